/* waits.c - who waits: for the end of a job, and for bytes that are read for it */
#include "broker/core/inputs.h"
#include "broker/core/jobs.h"
#include <stdlib.h>
#include <string.h>

static struct asker *asker_of(const struct core *c, uint64_t peer)
{
    return map_find_number(&c->jobs->askers, peer);
}

static struct asker *asker_get(struct core *c, uint64_t peer)
{
    struct asker *asker = asker_of(c, peer);

    if (asker != NULL)
        return asker;
    asker = grab(sizeof *asker);
    asker->peer = peer;
    if (!map_put(&c->jobs->askers, map_hash_number(peer), asker))
        abort();
    return asker;
}

/* It goes where it asks for nothing more. */
static void asker_leave(struct core *c, struct asker *asker)
{
    if (asker->waits != NULL || asker->reads > 0)
        return;
    map_remove(&c->jobs->askers, map_hash_number(asker->peer), asker);
    free(asker);
}

/* Where a user's are used up a connection may still have its share: without keys all are one user,
 * and one of them would have everything.  Twice as many are the bound, and one each beside. */
bool read_allows(struct core *c, const struct user *user, const struct reply *reply)
{
    const struct asker *asker = asker_of(c, reply->peer);
    size_t share = WIRE_READS_MOST / (c->jobs->askers.count + 1) + 1;

    if (user->reads < WIRE_READS_MOST || asker == NULL || (size_t)asker->reads < share)
        return true;
    answer_fail(c, reply, MODAL_BUSY, "", answer_number("retry_after_s", 0.1),
                "%d answers are being read, at most %d", user->reads, WIRE_READS_MOST);
    return false;
}

struct task *read_for(struct core *c, const struct reply *reply, const struct job *job,
                      enum task_type type, int64_t id, const char *part)
{
    struct task *task = task_new(type, id);
    struct user *user = job != NULL ? job->user : input_by_id(c, id)->user;

    task->after = after_new(AFTER_READ, reply);
    task->after->value = job != NULL ? job->id : 0;
    task->after->text = grab_text(part);
    task->owner = user;
    user->reads++;
    asker_get(c, reply->peer)->reads++;
    core_task(c, task, user_turn(user, reply->peer));
    return task;
}

/* The doc of an ended job, with its document where that was asked for and is small enough. */
void wait_tell(struct core *c, const struct wait *w)
{
    struct job *job = w->job;
    struct job *root = job->source != 0 ? job_by_id(c, job->source) : job;

    if (!w->result || job->shown != JOB_DONE || job->result_bytes > WIRE_BODY_MOST || root == NULL)
        answer_doc(c, &w->reply, job, -1, NULL);
    else if (root->document != NULL)
        answer_doc(c, &w->reply, job, -1, blob_share(root->document));
    else
        read_for(c, &w->reply, job, TASK_READ_RESULT, root->id, "wait")->length = WIRE_BODY_MOST;
}

static void put_asker(struct core *c, struct wait *w)
{
    struct asker *asker = asker_get(c, w->reply.peer);

    w->beside = asker->waits;
    w->beside_link = &asker->waits;
    if (w->beside != NULL)
        w->beside->beside_link = &w->beside;
    asker->waits = w;
}

static void leave_asker(struct core *c, struct wait *w)
{
    struct asker *asker = asker_of(c, w->reply.peer);

    *w->beside_link = w->beside;
    if (w->beside != NULL)
        w->beside->beside_link = w->beside_link;
    asker_leave(c, asker);
}

/* Not the timer of a wait that has ended; number 0 is none's. */
static bool is_awaited(const void *context, const struct heap_item *item)
{
    const struct core *c = context;
    uint64_t number = (uint64_t)item->order;

    return item->what != TIMER_WAIT || number == 0
        || map_find_number(&c->jobs->waits, number) != NULL;
}

/* Its timer stays until it is due, or such are half of all. */
static void drop_wait(struct core *c, struct wait *w)
{
    *w->link = w->next;
    if (w->next != NULL)
        w->next->link = w->link;
    leave_asker(c, w);
    map_remove(&c->jobs->waits, map_hash_number(w->number), w);
    w->user->waits--;
    free(w);
    if (++c->jobs->waits_past > WIRE_WAITS_MOST && c->jobs->waits_past > c->timers.count / 2) {
        heap_sift(&c->timers, is_awaited, c);
        c->jobs->waits_past = 0;
    }
}

