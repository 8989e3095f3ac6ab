/*
 * forced.c - the way from measured inputs and responses to modes
 *
 * The second opinion.  The standard errors of transfer.c hold where what is left over is white
 * and of its own in each response.  What bears on a pole is the noise near its frequency, in the
 * direction of its shape: over the NEAR lines about it, each response over its standard deviation,
 * the mean square of the projection on the shape is 1, with the standard deviation 1/sqrt(lines).
 * Where it is larger beyond chance, so are the errors, by its root; but where the search ended
 * while modes were still found, what is left is no noise, and they are unknown.
 *
 * The modal model.  A part a / (s - lambda) of a response over an input, s the Laplace variable,
 * adds to the state what an input that is straight between samples h apart brings, and so to (2)
 * of lines.c, r = exp(lambda h), beside a direct term
 *
 *     a (1 - r)^2 / (lambda^2 h) / (z - r):                                                   (3)
 *
 * a = shape times participation, of a pair beside its conjugate; of a real pole, whose conjugate
 * is itself, twice what transfer.h has.
 */
#include "modal/identify/forced/forced.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/answer/modes.h"
#include "modal/identify/ask/diagnose.h"
#include "modal/identify/ask/screen.h"
#include "modal/identify/ask/verdict.h"
#include "modal/identify/fit/refine.h"
#include "modal/identify/forced/clipping.h"
#include "modal/identify/forced/hits.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/prepare/record.h"
#include "modal/identify/prepare/response.h"
#include "modal/numbers.h"

enum {
    NEAR = 32,                   /* lines about a pole at least */
    FRF_EVEN = 256,              /* frequencies of frequency responses over the band, */
    FRF_BESIDE = 10,             /* and on either side of a mode */
    FRF_MOST = 1000000           /* numbers: some 60 MB of JSON */
};
static const double
    UNEXPLAINED = 0.5,           /* of the responses' rms */
    FEW_CYCLES = 2;              /* in the record: their beginning and end is all there is */

struct work {
    struct identify_options opt;
    const struct batch *batch;
    struct record rec;           /* responses */
    struct matrix inputs;        /* owned */
    int row[IDENTIFY_RECORDS_MOST];      /* where records begin */
    int records;
    struct lines lines;
    struct forced_search found;
    double widest;               /* factor of the second opinion */
    bool clipped;                /* an input or a response was */
    struct hits hits;            /* that samples do not tell */
    double clock;
};

/* ---- what is asked ---- */

static enum modal_status check(const struct batch *batch, const struct identify_options *o,
                               struct modal_error *err)
{
    const struct response_limits accepted = {
        .beside = "inputs, starts, frf, window, band, detrend, scale, signals, shapes, rank.fixed, "
                  "rank.most, threads",
        .modes_most = TRANSFER_POLES_MOST
    };
    enum modal_status rc = response_check(batch, o, &accepted, err);

    if (rc != MODAL_OK)
        return rc;
    if (o->inputs == NULL || o->input_count < 1)
        return modal_fail_field(err, MODAL_BAD_INPUT, "inputs", "response=forced needs the "
                                "channels that hold the measured excitation; accepted: "
                                "inputs=CH,..., names or indices below %zu", batch->channels);
    if (o->input_count > IDENTIFY_INPUTS_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "inputs", "inputs names %d channels; "
                                "accepted: 1 to %d", o->input_count, IDENTIFY_INPUTS_MOST);
    if (o->start_count > 0 && o->detrend == DETREND_LINEAR)
        return modal_fail_field(err, MODAL_BAD_INPUT, "detrend", "detrend=linear beside `starts`: "
                                "one line through several records is none of theirs; accepted: "
                                "none, mean");
    return MODAL_OK;
}

static bool is_input(const struct identify_options *o, int channel)
{
    for (int j = 0; j < o->input_count; j++)
        if (o->inputs[j] == channel)
            return true;
    return false;
}

/* ---- the record ---- */

static const char *name_of(const struct batch *b, int channel, char text[80])
{
    if (b->names != NULL && b->names[channel] != NULL)
        snprintf(text, 80, "\"%.60s\" (channel %d)", b->names[channel], channel);
    else
        snprintf(text, 80, "channel %d", channel);
    return text;
}

