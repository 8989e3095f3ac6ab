/*
 * users.c - accounts, limits, and whose job starts next
 *
 * Fair share is deficit round robin [SV95] for jobs whose seconds are known only when they end.  A
 * round gives user u the quantum q w_u, w_u his weight; a job starts when its user owes nothing,
 * his expected seconds are taken at once (so that several workers do not start several on one
 * credit), and what it really took is settled when it ends.  Unlike in [SV95] nobody waits until
 * he has what a job will cost: one long job among short ones would keep its user waiting for it
 * again. The number of rounds until somebody can start is computed, not walked:
 *
 *     r = min over users with a job that may start of ceil(-deficit_u / (q w_u))               (1)
 *
 * While they wait for each other, users' seconds over their weights so differ by at most a few
 * jobs' (tests/unit/broker/test_share.c). Who has no job that may start keeps no credit, and his
 * debt shrinks as the rounds pass; where nobody has one, all debts are forgiven: what a user took
 * while nobody waited for it, he owes nobody.  Inside a user's share, jobs are ordered by
 * submission less priority: one step of priority is worth a minute of waiting, so that nothing
 * starves.
 *
 * [SV95] Shreedhar and Varghese, Efficient fair queueing using deficit round robin, SIGCOMM 1995.
 */
#include "broker/core/jobs.h"
#include "broker/core/slots.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* q of (1): less than most jobs take, so that who waits is served within a few of them. */
static const double quantum_s = 0.05;
/* What nobody's jobs have told yet is expected of one; what one is charged at least. */
static const double cost_first_s = 0.01, cost_least_s = 1e-3;
/* The mean of a user's seconds is over some five jobs: it follows when they change. */
static const double cost_weight = 0.2;
/* A debt beyond it, in seconds, is forgiven: one long job shuts nobody out for a day. */
static const double deficit_least_s = -3600;

static bool has_name(const void *value, const void *key)
{
    return strcmp(((const struct user *)value)->name, key) == 0;
}

struct user *user_get(struct core *c, const char *name)
{
    uint64_t hash = map_hash_text(name);
    struct user *user = map_find(&c->users, hash, has_name, name);

    if (user != NULL)
        return user;
    user = grab(sizeof *user);
    snprintf(user->name, sizeof user->name, "%s", name);
    user->cost_s = cost_first_s;
    user->stones_end = &user->stones;
    user->number = UINT64_MAX - c->user_count;
    if (!map_put(&c->users, hash, user))
        abort();
    c->user_list = regrab(c->user_list, (c->user_count + 1) * sizeof *c->user_list);
    c->user_list[c->user_count++] = user;
    return user;
}

struct user *user_of_key(struct core *c, const char *key)
{
    for (size_t i = 0; i < c->settings.account_count; i++)
        if (strcmp(c->accounts[i].key, key) == 0) {
            struct user *user = user_get(c, c->accounts[i].user);
            user->account = &c->accounts[i];
            return user;
        }
    return NULL;
}

uint64_t user_turn(const struct user *user, uint64_t peer)
{
    bool keyless = user->account != NULL && user->account->key[0] == 0;

    return keyless && peer != 0 ? peer : user->number;
}

uint64_t core_turn(struct core *c, const char *key, uint64_t peer)
{
    const struct user *user = user_of_key(c, key);

    return user == NULL ? 0 : user_turn(user, peer);
}

bool role_is_client(enum wire_role role)
{
    return role != WIRE_ROLE_NONE && role != WIRE_ROLE_WORKER;
}

bool user_admits(const struct core *c, const struct user *user, const char *key)
{
    for (size_t i = 0; i < c->settings.account_count; i++)
        if (strcmp(c->accounts[i].key, key) == 0)
            return strcmp(c->accounts[i].user, user->name) == 0
                && role_is_client(c->accounts[i].role);
    return false;
}

