/* job.c - the table of kinds, and the one way through it; see job.h */
#include "job/job.h"
#include "job/identify.h"
#include "job/scene_jobs.h"
#include "job/steady.h"
#include "job/sweep.h"
#include "job/tradeoff.h"
#include <cblas.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Kinds, each a file of this folder. */
const struct job_kind job_kinds[] = {
    { "identify", JOB_ON_BATCH, identify_run },
    { "tradeoff", JOB_ON_EITHER, tradeoff_run },
    { "simulate", JOB_ON_SCENE, simulate_run },
    { "floquet", JOB_ON_SCENE, floquet_run },
    { "steady", JOB_ON_SCENE, steady_run },
    { "ablate", JOB_ON_SCENE, ablate_run },
    { "sweep", JOB_ON_SCENE, sweep_run },
    { NULL, JOB_ON_BATCH, NULL },
};

const struct job_kind *job_kind_find(const char *name)
{
    for (const struct job_kind *kind = job_kinds; name != NULL && kind->name != NULL; kind++)
        if (strcmp(kind->name, name) == 0)
            return kind;
    return NULL;
}

static enum modal_status check_input(const struct job_kind *kind, const struct job_request *request, struct modal_error *err)
{
    bool has = kind->input == JOB_ON_BATCH ? request->batch != NULL
             : kind->input == JOB_ON_SCENE ? request->scene != NULL : request->batch != NULL || request->scene != NULL;

    if (!has)
        return modal_fail_field(err, MODAL_BAD_INPUT, "input", "a job of kind %s needs %s", kind->name,
                                kind->input == JOB_ON_BATCH ? "a batch of signals" : kind->input == JOB_ON_SCENE ? "a scene" : "a batch or a scene");
    if (request->options != NULL && !cJSON_IsObject(request->options))
        return modal_fail_field(err, MODAL_BAD_INPUT, "options", "options must be an object");
    return MODAL_OK;
}

enum modal_status job_run(const struct job_request *request, struct job_result *out, struct modal_error *err)
{
    const struct job_kind *kind = job_kind_find(request->kind);
    enum modal_status rc;

    memset(out, 0, sizeof *out);
    if (kind == NULL) {
        char list[256] = "";
        for (const struct job_kind *k = job_kinds; k->name != NULL; k++)
            snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s", k == job_kinds ? "" : ", ", k->name);
        return modal_fail_field(err, MODAL_BAD_INPUT, "kind", "unknown kind \"%.40s\"; accepted: %s", request->kind ? request->kind : "", list);
    }
    rc = check_input(kind, request, err);
    if (rc == MODAL_OK) {
        openblas_set_num_threads(1);      /* the same numbers everywhere; a kind with an option `threads` sets its own */
        rc = kind->run(request, out, err);
    }
    if (rc != MODAL_OK)
        job_result_done(out);
    return rc;
}

void job_result_done(struct job_result *result)
{
    cJSON_Delete(result->result);
    free(result->signals);
    for (size_t i = 0; result->names != NULL && i < result->batch.channels; i++)
        free(result->names[i]);
    free(result->names);
    memset(result, 0, sizeof *result);
}
