/*
 * event.c - quiet, strike, free response, noise
 *
 * Where no force acts, sampled signals follow a recurrence of constant coefficients, forwards and
 * backwards, whatever their modes:
 *
 *     y[k] = a_1 y[k+1] + ... + a_p y[k+p] + noise                                            (1)
 *
 * Row by row, from after the strongest part of the record back to its beginning, (1) is fitted to
 * all rows so far, and the next row is foretold. What it differs by, over the error of the fit,
 *
 *     w[k] = (y[k] - a^T x[k]) / sqrt(1 + x[k]^T (X^T X)^{-1} x[k]),                          (2)
 *
 * is white and of one variance as long as (1) holds: the recursive residuals of [BDE75]. A mode
 * that decays fast comes out of the noise in directions x that no row had before, so that its
 * rows are no surprise; a force, even one of a single sample, is none of the rows' directions. A
 * row rotated into the triangle of those before it leaves (2) where its target stood.
 *
 * Twice the logarithm of the ratio of likelihoods that a window of residuals has a variance of its
 * own, and that it has that of the residuals before it, is chi-square of one degree [W38]; over all
 * rows and windows looked at it stays below
 *
 *     2 log(tests / ALARM)                                                                   (3)
 *
 * in all but ALARM of the records, where noise is white and p exceeds the order. (Of 4,500 random
 * ones of up to 14 modes, 10 to 80 dB and without noise, 7 were cut: many modes, some of them
 * fast.) Residuals are asked as they are, and over the size of the rows that foretold them:
 * rounding, and modes beyond the recurrence's order, are in proportion to those, noise is not, and
 * either may be all there is.
 *
 * [BDE75] Brown, Durbin, Evans, J. R. Stat. Soc. B 37 (1975) 149-192.
 * [W38] Wilks, Ann. Math. Statist. 9 (1938) 60-62.
 */
#include "modal/identify/prepare/event.h"
#include <cblas.h>
#include <complex.h>
#include <float.h>
#include <fftw3.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/identify/prepare/record.h"
#include "modal/identify/result.h"
#include "modal/numbers.h"

enum {
    ROWS_MOST = 4096,            /* longer records are looked at in means of several samples */
    COARSER = 4,                 /* strikes of many samples are seen in means of some */
    ORDER_MOST = 24,             /* of (1) */
    REFERENCE = 32,              /* rows that a window of residuals is held against */
    PARTS = 64,                  /* of a record, by their energy; of its end, by their noise */
    TAIL = 8                     /* of these, at least: what white noise is told from */
};

struct scan {
    int L, S, each;              /* rows, signals; samples that a row is the mean of */
    int p, reference;            /* order of (1); REFERENCE, or fewer in short records */
    double *z;                   /* L x S, about their means, of largest magnitude 1 */
    double *energy;              /* per row, a sum over signals */
    double *w;                   /* L x S: (2) */
    double *sum[2];              /* (L + 1) x S: of squares of (2) from row k on; over their rows */
    double independent;          /* numbers among the S residuals of a row */
    double *triangle, *row;      /* p x (p + 1), p + 1 */
    int from;                    /* rows from here on foretold nothing yet */
};

static void scan_done(struct scan *s)
{
    free(s->z), free(s->energy), free(s->w), free(s->sum[0]), free(s->sum[1]);
    free(s->triangle), free(s->row);
}

static enum modal_status scan_memory(struct scan *s, struct modal_error *err)
{
    size_t L = (size_t)s->L, p = (size_t)s->p;

    s->z = calloc(L * RECORD_FEW, sizeof *s->z);
    s->energy = calloc(L, sizeof *s->energy);
    s->w = calloc(L * RECORD_FEW, sizeof *s->w);
    s->sum[0] = calloc((L + 1) * RECORD_FEW, sizeof(double));
    s->sum[1] = calloc((L + 1) * RECORD_FEW, sizeof(double));
    s->triangle = calloc(p * (p + 1), sizeof(double));
    s->row = calloc(p + 1, sizeof(double));
    if (s->z == NULL || s->energy == NULL || s->w == NULL || s->sum[0] == NULL || s->sum[1] == NULL
        || s->triangle == NULL || s->row == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "event: no memory for %d rows", s->L);
    return MODAL_OK;
}

