/*
 * json_text.c - JSON written, exactly: a tree of cJSON's, or member by member without one; see
 * json.h
 *
 * cJSON prints numbers to within an epsilon; here a double is written with the fewest of 15, 16 or
 * 17 digits that read back bit for bit.
 */
#include "base/json.h"
#include <locale.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/utf8.h"

enum { FIRST_ROOM = 448 };        /* most documents that are written often are smaller */

/* Digits that a double always keeps, and that always tell it from its neighbours (DBL_DIG,
 * DBL_DECIMAL_DIG). */
enum {
    DIGITS_LEAST = 15,    /* DBL_DIG: a decimal of so many comes back from its double */
    DIGITS_MOST = 17,     /* DBL_DECIMAL_DIG: a double comes back from so many */
};

/* %.15g writes a whole number below this with all its digits and without an exponent. */
static const double WHOLE_MOST = 1e15;
/* Numbers whose thousandths are whole numbers below WHOLE_MOST, and the least of these. */
static const double THOUSANDTHS_MOST = 1e12;
static const double THOUSANDTH = 1e-3;

/* Where N bytes more and a zero byte may be written; NULL: no memory. */
static char *room_for(struct json_text *t, size_t n)
{
    if (t->failed)
        return NULL;
    if (t->length + n + 1 > t->room) {
        size_t room = 2 * t->room + n + FIRST_ROOM;
        char *more = realloc(t->x, room);
        if (more == NULL) {
            t->failed = true;
            return NULL;
        }
        t->x = more;
        t->room = room;
    }
    return t->x + t->length;
}

/* What was written up to END belongs to the text. */
static void written(struct json_text *t, char *end)
{
    *end = '\0';
    t->length = (size_t)(end - t->x);
}

void json_text_bytes(struct json_text *t, const char *bytes, size_t n)
{
    char *p = room_for(t, n);

    if (p == NULL)
        return;
    memcpy(p, bytes, n);
    written(t, p + n);
}

/* Bytes at the beginning of S that stand for themselves in a string, ASCII only. */
static size_t plain_length(const char *s)
{
    size_t n = 0;

    while ((unsigned char)s[n] >= 0x20 && (unsigned char)s[n] < 0x7f && s[n] != '"' && s[n] != '\\')
        n++;
    return n;
}

static void put_quoted(struct json_text *t, const char *s, size_t n)
{
    char *p = room_for(t, n + 2);

    if (p == NULL)
        return;
    *p = '"';
    memcpy(p + 1, s, n);
    p[n + 1] = '"';
    written(t, p + n + 2);
}

/* A byte that is no UTF-8 (a file's name in another encoding) stands as U+FFFD: what is printed can
 * be read.  Control characters are escaped, all of them, though JSON wants it of those below U+0020
 * alone: a terminal may be where it is read. */
void json_text_quoted(struct json_text *t, const char *s)
{
    const char *end, *from = s;                    /* from: what is not put yet */
    size_t simple = plain_length(s);
    int n, control;

    if (s[simple] == '\0') {
        put_quoted(t, s, simple);
        return;
    }
    end = s + simple + strlen(s + simple);
    json_text_bytes(t, "\"", 1);
    for (; s < end; s += n > 0 ? n : 1) {
        char escape[8];
        n = (unsigned char)*s < 0x80 ? 1 : utf8_length(s, end);
        control = n > 0 ? utf8_control_length(s) : 0;
        if (n > 0 && control == 0 && *s != '"' && *s != '\\')
            continue;
        json_text_bytes(t, from, (size_t)(s - from));
        from = s + (n > 0 ? n : 1);
        if (n == 0)
            json_text_bytes(t, "\xef\xbf\xbd", 3);
        else if (control > 0) {
            utf8_control_escape(s, control, escape);
            json_text_bytes(t, escape, strlen(escape));
        } else
            json_text_bytes(t, (char[]) { '\\', *s }, 2);
    }
    json_text_bytes(t, from, strlen(from));
    json_text_bytes(t, "\"", 1);
}

/* A key stands as it is where JSON lets it: no escape is read in one, so that duplicates cannot
 * hide. */
static void put_name(struct json_text *t, const char *key)
{
    size_t n = 0;

    while ((unsigned char)key[n] >= 0x20 && key[n] != '"' && key[n] != '\\')
        n++;
    if (key[n] == '\0' && utf8_valid(key))
        put_quoted(t, key, n);
    else
        json_text_quoted(t, key);
}

/* The digits of a whole number below 1e15, as %g would write them. */
static void put_whole(struct json_text *t, int64_t x)
{
    char s[20], *p = s + sizeof s;
    uint64_t left = x < 0 ? (uint64_t)-x : (uint64_t)x;

    do
        *--p = (char)('0' + left % 10);
    while ((left /= 10) != 0);
    if (x < 0)
        *--p = '-';
    json_text_bytes(t, p, (size_t)(s + sizeof s - p));
}

