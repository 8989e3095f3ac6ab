/* tradeoff.c - see tradeoff.h */
#include "job/tradeoff.h"
#include "job/tradeoff_identify.h"
#include "job/tradeoff_simulate.h"
#include "job/tradeoff_steady.h"
#include <stdio.h>
#include <string.h>
#include <time.h>

/* What can be traded off: each a file tradeoff_*.c of this folder. */
static const struct tradeoff {
    const char *of;
    bool on_scene;
    enum modal_status (*run)(const struct job_request *, struct job_result *, struct modal_error *);
} tradeoffs[] = {
    { "identify", false, tradeoff_identify },
    { "steady", true, tradeoff_steady },
    { "simulate", true, tradeoff_simulate },
    { NULL, false, NULL },
};

static enum modal_status refuse(const char *of, bool on_scene, struct modal_error *err)
{
    char list[128] = "";

    for (const struct tradeoff *t = tradeoffs; t->of != NULL; t++)
        if (t->on_scene == on_scene)
            snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s", list[0] ? ", " : "",
                     t->of);
    return modal_fail_field(err, MODAL_BAD_INPUT, "of",
                            "cannot trade off \"%.40s\" on a %s; accepted: %s", of,
                            on_scene ? "scene" : "batch", list);
}

enum modal_status tradeoff_run(const struct job_request *request, struct job_result *out,
                               struct modal_error *err)
{
    bool on_scene = request->batch == NULL;
    const char *of = on_scene ? "steady" : "identify";
    enum modal_status rc = json_get_string(request->options, "", "of", &of, err);

    if (rc != MODAL_OK)
        return rc;
    for (const struct tradeoff *t = tradeoffs; t->of != NULL; t++)
        if (t->on_scene == on_scene && strcmp(t->of, of) == 0)
            return t->run(request, out, err);
    return refuse(of, on_scene, err);
}

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

void tradeoff_tell(const struct job_request *request, int i, int rungs)
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
