/* merge.h - one pole for one mode that changes as it decays */
#ifndef MODAL_MERGE_H
#define MODAL_MERGE_H
#include "base/error.h"
#include "modal/identify/answer/modes.h"
#include "modal/identify/fit/refine.h"

/*
 * POLES of a fit to DATA crowd about a mode that TREND, COUNT windows, shows to follow its
 * amplitude (shifted by `hertz` against the data).  Each crowd becomes one pole, all poles are
 * refined again, and the standard errors of what was merged are as wide as what it covers;
 * *CONVERGED becomes true where that fit came to its least.  Both stay as they were where it fails.
 * Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status merge_crowds(const struct refine_data *data, const struct identify_window *trend,
                               int count, double hertz, struct poles *poles, bool *converged,
                               struct modal_error *err);
#endif
