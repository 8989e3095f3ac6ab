/*
 * graze.c - see graze.h
 *
 * A body that nothing else holds is pushed out of a stop by a force whose mean must vanish, and
 * which falls with the depth d as d^3/2: Newton's method leaves d / 3 at each step, and ends where
 * what is left is rounding, the stop met by a hair.  The derivative, which falls as d^1/2
 * alone, says that the mean is held, and multipliers by it that it is come back to, where it is one
 * of many: moved to the side away from the stop Newton's method leaves it there, free.
 */
#include "modal/steady/graze.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/matrix.h"
#include "modal/linalg/svd.h"
#include "modal/numbers.h"
#include "modal/steady/balance.h"
#include "modal/steady/iterate.h"
#include "modal/steady/pattern.h"
#include "modal/steady/stiffness.h"

/* Of the largest entry of each row what a derivative gives a motion that nothing holds: hundreds of
 * roundings, as OPEN of balance.c. */
static const double UNHELD = 1e-13;
/* What steps of rounding's size may move, as FLOOR of iterate.c. */
static const double SAME = 1e-9;

static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a mean");
}

/* Means that S_0 of B, full, takes to nothing beside what it or S_1 makes of other motions: the
 * last *COUNT rows of V. */
static enum modal_status find_loose(const struct balance *b, struct matrix *V, int *count,
                                    struct modal_error *err)
{
    int q = b->q;
    size_t entries = (size_t)q * (size_t)q;
    double none = UNHELD * numbers_modulus(b->S, b->H > 0 ? 2 * entries : entries), *s;
    struct matrix A, U;
    enum modal_status rc;

    *count = 0;
    if (q == 1 && fabs(creal(b->S[0])) > none)          /* most, and often asked */
        return MODAL_OK;
    A = matrix_new(q, q);
    U = matrix_new(q, q);
    s = malloc(((size_t)q + 1) * sizeof *s);
    rc = A.x == NULL || U.x == NULL || s == NULL
             ? no_memory(err) : MODAL_OK;
    for (size_t i = 0; rc == MODAL_OK && i < entries; i++)
        A.x[i] = creal(b->S[i]);
    if (rc == MODAL_OK)
        rc = svd_thin(&A, s, &U, V, err);
    while (rc == MODAL_OK && *count < q && s[q - 1 - *count] <= none)
        ++*count;
    free(A.x);
    free(U.x);
    free(s);
    return rc;
}

/* What B's derivative makes of the mean v[j * ld] into OUT, of the largest entry of each row. */
static void derivative_of(struct balance *b, const double *v, int ld, double *out)
{
    int q = b->q, n = 2 * b->HJ + 1;

    for (int i = 0; i < q; i++)
        for (int r = 0; r < n; r++) {
            double most = 0, sum = 0;

            for (int j = 0; j < q; j++) {
                for (int c = 0; c < n; c++)
                    most = fmax(most, fabs(balance_column(b, i, j, c)[r]));
                sum += balance_column(b, i, j, 0)[r] * v[j * ld];
            }
            out[i * n + r] = most > 0 ? sum / most : 0;
        }
}

/* Whether MOVED moves as X does but for its mean: a body that bounces on its stop may have a motion
 * free of it besides, which is another. */
static bool is_same(const struct balance *b, const double complex *X, const double complex *moved,
                    double span)
{
    int K = b->H + 1;
    double most = 0;

    for (int i = 0; i < b->q; i++)
        for (int k = 1; k < K; k++)
            most = fmax(most, cabs(X[i * K + k] - moved[i * K + k]));
    return most <= SAME * span;
}

/* S_0 takes V to rounding alone, and divided by itself that would take X back. */
enum modal_status graze_newton_held(struct balance *b, const struct iterate_options *opt,
                                    const double *v, double complex *X, bool *converged,
                                    struct modal_error *err)
{
    int q = b->q, K = b->H + 1;
    size_t entries = (size_t)q * (size_t)q;
    double stiff = numbers_modulus(b->S, b->H > 0 ? 2 * entries : entries), along = 0, unit = 0;
    double complex *own = malloc((entries + (size_t)q) * sizeof *own);
    struct iterate_report r = { 0 };
    enum modal_status rc;

