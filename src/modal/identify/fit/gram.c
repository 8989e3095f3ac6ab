/*
 * gram.c - variable projection for many poles by sums in closed form
 *
 * Every inner product of two columns of [Phi D] (refine.c) is made of
 *
 *     M_p(x) = sum_{l=0..L-1} l^p e^{x l},   p = 0, 1, 2,                                  (1)
 *
 * at x = z_j + z_k and z_j + conj z_k, z = a + i b: no row is read for them. With e = e^x - 1,
 *
 *     M_0 = (e^{Lx} - 1) / e,   M_1 = (L e^{Lx} - M_0 e^x) / e,
 *     M_2 = (L^2 e^{Lx} - (2 M_1 + M_0) e^x) / e,                                          (2)
 *
 * which cancel where |L x| is small; there the series of e^{x r} about the middle of the record
 * is summed, |x r| < 1. Cholesky's factor of these sums is R of the QR, known to the square of
 * its condition: COLUMN_LEAST keeps that below 1e-6 of the standard errors.
 *
 * The data are read by blocks of B rows. Within block t column j is the first block's times one
 * number, so that Phi^T Y is one product of a B x 2 count table with all blocks, turned and
 * added; Phi C likewise. Amplitudes come from the normal equations, what they leave is made row
 * by row, and projected again, which corrects them: residuals and gradient are as good as those
 * of a QR, whatever the sums lost [B87].
 *
 * The step's normal matrix, sum_c w_c^2 K_c^T (R22^T R22) K_c, takes the products of amplitudes
 * of all channels, C C^T, entry by entry: no rows for each channel. So an evaluation costs about
 * 4 L order S + 4 order^3.
 *
 * Poles that move together, the many lines of few multipliers, tell their parameters by sums of
 * derivatives, of which one alone may be next to nothing beside all others' columns: there R22 is
 * Cholesky's factor with pivots, of the rank that rounding leaves, and COLUMN_LEAST is asked of
 * the sums instead.
 *
 * [B87] Bjorck, Linear Algebra Appl. 88/89 (1987) 31-48: corrected seminormal equations.
 */
#include "modal/identify/fit/gram.h"
#include <cblas.h>
#include <complex.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Fewer columns than this cost little either way, and a QR serves exact data too. */
enum { ORDER_LEAST = 64 };
enum {
    TERMS = 20                      /* of the series: the next is (SERIES / 2)^20 / 20!, 4e-19 */
};
static const double COLUMN_LEAST = 1e-5;     /* of a column, that no other explains */
static const double REST_LEAST = 1e-9;       /* of a signal, left: below, the QR tells more */
static const double SERIES = 2;              /* |L x| up to which (2) is not used */

struct gram {
    int L, count, order, K;
    int block, blocks;                       /* the last one may be shorter */
    bool look;                               /* Phi alone, K = order columns; else 2 order */
    double *a, *b, *centre;                  /* of the poles that were factored */
    int *first_column;
    bool *pair;
    double power[TERMS + 4];                 /* sums of (r / (L/2))^n about the middle */
    double *table;                           /* block x 4 count: Re z^i, -Im z^i; i times these */
    double complex *start;                   /* count x blocks: the column at a block's first row */
    double *product;                         /* 4 count x blocks */
    double *rest;                            /* L */
    double *normal;                          /* 2 order x 2 order */
    bool together;                           /* some poles share their parameters */
    bool pivoted;                            /* R22 is not a triangle: by pivots, of rank rows */
    int rank, *pivot;
    double *scale;                           /* of the derivatives' columns, before Phi was taken */
};

double gram_work(int L, int order, int S)
{
    return 4.0 * order * ((double)L * S + (double)order * order);
}

bool gram_pays(int L, int order, int S)
{
    double wide = 2.0 * order + S;

    return order >= ORDER_LEAST && 2 * order < L && 2 * gram_work(L, order, S) < L * wide * wide;
}

