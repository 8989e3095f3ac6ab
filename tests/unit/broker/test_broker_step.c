/*
 * test_broker_step.c - the broker's core without sockets, clocks or disks, driven by a simulator
 * with faults from a seed
 *
 * The world of a seed: a ledger that commits late, in groups, refuses for want of space, and
 * forgets what it had not committed when the daemon "dies"; spool threads that are slow, out of
 * room or out of descriptors; workers that answer, die, fall silent, or answer for an attempt long
 * gone; clients that repeat, cancel, retry, delete, upload in pieces and vanish.  A restart makes a
 * new core from the committed rows alone.  The checker keeps its own account: what was
 * acknowledged, which edges were committed, which results were published, how far each upload was
 * said to be present.
 *
 * In a second thousand worlds there are workers elsewhere too: they join, two of one name, with a
 * key that may be revoked or none of a worker's; they leave, give jobs back, are lost with their
 * connection or cut off from it, so that what they say comes when the job is another's; they name
 * what is not theirs.  A document names its job and attempt, and the ledger of the world compares.
 *
 *     MODALD_SEEDS=n   how many worlds (default 1000);  MODALD_SEED=s  that one alone, with its log
 */
/* Tests as well: actions.c answer.c blob.c events.c heap.c histogram.c ident.c index.c inputs.c
 * chunks.c ends.c jobs.c life.c map.c memory.c metrics.c remotes.c requests.c room.c segments.c
 * slots.c step.c streams.c
 * submit.c transaction.c uploads.c waits.c windows.c workers.c */
#include "check.h"
#include <stdlib.h>
#include "base/crc32c.h"
#include "base/sha256.h"
#include "broker/core/core.h"
#include "broker/core/inputs.h"
#include "broker/core/jobs.h"
#include "broker/core/state.h"
#include "broker/kit/map.h"
#include "wire/frame.h"

enum {
    KEYS = 24,
    WORKERS = 3, AHEAD = 64,
    REMOTES = 4,
    STEPS = 400,
    ROWS = 4096,
    UPLOADS = 3,
    CHUNK = 96,
    STREAMS = 2,
    PUSHED = 4,
    NOTES = 256
};

/* ---- the ledger of the world
 * ------------------------------------------------------------------------------------ */

struct row {
    int64_t id;
    char key[16], user[16], kind[16], options[256], tag[160], error[32];
    int64_t input;
    uint8_t fingerprint[32];
    int priority;
    int64_t run_limit, deadline, not_before, submitted, started, finished;
    enum job_state state;
    int attempts, crashes;
    uint64_t result_bytes;
    bool cached, gone, has_result;
    int results;                 /* RESULT_PUT rows seen */
};

struct input_row {
    int64_t id;
    char user[16];
    uint8_t sha256[32];
    uint64_t samples, received;
    enum input_state state;
    bool inline_data, gone;
};
struct segment_row {
    int64_t stream;
    uint64_t epoch, first, count, offset, length;
    double data[PUSHED];
};

/* An upload as its client knows it. */
struct upload_view {
    bool open, unsure;           /* unsure: it must begin again to know where it is */
    char ident[9];
    uint64_t sent, acked;        /* bytes */
};

/* A stream likewise.  Its samples are their index, twisted by a checkpoint taken up again. */
struct stream_view {
    bool open, unsure, asked;    /* asked: to be closed */
    char ident[9], ended[9];     /* ended: the one closed before, */
    char sha256[65];             /* and what it was sealed as */
    uint64_t sent, acked, epoch, twist;
};

struct world {
    uint64_t dice, seed;
    struct core *core;
    struct settings settings;
    struct account account[3];
    struct moment now;
    struct row rows[ROWS]; int row_count;
    struct input_row inputs[ROWS]; int input_count;
    struct segment_row segments[ROWS]; int segment_count;
    struct {
        char user[16], key[16];
        uint8_t fingerprint[32];
        int64_t job, expired_ns;
    } stones[ROWS];
    int stone_count;
    struct { char topic[16], name[24], text[600]; } notes[NOTES]; int note_count;
    int64_t last_event;
    struct transaction *waiting, **waiting_end;
    struct task *tasks, **tasks_end;
    struct {
        bool alive;
        int64_t job_pid;
        char job[9];
        int attempt;
        bool busy, silent;
        int ahead[AHEAD], ahead_count;      /* attempts of windows behind the one that it has */
        char old_job[9];
        int old_attempt;
        bool booting;
    } workers[WORKERS];
    bool elsewhere, revoked;     /* there are workers elsewhere; their key is off the list */
    uint64_t last_peer;
    struct {
        uint64_t peer;           /* 0: not connected */
        bool joined, cut, busy, leaving, stopped;
        bool stranger;           /* its key is a client's */
        bool small;              /* it has no memory for a window */
        char job[9], old_job[9];
        int attempt, old_attempt;
    } remotes[REMOTES];
    /* of remotes: published; said of what is not theirs; live windows that they had */
    long documents, foreign, windows;
    char acked[2][KEYS][9];      /* by user and key: the job it was told */
    int acked_variant[2][KEYS];
    bool expired[2][KEYS];
    struct upload_view uploads[2][UPLOADS];
    struct stream_view streams[2][STREAMS];
    long sealed, closed, told_gone;
    int64_t request;
    struct {
        int user, key, variant, together;
        bool used, push;
        uint64_t offset, twist;
        char ident[9];
    } asked[1 << 12];
    bool full;
    long states, violations[11];
    long events, events_most;           /* EVENTs that were told, and of one step */
    bool verbose;
};

static struct world *w;

static double sample_of(uint64_t index, uint64_t twist)
{
    return (double)index + 1000.0 * (double)twist;
}

static long total_documents, total_foreign, total_windows;
static long total_states, total_restarts, total_gone, total_violations[11];

static uint32_t roll(uint32_t below)
{
    w->dice = w->dice * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(w->dice >> 33) % below;
}

static void violate(int promise, const char *what)
{
    w->violations[promise]++;
    printf("seed %llu: P%d violated: %s\n", (unsigned long long)w->seed, promise, what);
}

static struct row *row_by_id(int64_t id)
{
    for (int i = 0; i < w->row_count; i++)
        if (w->rows[i].id == id && !w->rows[i].gone)
            return &w->rows[i];
    return NULL;
}

static void copy(char *out, size_t room, const char *text)
{
    snprintf(out, room, "%s", text == NULL ? "" : text);
}

static void put_job(const struct job_record *r)
{
    struct row *row = &w->rows[w->row_count++];

    for (int i = 0; i < w->row_count - 1; i++)
        if (r->key != NULL && !w->rows[i].gone && strcmp(w->rows[i].key, r->key) == 0 &&
            strcmp(w->rows[i].user, r->user) == 0)
            violate(2, "two rows under one key");
    *row = (struct row) { .id = r->id,
                         .input = r->input,
                         .priority = r->priority,
                         .run_limit = r->run_limit_ns,
                         .deadline = r->deadline_ns,
                         .not_before = r->not_before_ns,
                         .submitted = r->submitted_ns,
                         .finished = r->finished_ns,
                         .state = r->state,
                         .cached = r->cached,
                         .result_bytes = r->result_bytes,
                         .attempts = r->attempts };
    memcpy(row->fingerprint, r->fingerprint, 32);
    copy(row->key, sizeof row->key, r->key);
    copy(row->user, sizeof row->user, r->user);
    copy(row->kind, sizeof row->kind, r->kind);
    copy(row->options, sizeof row->options, r->options);
    copy(row->tag, sizeof row->tag, r->tag);
    if (r->state == JOB_DONE && !r->cached)
        violate(3, "a job born done without being cached");
}

static void move_job(const struct job_record *r)
{
    struct row *row = row_by_id(r->id);

    if (row == NULL) {
        violate(3, "an edge of a job that is not there");
        return;
    }
    if (!ledger_moves[row->state][r->state])
        violate(3, "an edge that is not in the table");
    if (row->state == JOB_DONE || row->state == JOB_FAILED || row->state == JOB_CANCELLED)
        violate(3, "an end changed");
    if (r->state == JOB_DONE && row->results != 1)
        violate(4, "done without exactly one result");
    if (r->attempts < row->attempts)
        violate(4, "attempts went back");
    row->state = r->state;
    row->attempts = r->attempts;
    row->crashes = r->crashes;
    row->started = r->started_ns;
    row->finished = r->finished_ns;
    row->result_bytes = r->result_bytes;
    copy(row->error, sizeof row->error, r->error_code);
}

static void add_chunk(const struct ledger_change *change)
{
    for (int i = 0; i < w->input_count; i++)
        if (w->inputs[i].id == change->input_id && !w->inputs[i].gone) {
            /* with the one before, where it joins that */
            if (change->chunk.offset > w->inputs[i].received
                || change->chunk.offset + change->chunk.length <= w->inputs[i].received)
                violate(5, "a chunk that does not follow the one before");
            w->inputs[i].received = change->chunk.offset + change->chunk.length;
        }
}

