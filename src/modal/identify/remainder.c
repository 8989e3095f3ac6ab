/*
 * remainder.c - poles in what a fit leaves
 *
 * A pencil of the signals sees first what is strong: modes near the edge of the noise, or that
 * share a direction with strong neighbours, may be missing from its poles. What a refined fit
 * leaves has the strong ones taken out to their bound, so the same pencil sees the next ones as
 * the strongest. A peak test tells whether there is a reason to look.
 */
#include "modal/identify/remainder.h"
#include "modal/identify/exponents.h"
#include "modal/identify/pencil.h"
#include "modal/identify/powers.h"
#include "modal/linalg/qr.h"
#include <cblas.h>
#include <fftw3.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { ROWS_LEAST = 16 };        /* of the periodograms */
static const double ROUNDING = 1e-12;      /* of a signal: what is left is rounding (widen.c) */

/* E -= Phi C, pole by pole: basis has two columns. */
static void subtract(const struct refine_data *data, const struct refined *fit, const double *C,
                     int ld, double *basis, struct matrix *E)
{
    for (int j = 0, i = 0; j < fit->poles; j++) {
        enum pole_kind kind = pole_kind(fit->lambda[j], data->tau);
        int n = kind == POLE_PAIR ? 2 : 1;
        powers_of(kind, creal(fit->lambda[j]) * data->tau, cimag(fit->lambda[j]) * data->tau, E->m,
                  basis, E->m);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, E->m, E->n, n, -1, basis, E->m,
                    C + i, ld, 1, E->x, E->ld);
        i += n;
    }
}

enum modal_status remainder_of(const struct refine_data *data, const struct refined *fit,
                               struct matrix *E, struct modal_error *err)
{
    int L = data->Y->m, S = data->Y->n, phases = data->phases > 0 ? data->phases : 1;
    double *basis = malloc(2 * (size_t)L * sizeof *basis),
        *x = malloc((size_t)L * (size_t)S * sizeof *x);
    struct projected p = { 0 };
    enum modal_status rc = refine_project(data, fit->lambda, fit->poles, NULL, &p, err);

    if (rc == MODAL_OK && (basis == NULL || x == NULL))
        rc = modal_fail(err, MODAL_NO_MEMORY, "remainder: no memory for %d x %d", L, S);
    if (rc != MODAL_OK || p.degenerate)
        goto out;
    for (int c = 0; c < S; c++)
        memcpy(x + (size_t)c * (size_t)L, data->Y->x + (size_t)c * (size_t)data->Y->ld,
               (size_t)L * sizeof *x);
    *E = (struct matrix) { L, S, L, x };
    x = NULL;
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, p.order, S, 1,
                p.R, p.order, p.Z, p.order);
    subtract(data, fit, p.Z, p.order, basis, E);
    for (int c = 0; c < S; c++) {
        int g = c / phases;
        double noise = fit->noise[g], rms = sqrt(p.energy[g] / ((double)L * phases));
        double parts = rms > 0 ? cblas_dnrm2(p.order, p.Z + (size_t)c * (size_t)p.order,
                                             1) / rms : 1;
        bool seen = noise > fmax(parts, 1) * sqrt(p.lowest[g]) && noise > ROUNDING * rms;
        cblas_dscal(L, seen ? 1 / noise : 0, E->x + (size_t)c * (size_t)L, 1);
    }
out:
    projected_done(&p);
    free(basis), free(x);
    return rc;
}

