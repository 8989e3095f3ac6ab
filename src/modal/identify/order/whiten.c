/*
 * whiten.c - autoregression from sample to sample
 *
 * A fit of the columns of a period as if their noise were white has errors above the bound, and
 * bars below its errors, where the noise is correlated from sample to sample: its amplitudes C are
 * the best still, but
 *
 *     F = tr P Y W Y^T,   W = 1,                                                            (1)
 *
 * is the likelihood of white noise only; of rows with covariance V it is that of W = V^-1, that is
 * of Y V^-1/2. V has more entries than there are samples, but noise does not know the period: that
 * of sample k, predicted by the m before it,
 *
 *     e_k = sum_{j=1..m} a_j e_{k-j} + u_k,                                                 (2)
 *
 * leaves u white, with the same a for all k. The first samples of a period are predicted by the
 * last of the one before: (2) goes through the whole signal, and what a multiplier makes of each
 * sample from period to period it makes of (2) as well. Only the first m samples of the record have
 * none. They are left out, periods begin after them, and what is left at the end of the last is
 * less than one. (First samples by predictions of lower order, period by period, would be larger
 * than all others where the signal is smooth, correlated with the period before, and trusted most.)
 * The a of all orders up to `most` come from one QR of E's columns beside each other, shifted; the
 * order by Bayes' criterion.
 *
 * Before any fit E is not known, and what is left of directions that are drawn from noise taken for
 * white tells of too little. But the filter e_k = a e_{k-1} + u_k keeps the volume of the samples,
 * and so -2 ln(likelihood) of the periods Y, L x S after it, as r directions and white noise,
 *
 *     min_r  L S ln(sum_{i > r} s_i^2) + price(r),                                          (3)
 *
 * of singular values s, is comparable from one a to another. Noise alone gives a direction after r
 * others (sqrt(L - r) + sqrt(S - r))^2 of the (L - r)(S - r) that are left at most, for which
 * price(r) pays. With fewer columns than WIDE times L a few directions over them hold what
 * correlation there is at every r, and nothing is asked. (A price of all r (L + S - r) unknowns
 * tells that from noise, and tells multipliers in white noise away.)
 *
 * Of N numbers a is known to sqrt((1 - a^2) / N). It has to be found so well: signals are of low
 * frequencies, where noise with a = 0.9 that is filtered by 0.875 has 1.25 times the deviation that
 * its variance shows.
 */
#include "modal/identify/order/whiten.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/criterion.h"
#include "modal/identify/order/remainder.h"
#include "modal/linalg/eigen.h"
#include "modal/linalg/qr.h"

enum {
    ORDER_MOST = 8,                 /* of (2): four peaks of a spectrum */
    SIDE = ORDER_MOST + 1,
    WIDE = 2                        /* chosen: at L = S (3) fails, from 2 L on it did not */
};

/* (2) of all orders up to `most`: triangle of the shifted columns, 1 .. most samples before, then
 * the sample itself. */
struct prediction {
    int most, order;                /* order chosen; 0: white */
    double T[SIDE * SIDE];
    double gain;                    /* of -2 ln(likelihood), beside the price */
};

/* Sum of squares of u for order M. */
static double left(const struct prediction *a, int m)
{
    const double *t = a->T + (size_t)a->most * (size_t)(a->most + 1);

    return cblas_ddot(a->most + 1 - m, t + m, 1, t + m, 1);
}

/* Of a signal's columns E, each of L rows, where SHARE of them are free. */
static enum modal_status predict(const double *e, int L, int phases, double share,
                                 struct prediction *a, struct modal_error *err)
{
    int most = phases / 2 < ORDER_MOST ? phases / 2 : ORDER_MOST;
    size_t rows = (size_t)(phases - most) * (size_t)L;
    struct matrix A = { (int)rows, most + 1, (int)rows, NULL },
                  T = { most + 1, most + 1, most + 1, a->T };
    double n = share * (double)rows;
    enum modal_status rc = MODAL_OK;

