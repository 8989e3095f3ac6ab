/*
 * bound.c - the information of the samples that are there
 *
 * At each phase of a period (one of a constant system) channel c has the model Phi B_c + U_c h, U_c
 * its steps, in white noise of size s_c.  With J_c, the derivatives of Phi B_c by the poles' parts,
 * and P the projection onto what Phi leaves of the rows that are there, the information of steps
 * and poles, amplitudes being unknown, is
 *
 *     G_c = sum over phases [U_c J_c]' P [U_c J_c] / s_c^2,                                     (1)
 *
 * and that of the poles F = sum_c (G_JJ - G_JU G_UU^-1 G_UJ); the bounds are the diagonal of F^-1.
 * Both F, with and without what is lacking, rest on the same J and s.
 */
#include "modal/identify/prepare/bound.h"
#include <lapacke.h>
#include <math.h>
#include <string.h>
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/linear/powers.h"
#include "modal/linalg/svd.h"
#include "modal/linalg/workspace.h"

struct sums {
    const double complex *lambda; int count;
    double tau;
    int shift;                   /* phases */
    int L, order, most;          /* rows of each; most columns of A */
    const struct synthesis *fit;
    double *phi;                 /* L x order */
    double *A, *reflectors;      /* [Phi U J], L x most */
    double *G;                   /* most x most, upper triangle */
    bool *out;                   /* L */
};

/* The derivatives of column C by each pole's real and imaginary part; of a real pole's second, and
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

/* Rows of channel C at phase K that are wild, into s->out; how many. */
static int rows_out(const struct sums *s, const struct wild *w, int c, int k)
{
    int count = 0;

    memset(s->out, 0, sizeof *s->out * (size_t)s->L);
    for (int i = 0; i < w->count; i++)
        if (w->at[i].channel == c && w->at[i].row % s->shift == k
            && w->at[i].row / s->shift < s->L)
            s->out[w->at[i].row / s->shift] = true, count++;
    return count;
}

/* The columns of A for channel C at phase K. */
static int put_columns(const struct sums *s, int c, int k, const struct steps *steps)
{
    int columns = s->order;
    size_t L = (size_t)s->L;

    memcpy(s->A, s->phi, sizeof *s->A * L * (size_t)s->order);
    for (int i = 0; i < steps->count; i++)
        if (steps->at[i].channel == c) {
            double *u = s->A + L * (size_t)columns++;
            for (int l = 0; l < s->L; l++)
                u[l] = k + l * s->shift >= steps->at[i].row;
        }
    put_derivatives(s, c * s->shift + k, s->A + L * (size_t)columns);
    return columns + 2 * s->count;
}

/* (1) of channel C at phase K onto G, but for the noise. */
static enum modal_status add_phase(const struct sums *s, int c, int k, const struct wild *wild,
                                   const struct steps *steps, struct modal_error *err)
{
    int columns = put_columns(s, c, k, steps), first = s->order, n = columns - first;
    size_t L = (size_t)s->L;

    if (rows_out(s, wild, c, k) > 0)
        for (int j = 0; j < columns; j++)
            for (int l = 0; l < s->L; l++)
                s->A[(size_t)l + L * (size_t)j] *= !s->out[l];
    if (LAPACKE_dgeqrf(LAPACK_COL_MAJOR, s->L, columns, s->A, s->L, s->reflectors) != 0)
        return modal_fail(err, MODAL_NO_MEMORY, "bound: no memory for %d columns", columns);
    for (int j = 0; j < n; j++)
        for (int i = 0; i <= j; i++)
            for (int r = first; r <= first + i && r < s->L; r++)
                s->G[i + (size_t)j * (size_t)n] += s->A[(size_t)r + L * (size_t)(first + i)]
                                                 * s->A[(size_t)r + L * (size_t)(first + j)];
    return MODAL_OK;
}

/* The first COUNT of the n unknowns of G, upper triangle, are eliminated. */
static void eliminate(double *G, int n, int count)
{
    for (int k = 0; k < count; k++)
        for (int j = k + 1; j < n && G[k + (size_t)k * (size_t)n] > 0; j++)
            for (int i = k + 1; i <= j; i++)
                G[i + (size_t)j * (size_t)n] -= G[k + (size_t)i * (size_t)n]
                    * G[k + (size_t)j * (size_t)n] / G[k + (size_t)k * (size_t)n];
}

