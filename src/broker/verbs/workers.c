/*
 * workers.c - the pool: who has which job, leases, what comes back, who dies
 *
 * A slot is a worker with one job at most: a process of ours, or one elsewhere (remotes.c).
 * Whatever a worker says is believed only with the job and attempt its slot has now.  To end an
 * attempt early its process group is killed, or it is not heard any more; the job moves when the
 * exit is seen.
 */
#include "base/crc32c.h"
#include "broker/core/jobs.h"
#include "broker/core/slots.h"
#include "broker/verbs/verbs.h"
#include "broker/verbs/window_turns.h"
#include "wire/frame.h"
#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

enum {
    DETAIL_MOST = 4096,       /* of an error's detail: it is kept with the job's row, a page */
    THREADS_MOST = 1024,      /* of the option: the machine's cores limit it further */
    DOUBLINGS_MOST = 6,       /* of a tenth of a second: 6.4 s between two starts */
};

/* ---- starting a job -------------------------------------------------------------------------- */

static void run_on(struct core *c, struct job *job, int slot, struct blob *data)
{
    cJSON *header = cJSON_CreateObject();
    char ident[IDENT_TEXT];
    int64_t limit = job->run_limit_ns > 0 ? job->run_limit_ns : c->settings.run_limit_ns;

    job_ident(c, job, ident);
    cJSON_AddStringToObject(header, "job", ident);
    cJSON_AddNumberToObject(header, "attempt", job->attempts);
    cJSON_AddStringToObject(header, "kind", job->kind);
    cJSON_AddRawToObject(header, "options", job->options);
    cJSON_AddNumberToObject(header, "run_limit_s", (double)limit / 1e9);
    input_describe_run(c, job->input, slot_is_remote(slot),
                       cJSON_AddObjectToObject(header, "input"));
    worker_send(c, slot, "RUN", header, blob_share(data));
    if (limit > 0)
        core_timer(c, c->now.mono_ns + limit, TIMER_RUN_LIMIT, job->id, job->attempts);
}

/* The input of a job whose attempt has begun; job_input_read goes on with it. */
static void fetch(struct core *c, struct job *job)
{
    struct task *task = input_fetch(job->input);

    task->total = (uint64_t)job->id;
    task->after = after_new(AFTER_READ, NULL);
    task->after->value = job->id;
    task->after->attempts = job->attempts;
    core_task(c, task, user_turn(job->user, 0));
}

static void start(struct core *c, struct job *job, int slot)
{
    struct slot *s = &c->slots->at[slot];
    struct blob *data;

    job->attempts++;
    job->slot = slot;
    slot_set(c, slot, SLOT_BUSY);
    s->job = job;
    s->attempt = job->attempts;
    s->started_ns = s->heard_ns = c->now.mono_ns;
    s->cpu_s = 0;
    s->late_told = false;
    s->expected_s = job->user->cost_s;
    s->jobs++;
    c->counts.attempts++;
    job_move(c, job, JOB_RUNNING, NULL);
    data = input_at_hand(job->input);
    if (data == NULL && (input_is_inline(job->input) || !slot_is_remote(slot))) {
        fetch(c, job);
        return;
    }
    run_on(c, job, slot, data);
    input_begun(c, job->input);
}

/* The open file of a job's input, to its worker; SLOT -1: nobody wants it any more. */
static void hand(struct core *c, const struct job *job, int slot, int descriptor)
{
    char ident[9] = "";

    if (slot >= 0)
        job_ident(c, job, ident);
    core_act(c, (struct action) { .type = ACT_HAND, .slot = slot, .descriptor = descriptor,
                                  .header = slot < 0 ? NULL
                                            : grab_format("%s %d", ident, job->attempts) });
}

/* The input that a started job was waiting for: inline data, or an open file. */
void job_input_read(struct core *c, struct task *task)
{
    struct job *job = job_by_id(c, task->after->value);

    if (job == NULL || job->state != JOB_RUNNING || job->attempts != task->after->attempts
        || job->slot < 0) {
        if (task->descriptor >= 0)
            hand(c, NULL, -1, task->descriptor);
        return;
    }
    if (task->status != MODAL_OK) {
        int slot = job->slot;
        c->slots->at[slot].job = NULL;
        slot_set(c, slot, SLOT_IDLE);
        job->slot = -1;
        job_fail(c, job, JOB_FAILED, &task->err, NULL);
        return;
    }
    if (task->descriptor >= 0)
        hand(c, job, job->slot, task->descriptor);
    run_on(c, job, job->slot, task->text);
}

