/*
 * curve.c - steady states over one number of the scene
 *
 * A sweep solves N points, each from its neighbour.  A continuation follows one branch (path.h) and
 * reports folds, and between its points the changes of stability: a multiplier that leaves the unit
 * circle at +1 (a branch point, or at a fold), at -1 (period doubling) or as a pair
 * (Neimark-Sacker), located by regula falsi on |mu| - 1 over the parameter.
 *
 * Rigid friction alone has no branch to follow: a harmonic balance does not know of stops, and the
 * motion is unique (two of them would approach each other, friction being monotone in the rates),
 * so that there are no folds.  Its continuation is MARCHED points.
 *
 * Tested by tests/system/test_curve.py.
 */
#include "job/curve.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "job/cost.h"
#include "job/plan.h"
#include "job/scene_path.h"
#include "job/steady_print.h"
#include "job/steady_settings.h"
#include "modal/scene/scene.h"
#include "modal/steady/balance.h"
#include "modal/steady/cycle.h"
#include "modal/steady/estimate.h"
#include "modal/steady/path.h"
#include "modal/steady/reduction.h"
#include "modal/steady/solve.h"
#include "modal/steady/stability.h"

enum {
    POINTS_MOST = 20000,         /* of a sweep: a document of some 100 MB */
    PATH_POINTS_MOST = 5000,     /* of a branch, whose steps are as long as they can be */
    H_FOLLOWED_MOST = 64,        /* harmonics of a branch: its Jacobian is factored at each point */
    REFINE_MOST = 60,            /* halvings: 53 exhaust a double */
    NEAR = 4,                    /* points between a fold of the truncated motion and the exact
                                    one's */
    MARCHED = 101,               /* points where there is no branch to follow: a hundred steps */
    FROM_TO_USUAL = 100          /* count where none is asked for: any that the check lets pass */
};

/* Multipliers of an orbit lie on the circle to their own rounding, some 1e-12; beyond this they
 * have left it. */
static const double ON_CIRCLE = 1 + 1e-9;
/* Where stability changes is known to this part of the range: below it multipliers are rounding. */
static const double REFINED = 1e-12;
/* A multiplier is real that is within this of the axis: a pair about to meet there comes as the
 * root of rounding. */
static const double REAL = 1e-6;

struct curve {
    const struct job_request *request;
    struct steady_settings *settings;
    struct cost *cost;
    struct program *p;             /* of the scene as given: counts and names */
    struct curve_range range;
    bool omega;                    /* the parameter is omega: one session for all */
    cJSON *scene;                  /* a copy to change */
    struct program *here;          /* lowered at the parameter; p itself for omega */
    struct steady *s;
    int H;
    double complex *last;          /* of the point before */
    int last_q, last_H;
    double last_value, last_turn;
    int number, lone_branch, bare_fold;      /* points so far; the last ones with a branch point,
                                                with a fold where no multiplier passed */
    struct stability before;
    cJSON *points, *folds, *bifurcations;
    long ffts;
    int iterations, done;
};

enum modal_status curve_range_read(const char *text, const char *field, bool counted,
                                   struct curve_range *range, struct modal_error *err)
{
    const char *equals = strchr(text, '=');
    char *end = NULL, *rest = NULL;
    long count = counted ? 2 : FROM_TO_USUAL;

    if (equals == NULL || equals == text || (size_t)(equals - text) >= sizeof range->path)
        return modal_fail_field(err, MODAL_BAD_INPUT, field, "\"%.60s\": accepted: PATH=A:B%s, "
                                "such as omega=1:2%s", text, counted ? ":N" : "",
                                counted ? ":20" : "");
    *range = (struct curve_range) { 0 };
    memcpy(range->path, text, (size_t)(equals - text));
    range->from = strtod(equals + 1, &end);
    range->to = *end == ':' ? strtod(end + 1, &rest) : NAN;
    if (counted && rest != NULL && *rest == ':')
        count = strtol(rest + 1, &rest, 10);
    else if (counted)
        rest = NULL;
    if (rest == NULL || *rest != '\0' || !isfinite(range->from) || !isfinite(range->to) || count < 2
        || count > POINTS_MOST || (!counted && range->from == range->to))
        return modal_fail_field(err, MODAL_BAD_INPUT, field,
                                "\"%.60s\": accepted: PATH=A:B%s, finite, %s", text,
                                counted ? ":N" : "",
                                counted ? "2 to 20000 points" : "A and B different");
    range->count = (int)count;
    return MODAL_OK;
}

