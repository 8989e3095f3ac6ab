/*
 * identify.c - the way from a batch to modes; see identify.h for the stations
 *
 * Two decompositions lead to the poles of every order:
 *
 *   pencil.c       H by FFT products, one-sample shift: the default for systems without a period
 *   projection.c   the pair (14) with any shift, its own error bars: periodic systems, a named
 *                  method, a rank by singular values
 *
 * and order.c climbs either, refining by variable projection.  Very long records are decomposed by
 * their head only, and a fit to all rows begins there.  A named `method` is the paper's procedure:
 * no refinement unless asked for. Periodic systems shift by one period where that is a whole number
 * of samples; where not, all lines of a multiplier are fitted with one exponent
 * (identify_families.c), or by a shift of one sample each with its own, and modes.c folds the
 * exponents modulo i Omega.
 */
#include "modal/identify/identify.h"
#include "modal/identify/ask/diagnose.h"
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ambient/ambient.h"
#include "modal/identify/fit/criterion.h"
#include "modal/identify/forced/forced.h"
#include "modal/identify/identify_state.h"
#include "modal/identify/identify_stop.h"

const char *const identify_method_names[IDENTIFY_METHOD_COUNT + 1] = {
    "auto",           "partial-floquet",     "partial-floquet-full",
    "autoregressive", "autoregressive-full", NULL,
};

enum {
    ROUNDS_MOST = 5,                /* each tells the channels' noise anew, or sees smaller
                                     * spikes than the one before */
    WILD_LEAST = 2,                 /* the first poles are bent by what they had to rebuild */
    GROWTH_MOST = 4,                /* rounds: each may show more of what is left to be modes */
    STEPS_MOST = 4                  /* rounds: poles and steps are told by different rows */
};

static void work_done(struct work *w)
{
    record_done(&w->rec);
    pod_done(&w->pod);
    free(w->whole.x), free(w->whole_scale);
    free(w->weighted.x), free(w->noise), free(w->weight), free(w->grid), free(w->least);
    free(w->folded.x);
    compressed_free(w->blocks);
    pencil_done(&w->pencil), pencil_done(&w->full);
    projection_done(&w->projection);
    order_done(&w->choice);
    free(w->seen.lambda);
    wild_done(&w->wild);
    steps_done(&w->steps), steps_done(&w->spikes);
    workspace_free(&w->poles.space);
    synthesis_done(&w->all);
}

void identify_result_done(struct identify_result *r)
{
    for (int i = 0; i < r->mode_count; i++) {
        free(r->modes[i].harmonics);
        free(r->modes[i].shape), free(r->modes[i].participation);
    }
    for (int i = 0; i < r->cluster_count; i++)
        free(r->clusters[i].members);
    free(r->modes), free(r->offset), free(r->singular), free(r->channel), free(r->rms_error),
        free(r->relative_error);
    free(r->candidates), free(r->poles), free(r->clusters), free(r->trend);
    free(r->chosen.lambda), free(r->unweighed.lambda);
    free(r->frf.input), free(r->frf.hertz), free(r->frf.value), free(r->frf.std);
    memset(r, 0, sizeof *r);
}

/* A stage's seconds; a second time over they are added. */
static void note_stage(struct identify_result *out, const char *name, double seconds)
{
    int i = 0;

    while (i < out->stage_count && strcmp(out->stages[i].name, name) != 0)
        i++;
    if (i == IDENTIFY_STAGES)
        return;
    out->stages[i].name = name;
    out->stages[i].seconds += seconds;
    out->stage_count = i < out->stage_count ? out->stage_count : i + 1;
}

/* A stage ends: its seconds are noted, and a cancelled job stops. */
static enum modal_status stage(struct work *w, const char *name, struct identify_result *out,
                               struct modal_error *err)
{
    double now = work_clock(w);

    note_stage(out, name, now - w->clock);
    w->clock = now;
    if (w->opt.cancelled != NULL && w->opt.cancelled(w->opt.context))
        return modal_fail(err, MODAL_CANCELLED, "cancelled after the stage %s", name);
    return MODAL_OK;
}

/* ---- options ---- */

