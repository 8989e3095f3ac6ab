/*
 * doubling.c - the QR of a basis of powers by doubling
 *
 * The columns e^{lambda l} and l e^{lambda l}, l = 0 .. N-1, span a space that shifts map to
 * itself.  So rows N .. 2N-1 of the basis are its rows 0 .. N-1 times a small matrix, and with
 * Phi_N for [Phi D] of N rows
 *
 *    Phi_2N = [ Phi_N T1 ; Phi_N T2 ] = diag(Q_N, Q_N) [ R_N T1 ; R_N T2 ],  Phi_N = Q_N R_N,   (1)
 *
 * whose right factor has twice as many rows as columns, however long the record: its QR gives R_2N,
 * and Q_2N = diag(Q_N, Q_N) Q' is never formed.  From blocks of B rows that takes log2(L / B) small
 * factorisations.  Data are projected along: every block of B rows by the one Q_B, neighbours then
 * by Q', and what drops out on the way is orthogonal to the basis and adds up, without
 * cancellation, to the residual.  All is done by reflections, and each column of Phi is represented
 * to the rounding of its own length (Q_N R_N = Phi_N does, whatever the condition of R_N is), so
 * the result is as good as one QR of all rows.
 *
 * With the reference r = a (N-1) of a growing column, 0 of others, that keeps it at most 1, and the
 * centre c of D = (l - c) Phi, T1 and T2 are, for a pair (columns Re, -Im),
 *
 *     T1:  Phi' = s1 Phi,      D' = s1 (D + (c - c') Phi),      s1 = e^{-a N} (a > 0), 1;       (2)
 *     T2:  Phi' = s2 Phi [C -S; S C],  D' = s2 (D + (N + c - c') Phi) [C -S; S C],  s2 = 1 (a > 0),
 *          e^{aN},
 *
 * C = cos bN, S = sin bN.  Rows that are left over, fewer than B, are joined to the last triangle
 * as they are, by T2 of rows of the first block.
 *
 * Where blocks of a record are known by their Q^T (compressed.h) the first one is Q^T Phi, and so
 * are the data: far fewer rows, zeros below them where they are fewer than columns.
 *
 * Against L (columns + S)^2 multiplications this takes 2 L S columns (1 + columns / B).
 */
#include "modal/identify/fit/doubling.h"
#include "modal/linalg/reflect.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    LEVELS_MOST = 31,               /* an int counts rows */
    TABLE = 16,                     /* rows of a block that are made one by one */
    PANEL = 16                      /* columns of the compact form */
};

/* One factorisation: reflectors V, of m rows, whose last `flat` are upper trapezoidal, and T of the
 * compact form.  The first block's stand alone; all others' are those of rows below a triangle. */
struct level { int m, flat; double *V, *T; };

struct doubling {
    int L, n, block, levels, left;      /* L = (block << levels) + left */
    int panel;                          /* columns of a block reflector */
    bool small;                         /* by reflect.h; T of a level is tau then */
    const struct compressed *blocks;    /* borrowed: Q^T of all blocks, for themselves; or NULL */
    int rows;                           /* that a block has: `block`, or those of Q^T and zeros */
    double *table;                      /* block x n: the first block where that is not level[0] */
    struct level
        level[LEVELS_MOST + 2]; /* the first block, `levels` doublings, the rows left over */
    double *head;                       /* left x n: the first rows of the basis */
    double *R;                          /* n x n */
    double *data;                       /* a copy of the columns at hand */
    double *reflect;                    /* workspace of LAPACK */
    double *store;                      /* all of the above */
    int most;
};

/* Blocks long enough that few rows are left over and the small factors weigh little. */
static int block_least(int L, int n)
{
    /* the leaf's factor costs B n^2, the levels n^3 each */
    int root = (int)sqrt((double)L), wide = POWERS_WIDE * n;

    root = root > POWERS_BLOCK_LEAST ? root : POWERS_BLOCK_LEAST;
    return wide > root ? wide : root;
}

