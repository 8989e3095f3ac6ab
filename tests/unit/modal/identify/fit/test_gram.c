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
static const int column[POLES] = { 0, 2, 4, 6, 8, 9, 10 };
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

static struct gram *factored(double *R, bool together)
{
    struct doubling_poles poles = { POLES, ORDER, kind, column, a, b };
    struct gram *g = gram_new(L, POLES, ORDER, together);

    columns_themselves();
    CHECK(g != NULL && gram_factor(g, &poles, false, R));
    return g;
}

/* R^T R has the inner products, to the rounding of their columns' sizes. */
TEST(the_factor_has_the_inner_products_of_all_columns)
{
    static double R[K * K];
    struct gram *g = factored(R, false);

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
    struct gram *g = factored(R, false);
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

enum { MOST = 11 };             /* parameters */

/* The columns of the Jacobian as (2) and (3) of refine.c have them, of poles that move together
 * added up, projected by Phi's own normal equations. */
static void jacobian(const double *R, const double *C, int c, const struct gram_parameters *p,
                     double *J)
{
    double sums[ORDER];

    memset(J, 0, sizeof *J * L * MOST);
    for (int j = 0; j < POLES; j++) {
        const double *d = basis + (ORDER + column[j]) * L, *x = C + column[j] + c * ORDER;
        bool pair = kind[j] == POLE_PAIR;
        for (int l = 0; l < L && p->first[j] >= 0; l++) {
            J[l + p->first[j] * L] += x[0] * d[l] + (pair ? x[1] * d[l + L] : 0);
            if (pair && p->turn[j] != 0)
                J[l + (p->first[j] + 1) * L] += p->turn[j] * (x[0] * d[l + L] - x[1] * d[l]);
        }
    }
    for (int k = 0; k < p->count; k++) {
        for (int i = 0; i < ORDER; i++)
            sums[i] = cblas_ddot(L, basis + i * L, 1, J + k * L, 1);
        cblas_dtrsv(CblasColMajor, CblasUpper, CblasTrans, CblasNonUnit, ORDER, R, K, sums, 1);
        cblas_dtrsv(CblasColMajor, CblasUpper, CblasNoTrans, CblasNonUnit, ORDER, R, K, sums, 1);
        cblas_dgemv(CblasColMajor, CblasNoTrans, L, ORDER, -1, basis, L, sums, 1, 1, J + k * L, 1);
    }
}

/* Triangle T, by the Jacobian's own inner products and slope. */
static void check_triangle(const struct gram_parameters *p, const double *R, const double *C,
                           const double *weight, const double *T)
{
    static double J[L * MOST];
    double normal[MOST * MOST] = { 0 }, slope[MOST] = { 0 };
    int P = p->count;

    for (int c = 0; c < S; c++) {
        double w = weight[c] * weight[c];
        jacobian(R, C, c, p, J);
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
}

static void triangle_of(const struct gram_parameters *p, bool together)
{
    static double R[K * K], C[ORDER * S], Z[K * S], rest2[S], T[(MOST + 1) * (MOST + 1)];
    const double weight[S] = { 1, 0.3, 2.5 };
    struct gram *g = factored(R, together);
    struct matrix Y = { L, S, L, y };
    struct random rng = { 6 };

    for (int l = 0; l < L * S; l++)
        y[l] = random_normal(&rng) + 3 * basis[l % L + 2 * L] + basis[l % L + 6 * L];
    CHECK(gram_project(g, &Y, R, C, Z, rest2));
    CHECK(gram_triangle(g, R, C, Z, S, weight, p, T));
    check_triangle(p, R, C, weight, T);
    gram_free(g);
}

TEST(the_triangle_is_that_of_the_jacobian_and_of_its_slope)
{
    const int first[POLES] = { 0, 2, 4, 6, 8, -1, 9 }, turn[POLES] = { 1, 1, 1, 1, 1, 1, 1 };

    triangle_of(&(struct gram_parameters) { 11, first, turn }, false);
}

/* A pair with a conjugate line before it and another after, and a real pole whose lines turn by
 * what is fixed. */
TEST(poles_that_move_together_have_the_sums_of_their_derivatives)
{
    const int first[POLES] = { 3, 0, 2, 0, 2, -1, 0 }, turn[POLES] = { 1, -1, 0, 1, 0, 1, -1 };

    triangle_of(&(struct gram_parameters) { 5, first, turn }, true);
}

/* Two poles 1e-9 of a beat apart are one column. */
TEST(columns_that_sums_cannot_tell_apart_are_refused)
{
    const double twice_a[2] = { -0.01, -0.01 }, twice_b[2] = { 0.5, 0.5 + 1e-11 };
    const enum pole_kind pairs[2] = { POLE_PAIR, POLE_PAIR };
    const int at[2] = { 0, 2 };
    struct doubling_poles poles = { 2, 4, pairs, at, twice_a, twice_b };
    struct gram *g = gram_new(L, 2, 4, false);
    static double R[64];

    CHECK(g != NULL && !gram_factor(g, &poles, false, R));
    gram_free(g);
}
