/* forced.h - modes of a constant system from its responses to measured inputs */
#ifndef MODAL_FORCED_H
#define MODAL_FORCED_H
#include "base/error.h"
#include "modal/batch.h"
#include "modal/identify/result.h"

/*
 * As modal_identify() with RESPONSE_FORCED: the channels options->inputs are the excitation, the
 * others (or those chosen) its responses, with white noise of their own on each.  Inputs are
 * taken as free of noise.  The initial state is unknown; the mean of every channel is left out.
 * With `starts` several records lie one after another, each with a state and a level of its own.
 * Of the options starts, window, band, detrend (of the responses), scale, signals, shapes, frf,
 * rank.fixed, rank.most and threads serve; any other that was set is MODAL_BAD_INPUT, and so is a
 * period.
 *
 * Of a mode, amplitude is the rms of its part of the responses, and residual and persistence are
 * not known; *out's reconstruction is that of the responses about their means.  Diagnostics, beside
 * those of verdict.h: no_modes, short_record, near_nyquist, broad_poles, narrow_line,
 * too_many_unknowns, coloured_residual (with an input's channel, the first of such: its hits are
 * not what samples tell, as far as hits.h asks; no errors and no verdict then), zero_channel,
 * poor_reconstruction, order_work_limit, not_converged, clipped (a channel; the same).
 */
enum modal_status forced_identify(const struct batch *batch, const struct identify_options *options,
                                  struct identify_result *out, struct modal_error *err);
#endif
