/* test_identify_parts.c - the modules of identification, each against a closed form */
/* Tests as well: exponents.c fold.c hankel.c harmonics.c modes.c pod.c projection.c rank.c record.c
 * synthesis.c transition.c */
#include "check.h"
#include "signals.h"
#include <complex.h>
#include <float.h>
#include <stdbool.h>
#include <stdlib.h>
#include "modal/identify/answer/harmonics.h"
#include "modal/identify/answer/modes.h"
#include "modal/identify/fit/refine.h"
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/identify.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/linear/hankel.h"
#include "modal/identify/linear/projection.h"
#include "modal/identify/linear/rank.h"
#include "modal/identify/linear/transition.h"
#include "modal/identify/prepare/fold.h"
#include "modal/identify/prepare/pod.h"
#include "modal/identify/prepare/record.h"
#include "modal/linalg/eigen.h"
#include "modal/linalg/svd.h"

/* ---- exponents ---- */

TEST(an_exponent_and_its_multiplier_are_inverses_in_all_four_quadrants)
{
    const double tau = 0.37, moduli[] = { 1e-200, 0.3, 1 - 1e-9, 1, 1 + 1e-9, 2.5, 1e200 };

    for (size_t i = 0; i < sizeof moduli / sizeof *moduli; i++)
        for (int k = -4; k <= 4; k++) {
            double complex rho = moduli[i] * cexp(I * 0.7 * k), lambda = exponent_of(rho, tau);
            CHECK_NEAR(creal(lambda), log(moduli[i]) / tau,
                       4 * DBL_EPSILON * (1 + fabs(log(moduli[i]))) / tau);
            CHECK_NEAR(cabs(multiplier_of(lambda, tau) / rho - 1), 0, 1e3 * DBL_EPSILON);
        }
}

/* ln(1 + x) = x - x^2/2: a hypotenuse and log would leave seven digits of 1e-9. */
TEST(damping_of_one_part_in_1e9_keeps_its_digits)
{
    const double x = 1e-9;
    double complex rho = (1 + x) * 1;

    /* 1 + x is rounded to 1.1e-16 / 1e-9 */
    CHECK_NEAR(log_modulus(rho) / (x - x * x / 2), 1, 2e-7);
    CHECK_NEAR(log_modulus(CMPLX(0, 1 + 0x1p-40)) / 0x1p-40, 1, 1e-12);
    CHECK(log_modulus(1) == 0 && log_modulus(-1) == 0 && log_modulus(I) == 0);
}

TEST(what_the_printed_formula_makes_nan_is_finite_here)
{
    CHECK(exponent_of(1, 0.5) == 0);
    CHECK(frequency_of(0) == 0 && damping_ratio_of(0) == 0);
    CHECK_NEAR(damping_ratio_of(exponent_of(1.3, 0.5)), -1, 0);            /* phi = 0, growing */
    CHECK_NEAR(damping_ratio_of(exponent_of(0.7, 0.5)), 1, 0);
    CHECK(cimag(exponent_of(-0.7, 0.5)) == M_PI / 0.5);                      /* phi = pi */
    CHECK(creal(exponent_of(0, 0.5)) == -HUGE_VAL);
    CHECK_NEAR(frequency_of(exponent_of(0.9 * cexp(I), 1)), 1.005535, 1e-6); /* printed: -1.00554 */
}

TEST(poles_are_one_entry_a_pair_and_keep_their_kind)
{
    const double complex rho[] = { 0.5, 0.9 * cexp(I), 0.9 * cexp(-I), -0.8, 0, 1e-40 };
    double complex lambda[6];
    int dropped;

    CHECK(poles_of_multipliers(rho, 6, 0.1, 1e-32, lambda, &dropped) == 3 && dropped == 2);
    CHECK(pole_kind(lambda[0], 0.1) == POLE_PAIR && pole_kind(lambda[1], 0.1) == POLE_NEGATIVE &&
          pole_kind(lambda[2], 0.1) == POLE_REAL);
    CHECK(poles_order(lambda, 3, 0.1) == 4);
    CHECK(cimag(multiplier_of(lambda[1], 0.1)) == 0);
}

/* ---- rank ---- */

TEST(every_rank_rule_gives_its_definition_on_hc5s_singular_values)
{
    /* s / s1 as published for 0.98^t cos t + 0.5 0.95^t cos(2t + .4) + noise, 11 columns: r = 2, 2,
     * 5, 10 by sums, 2, 2, 2, 3 by squares */
    const double s[11] = { 1,      0.333,  0.0434, 0.0075, 0.0035, 0.0030,
                           0.0027, 0.0024, 0.0021, 0.0018, 0.0014 };
    const struct {
        double energy;
        int sums, squares;
    } cases[] = { { 0.9, 2, 2 }, { 0.95, 2, 2 }, { 0.99, 5, 2 }, { 0.999, 10, 3 } };

    for (int i = 0; i < 4; i++) {
        struct rank_options sums = { .rule = RANK_ENERGY, .energy = cases[i].energy },
                            squares = { .rule = RANK_ENERGY_SQUARED, .energy = cases[i].energy };
        CHECK(rank_estimate(s, 11, 16, 11, &sums) == cases[i].sums);
        CHECK(rank_estimate(s, 11, 16, 11, &squares) == cases[i].squares);
    }
    CHECK(rank_estimate(s, 11, 16, 11,
                        &(struct rank_options){ .rule = RANK_THRESHOLD, .threshold = 0.005 }) == 4);
    CHECK(rank_estimate(s, 11, 16, 11, &(struct rank_options) { .rule = RANK_FIXED, .fixed = 7 }) ==
          7);
    CHECK(rank_estimate(s, 11, 16, 11, &(struct rank_options){ .rule = RANK_FIXED, .fixed = 70 }) ==
          11);
}

