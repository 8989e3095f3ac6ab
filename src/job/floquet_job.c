/* floquet_job.c - kind `floquet`: exact exponents of a linear scene, by monodromy matrix and by
 * Hill's determinant
 *
 * Tested by tests/unit/job/test_scene_jobs.c. */
#include <math.h>
#include <stdio.h>
#include "job/cost.h"
#include "job/plan.h"
#include "job/scene_jobs.h"
#include "modal/scene/floquet.h"
#include "modal/scene/hill.h"
#include "modal/scene/scene.h"

struct options {
    double tolerance;
    bool hill;
    int harmonics;          /* of Hill's determinant; 0: chosen */
    int multipliers;        /* see floquet.h */
    int threads;
};

enum {
    HARMONICS_MOST = 200,  /* of Hill's determinant: its matrix has (2 h + 1) n rows */
    LEADING_MOST = 500     /* multipliers: chosen, as many as the whole spectrum serves */
};

#define AT(member) .at = offsetof(struct options, member)

const struct key_row floquet_option_rows[] = {
    { "tolerance", KEY_NUMBER, AT(tolerance), .low = FLOQUET_TOLERANCE_LEAST,
      .high = FLOQUET_TOLERANCE_MOST, .initial = "1e-12", .meaning = "of the monodromy matrix",
      .example = "1e-9" },
    { "hill", KEY_TRUTH, AT(hill), .initial = "true",
      .meaning = "Hill's determinant as a second, independent way", .example = "false" },
    { "hill.harmonics", KEY_WHOLE, AT(harmonics), .low = 0, .high = HARMONICS_MOST, .initial = "0",
      .meaning = "of it; 0: until its truncation is small", .example = "20" },
    { "multipliers", KEY_WHOLE, KEY_SHOWN_IF_SET, AT(multipliers), .low = 0, .high = LEADING_MOST,
      .initial = "0", .meaning = "of a periodic scene: so many of largest modulus, each by its "
                                 "residual; 0: all, of more than 500 states or "
                                 "stiff ones 10", .example = "20" },
    { "threads", KEY_WHOLE, KEY_SILENT, AT(threads), .low = 1, .high = JOB_THREADS_MOST,
      .initial = "1", .meaning = "that the job is counted for", .example = "2" },
    { 0 },
};

static cJSON *complex_or_null(double complex z, bool known)
{
    return known ? json_complex(creal(z), cimag(z)) : cJSON_CreateNull();
}

/* One entry per conjugate pair and per real exponent. */
static cJSON *print_modes(const struct floquet *f)
{
    cJSON *modes = cJSON_CreateArray();

    for (int i = 0; i < f->count; i++) {
        double complex lambda = f->exponent[i];
        double omega = cabs(lambda);
        if (!f->resolved[i] || (cimag(lambda) < 0 && (!f->periodic || cimag(f->multiplier[i]) < 0)))
            continue;
        cJSON *mode = cJSON_CreateObject();
        json_set_number(mode, "frequency_hz", omega / (2 * M_PI));
        json_set_number(mode, "frequency_rad_s", omega);
        json_set_number(mode, "damped_frequency_rad_s", fabs(cimag(lambda)));
        json_set_number(mode, "damping_ratio", omega > 0 ? -creal(lambda) / omega : 0);
        cJSON_AddItemToObject(mode, "exponent", json_complex(creal(lambda), cimag(lambda)));
        if (f->period > 0)
            cJSON_AddItemToObject(mode, "multiplier",
                                  json_complex(creal(f->multiplier[i]), cimag(f->multiplier[i])));
        json_set_number(mode, "error", f->bar[i]);
        cJSON_AddItemToArray(modes, mode);
    }
    return modes;
}

cJSON *floquet_stability(const struct floquet *f)
{
    cJSON *s = cJSON_CreateObject();

    if (f->stable == FLOQUET_UNDECIDED)
        cJSON_AddNullToObject(s, "stable");
    else
        cJSON_AddBoolToObject(s, "stable", f->stable == FLOQUET_STABLE);
    json_set_number(s, "max_multiplier", f->period > 0 ? f->max_multiplier : NAN);
    json_set_number(s, "margin", f->margin);
    json_set_number(s, "error", f->count > 0 ? f->bar[0] : NAN);
    return s;
}

static cJSON *print_hill(const struct hill *h, const struct floquet *f)
{
    cJSON *json = cJSON_CreateObject(), *list = cJSON_AddArrayToObject(json, "exponents");
    double worst = 0, W = 2 * M_PI / f->period;

    for (int i = 0; i < h->count; i++)
        cJSON_AddItemToArray(list, json_complex(creal(h->exponent[i]), cimag(h->exponent[i])));
    cJSON_AddNumberToObject(json, "harmonics", h->harmonics);
    json_set_number(json, "truncation", h->truncation);
    for (int i = 0; i < f->count; i++) {
        double least = HUGE_VAL;
        for (int j = 0; j < h->count && f->resolved[i]; j++)
            least = fmin(least, hypot(creal(f->exponent[i]) - creal(h->exponent[j]),
                                      remainder(cimag(f->exponent[i]) - cimag(h->exponent[j]), W)));
        worst = f->resolved[i] ? fmax(worst, least) : worst;
    }
    /* the largest, of a resolved exponent from Hill's nearest */
    json_set_number(json, "difference", worst);
    return json;
}