/* A job to the worker of SLOT; false: none may start. */
static bool job_start(struct core *c, int slot)
{
    struct job *job = user_next(c, slot);

    if (job != NULL)
        start(c, job, slot);
    return job != NULL;
}

/* A window or a job to the idle worker of SLOT, of those in slots FROM to END; false: neither. */
static bool give(struct core *c, int slot, int from, int end)
{
    const bool first = windows_first(c, from, end);

    if (first ? window_start(c, slot) : job_start(c, slot))
        return true;
    c->slots->windows_ns = c->slots->jobs_ns = 0;          /* the others do not wait */
    return first ? job_start(c, slot) : window_start(c, slot);
}

/* To workers elsewhere, after this host's.  Where one found no window, the others find those alone
 * that they are to go on with; who has no more memory and time than one that found no job finds
 * none. */
static void schedule_remotes(struct core *c)
{
    const int end = SLOTS_MOST + c->slots->remotes;
    uint64_t memory = 0;
    int64_t end_ns = INT64_MIN;
    bool any = true;

    for (int slot = SLOTS_MOST; c->slots->remotes_idle > 0 && slot < end; slot++) {
        const struct slot *s = &c->slots->at[slot];

        if (s->state != SLOT_IDLE)
            continue;
        if (c->slots->due_count > 0 && (any || s->remote->way_told_ns != 0)
            && slot_takes_windows(c, slot)) {
            if (give(c, slot, SLOTS_MOST, end))
                continue;
            any = false;
        } else if ((s->remote->memory <= memory && s->remote->end_ns <= end_ns)
                   || job_start(c, slot))
            continue;
        if (c->jobs->state_counts[JOB_QUEUED] == 0 && c->slots->due_count == 0)
            return;
        memory = s->remote->memory;
        end_ns = s->remote->end_ns;
    }
}

void workers_schedule(struct core *c)
{
    if (c->draining || c->terminating || c->now.mono_ns < c->disk.hold_until)
        return;
    for (int slot = 0; slot < c->slots->count; slot++)
        if (c->slots->at[slot].state == SLOT_IDLE)
            give(c, slot, 0, c->slots->count);
    windows_give_ahead(c);
    schedule_remotes(c);
}

/* ---- processes ------------------------------------------------------------------------------- */

/* One lease timer a slot, as long as it has a process. */
static void watch(struct core *c, int slot, int64_t when_ns)
{
    if (c->slots->at[slot].watched)
        return;
    c->slots->at[slot].watched = true;
    core_timer(c, when_ns, TIMER_LEASE, slot, 0);
}

void worker_watch(struct core *c, int slot)
{
    watch(c, slot, c->now.mono_ns + slot_lease_ns(c, slot));
}

static void spawn(struct core *c, int slot)
{
    c->slots->at[slot].state = SLOT_STARTING;
    c->slots->at[slot].process++;
    c->slots->at[slot].jobs = 0;
    c->slots->at[slot].heard_ns = c->now.mono_ns;
    core_act(c, (struct action) { .type = ACT_SPAWN, .slot = slot });
    watch(c, slot, c->now.mono_ns + c->settings.lease_ns);
}

void workers_fill(struct core *c)
{
    int wanted = c->settings.workers < SLOTS_MOST ? c->settings.workers : SLOTS_MOST;

    if (c->terminating)
        return;
    while (c->slots->count < wanted)
        spawn(c, c->slots->count++);
    for (int slot = wanted; slot < c->slots->count; slot++)
        if (c->slots->at[slot].state == SLOT_IDLE || c->slots->at[slot].state == SLOT_STARTING)
            worker_send(c, slot, "STOP", cJSON_CreateObject(), NULL);
}

