/* log.c - see log.h */
#include "base/log.h"
#include <assert.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/json.h"
#include "base/utf8.h"

enum {
    /* the digits of the largest double by %f, its point and those behind it */
    NUMBER_MOST = 340,
    SPEC_MOST   = 32,      /* of a conversion of ours written out for snprintf */
};

/* A conversion such as %.4096s or %lld: flags, width and precision as they stand, how many l,
 * whether z. */
struct conversion { const char *flags, *end; int length, longs; bool size; char type; };

static struct conversion read_conversion(const char *percent)
{
    struct conversion c = { .flags = percent + 1 };

    c.length = (int)strspn(c.flags, "-0123456789.");
    c.end = c.flags + c.length;
    for (; *c.end == 'l'; c.end++)
        c.longs++;
    c.size = *c.end == 'z';
    c.end += c.size;
    c.type = *c.end++;
    assert(strchr("sduofg", c.type) != NULL);
    return c;
}

/* Whether VALUE may stand without quotes. */
static bool is_bare(const char *value)
{
    while ((unsigned char)*value > ' ' && utf8_control_length(value) == 0 && *value != '"'
           && *value != '\\')
        value++;
    return *value == '\0';
}

static void put_text(struct json_text *line, const struct conversion *c, const char *value,
                     bool quoted)
{
    const char *point = memchr(c->flags, '.', (size_t)c->length);
    char *part = point == NULL ? strdup(value) : strndup(value, strtoul(point + 1, NULL, 10));

    if (part == NULL)
        line->failed = true;
    else if (quoted || !is_bare(part))
        json_text_quoted(line, part);
    else
        json_text_raw(line, part);
    free(part);
}

static void put_double(struct json_text *line, const struct conversion *c, double x)
{
    char spec[SPEC_MOST], digits[NUMBER_MOST];

    snprintf(spec, sizeof spec, "%%%.*s%c", c->length, c->flags, c->type);
    snprintf(digits, sizeof digits, spec, x);
    json_text_raw(line, digits);
}

/* By %d or, of one without a sign, by the others. */
static void put_integer(struct json_text *line, const struct conversion *c, unsigned long long x)
{
    char spec[SPEC_MOST], digits[NUMBER_MOST];

    snprintf(spec, sizeof spec, "%%%.*sll%c", c->length, c->flags, c->type);
    snprintf(digits, sizeof digits, spec, x);
    json_text_raw(line, digits);
}

char *log_vtext(const char *format, va_list args)
{
    struct json_text line = { 0 };
    const char *percent;

    for (; (percent = strchr(format, '%')) != NULL;) {
        struct conversion c = read_conversion(percent);
        bool quoted = c.type == 's' && percent > format && percent[-1] == '"' && *c.end == '"';

        json_text_bytes(&line, format, (size_t)(percent - format) - quoted);
        format = c.end + quoted;
        if (c.type == 's')
            put_text(&line, &c, va_arg(args, const char *), quoted);
        else if (c.type == 'f' || c.type == 'g')
            put_double(&line, &c, va_arg(args, double));
        else if (c.longs > 0 || c.size)            /* all of them have 64 bits here */
            put_integer(&line, &c, va_arg(args, unsigned long long));
        else if (c.type == 'd')
            put_integer(&line, &c, (unsigned long long)va_arg(args, int));
        else
            put_integer(&line, &c, va_arg(args, unsigned));
    }
    json_text_raw(&line, format);
    if (!line.failed)
        return line.x;
    free(line.x);
    return NULL;
}

char *log_text(const char *format, ...)
{
    va_list args;
    char *text;

    va_start(args, format);
    text = log_vtext(format, args);
    va_end(args);
    return text;
}
