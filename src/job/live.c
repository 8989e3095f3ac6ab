/* live.c - moving.c as a job; see live.h
 *
 * A target (`target.error`, `target.seconds`) asks for a climb over parts of the record, which
 * identify_run does: such windows are jobs of their own.
 *
 * Tested by tests/unit/broker/test_alarms.c.
 */
#include "job/live.h"
#include <cblas.h>
#include <complex.h>
#include <math.h>
#include <stdlib.h>
#include <time.h>
#include "job/identify_job.h"
#include "job/tracks_text.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/live/moving.h"

struct live {
    struct moving *window;
    struct batch shape;           /* signals, names NULL */
    struct identify_settings settings;
    cJSON *options;
    bool climbs;                  /* a target was set */
    bool shapes;                  /* were asked for; tracks look at them where they are not */
    uint64_t jobs;                /* windows that climbed */
    struct tracks tracks;
};

static double cpu_s(void)
{
    struct timespec t;

    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

enum modal_status live_new(const cJSON *options, const struct batch *shape, int hop,
                           struct live **out, struct modal_error *err)
{
    struct moving_options opt = { .channels = (int)shape->channels, .window = (int)shape->samples,
                                  .hop = hop, .dt = shape->dt, .period = shape->period };
    struct live *l = calloc(1, sizeof *l);
    enum modal_status rc;

    if (l == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "live: no memory");
    l->shape = *shape;
    l->shape.signals = NULL, l->shape.names = NULL, l->shape.units = NULL;
    l->options = options != NULL ? cJSON_Duplicate(options, true) : cJSON_CreateObject();
    rc = identify_options_read(options, shape, &l->settings, err);
    l->shapes = l->settings.opt.shapes;
    l->settings.opt.shapes |= shape->channels > 1;
    opt.identify = l->settings.opt;
    l->climbs = opt.identify.target_error > 0 || opt.identify.target_seconds > 0;
    if (rc == MODAL_OK)
        rc = moving_new(&opt, &l->window, err);
    if (rc != MODAL_OK)
        live_free(l);
    else
        *out = l;
    return rc;
}

void live_free(struct live *l)
{
    if (l == NULL)
        return;
    moving_free(l->window);
    identify_settings_done(&l->settings);
    cJSON_Delete(l->options);
    free(l);
}

static cJSON *write_update(const struct moving_cost *cost, double seconds)
{
    cJSON *o = cJSON_CreateObject();

    cJSON_AddBoolToObject(o, "updated", cost->updated);
    if (cost->why != NULL)
        cJSON_AddStringToObject(o, "why", cost->why);
    else
        cJSON_AddNullToObject(o, "why");
    cJSON_AddNumberToObject(o, "updates", (double)cost->updates);
    cJSON_AddNumberToObject(o, "batches", (double)cost->batches);
    json_set_number(o, "cpu_s", seconds);
    return o;
}

/* ---- what tracks see ---- */

/* What tracks look at of a window. */
struct shown { struct track_mode mode[TRACKS_MOST]; int count; };

/* A shape that was not asked for is shown to tracks alone. */
static void show_result(const struct live *l, struct identify_result *r, struct shown *shown)
{
    for (int i = 0; i < r->mode_count; i++) {
        struct identify_mode *m = &r->modes[i];
        bool has_shape = m->shape != NULL && r->channel_count > 1;

        if (shown->count < TRACKS_MOST) {
            struct track_mode *to = &shown->mode[shown->count++];

            *to = (struct track_mode) { .exponent = m->exponent, .std_re = m->std_re,
                                        .std_im = m->std_im };
            track_shape(m->shape, has_shape ? r->channel_count : 0, to->shape);
        }
        if (!l->shapes) {
            free(m->shape);
            m->shape = NULL;
        }
    }
}

static double complex complex_of(const cJSON *pair)
{
    const cJSON *re = cJSON_GetArrayItem(pair, 0), *im = cJSON_GetArrayItem(pair, 1);

    return CMPLX(cJSON_IsNumber(re) ? re->valuedouble : NAN,
                 cJSON_IsNumber(im) ? im->valuedouble : NAN);
}

/* A mode of a document as tracks see it; its shape goes where it was not asked for. */
static struct track_mode track_mode_of(const struct live *l, cJSON *mode)
{
    double complex std = complex_of(cJSON_GetObjectItemCaseSensitive(
                       cJSON_GetObjectItemCaseSensitive(mode, "std"), "exponent"));
    cJSON *list = cJSON_GetObjectItemCaseSensitive(mode, "shape"), *part;
    struct track_mode m = { .exponent = complex_of(cJSON_GetObjectItemCaseSensitive(mode,
                                                                                    "exponent")),
                            .std_re = creal(std), .std_im = cimag(std) };
    int count = cJSON_GetArraySize(list), c = 0;
    double complex *shape = count > 1 ? calloc((size_t)count, sizeof *shape) : NULL;

    cJSON_ArrayForEach(part, list)
        if (shape != NULL)
            shape[c++] = complex_of(part);
    track_shape(shape, c, m.shape);
    free(shape);
    if (!l->shapes) {
        cJSON_DeleteItemFromObjectCaseSensitive(mode, "shape");
        cJSON_DeleteItemFromObjectCaseSensitive(mode, "mpc");
    }
    return m;
}

static void show_document(const struct live *l, const cJSON *document, struct shown *shown)
{
    cJSON *mode;

    cJSON_ArrayForEach(mode, cJSON_GetObjectItemCaseSensitive(document, "modes"))
        if (shown->count < TRACKS_MOST)
            shown->mode[shown->count++] = track_mode_of(l, mode);
}

/* ---- a window ---- */

/* The window as a job of its own. */
static enum modal_status climb(struct live *l, struct moving_cost *cost, cJSON **document,
                               struct shown *shown, struct modal_error *err)
{
    struct batch batch = l->shape;
    struct job_request request = { .kind = "identify", .options = l->options, .batch = &batch };
    struct job_result result = { 0 };
    enum modal_status rc;

    batch.signals = moving_window(l->window);
    if (batch.signals == NULL)
        return modal_fail(err, MODAL_BAD_INPUT, "live: %d of %zu samples",
                          moving_samples(l->window), batch.samples);
    rc = identify_by(&l->settings, &request, &result, err);
    if (rc == MODAL_OK) {
        *document = result.result;
        show_document(l, *document, shown);
    }
    *cost = (struct moving_cost) { .why = "target", .batches = ++l->jobs };
    return rc;
}

static enum modal_status update(struct live *l, struct moving_cost *cost, cJSON **document,
                                struct shown *shown, struct modal_error *err)
{
    struct identify_result result;
    enum modal_status rc;

    openblas_set_num_threads(l->settings.threads);
    rc = moving_identify(l->window, &result, cost, err);
    if (rc == MODAL_OK) {
        show_result(l, &result, shown);
        *document = identify_modes_write(&result);
        identify_result_done(&result);
    }
    return rc;
}

/* ---- tracks ---- */

enum modal_status live_resume(struct live *l, const char *tracks, struct modal_error *err)
{
    return tracks_text_read(tracks, &l->tracks, err);
}

void live_skip(struct live *l)
{
    moving_clear(l->window);
}

static void add_edges(cJSON *document, const struct track_edge *edges, int count)
{
    cJSON *list = cJSON_AddArrayToObject(document, "track_edges");

    for (int i = 0; i < count; i++) {
        cJSON *edge = cJSON_CreateObject();
        cJSON_AddNumberToObject(edge, "track", (double)edges[i].number);
        cJSON_AddStringToObject(edge, "state", track_states[edges[i].state]);
        json_set_number(edge, "frequency_hz", cabs(edges[i].exponent) / (2 * M_PI));
        json_set_number(edge, "damping_ratio", damping_ratio_of(edges[i].exponent));
        cJSON_AddItemToArray(list, edge);
    }
}

/* Each mode of DOCUMENT gets its track; past TRACKS_MOST no event has room for modes. */
static enum modal_status number_modes(struct live *l, const struct track_window *w,
                                      const struct shown *shown, cJSON *document,
                                      struct modal_error *err)
{
    cJSON *modes = cJSON_GetObjectItemCaseSensitive(document, "modes"), *mode;
    struct track_edge edges[2 * TRACKS_MOST];
    int64_t number[TRACKS_MOST];
    int count = 0, edge_count = 0;
    enum modal_status rc;
    char *text;

    rc = tracks_follow(&l->tracks, w, shown->mode, shown->count, number, edges, &edge_count, err);
    if (rc != MODAL_OK)
        return rc;
    cJSON_ArrayForEach(mode, modes)
        if (count < shown->count)
            cJSON_AddNumberToObject(mode, "track", (double)number[count++]);
    add_edges(document, edges, edge_count);
    text = tracks_text_write(&l->tracks);
    if (text == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "live: no memory for %d tracks", l->tracks.count);
    cJSON_AddStringToObject(document, "tracks", text);
    free(text);
    return MODAL_OK;
}

enum modal_status live_next(struct live *l, uint64_t epoch, uint64_t to, const double *samples,
                            size_t count, cJSON **document, struct modal_error *err)
{
    double start = cpu_s();
    struct track_window w = { epoch, to + 1 - l->shape.samples, to, l->shape.dt };
    struct moving_cost cost;
    struct shown shown;
    enum modal_status rc = moving_push(l->window, samples, count, err);

    shown.count = 0;
    if (rc == MODAL_OK)
        rc = l->climbs ? climb(l, &cost, document, &shown, err)
                       : update(l, &cost, document, &shown, err);
    if (rc == MODAL_OK)
        rc = number_modes(l, &w, &shown, *document, err);
    if (rc == MODAL_OK)
        cJSON_AddItemToObject(*document, "update", write_update(&cost, cpu_s() - start));
    return rc;
}