double curve_range_at(const struct curve_range *range, int i)
{
    return i == range->count - 1
               ? range->to : range->from + (range->to - range->from) * i / (range->count - 1);
}

static enum modal_status parse(struct curve *c, const char *text, const char *field, bool counted,
                               struct modal_error *err)
{
    enum modal_status rc = curve_range_read(text, field, counted, &c->range, err);

    c->omega = rc == MODAL_OK && strcmp(c->range.path, "omega") == 0;
    if (c->omega && (c->range.from <= 0 || c->range.to <= 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, field, "omega from %g to %g; accepted: > 0",
                                c->range.from, c->range.to);
    return rc;
}

/* The scene at VALUE lowered, c->here. */
static enum modal_status lower_at(struct curve *c, double value, struct modal_error *err)
{
    const char *field = c->settings->sweep != NULL ? "sweep" : "continue";
    struct scene_options with = { .arrays = c->request->arrays };
    enum modal_status rc;

    c->here = NULL;
    cost_stage(c->cost, "solve");
    rc = scene_path_set(c->scene, c->range.path, value, field, err);
    if (rc == MODAL_OK)
        rc = scene_lower(c->scene, &with, &c->here, err);
    cost_stage(c->cost, "lower");
    if (rc == MODAL_OK && !(c->here->omega > 0))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "omega",
                              "a steady state needs the scene's omega > 0");
    if (rc == MODAL_OK)
        steady_subharmonic(c->here, c->settings->subharmonic);
    return rc;
}

/* The session at VALUE, c->s; omega to solve at into *OMEGA.  What the one before knows of a linear
 * part that is still the same stays. */
static enum modal_status session_at(struct curve *c, double value, double *omega,
                                    struct modal_error *err)
{
    struct steady *before = c->s;
    struct program *was = c->here != c->p ? c->here : NULL;
    enum modal_status rc;

    *omega = value / c->settings->subharmonic;
    if (c->omega && c->s != NULL)
        return MODAL_OK;
    c->s = NULL;
    c->here = c->p;
    rc = c->omega ? MODAL_OK : lower_at(c, value, err);
    if (rc == MODAL_OK)
        rc = steady_new(c->here, &c->settings->opt, &c->s, err);
    if (rc == MODAL_OK && !c->omega)
        *omega = c->here->omega;
    if (rc == MODAL_OK && before != NULL)
        steady_inherit(c->s, before);
    steady_free(before);
    program_free(was);
    return rc == MODAL_OK && c->omega && c->range.count > 2
               ? steady_reduce(c->s, c->range.count, err)
               : rc;
}

static void set_last(struct curve *c, const struct steady_point *point)
{
    size_t size = (size_t)point->q * ((size_t)point->H + 1);
    double complex *copy = point->converged ? malloc((size + 1) * sizeof *copy) : NULL;

    if (copy == NULL)
        return;
    memcpy(copy, point->X, size * sizeof *copy);
    free(c->last);
    c->last = copy;
    c->last_q = point->q;
    c->last_H = point->H;
}

void curve_report(const struct job_request *request, const struct curve_range *range,
                  double fraction, double value, bool converged, double amplitude, int stable)
{
    cJSON *event;

    if (request->progress == NULL)
        return;
    event = cJSON_CreateObject();
    json_set_number(event, "fraction", fraction);
    cJSON_AddStringToObject(event, "parameter", range->path);
    json_set_number(event, "value", value);
    cJSON_AddBoolToObject(event, "converged", converged);
    json_set_number(event, "amplitude", amplitude);
    if (stable != 0)
        cJSON_AddBoolToObject(event, "stable", stable > 0);
    request->progress(request->context, event);
    cJSON_Delete(event);
}