/* About its mean, of largest magnitude 1. False: it is constant, or not of finite numbers. */
static bool scale_signal(double *z, int L)
{
    double mean = 0, most = 0;

    for (int k = 0; k < L; k++)
        mean += z[k] / L;
    for (int k = 0; k < L; k++) {
        z[k] -= mean;
        most = fmax(most, fabs(z[k]));
    }
    if (!(most > 0) || !isfinite(most) || !isfinite(mean))
        return false;
    for (int k = 0; k < L; k++)
        z[k] /= most;
    return true;
}

/* The signals that are looked at; s->S stays 0 where none moves. */
static void read_signals(struct scan *s, const struct batch *b, const int *channels, int count,
                         size_t first)
{
    /* of many: a strike is in all of them */
    int wanted = count < RECORD_FEW ? count : RECORD_FEW;

    for (int i = 0; i < wanted; i++) {
        size_t c = (size_t)channels[(long)i * count / wanted];
        double *z = s->z + (size_t)s->S * (size_t)s->L;
        const double *x = b->signals + first * b->channels + c;
        for (int k = 0; k < s->L; k++) {
            double sum = 0;
            for (int j = 0; j < s->each; j++, x += b->channels)
                sum += *x / s->each;
            z[k] = sum;
        }
        s->S += scale_signal(z, s->L);
    }
    for (int c = 0; c < s->S; c++) {
        const double *z = s->z + (size_t)c * (size_t)s->L;
        double all = 0;
        for (int k = 0; k < s->L; k++)
            all += z[k] * z[k];
        for (int k = 0; k < s->L; k++)
            s->energy[k] += z[k] * z[k] / all;
    }
}

/* The end of the part of the record that has most energy. */
static int strongest(const struct scan *s)
{
    int part = (s->L + PARTS - 1) / PARTS, at = 0;
    double most = -1;

    for (int k = 0; k < s->L; k += part) {
        int end = k + part < s->L ? k + part : s->L;
        double sum = 0;
        for (int j = k; j < end; j++)
            sum += s->energy[j] / (end - k);
        if (sum > most)
            most = sum, at = end;
    }
    return at;
}

/* Twice the logarithm of the ratio of likelihoods that N numbers have a variance V times that of
 * M others, and that they have the same. */
static double ratio(double n, double v, double m)
{
    /* Gaussian: -2 ln L is N ln(variance), pooled less apart */
    return (n + m) * log((n * v + m) / (n + m)) - n * log(v);
}

static double threshold(double tests)
{
    return 2 * log(tests / IDENTIFY_ALARM);
}

/* Rows before which there is much less energy than from there to END; 0: none. */
static int quiet_rows(const struct scan *s, int end)
{
    double all = 0, before = 0, best = threshold(end);
    int at = 0;

    for (int k = 0; k < end; k++)
        all += s->energy[k];
    for (int k = 1; k < end; k++) {
        before += s->energy[k - 1];
        double low = fmax(before / k, DBL_MIN), high = (all - before) / (end - k);
        double gain = high > low ? ratio(end - k, high / low, k) : 0;  /* a fall is no onset */
        if (gain > best)
            best = gain, at = k;
    }
    return at;
}

/* A rise that begins slowly begins before the row AT that divides it best. */
static int first_rise(const struct scan *s, int at)
{
    double before = 0, most = threshold(at);

    for (int k = 0; k < at; k++)
        before += s->energy[k];
    for (int w = 1; w < at;) {
        double own = 0, v;
        for (int k = at - w; k < at; k++)
            own += s->energy[k];
        v = own / w / fmax((before - own) / (at - w), DBL_MIN);
        if (v > 1 && ratio(w, v, at - w) > most)
            at -= w, before -= own, w = 1;
        else
            w *= 2;
    }
    return at;
}

