/*
 * ablate.c - kind `ablate`: each effect of a scene removed in turn, what that changes and what it
 * saves
 *
 * Scenes with an excitation are compared by their steady states, others by their exponents:
 * exactly, and beside it the first-order estimate of influence.h.  Pulses die out and leave no
 * steady state: a scene with pulses alone is compared by its exponents too.  `change` is without
 * minus with.  `seconds` is the processor time of the answer with the effect less that without it,
 * each the least of REPEATS runs.
 *
 * Tested by tests/unit/job/test_scene_jobs.c.
 */
#include <math.h>
#include "job/cost.h"
#include "job/kind_run.h"
#include "job/plan.h"
#include "job/scene_jobs.h"
#include "job/steady.h"
#include "job/tradeoff_print.h"
#include "modal/scene/floquet.h"
#include "modal/scene/influence.h"
#include "modal/scene/scene.h"

/* The least of three is free of what else the machine did, mostly; more would treble a long job. */
enum { REPEATS = 3 };

struct ablation {
    const struct job_request *request;
    bool steady;
    struct program *program;         /* the whole scene's */
    cJSON *answer;                   /* steady: the whole scene's result */
    double seconds;                  /* of the whole scene's answer */
    double period;                   /* floquet: the whole scene's; 0 until known, or none */
};

/* The scene without effect number I; the caller deletes. */
static cJSON *scene_without(const cJSON *scene, int i)
{
    cJSON *copy = cJSON_Duplicate(scene, 1);

    cJSON_DeleteItemFromArray(cJSON_GetObjectItemCaseSensitive(copy, "effects"), i);
    return copy;
}

static enum modal_status steady_once(const struct ablation *a, const cJSON *scene, cJSON **answer,
                                     struct modal_error *err)
{
    struct job_request inner = { .kind = "steady", .options = a->request->options, .scene = scene,
                                 .arrays = a->request->arrays,
                                 .cancelled = a->request->cancelled,
                                 .context = a->request->context };
    struct job_result r;
    enum modal_status rc = kind_run(steady_run, &inner, &r, err);

    if (rc != MODAL_OK)
        return rc;
    cJSON_Delete(*answer);
    *answer = r.result;
    r.result = NULL;
    job_result_done(&r);
    return MODAL_OK;
}

/* A scene that is constant without the effect has multipliers over the whole scene's period, to
 * compare. */
static enum modal_status floquet_once(const struct ablation *a, const cJSON *scene,
                                      struct floquet *f, struct modal_error *err)
{
    struct scene_options whole = { .arrays = a->request->arrays };
    struct program *p = NULL;
    enum modal_status rc = scene_lower(scene, &whole, &p, err);

    floquet_done(f);
    if (rc == MODAL_OK && p->harmonics == 0 && !(p->period > 0))
        p->period = a->period;
    if (rc == MODAL_OK)
        rc = floquet(p, NULL, f, err);
    program_free(p);
    return rc;
}

/* The answer to SCENE into one of both, and the least time of REPEATS. */
static enum modal_status timed(const struct ablation *a, const cJSON *scene, cJSON **answer,
                               struct floquet *f, double *seconds, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    *seconds = HUGE_VAL;
    for (int k = 0; k < REPEATS && rc == MODAL_OK; k++) {
        double start = tradeoff_clock(NULL);
        rc = a->steady ? steady_once(a, scene, answer, err) : floquet_once(a, scene, f, err);
        *seconds = fmin(*seconds, tradeoff_clock(NULL) - start);
    }
    return rc;
}

/* One mode's row, and the largest changes so far. */
static void add_mode(cJSON *modes, const struct influence *f, int i, double worst[3])
{
    double complex a = f->from[i], b = f->to[i], d = f->first_order[i];
    double wa = cabs(a), wb = cabs(b), za = wa > 0 ? -creal(a) / wa : 0,
           zb = wb > 0 ? -creal(b) / wb : 0;
    double dw = wa > 0 ? creal(conj(a) * d) / wa : NAN,
           dz = wa > 0 ? (-creal(d) - za * dw) / wa : NAN;
    cJSON *mode = cJSON_CreateObject();

    json_set_number(mode, "frequency_hz", wa / (2 * M_PI));
    json_set_number(mode, "damping_ratio", za);
    cJSON_AddItemToObject(mode, "exponent", json_complex(creal(a), cimag(a)));
    cJSON_AddItemToObject(mode, "exponent_without", json_complex(creal(b), cimag(b)));
    json_set_number(mode, "frequency_change_hz", (wb - wa) / (2 * M_PI));
    json_set_number(mode, "frequency_first_order_hz", dw / (2 * M_PI));
    json_set_number(mode, "damping_change", zb - za);
    json_set_number(mode, "damping_first_order", dz);
    cJSON_AddItemToArray(modes, mode);
    worst[0] = fmax(worst[0], fabs(wb - wa) / (2 * M_PI));
    worst[1] = fmax(worst[1], fabs(zb - za));
    worst[2] = fmax(worst[2], cabs(b - a));
}

