/* ambient_free.h - is a record that was sent as ambient likelier a free response? */
#ifndef MODAL_AMBIENT_FREE_H
#define MODAL_AMBIENT_FREE_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/* Rows that are looked at, from the first on. */
enum { AMBIENT_FREE_ROWS = 65536 };

/*
 * Of Y (samples x channels, kept), its strongest orthogonal signal: *motions is the number of
 * decaying or growing vibrations, the fewest tried first, that are likelier with white noise than
 * stationary noise is, and *left what they leave of its rms; 0 where none are.  LESS: the first
 * rows of it are Y without the COUNT lines of constant amplitude that were found, which are
 * stationary, too.  STEP seconds a sample.  Fails with MODAL_NO_MEMORY.
 */
struct ambient_free_input { const struct matrix *Y, *less; int count; double step; };
/* *motions and *left of that. */
enum modal_status ambient_free(const struct ambient_free_input *in, int *motions, double *left,
                               struct modal_error *err);
#endif
