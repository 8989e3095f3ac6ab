/*
 * condense_basis.c - many linear dofs by one basis for all harmonics and frequencies; see
 * condense_state.h; tested by tests/unit/modal/steady/test_condense_basis.c
 *
 * With L(s) = L_rr of condense.h, symmetric, and B(s) = [L_rq, e_w, P_r], e_w the unit loads on the
 * dofs wanted, a rational Krylov basis [R84]: V orthonormal, of the solutions L(s_j)^-1 B(s_j) at
 * some s_j, real and imaginary parts apart.  At another s
 *
 *     L^ = V^T L V,   Y = V L^ ^-1 V^T B,   B^T L^-1 B = B^T Y + E,   E_ij = R_i^T L^-1 R_j,    (1)
 *
 * R = B - L Y: what is left of S, p and the rows wanted is of the square of what Y leaves.  So
 *
 *     |E_ij| <= |L^-1| |R_i| |R_j|,   |L^-1| about |L^ ^-1|_1,   |R_j|^2 about the mean of
 *     |theta^T R_j|^2 over SIGNS vectors theta of random signs,                                 (2)
 *
 * whose products with L V are made with V: nothing of r entries is touched at an s that V serves.
 * Where (2) exceeds the tolerance L is factored, and its solutions join V.  A basis that is full
 * begins anew, from the frequency at hand; one that serves less often than it fails is given up,
 * and so is one, half full, that holds every harmonic of a frequency and serves none of the next:
 * among many resonances it would be full before it served, at four times the cost.
 *
 * [R84] Ruhe, Rational Krylov sequence methods for eigenvalue computation, Linear Algebra Appl. 58
 * (1984) 391-405.
 */
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/sparse_lu.h"
#include "modal/numbers.h"
#include "modal/steady/budget.h"
#include "modal/steady/condense_state.h"
#include "modal/steady/pattern.h"

enum {
    SIGNS = 16              /* the mean of so many squares is off by a third */
};
/* Numbers of V: 512 MB. */
static const size_t NUMBERS_MOST = (size_t)1 << 26;
/* Of what the tolerance allows, what V may lack of solutions that it was made of. */
static const double SHARE = 0.1;
/* Where an estimate asks, which needs a digit or two: S^-1 F has them still where S's condition is
 * 100. */
static const double ROUGH = 1e-4;
/* The least reciprocal condition of L^ that tells anything. */
static const double CONDITION = 64 * DBL_EPSILON;

struct condense_basis {
    double tolerance;
    int r, q, duals, columns;       /* columns of B: q + duals + 1 */
    int m, most;                    /* of V now, at most; most 0: not yet known */
    int served, failed;             /* harmonics, since V was empty */
    int highest;                    /* asked for */
    double *V, *A[3], *B[3];        /* r x most; V^T A V, V^T A_rq: most rows */
    double *theta;                  /* SIGNS x r */
    double *seen[3], *right[3];     /* theta^T A V, theta^T A_rq: SIGNS rows */
    double *Z;                      /* r x 2 columns: those that join */
    double complex *L, *G, *Y;      /* L^; V^T B and its solutions, most x columns */
    double complex *work, *left;    /* 2 most; theta^T R, SIGNS x columns */
    double *scratch, *size;         /* most x 2 columns and reals of zgecon; |R_j| */
    int *pivot, *dual;              /* the dofs of e_w */
    struct workspace space, held;   /* of the arrays of B; of those whose size is known with most */
};

/* Signs by a hash of their places [SplitMix64], the same on every machine. */
static void draw_signs(struct condense_basis *b)
{
    for (size_t i = 0; i < (size_t)b->r; i++) {
        uint64_t z = ((uint64_t)i + 1) * 0x9e3779b97f4a7c15u;

        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        z ^= z >> 31;
        for (size_t j = 0; j < SIGNS; j++)
            b->theta[i * SIGNS + j] = (z >> j & 1) != 0 ? 1 : -1;
    }
}

/* Those of a row. */
static const double *signs_of(const struct condense_basis *b, int row)
{
    return b->theta + (size_t)row * SIGNS;
}

