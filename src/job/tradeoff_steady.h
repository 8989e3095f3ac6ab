/* tradeoff_steady.h - steady states: error against time over orders, samples, methods and time
 * integration */
#ifndef JOB_TRADEOFF_STEADY_H
#define JOB_TRADEOFF_STEADY_H
#include "base/key_table.h"
#include "job/job.h"

/* Its options. */
extern const struct key_row tradeoff_steady_rows[];

/* `tradeoff` of `steady` on REQUEST's scene.  A scene without laws has one rung. */
enum modal_status tradeoff_steady(const struct job_request *request, struct job_result *out,
                                  struct modal_error *err);
#endif
