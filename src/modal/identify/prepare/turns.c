/*
 * turns.c - see turns.h
 *
 * Between rows the angle is taken as linear, the columns as the polynomial of degree 7 through the
 * rows about it in Lagrange's form; of a motion at a quarter of the sampling rate it is off by
 * (pi/4)^8 2 / 1000 or so of that, at half of that frequency by a 250th of it.
 *
 * Tested by tests/unit/modal/identify/test_turns.c.
 */
#include "modal/identify/prepare/turns.h"
#include <math.h>
#include <stdlib.h>

static const double
    TURN[] = { 1, 2 * M_PI, 360 },
    BEYOND = 1e-3,               /* of a turn: how far rounding and noise may go */
    FILLED = 0.5;                /* of a turn: what its largest angle is beyond its least */

/* What a turn is in the unit of the angle; 0: none fits. */
static double turn_of(const double *x, size_t stride, int rows)
{
    double least = x[0], most = x[0];

    for (int k = 1; k < rows; k++) {
        least = fmin(least, x[(size_t)k * stride]);
        most = fmax(most, x[(size_t)k * stride]);
    }
    for (size_t i = 0; i < sizeof TURN / sizeof *TURN; i++)
        if (most - least <= TURN[i] * (1 + BEYOND))
            return most - least > TURN[i] * FILLED ? TURN[i] : 0;
    return 0;
}

enum modal_status turns_read(const double *x, size_t stride, int rows, double *turn,
                             struct modal_error *err)
{
    double whole = turn_of(x, stride, rows), sign = 0;

    if (whole == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "azimuth", "azimuth: the channel is no angle "
                                "that begins anew each turn; accepted: one within 360 degrees, "
                                "2 pi, or 1, that fills them");
    turn[0] = 0;
    for (int k = 1; k < rows; k++) {
        double step = (x[(size_t)k * stride] - x[(size_t)(k - 1) * stride]) / whole;
        /* of all whole turns the step nearest to none: more than two samples a turn make it the
         * right one */
        turn[k] = turn[k - 1] + step - round(step);
    }
    sign = turn[rows - 1] < 0 ? -1 : 1;
    for (int k = 0; k < rows; k++)
        turn[k] *= sign;
    for (int k = 1; k < rows; k++)
        if (turn[k] < turn[k - 1])
            return modal_fail_field(err, MODAL_BAD_INPUT, "azimuth", "azimuth turns back at sample "
                                    "%d, by %.3g of a turn, or takes half a turn there; accepted: "
                                    "an angle that only advances, more than two samples a turn", k,
                                    turn[k - 1] - turn[k]);
    return MODAL_OK;
}

double turns_rows_each(const double *turn, int rows)
{
    return (rows - 1) / (turn[rows - 1] - turn[0]);
}

enum modal_status turns_resample(struct matrix *Y, const double *turn, int phases, int points,
                                 struct modal_error *err)
{
    int L = Y->m, rows = (int)floor((turn[L - 1] - turn[0]) * phases) + 1, at = 0;
    double *x = malloc(sizeof *x * (size_t)rows * (size_t)Y->n), weight[TURNS_POINTS];

    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d x %d", rows, Y->n);
    for (int i = 0; i < rows; i++) {
        double angle = turn[0] + (double)i / phases, row;
        int first;
        while (at < L - 2 && turn[at + 1] <= angle)
            at++;
        /* the angle is straight between samples, the signals are not: they get degree points - 1 */
        row = turn[at + 1] > turn[at] ? at + (angle - turn[at]) / (turn[at + 1] - turn[at]) : at;
        first = at - points / 2 + 1;
        /* one-sided at the ends */
        first = first < 0 ? 0 : first > L - points ? L - points : first;
        record_lagrange(row - first, points, weight);
        for (int c = 0; c < Y->n; c++) {
            const double *y = Y->x + (size_t)c * Y->ld + first;
            double sum = 0;
            for (int j = 0; j < points; j++)
                sum += weight[j] * y[j];
            x[i + (size_t)rows * (size_t)c] = sum;
        }
    }
    free(Y->x);
    *Y = (struct matrix) { rows, Y->n, rows, x };
    return MODAL_OK;
}

enum modal_status turns_even_out(struct record *r, const double *turn, struct modal_error *err)
{
    double each = turns_rows_each(turn, r->Y.m);
    enum modal_status rc;

    r->period = each * r->step;
    r->per_period = (int)lround(each);      /* as many as before, evenly: nothing is decimated */
    rc = turns_resample(&r->Y, turn, r->per_period, TURNS_POINTS, err);
    r->step = r->period / r->per_period;
    return rc;
}

void turns_lengths(const double *turn, int rows, int turns, double *longer)
{
    double each = turns_rows_each(turn, rows), before = 0;

    for (int i = 0, at = 0; i < turns; i++) {
        double angle = turn[0] + i + 1, row;
        while (at < rows - 2 && turn[at + 1] <= angle)
            at++;
        row = turn[at + 1] > turn[at] ? at + (angle - turn[at]) / (turn[at + 1] - turn[at]) : at;
        longer[i] = angle <= turn[rows - 1] ? (row - before) / each - 1 : 0;
        before = row;
    }
}

enum modal_status turns_even(struct record *r, const struct batch *b, const int *azimuth,
                             double **longer, struct modal_error *err)
{
    size_t first = (size_t)llround(r->t0 / b->dt);
    int rows = r->Y.m;
    double *turn = calloc((size_t)rows + 1, sizeof *turn);
    enum modal_status rc = MODAL_OK;

    if (turn == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d angles", r->Y.m);
    if (azimuth != NULL)
        rc = turns_read(b->signals + first * b->channels + (size_t)*azimuth, b->channels, rows,
                        turn, err);
    for (int k = 0; k < rows && azimuth == NULL; k++)
        turn[k] = k * r->step / r->period;
    if (rc == MODAL_OK)
        rc = turns_even_out(r, turn, err);
    if (rc == MODAL_OK && azimuth != NULL) {
        int turns = r->Y.m / r->per_period;
        *longer = malloc(sizeof **longer * ((size_t)turns + 1));
        if (*longer != NULL)
            turns_lengths(turn, rows, turns, *longer);
        else
            rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d turns", turns);
    }
    free(turn);
    return rc;
}

enum modal_status turns_leave_azimuth(const struct batch *b, struct identify_options *cut,
                                      int **list, struct modal_error *err)
{
    int all = cut->channels != NULL ? cut->channel_count : (int)b->channels, count = 0;

    *list = NULL;
    if (cut->azimuth == NULL)
        return MODAL_OK;
    *list = malloc(sizeof **list * ((size_t)all + 1));
    if (*list == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d channels", all);
    for (int c = 0; c < all; c++) {
        int channel = cut->channels != NULL ? cut->channels[c] : c;
        if (channel != *cut->azimuth)
            (*list)[count++] = channel;
    }
    cut->channels = *list, cut->channel_count = count;
    cut->period = -1;
    return count > 0 ? MODAL_OK
                     : modal_fail_field(err, MODAL_BAD_INPUT, "azimuth", "azimuth is the only "
                                        "channel; accepted: at least one beside it");
}
