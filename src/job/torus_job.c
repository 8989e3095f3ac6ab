/* torus_job.c - see torus_job.h; tested by tests/system/test_tones.py */
#include "job/torus_job.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "job/cost.h"
#include "job/plan.h"
#include "job/steady_print.h"
#include "job/steady_settings.h"
#include "modal/scene/program.h"
#include "modal/steady/torus_solve.h"

static const double ALIKE = 1e-9;         /* of a tone: another is the same, and one they are */

static enum modal_status refuse(const char *option, struct modal_error *err)
{
    return modal_fail_field(err, MODAL_BAD_INPUT, option,
                            "%s is not accepted with tones, whose motion has no period", option);
}

enum modal_status torus_check(const struct steady_settings *s, struct modal_error *err)
{
    const struct { bool given; const char *option; } others[] = {
        { s->backbone != NULL, "backbone" }, { s->solutions == 1, "solutions" },
        { s->start != NULL, "start" },        { s->subharmonic > 1, "subharmonic" },
        { s->opt.samples > 0, "samples" },    { s->opt.cutoff > 0, "cutoff" },
        { s->time != 0, "time" },             { s->opt.unlocated, "located" },
        { s->opt.by_differences, "differences" },
        { s->opt.method != STEADY_AUTO && s->opt.method != STEADY_NEWTON, "method" },
    };

    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (others[i].given)
            return refuse(others[i].option, err);
    return MODAL_OK;
}

static const char *method_of(const struct program *p, const struct torus_point *point)
{
    return point->marched ? "march" : p->laws > 0 ? "newton" : "linear";
}

static cJSON *print_index(const struct torus_point *point, int m)
{
    cJSON *list = cJSON_CreateArray();

    for (int j = 0; j < point->tones.count; j++)
        cJSON_AddItemToArray(list, cJSON_CreateNumber(point->index[m].k[j]));
    return list;
}

/* The reported dofs' combinations; a motion whose phase has the sign of k turned is its conjugate,
 * so that k and -k say the same. */
static void print_harmonics(const struct program *p, const struct steady_settings *settings,
                            const struct torus_point *point, cJSON *doc)
{
    cJSON *list = cJSON_AddArrayToObject(doc, "harmonics");

    for (int i = 0; i < settings->dofs_count; i++) {
        cJSON *o = cJSON_CreateObject(), *k = cJSON_CreateArray(), *re = cJSON_CreateArray(),
              *im = cJSON_CreateArray();

        for (int m = 0; m < point->count; m++) {
            double complex X = point->X[(size_t)i * (size_t)point->count + (size_t)m];

            cJSON_AddItemToArray(k, print_index(point, m));
            cJSON_AddItemToArray(re, cJSON_CreateNumber(creal(X)));
            cJSON_AddItemToArray(im, cJSON_CreateNumber(cimag(X)));
        }
        cJSON_AddStringToObject(o, "dof", p->dofs[settings->dofs[i]]);
        cJSON_AddItemToObject(o, "k", k);
        cJSON_AddItemToObject(o, "re", re);
        cJSON_AddItemToObject(o, "im", im);
        cJSON_AddItemToArray(list, o);
    }
}

static void diagnose(cJSON *list, const char *code, const char *text)
{
    cJSON *d = cJSON_CreateObject();

    cJSON_AddStringToObject(d, "code", code);
    cJSON_AddStringToObject(d, "message", text);
    cJSON_AddItemToArray(list, d);
}

static void print_diagnostics(const struct steady_settings *settings,
                              const struct torus_point *point, cJSON *doc)
{
    cJSON *list = cJSON_AddArrayToObject(doc, "diagnostics");
    int undetermined = 0;
    char text[320];

    for (int l = 0; l < point->laws; l++)
        undetermined += point->undetermined[l];
    if (!point->converged) {
        snprintf(text, sizeof text,
                 "no motion of these tones was found, which is no proof that there is none: %s; "
                 "what is given is the best iterate", point->reason);
        diagnose(list, "not_converged", text);
    }
    if (point->converged && point->part.of > 0) {
        snprintf(text, sizeof text,
                 "from the scene's initial state the motion settles to one that repeats after %d "
                 "turns of tone %d alone: tones has one part in %d of it, whose numbers in k are "
                 "as many times larger", point->part.of, point->part.tone + 1, point->part.of);
        diagnose(list, "repeats_later", text);
    }
    if (point->converged && point->wanting && settings->opt.harmonics == 0) {
        snprintf(text, sizeof text,
                 "a line's error is estimated at %.3g of the amplitude, %.3g times target.error "
                 "%.3g, with %d combinations, the most that were tried",
                 point->line / point->amplitude,
                 point->line / point->amplitude / settings->opt.target_error,
                 settings->opt.target_error, point->count);
        diagnose(list, "target_not_met", text);
    }
    if (point->converged && point->open)
        diagnose(list, "undetermined_mean", STEADY_MEAN_IS_FREE);
    if (point->converged && undetermined > 0) {
        snprintf(text, sizeof text,
                 "%d sliders of %d come to rest: their places, and with them the mean, follow from "
                 "history; the mean given is that with the sliders %s", undetermined, point->laws,
                 point->from_start ? "where the scene's initial state leaves them"
                                   : "as near to zero as their strength allows");
        diagnose(list, "undetermined_offset", text);
    }
    if (settings->stability && point->converged && point->stability.reason != NULL) {
        snprintf(text, sizeof text, "the stability was not computed: %s", point->stability.reason);
        diagnose(list, "stability_unknown", text);
    }
}

