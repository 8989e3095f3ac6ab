/* subspace.h - innovations models of every order from the covariances of a record */
#ifndef MODAL_SUBSPACE_H
#define MODAL_SUBSPACE_H
#include "modal/identify/ambient/whittle.h"

/*
 * The state is the part of the past that tells most of the future, by canonical correlation: its
 * first N entries are the state of order N, so that leading parts of A, C and M are its own.
 */
struct subspace {
    int channels, order;          /* the highest order */
    double *A;                    /* order x order: E x(t+1) x(t)^T, where E x x^T = 1 */
    double *C;                    /* channels x order: E y(t) x(t)^T */
    double *M;                    /* order x channels: E x(t+1) y(t)^T */
    double *zero;                 /* channels x channels: E y y^T */
};

enum {
    SUBSPACE_SIDE = 300,          /* numbers in a past: it is decomposed in a tenth of a second */
    SUBSPACE_SIDE_MOST = 720      /* a second and a half */
};
/* Of the record whose lines are S, by a past of SIDE numbers at most.  *OUT is empty on failure;
 * subspace_done frees it.  Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE, MODAL_BAD_INPUT (a
 * record shorter than a few samples). */
enum modal_status subspace_make(const struct spectrum *s, int side, struct subspace *out,
                                struct modal_error *err);
void subspace_done(struct subspace *s);

/* The model of so many states, a real pole as a pair about it; false where it has none. */
bool subspace_model(const struct subspace *s, int order, struct whittle *out);
#endif
