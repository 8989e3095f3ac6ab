/*
 * torus_taylor.c - see torus_taylor.h; tested by tests/unit/modal/steady/test_torus.c
 *
 * With K, C and pushes times M^-1 and the powers of h that torus_taylor.h names, (1) there obeys
 *
 *     (k + 1)(k + 2) a_{k+2} = -K a_k - (k + 1) C a_{k+1} - sum_l push_l f_{l,k} + p_k,         (1)
 *     f_{l,k} = gain_l d_{l,k} + level_l [k = 0],
 *
 * p_k of the waves' own series.  As terms fall as (w h)^k / k!, w a bound of the fastest motion,
 * steps of FAST / w need some fifteen.  All products are as sparse as the program, so that a step
 * costs terms times entries, whatever regimes its laws are in.
 *
 * A law that changes at tau_0 leaves what has been as it is and adds to what comes a motion D of
 * its own, which begins at rest and obeys (1) with the new gain, moved by
 *
 *     g(tau) = (level' - level) + (gain' - gain) d(tau)                                         (2)
 *
 * alone.  Each term reaches one neighbour further, and where it is below rounding of the motion it
 * ends: of a chain a change moves some ten dofs within a step, however long the chain is.  D is
 * told about tau_0, and to move it to the step's begin costs each dof the terms' square: where few
 * dofs are beside those that are reached, the whole step is begun anew at tau_0 instead.
 *
 * M^-1 is that of masses on the diagonal.  Of others it is full, but entries far from the diagonal
 * are below rounding and left out.
 */
#include "modal/steady/torus_taylor.h"
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/law.h"
#include "modal/steady/budget.h"

enum { FULL_MOST = 512 };                 /* dofs of masses that are shared: M^-1 is 2 MB */
static const double FAST = 0.5;           /* rad a step of the fastest motion: of two turns in one
                                           * step the cubic through its ends sees both */
static const double ROUNDING = 1e-17;     /* of the motion: what a term is left out at, and */
static const double LEAVES = 1e-8;        /* of the error asked for: all that 8e6 steps leave out,
                                           * 64 a sample for as long as a march's longest memory, is
                                           * a part of it were it alike in all */
static const double BOUND = 1e-16;        /* of the largest entry of a row or of a push: what is
                                           * less is its rounding */

/* Of a number of columns that the compiler is to know: at -O2 it makes no copy of a function for
 * that by itself, and loops over columns take twice as long. */
#define COPIED static inline __attribute__((always_inline))

/* M^-1: of masses on the diagonal N numbers, else N x N by columns. */
struct masses { int n; bool full; double *inverse; };

/* Y += WEIGHT M^-1 e_I. */
static void mass_solve(const struct masses *m, int i, double weight, double *y)
{
    if (!m->full)
        y[i] += weight * m->inverse[i];
    else
        for (int j = 0; j < m->n; j++)
            y[j] += weight * m->inverse[(size_t)i * (size_t)m->n + (size_t)j];
}

/* M^-1 of S's program, its inverse in T's space; *SERVES as torus_taylor_init has it. */
static void invert(struct torus_taylor *t, const struct torus_solver *s, struct masses *m,
                   bool *serves)
{
    const struct sparse *M = &s->p->constant[PROGRAM_M];
    int n = t->n, *pivot = workspace_zeros(&t->space, (size_t)n, sizeof *pivot);

    *m = (struct masses) { .n = n };
    for (int i = 0; i < n; i++)
        for (int e = M->start[i]; e < M->start[i + 1]; e++)
            m->full |= M->index[e] != i;
    *serves = !m->full || n <= FULL_MOST;
    if (!*serves)
        return;
    m->inverse = workspace_numbers(&t->space, (size_t)n, m->full ? (size_t)n : 1);
    if (t->space.failed)
        return;
    if (m->full) {
        struct matrix to = { n, n, n, m->inverse };

        sparse_add_to_dense(M, 1, &to);
        *serves = LAPACKE_dgetrf_work(LAPACK_COL_MAJOR, n, n, to.x, n, pivot) == 0
            && LAPACKE_dgetri(LAPACK_COL_MAJOR, n, to.x, n, pivot) == 0;
    } else
        for (int i = 0; *serves && i < n; i++) {
            *serves = M->start[i + 1] > M->start[i] && M->value[M->start[i]] != 0;
            m->inverse[i] = *serves ? 1 / M->value[M->start[i]] : 0;
        }
}

