/* torus_maps.c - see torus_maps.h; tested by tests/unit/modal/steady/test_torus.c
 *
 * The map of one step is what its polynomials make of each unit vector.  That of twice as many is a
 * square: with P = (P_x P_l P_w) of x and v, of levels, which stay, and of waves, which turn by R,
 *
 *     P' = P_x P + (0  P_l  P_w R).                                                             (1)
 *
 * The polynomials' own terms are as linear in u, and where a motion has an event in every few steps
 * they are what a step costs: a second map has them all.
 *
 * A map is a few hundred numbers: it stands by columns of whole blocks of ROWS, which a product
 * sums in registers, for a call of a library costs as much as such a product.
 */
#include "modal/steady/torus_maps.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/lanes.h"
#include "modal/steady/budget.h"

enum {
    ROWS = 2 * LANES,          /* of a block, summed at once */
    NUMBERS_MOST = 1 << 20,    /* of all maps: 8 MB */
    REGIMES_MOST = 256,        /* sets that are kept in mind: looking one up costs less than a
                                * step */
};
static const double TRIED = 2;            /* strides a sample of several steps, about: the longest,
                                           * and where that will not do both its halves */
static const double FASTER = 2;           /* numbers of a map in the time of one of a sparse row's:
                                           * 1.2 a row's save a fifth of a march, 3 nothing */

/* From column to column of a map. */
static size_t ld_of(const struct torus_taylor *t)
{
    return (2 * (size_t)t->n + ROWS - 1) / ROWS * ROWS;
}

/* Numbers of a map. */
static double size_of(const struct torus_taylor *t)
{
    return (double)ld_of(t) * (2.0 * t->n + t->laws + 2.0 * t->waves);
}

/* Rows of a map of polynomials, and from column to column. */
static size_t terms_of(const struct torus_taylor *t)
{
    return ((size_t)(t->terms + 1) * (size_t)t->n + ROWS - 1) / ROWS * ROWS;
}

bool torus_maps_fit(const struct torus_taylor *t, int longest, double count)
{
    return count <= REGIMES_MOST && count * (longest + 1) * size_of(t) <= NUMBERS_MOST;
}

enum modal_status torus_maps_init(struct torus_maps *a, struct torus_taylor *t, int sample,
                                  int longest, struct modal_error *err)
{
    double steps = ldexp(1, sample), strides = sample > 0 ? TRIED : 1;

    *a = (struct torus_maps) { .t = t, .longest = longest,
                               .columns = 2 * t->n + t->laws + 2 * t->waves };
    a->in = workspace_zeros(&a->space, (size_t)a->columns, sizeof *a->in);
    a->out = workspace_zeros(&a->space, ld_of(t) + terms_of(t), sizeof *a->out);
    a->regime = workspace_zeros(&a->space, REGIMES_MOST, sizeof *a->regime);
    a->turn = workspace_zeros(&a->space, 2 * (size_t)t->waves * (size_t)(longest + 1),
                              sizeof *a->turn);
    for (int j = 0; !a->space.failed && j <= longest; j++)
        for (int w = 0; w < t->waves; w++) {
            double phase = t->omega[w] * ldexp(t->h, j), *turn = a->turn + 2 * (j * t->waves + w);

            turn[0] = cos(phase), turn[1] = sin(phase);
        }
    if (strides * size_of(t) * t->columns < steps * torus_taylor_work(t) * BUDGET_DENSE)
        a->most = (int)fmin(NUMBERS_MOST / ((longest + 1) * size_of(t)), REGIMES_MOST);
    if (a->most > 0 && torus_maps_tell_work(a) < FASTER * torus_taylor_work(t) * BUDGET_DENSE)
        a->telling = (int)(NUMBERS_MOST / (terms_of(t) * (size_t)a->columns));
    return workspace_check(&a->space, "torus: no memory for a march", err);
}

void torus_maps_done(struct torus_maps *a) { workspace_free(&a->space); }

