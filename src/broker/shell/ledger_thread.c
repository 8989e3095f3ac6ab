/*
 * ledger_thread.c - group commit: what waits while one group syncs is the next group
 *
 * On a full disk a group is taken apart: what may be refused (submissions, samples) is, and what
 * must pass (edges of jobs that run, deletes, chunks whose space is reserved) waits, in order,
 * behind the reserve given up for it, and is tried again.  Results wait too, and are refused when
 * the reserve is used up: their jobs fail.  The last part of the reserve is for what must pass
 * alone, else results would use it up and no delete could make room again.  Where that is used up
 * too, another program having taken what was free, what must pass is tried five times a second, and
 * who waits for it is told so (done_stuck).  Without a descriptor
 * for the samples of a stream a group waits until there is one, unanswered.  What is given up of
 * the last part nobody else takes: see need_room of spool_thread.c.  Behind samples that were
 * refused no later ones of their stream pass: its fence is up until the core takes it down.
 */
#include "broker/shell/queue.h"
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

enum { GROUP_MOST = 4096 };              /* transactions: what waits behind them is not kept long */
/* between two tries of a group for which there is no descriptor */
enum { BUSY_NS = 100000000 };
#define REST_AFTER_NS INT64_C(1000000000)      /* without any, the ledger tidies itself up, once */

/* The ledger's in the data folder; what is not there has no number. */
struct files { struct stat database, log; };

struct ledger_thread {
    pthread_t thread;
    pthread_mutex_t mutex;
    pthread_cond_t more;
    struct transaction *first, **end;
    bool stop, ping;
    enum { WHOLE, SHRUNK, GONE } reserve;
    bool settling;                             /* pages to give back, at leisure */
    /* when to rest, monotonic; 0: nothing was done since */
    int64_t rest_ns;
    struct ledger *ledger;
    const char *dir;
    struct files begun;                        /* the log's from its first group on */
    struct done_queue *done;
    struct ledger_change *changes;
    size_t room;
};

static bool gather(struct ledger_thread *l, struct transaction *first, size_t *count)
{
    size_t n = 0;

    for (struct transaction *t = first; t != NULL; t = t->next)
        n += t->count;
    if (n > l->room) {
        struct ledger_change *changes = realloc(l->changes, n * sizeof *changes);
        if (changes == NULL)
            return false;
        l->changes = changes;
        l->room = n;
    }
    *count = 0;
    for (struct transaction *t = first; t != NULL; t = t->next) {
        if (t->count > 0)
            memcpy(l->changes + *count, t->changes, t->count * sizeof *t->changes);
        *count += t->count;
    }
    return true;
}

/* A change the ledger would not apply is a bug of the core: stop rather than tell what is
 * not so. */
static enum modal_status check_applied(const struct ledger_thread *l, size_t count,
                                       struct modal_error *err)
{
    for (size_t i = 0; i < count; i++)
        if (l->changes[i].status != MODAL_OK)
            return modal_fail(err, MODAL_INTERNAL, "ledger: change %d was refused: %s",
                              (int)l->changes[i].verb, modal_status_code(l->changes[i].status));
    return MODAL_OK;
}

static enum modal_status commit(struct ledger_thread *l, struct transaction *first,
                                struct modal_error *err)
{
    size_t count;
    enum modal_status rc;

    if (!gather(l, first, &count))
        return modal_fail(err, MODAL_NO_MEMORY, "out of memory");
    if (count == 0)
        return MODAL_OK;
    rc = ledger_commit(l->ledger, l->changes, count, err);
    return rc == MODAL_OK ? check_applied(l, count, err) : rc;
}

enum { BEHIND_FENCES = FIRST_REFUSED + 1 };

/* Take those out of *FIRST that are refusable to LEAST and more, and those behind a fence; answer
 * them, leave the rest. */
static void refuse(struct ledger_thread *l, struct transaction **first, int least)
{
    struct transaction *refused = NULL, **end = &refused;

    while (*first != NULL) {
        struct transaction *t = *first;
        if ((int)t->refusable < least && (t->fence == NULL || !atomic_load(t->fence))) {
            first = &t->next;
            continue;
        }
        *first = t->next;
        t->next = NULL;
        t->status = MODAL_STORAGE_FULL;
        if (t->fence != NULL)
            atomic_store(t->fence, true);
        *end = t;
        end = &t->next;
    }
    if (refused != NULL)
        done_transactions(l->done, refused);
}