/* The channels that were chosen, or all, without the inputs. */
static enum modal_status read_responses(struct work *w, struct modal_error *err)
{
    struct identify_options cut = w->opt;
    int all = cut.channels != NULL ? cut.channel_count : (int)w->batch->channels, count = 0;
    int *list = malloc(sizeof *list * ((size_t)all + 1));
    char text[80];
    enum modal_status rc = MODAL_OK;

    if (list == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d channels", all);
    for (int c = 0; c < all && rc == MODAL_OK; c++) {
        int channel = cut.channels != NULL ? cut.channels[c] : c;
        if (!is_input(&cut, channel))
            list[count++] = channel;
        else if (cut.channels != NULL)
            rc = modal_fail_field(err, MODAL_BAD_INPUT, "signals", "signals names %s, which is an "
                                  "input too; accepted: responses",
                                  name_of(w->batch, channel, text));
    }
    if (rc == MODAL_OK && count == 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "inputs", "all %zu channels are inputs; at "
                              "least one must be a response", w->batch->channels);
    cut.channels = list, cut.channel_count = count;
    cut.band[0] = cut.band[1] = 0;
    cut.period = -1;
    if (rc == MODAL_OK)
        rc = record_make(w->batch, &cut, &w->rec, err);
    free(list);
    return rc;
}

/* What is new in column j, about its mean, beside those before it: its norm then over before. */
static double orthogonal_part(struct matrix *u, int j)
{
    double *x = u->x + (size_t)j * u->ld, mean = 0, before, most;

    for (int k = 0; k < u->m; k++)
        mean += x[k] / u->m;
    for (int k = 0; k < u->m; k++)
        x[k] -= mean;
    before = cblas_dnrm2(u->m, x, 1);
    most = fmax(before, fabs(mean) * sqrt(u->m));
    if (!(before > DBL_EPSILON * u->m * most))
        return -1;
    for (int twice = 0; twice < 2; twice++)
        for (int i = 0; i < j; i++) {
            const double *y = u->x + (size_t)i * u->ld;
            cblas_daxpy(u->m, -cblas_ddot(u->m, x, 1, y, 1), y, 1, x, 1);
        }
    most = cblas_dnrm2(u->m, x, 1);
    if (most > 0)
        cblas_dscal(u->m, 1 / most, x, 1);
    return most / before;
}

/* Each input must vary, and by more than the others do already. */
static enum modal_status check_inputs(const struct work *w, struct modal_error *err)
{
    struct matrix u = w->inputs;
    size_t bytes = sizeof *u.x * (size_t)u.m * (size_t)u.n;
    char text[80];
    enum modal_status rc = MODAL_OK;

    u.x = malloc(bytes);
    if (u.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d inputs", u.n);
    memcpy(u.x, w->inputs.x, bytes);
    for (int j = 0; j < u.n && rc == MODAL_OK; j++) {
        double own = orthogonal_part(&u, j);
        name_of(w->batch, w->opt.inputs[j], text);
        if (own < 0)
            rc = modal_fail_field(err, MODAL_BAD_INPUT, "inputs", "input %s is constant throughout "
                                  "what is identified: it excites nothing; accepted: channels that "
                                  "hold a force, or a motion, that varies", text);
        else if (!(own > DBL_EPSILON * u.m))
            rc = modal_fail_field(err, MODAL_BAD_INPUT, "inputs", "input %s is a sum of the inputs "
                                  "named before it: which of them moves the responses cannot be "
                                  "told; leave it out", text);
    }
    free(u.x);
    return rc;
}

/* Where records begin within what is identified: the first at its first row. */
static enum modal_status read_starts(struct work *w, struct modal_error *err)
{
    const struct identify_options *o = &w->opt;