static void put_note(const struct note_record *note)
{
    int at = 0;

    while (at < w->note_count && (strcmp(w->notes[at].topic, note->topic) != 0 ||
                                  strcmp(w->notes[at].name, note->name) != 0))
        at++;
    if (note->text == NULL) {
        if (at < w->note_count)
            w->notes[at] = w->notes[--w->note_count];
        return;
    }
    copy(w->notes[at].topic, 16, note->topic);
    copy(w->notes[at].name, 24, note->name);
    copy(w->notes[at].text, sizeof w->notes[at].text, note->text);
    w->note_count += at == w->note_count;
}

/* Where it lies in the stream's file: right behind all that was committed, over nothing. */
static void put_segment(const struct segment_record *r)
{
    uint64_t end = 0;

    for (int i = 0; i < w->segment_count; i++)
        if (w->segments[i].stream == r->stream)
            end = w->segments[i].offset + w->segments[i].length;
    if (r->offset != end || r->length != 8 * r->count)
        violate(5, "samples are written elsewhere than behind those that are committed");
    w->segments[w->segment_count] = (struct segment_row) { r->stream, r->epoch,  r->first, r->count,
                                                          r->offset, r->length, { 0 } };
    memcpy(w->segments[w->segment_count++].data, r->data, r->length);
}

static void delete_segments(int64_t stream)
{
    int kept = 0;

    for (int i = 0; i < w->segment_count; i++)
        if (w->segments[i].stream != stream)
            w->segments[kept++] = w->segments[i];
    w->segment_count = kept;
}

/* What a worker elsewhere computed is of this job and its latest attempt. */
static void compare_document(const struct row *row, const char *text, size_t length)
{
    char copy_of[64] = "", ident[9];
    int number = 0;

    if (length < sizeof copy_of)
        memcpy(copy_of, text, length);
    if (sscanf(copy_of, "{\"of\":\"%8[0-9a-z]\",\"attempt\":%d}", ident, &number) != 2)
        return;
    w->documents++;
    if (ident_number(w->settings.secret, ident) != row->id || number != row->attempts)
        violate(4, "a document of another job or attempt is published");
}

static void apply(struct ledger_change *change)
{
    struct row *row;

    switch (change->verb) {
    case LEDGER_INPUT_PUT: {
        struct input_row *in = NULL;
        for (int i = 0; i < w->input_count; i++)
            if (w->inputs[i].id == change->input.id)
                in = &w->inputs[i];
        if (in == NULL)
            in = &w->inputs[w->input_count++];
        *in = (struct input_row) { .id = change->input.id,
                                  .samples = change->input.shape.samples,
                                  .received = in->id == change->input.id && !in->gone ? in->received
                                                                                      : 0,
                                  .state = change->input.state,
                                  .inline_data = change->input.inline_data };
        memcpy(in->sha256, change->input.sha256, 32);
        copy(in->user, sizeof in->user, change->input.user);
        break;
    }
    case LEDGER_INPUT_DELETE:
        for (int i = 0; i < w->input_count; i++)
            w->inputs[i].gone |= w->inputs[i].id == change->id;
        break;
    case LEDGER_CHUNK_PUT: add_chunk(change); break;
    case LEDGER_SEGMENT_PUT: put_segment(&change->segment); break;
    case LEDGER_SEGMENTS_DELETE: delete_segments(change->id); break;
    case LEDGER_NOTE_PUT: put_note(&change->note); break;
    case LEDGER_JOB_PUT: put_job(&change->job); break;
    case LEDGER_JOB_MOVE: move_job(&change->job); break;
    case LEDGER_JOB_LIMITS:
        row = row_by_id(change->job.id);
        if (row != NULL)
            copy(row->tag, sizeof row->tag, change->job.tag);
        break;
    case LEDGER_JOB_DELETE:
        row = row_by_id(change->id);
        if (row == NULL || !job_state_final(row->state))
            violate(3, "a job that has not ended was deleted");
        else
            row->gone = true;
        break;
    case LEDGER_RESULT_PUT:
        row = row_by_id(change->result.job);
        if (row != NULL) {
            row->results++;
            compare_document(row, change->result.text, change->result.length);
        }
        break;
    case LEDGER_TOMBSTONE_PUT:
        copy(w->stones[w->stone_count].user, 16, change->tombstone.user);
        copy(w->stones[w->stone_count].key, 16, change->tombstone.key);
        memcpy(w->stones[w->stone_count].fingerprint, change->tombstone.fingerprint, 32);
        w->stones[w->stone_count].expired_ns = change->tombstone.expired_ns;
        w->stones[w->stone_count++].job = change->tombstone.job;
        break;
    case LEDGER_TOMBSTONE_DROP:
        for (int i = 0; i < w->stone_count; i++)
            if (strcmp(w->stones[i].key, change->tombstone.key) == 0
                && strcmp(w->stones[i].user, change->tombstone.user) == 0)
                w->stones[i--] = w->stones[--w->stone_count];
        break;
    case LEDGER_TOMBSTONES_PRUNE:
        for (int i = 0; i < w->stone_count; i++)
            if (w->stones[i].expired_ns < change->id)
                w->stones[i--] = w->stones[--w->stone_count];
        break;
    case LEDGER_EVENT_PUT:
        if (change->event.number <= w->last_event)
            violate(3, "event numbers do not grow");
        w->last_event = change->event.number;
        break;
    default: break;
    }
}

/* ---- carrying out
 * -----------------------------------------------------------------------------------------------
 */

static void run_step(struct event e);

/* The bytes of upload KEY of USER: their number is their own, and their hash made of it. */
static uint64_t upload_samples(int user, int key)
{
    return 12 * (uint64_t)(5 + 3 * key + 10 * user);
}

static void hash_of(uint64_t samples, uint8_t sha256[32])
{
    memset(sha256, (int)(samples & 255), 32);
}

static bool has_input_row(int64_t id)
{
    for (int i = 0; i < w->input_count; i++)
        if (w->inputs[i].id == id && !w->inputs[i].gone)
            return true;
    return false;
}

/* A crash must not bring back what somebody was told is gone: aborted,
 * or of another SHA-256 than was said. */
static void told_gone(const cJSON *header, const char *ident)
{
    const cJSON *error = cJSON_GetObjectItem(header, "error");
    const cJSON *detail = cJSON_GetObjectItem(error, "detail");
    const cJSON *state = cJSON_GetObjectItem(header, "state");
    bool gone = cJSON_HasObjectItem(detail, "found")
        || (state != NULL && strcmp(state->valuestring, "gone") == 0);

    if (gone && has_input_row(ident_number(~w->settings.secret, ident)))
        violate(5, "an upload is told to be gone while its row is there");
    w->told_gone += gone;
}

/* What an answer to UPLOAD says must not be less than what an earlier one said. */
static void told_upload(const struct action *a, const cJSON *header, int user, int key,
                        uint64_t offset)
{
    struct upload_view *v = &w->uploads[user][key];
    const cJSON *error = cJSON_GetObjectItem(header, "error"),
                *detail = cJSON_GetObjectItem(error, "detail"),
                *expected = cJSON_GetObjectItem(detail, "expected");
    const cJSON *state = cJSON_GetObjectItem(header, "state"),
                *present = cJSON_GetObjectItem(header, "present"),
                *ident = cJSON_GetObjectItem(header, "upload");

    v->unsure = true;
    if (strcmp(a->verb, "ERROR") == 0) {
        if (expected != NULL &&
            strcmp(cJSON_GetObjectItem(error, "field")->valuestring, "offset") == 0 &&
            expected->valuedouble < (double)v->acked)
            violate(5, "an upload expects again what was acknowledged");
        return;
    }
    if (state != NULL && strcmp(state->valuestring, "sealed") == 0) {
        *v = (struct upload_view) { .unsure = true };
        w->sealed++;
    } else if (state != NULL && strcmp(state->valuestring, "gone") == 0)
        *v = (struct upload_view) { .unsure = true };
    else if (state != NULL) {                              /* begun */
        if (present->valuedouble < (double)v->acked)
            violate(5, "acknowledged bytes are not present");
        *v = (struct upload_view) { .open = true,
                                   .sent = (uint64_t)present->valuedouble,
                                   .acked = (uint64_t)present->valuedouble };
        copy(v->ident, sizeof v->ident, ident->valuestring);
    } else if (v->open && strcmp(ident->valuestring, v->ident) ==
                              0) {   /* a chunk, and not of one that was given up since */
        if (present->valuedouble != (double)(offset + CHUNK))
            violate(5, "a chunk's answer is another's");
        v->acked = (uint64_t)present->valuedouble > v->acked ? (uint64_t)present->valuedouble
                                                             : v->acked;
        v->unsure = false;
    }
}

/* The sample AT of an epoch of STREAM as it was committed; NULL: it is not there. */
static const double *committed_sample(int64_t stream, uint64_t epoch, uint64_t at)
{
    for (int i = 0; i < w->segment_count; i++) {
        const struct segment_row *one = &w->segments[i];
        if (one->stream == stream && one->epoch == epoch && at >= one->first &&
            at < one->first + one->count)
            return &one->data[at - one->first];
    }
    return NULL;
}