void worker_timer(struct core *c, enum timer what, int64_t number)
{
    int slot = (int)number;
    struct slot *s = &c->slots->at[slot];
    int64_t due = s->heard_ns + slot_lease_ns(c, slot);

    if (what == TIMER_SPAWN) {
        if (s->state == SLOT_EMPTY && slot < c->settings.workers && !c->terminating)
            spawn(c, slot);
        return;
    }
    if (what == TIMER_END) {
        worker_exit(c, slot, s->remote->leaving ? 0 : SIGKILL, s->remote->said);
        return;
    }
    s->watched = false;
    if (s->state == SLOT_EMPTY || s->state == SLOT_KILLED)
        return;
    if (c->now.mono_ns < due && !window_late(c, s)) {
        watch(c, slot, due);
        return;
    }
    core_log(c, "level=warning event=lease slot=%d silent_s=%.1f%s", slot, (double)(c->now.mono_ns
             - s->heard_ns) / 1e9, slot_owes_ready(s) ? " what=\"no READY\"" : "");
    c->counts.leases_lost++;
    if (s->job != NULL)
        s->job->ending = ENDING_LEASE;
    worker_kill(c, slot);
}

/* Leave the job: the slot is free for its process's next one, or for its successor. */
static void part(struct core *c, struct slot *s)
{
    if (s->output != NULL)
        output_drop(c, s->output);
    if (s->job != NULL) {
        s->job->slot = -1;
        c->slots->jobs_ns += c->now.mono_ns - s->started_ns;
    }
    free(s->document);
    s->document = NULL;
    s->document_size = s->document_total = 0;
    s->parts = 0;
    if (s->remote != NULL) {
        s->remote->pulls = 0;
        s->remote->asked = 0;
        s->remote->pull_s = 0;
    }
    s->output = NULL;
    s->finishing = s->ready = false;
    s->job = NULL;
}

/* The cores that a job may use at once: its option `threads`, of those that there are. */
static int cores_of(const struct core *c, const struct job *job)
{
    cJSON *options = cJSON_Parse(job->options);
    int threads = 1;

    json_get_int(options, "", "threads", 1, THREADS_MOST, &threads, NULL);
    cJSON_Delete(options);
    return threads < c->settings.cores ? threads : c->settings.cores;
}

/* Time is the daemon's own; of the processor's a worker is believed no more than its cores can have
 * given meanwhile.  DONE has booked what ends while its signals are sealed. */
static void account_for(struct core *c, const struct slot *s, struct job *job)
{
    double wall_s = (double)(c->now.mono_ns - s->started_ns) / 1e9, cpu_s = s->cpu_s;

    if (s->finishing)
        return;
    if (cpu_s > wall_s)
        cpu_s = fmin(cpu_s, wall_s * cores_of(c, job));
    job->cpu_ns += (int64_t)(cpu_s * 1e9);
    user_ran(c, job->user, s->expected_s, wall_s, cpu_s > 0 ? cpu_s : wall_s);
}

void worker_exit(struct core *c, int slot, int status, const char *stderr_text)
{
    struct slot *s = &c->slots->at[slot];
    struct job *job = s->job;
    int64_t again_ns = 0;

    turns_free(c, slot);
    if (s->live != NULL) {
        window_died(c, slot);
        c->counts.deaths++;
    }
    if (job != NULL) {
        enum ending ending = job->ending;
        account_for(c, s, job);
        part(c, s);
        if (ending == ENDING_NONE)
            exit_log(c, slot, status, stderr_text);
        if (ending != ENDING_FINISH)
            attempt_ended(c, job, ending, s->remote, status, stderr_text);
        s->quick_deaths = 0;
        c->counts.deaths++;
    } else {
        part(c, s);
        if (status != 0)
            s->quick_deaths++;
        int doublings = s->quick_deaths < DOUBLINGS_MOST ? s->quick_deaths : DOUBLINGS_MOST;
        again_ns = s->quick_deaths == 0 ? 0 : SECOND / 10 << doublings;
        if (s->quick_deaths > 0)
            exit_log(c, slot, status, stderr_text);
    }
    if (s->remote != NULL) {
        core_log(c, "level=notice event=worker_left slot=%d name=%s node=%s", slot,
                 s->remote->name, s->remote->node);
        slot_leave(c, slot);
        return;
    }
    s->state = SLOT_EMPTY;
    if (c->terminating)
        return;
    if (slot < c->settings.workers) {
        if (again_ns == 0)
            spawn(c, slot);
        else
            core_timer(c, c->now.mono_ns + again_ns, TIMER_SPAWN, slot, 0);
    } else if (slot == c->slots->count - 1)
        c->slots->count--;
}

