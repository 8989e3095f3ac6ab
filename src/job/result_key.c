/* result_key.c - see result_key.h; tested by tests/system/test_manual.py */
#include "job/result_key.h"
#include <stddef.h>

#define UNKNOWN "not known"

/* ---- what several kinds share ---- */

static const struct result_key stage_keys[] = {
    { "<stage>", RESULT_NUMBER, .unit = "s", .means = "CPU time of it" },
    { 0 },
};

static const struct result_key cost_keys[] = {
    { "wall_s", RESULT_NUMBER, .unit = "s", .means = "from beginning to end" },
    { "cpu_s", RESULT_NUMBER, .unit = "s", .means = "of all threads" },
    { "stages", RESULT_OBJECT, .members = stage_keys, .means = "by what was done" },
    { "peak_bytes", RESULT_NUMBER, .unit = "bytes",
      .means = "memory of the process at its most so far, earlier jobs included" },
    { 0 },
};

#define COST { "cost", RESULT_OBJECT, .members = cost_keys, .means = "what it took" }

static const struct result_key effect_keys[] = {
    { "type", RESULT_TEXT, .means = "as in the scene" },
    { "states", RESULT_WHOLE, .means = "that it adds" },
    { "evaluations", RESULT_NUMBER, .means = "of its law; 0 where it is part of the matrices" },
    { "seconds", RESULT_NUMBER, .unit = "s", .means = "CPU time of these" },
    { "active", RESULT_TRUTH, .means = "false: a slider that never slips, a gap never closed" },
    { 0 },
};

static const struct result_key reduction_keys[] = {
    { "kept", RESULT_WHOLE, .means = "dofs of laws, loads, sensors and reports" },
    { "modes", RESULT_WHOLE, .means = "in place of the others: as asked for, or all" },
    { "highest", RESULT_NUMBER, .unit = "rad/s", .means = "of the last of them" },
    { "next", RESULT_NUMBER, .unit = "rad/s", .null = "none is", .means = "of the first left out" },
    { 0 },
};

static const struct result_key plan_keys[] = {
    { "class", RESULT_TEXT, .means = "linear-constant, linear-periodic or nonlinear" },
    { "states", RESULT_NUMBER, .means = "twice the dofs, and those that effects add" },
    { "integrator", RESULT_TEXT, .means = "what solved it" },
    { "hash", RESULT_TEXT, .means = "SHA-256 of the model that the scene became" },
    { "effects", RESULT_OBJECT, .list = "as the scene lists them", .members = effect_keys,
      .means = "what each did" },
    { "ffts", RESULT_NUMBER, .absent = "but for steady states and curves",
      .means = "fast Fourier transforms; 0 where the scene is linear" },
    { "iterations", RESULT_NUMBER, .absent = "but for steady states and curves",
      .means = "of the balance, all points together" },
    { "reduction", RESULT_OBJECT, .absent = "without reduce", .members = reduction_keys,
      .means = "of the linear part" },
    { 0 },
};

#define PLAN { "plan", RESULT_OBJECT, .members = plan_keys, \
               .means = "what the scene became and what computed it" }

static const struct result_key provenance_keys[] = {
    { "version", RESULT_TEXT, .means = "of modald" },
    { "options", RESULT_OWN, .means = "those in force, defaults included" },
    { "input_sha256", RESULT_TEXT, .absent = "in a process of its own (--local)",
      .means = "of the input as it was uploaded" },
    { "host", RESULT_TEXT, .absent = "tradeoff identify", .means = "where it ran" },
    { "threads", RESULT_WHOLE, .absent = "tradeoff identify", .means = "that it was given" },
    { "blas_core", RESULT_TEXT, .means = "the processor's kernels that OpenBLAS chose" },
    { "attributes", RESULT_OWN, .absent = "where the input has none",
      .means = "of the input, as they came" },
    { "units", RESULT_TEXT, .absent = "where the scene names none", .means = "as the scene says" },
    { 0 },
};

#define PROVENANCE { "provenance", RESULT_OBJECT, .members = provenance_keys, \
                     .means = "of what, by what and where it was computed" }

static const struct result_key diagnostic_keys[] = {
    { "code", RESULT_TEXT, .means = "one of those below" },
    { "message", RESULT_TEXT, .means = "with the numbers of this case" },
    { "channel", RESULT_WHOLE, .absent = "where it is about all", .means = "counted from 0" },
    { 0 },
};

