/* text.c - see text.h */
#include "text.h"
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void append(char *text, size_t size, const char *format, ...)
{
    size_t used = strlen(text);
    va_list args;

    va_start(args, format);
    if (used < size)
        vsnprintf(text + used, size - used, format, args);
    va_end(args);
}

static void append_string(char *text, size_t size, const char *string)
{
    append(text, size, "\"");
    for (const unsigned char *p = (const unsigned char *)string; *p != 0; p++)
        if (*p == '"' || *p == '\\')
            append(text, size, "\\%c", *p);
        else if (*p < 0x20)
            append(text, size, "\\u%04x", *p);
        else
            append(text, size, "%c", *p);
    append(text, size, "\"");
}

/* JSON is read where it lies, up to its 0.  A P below is where a value begins; NULL: there is none,
 * and none is in it. */

static const char *skip_space(const char *p)
{
    return p + strspn(p, " \t\r\n");
}

/* Behind the string at P; NULL: it does not end. */
static const char *skip_string(const char *p)
{
    for (p++; *p != '"'; p++)
        if (*p == 0 || (*p == '\\' && *++p == 0))
            return NULL;
    return p + 1;
}

/* Behind the value at P; NULL: it does not end.  Brackets are counted: none are too many. */
static const char *skip_value(const char *p)
{
    static const char marks[] = "\"{}[],: \t\r\n";
    size_t depth = 0, length;

    do {
        length = strcspn(p, marks);
        if (length == 0 && (*p == 0 || (depth == 0 && strchr("}],: \t\r\n", *p) != NULL)))
            return NULL;
        depth += *p == '{' || *p == '[';
        depth -= *p == '}' || *p == ']';
        p = *p == '"' ? skip_string(p) : p + (length > 0 ? length : 1);
    } while (p != NULL && depth > 0);
    return p;
}

/* The pair at P, its value noted if the key is one of KEYS.  Behind it; NULL: no pair, or noted
 * before. */
static const char *read_pair(const char *p, const char *const *keys, size_t count,
                             const char **values)
{
    const char *name = p + 1, *end = *p == '"' ? skip_string(p) : NULL;
    size_t length = end != NULL ? (size_t)(end - 1 - name) : 0;

    if (end == NULL || *(p = skip_space(end)) != ':')
        return NULL;
    p = skip_space(p + 1);
    for (size_t i = 0; i < count; i++)
        if (strlen(keys[i]) == length && memcmp(name, keys[i], length) == 0) {
            if (values[i] != NULL)
                return NULL;
            values[i] = p;
        }
    p = skip_value(p);
    return p != NULL ? skip_space(p) : NULL;
}

static const char *read_object(const char *p, const char *const *keys, size_t count,
                               const char **values)
{
    bool good = p != NULL && *p == '{', more;

    for (size_t i = 0; i < count; i++)
        values[i] = NULL;
    p = good ? skip_space(p + 1) : p;
    more = good && *p != '}';
    while (more) {
        p = read_pair(p, keys, count, values);
        more = p != NULL && *p == ',';
        p = more ? skip_space(p + 1) : p;
    }
    good = good && p != NULL && *p == '}';
    for (size_t i = 0; !good && i < count; i++)
        values[i] = NULL;
    return good ? p + 1 : NULL;
}

static const char *member(const char *p, const char *key)
{
    const char *value;

    read_object(p, &key, 1, &value);
    return value;
}

static const char *first_element(const char *p)
{
    p = p != NULL && *p == '[' ? skip_space(p + 1) : NULL;
    return p != NULL && *p != ']' ? p : NULL;
}

/* The element behind the one at P. */
static const char *next_element(const char *p)
{
    p = skip_value(p);
    p = p != NULL ? skip_space(p) : NULL;
    return p != NULL && *p == ',' ? skip_space(p + 1) : NULL;
}

/* The number at P; OTHERWISE where there is none that a double holds. */
static double number_at(const char *p, double otherwise)
{
    size_t length = p != NULL ? strcspn(p, ",]} \t\r\n") : 0;
    double value;
    char *end;

    if (length == 0 || strspn(p, "0123456789+-.eE") < length
        || (*p != '-' && (*p < '0' || *p > '9')))
        return otherwise;                               /* strtod also knows nan, infinity, 0x1p4 */
    value = strtod(p, &end);
    return end == p + length && isfinite(value) ? value : otherwise;
}

/* The same for a count of things. */
static uint64_t count_at(const char *p, uint64_t otherwise)
{
    double value = number_at(p, -1);
    bool good = value >= 0 && value <= integer_most && value == floor(value);

    return good ? (uint64_t)value : otherwise;
}

/* Is it the string TEXT, which JSON writes as it is? */
static bool is_text(const char *p, const char *text)
{
    size_t length = strlen(text);

    return p != NULL && *p == '"' && strncmp(p + 1, text, length) == 0 && p[1 + length] == '"';
}

enum { ESCAPE = 5 };         /* of a control character behind its backslash: u00 and two digits */

/* What add_string made of a string of fewer than SIZE bytes, into OUT; false, and OUT is "": it is
 * no such string. */
static bool read_string(const char *p, char *out, size_t size)
{
    size_t used = 0;
    unsigned code;

    out[0] = 0;
    if (p == NULL || *p != '"')
        return false;
    for (p++; *p != '"' && *p != 0 && used + 1 < size; p++)
        if (*p != '\\')
            out[used++] = *p;
        else if (p[1] == '"' || p[1] == '\\')
            out[used++] = *++p;
        else if (strspn(p + 1, "u0123456789abcdefABCDEF") >= ESCAPE
                 && sscanf(p + 1, "u00%2x", &code) == 1 && code > 0 && code < 0x20)
            out[used++] = (char)code, p += ESCAPE;
        else
            break;
    out[*p == '"' ? used : 0] = 0;
    return *p == '"';
}

/* The members of `open` behind the id: what the stream is, and which run it comes from. */
static void open_header(modald_stream *s, char *text, size_t size)
{
    if (s->open_text != NULL) {
        append(text, size, "%s", s->open_text);
        return;
    }
    append(text, size, ",\"op\":\"open\",\"name\":");
    append_string(text, size, s->name);
    append(text, size, ",\"channels\":%d,\"dt\":%.17g", s->channels, s->dt);
    if (s->period > 0)
        append(text, size, ",\"period\":%.17g", s->period);
    if (s->names != NULL)
        append(text, size, ",\"names\":%s", s->names);
    if (s->units != NULL)
        append(text, size, ",\"units\":%s", s->units);
    append(text, size, ",\"attributes\":%s", s->run ? s->run : "{}");
    if (s->window_samples > 0)
        append(text, size, ",\"window\":{\"samples\":%ld,\"hop\":%ld%s%s%s%s}", s->window_samples,
               s->window_hop > 0 ? s->window_hop : s->window_samples,
               s->options ? ",\"options\":" : "", s->options ? s->options : "",
               s->alarms ? ",\"alarms\":" : "", s->alarms ? s->alarms : "");
    append(text, size, "}");
}