    *a = (struct prediction) { .most = most };
    if (most < 1 || n < SIDE * SIDE || (A.x = malloc(rows * SIDE * sizeof *A.x)) == NULL)
        return most < 1 || n < SIDE * SIDE
                   ? MODAL_OK
                   : modal_fail(err, MODAL_NO_MEMORY, "whiten: no memory for %d periods", L);
    for (int j = 0; j <= most; j++)
        memcpy(A.x + (size_t)j * rows, e + (size_t)(j < most ? most - 1 - j : most) * (size_t)L,
               rows * sizeof *A.x);
    rc = qr_triangle(&A, &T, err);
    free(A.x);
    for (int m = 1; m <= most && rc == MODAL_OK && left(a, most) > 0; m++) {
        double gain = n * log(left(a, 0) / left(a, m)) - m * log(n);
        if (gain > a->gain)
            a->gain = gain, a->order = m;
    }
    return rc;
}

/* The coefficients of order M. */
static void coefficients(const struct prediction *a, int m, double *to)
{
    memcpy(to, a->T + (size_t)a->most * (size_t)(a->most + 1), (size_t)m * sizeof *to);
    cblas_dtrsv(CblasColMajor, CblasUpper, CblasNoTrans, CblasNonUnit, m, a->T, a->most + 1, to, 1);
}

static double *at_sample(double *y, int t, int phases, size_t ld)
{
    return y + (size_t)(t % phases) * ld + (size_t)(t / phases);
}

/* The signal whose first column is Y, its samples period by period, as (2) leaves it: what is
 * known of it begins FIRST samples later. */
static void take_out(const struct prediction *a, const struct periods *of, int first, double *y)
{
    size_t ld = (size_t)of->Y->ld;
    double coefficient[SIDE] = { 0 };

    coefficients(a, a->order, coefficient);
    for (int t = 0; t + first < of->samples; t++) {
        double u = *at_sample(y, t + first, of->phases, ld);
        for (int j = 1; j <= a->order; j++)
            u -= coefficient[j - 1] * *at_sample(y, t + first - j, of->phases, ld);
        /* none of what comes after needs it as it was: it reads no sample before t + 1 */
        *at_sample(y, t, of->phases, ld) = u;
    }
}

/* Y Y^T or Y^T Y, whichever is less (lower triangle); memory is the caller's to free. */
static enum modal_status products(const struct matrix *Y, struct matrix *A, struct modal_error *err)
{
    bool wide = Y->m <= Y->n;
    int side = wide ? Y->m : Y->n;

    *A = (struct matrix) { side, side, side,
                           calloc((size_t)side * (size_t)side + 1, sizeof *A->x) };
    if (A->x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "whiten: no memory for %d periods", Y->m);
    cblas_dsyrk(CblasColMajor, CblasLower, wide ? CblasNoTrans : CblasTrans, side,
                wide ? Y->n : Y->m, 1, Y->x, Y->ld, 0, A->x, side);
    return MODAL_OK;
}

/* The price of R directions in (3), ONE_LESS that of r - 1. */
static double price_of(double L, double S, double r, double one_less)
{
    double edge = sqrt(L - r + 1) + sqrt(S - r + 1),
           share = edge * edge / ((L - r + 1) * (S - r + 1));

    return r < 1 ? 0 : share < 1 ? one_less - L * S * log1p(-share) : HUGE_VAL;
}

/* (3) of Y. */
static enum modal_status worth_of(const struct matrix *Y, double *worth, struct modal_error *err)
{
    struct matrix A = { 0 };
    double price = 0, rest = 0, *left_of = NULL;       /* of i + 1 directions, the least */
    enum modal_status rc = products(Y, &A, err);

    *worth = HUGE_VAL;
    if (rc == MODAL_OK && (left_of = malloc(((size_t)A.n + 1) * sizeof *left_of)) == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "whiten: no memory for %d periods", Y->m);
    if (rc == MODAL_OK)
        rc = eigen_symmetric(&A, left_of, err);
    for (int i = 0; i < A.n && rc == MODAL_OK; i++)
        left_of[i] = rest += fmax(left_of[i], DBL_MIN);
    for (int r = 0; r < A.n && rc == MODAL_OK; r++) {
        price = price_of(Y->m, Y->n, r, price);
        *worth = fmin(*worth, (double)Y->m * Y->n * log(left_of[A.n - 1 - r]) + price);
    }
    free(A.x), free(left_of);
    return rc;
}

