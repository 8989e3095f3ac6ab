/*
 * slip.c - see slip.h
 *
 * Rows a turn apart are combinations of as many vectors as the motion has real numbers, if turns
 * are the system's; where they slip, each of its lines moves against the others, and the rows fill
 * more directions.  With F the rows at even phases of turns that slip by (1), interpolated, each
 * channel over its noise, and s_i its singular values,
 *
 *     Q = sum_i ln(1 + s_i^2 / edge^2),     edge = sqrt(rows) + sqrt(columns),                  (2)
 *
 * counts the directions that stand above the largest singular value of noise; right turns make it
 * least.  No poles enter, so that it does not matter how many of them a fit has drawn in place of
 * a slip: what is left by them is white.  A crowd of poles is what a slip looks like.
 *
 * Noise alone makes the s_i^2 sum to rows x columns, give or take sqrt(2 rows columns); two slips
 * read other samples, or others' means, and Q of noise differs by chance by up to
 *
 *     sqrt(2) sqrt(2 rows columns) / edge^2 <= 1/2,                                             (3)
 *
 * one standard deviation.  Interpolation takes off some of the noise, of which the weights tell
 * how much; what polynomials of a lesser degree differ by is added to it, as an error that varies.
 *
 * Q has many minima, as far apart as the fastest strong line's turns.  The search begins at none
 * and, over the first turns, at the best of a grid; then it goes on with twice as many turns, in
 * which (1) bends four times as much, until it has all of them.  Of many turns every second, third
 * .. is a row: their directions are as many.
 *
 * Tested by tests/unit/modal/identify/prepare/test_slip.c.
 */
#include "modal/identify/prepare/slip.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/identify/prepare/record.h"
#include "modal/identify/prepare/turns.h"
#include "modal/linalg/eigen.h"

enum {
    COLUMNS_MOST = 256,          /* of F, which has fewer phases where there were more: a Q
                                  * takes some milliseconds, whatever the record is */
    CHANNELS_MOST = 8,           /* the least noisy */
    COARSE_PHASES = 8,           /* of the grid, which only tells apart minima: lines to 4 a turn */
    COARSE_CHANNELS = 2,         /* likewise: where one has a node, the other has none */
    HALVINGS = 7,                /* of a descent's step, to REACHED */
    ORDER_FEW = 8,               /* of more, lines may meet by chance at a period that is wrong, and
                                  * a search costs less than they did */
    HEIGHT = 3,                  /* of the rows: singular values of motion grow as the height, of
                                  * noise more slowly */
    NEWTON_STEPS = 6
};
static const double
    GRID_ENDS = 2,               /* turns, of the first 64: a period that is wrong by 3 % */
    STEP_ENDS = 0.1,             /* turns: a line at 2 a turn moves by a fifth of one */
    GRID_BOW = 0.3,              /* turns: of a speed that changes by 5 % in 48 of them */
    STEP_BOW = 0.06,             /* turns: a line at 2 a turn moves by an eighth of one */
    NEAR = 0.05,                 /* turns: where Q must have risen all around a right period */
    RISEN = 1,                   /* so far: two deviations of (3) */
    QUIET = 1e-6,                /* of a channel's rms: squares of less are lost beside it */
    MOST = 0.125,                /* of all turns: more is no period that somebody took for another,
                                  * nor a speed that is steady but for a drift */
    AWAY = 1,                    /* turns: minima of a line are as near as that, and what goes
                                  * further is on its way out of the record */
    REACHED = NEAR / (1 << (HALVINGS - 1)),      /* turns: a descent's last step */
    STEP_FIRST = 1e-3,           /* turns: of differences, the first; then one deviation */
    STEP_LEAST = 1e-6,           /* turns: of less, differences of Q are rounding */
    STANDS = 1.5;                /* times edge^2: what is counted as a direction */

struct scan {
    const struct slip_record *r;
    double turns;                /* N: of the rows that are searched */
    int rows, apart, phases;     /* rows of F, whole turns from one to the next */
    int channel[CHANNELS_MOST], channels;
    double error[CHANNELS_MOST];         /* variance of the polynomials' errors */
    int height;                  /* rows of F in one of the Hankel matrix's */
    double *F, *G, *H, *s;       /* rows x columns at most; two squares of rows; eigenvalues */
    double edge;                 /* squared, of the last */
    struct modal_error *err;
    enum modal_status rc;
};

