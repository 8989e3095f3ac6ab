/* remote.h - a job by the daemon: upload, submit, wait, fetch */
#ifndef CTL_REMOTE_H
#define CTL_REMOTE_H
#include "input.h"

/* Like job_run, through the server of ARGS.  On failure *DETAIL may hold the error's detail, the caller's. */
enum modal_status remote_run(const struct input *input, const struct args *args, struct job_result *out,
                             cJSON **detail, struct modal_error *err);
#endif