static int levels_of(int L, int n)
{
    int levels = 0;

    while (levels < LEVELS_MOST && L >> (levels + 1) >= block_least(L, n))
        levels++;
    return levels;
}

/* Multiplications of S columns of 2^levels blocks of B rows, and of the factors. */
static double cost_of(int levels, double B, int n, int S)
{
    double leaf = (B + B) * n * n + levels * 4.0 * n * n * n;

    return leaf + 2.0 * ldexp(B, levels) * S * n * (1 + 2.0 * n / B);
}

bool doubling_pays(int L, int n, int S)
{
    int levels = levels_of(L, n);

    return n > 0 && levels > 0
        && cost_of(levels, L >> levels, n, S) < (double)L * (n + S) * (n + S);
}

double doubling_cost(const struct doubling *d, int S)
{
    return cost_of(d->levels, d->rows, d->n, S);
}

struct doubling *doubling_new(int L, int n, int most, const struct compressed *blocks)
{
    struct doubling *d = calloc(1, sizeof *d);
    size_t N = (size_t)n, rows, size, table, data;
    double *x;

    if (d == NULL)
        return NULL;
    d->L = L, d->n = n, d->most = most, d->blocks = blocks;
    d->levels = blocks != NULL ? blocks->levels : levels_of(L, n);
    d->block = blocks != NULL ? blocks->block : L >> d->levels;
    d->left = L - (d->block << d->levels);
    d->rows = blocks == NULL ? d->block : blocks->rows > n ? blocks->rows : n;
    d->small = n <= REFLECT_SMALL;
    d->panel = d->small || n < PANEL ? n : PANEL;
    rows = (size_t)d->rows + N * (size_t)d->levels + (size_t)d->left;
    table = blocks != NULL ? (size_t)d->block * N : 0;
    data = (((size_t)d->rows << d->levels) + (size_t)d->left + N) * (size_t)most;
    size = rows * N + (size_t)(d->levels + 2) * (size_t)d->panel * N + (size_t)d->left * N + N * N
         + table + data + (size_t)d->panel * (((size_t)most << d->levels) + N);
    d->store = x = malloc(size * sizeof *x);
    if (x == NULL) {
        free(d);
        return NULL;
    }
    for (int i = 0; i < d->levels + 2; i++) {
        d->level[i].m = i == 0 ? d->rows : i <= d->levels ? n : d->left;
        d->level[i].flat = i > 0 && i <= d->levels ? n - 1 : 0;
        d->level[i].V = x, x += (size_t)d->level[i].m * N;
        d->level[i].T = x, x += (size_t)d->panel * N;
    }
    d->head = x, x += (size_t)d->left * N;
    d->R = x, x += N * N;
    d->table = blocks != NULL ? x : d->level[0].V, x += table;
    d->data = x, x += data;
    d->reflect = x;
    return d;
}

void doubling_free(struct doubling *d)
{
    if (d == NULL)
        return;
    free(d->store);
    free(d);
}

/* e^{i b l} with the phase exact to its rounded b. */
static void turn(double b, double l, double *C, double *S)
{
    /* high + low = b l exactly, low < eps high */
    double high = b * l, low = fma(b, l, -high), c = cos(high), s = sin(high);

    *C = c - low * s, *S = s + low * c;
}

/* y = s (x [C -S; S C]) of a pair's columns, or s C x of a real one's. */
static void turn_columns(const double *x, int ldx, int m, bool pair, double s, double C, double S,
                         double *y, int ldy)
{
    for (int i = 0; i < m; i++) {
        double re = x[i], im = pair ? x[i + ldx] : 0;
        y[i] = s * (C * re + S * im);  /* columns Re and -Im: (re - i im) e^{i b l} */
        if (pair)
            y[i + ldy] = s * (C * im - S * re);
    }
}

