/* unheld.c - see unheld.h
 *
 * A mean that nothing holds is anywhere: a method's steps leave it where they went, thousands of
 * motions away at times, and there the motion has lost as many digits.
 */
#include "modal/steady/unheld.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/svd.h"
#include "modal/numbers.h"
#include "modal/steady/balance.h"
#include "modal/steady/graze.h"
#include "modal/steady/pattern.h"

/* Of the largest entry of each row what a derivative gives a motion that nothing holds: hundreds of
 * roundings, as OPEN of balance.c; and of the forces what balances (BALANCED of iterate.c). */
static const double UNHELD = 1e-13;
/* What rounding, which is another one elsewhere, may add to a residual of rounding. */
static const double AGAIN = 2;
/* Halvings of a way that a stop ends: a millionth of it is left. */
enum { HALVINGS = 20 };

static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a free mean");
}

void unheld_done(struct unheld *m)
{
    free(m->V.x);
    m->V.x = NULL;
}

bool unheld_any(const struct unheld *m) { return m->all || m->count > 0; }

/* The motions of harmonic 0 alone that the derivative of B, full, takes to nothing; it is made
 * again, its rows scaled as when it was factored last. */
static enum modal_status find_unheld(struct balance *b, struct unheld *m, struct modal_error *err)
{
    int q = b->q, n = 2 * b->HJ + 1;
    struct matrix A = matrix_new(q * n, q), U = matrix_new(q * n, q);
    double *s = malloc(((size_t)q + 1) * sizeof *s);
    enum modal_status rc = balance_derivative(b, err);

    m->V = matrix_new(q, q);
    if (rc == MODAL_OK && (A.x == NULL || U.x == NULL || s == NULL || m->V.x == NULL))
        rc = no_memory(err);
    for (int j = 0; rc == MODAL_OK && j < q; j++)
        for (int i = 0; i < q; i++)
            for (int r = 0; r < n; r++)
                A.x[(size_t)j * (size_t)A.ld + (size_t)(i * n + r)] =
                    balance_column(b, i, j, 0)[r] * b->row[i * n + r];
    if (rc == MODAL_OK)
        rc = svd_thin(&A, s, &U, &m->V, err);
    while (rc == MODAL_OK && m->count < q && s[q - 1 - m->count] <= UNHELD * fmax(1, s[0]))
        m->count++;
    free(A.x);
    free(U.x);
    free(s);
    return rc;
}

enum modal_status unheld_factor(struct balance *b, struct unheld *m, struct modal_error *err)
{
    int q = b->q, n = 2 * b->HJ + 1;
    enum modal_status rc;

    *m = (struct unheld) { .all = false };
    balance_factor(b, NULL);
    m->all = !b->pattern->full && b->factored && balance_open(b);
    if (!b->pattern->full || !balance_open(b))
        return MODAL_OK;
    rc = find_unheld(b, m, err);
    for (int d = q - m->count; rc == MODAL_OK && d < q; d++)
        for (int i = 0; i < q; i++)
            for (int j = 0; j < q; j++)
                balance_column(b, i, j, 0)[0] +=
                    m->V.x[d + i * q] * m->V.x[d + j * q] / b->row[i * n];
    if (rc == MODAL_OK)
        balance_factor(b, NULL);
    return rc;
}

void unheld_leave(const struct balance *b, const struct unheld *m, double *y)
{
    int q = b->q, n = 2 * b->H + 1;

    for (int d = q - m->count; d < q; d++) {
        double along = 0;

        for (int i = 0; i < q; i++)
            along += m->V.x[d + i * q] * y[i * n];
        for (int i = 0; i < q; i++)
            y[i * n] -= along * m->V.x[d + i * q];
    }
    for (int i = 0; m->all && i < q; i++)
        y[i * n] = 0;
}

enum modal_status unheld_ask(struct balance *b, bool *open, struct modal_error *err)
{
    struct unheld m;
    enum modal_status rc = balance_derivative(b, err);

    *open = false;
    if (rc != MODAL_OK)
        return rc;
    rc = unheld_factor(b, &m, err);
    *open = rc == MODAL_OK && unheld_any(&m);
    unheld_done(&m);
    return rc;
}

/* What of the means of X lies along M into WAY, b->q of them.  Of blocks the direction is what
 * their factors, singular to rounding, make of anything: its mean, for the rest is held. */
