/* run.c - a kind of job as a verb: in this process, or by the daemon; the same document either
 * way */
#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "outcome.h"
#include "field.h"
#include "input.h"
#include "output.h"
#include "progress.h"
#include "remote.h"
#include "result_show.h"
#include "sweep_point.h"
#include "sweep_shares.h"
#include "verbs.h"
#include "whole_file.h"

enum { SECOND_NS = 1000000000 };    /* of struct timespec */

/*
 * A curve stops at its next point where it is asked to, and is what it has: by the first SIGINT or
 * SIGTERM, or at the limit.  Whoever asks twice means the process.
 */
static volatile sig_atomic_t stop_asked;

/* s that a point may take once a curve has been asked to stop at the limit. */
static const double POINT_S = 10;

static void ask_to_stop(int signal_number)
{
    (void)signal_number;
    stop_asked = 1;
}

static bool is_stopped(void *context)
{
    (void)context;
    return stop_asked != 0;
}

static void catch_signals(void)
{
    struct sigaction action = { .sa_handler = ask_to_stop, .sa_flags = SA_RESETHAND };

    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}

/*
 * The limit of a job in this process.  A stage of LAPACK's can be long and asks nobody whether to
 * stop: so a thread waits, and at the limit it says so and ends the process, as the daemon ends a
 * worker.
 */
struct limit {
    double seconds;                /* from the start on; < 0: none */
    bool keeps;                    /* a curve: it is asked first */
    bool run_limit, json;          /* which one was asked for; how to say that it passed */
    bool over;                     /* the job has ended */
    bool passed;                   /* a curve was asked to stop */
    pthread_mutex_t lock;
    pthread_cond_t ended;
    pthread_t thread;
};

/* Until the job has ended, or for SECONDS; the lock is held. */
static void wait_for_end(struct limit *limit, double seconds)
{
    struct timespec end;
    int rc = 0;

    clock_gettime(CLOCK_MONOTONIC, &end);
    end.tv_sec += (time_t)seconds;
    end.tv_nsec += (long)(1e9 * (seconds - floor(seconds)));
    if (end.tv_nsec >= SECOND_NS)
        end.tv_sec++, end.tv_nsec -= SECOND_NS;
    while (!limit->over && rc != ETIMEDOUT)
        rc = pthread_cond_timedwait(&limit->ended, &limit->lock, &end);
}

static void *watch_limit(void *context)
{
    struct limit *limit = context;
    struct modal_error err = { 0 };

    pthread_mutex_lock(&limit->lock);
    wait_for_end(limit, limit->seconds);
    if (!limit->over && limit->keeps) {
        limit->passed = true;
        stop_asked = 1;
        wait_for_end(limit, POINT_S);
    }
    if (!limit->over) {
        if (limit->run_limit)
            modal_fail(&err, MODAL_RUN_LIMIT, "the run limit of %g s passed", limit->seconds);
        else
            modal_fail(&err, MODAL_TIMEOUT, "not finished in %g s", limit->seconds);
        _exit(outcome_failure(limit->json, &err, NULL));
    }
    pthread_mutex_unlock(&limit->lock);
    return NULL;
}

static enum modal_status limit_begin(struct limit *limit, const struct args *args,
                                     struct modal_error *err)
{
    pthread_condattr_t monotonic;

    limit->run_limit = args->run_limit > 0
                       && (args->timeout < 0 || args->run_limit < args->timeout);
    limit->seconds = limit->run_limit ? args->run_limit : args->timeout;
    limit->json = args->json;
    limit->keeps = args->sweep != NULL || args->follow != NULL;
    if (limit->keeps)
        catch_signals();
    if (limit->seconds < 0)
        return MODAL_OK;
    pthread_mutex_init(&limit->lock, NULL);
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&limit->ended, &monotonic);
    pthread_condattr_destroy(&monotonic);
    if (pthread_create(&limit->thread, NULL, watch_limit, limit) == 0)
        return MODAL_OK;
    limit->seconds = -1;
    return modal_fail(err, MODAL_NO_MEMORY, "no thread to watch the limit");
}

/* The job has ended in time: nothing of its answer is said before this returns. */
static void limit_end(struct limit *limit)
{
    if (limit->seconds < 0)
        return;
    pthread_mutex_lock(&limit->lock);
    limit->over = true;
    pthread_cond_signal(&limit->ended);
    pthread_mutex_unlock(&limit->lock);
    pthread_join(limit->thread, NULL);
    pthread_cond_destroy(&limit->ended);
    pthread_mutex_destroy(&limit->lock);
}

