/* test_long_records.c - records of some 10^5 samples: begun at their head, and told by all of it */
#include "check.h"
#include "modal/identify/identify.h"
#include "signals.h"

enum { ROWS = 150000, CHANNELS = 2 };
static double y[ROWS * CHANNELS];

/* Powers of each pole, of unit amplitude and phases at random, in noise of SD. */
static struct batch record(const double complex *lambda, int modes, double sd, struct random *rng)
{
    for (int i = 0; i < ROWS * CHANNELS; i++)
        y[i] = sd * random_normal(rng);
    for (int j = 0; j < modes; j++)
        for (int c = 0; c < CHANNELS; c++) {
            double complex B = cexp(I * 2 * M_PI * random_uniform(rng));
            for (int l = 0; l < ROWS; l++)
                y[l * CHANNELS + c] += creal(B * cexp(lambda[j] * l));
        }
    return (struct batch) { .samples = ROWS, .channels = CHANNELS, .signals = y, .dt = 1 };
}

/* As many modes, and each of the poles within five of its errors. */
static bool all_found(const struct identify_result *r, const double complex *lambda, int modes)
{
    bool all = r->mode_count == modes;

    for (int j = 0; j < modes && all; j++) {
        int at = 0;
        for (int m = 1; m < modes; m++)
            if (cabs(r->modes[m].exponent - lambda[j]) < cabs(r->modes[at].exponent - lambda[j]))
                at = m;
        all = fabs(creal(r->modes[at].exponent - lambda[j])) < 5 * r->modes[at].std_re
            && fabs(cimag(r->modes[at].exponent - lambda[j])) < 5 * r->modes[at].std_im;
    }
    return all;
}

/* The Cramer-Rao bound of one pole far from others: sums over the rows of e^{2al}, l e^{2al} and
 * l^2 e^{2al}, one unit of amplitude in each channel. */
static double bound(double complex lambda, double sd)
{
    double s0 = 0, s1 = 0, s2 = 0;

    for (int l = 0; l < ROWS; l++) {
        double e = exp(2 * creal(lambda) * l);
        s0 += e, s1 += l * e, s2 += (double)l * l * e;
    }
    return sd / sqrt(CHANNELS * (s2 - s1 * s1 / s0) / 2);
}

/* Over the whole band, slow and fast decay, one that grows: no Hankel matrix of all rows is made,
 * and errors are those of all rows. */
TEST(modes_of_a_long_record_are_found_from_its_head_with_the_errors_of_all_of_it)
{
    static const double complex lambda[] = { CMPLX(-2e-5, 0.02), CMPLX(-1e-5, 0.7),
                                             CMPLX(-4e-4, 1.5), CMPLX(-3e-6, 2.2),
                                             CMPLX(-2e-4, 3.0) };
    struct random rng = { 31 };
    struct batch b = record(lambda, 5, 0.1, &rng);
    struct identify_result r;

    CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
    CHECK(all_found(&r, lambda, 5) && r.verdict == VERDICT_STABLE && r.samples == ROWS);
    CHECK(r.used.rows + r.used.columns < ROWS / 2);
    for (int m = 0; m < r.mode_count; m++)
        CHECK_NEAR(r.modes[m].std_im / bound(r.modes[m].exponent, 0.1), 1, 0.05);
    identify_result_done(&r);
}

/* A tenth of a beat in the head, three in the whole. */
TEST(two_modes_that_the_head_cannot_tell_apart_are_told_by_all_of_it)
{
    const double apart = 2 * M_PI * 3 / ROWS;
    const double complex lambda[] = { CMPLX(-1e-5, 0.7), CMPLX(-1.2e-5, 0.7 + apart),
                                      CMPLX(-2e-5, 1.9) };
    struct random rng = { 32 };
    struct batch b = record(lambda, 3, 0.1, &rng);
    struct identify_result r;

    CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
    CHECK(all_found(&r, lambda, 3) && r.verdict == VERDICT_STABLE);
    CHECK(r.used.rows + r.used.columns < ROWS / 2);
    identify_result_done(&r);
}

