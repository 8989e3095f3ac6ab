/*
 * long_rest.c - columns of Y - Phi C, one at a time
 *
 * A column of Phi in a block is that of the first block times one number, so that a column of
 * Phi C, cut into blocks, is the first block's table times one number a pole and block: one
 * product. What is left is asked for all that is wanted of it while it is at hand, in the room
 * that its transform then takes: nothing as large as Y is made. What lies beside a pole is asked
 * of the blocks (compressed.h), which have it all.
 *
 * Parts of the record are its first L, L/4, L/16, ... rows: of the chi-squared that its best
 * number of rows shows of a decay e^{-a l}, A^2 (1 - e^{-a n})^2 / (2 a^2 n), twice or half of them
 * show 0.82. Shorter ones were asked when fewer rows were searched.
 *
 * Poles about the largest ordinate are asked of the sums over blocks of B rows of
 *
 *     e_l e^{-i phi l},   phi = theta - pi / (2 B),                                          (1)
 *
 * theta its angle: a pole e^{lambda l} is one of them too, e^{(lambda - i phi) B t} in block t,
 * that at theta with a quarter of a turn a block, 0.9 of it left; their real and imaginary parts
 * are twice as many signals of few rows, that a pencil takes.
 */
#include "modal/identify/order/long_rest.h"
#include <fftw3.h>
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/compressed.h"
#include "modal/identify/linear/powers.h"
#include "modal/identify/order/periodogram.h"
#include "modal/identify/order/remainder.h"

enum {
    BLOCKS_LEAST = 16,              /* rows of what a pencil is asked of */
    SHORTER = 4                     /* from one part of the record to the next: 0.82 is seen */
};

struct model {
    const struct compressed *blocks;
    const struct refined *fit;
    int n, B, count;             /* columns of the table; rows; blocks and what is left */
    double *table;               /* B x n: a pole's Re and -Im in the first block */
    double *turn;                /* n x blocks: its factor there, Re and Im */
    double *C;                   /* n x S: amplitudes, Re and Im */
    double *unit;                /* per column: 1 / noise, or 0 */
    double *X;                   /* n x blocks: of the column at hand */
    double *x;                   /* rows of the column at hand, then its transform */
    float *power;                /* ordinates of all columns: a threshold needs no more digits */
    double *rest;                /* rows x blocks x S: Q^T of what is left of each block */
    struct matrix tail;          /* left x S: what is left after them */
};

static void model_done(struct model *m)
{
    free(m->table), free(m->turn), free(m->C), free(m->unit), free(m->X), free(m->rest);
    free(m->tail.x);
    fftw_free(m->x), free(m->power);
}

static bool model_new(struct model *m, const struct refine_data *data, const struct refined *fit)
{
    const struct compressed *b = data->blocks;
    size_t n = 2 * (size_t)fit->poles, blocks = ((size_t)1 << b->levels) + 1, S = (size_t)b->Y.n;

    *m = (struct model) { .blocks = b, .fit = fit, .n = (int)n, .B = b->block,
                          .count = (int)blocks };
    m->table = malloc(n * (size_t)b->block * sizeof *m->table);
    m->turn = malloc(n * blocks * sizeof *m->turn), m->C = calloc(n * S, sizeof *m->C);
    m->unit = calloc(S, sizeof *m->unit), m->X = malloc(n * blocks * sizeof *m->X);
    return m->table != NULL && m->turn != NULL && m->C != NULL && m->unit != NULL && m->X != NULL;
}

/* Room for what is left. */
static bool rest_new(struct model *m)
{
    const struct compressed *b = m->blocks;
    size_t S = (size_t)b->Y.n, most = (size_t)periodogram_length(b->Y.m);

    m->rest = malloc(((size_t)b->rows << b->levels) * S * sizeof *m->rest);
    m->tail = (struct matrix) { b->left, b->Y.n, b->left > 0 ? b->left : 1,
                                malloc(((size_t)b->left * S + 1) * sizeof(double)) };
    m->x = fftw_alloc_real(most);
    m->power = malloc((most / 2 + 1) * sizeof *m->power);
    return m->rest != NULL && m->tail.x != NULL && m->x != NULL && m->power != NULL;
}

