/* whittle.h - maximum likelihood of modes from the spectral matrix of what they answer to noise */
#ifndef MODAL_WHITTLE_H
#define MODAL_WHITTLE_H
#include <stdbool.h>
#include "modal/identify/ambient/spectrum.h"

enum {
    WHITTLE_CHANNELS_MOST = 12,     /* after their reduction: each line takes their cube */
    WHITTLE_MODES_MOST = 120        /* of one spectrum */
};

/* Over the record: what decays less is a line, whatever it is. */
#define WHITTLE_DECAY_LEAST 0.1

/* Of Levenberg and Marquardt, in the scale of the information's diagonal: how a climb begins, as
 * good as none, and where no step gains: at the summit, to rounding. */
#define WHITTLE_DAMPING_FIRST 1e-3
#define WHITTLE_DAMPING_LEAST 1e-12
#define WHITTLE_DAMPING_MOST 1e8

/* One pair of the model (1) of whittle.c. */
struct whittle_mode {
    double complex lambda;                          /* a sample; Re < 0 */
    double complex phi[WHITTLE_CHANNELS_MOST];      /* its shape */
    double complex kappa[WHITTLE_CHANNELS_MOST];    /* how the innovations drive it */
    double std_decay, std_turn;                     /* of -Re and Im lambda; NAN: unknown */
};

struct whittle {
    int channels, count;
    struct whittle_mode mode[WHITTLE_MODES_MOST];
    double root[WHITTLE_CHANNELS_MOST * WHITTLE_CHANNELS_MOST];   /* lower triangle: M */
    double likelihood;                              /* its logarithm, but for a constant */
    int steps;
    bool converged;
};

/* The number of unknowns of the model, and of one mode. */
int whittle_unknowns(const struct whittle *m);
int whittle_unknowns_of_mode(int channels);

/* The exponent a sample of the system whose record of SAMPLES shows mode Q: its turn positive. */
double complex whittle_exponent(const struct whittle_mode *q, int samples);

/* What (3) of whittle.c makes of a model: R_0, G, and each mode's row of P C^H, with which its part
 * of R_0 is phi row^T + its conjugate. */
struct whittle_covariances {
    double zero[WHITTLE_CHANNELS_MOST * WHITTLE_CHANNELS_MOST];
    double complex g[WHITTLE_MODES_MOST][WHITTLE_CHANNELS_MOST];
    double complex row[WHITTLE_MODES_MOST][WHITTLE_CHANNELS_MOST];
};
/* *OUT: that of M. */
void whittle_covariances(const struct whittle *m, struct whittle_covariances *out);

/* What a likelihood takes in all bins, by a model of so many channels and modes: as long as so many
 * entries of J take (scoring.h). */
double whittle_work(const struct whittle *m, const struct bins *bins);

/* What bin B should hold by M, whose covariances are V: channels x channels by columns */
void whittle_spectrum(const struct whittle *m, const struct whittle_covariances *v,
                      const struct bins *bins, int b, double complex *S);

/* BINS as they would show in the middle of each by M: seen[]. */
void whittle_correct(const struct whittle *m, struct bins *bins);

/* The logarithm of the likelihood at M of what is seen; -HUGE_VAL where it is none. */
double whittle_likelihood(const struct whittle *m, const struct bins *bins);

/* exp(lambda) of each mode of M: they take as long as the rest of a bin, and are those of all. */
void whittle_poles(const struct whittle *m, double complex *poles);

/* f of (1) at e^{iw}, and its derivative by lambda. */
struct whittle_peak { double complex f, slope; };
/* Those of a POLE at z. */
struct whittle_peak whittle_peak(double complex pole, double complex z);

/* The middle of bin B, rad a sample. */
double whittle_middle(const struct bins *bins, int b);

/* At e^{iw}, side by side, each channels x channels by columns: 1, H R, H and H M of (1). */
enum { WHITTLE_UNITS, WHITTLE_HR, WHITTLE_H, WHITTLE_HM, WHITTLE_TRANSFERS };
/* V: room for them all; poles: whittle_poles(). */
void whittle_transfers(const struct whittle *m, const double complex *poles, double w,
                       double complex *V);

/* C of S = C C^H in the middle of bin B, and E = C^-1 I C^-H - 1 of what is seen there; the
 * logarithm of det S, NAN where S is not positive. */
double whittle_residual(const struct whittle *m, const double complex *poles,
                        const struct bins *bins, int b, double complex *C, double complex *E);
#endif
