/* diagnose.c - the conditions behind each code; the texts say what to do */
#include "modal/identify/ask/diagnose.h"
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include "modal/identify/linear/exponents.h"
#include "modal/identify/prepare/rounding.h"

static const double
    FADES = 4,                      /* 2 % are left a row later */
    TIE = 0.8,                      /* of the strongest harmonic: noise may have decided */
    ALIASED = 0.3,                  /* of it: a mode of its own may be there */
    POOR = 0.7;                     /* of a signal's rms: hardly half of its energy is rebuilt */

void identify_diagnose(struct identify_result *result, const char *code, int channel,
                       const char *format, ...)
{
    struct identify_diagnostic *d = &result->diagnostics[result->diagnostic_count];
    va_list arguments;

    if (result->diagnostic_count >= IDENTIFY_DIAGNOSTICS_MOST)
        return;
    result->diagnostic_count++;
    snprintf(d->code, sizeof d->code, "%s", code);
    d->channel = channel;
    va_start(arguments, format);
    vsnprintf(d->message, sizeof d->message, format, arguments);
    va_end(arguments);
}

void diagnose_near_nyquist(struct identify_result *result, int i, double turn)
{
    if (turn > DIAGNOSE_NYQUIST)
        identify_diagnose(result, "near_nyquist", -1,
                          "mode %d lies at %.3g of the Nyquist frequency: a faster mode may have "
                          "folded there; sample faster",
                          i, turn);
}

/* two multipliers, and one equation more that could contradict them */
enum { PAIR_ROWS = 3 };
static const double GROWTH_HIDES = 28;     /* e^28 = 1.4e12: four digits are left of the rest */

static void about_rank(struct identify_result *r, const struct diagnose_facts *f)
{
    if (f->asked_rank > f->full_rank)
        identify_diagnose(
            r, "rank_at_rounding", -1,
            "rank %d was asked for, but only %d singular values are above rounding: multipliers "
            "beyond are made of rounding errors and were left out; ask for at most %d",
            f->asked_rank, f->full_rank, f->full_rank);
    if (f->cut_pair)
        identify_diagnose(r, "cut_pair", -1,
                          "rank %d cuts a conjugate pair in two: its exponents are wrong; use %d, "
                          "or leave rank.rule to auto",
                          f->asked_rank, f->asked_rank + 1);
    else if (f->rank_low)
        identify_diagnose(r, "rank_too_low", -1,
                          "a higher rank than %d fits far better: weaker modes, unstable ones "
                          "among them, may be missing; leave rank.rule to auto",
                          f->asked_rank);
    if (f->order > 0 && f->rows < f->order + 3)
        identify_diagnose(r, "too_many_unknowns", -1,
                          "%d equations for %d unknowns a phase and signal: a small reconstruction "
                          "error proves nothing; record more periods or lower the rank",
                          f->rows, f->order);
    if (f->work_limit)
        identify_diagnose(r, "order_work_limit", -1,
                          "the search for an order ended where its work was spent: the answer is "
                          "the best seen, and more or fewer modes may fit better; give `band` or "
                          "`window` to look at less, or rank.fixed");
    if (!f->converged)
        identify_diagnose(r, "not_converged", -1, "the refinement did not converge: the exponents "
                          "are those with the least residual seen, their errors unknown, and no "
                          "verdict is given; give `band` or `window` to look "
                          "at less, or rank.fixed, or response=ambient where it is excited all "
                          "the time");
}

