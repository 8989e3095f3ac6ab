/* fuzz_steady.c - any bytes as a scene of a few dofs: solved, refused or ended in the midst of it,
 * never NaN as converged */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "job/job.h"

static double pick(const uint8_t **data, size_t *size)
{
    static const double of[] = { 0,   1,    -1,  0.5, 2, 10,    0.1,  1e-3,
                                 1e3, 1e-8, 1e8, 0.3, 3, 1e-30, 1e30, 7.7 };

    if (*size == 0)
        return 1;
    (*size)--;
    return of[*(*data)++ % 16];
}

static const char *const forms[] = {
    "{\"type\":\"friction\",\"dof\":\"x1\",\"to\":\"x2\",\"stiffness\":%g,\"limit\":%g}",
    "{\"type\":\"gap\",\"dof\":\"x1\",\"stiffness\":%g,\"clearance\":%g}",
    "{\"type\":\"cubic_spring\",\"dof\":\"x2\",\"coefficient\":%g}",
    "{\"type\":\"polynomial_damper\",\"dof\":\"x1\",\"coefficients\":[%g,%g]}",
    "{\"type\":\"coulomb\",\"dof\":\"x1\",\"limit\":%g}",
    "{\"type\":\"regularised_coulomb\",\"dof\":\"x1\",\"limit\":%g,\"velocity\":%g}",
    "{\"type\":\"gap\",\"dof\":\"x2\",\"stiffness\":%g,\"clearance\":%g,\"dissipation\":0.5,"
    "\"both_sides\":true}",
    "{\"type\":\"contact_friction\",\"normal\":\"x1\",\"tangential\":\"x2\","
    "\"normal_stiffness\":%g,\"preload\":%g,\"tangential_stiffness\":1,\"mu\":0.3}"
};

/* Questions whether to go on until the answer is no: what converges by the first way in has asked
 * fewer, and a search through all ways ten thousand. */
enum { QUESTIONS = 100 };

/* Has the search of DATA its whole budget?  It takes a hundred times as long: one input in 256, by
 * the sum of its bytes. */
static bool is_patient(const uint8_t *data, size_t size)
{
    unsigned char sum = 0;

    for (size_t i = 0; i < size; i++)
        sum += data[i];
    return sum == 0;
}

static bool cancelled(void *left)
{
    return left != NULL && (*(int *)left)-- <= 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char text[2048], effect[300];
    struct modal_error err;
    struct job_result out;
    cJSON *scene = NULL;
    size_t at;
    int effects = size > 0 ? data[0] % 3 : 0, left = QUESTIONS;
    bool patient = is_patient(data, size);

    if (size > 64)
        return 0;
    data += size > 0;
    size -= size > 0;
    at = (size_t)snprintf(text, sizeof text,
                          "{\"structure\":{\"type\":\"matrices\",\"M\":[[%g,0],[0,1]],\"C\":"
                          "[[%g,0],[0,0.1]],\"K\":[[%g,-1],[-1,%g]]},\"omega\":%g,\"effects\":[",
                          pick(&data, &size), pick(&data, &size), pick(&data, &size),
                          pick(&data, &size), fabs(pick(&data, &size)));
    for (int i = 0; i <= effects; i++) {
        size_t which = size > 0 ? *data % 8 : 0;

        data += size > 0;
        size -= size > 0;
        snprintf(effect, sizeof effect, forms[which], pick(&data, &size), pick(&data, &size));
        at += (size_t)snprintf(text + at, sizeof text - at, "%s%s", i ? "," : "", effect);
    }
    snprintf(text + at, sizeof text - at,
             "],\"excitation\":[{\"dof\":\"x1\",\"k\":1,\"cos\":%g},{\"dof\":\"x2\",\"k\":2,"
             "\"sin\":%g}],\"steady\":{\"harmonics\":5,\"max_iterations\":20}}",
             pick(&data, &size), pick(&data, &size));
    if (json_read(text, strlen(text), &scene, &err) != MODAL_OK)
        return 0;
    if (job_run(&(struct job_request) { .kind = "steady", .scene = scene, .cancelled = cancelled,
                                        .context = patient ? NULL : &left },
                &out, &err) == MODAL_OK) {
        const cJSON *row, *x;

        if (cJSON_IsTrue(cJSON_GetObjectItem(out.result, "converged")))
            cJSON_ArrayForEach(row, cJSON_GetObjectItem(out.result, "harmonics"))
                cJSON_ArrayForEach(x, cJSON_GetObjectItem(row, "re"))
                    if (!cJSON_IsNumber(x) || !isfinite(x->valuedouble))
                        abort();
        job_result_done(&out);
    }
    cJSON_Delete(scene);
    return 0;
}