/* sum (r / (L/2))^n over the rows, r from the middle. */
static void power_sums(struct gram *g)
{
    memset(g->power, 0, sizeof g->power);
    for (int l = 0; l < g->L; l++) {
        double r = (2.0 * l - (g->L - 1)) / g->L, x = 1;
        for (int n = 0; n < TERMS + 3; n += 2, x *= r * r)
            g->power[n] += x;
    }
}

struct gram *gram_new(int L, int count, int order, bool together)
{
    struct gram *g = calloc(1, sizeof *g);
    size_t N = (size_t)count, blocks;
    int root = (int)sqrt((double)L);

    if (g == NULL)
        return NULL;
    g->L = L, g->count = count, g->order = order, g->together = together;
    /* sqrt(L) rows make the table and the starts as long: least memory, and products of level 3 */
    g->block = root > POWERS_BLOCK_LEAST ? root : POWERS_BLOCK_LEAST;
    g->block = g->block < L ? g->block : L;
    g->blocks = (L + g->block - 1) / g->block;
    blocks = (size_t)g->blocks;
    g->a = calloc(3 * N, sizeof *g->a), g->b = g->a + N, g->centre = g->b + N;
    g->first_column = calloc(N, sizeof *g->first_column), g->pair = calloc(N, sizeof *g->pair);
    g->table = malloc((size_t)g->block * 4 * N * sizeof *g->table);
    g->start = malloc(N * blocks * sizeof *g->start);
    g->product = malloc(4 * N * blocks * sizeof *g->product);
    g->rest = malloc((size_t)L * sizeof *g->rest);
    g->normal = malloc(4 * (size_t)order * (size_t)order * sizeof *g->normal);
    g->pivot = malloc((size_t)order * sizeof *g->pivot);
    g->scale = malloc(3 * (size_t)order * sizeof *g->scale);
    if (g->a == NULL || g->first_column == NULL || g->pair == NULL || g->table == NULL
        || g->start == NULL || g->product == NULL || g->rest == NULL || g->normal == NULL
        || g->pivot == NULL || g->scale == NULL) {
        gram_free(g);
        return NULL;
    }
    power_sums(g);
    return g;
}

void gram_free(struct gram *g)
{
    if (g == NULL)
        return;
    free(g->a), free(g->first_column), free(g->pair), free(g->table), free(g->start);
    free(g->product), free(g->rest), free(g->normal), free(g->pivot), free(g->scale);
    free(g);
}

/* ---- (1) ---- */

/* (1) by the series about the middle. */
static void moments_near(const struct gram *g, double complex x, double complex M[3])
{
    double h = 0.5 * g->L, c = 0.5 * (g->L - 1);
    double complex N[3] = { 0 }, term = 1, middle = cexp(x * c);

    for (int m = 0; m < TERMS; m++) {
        for (int p = 0; p < 3; p++)
            N[p] += term * g->power[m + p];
        term *= x * h / (m + 1);
    }
    N[1] *= h, N[2] *= h * h;
    M[0] = middle * N[0];
    M[1] = middle * (N[1] + c * N[0]);
    M[2] = middle * (N[2] + 2 * c * N[1] + c * c * N[0]);
}

/* (1), Re x <= 0. */
static void moments_of(const struct gram *g, double complex x, double complex M[3])
{
    double L = g->L;
    double complex e, ex, last;

    if (cabs(x) * L < SERIES) {
        moments_near(g, x, M);
        return;
    }
    e = powers_grown(x), ex = 1 + e, last = cexp(L * x);
    M[0] = powers_grown(L * x) / e;        /* (2) */
    M[1] = (L * last - M[0] * ex) / e;
    M[2] = (L * L * last - (2 * M[1] + M[0]) * ex) / e;
}

/* (1) times e^scale; what grows is summed from its end. */
static void moments(const struct gram *g, double re, double im, double scale,
                    double complex M[3])
{
    double last = g->L - 1;
    double complex f, N[3];

    im = remainder(im, 2 * M_PI);   /* z^l has the same values, and e^x - 1 loses no digits */
    if (re <= 0) {
        moments_of(g, CMPLX(re, im), M);
        for (int p = 0; p < 3; p++)
            M[p] *= exp(scale);
        return;
    }
    moments_of(g, CMPLX(-re, -im), N);
    /* l -> L - 1 - l: (1) of -x, shifted by the last row */
    f = cexp(CMPLX(re * last + scale, im * last));
    M[0] = f * N[0];
    M[1] = f * (last * N[0] - N[1]);
    M[2] = f * (last * last * N[0] - 2 * last * N[1] + N[2]);
}

