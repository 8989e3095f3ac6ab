/* field.c - see field.h */
#include "field.h"
#include <limits.h>
#include <math.h>

const cJSON *field_get(const cJSON *object, const char *key)
{
    return cJSON_GetObjectItemCaseSensitive(object, key);
}

double field_real(const cJSON *object, const char *key)
{
    return field_number(object, key, NAN);
}

double field_at(const cJSON *list, int i)
{
    const cJSON *item = cJSON_GetArrayItem(list, i);

    return cJSON_IsNumber(item) ? item->valuedouble : NAN;
}

const char *field_word(const cJSON *object, const char *key, const char *otherwise)
{
    const char *s = cJSON_GetStringValue(field_get(object, key));

    return s != NULL ? s : otherwise;
}

double field_number(const cJSON *object, const char *key, double otherwise)
{
    const cJSON *item = field_get(object, key);

    return cJSON_IsNumber(item) ? item->valuedouble : otherwise;
}

/* cJSON keeps what is beyond an int at its ends. */
static int index_of(const cJSON *item)
{
    return cJSON_IsNumber(item) && item->valueint >= 0 && item->valueint < INT_MAX ? item->valueint
                                                                                  : -1;
}

int field_index(const cJSON *object, const char *key)
{
    return index_of(field_get(object, key));
}

int field_index_at(const cJSON *list, int i)
{
    return index_of(cJSON_GetArrayItem(list, i));
}