    w->row[0] = 0, w->records = 1;
    for (int i = 0; i < o->start_count; i++) {
        double row = round((o->starts[i] - w->rec.t0) / w->rec.step);
        if (i > 0 && !(o->starts[i] > o->starts[i - 1]))
            return modal_fail_field(err, MODAL_BAD_INPUT, "starts", "starts: %g s after %g s; "
                                    "accepted: times that rise", o->starts[i], o->starts[i - 1]);
        if (o->starts[i] > (double)(w->batch->samples - 1) * w->batch->dt)
            return modal_fail_field(err, MODAL_BAD_INPUT, "starts", "starts: %g s is behind the "
                                    "last sample, %g s", o->starts[i],
                                    (double)(w->batch->samples - 1) * w->batch->dt);
        if (row <= 0 || row >= w->rec.Y.m)
            continue;
        if (row - w->row[w->records - 1] < IDENTIFY_SAMPLES_LEAST)
            return modal_fail_field(err, MODAL_BAD_INPUT, "starts", "starts: a record of %g "
                                    "samples before %g s; accepted: %d samples and more",
                                    row - w->row[w->records - 1], o->starts[i],
                                    IDENTIFY_SAMPLES_LEAST);
        w->row[w->records++] = (int)row;
    }
    return MODAL_OK;
}

/* s, of the longest of them. */
static double longest_record(const struct work *w)
{
    int most = w->rec.Y.m - w->row[w->records - 1];

    for (int e = 1; e < w->records; e++)
        most = w->row[e] - w->row[e - 1] > most ? w->row[e] - w->row[e - 1] : most;
    return most * w->rec.step;
}

static enum modal_status read_inputs(struct work *w, struct modal_error *err)
{
    const struct batch *b = w->batch;
    size_t first = (size_t)llround(w->rec.t0 / b->dt);
    int L = w->rec.Y.m, count = w->opt.input_count;

    w->inputs = matrix_new(L, count);
    if (w->inputs.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d inputs", count);
    for (int j = 0; j < count; j++)
        for (int k = 0; k < L; k++)
            w->inputs.x[k + (size_t)j * L]
                = b->signals[(first + (size_t)k) * b->channels + (size_t)w->opt.inputs[j]];
    return check_inputs(w, err);
}

static struct forced_limits search_limits(const struct work *w)
{
    const struct identify_options *o = &w->opt;
    int most = o->rank.most > 0 ? (o->rank.most + 1) / 2 : TRANSFER_POLES_MOST;

    return (struct forced_limits) { o->rank.fixed / 2,
                                    most < TRANSFER_POLES_MOST ? most : TRANSFER_POLES_MOST,
                                    .cancelled = o->cancelled, .context = o->context };
}

static enum modal_status search(struct work *w, struct modal_error *err)
{
    const struct identify_options *o = &w->opt;
    double band[2] = { o->band[0] * w->rec.step, o->band[1] * w->rec.step };
    struct forced_limits limits = search_limits(w);
    struct lines_records records = { w->row, w->records };
    enum modal_status rc = lines_make(&w->rec.Y, &w->inputs, &records, band, &w->lines, err);

    if (rc == MODAL_OK && 2 * w->lines.count < transfer_unknowns(&w->lines, 1) / w->lines.responses)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, band[1] > 0 ? "band" : "signals", "%d lines of "
                              "the spectrum for the %d unknowns of one mode and %d inputs: record "
                              "longer, or name fewer inputs", w->lines.count,
                              transfer_unknowns(&w->lines, 1), w->opt.input_count);
    return rc == MODAL_OK ? forced_search(&w->lines, &limits, &w->found, err) : rc;
}

/* ---- the answer ---- */

/* Mean square of what is left over about pole p, along its shape; *lines of them. */
static double noise_about(const struct work *w, const double complex *R, int p, int *lines)
{
    const struct transfer *t = &w->found.model;
    const struct lines *l = &w->lines;
    double turn = 2 * M_PI / l->samples, half = fmax(-2 * creal(t->s[p]), NEAR / 2 * turn);
    double size = 0, sum = 0;
    int V = 2 * t->poles + l->direct;

    *lines = 0;
    for (int i = 0; i < l->responses; i++) {
        const double *x = t->x + 2 * p + (size_t)V * i;
        size += (x[0] * x[0] + x[1] * x[1]) / t->variance[i];
    }
    for (int n = 0; n < l->count && size > 0; n++) {
        double complex along = 0;
        if (fabs(carg(l->z[n]) - cimag(t->s[p])) > half)
            continue;
        for (int i = 0; i < l->responses; i++) {
            const double *x = t->x + 2 * p + (size_t)V * i;
            along += CMPLX(x[0], -x[1]) * R[n + (size_t)i * l->count] / t->variance[i];
        }
        sum += creal(along * conj(along)) / (2 * size);
        ++*lines;
    }
    return *lines > 0 ? sum / *lines : 1;
}

/* How each input drives mode P, whose shape is m's. */
static enum modal_status participate(const struct work *w, int p, struct identify_mode *m,
                                     struct modal_error *err)
{
    const struct transfer *t = &w->found.model;
    const struct lines *l = &w->lines;
    double h = w->rec.step;
    double complex lambda = t->s[p] / h, off = 1 - cexp(t->s[p]);
    double complex back = lambda * lambda * h / (off * off) * (cimag(lambda) > 0 ? 1 : 2);
    int largest = 0;
    const double *x;

