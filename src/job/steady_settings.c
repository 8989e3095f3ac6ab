/* steady_settings.c - the options of steady states, read from the scene's `steady` and the job's options */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "job/steady.h"

static const char *const scene_keys[] = { "harmonics", "samples", "method", "cutoff", "tolerance", "max_iterations", "stability", "start",
                                          "solutions", "dofs", "located", "differences", "relaxation", "subharmonic", "time",
                                          "target.error", "threads", NULL };
static const char *const option_keys[] = { "harmonics", "samples", "method", "cutoff", "tolerance", "max_iterations", "stability", "start",
                                           "solutions", "dofs", "located", "differences", "relaxation", "subharmonic", "time",
                                           "target.error", "threads", "sweep", "continue", "backbone", NULL };
static const char *const methods[] = { "auto", "direct", "newton", "rk4", "adaptive", "shooting", NULL };
static const char *const solutions[] = { "one", "all", NULL };

static enum modal_status read_dof(const cJSON *item, const char *path, const struct program *p, int *out, struct modal_error *err)
{
    int dof = cJSON_IsString(item) ? program_dof(p, item->valuestring) : -1;

    if (dof < 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s is no dof of this scene; its dofs are %s, ... %s",
                                cJSON_IsString(item) ? item->valuestring : "this", p->dofs[0], p->dofs[p->n - 1]);
    *out = dof;
    return MODAL_OK;
}

static enum modal_status read_dofs(const cJSON *object, const char *base, const struct program *p, struct steady_settings *s,
                                   struct modal_error *err)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(object, "dofs"), *item;
    char path[128], full[160];
    bool one = cJSON_IsString(list);                    /* "x1" is ["x1"], as -o dofs=x1 says it */
    int size = one ? 1 : cJSON_GetArraySize(list), count = 0;
    enum modal_status rc = MODAL_OK;

    if (list == NULL)
        return MODAL_OK;
    json_path(path, base, "dofs");
    if (!one && (!cJSON_IsArray(list) || size < 1))
        return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s must be a name of a dof, or a list of them", path);
    free(s->dofs);
    s->dofs = calloc((size_t)size, sizeof *s->dofs);
    if (s->dofs == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for dofs");
    for (item = one ? list : list->child; count < size; item = item->next) {
        snprintf(full, sizeof full, "%s[%d]", path, count);
        rc = read_dof(item, one ? path : full, p, &s->dofs[count++], err);
        if (rc != MODAL_OK)
            return rc;
    }
    s->dofs_count = count;
    return MODAL_OK;
}

/* {"k":[...], "re":[...], "im":[...]} of one dof */
static enum modal_status read_start_dof(const cJSON *entry, const char *path, int dof, struct steady_settings *s, int n,
                                        struct modal_error *err)
{
    static const char *const keys[] = { "k", "re", "im", NULL };
    double *list[3] = { NULL, NULL, NULL };
    size_t count[3];
    enum modal_status rc = json_keys(entry, path, keys, err);

    (void)n;
    for (int i = 0; rc == MODAL_OK && i < 3; i++)
        rc = json_get_numbers(entry, path, keys[i], i == 0 ? 0 : -1e300, i == 0 ? ORBIT_HARMONICS_MOST : 1e300, &list[i], &count[i], err);
    if (rc == MODAL_OK && (count[0] != count[1] || count[1] != count[2] || count[0] == 0))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, path, "k, re and im must be lists of one length");
    for (size_t i = 0; rc == MODAL_OK && i < count[0]; i++) {
        int k = (int)list[0][i];

        if (k != list[0][i])
            rc = modal_fail_field(err, MODAL_BAD_INPUT, path, "k holds %g; accepted: whole numbers", list[0][i]);
        else if (k <= s->start_H)
            s->start[(size_t)dof * ((size_t)s->start_H + 1) + (size_t)k] = CMPLX(list[1][i], k > 0 ? list[2][i] : 0);
    }
    for (int i = 0; i < 3; i++)
        free(list[i]);
    return rc;
}

static enum modal_status read_start(const cJSON *object, const char *base, const struct program *p, struct steady_settings *s,
                                    struct modal_error *err)
{
    const cJSON *start = cJSON_GetObjectItemCaseSensitive(object, "start"), *entry;
    char path[128], one[128];
    enum modal_status rc = MODAL_OK;

