/* by_inputs.h - a derivative of many dofs solved on what its laws read: harmonics share one real
 * factorization
 *
 * Where laws are few beside the dofs, as on a joint of two solids. */
#ifndef MODAL_BY_INPUTS_H
#define MODAL_BY_INPUTS_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct aft;
struct aft_target;
struct pattern;
struct program;

/* What all orders of a program share: its inputs, and the receptances of the structure with mean
 * slopes of its laws in place of them. */
struct joint;
/* Of P on PATTERN, both borrowed, PLACE[dof] a dof's index in it; *OUT is NULL where it would not
 * pay: inputs are not few, or matrices periodic.  Fails with MODAL_NO_MEMORY. */
enum modal_status joint_new(const struct program *p, const int *place,
                            const struct pattern *pattern, struct joint **out,
                            struct modal_error *err);
/* Frees J; NULL is none. */
void joint_free(struct joint *j);
/* False once it was found that it does not serve. */
bool joint_serves(const struct joint *j);

struct by_inputs;
/* A derivative of harmonics 0 .. HJ; without SLOPES each law is the spring that it was in
 * the first derivative of all.  J is borrowed.  Fails
 * with MODAL_NO_MEMORY. */
enum modal_status by_inputs_new(struct joint *j, int HJ, bool slopes, struct by_inputs **out,
                                struct modal_error *err);
/* Frees S; NULL is none. */
void by_inputs_free(struct by_inputs *s);
/* The HJ it was made for. */
int by_inputs_harmonics(const struct by_inputs *s);
/* The laws' slopes of the last force of W, of harmonics 0 .. HJ. */
enum modal_status by_inputs_set(struct by_inputs *s, struct aft *w, struct modal_error *err);
/* The same added into blocks INTO. */
void by_inputs_add(const struct by_inputs *s, const struct aft_target *into);
/*
 * y <- (S + slopes)^-1 y, y the real vector of aft.h, until no more than LEFT of it is left; S as
 * condense_at gives it at OMEGA.  False where it does not come there: y is lost, and after some
 * such failures, or where nothing can be made of the structure, joint_serves is false.
 */
bool by_inputs_solve(struct by_inputs *s, const double complex *S, double omega, double left,
                     double *y);
/* Operations (budget.h, scattered) so far, what is shared included. */
double by_inputs_work(const struct by_inputs *s);
#endif