/* Print POINT at VALUE into the curve; takes nothing over. */
static enum modal_status add_point(struct curve *c, double value, double fraction,
                                   struct steady_point *point, const struct stability *st,
                                   struct modal_error *err)
{
    cJSON *doc = NULL;
    enum modal_status rc = reduction_error(c->s, point, err);

    if (rc == MODAL_OK)
        rc = steady_print(c->s, c->here, c->settings, point,
                          c->settings->stability && point->converged ? st : NULL, &doc, err);

    if (rc != MODAL_OK)
        return rc;
    json_set_number(doc, "value", value);
    if (c->omega) {
        /* the parameter's own digits, and the key once */
        cJSON_DeleteItemFromObjectCaseSensitive(doc, "omega");
        json_set_number(doc, "omega", value);
    }
    if (c->settings->subharmonic > 1)
        json_set_number(doc, "fundamental", point->omega);
    cJSON_AddItemToArray(c->points, doc);
    steady_count(c->p, point);
    c->ffts += point->ffts;
    c->iterations += point->iterations;
    c->done++;
    curve_report(c->request, &c->range, fraction, value, point->converged, point->amplitude,
                 (st->verdict == STABILITY_STABLE) - (st->verdict == STABILITY_UNSTABLE));
    cost_stage(c->cost, "print");
    return MODAL_OK;
}

/* Before the first point: the given start stands for a point before it. */
static enum modal_status set_out(struct curve *c, struct modal_error *err)
{
    struct steady_start start = { 0 };
    enum modal_status rc = steady_settings_start(c->settings, c->s, &start, err);

    c->last = (double complex *)start.X;
    c->last_q = start.q;
    c->last_H = start.H;
    return rc;
}

static enum modal_status sweep(struct curve *c, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < c->range.count; i++) {
        double value = curve_range_at(&c->range, i), omega = 0;
        struct steady_start start;
        struct steady_point point = { 0 };
        struct stability st = { 0 };

        if (job_cancelled(c->request))
            return modal_fail(err, MODAL_CANCELLED, "cancelled at point %d of %d", i,
                              c->range.count);
        rc = session_at(c, value, &omega, err);
        if (rc == MODAL_OK && i == 0)
            rc = set_out(c, err);
        start = (struct steady_start) { c->last_q, c->last_H, c->last };
        if (rc == MODAL_OK)
            rc = steady_solve(c->s, omega, c->last != NULL ? &start : NULL, &point, err);
        if (rc == MODAL_OK && point.converged)
            rc = steady_estimate_point(c->s, &point, err);
        if (rc == MODAL_OK && c->settings->stability && point.converged)
            rc = stability_of(c->s, &point, &st, err);
        cost_stage(c->cost, "solve");
        if (rc == MODAL_OK) {
            set_last(c, &point);
            rc = add_point(c, value, (i + 1.0) / c->range.count, &point, &st, err);
        }
        stability_done(&st);
        steady_point_done(&point);
    }
    return rc;
}

static enum modal_status balance_at(void *context, double value, struct balance **out,
                                    struct modal_error *err)
{
    struct curve *c = context;
    double omega = 0;
    enum modal_status rc = session_at(c, value, &omega, err);

    if (rc == MODAL_OK)
        rc = steady_balance(c->s, c->H, out, err);
    return rc == MODAL_OK ? balance_set(*out, omega, 1, err) : rc;
}

/* A steady_point of a balance's solution, X copied. */
static enum modal_status point_of(struct curve *c, struct balance *b, const double complex *X,
                                  int iterations, struct steady_point *point,
                                  struct modal_error *err)
{
    enum modal_status rc = steady_point_of(c->s, b, X, point, err);

    if (rc != MODAL_OK)
        return rc;
    point->method = "continuation";
    point->iterations = iterations;
    return MODAL_OK;
}

