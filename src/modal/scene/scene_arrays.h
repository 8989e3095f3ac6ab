/* scene_arrays.h - sparse matrices that stand behind a scene's text, as they lie
 *
 * An input of a scene is its JSON text or, where it has matrices of many entries, that text, a zero
 * byte, and arrays.  In the text such a matrix is
 *
 *     {"shape": [n, n], "entries": e, "offset": o}
 *
 * and o bytes behind the zero byte stand, little-endian and without gaps,
 *
 *     u32 row_pointers[n + 1], u32 columns[e], f64 values[e]:
 *
 * compressed rows, counted from 0.  Columns of a row come in any order, and entries of one place
 * add up.  Two matrices may share one place.  All of it is hashed as the scene's text is.
 */
#ifndef MODAL_SCENE_ARRAYS_H
#define MODAL_SCENE_ARRAYS_H
#include <stdbool.h>
#include <stddef.h>
#include "base/error.h"
#include "base/json.h"

struct triplet;

/* What stands behind the zero byte; borrowed.  Zero: nothing does. */
struct scene_arrays { const unsigned char *data; size_t length; };

/* The length of the text that INPUT, LENGTH bytes, begins with; what stands behind it into *OUT. */
size_t scene_arrays_split(const void *input, size_t length, struct scene_arrays *out);

/* Does JSON name a matrix that stands behind the text? */
bool scene_arrays_named(const cJSON *json);

/*
 * The entries of the M x N matrix that JSON, at the path WHERE, names in A (NULL: none), by rows:
 * COUNT of them into *OUT, the caller's.  Fails with MODAL_BAD_INPUT where anything is not as
 * above or not finite, MODAL_TOO_LARGE past the limits of lowering.h, MODAL_NO_MEMORY; outputs are
 * then left alone.
 */
enum modal_status scene_arrays_read(const struct scene_arrays *a, const cJSON *json,
                                    const char *where, struct triplet **out, int *count, int *m,
                                    int *n, struct modal_error *err);

/* Arrays under way, with the zero byte ahead; zero is empty, free(data) ends it. */
struct scene_arrays_made { unsigned char *data; size_t length; };

/*
 * Add an N x N matrix of COUNT entries by compressed rows; what the text says of it into *OUT, the
 * caller's.  Fails with MODAL_BAD_INPUT at the path WHERE for pointers or columns that are no whole
 * numbers of 32 bits, MODAL_NO_MEMORY.
 */
enum modal_status scene_arrays_add(struct scene_arrays_made *to, const char *where, size_t n,
                                   size_t count, const double *pointers, const double *columns,
                                   const double *values, cJSON **out, struct modal_error *err);
#endif
