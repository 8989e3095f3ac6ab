/* index.c - jobs by their number */
#include "broker/core/jobs.h"

struct job *job_by_id(const struct core *c, int64_t id)
{
    return map_find_number(&c->jobs->all, (uint64_t)id);
}
