/* Defaults on systems nobody tuned them to: exponents drawn at random, the order unknown, in
 * records short and long.
 *
 * Frequencies at least three lines of the record apart, each mode living through a good part of it,
 * amplitudes within a factor of three: whoever knows where to look finds them all at 20 dB, so a
 * missing mode or one too many is a fault.  Errors are judged by the standard errors stated: beyond
 * five of them in two hundred numbers is none by chance. */
#include "modal/identify/identify.h"
#include <stdlib.h>
#include "check.h"
#include "signals.h"

enum { MODES = 4, SAMPLES = 1000, CHANNELS = 80, DRAWS = 15 };
static double x[SAMPLES * CHANNELS];

struct kind { int samples[2], channels[2], modes[2]; bool grows, offset; };
struct truth { int modes, samples, channels; double dt; double complex lambda[MODES]; };

static int between(struct random *rng, const int range[2])
{
    return range[0] + (int)(random_uniform(rng) * (range[1] - range[0] + 1));
}

static bool apart(const struct truth *t, double f)
{
    for (int j = 0; j < t->modes; j++)
        if (fabs(cimag(t->lambda[j]) / (2 * M_PI) - f) < 3 / (t->samples * t->dt))
            return false;
    return true;
}

static struct truth draw(const struct kind *k, struct random *rng)
{
    struct truth t = { 0,
                       between(rng, k->samples),
                       between(rng, k->channels),
                       pow(10, 5 * random_uniform(rng) - 4),
                       { 0 } };
    int wanted = between(rng, k->modes);
    double record = t.samples * t.dt;

    for (int tries = 0; t.modes < wanted && tries < 200; tries++) {
        double f = 4 / record + random_uniform(rng) * (0.42 / t.dt - 4 / record);
        if (apart(&t, f))
            t.lambda[t.modes++] = CMPLX(-(0.5 + 5.5 * random_uniform(rng)) / record, 2 * M_PI * f);
    }
    if (k->grows)
        t.lambda[0] = CMPLX(-creal(t.lambda[0]), cimag(t.lambda[0]));
    return t;
}

/* Samples of unit size, then white noise so many dB below; 0: none. */
static void fill(const struct truth *t, const struct kind *k, double snr_db, struct random *rng)
{
    double power = 0, sd, record = t->samples * t->dt;
    int n = t->samples * t->channels;

    memset(x, 0, sizeof *x * (size_t)n);
    for (int j = 0; j < t->modes; j++)
        for (int c = 0; c < t->channels; c++) {
            double a = (0.3 + 0.7 * random_uniform(rng)) *
                       exp(-fmax(0, creal(t->lambda[j]) * record) / 2),
                   p = 2 * M_PI * random_uniform(rng);
            for (int l = 0; l < t->samples; l++)
                x[l * t->channels + c] += a * exp(creal(t->lambda[j]) * l * t->dt) *
                                          cos(cimag(t->lambda[j]) * l * t->dt + p);
        }
    for (int i = 0; i < n; i++)
        power += x[i] * x[i] / n;
    sd = snr_db > 0 ? sqrt(power) * pow(10, -snr_db / 20) : 0;
    for (int i = 0; i < n; i++)
        x[i] += sd * random_normal(rng) + (k->offset ? 1.7 - 0.3 * (i % t->channels) : 0);
}

/* Every true exponent within five standard errors, or 1e-9 of its size, of a mode found, and as
 * many modes as true ones. */
static bool right(const struct truth *t, const struct kind *k, const struct identify_result *r)
{
    bool good = r->mode_count == t->modes && (r->offset != NULL) == k->offset &&
                r->verdict == (k->grows ? VERDICT_UNSTABLE : VERDICT_STABLE);

    for (int j = 0; j < t->modes && good; j++) {
        const struct identify_mode *m = &r->modes[0];
        double tiny = 1e-9 * cabs(t->lambda[j]);
        for (int i = 1; i < r->mode_count; i++)
            if (cabs(r->modes[i].exponent - t->lambda[j]) < cabs(m->exponent - t->lambda[j]))
                m = &r->modes[i];
        good = fabs(creal(m->exponent - t->lambda[j])) <= fmax(tiny, 5 * m->std_re) &&
               fabs(cimag(m->exponent - t->lambda[j])) <= fmax(tiny, 5 * m->std_im);
    }
    return good;
}

static int wrong_of_kind(struct kind k, uint64_t seed)
{
    const double levels[4] = { 0, 60, 40, 20 };
    int wrong = 0;

    for (int i = 0; i < 4 * DRAWS; i++) {
        struct random rng = { seed + 7919 * (uint64_t)i };
        struct truth t = draw(&k, &rng);
        struct identify_options opt = { 0 };
        struct identify_result r;
        fill(&t, &k, levels[i % 4], &rng);
        struct batch b = {
            .samples = (size_t)t.samples, .channels = (size_t)t.channels, .signals = x, .dt = t.dt
        };
        CHECK(modal_identify(&b, &opt, &r, NULL) == MODAL_OK);
        wrong += !right(&t, &k, &r);
        identify_result_done(&r);
    }
    return wrong;
}

TEST(a_few_channels_give_their_modes)
{
    CHECK(wrong_of_kind((struct kind){ { 100, 900 }, { 1, 5 }, { 1, 4 }, false, false }, 1) == 0);
}

/* With four modes in one channel no order below eight need fit better than two. */
TEST(one_channel_gives_four_modes)
{
    CHECK(wrong_of_kind((struct kind){ { 100, 900 }, { 1, 1 }, { 4, 4 }, false, false }, 2) <= 1);
}

/* Noise left to 20 samples looks like a mode now and then: one in sixty may. */
TEST(twenty_to_sixty_samples_give_no_mode_too_many)
{
    CHECK(wrong_of_kind((struct kind) { { 24, 60 }, { 1, 3 }, { 1, 2 }, false, false }, 3) <= 1);
}

TEST(many_channels_of_few_modes_are_not_drowned_by_their_noise)
{
    CHECK(wrong_of_kind((struct kind){ { 100, 400 }, { 20, 80 }, { 1, 4 }, false, false }, 4) == 0);
}

TEST(growth_and_offsets_are_told)
{
    CHECK(wrong_of_kind((struct kind){ { 100, 900 }, { 1, 5 }, { 1, 4 }, true, false }, 5) == 0);
    CHECK(wrong_of_kind((struct kind){ { 100, 900 }, { 1, 5 }, { 1, 4 }, false, true }, 6) == 0);
}