/* What a push was acknowledged for is committed as it was sent, in the epoch that was told. */
static void told_push(int n, const char *ident, uint64_t epoch)
{
    int64_t stream = ident_number(~w->settings.secret, ident);

    for (uint64_t i = 0; i < PUSHED; i++) {
        const double *there = committed_sample(stream, epoch, w->asked[n].offset + i);
        if (there == NULL || *there != sample_of(w->asked[n].offset + i, w->asked[n].twist))
            violate(5, "a push is acknowledged whose samples are not there");
    }
}

/* What a closed stream is said to be never changes; what was acknowledged of an open one is never
 * less. */
static void told_stream(const struct action *a, const cJSON *header, int n)
{
    int user = w->asked[n].user, key = w->asked[n].key;
    struct stream_view *v = &w->streams[user][key];
    const cJSON *next = cJSON_GetObjectItem(header, "next"),
                *epoch = cJSON_GetObjectItem(header, "epoch"),
                *sha256 = cJSON_GetObjectItem(header, "sha256");
    const cJSON *ident = cJSON_GetObjectItem(header, "stream");
    bool same = next != NULL && v->open && strcmp(ident->valuestring, v->ident) == 0;

    if (w->asked[n].push && strcmp(a->verb, "REPLY") == 0 &&
        cJSON_GetObjectItem(header, "samples") == NULL)
        told_push(n, ident->valuestring, (uint64_t)epoch->valuedouble);
    if (strcmp(a->verb, "ERROR") == 0) {
        v->unsure = true;
        v->asked = false;
    } else if (cJSON_GetObjectItem(header, "samples") != NULL &&
               strcmp(ident->valuestring, v->ended) == 0) {
        if (strcmp(sha256 == NULL ? "" : sha256->valuestring, v->sha256) != 0)
            violate(5, "a closed stream is closed to something else");
    } else if (cJSON_GetObjectItem(header, "samples") != NULL) {
        struct stream_view ended = { .unsure = true };
        copy(ended.ended, sizeof ended.ended, ident->valuestring);
        copy(ended.sha256, sizeof ended.sha256, sha256 == NULL ? "" : sha256->valuestring);
        if (same && epoch->valuedouble == (double)v->epoch && next->valuedouble < (double)v->acked)
            violate(5, "a stream is closed without what was acknowledged");
        *v = ended;
        w->closed++;
    } else if (same) {
        if (epoch->valuedouble < (double)v->epoch ||
            (epoch->valuedouble == (double)v->epoch && next->valuedouble < (double)v->acked))
            violate(5, "acknowledged samples are not present");
        v->epoch = (uint64_t)epoch->valuedouble;
        v->acked = (uint64_t)next->valuedouble;
    } else if (cJSON_GetObjectItem(header, "name") != NULL &&
               strcmp(ident->valuestring, v->ended) != 0) {   /* opened anew */
        v->open = true;
        v->epoch = (uint64_t)epoch->valuedouble;
        v->acked = (uint64_t)next->valuedouble;
        copy(v->ident, sizeof v->ident, ident->valuestring);
    }
    if (v->open && v->unsure && strcmp(a->verb, "REPLY") == 0) {
        v->unsure = false;
        v->sent = v->acked;
    }
}

/* The doc or the error that answers submission N. */
static void told_of_submit(int n, const cJSON *doc)
{
    int user = w->asked[n & 4095].user, key = w->asked[n & 4095].key,
        variant = w->asked[n & 4095].variant;
    const cJSON *job = cJSON_GetObjectItem(doc, "job"), *error = cJSON_GetObjectItem(doc, "error");
    const char *code = error == NULL ? "" : cJSON_GetObjectItem(error, "code")->valuestring;

    if (job != NULL) {
        if (row_by_id(ident_number(w->settings.secret, job->valuestring)) == NULL)
            violate(1, "a submission is answered that is not committed");
        if (w->acked[user][key][0] != 0 && strcmp(w->acked[user][key], job->valuestring) != 0)
            violate(2, "one key, two jobs");
        if (w->acked[user][key][0] != 0 && w->acked_variant[user][key] != variant)
            violate(2, "other content was taken under a known key");
        if (w->expired[user][key])
            violate(2, "a key that had expired ran again");
        copy(w->acked[user][key], 9, job->valuestring);
        w->acked_variant[user][key] = variant;
    } else if (strcmp(code, "conflict") == 0 && w->acked[user][key][0] != 0 &&
               w->acked_variant[user][key] == variant)
        violate(2, "a conflict with itself");
    else if (strcmp(code, "expired") == 0)
        w->expired[user][key] = true;
}

/* The answer to SUBMITS N, whose parts are the submissions N, N + 1, ... */
static void told_of_many(int n, const struct action *a)
{
    cJSON *list = NULL, *part;

    if (strcmp(a->verb, "ERROR") == 0)
        return;                                    /* none of them was taken */
    if (a->body == NULL || json_read(a->body->data, a->body->size, &list, NULL) != MODAL_OK
        || cJSON_GetArraySize(cJSON_GetObjectItem(list, "jobs")) != w->asked[n & 4095].together)
        violate(1, "SUBMITS is not answered by a list of as many");
    cJSON_ArrayForEach(part, cJSON_GetObjectItem(list, "jobs"))
        told_of_submit(n++, part);
    cJSON_Delete(list);
}

static void told(const struct action *a)
{
    cJSON *header = cJSON_Parse(a->header);
    const cJSON *id = cJSON_GetObjectItem(header, "id"),
                *verb = cJSON_GetObjectItem(header, "verb"),
                *job = cJSON_GetObjectItem(header, "job");
    const cJSON *state = cJSON_GetObjectItem(header, "state");
    struct row *row = NULL;

    if (w->verbose)
        printf("  -> %s %s\n", a->verb, a->header);
    if (job != NULL && strcmp(a->verb, "REPLY") == 0)
        row = row_by_id(ident_number(w->settings.secret, job->valuestring));
    if (row != NULL && state != NULL && cJSON_GetObjectItem(header, "deleted") == NULL &&
        strcmp(job_states[row->state], state->valuestring) != 0 && job_state_final(row->state) &&
        row->state != JOB_DEAD)
        violate(3, "a doc shows another state than the committed end");
    if (row == NULL && job != NULL && strcmp(a->verb, "REPLY") == 0 &&
        cJSON_GetObjectItem(header, "deleted") == NULL)
        violate(1, "a doc of a job that is not committed");
    if (verb != NULL && strcmp(verb->valuestring, "SUBMIT") == 0 && cJSON_IsNumber(id))
        told_of_submit((int)id->valuedouble, header);
    if (verb != NULL && strcmp(verb->valuestring, "SUBMITS") == 0 && cJSON_IsNumber(id))
        told_of_many((int)id->valuedouble, a);
    if (verb != NULL && strcmp(verb->valuestring, "UPLOAD") == 0 && cJSON_IsNumber(id)) {
        int n = (int)id->valuedouble & 4095;
        told_upload(a, header, w->asked[n].user, w->asked[n].key, w->asked[n].offset);
        told_gone(header, w->asked[n].ident);
    }
    if (verb != NULL && strcmp(verb->valuestring, "STREAM") == 0 && cJSON_IsNumber(id)) {
        int n = (int)id->valuedouble & 4095;
        told_stream(a, header, n);
    }
    cJSON_Delete(header);
}

static bool slot_waits[WORKERS];               /* its death is known, its successor not there */

/* A worker whose death is not known yet may be told to run; what it is told is lost with it.  One
 * that has a window may have others behind it. */
static void to_worker(const struct action *a)
{
    cJSON *header = cJSON_Parse(a->header);
    const char *job = cJSON_GetStringValue(cJSON_GetObjectItem(header, "job"));
    const bool run = strcmp(a->verb, "RUN") == 0;
    const int slot = a->slot, *count = &w->workers[slot].ahead_count,
              attempt = run ? cJSON_GetObjectItem(header, "attempt")->valueint : 0;
    const bool ahead = run && w->workers[slot].busy && strcmp(job, "live") == 0
                       && strcmp(w->workers[slot].job, "live") == 0 && *count < AHEAD;

    if (run && ((w->workers[slot].busy && !ahead) || (!w->workers[slot].alive && slot_waits[slot])))
        violate(4, "RUN to a worker that is not idle");
    if (ahead)
        w->workers[slot].ahead[w->workers[slot].ahead_count++] = attempt;
    else if (run) {
        copy(w->workers[slot].job, 9, job);
        w->workers[slot].attempt = attempt;
        w->workers[slot].busy = true;
    }
    cJSON_Delete(header);
}

/* It has ended what it had, and begins with what it has behind that. */
static void worker_goes_on(int slot)
{
    int *ahead = w->workers[slot].ahead;

    w->workers[slot].busy = w->workers[slot].ahead_count > 0;
    if (!w->workers[slot].busy)
        return;
    w->workers[slot].attempt = ahead[0];
    memmove(ahead, ahead + 1, (size_t)--w->workers[slot].ahead_count * sizeof *ahead);
}

