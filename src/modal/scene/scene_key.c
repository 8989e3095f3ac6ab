/* scene_key.c - see scene_key.h
 *
 * Reading goes row by row: first every name of the object must be one of the rows', then each row
 * is looked for, so that a misspelt key is told before the one that it leaves missing.
 */
#include "modal/scene/scene_key.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/lowering.h"

enum { KEYS_MOST = 32 };           /* of one part: the test of all tables counts them */

const struct scene_key scene_type_keys[] = {
    { "type", SCENE_TEXT, SCENE_ELSEWHERE, .means = "which of its kind it is" },
    { 0 },
};

/* What is accepted for KEY, where it is not there at all; wrong values are told by json.h. */
static const char *accepted(const struct scene_key *key)
{
    static const char *const texts[] = {
        [SCENE_NUMBER] = "a number", [SCENE_WHOLE] = "a whole number",
        [SCENE_TRUTH] = "true, false", [SCENE_WORD] = "a string",
        [SCENE_TEXT] = "a string", [SCENE_NUMBERS] = "a list of numbers",
        [SCENE_DOF] = "the name of a dof", [SCENE_ENDS] = "weights by dof name",
        [SCENE_PLACE] = "the name of a dof, or weights by dof name",
        [SCENE_LIST] = "a list of objects", [SCENE_OWN] = "a value",
    };

    return texts[key->type];
}

/* A failure that is KEY's, RC, ends with what KEY is: "(N/m; k in f = k d)". */
static enum modal_status explain(const struct scene_key *key, enum modal_status rc,
                                 struct modal_error *err)
{
    const char *unit = key->unit != NULL ? key->unit : "";
    size_t length = err != NULL ? strlen(err->message) : 0;

    /* a lack of memory is no key's */
    if (rc == MODAL_BAD_INPUT && err != NULL && key->means != NULL)
        snprintf(err->message + length, sizeof err->message - length, " (%s%s%s)", unit,
                 unit[0] != '\0' ? "; " : "", key->means);
    return rc;
}

/* MODAL_BAD_INPUT at the key that is not there. */
static enum modal_status missing(const char *path, const struct scene_key *key,
                                 struct modal_error *err)
{
    char where[128];

    json_path(where, path, key->name);
    return explain(key, modal_fail_field(err, MODAL_BAD_INPUT, where, "%s is missing; accepted: %s",
                                         where, accepted(key)), err);
}

/* KEY's objects into *TO, counted. */
static enum modal_status read_list(const cJSON *json, const char *path, const struct scene_key *key,
                                   const cJSON **to, struct modal_error *err)
{
    const cJSON *list = json_member(json, key->name), *item;
    int count = cJSON_IsArray(list) ? cJSON_GetArraySize(list) : 0;
    char where[128], *text;

    *to = list;
    if (list == NULL)
        return MODAL_OK;
    json_path(where, path, key->name);
    if (count > (int)key->high)
        return modal_fail_field(err, MODAL_TOO_LARGE, where, "%s has %d objects; at most %d", where,
                                count, (int)key->high);
    cJSON_ArrayForEach(item, list)
        count -= !cJSON_IsObject(item);
    if (count >= (int)key->low && count == cJSON_GetArraySize(list))
        return MODAL_OK;
    text = json_print(list);
    modal_fail_field(err, MODAL_BAD_INPUT, where, "%s is %.60s; accepted: a list of %d to %d "
                     "objects", where, text != NULL ? text : "no such list", (int)key->low,
                     (int)key->high);
    cJSON_free(text);
    return MODAL_BAD_INPUT;
}