    if (own == NULL)
        return no_memory(err);
    memcpy(own, b->S, entries * sizeof *own);
    memcpy(own + entries, b->load, (size_t)q * sizeof *own);
    for (int i = 0; i < q; i++) {
        along += v[i] * creal(X[i * K]);
        unit += v[i] * v[i];
    }
    for (int i = 0; i < q; i++) {
        for (int j = 0; j < q; j++)
            b->S[j * q + i] += stiff / unit * v[i] * v[j];
        b->load[i] += stiff / unit * v[i] * along;
    }
    stiffness_set(b->stiffness, b->S);
    rc = iterate_newton(b, opt, X, &r, err);
    memcpy(b->S, own, entries * sizeof *own);
    memcpy(b->load, own + entries, (size_t)q * sizeof *own);
    stiffness_set(b->stiffness, b->S);
    free(own);
    *converged = rc == MODAL_OK && r.converged;
    return rc;
}

/* X of B along the mean V by as much as it moves itself into MOVED, to a side where Newton's method
 * leaves the motion as it is and nothing holds V; *SLACK false: to neither.  OUT has room for
 * derivative_of. */
static enum modal_status move_off(struct balance *b, const struct iterate_options *opt,
                                  const double complex *X, const double *v, double complex *moved,
                                  double *out, bool *slack, struct modal_error *err)
{
    int q = b->q, K = b->H + 1;
    double span = 0, far = numbers_largest(v, (size_t)q);
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < q; i++) {
        double sum = 0;

        for (int k = 1; k < K; k++)
            sum += cabs(X[i * K + k]);
        span = fmax(span, sum);
    }
    *slack = false;
    for (int side = -1; rc == MODAL_OK && !*slack && span > 0 && side <= 1; side += 2) {
        bool converged;

        memcpy(moved, X, (size_t)q * (size_t)K * sizeof *X);
        for (int i = 0; i < q; i++)
            moved[i * K] += side * span / far * v[i];
        rc = graze_newton_held(b, opt, v, moved, &converged, err);
        if (rc != MODAL_OK || !converged || !is_same(b, X, moved, span))
            continue;
        rc = balance_residual(b, moved, true, err);
        if (rc == MODAL_OK)
            derivative_of(b, v, 1, out);
        *slack = rc == MODAL_OK && numbers_largest(out, (size_t)b->order) <= UNHELD;
    }
    return rc;
}

enum modal_status graze_leave(struct balance *b, const struct iterate_options *opt,
                              double complex *X, struct modal_error *err)
{
    int q = b->q, count = 0;
    struct matrix V, A = { 0 }, U = { 0 }, W = { 0 };
    size_t size = (size_t)q * ((size_t)b->H + 1);
    double complex *moved = NULL;
    double *s = NULL;
    bool slack;
    enum modal_status rc;

    if (!b->pattern->full)
        return MODAL_OK;
    V = matrix_new(q, q);
    rc = V.x == NULL ? no_memory(err) : find_loose(b, &V, &count, err);
    if (rc == MODAL_OK && count > 0) {
        A = matrix_new(b->order, count);
        U = matrix_new(b->order, count);
        W = matrix_new(count, count);
        s = calloc((size_t)count + (size_t)q + (size_t)b->order, sizeof *s);
        moved = malloc((size + 1) * sizeof *moved);
        rc = A.x == NULL || U.x == NULL || W.x == NULL || s == NULL || moved == NULL
                 ? no_memory(err) : balance_derivative(b, err);
        for (int d = 0; rc == MODAL_OK && d < count; d++)
            derivative_of(b, V.x + (q - count + d), q, A.x + (size_t)d * (size_t)b->order);
        if (rc == MODAL_OK)
            rc = svd_thin(&A, s, &U, &W, err);
    }
    for (int d = count - 1; rc == MODAL_OK && d >= 0; d--) {
        double *v = s + count;

        for (int j = 0; j < q; j++) {
            v[j] = 0;
            for (int e = 0; e < count; e++)
                v[j] += W.x[d + e * count] * V.x[q - count + e + j * q];
        }
        if (s[d] <= UNHELD)
            continue;                                   /* it is off all already */
        rc = move_off(b, opt, X, v, moved, v + q, &slack, err);
        if (rc == MODAL_OK && slack)
            memcpy(X, moved, size * sizeof *X);
    }
    if (rc == MODAL_OK && count > 0)
        rc = balance_residual(b, X, false, err);
    free(V.x);
    free(A.x);
    free(U.x);
    free(W.x);
    free(s);
    free(moved);
    return rc;
}
