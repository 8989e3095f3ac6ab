/* ambient.h - modes of a constant system from its answer to broad-band excitation that nobody
 * measured */
#ifndef MODAL_AMBIENT_H
#define MODAL_AMBIENT_H
#include "base/error.h"
#include "modal/batch.h"
#include "modal/identify/result.h"

/*
 * As modal_identify() with response RESPONSE_AMBIENT: the record is reduced (pod.h) and taken to
 * its spectra (spectrum.h), subspaces propose models of every order (subspace.h), of which as many
 * pairs as pay are taken (ambient_order.h) and fitted by likelihood (whittle.h).  With a period the
 * samples of each period are one row, of a constant system with the same multipliers
 * (ambient_lift.h), less their mean; unasked, it is reduced to POD_CHANNELS_FEW signals.  Which
 * options serve is told by response.h.
 *
 * Of a mode, amplitude is the rms of its part of the response; residual and persistence are not
 * known; *out's reconstruction is that of the spectra.  Diagnostics, beside near_nyquist, no_modes,
 * zero_channel and order_work_limit:
 *
 *   not_ambient          nearly all energy lies in a small part of the record: a free decay, or a
 *                        hit; neither errors nor a verdict are given
 *   clipped              a channel's peaks were cut off (screen.h): neither, too
 *   too_few_cycles       a mode's damping is known to no better than ENOUGH; how many are enough
 *   narrow_line          a line taken off (ambient_lines.h), or a mode that is no wider: no verdict
 *   mains_line           such a line at a multiple of the mains' frequency: no harm
 *   drift                a polynomial in time taken off (ambient_drift.h); no detrend was asked for
 *   coloured_excitation  poles without a peak of their own, or whose part takes from others': the
 *                        excitation's or a filter's, no modes
 *   channels_reduced     more channels than are fitted; the share of the energy that is left out
 *   not_stationary       eighths of the record, or of a channel alone, differ by more than chance
 *   turns_lock           the speed wanders to where multipliers meet: theirs have no errors, and no
 *                        verdict is given
 *   not_converged        the fit ended below its summit: neither errors nor a verdict
 */
enum modal_status ambient_identify(const struct batch *batch, const struct identify_options *opt,
                                   struct identify_result *out, struct modal_error *err);
#endif
