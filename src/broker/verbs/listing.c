/*
 * listing.c - LIST: a page of a user's jobs, of which a step looks at a bounded number
 *
 * What a page asks for may be found nowhere among all the jobs that a user has, and looking for it
 * takes 45 ns a job in the one thread that answers everybody.  So a step looks at LOOKED_AT jobs,
 * of each who waits for a page in turn.  What is found is kept by its number; its docs are written
 * when the page is whole, as the jobs are then.
 */
#include "broker/core/jobs.h"
#include "broker/kit/ident.h"
#include "broker/kit/memory.h"
#include "broker/verbs/verbs.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    LOOKED_AT = 1024,         /* 50 us: as long as an answer takes */
    WAITING_MOST = 1024,      /* pages of 8 KiB: as many as answers that wait for a connection */
};

struct listing {
    struct fair_item fair;
    struct listing *next, **link;         /* of all */
    bool gone;                            /* nobody is there to be answered */
    struct reply reply;
    struct user *asker;
    char key[KEY_TEXT];
    struct wire_list wanted;              /* with texts of its own, once it waits */
    int64_t at;                           /* the job that was looked at last; 0: from the end */
    int count;
    int64_t found[WIRE_PAGE_MOST];
};

static bool begins(const char *text, const char *with)
{
    return text != NULL && strncmp(text, with, strlen(with)) == 0;
}

static bool is_listed(const struct job *job, const struct wire_list *l)
{
    return job->committed && !job->deleting && !job->hidden
           && (l->state < 0 || (int)job->shown == l->state)
           && (l->kind == NULL || strcmp(job->kind, l->kind) == 0)
           && (l->key == NULL || begins(job->key, l->key))
           && (double)job->submitted_ns >= l->since * (double)SECOND;
}

/* Where L goes on among the jobs of USER. */
static size_t place(const struct user *user, const struct listing *l)
{
    if (!l->wanted.newest)
        return user_seek(user, l->at);
    return l->at > 0 ? user_seek(user, l->at - 1) : user->job_count;
}

/* The next of USER's jobs from *AT on, towards the newest or from there. */
static struct job *next_job(const struct user *user, bool newest, size_t *at)
{
    struct job *job = NULL;

    while (job == NULL && (newest ? *at > 0 : *at < user->job_count))
        job = user->jobs[newest ? --*at : (*at)++];
    return job;
}

/* Some more of USER's jobs; true: the page is whole. */
static bool look(const struct user *user, struct listing *l)
{
    size_t at = place(user, l);
    const struct job *job;

    for (int i = 0; i < LOOKED_AT && l->count < l->wanted.limit; i++) {
        if ((job = next_job(user, l->wanted.newest, &at)) == NULL)
            return true;
        l->at = job->id;
        if (is_listed(job, &l->wanted))
            l->found[l->count++] = job->id;
    }
    return l->count == l->wanted.limit;
}

/* The page that L is of USER's jobs. */
static void tell(struct core *c, const struct user *user, const struct listing *l)
{
    size_t at = place(user, l);
    bool more = l->count == l->wanted.limit && next_job(user, l->wanted.newest, &at) != NULL;
    struct json_text page = { 0 };
    char ident[IDENT_TEXT], *text;
    int count = 0;
    cJSON *header;

    json_text_open(&page, NULL);
    json_text_key(&page, "jobs");
    json_text_raw(&page, "[");
    for (int i = 0; i < l->count; i++) {
        const struct job *job = job_by_id(c, l->found[i]);
        if (job == NULL || !is_listed(job, &l->wanted))
            continue;                            /* not as it was when it was looked at */
        json_text_open(&page, NULL);
        doc_write(c, &page, job, false);
        json_text_close(&page);
        count++;
    }
    json_text_raw(&page, "]");
    ident_text(ident, c->settings.secret, l->at);
    json_text_string(&page, "next", more ? ident : NULL);
    text = text_end(&page);
    header = answer_new(&l->reply);
    cJSON_AddNumberToObject(header, "count", count);
    answer_send(c, &l->reply, header, blob_take(text, strlen(text)));
}

