/* Stable, unstable or undecided: what grows is said to grow however weak it begins, and what merely
 * makes up for a wrong model is not. */
/* Tests as well: diagnose.c trend.c */
#include "check.h"
#include "modal/identify/ask/trend.h"
#include "modal/identify/ask/verdict.h"
#include "modal/identify/identify.h"
#include "signals.h"

enum { SAMPLES = 900, DRAWS = 12 };
static double x[2 * SAMPLES];
static const double dt = 0.02;

/* Of a default identification; VERDICT_UNDECIDED where it fails, which is a failure of its own. */
static int verdict(int channels)
{
    struct batch b = { .samples = SAMPLES, .channels = (size_t)channels, .signals = x, .dt = dt };
    struct identify_options opt = { 0 };
    struct identify_result r;
    int said;

    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
    said = (int)r.verdict;
    identify_result_done(&r);
    return said;
}

static double uniform(struct random *rng, double low, double high)
{
    return low + (high - low) * random_uniform(rng);
}

/* Two decaying modes in two channels, white noise of `noise` on amplitudes of about 1. */
static void decays(struct random *rng, double noise)
{
    double f1 = uniform(rng, 1, 3), f2 = uniform(rng, 4, 8), d1 = uniform(rng, 0.1, 0.4),
           d2 = uniform(rng, 0.2, 0.6), p = uniform(rng, 0, 6);

    for (int k = 0; k < SAMPLES; k++) {
        double t = k * dt, a = exp(-d1 * t) * cos(2 * M_PI * f1 * t + p),
               b = exp(-d2 * t) * cos(2 * M_PI * f2 * t + 1);
        x[2 * k] = a + 0.5 * b + noise * random_normal(rng);
        x[2 * k + 1] = 0.7 * a - 0.4 * b + noise * random_normal(rng);
    }
}

TEST(two_decaying_modes_in_noise_are_stable)
{
    const double levels[3] = { 1e-4, 1e-3, 1e-2 };

    for (int i = 0; i < DRAWS; i++) {
        struct random rng = { 900 + (uint64_t)i };
        decays(&rng, levels[i % 3]);
        CHECK(verdict(2) == VERDICT_STABLE);
    }
}

/* A third mode, a hundredth to a thousandth of the others at the start, that grows thirtyfold;
 * noise ten times below its start. */
TEST(a_mode_that_begins_weak_and_grows_is_unstable)
{
    for (int i = 0; i < DRAWS; i++) {
        struct random rng = { 700 + (uint64_t)i };
        double weak = pow(10, uniform(&rng, -3, -2)), f = uniform(&rng, 9, 15),
               g = log(30) / (SAMPLES * dt);
        decays(&rng, weak / 10);
        for (int k = 0; k < SAMPLES; k++)
            x[2 * k] += weak * exp(g * k * dt) * cos(2 * M_PI * f * k * dt),
                x[2 * k + 1] -= 0.3 * weak * exp(g * k * dt) * sin(2 * M_PI * f * k * dt);
        CHECK(verdict(2) == VERDICT_UNSTABLE);
    }
}

/* A sensor that drifts: half a slow sine and a parabola, a tenth of the signal, whose best
 * exponents may well grow. */
TEST(a_drifting_sensor_makes_no_system_unstable)
{
    for (int i = 0; i < DRAWS; i++) {
        struct random rng = { 300 + (uint64_t)i };
        double a = uniform(&rng, -0.1, 0.1), c = uniform(&rng, -0.1, 0.1),
               w = uniform(&rng, 0.3, 0.9) * M_PI / (SAMPLES * dt), p = uniform(&rng, 0, 6);
        decays(&rng, 1e-3);
        for (int k = 0; k < SAMPLES; k++) {
            double s = k / (double)SAMPLES;
            x[2 * k] += a * s * s + c * sin(w * k * dt + p);
        }
        CHECK(verdict(2) != VERDICT_UNSTABLE);
    }
}

/* Damping by friction, amplitude (1 - t/t0)^2 beside a constant floor of it, and a frequency that
 * rises as it decays: no set of exponents is right. */