#define DIAGNOSTICS { "diagnostics", RESULT_OBJECT, .list = "none where nothing is to be said", \
                      .members = diagnostic_keys, .means = "what to know before it is used" }

static const struct result_key error_keys[] = {
    { "code", RESULT_TEXT, .means = "of an error: see PROTOCOL.md" },
    { "message", RESULT_TEXT, .means = "what is wrong, and what would be accepted" },
    { "field", RESULT_TEXT, .absent = "where it is about no field",
      .means = "the option, or the path in the scene" },
    { 0 },
};

/* ---- identify ---- */

static const struct result_key identify_provenance_keys[] = {
    { "version", RESULT_TEXT, .means = "of modald" },
    { "options", RESULT_OWN, .means = "those in force, defaults included" },
    { "input_sha256", RESULT_TEXT, .null = "in a process of its own (--local)",
      .means = "of the batch as it was uploaded" },
    { "input", RESULT_OBJECT, .members = identify_input_keys, .means = "the batch" },
    { "samples_used", RESULT_WHOLE, .means = "after window and decimation" },
    { "dt_used", RESULT_NUMBER, .unit = "s", .means = "between these" },
    { "decimation", RESULT_WHOLE, .means = "one of so many was kept" },
    { "host", RESULT_TEXT, .means = "where it ran" },
    { "threads", RESULT_WHOLE, .means = "that it was given" },
    { "blas_core", RESULT_TEXT, .means = "the processor's kernels that OpenBLAS chose" },
    { 0 },
};

static const struct result_key ladder_rung_keys[] = {
    { "settings", RESULT_OWN, .means = "options of this rung" },
    { "error", RESULT_NUMBER, .null = "it did not run",
      .means = "the largest standard deviation of an exponent over its modulus" },
    { "seconds", RESULT_NUMBER, .unit = "s", .null = "it did not run", .means = "CPU time" },
    { "ran", RESULT_TRUTH, .means = "it was climbed to" },
    { 0 },
};

static const struct result_key ladder_keys[] = {
    { "rungs", RESULT_OBJECT, .list = "from the cheapest on", .members = ladder_rung_keys,
      .means = "ways to the answer" },
    { "chosen", RESULT_WHOLE, .means = "the rung that the answer is of" },
    { "stop", RESULT_TEXT, .null = "no target was set",
      .means = "target.error, target.seconds, or exhausted" },
    { 0 },
};

static const struct result_key identify_keys[] = {
    { "kind", RESULT_TEXT, .means = "identify" },
    { "response", RESULT_TEXT, .means = "free, ambient or forced: what the record answers" },
    { "modes", RESULT_OBJECT, .list = "one a conjugate pair, by falling amplitude",
      .members = identify_mode_keys, .means = "frequencies and damping" },
    { "stability", RESULT_OBJECT, .members = identify_verdict_keys, .means = "the verdict" },
    { "rank", RESULT_OBJECT, .members = identify_rank_keys,
      .means = "how much of the data was used" },
    { "reconstruction", RESULT_OBJECT, .members = identify_rebuilt_keys,
      .means = "the signals rebuilt from the modes; of an ambient record, their spectra" },
    { "frf", RESULT_OBJECT, .absent = "without frf=true", .members = identify_frf_keys,
      .means = "frequency responses of the model" },
    { "offset", RESULT_NUMBER, .unit = "the channel's",
      .list = "one a channel, none where none was found", .null = UNKNOWN,
      .means = "the constant part: of the null exponent, which is no mode" },
    { "order", RESULT_OBJECT, .members = identify_order_keys, .means = "how the order was chosen" },
    { "stabilisation", RESULT_OBJECT, .list = "of every candidate's", .members = identify_pole_keys,
      .means = "exponents against order: a stabilisation diagram" },
    { "clusters", RESULT_OBJECT, .list = "of close ones", .members = identify_cluster_keys,
      .means = "multipliers that nearly coalesce" },
    { "trend", RESULT_OBJECT, .list = "part after part, none where it is one system throughout",
      .members = identify_trend_keys, .means = "the strongest vibration over the record" },
    { "proposed_window", RESULT_SPAN, .unit = "s",
      .null = "all that was looked at is one, or it cannot be told",
      .means = "one free response: after quiet and a strike, before noise, or where it stops" },
    DIAGNOSTICS,
    COST,
    { "provenance", RESULT_OBJECT, .members = identify_provenance_keys,
      .means = "of what, by what and where it was computed" },
    { "ladder", RESULT_OBJECT, .members = ladder_keys, .means = "error against time" },
    { 0 },
};