/* The first block's columns, and what they are turned by in the others. */
static void fill_tables(struct model *m, double tau)
{
    int last = m->blocks->Y.m - 1;

    for (int j = 0; j < m->fit->poles; j++) {
        double complex z = m->fit->lambda[j];
        double a = creal(z) * tau, b = cimag(z) * tau;
        double *re = m->table + (size_t)(2 * j) * (size_t)m->B, *im = re + m->B;
        for (int i = 0; i < m->B; i++) {
            double size = exp(a * i);
            re[i] = size * cos(b * i), im[i] = -size * sin(b * i);
        }
        for (int t = 0; t < m->count; t++) {
            double l = (double)t * m->B, size = exp(a * (l - (a > 0 ? last : 0)));
            /* z^{tB}: block t of a pole's columns is the first one turned and shrunk */
            m->turn[2 * j + t * m->n] = size * cos(b * l);
            m->turn[2 * j + 1 + t * m->n] = size * sin(b * l);
        }
    }
}

/* Amplitudes, and which columns have something left. */
static void take_amplitudes(struct model *m, const struct refine_data *data, struct projected *p)
{
    int S = p->columns;

    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, p->order, S, 1,
                p->R, p->order, p->Z, p->order);
    for (int c = 0; c < S; c++) {
        const double *z = p->Z + (size_t)c * (size_t)p->order;
        for (int j = 0, i = 0; j < m->fit->poles; j++) {
            bool pair = pole_kind(m->fit->lambda[j], data->tau) == POLE_PAIR;
            m->C[2 * j + (size_t)c * (size_t)m->n] = z[i++];
            m->C[2 * j + 1 + (size_t)c * (size_t)m->n] = pair ? z[i++] : 0;
        }
        m->unit[c] = remainder_unit(data, m->fit, p, c);
    }
}

/* The numbers of column C's blocks, so that it is table X. */
static void turn_column(struct model *m, int c)
{
    const double *C = m->C + (size_t)c * (size_t)m->n;

    for (int t = 0; t < m->count; t++)
        for (int j = 0; j < m->n; j += 2) {
            const double *u = m->turn + j + t * m->n;
            m->X[j + t * m->n] = C[j] * u[0] - C[j + 1] * u[1];  /* (b_r + i b_i) z^{tB} */
            m->X[j + 1 + t * m->n] = C[j] * u[1] + C[j + 1] * u[0];
        }
}

/* What is left of column C, over its noise: of its rows, into m->x; of its blocks. */
static void leave_column(struct model *m, int c)
{
    const struct compressed *b = m->blocks;
    const double *y = b->Y.x + (size_t)c * (size_t)b->Y.ld;
    int blocks = m->count - 1, chunk = POWERS_CHUNK / m->B > 0 ? POWERS_CHUNK / m->B : 1, B = m->B;

    turn_column(m, c);
    for (int t = 0; t < blocks; t += chunk) {
        int some = blocks - t < chunk ? blocks - t : chunk;
        double *e = m->x + (size_t)t * (size_t)B;
        memcpy(e, y + (size_t)t * (size_t)B, (size_t)some * (size_t)B * sizeof *e);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, B, some, m->n, -m->unit[c],
                    m->table, B, m->X + (size_t)t * (size_t)m->n, m->n, m->unit[c], e, B);
    }
    if (b->left > 0) {
        double *e = m->x + (size_t)blocks * (size_t)B;
        memcpy(e, y + (size_t)blocks * (size_t)B, (size_t)b->left * sizeof *e);
        cblas_dgemv(CblasColMajor, CblasNoTrans, b->left, m->n, -m->unit[c], m->table, B,
                    m->X + (size_t)blocks * (size_t)m->n, 1, m->unit[c], e, 1);
        memcpy(m->tail.x + (size_t)c * (size_t)m->tail.ld, e, (size_t)b->left * sizeof *e);
    }
}

/* The same of Q^T of all blocks of all columns. */
static enum modal_status leave_blocks(struct model *m, struct modal_error *err)
{
    const struct compressed *b = m->blocks;
    size_t all = (size_t)b->rows << b->levels;
    double *T = malloc((size_t)b->rows * (size_t)m->n * sizeof *T);

