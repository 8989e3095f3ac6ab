/*
 * hill_window.c - see hill_window.h
 *
 * x(t) = e^(lambda t) sum_k x_k e^(i k W t), |k| <= H, is a free motion where, with s_k = lambda +
 * i k W and X^+-h = (X_c -+ i X_s) / 2 of what pulsates with cos and sin of h W t,
 *
 *     (s_k^2 M + s_k C + K) x_k + sum_(+-h) (s_(k-+h) C^+-h + K^+-h) x_(k-+h) = 0,
 *
 * in short Q(lambda) x = 0.  W is the largest frequency of which all that pulsates is whole
 * multiples; a period may hold several of its cycles.
 *
 * With lambda = sigma + mu and w = mu x / W, Q(sigma + mu) = Q + mu Q' + mu^2 M says
 *
 *     B (x, w) = (W / mu) (x, w),   B (f, g) = (-W Q^-1 (Q' f + W M g), f),                     (1)
 *
 * Q and Q' at sigma: exponents next to sigma are the largest of B, by Arnoldi's way.  Its vectors'
 * halves all lie in the span of one basis U, [LSB16]: q_j = (U a_j, U b_j), half the room.  Norms
 * are in the roots of kinetic energies, each dof over its mass.  What was found is then refined,
 * [N85]: with Q(lambda) x summed in long doubles, for stiff rows cancel,
 *
 *     lambda' = lambda - (x^H Q^-1 Q(lambda) x) / (x^H Q^-1 Q'(lambda) x),
 *     x' = x - Q^-1 Q(lambda) x,                                                                (2)
 *
 * so that the factors' rounding, of the stiffest motion, slows it down and does not stay in it;
 * with factors next to the exponent itself where sigma is too far: between its error and others.
 *
 * The residual: B q = (W / mu) q is missed by W / mu times Q^-1 Q(lambda) x, so that the multiplier
 * e^(lambda T) is by T |mu| times as much of its size to first order, and what lies past the
 * harmonics kept moves a motion by about what the outermost ones are.
 *
 * The entries themselves are rounded, |D| <= e |A| for each of them, and so is Q by some D with
 * |D| <= e G, where G is made as Q is, of all sizes.  That misses x as a residual D x does, of
 * |D x| <= e g, g = G |x|, each component by itself and of any phase: the multiplier moves by up to
 *
 *     T |mu| e max |Q^-1 v|,   |v_i| <= g_i,                                                    (3)
 *
 * of its size and its condition, |x| = 1.  A convex function is largest at a corner, where |v_i| =
 * g_i, which is climbed to by phases, [B74]: of v those of Q^-H z, z = Q^-1 v, which takes one step
 * where one motion is most of Q^-1, as it is near its exponent.  Of a beam that turns about a pin
 * K's entries, 1e8 times what its lowest motion is held by, cancel in K x to 0: to e g, for those
 * that were rounded.
 *
 * [B74] Boyd, Linear Algebra Appl. 9 (1974) 95-101: the power method for norms of this kind.
 * [S11] Saad, Numerical Methods for Large Eigenvalue Problems, 2nd ed., SIAM 2011.
 * [LSB16] Lu, Su, Bai, SIAM J. Matrix Anal. Appl. 37 (2016) 195-214: two-level orthogonal Arnoldi.
 * [N85] Neumaier, SIAM J. Numer. Anal. 22 (1985) 914-923: residual inverse iteration.
 */
#include "modal/scene/hill_window.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/sparse_lu.h"
#include "modal/scene/dofwise.h"

