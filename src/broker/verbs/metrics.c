/* metrics.c - counts for STATS, and as Prometheus text for METRICS and the metrics file */
#include "broker/core/jobs.h"
#include "broker/core/slots.h"
#include "broker/verbs/verbs.h"
#include "job/job.h"
#include <assert.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* Of a user's ready jobs, a heap whose oldest are near its top but for their priorities. */
enum { LOOKED_AT = 64 };

static double oldest_s(const struct core *c, const struct user *only)
{
    int64_t oldest = 0;

    for (size_t i = 0; i < c->user_count; i++) {
        const struct heap *ready = &c->user_list[i]->ready;
        if (only != NULL && c->user_list[i] != only)
            continue;
        for (size_t n = 0; n < ready->count && n < LOOKED_AT; n++) {
            const struct job *job = job_by_id(c, ready->items[n].order);
            if (job != NULL && job->ready && (oldest == 0 || job->submitted_ns < oldest))
                oldest = job->submitted_ns;
        }
    }
    return oldest == 0 ? 0 : (double)(c->now.utc_ns - oldest) / 1e9;
}

/* What all queued jobs are expected to take, by the mean of each user's, or (ELSEWHERE) those that
 * may go to workers elsewhere: who sizes a pool reads it, and learns of nobody's jobs. */
static double expected_s(const struct core *c, bool elsewhere)
{
    double all_s = 0;

    for (size_t i = 0; i < c->user_count; i++) {
        const struct user *user = c->user_list[i];
        int64_t stay = elsewhere && !slots_link_pays(c, user) ? user->queued_large : 0;
        all_s += (double)(user->queued - stay) * user->cost_s;
    }
    return all_s;
}

void stats_write(const struct core *c, const struct user *user, bool all, cJSON *object)
{
    const int64_t *counts = all ? c->jobs->state_counts : user->states;
    int64_t uploads = 0, bytes = 0;
    int busy = 0, alive = 0;
    cJSON *jobs = cJSON_AddObjectToObject(object, "jobs"), *part;

    for (int s = 0; s < JOB_STATE_COUNT; s++)
        cJSON_AddNumberToObject(jobs, job_states[s], (double)counts[s]);
    part = cJSON_AddObjectToObject(object, "queue");
    cJSON_AddNumberToObject(part, "most", (double)c->settings.queue_jobs);
    cJSON_AddNumberToObject(part, "oldest_s", oldest_s(c, all ? NULL : user));
    cJSON_AddNumberToObject(part, "cpu_s", expected_s(c, false));
    cJSON_AddNumberToObject(part, "elsewhere_s", expected_s(c, true));
    for (int i = slot_after(c, -1); i >= 0; i = slot_after(c, i)) {
        const struct slot *s = &c->slots->at[i];
        busy += s->state == SLOT_BUSY;
        alive += s->state != SLOT_EMPTY && s->state != SLOT_STARTING;
    }
    part = cJSON_AddObjectToObject(object, "workers");
    cJSON_AddNumberToObject(part, "total", c->settings.workers);
    cJSON_AddNumberToObject(part, "alive", alive);
    cJSON_AddNumberToObject(part, "busy", busy);
    cJSON_AddNumberToObject(part, "elsewhere", workers_elsewhere(c));
    cJSON_AddNumberToObject(part, "deaths", (double)c->counts.deaths);
    for (size_t i = 0; i < c->user_count; i++)
        if (all || c->user_list[i] == user) {
            uploads += c->user_list[i]->open_count;
            bytes += c->user_list[i]->bytes;
        }
    part = cJSON_AddObjectToObject(object, "spool");
    cJSON_AddNumberToObject(part, "bytes", (double)bytes);
    cJSON_AddNumberToObject(part, "uploads", (double)uploads);
    part = cJSON_AddObjectToObject(object, "streams");
    cJSON_AddNumberToObject(part, "windows", (double)c->slots->windows);
    cJSON_AddNumberToObject(part, "skipped", (double)c->slots->windows_skipped);
    cJSON_AddNumberToObject(part, "waiting", (double)c->slots->due_count);
    part = cJSON_AddObjectToObject(object, "ledger");
    cJSON_AddNumberToObject(part, "transactions", (double)c->counts.commits);
    cJSON_AddNumberToObject(part, "changes", (double)c->counts.committed_changes);
    cJSON_AddNumberToObject(part, "waiting", (double)c->uncommitted);
    cJSON_AddNumberToObject(part, "events", (double)c->last_event);
    part = cJSON_AddObjectToObject(object, "rejects");
    for (int s = 0; s < MODAL_STATUS_COUNT; s++)
        if (c->counts.rejects[s] > 0)
            cJSON_AddNumberToObject(part, modal_status_code((enum modal_status)s),
                                    (double)c->counts.rejects[s]);
    cJSON_AddNumberToObject(object, "uptime_s",
                            (double)(c->now.mono_ns - c->counts.started_ns) / 1e9);
    cJSON_AddBoolToObject(object, "draining", c->draining || c->terminating);
    cJSON_AddBoolToObject(object, "storage_full", c->disk.full);
}