static int unstable(const struct stability *s)
{
    int count = 0;

    for (int i = 0; i < s->count; i++)
        count += cabs(s->multiplier[i]) > ON_CIRCLE;
    return count;
}

/* The multiplier nearest the circle that changed sides between two points. */
static double complex changed(const struct stability *a, const struct stability *b)
{
    const struct stability *more = unstable(a) > unstable(b) ? a : b;
    int least = unstable(a) > unstable(b) ? unstable(b) : unstable(a);

    return more->multiplier[least];
}

/* Between the last point and this one the stability changes without a fold: where |mu| = 1, at a
 * fixed parameter's Newton solution. */
static enum modal_status refine(struct curve *c, double value, const double complex *X,
                                const struct stability *st, struct modal_error *err)
{
    double a = c->last_value, b = value, where = NAN, there = NAN;
    double least = REFINED * fabs(c->range.to - c->range.from);
    int base = unstable(&c->before) < unstable(st) ? unstable(&c->before) : unstable(st);
    bool rises = unstable(st) > unstable(&c->before);
    size_t size = (size_t)c->last_q * ((size_t)c->last_H + 1);
    double complex *Y = malloc((size + 1) * sizeof *Y), mu = changed(&c->before, st);
    enum modal_status rc =
        Y != NULL ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "curve: no memory");
    const char *type;
    cJSON *event;

    for (int i = 0; rc == MODAL_OK && i < REFINE_MOST && fabs(b - a) > least; i++) {
        double middle = 0.5 * (a + b), share = (middle - c->last_value) / (value - c->last_value),
               omega = 0;
        struct steady_start start = { c->last_q, c->last_H, Y };
        struct steady_point point = { 0 };
        struct stability here = { 0 };

        for (size_t e = 0; e < size; e++)
            Y[e] = c->last[e] + share * (X[e] - c->last[e]);
        rc = session_at(c, middle, &omega, err);
        if (rc == MODAL_OK)
            rc = steady_solve(c->s, omega, &start, &point, err);
        if (rc == MODAL_OK && point.converged)
            rc = stability_of(c->s, &point, &here, err);
        if (rc == MODAL_OK && here.count > base) {
            where = middle;
            there = omega;
            mu = here.multiplier[base];
            if ((unstable(&here) > base) == rises)
                b = middle;
            else
                a = middle;
        } else
            i = REFINE_MOST;
        stability_done(&here);
        steady_point_done(&point);
    }
    free(Y);
    if (rc != MODAL_OK)
        return rc;
    type = fabs(cimag(mu)) > REAL ? "neimark_sacker"
           : creal(mu) < 0        ? "period_doubling"
                                  : "branch_point";
    if (type[0] == 'b' && c->number - c->bare_fold <= NEAR) {
        c->bare_fold = -NEAR;
        return MODAL_OK;
    }
    c->lone_branch = type[0] == 'b' ? c->number : -NEAR;
    event = cJSON_CreateObject();
    cJSON_AddStringToObject(event, "type", type);
    json_set_number(event, c->range.path, isnan(where) ? (c->last_value + value) / 2 : (a + b) / 2);
    if (type[0] == 'n' && there > 0)                   /* arg mu over a period */
        json_set_number(event, "second_tone", fabs(carg(mu)) * there / (2 * M_PI));
    cJSON_AddItemToArray(c->bifurcations, event);
    return MODAL_OK;
}

/*
 * At a fold one multiplier passes 1.  Multipliers are the exact motion's, folds the truncated
 * one's, so that the two may come some points apart: a branch point beside a fold at which no
 * multiplier passed is that fold, and not told twice.
 */
static void pair_fold(struct curve *c)
{
    if (c->number - c->lone_branch <= NEAR) {
        cJSON_DeleteItemFromArray(c->bifurcations, cJSON_GetArraySize(c->bifurcations) - 1);
        c->lone_branch = -NEAR;
    } else
        c->bare_fold = c->number;
}

