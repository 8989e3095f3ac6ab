/* field.c - see field.h */
#include "field.h"

const char *field_word(const cJSON *object, const char *key, const char *otherwise)
{
    const char *s = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, key));

    return s != NULL ? s : otherwise;
}

double field_number(const cJSON *object, const char *key, double otherwise)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);

    return cJSON_IsNumber(item) ? item->valuedouble : otherwise;
}