enum {
    ROOM = 5,                    /* vectors a wanted exponent, and */
    ROOM_MORE = 30,              /* more of them: chosen; most settle with half of that */
    LOOK = 4,                    /* vectors between looks at the small problem, and */
    REFINED = 6,                 /* steps of (2) at most, each halving the residual: chosen */
    CLIMBED = 4,                 /* steps to (3) at most: chosen */
    LOOK_SHARE = 6,              /* so many-th of those that there are: chosen */
    PAIR = 24,                   /* operations an entry of two vectors: two combined, one made */
                                 /* orthogonal to others twice, eight each, half of them there */
    DENSE = 4,                   /* of them in the time of one, as BUDGET_DENSE */
};
static const double SETTLED = 1e-11;     /* residual of (1) over the eigenvalue: chosen */
static const double EXACT = 1e-11;       /* a residual that is not refined: a hundredth of 1e-9 */
/* of an entry: some eight operations make it of a structure's parameters */
static const double ROUNDING = 4 * DBL_EPSILON;
static const double CLIMBS = 1.1;        /* times the step before: less is no step to (3) */
static const double AGAIN = 0.7;         /* of its norm: less is left, then once more */
static const double INVARIANT = 1e-14;   /* what is left of a vector that is rounding */

struct entry { int i, j; double complex value; };

struct search {
    const struct program *p;     /* borrowed */
    int n, H, N, unit;           /* N = (2 H + 1) n; W is so many omegas */
    double W, period;
    double complex shift, sigma; /* of (1); of the factors, in (2) */
    double *root;                /* n: sqrt(M_ii) */
    struct sparse_lu *Q;
    double complex *value;       /* which the factors read */
    int most, m, r;              /* vectors: room, of (1), of U */
    double complex *U, *a, *b, *h;   /* N x (most + 1); (most + 1)^2 each */
    double complex *f, *g, *x, *kept, *last;     /* N each */
    double *size;                /* N: g of (3) */
    double factors;              /* dense operations of all factorizations */
    struct workspace space, matrix;      /* of the arrays; of `value` */
};

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "exponents: out of memory");
}

/* y += factor A x, a row's sum in long doubles: the forces of a stiff row cancel. */
static void multiply_add(const struct sparse *A, double complex factor, const double complex *x,
                         double complex *y)
{
    for (int i = 0; factor != 0 && i < A->m; i++) {
        long double re = 0, im = 0;
        for (int k = A->start[i]; k < A->start[i + 1]; k++) {
            re += (long double)A->value[k] * creal(x[A->index[k]]);
            im += (long double)A->value[k] * cimag(x[A->index[k]]);
        }
        y[i] += factor * CMPLX((double)re, (double)im);
    }
}

/* y += |factor| |A| |x|, of entries. */
static void add_sizes(const struct sparse *A, double complex factor, const double complex *x,
                      double complex *y)
{
    for (int i = 0; factor != 0 && i < A->m; i++)
        for (int k = A->start[i]; k < A->start[i + 1]; k++)
            y[i] += cabs(factor * x[A->index[k]]) * fabs(A->value[k]);
}

typedef void product(const struct sparse *A, double complex factor, const double complex *x,
                     double complex *y);

/* s_k at LAMBDA; and what M, C and K are multiplied with in Q's derivative ORDER, over ORDER!. */
static void factors_of(const struct search *s, double complex lambda, int k, int order,
                       double complex out[3])
{
    double complex rate = lambda + I * (k * s->W);

    out[PROGRAM_M] = order == 0 ? rate * rate : order == 1 ? 2 * rate : 1;
    out[PROGRAM_C] = order == 0 ? rate : order == 1 ? 1 : 0;
    out[PROGRAM_K] = order == 0 ? 1 : 0;
}

/* OUT += Q's derivative ORDER over ORDER! at LAMBDA, times x, of products that ADD adds. */
static void multiply(const struct search *s, double complex lambda, int order, product *add,
                     const double complex *x, double complex *out)
{
    double complex factor[3];

    for (int k = -s->H; k <= s->H; k++) {
        const double complex *from = x + (size_t)(k + s->H) * (size_t)s->n;
        factors_of(s, lambda, k, order, factor);
        for (int part = PROGRAM_M; part <= PROGRAM_K; part++)
            add(&s->p->constant[part], factor[part], from,
                out + (size_t)(k + s->H) * (size_t)s->n);
        for (int h = 0; h < s->p->harmonics; h++)
            for (int side = -1; side <= 1; side += 2) {
                const struct program_harmonic *a = &s->p->harmonic[h];
                int to = k + side * (a->k / s->unit);
                size_t row = (size_t)(to + s->H) * (size_t)s->n;
                for (int part = PROGRAM_C; abs(to) <= s->H && part <= PROGRAM_K; part++) {
                    add(&a->cosine[part], factor[part] / 2, from, out + row);
                    add(&a->sine[part], -I * side * factor[part] / 2, from, out + row);
                }
            }
    }
}