static void put_back(struct ledger_thread *l, struct transaction *list)
{
    struct transaction **end = &list;

    pthread_mutex_lock(&l->mutex);
    while (*end != NULL)
        end = &(*end)->next;
    *end = l->first;
    if (l->first == NULL)
        l->end = end;
    l->first = list;
    pthread_mutex_unlock(&l->mutex);
}

/* Until there is something to do, or time to rest. */
static void wait_for_work(struct ledger_thread *l)
{
    struct timespec rest = { l->rest_ns / 1000000000, l->rest_ns % 1000000000 };
    bool over = false;

    while (l->first == NULL && !l->stop && !l->ping && !l->settling && !over)
        if (l->rest_ns == 0)
            pthread_cond_wait(&l->more, &l->mutex);
        else
            over = pthread_cond_timedwait(&l->more, &l->mutex, &rest) == ETIMEDOUT;
}

/* Up to GROUP_MOST transactions; NULL: stop, rest, or nothing after all.  *PING: somebody wants to
 * know that this thread lives. */
static struct transaction *next_group(struct ledger_thread *l, bool *ping, bool *stop)
{
    struct transaction *list, **cut;

    pthread_mutex_lock(&l->mutex);
    wait_for_work(l);
    list = l->first;
    cut = &l->first;
    for (int n = 0; n < GROUP_MOST && *cut != NULL; n++)
        cut = &(*cut)->next;
    if (cut == &l->first)
        list = NULL;
    else {
        struct transaction *rest = *cut;
        *cut = NULL;
        l->first = rest;
        if (rest == NULL)
            l->end = &l->first;
    }
    *ping = l->ping;
    l->ping = false;
    *stop = l->stop;
    pthread_mutex_unlock(&l->mutex);
    return list;
}

static enum modal_status full_disk(struct ledger_thread *l, struct transaction *group,
                                   struct modal_error *err)
{
    int before = l->reserve;
    enum modal_status rc;

    refuse(l, &group, before == WHOLE ? FIRST_REFUSED : LAST_REFUSED);
    if (before == WHOLE) {
        reserve_hold(l->dir, RESERVE_LAST, NULL);
        l->reserve = SHRUNK;
    } else if (group != NULL) {
        reserve_release(l->dir, NULL);
        l->reserve = GONE;
    }
    /* so that the log begins anew in its own space: the database has the room that was given up */
    rc = ledger_checkpoint(l->ledger, err);
    if (group != NULL)
        put_back(l, group);
    if (group != NULL && before == GONE)
        done_stuck(l->done);
    if (group != NULL && before == GONE)
        nanosleep(&(struct timespec) { 0, 200000000 }, NULL);
    return rc;
}

/* Take back of the reserve what there is room for. */
static void mend_reserve(struct ledger_thread *l)
{
    if (l->reserve == GONE && reserve_hold(l->dir, RESERVE_LAST, NULL) == MODAL_OK)
        l->reserve = SHRUNK;
    if (l->reserve == SHRUNK && reserve_hold(l->dir, RESERVE_BYTES, NULL) == MODAL_OK)
        l->reserve = WHOLE;
}

