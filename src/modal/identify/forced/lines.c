/*
 * lines.c - the transform of a record, exact though the record is no period
 *
 * A system x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k] on samples 0 .. N-1, transformed at a
 * line z^N = 1:
 *
 *     z (X - x[0] + x[N]) = A X + B U,     so that                                           (1)
 *     Y = (C (z - A)^-1 B + D) U + C (z - A)^-1 z (x[0] - x[N]),                             (2)
 *
 * without an approximation: an unknown x[0] is one more drive of the same poles, z (Pintelon and
 * Schoukens, System Identification, 2012, ch. 6).  An input that is straight between samples has
 * the form (2) too, its B and D in other coordinates.  Where another record begins at row s, the
 * state jumps there by what nobody knows, which adds to (1) and so to (2)
 *
 *     C (z - A)^-1 z^(1-s) jump:                                                              (3)
 *
 * records one after another are one record with so many drives more, each as long as it is, and the
 * fit is of all of them by their likelihood; nothing is averaged.
 *
 * Direct: inputs that are not straight between samples, an impact shorter than one, reach the
 * responses by way of the samples beside as well: u[k], (u[k+1] - u[k-1])/2 and
 * u[k+1] - 2 u[k] + u[k-1], and as u[-1] and u[N] are unknown the transforms 1 and z of the first
 * and the last sample, z^-s and z^(1-s) where another begins.  The levels of records may differ,
 * which lines from the first on see: a column for each record but one, (z^-s - z^-e) / (1 - 1/z) of
 * rows s to e - 1.
 */
#include "modal/identify/forced/lines.h"
#include <cblas.h>
#include <fftw3.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    BESIDE = 3,                     /* direct columns of an input: a sample, two of those beside */
    ENDS = 2,                       /* of a record's ends: 1 and z */
    BAND_LEAST = 32                 /* lines: a level to 18 %, many beside what a pole takes */
};
static const double BAND_SHARE = 0.25;  /* of its frequency: what noise hardly varies over */

void lines_done(struct lines *l)
{
    free(l->z), free(l->Y), free(l->W), free(l->X), free(l->energy), free(l->size);
    free(l->norm);
    memset(l, 0, sizeof *l);
}

/* Lines FIRST, .. of column c of x into out. */
struct transform { double *x; fftw_complex *X; fftw_plan plan; };

static void transform_column(const struct transform *t, const struct matrix *x, int c, int first,
                             int count, double complex *out)
{
    memcpy(t->x, x->x + (size_t)c * x->ld, sizeof *t->x * (size_t)x->m);
    fftw_execute(t->plan);
    for (int n = 0; n < count; n++)
        /* Parseval: squares of lines are those of samples */
        out[n] = t->X[first + n] / sqrt(x->m);
}

/* Over its size, which is returned. */
static double to_unit(double complex *x, int count, double unit)
{
    double size = cblas_dznrm2(count, x, 1) / unit;

    if (size > 0)
        cblas_zdscal(count, 1 / size, x, 1);
    return size;
}

/* What an input has by way of the sample itself and those beside it. */
static void set_beside(double complex z, double complex u, double complex *x, size_t stride)
{
    x[0] = u;
    x[stride] = I * cimag(z) * u;   /* (z - 1/z) / 2: the difference of the samples beside it */
    x[2 * stride] = 2 * (creal(z) - 1) * u;  /* z - 2 + 1/z: the second difference */
}

/* z^-s on the circle at line n of FIRST and on. */
static double complex delay(const struct lines *l, int first, int n, int s)
{
    long turns = (long)(first + n) * s % l->samples;      /* exact, however late s is */

    return cexp(CMPLX(0, -2 * M_PI * (double)turns / l->samples));
}

void lines_pulse(const struct lines *l, const double *x, int count, int row, int first, int rows,
                 double complex *out)
{
    int at = (int)lround(carg(l->z[0]) / (2 * M_PI) * l->samples) + first;

    for (int n = 0; n < rows; n++) {
        double complex back = conj(l->z[first + n]), sum = 0;
        for (int k = count - 1; k >= 0; k--)
            sum = sum * back + x[k];
        out[n] = sum * delay(l, at, n, row) / sqrt(l->samples);
    }
}

static void add_beginnings(struct lines *l, const struct lines_records *r, int first)
{
    size_t count = (size_t)l->count;
    double complex *ends = l->X + (size_t)BESIDE * l->inputs * count,
                   *levels = ends + (size_t)ENDS * r->count * count;

    for (int e = 0; e < r->count; e++)
        for (int n = 0; n < l->count; n++) {
            double complex here = delay(l, first, n, r->row[e]);
            double complex next = e + 1 < r->count ? delay(l, first, n, r->row[e + 1]) : 1;
            l->W[n + (size_t)(l->inputs + e) * count] = here * l->z[n];       /* (3) */
            ends[n + (size_t)(ENDS * e) * count] = here;
            ends[n + (size_t)(ENDS * e + 1) * count] = here * l->z[n];
            if (e > 0 && first == 1)
                levels[n + (size_t)(e - 1) * count] = (here - next) / (1 - 1 / l->z[n]);
        }
}