TEST(clean_singular_values_have_an_exact_rank_by_every_rule_and_zeros_have_none)
{
    double s[40] = { 3e5, 2e3, 4, 0.1 }, zeros[5] = { 0 };

    for (int i = 4; i < 40; i++)
        s[i] = 3e5 * DBL_EPSILON * (1 + 1.0 / i);
    for (int rule = RANK_AUTO; rule < RANK_RULE_COUNT; rule++) {
        struct rank_options opt = { .rule = rule, .fixed = 4, .energy = 1 - 1e-14 };
        CHECK(rank_estimate(s, 40, 60, 40, &opt) == 4);
        CHECK(rank_estimate(zeros, 5, 9, 5, &opt) == 0);
    }
}

/* ---- hankel, fold ---- */

static struct matrix filled(int m, int n, double *x)
{
    for (int j = 0; j < n; j++)
        for (int i = 0; i < m; i++)
            x[i + j * m] = sin(1 + i + 7.3 * j * i + j);
    return (struct matrix) { m, n, m, x };
}

TEST(the_hankel_pair_is_equation_14_and_its_products_are_the_matrixs)
{
    const int shifts[] = { 1, 3, 5 };
    double y[60], h0[8 * 9], h1[8 * 9], x[9], u[8], product[9], direct;
    struct matrix Y = filled(30, 2, y);

    for (int c = 0; c < 3; c++) {
        struct hankel h = { &Y, 2, 4, shifts[c] == 1 ? 9 : shifts[c] == 3 ? 8 : 4, shifts[c] };
        struct hankel later = { &Y, 2 + h.shift, 4, h.columns, h.shift };
        struct matrix H0 = { 8, h.columns, 8, h0 }, H1 = { 8, h.columns, 8, h1 };
        CHECK(hankel_check(&h, NULL) == MODAL_OK);
        hankel_form(&h, &H0), hankel_form(&later, &H1);
        for (int i = 0; i < 4; i++)
            for (int l = 0; l < h.columns; l++)
                for (int s = 0; s < 2; s++) {
                    CHECK(h0[s * 4 + i + l * 8] == y[2 + i + l * shifts[c] + s * 30]);
                    CHECK(h1[s * 4 + i + l * 8] == y[2 + i + (l + 1) * shifts[c] + s * 30]);
                }
        for (int l = 0; l < 9; l++)
            x[l] = cos(l);
        hankel_apply(&later, x, u);
        for (int i = 0; i < 8; i++) {
            direct = 0;
            for (int l = 0; l < h.columns; l++)
                direct += h1[i + l * 8] * x[l];
            CHECK_NEAR(u[i], direct, 1e-14);
        }
        hankel_apply_transpose(&h, u, product);
        for (int l = 0; l < h.columns; l++) {
            direct = 0;
            for (int i = 0; i < 8; i++)
                direct += h0[i + l * 8] * u[i];
            CHECK_NEAR(product[l], direct, 1e-14);
        }
    }
}