static enum modal_status check_range(const char *field, double value, double low, double high,
                                     struct modal_error *err)
{
    if (!(value >= low && value <= high))
        return modal_fail_field(err, MODAL_BAD_INPUT, field, "%s is %g; accepted: %g to %g", field,
                                value, low, high);
    return MODAL_OK;
}

static enum modal_status check_options(const struct identify_options *o, struct modal_error *err)
{
    const struct { const char *field; double value, low, high; } limits[] = {
        { "method", o->method, 0, IDENTIFY_METHOD_COUNT - 1 },
        { "detrend", o->detrend, 0, DETREND_COUNT - 1 },
        { "scale", o->scale, 0, SCALE_COUNT - 1 },
        { "rank.rule", o->rank.rule, 0, RANK_RULE_COUNT - 1 },
        { "pod.energy", o->pod_energy, 0, 1 },
        { "pod.rank", o->pod_rank, 0, IDENTIFY_ORDER_MOST },
        { "rank.energy", o->rank.energy, 0, 1 },
        { "rank.threshold", o->rank.threshold, 0, 1 },
        { "rank.fixed", o->rank.fixed, o->rank.rule == RANK_FIXED, IDENTIFY_ORDER_MOST },
        { "rank.most", o->rank.most, 0, IDENTIFY_ORDER_MOST },
        { "rows", o->rows, 0, INT32_MAX },
        { "columns", o->columns, 0, INT32_MAX },
        { "stride", o->stride, 0, INT32_MAX },
        { "target.error", o->target_error, 0, HUGE_VAL },
        { "target.seconds", o->target_seconds, 0, HUGE_VAL },
    };
    enum modal_status rc = MODAL_OK;

    for (size_t i = 0; i < sizeof limits / sizeof *limits && rc == MODAL_OK; i++)
        rc = check_range(limits[i].field, limits[i].value, limits[i].low, limits[i].high, err);
    return rc;
}

/* The shift, and whether it suits the period. */
static enum modal_status choose_shift(struct work *w, struct modal_error *err)
{
    const struct record *r = &w->rec;
    int stride = w->opt.stride;

    w->shift = r->per_period > 0 ? r->per_period : 1;
    if (stride > 0 && r->per_period > 0 && stride != r->per_period)
        return modal_fail_field(err, MODAL_BAD_INPUT, "stride",
                                "a stride of %d samples for a period of %d; accepted: %d, or "
                                "`period` 0 for constant coefficients",
                                stride, r->per_period, r->per_period);
    if (stride > 1 && r->period > 0 && r->per_period == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "stride",
                                "a stride of %d samples, and a period of %.9g samples; accepted: 1",
                                stride, r->period / r->step);
    if (stride > 0)
        w->shift = stride;
    if (w->shift > r->Y.m / 2)
        return modal_fail_field(err, MODAL_BAD_INPUT, "stride",
                                "a stride of %d in %d samples; accepted: 1 to %d", w->shift, r->Y.m,
                                r->Y.m / 2);
    w->tau = w->shift * r->step;  /* of one shift of the Hankel pair: exponents are ln rho / tau */
    w->opt.stride = w->shift;
    return MODAL_OK;
}

/* More proper orthogonal signals than channels, or than rows, there are none of. */
static enum modal_status check_pod_rank(const struct work *w, struct modal_error *err)
{
    int channels = w->rec.channels, rows = w->rec.Y.m, most = channels < rows ? channels : rows;

    if (w->opt.pod_rank <= most)
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, "pod.rank", "pod.rank is %d of %d channel%s and "
                            "%d samples; accepted: 1 to %d", w->opt.pod_rank, channels,
                            channels > 1 ? "s" : "", rows, most);
}

/* ---- from signals to the chosen order, once and again ---- */

/* What the search for the order spent: on eigenvalues, and on the rest of it. */
static enum modal_status stage_order(struct work *w, struct identify_result *out,
                                     struct modal_error *err)
{
    note_stage(out, "eig", w->eigenvalues);  /* timed within the search, told apart from it */
    w->clock += w->eigenvalues;     /* taken off the search, which goes on being timed */
    w->eigenvalues = 0;
    return stage(w, w->refine ? "refine" : "eig", out, err);
}

