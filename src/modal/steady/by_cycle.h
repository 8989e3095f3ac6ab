/* by_cycle.h - the steady state under rigid friction: a motion followed in time (cycle.h), as a
 * point of H harmonics */
#ifndef MODAL_BY_CYCLE_H
#define MODAL_BY_CYCLE_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct balance;
struct steady;
struct steady_point;
struct steady_start;

/*
 * Follow the program of S (cycle_takes) at OMEGA from START, or from rest (NULL), until it repeats,
 * and give it as POINT at the options' harmonics or as few as meet the target, with multipliers and
 * errors.  Not to repeat is an answer: not converged.  Fails as cycle_find and balance_set do.
 */
enum modal_status solve_by_cycle(struct steady *s, double omega, const struct steady_start *start,
                                 struct steady_point *point, struct modal_error *err);

/*
 * The motion of S at OMEGA that settle.h finds from START, or from rest (NULL): sought when a
 * solution first asks for it, and kept until time_forget.  X: its harmonics of balance B's kept
 * dofs; *FOUND false: there is none, or laws that are not followed.  Fails with MODAL_NO_MEMORY or
 * MODAL_CANCELLED.
 */
enum modal_status time_start(struct steady *s, const struct balance *b,
                             const struct steady_start *start, double complex *X, bool *found,
                             struct modal_error *err);
/* What time_start found as POINT, as solve_by_cycle gives its own; its iterations and attempts
 * stay.  What it found near is closed, for which the budget grows; a search that has found nothing
 * goes on for as many operations of budget.h as it had, of REST.  Fails as time_start does. */
enum modal_status time_answer(struct steady *s, double omega, double rest,
                              struct steady_point *point, struct modal_error *err);
/* Whether time_start found a motion that closes: time_answer has an answer. */
bool time_closed(const struct steady *s);
/* As time_start, of a motion from rest that attracts. */
enum modal_status time_attractor(struct steady *s, const struct balance *b, double complex *X,
                                 bool *found, struct modal_error *err);
/*
 * POINT, balanced with an estimate of its errors, is looked at in time: where its series leaves
 * much of the forces unbalanced, a period is marched from its own state, and the motion that closes
 * in time from there takes its place.  Closes none, though that period leaves it by more than its
 * error allows, it is not converged.  Fails as time_start does.
 */
enum modal_status time_look(struct steady *s, struct steady_point *point, struct modal_error *err);
/* Frees it. */
void time_forget(struct steady *s);
#endif