/* ---- steady ---- */

static const struct result_key dof_harmonic_keys[] = {
    { "dof", RESULT_TEXT, .means = "its name" },
    { "k", RESULT_OWN, .means = "list of the harmonics of omega, from 0; with tones of lists "
      "[k1, k2], x(t) = Re sum X_k exp(i (k1 w1 + k2 w2) t)" },
    { "re", RESULT_NUMBER, .list = "one a harmonic", .unit = "the dof's", .null = UNKNOWN,
      .means = "Re X_k of x(t) = Re sum X_k exp(i k omega t)" },
    { "im", RESULT_NUMBER, .list = "one a harmonic", .unit = "the dof's", .null = UNKNOWN,
      .means = "Im X_k: minus the sine's coefficient" },
    { 0 },
};

static const struct result_key motion_keys[] = {
    { "<dof>", RESULT_NUMBER, .list = "one a time", .unit = "the dof's", .null = UNKNOWN,
      .means = "x(t)" },
    { 0 },
};

static const struct result_key time_keys[] = {
    { "t", RESULT_NUMBER, .list = "over one period", .unit = "s", .means = "times" },
    { "x", RESULT_OBJECT, .members = motion_keys, .means = "motions at these" },
    { 0 },
};

static const struct result_key equation_keys[] = {
    { "rms_residual", RESULT_NUMBER, .unit = "N", .null = UNKNOWN,
      .means = "of the equation of motion in time, with the laws as they are" },
    { "max_residual", RESULT_NUMBER, .unit = "N", .null = UNKNOWN, .means = "its largest" },
    { "relative_residual", RESULT_NUMBER, .null = UNKNOWN, .means = "that over the largest force" },
    { 0 },
};

static const struct result_key work_keys[] = {
    { "spent", RESULT_NUMBER, .null = UNKNOWN, .means = "operations, counted not timed" },
    { "allowed", RESULT_NUMBER, .null = "no limit", .means = "the most unasked" },
    { 0 },
};

static const struct result_key orbit_keys[] = {
    { "stable", RESULT_TRUTH, .null = "undecided, or not computed", .means = "disturbances decay" },
    { "max_multiplier", RESULT_NUMBER, .null = "not computed", .means = "the largest modulus" },
    { "multipliers", RESULT_COMPLEX, .list = "both of each pair, the largest first",
      .means = "of disturbances, over 2 pi/omega; of many states the leading ten alone" },
    { "error", RESULT_NUMBER, .absent = "where it was not computed", .null = UNKNOWN,
      .means = "estimate, of the multipliers; where all were only bounded, up to the bound" },
    { "exponents", RESULT_NUMBER, .list = "the four largest", .unit = "1/s",
      .absent = "without tones",
      .means = "Lyapunov's, of disturbances of a motion of tones; one is 0 where a tone is free" },
    { "margin", RESULT_NUMBER, .unit = "1/s", .absent = "without tones", .null = "not computed",
      .means = "less the exponent that decides: a free tone's own does not" },
    { "margin_std", RESULT_NUMBER, .unit = "1/s", .absent = "without tones", .null = "not computed",
      .means = "of margin: scatter of batches of turns and length of steps" },
    { 0 },
};

