/* scene_schema.c - the schema of scenes; see schema.h */
#include <stdio.h>
#include <string.h>
#include "job/job_options.h"
#include "modal/scene/scene.h"
#include "modal/scene/scene_key.h"
#include "schema.h"
#include "schema_parts.h"

/* A range's ends, where they are of the user's concern. */
static void add_range(cJSON *o, double low, double high)
{
    if (low == SCENE_POSITIVE)
        cJSON_AddNumberToObject(o, "exclusiveMinimum", 0);
    else if (low > -SCENE_LARGE)
        cJSON_AddNumberToObject(o, "minimum", low);
    if (high < SCENE_LARGE)
        cJSON_AddNumberToObject(o, "maximum", high);
}

static cJSON *word_of(const char *const *words)
{
    cJSON *o = cJSON_CreateObject(), *list = cJSON_AddArrayToObject(o, "enum");

    for (; *words != NULL; words++)
        cJSON_AddItemToArray(list, cJSON_CreateString(*words));
    return o;
}

static cJSON *part_of(const struct scene_key *const *tables);

static cJSON *value_of(const struct scene_key *key)
{
    static const char *const types[] = {
        [SCENE_NUMBER] = "number", [SCENE_WHOLE] = "integer", [SCENE_TRUTH] = "boolean",
        [SCENE_TEXT] = "string", [SCENE_DOF] = "string", [SCENE_NUMBERS] = "number",
        [SCENE_WORD] = NULL, [SCENE_ENDS] = "object", [SCENE_PLACE] = "object", [SCENE_LIST] = NULL,
        [SCENE_OWN] = NULL,
    };
    cJSON *o;

    if (key->type == SCENE_WORD)
        return word_of(key->words);
    if (key->type == SCENE_LIST) {
        o = schema_list(part_of((const struct scene_key *const[]){ key->members, NULL }));
        cJSON_AddNumberToObject(o, "minItems", key->low);
        cJSON_AddNumberToObject(o, "maxItems", key->high);
        return o;
    }
    if (key->type == SCENE_OWN)
        return key->members != NULL ? part_of((const struct scene_key *const[]){ key->members,
                                                                                NULL })
                                    : cJSON_CreateObject();
    o = schema_type(types[key->type], false);
    if (key->type == SCENE_ENDS || key->type == SCENE_PLACE) {
        cJSON_AddItemToObject(o, "additionalProperties", schema_type("number", false));
        cJSON_AddNumberToObject(o, "minProperties", 1);
        cJSON_AddNumberToObject(o, "maxProperties", LAW_ENDS_MOST);
    }
    if (key->type == SCENE_PLACE) {
        cJSON *either = cJSON_CreateObject(), *list = cJSON_AddArrayToObject(either, "anyOf");
        cJSON_AddItemToArray(list, schema_type("string", false));
        cJSON_AddItemToArray(list, o);
        o = either;
    }
    if (key->type == SCENE_NUMBER || key->type == SCENE_WHOLE || key->type == SCENE_NUMBERS)
        add_range(o, key->low, key->high);
    return key->type == SCENE_NUMBERS ? schema_list(o) : o;
}

static cJSON *required(const char *name)
{
    cJSON *o = cJSON_CreateObject();

    cJSON_AddItemToArray(cJSON_AddArrayToObject(o, "required"), cJSON_CreateString(name));
    return o;
}

/* What must stand beside what. */
static void add_needs(const struct scene_key *key, cJSON *needed, cJSON *either, cJSON *drawn)
{
    cJSON *one, *list;

    if (key->needed && key->unless == NULL)
        cJSON_AddItemToArray(needed, cJSON_CreateString(key->name));
    if (key->needed && key->unless != NULL) {
        list = cJSON_AddArrayToObject(one = cJSON_CreateObject(), "anyOf");
        cJSON_AddItemToArray(list, required(key->name));
        cJSON_AddItemToArray(list, required(key->unless));
        cJSON_AddItemToArray(either, one);
    }
    if (key->with != NULL)
        cJSON_AddItemToArray(cJSON_AddArrayToObject(drawn, key->with),
                             cJSON_CreateString(key->name));
}

/* An object with the keys of TABLES and no others. */
static cJSON *part_of(const struct scene_key *const *tables)
{
    cJSON *properties = cJSON_CreateObject(), *needed = cJSON_CreateArray(),
          *either = cJSON_CreateArray(), *drawn = cJSON_CreateObject(), *o;

    for (; *tables != NULL; tables++)
        for (const struct scene_key *key = *tables; key->name != NULL; key++) {
            cJSON *value = value_of(key);
            schema_describe(value, key->means, key->unit);
            cJSON_AddItemToObject(properties, key->name, value);
            add_needs(key, needed, either, drawn);
        }
    o = schema_object(properties, NULL);
    cJSON_AddItemToObject(o, "required", needed);
    if (cJSON_GetArraySize(either) > 0)
        cJSON_AddItemToObject(o, "allOf", either);
    else
        cJSON_Delete(either);
    if (drawn->child != NULL)
        cJSON_AddItemToObject(o, "dependentRequired", drawn);
    else
        cJSON_Delete(drawn);
    return o;
}

