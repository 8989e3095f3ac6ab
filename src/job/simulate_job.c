/* simulate_job.c - kind `simulate`: a scene's motion as a batch;
 * tested by tests/unit/job/test_scene_jobs.c */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "job/cost.h"
#include "job/plan.h"
#include "job/scene_mesh.h"
#include "job/scene_jobs.h"
#include "modal/scene/scene.h"
#include "modal/scene/simulate.h"

/* What a job is to do: the steppers' options, the scene's changes. */
struct settings {
    struct simulate_options opt;
    struct scene_options scene;                     /* effects left out */
    int integrator, threads;
    int elements, inflow_states;                    /* in place of the scene's own; 0: as it says */
};

/* Of substeps, elements, states: beyond what a record or a mesh is made of. */
enum { COUNT_MOST = 1000000 };
static const char *const integrators[] = { "auto", "rk4", NULL };

#define AT(member) .at = offsetof(struct settings, member)

const struct key_row simulate_option_rows[] = {
    { "integrator", KEY_CHOICE, AT(integrator), .words = integrators, .initial = "auto",
      .meaning = "auto: exact exponentials and maps where the scene is linear", .example = "rk4" },
    { "tolerance", KEY_NUMBER, AT(opt.tolerance), .low = 1e-14, .high = 1,
      .meaning = "of a step of the adaptive parts, relative", .example = "1e-9" },
    { "substeps", KEY_WHOLE, AT(opt.substeps), .low = 1, .high = COUNT_MOST, .initial = "1",
      .meaning = "of rk4 in one sample", .example = "4" },
    { "without", KEY_OWN, .low = 0, .high = SCENE_EFFECTS_MOST - 1, .form = "I,J",
      .meaning = "leave these effects of the scene out, counted from 0", .example = "0,2" },
    { "elements", KEY_WHOLE, KEY_SHOWN_IF_SET, AT(elements), .low = 1, .high = COUNT_MOST,
      .meaning = "another mesh, with the same places and channels", .example = "8" },
    { "inflow_states", KEY_WHOLE, KEY_SHOWN_IF_SET, AT(inflow_states), .low = 1, .high = COUNT_MOST,
      .meaning = "of the airloads, in place of the scene's", .example = "6" },
    { "threads", KEY_WHOLE, KEY_SILENT, AT(threads), .low = 1, .high = JOB_THREADS_MOST,
      .initial = "1", .meaning = "that the job is counted for", .example = "2" },
    { 0 },
};

/* The scene on another mesh or inflow, into *CHANGED, which the caller deletes; NULL where nothing
 * is asked for. */