/* ---- the factor ---- */

/* The products of poles j and k, from A = sum u_j conj u_k and B = sum u_j u_k, columns being Re u
 * and -Im u, at (row, col) of the normal matrix. */
static void put(struct gram *g, int j, int k, int row, int col, double complex A,
                double complex B)
{
    int ld = g->K;
    double *N = g->normal + row + (size_t)col * (size_t)ld;

    N[0] = 0.5 * (creal(A) + creal(B));
    if (g->pair[k])
        N[ld] = 0.5 * (cimag(A) - cimag(B));
    if (g->pair[j])
        N[1] = -0.5 * (cimag(A) + cimag(B));
    if (g->pair[j] && g->pair[k])
        N[1 + ld] = 0.5 * (creal(A) - creal(B));
}

/* All products of poles j <= k; the triangle below is not read. */
static void products(struct gram *g, int j, int k)
{
    int q = g->order, cj = g->first_column[j], ck = g->first_column[k];
    double last = g->L - 1, scale = -last * (fmax(g->a[j], 0) + fmax(g->a[k], 0));
    double mj = g->centre[j], mk = g->centre[k];
    double complex A[3], B[3];

    moments(g, g->a[j] + g->a[k], g->b[j] - g->b[k], scale, A);
    moments(g, g->a[j] + g->a[k], g->b[j] + g->b[k], scale, B);
    put(g, j, k, cj, ck, A[0], B[0]);
    if (g->look)
        return;
    put(g, j, k, cj, q + ck, A[1] - mk * A[0], B[1] - mk * B[0]);
    put(g, j, k, q + cj, q + ck, A[2] - (mj + mk) * A[1] + mj * mk * A[0],
        B[2] - (mj + mk) * B[1] + mj * mk * B[0]);
    if (j != k)
        put(g, k, j, ck, q + cj, conj(A[1]) - mj * conj(A[0]), B[1] - mj * B[0]);
}

static void take_poles(struct gram *g, const struct doubling_poles *p)
{
    for (int j = 0; j < g->count; j++) {
        double a = p->a[j];
        g->a[j] = a;
        g->b[j] = p->kind[j] == POLE_PAIR ? p->b[j] : p->kind[j] == POLE_NEGATIVE ? M_PI : 0;
        g->pair[j] = p->kind[j] == POLE_PAIR;
        g->first_column[j] = p->column[j];
        g->centre[j] = powers_centre(a, g->L);
    }
}

/* Powers within a block, and where each block begins. */
static void fill_tables(struct gram *g)
{
    int B = g->block, n = g->count;

    for (int j = 0; j < n; j++) {
        double a = g->a[j], b = g->b[j];
        double *re = g->table + (size_t)(2 * j) * (size_t)B, *im = re + B,
            *later = re + (size_t)(2 * n) * (size_t)B;
        for (int i = 0; i < B; i++) {
            double size = exp(a * i);
            re[i] = size * cos(b * i), im[i] = -size * sin(b * i);
            later[i] = i * re[i], later[i + B] = i * im[i];
        }
        for (int t = 0; t < g->blocks; t++) {
            double l = (double)t * B, size = exp(a * (l - (a > 0 ? g->L - 1 : 0)));
            g->start[j + (size_t)t * (size_t)n] = CMPLX(size * cos(b * l), size * sin(b * l));
        }
    }
}

/* The triangle of the first N columns, in place; false: some depends on those before it. */
static bool factor_first(struct gram *g, int n, const double *norm)
{
    bool well = LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'U', n, g->normal, g->K) == 0;

    for (int j = 0; j < n && well; j++)  /* the sine of its angle to those before */
        well = g->normal[j + (size_t)j * (size_t)g->K] > COLUMN_LEAST * norm[j];
    return well;
}