static enum modal_status exponents_changed(const struct ablation *a, const cJSON *scene,
                                           cJSON *change, struct modal_error *err)
{
    struct program *p = NULL;
    struct influence f;
    double worst[3] = { 0 };
    cJSON *modes;
    struct scene_options with = { .arrays = a->request->arrays };
    enum modal_status rc = scene_lower(scene, &with, &p, err);

    if (rc == MODAL_OK)
        rc = influence(a->program, p, &f, err);
    program_free(p);
    if (rc != MODAL_OK)
        return rc;
    modes = cJSON_CreateArray();
    for (int i = 0; i < f.count; i++)
        if (!isnan(cabs(f.from[i])) && cimag(f.from[i]) >= 0)
            add_mode(modes, &f, i, worst);
    json_set_number(change, "frequency_hz", worst[0]);
    json_set_number(change, "damping_ratio", worst[1]);
    json_set_number(change, "exponent", worst[2]);
    json_set_number(change, "margin", f.margin_to - f.margin_from);
    cJSON_AddItemToObject(change, "modes", modes);
    influence_done(&f);
    return MODAL_OK;
}

static double coefficient(const cJSON *dof, const char *part, int i)
{
    const cJSON *x = cJSON_GetArrayItem(cJSON_GetObjectItemCaseSensitive(dof, part), i);

    return cJSON_IsNumber(x) ? x->valuedouble : 0;
}

/* The largest difference of a harmonic of one dof, and the largest of the first. */
static double harmonics_differ(const cJSON *a, const cJSON *b, double *size)
{
    int m = cJSON_GetArraySize(cJSON_GetObjectItemCaseSensitive(a, "k")),
        n = cJSON_GetArraySize(cJSON_GetObjectItemCaseSensitive(b, "k"));
    double worst = 0;

    for (int i = 0; i < m; i++) {
        double re = coefficient(a, "re", i), im = coefficient(a, "im", i),
               k = coefficient(a, "k", i);
        int j = 0;
        while (j < n && coefficient(b, "k", j) != k)
            j++;
        worst = fmax(worst, hypot(j < n ? coefficient(b, "re", j) - re : -re,
                                  j < n ? coefficient(b, "im", j) - im : -im));
        *size = fmax(*size, hypot(re, im));
    }
    return worst;
}

static void steady_changed(const struct ablation *a, const cJSON *without, cJSON *change)
{
    const cJSON *dof, *other = cJSON_GetObjectItemCaseSensitive(without, "harmonics");
    cJSON *dofs = cJSON_CreateObject();
    double worst = 0, size = 0;

    other = other != NULL ? other->child : NULL;
    cJSON_ArrayForEach(dof, cJSON_GetObjectItemCaseSensitive(a->answer, "harmonics")) {
        double d = other != NULL ? harmonics_differ(dof, other, &size) : NAN;
        const cJSON *name = cJSON_GetObjectItemCaseSensitive(dof, "dof");
        if (cJSON_IsString(name))
            json_set_number(dofs, name->valuestring, d);
        worst = fmax(worst, d);
        other = other != NULL ? other->next : NULL;
    }
    json_set_number(change, "harmonics", worst);
    json_set_number(change, "relative", size > 0 ? worst / size : NAN);
    cJSON_AddItemToObject(change, "dofs", dofs);
}

static cJSON *print_floquet(const struct floquet *f)
{
    cJSON *json = cJSON_CreateObject();

    floquet_values(json, f);
    cJSON_AddItemToObject(json, "stability", floquet_stability(f));
    return json;
}

/* What every result repeats stays out. */
static cJSON *strip(cJSON *answer)
{
    static const char *const repeated[] = { "provenance", "plan", "cost", "kind" };

    for (size_t i = 0; i < sizeof repeated / sizeof *repeated; i++)
        cJSON_DeleteItemFromObjectCaseSensitive(answer, repeated[i]);
    return answer;
}

/* A scene that has no answer without the effect (a free body pushed, say) is itself the finding. */
static bool is_finding(enum modal_status rc)
{
    return rc == MODAL_BAD_INPUT || rc == MODAL_NO_CONVERGENCE || rc == MODAL_OVERFLOW
           || rc == MODAL_ELEMENT_FAILED;
}

static void add_failure(cJSON *row, enum modal_status rc, const struct modal_error *why)
{
    cJSON *without = cJSON_AddObjectToObject(row, "without"),
          *e = cJSON_AddObjectToObject(without, "error");

    cJSON_AddStringToObject(e, "code", modal_status_code(rc));
    cJSON_AddStringToObject(e, "message", why->message);
}

