/* life.c - the beginning of a core, the taking over of a ledger's rows, and the end */
#include "broker/core/state.h"
#include "job/job.h"
#include <stdlib.h>
#include <string.h>

struct core *core_new(const struct settings *settings, struct moment now)
{
    struct core *c = grab(sizeof *c);

    c->settings = *settings;
    c->now = now;
    c->started_ns = now.mono_ns;
    c->stones_end = &c->stones;
    c->next_job = c->next_input = c->next_event = c->next_wait = 1;
    users_configure(c);
    core_timer(c, now.mono_ns + HOUSEKEEPING_S * SECOND, TIMER_HOUSEKEEPING, 0, 0);
    return c;
}

static enum modal_status load_input(void *context, const struct input_record *r)
{
    struct core *c = context;
    struct input *input = input_load(c, r);

    if (r->id >= c->next_input)
        c->next_input = r->id + 1;
    if (input->state == INPUT_OPEN) {
        struct user *user = input->user;
        input->filling = filling_new(r->used_ns > r->created_ns ? r->used_ns : r->created_ns);
        input->filling->accepted = input->filling->durable = r->received;
        user->open = regrab(user->open, (size_t)(user->open_count + 1) * sizeof *user->open);
        user->open[user->open_count++] = input;
    }
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
    job->kind = kind != NULL ? kind->name : arena_text(&c->kinds, r->kind);
    job->options = !job_state_final(r->state) || r->state == JOB_DEAD ? region_text(&c->region, r->options) : NULL;
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
    if (r->input >= c->next_input)                 /* an input that has gone since */
        c->next_input = r->input + 1;
    job->input = input_by_id(c, r->input);
    job->output = r->output == 0 ? NULL : input_by_id(c, r->output);
    if (job->input != NULL)
        job->input->jobs++;
    if (job->output != NULL && !job->cached)
        job->output->jobs++;
}

static void count_loaded(struct core *c, struct job *job)
{
    c->state_counts[job->state]++;
    job->user->queued += job->state == JOB_QUEUED;
    job->user->running += job->state == JOB_RUNNING;
    if (job->state != JOB_DONE || job->cached)
        return;
    c->result_total += (int64_t)job->result_bytes;
    job->user->bytes += (int64_t)job->result_bytes;
    if (!job->hidden)
        job_index_result(c, job);
}

static enum modal_status load_job(void *context, const struct job_record *r)
{
    struct core *c = context;
    struct job *job = job_of_row(c, r);

    if (r->id >= c->next_job)
        c->next_job = r->id + 1;
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
    if (job >= c->next_job)
        c->next_job = job + 1;
}

static enum modal_status load_tombstone(void *context, const struct tombstone_record *r)
{
    struct core *c = context;

    struct user *user = user_get(c, r->user);

    user_bury(c, user, r->key, r->fingerprint, r->expired_ns);
    user_tombstone(user, r->key)->committed = true;
    load_number(c, r->job);
    return MODAL_OK;
}

static void load_upload_note(struct core *c, const struct note_record *r)
{
    struct input *input = input_by_id(c, strtoll(r->name, NULL, 10));
    cJSON *object = NULL;
    const char *key = NULL, *hash = NULL;

    if (input == NULL || input->filling == NULL || json_read(r->text, strlen(r->text), &object, NULL) != MODAL_OK)
        return;
    input->filling->aborting = cJSON_HasObjectItem(object, "output");     /* its worker is gone */
    json_get_string(object, "", "key", &key, NULL);
    json_get_string(object, "", "sha256", &hash, NULL);
    input->filling->key = grab_text(key);
    input->filling->has_declared = hash != NULL && sha256_from_hex(hash, input->filling->declared);
    cJSON_Delete(object);
}

static enum modal_status load_note(void *context, const struct note_record *r)
{
    struct core *c = context;

    if (strcmp(r->topic, "upload") == 0)
        load_upload_note(c, r);
    if (strcmp(r->topic, "stream") == 0)
        stream_load_note(c, r);
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
    *out = (struct ledger_visitor) { .context = core, .input = load_input, .job = load_job, .tombstone = load_tombstone,
                                     .note = load_note, .segment = load_segment, .event = load_event };
}

