/*
 * ragged.c - see ragged.h; tested by tests/unit/modal/identify/test_ragged.c
 *
 * The Fourier coefficients of exponentials rho_j^k, k = 0 .. L-1, at lines z_m = e^{i 2 pi m / L}
 * are rational: F_m = sum_j c_j (1 - rho_j^L) / (1 - rho_j / z_m). Of neighbouring lines, even and
 * odd, the Loewner matrix
 *
 *     A_{mn} = (F_m - F_n) / (2 sin(pi (m - n) / L)),    m even, n odd,                         (1)
 *
 * has the rank of its poles: those among the lines, and few for all that are far away [AA86]. (The
 * divided difference has z_m - z_n below; that differs by factors of size 1 of rows and columns.)
 * Several signals have the same poles, and their matrices one beside the other the same rank. Of
 * BINS lines, with POLES about them whose columns P projects on, and E made by (1) of white noise,
 *
 *     sum_{k > POLES} s_k(A)^2 <= |(1 - P) A|^2 = |(1 - P) E|^2                                 (2)
 *
 * for no matrix of that rank is nearer to A than its own leading part. Two rows of E have a sum
 * of 1 / ((x - n)(y - n)) over half odd n in common, which vanishes for whole x and y far from the
 * ends: (2) has the mean (1 - POLES / HALF) sum 2 variance / (2 sin)^2. It is a quadratic form of
 * the noise with a mean of about HALF - POLES times its largest eigenvalue or more, and exceeds T
 * times that mean with less than e^{-(HALF - POLES) (T - 1 - ln T)}: 0.8 % where T is TIMES. So K
 * places that exceed T_k have between them the evidence
 *
 *     sum_k (HALF - POLES) (T_k - 1 - ln T_k) - ln (PLACES over K),                             (3)
 *
 * and noise reaches CHANCE once in e^CHANCE records (by this bound; it hardly reaches its mean in
 * fact). What noise drives is another number at each line, and keeps all but a share of its energy
 * in (2).  A place needs the least number of poles, POLES or more, with which (2) is below TIMES.
 *
 * The variance is the median over all lines, of |F|^2 exponentially distributed: many modes raise
 * that, and it errs for the free response. There is no end of poles where what stands out of the
 * noise needs more than CROWD of them in places that need more than POLES: nearer than four lines
 * from one to the next, which few records of so many modes resolve. A response is held for driven
 * where those places have most of the energy (SHARE); else free modes may stand out of what is
 * driven. A narrow mode is a few lines to its place, which poles draw.
 *
 * [AA86] Antoulas and Anderson, IMA J. Math. Control Inf. 3 (1986) 61-88.
 */
#include <fftw3.h>       /* before complex.h, which makes its numbers the compiler's */
#include "modal/identify/prepare/ragged.h"
#include <complex.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/prepare/record.h"
#include "modal/numbers.h"

enum {
    BINS = 64,                  /* lines of a place */
    HALF = BINS / 2,            /* even and odd ones: rows and columns of (1) */
    POLES = BINS / 4,           /* that may be among them */
    PLACES = 16,                /* those of most energy are looked at */
    CROWD = 3 * POLES           /* poles that are no set of modes */
};
static const double
    TIMES = 2,                  /* of the noise that is expected */
    CHANCE = 11.5,              /* one in 100,000 */
    ABOVE = 10,                 /* times the noise: a place of less says nothing */
    SHARE = 0.5;                /* of the energy in places above that: most of it */

struct lines {
    int count, signals, samples;
    double complex *F;          /* count x signals, over the deviation of the noise */
    double *energy;             /* of each place */
};

static void lines_done(struct lines *s)
{
    free(s->F), free(s->energy);
}

/* The lines F over their noise, which is no less than their rounding; sorted in P.  False: there
 * are none. */
static bool over_noise(double complex *F, int count, double *p)
{
    const double ROUNDINGS = 16;
    double all = 0, noise;

    for (int m = 0; m < count; m++)
        all += p[m] = numbers_square(F[m]);
    numbers_sort(p, (size_t)count);
    noise = sqrt(fmax(p[count / 2] / M_LN2, all * pow(ROUNDINGS * DBL_EPSILON, 2)));
    for (int m = 0; m < count; m++)
        F[m] = noise > 0 ? F[m] / noise : 0;
    return noise > 0;
}

/* The lines strictly between 0 and the Nyquist frequency. */
static enum modal_status read_lines(const struct matrix *Y, struct lines *s,
                                    struct modal_error *err)
{
    /* the first: what has no end has none in any */
    int L = Y->m, wanted = Y->n < RECORD_FEW ? Y->n : RECORD_FEW;
    double *x = fftw_alloc_real((size_t)L + 2);
    fftw_complex *X = fftw_alloc_complex((size_t)L / 2 + 1);
    fftw_plan plan = x != NULL && X != NULL ? fftw_plan_dft_r2c_1d(L, x, X, FFTW_ESTIMATE) : NULL;

