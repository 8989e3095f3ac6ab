/* kind_run.h - a kind's function on a request, as job_run and the kinds that run others call it */
#ifndef JOB_KIND_RUN_H
#define JOB_KIND_RUN_H
#include "job/job.h"

typedef enum modal_status kind_function(const struct job_request *request, struct job_result *out,
                                        struct modal_error *err);

/*
 * RUN on REQUEST, whose input and options the caller has seen to be of RUN's kind.  Before it the
 * scene's `steady` has no unknown key, and BLAS one thread, whatever ran before: the same numbers
 * everywhere; a kind with threads of its own sets them.  *OUT is empty where it fails, else the
 * caller's (job_result_done).
 */
enum modal_status kind_run(kind_function *run, const struct job_request *request,
                           struct job_result *out, struct modal_error *err);
#endif
