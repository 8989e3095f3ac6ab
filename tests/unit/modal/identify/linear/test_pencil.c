/* The FFT Hankel operator against direct sums, and the pencil against closed-form multipliers. */
#include "modal/identify/linear/pencil.h"
#include <float.h>
#include "check.h"
#include "signals.h"

static double y[64 * 1024];

static void noise(int count, uint64_t seed)
{
    struct random r = { seed };

    for (int i = 0; i < count; i++)
        y[i] = random_normal(&r);
}

/* Correlations by FFT err by about log2(N) DBL_EPSILON |x| |y|: 10 * 2.2e-16 * 30 * 15. */
static void compare_products(int L, int S, int ld, int m)
{
    struct matrix Y = { L, S, ld, y };
    struct hankel_operator *h;
    struct linear_operator op;
    double x[64], u[256], got[256], back[64];
    struct random r = { 3 };
    int n = L - m + 1;

    CHECK(hankel_operator_new(&Y, m, &h, &op, NULL) == MODAL_OK);
    CHECK(op.m == S * m && op.n == n);
    for (int l = 0; l < n; l++)
        x[l] = random_normal(&r);
    for (int i = 0; i < S * m; i++)
        u[i] = random_normal(&r);
    CHECK(op.apply(op.context, x, got, NULL) == MODAL_OK &&
          op.apply_transpose(op.context, u, back, NULL) == MODAL_OK);
    for (int s = 0; s < S; s++)
        for (int i = 0; i < m; i++) {
            double sum = 0;
            for (int l = 0; l < n; l++)
                sum += y[i + l + s * ld] * x[l];
            CHECK_NEAR(got[s * m + i], sum, 1e-12);
        }
    for (int l = 0; l < n; l++) {
        double sum = 0;
        for (int s = 0; s < S; s++)
            for (int i = 0; i < m; i++)
                sum += y[i + l + s * ld] * u[s * m + i];
        CHECK_NEAR(back[l], sum, 1e-12);
    }
    hankel_operator_done(h);
}

TEST(products_by_fft_are_the_hankel_matrix_for_any_shape)
{
    noise(4096, 1);
    compare_products(53, 3, 60, 17);       /* odd, prime, ld > L */
    compare_products(40, 1, 40, 20);
    compare_products(31, 4, 31, 30);       /* two columns */
    compare_products(31, 2, 31, 1);
    compare_products(2, 1, 2, 1);
}

