/* tradeoff_identify.c - see tradeoff_identify.h */
#include "job/tradeoff_identify.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "job/blas_core.h"
#include "job/cost.h"
#include "job/identify_job.h"
#include "job/identify_ladder.h"
#include "job/tradeoff_print.h"
#include "modal/identify/linear/exponents.h"

/* Exponents of a truth: twice the highest order that identify looks for, and some. */
enum { TRUTH_MOST = 1000 };
static const double DEAR = 2;     /* s: a reference that takes so long is not repeated unless
                                     asked */

struct tradeoff_work {
    const struct job_request *request;
    cJSON *asked;                               /* identify's options */
    int response;
    int repetitions;
    double target_seconds;
    double complex *truth; int truth_count;
    bool given;                                 /* the truth was given; else it is the
                                                   reference's */
    double bound;
    cJSON *settings[IDENTIFY_RUNGS_MOST];
    double algorithm[IDENTIFY_RUNGS_MOST];
    double own[IDENTIFY_RUNGS_MOST];            /* of each rung: as bound */
    int unmatched[IDENTIFY_RUNGS_MOST];
    int count;
};

static void work_done(struct tradeoff_work *w)
{
    cJSON_Delete(w->asked);
    free(w->truth);
    for (int i = 0; i < w->count; i++)
        cJSON_Delete(w->settings[i]);
}

#define AT(member) .at = offsetof(struct tradeoff_work, member)

/* Beside identify's. */
const struct key_row tradeoff_identify_rows[] = {
    { "of", KEY_OWN, .form = "identify", .meaning = "what is traded off", .example = "identify" },
    { "repetitions", KEY_WHOLE, AT(repetitions), .low = 1, .high = LADDER_REPETITIONS_MOST,
      .meaning = "of each rung, whose time is their median; default: 3 where the reference is "
      "quick", .example = "5" },
    { "target.error", KEY_OWN, .form = "X",
      .meaning = "of no effect: every rung that suits the data is climbed", .example = "1e-3" },
    { "target.seconds", KEY_NUMBER, AT(target_seconds), .low = 1e-300, .high = 1e300, .unit = "s",
      .form = "S", .meaning = "climb no longer than this", .example = "10" },
    { "truth", KEY_OWN, .unit = "1/s", .form = "[[RE,IM],...]",
      .meaning = "the exponents that errors are against; default: the best rung's",
      .example = "[[-0.1,6.2]]" },
    { 0 },
};

/* The options that are the tradeoff's own, taken out of what identify gets. */
static enum modal_status read_options(struct tradeoff_work *w, struct modal_error *err)
{
    const cJSON *o = w->request->options;
    enum modal_status rc;

    w->asked = o != NULL ? cJSON_Duplicate(o, true) : cJSON_CreateObject();
    if (w->asked == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "tradeoff: no memory for the options");
    for (const struct key_row *own = tradeoff_identify_rows; own->name != NULL; own++)
        cJSON_DeleteItemFromObjectCaseSensitive(w->asked, own->name);
    rc = json_get_choice(o, "", "response", identify_response_names, &w->response, err);
    return rc == MODAL_OK ? key_table_read(tradeoff_identify_rows, o, "", w, err) : rc;
}

static bool is_pair(const cJSON *item)
{
    return cJSON_IsArray(item) && cJSON_GetArraySize(item) == 2
           && cJSON_IsNumber(cJSON_GetArrayItem(item, 0))
           && cJSON_IsNumber(cJSON_GetArrayItem(item, 1));
}

/* One exponent of a pair: Im >= 0. */
static double complex upper(double re, double im)
{
    return CMPLX(re, fabs(im));
}

static enum modal_status truth_from_option(struct tradeoff_work *w, const cJSON *list,
                                           struct modal_error *err)
{
    const cJSON *item;
    int n = cJSON_GetArraySize(list);

    if (!cJSON_IsArray(list) || n < 1 || n > TRUTH_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "truth",
                                "truth: accepted: a list of 1 to %d exponents [re, im] in 1/s",
                                TRUTH_MOST);
    w->truth = malloc(sizeof *w->truth * (size_t)n);
    if (w->truth == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "tradeoff: no memory for %d exponents", n);
    cJSON_ArrayForEach(item, list) {
        if (!is_pair(item))
            return modal_fail_field(err, MODAL_BAD_INPUT, "truth",
                                    "truth: entry %d is not a pair of numbers [re, im]",
                                    w->truth_count);
        w->truth[w->truth_count++] = upper(cJSON_GetArrayItem(item, 0)->valuedouble,
                                           cJSON_GetArrayItem(item, 1)->valuedouble);
    }
    w->given = true;
    return MODAL_OK;
}

/* {"modes":[{"lambda_re","lambda_im"},...]}, as text or object; anything else is not a truth, and
 * no error. */
