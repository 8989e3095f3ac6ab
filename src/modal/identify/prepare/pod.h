/* pod.h - proper orthogonal modes: many channels reduced to few signals */
#ifndef MODAL_POD_H
#define MODAL_POD_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/* More channels than this are reduced unasked. */
#define POD_CHANNELS_FEW 8
/* Channels whose noise differs by more are weighed by it before; less than this of their rms is
 * rounding, not noise. */
#define NOISE_ALIKE 1.3
#define NOISE_QUIETEST 1e-13

/* At most so many orthogonal signals are kept unasked. */
#define POD_SIGNALS_MOST 40

struct pod_options {
    double energy;   /* keep sum_{i<=r} s_i >= energy * sum; 0: everything above rounding, at most
                      * `most` */
    int rank;        /* keep exactly so many (or all there are); 0: by energy */
    int most;        /* signals at most; 0: 40 */
    const double *weight;   /* per channel, that its column is multiplied by; NULL: 1 */
};

struct pod {
    struct matrix signals;   /* L x r, column i = s_i v_i (23), in the units of Y; owned */
    struct matrix modes;   /* S x r, orthonormal columns u_i: Y = signals * modes^T + rest; owned */
    double *s; int count;    /* r singular values; owned */
    double energy;           /* kept share of sum s (as far as computed: an upper bound where
                              * Lanczos stopped early) */
};

/* (1) of pod.c: what no singular value of L x S white noise passes whose sum of squares is REST. */
double pod_edge(double L, double S, double rest);

/* Y: L x S, kept; signals and modes are those of its weighed columns. */
enum modal_status pod_reduce(const struct matrix *Y, const struct pod_options *opt, struct pod *out,
                             struct modal_error *err);
void pod_done(struct pod *p);
#endif