/* THOUSANDTHS / 1000 in full, as %.15g writes it: instants are in whole milliseconds. */
static void put_thousandths(struct json_text *t, int64_t thousandths)
{
    int part = (int)(thousandths < 0 ? -(thousandths % 1000) : thousandths % 1000);
    size_t n = part % 10 != 0 ? 3 : part % 100 != 0 ? 2 : 1;
    const char digits[] = { '.', (char)('0' + part / 100), (char)('0' + part / 10 % 10),
                            (char)('0' + part % 10) };

    if (thousandths < 0 && thousandths / 1000 == 0)
        json_text_bytes(t, "-", 1);
    put_whole(t, thousandths / 1000);
    json_text_bytes(t, digits, n + 1);
}

static void put_number(struct json_text *t, double x)
{
    char s[40], *point;
    int n = 0;

    if (!isfinite(x)) {
        json_text_bytes(t, "null", 4);
        return;
    }
    if (fabs(x) < WHOLE_MOST && x == floor(x) && !(x == 0 && signbit(x))) {
        put_whole(t, (int64_t)x);
        return;
    }
    /* a quotient of whole numbers below WHOLE_MOST is the double next to the decimal, and has no
     * other decimal of 15 digits; below a thousandth there is none */
    if (fabs(x) < THOUSANDTHS_MOST && fabs(x) >= THOUSANDTH && rint(1000 * x) / 1000 == x) {
        put_thousandths(t, (int64_t)rint(1000 * x));
        return;
    }
    for (int precision = DIGITS_LEAST; precision <= DIGITS_MOST; precision++) {
        n = snprintf(s, sizeof s, "%.*g", precision, x);
        if (strtod(s, NULL) == x)
            break;
    }
    point = memchr(s, localeconv()->decimal_point[0], (size_t)n);
    if (point != NULL)
        *point = '.';
    json_text_bytes(t, s, (size_t)n);
}

static void put_value(struct json_text *t, const cJSON *v)
{
    if (cJSON_IsObject(v) || cJSON_IsArray(v)) {
        json_text_bytes(t, cJSON_IsObject(v) ? "{" : "[", 1);
        for (const cJSON *child = v->child; child != NULL; child = child->next) {
            if (child != v->child)
                json_text_bytes(t, ",", 1);
            if (cJSON_IsObject(v)) {
                put_name(t, child->string);
                json_text_bytes(t, ":", 1);
            }
            put_value(t, child);
        }
        json_text_bytes(t, cJSON_IsObject(v) ? "}" : "]", 1);
    } else if (cJSON_IsString(v)) {
        json_text_quoted(t, v->valuestring);
    } else if (cJSON_IsNumber(v)) {
        put_number(t, v->valuedouble);
    } else if (cJSON_IsRaw(v)) {
        json_text_bytes(t, v->valuestring, strlen(v->valuestring));
    } else if (v != NULL && cJSON_IsInvalid(v)) {
        t->failed = true;                           /* json_put had no memory */
    } else {
        const char *word = cJSON_IsTrue(v) ? "true" : cJSON_IsFalse(v) ? "false" : "null";
        json_text_bytes(t, word, strlen(word));
    }
}

char *json_print(const cJSON *value)
{
    struct json_text t = { 0 };
    char *fitting;

    put_value(&t, value);
    if (t.failed) {
        free(t.x);
        return NULL;
    }
    fitting = realloc(t.x, t.length + 1);          /* it may be kept long */
    return fitting != NULL ? fitting : t.x;
}

void json_text_raw(struct json_text *t, const char *text)
{
    json_text_bytes(t, text, strlen(text));
}

void json_text_open(struct json_text *t, const char *key)
{
    if (key != NULL)
        json_text_key(t, key);
    else if (t->length > 0 && strchr("[{", t->x[t->length - 1]) == NULL)
        json_text_bytes(t, ",", 1);
    json_text_bytes(t, "{", 1);
}

void json_text_close(struct json_text *t)
{
    json_text_bytes(t, "}", 1);
}

void json_text_key(struct json_text *t, const char *key)
{
    size_t n = strlen(key);
    char *p = room_for(t, n + 4);

    if (p == NULL)
        return;
    if (t->length > 0 && p[-1] != '{')
        *p++ = ',';
    *p++ = '"';
    memcpy(p, key, n);
    memcpy(p + n, "\":", 2);
    written(t, p + n + 2);
}

void json_text_string(struct json_text *t, const char *key, const char *value)
{
    json_text_key(t, key);
    if (value != NULL)
        json_text_quoted(t, value);
    else
        json_text_bytes(t, "null", 4);
}

void json_text_number(struct json_text *t, const char *key, double value)
{
    json_text_key(t, key);
    put_number(t, value);
}

void json_text_bool(struct json_text *t, const char *key, bool value)
{
    json_text_key(t, key);
    json_text_bytes(t, value ? "true" : "false", value ? 4 : 5);
}
