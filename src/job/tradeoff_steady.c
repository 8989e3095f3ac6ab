/*
 * tradeoff_steady.c - see tradeoff_steady.h
 *
 * Errors are max over time and dofs of |x - ref| / max |ref|, the reference being the steady state
 * of REFERENCE_H harmonics (fewer for many dofs), itself orders finer than any rung.  Seconds are
 * those of the solution alone, each rung from rest; of a reduction with its modes, and its error
 * is that of the dofs which it keeps.
 */
#include "job/tradeoff_steady.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "job/cost.h"
#include "job/plan.h"
#include "job/steady_print.h"
#include "job/steady_settings.h"
#include "job/tradeoff_print.h"
#include "job/tradeoff_tones.h"
#include "modal/scene/orbit.h"
#include "modal/scene/scene.h"
#include "modal/steady/condense.h"
#include "modal/steady/solve.h"

enum {
    REFERENCE_H = 384,               /* harmonics: three times the finest rung's */
    REFERENCE_H_LEAST = 64,          /* below it rungs would be as fine as the reference */
    REFERENCE_UNKNOWNS = 1600,       /* of its balance: a Jacobian of 20 MB, factored in a second */
    RUNGS_MOST = 48                  /* room for the table of rungs (34) and some more */
};

static const struct rung {
    enum steady_method method;
    int harmonics, samples;
    bool sampled;                 /* located: false */
    double cutoff, tolerance;
    int reduce;                   /* modes, where there are more dofs to reduce */
    double krylov;                /* of a basis, where there are many linear dofs */
} ladder_rungs[] = {
    { STEADY_AUTO, 4, 0, false, 0, 0, 0, 0 }, { STEADY_AUTO, 8, 0, false, 0, 0, 0, 0 },
    { STEADY_AUTO, 16, 0, false, 0, 0, 0, 0 }, { STEADY_AUTO, 32, 0, false, 0, 0, 0, 0 },
    { STEADY_AUTO, 32, 0, false, 0, 0, 0, 1e-2 }, { STEADY_AUTO, 32, 0, false, 0, 0, 0, 1e-4 },
    { STEADY_AUTO, 32, 0, false, 0, 0, 0, 1e-6 },
    { STEADY_AUTO, 32, 0, false, 0, 0, 10, 0 }, { STEADY_AUTO, 32, 0, false, 0, 0, 20, 0 },
    { STEADY_AUTO, 32, 0, false, 0, 0, 40, 0 }, { STEADY_AUTO, 32, 0, false, 0, 0, 80, 0 },
    { STEADY_AUTO, 64, 0, false, 0, 0, 0, 0 }, { STEADY_AUTO, 128, 0, false, 0, 0, 0, 0 },
    { STEADY_NEWTON, 16, 0, false, 1e-3, 0, 0, 0 }, { STEADY_NEWTON, 64, 0, false, 1e-3, 0, 0, 0 },
    { STEADY_DIRECT, 16, 0, false, 0, 1e-6, 0, 0 }, { STEADY_DIRECT, 64, 0, false, 0, 1e-8, 0, 0 },
    { STEADY_DIRECT, 31, 64, true, 0, 1e-6, 0, 0 },
    { STEADY_DIRECT, 127, 256, true, 0, 1e-6, 0, 0 },
    { STEADY_NEWTON, 31, 64, true, 0, 0, 0, 0 }, { STEADY_NEWTON, 31, 256, true, 0, 0, 0, 0 },
    { STEADY_NEWTON, 63, 128, true, 0, 0, 0, 0 }, { STEADY_NEWTON, 63, 1024, true, 0, 0, 0, 0 },
    { STEADY_NEWTON, 63, 4096, true, 0, 0, 0, 0 }, { STEADY_RK4, 0, 64, false, 0, 0, 0, 0 },
    { STEADY_RK4, 0, 256, false, 0, 0, 0, 0 }, { STEADY_RK4, 0, 1024, false, 0, 0, 0, 0 },
    { STEADY_RK4, 0, 4096, false, 0, 0, 0, 0 }, { STEADY_ADAPTIVE, 0, 256, false, 0, 1e-4, 0, 0 },
    { STEADY_ADAPTIVE, 0, 256, false, 0, 1e-6, 0, 0 },
    { STEADY_ADAPTIVE, 0, 256, false, 0, 1e-8, 0, 0 },
    { STEADY_SHOOTING, 0, 256, false, 0, 0, 0, 0 }, { STEADY_SHOOTING, 0, 1024, false, 0, 0, 0, 0 },
    { STEADY_SHOOTING, 0, 4096, false, 0, 0, 0, 0 },
};
static const char *const names[] = { "auto", "direct", "newton", "rk4", "adaptive", "shooting" };

