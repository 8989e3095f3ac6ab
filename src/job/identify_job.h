/* identify_job.h - the kind `identify`: the result document of contracts.md */
#ifndef JOB_IDENTIFY_JOB_H
#define JOB_IDENTIFY_JOB_H
#include "job/job.h"
#include "modal/identify/identify.h"

/* What a live result tells of the document: {"kind","modes","stability","diagnostics"}. */
cJSON *identify_modes_write(const struct identify_result *result);

enum modal_status identify_run(const struct job_request *request, struct job_result *out, struct modal_error *err);
#endif