TEST(a_pair_that_does_not_fit_is_refused_by_the_option_at_fault)
{
    double y[20];
    struct matrix Y = filled(20, 1, y);
    struct modal_error err;

    CHECK(hankel_check(&(struct hankel) { &Y, 0, 20, 1, 1 }, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "rows");
    CHECK(hankel_check(&(struct hankel) { &Y, 0, 5, 16, 1 }, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "columns");
    CHECK(hankel_check(&(struct hankel) { &Y, 0, 5, 15, 1 }, &err) == MODAL_OK);
    CHECK(hankel_check(&(struct hankel) { &Y, 1, 5, 15, 1 }, &err) == MODAL_BAD_INPUT);
}

TEST(folding_puts_sample_k_plus_l_p_into_row_l)
{
    double y[46];
    struct matrix Y = filled(23, 2, y), F;

    CHECK(fold(&Y, 5, &F, NULL) == MODAL_OK);
    CHECK(F.m == 4 && F.n == 10);
    for (int s = 0; s < 2; s++)
        for (int k = 0; k < 5; k++)
            for (int l = 0; l < 4; l++)
                CHECK(F.x[l + (k + 5 * s) * 4] == y[k + 5 * l + 23 * s]);
    free(F.x);
}

/* ---- transition: the four matrices at small size ---- */

/* Three exponents in one signal, rank 5 (two pairs and one real). */
static void three_modes(double *y, int K)
{
    for (int k = 0; k < K; k++)
        y[k] = exp(-0.02 * k) * cos(0.7 * k) + 0.6 * exp(-0.05 * k) * sin(1.9 * k + 0.3) +
               0.4 * exp(-0.1 * k);
}

/* C = A B, dense. */
static void multiply(int m, int k, int n, const double *A, const double *B, double *C)
{
    for (int i = 0; i < m; i++)
        for (int j = 0; j < n; j++) {
            C[i + j * m] = 0;
            for (int l = 0; l < k; l++)
                C[i + j * m] += A[i + l * m] * B[l + j * k];
        }
}

/* The r eigenvalues of largest modulus must agree with the truth, the rest must be zero. */
static void check_spectrum(double *A, int n, const double complex *rho, int r, double tolerance)
{
    struct matrix M = { n, n, n, A };
    double complex w[32];
    int zeros = 0;

    CHECK(eigen_general(&M, w, NULL, NULL, NULL) == MODAL_OK);
    for (int j = 0; j < r; j++) {
        double nearest = HUGE_VAL;
        for (int i = 0; i < n; i++)
            nearest = fmin(nearest, cabs(w[i] - rho[j]));
        CHECK_NEAR(nearest, 0, tolerance);
    }
    for (int i = 0; i < n; i++)
        zeros += cabs(w[i]) < tolerance;
    CHECK(zeros == n - r);
}

TEST(the_four_matrices_share_the_multipliers_and_q_and_b_add_only_zeros)
{
    enum { M = 9, N = 7, R = 5 };
    double y[40], h0[M * N], h1[M * N], copy[M * N], s[N], u[M * N], vt[N * N];
    double vs[N * R], svu[N * M], usu[M * M], Q[M * M], B[N * N], Qh[R * R], Bh[R * R], uth1[R * N];
    struct matrix Y = { 40, 1, 40, y }, H0 = { M, N, M, h0 }, H1 = { M, N, M, h1 },
                  C = { M, N, M, copy }, U = { M, N, M, u }, VT = { N, N, N, vt };
    struct hankel h = { &Y, 0, M, N, 1 }, later = { &Y, 1, M, N, 1 };
    const double complex rho[R] = { cexp(-0.02 + 0.7 * I), cexp(-0.02 - 0.7 * I),
                                    cexp(-0.05 + 1.9 * I), cexp(-0.05 - 1.9 * I), exp(-0.1) };

    three_modes(y, 40);
    hankel_form(&h, &H0), hankel_form(&later, &H1);
    memcpy(copy, h0, sizeof h0);
    CHECK(svd_thin(&C, s, &U, &VT, NULL) == MODAL_OK);
    for (int i = 0; i < N; i++)                                   /* V S^{-1} */
        for (int j = 0; j < R; j++)
            vs[i + j * N] = vt[j + i * N] / s[j];
    for (int i = 0; i < N; i++)                                   /* V S^{-1} U^T = H0^+ */
        for (int j = 0; j < M; j++) {
            svu[i + j * N] = 0;
            for (int l = 0; l < R; l++)
                svu[i + j * N] += vs[i + l * N] * u[j + l * M];
        }
    multiply(M, N, M, h1, svu, Q);                                /* (16) */
    multiply(N, M, N, svu, h1, B);                                /* (20) */
    for (int i = 0; i < R; i++)
        for (int j = 0; j < N; j++) {
            uth1[i + j * R] = 0;
            for (int l = 0; l < M; l++)
                uth1[i + j * R] += u[l + i * M] * h1[l + j * M];
        }
    multiply(R, N, R, uth1, vs, Qh);                              /* (17) */
    for (int i = 0; i < R; i++)
        for (int j = 0; j < R; j++)
            Bh[i + j * R] = Qh[i + j * R] * s[j] / s[i];          /* (21) */
    memcpy(usu, Q, sizeof Q);
    check_spectrum(usu, M, rho, R, 1e-9);
    check_spectrum(B, N, rho, R, 1e-9);
    check_spectrum(Qh, R, rho, R, 1e-9);
    check_spectrum(Bh, R, rho, R, 1e-9);
    for (int method = IDENTIFY_AUTO; method < IDENTIFY_METHOD_COUNT; method++) {
        struct projection p;
        double complex lambda[R];
        int count, dropped;
        CHECK(projection_make(&h, R, &p, NULL) == MODAL_OK);
        CHECK(projection_poles(&p, method, R, 1, lambda, &count, &dropped, NULL) == MODAL_OK &&
              count == 3);
        for (int i = 0; i < 3; i++) {
            double nearest = HUGE_VAL;
            for (int j = 0; j < R; j++)
                nearest = fmin(nearest, cabs(multiplier_of(lambda[i], 1) - rho[j]));
            CHECK_NEAR(nearest, 0, 1e-11);
        }
        projection_done(&p);
    }
}

TEST(a_rank_without_a_singular_value_is_refused)
{
    const double s[2] = { 1, 0 }, G[4] = { 1, 0, 0, 1 };
    struct transition t = { 2, s, G };
    double complex rho[3] = { 7, 7, 7 };

    CHECK(transition_multipliers(&t, IDENTIFY_AUTO, 2, rho, NULL) == MODAL_BAD_INPUT);
    CHECK(transition_multipliers(&t, IDENTIFY_AUTO, 3, rho, NULL) == MODAL_BAD_INPUT);
    CHECK(rho[0] == 7);
}

/* Prony's method: x[k + n] = sum a_i x[k + i], the roots of z^n - sum a_i z^i.  It is B with m = n
 * = the order: then H0 is square and B = H0^{-1} H1 is the companion matrix of exactly these a_i
 * (the paper's special case). */
TEST(pronys_method_is_the_square_autoregressive_case)
{
    enum { N = 4 };
    double y[2 * N], h0[N * N], h1[N * N], inverse[N * N], B[N * N], s[N], u[N * N], vt[N * N];
    struct matrix Y = { 2 * N, 1, 2 * N, y }, H0 = { N, N, N, h0 }, H1 = { N, N, N, h1 },
                  U = { N, N, N, u }, VT = { N, N, N, vt };
    struct hankel h = { &Y, 0, N, N, 1 }, later = { &Y, 1, N, N, 1 };
    const double complex rho[2] = { 0.95 * cexp(0.8 * I), 1.02 * cexp(1.7 * I) };
    /* (z - rho1)(z - rho1*)(z - rho2)(z - rho2*) = z^4 - a3 z^3 - ... */
    const double p1 = -2 * creal(rho[0]), q1 = 0.95 * 0.95, p2 = -2 * creal(rho[1]),
                 q2 = 1.02 * 1.02;
    const double a[N] = { -q1 * q2, -(p1 * q2 + p2 * q1), -(q1 + q2 + p1 * p2), -(p1 + p2) };

    for (int k = 0; k < 2 * N; k++)
        y[k] = creal(cpow(rho[0], k)) + 0.7 * cimag((0.3 + I) * cpow(rho[1], k));
    hankel_form(&h, &H0), hankel_form(&later, &H1);
    CHECK(svd_thin(&H0, s, &U, &VT, NULL) == MODAL_OK);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            inverse[i + j * N] = 0;
            for (int l = 0; l < N; l++)
                inverse[i + j * N] += vt[l + i * N] / s[l] * u[j + l * N];
        }
    multiply(N, N, N, inverse, h1, B);
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < N - 1; j++)
            CHECK_NEAR(B[i + j * N], i == j + 1, 1e-12);         /* a shift */
        CHECK_NEAR(B[i + (N - 1) * N], a[i], 1e-12);             /* Prony's coefficients */
    }
}

