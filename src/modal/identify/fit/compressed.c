/*
 * compressed.c - projections of a very long record, block by block
 *
 * In a block of B rows about row c a pole lambda near a known one, lambda_0, has the columns
 *
 *     e^{lambda l} = e^{lambda_0 l} sum_p (delta (l - c))^p / p! e^{delta c},  delta = lambda -
 *                    lambda_0,                                                            (1)
 *
 * and so has its derivative. So all that a fit can ask of the block is in the span of
 * u^p e^{lambda_0 l}, u = (l - c) / w, p < TERMS, whichever block it is: they differ by a factor.
 * With an orthonormal Q of that span |y - Phi x|^2 = |Q^T y - Q^T Phi x|^2 + |y - Q Q^T y|^2, and
 * the second part does not depend on the fit. It is |y|^2 - |Q^T y|^2 where that keeps twelve
 * digits, as many as an exact fit has; else it is summed from what is left, so that exact data stay
 * exact.
 *
 * w is half of the block, or the life 1 / |a| of what decays sooner. (1) is cut at
 * (delta w)^TERMS / TERMS!, which REACH keeps below 1e-11.
 */
#include "modal/identify/fit/compressed.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    TERMS = 3                       /* of (1) */
};
static const double
    REACH = 3e-4,                   /* of delta w: (1) is then cut below 1e-11 */
    CANCELS = 1e-4;                 /* of |y|^2: of sixteen digits a difference keeps twelve */

void compressed_free(struct compressed *c)
{
    if (c == NULL)
        return;
    free(c->Q), free(c->data), free(c->rest), free(c->a);
    free(c);
}

/* Sums of squares of the column and of its steps. */
static void measure(const double *y, int L, double *energy, double *swing)
{
    double square[4] = { 0 }, step[4] = { 0 };
    int l = 1;

    for (; l + 4 <= L; l += 4)
        for (int i = 0; i < 4; i++) {
            /* four sums at once: the adder is filled, and rounding grows with L / 4 */
            double d = y[l + i] - y[l + i - 1];
            square[i] += y[l + i] * y[l + i], step[i] += d * d;
        }
    for (; l < L; l++)
        square[0] += y[l] * y[l], step[0] += (y[l] - y[l - 1]) * (y[l] - y[l - 1]);
    *energy = y[0] * y[0] + square[0] + square[1] + square[2] + square[3];
    *swing = step[0] + step[1] + step[2] + step[3];
}

struct compressed *compressed_new(const struct matrix *Y)
{
    struct compressed *c = calloc(1, sizeof *c);
    size_t S = (size_t)Y->n;

    if (c == NULL)
        return NULL;
    c->Y = *Y;
    c->rest = calloc(4 * S, sizeof *c->rest);
    if (c->rest == NULL) {
        free(c);
        return NULL;
    }
    c->energy = c->rest + 2 * S, c->swing = c->energy + S;
    for (size_t k = 0; k < S; k++)
        measure(Y->x + k * (size_t)Y->ld, Y->m, &c->energy[k], &c->swing[k]);
    return c;
}

static double width_of(const struct compressed *c, double a)
{
    /* where e^{a l} has its weight: its life, half a block at most */
    return fabs(a) * c->block > 2 ? 1 / fabs(a) : 0.5 * c->block;
}

static double angle_of(const struct doubling_poles *p, int j)
{
    return p->kind[j] == POLE_PAIR ? p->b[j] : p->kind[j] == POLE_NEGATIVE ? M_PI : 0;
}

bool compressed_holds(const struct compressed *c, const struct doubling_poles *p)
{
    for (int j = 0; j < p->count; j++) {
        bool near = false;
        for (int k = 0; k < c->count && !near; k++)
            near = hypot(p->a[j] - c->a[k], angle_of(p, j) - c->angle[k]) * width_of(c, c->a[k])
                <= REACH;
        if (!near)
            return false;
    }
    return true;
}

/* Blocks long enough for so many columns. */
static void cut_blocks(struct compressed *c, int columns)
{
    int L = c->Y.m, least = (int)sqrt((double)L);

    /* and no fewer rows than sqrt(L): blocks and their number balance */
    least = least > POWERS_WIDE * columns ? least : POWERS_WIDE * columns;
    least = least > POWERS_BLOCK_LEAST ? least : POWERS_BLOCK_LEAST;
    for (c->levels = 0; L >> (c->levels + 1) >= least;)
        c->levels++;
    c->block = L >> c->levels;
    c->left = L - (c->block << c->levels);
}

/* The columns of (1) of one pole, of unit norm; how many. */
static int fill_pole(const struct compressed *c, enum pole_kind kind, double a, double b,
                     double *x)
{
    int B = c->block, n = kind == POLE_PAIR ? 2 : 1;
    double w = width_of(c, a), centre = a > 0 ? B - 1 - w : w;

    powers_of(kind, a, b, B, x, B);
    for (int i = n; i < TERMS * n; i++)
        for (int l = 0; l < B; l++)
            /* (1): powers of a number of order 1 */
            x[l + i * B] = (l - centre) / w * x[l + (i - n) * B];
    for (int i = 0; i < TERMS * n; i++) {
        double norm = cblas_dnrm2(B, x + i * B, 1);
        cblas_dscal(B, norm > 0 ? 1 / norm : 0, x + i * B, 1);
    }
    return TERMS * n;
}

