/* test_identify_any.c - whatever the signals and options, an answer has no NaN where a number
 * belongs, or there is an error with a field
 *
 * Random sizes, ranks, scales (1e+-160 and beyond), degenerate signals and options from a fixed
 * generator; every sanitizer build runs it too.
 */
#include "check.h"
#include <complex.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>
#include "modal/identify/identify.h"

enum { TRIALS = 400 };

static uint64_t seed = 88172645463325252u;

static uint64_t bits(void)
{
    seed ^= seed << 13, seed ^= seed >> 7, seed ^= seed << 17;
    return seed;
}

static double uniform(double low, double high)
{
    return low + (high - low) * (double)(bits() >> 11) / 9007199254740992.0;
}
static int pick(int n) { return (int)(bits() % (uint64_t)n); }

/* One channel of a kind that has broken programs before. */
static void fill(double *x, int K, int S, int c, int kind)
{
    const double scales[] = { 1, 1e160, 1e-160, 1e300, 5e-324, 1e-310, 1e-3 };
    double scale = scales[pick(7)], a = uniform(-0.3, 0.3), w = uniform(0, M_PI);

    for (int k = 0; k < K; k++) {
        double v;
        switch (kind) {
        case 0: v = exp(a * k - fmax(a * K, 0)) * cos(w * k); break;
        case 1: v = uniform(-1, 1); break;
        case 2: v = 0; break;
        case 3: v = 1; break;
        case 4: v = k == K / 2; break;                           /* a spike */
        case 5: v = k % 2 ? -1 : 1; break;                        /* Nyquist */
        case 6: v = (double)k / K; break;                         /* a ramp */
        case 7: v = k < K / 2 ? 0 : 1; break;                     /* a step */
        case 8: v = floor(4 * cos(w * k)) / 4; break;             /* coarse quantisation */
        case 9: v = k * (double)k / K / K; break;                 /* a double root at 1, and more */
        default: v = cos(w * k) + 1e-12 * uniform(-1, 1);
        }
        x[k * S + c] = v * scale;
    }
}

static struct identify_options options(int K)
{
    struct identify_options o = { 0 };

    if (pick(2))
        return o;
    o.method = pick(IDENTIFY_METHOD_COUNT);
    o.rank.rule = pick(RANK_RULE_COUNT);
    o.rank.fixed = o.rank.rule == RANK_FIXED ? 1 + pick(12) : 0;
    o.detrend = pick(DETREND_COUNT);
    o.stride = pick(3) ? 0 : 1 + pick(4);
    o.rows = pick(3) ? 0 : 1 + pick(K);
    o.columns = pick(4) ? 0 : 1 + pick(K);
    o.difference = pick(4) == 0;
    o.shapes = pick(2);
    o.refine = pick(3);
    o.signals_all = pick(3) == 0;
    o.pod_rank = pick(4) ? 0 : 1 + pick(3);
    if (pick(4) == 0)
        o.band[0] = uniform(0, 0.2), o.band[1] = uniform(0.2, 0.6);
    if (pick(4) == 0)
        o.window[0] = uniform(0, K / 2), o.window[1] = uniform(K / 2, K);
    return o;
}

/* Known unknowns may be NAN (standard deviations, persistence, residual); what describes a mode may
 * not. */
static bool sound(const struct identify_result *r)
{
    bool ok = r->verdict == VERDICT_UNDECIDED || r->mode_count > 0;

    for (int i = 0; i < r->mode_count; i++) {
        const struct identify_mode *m = &r->modes[i];
        ok &= isfinite(creal(m->exponent)) && isfinite(cimag(m->exponent)) &&
              isfinite(creal(m->multiplier)) && isfinite(cimag(m->multiplier));
        ok &= isfinite(m->amplitude) && m->amplitude >= 0 && m->energy >= 0 &&
              m->energy <= 1 + 1e-12;
        ok &= cimag(m->exponent) >= 0 && isfinite(creal(m->resolved)) &&
              isfinite(cimag(m->resolved));
        ok &= i == 0 || m->amplitude <= r->modes[i - 1].amplitude;
        for (int c = 0; m->shape != NULL && c < r->channel_count; c++)
            ok &= cabs(m->shape[c]) <= 1 + 1e-9;
    }
    for (int c = 0; c < r->channel_count; c++)
        ok &= isfinite(r->rms_error[c]) &&
              (isnan(r->relative_error[c]) || r->relative_error[c] >= 0);
    for (int i = 0; i < r->cluster_count; i++)
        ok &= isfinite(r->clusters[i].radius) && r->clusters[i].member_count > 0;
    return ok;
}

