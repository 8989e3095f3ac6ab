/*
 * tradeoff_tones.c - see tradeoff_tones.h; tested by tests/system/test_tones.py
 *
 * The reference is time integration at TOLERANCE.  It begins where the finest answer has the motion
 * at t = 0, and runs on until what it begins with wrongly, memories of sliders and what that answer
 * misses, has decayed to rounding by the answer's own exponent m, log(1 / DBL_EPSILON) / m; that is
 * left out.  Errors are max |x - ref| / max |ref| over the COMPARED turns after that and the
 * reported dofs.  Seconds are those of the solution alone, each rung from rest.
 */
#include "job/tradeoff_tones.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "job/steady_settings.h"
#include "job/torus_job.h"
#include "job/tradeoff_print.h"
#include "modal/scene/program.h"
#include "modal/scene/scene.h"
#include "modal/scene/simulate.h"
#include "modal/scene/sparse_motion.h"
#include "modal/steady/torus_solve.h"

enum {
    SAMPLES = 16,             /* of a turn: max |x - ref| of what has eight harmonics and more */
    COMPARED = 256,           /* turns: of tones one in 100 apart more than two beats */
    SETTLING_LEAST = 64,      /* turns left out, where much is damped: sliders' history */
    SETTLING_MOST = 8192,     /* where little is: some seconds of a march */
};
static const double TOLERANCE = 1e-11;    /* of the reference's steps: a hundredth of the finest
                                           * rung's target */
static const double FINEST = 1e-8;        /* target of the answer that the reference begins at */

/* All combinations of an order, then grown until an error. */
static const struct tones_rung { int harmonics; double target; } ladder[] = {
    { 3, 0 }, { 5, 0 }, { 7, 0 }, { 9, 0 }, { 0, 1e-2 }, { 0, 1e-3 }, { 0, 1e-4 }, { 0, 1e-5 },
    { 0, 1e-6 }, { 0, 1e-7 }, { 0, 1e-8 },
};
enum { RUNGS = sizeof ladder / sizeof *ladder };

struct tones_climb {
    const struct job_request *request;
    struct program *p;
    struct steady_settings settings;
    int rungs, turns;                     /* turns left out of the reference */
    struct scene_time time;               /* of what is compared */
    double *reference, scale;             /* [sample dofs + dof]; its largest */
    double aside;                         /* s: of comparisons, which are no rung's */
};

/* max |x - reference| over scale of POINT, whose waves turn from sample to sample. */
static enum modal_status error_of(const struct tones_climb *t, const struct torus_point *point,
                                  double *error, struct modal_error *err)
{
    size_t K = (size_t)point->count, dofs = (size_t)t->settings.dofs_count;
    double complex *wave = malloc(2 * K * sizeof *wave), *hop = wave + K;

    if (wave == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "tradeoff: no memory");
    for (size_t k = 0; k < K; k++) {
        double w = torus_frequency(&point->tones, point->index[k]);

        wave[k] = cexp(I * fmod(w * t->time.start, 2 * M_PI));
        hop[k] = cexp(I * w * t->time.dt);
    }
    *error = 0;
    for (long n = 0; n < t->time.samples; n++) {
        for (size_t i = 0; i < dofs; i++) {
            double x = -t->reference[(size_t)n * dofs + i];

            for (size_t k = 0; k < K; k++)
                x += creal(point->X[i * K + k] * wave[k]);
            *error = fmax(*error, fabs(x) / t->scale);
        }
        for (size_t k = 0; k < K; k++)
            wave[k] *= hop[k];
    }
    free(wave);
    return MODAL_OK;
}

static enum modal_status climb(void *context, int i, double *error, struct modal_error *err)
{
    struct tones_climb *t = context;
    struct steady_settings how = t->settings;
    struct torus_point point = { 0 };
    double begun;
    enum modal_status rc;