void floquet_values(cJSON *r, const struct floquet *f)
{
    cJSON *list;

    if (f->period > 0) {
        json_set_number(r, "period", f->period);
        list = cJSON_AddArrayToObject(r, "multipliers");
        for (int i = 0; i < f->count; i++)
            cJSON_AddItemToArray(list, complex_or_null(f->multiplier[i], f->resolved[i]));
    }
    list = cJSON_AddArrayToObject(r, "exponents");
    for (int i = 0; i < f->count; i++)
        cJSON_AddItemToArray(list, complex_or_null(f->exponent[i], f->resolved[i]));
}

static cJSON *print_result(const struct program *p, const struct floquet *f)
{
    cJSON *r = cJSON_CreateObject();

    cJSON_AddStringToObject(r, "kind", "floquet");
    floquet_values(r, f);
    cJSON_AddItemToObject(r, "errors", json_numbers(f->bar, (size_t)f->count));
    cJSON_AddItemToObject(r, "modes", print_modes(f));
    cJSON_AddItemToObject(r, "stability", floquet_stability(f));
    if (f->periodic) {
        cJSON *m = cJSON_AddObjectToObject(r, "monodromy");
        cJSON_AddNumberToObject(m, "substeps", f->substeps);
        json_set_number(m, "error", f->error);
    }
    cJSON_AddItemToObject(r, "plan", plan_print(p, f->windows > 0 ? "hill"
                                                     : f->leading  ? "arnoldi"
                                                     : f->periodic ? "magnus"
                                                                   : "eigenvalues"));
    return r;
}

static void floquet_diagnose(cJSON *result, const char *code, const char *message)
{
    cJSON *list = cJSON_GetObjectItem(result, "diagnostics"), *d = cJSON_CreateObject();

    if (list == NULL)
        list = cJSON_AddArrayToObject(result, "diagnostics");
    cJSON_AddStringToObject(d, "code", code);
    cJSON_AddStringToObject(d, "message", message);
    cJSON_AddItemToArray(list, d);
}

/* The best so far, and what would buy more. */
static void diagnose_unsettled(cJSON *result, const struct floquet *f)
{
    char text[600], sums[160] = "";

    if (f->sums_to > 0)
        snprintf(sums, sizeof sums, ": pairs that may grow by the sum of their frequencies were "
                 "looked for up to %.4g rad/s alone", f->sums_to);
    snprintf(text, sizeof text, "%d vectors carried over a period and %d windows of Hill's matrix "
             "do not settle which %d multipliers are the leading ones: those given are the best so "
             "far, residual %.2g, and a larger one may be missing%s; give a smaller multipliers, "
             "or damping that tells them apart",
             f->periods, f->windows, f->count, f->error, sums);
    floquet_diagnose(result, "multipliers_unsettled", text);
}

/* Which of equals are given is chance. */
static void diagnose_alike(cJSON *result, const struct floquet *f)
{
    char text[300];

    snprintf(text, sizeof text, "others have the modulus %.12g of the last of these %d to within "
             "its bar, as all of an undamped system have that is stable: which of them are given "
             "is chance", cabs(f->multiplier[f->count - 1]), f->count);
    floquet_diagnose(result, "multipliers_alike", text);
}

/* Hill's way is a check: where it is too large for its limit, the result says so and stands. */
static enum modal_status add_hill(cJSON *result, const struct program *p, const struct floquet *f,
                                  const struct options *o, struct modal_error *err)
{
    struct hill h;
    struct modal_error why;
    enum modal_status rc;

    if (!o->hill || !f->periodic || f->leading || p->seen_fixed)
        return MODAL_OK;
    rc = hill(p, o->harmonics, &h, &why);
    if (rc == MODAL_TOO_LARGE && o->harmonics == 0) {
        floquet_diagnose(result, "hill_too_large", why.message);
        return MODAL_OK;
    }
    if (rc != MODAL_OK) {
        if (err != NULL)
            *err = why;
        return rc;
    }
    cJSON_AddItemToObject(result, "hill", print_hill(&h, f));
    hill_done(&h);
    return MODAL_OK;
}

enum modal_status floquet_run(const struct job_request *request, struct job_result *out,
                              struct modal_error *err)
{
    struct options o = { 0 };
    struct scene_options with = { .arrays = request->arrays };
    struct program *p = NULL;
    struct floquet f = { 0 };
    struct cost cost;
    enum modal_status rc = key_table_options(floquet_option_rows, request->options, &o, err);

    cost_start(&cost);
    if (rc == MODAL_OK)
        rc = scene_lower(request->scene, &with, &p, err);
    cost_stage(&cost, "lower");
    if (rc == MODAL_OK)
        rc = floquet(p, &(struct floquet_options) { o.tolerance, o.multipliers }, &f, err);
    cost_stage(&cost, "floquet");
    if (rc == MODAL_OK) {
        out->result = print_result(p, &f);
        if (f.unsettled)
            diagnose_unsettled(out->result, &f);
        if (f.alike)
            diagnose_alike(out->result, &f);
        rc = add_hill(out->result, p, &f, &o, err);
        cost_stage(&cost, "hill");
    }
    if (rc == MODAL_OK) {
        cJSON *shown = cJSON_CreateObject();

        key_table_write(floquet_option_rows, &o, shown);
        cJSON_AddItemToObject(out->result, "cost", cost_print(&cost));
        cJSON_AddItemToObject(out->result, "provenance", provenance_print(request, shown));
    }
    floquet_done(&f);
    program_free(p);
    return rc;
}
