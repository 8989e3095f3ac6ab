/* solutions.h - several steady states of one balance: along the loads' level, and from many
 * starts */
#ifndef MODAL_SOLUTIONS_H
#define MODAL_SOLUTIONS_H
#include <complex.h>
#include <stdbool.h>
#include <stdint.h>
#include "base/error.h"

struct balance;

enum { SOLUTIONS_MOST = 64 };   /* chosen: three oscillators that jump have 3^3 */

struct solutions {
    int count;
    double complex *X[SOLUTIONS_MOST];   /* kept dofs of the balance */
};

struct solutions_options {
    int most;                            /* stop at so many; 0: SOLUTIONS_MOST */
    int starts;                          /* of solutions_from_starts; 0: 240 */
    bool (*cancelled)(void *context);
    void *context;
};

/* Add X unless it is there already, to 1e-6 of its size; true if added. */
bool solutions_add(struct solutions *s, const struct balance *b, const double complex *X);

/* Follow the branch from almost no load over its folds, up to LEVEL_HIGH times the load: each
 * crossing of level 1. */
enum modal_status solutions_along_levels(struct balance *b, const struct solutions_options *opt,
                                         struct solutions *out, struct modal_error *err);
/* Follow the branch over the dampers of balance_set_damping from SHARE of them, whose solution X
 * is, around its folds: its first crossings of none, opt->most of them.  B keeps the last
 * dampers. */
enum modal_status solutions_along_damping(struct balance *b, double share, const double complex *X,
                                          const struct solutions_options *opt,
                                          struct solutions *out, struct modal_error *err);
/* Newton's method from `starts` motions of the harmonics up to the loads', their sizes spread over
 * four decades, phases at random from a fixed seed; and from every solution's mirror image and
 * shifts by the loads' own symmetry. */
enum modal_status solutions_from_starts(struct balance *b, const struct solutions_options *opt,
                                        struct solutions *out, struct modal_error *err);
/* Frees every X and empties S. */
void solutions_done(struct solutions *s);
#endif
