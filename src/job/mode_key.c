/* mode_key.c - what is told of a record, its modes and how they were found: rows of result_key.h */
#include <stddef.h>
#include "job/result_key.h"

#define UNKNOWN "not known"

static const struct result_key mode_std_keys[] = {
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .null = UNKNOWN, .means = "of frequency_hz" },
    { "damping_ratio", RESULT_NUMBER, .null = UNKNOWN, .means = "of damping_ratio" },
    { "exponent", RESULT_COMPLEX, .unit = "1/s, rad/s", .null = UNKNOWN,
      .means = "of its real and of its imaginary part" },
    { "multiplier", RESULT_NUMBER, .null = UNKNOWN, .means = "of |multiplier|" },
    { 0 },
};

static const struct result_key bound_keys[] = {
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .null = UNKNOWN,
      .means = "standard deviation then, excited again in the same way" },
    { "damping_ratio", RESULT_NUMBER, .null = UNKNOWN, .means = "likewise" },
    { 0 },
};

static const struct result_key harmonic_keys[] = {
    { "k", RESULT_WHOLE, .means = "the mode's part with exponent + i k 2 pi/period" },
    { "magnitude", RESULT_NUMBER, .means = "of that part, over all signals; the strongest first" },
    { 0 },
};

const struct result_key identify_mode_keys[] = {
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .null = UNKNOWN,
      .means = "|resolved_exponent| / (2 pi): undamped" },
    { "frequency_rad_s", RESULT_NUMBER, .unit = "rad/s", .null = UNKNOWN,
      .means = "|resolved_exponent|" },
    { "damped_frequency_rad_s", RESULT_NUMBER, .unit = "rad/s", .null = UNKNOWN,
      .means = "|Im resolved_exponent|; 0 of a real exponent" },
    { "damping_ratio", RESULT_NUMBER, .null = UNKNOWN,
      .means = "-Re resolved_exponent / |resolved_exponent|; below 0 it grows" },
    { "exponent", RESULT_COMPLEX, .unit = "1/s, rad/s", .null = UNKNOWN,
      .means = "lambda of exp(lambda t), Im >= 0; with a period its principal value" },
    { "resolved_exponent", RESULT_COMPLEX, .unit = "1/s, rad/s", .null = UNKNOWN,
      .means = "exponent + i resolved_k 2 pi/period; the same without a period" },
    { "multiplier", RESULT_COMPLEX, .null = UNKNOWN,
      .means = "exp(lambda T) over the period, or over one sample of the batch as sent" },
    { "amplitude", RESULT_NUMBER, .null = UNKNOWN,
      .means = "rms of its part over the record, channels scaled to unit rms" },
    { "energy", RESULT_NUMBER, .null = UNKNOWN, .means = "its share of that of all modes, 0 to 1" },
    { "persistence", RESULT_NUMBER, .null = "it was not looked for",
      .means = "share of the orders and windows tried that show it, 0 to 1" },
    { "residual", RESULT_NUMBER, .null = UNKNOWN,
      .means = "sine of the angle between its powers and the signals' subspace: 0 is exact" },
    { "std", RESULT_OBJECT, .members = mode_std_keys,
      .means = "standard deviations, widened where the model is in doubt" },
    { "bar", RESULT_NUMBER, .null = UNKNOWN,
      .means = "on |multiplier|: the largest of the estimates of its error" },
    { "participation", RESULT_COMPLEX, .list = "one an input",
      .absent = "without response=forced and shapes=true", .null = UNKNOWN,
      .means = "times shape, over s - exponent: the mode's part of response over input" },
    { "shape", RESULT_COMPLEX, .list = "one a channel", .absent = "without shapes=true",
      .null = UNKNOWN, .means = "the mode's shape, its largest component 1" },
    { "mpc", RESULT_NUMBER, .absent = "without shapes=true", .null = UNKNOWN,
      .means = "modal phase collinearity of the shape: 1 is a standing wave" },
    { "harmonics", RESULT_OBJECT, .list = "the strongest first", .absent = "without a period",
      .members = harmonic_keys, .means = "what the mode is made of over the period" },
    { "resolved_k", RESULT_WHOLE, .absent = "without a period",
      .means = "the k of the strongest of these" },
    { "runner_up", RESULT_NUMBER, .absent = "without a period", .null = UNKNOWN,
      .means = "magnitude of the second over the first: 1 is a tie" },
    { "cycles", RESULT_NUMBER, .absent = "of a free response", .means = "swings in the record" },
    { "bound_at_2x", RESULT_OBJECT, .absent = "of a free response", .members = bound_keys,
      .means = "what twice the record would give" },
    { 0 },
};

const struct result_key identify_verdict_keys[] = {
    { "stable", RESULT_TRUTH, .null = "undecided", .means = "every motion decays" },
    { "max_multiplier", RESULT_NUMBER, .null = "no mode",
      .means = "the largest |multiplier|; above 1 it grows" },
    { "margin", RESULT_NUMBER, .unit = "1/s", .null = "no mode",
      .means = "-max Re exponent, the offset apart" },
    { "margin_std", RESULT_NUMBER, .unit = "1/s", .null = UNKNOWN, .means = "of margin" },
    { "decides", RESULT_WHOLE, .null = "no mode", .means = "the mode that the verdict rests on" },
    { 0 },
};

