/* utf8.c - see utf8.h; the forms of a sequence are those of RFC 3629, section 3 */
#include "base/utf8.h"
#include <stdlib.h>
#include <string.h>

int utf8_length(const char *p, const char *end)
{
    static const struct { unsigned char mask, lead; unsigned least; } forms[] = {
        { 0x80, 0x00, 0 }, { 0xe0, 0xc0, 0x80 }, { 0xf0, 0xe0, 0x800 }, { 0xf8, 0xf0, 0x10000 } };

    for (int n = 0; n < 4; n++) {
        if (((unsigned char)p[0] & forms[n].mask) != forms[n].lead)
            continue;
        unsigned code = (unsigned char)p[0] & (unsigned char)~forms[n].mask;
        if (end - p < n + 1)
            return 0;
        for (int i = 1; i <= n; i++) {
            if (((unsigned char)p[i] & 0xc0) != 0x80)
                return 0;
            code = code << 6 | ((unsigned char)p[i] & 0x3f);
        }
        if (code < forms[n].least || code > 0x10ffff || (code >= 0xd800 && code <= 0xdfff))
            return 0;
        return n + 1;
    }
    return 0;
}

bool utf8_valid(const char *text)
{
    const char *end = text + strlen(text);

    while (text < end) {
        int n = utf8_length(text, end);
        if (n == 0)
            return false;
        text += n;
    }
    return true;
}

int utf8_control_length(const char *text)
{
    const unsigned char *p = (const unsigned char *)text;

    if (p[0] < 0x20 || p[0] == 0x7f)
        return 1;
    if ((p[0] == 0xc2 && p[1] >= 0x80 && p[1] <= 0x9f) || (p[0] == 0xd8 && p[1] == 0x9c))
        return 2;
    if (p[0] == 0xe2 && p[1] == 0x80)
        return p[2] == 0x8e || p[2] == 0x8f || (p[2] >= 0xaa && p[2] <= 0xae) ? 3 : 0;
    return p[0] == 0xe2 && p[1] == 0x81 && p[2] >= 0xa6 && p[2] <= 0xa9 ? 3 : 0;
}

const char *utf8_control(const char *text)
{
    while (utf8_control_length(text) == 0)
        text++;
    return text;
}

void utf8_control_escape(const char *text, int length, char out[8])
{
    static const unsigned char lead[] = { 0x7f, 0x1f, 0x0f };  /* of the first byte */
    unsigned code = (unsigned char)text[0] & lead[length - 1];

    for (int i = 1; i < length; i++)
        code = code << 6 | ((unsigned char)text[i] & 0x3f);
    snprintf(out, 8, "\\u%04x", code & 0xffff);
}

enum { SEQUENCE_MOST = 4 };       /* bytes */

/* Bytes of a sequence that begins with LEAD, as far as that tells. */
static int announced(char lead)
{
    const unsigned char byte = (unsigned char)lead;

    return byte >= 0xf0 && byte <= 0xf4 ? SEQUENCE_MOST : byte >= 0xe0 ? 3 : byte >= 0xc2 ? 2 : 1;
}

size_t utf8_put(FILE *file, const char *text, size_t length)
{
    const char *end = text + length, *from = text, *p = text;

    while (p < end) {
        char whole[SEQUENCE_MOST + 1] = { 0 }, escape[8];
        int n = utf8_length(p, end), control;

        if (n == 0 && end - p < announced(*p))
            break;                                 /* cut, or wrong in a way that the next tells */
        memcpy(whole, p, n > 0 ? (size_t)n : 1);
        control = n > 0 ? utf8_control_length(whole) : 0;
        if (n > 0 && (control == 0 || *p == '\n' || *p == '\t')) {
            p += n;
            continue;
        }
        fwrite(from, 1, (size_t)(p - from), file);
        if (n > 0)
            utf8_control_escape(whole, n, escape);
        fputs(n > 0 ? escape : "\xef\xbf\xbd", file);
        p += n > 0 ? n : 1;
        from = p;
    }
    fwrite(from, 1, (size_t)(p - from), file);
    return (size_t)(p - text);
}

char *utf8_from(const char *bytes, size_t length)
{
    char *text = malloc(2 * length + 1);        /* a Latin-1 byte takes two at most */
    size_t n = 0;

    if (text == NULL)
        return NULL;
    length = strnlen(bytes, length);
    memcpy(text, bytes, length);
    text[length] = 0;
    if (utf8_valid(text))
        return text;
    for (size_t i = 0; i < length; i++) {
        unsigned char c = (unsigned char)bytes[i];
        if (c >= 0x80)
            text[n++] = (char)(0xc0 | c >> 6);
        text[n++] = (char)(c < 0x80 ? c : 0x80 | (c & 0x3f));
    }
    text[n] = 0;
    return text;
}