/* A's entries times FACTOR at block (TO, FROM). */
static struct entry *add_block(const struct sparse *A, double complex factor, int to, int from,
                               struct entry *e)
{
    for (int i = 0; i < A->m; i++)
        for (int k = A->start[i]; k < A->start[i + 1]; k++)
            *e++ = (struct entry){ to + i, from + A->index[k], factor * A->value[k] };
    return e;
}

/* The entries of Q(sigma) into E; how many.  E NULL: counted. */
static size_t list_entries(const struct search *s, struct entry *e)
{
    struct entry *begin = e;
    size_t count = 0;
    double complex factor[3];

    for (int k = -s->H; k <= s->H; k++) {
        int from = (k + s->H) * s->n;
        factors_of(s, s->sigma, k, 0, factor);
        for (int part = PROGRAM_M; part <= PROGRAM_K; part++) {
            const struct sparse *A = &s->p->constant[part];
            count += A->m > 0 ? (size_t)A->start[A->m] : 0;
            e = e != NULL ? add_block(A, factor[part], from, from, e) : NULL;
        }
        for (int h = 0; h < 2 * s->p->harmonics; h++)
            for (int part = PROGRAM_C; part <= PROGRAM_K; part++) {
                const struct program_harmonic *a = &s->p->harmonic[h / 2];
                int side = h % 2 == 0 ? 1 : -1, to = k + side * (a->k / s->unit),
                    row = (to + s->H) * s->n;
                const struct sparse *c = &a->cosine[part], *d = &a->sine[part];
                if (abs(to) > s->H)
                    continue;
                count += (c->m > 0 ? (size_t)c->start[c->m] : 0)
                         + (d->m > 0 ? (size_t)d->start[d->m] : 0);
                if (e == NULL)
                    continue;
                e = add_block(c, factor[part] / 2, row, from, e);
                e = add_block(d, -I * side * factor[part] / 2, row, from, e);
            }
    }
    return begin != NULL ? (size_t)(e - begin) : count;
}

/* COUNT of E stably by row or column into OUT; START: n + 1 places. */
static void sort_entries(const struct entry *e, size_t count, bool by_row, int n, int *start,
                         struct entry *out)
{
    memset(start, 0, ((size_t)n + 1) * sizeof *start);
    for (size_t c = 0; c < count; c++)
        start[(by_row ? e[c].i : e[c].j) + 1]++;
    for (int i = 0; i < n; i++)
        start[i + 1] += start[i];
    for (size_t c = 0; c < count; c++)
        out[start[by_row ? e[c].i : e[c].j]++] = e[c];
}

/* The factors of Q(sigma). */
static enum modal_status factor(struct search *s, struct modal_error *err)
{
    struct workspace scratch = { 0 };
    size_t count = list_entries(s, NULL), last = 0, N = (size_t)s->N;
    struct entry *e = workspace_zeros(&scratch, count, sizeof *e),
                 *sorted = workspace_zeros(&scratch, count, sizeof *sorted);
    int *start = workspace_zeros(&scratch, N + 1, sizeof *start),
        *row = workspace_zeros(&scratch, count, sizeof *row);
    enum modal_status rc;