/* R22 with pivots: by its columns where they were R22^T R22 is what Phi leaves of the derivatives'
 * sums of squares, but for their rounding (a tolerance below 0 is LAPACK's, order x epsilon). */
static bool factor_pivoted(struct gram *g)
{
    int q = g->order, K = g->K;
    double *A = g->normal + q + (size_t)q * (size_t)K, *room = g->scale + q;

    for (int j = 0; j < q; j++)
        for (int i = 0; i <= j; i++)
            A[i + (size_t)j * (size_t)K] /= g->scale[i] * g->scale[j];
    if (LAPACKE_dpstrf_work(LAPACK_COL_MAJOR, 'U', q, A, K, g->pivot, &g->rank,
                            -1, room) < 0)
        return false;
    for (int j = 0; j < q; j++)
        for (int i = (j < g->rank ? j + 1 : g->rank); i < q; i++)
            A[i + (size_t)j * (size_t)K] = 0;
    return g->rank > 0;
}

/* R of the sums; false: sums do not tell enough. */
static bool factor(struct gram *g, const double *norm)
{
    int q = g->order, K = g->K;
    double *right = g->normal + (size_t)q * (size_t)K;

    g->pivoted = g->together && !g->look;
    if (!factor_first(g, g->pivoted ? q : K, norm))
        return false;
    if (!g->pivoted)
        return true;
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasTrans, CblasNonUnit, q, q, 1, g->normal,
                K, right, K);
    cblas_dsyrk(CblasColMajor, CblasUpper, CblasTrans, q, q, -1, right, K, 1, right + q, K);
    memcpy(g->scale, norm + q, (size_t)q * sizeof *norm);
    return factor_pivoted(g);
}

bool gram_factor(struct gram *g, const struct doubling_poles *poles, bool look, double *R)
{
    int K = look ? g->order : 2 * g->order;
    double *norm = g->product;                          /* K <= 4 count numbers, until projecting */

    g->look = look, g->K = K;
    take_poles(g, poles);
    fill_tables(g);
    for (int k = 0; k < g->count; k++)
        for (int j = 0; j <= k; j++)
            products(g, j, k);
    for (int j = 0; j < K; j++)
        norm[j] = sqrt(g->normal[j + (size_t)j * (size_t)K]);
    if (!factor(g, norm))
        return false;
    for (int j = 0; j < K; j++) {
        const double *from = g->normal + (size_t)j * (size_t)K;
        double *to = R + (size_t)j * (size_t)K;
        memcpy(to, from, (size_t)(j + 1) * sizeof *to);
        memset(to + j + 1, 0, (size_t)(K - 1 - j) * sizeof *to);
    }
    return true;
}

/* ---- data ---- */

/* sum += what the projected blocks of one column say of pole j; *late of its derivative. */
static void turn(const struct gram *g, int j, bool derivatives, double complex *sum,
                 double complex *late)
{
    int n = g->count, rows = derivatives ? 4 * n : 2 * n;

    for (int t = 0; t < g->blocks; t++) {
        const double *p = g->product + (size_t)t * (size_t)rows + 2 * j;
        double complex u = g->start[j + (size_t)t * (size_t)n], h = CMPLX(p[0], -p[1]);
        *sum += u * h;
        if (derivatives)
            /* l = t B + i */
            *late += u * ((double)t * g->block * h + CMPLX(p[2 * n], -p[2 * n + 1]));
    }
}

/* out = Phi^T y, or [Phi D]^T y. */
static void project(struct gram *g, const double *y, bool derivatives, double *out)
{
    int n = g->count, B = g->block, rows = derivatives ? 4 * n : 2 * n, whole = g->L / B,
        left = g->L - whole * B;

    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, rows, whole, B, 1, g->table, B, y, B, 0,
                g->product, rows);
    if (left > 0)
        cblas_dgemv(CblasColMajor, CblasTrans, left, rows, 1, g->table, B, y + (size_t)whole * B,
                    1, 0, g->product + (size_t)whole * (size_t)rows, 1);
    for (int j = 0; j < n; j++) {
        double complex sum = 0, late = 0;
        int c = g->first_column[j];
        turn(g, j, derivatives, &sum, &late);
        late -= g->centre[j] * sum;
        out[c] = creal(sum);
        if (g->pair[j])
            out[c + 1] = -cimag(sum);
        if (derivatives)
            out[g->order + c] = creal(late);
        if (derivatives && g->pair[j])
            out[g->order + c + 1] = -cimag(late);
    }
}

