/* identify_job.h - the kind `identify`: the result document of contracts.md */
#ifndef JOB_IDENTIFY_JOB_H
#define JOB_IDENTIFY_JOB_H
#include "job/identify_options.h"
#include "job/job.h"

/* What a live result tells of the document: {"kind","modes","stability","diagnostics"}. */
cJSON *identify_modes_write(const struct identify_result *result);

/* The kind: options of REQUEST->options, the document into OUT->result. */
enum modal_status identify_run(const struct job_request *request, struct job_result *out,
                               struct modal_error *err);

/* The same with options read before: SETTINGS are those of REQUEST->options. */
enum modal_status identify_by(const struct identify_settings *settings,
                              const struct job_request *request, struct job_result *out,
                              struct modal_error *err);
#endif
