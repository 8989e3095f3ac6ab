/* tradeoff_tones.h - steady states under several tones: error against time over sets of
 * combinations and targets, measured against a long march */
#ifndef JOB_TRADEOFF_TONES_H
#define JOB_TRADEOFF_TONES_H
#include "base/json.h"
#include "job/job.h"

struct program;
struct steady_settings;

/* What a climb of the ladder is asked for, as tradeoff_steady's options have it. */
struct tradeoff_wishes { double target, seconds; int repetitions; };

/*
 * The document of `tradeoff` of REQUEST's scene, lowered as P, under SETTINGS' tones; the caller's.
 * MODAL_BAD_INPUT, field the option, for what tones or this tradeoff do not take;
 * MODAL_NO_CONVERGENCE where no motion was found to march from, or the one found is unstable.
 */
enum modal_status tradeoff_tones(const struct job_request *request, struct program *p,
                                 const struct steady_settings *settings,
                                 const struct tradeoff_wishes *wishes, cJSON **doc,
                                 struct modal_error *err);
#endif