    if (start == NULL)
        return MODAL_OK;
    json_path(path, base, "start");
    if (!cJSON_IsObject(start))
        return modal_fail_field(err, MODAL_BAD_INPUT, path, "start must be an object {dof: {\"k\", \"re\", \"im\"}}");
    free(s->start);
    s->start_H = 512;
    s->start = calloc((size_t)p->n * ((size_t)s->start_H + 1), sizeof *s->start);
    if (s->start == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a start");
    cJSON_ArrayForEach(entry, start) {
        int dof = program_dof(p, entry->string);

        json_path(one, path, entry->string);
        if (dof < 0 || !cJSON_IsObject(entry))
            return modal_fail_field(err, MODAL_BAD_INPUT, one, "%s must be a dof of this scene with {\"k\", \"re\", \"im\"}", entry->string);
        rc = read_start_dof(entry, one, dof, s, p->n, err);
        if (rc != MODAL_OK)
            return rc;
    }
    return MODAL_OK;
}

static enum modal_status read_time(const cJSON *object, const char *base, struct steady_settings *s, struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, "time");

    if (item == NULL || cJSON_IsBool(item)) {
        s->time = cJSON_IsTrue(item) ? -1 : s->time;
        return MODAL_OK;
    }
    return json_get_int(object, base, "time", 1, ORBIT_SAMPLES_MOST, &s->time, err);
}

static enum modal_status read_numbers(const cJSON *o, const char *base, struct steady_options *opt, int *subharmonic, struct modal_error *err)
{
    const struct { const char *key; int low, high, *out; } ints[] = {
        { "harmonics", 1, ORBIT_HARMONICS_MOST, &opt->harmonics }, { "samples", 3, ORBIT_SAMPLES_MOST, &opt->samples },
        { "max_iterations", 1, 1000000, &opt->max_iterations }, { "subharmonic", 1, 64, subharmonic } };
    const struct { const char *key; double low, high, *out; } numbers[] = {
        { "cutoff", 0, 1, &opt->cutoff }, { "tolerance", 1e-15, 0.1, &opt->tolerance }, { "relaxation", 1e-6, 1, &opt->relaxation },
        { "target.error", 1e-14, 1, &opt->target_error } };
    enum modal_status rc = MODAL_OK;

    for (size_t i = 0; rc == MODAL_OK && i < sizeof ints / sizeof *ints; i++)
        rc = json_get_int(o, base, ints[i].key, ints[i].low, ints[i].high, ints[i].out, err);
    for (size_t i = 0; rc == MODAL_OK && i < sizeof numbers / sizeof *numbers; i++)
        rc = json_get_number(o, base, numbers[i].key, numbers[i].low, numbers[i].high, numbers[i].out, err);
    return rc;
}

static enum modal_status read_from(const cJSON *o, const char *base, const char *const *keys, const struct program *p,
                                   struct steady_settings *s, bool *located, struct modal_error *err)
{
    int method = (int)s->opt.method, which = s->all, threads = 1;
    enum modal_status rc;

    if (o == NULL)
        return MODAL_OK;
    if (!cJSON_IsObject(o))
        return modal_fail_field(err, MODAL_BAD_INPUT, base[0] ? base : "options", "must be an object");
    if ((rc = json_keys(o, base, keys, err)) != MODAL_OK || (rc = read_numbers(o, base, &s->opt, &s->subharmonic, err)) != MODAL_OK
        || (rc = json_get_choice(o, base, "method", methods, &method, err)) != MODAL_OK
        || (rc = json_get_choice(o, base, "solutions", solutions, &which, err)) != MODAL_OK
        || (rc = json_get_bool(o, base, "stability", &s->stability, err)) != MODAL_OK
        || (rc = json_get_bool(o, base, "located", located, err)) != MODAL_OK
        || (rc = json_get_bool(o, base, "differences", &s->opt.by_differences, err)) != MODAL_OK
        || (rc = json_get_int(o, base, "threads", 1, 256, &threads, err)) != MODAL_OK
        || (rc = read_time(o, base, s, err)) != MODAL_OK || (rc = read_dofs(o, base, p, s, err)) != MODAL_OK
        || (rc = read_start(o, base, p, s, err)) != MODAL_OK)
        return rc;
    s->opt.method = (enum steady_method)method;
    s->all = which == 1;
    return MODAL_OK;
}