bool key_is_worker(const struct core *c, const char *key)
{
    for (size_t i = 0; i < c->settings.account_count; i++)
        if (strcmp(c->accounts[i].key, key) == 0)
            return c->accounts[i].role == WIRE_ROLE_WORKER;
    return false;
}

static bool has_account(const struct account *all, size_t count, const struct account *one)
{
    for (size_t i = 0; i < count; i++)
        if (strcmp(all[i].key, one->key) == 0 && strcmp(all[i].user, one->user) == 0
            && all[i].role == one->role)
            return true;
    return false;
}

/* Who comes and who goes with a reload; not at the start, when the whole list comes. */
static void audit_accounts(struct core *c, const struct account *old, size_t olds)
{
    const struct account *now = c->settings.accounts;

    for (size_t i = 0; i < olds; i++)
        if (!has_account(now, c->settings.account_count, &old[i]))
            core_log(c, "level=notice event=audit user=%s what=revoked role=%s", old[i].user,
                     wire_roles[old[i].role]);
    for (size_t i = 0; olds > 0 && i < c->settings.account_count; i++)
        if (!has_account(old, olds, &now[i]))
            core_log(c, "level=notice event=audit user=%s what=admitted role=%s", now[i].user,
                     wire_roles[now[i].role]);
}

void users_configure(struct core *c)
{
    size_t count = c->settings.account_count;

    audit_accounts(c, c->accounts, c->account_count);
    c->account_count = count;
    free(c->accounts);
    c->accounts = grab((count + 1) * sizeof *c->accounts);
    if (count > 0)
        memcpy(c->accounts, c->settings.accounts, count * sizeof *c->accounts);
    c->settings.accounts = NULL;
    for (size_t i = 0; i < c->user_count; i++)
        c->user_list[i]->account = NULL;
    for (size_t i = 0; i < count; i++)
        user_get(c, c->accounts[i].user)->account = &c->accounts[i];
}

/* ---- a user's jobs, by id -------------------------------------------------------------------- */

size_t user_seek(const struct user *user, int64_t id)
{
    size_t low = 0, high = user->job_count;

    /* ids of removed jobs: find the next one that is there */
    while (low < high) {
        size_t middle = (low + high) / 2, at = middle;
        while (at < high && user->jobs[at] == NULL)
            at++;
        if (at < high && user->jobs[at]->id <= id)
            low = at + 1;
        else
            high = middle;
    }
    return low;
}

void user_add_job(struct user *user, struct job *job)
{
    if (user->job_count == user->job_room) {
        user->job_room = user->job_room ? 2 * user->job_room : 16;
        user->jobs = regrab(user->jobs, user->job_room * sizeof *user->jobs);
    }
    user->jobs[user->job_count++] = job;
}

/* Squeeze the removed ones out: once they are half of all, each has paid for the walk. */
static void squeeze(struct user *user)
{
    size_t kept = 0;

    for (size_t i = 0; i < user->job_count; i++)
        if (user->jobs[i] != NULL)
            user->jobs[kept++] = user->jobs[i];
    user->job_count = kept;
    user->jobs_gone = 0;
}

void user_drop_job(struct user *user, const struct job *job)
{
    enum { FEW_JOBS = 32 };     /* 256 bytes: not worth a walk at each that goes */
    size_t at = user_seek(user, job->id - 1);

    while (at < user->job_count && user->jobs[at] != job)
        at++;
    if (at == user->job_count)
        return;
    user->jobs[at] = NULL;
    user->jobs_gone++;
    if (2 * user->jobs_gone >= user->job_count && user->job_count >= FEW_JOBS)
        squeeze(user);
}

/* ---- keys whose job is gone ------------------------------------------------------------------ */

static bool has_key(const void *value, const void *key)
{
    return strcmp(((const struct tombstone *)value)->key, key) == 0;
}

struct tombstone *user_tombstone(const struct user *user, const char *key)
{
    return map_find(&user->tombstones, map_hash_text(key), has_key, key);
}