/* ---- residuals ---- */

/* Row X (p + 1 numbers, its target last) into the triangle: (2). */
static double rotate_in(double *triangle, double *x, int p)
{
    for (int i = 0; i < p; i++) {
        double *r = triangle + (size_t)i * (size_t)(p + 1);
        double size = sqrt(r[i] * r[i] + x[i] * x[i]), c, d;
        if (!(size > 0))            /* nothing to rotate: the row has a zero there */
            continue;
        c = r[i] / size, d = x[i] / size;
        for (int j = i; j <= p; j++) {
            double t = c * r[j] + d * x[j];
            x[j] = c * x[j] - d * r[j];
            r[j] = t;
        }
    }
    return x[p];
}

/* The residuals of signal C at rows below END, down to row LEAST. */
static void residuals(struct scan *s, int c, int least, int end)
{
    const double *z = s->z + (size_t)c * (size_t)s->L;
    double *sum = s->sum[0] + (size_t)c * (size_t)(s->L + 1), size = 0;
    double *over = s->sum[1] + (size_t)c * (size_t)(s->L + 1);
    int p = s->p;

    memset(s->triangle, 0, (size_t)p * (size_t)(p + 1) * sizeof(double));
    for (int i = 0; i < p; i++) {
        /* regular from the first row; far below any sample's part */
        s->triangle[(size_t)i * (size_t)(p + 1) + (size_t)i] = DBL_EPSILON;
        size += z[end - p + i] * z[end - p + i];
    }
    for (int k = end - p - 1; k >= least; k--) {
        double w;
        memcpy(s->row, z + k + 1, (size_t)p * sizeof(double));
        s->row[p] = z[k];
        w = rotate_in(s->triangle, s->row, p);
        size += z[k] * z[k];
        if (k > s->from)
            w = 0;
        s->w[k + c * s->L] = w;
        sum[k] = sum[k + 1] + w * w;
        over[k] = over[k + 1] + w * w / fmax(size, DBL_MIN);
        /* the energy of the p rows that predict, and of the row itself */
        size -= z[k + p] * z[k + p];
    }
}

/* Noise that signals have in common is told once: of the first residuals, (sum of the eigenvalues
 * of their correlation)^2 over the sum of their squares. */
static double independent_numbers(const struct scan *s)
{
    const double *w = s->w + s->from - s->reference;
    double all = 0;

    for (int c = 0; c < s->S; c++)
        for (int d = 0; d < s->S; d++) {
            const double *a = w + c * s->L, *b = w + d * s->L;
            double n = s->reference, ab = cblas_ddot((int)n, a, 1, b, 1);
            double aabb = cblas_ddot((int)n, a, 1, a, 1) * cblas_ddot((int)n, b, 1, b, 1);
            all += c == d ? 1 : aabb > 0 ? ab * ab / aabb : 0;
        }
    return s->S * s->S / all;       /* S where they are independent, 1 where they are one */
}

/* The variance of WINDOW rows from K on, over that of the rows after them. */
static double rise(const struct scan *s, const double *sum, int k, int window)
{
    double all = 0;

    for (int c = 0; c < s->S; c++, sum += s->L + 1) {
        double own = (sum[k] - sum[k + window]) / window;
        double others = (sum[k + window] - sum[k + window + s->reference]) / s->reference;
        all += own > 0 ? own / fmax(others, DBL_MIN) / s->S : 0;
    }
    return all;
}

/* How much likelier it is that the variance rises at row K + W, the window beginning at K. */
static double evidence(const struct scan *s, int k, int w)
{
    /* also over the motion's own energy: multiplicative errors grow with it */
    double v = fmin(rise(s, s->sum[0], k, w), rise(s, s->sum[1], k, w));

    return v > 1 ? ratio(w * s->independent, v, s->reference * s->independent) : 0;
}

/* The first row, from END back to LEAST, from which on (1) holds and before which it does not;
 * LEAST: it holds throughout. Of the windows with the first row that shows it, the likeliest. */
