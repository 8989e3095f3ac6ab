/* test_ambient.c - spectra of known systems: what a record's ends and bins make of them, and the
 * modes found in them */
/* Tests as well: ambient_lines.c ambient_order.c spectrum.c subspace.c whittle.c */
#include "check.h"
#include <complex.h>
#include <stdlib.h>
#include "modal/identify/ambient/ambient_lines.h"
#include "modal/identify/ambient/ambient_order.h"
#include "modal/identify/ambient/subspace.h"

enum { N = 96, CHANNELS = 2 };

/* Two pairs seen by two channels, one of them as narrow as a line of the record. */
static struct whittle two_pairs(void)
{
    struct whittle m = { .channels = CHANNELS, .count = 2, .root = { 1.3, 0.4, 0, 0.7 } };

    m.mode[0].lambda = CMPLX(-0.031, 0.73), m.mode[1].lambda = CMPLX(-0.17, 1.9);
    for (int i = 0; i < CHANNELS; i++) {
        m.mode[0].phi[i] = CMPLX(1 - 0.6 * i, 0.2 * i), m.mode[1].phi[i] = CMPLX(0.4 + i, -0.3);
        m.mode[0].kappa[i] = CMPLX(0.07, 0.05 * i), m.mode[1].kappa[i] = CMPLX(-0.1 * i, 0.21);
    }
    return m;
}

static double complex H_of(const struct whittle *m, double complex z, int r, int c)
{
    double complex h = r == c;

    for (int k = 0; k < m->count; k++) {
        double complex mu = cexp(m->mode[k].lambda), p = m->mode[k].phi[r] * m->mode[k].kappa[c];
        h += p / (z - mu) + conj(p) / (z - conj(mu));
    }
    return h;
}

/* H R H^H at w, from its definition. */
static double complex S_of(const struct whittle *m, double w, int r, int c)
{
    double complex z = cexp(CMPLX(0, w)), sum = 0;

    for (int i = 0; i < CHANNELS; i++)
        for (int j = 0; j < CHANNELS; j++) {
            double R = 0;
            for (int k = 0; k < CHANNELS; k++)
                R += m->root[i + CHANNELS * k] * m->root[j + CHANNELS * k];
            sum += H_of(m, z, r, i) * R * conj(H_of(m, z, c, j));
        }
    return sum;
}

static struct bins one_bin(int first, int lines, double *from, double *to, int *counts)
{
    counts[0] = 0, counts[1] = lines;
    *from = 2 * M_PI * (first - 0.5) / N, *to = *from + 2 * M_PI * lines / N;
    return (struct bins) { .count = 1, .channels = CHANNELS, .samples = N, .first = counts,
                           .lines = counts + 1, .from = from, .to = to };
}

/* By the covariances, R_0 and those of all lags, S is what (1) says it is. */
TEST(a_line_shows_the_spectrum_that_the_covariances_have)
{
    struct whittle m = two_pairs();
    struct whittle_covariances v;
    double from, to;
    int counts[2];
    double complex S[CHANNELS * CHANNELS];

    whittle_covariances(&m, &v);
    for (int j = 10; j < 13; j++) {
        struct bins b = one_bin(j, 1, &from, &to, counts);
        whittle_spectrum(&m, &v, &b, 0, S);
        for (int c = 0; c < CHANNELS; c++)
            for (int r = 0; r < CHANNELS; r++)
                CHECK_NEAR(cabs(S[r + CHANNELS * c] - S_of(&m, 2 * M_PI * j / N, r, c)), 0,
                           1e-9 * cabs(S[0]));
    }
}

/* R_0 is the mean of S over all frequencies. */
TEST(the_covariance_at_no_lag_is_the_mean_of_the_spectrum)
{
    enum { FINE = 4096 };
    struct whittle m = two_pairs();
    struct whittle_covariances v;

    whittle_covariances(&m, &v);
    for (int c = 0; c < CHANNELS; c++)
        for (int r = 0; r < CHANNELS; r++) {
            double mean = 0;
            for (int f = 0; f < FINE; f++)
                mean += creal(S_of(&m, 2 * M_PI * f / FINE, r, c)) / FINE;
            CHECK_NEAR((v.zero[r + CHANNELS * c] + v.zero[c + CHANNELS * r]) / 2, mean,
                       1e-10 * fabs(v.zero[0]));
        }
}

/* The integral of a peak over a bin against 400 of its points by the midpoint rule, whose error is
 * (h / 400)^2 / 24 times a second derivative of 2 / 0.031^3. */
