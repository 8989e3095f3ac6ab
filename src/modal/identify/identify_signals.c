/*
 * identify_signals.c - a record's channels as signals: reduced, weighed by their noise, and what a
 * grid of their numbers leaves of them
 */
#include "modal/identify/ask/diagnose.h"
#include "modal/identify/identify_state.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ask/screen.h"
#include "modal/identify/prepare/fold.h"
#include "modal/linalg/svd.h"

/* Records that end below the grid. */
static const double
    GRID_ABOVE = 1.9,                   /* steps from the end's value */
    GRID_WORTH = 0.9;                   /* of all: records of which more is above stay whole */

static const double
    NOISE_FEW = 10,                     /* channels that are not mixed are weighed from this ratio
                                         * on, or where the first answer is in doubt: their fits
                                         * weigh each by its own noise already */
    WEIGH_FALL = 10,                    /* of a channel's noise: once more */
    WEIGH_RANGE = 1e-6;                 /* of weights */

/* The variance of the grid in each signal: independent in each channel, and so weighed by squares.
 * A difference over a period has it twice, a filter its own gain of it. */
enum modal_status work_grid_noise(struct work *w, struct modal_error *err)
{
    int S = w->rec.channels;
    double *least = calloc((size_t)w->X->n + 1, sizeof *least), times = w->opt.difference ? 2 : 1;

    if (least == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for the noise of %d signals",
                          w->X->n);
    for (int i = 0; i < w->X->n; i++)
        for (int c = 0; c < S; c++) {
            double part =
                w->pod.count > 0 ? w->pod.modes.x[c + (size_t)i * (size_t)w->pod.modes.ld] : c == i;
            double q = w->rec.scale[c] > 0 ? part * w->grid[c].step / w->rec.scale[c]
                    * (w->weight != NULL && w->pod.count > 0 ? w->weight[c] : 1)
                                           : 0;
            least[i] += times * w->rec.gain * GRID_NOISE_MOST * q * q;
        }
    free(w->least);
    w->least = least;
    return MODAL_OK;
}

/* Orthogonal signals that are no larger than their grid makes them hold nothing else; they are the
 * weakest. */
static void drop_below_grid(struct work *w)
{
    int kept = w->pod.count;

    while (kept > 1 && w->pod.s[kept - 1] * w->pod.s[kept - 1] <= w->X->m * w->least[kept - 1])
        kept--;
    w->pod.count = w->pod.signals.n = w->pod.modes.n = kept;
}

enum modal_status work_reduce(struct work *w, struct identify_result *out,
                              struct modal_error *err)
{
    struct pod_options opt = { .energy = w->opt.pod_energy, .rank = w->opt.pod_rank,
                               .weight = w->weight };
    bool asked = opt.energy > 0 || opt.rank > 0;
    enum modal_status rc = MODAL_OK;

    w->X = &w->rec.Y;
    out->pod_rank = w->rec.channels;
    out->energy = 1;
    if (!w->opt.signals_all && (asked || w->rec.channels > POD_CHANNELS_FEW)) {
        /* refined on all channels afterwards */
        /* of s_1: a start for refining, or the answer itself */
        struct wide_options wide = { opt, w->refine ? 1e-4 : 1e-9 };
        if (w->pod.count == 0)
            rc = w->rec.wide
                ? wide_pod(&w->rec.view, &wide, &w->pod, err)
                : pod_reduce(&w->rec.Y, &opt, &w->pod, err);
        w->X = &w->pod.signals;
        out->pod_rank = w->pod.count;
        out->energy = w->pod.energy;
    }
    w->data = (struct refine_data) { .Y = w->X, .tau = w->tau, .phases = 1, .share = w->rec.share };
    if (rc == MODAL_OK && w->least != NULL)
        rc = work_grid_noise(w, err);
    if (rc == MODAL_OK && w->least != NULL && w->pod.count > 0) {
        drop_below_grid(w);
        out->pod_rank = w->pod.count;
    }
    w->data.least = w->least;
    if (rc == MODAL_OK && w->shift > 1) {
        rc = fold(w->X, w->shift, &w->folded, err);
        w->samples = w->X->m / w->shift * w->shift;
        w->data = (struct refine_data) { .Y = &w->folded, .tau = w->tau, .phases = w->shift,
                                         .least = w->least };
    }
    return rc;
}

