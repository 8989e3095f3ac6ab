/*
 * ambient_lines.c - a sinusoid at a time
 *
 * Spectra are of columns under Hann's window, whose line has no leakage to speak of: a line stands
 * out in the sum of all columns against the median of its neighbourhood.  Its frequency is where
 * the column that shows it best has its peak, by golden section, and then by least squares under
 * the same window, so that other lines do not disturb it; its amplitude in each column likewise.
 */
#include <fftw3.h>       /* before complex.h, which makes its numbers the compiler's */
#include "modal/identify/ambient/ambient_lines.h"
#include <complex.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"

enum {
    BLOCK = 64,                  /* lines of a neighbourhood */
    WIDTH = 3,                   /* lines on either side that a sinusoid fills */
    FAILED_MOST = 16,            /* candidates that are no sinusoids */
    TURNS = 20,                  /* of the golden section: to a ten thousandth of a line */
    STEPS = 3                    /* of Gauss and Newton from there: to rounding */
};
static const double
    STANDS_OUT = 100,            /* over the median about it */
    LEFT = 0.01,                 /* of its energy when it was taken off */
    NOTHING = 1e-6;              /* of a column's rms: what is left of a line alone */

struct work {
    struct matrix *Y;
    int lines;                   /* 0 .. lines - 1 */
    double *x, *power;           /* a column under the window; the sum over columns */
    double *window;
    bool *closed;
    fftw_complex *X;
    fftw_plan plan;
};

static void work_done(struct work *w)
{
    if (w->plan != NULL)
        fftw_destroy_plan(w->plan);
    fftw_free(w->x), fftw_free(w->X);
    free(w->power), free(w->closed), free(w->window);
}

static void hann(struct work *w)
{
    for (int k = 0; k < w->Y->m; k++)
        w->window[k] = (1 - cos(2 * M_PI * (k + 0.5) / w->Y->m)) / 2;
}

static enum modal_status work_init(struct work *w, struct matrix *Y, struct modal_error *err)
{
    size_t n = (size_t)Y->m;