void wait_begin(struct core *c, const struct wait *now, double timeout_s)
{
    struct job *job = now->job;
    struct wait *w = grab(sizeof *w);

    *w = *now;
    w->number = c->jobs->next_wait++;
    w->next = job->waits;
    w->link = &job->waits;
    if (w->next != NULL)
        w->next->link = &w->next;
    job->waits = w;
    w->user->waits++;
    put_asker(c, w);
    if (!map_put(&c->jobs->waits, map_hash_number(w->number), w))
        abort();
    core_timer(c, c->now.mono_ns + (int64_t)(timeout_s * 1e9), TIMER_WAIT, (int64_t)w->number, 0);
}

void waits_gone(struct core *c, uint64_t peer)
{
    struct asker *asker;

    while ((asker = asker_of(c, peer)) != NULL && asker->waits != NULL)
        drop_wait(c, asker->waits);
}

void wait_answer(struct core *c, struct job *job)
{
    while (job->waits != NULL) {
        wait_tell(c, job->waits);
        drop_wait(c, job->waits);
    }
}

void waits_revoke(struct core *c)
{
    struct modal_error err;
    struct wait *w;
    size_t at = 0;

    modal_fail(&err, MODAL_DENIED, "this key is not, or no longer, admitted");
    while ((w = map_next(&c->jobs->waits, &at)) != NULL)
        if (!user_admits(c, w->user, w->key)) {
            answer_error(c, &w->reply, &err, NULL);
            drop_wait(c, w);
        }
}

void wait_timeout(struct core *c, uint64_t number)
{
    struct wait *w = map_find_number(&c->jobs->waits, number);

    if (w == NULL) {
        c->jobs->waits_past -= c->jobs->waits_past > 0;
        return;
    }
    answer_doc(c, &w->reply, w->job, -1, NULL);
    drop_wait(c, w);
    c->jobs->waits_past -= c->jobs->waits_past > 0;            /* this timer has run */
}

void sums_keep(struct core *c, const struct task *task)
{
    const struct input *input = input_by_id(c, task->id);
    struct transaction *t;

    if (task->sums.count == 0 || input == NULL || input->going)
        return;
    t = transaction_new();
    t->refusable = FIRST_REFUSED;
    transaction_add_sums(t, task->id, &task->sums);
    core_commit(c, t);
}

/* Whose bytes they are, into HEADER: those of JOB, or of the input that TASK read. */
static void add_origin(const struct core *c, const struct task *task, const struct job *job,
                       cJSON *header)
{
    const char *part = task->after->text;
    const struct input *input = job == NULL                ? input_by_id(c, task->id)
                                : strcmp(part, "batch") == 0 ? job->output
                                : strcmp(part, "input") == 0 ? job->input
                                                             : NULL;
    char ident[IDENT_TEXT];

    if (job != NULL) {
        job_ident(c, job, ident);
        cJSON_AddStringToObject(header, "job", ident);
    } else {
        ident_text(ident, ~c->settings.secret, task->id);
        cJSON_AddStringToObject(header, "upload", ident);
    }
    if (input != NULL)
        input_describe(input, cJSON_AddObjectToObject(header, "batch"));
}

/* Bytes that were read for somebody: RESULT's, or a wait's document. */
void read_task_done(struct core *c, struct task *task)
{
    struct after *after = task->after;
    struct asker *asker = asker_of(c, after->reply.peer);
    bool of_job = after->value != 0;
    struct job *job = of_job ? job_by_id(c, after->value) : NULL;
    cJSON *header;

    ((struct user *)task->owner)->reads--;
    asker->reads--;
    asker_leave(c, asker);
    if (task->type == TASK_READ_SPOOL)
        sums_keep(c, task);
    if (of_job && job == NULL) {
        answer_fail(c, &after->reply, MODAL_NOT_FOUND, "job", NULL, "no such job of yours");
        return;
    }
    if (task->status != MODAL_OK) {
        answer_error(c, &after->reply, &task->err, NULL);
        return;
    }
    if (strcmp(after->text, "wait") == 0) {
        answer_doc(c, &after->reply, job, -1, blob_share(task->text));
        return;
    }
    header = answer_new(&after->reply);
    add_origin(c, task, job, header);
    cJSON_AddStringToObject(header, "part", after->text);
    cJSON_AddNumberToObject(header, "offset", (double)task->offset);
    cJSON_AddNumberToObject(header, "bytes", (double)task->text->size);
    cJSON_AddNumberToObject(header, "total", (double)task->total);
    answer_send(c, &after->reply, header, blob_share(task->text));
}