static const struct result_key steady_keys[] = {
    { "kind", RESULT_TEXT, .means = "steady" },
    { "converged", RESULT_TRUTH, .means = "false: the best iterate, and a diagnostic says why" },
    { "omega", RESULT_NUMBER, .unit = "rad/s", .null = "with tones",
      .means = "of the motion's first harmonic" },
    { "tones", RESULT_NUMBER, .list = "one to three", .unit = "rad/s", .absent = "without tones",
      .means = "w1, w2, .. of the motion, of no common period; a free one as it was found" },
    { "subharmonic", RESULT_WHOLE, .list = "one a tone", .absent = "but where a motion of tones "
      "repeats after turns of one alone", .means = "what each tone given is over its `tones`" },
    { "method", RESULT_TEXT, .means = "what found it: linear, direct, newton, ..; march: lines of "
      "tones, read from a march of laws with events" },
    { "iterations", RESULT_WHOLE, .means = "of the balance" },
    { "H", RESULT_WHOLE, .means = "harmonics kept, beside the mean; with tones the highest "
      "|k1| + |k2| + .. kept" },
    { "N", RESULT_WHOLE, .means = "samples of a period, or of all phases of tones, at which laws "
      "were evaluated, or of a march; 0: none" },
    { "harmonics", RESULT_OBJECT, .list = "one a dof reported", .members = dof_harmonic_keys,
      .means = "the motion" },
    { "time", RESULT_OBJECT, .absent = "without time", .members = time_keys,
      .means = "the motion over one period" },
    { "residual", RESULT_NUMBER, .null = UNKNOWN, .means = "of the balance, relative" },
    { "truncation_error", RESULT_NUMBER, .unit = "the dofs'", .null = UNKNOWN,
      .means = "estimate of max |x - exact| that more harmonics would remove" },
    { "sampling_error", RESULT_NUMBER, .unit = "the dofs'", .null = UNKNOWN,
      .means = "that more samples would remove" },
    { "solver_error", RESULT_NUMBER, .unit = "the dofs'", .null = UNKNOWN,
      .means = "that more iterations would remove" },
    { "reduction_error", RESULT_NUMBER, .unit = "the dofs'", .null = UNKNOWN, .absent = "without "
      "reduce", .means = "that more modes would remove" },
    { "total_error", RESULT_NUMBER, .unit = "the dofs'", .null = UNKNOWN, .means = "of all these, "
      "over time and reported dofs; with a free tone at equal phases of it" },
    { "line_error", RESULT_NUMBER, .unit = "the dofs'", .null = UNKNOWN, .absent = "without tones",
      .means = "of a combination's X, told or left out" },
    { "tone_error", RESULT_NUMBER, .unit = "rad/s", .null = UNKNOWN, .absent = "without a free "
      "tone", .means = "of its frequency" },
    { "reconstruction", RESULT_OBJECT, .members = equation_keys,
      .means = "the motion in the equation of motion" },
    { "work", RESULT_OBJECT, .members = work_keys, .means = "against the limit of work" },
    { "stability", RESULT_OBJECT, .members = orbit_keys, .means = "of the motion" },
    DIAGNOSTICS,
    { "solutions", RESULT_OBJECT, .list = "of different motions", .as = { "steady" },
      .absent = "without solutions=all", .means = "all that were found, this one first" },
    PLAN,
    COST,
    PROVENANCE,
    { 0 },
};

static const struct result_key point_keys[] = {
    { "value", RESULT_NUMBER, .means = "of the parameter" },
    { "fundamental", RESULT_NUMBER, .unit = "rad/s", .absent = "without subharmonic",
      .means = "omega of the motion, a fraction of the load's" },
    { 0 },
};

static const struct result_key fold_keys[] = {
    { "<parameter>", RESULT_NUMBER, .means = "its value there" },
    { 0 },
};

static const struct result_key bifurcation_keys[] = {
    { "type", RESULT_TEXT, .means = "branch_point, period_doubling or neimark_sacker" },
    { "<parameter>", RESULT_NUMBER, .means = "its value there" },
    { "second_tone", RESULT_NUMBER, .unit = "rad/s", .absent = "but at neimark_sacker",
      .means = "that the motion brings beside omega, up to its sign and multiples of omega: the "
      "branch is solved for by -o tones=OMEGA,free" },
    { 0 },
};

static const struct result_key curve_keys[] = {
    { "kind", RESULT_TEXT, .means = "curve" },
    { "parameter", RESULT_TEXT, .means = "path in the scene, or omega" },
    { "points", RESULT_OBJECT, .list = "along the curve", .members = point_keys,
      .as = { "steady" }, .means = "a steady state each" },
    { "folds", RESULT_OBJECT, .list = "along the curve", .members = fold_keys,
      .means = "where the parameter turns back" },
    { "bifurcations", RESULT_OBJECT, .list = "along the curve", .members = bifurcation_keys,
      .means = "where another multiplier leaves the unit circle" },
    { "complete", RESULT_TRUTH, .absent = "of a sweep that was not stopped",
      .means = "it reached the end asked for" },
    { "reason", RESULT_TEXT, .absent = "where it did", .means = "why it did not" },
    PLAN,
    COST,
    PROVENANCE,
    { 0 },
};

