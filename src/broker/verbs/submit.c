/* submit.c - SUBMIT: the same key again, a cached answer, or a new job */
#include "base/crc32c.h"
#include "base/sha256.h"
#include "broker/core/inputs.h"
#include "broker/core/jobs.h"
#include "broker/verbs/verbs.h"
#include "job/job.h"
#include "wire/frame.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- what makes two submissions the same ----------------------------------------------------- */

/* settings = SHA-256(kind, options).  Scripts ask the same of many inputs: the latest
 * is remembered. */
static void hash_settings(struct core *c, const char *kind, const char *options,
                          uint8_t settings[32])
{
    size_t n_kind = strlen(kind);
    char *text = c->jobs->asked.text;

    if (text == NULL || strncmp(text, kind, n_kind) != 0 || text[n_kind] != '\n'
        || strcmp(text + n_kind + 1, options) != 0) {
        free(text);
        text = c->jobs->asked.text = grab_format("%s\n%s", kind, options);
        sha256_of(text, strlen(text), c->jobs->asked.settings);
    }
    memcpy(settings, c->jobs->asked.settings, 32);
}

/* fingerprint = SHA-256(settings, content of the input) */
static void hash_both(const uint8_t settings[32], const uint8_t content[32],
                      uint8_t fingerprint[32])
{
    uint8_t both[64];

    memcpy(both, settings, 32);
    memcpy(both + 32, content, 32);
    sha256_of(both, sizeof both, fingerprint);
}

/* ---- a submission under way ------------------------------------------------------------------ */

struct submission {
    struct user *user;
    struct reply reply;
    const struct wire_request *r;
    const struct job_kind *kind;
    struct input *input;             /* NULL: new, in `data` */
    struct blob *data;
    uint8_t sha256[32];              /* of `data` */
    uint8_t content[32], settings[32], fingerprint[32];
    char *options;
};

static bool find_kind(struct core *c, struct submission *s)
{
    char list[NEAR_ACCEPTED];

    s->kind = job_kind_find(s->r->submit.kind);
    if (s->kind != NULL)
        return true;
    job_kinds_accepted(s->r->submit.kind, list);
    answer_fail(c, &s->reply, MODAL_BAD_INPUT, "kind", NULL, "unknown kind \"%.40s\"%s",
                s->r->submit.kind, list);
    return false;
}

/* The input the request names, sealed and the caller's own. */
static bool find_named(struct core *c, struct submission *s)
{
    uint8_t hash[32];

    if (s->r->submit.sha256 != NULL && sha256_from_hex(s->r->submit.sha256, hash))
        s->input = input_of_identity(s->user, hash);
    if (s->r->submit.upload != NULL)
        s->input = input_by_id(c, ident_number(~c->settings.secret, s->r->submit.upload));
    if (s->input == NULL || s->input->user != s->user || s->input->going || !s->input->committed) {
        s->input = NULL;
        answer_fail(c, &s->reply, MODAL_NOT_FOUND, "input", NULL, "no such input of yours");
        return false;
    }
    if (s->input->state != INPUT_SEALED) {
        answer_fail(c, &s->reply, MODAL_CONFLICT, "input.upload", NULL,
                    "the upload is not sealed yet");
        return false;
    }
    memcpy(s->content, s->input->content, 32);
    return true;
}

/* A copy of the body: a small frame is a part of libzmq's buffer of 8 kB, which would stay
 * with it. */
static struct blob *gather(const struct wire_message *m)
{
    char *all = grab(m->body_bytes + 1);
    struct blob *data;

    wire_gather(m, all, m->body_bytes);
    data = blob_take(all, m->body_bytes);
    if (data == NULL)
        abort();
    return data;
}

static void read_inline(struct submission *s, const struct wire_message *m)
{
    const struct wire_input *w = &s->r->submit.input;
    struct input_shape shape;
    const char **names;

    s->data = gather(m);
    input_shape_of(w, &shape, &names);
    identity_of(&shape, s->data->data, s->data->size, s->sha256);
    free(names);
    input_content(s->sha256, w->attributes, s->content);
    s->input = input_sealed(s->user, s->content);
    if (s->input != NULL && s->input->going)
        s->input = NULL;
}