    *w = (struct work) { .Y = Y, .lines = Y->m / 2, .x = fftw_alloc_real(n),
                         .power = malloc(sizeof *w->power * (n / 2 + 1)),
                         .window = malloc(sizeof *w->window * n),
                         .closed = calloc(n / 2 + 1, sizeof *w->closed),
                         .X = fftw_alloc_complex(n / 2 + 1) };
    if (w->x != NULL && w->X != NULL)
        w->plan = fftw_plan_dft_r2c_1d(Y->m, w->x, w->X, FFTW_ESTIMATE);
    if (w->plan == NULL || w->power == NULL || w->closed == NULL || w->window == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d samples", Y->m);
    hann(w);
    return MODAL_OK;
}

static double *column(const struct work *w, int c)
{
    return w->Y->x + (size_t)c * w->Y->ld;
}

static void transform(struct work *w, int c)
{
    for (int k = 0; k < w->Y->m; k++)
        w->x[k] = column(w, c)[k] * w->window[k];
    fftw_execute(w->plan);
}

static void measure(struct work *w)
{
    memset(w->power, 0, sizeof *w->power * (size_t)w->lines);
    for (int c = 0; c < w->Y->n; c++) {
        transform(w, c);
        for (int j = 0; j < w->lines; j++)
            w->power[j] += w->X[j][0] * w->X[j][0] + w->X[j][1] * w->X[j][1];
    }
}

/* The line that stands out most, not closed; -1: none. */
static int find(const struct work *w)
{
    double block[BLOCK], most = STANDS_OUT;
    int at = -1;

    for (int first = 0; first + BLOCK <= w->lines; first += BLOCK) {
        memcpy(block, w->power + first, sizeof block);
        const double median = numbers_ranked(block, BLOCK, BLOCK / 2);
        for (int j = first; j < first + BLOCK; j++)
            if (j > WIDTH && !w->closed[j] && w->power[j] > most * median)
                at = j, most = w->power[j] / median;
    }
    return at;
}

/* Of column C under the window, a sum over samples with exp(-i w k); exp by its multiples. */
static double complex transform_at(const struct work *w, int c, double turn)
{
    const double *y = column(w, c);
    double complex sum = 0;

    for (int first = 0; first < w->Y->m; first += BLOCK) {
        double complex z = cexp(CMPLX(0, -turn * first)), step = cexp(CMPLX(0, -turn));
        for (int k = first; k < w->Y->m && k < first + BLOCK; k++, z *= step)
            sum += y[k] * w->window[k] * z;
    }
    return sum;
}

/* The least squares of column C on the sinusoid under the window. */
static double complex amplitude_of(const struct work *w, int c, double turn)
{
    double complex twice = 0, seen = transform_at(w, c, turn);
    double all = 0, size;

    for (int first = 0; first < w->Y->m; first += BLOCK) {
        double complex z = cexp(CMPLX(0, -2 * turn * first)), step = cexp(CMPLX(0, -2 * turn));
        for (int k = first; k < w->Y->m && k < first + BLOCK; k++, z *= step)
            twice += w->window[k] * z, all += w->window[k];
    }
    /* all z + twice conj(z) = 2 seen */
    size = all * all - creal(twice * conj(twice));
    return 2 * (all * seen - twice * conj(seen)) / size;
}

/* A step of Gauss and Newton on the frequency, the phase held in the middle. */
static double sharper(const struct work *w, int c, double turn)
{
    const double *y = column(w, c);
    double complex z = amplitude_of(w, c, turn);
    double along = 0, size = 0, middle = (w->Y->m - 1) / 2.;

    for (int k = 0; k < w->Y->m; k++) {
        double complex e = z * cexp(CMPLX(0, turn * k));
        double slope = -(k - middle) * cimag(e) * w->window[k];
        along += slope * (y[k] - creal(e));
        size += slope * -(k - middle) * cimag(e);
    }
    return size > 0 ? turn + along / size : turn;
}

/* The column where line J is highest over the median about it: noise disturbs it least there. */
static int clearest(struct work *w, int j)
{
    int first = (int)fmax(fmin(j - BLOCK / 2, w->lines - BLOCK), 0), best = 0;
    int count = w->lines - first < BLOCK ? w->lines - first : BLOCK;
    double most = -1, block[BLOCK];

    for (int c = 0; c < w->Y->n; c++) {
        transform(w, c);
        for (int i = 0; i < count; i++)
            block[i] = numbers_square(CMPLX(w->X[first + i][0], w->X[first + i][1]));
        double high = block[j - first], median = numbers_ranked(block, count, count / 2);
        if (high > most * median)
            best = c, most = high / median;
    }
    return best;
}

/* Radians a sample of the peak about line J. */
static double peak_near(struct work *w, int j)
{
    const double golden = (sqrt(5) - 1) / 2;
    double line = 2 * M_PI / w->Y->m, a = (j - 1) * line, b = (j + 1) * line;
    int best = clearest(w, j);

    for (int turn = 0; turn < TURNS; turn++) {
        double p = b - golden * (b - a), q = a + golden * (b - a);
        if (cabs(transform_at(w, best, p)) > cabs(transform_at(w, best, q)))
            b = q;
        else
            a = p;
    }
    a = (a + b) / 2;
    for (int step = 0; step < STEPS; step++)
        a = sharper(w, best, a);
    return a;
}

/* y - Re(z exp(i turn k)), or back by a negative sign. */
static void subtract(const struct work *w, int c, double turn, double complex z)
{
    double *y = column(w, c);

    for (int first = 0; first < w->Y->m; first += BLOCK) {
        double complex now = z * cexp(CMPLX(0, turn * first)), step = cexp(CMPLX(0, turn));
        for (int k = first; k < w->Y->m && k < first + BLOCK; k++, now *= step)
            y[k] -= creal(now);
    }
}

static double energy_near(const struct work *w, int j)
{
    double sum = 0;

    for (int i = j - WIDTH; i <= j + WIDTH; i++)
        sum += i >= 0 && i < w->lines ? w->power[i] : 0;
    return sum;
}

void ambient_lines_done(struct ambient_line *line, int count)
{
    for (int i = 0; i < count; i++) {
        free(line[i].z);
        line[i].z = NULL;
    }
}

/* The sinusoid of so many radians a sample off all columns. */
static enum modal_status subtract_all(const struct work *w, double turn, struct ambient_line *out,
                                      struct modal_error *err)
{
    *out = (struct ambient_line) { turn / (2 * M_PI), 0, malloc(sizeof *out->z * (size_t)w->Y->n) };
    if (out->z == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d channels", w->Y->n);
    for (int c = 0; c < w->Y->n; c++) {
        out->z[c] = amplitude_of(w, c, turn);
        subtract(w, c, turn, out->z[c]);
        out->share += numbers_square(out->z[c]) / (2 * w->Y->n);
    }
    return MODAL_OK;
}

static void add_all(const struct work *w, struct ambient_line *line)
{
    for (int c = 0; c < w->Y->n; c++)
        subtract(w, c, 2 * M_PI * line->frequency, -line->z[c]);
    ambient_lines_done(line, 1);
}

/* The sinusoid at line J off all columns, if it is one. */
static enum modal_status take(struct work *w, int j, struct ambient_line *out, bool *taken,
                              struct modal_error *err)
{
    double before = energy_near(w, j);
    enum modal_status rc = subtract_all(w, peak_near(w, j), out, err);