/* The largest ordinate of the first N rows. */
static double peak_of(const struct matrix *E, int n, double *x, fftw_complex *X, double *power)
{
    fftw_plan plan = fftw_plan_dft_r2c_1d(n, x, X, FFTW_ESTIMATE);
    double most = 0;

    if (plan == NULL)
        return 0;
    memset(power, 0, ((size_t)n / 2 + 1) * sizeof *power);
    for (int c = 0; c < E->n; c++) {
        memcpy(x, E->x + (size_t)c * (size_t)E->ld, (size_t)n * sizeof *x);
        fftw_execute(plan);
        for (int k = 0; k <= n / 2; k++) {
            double half = k == 0 || 2 * k == n ? 0.5 : 1;
            power[k] += half * (creal(X[k]) * creal(X[k]) + cimag(X[k]) * cimag(X[k])) / n;
        }
    }
    for (int k = 0; k <= n / 2; k++)
        most = fmax(most, power[k]);
    fftw_destroy_plan(plan);
    return most;
}

enum modal_status remainder_peak(const struct matrix *E, double *chi2, struct modal_error *err)
{
    int most = transform_length(E->m);
    double *x = fftw_alloc_real((size_t)most), *power = fftw_alloc_real((size_t)most / 2 + 1);
    fftw_complex *X = fftw_alloc_complex((size_t)most / 2 + 1);
    enum modal_status rc = MODAL_OK;

    *chi2 = 0;
    if (x == NULL || X == NULL || power == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "remainder: no memory for a transform of %d", most);
    for (int n = E->m; rc == MODAL_OK && n >= ROWS_LEAST; n /= 2) {
        int fast = transform_length(n);
        *chi2 = fmax(*chi2, 2 * peak_of(E, fast <= E->m ? fast : n, x, X, power));
    }
    fftw_free(x), fftw_free(X), fftw_free(power);
    return rc;
}

enum modal_status remainder_poles(const struct matrix *E, double tau, int most,
                                  double complex *lambda, int *count, struct modal_error *err)
{
    struct pencil p;
    double complex *rho;
    int r;
    enum modal_status rc = pencil_new(E, &(struct pencil_options) { .wanted = most }, &p, err);

    *count = 0;
    if (rc != MODAL_OK)
        return rc;
    r = pencil_signals(&p);
    r = r < 2 ? 2 : r;
    r = r < p.count ? r : p.count;
    rho = malloc(((size_t)r + 1) * sizeof *rho);
    if (rho == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "remainder: no memory for order %d", r);
    else if (r > 0 && (rc = pencil_multipliers(&p, r, rho, err)) == MODAL_OK)
        *count = poles_of_multipliers(rho, r, tau, 1e-300, lambda, NULL);
    if (rc == MODAL_NO_CONVERGENCE)
        rc = MODAL_OK;
    free(rho);
    pencil_done(&p);
    return rc;
}

enum modal_status remainder_split(const struct matrix *E, double tau, double complex lambda,
                                  double *chi2, struct modal_error *err)
{
    size_t L = (size_t)E->m, S = (size_t)E->n;
    double *x = malloc((6 * L + 2 * S) * sizeof *x), *gain = x + 6 * L, a = creal(lambda) * tau;
    double centre = a == 0 ? 0.5 * L : a > 0 ? L - fmin(0.5 * L, 1 / a) : fmin(0.5 * L, -1 / a),
        width = centre < 0.5 * L ? centre : L - centre;
    struct matrix V = { E->m, 6, E->m, x }, none = { 0 };
    enum modal_status rc;

    *chi2 = 0;
    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "remainder: no memory for %d rows", E->m);
    powers_of(POLE_PAIR, a, cimag(lambda) * tau, E->m, x, E->m);
    for (size_t c = 2; c < 6; c++)
        for (size_t l = 0; l < L; l++)
            x[l + c * L] = x[l + (c - 2) * L] * ((double)l - centre) / fmax(width, 1);
    rc = E->m >= 6 ? qr_orthonormal(&V, &none, err) : MODAL_OK;
    if (rc == MODAL_OK && E->m >= 6) {
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, 2, E->n, E->m, 1, x + 4 * L, E->m,
                    E->x, E->ld, 0, gain, 2);
        *chi2 = cblas_ddot(2 * E->n, gain, 1, gain, 1);
    }
    free(x);
    return rc;
}
