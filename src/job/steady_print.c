/* steady_print.c - see steady_print.h; tested by tests/system/test_curve.py */
#include "job/steady_print.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "job/steady_settings.h"
#include "modal/scene/program.h"
#include "modal/steady/resonance.h"
#include "modal/steady/stability.h"

static enum modal_status print_harmonics(struct steady *s, const struct program *p,
                                         const struct steady_settings *settings,
                                         const struct steady_point *point, cJSON *doc,
                                         struct modal_error *err)
{
    size_t K = (size_t)point->H + 1;
    double complex *X = malloc(K * sizeof *X);
    double *k = malloc(3 * K * sizeof *k), *re = k + K, *im = re + K;
    cJSON *list = cJSON_AddArrayToObject(doc, "harmonics");
    enum modal_status rc = X == NULL || k == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory to print")
                               : MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < settings->dofs_count; i++) {
        cJSON *row = cJSON_CreateObject();

        rc = steady_recover(s, point, settings->dofs[i], X, err);
        for (size_t h = 0; h < K; h++) {
            k[h] = (double)h;
            re[h] = creal(X[h]);
            im[h] = cimag(X[h]);
        }
        cJSON_AddStringToObject(row, "dof", p->dofs[settings->dofs[i]]);
        cJSON_AddItemToObject(row, "k", json_numbers(k, K));
        cJSON_AddItemToObject(row, "re", json_numbers(re, K));
        cJSON_AddItemToObject(row, "im", json_numbers(im, K));
        cJSON_AddItemToArray(list, row);
    }
    free(X);
    free(k);
    return rc;
}

static enum modal_status print_time(struct steady *s, const struct program *p,
                                    const struct steady_settings *settings,
                                    const struct steady_point *point, cJSON *doc,
                                    struct modal_error *err)
{
    int N = settings->time > 0        ? settings->time
            : point->N > 2 * point->H ? point->N
                                      : 4 * point->H + 4;
    double complex *X = malloc(((size_t)point->H + 1) * sizeof *X);
    double *x = malloc((size_t)N * sizeof *x);
    cJSON *time = cJSON_AddObjectToObject(doc, "time"), *rows;
    enum modal_status rc = X == NULL || x == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory to print")
                               : MODAL_OK;

    for (int j = 0; rc == MODAL_OK && j < N; j++)
        x[j] = 2 * M_PI / point->omega * j / N;
    if (rc == MODAL_OK)
        cJSON_AddItemToObject(time, "t", json_numbers(x, (size_t)N));
    rows = cJSON_AddObjectToObject(time, "x");
    for (int i = 0; rc == MODAL_OK && i < settings->dofs_count; i++) {
        rc = steady_recover(s, point, settings->dofs[i], X, err);
        for (int j = 0; rc == MODAL_OK && j < N; j++) {
            x[j] = creal(X[0]);
            for (int k = 1; k <= point->H; k++) {
                double phase = 2 * M_PI * (double)((long)k * j % N) / N;

                x[j] += creal(X[k]) * cos(phase) - cimag(X[k]) * sin(phase);
            }
        }
        if (rc == MODAL_OK)
            cJSON_AddItemToObject(rows, p->dofs[settings->dofs[i]], json_numbers(x, (size_t)N));
    }
    free(X);
    free(x);
    return rc;
}

static void print_stability(const struct stability *st, cJSON *doc)
{
    cJSON *o = cJSON_AddObjectToObject(doc, "stability"), *list;

    if (st->verdict == STABILITY_STABLE || st->verdict == STABILITY_UNSTABLE)
        cJSON_AddBoolToObject(o, "stable", st->verdict == STABILITY_STABLE);
    else
        cJSON_AddNullToObject(o, "stable");
    json_set_number(o, "max_multiplier", st->verdict != STABILITY_UNKNOWN ? st->largest : NAN);
    list = cJSON_AddArrayToObject(o, "multipliers");
    for (int i = 0; i < st->count; i++)
        cJSON_AddItemToArray(list,
                             json_complex(creal(st->multiplier[i]), cimag(st->multiplier[i])));
    if (st->verdict != STABILITY_UNKNOWN)
        json_set_number(o, "error", st->error);
}