/* ---- results --------------------------------------------------------------------------------- */

/* The document is stored, or small enough for the ledger: publish it. */
void job_result_put(struct core *c, struct task *task)
{
    struct job *job = job_by_id(c, task->after->value);
    struct transaction *t;
    struct result_record *row;

    if (job == NULL || job->state != JOB_RUNNING || job->attempts != task->after->attempts)
        return;
    if (task->status != MODAL_OK) {
        job_fail(c, job, JOB_FAILED, &task->err, NULL);
        return;
    }
    t = transaction_new();
    t->refusable = LAST_REFUSED;
    row = &transaction_add(t, LEDGER_RESULT_PUT)->result;
    *row = task->record;
    memcpy(row->input, input_sha256(job->input), 32);
    memcpy(row->settings, job->settings, 32);
    transaction_keep(t, task->text, task->text->size);
    job->result_bytes = task->text->size;
    document_keep(c, job, task->text);
    input_use(c, job->output, 1);
    job_move(c, job, JOB_DONE, t);
}

static void publish(struct core *c, struct job *job, struct blob *document)
{
    struct task *task = task_new(TASK_RESULT_PUT, job->id);

    task->text = document;
    task->after = after_new(AFTER_READ, NULL);
    task->after->value = job->id;
    task->after->attempts = job->attempts;
    job->ending = ENDING_FINISH;
    if (document->size <= LEDGER_RESULT_INLINE_MOST) {
        task->record = (struct result_record) {
            .job = job->id, .text = document->data, .length = document->size,
            .crc = crc32c(0, document->data, document->size) };
        job_result_put(c, task);
        task_free(task);
        return;
    }
    core_task(c, task, user_turn(job->user, 0));
}

static void make_idle(struct core *c, int slot)
{
    struct slot *s = &c->slots->at[slot];

    if (s->remote == NULL
        && (slot >= c->settings.workers
            || (c->settings.worker_jobs > 0 && s->jobs >= c->settings.worker_jobs))) {
        worker_send(c, slot, "STOP", cJSON_CreateObject(), NULL);
        return;
    }
    if (s->remote != NULL && s->remote->leaving) {
        worker_kill(c, slot);
        return;
    }
    slot_set(c, slot, SLOT_IDLE);
    s->quick_deaths = 0;
}

/* DONE has come and the signals, if any, are sealed. */
static void finish(struct core *c, int slot)
{
    struct slot *s = &c->slots->at[slot];
    struct job *job = s->job;
    struct blob *document = blob_take(s->document, s->document_size);
    bool ready = s->ready;

    s->document = NULL;
    job->output = s->output;
    s->output = NULL;
    part(c, s);
    /* until READY, which may have come while the signals were sealed */
    s->state = SLOT_TAKEN;
    s->heard_ns = c->now.mono_ns;
    if (ready || (s->remote != NULL && s->remote->leaving))
        make_idle(c, slot);
    publish(c, job, document);
}

static void fail_attempt(struct core *c, int slot, const struct modal_error *err, cJSON *detail)
{
    struct job *job = c->slots->at[slot].job;

    part(c, &c->slots->at[slot]);
    if (c->slots->at[slot].state == SLOT_BUSY)
        c->slots->at[slot].state = SLOT_TAKEN;
    job_fail(c, job, JOB_FAILED, err, detail);
}

void worker_output(struct core *c, const struct after *after)
{
    int slot = (int)after->value;
    struct slot *s = &c->slots->at[slot];

    if (s->output != after->input)
        return;
    if (after->err != NULL) {
        s->output = NULL;
        fail_attempt(c, slot, after->err, NULL);
        worker_kill(c, slot);
    } else if (s->finishing)
        finish(c, slot);
}

/* ---- what workers say ------------------------------------------------------------------------ */

static void on_ready(struct core *c, int slot, const struct wire_message *m, struct blob **body)
{
    struct slot *s = &c->slots->at[slot];

    (void)m, (void)body;
    if (s->state == SLOT_STARTING || s->state == SLOT_TAKEN)
        make_idle(c, slot);
    else
        s->ready = s->state == SLOT_BUSY && s->finishing;
}

