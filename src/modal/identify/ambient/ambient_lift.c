/*
 * ambient_lift.c - a periodic system, period by period
 *
 * x' = A(t) x + B(t) u, y = C(t) x + v with one period T and white u and v, sampled p times a
 * period.  The vector Y_m of the p samples of all channels in period m obeys, with x_m at its
 * beginning,
 *
 *     x_(m+1) = F x_m + w_m,    Y_m = O x_m + e_m,                                              (1)
 *
 * w and e white: a constant system of as many states, whose multipliers are the periodic one's
 * [BC09].  Any combinations of Y_m are such a system too.  Of an eigenvector f of F at rho =
 * exp(lambda T), O f is what its mode does in one period: a(t) exp(lambda t) with a periodic a,
 * whose Fourier coefficients tell at which lambda + i k 2 pi / T it moves (harmonics.h).
 *
 * Where the speed wanders, rows at even angles are such a system if all that has a rate keeps to
 * the angle.  Frequencies that keep to time make F one of the length of each turn: see
 * ambient_wander.c.
 *
 * [BC09] Bittanti and Colaneri, Periodic Systems, Springer 2009, chapter 6.
 *
 * Tested by tests/unit/modal/identify/test_ambient_lift.c.
 */
#include "modal/identify/ambient/ambient_lift.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/answer/harmonics.h"

void ambient_lift_settle(struct matrix *Y, int phases)
{
    int periods = Y->m / phases;

    Y->m = periods * phases;
    for (int c = 0; c < Y->n; c++) {
        double *column = Y->x + (size_t)c * Y->ld, before = cblas_dnrm2(Y->m, column, 1);
        for (int k = 0; k < phases; k++) {
            double *y = column + k, mean = 0;
            for (int m = 0; m < periods; m++)
                mean += y[(size_t)m * phases] / periods;
            for (int m = 0; m < periods; m++)
                y[(size_t)m * phases] -= mean;
        }
        /* an orbit is known as well as the angle of its fastest harmonic, pi a sample */
        if (cblas_dnrm2(Y->m, column, 1) <= DBL_EPSILON * M_PI * Y->m * before)
            memset(column, 0, sizeof *column * (size_t)Y->m);
    }
}

enum modal_status ambient_lift(const struct matrix *Y, int rows, int phases, struct matrix *out,
                               struct modal_error *err)
{
    int periods = rows / phases;

    *out = matrix_new(periods, phases * Y->n);
    if (out->x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d x %d", rows, Y->n);
    for (int c = 0; c < Y->n; c++)
        for (int k = 0; k < phases; k++) {
            const double *y = Y->x + (size_t)c * Y->ld + k;
            double *x = out->x + (size_t)(k + phases * c) * out->ld;
            for (int m = 0; m < periods; m++)
                x[m] = y[(size_t)m * phases];
        }
    return MODAL_OK;
}

double complex ambient_lift_component(const double complex *b, int phases, double complex turn)
{
    double complex sum = 0;

    for (int k = 0; k < phases; k++)
        sum += b[k] * cexp(-turn * k / phases) / phases;
    return sum;
}

enum modal_status ambient_lift_resolve(const double complex *b, int phases, int channels,
                                       double period, struct identify_mode *m,
                                       struct modal_error *err)
{
    struct identify_harmonic list[HARMONICS_REPORTED];
    enum modal_status rc = harmonics_of(b, 1, phases, channels, m->exponent, period, list,
                                        &m->harmonic_count, &m->resolved_k, &m->runner_up, err);

    if (rc != MODAL_OK)
        return rc;
    m->harmonics = malloc(sizeof list);
    if (m->harmonics == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for harmonics");
    memcpy(m->harmonics, list, sizeof *list * (size_t)m->harmonic_count);
    m->resolved = m->exponent + CMPLX(0, m->resolved_k * 2 * M_PI / period);
    return MODAL_OK;
}
