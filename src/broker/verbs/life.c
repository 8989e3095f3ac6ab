/* life.c - the beginning of a core, the taking over of a ledger's rows, and the end */
#include "base/sha256.h"
#include "broker/core/inputs.h"
#include "broker/core/jobs.h"
#include "broker/verbs/verbs.h"
#include "job/job.h"
#include <stdlib.h>
#include <string.h>

struct core *core_new(const struct settings *settings, struct moment now)
{
    struct core *c = grab(sizeof *c);

    c->settings = *settings;
    c->now = now;
    c->counts.started_ns = now.mono_ns;
    jobs_init(c);
    inputs_init(c);
    slots_init(c);
    events_init(c);
    users_configure(c);
    core_timer(c, now.mono_ns + HOUSEKEEPING_S * SECOND, TIMER_HOUSEKEEPING, 0, 0);
    return c;
}

static enum modal_status load_input(void *context, const struct input_record *r)
{
    struct core *c = context;
    struct input *input = input_load(c, r);

    input_number_past(c, r->id);
    if (input->state == INPUT_OPEN)
        upload_load(input, r);
    return MODAL_OK;
}

static void load_failure(struct job *job, const struct job_record *r)
{
    if (r->error_code == NULL)
        return;
    job->failure = grab(sizeof *job->failure);
    job->failure->status = modal_status_from_code(r->error_code);
    job->failure->message = grab_text(r->error_message != NULL ? r->error_message : "");
    job->failure->field = grab_text(r->error_field);
    job->failure->detail = grab_text(r->error_detail);
}

/* What the broker keeps in a job's tag. */
static void load_tag(struct job *job, const char *tag)
{
    cJSON *object = NULL;
    const char *settings = NULL, *source = NULL;

    if (tag == NULL || json_read(tag, strlen(tag), &object, NULL) != MODAL_OK)
        return;
    json_get_int(object, "", "max_attempts", 1, WIRE_ATTEMPTS_MOST, &job->max_attempts, NULL);
    json_get_bool(object, "", "hidden", &job->hidden, NULL);
    if (json_get_string(object, "", "settings", &settings, NULL) == MODAL_OK && settings != NULL)
        sha256_from_hex(settings, job->settings);
    if (json_get_string(object, "", "source", &source, NULL) == MODAL_OK && source != NULL)
        job->source = strtoll(source, NULL, 10);
    cJSON_Delete(object);
}

/* What the row says, as it says it. */
static struct job *job_of_row(struct core *c, const struct job_record *r)
{
    struct job *job = job_new(c, user_get(c, r->user), r->id);
    const struct job_kind *kind = job_kind_find(r->kind);

    job->key = region_text(&c->region, r->key);
    job->kind = kind != NULL ? kind->name : arena_text(&c->jobs->kinds, r->kind);
    job->kind_row = kind != NULL ? (int8_t)(kind - job_kinds) : -1;
    job->options = !job_state_final(r->state) || r->state == JOB_DEAD
                       ? region_text(&c->region, r->options)
                       : NULL;
    memcpy(job->fingerprint, r->fingerprint, 32);
    job->priority = r->priority;
    job->run_limit_ns = r->run_limit_ns;
    job->deadline_ns = r->deadline_ns;
    job->not_before_ns = r->not_before_ns;
    job->state = job->shown = r->state;
    job->attempts = job->shown_attempts = r->attempts;
    job->crashes = r->crashes;
    job->submitted_ns = r->submitted_ns;
    job->started_ns = r->started_ns;
    job->finished_ns = r->finished_ns;
    job->cpu_ns = r->cpu_ns;
    job->result_bytes = r->result_bytes;
    job->cached = r->cached;
    job->committed = true;
    load_failure(job, r);
    load_tag(job, r->tag);
    return job;
}

/* Its input, and the signals it made. */
static void load_inputs(struct core *c, struct job *job, const struct job_record *r)
{
    input_number_past(c, r->input);                /* an input that may have gone since */
    job->input = input_by_id(c, r->input);
    job->output = r->output == 0 ? NULL : input_by_id(c, r->output);
    if (job->input != NULL)
        job->input->jobs++;
    if (job->output != NULL && !job->cached)
        job->output->jobs++;
}

static void count_loaded(struct core *c, struct job *job)
{
    c->jobs->state_counts[job->state]++;
    job_count(c, job, 1);
    job_count_queued(job, job->state == JOB_QUEUED);
    job->user->running += job->state == JOB_RUNNING;
    if (job->state != JOB_DONE || job->cached)
        return;
    c->jobs->result_total += (int64_t)job->result_bytes;
    job->user->bytes += (int64_t)job->result_bytes;
    if (!job->hidden)
        job_index_result(c, job);
}