/* Whether JOB is what S asks for.  Fingerprints of folders of before attributes were part of them
 * are not, so what they stand for decides. */
static bool same_job(const struct job *job, const struct submission *s)
{
    return memcmp(job->fingerprint, s->fingerprint, 32) == 0
           || (job->input != NULL && memcmp(job->settings, s->settings, 32) == 0
               && memcmp(job->input->content, s->content, 32) == 0);
}

/* A job, or what is left of one, that already has the key; true: answered. */
static bool known_key(struct core *c, struct submission *s)
{
    struct job *job;

    if (s->r->submit.key == NULL)
        return false;
    if (answer_expired(c, &s->reply, user_tombstone(s->user, s->r->submit.key)))
        return true;
    job = job_find(c, s->user, &(struct wire_job) { .key = s->r->submit.key });
    if (job == NULL)
        return false;
    if (!same_job(job, s))
        answer_fail(c, &s->reply, MODAL_CONFLICT, "key", NULL,
                    "the key names a job of other kind, options or input");
    else if (!job->committed) {
        struct after *after = after_new(AFTER_REPEAT, &s->reply);
        after->job = job;
        transaction_join(job->last, after);
    } else
        answer_doc(c, &s->reply, job, true, NULL);
    return true;
}

/* Whether there is room for one job more; false: answered. */
static bool may_enter(struct core *c, struct submission *s)
{
    int64_t most = c->settings.queue_jobs;

    if (c->draining || c->terminating)
        answer_fail(c, &s->reply, MODAL_DRAINING, "", answer_number("retry_after_s", 5),
                    "the daemon takes no new work");
    else if (room_is_full(c))
        answer_fail(c, &s->reply, MODAL_STORAGE_FULL, "", answer_number("retry_after_s", 5),
                    "the disk is full");
    else if (c->jobs->state_counts[JOB_QUEUED] >= most)
        answer_fail(c, &s->reply, MODAL_BUSY, "", answer_number("retry_after_s", 1),
                    "the queue holds %lld jobs, at most %lld",
                    (long long)c->jobs->state_counts[JOB_QUEUED], (long long)most);
    else
        return !user_quota(c, s->user, &s->reply, 1, s->input == NULL ? (int64_t)s->data->size : 0)
            && (s->input != NULL || upload_allows(c, s->user, s->data->size, &s->reply));
    return false;
}

static void put_job_row(struct transaction *t, const struct job *job, const struct input *input)
{
    struct job_record *row = &transaction_add(t, LEDGER_JOB_PUT)->job;
    struct json_text tag = { 0 };
    char hex[65], source[24];

    sha256_hex(job->settings, hex);
    snprintf(source, sizeof source, "%lld", (long long)job->source);
    json_text_open(&tag, NULL);
    json_text_number(&tag, "max_attempts", job->max_attempts);
    json_text_string(&tag, "settings", hex);
    if (job->source != 0)
        json_text_string(&tag, "source", source);
    json_text_close(&tag);
    *row = (struct job_record) {
        .id = job->id, .user = transaction_text(t, job->user->name),
        .key = transaction_text(t, job->key), .kind = job->kind,
        .options = transaction_text(t, job->options), .input = input->id,
        .priority = job->priority, .run_limit_ns = job->run_limit_ns,
        .deadline_ns = job->deadline_ns, .not_before_ns = job->not_before_ns,
        .tag = transaction_text(t, tag.x), .state = job->state, .submitted_ns = job->submitted_ns,
        .finished_ns = job->finished_ns, .result_bytes = job->result_bytes,
        .output = job->output == NULL ? 0 : job->output->id, .cached = job->cached };
    memcpy(row->fingerprint, job->fingerprint, 32);
    free(tag.x);
}

static struct job *make_job(struct core *c, struct submission *s)
{
    struct job *job = job_new(c, s->user, c->jobs->next_job++);
    const struct wire_request *r = s->r;