    if (T == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "long_rest: no memory for %d blocks", m->count);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, b->rows, m->n, m->B, 1, b->Q, m->B,
                m->table, m->B, 0, T, b->rows);
    memcpy(m->rest, b->data, all * (size_t)b->Y.n * sizeof *T);
    for (int c = 0; c < b->Y.n; c++) {
        turn_column(m, c);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, b->rows, m->count - 1, m->n,
                    -m->unit[c], T, b->rows, m->X, m->n, m->unit[c], m->rest + (size_t)c * all,
                    b->rows);
    }
    free(T);
    return MODAL_OK;
}

/* Lines in the first ROWS of all columns; the colour of all of them. */
static enum modal_status look_at_rows(struct model *m, int rows, struct long_rest *out,
                                      struct modal_error *err)
{
    int L = m->blocks->Y.m, n = periodogram_length(rows), count;
    struct periodogram *p = NULL;
    enum modal_status rc = periodogram_new(rows, m->x, &p, err);

    if (rc != MODAL_OK)
        return rc;
    count = periodogram_count(p);
    memset(m->power, 0, (size_t)count * sizeof *m->power);
    for (int c = 0; c < m->blocks->Y.n && rc == MODAL_OK; c++) {
        leave_column(m, c);
        if (rows == L)
            rc = colour_add(m->x, L, &out->colour, err);
        if (m->unit[c] == 0)
            continue;
        memset(m->x + rows, 0, (size_t)(n - rows) * sizeof *m->x);
        periodogram_add(p, 1.0 / rows, m->power);
    }
    for (int k = 0; k < count && rc == MODAL_OK; k++)
        /* unit variance: twice an ordinate is chi-squared of two numbers a column */
        if (2 * m->power[k] > out->chi2)
            out->chi2 = 2 * m->power[k], out->angle = periodogram_angle(p, k), out->rows = rows;
    periodogram_free(p);
    return rc;
}

static enum modal_status look(struct model *m, const struct refine_data *data, int seen,
                              struct long_rest *out, struct modal_error *err)
{
    int L = m->blocks->Y.m;
    size_t all = (size_t)m->blocks->rows << m->blocks->levels;
    struct matrix E = { (int)all, m->blocks->Y.n, (int)all, m->rest };
    enum modal_status rc = leave_blocks(m, err);

    if (rc == MODAL_OK)
        rc = colour_spread_of(&E, &out->spread, err);
    for (int n = L; rc == MODAL_OK && (n == L || n / 2 >= seen) && n >= SHORTER; n /= SHORTER)
        rc = look_at_rows(m, n, out, err);
    for (int j = 0; j < m->fit->poles && rc == MODAL_OK; j++)
        if (pole_kind(m->fit->lambda[j], data->tau) == POLE_PAIR)
            rc = remainder_split_blocks(m->blocks, m->rest, &m->tail, data->tau, m->fit->lambda[j],
                                        &out->beside[j], err);
    return rc;
}

/* Amplitudes and tables of what FIT says of DATA; *known: poles that coincide say nothing. */
static enum modal_status model_fit(struct model *m, const struct refine_data *data,
                                   const struct refined *fit, bool *known,
                                   struct modal_error *err)
{
    struct projected p = { 0 };
    enum modal_status rc = refine_project(data, fit->lambda, fit->poles, NULL, &p, err);

    *known = !p.degenerate;
    if (rc == MODAL_OK && *known && !model_new(m, data, fit))
        rc = modal_fail(err, MODAL_NO_MEMORY, "long_rest: no memory for %d poles", fit->poles);
    if (rc == MODAL_OK && *known) {
        fill_tables(m, data->tau);
        take_amplitudes(m, data, &p);
    }
    projected_done(&p);
    return rc;
}

