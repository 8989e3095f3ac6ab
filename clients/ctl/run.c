/* run.c - a kind of job as a verb: in this process, or by the daemon; the same document either
 * way */
#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "outcome.h"
#include "input.h"
#include "output.h"
#include "remote.h"
#include "result_show.h"
#include "sweep_point.h"
#include "sweep_shares.h"
#include "verbs.h"

enum { SECOND_NS = 1000000000 };    /* of struct timespec */

/*
 * The limit of a job in this process.  A stage of LAPACK's can be long and asks nobody whether to
 * stop: so a thread waits, and at the limit it says so and ends the process, as the daemon ends a
 * worker.
 */
struct limit {
    double seconds;                /* from the start on; < 0: none */
    bool run_limit, json;          /* which one was asked for; how to say that it passed */
    bool over;                     /* the job has ended */
    pthread_mutex_t lock;
    pthread_cond_t ended;
    pthread_t thread;
};

static void *watch_limit(void *context)
{
    struct limit *limit = context;
    struct modal_error err = { 0 };
    struct timespec end;
    int rc = 0;

    clock_gettime(CLOCK_MONOTONIC, &end);
    end.tv_sec += (time_t)limit->seconds;
    end.tv_nsec += (long)(1e9 * (limit->seconds - floor(limit->seconds)));
    if (end.tv_nsec >= SECOND_NS)
        end.tv_sec++, end.tv_nsec -= SECOND_NS;
    pthread_mutex_lock(&limit->lock);
    while (!limit->over && rc != ETIMEDOUT)
        rc = pthread_cond_timedwait(&limit->ended, &limit->lock, &end);
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
        fprintf(stderr, "\r%3.0f %%\r", 100 * fraction->valuedouble);
}

static enum modal_status run_here(const struct input *input, const struct args *args,
                                  struct job_result *out, struct modal_error *err)
{
    struct limit limit = { 0 };
    struct job_request request = {
        .kind = input->kind->name, .options = input->options,
        .batch = input->scene ? NULL : &input->batch, .scene = input->scene,
        .input_sha256 = input->sha256, .attributes = input->signals.attributes,
        .progress = isatty(STDERR_FILENO) ? print_progress : NULL,
    };
    enum modal_status rc = limit_begin(&limit, args, err);

    if (rc != MODAL_OK)
        return rc;
    rc = job_run(&request, out, err);
    limit_end(&limit);
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
        rc = output_check_place(args->output, "output", err);
    if (rc == MODAL_OK)
        rc = result_show_check(args, err);
    return rc != MODAL_OK
               ? rc
               : input_read(verb->name, of, args->word[args->words - 1], args, input, err);
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
    enum modal_status rc = read_input(verb, args, &input, &err);

    if (rc == MODAL_OK)
        rc = args->local ? run_here(&input, args, &result, &err)
                         : run_there(&input, args, &result, &detail, &err);
    if (rc == MODAL_OK)
        rc = show(args, &result, &input, &err);
    int status = rc == MODAL_OK ? sweep_exit(result.result)
                                : outcome_failure(args->json, &err, detail);
    cJSON_Delete(detail);
    job_result_done(&result);
    input_done(&input);
    return status;
}
