/*
 * sweep.c - see sweep.h
 *
 * The scene is copied once; a point sets its values in the copy and lowers it.  Floquet's points,
 * of which maps of stability have tens of thousands, call the solver directly; the other verbs go
 * through their kinds.
 *
 * Tested by tests/unit/job/test_scene_jobs.c.
 */
#include "job/sweep.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "job/cost.h"
#include "job/identify_job.h"
#include "job/kind_run.h"
#include "job/scene_jobs.h"
#include "job/scene_path.h"
#include "job/steady.h"
#include "modal/scene/floquet.h"
#include "modal/scene/scene.h"

/* Points between two reports: what is lost with a worker, and a message of some 100 kB. */
enum { CHUNK_MOST = 2048 };
/* s between two reports: what a watcher takes for alive. */
static const double CHUNK_SECONDS = 1;

struct axis { const char *path; double *values; size_t count; };

struct sweep {
    const struct sweep_verb *verb;
    const cJSON *options;
    cJSON *scene;                      /* our copy, set point by point */
    int axes, points;
    struct axis axis[SWEEP_AXES_MOST];
};

/* What a point computes: into POINT, {"index"} so far. */
struct sweep_verb {
    const char *name;
    enum modal_status (*run)(struct sweep *, const struct job_request *, cJSON *point,
                             struct modal_error *);
};

/* The points of a job: COUNT from FIRST on. */
struct share { int first, count, threads; };

#define AT(member) .at = offsetof(struct share, member)

const struct key_row sweep_option_rows[] = {
    { "first", KEY_WHOLE, AT(first), .low = 0, .high = SWEEP_POINTS_MOST - 1, .initial = "0",
      .form = "I", .meaning = "the first point of a share", .example = "64" },
    { "count", KEY_WHOLE, AT(count), .low = 1, .high = SWEEP_POINTS_MOST,
      .meaning = "the points in it; default: all from the first on", .example = "64" },
    { "threads", KEY_WHOLE, KEY_SILENT, AT(threads), .low = 1, .high = JOB_THREADS_MOST,
      .initial = "1", .meaning = "that the job is counted for", .example = "2" },
    { 0 },
};

const struct key_row sweep_document_rows[] = {
    { "verb", KEY_OWN, .initial = "floquet", .form = "\"NAME\"",
      .meaning = "what is computed at each point: floquet, steady, or identify of the scene's "
      "motion", .example = "\"steady\"" },
    { "scene", KEY_OWN, .form = "{...}", .meaning = "the scene", .example = "{}" },
    { "grid", KEY_OWN, .form = "[AXIS,...]",
      .meaning = "1 to 6 axes, the last running fastest",
      .example = "[{\"path\":\"omega\",\"values\":[1,2]}]" },
    { "options", KEY_OWN, .form = "{...}", .meaning = "the verb's own",
      .example = "{\"tolerance\":1e-9}" },
    { 0 },
};

const struct key_row sweep_axis_rows[] = {
    { "path", KEY_OWN, .form = "\"PATH\"",
      .meaning = "of a number of the scene", .example = "\"effects[0].stiffness\"" },
    { "values", KEY_OWN, .form = "[X,...]", .meaning = "that it takes, one after the other",
      .example = "[1,1.5,2]" },
    { 0 },
};

static void add_stability(cJSON *point, const struct floquet *f)
{
    cJSON_AddItemToObject(point, "stability", floquet_stability(f));
    if (f->count > 0 && f->resolved[0])
        cJSON_AddItemToObject(point, "exponent",
                              json_complex(creal(f->exponent[0]), cimag(f->exponent[0])));
}

static enum modal_status run_floquet(struct sweep *s, const struct job_request *request,
                                     cJSON *point, struct modal_error *err)
{
    struct floquet_options o = { 0 };
    struct scene_options with = { .arrays = request->arrays };
    struct floquet f;
    struct program *p = NULL;
    enum modal_status rc = json_get_number(s->options, "options", "tolerance",
                                           FLOQUET_TOLERANCE_LEAST, FLOQUET_TOLERANCE_MOST,
                                           &o.tolerance, err);

    if (rc == MODAL_OK)
        rc = scene_lower(s->scene, &with, &p, err);
    if (rc == MODAL_OK)
        rc = floquet(p, &o, &f, err);
    if (rc == MODAL_OK) {
        add_stability(point, &f);
        floquet_done(&f);
    }
    program_free(p);
    return rc;
}

