/* ambient_free.h - do few decaying or growing motions rebuild what was sent as ambient? */
#ifndef MODAL_AMBIENT_FREE_H
#define MODAL_AMBIENT_FREE_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/* Rows that are looked at, from the first on. */
enum { AMBIENT_FREE_ROWS = 65536 };

/*
 * *left: the norm of what ORDER exponentials, a pencil's, leave of Y (samples x channels, kept; its
 * strongest orthogonal signals) over that of Y; 1 where there are none.  STEP seconds a sample.
 * A free response is rebuilt to its noise, an answer to lasting excitation, whose amplitudes and
 * phases change by it, only as far as it is short.  Fails with MODAL_NO_MEMORY.
 */
enum modal_status ambient_free_left(const struct matrix *Y, double step, int order, double *left,
                                    struct modal_error *err);
#endif