static enum modal_status on_point(void *context, const struct path_point *path, struct balance *b,
                                  bool *stop, struct modal_error *err)
{
    struct curve *c = context;
    struct steady_point point = { 0 };
    struct stability st = { 0 };
    double fraction = fmin(1, fmax(0, (path->lambda - c->range.from)
                                          / (c->range.to - c->range.from)));
    enum modal_status rc;

    (void)stop;
    rc = point_of(c, b, path->X, path->iterations, &point, err);
    if (rc == MODAL_OK)
        rc = steady_estimate_point(c->s, &point, err);
    if (rc == MODAL_OK && c->settings->stability)
        rc = stability_of(c->s, &point, &st, err);
    cost_stage(c->cost, "solve");
    if (rc == MODAL_OK)
        rc = add_point(c, path->lambda, fraction, &point, &st, err);
    c->number++;
    if (rc == MODAL_OK && c->before.count > 0 && st.count == c->before.count && c->last != NULL) {
        bool changed_here = unstable(&st) != unstable(&c->before),
             fold = !(path->turn * c->last_turn > 0);

        if (changed_here && !fold)
            rc = refine(c, path->lambda, point.X, &st, err);
        else if (fold && !changed_here)
            pair_fold(c);
    }
    if (rc == MODAL_OK) {
        set_last(c, &point);
        stability_done(&c->before);
        c->before = st;
        st = (struct stability) { 0 };
        c->last_value = path->lambda;
        c->last_turn = path->turn;
    }
    stability_done(&st);
    steady_point_done(&point);
    return rc;
}

static enum modal_status on_special(void *context, enum path_special kind,
                                    const struct path_point *path, struct balance *b,
                                    struct modal_error *err)
{
    struct curve *c = context;
    cJSON *event;

    (void)b;
    (void)err;
    if (kind != PATH_FOLD)
        return MODAL_OK;                    /* branch points show in the multipliers */
    event = cJSON_CreateObject();
    json_set_number(event, c->range.path, path->lambda);
    cJSON_AddItemToArray(c->folds, event);
    return MODAL_OK;
}

static bool path_cancelled(void *context)
{
    return job_cancelled(((const struct curve *)context)->request);
}

static enum modal_status follow(struct curve *c, cJSON *doc, struct modal_error *err)
{
    struct path_problem problem = { .at = balance_at, .point = on_point, .special = on_special,
                                    .cancelled = path_cancelled, .context = c,
                                    .from = c->range.from,
                                    .to = c->range.to, .points_most = PATH_POINTS_MOST };
    struct path_report report = { 0 };
    struct steady_point first = { 0 };
    double omega = 0;
    enum modal_status rc = session_at(c, c->range.from, &omega, err);

    if (rc == MODAL_OK)
        rc = set_out(c, err);
    if (rc == MODAL_OK)
        rc = steady_solve(c->s, omega,
                          c->last != NULL ? &(struct steady_start){ c->last_q, c->last_H, c->last }
                                          : NULL,
                          &first, err);
    if (rc == MODAL_OK && !first.converged) {
        struct stability none = { 0 };

        report.reason = "there is no solution where the branch should set out";
        rc = add_point(c, c->range.from, 1, &first, &none, err);
    } else if (rc == MODAL_OK) {
        struct balance *b;
        /* laws that rest at the start act further on */
        int H = first.linear != NULL ? steady_first_order(c->s) : first.H;
        struct steady_start start = { first.q, first.H, first.X };

        c->H = c->settings->opt.harmonics > 0 ? c->settings->opt.harmonics
               : H < H_FOLLOWED_MOST          ? H
                                              : H_FOLLOWED_MOST;
        rc = steady_balance(c->s, c->H, &b, err);
        if (rc == MODAL_OK) {
            double complex *X = calloc((size_t)b->q * ((size_t)c->H + 1) + 1, sizeof *X);

            for (int i = 0; X != NULL && i < b->q; i++)
                for (int k = 0; k <= c->H && k <= start.H; k++)
                    X[i * (c->H + 1) + k] = start.X[i * (start.H + 1) + k];
            rc = X == NULL ? modal_fail(err, MODAL_NO_MEMORY, "curve: no memory")
                           : path_follow(&problem, X, &report, err);
            free(X);
        }
    }
    cost_stage(c->cost, "solve");
    if (rc == MODAL_OK) {
        cJSON_AddBoolToObject(doc, "complete", report.complete);
        if (report.reason != NULL)
            cJSON_AddStringToObject(doc, "reason", report.reason);
    }
    steady_point_done(&first);
    return rc;
}