void user_bury(struct user *user, const char *key, const uint8_t fingerprint[32],
               int64_t expired_ns)
{
    struct tombstone *stone = user_tombstone(user, key);

    if (stone == NULL) {
        stone = grab(sizeof *stone);
        stone->key = grab_text(key);
        if (!map_put(&user->tombstones, map_hash_text(key), stone))
            abort();
        *user->stones_end = stone;
        user->stones_end = &stone->next;
    }
    stone->expired_ns = expired_ns;
    stone->committed = false;
    memcpy(stone->fingerprint, fingerprint, 32);
}

static int by_age(const void *a, const void *b)
{
    const struct tombstone *x = *(struct tombstone *const *)a, *y = *(struct tombstone *const *)b;

    return (x->expired_ns > y->expired_ns) - (x->expired_ns < y->expired_ns);
}

static void sort_stones(struct user *user)
{
    size_t count = user->tombstones.count, at = 0;
    struct tombstone **all = grab((count + 1) * sizeof *all), *stone;

    for (stone = user->stones; stone != NULL; stone = stone->next)
        all[at++] = stone;
    qsort(all, count, sizeof *all, by_age);
    user->stones_end = &user->stones;
    for (at = 0; at < count; at++) {
        *user->stones_end = all[at];
        user->stones_end = &all[at]->next;
    }
    *user->stones_end = NULL;
    free(all);
}

void tombstones_sort(struct core *c)
{
    for (size_t i = 0; i < c->user_count; i++)
        sort_stones(c->user_list[i]);
}

const struct user *user_listed(struct core *c, const struct reply *reply,
                               const struct user *asker, const char *name)
{
    if (name == NULL || strcmp(name, asker->name) == 0)
        return asker;
    if (asker->account->role != WIRE_ROLE_ADMIN) {
        answer_fail(c, reply, MODAL_DENIED, "user", NULL,
                    "what others have is an admin's to list");
        return NULL;
    }
    for (size_t i = 0; i < c->user_count; i++)
        if (strcmp(c->user_list[i]->name, name) == 0)
            return c->user_list[i];
    answer_fail(c, reply, MODAL_NOT_FOUND, "user", NULL, "no user \"%.60s\" has had jobs here",
                name);
    return NULL;
}

/* USER's oldest is forgotten. */
static void drop_oldest(struct user *user)
{
    struct tombstone *stone = user->stones;

    user->stones = stone->next;
    if (user->stones == NULL)
        user->stones_end = &user->stones;
    map_remove(&user->tombstones, map_hash_text(stone->key), stone);
    free(stone->key);
    free(stone);
}

void tombstones_trim(struct core *c, struct user *user, struct transaction *t)
{
    enum { A_TIME = 2 };        /* one comes: what is too many becomes less, in short steps */

    for (int n = 0; n < A_TIME && (int64_t)user->tombstones.count > c->settings.jobs_kept
                    && user->stones->committed; n++) {
        struct ledger_change *change = transaction_add(t, LEDGER_TOMBSTONE_DROP);
        change->tombstone = (struct tombstone_record) {
            .user = transaction_text(t, user->name),
            .key = transaction_text(t, user->stones->key) };
        drop_oldest(user);
    }
}

void tombstones_retain(struct core *c)
{
    int64_t before_ns = c->now.utc_ns - c->settings.tombstone_age_ns;
    bool aged = false;

    for (size_t i = 0; i < c->user_count; i++) {
        struct user *user = c->user_list[i];
        while (user->stones != NULL && user->stones->committed
               && user->stones->expired_ns < before_ns) {
            drop_oldest(user);
            aged = true;
        }
    }
    if (aged) {
        struct transaction *t = transaction_new();
        transaction_add(t, LEDGER_TOMBSTONES_PRUNE)->id = before_ns;
        core_commit(c, t);
    }
}

/* ---- shares ---------------------------------------------------------------------------------- */

/* The user's best job that is still to be started, stale entries dropped. */
static struct job *first_ready(struct core *c, struct user *user)
{
    const struct heap_item *least;

