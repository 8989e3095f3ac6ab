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

enum { LINE = 400 };

/* Values 0.995^k. */
static enum modal_status multiply_line(void *context, const double *x, double *y,
                                       struct modal_error *err)
{
    (void)context, (void)err;
    for (int k = 0; k < LINE; k++)
        y[k] = x[k] * pow(0.995, k);
    return MODAL_OK;
}

/* Products after which eight eigenvalues settle, looked at wherever MOST says. */
static int products_of(double tolerance, int most, bool *settled)
{
    struct linear_operator A = { LINE, LINE, NULL, multiply_line, NULL };
    struct arnoldi a;
    int products;

    CHECK(arnoldi(&A, 8, tolerance, most, &a, NULL) == MODAL_OK);
    *settled = a.settled;
    products = a.products;
    arnoldi_done(&a);
    return products;
}

/* The fewest are those after which a look with so many at most finds all settled. */
TEST(spaces_that_settle_are_hardly_larger_than_they_must_be)
{
    int all = 0, fewest = 0;
    bool settled;

    for (double tolerance = 1e-5; tolerance > 5e-13; tolerance /= 10) {
        int low = 8, high = products_of(tolerance, 0, &settled);
        CHECK(settled);
        all += high;
        while (low < high) {
            int middle = (low + high) / 2;
            products_of(tolerance, middle, &settled);
            high = settled ? middle : high;
            low = settled ? low : middle + 1;
        }
        fewest += high;
    }
    print_message("%d products of %d\n", all, fewest);
    CHECK(all <= 1.1 * fewest);
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
