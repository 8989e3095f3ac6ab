/*
 * periodogram.c - a long real transform in place, without tables of its length
 *
 * A plan of FFTW for 10^6 numbers has tables as long as they, which take three times as long to
 * make as the transform does.  Here N = 2 M numbers are M complex ones, z_j = x_{2j} + i x_{2j+1},
 * M = m n, and in four steps, with j = j_1 n + j_2 and k = k_1 + m k_2
 *
 *     Z_k = sum_{j_2} w_n^{j_2 k_2} w_M^{j_2 k_1} sum_{j_1} w_m^{j_1 k_1} z_j,
 *     w_M = e^{-2 pi i / M}:                                                                (1)
 *
 * n transforms of m numbers n apart, M turns, m transforms of n numbers that follow each other; Z_k
 * lies at k_1 n + k_2 then, and there it stays.  With Z' of M - k, which M being odd is another,
 *
 *     e = (Z + conj Z') / 2,   o = -i (Z - conj Z') / 2,   X_k = e + w_N^k o,
 *     X_{M-k} = conj(e - w_N^k o).                                                          (2)
 *
 * Turns follow from each other, one a row exact: off by n roundings, and an ordinate is asked for
 * its size.
 */
#include "modal/identify/order/periodogram.h"
#include <complex.h>
#include <fftw3.h>
#include <math.h>
#include <stdlib.h>
#include "modal/identify/linear/pencil.h"

struct periodogram {
    double *x;
    int m, n;                    /* (1), both odd */
    fftw_plan down, across;
};

int periodogram_length(int rows)
{
    return transform_length(rows);
}

int periodogram_count(const struct periodogram *p)
{
    return p->m * p->n + 1;
}

void periodogram_free(struct periodogram *p)
{
    if (p == NULL)
        return;
    if (p->down != NULL) fftw_destroy_plan(p->down);
    if (p->across != NULL) fftw_destroy_plan(p->across);
    free(p);
}

enum modal_status periodogram_new(int rows, double *x, struct periodogram **out,
                                  struct modal_error *err)
{
    int M = periodogram_length(rows) / 2;
    struct periodogram *p = calloc(1, sizeof *p);
    fftw_complex *z = (fftw_complex *)x;

    if (p == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "periodogram: no memory");
    p->x = x;
    for (p->m = (int)sqrt((double)M); M % p->m != 0;)
        p->m--;
    p->n = M / p->m;
    p->down = fftw_plan_many_dft(1, &p->m, p->n, z, NULL, p->n, 1, z, NULL, p->n, 1, FFTW_FORWARD,
                                 FFTW_ESTIMATE);
    p->across = fftw_plan_many_dft(1, &p->n, p->m, z, NULL, 1, p->n, z, NULL, 1, p->n,
                                   FFTW_FORWARD, FFTW_ESTIMATE);
    if (p->down == NULL || p->across == NULL) {
        periodogram_free(p);
        return modal_fail(err, MODAL_NO_MEMORY, "periodogram: no memory for %d rows", rows);
    }
    *out = p;
    return MODAL_OK;
}

/* (1) */
static void turn(struct periodogram *p)
{
    for (int k = 1; k < p->m; k++) {
        double angle = -2 * M_PI * k / ((double)p->m * p->n), c = cos(angle), s = sin(angle);
        double re = 1, im = 0, *z = p->x + 2 * (size_t)k * (size_t)p->n;
        for (int j = 0; j < 2 * p->n; j += 2) {
            double a = z[j], b = z[j + 1], next = re * c - im * s;
            z[j] = a * re - b * im, z[j + 1] = a * im + b * re;
            im = re * s + im * c, re = next;
        }
    }
}

/* (2) of ordinates first, first + 1, ... before END of row K1, and of those that pair with them. */
static void add_pairs(const struct periodogram *p, int k1, int first, int end, double scale,
                      float *power)
{
    double N = 2.0 * p->m * p->n, angle = -2 * M_PI * (k1 + (double)p->m * first) / N;
    double re = cos(angle), im = sin(angle), c = cos(-2 * M_PI * p->m / N),
           s = sin(-2 * M_PI * p->m / N);
    size_t row = (size_t)k1 * (size_t)p->n, other = (size_t)(k1 > 0 ? p->m - k1 : 0) * (size_t)p->n;

    for (int k2 = first; k2 < end; k2++) {
        size_t i = row + (size_t)k2, j = other + (size_t)(k1 > 0 ? p->n - 1 - k2 : p->n - k2);
        double a = p->x[2 * i], b = p->x[2 * i + 1], u = p->x[2 * j], v = p->x[2 * j + 1];
        double er = 0.5 * (a + u), ei = 0.5 * (b - v), or = 0.5 * (b + v), oi = 0.5 * (u - a);
        double tr = or * re - oi * im, ti = or * im + oi * re, next = re * c - im * s;
        power[i] += (float)(scale * ((er + tr) * (er + tr) + (ei + ti) * (ei + ti)));
        power[j] += (float)(scale * ((er - tr) * (er - tr) + (ei - ti) * (ei - ti)));
        im = re * s + im * c, re = next;
    }
}

void periodogram_add(struct periodogram *p, double scale, float *power)
{
    double sum, difference;

    fftw_execute(p->down);
    turn(p);
    fftw_execute(p->across);
    sum = p->x[0] + p->x[1], difference = p->x[0] - p->x[1];
    power[0] += (float)(0.5 * scale * sum * sum);
    power[p->m * p->n] += (float)(0.5 * scale * difference * difference);
    add_pairs(p, 0, 1, (p->n + 1) / 2, scale, power);
    for (int k1 = 1; k1 <= p->m / 2; k1++)
        add_pairs(p, k1, 0, p->n, scale, power);
}

double periodogram_angle(const struct periodogram *p, int i)
{
    int M = p->m * p->n;

    return M_PI * (i == M ? M : i / p->n + (double)p->m * (i % p->n)) / M;
}
