/* spectrum.c - see spectrum.h; tested by tests/unit/modal/identify/test_ambient.c */
#include <fftw3.h>       /* before complex.h, which makes its numbers the compiler's */
#include "modal/identify/ambient/spectrum.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

void spectrum_done(struct spectrum *s)
{
    free(s->F);
    memset(s, 0, sizeof *s);
}

static const double
    BEYOND = 1.25,               /* of the end: what lies there shows that it does */
    FLOOR = 1e-3;                /* of a bin's energy, and so much of what it tells at most; above
                                    what its width leaves where S is singular; see whittle.c */

enum { LINES_FEW = 64 };         /* of a spectrum that can be asked */

/* Of one channel after the other: the lines that are kept, over sqrt(samples). */
static enum modal_status transform(const struct matrix *Y, struct spectrum *s,
                                   struct modal_error *err)
{
    int N = Y->m;
    /* Parseval: |F|^2 of a line is then the signal's spectrum, whatever N */
    double *x = fftw_alloc_real((size_t)N), scale = 1 / sqrt(N);
    fftw_complex *X = fftw_alloc_complex((size_t)N / 2 + 1);
    fftw_plan plan = x != NULL && X != NULL ? fftw_plan_dft_r2c_1d(N, x, X, FFTW_ESTIMATE) : NULL;

    for (int c = 0; plan != NULL && c < s->channels; c++) {
        memcpy(x, Y->x + (size_t)c * Y->ld, sizeof *x * (size_t)N);
        fftw_execute(plan);
        for (int j = 0; j < s->lines; j++)
            s->F[(size_t)j * s->channels + c] = CMPLX(X[s->first + j][0] * scale,
                                                      X[s->first + j][1] * scale);
    }
    if (plan != NULL)
        fftw_destroy_plan(plan);
    fftw_free(x), fftw_free(X);
    return plan != NULL ? MODAL_OK
                        : modal_fail(err, MODAL_NO_MEMORY, "spectrum: no memory for %d samples", N);
}

enum modal_status spectrum_make(const struct matrix *Y, int first, double end,
                                struct spectrum *out, struct modal_error *err)
{
    int N = Y->m, last = (N - 1) / 2, samples = N;
    enum modal_status rc;

    if (end > 0) {
        last = (int)fmin(last, floor(fmin(BEYOND * end, 1) * N));
        /* as if sampled at the rate that these lines need */
        samples = last < (N - 1) / 2 ? 2 * last + 2 : N;
    }
    if (last - first + 1 < LINES_FEW)
        return modal_fail_field(err, MODAL_BAD_INPUT, end > 0 ? "band" : "signals",
                                "%d lines of the spectrum are left; at least %d are needed",
                                last - first + 1, LINES_FEW);
    *out = (struct spectrum) { Y->n, samples, first, last - first + 1, NULL };
    out->F = malloc(sizeof *out->F * (size_t)out->lines * (size_t)out->channels);
    rc = out->F != NULL ? transform(Y, out, err)
                        : modal_fail(err, MODAL_NO_MEMORY, "spectrum: no memory for %d lines of %d "
                                     "channels", out->lines, out->channels);
    if (rc != MODAL_OK)
        spectrum_done(out);
    return rc;
}

/* ---- bins ---- */

void bins_done(struct bins *b)
{
    free(b->first), free(b->lines), free(b->from), free(b->to), free(b->mean), free(b->floor);
    free(b->seen);
    memset(b, 0, sizeof *b);
}

/* How many lines from line j on make a bin. */
static int width_at(const struct spectrum *s, int j, const double complex *poles, int count,
                    double share, int most)
{
    double w = 2 * M_PI * (s->first + j) / s->samples, near = HUGE_VAL;

    for (int k = 0; k < count; k++)
        near = fmin(near, cabs(CMPLX(0, w) - poles[k]));
    /* a resonance is as wide as its pole is far from the axis */
    near *= share * s->samples / (2 * M_PI);
    return (int)fmin(fmax(fmin(near, most), 1), s->lines - j);
}

/* The mean of bin B, its floor, and both as they are seen. */
static void average(const struct spectrum *s, struct bins *out, int b)
{
    int l = s->channels;
    double complex *mean = out->mean + (size_t)b * l * l, *seen = out->seen + (size_t)b * l * l;

    memset(mean, 0, sizeof *mean * l * l);
    for (int j = out->first[b]; j < out->first[b] + out->lines[b]; j++) {
        const double complex *f = s->F + (size_t)j * l;
        for (int c = 0; c < l; c++)
            for (int r = 0; r < l; r++)
                /* lines of a bin are independent: their sum is Wishart's */
                mean[r + l * c] += f[r] * conj(f[c]);
    }
    for (int i = 0; i < l * l; i++)
        mean[i] /= out->lines[b];
    out->floor[b] = 0;
    for (int i = 0; i < l; i++)
        /* a share of the mean eigenvalue, on every one of them */
        out->floor[b] += FLOOR / l * creal(mean[i * (l + 1)]);
    memcpy(seen, mean, sizeof *seen * l * l);
    for (int i = 0; i < l; i++)
        seen[i * (l + 1)] += out->floor[b];
}

enum modal_status bins_make(const struct spectrum *s, const double complex *poles, int count,
                            double share, int widest, struct bins *out, struct modal_error *err)
{
    int n = 0, most = s->lines / widest > 1 ? s->lines / widest : 1;
    int l2 = s->channels * s->channels;
    double line = 2 * M_PI / s->samples;

    for (int j = 0; j < s->lines; n++)
        j += width_at(s, j, poles, count, share, most);
    *out = (struct bins) { n, s->channels, s->samples, malloc(sizeof(int) * n),
                           malloc(sizeof(int) * n), malloc(sizeof(double) * n),
                           malloc(sizeof(double) * n),
                           malloc(sizeof(double complex) * n * l2), malloc(sizeof(double) * n),
                           malloc(sizeof(double complex) * n * l2) };
    if (out->first == NULL || out->lines == NULL || out->from == NULL || out->to == NULL
        || out->mean == NULL || out->floor == NULL || out->seen == NULL) {
        bins_done(out);
        return modal_fail(err, MODAL_NO_MEMORY, "spectrum: no memory for %d bins", n);
    }
    for (int b = 0, j = 0; b < n; b++) {
        out->first[b] = j;
        out->lines[b] = width_at(s, j, poles, count, share, most);
        out->from[b] = (s->first + j - 0.5) * line;
        out->to[b] = out->from[b] + out->lines[b] * line;
        average(s, out, b);
        j += out->lines[b];
    }
    return MODAL_OK;
}
