/* steady.c - kind `steady`: see steady.h; curves are in curve.c */
#include "job/steady.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "job/cost.h"
#include "job/plan.h"
#include "job/steady_print.h"
#include "modal/scene/scene.h"

/* The settings' start, dof by dof, as the kept dofs' motion; the caller frees start->X. */
static enum modal_status kept_start(const struct steady_settings *settings, struct steady *s, struct steady_start *start, struct modal_error *err)
{
    int q = condense_kept(steady_condense(s)), K = settings->start_H + 1;
    double complex *X;

    if (settings->start == NULL)
        return MODAL_OK;
    X = calloc((size_t)q * (size_t)K + 1, sizeof *X);
    if (X == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a start");
    for (int i = 0; i < q; i++)
        memcpy(X + i * K, settings->start + (size_t)condense_dofs(steady_condense(s))[i] * (size_t)K, (size_t)K * sizeof *X);
    *start = (struct steady_start) { q, settings->start_H, X };
    return MODAL_OK;
}

static enum modal_status one_state(const struct job_request *request, struct program *p, struct steady_settings *settings, struct cost *cost,
                                   cJSON **doc, struct modal_error *err)
{
    struct steady *s = NULL;
    struct steady_point point = { 0 };
    struct steady_start start = { 0 };
    struct stability stability = { 0 };
    cJSON *plan;
    enum modal_status rc = steady_new(p, &settings->opt, &s, err);

    (void)request;
    if (rc == MODAL_OK)
        rc = kept_start(settings, s, &start, err);
    if (rc == MODAL_OK)
        rc = steady_solve(s, p->omega, start.X != NULL ? &start : NULL, &point, err);
    cost_stage(cost, "solve");
    if (rc == MODAL_OK && settings->stability && point.converged)
        rc = stability_of(s, &point, &stability, err);
    cost_stage(cost, "stability");
    if (rc == MODAL_OK)
        rc = steady_print(s, p, settings, &point, settings->stability && point.converged ? &stability : NULL, doc, err);
    if (rc == MODAL_OK) {
        steady_count(p, &point);
        plan = plan_print(p, point.method != NULL ? point.method : "none");
        cJSON_AddNumberToObject(plan, "ffts", (double)point.ffts);
        cJSON_AddNumberToObject(plan, "iterations", point.iterations);
        cJSON_AddItemToObject(*doc, "plan", plan);
    }
    cost_stage(cost, "print");
    free((void *)start.X);
    stability_done(&stability);
    steady_point_done(&point);
    steady_free(s);
    return rc;
}

enum modal_status steady_run(const struct job_request *request, struct job_result *out, struct modal_error *err)
{
    struct cost cost;
    struct steady_settings settings = { 0 };
    struct program *p = NULL;
    cJSON *shown = NULL, *doc = NULL;
    enum modal_status rc;

    cost_start(&cost);
    rc = scene_lower(request->scene, NULL, &p, err);
    if (rc != MODAL_OK)
        return rc;
    rc = steady_settings_read(request, p, &settings, &shown, err);
    if (rc != MODAL_OK)
        goto out;
    if (!(p->omega > 0)) {
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "omega", "a steady state needs the scene's omega > 0");
        goto out;
    }
    steady_subharmonic(p, settings.subharmonic);
    steady_count_start(p);
    cost_stage(&cost, "lower");
    rc = one_state(request, p, &settings, &cost, &doc, err);
    if (rc != MODAL_OK)
        goto out;
    cJSON_AddItemToObject(doc, "cost", cost_print(&cost));
    cJSON_AddItemToObject(doc, "provenance", provenance_print(request, shown));
    shown = NULL;
    out->result = doc;
out:
    cJSON_Delete(shown);
    steady_settings_done(&settings);
    program_free(p);
    return rc;
}
