/* identify.h - modes of a free response: frequencies, damping, stability of constant or periodic
 * systems
 *
 * Rooms, each of which calls only such as stand before it (tests/house):
 *
 *   result.h   what is asked and what is answered: types
 *   linear/    Hankel pairs (14), (18) and pencils, their rank; the multipliers of Q, Qhat, B and
 *              Bhat; corrected (10) exponents
 *   fit/       variable projection on the exponents with standard errors; what a model is worth;
 *              synthesis, eq. (25); whether what is left is white, and whether parts agree
 *   order/     how many poles: from above, by what a fit leaves, less those a set does without
 *   prepare/   from a batch to rows of unit rms: the free part (event), cut (window, band,
 *              difference, detrend), turns, folds of a period; many channels to few signals
 *   answer/    from poles to modes: amplitudes, shapes, harmonics g_jk
 *   ask/       is the model right, and what follows: widen, merge, trend, drift, verdict, notes
 *   ambient/   where noise drives: Whittle's likelihood of the spectral matrix
 *   forced/    where the excitation was measured: its likelihood line by line
 *   live/      windows of a stream: the same fit on compressed rows, and modes over time as tracks
 *
 * identify*.c is the way through a free response, stage by stage.
 *
 * Poles, multipliers and exponents: conventions of linear/exponents.h.  Damping ratio -Re/|lambda|:
 * positive decays.
 */
#ifndef MODAL_IDENTIFY_H
#define MODAL_IDENTIFY_H
#include "base/error.h"
#include "modal/batch.h"
#include "modal/identify/result.h"

/*
 * Identify BATCH (borrowed), by options->response as a free response or as forced.h says.  *out is
 * empty on failure; the caller frees it with identify_result_done. Fails with MODAL_BAD_INPUT,
 * err->field naming the option ("rank.fixed"), attribute ("dt", "period") or dataset ("signals":
 * text with the first offending channel and sample); MODAL_TOO_LARGE; MODAL_NO_MEMORY;
 * MODAL_NO_CONVERGENCE; MODAL_CANCELLED.
 */
enum modal_status modal_identify(const struct batch *batch, const struct identify_options *options,
                                 struct identify_result *out, struct modal_error *err);
void identify_result_done(struct identify_result *result);
#endif