/* The Poincare map: with p samples a period and one row, H1 = Phi H0 on the states at one phase; n
 * signals that are the states give Phi itself. */
TEST(the_poincare_map_is_the_case_of_one_row_a_state_and_one_period_a_column)
{
    enum { P = 5, N = 2, L = 6 };
    const double Phi[4] = { 0.9, -0.4, 0.5, 0.7 };   /* columns (0.9, -0.4), (0.5, 0.7) */
    double y[2 * P * (L + 1)], x[2] = { 1, -0.3 };
    struct matrix Y = { P * (L + 1), 2, P * (L + 1), y };
    struct hankel h = { &Y, 0, 1, L, P };
    struct projection p;
    double complex lambda[2];
    double trace = 1.6, det = 0.9 * 0.7 + 0.4 * 0.5;
    int count, dropped;

    for (int l = 0; l <= L; l++) {
        double next[2] = { Phi[0] * x[0] + Phi[2] * x[1], Phi[1] * x[0] + Phi[3] * x[1] };
        for (int k = 0; k < P; k++)   /* other phases: anything periodic times the state */
            y[l * P + k] = x[0] * (1 + k) - k * x[1],
                      y[l * P + k + P * (L + 1)] = x[1] + 0.1 * k * x[0];
        x[0] = next[0], x[1] = next[1];
    }
    CHECK(projection_make(&h, 2, &p, NULL) == MODAL_OK);
    CHECK(projection_poles(&p, IDENTIFY_PARTIAL_FLOQUET, 2, 1, lambda, &count, &dropped, NULL) ==
              MODAL_OK &&
          count == 1);
    CHECK_NEAR(2 * creal(multiplier_of(lambda[0], 1)), trace, 1e-13);
    CHECK_NEAR(pow(cabs(multiplier_of(lambda[0], 1)), 2), det, 1e-13);
    projection_done(&p);
}

/* ---- pod ---- */

static void check_pod(int L, int S)
{
    double *y = malloc(sizeof *y * L * S), worst = 0;
    struct matrix Y = { L, S, L, y };
    struct pod p;

    for (int c = 0; c < S; c++)                                  /* rank 3: three time functions */
        for (int l = 0; l < L; l++)
            y[l + c * L] = cos(0.1 * c) * sin(0.3 * l) + 1e-3 * sin(0.5 * c) * cos(0.7 * l) +
                           1e-6 * cos(1.7 * c + 1) * sin(1.1 * l + 1);
    CHECK(pod_reduce(&Y, &(struct pod_options) { 0 }, &p, NULL) == MODAL_OK);
    CHECK(p.count >= 3 && p.count <= 5);
    for (int c = 0; c < S; c++)
        for (int l = 0; l < L; l++) {
            double sum = 0;
            for (int i = 0; i < p.count; i++)
                sum += p.signals.x[l + i * L] * p.modes.x[c + i * S];
            worst = fmax(worst, fabs(sum - y[l + c * L]));
        }
    CHECK_NEAR(worst, 0, 1e-13);
    pod_done(&p);
    CHECK(pod_reduce(&Y, &(struct pod_options){ .rank = 2 }, &p, NULL) == MODAL_OK && p.count == 2);
    pod_done(&p);
    CHECK(pod_reduce(&Y, &(struct pod_options) { .energy = 0.9 }, &p, NULL) == MODAL_OK &&
          p.count == 1);
    pod_done(&p);
    free(y);
}

/* Weights are those of a record whose columns were multiplied before. */
static void check_weights(int L, int S)
{
    double *y = malloc(sizeof *y * 2 * (size_t)L * S), *z = y + (size_t)L * S, weight[16];
    struct matrix Y = { L, S, L, y }, Z = { L, S, L, z };
    struct random r = { 29 };
    struct pod p, q;

    for (int c = 0; c < S; c++) {
        weight[c] = pow(10, c % 3 - 1);
        for (int l = 0; l < L; l++) {
            y[l + c * L] = cos(0.3 * c) * sin(0.3 * l) + sin(0.5 * c) * cos(0.7 * l)
                         + 1e-2 * random_normal(&r);
            z[l + c * L] = y[l + c * L] * weight[c];
        }
    }
    CHECK(pod_reduce(&Y, &(struct pod_options) { .weight = weight }, &p, NULL) == MODAL_OK);
    CHECK(pod_reduce(&Z, &(struct pod_options) { 0 }, &q, NULL) == MODAL_OK);
    CHECK(p.count == q.count && p.count >= 2);
    for (int i = 0; i < p.count; i++) {
        double sum = 0, all = 0;
        CHECK_NEAR(p.s[i], q.s[i], 1e-12 * q.s[0]);
        for (int l = 0; l < L; l++) {
            sum += p.signals.x[l + i * L] * q.signals.x[l + i * L];
            all += q.signals.x[l + i * L] * q.signals.x[l + i * L];
        }
        CHECK_NEAR(fabs(sum) / all, 1, 1e-9);
    }
    for (int l = 0; l < L * S; l++)
        CHECK(z[l] == y[l] * weight[l / L]);             /* both are as they were */
    pod_done(&p), pod_done(&q);
    free(y);
}