/* What arrives where somebody is: not where the connection is cut. */
static void to_remote(const struct action *a)
{
    cJSON *header = cJSON_Parse(a->header);
    int n = 0;

    while (n < REMOTES && w->remotes[n].peer != a->peer)
        n++;
    if (n < REMOTES && strcmp(a->verb, "RUN") == 0) {
        if (!w->remotes[n].joined || w->remotes[n].busy || w->remotes[n].stranger || w->revoked)
            violate(4, "RUN to a worker elsewhere that may not have it");
        if (cJSON_HasObjectItem(header, "live")) {
            w->windows++;
            if (w->settings.windows_elsewhere_ns == 0 || w->remotes[n].small)
                violate(4, "a live window to a worker elsewhere that may not have it");
        }
        copy(w->remotes[n].job, 9, cJSON_GetObjectItem(header, "job")->valuestring);
        w->remotes[n].attempt = (int)cJSON_GetObjectItem(header, "attempt")->valuedouble;
        w->remotes[n].busy = true;
    } else if (n < REMOTES && strcmp(a->verb, "WELCOME") == 0)
        w->remotes[n].joined = true;
    else if (n < REMOTES && !w->remotes[n].cut)
        w->remotes[n].stopped = true;                      /* STOP or NO */
    cJSON_Delete(header);
}

static void carry_out(struct action *a)
{
    switch (a->type) {
    case ACT_SEND:
        told(a);
        break;
    case ACT_COMMIT:
        a->transaction->next = NULL;
        *w->waiting_end = a->transaction;
        w->waiting_end = &a->transaction->next;
        break;
    case ACT_TASK:
        a->task->next = NULL;
        *w->tasks_end = a->task;
        w->tasks_end = &a->task->next;
        break;
    case ACT_WORKER:
        to_worker(a);
        break;
    case ACT_REMOTE:
        to_remote(a);
        break;
    case ACT_SPAWN:
        w->workers[a->slot].alive = w->workers[a->slot].booting = true;
        w->workers[a->slot].busy = w->workers[a->slot].silent = false;
        w->workers[a->slot].ahead_count = 0;
        break;
    case ACT_KILL:
        w->workers[a->slot].alive = false;
        break;
    default:
        if (w->verbose && a->type == ACT_LOG)
            printf("     %s\n", a->header);
    }
    if (a->type != ACT_COMMIT && a->type != ACT_TASK) {
        free(a->header);
        blob_drop(a->body);
    }
}

static void carry_out_all(const struct actions *list)
{
    size_t count = list->count;
    struct action *own = malloc((count + 1) * sizeof *own);
    long events = 0;

    memcpy(own, list->items, count * sizeof *own);
    for (size_t i = 0; i < count; i++) {
        events += own[i].type == ACT_SEND && strcmp(own[i].verb, "EVENT") == 0;
        carry_out(&own[i]);
    }
    free(own);
    w->events += events;
    w->events_most = events > w->events_most ? events : w->events_most;
}

static void run_step(struct event e)
{
    w->states++;
    carry_out_all(core_step(w->core, &e, w->now));
}

/* ---- what may happen
 * -------------------------------------------------------------------------------------------- */

static void request(int user, const char *verb, const char *header, const void *body, size_t size)
{
    struct wire_frame frames[4] = {
        { WIRE_VERSION, 7 }, { verb, strlen(verb) }, { header, strlen(header) }, { body, size }
    };
    struct blob *blobs[1] = { body != NULL ? blob_copy(body, size) : NULL };
    struct wire_message m;
    struct modal_error err;
    enum modal_status rc = wire_open(frames, body != NULL ? 4 : 3, WIRE_VERSION, true, &m, &err);

    if (w->verbose)
        printf("<- %s %s\n", verb, header);
    if (m.body_count == 1)
        m.body[0].data = blobs[0]->data;
    run_step((struct event) { .type = EVENT_REQUEST,
                             .peer = 1 + (uint64_t)user,
                             .key = user == 0 ? "" : "second",
                             .message = rc == MODAL_OK ? &m : NULL,
                             .verb = m.verb,
                             .id = m.id,
                             .fault = &err,
                             .body = blobs });
    wire_close(&m);
    blob_drop(blobs[0]);
}

static void submit_something(void)
{
    int user = (int)roll(2), key = (int)roll(KEYS), variant = roll(12) == 0 ? 1 : 0;
    double data[2] = { key + 100 * user, variant };
    char header[400];
    int n = (int)(++w->request & 4095);

    w->asked[n].user = user;
    w->asked[n].key = key;
    w->asked[n].variant = variant;
    snprintf(header, sizeof header,
             "{\"id\":%d,\"kind\":\"identify\",\"key\":\"k%d\",\"priority\":%u,\"input\":"
             "{\"content\":\"batch\",\"samples\":2,\"channels\":1,\"dt\":1}%s%s}",
             n, key, roll(256), roll(5) == 0 ? ",\"run_limit_s\":3" : "",
             roll(8) == 0 ? ",\"deadline_s\":30" : "");
    request(user, "SUBMIT", header, data, sizeof data);
}

/* One to four submissions in one message; the same key may be in it twice. */
static void submit_some(void)
{
    int user = (int)roll(2), together = 1 + (int)roll(4), first = (int)(w->request + 1);
    double data[8];
    char header[1600];
    size_t used = (size_t)snprintf(header, sizeof header, "{\"id\":%d,\"jobs\":[", first & 4095);

    for (int i = 0; i < together; i++) {
        int n = (int)(++w->request & 4095), key = (int)roll(KEYS), variant = roll(12) == 0 ? 1 : 0;
        w->asked[n].user = user;
        w->asked[n].key = key;
        w->asked[n].variant = variant;
        data[2 * i] = key + 100 * user;
        data[2 * i + 1] = variant;
        used +=
            (size_t)snprintf(header + used, sizeof header - used,
                             "%s{\"kind\":\"identify\",\"key\":\"k%d\",\"priority\":%u,\"input\":"
                             "{\"content\":\"batch\",\"samples\":2,\"channels\":1,\"dt\":1}}",
                             i > 0 ? "," : "", key, roll(256));
    }
    snprintf(header + used, sizeof header - used, "]}");
    w->asked[first & 4095].together = together;
    request(user, "SUBMITS", header, data, 2 * (size_t)together * sizeof *data);
}

static void ask_upload(int user, int key, const char *op, uint64_t offset)
{
    static const char body[CHUNK];
    const struct upload_view *v = &w->uploads[user][key];
    uint64_t samples = upload_samples(user, key);
    char header[300], hex[65];
    uint8_t sha256[32];
    int n = (int)(++w->request & 4095);

    w->asked[n].user = user;
    w->asked[n].key = key;
    w->asked[n].offset = offset;
    memcpy(w->asked[n].ident, v->ident, sizeof v->ident);
    hash_of(strcmp(op, "spoil") == 0 ? samples + 1 : samples, sha256);
    sha256_hex(sha256, hex);
    if (strcmp(op, "begin") == 0)
        snprintf(header, sizeof header,
                 "{\"id\":%d,\"op\":\"begin\",\"key\":\"u%d\",\"content\":\"batch\","
                 "\"samples\":%d,\"channels\":1,\"dt\":1}",
                 n, key, (int)samples);
    else if (strcmp(op, "chunk") == 0)
        snprintf(header, sizeof header,
                 "{\"id\":%d,\"op\":\"chunk\",\"upload\":\"%s\",\"offset\":%d,\"crc32c\":%u}", n,
                 v->ident, (int)offset, crc32c(0, body, CHUNK));
    else if (strcmp(op, "seal") == 0 || strcmp(op, "spoil") == 0)
        snprintf(header, sizeof header,
                 "{\"id\":%d,\"op\":\"seal\",\"upload\":\"%s\",\"sha256\":\"%s\"}", n, v->ident,
                 hex);
    else
        snprintf(header, sizeof header, "{\"id\":%d,\"op\":\"abort\",\"upload\":\"%s\"}", n,
                 v->ident);
    request(user, "UPLOAD", header, strcmp(op, "chunk") == 0 ? body : NULL,
            strcmp(op, "chunk") == 0 ? CHUNK : 0);
}

/* The next thing a client does with an upload, several chunks ahead of the answers. */
static void upload_something(int user, int key, bool aborts)
{
    struct upload_view *v = &w->uploads[user][key];

    if (!v->open || v->unsure) {
        v->unsure = false;
        ask_upload(user, key, "begin", 0);
    } else if (aborts && roll(40) == 0)
        ask_upload(user, key, "abort", 0);
    else if (v->sent < 8 * upload_samples(user, key)) {
        v->sent += CHUNK;
        ask_upload(user, key, "chunk", v->sent - CHUNK);
    } else if (aborts && roll(8) == 0)
        ask_upload(user, key, "spoil", 0);         /* the seal of other bytes */
    else
        ask_upload(user, key, "seal", 0);
}

