/* steady_settings.c - see steady_settings.h; tested by tests/system/test_curve.py */
#include "job/steady_settings.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/near.h"
#include "modal/scene/orbit.h"
#include "modal/scene/program.h"
#include "modal/steady/condense.h"

static const char *const methods[] = { "auto", "direct", "newton", "rk4",
                                       "adaptive", "shooting", NULL };
static const char *const solutions[] = { "one", "all", NULL };

enum {
    ITERATIONS_MOST = 1000000,       /* days of iteration: who wants more has mistyped */
    REPORTED_ALL = 1000,             /* dofs up to which all are reported unasked */
    SUBHARMONICS_MOST = 64,          /* motions of higher order are not met in practice */
    REDUCE_MOST = 2000,              /* modes: their dense matrices take minutes */
    THREADS_MOST = 256,              /* as identify */
    START_HARMONICS = 512            /* of a given start: more than a converged answer has */
};

#define AT(member) .at = offsetof(struct steady_settings, member)

/* Those that the scene's `steady` may hold too. */
const struct key_row steady_option_rows[] = {
    { "harmonics", KEY_WHOLE, KEY_SHOWN_IF_SET, AT(opt.harmonics), .low = 1,
      .high = ORBIT_HARMONICS_MOST, .meaning = "of each dof; default: what target.error needs",
      .example = "9" },
    { "samples", KEY_WHOLE, KEY_SHOWN_IF_SET, AT(opt.samples), .low = 3, .high = ORBIT_SAMPLES_MOST,
      .meaning = "of one period, for forces in time; default: enough for the laws",
      .example = "1024" },
    { "method", KEY_CHOICE, AT(opt.method), .words = methods, .initial = "auto",
      .meaning = "how the balance is solved; the last three integrate in time",
      .example = "newton" },
    { "cutoff", KEY_NUMBER, AT(opt.cutoff), .low = 0, .high = 1, .initial = "0",
      .meaning = "harmonics below so much of the largest are left out", .example = "1e-3" },
    { "tolerance", KEY_NUMBER, AT(opt.tolerance), .low = 1e-15, .high = 0.1, .initial = "1e-12",
      .meaning = "of the balance", .example = "1e-9" },
    { "max_iterations", KEY_WHOLE, AT(opt.max_iterations), .low = 1, .high = ITERATIONS_MOST,
      .meaning = "of one attempt (default 60); then the best so far is the answer, not converged",
      .example = "100" },
    { "stability", KEY_TRUTH, AT(stability), .initial = "true",
      .meaning = "multipliers of the orbit", .example = "false" },
    { "solutions", KEY_CHOICE, AT(solutions), .words = solutions, .initial = "one",
      .meaning = "all: several starts, no duplicates", .example = "all" },
    { "located", KEY_TRUTH, AT(located), .initial = "true",
      .meaning = "reversals and contacts located inside the sample", .example = "false" },
    { "differences", KEY_TRUTH, AT(opt.by_differences), .initial = "false",
      .meaning = "Newton by difference quotients, as in the paper", .example = "true" },
    { "relaxation", KEY_NUMBER, KEY_SHOWN_IF_SET, AT(opt.relaxation), .low = 1e-6, .high = 1,
      .meaning = "of direct iteration (default 1)", .example = "0.5" },
    { "subharmonic", KEY_WHOLE, AT(subharmonic), .low = 1, .high = SUBHARMONICS_MOST,
      .initial = "1", .meaning = "the fundamental is omega / N", .example = "3" },
    { "reduce", KEY_WHOLE, KEY_SHOWN_IF_SET, AT(opt.reduce), .low = 1, .high = REDUCE_MOST,
      .meaning = "modes in place of the dofs that have no law, load or sensor and are not reported "
      "(Craig-Bampton); their error is told", .example = "40" },
    { "krylov", KEY_NUMBER, KEY_SHOWN_IF_SET, AT(opt.krylov), .low = 1e-14, .high = 0.1,
      .meaning = "of 2000 linear dofs and more, harmonics and frequencies share a Krylov basis "
      "with this error of their receptances, relative; default: 1e-10 along a curve over omega, "
      "none at a point, where each harmonic is factored", .example = "1e-6" },
    { "target.error", KEY_NUMBER, AT(opt.target_error), .low = 1e-14, .high = 1, .initial = "1e-6",
      .meaning = "that default harmonics reach, relative to the largest motion; under several "
      "tones that of each line",
      .example = "1e-3" },
    { "time", KEY_OWN, .low = 1, .high = ORBIT_SAMPLES_MOST, .form = "true|N",
      .meaning = "the waveform too, in N samples", .example = "64" },
    { "dofs", KEY_OWN, .form = "A,B",
      .meaning = "those reported (default all; of more than 1000, and with reduce, those of laws, "
      "loads, sensors)",
      .example = "x1,x2" },
    { "start", KEY_OWN, .form = "{\"A\":{\"k\":[1],\"re\":[1],\"im\":[0]}}",
      .meaning = "where to begin", .example = "{\"x1\":{\"k\":[1],\"re\":[1],\"im\":[0]}}" },
    { "tones", KEY_OWN, .unit = "rad/s", .form = "W1,W2[,W3]",
      .meaning = "two or three tones without a common period, in place of omega; loads name theirs "
      "by k: [k1, k2]; free in place of one: the motion's own, solved for, alone or beside others",
      .example = "1,1.618" },
    { "threads", KEY_WHOLE, KEY_SILENT, AT(threads), .low = 1, .high = THREADS_MOST, .initial = "1",
      .meaning = "that the job is counted for", .example = "2" },
    { 0 },
};

