/*
 * serve.c - RUN to job_run to DONE; see serve.h
 *
 * A document longer than one frame, and the batch of `simulate`, go ahead of DONE in PARTs, of
 * which at most four wait for their GO, so that neither side holds more than that.
 */
#include "worker/serve.h"
#include <malloc.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>
#include "base/crc32c.h"
#include "job/blas_core.h"
#include "job/job.h"
#include "modal/scene/scene_arrays.h"
#include "store/mapping.h"
#include "store/spool.h"
#include "wire/request.h"
#include "worker/descriptors.h"
#include "worker/live_windows.h"
#include "worker/pull.h"

enum {
    PROGRESS_MS = 100,    /* between two PROGRESS: as often as a person can read them */
    /* that a window's end waits for those of the next: half of what a worker has ahead
     * (PROTOCOL.md, section 13), so that it works on the other half until it is told of more */
    KEPT_MS = 10,
};

/* One RUN. */
struct run {
    struct link *link;
    char job[WIRE_ID_MOST + 1];
    int attempt;
    char *kind, *sha256;
    cJSON *header;                 /* detached from the message */
    const cJSON *options, *input;
    struct wire_input shape;

    struct mapping map;          /* the data, from the file ... */
    void *copy;                    /* ... or from the message ... */
    struct pulled pulled;          /* ... or piece by piece */
    const char **names;
    struct batch batch;
    cJSON *scene;
    struct scene_arrays arrays;    /* behind the scene's text, in the data */

    uint64_t memory;               /* of serve_options */
    int waiting;                   /* PARTs without GO */
    double cpu_start;
    int64_t said_ms;               /* last PROGRESS */
};