    job->key = region_text(&c->region, r->submit.key);
    job->kind = s->kind->name;
    job->kind_row = (int8_t)(s->kind - job_kinds);
    job->options = region_text(&c->region, s->options);
    memcpy(job->fingerprint, s->fingerprint, 32);
    memcpy(job->settings, s->settings, 32);
    job->priority = r->submit.priority;
    job->max_attempts = r->submit.max_attempts;
    job->run_limit_ns = (int64_t)(r->submit.run_limit_s * 1e9);
    job->submitted_ns = c->now.utc_ns;
    job->deadline_ns =
        r->submit.deadline_s > 0 ? c->now.utc_ns + (int64_t)(r->submit.deadline_s * 1e9) : 0;
    job->not_before_ns = (int64_t)(r->submit.not_before * 1e9);
    job_index(c, job);
    return job;
}

/* The result of SOURCE becomes this job's too. */
static void show_cached(struct core *c, struct job *job, struct job *source)
{
    struct job *root = source->source != 0 ? job_by_id(c, source->source) : source;

    job->state = JOB_DONE;
    job->cached = true;
    job->source = root->id;
    root->shares++;
    job->result_bytes = root->result_bytes;
    job->output = root->output;
    job->finished_ns = c->now.utc_ns;
}

static void enter(struct core *c, struct submission *s, struct job *source)
{
    struct transaction *t = transaction_new();
    struct job *job;
    struct after *after;

    t->refusable = FIRST_REFUSED;
    if (s->input == NULL) {
        s->input = input_new(c, s->user, &s->r->submit.input, input_number(c));
        s->input->state = INPUT_SEALED;
        input_put_inline(s->input);
        s->input->crc = crc32c(0, s->data->data, s->data->size);
        memcpy(s->input->sha256, s->sha256, 32);
        input_cache(c, s->input, s->data);
        input_index(s->input);
    }
    /* its first row may yet be refused, so every row brings it along */
    if (!s->input->committed)
        input_record_fill(s->input, t, &transaction_add(t, LEDGER_INPUT_PUT)->input);
    job = make_job(c, s);
    job->input = s->input;
    input_use(c, s->input, 1);
    if (source != NULL)
        show_cached(c, job, source);
    put_job_row(t, job, s->input);
    job_event(c, job, t, NULL, job->state);
    job->last = t;
    after = after_new(AFTER_SUBMIT, &s->reply);
    after->job = job;
    after->to = job->state;
    after->value = c->now.mono_ns;
    transaction_join(t, after);
    c->jobs->state_counts[job->state]++;
    job_count(c, job, 1);
    if (job->state == JOB_QUEUED)
        job_count_queued(job, 1);
    core_commit(c, t);
}

static void submit(struct core *c, const struct wire_message *m, const struct wire_request *r,
                   struct user *user, const struct reply *reply)
{
    struct submission s = { .user = user, .reply = *reply, .r = r };
    bool named = r->submit.upload != NULL || r->submit.sha256 != NULL;
    struct job *source;

    if (!find_kind(c, &s) || (named && !find_named(c, &s)))
        goto out;
    if (!named)
        read_inline(&s, m);
    s.options = grab_canonical(r->submit.options);
    hash_settings(c, s.kind->name, s.options, s.settings);
    hash_both(s.settings, s.content, s.fingerprint);
    if (known_key(c, &s) || !may_enter(c, &s))
        goto out;
    source = r->submit.fresh || s.input == NULL ? NULL : job_cached(c, user, s.content, s.settings);
    enter(c, &s, source);
out:
    blob_drop(s.data);
    free(s.options);
}

void submit_request(struct core *c, const struct request *q)
{
    submit(c, q->event->message, &q->wire, q->user, &q->reply);
}

/* Each part is a submission of its own, with its own transaction and answer; only the message
 * is shared. */
void submits_request(struct core *c, const struct request *q)
{
    struct reply part = { .peer = q->event->peer, .verb = WIRE_SUBMIT };
    struct blob *data = gather(q->event->message);
    const char *body = data->data;
    const cJSON *job;

    part.all = answers_new(c, &q->reply, cJSON_GetArraySize(q->wire.submits.jobs));
    cJSON_ArrayForEach(job, q->wire.submits.jobs) {
        struct wire_message m;
        struct wire_request one;
        struct modal_error err;

        wire_part(job, &body, &m);
        if (wire_request_read(&m, &one, &err) == MODAL_OK)
            submit(c, &m, &one, q->user, &part);
        else
            answer_error(c, &part, &err, NULL);
        part.place++;
    }
    blob_drop(data);
}
