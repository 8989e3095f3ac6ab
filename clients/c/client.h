/* client.h - the verbs of proto/PROTOCOL.md on a link: documents as cJSON, inputs as they lie
 *
 * Each call ends by DEADLINE (link_now() + s; INFINITY: no bound).  Fails as link_question does,
 * with the daemon's own errors besides; *DETAIL (may be NULL) is then the error's detail or
 * untouched.
 */
#ifndef CLIENT_CLIENT_H
#define CLIENT_CLIENT_H
#include "link.h"
#include "modal/batch.h"

/* What a job runs on: a batch, or a scene's JSON text with what stands behind it.  All
 * borrowed. */
struct client_input {
    const struct batch *batch;       /* NULL: a scene */
    const cJSON *attributes;         /* of a batch; or NULL */
    const char *scene;
    size_t scene_length;             /* bytes; 0: all of the text */
    const char *sha256;              /* identity in hex (store/identity.h); NULL: is computed */
    const char *upload;              /* what the daemon, which has it, calls it; NULL: it has not */
};

struct client_job {
    const char *kind;
    const cJSON *options;            /* object, or NULL */
    const char *key;                 /* NULL: none; then a lost answer is MODAL_NO_SERVER */
    double priority;                 /* < 0: the daemon's default */
    double run_limit, deadline;      /* s; 0: none */
    bool fresh;                      /* not from another job's result */
};

/* Told now and then while something long goes on; may be NULL. */
struct client_progress {
    void (*tell)(void *context, const char *what, double fraction);
    void *context;
};

/* Bring INPUT (any size) into the daemon's spool; its upload id into ID.  Resumes and deduplicates
 * by the identity. */
enum modal_status client_upload(struct link *link, const struct client_input *input,
                                const struct client_progress *progress, double deadline,
                                char id[128], cJSON **detail, struct modal_error *err);

/* Submit JOB on INPUT; inputs over WIRE_INLINE_MOST are uploaded first.  The queue document is the
 * caller's. */
enum modal_status client_submit(struct link *link, const struct client_job *job,
                                const struct client_input *input,
                                const struct client_progress *progress, double deadline,
                                cJSON **doc, cJSON **detail, struct modal_error *err);

/* The header of a SUBMIT whose input is INPUT itself in the body (UPLOAD NULL) or upload UPLOAD:
 * for pipelines. */
cJSON *client_submit_header(const struct client_job *job, const struct client_input *input,
                            const char *upload);

/* The bytes an input has on the wire, and where they lie. */
const void *client_input_bytes(const struct client_input *input, size_t *length);

/* VERB (STATUS, CANCEL, RETRY, DELETE) of JOB: its queue document, the caller's. */
enum modal_status client_do(struct link *link, const char *verb, const char *job, double deadline,
                            cJSON **doc, cJSON **detail, struct modal_error *err);

/* Until JOB has ended.  MODAL_TIMEOUT at DEADLINE; *DOC is the last document seen, or NULL, in
 * every case. */
enum modal_status client_wait(struct link *link, const char *job,
                              const struct client_progress *progress, double deadline, cJSON **doc,
                              cJSON **detail, struct modal_error *err);

/* Seconds after which what was refused with DETAIL may be asked again: as it says, 0.01 to 5. */
double client_pause(const cJSON *detail);

/* Has the job of the queue document DOC ended, well or not? */
bool client_ended(const cJSON *doc);

/* PART ("document", "batch", "input", "stderr") of JOB, whole, a 0 behind it, the caller's;
 * *DESCRIPTION (may be NULL) of a batch. */
enum modal_status client_result(struct link *link, const char *job, const char *part,
                                double deadline, char **bytes, size_t *length, cJSON **description,
                                cJSON **detail, struct modal_error *err);

/* The bytes of the caller's sealed input UPLOAD, whole; as client_result. */
enum modal_status client_stored(struct link *link, const char *upload, double deadline,
                                char **bytes, size_t *length, cJSON **description, cJSON **detail,
                                struct modal_error *err);

/* Ask VERB with HEADER (taken over): the answer's header, and its body as text where there is
 * one; both the caller's. */
enum modal_status client_ask(struct link *link, const char *verb, cJSON *header, double deadline,
                             cJSON **answer, char **body, cJSON **detail, struct modal_error *err);

#endif