static char *own(const char *text)
{
    return text != NULL ? grab_text(text) : NULL;
}

static void listing_free(struct listing *l)
{
    *l->link = l->next;
    if (l->next != NULL)
        l->next->link = l->link;
    free((char *)l->wanted.kind);
    free((char *)l->wanted.key);
    free((char *)l->wanted.user);
    free(l);
}

/* NOW goes on in the steps that follow. */
static void put_off(struct core *c, const struct listing *now)
{
    struct listing *l = grab(sizeof *l);

    *l = *now;
    l->wanted.kind = own(now->wanted.kind);
    l->wanted.key = own(now->wanted.key);
    l->wanted.user = own(now->wanted.user);
    l->wanted.after = NULL;
    l->next = c->listings;
    l->link = &c->listings;
    if (l->next != NULL)
        l->next->link = &l->next;
    c->listings = l;
    fair_queue_put(&c->looking, &l->fair);
}

/* Where as many as there may be are looked for TURN may have an equal share. */
static bool may_wait(struct core *c, uint64_t turn, const struct reply *reply)
{
    const struct fair_queue *looking = &c->looking;

    if (looking->size < WAITING_MOST
        || fair_queue_size(looking, turn) < WAITING_MOST / (looking->by_turn.count + 1))
        return true;
    answer_fail(c, reply, MODAL_BUSY, "", answer_number("retry_after_s", 1),
                "%zu pages of jobs are looked for, at most %d, of which each who waits may have an "
                "equal share", looking->size, WAITING_MOST);
    return false;
}

void list_request(struct core *c, const struct request *q)
{
    const char *after = q->wire.list.after;
    const struct user *user = user_listed(c, &q->reply, q->user, q->wire.list.user);
    struct listing l;

    if (user == NULL)
        return;
    l.fair = (struct fair_item) { .turn = user_turn(q->user, q->reply.peer), .size = 1 };
    l.gone = false;
    l.reply = q->reply;
    l.asker = q->user;
    snprintf(l.key, sizeof l.key, "%s", q->event->key);
    l.wanted = q->wire.list;
    l.at = after == NULL ? 0 : ident_number(c->settings.secret, after);
    l.count = 0;
    if (l.at < 0)
        answer_fail(c, &q->reply, MODAL_BAD_INPUT, "after", NULL,
                    "after is no cursor of LIST; accepted: `next` of an earlier page");
    else if (look(user, &l))
        tell(c, user, &l);
    else if (may_wait(c, l.fair.turn, &q->reply))
        put_off(c, &l);
}

/* Whose jobs L is about; NULL: he may ask that no more, which he is told. */
static const struct user *still_listed(struct core *c, const struct listing *l)
{
    struct modal_error err;

    if (user_admits(c, l->asker, l->key))
        return user_listed(c, &l->reply, l->asker, l->wanted.user);
    modal_fail(&err, MODAL_DENIED, "this key is not, or no longer, admitted");
    answer_error(c, &l->reply, &err, NULL);
    return NULL;
}

void listings_pump(struct core *c)
{
    struct listing *l;
    const struct user *user;

    while ((l = (struct listing *)fair_queue_take(&c->looking, NULL, NULL)) != NULL && l->gone)
        listing_free(l);
    if (l == NULL)
        return;
    user = still_listed(c, l);
    if (user != NULL && !look(user, l)) {
        fair_queue_put(&c->looking, &l->fair);
        return;
    }
    if (user != NULL)
        tell(c, user, l);
    listing_free(l);
}

bool listings_wait(const struct core *c)
{
    return c->listings != NULL;
}

void listings_gone(struct core *c, uint64_t peer)
{
    for (struct listing *l = c->listings; l != NULL; l = l->next)
        l->gone |= l->reply.peer == peer;
}

void listings_done(struct core *c)
{
    struct listing *l;

    while ((l = (struct listing *)fair_queue_take(&c->looking, NULL, NULL)) != NULL)
        listing_free(l);
}