/* What of the N numbers Y is not rounding into TRIPLETS of row ROW, or none: their count.  Y is 0
 * again. */
static int collect(int n, double *y, int row, struct triplet *triplets)
{
    double most = 0;
    int count = 0;

    for (int j = 0; j < n; j++)
        most = fmax(most, fabs(y[j]));
    for (int j = 0; j < n; j++) {
        if (fabs(y[j]) > BOUND * most) {
            if (triplets != NULL)
                triplets[count] = (struct triplet) { row, j, y[j] };
            count++;
        }
        y[j] = 0;
    }
    return count;
}

/* M^-1 A into OUT, Y being n zeros. */
static enum modal_status times_inverse(struct torus_taylor *t, const struct masses *m,
                                       const struct sparse *A, double *y, struct sparse *out,
                                       struct modal_error *err)
{
    size_t n = (size_t)t->n, most = m->full ? n * n : (size_t)A->start[n];
    struct triplet *all = malloc((most + 1) * sizeof *all);
    int count = 0;
    enum modal_status rc;

    if (all == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a march");
    for (int i = 0; i < t->n; i++) {
        /* row i of the product: rows j of A, each as much as M^-1 has of it */
        int from = m->full ? 0 : i, to = m->full ? t->n - 1 : i;

        for (int j = from; j <= to; j++) {
            double weight = m->inverse[m->full ? (size_t)j * n + (size_t)i : (size_t)i];

            for (int e = A->start[j]; e < A->start[j + 1]; e++)
                y[A->index[e]] += weight * A->value[e];
        }
        count += collect(t->n, y, i, all + count);
    }
    rc = sparse_from_triplets(t->n, t->n, all, count, out, err);
    free(all);
    return rc;
}

/* Room of A for OWNERS and as many entries as ROOM. */
static void ends_room(struct torus_taylor *t, struct torus_ends *a, int owners, size_t room)
{
    a->start = workspace_zeros(&t->space, (size_t)owners + 1, sizeof *a->start);
    a->dof = workspace_room(&t->space, room, sizeof *a->dof);
    a->weight = workspace_room(&t->space, room, sizeof *a->weight);
}

/* The next owner of A, OWNER, has what is not rounding of Y, n numbers, which are 0 again. */
static void ends_add(int n, struct torus_ends *a, int owner, double *y, struct triplet *room)
{
    int from = a->start[owner], count = collect(n, y, owner, room);

    for (int e = 0; e < count; e++) {
        a->dof[from + e] = room[e].j;
        a->weight[from + e] = room[e].value;
    }
    a->start[owner + 1] = from + count;
}

/* Entries that what OWNERS with ENDS ends push has at the most. */
static size_t pushes_most(const struct torus_taylor *t, const struct masses *m, int owners,
                          size_t ends)
{
    return m->full ? (size_t)owners * (size_t)t->n : ends;
}

/* t->see and t->push; Y: n zeros, ROOM: n. */
static void set_laws(struct torus_taylor *t, const struct torus_solver *s, const struct masses *m,
                     double *y, struct triplet *room)
{
    size_t ends = 0;

    for (int l = 0; l < t->laws; l++)
        ends += (size_t)law_ends(&s->p->law[l]);
    ends_room(t, &t->see, t->laws, ends);
    ends_room(t, &t->push, t->laws, pushes_most(t, m, t->laws, ends));
    for (int l = 0; !t->space.failed && l < t->laws; l++) {
        const struct law *law = &s->p->law[l];

        /* what it sees and what it pushes differ by M^-1 alone: a law acts where it looks */
        for (int e = 0; e < law_ends(law); e++)
            y[law->end[e].dof] += law->end[e].weight;
        ends_add(t->n, &t->see, l, y, room);
        for (int e = 0; e < law_ends(law); e++)
            mass_solve(m, law->end[e].dof, law->end[e].weight, y);
        ends_add(t->n, &t->push, l, y, room);
    }
}

/* t->omega and t->pull. */
static void set_loads(struct torus_taylor *t, const struct torus_solver *s, const struct masses *m,
                      double *y, struct triplet *room)
{
    for (int phase = 0; phase < 2; phase++)
        ends_room(t, &t->pull[phase], t->waves,
                  pushes_most(t, m, t->waves, (size_t)s->p->loads));
    t->omega = workspace_zeros(&t->space, (size_t)t->waves, sizeof *t->omega);
    for (int w = 0; !t->space.failed && w < t->waves; w++)
        for (int phase = 0; phase < 2; phase++) {
            for (int a = 0; a < s->p->loads; a++) {
                const struct program_load *load = &s->p->load[a];
                struct torus_index k = { { load->tone[0], load->tone[1], load->tone[2] } };
                bool flipped;

                /* of k and -k one is told, and its sine changes sign with it */
                k = torus_signed(&s->tones, k, &flipped);
                if (torus_group(s, k) != w + 1)
                    continue;
                t->omega[w] = torus_frequency(&s->tones, k);
                mass_solve(m, load->dof,
                           phase == 0 ? load->cosine : flipped ? -load->sine : load->sine, y);
            }
            ends_add(t->n, &t->pull[phase], w, y, room);
        }
}

/*
 * t->fast, of any regimes: of an eigenvalue s^2 x + s C x + K x = 0 says |s|^2 <= |s| |C| + |K|,
 * and so |s| <= |C| + |K|^(1/2), by the largest sum of a row of each; laws hold with their largest
 * gains.  A dof is measured by the root of its M^-1, what equal energies move it by: of lengths and
 * angles together sums have no meaning else.  It is too large for most, which costs a step some
 * terms.  Y: n zeros, and again.
 */
static void set_fast(struct torus_taylor *t, const struct masses *m, const double *steepest,
                     double *y)
{
    double *unit = workspace_room(&t->space, (size_t)t->n, sizeof *unit), damp = 0, most = 0;

    if (unit == NULL)
        return;
    for (int i = 0; i < t->n; i++) {
        double light = fabs(m->inverse[m->full ? (size_t)i * (size_t)(t->n + 1) : (size_t)i]);

        unit[i] = light > 0 ? sqrt(light) : 1;
    }
    for (int i = 0; i < t->n; i++) {
        double sum = 0;

        for (int e = t->K.start[i]; e < t->K.start[i + 1]; e++)
            y[i] += fabs(t->K.value[e]) * unit[t->K.index[e]];
        for (int e = t->C.start[i]; e < t->C.start[i + 1]; e++)
            sum += fabs(t->C.value[e]) * unit[t->C.index[e]];
        damp = fmax(damp, sum / unit[i]);
    }
    for (int l = 0; l < t->laws; l++) {
        double seen = 0;

        for (int e = t->see.start[l]; e < t->see.start[l + 1]; e++)
            seen += fabs(t->see.weight[e]) * unit[t->see.dof[e]];
        for (int e = t->push.start[l]; e < t->push.start[l + 1]; e++)
            y[t->push.dof[e]] += fabs(t->push.weight[e]) * steepest[l] * seen;
    }
    for (int i = 0; i < t->n; i++)
        most = fmax(most, y[i] / unit[i]), y[i] = 0;
    t->fast = sqrt(most) + damp;
}

enum modal_status torus_taylor_init(struct torus_taylor *t, const struct torus_solver *s,
                                    int columns, const double *steepest, bool *serves,
                                    struct modal_error *err)
{
    struct masses m;
    double *y;
    struct triplet *room;
    size_t n = (size_t)s->p->n, wide = (TORUS_TERMS_MOST + 1) * n * (size_t)columns;
    enum modal_status rc = MODAL_OK;

