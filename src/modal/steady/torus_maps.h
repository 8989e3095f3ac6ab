/* torus_maps.h - strides of a march as products with matrices
 *
 * While no law changes its regime u = (x, v, levels, cosines, sines) obeys u' = A u, A one matrix
 * for each set of regimes, and a stride of 2^j steps is a product with e^{A h 2^j}: as exact, and
 * as dear, for many steps as for one, whatever there is faster than the stride.
 */
#ifndef MODAL_TORUS_MAPS_H
#define MODAL_TORUS_MAPS_H
#include "modal/linalg/workspace.h"
#include "modal/steady/torus_taylor.h"

/* A set of regimes, steps taken in it, and once it has them its maps, by columns, of 1, 2,
 * 4 .. steps one behind the other; bend: of each law d'' h^2, a row of as many columns; terms, or
 * NULL: of a step's polynomials, all their terms, by columns too. */
struct torus_regime { int *key; long steps; double *P, *bend, *terms; };

struct torus_maps {
    struct workspace space;
    struct torus_taylor *t;                        /* borrowed */
    int columns, longest;                          /* strides of 2^longest steps are the longest */
    struct torus_regime *regime, *now;             /* now NULL: none of those kept */
    int regimes, most;                             /* most 0: steps are of polynomials */
    int telling;                                   /* so many more sets may have their terms */
    double *turn;                                  /* [stride][wave][2]: cos, sin of omega h 2^j */
    double *in, *out;                              /* of a product */
};

/* Whether maps of COUNT sets of T's laws have room, for strides of as many as 2^LONGEST steps. */
bool torus_maps_fit(const struct torus_taylor *t, int longest, double count);
/* Of T, its step set, 2^SAMPLE of them from sample to sample.  Fails with MODAL_NO_MEMORY; done
 * takes what is half made. */
enum modal_status torus_maps_init(struct torus_maps *a, struct torus_taylor *t, int sample,
                                  int longest, struct modal_error *err);
void torus_maps_done(struct torus_maps *a);
/* A->now is that of KEY, the regime of each law: found among those met before, for a motion of few
 * laws has few and meets them again and again, or a new one while there is room. */
void torus_maps_find(struct torus_maps *a, const int *key);
/* Whether A->now has its maps; EARNED: a step is taken in it, and those that have been stepped
 * through as often as a map has columns have earned theirs. */
bool torus_maps_has(struct torus_maps *a, bool earned);
/* 2^J steps from U, as torus_taylor_make has it, WAVE at their begin, into TO. */
void torus_maps_stride(const struct torus_maps *a, int j, const double *u, const double *wave,
                       double *to);
/* Whether A->now tells polynomials; those of a step from U, WAVE there, into t->a: what
 * torus_taylor_make has of its terms. */
bool torus_maps_tells(const struct torus_maps *a);
void torus_maps_tell(const struct torus_maps *a, const double *u, const double *wave);
/* d'' h^2 of law L at U and WAVE. */
double torus_maps_bend(const struct torus_maps *a, int l, const double *u, const double *wave);
/* WAVE 2^J steps on. */
void torus_maps_turn(const struct torus_maps *a, int j, double *wave);
/* What a stride costs, in budget.h's units, be it long or short, and polynomials. */
double torus_maps_work(const struct torus_maps *a);
double torus_maps_tell_work(const struct torus_maps *a);
#endif