    if (rc != MODAL_OK)
        return rc;
    measure(w);
    *taken = energy_near(w, j) < LEFT * before;
    if (!*taken) {
        add_all(w, out);
        measure(w);
    }
    for (int i = j - WIDTH; i <= j + WIDTH; i++)
        if (i >= 0 && i < w->lines)
            w->closed[i] = true;
    return MODAL_OK;
}

void ambient_lines_settle(struct matrix *Y)
{
    for (int c = 0; c < Y->n; c++) {
        double *y = Y->x + (size_t)c * Y->ld, mean = 0, sum = 0;
        for (int k = 0; k < Y->m; k++)
            mean += y[k] / Y->m;
        for (int k = 0; k < Y->m; k++)
            y[k] -= mean, sum += y[k] * y[k];
        if (sqrt(sum / Y->m) < NOTHING)
            memset(y, 0, sizeof *y * (size_t)Y->m);
    }
}

enum modal_status ambient_lines_take(struct matrix *Y, struct ambient_line *out, int *count,
                                     struct modal_error *err)
{
    struct work w;
    enum modal_status rc = work_init(&w, Y, err);

    *count = 0;
    if (rc == MODAL_OK)
        measure(&w);
    for (int failed = 0; rc == MODAL_OK && failed < FAILED_MOST && *count < AMBIENT_LINES_MOST;) {
        bool taken = false;
        int j = find(&w);
        if (j < 0)
            break;
        rc = take(&w, j, &out[*count], &taken, err);
        *count += taken, failed += !taken;
    }
    if (rc == MODAL_OK && *count > 0)
        ambient_lines_settle(Y);
    work_done(&w);
    return rc;
}

/* The column functions of one line need the window alone. */
static enum modal_status window_init(struct work *w, struct matrix *Y, struct modal_error *err)
{
    *w = (struct work) { .Y = Y, .window = malloc(sizeof *w->window * (size_t)Y->m) };
    if (w->window == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d samples", Y->m);
    hann(w);
    return MODAL_OK;
}

enum modal_status ambient_lines_take_at(struct matrix *Y, double frequency,
                                        struct ambient_line *out, struct modal_error *err)
{
    struct work w;
    enum modal_status rc = window_init(&w, Y, err);

    if (rc == MODAL_OK)
        rc = subtract_all(&w, 2 * M_PI * frequency, out, err);
    free(w.window);
    return rc;
}

void ambient_lines_put_back(struct matrix *Y, struct ambient_line *line)
{
    add_all(&(struct work) { .Y = Y }, line);
}
