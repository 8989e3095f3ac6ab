/* cost.c - see cost.h; tested by tests/unit/job/test_scene_jobs.c */
#include "job/cost.h"
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>
#include "job/blas_core.h"

static double seconds(clockid_t clock)
{
    struct timespec t;

    clock_gettime(clock, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

double cost_cpu_s(void)
{
    return seconds(CLOCK_PROCESS_CPUTIME_ID);
}

void cost_start(struct cost *c)
{
    memset(c, 0, sizeof *c);
    c->wall = seconds(CLOCK_MONOTONIC);
    c->cpu = c->mark = cost_cpu_s();
}

void cost_stage(struct cost *c, const char *name)
{
    double now = cost_cpu_s();
    int i = 0;

    while (i < c->stages && strcmp(c->stage[i].name, name) != 0)
        i++;
    if (i == c->stages && c->stages < COST_STAGES_MOST) {
        c->stage[i].name = name;
        c->stage[c->stages++].seconds = 0;
    }
    if (i < c->stages)
        c->stage[i].seconds += now - c->mark;
    c->mark = now;
}

cJSON *cost_print(const struct cost *c)
{
    cJSON *cost = cJSON_CreateObject(), *stages;
    struct rusage use;

    json_set_number(cost, "wall_s", seconds(CLOCK_MONOTONIC) - c->wall);
    json_set_number(cost, "cpu_s", cost_cpu_s() - c->cpu);
    stages = cJSON_AddObjectToObject(cost, "stages");
    for (int i = 0; i < c->stages; i++)
        json_set_number(stages, c->stage[i].name, c->stage[i].seconds);
    getrusage(RUSAGE_SELF, &use);
    json_set_number(cost, "peak_bytes", 1024.0 * (double)use.ru_maxrss);
    return cost;
}

cJSON *provenance_print(const struct job_request *request, cJSON *options)
{
    cJSON *p = cJSON_CreateObject();
    const cJSON *units = request->scene != NULL
                             ? cJSON_GetObjectItemCaseSensitive(request->scene, "units")
                             : NULL;
    const cJSON *threads = cJSON_GetObjectItemCaseSensitive(options, "threads");
    char host[256] = "";

    gethostname(host, sizeof host - 1);
    cJSON_AddStringToObject(p, "version", MODALD_VERSION);
    cJSON_AddItemToObject(p, "options", options != NULL ? options : cJSON_CreateObject());
    if (request->input_sha256 != NULL)
        cJSON_AddStringToObject(p, "input_sha256", request->input_sha256);
    cJSON_AddStringToObject(p, "host", host);
    cJSON_AddNumberToObject(p, "threads", cJSON_IsNumber(threads) ? threads->valuedouble : 1);
    cJSON_AddStringToObject(p, "blas_core", blas_core_name());
    if (request->attributes != NULL)
        cJSON_AddItemToObject(p, "attributes", cJSON_Duplicate(request->attributes, 1));
    if (cJSON_IsString(units))
        cJSON_AddStringToObject(p, "units", units->valuestring);
    return p;
}