static void about_mode(struct identify_result *r, const struct diagnose_facts *f, int i)
{
    const struct identify_mode *m = &r->modes[i];
    double turn = fabs(cimag(m->exponent)) * f->tau, decay = -creal(m->exponent) * f->tau;

    if (decay > FADES)
        identify_diagnose(
            r, "fast_decay", -1,
            "mode %d decays by exp(-%.3g) from one row to the next: it is gone after a few; its "
            "exponent rests on them alone. Sample faster, or start the window later to drop it",
            i, decay);
    if (-decay * f->rows > GROWTH_HIDES)
        identify_diagnose(r, "growth_hides", -1,
                          "mode %d grows by exp(%.3g) over the record: whatever did not grow with "
                          "it is below its rounding errors; use a shorter window to see the rest",
                          i, -decay * f->rows);
    if (r->period == 0 && r->decimation == 1 && r->shift == 1)
        diagnose_near_nyquist(r, i, turn / M_PI);
    if (r->period > 0 && m->runner_up >= TIE)
        identify_diagnose(r, "near_tie", -1,
                          "mode %d: two harmonics are nearly equally strong (ratio %.3g), so the "
                          "integer %d that resolves its frequency is not certain",
                          i, m->runner_up, m->resolved_k);
    if (r->period > 0 && m->runner_up >= ALIASED && m->harmonic_count > 1)
        identify_diagnose(r, "aliases", -1,
                          "mode %d has strong harmonics %d and %d: one multiplier, or several "
                          "modes whose frequencies differ by multiples of 1/period; the signals "
                          "cannot tell. For constant coefficients give period 0",
                          i, m->harmonics[0].k, m->harmonics[1].k);
}

/* Two strong modes, or one, that the record is too short to tell: the numbers rest on the model
 * being exact. */
static void about_length(struct identify_result *r, const struct diagnose_facts *f)
{
    const double STRONG = 0.01;

    for (int i = 0; i < r->mode_count; i++) {
        const struct identify_mode *m = &r->modes[i];
        double cycles = cimag(m->exponent) * f->record / (2 * M_PI);
        if (r->period > 0 || m->energy < STRONG || cimag(m->exponent) == 0)
            continue;
        if (cycles < 2)             /* an offset and a slope look like what is left of less */
            identify_diagnose(
                r, "short_record", -1,
                "mode %d turns %.2g times in the record: its damping, and the standard errors, "
                "hold only if the motion is exactly a sum of exponentials; record longer",
                i, cycles);
        for (int j = i + 1; j < r->mode_count; j++) {
            double beat =
                fabs(cimag(m->exponent) - cimag(r->modes[j].exponent)) * f->record / (2 * M_PI);
            if (beat < 0.5 && r->modes[j].energy >= STRONG && cimag(r->modes[j].exponent) != 0)
                identify_diagnose(r, "unresolved_pair", -1,
                                  "modes %d and %d differ by %.2g of a beat over the record: they "
                                  "are told apart by the model alone, and a slow change of one "
                                  "mode looks the same; record longer",
                                  i, j, beat);
        }
    }
}

/* Channels of no motion have no relative error; those of rounding alone are told by
 * about_rounding. */
static void about_zeros(struct identify_result *r, const struct diagnose_facts *f)
{
    for (int c = 0; c < r->channel_count; c++)
        if (isnan(r->relative_error[c]) && (f->below == NULL || !f->below[c]))
            identify_diagnose(r, "zero_channel", r->channel[c], "channel %d is zero throughout "
                              "what is identified: not connected, or not moved; it says "
                              "nothing and is left out", r->channel[c]);
}

/* A strong channel or an orbit hides the others. */
static void about_channels(struct identify_result *r)
{
    int said = 0;

    if (r->total_relative_error > 0.5)
        identify_diagnose(r, "poor_reconstruction", -1,
                          "the modes leave %.0f %% of the signals unexplained: noise, a forced "
                          "response, or too low a rank",
                          100 * r->total_relative_error);
    for (int c = 0;
         c < r->channel_count && said < IDENTIFY_TOLD && r->total_relative_error <= 0.5; c++)
        if (r->relative_error[c] > POOR && r->relative_error[c] > 3 * r->total_relative_error) {
            identify_diagnose(r, "dominated_signal", r->channel[c],
                              "channel %d is rebuilt to %.0f %% only while all together are to "
                              "%.2g %%: others dominate it; raise the rank, or identify it alone",
                              r->channel[c], 100 * r->relative_error[c],
                              100 * r->total_relative_error);
            said++;
        }
}

static void about_rounding(struct identify_result *r, const struct diagnose_facts *f)
{
    int said = 0;

    for (int c = 0; c < r->channel_count && f->below != NULL && said < IDENTIFY_TOLD; c++)
        if (f->below[c]) {
            identify_diagnose(
                r, "below_rounding", r->channel[c],
                "channel %d is smaller than %g of the largest and is no free response: rounding "
                "errors of the others, left out; if its unit makes it so small, "
                "give it in another, or identify it alone by `signals`",
                r->channel[c], ROUNDING_RATIO);
            said++;
        }
}

