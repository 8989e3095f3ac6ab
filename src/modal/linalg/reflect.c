/*
 * reflect.c - Householder reflections, column by column
 *
 * With alpha the entry to keep and x those to annihilate, beta = -sign(alpha) |(alpha, x)|,
 *
 *     v = (1, x / (alpha - beta)),    tau = (beta - alpha) / beta,                              (1)
 *
 * has no cancellation [GVL, sec. 5.1].  Two numbers are multiplied at a time.
 *
 * [GVL] Golub and Van Loan, Matrix Computations, 4th ed., 2013.
 */
#include "modal/linalg/reflect.h"
#include <math.h>
#include <stddef.h>

typedef double two __attribute__((vector_size(16), aligned(8), may_alias));

static double dot(int m, const double *x, const double *y)
{
    two s = { 0, 0 }, t = { 0, 0 };
    double sum;
    int i = 0;

    for (; i + 4 <= m; i += 4) {            /* two sums: an addition need not wait for the last */
        s += *(const two *)(x + i) * *(const two *)(y + i);
        t += *(const two *)(x + i + 2) * *(const two *)(y + i + 2);
    }
    s += t;
    sum = s[0] + s[1];
    for (; i < m; i++)
        sum += x[i] * y[i];
    return sum;
}

/* y -= a x */
static void subtract(int m, double a, const double *x, double *y)
{
    two b = { a, a };
    int i = 0;

    for (; i + 4 <= m; i += 4) {
        *(two *)(y + i) -= b * *(const two *)(x + i);
        *(two *)(y + i + 2) -= b * *(const two *)(x + i + 2);
    }
    for (; i < m; i++)
        y[i] -= a * x[i];
}

/* (1): alpha becomes beta, x the rest of v.  Returns tau. */
static double reflection(int m, double *alpha, double *x)
{
    double square = dot(m, x, x), beta, scale, tau;

    if (square == 0)
        return 0;                           /* nothing to annihilate: the identity */
    beta = -copysign(sqrt(*alpha * *alpha + square), *alpha);
    tau = (beta - *alpha) / beta, scale = 1 / (*alpha - beta);
    for (int i = 0; i < m; i++)
        x[i] *= scale;
    *alpha = beta;
    return tau;
}

void reflect_columns(int m, int n, double *A, int ld, double *tau)
{
    for (int k = 0; k < n; k++) {
        double *v = A + k + (ptrdiff_t)k * ld;
        tau[k] = reflection(m - k - 1, v, v + 1);
        for (int j = k + 1; j < n && tau[k] != 0; j++) {
            double *x = A + k + (ptrdiff_t)j * ld,
                   s = tau[k] * (x[0] + dot(m - k - 1, v + 1, x + 1));     /* tau v^T x, v_0 = 1 */
            x[0] -= s;
            subtract(m - k - 1, s, v + 1, x + 1);
        }
    }
}

void reflect_compact(int m, int n, const double *V, int ld, const double *tau, double *T)
{
    for (int k = 0; k < n; k++) {
        const double *v = V + k + (ptrdiff_t)k * ld;
        double *t = T + (ptrdiff_t)k * n;
        for (int i = 0; i < k; i++) {
            const double *u = V + k + (ptrdiff_t)i * ld;
            t[i] = -tau[k] * (u[0] + dot(m - k - 1, u + 1, v + 1));     /* -tau_k v_i^T v_k */
        }
        for (int i = 0; i < k; i++) {         /* T of those before, from the left, in place */
            double sum = 0;
            for (int l = i; l < k; l++)
                sum += T[i + (ptrdiff_t)l * n] * t[l];
            t[i] = sum;
        }
        t[k] = tau[k];
        for (int i = k + 1; i < n; i++)
            t[i] = 0;
    }
}

/* Rows of column k of the part below. */
static int rows_of(int m, int flat, int k)
{
    int rows = m - flat + k + 1;

    return rows < m ? rows : m;
}

void reflect_below(int m, int n, int flat, double *R, int ldr, double *B, int ldb, double *tau)
{
    for (int k = 0; k < n; k++) {
        double *r = R + k + (ptrdiff_t)k * ldr, *v = B + (ptrdiff_t)k * ldb;
        int rows = rows_of(m, flat, k);
        tau[k] = reflection(rows, r, v);
        for (int j = k + 1; j < n && tau[k] != 0; j++) {
            double *x = B + (ptrdiff_t)j * ldb, *top = r + (ptrdiff_t)(j - k) * ldr,
                   s = tau[k] * (*top + dot(rows, v, x));      /* v's upper part is e_k */
            *top -= s;
            subtract(rows, s, v, x);
        }
    }
}

void reflect_below_apply(int m, int n, int flat, const double *V, int ldv, const double *tau,
                         int count, double *top, int ldt, double *low, int ldl)
{
    for (int c = 0; c < count; c++)
        for (int k = 0; k < n; k++) {
            const double *v = V + (ptrdiff_t)k * ldv;
            double *t = top + k + (ptrdiff_t)c * ldt, *x = low + (ptrdiff_t)c * ldl;
            int rows = rows_of(m, flat, k);
            double s = tau[k] * (*t + dot(rows, v, x));
            *t -= s;
            subtract(rows, s, v, x);
        }
}