static int columns_of(const struct scan *a)
{
    return a->phases * a->channels;
}

/* The least noisy channels that move. */
static void choose_channels(struct scan *a)
{
    const struct matrix *Y = a->r->Y;

    a->channels = 0;
    for (int c = 0; c < Y->n; c++) {
        int at = a->channels;
        if (!(a->r->noise[c] > 0)
            || cblas_idamax(Y->m, Y->x + (size_t)c * Y->ld, 1) >= (size_t)Y->m
            || Y->x[(size_t)c * Y->ld + cblas_idamax(Y->m, Y->x + (size_t)c * Y->ld, 1)] == 0)
            continue;
        if (a->channels < CHANNELS_MOST)
            a->channels++;
        else if (a->r->noise[a->channel[--at]] <= a->r->noise[c])
            continue;
        for (; at > 0 && a->r->noise[a->channel[at - 1]] > a->r->noise[c]; at--)
            a->channel[at] = a->channel[at - 1];
        a->channel[at] = c;
    }
}

/* x of (1), in rows, after TURN turns of the system's own: the root near none, free of
 * cancellation. */
static double slipped(const struct scan *a, double ends, double bow, double turn)
{
    double b = a->turns + ends + 4 * bow;

    return a->r->each * a->turns * 2 * turn / (b + sqrt(fmax(b * b - 16 * bow * turn, 0)));
}

/* As record_lagrange(), in 4 POINTS multiplications: some thousand places a search. */
static void weigh_points(double at, int points, double *weight)
{
    double before = 1, after = 1, factorial = 1;

    for (int i = 0; i < points; i++) {
        weight[i] = before;
        before *= at - i;
        factorial *= i > 0 ? i : 1;
    }
    for (int i = points - 1; i >= 0; i--) {
        double sign = (points - 1 - i) % 2 == 0 ? 1 : -1;
        /* factorial: of i (points - 1 - i), as the products of i - j come to */
        weight[i] *= sign * after / factorial;
        after *= at - i;
        factorial *= (double)(points - i) / fmax(i, 1);
    }
}

/* The rows of F whose turns are within the record; *gain: of white noise, by polynomials of POINTS
 * points.  Returns how many. */
static int fill(struct scan *a, double ends, double bow, int points, double *gain)
{
    const struct matrix *Y = a->r->Y;
    double weight[TURNS_POINTS], sum = 0;
    int used = 0;

    for (int l = 0; l < a->rows; l++) {
        double first = slipped(a, ends, bow, l * a->apart);
        double last = slipped(a, ends, bow, l * a->apart + 1 - 1.0 / a->phases);
        if (!(first >= 0 && last <= Y->m - 1))       /* nor where turns would run backwards */
            continue;
        for (int p = 0; p < a->phases; p++) {
            double row = slipped(a, ends, bow, l * a->apart + (double)p / a->phases);
            int from = (int)floor(row) - points / 2 + 1;
            from = from < 0 ? 0 : from > Y->m - points ? Y->m - points : from;
            weigh_points(row - from, points, weight);
            sum += cblas_ddot(points, weight, 1, weight, 1);
            for (int c = 0; c < a->channels; c++)
                a->F[used + (size_t)(c * a->phases + p) * a->rows] =
                    cblas_ddot(points, weight, 1, Y->x + (size_t)a->channel[c] * Y->ld + from, 1);
        }
        used++;
    }
    *gain = used > 0 ? sum / ((double)used * a->phases) : 1;
    return used;
}

/* a->error: what polynomials of a lesser degree differ by, half-way between samples. */
static void find_errors(struct scan *a, double *other)
{
    double half = 0.5 / a->r->each, gain;
    int used;

    /* the slip that moves no turn but half a sample: in the mean over all, any other is the same */
    used = fill(a, half * a->turns, 0, TURNS_POINTS - 2, &gain);
    memcpy(other, a->F, sizeof *other * (size_t)a->rows * (size_t)columns_of(a));
    fill(a, half * a->turns, 0, TURNS_POINTS, &gain);
    for (int c = 0; c < a->channels; c++) {
        const struct matrix *Y = a->r->Y;
        const double *y = Y->x + (size_t)a->channel[c] * Y->ld;
        double rms = cblas_dnrm2(Y->m, y, 1) / sqrt(Y->m), sum = 0;
        for (int j = c * a->phases; j < (c + 1) * a->phases; j++)
            for (int l = 0; l < used; l++) {
                double d = a->F[l + (size_t)j * a->rows] - other[l + (size_t)j * a->rows];
                sum += d * d;
            }
        a->error[c] = sum / fmax(1, (double)used * a->phases) + pow(QUIET * rms, 2);
    }
}