/* (3) of the periods, signal g times WEIGHT[g], after e_k = a e_{k-1} + u_k. */
static enum modal_status worth_with(const struct periods *of, const double *weight,
                                    const struct prediction *a, double *worth,
                                    struct modal_error *err)
{
    size_t ld = (size_t)of->Y->ld, n = (size_t)of->Y->n;
    struct matrix Z = { (of->samples - 1) / of->phases, of->Y->n, of->Y->ld,
                        malloc(ld * n * sizeof *Z.x) };
    struct periods all = { &Z, of->phases, of->samples };
    enum modal_status rc;

    if (Z.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "whiten: no memory for %d periods", Z.m);
    memcpy(Z.x, of->Y->x, ld * n * sizeof *Z.x);
    for (int c = 0; c < Z.n; c++)
        cblas_dscal(Z.ld, weight != NULL ? weight[c / of->phases] : 1, Z.x + (size_t)c * ld, 1);
    for (int c = 0; c < Z.n; c += of->phases)
        take_out(a, &all, 1, Z.x + (size_t)c * ld);
    rc = worth_of(&Z, worth, err);
    free(Z.x);
    return rc;
}

/* e_k = a e_{k-1} + u_k, u of variance 1 - a^2. */
static struct prediction first_order(double a)
{
    return (struct prediction) { .most = 1, .order = 1, .T = { 1, 0, a, sqrt(1 - a * a) } };
}

/* A of *at, or of that and STEP up or down, whichever is the better; *best: how good. */
static enum modal_status look_beside(const struct periods *of, const double *weight, double step,
                                     double *at, double *best, struct modal_error *err)
{
    double middle = *at, worth;
    enum modal_status rc = MODAL_OK;

    for (int side = -1; side <= 1 && rc == MODAL_OK; side += 2) {
        struct prediction a = first_order(middle + side * step);
        rc = worth_with(of, weight, &a, &worth, err);
        if (rc == MODAL_OK && worth < *best)
            *best = worth, *at = middle + side * step;
    }
    return rc;
}

enum modal_status whiten_first(struct periods *of, const double *weight, double least,
                               double *told, struct modal_error *err)
{
    double best = 0, at = 0, step = 0, numbers = (double)of->samples * of->Y->n / of->phases;
    struct prediction a = first_order(0);
    enum modal_status rc = MODAL_OK;

    *told = 0;
    if (of->Y->n < WIDE * of->Y->m
        || (rc = worth_with(of, weight, &a, &best, err)) != MODAL_OK)
        return rc;
    best -= least;
    for (int sign = 1; sign >= -1 && at == 0; sign -= 2) {
        double worth = -HUGE_VAL;
        for (double far = 0.5; rc == MODAL_OK && far * of->samples > 1; far /= 2) {
            a = first_order(sign * (1 - far));
            rc = worth_with(of, weight, &a, &worth, err);
            if (!(worth < best))
                break;
            best = worth, at = sign * (1 - far), step = far / 2;
        }
    }
    for (; rc == MODAL_OK && numbers * step * step > 1 - at * at; step /= 2)
        rc = look_beside(of, weight, step, &at, &best, err);
    if (rc != MODAL_OK || at == 0)
        return rc;
    a = first_order(at);
    for (int c = 0; c < of->Y->n; c += of->phases)
        take_out(&a, of, 1, of->Y->x + (size_t)c * (size_t)of->Y->ld);
    of->Y->m = --of->samples / of->phases;
    *told = at * at;
    return MODAL_OK;
}

enum modal_status noise_spread(const struct matrix *E, int M, double *spread,
                               struct modal_error *err)
{
    double trace = 0, squares = 0;
    struct matrix A = { 0 };
    enum modal_status rc = products(E, &A, err);

    *spread = 0;
    if (rc != MODAL_OK)
        return rc;
    for (int c = 0; c < A.n; c++) {
        const double *at = A.x + (size_t)c * (size_t)(A.n + 1);
        trace += at[0];
        squares += 2 * cblas_ddot(A.n - c, at, 1, at, 1) - at[0] * at[0];
    }
    if (trace > 0)
        *spread = M < 2 ? HUGE_VAL
            : (squares / (trace * trace) - 1. / M) * M * M * E->n / ((M - 1.) * (M + 2));
    free(A.x);
    return MODAL_OK;
}

