/*
 * torus_curve.c - steady states under several tones over one number
 *
 * Each point begins at the one before it, so that of several motions the branch goes on; where
 * that leads nowhere, at rest.  A tone is `tones[J]`, wherever it was given; any other path is one
 * of the scene, which is lowered anew.  Where two tones meet, no point: one omega says it.
 *
 * Tested by tests/system/test_tones.py.
 */
#include "job/torus_curve.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "job/cost.h"
#include "job/curve.h"
#include "job/plan.h"
#include "job/scene_path.h"
#include "job/steady_settings.h"
#include "job/torus_job.h"
#include "modal/scene/program.h"
#include "modal/scene/scene.h"
#include "modal/steady/torus_solve.h"

struct torus_sweep {
    const struct job_request *request;
    struct steady_settings settings;      /* a copy, whose tones move; what it points to is not */
    struct cost *cost;
    struct program *p;                    /* of the scene as given: counts and names */
    struct curve_range range;
    int tone;                             /* that is swept; -1: a number of the scene */
    cJSON *scene, *points;                /* a copy to change */
    struct torus_point last;              /* the last that converged, none where q is 0 */
    int iterations, done;
};

/* Which tone PATH names, -1: none. */
static int tone_of(const char *path)
{
    int j = -1, end = 0;

    if (strncmp(path, "steady.", 7) == 0)
        path += 7;
    if (sscanf(path, "tones[%d]%n", &j, &end) != 1 || end == 0 || path[end] != '\0')
        return -1;
    return j;
}

static enum modal_status read_range(struct torus_sweep *w, struct modal_error *err)
{
    enum modal_status rc = curve_range_read(w->settings.sweep, "sweep", true, &w->range, err);
    int count = w->settings.tones_count;

    if (rc != MODAL_OK)
        return rc;
    w->tone = tone_of(w->range.path);
    if (w->tone >= count || (w->tone >= 0 && w->tone + 1 == w->settings.free_tone))
        return modal_fail_field(err, MODAL_BAD_INPUT, "sweep",
                                "%s is no tone that is given; accepted: tones[0] to tones[%d], "
                                "but one that is free", w->range.path, count - 1);
    if (w->tone >= 0 && !(w->range.from > 0 && w->range.to > 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, "sweep", "%s from %g to %g; accepted: > 0",
                                w->range.path, w->range.from, w->range.to);
    if (strcmp(w->range.path, "omega") == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "sweep",
                                "omega is not what moves here; accepted: tones[0] to tones[%d], or "
                                "a number of the scene", count - 1);
    return MODAL_OK;
}

/* The program at VALUE, W->p itself for a tone; the caller frees any other. */
static enum modal_status lower_at(struct torus_sweep *w, double value, struct program **here,
                                  struct modal_error *err)
{
    struct scene_options with = { .arrays = w->request->arrays };
    enum modal_status rc;

    *here = w->p;
    if (w->tone >= 0) {
        w->settings.tones[w->tone] = value;
        return MODAL_OK;
    }
    *here = NULL;
    rc = scene_path_set(w->scene, w->range.path, value, "sweep", err);
    if (rc == MODAL_OK)
        rc = scene_lower(w->scene, &with, here, err);
    cost_stage(w->cost, "lower");
    return rc;
}

static enum modal_status solve_at(struct torus_sweep *w, struct program *here,
                                  struct torus_point *point, struct modal_error *err)
{
    enum modal_status rc;