/* Column(s) of one pole in the first block: TABLE rows, and from them twice as many, and again. */
static void fill_pole(const struct doubling *d, enum pole_kind kind, double a, double b, double *x)
{
    int B = d->block;
    bool pair = kind == POLE_PAIR;
    double reference = a > 0 ? a * (B - 1) : 0, C = 1, S = 0;

    for (int l = 0; l < TABLE; l++) {
        double e = exp(a * l - reference);
        if (pair)
            turn(b, l, &C, &S);
        x[l] = kind == POLE_NEGATIVE && l % 2 ? -e : e * C;
        if (pair)
            x[B + l] = -e * S;
    }
    for (int l = TABLE; l < B; l *= 2) {
        if (pair)
            turn(b, l, &C, &S);
        /* rows 0 .. l-1 again, l rows on: log2(B) exponentials a pole */
        turn_columns(x, B, l < B - l ? l : B - l, pair, exp(a * l), C, S, x + l, B);
    }
}

static void fill_block(struct doubling *d, const struct doubling_poles *p)
{
    int B = d->block;
    double *V = d->table;

    for (int j = 0; j < p->count; j++) {
        double *x = V + (size_t)p->column[j] * (size_t)B, centre = powers_centre(p->a[j], B);
        fill_pole(d, p->kind[j], p->a[j], p->b[j], x);
        for (int c = 0; d->n > p->order && c < (p->kind[j] == POLE_PAIR ? 2 : 1); c++)
            for (int l = 0; l < B; l++)
                x[l + (size_t)(p->order + c) * (size_t)B] =
                    (l - centre) * x[l + (size_t)c * (size_t)B];
    }
    matrix_copy(d->left, d->n, V, B, d->head, d->left);
    if (d->blocks == NULL)
        return;
    memset(d->level[0].V, 0, (size_t)d->rows * (size_t)d->n * sizeof *V);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, d->blocks->rows, d->n, B, 1,
                d->blocks->Q, B, V, B, 0, d->level[0].V, d->rows);
}

/* (2) of one pole: y (m rows) = x T, for a shift of D's centre by `off`. */
static void shift_pole(const struct doubling_poles *p, int j, bool derivatives, const double *x,
                       int ldx, int m, double s, double C, double S, double off, double *y, int ldy)
{
    bool pair = p->kind[j] == POLE_PAIR;
    size_t at = (size_t)p->column[j], d = at + (size_t)p->order;

    turn_columns(x + at * (size_t)ldx, ldx, m, pair, s, C, S, y + at * (size_t)ldy, ldy);
    if (!derivatives)
        return;
    turn_columns(x + d * (size_t)ldx, ldx, m, pair, s, C, S, y + d * (size_t)ldy, ldy);
    for (int c = 0; c < (pair ? 2 : 1); c++)
        for (int i = 0; i < m; i++)
            y[i + (d + (size_t)c) * (size_t)ldy] += off * y[i + (at + (size_t)c) * (size_t)ldy];
}

/* The rotation of pole j over N rows. */
static void rotation(const struct doubling_poles *p, int j, int N, double *C, double *S)
{
    *C = p->kind[j] == POLE_NEGATIVE && N % 2 ? -1 : 1, *S = 0;
    if (p->kind[j] == POLE_PAIR)
        turn(p->b[j], N, C, S);
}

/* The right factor of (1): T1 on the triangle of N rows, in place, and T2 on x, the m rows of M
 * more whose columns are centred for K rows.  Below the first of them x T2 is upper triangular but
 * for the subdiagonal that a pair's rotation fills. */