/* Q of N columns in its place. Those that depend on others give directions more, which do no
 * harm. */
static enum modal_status orthonormalise(struct compressed *c, int n, struct modal_error *err)
{
    double *tau = malloc((size_t)n * sizeof *tau);
    int B = c->block;
    bool made;

    c->rows = n < B ? n : B;        /* no more directions than rows */
    made = tau != NULL && LAPACKE_dgeqrf(LAPACK_COL_MAJOR, B, n, c->Q, B, tau) == 0
        && LAPACKE_dorgqr(LAPACK_COL_MAJOR, B, c->rows, c->rows, c->Q, B, tau) == 0;
    free(tau);
    return made ? MODAL_OK
                : modal_fail(err, MODAL_NO_CONVERGENCE, "compressed: QR of %d x %d", B, n);
}

/* Q^T of blocks T .. END of column K; the square of what is left. REST has room for a chunk. */
static double project_blocks(struct compressed *c, int k, int t, int end, double *rest)
{
    int B = c->block, n = c->rows, chunk = POWERS_CHUNK / B > 0 ? POWERS_CHUNK / B : 1;
    const double *y = c->Y.x + (size_t)k * (size_t)c->Y.ld;
    double *z = c->data + (size_t)k * ((size_t)n << c->levels), sum = 0, all, left;

    for (; t < end; t += chunk) {
        int some = end - t < chunk ? end - t : chunk;
        const double *from = y + (size_t)t * (size_t)B;
        double *to = z + (size_t)t * (size_t)n;
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, n, some, B, 1, c->Q, B, from, B, 0,
                    to, n);
        all = cblas_ddot(some * B, from, 1, from, 1);
        left = all - cblas_ddot(some * n, to, 1, to, 1);
        if (left < CANCELS * all) {
            memcpy(rest, from, (size_t)some * (size_t)B * sizeof *rest);
            cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, B, some, n, -1, c->Q, B, to, n,
                        1, rest, B);
            left = cblas_ddot(some * B, rest, 1, rest, 1);
        }
        sum += left;
    }
    return sum;
}

/* Room for N columns, about COUNT poles. */
static bool make_room(struct compressed *c, int n, int count)
{
    free(c->Q), free(c->data), free(c->a);
    c->Q = malloc((size_t)c->block * (size_t)n * sizeof *c->Q);
    c->data = malloc(((size_t)n << c->levels) * (size_t)c->Y.n * sizeof *c->data);
    c->a = malloc(2 * (size_t)count * sizeof *c->a);
    c->angle = c->a != NULL ? c->a + count : NULL;
    return c->Q != NULL && c->data != NULL && c->a != NULL;
}

enum modal_status compressed_about(struct compressed *c, const struct doubling_poles *p,
                                   struct modal_error *err)
{
    int columns = TERMS * p->order, at = 0;
    double *rest = NULL;
    enum modal_status rc;

    c->count = 0;
    cut_blocks(c, columns);
    if (!make_room(c, columns, p->count)
        || (rest = malloc((size_t)(POWERS_CHUNK + c->block) * sizeof *rest)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "compressed: no memory for %d rows", c->Y.m);
    for (int j = 0; j < p->count; j++)
        at += fill_pole(c, p->kind[j], p->a[j], p->b[j], c->Q + (size_t)at * (size_t)c->block);
    rc = orthonormalise(c, columns, err);
    for (int k = 0; k < c->Y.n && rc == MODAL_OK; k++) {
        int half = (1 << c->levels) / 2;
        c->rest[2 * k] = project_blocks(c, k, 0, half, rest);
        c->rest[2 * k + 1] = project_blocks(c, k, half, 1 << c->levels, rest);
    }
    free(rest);
    if (rc != MODAL_OK)
        return rc;
    for (c->count = 0; c->count < p->count; c->count++)
        c->a[c->count] = p->a[c->count], c->angle[c->count] = angle_of(p, c->count);
    return MODAL_OK;
}

struct compressed *compressed_half(const struct compressed *c, bool later)
{
    int first = later ? c->block << (c->levels - 1) : 0;
    struct matrix Y = { later ? c->Y.m - first : c->block << (c->levels - 1), c->Y.n, c->Y.ld,
                        c->Y.x + first };
    struct compressed *h = compressed_new(&Y);
    size_t part;

    if (h == NULL)
        return NULL;
    h->block = c->block, h->levels = c->levels - 1, h->left = later ? c->left : 0;
    if (!make_room(h, c->rows, c->count)) {
        compressed_free(h);
        return NULL;
    }
    h->rows = c->rows, h->count = c->count;
    part = (size_t)h->rows << h->levels;
    memcpy(h->Q, c->Q, (size_t)c->block * (size_t)c->rows * sizeof *h->Q);
    memcpy(h->a, c->a, (size_t)c->count * sizeof *h->a);
    memcpy(h->angle, c->angle, (size_t)c->count * sizeof *h->angle);
    for (int k = 0; k < Y.n; k++) {
        memcpy(h->data + (size_t)k * part, c->data + (2 * (size_t)k + later) * part,
               part * sizeof *h->data);
        h->rest[2 * k + 1] = c->rest[2 * k + later];
    }
    return h;
}