    s->value = workspace_zeros(&s->matrix, count, sizeof *s->value);
    rc = scratch.failed || s->matrix.failed ? no_memory(err) : MODAL_OK;
    if (rc == MODAL_OK) {
        list_entries(s, e);
        sort_entries(e, count, true, s->N, start, sorted);
        sort_entries(sorted, count, false, s->N, start, e);
        memset(start, 0, (N + 1) * sizeof *start);
        for (size_t c = 0; c < count; c++) {     /* those of one place added */
            bool again = c > 0 && e[c].j == e[c - 1].j && e[c].i == e[c - 1].i;
            last += again || c == 0 ? 0 : 1;
            s->value[last] += e[c].value;
            row[last] = e[c].i;
            start[e[c].j + 1] = (int)last + 1;
        }
        for (size_t i = 0; i < N; i++)
            start[i + 1] = start[i + 1] > start[i] ? start[i + 1] : start[i];
        rc = sparse_lu_new(s->N, start, row, true, &s->Q, err);
    }
    if (rc == MODAL_OK && !sparse_lu_factor(s->Q, s->value))
        rc = modal_fail(err, MODAL_NO_CONVERGENCE,
                        "Hill's matrix at %g%+gi is singular, or there is no memory for its "
                        "factors", creal(s->sigma), cimag(s->sigma));
    s->factors += rc == MODAL_OK ? sparse_lu_work(s->Q) : 0;
    workspace_free(&scratch);
    return rc;
}

/* The factors at SHIFT in place of those at sigma, which are gone where it fails. */
static enum modal_status move(struct search *s, double complex shift, struct modal_error *err)
{
    s->sigma = shift;
    sparse_lu_free(s->Q);
    s->Q = NULL;
    workspace_free(&s->matrix);
    return factor(s, err);
}

/* X, in roots of energies, to displacements (DOWN) or back. */
static void scale(const struct search *s, bool down, double complex *x)
{
    for (int i = 0; i < s->N; i++)
        x[i] *= down ? 1 / s->root[i % s->n] : s->root[i % s->n];
}

/* y = U c */
static void combine(const struct search *s, const double complex *c, double complex *y)
{
    const double complex one = 1, zero = 0;

    cblas_zgemv(CblasColMajor, CblasNoTrans, s->N, s->r, &one, s->U, s->N, c, 1, &zero, y, 1);
}

/* X (LENGTH) less its parts along COUNT columns of V (leading dimension LD), which are added to C,
 * twice where little is left [S11]; the norm that is. */
static double orthogonalise(const double complex *V, int length, int ld, int count,
                            double complex *x, double complex *c, double complex *room)
{
    const double complex one = 1, minus = -1, zero = 0;
    double before, left = cblas_dznrm2(length, x, 1);

    for (int pass = 0; pass < 2; pass++) {
        before = left;
        cblas_zgemv(CblasColMajor, CblasConjTrans, length, count, &one, V, ld, x, 1, &zero, room,
                    1);
        cblas_zgemv(CblasColMajor, CblasNoTrans, length, count, &minus, V, ld, room, 1, &one, x,
                    1);
        cblas_zaxpy(count, &one, room, 1, c, 1);
        left = cblas_dznrm2(length, x, 1);
        if (left >= AGAIN * before)
            break;
    }
    return left;
}

/* One more vector of (1), q_m -> q_(m+1).  Columns of `a` hold (a_j, b_j), room for `most` + 1 of
 * each.  False: the space is invariant. */
static bool grow(struct search *s)
{
    int room = s->most + 1, ld = 2 * room;
    double complex *q = s->a + (size_t)s->m * (size_t)ld, *next = q + ld,
                   *h = s->h + (size_t)s->m * (size_t)room;
    double before, left;

    combine(s, q, s->f);
    combine(s, q + room, s->g);
    scale(s, true, s->f);
    scale(s, true, s->g);
    memset(s->x, 0, (size_t)s->N * sizeof *s->x);
    for (int i = 0; i < s->N; i++)
        s->g[i] *= s->W;
    multiply(s, s->sigma, 1, multiply_add, s->f, s->x);
    multiply(s, s->sigma, 2, multiply_add, s->g, s->x);
    sparse_lu_solve(s->Q, s->x, s->f);
    scale(s, false, s->f);
    for (int i = 0; i < s->N; i++)
        s->f[i] *= -s->W;
    before = cblas_dznrm2(s->N, s->f, 1);
    memset(next, 0, (size_t)ld * sizeof *next);
    left = orthogonalise(s->U, s->N, s->N, s->r, s->f, next, s->b);
    if (left > INVARIANT * before) {
        next[s->r] = left;
        for (int i = 0; i < s->N; i++)
            s->U[(size_t)i + (size_t)s->r * (size_t)s->N] = s->f[i] / left;
        s->r++;
    }
    memcpy(next + room, q, (size_t)room * sizeof *q);
    before = cblas_dznrm2(ld, next, 1);
    left = orthogonalise(s->a, ld, ld, s->m + 1, next, h, s->b);
    s->m++;
    if (!(left > INVARIANT * before))
        return false;
    h[s->m] = left;
    for (int i = 0; i < ld; i++)
        next[i] /= left;
    return true;
}