/* From signals to the chosen order. */
static enum modal_status analyse(struct work *w, struct identify_result *out,
                                 struct modal_error *err)
{
    bool found = false;
    enum modal_status rc;

    w->triplets = TRIPLETS_FIRST, out->begun = false;
    if ((rc = work_reduce(w, out, err)) != MODAL_OK
        || (rc = stage(w, "pod", out, err)) != MODAL_OK
        || (w->opt.known != NULL && (rc = work_begin_at_known(w, out, &found, err)) != MODAL_OK)
        || (work_begins_at_head(w) && (rc = work_grow_from_head(w, out, &found, err)) != MODAL_OK)
        || (!found && (rc = work_decompose(w, out, err)) != MODAL_OK)
        || (!found && (rc = stage(w, "svd", out, err)) != MODAL_OK)
        || (!found && (rc = work_choose_order(w, out, err)) != MODAL_OK)
        || (w->choice.chosen >= 0 && (rc = work_look_above(w, err)) != MODAL_OK)
        || (rc = stage_order(w, out, err)) != MODAL_OK)
        return rc;
    return MODAL_OK;
}

/* All but the signals of a wide batch, which cost passes over it and stay the same. */
static void forget_analysis(struct work *w, struct identify_result *out)
{
    if (!w->rec.wide)
        pod_done(&w->pod);
    pencil_done(&w->pencil), pencil_done(&w->full);
    projection_done(&w->projection);
    order_done(&w->choice);
    free(w->folded.x), w->folded.x = NULL;
    free(out->singular), out->singular = NULL;
    w->projected = w->counted = false;
    w->facts = (struct diagnose_facts) { .converged = true };
}

/* Of a record with a period of a whole number of samples, what its fold showed. */
struct by_fold { int phases; double bic, numbers; bool whitened; };

/* By lines, w->choice: one set of multipliers in white noise?  And is it worth more than what the
 * fold showed, or did that take lines for the colour of noise, of which there is none? */
static bool lines_are_better(const struct work *w, const struct by_fold *fold)
{
    double numbers = (double)w->data.Y->m * w->data.Y->n;

    if (w->choice.chosen < 0 || !w->facts.converged)
        return false;
    if (fold->bic == HUGE_VAL)
        return true;
    return work_is_clean(w)
        && (fold->whitened
            || work_bic_chosen(&w->choice) * fold->numbers / numbers < fold->bic);
}

/* Are periods as many as would show another pair (criterion.h), or, where noise was found to be
 * coloured, two: what is not seen may be what coloured it? */
static bool fold_tells(const struct work *w)
{
    double S = w->data.Y->n;
    int more = w->facts.told > 0 ? 4 : 2;

    return w->rec.wide
        || w->facts.order + more <= criterion_order_told(S, S * w->data.Y->m);
}

static void set_fold(struct work *w, int phases, struct identify_result *out)
{
    w->rec.per_period = phases;
    w->shift = w->opt.stride = phases > 0 ? phases : 1, w->tau = w->shift * w->rec.step;
    w->spent = 0;                       /* the fold answers as it did */
    forget_analysis(w, out);
}

/* Where periods are too few for all samples of one to have amplitudes of their own, and their fold
 * shows little: by lines, of which a motion has few. */
static enum modal_status analyse_by_lines(struct work *w, struct identify_result *out,
                                          struct modal_error *err)
{
    struct by_fold fold = { w->rec.per_period, work_bic_chosen(&w->choice),
                            (double)w->data.Y->m * w->data.Y->n, w->facts.told > 0 };
    enum modal_status rc;

    if (fold.phases == 0 || !w->refine || w->opt.method != IDENTIFY_AUTO
        || w->opt.rank.rule != RANK_AUTO || (w->choice.chosen >= 0 && fold_tells(w))
        || (w->choice.chosen < 0 && out->begun))   /* lines had none in what was known */
        return MODAL_OK;
    set_fold(w, 0, out);
    rc = analyse(w, out, err);
    if (rc != MODAL_OK || lines_are_better(w, &fold))
        return rc;
    set_fold(w, fold.phases, out);
    return analyse(w, out, err);
}

