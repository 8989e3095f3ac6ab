/* schema_parts.c - see schema_parts.h */
#include "schema_parts.h"
#include <stdio.h>

cJSON *schema_document(const char *title)
{
    cJSON *o = cJSON_CreateObject();

    cJSON_AddStringToObject(o, "$schema", "https://json-schema.org/draft/2020-12/schema");
    cJSON_AddStringToObject(o, "title", title);
    cJSON_AddStringToObject(o, "type", "object");
    return o;
}

cJSON *schema_type(const char *type, bool null)
{
    cJSON *o = cJSON_CreateObject(), *list;

    if (!null) {
        cJSON_AddStringToObject(o, "type", type);
        return o;
    }
    list = cJSON_AddArrayToObject(o, "type");
    cJSON_AddItemToArray(list, cJSON_CreateString(type));
    cJSON_AddItemToArray(list, cJSON_CreateString("null"));
    return o;
}

cJSON *schema_list(cJSON *items)
{
    cJSON *o = schema_type("array", false);

    cJSON_AddItemToObject(o, "items", items);
    return o;
}

cJSON *schema_reference(const char *name)
{
    cJSON *o = cJSON_CreateObject();
    char path[128];

    snprintf(path, sizeof path, "#/$defs/%s", name);
    cJSON_AddStringToObject(o, "$ref", path);
    return o;
}

cJSON *schema_object(cJSON *properties, cJSON *others)
{
    cJSON *o = schema_type("object", false);

    cJSON_AddItemToObject(o, "properties", properties);
    cJSON_AddItemToObject(o, "additionalProperties",
                          others != NULL ? others : cJSON_CreateFalse());
    return o;
}

void schema_when(cJSON *all, const char *key, const char *word, bool maybe, const char *name)
{
    cJSON *rule = cJSON_CreateObject(), *when = cJSON_AddObjectToObject(rule, "if");
    cJSON *properties = cJSON_AddObjectToObject(when, "properties");

    cJSON_AddStringToObject(cJSON_AddObjectToObject(properties, key), "const", word);
    if (!maybe)
        cJSON_AddItemToArray(cJSON_AddArrayToObject(when, "required"), cJSON_CreateString(key));
    cJSON_AddItemToObject(rule, "then", schema_reference(name));
    cJSON_AddItemToArray(all, rule);
}

void schema_describe(cJSON *schema, const char *means, const char *unit)
{
    char text[400];

    snprintf(text, sizeof text, "%s%s%s%s", means != NULL ? means : "",
             unit != NULL && unit[0] != '\0' ? " [" : "", unit != NULL ? unit : "",
             unit != NULL && unit[0] != '\0' ? "]" : "");
    if (text[0] != '\0')
        cJSON_AddStringToObject(schema, "description", text);
}