TEST(any_finite_signal_gets_a_sound_answer_or_an_error_with_a_field)
{
    int answered = 0;

    for (int trial = 0; trial < TRIALS; trial++) {
        int K = 8 + pick(pick(4) ? 60 : 250), S = 1 + pick(pick(5) ? 3 : 14);
        double *x = calloc((size_t)K * S, sizeof *x);
        struct batch batch = { .samples = K,
                               .channels = S,
                               .signals = x,
                               .dt = 1,
                               .period = pick(3)   ? 0
                                         : pick(2) ? 2 + pick(K / 4)
                                                   : uniform(2, K / 3.0) };
        struct identify_options opt = options(K);
        struct identify_result r;
        struct modal_error err = { .field = "" };
        enum modal_status rc;
        for (int c = 0; c < S; c++)
            fill(x, K, S, c, pick(11));
        rc = modal_identify(&batch, &opt, &r, &err);
        if (rc == MODAL_OK ? !sound(&r) : rc != MODAL_BAD_INPUT || err.field[0] == 0)
            fail_msg("trial %d: %d samples, %d channels, period %g: status %d (%s: %s)", trial, K,
                     S, batch.period, rc, err.field, err.message);
        answered += rc == MODAL_OK;
        identify_result_done(&r);
        free(x);
    }
    CHECK(answered > TRIALS / 3);
}

/* The channel that is stuck for 7 samples is 1e261 at most, the other 1e304. */
TEST(samples_that_are_stuck_in_a_channel_below_rounding_are_no_failure_of_the_other)
{
    enum { HEAD = 3, K = 37, S = 2 };
    FILE *file = fopen(TEST_DATA "/../seeds/fuzz_batch/stuck_in_a_channel_below_rounding", "rb");
    double x[K * S];
    struct batch batch = { .samples = K, .channels = S, .signals = x, .dt = 0.1 };
    struct identify_options opt = { .rows = 8, .columns = 8 };
    struct identify_result r;
    struct modal_error err = { .field = "" };

    CHECK(file != NULL && fseek(file, HEAD, SEEK_SET) == 0 && fread(x, sizeof x, 1, file) == 1);
    fclose(file);
    CHECK(modal_identify(&batch, &opt, &r, &err) == MODAL_OK && sound(&r));
    identify_result_done(&r);
}

TEST(the_same_signals_give_the_same_bits)
{
    enum { K = 150 };
    double x[2 * K];
    struct batch batch = { .samples = K, .channels = 2, .signals = x, .dt = 0.1 };
    struct identify_result a, b;

    for (int k = 0; k < K; k++)
        x[2 * k] = exp(-0.01 * k) * cos(0.4 * k) + 0.01 * uniform(-1, 1),
              x[2 * k + 1] = exp(-0.02 * k) * sin(0.9 * k) + 0.01 * uniform(-1, 1);
    CHECK(modal_identify(&batch, NULL, &a, NULL) == MODAL_OK &&
          modal_identify(&batch, NULL, &b, NULL) == MODAL_OK);
    CHECK(a.mode_count == b.mode_count && a.mode_count > 0);
    for (int i = 0; i < a.mode_count; i++)
        CHECK(memcmp(&a.modes[i].exponent, &b.modes[i].exponent, sizeof a.modes[i].exponent) == 0 &&
              a.modes[i].std_re == b.modes[i].std_re);
    identify_result_done(&a), identify_result_done(&b);
}

/* Found by a fuzzer: without its spike and its steps nothing is left of it, and twice no triplets
 * were asked for again and again. Ended by its alarm. */
TEST(of_signals_that_are_zero_without_their_steps_no_more_triplets_are_asked)
{
    static const struct { int row; double value; } first[] = {
        { 0, 2.59034e-319 }, { 12, -9.255959211743199e+61 }, { 14, 9.18582397751693e-310 },
        { 21, -2.6864881219803008e+185 }, { 23, 3.4212928747544036e+304 },
        { 25, -1.6067712815580223e-215 }, { 27, 5.2285142027651986e+54 },
        { 29, 4.0713135017026016e+17 }, { 31, 1.0734583860577621e+272 },
        { 33, 1.9128790971388734e+204 }, { 35, -5.292044301732848e+267 },
        { 37, -492846094591.20215 }, { 39, 1.4239118484080987e-185 },
        { 40, 1.777612657432164e-95 }, { 41, -2.3229159534893675e-117 },
        { 42, -9.11011244532728e+23 }, { 43, -1.0588412888721146e+100 },
        { 44, 6.8222915767499434e+274 }, { 45, 4.5157819634901045e-225 },
        { 46, -3.261491576502662e+77 }
    };
    double y[47 * 2] = { 0 };
    struct batch b = { .samples = 47, .channels = 2, .signals = y, .dt = 0.1, .period = 0.8 };
    struct identify_options opt = { .signals_all = true };
    struct identify_result r;

    for (size_t i = 0; i < sizeof first / sizeof *first; i++)
        y[2 * first[i].row] = first[i].value;
    y[2 * 31 + 1] = -2.50764917479861e+281;
    alarm(20);
    /* how many modes are made of what rounding leaves is the processor's */
    CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK && sound(&r));
    alarm(0);
    identify_result_done(&r);
}
