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
#include "modal/identify/fit/refine.h"
#include "modal/identify/prepare/grid.h"
#include "modal/numbers.h"

enum {
    HELD = 3,                               /* equal extremes that are a plateau */
    NEAR = 8,                               /* an extreme: a step is told among so many */
    PLATEAUS = 2,                           /* that are a finding, as above */
    ROWS = 64                               /* of a file mapped that are held at a time */
};
static const double
    GRID_LEAST = 1e-4,                      /* of the rms */
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

    /* of the range: less is the rounding of one value */
    for (int k = 1; k < L; k++)
        if (x[k] - x[k - 1] > REFINE_TIED * range)
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

    for (int i = 0; x != NULL && i < result->channel_count && i < GRID_CHANNELS; i++) {
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

/*
 * Motion that comes to a stop of its converter is on its way at one sample and held at the next.  A
 * smooth one that stays for n samples within one step q of its peak P - c t^2 has
 * c ((n - 1) / 2)^2 <= 2 q, where noise within half a step at either side is let pass for motion,
 * and so came from two samples before to one before by c (n + 2) <= 8 q (n + 2) / (n - 1)^2, as
 * rounding and that noise have it, by 2 q more.  That is how far it may come; how far it came, the
 * shorter way of before and after, is S of it.
 *
 * Motion that is not smooth between samples, which goes by S at a time, still meets the one step
 * of its peak with each of n - 1 samples by a chance of 1 / S or less; so do smooth ones whose peak
 * is flat by chance (of t^4 alone: S^(n - 1) < 500).  Noise gives each of the extreme's RUNS such a
 * chance; that periods repeat gives them none.  A grid need not be known: q is the least distance
 * among the values NEAR the extreme, which is never less than its step.
 */
static double way_allowed(int n)
{
    return 8. * (n + 2) / ((n - 1.) * (n - 1)) + 2;
}

struct rail { double value; int samples; double ln_chance; };

/* The extreme of x in the direction of SIGN, of SORTED values, and the ln of the chance that it was
 * not cut off. */
static struct rail look_at(const double *x, const double *sorted, int L, int sign)
{
    const double *end = sign > 0 ? sorted + L - 1 : sorted;
    double range = sorted[L - 1] - sorted[0], step = range, surest = 0;
    struct rail rail = { .value = *end };
    int runs = 0;

    for (int k = 1, steps = 0; k < L && steps < NEAR; k++) {
        double apart = fabs(end[-sign * k] - end[-sign * (k - 1)]);
        if (apart > REFINE_TIED * range)
            step = fmin(step, apart), steps++;
    }
    for (int k = 0, first = 0; k <= L; k++)
        if (k == L || x[k] != rail.value) {
            int n = k - first;
            rail.samples += n, runs += n > 0;
            if (n >= HELD && first > 1 && k + 1 < L) {
                double way = fmin(sign * (x[first - 1] - x[first - 2]), sign * (x[k] - x[k + 1]));
                if (way > 0)
                    surest = fmax(surest, (n - 1) * log(way / (way_allowed(n) * step)));
            }
            first = k + 1;
        }
    rail.ln_chance = log(runs) - surest;
    return rail;
}

bool screen_rails(const struct batch *b, size_t first, size_t count, struct identify_result *result)
{
    double *x = malloc(2 * sizeof *x * (count + 1)), *sorted = x + count;
    double chance = log(IDENTIFY_ALARM / result->channel_count);
    struct batch part = *b;
    bool any = false;

    part.signals += first * b->channels;

    for (int i = 0; x != NULL && i < result->channel_count && count >= SAMPLES_LEAST; i++) {
        int c = result->channel[i], L = (int)count, held;
        double least = HUGE_VAL, most = -HUGE_VAL;
        struct rail low, high;
        read_channel(&part, (size_t)c, L, x);
        for (int k = 0; k < L; k++)
            least = fmin(least, x[k]), most = fmax(most, x[k]);
        if (runs_at(x, L, least) == 0 || runs_at(x, L, most) == 0)
            continue;                           /* most channels: not sorted */
        memcpy(sorted, x, sizeof *x * count);
        numbers_sort(sorted, count);
        low = look_at(x, sorted, L, -1), high = look_at(x, sorted, L, 1);
        held = low.samples + high.samples;
        /* contact forces hold one, signals of two levels both, most of the time */
        if (!(low.ln_chance < chance) || !(high.ln_chance < chance) || held > L - held)
            continue;
        any = true;
        identify_diagnose(result, "clipped", c, "channel %d holds its extremes %g and %g in %d "
                          "samples, and comes to both at full speed: its peaks are cut off, errors "
                          "are unknown and no verdict is given; measure with less gain, or "
                          "identify a window without them", c, low.value, high.value, held);
    }
    free(x);
    return any;
}
