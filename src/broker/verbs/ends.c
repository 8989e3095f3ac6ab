/* ends.c - what becomes of an attempt whose worker ended under it */
#include "broker/core/jobs.h"
#include "broker/core/slots.h"
#include "broker/verbs/verbs.h"
#include "wire/protocol.h"
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>

/* Its worker died under it, or was lost where it is ELSEWHERE: again, or dead. */
static void crashed(struct core *c, struct job *job, const struct remote *elsewhere, int status,
                    const char *stderr_text)
{
    struct modal_error err;

    job->crashes++;
    if (elsewhere != NULL)
        modal_fail(&err, MODAL_WORKER_DIED, "the worker %s on %s was lost in attempt %d",
                   elsewhere->name, elsewhere->node, job->attempts);
    else if (WIFSIGNALED(status))
        modal_fail(&err, MODAL_WORKER_DIED, "the worker died of signal %d in attempt %d",
                   WTERMSIG(status), job->attempts);
    else
        modal_fail(&err, MODAL_WORKER_DIED, "the worker ended with status %d in attempt %d",
                   WEXITSTATUS(status), job->attempts);
    if (job->crashes >= job->max_attempts) {
        job->stderr_text = grab_text(stderr_text != NULL ? stderr_text : "");
        job_fail(c, job, JOB_DEAD, &err, NULL);
        return;
    }
    job_move(c, job, JOB_QUEUED, NULL);
    core_timer(c, c->now.mono_ns + (SECOND / 2 << (job->crashes - 1)), TIMER_START, job->id, 0);
}

/* It would have none in another attempt either: as where the worker can say so itself. */
static void without_memory(struct core *c, struct job *job)
{
    struct modal_error err;
    char limit[96] = "";

    if (c->settings.worker_memory > 0)
        snprintf(limit, sizeof limit, "; a worker has at most %lld bytes (worker_memory)",
                 (long long)c->settings.worker_memory);
    modal_fail(&err, MODAL_NO_MEMORY, "the worker had no memory for a document in attempt %d%s",
               job->attempts, limit);
    job_fail(c, job, JOB_FAILED, &err, NULL);
}

void attempt_ended(struct core *c, struct job *job, enum ending ending,
                   const struct remote *elsewhere, int status, const char *stderr_text)
{
    struct modal_error err;

    switch (ending) {
    case ENDING_CANCEL:
        modal_fail(&err, MODAL_CANCELLED, "cancelled while it ran");
        job_fail(c, job, JOB_CANCELLED, &err, NULL);
        break;
    case ENDING_RUN_LIMIT:
        modal_fail(&err, MODAL_RUN_LIMIT, "attempt %d passed its run limit of %.17g s%s",
                   job->attempts,
                   (double)(job->run_limit_ns > 0 ? job->run_limit_ns
                                                  : c->settings.run_limit_ns) / 1e9,
                   job->run_limit_ns > 0 ? "" : ", which the daemon's configuration sets where "
                                                "a job names none (run_limit_s)");
        job_fail(c, job, JOB_FAILED, &err, NULL);
        break;
    case ENDING_DEADLINE:
        modal_fail(&err, MODAL_DEADLINE, "the deadline passed while the job ran");
        job_fail(c, job, JOB_FAILED, &err, NULL);
        break;
    default:
        if (elsewhere == NULL && WIFEXITED(status)
            && WEXITSTATUS(status) == WIRE_WORKER_NO_MEMORY) {
            without_memory(c, job);
            break;
        }
        crashed(c, job, elsewhere, status, stderr_text);
    }
}

void exit_log(struct core *c, int slot, int status, const char *stderr_text)
{
    /* bytes: the reason stands at the end, and a line is read by people */
    enum { SAID_MOST = 1023 };
    size_t length = stderr_text == NULL ? 0 : strlen(stderr_text);

    core_log(c, "level=warning event=worker_exit slot=%d status=%d said=\"%s\"", slot, status,
             length == 0 ? "" : stderr_text + (length > SAID_MOST ? length - SAID_MOST : 0));
}
