/*
 * arnoldi.c - see arnoldi.h
 *
 * With orthonormal v_0 .. v_m and Hessenberg's H, [S11, 6.2]
 *
 *     A V_m = V_m H_m + h v_m e_m^T,   h = H(m, m-1),                                           (1)
 *
 * a pair (w, y) of H_m has the residual |h| |e_m^T y| / |y| as one of A, without a product.  H's
 * eigenvalues come by QR, the vectors of the wanted ones alone by inverse iteration.  Looking costs
 * 10 m^3: it is done where m has grown by a half, so that all looks cost about 1.4 of the last.
 * Once residuals fall they do so the faster the later: then where two looks foretell the end.
 *
 * Where values crowd that takes a polynomial of some degree D of A.  From A^j v_0 it has zeros at 0
 * j times, and where most values are smaller than the wanted ones m falls to about D - j: products
 * as before, and fewer vectors, each of which costs more than a product once there are many.  Other
 * values lose by A^j beside the largest w; the last wanted one may lose LOST, which as rounding's
 * share of the start is still 1e-13.
 *
 * [S11] Saad, Numerical Methods for Large Eigenvalue Problems, 2nd ed., SIAM 2011.
 */
#include "modal/linalg/arnoldi.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"

enum {
    LOOK_FIRST = 4,              /* products for each wanted value before the first look */
    GROWTH = 2,                  /* a look each time m has grown by a half, */
    GROWTH_LATE = 4,             /* or by a quarter at most once residuals are FALLING, */
    GROWTH_LEAST = 16,           /* and by a sixteenth at least */
    TRIED = 3,                   /* of EVEN, a third: vectors so far are cheap to let go */
};
static const double FALLING = 1e-3;  /* of the largest modulus: residuals below it fall: chosen */
static const double AHEAD = 1.25;    /* of what is foretold: looks cost some hundred vectors */
static const double LOST = 1e-3;     /* of a wanted value's part of the start: chosen, see above */
static const double AGAIN = 0.7; /* of its norm: less is left, then orthogonal once more [S11] */

struct subspace {
    const struct linear_operator *A;
    int n, m, most;              /* vectors so far; room */
    int limit, end, before;      /* products; vectors at most; products before the first of them */
    double *V, *H, *h;           /* n x (most + 1), (most + 1) x most, most + 1 */
    bool whole;                  /* invariant: nothing is left outside */
};

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "eigenvalues: out of memory");
}

/* U less its parts along the first M vectors, which are added to h. */
static void orthogonalise(struct subspace *s, double *u, double *h)
{
    cblas_dgemv(CblasColMajor, CblasTrans, s->n, s->m + 1, 1, s->V, s->n, u, 1, 0, s->h, 1);
    cblas_dgemv(CblasColMajor, CblasNoTrans, s->n, s->m + 1, -1, s->V, s->n, s->h, 1, 1, u, 1);
    cblas_daxpy(s->m + 1, 1, s->h, 1, h, 1);
}

/* One more column of (1). */
static enum modal_status grow(struct subspace *s, struct modal_error *err)
{
    double *u = s->V + (size_t)(s->m + 1) * (size_t)s->n,
           *h = s->H + (size_t)s->m * (size_t)(s->most + 1), before, left;
    enum modal_status rc =
        s->A->apply(s->A->context, s->V + (size_t)s->m * (size_t)s->n, u, err);

    if (rc != MODAL_OK)
        return rc;
    before = cblas_dnrm2(s->n, u, 1);
    orthogonalise(s, u, h);
    left = cblas_dnrm2(s->n, u, 1);
    if (left < AGAIN * before) {
        orthogonalise(s, u, h);
        left = cblas_dnrm2(s->n, u, 1);
    }
    s->m++;
    s->whole = s->m == s->n || left <= s->n * DBL_EPSILON * before;
    h[s->m] = s->whole ? 0 : left;
    if (!s->whole)
        cblas_dscal(s->n, 1 / left, u, 1);
    return MODAL_OK;
}

struct small {                   /* the eigenvalue problem of H_m */
    double *H, *wr, *wi, *left, *right;
    lapack_logical *chosen;
    int *order;
    lapack_int *fail;
    struct workspace space;
};