    m->participation = malloc(sizeof *m->participation * (size_t)l->inputs);
    if (m->participation == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d inputs", l->inputs);
    while (largest < l->responses - 1 && m->shape[largest] != 1)
        largest++;
    x = t->x + 2 * p + (size_t)(2 * t->poles + l->direct) * largest;
    back *= CMPLX(x[0], x[1]) * w->rec.scale[largest];   /* what the shape was divided by */
    for (int j = 0; j < l->inputs; j++)
        m->participation[j] = back * t->q[j + (size_t)l->drives * p] / l->size[j];
    return MODAL_OK;
}

static enum modal_status shape_mode(const struct work *w, int p, struct identify_mode *m,
                                    struct modal_error *err)
{
    const struct lines *l = &w->lines;
    int V = 2 * w->found.model.poles + l->direct;

    m->shape = malloc(sizeof *m->shape * (size_t)l->responses);
    if (m->shape == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for shapes");
    for (int i = 0; i < l->responses; i++) {
        const double *x = w->found.model.x + 2 * p + (size_t)V * i;
        m->shape[i] = CMPLX(x[0], x[1]) * w->rec.scale[i];
    }
    modes_scale_shape(m, l->responses);
    return participate(w, p, m, err);
}

/* Else it makes up for what is beyond the band. */
static bool is_within(const struct work *w, double complex lambda)
{
    double hertz = cimag(lambda) / (2 * M_PI);

    return w->opt.band[1] == 0 || (hertz >= w->opt.band[0] && hertz <= w->opt.band[1]);
}

static enum modal_status report_mode(struct work *w, const double complex *R, int p, int live,
                                     struct identify_mode *m, struct modal_error *err)
{
    const struct transfer *t = &w->found.model;
    double step = w->rec.step, noise, wider;
    double complex lambda = t->s[p] / step;
    int lines;

    *m = (struct identify_mode) { .exponent = lambda, .resolved = lambda,
                                  .multiplier = multiplier_of(lambda, w->rec.dt),
                                  .amplitude = sqrt(2 * t->energy[p] / w->rec.Y.m / live),
                                  .persistence = NAN, .residual = NAN, .runner_up = NAN,
                                  .growth = t->exact ? GROWTH_EXACT : GROWTH_UNSEEN };
    noise = noise_about(w, R, p, &lines);
    wider = noise > 1 + FORCED_CHANCE / sqrt(lines) && !t->exact ? sqrt(noise) : 1;
    w->widest = fmax(w->widest, wider);
    m->std_re = t->spread[2 * p] / step * wider;
    m->std_im = t->spread[2 * p + 1] / step * wider;
    modes_spread_std(m, w->rec.dt, w->rec.Y.m * step);
    m->bar = m->std_multiplier;
    m->cycles = cabs(lambda) / (2 * M_PI) * w->rec.Y.m * step;
    return w->opt.shapes ? shape_mode(w, p, m, err) : MODAL_OK;
}

static enum modal_status report_modes(struct work *w, struct identify_result *out,
                                      struct modal_error *err)
{
    const struct transfer *t = &w->found.model;
    const struct lines *l = &w->lines;
    double complex *R = malloc(sizeof *R * (size_t)l->count * (size_t)l->responses);
    int live = 0;
    enum modal_status rc = MODAL_OK;

