/* polish.c - variable projection in long double
 *
 * Two poles that nearly coincide have coefficients of opposite sign and of size 1/distance, and a
 * basis whose condition is of that size.  Double precision then evaluates the model with errors
 * above those of data that are exact to their last bit: refine.c ends where its own arithmetic
 * does. With eleven bits more the data decide.  The model, the Jacobian and its reduction are those
 * of refine.c, (1) to (3), with all weights 1, and small enough to be written plainly: Gram-Schmidt
 * twice over for the basis Phi = Q R, and with D = diag(l) Phi
 *
 *     C = R^{-1} Q^T Y,   e = Y - Q Q^T Y,   J_p = (I - Q Q^T) dPhi/dp C,                       (1)
 *
 * Levenberg's step from J^T J, its columns scaled.  Squaring the condition is harmless here: twice
 * the digits that were lost are still fewer than long double has more than double has digits of
 * data to lose.
 */
#include "modal/identify/fit/polish.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/linear/exponents.h"
#include "modal/linalg/workspace.h"

enum { ITERATIONS = 40 };                 /* from the nine digits of a fit in double precision */
static const double COST_MOST = 2e7;      /* L S P^2 of one evaluation */
static const long double
    DAMPING_FIRST = 1e-3L,                /* of Levenberg and Marquardt: it begins near */
    DAMPING_MOST = 1e6L,                  /* no step gains: the minimum, to rounding */
    FALL_LEAST = 1e-9L;                   /* of F: so much for another step */

struct work {
    const struct matrix *Y;
    int L, S, q, P, count;
    double tau;
    enum pole_kind *kind;
    int *column, *first;
    long double *Phi, *D, *Q, *R;     /* L x q; L x q, made orthogonal to Q; L x q; q x q */
    long double *C, *J, *e;           /* q; L x P; L: of one channel */
    long double *N, *A, *g, *step;    /* P x P, twice; P; P */
    struct workspace space;           /* of all these */
};

static bool work_allocate(struct work *w)
{
    size_t L = (size_t)w->L, q = (size_t)w->q, P = (size_t)w->P;
    const struct { long double **x; size_t count; } all[] = {
        { &w->Phi, L * q }, { &w->D, L * q }, { &w->Q, L * q }, { &w->R, q * q }, { &w->C, q },
        { &w->J, L * P }, { &w->e, L }, { &w->N, P * P }, { &w->A, P * P }, { &w->g, P },
        { &w->step, P },
    };

    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        *all[i].x = workspace_zeros(&w->space, all[i].count, sizeof(long double));
    return !w->space.failed;
}

