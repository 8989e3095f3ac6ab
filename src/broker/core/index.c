/* index.c - jobs by their number */
#include "broker/core/jobs.h"

static bool has_id(const void *value, const void *key)
{
    return ((const struct job *)value)->id == *(const int64_t *)key;
}

struct job *job_by_id(const struct core *c, int64_t id)
{
    return map_find(&c->jobs->all, map_hash_number((uint64_t)id), has_id, &id);
}
