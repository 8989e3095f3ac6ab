/* result_schema.c - the schema of results; see schema.h */
#include <stdio.h>
#include <string.h>
#include "job/result_key.h"
#include "schema.h"
#include "schema_parts.h"

static cJSON *object_of(const struct result_key *keys, const char *const *as);

static cJSON *pair(bool null)
{
    cJSON *o = schema_type("array", null);

    cJSON_AddItemToObject(o, "items", schema_type("number", null));
    cJSON_AddNumberToObject(o, "minItems", 2);
    cJSON_AddNumberToObject(o, "maxItems", 2);
    return o;
}

/* Of one of KEY where it is a list. */
static cJSON *value_of(const struct result_key *key)
{
    static const char *const types[] = {
        [RESULT_NUMBER] = "number", [RESULT_WHOLE] = "integer", [RESULT_TRUTH] = "boolean",
        [RESULT_TEXT] = "string",
    };

    if (key->type == RESULT_OWN)
        return cJSON_CreateObject();                    /* all is accepted */
    if (key->type == RESULT_OBJECT)
        return object_of(key->members, key->as);
    if (key->type == RESULT_COMPLEX || key->type == RESULT_SPAN)
        return pair(key->null != NULL);
    return schema_type(types[key->type], key->null != NULL);
}

static cJSON *member_of(const struct result_key *key)
{
    cJSON *value = value_of(key), *o = key->list != NULL ? schema_list(value) : value;

    schema_describe(o, key->means, key->unit);
    return o;
}

/* A name that two kinds have in different forms may have either. */
static void add_property(cJSON *properties, const char *name, cJSON *schema)
{
    cJSON *there = cJSON_GetObjectItemCaseSensitive(properties, name), *any, *list;

    if (there == NULL) {
        cJSON_AddItemToObject(properties, name, schema);
        return;
    }
    any = cJSON_CreateObject();
    list = cJSON_AddArrayToObject(any, "anyOf");
    cJSON_AddItemToArray(list, cJSON_Duplicate(there, true));
    cJSON_AddItemToArray(list, schema);
    cJSON_ReplaceItemInObjectCaseSensitive(properties, name, any);
}

/* Those of another kind, but what again holds whole results. */
static void add_like(cJSON *properties, const char *kind)
{
    const struct result_document *d = result_documents;
    char path[128];

    while (strcmp(d->kind, kind) != 0)
        d++;
    for (const struct result_key *k = d->keys; k->name != NULL; k++)
        if (k->as[0] == NULL) {
            snprintf(path, sizeof path, "%s/properties/%s", kind, k->name);
            add_property(properties, k->name, schema_reference(path));
        }
}

static cJSON *object_of(const struct result_key *keys, const char *const *as)
{
    cJSON *properties = cJSON_CreateObject(), *others = NULL, *required = cJSON_CreateArray(), *o;

    for (; keys != NULL && keys->name != NULL; keys++)
        if (keys->name[0] == '<')
            others = member_of(keys);
        else {
            cJSON_AddItemToObject(properties, keys->name, member_of(keys));
            if (keys->absent == NULL)
                cJSON_AddItemToArray(required, cJSON_CreateString(keys->name));
        }
    for (; as != NULL && *as != NULL; as++)
        add_like(properties, *as);
    o = schema_object(properties, others);
    cJSON_AddItemToObject(o, "required", required);
    return o;
}

cJSON *schema_result(void)
{
    cJSON *o = schema_document("A result of a job, by its kind"), *all, *parts, *kinds;

    cJSON_AddItemToArray(cJSON_AddArrayToObject(o, "required"), cJSON_CreateString("kind"));
    kinds = cJSON_AddArrayToObject(
        cJSON_AddObjectToObject(cJSON_AddObjectToObject(o, "properties"), "kind"), "enum");
    all = cJSON_AddArrayToObject(o, "allOf");
    parts = cJSON_AddObjectToObject(o, "$defs");
    for (const struct result_document *d = result_documents; d->kind != NULL; d++)
        if (d->result) {
            cJSON_AddItemToArray(kinds, cJSON_CreateString(d->kind));
            schema_when(all, "kind", d->kind, false, d->kind);
            cJSON_AddItemToObject(parts, d->kind, object_of(d->keys, NULL));
        }
    return o;
}
