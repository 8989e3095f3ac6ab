/*
 * json.c - see json.h
 *
 * cJSON accepts duplicate keys, reads 1e999 as infinity and prints numbers to within an epsilon.  A first pass over
 * the text checks what it lets pass (structure, depth, keys, numbers, UTF-8); only then does cJSON build the tree.
 */
#include "modal/json.h"
#include <ctype.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/utf8.h"

/* A key as it stands between its quotes; duplicates are found by comparing unescaped text only where no escape occurs. */
struct key { const char *text; size_t length; };

/* Where the scan is: a member or element of what is UP.  Written out only for an error. */
struct place {
    const struct place *up;
    struct key key;               /* text NULL: the element `index` */
    size_t index;
};

struct scan {
    const char *start, *at, *end;
    int depth;
    const struct place *place;    /* NULL: the document */
    struct modal_error *err;
};

static void key_name(char name[64], const struct key *key)
{
    snprintf(name, 64, "%.*s", (int)(key->length < 63 ? key->length : 63), key->text);
}

static void place_path(char path[128], const struct place *place)
{
    char name[64];

    path[0] = '\0';
    if (place == NULL)
        return;
    place_path(path, place->up);
    if (place->key.text != NULL)
        key_name(name, &place->key);
    else
        snprintf(name, sizeof name, "[%zu]", place->index);
    json_path(path, path, name);
}

static enum modal_status scan_fail(const struct scan *s, const char *what)
{
    const char *line = s->start, *next;
    int number = 1;
    char path[128];

    for (; (next = memchr(line, '\n', (size_t)(s->at - line))) != NULL; line = next + 1)
        number++;
    place_path(path, s->place);
    return modal_fail_field(s->err, MODAL_BAD_INPUT, path, "JSON: %s at line %d, column %td", what, number, s->at - line + 1);
}

static void skip_space(struct scan *s)
{
    while (s->at < s->end && (*s->at == ' ' || *s->at == '\t' || *s->at == '\r' || *s->at == '\n'))
        s->at++;
}

static enum modal_status scan_value(struct scan *s);

/* Four hex digits, not all 0. */
static bool is_escape_of_a_character(const char *p, const char *end)
{
    if (end - p < 4 || memcmp(p, "0000", 4) == 0)
        return false;
    for (int i = 0; i < 4; i++)
        if (!isxdigit((unsigned char)p[i]))
            return false;
    return true;
}

static enum modal_status scan_string(struct scan *s)
{
    s->at++;
    while (s->at < s->end && *s->at != '"') {
        int n = (unsigned char)*s->at < 0x80 ? 1 : utf8_length(s->at, s->end);
        if (n == 0)
            return scan_fail(s, "not UTF-8");
        if ((unsigned char)*s->at < 0x20)
            return scan_fail(s, "a control character in a string");
        if (*s->at == '\\') {
            if (s->end - s->at < 2 || strchr("\"\\/bfnrtu", s->at[1]) == NULL)
                return scan_fail(s, "an unknown escape");
            if (s->at[1] == 'u' && !is_escape_of_a_character(s->at + 2, s->end))
                return scan_fail(s, "a bad \\u escape");
            n = 2;
        }
        s->at += n;
    }
    if (s->at >= s->end)
        return scan_fail(s, "an unterminated string");
    s->at++;
    return MODAL_OK;
}

static const char *digits(const char *p, const char *end)
{
    while (p < end && isdigit((unsigned char)*p))
        p++;
    return p;
}

static enum modal_status scan_number(struct scan *s)
{
    const char *p = s->at, *q;
    bool exponent = false;
    char text[512];