static enum modal_status ablate_effect(const struct ablation *a, int i, cJSON *row,
                                       struct modal_error *err)
{
    cJSON *scene = scene_without(a->request->scene, i), *answer = NULL,
          *change = cJSON_AddObjectToObject(row, "change");
    struct floquet f = { 0 };
    struct modal_error why = { 0 };
    double seconds;
    enum modal_status rc = timed(a, scene, &answer, &f, &seconds, &why);

    if (rc == MODAL_OK && !a->steady)
        rc = exponents_changed(a, scene, change, &why);
    if (rc == MODAL_OK) {
        if (a->steady)
            steady_changed(a, answer, change);
        json_set_number(row, "seconds", a->seconds - seconds);
        cJSON_AddItemToObject(row, "without", a->steady ? strip(answer) : print_floquet(&f));
        answer = NULL;
    } else if (is_finding(rc)) {
        json_set_number(row, "seconds", NAN);
        add_failure(row, rc, &why);
        rc = MODAL_OK;
    } else if (err != NULL) {
        *err = why;
    }
    cJSON_Delete(answer);
    cJSON_Delete(scene);
    floquet_done(&f);
    return rc;
}

static enum modal_status run_all(struct ablation *a, cJSON *list, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    int count = a->program->effects;

    for (int i = 0; i < count && rc == MODAL_OK; i++) {
        cJSON *row = cJSON_CreateObject();
        cJSON_AddStringToObject(row, "type", a->program->effect[i].type);
        cJSON_AddItemToArray(list, row);
        if (job_cancelled(a->request))
            return modal_fail(err, MODAL_CANCELLED, "ablate: cancelled before effect %d of %d",
                              i + 1, count);
        rc = ablate_effect(a, i, row, err);
        if (rc == MODAL_OK && a->request->progress != NULL) {
            cJSON *event = cJSON_CreateObject();
            json_set_number(event, "fraction", (double)(i + 1) / count);
            a->request->progress(a->request->context, event);
            cJSON_Delete(event);
        }
    }
    return rc;
}

static bool has_harmonic(const struct program *p)
{
    for (int i = 0; i < p->loads; i++)
        if (p->load[i].type == LOAD_HARMONIC)
            return true;
    return false;
}

/* Exponents have no options but whom the job is counted for, which is the broker's to read. */
const struct key_row ablate_option_rows[] = {
    { "threads", KEY_OWN, KEY_SILENT, .form = "N", .initial = "1",
      .meaning = "that the job is counted for", .example = "2" },
    { 0 },
};

enum modal_status ablate_run(const struct job_request *request, struct job_result *out,
                             struct modal_error *err)
{
    struct ablation a = { .request = request };
    struct floquet whole = { 0 };
    struct scene_options options = { .arrays = request->arrays };
    struct cost cost;
    enum modal_status rc;

    cost_start(&cost);
    rc = scene_lower(request->scene, &options, &a.program, err);
    if (rc == MODAL_OK) {
        a.steady = has_harmonic(a.program);
        if (!a.steady && request->options != NULL)
            rc = key_table_check(ablate_option_rows, NULL, request->options, "", err);
    }
    if (rc == MODAL_OK)
        rc = timed(&a, request->scene, &a.answer, &whole, &a.seconds, err);
    a.period = whole.period;
    cost_stage(&cost, "whole");
    if (rc == MODAL_OK) {
        out->result = cJSON_CreateObject();
        cJSON_AddStringToObject(out->result, "kind", "ablate");
        cJSON_AddStringToObject(out->result, "of", a.steady ? "steady" : "floquet");
        json_set_number(out->result, "seconds", a.seconds);
        rc = run_all(&a, cJSON_AddArrayToObject(out->result, "effects"), err);
        cost_stage(&cost, "without");
    }
    if (rc == MODAL_OK) {
        cJSON *plan = a.steady ? cJSON_DetachItemFromObjectCaseSensitive(a.answer, "plan")
                               : plan_print(a.program,
                                            a.program->harmonics > 0 ? "magnus" : "eigenvalues");
        cJSON_AddItemToObject(out->result, "with",
                              a.steady ? cJSON_Duplicate(strip(a.answer), 1)
                                       : print_floquet(&whole));
        cJSON_AddItemToObject(out->result, "plan", plan);
        cJSON_AddItemToObject(out->result, "cost", cost_print(&cost));
        cJSON_AddItemToObject(out->result, "provenance",
                              provenance_print(request, cJSON_Duplicate(request->options, 1)));
    }
    cJSON_Delete(a.answer);
    floquet_done(&whole);
    program_free(a.program);
    return rc;
}