static void on_progress(struct core *c, int slot, const struct wire_message *m, struct blob **body)
{
    struct job *job = c->slots->at[slot].job;
    const cJSON *progress = cJSON_GetObjectItemCaseSensitive(m->header, "progress");
    char *text;

    (void)body;
    if (!cJSON_IsObject(progress) || (text = json_print(progress)) == NULL)
        return;
    if (strlen(text) > WIRE_PROGRESS_MOST) {
        free(text);
        return;
    }
    free(job->progress);
    job->progress = text;
    events_progress(c, job);
}

static void bad_worker(struct core *c, int slot, const char *what)
{
    core_log(c, "level=error event=worker_protocol slot=%d what=\"%.511s\"", slot, what);
    worker_kill(c, slot);
}

/* What it computed is more than may be kept: the job fails,
 * and what is still under way from this worker ends with it. */
static void too_large(struct core *c, int slot, const struct modal_error *err)
{
    fail_attempt(c, slot, err, NULL);
    worker_kill(c, slot);
}

/* Bytes at OFFSET of TOTAL, which the first PART has settled as SETTLED: there are some, and they
 * follow the HERE bytes before. */
static bool in_order(const struct wire_message *m, uint64_t offset, uint64_t total, uint64_t here,
                     uint64_t settled)
{
    return m->body_count == 1 && m->body_bytes > 0 && offset == here && total == settled
        && m->body_bytes <= total - here;
}

static void document_part(struct core *c, int slot, uint64_t offset, uint64_t total,
                          const struct wire_message *m)
{
    struct slot *s = &c->slots->at[slot];
    struct modal_error err;

    if (total > WIRE_DOCUMENT_MOST) {
        modal_fail_field(&err, MODAL_TOO_LARGE, "result",
                         "the result has %llu bytes; accepted: at most %d",
                         (unsigned long long)total, WIRE_DOCUMENT_MOST);
        too_large(c, slot, &err);
        return;
    }
    if (!in_order(m, offset, total, s->document_size,
                  s->document != NULL ? s->document_total : total)) {
        bad_worker(c, slot, "a part out of order");
        return;
    }
    if (s->document == NULL)
        s->document = grab(total + 1);
    s->document_total = total;
    s->document_size += wire_gather(m, s->document + offset, m->body_bytes);
    worker_go(c, slot);
}

/* The first PART of signals says what they are; false: it was refused. */
static bool begin_signals(struct core *c, int slot, const struct wire_message *m)
{
    const cJSON *batch = cJSON_GetObjectItemCaseSensitive(m->header, "batch");
    struct wire_input w;
    struct modal_error err;

    if (wire_input_read(batch, "batch", WIRE_BATCH, &w, &err) != MODAL_OK) {
        bad_worker(c, slot, err.message);
        return false;
    }
    if ((double)w.bytes > (double)c->settings.input_bytes) {
        modal_fail_field(&err, MODAL_TOO_LARGE, "time", "the signals have %llu bytes; accepted: at "
                         "most %lld (input_bytes)", (unsigned long long)w.bytes,
                         (long long)c->settings.input_bytes);
        too_large(c, slot, &err);
        return false;
    }
    c->slots->at[slot].output = output_begin(c, c->slots->at[slot].job->user, &w, slot);
    return true;
}

static void signals_part(struct core *c, int slot, uint64_t offset, uint64_t total,
                         const struct wire_message *m, struct blob **body)
{
    struct slot *s = &c->slots->at[slot];

    if (s->output == NULL && offset == 0 && !begin_signals(c, slot, m))
        return;
    if (s->output == NULL
        || !in_order(m, offset, total, output_accepted(s->output), output_total(s->output))) {
        bad_worker(c, slot, "signals out of order");
        return;
    }
    output_chunk(c, s->output, body[0]);
}

