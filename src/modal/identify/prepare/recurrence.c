/*
 * recurrence.c - a column's recurrences by least squares, from the products of its rows
 *
 * Products of the rows l - i and l - j are summed over all l that no row left out comes near; those
 * of neighbouring i and j differ by their ends alone. Half the digits are lost to products.
 */
#include "modal/identify/prepare/recurrence.h"
#include <cblas.h>
#include <math.h>
#include <string.h>

enum {
    ROWS_LEAST = 4,              /* over the order: of fewer it is the samples themselves */
    CACHED = 1024                /* rows at a time: of two columns, they stay in a first cache */
};
static const double RIDGE = 1e-14;       /* of what is solved: its rounding */

bool recurrence_band_solve(double *B, int n, int kd, double *x)
{
    size_t w = (size_t)kd + 1;

    for (int i = 0; i < n; i++)
        for (int d = i < kd ? i : kd; d >= 0; d--) {
            double sum = B[i * w + d];
            for (int j = i - d, m = i > kd ? i - kd : 0; m < j; m++)
                sum -= B[i * w + (i - m)] * B[j * w + (j - m)];
            if (d == 0 && !(sum > 0))
                return false;
            B[i * w + d] = d > 0 ? sum / B[(i - d) * w] : sqrt(sum);
        }
    for (int i = 0; i < n; i++) {
        for (int d = 1; d <= kd && d <= i; d++)
            x[i] -= B[i * w + d] * x[i - d];
        x[i] /= B[i * w];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int d = 1; d <= kd && i + d < n; d++)
            x[i] -= B[(i + d) * w + d] * x[i + d];
        x[i] /= B[i * w];
    }
    return true;
}

/* Products of rows FROM to TO - 1 onto R, (p + 1) x (p + 1), upper triangle; of how many rows. */
static int add_products(const double *z, int p, int from, int to, double *R)
{
    int n = p + 1, first = from + p;
    double own[(RECURRENCE_MOST + 1) * (RECURRENCE_MOST + 1)];

    if (to <= first)
        return 0;
    memset(own, 0, sizeof own);
    for (int l = first, rows; l < to; l += rows) {
        rows = to - l < CACHED ? to - l : CACHED;
        for (int j = 0; j < n; j++)
            own[j] += cblas_ddot(rows, z + l, 1, z + l - j, 1);
    }
    for (int i = 1; i < n; i++)
        for (int j = i; j < n; j++)
            own[i * n + j] = own[(i - 1) * n + j - 1] + z[first - i] * z[first - j]
                           - z[to - i] * z[to - j];
    for (int i = 0; i < n; i++)
        for (int j = i; j < n; j++)
            R[i * n + j] += own[i * n + j];
    return to - first;
}

static bool solve_recurrence(const double *R, int p, bool back, double *a)
{
    double B[RECURRENCE_MOST * RECURRENCE_MOST], trace = 0;
    int n = p + 1;

    for (int i = 0; i < n; i++)
        trace += R[i * n + i];
    for (int i = 0; i < p; i++) {
        for (int d = 0; d <= i; d++)
            B[i * p + d] = (back ? R[(p - i - 1) * n + p - i - 1 + d] : R[(i - d + 1) * n + i + 1])
                         + (d == 0 ? RIDGE * trace : 0);
        a[i + 1] = back ? -R[(p - i - 1) * n + p] : -R[i + 1];
    }
    a[0] = 1;
    return trace > 0 && recurrence_band_solve(B, p, p - 1, a + 1);
}

bool recurrence_fit(const double *z, const bool *out, int L, int p, double *forward, double *back)
{
    double R[(RECURRENCE_MOST + 1) * (RECURRENCE_MOST + 1)] = { 0 };
    int rows = 0;

    for (int l = 0, begin = 0; l <= L; l++)
        if (l == L || (out != NULL && out[l])) {
            rows += add_products(z, p, begin, l, R);
            begin = l + 1;
        }
    return rows >= ROWS_LEAST * p && solve_recurrence(R, p, false, forward)
        && (back == NULL || solve_recurrence(R, p, true, back));
}

void recurrence_leaves(const double *a, int p, int sense, const double *z, int L, double *e)
{
    memset(e, 0, sizeof *e * (size_t)L);
    for (int l = 0, rows; l < L - p; l += rows) {
        rows = L - p - l < CACHED ? L - p - l : CACHED;
        for (int j = 0; j <= p; j++)
            cblas_daxpy(rows, a[j], z + l + (sense > 0 ? p - j : j), 1,
                        e + l + (sense > 0 ? p : 0), 1);
    }
}