/* Below the noise in the head: growth is seen in what the fit to all rows leaves. */
TEST(a_mode_that_grows_out_of_the_noise_after_the_head_is_found)
{
    const double complex lambda[] = { CMPLX(-1e-5, 0.7), CMPLX(7e-5, 1.3) };
    struct random rng = { 33 };
    struct batch b = record(lambda, 1, 0.1, &rng);
    struct identify_result r;

    for (int c = 0; c < CHANNELS; c++)
        for (int l = 0; l < ROWS; l++)
            y[l * CHANNELS + c] += creal(cexp(lambda[1] * (l - ROWS) + I * c));
    CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
    CHECK(all_found(&r, lambda, 2) && r.verdict == VERDICT_UNSTABLE);
    identify_result_done(&r);
}

/* Nothing but noise in the head: it is begun at its end; no Hankel matrix of all rows is made. */
TEST(a_long_record_that_only_grows_is_found_from_its_end_with_the_errors_of_all_of_it)
{
    const double complex lambda[] = { CMPLX(1e-4, 1.3), CMPLX(7e-5, 0.4) };
    struct random rng = { 36 };
    struct batch b = record(lambda, 0, 0.1, &rng);
    struct identify_result r;

    for (int j = 0; j < 2; j++)
        for (int c = 0; c < CHANNELS; c++)
            for (int l = 0; l < ROWS; l++)
                y[l * CHANNELS + c] += creal(cexp(lambda[j] * (l - ROWS) + I * c));
    CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
    CHECK(all_found(&r, lambda, 2) && r.verdict == VERDICT_UNSTABLE);
    CHECK(r.used.rows + r.used.columns < ROWS / 2);
    for (int m = 0; m < r.mode_count; m++) {
        double complex decays = -conj(r.modes[m].exponent);  /* the same in reversed time */
        CHECK_NEAR(r.modes[m].std_im / bound(decays, 0.1), 1, 0.05);
    }
    identify_result_done(&r);
}

/* So many that a fit goes by sums in closed form, which read no blocks; what it leaves is asked
 * for by blocks all the same. */
TEST(forty_modes_of_a_long_record_are_found)
{
    enum { MODES = 40 };
    double complex lambda[MODES];
    struct random rng = { 37 };
    struct batch b;
    struct identify_result r;

    for (int j = 0; j < MODES; j++)
        lambda[j] = CMPLX(-2e-5 - 1e-4 * random_uniform(&rng),
                          0.05 + 0.075 * (j + 0.5 * random_uniform(&rng)));
    b = record(lambda, MODES, 0.1, &rng);
    CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
    CHECK(all_found(&r, lambda, MODES) && r.verdict == VERDICT_STABLE);
    identify_result_done(&r);
}

/* Exact signals leave rounding, and nothing else is made of it. */
TEST(a_long_record_without_noise_shows_its_modes_to_rounding)
{
    const double complex lambda[] = { CMPLX(-1e-5, 0.7), CMPLX(-3e-5, 2.1) };
    struct random rng = { 34 };
    struct batch b = record(lambda, 2, 0, &rng);
    struct identify_result r;

    CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
    CHECK(r.mode_count == 2 && r.verdict == VERDICT_STABLE);
    for (int m = 0; m < r.mode_count; m++)
        CHECK(fmin(cabs(r.modes[m].exponent - lambda[0]), cabs(r.modes[m].exponent - lambda[1]))
              < 1e-14);
    identify_result_done(&r);
}

static size_t spared;
static const double *spared_to;

/* In their order; and all of them where all have been copied, for what is looked at again. */
static void count_spared(const void *from, size_t bytes)
{
    if (spared == sizeof y && from == y && bytes == sizeof y)
        return;
    CHECK(spared_to == NULL || (const double *)from == spared_to);
    spared += bytes, spared_to = (const double *)from + bytes / sizeof *spared_to;
}

TEST(samples_are_given_back_once_as_they_are_copied)
{
    const double complex lambda[] = { CMPLX(-1e-5, 0.7) };
    struct random rng = { 35 };
    struct batch b = record(lambda, 1, 0.1, &rng);
    struct identify_result r;

    b.spare = count_spared;
    CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK && all_found(&r, lambda, 1));
    CHECK(spared == sizeof y && spared_to == y + ROWS * CHANNELS);
    identify_result_done(&r);
}