static void on_part(struct core *c, int slot, const struct wire_message *m, struct blob **body)
{
    const char *part_name = "document";
    double offset = -1, total = -1;

    if (json_need_number(m->header, "", "offset", 0, WIRE_INTEGER_MOST, &offset, NULL) != MODAL_OK
        || json_need_number(m->header, "", "total", 0, WIRE_INTEGER_MOST, &total, NULL) != MODAL_OK
        || json_get_string(m->header, "", "part", &part_name, NULL) != MODAL_OK)
        bad_worker(c, slot, "a part without its place");
    else if (c->slots->at[slot].parts++ == WIRE_PARTS_MOST)
        bad_worker(c, slot, "more parts than may wait for their GO");
    else if (strcmp(part_name, "batch") == 0)
        signals_part(c, slot, (uint64_t)offset, (uint64_t)total, m, body);
    else if (strcmp(part_name, "document") == 0)
        document_part(c, slot, (uint64_t)offset, (uint64_t)total, m);
    else
        bad_worker(c, slot, "a part of nothing");
}

static void charge(struct core *c, int slot, const struct wire_message *m)
{
    struct slot *s = &c->slots->at[slot];

    json_get_number(m->header, "", "cpu_s", 0, 1e9, &s->cpu_s, NULL);
    account_for(c, s, s->job);
}

/* The document lies in DONE, or in the PARTs before it; signals, if any, are all there. */
static bool is_whole(const struct slot *s, const struct wire_message *m)
{
    const bool in_parts = s->document != NULL;

    if (in_parts ? m->body_count != 0 || s->document_size != s->document_total
                 : m->body_count != 1 || m->body_bytes == 0)
        return false;
    return s->output == NULL || output_accepted(s->output) == output_total(s->output);
}

static void on_done(struct core *c, int slot, const struct wire_message *m, struct blob **body)
{
    struct slot *s = &c->slots->at[slot];

    (void)body;
    if (!is_whole(s, m)) {
        bad_worker(c, slot, "DONE with a part missing");
        return;
    }
    charge(c, slot, m);
    user_worked(s->job->user, slot_work_s_byte(c, slot));
    if (s->document == NULL) {
        s->document = grab(m->body_bytes + 1);
        s->document_size = s->document_total = wire_gather(m, s->document, m->body_bytes);
    }
    s->finishing = true;
    if (s->output != NULL)
        output_seal(c, s->output);
    else
        finish(c, slot);
}

/* A copy of the error's detail, an object of at most DETAIL_MOST bytes; NULL: none,
 * or another, which is left out. */
static cJSON *detail_of(struct core *c, int slot, const cJSON *error)
{
    const cJSON *detail = cJSON_GetObjectItemCaseSensitive(error, "detail");
    char *text = cJSON_IsObject(detail) ? json_print(detail) : NULL;
    const size_t length = text != NULL ? strlen(text) : 0;

    free(text);
    if (length > DETAIL_MOST)
        core_log(c, "level=warning event=detail_left_out slot=%d bytes=%zu most=%d", slot, length,
                 DETAIL_MOST);
    return length == 0 || length > DETAIL_MOST ? NULL : cJSON_Duplicate(detail, true);
}

static void on_failed(struct core *c, int slot, const struct wire_message *m, struct blob **body)
{
    const cJSON *error = cJSON_GetObjectItemCaseSensitive(m->header, "error");
    struct modal_error err;

    (void)body;
    charge(c, slot, m);
    worker_error(error, &err);
    fail_attempt(c, slot, &err, detail_of(c, slot, error));
}

/* The job of SLOT back into the queue: this attempt says nothing against it. */
static void give_back(struct core *c, int slot)
{
    struct slot *s = &c->slots->at[slot];
    struct job *job = s->job;

    account_for(c, s, job);
    part(c, s);
    job_move(c, job, JOB_QUEUED, NULL);
    core_timer(c, c->now.mono_ns, TIMER_START, job->id, 0);
}

void worker_dismiss(struct core *c, int slot)
{
    if (c->slots->at[slot].job != NULL)
        give_back(c, slot);
    else if (c->slots->at[slot].live != NULL)
        windows_back(c, slot);
    c->slots->at[slot].remote->leaving = true;
    worker_kill(c, slot);
}

static void on_release(struct core *c, int slot, const struct wire_message *m, struct blob **body)
{
    (void)m, (void)body;
    worker_dismiss(c, slot);
}

/* A RUN that it has not read yet comes back as a RELEASE; signals that are being sealed are
 * waited for. */