static bool rigid_alone(const struct program *p, const struct steady_options *opt)
{
    bool rigid = p->laws > 0 && p->harmonics == 0 && opt->method == STEADY_AUTO && cycle_takes(p);

    for (int l = 0; l < p->laws; l++)
        rigid &= p->law[l].kind->set_valued;
    return rigid;
}

static enum modal_status march(struct curve *c, cJSON *doc, struct modal_error *err)
{
    enum modal_status rc;
    const cJSON *point;
    bool complete = true;

    c->range.count = MARCHED;
    rc = sweep(c, err);
    cJSON_ArrayForEach(point, c->points)
        complete &= cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(point, "converged"));
    if (rc == MODAL_OK)
        cJSON_AddBoolToObject(doc, "complete", complete);
    if (rc == MODAL_OK && !complete)
        cJSON_AddStringToObject(doc, "reason", "at some points no periodic motion was found");
    return rc;
}

static void curve_done(struct curve *c)
{
    steady_free(c->s);
    if (c->here != c->p)
        program_free(c->here);
    cJSON_Delete(c->scene);
    free(c->last);
    stability_done(&c->before);
}

enum modal_status curve_run(const struct job_request *request, struct program *p,
                            struct steady_settings *settings, struct cost *cost, cJSON **doc,
                            struct modal_error *err)
{
    struct curve c = { .request = request, .settings = settings, .cost = cost, .p = p, .here = p,
                       .lone_branch = -NEAR, .bare_fold = -NEAR };
    bool counted = settings->sweep != NULL;
    cJSON *out = cJSON_CreateObject(), *plan;
    enum modal_status rc = parse(&c, counted ? settings->sweep : settings->follow,
                                 counted ? "sweep" : "continue", counted, err);

    settings->opt.estimate_later = settings->opt.harmonics > 0;
    cJSON_AddStringToObject(out, "kind", "curve");
    cJSON_AddStringToObject(out, "parameter", c.range.path);
    c.points = cJSON_AddArrayToObject(out, "points");
    c.folds = cJSON_AddArrayToObject(out, "folds");
    c.bifurcations = cJSON_AddArrayToObject(out, "bifurcations");
    if (rc == MODAL_OK && !c.omega) {
        c.scene = cJSON_Duplicate(request->scene, 1);
        rc = c.scene == NULL ? modal_fail(err, MODAL_NO_MEMORY, "curve: no memory") : MODAL_OK;
    }
    if (rc == MODAL_OK)
        rc = counted                          ? sweep(&c, err)
             : rigid_alone(p, &settings->opt) ? march(&c, out, err)
                                              : follow(&c, out, err);
    if (rc == MODAL_CANCELLED && c.done > 0) {          /* what was found before is the answer */
        cJSON_AddFalseToObject(out, "complete");
        cJSON_AddStringToObject(out, "reason", JOB_STOPPED);
        rc = MODAL_OK;
    }
    if (rc == MODAL_OK) {
        plan = plan_print(p, counted ? "sweep" : "continuation");
        cJSON_AddNumberToObject(plan, "ffts", (double)c.ffts);
        cJSON_AddNumberToObject(plan, "iterations", c.iterations);
        plan_add_reduction(plan, c.s != NULL ? steady_reduction(c.s) : NULL);
        cJSON_AddItemToObject(out, "plan", plan);
        *doc = out;
        out = NULL;
    }
    cJSON_Delete(out);
    curve_done(&c);
    return rc;
}
