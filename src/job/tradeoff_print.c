/* tradeoff_print.c - see tradeoff_print.h; tested by tests/unit/job/test_tradeoff_identify.c */
#include "job/tradeoff_print.h"
#include <time.h>

enum modal_status tradeoff_print(const char *of, cJSON *reference, cJSON **settings,
                                 const struct ladder_rung *rungs, int count, int recommended,
                                 cJSON **out, struct modal_error *err)
{
    cJSON *doc = cJSON_CreateObject(), *list = NULL;

    if (doc == NULL) {
        cJSON_Delete(reference);
        for (int i = 0; i < count; i++)
            cJSON_Delete(settings[i]);
        return modal_fail(err, MODAL_NO_MEMORY, "tradeoff: no memory for the result");
    }
    cJSON_AddStringToObject(doc, "kind", "tradeoff");
    cJSON_AddStringToObject(doc, "of", of);
    cJSON_AddItemToObject(doc, "reference", reference);
    list = cJSON_AddArrayToObject(doc, "rungs");
    for (int i = 0; i < count; i++) {
        cJSON *rung = cJSON_CreateObject();
        cJSON_AddItemToObject(rung, "settings", settings[i]);
        json_set_number(rung, "error", rungs[i].error);
        json_set_number(rung, "seconds", rungs[i].seconds);
        cJSON_AddBoolToObject(rung, "pareto", rungs[i].pareto);
        cJSON_AddItemToArray(list, rung);
        settings[i] = NULL;
    }
    if (recommended >= 0)
        cJSON_AddNumberToObject(doc, "recommended", recommended);
    else
        cJSON_AddNullToObject(doc, "recommended");
    *out = doc;
    return MODAL_OK;
}

void tradeoff_report(const struct job_request *request, int i, int rungs)
{
    cJSON *event;

    if (request->progress == NULL)
        return;
    event = cJSON_CreateObject();
    json_set_number(event, "fraction", (double)i / rungs);
    cJSON_AddNumberToObject(event, "rung", i);
    cJSON_AddNumberToObject(event, "rungs", rungs);
    request->progress(request->context, event);
    cJSON_Delete(event);
}

double tradeoff_clock(void *context)
{
    struct timespec t;

    (void)context;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