/* Channel C, of size s2, onto F: of the rows that are not WILD, with its STEPS. */
static enum modal_status add_channel(const struct sums *s, int c, double s2,
                                     const struct wild *wild, const struct steps *steps, double *F,
                                     struct modal_error *err)
{
    int n = 2 * s->count, fitted = 0;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < steps->count; i++)
        fitted += steps->at[i].channel == c;
    memset(s->G, 0, sizeof *s->G * (size_t)s->most * (size_t)s->most);
    for (int k = 0; k < s->shift && rc == MODAL_OK; k++)
        rc = add_phase(s, c, k, wild, steps, err);
    eliminate(s->G, fitted + n, fitted);
    for (int j = 0; j < n; j++)
        for (int i = 0; i <= j; i++)
            F[i + (size_t)j * (size_t)n] +=
                s->G[fitted + i + (size_t)(fitted + j) * (size_t)(fitted + n)] / s2;
    return rc;
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

/* Samples of channel C that are wild. */
static int lost_of(const struct wild *w, int c)
{
    int count = 0;

    for (int i = 0; i < w->count; i++)
        count += w->at[i].channel == c;
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
static enum modal_status add_channels(const struct sums *s, const struct wild *wild,
                                      const struct steps *steps, double *const F[2], double *part,
                                      struct modal_error *err)
{
    static const struct wild none = { 0 };
    static const struct steps still = { 0 };
    size_t N = 4 * (size_t)s->count * (size_t)s->count;
    enum modal_status rc = MODAL_OK;

    for (int c = 0; c < s->fit->channels / s->shift && rc == MODAL_OK; c++) {
        int lost = lost_of(wild, c);
        double free_rows = fmax(((double)s->L - s->order) * s->shift - lost, 1),
               left = safe_norm(s->fit->channel_residual + (size_t)c * (size_t)s->shift,
                                (size_t)s->shift), s2 = left * left / free_rows;
        if (!(s2 > 0))
            continue;
        memset(part, 0, sizeof *part * N);
        rc = add_channel(s, c, s2, &none, &still, part, err);
        for (size_t i = 0; i < N; i++)
            F[0][i] += part[i];
        if (rc == MODAL_OK && (lost > 0 || has_step(steps, c))) {
            memset(part, 0, sizeof *part * N);
            rc = add_channel(s, c, s2, wild, steps, part, err);
        }
        for (size_t i = 0; i < N; i++)
            F[1][i] += part[i];
    }
    return rc;
}

static enum modal_status make_sums(struct sums *s, const struct steps *steps,
                                   struct workspace *space, struct modal_error *err)
{
    s->most = s->order + steps->count + 2 * s->count;
    s->phi = workspace_room(space, (size_t)s->L * (size_t)s->order, sizeof *s->phi);
    s->A = workspace_room(space, (size_t)s->L * (size_t)s->most, sizeof *s->A);
    s->reflectors = workspace_numbers(space, (size_t)s->most, 1);
    s->G = workspace_numbers(space, (size_t)s->most, (size_t)s->most);
    s->out = workspace_zeros(space, (size_t)s->L, sizeof *s->out);
    for (int j = 0, column = 0; j < s->count && !space->failed; j++) {
        powers_of(pole_kind(s->lambda[j], s->tau), creal(s->lambda[j]) * s->tau,
                  cimag(s->lambda[j]) * s->tau, s->L, s->phi + (size_t)s->L * (size_t)column,
                  s->L);
        column += pole_order(s->lambda[j], s->tau);
    }
    return workspace_check(space, "bound: no memory", err);
}

enum modal_status bound_factors(const struct rebuild_model *poles, const struct matrix *Y,
                                const struct wild *wild, const struct steps *steps, double *factor,
                                struct modal_error *err)
{
    size_t n = 2 * (size_t)poles->count;
    struct workspace space = { 0 };
    struct synthesis fit = { 0 };
    struct sums s = { .lambda = poles->lambda, .count = poles->count, .tau = poles->tau,
                      .shift = poles->shift, .L = Y->m / poles->shift, .fit = &fit,
                      .order = poles_order(poles->lambda, poles->count, poles->tau) };
    double *F[2] = { workspace_numbers(&space, n, n), workspace_numbers(&space, n, n) },
           *part = workspace_numbers(&space, n, n), *whole = workspace_numbers(&space, n, 1),
           *lacking = workspace_numbers(&space, n, 1);
    enum modal_status rc = make_sums(&s, steps, &space, err);

    for (size_t j = 0; j < n; j++)
        factor[j] = 1;
    if (rc == MODAL_OK && n > 0 && s.order < s.L)
        rc = rebuild_record(poles, Y, NULL, &fit, err);
    if (rc == MODAL_OK && fit.channels > 0)
        rc = add_channels(&s, wild, steps, F, part, err);
    if (rc == MODAL_OK && fit.channels > 0 && invert(F[0], (int)n, whole)
        && invert(F[1], (int)n, lacking))
        for (size_t j = 0; j < n; j++)
            factor[j] = lacking[j] > whole[j] ? sqrt(lacking[j] / whole[j]) : 1;
    synthesis_done(&fit);
    workspace_free(&space);
    return rc;
}