    how.opt.harmonics = ladder[i].harmonics;
    how.opt.target_error = ladder[i].target;
    how.stability = false;
    rc = torus_at(t->p, &how, NULL, false, &point, err);
    if (rc == MODAL_OK)
        torus_count(t->p, &point);
    if (rc == MODAL_OK && !point.converged)
        rc = modal_fail(err, MODAL_NO_CONVERGENCE, "this rung has no answer");
    begun = tradeoff_clock(NULL);
    if (rc == MODAL_OK)
        rc = error_of(t, &point, error, err);
    t->aside += tradeoff_clock(NULL) - begun;
    torus_point_done(&point);
    return rc;
}

static double clock_of_rungs(void *context)
{
    const struct tones_climb *t = context;

    return tradeoff_clock(NULL) - t->aside;
}

static void begins(void *context, int i)
{
    const struct tones_climb *t = context;

    tradeoff_report(t->request, i, t->rungs);
}

static bool was_cancelled(void *context)
{
    const struct tones_climb *t = context;

    return job_cancelled(t->request);
}

/* P's motion from POINT's at t = 0, which has all of its dofs, into t->reference. */
static enum modal_status march(struct tones_climb *t, const struct torus_point *point,
                               struct modal_error *err)
{
    int n = t->p->n, dofs = t->settings.dofs_count;
    struct program view = *t->p;
    struct simulate_options how = { .tolerance = TOLERANCE,
                                    .leaps = sparse_motion_strides(t->p, &t->time),
                                    .cancelled = t->settings.opt.cancelled,
                                    .context = t->settings.opt.context };
    struct simulate_result done = { 0 };
    struct triplet *term = calloc((size_t)dofs, sizeof *term);
    enum modal_status rc = MODAL_NO_MEMORY;

    view.outputs = dofs;
    view.output = calloc((size_t)dofs, sizeof *view.output);
    view.x0 = calloc((size_t)n, sizeof *view.x0);
    view.v0 = calloc((size_t)n, sizeof *view.v0);
    t->reference = calloc((size_t)t->time.samples * (size_t)dofs, sizeof *t->reference);
    if (term == NULL || view.output == NULL || view.x0 == NULL || view.v0 == NULL
        || t->reference == NULL) {
        modal_fail(err, MODAL_NO_MEMORY, "tradeoff: no memory");
        goto out;
    }
    view.omega = t->settings.tones[0];    /* what a load's k that is one number counts */
    for (int i = 0; i < dofs; i++) {
        term[i] = (struct triplet) { 0, t->settings.dofs[i], 1 };
        view.output[i] = (struct program_output) { view.dofs[t->settings.dofs[i]], &term[i], 1 };
    }
    for (int i = 0; i < n; i++)
        for (int k = 0; k < point->count; k++) {
            double complex X = point->X[(size_t)i * (size_t)point->count + (size_t)k];

            view.x0[i] += creal(X);
            view.v0[i] -= torus_frequency(&point->tones, point->index[k]) * cimag(X);
        }
    rc = simulate(&view, &t->time, &how, t->reference, &done, err);
    for (long e = 0; rc == MODAL_OK && e < t->time.samples * dofs; e++)
        t->scale = fmax(t->scale, fabs(t->reference[e]));
    if (rc == MODAL_OK && !(t->scale > 0))
        rc = modal_fail(err, MODAL_NO_CONVERGENCE,
                        "tradeoff: the steady state is rest; there is no error to measure");
out:
    free(term), free(view.output), free(view.x0), free(view.v0);
    return rc;
}

/* The turns left out and what is compared, of POINT's margin. */
static void lay_out(struct tones_climb *t, const struct torus_point *point)
{
    double turn = 2 * M_PI / point->tones.omega[point->tones.lead], most = SETTLING_MOST;
    double margin = point->stability.margin;

    if (point->stability.verdict > 0 && margin > 0)
        most = fmin(most, ceil(log(1 / DBL_EPSILON) / margin / turn));
    t->turns = (int)fmax(most, SETTLING_LEAST);
    t->time = (struct scene_time) { .dt = turn / SAMPLES, .start = t->turns * turn,
                                    .samples = (long)SAMPLES * COMPARED,
                                    .duration = (SAMPLES * COMPARED - 1) * turn / SAMPLES };
}