static enum modal_status load_job(void *context, const struct job_record *r)
{
    struct core *c = context;
    struct job *job = job_of_row(c, r);

    if (r->id >= c->jobs->next_job)
        c->jobs->next_job = r->id + 1;
    load_inputs(c, job, r);
    if (job->hidden) {                             /* its key has a tombstone */
        region_drop(job->key);
        job->key = NULL;
    }
    job_index(c, job);
    count_loaded(c, job);
    if (job_state_final(job->state))
        job_note_end(c, job);
    return MODAL_OK;
}

/* A number that was a job's is never another's: somebody may still have its identifier. */
static void load_number(struct core *c, int64_t job)
{
    if (job >= c->jobs->next_job)
        c->jobs->next_job = job + 1;
}

static enum modal_status load_tombstone(void *context, const struct tombstone_record *r)
{
    struct core *c = context;

    struct user *user = user_get(c, r->user);

    user_bury(user, r->key, r->fingerprint, r->expired_ns);
    user_tombstone(user, r->key)->committed = true;
    load_number(c, r->job);
    return MODAL_OK;
}

static enum modal_status load_note(void *context, const struct note_record *r)
{
    struct core *c = context;

    if (strcmp(r->topic, "upload") == 0)
        upload_load_note(c, r);
    if (strcmp(r->topic, "stream") == 0)
        stream_load_note(c, r);
    if (strcmp(r->topic, "sealed") == 0)
        stream_load_sealed(c, r);
    if (strcmp(r->topic, "tracks") == 0)
        window_load_tracks(c, r);
    if (strcmp(r->topic, "window") == 0)
        window_load_told(c, r);
    if (strcmp(r->topic, "verdict") == 0)
        window_load_verdict(c, r);
    if (strcmp(r->topic, "cpu") == 0)
        user_load_note(c, r);
    if (strcmp(r->topic, "daemon") == 0 && strcmp(r->name, "draining") == 0)
        c->draining = true;
    return MODAL_OK;
}

static enum modal_status load_event(void *context, const struct event_record *r)
{
    struct core *c = context;

    if (r->number >= c->next_event)
        c->next_event = r->number + 1;
    c->last_event = c->next_event - 1;
    load_number(c, r->job);
    return MODAL_OK;
}

static enum modal_status load_segment(void *context, const struct segment_record *r)
{
    stream_load_segment(context, r);
    return MODAL_OK;
}

void core_visitor(struct core *core, struct ledger_visitor *out)
{
    *out = (struct ledger_visitor) {
        .context = core, .input = load_input, .job = load_job, .tombstone = load_tombstone,
        .note = load_note, .segment = load_segment, .event = load_event };
}

bool core_has_file(const struct core *c, enum spool_file what, int64_t id)
{
    const struct input *input = what == SPOOL_RESULT ? NULL : input_by_id(c, id);
    const struct job *job = what == SPOOL_RESULT ? job_by_id(c, id) : NULL;

    if (what == SPOOL_SAMPLES)
        return stream_is_open(c, id);
    if (what == SPOOL_RESULT)
        return job != NULL && job->state == JOB_DONE
            && job->result_bytes > LEDGER_RESULT_INLINE_MOST;
    return input != NULL && !input->inline_data
        && (what == SPOOL_SEALED || input->state == INPUT_OPEN);
}

struct actions *core_loaded(struct core *c, struct moment now)
{
    size_t at = 0;
    struct job *job;

    c->out.count = 0;
    c->now = now;
    c->counts.replay_s = (double)(now.mono_ns - c->counts.started_ns) / 1e9;
    while ((job = map_next(&c->jobs->all, &at)) != NULL) {
        struct job *root = job->source == 0 ? NULL : job_by_id(c, job->source);
        if (root != NULL)
            root->shares++;
        if (job->state == JOB_RUNNING)             /* its worker ended with the daemon before */
            job_move(c, job, JOB_QUEUED, NULL);
        job_watch(c, job);
    }
    tombstones_sort(c);
    uploads_go_on(c);
    windows_recall(c);
    core_log(c, "level=notice event=replay jobs=%zu inputs=%zu queued=%lld", c->jobs->all.count,
             c->inputs->all.count, (long long)c->jobs->state_counts[JOB_QUEUED]);
    workers_fill(c);
    return &c->out;
}

void core_free(struct core *c)
{
    streams_done(c);
    jobs_done(c);
    inputs_done(c);                                /* they leave their users' tables */
    events_done(c);
    users_done(c);
    slots_done(c);
    while (c->answers != NULL)
        answers_free(c->answers);
    heap_done(&c->timers);
    shares_done(&c->behind);
    spell_done(&c->spell);
    region_close(&c->region);
    free(c->out.items);
    free(c);
}