/* g->rest = y - Phi c. */
static void subtract(struct gram *g, const double *y, const double *c)
{
    int n = g->count, B = g->block, whole = g->L / B, left = g->L - whole * B;

    for (int t = 0; t < g->blocks; t++)
        for (int j = 0; j < n; j++) {
            int i = g->first_column[j];
            double complex x = CMPLX(c[i], g->pair[j] ? c[i + 1] : 0)
                             * g->start[j + (size_t)t * (size_t)n];
            double *p = g->product + (size_t)t * (size_t)(2 * n) + 2 * j;
            p[0] = creal(x), p[1] = cimag(x);
        }
    memcpy(g->rest, y, (size_t)g->L * sizeof *y);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, B, whole, 2 * n, -1, g->table, B,
                g->product, 2 * n, 1, g->rest, B);
    if (left > 0)
        cblas_dgemv(CblasColMajor, CblasNoTrans, left, 2 * n, -1, g->table, B,
                    g->product + (size_t)whole * (size_t)(2 * n), 1, 1,
                    g->rest + (size_t)whole * B, 1);
}

static void solve(const double *R, int K, int q, CBLAS_TRANSPOSE how, double *x, int ld, int S)
{
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, how, CblasNonUnit, q, S, 1, R, K, x, ld);
}

/* Z2 of D^T of what is left, in place: R22^{-T} of its part outside Phi, Z1. */
static void solve_derivatives(const struct gram *g, const double *R, double *Z, int S)
{
    int q = g->order, K = g->K;
    const double *R12 = R + (size_t)q * (size_t)K, *R22 = R12 + q;

    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, q, S, q, -1, R12, K, Z, K, 1, Z + q, K);
    for (int c = 0; c < S; c++) {
        double *z = Z + q + (size_t)c * (size_t)K, *x = g->scale + q;
        for (int j = 0; j < q; j++)
            x[j] = z[g->pivot[j] - 1] / g->scale[g->pivot[j] - 1];
        cblas_dtrsv(CblasColMajor, CblasUpper, CblasTrans, CblasNonUnit, g->rank, R22, K, x, 1);
        memset(z, 0, (size_t)q * sizeof *z);
        memcpy(z, x, (size_t)g->rank * sizeof *z);
    }
}

bool gram_project(struct gram *g, const struct matrix *Y, const double *R, double *C, double *Z,
                  double *rest2)
{
    int q = g->order, K = g->K, S = Y->n;
    bool noisy = true;

    for (int c = 0; c < S; c++)
        project(g, Y->x + (size_t)c * (size_t)Y->ld, false, C + (size_t)c * (size_t)q);
    solve(R, K, q, CblasTrans, C, q, S);
    solve(R, K, q, CblasNoTrans, C, q, S);
    for (int c = 0; c < S; c++) {
        const double *y = Y->x + (size_t)c * (size_t)Y->ld;
        double left, all = cblas_dnrm2(g->L, y, 1);
        subtract(g, y, C + (size_t)c * (size_t)q);
        left = cblas_dnrm2(g->L, g->rest, 1);
        /* amplitudes from sums have half of the digits, and the rest of a fit to rounding none */
        noisy &= all == 0 || left > REST_LEAST * all;
        rest2[c] = left * left;
        project(g, g->rest, !g->look, Z + (size_t)c * (size_t)K);
    }
    solve(R, K, g->pivoted ? q : K, CblasTrans, Z, K, S);
    if (g->pivoted)
        solve_derivatives(g, R, Z, S);
    for (int c = 0; c < S; c++) {                       /* what the sums lost */
        double *z = Z + (size_t)c * (size_t)K, *x = C + (size_t)c * (size_t)q;
        /* what Phi still holds of the rest: the correction of [B87] */
        rest2[c] -= cblas_ddot(q, z, 1, z, 1);
        cblas_dtrsv(CblasColMajor, CblasUpper, CblasNoTrans, CblasNonUnit, q, R, K, z, 1);
        cblas_daxpy(q, 1, z, 1, x, 1);
        memcpy(z, x, (size_t)q * sizeof *z);
        cblas_dtrmv(CblasColMajor, CblasUpper, CblasNoTrans, CblasNonUnit, q, R, K, z, 1);
    }
    return noisy;
}