static enum modal_status find_reference(struct tones_climb *t, struct modal_error *err)
{
    struct steady_settings how = t->settings;
    struct torus_point point = { 0 };
    int *all = malloc((size_t)t->p->n * sizeof *all);
    enum modal_status rc;

    if (all == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "tradeoff: no memory");
    for (int i = 0; i < t->p->n; i++)
        all[i] = i;
    how.dofs = all, how.dofs_count = t->p->n;
    how.opt.harmonics = 0;
    how.opt.target_error = FINEST;
    how.stability = true;
    rc = torus_at(t->p, &how, NULL, false, &point, err);
    if (rc == MODAL_OK && !point.converged)
        rc = modal_fail(err, MODAL_NO_CONVERGENCE,
                        "tradeoff: no motion of these tones was found to measure errors against");
    if (rc == MODAL_OK && point.stability.verdict < 0)
        rc = modal_fail(err, MODAL_NO_CONVERGENCE, "tradeoff: the motion found is unstable; time "
                                                   "integration leaves it and measures no error");
    if (rc == MODAL_OK)
        lay_out(t, &point);
    if (rc == MODAL_OK)
        rc = march(t, &point, err);
    torus_point_done(&point);
    free(all);
    return rc;
}

static enum modal_status run(struct tones_climb *t, const struct tradeoff_wishes *wishes,
                             cJSON **doc, struct modal_error *err)
{
    struct ladder steps = { .rungs = t->rungs, .repetitions = wishes->repetitions,
                            .target_error = wishes->target, .target_seconds = wishes->seconds,
                            .climb = climb, .clock = clock_of_rungs, .cancelled = was_cancelled,
                            .begins = begins, .context = t };
    struct ladder_rung rungs[RUNGS];
    struct ladder_outcome outcome;
    cJSON *settings[RUNGS], *reference;
    enum modal_status rc = ladder_run(&steps, rungs, &outcome, err);

    if (rc != MODAL_OK)
        return rc;
    for (int i = 0; i < outcome.ran; i++) {
        settings[i] = cJSON_CreateObject();
        if (ladder[i].harmonics > 0)
            cJSON_AddNumberToObject(settings[i], "harmonics", ladder[i].harmonics);
        else
            cJSON_AddNumberToObject(settings[i], "target.error", ladder[i].target);
    }
    reference = cJSON_CreateObject();
    cJSON_AddStringToObject(reference, "method", "adaptive");
    cJSON_AddNumberToObject(reference, "tolerance", TOLERANCE);
    cJSON_AddNumberToObject(reference, "left_out_s", t->time.start);
    cJSON_AddNumberToObject(reference, "compared_s", t->time.duration);
    return tradeoff_print("steady", reference, settings, rungs, outcome.ran, outcome.recommended,
                          doc, err);
}

enum modal_status tradeoff_tones(const struct job_request *request, struct program *p,
                                 const struct steady_settings *settings,
                                 const struct tradeoff_wishes *wishes, cJSON **doc,
                                 struct modal_error *err)
{
    struct tones_climb t = { .request = request, .p = p, .settings = *settings };
    enum modal_status rc = torus_check(settings, err);

    if (rc == MODAL_OK && (settings->free_tone > 0 || torus_alike(settings)))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "tones",
                              "tones: a tradeoff takes two or three that are given and differ; the "
                              "phase of a free one is anybody's, and time integration has its own");
    if (rc == MODAL_OK)
        rc = find_reference(&t, err);
    t.rungs = p->laws > 0 ? RUNGS : 1;
    if (rc == MODAL_OK)
        rc = run(&t, wishes, doc, err);
    free(t.reference);
    return rc;
}