TEST(weighed_proper_orthogonal_signals_are_those_of_weighed_channels)
{
    check_weights(500, 12);
    check_weights(40000, 12);
}

TEST(proper_orthogonal_signals_rebuild_the_channels_dense_and_by_lanczos)
{
    check_pod(50, 12);
    check_pod(40000, 12);
    check_pod(150, 120);
    check_pod(100, 300);
}

/* ---- synthesis ---- */

TEST(the_synthesis_gives_back_the_coefficients_of_every_kind_of_pole)
{
    const double tau = 0.5;
    const double complex lambda[3] = { CMPLX(-0.1, 1.3), -0.4, CMPLX(0.05, M_PI / tau) };
    double y[40], fit[40];
    struct matrix Y = { 20, 2, 20, y }, F = { 20, 2, 20, fit };
    struct synthesis s;

    for (int l = 0; l < 20; l++)
        for (int c = 0; c < 2; c++)
            y[l + 20 * c] = creal(CMPLX(1.2 + c, -0.7) * cexp(lambda[0] * tau * l)) +
                            (0.3 - c) * exp(-0.2 * l) + 0.9 * (l % 2 ? -1 : 1) * exp(0.025 * l);
    CHECK(synthesis_fit(lambda, 3, tau, &Y, &F, &s, NULL) == MODAL_OK);
    CHECK(s.order == 4 && s.rank == 4);
    for (int c = 0; c < 2; c++) {
        CHECK_NEAR(cabs(s.coefficient[3 * c] - CMPLX(1.2 + c, -0.7)), 0, 1e-13);
        CHECK_NEAR(creal(s.coefficient[1 + 3 * c]), 0.3 - c, 1e-13);
        CHECK_NEAR(creal(s.coefficient[2 + 3 * c]) * exp(-s.reference[2]), 0.9, 1e-13);
    }
    CHECK_NEAR(s.residual, 0, 1e-13);
    for (int i = 0; i < 40; i++)
        CHECK_NEAR(fit[i], y[i], 1e-13);
    synthesis_done(&s);
}

/* Long enough that no basis is formed; rows that fill no block, too. */
TEST(the_synthesis_of_a_long_record_gives_back_the_coefficients_of_every_kind_of_pole)
{
    enum { LONG = 40017 };
    static double y[2 * LONG], fit[2 * LONG];
    const double tau = 0.5;
    const double complex lambda[4] = { CMPLX(-0.0001, 1.3), -0.0004, CMPLX(0.0005, M_PI / tau),
                                       CMPLX(0.0002, 2.9) };
    struct matrix Y = { LONG, 2, LONG, y }, F = { LONG, 2, LONG, fit };
    double G[36], last = tau * (LONG - 1), sum = 0;
    struct synthesis s;

    for (int l = 0; l < LONG; l++) {
        for (int c = 0; c < 2; c++)
            y[l + LONG * c] = creal(CMPLX(1.2 + c, -0.7) * cexp(lambda[0] * tau * l))
                + (0.3 - c) * exp(-0.0002 * l)
                + 0.9 * (l % 2 ? -1 : 1) * exp(0.00025 * l - 0.0005 * last)
                + creal(CMPLX(c, 0.4) * cexp(lambda[3] * tau * l - 0.0002 * last));
        sum += pow(creal(cexp(lambda[3] * tau * l - 0.0002 * last)), 2);
    }
    CHECK(synthesis_fit(lambda, 4, tau, &Y, &F, &s, NULL) == MODAL_OK);
    CHECK(s.order == 6 && s.rank == 6);
    for (int c = 0; c < 2; c++) {
        CHECK_NEAR(cabs(s.coefficient[4 * c] - CMPLX(1.2 + c, -0.7)), 0, 1e-10);
        CHECK_NEAR(creal(s.coefficient[1 + 4 * c]), 0.3 - c, 1e-10);
        CHECK_NEAR(creal(s.coefficient[2 + 4 * c]), 0.9, 1e-10);
        CHECK_NEAR(cabs(s.coefficient[3 + 4 * c] - CMPLX(c, 0.4)), 0, 1e-10);
    }
    CHECK_NEAR(s.residual, 0, 1e-8);
    for (int i = 0; i < 2 * LONG; i++)
        CHECK_NEAR(fit[i], y[i], 1e-9);
    synthesis_products(lambda, 4, tau, LONG, G);
    CHECK_NEAR(G[4 + 4 * 6] / sum, 1, 1e-10);
    synthesis_done(&s);
}

/* Sums of powers are sums over rows, whether they decay, grow past overflow, alternate, or lie so
 * near each other, or so near whole turns a row, that their ratios are 1 to ten digits. */