/* Once more, with a floor, where a fit without one came down to the grid: rounding is no white
 * noise, and more poles follow it. */
static enum modal_status analyse_above_grid(struct work *w, const struct batch *b,
                                            struct identify_result *out, struct modal_error *err)
{
    bool any = false;
    enum modal_status rc;

    if (!w->refine || w->choice.chosen < 0)
        return MODAL_OK;
    rc = work_find_grids(w, b, &any, err);
    if (rc != MODAL_OK || !any)
        return rc;
    rc = work_grid_noise(w, err);
    out->at_grid = rc == MODAL_OK && work_grid_matters(w);
    if (!out->at_grid) {
        free(w->least), w->least = NULL;
        return rc;
    }
    forget_analysis(w, out);
    w->spent = 0;                      /* what the first one spent was spent on rounding */
    rc = work_cut_below_grid(w, err);
    return rc == MODAL_OK ? analyse(w, out, err) : rc;
}

/* Did every direction that was told stand out of the noise?  Weights change that alone, and poles
 * that were refined are a start as good as any. */
static bool told_all(const struct work *w)
{
    return w->opt.rank.rule == RANK_FIXED && !w->projected && w->shift == 1 && w->facts.converged
        && w->facts.order == w->opt.rank.fixed;
}

/* Once more, on channels weighed by the noise that the answer before left, until that settles. */
static enum modal_status analyse_weighed(struct work *w, struct identify_result *out,
                                         struct modal_error *err)
{
    for (int round = 0; round < ROUNDS_MOST && work_worth_weighing(w); round++) {
        bool again, told = round == 0 && told_all(w);
        struct pencil kept = { 0 };
        enum modal_status rc = work_weigh_channels(w, &again, err);
        if (rc != MODAL_OK || !again)
            return rc;
        w->spent = round == 0 ? 0 : w->spent;      /* what was spent on signals that noise hid */
        w->trial = false;
        if (round == 0)
            rc = work_keep_chosen(w, &out->unweighed, err);
        /* poles to begin with: other weights move them by little */
        w->known = round == 0 && (w->many || told || (w->choice.clean && !w->choice.crowded));
        if (rc != MODAL_OK)
            return rc;
        if (told)
            kept = w->pencil, w->pencil = (struct pencil) { 0 };
        forget_analysis(w, out);
        w->pencil = kept;
        rc = analyse(w, out, err);
        if (rc != MODAL_OK)
            return rc;
    }
    return MODAL_OK;
}

/* The same signals, with what was made of them, searched for as long as any. */
static enum modal_status search_longer(struct work *w, struct identify_result *out,
                                       struct modal_error *err)
{
    enum modal_status rc;

    w->trial = false, w->spent = 0;
    w->facts = (struct diagnose_facts) { .converged = true, .full_rank = w->facts.full_rank };
    if ((rc = work_choose_order(w, out, err)) != MODAL_OK
        || (w->choice.chosen >= 0 && (rc = work_look_above(w, err)) != MODAL_OK))
        return rc;
    return stage_order(w, out, err);
}

/* The same, and what a trial did not end. */
static enum modal_status analyse_again(struct work *w, struct identify_result *out,
                                       struct modal_error *err)
{
    enum modal_status rc = analyse_weighed(w, out, err);

    if (rc != MODAL_OK || !w->trial || !w->facts.work_limit || w->ragged > 0)
        return rc;
    rc = search_longer(w, out, err);
    return rc == MODAL_OK ? analyse_weighed(w, out, err) : rc;
}

/* Everything from signals as they are on, in one setting of the search. */
static enum modal_status analyse_anew(struct work *w, struct identify_result *out,
                                      struct modal_error *err)
{
    enum modal_status rc;

