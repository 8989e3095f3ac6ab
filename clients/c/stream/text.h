/* text.h - messages as text: JSON written at the end of a buffer, and read where it lies */
#ifndef STREAM_TEXT_H
#define STREAM_TEXT_H
#include "state.h"

/* Append to TEXT, never past SIZE; too long a text ends short and is refused by the daemon. */
static void append(char *text, size_t size, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Append STRING as JSON writes it, in quotes. */
static void append_string(char *text, size_t size, const char *string);

/* P behind its white space. */
static const char *skip_space(const char *p);

/* JSON is read where it lies, up to its 0.  A P below is where a value begins; NULL: there is none,
 * and none is in it. */

/*
 * Read the object at P in one pass: VALUES gets where the value of each of the COUNT KEYS begins,
 * or NULL where it has none.  Returns what is behind the object; NULL, and no value: it does not
 * end, or one of the keys is there twice.  Keys are compared as they are written: an escape in one
 * makes it another.  What a value that is not asked for holds is passed over, its brackets counted.
 */
static const char *read_object(const char *p, const char *const *keys, size_t count,
                               const char **values);

/* The value of KEY in the object at P; NULL: there is none, or none that read_object would give. */
static const char *member(const char *p, const char *key);

/* The first element of the list at P; NULL: there is none. */
static const char *first_element(const char *p);

/* The element behind the one at P; NULL: it was the last. */
static const char *next_element(const char *p);

/* The number at P; OTHERWISE where there is none that a double holds. */
static double number_at(const char *p, double otherwise);

/* The same for a count of things, up to 2^53. */
static uint64_t count_at(const char *p, uint64_t otherwise);

/* Is it the string TEXT, which JSON writes as it is? */
static bool is_text(const char *p, const char *text);

/* What add_string made of a string of fewer than SIZE bytes, into OUT; false, and OUT is "": it is
 * no such string. */
static bool read_string(const char *p, char *out, size_t size);

/* Append the members of `open` behind the id: what the stream is, and which run it comes from. */
static void open_header(modald_stream *s, char *text, size_t size);
#endif