/* A kind's result moves into the point, but for what every point would repeat. */
static void move_members(cJSON *result, cJSON *point)
{
    static const char *const shared[] = { "kind", "provenance", "plan" };

    for (size_t i = 0; i < sizeof shared / sizeof *shared; i++)
        cJSON_DeleteItemFromObjectCaseSensitive(result, shared[i]);
    while (result->child != NULL) {
        cJSON *item = cJSON_DetachItemViaPointer(result, result->child);
        cJSON_AddItemToObject(point, item->string, item);
    }
}

static enum modal_status run_steady(struct sweep *s, const struct job_request *request,
                                    cJSON *point, struct modal_error *err)
{
    struct job_request inner = { .kind = "steady", .options = s->options, .scene = s->scene,
                                 .arrays = request->arrays,
                                 .cancelled = request->cancelled, .context = request->context };
    struct job_result r;
    enum modal_status rc = kind_run(steady_run, &inner, &r, err);

    if (rc != MODAL_OK)
        return rc;
    move_members(r.result, point);
    job_result_done(&r);
    return MODAL_OK;
}

/* Of the scene's motion. */
static enum modal_status run_identify(struct sweep *s, const struct job_request *request,
                                      cJSON *point, struct modal_error *err)
{
    struct job_request moves = { .kind = "simulate", .scene = s->scene,
                                 .arrays = request->arrays,
                                 .cancelled = request->cancelled, .context = request->context };
    struct job_result motion, r;
    struct job_request inner = { .kind = "identify", .options = s->options, .batch = &motion.batch,
                                 .cancelled = request->cancelled, .context = request->context };
    enum modal_status rc = kind_run(simulate_run, &moves, &motion, err);

    if (rc != MODAL_OK)
        return rc;
    rc = kind_run(identify_run, &inner, &r, err);
    job_result_done(&motion);
    if (rc != MODAL_OK)
        return rc;
    move_members(r.result, point);
    job_result_done(&r);
    return MODAL_OK;
}

static const struct sweep_verb verbs[] = {
    { "floquet", run_floquet },
    { "steady", run_steady },
    { "identify", run_identify },
};
enum { VERBS = sizeof verbs / sizeof *verbs };

static enum modal_status read_axis(struct sweep *s, const cJSON *json, const char *base,
                                   struct modal_error *err)
{
    struct axis *axis = &s->axis[s->axes++];
    char field[128];
    enum modal_status rc = key_table_check(sweep_axis_rows, NULL, json, base, err);

    if (rc == MODAL_OK)
        rc = json_need_string(json, base, "path", &axis->path, err);
    if (rc == MODAL_OK)
        rc = json_get_numbers(json, base, "values", -HUGE_VAL, HUGE_VAL, &axis->values,
                              &axis->count, err);
    json_path(field, base, "values");
    if (rc == MODAL_OK && axis->count < 1)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, field, "%s must list at least one number",
                              field);
    json_path(field, base, "path");
    if (rc == MODAL_OK)
        rc = scene_path_set(s->scene, axis->path, axis->values[0], field, err);
    if (rc == MODAL_OK && (double)s->points * (double)axis->count > SWEEP_POINTS_MOST)
        rc = modal_fail_field(err, MODAL_TOO_LARGE, "grid", "the grid has more than %d points",
                              SWEEP_POINTS_MOST);
    if (rc == MODAL_OK)
        s->points *= (int)axis->count;
    return rc;
}

static enum modal_status read_grid(struct sweep *s, const cJSON *document, struct modal_error *err)
{
    const cJSON *grid = cJSON_GetObjectItemCaseSensitive(document, "grid"), *item;
    char base[32];
    enum modal_status rc = MODAL_OK;

    if (!cJSON_IsArray(grid) || cJSON_GetArraySize(grid) < 1
        || cJSON_GetArraySize(grid) > SWEEP_AXES_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "grid",
                                "grid must list 1 to %d axes {\"path\", \"values\"}",
                                SWEEP_AXES_MOST);
    cJSON_ArrayForEach(item, grid) {
        snprintf(base, sizeof base, "grid[%d]", s->axes);
        if (rc == MODAL_OK)
            rc = read_axis(s, item, base, err);
    }
    return rc;
}