/* ---- `steady`: options of a job ---- */

static cJSON *option_of(const struct key_row *row)
{
    static const char *const types[] = {
        [KEY_NUMBER] = "number", [KEY_WHOLE] = "integer", [KEY_TRUTH] = "boolean",
        [KEY_TEXT] = "string", [KEY_CHOICE] = NULL, [KEY_INTERVAL] = NULL, [KEY_OWN] = NULL,
    };
    cJSON *o;

    if (row->type == KEY_CHOICE)
        return word_of(row->words);
    if (row->type == KEY_OWN)
        return cJSON_CreateObject();
    o = schema_type(row->type == KEY_INTERVAL ? "number" : types[row->type], false);
    if (row->type != KEY_TRUTH && row->type != KEY_TEXT)
        add_range(o, row->low, row->high);
    return row->type == KEY_INTERVAL ? schema_list(o) : o;
}

/* Those of the first table alone: curves are asked for outside the scene. */
static cJSON *steady_options(void)
{
    const struct job_option_table *t = job_option_tables;
    cJSON *properties = cJSON_CreateObject();

    while (strcmp(t->kind, "steady") != 0)
        t++;
    for (const struct key_row *row = t->rows; row->name != NULL; row++) {
        cJSON *value = option_of(row);
        schema_describe(value, row->meaning, row->unit);
        cJSON_AddItemToObject(properties, row->name, value);
    }
    return schema_object(properties, NULL);
}

/* ---- parts that have types ---- */

/* Is TYPE what its list takes a part for that names none? */
static bool is_default(const struct scene_table *t)
{
    char quoted[64];

    snprintf(quoted, sizeof quoted, "\"%s\"", t->name);
    for (int i = 0; i < SCENE_TABLES_MOST && t->keys[i] != NULL; i++)
        for (const struct scene_key *key = t->keys[i]; key->name != NULL; key++)
            if (strcmp(key->name, "type") == 0 && key->otherwise != NULL)
                return strcmp(key->otherwise, quoted) == 0;
    return false;
}

/* Every part of LIST into PARTS; what one of them must be is returned. */
static cJSON *parts_of(const char *list, cJSON *parts)
{
    cJSON *o = schema_type("object", false), *types = cJSON_CreateArray(),
          *all = cJSON_CreateArray(), *any = cJSON_CreateArray(), *type;
    struct scene_table t;
    char name[64];
    bool needed = true;

    for (int i = 0; scene_tables(i, &t); i++) {
        if (strcmp(t.list, list) != 0)
            continue;
        if (t.name != NULL)
            snprintf(name, sizeof name, "%s.%s", list, t.name);
        else
            snprintf(name, sizeof name, "%s.%d", list, cJSON_GetArraySize(any));
        cJSON_AddItemToObject(parts, name, part_of(t.keys));
        if (t.name != NULL) {
            cJSON_AddItemToArray(types, cJSON_CreateString(t.name));
            schema_when(all, "type", t.name, is_default(&t), name);
            needed &= !is_default(&t);
        } else
            cJSON_AddItemToArray(any, schema_reference(name));
    }
    if (cJSON_GetArraySize(types) > 0) {
        type = cJSON_AddObjectToObject(cJSON_AddObjectToObject(o, "properties"), "type");
        cJSON_AddItemToObject(type, "enum", types);
        cJSON_AddItemToObject(o, "allOf", all);
        if (needed)
            cJSON_AddItemToArray(cJSON_AddArrayToObject(o, "required"),
                                 cJSON_CreateString("type"));
        cJSON_Delete(any);
    } else {
        cJSON_AddItemToObject(o, "anyOf", any);
        cJSON_Delete(types);
        cJSON_Delete(all);
    }
    return o;
}

cJSON *schema_scene(void)
{
    static const struct { const char *key; bool list; } typed[] = {
        { "structure", false }, { "effects", true }, { "excitation", true }, { "sensors", true },
    };
    struct scene_table t;
    cJSON *o = schema_document("A scene: the input of steady, simulate, floquet and ablate");
    cJSON *parts = cJSON_CreateObject(), *properties;

    scene_tables(0, &t);                                /* the scene's own */
    cJSON *whole = part_of(t.keys);
    properties = cJSON_GetObjectItemCaseSensitive(whole, "properties");
    for (size_t i = 0; i < sizeof typed / sizeof *typed; i++) {
        cJSON *one = parts_of(typed[i].key, parts);
        cJSON_ReplaceItemInObjectCaseSensitive(properties, typed[i].key,
                                               typed[i].list ? schema_list(one) : one);
    }
    cJSON_ReplaceItemInObjectCaseSensitive(properties, "steady", steady_options());
    while (whole->child != NULL) {
        cJSON *item = cJSON_DetachItemViaPointer(whole, whole->child);
        if (strcmp(item->string, "type") == 0)
            cJSON_Delete(item);                         /* the document has said it */
        else
            cJSON_AddItemToObject(o, item->string, item);
    }
    cJSON_Delete(whole);
    cJSON_AddItemToObject(o, "$defs", parts);
    return o;
}
