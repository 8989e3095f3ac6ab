/* tradeoff_identify.h - identify's error against its time on the user's own batch */
#ifndef JOB_TRADEOFF_IDENTIFY_H
#define JOB_TRADEOFF_IDENTIFY_H
#include "base/key_table.h"
#include "job/job.h"

/* Its options, beside identify's, which are laid under every rung. */
extern const struct key_row tradeoff_identify_rows[];

/*
 * Errors are against the option `truth`, else the attribute `truth` of the batch
 * ({"modes":[{"lambda_re","lambda_im"}]}), else the default's own answer.
 *
 * Beside what every tradeoff's document has, this one has `bound` (the data's own error: the
 * largest standard deviation of an exponent over its modulus, from the Cramer-Rao bound of the
 * reference), and each rung `algorithm_error` (against the reference) and `unmatched`.  Against an
 * answer `error` joins both, sqrt(algorithm^2 + bound^2); against a truth it holds both already.
 */
enum modal_status tradeoff_identify(const struct job_request *request, struct job_result *out,
                                    struct modal_error *err);
#endif
