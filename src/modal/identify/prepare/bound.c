/*
 * bound.c - the information of the samples that are there
 *
 * Channel c has the model Phi B_c + U_c h, U_c its steps, in white noise of size s_c.  With the
 * columns [Phi U_c J_c] of the rows that are there, J_c being the derivatives of Phi B_c by the
 * poles' parts, the information of those parts, amplitudes and steps being unknown, is
 *
 *     F = sum_c R_c'R_c / s_c^2,                                                               (1)
 *
 * R_c being the last block of the triangle of [Phi U_c J_c] = Q R; the bounds are the diagonal of
 * F^-1. Both F, with and without what is lacking, rest on the same J and s.
 */
#include "modal/identify/prepare/bound.h"
#include <lapacke.h>
#include <math.h>
#include <string.h>
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/linear/powers.h"
#include "modal/linalg/workspace.h"

struct sums {
    const double complex *lambda; int count;
    double tau;
    int L, order, most;          /* most columns of A */
    const struct synthesis *fit;
    double *phi;                 /* L x order */
    double *A, *reflectors;      /* [Phi U J], L x most */
};

/* The derivatives of channel C by each pole's real and imaginary part; of a real pole's second, and
 * of a pole at zero, none: 0. */
static void put_derivatives(const struct sums *s, int c, double *J)
{
    size_t L = (size_t)s->L;
    int column = 0;

    for (int j = 0; j < s->count; j++) {
        bool pair = pole_kind(s->lambda[j], s->tau) == POLE_PAIR;
        double complex b = s->fit->coefficient[j + (size_t)c * (size_t)s->count];
        double centre = powers_centre(creal(s->lambda[j]) * s->tau, s->L),
               *re = J + (size_t)(2 * j) * L, *im = re + L;
        const double *x = s->phi + (size_t)column * L, *y = x + L;
        for (int l = 0; l < s->L; l++) {
            double t = s->lambda[j] == 0 ? 0 : l - centre;
            /* Re B (x - i y), x and y the real and minus imaginary part of the powers */
            re[l] = t * (creal(b) * x[l] + (pair ? cimag(b) * y[l] : 0));
            im[l] = pair ? t * (creal(b) * y[l] - cimag(b) * x[l]) : 0;
        }
        column += pair ? 2 : 1;
    }
}

/* (1) of channel C, of size s2, onto F: of the rows that are not OUT (NULL: all), with its STEPS
 * (NULL: none). */
static enum modal_status add_channel(struct sums *s, int c, double s2, const bool *out,
                                     const struct steps *steps, double *F, struct modal_error *err)
{
    int n = 2 * s->count, columns = s->order, first;
    size_t L = (size_t)s->L;

    memcpy(s->A, s->phi, sizeof *s->A * L * (size_t)s->order);
    for (int i = 0; steps != NULL && i < steps->count; i++)
        if (steps->at[i].channel == c) {
            double *u = s->A + L * (size_t)columns++;
            for (int l = 0; l < s->L; l++)
                u[l] = l >= steps->at[i].row;
        }
    first = columns, columns += n;
    put_derivatives(s, c, s->A + L * (size_t)first);
    for (int j = 0; out != NULL && j < columns; j++)
        for (int l = 0; l < s->L; l++)
            s->A[(size_t)l + L * (size_t)j] *= !out[l];
    if (LAPACKE_dgeqrf(LAPACK_COL_MAJOR, s->L, columns, s->A, s->L, s->reflectors) != 0)
        return modal_fail(err, MODAL_NO_MEMORY, "bound: no memory for %d columns", columns);
    for (int j = 0; j < n; j++)
        for (int i = 0; i <= j; i++)
            for (int k = 0; k <= i; k++)
                F[i + (size_t)j * (size_t)n] += s->A[(size_t)(first + k) + L * (size_t)(first + i)]
                                              * s->A[(size_t)(first + k) + L * (size_t)(first + j)]
                                              / s2;
    return MODAL_OK;
}

/* The diagonal of F^-1, 0 for parameters that are none; false: F is singular. */
static bool invert(double *F, int n, double *diagonal)
{
    size_t N = (size_t)n;

    for (int j = 0; j < n; j++)
        diagonal[j] = F[(size_t)j * (N + 1)] > 0 ? 1 / sqrt(F[(size_t)j * (N + 1)]) : 0;
    for (int j = 0; j < n; j++)
        for (int i = 0; i <= j; i++)
            F[(size_t)i + (size_t)j * N] = i == j ? 1
                : F[(size_t)i + (size_t)j * N] * diagonal[i] * diagonal[j];
    if (LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'U', n, F, n) != 0
        || LAPACKE_dpotri_work(LAPACK_COL_MAJOR, 'U', n, F, n) != 0)
        return false;
    for (int j = 0; j < n; j++)
        diagonal[j] *= diagonal[j] * F[(size_t)j * (N + 1)];
    return true;
}