TEST(products_of_the_columns_of_poles_are_sums_over_their_rows)
{
    enum { ROWS = 3001, POLES = 7, ORDER = 12 };
    const double complex row[POLES] = { CMPLX(-0.013, 0.7), CMPLX(-0.013, 0.7 + 1e-10), -2e-5,
                                        CMPLX(0.6, 2.1), CMPLX(-0.001, M_PI), CMPLX(1e-4, 3.14),
                                        CMPLX(-0.4, 3.0415) };
    const double tau = 0.017;
    static double column[ORDER * ROWS], G[ORDER * ORDER];
    double complex lambda[POLES];
    int n = 0;

    for (int j = 0; j < POLES; j++) {
        long double a = creal(row[j]), b = cimag(row[j]);
        lambda[j] = row[j] / tau;
        for (int l = 0; l < ROWS; l++) {
            long double size = expl(a * (a > 0 ? l - (ROWS - 1) : l));
            column[l + n * ROWS] = (double)(size * (b == M_PI ? 1 - 2 * (l % 2) : cosl(b * l)));
            column[l + (n + 1) * ROWS] = (double)(-size * sinl(b * l));
            if (l + 1 == ROWS)
                n += j == 2 || j == 4 ? 1 : 2;
        }
    }
    CHECK(n == ORDER);
    synthesis_products(lambda, POLES, tau, ROWS, G);
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < ORDER; j++) {
            long double sum = 0, x = 0, y = 0;
            for (int l = 0; l < ROWS; l++) {
                sum += (long double)column[l + i * ROWS] * column[l + j * ROWS];
                x += (long double)column[l + i * ROWS] * column[l + i * ROWS];
                y += (long double)column[l + j * ROWS] * column[l + j * ROWS];
            }
            /* lambda tau is rounded, and turned by that in each row */
            CHECK_NEAR(G[i + ORDER * j] / (double)sqrtl(x * y), (double)(sum / sqrtl(x * y)),
                       4 * ROWS * DBL_EPSILON);
        }
}

/* What one pole has, two alike have together, and no number overflows. */
TEST(of_two_poles_that_are_one_a_long_record_leaves_what_it_leaves_of_one)
{
    enum { LONG = 40000 };
    static double y[LONG];
    const double complex lambda[2] = { CMPLX(-0.0001, 1.3), CMPLX(-0.0001, 1.3) };
    struct matrix Y = { LONG, 1, LONG, y };
    struct synthesis s;

    for (int l = 0; l < LONG; l++)
        y[l] = creal(CMPLX(1.2, -0.7) * cexp(lambda[0] * l));
    CHECK(synthesis_fit(lambda, 2, 1, &Y, NULL, &s, NULL) == MODAL_OK);
    CHECK(s.order == 4 && s.rank == 2);
    CHECK_NEAR(cabs(s.coefficient[0] + s.coefficient[1] - CMPLX(1.2, -0.7)), 0, 1e-10);
    CHECK_NEAR(s.residual, 0, 1e-8);
    synthesis_done(&s);
}

/* Two multipliers 1 +- 1e-6: normal equations leave 2e-6 of error, method.md; SVD of the scaled
 * basis 2e-12 times modest. */
TEST(nearly_equal_multipliers_keep_their_coefficients)
{
    const double complex lambda[2] = { 1e-6, -1e-6 };
    double y[12];
    struct matrix Y = { 12, 1, 12, y };
    struct synthesis s;

    for (int l = 0; l < 12; l++)
        y[l] = 1.7 * exp(1e-6 * l) - 0.6 * exp(-1e-6 * l);
    CHECK(synthesis_fit(lambda, 2, 1, &Y, NULL, &s, NULL) == MODAL_OK);
    CHECK_NEAR(creal(s.coefficient[0]) * exp(-s.reference[0]), 1.7, 1e-9);
    CHECK_NEAR(creal(s.coefficient[1]), -0.6, 1e-9);
    synthesis_done(&s);
}

TEST(growth_by_1e300_over_the_record_does_not_overflow_the_basis)
{
    const double complex lambda[1] = { 57.0 };
    double y[12];
    struct matrix Y = { 12, 1, 12, y };
    struct synthesis s;

    for (int l = 0; l < 12; l++)
        y[l] = exp(57.0 * (l - 11));
    CHECK(synthesis_fit(lambda, 1, 1, &Y, NULL, &s, NULL) == MODAL_OK);
    CHECK_NEAR(creal(s.coefficient[0]), 1, 1e-13);
    CHECK_NEAR(s.reference[0], 57.0 * 11, 1e-12 * 627);
    synthesis_done(&s);
}

/* ---- harmonics ---- */

TEST(the_harmonics_of_a_periodic_coefficient_are_its_fourier_series)
{
    enum { P = 16 };
    const double T = 2.5;
    /* k = 0, -2, 3 */
    const double complex lambda = CMPLX(-0.2, 0.9), g[3] = { 0.4, CMPLX(0.5, 0.7), -0.1 };
    double complex b[P];
    struct identify_harmonic list[HARMONICS_REPORTED];
    int count, k;
    double ratio;

    for (int n = 0; n < P; n++)
        b[n] = cexp(lambda * T * n / P) * (g[0] + g[1] * cexp(-2 * M_PI * I * 2 * n / P) +
                                           g[2] * cexp(2 * M_PI * I * 3 * n / P));
    CHECK(harmonics_of(b, 1, P, 1, lambda, T, list, &count, &k, &ratio, NULL) == MODAL_OK);
    CHECK(k == -2 && list[0].k == -2 && list[1].k == 0 && list[2].k == 3);
    CHECK_NEAR(list[0].magnitude, hypot(0.5, 0.7), 1e-14);
    CHECK_NEAR(list[2].magnitude, 0.1, 1e-14);
    CHECK_NEAR(ratio, 0.4 / hypot(0.5, 0.7), 1e-13);
}

/* phi = pi: |g_k| = |g_{-1-k}|, one frequency; the larger k is named and the runner-up is the next
 * other frequency. */
TEST(tied_harmonics_of_a_real_multiplier_name_the_least_frequency_once)
{
    struct identify_harmonic list[] = { { -1, 1 }, { 1, 0.25 }, { 0, 1 }, { -2, 0.25 } };
    struct identify_harmonic equal[] = { { 2, 1 }, { -1, 1 } };
    int k;
    double ratio;

    harmonics_choose(list, 4, CMPLX(0.1, M_PI), 1, &k, &ratio);
    CHECK(k == 0);
    CHECK_NEAR(ratio, 0.25, 1e-15);
    harmonics_choose(equal, 2, CMPLX(0.1, 0.4), 1, &k, &ratio);
    CHECK(k == -1);                                              /* |0.4 - 6.28| < |0.4 + 12.57| */
    CHECK_NEAR(ratio, 1, 0);
}