/* KEY's default into *TO, then its value where JSON has one. */
static enum modal_status read_value(const struct lowering *l, const cJSON *json, const char *path,
                                    const struct scene_key *key, void *to, struct modal_error *err)
{
    struct scene_numbers *list = to;

    switch (key->type) {
    case SCENE_NUMBER:
        *(double *)to = key->standard;  /* json_get_number leaves it where the key is absent */
        return json_get_number(json, path, key->name, key->low, key->high, to, err);
    case SCENE_WHOLE:
        *(int *)to = (int)key->standard;
        return json_get_int(json, path, key->name, (int)key->low, (int)key->high, to, err);
    case SCENE_TRUTH:
        return json_get_bool(json, path, key->name, to, err);
    case SCENE_WORD:
        *(int *)to = (int)key->standard;
        return json_get_choice(json, path, key->name, key->words, to, err);
    case SCENE_TEXT:
        return json_get_string(json, path, key->name, to, err);
    case SCENE_NUMBERS:
        return json_get_numbers(json, path, key->name, key->low, key->high, &list->x, &list->count,
                                err);
    case SCENE_DOF:
        *(int *)to = -1;
        return lowering_dof(l, json, path, key->name, to, err);
    case SCENE_ENDS:
    case SCENE_PLACE:
        return lowering_ends(l, json, path, key->name, key->type == SCENE_PLACE, to, err);
    case SCENE_LIST:
        return read_list(json, path, key, to, err);
    case SCENE_OWN:
        *(const cJSON **)to = json_member(json, key->name);
        break;
    }
    return MODAL_OK;
}

/* One row: is it needed, then its default and its value. */
static enum modal_status read_key(const struct lowering *l, const cJSON *json, const char *path,
                                  const struct scene_key *key, void *values,
                                  struct modal_error *err)
{
    /* the other key says it */
    bool excused = key->unless != NULL && json_member(json, key->unless) != NULL;
    /* the other key asks for it */
    bool drawn = key->with != NULL && json_member(json, key->with) != NULL;

    if (((key->needed && !excused) || drawn) && json_member(json, key->name) == NULL)
        return missing(path, key, err);
    if (key->at == SCENE_ELSEWHERE)  /* known, but not read here */
        return MODAL_OK;
    enum modal_status rc = read_value(l, json, path, key, (char *)values + key->at, err);
    /* what is wrong with a dof is its name, whatever for */
    return key->type == SCENE_DOF || key->type == SCENE_ENDS || key->type == SCENE_PLACE
               ? rc : explain(key, rc, err);
}

/* Every key of JSON is in one of the tables. */
static enum modal_status check_names(const cJSON *json, const char *path,
                                     const struct scene_key *const *tables, struct modal_error *err)
{
    const char *names[KEYS_MOST + 1] = { NULL };
    int count = 0;

    for (; *tables != NULL; tables++)
        for (const struct scene_key *key = *tables; key->name != NULL && count < KEYS_MOST; key++)
            names[count++] = key->name;  /* for the message: it lists and suggests them */
    return json_keys(json, path, names, err);
}

enum modal_status scene_keys_read(const struct lowering *l, const cJSON *json, const char *path,
                                  const struct scene_key *const *tables, void *values,
                                  struct modal_error *err)
{
    enum modal_status rc = check_names(json, path, tables, err);

    for (; rc == MODAL_OK && *tables != NULL; tables++)
        for (const struct scene_key *key = *tables; rc == MODAL_OK && key->name != NULL; key++)
            rc = read_key(l, json, path, key, values, err);
    return rc;
}

void scene_keys_free(const struct scene_key *const *tables, void *values)
{
    for (; values != NULL && *tables != NULL; tables++)
        for (const struct scene_key *key = *tables; key->name != NULL; key++)
            if (key->type == SCENE_NUMBERS)
                free(((struct scene_numbers *)((char *)values + key->at))->x);
            else if (key->type == SCENE_ENDS || key->type == SCENE_PLACE)
                free(((struct scene_ends *)((char *)values + key->at))->x);
}

enum modal_status scene_key_need(const cJSON *json, const char *path, const struct scene_key *keys,
                                 const char *name, struct modal_error *err)
{
    while (keys->name != NULL && strcmp(keys->name, name) != 0)
        keys++;
    return json_member(json, name) != NULL ? MODAL_OK : missing(path, keys, err);
}
