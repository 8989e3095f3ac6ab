/* identify_slip.c - whether a periodic record keeps the period that it was given, and what follows
 *
 * A system whose turns are not those of the period shows a crowd of multipliers where it has one,
 * one for each of its lines or for each bend of them, in white noise; of the crowd some may grow.
 * Where turns of its own (prepare/slip.h) make the same record one of fewer multipliers, those are
 * the answer.  Two pairs fewer, where the period is another by a turn of the record and more: some
 * period brings lines of any two modes together that decay alike, and of a constant system any
 * period is as good.
 */
#include "modal/identify/ask/diagnose.h"
#include "modal/identify/identify_state.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include "modal/identify/prepare/turns.h"

enum {
    FEWER = 2,                   /* real numbers: a pair */
    FEWER_FAR = 4,               /* two pairs: of a period that is another by a turn or more */
    ORDER_LEAST = 4              /* that a pair and what remains are */
};
static const double
    GAIN = 0.75,                 /* 1.5 deviations of noise (slip.c, (3)): a second identification
                                  * decides */
    LINE = 0.1;                  /* of the strongest: of 60 lines noise at 10 dB makes one of half
                                  * as much */

enum modal_status work_even_out(struct work *w, struct modal_error *err)
{
    double *turn = malloc(sizeof *turn * (size_t)w->rec.Y.m);
    enum modal_status rc;

    if (turn == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d angles", w->rec.Y.m);
    slip_turns(w->slip, w->rec.period / w->rec.step, w->rec.Y.m, turn);
    rc = turns_even_out(&w->rec, turn, err);
    free(turn);
    return rc;
}

/* Is the record one whose turns can be asked for, and its answer one of so many multipliers that
 * fewer may do? Before wild samples and steps are looked for: what a slip leaves looks like them,
 * and by its own turns the record is asked for them again. */
static bool may_slip(const struct work *w)
{
    return w->rec.period > 0 && !w->rec.wide && w->blocks == NULL && w->refine
        && w->opt.known == NULL && w->rec.shift_rad_s == 0 && w->opt.method == IDENTIFY_AUTO
        && w->opt.rank.rule == RANK_AUTO && w->choice.chosen >= 0 && w->wild.count == 0
        && w->rec.stuck.count == 0 && w->steps.count == 0 && w->grown == 0
        && w->choice.candidates[w->choice.chosen].fit.order >= ORDER_LEAST;
}

enum modal_status work_find_slip(const struct work *w, struct slip *slip, struct modal_error *err)
{
    double *noise;
    struct slip_record r = { &w->rec.Y, w->rec.period / w->rec.step, NULL, 0 };
    enum modal_status rc;

    *slip = (struct slip) { 0 };
    if (!may_slip(w))
        return MODAL_OK;
    noise = malloc(sizeof *noise * (size_t)w->rec.channels);
    if (noise == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d channels",
                          w->rec.channels);
    r.noise = noise, r.order = w->choice.candidates[w->choice.chosen].fit.order;
    rc = work_channel_noise(w, noise, err);
    if (rc == MODAL_OK)
        rc = slip_find(&r, slip, err);
    if (slip->gain < GAIN)
        *slip = (struct slip) { 0 };
    free(noise);
    return rc;
}

/* Real numbers of the motion: two a pair of multipliers, one where it is real. */
static int order_of(const struct identify_result *r)
{
    int order = 0;

    for (int i = 0; i < r->mode_count; i++)
        order += cimag(r->modes[i].multiplier) != 0 ? 2 : 1;
    return order;
}

/* Has some multiplier of R two lines, which alone tell of a period?  Where all have one, turns that
 * slip are frequencies that change. */
static bool has_lines(const struct identify_result *r)
{
    bool has = false;

    for (int i = 0; i < r->mode_count; i++)          /* a real one's line is its own mirror */
        has |= cimag(r->modes[i].multiplier) != 0 && r->modes[i].runner_up > LINE;
    return has;
}

/* Does SECOND, of fewer real numbers, leave no more than BIC lets these be worth?  Each sample has
 * the logarithm of what is left of it; each number its exponent and, at every phase of every
 * channel, an amplitude.  What FIRST explains to rounding slips nowhere. */
static bool is_likelier(const struct identify_result *first, const struct identify_result *second)
{
    double rows = first->samples, phases = first->period / first->dt, left = 0;
    double numbers = (order_of(first) - order_of(second)) * (1 + phases * first->channel_count);

    for (int c = 0; c < first->channel_count; c++)
        if (isfinite(first->relative_error[c]) && isfinite(second->relative_error[c]))
            left += 2 * rows * log(fmax(second->relative_error[c], DBL_EPSILON)
                                   / fmax(first->relative_error[c], DBL_EPSILON));
    return left <= numbers * log(rows * first->channel_count);
}

bool work_slips(const struct slip *slip, const struct identify_result *first,
                struct identify_result *second)
{
    int many = first->mode_count, few = second->mode_count;
    int fewer = fabs(slip->ends) < 1 ? FEWER : FEWER_FAR;
    double given = first->period, std = given * slip->std_ends / slip->turns;

    if (!has_lines(second) || order_of(second) > order_of(first) - fewer
        || !is_likelier(first, second))
        return false;
    if (slip->bow == 0)
        identify_diagnose(second, "wrong_period", -1, "the period of the record is %.9g s, give or "
                          "take %.2g, where %.9g s was given: by that it shows %d multipliers, "
                          "which drift against each other, by its own %d, which are told here",
                          second->period, std, given, many, few);
    else
        identify_diagnose(second, "period_drifts", -1, "the period given, %.9g s, does not hold: "
                          "halfway through the record its turns are %.3g of a turn off even ones "
                          "(give or take %.2g), as where the speed changes by %.2g %% from its "
                          "first turn to its last; %d multipliers, some of which may grow, made "
                          "up for that where %d of even turns do, which are told here, over the "
                          "mean period; resample the signals at even angles of the azimuth, or "
                          "give a shorter `window`", given, slip->bow, slip->std_bow,
                          fabs(800 * slip->bow / slip->turns), many, few);
    return true;
}