TEST(rows_out_of_range_are_bad_input_that_names_them)
{
    struct matrix Y = { 10, 1, 10, y };
    struct hankel_operator *h = NULL;
    struct linear_operator op;
    struct modal_error err;

    CHECK(hankel_operator_new(&Y, 10, &h, &op, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "rows");
    CHECK(hankel_operator_new(&Y, 0, &h, &op, &err) == MODAL_BAD_INPUT && h == NULL);
}

TEST(multipliers_of_clean_signals_are_exact_at_their_order)
{
    struct decay d = { .modes = 3, .channels = 2, .samples = 300, .dt = 0.05,
                       .lambda = { decay_pole(1.0, 0.01), decay_pole(4.1, 0.02), -0.3 } };
    struct random r = { 2 };
    struct matrix Y = { 300, 2, 300, y };
    struct pencil p;
    double complex rho[8];

    decay_amplitudes(&d, &r);
    decay_signals(&d, y, 300);
    CHECK(pencil_new(&Y, NULL, &p, NULL) == MODAL_OK);
    CHECK(p.count >= 5 && p.s[5] < 1e-12 * p.s[0] && p.s[4] > 1e-6 * p.s[0]);
    CHECK(pencil_multipliers(&p, 5, rho, NULL) == MODAL_OK);
    for (int j = 0; j < 3; j++) {
        double best = 1;
        for (int i = 0; i < 5; i++)
            best = fmin(best, cabs(rho[i] - cexp(d.lambda[j] * d.dt)));
        CHECK_NEAR(best, 0, 1e-11);          /* rounding over the smallest singular value kept */
    }
    CHECK(pencil_multipliers(&p, 0, rho, NULL) == MODAL_BAD_INPUT);
    CHECK(pencil_multipliers(&p, p.count + 1, rho, NULL) == MODAL_BAD_INPUT);
    pencil_done(&p);
}

TEST(a_zero_signal_has_no_triplet_above_zero)
{
    struct matrix Y = { 60, 2, 60, y };
    struct pencil p;

    memset(y, 0, sizeof y);
    CHECK(pencil_new(&Y, NULL, &p, NULL) == MODAL_OK);
    CHECK(p.count == 0 || p.s[0] == 0);
    pencil_done(&p);
}

/* Three pairs in 40 columns of 60 rows, in noise of 1e-4. */
TEST(products_of_few_rows_give_the_triplets_and_multipliers_that_signals_give)
{
    const double complex z[3] = { CMPLX(-0.02, 0.7), CMPLX(-0.1, 1.9), CMPLX(-0.005, 2.8) };
    enum { ROWS = 60, COLUMNS = 40 };
    struct matrix Y = { ROWS, COLUMNS, ROWS, y }, K;
    struct random r = { 7 };

    for (int c = 0; c < COLUMNS; c++) {
        double complex B[3];
        for (int j = 0; j < 3; j++)
            B[j] = CMPLX(random_normal(&r), random_normal(&r));
        for (int l = 0; l < ROWS; l++) {
            y[l + c * ROWS] = 1e-4 * random_normal(&r);
            for (int j = 0; j < 3; j++)
                y[l + c * ROWS] += creal(B[j] * cexp(z[j] * l));
        }
    }
    CHECK(pencil_products_pay(ROWS, COLUMNS) && pencil_products(&Y, &K, NULL) == MODAL_OK);
    for (int rows = 2; rows <= 30; rows += 14)
        for (int wanted = 10; wanted <= 20; wanted += 10) {     /* Lanczos; all */
            struct pencil_options how = { .rows = rows, .wanted = wanted };
            struct pencil p, q;
            double complex rho[20];
            CHECK(pencil_new(&Y, &how, &p, NULL) == MODAL_OK);
            how.products = &K;
            CHECK(pencil_new(&Y, &how, &q, NULL) == MODAL_OK);
            CHECK(q.count == wanted && pencil_signals(&q) >= 6 && pencil_signals(&p) >= 6);
            CHECK_NEAR(q.energy / p.energy, 1, 1e-12);
            for (int i = 0; i < 6; i++)
                CHECK_NEAR(q.s[i] / p.s[i], 1, 1e-9);
            CHECK(pencil_multipliers(&q, 6, rho, NULL) == MODAL_OK);
            for (int j = 0; j < 3; j++) {
                double best = 1;
                for (int i = 0; i < 6; i++)
                    best = fmin(best, cabs(rho[i] - cexp(z[j])));
                CHECK_NEAR(best, 0, 1e-4);
            }
            pencil_done(&p), pencil_done(&q);
        }
    free(K.x);
}

/* The last row of V has nearly all of a column: V1 has next to nothing of it. */
TEST(a_motion_that_grows_tenfold_a_sample_beside_a_decay_has_its_multiplier)
{
    enum { L = 24 };
    struct matrix Y = { L, 1, L, y };
    const double grows[] = { 1.02, 1.3, 2, 10 };

    for (int i = 0; i < 4; i++) {
        struct pencil p;
        double complex rho[2];
        for (int l = 0; l < L; l++)
            y[l] = pow(grows[i], l - L + 1) + pow(0.5, l);
        CHECK(pencil_new(&Y, &(struct pencil_options) { .wanted = 2 }, &p, NULL) == MODAL_OK);
        CHECK(p.count == 2 && pencil_multipliers(&p, 2, rho, NULL) == MODAL_OK);
        CHECK_NEAR(fmax(creal(rho[0]), creal(rho[1])), grows[i], 1e-11 * grows[i]);
        CHECK_NEAR(fmin(creal(rho[0]), creal(rho[1])), 0.5, 1e-11);
        pencil_done(&p);
    }
}

/* A million numbers of V and more, whose factors come from products: a decay, and one whose last
 * row has nearly all of a column. */
TEST(a_pencil_of_a_long_record_has_its_multipliers)
{
    enum { ROWS = 100000, K = 16 };
    double *x = malloc(ROWS * sizeof *x);
    struct matrix Y = { ROWS, 1, ROWS, x };
    const double rate[] = { -1e-4, -2e-5, 3 }, turn[] = { 0.3, 1.1, 0 };

    for (int count = 2; count <= 3; count++) {
        struct pencil p;
        double complex rho[K];
        for (int l = 0; l < ROWS; l++) {
            x[l] = exp(rate[0] * l) * cos(turn[0] * l) + exp(rate[1] * l) * sin(turn[1] * l);
            x[l] += count == 3 ? exp(rate[2] * (l - ROWS + 1)) : 0;
        }
        CHECK(pencil_new(&Y, &(struct pencil_options) { .wanted = K }, &p, NULL) == MODAL_OK);
        CHECK(p.count >= 2 * count - count / 3);
        int r = count == 3 ? 5 : 4;
        CHECK(pencil_multipliers(&p, r, rho, NULL) == MODAL_OK);
        for (int j = 0; j < count; j++) {
            double nearest = HUGE_VAL;
            for (int i = 0; i < r; i++)
                nearest = fmin(nearest, cabs(rho[i] - cexp(CMPLX(rate[j], turn[j]))));
            CHECK_NEAR(nearest, 0, 1e-7);       /* products by FFT, the growing one a 300th */
        }
        pencil_done(&p);
    }
    free(x);
}