struct ritz {                    /* of the small problem */
    double complex *theta, *left, *right, *copy;
    double *residual;            /* over |theta| */
    int *order;                  /* descending in modulus */
    int settled;                 /* so many, the first in that order */
    struct workspace space;
};

/* Values and vectors of h's first m rows and columns; LAST: left ones too. */
static enum modal_status look(const struct search *s, struct ritz *z, bool last,
                              struct modal_error *err)
{
    int m = s->m, room = s->most + 1;
    size_t size = (size_t)m;

    workspace_free(&z->space);
    z->theta = workspace_zeros(&z->space, size, sizeof *z->theta);
    z->left = workspace_zeros(&z->space, size * size, sizeof *z->left);
    z->right = workspace_zeros(&z->space, size * size, sizeof *z->right);
    z->copy = workspace_zeros(&z->space, size * size, sizeof *z->copy);
    z->residual = workspace_zeros(&z->space, size, sizeof *z->residual);
    z->order = workspace_zeros(&z->space, size, sizeof *z->order);
    if (z->space.failed)
        return no_memory(err);
    for (size_t j = 0; j < size; j++)
        memcpy(z->copy + j * size, s->h + j * (size_t)room, size * sizeof *z->copy);
    if (LAPACKE_zgeev(LAPACK_COL_MAJOR, last ? 'V' : 'N', 'V', m, z->copy, m, z->theta, z->left, m,
                      z->right, m) != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "exponents: no eigenvalues of order %d", m);
    for (int c = 0; c < m; c++) {
        int j = c;
        z->residual[c] = cabs(s->h[m + (m - 1) * room] * z->right[(m - 1) + c * m])
                         / cabs(z->theta[c]);
        for (; j > 0 && cabs(z->theta[z->order[j - 1]]) < cabs(z->theta[c]); j--)
            z->order[j] = z->order[j - 1];
        z->order[j] = c;
    }
    for (z->settled = 0; z->settled < m; z->settled++)
        if (!(z->residual[z->order[z->settled]] <= SETTLED))
            break;
    return MODAL_OK;
}

/* The share of x's outermost harmonics, and k of the largest. */
static double edge_of(const struct search *s, const double complex *x, int *largest)
{
    double all = 0, edge = 0, most = -1;
    int reach = hill_window_reach(s->p);

    *largest = 0;
    for (int k = -s->H; k <= s->H; k++) {
        double size = cblas_dznrm2(s->n, x + (size_t)(k + s->H) * (size_t)s->n, 1);
        all += size * size;
        edge += s->H > 0 && abs(k) > s->H - reach ? size * size : 0;
        *largest = size > most ? k : *largest;
        most = fmax(most, size);
    }
    return sqrt(edge / all);
}

/* (x, x') at t = 0 of the motion X at LAMBDA, in roots of energies. */
static void take_start(const struct search *s, const double *weight, double complex lambda,
                       const double complex *x, double complex *y)
{
    double size;

    for (int k = -s->H; k <= s->H; k++)
        for (int i = 0; i < s->n; i++) {
            double complex here = x[(size_t)(k + s->H) * (size_t)s->n + (size_t)i];
            y[i] += here;
            y[s->n + i] += (lambda + I * (k * s->W)) * here;
        }
    for (int i = 0; i < 2 * s->n; i++)
        y[i] *= weight[i];
    size = cblas_dznrm2(2 * s->n, y, 1);
    for (int i = 0; i < 2 * s->n; i++)
        y[i] /= size;
}