static void diagnose(cJSON *list, const char *code, const char *format, const char *a)
{
    cJSON *d = cJSON_CreateObject();
    char text[512];

    snprintf(text, sizeof text, format, a);
    cJSON_AddStringToObject(d, "code", code);
    cJSON_AddStringToObject(d, "message", text);
    cJSON_AddItemToArray(list, d);
}

static void print_missed(cJSON *list, const struct steady_point *point, double target)
{
    char text[360], more[140] = "";

    if (point->wanting)
        snprintf(more, sizeof more, "; the next needs more work than is spent unasked: give "
                 "harmonics = %d for it", 2 * point->H);
    snprintf(text, sizeof text, "the error's estimate is %.3g of the amplitude, %.3g times "
             "target.error %.3g, with %d harmonics, the most that were tried%s",
             point->error / point->amplitude, point->error / point->amplitude / target, target,
             point->H, more);
    diagnose(list, "target_not_met", "%s", text);
}

/* One line for all sliders that stay where they are. */
static void print_offsets(const struct program *p, const struct steady_point *point, cJSON *list)
{
    int count = 0, first = 0;
    char which[96];

    for (int l = point->laws - 1; point->converged && l >= 0; l--)
        if (point->undetermined[l]) {
            count++;
            first = l;
        }
    if (point->converged && point->open)
        diagnose(list, "undetermined_mean", "%s", STEADY_MEAN_IS_FREE);
    if (count == 0)
        return;
    if (count == 1)
        snprintf(which, sizeof which, "the slider of effect %s never slips",
                 p->effect[p->law[first].effect].type);
    else
        snprintf(which, sizeof which, "%d sliders of %d never slip", count, point->laws);
    diagnose(list, "undetermined_offset",
             point->followed
                 ? "%s: its place, and with it the mean, follows from history; the mean given is "
                   "one of many, which a motion in time came to"
                 : "%s: its place, and with it the mean, follows from history; the mean given is "
                   "that with the slider at zero, or as near to it as its strength allows", which);
}

/* A reduction that is too coarse for the error asked for, or of which that is not known. */
static void print_reduction(const struct steady_settings *settings,
                            const struct steady_point *point, cJSON *list)
{
    double target = settings->opt.target_error;
    char text[200];

    if (!point->converged || settings->opt.reduce == 0)
        return;
    if (isnan(point->reduction))
        snprintf(text, sizeof text, "could not be estimated: with twice the modes no like motion "
                 "was found");
    else if (point->reduction > target * point->amplitude && point->amplitude > 0)
        snprintf(text, sizeof text, "is %.3g of the amplitude, %.3g times target.error %.3g",
                 point->reduction / point->amplitude,
                 point->reduction / point->amplitude / target, target);
    else
        return;
    diagnose(list, "reduction_coarse", "the error of the reduction %s: give reduce more modes, or "
             "leave it out", text);
}

/* That there is no motion is said only where it is certain. */
static void print_failure(const struct program *p, const struct steady_point *point, cJSON *list)
{
    const char *reason = point->reason != NULL ? point->reason : "the balance does not close",
               *given = point->residual < 0 ? "no motion is given, but zeros"
                                            : "what is given is the best iterate";
    char where[400];
    int k;

    if (resonance_unheld(p, point->omega, &k)) {
        if (k > 0)
            snprintf(where, sizeof where, "harmonic %d excites an undamped resonance, and no "
                     "friction is strong enough to hold it; %s", k, given);
        else
            snprintf(where, sizeof where, "the mean load pushes what no spring holds, and no "
                     "friction is strong enough to hold it; %s", given);
        diagnose(list, "no_periodic_solution", "there is no periodic solution: %s", where);
    } else {
        snprintf(where, sizeof where, "%s; %s", reason, given);
        diagnose(list, "not_converged", "no periodic solution was found, which is no proof "
                 "that there is none: %s", where);
    }
}

