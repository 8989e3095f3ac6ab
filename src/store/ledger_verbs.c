/* ledger_verbs.c - see ledger_verbs.h */
#include "store/ledger_verbs.h"
#include <stdlib.h>
#include "store/ledger_db.h"

const char *const job_states[JOB_STATE_COUNT] = { "queued", "running",   "done",
                                                  "failed", "cancelled", "dead" };

/* A lost worker, or a drain, puts a running job back; `retry` puts a failed or dead one back; a job
 * found cached, expired in the queue or cancelled there is final without having run.  A move to the
 * same state updates the rest of the row. */
const bool ledger_moves[JOB_STATE_COUNT][JOB_STATE_COUNT] = {
    [JOB_QUEUED]  = { [JOB_QUEUED] = true, [JOB_RUNNING] = true, [JOB_DONE] = true,
                      [JOB_FAILED] = true, [JOB_CANCELLED] = true, [JOB_DEAD] = true },
    [JOB_RUNNING] = { [JOB_QUEUED] = true, [JOB_RUNNING] = true, [JOB_DONE] = true,
                      [JOB_FAILED] = true, [JOB_CANCELLED] = true, [JOB_DEAD] = true },
    [JOB_FAILED]  = { [JOB_QUEUED] = true },
    [JOB_DEAD]    = { [JOB_QUEUED] = true },
};

bool job_state_final(enum job_state state)
{
    return state != JOB_QUEUED && state != JOB_RUNNING;
}

static void bind_int(struct ledger_binder *to, int64_t value)
{
    sqlite3_bind_int64(to->statement, to->next++, value);
}

static void bind_real(struct ledger_binder *to, double value)
{
    sqlite3_bind_double(to->statement, to->next++, value);
}

static void bind_text(struct ledger_binder *to, const char *text)
{
    if (text != NULL)
        sqlite3_bind_text(to->statement, to->next, text, -1, SQLITE_STATIC);
    to->next++;
}

static void bind_blob(struct ledger_binder *to, const void *data, size_t length)
{
    if (data != NULL)
        sqlite3_bind_blob64(to->statement, to->next, length > 0 ? data : "", length, SQLITE_STATIC);
    to->next++;
}

static enum modal_status bind_input(struct ledger_binder *to, const struct ledger_change *change,
                                    struct modal_error *err)
{
    const struct input_record *input = &change->input;
    const struct input_shape *shape = &input->shape;
    char *names = NULL;
    enum modal_status rc = ledger_names_text(shape, &names, err);

    if (rc != MODAL_OK)
        return rc;
    bind_int(to, input->id);
    bind_text(to, input->user);
    bind_int(to, input->state);
    bind_int(to, shape->type);
    bind_int(to, (int64_t)shape->samples);
    bind_int(to, (int64_t)shape->channels);
    bind_int(to, (int64_t)shape->length);
    bind_real(to, shape->dt);
    bind_real(to, shape->period);
    bind_text(to, shape->units);
    sqlite3_bind_text(to->statement, to->next++, names, -1, SQLITE_TRANSIENT);
    bind_text(to, shape->attributes);
    bind_blob(to, input->sha256, 32);
    bind_int(to, input->crc);
    bind_int(to, input->inline_data);
    bind_int(to, (int64_t)input->offset);
    bind_int(to, input->created_ns);
    bind_int(to, input->used_ns);
    bind_blob(to, input->inline_data ? input->data : NULL, input_bytes(shape));
    free(names);
    return MODAL_OK;
}

static enum modal_status bind_used(struct ledger_binder *to, const struct ledger_change *change,
                                   struct modal_error *err)
{
    (void)err;
    bind_int(to, change->input.id);
    bind_int(to, change->input.used_ns);
    return MODAL_OK;
}

static enum modal_status bind_id(struct ledger_binder *to, const struct ledger_change *change,
                                 struct modal_error *err)
{
    (void)err;
    bind_int(to, change->id);
    return MODAL_OK;
}

static enum modal_status bind_chunk(struct ledger_binder *to, const struct ledger_change *change,
                                    struct modal_error *err)
{
    (void)err;
    bind_int(to, change->input_id);
    bind_int(to, (int64_t)change->chunk.offset);
    bind_int(to, (int64_t)change->chunk.length);
    bind_int(to, change->chunk.crc);
    return MODAL_OK;
}

static enum modal_status bind_segment(struct ledger_binder *to, const struct ledger_change *change,
                                      struct modal_error *err)
{
    const struct segment_record *segment = &change->segment;