static void on_leave(struct core *c, int slot, const struct wire_message *m, struct blob **body)
{
    (void)m, (void)body;
    c->slots->at[slot].remote->leaving = true;
    if (c->slots->at[slot].job == NULL)
        worker_dismiss(c, slot);
}

static void on_stderr(struct core *c, int slot, const struct wire_message *m, struct blob **body)
{
    struct remote *remote = c->slots->at[slot].remote;

    (void)body;
    if (m->body_count != 1 || m->body_bytes > WIRE_STDERR_MOST) {
        bad_worker(c, slot, "STDERR that is not one frame of at most 65536 bytes");
        return;
    }
    free(remote->said);
    remote->said = grab(m->body_bytes + 1);
    wire_gather(m, remote->said, m->body_bytes);
    text_clean(remote->said, m->body_bytes);
}

static void on_window(struct core *c, int slot, const struct wire_message *m, struct blob **body)
{
    (void)body;
    if (window_is_whole(&c->slots->at[slot], m))
        bad_worker(c, slot, "a window asked for again that it has whole");
    else
        window_end(c, slot, m);
}

static void on_input(struct core *c, int slot, const struct wire_message *m, struct blob **body)
{
    const char *wrong = piece_request(c, slot, m);

    (void)body;
    if (wrong != NULL)
        bad_worker(c, slot, wrong);
}

/* Of an attempt that is over: told once in the life of the next. */
static void tell_late(struct core *c, int slot, const char *verb)
{
    if (!c->slots->at[slot].late_told)
        core_log(c, "level=info event=late slot=%d verb=%s", slot, verb);
    c->slots->at[slot].late_told = true;
}

static bool is_current(const struct core *c, const struct slot *s, const struct wire_message *m)
{
    const char *ident = "";
    int attempt = -1;

    json_get_string(m->header, "", "job", &ident, NULL);
    json_get_int(m->header, "", "attempt", 0, INT32_MAX, &attempt, NULL);
    if (s->state != SLOT_BUSY || s->attempt != attempt)
        return false;
    return s->live != NULL
        || (s->job != NULL && !s->finishing
            && ident_number(c->settings.secret, ident) == s->job->id);
}

void worker_message(struct core *c, const struct event *e)
{
    typedef void said(struct core *, int, const struct wire_message *, struct blob **);
    static const struct {
        const char *verb;
        bool on_job;         /* believed only of the current job, or window, and attempt */
        bool elsewhere;      /* of those alone */
        said *run, *window;  /* window: of a live one; NULL: it was heard, which is all */
    } verbs[] = {
        { "READY", false, false, on_ready, NULL }, { "BEAT", false, false, NULL, NULL },
        { "PROGRESS", true, false, on_progress, NULL }, { "PART", true, false, on_part, NULL },
        { "DONE", true, false, on_done, on_window },
        { "FAILED", true, false, on_failed, on_window },
        { "INPUT", true, true, on_input, NULL }, { "RELEASE", true, true, on_release, on_release },
        { "STDERR", false, true, on_stderr, NULL }, { "LEAVE", false, true, on_leave, NULL },
    };
    const struct wire_message *m = e->message;
    const int slot = e->slot;
    struct slot *s = &c->slots->at[slot];
    said *run;

    if (slot < 0 || (slot >= c->slots->count && s->remote == NULL) || s->state == SLOT_EMPTY)
        return;
    if (m == NULL) {
        bad_worker(c, slot, e->fault->message);
        return;
    }
    if (!slot_owes_ready(s) || strcmp(m->verb, "READY") == 0)
        s->heard_ns = c->now.mono_ns;
    for (size_t i = 0; i < sizeof verbs / sizeof *verbs; i++) {
        if (strcmp(verbs[i].verb, m->verb) != 0 || (verbs[i].elsewhere && s->remote == NULL))
            continue;
        if (verbs[i].on_job && !is_current(c, s, m))
            tell_late(c, slot, m->verb);
        else if ((run = verbs[i].on_job && s->live != NULL ? verbs[i].window
                                                           : verbs[i].run) != NULL)
            run(c, slot, m, e->body);
        return;
    }
    bad_worker(c, slot, "an unknown verb");
}