/* y = A_rr x of matrix T. */
static void multiply(const struct condense *c, int t, const double *x, double *y)
{
    const struct sparse *a = &c->p->constant[t];

    memset(y, 0, (size_t)c->r * sizeof *y);
    for (int i = 0; i < a->m; i++)
        for (int e = c->spot[i] >= 0 ? a->start[i] : a->start[i + 1]; e < a->start[i + 1]; e++)
            if (c->spot[a->index[e]] >= 0)
                y[c->spot[i]] += a->value[e] * x[c->spot[a->index[e]]];
}

enum modal_status condense_basis_new(struct condense *c, double tolerance,
                                     struct modal_error *err)
{
    struct condense_basis *b;

    if ((b = c->basis = calloc(1, sizeof *b)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "condense: no memory for a basis");
    b->tolerance = tolerance;
    b->r = c->r;
    b->q = c->q;
    b->duals = c->seats;
    b->columns = b->q + b->duals + 1;
    b->dual = workspace_zeros(&b->space, (size_t)b->duals, sizeof *b->dual);
    for (int i = 0; b->dual != NULL && i < c->n; i++)
        if (c->seat[i] >= 0)
            b->dual[c->seat[i]] = c->spot[i];
    b->Z = workspace_zeros(&b->space, (size_t)b->r * 2 * (size_t)b->columns, sizeof *b->Z);
    b->theta = workspace_zeros(&b->space, (size_t)b->r * SIGNS, sizeof *b->theta);
    if (b->theta != NULL)
        draw_signs(b);
    b->left = workspace_zeros(&b->space, (size_t)(SIGNS * b->columns), sizeof *b->left);
    b->size = workspace_zeros(&b->space, (size_t)b->columns, sizeof *b->size);
    for (int t = 0; t < 3 && !b->space.failed; t++) {
        const struct sparse *a = &c->p->constant[t];

        b->right[t] = workspace_zeros(&b->space, (size_t)(SIGNS * b->q), sizeof *b->right[t]);
        if (b->right[t] == NULL || a->start == NULL)
            continue;
        EACH_COUPLING(c, a, i, e)
            cblas_daxpy(SIGNS, a->value[e], signs_of(b, c->spot[i]), 1,
                        b->right[t] + c->place[a->index[e]] * SIGNS, 1);
    }
    return workspace_check(&b->space, "condense: no memory for a basis", err);
}

void condense_basis_free(struct condense *c)
{
    if (c->basis == NULL)
        return;
    workspace_free(&c->basis->held);
    workspace_free(&c->basis->space);
    free(c->basis);
    c->basis = NULL;
}

/* How many columns V may have: the 8/3 m^3 operations of L^ are as many as a factorization's, and
 * go ten times as fast (a full matrix's, of 10,000 dofs: 20 a nanosecond, and 2).  False: too few
 * for two frequencies, or no memory. */
static bool find_room(struct condense_basis *b, double factorization)
{
    size_t m, columns = (size_t)b->columns;

    b->most = (int)fmin(cbrt(3.0 / 8 * factorization), (double)(NUMBERS_MOST / (size_t)b->r));
    if (b->most < 4 * b->columns)
        return false;
    m = (size_t)b->most;
    b->V = workspace_zeros(&b->held, (size_t)b->r * m, sizeof *b->V);
    for (int t = 0; t < 3; t++) {
        b->A[t] = workspace_zeros(&b->held, m * m, sizeof *b->A[t]);
        b->B[t] = workspace_zeros(&b->held, m * (size_t)b->q, sizeof *b->B[t]);
        b->seen[t] = workspace_zeros(&b->held, m * SIGNS, sizeof *b->seen[t]);
    }
    b->L = workspace_zeros(&b->held, m * m, sizeof *b->L);
    b->G = workspace_zeros(&b->held, m * columns, sizeof *b->G);
    b->Y = workspace_zeros(&b->held, m * columns, sizeof *b->Y);
    b->work = workspace_zeros(&b->held, 2 * m, sizeof *b->work);
    b->scratch = workspace_zeros(&b->held, 2 * columns * m + 2 * m, sizeof *b->scratch);
    b->pivot = workspace_zeros(&b->held, m, sizeof *b->pivot);
    return !b->held.failed;
}

/* Z, WIDE columns, less what V has of it. */
static void leave_basis(struct condense_basis *b, double *Z, int wide)
{
    if (b->m == 0)
        return;
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, b->m, wide, b->r, 1, b->V, b->r, Z, b->r,
                0, b->scratch, b->m);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, b->r, wide, b->m, -1, b->V, b->r,
                b->scratch, b->m, 1, Z, b->r);
}