/* ---- record ---- */

static struct batch two_channels(double *x, int K, double dt)
{
    for (int k = 0; k < K; k++) {
        x[2 * k] = 1e200 * exp(-0.3 * k * dt) * cos(2 * M_PI * 3.2 * k * dt);
        x[2 * k + 1] = 1e-200 * exp(-0.3 * k * dt) * sin(2 * M_PI * 3.2 * k * dt);
    }
    return (struct batch) { .samples = K, .channels = 2, .signals = x, .dt = dt };
}

TEST(a_record_has_unit_rms_whatever_the_units_and_keeps_its_scale)
{
    double x[800];
    struct batch b = two_channels(x, 400, 0.01);
    struct record r;

    CHECK(record_make(&b, &(struct identify_options) { 0 }, &r, NULL) == MODAL_OK);
    for (int c = 0; c < 2; c++) {
        CHECK_NEAR(safe_norm(r.Y.x + c * r.Y.ld, 400), 20, 1e-12);
        CHECK_NEAR(r.scale[c] * r.Y.x[7 + c * r.Y.ld] / x[14 + c], 1, 1e-14);
    }
    record_done(&r);
}

TEST(a_window_takes_its_samples_and_refuses_what_is_outside)
{
    double x[800];
    struct batch b = two_channels(x, 400, 0.01);
    struct identify_options opt = { .window = { 0.5, 1.5 } }, late = { .window = { 5, 6 } },
                            thin = { .window = { 1, 1.05 } };
    struct modal_error err;
    struct record r;

    CHECK(record_make(&b, &opt, &r, NULL) == MODAL_OK);
    CHECK(r.Y.m == 101);
    CHECK_NEAR(r.t0, 0.5, 1e-15);
    CHECK_NEAR(r.scale[0] * r.Y.x[0] / x[100], 1, 1e-14);
    record_done(&r);
    CHECK(record_make(&b, &late, &r, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "window");
    CHECK(record_make(&b, &thin, &r, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "window");
}

/* What was filtered, mixed and decimated keeps its exponent: Re unchanged, Im moved by a known
 * frequency. */
TEST(a_band_keeps_a_light_pair_in_a_long_record_and_leaves_out_the_rest)
{
    enum { K = 40000 };
    double *x = malloc(sizeof *x * K);
    const double complex a = CMPLX(-3, 2 * M_PI * 3615), b = CMPLX(-1.55, 2 * M_PI * 3621);
    struct batch batch = { .samples = K, .channels = 1, .signals = x, .dt = 1 / 44100.0 };
    struct identify_options opt = { .band = { 3500, 3700 } };
    struct identify_result r;

    for (int k = 0; k < K; k++) {
        double t = k / 44100.0;
        x[k] = exp(creal(a) * t) * cos(cimag(a) * t) +
               0.7 * exp(creal(b) * t) * cos(cimag(b) * t + 1) +
               3 * exp(-2 * t) * cos(2 * M_PI * 1309 * t) +
               2 * exp(-4 * t) * cos(2 * M_PI * 6738 * t);
    }
    CHECK(modal_identify(&batch, &opt, &r, NULL) == MODAL_OK);
    CHECK(r.decimation > 20 && r.mode_count == 2);
    for (int i = 0; i < 2; i++) {
        double off = fmin(cabs(r.modes[i].exponent - a), cabs(r.modes[i].exponent - b));
        /* the stop band lets 90 dB through: 3e-5 of the others' amplitude, over 0.9 s */
        CHECK(off < 1e-2);
    }
    /* over one sample as sent */
    CHECK_NEAR(cabs(r.modes[0].multiplier), exp(creal(r.modes[0].exponent) / 44100), 1e-12);
    identify_result_done(&r);
    free(x);
}

TEST(a_difference_over_a_fraction_of_a_sample_removes_the_orbit_and_keeps_the_exponent)
{
    enum { K = 600 };
    double x[K], dt = 0.02, T = 1.104999;
    struct batch batch = { .samples = K, .channels = 1, .signals = x, .dt = dt, .period = T };
    struct identify_options opt = { .period = -1, .difference = true };
    struct identify_result r;

    for (int k = 0; k < K; k++)
        x[k] = 5 + cos(2 * M_PI / T * k * dt) + 0.3 * sin(4 * M_PI / T * k * dt) +
               0.1 * exp(-0.28 * k * dt) * cos(6.16 * k * dt);
    CHECK(modal_identify(&batch, &opt, &r, NULL) == MODAL_OK);
    CHECK(r.mode_count >= 1);
    /* Lagrange on ten points leaves (omega dt)^10 = 1e-6 of the orbit at most */
    CHECK_NEAR(creal(r.modes[0].exponent), -0.28, 1e-6);
    CHECK_NEAR(cimag(r.modes[0].exponent), 6.16, 1e-6);
    identify_result_done(&r);
}

TEST(detrending_removes_a_line_exactly)
{
    double x[100];
    struct batch batch = { .samples = 100, .channels = 1, .signals = x, .dt = 0.1 };
    struct identify_options opt = { .detrend = DETREND_LINEAR };
    struct record r;

    for (int k = 0; k < 100; k++)
        x[k] = 4 - 0.03 * k + (k % 2 ? 1e-3 : -1e-3);
    CHECK(record_make(&batch, &opt, &r, NULL) == MODAL_OK);
    for (int k = 0; k < 100; k++)
        CHECK_NEAR(fabs(r.Y.x[k]), 1, 0.05);
    record_done(&r);
}

/* ---- modes ---- */

TEST(phase_collinearity_is_one_for_a_line_and_zero_for_a_circle)
{
    const double complex line[3] = { CMPLX(1, 2), CMPLX(-0.5, -1), 0 },
                         circle[4] = { 1, I, -1, -I };

    CHECK_NEAR(modes_mpc(line, 3), 1, 1e-15);
    CHECK_NEAR(modes_mpc(circle, 4), 0, 1e-15);
}

TEST(shapes_come_in_the_channels_own_units_with_largest_component_one)
{
    enum { K = 200 };
    double x[3 * K];
    struct batch batch = { .samples = K, .channels = 3, .signals = x, .dt = 0.05 };
    struct identify_options opt = { .shapes = true };
    const double complex phi[3] = { 0.2, CMPLX(0, 4e3), -1e3 };
    struct identify_result r;

    for (int k = 0; k < K; k++)
        for (int c = 0; c < 3; c++)
            x[3 * k + c] = creal(phi[c] * cexp(CMPLX(-0.1, 5) * 0.05 * k));
    CHECK(modal_identify(&batch, &opt, &r, NULL) == MODAL_OK);
    CHECK(r.mode_count == 1 && r.modes[0].shape != NULL);
    for (int c = 0; c < 3; c++)
        CHECK_NEAR(cabs(r.modes[0].shape[c] - phi[c] / phi[1]), 0, 1e-12);
    CHECK(r.modes[0].shape[1] == 1);
    identify_result_done(&r);
}

/* Undamped at 60 samples a period the amplitude over whole periods is 1 / sqrt 2 of the peak, in
 * units of the channel's own rms: 1. */
TEST(amplitudes_are_rms_over_the_record_in_units_of_the_channels_rms)
{
    enum { K = 600 };
    double x[K];
    struct batch batch = { .samples = K, .channels = 1, .signals = x, .dt = 1 };
    struct identify_result r;

    for (int k = 0; k < K; k++)
        x[k] = 3 * cos(2 * M_PI * k / 60) + 4 * cos(2 * M_PI * k / 20 + 1);
    CHECK(modal_identify(&batch, NULL, &r, NULL) == MODAL_OK);
    CHECK(r.mode_count == 2);
    CHECK_NEAR(r.modes[0].amplitude, 0.8, 1e-12);
    CHECK_NEAR(r.modes[1].amplitude, 0.6, 1e-12);
    CHECK_NEAR(r.modes[0].energy, 0.64, 1e-12);
    CHECK(r.verdict == VERDICT_UNDECIDED);                      /* undamped: on the circle */
    identify_result_done(&r);
}

static bool cancel_now(void *context) { (void)context; return true; }

TEST(a_cancelled_identification_says_so_and_leaves_nothing)
{
    double x[200];
    struct batch batch = { .samples = 200, .channels = 1, .signals = x, .dt = 1 };
    struct identify_result r;
    struct identify_options opt = { .cancelled = cancel_now };

    for (int k = 0; k < 200; k++)
        x[k] = cos(0.3 * k);
    CHECK(modal_identify(&batch, &opt, &r, NULL) == MODAL_CANCELLED);
    CHECK(r.modes == NULL && r.stage_count == 0);
}

/* Twelve channels of one noise level, a third of which hear the motion fifty times weaker: scaled
 * to unit rms they are mostly noise.  The bars must be those of a fit that knows that the noise is
 * the same everywhere (the Cramer-Rao bound), not those of channels taken as equal. */
TEST(channels_that_hear_mostly_noise_cost_the_others_nothing)
{
    enum { L = 300, S = 12 };
    static double x[L * S], y[L * S];
    struct batch batch = { .samples = L, .channels = S, .signals = x, .dt = 0.05 };
    struct matrix Y = { L, S, L, y };
    struct refine_data data = { .Y = &Y, .tau = 0.05 };
    const double complex truth[2] = { CMPLX(-0.1, 6.2), CMPLX(-0.05, 14) };
    struct identify_result r;
    struct refined bound;
    uint32_t z = 7;

    for (int c = 0; c < S; c++)
        for (int l = 0; l < L; l++) {
            double t = 0.05 * l, size = c % 3 == 0 ? 0.02 : 1, noise = 0;
            for (int i = 0; i < 12; i++) {
                z = 1664525u * z + 1013904223u;
                noise += z / 4294967296.0 - 0.5;             /* sum of twelve: unit variance */
            }
            y[l + c * L] = x[l * S + c] = size *
                                              (creal(cexp(truth[0] * t + I * c)) +
                                               0.6 * creal(cexp(truth[1] * t + 2.0 * I * c * c))) +
                                          0.01 * noise;
        }
    CHECK(refine_poles(&data, truth, 2, NULL, &(struct refine_options) { .equal_noise = true },
                       &bound, NULL) == MODAL_OK);
    CHECK(modal_identify(&batch, NULL, &r, NULL) == MODAL_OK && r.mode_count == 2);
    for (int i = 0; i < 2; i++) {
        int j = fabs(cimag(r.modes[i].exponent) - 6.2) < 1 ? 0 : 1;
        CHECK(r.modes[i].std_re < 1.2 * bound.std_re[j] &&
              r.modes[i].std_re > 0.8 * bound.std_re[j]);
        CHECK_NEAR(creal(r.modes[i].exponent), creal(truth[j]), 5 * bound.std_re[j]);
        CHECK_NEAR(cimag(r.modes[i].exponent), cimag(truth[j]), 5 * bound.std_im[j]);
    }
    refined_done(&bound);
    identify_result_done(&r);
}