static int64_t now_ns(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

static struct files files_of(const char *dir)
{
    struct files files = { .database.st_size = 0 };
    char path[4200];

    snprintf(path, sizeof path, "%s/ledger.db", dir);
    stat(path, &files.database);
    snprintf(path, sizeof path, "%s/ledger.db-wal", dir);
    stat(path, &files.log);
    return files;
}

static bool same_file(const struct stat *a, const struct stat *b)
{
    return a->st_ino == b->st_ino && a->st_dev == b->st_dev;
}

/* What was committed to files that are not in the folder any more, which was removed, moved or put
 * back meanwhile, nobody will find: it is not acknowledged. */
static enum modal_status measure(struct ledger_thread *l, struct transaction *first,
                                 int64_t took_ns, struct modal_error *err)
{
    const struct files files = files_of(l->dir);

    if (!same_file(&files.database, &l->begun.database)
        || (l->begun.log.st_ino != 0 && !same_file(&files.log, &l->begun.log)))
        return modal_fail(err, MODAL_IO, "%s: the ledger is not there any more, or is another: the "
                          "data folder was removed or replaced while the daemon ran", l->dir);
    l->begun.log = files.log;
    first->took_ns = took_ns;
    first->ledger_bytes = files.database.st_size + files.log.st_size;
    for (const struct transaction *t = first; t != NULL; t = t->next)
        first->group++;
    return MODAL_OK;
}

/* After work a rest is due some time later; when that has passed without work, it is taken. */
static enum modal_status rest_or_work(struct ledger_thread *l, bool worked, struct modal_error *err)
{
    int64_t now = now_ns();
    bool more = false;
    enum modal_status rc = MODAL_OK;

    if (!worked && (l->rest_ns == 0 || now < l->rest_ns))
        return MODAL_OK;
    if (!worked)
        rc = ledger_idle(l->ledger, &more, err);
    l->rest_ns = worked || more ? now + REST_AFTER_NS / (more ? 20 : 1) : 0;
    return rc;
}

/* After a group, or for want of one.  Without a reserve each group's log begins anew, so that an
 * edge takes of the last room what its rows take, and no more. */
static enum modal_status tidy(struct ledger_thread *l, bool worked, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (worked && l->reserve == GONE)
        rc = ledger_checkpoint(l->ledger, err);
    if (rc == MODAL_OK)
        rc = ledger_settle(l->ledger, &l->settling, err);
    return rc == MODAL_OK ? rest_or_work(l, worked, err) : rc;
}

static void *run(void *context)
{
    struct ledger_thread *l = context;
    struct modal_error err;
    int64_t begun_ns;
    bool ping, stop;

    for (;;) {
        struct transaction *group = next_group(l, &ping, &stop);
        enum modal_status rc;

        if (ping)
            done_ping(l->done);
        if (group == NULL && stop)
            return NULL;
        if (l->reserve == GONE)
            mend_reserve(l);
        if (group != NULL)
            refuse(l, &group, l->reserve == GONE ? LAST_REFUSED : BEHIND_FENCES);
        begun_ns = now_ns();
        rc = group != NULL ? commit(l, group, &err) : MODAL_OK;
        if (rc == MODAL_STORAGE_FULL) {
            if ((rc = full_disk(l, group, &err)) == MODAL_OK)
                continue;
            group = NULL;                               /* it was put back */
        }
        if (rc == MODAL_BUSY && !stop) {
            put_back(l, group);
            nanosleep(&(struct timespec) { 0, BUSY_NS }, NULL);
            continue;
        }
        if (rc == MODAL_OK && group != NULL) {
            mend_reserve(l);
            rc = measure(l, group, now_ns() - begun_ns, &err);
        }
        if (rc != MODAL_OK) {
            if (group != NULL)
                put_back(l, group);
            done_fatal(l->done, &err);
            return NULL;
        }
        if (group != NULL)
            done_transactions(l->done, group);
        if (tidy(l, group != NULL, &err) != MODAL_OK) {
            done_fatal(l->done, &err);
            return NULL;
        }
    }
}

/* What nobody is told of, for the ledger failed. */
static void drop(struct transaction *list)
{
    while (list != NULL) {
        struct transaction *next = list->next;
        transaction_free(list);
        list = next;
    }
}

struct ledger_thread *ledger_thread_start(struct ledger *ledger, const char *dir,
                                          struct done_queue *done)
{
    struct ledger_thread *l = calloc(1, sizeof *l);
    pthread_condattr_t monotonic;

    if (l == NULL)
        return NULL;
    pthread_mutex_init(&l->mutex, NULL);
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&l->more, &monotonic);
    pthread_condattr_destroy(&monotonic);
    l->rest_ns = now_ns() + REST_AFTER_NS;         /* what the last process left */
    l->end = &l->first;
    l->ledger = ledger;
    l->dir = dir;
    l->begun = files_of(dir);
    l->begun.log = (struct stat) { 0 };
    l->done = done;
    if (pthread_create(&l->thread, NULL, run, l) != 0) {
        free(l);
        return NULL;
    }
    return l;
}

void ledger_thread_put(struct ledger_thread *l, struct transaction *first)
{
    pthread_mutex_lock(&l->mutex);
    *l->end = first;
    while (*l->end != NULL)
        l->end = &(*l->end)->next;
    pthread_cond_signal(&l->more);
    pthread_mutex_unlock(&l->mutex);
}

void ledger_thread_ping(struct ledger_thread *l)
{
    pthread_mutex_lock(&l->mutex);
    l->ping = true;
    pthread_cond_signal(&l->more);
    pthread_mutex_unlock(&l->mutex);
}

void ledger_thread_stop(struct ledger_thread *l)
{
    if (l == NULL)
        return;
    pthread_mutex_lock(&l->mutex);
    l->stop = true;
    pthread_cond_signal(&l->more);
    pthread_mutex_unlock(&l->mutex);
    pthread_join(l->thread, NULL);
    drop(l->first);
    pthread_cond_destroy(&l->more);
    pthread_mutex_destroy(&l->mutex);
    free(l->changes);
    free(l);
}