    free(w->noise), free(w->weight), free(w->weighted.x), free(out->unweighed.lambda);
    w->noise = w->weight = NULL, w->weighted = (struct matrix) { 0 };
    out->unweighed = (struct identify_chosen) { 0 };
    w->known = false, w->spent = 0;
    /* what the samples before these were said of is not said of these */
    w->ragged = 0, w->many = w->endless = false;
    w->trial = work_may_weigh(w) && w->rec.channels <= POD_CHANNELS_FEW;
    forget_analysis(w, out);
    if ((rc = record_cut(&w->rec, w->rec.Y.m, w->opt.scale, err)) != MODAL_OK
        || (rc = analyse(w, out, err)) != MODAL_OK)
        return rc;
    return analyse_again(w, out, err);
}

/* Without the later part of what grows until its rounding hides the rest, where the earlier one is
 * one set of modes in noise. */
static enum modal_status analyse_before_growth(struct work *w, struct identify_result *out,
                                               struct modal_error *err)
{
    bool cut = true;
    enum modal_status rc = MODAL_OK;

    for (int round = 0; round < GROWTH_MOST && rc == MODAL_OK && cut; round++) {
        rc = work_cut_growth(w, &cut, err);
        if (rc == MODAL_OK && cut)
            rc = analyse_anew(w, out, err);
    }
    if (rc != MODAL_OK || w->grown == 0 || work_is_clean(w))
        return rc;
    work_put_growth_back(w);
    return analyse_anew(w, out, err);
}

/* With steps, as long as they and the poles move each other; without where they are none. */
static enum modal_status analyse_with_steps(struct work *w, struct identify_result *out,
                                            struct modal_error *err)
{
    bool settled = false;
    enum modal_status rc = MODAL_OK;

    if (w->steps.count == 0)
        return MODAL_OK;
    for (int round = 0; round < STEPS_MOST && rc == MODAL_OK && !settled; round++) {
        rc = work_fit_steps(w, &settled, err);
        if (rc == MODAL_OK && !settled)
            rc = analyse_anew(w, out, err);
    }
    if (rc != MODAL_OK || work_are_steps(w))
        return rc;
    work_put_steps_back(w);
    return analyse_anew(w, out, err);
}

static int chosen_poles(const struct work *w)
{
    return w->choice.chosen >= 0 ? w->choice.candidates[w->choice.chosen].fit.poles : 0;
}

/* Without the samples that are neither motion nor noise, as long as others stand out of what the
 * next poles leave; with them all the same where that leads to no one set of modes in noise, but
 * for those that are stuck. */
static enum modal_status analyse_without_wild(struct work *w, struct identify_result *out,
                                              struct modal_error *err)
{
    int before = 0, poles;
    enum modal_status rc = work_begin_wild(w, err);

    if (rc != MODAL_OK || !work_may_take_wild(w))
        return rc;
    rc = work_take_wild(w, err);
    for (int round = 1; rc == MODAL_OK && w->wild.count > 0; round++) {
        before = w->wild.count, poles = chosen_poles(w);
        rc = analyse_anew(w, out, err);
        if (rc == MODAL_OK && round < ROUNDS_MOST)
            rc = work_take_wild(w, err);
        if (round == ROUNDS_MOST || (work_is_clean(w) || w->wild.known_count == 0
                                   ? round >= WILD_LEAST && w->wild.count == before
                                   : chosen_poles(w) >= poles))
            break;
    }
    if (rc != MODAL_OK || before == 0 || (w->wild.count > 0 && work_is_clean(w))
        || (w->wild.known_count > 0 && w->wild.count == w->wild.known_count))
        return rc;
    work_put_wild_back(w);
    return analyse_anew(w, out, err);
}

/* ---- the answer ---- */

/* What is proposed, and whether it was used. */
static void report_window(struct work *w, struct identify_result *out)
{
    const double *t = w->rec.proposed;
    bool asked = w->opt.window[0] == WINDOW_AUTO;

    if (!w->rec.parted
        && (work_is_explained(w, out) || w->wild.count > 0 || w->steps.count > 0))
        return;
    memcpy(out->proposed, t, sizeof out->proposed);
    if (asked || w->rec.parted)
        memcpy(w->opt.window, t, sizeof w->opt.window);
    if (!asked && t[1] > 0)
        identify_diagnose(out, "not_free_throughout", -1, "only %.6g to %.6g s of the record are "
                          "one free response: what comes before is quiet, or driven; %s", t[0],
                          t[1], w->rec.parted ? "of so many samples that part alone was "
                          "identified: name `window` for another"
                          : "`-o window=auto` identifies that part alone");
}