void torus_maps_find(struct torus_maps *a, const int *key)
{
    struct torus_regime *r = a->regime;
    size_t wide = (size_t)a->t->laws * sizeof *key;

    a->now = NULL;
    for (int e = 0; e < a->regimes; e++, r++)
        if (memcmp(r->key, key, wide) == 0) {
            a->now = r;
            return;
        }
    if (a->regimes == a->most)
        return;
    r->key = workspace_zeros(&a->space, (size_t)a->t->laws, sizeof *r->key);
    if (r->key == NULL)
        return;
    memcpy(r->key, key, wide);
    a->now = r;
    a->regimes++;
}

/* The map of one step into P, rows of d'' h^2 into BEND and, unless it is NULL, that of polynomials
 * into TERMS, column by column, by the laws' lines now; ONE: as many zeros as columns, and 2 n
 * more. */
static void make_first(struct torus_maps *a, double *P, double *bend, double *terms, double *one)
{
    struct torus_taylor *t = a->t;
    int n = t->n, D = a->columns, columns = t->columns;
    double *level = t->level, leaves = t->leaves;
    size_t ld = ld_of(t);

    t->leaves = 0;                        /* a map serves every step */
    torus_taylor_narrow(t, 1);
    t->level = one + 2 * n;
    for (int j = 0; j < D; j++) {
        one[j] = 1;
        torus_taylor_make(t, one, one + 2 * n + t->laws, one + D);
        one[j] = 0;
        memcpy(P + (size_t)j * ld, one + D, 2 * (size_t)n * sizeof *P);
        for (int l = 0; l < t->laws; l++)
            for (int e = t->see.start[l]; e < t->see.start[l + 1]; e++)
                bend[l * D + j] += 2 * t->see.weight[e] * t->a[2 * n + t->see.dof[e]];
        if (terms != NULL)
            memcpy(terms + (size_t)j * terms_of(t), t->a,
                   (size_t)(t->terms + 1) * (size_t)n * sizeof *terms);
    }
    torus_taylor_narrow(t, columns);
    t->level = level, t->leaves = leaves;
}

/* (1): TO of twice as many steps as P, which is of 2^J. */
static void square(const struct torus_maps *a, int j, const double *P, double *to)
{
    int n = 2 * a->t->n, D = a->columns, laws = a->t->laws, ld = (int)ld_of(a->t);
    const double *turn = a->turn + 2 * j * a->t->waves;

    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, D, n, 1, P, ld, P, ld, 0, to, ld);
    cblas_daxpy(laws * ld, 1, P + n * ld, 1, to + n * ld, 1);
    for (int w = 0; w < a->t->waves; w++) {
        double c = turn[2 * w], s = turn[2 * w + 1];
        const double *from = P + (n + laws + 2 * w) * ld;
        double *at = to + (n + laws + 2 * w) * ld;

        for (int i = 0; i < n; i++) {
            at[i] += c * from[i] + s * from[ld + i];
            at[ld + i] += c * from[ld + i] - s * from[i];
        }
    }
}

/* A->now's maps, of the laws' lines at hand. */
static void make_maps(struct torus_maps *a)
{
    size_t D = (size_t)a->columns, size = ld_of(a->t) * D;
    double *P = workspace_zeros(&a->space, size * (size_t)(a->longest + 1), sizeof *P);
    double *bend = workspace_zeros(&a->space, (size_t)a->t->laws * D, sizeof *bend);
    double *terms = a->telling > 0 ? workspace_zeros(&a->space, terms_of(a->t) * D, sizeof *terms)
                                   : NULL;
    double *one = calloc(D + 2 * (size_t)a->t->n, sizeof *one);

    if (P != NULL && bend != NULL && one != NULL) {
        make_first(a, P, bend, terms, one);
        for (int j = 0; j < a->longest; j++)
            square(a, j, P + (size_t)j * size, P + (size_t)(j + 1) * size);
        a->now->P = P, a->now->bend = bend, a->now->terms = terms;
        a->telling -= terms != NULL;
    }
    free(one);
}

bool torus_maps_has(struct torus_maps *a, bool earned)
{
    if (a->now != NULL && a->now->P == NULL && earned && a->now->steps++ == a->columns)
        make_maps(a);
    return a->now != NULL && a->now->P != NULL;
}