    (void)err;
    bind_int(to, segment->stream);
    bind_int(to, (int64_t)segment->offset);
    bind_int(to, (int64_t)segment->epoch);
    bind_int(to, (int64_t)segment->first);
    bind_int(to, (int64_t)segment->count);
    bind_int(to, (int64_t)segment->length);
    bind_int(to, segment->crc);
    return MODAL_OK;
}

/* What a move changes, in the order of the columns from `state` on. */
static void bind_progress(struct ledger_binder *to, const struct job_record *job)
{
    bind_int(to, job->state);
    bind_int(to, job->attempts);
    bind_int(to, job->crashes);
    bind_int(to, job->submitted_ns);
    bind_int(to, job->started_ns);
    bind_int(to, job->finished_ns);
    bind_int(to, job->cpu_ns);
    bind_text(to, job->error_code);
    bind_text(to, job->error_message);
    bind_text(to, job->error_field);
    bind_text(to, job->error_detail);
    bind_int(to, (int64_t)job->result_bytes);
    bind_int(to, job->output);
    bind_int(to, job->cached);
    bind_text(to, job->stderr_text);
}

static enum modal_status bind_job(struct ledger_binder *to, const struct ledger_change *change,
                                  struct modal_error *err)
{
    const struct job_record *job = &change->job;

    (void)err;
    bind_int(to, job->id);
    bind_text(to, job->user);
    bind_text(to, job->key);
    bind_text(to, job->kind);
    bind_text(to, job->options);
    bind_int(to, job->input);
    bind_blob(to, job->fingerprint, 32);
    bind_int(to, job->priority);
    bind_int(to, job->run_limit_ns);
    bind_int(to, job->deadline_ns);
    bind_int(to, job->not_before_ns);
    bind_text(to, job->tag);
    bind_progress(to, job);
    return MODAL_OK;
}

/* The states JOB may come from, as bits. */
static int64_t sources(enum job_state to)
{
    int64_t bits = 0;

    for (int from = 0; from < JOB_STATE_COUNT; from++)
        if (ledger_moves[from][to])
            bits |= (int64_t)1 << from;
    return bits;
}

static enum modal_status bind_move(struct ledger_binder *to, const struct ledger_change *change,
                                   struct modal_error *err)
{
    const struct job_record *job = &change->job;

    if (job->state < 0 || job->state >= JOB_STATE_COUNT)
        return modal_fail(err, MODAL_INTERNAL, "ledger: job %lld has no state %d",
                          (long long)job->id, (int)job->state);
    bind_int(to, job->id);
    bind_int(to, sources(job->state));
    bind_progress(to, job);
    return MODAL_OK;
}

static enum modal_status bind_limits(struct ledger_binder *to, const struct ledger_change *change,
                                     struct modal_error *err)
{
    const struct job_record *job = &change->job;

    (void)err;
    bind_int(to, job->id);
    bind_int(to, job->priority);
    bind_int(to, job->run_limit_ns);
    bind_int(to, job->deadline_ns);
    bind_int(to, job->not_before_ns);
    bind_text(to, job->tag);
    return MODAL_OK;
}

static enum modal_status bind_result(struct ledger_binder *to, const struct ledger_change *change,
                                     struct modal_error *err)
{
    const struct result_record *result = &change->result;

    (void)err;
    bind_int(to, result->job);
    bind_int(to, (int64_t)result->length);
    bind_int(to, result->crc);
    bind_blob(to, result->input, 32);
    bind_blob(to, result->settings, 32);
    bind_blob(to, result->text, result->length);
    return MODAL_OK;
}

static enum modal_status bind_tombstone(struct ledger_binder *to,
                                        const struct ledger_change *change,
                                        struct modal_error *err)
{
    const struct tombstone_record *tombstone = &change->tombstone;

    (void)err;
    bind_text(to, tombstone->user);
    bind_text(to, tombstone->key);
    bind_int(to, tombstone->job);
    bind_blob(to, tombstone->fingerprint, 32);
    bind_int(to, tombstone->expired_ns);
    return MODAL_OK;
}

static enum modal_status bind_key(struct ledger_binder *to, const struct ledger_change *change,
                                  struct modal_error *err)
{
    (void)err;
    bind_text(to, change->tombstone.user);
    bind_text(to, change->tombstone.key);
    return MODAL_OK;
}

static enum modal_status bind_event(struct ledger_binder *to, const struct ledger_change *change,
                                    struct modal_error *err)
{
    const struct event_record *event = &change->event;

    (void)err;
    bind_int(to, event->number);
    bind_int(to, event->ns);
    bind_int(to, event->job);
    bind_text(to, event->user);
    bind_text(to, event->topic);
    bind_text(to, event->text);
    return MODAL_OK;
}

