/*
 * json_read.c - JSON read strictly; see json.h
 *
 * cJSON accepts duplicate keys and reads 1e999 as infinity.  So its trees are built here, in one
 * pass that checks structure, depth, keys, numbers and UTF-8 on the way.
 */
#include "base/json.h"
#include <ctype.h>
#include <limits.h>
#include <locale.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/utf8.h"

/* A key as it stands between its quotes: without escapes. */
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
    struct json_pool **pool;      /* where the tree lies; NULL: each item by itself */
};

/* Memory given out from the front, and freed as a whole. */
struct json_pool { struct json_pool *next; size_t used, room; max_align_t bytes[]; };

enum {
    NAME_ROOM = 64,      /* of a key in a message, cut there, with its end */
    HEX_DIGITS = 4,      /* of an escaped character */
    PAIR_SECOND = 6,     /* bytes of the second of a surrogate pair, "\\udc00" */
};

static void key_name(char name[NAME_ROOM], const struct key *key)
{
    size_t most = NAME_ROOM - 1;

    snprintf(name, NAME_ROOM, "%.*s", (int)(key->length < most ? key->length : most), key->text);
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
    return modal_fail_field(s->err, MODAL_BAD_INPUT, path, "JSON: %s at line %d, column %td", what,
                            number, s->at - line + 1);
}

static void skip_space(struct scan *s)
{
    while (s->at < s->end && (*s->at == ' ' || *s->at == '\t' || *s->at == '\r' || *s->at == '\n'))
        s->at++;
}

static enum modal_status no_memory(const struct scan *s)
{
    return modal_fail(s->err, MODAL_NO_MEMORY, "JSON: out of memory");
}

/* As malloc.  A header of the wire has an item for some 12 bytes, so that a block of eight times
 * its length mostly holds its tree. */
static void *allocate(const struct scan *s, size_t size)
{
    struct json_pool *pool;
    void *out;

    if (s->pool == NULL)
        return cJSON_malloc(size);
    size = (size + 15) / 16 * 16;
    pool = *s->pool;
    if (pool == NULL || pool->room - pool->used < size) {
        size_t room = 8 * (size_t)(s->end - s->start) + size + 512;
        pool = malloc(sizeof *pool + room);
        if (pool == NULL)
            return NULL;
        *pool = (struct json_pool) { .next = *s->pool, .room = room };
        *s->pool = pool;
    }
    out = (char *)pool->bytes + pool->used;
    pool->used += size;
    return out;
}

void json_pool_free(struct json_pool *pool)
{
    while (pool != NULL) {
        struct json_pool *next = pool->next;
        free(pool);
        pool = next;
    }
}

/* A bare item of a cJSON type; NULL: no memory. */
static cJSON *item_of(const struct scan *s, int type)
{
    cJSON *item = allocate(s, sizeof *item);

    if (item != NULL) {
        memset(item, 0, sizeof *item);
        item->type = type;
    }
    return item;
}

static char *text_of(const struct scan *s, const char *bytes, size_t length)
{
    char *text = allocate(s, length + 1);

    if (text != NULL) {
        memcpy(text, bytes, length);
        text[length] = '\0';
    }
    return text;
}

/* At the end of PARENT's children, as cJSON links them: the first one's prev is the last. */
static void append(cJSON *parent, cJSON *item)
{
    cJSON *last = parent->child == NULL ? item : parent->child->prev;

    if (parent->child == NULL)
        parent->child = item;
    else {
        last->next = item;
        item->prev = last;
    }
    parent->child->prev = item;
}

static enum modal_status scan_value(struct scan *s, cJSON **out);

/* Four hex digits, not all 0. */
static bool is_escape_of_a_character(const char *p, const char *end)
{
    if (end - p < HEX_DIGITS || memcmp(p, "0000", 4) == 0)
        return false;
    for (int i = 0; i < HEX_DIGITS; i++)
        if (!isxdigit((unsigned char)p[i]))
            return false;
    return true;
}

#define EACH_BYTE (~UINT64_C(0) / 255)

/* Behind the characters from P on that stand in a string for themselves: ASCII without quotes,
 * backslashes and control characters.  Eight at once, of which one is another where a bit 7 is set:
 * of itself, or by the borrow from 1 below it or from 32, for those that are equal or less. */