/* OUT = P IN of COUNT columns, LD a column. */
LANES_BODY void product_by(const double *P, size_t ld, int count, const double *in, double *out)
{
    for (size_t i = 0; i < ld; i += ROWS) {
        const double *p = P + i;
        lanes upper = { 0 }, lower = { 0 };

        for (int j = 0; j < count; j++, p += ld) {
            upper += in[j] * *(const lanes *)p;
            lower += in[j] * *(const lanes *)(p + LANES);
        }
        *(lanes *)(out + i) = upper;
        *(lanes *)(out + i + LANES) = lower;
    }
}

LANES_NARROW void product_narrow(const double *P, size_t ld, int count, const double *in,
                                 double *out)
{
    product_by(P, ld, count, in, out);
}

LANES_WIDE void product_wide(const double *P, size_t ld, int count, const double *in, double *out)
{
    product_by(P, ld, count, in, out);
}

/* Column C of P, LD a column, times column C of U with its levels, which waves move if it is the
 * motion, into a->out.  The waves are in a->in. */
static void product(const struct torus_maps *a, const double *P, size_t ld, int c, const double *u)
{
    int n = 2 * a->t->n, laws = a->t->laws, C = a->t->columns;

    for (int i = 0; i < n; i++)
        a->in[i] = u[i * C + c];
    for (int l = 0; l < laws; l++)
        a->in[n + l] = a->t->level[l * C + c];
    (lanes_wide() ? product_wide : product_narrow)(P, ld, c == 0 ? a->columns : n + laws, a->in,
                                                   a->out);
}

/* WAVE where a product has it. */
static void put_waves(const struct torus_maps *a, const double *wave)
{
    memcpy(a->in + 2 * a->t->n + a->t->laws, wave, 2 * (size_t)a->t->waves * sizeof *wave);
}

void torus_maps_stride(const struct torus_maps *a, int j, const double *u, const double *wave,
                       double *to)
{
    int n = 2 * a->t->n, C = a->t->columns;
    size_t ld = ld_of(a->t);

    put_waves(a, wave);
    for (int c = 0; c < C; c++) {
        product(a, a->now->P + (size_t)j * ld * (size_t)a->columns, ld, c, u);
        for (int i = 0; i < n; i++)
            to[i * C + c] = a->out[i];
    }
}

bool torus_maps_tells(const struct torus_maps *a)
{
    return a->now != NULL && a->now->terms != NULL;
}

void torus_maps_tell(const struct torus_maps *a, const double *u, const double *wave)
{
    struct torus_taylor *t = a->t;
    int C = t->columns;

    put_waves(a, wave);
    for (int c = 0; c < C; c++) {
        product(a, a->now->terms, terms_of(t), c, u);
        for (int e = 0; e < (t->terms + 1) * t->n; e++)
            t->a[e * C + c] = a->out[e];
    }
    t->used = t->terms;
}

double torus_maps_bend(const struct torus_maps *a, int l, const double *u, const double *wave)
{
    int n = 2 * a->t->n, C = a->t->columns;
    const double *row = a->now->bend + l * a->columns;
    double sum = 0;

    for (int i = 0; i < n; i++)
        sum += row[i] * u[i * C];
    for (int k = 0; k < a->t->laws; k++)
        sum += row[n + k] * a->t->level[k * C];
    for (int w = 0; w < 2 * a->t->waves; w++)
        sum += row[n + a->t->laws + w] * wave[w];
    return sum;
}

void torus_maps_turn(const struct torus_maps *a, int j, double *wave)
{
    const double *turn = a->turn + 2 * j * a->t->waves;

    for (int w = 0; w < a->t->waves; w++) {
        double *q = wave + 2 * w, c = q[0], s = q[1];

        q[0] = c * turn[2 * w] - s * turn[2 * w + 1];
        q[1] = c * turn[2 * w + 1] + s * turn[2 * w];
    }
}

double torus_maps_work(const struct torus_maps *a) { return size_of(a->t) * a->t->columns; }

double torus_maps_tell_work(const struct torus_maps *a)
{
    return (double)terms_of(a->t) * a->columns * a->t->columns;
}