TEST(a_mode_damped_by_friction_is_not_unstable)
{
    for (int i = 0; i < DRAWS; i++) {
        struct random rng = { 100 + (uint64_t)i };
        double f = uniform(&rng, 2, 5), soft = uniform(&rng, 0.002, 0.02),
               end = uniform(&rng, 1.05, 1.6) * SAMPLES * dt, phase = 0;
        for (int k = 0; k < SAMPLES; k++) {
            double a = pow(1 - k * dt / end, 2);
            phase += 2 * M_PI * f * (1 - soft * a) * dt;
            x[2 * k] = a * cos(phase) + 1e-3 * random_normal(&rng);
            x[2 * k + 1] = 0.6 * a * cos(phase + 0.2) + 0.02 * a * a * cos(2 * phase) +
                           1e-3 * random_normal(&rng);
        }
        CHECK(verdict(2) != VERDICT_UNSTABLE);
    }
}

/* One mode whose decay rate changes from `first` to `second` in the middle, and a steady one beside
 * it; noise of 1e-3. */
static void changes_rate(struct random *rng, double first, double second)
{
    double f = uniform(rng, 2, 5), a = 1, phase = uniform(rng, 0, 6);

    for (int k = 0; k < SAMPLES; k++) {
        double b = 0.3 * exp(-0.1 * k * dt) * cos(2 * M_PI * (f + 4) * k * dt);
        x[2 * k] = a * cos(2 * M_PI * f * k * dt + phase) + b + 1e-3 * random_normal(rng);
        x[2 * k + 1] = 0.6 * a * cos(2 * M_PI * f * k * dt + phase + 0.2) - b +
                       1e-3 * random_normal(rng);
        a *= exp(-(k < SAMPLES / 2 ? first : second) * dt);
    }
}

/* No constant rate fits, and half a change is the error of the whole; but nothing in the record
 * fails to decay.  More poles would make up for it, so the order is given. */
TEST(a_mode_that_decays_at_two_rates_is_stable_and_one_that_decays_and_grows_is_not)
{
    struct batch b = { .samples = SAMPLES, .channels = 2, .signals = x, .dt = dt };
    struct identify_options opt = { .rank = { .rule = RANK_FIXED, .fixed = 4 } };

    for (int i = 0; i < DRAWS; i++) {
        struct random rng = { 500 + (uint64_t)i };
        bool grows = i % 2 == 1;
        struct identify_result r;
        changes_rate(&rng, uniform(&rng, 0.2, 0.3), grows ? -0.15 : uniform(&rng, 0.02, 0.05));
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        CHECK(grows ? r.verdict != VERDICT_STABLE : r.verdict == VERDICT_STABLE);
        CHECK(r.decides >= 0 && r.decides < r.mode_count);
        identify_result_done(&r);
    }
}

/* Three times the frequency and the growth of a far stronger mode, and surer of it than that one:
 * the harmonic that a nonlinearity makes says nothing of its own.  Twice the growth it would have
 * to have, and it is a mode. */
TEST(a_harmonic_of_a_mode_does_not_decide)
{
    struct identify_mode modes[2] = {
        { .exponent = CMPLX(0.5, 1210), .resolved = CMPLX(0.5, 1210), .multiplier = 1,
          .energy = 0.99, .std_re = 0.3 },
        { .exponent = CMPLX(1.5, 3630), .resolved = CMPLX(1.5, 3630), .multiplier = 1,
          .energy = 0.01, .std_re = 0.1 },
    };
    struct identify_result r = { .modes = modes, .mode_count = 2, .dt = 1e-3, .decimation = 1,
                                 .freedom = 900 };

    modes[0].growth = modes[1].growth = GROWTH_EXACT;
    trend_mark_harmonics(&r);
    verdict_stability(&r, 0.95);
    CHECK(r.verdict == VERDICT_UNDECIDED && r.decides == 0);
    modes[1].exponent = modes[1].resolved = CMPLX(3, 3630);
    modes[1].harmonic = false;
    trend_mark_harmonics(&r);
    verdict_stability(&r, 0.95);
    CHECK(r.verdict == VERDICT_UNSTABLE && r.decides == 1);
}

