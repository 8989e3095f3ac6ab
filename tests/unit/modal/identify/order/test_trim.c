/* What trimming leaves out, and what a fit leaves: against least squares made anew. */
/* Tests as well: criterion.c remainder.c rise.c */
#include "check.h"
#include "modal/identify/order/remainder.h"
#include "modal/identify/order/trim.h"
#include "signals.h"

enum { L = 300, S = 3 };
static double y[L * S];

/* Three modes, one far weaker, in noise of 1e-3. */
static const double complex truth[3] = { CMPLX(-0.01, 0.5), CMPLX(-0.004, 1.1), CMPLX(-0.02, 2.3) };

static struct matrix record(uint64_t seed, double weak)
{
    struct random rng = { seed };

    for (int c = 0; c < S; c++) {
        double complex B[3];
        for (int j = 0; j < 3; j++)
            B[j] = CMPLX(random_normal(&rng), random_normal(&rng)) * (j == 2 ? weak : 1);
        for (int l = 0; l < L; l++) {
            y[l + c * L] = 1e-3 * random_normal(&rng);
            for (int j = 0; j < 3; j++)
                y[l + c * L] += creal(B[j] * cexp(truth[j] * l));
        }
    }
    return (struct matrix) { L, S, L, y };
}

static double bic_of(const struct refine_data *d, const double complex *lambda, int count)
{
    struct refine_options look = { .iterations = -1 };
    struct refined fit;
    double bic;

    CHECK(refine_poles(d, lambda, count, NULL, &look, &fit, NULL) == MODAL_OK);
    bic = fit.bic;
    refined_done(&fit);
    return bic;
}

TEST(the_pole_that_goes_first_is_the_one_whose_absence_costs_least_by_fits_made_anew)
{
    for (uint64_t seed = 0; seed < 8; seed++) {
        struct matrix Y = record(30 + seed, 0.05);
        struct refine_data d = { .Y = &Y, .tau = 1 };
        struct trim_options one = { .share = 1, .reach = 1e9, .most = 1 };
        const double complex all[6] = { truth[0], truth[1], truth[2],
                                        CMPLX(-0.3, 0), CMPLX(0.001, 1.7), CMPLX(-0.1, M_PI) };
        double complex left[6];
        double least = HUGE_VAL;
        int count = 6, gone = -1, seen = -1;

        memcpy(left, all, sizeof all);
        CHECK(trim_poles(&d, left, &count, &one, NULL, NULL) == MODAL_OK && count == 5);
        for (int j = 0; j < 6; j++) {
            double complex others[5];
            int n = 0;
            for (int k = 0; k < 6; k++)
                if (k != j)
                    others[n++] = all[k];
            double bic = bic_of(&d, others, 5);
            if (bic < least)
                least = bic, gone = j;
        }
        for (int j = 0; j < 6 && seen < 0; j++)
            if (j == 5 || left[j] != all[j])
                seen = j;
        CHECK(seen == gone);
    }
}

TEST(poles_in_noise_go_and_modes_stay)
{
    for (uint64_t seed = 0; seed < 20; seed++) {
        struct matrix Y = record(60 + seed, 0.05);
        struct refine_data d = { .Y = &Y, .tau = 1 };
        struct trim_options whole = { .share = 1 };
        double complex lambda[6] = { truth[0], CMPLX(-0.01, 1.6), truth[1],
                                     CMPLX(0.001, 2.0), truth[2], CMPLX(-0.2, 0) };
        double work = 0;
        int count = 6;

        CHECK(trim_poles(&d, lambda, &count, &whole, &work, NULL) == MODAL_OK);
        CHECK(count == 3 && work > 0);
        CHECK(lambda[0] == truth[0] && lambda[1] == truth[1] && lambda[2] == truth[2]);
    }
}

TEST(a_pole_listed_twice_goes_once)
{
    struct matrix Y = record(90, 1);
    struct refine_data d = { .Y = &Y, .tau = 1 };
    struct trim_options whole = { .share = 1 };
    double complex lambda[4] = { truth[0], truth[1], truth[0], truth[2] };
    int count = 4;

    CHECK(trim_poles(&d, lambda, &count, &whole, NULL, NULL) == MODAL_OK);
    CHECK(count == 3 && lambda[0] == truth[0] && lambda[1] == truth[1] && lambda[2] == truth[2]);
}

/* chi-squared of a mode in the remainder is far above that of noise, whose largest of some 300
 * ordinates of 2 S = 6 degrees of freedom stays below 50. */