static void truth_from_attribute(struct tradeoff_work *w)
{
    const cJSON *truth = cJSON_GetObjectItemCaseSensitive(w->request->attributes, "truth"), *modes,
                *item;
    cJSON *own = NULL;

    if (cJSON_IsString(truth)
        && json_read(truth->valuestring, strlen(truth->valuestring), &own, NULL) == MODAL_OK)
        truth = own;
    modes = cJSON_GetObjectItemCaseSensitive(truth, "modes");
    if (cJSON_IsArray(modes) && cJSON_GetArraySize(modes) >= 1
        && cJSON_GetArraySize(modes) <= TRUTH_MOST)
        w->truth = malloc(sizeof *w->truth * (size_t)cJSON_GetArraySize(modes));
    cJSON_ArrayForEach(item, modes) {
        const cJSON *re = cJSON_GetObjectItemCaseSensitive(item, "lambda_re"),
                    *im = cJSON_GetObjectItemCaseSensitive(item, "lambda_im");
        if (w->truth != NULL && cJSON_IsNumber(re) && cJSON_IsNumber(im)
            && (re->valuedouble != 0 || im->valuedouble != 0))
            w->truth[w->truth_count++] = upper(re->valuedouble, im->valuedouble);
    }
    w->given = w->truth_count > 0;
    cJSON_Delete(own);
}

static enum modal_status set_reference(struct tradeoff_work *w, const struct identify_result *r,
                                       struct modal_error *err)
{
    w->bound = identify_error(r);
    if (w->given)
        return MODAL_OK;
    if (r->mode_count < 1)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "signals",
            "no mode was found in these signals: there is nothing to compare settings by");
    free(w->truth);
    w->truth = malloc(sizeof *w->truth * (size_t)r->mode_count);
    if (w->truth == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "tradeoff: no memory for %d exponents",
                          r->mode_count);
    for (int i = 0; i < r->mode_count; i++)
        w->truth[i] = r->modes[i].exponent;
    w->truth_count = r->mode_count;
    return MODAL_OK;
}

static struct identify_ladder_facts facts_of(const struct tradeoff_work *w,
                                             const struct identify_result *r)
{
    const struct batch *b = w->request->batch;
    struct identify_ladder_facts f = { w->response,
                                       (size_t)r->samples * (size_t)r->decimation,
                                       (size_t)r->channel_count,
                                       b->dt,
                                       r->period,
                                       r->hankel_rank,
                                       0,
                                       { 0, (double)(b->samples - 1) * b->dt } };

    for (int i = 0; i < r->mode_count; i++)
        f.highest_hz = fmax(f.highest_hz, frequency_of(r->modes[i].exponent) / (2 * M_PI));
    return f;
}

static enum modal_status climb(void *context, int i, double *error, struct modal_error *err)
{
    struct tradeoff_work *w = context;
    struct identify_result r;
    enum modal_status rc = identify_ladder_answer(w->request, w->settings[i], &r, err);

    if (rc == MODAL_BAD_INPUT || rc == MODAL_TOO_LARGE)
        /* these settings do not fit these data: a rung without an answer */
        return MODAL_NO_CONVERGENCE;
    if (rc != MODAL_OK)
        return rc;
    w->own[i] = identify_error(&r);
    w->algorithm[i] = identify_distance(&r, w->truth, w->truth_count, &w->unmatched[i]);
    *error = w->given || !isfinite(w->bound) ? w->algorithm[i] : hypot(w->algorithm[i], w->bound);
    identify_result_done(&r);
    return MODAL_OK;
}

static void begins(void *context, int i)
{
    const struct tradeoff_work *w = context;

    tradeoff_report(w->request, i, w->count);
}

static bool stopped(void *context)
{
    return job_cancelled(((struct tradeoff_work *)context)->request);
}

/* Quickest first, as a reader climbs it. */
static void sort_rungs(struct tradeoff_work *w, struct ladder_rung *rungs, int *recommended)
{
    for (int i = 1; i < w->count; i++)
        for (int j = i; j > 0 && rungs[j].ran
                        && (!rungs[j - 1].ran || rungs[j].seconds < rungs[j - 1].seconds);
             j--) {
            struct ladder_rung r = rungs[j];
            cJSON *s = w->settings[j];
            double a = w->algorithm[j], own = w->own[j];
            int u = w->unmatched[j];
            rungs[j] = rungs[j - 1], w->settings[j] = w->settings[j - 1],
            w->algorithm[j] = w->algorithm[j - 1], w->own[j] = w->own[j - 1],
            w->unmatched[j] = w->unmatched[j - 1];
            rungs[j - 1] = r, w->settings[j - 1] = s, w->algorithm[j - 1] = a,
                      w->own[j - 1] = own, w->unmatched[j - 1] = u;
            *recommended = *recommended == j ? j - 1 : *recommended == j - 1 ? j : *recommended;
        }
}

