/* modes.h - from poles to modes: amplitudes, shapes, harmonics, offset, reconstruction */
#ifndef MODAL_MODES_H
#define MODAL_MODES_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/prepare/record.h"
#include "modal/identify/result.h"
#include "modal/linalg/workspace.h"

/* The poles of the record, tau = shift * step apart, as the order was chosen. */
struct poles {
    int count;
    double complex *lambda;
    double *std_re, *std_im;      /* 1/s; NAN: unknown */
    double *bar;                  /* on the multiplier over tau; NAN: unknown */
    double *angle;                /* residual; NAN: unknown */
    enum growth *growth;
    int shift;
    double tau;
    bool refined;                 /* standard deviations are from the Jacobian */
    bool tied;                    /* lines of a multiplier have one exponent (refine.h, omega) */
    struct synthesis *fit;  /* of all channels, where it is known already (taken over); else NULL */
    struct workspace space;       /* of the arrays */
};

/*
 * Fill what RESULT says of modes, offset, reconstruction: everything of a mode but persistence.
 * POLES are over `shift` samples of REC. Three kinds of system: constant (rec->period 0); periodic
 * with a whole number of samples (shift = rec->per_period); periodic without (shift 1: poles that
 * differ by multiples of i Omega are one mode).  Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status modes_report(const struct record *rec, const struct poles *poles,
                               const struct identify_options *opt, struct identify_result *result,
                               struct modal_error *err);

/* Modal phase collinearity of a shape: 1 where all components lie on one line in the complex plane
 * [PEL93]. */
double modes_mpc(const double complex *shape, int count);

/* Shape m->shape, COUNT >= 1 components, over its largest; m->mpc. */
void modes_scale_shape(struct identify_mode *m, int count);

/* m->std_re and std_im, 1/s, at least rounding of a record of so many seconds; from them the other
 * standard deviations, those of the multiplier over SPAN seconds. */
void modes_spread_std(struct identify_mode *m, double span, double record);

/* The energy of each mode, as its share of the sum of squared amplitudes; the strongest first. */
void modes_rank(struct identify_result *result);

/* The mode nearest to an exponent, within its own decay rate; -1: none. */
int modes_nearest(const struct identify_result *result, double complex lambda);
#endif