/* Those of the job alone. */
const struct key_row steady_curve_rows[] = {
    { "sweep", KEY_TEXT, KEY_SHOWN_IF_SET, AT(sweep), .form = "PATH=A:B:N",
      .meaning = "a solution at each of N values of omega, of tones[J], or of a number of the "
      "scene",
      .example = "omega=0.5:2:31" },
    { "continue", KEY_TEXT, KEY_SHOWN_IF_SET, AT(follow), .form = "PATH=A:B",
      .meaning = "the curve of solutions from A to B, around its folds", .example = "omega=0.5:2" },
    { "backbone", KEY_TEXT, KEY_SHOWN_IF_SET, AT(backbone), .form = "MODE:A:B[:N]",
      .meaning = "free vibration of a mode from amplitude A to B, at N of them, or along its "
      "curve and round its folds, in place of the forced one", .example = "1:0.1:2:20" },
    { 0 },
};

static enum modal_status read_dof(const cJSON *item, const char *path, const struct program *p,
                                  int *out, struct modal_error *err)
{
    const char *name = cJSON_IsString(item) ? item->valuestring : "this";
    int dof = cJSON_IsString(item) ? program_dof(p, name) : -1;
    char meant[NEAR_TEXT];

    if (dof < 0) {
        near_given(name, (const char *const *)p->dofs, (size_t)p->n, meant);
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "%.40s is no dof of this scene%s; its dofs are %s, ... %s", name,
                                meant, p->dofs[0], p->dofs[p->n - 1]);
    }
    *out = dof;
    return MODAL_OK;
}

static enum modal_status read_dofs(const cJSON *object, const char *base, const struct program *p,
                                   struct steady_settings *s, struct modal_error *err)
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
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "%s must be a name of a dof, or a list of them", path);
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
static enum modal_status read_start_dof(const cJSON *entry, const char *path, int dof,
                                        struct steady_settings *s, struct modal_error *err)
{
    static const char *const keys[] = { "k", "re", "im", NULL };
    double *list[3] = { NULL, NULL, NULL };
    size_t count[3];
    enum modal_status rc = json_keys(entry, path, keys, err);

    for (int i = 0; rc == MODAL_OK && i < 3; i++)
        rc = json_get_numbers(entry, path, keys[i], i == 0 ? 0 : -1e300,
                              i == 0 ? ORBIT_HARMONICS_MOST : 1e300, &list[i], &count[i], err);
    if (rc == MODAL_OK && (count[0] != count[1] || count[1] != count[2] || count[0] == 0))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, path,
                              "k, re and im must be lists of one length");
    for (size_t i = 0; rc == MODAL_OK && i < count[0]; i++) {
        int k = (int)list[0][i];

        if (k != list[0][i])
            rc = modal_fail_field(err, MODAL_BAD_INPUT, path, "k holds %g; accepted: whole numbers",
                                  list[0][i]);
        else if (k <= s->start_H)
            s->start[(size_t)dof * ((size_t)s->start_H + 1) + (size_t)k] =
                CMPLX(list[1][i], k > 0 ? list[2][i] : 0);
    }
    for (int i = 0; i < 3; i++)
        free(list[i]);
    return rc;
}

static enum modal_status read_start(const cJSON *object, const char *base, const struct program *p,
                                    struct steady_settings *s, struct modal_error *err)
{
    const cJSON *start = cJSON_GetObjectItemCaseSensitive(object, "start"), *entry;
    char path[128], one[128];
    enum modal_status rc = MODAL_OK;

