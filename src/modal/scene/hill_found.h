/* hill_found.h - the motions that windows of Hill's matrix have found, each once */
#ifndef MODAL_HILL_FOUND_H
#define MODAL_HILL_FOUND_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct hill_window;

/* residual: how far the multiplier may be off */
struct hill_hint { double complex exponent; double complex multiplier; double residual; };

struct hill_motion {
    double complex exponent, multiplier; /* not folded */
    double residual, condition, bar;     /* of P's matrices as they are */
    double rounding;                     /* hill_window.h's, times the multiplier's size, of */
                                         /* what may be real; else 0 */
    double turn;                         /* sine of what a cycle of W turns it by: >= 0 */
    double complex *start;
    int run;                             /* the search that it is of, or was seen in last */
    bool taken;                          /* by a hint */
};

struct hill_found {
    int n, wanted, reach;                /* dofs; multipliers; the highest harmonic, of W */
    double period, W;
    struct hill_motion *motion;          /* of each pair the upper one */
    int count, room, runs;
};

/* How far a multiplier may be from the true one, by its RESIDUAL and its CONDITION, as of Phi in
 * floquet.c. */
double hill_motion_bar(double residual, double condition);
/* Is F of a real motion, alone?  Both of a pair may be real over several cycles of W. */
bool hill_motion_real(const struct hill_motion *f);
/* What H found, of each pair the one that a cycle of W turns upwards.  Fails with
 * MODAL_NO_MEMORY. */
enum modal_status hill_found_add(struct hill_found *s, const struct hill_window *h,
                                 struct modal_error *err);
/* How many of those found, which are sorted, make up what is wanted. */
int hill_found_last(struct hill_found *s);
/* Is the one after LAST as large as it? */
bool hill_found_alike(const struct hill_found *s, int last);
/* How large a multiplier must be to be one of those wanted. */
double hill_found_least(struct hill_found *s);
/* The largest modulus so far; 1 before there is any. */
double hill_found_largest(const struct hill_found *s);
/* The multipliers that grow by more than RATE, 1/s. */
int hill_found_growing(const struct hill_found *s, double rate);
/* One of those found that no other hint has, where H says; NULL: there is none. */
struct hill_motion *hill_found_own(struct hill_found *s, const struct hill_hint *h);
/* *S becomes zeros. */
void hill_found_done(struct hill_found *s);
#endif