/* Column z to size 1; false where there is nothing of it. */
static bool to_unit(int r, double *z)
{
    double norm = cblas_dnrm2(r, z, 1);

    if (!(norm > 0) || !isfinite(norm))
        return false;
    cblas_dscal(r, 1 / norm, z, 1);
    return true;
}

/* Of the WIDE columns of Z, of size 1, those that have more than DEPENDENT beside the ones before:
 * orthonormal, first; how many. */
static int part(struct condense_basis *b, int wide, double dependent)
{
    size_t r = (size_t)b->r;
    int kept = 0;

    for (int j = 0; j < wide; j++) {
        double *z = b->Z + (size_t)kept * r;

        if (j > kept)
            memcpy(z, b->Z + (size_t)j * r, r * sizeof *z);
        for (int pass = 0; pass < 2 && kept > 0; pass++) {
            cblas_dgemv(CblasColMajor, CblasTrans, b->r, kept, 1, b->Z, b->r, z, 1, 0, b->scratch,
                        1);
            cblas_dgemv(CblasColMajor, CblasNoTrans, b->r, kept, -1, b->Z, b->r, b->scratch, 1, 1,
                        z, 1);
        }
        kept += cblas_dnrm2(b->r, z, 1) > dependent && to_unit(b->r, z);
    }
    return kept;
}

/* The WIDE columns of Z, of size 1 each, orthonormal and without V: those that are left, first.
 * Twice, as what is little and comes to size 1 brings its rounding along. */
static int make_orthonormal(struct condense_basis *b, int wide)
{
    double dependent = SHARE * b->tolerance;

    leave_basis(b, b->Z, wide);
    wide = part(b, wide, dependent);
    leave_basis(b, b->Z, wide);
    return part(b, wide, dependent);
}

/* The first KEPT columns of Z join V, with their products. */
static void join(struct condense *c, int kept)
{
    struct condense_basis *b = c->basis;
    int old = b->m, m = old + kept;
    size_t r = (size_t)b->r, most = (size_t)b->most;

    memcpy(b->V + (size_t)old * r, b->Z, (size_t)kept * r * sizeof *b->V);
    b->m = m;
    for (int t = 0; t < 3; t++) {
        const struct sparse *a = &c->p->constant[t];
        double *A = b->A[t] + (size_t)old * most;

        for (int j = old; j < m; j++)
            for (int i = 0; i < b->q; i++)
                b->B[t][(size_t)i * most + (size_t)j] = 0;
        if (a->start == NULL)
            continue;
        EACH_COUPLING(c, a, i, e)
            for (int j = old; j < m; j++)
                b->B[t][(size_t)c->place[a->index[e]] * most + (size_t)j] +=
                    a->value[e] * b->V[(size_t)j * r + (size_t)c->spot[i]];
        for (int j = 0; j < kept; j++)
            multiply(c, t, b->V + (size_t)(old + j) * r, b->Z + (size_t)j * r);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, m, kept, b->r, 1, b->V, b->r, b->Z,
                    b->r, 0, A, b->most);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, SIGNS, kept, b->r, 1, b->theta,
                    SIGNS, b->Z, b->r, 0, b->seen[t] + (size_t)old * SIGNS, SIGNS);
        for (int j = old; j < m; j++)
            for (int i = 0; i < j; i++)
                b->A[t][(size_t)i * most + (size_t)j] = b->A[t][(size_t)j * most + (size_t)i];
    }
}

/* Real and imaginary parts of solution x into the next columns of Z, those that are not 0. */
static int take(struct condense_basis *b, const double complex *x, int wide)
{
    for (int part = 0; part < 2; part++) {
        double *z = b->Z + (size_t)wide * (size_t)b->r;

        for (int i = 0; i < b->r; i++)
            z[i] = part == 0 ? creal(x[i]) : cimag(x[i]);
        wide += to_unit(b->r, z);
    }
    return wide;
}

