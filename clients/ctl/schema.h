/* schema.h - JSON Schemas (draft 2020-12) of scenes and results, made of the tables by which they
 * are read and told: scene_key.h, key_table.h, result_key.h */
#ifndef CTL_SCHEMA_H
#define CTL_SCHEMA_H
#include "base/json.h"

/* The caller deletes; NULL: no memory. */
cJSON *schema_scene(void);
cJSON *schema_result(void);
#endif