static void print_progress(void *context, const cJSON *event)
{
    const cJSON *fraction = cJSON_GetObjectItemCaseSensitive(event, "fraction");

    (void)context;
    if (cJSON_IsNumber(fraction))
        progress_tell("running", fraction->valuedouble);
}

/* Whether RESULT is a curve's that was stopped: told, with the exit status in *STATUS. */
static void tell_stopped(const cJSON *result, bool passed, int *status)
{
    const cJSON *points = cJSON_GetObjectItemCaseSensitive(result, "points");

    if (strcmp(field_word(result, "reason", ""), JOB_STOPPED) != 0)
        return;
    fprintf(stderr, "modalctl: stopped%s: %d points are what there is\n",
            passed ? " by the limit of time" : "", cJSON_GetArraySize(points));
    *status = modal_status_exit(passed ? MODAL_TIMEOUT : MODAL_CANCELLED);
}

static enum modal_status run_here(const struct input *input, const struct args *args,
                                  struct job_result *out, int *status, struct modal_error *err)
{
    struct limit limit = { 0 };
    struct job_request request = {
        .kind = input->kind->name, .options = input->options,
        .batch = input->scene ? NULL : &input->batch, .scene = input->scene,
        .arrays = &input->arrays, .input_sha256 = input->sha256,
        .attributes = input->signals.attributes,
        .progress = print_progress, .cancelled = is_stopped,
    };
    enum modal_status rc = limit_begin(&limit, args, err);

    if (rc != MODAL_OK)
        return rc;
    rc = job_run(&request, out, err);
    limit_end(&limit);
    progress_end();
    if (rc == MODAL_CANCELLED && limit.passed)
        rc = modal_fail(err, MODAL_TIMEOUT, "not finished in %g s", limit.seconds);
    if (rc == MODAL_OK)
        tell_stopped(out->result, limit.passed, status);
    return rc;
}

/* What stands behind the verb: FILE, or for `tradeoff` OF FILE. */
static enum modal_status read_input(const struct verb *verb, const struct args *args,
                                    struct input *input, struct modal_error *err)
{
    bool tradeoff = strcmp(verb->name, "tradeoff") == 0;
    const char *of = tradeoff && args->words == 3 ? args->word[1] : NULL;

    if (strcmp(verb->name, "simulate") == 0 && args->output == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "output", "simulate needs -O FILE.h5 or "
                                "FILE.csv for its signals");
    enum modal_status rc = output_check(args->output, err);
    if (rc == MODAL_OK)
        rc = whole_file_check(args->output, "output", err);
    if (rc == MODAL_OK)
        rc = result_show_check(args, err);
    if (rc == MODAL_OK)
        rc = input_read(verb->name, of, args->word[args->words - 1], args, input, err);
    if (rc == MODAL_OK && args->sha256 != NULL && strcmp(args->sha256, input->sha256) != 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "file", "%.300s is not what it was when its "
                              "task was written", args->word[args->words - 1]);
    return rc;
}

static enum modal_status show(const struct args *args, const struct job_result *result,
                              const struct input *input, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (args->output != NULL)
        rc = output_write(args->output, result->result, &result->batch, err);
    if (rc == MODAL_OK)
        rc = result_show(args, result->result, input, err);
    if (rc == MODAL_OK && !args->json && args->output != NULL && result->batch.samples > 0)
        printf("\n%zu samples x %zu channels in %s\n", result->batch.samples,
               result->batch.channels, args->output);
    return rc;
}

static enum modal_status run_there(const struct input *input, const struct args *args,
                                   struct job_result *out, cJSON **detail, struct modal_error *err)
{
    bool shared = strcmp(input->kind->name, "sweep") == 0 && sweep_is_whole(args);

    return shared ? sweep_remote(input, args, out, detail, err)
                  : remote_run(input, args, out, detail, err);
}

int run_job(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    struct job_result result = { 0 };
    struct input input = { 0 };
    cJSON *detail = NULL;
    int stopped = 0, status;
    enum modal_status rc = read_input(verb, args, &input, &err);

    if (rc == MODAL_OK)
        rc = args->local ? run_here(&input, args, &result, &stopped, &err)
                         : run_there(&input, args, &result, &detail, &err);
    if (rc == MODAL_OK)
        rc = show(args, &result, &input, &err);
    status = rc == MODAL_OK ? sweep_exit(result.result)
                            : outcome_failure(args->json, &err, detail);
    status = status == 0 ? stopped : status;
    cJSON_Delete(detail);
    job_result_done(&result);
    input_done(&input);
    return status;
}
