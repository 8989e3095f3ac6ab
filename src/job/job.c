/* job.c - the one way to every kind's function; see job.h;
 * tested by tests/unit/job/test_job_identify.c */
#include "job/job.h"
#include "job/identify_job.h"
#include "job/kind_run.h"
#include "job/scene_jobs.h"
#include "job/steady.h"
#include "job/sweep.h"
#include "job/tradeoff.h"
#include <stdio.h>
#include <string.h>

/* Each a file of this folder. */
static kind_function *const runs[JOB_KIND_COUNT] = {
    [JOB_IDENTIFY] = identify_run, [JOB_TRADEOFF] = tradeoff_run, [JOB_SIMULATE] = simulate_run,
    [JOB_FLOQUET] = floquet_run,
    [JOB_STEADY] = steady_run,     [JOB_ABLATE] = ablate_run,     [JOB_SWEEP] = sweep_run,
};

static enum modal_status check_input(const struct job_kind *kind, const struct job_request *request,
                                     struct modal_error *err)
{
    bool has = kind->input == JOB_ON_BATCH   ? request->batch != NULL
               : kind->input == JOB_ON_SCENE ? request->scene != NULL
                                             : request->batch != NULL || request->scene != NULL;

    if (!has)
        return modal_fail_field(err, MODAL_BAD_INPUT, "input", "a job of kind %s needs %s",
                                kind->name,
                                kind->input == JOB_ON_BATCH   ? "a batch of signals"
                                : kind->input == JOB_ON_SCENE ? "a scene"
                                                              : "a batch or a scene");
    if (request->options != NULL && !cJSON_IsObject(request->options))
        return modal_fail_field(err, MODAL_BAD_INPUT, "options", "options must be an object");
    return MODAL_OK;
}

enum modal_status job_run(const struct job_request *request, struct job_result *out,
                          struct modal_error *err)
{
    const struct job_kind *kind = job_kind_find(request->kind);
    enum modal_status rc;

    memset(out, 0, sizeof *out);
    if (kind == NULL) {
        char list[NEAR_ACCEPTED];
        job_kinds_accepted(request->kind ? request->kind : "", list);
        return modal_fail_field(err, MODAL_BAD_INPUT, "kind", "unknown kind \"%.40s\"%s",
                                request->kind ? request->kind : "", list);
    }
    rc = check_input(kind, request, err);
    return rc == MODAL_OK ? kind_run(runs[kind - job_kinds], request, out, err) : rc;
}