static void make_direct(struct lines *l)
{
    for (int j = 0; j < l->inputs; j++)
        for (int n = 0; n < l->count; n++)
            set_beside(l->z[n], l->W[n + (size_t)j * l->count],
                       l->X + n + (size_t)BESIDE * j * l->count, (size_t)l->count);
    for (int c = 0; c < l->direct; c++)
        l->norm[c] = to_unit(l->X + (size_t)c * l->count, l->count, 1);
}

void lines_direct(const struct lines *l, double complex z, int input, double complex *row)
{
    memset(row, 0, sizeof *row * (size_t)l->direct);
    set_beside(z, 1 / l->size[input], row + BESIDE * input, 1);
    for (int c = BESIDE * input; c < BESIDE * (input + 1); c++)
        row[c] = l->norm[c] > 0 ? row[c] / l->norm[c] : 0;  /* as X's columns were scaled */
}

int lines_band_end(const struct lines *l, int first)
{
    double turns = carg(l->z[first]) / (2 * M_PI) * l->samples;
    int end = first + (int)fmax(BAND_LEAST, BAND_SHARE * turns);

    return l->count - end < BAND_LEAST ? l->count : end;
}

static enum modal_status make_room(struct lines *l, struct transform *t, struct modal_error *err)
{
    size_t n = (size_t)l->count;

    l->z = malloc(sizeof *l->z * n);
    l->Y = malloc(sizeof *l->Y * n * (size_t)l->responses);
    l->W = malloc(sizeof *l->W * n * (size_t)l->drives);
    l->X = malloc(sizeof *l->X * n * (size_t)l->direct);
    l->energy = malloc(sizeof *l->energy * (size_t)l->responses);
    l->size = malloc(sizeof *l->size * (size_t)l->drives);
    l->norm = malloc(sizeof *l->norm * (size_t)l->direct);
    t->x = fftw_alloc_real((size_t)l->samples);
    t->X = fftw_alloc_complex((size_t)l->samples / 2 + 1);
    if (t->x != NULL && t->X != NULL)
        t->plan = fftw_plan_dft_r2c_1d(l->samples, t->x, t->X, FFTW_ESTIMATE);
    if (l->z == NULL || l->Y == NULL || l->W == NULL || l->X == NULL || l->energy == NULL
        || l->size == NULL || l->norm == NULL || t->plan == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "lines: no memory for %d lines of %d channels",
                          l->count, l->responses + l->drives);
    return MODAL_OK;
}

enum modal_status lines_make(const struct matrix *responses, const struct matrix *inputs,
                             const struct lines_records *records, const double band[2],
                             struct lines *out, struct modal_error *err)
{
    int N = responses->m, first = 1, last = (N - 1) / 2;
    struct lines l = { .samples = N, .responses = responses->n, .inputs = inputs->n,
                       .records = records->count, .drives = inputs->n + records->count };
    struct transform t = { 0 };
    enum modal_status rc;

    if (band[1] > 0) {
        first = (int)fmax(first, ceil(band[0] * N));
        last = (int)fmin(last, floor(band[1] * N));
    }
    l.count = last - first + 1;
    l.direct = BESIDE * l.inputs + ENDS * l.records + (first == 1 ? l.records - 1 : 0);
    if (l.count < LINES_LEAST)
        return modal_fail_field(err, MODAL_BAD_INPUT, band[1] > 0 ? "band" : "signals",
                                "%d lines of the spectrum are left; at least %d are needed",
                                l.count > 0 ? l.count : 0, LINES_LEAST);
    rc = make_room(&l, &t, err);
    if (rc == MODAL_OK) {
        for (int n = 0; n < l.count; n++)
            /* a line's place on the unit circle */
            l.z[n] = cexp(CMPLX(0, 2 * M_PI * (first + n) / N));
        for (int c = 0; c < l.responses; c++) {
            transform_column(&t, responses, c, first, l.count, l.Y + (size_t)c * l.count);
            l.energy[c] = cblas_dznrm2(l.count, l.Y + (size_t)c * l.count, 1);
            l.energy[c] *= l.energy[c];
        }
        for (int j = 0; j < inputs->n; j++)
            transform_column(&t, inputs, j, first, l.count, l.W + (size_t)j * l.count);
        add_beginnings(&l, records, first);
        for (int j = 0; j < l.drives; j++)
            l.size[j] = to_unit(l.W + (size_t)j * l.count, l.count, sqrt(l.count));
        make_direct(&l);
        for (int n = 0; n < l.count; n = lines_band_end(&l, n))
            l.bands++;
    }
    fftw_destroy_plan(t.plan);
    fftw_free(t.x), fftw_free(t.X);
    if (rc != MODAL_OK)
        lines_done(&l);
    else
        *out = l;
    return rc;
}
