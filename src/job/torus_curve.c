/*
 * torus_curve.c - steady states under several tones over one number
 *
 * Each point begins at the one before it, so that of several motions the branch goes on; where
 * that leads nowhere, at rest.  A tone is `tones[J]`, wherever it was given; any other path is one
 * of the scene, which is lowered anew.  Where two tones meet, no point: one omega says it.
 *
 * A branch is followed by its length, in the space of the combinations' motion over the largest and
 * of the value over its range.  The next place is foreseen by the parabola through the last three,
 * value and motion, and balanced at its value from its motion: beyond a fold the parabola has
 * turned back, and the solution near its motion is the branch's other half.  One that is not near
 * is of another branch, and the step is tried at other lengths: a shorter one where the branch
 * bends, a longer one where the place foreseen is beyond the fold.  The fold is the vertex of the
 * parabola through the three places about it, drawn closer.
 *
 * Tested by tests/system/test_tones.py.
 */
#include "job/torus_curve.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
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

enum {
    POINTS_MOST = 1000,          /* of a branch: each costs what a steady state does */
    TRAIL = 3,                   /* of a parabola */
    SETTING_OUT = 8,             /* times that the first step is shortened */
};
static const double FIRST = 0.01;         /* of the range: the first step */
static const double SHORTER = 0.25;       /* of it, where it leads nowhere */
static const double LONGEST = 0.1;        /* of a branch's length: a curve is drawn by ten points */
static const double OFF = 0.3;            /* of a step that a place foreseen may be off: on the same
                                           * branch a parabola is off by less, or it is too long */
static const double AHEAD = 0.9;          /* cosine: a line through two places may be off in length
                                           * where the branch bends, not in direction */
static const double GOOD = 0.03;          /* of a step: then the next is LONGER */
static const double LONGER = 1.5;         /* then off by 1.5^3 of that, and well within OFF */
static const double TRIES[] = { 1, 0.5, 0.25, 2, 0.1, 3, 0.03 };    /* of a step that led nowhere */
static const double CLOSER = 0.08;        /* of the trail: the vertex is off by its cube */

/* A place of a branch: MOTION owns what it has, ALONG is the branch's length so far. */
struct place { struct torus_point motion; double value, along; };

struct torus_sweep {
    const struct job_request *request;
    struct steady_settings settings;      /* a copy, whose tones move; what it points to is not */
    struct cost *cost;
    struct program *p;                    /* of the scene as given: counts and names */
    struct curve_range range;
    int tone;                             /* that is swept; -1: a number of the scene */
    cJSON *scene, *points, *folds;        /* scene: a copy to change */
    struct torus_point last;              /* the last that converged, none where q is 0 */
    int iterations, done;
    struct place trail[TRAIL];            /* of a branch, the last place last */
    int trailing;
    double largest;                       /* m: of its motions */
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
    bool counted = w->settings.sweep != NULL;
    const char *option = counted ? "sweep" : "continue";
    enum modal_status rc = curve_range_read(counted ? w->settings.sweep : w->settings.follow,
                                            option, counted, &w->range, err);
    int count = w->settings.tones_count;