/* ---- channels by their noise ---- */

/*
 * Proper orthogonal signals of channels scaled to unit rms mix channels of little noise with
 * channels of much, and no weight on the mixture can undo that: a channel that hears hardly
 * anything but noise then costs a factor in the error of all.  So, once a first answer tells the
 * noise of each channel, they are divided by it, and reduced and identified again.  Where that
 * leaves a channel WEIGH_FALL times less than before, what was taken for its noise was the error
 * that the others' noise made: once more.  Weights differ by WEIGH_RANGE at most, so that a mode
 * which only noisy channels hear stays far above the rounding of the others.  Few channels are not
 * mixed, but a pencil of all alike may miss what much more noise in one hides in the others.
 */
bool work_may_weigh(const struct work *w)
{
    return w->refine && !w->rec.wide && w->rec.channels > 1 && !w->opt.signals_all
        && w->opt.rank.rule <= RANK_FIXED && w->opt.pod_rank == 0 && w->opt.pod_energy == 0
        && w->opt.scale == SCALE_RMS;
}

bool work_worth_weighing(const struct work *w)
{
    return work_may_weigh(w) && w->choice.chosen >= 0
        && w->choice.candidates[w->choice.chosen].fit.residual
        > REFINE_EXACT * refine_norm(&w->data);
}

/* The amplitudes of poles in the signals Y, by blocks where those are they. */
enum modal_status work_fit_signals(const struct work *w, const double complex *lambda, int count,
                                   const struct matrix *Y, struct synthesis *out,
                                   struct modal_error *err)
{
    struct compressed *b = w->data.blocks;

    return b != NULL && b->Y.x == Y->x && b->Y.m == Y->m
               ? synthesis_fit_blocks(lambda, count, w->tau, b, out, err)
               : synthesis_fit(lambda, count, w->tau, Y, NULL, out, err);
}

enum modal_status work_channel_noise(const struct work *w, double *noise,
                                     struct modal_error *err)
{
    const struct refined *fit = &w->choice.candidates[w->choice.chosen].fit;
    struct matrix folded = { 0 };
    const struct matrix *Y = &w->rec.Y;
    struct synthesis s = { 0 };
    enum modal_status rc = MODAL_OK;

    if (w->shift > 1) {
        rc = fold(&w->rec.Y, w->shift, &folded, err);
        Y = &folded;
    }
    if (rc == MODAL_OK)
        rc = work_fit_signals(w, fit->lambda, fit->poles, Y, &s, err);
    for (int c = 0; c < w->rec.channels && rc == MODAL_OK; c++)
        noise[c] = safe_norm(s.channel_residual + (size_t)c * w->shift, w->shift)
            / sqrt((double)Y->m * w->shift);
    synthesis_done(&s);
    free(folded.x);
    return rc;
}

/* Is a channel much quieter than was thought, or, at first, are they not alike? */
static bool weights_differ(const struct work *w, const double *noise)
{
    double least = HUGE_VAL, most = 0;
    bool fell = false;

    for (int c = 0; c < w->rec.channels; c++) {
        if (!(w->rec.scale[c] > 0))
            continue;
        least = fmin(least, noise[c]), most = fmax(most, noise[c]);
        /* residuals never rise for better poles: noise falls round by round, and ends */
        fell |= w->noise != NULL && noise[c] < w->noise[c] / WEIGH_FALL;
    }
    bool doubtful = w->pod.count > 0 || w->facts.work_limit;
    return w->noise == NULL ? most > (doubtful ? NOISE_ALIKE : NOISE_FEW) * least : fell;
}

/* Weights over the noise, the quietest channel at 1; of few channels weighted = rec.Y by them. */
static enum modal_status divide_by_noise(struct work *w, struct modal_error *err)
{
    const struct matrix *Y = &w->rec.Y;
    bool few = w->pod.count == 0;
    double least = HUGE_VAL;

    if (w->weight == NULL) {
        w->weighted = few ? matrix_new(Y->m, Y->n) : (struct matrix) { 0 };
        w->weight = malloc(sizeof *w->weight * (size_t)w->rec.channels);
    }
    if (w->weight == NULL || (few && w->weighted.x == NULL))
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d samples of %d channels",
                          Y->m, Y->n);
    for (int c = 0; c < Y->n; c++)
        least = w->rec.scale[c] > 0 ? fmin(least, w->noise[c]) : least;
    for (int c = 0; c < Y->n; c++) {
        w->weight[c] = least / w->noise[c];  /* the quietest stays as it is: no sample grows */
        for (int l = 0; l < Y->m && few; l++)
            w->weighted.x[l + (size_t)c * Y->m] = Y->x[l + (size_t)c * Y->ld] * w->weight[c];
    }
    return MODAL_OK;
}

