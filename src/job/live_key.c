/* live_key.c - what is told of the live windows of a stream: rows of result_key.h; PROTOCOL.md,
 * section 11, says when */
#include <stddef.h>
#include "job/result_key.h"

/* Of every event of a stream. */
#define STREAM_EVENT(WHAT)                                                                         \
    { "event", RESULT_TEXT, .means = WHAT },                                                       \
    { "number", RESULT_WHOLE, .means = "of the event: it can be replayed from there" },            \
    { "time", RESULT_NUMBER, .unit = "s", .means = "when it was told, UTC" },                      \
    { "stream", RESULT_TEXT, .means = "its name" },                                                \
    { "stream_id", RESULT_TEXT, .means = "which of that name" },                                   \
    { "epoch", RESULT_WHOLE, .means = "of its samples: a run taken up again begins another" },     \
    { "from", RESULT_WHOLE, .means = "first sample of the window" },                               \
    { "to", RESULT_WHOLE, .means = "its last" },                                                   \
    { "dt", RESULT_NUMBER, .unit = "s", .means = "between two samples" }

#define NO_MODE "where the window has no such mode"

static const struct result_key update_keys[] = {
    { "updated", RESULT_TRUTH, .means = "the modes are those of the window before, renewed" },
    { "why", RESULT_TEXT, .null = "where they were", .means = "why they were found from nothing" },
    { "updates", RESULT_WHOLE, .means = "windows of the stream brought up to date so far" },
    { "batches", RESULT_WHOLE, .means = "windows found from nothing so far" },
    { "cpu_s", RESULT_NUMBER, .unit = "s", .means = "that this window took" },
    { 0 },
};

static const struct result_key lag_keys[] = {
    { "samples", RESULT_WHOLE, .means = "that had come after the window when it was told" },
    { "bytes", RESULT_WHOLE, .means = "of these" },
    { 0 },
};

static const struct result_key gap_keys[] = {
    { "count", RESULT_WHOLE, .means = "of gaps in the epoch so far" },
    { "samples", RESULT_WHOLE, .means = "that they lack" },
    { 0 },
};

static const struct result_key mode_keys[] = {
    { "track", RESULT_WHOLE, .means = "a number that stays with the mode from window to window" },
    { 0 },
};

static const struct result_key std_keys[] = {
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .absent = "where it is not known",
      .means = "standard deviation" },
    { "damping_ratio", RESULT_NUMBER, .absent = "where it is not known",
      .means = "standard deviation" },
    { 0 },
};

static const struct result_key alarm_mode_keys[] = {
    { "track", RESULT_WHOLE, .means = "its track" },
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .means = "|exponent| / 2 pi" },
    { "damping_ratio", RESULT_NUMBER, .means = "positive decays" },
    { "std", RESULT_OBJECT, .absent = "where it is not known", .members = std_keys,
      .means = "standard deviations" },
    { 0 },
};

const struct result_key live_window_keys[] = {
    STREAM_EVENT("modes: what a window gave"),
    { "verdict", RESULT_TEXT, .absent = "where the window failed",
      .means = "stable, unstable or undecided: stability.stable in a word" },
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .absent = NO_MODE,
      .means = "of the mode of the lowest damping ratio" },
    { "frequency_hz_std", RESULT_NUMBER, .unit = "Hz", .absent = NO_MODE,
      .means = "its standard deviation" },
    { "damping_ratio", RESULT_NUMBER, .absent = NO_MODE, .means = "of the same mode" },
    { "damping_ratio_std", RESULT_NUMBER, .absent = NO_MODE, .means = "its standard deviation" },
    { "modes", RESULT_OBJECT, .list = "with the members that identify gives",
      .absent = "where the window failed", .members = mode_keys,
      .means = "residual and persistence are null in an update" },
    { "stability", RESULT_OWN, .absent = "where the window failed", .means = "as of identify" },
    { "diagnostics", RESULT_OWN, .absent = "where the window failed", .means = "as of identify" },
    { "update", RESULT_OBJECT, .absent = "where the window failed", .members = update_keys,
      .means = "how the modes were found" },
    { "left_out", RESULT_TEXT, .absent = "where all fits an event",
      .means = "shapes, of all modes, or modes, with the diagnostics: too long for an event" },
    { "error", RESULT_OWN, .absent = "where it did not", .means = "why the window failed" },
    { "lag", RESULT_OBJECT, .absent = "of an earlier epoch", .members = lag_keys,
      .means = "how far the modes are behind the samples" },
    { "skipped", RESULT_WHOLE, .means = "windows left out since the one told before" },
    { "gaps", RESULT_OBJECT, .absent = "of an earlier epoch", .members = gap_keys,
      .means = "what the record lacks" },
    { 0 },
};

const struct result_key live_track_keys[] = {
    STREAM_EVENT("track: a mode came or went"),
    { "track", RESULT_WHOLE, .means = "its number" },
    { "state", RESULT_TEXT, .means = "born, died or back" },
    { "frequency_hz", RESULT_NUMBER, .unit = "Hz", .means = "by the track" },
    { "damping_ratio", RESULT_NUMBER, .means = "by the track" },
    { 0 },
};

const struct result_key live_alarm_keys[] = {
    STREAM_EVENT("alarm: a rule of the stream is, or is no longer, broken"),
    { "rule", RESULT_TEXT, .means = "damping_below, growth or new_mode" },
    { "state", RESULT_TEXT, .means = "raised or cleared" },
    { "limit", RESULT_NUMBER, .absent = "of rules without one", .means = "as it was asked for" },
    { "mode", RESULT_OBJECT, .absent = "of growth, and where no mode is left",
      .members = alarm_mode_keys, .means = "that it is about" },
    { 0 },
};
