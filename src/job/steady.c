/* steady.c - kind `steady`: see steady.h; curves are in curve.c;
 * tested by tests/unit/job/test_scene_jobs.c */
#include "job/steady.h"
#include <stdlib.h>
#include <string.h>
#include "job/backbone_job.h"
#include "job/cost.h"
#include "job/curve.h"
#include "job/plan.h"
#include "job/steady_print.h"
#include "job/steady_settings.h"
#include "job/torus_curve.h"
#include "job/torus_job.h"
#include "modal/scene/scene.h"
#include "modal/steady/by_cycle.h"
#include "modal/steady/reduction.h"
#include "modal/steady/solve.h"
#include "modal/steady/stability.h"

/* Whether OTHER, FOUND, is not unstable; its stability into *ST. */
static enum modal_status attracts(struct steady *s, const struct steady_point *other, bool found,
                                  struct stability *st, bool *done, struct modal_error *err)
{
    enum modal_status rc = found ? stability_of(s, other, st, err) : MODAL_OK;

    *done = rc == MODAL_OK && found && st->verdict != STABILITY_UNSTABLE;
    return rc;
}

/* POINT, unstable, and what is KNOWN of it become the motion that attracts from rest, where one is
 * found that is not unstable as well; *DONE: they did. */
static enum modal_status take_attractor(struct steady *s, struct steady_point *point,
                                        struct stability *known, bool *done,
                                        struct modal_error *err)
{
    struct steady_point other;
    struct stability st = { 0 };
    bool found;
    enum modal_status rc = steady_solve_attractor(s, point, &other, &found, err);

    if (rc == MODAL_OK && found)
        rc = steady_refine(s, &other, err);
    if (rc == MODAL_OK)
        rc = attracts(s, &other, found, &st, done, err);
    if (rc == MODAL_OK && !*done) {
        stability_done(&st);
        steady_point_done(&other);
        rc = steady_follow_attractor(s, point->omega, &other, &found, err);
        if (rc == MODAL_OK)
            rc = attracts(s, &other, found, &st, done, err);
    }
    time_forget(s);
    *done = rc == MODAL_OK && *done;
    if (*done) {
        struct steady_point last = *point;
        struct stability was = *known;

        *point = other;
        point->work = *steady_work(s);
        *known = st;
        other = last;
        st = was;
    }
    stability_done(&st);
    steady_point_done(&other);
    return rc;
}

/* The verdict of POINT into *KNOWN; one that is not unstable has the rest of the work for what its
 * target asks, and with more harmonics a verdict of its own. */
static enum modal_status judge_and_refine(struct steady *s, struct steady_point *point,
                                          struct stability *known, struct modal_error *err)
{
    int H = point->H;
    enum modal_status rc = stability_of(s, point, known, err);

    if (rc == MODAL_OK && known->verdict != STABILITY_UNSTABLE)
        rc = steady_refine(s, point, err);
    if (rc == MODAL_OK && point->H != H) {
        stability_done(known);
        rc = stability_of(s, point, known, err);
    }
    return rc;
}

/* A motion found from rest that is unstable is not what a machine does: a stable one is sought
 * among all, and given if there is.  *KNOWN is the stability of the one given. */
static enum modal_status prefer_stable(struct steady *s, const struct program *p,
                                       struct steady_point *point, struct stability *known,
                                       struct modal_error *err)
{
    const struct budget *work = steady_work(s);
    struct stability st = { 0 };
    struct steady_point *points = NULL;
    int count = 0, stable = -1;
    bool done = false;
    enum modal_status rc = judge_and_refine(s, point, known, err);

    if (rc != MODAL_OK || known->verdict != STABILITY_UNSTABLE)
        return rc;
    rc = take_attractor(s, point, known, &done, err);
    if (rc != MODAL_OK || done)
        return rc;
    rc = steady_solve_all(s, p->omega, NULL, point, &points, &count, err);
    /* the first is what is known */
    for (int i = 1; rc == MODAL_OK && i < count && stable < 0 && stability_pays(work, known); i++) {
        if (points[i].converged)             /* with the harmonics that its own error asks for */
            rc = steady_refine(s, &points[i], err);
        if (rc == MODAL_OK && points[i].converged)
            rc = stability_of(s, &points[i], &st, err);
        if (rc == MODAL_OK && points[i].converged && st.verdict == STABILITY_STABLE)
            stable = i;
        if (stable < 0)
            stability_done(&st);
    }
    if (rc == MODAL_OK && stable >= 0) {
        stability_done(known);
        *known = st;
        memset(&st, 0, sizeof st);
        steady_point_done(point);
        *point = points[stable];
        point->method = "multi-start";
        memset(&points[stable], 0, sizeof points[stable]);
    } else if (rc == MODAL_OK) {
        bool unsought = budget_spent(work) || (count > 0 && points[0].unsought);

        rc = count > 0 ? steady_refine(s, point, err) : MODAL_OK;
        point->unsought = unsought;                     /* of whichever the refined one is */
    }
    if (rc == MODAL_OK)
        point->work = *work;
    for (int i = 0; i < count; i++)
        steady_point_done(&points[i]);
    free(points);
    stability_done(&st);
    return rc;
}

/* Whether a stable motion is given in place of an unstable one: not where one is asked for by its
 * start or its method. */