    if (p < s->end && *p == '-')
        p++;
    q = digits(p, s->end);
    if (q == p || (*p == '0' && q - p > 1))
        return scan_fail(s, "not a JSON value (NaN and Infinity are not accepted)");
    p = q;
    if (p < s->end && *p == '.') {
        q = digits(++p, s->end);
        if (q == p)
            return scan_fail(s, "a malformed number");
        p = q;
    }
    if (p < s->end && (*p == 'e' || *p == 'E')) {
        exponent = true;
        p++;
        if (p < s->end && (*p == '+' || *p == '-'))
            p++;
        q = digits(p, s->end);
        if (q == p)
            return scan_fail(s, "a malformed number");
        p = q;
    }
    if ((size_t)(p - s->at) >= sizeof text)
        return scan_fail(s, "a number of more than 511 characters");
    if (exponent || p - s->at > 300) {             /* else it is below 1e300 */
        memcpy(text, s->at, (size_t)(p - s->at));
        text[p - s->at] = '\0';
        if (!isfinite(strtod(text, NULL)))
            return scan_fail(s, "a number that overflows a double");
    }
    s->at = p;
    return MODAL_OK;
}

static int compare_keys(const void *a, const void *b)
{
    const struct key *x = a, *y = b;
    size_t n = x->length < y->length ? x->length : y->length;
    int order = memcmp(x->text, y->text, n);

    return order != 0 ? order : (x->length > y->length) - (x->length < y->length);
}

static enum modal_status check_duplicates(struct scan *s, struct key *keys, size_t count)
{
    char name[64], path[128];

    qsort(keys, count, sizeof *keys, compare_keys);
    for (size_t i = 1; i < count; i++)
        if (compare_keys(&keys[i - 1], &keys[i]) == 0) {
            key_name(name, &keys[i]);
            place_path(path, s->place);
            json_path(path, path, name);
            return modal_fail_field(s->err, MODAL_BAD_INPUT, path, "JSON: the key \"%s\" stands twice in one object", name);
        }
    return MODAL_OK;
}

/* The keys of one object; a few need no memory. */
struct keys { struct key few[16], *list; size_t count, room; };

static enum modal_status keep_key(struct scan *s, struct keys *keys, struct key key)
{
    if (keys->count == keys->room) {
        bool first = keys->list == keys->few;
        struct key *more = realloc(first ? NULL : keys->list, 2 * keys->room * sizeof *more);

        if (more == NULL)
            return modal_fail(s->err, MODAL_NO_MEMORY, "JSON: out of memory");
        if (first)
            memcpy(more, keys->few, sizeof keys->few);
        keys->list = more;
        keys->room *= 2;
    }
    keys->list[keys->count++] = key;
    return MODAL_OK;
}

/* "key": value */
static enum modal_status scan_member(struct scan *s, struct keys *keys)
{
    struct place here = { .up = s->place };
    const char *from = s->at + 1;
    enum modal_status rc;

    if (s->at >= s->end || *s->at != '"')
        return scan_fail(s, "a key was expected");
    if ((rc = scan_string(s)) != MODAL_OK)
        return rc;
    here.key = (struct key) { from, (size_t)(s->at - 1 - from) };
    if (memchr(from, '\\', here.key.length) != NULL)          /* so that duplicates cannot hide */
        return scan_fail(s, "an escape in a key");
    if ((rc = keep_key(s, keys, here.key)) != MODAL_OK)
        return rc;
    skip_space(s);
    if (s->at >= s->end || *s->at != ':')
        return scan_fail(s, "':' was expected");
    s->at++;
    s->place = &here;
    rc = scan_value(s);
    s->place = here.up;
    return rc;
}

static enum modal_status scan_members(struct scan *s, struct keys *keys)
{
    for (;;) {
        enum modal_status rc;

        skip_space(s);
        if ((rc = scan_member(s, keys)) != MODAL_OK)
            return rc;
        skip_space(s);
        if (s->at >= s->end || (*s->at != ',' && *s->at != '}'))
            return scan_fail(s, "',' or '}' was expected");
        if (*s->at++ == '}')
            return check_duplicates(s, keys->list, keys->count);
    }
}