struct tradeoff {
    struct program *p;
    struct steady_options base;
    const struct rung *rung[RUNGS_MOST];
    int rungs, H;
    double complex *reference;             /* of each reported dof, H+1 */
    bool *kept;                            /* of each of them, by a reduction */
    double scale;
    const struct job_request *request;
};

static struct steady_options options_of(const struct tradeoff *t, const struct rung *r)
{
    struct steady_options opt = t->base;

    opt.method = r->method;
    opt.harmonics = r->harmonics;
    opt.samples = r->samples;
    opt.unlocated = r->sampled;
    opt.cutoff = r->cutoff;
    opt.tolerance = r->tolerance > 0 ? r->tolerance : opt.tolerance;
    opt.estimate_later = true;
    opt.reduce = r->reduce;
    opt.krylov = r->krylov;
    if (r->reduce > 0) {
        opt.dofs = opt.keep;
        opt.dofs_count = opt.keep_count;
    }
    return opt;
}

static cJSON *print_rung(const struct rung *r)
{
    cJSON *o = cJSON_CreateObject();

    cJSON_AddStringToObject(o, "method", names[r->method]);
    if (r->harmonics > 0)
        cJSON_AddNumberToObject(o, "harmonics", r->harmonics);
    if (r->samples > 0)
        cJSON_AddNumberToObject(o, "samples", r->samples);
    if (r->reduce > 0)
        cJSON_AddNumberToObject(o, "reduce", r->reduce);
    if (r->krylov > 0)
        cJSON_AddNumberToObject(o, "krylov", r->krylov);
    if (r->sampled)
        cJSON_AddBoolToObject(o, "located", false);
    if (r->cutoff > 0)
        cJSON_AddNumberToObject(o, "cutoff", r->cutoff);
    if (r->tolerance > 0)
        cJSON_AddNumberToObject(o, "tolerance", r->tolerance);
    return o;
}

/* Solve with OPT; every reported dof's harmonics, of a reduction those kept, into X, t->H + 1
 * each. */
static enum modal_status solve(const struct tradeoff *t, const struct steady_options *opt,
                               double complex *X, bool *converged, struct modal_error *err)
{
    struct steady *s = NULL;
    struct steady_point point = { 0 };
    int K = t->H + 1;
    enum modal_status rc = steady_new(t->p, opt, &s, err);

    if (rc == MODAL_OK)
        rc = steady_solve(s, t->p->omega, NULL, &point, err);
    if (rc == MODAL_OK)
        steady_count(t->p, &point);
    *converged = rc == MODAL_OK && point.converged;
    for (int i = 0; X != NULL && *converged && i < t->base.dofs_count && rc == MODAL_OK; i++) {
        double complex *own = calloc((size_t)point.H + 1, sizeof *own);

        rc = own == NULL ? modal_fail(err, MODAL_NO_MEMORY, "tradeoff: no memory")
             : opt->reduce > 0 && !t->kept[i] ? MODAL_OK
                         : steady_recover(s, &point, t->base.dofs[i], own, err);
        memset(X + (size_t)i * (size_t)K, 0, (size_t)K * sizeof *X);
        for (int k = 0; rc == MODAL_OK && k <= point.H && k < K; k++)
            X[(size_t)i * (size_t)K + (size_t)k] = own[k];
        free(own);
    }
    steady_point_done(&point);
    steady_free(s);
    return rc;
}

static enum modal_status error_of(const struct tradeoff *t, bool reduced, const double complex *X,
                                  double *error, struct modal_error *err)
{
    int K = t->H + 1;
    double *x = malloc((size_t)(4 * K) * sizeof *x);
    double complex *d = malloc((size_t)K * sizeof *d);
    struct orbit_grid *g = NULL;
    enum modal_status rc = x == NULL || d == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "tradeoff: no memory")
                               : orbit_grid_to_time(4 * K, &g, err);

    *error = 0;
    for (int i = 0; rc == MODAL_OK && i < t->base.dofs_count; i++) {
        for (int k = 0; k < K; k++)
            d[k] = X[(size_t)i * (size_t)K + (size_t)k]
                   - t->reference[(size_t)i * (size_t)K + (size_t)k];
        if (!reduced || t->kept[i])
            *error = fmax(*error, orbit_peak(g, t->H, d, x) / t->scale);
    }
    free(x);
    free(d);
    orbit_grid_free(g);
    return rc;
}

static enum modal_status climb(void *context, int i, double *error, struct modal_error *err)
{
    struct tradeoff *t = context;
    struct steady_options opt = options_of(t, t->rung[i]);
    double complex *X = calloc((size_t)t->base.dofs_count * ((size_t)t->H + 1), sizeof *X);
    bool converged = false;
    enum modal_status rc = X == NULL ? modal_fail(err, MODAL_NO_MEMORY, "tradeoff: no memory")
                                     : solve(t, &opt, X, &converged, err);

