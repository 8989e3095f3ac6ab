/* test_gram.c - sums in closed form against the columns themselves */
#include "modal/identify/fit/gram.h"
#include "modal/identify/linear/powers.h"
#include "check.h"
#include "signals.h"
#include <cblas.h>
#include <float.h>

enum { L = 333, POLES = 7, S = 3, ORDER = 12, K = 2 * ORDER };

/* Decays, growth, no damping, neighbours, both real kinds, one near the Nyquist frequency: 12
 * columns. */
static const double a[POLES] = { -0.02, 0.011, 0, -0.0004, -0.03, -0.4, -0.0004 };
static const double b[POLES] = { 0.7, 1.9, 2.6, 3.1399, 0, M_PI, 3.1301 };
static const enum pole_kind kind[POLES] = { POLE_PAIR, POLE_PAIR, POLE_PAIR, POLE_PAIR, POLE_REAL,
                                            POLE_NEGATIVE, POLE_PAIR };
static const int column[POLES] = { 0, 2, 4, 6, 8, 9, 10 }, first[POLES] = { 0, 2, 4, 6, 8, -1, 9 };
static double basis[L * K], y[L * S];

/* Columns of Phi, then of D about the same centres as refine.c has. */
static void columns_themselves(void)
{
    for (int j = 0; j < POLES; j++) {
        double *x = basis + column[j] * L;
        double centre = a[j] == 0 ? 0.5 * (L - 1) : a[j] > 0 ? L - 1 - fmin(0.5 * L, 1 / a[j])
                      : fmin(0.5 * L, -1 / a[j]);
        powers_of(kind[j], a[j], b[j], L, x, L);
        for (int c = 0; c < (kind[j] == POLE_PAIR ? 2 : 1); c++)
            for (int l = 0; l < L; l++)
                x[l + (ORDER + c) * L] = (l - centre) * x[l + c * L];
    }
}

static struct gram *factored(double *R)
{
    struct doubling_poles poles = { POLES, ORDER, kind, column, a, b };
    struct gram *g = gram_new(L, POLES, ORDER);

    columns_themselves();
    CHECK(g != NULL && gram_factor(g, &poles, false, R));
    return g;
}

/* R^T R has the inner products, to the rounding of their columns' sizes. */
TEST(the_factor_has_the_inner_products_of_all_columns)
{
    static double R[K * K];
    struct gram *g = factored(R);

    for (int i = 0; i < K; i++)
        for (int j = 0; j < K; j++) {
            double sum = cblas_ddot(L, basis + i * L, 1, basis + j * L, 1);
            double size = cblas_dnrm2(L, basis + i * L, 1) * cblas_dnrm2(L, basis + j * L, 1);
            CHECK_NEAR(cblas_ddot(K, R + i * K, 1, R + j * K, 1) / size, sum / size,
                       1000 * DBL_EPSILON);
        }
    gram_free(g);
}

/* What is left is orthogonal to Phi, and no larger than what any other amplitudes leave. */
TEST(amplitudes_leave_what_is_orthogonal_to_every_column)
{
    static double R[K * K], C[ORDER * S], Z[K * S], rest2[S], left[L];
    struct gram *g = factored(R);
    struct matrix Y = { L, S, L, y };
    struct random rng = { 5 };

    for (int l = 0; l < L * S; l++)
        y[l] = random_normal(&rng) + 3 * basis[l % L + 2 * L] + basis[l % L + 10 * L];
    CHECK(gram_project(g, &Y, R, C, Z, rest2));
    for (int c = 0; c < S; c++) {
        memcpy(left, y + c * L, sizeof left);
        cblas_dgemv(CblasColMajor, CblasNoTrans, L, ORDER, -1, basis, L, C + c * ORDER, 1, 1, left,
                    1);
        CHECK_NEAR(cblas_ddot(L, left, 1, left, 1) / rest2[c], 1, 1e-13);
        for (int i = 0; i < ORDER; i++)
            CHECK_NEAR(cblas_ddot(L, left, 1, basis + i * L, 1)
                       / cblas_dnrm2(L, basis + i * L, 1), 0, 1e-11);
    }
    gram_free(g);
}