    if (rc != MODAL_OK)
        return rc;
    w->tone = tone_of(w->range.path);
    if (w->tone >= count || (w->tone >= 0 && w->tone + 1 == w->settings.free_tone))
        return modal_fail_field(err, MODAL_BAD_INPUT, option,
                                "%s is no tone that is given; accepted: tones[0] to tones[%d], "
                                "but one that is free", w->range.path, count - 1);
    if (w->tone >= 0 && !(w->range.from > 0 && w->range.to > 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, option, "%s from %g to %g; accepted: > 0",
                                w->range.path, w->range.from, w->range.to);
    if (strcmp(w->range.path, "omega") == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, option,
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
    rc = scene_path_set(w->scene, w->range.path, value,
                        w->settings.sweep != NULL ? "sweep" : "continue", err);
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
    rc = torus_at(here, &w->settings, w->last.q > 0 ? &w->last : NULL, false, point, err);
    if (rc == MODAL_OK && !point->converged && w->last.q > 0) {
        torus_count(w->p, point);
        torus_point_done(point);
        rc = torus_at(here, &w->settings, NULL, false, point, err);
    }
    return rc;
}

/* Printed and told. */
static void print_point(struct torus_sweep *w, double fraction, double value,
                        const struct program *here, const struct torus_point *point)
{
    cJSON *doc = torus_print(here, &w->settings, point);

    json_set_number(doc, "value", value);
    cJSON_AddItemToArray(w->points, doc);
    torus_count(w->p, point);
    w->iterations += point->iterations;
    w->done++;
    curve_report(w->request, &w->range, fraction, value, point->converged, point->amplitude,
                 point->stability.verdict);
    cost_stage(w->cost, "print");
}

/* Printed and, where it converged, the last: POINT is W's then. */
static void add_point(struct torus_sweep *w, int i, double value, const struct program *here,
                      struct torus_point *point)
{
    print_point(w, (i + 1.0) / w->range.count, value, here, point);
    if (point->converged && point->q > 0) {
        torus_point_done(&w->last);
        w->last = *point;
    } else
        torus_point_done(point);
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

/* Of A's motion combination K, told with either sign, of dof I. */
static double complex motion_at(const struct torus_point *a, struct torus_index k, int i)
{
    struct torus_index other = { { -k.k[0], -k.k[1], -k.k[2] } };

    for (int m = 0; m < a->count; m++) {
        double complex X = a->start[(size_t)i * (size_t)a->count + (size_t)m];

        if (torus_equal(a->index[m], k))
            return X;
        if (torus_equal(a->index[m], other))
            return conj(X);
    }
    return 0;
}

/* (z_b - z_a) . (z_d - z_c) of the space that a branch's length is of. */
static double product(const struct torus_sweep *w, const struct place *a, const struct place *b,
                      const struct place *c, const struct place *d)
{
    double range = w->range.to - w->range.from;
    double sum = (b->value - a->value) / range * (d->value - c->value) / range;

    for (int m = 0; m < b->motion.count; m++)
        for (int i = 0; i < b->motion.q; i++) {
            struct torus_index k = b->motion.index[m];
            double complex one = motion_at(&b->motion, k, i) - motion_at(&a->motion, k, i),
                           two = motion_at(&d->motion, k, i) - motion_at(&c->motion, k, i);

            sum += creal(one * conj(two)) / (w->largest * w->largest);
        }
    return sum;
}

static double distance(const struct torus_sweep *w, const struct place *a, const struct place *b)
{
    return sqrt(fmax(product(w, a, b, a, b), 0));
}

/* What the trail's places weigh in the parabola, or the line, through them at ALONG. */
static void weigh(const struct torus_sweep *w, double along, double *weight)
{
    for (int a = 0; a < w->trailing; a++) {
        weight[a] = 1;
        for (int b = 0; b < w->trailing; b++)
            if (b != a)
                weight[a] *= (along - w->trail[b].along) / (w->trail[a].along - w->trail[b].along);
    }
}

/* The place foreseen at ALONG, on the last one's combinations, which it borrows; its motion is the
 * caller's to free. */
static enum modal_status foresee(const struct torus_sweep *w, double along, struct place *to,
                                 struct modal_error *err)
{
    const struct torus_point *last = &w->trail[w->trailing - 1].motion;
    int tone = w->settings.free_tone - 1;
    size_t K = (size_t)last->count;
    double weight[TRAIL];

    weigh(w, along, weight);
    *to = (struct place) { .motion = *last, .along = along };
    to->motion.marched = false;
    to->motion.start = calloc((size_t)last->q * K + 1, sizeof *to->motion.start);
    if (to->motion.start == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "curve: no memory");
    if (tone >= 0)
        to->motion.tones.omega[tone] = 0;
    for (int a = 0; a < w->trailing; a++) {
        to->value += weight[a] * w->trail[a].value;
        if (tone >= 0)
            to->motion.tones.omega[tone] += weight[a] * w->trail[a].motion.tones.omega[tone];
        for (int i = 0; i < last->q; i++)
            for (size_t m = 0; m < K; m++)
                to->motion.start[(size_t)i * K + m] +=
                    weight[a] * motion_at(&w->trail[a].motion, last->index[m], i);
    }
    return MODAL_OK;
}

/* The place at VALUE that is balanced from START's motion, NULL: wherever it is, into TO; *HERE its
 * program, freed by leave().  Its motion is whole whether it converged or not. */
static enum modal_status balance_at(struct torus_sweep *w, double value,
                                    const struct torus_point *start, struct program **here,
                                    struct place *to, struct modal_error *err)
{
    enum modal_status rc = lower_at(w, value, here, err);

    *to = (struct place) { .value = value };
    if (rc == MODAL_OK && job_cancelled(w->request))
        rc = modal_fail(err, MODAL_CANCELLED, "cancelled at point %d", w->done);
    if (rc == MODAL_OK && torus_alike(&w->settings))
        to->motion = (struct torus_point) { .reason = "two tones are the same here" };
    else if (rc == MODAL_OK)
        rc = torus_at(*here, &w->settings, start, start != NULL, &to->motion, err);
    cost_stage(w->cost, "solve");
    return rc;
}

static void leave(const struct torus_sweep *w, struct program *here)
{
    if (here != w->p)
        program_free(here);
}

/* PLACE at the trail's end, told: its motion is the trail's. */
static void go_to(struct torus_sweep *w, const struct program *here, struct place *place)
{
    double size = 0;

    for (int e = 0; e < place->motion.q * place->motion.count; e++)
        size += pow(cabs(place->motion.start[e]), 2);
    w->largest = fmax(w->largest, sqrt(size));
    if (w->trailing > 0)
        place->along = w->trail[w->trailing - 1].along
            + distance(w, &w->trail[w->trailing - 1], place);
    if (w->trailing == TRAIL) {
        torus_point_done(&w->trail[0].motion);
        memmove(w->trail, w->trail + 1, (TRAIL - 1) * sizeof *w->trail);
        w->trailing--;
    }
    w->trail[w->trailing++] = *place;
    print_point(w, (place->value - w->range.from) / (w->range.to - w->range.from), place->value,
                here, &place->motion);
}

/* The value where the parabola through three places, AT along their chord, turns; *WHERE. */
static double vertex(const double *at, const double *value, double *where)
{
    double s = (value[1] - value[0]) / (at[1] - at[0]), t = (value[2] - value[1]) / (at[2] - at[1]);
    double bend = (t - s) / (at[2] - at[0]);

    *where = 0.5 * (at[0] + at[1] - s / bend);
    return value[0] + (*where - at[0]) * (s + bend * (*where - at[1]));
}

/* Along the trail's chord. */
static double along_chord(const struct torus_sweep *w, const struct place *to)
{
    return product(w, &w->trail[0], to, &w->trail[0], &w->trail[TRAIL - 1])
        / distance(w, &w->trail[0], &w->trail[TRAIL - 1]);
}

/* A place ALONG the trail, where it is along the chord and its value; *FOUND false: none near. */
static enum modal_status probe(struct torus_sweep *w, double along, double *at, double *value,
                               bool *found, struct modal_error *err)
{
    struct program *here = NULL;
    struct place seen, to = { 0 };
    enum modal_status rc = foresee(w, along, &seen, err);

    if (rc != MODAL_OK)
        return rc;
    rc = balance_at(w, seen.value, &seen.motion, &here, &to, err);
    *found = rc == MODAL_OK && to.motion.converged
        && distance(w, &seen, &to) < OFF * distance(w, &w->trail[0], &w->trail[TRAIL - 1]);
    if (*found) {
        *at = along_chord(w, &to);
        *value = to.value;
    }
    if (rc == MODAL_OK)
        torus_count(w->p, &to.motion);
    torus_point_done(&to.motion);
    free(seen.motion.start);
    leave(w, here);
    return rc;
}

/* Where the value turned among the trail's places: the vertex of the parabola through three nearer
 * ones, or where these are not found through the trail's own. */
static enum modal_status find_fold(struct torus_sweep *w, struct modal_error *err)
{
    static const double about[TRAIL] = { -2, -1, 1 };
    double along[TRAIL], value[TRAIL], at[TRAIL], near[TRAIL], where, fold, closer;
    bool found = true;
    cJSON *event;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < TRAIL; i++)
        along[i] = w->trail[i].along, value[i] = w->trail[i].value;
    fold = vertex(along, value, &where);
    closer = CLOSER * (along[TRAIL - 1] - along[0]);
    for (int i = 0; rc == MODAL_OK && found && i < TRAIL; i++)
        rc = probe(w, where + about[i] * closer, &at[i], &near[i], &found, err);
    if (rc != MODAL_OK)
        return rc;
    if (found && (near[1] - near[0]) * (near[2] - near[1]) != 0)
        fold = vertex(at, near, &where);
    event = cJSON_CreateObject();
    json_set_number(event, w->range.path, fold);
    cJSON_AddItemToArray(w->folds, event);
    return MODAL_OK;
}

/* The first two places of a branch, told; *REASON: why there are none. */
static enum modal_status set_out(struct torus_sweep *w, const char **reason,
                                 struct modal_error *err)
{
    struct program *here = NULL;
    struct place to;
    double step = FIRST * (w->range.to - w->range.from);
    enum modal_status rc = balance_at(w, w->range.from, NULL, &here, &to, err);

    if (rc == MODAL_OK && to.motion.converged && to.motion.marched) {
        struct place marched = to;             /* the branch is of balances */

        rc = torus_at(here, &w->settings, &marched.motion, true, &to.motion, err);
        torus_count(w->p, &marched.motion);
        torus_point_done(&marched.motion);
    }
    if (rc == MODAL_OK && to.motion.converged && to.motion.q > 0)
        go_to(w, here, &to);
    else if (rc == MODAL_OK) {
        *reason = "there is no solution where the branch should set out";
        print_point(w, 0, to.value, here, &to.motion);
        torus_point_done(&to.motion);
    }
    leave(w, here);
    for (int i = 0; rc == MODAL_OK && *reason == NULL && w->trailing < 2; i++, step *= SHORTER) {
        here = NULL;
        rc = balance_at(w, w->range.from + step, &w->trail[0].motion, &here, &to, err);
        if (rc == MODAL_OK && to.motion.converged && distance(w, &w->trail[0], &to) < LONGEST)
            go_to(w, here, &to);
        else if (rc == MODAL_OK) {
            torus_count(w->p, &to.motion);
            torus_point_done(&to.motion);
            *reason = i + 1 < SETTING_OUT ? NULL : "the branch has no place near where it sets out";
        }
        leave(w, here);
    }
    return rc;
}

/* How far from TO a place foreseen may be for the errors of both alone: those of the trail's places
 * go into it as their motions do. */
static double unsure(const struct torus_sweep *w, double along, const struct place *to)
{
    double weight[TRAIL], sum = to->motion.error;

    weigh(w, along, weight);
    for (int a = 0; a < w->trailing; a++)
        sum += fabs(weight[a]) * w->trail[a].motion.error;
    return sum / w->largest;
}

/* Whether TO, from SEEN at LENGTH, is the branch's next place; *OFF: their distance, less what
 * their errors may make of it. */
static bool is_next(const struct torus_sweep *w, const struct place *seen, const struct place *to,
                    double length, bool ended, double *off)
{
    const struct place *last = &w->trail[w->trailing - 1];
    double far = distance(w, last, to);

    *off = fmax(distance(w, seen, to) - unsure(w, last->along + length, to), 0);
    if (!(far > 0) || !(product(w, last, to, &w->trail[w->trailing - 2], last) > 0))
        return false;
    return *off < OFF * length || (ended && far < length)
        || (w->trailing < TRAIL && far < 2 * length
            && product(w, last, to, last, seen) > AHEAD * far * distance(w, last, seen));
}

/* One place further, STEP along, which becomes the next step; *ENDED: it is the end, or *REASON. */
static enum modal_status go_on(struct torus_sweep *w, double *step, bool *ended,
                               const char **reason, struct modal_error *err)
{
    const struct place *last = &w->trail[w->trailing - 1];
    double low = fmin(w->range.from, w->range.to), high = fmax(w->range.from, w->range.to);
    bool gone = false;
    enum modal_status rc = MODAL_OK;

    for (size_t t = 0; rc == MODAL_OK && !gone && t < sizeof TRIES / sizeof *TRIES; t++) {
        double length = fmin(*step * TRIES[t], LONGEST), off;
        struct program *here = NULL;
        struct place seen, to = { 0 };

        rc = foresee(w, last->along + length, &seen, err);
        if (rc != MODAL_OK)
            return rc;
        *ended = seen.value < low || seen.value > high;
        seen.value = fmin(fmax(seen.value, low), high);
        rc = balance_at(w, seen.value, &seen.motion, &here, &to, err);
        if (rc == MODAL_OK && to.motion.converged) {
            gone = is_next(w, &seen, &to, length, *ended, &off);
            if (gone)
                *step = off < GOOD * length ? LONGER * length : length;
        }
        free(seen.motion.start);
        if (gone)
            go_to(w, here, &to);
        else if (rc == MODAL_OK) {
            torus_count(w->p, &to.motion);
            torus_point_done(&to.motion);
        }
        leave(w, here);
    }
    if (rc == MODAL_OK && !gone)
        *reason = "no place of the branch was found further on";
    *ended &= gone;
    return rc;
}

/* Whether the value turned among the trail's places. */
static bool turned_back(const struct torus_sweep *w)
{
    const struct place *t = w->trail;

    return w->trailing == TRAIL && (t[1].value - t[0].value) * (t[2].value - t[1].value) < 0;
}

/* The branch from the range's first value to either of its ends. */
static enum modal_status follow(struct torus_sweep *w, cJSON *doc, struct modal_error *err)
{
    const char *reason = NULL;
    bool ended = false;
    double step = 0;
    enum modal_status rc = set_out(w, &reason, err);

    if (rc == MODAL_OK && reason == NULL)
        step = w->trail[1].along;
    while (rc == MODAL_OK && reason == NULL && !ended) {
        rc = go_on(w, &step, &ended, &reason, err);
        if (rc == MODAL_OK && reason == NULL && turned_back(w))
            rc = find_fold(w, err);
        if (reason == NULL && !ended && w->done >= POINTS_MOST)
            reason = "the points allowed are used up";
    }
    if (ended && w->trail[w->trailing - 1].value != w->range.to)
        reason = "the branch turned back to where it set out";
    if (rc == MODAL_OK) {
        cJSON_AddBoolToObject(doc, "complete", reason == NULL);
        if (reason != NULL)
            cJSON_AddStringToObject(doc, "reason", reason);
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
    w.folds = cJSON_AddArrayToObject(out, "folds");
    cJSON_AddArrayToObject(out, "bifurcations");
    if (rc == MODAL_OK)
        rc = settings->sweep != NULL ? sweep(&w, err) : follow(&w, out, err);
    if (rc == MODAL_CANCELLED && w.done > 0) {        /* what was found before is the answer */
        cJSON_AddFalseToObject(out, "complete");
        cJSON_AddStringToObject(out, "reason", JOB_STOPPED);
        rc = MODAL_OK;
    }
    if (rc == MODAL_OK) {
        plan = plan_print(p, settings->sweep != NULL ? "sweep" : "continuation");
        cJSON_AddNumberToObject(plan, "iterations", w.iterations);
        cJSON_AddItemToObject(out, "plan", plan);
        *doc = out;
        out = NULL;
    }
    cJSON_Delete(out);
    cJSON_Delete(w.scene);
    torus_point_done(&w.last);
    for (int i = 0; i < w.trailing; i++)
        torus_point_done(&w.trail[i].motion);
    return rc;
}
