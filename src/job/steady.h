/* steady.h - kind `steady`: one steady state, or a curve of them; its options are those of
 * steady_settings.h */
#ifndef JOB_STEADY_H
#define JOB_STEADY_H
#include "job/job.h"

/* The kind: REQUEST's scene, the document into OUT->result. */
enum modal_status steady_run(const struct job_request *request, struct job_result *out,
                             struct modal_error *err);

#endif