/* What (2) of each signal tells of E in a period, M rows of it free, or what it LEAVES, in units of
 * its deviation; memory is the caller's to free. */
static enum modal_status part(const struct matrix *E, const struct prediction *a, int phases,
                              int M, bool leaves, struct matrix *T, struct modal_error *err)
{
    *T = (struct matrix) { E->m, 0, E->m, calloc((size_t)E->m * (size_t)E->n, sizeof *T->x) };
    if (T->x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "whiten: no memory for %d periods", E->m);
    for (int g = 0; g < E->n / phases; g++) {
        const double *e = E->x + (size_t)g * (size_t)phases * (size_t)E->ld;
        double coefficient[SIDE + 1] = { leaves ? -1 : 0 }, after = left(&a[g], a[g].order),
               sum = leaves ? after : left(&a[g], 0) - after,
               unit = sqrt(M * (double)(phases - a[g].most) / sum);
        coefficients(&a[g], a[g].order, coefficient + 1);
        for (int k = a[g].order; k < phases && sum > 0; k++, T->n++)
            for (int j = 0; j <= a[g].order; j++)
                cblas_daxpy(T->m, coefficient[j] * unit, e + (size_t)(k - j) * (size_t)E->ld, 1,
                            T->x + (size_t)T->n * (size_t)T->ld, 1);
    }
    return MODAL_OK;
}

/* Is what (2) tells of E noise: nowhere more than noise so spread gives a pair of multipliers? Of
 * rows so few that it could give a pair all there is, is what (2) leaves spread as by chance? */
static enum modal_status tells_noise(const struct matrix *E, const struct prediction *a, int phases,
                                     int M, bool *noise, struct modal_error *err)
{
    struct matrix T;
    double spread = 0, chi2 = 0, most;
    double complex lambda;
    enum modal_status rc = part(E, a, phases, M, false, &T, err);

    if (rc == MODAL_OK)
        rc = noise_spread(&T, M, &spread, err);
    if (rc == MODAL_OK)
        rc = remainder_peak(&T, 1, &lambda, &chi2, err);
    most = criterion_noise_pair(T.n, fmin(1 / spread, 1), (double)M * T.n);
    *noise = chi2 <= most;
    if (rc == MODAL_OK && !(most < (double)M * T.n)) {
        free(T.x);
        rc = part(E, a, phases, M, true, &T, err);
        if (rc == MODAL_OK)
            rc = noise_spread(&T, M, &spread, err);
        *noise = spread <= 1 + NOISE_CHANCE / M;
    }
    free(T.x);
    return rc;
}

enum modal_status whiten_periods(struct periods *of, const struct matrix *E, int order,
                                 double least, double *told, struct modal_error *err)
{
    int phases = of->phases, signals = E->n / phases, first = 0;
    bool noise = false;
    double gain = 0, share = (double)(E->m - order) / E->m;
    struct prediction *a = calloc((size_t)signals + 1, sizeof *a);
    enum modal_status rc = a != NULL ? MODAL_OK
        : modal_fail(err, MODAL_NO_MEMORY, "whiten: no memory for %d signals", signals);

    *told = 0;
    for (int g = 0; g < signals && rc == MODAL_OK; g++) {
        rc = predict(E->x + (size_t)g * (size_t)phases * (size_t)E->ld, E->m, phases, share, &a[g],
                     err);
        gain += a[g].gain / share;     /* in all rows: the fit may have drawn noise in many */
        first = a[g].order > first ? a[g].order : first;
    }
    if (rc != MODAL_OK || !(gain > least) || (of->samples - first) / phases <= order + 1)
        goto out;
    rc = tells_noise(E, a, phases, E->m - order, &noise, err);
    if (rc != MODAL_OK || !noise)
        goto out;
    for (int g = 0; g < signals; g++) {
        take_out(&a[g], of, first, of->Y->x + (size_t)g * (size_t)phases * (size_t)of->Y->ld);
        *told += (1 - left(&a[g], a[g].order) / left(&a[g], 0)) / signals;
    }
    of->samples -= first;
    of->Y->m = of->samples / phases;
out:
    free(a);
    return rc;
}
