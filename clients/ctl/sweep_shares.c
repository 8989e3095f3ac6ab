/* sweep_shares.c - see sweep_shares.h
 *
 * Shares are those of the job's options `first` and `count` (job/sweep.h).  How a grid is cut
 * depends on its size alone, and a share's key on the document, the options, the version and the
 * share, so that the same sweep meets the same jobs from anywhere at any time.  A key whose job
 * ended without a result is spent (a job's end never changes): the next round, the number at the
 * key's end, takes its place.
 */
#include "sweep_shares.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "outcome.h"
#include "field.h"
#include "job/sweep.h"
#include "base/sha256.h"
#include "sweep_whole.h"
#include "terminal.h"
#include "verbs.h"
#include "wire/protocol.h"

enum {
    SHARES_MOST = 64,                     /* jobs: enough for every worker a share, few for a
                                             queue */
    ROUNDS_MOST = 1000,                   /* of asking: a share that never ends is a fault */
    STEM_MOST = WIRE_KEY_MOST - 24        /* bytes of a key before the share and the try in it */
};

struct grid {
    const struct input *input;
    const struct args *args;
    struct link *link;
    double deadline;
    char stem[STEM_MOST + 1];            /* what the keys of all shares begin with */
    int points, shares;
    struct sweep_whole whole;
    cJSON *docs[SHARES_MOST];            /* the shares' queue documents */
};

/* The first point of share I; of I = shares, the number of points. */
static int first_of(const struct grid *g, int i)
{
    return (int)((long long)g->points * i / g->shares);
}

static void add_text(struct sha256 *s, const char *text)
{
    sha256_add(s, text, strlen(text) + 1);
}

/* The user's key, or one of the content. */
static enum modal_status set_stem(struct grid *g, struct modal_error *err)
{
    char hex[65], *options = json_print(g->input->options);
    struct sha256 hash;
    uint8_t digest[32];

    if (options == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "sweep: out of memory");
    sha256_init(&hash);
    add_text(&hash, MODALD_VERSION);
    add_text(&hash, g->input->sha256);
    add_text(&hash, options);
    sha256_end(&hash, digest);
    sha256_hex(digest, hex);
    free(options);
    if (g->args->key != NULL && strlen(g->args->key) > STEM_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "key",
                                "the key of a sweep has at most %d bytes", STEM_MOST);
    snprintf(g->stem, sizeof g->stem, "%s%s", g->args->key ? "" : "sweep-",
             g->args->key ? g->args->key : hex);
    return MODAL_OK;
}

static void set_key(const struct grid *g, int i, int round, const char *before,
                    char key[WIRE_KEY_MOST + 8])
{
    snprintf(key, WIRE_KEY_MOST + 8, "%s%s:%d:%d", before, g->stem, first_of(g, i), round);
}

/* Checks the document here, where its points are counted. */
static enum modal_status grid_open(struct grid *g, const struct input *input,
                                   const struct args *args, struct modal_error *err)
{
    struct sweep *s = NULL;
    enum modal_status rc = sweep_new(input->scene, &s, err);

    *g = (struct grid) { .input = input, .args = args, .deadline = remote_deadline(args),
                         .whole.as_text = sweep_whole_as_text(args) };
    if (rc != MODAL_OK)
        return rc;
    g->points = sweep_points(s);
    g->shares = g->points < SHARES_MOST ? g->points : SHARES_MOST;
    sweep_free(s);
    rc = set_stem(g, err);
    return rc == MODAL_OK ? remote_open(args, &g->link, err) : rc;
}

static void grid_close(struct grid *g)
{
    for (int i = 0; i < g->shares; i++)
        cJSON_Delete(g->docs[i]);
    sweep_whole_done(&g->whole);
    link_close(g->link);
}

/* May the same be asked again later?  Then the time until later has passed. */
static bool waited(enum modal_status rc, const cJSON *detail, double deadline)
{
    double s = client_pause(detail);
    struct timespec t = { (time_t)s, (long)(1e9 * (s - floor(s))) };

    if (rc != MODAL_BUSY && (rc != MODAL_QUOTA || !cJSON_HasObjectItem(detail, "retry_after_s")))
        return false;
    if (link_now() + s > deadline)
        return false;
    nanosleep(&t, NULL);
    return true;
}