static void ask_stream(int user, int key, const char *op, const char *ident)
{
    struct stream_view *v = &w->streams[user][key];
    double data[PUSHED];
    char header[300];
    int n = (int)(++w->request & 4095);

    w->asked[n].user = user;
    w->asked[n].key = key;
    for (int i = 0; i < PUSHED; i++)
        data[i] = sample_of(v->sent + (uint64_t)i, v->twist);
    w->asked[n].offset = v->sent;
    w->asked[n].twist = v->twist;
    w->asked[n].push = strcmp(op, "push") == 0;
    if (strcmp(op, "open") == 0)
        snprintf(header, sizeof header,
                 "{\"id\":%d,\"op\":\"open\",\"name\":\"r%d\",\"channels\":1,\"dt\":0.1,"
                 "\"window\":{\"samples\":12,\"hop\":8}}",
                 n, key);
    else if (strcmp(op, "push") == 0)
        snprintf(header, sizeof header,
                 "{\"id\":%d,\"op\":\"push\",\"stream\":\"%s\",\"epoch\":%d,\"first\":%d,"
                 "\"count\":%d,\"crc32c\":%u}",
                 n, ident, (int)v->epoch, (int)v->sent, PUSHED, crc32c(0, data, sizeof data));
    else
        snprintf(header, sizeof header, "{\"id\":%d,\"op\":\"close\",\"stream\":\"%s\"}", n, ident);
    request(user, "STREAM", header, strcmp(op, "push") == 0 ? data : NULL,
            strcmp(op, "push") == 0 ? sizeof data : 0);
}

/* The next thing a simulation does with its stream: now and then it goes on from a checkpoint, with
 * other samples. */
static void stream_something(int user, int key, bool close)
{
    struct stream_view *v = &w->streams[user][key];

    if (v->ended[0] != 0 && roll(6) == 0)
        ask_stream(user, key, "close", v->ended);
    else if (!v->open || v->unsure) {
        v->unsure = true;
        ask_stream(user, key, "open", NULL);
    } else if (v->asked || (v->acked >= 20 && (close || roll(10) == 0))) {
        v->asked = true;
        ask_stream(user, key, "close", v->ident);
    } else {
        if (roll(12) == 0 && v->sent == v->acked && v->sent >= 8)
            v->sent -= 8, v->twist++;
        ask_stream(user, key, "push", v->ident);
        v->sent += PUSHED;
    }
}

static void ask_about_something(const char *verb)
{
    char header[100];

    snprintf(header, sizeof header, "{\"id\":\"q\",\"job\":\"key:k%u\"}", roll(KEYS));
    request((int)roll(2), verb, header, NULL, 0);
}

static void worker_says(int slot, const char *verb, const char *job, int attempt, const char *more,
                        const char *body)
{
    char header[300];
    struct wire_frame frames[4] = { { WIRE_WORKER, 7 },
                                    { verb, strlen(verb) },
                                    { header, 0 },
                                    { body, body == NULL ? 0 : strlen(body) } };
    struct blob *blobs[1] = { body != NULL ? blob_copy(body, strlen(body)) : NULL };
    struct wire_message m;

    snprintf(header, sizeof header, "{\"job\":\"%s\",\"attempt\":%d%s}", job, attempt, more);
    frames[2].size = strlen(header);
    if (wire_open(frames, body != NULL ? 4 : 3, WIRE_WORKER, false, &m, NULL) == MODAL_OK)
        run_step(
            (struct event) { .type = EVENT_WORKER, .slot = slot, .message = &m, .body = blobs });
    wire_close(&m);
    blob_drop(blobs[0]);
}

static void worker_acts(void)
{
    int slot = (int)roll(WORKERS);
    uint32_t what = roll(20);

    if (!w->workers[slot].alive || w->workers[slot].silent)
        return;
    if (w->workers[slot].booting) {
        w->workers[slot].booting = false;
        worker_says(slot, "READY", "", 0, ",\"pid\":7", NULL);
    } else if (what == 0) {
        w->workers[slot].alive = false;                    /* it dies */
    } else if (what == 1) {
        w->workers[slot].silent = true;                    /* it hangs */
    } else if (what == 2 && w->workers[slot].old_job[0] != 0) {
        worker_says(slot, "DONE", w->workers[slot].old_job, w->workers[slot].old_attempt, "",
                    "{\"late\":1}");
    } else if (w->workers[slot].busy && what < 14) {
        memcpy(w->workers[slot].old_job, w->workers[slot].job, sizeof w->workers[slot].job);
        w->workers[slot].old_attempt = w->workers[slot].attempt;
        worker_goes_on(slot);
        if (what < 12)
            worker_says(slot, "DONE", w->workers[slot].old_job, w->workers[slot].old_attempt,
                        ",\"cpu_s\":0.001", "{\"kind\":\"identify\"}");
        else
            worker_says(slot, "FAILED", w->workers[slot].old_job, w->workers[slot].old_attempt,
                        ",\"error\":{\"code\":\"no_convergence\",\"message\":\"x\"}", NULL);
        worker_says(slot, "READY", "", 0, ",\"pid\":7", NULL);
    } else
        worker_says(slot, "BEAT", "", 0, "", NULL);
}

static void remote_says(int n, const char *verb, const char *header, const char *body)
{
    struct wire_frame frames[4] = { { WIRE_WORKER, 7 },
                                    { verb, strlen(verb) },
                                    { header, strlen(header) },
                                    { body, body == NULL ? 0 : strlen(body) } };
    struct blob *blobs[1] = { body != NULL ? blob_copy(body, strlen(body)) : NULL };
    struct wire_message m;

    if (w->verbose)
        printf("   %d: %s %s\n", n, verb, header);
    if (wire_open(frames, body != NULL ? 4 : 3, WIRE_WORKER, false, &m, NULL) == MODAL_OK)
        run_step((struct event) { .type = EVENT_REMOTE,
                                 .peer = w->remotes[n].peer,
                                 .key = w->remotes[n].stranger ? "second" : "work",
                                 .message = &m,
                                 .body = blobs });
    wire_close(&m);
    blob_drop(blobs[0]);
}

/* VERB of JOB and ATTEMPT, with MORE members, and for DONE their document. */
static void remote_says_of(int n, const char *verb, const char *job, int attempt, const char *more)
{
    char header[300], document[64];

    snprintf(header, sizeof header, "{\"job\":\"%s\",\"attempt\":%d%s}", job, attempt, more);
    snprintf(document, sizeof document, "{\"of\":\"%s\",\"attempt\":%d}", job, attempt);
    remote_says(n, verb, header, strcmp(verb, "DONE") == 0 ? document : NULL);
}

/* Its connection is gone, and what it had it may still say on the next. */
static void remote_ends(int n)
{
    const uint64_t peer = w->remotes[n].peer;

    memcpy(w->remotes[n].old_job, w->remotes[n].job, 9);
    w->remotes[n].old_attempt = w->remotes[n].attempt;
    w->remotes[n].peer = 0;
    w->remotes[n].joined = w->remotes[n].cut = w->remotes[n].busy = w->remotes[n].leaving = false;
    w->remotes[n].stopped = false;
    run_step((struct event) { .type = EVENT_REMOTE_GONE, .peer = peer });
}

static void remote_joins(int n)
{
    char header[200], left[40] = "";

    w->remotes[n].peer = ++w->last_peer;
    w->remotes[n].stranger = roll(10) == 0;
    w->remotes[n].small = roll(4) == 0;
    if (roll(3) == 0)
        snprintf(left, sizeof left, ",\"left_s\":%u", roll(30));
    snprintf(header, sizeof header,
             "{\"version\":\"%s\",\"name\":\"n%d\",\"node\":\"x\",\"memory_bytes\":%d%s}",
             roll(20) == 0 ? "0" : MODALD_VERSION, n / 2, w->remotes[n].small ? 8 : 1 << 20, left);
    remote_says(n, "JOIN", header, NULL);
    if (w->remotes[n].joined)
        remote_says(n, "READY", "{}", NULL);
}

static void remote_finishes(int n, const char *verb, const char *more)
{
    w->remotes[n].busy = false;
    remote_says_of(n, verb, w->remotes[n].job, w->remotes[n].attempt, more);
    remote_says(n, "READY", "{}", NULL);
}

/* One that is connected and heard. */
static void remote_works(int n)
{
    const uint32_t what = roll(24), other = roll(REMOTES);
    const bool busy = w->remotes[n].busy;

    if (what == 0)
        remote_ends(n);
    else if (what == 1)
        w->remotes[n].cut = true;
    else if (what == 2 && w->remotes[n].old_job[0] != 0)
        remote_says_of(n, "DONE", w->remotes[n].old_job, w->remotes[n].old_attempt, "");
    else if (what == 3 && other != (uint32_t)n && w->remotes[other].busy) {
        w->foreign++;
        remote_says_of(n, roll(2) == 0 ? "DONE" : "RELEASE", w->remotes[other].job,
                       w->remotes[other].attempt, "");
    } else if (what == 4 && busy)
        remote_says_of(n, "INPUT", w->remotes[n].job, w->remotes[n].attempt,
                       ",\"offset\":0,\"length\":8");
    else if (what == 5)
        remote_says(n, "STDERR", "{}", "last words");
    else if (what < 8 && busy)
        remote_says_of(n, "RELEASE", w->remotes[n].job, w->remotes[n].attempt, "");
    else if (what < 8) {
        w->remotes[n].leaving = true;
        remote_says(n, "LEAVE", "{}", NULL);
    } else if (busy && what < 18)
        remote_finishes(n, "DONE", ",\"cpu_s\":0.1");
    else if (busy && what < 20)
        remote_finishes(n, "FAILED", ",\"error\":{\"code\":\"no_convergence\",\"message\":\"x\"}");
    else
        remote_says(n, "BEAT", "{}", NULL);
}

