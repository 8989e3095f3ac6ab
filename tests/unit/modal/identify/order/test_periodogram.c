/* Ordinates of long columns, against sums over their rows. */
#include "modal/identify/order/periodogram.h"
#include <complex.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "check.h"
#include "signals.h"

/* |sum x_l e^{-i theta l}|^2 */
static double ordinate(const double *x, int rows, double theta)
{
    double complex sum = 0;

    for (int l = 0; l < rows; l++)
        sum += x[l] * cexp(-I * fmod(theta * l, 2 * M_PI));
    return creal(sum) * creal(sum) + cimag(sum) * cimag(sum);
}

static void check_rows(int rows)
{
    int n = periodogram_length(rows), count;
    double *x = calloc((size_t)n, sizeof *x), *kept = calloc((size_t)n, sizeof *kept), sum = 0;
    float *power = calloc((size_t)n, sizeof *power);
    struct periodogram *p = NULL;
    struct random rng = { (uint64_t)rows };

    CHECK(periodogram_new(rows, x, &p, NULL) == MODAL_OK);
    count = periodogram_count(p);
    CHECK(count == n / 2 + 1);
    for (int l = 0; l < rows; l++)
        x[l] = kept[l] = random_normal(&rng);
    periodogram_add(p, 1, power);
    for (int i = 0; i < count; i++) {
        double theta = periodogram_angle(p, i);
        double half = theta > 1e-9 && theta < M_PI - 1e-9 ? 1 : 0.5;
        CHECK(theta >= 0 && theta <= M_PI + 1e-9);
        sum += power[i];
        if (i % (count / 60 + 1) == 0 || half < 1)
            CHECK_NEAR(power[i], half * ordinate(kept, rows, theta), 1e-6 * n);
    }
    /* Parseval: all of them, twice, are n times the sum of squares; none stands twice. */
    for (int l = 0; l < rows; l++)
        sum -= 0.5 * n * kept[l] * kept[l];
    CHECK_NEAR(sum, 0, 1e-6 * n * (double)rows);
    periodogram_free(p);
    free(x), free(kept), free(power);
}

TEST(an_ordinate_is_the_squared_sum_over_all_rows_at_its_angle)
{
    const int rows[] = { 1, 2, 6, 14, 30, 97, 450, 2401 * 2, 10000, 65536 };

    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        check_rows(rows[i]);
}

TEST(columns_add_up_with_their_scale)
{
    enum { ROWS = 90 };
    double *x = calloc((size_t)periodogram_length(ROWS), sizeof *x);
    float power[ROWS] = { 0 };
    struct periodogram *p = NULL;

    CHECK(periodogram_new(ROWS, x, &p, NULL) == MODAL_OK);
    for (int column = 0; column < 2; column++) {
        memset(x, 0, ROWS * sizeof *x);
        x[7 * column] = 1;          /* a single one has the ordinate 1 everywhere */
        periodogram_add(p, 1 + column, power);
    }
    for (int i = 0; i < periodogram_count(p); i++) {
        double theta = periodogram_angle(p, i);
        CHECK_NEAR(power[i], theta > 1e-9 && theta < M_PI - 1e-9 ? 3 : 1.5, 1e-5);
    }
    periodogram_free(p);
    free(x);
}