    if (rc == MODAL_BAD_INPUT || rc == MODAL_OVERFLOW || (rc == MODAL_OK && !converged))
        rc = modal_fail(err, MODAL_NO_CONVERGENCE, "this rung has no answer");
    if (rc == MODAL_OK)
        rc = error_of(t, opt.reduce > 0, X, error, err);
    free(X);
    return rc;
}

static void begins(void *context, int i)
{
    const struct tradeoff *t = context;

    tradeoff_report(t->request, i, t->rungs);
}

static bool was_cancelled(void *context)
{
    const struct tradeoff *t = context;

    return job_cancelled(t->request);
}

/* The highest harmonic of a load as its dofs see it: one fixed in space, on axes that turn, reaches
 * as much higher. */
static int highest(const struct program *p, const struct program_load *load)
{
    return load->k + (load->dof_sine >= 0 ? (int)lround(fmin(p->frame_speed / p->omega, 1e6)) : 0);
}

/* Rungs that this scene can climb: the loads' harmonic fits, and laws for methods to differ on. */
static void choose_rungs(struct tradeoff *t)
{
    int load = 0;

    for (int i = 0; i < t->p->loads; i++)
        load = highest(t->p, &t->p->load[i]) > load ? highest(t->p, &t->p->load[i]) : load;
    for (size_t i = 0; i < sizeof ladder_rungs / sizeof *ladder_rungs; i++) {
        const struct rung *r = &ladder_rungs[i];
        bool fits = r->harmonics == 0 ? 2 * load < r->samples : r->harmonics >= load;

        fits &= r->reduce == 0 || r->reduce < t->p->n - t->base.keep_count;
        fits &= r->krylov == 0 || condense_many(t->p);
        if (fits && (t->p->laws > 0 || t->rungs == 0 || r->reduce > 0))
            t->rung[t->rungs++] = r;
    }
}

/* Which of the reported dofs a reduction keeps. */
static enum modal_status find_kept(struct tradeoff *t, struct modal_error *err)
{
    const struct steady_options *o = &t->base;

    t->kept = calloc((size_t)o->dofs_count + 1, sizeof *t->kept);
    for (int i = 0; t->kept != NULL && i < o->dofs_count; i++)
        for (int j = 0; j < o->keep_count && !t->kept[i]; j++)
            t->kept[i] = o->keep[j] == o->dofs[i];
    return t->kept != NULL ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "tradeoff: no memory");
}

static enum modal_status find_reference(struct tradeoff *t, struct modal_error *err)
{
    struct steady_options opt = t->base;
    size_t K;
    double *x;
    struct orbit_grid *g = NULL;
    bool converged = false;
    enum modal_status rc;

    t->H = REFERENCE_H;
    while (t->H > REFERENCE_H_LEAST
           && (long)t->p->laws * 2 * (2 * t->H + 1) > REFERENCE_UNKNOWNS)
        t->H /= 2;
    K = (size_t)t->H + 1;
    opt.harmonics = t->H;
    opt.samples = 0;
    opt.method = STEADY_AUTO;
    opt.estimate_later = true;
    t->reference = calloc((size_t)t->base.dofs_count * K, sizeof *t->reference);
    x = malloc(4 * K * sizeof *x);
    rc = t->reference == NULL || x == NULL ? modal_fail(err, MODAL_NO_MEMORY, "tradeoff: no memory")
                                           : orbit_grid_to_time((int)(4 * K), &g, err);
    if (rc == MODAL_OK)
        rc = solve(t, &opt, t->reference, &converged, err);
    if (rc == MODAL_OK && !converged)
        rc = modal_fail(err, MODAL_NO_CONVERGENCE,
                        "tradeoff: no periodic solution was found to measure errors against");
    for (int i = 0; rc == MODAL_OK && i < t->base.dofs_count; i++)
        t->scale = fmax(t->scale, orbit_peak(g, t->H, t->reference + (size_t)i * K, x));
    if (rc == MODAL_OK && !(t->scale > 0))
        rc = modal_fail(err, MODAL_NO_CONVERGENCE,
                        "tradeoff: the steady state is rest; there is no error to measure");
    free(x);
    orbit_grid_free(g);
    return rc;
}

