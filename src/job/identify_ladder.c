/* identify_ladder.c - see identify_ladder.h; tested by tests/unit/job/test_tradeoff_identify.c */
#include "job/identify_ladder.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/*
 * The rungs.  `rows` is a share of the record for each signal; limits of accuracy: a tenth costs a
 * factor 2.3 in variance, a third 1.4, refinement takes any of them to the bound.
 */
static const struct rung {
    const char *method;          /* NULL: the default, refined */
    double rows;                 /* share of the samples; 0: the default */
    double window;               /* share of the record from its start; 0: all */
    double pod;                  /* signals as a multiple of the order; 0: the default, < 0: every
                                    channel */
    bool fixed;                  /* the order is given, not looked for */
    bool band;                   /* decimated to the modes' band */
    bool in_short;
} rungs[] = {
    { NULL,                   0,    0.25, 0, false, false, true  },
    { NULL,                   0,    0.5, 0,  false, false, true  },
    { "partial-floquet",      0.1,  0,   0,  true,  false, false },
    { "partial-floquet",      0,    0.5, 0,  true,  false, false },
    { "partial-floquet",      0,    0,   0,  true,  false, false },
    { "autoregressive",       0.5,  0,   0,  true,  false, false },
    { "partial-floquet",      0,    0,   1,  true,  false, false },
    { "partial-floquet",      0,    0,   0,  true,  true,  false },
    { NULL,                   0.1,  0,   0,  true,  false, false },
    { NULL,                   0,    0,   0,  false, true,  false },
    { NULL,                   0,    0,   1,  false, false, false },
    { NULL,                   0,    0,   0,  true,  false, false },
    { NULL,                   0,    0,   0,  false, false, true  },
    { NULL,                   0,    0,   -1, false, false, false },
};

/* Those of a record whose excitation lasts, measured or not.  All are at their bound: what is
 * traded is how long it is recorded and on how many channels, and what an order that is wrong
 * costs. */
static const struct lasting {
    double window;               /* as above */
    double channels;             /* share of them, as proper orthogonal ones; 0: the default */
    bool fixed;
    int more;                    /* exponents than were found */
} lasting[] = {
    { 0.125, 0, false, 0 }, { 0.25, 0, false, 0 }, { 0.5, 0, false, 0 }, { 0, 0.25, false, 0 },
    { 0, 0.5, false, 0 },   { 0, 0, true, 0 },     { 0, 0, true, 2 },    { 0, 0, false, 0 },
};

enum {
    LASTING_LEAST = 256,         /* samples, or periods, of a part: ambient.h takes no less */
    PART_LEAST = 64,             /* samples of a part of the record, beside six for each exponent */
    CHANNELS_FEW = 8,            /* so many are as quick as their proper orthogonal modes */
    CHANNELS_MANY = 1000         /* more without reduction take longer than all other rungs */
};

static bool is_ruled(const cJSON *asked)
{
    return cJSON_HasObjectItem(asked, "rank.fixed") || cJSON_HasObjectItem(asked, "rank.rule")
        || cJSON_HasObjectItem(asked, "rank.energy") || cJSON_HasObjectItem(asked, "rank");
}

static bool suits_lasting(const struct lasting *r, const struct identify_ladder_facts *f,
                          const cJSON *asked)
{
    double parts = f->period > 0 ? f->period / f->dt : 1;

    if (r->fixed && (f->order == 0 || is_ruled(asked)))
        return false;
    if (r->window > 0 && (cJSON_HasObjectItem(asked, "window")
                          || r->window * (double)f->samples < LASTING_LEAST * parts))
        return false;
    return r->channels == 0
        || (f->response == RESPONSE_AMBIENT && f->period == 0
            && r->channels * (double)f->channels >= 1 && !cJSON_HasObjectItem(asked, "pod")
            && !cJSON_HasObjectItem(asked, "pod.rank")
            && !cJSON_HasObjectItem(asked, "pod.energy"));
}

/* May the rung be made for these data?  Periodic systems have their rows by the period. */
static bool suits(const struct rung *r, const struct identify_ladder_facts *f, const cJSON *asked)
{
    double top = f->highest_hz * 1.3;

    if (r->band
        && (f->period > 0 || f->order == 0 || top <= 0 || 1 / f->dt / (4 * top) < 2
            || cJSON_HasObjectItem(asked, "band")))
        return false;
    if (r->rows > 0 && (f->period > 0 || r->rows * (double)f->samples < 2 * f->order + 8))
        return false;
    if (r->window > 0
        && (cJSON_HasObjectItem(asked, "window")
            || r->window * (double)f->samples < 6 * f->order + PART_LEAST
            || (f->period > 0 && r->window * (double)f->samples * f->dt < 8 * f->period)))
        return false;
    if (r->pod > 0 && (f->channels <= CHANNELS_FEW || f->order == 0))
        return false;
    return !(r->pod < 0 && (f->channels <= CHANNELS_FEW || f->channels > CHANNELS_MANY));
}

static void set(cJSON *o, const char *key, cJSON *value)
{
    cJSON_DeleteItemFromObjectCaseSensitive(o, key);
    cJSON_AddItemToObject(o, key, value);
}