/* ---- the step ---- */

/* A[row, col] += X, of an entry that its mirror is not added for; of the triangle above only. */
static void add_entry(double *A, int n, int row, int col, double x)
{
    int top = row < col ? row : col, side = row < col ? col : row;

    A[top + (size_t)side * (size_t)n] += x;
}

/* Entries of the normal matrix of poles j <= k: M of their derivatives, W of their amplitudes. */
static void normal_of(const struct gram *g, int j, int k, const double *M, const double *W,
                      const struct gram_parameters *p, double *A)
{
    int q = g->order, i = g->first_column[j], l = g->first_column[k], r = p->first[j],
        s = p->first[k], tj = g->pair[j] ? p->turn[j] : 0, tk = g->pair[k] ? p->turn[k] : 0;
    const double *m = M + i + (size_t)l * (size_t)q, *w = W + i + (size_t)l * (size_t)q;
    bool pj = g->pair[j], pk = g->pair[k];
    double m12 = pk ? m[q] : 0, m21 = pj ? m[1] : 0, m22 = pj && pk ? m[1 + q] : 0;
    double w12 = pk ? w[q] : 0, w21 = pj ? w[1] : 0, w22 = pj && pk ? w[1 + q] : 0;
    /* two poles of one parameter: both orders of them are that entry of the diagonal */
    double both = r == s && j != k ? 2 : 1;

    /* K^T M K by (3) of refine.c, summed over channels in W */
    add_entry(A, p->count, r, s, both * (m[0] * w[0] + m12 * w12 + m21 * w21 + m22 * w22));
    if (tk != 0)
        add_entry(A, p->count, r, s + 1,
                  tk * (m12 * w[0] - m[0] * w12 + m22 * w21 - m21 * w22));
    if (tj != 0 && j != k)
        add_entry(A, p->count, r + 1, s,
                  tj * (m21 * w[0] + m22 * w12 - m[0] * w21 - m12 * w22));
    if (tj != 0 && tk != 0)
        add_entry(A, p->count, r + 1, s + 1,
                  both * tj * tk * (m22 * w[0] - m21 * w12 - m12 * w21 + m[0] * w22));
}

/* Its right-hand side, from V = R22^T Z2. */
static void slope_of(const struct gram *g, int j, const double *C, const double *V, int S,
                     const double *weight, int turn, double *b)
{
    int q = g->order, i = g->first_column[j];

    for (int c = 0; c < S; c++) {
        const double *x = C + i + (size_t)c * (size_t)q, *v = V + i + (size_t)c * (size_t)q;
        double w = weight[c] * weight[c];
        /* K_c^T R22^T Q2^T y_c, K_c of (3) */
        b[0] += w * (x[0] * v[0] + (g->pair[j] ? x[1] * v[1] : 0));
        if (g->pair[j] && turn != 0)
            b[1] += w * turn * (x[0] * v[1] - x[1] * v[0]);
    }
}

/* A, q x N, becomes R22^T A. */
static void times_derivatives(const struct gram *g, const double *R22, double *A, int n)
{
    int q = g->order;

    cblas_dtrmm(CblasColMajor, CblasLeft, CblasUpper, CblasTrans, CblasNonUnit, q, n, 1, R22, g->K,
                A, q);
    for (int c = 0; c < n && g->pivoted; c++) {
        double *x = A + (size_t)c * (size_t)q, *room = g->scale + q;
        memcpy(room, x, (size_t)q * sizeof *x);
        for (int j = 0; j < q; j++)
            x[g->pivot[j] - 1] = room[j] * g->scale[g->pivot[j] - 1];
    }
}

