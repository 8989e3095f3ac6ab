/* tradeoff_simulate.c - see tradeoff_simulate.h; tested by tests/unit/job/test_scene_jobs.c */
#include "job/tradeoff_simulate.h"
#include <math.h>
#include <string.h>
#include "job/cost.h"
#include "job/kind_run.h"
#include "job/scene_jobs.h"
#include "job/scene_mesh.h"
#include "job/tradeoff_print.h"
#include "modal/numbers.h"

enum {
    EFFECTS_SHOWN = 24,              /* left out one by one: a picture of more is unreadable */
    SUBSTEPS_LAST = 1024,            /* of rk4: its error is rounding long before */
    RUNGS_MOST = 64                  /* 5 tolerances, the effects, 4 models, 6 of rk4, and room */
};

struct work {
    const struct job_request *request;
    struct job_result reference;
    cJSON *settings[RUNGS_MOST];
    int count;
};

static void add_rung(struct work *w, const char *integrator, double tolerance, int substeps,
                     int without)
{
    cJSON *s = cJSON_CreateObject();

    cJSON_AddStringToObject(s, "integrator", integrator);
    if (tolerance > 0)
        json_set_number(s, "tolerance", tolerance);
    if (substeps > 0)
        cJSON_AddNumberToObject(s, "substeps", substeps);
    if (without >= 0)
        cJSON_AddItemToObject(s, "without", json_numbers((double[]) { without }, 1));
    w->settings[w->count++] = s;
}

/* One setting more on the last rung. */
static void set_last(struct work *w, const char *key, int value)
{
    cJSON_AddNumberToObject(w->settings[w->count - 1], key, value);
}

/* Half as many elements and twice as many, where the scene has a mesh whose places they keep:
 * the finer one shows what the scene's own mesh leaves out. */
static void add_meshes(struct work *w, double tolerance)
{
    const cJSON *stated = cJSON_GetObjectItemCaseSensitive(
        cJSON_GetObjectItemCaseSensitive(w->request->scene, "structure"), "elements");
    int own = cJSON_IsNumber(stated) ? (int)stated->valuedouble : 0;

    for (int i = 0; i < 2; i++) {
        int elements = i == 0 ? own / 2 : 2 * own;
        cJSON *copy = cJSON_Duplicate(w->request->scene, 1);
        if (elements > 0 && copy != NULL && scene_mesh(copy, NULL, elements, NULL) == MODAL_OK) {
            add_rung(w, "auto", tolerance, 0, -1);
            set_last(w, "elements", elements);
        }
        cJSON_Delete(copy);
    }
}

static void add_inflows(struct work *w, double tolerance)
{
    for (int step = -1; step <= 1; step += 2) {
        int states = scene_inflow_beside(w->request->scene, step);
        if (states == 0)
            continue;
        add_rung(w, "auto", tolerance, 0, -1);
        set_last(w, "inflow_states", states);
    }
}

/* Exact steppers of linear scenes know no tolerance: one rung. */
static void make_rungs(struct work *w, bool linear_constant)
{
    static const double tolerance[] = { 1e-4, 1e-6, 1e-8, 1e-10, 1e-12 };
    const cJSON *effects = cJSON_GetObjectItemCaseSensitive(w->request->scene, "effects");
    int listed = cJSON_GetArraySize(effects);

    for (int i = linear_constant ? 4 : 0; i < 5; i++)
        add_rung(w, "auto", tolerance[i], 0, -1);
    for (int i = 0; i < listed && i < EFFECTS_SHOWN; i++)
        add_rung(w, "auto", linear_constant ? 1e-12 : 1e-10, 0, i);
    add_meshes(w, linear_constant ? 1e-12 : 1e-10);
    add_inflows(w, linear_constant ? 1e-12 : 1e-10);
    for (int n = 1; n <= SUBSTEPS_LAST; n *= 4)
        add_rung(w, "rk4", 0, n, -1);
}

static enum modal_status run(const struct work *w, const cJSON *options, struct job_result *out,
                             struct modal_error *err)
{
    struct job_request inner = { .kind = "simulate", .options = options, .scene = w->request->scene,
                                 .arrays = w->request->arrays,
                                 .cancelled = w->request->cancelled,
                                 .context = w->request->context };

    return kind_run(simulate_run, &inner, out, err);
}

/* max |x - ref| / max |ref| of the worst channel; a channel whose reference is 0 throughout counts
 * against the largest one. */
static double error_of(const struct batch *x, const struct batch *reference)
{
    size_t values = reference->samples * reference->channels;
    double worst = 0, scale = numbers_largest(reference->signals, values);

    for (size_t c = 0; c < reference->channels; c++) {
        double most = 0, off = 0;
        for (size_t k = c; k < values; k += reference->channels) {
            most = fmax(most, fabs(reference->signals[k]));
            off = fmax(off, fabs(x->signals[k] - reference->signals[k]));
        }
        worst = fmax(worst, off / (most > 0 ? most : scale > 0 ? scale : 1));
    }
    return worst;
}