/* a->H: of the rows of a Hankel matrix of HEIGHT rows of F, its channels over their noise, each by
 * each.  Its rows are sums of products of F's. Returns how many. */
static int gram(struct scan *a, double ends, double bow, int height)
{
    double gain;
    int used = fill(a, ends, bow, TURNS_POINTS, &gain), n = used - height + 1;

    for (int c = 0; c < a->channels; c++) {
        double noise = a->r->noise[a->channel[c]];
        for (int p = 0; p < a->phases; p++)
            cblas_dscal(used, 1 / sqrt(gain * noise * noise + a->error[c]),
                        a->F + (size_t)(c * a->phases + p) * a->rows, 1);
    }
    cblas_dsyrk(CblasColMajor, CblasLower, CblasNoTrans, used, columns_of(a), 1, a->F, a->rows, 0,
                a->G, used > 0 ? used : 1);
    for (int j = 0; j < n; j++)
        for (int i = j; i < n; i++) {
            double sum = 0;
            for (int k = 0; k < height; k++)
                sum += a->G[i + k + (size_t)(j + k) * used];
            a->H[i + (size_t)j * n] = sum;
        }
    a->edge = pow(sqrt(fmax(n, 1)) + sqrt((double)height * columns_of(a)), 2);
    return n > 0 ? n : 0;
}

/* (2), of slips up to MOST: of others fewer rows are within the record, which makes it less. */
static double directions(struct scan *a, double ends, double bow)
{
    int n = fabs(ends) + 4 * fabs(bow) > MOST * a->turns ? 0 : gram(a, ends, bow, a->height);
    double sum = 0;

    for (int j = 0; j < n; j++) {
        cblas_dscal(n - j, 1 / a->edge, a->H + j + (size_t)j * n, 1);
        a->H[j + (size_t)j * n] += 1;
    }
    if (n == 0 || LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'L', n, a->H, n) != 0)
        return HUGE_VAL;
    for (int j = 0; j < n; j++)
        sum += 2 * log(a->H[j + (size_t)j * n]);
    return sum;
}

/* How many directions stand above the noise. */
static int count_directions(struct scan *a, double ends, double bow)
{
    int n = gram(a, ends, bow, a->height), rank = 0;
    struct matrix H = { n, n, n, a->H };

    if (n == 0 || (a->rc = eigen_symmetric(&H, a->s, a->err)) != MODAL_OK)
        return 0;
    while (rank < n && a->s[n - 1 - rank] > STANDS * a->edge)
        rank++;
    return rank;
}

/* What the rows of F leave beyond the first RANK directions: chi-squared. */
static double beyond(struct scan *a, double ends, double bow, int rank)
{
    int n = gram(a, ends, bow, 1);
    struct matrix H = { n, n, n, a->H };
    double sum = 0;

    if (a->rc != MODAL_OK || n == 0
        || (a->rc = eigen_symmetric(&H, a->s, a->err)) != MODAL_OK)
        return NAN;
    for (int i = 0; i < n - rank; i++)
        sum += a->s[i];
    return sum;
}

/* A scan of the first TURNS, or nothing where there is no memory. */
static void scan_of(struct scan *a, double turns)
{
    int most = REFINE_ROWS_LEAST > 2 * a->r->order ? REFINE_ROWS_LEAST : 2 * a->r->order;

    a->turns = turns;
    a->apart = (int)ceil(turns / most);
    a->rows = (int)(turns / a->apart);
    a->height = a->rows / HEIGHT + 1;
}