static int free_from(struct scan *s, int least, int end)
{
    int windows = 0, at = least, seen = -1;
    double most;

    s->from = end - 2 * s->p - 1;
    for (int c = 0; c < s->S; c++)
        residuals(s, c, least, end);
    s->independent = independent_numbers(s);
    for (int w = 1; w <= s->reference; w *= 2)
        windows++;                  /* every place and every length is a chance of a false alarm */
    most = threshold((double)windows * (end - least));
    for (int k = s->from - s->reference; k >= least && k > seen - s->reference; k--)
        for (int w = 1; w <= s->reference && k + w + s->reference <= s->from + 1; w *= 2) {
            double gain = evidence(s, k, w);
            if (gain <= most || k + w <= seen)
                continue;
            seen = seen < 0 ? k : seen;
            most = gain, at = k + w;
        }
    return at;
}

/* The row that a free response begins at; 0: the first, or it cannot be told. Where there is no
 * quiet, so few rows that they make no recurrence of their own may be a strike, and not a response
 * before it; means of samples may hide a fast mode in them. What is seen of a strike ends where it
 * falls below the noise: as much again as was seen is left out after it, or p rows. */
static int response_begins(struct scan *s)
{
    int p = s->p, end = strongest(s) + 4 * p + s->reference, quiet, begin, least;

    end = end < s->L ? end : s->L;
    quiet = first_rise(s, quiet_rows(s, end));
    least = quiet > p ? quiet - p : 0;
    if (end - least < 4 * p + s->reference || (quiet == 0 && s->each > 1))
        return 0;
    begin = free_from(s, least, end);
    if (begin <= least || (quiet == 0 && begin > p))
        return 0;
    begin = begin > quiet ? begin : quiet;
    quiet = begin + (begin - quiet > p ? begin - quiet : p);
    return quiet < (begin + s->L) / 2 ? quiet : (begin + s->L) / 2;
}

/* ---- noise after the response ---- */

/* Mean energy of rows [K, K + N), each signal over its own in the last TAIL rows. */
static double above_noise(const struct scan *s, int k, int n, int tail)
{
    double all = 0;

    for (int c = 0; c < s->S; c++) {
        const double *z = s->z + (size_t)c * (size_t)s->L;
        double own = 0, noise = 0;
        for (int j = k; j < k + n; j++)
            own += z[j] * z[j];
        for (int j = s->L - tail; j < s->L; j++)
            noise += z[j] * z[j];
        all += own / n / fmax(noise / tail, DBL_MIN) / s->S;
    }
    return all;
}

static bool is_constant(const double *x, int count)
{
    bool same = true;

    for (int i = 1; i < count; i++)
        same &= x[i] == x[0];
    return same;
}

/* Has the spectrum of the last ROWS rows no line that white noise has in ALARM of records? */
static bool white(const struct scan *s, int rows)
{
    int lines = rows / 2 + 1;
    double *x = fftw_malloc(sizeof *x * (size_t)rows), most = 0;
    fftw_complex *X = fftw_malloc(sizeof *X * (size_t)lines);
    fftw_plan plan = x != NULL && X != NULL ? fftw_plan_dft_r2c_1d(rows, x, X, FFTW_ESTIMATE)
                                            : NULL;

    for (int c = 0; c < s->S && plan != NULL; c++) {
        double all = 0;
        memcpy(x, s->z + (size_t)(c + 1) * (size_t)s->L - rows, (size_t)rows * sizeof *x);
        if (is_constant(x, rows))       /* rounding of the transform is all there would be */
            continue;
        fftw_execute(plan);
        for (int i = 1; i < lines; i++)
            all += numbers_square(X[i]);
        for (int i = 1; i < lines; i++)
            most = fmax(most, numbers_square(X[i]) * (lines - 1) / fmax(all, DBL_MIN));
    }
    if (plan != NULL)
        fftw_destroy_plan(plan);
    fftw_free(x), fftw_free(X);
    return plan != NULL && most < threshold((double)lines * s->S) / 2;
}