/* What was cut off for longer than its lease says what it has to say, and is not believed. */
static void remote_acts(void)
{
    const int n = (int)roll(REMOTES);

    if (w->remotes[n].peer == 0)
        remote_joins(n);
    else if (w->remotes[n].stopped || (!w->remotes[n].joined && roll(2) == 0))
        remote_ends(n);
    else if (w->remotes[n].cut) {
        w->remotes[n].cut = roll(8) != 0;
        if (!w->remotes[n].cut && w->remotes[n].busy)
            remote_finishes(n, "DONE", "");
    } else
        remote_works(n);
}

/* The keys file is read again, with or without the workers' key. */
static void revoke_or_admit(void)
{
    w->revoked = !w->revoked;
    w->settings.account_count = w->revoked ? 2 : 3;
    run_step((struct event) { .type = EVENT_SETTINGS, .settings = &w->settings });
}

static void settle_remotes(void)
{
    for (int n = 0; n < REMOTES; n++)
        if (w->remotes[n].peer != 0 && (w->remotes[n].cut || w->remotes[n].stopped))
            remote_ends(n);
        else if (w->remotes[n].peer != 0 && w->remotes[n].busy)
            remote_finishes(n, "DONE", "");
}

/* Deaths become known, in any order with other things. */
static void exits(void)
{
    for (int slot = 0; slot < WORKERS; slot++)
        if (!w->workers[slot].alive && !slot_waits[slot]) {
            slot_waits[slot] = true;
            w->workers[slot].busy = false;
            run_step((struct event){
                .type = EVENT_EXIT, .slot = slot, .status = 9, .stderr_text = "last words" });
        }
}

static void note_alive(void)
{
    for (int slot = 0; slot < WORKERS; slot++)
        if (w->workers[slot].alive)
            slot_waits[slot] = false;
}

/* Commit a prefix of what waits as one group; on a full disk the refusable ones of it are refused,
 * and those behind their fences. */
static void commit_some(uint32_t most)
{
    for (uint32_t n = 0; n < most && w->waiting != NULL; n++) {
        struct transaction *t = w->waiting;
        w->waiting = t->next;
        if (w->waiting == NULL)
            w->waiting_end = &w->waiting;
        t->next = NULL;
        if ((t->fence != NULL && atomic_load(t->fence)) ||
            (w->full &&
             (t->refusable == FIRST_REFUSED || (t->refusable == LAST_REFUSED && roll(2) == 0))))
            t->status = MODAL_STORAGE_FULL;
        for (size_t i = 0; t->status == MODAL_OK && i < t->count; i++)
            apply(&t->changes[i]);
        if (t->status != MODAL_OK && t->fence != NULL)
            atomic_store(t->fence, true);
        run_step((struct event) { .type = EVENT_COMMITTED, .transaction = t });
    }
}

/* A spool that has no room, or no descriptor, as far as its tasks can meet that. */
static enum modal_status luck(const struct task *task)
{
    switch (task->type) {
    case TASK_BEGIN:
    case TASK_SEAL:
    case TASK_STREAM_SEAL:
        return roll(8) == 0 ? MODAL_BUSY : w->full && roll(2) == 0 ? MODAL_STORAGE_FULL : MODAL_OK;
    case TASK_RESUME: return roll(8) == 0 ? MODAL_BUSY : MODAL_OK;
    case TASK_WRITE:
        return roll(8) == 0 || (w->full && roll(2) == 0) ? MODAL_STORAGE_FULL : MODAL_OK;
    default: return MODAL_OK;
    }
}

/* All its segments are there, one after the other, and the last is the end. */
static void check_segments(const struct task *t)
{
    uint64_t samples = 0;

    for (int i = 0; i < w->segment_count; i++) {
        const struct segment_row *one = &w->segments[i];
        if (one->stream != t->stream || one->epoch != t->epoch)
            continue;
        if (one->first < t->begin + samples)
            violate(5, "a stream is sealed of segments that lie in each other");
        samples = one->first - t->begin + one->count;
    }
    if (samples != t->shape.samples)
        violate(5, "a stream is sealed of other samples than it has");
}

static void compare_samples(struct task *t)
{
    for (uint64_t i = 0; i < t->length; i++) {
        const double *there = committed_sample(t->stream, t->epoch, t->begin + i);
        t->differs |= there != NULL && *there != ((const double *)t->chunks[0]->data)[i];
    }
}

/* A window goes on from samples that are all there. */
static void read_samples(struct task *t)
{
    t->text = blob_take(calloc(t->length, 8), t->length * 8);
    for (uint64_t i = 0; i < t->length; i++) {
        const double *there = committed_sample(t->stream, t->epoch, t->begin + i);
        if (there == NULL)
            violate(5, "samples are read that are not there");
        else
            ((double *)t->text->data)[i] = *there;
    }
}

static void do_task(struct task *t)
{
    static char handle;

    t->status = luck(t);
    if (t->status != MODAL_OK)
        modal_fail(&t->err, t->status, "bad luck");
    else if (t->type == TASK_READ_INPUT || t->type == TASK_READ_RESULT ||
             t->type == TASK_READ_STDERR)
        t->text = blob_copy("0123456789abcdef", 16);
    else if (t->type == TASK_ROOM)
        t->total = w->full ? 0 : 1 << 30;
    else if (t->type == TASK_BEGIN)
        t->upload = (void *)&handle;
    else if (t->type == TASK_SEAL)
        hash_of(t->shape.samples, t->sha256);
    else if (t->type == TASK_STREAM_SEAL) {
        check_segments(t);
        hash_of((uint64_t)t->id, t->sha256);
    } else if (t->type == TASK_SAMPLES_COMPARE)
        compare_samples(t);
    else if (t->type == TASK_SAMPLES_READ)
        read_samples(t);
    else if (t->type == TASK_BATCH_READ)
        t->text = blob_take(calloc(t->length, 1), t->length);
    else if (t->type == TASK_REMOVE_INPUT && has_input_row(t->id))
        violate(5, "the file of an input goes before its row");
    else if (t->type == TASK_CLOSE)
        t->upload = NULL;
    if (t->type == TASK_RESUME) {
        t->upload = t->status == MODAL_OK ? (void *)&handle : NULL;
        for (int i = 0; i < w->input_count && t->status == MODAL_OK; i++)
            if (w->inputs[i].id == t->id && !w->inputs[i].gone &&
                w->inputs[i].received != t->offset)
                violate(5, "an upload is taken up before its chunks are committed");
    }
    run_step((struct event) { .type = EVENT_TASK, .task = t });
}

static void do_tasks(uint32_t most)
{
    for (uint32_t n = 0; n < most && w->tasks != NULL; n++) {
        struct task *t = w->tasks;
        w->tasks = t->next;
        if (w->tasks == NULL)
            w->tasks_end = &w->tasks;
        do_task(t);
    }
}

/* ---- restarts
 * -------------------------------------------------------------------------------------------------
 */

static void load_rows(struct ledger_visitor *v)
{
    for (int i = 0; i < w->input_count; i++) {
        struct input_record r = { .id = w->inputs[i].id,
                                  .user = w->inputs[i].user,
                                  .shape = { .type = INPUT_BATCH,
                                             .samples = w->inputs[i].samples,
                                             .channels = 1,
                                             .dt = 1 },
                                  .state = w->inputs[i].state,
                                  .inline_data = w->inputs[i].inline_data,
                                  .received = w->inputs[i].received,
                                  .created_ns = 1,
                                  .used_ns = w->now.utc_ns };
        memcpy(r.sha256, w->inputs[i].sha256, 32);
        if (!w->inputs[i].gone)
            v->input(v->context, &r);
    }
    for (int i = 0; i < w->row_count; i++) {
        const struct row *row = &w->rows[i];
        struct job_record r = { .id = row->id,
                                .user = row->user,
                                .key = row->key[0] ? row->key : NULL,
                                .kind = row->kind,
                                .options = row->options,
                                .input = row->input,
                                .priority = row->priority,
                                .run_limit_ns = row->run_limit,
                                .deadline_ns = row->deadline,
                                .not_before_ns = row->not_before,
                                .tag = row->tag,
                                .state = row->state,
                                .attempts = row->attempts,
                                .crashes = row->crashes,
                                .submitted_ns = row->submitted,
                                .started_ns = row->started,
                                .finished_ns = row->finished,
                                .error_code = row->error[0] ? row->error : NULL,
                                .result_bytes = row->result_bytes,
                                .cached = row->cached };
        memcpy(r.fingerprint, row->fingerprint, 32);
        if (!row->gone)
            v->job(v->context, &r);
    }
    for (int i = 0; i < w->stone_count; i++) {
        struct tombstone_record r = { .user = w->stones[i].user,
                                      .key = w->stones[i].key,
                                      .job = w->stones[i].job,
                                      .expired_ns = w->stones[i].expired_ns };
        v->tombstone(v->context, &r);
    }
    for (int i = 0; i < w->note_count; i++)
        v->note(v->context,
                &(struct note_record) { w->notes[i].topic, w->notes[i].name, w->notes[i].text });
    /* one stream's are in order, which is what matters */
    for (int i = 0; i < w->segment_count; i++) {
        const struct segment_row *one = &w->segments[i];
        v->segment(v->context, &(struct segment_record) { .stream = one->stream,
                                                         .epoch = one->epoch,
                                                         .first = one->first,
                                                         .count = one->count,
                                                         .offset = one->offset,
                                                         .length = one->length });
    }
    if (w->last_event > 0)
        v->event(v->context,
                 &(struct event_record) { .number = w->last_event, .user = "one", .text = "{}" });
}

