/* backbone_job.c - see backbone_job.h; tested by tests/system/test_plots.py */
#include "job/backbone_job.h"
#include <math.h>
#include <stdlib.h>
#include "job/cost.h"
#include "job/plan.h"
#include "job/steady_print.h"
#include "job/steady_settings.h"
#include "modal/steady/backbone.h"

enum {
    POINTS_MOST = 5000,      /* a document of some 10 MB with a few dofs */
    HARMONICS = 9            /* of a mode: cubic laws need few, and odd ones */
};

struct range { int mode, count; double from, to; };   /* count 0: as many as the curve has */

static enum modal_status parse(const char *text, struct range *r, struct modal_error *err)
{
    char *end = NULL;
    bool counted;

    r->mode = (int)strtol(text, &end, 10);
    r->from = *end == ':' ? strtod(end + 1, &end) : NAN;
    r->to = *end == ':' ? strtod(end + 1, &end) : NAN;
    counted = *end == ':';
    r->count = counted ? (int)strtol(end + 1, &end, 10) : 0;
    if (*end != '\0' || !(r->from > 0) || !(r->to > 0) || !isfinite(r->from) || !isfinite(r->to)
        || (counted && (r->count < 2 || r->count > POINTS_MOST)))
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "backbone",
            "\"%.60s\"; accepted: MODE:A:B or MODE:A:B:N, amplitudes A and B > 0, 2 to %d points",
            text, POINTS_MOST);
    return MODAL_OK;
}

static cJSON *print_harmonics(const struct program *p, const struct steady_settings *settings,
                              const struct backbone_point *point, int H)
{
    size_t K = (size_t)H + 1;
    double *k = malloc(3 * K * sizeof *k);
    cJSON *list = cJSON_CreateArray();

    for (int i = 0; k != NULL && i < settings->dofs_count; i++) {
        cJSON *row = cJSON_CreateObject();

        for (size_t h = 0; h < K; h++) {
            double complex X = point->X[(size_t)settings->dofs[i] * K + h];

            k[h] = (double)h;
            k[K + h] = creal(X);
            k[2 * K + h] = cimag(X);
        }
        cJSON_AddStringToObject(row, "dof", p->dofs[settings->dofs[i]]);
        cJSON_AddItemToObject(row, "k", json_numbers(k, K));
        cJSON_AddItemToObject(row, "re", json_numbers(k + K, K));
        cJSON_AddItemToObject(row, "im", json_numbers(k + 2 * K, K));
        cJSON_AddItemToArray(list, row);
    }
    free(k);
    return list;
}

static void print_frequency(cJSON *o, double omega, double damping_ratio)
{
    json_set_number(o, "omega", omega);
    json_set_number(o, "frequency_hz", omega / (2 * M_PI));
    json_set_number(o, "damping_ratio", damping_ratio);
}

static cJSON *print_point(const struct program *p, const struct steady_settings *settings,
                          const struct backbone_point *point, int H)
{
    cJSON *o = cJSON_CreateObject();

    cJSON_AddNumberToObject(o, "amplitude", point->amplitude);
    print_frequency(o, point->converged ? point->omega : NAN,
                    point->converged ? point->damping_ratio : NAN);
    json_set_number(o, "energy", point->converged ? point->energy : NAN);
    cJSON_AddBoolToObject(o, "converged", point->converged);
    cJSON_AddNumberToObject(o, "iterations", point->iterations);
    json_set_number(o, "residual", point->residual);
    cJSON_AddItemToObject(o, "harmonics", print_harmonics(p, settings, point, H));
    return o;
}

/* What the laws did, for the plan. */
static void count(struct program *p, const struct backbone *b)
{
    for (int l = 0; l < p->laws; l++)
        p->effect[p->law[l].effect].active |= backbone_acts(b, l);
}

static void count_evaluations(struct program *p, const struct backbone *b)
{
    for (int l = 0; l < p->laws; l++)
        p->effect[p->law[l].effect].evaluations += backbone_evaluations(b, l);
}

/* Amplitude I of R, the last to the last bit. */
static double amplitude(const struct range *r, int i)
{
    return i == 0              ? r->from
           : i + 1 < r->count  ? r->from * pow(r->to / r->from, (double)i / (r->count - 1))
                               : r->to;
}

/* Amplitude after amplitude, or along the curve until it is at the last, or has come back to less
 * energy (more, where amplitudes fall) than it began with; the first that is not reached ends the
 * list. */
static enum modal_status follow(const struct job_request *request, struct program *p,
                                const struct steady_settings *settings, const struct range *r,
                                struct backbone *b, int H, cJSON *points, struct modal_error *err)
{
    double begun = 0;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < (r->count > 0 ? r->count : POINTS_MOST); i++) {
        struct backbone_point point;

        if (job_cancelled(request))
            return modal_fail(err, MODAL_CANCELLED, "cancelled");
        rc = i == 0 || r->count > 0 ? backbone_at(b, amplitude(r, i), &point, err)
                                    : backbone_next(b, r->to, &point, err);
        if (rc == MODAL_OK) {
            cJSON_AddItemToArray(points, print_point(p, settings, &point, H));
            count(p, b);
        }
        if (rc == MODAL_OK
            && (!point.converged
                || (i > 0 && r->count == 0
                    && (point.amplitude == r->to
                        || (point.energy - begun) * (r->to - r->from) < 0))))
            break;
        begun = i == 0 ? point.energy : begun;
    }
    return rc;
}

enum modal_status backbone_run(const struct job_request *request, struct program *p,
                               const struct steady_settings *settings, struct cost *cost,
                               cJSON **doc, struct modal_error *err)
{
    int H = settings->opt.harmonics > 0 ? settings->opt.harmonics : HARMONICS;
    struct backbone *b = NULL;
    struct range r;
    cJSON *out = NULL, *linear;
    double omega, zeta;
    enum modal_status rc = parse(settings->backbone, &r, err);

    if (rc == MODAL_OK)
        rc = backbone_new(p, r.mode, H, settings->opt.samples, &b, err);
    if (rc != MODAL_OK)
        return rc;
    out = cJSON_CreateObject();
    omega = backbone_linear(b, &zeta);
    cJSON_AddStringToObject(out, "kind", "backbone");
    cJSON_AddNumberToObject(out, "mode", r.mode);
    linear = cJSON_AddObjectToObject(out, "linear");
    print_frequency(linear, omega, zeta);
    steady_count_start(p);
    rc = follow(request, p, settings, &r, b, H, cJSON_AddArrayToObject(out, "points"), err);
    cost_stage(cost, "solve");
    count_evaluations(p, b);
    backbone_free(b);
    if (rc != MODAL_OK) {
        cJSON_Delete(out);
        return rc;
    }
    cJSON_AddItemToObject(out, "plan", plan_print(p, "extended periodic motion"));
    *doc = out;
    return MODAL_OK;
}