/* One SUBMIT under KEY, repeated while the daemon is full. */
static enum modal_status submit_key(struct grid *g, const cJSON *options, const char *key,
                                    cJSON **doc, cJSON **detail, struct modal_error *err)
{
    struct client_input in = remote_input(g->input);
    struct client_job job = remote_job(g->input, g->args, key);
    enum modal_status rc;

    job.options = options;
    for (;;) {
        rc = client_submit(g->link, &job, &in, NULL, remote_answer_by(g->deadline), doc, detail,
                           err);
        if (rc == MODAL_OK || !waited(rc, *detail, g->deadline))
            return rc;
        cJSON_Delete(*detail);
        *detail = NULL;
    }
}

/* Share I: the job of its last round, where that runs or has a result; else one of the next. */
static enum modal_status submit_share(struct grid *g, int i, cJSON **detail,
                                      struct modal_error *err)
{
    cJSON *options = cJSON_Duplicate(g->input->options, true);
    char key[WIRE_KEY_MOST + 8];
    enum modal_status rc = MODAL_OK;
    bool spent = true;

    cJSON_AddNumberToObject(options, "first", first_of(g, i));
    cJSON_AddNumberToObject(options, "count", first_of(g, i + 1) - first_of(g, i));
    for (int round = 0; round < ROUNDS_MOST && spent; round++) {
        cJSON *doc = NULL;
        set_key(g, i, round, "", key);
        rc = submit_key(g, options, key, &doc, detail, err);
        spent = rc == MODAL_EXPIRED
                || (rc == MODAL_OK
                    && cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(doc, "duplicate"))
                    && client_ended(doc) && strcmp(field_word(doc, "state", ""), "done") != 0);
        if (spent) {
            cJSON_Delete(doc);
            cJSON_Delete(*detail);
            *detail = NULL;
        } else {
            g->docs[i] = doc;
        }
    }
    cJSON_Delete(options);
    return rc == MODAL_OK && spent
               ? modal_fail_field(err, MODAL_TOO_LARGE, "key",
                                  "%d rounds of share %d were broken off", ROUNDS_MOST, i)
               : rc;
}

static enum modal_status submit_shares(struct grid *g, cJSON **detail, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < g->shares && rc == MODAL_OK; i++)
        rc = submit_share(g, i, detail, err);
    return rc;
}

/* End what has not ended; a failure leaves the rest to run, which harms nobody. */
static void cancel_shares(struct grid *g)
{
    for (int i = 0; i < g->shares; i++) {
        cJSON *doc = NULL, *detail = NULL;
        struct modal_error unsaid;
        if (g->docs[i] == NULL || client_ended(g->docs[i]))
            continue;
        if (client_do(g->link, "CANCEL", field_word(g->docs[i], "job", ""),
                      remote_answer_by(g->deadline), &doc, &detail, &unsaid)
            == MODAL_OK) {
            cJSON_Delete(g->docs[i]);
            g->docs[i] = doc;
        }
        cJSON_Delete(detail);
    }
}

/* ------------------------------------------------------------------ waiting and putting
 * together */

struct shown { int done, shares; };

static void print_progress(void *context, const char *what, double fraction)
{
    struct shown *shown = context;

    (void)what;
    fprintf(terminal_stderr(), "\rsweep    %3.0f %% \r",
            100 * (shown->done + fraction) / shown->shares);
}

/* Until share I has ended, with its result in its document. */
static enum modal_status wait_share(struct grid *g, int i, cJSON **detail, struct modal_error *err)
{
    struct shown shown = { i, g->shares };
    struct client_progress progress = { print_progress, &shown };
    char job[160];
    cJSON *doc = NULL;
    enum modal_status rc;

    snprintf(job, sizeof job, "%s", field_word(g->docs[i], "job", ""));
    rc = client_wait(g->link, job, isatty(STDERR_FILENO) ? &progress : NULL, g->deadline, &doc,
                     detail, err);
    if (doc != NULL) {
        cJSON_Delete(g->docs[i]);
        g->docs[i] = doc;
    }
    if (rc == MODAL_OK)
        rc = remote_job_error(g->docs[i], detail, err);
    return rc == MODAL_OK
               ? remote_add_result(g->link, g->docs[i], remote_answer_by(g->deadline), detail, err)
               : rc;
}

enum modal_status sweep_remote(const struct input *input, const struct args *args,
                               struct job_result *out, cJSON **detail, struct modal_error *err)
{
    struct grid g;
    enum modal_status rc = grid_open(&g, input, args, err);