static enum modal_status read_document(struct sweep *s, const cJSON *document,
                                       struct modal_error *err)
{
    const char *names[VERBS + 1] = { NULL };
    const cJSON *scene = cJSON_GetObjectItemCaseSensitive(document, "scene");
    int verb = 0;
    enum modal_status rc = key_table_check(sweep_document_rows, NULL, document, "", err);

    for (int i = 0; i < VERBS; i++)
        names[i] = verbs[i].name;
    if (rc == MODAL_OK)
        rc = json_get_choice(document, "", "verb", names, &verb, err);
    if (rc != MODAL_OK)
        return rc;
    s->verb = &verbs[verb];
    s->options = cJSON_GetObjectItemCaseSensitive(document, "options");
    if (s->options != NULL && !cJSON_IsObject(s->options))
        return modal_fail_field(err, MODAL_BAD_INPUT, "options", "options must be an object");
    if (!cJSON_IsObject(scene))
        return modal_fail_field(err, MODAL_BAD_INPUT, "scene", "a sweep needs an object \"scene\"");
    if ((s->scene = cJSON_Duplicate(scene, 1)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "sweep: out of memory");
    s->points = 1;
    return read_grid(s, document, err);
}

enum modal_status sweep_new(const cJSON *document, struct sweep **out, struct modal_error *err)
{
    struct sweep *s = calloc(1, sizeof *s);
    enum modal_status rc = s != NULL ? read_document(s, document, err)
                                     : modal_fail(err, MODAL_NO_MEMORY, "sweep: out of memory");

    if (rc == MODAL_OK)
        *out = s;
    else
        sweep_free(s);
    return rc;
}

void sweep_free(struct sweep *s)
{
    if (s == NULL)
        return;
    for (int i = 0; i < s->axes; i++)
        free(s->axis[i].values);
    cJSON_Delete(s->scene);
    free(s);
}

int sweep_points(const struct sweep *s)
{
    return s->points;
}

static enum modal_status set_point(struct sweep *s, int point, cJSON *index,
                                   struct modal_error *err)
{
    int digits[SWEEP_AXES_MOST];
    enum modal_status rc = MODAL_OK;

    for (int a = s->axes - 1; a >= 0; a--) {
        digits[a] = point % (int)s->axis[a].count;
        point /= (int)s->axis[a].count;
    }
    for (int a = 0; a < s->axes && rc == MODAL_OK; a++) {
        char field[32];
        snprintf(field, sizeof field, "grid[%d].path", a);
        cJSON_AddItemToArray(index, cJSON_CreateNumber(digits[a]));
        rc = scene_path_set(s->scene, s->axis[a].path, s->axis[a].values[digits[a]], field, err);
    }
    return rc;
}

/* Whether a failure is the point's own, to be told in its row, or the job's. */
static bool of_the_point(enum modal_status rc)
{
    return rc != MODAL_CANCELLED && rc != MODAL_NO_MEMORY && rc != MODAL_INTERNAL;
}

static void add_error(cJSON *point, enum modal_status rc, const struct modal_error *err)
{
    cJSON *e = cJSON_AddObjectToObject(point, "error");

    cJSON_AddStringToObject(e, "code", modal_status_code(rc));
    cJSON_AddStringToObject(e, "message", err->message);
    if (err->field[0] != '\0')
        cJSON_AddStringToObject(e, "field", err->field);
}

/* Points FIRST .. FIRST + COUNT - 1, appended to the array POINTS: {"index", "stability", ...}, or
 * {"index", "error"} where the point's own scene is at fault.  Where REQUEST is cancelled POINTS
 * has those before. */
static enum modal_status run_points(struct sweep *s, int first, int count,
                                    const struct job_request *request, cJSON *points,
                                    struct modal_error *err)
{
    for (int p = first; p < first + count; p++) {
        struct modal_error why = { 0 };
        cJSON *point = cJSON_CreateObject(), *index = cJSON_AddArrayToObject(point, "index");
        enum modal_status rc;
        if (job_cancelled(request)) {
            cJSON_Delete(point);
            return modal_fail(err, MODAL_CANCELLED, "sweep: cancelled at point %d of %d", p,
                              s->points);
        }
        rc = set_point(s, p, index, &why);
        if (rc == MODAL_OK)
            rc = s->verb->run(s, request, point, &why);
        if (rc != MODAL_OK && !of_the_point(rc)) {
            cJSON_Delete(point);
            if (err != NULL)
                *err = why;
            return rc;
        }
        if (rc != MODAL_OK)
            add_error(point, rc, &why);
        cJSON_AddItemToArray(points, point);
    }
    return MODAL_OK;
}

static void report(const struct job_request *request, const cJSON *chunk, int done, int share,
                   int first, int count)
{
    cJSON *event;

    if (request->progress == NULL)
        return;
    event = cJSON_CreateObject();
    json_set_number(event, "fraction", (double)done / share);
    cJSON_AddNumberToObject(event, "done", done);
    cJSON_AddNumberToObject(event, "total", share);
    cJSON_AddNumberToObject(event, "first", first);
    cJSON_AddNumberToObject(event, "count", count);
    cJSON_AddItemReferenceToObject(event, "points", (cJSON *)chunk);
    request->progress(request->context, event);
    cJSON_Delete(event);
}

static double now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* The whole share in chunks, grown until one takes about CHUNK_SECONDS; POINTS collects them. */
static enum modal_status run_share(struct sweep *s, int first, int share,
                                   const struct job_request *request, cJSON *points,
                                   struct modal_error *err)
{
    int size = 1;
    enum modal_status rc = MODAL_OK;

