/* canonical.h - the text of a JSON value that is the same whatever order its members came in */
#ifndef BASE_CANONICAL_H
#define BASE_CANONICAL_H
#include <cjson/cJSON.h>

/*
 * VALUE as json_print prints it, the members of every object in the order of their names' bytes:
 * two values are the same if their texts are.  NULL is the empty object.  The caller frees the
 * text; NULL when memory runs out.
 */
char *canonical_text(const cJSON *value);
#endif
