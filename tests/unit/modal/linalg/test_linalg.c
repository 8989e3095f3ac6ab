/* test_linalg.c - the thin calls on LAPACK and the Golub-Kahan-Lanczos iteration */
/* Tests as well: eigen.c lanczos.c least_squares.c qr.c svd.c */
#include "check.h"
#include <complex.h>
#include <float.h>
#include <stdlib.h>
#include "modal/linalg/eigen.h"
#include "modal/linalg/lanczos.h"
#include "modal/linalg/least_squares.h"
#include "modal/linalg/qr.h"
#include "modal/linalg/svd.h"

static double uniform(uint32_t *z)
{
    *z = 1664525u * *z + 1013904223u;
    return *z / 4294967296.0 - 0.5;
}

static struct matrix random_matrix(int m, int n, int ld, uint32_t seed)
{
    struct matrix A = { m, n, ld, calloc((size_t)ld * n + 1, sizeof(double)) };

    for (int i = 0; i < ld * n; i++)
        A.x[i] = uniform(&seed);
    return A;
}

static double dot(int n, const double *a, const double *b)
{
    double sum = 0;
    for (int i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* Orthonormal factors of random matrices make A = Q1 diag(sigma) Q2^T with singular values known by
 * construction. */
static struct matrix with_singular_values(int m, int n, const double *sigma, int count)
{
    struct matrix P = random_matrix(m, count, m, 5), Q = random_matrix(n, count, n, 6),
                  A = random_matrix(m, n, m + 2, 7);

    CHECK(qr_orthonormal(&P, NULL, NULL) == MODAL_OK && qr_orthonormal(&Q, NULL, NULL) == MODAL_OK);
    for (int i = 0; i < m; i++)
        for (int j = 0; j < n; j++) {
            double sum = 0;
            for (int k = 0; k < count; k++)
                sum += P.x[i + k * m] * sigma[k] * Q.x[j + k * n];
            A.x[i + j * A.ld] = sum;
        }
    free(P.x);
    free(Q.x);
    return A;
}

static void check_svd(int m, int n, double scale)
{
    int k = m < n ? m : n;
    struct matrix A = random_matrix(m, n, m + 3, 11), B = random_matrix(m, n, m + 3, 11);
    struct matrix U = random_matrix(m, k, m + 1, 1), VT = random_matrix(k, n, k + 1, 2);
    double *s = calloc(k + 1, sizeof *s);

    for (int j = 0; j < n * A.ld; j++)
        A.x[j] *= scale, B.x[j] *= scale;
    CHECK(svd_thin(&A, s, &U, &VT, NULL) == MODAL_OK);
    for (int i = 0; i < m; i++)
        for (int j = 0; j < n; j++) {
            double sum = 0;
            for (int l = 0; l < k; l++)
                sum += U.x[i + l * U.ld] * (s[l] / scale) * VT.x[l + j * VT.ld];
            CHECK_NEAR(sum, B.x[i + j * B.ld] / scale, 100 * DBL_EPSILON);
        }
    free(A.x), free(B.x), free(U.x), free(VT.x), free(s);
}

TEST(an_svd_rebuilds_its_matrix_for_every_shape_and_scale)
{
    const int sizes[][2] = { { 1, 1 }, { 2, 1 }, { 1, 3 }, { 7, 4 }, { 4, 9 }, { 30, 30 } };

    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        check_svd(sizes[i][0], sizes[i][1], 1);
        check_svd(sizes[i][0], sizes[i][1], 1e-200);
        check_svd(sizes[i][0], sizes[i][1], 1e200);
    }
}

TEST(an_svd_refuses_what_is_not_finite)
{
    double x[4] = { 1, NAN, 0, 2 }, s[2] = { 7, 7 };
    struct matrix A = { 2, 2, 2, x };
    struct modal_error err;

    CHECK(svd_thin(&A, s, NULL, NULL, &err) == MODAL_BAD_INPUT);
    CHECK(s[0] == 7);
}

TEST(safe_norm_neither_overflows_nor_underflows)
{
    const double big[2] = { 3e200, -4e200 }, small[2] = { 3e-200, 4e-200 };

    CHECK_NEAR(safe_norm(big, 2) / 1e200, 5, 4 * DBL_EPSILON * 5);
    CHECK_NEAR(safe_norm(small, 2) / 1e-200, 5, 4 * DBL_EPSILON * 5);
    CHECK(safe_norm(big, 0) == 0);
}

/* The companion matrix of (x - 2.385)(x^2 - 2 x 0.3 + 0.3^2 + 0.7^2). */
TEST(eigenvalues_of_a_companion_matrix_are_the_roots)
{
    const double a = 2.385, re = 0.3, im = 0.7, b = 2 * re, c = -(re * re + im * im);
    double x[9] = { b + a, 1, 0, c - a * b, 0, 1, -a * c, 0, 0 }, condition[3];
    struct matrix A = { 3, 3, 3, x };
    double complex w[3], V[9];
    int real = -1;

    CHECK(eigen_general(&A, w, condition, V, NULL) == MODAL_OK);
    for (int i = 0; i < 3; i++)
        if (cimag(w[i]) == 0)
            real = i;
    CHECK(real >= 0);
    CHECK_NEAR(creal(w[real]), a, 20 * condition[real] * DBL_EPSILON * 3);
    for (int i = 0; i < 3; i++)
        if (cimag(w[i]) > 0) {
            CHECK_NEAR(creal(w[i]), re, 1e-14);
            CHECK_NEAR(cimag(w[i]), im, 1e-14);
            CHECK(w[i + 1] == conj(w[i]));
            /* a companion eigenvector is (w^2, w, 1) up to scale */
            CHECK_NEAR(cabs(V[i * 3] / V[i * 3 + 1] - w[i]), 0, 1e-14);
        }
}

TEST(a_symmetric_matrix_has_the_eigenvalues_of_its_construction)
{
    double x[4] = { 2, 1, 1, 2 }, w[2];
    struct matrix A = { 2, 2, 2, x };

    CHECK(eigen_symmetric(&A, w, NULL) == MODAL_OK);
    CHECK_NEAR(w[0], 1, 8 * DBL_EPSILON);
    CHECK_NEAR(w[1], 3, 8 * DBL_EPSILON);
    CHECK_NEAR(fabs(x[0]), sqrt(0.5), 8 * DBL_EPSILON);
}

TEST(qr_gives_back_the_matrix_and_orthonormal_columns)
{
    struct matrix A = random_matrix(9, 4, 11, 3), B = random_matrix(9, 4, 11, 3),
                  R = random_matrix(4, 4, 5, 4);

    CHECK(qr_orthonormal(&A, &R, NULL) == MODAL_OK);
    for (int j = 0; j < 4; j++) {
        for (int i = 0; i < 9; i++) {
            double sum = 0;
            for (int k = 0; k < 4; k++)
                sum += A.x[i + k * 11] * R.x[k + j * 5];
            CHECK_NEAR(sum, B.x[i + j * 11], 40 * DBL_EPSILON);
        }
        for (int k = 0; k < 4; k++)
            CHECK_NEAR(dot(9, A.x + j * 11, A.x + k * 11), j == k, 40 * DBL_EPSILON);
    }
    A.m = 3;
    CHECK(qr_triangle(&A, &R, NULL) == MODAL_BAD_INPUT);
    free(A.x), free(B.x), free(R.x);
}

/* A^T A = R^T R, and |R_ij| is that of any other QR of A: only the signs of rows are free. */
TEST(the_triangle_of_a_tall_matrix_read_by_panels_is_the_triangle_of_its_qr)
{
    static const int rows[] = { 561, 1000, 5003 };

    for (int t = 0; t < 3; t++) {
        int m = rows[t];
        struct matrix A = random_matrix(m, 7, m + 2, 5), Q = random_matrix(m, 7, m + 2, 5),
                      R = random_matrix(7, 7, 8, 1), S = random_matrix(7, 7, 8, 2);
        CHECK(qr_orthonormal(&Q, &S, NULL) == MODAL_OK && qr_triangle(&A, &R, NULL) == MODAL_OK);
        for (int j = 0; j < 7; j++)
            for (int i = 0; i < 7; i++)
                CHECK_NEAR(fabs(R.x[i + j * 8]), fabs(S.x[i + j * 8]),
                           20 * sqrt(m) * DBL_EPSILON * fabs(S.x[j + j * 8]));
        free(A.x), free(Q.x), free(R.x), free(S.x);
    }
}

/* Reflections keep inner products: with the first 4 of 7 columns a triangle, A^T A is that of what
 * stands in A's place, zeros below the triangle included; columns of any size, one of them zero. */
TEST(reflected_columns_keep_their_inner_products_and_leave_a_triangle)
{
    static const double scales[7] = { 1, 1e-160, 1e150, 0, 1, 1, 1e-3 };
    enum { M = 30, K = 4, N = 7 };
    struct matrix A = random_matrix(M, N, M + 2, 5), B = random_matrix(M, N, M + 2, 5);
    double work[N];

    for (int j = 0; j < N; j++)
        for (int i = 0; i < M + 2; i++)
            B.x[i + j * (M + 2)] *= scales[j];
    qr_reflect(&B, K, work);
    for (int j = 0; j < N; j++) {
        for (int i = j + 1; i < M && j < K; i++)
            CHECK(B.x[i + j * (M + 2)] == 0);
        for (int i = 0; i <= j; i++) {
            double si = scales[i] > 0 ? 1 / scales[i] : 0, sj = scales[j] > 0 ? 1 / scales[j] : 0,
                   sum = 0;
            for (int l = 0; l < M; l++)
                sum += B.x[l + i * (M + 2)] * si * (B.x[l + j * (M + 2)] * sj);
            CHECK_NEAR(sum, si * sj == 0 ? 0 : dot(M, A.x + i * (M + 2), A.x + j * (M + 2)),
                       40 * M * DBL_EPSILON);
        }
    }
    free(A.x), free(B.x);
}

/* b = A x exactly representable: columns scaled by 1e-150, 1, 1e150 must not lose x. */
TEST(least_squares_is_indifferent_to_the_scale_of_its_columns)
{
    const double scales[3] = { 1e-150, 1, 1e150 }, x[3] = { 2.385, -0.71, 1.3 };
    struct matrix A = random_matrix(8, 3, 8, 21), B = random_matrix(8, 1, 8, 1);

    for (int i = 0; i < 8; i++)
        B.x[i] = A.x[i] * x[0] + A.x[i + 8] * x[1] + A.x[i + 16] * x[2];
    for (int j = 0; j < 3; j++)
        for (int i = 0; i < 8; i++)
            A.x[i + j * 8] *= scales[j];
    CHECK(least_squares_solve(&A, &B, NULL) == MODAL_OK);
    for (int j = 0; j < 3; j++)
        CHECK_NEAR(B.x[j] * scales[j], x[j], 1e-12);
    free(A.x), free(B.x);
}

TEST(least_squares_gives_equal_columns_equal_shares_and_a_zero_column_nothing)
{
    double a[12] = { 1, 2, 3, 4, 1, 2, 3, 4, 0, 0, 0, 0 }, b[4] = { 3, 6, 9, 12 };
    struct matrix A = { 4, 3, 4, a }, B = { 4, 1, 4, b };

    CHECK(least_squares_solve(&A, &B, NULL) == MODAL_OK);
    CHECK_NEAR(b[0], 1.5, 1e-14);
    CHECK_NEAR(b[1], 1.5, 1e-14);
    CHECK(b[2] == 0);
}

static void check_lanczos(int m, int n, const double *sigma, int count, int wanted, int expected)
{
    struct matrix A = with_singular_values(m, n, sigma, count);
    struct matrix U = random_matrix(m, wanted, m + 1, 1),
                  VT = random_matrix(wanted, n, wanted + 1, 2);
    struct linear_operator op = dense_operator(&A);
    struct lanczos_options opt = { .wanted = wanted };
    struct lanczos_result result;
    double s[32], *z = calloc(m, sizeof *z), worst = 0;

    CHECK(lanczos_svd(&op, &opt, s, &U, &VT, &result, NULL) == MODAL_OK);
    CHECK(result.count == expected);
    for (int i = 0; i < result.count; i++) {
        CHECK_NEAR(s[i], i < count ? sigma[i] : 0, 200 * DBL_EPSILON * sigma[0]);
        for (int j = 0; j < result.count; j++) {
            double vv = 0;
            CHECK_NEAR(dot(m, U.x + i * U.ld, U.x + j * U.ld), i == j, 1e-13);
            for (int l = 0; l < n; l++)
                vv += VT.x[i + l * VT.ld] * VT.x[j + l * VT.ld];
            CHECK_NEAR(vv, i == j, 1e-13);
        }
        for (int l = 0; l < m; l++) {          /* A v = s u */
            z[l] = -s[i] * U.x[l + i * U.ld];
            for (int j = 0; j < n; j++)
                z[l] += A.x[l + j * A.ld] * VT.x[i + j * VT.ld];
            worst = fmax(worst, fabs(z[l]));
        }
    }
    CHECK_NEAR(worst, 0, 1e-13 * sigma[0]);
    free(A.x), free(U.x), free(VT.x), free(z);
}

TEST(lanczos_finds_singular_values_known_by_construction_tall_and_wide)
{
    const double sigma[8] = { 2.385, 1.1, 0.5, 3e-2, 1e-3, 1e-5, 1e-7, 1e-9 };

    check_lanczos(60, 25, sigma, 8, 5, 5);
    check_lanczos(25, 60, sigma, 8, 5, 5);
    check_lanczos(8, 8, sigma, 8, 8, 8);
}

/* A repeated singular value is found with its multiplicity because a breakdown is restarted. */
TEST(lanczos_finds_a_repeated_singular_value_as_often_as_it_occurs)
{
    const double sigma[5] = { 1.7, 1.7, 1.7, 0.4, 0.4 };

    check_lanczos(40, 30, sigma, 5, 5, 5);
    check_lanczos(30, 40, sigma, 5, 5, 5);
}

TEST(lanczos_goes_on_to_the_bits_that_it_has_from_the_start)
{
    enum { M = 40, N = 30 };
    struct matrix A = random_matrix(M, N, M, 9), VT = matrix_new(N, N), once = matrix_new(N, N);
    struct linear_operator op = dense_operator(&A);
    struct lanczos *run = NULL;
    struct lanczos_result result, all;
    double s[N], t[N];

    for (int wanted = 3; wanted <= N; wanted *= 2) {
        struct lanczos_options opt = { .wanted = wanted, .tolerance = HUGE_VAL };
        int before = run != NULL ? result.steps : 0;
        CHECK(lanczos_more(&run, &op, &opt, s, NULL, &VT, &result, NULL) == MODAL_OK);
        CHECK(lanczos_svd(&op, &opt, t, NULL, &once, &all, NULL) == MODAL_OK);
        CHECK(result.count == wanted && result.steps == all.steps && result.steps > before);
        CHECK(memcmp(s, t, sizeof *s * (size_t)wanted) == 0);
        for (int l = 0; l < N; l++)
            CHECK(memcmp(VT.x + l * N, once.x + l * N, sizeof *s * (size_t)wanted) == 0);
    }
    /* fewer than it has: nothing is stepped */
    CHECK(lanczos_more(&run, &op, &(struct lanczos_options) { .wanted = 2, .tolerance = HUGE_VAL },
                       s, NULL, NULL, &all, NULL) == MODAL_OK);
    CHECK(all.count == 2 && all.steps == result.steps);
    lanczos_free(run), lanczos_free(NULL);
    free(A.x), free(VT.x), free(once.x);
}

TEST(lanczos_stops_when_the_rank_is_exhausted)
{
    const double sigma[2] = { 1.7, 0.3 };
    struct matrix A = with_singular_values(50, 40, sigma, 2);
    struct linear_operator op = dense_operator(&A);
    struct lanczos_options opt = { .wanted = 10 };
    struct lanczos_result result;
    double s[10];

    CHECK(lanczos_svd(&op, &opt, s, NULL, NULL, &result, NULL) == MODAL_OK);
    CHECK(result.steps < 10);
    CHECK(result.count >= 2);
    CHECK_NEAR(s[0], 1.7, 1e-14);
    CHECK_NEAR(s[1], 0.3, 1e-14);
    free(A.x);
}

static enum modal_status broken(void *context, const double *x, double *y, struct modal_error *err)
{
    (void)context, (void)x, (void)y;
    return modal_fail(err, MODAL_IO, "the file went away");
}

TEST(lanczos_fails_with_what_its_operator_fails_with)
{
    struct linear_operator op = { 9, 4, NULL, broken, broken };
    struct lanczos_options opt = { .wanted = 2 };
    struct lanczos_result result = { -1, -1, -1 };
    double s[2] = { 7, 7 };

    CHECK(lanczos_svd(&op, &opt, s, NULL, NULL, &result, NULL) == MODAL_IO);
    CHECK(result.count == -1 && s[0] == 7);
}