static int verdict_of_slow(double rate, double std, double energy, enum growth growth)
{
    struct identify_mode mode = {
        .exponent = CMPLX(rate, 0.1), .resolved = CMPLX(rate, 0.1), .multiplier = 1,
        .energy = energy, .persistence = 1, .std_re = std, .std_multiplier = std / 10,
        .growth = growth,
    };
    struct identify_result r = { .modes = &mode, .mode_count = 1, .dt = 1e-3, .decimation = 1,
                                 .freedom = 900 };

    verdict_stability(&r, 1);
    return r.verdict;
}

static int verdict_of_slow_growth(double energy, enum growth growth)
{
    return verdict_of_slow(0.5, 0.01, energy, growth);
}

/* A parabola is e^2 within its noise; e^3.6 known to a sixth is not for sure more than that, and
 * known to a hundredth it is. */
TEST(drift_that_may_rise_as_little_as_a_parabola_is_no_instability)
{
    CHECK(verdict_of_slow(3.6, 0.6, 0.01, GROWTH_IN_HALF) == VERDICT_UNDECIDED);
    CHECK(verdict_of_slow(3.6, 0.04, 0.01, GROWTH_IN_HALF) == VERDICT_UNSTABLE);
    CHECK(verdict_slow(3.6, 0.6, 1) && !verdict_slow(3.6, 0.04, 1));
}

TEST(slow_growth_of_a_strong_mode_is_believed_where_both_halves_show_it_alike)
{
    CHECK(verdict_of_slow_growth(0.99, GROWTH_IN_HALVES) == VERDICT_UNSTABLE);
    CHECK(verdict_of_slow_growth(0.99, GROWTH_IN_HALF) == VERDICT_UNDECIDED);
    CHECK(verdict_of_slow_growth(1e-4, GROWTH_IN_HALVES) == VERDICT_UNDECIDED);
}

/* A strong mode that grows beyond its error is believed where no half of the record could be asked,
 * one of a ten-thousandth of the energy is not. */
