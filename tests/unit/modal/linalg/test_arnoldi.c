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

    CHECK(arnoldi(&A, 7, 1e-11, 0, 0, &a, NULL) == MODAL_OK);
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

    CHECK(arnoldi(&A, N, 1e-11, 0, 0, &a, NULL) == MODAL_OK);
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

    CHECK(arnoldi(&A, 8, tolerance, most, 0, &a, NULL) == MODAL_OK);
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

enum { CROWD = 800, EVEN = 240 };

/* Values of motions that a damper in proportion lets turn: exp(i w - w^2 / 20), w to 2. */
static enum modal_status multiply_crowd(void *context, const double *x, double *y,
                                        struct modal_error *err)
{
    (void)err;
    ++*(int *)context;
    for (int k = 0; k < CROWD; k += 2) {
        double w = 2.0 * (k + 2) / CROWD, r = exp(-w * w / 41);
        double c = r * cos(5 * w), s = r * sin(5 * w);
        y[k] = c * x[k] - s * x[k + 1];
        y[k + 1] = s * x[k] + c * x[k + 1];
    }
    return MODAL_OK;
}

TEST(a_start_that_is_carried_on_spares_vectors_and_takes_at_most_half_as_many_products_again)
{
    int products = 0, vectors;
    struct linear_operator A = { CROWD, CROWD, &products, multiply_crowd, NULL };
    struct arnoldi a;

    CHECK(arnoldi(&A, 4, 1e-6, 0, 0, &a, NULL) == MODAL_OK && a.settled);
    CHECK(a.vectors == a.products);
    vectors = a.vectors;
    arnoldi_done(&a);
    products = 0;
    CHECK(arnoldi(&A, 4, 1e-6, 0, EVEN, &a, NULL) == MODAL_OK && a.settled);
    print_message("%d vectors of %d, %d products\n", a.vectors, vectors, a.products);
    CHECK(a.products == products && a.vectors < 0.8 * vectors && a.products < 1.5 * vectors);
    for (int i = 0; i < a.count; i++) {
        double w = 4.0 * (i / 2 + 1) / CROWD;
        CHECK_NEAR(creal(a.w[i]), exp(-w * w / 41) * cos(5 * w), 1e-5);
        CHECK_NEAR(fabs(cimag(a.w[i])), exp(-w * w / 41) * sin(5 * w), 1e-5);
    }
    arnoldi_done(&a);
}

TEST(all_of_a_matrix_is_still_spanned_where_a_start_could_be_carried_on)
{
    int products = 0;
    struct linear_operator A = { N, N, &products, multiply, NULL };
    struct arnoldi a;

    for (int most = N; most < 4 * N; most += N) {
        CHECK(arnoldi(&A, 2, 1e-30, most, 8, &a, NULL) == MODAL_OK);
        CHECK(a.vectors == N && a.products <= most && a.settled);
        CHECK_NEAR(cabs(a.w[0]), 1, 1e-9);
        arnoldi_done(&a);
    }
}

/* One value of 1, the others a line that begins at 0.7: a hundred powers leave of these 1e-16. */
static enum modal_status multiply_one(void *context, const double *x, double *y,
                                      struct modal_error *err)
{
    (void)context, (void)err;
    for (int k = 0; k < LINE; k++)
        y[k] = x[k] * (k == 0 ? 1 : 0.7 - 1e-4 * k);
    return MODAL_OK;
}

TEST(values_far_below_the_first_are_not_lost_of_a_start_that_is_carried_on)
{
    struct linear_operator A = { LINE, LINE, NULL, multiply_one, NULL };
    struct arnoldi a;

    CHECK(arnoldi(&A, 4, 1e-10, 0, 80, &a, NULL) == MODAL_OK && a.settled && a.count == 4);
    for (int i = 0; i < a.count; i++)
        CHECK_NEAR(creal(a.w[i]), i == 0 ? 1 : 0.7 - 1e-4 * i, 1e-8);
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

    CHECK(arnoldi(&A, 3, 1e-9, 0, 0, &a, NULL) == MODAL_OVERFLOW && a.w == NULL && a.V == NULL);
}
