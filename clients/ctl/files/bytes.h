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

/*
 * Numbers on their way to TO, LINE of them after the other LINES times: they go LINES apart, so
 * that what lay line behind line is turned; with LINES 1 they lie as they came.
 */
struct numbers { double *to; size_t line, lines, at_line, at; };
/* The next COUNT of them. */
void numbers_put(struct number_type type, const unsigned char *from, size_t count,
                 struct numbers *into);

/* The next number as a size, passed then; false where the bytes end or it is negative. */
bool bytes_size(struct bytes *bytes, struct number_type type, size_t *out);

/* What deflate made LENGTH bytes of, at most: RFC 1951 cannot make less of more. */
size_t inflated_most(size_t length);
/* What is inflated piece by piece, so that nothing more than a piece is held. */
struct inflater;
/* FROM, with or without zlib's head (RAW: without); NULL: no memory. */
struct inflater *inflater_new(struct bytes from, bool raw);
void inflater_free(struct inflater *inflater);
/*
 * Go on into TO until it has ROOM bytes or the stream ends; *GOT says how many.  False where the
 * stream is damaged or cut; its checksum is read with its last byte.
 */
bool inflater_read(struct inflater *inflater, unsigned char *to, size_t room, size_t *got);
/* Exactly COUNT more numbers of TYPE; false also where the stream ends before. */
bool inflater_numbers(struct inflater *inflater, struct number_type type, size_t count,
                      struct numbers *into);
/* COUNT bytes passed over; false as above. */
bool inflater_pass(struct inflater *inflater, size_t count);
/* Of all that came of a RAW one. */
uint32_t inflater_crc(const struct inflater *inflater);

/* FROM, raw, into TO until it has ROOM bytes or the stream ends, as inflater_read. */
bool inflate_bytes(struct bytes from, unsigned char *to, size_t room, size_t *got);
#endif