static void drop_all(void)
{
    while (w->waiting != NULL) {
        struct transaction *t = w->waiting;
        w->waiting = t->next;
        transaction_free(t);
    }
    while (w->tasks != NULL) {
        struct task *t = w->tasks;
        w->tasks = t->next;
        task_free(t);
    }
    w->waiting_end = &w->waiting;
    w->tasks_end = &w->tasks;
}

static void boot(void)
{
    struct ledger_visitor v;

    memset(w->workers, 0, sizeof w->workers);
    memset(w->remotes, 0, sizeof w->remotes);
    memset(slot_waits, 0, sizeof slot_waits);
    w->core = core_new(&w->settings, w->now);
    core_visitor(w->core, &v);
    load_rows(&v);
    carry_out_all(core_loaded(w->core, w->now));
}

/* The core closes the spool's handles; those of this world are none. */
static void end_core(void)
{
    struct input *input;
    size_t at = 0;

    while ((input = map_next(&w->core->inputs->all, &at)) != NULL)
        if (input->filling != NULL)
            input->filling->upload = NULL;
    core_free(w->core);
}

/* Power off: what was not committed never was. */
static void restart(void)
{
    if (w->verbose)
        printf("---- restart\n");
    total_restarts++;
    drop_all();
    end_core();
    for (int i = 0; i < 2 * UPLOADS; i++)
        w->uploads[i / UPLOADS][i % UPLOADS].unsure = true;
    for (int i = 0; i < 2 * STREAMS; i++) {
        struct stream_view *v = &w->streams[i / STREAMS][i % STREAMS];
        v->unsure = true;
        v->asked = false;
        v->ended[0] = 0;   /* a restart does not remember those that are closed */
    }
    boot();
}

/* ---- a world
 * -------------------------------------------------------------------------------------------------
 */

static void pass_time(void)
{
    int64_t ns = (int64_t)roll(4) * SECOND + (int64_t)roll(1000) * 1000000;

    w->now.mono_ns += ns;
    /* the wall clock may jump an hour */
    w->now.utc_ns += ns + (roll(50) == 0 ? ((int64_t)roll(7200) - 3600) * SECOND : 0);
    run_step((struct event) { .type = EVENT_TIME });
}

static void something_happens(void)
{
    static const char *const verbs[] = { "STATUS", "CANCEL", "RETRY", "DELETE", "WAIT", "RESULT" };
    uint32_t what = roll(100);

    if (what < 10)
        submit_something();
    else if (what < 14)
        submit_some();
    else if (what < 18)
        upload_something((int)roll(2), (int)roll(UPLOADS), true);
    else if (what < 24)
        stream_something((int)roll(2), (int)roll(STREAMS), false);
    else if (what < 34)
        ask_about_something(verbs[roll(6)]);
    else if (what < 64 && w->elsewhere && roll(3) > 0)
        remote_acts();
    else if (what < 64)
        worker_acts();
    else if (what < 82)
        commit_some(1 + roll(6));
    else if (what < 90)
        do_tasks(1 + roll(4));
    else if (what < 96)
        pass_time();
    else if (what < 97)
        w->full = !w->full;
    else if (what < 98)
        run_step((struct event) { .type = EVENT_PEER_GONE, .peer = 1 + roll(2) });
    else if (what < 99)
        restart();
    else if (w->elsewhere && roll(2) == 0)
        revoke_or_admit();
    exits();
    note_alive();
}

/* What STATS and METRICS say without a walk over all jobs is what a walk finds. */
static void check_counts(void)
{
    const struct core *c = w->core;
    int64_t kinds[JOB_KINDS_MOST] = { 0 };

    for (size_t i = 0; i < c->user_count; i++) {
        const struct user *user = c->user_list[i];
        int64_t states[JOB_STATE_COUNT] = { 0 };
        for (size_t k = 0; k < user->job_count; k++)
            if (user->jobs[k] != NULL && !user->jobs[k]->hidden) {
                states[user->jobs[k]->state]++;
                kinds[user->jobs[k]->kind_row]++;
            }
        if (memcmp(states, user->states, sizeof states) != 0)
            violate(3, "a user's jobs are counted in other states than they are in");
    }
    if (memcmp(kinds, c->jobs->kind_counts, sizeof kinds) != 0)
        violate(3, "jobs are counted by other kinds than theirs");
}

/* With no more faults everything that was acknowledged comes to an end. */
static void settle(void)
{
    const struct core *c;
    const int64_t *states;

    w->full = false;
    check_counts();
    for (int round = 0; round < 3000; round++) {
        c = w->core, states = c->jobs->state_counts;
        if (states[JOB_QUEUED] == 0 && states[JOB_RUNNING] == 0 && c->uncommitted == 0 &&
            c->tasks == 0) {
            check_counts();
            return;
        }
        for (int slot = 0; slot < WORKERS; slot++) {
            if (w->workers[slot].silent)
                w->workers[slot].alive = false;
            if (w->workers[slot].alive && w->workers[slot].booting) {
                w->workers[slot].booting = false;
                worker_says(slot, "READY", "", 0, ",\"pid\":7", NULL);
            } else if (w->workers[slot].alive && w->workers[slot].busy) {
                const int attempt = w->workers[slot].attempt;
                worker_goes_on(slot);
                worker_says(slot, "DONE", w->workers[slot].job, attempt, "", "{}");
                worker_says(slot, "READY", "", 0, ",\"pid\":7", NULL);
            }
        }
        settle_remotes();
        exits();
        note_alive();
        commit_some(100);
        do_tasks(100);
        w->now.mono_ns += SECOND / 2;
        w->now.utc_ns += SECOND / 2;
        run_step((struct event) { .type = EVENT_TIME });
    }
    violate(4, "what was acknowledged does not end");
}

/* Each upload that was begun comes to its seal, however unlucky its tasks were. */
static void finish_uploads(void)
{
    for (int i = 0; i < 2 * UPLOADS; i++) {
        int user = i / UPLOADS, key = i % UPLOADS;
        long before = w->sealed;
        for (int round = 0; round < 2000 && w->sealed == before; round++) {
            upload_something(user, key, false);
            do_tasks(2);
            commit_some(1 + roll(2));
            if (round % 50 == 49)
                w->uploads[user][key].unsure = true;       /* an answer was lost */
        }
        if (w->sealed == before)
            violate(5, "an upload does not come to its seal");
    }
}

static void finish_streams(void)
{
    for (int i = 0; i < 2 * STREAMS; i++) {
        struct stream_view *v = &w->streams[i / STREAMS][i % STREAMS];
        long before = w->closed;
        for (int round = 0; round < 2000 && w->closed == before; round++) {
            stream_something(i / STREAMS, i % STREAMS, true);
            do_tasks(2);
            commit_some(1 + roll(3));
            if (round % 50 == 49)
                v->unsure = true, v->asked = false;
        }
        if (w->closed == before)
            violate(5, "a stream does not come to its end");
    }
}

static void check_acknowledged(void)
{
    for (int user = 0; user < 2; user++)
        for (int key = 0; key < KEYS; key++) {
            struct row *row =
                w->acked[user][key][0] == 0
                    ? NULL
                    : row_by_id(ident_number(w->settings.secret, w->acked[user][key]));
            bool stone = false;
            char name[16];
            snprintf(name, sizeof name, "k%d", key);
            for (int i = 0; i < w->stone_count; i++)
                stone |= strcmp(w->stones[i].key, name) == 0 &&
                         strcmp(w->stones[i].user, user == 0 ? "one" : "two") == 0;
            if (w->acked[user][key][0] != 0 && row == NULL && !stone)
                violate(1, "an acknowledged job is lost");
            if (row != NULL && !job_state_final(row->state))
                violate(4, "an acknowledged job has not ended");
        }
    for (int i = 0; i < w->row_count; i++)
        if (w->rows[i].results > 1)
            violate(4, "two results of one job");
}

static void open_world(uint64_t seed, bool verbose, bool elsewhere)
{
    w = calloc(1, sizeof *w);
    w->seed = w->dice = seed;
    w->dice = map_hash_number(seed + 1);
    w->verbose = verbose;
    w->waiting_end = &w->waiting;
    w->tasks_end = &w->tasks;
    w->now = (struct moment) { 1000 * SECOND, INT64_C(1790000000) * SECOND };
    w->account[0] =
        (struct account) { .key = "", .user = "one", .role = WIRE_ROLE_ADMIN, .weight = 1 };
    w->account[1] =
        (struct account) { .key = "second", .user = "two", .role = WIRE_ROLE_SUBMIT, .weight = 2 };
    w->account[2] =
        (struct account) { .key = "work", .user = "pool", .role = WIRE_ROLE_WORKER, .weight = 1 };
    w->elsewhere = elsewhere;
    w->settings = (struct settings) { .accounts = w->account,
                                     .account_count = elsewhere ? 3 : 2,
                                     .workers = elsewhere && seed % 2 == 1 ? 1 : WORKERS,
                                     .queue_jobs = 20,
                                     .input_bytes = 1 << 20,
                                     .window_bytes = 1 << 20,
                                     .lease_ns = 5 * SECOND,
                                     .windows_elsewhere_ns = seed % 4 == 0 ? 0 : 2 * SECOND,
                                     .result_age_ns = 3600 * SECOND,
                                     .input_age_ns = 60 * SECOND,
                                     .tombstone_age_ns = 86400 * SECOND,
                                     .upload_idle_ns = 86400 * SECOND,
                                     .result_bytes = 1 << 30,
                                     .events_kept = 1024, .jobs_kept = 1 << 20,
                                     .secret = 0x1234567 };
    boot();
}