static const char *plain_end(const char *p, const char *end)
{
    for (; end - p >= 8; p += 8) {
        uint64_t x, quote, escape;
        memcpy(&x, p, 8);
        quote = x ^ EACH_BYTE * '"', escape = x ^ EACH_BYTE * '\\';
        if (((x | (x - EACH_BYTE * 0x20) | (quote - EACH_BYTE) | (escape - EACH_BYTE))
             & EACH_BYTE * 0x80) != 0)
            break;
    }
    while (p < end && (signed char)*p >= 0x20 && *p != '"' && *p != '\\')
        p++;
    return p;
}

/* The string at s->at, between its quotes; *ESCAPES: whether there are any. */
static enum modal_status scan_string(struct scan *s, struct key *inside, bool *escapes)
{
    *escapes = false;
    inside->text = ++s->at;
    while ((s->at = plain_end(s->at, s->end)) < s->end && *s->at != '"') {
        int n = (unsigned char)*s->at < 0x80 ? 1 : utf8_length(s->at, s->end);
        if (n == 0)
            return scan_fail(s, "not UTF-8");
        if ((unsigned char)*s->at < 0x20)
            return scan_fail(s, "a control character in a string");
        if (*s->at == '\\') {
            if (s->end - s->at < 2 || s->at[1] == '\0' || strchr("\"\\/bfnrtu", s->at[1]) == NULL)
                return scan_fail(s, "an unknown escape");
            if (s->at[1] == 'u' && !is_escape_of_a_character(s->at + 2, s->end))
                return scan_fail(s, "a bad \\u escape");
            n = 2;
            *escapes = true;
        }
        s->at += n;
    }
    if (s->at >= s->end)
        return scan_fail(s, "an unterminated string");
    inside->length = (size_t)(s->at++ - inside->text);
    return MODAL_OK;
}

static uint32_t hex4(const char *p)
{
    uint32_t x = 0;

    for (int i = 0; i < 4; i++)
        x = x << 4
            | (uint32_t)(isdigit((unsigned char)p[i]) ? p[i] - '0' : (p[i] | 0x20) - 'a' + 10);
    return x;
}

/* The character of the escape \u at P, after the u; bytes read beyond its four digits into *MORE;
 * 0: half a surrogate pair. */
static uint32_t escaped_character(const char *p, const char *end, int *more)
{
    uint32_t first = hex4(p), second;

    *more = 0;
    if (first < 0xd800 || first > 0xdfff)
        return first;
    if (first > 0xdbff || end - p < HEX_DIGITS + PAIR_SECOND || p[4] != '\\' || p[5] != 'u')
        return 0;
    second = hex4(p + 6);
    if (second < 0xdc00 || second > 0xdfff)
        return 0;
    *more = 6;
    return 0x10000 + ((first & 0x3ff) << 10 | (second & 0x3ff));
}

static char *put_utf8(char *to, uint32_t c)
{
    static const unsigned char lead[] = { 0, 0, 0xc0, 0xe0, 0xf0 };
    int n = c < 0x80 ? 1 : c < 0x800 ? 2 : c < 0x10000 ? 3 : 4;

    for (int i = n - 1; i > 0; i--, c >>= 6)
        to[i] = (char)(0x80 | (c & 0x3f));
    to[0] = (char)(lead[n] | c);
    return to + n;
}

/* INSIDE, checked by scan_string, without its escapes: never longer than with them. */
static enum modal_status unescape(const struct scan *s, struct key inside, char *to)
{
    static const char plain[] = "\"\\/bfnrt", meant[] = "\"\\/\b\f\n\r\t";
    const char *p = inside.text, *end = p + inside.length;
    uint32_t c;
    int more;

    while (p < end) {
        if (*p != '\\') {
            *to++ = *p++;
            continue;
        }
        if (p[1] != 'u') {
            *to++ = meant[strchr(plain, p[1]) - plain];
            p += 2;
            continue;
        }
        if ((c = escaped_character(p + 2, end, &more)) == 0)
            return scan_fail(s, "half a surrogate pair in a string");
        to = put_utf8(to, c);
        p += 6 + more;
    }
    *to = '\0';
    return MODAL_OK;
}

static enum modal_status read_string(struct scan *s, cJSON **out)
{
    struct key inside;
    bool escapes;
    enum modal_status rc = scan_string(s, &inside, &escapes);

