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
static const double LINGERS = M_SQRT1_2;
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

/* ln of the chance that AT of so many ALL are at the extreme, or more, at LINGERS each: Chernoff's
 * bound. */
static double ln_chance(double at, double all)
{
    double share = at / all, rest = 1 - share;

    if (!(share > LINGERS))
        return 0;
    return -all * (share * log(share / LINGERS)
                   + (rest > 0 ? rest * log(rest / (1 - LINGERS)) : 0));
}

/* How many of sorted X, N of them, are at the extreme in the direction of SIGN; *all: and at the
 * value next to it. */
static int count_extreme(const double *x, int n, int sign, int *all)
{
    const double *end = sign > 0 ? x + n - 1 : x;
    int at = 0;

    while (at < n && end[-sign * at] == *end)
        at++;
    for (*all = at; *all < n && end[-sign * *all] == end[-sign * at];)
        ++*all;
    return at;
}

/* Of a channel's sorted X: at those of its extremes that it was cut off at. */
static int count_at_rails(const double *x, int n, double alarm)
{
    int at[2], all[2], ties = 0, held = 0;

    for (int k = 1; k < n; k++)
        ties += x[k] == x[k - 1] && x[k] > x[0] && x[k] < x[n - 1];
    for (int end = 0; end < 2; end++) {
        at[end] = count_extreme(x, n, 2 * end - 1, &all[end]);
        if ((ties == 0 && at[end] >= HELD) || ln_chance(at[end], all[end]) < log(alarm))
            held += at[end];
    }
    if (ln_chance(at[0] + at[1], all[0] + all[1]) < log(alarm))
        held = at[0] + at[1];
    return 2 * (at[0] + at[1]) > n ? 0 : held;
}

/* Are there as many samples at an extreme as are a finding?  Most channels are not sorted. */
static bool has_rail(const double *x, size_t n)
{
    double low = x[0], high = x[0];
    int at_low = 0, at_high = 0;

    for (size_t k = 1; k < n; k++)
        low = fmin(low, x[k]), high = fmax(high, x[k]);
    for (size_t k = 0; k < n; k++)
        at_low += x[k] == low, at_high += x[k] == high;
    return high > low && (at_low >= HELD || at_high >= HELD);
}

bool screen_rails(const struct batch *b, size_t first, size_t count, struct identify_result *result)
{
    double *x = malloc(sizeof *x * (count + 1));
    double alarm = IDENTIFY_ALARM / (3. * result->channel_count);   /* either extreme, or both */
    bool any = false;

    for (int i = 0; x != NULL && i < result->channel_count && count >= SAMPLES_LEAST; i++) {
        int c = result->channel[i], held = 0;
        for (size_t k = 0; k < count; k++)
            x[k] = b->signals[(first + k) * b->channels + (size_t)c];
        if (has_rail(x, count)) {
            numbers_sort(x, count);
            held = count_at_rails(x, (int)count, alarm);
        }
        any = any || held > 0;
        if (held > 0)
            identify_diagnose(result, "clipped", c, "channel %d holds its extremes %g and %g in %d "
                              "samples, more than motion does: its peaks are cut off, errors are "
                              "unknown and no verdict is given; measure with less gain, or "
                              "identify a window without them", c, x[0], x[count - 1], held);
    }
    free(x);
    return any;
}
