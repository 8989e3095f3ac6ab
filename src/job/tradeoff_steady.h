/* tradeoff_steady.h - steady states: error against time over orders, samples, methods and time integration */
#ifndef JOB_TRADEOFF_STEADY_H
#define JOB_TRADEOFF_STEADY_H
#include "job/job.h"

/* Options: target.error, target.seconds, repetitions, stability (taken and ignored).  A scene without laws has one rung. */
enum modal_status tradeoff_steady(const struct job_request *request, struct job_result *out, struct modal_error *err);
#endif
