/* identify_wild.c - what spikes and stuck samples do to the way from signals to modes: they are
 * left out, errors are those of the rest, and it is said */
#include "modal/identify/identify_state.h"
#include <math.h>
#include <stdlib.h>
#include "modal/identify/prepare/bound.h"
#include "modal/linalg/svd.h"

/* rec.Y between its scale and the batch's: samples are kept in the batch's unit. */
static void scale_wild(struct work *w, bool out)
{
    for (int i = 0; i < w->wild.count; i++) {
        struct wild_sample *s = &w->wild.at[i];
        s->sent = out ? s->sent * w->rec.scale[s->channel] : s->sent / w->rec.scale[s->channel];
    }
}

bool work_may_take_wild(const struct work *w)
{
    return w->refine && !w->rec.wide && w->rec.gain == 1
        && w->rec.decimation == 1 && !w->opt.difference && w->data.blocks == NULL
        && w->ragged == 0 && w->opt.scale == SCALE_RMS;
}

static int by_place(const void *a, const void *b)
{
    const struct wild_sample *x = a, *y = b;

    return x->channel != y->channel ? x->channel - y->channel : x->row - y->row;
}

/* S as it was sent, where it is off by so much; false: of a record that was cut before it, or of a
 * channel that has no scale, being nothing beside the others. */
static bool as_sent(const struct work *w, struct wild_sample *s)
{
    if (!work_may_take_wild(w))
        return true;
    if (s->row >= w->rec.Y.m || !(w->rec.scale[s->channel] > 0))
        return false;
    s->sent += w->rec.scale[s->channel]
             * w->rec.Y.x[s->row + (size_t)s->channel * (size_t)w->rec.Y.ld];
    return true;
}

enum modal_status work_begin_wild(struct work *w, struct modal_error *err)
{
    struct wild *stuck = &w->rec.stuck, *wild = &w->wild;
    int most = stuck->count + w->spikes.count, count = 0;

    if (most == 0)
        return MODAL_OK;
    wild->at = malloc((size_t)most * sizeof *wild->at);
    if (wild->at == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d samples", most);
    for (int i = 0; i < stuck->count; i++)
        if (as_sent(w, &stuck->at[i]))
            stuck->at[count] = wild->at[count] = stuck->at[i], count++;
    wild->known_count = stuck->count = count;
    wild->known = stuck->at;
    for (int i = 0; i < w->spikes.count; i++) {
        const struct step *s = &w->spikes.at[i];
        struct wild_sample one = { s->row, s->channel, s->size };
        bool known = wild->known_count > 0
            && bsearch(&one, wild->known, (size_t)wild->known_count, sizeof one, by_place) != NULL;
        if (!known && as_sent(w, &one))
            wild->at[count++] = one;
    }
    wild->count = count;
    qsort(wild->at, (size_t)count, sizeof *wild->at, by_place);
    wild->share = count / ((double)w->rec.Y.m * w->rec.channels * w->rec.decimation);
    return MODAL_OK;
}

/* Those that stand out of what the strongest poles leave, as far as medians believe them. */
static enum modal_status take_robust(struct work *w, const struct refined *fit,
                                     struct modal_error *err)
{
    double complex *best = malloc(sizeof *best * ((size_t)fit->poles + 1));
    struct rebuild_model poles = { fit->lambda, fit->poles, w->tau, w->shift };
    enum modal_status rc = best == NULL
        ? modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles", fit->poles)
        : wild_strongest(&poles, &w->rec.Y, best, &poles.count, err);

    poles.lambda = best;
    if (rc == MODAL_OK)
        rc = wild_take(&poles, &w->rec.Y, &w->wild, err);
    free(best);
    return rc;
}

enum modal_status work_take_wild(struct work *w, struct modal_error *err)
{
    const struct refined *fit = w->choice.chosen >= 0
                              ? &w->choice.candidates[w->choice.chosen].fit : NULL;
    enum modal_status rc = MODAL_OK;