enum { SERIES_MOST = 32 };    /* users with lines of their own: a page stays short with many */

enum { LINE_MOST = 512 };     /* of one put: names, a help and a number */

struct page { char *text; size_t size, room; };

static void put(struct page *p, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void put(struct page *p, const char *format, ...)
{
    va_list args;
    int n;

    if (p->room - p->size < LINE_MOST) {
        p->room = p->room ? 2 * p->room : 8192;
        p->text = regrab(p->text, p->room);
    }
    va_start(args, format);
    n = vsnprintf(p->text + p->size, p->room - p->size, format, args);
    va_end(args);
    p->size += (size_t)n < p->room - p->size ? (size_t)n : p->room - p->size - 1;
}

static void head(struct page *p, const char *name, const char *type, const char *help)
{
    put(p, "# HELP modald_%s %s\n# TYPE modald_%s %s\n", name, help, name, type);
}

static void one(struct page *p, const char *name, const char *type, const char *help, double value)
{
    head(p, name, type, help);
    put(p, "modald_%s %.17g\n", name, value);
}

static void histogram(struct page *p, const char *name, const char *help, const struct histogram *h,
                      const double bounds[HISTOGRAM_BUCKETS])
{
    int64_t below = 0;

    head(p, name, "histogram", help);
    for (int i = 0; i < HISTOGRAM_BUCKETS; i++)
        put(p, "modald_%s_bucket{le=\"%g\"} %lld\n", name, bounds[i],
            (long long)(below += h->counts[i]));
    put(p, "modald_%s_bucket{le=\"+Inf\"} %lld\n", name, (long long)h->count);
    put(p, "modald_%s_sum %.17g\nmodald_%s_count %lld\n", name, h->sum, name, (long long)h->count);
}

static void kinds(struct page *p, const struct core *c)
{
    static_assert((int)JOB_KIND_COUNT <= (int)JOB_KINDS_MOST, "kind_counts has a place for each");

    head(p, "jobs_kind", "gauge", "Jobs in the ledger by kind.");
    for (int k = 0; k < JOB_KIND_COUNT; k++)
        put(p, "modald_jobs_kind{kind=\"%s\"} %lld\n", job_kinds[k].name,
            (long long)c->jobs->kind_counts[k]);
}

static double cpu_today(const struct core *c, const struct user *user)
{
    return user->cpu_day == c->now.utc_ns / DAY ? user->cpu_s : 0;
}

static double stored(const struct core *c, const struct user *user)
{
    (void)c;
    return (double)user->bytes;
}

typedef double reading(const struct core *c, const struct user *user);

/* USER among the COUNT greatest of TOP, in descending order; who has no place there: the one that
 * leaves, or USER. */
static const struct user *insert(const struct core *c, reading *value, const struct user **top,
                                 size_t *count, const struct user *user)
{
    const struct user *last = *count == SERIES_MOST ? top[SERIES_MOST - 1] : NULL;
    size_t at = *count;

    while (at > 0 && value(c, top[at - 1]) < value(c, user))
        at--;
    if (at == SERIES_MOST)
        return user;
    *count += *count < SERIES_MOST;
    memmove(top + at + 1, top + at, (*count - 1 - at) * sizeof *top);
    top[at] = user;
    return last;
}

/* The users with the greatest values, the rest as "other", which a user of that name is part of;
 * of ONLY alone where there is one. */
static void per_user(struct page *p, const struct core *c, const char *name, const char *help,
                     reading *value, const struct user *only)
{
    const struct user *top[SERIES_MOST], *left;
    size_t count = 0, others = 0;
    double rest = 0;

    head(p, name, "gauge", help);
    for (size_t i = 0; i < c->user_count; i++) {
        const struct user *user = c->user_list[i];
        if (only != NULL && user != only)
            continue;
        left = only == NULL && strcmp(user->name, "other") == 0
                   ? user
                   : insert(c, value, top, &count, user);
        rest += left != NULL ? value(c, left) : 0;
        others += left != NULL;
    }
    for (size_t i = 0; i < count; i++)
        put(p, "modald_%s{user=\"%s\"} %.17g\n", name, top[i]->name, value(c, top[i]));
    if (others > 0)
        put(p, "modald_%s{user=\"other\"} %.17g\n", name, rest);
}

/* Bytes of inputs and results, of all users. */
static int64_t stored_in_all(const struct core *c)
{
    int64_t bytes = 0;

    for (size_t i = 0; i < c->user_count; i++)
        bytes += c->user_list[i]->bytes;
    return bytes;
}

static void values(struct page *p, const struct core *c)
{
    static const char GAUGE[] = "gauge", COUNTER[] = "counter";
    const struct counts *n = &c->counts;
    const struct { const char *name, *type, *help; double value; } rows[] = {
        { "replay_seconds", GAUGE, "What the start took to read the ledger.", n->replay_s },
        { "attempts_total", COUNTER, "Attempts of jobs begun.", (double)n->attempts },
        { "leases_lost_total", COUNTER, "Workers that fell silent.", (double)n->leases_lost },
        { "received_bytes_total", COUNTER, "Bytes of requests' bodies.", (double)n->bytes_in },
        { "sent_bytes_total", COUNTER, "Bytes of replies.", (double)n->bytes_out },
        { "queue_oldest_seconds", GAUGE,
          "Age of the oldest job that is ready to start.", oldest_s(c, NULL) },
        { "workers", GAUGE, "Worker processes wanted.", c->settings.workers },
        { "workers_elsewhere", GAUGE, "Workers of other hosts that have joined.",
          workers_elsewhere(c) },
        { "workers_busy", GAUGE, "Workers with a job.", workers_busy(c) },
        { "worker_deaths_total", COUNTER,
          "Workers that ended while they had a job.", (double)n->deaths },
        { "connections", GAUGE, "Connections of clients.", (double)n->connections },
        { "connections_refused_total", COUNTER,
          "Connections closed as they came, being one too many, or before they spoke, in favour "
          "of another.", (double)n->connections_refused },
        { "connections_ended_total", COUNTER,
          "Connections ended for what they sent: not ZMTP 3, or more than messages hold.",
          (double)n->connections_ended },
        { "hangups_kept_total", COUNTER,
          "Hang-ups not heard at once, the requests before them being still to be taken.",
          (double)n->hangups_kept },
        { "transactions_total", COUNTER, "Ledger transactions asked for.", (double)n->commits },
        { "changes_total", COUNTER, "Ledger changes committed.", (double)n->committed_changes },
        { "transactions_waiting", GAUGE,
          "Transactions not yet on stable storage.", (double)c->uncommitted },
        { "replies_total", COUNTER, "Replies sent, without errors.", (double)n->replies },
        { "stored_bytes", GAUGE, "Bytes of inputs and results.", (double)stored_in_all(c) },
        { "upload_bytes_waiting", GAUGE,
          "Bytes of chunks not yet on stable storage.", (double)inputs_in_flight(c) },
        { "windows_total", COUNTER, "Live windows that a worker was given.",
          (double)c->slots->windows },
        { "windows_skipped_total", COUNTER,
          "Live windows left out, for their turn had not come before the next was due.",
          (double)c->slots->windows_skipped },
        { "windows_waiting", GAUGE, "Streams whose window is due and waits for a worker.",
          (double)c->slots->due_count },
        { "credit_stalls_total", COUNTER,
          "Chunks and pushes refused as beyond the credit.", (double)n->credit_stalls },
        { "ledger_bytes", GAUGE,
          "Bytes of the ledger and its log on disk, at the last commit.", (double)n->ledger_bytes },
        { "events_total", COUNTER, "Numbered events.", (double)c->last_event },
        { "draining", GAUGE, "1 while no job starts.", c->draining || c->terminating },
        { "storage_full", GAUGE, "1 while submits are refused for want of disk.", c->disk.full },
        { "uptime_seconds", GAUGE,
          "Seconds since the start.", (double)(c->now.mono_ns - n->started_ns) / 1e9 },
    };

    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        one(p, rows[i].name, rows[i].type, rows[i].help, rows[i].value);
}

static void histograms(struct page *p, const struct counts *n)
{
    histogram(p, "submit_seconds", "From a submission's arrival to its acknowledgement.",
              &n->submit_seconds, histogram_seconds);
    histogram(p, "commit_seconds", "A group of the ledger: its transaction and its sync.",
              &n->commit_seconds, histogram_seconds);
    histogram(p, "commit_transactions", "Transactions in a group.", &n->commit_transactions,
              histogram_numbers);
    histogram(p, "write_seconds", "A group of chunks: written, hashed and synced.",
              &n->write_seconds, histogram_seconds);
}

static void states(struct page *p, const struct core *c)
{
    head(p, "jobs", "gauge", "Jobs in the ledger by state.");
    for (int s = 0; s < JOB_STATE_COUNT; s++)
        put(p, "modald_jobs{state=\"%s\"} %lld\n", job_states[s],
            (long long)c->jobs->state_counts[s]);
}

static void rejects(struct page *p, const struct core *c)
{
    head(p, "rejects_total", "counter", "Requests answered by an error, by code.");
    for (int s = 1; s < MODAL_STATUS_COUNT; s++)
        put(p, "modald_rejects_total{code=\"%s\"} %lld\n", modal_status_code((enum modal_status)s),
            (long long)c->counts.rejects[s]);
}

struct blob *metrics_text(const struct core *c, const struct user *user)
{
    struct page p = { NULL, 0, 0 };

    head(&p, "build_info", "gauge", "Version of the daemon.");
    put(&p, "modald_build_info{version=\"%s\"} 1\n", MODALD_VERSION);
    states(&p, c);
    kinds(&p, c);
    histograms(&p, &c->counts);
    values(&p, c);
    rejects(&p, c);
    per_user(&p, c, "user_cpu_seconds",
             "CPU-seconds of jobs today, of the users with the most; the rest as other.", cpu_today,
             user);
    per_user(&p, c, "user_stored_bytes",
             "Bytes of inputs and results, of the users with the most; the rest as other.", stored,
             user);
    return blob_take(p.text, p.size);
}
