/* torus.h - a motion of several tones: its combinations, and its samples on hyper-time
 *
 * With tones w_1 .. w_d, d = 1, 2 or 3, of no common period, and combinations k = (k_1, .., k_d),
 *
 *     x(t) = Re sum_k X_k e^{i Omega_k t},   Omega_k = k . w,   X_0 real,                       (1)
 *
 * each k told with the sign that makes Omega_k > 0 (where tones have a period after all and Omega_k
 * is 0: the first number of k that is not 0).  x is a function of d phases, 2 pi periodic in
 * each.  One tone, the fastest, leads: along
 *
 *    theta in [0, 2 pi),  theta_lead = theta,  theta_j = phi_j + nu_j theta,  nu_j = w_j / w_lead
 *    (2)
 *
 * with phi fixed the phases go as time does, t = theta / w_lead: a line is a stretch of the motion
 * itself.  Lines stand at even phi, samples at even theta.  The shear of (2) is a phase of each
 * harmonic in phi, so that transforms stay fast and lose nothing.
 */
#ifndef MODAL_TORUS_H
#define MODAL_TORUS_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

enum { TORUS_TONES_MOST = 3 };      /* samples grow as a power of them */

struct torus_tones {
    int count, lead;
    double omega[TORUS_TONES_MOST], nu[TORUS_TONES_MOST];   /* rad/s; (2), nu of the lead is 1 */
};

struct torus_index { int k[TORUS_TONES_MOST]; };            /* 0 past the tones */

/* COUNT tones at OMEGA, each > 0. */
struct torus_tones torus_tones_of(const double *omega, int count);
/* Tone J at OMEGA from now on; who leads stays. */
void torus_tones_move(struct torus_tones *t, int j, double omega);
/* Omega_k, rad/s. */
double torus_frequency(const struct torus_tones *t, struct torus_index k);
/* rad/s: what Omega_k may be off by where tones that have a period are off it by rounding. */
double torus_rounding(const struct torus_tones *t, struct torus_index k);
/* |k_1| + .. + |k_d|. */
int torus_order(struct torus_index k);
bool torus_equal(struct torus_index a, struct torus_index b);
/* Whether K has the sign that (1) tells it with; 0 has. */
bool torus_told(const struct torus_tones *t, struct torus_index k);
/* K with that sign; *FLIPPED: it had the other. */
struct torus_index torus_signed(const struct torus_tones *t, struct torus_index k, bool *flipped);

struct torus_grid;
/* N samples a line, and LINES[j] lines along tone j (of the lead: 1).  Fails with
 * MODAL_NO_MEMORY. */
enum modal_status torus_grid_new(const struct torus_tones *t, int N, const int *lines,
                                 struct torus_grid **out, struct modal_error *err);
/* NULL is accepted. */
void torus_grid_free(struct torus_grid *g);
/* G under T, tones moved since: of as many, led by the same. */
void torus_grid_retune(struct torus_grid *g, const struct torus_tones *t);
int torus_grid_samples(const struct torus_grid *g);         /* N */
int torus_grid_lines(const struct torus_grid *g);           /* in all */
/* phi_j of line LINE, 0 for the lead. */
double torus_grid_phase(const struct torus_grid *g, int line, int j);
/* All combinations that it holds, as (1) tells them, into OUT, room for as many as the grid has
 * points; how many. */
int torus_grid_indices(const struct torus_grid *g, struct torus_index *out);

/*
 * x[line N + n] of (1), COUNT combinations INDEX with coefficients X.
 */
void torus_synthesize(struct torus_grid *g, int count, const struct torus_index *index,
                      const double complex *X, double *x);
/* Motion and rate at once, in one transform, TURN turns of theta later, on the lines' own
 * continuations: x of (1) and v of its d/dt. */
void torus_synthesize_both(struct torus_grid *g, int count, const struct torus_index *index,
                           const double complex *X, int turn, double *x, double *v);
/* The two-sided means <x e^{-i k . theta}> of samples x; torus_coefficient reads them. */
void torus_analyze(struct torus_grid *g, const double *x);
/* Of the last torus_analyze, combination K of either sign, taken modulo the grid. */
double complex torus_coefficient(const struct torus_grid *g, struct torus_index k);
#endif
