/*
 * screen.c - clipped and quantised samples
 *
 * A sampled free decay meets its own extreme value exactly at one sample; a converter at its stop
 * holds it.  Runs of HELD equal extremes in floating point happen by chance with probability below
 * 2^-100, so two of them are a finding.
 *
 * Grid: the sorted values' smallest step q (beyond rounding) is a grid if every step is a multiple
 * of it to a thousandth.  Continuous values, L of them, have steps as small as rms / L^2, which is
 * no grid anyone can see.
 */
#include "modal/identify/ask/screen.h"
#include "modal/identify/ask/diagnose.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"

enum {
    HELD = 3,                               /* equal extremes that are a plateau */
    PLATEAUS = 2,                           /* that are a finding, as above */
    ROWS = 64                               /* of a file mapped that are held at a time */
};
static const double
    GRID_LEAST = 1e-4,                      /* of the rms */
    APART = 1e-9,                           /* of the range: less is the rounding of one value */
    OFF = 1e-3;                             /* of a step, or of many: no multiple, as above */
enum {
    STEPS_LEAST = 3,                        /* that a grid has: two make one by chance */
    SAMPLES_LEAST = 3                       /* that have anything wrong */
};

static int runs_at(const double *x, int L, double value)
{
    int runs = 0;

    for (int k = 0, held = 0; k < L; k++) {
        held = x[k] == value ? held + 1 : 0;
        runs += held == HELD;
    }
    return runs;
}

static void look_for_clipping(const double *x, int L, int channel, struct identify_result *result)
{
    double low = x[0], high = x[0];
    int runs;

    for (int k = 1; k < L; k++)
        low = fmin(low, x[k]), high = fmax(high, x[k]);
    if (!(high > low))
        return;
    runs = runs_at(x, L, high) + runs_at(x, L, low);
    if (runs >= PLATEAUS)
        identify_diagnose(result, "clipped", channel,
                          "channel %d holds its extreme values %g and %g for %d samples or more in "
                          "%d places: peaks are cut off; "
                          "begin the window later, or measure with less gain",
                          channel, low, high, HELD, runs);
}

/* X is sorted. */
static bool look_for_grid(const double *x, int L, double rms, int channel,
                          struct identify_result *result)
{
    double range = x[L - 1] - x[0], step = range;
    int off = 0, steps = 0;

    for (int k = 1; k < L; k++)
        if (x[k] - x[k - 1] > APART * range)
            step = fmin(step, x[k] - x[k - 1]);
    if (!(step > GRID_LEAST * rms) || !(range > 0))
        return false;
    for (int k = 1; k < L; k++) {
        double turns = (x[k] - x[k - 1]) / step;
        steps += turns > 0.5;
        off += fabs(turns - nearbyint(turns)) > OFF * fmax(1, turns);
    }
    if (off > 0 || steps < STEPS_LEAST)
        return false;
    identify_diagnose(
        result, "quantised", channel,
        "the values of channel %d lie on a grid of %g, %.2g of its rms: rounding acts as noise of "
        "%g; "
        "end the window before the signal falls to the grid, or record with more digits",
        channel, step, step / rms, step / sqrt(12));
    return true;
}

/* The first L samples of channel c, and the largest magnitude of them; ROWS at a time are held. */
static double read_channel(const struct batch *b, size_t c, int L, double *x)
{
    const size_t row = b->channels * sizeof(double);
    double most = 0;

    for (int k = 0; k < L; k++) {
        most = fmax(most, fabs(x[k] = b->signals[(size_t)k * b->channels + c]));
        if (b->release != NULL && (k % ROWS == ROWS - 1 || k + 1 == L))
            b->release(b->signals + (size_t)(k / ROWS * ROWS) * b->channels,
                       (size_t)(k % ROWS + 1) * row);
    }
    return most;
}

void screen_samples(const struct batch *b, struct identify_result *result)
{
    int L = b->samples < SCREEN_SAMPLES ? (int)b->samples : SCREEN_SAMPLES;
    double *x = malloc(2 * sizeof *x * ((size_t)L + 1)), *sorted = x + L;

    for (int i = 0; x != NULL && i < result->channel_count && i < SCREEN_CHANNELS; i++) {
        size_t c = (size_t)result->channel[i];
        double most = read_channel(b, c, L, x), sum = 0;
        for (int k = 0; k < L && most > 0; k++)
            sum += (x[k] / most) * (x[k] / most);
        if (L < SAMPLES_LEAST || most < DBL_MIN / DBL_EPSILON)
            continue;
        memcpy(sorted, x, (size_t)L * sizeof *x);
        numbers_sort(sorted, (size_t)L);
        /* on a coarse grid every peak is held */
        if (!look_for_grid(sorted, L, most * sqrt(sum / L), (int)c, result))
            look_for_clipping(x, L, (int)c, result);
    }
    free(x);
}
