/* schema_parts.h - what both schemas are put together of */
#ifndef CTL_SCHEMA_PARTS_H
#define CTL_SCHEMA_PARTS_H
#include <stdbool.h>
#include "base/json.h"

/* {"$schema", "title", "type": "object"}: what a document begins with; the caller deletes. */
cJSON *schema_document(const char *title);

/* {"type": TYPE}, or with null beside it. */
cJSON *schema_type(const char *type, bool null);

/* {"type": "array", "items": ITEMS}, which it takes over. */
cJSON *schema_list(cJSON *items);

/* {"$ref": "#/$defs/NAME"} */
cJSON *schema_reference(const char *name);

/* An object of PROPERTIES (taken over) and no others but, where OTHERS is not NULL, such ones. */
cJSON *schema_object(cJSON *properties, cJSON *others);

/* Where the member KEY is WORD, or absent and MAYBE, {"$ref"} to NAME: into the list ALL. */
void schema_when(cJSON *all, const char *key, const char *word, bool maybe, const char *name);

/* Put MEANS, and UNIT where there is one, into SCHEMA as its description. */
void schema_describe(cJSON *schema, const char *means, const char *unit);
#endif