/* From *ends, *bow to where no step of a thousandth of a turn makes less of (2), within AWAY. */
static double descend(struct scan *a, double *ends, double *bow)
{
    double step[] = { NEAR, NEAR / 2 }, begin[] = { *ends, *bow };
    double best = directions(a, *ends, *bow);

    for (int i = 0; i < HALVINGS; i++, step[0] /= 2, step[1] /= 2)
        for (bool moved = true; moved;) {
            moved = false;
            for (int way = 0; way < 4; way++) {
                double e = *ends + (way == 0) * step[0] - (way == 1) * step[0];
                double b = *bow + (way == 2) * step[1] - (way == 3) * step[1];
                double q = fabs(e - begin[0]) > AWAY || fabs(b - begin[1]) > AWAY
                               ? HUGE_VAL
                               : directions(a, e, b);
                if (q < best)
                    best = q, *ends = e, *bow = b, moved = true;
            }
        }
    return best;
}

/* The best of a grid over few phases of few channels, of bows up to MOST. */
static void search_grid(struct scan *a, double most, double *ends, double *bow)
{
    int phases = a->phases, channels = a->channels;
    double least = HUGE_VAL;

    a->phases = phases < COARSE_PHASES ? phases : COARSE_PHASES;
    a->channels = channels < COARSE_CHANNELS ? channels : COARSE_CHANNELS;
    for (double e = -GRID_ENDS; e <= GRID_ENDS; e += STEP_ENDS)
        for (double b = -most; b <= most; b += STEP_BOW) {
            double q = directions(a, e, b);
            if (q < least)
                least = q, *ends = e, *bow = b;
        }
    a->phases = phases, a->channels = channels;
}

/* Newton's method on what is left beyond the directions that stand out, half of whose second
 * derivative is the information. */
static void settle(struct scan *a, struct slip *s)
{
    double h[] = { STEP_FIRST, STEP_FIRST };
    int rank = count_directions(a, s->ends, s->bow);

    for (int i = 0; i < NEWTON_STEPS; i++) {
        double x = s->ends, y = s->bow, f = beyond(a, x, y, rank);
        double fe = beyond(a, x + h[0], y, rank), le = beyond(a, x - h[0], y, rank);
        double fb = beyond(a, x, y + h[1], rank), lb = beyond(a, x, y - h[1], rank);
        double both = beyond(a, x + h[0], y + h[1], rank);
        double ee = (fe - 2 * f + le) / (h[0] * h[0]), bb = (fb - 2 * f + lb) / (h[1] * h[1]);
        double eb = (both - fe - fb + f) / (h[0] * h[1]), det = ee * bb - eb * eb;
        double ge = (fe - le) / (2 * h[0]), gb = (fb - lb) / (2 * h[1]);
        double de = -(bb * ge - eb * gb) / det, db = -(ee * gb - eb * ge) / det;
        if (!(det > 0) || !(ee > 0)) {
            h[0] /= 4, h[1] /= 4;
            continue;
        }
        s->std_ends = sqrt(2 * bb / det), s->std_bow = sqrt(2 * ee / det);
        if (!(fabs(de) <= NEAR / 4 && fabs(db) <= NEAR / 4))
            break;
        if (s->std_ends < REACHED)               /* else (2), of Hankel rows, tells more */
            s->ends += de, s->bow += db;
        h[0] = fmin(fmax(s->std_ends, STEP_LEAST), NEAR / 4);
        h[1] = fmin(fmax(s->std_bow, STEP_LEAST), NEAR / 4);
    }
}

/* Does Q rise on all sides of none? */
static bool is_least(struct scan *a, double none)
{
    return fmin(fmin(directions(a, NEAR, 0), directions(a, -NEAR, 0)),
                fmin(directions(a, 0, NEAR), directions(a, 0, -NEAR))) > none + RISEN;
}

/* From what the first turns tell, of bows up to MOST, to all N of them. */
static double search(struct scan *a, double N, double most, double *ends, double *bow)
{
    double turns = fmin(N, REFINE_ROWS_LEAST);

    scan_of(a, turns);
    search_grid(a, most, ends, bow);
    descend(a, ends, bow);
    while (turns < N) {
        double more = fmin(2 * turns, N) / turns, bend = *bow * more * more;
        *ends = (*ends + 4 * *bow) * more - 4 * bend, *bow = bend, turns *= more;
        scan_of(a, turns);
        descend(a, ends, bow);
    }
    return directions(a, *ends, *bow);
}