static enum modal_status small_new(int m, int columns, struct small *e, struct modal_error *err)
{
    size_t rows = (size_t)m;

    *e = (struct small){ 0 };
    e->H = workspace_zeros(&e->space, rows * rows, sizeof *e->H);
    e->wr = workspace_zeros(&e->space, rows, sizeof *e->wr);
    e->wi = workspace_zeros(&e->space, rows, sizeof *e->wi);
    e->left = workspace_zeros(&e->space, rows * (size_t)columns, sizeof *e->left);
    e->right = workspace_zeros(&e->space, rows * (size_t)columns, sizeof *e->right);
    e->chosen = workspace_zeros(&e->space, rows, sizeof *e->chosen);
    e->order = workspace_zeros(&e->space, rows, sizeof *e->order);
    e->fail = workspace_zeros(&e->space, 2 * (size_t)columns, sizeof *e->fail);
    return workspace_check(&e->space, "eigenvalues: out of memory", err);
}

static void copy_hessenberg(const struct subspace *s, double *H)
{
    for (int j = 0; j < s->m; j++)
        memcpy(H + (size_t)j * (size_t)s->m, s->H + (size_t)j * (size_t)(s->most + 1),
               (size_t)s->m * sizeof *H);
}

/* Marks the WANTED of largest modulus, pairs whole, by their first; how many columns they take. */
static int choose(struct small *e, int m, int wanted)
{
    int columns = 0;

    for (int i = 0; i < m; i++) {            /* by insertion: few move far, and pairs stay */
        int j = i;
        double size = hypot(e->wr[i], e->wi[i]);
        for (; j > 0 && hypot(e->wr[e->order[j - 1]], e->wi[e->order[j - 1]]) < size; j--)
            e->order[j] = e->order[j - 1];
        e->order[j] = i;
    }
    for (int i = 0; i < m && columns < wanted; i++) {
        int at = e->order[i];
        if (e->wi[at] < 0)                   /* came with its pair's first */
            continue;
        e->chosen[at] = 1;
        columns += e->wi[at] > 0 ? 2 : 1;
    }
    return columns;
}

/* Vector C of X (one column, or two of a pair) into Y, of unit norm. */
static void take_vector(const double *x, int m, bool pair, double complex *y)
{
    double norm = 0;

    for (int i = 0; i < m; i++) {
        y[i] = CMPLX(x[i], pair ? x[m + i] : 0);
        norm = hypot(norm, cabs(y[i]));
    }
    for (int i = 0; i < m; i++)
        y[i] /= norm;
}

/* The chosen pairs of H as pairs of A, into *OUT but for V where LIFT is not set. */
static enum modal_status take(const struct subspace *s, struct small *e, bool lift,
                              struct arnoldi *out, struct modal_error *err)
{
    size_t rows = (size_t)s->m, n = (size_t)s->n;
    double complex *y = calloc(2 * rows + 1, sizeof *y), *z = y + rows;
    double h = s->H[(size_t)(s->m - 1) * (size_t)(s->most + 1) + rows];
    int column = 0, first = 0;

    if (y == NULL)
        return no_memory(err);
    for (int j = 0; j < s->m; j++) {
        bool pair = e->wi[j] > 0;
        double complex product = 0;
        if (!e->chosen[j])
            continue;
        take_vector(e->right + (size_t)column * rows, s->m, pair, y);
        take_vector(e->left + (size_t)column * rows, s->m, pair, z);
        for (int i = 0; i < s->m; i++)
            product += conj(z[i]) * y[i];
        for (int both = 0; both < (pair ? 2 : 1); both++, first++) {
            out->w[first] = CMPLX(e->wr[j], both == 0 ? e->wi[j] : -e->wi[j]);
            out->residual[first] = h * cabs(y[rows - 1]);
            out->condition[first] = 1 / fmax(cabs(product), DBL_EPSILON);
            for (size_t i = 0; lift && i < n; i++) {
                double complex sum = 0;
                for (size_t k = 0; k < rows; k++)
                    sum += s->V[i + k * n] * y[k];
                out->V[i + (size_t)first * n] = both == 0 ? sum : conj(sum);
            }
        }
        column += pair ? 2 : 1;
    }
    out->count = first;
    free(y);
    return MODAL_OK;
}