static enum modal_status scan_object(struct scan *s)
{
    struct keys keys = { .list = keys.few, .room = sizeof keys.few / sizeof *keys.few };
    enum modal_status rc = MODAL_OK;

    s->at++;
    skip_space(s);
    if (s->at < s->end && *s->at == '}')
        s->at++;
    else
        rc = scan_members(s, &keys);
    if (keys.list != keys.few)
        free(keys.list);
    return rc;
}

static enum modal_status scan_array(struct scan *s)
{
    struct place here = { .up = s->place };

    s->at++;
    skip_space(s);
    if (s->at < s->end && *s->at == ']') {
        s->at++;
        return MODAL_OK;
    }
    for (;; here.index++) {
        s->place = &here;
        enum modal_status rc = scan_value(s);
        if (rc != MODAL_OK)
            return rc;
        s->place = here.up;
        skip_space(s);
        if (s->at < s->end && *s->at == ',') {
            s->at++;
            continue;
        }
        if (s->at < s->end && *s->at == ']') {
            s->at++;
            return MODAL_OK;
        }
        return scan_fail(s, "',' or ']' was expected");
    }
}

static enum modal_status scan_value(struct scan *s)
{
    static const char *const words[] = { "true", "false", "null" };
    enum modal_status rc;

    skip_space(s);
    if (s->at >= s->end)
        return scan_fail(s, "a value was expected");
    if (*s->at == '"')
        return scan_string(s);
    if (*s->at == '{' || *s->at == '[') {
        if (s->depth >= JSON_DEPTH_MOST)
            return modal_fail_field(s->err, MODAL_BAD_INPUT, "", "JSON: nested deeper than %d at byte %td", JSON_DEPTH_MOST, s->at - s->start);
        s->depth++;
        rc = *s->at == '{' ? scan_object(s) : scan_array(s);
        s->depth--;
        return rc;
    }
    for (int i = 0; i < 3; i++)
        if ((size_t)(s->end - s->at) >= strlen(words[i]) && memcmp(s->at, words[i], strlen(words[i])) == 0) {
            s->at += strlen(words[i]);
            return MODAL_OK;
        }
    return scan_number(s);
}

enum modal_status json_read(const char *text, size_t length, cJSON **out, struct modal_error *err)
{
    struct scan s = { .start = text, .at = text, .end = text + length, .err = err };
    enum modal_status rc = scan_value(&s);

    if (rc != MODAL_OK)
        return rc;
    skip_space(&s);
    if (s.at != s.end)
        return scan_fail(&s, "text after the value");
    cJSON *value = cJSON_ParseWithLength(text, length);
    if (value == NULL)
        return modal_fail(err, MODAL_BAD_INPUT, "JSON: not readable");
    *out = value;
    return MODAL_OK;
}

struct text { char *x; size_t length, room; bool failed; };

static void put(struct text *t, const char *bytes, size_t n)
{
    if (t->failed)
        return;
    if (t->length + n + 1 > t->room) {
        size_t room = 2 * t->room + n + 64;
        char *more = realloc(t->x, room);
        if (more == NULL) {
            t->failed = true;
            return;
        }
        t->x = more;
        t->room = room;
    }
    memcpy(t->x + t->length, bytes, n);
    t->length += n;
    t->x[t->length] = '\0';
}

/* A byte that is no UTF-8 (a file's name in another encoding) stands as U+FFFD: what is printed can be read. */
static void put_string(struct text *t, const char *s)
{
    const char *end = s + strlen(s), *from = s;    /* from: what is not put yet */
    int n;

    put(t, "\"", 1);
    for (; s < end; s += n > 0 ? n : 1) {
        char escape[8];
        bool plain = *s != '"' && *s != '\\' && (unsigned char)*s >= 0x20;
        n = (unsigned char)*s < 0x80 ? 1 : utf8_length(s, end);
        if (plain && n > 0)
            continue;
        put(t, from, (size_t)(s - from));
        from = s + 1;
        if (n == 0)
            put(t, "\xef\xbf\xbd", 3);
        else if ((unsigned char)*s < 0x20)
            put(t, escape, (size_t)snprintf(escape, sizeof escape, "\\u%04x", (unsigned char)*s));
        else
            put(t, (char[]) { '\\', *s }, 2);
    }
    put(t, from, strlen(from));
    put(t, "\"", 1);
}