/* The columns of the Jacobian as (2) and (3) of refine.c have them, projected by Phi's own normal
 * equations. */
static void jacobian(const double *R, const double *C, int c, double *J)
{
    double sums[ORDER];

    memset(J, 0, sizeof *J * L * 11);
    for (int j = 0; j < POLES; j++) {
        const double *d = basis + (ORDER + column[j]) * L, *x = C + column[j] + c * ORDER;
        bool pair = kind[j] == POLE_PAIR;
        for (int l = 0; l < L && first[j] >= 0; l++) {
            J[l + first[j] * L] = x[0] * d[l] + (pair ? x[1] * d[l + L] : 0);
            if (pair)
                J[l + (first[j] + 1) * L] = x[0] * d[l + L] - x[1] * d[l];
        }
    }
    for (int p = 0; p < 11; p++) {
        for (int i = 0; i < ORDER; i++)
            sums[i] = cblas_ddot(L, basis + i * L, 1, J + p * L, 1);
        cblas_dtrsv(CblasColMajor, CblasUpper, CblasTrans, CblasNonUnit, ORDER, R, K, sums, 1);
        cblas_dtrsv(CblasColMajor, CblasUpper, CblasNoTrans, CblasNonUnit, ORDER, R, K, sums, 1);
        cblas_dgemv(CblasColMajor, CblasNoTrans, L, ORDER, -1, basis, L, sums, 1, 1, J + p * L, 1);
    }
}

TEST(the_triangle_is_that_of_the_jacobian_and_of_its_slope)
{
    enum { P = 11 };
    static double R[K * K], C[ORDER * S], Z[K * S], rest2[S], T[(P + 1) * (P + 1)], J[L * P];
    static double normal[P * P], slope[P];
    const double weight[S] = { 1, 0.3, 2.5 };
    struct gram *g = factored(R);
    struct matrix Y = { L, S, L, y };
    struct random rng = { 6 };

    for (int l = 0; l < L * S; l++)
        y[l] = random_normal(&rng) + 3 * basis[l % L + 2 * L] + basis[l % L + 6 * L];
    CHECK(gram_project(g, &Y, R, C, Z, rest2));
    CHECK(gram_triangle(g, R, C, Z, S, weight, first, P, T));
    for (int c = 0; c < S; c++) {
        double w = weight[c] * weight[c];
        jacobian(R, C, c, J);
        for (int i = 0; i < P; i++) {
            slope[i] += w * cblas_ddot(L, J + i * L, 1, y + c * L, 1);
            for (int j = 0; j < P; j++)
                normal[i + j * P] += w * cblas_ddot(L, J + i * L, 1, J + j * L, 1);
        }
    }
    for (int i = 0; i < P; i++) {
        CHECK_NEAR(cblas_ddot(P, T + i * (P + 1), 1, T + P * (P + 1), 1)
                   / sqrt(normal[i + i * P]), slope[i] / sqrt(normal[i + i * P]), 1e-8);
        for (int j = 0; j < P; j++) {
            double size = sqrt(normal[i + i * P] * normal[j + j * P]);
            CHECK_NEAR(cblas_ddot(P, T + i * (P + 1), 1, T + j * (P + 1), 1) / size,
                       normal[i + j * P] / size, 1e-8);
        }
    }
    gram_free(g);
}

/* Two poles 1e-9 of a beat apart are one column. */
TEST(columns_that_sums_cannot_tell_apart_are_refused)
{
    const double twice_a[2] = { -0.01, -0.01 }, twice_b[2] = { 0.5, 0.5 + 1e-11 };
    const enum pole_kind pairs[2] = { POLE_PAIR, POLE_PAIR };
    const int at[2] = { 0, 2 };
    struct doubling_poles poles = { 2, 4, pairs, at, twice_a, twice_b };
    struct gram *g = gram_new(L, 2, 4);
    static double R[64];

    CHECK(g != NULL && !gram_factor(g, &poles, false, R));
    gram_free(g);
}
