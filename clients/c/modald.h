/* modald.h - a small client of modald: connect, upload, submit, wait, result, cancel
 *
 * Connections are made and made again in the background; no call blocks longer than the `timeout`
 * it is given [s].  Every call returns an exit status of modalctl: 0 done, 1 the job failed, 2 bad
 * input, 3 no server, 4 refused, 5 not finished in time; then `error` (may be NULL) says why, with
 * the stable code of the protocol.  Documents are JSON text, as modalctl --json prints it; the
 * caller frees it with modald_free.  One thread a connection at a time.
 * No server ends the process, and one that says more than a call takes is hung up on; between calls
 * nobody counts what it says: where it is not trusted with your memory, disconnect after each.
 */
#ifndef MODALD_H
#define MODALD_H
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* As the exit status of modalctl. */
enum modald_outcome {
    MODALD_DONE = 0,
    MODALD_FAILED = 1,       /* the job: see its error */
    MODALD_BAD_INPUT = 2,    /* this side refuses it, or the daemon does */
    MODALD_NO_SERVER = 3,    /* nobody answers there */
    MODALD_REFUSED = 4,      /* a limit, or no permission */
    MODALD_NOT_YET = 5       /* the time to wait is over, the job is not */
};

struct modald_error {
    char code[32];              /* "bad_input", "busy", ... */
    char field[128];            /* what is at fault: an option, an attribute, a path; or "" */
    char message[512];
    double retry_after;         /* s; 0: the daemon did not say */
};

/* Signals at equal steps: sample k of channel s is signals[k * channels + s]. */
struct modald_batch {
    const double *signals;
    size_t samples, channels;
    double dt, period;          /* s; period 0: not a periodic system */
    const char *const *names;   /* `channels` names, or NULL */
    const char *units;          /* or NULL */
};

/* All zero: an identify job with the defaults. */
struct modald_job {
    const char *kind;           /* NULL: "identify" */
    const char *options;        /* a JSON object, or NULL */
    const char *key;            /* your name for it: the same key is the same job; NULL: none */
    int priority;               /* 1 .. 255, higher is more urgent; 0: the default, 100 */
    double run_limit, deadline; /* s; 0: none */
};

struct modald;                  /* a connection */

/* Begin a connection, *OUT.  ENDPOINT NULL: $MODALD_URL, else /run/modald/modald.ipc, else the same
 * under $XDG_RUNTIME_DIR.  KEYFILE NULL: $MODALD_KEYFILE, else none.  Does not wait for the daemon:
 * the first question finds out. */
int modald_connect(const char *endpoint, const char *keyfile, struct modald **out,
                   struct modald_error *error);

/* End it; NULL is fine. */
void modald_disconnect(struct modald *connection);

/* Put JOB on a BATCH on the queue; *DOCUMENT: {"job","key","kind","state",...}. */
int modald_submit(struct modald *connection, const struct modald_job *job,
                  const struct modald_batch *batch, double timeout, char **document,
                  struct modald_error *error);

/* The same on a SCENE, JSON text. */
int modald_submit_scene(struct modald *connection, const struct modald_job *job, const char *scene,
                        double timeout, char **document, struct modald_error *error);

/* Bring a batch that several jobs will share; its identity, 64 hex digits and a 0, into SHA256. */
int modald_upload(struct modald *connection, const struct modald_batch *batch, double timeout,
                  char sha256[65], struct modald_error *error);

/* The queue document of JOB, an id or "key:K", into *DOCUMENT. */
int modald_status(struct modald *connection, const char *job, double timeout, char **document,
                  struct modald_error *error);

/* End JOB; its queue document then, into *DOCUMENT. */
int modald_cancel(struct modald *connection, const char *job, double timeout, char **document,
                  struct modald_error *error);

/* Wait until JOB has ended.  0: done; 1 or 2: as the job failed; 5: not yet.  *DOCUMENT is set in
 * these cases. */
int modald_wait(struct modald *connection, const char *job, double timeout, char **document,
                struct modald_error *error);

/* A done job's result into *RESULT, to the byte what the worker wrote. */
int modald_result(struct modald *connection, const char *job, double timeout, char **result,
                  struct modald_error *error);

/* All of it: submit, wait, result. */
int modald_run(struct modald *connection, const struct modald_job *job,
               const struct modald_batch *batch, double timeout, char **result,
               struct modald_error *error);

/* The id of a queue document into ID of SIZE bytes; 0, or 2 where there is none. */
int modald_job_id(const char *document, char *id, size_t size);

/* Free a document or a result; NULL is fine. */
void modald_free(char *text);

#ifdef __cplusplus
}
#endif
#endif