    if (torus_alike(&w->settings)) {
        *point = (struct torus_point) { .reason = "two tones are the same here", .residual = NAN,
                                        .tones = torus_tones_of(w->settings.tones,
                                                                w->settings.tones_count) };
        return MODAL_OK;
    }
    rc = torus_at(here, &w->settings, w->last.q > 0 ? &w->last : NULL, point, err);
    if (rc == MODAL_OK && !point->converged && w->last.q > 0) {
        torus_count(w->p, point);
        torus_point_done(point);
        rc = torus_at(here, &w->settings, NULL, point, err);
    }
    return rc;
}

static void report_point(const struct torus_sweep *w, int i, double value,
                         const struct torus_point *point)
{
    cJSON *event;

    if (w->request->progress == NULL)
        return;
    event = cJSON_CreateObject();
    json_set_number(event, "fraction", (i + 1.0) / w->range.count);
    cJSON_AddStringToObject(event, "parameter", w->range.path);
    json_set_number(event, "value", value);
    cJSON_AddBoolToObject(event, "converged", point->converged);
    json_set_number(event, "amplitude", point->amplitude);
    if (point->stability.verdict != 0)
        cJSON_AddBoolToObject(event, "stable", point->stability.verdict > 0);
    w->request->progress(w->request->context, event);
    cJSON_Delete(event);
}

/* Printed, told and, where it converged, the last: POINT is W's then. */
static void add_point(struct torus_sweep *w, int i, double value, const struct program *here,
                      struct torus_point *point)
{
    cJSON *doc = torus_print(here, &w->settings, point);

    json_set_number(doc, "value", value);
    cJSON_AddItemToArray(w->points, doc);
    torus_count(w->p, point);
    w->iterations += point->iterations;
    w->done++;
    report_point(w, i, value, point);
    if (point->converged && point->q > 0) {
        torus_point_done(&w->last);
        w->last = *point;
    } else
        torus_point_done(point);
    cost_stage(w->cost, "print");
}

static enum modal_status sweep(struct torus_sweep *w, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < w->range.count; i++) {
        double value = curve_range_at(&w->range, i);
        struct program *here = NULL;
        struct torus_point point = { 0 };

        if (job_cancelled(w->request))
            return modal_fail(err, MODAL_CANCELLED, "cancelled at point %d of %d", i,
                              w->range.count);
        rc = lower_at(w, value, &here, err);
        if (rc == MODAL_OK)
            rc = solve_at(w, here, &point, err);
        cost_stage(w->cost, "solve");
        if (rc == MODAL_OK)
            add_point(w, i, value, here, &point);
        if (here != w->p)
            program_free(here);
    }
    return rc;
}

enum modal_status torus_curve(const struct job_request *request, struct program *p,
                              const struct steady_settings *settings, struct cost *cost,
                              cJSON **doc, struct modal_error *err)
{
    struct torus_sweep w = { .request = request, .settings = *settings, .cost = cost, .p = p,
                             .scene = cJSON_Duplicate(request->scene, 1) };
    cJSON *out = cJSON_CreateObject(), *plan;
    enum modal_status rc = torus_check(settings, err);

    if (rc == MODAL_OK)
        rc = w.scene == NULL ? modal_fail(err, MODAL_NO_MEMORY, "curve: no memory")
                             : read_range(&w, err);
    cJSON_AddStringToObject(out, "kind", "curve");
    cJSON_AddStringToObject(out, "parameter", w.range.path);
    w.points = cJSON_AddArrayToObject(out, "points");
    cJSON_AddArrayToObject(out, "folds");
    cJSON_AddArrayToObject(out, "bifurcations");
    if (rc == MODAL_OK)
        rc = sweep(&w, err);
    if (rc == MODAL_CANCELLED && w.done > 0) {        /* what was found before is the answer */
        cJSON_AddFalseToObject(out, "complete");
        cJSON_AddStringToObject(out, "reason", JOB_STOPPED);
        rc = MODAL_OK;
    }
    if (rc == MODAL_OK) {
        plan = plan_print(p, "sweep");
        cJSON_AddNumberToObject(plan, "iterations", w.iterations);
        cJSON_AddItemToObject(out, "plan", plan);
        *doc = out;
        out = NULL;
    }
    cJSON_Delete(out);
    cJSON_Delete(w.scene);
    torus_point_done(&w.last);
    return rc;
}
