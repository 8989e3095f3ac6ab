/* scene_help.c - see scene_help.h */
#include "scene_help.h"
#include <string.h>
#include "base/near.h"
#include "modal/scene/scene.h"
#include "modal/scene/scene_key.h"

enum { TYPES_MOST = 128 };           /* three times what there is */

static const char *type_of(const struct scene_key *key)
{
    switch (key->type) {
    case SCENE_NUMBER:  return "a number";
    case SCENE_WHOLE:   return "a whole number";
    case SCENE_TRUTH:   return "true or false";
    case SCENE_TEXT:    return "text";
    case SCENE_NUMBERS: return "a list of numbers";
    case SCENE_DOF:     return "a dof";
    case SCENE_ENDS:    return "weights by dof name";
    case SCENE_PLACE:   return "a dof, or weights by dof name";
    case SCENE_LIST:    return "a list of objects";
    case SCENE_WORD:    return "one of";
    default:            return NULL;
    }
}

static void print_range(FILE *to, const struct scene_key *key)
{
    if (key->type != SCENE_NUMBER && key->type != SCENE_WHOLE && key->type != SCENE_NUMBERS)
        return;
    if (key->low == SCENE_POSITIVE)
        fputs(", above 0", to);
    else if (key->low > -SCENE_LARGE)
        fprintf(to, ", from %g", key->low);
    if (key->high < SCENE_LARGE)
        fprintf(to, " to %g", key->high);
}

/* What holds where the key is absent. */
static void print_absent(FILE *to, const struct scene_key *key)
{
    bool counted = key->type == SCENE_NUMBER || key->type == SCENE_WHOLE;

    if (key->needed && key->unless == NULL)
        fputs("; needed", to);
    else if (key->needed)
        fprintf(to, "; needed without %s", key->unless);
    else if (key->otherwise != NULL)
        fprintf(to, "; default: %s", key->otherwise);
    else if (key->type == SCENE_WORD)
        fprintf(to, "; default %s", key->words[(int)key->standard]);
    else if (counted)
        fprintf(to, "; default %g", key->standard);
    if (key->with != NULL)
        fprintf(to, "; with %s", key->with);
}

static void print_keys(FILE *to, const struct scene_key *keys, int indent)
{
    for (; keys->name != NULL; keys++) {
        const char *type = type_of(keys);
        fprintf(to, "%*s%s", indent, "", keys->name);
        if (keys->means != NULL)
            fprintf(to, ": %s", keys->means);
        fprintf(to, "\n%*s%s", indent + 8, "", type != NULL ? type : "a form of its own");
        for (int i = 0; keys->words != NULL && keys->words[i] != NULL; i++)
            fprintf(to, "%s %s", i > 0 ? "," : "", keys->words[i]);
        if (keys->unit != NULL && keys->unit[0] != 0)
            fprintf(to, ", %s", keys->unit);
        print_range(to, keys);
        print_absent(to, keys);
        if (keys->example != NULL)
            fprintf(to, "; such as \"%s\": %s", keys->name, keys->example);
        fputc('\n', to);
        if (keys->members != NULL)
            print_keys(to, keys->members, indent + 4);
    }
}

static void print_table(FILE *to, const struct scene_table *t)
{
    fputs(t->list != NULL && t->list[0] != 0 ? t->list : "scene", to);
    if (t->name != NULL)
        fprintf(to, " of type \"%s\"", t->name);
    for (int i = 0; t->structures != NULL && t->structures[i] != NULL; i++)
        fprintf(to, "%s %s", i > 0 ? "," : " on", t->structures[i]);
    fputc('\n', to);
    if (t->law != NULL)
        fprintf(to, "  %s\n", t->law);
    for (int i = 0; i < SCENE_TABLES_MOST && t->keys[i] != NULL; i++)
        print_keys(to, t->keys[i], 4);
    fputc('\n', to);
}

static bool is_called(const struct scene_table *t, const char *type)
{
    return type == NULL || (t->name != NULL && strcmp(t->name, type) == 0)
           || (t->list != NULL && strcmp(t->list, type) == 0);
}

static enum modal_status no_type(const char *type, struct modal_error *err)
{
    const char *names[TYPES_MOST + 1];
    char list[1000] = "", meant[NEAR_TEXT];
    struct scene_table t;
    size_t used = 0;
    int count = 0;

    for (int i = 0; scene_tables(i, &t) && used < sizeof list && count < TYPES_MOST; i++)
        if (t.name != NULL) {
            names[count++] = t.name;
            used += (size_t)snprintf(list + used, sizeof list - used, "%s%s", used > 0 ? ", " : "",
                                     t.name);
        }
    names[count] = NULL;
    near_text(type, names, meant);
    return modal_fail_field(err, MODAL_BAD_INPUT, "type", "no part of a scene is of type "
                            "\"%.40s\"%s; accepted: %s", type, meant, list);
}

enum modal_status scene_help(FILE *to, const char *type, struct modal_error *err)
{
    struct scene_table t;
    int found = 0;

    for (int i = 0; scene_tables(i, &t); i++)
        if (is_called(&t, type)) {
            print_table(to, &t);
            found++;
        }
    return found > 0 ? MODAL_OK : no_type(type, err);
}
