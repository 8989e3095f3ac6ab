/* unheld.h - means that nothing holds: of a body that sliders alone stop, one of many */
#ifndef MODAL_UNHELD_H
#define MODAL_UNHELD_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

struct balance;
struct iterate_options;

/* Motions of harmonic 0 alone, orthonormal: the last `count` rows of V; or `all`, where blocks say
 * no more than that there is one. */
struct unheld {
    struct matrix V;
    int count;
    bool all;
};

/* The derivative of B, just made, factored.  Means that nothing holds are found into M and held by
 * a spring each, as stiff as the stiffest in their rows: the rest is solved as it was.  What is
 * singular but for these is not factored. */
enum modal_status unheld_factor(struct balance *b, struct unheld *m, struct modal_error *err);
/* Frees what M holds. */
void unheld_done(struct unheld *m);
/* Whether there is one. */
bool unheld_any(const struct unheld *m);
/* Whether there is one of the motion that B's last residual was of: *OPEN.  B's derivative is made
 * and factored for it; a direction of more than means is none. */
enum modal_status unheld_ask(struct balance *b, bool *open, struct modal_error *err);

/* What of y, as balance_solve leaves it, moves means of M: out of it, for it has no error. */
void unheld_leave(const struct balance *b, const struct unheld *m, double *y);
/* X, of which M is, moved along M until its mean is the nearest to 0, where bodies begin.  A stop
 * in between, where it balances no more, ends the way a swing before it, as graze.h leaves stops.
 * Digits that it had lost far off are found again; *RESIDUAL, X's (balance_relative_residual),
 * becomes the new one's.  R is of X then, and the derivative is to be made anew. */
enum modal_status unheld_settle(struct balance *b, const struct unheld *m,
                                const struct iterate_options *opt, double complex *X,
                                double *residual, struct modal_error *err);
#endif