static enum modal_status bind_note(struct ledger_binder *to, const struct ledger_change *change,
                                   struct modal_error *err)
{
    (void)err;
    bind_text(to, change->note.topic);
    bind_text(to, change->note.name);
    bind_text(to, change->note.text);
    return MODAL_OK;
}

const struct ledger_verb_sql ledger_verbs[LEDGER_VERB_COUNT] = {
    [LEDGER_INPUT_PUT] = {
        { "INSERT OR REPLACE INTO inputs VALUES(?1,?2,?3,?4,?5,?6,?7,?8,?9,?10,?11,?12,?13,?14,?15,"
          "?16,?17,?18,?19)" }, bind_input, true },
    [LEDGER_INPUT_USED] = { { "UPDATE inputs SET used=?2 WHERE id=?1" }, bind_used, true },
    [LEDGER_INPUT_DELETE] = {
        { "DELETE FROM chunks WHERE input=?1",
          "DELETE FROM inputs WHERE id=?1" }, bind_id, true, true },
    [LEDGER_CHUNK_PUT] = {
        { "INSERT OR REPLACE INTO chunks VALUES(?1,?2,?3,?4)" }, bind_chunk, true },
    [LEDGER_SEGMENT_PUT] = {
        { "INSERT INTO segments VALUES(?1,?2,?3,?4,?5,?6,?7)" }, bind_segment, true },
    [LEDGER_SEGMENT_ROW] = {
        { "INSERT OR IGNORE INTO segments SELECT ?1,?2,?3,?4,?5,?6,?7 WHERE EXISTS"
          " (SELECT 1 FROM notes WHERE topic='stream' AND name=CAST(?1 AS TEXT))" },
        bind_segment, false },
    [LEDGER_SAMPLES_SETTLE] = { { NULL }, NULL, false },
    [LEDGER_SEGMENTS_DELETE] = { { "DELETE FROM segments WHERE stream=?1" }, bind_id, false, true },
    [LEDGER_JOB_PUT] = {
        { "INSERT INTO jobs VALUES(?1,?2,?3,?4,?5,?6,?7,?8,?9,?10,?11,?12,?13,?14,?15,?16,?17,?18,"
          "?19,?20,?21,?22,?23,?24,?25,?26,?27)" }, bind_job, true },
    [LEDGER_JOB_MOVE] = {
        { "UPDATE jobs SET state=?3, attempts=?4, crashes=?5, submitted=?6, started=?7,"
          " finished=?8, cpu=?9, error_code=?10, error_message=?11, error_field=?12,"
          " error_detail=?13, result_bytes=?14, output=?15, cached=?16, stderr=?17"
          " WHERE id=?1 AND (1 << state) & ?2" }, bind_move, true },
    [LEDGER_JOB_LIMITS] = {
        { "UPDATE jobs SET priority=?2, run_limit=?3, deadline=?4, not_before=?5, tag=?6"
          " WHERE id=?1" }, bind_limits, true },
    [LEDGER_JOB_DELETE] = {
        { "DELETE FROM results WHERE job=?1",
          "DELETE FROM jobs WHERE id=?1" }, bind_id, true, true },
    [LEDGER_RESULT_PUT] = {
        { "INSERT OR REPLACE INTO results VALUES(?1,?2,?3,?4,?5,?6)" }, bind_result, true },
    [LEDGER_TOMBSTONE_PUT] = {
        { "INSERT OR REPLACE INTO tombstones VALUES(?1,?2,?3,?4,?5)" }, bind_tombstone, true },
    [LEDGER_TOMBSTONES_PRUNE] = {
        { "DELETE FROM tombstones WHERE expired<?1" }, bind_id, false, true },
    [LEDGER_TOMBSTONE_DROP] = {
        { "DELETE FROM tombstones WHERE user=?1 AND key=?2" }, bind_key, false, true },
    [LEDGER_EVENT_PUT] = { { "INSERT INTO events VALUES(?1,?2,?3,?4,?5,?6)" }, bind_event, true },
    [LEDGER_EVENTS_PRUNE] = { { "DELETE FROM events WHERE number<?1" }, bind_id, false, true },
    [LEDGER_NOTE_PUT] = {
        { "DELETE FROM notes WHERE topic=?1 AND name=?2 AND ?3 IS NULL",
          "INSERT INTO notes SELECT ?1,?2,?3 WHERE ?3 IS NOT NULL"
          " ON CONFLICT DO UPDATE SET text=excluded.text" }, bind_note, false },
};