/* Weigh the channels by what the chosen poles leave in them; *again: they are weighed anew. */
enum modal_status work_weigh_channels(struct work *w, bool *again, struct modal_error *err)
{
    double *noise = malloc(sizeof *noise * w->rec.channels), most = 0;
    enum modal_status rc;

    *again = false;
    if (noise == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for the noise of %d channels",
                          w->rec.channels);
    rc = work_channel_noise(w, noise, err);
    for (int c = 0; c < w->rec.channels && rc == MODAL_OK; c++)
        most = fmax(most, noise[c]);
    for (int c = 0; c < w->rec.channels && rc == MODAL_OK; c++)
        /* a channel that is fitted to rounding would outweigh all others */
        noise[c] = fmax(noise[c], fmax(WEIGH_RANGE * most, NOISE_QUIETEST));
    *again = rc == MODAL_OK && weights_differ(w, noise);
    if (*again) {
        free(w->noise);
        w->noise = noise, noise = NULL;
        rc = divide_by_noise(w, err);
    }
    free(noise);
    return rc;
}

/* ---- samples on a grid ---- */

/* A record that was evened out may have more rows than were sent. */
int work_rows_sent(const struct work *w, const struct batch *b)
{
    int rows = w->rec.Y.m * w->rec.decimation;
    size_t most = b->samples - (size_t)llround(w->rec.t0 / b->dt);

    return (size_t)rows < most ? rows : (int)most;
}

/* GRID_FIRST samples of each channel, spread over ROWS from row FIRST on, one channel after the
 * other.  Pages of a mapped file are given back one by one, or all of it would be in memory. */
static void read_some(const struct work *w, const struct batch *b, size_t first, int rows,
                      double *some)
{
    for (int k = 0; k < GRID_FIRST; k++) {
        size_t row = first + (size_t)((double)k * (rows - 1) / (GRID_FIRST - 1));
        for (int c = 0; c < w->rec.channels; c++)
            some[k + c * GRID_FIRST] = b->signals[row * b->channels + w->rec.channel[c]];
        if (b->spare != NULL)
            b->spare(b->signals, b->samples * b->channels * sizeof *b->signals);
    }
}

/* The grid of each channel, as it was sent.  True: there is one. */
enum modal_status work_find_grids(struct work *w, const struct batch *b, bool *any,
                                  struct modal_error *err)
{
    size_t first = (size_t)llround(w->rec.t0 / b->dt);
    int rows = work_rows_sent(w, b);
    double *some = malloc(sizeof *some * GRID_FIRST * ((size_t)w->rec.channels + 1));
    enum modal_status rc = MODAL_OK;

    w->grid = calloc((size_t)w->rec.channels + 1, sizeof *w->grid);
    if (w->grid == NULL || some == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for the grids of %d channels",
                        w->rec.channels);
        goto out;
    }
    if (w->rec.wide) {
        rc = wide_grids(&w->rec.view, w->grid, any, err);
        goto out;
    }
    read_some(w, b, first, rows, some);
    for (int c = 0; c < w->rec.channels; c++) {
        if (w->rec.scale[c] > 0 && grid_may_be(some + c * GRID_FIRST, GRID_FIRST))
            w->grid[c] = grid_of(b->signals + first * b->channels + w->rec.channel[c],
                                 b->channels, rows);
        *any |= w->grid[c].step > 0;
    }
out:
    free(some);
    return rc;
}

static bool floats(const struct work *w)
{
    for (int c = 0; c < w->rec.channels; c++)
        if (w->grid[c].floating)
            return true;
    return false;
}

/* At most what is left of a signal where its grid makes it, over w->least. */
static const double BELOW = 2;

/* Is what a fit leaves in a signal about what its grid makes?  Far less: the numbers are exact, and
 * happen to lie on a grid. */
