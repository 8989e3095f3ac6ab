/* whittle.h - maximum likelihood of modes from the spectral matrix of what they answer to noise */
#ifndef MODAL_WHITTLE_H
#define MODAL_WHITTLE_H
#include <stdbool.h>
#include "modal/identify/ambient/spectrum.h"

enum {
    WHITTLE_CHANNELS_MOST = 12,     /* after their reduction: each line takes their cube */
    WHITTLE_MODES_MOST = 60         /* of one spectrum: each step takes their cube */
};

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

/* What bin B should hold by M, whose covariances are V: channels x channels by columns */
void whittle_spectrum(const struct whittle *m, const struct whittle_covariances *v,
                      const struct bins *bins, int b, double complex *S);

/* BINS as they would show in the middle of each by M: seen[]. */
void whittle_correct(const struct whittle *m, struct bins *bins);

/* The logarithm of the likelihood at M of what is seen; -HUGE_VAL where it is none. */
double whittle_likelihood(const struct whittle *m, const struct bins *bins);

/*
 * Climb from M, by what is seen, until a step gains less than `gain` in the logarithm of the
 * likelihood, many steps like the last would not reach `needed`, `most` steps are done or no work
 * is left.  errors: the standard errors, too, from the information matrix; of what converged.
 * Fails with MODAL_NO_MEMORY, MODAL_CANCELLED.
 */
struct whittle_limits {
    double gain, needed;             /* needed: of the logarithm of the likelihood; -HUGE_VAL */
    int most;
    bool errors;
    double *work;                    /* what is left of it: bins times unknowns squared a step */
    bool (*cancelled)(void *context);
    void *context;
};
/* *M is where the climb from it ended, by those LIMITS. */
enum modal_status whittle_fit(struct whittle *m, const struct bins *bins,
                              const struct whittle_limits *limits, struct modal_error *err);
#endif
