/* tradeoff_identify.h - identify's error against its time on the user's own batch */
#ifndef JOB_TRADEOFF_IDENTIFY_H
#define JOB_TRADEOFF_IDENTIFY_H
#include "job/job.h"

/*
 * Options: identify's, laid under every rung; `repetitions` (1 .. 99, default 3), of which the median is taken; `truth`, a list of
 * [re, im] exponents, else the attribute `truth` of the batch ({"modes":[{"lambda_re","lambda_im"}]}), else the default's own answer is
 * the reference.  `target.seconds` ends the climb.
 *
 * Beside what contracts.md names, the document has `bound` (the data's own error: the largest standard deviation of an exponent over its
 * modulus, from the Cramer-Rao bound of the reference), and each rung `algorithm_error` (against the reference) and `unmatched`.
 * Against an answer `error` joins both, sqrt(algorithm^2 + bound^2); against a truth it holds both already.
 */
enum modal_status tradeoff_identify(const struct job_request *request, struct job_result *out, struct modal_error *err);
#endif