static const struct result_key linear_keys[] = {
    { "omega", RESULT_NUMBER, .unit = "rad/s", .null = UNKNOWN, .means = "of the mode" },
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .null = UNKNOWN, .means = "omega / (2 pi)" },
    { "damping_ratio", RESULT_NUMBER, .null = UNKNOWN, .means = "of the mode" },
    { 0 },
};

static const struct result_key backbone_point_keys[] = {
    { "amplitude", RESULT_NUMBER, .means = "as the option asks for it, or where the curve is" },
    { "omega", RESULT_NUMBER, .unit = "rad/s", .null = "it did not converge",
      .means = "of the nonlinear mode" },
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .null = "it did not converge",
      .means = "omega / (2 pi)" },
    { "damping_ratio", RESULT_NUMBER, .null = "it did not converge", .means = "of the mode" },
    { "energy", RESULT_NUMBER, .unit = "J", .null = "it did not converge", .means = "of motion" },
    { "converged", RESULT_TRUTH, .means = "the first that is not ends the list" },
    { "iterations", RESULT_WHOLE, .means = "of Newton's method" },
    { "residual", RESULT_NUMBER, .null = UNKNOWN, .means = "of the balance, relative" },
    { "harmonics", RESULT_OBJECT, .list = "one a dof reported", .members = dof_harmonic_keys,
      .means = "the motion" },
    { 0 },
};

static const struct result_key backbone_keys[] = {
    { "kind", RESULT_TEXT, .means = "backbone" },
    { "mode", RESULT_WHOLE, .means = "of the linear structure that it grows from" },
    { "linear", RESULT_OBJECT, .members = linear_keys, .means = "at no amplitude" },
    { "points", RESULT_OBJECT, .list = "one an amplitude, or along the curve",
      .members = backbone_point_keys, .means = "the mode there" },
    PLAN,
    COST,
    PROVENANCE,
    { 0 },
};

/* ---- simulate, floquet ---- */

static const struct result_key steps_keys[] = {
    { "products", RESULT_NUMBER, .means = "of a matrix with the state" },
    { "exponentials", RESULT_NUMBER, .means = "of matrices" },
    { "steps", RESULT_NUMBER, .means = "in time" },
    { "rejected", RESULT_NUMBER, .means = "of these, for their error" },
    { 0 },
};

static const struct result_key simulate_keys[] = {
    { "kind", RESULT_TEXT, .means = "simulate" },
    { "samples", RESULT_NUMBER, .means = "of the record: duration/dt + 1" },
    { "dt", RESULT_NUMBER, .unit = "s", .means = "between these" },
    { "start", RESULT_NUMBER, .unit = "s", .means = "of the record" },
    { "duration", RESULT_NUMBER, .unit = "s", .means = "of the record" },
    { "period", RESULT_NUMBER, .unit = "s",
      .absent = "of a constant system, or where the record holds less than two",
      .means = "that the batch is given" },
    { "channels", RESULT_TEXT, .list = "one a sensor", .means = "names" },
    { "work", RESULT_OBJECT, .members = steps_keys, .means = "counts" },
    PLAN,
    COST,
    PROVENANCE,
    { 0 },
};

static const struct result_key exact_mode_keys[] = {
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .means = "|exponent| / (2 pi)" },
    { "frequency_rad_s", RESULT_NUMBER, .unit = "rad/s", .means = "|exponent|" },
    { "damped_frequency_rad_s", RESULT_NUMBER, .unit = "rad/s", .means = "|Im exponent|" },
    { "damping_ratio", RESULT_NUMBER, .means = "-Re exponent / |exponent|" },
    { "exponent", RESULT_COMPLEX, .unit = "1/s, rad/s", .means = "as in exponents" },
    { "multiplier", RESULT_COMPLEX, .absent = "without a period", .means = "exp(exponent period)" },
    { "error", RESULT_NUMBER, .null = UNKNOWN, .means = "as in errors" },
    { 0 },
};

static const struct result_key exact_verdict_keys[] = {
    { "stable", RESULT_TRUTH, .null = "undecided: within its error of the boundary",
      .means = "every motion decays" },
    { "max_multiplier", RESULT_NUMBER, .null = "no period", .means = "the largest modulus" },
    { "margin", RESULT_NUMBER, .unit = "1/s", .null = UNKNOWN, .means = "-max Re exponent" },
    { "error", RESULT_NUMBER, .null = UNKNOWN, .means = "of the exponent that decides" },
    { 0 },
};