    if (rc != MODAL_OK)
        return rc;
    *out = item_of(s, cJSON_String);
    if (*out == NULL || ((*out)->valuestring = text_of(s, inside.text, inside.length)) == NULL)
        return no_memory(s);
    return escapes ? unescape(s, inside, (*out)->valuestring) : MODAL_OK;
}

static const char *digits(const char *p, const char *end)
{
    while (p < end && isdigit((unsigned char)*p))
        p++;
    return p;
}

/* The number at s->at as JSON has it: to *END; *WHOLE: without fraction and exponent. */
static enum modal_status scan_number(struct scan *s, const char **end, bool *whole)
{
    const char *p = s->at, *q;

    *whole = true;
    if (p < s->end && *p == '-')
        p++;
    q = digits(p, s->end);
    if (q == p || (*p == '0' && q - p > 1))
        return scan_fail(s, "not a JSON value (NaN and Infinity are not accepted)");
    p = q;
    if (p < s->end && *p == '.') {
        *whole = false;
        q = digits(++p, s->end);
        if (q == p)
            return scan_fail(s, "a malformed number");
        p = q;
    }
    if (p < s->end && (*p == 'e' || *p == 'E')) {
        *whole = false;
        p++;
        if (p < s->end && (*p == '+' || *p == '-'))
            p++;
        q = digits(p, s->end);
        if (q == p)
            return scan_fail(s, "a malformed number");
        p = q;
    }
    *end = p;
    return MODAL_OK;
}

/* A whole number below 10^15 is below 2^53, so a double has it exactly. */
enum { EXACT_DIGITS = 15 };

/* Digits, at most EXACT_DIGITS with the sign: exact. */
static double whole_number(const char *p, const char *end)
{
    bool negative = *p == '-';
    int64_t x = 0;

    for (p += negative; p < end; p++)
        x = 10 * x + (*p - '0');
    return negative ? -(double)x : (double)x;
}

/* By strtod, which wants the point of the locale. */
static double other_number(const char *p, size_t length, char text[JSON_NUMBER_MOST + 1])
{
    char *point;

    memcpy(text, p, length);
    text[length] = '\0';
    point = strchr(text, '.');
    if (point != NULL)
        *point = localeconv()->decimal_point[0];
    return strtod(text, NULL);
}

static enum modal_status read_number(struct scan *s, cJSON **out)
{
    const char *end = s->at;
    char text[JSON_NUMBER_MOST + 1];
    bool whole;
    double x;
    enum modal_status rc = scan_number(s, &end, &whole);

    if (rc != MODAL_OK)
        return rc;
    if ((size_t)(end - s->at) >= sizeof text)
        return scan_fail(s, "a number of more than 511 characters");
    x = whole && end - s->at <= EXACT_DIGITS ? whole_number(s->at, end)
                                   : other_number(s->at, (size_t)(end - s->at), text);
    if (!isfinite(x))
        return scan_fail(s, "a number that overflows a double");
    *out = item_of(s, cJSON_Number);
    if (*out == NULL)
        return no_memory(s);
    (*out)->valuedouble = x;
    (*out)->valueint = x >= INT_MAX ? INT_MAX : x <= INT_MIN ? INT_MIN : (int)x;
    s->at = end;
    return MODAL_OK;
}

static int compare_keys(const void *a, const void *b)
{
    const struct key *x = a, *y = b;
    size_t n = x->length < y->length ? x->length : y->length;
    int order = memcmp(x->text, y->text, n);

    return order != 0 ? order : (x->length > y->length) - (x->length < y->length);
}

enum { FEW_KEYS = 16 };       /* nearly every object has no more; 120 comparisons at most */

/* Whether two of a few keys are one; without sorting them, as nearly every object has few. */
static bool any_twice(const struct key *keys, size_t count)
{
    for (size_t i = 1; i < count; i++)
        for (size_t j = 0; j < i; j++)
            if (keys[i].length == keys[j].length
                && memcmp(keys[i].text, keys[j].text, keys[i].length) == 0)
                return true;
    return false;
}

static enum modal_status check_duplicates(struct scan *s, struct key *keys, size_t count)
{
    char name[64], path[128];

