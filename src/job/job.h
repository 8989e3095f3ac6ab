/* job.h - one job as a pure function: (kind, options, input) -> result
 *
 * The seam of the house: the worker, `modalctl --local` and the tests all call job_run, so that
 * what is tested in process is what the service runs.  JSON in, JSON out; no files, no sockets, no
 * clock but the one that measures cost.
 */
#ifndef JOB_JOB_H
#define JOB_JOB_H
#include <stdbool.h>
#include "modal/batch.h"
#include "base/error.h"
#include "base/json.h"
#include "base/near.h"

struct scene_arrays;

/* More than any machine's processors that a job is counted for. */
enum { JOB_THREADS_MOST = 1024 };

/* The `reason` of a curve that was cancelled. */
#define JOB_STOPPED "stopped before its end"

struct job_request {
    const char *kind;             /* a name of job_kinds */
    const cJSON *options;         /* object, or NULL for none */
    const struct batch *batch;    /* kinds on signals; borrowed */
    const cJSON *scene;           /* kinds on a scene; borrowed */
    const struct scene_arrays *arrays;   /* behind its text (scene_arrays.h); NULL: none */
    const char *input_sha256;     /* hex, for provenance; NULL: unknown */
    const cJSON *attributes;      /* of the batch: returned as provenance; may be NULL */

    /* Called between units of work, from the calling thread; each may be NULL. */
    void (*progress)(void *context, const cJSON *event);   /* {"fraction":…, …}; borrowed */
    /* true: stop soon with MODAL_CANCELLED; a curve that has points with those, `complete` false
     * and `reason` JOB_STOPPED */
    bool (*cancelled)(void *context);
    void *context;
};

/* Is REQUEST to stop? */
static inline bool job_cancelled(const struct job_request *request)
{
    return request->cancelled != NULL && request->cancelled(request->context);
}

struct job_result {
    cJSON *result;                /* the document of contracts.md */
    struct batch batch;           /* simulate: the signals, in what follows; samples 0: none */
    double *signals;
    char **names;
};

/*
 * Run REQUEST.  Every option's key is checked and every default written back into
 * result.provenance.options.  On failure *OUT is empty and ERR says why; MODAL_BAD_INPUT always
 * names a field.  job_result_done frees what job_run filled.
 */
enum modal_status job_run(const struct job_request *request, struct job_result *out,
                          struct modal_error *err);
void job_result_done(struct job_result *result);

/* The kinds: NULL-named row ends the table.  They stand in a file of their own, kinds.c, so that
 * the broker knows them without the numerics, their libraries and the memory of those. */
struct job_kind {
    const char *name;
    enum { JOB_ON_BATCH, JOB_ON_SCENE, JOB_ON_EITHER } input;
};
/* rows */
enum {
    JOB_IDENTIFY,
    JOB_TRADEOFF,
    JOB_SIMULATE,
    JOB_FLOQUET,
    JOB_STEADY,
    JOB_ABLATE,
    JOB_SWEEP,
    JOB_KIND_COUNT
};
extern const struct job_kind job_kinds[];
const struct job_kind *job_kind_find(const char *name);   /* NULL: no such kind */
/* How a message ends that refuses NAME: near_accepted of all kinds. */
void job_kinds_accepted(const char *name, char out[NEAR_ACCEPTED]);

#endif