TEST(a_mode_that_a_fit_lacks_stands_out_of_what_it_leaves_and_its_pole_is_found_there)
{
    for (uint64_t seed = 0; seed < 10; seed++) {
        struct matrix Y = record(120 + seed, 0.05), E = { 0 };
        struct refine_data d = { .Y = &Y, .tau = 1 };
        struct refined fit;
        double complex found[16];
        double complex peak;
        double chi2, nearest = HUGE_VAL;
        int count;

        CHECK(refine_poles(&d, truth, 3, NULL, NULL, &fit, NULL) == MODAL_OK);
        CHECK(remainder_of(&d, &fit, &E, NULL) == MODAL_OK);
        CHECK(remainder_peak(&E, 1, &peak, &chi2, NULL) == MODAL_OK);
        CHECK(chi2 < 50);
        refined_done(&fit), free(E.x);
        CHECK(refine_poles(&d, truth, 2, NULL, NULL, &fit, NULL) == MODAL_OK);
        CHECK(remainder_of(&d, &fit, &E, NULL) == MODAL_OK);
        CHECK(remainder_peak(&E, 1, &peak, &chi2, NULL) == MODAL_OK);
        CHECK(chi2 > 100 && cabs(peak - truth[2]) < 0.02);
        CHECK(remainder_poles(&E, 1, 16, found, &count, NULL) == MODAL_OK);
        CHECK(count >= 1 && count <= 16);
        for (int j = 0; j < count; j++)
            nearest = fmin(nearest, cabs(found[j] - truth[2]));
        CHECK(nearest < 2e-3);
        refined_done(&fit), free(E.x);
    }
}

TEST(of_exact_signals_nothing_is_left_and_two_neighbours_show_beside_the_pole_that_stands_for_both)
{
    struct matrix Y = { L, 1, L, y }, E = { 0 };
    struct refine_data d = { .Y = &Y, .tau = 1 };
    const double complex pair[2] = { CMPLX(-0.004, 1.1), CMPLX(-0.004, 1.106) };
    const double complex one = CMPLX(-0.004, 1.103);
    struct random rng = { 7 };
    struct refined fit;
    double chi2, far;

    for (int l = 0; l < L; l++)
        y[l] = creal(cexp(pair[0] * l) + cexp(pair[1] * l));
    CHECK(refine_poles(&d, pair, 2, NULL, NULL, &fit, NULL) == MODAL_OK);
    CHECK(remainder_of(&d, &fit, &E, NULL) == MODAL_OK);
    for (int l = 0; l < L; l++)
        CHECK(E.x[l] == 0);
    refined_done(&fit), free(E.x);
    for (int l = 0; l < L; l++)
        y[l] += 1e-3 * random_normal(&rng);
    CHECK(refine_poles(&d, &one, 1, NULL, NULL, &fit, NULL) == MODAL_OK);
    CHECK(remainder_of(&d, &fit, &E, NULL) == MODAL_OK);
    CHECK(remainder_split(&E, 1, fit.lambda[0], false, &chi2, NULL) == MODAL_OK && chi2 > 100);
    CHECK(remainder_split(&E, 1, CMPLX(-0.004, 2.2), false, &far, NULL) == MODAL_OK && far < 30);
    refined_done(&fit), free(E.x);
}

/* z, u z and u^2 z themselves, one out of the other; what the last two leave of E. */
static double beside(const struct matrix *E, double complex z)
{
    enum { COLUMNS = 6 };
    int n = E->m;
    double a = creal(z), centre = a == 0 ? n / 2.0 : a > 0 ? n - fmin(n / 2.0, 1 / a)
                                                           : fmin(n / 2.0, -1 / a), sum = 0;
    double *V = malloc(sizeof *V * COLUMNS * (size_t)n);

    for (int l = 0; l < n; l++)
        for (int p = 0; p < COLUMNS; p++) {
            double complex x = cexp(CMPLX(a * (l - (a > 0 ? n : 0)), cimag(z) * l));
            V[l + p * n] = (p % 2 ? -cimag(x) : creal(x)) * pow((l - centre) / n, p / 2);
        }
    for (int twice = 0; twice < 2; twice++)
        for (int p = 0; p < COLUMNS; p++) {
            double norm = 0;
            for (int q = 0; q < p; q++) {
                double dot = 0;
                for (int l = 0; l < n; l++)
                    dot += V[l + p * n] * V[l + q * n];
                for (int l = 0; l < n; l++)
                    V[l + p * n] -= dot * V[l + q * n];
            }
            for (int l = 0; l < n; l++)
                norm += V[l + p * n] * V[l + p * n];
            for (int l = 0; l < n; l++)
                V[l + p * n] /= sqrt(norm);
        }
    for (int c = 0; c < E->n; c++)
        for (int p = 4; p < COLUMNS; p++) {
            double dot = 0;
            for (int l = 0; l < n; l++)
                dot += V[l + p * n] * E->x[l + c * E->ld];
            sum += dot * dot;
        }
    free(V);
    return sum;
}