    if (count <= FEW_KEYS && !any_twice(keys, count))
        return MODAL_OK;
    qsort(keys, count, sizeof *keys, compare_keys);
    for (size_t i = 1; i < count; i++)
        if (compare_keys(&keys[i - 1], &keys[i]) == 0) {
            key_name(name, &keys[i]);
            place_path(path, s->place);
            json_path(path, path, name);
            return modal_fail_field(s->err, MODAL_BAD_INPUT, path,
                                    "JSON: the key \"%s\" stands twice in one object", name);
        }
    return MODAL_OK;
}

/* The keys of one object; a few need no memory. */
struct keys { struct key few[FEW_KEYS], *list; size_t count, room; };

static enum modal_status add_key(struct scan *s, struct keys *keys, struct key key)
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

/* "key": value, behind OBJECT's members */
static enum modal_status scan_member(struct scan *s, struct keys *keys, cJSON *object)
{
    struct place here = { .up = s->place };
    cJSON *value = NULL;
    bool escapes;
    enum modal_status rc;

    if (s->at >= s->end || *s->at != '"')
        return scan_fail(s, "a key was expected");
    if ((rc = scan_string(s, &here.key, &escapes)) != MODAL_OK)
        return rc;
    if (escapes)                                   /* so that duplicates cannot hide */
        return scan_fail(s, "an escape in a key");
    if ((rc = add_key(s, keys, here.key)) != MODAL_OK)
        return rc;
    skip_space(s);
    if (s->at >= s->end || *s->at != ':')
        return scan_fail(s, "':' was expected");
    s->at++;
    s->place = &here;
    rc = scan_value(s, &value);
    s->place = here.up;
    if (value == NULL)
        return rc;
    append(object, value);
    value->string = text_of(s, here.key.text, here.key.length);
    return rc == MODAL_OK && value->string == NULL ? no_memory(s) : rc;
}

static enum modal_status scan_members(struct scan *s, struct keys *keys, cJSON *object)
{
    for (;;) {
        enum modal_status rc;

        skip_space(s);
        if ((rc = scan_member(s, keys, object)) != MODAL_OK)
            return rc;
        skip_space(s);
        if (s->at >= s->end || (*s->at != ',' && *s->at != '}'))
            return scan_fail(s, "',' or '}' was expected");
        if (*s->at++ == '}')
            return check_duplicates(s, keys->list, keys->count);
    }
}

static enum modal_status scan_object(struct scan *s, cJSON *object)
{
    struct keys keys = { .list = keys.few, .room = FEW_KEYS };
    enum modal_status rc = MODAL_OK;

    skip_space(s);
    if (s->at < s->end && *s->at == '}')
        s->at++;
    else
        rc = scan_members(s, &keys, object);
    if (keys.list != keys.few)
        free(keys.list);
    return rc;
}

static enum modal_status scan_array(struct scan *s, cJSON *array)
{
    struct place here = { .up = s->place };
    cJSON *value;

