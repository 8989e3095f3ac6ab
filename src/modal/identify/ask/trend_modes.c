/* trend_modes.c - what modes alone say that are none of the system's: see trend.h */
#include "modal/identify/ask/trend.h"
#include <math.h>
#include "modal/identify/ask/diagnose.h"
#include "modal/identify/fit/refine.h"
#include "modal/identify/linear/exponents.h"

static const double
    HARMONIC_NEAR = 5e-3,          /* a harmonic of a nonlinearity: off its frequency, */
    HARMONIC_DECAY = 0.3,          /* and off its decay rate */
    MAINS_NEAR = 1e-3,             /* off a frequency of the mains: as far as grids let it go */
    MAINS_DAMPING = 2e-4,          /* ratio: less than structures have */
    DRIFT_SLOW = 1.5,              /* rad over the record: a quarter of a turn */
    DRIFT_LEAST = 0.01;            /* of the energy */
enum { MAINS_HARMONICS = 5 };      /* of the mains' frequency */
/* Coincidences that a record of independent modes may be expected to have: one in twenty. */
static const double HARMONIC_CHANCE = 0.05;

int trend_multiple_of(double complex lambda, double complex base)
{
    /* quadratic and cubic forces answer at twice and three times */
    double f = cimag(lambda) / cimag(base), n = nearbyint(f);

    return cimag(base) > 0 && (n == 2 || n == 3) && fabs(f - n) < HARMONIC_NEAR * n ? (int)n : 0;
}

/* Weak enough beside A to be its harmonic? */
static bool is_weak(const struct identify_mode *b, const struct identify_mode *a)
{
    return b->energy <= TREND_HARMONIC * a->energy;
}

/*
 * What independent modes do by chance. LOOKS pairs of a mode and two or three times another are
 * there to coincide; with frequencies anywhere up to the HIGHEST and damping ratios anywhere over
 * their own RANGE, in natural logarithms, one comes as near as a pair at distances d and e, or as
 * its errors let us tell, with chances p = 2 d / HIGHEST and q = 2 e / RANGE, at most 1. So many
 * are expected to have no greater a product of the two:
 *
 *     LOOKS p q (1 - ln p q),                                                           (1)
 *
 * LOOKS p where all damping ratios are alike.
 */
struct chance { double looks, highest, range; };

static struct chance chance_of(const struct identify_result *r)
{
    struct chance c = { 0 };
    double least = HUGE_VAL, most = 0;

    for (int i = 0; i < r->mode_count; i++) {
        double zeta = fabs(damping_ratio_of(r->modes[i].exponent));
        c.highest = fmax(c.highest, cimag(r->modes[i].exponent));
        if (zeta > 0 && cimag(r->modes[i].exponent) > 0)
            least = fmin(least, zeta), most = fmax(most, zeta);
    }
    c.range = most > least ? log(most / least) : 0;
    for (int i = 0; i < r->mode_count; i++)
        for (int j = 0; j < r->mode_count; j++)
            for (int n = 2; n <= 3; n++) {
                double f = n * cimag(r->modes[i].exponent);
                c.looks += f > 0 && f <= c.highest && is_weak(&r->modes[j], &r->modes[i]);
            }
    return c;
}

/* (1) for B at N times A. */
static double by_chance(const struct chance *c, const struct identify_mode *b,
                        const struct identify_mode *a, int n)
{
    double rate = creal(b->exponent) / creal(a->exponent) / n;
    double d = fabs(cimag(b->exponent) - n * cimag(a->exponent)), e = fabs(log(rate));

    if (b->std_im >= 0 && a->std_im >= 0) {
        d = fmax(d, hypot(b->std_im, n * a->std_im));  /* no nearer than errors tell */
        e = fmax(e, hypot(b->std_re / creal(b->exponent), a->std_re / creal(a->exponent)));
    }
    d = fmin(1, 2 * d / c->highest);
    e = c->range > 0 ? d * fmin(1, 2 * e / c->range) : d;
    /* (1): P(p q <= e) of two uniform numbers is e (1 - ln e) */
    return c->looks * (c->range > 0 && e > 0 ? e * (1 - log(e)) : e);
}