static void print_diagnostics(const struct program *p, const struct steady_settings *settings,
                              const struct steady_point *point, const struct stability *st,
                              cJSON *doc)
{
    cJSON *list = cJSON_AddArrayToObject(doc, "diagnostics");
    double target = settings->opt.target_error;

    if (!point->converged)
        print_failure(p, point, list);
    print_offsets(p, point, list);
    if (point->converged && settings->opt.harmonics == 0
        && point->error - point->reduction > target * point->amplitude)
        print_missed(list, point, target);
    print_reduction(settings, point, list);
    if (point->converged && point->laws > 0 && !(point->error >= 0)
        && !isnan(point->reduction))
        diagnose(list, "error_unknown",
                 "the error could not be estimated: the derivative is singular at the solution%s",
                 "");
    if (point->unsought)
        diagnose(list, "search_work_limit", "the work allowed was spent before the search for "
                 "other motions was over%s", "");
    if (st != NULL && st->verdict == STABILITY_UNKNOWN && st->reason != NULL)
        diagnose(list, "stability_unknown", "the stability was not computed: %s", st->reason);
}

enum modal_status steady_print(struct steady *s, const struct program *p,
                               const struct steady_settings *settings,
                               const struct steady_point *point, const struct stability *stability,
                               cJSON **out, struct modal_error *err)
{
    const struct stability unknown = { .verdict = STABILITY_UNKNOWN };
    bool known = point->converged || point->fewer;       /* the errors */
    cJSON *doc = cJSON_CreateObject(), *r;
    enum modal_status rc;

    cJSON_AddStringToObject(doc, "kind", "steady");
    cJSON_AddBoolToObject(doc, "converged", point->converged);
    json_set_number(doc, "omega", point->omega);
    cJSON_AddStringToObject(doc, "method", point->method != NULL ? point->method : "none");
    cJSON_AddNumberToObject(doc, "iterations", point->iterations);
    cJSON_AddNumberToObject(doc, "H", point->H);
    cJSON_AddNumberToObject(doc, "N", point->N);
    rc = print_harmonics(s, p, settings, point, doc, err);
    if (rc == MODAL_OK && settings->time != 0)
        rc = print_time(s, p, settings, point, doc, err);
    json_set_number(doc, "residual", point->residual >= 0 ? point->residual : NAN);
    json_set_number(doc, "truncation_error", known ? point->truncation : NAN);
    json_set_number(doc, "sampling_error", known ? point->sampling : NAN);
    json_set_number(doc, "solver_error", known ? point->solver : NAN);
    if (settings->opt.reduce > 0)
        json_set_number(doc, "reduction_error", known ? point->reduction : NAN);
    json_set_number(doc, "total_error", known ? point->error : NAN);
    r = cJSON_AddObjectToObject(doc, "reconstruction");
    json_set_number(r, "rms_residual", known ? point->tail_rms : NAN);
    json_set_number(r, "max_residual", known ? point->tail_max : NAN);
    json_set_number(r, "relative_residual",
                    !known ? NAN : point->tail_max == 0 ? 0 : point->tail_max / point->load_max);
    r = cJSON_AddObjectToObject(doc, "work");
    json_set_number(r, "spent", point->work.spent);
    json_set_number(r, "allowed", point->work.most);
    print_stability(stability != NULL ? stability : &unknown, doc);
    print_diagnostics(p, settings, point, stability, doc);
    if (rc != MODAL_OK) {
        cJSON_Delete(doc);
        return rc;
    }
    *out = doc;
    return MODAL_OK;
}

void steady_count_start(struct program *p)
{
    for (int l = 0; l < p->laws; l++)
        p->effect[p->law[l].effect].active = false;
}

void steady_count_laws(struct program *p, int laws, const long *evaluations, const bool *acts)
{
    for (int l = 0; l < p->laws && l < laws; l++) {
        struct program_effect *e = &p->effect[p->law[l].effect];

        e->evaluations += evaluations[l];
        e->active |= acts[l];
    }
}

void steady_count(struct program *p, const struct steady_point *point)
{
    steady_count_laws(p, point->laws, point->evaluations, point->acts);
}
