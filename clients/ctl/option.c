/* option.c - see option.h */
#include "option.h"
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/utf8.h"

bool option_looks_like(const char *text)
{
    size_t n = 0;

    while (isalnum((unsigned char)text[n]) || (text[n] != 0 && strchr("._[]", text[n]) != NULL))
        n++;
    return n > 0 && isalpha((unsigned char)text[0]) && text[n] == '=';
}

/* A number of the C locale, without the words (nan, inf) and the hexadecimal forms that strtod
 * takes. */
static bool is_number(const char *text, double *value)
{
    char *end;

    if (text[0] == 0 || strspn(text, "0123456789+-.eE") != strlen(text))
        return false;
    *value = strtod(text, &end);
    return end != text && *end == 0;
}

static cJSON *read_one(const char *text)
{
    double value;

    if (strcmp(text, "true") == 0 || strcmp(text, "false") == 0)
        return cJSON_CreateBool(text[0] == 't');
    if (strcmp(text, "null") == 0)
        return cJSON_CreateNull();
    return is_number(text, &value) ? cJSON_CreateNumber(value) : cJSON_CreateString(text);
}

static cJSON *read_list(const char *text)
{
    cJSON *list = cJSON_CreateArray();
    char *copy = strdup(text), *rest = copy, *part;

    while (list != NULL && copy != NULL && (part = strsep(&rest, ",")) != NULL)
        cJSON_AddItemToArray(list, read_one(part));
    free(copy);
    return list;
}

/* The first number in TEXT that does not fit a double, if any: 1e999 must not become infinity in
 * silence. */
static bool overflows(const cJSON *value)
{
    if (cJSON_IsNumber(value))
        return !isfinite(value->valuedouble);
    for (const cJSON *item = cJSON_IsArray(value) ? value->child : NULL; item != NULL;
         item = item->next)
        if (overflows(item))
            return true;
    return false;
}

static enum modal_status put(cJSON *options, const char *key, cJSON *value, struct modal_error *err)
{
    if (value == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory for option %s", key);
    cJSON_DeleteItemFromObjectCaseSensitive(options, key);
    if (!cJSON_AddItemToObject(options, key, value)) {
        cJSON_Delete(value);
        return modal_fail(err, MODAL_NO_MEMORY, "no memory for option %s", key);
    }
    return MODAL_OK;
}

enum modal_status option_set_text(cJSON *options, const char *key, const char *value,
                                  struct modal_error *err)
{
    return put(options, key, cJSON_CreateString(value), err);
}

enum modal_status option_add(cJSON *options, const char *text, struct modal_error *err)
{
    const char *equals = strchr(text, '=');
    char key[128];
    cJSON *value = NULL;

    snprintf(key, sizeof key, "%.*s", equals ? (int)(equals - text) : (int)strlen(text), text);
    if (equals == NULL || equals == text || equals[1] == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, key[0] ? key : "option",
                                "-o \"%.80s\": accepted: KEY=VALUE, neither empty", text);
    if (!utf8_valid(text))
        return modal_fail_field(err, MODAL_BAD_INPUT, "option", "-o: not UTF-8");
    text = equals + 1;
    if (strchr("[{\"", text[0]) != NULL) {
        struct modal_error inner = { 0 };
        if (json_read(text, strlen(text), &value, &inner) != MODAL_OK)
            return modal_fail_field(err, MODAL_BAD_INPUT, key, "-o %s: %.300s", key, inner.message);
    } else {
        value = strchr(text, ',') != NULL ? read_list(text) : read_one(text);
    }
    if (value != NULL && overflows(value)) {
        cJSON_Delete(value);
        return modal_fail_field(err, MODAL_BAD_INPUT, key,
                                "-o %s=%.60s: the number is beyond the range of a double", key,
                                text);
    }
    return put(options, key, value, err);
}