    if (start == NULL)
        return MODAL_OK;
    json_path(path, base, "start");
    if (!cJSON_IsObject(start))
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "start must be an object {dof: {\"k\", \"re\", \"im\"}}");
    free(s->start);
    s->start_H = START_HARMONICS;
    s->start = calloc((size_t)p->n * ((size_t)s->start_H + 1), sizeof *s->start);
    if (s->start == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a start");
    cJSON_ArrayForEach(entry, start) {
        int dof = program_dof(p, entry->string);

        json_path(one, path, entry->string);
        if (dof < 0 || !cJSON_IsObject(entry))
            return modal_fail_field(err, MODAL_BAD_INPUT, one,
                                    "%s must be a dof of this scene with {\"k\", \"re\", \"im\"}",
                                    entry->string);
        rc = read_start_dof(entry, one, dof, s, err);
        if (rc != MODAL_OK)
            return rc;
    }
    return MODAL_OK;
}

static enum modal_status read_time(const cJSON *object, const char *base, struct steady_settings *s,
                                   struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, "time");

    if (item == NULL || cJSON_IsBool(item)) {
        s->time = cJSON_IsTrue(item) ? -1 : s->time;
        return MODAL_OK;
    }
    return json_get_int(object, base, "time", 1, ORBIT_SAMPLES_MOST, &s->time, err);
}

static const double TONE_LEAST = 1e-9;    /* rad/s: slower than any machine */
static const double TONE_MOST = 1e12;     /* rad/s: faster than any */

static bool is_free(const cJSON *item)
{
    return cJSON_IsString(item) && strcmp(item->valuestring, "free") == 0;
}

/* A list, or the word `free` alone. */
static enum modal_status read_tones(const cJSON *object, const char *base,
                                    struct steady_settings *s, struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, "tones");
    int count = cJSON_IsArray(item) ? cJSON_GetArraySize(item) : is_free(item);
    char path[128], place[160];

    if (item == NULL)
        return MODAL_OK;
    json_path(path, base, "tones");
    s->tones_count = s->free_tone = 0;
    for (int i = 0; i < count && count <= PROGRAM_TONES_MOST; i++) {
        const cJSON *tone = cJSON_IsArray(item) ? cJSON_GetArrayItem(item, i) : item;

        snprintf(place, sizeof place, "%s[%d]", path, i);
        s->tones[i] = cJSON_IsNumber(tone) ? tone->valuedouble : 0;
        if (is_free(tone) && s->free_tone == 0)
            s->free_tone = i + 1;
        else if (!(s->tones[i] >= TONE_LEAST && s->tones[i] <= TONE_MOST))
            return modal_fail_field(err, MODAL_BAD_INPUT, place,
                                    "%s must be a frequency from %g to %g rad/s, or, of one of "
                                    "them, \"free\": the motion's own", place, TONE_LEAST,
                                    TONE_MOST);
    }
    if (count < (s->free_tone > 0 ? 1 : 2) || count > PROGRAM_TONES_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "%s must be two or three frequencies in rad/s, of which one may be "
                                "\"free\", or that alone; one that is known is the scene's omega",
                                path);
    s->tones_count = count;
    return MODAL_OK;
}

/* As it was given. */
static cJSON *show_tones(const struct steady_settings *s)
{
    cJSON *list = cJSON_CreateArray();

    for (int i = 0; i < s->tones_count; i++)
        cJSON_AddItemToArray(list, i + 1 == s->free_tone ? cJSON_CreateString("free")
                                                         : cJSON_CreateNumber(s->tones[i]));
    return list;
}

/* O, the scene's `steady` (BASE) or the job's options, with ROWS beside those that both may
 * hold. */
static enum modal_status read_from(const cJSON *o, const char *base, const struct key_row *rows,
                                   const struct program *p, struct steady_settings *s,
                                   struct modal_error *err)
{
    enum modal_status rc;

    if (o == NULL)
        return MODAL_OK;
    if (!cJSON_IsObject(o))
        return modal_fail_field(err, MODAL_BAD_INPUT, base[0] ? base : "options",
                                "must be an object");
    if ((rc = key_table_check(steady_option_rows, rows, o, base, err)) != MODAL_OK
        || (rc = key_table_read(steady_option_rows, o, base, s, err)) != MODAL_OK
        || (rows != NULL && (rc = key_table_read(rows, o, base, s, err)) != MODAL_OK)
        || (rc = read_time(o, base, s, err)) != MODAL_OK
        || (rc = read_tones(o, base, s, err)) != MODAL_OK
        || (rc = read_dofs(o, base, p, s, err)) != MODAL_OK)
        return rc;
    return read_start(o, base, p, s, err);
}

/* A curve is of one kind. */
static enum modal_status check_curve(const struct steady_settings *s, struct modal_error *err)
{
    if ((s->sweep != NULL) + (s->follow != NULL) + (s->backbone != NULL) > 1)
        return modal_fail_field(err, MODAL_BAD_INPUT, s->follow != NULL ? "continue" : "backbone",
                                "sweep, continue and backbone exclude each other");
    if (s->opt.reduce > 0 && (s->tones_count > 0 || s->backbone != NULL))
        return modal_fail_field(err, MODAL_BAD_INPUT, "reduce",
                                "reduce does not go with %s: leave one of them out",
                                s->backbone != NULL ? "backbone" : "tones");
    return MODAL_OK;
}