/* R22 with its columns where they were, into M. */
static void derivatives_of(const struct gram *g, const double *R22, double *M)
{
    int q = g->order;

    matrix_copy(q, q, R22, g->K, M, q);
    for (int j = 0; j < q && g->pivoted; j++) {
        int at = g->pivot[j] - 1;
        double *x = M + (size_t)at * (size_t)q;
        memcpy(x, R22 + (size_t)j * (size_t)g->K, (size_t)q * sizeof *x);
        cblas_dscal(q, g->scale[at], x, 1);
    }
}

/* M = R22^T R22, W = C diag(weight)^2 C^T, V = R22^T Z2. */
static void step_products(const struct gram *g, const double *R, const double *C, const double *Z,
                          int S, const double *weight, double *M, double *W, double *V)
{
    int q = g->order, K = g->K;
    const double *R22 = R + q + (size_t)q * (size_t)K;

    derivatives_of(g, R22, M);
    times_derivatives(g, R22, M, q);
    for (int c = 0; c < S; c++)
        for (int i = 0; i < q; i++)
            V[i + (size_t)c * (size_t)q] = weight[c] * C[i + (size_t)c * (size_t)q];
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, q, q, S, 1, V, q, V, q, 0, W, q);
    matrix_copy(q, S, Z + q, K, V, q);
    times_derivatives(g, R22, V, S);
}

/* Do the sums tell every parameter: is what Phi and the parameters before leave of its derivative
 * more than COLUMN_LEAST of it?  Of derivatives that were factored one by one it is. */
static bool tells(const struct gram *g, const double *W, const struct gram_parameters *p,
                  const double *A, double *size)
{
    int q = g->order, n = p->count;
    bool told = true;

    memset(size, 0, (size_t)n * sizeof *size);
    for (int j = 0; j < g->count && g->pivoted; j++) {
        int i = g->first_column[j], r = p->first[j];
        for (int c = i; c < i + (g->pair[j] ? 2 : 1) && r >= 0; c++) {
            double x = W[c + (size_t)c * (size_t)q] * g->scale[c] * g->scale[c];
            size[r] += x;
            if (g->pair[j] && p->turn[j] != 0)
                size[r + 1] += x;
        }
    }
    for (int r = 0; r < n && told; r++) {
        double a = A[r + (size_t)r * (size_t)n];
        told = !g->pivoted || a * a > COLUMN_LEAST * COLUMN_LEAST * size[r];
    }
    return told;
}

bool gram_triangle(struct gram *g, const double *R, const double *C, const double *Z, int S,
                   const double *weight, const struct gram_parameters *p, double *T)
{
    size_t q = (size_t)g->order, n = (size_t)p->count, P = n + 1;
    double *M = calloc(2 * q * q + q * (size_t)S + n * n + n, sizeof *M);
    double *W = M + q * q, *V = W + q * q, *A = V + q * (size_t)S, *b = A + n * n;
    bool definite = M != NULL;

    if (!definite)
        return false;
    step_products(g, R, C, Z, S, weight, M, W, V);
    for (int k = 0; k < g->count; k++) {
        for (int j = 0; j <= k && p->first[k] >= 0; j++)
            if (p->first[j] >= 0)
                normal_of(g, j, k, M, W, p, A);
        if (p->first[k] >= 0)
            slope_of(g, k, C, V, S, weight, p->turn[k], b + p->first[k]);
    }
    definite = LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'U', p->count, A, p->count) == 0
            && tells(g, W, p, A, T);
    memset(T, 0, P * P * sizeof *T);
    for (size_t j = 0; j < n && definite; j++)
        memcpy(T + j * P, A + j * n, (j + 1) * sizeof *T);
    if (definite)
        cblas_dtrsv(CblasColMajor, CblasUpper, CblasTrans, CblasNonUnit, p->count, A, p->count, b,
                    1);
    memcpy(T + n * P, b, n * sizeof *T);
    free(M);
    return definite;
}