/* The row after which there is white noise alone; s->L: there is none such. Where the energy is
 * that of the end a line may be seen still. */
static int response_ends(const struct scan *s)
{
    int part = s->L / PARTS, tail = TAIL * part, end;
    double most = threshold(PARTS);

    if (part < 1)
        return s->L;
    for (end = s->L - tail; end - part > 0; end -= part) {
        double v = above_noise(s, end - part, part, tail);
        if (v > 1 && ratio(part * s->S, v, tail * s->S) > most)
            break;
    }
    if (end - part <= 0)
        return s->L;
    while (end <= s->L - tail && !white(s, s->L - end))
        end += part;
    return end <= s->L - tail ? end : s->L;
}

/* The signals of some rows, EACH samples to one. */
static enum modal_status scan_begin(struct scan *s, const struct batch *b, const int *channels,
                                    int count, struct event_rows rows, size_t each,
                                    struct modal_error *err)
{
    enum modal_status rc;

    *s = (struct scan) { .L = (int)((rows.last - rows.first + 1) / each), .each = (int)each };
    s->p = s->L / 8 < ORDER_MOST ? s->L / 8 : ORDER_MOST;
    s->reference = s->L / 4 < REFERENCE ? s->L / 4 : REFERENCE;
    rc = scan_memory(s, err);
    if (rc == MODAL_OK)
        read_signals(s, b, channels, count, rows.first);
    return rc;
}

/* How many rows of PART come before a free response; 0: none, or it cannot be told. Few samples
 * are looked at one by one, all of a long record in means of some. */
static enum modal_status driven_rows(const struct batch *b, const int *channels, int count,
                                     struct event_rows part, size_t *rows, struct modal_error *err)
{
    size_t n = part.last - part.first + 1, coarse = (n + ROWS_MOST - 1) / ROWS_MOST;
    struct event_rows head = part;
    enum modal_status rc = MODAL_OK;

    *rows = 0;
    head.last = coarse > 1 ? part.first + ROWS_MOST - 1 : part.last;
    for (size_t each = 1; rc == MODAL_OK && *rows == 0 && n / each >= REFINE_ROWS_LEAST;
         each = each < coarse ? coarse : COARSER * each) {
        struct scan s = { 0 };
        rc = scan_begin(&s, b, channels, count, each < coarse ? head : part, each, err);
        if (rc == MODAL_OK && s.S > 0)
            *rows = each * (size_t)response_begins(&s);
        scan_done(&s);
    }
    return rc;
}

enum modal_status event_find(const struct batch *b, const int *channels, int count,
                             struct event_rows whole, struct event_rows *part, bool *cut,
                             struct modal_error *err)
{
    size_t each = (whole.last - whole.first + ROWS_MOST) / ROWS_MOST, rows;
    struct scan s = { 0 };
    enum modal_status rc;

    *part = whole;
    do {
        rc = driven_rows(b, channels, count, *part, &rows, err);
        part->first += rows;          /* a hammer may strike twice */
    } while (rc == MODAL_OK && rows > 0);
    *cut = part->first > whole.first;
    if (rc == MODAL_OK && *cut && (rc = scan_begin(&s, b, channels, count, *part, each, err))
                                      == MODAL_OK) {
        int end = response_ends(&s);
        if (end < s.L)
            part->last = part->first + (size_t)end * each - 1;
    }
    scan_done(&s);
    return rc;
}

enum modal_status event_end(const struct batch *b, const int *channels, int count,
                            struct event_rows whole, size_t *end, struct modal_error *err)
{
    size_t each = (whole.last - whole.first + ROWS_MOST) / ROWS_MOST;
    struct scan s = { 0 };
    enum modal_status rc = scan_begin(&s, b, channels, count, whole, each, err);

    *end = whole.last + 1;
    if (rc == MODAL_OK && s.S > 0) {
        int row = response_ends(&s);
        if (row < s.L)
            *end = whole.first + (size_t)row * each;
    }
    scan_done(&s);
    return rc;
}
