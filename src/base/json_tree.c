/* json_tree.c - what a tree holds, checked on the way out, with errors that name the path; see
 * json.h */
#include "base/json.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/near.h"

void json_memory_by(void *(*allocate)(size_t size))
{
    cJSON_InitHooks(&(cJSON_Hooks) { .malloc_fn = allocate, .free_fn = free });
}

void json_put(cJSON *object, const char *key, cJSON *item)
{
    if (object != NULL && item != NULL && cJSON_AddItemToObject(object, key, item))
        return;
    cJSON_Delete(item);
    if (object != NULL)
        object->type = cJSON_Invalid;
}

void json_put_string(cJSON *object, const char *key, const char *value)
{
    json_put(object, key, cJSON_CreateString(value));
}

void json_put_number(cJSON *object, const char *key, double value)
{
    json_put(object, key, cJSON_CreateNumber(value));
}

void json_path(char out[JSON_PATH_SIZE], const char *base, const char *key)
{
    /* an empty key has a name too, or the error would name the document */
    const char *part[] = { base, base[0] != '\0' && key[0] != '[' ? "." : "",
                           key[0] != '\0' ? key : "\"\"" };
    size_t n = 0;

    /* a path for each key that a scene has: snprintf takes twenty times as long */
    for (int i = 0; i < 3; i++)
        for (const char *c = part[i]; *c != '\0' && n + 1 < JSON_PATH_SIZE; c++)
            out[n++] = *c;
    out[n] = '\0';
}

const cJSON *json_member(const cJSON *object, const char *key)
{
    const cJSON *child = cJSON_IsObject(object) ? object->child : NULL;

    while (child != NULL && (child->string[0] != key[0] || strcmp(child->string, key) != 0))
        child = child->next;
    return child;
}

enum { KEYS_MOST = 64 };   /* of a table that is listed: twice the longest there is */

/* Limits beyond these keep computations within the doubles; a user need not be told of them. */
static const double TINY = 1e-290;
static const double HUGE_NUMBER = 1e290;

/* "a, b, c" of a NULL-terminated list. */
static void list_words(char *out, size_t room, const char *const *words)
{
    size_t n = 0;

    out[0] = '\0';
    for (int i = 0; words[i] != NULL && n < room; i++)
        n += (size_t)snprintf(out + n, room - n, "%s%s", i ? ", " : "", words[i]);
}

static bool is_word(const char *s, const char *const *words, int *index)
{
    for (int i = 0; words[i] != NULL; i++)
        if (s[0] == words[i][0] && strcmp(s, words[i]) == 0) {
            *index = i;
            return true;
        }
    return false;
}

static int by_name(const void *a, const void *b)
{
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

/* "; did you mean a, b?; accepted: a, b, c", in the alphabet's order. */
static enum modal_status unknown_key(const char *path, const char *key, const char *const *names,
                                     struct modal_error *err)
{
    const char *sorted[KEYS_MOST + 1] = { NULL };
    char accepted[NEAR_ACCEPTED];
    int count = 0;

    while (count < KEYS_MOST && names[count] != NULL)
        sorted[count] = names[count], count++;
    qsort(sorted, (size_t)count, sizeof *sorted, by_name);
    near_accepted(key, sorted, accepted);
    return modal_fail_field(err, MODAL_BAD_INPUT, path, "unknown key \"%.60s\"%s", key, accepted);
}

enum modal_status json_keys(const cJSON *object, const char *base, const char *const *names,
                            struct modal_error *err)
{
    char path[128];
    int index;

    if (!cJSON_IsObject(object))
        return modal_fail_field(err, MODAL_BAD_INPUT, base, "%s must be an object",
                                base[0] ? base : "the document");
    for (const cJSON *child = object->child; child != NULL; child = child->next)
        if (!is_word(child->string, names, &index)) {
            json_path(path, base, child->string);
            return unknown_key(path, child->string, names, err);
        }
    return MODAL_OK;
}

static enum modal_status wrong_type(const cJSON *item, const char *base, const char *key,
                                    const char *accepted, struct modal_error *err)
{
    char path[128], *text = json_print(item);
    enum modal_status rc;

    json_path(path, base, key);
    rc = modal_fail_field(err, MODAL_BAD_INPUT, path, "%s is %.80s; accepted: %s", path,
                          text ? text : "?", accepted);
    free(text);
    return rc;
}

enum modal_status json_get_number(const cJSON *object, const char *base, const char *key,
                                  double low, double high, double *out, struct modal_error *err)
{
    const cJSON *item = json_member(object, key);
    char accepted[96];

    if (item == NULL)
        return MODAL_OK;
    if (!cJSON_IsNumber(item) || !(item->valuedouble >= low && item->valuedouble <= high)) {
        if (isinf(low) && isinf(high))
            snprintf(accepted, sizeof accepted, "a number");
        else if (low > 0 && low < TINY && high > HUGE_NUMBER)
            snprintf(accepted, sizeof accepted, "a positive number");
        else if (isinf(high) || high > HUGE_NUMBER)
            snprintf(accepted, sizeof accepted,
                     low < -HUGE_NUMBER ? "a finite number" : "a number of at least %g", low);
        else
            snprintf(accepted, sizeof accepted, "a number from %g to %g", low, high);
        return wrong_type(item, base, key, accepted, err);
    }
    *out = item->valuedouble;
    return MODAL_OK;
}

enum modal_status json_get_int(const cJSON *object, const char *base, const char *key, int low,
                               int high, int *out, struct modal_error *err)
{
    const cJSON *item = json_member(object, key);
    char accepted[96];

    if (item == NULL)
        return MODAL_OK;
    if (!cJSON_IsNumber(item) || item->valuedouble != floor(item->valuedouble)
        || !(item->valuedouble >= low && item->valuedouble <= high)) {
        snprintf(accepted, sizeof accepted, "a whole number from %d to %d", low, high);
        return wrong_type(item, base, key, accepted, err);
    }
    *out = (int)item->valuedouble;
    return MODAL_OK;
}

enum modal_status json_get_bool(const cJSON *object, const char *base, const char *key, bool *out,
                                struct modal_error *err)
{
    const cJSON *item = json_member(object, key);

    if (item == NULL)
        return MODAL_OK;
    if (!cJSON_IsBool(item))
        return wrong_type(item, base, key, "true, false", err);
    *out = cJSON_IsTrue(item);
    return MODAL_OK;
}

enum modal_status json_get_string(const cJSON *object, const char *base, const char *key,
                                  const char **out, struct modal_error *err)
{
    const cJSON *item = json_member(object, key);

    if (item == NULL)
        return MODAL_OK;
    if (!cJSON_IsString(item))
        return wrong_type(item, base, key, "a string", err);
    *out = item->valuestring;
    return MODAL_OK;
}

static enum modal_status need(const cJSON *object, const char *base, const char *key,
                              const char *accepted, struct modal_error *err)
{
    char path[128];

    if (json_member(object, key) != NULL)
        return MODAL_OK;
    json_path(path, base, key);
    return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s is missing; accepted: %s", path,
                            accepted);
}