    *t = (struct torus_taylor) { .n = s->p->n, .laws = s->p->laws, .waves = s->groups,
                                 .columns = columns, .h = 1,
                                 .leaves = fmax(LEAVES * torus_target(s), ROUNDING) };
    y = workspace_zeros(&t->space, n, sizeof *y);
    room = workspace_zeros(&t->space, n, sizeof *room);
    t->gain = workspace_zeros(&t->space, (size_t)t->laws, sizeof *t->gain);
    t->level = workspace_zeros(&t->space, (size_t)(t->laws * columns), sizeof *t->level);
    t->a = workspace_zeros(&t->space, wide, sizeof *t->a);
    t->delta = workspace_zeros(&t->space, wide, sizeof *t->delta);
    t->u = workspace_zeros(&t->space, 2 * n * (size_t)columns, sizeof *t->u);
    t->end = workspace_zeros(&t->space, 2 * n * (size_t)columns, sizeof *t->end);
    t->wave = workspace_zeros(&t->space, 2 * (size_t)t->waves, sizeof *t->wave);
    *serves = true;
    if (!t->space.failed)
        invert(t, s, &m, serves);
    if (!t->space.failed && *serves) {
        rc = times_inverse(t, &m, &s->p->constant[PROGRAM_K], y, &t->K, err);
        if (rc == MODAL_OK)
            rc = times_inverse(t, &m, &s->p->constant[PROGRAM_C], y, &t->C, err);
        if (rc != MODAL_OK)
            return rc;
        set_laws(t, s, &m, y, room);
        set_loads(t, s, &m, y, room);
        if (!t->space.failed) {
            set_fast(t, &m, steepest, y);
            torus_taylor_set_reach(t);
        }
    }
    return workspace_check(&t->space, "torus: no memory for a march", err);
}

void torus_taylor_done(struct torus_taylor *t)
{
    sparse_done(&t->K);
    sparse_done(&t->C);
    workspace_free(&t->space);
}

void torus_taylor_narrow(struct torus_taylor *t, int columns) { t->columns = columns; }

/* X, COUNT numbers, times BY: h and its square, which all that a step multiplies with has in it. */
static void scale(double *x, int count, double by)
{
    for (int e = 0; e < count; e++)
        x[e] *= by;
}

bool torus_taylor_set_step(struct torus_taylor *t, double h)
{
    double by = h / t->h, fast = t->fast * h;

    if (fast > FAST)
        return false;
    scale(t->K.value, t->K.start[t->n], by * by);
    scale(t->C.value, t->C.start[t->n], by);
    scale(t->push.weight, t->push.start[t->laws], by * by);
    for (int phase = 0; phase < 2; phase++)
        scale(t->pull[phase].weight, t->pull[phase].start[t->waves], by * by);
    t->h = h;
    for (int w = 0; w < t->waves; w++)
        fast = fmax(fast, t->omega[w] * h);
    /* terms fall as (w h)^k / k!, of the fastest wave too: as many as stand above rounding */
    t->terms = 2;
    for (double left = fast; left > ROUNDING && t->terms < TORUS_TERMS_MOST; t->terms++)
        left *= fast / t->terms;
    return true;
}

/* TO -= FACTOR (row I of A) x, of X's COLUMNS. */
COPIED void take_row(const struct sparse *A, int i, double factor, const double *x, int columns,
                     double *restrict to)
{
    for (int e = A->start[i]; e < A->start[i + 1]; e++) {
        const double *from = x + (size_t)A->index[e] * (size_t)columns;
        double by = factor * A->value[e];

        for (int c = 0; c < columns; c++)
            to[c] -= by * from[c];
    }
}

/* Law L's d in X into D, a number a column. */
COPIED void look(const struct torus_taylor *t, int l, const double *x, int columns,
                 double *restrict d)
{
    for (int c = 0; c < columns; c++)
        d[c] = 0;
    for (int e = t->see.start[l]; e < t->see.start[l + 1]; e++)
        for (int c = 0; c < columns; c++)
            d[c] += t->see.weight[e] * x[t->see.dof[e] * columns + c];
}

/* Term K + 2 of dof I into TO, but for laws and loads: (1). */
COPIED void term_of(const struct torus_taylor *t, const double *a, int k, int i, int columns,
                    double *to)
{
    size_t wide = (size_t)t->n * (size_t)columns;
    double sum[TORUS_WIDE] = { 0 };

    take_row(&t->K, i, 1, a + (size_t)k * wide, columns, sum);
    take_row(&t->C, i, k + 1, a + (size_t)(k + 1) * wide, columns, sum);
    for (int c = 0; c < columns; c++)
        to[c] = sum[c];
}

/* TO -= law L's push times D. */
COPIED void push(const struct torus_taylor *t, int l, const double *restrict d, int columns,
                 double *restrict to)
{
    for (int e = t->push.start[l]; e < t->push.start[l + 1]; e++)
        for (int c = 0; c < columns; c++)
            to[t->push.dof[e] * columns + c] -= t->push.weight[e] * d[c];
}

/* Loads' part of term K + 2 into TO: of wave w the cosine and sine of its phase turn by a quarter
 * a term. */
static void pull(const struct torus_taylor *t, int k, int columns, double *wave, double *to)
{
    for (int w = 0; w < t->waves; w++) {
        double *q = wave + 2 * w, was = q[0], by = t->omega[w] * t->h / (k + 1);

        for (int phase = 0; phase < 2; phase++)
            for (int e = t->pull[phase].start[w]; e < t->pull[phase].start[w + 1]; e++)
                to[t->pull[phase].dof[e] * columns] += t->pull[phase].weight[e] * q[phase];
        q[0] = -by * q[1], q[1] = by * was;
    }
}

/* Whether TERM of each column is less than is left out of SIZE. */
COPIED bool is_faint(const struct torus_taylor *t, const double *term, const double *size,
                     int columns)
{
    bool faint = true;

    for (int i = 0; faint && i < t->n; i++)
        for (int c = 0; c < columns; c++)
            faint = faint && fabs(term[i * columns + c]) <= t->leaves * size[c];
    return faint;
}

/*
 * torus_taylor_make of COLUMNS.  Each term is made of the two before it: where these are faint all
 * that follow are, for steps are short.  The sums of the end are taken along with the terms, which
 * are in the cache then: x is the sum of all, and h x' that of k times term k.
 */
COPIED void make(struct torus_taylor *t, const double *u, const double *wave, int columns,
                 double *restrict to)
{
    int n = t->n, wide = n * columns;
    double q[2 * TORUS_LOADS_MOST], d[TORUS_WIDE], size[TORUS_WIDE] = { 0 }, *a = t->a;
    int faint = 0;

    /* terms 0 and 1 are x and h x' at the begin; the ends' sums have them at once */
    memcpy(q, wave, 2 * (size_t)t->waves * sizeof *q);
    memcpy(a, u, (size_t)wide * sizeof *a);
    for (int e = 0; e < wide; e++)
        a[wide + e] = u[wide + e] * t->h;
    memcpy(to, a, 2 * (size_t)wide * sizeof *to);
    for (int i = 0; i < n; i++)
        for (int c = 0; c < columns; c++) {
            double x = fabs(a[i * columns + c]), v = fabs(a[wide + i * columns + c]);

            size[c] = x > size[c] ? x : size[c];
            size[c] = v > size[c] ? v : size[c];
        }
    for (int e = 0; e < wide; e++)
        to[e] += a[wide + e];
    t->used = t->terms;
    for (int k = 0; k + 2 <= t->used; k++) {
        double *now = a + (size_t)k * (size_t)wide, *next = now + 2 * (size_t)wide;

        /* the right side of (1) of all dofs, then (k + 1)(k + 2) is divided by */
        for (int i = 0; i < n; i++)
            term_of(t, a, k, i, columns, next + i * columns);
        for (int l = 0; l < t->laws; l++) {
            look(t, l, now, columns, d);
            for (int c = 0; c < columns; c++)
                d[c] = t->gain[l] * d[c] + (k == 0 ? t->level[l * columns + c] : 0);
            push(t, l, d, columns, next);
        }
        pull(t, k, columns, q, next);
        for (int e = 0; e < wide; e++) {
            next[e] *= 1.0 / ((k + 1) * (k + 2));
            to[e] += next[e];
            to[wide + e] += (k + 2) * next[e];
        }
        faint = is_faint(t, next, size, columns) ? faint + 1 : 0;
        if (faint == 2)
            t->used = k + 2;
    }
    for (int e = 0; e < wide; e++)
        to[wide + e] *= 1 / t->h;
}

void torus_taylor_begin(struct torus_taylor *t, const double *wave)
{
    t->base = 0;
    memcpy(t->wave, wave, 2 * (size_t)t->waves * sizeof *wave);
}

void torus_taylor_make(struct torus_taylor *t, const double *u, const double *wave, double *to)
{
    torus_taylor_begin(t, wave);
    switch (t->columns) {
    case 1: make(t, u, wave, 1, to); break;
    case TORUS_PAIR: make(t, u, wave, TORUS_PAIR, to); break;
    default: make(t, u, wave, TORUS_WIDE, to);
    }
}

void torus_taylor_sees(const struct torus_taylor *t, int l, int c, double *p)
{
    for (int k = 0; k <= t->used; k++) {
        const double *a = t->a + (size_t)k * (size_t)t->n * (size_t)t->columns + c;

        p[k] = 0;
        for (int e = t->see.start[l]; e < t->see.start[l + 1]; e++)
            p[k] += t->see.weight[e] * a[t->see.dof[e] * t->columns];
    }
}

double torus_taylor_at(const struct torus_taylor *t, const double *p, double tau, double *rate)
{
    double x = p[t->used], v = 0, after = tau - t->base;

    for (int k = t->used - 1; k >= 0; k--) {
        v = v * after + x;
        x = x * after + p[k];
    }
    *rate = v;
    return x;
}

/* COLUMNS polynomials P about 0, term by term, about BY: Horner's scheme again and again. */
COPIED void shift(int terms, double by, int columns, double *p)
{
    for (int j = 0; by != 0 && j < terms; j++)
        for (int k = terms - 1; k >= j; k--) {
            double *restrict to = p + k * columns;
            const double *restrict from = to + columns;

            for (int c = 0; c < columns; c++)
                to[c] += by * from[c];
        }
}

/* Where what has come HOPS far is felt next. */
static int outer_of(const struct torus_reach *r, int hops)
{
    return hops + 1 < r->hops ? hops + 1 : r->hops - 1;
}

/* Term K + 2 of D, which has come HOPS far, G[c] being what moves it; the largest of it a hop
 * further, over SIZE of its column. */
COPIED double change_term(struct torus_taylor *t, int l, int hops, int k, const double *g,
                          const double *size, int C)
{
    const struct torus_reach *r = &t->reach[l];
    int wide = t->n * C, count = r->dofs[outer_of(r, hops)];
    double *now = t->delta + (size_t)k * (size_t)wide, *next = now + 2 * (size_t)wide;
    double d[TORUS_WIDE], most = 0;

    /* (1) of the dofs that may be reached, forces of the laws that see what was: a spring reaches
     * its neighbour within one term, and a law whose ends have not moved is still */
    for (int b = 0; b < count; b++)
        term_of(t, t->delta, k, r->dof[b], C, next + r->dof[b] * C);
    for (int b = 0; b < r->laws[hops]; b++) {
        int m = r->law[b];

        look(t, m, now, C, d);
        for (int c = 0; c < C; c++)
            d[c] = t->gain[m] * d[c] + (m == l ? g[c] : 0);
        push(t, m, d, C, next);
    }
    for (int b = 0; b < count; b++)
        for (int c = 0; c < C; c++) {
            double *at = &next[r->dof[b] * C + c];

            *at *= 1.0 / ((k + 1) * (k + 2));
            if (b >= r->dofs[hops] && fabs(*at) > most * size[c])
                most = fabs(*at) / size[c];
        }
    return most;
}

/* The motion's size where law L reaches, of each column: above 0, for at the start of a march much
 * of a chain is at rest. */
static void sizes(const struct torus_taylor *t, int l, double *size)
{
    const struct torus_reach *r = &t->reach[l];
    int C = t->columns;

    for (int c = 0; c < C; c++)
        size[c] = DBL_MIN;
    for (int b = 0; b < r->dofs[r->hops - 1]; b++)
        for (int c = 0; c < C; c++)
            size[c] = fmax(size[c], fmax(fabs(t->a[r->dof[b] * C + c]),
                                         fabs(t->a[(t->n + r->dof[b]) * C + c])));
}

void torus_taylor_set_line(struct torus_taylor *t, int l, double gain, const double *level)
{
    memcpy(t->level + l * t->columns, level, (size_t)t->columns * sizeof *level);
    t->gain[l] = gain;
}

/* g's terms about TAU, (2), of law L's new gain and level, which it has from here on. */
static void moves_by(struct torus_taylor *t, int l, double tau, double gain, const double *level,
                     double *g)
{
    int C = t->columns;

    for (int c = 0; c < C; c++) {
        double p[TORUS_TERMS_MOST + 1];

        torus_taylor_sees(t, l, c, p);
        shift(t->used, tau - t->base, 1, p);
        for (int k = 0; k <= t->terms; k++)
            g[k * C + c] = (gain - t->gain[l]) * p[k];
        g[c] += level[c] - t->level[l * C + c];
    }
    torus_taylor_set_line(t, l, gain, level);
}

void torus_taylor_stop(struct torus_taylor *t, double tau, double *q)
{
    int wide = t->n * t->columns;
    double *restrict x = t->u, *restrict v = x + wide;
    double after = tau - t->base, per_s = 1 / t->h;

    memcpy(x, t->a + t->used * wide, (size_t)wide * sizeof *x);
    memset(v, 0, (size_t)wide * sizeof *v);
    for (int k = t->used - 1; k >= 0; k--) {
        const double *a = t->a + k * wide;

        for (int e = 0; e < wide; e++) {
            v[e] = v[e] * after + x[e];
            x[e] = x[e] * after + a[e];
        }
    }
    for (int e = 0; e < wide; e++)
        v[e] *= per_s;
    for (int w = 0; w < t->waves; w++) {
        double c = cos(t->omega[w] * t->h * tau), s = sin(t->omega[w] * t->h * tau);

        q[2 * w] = c * t->wave[2 * w] - s * t->wave[2 * w + 1];
        q[2 * w + 1] = s * t->wave[2 * w] + c * t->wave[2 * w + 1];
    }
    t->base = tau;
}

/* (1) from TAU on, about TAU, of C columns, the laws as they are. */
COPIED void begin_anew(struct torus_taylor *t, double tau, int C)
{
    double q[2 * TORUS_LOADS_MOST];

    torus_taylor_stop(t, tau, q);
    make(t, t->u, q, C, t->end);
}

/* D of dof I, from TAU on, to its motion; D is 0 again. */
COPIED void add_change(struct torus_taylor *t, int i, double tau, int C)
{
    size_t wide = (size_t)t->n * (size_t)C;
    double *from = t->delta + i * C, *to = t->a + i * C, p[(TORUS_TERMS_MOST + 1) * TORUS_WIDE];

    for (int k = 0; k <= t->terms; k++, from += wide)
        for (int c = 0; c < C; c++)
            p[k * C + c] = from[c], from[c] = 0;
    /* polynomials of what comes after TAU, told as (1) is, from the step's begin: of no use before,
     * where nobody looks any more */
    shift(t->terms, t->base - tau, C, p);
    for (int k = 0; k <= t->terms; k++, to += wide)
        for (int c = 0; c < C; c++)
            to[c] += p[k * C + c];
}

/* torus_taylor_change of C columns: (2)'s motion term by term, one hop further where what arrived
 * there is more than rounding of the motion at hand, and then added to all that it has reached. */
COPIED int change_by(struct torus_taylor *t, int l, double tau, double gain, const double *level,
                     int C)
{
    const struct torus_reach *r = &t->reach[l];
    int hops = 0;
    double g[(TORUS_TERMS_MOST + 1) * TORUS_WIDE], size[TORUS_WIDE];

    for (; t->used < t->terms; t->used++)          /* D may have all */
        memset(t->a + (size_t)(t->used + 1) * (size_t)(t->n * C), 0,
               (size_t)(t->n * C) * sizeof *t->a);
    /* D's terms 0 and 1 are zeros, as add_change leaves them: it begins at rest */
    moves_by(t, l, tau, gain, level, g);
    sizes(t, l, size);
    for (int k = 0; k + 2 <= t->terms; k++)
        if (change_term(t, l, hops, k, g + k * C, size, C) > ROUNDING)
            hops = outer_of(r, hops);
    hops = outer_of(r, hops);
    for (int b = 0; b < r->dofs[hops]; b++)
        add_change(t, r->dof[b], tau, C);
    return hops;
}

/* What it costs to begin a step anew. */
static double anew_work(const struct torus_taylor *t)
{
    return torus_taylor_work(t) + 2.0 * t->terms * t->n * t->columns / BUDGET_DENSE;
}

/* What a motion of its own costs that reaches DOFS, and as many to be moved to the step's begin. */
static double reach_work(const struct torus_taylor *t, double dofs)
{
    return dofs / t->n * torus_taylor_work(t)
        + t->columns * dofs * t->terms * t->terms / BUDGET_DENSE;
}

int torus_taylor_change(struct torus_taylor *t, int l, double tau, double gain,
                        const double *level)
{
    struct torus_reach *r = &t->reach[l];

    if (r->felt < 0 || anew_work(t) > reach_work(t, r->dofs[r->felt])) {
        switch (t->columns) {
        case 1: r->felt = change_by(t, l, tau, gain, level, 1); break;
        case TORUS_PAIR: r->felt = change_by(t, l, tau, gain, level, TORUS_PAIR); break;
        default: r->felt = change_by(t, l, tau, gain, level, TORUS_WIDE);
        }
        return r->felt;
    }
    torus_taylor_set_line(t, l, gain, level);
    switch (t->columns) {
    case 1: begin_anew(t, tau, 1); break;
    case TORUS_PAIR: begin_anew(t, tau, TORUS_PAIR); break;
    default: begin_anew(t, tau, TORUS_WIDE);
    }
    return r->hops - 1;
}

void torus_taylor_end(const struct torus_taylor *t, const int *list, int count, double *to)
{
    int C = t->columns;
    size_t wide = (size_t)t->n * (size_t)C;
    double after = 1 - t->base;

    for (int b = 0; b < count; b++)
        for (int c = 0; c < C; c++) {
            const double *a = t->a + list[b] * C + c;
            double x = 0, v = 0;

            for (int k = t->used; k >= 0; k--)
                v = v * after + x, x = x * after + a[(size_t)k * wide];
            to[list[b] * C + c] = x;
            to[wide + (size_t)(list[b] * C + c)] = v / t->h;
        }
}

double torus_taylor_work(const struct torus_taylor *t)
{
    double pulls = t->pull[0].start[t->waves] + t->pull[1].start[t->waves];
    double entries = t->K.start[t->n] + t->C.start[t->n] + t->see.start[t->laws]
        + t->push.start[t->laws] + 2.0 * t->n;

    return t->terms * (t->columns * entries + pulls) / BUDGET_DENSE;
}

double torus_taylor_change_work(const struct torus_taylor *t, int l, int hops)
{
    return fmin(anew_work(t), reach_work(t, t->reach[l].dofs[hops]));
}