    if (!work_may_take_wild(w) || fit == NULL || fit->poles == 0)
        return MODAL_OK;
    /* of what is no one set of modes in noise nothing can be said to be neither */
    w->wild.no_others = w->wild.count == w->wild.known_count && !work_is_clean(w);
    if (w->wild.count == 0 && w->wild.no_others)
        return MODAL_OK;
    scale_wild(w, false);
    if (w->wild.count == w->wild.known_count)
        rc = wild_take(&(struct rebuild_model) { fit->lambda, fit->poles, w->tau, w->shift },
                       &w->rec.Y, &w->wild, err);
    if (rc == MODAL_OK && w->wild.count > 0)
        rc = take_robust(w, fit, err);
    scale_wild(w, true);
    return rc;
}

void work_put_wild_back(struct work *w)
{
    scale_wild(w, false);
    wild_put_back(&w->rec.Y, &w->wild);
}

bool work_is_clean(const struct work *w)
{
    return w->choice.clean
        || (w->choice.chosen >= 0 && w->choice.candidates[w->choice.chosen].fit.residual
                                         <= REFINE_EXACT * safe_matrix_norm(w->data.Y));
}

/* Rebuilt samples agree with the model whatever it is: neither the size of the noise nor what is
 * known of a pole has anything of them. Where they are filled only, not rebuilt, the poles are by
 * some share less known. */
enum modal_status work_widen_for_lacking(const struct work *w, struct poles *p,
                                         struct modal_error *err)
{
    double all = (double)w->rec.Y.m * w->rec.channels, size = 1 / sqrt(1 - w->wild.count / all),
           *factor;
    enum modal_status rc = MODAL_OK;

    if ((w->wild.count == 0 && w->steps.count == 0) || p->count == 0)
        return MODAL_OK;
    factor = malloc(2 * sizeof *factor * (size_t)p->count);
    if (factor == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles", p->count);
    for (int j = 0; j < 2 * p->count; j++)
        factor[j] = 1 / sqrt(1 - w->wild.share);
    if (work_may_take_wild(w))
        rc = bound_factors(&(struct rebuild_model) { p->lambda, p->count, p->tau, w->shift },
                           &w->rec.Y, &w->wild, &w->steps, factor, err);
    for (int j = 0; j < p->count && rc == MODAL_OK; j++)
        p->std_re[j] *= size * factor[2 * j], p->std_im[j] *= size * factor[2 * j + 1];
    free(factor);
    return rc;
}

/* COUNT samples of one channel. */
static void report_channel(const struct work *w, const struct wild_sample *at, int count,
                           struct identify_result *out)
{
    const struct wild *all = &w->wild;
    int stuck = 0, channel = w->rec.channel[at->channel];
    double first = w->rec.t0 + at->row * w->rec.dt;

    for (int i = 0; i < all->known_count; i++)
        stuck += all->known[i].channel == at->channel;
    if (stuck > 0)
        identify_diagnose(out, "wild_samples", channel,
                          "%d samples of channel %d, the first at %.6g s, are no part of the "
                          "motion: %d are exactly equal, as dropped, held or cut; they are left "
                          "out, and rebuilt by the modes; see what sends them", count, channel,
                          first, stuck);
    else
        identify_diagnose(out, "wild_samples", channel,
                          "%d sample%s of channel %d, the first at %.6g s, stand%s out of the "
                          "noise as none of it does: left out as spikes, and "
                          "rebuilt by the modes; see what sends them", count,
                          count > 1 ? "s" : "", channel, first, count > 1 ? "" : "s");
}

void work_report_wild(const struct work *w, struct identify_result *out)
{
    const struct wild *all = &w->wild;
    int said = 0;

    for (int i = 0, first = 0; i < all->count; i++) {
        if (i + 1 < all->count && all->at[i + 1].channel == all->at[i].channel)
            continue;
        if (said++ < IDENTIFY_TOLD)     /* channels */
            report_channel(w, all->at + first, i + 1 - first, out);
        first = i + 1;
    }
}