static enum modal_status change_model(const cJSON *scene, const struct settings *m, cJSON **changed,
                                      struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (m->elements == 0 && m->inflow_states == 0)
        return MODAL_OK;
    if ((*changed = cJSON_Duplicate(scene, 1)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "simulate: out of memory");
    if (m->elements > 0)
        rc = scene_mesh(*changed, m->scene.arrays, m->elements, err);
    return rc == MODAL_OK && m->inflow_states > 0 ? scene_inflow(*changed, m->inflow_states, err)
                                                  : rc;
}

/* `without`: one effect's number or a list of them, each of EFFECTS in the scene ("-o without=0" is
 * a number, "-o without=0,2" a list). */
static enum modal_status read_without(const cJSON *json, int effects, struct scene_options *without,
                                      struct modal_error *err)
{
    bool one = cJSON_IsNumber(cJSON_GetObjectItemCaseSensitive(json, "without"));
    double *list = NULL, single = NAN;
    size_t count = 1;
    enum modal_status rc = one ? json_get_number(json, "", "without", 0, SCENE_EFFECTS_MOST - 1,
                                                 &single, err)
                               : json_get_numbers(json, "", "without", 0, SCENE_EFFECTS_MOST - 1,
                                                  &list, &count, err);

    for (size_t i = 0; i < count && rc == MODAL_OK; i++) {
        double k = one ? single : list[i];
        if (k != floor(k) || k >= effects)
            rc = modal_fail_field(
                err, MODAL_BAD_INPUT, "without",
                "without lists the numbers of effects, from 0; the scene has %d, and no number %g",
                effects, k);
        else
            without->without[(int)k] = true;
    }
    free(list);
    return rc;
}

static cJSON *print_options(const struct settings *s)
{
    cJSON *json = cJSON_CreateObject(), *without = cJSON_CreateArray();

    for (int i = 0; i < SCENE_EFFECTS_MOST; i++)
        if (s->scene.without[i])
            cJSON_AddItemToArray(without, cJSON_CreateNumber(i));
    key_table_write(simulate_option_rows, s, json);
    cJSON_AddItemToObject(json, "without", without);
    return json;
}

static void report(void *context, double fraction)
{
    const struct job_request *request = context;
    cJSON *event = cJSON_CreateObject();

    json_set_number(event, "fraction", fraction);
    request->progress(request->context, event);
    cJSON_Delete(event);
}

static bool asked_to_stop(void *context)
{
    const struct job_request *request = context;

    return request->cancelled(request->context);
}

/* A term of an output of this kind or a higher one is seen from other axes: program.h. */
enum { TURNING = 4 };

/* Does a channel look from other axes than the motion's, turning against it? */
static bool turns(const struct program *p)
{
    for (int i = 0; i < p->outputs; i++)
        for (int t = 0; t < p->output[i].count; t++)
            if (p->output[i].terms[t].i >= TURNING)
                return p->frame_speed > 0;
    return false;
}

/* The batch's period: the scene's; or that of what pulsates or turns, where the record holds two of
 * it. */
static double period_of(const struct program *p, const struct scene_time *t)
{
    bool pulsates = p->harmonics > 0 || p->laws > 0 || turns(p);
    double period = p->period > 0 ? p->period : pulsates && p->omega > 0 ? 2 * M_PI / p->omega : 0;

    return 2 * period <= t->duration ? period : 0;
}

/* Room for the signals and their names, owned by OUT. */
static enum modal_status make_batch(const struct program *p, const struct scene_time *t,
                                    struct job_result *out, struct modal_error *err)
{
    size_t channels = (size_t)p->outputs, samples = (size_t)t->samples;

    if ((double)samples * (double)channels > SIMULATE_VALUES_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "time",
                                "%zu samples of %zu channels are more than %d numbers", samples,
                                channels, SIMULATE_VALUES_MOST);
    out->signals = malloc(samples * channels * sizeof *out->signals + 1);
    out->names = calloc(channels + 1, sizeof *out->names);
    out->batch.channels = out->names != NULL ? channels : 0;
    if (out->signals == NULL || out->names == NULL)
        return modal_fail(err, MODAL_NO_MEMORY,
                          "simulate: no memory for %zu samples of %zu channels", samples, channels);
    for (size_t i = 0; i < channels; i++)
        if ((out->names[i] = strdup(p->output[i].name)) == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "simulate: out of memory");
    out->batch.samples = samples;
    out->batch.signals = out->signals;
    out->batch.dt = t->dt;
    out->batch.period = period_of(p, t);
    out->batch.names = (const char *const *)out->names;
    return MODAL_OK;
}

static cJSON *print_result(const struct program *p, const struct scene_time *t,
                           const struct simulate_result *s, const struct batch *b)
{
    cJSON *r = cJSON_CreateObject(), *list, *work;

    cJSON_AddStringToObject(r, "kind", "simulate");
    cJSON_AddNumberToObject(r, "samples", (double)t->samples);
    json_set_number(r, "dt", t->dt);
    json_set_number(r, "start", t->start);
    json_set_number(r, "duration", t->duration);
    if (b->period > 0)
        json_set_number(r, "period", b->period);
    list = cJSON_AddArrayToObject(r, "channels");
    for (int i = 0; i < p->outputs; i++)
        cJSON_AddItemToArray(list, cJSON_CreateString(p->output[i].name));
    work = cJSON_AddObjectToObject(r, "work");
    cJSON_AddNumberToObject(work, "products", (double)s->products);
    cJSON_AddNumberToObject(work, "exponentials", (double)s->maps);
    cJSON_AddNumberToObject(work, "steps", (double)s->steps);
    cJSON_AddNumberToObject(work, "rejected", (double)s->rejected);
    cJSON_AddItemToObject(r, "plan", plan_print(p, s->integrator));
    return r;
}

enum modal_status simulate_run(const struct job_request *request, struct job_result *out,
                               struct modal_error *err)
{
    struct settings settings = { 0 };
    struct simulate_result s = { 0 };
    struct scene_time t;
    struct program *p = NULL;
    struct cost cost;
    cJSON *changed = NULL;
    int effects = cJSON_GetArraySize(cJSON_GetObjectItemCaseSensitive(request->scene, "effects"));
    enum modal_status rc = key_table_options(simulate_option_rows, request->options, &settings,
                                             err);

    cost_start(&cost);
    if (rc == MODAL_OK)
        rc = read_without(request->options, effects, &settings.scene, err);
    settings.scene.arrays = request->arrays;
    settings.opt.rk4 = settings.integrator == 1;
    settings.opt.progress = request->progress != NULL ? report : NULL;
    settings.opt.cancelled = request->cancelled != NULL ? asked_to_stop : NULL;
    settings.opt.context = (void *)request;
    if (rc == MODAL_OK)
        rc = change_model(request->scene, &settings, &changed, err);
    if (rc == MODAL_OK)
        rc = scene_lower(changed != NULL ? changed : request->scene, &settings.scene, &p, err);
    if (rc == MODAL_OK)
        rc = scene_time(request->scene, p, &t, err);
    cost_stage(&cost, "lower");
    if (rc == MODAL_OK)
        rc = make_batch(p, &t, out, err);
    if (rc == MODAL_OK)
        rc = simulate(p, &t, &settings.opt, out->signals, &s, err);
    cost_stage(&cost, "step");
    if (rc == MODAL_OK) {
        out->result = print_result(p, &t, &s, &out->batch);
        cJSON_AddItemToObject(out->result, "cost", cost_print(&cost));
        cJSON_AddItemToObject(out->result, "provenance",
                              provenance_print(request, print_options(&settings)));
    }
    program_free(p);
    cJSON_Delete(changed);
    return rc;
}