    if (rc == MODAL_OK)
        rc = submit_shares(&g, detail, err);
    for (int i = 0; i < g.shares && rc == MODAL_OK; i++) {
        rc = wait_share(&g, i, detail, err);
        if (rc == MODAL_OK)
            sweep_whole_add(&g.whole, cJSON_DetachItemFromObjectCaseSensitive(g.docs[i], "result"));
        else if (client_ended(g.docs[i]) && strcmp(field_word(g.docs[i], "state", ""), "done") != 0)
            cancel_shares(&g);
    }
    if (rc == MODAL_OK)
        rc = sweep_whole_end(&g.whole, g.points, &out->result, err);
    grid_close(&g);
    return rc;
}

bool sweep_is_whole(const struct args *args)
{
    return !cJSON_HasObjectItem(args->options, "first")
           && !cJSON_HasObjectItem(args->options, "count");
}

/* ------------------------------------------------------------------ without waiting */

/* Share I's job of its last round, where there is one. */
static enum modal_status find_share(struct grid *g, int i, cJSON **detail, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int round = 0; round < ROUNDS_MOST && rc == MODAL_OK; round++) {
        char key[WIRE_KEY_MOST + 8];
        cJSON *doc = NULL;
        set_key(g, i, round, "key:", key);
        rc = client_do(g->link, "STATUS", key, remote_answer_by(g->deadline), &doc, detail, err);
        if (rc == MODAL_OK) {
            cJSON_Delete(g->docs[i]);
            g->docs[i] = doc;
        } else if (rc == MODAL_EXPIRED) {
            cJSON_Delete(*detail);
            *detail = NULL;
            rc = MODAL_OK;
        }
    }
    return rc == MODAL_NOT_FOUND ? MODAL_OK : rc;
}

static enum modal_status cancel_found(struct grid *g, cJSON **detail, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    int found = 0;

    /* the last first: they have not begun */
    for (int i = g->shares - 1; i >= 0 && rc == MODAL_OK; i--) {
        rc = find_share(g, i, detail, err);
        found += g->docs[i] != NULL;
    }
    if (rc == MODAL_OK && found == 0)
        return modal_fail(err, MODAL_NOT_FOUND, "this sweep has no jobs on the server");
    if (rc == MODAL_OK) {
        cJSON_Delete(*detail);
        *detail = NULL;
        cancel_shares(g);
    }
    return rc;
}

/* {"kind", "key", "points", "done": points of done shares, "jobs": queue documents} */
static enum modal_status print_shares(struct grid *g, struct modal_error *err)
{
    cJSON *answer = cJSON_CreateObject(), *jobs;
    enum modal_status rc = MODAL_OK;
    int done = 0;

    for (int i = 0; i < g->shares; i++)
        if (strcmp(field_word(g->docs[i], "state", ""), "done") == 0)
            done += first_of(g, i + 1) - first_of(g, i);
    cJSON_AddStringToObject(answer, "kind", "sweep");
    cJSON_AddStringToObject(answer, "key", g->stem);
    cJSON_AddNumberToObject(answer, "points", g->points);
    cJSON_AddNumberToObject(answer, "done", done);
    jobs = cJSON_AddArrayToObject(answer, "jobs");
    for (int i = 0; i < g->shares; i++)
        if (g->docs[i] != NULL)
            cJSON_AddItemReferenceToArray(jobs, g->docs[i]);
    if (g->args->json)
        rc = outcome_json(answer, err);
    else
        printf("%d of %d points done, %d jobs from %s on; `modalctl sweep FILE --wait` gives the "
               "table\n",
               done, g->points, cJSON_GetArraySize(jobs), field_word(jobs->child, "job", ""));
    cJSON_Delete(answer);
    return rc;
}

int sweep_submit(const struct args *args)
{
    struct modal_error err = { 0 };
    struct input input = { 0 };
    struct grid g = { 0 };
    cJSON *detail = NULL;
    int status;
    enum modal_status rc = args->local ? modal_fail_field(
                               &err, MODAL_BAD_INPUT, "local",
                               "--cancel speaks of a daemon's queue; --local has none")
                                       : MODAL_OK;

    if (rc == MODAL_OK)
        rc = input_read("sweep", NULL, args->word[1], args, &input, &err);
    if (rc == MODAL_OK)
        rc = grid_open(&g, &input, args, &err);
    if (rc == MODAL_OK)
        rc = args->cancel ? cancel_found(&g, &detail, &err) : submit_shares(&g, &detail, &err);
    if (rc == MODAL_OK)
        rc = print_shares(&g, &err);
    status = rc == MODAL_OK ? 0 : outcome_failure(args->json, &err, detail);
    cJSON_Delete(detail);
    grid_close(&g);
    input_done(&input);
    return status;
}