static const struct result_key monodromy_keys[] = {
    { "substeps", RESULT_WHOLE, .means = "of a period" },
    { "error", RESULT_NUMBER, .null = UNKNOWN, .means = "estimate, relative" },
    { 0 },
};

static const struct result_key hill_keys[] = {
    { "exponents", RESULT_COMPLEX, .list = "by falling real part", .unit = "1/s, rad/s",
      .means = "by Hill's determinant" },
    { "harmonics", RESULT_WHOLE, .means = "kept, on each side" },
    { "truncation", RESULT_NUMBER, .unit = "1/s", .null = UNKNOWN,
      .means = "the largest change from fewer harmonics" },
    { "difference", RESULT_NUMBER, .unit = "1/s", .null = UNKNOWN,
      .means = "the largest, between the two ways" },
    { 0 },
};

static const struct result_key floquet_keys[] = {
    { "kind", RESULT_TEXT, .means = "floquet" },
    { "period", RESULT_NUMBER, .unit = "s", .absent = "of a constant system without one",
      .means = "that multipliers are over" },
    { "multipliers", RESULT_COMPLEX, .list = "both of each pair, the largest first",
      .null = "below rounding", .absent = "without a period", .means = "exp(exponent period)" },
    { "exponents", RESULT_COMPLEX, .list = "both of each pair, by falling real part",
      .unit = "1/s, rad/s", .null = "its multiplier is below rounding",
      .means = "principal values of ln(multiplier) / period; of a constant system eigenvalues" },
    { "errors", RESULT_NUMBER, .list = "one an exponent", .null = UNKNOWN,
      .means = "on |multiplier| of a periodic system, else on the exponent" },
    { "modes", RESULT_OBJECT, .list = "one a conjugate pair", .members = exact_mode_keys,
      .means = "frequencies and damping" },
    { "stability", RESULT_OBJECT, .members = exact_verdict_keys, .means = "the verdict" },
    { "monodromy", RESULT_OBJECT, .members = monodromy_keys, .absent = "of a constant system",
      .means = "the matrix over one period" },
    PLAN,
    { "diagnostics", RESULT_OBJECT, .list = "of one", .members = diagnostic_keys,
      .absent = "where nothing is to be said", .means = "what to know before it is used" },
    { "hill", RESULT_OBJECT, .members = hill_keys,
      .absent = "of a constant system, with hill=false, or too large",
      .means = "a second, independent way" },
    COST,
    PROVENANCE,
    { 0 },
};

/* ---- tradeoff, ablate, sweep ---- */

static const struct result_key reference_keys[] = {
    { "by", RESULT_TEXT, .absent = "but for identify",
      .means = "truth, where the batch or the option `truth` gives it; else settings" },
    { "settings", RESULT_OWN, .absent = "but by settings", .means = "options of the reference" },
    { "exponents", RESULT_COMPLEX, .list = "one a mode", .absent = "but for identify",
      .means = "that errors are against" },
    { "left_out_s", RESULT_NUMBER, .unit = "s", .absent = "but of tones", .means = "transient" },
    { "compared_s", RESULT_NUMBER, .unit = "s", .absent = "but of tones", .means = "the rest" },
    { "<option>", RESULT_OWN, .means = "of steady or simulate: those of the reference" },
    { 0 },
};

static const struct result_key rung_keys[] = {
    { "settings", RESULT_OWN, .means = "options that can be given back with -o" },
    { "error", RESULT_NUMBER, .null = "it has no answer",
      .means = "max |x - reference| / max |reference|, or the largest of an exponent" },
    { "seconds", RESULT_NUMBER, .unit = "s", .null = "it did not run", .means = "CPU time" },
    { "pareto", RESULT_TRUTH, .means = "none is both quicker and better" },
    { "algorithm_error", RESULT_NUMBER, .absent = "but for identify", .null = "it has no answer",
      .means = "against the reference, without the data's own error" },
    { "bound", RESULT_NUMBER, .absent = "but for identify", .null = UNKNOWN,
      .means = "its own: the largest standard error that it states of an exponent" },
    { "unmatched", RESULT_WHOLE, .absent = "but for identify", .means = "exponents that it lacks" },
    { 0 },
};