/* The digits of a whole number below 1e15, as %g would write them. */
static void put_whole(struct text *t, int64_t x)
{
    char s[20], *p = s + sizeof s;
    uint64_t left = x < 0 ? (uint64_t)-x : (uint64_t)x;

    do
        *--p = (char)('0' + left % 10);
    while ((left /= 10) != 0);
    if (x < 0)
        *--p = '-';
    put(t, p, (size_t)(s + sizeof s - p));
}

static void put_number(struct text *t, double x)
{
    char s[40];
    int n = 0;

    if (!isfinite(x)) {
        put(t, "null", 4);
        return;
    }
    if (fabs(x) < 1e15 && x == floor(x) && !(x == 0 && signbit(x))) {
        put_whole(t, (int64_t)x);
        return;
    }
    for (int precision = 15; precision <= 17; precision++) {
        n = snprintf(s, sizeof s, "%.*g", precision, x);
        if (strtod(s, NULL) == x)
            break;
    }
    put(t, s, (size_t)n);
}

static void put_value(struct text *t, const cJSON *v)
{
    if (cJSON_IsObject(v) || cJSON_IsArray(v)) {
        put(t, cJSON_IsObject(v) ? "{" : "[", 1);
        for (const cJSON *child = v->child; child != NULL; child = child->next) {
            if (child != v->child)
                put(t, ",", 1);
            if (cJSON_IsObject(v)) {
                put_string(t, child->string);
                put(t, ":", 1);
            }
            put_value(t, child);
        }
        put(t, cJSON_IsObject(v) ? "}" : "]", 1);
    } else if (cJSON_IsString(v)) {
        put_string(t, v->valuestring);
    } else if (cJSON_IsNumber(v)) {
        put_number(t, v->valuedouble);
    } else if (cJSON_IsRaw(v)) {
        put(t, v->valuestring, strlen(v->valuestring));
    } else {
        const char *word = cJSON_IsTrue(v) ? "true" : cJSON_IsFalse(v) ? "false" : "null";
        put(t, word, strlen(word));
    }
}

char *json_print(const cJSON *value)
{
    struct text t = { 0 };

    put_value(&t, value);
    if (t.failed) {
        free(t.x);
        return NULL;
    }
    return t.x;
}

void json_path(char out[128], const char *base, const char *key)
{
    char path[256];
    const char *name = key[0] != '\0' ? key : "\"\"";      /* an empty key has a name too, or the error would name the document */

    snprintf(path, sizeof path, "%s%s%s", base, base[0] != '\0' && key[0] != '[' ? "." : "", name);
    snprintf(out, 128, "%.127s", path);
}

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
        if (strcmp(s, words[i]) == 0) {
            *index = i;
            return true;
        }
    return false;
}

enum modal_status json_keys(const cJSON *object, const char *base, const char *const *names, struct modal_error *err)
{
    char path[128], list[400];
    int index;

    if (!cJSON_IsObject(object))
        return modal_fail_field(err, MODAL_BAD_INPUT, base, "%s must be an object", base[0] ? base : "the document");
    for (const cJSON *child = object->child; child != NULL; child = child->next)
        if (!is_word(child->string, names, &index)) {
            json_path(path, base, child->string);
            list_words(list, sizeof list, names);
            return modal_fail_field(err, MODAL_BAD_INPUT, path, "unknown key \"%.60s\"; accepted: %s", child->string, list);
        }
    return MODAL_OK;
}

static enum modal_status wrong_type(const cJSON *item, const char *base, const char *key, const char *accepted,
                                    struct modal_error *err)
{
    char path[128], *text = json_print(item);
    enum modal_status rc;

