/* field.h - one field of a document that a server sent */
#ifndef CTL_FIELD_H
#define CTL_FIELD_H
#include "base/json.h"

/* NULL where OBJECT has no such field, or is none. */
const cJSON *field_get(const cJSON *object, const char *key);

/* NAN where OBJECT has no such number; of LIST, its item I. */
double field_real(const cJSON *object, const char *key);
double field_at(const cJSON *list, int i);

/* OTHERWISE where OBJECT has no such field, or one of another type. The text is the document's. */
const char *field_word(const cJSON *object, const char *key, const char *otherwise);
double field_number(const cJSON *object, const char *key, double otherwise);

/* A place in a list, from 0: -1 where OBJECT has no such number, or it is a place in no list. Of
 * LIST, its item I. */
int field_index(const cJSON *object, const char *key);
int field_index_at(const cJSON *list, int i);
#endif