enum modal_status json_need_number(const cJSON *object, const char *base, const char *key,
                                   double low, double high, double *out, struct modal_error *err)
{
    enum modal_status rc = need(object, base, key, "a number", err);

    return rc == MODAL_OK ? json_get_number(object, base, key, low, high, out, err) : rc;
}

enum modal_status json_need_string(const cJSON *object, const char *base, const char *key,
                                   const char **out, struct modal_error *err)
{
    enum modal_status rc = need(object, base, key, "a string", err);

    return rc == MODAL_OK ? json_get_string(object, base, key, out, err) : rc;
}

enum modal_status json_get_choice(const cJSON *object, const char *base, const char *key,
                                  const char *const *words, int *out, struct modal_error *err)
{
    const cJSON *item = json_member(object, key);
    char path[128], list[NEAR_ACCEPTED];

    if (item == NULL || (cJSON_IsString(item) && is_word(item->valuestring, words, out)))
        return MODAL_OK;
    if (!cJSON_IsString(item)) {
        list_words(list, sizeof list, words);
        return wrong_type(item, base, key, list, err);
    }
    json_path(path, base, key);
    near_accepted(item->valuestring, words, list);
    return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s is \"%.60s\"%s", path,
                            item->valuestring, list);
}

enum modal_status json_get_numbers(const cJSON *object, const char *base, const char *key,
                                   double low, double high, double **out, size_t *count,
                                   struct modal_error *err)
{
    const cJSON *list = json_member(object, key), *item;
    size_t n = 0;
    double *x;
    char name[160], accepted[96];

    *out = NULL;
    *count = 0;
    if (list == NULL)
        return MODAL_OK;
    if (!cJSON_IsArray(list))
        return wrong_type(list, base, key, "a list of numbers", err);
    x = malloc(((size_t)cJSON_GetArraySize(list) + 1) * sizeof *x);
    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "JSON: out of memory");
    cJSON_ArrayForEach(item, list) {
        if (!cJSON_IsNumber(item) || !(item->valuedouble >= low && item->valuedouble <= high)) {
            free(x);
            snprintf(name, sizeof name, "%.100s[%zu]", key, n);
            snprintf(accepted, sizeof accepted, "a number from %g to %g", low, high);
            return wrong_type(item, base, name, accepted, err);
        }
        x[n++] = item->valuedouble;
    }
    *out = x;
    *count = n;
    return MODAL_OK;
}

cJSON *json_complex(double re, double im)
{
    return json_numbers((double[]) { re, im }, 2);
}

cJSON *json_numbers(const double *x, size_t count)
{
    cJSON *list = cJSON_CreateArray();

    for (size_t i = 0; i < count; i++)
        cJSON_AddItemToArray(list, isfinite(x[i]) ? cJSON_CreateNumber(x[i]) : cJSON_CreateNull());
    return list;
}

void json_set_number(cJSON *object, const char *key, double value)
{
    if (isfinite(value))
        cJSON_AddNumberToObject(object, key, value);
    else
        cJSON_AddNullToObject(object, key);
}