static void report_settings(struct work *w, struct identify_result *out)
{
    report_window(w, out);
    out->period = w->rec.period;
    out->dt = w->rec.step;
    out->decimation = w->rec.decimation;
    out->shift = w->shift;
    out->samples = w->shift > 1 ? w->data.Y->m * w->shift : w->rec.Y.m;
    out->freedom = w->data.Y->m - w->facts.order;  /* of each signal: rows less its amplitudes */
    out->rule = w->opt.rank.rule;
    w->opt.rows = out->rows, w->opt.columns = out->columns;
    w->opt.refine = w->refine ? CHOICE_YES : CHOICE_NO;
    w->opt.period = w->rec.period;
    out->used = w->opt;
    out->used.channels = NULL, out->used.clock = NULL, out->used.cancelled = NULL,
    out->used.context = NULL;
}

/* What modes_report would read all rows of a very long record for. */
static enum modal_status fit_long(struct work *w, struct modal_error *err)
{
    struct poles *p = &w->poles;
    enum modal_status rc;

    if (w->data.blocks == NULL || w->data.blocks->Y.x != w->rec.Y.x || p->fit != NULL)
        return MODAL_OK;
    rc = work_fit_signals(w, p->lambda, p->count, &w->rec.Y, &w->all, err);
    p->fit = rc == MODAL_OK ? &w->all : NULL;
    return rc;
}

/* A free response, its turns evened out by SLIP (NULL: they are the period's); *found, where that
 * is asked for: how they slip. */
static enum modal_status identify_free(const struct batch *batch,
                                       const struct identify_options *options,
                                       const struct slip *slip, struct slip *found,
                                       struct identify_result *out, struct modal_error *err)
{
    struct work w = { .opt = *options, .facts = { .converged = true }, .slip = slip };
    enum modal_status rc;

    memset(out, 0, sizeof *out);
    w.refine = w.opt.refine == CHOICE_YES
        || (w.opt.refine == CHOICE_DEFAULT && w.opt.method == IDENTIFY_AUTO);
    w.clock = w.opt.clock != NULL ? w.opt.clock(w.opt.context) : 0;
    if ((rc = check_options(&w.opt, err)) != MODAL_OK
        || (rc = record_make(batch, &w.opt, &w.rec, err)) != MODAL_OK
        || (slip != NULL && (rc = work_even_out(&w, err)) != MODAL_OK)
        || (rc = check_pod_rank(&w, err)) != MODAL_OK
        || (rc = choose_shift(&w, err)) != MODAL_OK
        || (rc = work_begin_steps(&w, err)) != MODAL_OK
        || (rc = stage(&w, "read", out, err)) != MODAL_OK)
        goto out;
    w.trial = work_may_weigh(&w) && w.rec.channels <= POD_CHANNELS_FEW;
    if ((rc = analyse(&w, out, err)) != MODAL_OK
        || (rc = analyse_by_lines(&w, out, err)) != MODAL_OK
        || (rc = analyse_above_grid(&w, batch, out, err)) != MODAL_OK
        || (rc = analyse_again(&w, out, err)) != MODAL_OK
        || (rc = analyse_before_growth(&w, out, err)) != MODAL_OK
        || (found != NULL && (rc = work_find_slip(&w, found, err)) != MODAL_OK)
        || (rc = analyse_with_steps(&w, out, err)) != MODAL_OK
        || (rc = analyse_without_wild(&w, out, err)) != MODAL_OK
        || (rc = work_keep_chosen(&w, &out->chosen, err)) != MODAL_OK
        || (rc = work_take_poles(&w, err)) != MODAL_OK
        || (rc = work_widen(&w, batch, out, err)) != MODAL_OK)
        goto out;
    report_settings(&w, out);
    if ((rc = work_doubt(&w, out, err)) != MODAL_OK
        || (rc = fit_long(&w, err)) != MODAL_OK
        || (rc = modes_report(&w.rec, &w.poles, &w.opt, out, err)) != MODAL_OK
        || (rc = stage(&w, "synthesis", out, err)) != MODAL_OK
        || (rc = work_report_ladder(&w, out, err)) != MODAL_OK)
        goto out;
    w.facts.rejected = slip != NULL && !work_is_clean(&w);      /* nor do even turns explain it */
    if ((rc = work_conclude(&w, batch, out, err)) != MODAL_OK
        || (rc = stage(&w, "verdict", out, err)) != MODAL_OK)
        goto out;
out:
    work_done(&w);
    if (rc != MODAL_OK)
        identify_result_done(out);
    return rc;
}

