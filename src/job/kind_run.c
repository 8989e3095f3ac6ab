/* kind_run.c - see kind_run.h; tested by tests/unit/job/test_scene_jobs.c */
#include "job/kind_run.h"
#include <cblas.h>
#include <stdlib.h>
#include <string.h>
#include "job/steady_settings.h"

enum modal_status kind_run(kind_function *run, const struct job_request *request,
                           struct job_result *out, struct modal_error *err)
{
    enum modal_status rc = request->scene != NULL ? steady_settings_keys(request->scene, err)
                                                  : MODAL_OK;

    memset(out, 0, sizeof *out);
    if (rc == MODAL_OK) {
        openblas_set_num_threads(1);
        rc = run(request, out, err);
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