    out->modes = calloc((size_t)t->poles + 1, sizeof *out->modes);
    if (R == NULL || out->modes == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d modes", t->poles);
    if (rc == MODAL_OK)
        rc = transfer_rest(l, t, R, err);
    for (int i = 0; i < l->responses; i++)
        live += l->energy[i] > 0;
    for (int p = 0; p < t->poles && rc == MODAL_OK; p++)
        if (is_within(w, t->s[p] / w->rec.step))
            rc = report_mode(w, R, p, live, &out->modes[out->mode_count++], err);
    if (rc == MODAL_OK)
        modes_rank(out);
    free(R);
    return rc;
}

static enum modal_status report_responses(struct work *w, struct identify_result *out,
                                          struct modal_error *err)
{
    const struct transfer *t = &w->found.model;
    const struct lines *l = &w->lines;
    size_t n = (size_t)l->responses;
    double all = 0, left = 0;

    out->channel_count = l->responses;
    out->channel = malloc(sizeof *out->channel * n);
    out->rms_error = malloc(sizeof *out->rms_error * n);
    out->relative_error = malloc(sizeof *out->relative_error * n);
    if (out->channel == NULL || out->rms_error == NULL || out->relative_error == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d channels",
                          l->responses);
    memcpy(out->channel, w->rec.channel, sizeof *out->channel * n);
    for (int i = 0; i < l->responses; i++) {
        out->relative_error[i] = l->energy[i] > 0 ? sqrt(t->rss[i] / l->energy[i]) : NAN;
        out->rms_error[i] = sqrt(2 * t->rss[i] / l->samples) * w->rec.scale[i];
        all += l->energy[i], left += t->rss[i];
    }
    out->total_relative_error = all > 0 ? sqrt(left / all) : NAN;
    return MODAL_OK;
}

/* Evenly over the lines, and closer about each mode, where a phase turns by equal angles. */
static int frequencies(const struct work *w, double *turn)
{
    const struct transfer *t = &w->found.model;
    double low = carg(w->lines.z[0]), high = carg(w->lines.z[w->lines.count - 1]);
    int count = 0;

    for (int k = 0; k < FRF_EVEN; k++)
        turn[count++] = low + (high - low) * k / (FRF_EVEN - 1);
    for (int p = 0; p < t->poles; p++)
        for (int k = -FRF_BESIDE; k <= FRF_BESIDE; k++) {
            double at = cimag(t->s[p])
                + fabs(creal(t->s[p])) * tan(M_PI / 2 * k / (FRF_BESIDE + 1));
            if (cimag(t->s[p]) > 0 && at > low && at < high)
                turn[count++] = at;
        }
    numbers_sort(turn, (size_t)count);
    return count;
}

/* Units of the channels over those of the inputs; as little known as the modes are. */
static void scale_frf(const struct work *w, struct identify_frf *f)
{
    for (int j = 0; j < f->inputs; j++) {
        f->input[j] = w->opt.inputs[j];
        for (int i = 0; i < f->responses; i++)
            for (int k = 0; k < f->count; k++) {
                size_t at = k + (size_t)f->count * (i + (size_t)f->responses * j);
                f->value[at] *= w->rec.scale[i];
                f->std[at] *= w->found.model.converged && !w->clipped && w->hits.input < 0
                                  ? w->rec.scale[i] * w->widest : NAN;
            }
    }
}

static enum modal_status report_frf(struct work *w, struct identify_result *out,
                                    struct modal_error *err)
{
    const struct lines *l = &w->lines;
    double turn[FRF_EVEN + TRANSFER_POLES_MOST * (2 * FRF_BESIDE + 1)];
    struct identify_frf f = { frequencies(w, turn), l->responses, l->inputs, NULL, NULL, NULL,
                              NULL };
    size_t entries = (size_t)f.count * (size_t)f.responses * (size_t)f.inputs;
    enum modal_status rc;

