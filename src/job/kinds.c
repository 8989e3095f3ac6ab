/* kinds.c - the table of kinds; see job.h; tested by tests/unit/job/test_job_options.c */
#include <string.h>
#include "job/job.h"

const struct job_kind job_kinds[] = {
    [JOB_IDENTIFY] = { "identify", JOB_ON_BATCH }, [JOB_TRADEOFF] = { "tradeoff", JOB_ON_EITHER },
    [JOB_SIMULATE] = { "simulate", JOB_ON_SCENE },
    [JOB_FLOQUET] = { "floquet", JOB_ON_SCENE }, [JOB_STEADY] = { "steady", JOB_ON_SCENE },
    [JOB_ABLATE] = { "ablate", JOB_ON_SCENE },
    [JOB_SWEEP] = { "sweep", JOB_ON_SCENE },        [JOB_KIND_COUNT] = { NULL, JOB_ON_BATCH },
};

const struct job_kind *job_kind_find(const char *name)
{
    for (const struct job_kind *kind = job_kinds; name != NULL && kind->name != NULL; kind++)
        if (strcmp(kind->name, name) == 0)
            return kind;
    return NULL;
}

void job_kinds_accepted(const char *name, char out[NEAR_ACCEPTED])
{
    const char *names[JOB_KIND_COUNT + 1];

    for (int i = 0; i <= JOB_KIND_COUNT; i++)
        names[i] = job_kinds[i].name;                   /* the last row's is NULL */
    near_accepted(name, names, out);
}