    while ((least = heap_least(&user->ready)) != NULL) {
        struct job *job = job_by_id(c, least->order);
        if (job != NULL && job->ready && job->state == JOB_QUEUED)
            return job;
        heap_pop(&user->ready);
    }
    return NULL;
}

/* of a user's first jobs, to find one for a worker that may not have all: a bound on the work */
enum { FITS_LOOKED_AT = 64 };

/* The best of USER's first jobs that the worker of SLOT, which is elsewhere, may have: those that
 * may not go to it wait for others, and not the others' behind them. */
static struct job *first_fit(struct core *c, struct user *user, int slot)
{
    const struct heap_item *best = NULL;
    struct job *found = NULL;

    for (size_t i = 0; i < user->ready.count && i < FITS_LOOKED_AT; i++) {
        const struct heap_item *item = &user->ready.items[i];
        struct job *job = job_by_id(c, item->order);

        if (job == NULL || !job->ready || job->state != JOB_QUEUED || !slot_fits(c, slot, job))
            continue;
        if (best != NULL
            && (item->key > best->key || (item->key == best->key && item->order > best->order)))
            continue;
        best = item;
        found = job;
    }
    return found;
}

/* USER's job for the worker of SLOT; NULL: none. */
static struct job *job_for(struct core *c, struct user *user, int slot)
{
    struct job *first = first_ready(c, user);

    return first == NULL || !slot_is_remote(slot) || slot_fits(c, slot, first)
               ? first : first_fit(c, user, slot);
}

static bool may_run(const struct core *c, struct user *user)
{
    const struct allowance *most = user->account == NULL ? NULL : &user->account->most;

    if (most == NULL)
        /* an account that was revoked: what it has queued still runs */
        return true;
    if (most->running > 0 && user->running >= most->running)
        return false;
    return !(most->cpu_s_day > 0 && user->cpu_day == c->now.utc_ns / DAY
             && user->cpu_s >= most->cpu_s_day);
}

static double share(const struct user *user)
{
    return quantum_s
           * (user->account != NULL && user->account->weight > 0 ? user->account->weight : 1);
}

/* (1) */
static double rounds_until(const struct user *user)
{
    return user->deficit >= 0 ? 0 : ceil(-user->deficit / share(user));
}

/* Whether the user has a job that may start now; who has none keeps no credit. */
static bool competes(struct core *c, struct user *user, int slot)
{
    if (job_for(c, user, slot) != NULL && may_run(c, user))
        return true;
    user->deficit = fmin(user->deficit, 0);
    return false;
}

/* ROUNDS pass: those who compete have their quanta, of others debts shrink. */
static void pass_rounds(struct core *c, double rounds)
{
    for (size_t n = 0; n < c->user_count; n++) {
        struct user *user = c->user_list[n];
        double deficit = user->deficit + rounds * share(user);
        user->deficit = user->competes ? deficit : fmin(deficit, 0);
    }
}

bool user_any_waits(struct core *c, int slot)
{
    bool any = false;

    for (size_t n = 0; n < c->user_count && !any; n++)
        any = competes(c, c->user_list[n], slot);
    return any;
}

struct job *user_next(struct core *c, int slot)
{
    struct user *best = NULL;
    struct job *job;
    double least = HUGE_VAL;

    for (size_t n = 0; n < c->user_count; n++) {
        struct user *user = c->user_list[(c->turn + n) % c->user_count];
        user->competes = competes(c, user, slot);
        if (user->competes && rounds_until(user) < least) {
            least = rounds_until(user);
            best = user;
        }
    }
    pass_rounds(c, least);
    if (best == NULL)
        return NULL;
    best->deficit -= best->cost_s;
    while (c->user_list[c->turn % c->user_count] != best)
        c->turn++;
    if (best->deficit < 0)
        c->turn++;                                 /* its turn ends when its credit does */
    job = job_for(c, best, slot);
    if (heap_least(&best->ready)->order == job->id)
        heap_pop(&best->ready);
    job->ready = false;                            /* of another, the entry is stale now */
    return job;
}

