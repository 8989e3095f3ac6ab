/* utf8.h - text that may not be UTF-8: found out, and made so */
#ifndef BASE_UTF8_H
#define BASE_UTF8_H
#include <stdbool.h>
#include <stddef.h>

/* Bytes of the UTF-8 sequence at P, 1 to 4; 0 where it is malformed: overlong, a surrogate, past
 * U+10FFFF, or cut by END. */
int utf8_length(const char *p, const char *end);

/* Is the string UTF-8 all through? */
bool utf8_valid(const char *text);

/* The first control character of TEXT, U+0000 to U+001F or U+007F to U+009F, which terminals obey:
 * its end where there is none. */
const char *utf8_control(const char *text);

/* A copy of LENGTH bytes, up to the first zero byte, as UTF-8: as they stand where they are it,
 * else each byte taken as Latin-1, which can express all.  The caller frees it; NULL when memory
 * runs out. */
char *utf8_from(const char *bytes, size_t length);
#endif