/* Does a bow explain no more than chance beside ends of their own?  Those are s->ends then. */
static bool ends_alone(struct scan *a, struct slip *s)
{
    double with = directions(a, s->ends, s->bow), ends = s->ends, step = NEAR,
           least = directions(a, ends, 0);

    if (fabs(s->bow) >= REFINE_CLEAR * s->std_bow)
        return false;
    for (int i = 0; i < HALVINGS; i++, step /= 2)
        for (int way = -1; way <= 1; way += 2) {
            double q = directions(a, ends + way * step, 0);
            if (q < least)
                least = q, ends += way * step;
        }
    if (least - with > RISEN)
        return false;
    s->ends = ends;
    return true;
}

/* Without a bow that is no more than chance: the ends alone. */
static void settle_ends(struct scan *a, struct slip *s)
{
    double h = STEP_FIRST;
    int rank = count_directions(a, s->ends, 0);

    s->bow = 0;
    for (int i = 0; i < NEWTON_STEPS; i++) {
        double f = beyond(a, s->ends, 0, rank), more = beyond(a, s->ends + h, 0, rank),
               less = beyond(a, s->ends - h, 0, rank), bend = (more - 2 * f + less) / (h * h),
               step = -(more - less) / (2 * h * bend);
        if (!(bend > 0)) {
            h /= 4;
            continue;
        }
        s->std_ends = sqrt(2 / bend);
        if (s->std_ends < REACHED)
            s->ends += fmax(-NEAR / 4, fmin(step, NEAR / 4));
        h = fmin(fmax(s->std_ends, STEP_LEAST), NEAR / 4);
    }
}

/* The better of two searches, and its bars. */
static void find_slip(struct scan *a, struct slip *out)
{
    double none = directions(a, 0, 0), least;
    bool here = a->r->order <= ORDER_FEW && is_least(a, none);
    struct slip s = { .turns = a->turns };

    *out = s;
    least = descend(a, &s.ends, &s.bow);
    for (int i = 0; i < 2 && !here; i++) {           /* a period's slip has no bow */
        double ends = 0, bow = 0, q = search(a, s.turns, i * GRID_BOW, &ends, &bow);
        if (q < least)
            least = q, s.ends = ends, s.bow = bow;
    }
    s.gain = none - least;
    s.std_ends = s.std_bow = REACHED;
    if (s.gain > 0)
        settle(a, &s);
    if (s.gain > 0 && ends_alone(a, &s))
        settle_ends(a, &s);
    if (s.gain > 0)
        *out = s;
}

enum modal_status slip_find(const struct slip_record *r, struct slip *out, struct modal_error *err)
{
    struct scan a = { .r = r, .err = err, .phases = (int)lround(r->each) };
    double N = floor((r->Y->m - 1) / r->each), *other = NULL;
    size_t entries, side;

    *out = (struct slip) { .turns = N };
    choose_channels(&a);
    if (a.channels == 0 || N < 2 || a.phases < 2 || r->Y->m < TURNS_POINTS)
        return MODAL_OK;
    if (columns_of(&a) > COLUMNS_MOST)
        a.phases = COLUMNS_MOST / a.channels;
    scan_of(&a, N);
    side = (size_t)(REFINE_ROWS_LEAST > 2 * r->order ? REFINE_ROWS_LEAST : 2 * r->order) + 1;
    entries = side * (size_t)columns_of(&a);
    a.F = malloc(sizeof *a.F * entries), other = malloc(sizeof *other * entries);
    a.G = calloc(side * side, sizeof *a.G), a.H = calloc(side * side, sizeof *a.H);
    a.s = malloc(sizeof *a.s * side);
    if (a.F == NULL || other == NULL || a.G == NULL || a.H == NULL || a.s == NULL) {
        a.rc = modal_fail(err, MODAL_NO_MEMORY, "slip: no memory for %zu numbers", entries);
    } else {
        find_errors(&a, other);
        find_slip(&a, out);
    }
    free(a.F), free(other), free(a.G), free(a.H), free(a.s);
    return a.rc;
}

void slip_turns(const struct slip *s, double each, int rows, double *turn)
{
    for (int k = 0; k < rows; k++) {
        double x = k / each, u = x / s->turns;
        turn[k] = x + s->ends * u + 4 * s->bow * u * (1 - u);
    }
}
