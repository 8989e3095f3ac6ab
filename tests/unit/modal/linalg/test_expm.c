#include "check.h"
#include <float.h>
#include <stdlib.h>
#include "modal/linalg/expm.h"

static void exponential(int n, const double *A, double *E)
{
    struct expm *w = NULL;
    struct modal_error err;

    CHECK(expm_new(n, &w, &err) == MODAL_OK);
    if (expm(w, A, E, &err) != MODAL_OK)
        fail_msg("%s", err.message);
    expm_free(w);
}

/* exp(t [a b; 0 a]) = e^(a t) [1 bt; 0 1]; one more Jordan level adds b^2 t^2 / 2. */
TEST(a_jordan_block_has_its_powers_of_time)
{
    const double a = -0.37, b = 2.385;
    double A2[4] = { a, 0, b, a }, E2[4], A3[9] = { a, 0, 0, b, a, 0, 0, b, a }, E3[9];

    exponential(2, A2, E2);
    CHECK_NEAR(E2[0], exp(a), 4 * DBL_EPSILON);
    CHECK_NEAR(E2[2], b * exp(a), 8 * DBL_EPSILON);
    CHECK(E2[1] == 0);
    exponential(3, A3, E3);
    CHECK_NEAR(E3[6], b * b / 2 * exp(a), 1e-15);
    CHECK_NEAR(E3[3], b * exp(a), 1e-15);
}

/* exp of a skew matrix rotates: [0 -w; w 0] by w, whatever its size; an error of eps in w t is w t
 * eps in the angle. */
TEST(a_long_rotation_keeps_its_length)
{
    for (double w = 1e-9; w < 1e8; w *= 13.7) {
        double A[4] = { 0, w, -w, 0 }, E[4];
        exponential(2, A, E);
        CHECK_NEAR(E[0] * E[3] - E[1] * E[2], 1, 4 * DBL_EPSILON);
        CHECK_NEAR(E[0], cos(w), 8 * DBL_EPSILON * (1 + w));
    }
}

/* For every Pade degree and squaring: exp(A) exp(-A) = I and det exp(A) = e^(tr A) (A 3 x 3, full).
 */
TEST(the_exponential_inverts_and_has_the_trace_in_its_determinant)
{
    const double base[9] = { 0.31, -1.2, 0.4, 0.9, -0.53, 1.7, -0.2, 0.6, 0.11 };

    for (double scale = 1e-3; scale < 20; scale *= 3) {
        double A[9], B[9], E[9], F[9], trace = scale * (0.31 - 0.53 + 0.11), size = 0;
        for (int i = 0; i < 9; i++) {
            A[i] = scale * base[i];
            B[i] = -A[i];
        }
        exponential(3, A, E);
        exponential(3, B, F);
        for (int i = 0; i < 9; i++)
            size = fmax(size, fabs(E[i]) * 3 * exp(3 * scale));
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                double x = 0;
                for (int k = 0; k < 3; k++)
                    x += E[i + 3 * k] * F[k + 3 * j];
                CHECK_NEAR(x, i == j, 1e-15 * (1 + scale) * (1 + size));
            }
        double det = E[0] * (E[4] * E[8] - E[5] * E[7]) - E[3] * (E[1] * E[8] - E[2] * E[7]) +
                     E[6] * (E[1] * E[5] - E[2] * E[4]);
        CHECK_NEAR(det, exp(trace), 1e-14 * (1 + size * size));
    }
}

/* y' = A y, A = -k on the diagonal, k on the one below: a Poisson process, exp(A)_(i0) = e^-k k^i /
 * i!. */
TEST(a_poisson_process_has_its_probabilities)
{
    enum { n = 24 };
    double *A = calloc(n * n, sizeof *A), *E = calloc(n * n, sizeof *E), k = 3.7, p = exp(-3.7);

    for (int i = 0; i < n; i++) {
        A[i + i * n] = -k;
        if (i + 1 < n)
            A[i + 1 + i * n] = k;
    }
    exponential(n, A, E);
    for (int i = 0; i < n; i++) {
        CHECK_NEAR(E[i], p, 1e-15);
        p *= k / (i + 1);
    }
    free(A);
    free(E);
}

