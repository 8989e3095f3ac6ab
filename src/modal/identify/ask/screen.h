/* screen.h - what is wrong with the samples themselves: clipped, quantised */
#ifndef MODAL_SCREEN_H
#define MODAL_SCREEN_H
#include <stdbool.h>
#include "modal/batch.h"
#include "modal/identify/result.h"

enum {
    SCREEN_SAMPLES = 20000      /* of each: they are sorted */
};

/*
 * Look at the first GRID_CHANNELS of the channels chosen (result->channel) and SCREEN_SAMPLES
 * samples as they were sent, and add diagnostics with the channel at fault:
 *
 *   clipped     the largest or smallest value is held for three samples or more, at least twice:
 *               peaks are cut off
 *   quantised   all values lie on a grid coarser than a ten-thousandth of the channel's rms
 *
 * Constant and zero channels have neither.  Out of memory it looks at nothing.
 */
void screen_samples(const struct batch *batch, struct identify_result *result);

/*
 * The same of responses that go on throughout, of rows FIRST .. FIRST + COUNT - 1 of all channels
 * chosen: clipped, where both extremes are held longer than any motion is that comes to them and
 * goes as fast (screen.c).  Is one?  Out of memory, none.
 */
bool screen_rails(const struct batch *batch, size_t first, size_t count,
                  struct identify_result *result);
#endif