    if (entries > FRF_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "frf", "frequency responses of %d responses "
                                "to %d inputs at %d frequencies are %zu numbers; at most %d: name "
                                "fewer responses by `signals`", f.responses, f.inputs, f.count,
                                entries, FRF_MOST);
    f.input = malloc(sizeof *f.input * (size_t)f.inputs);
    f.hertz = malloc(sizeof *f.hertz * (size_t)f.count);
    f.value = malloc(sizeof *f.value * entries);
    f.std = malloc(sizeof *f.std * entries);
    out->frf = f;
    if (f.input == NULL || f.hertz == NULL || f.value == NULL || f.std == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for frequency responses");
    rc = transfer_frf(l, &w->found.model, turn, f.count, f.value, f.std, err);
    for (int k = 0; k < f.count; k++)
        f.hertz[k] = turn[k] / (2 * M_PI * w->rec.step);
    if (rc == MODAL_OK)
        scale_frf(w, &f);
    return rc;
}

static enum modal_status report_orders(struct work *w, struct identify_result *out,
                                       struct modal_error *err)
{
    const struct forced_search *f = &w->found;
    double step = w->rec.step;
    int poles = 0;

    for (int i = 0; i < f->rungs; i++)
        poles += f->rung[i].poles;
    out->candidates = calloc((size_t)f->rungs + 1, sizeof *out->candidates);
    out->poles = calloc((size_t)poles + 1, sizeof *out->poles);
    if (out->candidates == NULL || out->poles == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d orders", f->rungs);
    for (int i = 0; i < f->rungs; i++) {
        const struct forced_rung *r = &f->rung[i];
        out->candidates[out->candidate_count++] = (struct identify_candidate) {
            2 * r->poles, r->bic, r->residual, true, r->converged, r->poles == f->model.poles };
        for (int p = 0; p < r->poles; p++)
            out->poles[out->pole_count++] = (struct identify_pole) {
                2 * r->poles, r->s[p] / step, r->spread[2 * p] / step, r->spread[2 * p + 1] / step,
                modes_nearest(out, r->s[p] / step) };
    }
    return MODAL_OK;
}

static void report_settings(struct work *w, struct identify_result *out)
{
    const struct lines *l = &w->lines;

    out->input_count = l->inputs;
    out->hankel_rank = 2 * w->found.model.poles;
    out->pod_rank = l->responses;
    out->energy = NAN;
    out->rule = w->opt.rank.rule;
    out->dt = w->rec.step;
    out->decimation = out->shift = 1;
    out->samples = w->rec.Y.m;
    out->freedom = 2 * l->count - 2 * w->found.model.poles - l->direct;
    w->opt.period = 0;
    w->opt.refine = CHOICE_YES;
    out->used = w->opt;
    out->used.channels = out->used.inputs = NULL, out->used.starts = NULL;
    out->used.clock = NULL, out->used.cancelled = NULL, out->used.context = NULL;
}

/* ---- what may be wrong ---- */

static void about_modes(const struct work *w, struct identify_result *r)
{
    double record = longest_record(w);
    int broad = 0, narrow = 0;

    for (int i = 0; i < r->mode_count; i++) {
        const struct identify_mode *m = &r->modes[i];
        double turn = cimag(m->exponent) * w->rec.step / M_PI;
        bool swings = cimag(m->exponent) > 0;
        broad += damping_ratio_of(m->exponent) >= FORCED_NO_PEAK;
        if (swings && m->cycles < FEW_CYCLES)
            identify_diagnose(r, "short_record", -1, "mode %d turns %.2g times in the record: its "
                              "damping, and the standard errors, hold only if the system is "
                              "exactly linear and constant; record longer", i, m->cycles);
        if (swings && isfinite(m->std_re) && narrow < IDENTIFY_TOLD
            && fabs(creal(m->exponent)) < fmin(1 / record, REFINE_CLEAR * m->std_re)) {
            narrow++;
            identify_diagnose(r, "narrow_line", -1, "mode %d (%.5g Hz) does not decay within the "
                              "record beyond its error: a rotating part, the mains or a limit "
                              "cycle that no input moves looks so; record longer, or leave it out "
                              "by `band`", i, cabs(m->exponent) / (2 * M_PI));
        }
        diagnose_near_nyquist(r, i, turn);
    }
    if (broad > 0)
        identify_diagnose(r, "broad_poles", -1, "%d mode%s no peak, damped beyond 70 %%: a motion "
                          "that hardly swings or does not, or a filter of the measuring chain",
                          broad, broad > 1 ? "s show" : " shows");
    if (r->mode_count == 0)
        identify_diagnose(r, "no_modes", -1, "no mode of the responses follows the inputs: they "
                          "excite none, or noise hides it");
}

/* Fewer equations than unknowns: the fit is exact, and nothing can contradict it. */
static bool is_starved(const struct work *w)
{
    const struct lines *l = &w->lines;

    return 2 * l->count * l->responses <= transfer_unknowns(l, w->found.model.poles);
}

/* Modes that were not looked for are in what is left: those near them make up for it, by many
 * times what the noise about them says. */
static bool is_cut_short(const struct work *w)
{
    return w->found.climbing && w->widest > 1;
}

static void about_noise(const struct work *w, struct identify_result *r)
{
    char text[80];

    if (w->hits.input >= 0 && (w->widest == 1 || w->hits.in_colour))
        identify_diagnose(r, "coloured_residual", w->opt.inputs[w->hits.input], "the responses "
                          "tell the %d hits of input %s, %d sample%s at most, harder or softer, "
                          "later or sooner than its samples do: a force that lives between them, "
                          "or one that was not measured; errors are unknown and no verdict is "
                          "given; sample faster, use a softer tip, or identify one hit at a time "
                          "by `window`", w->hits.count,
                          name_of(w->batch, w->opt.inputs[w->hits.input], text),
                          w->hits.longest, w->hits.longest > 1 ? "s" : "");
    else if (w->hits.input >= 0)
        identify_diagnose(r, "coloured_residual", -1, "what the modes leave is not white noise, "
                          "and goes with the hits of input %s, which may be it, or the excitation "
                          "that was not measured: errors are unknown and no verdict is given; "
                          "measure what else moves the structure, or repeat the hits and name "
                          "where records begin by `starts`",
                          name_of(w->batch, w->opt.inputs[w->hits.input], text));
    else if (is_cut_short(w))
        identify_diagnose(r, "coloured_residual", -1, "what the modes leave is not white noise, "
                          "and the search for more had not ended: errors are unknown and no "
                          "verdict is given; give `band` to look at less");
    else if (w->widest > 1)
        identify_diagnose(r, "coloured_residual", -1, "what the modes leave is not white noise: "
                          "standard errors were widened by up to %.2g; an excitation that was not "
                          "measured, noise on the inputs or a nonlinearity looks so", w->widest);
}

static void about_fit(const struct work *w, struct identify_result *r)
{
    if (is_starved(w))
        identify_diagnose(r, "too_many_unknowns", -1, "%d equations for %d unknowns: a small "
                          "reconstruction error proves nothing; record longer, or lower rank.fixed",
                          2 * w->lines.count * w->lines.responses,
                          transfer_unknowns(&w->lines, w->found.model.poles));

    if (w->found.limit)
        identify_diagnose(r, "order_work_limit", -1, "the search for modes ended at %d, for the "
                          "work or the modes that it may take: more may fit better; give `band` to "
                          "look at less%s", w->found.model.poles, w->opt.rank.most > 0 ? ", or "
                          "raise rank.most" : "");
    if (!w->found.model.converged)
        identify_diagnose(r, "not_converged", -1, "the fit to the responses did not converge: "
                          "errors are unknown and no verdict is given; give `band` to look at "
                          "less, or rank.fixed");
    about_noise(w, r);
    if (r->total_relative_error > UNEXPLAINED)
        identify_diagnose(r, "poor_reconstruction", -1, "the inputs leave %.0f %% of the responses "
                          "unexplained: noise, an excitation that was not measured, or a "
                          "nonlinearity", 100 * r->total_relative_error);
    diagnose_still_channels(r);
}

static struct clipping_record own_record(const struct work *w)
{
    return (struct clipping_record) { &w->rec.Y, &w->inputs, { w->row, w->records },
                                      { w->opt.band[0] * w->rec.step,
                                        w->opt.band[1] * w->rec.step } };
}

/* What modes are still in, or nothing is, does not tell hits. */
static enum modal_status find_hits(struct work *w, struct modal_error *err)
{
    struct clipping_record record = own_record(w);