TEST(a_bin_shows_the_mean_of_what_lies_in_it)
{
    enum { POINTS = 400, LINES = 4 };
    struct whittle m = two_pairs();
    struct whittle_covariances v;
    double from, to, f, t;
    int counts[2], one[2];
    double complex S[CHANNELS * CHANNELS], point[CHANNELS * CHANNELS], mean = 0;
    struct bins wide = one_bin(9, LINES, &from, &to, counts);

    whittle_covariances(&m, &v);
    whittle_spectrum(&m, &v, &wide, 0, S);
    for (int i = 0; i < POINTS; i++) {
        struct bins b = one_bin(9, 1, &f, &t, one);
        f = t = from + (i + 0.5) * (to - from) / POINTS;
        whittle_spectrum(&m, &v, &b, 0, point);
        mean += point[1] / POINTS;
    }
    CHECK_NEAR(cabs(S[1] - mean), 0, 1e-5 * cabs(mean));
}

/* Of a chi-squared variable the bound holds for every degree of freedom; of 2, where the tail is
 * exp(-t / 2), in closed form. */
TEST(the_price_is_above_what_chance_brings)
{
    const double alarm = 0.01;

    for (int lines = 100; lines <= 1000000; lines *= 10) {
        double twice = 2 * ambient_price(1, lines);
        /* four degrees of freedom: P = exp(-t/2) (1 + t/2) */
        CHECK(exp(-twice / 2) * (1 + twice / 2) * lines <= alarm);
        CHECK(exp(-twice / 2) * (1 + twice / 2) * lines > alarm * 1e-4);
    }
}

/* A record of one channel whose every line has the size that it has in the mean: nothing is left to
 * chance, and likelihood is greatest at the truth. */
enum { LONG = 4096 };

static struct whittle one_channel(void)
{
    struct whittle m = { .channels = 1, .count = 2, .root = { 0.8 } };

    m.mode[0].lambda = CMPLX(-0.02, 0.6), m.mode[1].lambda = CMPLX(-0.05, 1.7);
    m.mode[0].phi[0] = m.mode[1].phi[0] = 1;
    m.mode[0].kappa[0] = CMPLX(0.06, 0.02), m.mode[1].kappa[0] = CMPLX(-0.03, 0.08);
    return m;
}

static struct spectrum lines_of_mean(const struct whittle *m, double complex F[LONG / 2 - 1])
{
    for (int j = 1; j < LONG / 2; j++) {
        double complex z = cexp(CMPLX(0, 2 * M_PI * j / LONG)), h = 1;
        for (int k = 0; k < m->count; k++) {
            double complex mu = cexp(m->mode[k].lambda), p = m->mode[k].kappa[0];
            h += p / (z - mu) + conj(p) / (z - conj(mu));
        }
        F[j - 1] = cabs(h) * m->root[0];
    }
    return (struct spectrum) { .channels = 1, .samples = LONG, .first = 1, .lines = LONG / 2 - 1,
                               .F = F };
}

static double nearest(const struct whittle *found, double complex lambda)
{
    double least = HUGE_VAL;

    for (int k = 0; k < found->count; k++)
        least = fmin(least, cabs(found->mode[k].lambda - lambda));
    return least;
}

/* The past of 100 samples tells all but exp(-0.02 100) of the slower mode's own; noise tells it
 * sooner.  The other orders: fewer miss a pole, and more have these two all the same. */
TEST(subspaces_of_exact_covariances_have_the_poles_in_their_order_and_above)
{
    static double complex F[LONG / 2 - 1];
    struct whittle m = one_channel();
    struct spectrum s = lines_of_mean(&m, F);
    struct subspace from;
    struct whittle found;
    struct modal_error err;

    CHECK(subspace_make(&s, SUBSPACE_SIDE, &from, &err) == MODAL_OK);
    CHECK(subspace_model(&from, 4, &found) && found.count == 2);
    for (int k = 0; k < 2; k++)
        CHECK(nearest(&found, m.mode[k].lambda) < 1e-3);
    CHECK_NEAR(found.root[0], 0.8, 1e-3);
    CHECK(subspace_model(&from, 2, &found) && found.count == 1);
    CHECK(subspace_model(&from, 0, &found) && found.count == 0);
    CHECK(!subspace_model(&from, from.order + 1, &found));
    subspace_done(&from);
}