void condense_basis_join(struct condense *c)
{
    struct condense_basis *b = c->basis;
    double complex *unit = c->right;                    /* its first column, read by then */
    int wide = 0;

    if (b->most == 0 && !find_room(b, sparse_lu_work(c->factors))) {
        condense_basis_free(c);
        return;
    }
    if (b->served == 0 && b->failed > b->highest && b->m > b->most / 2) {
        condense_basis_free(c);
        return;
    }
    b->failed++;
    for (int j = 0; j <= b->q; j++)
        wide = take(b, c->right + (size_t)j * (size_t)c->order, wide);
    for (int w = 0; w < b->duals; w++) {
        memset(unit, 0, (size_t)c->order * sizeof *unit);
        unit[b->dual[w]] = 1;
        sparse_lu_solve(c->factors, unit, c->column);
        wide = take(b, c->column, wide);
    }
    wide = make_orthonormal(b, wide);
    if (b->m + wide > b->most && b->served < b->failed) {
        condense_basis_free(c);
        return;
    }
    if (b->m + wide > b->most)
        b->m = b->served = b->failed = 0;               /* from here on */
    join(c, wide);
}

/* V^T B of harmonic K. */
static void project(struct condense *c, int k, double s)
{
    struct condense_basis *b = c->basis;
    size_t most = (size_t)b->most;
    double complex f[3] = { factor_of(0, s), factor_of(1, s), factor_of(2, s) };

    memset(b->G, 0, most * (size_t)b->columns * sizeof *b->G);
    for (size_t j = 0; j < (size_t)b->q; j++)
        for (size_t i = 0; i < (size_t)b->m; i++)
            b->G[j * most + i] = f[0] * b->B[0][j * most + i] + f[1] * b->B[1][j * most + i]
                                 + f[2] * b->B[2][j * most + i];
    for (int w = 0; w < b->duals; w++)
        for (int i = 0; i < b->m; i++)
            b->G[(size_t)(b->q + w) * most + (size_t)i] =
                b->V[(size_t)i * (size_t)b->r + (size_t)b->dual[w]];
    for (int l = 0; l < c->loads; l++)
        for (int i = 0; c->load[l].k == k && c->spot[c->load[l].dof] >= 0 && i < b->m; i++)
            b->G[(size_t)(b->columns - 1) * most + (size_t)i] +=
                c->load[l].value * b->V[(size_t)i * (size_t)b->r
                                        + (size_t)c->spot[c->load[l].dof]];
}

/* |R_j| of (2). */
static void find_residuals(struct condense *c, int k, double s)
{
    struct condense_basis *b = c->basis;
    int last = b->columns - 1;

    memset(b->left, 0, (size_t)(SIGNS * b->columns) * sizeof *b->left);
    for (int t = 0; t < 3; t++) {
        double complex f = factor_of(t, s);

        for (int j = 0; j < b->columns; j++)
            for (int i = 0; i < b->m; i++) {
                double complex y = f * b->Y[(size_t)j * (size_t)b->most + (size_t)i];

                for (int h = 0; h < SIGNS; h++)
                    b->left[j * SIGNS + h] -= b->seen[t][i * SIGNS + h] * y;
            }
        for (int j = 0; j < SIGNS * b->q; j++)
            b->left[j] += f * b->right[t][j];
    }
    for (int w = 0; w < b->duals; w++)
        for (int h = 0; h < SIGNS; h++)
            b->left[(b->q + w) * SIGNS + h] += signs_of(b, b->dual[w])[h];
    for (int l = 0; l < c->loads; l++)
        for (int h = 0; c->load[l].k == k && c->spot[c->load[l].dof] >= 0 && h < SIGNS; h++)
            b->left[last * SIGNS + h] +=
                c->load[l].value * signs_of(b, c->spot[c->load[l].dof])[h];
    for (int j = 0; j < b->columns; j++)
        b->size[j] = cblas_dznrm2(SIGNS, b->left + j * SIGNS, 1) / sqrt(SIGNS);
}

/* S, p and the rows wanted of (1) into H, S and p with the kept dofs' own in them already. */
static void answer(struct condense *c, struct condense_harmonic *h)
{
    struct condense_basis *b = c->basis;
    size_t most = (size_t)b->most, seats = (size_t)c->seats;

    for (int j = 0; j <= b->q; j++) {
        const double complex *y = b->Y + (size_t)(j < b->q ? j : b->columns - 1) * most;
        double complex *out = j < b->q ? h->S + (size_t)j * (size_t)b->q : h->p;

        for (int i = 0; i < b->q; i++)
            for (int e = 0; e < b->m; e++)
                out[i] -= b->G[(size_t)i * most + (size_t)e] * y[e];
        for (int i = 0; i < c->n; i++)
            if (c->seat[i] >= 0) {
                double complex sum = 0;

                for (int e = 0; e < b->m; e++)
                    sum += b->V[(size_t)e * (size_t)b->r + (size_t)c->spot[i]] * y[e];
                h->row[(size_t)j * seats + (size_t)c->seat[i]] = sum;
            }
    }
}

