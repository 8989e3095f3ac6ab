/* aft.h - the laws' forces, from harmonics to harmonics through time, with their derivative
 *
 * Unknowns are the harmonics of q retained dofs, X[i * (H+1) + k]; as a real vector each dof has 2H
 * + 1 entries, u[i * (2H+1) + r]: r = 0 the mean, r = 2k-1 Re X_k, r = 2k Im X_k. */
#ifndef MODAL_AFT_H
#define MODAL_AFT_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct program;

struct aft;

/*
 * A workspace for the laws of P (borrowed until aft_free) on H harmonics and N > 2 H samples.
 * PLACE[dof] is a dof's index among the q retained ones, -1 if it is not; every dof of a law is.
 * With LOCATED the events of laws that have pieces are found inside the samples, and their forces
 * are exact for the motion given; else all laws are sampled.
 */
enum modal_status aft_new(const struct program *p, const int *place, int q, int H, int N,
                          bool located, struct aft **out, struct modal_error *err);
/* Frees W and all that it made; NULL is none. */
void aft_free(struct aft *w);

/*
 * F[i*(H+1)+k], in N, of the motion X.  Fails with MODAL_ELEMENT_FAILED (a user's law) or
 * MODAL_NO_MEMORY; MODAL_OVERFLOW where X is not finite.
 */
enum modal_status aft_force(struct aft *w, double omega, const double complex *X, double complex *F,
                            struct modal_error *err);
/* The stiffest spring of the laws that are made of springs, N/m; 0: none is. */
double aft_stiffest(const struct aft *w);
/* From here on none of them is stiffer than MOST; HUGE_VAL: as they are.  Fails with
 * MODAL_NO_MEMORY. */
enum modal_status aft_soften(struct aft *w, double most, struct modal_error *err);
/* Derivatives from here on are of harmonics 0 .. HJ <= H alone, of order q (2 HJ + 1). */
void aft_set_order(struct aft *w, int HJ);
/* Where a derivative lies: column C of the block of retained dofs (i, j), 2 HJ + 1 rows. */
struct aft_target {
    double *(*column)(void *context, int i, int j, int c);
    void *context;
};
/* dF/du of the last aft_force, added once into INTO. */
enum modal_status aft_add_derivative(struct aft *w, const struct aft_target *into,
                                     struct modal_error *err);
/* The same as it is: VISIT is given, of each law, how the force of input I changes with the
 * displacement of input J, 2 HJ + 1 rows and columns, which is lost after. */
enum modal_status aft_each_slope(struct aft *w,
                                 void (*visit)(void *context, int law, int i, int j,
                                               const double *block),
                                 void *context, struct modal_error *err);

/* N. */
int aft_samples(const struct aft *w);
/* Discrete transforms made so far. */
long aft_transforms(const struct aft *w);
/* Turns of the laws' motions and events of their pieces in the last force: each is a root of a sum
 * of H terms. */
long aft_events(const struct aft *w);
/* Products of harmonics that were summed so far, (2) of aft_events.c. */
double aft_summed(const struct aft *w);
/* Of law LAW so far: one a sample, or N for the pieces of a period. */
long aft_evaluations(const struct aft *w, int law);
/* Whether law LAW slipped or touched in the last force. */
bool aft_acts(const struct aft *w, int law);
/* Whether what law LAW held in the last force is one of many: a slider that never slips. */
bool aft_undetermined(const struct aft *w, int law);
/* Largest slope of any law's force in the last one, N/m: the gain's numerator.  Of a user's law
 * they are made for this; one that fails meanwhile is left out, as it fails in the derivative as
 * well. */
double aft_slope(struct aft *w);

#endif