TEST(what_overflows_is_said)
{
    struct expm *w = NULL;
    double A[4] = { 800, 0, 0, 1 }, E[4], B[9] = { 1e13 }, F[9];

    CHECK(expm_new(2, &w, NULL) == MODAL_OK);
    CHECK(expm(w, A, E, NULL) == MODAL_OVERFLOW);
    expm_free(w);
    CHECK(expm_new(3, &w, NULL) == MODAL_OK);
    CHECK(expm(w, B, F, NULL) == MODAL_OVERFLOW);
    B[0] = NAN;
    CHECK(expm(w, B, F, NULL) == MODAL_OVERFLOW);
    expm_free(w);
}

/* Rates 0.3, 1 and 3e6 1/s side by side, coupled by a similarity: exp(A) = V diag(e^-r) V^-1 has no
 * large entry, though exp(A - tr/3 I) would have. */
TEST(a_rate_of_millions_beside_slow_ones_does_not_overflow)
{
    /* by columns, unit triangular */
    const double r[3] = { 0.3, 1, 3e6 }, V[9] = { 1, 0.5, 0, 0, 1, 0.25, 0, 0, 1 };
    const double inverse[9] = { 1, -0.5, 0.125, 0, 1, -0.25, 0, 0, 1 };
    double A[9] = { 0 }, E[9], expected;
    struct expm *w = NULL;

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++)
                A[i + 3 * j] -= V[i + 3 * k] * r[k] * inverse[k + 3 * j];
    CHECK(expm_new(3, &w, NULL) == MODAL_OK);
    CHECK(expm(w, A, E, NULL) == MODAL_OK);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            expected = 0;
            for (int k = 0; k < 3; k++)
                expected += V[i + 3 * k] * exp(-r[k]) * inverse[k + 3 * j];
            /* a relative perturbation of A by epsilon */
            CHECK_NEAR(E[i + 3 * j], expected, 3e6 * 10 * DBL_EPSILON);
        }
    expm_free(w);
}

/* y' = w y + b, y(0) = 0: y(t) = b (e^(wt) - 1) / w, whatever the size of b; and an oscillator
 * driven at its side. */
TEST(a_load_of_any_size_leaves_the_motion_its_digits)
{
    for (int k = -300; k <= 300; k += 75) {
        const double b = 2.385 * pow(10, k), w = 0.7, W = 1.3;
        double A[16] = { 0 }, E[16], F[9], B[9] = { 0 };
        struct expm *three = NULL, *four = NULL;

        CHECK(expm_new(3, &three, NULL) == MODAL_OK && expm_new(4, &four, NULL) == MODAL_OK);
        B[0] = w;                                   /* y' = w y + b z, z' = u, u' = 0 */
        B[0 + 3] = b;
        B[1 + 6] = 1;
        CHECK(expm_driven(three, 1, B, F, NULL) == MODAL_OK);
        CHECK_NEAR(F[0], exp(w), 20 * DBL_EPSILON);
        CHECK_NEAR(F[3] / b, expm1(w) / w, 20 * DBL_EPSILON);
        CHECK_NEAR(F[6] / b, (expm1(w) - w) / (w * w), 20 * DBL_EPSILON);
        A[1] = -w;   /* x' = w v, v' = -w x + b c; c' = -W s, s' = W c */
        A[0 + 4] = w;
        A[1 + 8] = b;
        A[3 + 8] = W;
        A[2 + 12] = -W;
        CHECK(expm_driven(four, 2, A, E, NULL) == MODAL_OK);
        CHECK_NEAR(E[0], cos(w), 20 * DBL_EPSILON);
        CHECK_NEAR(E[8] / b, w * (cos(w) - cos(W)) / (W * W - w * w), 20 * DBL_EPSILON);
        expm_free(three);
        expm_free(four);
    }
}