enum modal_status long_rest_look(const struct refine_data *data, const struct refined *fit,
                                 int seen, struct long_rest *out, struct modal_error *err)
{
    struct model m = { 0 };
    enum modal_status rc;

    *out = (struct long_rest) { .chi2 = 0 };
    rc = model_fit(&m, data, fit, &out->known, err);
    if (rc != MODAL_OK || !out->known)
        goto out;
    out->beside = calloc((size_t)fit->poles, sizeof *out->beside);
    if (!rest_new(&m) || out->beside == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "long_rest: no memory for %d rows", data->Y->m);
        goto out;
    }
    rc = look(&m, data, seen, out, err);
out:
    model_done(&m);
    if (rc != MODAL_OK)
        long_rest_done(out);
    return rc;
}

/* Column C of the rest times e^{-i angle l}, added up block by block: Re and Im, of COUNT blocks.
 * W: the first block's turns; T: those times the table. */
static void shift_column(struct model *m, int c, double angle, const double *W, const double *T,
                         struct matrix *D)
{
    const double *y = m->blocks->Y.x + (size_t)c * (size_t)m->blocks->Y.ld;
    double *re = D->x + (size_t)(2 * c) * (size_t)D->ld, *im = re + D->ld, z[2];

    turn_column(m, c);
    for (int t = 0; t < D->m; t++) {
        const double *X = m->X + (size_t)t * (size_t)m->n;
        double turn = fmod(angle * m->B, 2 * M_PI) * t, co = cos(turn), si = sin(turn);
        cblas_dgemv(CblasColMajor, CblasTrans, m->B, 2, m->unit[c], W, m->B,
                    y + (size_t)t * (size_t)m->B, 1, 0, z, 1);
        cblas_dgemv(CblasColMajor, CblasNoTrans, 2, m->n, -m->unit[c], T, 2, X, 1, 1, z, 1);
        re[t] = z[0] * co + z[1] * si, im[t] = z[1] * co - z[0] * si;
    }
}

/* The rest about ANGLE, a row a block. */
static enum modal_status shift_rest(struct model *m, double angle, struct matrix *D,
                                    struct modal_error *err)
{
    size_t B = (size_t)m->B, n = (size_t)m->n;
    double *W = malloc(2 * (B + n) * sizeof *W), *T = W + 2 * B;

    if (W == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "long_rest: no memory for %d blocks", D->m);
    for (int i = 0; i < m->B; i++)
        W[i] = cos(angle * i), W[i + m->B] = -sin(angle * i);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, 2, m->n, m->B, 1, W, m->B, m->table, m->B,
                0, T, 2);
    for (int c = 0; c < m->blocks->Y.n; c++)
        shift_column(m, c, angle, W, T, D);
    free(W);
    return MODAL_OK;
}

enum modal_status long_rest_poles(const struct refine_data *data, const struct refined *fit,
                                  const struct long_rest *rest, int most, double complex *lambda,
                                  int *count, struct modal_error *err)
{
    struct model m = { 0 };
    struct matrix D = { 0 };
    double angle = 0, step = 0;
    bool known;
    int found = 0;
    enum modal_status rc = model_fit(&m, data, fit, &known, err);

    *count = 0;
    if (rc != MODAL_OK || !known || (D.m = rest->rows / m.B) < BLOCKS_LEAST)
        goto out;
    D.n = 2 * data->Y->n, D.ld = D.m;
    D.x = malloc(sizeof *D.x * (size_t)D.ld * (size_t)D.n);
    if (D.x == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "long_rest: no memory for %d blocks", D.m);
        goto out;
    }
    step = data->tau * m.B, angle = rest->angle - M_PI_2 / m.B;  /* (1) */
    rc = shift_rest(&m, angle, &D, err);
    if (rc == MODAL_OK)
        rc = remainder_poles(&D, step, most, lambda, &found, err);
    for (int j = 0; j < found && rc == MODAL_OK; j++) {
        double theta = angle + cimag(lambda[j]) * data->tau;
        if (pole_kind(lambda[j], step) == POLE_PAIR && theta > 0 && theta < M_PI)
            lambda[(*count)++] = CMPLX(creal(lambda[j]), theta / data->tau);
    }
out:
    free(D.x);
    model_done(&m);
    return rc;
}

void long_rest_done(struct long_rest *r)
{
    free(r->colour.power), free(r->beside);
    *r = (struct long_rest) { 0 };
}