    if (w->found.model.exact || !w->found.model.converged || is_starved(w) || is_cut_short(w))
        return MODAL_OK;
    return hits_find(&record, &w->lines, &w->found.model, &w->hits, err);
}

/* Inputs that were cut off; what they went on by is an excitation that nobody measured. */
static enum modal_status about_inputs(struct work *w, struct identify_result *r,
                                      struct modal_error *err)
{
    const struct forced_search *f = &w->found;
    struct clipping_record record = own_record(w);
    struct forced_limits limits = search_limits(w);
    struct clipping each[IDENTIFY_INPUTS_MOST];
    char text[80];
    enum modal_status rc = f->model.exact ? MODAL_OK
        : clipping_find(&record, f, &limits, each, &w->clipped, err);

    for (int j = 0; j < w->inputs.n && rc == MODAL_OK && w->clipped; j++)
        if (each[j].samples > 0)
            identify_diagnose(r, "clipped", w->opt.inputs[j], "input %s holds its extremes %g and "
                              "%g in %d samples, and the responses are explained better where it "
                              "went on beyond: its peaks are cut off, errors are unknown and no "
                              "verdict is given; measure with less gain, or identify a window "
                              "without them", name_of(w->batch, w->opt.inputs[j], text),
                              each[j].low, each[j].high, each[j].samples);
    return rc;
}

static enum modal_status conclude(struct work *w, struct identify_result *out,
                                  struct modal_error *err)
{
    double record = w->rec.Y.m * w->rec.step;
    enum modal_status rc = verdict_clusters(out, record, err);

