/* Reflections against what any orthogonal factorisation keeps: A^T A = R^T R, and Q^T A = R.
 * Tolerances: rounding of sums of some ten numbers of size 1. */
#include "modal/linalg/reflect.h"
#include <float.h>
#include <math.h>
#include <string.h>
#include "check.h"
#include "signals.h"

enum { LD = 40 };
static const double CLOSE = 100 * DBL_EPSILON;

static void fill(double *x, int count, uint64_t seed)
{
    struct random r = { seed };

    for (int i = 0; i < count; i++)
        x[i] = random_normal(&r);
}

static long double product(const double *A, const double *B, int i, int j, int m)
{
    long double sum = 0;

    for (int k = 0; k < m; k++)
        sum += (long double)A[k + i * LD] * B[k + j * LD];
    return sum;
}

/* R^T R of an upper triangle. */
static long double triangle_product(const double *R, int i, int j)
{
    return product(R, R, i, j, (i < j ? i : j) + 1);
}

TEST(a_triangle_has_the_products_of_its_columns)
{
    static const int sizes[][2] = { { 17, 6 }, { 5, 5 }, { 1, 1 }, { 31, 1 }, { 32, 24 } };

    for (int s = 0; s < 5; s++) {
        int m = sizes[s][0], n = sizes[s][1];
        double A[LD * 24], R[LD * 24], tau[24];
        fill(A, LD * n, 3), memcpy(R, A, sizeof A);
        reflect_columns(m, n, R, LD, tau);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                CHECK_NEAR((double)(triangle_product(R, i, j) - product(A, A, i, j, m)), 0,
                           CLOSE * m);
    }
}

/* I - V T V^T on A itself leaves R and zeros. */
TEST(the_compact_form_is_the_product_of_the_reflections)
{
    enum { M = 19, N = 7 };
    double A[LD * N], V[LD * N], tau[N], T[N * N];

    fill(A, LD * N, 5), memcpy(V, A, sizeof A);
    reflect_columns(M, N, V, LD, tau);
    reflect_compact(M, N, V, LD, tau, T);
    for (int j = 0; j < N; j++) {
        long double w[N], x[M];
        for (int k = 0; k < N; k++) {
            w[k] = A[k + j * LD];
            for (int i = k + 1; i < M; i++)
                w[k] += (long double)V[i + k * LD] * A[i + j * LD];
        }
        for (int i = 0; i < M; i++) {
            x[i] = A[i + j * LD];
            for (int k = 0; k < N && k <= i; k++)
                for (int l = 0; l <= k; l++)                      /* T^T: of Q^T */
                    x[i] -= (i == k ? 1 : V[i + k * LD]) * T[l + k * N] * w[l];
            CHECK_NEAR((double)x[i] - (i <= j ? V[i + j * LD] : 0), 0, CLOSE);
        }
    }
}

/* What lies below the trapezoid is not a number, and is not read. */
TEST(rows_below_a_triangle_are_taken_in)
{
    /* m, n, flat */
    static const int shape[][3] = {
        { 7, 5, 0 }, { 6, 6, 5 }, { 4, 4, 4 }, { 1, 3, 0 }, { 1, 1, 0 }
    };

    for (int s = 0; s < 5; s++) {
        int m = shape[s][0], n = shape[s][1], flat = shape[s][2];
        double all[LD * 8], R[LD * 8], V[LD * 8], top[LD * 8], low[LD * 8], tau[8];
        fill(all, LD * n, 7);
        for (int j = 0; j < n; j++)
            for (int i = 0; i < n + m; i++)
                if (i < n ? i > j : i - n > m - flat + j)
                    all[i + j * LD] = 0;
        for (int j = 0; j < n; j++) {
            memcpy(R + j * LD, all + j * LD, LD * sizeof *R);
            for (int i = 0; i < m; i++)
                V[i + j * LD] = i > m - flat + j ? NAN : all[n + i + j * LD];
            for (int i = 0; i < LD; i++)
                top[i + j * LD] = all[i + j * LD],
                            low[i + j * LD] = i < m ? all[n + i + j * LD] : 0;
        }
        reflect_below(m, n, flat, R, LD, V, LD, tau);
        reflect_below_apply(m, n, flat, V, LD, tau, n, top, LD, low, LD);
        for (int j = 0; j < n; j++) {
            for (int i = 0; i < n; i++) {
                CHECK_NEAR((double)(triangle_product(R, i, j) - product(all, all, i, j, n + m)), 0,
                           CLOSE);
                CHECK_NEAR(top[i + j * LD], i <= j ? R[i + j * LD] : 0, CLOSE);
            }
            for (int i = 0; i < m; i++)
                CHECK_NEAR(low[i + j * LD], 0, CLOSE);
        }
    }
}

TEST(a_column_of_zeros_is_left_alone)
{
    double A[LD * 2] = { 0 }, tau[2] = { 9, 9 };

    A[3 + LD] = -2.5;
    reflect_columns(5, 2, A, LD, tau);
    CHECK(tau[0] == 0 && A[0] == 0);
    CHECK_NEAR(fabs(A[1 + LD]), 2.5, 0);
}
