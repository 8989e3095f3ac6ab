/* settle.h - a motion that repeats, found in time: a start for the balance where no way of its own
 * leads to one, and the answer where the balance does not settle even from there
 *
 * Harmonic balance of kinks has no descent to its solution from afar; time integration has: the
 * state forgets where it began, and where what repeats is unstable Newton's method on the map of
 * a period closes it. */
#ifndef MODAL_SETTLE_H
#define MODAL_SETTLE_H
#include <stdbool.h>
#include "base/error.h"

struct cycle;
struct cycle_options;
struct program;
struct settle;                /* one search */

/* Of a motion's size, what a period may leave open of one that is a start still. */
#define SETTLE_NEAR 0.1

/* Whether P is of the kind that is followed here: laws that a state determines, none rigid and none
 * a user's, and few states. */
bool settle_takes(const struct program *p);

/* For the program P (settle_takes) at OMEGA, borrowed, as is what OPT points to.  Fails with
 * MODAL_NO_MEMORY, or as statespace_new does. */
enum modal_status settle_new(const struct program *p, double omega, const struct cycle_options *opt,
                             struct settle **out, struct modal_error *err);
/* NULL is accepted. */
void settle_free(struct settle *s);

/*
 * A motion near the one that is reached from displacements X0 and rates V0 by dof, sliders at zero
 * (NULL: from rest), into OUT, without forces and multipliers; cycle_done frees it.  MOST:
 * operations of budget.h that closing it may cost.  Not to close is an answer: where it leaves
 * SETTLE_NEAR open at most the last period is given all the same.  ATTRACTED: what marching alone
 * comes near to, as an unstable motion is not.  Fails with MODAL_NO_MEMORY or MODAL_CANCELLED.
 */
enum modal_status settle_find(struct settle *s, const double *x0, const double *v0, double most,
                              bool attracted, struct cycle *out, struct modal_error *err);

/* The motion itself, to 1e-9, in place of that of settle_find, in OUT, or sought on from where that
 * ended; not closed where that costs more than MOST.  Fails as settle_find. */
enum modal_status settle_close(struct settle *s, double most, struct cycle *out,
                               struct modal_error *err);

/* Instants of a period that settle_look compares, equally spaced from its start. */
enum { SETTLE_INSTANTS = 64 };

/*
 * The period from displacements X0 and rates V0 by dof, what laws remember as a period before
 * leaves it: displacement of dof i at instant j into X[i * SETTLE_INSTANTS + j].  *ENDED false: it
 * costs more than MOST.  Fails as settle_find.
 */
enum modal_status settle_look(struct settle *s, const double *x0, const double *v0, double most,
                              double *x, bool *ended, struct modal_error *err);

/* The motion that closes near the period of settle_look, or some periods on, to 1e-9 by Newton's
 * method from there, into OUT as settle_find.  Fails as settle_find. */
enum modal_status settle_close_from(struct settle *s, double most, struct cycle *out,
                                    struct modal_error *err);

/* The multipliers of the motion found, what laws remember among its states, and their error, into
 * OUT; it has none where that would cost more than MOST.  Fails as settle_find. */
enum modal_status settle_multipliers(struct settle *s, double most, struct cycle *out,
                                     struct modal_error *err);
#endif