/* 2 or 3, where B is that harmonic of A: it decays as that power of it, too, and is nearer than
 * modes come by chance; else 0. */
static int harmonic_of(const struct chance *c, const struct identify_mode *b,
                       const struct identify_mode *a)
{
    int n = is_weak(b, a) ? trend_multiple_of(b->exponent, a->exponent) : 0;

    return n > 0 && fabs(creal(b->exponent) / creal(a->exponent) / n - 1) < HARMONIC_DECAY
        && by_chance(c, b, a, n) < HARMONIC_CHANCE ? n : 0;
}

void trend_mark_harmonics(struct identify_result *r)
{
    struct chance c = chance_of(r);

    for (int i = 0; i < r->mode_count; i++)
        for (int j = 0; j < r->mode_count; j++)
            r->modes[j].harmonic |= harmonic_of(&c, &r->modes[j], &r->modes[i]) > 0;
}

static void look_for_harmonics(struct identify_result *r)
{
    struct chance c = chance_of(r);

    for (int i = 0; i < r->mode_count; i++)
        for (int j = 0; j < r->mode_count; j++) {
            const struct identify_mode *a = &r->modes[i], *b = &r->modes[j];
            int n = harmonic_of(&c, b, a);
            if (n > 0)
                identify_diagnose(r, "harmonic_of_mode", -1, "%.5g Hz is %d times %.5g Hz and "
                                  "decays as its power: a harmonic of that mode "
                                  "(nonlinearity), not a mode", cimag(b->exponent) / (2 * M_PI), n,
                                  cimag(a->exponent) / (2 * M_PI));
        }
}

static void look_for_mains(struct identify_result *r)
{
    static const double mains[] = { 50, 60 };

    for (int i = 0; i < r->mode_count; i++)
        for (int m = 0; m < 2; m++) {
            double hz = cimag(r->modes[i].exponent) / (2 * M_PI), n = nearbyint(hz / mains[m]);
            if (n >= 1 && n <= MAINS_HARMONICS && fabs(hz - n * mains[m]) < MAINS_NEAR * mains[m]
                && fabs(damping_ratio_of(r->modes[i].exponent)) < MAINS_DAMPING)
                identify_diagnose(
                    r, "mains_line", -1,
                    "%.5g Hz is an undamped line at %g times %g Hz: mains, not a mode", hz, n,
                    mains[m]);
        }
}

/* What neither decays nor grows by its error, when that is known to UNDAMPED over the record. */
static void look_for_undamped(struct identify_result *r, double record)
{
    const double UNDAMPED = 0.01;

    for (int i = 0; i < r->mode_count; i++) {
        const struct identify_mode *m = &r->modes[i];
        double bar = REFINE_CLEAR * m->std_re;
        if (cimag(m->exponent) * record > 4 * M_PI && fabs(creal(m->exponent)) <= bar
            && bar * record < UNDAMPED)
            identify_diagnose(r, "undamped", -1, "mode %d (%.5g Hz) keeps its amplitude over the "
                              "record to %.2g: a steady force, a limit cycle or a mode without "
                              "damping, which the record cannot tell apart", i,
                              cimag(m->exponent) / (2 * M_PI), bar * record);
    }
}

static void look_for_drift(struct identify_result *r, double record)
{
    bool vibrates = false;

    for (int i = 0; i < r->mode_count; i++)
        vibrates |= cimag(r->modes[i].exponent) * record > 4 * M_PI;
    for (int i = 0; i < r->mode_count && vibrates; i++)
        /* less than a quarter of a turn: offset, slope and curvature are all that is seen */
        if (cabs(r->modes[i].exponent) * record < DRIFT_SLOW && r->modes[i].energy > DRIFT_LEAST) {
            identify_diagnose(r, "drift", -1,
                              "%.2g of the energy moves more slowly than the record of %g s: drift "
                              "or a rigid motion; its exponent says little, "
                              "and `detrend` or `band` removes it",
                              r->modes[i].energy, record);
            return;
        }
}

void trend_of_modes(double record, struct identify_result *result)
{
    look_for_harmonics(result);
    look_for_mains(result);
    look_for_undamped(result, record);
    look_for_drift(result, record);
}
