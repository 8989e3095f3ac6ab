/* orbit.h - one periodic motion d(theta), theta = omega t: its harmonics, its samples, and where it
 * turns and crosses
 *
 *     d(theta) = Re sum_{k=0..H} D_k e^{i k theta},  D_0 real                                  (1)
 *
 * Rates here are per radian of theta.  Samples only show where to look: turns and crossings are
 * polished on (1) itself.
 */
#ifndef MODAL_ORBIT_H
#define MODAL_ORBIT_H
#include <complex.h>
#include "base/error.h"

enum {
    ORBIT_HARMONICS_MOST = 8192,     /* impacts fall as k^-2: to 1e-8 there */
    ORBIT_SAMPLES_MOST = 1 << 20,    /* of one signal: 8 MB */
};

/* Transforms between H harmonics and N samples, N > 2 H; made once for a size. */
struct orbit_grid;
/* Fails with MODAL_NO_MEMORY. */
enum modal_status orbit_grid_new(int N, struct orbit_grid **out, struct modal_error *err);
/* The same for orbit_synthesize and what calls it alone: half of the plans, which cost more than a
 * hundred transforms. */
enum modal_status orbit_grid_to_time(int N, struct orbit_grid **out, struct modal_error *err);
/* NULL is accepted. */
void orbit_grid_free(struct orbit_grid *g);
/* x[0..N-1] of harmonics X[0..H], and of their rate, each derivative factor i k. */
void orbit_synthesize(struct orbit_grid *g, int H, const double complex *X, int derivative,
                      double *x);
/* The largest of these samples, which stay in x, of harmonics X[0..H]. */
double orbit_peak(struct orbit_grid *g, int H, const double complex *X, double *x);
/* X[0..H] of samples x, c_0 = 1, c_k = 2: (1)'s scaling. */
void orbit_analyze(struct orbit_grid *g, const double *x, int H, double complex *X);
/* The two-sided G_m = (1/N) sum_j x_j e^{-i m theta_j}, m = 0 .. M, any M: of period N in m. */
void orbit_analyze_gain(struct orbit_grid *g, const double *x, int M, double complex *G);
long orbit_grid_transforms(const struct orbit_grid *g);      /* so far */

struct orbit {
    int H, N, top;              /* D is 0 past `top` <= H */
    double omega;               /* rad/s */
    double complex *D;          /* H + 1 */
    double *d, *v;              /* N each: (1) and its rate per radian at 2 pi j / N */
    int turns;                  /* -1: not yet looked for */
    struct orbit_turn *turn;
    int turns_room;  /* of `turn` */
};

/* A strict extremum of d, polished; ascending theta in [0, 2 pi), maxima and minima in turn. */
struct orbit_turn { double theta, d; };

/* Zero harmonics D of H + 1, room for N samples.  Fails with MODAL_NO_MEMORY; orbit_done
 * frees. */
enum modal_status orbit_init(struct orbit *o, int H, int N, struct modal_error *err);
/* O's arrays; O itself is the caller's and becomes zeros. */
void orbit_done(struct orbit *o);
/* Samples, and `top`, from the harmonics o->D, which the caller has set. */
void orbit_sample(struct orbit *o, struct orbit_grid *g, double omega);
/* a x + b y, of one size, into O. */
void orbit_combine(struct orbit *o, double a, const struct orbit *x, double b,
                   const struct orbit *y);

/* (1), its rate and the rate of that at THETA. */
void orbit_at(const struct orbit *o, double theta, double out[3]);
/* Fill o->turn. */
enum modal_status orbit_find_turns(struct orbit *o, struct modal_error *err);
struct orbit_end { double theta, d, v; };                    /* a known instant: v per radian */
/* turn i of this period, i - turns of the next */
struct orbit_end orbit_turn_end(const struct orbit *o, int i);
/* The theta between two ends, from before to, where d passes LEVEL; d is monotone there and
 * LEVEL within its ends. */
double orbit_crossing(const struct orbit *o, struct orbit_end from, struct orbit_end to,
                      double level);
/* All crossings of LEVEL, ascending in [0, 2 pi), into theta (room MOST); their number, or -1 if
 * there are more. */
int orbit_crossings(const struct orbit *o, double level, double *theta, int most);
/* The theta in (from, to) where the rate passes LEVEL, the rate - LEVEL differing in sign at the
 * ends. */
double orbit_rate_crossing(const struct orbit *o, double from, double to, double level);

#endif