static cJSON *show(const struct steady_settings *s, bool located)
{
    cJSON *o = cJSON_CreateObject();

    if (s->opt.harmonics > 0)
        cJSON_AddNumberToObject(o, "harmonics", s->opt.harmonics);
    if (s->opt.samples > 0)
        cJSON_AddNumberToObject(o, "samples", s->opt.samples);
    cJSON_AddStringToObject(o, "method", methods[s->opt.method]);
    cJSON_AddNumberToObject(o, "cutoff", s->opt.cutoff);
    cJSON_AddNumberToObject(o, "tolerance", s->opt.tolerance);
    cJSON_AddNumberToObject(o, "max_iterations", s->opt.max_iterations);
    cJSON_AddBoolToObject(o, "stability", s->stability);
    cJSON_AddStringToObject(o, "solutions", solutions[s->all]);
    cJSON_AddBoolToObject(o, "located", located);
    cJSON_AddBoolToObject(o, "differences", s->opt.by_differences);
    cJSON_AddNumberToObject(o, "subharmonic", s->subharmonic);
    cJSON_AddNumberToObject(o, "target.error", s->opt.target_error);
    if (s->sweep != NULL)
        cJSON_AddStringToObject(o, "sweep", s->sweep);
    if (s->follow != NULL)
        cJSON_AddStringToObject(o, "continue", s->follow);
    if (s->backbone != NULL)
        cJSON_AddStringToObject(o, "backbone", s->backbone);
    return o;
}

enum modal_status steady_settings_read(const struct job_request *request, const struct program *p, struct steady_settings *out,
                                       cJSON **shown, struct modal_error *err)
{
    const cJSON *in_scene = cJSON_GetObjectItemCaseSensitive(request->scene, "steady");
    bool located = true;
    enum modal_status rc;

    memset(out, 0, sizeof *out);
    out->stability = true;
    out->subharmonic = 1;
    out->opt = (struct steady_options) { .tolerance = 1e-12, .target_error = 1e-6, .cancelled = request->cancelled, .context = request->context };
    rc = read_from(in_scene, "steady", scene_keys, p, out, &located, err);
    if (rc == MODAL_OK)
        rc = read_from(request->options, "", option_keys, p, out, &located, err);
    if (rc == MODAL_OK)
        rc = json_get_string(request->options, "", "sweep", &out->sweep, err);
    if (rc == MODAL_OK)
        rc = json_get_string(request->options, "", "continue", &out->follow, err);
    if (rc == MODAL_OK)
        rc = json_get_string(request->options, "", "backbone", &out->backbone, err);
    if (rc == MODAL_OK && (out->sweep != NULL) + (out->follow != NULL) + (out->backbone != NULL) > 1)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, out->follow != NULL ? "continue" : "backbone", "sweep, continue and backbone exclude each other");
    if (rc == MODAL_OK && out->dofs == NULL) {
        out->dofs = calloc((size_t)p->n + 1, sizeof *out->dofs);
        if (out->dofs == NULL)
            rc = modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for dofs");
        for (int i = 0; rc == MODAL_OK && i < p->n; i++)
            out->dofs[i] = i;
        out->dofs_count = p->n;
    }
    if (rc != MODAL_OK) {
        steady_settings_done(out);
        return rc;
    }
    out->opt.unlocated = !located;
    out->opt.dofs = out->dofs;
    out->opt.dofs_count = out->dofs_count;
    *shown = show(out, located);
    return MODAL_OK;
}

enum modal_status steady_settings_start(const struct steady_settings *settings, struct steady *s, struct steady_start *start,
                                        struct modal_error *err)
{
    int q = condense_kept(steady_condense(s)), K = settings->start_H + 1;
    double complex *X;

    if (settings->start == NULL)
        return MODAL_OK;
    X = calloc((size_t)q * (size_t)K + 1, sizeof *X);
    if (X == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a start");
    for (int i = 0; i < q; i++)
        memcpy(X + i * K, settings->start + (size_t)condense_dofs(steady_condense(s))[i] * (size_t)K, (size_t)K * sizeof *X);
    *start = (struct steady_start) { q, settings->start_H, X };
    return MODAL_OK;
}

enum modal_status steady_settings_keys(const cJSON *scene, struct modal_error *err)
{
    const cJSON *steady = cJSON_GetObjectItemCaseSensitive(scene, "steady");

    return steady != NULL ? json_keys(steady, "steady", scene_keys, err) : MODAL_OK;
}

void steady_settings_done(struct steady_settings *s)
{
    free(s->dofs);
    free(s->start);
    s->dofs = NULL;
    s->start = NULL;
}

void steady_subharmonic(struct program *p, int subharmonic)
{
    p->omega /= subharmonic;
    for (int i = 0; i < p->loads; i++)
        p->load[i].k *= subharmonic;
    for (int h = 0; h < p->harmonics; h++)
        p->harmonic[h].k *= subharmonic;
}