/* OUT = Q^-1 times Q's derivative ORDER at LAMBDA times X, which is of displacements, in roots of
 * energies. */
static void solve_of(struct search *s, double complex lambda, int order, const double complex *x,
                     double complex *out)
{
    memset(s->x, 0, (size_t)s->N * sizeof *s->x);
    multiply(s, lambda, order, multiply_add, x, s->x);
    sparse_lu_solve(s->Q, s->x, out);
    scale(s, false, out);
}

/* (2) until it is met, or no step halves what it is missed by: LAMBDA and f, in roots of energies.
 * The residual. */
static double refine(struct search *s, double complex *lambda)
{
    size_t bytes = (size_t)s->N * sizeof *s->f;
    double complex top, bottom, to = *lambda;
    double missed = HUGE_VAL;

    memcpy(s->last, s->f, bytes);
    for (int i = 0; i < REFINED; i++) {
        double size = cblas_dznrm2(s->N, s->f, 1), here;

        memcpy(s->kept, s->f, bytes);
        scale(s, true, s->kept);
        solve_of(s, to, 0, s->kept, s->g);
        here = s->period * cabs(to - s->sigma) * cblas_dznrm2(s->N, s->g, 1) / size;
        if (!(here <= missed / 2))
            break;
        missed = here;
        *lambda = to;
        memcpy(s->last, s->f, bytes);
        if (missed <= EXACT)
            break;
        cblas_zdotc_sub(s->N, s->f, 1, s->g, 1, &top);
        for (int k = 0; k < s->N; k++)
            s->f[k] -= s->g[k];
        solve_of(s, to, 1, s->kept, s->g);
        cblas_zdotc_sub(s->N, s->last, 1, s->g, 1, &bottom);
        to -= top / bottom;
    }
    memcpy(s->f, s->last, bytes);
    return missed;
}

/* (3) of LAMBDA and f, in roots of energies. */
static double rounding_of(struct search *s, double complex lambda)
{
    double size = cblas_dznrm2(s->N, s->f, 1), most = 0, here;

    memcpy(s->kept, s->f, (size_t)s->N * sizeof *s->kept);
    scale(s, true, s->kept);
    memset(s->x, 0, (size_t)s->N * sizeof *s->x);
    multiply(s, lambda, 0, add_sizes, s->kept, s->x);
    for (int k = 0; k < s->N; k++) {     /* begun as if Q were symmetric: Q^-H z is conj(x) then */
        s->size[k] = creal(s->x[k]);
        s->x[k] = conj(s->kept[k]);
    }
    for (int i = 0; i < CLIMBED; i++) {
        for (int k = 0; k < s->N; k++)
            s->x[k] = s->size[k] * (s->x[k] != 0 ? s->x[k] / cabs(s->x[k]) : 1);
        sparse_lu_solve(s->Q, s->x, s->g);
        scale(s, false, s->g);
        here = cblas_dznrm2(s->N, s->g, 1);
        if (!(here > CLIMBS * most))
            break;
        most = here;
        scale(s, false, s->g);
        sparse_lu_solve_adjoint(s->Q, s->g, s->x);
    }
    return s->period * cabs(lambda - s->sigma) * ROUNDING * fmax(most, here) / size;
}

/* LAMBDA and f nearer to a motion, with factors beside it where those at hand do not do; *MISSED:
 * what it misses by then. */
static enum modal_status approach(struct search *s, double complex *lambda, double *missed,
                                  struct modal_error *err)
{
    double complex was = s->sigma;

    *missed = refine(s, lambda);
    if (!(*missed > EXACT))
        return MODAL_OK;
    if (move(s, *lambda + sqrt(fmin(*missed, 1)) / s->period, NULL) != MODAL_OK)
        return move(s, was, err);
    *missed = fmin(refine(s, lambda), *missed);
    return MODAL_OK;
}