static const struct result_key tradeoff_keys[] = {
    { "kind", RESULT_TEXT, .means = "tradeoff" },
    { "of", RESULT_TEXT, .means = "identify, steady or simulate" },
    { "reference", RESULT_OBJECT, .members = reference_keys, .means = "what errors are against" },
    { "rungs", RESULT_OBJECT, .list = "one a setting", .members = rung_keys, .means = "answers" },
    { "recommended", RESULT_WHOLE, .null = "none", .means = "which of rungs, from 0" },
    { "bound", RESULT_NUMBER, .absent = "but for identify", .null = UNKNOWN,
      .means = "the data's own error: the least that any rung could have" },
    { "bound_at_2x", RESULT_NUMBER, .absent = "but for identify with response=ambient or forced",
      .null = UNKNOWN, .means = "what it would be with twice the record" },
    { "repetitions", RESULT_WHOLE, .absent = "but for identify", .means = "of each rung" },
    { "plan", RESULT_OBJECT, .absent = "of identify", .members = plan_keys,
      .means = "what the scene became and what computed it" },
    COST,
    PROVENANCE,
    { 0 },
};

static const struct result_key changed_mode_keys[] = {
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .null = UNKNOWN, .means = "with the effect" },
    { "damping_ratio", RESULT_NUMBER, .null = UNKNOWN, .means = "with the effect" },
    { "exponent", RESULT_COMPLEX, .unit = "1/s, rad/s", .means = "with the effect" },
    { "exponent_without", RESULT_COMPLEX, .unit = "1/s, rad/s", .null = "it has none",
      .means = "without it" },
    { "frequency_change_hz", RESULT_NUMBER, .unit = "Hz", .null = UNKNOWN,
      .means = "without less with" },
    { "frequency_first_order_hz", RESULT_NUMBER, .unit = "Hz", .null = UNKNOWN,
      .means = "the same to first order in the effect" },
    { "damping_change", RESULT_NUMBER, .null = UNKNOWN, .means = "without less with" },
    { "damping_first_order", RESULT_NUMBER, .null = UNKNOWN,
      .means = "the same to first order in the effect" },
    { 0 },
};

static const struct result_key dof_change_keys[] = {
    { "<dof>", RESULT_NUMBER, .unit = "the dof's", .null = UNKNOWN,
      .means = "the largest change of one of its harmonics" },
    { 0 },
};

static const struct result_key change_keys[] = {
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .absent = "of steady", .null = UNKNOWN,
      .means = "the largest change of a frequency" },
    { "damping_ratio", RESULT_NUMBER, .absent = "of steady", .null = UNKNOWN,
      .means = "the largest change of a damping ratio" },
    { "exponent", RESULT_NUMBER, .unit = "1/s", .absent = "of steady", .null = UNKNOWN,
      .means = "the largest |change| of an exponent" },
    { "margin", RESULT_NUMBER, .unit = "1/s", .absent = "of steady", .null = UNKNOWN,
      .means = "of stability, without less with" },
    { "modes", RESULT_OBJECT, .list = "one a conjugate pair", .members = changed_mode_keys,
      .absent = "of steady", .means = "mode by mode" },
    { "harmonics", RESULT_NUMBER, .unit = "the dofs'", .absent = "of floquet", .null = UNKNOWN,
      .means = "the largest change of a harmonic" },
    { "relative", RESULT_NUMBER, .absent = "of floquet", .null = "nothing moves",
      .means = "that over the largest harmonic" },
    { "dofs", RESULT_OBJECT, .members = dof_change_keys, .absent = "of floquet",
      .means = "dof by dof" },
    { 0 },
};

static const struct result_key failure_keys[] = {
    { "error", RESULT_OBJECT, .members = error_keys, .absent = "where it has an answer",
      .means = "why there is none" },
    { 0 },
};

static const struct result_key ablated_keys[] = {
    { "type", RESULT_TEXT, .means = "of the effect, as in the scene" },
    { "change", RESULT_OBJECT, .members = change_keys,
      .means = "of the answer, when it is left out; empty where there is none" },
    { "seconds", RESULT_NUMBER, .unit = "s", .null = "without it there is no answer",
      .means = "CPU time that it costs: with less without" },
    { "without", RESULT_OBJECT, .members = failure_keys, .as = { "steady", "floquet" },
      .means = "the answer without it, but its cost and provenance" },
    { 0 },
};