/* A rung that overflows (too long an explicit step) or has no scene without its effect has no
 * answer; the climb goes on. */
static enum modal_status climb(void *context, int i, double *error, struct modal_error *err)
{
    struct work *w = context;
    struct job_result r;
    enum modal_status rc = run(w, w->settings[i], &r, err);

    if (rc == MODAL_OVERFLOW || rc == MODAL_BAD_INPUT)
        return MODAL_NO_CONVERGENCE;
    if (rc != MODAL_OK)
        return rc;
    *error = error_of(&r.batch, &w->reference.batch);
    job_result_done(&r);
    return MODAL_OK;
}

static void begins(void *context, int i)
{
    const struct work *w = context;

    tradeoff_report(w->request, i, w->count);
}

static bool cancelled(void *context)
{
    const struct work *w = context;

    return job_cancelled(w->request);
}

struct wishes { double target_error, target_seconds; int repetitions, threads; };

#define AT(member) .at = offsetof(struct wishes, member)

const struct key_row tradeoff_simulate_rows[] = {
    { "of", KEY_OWN, .form = "simulate", .meaning = "what is traded off", .example = "simulate" },
    { "repetitions", KEY_WHOLE, AT(repetitions), .low = 1, .high = LADDER_REPETITIONS_MOST,
      .initial = "1", .meaning = "of each rung, whose time is their median", .example = "5" },
    { "target.error", KEY_NUMBER, AT(target_error), .low = 0, .high = 1e300, .initial = "0",
      .meaning = "stop at the first rung below it; 0: never", .example = "1e-6" },
    { "target.seconds", KEY_NUMBER, AT(target_seconds), .low = 0, .high = 1e300, .initial = "0",
      .unit = "s", .form = "S", .meaning = "climb no longer than this; 0: to the end",
      .example = "10" },
    { "threads", KEY_WHOLE, KEY_SILENT, AT(threads), .low = 1, .high = JOB_THREADS_MOST,
      .initial = "1", .meaning = "that the job is counted for", .example = "2" },
    { 0 },
};

static enum modal_status run_reference(struct work *w, cJSON **settings, struct modal_error *err)
{
    *settings = cJSON_CreateObject();
    cJSON_AddStringToObject(*settings, "integrator", "auto");
    json_set_number(*settings, "tolerance", 1e-13);
    return run(w, *settings, &w->reference, err);
}

enum modal_status tradeoff_simulate(const struct job_request *request, struct job_result *out,
                                    struct modal_error *err)
{
    struct work w = { .request = request };
    struct ladder ladder = { .climb = climb, .clock = tradeoff_clock, .cancelled = cancelled,
                             .begins = begins, .context = &w };
    struct ladder_rung rungs[RUNGS_MOST];
    struct ladder_outcome outcome;
    struct cost cost;
    cJSON *reference = NULL, *plan;
    const cJSON *class;
    struct wishes wishes = { 0 };
    enum modal_status rc = key_table_options(tradeoff_simulate_rows, request->options, &wishes,
                                             err);

    ladder.repetitions = wishes.repetitions;
    ladder.target_error = wishes.target_error;
    ladder.target_seconds = wishes.target_seconds;
    cost_start(&cost);
    if (rc == MODAL_OK)
        rc = run_reference(&w, &reference, err);
    cost_stage(&cost, "reference");
    if (rc == MODAL_OK) {
        plan = cJSON_GetObjectItemCaseSensitive(w.reference.result, "plan");
        class = cJSON_GetObjectItemCaseSensitive(plan, "class");
        make_rungs(&w, cJSON_IsString(class) && strcmp(class->valuestring, "linear-constant") == 0);
        ladder.rungs = w.count;
        rc = ladder_run(&ladder, rungs, &outcome, err);
        cost_stage(&cost, "rungs");
    }
    if (rc == MODAL_OK) {
        rc = tradeoff_print("simulate", reference, w.settings, rungs, w.count, outcome.recommended,
                            &out->result, err);
        reference = NULL;
    }
    if (rc == MODAL_OK) {
        cJSON_AddItemToObject(out->result, "plan",
                              cJSON_DetachItemFromObjectCaseSensitive(w.reference.result, "plan"));
        cJSON_AddItemToObject(out->result, "cost", cost_print(&cost));
        cJSON_AddItemToObject(out->result, "provenance",
                              provenance_print(request, cJSON_Duplicate(request->options, 1)));
    }
    for (int i = 0; i < w.count; i++)
        cJSON_Delete(w.settings[i]);
    cJSON_Delete(reference);
    job_result_done(&w.reference);
    return rc;
}