/* Value C of Z into OUT. */
static enum modal_status take(struct search *s, const struct ritz *z, int c, const double *weight,
                              struct hill_window *out, struct modal_error *err)
{
    int m = s->m, ld = 2 * (s->most + 1), at = out->count, middle;
    double complex lambda = s->shift + s->W / z->theta[c], dot = 0, *sum = s->b;
    double missed;
    enum modal_status rc;

    memset(sum, 0, (size_t)ld * sizeof *sum);
    for (int j = 0; j < m; j++)
        for (int i = 0; i < s->r; i++)
            sum[i] += s->a[i + (size_t)j * (size_t)ld] * z->right[j + c * m];
    combine(s, sum, s->f);
    rc = approach(s, &lambda, &missed, err);
    if (rc != MODAL_OK)
        return rc;
    out->count++;
    out->rounding[at] = rounding_of(s, lambda);
    out->edge[at] = edge_of(s, s->f, &middle);
    scale(s, true, s->f);
    take_start(s, weight, lambda, s->f, out->start + (size_t)at * 2 * (size_t)s->n);
    for (int i = 0; i < m; i++)
        dot += conj(z->left[i + c * m]) * z->right[i + c * m];
    out->exponent[at] = lambda + I * (middle * s->W);
    out->middle[at] = middle;
    out->condition[at] = fmax(1 / cabs(dot), 1);
    out->residual[at] = missed + 2 * out->edge[at];
    return MODAL_OK;
}

/* Arrays of S, and its start. */
static enum modal_status prepare(struct search *s, int seed, struct modal_error *err)
{
    size_t N = (size_t)s->N, room = (size_t)s->most + 1;
    const struct sparse *M = &s->p->constant[PROGRAM_M];
    uint64_t state = (uint64_t)seed;
    double size;

    s->root = workspace_zeros(&s->space, (size_t)s->n, sizeof *s->root);
    s->U = workspace_zeros(&s->space, N * room, sizeof *s->U);
    s->a = workspace_zeros(&s->space, 2 * room * room, sizeof *s->a);
    s->h = workspace_zeros(&s->space, room * room, sizeof *s->h);
    s->b = workspace_zeros(&s->space, 2 * room, sizeof *s->b);
    s->f = workspace_zeros(&s->space, N, sizeof *s->f);
    s->g = workspace_zeros(&s->space, N, sizeof *s->g);
    s->x = workspace_zeros(&s->space, N, sizeof *s->x);
    s->last = workspace_zeros(&s->space, N, sizeof *s->last);
    s->kept = workspace_zeros(&s->space, N, sizeof *s->kept);
    s->size = workspace_zeros(&s->space, N, sizeof *s->size);
    if (s->space.failed)
        return no_memory(err);
    for (int i = 0; i < s->n; i++)
        for (int k = M->start[i]; k < M->start[i + 1]; k++)
            s->root[i] = M->index[k] == i ? sqrt(fabs(M->value[k])) : s->root[i];
    for (int i = 0; i < s->n; i++) {     /* the middle harmonic alone: copies are elsewhere */
        state = state * 6364136223846793005u + 1442695040888963407u;
        s->x[(size_t)s->H * (size_t)s->n + (size_t)i] = (double)(state >> 11) / 9007199254740992.0
                                                        - 0.5;
    }
    size = cblas_dznrm2(s->N, s->x, 1);
    for (size_t i = 0; i < N; i++)
        s->U[i] = s->x[i] / size;
    s->r = 1;
    s->a[0] = 1;
    return MODAL_OK;
}

/* Of Z what has settled, WANTED at most. */
static enum modal_status report(struct search *s, const struct ritz *z, int wanted,
                                struct hill_window *out, struct modal_error *err)
{
    size_t count = (size_t)(z->settled < wanted ? z->settled : wanted), n = (size_t)s->n;
    double *weight = workspace_zeros(&s->space, 2 * n, sizeof *weight);
    enum modal_status rc = MODAL_OK;