bool core_has_file(const struct core *c, enum spool_file what, int64_t id)
{
    const struct input *input = what == SPOOL_RESULT ? NULL : input_by_id(c, id);
    const struct job *job = what == SPOOL_RESULT ? job_by_id(c, id) : NULL;

    if (what == SPOOL_SAMPLES)
        return stream_is_open(c, id);
    if (what == SPOOL_RESULT)
        return job != NULL && job->state == JOB_DONE && job->result_bytes > LEDGER_RESULT_INLINE_MOST;
    return input != NULL && !input->inline_data && (what == SPOOL_SEALED || input->state == INPUT_OPEN);
}

struct actions *core_loaded(struct core *c, struct moment now)
{
    size_t at = 0;
    struct job *job;
    struct input *input;

    c->out.count = 0;
    c->now = now;
    c->replay_s = (double)(now.mono_ns - c->started_ns) / 1e9;
    while ((job = map_next(&c->jobs, &at)) != NULL) {
        struct job *root = job->source == 0 ? NULL : job_by_id(c, job->source);
        if (root != NULL)
            root->shares++;
        if (job->state == JOB_RUNNING)             /* its worker ended with the daemon before */
            job_move(c, job, JOB_QUEUED, NULL);
        job_watch(c, job);
    }
    tombstones_sort(c);
    for (at = 0; (input = map_next(&c->inputs, &at)) != NULL;)
        if (input->filling != NULL && input->filling->aborting)
            upload_quiet(c, input);
    core_log(c, "level=notice event=replay jobs=%zu inputs=%zu queued=%lld", c->jobs.count, c->inputs.count, (long long)c->state_counts[JOB_QUEUED]);
    workers_fill(c);
    return &c->out;
}

static void free_user(struct user *user)
{
    struct tombstone *stone;
    size_t at = 0;

    while ((stone = map_next(&user->tombstones, &at)) != NULL) {
        free(stone->key);
        free(stone);
    }
    map_done(&user->tombstones);
    map_done(&user->keys);
    map_done(&user->inputs);
    map_done(&user->identities);
    heap_done(&user->ready);
    free(user->jobs);
    free(user->open);
    free(user);
}

static void free_job(struct job *job)
{
    while (job->waits != NULL) {
        struct wait *next = job->waits->next;
        free(job->waits);
        job->waits = next;
    }
    blob_drop(job->document);
    failure_free(job->failure);
    after_free(job->asks);
    region_drop(job->key);
    region_drop(job->options);
    free(job->progress);
    free(job->stderr_text);
    region_drop(job);
}

void core_free(struct core *c)
{
    size_t at = 0;
    struct job *job;
    struct input *input;
    struct asker *asker;

    while ((job = map_next(&c->jobs, &at)) != NULL)
        free_job(job);
    for (at = 0; (input = map_next(&c->inputs, &at)) != NULL;) {
        if (input->filling != NULL)
            upload_close(input->filling->upload);
        input_forget(c, input);
    }
    for (size_t i = 0; i < c->user_count; i++)
        free_user(c->user_list[i]);
    free(c->asked.text);
    for (int i = 0; i < RING; i++) {
        free(c->ring[i].user);
        free(c->ring[i].topic);
        free(c->ring[i].text);
    }
    while (c->streams != NULL) {
        struct stream *next = c->streams->next_stream;
        stream_free(c->streams);
        c->streams = next;
    }
    while (c->subscriptions != NULL) {
        struct subscription *next = c->subscriptions->next;
        free(c->subscriptions->stream);
        free(c->subscriptions);
        c->subscriptions = next;
    }
    while (c->answers != NULL)
        answers_free(c->answers);
    for (int i = 0; i < SLOTS_MOST; i++)
        free(c->slots[i].document);
    map_done(&c->jobs);
    map_done(&c->inputs);
    map_done(&c->users);
    map_done(&c->results);
    map_done(&c->waits);
    for (at = 0; (asker = map_next(&c->askers, &at)) != NULL;)
        free(asker);
    map_done(&c->askers);
    heap_done(&c->timers);
    region_close(&c->region);
    arena_free(c->kinds);
    free(c->user_list);
    free(c->accounts);
    free(c->ended);
    free(c->full);
    free(c->out.items);
    free(c);
}
