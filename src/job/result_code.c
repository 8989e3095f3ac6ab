/* result_code.c - what each diagnostic means, and what to do; see result_key.h; tested by
 * tests/system/test_manual.py */
#include "job/result_key.h"
#include <stddef.h>

const struct result_code result_codes[] = {
    { "rank_at_rounding", "identify", "the rank asked for reaches into rounding errors",
      "ask for at most the rank that it names" },
    { "cut_pair", "identify", "the rank asked for cuts a conjugate pair in two",
      "use one more, or leave rank.rule to auto" },
    { "rank_too_low", "identify", "a higher rank than was asked for fits far better",
      "leave rank.rule to auto" },
    { "too_many_unknowns", "identify", "nearly as many unknowns as equations: a small "
      "reconstruction error proves nothing", "record more periods, or lower the rank" },
    { "order_work_limit", "identify", "the search for an order ended where its work was spent",
      "give `band` or `window` to look at less, or rank.fixed" },
    { "not_converged", "identify", "the refinement did not converge",
      "take the exponents for rough; another `window` or `band` may converge" },
    { "fast_decay", "identify", "a mode is gone after a few samples: its exponent rests on them",
      "sample faster, or start the window later to drop it" },
    { "growth_hides", "identify", "a mode grows so much that others are below its rounding errors: "
      "where that begins the record is cut, if the part before tells more",
      "use a shorter window to see the rest" },
    { "near_nyquist", "identify", "a mode near half the sampling rate may be a faster one, folded",
      "sample faster" },
    { "near_tie", "identify", "two harmonics are nearly equally strong: resolved_k is not certain",
      "use the exponent and the multiplier, which do not depend on it" },
    { "aliases", "identify", "one multiplier, or modes that differ by multiples of 1/period",
      "for constant coefficients give period=0" },
    { "narrow_line", "identify", "a motion that does not decay within the record or its error",
      "record longer, or leave it out by `band`: what turns, or the mains, looks so" },
    { "broad_poles", "identify", "modes of a forced response damped beyond 70 %: they show no peak",
      "tell whether they are the system's: a filter of the measuring chain looks so" },
    { "too_few_cycles", "identify", "an ambient mode whose damping is known to 15 % or worse",
      "record longer: the message says how long" },
    { "coloured_excitation", "identify", "part of an ambient spectrum is no mode's: it has no peak",
      "none is needed: it was fitted beside the modes" },
    { "not_ambient", "identify", "an ambient record whose motion is over within a quarter of it, "
      "or that is likelier a few decaying motions", "give response=free, or `window`" },
    { "not_stationary", "identify", "eighths of an ambient record, or of a channel of it, differ "
      "beyond chance", "identify parts by `window`, or leave the channel out by `signals`" },
    { "turns_lock", "identify", "a speed wanders to where the multipliers of two modes "
      "that move each other meet, or one and its conjugate: those have no errors",
      "identify a `window` of steadier speed" },
    { "channels_reduced", "identify", "an ambient record's channels were reduced to the strongest "
      "signals", "name few channels by `signals` where a weak mode matters" },
    { "short_record", "identify", "a mode turns less often than its damping needs",
      "record longer" },
    { "unresolved_pair", "identify", "two modes less than a beat apart over the record",
      "record longer" },
    { "zero_channel", "identify", "a channel is zero throughout", "see whether it is connected" },
    { "poor_reconstruction", "identify", "the modes leave more than half of the signals",
      "look for noise, a forced response, or too low a rank" },
    { "dominated_signal", "identify", "others are so much larger that a channel is rebuilt badly",
      "raise the rank, or identify it alone by `signals`" },
    { "below_rounding", "identify", "a channel is nothing but rounding errors of the others",
      "give it in another unit, or identify it alone by `signals`" },
    { "no_modes", "identify", "no mode stands above the noise",
      "see whether the record holds a free response" },
    { "offset", "identify", "a constant part was found", "none is needed: it is in `offset`" },
    { "periodic_orbit", "identify", "the periodic motion itself was not removed",
      "use difference=true" },
    { "near_defective", "identify", "multipliers nearly coalesce: only their mean is certain",
      "use the cluster's centroid" },
    { "coloured_residual", "identify", "what the modes leave is no white noise; standard "
      "deviations were widened, or are unknown where it is modes or hits between samples",
      "look for what is slow, driven or nonlinear" },
    { "parts_disagree", "identify", "halves of the record have other exponents; standard "
      "deviations were widened, or left out where no verdict can be given", "identify parts by "
      "`window`, or give response=ambient where it is excited all the time" },
    { "amplitude_dependent", "identify", "the mode changes as it decays",
      "read `trend`, or identify parts by `window`" },
    { "changes_in_record", "identify", "not one system throughout",
      "identify each part by `window`" },
    { "not_free_decay", "identify", "the response is driven, or noise: no verdict and no "
      "standard deviations", "give response=ambient where nobody measured the excitation, "
      "response=forced where it was measured, or window a part after its end" },
    { "harmonic_of_mode", "identify", "a multiple of another mode that decays as its power",
      "take it for a nonlinearity of that mode, not for a mode" },
    { "mains_line", "identify", "an undamped line at a multiple of 50 or 60 Hz",
      "take it for mains, not for a mode" },
    { "undamped", "identify", "a mode keeps its amplitude over the record",
      "see whether it is a steady force, a limit cycle or a mode without damping" },
    { "drift", "identify", "part of the signals moves more slowly than the record",
      "remove it by `detrend` or `band`; an ambient record's was taken off" },
    { "quantised", "identify", "a channel lies on a grid, or has digits, whose steps matter",
      "end the window before the signal falls to the grid, or record with more digits" },
    { "ends_below_grid", "identify", "the rest of the record is rounded to nothing and is not used",
      "none is needed" },
    { "not_free_throughout", "identify", "the record begins with quiet, or with "
      "what drives it, or the response stops in it where its modes would last",
      "give window=auto, which uses `proposed_window`, as over 32,768 rows is done unasked" },
    { "clipped", "identify", "a channel's peaks are cut off",
      "begin the window later, or measure with less gain" },
    { "wild_samples", "identify", "samples of a channel that are neither motion nor noise: left "
      "out, and rebuilt by the modes", "see what sends them: a telemetry's spikes, dropouts" },
    { "step", "identify", "a channel's mean jumps and stays: fitted beside the modes, and left out",
      "see what moves it: a sensor that slips, a load that goes" },
    { "wrong_period", "identify", "the record's turns are even, and not those of the period given: "
      "its own was taken", "give the period that it names" },
    { "period_drifts", "identify", "the speed changes over the record: it was taken at even angles",
      "resample the signals at even angles of the azimuth, or give a shorter `window`" },
    { "growth_unconfirmed", "identify", "growth in the whole record that its parts do not show",
      "record longer, or identify a part by `window`" },
    { "repeats_later", "steady", "under tones the motion repeats after some turns of one of them "
      "alone, as laws that open and close may have it", "take tones and k as told, or give that "
      "part of the tone yourself" },
    { "undetermined_mean", "steady", "nothing but what slips holds the body: its mean follows "
      "from history", "take the motion about it; it has an error" },
    { "undetermined_offset", "steady", "a slider never slips: its place, and the mean, follow "
      "from history", "take the mean for one of many" },
    { "no_periodic_solution", "steady", "there certainly is none: a load that nothing holds",
      "add what holds it, or change the load" },
    { "not_converged", "steady", "none was found, which is no proof that there is none",
      "follow it from elsewhere with --continue, or give `start`" },
    { "target_not_met", "steady", "the error is above target.error",
      "give `harmonics`, as it says" },
    { "reduction_coarse", "steady", "what reduce leaves out is more than target.error, or unknown",
      "give `reduce` more modes, or leave it out" },
    { "error_unknown", "steady", "the derivative is singular at the solution",
      "take the motion without an error, or move the parameter" },
    { "stability_unknown", "steady", "it was not computed, and why", "see the reason" },
    { "search_work_limit", "steady", "the search for all motions, or for a stable one beside an "
      "unstable, ended where its work was spent", "march to one with simulate, and give `start`" },
    { "multipliers_unsettled", "floquet", "the leading multipliers are not told apart: the best so "
      "far", "give fewer `multipliers`" },
    { "multipliers_alike", "floquet", "others have the modulus of the last that is given",
      "nothing, or give more `multipliers`" },
    { "hill_too_large", "floquet", "Hill's determinant would be too large; the answer stands",
      "give hill=false, or fewer hill.harmonics" },
    { 0 },
};
