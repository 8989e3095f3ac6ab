/* sweep_shares.h - a sweep by the daemon: shares of its points as jobs over all workers, put
 * together into one table */
#ifndef CTL_SWEEP_SHARES_H
#define CTL_SWEEP_SHARES_H
#include "remote.h"

/* Are all points meant, not the share of `-o first= count=`? */
bool sweep_is_whole(const struct args *args);
/*
 * Like remote_run, for all points of the document INPUT: finds or submits the shares' jobs, waits
 * for all.  The result is that of one job, its cost summed over the shares.  A share that ends
 * without a result ends the sweep with its error, and the other shares are cancelled;
 * MODAL_TIMEOUT, MODAL_NO_SERVER leave them running.
 */
enum modal_status sweep_remote(const struct input *input, const struct args *args,
                               struct job_result *out, cJSON **detail, struct modal_error *err);
/* Submit the shares, or with --cancel end them, and say their queue documents; the exit status. */
int sweep_submit(const struct args *args);
#endif