    if (rc != MODAL_OK)
        return rc;
    verdict_stability(out, record);
    about_modes(w, out);
    rc = find_hits(w, err);
    about_fit(w, out);
    if (rc == MODAL_OK)
        rc = about_inputs(w, out, err);
    if (screen_rails(w->batch, (size_t)llround(w->rec.t0 / w->batch->dt), (size_t)w->rec.Y.m, out))
        w->clipped = true;
    if (!w->found.model.converged || is_starved(w) || is_cut_short(w) || w->clipped
        || w->hits.input >= 0)
        verdict_withhold(out);
    return rc;
}

enum modal_status forced_identify(const struct batch *batch, const struct identify_options *options,
                                  struct identify_result *out, struct modal_error *err)
{
    struct work w = { .opt = *options, .batch = batch, .widest = 1, .hits.input = -1 };
    enum modal_status rc;

    response_stage(options, &w.clock, NULL, out);
    if ((rc = check(batch, options, err)) == MODAL_OK
        && (rc = read_responses(&w, err)) == MODAL_OK)
        rc = read_starts(&w, err);
    if (rc == MODAL_OK)
        rc = read_inputs(&w, err);
    response_stage(options, &w.clock, "read", out);
    if (rc == MODAL_OK)
        rc = search(&w, err);
    response_stage(options, &w.clock, "refine", out);
    if (rc == MODAL_OK && (rc = report_modes(&w, out, err)) == MODAL_OK
        && (rc = report_responses(&w, out, err)) == MODAL_OK
        && (rc = report_orders(&w, out, err)) == MODAL_OK) {
        report_settings(&w, out);
        rc = conclude(&w, out, err);
    }
    if (rc == MODAL_OK && w.opt.frf)
        rc = report_frf(&w, out, err);
    response_stage(options, &w.clock, "verdict", out);
    forced_search_done(&w.found);
    lines_done(&w.lines);
    record_done(&w.rec);
    free(w.inputs.x);
    return rc;
}