TEST(growth_that_no_half_was_asked_for_is_believed_of_strong_modes)
{
    const struct { double energy; enum growth growth; int verdict; } cases[] = {
        { 0.99, GROWTH_UNASKED, VERDICT_UNSTABLE }, { 1e-4, GROWTH_UNASKED, VERDICT_UNDECIDED },
        { 1e-4, GROWTH_EXACT, VERDICT_UNSTABLE },
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        /* slower than the record, which alone would leave it open */
        CHECK(verdict_of_slow_growth(cases[i].energy, cases[i].growth) == cases[i].verdict);
}

/* A mode of 20 standard errors' decay beside one off 0 by Z of its own: noise alone shows so much
 * to that side in one of 2 / erfc(Z / sqrt 2) records. */
TEST(what_noise_shows_once_in_twenty_thousand_records_is_no_verdict)
{
    static const double off[] = { 2.5, 3.5, 4.5, 6 };

    for (int i = 0; i < 8; i++) {
        double z = (i % 2 ? -1 : 1) * off[i / 2];
        bool chance = 20000 * erfc(fabs(z) / sqrt(2)) / 2 > 1;
        struct identify_mode modes[2] = {
            { .exponent = CMPLX(-2, 300), .resolved = CMPLX(-2, 300), .multiplier = 0.998,
              .energy = 0.5, .persistence = 1, .std_re = 0.1 },
            { .exponent = CMPLX(0.1 * z, 900), .resolved = CMPLX(0.1 * z, 900), .multiplier = 1,
              .energy = 0.5, .persistence = 1, .std_re = 0.1 },
        };
        struct identify_result r = { .modes = modes, .mode_count = 2, .dt = 1e-3, .decimation = 1,
                                     .freedom = 900 };

        verdict_stability(&r, 1);
        CHECK(r.verdict == (chance ? VERDICT_UNDECIDED : z > 0 ? VERDICT_UNSTABLE
                                                               : VERDICT_STABLE));
        CHECK(r.verdict == VERDICT_STABLE || r.decides == 1);
        CHECK_NEAR(r.margin_std, 0.1, 1e-12);
    }
}

/* A motion gone in 824 nepers a period: its multiplier is below the least double and its logarithm
 * is anybody's guess, but |rho| is at most its bar, and a bar below 1 decays. */
TEST(a_multiplier_below_the_least_number_is_judged_by_its_bar)
{
    const struct { double bar; int verdict; } cases[] = {
        { 0, VERDICT_STABLE }, { 0.94, VERDICT_STABLE }, { 1.06, VERDICT_UNDECIDED },
        { NAN, VERDICT_UNDECIDED },
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct identify_mode mode = {
            .exponent = -32640, .resolved = -32640, .multiplier = 0, .energy = 1,
            .persistence = NAN,
            .std_re = NAN, .std_multiplier = NAN, .bar = cases[i].bar,
        };
        struct identify_result r = { .modes = &mode, .mode_count = 1, .period = 0.0253,
                                     .freedom = 100 };

        verdict_stability(&r, 0.3);
        CHECK((int)r.verdict == cases[i].verdict);
    }
}

/* Van der Pol's oscillator from three times its limit cycle, by the midpoint rule: the motion that
 * stays does not decay. */
TEST(what_settles_on_a_limit_cycle_is_not_stable)
{
    for (int i = 0; i < 4; i++) {
        struct random rng = { 40 + (uint64_t)i };
        double w = 2 * M_PI * uniform(&rng, 1, 3), e = uniform(&rng, 0.1, 0.4), q = 6, v = 0,
               h = dt / 20;
        for (int k = 0; k < SAMPLES; k++) {
            x[2 * k] = q + 1e-3 * random_normal(&rng),
                  x[2 * k + 1] = v / w + 1e-3 * random_normal(&rng);
            for (int s = 0; s < 20; s++) {
                double qm = q + h / 2 * v, vm = v + h / 2 * (e * (1 - q * q) * v - w * w * q);
                q += h * vm;
                v += h * (e * (1 - qm * qm) * vm - w * w * qm);
            }
        }
        CHECK(verdict(2) != VERDICT_STABLE);
    }
}

/* One line of one signal that decays, whose phase wanders by 0.5 to 3 rad some times a second, and
 * its third harmonic: exponents that grow and decay make up for that, to any accuracy. */
TEST(of_lines_that_wander_and_decay_hardly_one_in_ten_is_called_unstable)
{
    const int lines = check_draws(20, 40);
    const double step = 1 / 1280.0;
    int unstable = 0;

    for (int i = 0; i < lines; i++) {
        struct random rng = { (uint64_t)i };
        int n = (int)uniform(&rng, 250, 700);
        double f = 2 * M_PI * uniform(&rng, 150, 250), decay = uniform(&rng, 0.02, 0.3),
               far = uniform(&rng, 0.5, 3), w = 2 * M_PI * uniform(&rng, 1, 4),
               p = uniform(&rng, 0, 6), q = uniform(&rng, 0, 6), beat = uniform(&rng, 0, 0.1),
               noise = pow(10, uniform(&rng, -3, -1.5)), third = uniform(&rng, 0, 0.05);
        struct batch b = { .samples = (size_t)n, .channels = 1, .signals = x, .dt = step };
        struct identify_result r;
        for (int k = 0; k < n; k++) {
            double t = k * step, phase = f * t + far * sin(w * t + q) + p,
                   size = exp(-decay * t) * (1 + beat * sin(1.3 * w * t));
            x[k] = size * (cos(phase) + third * cos(3 * phase)) + noise * random_normal(&rng);
        }
        CHECK(modal_identify(&b, NULL, &r, NULL) == MODAL_OK);
        unstable += r.verdict == VERDICT_UNSTABLE;
        identify_result_done(&r);
    }
    CHECK(unstable <= lines / 10);
}

/* e^{0.009 k} sin(w k) / w nearly meets its conjugate: a cluster within a small radius, but with
 * error bars of rounding.  |rho| - 1 = 0.00904. */
TEST(a_close_cluster_that_rounding_resolves_is_decided)
{
    const double turns[] = { 0.001, 0.002, 0.004 };

    for (int i = 0; i < 6; i++) {
        double sign = i < 3 ? 1 : -1, w = turns[i % 3];
        struct batch b = { .samples = 120, .channels = 1, .signals = x, .dt = 1 };
        struct identify_options opt = { 0 };
        struct identify_result r;
        for (int k = 0; k < 120; k++)
            x[k] = exp(sign * 0.009 * k) * sin(w * k) / w;
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        CHECK(r.verdict == (sign > 0 ? VERDICT_UNSTABLE : VERDICT_STABLE));
        identify_result_done(&r);
    }
}