TEST(what_a_second_pole_could_take_is_that_of_its_columns_however_long_the_record)
{
    static const int rows[] = { 40, 1024, 2500, 5120 };
    static const double complex poles[] = { CMPLX(-0.004, 1.1), CMPLX(0, 0.3), CMPLX(0.003, 2.9),
                                            CMPLX(-0.3, 0.8) };
    static double e[5120 * S];
    struct random rng = { 11 };

    for (int i = 0; i < 5120 * S; i++)
        e[i] = random_normal(&rng);
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) {
            struct matrix E = { rows[i], S, 5120, e };
            double chi2;
            CHECK(remainder_split(&E, 0.5, poles[j] / 0.5, false, &chi2, NULL) == MODAL_OK);
            CHECK_NEAR(chi2 / beside(&E, poles[j]), 1, 1e-6);
        }
}

/* A turn in ten thousand records: the columns are those of a polynomial. */
TEST(beside_a_pole_that_hardly_turns_anything_could_be)
{
    static double e[L];
    struct matrix E = { L, 1, L, e };
    double chi2;

    CHECK(remainder_split(&E, 1, CMPLX(0, 2e-6), false, &chi2, NULL) == MODAL_OK);
    CHECK(chi2 == HUGE_VAL);
}

/* All that one pole alone makes of a record is its chi-squared, where it turns in its life. */
TEST(of_any_pole_that_lives_for_samples_or_for_records_the_filters_show_three_fifths)
{
    struct random rng = { 17 };

    for (int draw = 0; draw < 300; draw++) {
        double life = exp(log(10) + random_uniform(&rng) * log(10000)), turn = 2 * M_PI / L;
        double edge = fmax(4 * turn, 10 / life);
        double complex z = CMPLX((draw % 2 == 0 ? -1 : 1) / life,
                                 edge + (M_PI - 2 * edge) * random_uniform(&rng)), peak;
        double all = 0, chi2, size = creal(z) > 0 ? creal(z) * L : 0;
        struct matrix E = { L, 2, L, y };

        for (int c = 0; c < 2; c++) {
            double complex B = cexp(2 * M_PI * I * random_uniform(&rng));
            for (int l = 0; l < L; l++) {
                double e = y[l + c * L] = creal(B * cexp(z * l - size));
                all += e * e;
            }
        }
        CHECK(remainder_peak(&E, 0.5, &peak, &chi2, NULL) == MODAL_OK);
        CHECK(chi2 > 0.6 * all && chi2 < 1.1 * all);
        CHECK(fabs(cimag(peak) * 0.5 - cimag(z)) < turn + fabs(creal(z)));
    }
}

/* 24 columns of 200 rows are transformed, 25 multiplied: the last of those is zero. */
TEST(products_of_rows_show_the_peak_that_transforms_of_columns_show)
{
    enum { ROWS = 200, COLUMNS = 25 };
    static double e[ROWS * COLUMNS];
    struct random rng = { 61 };

    for (int draw = 0; draw < 12; draw++) {
        double complex z = CMPLX((draw % 3 - 1) * pow(10, -2 + 0.1 * draw), 0.2 + 0.2 * draw);
        double complex peak[2];
        double chi2[2], size = creal(z) > 0 ? creal(z) * ROWS : 0;
        for (int c = 0; c < COLUMNS - 1; c++)
            for (int l = 0; l < ROWS; l++)
                e[l + c * ROWS] = random_normal(&rng) + 3 * creal(cexp(z * l - size + I * c));
        for (int few = 0; few < 2; few++) {
            struct matrix E = { ROWS, COLUMNS - few, ROWS, e };
            CHECK(remainder_peak(&E, 0.5, &peak[few], &chi2[few], NULL) == MODAL_OK);
        }
        CHECK(cabs(peak[0] - peak[1]) < 1e-12);
        CHECK_NEAR(chi2[0] / chi2[1], 1, 1e-11);
    }
}