static bool prefers_stable(const struct program *p, const struct steady_settings *settings)
{
    return settings->solutions != 1 && settings->stability && settings->start == NULL
        && settings->opt.method == STEADY_AUTO && p->laws > 0;
}

/* One point, or with `solutions` all every one, the first converged first.  *KNOWN: the stability
 * of the one, if it was looked at. */
static enum modal_status solve_points(struct steady *s, const struct program *p,
                                      const struct steady_settings *settings,
                                      const struct steady_start *start,
                                      struct steady_point **points, int *count,
                                      struct stability *known, struct modal_error *err)
{
    enum modal_status rc;

    if (settings->solutions == 1)
        return steady_solve_all(s, p->omega, start, NULL, points, count, err);
    *points = calloc(1, sizeof **points);
    if (*points == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    rc = steady_solve(s, p->omega, start, *points, err);
    *count = rc == MODAL_OK ? 1 : 0;
    if (rc == MODAL_OK && settings->opt.prefers_stable && (*points)->converged)
        rc = prefer_stable(s, p, *points, known, err);
    return rc;
}

static enum modal_status print_point(struct steady *s, struct program *p,
                                     const struct steady_settings *settings,
                                     struct steady_point *point, struct stability *known,
                                     struct cost *cost, cJSON **doc, struct modal_error *err)
{
    bool wanted = settings->stability && point->converged;
    enum modal_status rc = wanted && known->verdict == STABILITY_UNKNOWN && known->reason == NULL
                               ? stability_of(s, point, known, err)
                               : MODAL_OK;

    cost_stage(cost, "stability");
    if (rc == MODAL_OK)
        rc = reduction_error(s, point, err);
    if (rc == MODAL_OK)
        rc = steady_print(s, p, settings, point, wanted ? known : NULL, doc, err);
    if (rc == MODAL_OK)
        steady_count(p, point);
    stability_done(known);
    return rc;
}

static enum modal_status one_state(struct program *p, struct steady_settings *settings,
                                   struct cost *cost, cJSON **doc, struct modal_error *err)
{
    struct steady *s = NULL;
    struct steady_point *points = NULL;
    struct steady_start start = { 0 };
    struct stability known = { 0 };
    cJSON *list = NULL, *one = NULL;
    int count = 0;
    enum modal_status rc;

    settings->opt.prefers_stable = prefers_stable(p, settings);
    rc = steady_new(p, &settings->opt, &s, err);
    if (rc == MODAL_OK)
        rc = steady_settings_start(settings, s, &start, err);
    if (rc == MODAL_OK)
        rc = solve_points(s, p, settings, start.X != NULL ? &start : NULL, &points, &count, &known,
                          err);
    cost_stage(cost, "solve");
    if (rc == MODAL_OK && settings->solutions == 1)
        list = cJSON_CreateArray();
    for (int i = 0; rc == MODAL_OK && i < count; i++) {
        rc = print_point(s, p, settings, &points[i], &known, cost, i == 0 ? doc : &one, err);
        if (rc == MODAL_OK && list != NULL)
            cJSON_AddItemToArray(list, i == 0 ? cJSON_Duplicate(*doc, 1) : one);
    }
    if (rc == MODAL_OK) {
        cJSON *plan = plan_print(p, points[0].method != NULL ? points[0].method : "none");

        if (list != NULL)
            cJSON_AddItemToObject(*doc, "solutions", list);
        plan_add_reduction(plan, steady_reduction(s));
        cJSON_AddNumberToObject(plan, "ffts", (double)points[0].ffts);
        cJSON_AddNumberToObject(plan, "iterations", points[0].iterations);
        cJSON_AddItemToObject(*doc, "plan", plan);
    } else
        cJSON_Delete(list);
    cost_stage(cost, "print");
    for (int i = 0; i < count; i++)
        steady_point_done(&points[i]);
    stability_done(&known);
    free(points);
    free((void *)start.X);
    steady_free(s);
    return rc;
}

enum modal_status steady_run(const struct job_request *request, struct job_result *out,
                             struct modal_error *err)
{
    struct cost cost;
    struct steady_settings settings = { 0 };
    struct scene_options with = { .arrays = request->arrays };
    struct program *p = NULL;
    cJSON *shown = NULL, *doc = NULL;
    enum modal_status rc;

    cost_start(&cost);
    rc = scene_lower(request->scene, &with, &p, err);
    if (rc != MODAL_OK)
        return rc;
    rc = steady_settings_read(request, p, &settings, &shown, err);
    if (rc != MODAL_OK)
        goto out;
    if (settings.tones_count == 0 && !(p->omega > 0) && settings.sweep == NULL
        && settings.follow == NULL && settings.backbone == NULL) {
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "omega",
                              "a steady state needs the scene's omega > 0");
        goto out;
    }
    steady_subharmonic(p, settings.subharmonic);
    steady_count_start(p);
    cost_stage(&cost, "lower");
    rc = settings.tones_count > 0 && (settings.sweep != NULL || settings.follow != NULL)
             ? torus_curve(request, p, &settings, &cost, &doc, err)
         : settings.tones_count > 0 ? torus_run(p, &settings, &cost, &doc, err)
         : settings.sweep != NULL || settings.follow != NULL
             ? curve_run(request, p, &settings, &cost, &doc, err)
         : settings.backbone != NULL ? backbone_run(request, p, &settings, &cost, &doc, err)
                                     : one_state(p, &settings, &cost, &doc, err);
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
