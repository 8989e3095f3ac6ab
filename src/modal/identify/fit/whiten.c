/*
 * whiten.c - autoregression within a period
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
 * leaves u white, with the same a for all k, and the first samples of a row, which have fewer
 * before them, by predictions of lower order. So V^-1/2 is a band below a triangle, of (2). The
 * a of all orders up to `most` come from one QR of E's columns beside each other, shifted; the
 * order by Bayes' criterion. What reaches over the end of a period is left as it is: one sample of
 * each tells of it.
 */
#include "modal/identify/fit/whiten.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/qr.h"

enum {
    ORDER_MOST = 8,                 /* of (2): four peaks of a spectrum */
    SIDE = ORDER_MOST + 1
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

/* The columns Y of a signal as (2) leaves them, all with the variance of the order chosen. */
static void take_out(const struct prediction *a, int phases, int L, size_t ld, double *y)
{
    double coefficient[SIDE] = { 0 };

    coefficients(a, a->order, coefficient);
    for (int k = phases - 1; k >= 0; k--) {
        double *at = y + (size_t)k * ld;
        int m = k < a->order ? k : a->order;
        if (m < a->order)
            coefficients(a, m, coefficient);
        for (int j = 1; j <= m; j++)
            cblas_daxpy(L, -coefficient[j - 1], at - (size_t)j * ld, 1, at, 1);
        cblas_dscal(L, sqrt(left(a, a->order) / left(a, m)), at, 1);
    }
}

enum modal_status whiten_rows(const struct matrix *E, int phases, int order, double least,
                              struct matrix *Y, double *told, struct modal_error *err)
{
    int signals = E->n / phases;
    double gain = 0, share = (double)(E->m - order) / E->m;
    struct prediction *a = calloc((size_t)signals + 1, sizeof *a);
    enum modal_status rc = a != NULL ? MODAL_OK
        : modal_fail(err, MODAL_NO_MEMORY, "whiten: no memory for %d signals", signals);

    *told = 0;
    for (int g = 0; g < signals && rc == MODAL_OK; g++) {
        rc = predict(E->x + (size_t)g * (size_t)phases * (size_t)E->ld, E->m, phases, share, &a[g],
                     err);
        gain += a[g].gain / share;     /* in all rows: the fit may have drawn noise in many */
    }
    for (int g = 0; g < signals && rc == MODAL_OK && gain > least; g++)
        if (a[g].order > 0) {
            take_out(&a[g], phases, Y->m, (size_t)Y->ld,
                     Y->x + (size_t)g * (size_t)phases * (size_t)Y->ld);
            *told += (1 - left(&a[g], a[g].order) / left(&a[g], 0)) / signals;
        }
    free(a);
    return rc;
}