static cJSON *exponents_of(const struct tradeoff_work *w)
{
    cJSON *list = cJSON_CreateArray();

    for (int i = 0; i < w->truth_count; i++)
        cJSON_AddItemToArray(list, json_complex(creal(w->truth[i]), cimag(w->truth[i])));
    return list;
}

static cJSON *reference_of(const struct tradeoff_work *w)
{
    cJSON *o = cJSON_CreateObject();

    cJSON_AddStringToObject(o, "by", w->given ? "truth" : "settings");
    if (!w->given)
        cJSON_AddItemToObject(o, "settings", cJSON_Duplicate(w->asked, true));
    cJSON_AddItemToObject(o, "exponents", exponents_of(w));
    return o;
}

/* Beside the common document: the bound, what each rung's error is made of, where it was
 * computed. */
static void add_own(const struct tradeoff_work *w, const struct ladder_rung *rungs,
                    struct cost *cost, cJSON *doc)
{
    cJSON *list = cJSON_GetObjectItemCaseSensitive(doc, "rungs"),
          *provenance = cJSON_CreateObject();

    json_set_number(doc, "bound", w->bound);
    if (w->response != RESPONSE_FREE)
        json_set_number(doc, "bound_at_2x", w->bound * M_SQRT1_2);
    for (int i = 0; i < w->count; i++) {
        cJSON *rung = cJSON_GetArrayItem(list, i);
        bool answered = rungs[i].ran && isfinite(rungs[i].error);
        json_set_number(rung, "algorithm_error", answered ? w->algorithm[i] : NAN);
        json_set_number(rung, "bound", answered ? w->own[i] : NAN);
        cJSON_AddNumberToObject(rung, "unmatched",
                                answered ? w->unmatched[i] : w->truth_count);
    }
    cJSON_AddNumberToObject(doc, "repetitions", w->repetitions);
    cost_stage(cost, "climb");
    cJSON_AddItemToObject(doc, "cost", cost_print(cost));
    cJSON_AddStringToObject(provenance, "version", MODALD_VERSION);
    cJSON_AddItemToObject(provenance, "options",
                          w->request->options != NULL ? cJSON_Duplicate(w->request->options, true)
                                                      : cJSON_CreateObject());
    if (w->request->input_sha256 != NULL)
        cJSON_AddStringToObject(provenance, "input_sha256", w->request->input_sha256);
    cJSON_AddStringToObject(provenance, "blas_core", blas_core_name());
    cJSON_AddItemToObject(doc, "provenance", provenance);
}

enum modal_status tradeoff_identify(const struct job_request *request, struct job_result *out,
                                    struct modal_error *err)
{
    struct tradeoff_work w = { .request = request };
    struct identify_result reference = { 0 };
    struct ladder_rung rungs[IDENTIFY_RUNGS_MOST];
    struct ladder_outcome outcome;
    struct ladder ladder = { .climb = climb, .clock = tradeoff_clock, .cancelled = stopped,
                             .begins = begins, .context = &w };
    const cJSON *truth = cJSON_GetObjectItemCaseSensitive(request->options, "truth");
    double start = tradeoff_clock(NULL);
    struct cost cost;
    enum modal_status rc = read_options(&w, err);

    cost_start(&cost);

    if (rc == MODAL_OK && truth != NULL)
        rc = truth_from_option(&w, truth, err);
    else if (rc == MODAL_OK)
        truth_from_attribute(&w);
    if (rc == MODAL_OK)
        rc = identify_ladder_answer(request, w.asked, &reference, err);
    if (rc == MODAL_OK)
        rc = set_reference(&w, &reference, err);
    if (rc != MODAL_OK)
        goto out;
    cost_stage(&cost, "reference");
    if (w.repetitions == 0)
        w.repetitions = tradeoff_clock(NULL) - start > DEAR ? 1 : 3;
    struct identify_ladder_facts facts = facts_of(&w, &reference);
    w.count = identify_ladder_rungs(w.asked, &facts, false, w.settings);
    ladder.rungs = w.count, ladder.repetitions = w.repetitions,
    ladder.target_seconds = w.target_seconds;
    /* a rung within 1.5 of the bound is as good as the data */
    ladder.floor = isfinite(w.bound) ? 1.5 * w.bound : 0;
    rc = ladder_run(&ladder, rungs, &outcome, err);
    if (rc != MODAL_OK)
        goto out;
    sort_rungs(&w, rungs, &outcome.recommended);
    rc = tradeoff_print("identify", reference_of(&w), w.settings, rungs, w.count,
                        outcome.recommended, &out->result, err);
    if (rc == MODAL_OK)
        add_own(&w, rungs, &cost, out->result);
out:
    identify_result_done(&reference);
    work_done(&w);
    return rc;
}