static double cpu_seconds(void)
{
    struct rusage usage;

    getrusage(RUSAGE_SELF, &usage);
    return (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec)
           + 1e-6 * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

static int64_t now_ms(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

static cJSON *header_of(const struct run *run)
{
    cJSON *header = cJSON_CreateObject();

    cJSON_AddStringToObject(header, "job", run->job);
    cJSON_AddNumberToObject(header, "attempt", run->attempt);
    return header;
}

/* --- the input --- */

static enum modal_status map_input(struct run *run, const char *file, const void **data,
                                   struct modal_error *err)
{
    double offset = 0, crc = 0;
    int fd = -1;
    enum modal_status rc = json_need_number(run->input, "input", "offset", 0, WIRE_INTEGER_MOST,
                                            &offset, err);

    if (rc == MODAL_OK)
        rc = json_need_number(run->input, "input", "crc32c", 0, 4294967295.0, &crc, err);
    if (rc == MODAL_OK)
        rc = descriptors_receive(run->job, run->attempt, &fd, err);
    if (rc == MODAL_OK)
        rc = spool_map_open(fd, file, (uint64_t)offset, run->shape.bytes, (uint32_t)crc, &run->map,
                            err);
    if (fd >= 0)
        close(fd);
    *data = run->map.data;
    return rc;
}

static enum modal_status copy_input(struct run *run, const struct wire_message *message,
                                    const void **data, struct modal_error *err)
{
    double crc = -1;
    enum modal_status rc = json_get_number(run->input, "input", "crc32c", 0, 4294967295.0, &crc,
                                           err);

    if (rc != MODAL_OK)
        return rc;
    if (message->body_bytes != run->shape.bytes)
        return modal_fail_field(err, MODAL_BAD_FRAME, "input",
                                "the message has %zu bytes of an input of %llu",
                                message->body_bytes, (unsigned long long)run->shape.bytes);
    run->copy = malloc(message->body_bytes + 1);
    if (run->copy == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "worker: no memory for an input of %zu bytes",
                          message->body_bytes);
    wire_gather(message, run->copy, message->body_bytes);
    if (crc >= 0 && crc32c(0, run->copy, message->body_bytes) != (uint32_t)crc)
        return modal_fail_field(err, MODAL_CORRUPT, "input", "the input's checksum is wrong");
    *data = run->copy;
    return MODAL_OK;
}

static enum modal_status pull(struct run *run, const void **data, struct modal_error *err)
{
    double crc = 0;
    enum modal_status rc = json_need_number(run->input, "input", "crc32c", 0, UINT32_MAX, &crc,
                                            err);

    if (rc == MODAL_OK)
        rc = pull_input(run->link, run->job, run->attempt, run->shape.bytes, (uint32_t)crc,
                        &run->pulled, err);
    *data = run->pulled.data;
    return rc;
}

static enum modal_status make_batch(struct run *run, const void *data, struct modal_error *err)
{
    const struct wire_input *shape = &run->shape;
    const cJSON *item;
    size_t s = 0;

    if (shape->names != NULL) {
        run->names = calloc(shape->channels + 1, sizeof *run->names);
        if (run->names == NULL)
            return modal_fail(err, MODAL_NO_MEMORY,
                              "worker: no memory for the names of %llu channels",
                              (unsigned long long)shape->channels);
        cJSON_ArrayForEach(item, shape->names)
            run->names[s++] = item->valuestring;
    }
    run->batch = (struct batch) { .samples = shape->samples,
                                  .channels = shape->channels,
                                  .signals = data,
                                  .dt = shape->dt,
                                  .period = shape->period,
                                  .names = run->names,
                                  .units = shape->units,
                                  .release = run->map.data != NULL
                                                     && run->map.length > mapping_resident_most()
                                                 ? mapping_release
                                                 : NULL,
                                  .spare = run->map.data != NULL ? mapping_release : NULL };
    return MODAL_OK;
}

static enum modal_status make_scene(struct run *run, const void *data, struct modal_error *err)
{
    size_t length = scene_arrays_split(data, run->shape.bytes, &run->arrays);

    if (length > WIRE_SCENE_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "scene",
                                "a scene's text of %zu bytes; accepted: at most %d, and matrices "
                                "of more as arrays behind it", length, WIRE_SCENE_MOST);
    return json_read(data, length, &run->scene, err);
}

static enum modal_status read_input(struct run *run, const struct wire_message *message,
                                    struct modal_error *err)
{
    static const char *const contents[] = { "batch", "scene", NULL };
    const char *file = NULL;
    const void *data = NULL;
    int content = -1;
    enum modal_status rc = json_get_choice(run->input, "input", "content", contents, &content, err);

    if (rc == MODAL_OK && content < 0)
        rc = modal_fail_field(err, MODAL_BAD_FRAME, "input.content",
                              "RUN does not say what its input is");
    if (rc == MODAL_OK)
        rc = wire_input_read(run->input, "input", content == 0 ? WIRE_BATCH : WIRE_SCENE,
                             &run->shape, err);
    if (rc == MODAL_OK)
        rc = json_get_string(run->input, "input", "file", &file, err);
    if (rc == MODAL_OK)
        rc = file != NULL ? map_input(run, file, &data, err)
             : cJSON_HasObjectItem(run->input, "pull") ? pull(run, &data, err)
                                                       : copy_input(run, message, &data, err);
    if (rc == MODAL_OK && content == 0)
        rc = make_batch(run, data, err);
    else if (rc == MODAL_OK)
        rc = make_scene(run, data, err);
    return rc;
}

/* --- RUN --- */

/* What identifies a RUN, without which it cannot even be answered. */
static enum modal_status run_begin(struct run *run, struct link *link,
                                   const struct wire_message *message, struct modal_error *err)
{
    const char *job = NULL;
    enum modal_status rc = json_need_string(message->header, "", "job", &job, err);
    int attempt = 0;

    *run = (struct run) { .link = link, .cpu_start = cpu_seconds() };
    if (rc == MODAL_OK)
        rc = json_get_int(message->header, "", "attempt", 0, 1 << 30, &attempt, err);
    if (rc == MODAL_OK && (strlen(job) > WIRE_ID_MOST || strpbrk(job, "\"\\") != NULL))
        rc = modal_fail_field(err, MODAL_BAD_FRAME, "job", "a job's id of %zu bytes", strlen(job));
    if (rc != MODAL_OK)
        return rc;
    snprintf(run->job, sizeof run->job, "%s", job);
    run->attempt = attempt;
    link_working(link, run->job, attempt);
    return MODAL_OK;
}

static enum modal_status run_read(struct run *run, const struct wire_message *message,
                                  struct modal_error *err)
{
    const char *kind = NULL, *sha256 = NULL;
    enum modal_status rc;

    run->header = cJSON_Duplicate(message->header, true);
    if (run->header == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "worker: no memory for a job");
    run->options = cJSON_GetObjectItemCaseSensitive(run->header, "options");
    run->input = cJSON_GetObjectItemCaseSensitive(run->header, "input");
    rc = json_need_string(run->header, "", "kind", &kind, err);
    if (rc == MODAL_OK && !cJSON_IsObject(run->input))
        rc = modal_fail_field(err, MODAL_BAD_FRAME, "input", "RUN has no input");
    if (rc == MODAL_OK)
        rc = json_get_string(run->input, "input", "sha256", &sha256, err);
    if (rc == MODAL_OK)
        rc = read_input(run, message, err);
    run->kind = (char *)(uintptr_t)kind;
    run->sha256 = (char *)(uintptr_t)sha256;
    return rc;
}

static void run_done(struct run *run)
{
    link_working(run->link, NULL, 0);
    mapping_close(&run->map);
    pull_done(&run->pulled);
    free(run->copy);
    free(run->names);
    cJSON_Delete(run->scene);
    cJSON_Delete(run->header);
}

static bool too_long_to_tell(const cJSON *event)
{
    char *text = json_print(event);
    const bool told = text != NULL && strlen(text) <= WIRE_PROGRESS_MOST;

    free(text);
    return !told;
}

/* EVENT, without the points of a sweep where nobody would be told of it with them. */
static void send_progress(void *context, const cJSON *event)
{
    struct run *run = context;
    int64_t now = now_ms();
    cJSON *header, *progress;

    if (now - run->said_ms < PROGRESS_MS)
        return;
    run->said_ms = now;
    progress = cJSON_Duplicate(event, true);
    if (too_long_to_tell(progress))
        cJSON_DeleteItemFromObjectCaseSensitive(progress, "points");
    header = header_of(run);
    cJSON_AddItemToObject(header, "progress", progress);
    link_send(run->link, "PROGRESS", header, NULL, 0, NULL);
}

/* --- the answer --- */

/* Until a GO for this job came. */
static enum modal_status wait_go(struct run *run, struct modal_error *err)
{
    const struct wire_message *message;

    for (;;) {
        enum modal_status rc = link_receive(run->link, &message, err);
        const cJSON *job;
        if (rc != MODAL_OK)
            return rc;
        job = cJSON_GetObjectItemCaseSensitive(message->header, "job");
        if (strcmp(message->verb, "GO") == 0 && cJSON_IsString(job)
            && strcmp(job->valuestring, run->job) == 0)
            break;
    }
    run->waiting--;
    return MODAL_OK;
}

/* LENGTH bytes of DATA as PARTs; BATCH (may be NULL; taken over) describes them. */
static enum modal_status send_parts(struct run *run, const char *part, const void *data,
                                    size_t length, cJSON *batch, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (size_t at = 0; rc == MODAL_OK && at < length; at += WIRE_BODY_MOST) {
        cJSON *header;
        while (rc == MODAL_OK && run->waiting >= WIRE_PARTS_MOST)
            rc = wait_go(run, err);
        if (rc != MODAL_OK)
            break;
        header = header_of(run);
        cJSON_AddStringToObject(header, "part", part);
        cJSON_AddNumberToObject(header, "offset", (double)at);
        cJSON_AddNumberToObject(header, "total", (double)length);
        if (at == 0 && batch != NULL) {
            cJSON_AddItemToObject(header, "batch", batch);
            batch = NULL;
        }
        run->waiting++;
        rc = link_send(run->link, "PART", header, (const char *)data + at,
                       length - at < WIRE_BODY_MOST ? length - at : WIRE_BODY_MOST, err);
    }
    cJSON_Delete(batch);
    return rc;
}

static enum modal_status send_batch(struct run *run, const struct batch *batch,
                                    struct modal_error *err)
{
    struct wire_input shape = { .content = WIRE_BATCH,
                                .samples = batch->samples,
                                .channels = batch->channels,
                                .dt = batch->dt,
                                .period = batch->period,
                                .units = batch->units };
    cJSON *description = cJSON_CreateObject(), *names = NULL;
    enum modal_status rc;

    if (batch->names != NULL) {
        names = cJSON_CreateArray();
        for (size_t s = 0; s < batch->channels; s++)
            cJSON_AddItemToArray(names, cJSON_CreateString(batch->names[s]));
    }
    shape.names = names;
    wire_input_write(description, &shape);
    cJSON_Delete(names);
    rc = send_parts(run, "batch", batch->signals, batch->samples * batch->channels * sizeof(double),
                    description, err);
    return rc;
}

static enum modal_status send_failed(struct run *run, const struct modal_error *why,
                                     struct modal_error *err)
{
    cJSON *header = header_of(run);

    json_set_number(header, "cpu_s", cpu_seconds() - run->cpu_start);
    cJSON_AddItemToObject(header, "error", wire_error_object(why, NULL));
    return link_send(run->link, "FAILED", header, NULL, 0, err);
}

/* DOCUMENT of a live window, which goes in one frame: shapes that are longer leave no event room
 * for modes. */
static char *window_text(cJSON *document)
{
    char *text = json_print(document);
    cJSON *mode;

    if (text == NULL || strlen(text) <= WIRE_BODY_MOST)
        return text;
    cJSON_ArrayForEach(mode, cJSON_GetObjectItemCaseSensitive(document, "modes"))
        cJSON_DeleteItemFromObjectCaseSensitive(mode, "shape");
    cJSON_AddStringToObject(document, "left_out", "shapes");
    free(text);
    return json_print(document);
}

/* LIVE: of a window, whose end waits for those of the next, if there are any. */
static enum modal_status send_done(struct run *run, const struct job_result *result, bool live,
                                   struct modal_error *err)
{
    char *text = live ? window_text(result->result) : json_print(result->result);
    const size_t most = live ? WIRE_BODY_MOST : WIRE_DOCUMENT_MOST;
    size_t length = text != NULL ? strlen(text) : 0;
    struct modal_error why;
    enum modal_status rc = MODAL_OK;
    cJSON *header;

    if (text == NULL || length > most) {
        modal_fail(&why, text == NULL ? MODAL_NO_MEMORY : MODAL_TOO_LARGE,
                   "the result document takes %zu bytes; at most %zu are kept", length, most);
        free(text);
        return send_failed(run, &why, err);
    }
    if (result->batch.samples > 0)
        rc = send_batch(run, &result->batch, err);
    if (rc == MODAL_OK && length > WIRE_BODY_MOST)
        rc = send_parts(run, "document", text, length, NULL, err);
    while (rc == MODAL_OK && run->waiting > 0)
        rc = wait_go(run, err);
    if (rc == MODAL_OK) {
        header = header_of(run);
        json_set_number(header, "cpu_s", cpu_seconds() - run->cpu_start);
        rc = (live ? link_keep : link_send)(run->link, "DONE", header,
                                            length > WIRE_BODY_MOST ? NULL : text, length, err);
    }
    free(text);
    return rc;
}

/* A job that wanted memory where there was none is told how much there is. */
static void name_limit(struct modal_error *why, uint64_t memory)
{
    size_t length = strlen(why->message);

    if (why->status == MODAL_NO_MEMORY && memory > 0)
        snprintf(why->message + length, sizeof why->message - length,
                 "; a worker has at most %llu bytes (worker_memory)", (unsigned long long)memory);
}

/* LIVE is to run next: what is kept waits no longer than it may for one that takes long, or that
 * nobody knows. */
static enum modal_status go_before(struct run *run, const struct live_windows *windows,
                                   const cJSON *live, struct modal_error *err)
{
    const int64_t since_ms = link_kept_ms(run->link);

    return since_ms != 0 && live_windows_took_ms(windows, live) > since_ms + KEPT_MS - now_ms()
               ? link_let_go(run->link, err) : MODAL_OK;
}

static enum modal_status run_job(struct run *run, struct live_windows *windows,
                                 const struct wire_message *message, struct modal_error *err)
{
    struct job_result result = { 0 };
    const cJSON *live;
    struct modal_error why = { .status = MODAL_OK };
    enum modal_status rc = run_read(run, message, &why);

    live = cJSON_GetObjectItemCaseSensitive(run->header, "live");
    if (rc == MODAL_OK && live != NULL && run->scene == NULL) {
        const enum modal_status sent = go_before(run, windows, live, err);
        if (sent != MODAL_OK)
            return sent;
        rc = live_windows_run(windows, live, run->options, &run->batch, &result.result, &why);
    } else if (rc == MODAL_OK) {
        struct job_request request = {
            .kind = run->kind,
            .options = run->options,
            .batch = run->scene == NULL ? &run->batch : NULL,
            .scene = run->scene,
            .arrays = &run->arrays,
            .input_sha256 = run->sha256,
            .attributes = run->shape.attributes,
            .progress = send_progress,
            .context = run,
        };
        rc = job_run(&request, &result, &why);
    }
    if (rc != MODAL_OK) {
        name_limit(&why, run->memory);
        return send_failed(run, &why, err);
    }
    rc = send_done(run, &result, live != NULL, err);
    job_result_done(&result);
    return rc;
}

static enum modal_status send_ready(struct link *link, struct modal_error *err)
{
    cJSON *header = cJSON_CreateObject();

    cJSON_AddNumberToObject(header, "pid", getpid());
    cJSON_AddStringToObject(header, "version", MODALD_VERSION);
    cJSON_AddStringToObject(header, "core", blas_core_name());
    return link_send(link, "READY", header, NULL, 0, err);
}

/* After a window whose end is kept: where the next has not come yet, the worker is idle, and what
 * is kept goes with its READY; else it goes in time for more to come. */
static enum modal_status end_window(struct link *link, struct modal_error *err)
{
    if (!link_waits(link))
        return send_ready(link, err);
    return link_kept_ms(link) != 0 && now_ms() - link_kept_ms(link) >= KEPT_MS
               ? link_let_go(link, err) : MODAL_OK;
}

static enum modal_status serve_all(struct link *link, const struct serve_options *options,
                                   struct live_windows *windows, struct modal_error *err)
{
    enum modal_status rc = send_ready(link, err);

    for (int jobs = 0; rc == MODAL_OK;) {
        const struct wire_message *message;
        struct run run;
        bool live;
        rc = link_receive(link, &message, err);
        if (rc == MODAL_OK && strcmp(message->verb, "STOP") == 0)
            return MODAL_OK;
        if (rc != MODAL_OK || strcmp(message->verb, "RUN") != 0)
            continue;
        rc = run_begin(&run, link, message, err);
        if (rc != MODAL_OK)
            return rc;
        run.memory = options->memory;
        rc = run_job(&run, windows, message, err);
        live = cJSON_HasObjectItem(run.header, "live");
        run_done(&run);
        if (rc == MODAL_OK && live) {
            rc = end_window(link, err);
            continue;
        }
        malloc_trim(0);                /* a window goes on with what it has */
        if (rc == MODAL_OK && options->jobs_most > 0 && ++jobs >= options->jobs_most)
            return MODAL_OK;
        if (rc == MODAL_OK)
            rc = send_ready(link, err);
    }
    return rc;
}

enum modal_status serve(struct link *link, const struct serve_options *options,
                        struct modal_error *err)
{
    struct live_windows *windows = live_windows_new();
    enum modal_status rc = windows != NULL
                               ? serve_all(link, options, windows, err)
                               : modal_fail(err, MODAL_NO_MEMORY, "worker: no memory for windows");

    live_windows_free(windows);
    return rc;
}