/* *before, found by OWN options, with the rows and columns that OPTIONS ask for; what does not fit
 * the part that is the answer is refused by name. */
static enum modal_status identify_as_asked(const struct batch *batch,
                                           const struct identify_options *options,
                                           struct identify_options *own,
                                           struct identify_result *before,
                                           struct modal_error *err)
{
    enum modal_status rc;

    if (options->rows == 0 && options->columns == 0)
        return MODAL_OK;
    own->rows = options->rows, own->columns = options->columns;
    identify_result_done(before);
    rc = identify_free(batch, own, NULL, NULL, before, err);
    memcpy(before->proposed, before->used.window, sizeof before->proposed);
    return rc;
}

/* Of a response that stops in the record, *out is what comes before, where window=auto asks for it,
 * and else says so. */
static enum modal_status look_for_stop(const struct batch *batch,
                                       const struct identify_options *options,
                                       struct identify_result *out, struct modal_error *err)
{
    struct identify_result before = { 0 }, all = *out;
    struct identify_options own = *options;
    struct stop stop;
    enum modal_status rc = stop_begin(&stop, batch, out, err);

    own.rows = own.columns = 0;         /* asked of all samples: what comes before may be fewer */
    while (rc == MODAL_OK && stop_asks(&stop, own.window)) {
        identify_result_done(&before);
        rc = identify_free(batch, &own, NULL, NULL, &before, err);
        if (rc == MODAL_OK)
            rc = stop_tell(&stop, &before, err);
    }
    if (rc == MODAL_OK && stop.is && options->window[0] == WINDOW_AUTO)
        rc = identify_as_asked(batch, options, &own, &before, err);
    if (rc == MODAL_OK && stop.is && options->window[0] == WINDOW_AUTO)
        *out = before, before = all;
    else if (rc == MODAL_OK && stop.is)
        stop_report(out, &before);
    identify_result_done(&before);
    stop_done(&stop);
    return rc;
}

enum modal_status modal_identify(const struct batch *batch, const struct identify_options *options,
                                 struct identify_result *out, struct modal_error *err)
{
    static const struct identify_options defaults = { 0 };
    const struct identify_options *o = options != NULL ? options : &defaults;
    struct identify_result by_own = { 0 }, other;
    struct identify_options own = *o;
    struct slip slip = { 0 };
    enum modal_status rc;

    if (o->response != RESPONSE_FREE)
        memset(out, 0, sizeof *out);
    if (o->response == RESPONSE_FORCED)
        rc = forced_identify(batch, o, out, err);
    else if (o->response == RESPONSE_AMBIENT)
        rc = ambient_identify(batch, o, out, err);
    else
        rc = identify_free(batch, o, NULL, &slip, out, err);
    if (rc == MODAL_OK && slip.gain > 0) {
        if (slip.bow == 0)
            own.period = out->period / (1 + slip.ends / slip.turns);
        rc = identify_free(batch, &own, slip.bow != 0 ? &slip : NULL, NULL, &by_own, err);
        if (rc == MODAL_OK && work_slips(&slip, out, &by_own))
            other = *out, *out = by_own, by_own = other;
    }
    identify_result_done(&by_own);
    if (rc == MODAL_OK && o->response == RESPONSE_FREE)
        rc = look_for_stop(batch, o, out, err);
    if (rc != MODAL_OK)
        identify_result_done(out);
    return rc;
}