    skip_space(s);
    if (s->at < s->end && *s->at == ']') {
        s->at++;
        return MODAL_OK;
    }
    for (;; here.index++) {
        s->place = &here;
        value = NULL;
        enum modal_status rc = scan_value(s, &value);
        if (value != NULL)
            append(array, value);
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

static enum modal_status scan_container(struct scan *s, cJSON **out)
{
    bool object = *s->at == '{';
    enum modal_status rc;

    if (s->depth >= JSON_DEPTH_MOST)
        return modal_fail_field(s->err, MODAL_BAD_INPUT, "",
                                "JSON: nested deeper than %d at byte %td", JSON_DEPTH_MOST,
                                s->at - s->start);
    *out = item_of(s, object ? cJSON_Object : cJSON_Array);
    if (*out == NULL)
        return no_memory(s);
    s->depth++;
    s->at++;
    rc = object ? scan_object(s, *out) : scan_array(s, *out);
    s->depth--;
    return rc;
}

/* *OUT may be half made when it fails: its owner's to delete. */
static enum modal_status scan_value(struct scan *s, cJSON **out)
{
    static const struct { const char *word; size_t length; int type; } words[] = {
        { "true", 4, cJSON_True }, { "false", 5, cJSON_False }, { "null", 4, cJSON_NULL },
    };

    skip_space(s);
    if (s->at >= s->end)
        return scan_fail(s, "a value was expected");
    if (*s->at == '"')
        return read_string(s, out);
    if (*s->at == '{' || *s->at == '[')
        return scan_container(s, out);
    for (int i = 0; i < 3; i++)
        if ((size_t)(s->end - s->at) >= words[i].length
            && memcmp(s->at, words[i].word, words[i].length) == 0) {
            s->at += words[i].length;
            *out = item_of(s, words[i].type);
            return *out != NULL ? MODAL_OK : no_memory(s);
        }
    return read_number(s, out);
}

static enum modal_status read_document(struct scan *s, cJSON **out)
{
    enum modal_status rc = scan_value(s, out);

    if (rc != MODAL_OK)
        return rc;
    skip_space(s);
    return s->at == s->end ? MODAL_OK : scan_fail(s, "text after the value");
}

enum modal_status json_read(const char *text, size_t length, cJSON **out, struct modal_error *err)
{
    struct scan s = { .start = text, .at = text, .end = text + length, .err = err };
    cJSON *value = NULL;
    enum modal_status rc = read_document(&s, &value);

    if (rc == MODAL_OK)
        *out = value;
    else
        cJSON_Delete(value);
    return rc;
}

enum modal_status json_read_pooled(const char *text, size_t length, cJSON **out,
                                   struct json_pool **pool, struct modal_error *err)
{
    struct json_pool *own = NULL;
    struct scan s = { .start = text, .at = text, .end = text + length, .err = err, .pool = &own };
    cJSON *value = NULL;
    enum modal_status rc = read_document(&s, &value);

    if (rc == MODAL_OK) {
        *out = value;
        *pool = own;
    } else
        json_pool_free(own);
    return rc;
}

/* ---- a member as it is written --------------------------------------------------------------- */

static size_t skip_blanks(const char *text, size_t length, size_t at)
{
    while (at < length && memchr(" \t\r\n", text[at], 4) != NULL)
        at++;
    return at;
}

/* Behind the string that begins AT. */
static size_t skip_quoted(const char *text, size_t length, size_t at)
{
    const char *end = text + length, *p = plain_end(text + (at < length ? at + 1 : at), end);

    while (p < end && *p != '"')
        p = plain_end(p + (*p == '\\' && end - p > 1 ? 2 : 1), end);
    return (size_t)(p - text) + 1;
}

/* Behind the value that begins AT. */
static size_t skip_member(const char *text, size_t length, size_t at)
{
    enum { OTHER, OPEN, CLOSE, COMMA, QUOTE };
    static const unsigned char kinds[256] = {
        ['{'] = OPEN, ['['] = OPEN, ['}'] = CLOSE, [']'] = CLOSE, [','] = COMMA, ['"'] = QUOTE };
    size_t depth = 0;

    while (at < length) {
        const int kind = kinds[(unsigned char)text[at]];
        if (depth == 0 && (kind == CLOSE || kind == COMMA))
            break;
        depth += kind == OPEN;
        depth -= kind == CLOSE;
        at = kind == QUOTE ? skip_quoted(text, length, at) : at + 1;
    }
    return at;
}

/* The member whose name begins at NAME and ends before END, its value from VALUE to BEHIND, into
 * FOUND, if it is one of KEYS. */
static void note_member(const char *text, size_t name, size_t end, size_t value, size_t behind,
                        const char *const *keys, size_t count, struct json_part *found)
{
    for (size_t i = 0; i < count; i++)
        if (end - name == strlen(keys[i]) && memcmp(text + name, keys[i], end - name) == 0) {
            while (behind > value && memchr(" \t\r\n", text[behind - 1], 4) != NULL)
                behind--;
            found[i] = (struct json_part) { text + value, behind - value };
            return;
        }
}

void json_find_texts(const char *text, size_t length, const char *const *keys, size_t count,
                     struct json_part *found)
{
    size_t at = skip_blanks(text, length, 0);

    memset(found, 0, count * sizeof *found);
    if (at >= length || text[at] != '{')
        return;
    do {
        const size_t name = skip_blanks(text, length, at + 1) + 1,
                     behind = skip_quoted(text, length, name - 1),
                     colon = skip_blanks(text, length, behind),
                     value = skip_blanks(text, length, colon + 1);
        at = skip_member(text, length, value);
        if (at < length)
            note_member(text, name, behind - 1, value, at, keys, count, found);
    } while (at < length && text[at] == ',');
}