static void close_world(void)
{
    drop_all();
    end_core();
    total_states += w->states;
    total_gone += w->told_gone;
    total_documents += w->documents;
    total_foreign += w->foreign;
    total_windows += w->windows;
    for (int p = 0; p < 11; p++)
        total_violations[p] += w->violations[p];
    free(w);
}

static void run_world(uint64_t seed, bool verbose, bool elsewhere)
{
    open_world(seed, verbose, elsewhere);
    for (int i = 0; i < STEPS; i++)
        something_happens();
    settle();
    finish_uploads();
    finish_streams();
    settle();
    check_acknowledged();
    close_world();
}

static void run_worlds(bool elsewhere)
{
    const char *one = getenv("MODALD_SEED"), *many = getenv("MODALD_SEEDS");
#ifdef __SANITIZE_ADDRESS__
    const long usual = 250;         /* of the thousand: a step costs four times as much there */
#else
    const long usual = 1000;
#endif
    long seeds = many != NULL ? strtol(many, NULL, 10) : usual, violations = 0;

    if (one != NULL)
        run_world(strtoull(one, NULL, 10), true, elsewhere);
    else
        for (long seed = 0; seed < seeds; seed++)
            run_world((uint64_t)seed, false, elsewhere);
    for (int p = 1; p <= 5; p++) {
        printf("P%d: simulator, %ld seeds, %ld restarts, %ld states tried, %ld violations\n", p,
               seeds, total_restarts, total_states, total_violations[p]);
        violations += total_violations[p];
    }
    printf("simulator: %ld live windows were elsewhere\n", total_windows);
    CHECK(violations == 0);
    /* Uploads were aborted, or refused for their hash. */
    CHECK(one != NULL || seeds < 100 || total_gone > 0);
    CHECK(one != NULL || seeds < 100 || !elsewhere ||
          (total_documents > 0 && total_foreign > 0 && total_windows > 0));
}

TEST(no_promise_is_violated_in_any_world_of_a_thousand_seeds)
{
    run_worlds(false);
}

TEST(nor_in_any_world_of_a_thousand_seeds_with_workers_elsewhere)
{
    run_worlds(true);
}

static void submit_key(int key)
{
    double data[2] = { 3.25, key };
    char header[200];

    w->asked[++w->request & 4095].key = key;
    w->asked[w->request & 4095].user = 0;
    snprintf(header, sizeof header,
             "{\"id\":%d,\"kind\":\"identify\",\"key\":\"k%d\",\"input\":{\"content\":\"batch\","
             "\"samples\":2,\"channels\":1,\"dt\":1}}",
             (int)(w->request & 4095), key);
    request(0, "SUBMIT", header, data, sizeof data);
    commit_some(100);
}

/* Retention is of a day here: within it the key says `expired`, after a restart too; past it the
 * key is free, and its job another. */
TEST(a_tombstone_goes_at_its_age_from_memory_and_ledger)
{
    char first[9];

    open_world(2385, false, false);
    submit_key(3);
    submit_key(4);
    settle();
    copy(first, sizeof first, w->acked[0][3]);
    CHECK(first[0] != 0);
    request(0, "DELETE", "{\"id\":\"d\",\"job\":\"key:k4\"}", NULL, 0);
    request(0, "DELETE", "{\"id\":\"d\",\"job\":\"key:k3\"}", NULL, 0);
    commit_some(100);
    CHECK(w->stone_count == 2);
    restart();
    submit_key(3);
    CHECK(w->expired[0][3]);
    w->now.mono_ns += 86420 * SECOND;
    w->now.utc_ns += 86420 * SECOND;
    run_step((struct event) { .type = EVENT_TIME });
    commit_some(100);
    CHECK(w->stone_count == 0);
    w->expired[0][3] = false;
    w->acked[0][3][0] = 0;
    submit_key(3);
    CHECK(w->acked[0][3][0] != 0 && strcmp(w->acked[0][3], first) != 0);
    settle();
    CHECK(row_by_id(ident_number(w->settings.secret, first)) == NULL);
    CHECK(w->violations[1] + w->violations[2] + w->violations[3] + w->violations[4] == 0);
    close_world();
}

static void wait_ns(int64_t ns)
{
    w->now.mono_ns += ns;
    run_step((struct event) { .type = EVENT_TIME });
}

/* The lease of a worker elsewhere is 3 s, whatever longer one those of this host have. */
TEST(a_worker_elsewhere_is_lost_when_it_was_silent_for_three_seconds_and_not_before)
{
    open_world(2385, false, true);
    w->remotes[0].peer = ++w->last_peer;
    remote_says(0, "JOIN", "{\"version\":\"" MODALD_VERSION "\",\"name\":\"n\",\"node\":\"x\","
                "\"memory_bytes\":8}", NULL);
    remote_says(0, "READY", "{}", NULL);
    CHECK(w->remotes[0].joined);
    wait_ns(2 * SECOND);
    remote_says(0, "BEAT", "{}", NULL);
    wait_ns(3 * SECOND - 1);
    CHECK(!w->remotes[0].stopped);
    wait_ns(1);
    CHECK(w->remotes[0].stopped);
    close_world();
}

static uint64_t turn_of_begin(uint64_t peer, int user)
{
    static char header[] = "{\"id\":1,\"op\":\"begin\",\"content\":\"batch\",\"samples\":3,"
                           "\"channels\":1,\"dt\":1}";
    struct wire_frame frames[3] = {
        { WIRE_VERSION, 7 }, { "UPLOAD", 6 }, { header, strlen(header) }
    };
    struct task **last = w->tasks_end;
    struct wire_message m;

    CHECK(wire_open(frames, 3, WIRE_VERSION, true, &m, NULL) == MODAL_OK);
    run_step((struct event) { .type = EVENT_REQUEST, .peer = peer, .message = &m,
                              .key = user == 0 ? "" : "second", .verb = m.verb, .id = m.id });
    wire_close(&m);
    CHECK(*last != NULL && (*last)->type == TASK_BEGIN);
    return (*last)->fair.turn;
}

/* User 0 comes without keys. */
TEST(tasks_of_a_user_have_one_turn_and_without_keys_those_of_a_connection)
{
    uint64_t one, other;

    open_world(2385, false, false);
    one = turn_of_begin(11, 1);
    CHECK(one != TURN_NOBODY && turn_of_begin(12, 1) == one);
    other = turn_of_begin(21, 0);
    CHECK(other != TURN_NOBODY && other != one);
    CHECK(turn_of_begin(22, 0) != other && turn_of_begin(21, 0) == other);
    close_world();
}

/* 12 jobs, of each of which 2000 subscriptions are told when it has a row; a step is 1 ms. */
TEST(a_step_tells_a_bounded_number_of_events_and_all_are_told_to_all)
{
    enum { SUBSCRIPTIONS = 2000, JOBS = 12 };
    char header[120];

    open_world(2385, false, false);
    for (int i = 0; i < SUBSCRIPTIONS; i++)
        request(i % 2, "EVENTS", "{\"id\":\"e\",\"op\":\"subscribe\"}", NULL, 0);
    for (int i = 0; i < JOBS; i++) {
        double data[2] = { 3.25, i };
        snprintf(header, sizeof header,
                 "{\"id\":\"s\",\"kind\":\"identify\",\"not_before\":3e9,\"input\":{\"content\":"
                 "\"batch\",\"samples\":2,\"channels\":1,\"dt\":1}}");
        request(1, "SUBMIT", header, data, sizeof data);
    }
    commit_some(100);
    while (core_next_ns(w->core) == 0)
        run_step((struct event) { .type = EVENT_TIME });
    CHECK(w->events == JOBS * SUBSCRIPTIONS / 2);
    CHECK(w->events_most <= 256);
    close_world();
}

/* Identifiers are a bijection: 10,000 numbers give 10,000 texts, each its own number again. */
TEST(an_identifier_gives_its_number_back_and_others_give_none)
{
    char text[9], before[9] = "";

    for (int64_t number = 1; number < 10000; number++) {
        ident_text(text, 77, number);
        CHECK(ident_number(77, text) == number);
        CHECK(strcmp(text, before) != 0);
        strcpy(before, text);
    }
    CHECK(ident_number(77, "") == -1 && ident_number(77, "0000000") == -1 &&
          ident_number(77, "0000000I") == -1);
    CHECK(ident_number(77, "key:abcd9") == -1);
}
