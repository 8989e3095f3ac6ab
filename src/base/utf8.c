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

const char *utf8_control(const char *text)
{
    const unsigned char *p = (const unsigned char *)text;

    while (p[0] >= 0x20 && p[0] != 0x7f && !(p[0] == 0xc2 && p[1] >= 0x80 && p[1] <= 0x9f))
        p++;
    return (const char *)p;
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
