/* bytes.h - a file's bytes in memory, and the numbers in them */
#ifndef CTL_FILES_BYTES_H
#define CTL_FILES_BYTES_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/error.h"

/* LENGTH bytes, of which AT have been passed. */
struct bytes { const unsigned char *data; size_t length, at; };

/* The next COUNT bytes, passed then; NULL, and nothing passed, where there are not so many. */
const unsigned char *bytes_next(struct bytes *bytes, size_t count);
size_t bytes_left(const struct bytes *bytes);

/* How a number lies in a file: SIZE 1, 2, 4 or 8; a `float` has 4 or 8. */
struct number_type { enum { NUMBER_NONE, NUMBER_FLOAT, NUMBER_INT, NUMBER_UINT } kind;
                     int size; bool big; };

/* The number that begins at FROM. */
double number_decode(struct number_type type, const unsigned char *from);
/* COUNT of them, one behind the other. */
void numbers_decode(struct number_type type, const unsigned char *from, size_t count, double *to);
/* The next number as a size, passed then; false where the bytes end or it is negative. */
bool bytes_size(struct bytes *bytes, struct number_type type, size_t *out);

/* What deflate made LENGTH bytes of, at most: RFC 1951 cannot make less of more. */
size_t inflated_most(size_t length);
/*
 * Inflate FROM, with or without zlib's head (RAW: without), into TO until it has ROOM bytes or
 * the stream ends; *GOT says how many.  False where the stream is damaged or cut.
 */
bool inflate_bytes(struct bytes from, bool raw, unsigned char *to, size_t room, size_t *got);
#endif