static long double dot(const long double *a, const long double *b, int n)
{
    long double sum = 0;

    for (int i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* Columns of Phi, largest entry 1, and D = diag(l) Phi.  x: Re, Im of each pole. */
static void fill(struct work *w, const long double *x)
{
    for (int j = 0; j < w->count; j++) {
        long double a = x[2 * j] * w->tau, b = x[2 * j + 1] * w->tau,
                    top = a > 0 ? a * (w->L - 1) : 0;
        long double *re = w->Phi + (size_t)w->column[j] * (size_t)w->L, *im = re + w->L;
        for (int l = 0; l < w->L; l++) {
            long double size = expl(a * l - top);
            re[l] = w->kind[j] == POLE_PAIR            ? size * cosl(b * l)
                : w->kind[j] == POLE_NEGATIVE && l % 2 ? -size
                                                       : size;
            if (w->kind[j] == POLE_PAIR)
                im[l] = -size * sinl(b * l);
        }
    }
    for (int i = 0; i < w->q; i++)
        for (int l = 0; l < w->L; l++)
            /* not centred as refine.c's: e is orthogonal to Phi, so that a multiple of it
             * changes nothing */
            w->D[l + (size_t)i * (size_t)w->L] = l * w->Phi[l + (size_t)i * (size_t)w->L];
}

/* v less its part in the first n columns of Q, which is added to r. */
static void project_out(const struct work *w, int n, long double *v, long double *r)
{
    /* the second takes out what rounding of the first left: twice is enough */
    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; i < n; i++) {
            const long double *Q = w->Q + (size_t)i * (size_t)w->L;
            long double part = dot(Q, v, w->L);
            if (r != NULL)
                r[i] += part;
            for (int l = 0; l < w->L; l++)
                v[l] -= part * Q[l];
        }
}

/* Phi = Q R, D orthogonal to Q; false where Phi is singular. */
static bool factor(struct work *w)
{
    memset(w->R, 0, sizeof(long double) * (size_t)w->q * (size_t)w->q);
    for (int j = 0; j < w->q; j++) {
        long double *v = w->Q + (size_t)j * (size_t)w->L, *r = w->R + (size_t)j * (size_t)w->q;
        memcpy(v, w->Phi + (size_t)j * (size_t)w->L, sizeof(long double) * (size_t)w->L);
        project_out(w, j, v, r);
        r[j] = sqrtl(dot(v, v, w->L));
        if (!(r[j] > 0))
            return false;
        for (int l = 0; l < w->L; l++)
            v[l] /= r[j];
    }
    for (int j = 0; j < w->q; j++)
        project_out(w, w->q, w->D + (size_t)j * (size_t)w->L, NULL);
    return true;
}

/* (1) for channel c, its J and e into N, g. */
static void add_channel(struct work *w, int c)
{
    int L = w->L, q = w->q, P = w->P;

    memset(w->C, 0, sizeof(long double) * (size_t)q);
    for (int l = 0; l < L; l++)
        w->e[l] = w->Y->x[l + (size_t)c * (size_t)w->Y->ld];
    project_out(w, q, w->e, w->C);
    for (int i = q - 1; i >= 0; i--) {
        for (int k = i + 1; k < q; k++)
            w->C[i] -= w->R[i + (size_t)k * (size_t)q] * w->C[k];
        w->C[i] /= w->R[i + (size_t)i * (size_t)q];
    }
    for (int j = 0; j < w->count; j++) {
        int i = w->column[j], p = w->first[j];
        const long double *d1 = w->D + (size_t)i * (size_t)L, *d2 = d1 + L;
        for (int l = 0; l < L && p >= 0; l++) {
            bool pair = w->kind[j] == POLE_PAIR;
            /* (3) of refine.c */
            w->J[l + (size_t)p * (size_t)L] = w->C[i] * d1[l] + (pair ? w->C[i + 1] * d2[l] : 0);
            if (pair)
                w->J[l + (size_t)(p + 1) * (size_t)L] = w->C[i] * d2[l] - w->C[i + 1] * d1[l];
        }
    }
    for (int p = 0; p < P; p++) {
        w->g[p] += dot(w->J + (size_t)p * (size_t)L, w->e, L);
        for (int k = 0; k <= p; k++)
            w->N[p + (size_t)k * (size_t)P] +=
                dot(w->J + (size_t)p * (size_t)L, w->J + (size_t)k * (size_t)L, L);
    }
}

/* Sum of squares left at x; N and g there.  HUGE_VALL where the poles coincide. */
static long double evaluate(struct work *w, const long double *x)
{
    long double F = 0;

    memset(w->N, 0, sizeof(long double) * (size_t)w->P * (size_t)w->P);
    memset(w->g, 0, sizeof(long double) * (size_t)w->P);
    fill(w, x);
    if (!factor(w))
        return HUGE_VALL;
    for (int c = 0; c < w->S; c++) {
        add_channel(w, c);
        F += dot(w->e, w->e, w->L);
    }
    return F;
}

/* Lower Cholesky factor in A of N with unit diagonal, mu added to it; false where not positive. */
static bool cholesky(struct work *w, long double mu)
{
    int P = w->P;

    for (int j = 0; j < P; j++)
        for (int i = j; i < P; i++) {
            long double sum = w->N[i + (size_t)j * (size_t)P]
                    / sqrtl(w->N[i + (size_t)i * (size_t)P] * w->N[j + (size_t)j * (size_t)P])
                + (i == j ? mu : 0);  /* columns scaled to 1, so that mu is a part of each */
            for (int k = 0; k < j; k++)
                sum -= w->A[i + (size_t)k * (size_t)P] * w->A[j + (size_t)k * (size_t)P];
            if (i == j && !(sum > 0))
                return false;
            w->A[i + (size_t)j * (size_t)P] =
                i == j ? sqrtl(sum) : sum / w->A[j + (size_t)j * (size_t)P];
        }
    return true;
}

/* b = (A A^T)^{-1} b */
static void solve(const struct work *w, long double *b)
{
    int P = w->P;

    for (int i = 0; i < P; i++) {
        for (int k = 0; k < i; k++)
            b[i] -= w->A[i + (size_t)k * (size_t)P] * b[k];
        b[i] /= w->A[i + (size_t)i * (size_t)P];
    }
    for (int i = P - 1; i >= 0; i--) {
        for (int k = i + 1; k < P; k++)
            b[i] -= w->A[k + (size_t)i * (size_t)P] * b[k];
        b[i] /= w->A[i + (size_t)i * (size_t)P];
    }
}

static long double scale_of(const struct work *w, int p)
{
    return sqrtl(w->N[p + (size_t)p * (size_t)w->P]);
}

/* x moved by the damped step into y. */
static bool move(struct work *w, long double mu, const long double *x, long double *y)
{
    if (!cholesky(w, mu))
        return false;
    for (int p = 0; p < w->P; p++)
        w->step[p] = w->g[p] / scale_of(w, p);
    solve(w, w->step);
    memcpy(y, x, sizeof(long double) * 2 * (size_t)w->count);
    for (int j = 0; j < w->count; j++) {
        int p = w->first[j];
        if (p >= 0)
            y[2 * j] += w->step[p] / scale_of(w, p) / w->tau;
        if (p >= 0 && w->kind[j] == POLE_PAIR)
            y[2 * j + 1] += w->step[p + 1] / scale_of(w, p + 1) / w->tau;
    }
    return true;
}

/* Down from x, in place; the sum of squares there, N as of x. */
static long double descend(struct work *w, long double *x, long double *trial)
{
    long double F = evaluate(w, x), mu = DAMPING_FIRST;

    for (int i = 0; i < ITERATIONS && F < HUGE_VALL && mu < DAMPING_MOST; i++) {
        long double next = move(w, mu, x, trial) ? evaluate(w, trial) : HUGE_VALL;
        if (next < F) {
            bool settled = F - next <= FALL_LEAST * F;
            memcpy(x, trial, sizeof(long double) * 2 * (size_t)w->count);
            F = next, mu /= 8;
            if (settled)
                break;
        } else {
            mu *= 8;
            evaluate(w, x);
        }
    }
    return evaluate(w, x);
}

/* Standard errors from N at the end. */
static void report(struct work *w, long double F, const long double *x, double complex *lambda,
                   double *std_re, double *std_im)
{
    /* each channel has q amplitudes of its own */
    double freedom = fmax(1, (double)w->S * (w->L - w->q) - w->P);

    if (!cholesky(w, 0))
        return;
    for (int j = 0; j < w->count; j++) {
        double std[2] = { 0, 0 };
        int n = w->kind[j] == POLE_PAIR ? 2 : 1;
        if (w->first[j] < 0)
            continue;
        for (int k = 0; k < n; k++) {
            int p = w->first[j] + k;
            memset(w->step, 0, sizeof(long double) * (size_t)w->P);
            w->step[p] = 1;
            solve(w, w->step);
            /* (5) of refine.c: the inverse's diagonal, entry by entry */
            std[k] = (double)(sqrtl(w->step[p] * F / freedom) / scale_of(w, p) / w->tau);
        }
        lambda[j] = CMPLX((double)x[2 * j],
                          w->kind[j] == POLE_PAIR ? (double)x[2 * j + 1] : cimag(lambda[j]));
        std_re[j] = std[0], std_im[j] = std[1];
    }
}

/* Where each pole's columns and parameters are. */
static void lay_out(struct work *w, const double complex *lambda, long double *x)
{
    for (int j = 0; j < w->count; j++) {
        int n = pole_order(lambda[j], w->tau);
        w->kind[j] = pole_kind(lambda[j], w->tau);
        w->column[j] = w->q, w->q += n;
        w->first[j] = lambda[j] == 0 ? -1 : w->P;
        w->P += lambda[j] == 0 ? 0 : n;
        x[2 * j] = creal(lambda[j]), x[2 * j + 1] = cimag(lambda[j]);
    }
}

static bool inside(const struct work *w, const long double *x)
{
    for (int j = 0; j < w->count; j++)
        if (!isfinite(x[2 * j])
            || (w->kind[j] == POLE_PAIR && !(x[2 * j + 1] > 0 && x[2 * j + 1] * w->tau < M_PI)))
            return false;
    return true;
}

enum modal_status polish_poles(const struct refine_data *data, double complex *lambda, int count,
                               double *std_re, double *std_im, struct modal_error *err)
{
    struct work w = {
        .Y = data->Y, .L = data->Y->m, .S = data->Y->n, .count = count, .tau = data->tau
    };
    size_t n = (size_t)count;
    long double *x = workspace_zeros(&w.space, 2 * n, sizeof *x),
                *trial = workspace_zeros(&w.space, 2 * n, sizeof *trial), before, after;
    enum modal_status rc;

    w.kind = workspace_zeros(&w.space, n, sizeof *w.kind);
    w.column = workspace_zeros(&w.space, n, sizeof *w.column);
    w.first = workspace_zeros(&w.space, n, sizeof *w.first);
    rc = workspace_check(&w.space, "polish: no memory for the poles", err);
    /* no extended precision on this machine: nothing to gain */
    if (rc != MODAL_OK || LDBL_MANT_DIG <= DBL_MANT_DIG)
        goto out;
    lay_out(&w, lambda, x);
    if (w.P == 0 || w.q >= w.L || (double)w.L * w.S * w.P * w.P > COST_MOST)
        goto out;
    if (!work_allocate(&w)) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "polish: no memory for order %d", w.q);
        goto out;
    }
    before = evaluate(&w, x);
    after = descend(&w, x, trial);
    if (after < before && inside(&w, x))
        report(&w, after, x, lambda, std_re, std_im);
out:
    workspace_free(&w.space);
    return rc;
}
