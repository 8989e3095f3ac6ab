/* torus_laws.h - the laws' forces on hyper-time, from combinations to combinations
 *
 * A law is evaluated at the samples of torus.h's lines.  Where its regime changes between two
 * samples the instant is located, and the sum over samples is corrected to the integral; a law
 * with memory comes from so many turns before that what it holds no longer depends on where it
 * began.
 */
#ifndef MODAL_TORUS_LAWS_H
#define MODAL_TORUS_LAWS_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/steady/torus.h"

struct budget;
struct program;

struct torus_laws;

/*
 * Of P's laws (borrowed); PLACE[dof] is a dof's index among the q that iterate.  Fails with
 * MODAL_BAD_INPUT, field "tones", for a law whose force is not a function of a path: rigid
 * friction, and a user's law, which keeps a time and a memory of its own.  MODAL_NO_MEMORY.
 */
enum modal_status torus_laws_new(const struct program *p, const struct torus_tones *t,
                                 const int *place, int q, struct budget *work,
                                 struct torus_laws **out, struct modal_error *err);
/* NULL is accepted. */
void torus_laws_free(struct torus_laws *w);
/* W under T, tones moved since. */
void torus_laws_retune(struct torus_laws *w, const struct torus_tones *t);

/*
 * The forces of the motion X[i count + m] of combinations INDEX, on grid G, which is overwritten:
 * F[i wanted + m] of combinations AT (Omega_k > 0, and 0), in N.  MODAL_OVERFLOW where X is not
 * finite; MODAL_NO_MEMORY.
 */
enum modal_status torus_forces(struct torus_laws *w, struct torus_grid *g, int count,
                               const struct torus_index *index, const double complex *X, int wanted,
                               const struct torus_index *at, double complex *F,
                               struct modal_error *err);

/*
 * J += dF/du of the last torus_forces, on the same grid, of the first CORE combinations of INDEX:
 * u of a dof is (X_0, Re X_1, Im X_1, ..), order q (2 CORE - 1), by columns.  What a slider
 * remembers is held, and events stay where they are: exact for laws without memory but for the
 * corrections.
 */
void torus_derivative(const struct torus_laws *w, struct torus_grid *g, int core,
                      const struct torus_index *index, double *J);
/* K += df/dd and C += df/dv of the last torus_forces, their means over the torus, q x q by columns:
 * what a combination has of itself in that derivative. */
void torus_mean_slopes(const struct torus_laws *w, double *K, double *C);

/* While HELD, forces take as many turns of history as those before: for motions beside theirs. */
void torus_hold(struct torus_laws *w, bool held);
/* Of law LAW: evaluations so far; whether it slipped or touched in the last forces; whether what it
 * held is one of many. */
long torus_evaluations(const struct torus_laws *w, int law);
/* What the last forces' events cost for each combination asked for, in budget.h's units. */
double torus_events_work(const struct torus_laws *w);
bool torus_acts(const struct torus_laws *w, int law);
bool torus_undetermined(const struct torus_laws *w, int law);
/* Law LAW was asked EVALUATIONS times more, beside samples, and acted or not: a slider that did not
 * holds one of many places. */
void torus_note(struct torus_laws *w, int law, bool acts, long evaluations);
/* Whether all laws are analytic: then only aliasing is an error of samples. */
bool torus_smooth(const struct torus_laws *w);
#endif
