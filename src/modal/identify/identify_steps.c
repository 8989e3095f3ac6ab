/* identify_steps.c - what steps do to the way from signals to modes: they are fitted beside the
 * poles, taken out, and it is said */
#include "modal/identify/identify_state.h"
#include <math.h>
#include <stdlib.h>
#include "modal/identify/linear/exponents.h"

static const double
    MOVED = 0.1;                    /* of a step's std: what is left of it biases no error by more
                                     * than a hundredth */

/* Steps between the batch's unit and that of rec.Y. */
static void scale_steps(const struct steps *steps, const struct record *rec, bool out)
{
    for (int i = 0; i < steps->count; i++) {
        struct step *s = &steps->at[i];
        double scale = rec->scale[s->channel], factor = out ? scale : 1 / scale;
        s->size *= factor, s->std *= factor;
    }
}

enum modal_status work_begin_steps(struct work *w, struct modal_error *err)
{
    enum modal_status rc;

    if (!work_may_take_wild(w) || w->rec.Y.m >= GROW * HEAD)
        return MODAL_OK;
    rc = steps_find(&w->rec.Y, &w->steps, &w->spikes, err);
    if (rc != MODAL_OK || w->steps.count + w->spikes.count == 0)
        return rc;
    steps_take(&w->steps, 1, &w->rec.Y);
    scale_steps(&w->steps, &w->rec, true);
    for (int i = 0; i < w->spikes.count; i++)
        w->rec.Y.x[w->spikes.at[i].row + (size_t)w->spikes.at[i].channel * (size_t)w->rec.Y.ld]
            -= w->spikes.at[i].size;
    scale_steps(&w->spikes, &w->rec, true);
    return record_cut(&w->rec, w->rec.Y.m, w->opt.scale, err);
}

/* Those of a record that was cut before them are none. */
static void drop_late(struct work *w)
{
    int count = 0;

    for (int i = 0; i < w->steps.count; i++)
        if (w->steps.at[i].row < w->rec.Y.m)
            w->steps.at[count++] = w->steps.at[i];
    w->steps.count = count;
}

/* The poles that are no slow ones, into OTHERS; what slow ones cost by Bayes' criterion
 * (criterion.c). */
static int leave_slow_out(const struct work *w, const struct refined *fit, double complex *others,
                          double *price)
{
    int S = w->rec.channels * w->shift, count = 0;
    double record = w->rec.step * w->rec.Y.m;

    *price = 0;
    for (int j = 0; j < fit->poles; j++) {
        int order = pole_order(fit->lambda[j], w->tau);
        if (cabs(fit->lambda[j]) * record < 2 * M_PI)
            *price += (S * order + (fit->lambda[j] != 0) * (1 + 1.0 / S) * order)
                    * log((double)w->rec.Y.m * w->rec.channels);
        else
            others[count++] = fit->lambda[j];
    }
    return count;
}

/* An offset, and what is slower than the record, a step may have drawn that was told a little too
 * high or low: they stay where they are worth it beside the step as it is without them. */
static enum modal_status fit_steps(struct work *w, const struct refined *fit, double *moved,
                                   struct modal_error *err)
{
    size_t bytes = sizeof *w->steps.at * (size_t)w->steps.count;
    struct steps without = { malloc(bytes), w->steps.count };
    double complex *others = malloc(sizeof *others * (size_t)fit->poles);
    double price = 0, left, more, far;
    int count = fit->poles;
    struct rebuild_model all = { fit->lambda, fit->poles, w->tau, w->shift };
    enum modal_status rc = MODAL_OK;

    if (without.at == NULL || others == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d steps", without.count);
    } else {
        memcpy(without.at, w->steps.at, bytes);
        count = leave_slow_out(w, fit, others, &price);
        rc = steps_fit(&all, &w->rec.Y, &w->steps, moved, &left, err);
    }
    if (rc == MODAL_OK && count < fit->poles) {
        all.lambda = others, all.count = count;
        rc = steps_fit(&all, &w->rec.Y, &without, &far, &more, err);
        if (rc == MODAL_OK && more < left + price)
            memcpy(w->steps.at, without.at, bytes), *moved = far;
    }
    free(without.at), free(others);
    return rc;
}

enum modal_status work_fit_steps(struct work *w, bool *settled, struct modal_error *err)
{
    const struct refined *fit = w->choice.chosen >= 0
                              ? &w->choice.candidates[w->choice.chosen].fit : NULL;
    struct steps before = { malloc(sizeof *before.at * (size_t)(w->steps.count + 1)), 0 };
    double moved;
    enum modal_status rc = MODAL_OK;

    *settled = true;
    drop_late(w);
    before.count = w->steps.count;
    if (before.at == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d steps", before.count);
    if (before.count > 0 && fit != NULL && fit->poles > 0) {
        scale_steps(&w->steps, &w->rec, false);
        memcpy(before.at, w->steps.at, sizeof *before.at * (size_t)before.count);
        rc = fit_steps(w, fit, &moved, err);
        *settled = rc != MODAL_OK || !(moved > MOVED);
        if (rc == MODAL_OK) {
            /* those that are taken out are those that there are: what is put back is the record */
            steps_take(&before, -1, &w->rec.Y);
            steps_take(&w->steps, 1, &w->rec.Y);
        }
        scale_steps(&w->steps, &w->rec, true);
    }
    free(before.at);
    return rc;
}

bool work_are_steps(const struct work *w)
{
    double limit = wild_standing_out((double)w->rec.Y.m * w->rec.channels);
    bool all = w->steps.count > 0;

    for (int i = 0; i < w->steps.count; i++)
        all &= fabs(w->steps.at[i].size) > limit * w->steps.at[i].std;
    return all && work_is_clean(w);
}

void work_put_steps_back(struct work *w)
{
    scale_steps(&w->steps, &w->rec, false);
    steps_take(&w->steps, -1, &w->rec.Y);
    steps_done(&w->steps);
}

void work_report_steps(const struct work *w, struct identify_result *out)
{
    for (int i = 0; i < w->steps.count && i < IDENTIFY_TOLD; i++) {      /* steps */
        const struct step *s = &w->steps.at[i];
        int channel = w->rec.channel[s->channel];
        identify_diagnose(out, "step", channel,
                          "channel %d jumps by %.4g (standard deviation %.2g) at %.6g s and stays "
                          "there: a sensor that slips, or a load that goes; the step is fitted "
                          "beside the modes and left out; see what moves it", channel, s->size,
                          s->std, w->rec.t0 + s->row * w->rec.step);
    }
}
