/* magnus.h - maps of y' = A(t) y over a time, by the sixth-order Magnus series */
#ifndef MODAL_MAGNUS_H
#define MODAL_MAGNUS_H
#include <stdbool.h>
#include "modal/scene/sources.h"
#include "modal/scene/statespace.h"

enum { MAGNUS_SUBSTEPS_MOST = 1 << 17 };   /* past it rounding of the product is 1e-11 */

struct magnus {
    const struct statespace *ss;  /* borrowed */
    int size;                    /* N, or N + nw with the sources' states below */
    struct magnus_work *work;  /* matrices of `size`, made once */
};

/* SRC NULL: the state alone.  Both are borrowed. */
enum modal_status magnus_new(const struct statespace *ss, const struct sources *src,
                             struct magnus **out, struct modal_error *err);
/* NULL is accepted. */
void magnus_free(struct magnus *m);

/* OUT (size x size by columns): the map over [t, t + h], as the product of SUBSTEPS steps. */
enum modal_status magnus_map(struct magnus *m, double t, double h, int substeps, double *out,
                             struct modal_error *err);

/*
 * The same, with *substeps doubled from what it holds (at least 1) until the map changes by less
 * than TOLERANCE times its norm, then extrapolated (the next order of the even error series is
 * removed).  *error estimates the relative error left.  Fails with MODAL_NO_CONVERGENCE past
 * MAGNUS_SUBSTEPS_MOST.
 */
enum modal_status magnus_converge(struct magnus *m, double t, double h, double tolerance,
                                  int *substeps, double *out, double *error,
                                  struct modal_error *err);

#endif
