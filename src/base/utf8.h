/* utf8.h - text that may not be UTF-8: found out, and made so */
#ifndef BASE_UTF8_H
#define BASE_UTF8_H
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

/* Bytes of the UTF-8 sequence at P, 1 to 4; 0 where it is malformed: overlong, a surrogate, past
 * U+10FFFF, or cut by END. */
int utf8_length(const char *p, const char *end);

/* Is the string UTF-8 all through? */
bool utf8_valid(const char *text);

/* Bytes of the control character that TEXT begins with: one that terminals obey, U+0000 (its end, 1
 * byte) to U+001F and U+007F to U+009F, or one that turns the direction of text beside it, so that
 * it reads as what it is not: U+061C, U+200E, U+200F, U+202A to U+202E and U+2066 to U+2069.  0: it
 * begins with none. */
int utf8_control_length(const char *text);

/* The control character that TEXT begins with, of LENGTH bytes as above, as \uXXXX. */
void utf8_control_escape(const char *text, int length, char out[8]);

/* The first control character of TEXT, its end where there is none. */
const char *utf8_control(const char *text);

/* LENGTH bytes of TEXT to FILE for people to read, whoever wrote them: control characters but the
 * ends of lines and tabs as \uXXXX, bytes that are no UTF-8 as U+FFFD.  How many were written:
 * fewer only where a sequence begins that the bytes after them may complete. */
size_t utf8_put(FILE *file, const char *text, size_t length);

/* A copy of LENGTH bytes, up to the first zero byte, as UTF-8: as they stand where they are it,
 * else each byte taken as Latin-1, which can express all.  The caller frees it; NULL when memory
 * runs out. */
char *utf8_from(const char *bytes, size_t length);
#endif
