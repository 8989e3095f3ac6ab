/* backbone_job.h - a scene's nonlinear mode over its amplitude: option `backbone` of kind
 * `steady` */
#ifndef JOB_BACKBONE_JOB_H
#define JOB_BACKBONE_JOB_H
#include "job/job.h"

struct cost;
struct program;
struct steady_settings;

/*
 * {"kind":"backbone", "mode", "linear":{"omega", "frequency_hz", "damping_ratio"},
 * "points":[{"amplitude", "omega", "frequency_hz", "damping_ratio", "energy", "converged",
 * "iterations", "residual", "harmonics"}], "plan"} of settings->backbone, MODE:A:B:N: N amplitudes
 * from A to B, equal in ratio; without N as many as the curve has, along its length and round its
 * folds, until it comes to B.  Amplitudes are modal, in m sqrt(kg): X_1 = amplitude times the mode
 * of unit modal mass.
 */
enum modal_status backbone_run(const struct job_request *request, struct program *p,
                               const struct steady_settings *settings, struct cost *cost,
                               cJSON **doc, struct modal_error *err);
#endif