static bool leaves_grid(const struct work *w, const struct refined *fit)
{
    const double EXACT = 1e-4;
    bool any = false;

    for (int g = 0; g < fit->groups && w->least != NULL && fit->noise != NULL; g++) {
        double left = fit->noise[g] * fit->noise[g];
        /* `least` is the most that a grid makes (grid.h): more is motion, far less is exact */
        any |= left > EXACT * w->least[g] && left < BELOW * w->least[g];
    }
    return any;
}

/* Significant digits make their noise where the response is large, and enough poles may follow all
 * of it: fewer that leave it count as well. */
bool work_grid_matters(const struct work *w)
{
    const struct order_choice *o = &w->choice;
    bool any = leaves_grid(w, &o->candidates[o->chosen].fit);

    for (int i = 0; i < o->count && !any && floats(w); i++)
        any = o->candidates[i].fit.poles < o->candidates[o->chosen].fit.poles
            && leaves_grid(w, &o->candidates[i].fit);
    return any;
}

/* Are all signals explained to the rounding of their samples?  Nothing is then left that could
 * change in the record, or be driven. */
bool work_is_explained(const struct work *w, const struct identify_result *out)
{
    const struct refined *fit =
        w->choice.chosen >= 0 ? &w->choice.candidates[w->choice.chosen].fit : NULL;
    bool all = out->at_grid && fit != NULL && w->least != NULL && w->facts.converged;

    for (int g = 0; all && g < fit->groups; g++)
        all = fit->noise[g] * fit->noise[g] < BELOW * w->least[g];
    return all;
}

/* Rows up to the last in which some channel, as it was sent, is GRID_ABOVE steps from where it
 * ends. */
static int rows_above_grid(const struct work *w)
{
    const struct matrix *Y = &w->rec.Y;
    int rows = 0;

    if (w->rec.wide)
        return wide_rows_above(&w->rec.view, w->grid, GRID_ABOVE);
    for (int c = 0; c < Y->n; c++) {
        const double *y = Y->x + (size_t)c * Y->ld;
        double least = w->rec.scale[c] > 0 ? GRID_ABOVE * w->grid[c].step / w->rec.scale[c] : 0;
        if (w->rec.scale[c] > 0 && !grid_ends(&w->grid[c]))
            return Y->m;
        for (int k = Y->m - 1; k >= rows && w->rec.scale[c] > 0; k--)
            if (fabs(y[k] - y[Y->m - 1]) >= least)
                rows = k + 1;
    }
    return rows;
}

/* A response that has died away below the grid was rounded to nothing: no noise, but part of
 * itself, and longer records of it make the answer worse. */
enum modal_status work_cut_below_grid(struct work *w, struct modal_error *err)
{
    int L = w->rec.Y.m,
        rows = w->rec.decimation == 1 && !w->opt.difference ? rows_above_grid(w) : L;

    rows = (rows + w->shift - 1) / w->shift * w->shift;
    if (rows > GRID_WORTH * L || rows < REFINE_ROWS_LEAST * w->shift)
        return MODAL_OK;
    pod_done(&w->pod);
    w->cut = rows;
    return record_cut(&w->rec, rows, w->opt.scale, err);
}

void work_report_grids(const struct work *w, struct identify_result *out)
{
    for (int c = 0; c < w->rec.channels && c < GRID_CHANNELS && out->at_grid; c++) {
        bool said = w->grid[c].step == 0;
        for (int i = 0; i < out->diagnostic_count; i++)
            said |= strcmp(out->diagnostics[i].code, "quantised") == 0
                && out->diagnostics[i].channel == w->rec.channel[c];
        if (!said)
            identify_diagnose(out, "quantised", w->rec.channel[c],
                              "the values of channel %d %s%g, and what the modes "
                              "leave of them is no more than its rounding, %g: "
                              "whatever is smaller than half a step is not looked for",
                              w->rec.channel[c],
                              w->grid[c].floating ? "have few digits, in the root mean square "
                                                    "to steps of "
                                                  : "lie on a grid of ",
                              w->grid[c].step, w->grid[c].step / sqrt(12));
    }
    if (w->cut > 0)
        identify_diagnose(out, "ends_below_grid", -1,
                          "after %.6g s no channel is two steps of its grid from where it ends: "
                          "what was left of the response was rounded to nothing, and the rest of "
                          "the record is not used",
                          w->rec.t0 + w->cut * w->rec.step);
}
