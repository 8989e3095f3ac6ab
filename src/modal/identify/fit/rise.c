/* rise.c - (1) of rise.h */
#include "modal/identify/fit/rise.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>
#include "modal/identify/linear/exponents.h"

/* (1) in each signal for the pole whose N columns begin at I: INVERSE is R^{-1}, C as in (1). */
static void rise_of(const struct projected *p, int ld, const double *inverse, const double *C,
                    int i, int n, double *rise)
{
    int q = p->order, phases = p->criterion.phases;
    const double *B = inverse + i;
    /* [a b; b d] = B B^T, rows of R^{-1} begin at their diagonal */
    double a = cblas_ddot(q - i, B + i * ld, ld, B + i * ld, ld), b = 0, d = 1, det;

    if (n == 2) {
        b = cblas_ddot(q - i, B + i * ld, ld, B + 1 + i * ld, ld);
        d = cblas_ddot(q - i, B + 1 + i * ld, ld, B + 1 + i * ld, ld);
    }
    det = a * d - b * b;
    memset(rise, 0, (size_t)p->criterion.groups * sizeof *rise);
    for (int c = 0; c < p->columns; c++) {
        const double *at = C + i + (size_t)c * (size_t)ld;
        double x = at[0], y = n == 2 ? at[1] : 0;
        rise[c / phases] += det > 0 ? fmax((d * x * x - 2 * b * x * y + a * y * y) / det, 0) : 0;
    }
}

bool rise_without(const struct projected *p, int ld, const double complex *lambda, int count,
                  double tau, double *room, double *rise)
{
    int q = p->order;
    double *inverse = room, *C = room + (size_t)ld * (size_t)q;

    for (int j = 0; j < q; j++) {
        memcpy(inverse + j * ld, p->R + j * ld, (size_t)(j + 1) * sizeof *inverse);
        /* rise_of reads one of a pair's */
        memset(inverse + j * ld + j + 1, 0, (size_t)(q - j - 1) * sizeof *inverse);
    }
    if (LAPACKE_dtrtri(LAPACK_COL_MAJOR, 'U', 'N', q, inverse, ld) != 0)
        return false;
    matrix_copy(q, p->columns, p->Z, ld, C, ld);
    cblas_dtrmm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, q, p->columns, 1,
                inverse, ld, C, ld);
    for (int j = 0, i = 0; j < count; j++) {
        int n = pole_order(lambda[j], tau);
        rise_of(p, ld, inverse, C, i, n, rise + (size_t)j * (size_t)p->criterion.groups);
        i += n;
    }
    return true;
}
