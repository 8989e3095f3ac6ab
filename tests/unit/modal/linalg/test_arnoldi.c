#include "check.h"
#include <cblas.h>
#include <stdlib.h>
#include "modal/linalg/arnoldi.h"

enum { N = 60 };

/* Blocks of modulus r_k = 0.97^k turned by 0.7 k, in pairs, and a coupling above them that makes A
 * not normal: a triangle of blocks has its blocks' eigenvalues. */
static enum modal_status multiply(void *context, const double *x, double *y,
                                  struct modal_error *err)
{
    (void)err;
    ++*(int *)context;
    for (int k = 0; k < N / 2; k++) {
        double r = pow(0.97, k), c = r * cos(0.7 * k + 0.3), s = r * sin(0.7 * k + 0.3);
        y[2 * k] = c * x[2 * k] - s * x[2 * k + 1];
        y[2 * k + 1] = s * x[2 * k] + c * x[2 * k + 1];
        if (2 * k + 2 < N)
            y[2 * k] += 0.2 * x[2 * k + 2];
    }
    return MODAL_OK;
}

TEST(the_largest_eigenvalues_of_a_matrix_that_is_not_normal_come_with_their_vectors)
{
    int products = 0;
    struct linear_operator A = { N, N, &products, multiply, NULL };
    struct arnoldi a;
    double x[2 * N], y[2 * N];

    CHECK(arnoldi(&A, 7, 1e-11, 0, &a, NULL) == MODAL_OK);
    CHECK(a.count == 8 && a.products == products);       /* no pair is parted */
    for (int i = 0; i < a.count; i++) {
        double complex want = pow(0.97, i / 2) * cexp(I * (0.7 * (i / 2) + 0.3));
        double off = 0, norm = 0;
        CHECK_NEAR(creal(a.w[i]), creal(want), 1e-9);
        CHECK_NEAR(fabs(cimag(a.w[i])), fabs(cimag(want)), 1e-9);
        for (int k = 0; k < N; k++) {
            x[k] = creal(a.V[k + i * N]);
            x[N + k] = cimag(a.V[k + i * N]);
            norm += x[k] * x[k] + x[N + k] * x[N + k];
        }
        multiply(&products, x, y, NULL);
        multiply(&products, x + N, y + N, NULL);
        for (int k = 0; k < N; k++)
            off = hypot(off, cabs(CMPLX(y[k], y[N + k]) - a.w[i] * CMPLX(x[k], x[N + k])));
        CHECK_NEAR(norm, 1, 1e-12);
        CHECK_NEAR(off, 0, 2e-11);
        CHECK_NEAR(a.residual[i], 0, 1e-11);
        CHECK(a.condition[i] >= 1 - 1e-9);
    }
    arnoldi_done(&a);
}

TEST(all_eigenvalues_are_had_by_as_many_products_as_there_are)
{
    int products = 0;
    struct linear_operator A = { N, N, &products, multiply, NULL };
    struct arnoldi a;

    CHECK(arnoldi(&A, N, 1e-11, 0, &a, NULL) == MODAL_OK);
    CHECK(a.count == N && a.products == N && products == N);
    CHECK_NEAR(cabs(a.w[N - 1]), pow(0.97, N / 2 - 1), 1e-7);
    arnoldi_done(&a);
}

static enum modal_status refuse(void *context, const double *x, double *y, struct modal_error *err)
{
    (void)context, (void)x, (void)y;
    return modal_fail(err, MODAL_OVERFLOW, "no");
}

TEST(what_the_operator_fails_with_is_handed_on)
{
    struct linear_operator A = { N, N, NULL, refuse, NULL };
    struct arnoldi a;

    CHECK(arnoldi(&A, 3, 1e-9, 0, &a, NULL) == MODAL_OVERFLOW && a.w == NULL && a.V == NULL);
}
