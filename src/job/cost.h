/* cost.h - what a job cost, stage by stage, and where its result comes from: `cost` and
 * `provenance` of every result */
#ifndef JOB_COST_H
#define JOB_COST_H
#include "job/job.h"

/* Twice the most that a kind names. */
enum { COST_STAGES_MOST = 24 };

struct cost {
    double wall, cpu;                        /* clocks at the start */
    double mark;                             /* cpu at the last stage's end */
    int stages;
    struct { const char *name; double seconds; } stage[COST_STAGES_MOST];
};

/* Processor seconds of this process so far. */
double cost_cpu_s(void);

/* The clocks of C from here on; no stage yet. */
void cost_start(struct cost *c);
/* What was done since the last mark belongs to stage NAME (a literal); a name that comes again adds
 * up. */
void cost_stage(struct cost *c, const char *name);
/* {"wall_s", "cpu_s", "stages": {...}, "peak_bytes"} up to now, the caller's. */
cJSON *cost_print(const struct cost *c);

/*
 * {"version", "options", "input_sha256", "host", "threads", "blas_core", "attributes" or "units"}.
 * OPTIONS (after defaults) becomes the document's; NULL: {}.
 */
cJSON *provenance_print(const struct job_request *request, cJSON *options);

#endif