static void way_of(struct balance *b, const struct unheld *m, const double complex *X, double *y,
                   double *way)
{
    int q = b->q, n = 2 * b->H + 1, K = b->H + 1;
    double square = 0, along = 0;

    for (int i = 0; i < q; i++)
        y[i * n] = creal(X[i * K]);
    unheld_leave(b, m, y);
    for (int i = 0; i < q; i++)
        way[i] = creal(X[i * K]) - y[i * n];
    if (!m->all)
        return;
    memset(y, 0, (size_t)b->order * sizeof *y);
    for (int i = 0; i < q; i++)
        y[i * n] = i % 2 == 0 ? 1 : 2;                  /* normal to no left direction, likely */
    balance_solve(b, y);
    for (int i = 0; i < q; i++) {
        square += y[i * n] * y[i * n];
        along += y[i * n] * way[i];
    }
    for (int i = 0; i < q; i++)
        way[i] = square > 0 && isfinite(square) ? along / square * y[i * n] : 0;
}

/* The means of X are those of BEFORE less SHARE of WAY; its relative residual there into *NOW. */
static enum modal_status look_at(struct balance *b, const double complex *before, double share,
                                 const double *way, double complex *X, double *now,
                                 struct modal_error *err)
{
    int K = b->H + 1;
    enum modal_status rc;

    for (int i = 0; i < b->q; i++)
        X[i * K] = before[i * K] - share * way[i];
    rc = balance_residual(b, X, false, err);
    *now = rc == MODAL_OK ? balance_relative_residual(b, X) : HUGE_VAL;
    return rc;
}

/* How much of WAY is gone before X balances no more, to LOOSE; less than 1, and a swing of X less:
 * a stop ends it. */
static enum modal_status go(struct balance *b, const double complex *before, const double *way,
                            double loose, double complex *X, double *gone, struct modal_error *err)
{
    double step = 1, now, span = 0;
    enum modal_status rc = MODAL_OK;

    *gone = 0;
    for (int left = HALVINGS; rc == MODAL_OK && *gone < 1 && left > 0; left--, step /= 2) {
        rc = look_at(b, before, *gone + step, way, X, &now, err);
        *gone += rc == MODAL_OK && now <= loose ? step : 0;
    }
    for (int i = 0; i < b->q; i++) {
        double sum = 0;

        for (int k = 1; k <= b->H; k++)
            sum += cabs(X[i * (b->H + 1) + k]);
        span = fmax(span, sum);
    }
    if (*gone < 1)
        *gone = fmax(0, *gone - span / numbers_largest(way, (size_t)b->q));
    return rc;
}

/* Newton's method on X, its mean held, where digits that it had lost far off make *NOW more than
 * rounding: *NOW of what it comes to, HUGE_VAL of another motion. */
static enum modal_status sharpen(struct balance *b, const struct unheld *m,
                                 const struct iterate_options *opt, double *v, double complex *X,
                                 double *now, struct modal_error *err)
{
    bool converged;
    enum modal_status rc;

    if (m->count != 1 || *now <= UNHELD)
        return MODAL_OK;
    for (int i = 0; i < b->q; i++)
        v[i] = m->V.x[b->q - 1 + i * b->q];
    rc = graze_newton_held(b, opt, v, X, &converged, err);
    if (rc == MODAL_OK)
        rc = balance_residual(b, X, false, err);
    *now = rc == MODAL_OK && converged ? balance_relative_residual(b, X) : HUGE_VAL;
    return rc;
}

enum modal_status unheld_settle(struct balance *b, const struct unheld *m,
                                const struct iterate_options *opt, double complex *X,
                                double *residual, struct modal_error *err)
{
    size_t size = (size_t)b->q * ((size_t)b->H + 1);
    double *way = calloc((size_t)b->q + 1, sizeof *way),
           *y = calloc((size_t)b->order + 1, sizeof *y), gone = 0, now;
    double complex *before = calloc(size + 1, sizeof *before);
    /* far off rounding of the forces is no contact; the end is held to what it was */
    double most = AGAIN * fmax(*residual, UNHELD),
           loose = fmax(most, (2 * b->H + 1) * balance_lost(b, X));
    enum modal_status rc = way == NULL || y == NULL || before == NULL ? no_memory(err) : MODAL_OK;

    if (rc == MODAL_OK) {
        memcpy(before, X, size * sizeof *X);
        way_of(b, m, X, y, way);
    }
    if (rc == MODAL_OK && numbers_largest(way, (size_t)b->q) > 0)
        rc = go(b, before, way, loose, X, &gone, err);
    if (rc == MODAL_OK)
        rc = look_at(b, before, gone, way, X, &now, err);
    if (rc == MODAL_OK)
        rc = sharpen(b, m, opt, y, X, &now, err);
    if (rc == MODAL_OK && now <= most)
        *residual = now;
    else if (before != NULL) {
        memcpy(X, before, size * sizeof *X);
        rc = rc == MODAL_OK ? balance_residual(b, X, false, err) : rc;
    }
    free(way);
    free(y);
    free(before);
    return rc;
}
