/* at_rest.h - the motion in which no law leaves the regime that it rests in: gaps that stay open,
 * contacts that stay closed, sliders that never slip
 *
 * There each law is a level and a spring (law_rest), and the program a linear one: it is solved as
 * one, and each law is asked whether what it would see stays in its regime (law_class.stays).
 */
#ifndef MODAL_AT_REST_H
#define MODAL_AT_REST_H
#include <stdbool.h>
#include "modal/steady/point.h"

struct at_rest;

/* Of P, borrowed until at_rest_free, to recover the COUNT dofs of DOFS (NULL: all).  *OUT is NULL
 * where laws are few, some law has no such regime or matrices pulsate.  Fails as condense_new
 * does. */
enum modal_status at_rest_new(const struct program *p, const int *dofs, int count,
                              struct at_rest **out, struct modal_error *err);
/* NULL is accepted. */
void at_rest_free(struct at_rest *a);

/* Whether there is such a motion at OMEGA: then POINT, initialised, becomes it. *FOUND is false too
 * where what is held at rest has none. */
enum modal_status at_rest_solve(struct at_rest *a, double omega, struct steady_point *point,
                                bool *found, struct modal_error *err);
/* The least H that holds the loads, at least 1. */
int at_rest_harmonics(const struct at_rest *a);
/* The program with its laws' springs and forces at rest in their place, borrowed. */
const struct program *at_rest_program(const struct at_rest *a);
/* Operations (budget.h) so far. */
double at_rest_work(const struct at_rest *a);
#endif
