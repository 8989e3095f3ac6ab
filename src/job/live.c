/* live.c - moving.c as a job; see live.h
 *
 * A target (`target.error`, `target.seconds`) asks for a climb over parts of the record, which
 * identify_run does: such windows are jobs of their own.
 *
 * Tested by tests/unit/broker/test_alarms.c.
 */
#include "job/live.h"
#include <cblas.h>
#include <stdlib.h>
#include <time.h>
#include "job/identify_job.h"
#include "modal/identify/moving.h"

struct live {
    struct moving *window;
    struct batch shape;           /* signals, names NULL */
    struct identify_settings settings;
    cJSON *options;
    bool climbs;                  /* a target was set */
    uint64_t jobs;                /* windows that climbed */
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

/* The window as a job of its own. */
static enum modal_status climb(struct live *l, struct moving_cost *cost, cJSON **document,
                               struct modal_error *err)
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
    if (rc == MODAL_OK)
        *document = result.result;
    *cost = (struct moving_cost) { .why = "target", .batches = ++l->jobs };
    return rc;
}

static enum modal_status update(struct live *l, struct moving_cost *cost, cJSON **document,
                                struct modal_error *err)
{
    struct identify_result result;
    enum modal_status rc;

    openblas_set_num_threads(l->settings.threads);
    rc = moving_identify(l->window, &result, cost, err);
    if (rc == MODAL_OK) {
        *document = identify_modes_write(&result);
        identify_result_done(&result);
    }
    return rc;
}

enum modal_status live_next(struct live *l, const double *samples, size_t count, cJSON **document,
                            struct modal_error *err)
{
    double start = cpu_s();
    struct moving_cost cost;
    enum modal_status rc = moving_push(l->window, samples, count, err);

    if (rc == MODAL_OK)
        rc = l->climbs ? climb(l, &cost, document, err) : update(l, &cost, document, err);
    if (rc == MODAL_OK)
        cJSON_AddItemToObject(*document, "update", write_update(&cost, cpu_s() - start));
    return rc;
}