/* A motion of several tones has no period, and exponents in place of multipliers. */
static void print_stability(const struct torus_point *point, cJSON *o)
{
    const struct torus_stability *s = &point->stability;

    if (s->verdict != 0)
        cJSON_AddBoolToObject(o, "stable", s->verdict > 0);
    else
        cJSON_AddNullToObject(o, "stable");
    cJSON_AddNullToObject(o, "max_multiplier");
    cJSON_AddArrayToObject(o, "multipliers");
    cJSON_AddItemToObject(o, "exponents", json_numbers(s->exponent, (size_t)s->count));
    json_set_number(o, "margin", s->count > 0 ? s->margin : NAN);
    json_set_number(o, "margin_std", s->count > 0 ? s->error : NAN);
}

static void print_errors(const struct steady_settings *settings, const struct torus_point *point,
                         cJSON *doc)
{
    bool known = point->converged;
    cJSON *o;

    json_set_number(doc, "residual", point->residual);
    json_set_number(doc, "truncation_error", known ? point->truncation : NAN);
    json_set_number(doc, "sampling_error", known ? point->sampling : NAN);
    json_set_number(doc, "solver_error", known ? point->solver : NAN);
    json_set_number(doc, "total_error", known ? point->error : NAN);
    json_set_number(doc, "line_error", known ? point->line : NAN);
    if (settings->free_tone > 0)
        json_set_number(doc, "tone_error", known ? point->tone_error : NAN);
    o = cJSON_AddObjectToObject(doc, "reconstruction");
    json_set_number(o, "rms_residual", NAN);
    json_set_number(o, "max_residual", NAN);
    json_set_number(o, "relative_residual", NAN);
    o = cJSON_AddObjectToObject(doc, "work");
    json_set_number(o, "spent", point->work.spent);
    json_set_number(o, "allowed", point->work.most);
    print_stability(point, cJSON_AddObjectToObject(doc, "stability"));
}

/* What each of the tones given was divided by. */
static cJSON *print_parts(const struct torus_point *point)
{
    cJSON *list = cJSON_CreateArray();

    for (int j = 0; j < point->tones.count; j++)
        cJSON_AddItemToArray(list, cJSON_CreateNumber(j == point->part.tone ? point->part.of : 1));
    return list;
}

cJSON *torus_print(const struct program *p, const struct steady_settings *settings,
                   const struct torus_point *point)
{
    cJSON *doc = cJSON_CreateObject();
    int highest = 0;

    for (int m = 0; m < point->count; m++)
        highest = torus_order(point->index[m]) > highest ? torus_order(point->index[m]) : highest;
    cJSON_AddStringToObject(doc, "kind", "steady");
    cJSON_AddBoolToObject(doc, "converged", point->converged);
    cJSON_AddNullToObject(doc, "omega");
    cJSON_AddItemToObject(doc, "tones",
                          json_numbers(point->tones.omega, (size_t)point->tones.count));
    if (point->part.of > 0)
        cJSON_AddItemToObject(doc, "subharmonic", print_parts(point));
    cJSON_AddStringToObject(doc, "method", method_of(p, point));
    cJSON_AddNumberToObject(doc, "iterations", point->iterations);
    cJSON_AddNumberToObject(doc, "H", highest);
    cJSON_AddNumberToObject(doc, "N", point->samples);
    print_harmonics(p, settings, point, doc);
    print_errors(settings, point, doc);
    print_diagnostics(settings, point, doc);
    return doc;
}

bool torus_alike(const struct steady_settings *s)
{
    for (int i = 0; i < s->tones_count; i++)
        for (int j = 0; j < i; j++)
            if (fabs(s->tones[i] - s->tones[j]) <= ALIKE * s->tones[i] && s->tones[i] > 0)
                return true;
    return false;
}

enum modal_status torus_at(struct program *p, const struct steady_settings *settings,
                           const struct torus_point *start, bool near, struct torus_point *point,
                           struct modal_error *err)
{
    const struct torus_options opt = { .order = settings->opt.harmonics,
                                       .tolerance = settings->opt.tolerance,
                                       .max_iterations = settings->opt.max_iterations,
                                       .target_error = settings->opt.target_error,
                                       .stability = settings->stability,
                                       .free = settings->free_tone,
                                       .start = start,
                                       .near = near,
                                       .dofs = settings->dofs,
                                       .dofs_count = settings->dofs_count,
                                       .cancelled = settings->opt.cancelled,
                                       .context = settings->opt.context };

    for (int j = 0; j < settings->tones_count; j++)
        p->tones[j] = settings->tones[j];
    return torus_solve(p, settings->tones, settings->tones_count, &opt, point, err);
}

void torus_count(struct program *p, const struct torus_point *point)
{
    steady_count_laws(p, point->laws, point->evaluations, point->acts);
}

enum modal_status torus_run(struct program *p, const struct steady_settings *settings,
                            struct cost *cost, cJSON **doc, struct modal_error *err)
{
    struct torus_point point = { 0 };
    enum modal_status rc = torus_check(settings, err);

    if (rc == MODAL_OK && torus_alike(settings))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "tones",
                              "tones: two of them are the same; accepted: two or three tones that "
                              "differ");
    if (rc == MODAL_OK)
        rc = torus_at(p, settings, NULL, false, &point, err);
    cost_stage(cost, "solve");
    if (rc != MODAL_OK)
        return rc;
    torus_count(p, &point);
    *doc = torus_print(p, settings, &point);
    cJSON_AddItemToObject(*doc, "plan", plan_print(p, method_of(p, &point)));
    torus_point_done(&point);
    cost_stage(cost, "print");
    return MODAL_OK;
}