static void stack(const struct doubling *d, const struct doubling_poles *p, const double *x, int N,
                  int M, int K, const struct level *to)
{
    bool derivatives = d->n > p->order;

    for (int j = 0; j < p->count; j++) {
        double a = p->a[j], c = powers_centre(a, N + M), C, S;
        rotation(p, j, N, &C, &S);
        shift_pole(p, j, derivatives, x, to->m, to->m, a > 0 ? exp(a * (K - M)) : exp(a * N), C, S,
                   N + powers_centre(a, K) - c, to->V, to->m);
        shift_pole(p, j, derivatives, d->R, d->n, d->n, a > 0 ? exp(-a * M) : 1, 1, 0,
                   powers_centre(a, N) - c, d->R, d->n);
    }
}

static enum modal_status factor_block(struct doubling *d, struct modal_error *err)
{
    const struct level *v = &d->level[0];
    int n = d->n;

    if (d->small) {
        reflect_columns(v->m, n, v->V, v->m, d->reflect);
        reflect_compact(v->m, n, v->V, v->m, d->reflect, v->T);
    } else if (LAPACKE_dgeqrt_work(LAPACK_COL_MAJOR, v->m, n, d->panel, v->V, v->m, v->T, d->panel,
                                   d->reflect)
               != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "doubling: QR of %d x %d", v->m, n);
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++)
            d->R[i + (size_t)j * (size_t)n] = i <= j ? v->V[i + (size_t)j * (size_t)v->m] : 0;
    return MODAL_OK;
}

/* The triangle and the rows of a level below it, to a triangle. */
static enum modal_status factor_level(struct doubling *d, const struct level *v,
                                      struct modal_error *err)
{
    if (d->small)
        reflect_below(v->m, d->n, v->flat, d->R, d->n, v->V, v->m, v->T);
    else if (LAPACKE_dtpqrt_work(LAPACK_COL_MAJOR, v->m, d->n, v->flat, d->panel, d->R, d->n, v->V,
                                 v->m, v->T, d->panel, d->reflect)
             != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "doubling: QR of %d rows below %d", v->m,
                          d->n);
    return MODAL_OK;
}

enum modal_status doubling_factor(struct doubling *d, const struct doubling_poles *p, double *R,
                                  struct modal_error *err)
{
    enum modal_status rc;

    fill_block(d, p);
    rc = factor_block(d, err);
    for (int i = 1; i <= d->levels && rc == MODAL_OK; i++) {
        int N = d->block << (i - 1);
        stack(d, p, d->R, N, N, N, &d->level[i]);
        rc = factor_level(d, &d->level[i], err);
    }
    if (rc == MODAL_OK && d->left > 0) {
        stack(d, p, d->head, d->L - d->left, d->left, d->block, &d->level[d->levels + 1]);
        rc = factor_level(d, &d->level[d->levels + 1], err);
    }
    if (rc == MODAL_OK)
        memcpy(R, d->R, (size_t)d->n * (size_t)d->n * sizeof *R);
    return rc;
}

static enum modal_status apply_block(struct doubling *d, int count, struct modal_error *err)
{
    const struct level *v = &d->level[0];

    if (LAPACKE_dgemqrt_work(LAPACK_COL_MAJOR, 'L', 'T', v->m, count, d->n, d->panel, v->V, v->m,
                             v->T, d->panel, d->data, v->m, d->reflect)
        != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "doubling: reflections of %d x %d", v->m,
                          d->n);
    return MODAL_OK;
}

/* Q^T of a level on COUNT columns of n + m numbers, in place. */
static enum modal_status apply_level(struct doubling *d, const struct level *v, int count,
                                     struct modal_error *err)
{
    int n = d->n;

    if (d->small)
        reflect_below_apply(v->m, n, v->flat, v->V, v->m, v->T, count, d->data, n + v->m,
                            d->data + n, n + v->m);
    else if (LAPACKE_dtpmqrt_work(LAPACK_COL_MAJOR, 'L', 'T', v->m, count, n, v->flat, d->panel,
                                  v->V, v->m, v->T, d->panel, d->data, n + v->m, d->data + n,
                                  n + v->m, d->reflect)
             != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "doubling: reflections of %d rows below %d",
                          v->m, n);
    return MODAL_OK;
}