static enum modal_status run(struct tradeoff *t, double target, double seconds, int repetitions,
                             cJSON **doc, struct modal_error *err)
{
    struct ladder ladder = { .rungs = t->rungs, .repetitions = repetitions, .target_error = target,
                             .target_seconds = seconds, .climb = climb, .clock = tradeoff_clock,
                             .cancelled = was_cancelled, .begins = begins, .context = t };
    struct ladder_rung rungs[RUNGS_MOST];
    struct ladder_outcome outcome;
    cJSON *settings[RUNGS_MOST], *reference;
    enum modal_status rc = ladder_run(&ladder, rungs, &outcome, err);

    if (rc != MODAL_OK)
        return rc;
    for (int i = 0; i < outcome.ran; i++)
        settings[i] = print_rung(t->rung[i]);
    reference = cJSON_CreateObject();
    cJSON_AddStringToObject(reference, "method", "auto");
    cJSON_AddNumberToObject(reference, "harmonics", t->H);
    return tradeoff_print("steady", reference, settings, rungs, outcome.ran, outcome.recommended,
                          doc, err);
}

#define AT(member) .at = offsetof(struct tradeoff_wishes, member)

const struct key_row tradeoff_steady_rows[] = {
    { "of", KEY_OWN, .form = "steady", .meaning = "what is traded off", .example = "steady" },
    { "repetitions", KEY_WHOLE, AT(repetitions), .low = 1, .high = LADDER_REPETITIONS_MOST,
      .initial = "3", .meaning = "of each rung, whose time is their median", .example = "5" },
    { "target.error", KEY_NUMBER, AT(target), .low = 0, .high = 1, .initial = "0",
      .meaning = "stop at the first rung below it; 0: never", .example = "1e-6" },
    { "target.seconds", KEY_NUMBER, AT(seconds), .low = 0, .high = 1e6, .initial = "0", .unit = "s",
      .form = "S", .meaning = "climb no longer than this; 0: to the end", .example = "10" },
    { "stability", KEY_OWN, .form = "true|false",
      .meaning = "taken for steady's sake: no rung looks at it", .example = "false" },
    { "threads", KEY_OWN, KEY_SILENT, .form = "N", .initial = "1",
      .meaning = "that the job is counted for", .example = "2" },
    { 0 },
};

static enum modal_status read_scene(const struct job_request *request, struct program **p,
                                    struct steady_settings *settings, cJSON **shown,
                                    struct modal_error *err)
{
    struct job_request scene_only = *request;
    struct scene_options with = { .arrays = request->arrays };
    enum modal_status rc = scene_lower(request->scene, &with, p, err);

    scene_only.options = NULL;
    if (rc == MODAL_OK)
        rc = steady_settings_read(&scene_only, *p, settings, shown, err);
    if (rc == MODAL_OK && settings->tones_count == 0 && !((*p)->omega > 0))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "omega",
                              "a steady state needs the scene's omega > 0");
    return rc;
}

/* The document under one omega. */
static enum modal_status tradeoff_period(const struct job_request *request, struct program *p,
                                         const struct steady_settings *settings,
                                         const struct tradeoff_wishes *wishes, struct cost *cost,
                                         cJSON **doc, struct modal_error *err)
{
    struct tradeoff t = { .request = request, .p = p, .base = settings->opt };
    enum modal_status rc;

    steady_subharmonic(p, settings->subharmonic);
    choose_rungs(&t);
    steady_count_start(p);
    rc = find_kept(&t, err);
    if (rc == MODAL_OK)
        rc = find_reference(&t, err);
    cost_stage(cost, "reference");
    if (rc == MODAL_OK)
        rc = run(&t, wishes->target, wishes->seconds, wishes->repetitions, doc, err);
    free(t.reference);
    free(t.kept);
    return rc;
}

enum modal_status tradeoff_steady(const struct job_request *request, struct job_result *out,
                                  struct modal_error *err)
{
    struct steady_settings settings = { 0 };
    struct program *p = NULL;
    struct tradeoff_wishes wishes = { 0 };
    struct cost cost;
    cJSON *shown = NULL, *doc = NULL;
    enum modal_status rc = key_table_options(tradeoff_steady_rows, request->options, &wishes, err);

    cost_start(&cost);
    if (rc == MODAL_OK)
        rc = read_scene(request, &p, &settings, &shown, err);
    if (rc == MODAL_OK)
        rc = settings.tones_count > 0
                 ? tradeoff_tones(request, p, &settings, &wishes, &doc, err)
                 : tradeoff_period(request, p, &settings, &wishes, &cost, &doc, err);
    cost_stage(&cost, "climb");
    if (rc == MODAL_OK) {
        cJSON_AddItemToObject(doc, "plan", plan_print(p, "ladder"));
        cJSON_AddItemToObject(doc, "cost", cost_print(&cost));
        cJSON_AddItemToObject(doc, "provenance", provenance_print(request, shown));
        shown = NULL;
        out->result = doc;
    }
    cJSON_Delete(shown);
    steady_settings_done(&settings);
    program_free(p);
    return rc;
}