static cJSON *settings_of(const struct rung *r, const struct identify_ladder_facts *f,
                          const cJSON *asked)
{
    cJSON *o = asked != NULL ? cJSON_Duplicate(asked, true) : cJSON_CreateObject();
    const double window[2] = { f->window[0],
                               f->window[0] + r->window * (f->window[1] - f->window[0]) },
                 band[2] = { 0, 1.3 * f->highest_hz };

    cJSON_DeleteItemFromObjectCaseSensitive(o, "target.error");
    cJSON_DeleteItemFromObjectCaseSensitive(o, "target.seconds");
    set(o, "method", cJSON_CreateString(r->method != NULL ? r->method : "auto"));
    if (r->method != NULL)
        set(o, "refine", cJSON_CreateFalse());
    if (r->rows > 0)
        set(o, "rows", cJSON_CreateNumber(ceil(r->rows * (double)f->samples)));
    if (r->window > 0)
        set(o, "window", cJSON_CreateDoubleArray(window, 2));
    if (r->band)
        set(o, "band", cJSON_CreateDoubleArray(band, 2));
    if (r->pod > 0)
        set(o, "pod.rank", cJSON_CreateNumber(fmin(ceil(r->pod * f->order), (double)f->channels)));
    if (r->pod < 0)
        set(o, "signals", cJSON_CreateString("all"));
    if (r->fixed && !is_ruled(o) && f->order > 0)
        set(o, "rank.fixed", cJSON_CreateNumber(f->order));
    return o;
}

static cJSON *settings_of_lasting(const struct lasting *r, const struct identify_ladder_facts *f,
                                  const cJSON *asked)
{
    const struct rung part = { .window = r->window, .fixed = r->fixed };
    cJSON *o = settings_of(&part, f, asked);

    if (r->channels > 0)
        set(o, "pod.rank", cJSON_CreateNumber(floor(r->channels * (double)f->channels)));
    if (r->more > 0)
        set(o, "rank.fixed", cJSON_CreateNumber(f->order + r->more));
    return o;
}

int identify_ladder_rungs(const cJSON *asked, const struct identify_ladder_facts *facts,
                          bool short_one, cJSON *settings[IDENTIFY_RUNGS_MOST])
{
    int count = 0;

    if (facts->response != RESPONSE_FREE) {
        for (size_t i = 0; i < sizeof lasting / sizeof *lasting; i++)
            if (suits_lasting(&lasting[i], facts, asked))
                settings[count++] = settings_of_lasting(&lasting[i], facts, asked);
        return count;
    }
    for (size_t i = 0; i < sizeof rungs / sizeof *rungs; i++)
        if ((short_one ? rungs[i].in_short : true) && suits(&rungs[i], facts, asked))
            settings[count++] = settings_of(&rungs[i], facts, asked);
    return count;
}

double identify_error(const struct identify_result *r)
{
    double worst = NAN;

    for (int i = 0; i < r->mode_count; i++) {
        const struct identify_mode *m = &r->modes[i];
        double size = cabs(m->exponent), span = r->period > 0        ? r->period
                                                : r->used.stride > 0 ? r->dt * r->used.stride
                                                                     : r->dt;
        double error = isfinite(m->std_re) ? hypot(m->std_re, m->std_im)
                                           : m->bar / fmax(cabs(m->multiplier), 1e-300) / span;
        if (size > 0 && isfinite(error) && !(error / size <= worst))
            worst = error / size;
    }
    return worst;
}

double identify_distance(const struct identify_result *r, const double complex *truth, int count,
                         int *unmatched)
{
    bool *taken = calloc((size_t)r->mode_count + 1, sizeof *taken),
         *matched = calloc((size_t)count + 1, sizeof *matched);
    double worst = 0;

    *unmatched = count;
    for (int n = 0; taken != NULL && matched != NULL && n < count && n < r->mode_count; n++) {
        double least = HUGE_VAL;
        int a = -1, b = -1;
        for (int j = 0; j < count; j++)
            for (int i = 0; i < r->mode_count; i++) {
                double d = cabs(r->modes[i].exponent - truth[j]);
                if (!matched[j] && !taken[i] && d < least)
                    least = d, a = j, b = i;
            }
        if (a < 0)
            break;
        double scale = fmax(cabs(truth[a]), 1e-300);
        matched[a] = taken[b] = true;
        *unmatched -= least < scale;
        worst = fmax(worst, fmin(least / scale, 1));
    }
    free(taken), free(matched);
    return *unmatched > 0 ? 1 : worst;
}

static double cpu(void *context)
{
    (void)context;
    return (double)clock() / CLOCKS_PER_SEC;
}

static bool stopped(void *context)
{
    return job_cancelled(context);
}

enum modal_status identify_answer(const struct job_request *request,
                                  const struct identify_settings *settings,
                                  struct identify_result *out, struct modal_error *err)
{
    struct identify_options opt = settings->opt;

    openblas_set_num_threads(settings->threads);
    opt.clock = cpu, opt.cancelled = stopped, opt.context = (void *)request;
    return modal_identify(request->batch, &opt, out, err);
}

enum modal_status identify_ladder_answer(const struct job_request *request, const cJSON *rung,
                                         struct identify_result *out, struct modal_error *err)
{
    struct identify_settings settings;
    enum modal_status rc = identify_options_read(rung, request->batch, &settings, err);

    if (rc != MODAL_OK)
        return rc;
    rc = identify_answer(request, &settings, out, err);
    identify_settings_done(&settings);
    return rc;
}