    s->samples = L, s->count = (L - 1) / 2;
    s->F = malloc((size_t)s->count * (size_t)wanted * sizeof *s->F);
    s->energy = calloc((size_t)(s->count / BINS) + 1, sizeof *s->energy);
    for (int c = 0; plan != NULL && s->F != NULL && c < wanted; c++) {
        double complex *F = s->F + (size_t)s->signals * s->count;
        memcpy(x, Y->x + (size_t)c * Y->ld, (size_t)L * sizeof *x);
        fftw_execute(plan);
        for (int m = 0; m < s->count; m++)
            F[m] = CMPLX(X[m + 1][0], X[m + 1][1]);
        s->signals += over_noise(F, s->count, x);
    }
    if (plan != NULL)
        fftw_destroy_plan(plan);
    fftw_free(x), fftw_free(X);
    return plan != NULL && s->F != NULL && s->energy != NULL
         ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "ragged: no memory for %d samples", L);
}

/* What (1) from line FIRST on has after POLES, over what noise has, and the poles that it needs. */
static enum modal_status raggedness(const struct lines *s, int first, double *ratio, int *poles,
                                    struct modal_error *err)
{
    double complex A[HALF * HALF * RECORD_FEW];
    double value[HALF], work[HALF], noise = 0, rest = 0;

    for (int c = 0; c < s->signals; c++)
        for (int n = 0; n < HALF; n++)
            for (int m = 0; m < HALF; m++) {
                const double complex *F = s->F + (size_t)c * s->count + first;
                double d = 2 * sin(M_PI * (2 * (m - n) - 1) / s->samples);
                A[m + (n + c * HALF) * HALF] = (F[2 * m] - F[2 * n + 1]) / d;
                noise += 2 / (d * d);
            }
    if (LAPACKE_zgesvd(LAPACK_COL_MAJOR, 'N', 'N', HALF, HALF * s->signals, A, HALF, value, NULL, 1,
                       NULL, 1, work) != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "ragged: no singular values of %d lines",
                          BINS);
    *poles = POLES;
    for (int k = HALF - 1; k >= POLES; k--) {
        double expected = (1 - k / (double)HALF) * noise;
        rest += value[k] * value[k];
        if (*poles == POLES && rest > TIMES * expected)
            *poles = k + 1;
        *ratio = rest / expected;
    }
    return MODAL_OK;
}

/* The place of most energy, of COUNT. */
static int strongest(const struct lines *s, int count)
{
    int at = 0;

    for (int i = 1; i < count; i++)
        at = s->energy[i] > s->energy[at] ? i : at;
    return at;
}

static enum modal_status judge(const struct lines *s, struct ragged *out, struct modal_error *err)
{
    int count = s->count / BINS, found = 0, poles = 0, needs;
    double all = 0, driven = 0, evidence = 0, ratio;
    enum modal_status rc = MODAL_OK;

    for (int c = 0; c < s->signals; c++)
        for (int m = 0; m < count * BINS; m++)
            s->energy[m / BINS] += numbers_square(s->F[m + (size_t)c * s->count]);
    for (int looked = 0; looked < PLACES && rc == MODAL_OK; looked++) {
        int at = strongest(s, count);
        double energy = s->energy[at];
        if (!(energy > ABOVE * BINS * s->signals))
            break;
        rc = raggedness(s, at * BINS, &ratio, &needs, err);
        all += energy, s->energy[at] = 0;
        if (rc != MODAL_OK || needs == POLES)
            continue;
        driven += energy, poles += needs, found++;
        /* (3) */
        evidence += (HALF - POLES) * (ratio - 1 - log(ratio))
                  - log((PLACES + 1 - found) / (double)found);
    }
    out->endless = poles > CROWD && evidence > CHANCE;
    out->driven = out->endless && driven > SHARE * all;
    return rc;
}

enum modal_status ragged_spectrum(const struct matrix *Y, struct ragged *out,
                                  struct modal_error *err)
{
    struct lines s = { 0 };
    enum modal_status rc;

    *out = (struct ragged) { 0 };
    if (Y->m < 2 * (CROWD / HALF + 1) * BINS)         /* places for more than CROWD */
        return MODAL_OK;
    rc = read_lines(Y, &s, err);
    if (rc == MODAL_OK)
        rc = judge(&s, out, err);
    lines_done(&s);
    return rc;
}
