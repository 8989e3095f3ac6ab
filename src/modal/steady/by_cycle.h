/* by_cycle.h - the steady state under rigid friction: a motion followed in time (cycle.h), as a
 * point of H harmonics */
#ifndef MODAL_BY_CYCLE_H
#define MODAL_BY_CYCLE_H
#include "base/error.h"

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
#endif
