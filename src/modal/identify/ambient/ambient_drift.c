/*
 * ambient_drift.c - the lowest lines, held against those beside them
 *
 * A sensor that warms up, or a reference that creeps, moves smoothly over the whole record.  Its
 * end is not its beginning: a record that repeats shows a jump, of 1 / f at every line, which is no
 * answer to noise.  Under Hann's window, which no jump is seen through, it lies in the lowest lines
 * alone; of an answer to noise those are as large as the lines beside them, in the mean square.
 * What is taken off are Gram's polynomials, orthonormal over the samples, of as many degrees as so
 * many lines have numbers.
 *
 * Tested by tests/system/test_ambient.py.
 */
#include "modal/identify/ambient/ambient_drift.h"
#include <cblas.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include "modal/identify/ambient/spectrum.h"

enum {
    DEGREE = 2 * AMBIENT_DRIFT_LINES,    /* a cosine and a sine each */
    FIRST = 2,                   /* line under the window that a mean does not reach */
    SLOW = AMBIENT_DRIFT_LINES - FIRST + 1,
    BESIDE = 64                  /* lines that are held against them */
};
/* F of 6 and 128 degrees of freedom is so much five times in 1e9; under a window lines are not
 * quite free. */
static const double DRIFT = 10;

/* Columns 0 .. DEGREE of Q: Gram's polynomials, orthonormal over its rows, by the recurrence of
 * three terms. */
static void polynomials(struct matrix *Q)
{
    int N = Q->m;

    for (int k = 0; k < N; k++)
        Q->x[k] = 1 / sqrt(N);
    for (int p = 1; p <= DEGREE; p++) {
        double *x = Q->x + (size_t)p * Q->ld;
        const double *last = x - Q->ld;
        for (int k = 0; k < N; k++)
            x[k] = last[k] * (2. * k + 1 - N) / N;
        for (int j = p > 1 ? p - 2 : 0; j < p; j++) {
            const double *y = Q->x + (size_t)j * Q->ld;
            cblas_daxpy(N, -cblas_ddot(N, x, 1, y, 1), y, 1, x, 1);
        }
        cblas_dscal(N, 1 / cblas_dnrm2(N, x, 1), x, 1);
    }
}

/* The lowest lines of Y under the window. */
static enum modal_status lowest_lines(const struct matrix *Y, struct spectrum *s,
                                      struct modal_error *err)
{
    struct matrix seen = matrix_new(Y->m, Y->n);
    enum modal_status rc;

    if (seen.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d samples", Y->m);
    for (int k = 0; k < Y->m; k++) {
        double window = (1 - cos(2 * M_PI * (k + 0.5) / Y->m)) / 2;
        for (int c = 0; c < Y->n; c++)
            seen.x[k + (size_t)c * seen.ld] = window * Y->x[k + (size_t)c * Y->ld];
    }
    rc = spectrum_make(&seen, FIRST, (double)BESIDE / Y->m, s, err);
    free(seen.x);
    return rc;
}

/* Do the lowest lines of a column stand out? */
static enum modal_status find(const struct matrix *Y, bool *drifts, struct modal_error *err)
{
    struct spectrum s;
    enum modal_status rc = lowest_lines(Y, &s, err);

    *drifts = false;
    for (int c = 0; rc == MODAL_OK && c < s.channels && !*drifts; c++) {
        double slow = 0, beside = 0;
        for (int j = 0; j < s.lines; j++) {
            double complex f = s.F[(size_t)j * s.channels + c];
            *(j < SLOW ? &slow : &beside) += creal(f * conj(f));
        }
        *drifts = slow / SLOW > DRIFT * beside / (s.lines - SLOW);
    }
    if (rc == MODAL_OK)
        spectrum_done(&s);
    return rc;
}

/* Y less Q Q^T Y; what that is of its mean square. */
static double take(struct matrix *Y, const struct matrix *Q)
{
    double slow = 0, all = 0;

    for (int c = 0; c < Y->n; c++) {
        double *y = Y->x + (size_t)c * Y->ld, T[DEGREE + 1];
        all += cblas_ddot(Y->m, y, 1, y, 1);
        cblas_dgemv(CblasColMajor, CblasTrans, Q->m, Q->n, 1, Q->x, Q->ld, y, 1, 0, T, 1);
        cblas_dgemv(CblasColMajor, CblasNoTrans, Q->m, Q->n, -1, Q->x, Q->ld, T, 1, 1, y, 1);
        slow += cblas_ddot(Q->n, T, 1, T, 1);
    }
    return slow / all;
}

enum modal_status ambient_drift_take(struct matrix *Y, double *share, struct modal_error *err)
{
    struct matrix Q;
    bool drifts;
    enum modal_status rc = find(Y, &drifts, err);

    *share = 0;
    if (rc != MODAL_OK || !drifts)
        return rc;
    Q = matrix_new(Y->m, DEGREE + 1);
    if (Q.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for a drift of %d samples",
                          Y->m);
    polynomials(&Q);
    *share = take(Y, &Q);
    free(Q.x);
    return MODAL_OK;
}
