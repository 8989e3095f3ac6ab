/* remote.h - modalctl and the daemon: the link the arguments name, jobs through it, documents
 * said */
#ifndef CTL_REMOTE_H
#define CTL_REMOTE_H
#include "client.h"
#include "input.h"

/* The link to the server of ARGS. */
enum modal_status remote_open(const struct args *args, struct link **out, struct modal_error *err);
/* link_now() + --timeout; INFINITY without one. */
double remote_deadline(const struct args *args);
/* --timeout bounds the waiting for a job, not the asking: what is answered at once (a
 * submission, a state, a result that is there) has these seconds in any case. */
#define REMOTE_ANSWER_S 10
double remote_answer_by(double deadline);
/* Progress on stderr, as progress.h says. */
const struct client_progress *remote_progress(void);

/* INPUT as the client library takes it, and what ARGS say of the job; KEY NULL: that of ARGS. */
struct client_input remote_input(const struct input *input);
struct client_job remote_job(const struct input *input, const struct args *args, const char *key);

/* Like job_run, through the server of ARGS.  On failure *DETAIL may hold the error's detail, the
 * caller's. */
enum modal_status remote_run(const struct input *input, const struct args *args,
                             struct job_result *out, cJSON **detail, struct modal_error *err);

/* The error of an ended job's document into ERR and *DETAIL; MODAL_OK where it is done. */
enum modal_status remote_job_error(const cJSON *doc, cJSON **detail, struct modal_error *err);
/* Add "result" to a done job's document. */
enum modal_status remote_add_result(struct link *link, cJSON *doc, double deadline, cJSON **detail,
                                    struct modal_error *err);
/* LENGTH bytes at *BYTES, which are moved, with their DESCRIPTION as the batch of OUT. */
enum modal_status remote_batch(const cJSON *description, char **bytes, size_t length,
                               struct job_result *out, struct modal_error *err);
/* Fetch the signals of JOB (`simulate`) into OUT. */
enum modal_status remote_signals(struct link *link, const char *job, double deadline,
                                 struct job_result *out, cJSON **detail, struct modal_error *err);
#endif