    out->exponent = workspace_zeros(&out->space, count, sizeof *out->exponent);
    out->residual = workspace_zeros(&out->space, count, sizeof *out->residual);
    out->rounding = workspace_zeros(&out->space, count, sizeof *out->rounding);
    out->condition = workspace_zeros(&out->space, count, sizeof *out->condition);
    out->edge = workspace_zeros(&out->space, count, sizeof *out->edge);
    out->middle = workspace_zeros(&out->space, count, sizeof *out->middle);
    out->start = workspace_zeros(&out->space, 2 * n * count, sizeof *out->start);
    if (s->space.failed || out->space.failed)
        return no_memory(err);
    dofwise_weights(s->p, s->period, weight);
    for (size_t i = 0; i < count && rc == MODAL_OK; i++)
        rc = take(s, z, z->order[i], weight, out, err);
    out->radius = count > 0 ? s->W / cabs(z->theta[z->order[count - 1]]) : 0;
    return rc;
}

/* Of how many omegas all harmonics are whole multiples, at most, by Euclid's way. */
static int unit_of(const struct program *p)
{
    int unit = 0;

    for (int h = 0; h < p->harmonics; h++)
        for (int k = p->harmonic[h].k, rest; k > 0; k = rest) {
            rest = unit % k;
            unit = k;
        }
    return unit > 0 ? unit : 1;
}

double hill_window_frequency(const struct program *p, double period)
{
    return p->harmonics > 0 ? unit_of(p) * p->omega : 2 * M_PI / period;
}

int hill_window_reach(const struct program *p)
{
    return p->harmonics > 0 ? p->harmonic[p->harmonics - 1].k / unit_of(p) : 0;
}

double hill_window_vectors(int wanted) { return ROOM * (double)wanted + ROOM_MORE; }

double hill_window_work(double entries, double vectors, double factors)
{
    return (factors + PAIR * entries * vectors * vectors) / DENSE;
}

enum modal_status hill_window(const struct program *p, double period, double complex shift,
                              int harmonics, int wanted, int seed, struct hill_window *out,
                              struct modal_error *err)
{
    struct search s = { .p = p, .n = p->n, .H = harmonics, .period = period, .shift = shift,
                        .sigma = shift, .unit = unit_of(p) };
    struct ritz z = { 0 };
    double vectors = hill_window_vectors(wanted), size = (2.0 * harmonics + 1) * p->n;
    bool more = true;
    int next = wanted + LOOK;
    enum modal_status rc;

    *out = (struct hill_window){ 0 };
    if (size * fmin(vectors, 2 * size) * sizeof *s.U > HILL_WINDOW_BYTES)
        return modal_fail(err, MODAL_TOO_LARGE, "%g vectors of %d dofs by %d harmonics take more "
                          "than %d bytes", vectors, p->n, 2 * harmonics + 1, HILL_WINDOW_BYTES);
    s.W = hill_window_frequency(p, period);
    s.N = (int)size;
    s.most = (int)fmin(vectors, 2 * size);
    rc = prepare(&s, seed, err);
    if (rc == MODAL_OK)
        rc = factor(&s, err);
    while (rc == MODAL_OK && more && s.m < s.most && z.settled < wanted) {
        more = grow(&s);
        if (more && s.m < s.most && s.m < next)
            continue;
        rc = look(&s, &z, false, err);
        next = s.m + LOOK + s.m / LOOK_SHARE;
    }
    if (rc == MODAL_OK)
        rc = look(&s, &z, true, err);
    if (rc == MODAL_OK)
        rc = report(&s, &z, wanted, out, err);
    out->factors = s.Q != NULL ? sparse_lu_work(s.Q) : 0;
    out->work = hill_window_work(size, s.m, s.factors);
    workspace_free(&z.space);
    sparse_lu_free(s.Q);
    workspace_free(&s.matrix);
    workspace_free(&s.space);
    if (rc != MODAL_OK)
        hill_window_done(out);
    return rc;
}

void hill_window_done(struct hill_window *h)
{
    workspace_free(&h->space);
    *h = (struct hill_window){ 0 };
}