double condense_harmonic_doubt(const struct condense *c, int k, const struct condense_harmonic *h,
                               const double *size, int last)
{
    double stiff = numbers_modulus(h->S, (size_t)c->q * (size_t)c->q), load = 0, moved, kept = 0,
           wanted = 0, loaded = size[last];

    for (int l = 0; l < c->loads; l++)
        load = c->load[l].k == k ? fmax(load, cabs(c->load[l].value)) : load;
    moved = fmax(numbers_modulus(h->row + (size_t)c->seats * (size_t)c->q, (size_t)c->seats),
                 load / stiff);
    for (int j = 0; j < c->q; j++)
        kept = fmax(kept, size[j]);
    for (int j = c->q; j < c->q + c->seats; j++)
        wanted = fmax(wanted, size[j]);
    return fmax(fmax(kept * kept / stiff, kept * wanted),
                loaded > 0 ? loaded * fmax(kept / load, wanted / moved) : 0);
}

/* Y = L^ ^-1 V^T B, L^ factored; |L^ ^-1|, 0: it is singular to rounding. */
static double solve_full(struct condense *c, double s)
{
    struct condense_basis *b = c->basis;
    size_t most = (size_t)b->most;
    double complex f[3] = { factor_of(0, s), factor_of(1, s), factor_of(2, s) };
    double norm = 0, condition = 0, m = b->m;

    for (size_t j = 0; j < (size_t)b->m; j++)
        for (size_t i = 0; i < (size_t)b->m; i++)
            b->L[j * most + i] = f[0] * b->A[0][j * most + i] + f[1] * b->A[1][j * most + i]
                                 + f[2] * b->A[2][j * most + i];
    for (int j = 0; j < b->m; j++)
        norm = fmax(norm, cblas_dzasum(b->m, b->L + (size_t)j * most, 1));
    memcpy(b->Y, b->G, most * (size_t)b->columns * sizeof *b->Y);
    c->work += 8 * m * m * (m / 3 + b->columns) / BUDGET_DENSE;
    if (LAPACKE_zgetrf_work(LAPACK_COL_MAJOR, b->m, b->m, b->L, b->most, b->pivot) != 0
        || LAPACKE_zgecon_work(LAPACK_COL_MAJOR, '1', b->m, b->L, b->most, norm, &condition,
                               b->work, b->scratch) != 0
        || !(condition > CONDITION))
        return 0;
    LAPACKE_zgetrs_work(LAPACK_COL_MAJOR, 'N', b->m, b->columns, b->L, b->most, b->pivot, b->Y,
                        b->most);
    return 1 / (condition * norm);
}

/* Harmonic K by V as it is into H, to TOLERANCE; false: it does not serve. */
static bool serves(struct condense *c, int k, double tolerance, struct condense_harmonic *h)
{
    struct condense_basis *b = c->basis;
    double s = k * c->omega, inverse;

    project(c, k, s);
    inverse = solve_full(c, s);
    if (!(inverse > 0))
        return false;
    find_residuals(c, k, s);
    memset(h->S, 0, (size_t)(b->q * b->q) * sizeof *h->S);
    memset(h->p, 0, (size_t)b->q * sizeof *h->p);
    condense_kept_block(c, s, h->S);
    for (int l = 0; l < c->loads; l++)
        if (c->load[l].k == k && c->place[c->load[l].dof] >= 0)
            h->p[c->place[c->load[l].dof]] += c->load[l].value;
    answer(c, h);
    h->doubt = inverse * condense_harmonic_doubt(c, k, h, b->size, b->columns - 1);
    return h->doubt <= tolerance;
}

bool condense_basis_answer(struct condense *c, int k, bool rough, struct condense_harmonic *h)
{
    struct condense_basis *b = c->basis;

    if (!rough)
        b->highest = k > b->highest ? k : b->highest;
    if (k == 0 || b->m == 0
        || !serves(c, k, rough ? fmax(ROUGH, b->tolerance) : b->tolerance, h))
        return false;
    h->rough = h->doubt > b->tolerance;
    b->served++;
    return true;
}