    json_path(path, base, key);
    rc = modal_fail_field(err, MODAL_BAD_INPUT, path, "%s is %.80s; accepted: %s", path, text ? text : "?", accepted);
    free(text);
    return rc;
}

enum modal_status json_get_number(const cJSON *object, const char *base, const char *key, double low, double high,
                                  double *out, struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);
    char accepted[96];

    if (item == NULL)
        return MODAL_OK;
    if (!cJSON_IsNumber(item) || !(item->valuedouble >= low && item->valuedouble <= high)) {
        if (isinf(low) && isinf(high))
            snprintf(accepted, sizeof accepted, "a number");
        else if (low > 0 && low < 1e-290 && high > 1e290)
            snprintf(accepted, sizeof accepted, "a positive number");
        else if (isinf(high) || high > 1e290)
            snprintf(accepted, sizeof accepted, low < -1e290 ? "a finite number" : "a number of at least %g", low);
        else
            snprintf(accepted, sizeof accepted, "a number from %g to %g", low, high);
        return wrong_type(item, base, key, accepted, err);
    }
    *out = item->valuedouble;
    return MODAL_OK;
}

enum modal_status json_get_int(const cJSON *object, const char *base, const char *key, int low, int high, int *out,
                               struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);
    char accepted[96];

    if (item == NULL)
        return MODAL_OK;
    if (!cJSON_IsNumber(item) || item->valuedouble != floor(item->valuedouble) || !(item->valuedouble >= low && item->valuedouble <= high)) {
        snprintf(accepted, sizeof accepted, "a whole number from %d to %d", low, high);
        return wrong_type(item, base, key, accepted, err);
    }
    *out = (int)item->valuedouble;
    return MODAL_OK;
}

enum modal_status json_get_bool(const cJSON *object, const char *base, const char *key, bool *out,
                                struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);

    if (item == NULL)
        return MODAL_OK;
    if (!cJSON_IsBool(item))
        return wrong_type(item, base, key, "true, false", err);
    *out = cJSON_IsTrue(item);
    return MODAL_OK;
}

enum modal_status json_get_string(const cJSON *object, const char *base, const char *key, const char **out,
                                  struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);

    if (item == NULL)
        return MODAL_OK;
    if (!cJSON_IsString(item))
        return wrong_type(item, base, key, "a string", err);
    *out = item->valuestring;
    return MODAL_OK;
}

static enum modal_status need(const cJSON *object, const char *base, const char *key, const char *accepted, struct modal_error *err)
{
    char path[128];

    if (cJSON_GetObjectItemCaseSensitive(object, key) != NULL)
        return MODAL_OK;
    json_path(path, base, key);
    return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s is missing; accepted: %s", path, accepted);
}

enum modal_status json_need_number(const cJSON *object, const char *base, const char *key, double low, double high,
                                   double *out, struct modal_error *err)
{
    enum modal_status rc = need(object, base, key, "a number", err);

    return rc == MODAL_OK ? json_get_number(object, base, key, low, high, out, err) : rc;
}

enum modal_status json_need_string(const cJSON *object, const char *base, const char *key, const char **out,
                                   struct modal_error *err)
{
    enum modal_status rc = need(object, base, key, "a string", err);

    return rc == MODAL_OK ? json_get_string(object, base, key, out, err) : rc;
}

enum modal_status json_get_choice(const cJSON *object, const char *base, const char *key, const char *const *words,
                                  int *out, struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);
    char list[400];

    if (item == NULL || (cJSON_IsString(item) && is_word(item->valuestring, words, out)))
        return MODAL_OK;
    list_words(list, sizeof list, words);
    return wrong_type(item, base, key, list, err);
}

enum modal_status json_get_numbers(const cJSON *object, const char *base, const char *key, double low, double high,
                                   double **out, size_t *count, struct modal_error *err)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(object, key), *item;
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