/* A look at H_m: the wanted into *OUT, and whether all have settled; with vectors then, and at the
 * last look. */
static enum modal_status look(const struct subspace *s, int wanted, double tolerance,
                              struct arnoldi *out, struct modal_error *err)
{
    struct small e;
    lapack_int found, m = s->m;
    int columns = 0;
    double largest = 0, worst = 0;
    enum modal_status rc = small_new(s->m, wanted + 1, &e, err);

    if (rc == MODAL_OK) {
        copy_hessenberg(s, e.H);
        if (LAPACKE_dhseqr(LAPACK_COL_MAJOR, 'E', 'N', m, 1, m, e.H, m, e.wr, e.wi, NULL, 1) != 0)
            rc = modal_fail(err, MODAL_NO_CONVERGENCE, "eigenvalues: QR did not converge");
    }
    if (rc == MODAL_OK) {
        columns = choose(&e, s->m, wanted);
        copy_hessenberg(s, e.H);
        if (LAPACKE_dhsein(LAPACK_COL_MAJOR, 'B', 'Q', 'N', e.chosen, m, e.H, m, e.wr, e.wi,
                           e.left, m, e.right, m, columns, &found, e.fail, e.fail + columns)
            < 0)
            rc = modal_fail(err, MODAL_NO_CONVERGENCE, "eigenvalues: no vectors of them");
    }
    if (rc == MODAL_OK)
        rc = take(s, &e, false, out, err);
    for (int i = 0; rc == MODAL_OK && i < out->count; i++) {
        largest = fmax(largest, cabs(out->w[i]));
        worst = fmax(worst, out->residual[i]);
    }
    out->worst = worst / largest;
    out->settled = out->worst <= tolerance;
    if (rc == MODAL_OK && (out->settled || s->m == s->end))
        rc = take(s, &e, true, out, err);
    workspace_free(&e.space);
    return rc;
}

/* How many products there are at the look after that of M, which found WORST in place of BEFORE of
 * M_BEFORE: where the line through both, of its logarithm, meets TOLERANCE. */
static int next_look(int m, double worst, int m_before, double before, double tolerance)
{
    double foretold = AHEAD * (m - m_before) * log(worst / tolerance) / log(before / worst);

    if (!(worst < FALLING))
        return m + m / GROWTH;
    return m + (before > worst && foretold < m / GROWTH_LATE
                    ? (int)fmax(ceil(foretold), m / GROWTH_LEAST) : m / GROWTH_LATE);
}

/* A fixed vector without pattern, of unit norm, to begin with. */
static void begin(struct subspace *s)
{
    uint32_t state = 1;

    for (int i = 0; i < s->n; i++) {
        state = 1664525 * state + 1013904223;    /* a linear congruence: no number of it is 0 */
        s->V[i] = (double)state / UINT32_MAX - 0.5;
    }
    cblas_dscal(s->n, 1 / cblas_dnrm2(s->n, s->V, 1), s->V, 1);
}

/* So many products may a start be carried for: twice as many as were made, what leaves half of all
 * to vectors, or where all of A could be spanned what lets it be, and what the wanted in A bear. */
static int carried_most(const struct subspace *s, const struct arnoldi *a)
{
    double largest = 0, least = HUGE_VAL, bear,
           leaves = (s->limit < s->n ? s->limit / 2 : s->limit - s->n) - s->m;

    for (int i = 0; i < a->count; i++) {
        largest = fmax(largest, cabs(a->w[i]));
        least = fmin(least, cabs(a->w[i]));
    }
    bear = largest > least ? log(LOST) / log(least / largest) : HUGE_VAL;
    return (int)fmax(fmin(fmin(2.0 * s->m, leaves), bear), 0);
}

/* The space anew from the start carried on by PRODUCTS. */
static enum modal_status begin_again(struct subspace *s, int products, struct modal_error *err)
{
    double *next = s->V + s->n, size = 1;
    enum modal_status rc = MODAL_OK;