/* Rows of channel C that are wild, into OUT; how many. */
static int rows_out(const struct wild *w, int c, int L, bool *out)
{
    int count = 0;

    memset(out, 0, sizeof *out * (size_t)L);
    for (int i = 0; i < w->count; i++)
        if (w->at[i].channel == c && w->at[i].row < L)
            out[w->at[i].row] = true, count++;
    return count;
}

static bool has_step(const struct steps *s, int c)
{
    for (int i = 0; i < s->count; i++)
        if (s->at[i].channel == c)
            return true;
    return false;
}

/* Both F. A channel that lacks nothing adds the same to either. */
static enum modal_status add_channels(struct sums *s, const struct wild *wild,
                                      const struct steps *steps, bool *out, double *const F[2],
                                      double *part, struct modal_error *err)
{
    size_t N = 4 * (size_t)s->count * (size_t)s->count;
    enum modal_status rc = MODAL_OK;

    for (int c = 0; c < s->fit->channels && rc == MODAL_OK; c++) {
        int lost = rows_out(wild, c, s->L, out);
        double free_rows = fmax(s->L - s->order - lost, 1),
               s2 = pow(s->fit->channel_residual[c], 2) / free_rows;
        if (!(s2 > 0))
            continue;
        memset(part, 0, sizeof *part * N);
        rc = add_channel(s, c, s2, NULL, NULL, part, err);
        for (size_t i = 0; i < N; i++)
            F[0][i] += part[i];
        if (rc == MODAL_OK && (lost > 0 || has_step(steps, c))) {
            memset(part, 0, sizeof *part * N);
            rc = add_channel(s, c, s2, out, steps, part, err);
        }
        for (size_t i = 0; i < N; i++)
            F[1][i] += part[i];
    }
    return rc;
}

static enum modal_status make_sums(struct sums *s, const struct steps *steps, int columns,
                                   struct workspace *space, struct modal_error *err)
{
    s->most = s->order + steps->count + columns;
    s->phi = workspace_room(space, (size_t)s->L * (size_t)s->order, sizeof *s->phi);
    s->A = workspace_room(space, (size_t)s->L * (size_t)s->most, sizeof *s->A);
    s->reflectors = workspace_numbers(space, (size_t)s->most, 1);
    for (int j = 0, column = 0; j < s->count && !space->failed; j++) {
        powers_of(pole_kind(s->lambda[j], s->tau), creal(s->lambda[j]) * s->tau,
                  cimag(s->lambda[j]) * s->tau, s->L, s->phi + (size_t)s->L * (size_t)column,
                  s->L);
        column += pole_order(s->lambda[j], s->tau);
    }
    return workspace_check(space, "bound: no memory", err);
}

enum modal_status bound_factors(const double complex *lambda, int count, double tau,
                                const struct matrix *Y, const struct wild *wild,
                                const struct steps *steps, double *factor, struct modal_error *err)
{
    size_t n = 2 * (size_t)count;
    struct workspace space = { 0 };
    struct synthesis fit = { 0 };
    struct sums s = { .lambda = lambda, .count = count, .tau = tau, .L = Y->m,
                      .order = poles_order(lambda, count, tau), .fit = &fit };
    double *F[2] = { workspace_numbers(&space, n, n), workspace_numbers(&space, n, n) },
           *part = workspace_numbers(&space, n, n), *whole = workspace_numbers(&space, n, 1),
           *lacking = workspace_numbers(&space, n, 1);
    bool *out = workspace_zeros(&space, (size_t)Y->m, sizeof *out);
    enum modal_status rc = make_sums(&s, steps, (int)n, &space, err);

    for (size_t j = 0; j < n; j++)
        factor[j] = 1;
    if (rc == MODAL_OK && count > 0 && s.most < s.L)
        rc = synthesis_fit(lambda, count, tau, Y, NULL, &fit, err);
    if (rc == MODAL_OK && fit.channels > 0)
        rc = add_channels(&s, wild, steps, out, F, part, err);
    if (rc == MODAL_OK && fit.channels > 0 && invert(F[0], (int)n, whole)
        && invert(F[1], (int)n, lacking))
        for (size_t j = 0; j < n; j++)
            factor[j] = lacking[j] > whole[j] ? sqrt(lacking[j] / whole[j]) : 1;
    synthesis_done(&fit);
    workspace_free(&space);
    return rc;
}