static const struct result_key ablate_keys[] = {
    { "kind", RESULT_TEXT, .means = "ablate" },
    { "of", RESULT_TEXT, .means = "steady where the scene has harmonic loads, else floquet" },
    { "seconds", RESULT_NUMBER, .unit = "s", .means = "CPU time of the whole scene's answer" },
    { "effects", RESULT_OBJECT, .list = "as the scene lists them", .members = ablated_keys,
      .means = "what each costs and changes" },
    { "with", RESULT_OBJECT, .as = { "steady", "floquet" },
      .means = "the whole scene's answer, but its cost and provenance" },
    PLAN,
    COST,
    PROVENANCE,
    { 0 },
};

static const struct result_key sweep_point_keys[] = {
    { "index", RESULT_WHOLE, .list = "one an axis", .means = "which of its values, from 0" },
    { "exponent", RESULT_COMPLEX, .unit = "1/s, rad/s", .absent = "but of floquet",
      .means = "the one with the largest real part" },
    { "error", RESULT_OBJECT, .members = error_keys, .absent = "where it has an answer",
      .means = "why it has none" },
    { 0 },
};

static const struct result_key axis_keys[] = {
    { "path", RESULT_TEXT, .means = "of a number of the scene" },
    { "values", RESULT_NUMBER, .list = "in the order asked for", .means = "that it takes" },
    { 0 },
};

static const struct result_key sweep_keys[] = {
    { "kind", RESULT_TEXT, .means = "sweep" },
    { "verb", RESULT_TEXT, .means = "floquet, steady or identify" },
    { "total", RESULT_WHOLE, .means = "points of the whole grid" },
    { "grid", RESULT_OBJECT, .list = "of axes, as asked for", .members = axis_keys,
      .means = "what was varied" },
    { "points", RESULT_OBJECT, .list = "the last axis runs fastest", .members = sweep_point_keys,
      .as = { "floquet", "steady", "identify" },
      .means = "an answer each, of floquet its stability" },
    COST,
    PROVENANCE,
    { 0 },
};

/* ---- events ---- */

static const struct result_key progress_keys[] = {
    { "fraction", RESULT_NUMBER, .null = UNKNOWN, .means = "of the work that is done, 0 to 1" },
    { "parameter", RESULT_TEXT, .absent = "but of a curve", .means = "its parameter" },
    { "value", RESULT_NUMBER, .absent = "but of a curve", .means = "where it is" },
    { "converged", RESULT_TRUTH, .absent = "but of a curve", .means = "of that point" },
    { "amplitude", RESULT_NUMBER, .absent = "but of a curve", .null = UNKNOWN,
      .means = "max |x(t)| over the dofs there" },
    { "stable", RESULT_TRUTH, .absent = "but of a curve, where it is known", .means = "there" },
    { "rung", RESULT_WHOLE, .absent = "but of a tradeoff", .means = "that begins" },
    { "rungs", RESULT_WHOLE, .absent = "but of a tradeoff", .means = "that there are" },
    { "done", RESULT_WHOLE, .absent = "but of a sweep", .means = "points of this share" },
    { "total", RESULT_WHOLE, .absent = "but of a sweep", .means = "points in it" },
    { "first", RESULT_WHOLE, .absent = "but of a sweep", .means = "of the points it brings" },
    { "count", RESULT_WHOLE, .absent = "but of a sweep", .means = "of these" },
    { "points", RESULT_OBJECT, .list = "as in the result", .absent = "but of a sweep",
      .members = sweep_point_keys, .as = { "floquet", "steady", "identify" },
      .means = "those that are new, where they fit 4096 bytes" },
    { 0 },
};

const struct result_document result_documents[] = {
    { "identify", true, identify_keys, "modes of a batch of signals" },
    { "steady", true, steady_keys, "a steady-state motion" },
    { "curve", true, curve_keys, "of steady with --sweep or --continue" },
    { "backbone", true, backbone_keys, "of steady with -o backbone" },
    { "simulate", true, simulate_keys, "beside the batch of signals" },
    { "floquet", true, floquet_keys, "exact exponents of a linear scene" },
    { "tradeoff", true, tradeoff_keys, "error against time over a ladder of settings" },
    { "ablate", true, ablate_keys, "each effect's cost and influence" },
    { "sweep", true, sweep_keys, "a scene over a grid of its values" },
    { "progress", false, progress_keys, "an event while a job runs" },
    { "live modes", false, live_window_keys, "an event of a stream: a window" },
    { "live track", false, live_track_keys, "an event of a stream: a mode came or went" },
    { "live alarm", false, live_alarm_keys, "an event of a stream: a rule" },
    { 0 },
};