void user_worked(struct user *user, double s_byte)
{
    const double weight = user->work_s_byte > 0 ? cost_weight : 1;

    if (s_byte > 0)
        user->work_s_byte += weight * (s_byte - user->work_s_byte);
}

/* EXPECTED_S: what was taken for it when it started, which has been another mean than today's. */
void user_ran(struct core *c, struct user *user, double expected_s, double seconds, double cpu_s)
{
    int64_t day = c->now.utc_ns / DAY;

    user->deficit -= seconds - expected_s;
    if (user->deficit < deficit_least_s)
        user->deficit = deficit_least_s;
    user->cost_s += cost_weight * (seconds - user->cost_s);
    if (user->cost_s < cost_least_s)
        user->cost_s = cost_least_s;
    if (user->cpu_day != day)
        user->cpu_s = 0;
    user->cpu_day = day;
    user->cpu_s += cpu_s;
}

/* What the user's jobs took today, to go with the edge that ends an attempt: a restart goes
 * on counting. */
void user_note(struct user *user, struct transaction *t)
{
    char text[96];

    snprintf(text, sizeof text, "{\"day\":%lld,\"cpu_s\":%.17g}", (long long)user->cpu_day,
             user->cpu_s);
    transaction_add(t, LEDGER_NOTE_PUT)->note =
        (struct note_record) { "cpu", transaction_text(t, user->name), transaction_text(t, text) };
}

void user_load_note(struct core *c, const struct note_record *r)
{
    struct user *user = user_get(c, r->name);
    cJSON *object = NULL;
    double day = 0;

    if (json_read(r->text, strlen(r->text), &object, NULL) != MODAL_OK)
        return;
    json_get_number(object, "", "day", 0, 1e9, &day, NULL);
    json_get_number(object, "", "cpu_s", 0, 1e15, &user->cpu_s, NULL);
    user->cpu_day = (int64_t)day;
    cJSON_Delete(object);
}

/* ---- limits ---------------------------------------------------------------------------------- */

static bool over(struct core *c, const struct reply *reply, const char *limit, double most,
                 double used, double more, double retry_s)
{
    cJSON *detail;

    if (most <= 0 || used + more <= most)
        return false;
    detail = cJSON_CreateObject();
    cJSON_AddStringToObject(detail, "limit", limit);
    cJSON_AddNumberToObject(detail, "most", most);
    cJSON_AddNumberToObject(detail, "used", used);
    if (retry_s > 0)
        cJSON_AddNumberToObject(detail, "retry_after_s", retry_s);
    answer_fail(c, reply, MODAL_QUOTA, "", detail, "over your limit: %s at most %.15g, used %.15g",
                limit, most, used);
    return true;
}

bool user_quota(struct core *c, struct user *user, const struct reply *reply, int64_t more_jobs,
                int64_t more_bytes)
{
    const struct allowance *most = &user->account->most;
    int64_t day = DAY;
    double used_cpu = user->cpu_day == c->now.utc_ns / day ? user->cpu_s : 0;
    double tomorrow_s = (double)(day - c->now.utc_ns % day) / 1e9;

    return over(c, reply, "queued", (double)most->queued, (double)(user->queued), (double)more_jobs,
                1)
           || over(c, reply, "bytes", (double)most->bytes, (double)(user->bytes + user->beside),
                   (double)more_bytes, 0)
           || (more_jobs > 0 && most->cpu_s_day > 0 && used_cpu >= most->cpu_s_day
               && over(c, reply, "cpu_s_day", most->cpu_s_day, used_cpu, 1, tomorrow_s));
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

void users_done(struct core *c)
{
    for (size_t i = 0; i < c->user_count; i++)
        free_user(c->user_list[i]);
    map_done(&c->users);
    free(c->user_list);
    free(c->accounts);
}