    memset(s->H, 0, ((size_t)s->most + 1) * (size_t)s->m * sizeof *s->H);
    s->before += s->m + products;
    s->end = s->most < s->limit - s->before ? s->most : s->limit - s->before;
    s->m = 0;
    begin(s);
    for (int i = 0; rc == MODAL_OK && i < products && size > 0; i++) {
        rc = s->A->apply(s->A->context, s->V, next, err);
        size = cblas_dnrm2(s->n, next, 1);
        for (int k = 0; rc == MODAL_OK && size > 0 && k < s->n; k++)
            s->V[k] = next[k] / size;
    }
    return rc;
}

/* Descending in modulus, pairs together. */
static void sort(struct arnoldi *a, size_t n)
{
    for (int i = 1; i < a->count; i++)
        for (int j = i; j > 0 && cabs(a->w[j]) > cabs(a->w[j - 1]) * (1 + DBL_EPSILON); j--) {
            double complex w = a->w[j];
            double r = a->residual[j], c = a->condition[j];
            a->w[j] = a->w[j - 1], a->w[j - 1] = w;
            a->residual[j] = a->residual[j - 1], a->residual[j - 1] = r;
            a->condition[j] = a->condition[j - 1], a->condition[j - 1] = c;
            cblas_zswap((int)n, a->V + (size_t)j * n, 1, a->V + (size_t)(j - 1) * n, 1);
        }
}

/* Grows until WANTED have settled, or all products are made. */
static enum modal_status run(struct subspace *s, int wanted, double tolerance, int even,
                             struct arnoldi *out, struct modal_error *err)
{
    int next = LOOK_FIRST * wanted, looked = 0;
    double before = HUGE_VAL;
    enum modal_status rc = MODAL_OK;

    begin(s);
    while (rc == MODAL_OK && !out->settled && s->m < s->end) {
        int carried;

        rc = grow(s, err);
        if (rc != MODAL_OK || (s->m < next && !s->whole && s->m < s->end))
            continue;
        rc = look(s, wanted, tolerance, out, err);
        next = next_look(s->m, out->worst, looked, before, tolerance);
        looked = s->m;
        before = out->worst;
        if (rc != MODAL_OK || s->before > 0 || s->whole || TRIED * s->m < even || even == 0
            || !(out->worst >= FALLING))
            continue;
        carried = carried_most(s, out);
        if (carried < s->m)                  /* little is spared beside what is let go */
            continue;
        rc = begin_again(s, carried, err);
        next = LOOK_FIRST * wanted;
        looked = 0;
        before = HUGE_VAL;
    }
    return rc;
}

enum modal_status arnoldi(const struct linear_operator *A, int wanted, double tolerance, int most,
                          int even, struct arnoldi *out, struct modal_error *err)
{
    int limit = most > 0 && most < ARNOLDI_MOST ? most : ARNOLDI_MOST;
    struct subspace s = { .A = A, .n = A->n, .most = A->n < limit ? A->n : limit,
                          .limit = limit };
    size_t n = (size_t)A->n, room = (size_t)s.most, values = (size_t)wanted + 1;
    enum modal_status rc = MODAL_OK;

    *out = (struct arnoldi){ .w = calloc(values, sizeof *out->w),
                             .residual = calloc(values, sizeof *out->residual),
                             .condition = calloc(values, sizeof *out->condition),
                             .V = calloc(values * n, sizeof *out->V) };
    s.end = s.most;
    s.V = calloc(n * (room + 1), sizeof *s.V);
    s.H = calloc((room + 1) * room, sizeof *s.H);
    s.h = calloc(room + 1, sizeof *s.h);
    if (out->w == NULL || out->residual == NULL || out->condition == NULL || out->V == NULL
        || s.V == NULL || s.H == NULL || s.h == NULL)
        rc = no_memory(err);
    if (rc == MODAL_OK)
        rc = run(&s, wanted, tolerance, even, out, err);
    out->vectors = s.m;
    out->products = s.before + s.m;
    sort(out, n);
    free(s.V);
    free(s.H);
    free(s.h);
    if (rc != MODAL_OK)
        arnoldi_done(out);
    return rc;
}

void arnoldi_done(struct arnoldi *a)
{
    free(a->w);
    free(a->residual);
    free(a->condition);
    free(a->V);
    *a = (struct arnoldi){ 0 };
}