    for (int done = 0; done < share && rc == MODAL_OK;) {
        cJSON *chunk = cJSON_CreateArray();
        int count = size < share - done ? size : share - done;
        double start = now();
        rc = run_points(s, first + done, count, request, chunk, err);
        done += count;
        if (rc == MODAL_OK)
            report(request, chunk, done, share, first + done - count, count);
        while (rc == MODAL_OK && chunk->child != NULL)
            cJSON_AddItemToArray(points, cJSON_DetachItemViaPointer(chunk, chunk->child));
        cJSON_Delete(chunk);
        if (now() - start < CHUNK_SECONDS / 2 && size < CHUNK_MOST)
            size *= 2;
    }
    return rc;
}

/* The grid's own size bounds the share closer than the table can. */
static enum modal_status read_share(const cJSON *options, int points, struct share *out,
                                    struct modal_error *err)
{
    enum modal_status rc = key_table_options(sweep_option_rows, options, out, err);

    if (rc == MODAL_OK)
        rc = json_get_int(options, "", "first", 0, points - 1, &out->first, err);
    if (rc == MODAL_OK && out->count == 0)
        out->count = points - out->first;
    return rc == MODAL_OK
               ? json_get_int(options, "", "count", 1, points - out->first, &out->count, err)
               : rc;
}

enum modal_status sweep_run(const struct job_request *request, struct job_result *out,
                            struct modal_error *err)
{
    struct sweep *s = NULL;
    struct cost cost;
    struct share share = { 0 };
    cJSON *points, *shown;
    enum modal_status rc;

    cost_start(&cost);
    rc = sweep_new(request->scene, &s, err);
    if (rc == MODAL_OK)
        rc = read_share(request->options, s->points, &share, err);
    if (rc == MODAL_OK) {
        out->result = cJSON_CreateObject();
        cJSON_AddStringToObject(out->result, "kind", "sweep");
        cJSON_AddStringToObject(out->result, "verb", s->verb->name);
        cJSON_AddNumberToObject(out->result, "total", s->points);
        cJSON_AddItemToObject(
            out->result, "grid",
            cJSON_Duplicate(cJSON_GetObjectItemCaseSensitive(request->scene, "grid"), true));
        points = cJSON_AddArrayToObject(out->result, "points");
        rc = run_share(s, share.first, share.count, request, points, err);
        cost_stage(&cost, "points");
    }
    if (rc == MODAL_OK) {
        cJSON_AddItemToObject(out->result, "cost", cost_print(&cost));
        shown = cJSON_CreateObject();
        key_table_write(sweep_option_rows, &share, shown);
        cJSON_AddItemToObject(out->result, "provenance", provenance_print(request, shown));
    }
    sweep_free(s);
    return rc;
}