static void about_colour(struct identify_result *r, const struct diagnose_facts *f)
{
    if (f->doubt.colour > 1)
        identify_diagnose(
            r, "coloured_residual", -1,
            "what the modes leave is not white noise: %s%.2g%s; the model may be missing something "
            "slow, driven or nonlinear",
            f->converged && !r->driven && !f->rejected ? "standard errors were widened by up to "
                                                       : "errors would be up to ",
            f->doubt.colour, f->converged && !r->driven && !f->rejected ? "" : " times as wide");
    if (f->told > 0)
        identify_diagnose(
            r, "coloured_residual", -1,
            "the noise is not white within a period: neighbouring samples tell %.2g of its "
            "variance, which was taken out; multipliers and standard errors are of what is left",
            f->told);
}

/* Poles that noise contradicts in less than one record of 10^6 (parts.c). */
static void about_parts(struct identify_result *r, const struct diagnose_facts *f)
{
    if (f->rejected && f->doubt.contradiction > 1)
        identify_diagnose(r, "parts_disagree", -1,
                          "halves of the record have other exponents than the whole (%.2g times "
                          "what noise explains): the model does not hold throughout, and whether "
                          "the modes decay is open; there are no standard errors and no verdict; "
                          "give response=ambient where it is excited all the time, or `window` a "
                          "part that is free",
                          f->doubt.contradiction);
    else if (f->doubt.contradiction > 1)
        identify_diagnose(r, "parts_disagree", -1,
                          "halves of the record have other exponents than the whole (%.2g times "
                          "what noise explains): the model does not hold throughout%s",
                          f->doubt.contradiction,
                          f->converged && !r->driven ? "; standard errors were widened to the "
                                                       "differences" : "");
}

void diagnose_still_channels(struct identify_result *r)
{
    for (int c = 0, said = 0; c < r->channel_count && said < IDENTIFY_TOLD; c++)
        if (isnan(r->relative_error[c])) {
            identify_diagnose(r, "zero_channel", r->channel[c], "channel %d is constant throughout "
                              "what is identified: not connected, or not moved; it says nothing "
                              "and is left out", r->channel[c]);
            said++;
        }
}

void diagnose(struct identify_result *r, const struct diagnose_facts *f)
{
    if (r->mode_count == 0)
        identify_diagnose(r, "no_modes", -1,
                          "no mode stands above the noise: the signals may hold no free response");
    if (r->mode_count == 0 && f->rows < PAIR_ROWS)
        identify_diagnose(
            r, "too_many_unknowns", -1,
            "%d equations a phase and signal: a pair of modes of a periodic system needs %d to be "
            "told from none; record more periods, or give period=0 for constant coefficients",
            f->rows, PAIR_ROWS);
    about_rank(r, f);
    if (f->dropped > 0)
        identify_diagnose(
            r, "fast_decay", -1,
            "%d multiplier%s zero to rounding: faster than the sampling, no exponent can be given",
            f->dropped, f->dropped > 1 ? "s are" : " is");
    if (r->offset != NULL)
        identify_diagnose(r, "offset", -1,
                          "a constant part was found and is reported as offset, not as a mode");
    if (f->orbit)
        identify_diagnose(r, "periodic_orbit", -1,
                          "a multiplier of 1 varies over the period: the periodic solution itself "
                          "was not removed and may hide weaker modes; use difference=true");
    for (int i = 0; i < r->mode_count; i++)
        about_mode(r, f, i);
    about_length(r, f);
    for (int i = 0; i < r->cluster_count; i++)
        if (r->clusters[i].near_defective)
            identify_diagnose(
                r, "near_defective", -1,
                "%d multiplier%s within %.2g of %.6g%+.6gi nearly coalesce: only their mean is "
                "well determined, and growth like a polynomial in time is possible",
                r->clusters[i].member_count,
                r->clusters[i].member_count > 1 ? "s" : " and its conjugate", r->clusters[i].radius,
                creal(r->clusters[i].centroid), cimag(r->clusters[i].centroid));
    about_colour(r, f);
    about_parts(r, f);
    about_rounding(r, f);
    about_zeros(r, f);
    about_channels(r);
}