/* Whether dof I is an end of a law, loaded or, where the scene names fewer sensors than dofs, one
 * of theirs, into OF. */
static void mark_ends(const struct program *p, bool *of)
{
    for (int l = 0; l < p->laws; l++)
        for (int e = 0; e < law_ends(&p->law[l]); e++)
            of[p->law[l].end[e].dof] = true;
    for (int l = 0; l < p->loads; l++)
        of[p->load[l].dof] = true;
    for (int o = 0; p->outputs < p->n && o < p->outputs; o++)
        for (int t = 0; t < p->output[o].count; t++)
            if (p->output[o].terms[t].i % 4 != 3)       /* of dofs, not of linear states */
                of[p->output[o].terms[t].j] = true;
}

/* Without `dofs`, all; of more than REPORTED_ALL, and with reduce, those of laws, loads and
 * sensors: these and `dofs` are what a reduction keeps. */
static enum modal_status report_all(const struct program *p, struct steady_settings *s,
                                    struct modal_error *err)
{
    bool *ends = calloc((size_t)p->n + 1, sizeof *ends), given = s->dofs != NULL,
         all = p->n <= REPORTED_ALL && s->opt.reduce == 0;

    if (!given)
        s->dofs = calloc((size_t)p->n + 1, sizeof *s->dofs);
    s->keep = calloc((size_t)p->n + 1, sizeof *s->keep);
    if (s->dofs == NULL || s->keep == NULL || ends == NULL) {
        free(ends);
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for dofs");
    }
    mark_ends(p, ends);
    for (int i = 0; i < p->n && !given; i++)
        if (all || ends[i])
            s->dofs[s->dofs_count++] = i;
    for (int i = 0; given && i < s->dofs_count; i++)
        ends[s->dofs[i]] = true;
    for (int i = 0; i < p->n; i++)
        if (ends[i])
            s->keep[s->keep_count++] = i;
    free(ends);
    return MODAL_OK;
}

enum modal_status steady_settings_read(const struct job_request *request, const struct program *p,
                                       struct steady_settings *out, cJSON **shown,
                                       struct modal_error *err)
{
    const cJSON *in_scene = cJSON_GetObjectItemCaseSensitive(request->scene, "steady");
    enum modal_status rc;

    *out = (struct steady_settings){ .opt = { .cancelled = request->cancelled,
                                              .context = request->context } };
    key_table_defaults(steady_option_rows, out);
    rc = read_from(in_scene, "steady", NULL, p, out, err);
    if (rc == MODAL_OK)
        rc = read_from(request->options, "", steady_curve_rows, p, out, err);
    if (rc == MODAL_OK)
        rc = check_curve(out, err);
    if (rc == MODAL_OK)
        rc = report_all(p, out, err);
    if (rc != MODAL_OK) {
        steady_settings_done(out);
        return rc;
    }
    out->opt.unlocated = !out->located;
    out->opt.dofs = out->dofs;
    out->opt.dofs_count = out->dofs_count;
    out->opt.keep = out->keep;
    out->opt.keep_count = out->keep_count;
    *shown = cJSON_CreateObject();
    if (out->tones_count > 0)
        cJSON_AddItemToObject(*shown, "tones", show_tones(out));
    key_table_write(steady_option_rows, out, *shown);
    key_table_write(steady_curve_rows, out, *shown);
    return MODAL_OK;
}

enum modal_status steady_settings_start(const struct steady_settings *settings, struct steady *s,
                                        struct steady_start *start, struct modal_error *err)
{
    int q = condense_kept(steady_condense(s)), K = settings->start_H + 1;
    double complex *X;

    if (settings->start == NULL)
        return MODAL_OK;
    X = calloc((size_t)q * (size_t)K + 1, sizeof *X);
    if (X == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a start");
    for (int i = 0; i < q; i++) {
        int dof = steady_dof(s, condense_dofs(steady_condense(s))[i]);

        if (dof >= 0)
            memcpy(X + i * K, settings->start + (size_t)dof * (size_t)K, (size_t)K * sizeof *X);
    }
    *start = (struct steady_start) { q, settings->start_H, X };
    return MODAL_OK;
}

enum modal_status steady_settings_keys(const cJSON *scene, struct modal_error *err)
{
    const cJSON *steady = cJSON_GetObjectItemCaseSensitive(scene, "steady");

    return steady != NULL ? key_table_check(steady_option_rows, NULL, steady, "steady", err)
                          : MODAL_OK;
}

void steady_settings_done(struct steady_settings *s)
{
    free(s->dofs);
    free(s->start);
    free(s->keep);
    s->keep = NULL;
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