/* Below row n of S x `each` columns of m rows lies what is orthogonal to the basis: add it up, and
 * close the gaps. */
static void drop_rest(struct doubling *d, int m, int S, int each, double *rest2)
{
    int n = d->n;
    double *to = d->data;

    for (int c = 0; c < S; c++)
        /* each pair of blocks is one at the next level */
        for (int k = 0; k < each; k++, to += n) {
            const double *x = d->data + ((size_t)c * (size_t)each + (size_t)k) * (size_t)m;
            rest2[c] += cblas_ddot(m - n, x + n, 1, x + n, 1);
            memmove(to, x, (size_t)n * sizeof *to);
        }
}

/* The rows left over below the coefficients of those before, last column first: the columns grow.
 * */
static void join_left(struct doubling *d, const struct matrix *Y, int first, int S)
{
    int n = d->n, m = n + d->left;

    for (int c = S - 1; c >= 0; c--) {
        memmove(d->data + (size_t)c * (size_t)m, d->data + (size_t)c * (size_t)n,
                (size_t)n * sizeof *Y->x);
        memcpy(d->data + (size_t)c * (size_t)m + n,
               Y->x + (size_t)(first + c) * (size_t)Y->ld + (d->L - d->left),
               (size_t)d->left * sizeof *Y->x);
    }
}

/* The blocks of columns FIRST, .. into d->data; rest2 begins with what they have no rows of. */
static void load_blocks(struct doubling *d, const struct matrix *Y, int first, int S,
                        double *rest2)
{
    const struct compressed *b = d->blocks;
    size_t rows = (size_t)d->rows, all = rows << d->levels, own;

    memset(rest2, 0, (size_t)S * sizeof *rest2);
    for (int c = 0; c < S && b == NULL; c++)
        memcpy(d->data + (size_t)c * all, Y->x + (size_t)(first + c) * (size_t)Y->ld,
               all * sizeof *Y->x);
    if (b == NULL)
        return;
    own = (size_t)b->rows;
    for (int c = 0; c < S; c++) {
        const double *from = b->data + (size_t)(first + c) * (own << d->levels);
        double *to = d->data + (size_t)c * all;
        for (int t = 0; t < 1 << d->levels; t++, from += own, to += rows) {
            memcpy(to, from, own * sizeof *to);
            memset(to + own, 0, (rows - own) * sizeof *to);
        }
        rest2[c] = b->rest[2 * (first + c)] + b->rest[2 * (first + c) + 1];
    }
}

static enum modal_status project_some(struct doubling *d, const struct matrix *Y, int first, int S,
                                      double *Z, double *rest2, struct modal_error *err)
{
    enum modal_status rc;

    load_blocks(d, Y, first, S, rest2);
    rc = apply_block(d, S << d->levels, err);
    drop_rest(d, d->rows, S, 1 << d->levels, rest2);
    for (int i = 1; i <= d->levels && rc == MODAL_OK; i++) {
        int each = 1 << (d->levels - i);
        rc = apply_level(d, &d->level[i], S * each, err);
        drop_rest(d, 2 * d->n, S, each, rest2);
    }
    if (rc == MODAL_OK && d->left > 0) {
        join_left(d, Y, first, S);
        rc = apply_level(d, &d->level[d->levels + 1], S, err);
        drop_rest(d, d->n + d->left, S, 1, rest2);
    }
    memcpy(Z, d->data, (size_t)d->n * (size_t)S * sizeof *Z);
    return rc;
}

enum modal_status doubling_project(struct doubling *d, const struct matrix *Y, int first, int S,
                                   double *Z, double *rest2, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int c = 0; c < S && rc == MODAL_OK; c += d->most)
        rc = project_some(d, Y, first + c, S - c < d->most ? S - c : d->most,
                          Z + (size_t)c * (size_t)d->n, rest2 + c, err);
    return rc;
}