/* A twentieth of the standard error, which is sqrt(0.02 / LONG) for the slower pole at best. */
TEST(the_search_ends_at_the_truth_where_every_line_has_its_mean)
{
    static double complex F[LONG / 2 - 1];
    struct whittle m = one_channel();
    struct spectrum s = lines_of_mean(&m, F);
    struct ambient_limits limits = { .most = 10 };
    struct ambient_search found;
    struct modal_error err;

    CHECK(ambient_search(&s, &limits, &found, &err) == MODAL_OK);
    CHECK(found.model->count == 2 && found.model->converged && !found.limit);
    for (int k = 0; k < found.model->count; k++) {
        const struct whittle_mode *q = &found.model->mode[k];
        double decay = -creal(q->lambda), au = sqrt(decay / LONG);
        CHECK(q->std_decay > au && q->std_turn > au && q->std_turn < 3 * au);
        CHECK(nearest(found.model, m.mode[k].lambda) < au / 20);
    }
    ambient_search_done(&found);
}

/* The first step of the answer's own fit takes more; what it is corrected by is not climbed. */
TEST(an_answer_whose_work_is_spent_has_a_limit_and_neither_converged_nor_errors)
{
    static double complex F[LONG / 2 - 1];
    struct whittle m = one_channel();
    struct spectrum s = lines_of_mean(&m, F);
    struct ambient_limits limits = { .most = 10, .work = 1 };
    struct ambient_search found;
    struct modal_error err;

    CHECK(ambient_search(&s, &limits, &found, &err) == MODAL_OK);
    CHECK(found.limit && !found.model->converged && found.model->count == 2);
    CHECK(isnan(found.model->mode[0].std_decay) && isnan(found.model->mode[1].std_turn));
    ambient_search_done(&found);
}

/* What a record of LONG samples has in the mean at each line: covariances R_0 and g mu^(k-1) under
 * the triangle 1 - |k| / LONG, summed in closed form. */
static void lines_of_record(const struct whittle *m, double complex F[LONG / 2 - 1])
{
    struct whittle_covariances v;

    whittle_covariances(m, &v);
    for (int j = 1; j < LONG / 2; j++) {
        double complex z = cexp(CMPLX(0, 2 * M_PI * j / LONG)), sum = 0;
        for (int k = 0; k < m->count; k++)
            for (int other = 0; other < 2; other++) {
                double complex mu = cexp(m->mode[k].lambda), g = v.g[k][0];
                mu = other ? conj(mu) : mu, g = other ? conj(g) : g;
                sum += g * (1 / (z - mu) - (1 - cpow(mu, LONG)) * z
                                               / (LONG * (z - mu) * (z - mu)));
            }
        F[j - 1] = sqrt(v.zero[0] + 2 * creal(sum));
    }
}

/* The ends make each pole seem to decay by 1/LONG, 5 % of 0.005, faster: four times the tolerance,
 * which is of the next order, 1/(0.005 LONG)^2 = 0.24 %, and rounded up. */
TEST(a_pole_is_not_wider_for_the_ends_of_the_record)
{
    static double complex F[LONG / 2 - 1];
    struct whittle m = one_channel();
    struct ambient_limits limits = { .most = 10 };
    struct ambient_search found;
    struct modal_error err;
    struct spectrum s;

    m.mode[0].lambda = CMPLX(-0.005, 0.6);
    s = lines_of_mean(&m, F);
    lines_of_record(&m, F);
    CHECK(ambient_search(&s, &limits, &found, &err) == MODAL_OK);
    CHECK(found.model->count == 2);
    for (int k = 0; k < found.model->count; k++) {
        double complex lambda = whittle_exponent(&found.model->mode[k], LONG);
        if (fabs(cimag(lambda) - 0.6) < 0.1)
            CHECK_NEAR(-creal(lambda), 0.005, 0.0125 * 0.005);
    }
    ambient_search_done(&found);
}

TEST(a_sinusoid_is_taken_off_and_noise_is_left_alone)
{
    static double y[2 * LONG], noise[2 * LONG];
    struct matrix Y = { LONG, 2, LONG, y };
    struct ambient_line line[AMBIENT_LINES_MOST];
    struct modal_error err;
    unsigned state = 1;
    int count;

    for (int i = 0; i < 2 * LONG; i++) {
        state = state * 1664525u + 1013904223u;
        noise[i] = state / 4294967296.0 - 0.5;
        y[i] = noise[i] + (3 + i / LONG) * sin(0.4321 * (i % LONG) + i / LONG);
    }
    CHECK(ambient_lines_take(&Y, line, &count, &err) == MODAL_OK && count == 1);
    CHECK_NEAR(line[0].frequency, 0.4321 / (2 * M_PI), 1e-6);
    CHECK_NEAR(line[0].share, (9 + 16) / 4., 0.1);
    for (int i = 0; i < 2 * LONG; i++)
        CHECK(fabs(y[i] - noise[i]) < 0.1);
    ambient_lines_done(line, count);
    CHECK(ambient_lines_take(&Y, line, &count, &err) == MODAL_OK && count == 0);
}