const struct result_key identify_rank_keys[] = {
    { "pod", RESULT_WHOLE, .means = "proper orthogonal signals kept" },
    { "hankel", RESULT_WHOLE, .means = "order: exponents, two for a conjugate pair" },
    { "rule", RESULT_TEXT, .means = "the one that chose it: see rank.rule in modalctl(1)" },
    { "energy", RESULT_NUMBER, .null = UNKNOWN, .means = "share of the singular values kept" },
    { "singular_values", RESULT_NUMBER, .list = "of the Hankel matrix, leading ones",
      .null = UNKNOWN, .means = "over the first" },
    { "freedom", RESULT_WHOLE, .means = "equations less unknowns, each signal and phase" },
    { 0 },
};

static const struct result_key signal_keys[] = {
    { "name", RESULT_TEXT, .means = "of the channel; ch0, ch1, .. where it has none" },
    { "rms_error", RESULT_NUMBER, .unit = "the channel's", .null = UNKNOWN,
      .means = "rms of signal less what the modes rebuild" },
    { "relative_error", RESULT_NUMBER, .null = "the channel is zero",
      .means = "rms_error over the channel's rms" },
    { 0 },
};

const struct result_key identify_rebuilt_keys[] = {
    { "signals", RESULT_OBJECT, .list = "one a channel", .members = signal_keys,
      .means = "how well each is rebuilt" },
    { "relative_error", RESULT_NUMBER, .null = UNKNOWN, .means = "of all together" },
    { 0 },
};

static const struct result_key response_curve_keys[] = {
    { "input", RESULT_TEXT, .means = "the channel of the excitation" },
    { "name", RESULT_TEXT, .means = "the channel of the response" },
    { "value", RESULT_COMPLEX, .list = "one a frequency", .null = UNKNOWN,
      .means = "response over excitation, in the channels' units" },
    { "std", RESULT_NUMBER, .list = "one a frequency", .null = UNKNOWN,
      .means = "standard deviation of value, as a distance in the complex plane" },
    { 0 },
};

const struct result_key identify_frf_keys[] = {
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .list = "rising, closer about modes",
      .means = "where it is told" },
    { "curves", RESULT_OBJECT, .list = "one an input and response",
      .members = response_curve_keys, .means = "the modes' and the direct terms' together" },
    { 0 },
};

static const struct result_key candidate_keys[] = {
    { "order", RESULT_WHOLE, .means = "exponents" },
    { "bic", RESULT_NUMBER, .null = UNKNOWN,
      .means = "Bayesian information criterion: the least is chosen" },
    { "residual", RESULT_NUMBER, .null = UNKNOWN, .means = "relative, of the signals" },
    { "refined", RESULT_TRUTH, .means = "fitted to the samples themselves" },
    { "converged", RESULT_TRUTH, .means = "and that fit ended" },
    { "chosen", RESULT_TRUTH, .means = "the answer's" },
    { 0 },
};

const struct result_key identify_order_keys[] = {
    { "rule", RESULT_TEXT, .means = "bic, or the rank's rule" },
    { "candidates", RESULT_OBJECT, .list = "of orders looked at", .members = candidate_keys,
      .means = "how each fits" },
    { 0 },
};

const struct result_key identify_pole_keys[] = {
    { "order", RESULT_WHOLE, .means = "of the fit that has it" },
    { "exponent", RESULT_COMPLEX, .unit = "1/s, rad/s", .null = UNKNOWN, .means = "of it" },
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .null = UNKNOWN, .means = "undamped" },
    { "damping_ratio", RESULT_NUMBER, .null = UNKNOWN, .means = "as a mode's" },
    { "std", RESULT_COMPLEX, .unit = "1/s, rad/s", .null = UNKNOWN, .means = "of exponent" },
    { "mode", RESULT_WHOLE, .null = "it is none of the answer's",
      .means = "the answer's mode that it is" },
    { 0 },
};

const struct result_key identify_cluster_keys[] = {
    { "centroid", RESULT_COMPLEX, .means = "mean of their multipliers" },
    { "radius", RESULT_NUMBER, .null = UNKNOWN, .means = "the farthest from it" },
    { "members", RESULT_WHOLE, .list = "of modes", .means = "which, from 0" },
    { "near_defective", RESULT_TRUTH, .means = "only their mean is well determined" },
    { 0 },
};

static const struct result_key trend_std_keys[] = {
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .null = UNKNOWN, .means = "of frequency_hz" },
    { "damping_ratio", RESULT_NUMBER, .null = UNKNOWN, .means = "of damping_ratio" },
    { 0 },
};

const struct result_key identify_trend_keys[] = {
    { "t", RESULT_NUMBER, .unit = "s", .means = "middle of the part" },
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .null = UNKNOWN, .means = "there" },
    { "damping_ratio", RESULT_NUMBER, .null = UNKNOWN, .means = "there" },
    { "amplitude", RESULT_NUMBER, .null = UNKNOWN, .means = "there, as a mode's" },
    { "std", RESULT_OBJECT, .members = trend_std_keys, .means = "standard deviations" },
    { 0 },
};

const struct result_key identify_input_keys[] = {
    { "samples", RESULT_WHOLE, .means = "of the batch" },
    { "channels", RESULT_WHOLE, .means = "of the batch" },
    { "dt", RESULT_NUMBER, .unit = "s", .means = "of the batch" },
    { "period", RESULT_NUMBER, .unit = "s", .means = "of the batch; 0: none" },
    { "units", RESULT_TEXT, .absent = "where the file has none", .means = "as the file says" },
    { "attributes", RESULT_OWN, .absent = "where the file has none", .means = "as they came" },
    { 0 },
};
