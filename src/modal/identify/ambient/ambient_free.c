/*
 * ambient_free.c - two accounts of one record, by their likelihoods
 *
 * Of N samples of one signal, n exponentials that leave white noise of variance e have the
 * logarithm of the likelihood -N/2 ln e, and cost ln(N)/2 for each of 2 n numbers, exponents and
 * amplitudes; a line of constant amplitude costs three.  The other account is that of
 * stationary.h.  BIC takes the greater.  They are far apart: of what noise drives through a
 * resonance each sample is told by those before to far less than is left of the record by a few
 * vibrations of constant decay, whose amplitudes and phases the noise changes; of a free response
 * these leave its noise, and the spectrum stands above that over all the width of each peak.
 */
#include "modal/identify/ambient/ambient_free.h"
#include <complex.h>
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include "modal/identify/ambient/whittle.h"
#include "modal/identify/fit/stationary.h"
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/linear/pencil.h"
#include "modal/identify/prepare/pod.h"

enum {
    MOST = 32,                           /* vibrations: of a free response with more these are left
                                          * with the weakest, still far less than it is noise */
    FEW = 8                              /* of the longest record, and of others as many as cost no
                                          * more, rows times their square; beyond these an eighth
                                          * more each time */
};
static const double FLOOR = 1e-300;      /* of a multiplier: zero to rounding */

/* What N rows, the strongest signal without its lines, are as noise. */
static enum modal_status as_noise(const struct ambient_free_input *in, const struct pod *pod,
                                  double *likelihood, struct modal_error *err)
{
    int N = in->Y->m;
    double *x = malloc(sizeof *x * (size_t)N);
    enum modal_status rc;

    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d samples", N);
    cblas_dgemv(CblasColMajor, CblasNoTrans, N, in->less->n, 1, in->less->x, in->less->ld,
                pod->modes.x, 1, 0, x, 1);
    rc = stationary_likelihood(x, N, likelihood, err);
    *likelihood -= 1.5 * in->count * log(N);
    free(x);
    return rc;
}

/* What is left of the strongest signal X by N vibrations of the pencil: its norm. */
static enum modal_status as_free(const struct pencil *p, int n, const struct matrix *x,
                                 double step, double *rest, struct modal_error *err)
{
    double complex rho[2 * MOST], lambda[2 * MOST];
    struct synthesis f = { 0 };
    enum modal_status rc = pencil_multipliers(p, 2 * n, rho, err);
    int poles = rc == MODAL_OK ? poles_of_multipliers(rho, 2 * n, step, FLOOR, lambda, NULL) : 0;

    if (poles > 0)
        rc = synthesis_fit(lambda, poles, step, x, NULL, &f, err);
    *rest = rc == MODAL_OK && poles > 0 ? f.residual : HUGE_VAL;
    synthesis_done(&f);
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}

enum modal_status ambient_free(const struct ambient_free_input *in, int *motions, double *left,
                               struct modal_error *err)
{
    struct pod pod = { 0 };
    struct pencil p = { 0 };
    struct pod_options how = { .most = WHITTLE_CHANNELS_MOST };
    struct matrix x;
    double noise = 0, rest, N = in->Y->m;
    int most = (int)fmin(MOST, FEW * sqrt(AMBIENT_FREE_ROWS / N));
    enum modal_status rc = pod_reduce(in->Y, &how, &pod, err);

    *motions = 0;
    if (rc != MODAL_OK || pod.count == 0)
        goto out;
    x = pod.signals;
    x.n = 1;
    rc = as_noise(in, &pod, &noise, err);
    if (rc == MODAL_OK)
        rc = pencil_new(&pod.signals, &(struct pencil_options) { .wanted = 2 * most }, &p, err);
    for (int n = 1; rc == MODAL_OK && *motions == 0 && n <= most && 2 * n <= p.count;
         n += 1 + n / FEW) {
        rc = as_free(&p, n, &x, in->step, &rest, err);
        /* 4 numbers a vibration */
        if (rc == MODAL_OK && -N * log(rest / sqrt(N)) - 2 * n * log(N) > noise)
            *motions = n, *left = rest / pod.s[0];
    }
out:
    pencil_done(&p);
    pod_done(&pod);
    return rc;
}
