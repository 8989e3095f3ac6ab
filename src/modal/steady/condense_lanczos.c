/*
 * condense_lanczos.c - many linear dofs whose damping is in proportion: all harmonics and
 * frequencies of a curve by one real factorization; see condense_state.h; tested by
 * tests/unit/modal/steady/test_condense_basis.c
 *
 * Where C = alpha M + beta K and A_0 is positive, L(s) = L_rr of condense.h is
 *
 *     L = a A_0 + c M_rr,   A_0 = K_rr + sigma^2 M_rr,
 *     a = 1 + i beta s,     c = i alpha s - s^2 - a sigma^2,                                   (1)
 *
 * and what is asked for are the numbers F^T L^-1 F,
 *
 *     F = [L_rq, e_w, P_r] = B Phi(s),   B = [K_rq, M_rq, e_w, P_r],                           (2)
 *
 * e_w the unit loads on the dofs wanted, P_r the loads of each harmonic, real and imaginary parts
 * apart.  With A_0 = R^T R, N = R^-T M_rr R^-1 is symmetric, F^T L^-1 F = F~^T (a + c N)^-1 F~,
 * F~ = R^-T F, and block Lanczos, begun at R^-T B = Q_1 R_1,
 *
 *     N Q_j = Q_j-1 B_j^T + Q_j A_j + Q_j+1 B_j+1,                                             (3)
 *
 * serves every s: a + c T_j, T_j block tridiagonal of the A and B, is eliminated block by block,
 *
 *     D_1 = a + c A_1,     D_j+1 = a + c A_j+1 - c^2 B_j+1 D_j^-1 B_j+1^T,
 *     P_1 = R_1 Phi,       P_j+1 = -c B_j+1 D_j^-1 P_j,
 *     F^T L^-1 F = sum_i P_i^T D_i^-1 P_i + E,   E = P_j+1^T Q_j+1^T (a + c N)^-1 Q_j+1 P_j+1,  (4)
 *     |E_mn| <= |P_j+1 e_m| |P_j+1 e_n| / min |a + c theta|,                                   (5)
 *
 * theta the eigenvalues of N: j blocks match 2 j moments about sigma [FF95].  The least of (5) is
 * that over all theta >= 0, or where this is 0 (without damping) over those of T_j.  Steps are
 * made until (5) is met; (4) goes on where it stood.  Three blocks of vectors are held and no
 * basis: once resonances are found vectors lose their orthogonality and find them again, which
 * costs steps and no digits [G89].
 *
 * [FF95] Feldmann and Freund, Efficient linear circuit analysis by Pade approximation via the
 * Lanczos process, IEEE Trans. CAD 14 (1995) 639-649.
 * [G89] Greenbaum, Behavior of slightly perturbed Lanczos and conjugate-gradient recurrences,
 * Linear Algebra Appl. 113 (1989) 7-63.
 */
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/sparse_cholesky.h"
#include "modal/linalg/sparse_lu.h"
#include "modal/numbers.h"
#include "modal/steady/budget.h"
#include "modal/steady/condense_state.h"
#include "modal/steady/pattern.h"

enum {
    DUALS_MOST = 32,        /* dofs wanted, each of which is one more column of B */
    FASTER = 5,             /* products of full matrices, of 10,000 rows: 20 operations a ns */
    GROWTH = 8,             /* an eighth of the steps is made before s is asked anew */
    STEP = 1000,            /* of budget.h: a microsecond, of the calls that a step of (4) makes */
    PRODUCTS = 8,           /* r x wide x wide in a step: (3), and Q's factors */
    REDUCTION = 12          /* n x n x reach: a band to its eigenvalues, 6 and as much by rotations */
};
/* Entries off symmetry by less, relative, are symmetric: rounding of an assembly. */
static const double SYMMETRIC = 1e-12;
/* sigma over the s first asked for, the highest that is solved for.  Polynomials in theta = 1 /
 * (lambda + sigma^2), of all theta in 0 .. 1 / sigma^2, part neighbours at lambda = s^2 as well as
 * s sigma / (s^2 + sigma^2) is large: at s by half, as well at three times s, for an error, as at s
 * itself with sqrt 3; and at s / 3 by half of that. */
static const double SHIFT = 1.7;
/* Of what factors would cost along all points, what (3) may. */
static const double VENTURE = 0.5;
/* What S^-1 F may be off by, relative and by (5), where an estimate asks: it needs a digit or two.
 */
static const double ROUGH = 0.03;
/* The least |a + c theta| that tells anything. */
static const double CONDITION = 64 * DBL_EPSILON;
/* What a column of (3) has beside the others, over |N|, below which it is their rounding. */
static const double DEPENDENT = 1e-13;
/* Cholesky's pivots over the largest size of a column: above REGULAR columns are orthonormal to a
 * thousand roundings, above TWICE a second factorization makes them so. */
static const double REGULAR = 0.03;
static const double TWICE = 1e-5;

/* Q_j has WIDE columns; A_j; B_j+1, `next` x wide, in columns of `wide`, next <= wide. */
struct step { int wide, next; double *A, *B; };

struct condense_lanczos {
    double tolerance, alpha, beta, sigma2;
    int r, q, duals, answers;       /* answers: columns of F, q + duals + 1 */
    bool massive;                   /* M_rq is not 0 */
    int sides;                      /* columns of B */
    struct sparse_cholesky *factors;    /* of A_0; NULL: before the first question */
    struct sparse M;                /* M_rr in the factors' order; its arrays are `space`'s */
    double *Q[3];                   /* r x sides: of the last step, of this, of the next */
    double *R;                      /* R_1, step[0].wide x sides, in columns of `sides` */
    struct step *step;
    int steps, places;
    double scale;                   /* of N: the largest entry of an A_j */
    bool ended;                     /* no more steps */
    int points, asked;              /* that follow; harmonics of the first of them */
    double first;                   /* rad/s: of the first */
    double spent, once;             /* operations, of all of it; of one factorization of L */
    int served, failed;             /* harmonics */
    double *small, *column;         /* 2 sides x sides; r */
    double complex *D, *X, *P, *G;  /* sides x sides, x (answers + sides), x answers; answers^2 */
    int *pivot;
    double *size;                   /* |P_j+1 e_m| of (5) */
    double *theta;                  /* eigenvalues of T_j, ascending */
    int thetas, thetas_of;          /* how many, of how many steps; 0: not known */
    struct workspace space, blocks;     /* of the arrays; of A and B */
};

static void drop(struct condense *c)
{
    struct condense_lanczos *l = c->lanczos;

    sparse_cholesky_free(l->factors);
    workspace_free(&l->space);
    workspace_free(&l->blocks);
    free(l->step);
    free(l->theta);
    free(l);
    c->lanczos = NULL;
}

void condense_lanczos_free(struct condense *c)
{
    if (c->lanczos != NULL)
        drop(c);
}

/* Whether anything of harmonic K loads the linear dofs. */
static bool has_load(const struct condense *c, int k)
{
    for (int l = 0; l < c->loads; l++)
        if (c->load[l].k == k && c->spot[c->load[l].dof] >= 0)
            return true;
    return false;
}

/* Each entry of A_rq of matrix T: (row among the linear, column among the kept). */
#define EACH_COUPLING(c, a, i, e) \
    for (int i = 0; i < (a)->m; i++) \
        for (int e = (c)->spot[i] >= 0 ? (a)->start[i] : (a)->start[i + 1]; \
             e < (a)->start[i + 1]; e++) \
            if ((c)->place[(a)->index[e]] >= 0)

enum modal_status condense_share(struct condense *c, double tolerance, int points,
                                 struct modal_error *err)
{
    struct condense_lanczos *l;
    const struct sparse *M = &c->p->constant[PROGRAM_M];
    double alpha, beta;

    if (!c->sparse || c->q == 0 || c->seats > DUALS_MOST || c->basis != NULL || c->lanczos != NULL)
        return MODAL_OK;
    for (int t = 0; t < 3; t++)
        if (c->p->constant[t].start != NULL && !sparse_symmetric(&c->p->constant[t], SYMMETRIC))
            return MODAL_OK;
    if (points <= 1 || !condense_proportional(c, &alpha, &beta))
        return condense_basis_new(c, tolerance, err);
    if ((l = c->lanczos = calloc(1, sizeof *l)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "condense: no memory for a curve");
    *l = (struct condense_lanczos) { .tolerance = tolerance, .alpha = alpha, .beta = beta,
                                     .r = c->r, .q = c->q, .duals = c->seats,
                                     .answers = c->q + c->seats + 1, .points = points };
    if (M->start != NULL)
        EACH_COUPLING(c, M, i, e)
            l->massive = true;
    l->sides = (l->massive ? 2 : 1) * l->q + l->duals;
    for (int k = 0; k <= c->highest; k++)
        l->sides += has_load(c, k) ? 2 : 0;
    return MODAL_OK;
}

/* A_0 factored; NULL where it is not positive, or no memory. */
static struct sparse_cholesky *factor_real(const struct condense *c, double sigma2)
{
    struct pattern *pattern = NULL;
    struct sparse_cholesky *out = NULL;
    double *value = NULL;

    if (pattern_new(c->p, c->spot, c->r, false, &pattern, NULL) != MODAL_OK)
        return NULL;
    value = calloc((size_t)pattern_entries(pattern) + 1, sizeof *value);
    for (int t = 0; t < 3 && value != NULL; t++) {
        const struct sparse *a = &c->p->constant[t];
        double by = t == PROGRAM_K ? 1 : t == PROGRAM_M ? sigma2 : 0;

        for (int i = 0; by != 0 && a->start != NULL && i < a->m; i++)
            for (int e = a->start[i]; e < a->start[i + 1]; e++)
                if (c->spot[i] >= 0 && c->spot[a->index[e]] >= 0)
                    value[pattern_find(pattern, c->spot[i], c->spot[a->index[e]])] +=
                        by * a->value[e];
    }
    if (value != NULL
        && sparse_cholesky_new(c->r, pattern->start, pattern->index, value, &out, NULL) != MODAL_OK)
        out = NULL;
    free(value);
    pattern_free(pattern);
    return out;
}

/* M_rr in the order of the factors, whose row ROW[i] is the linear dof i's. */
static void order_mass(const struct condense *c, const int *row, struct condense_lanczos *l)
{
    const struct sparse *a = &c->p->constant[PROGRAM_M];
    size_t entries = a->start != NULL ? (size_t)a->start[a->m] : 0;
    int *start = workspace_zeros(&l->space, (size_t)l->r + 1, sizeof *start),
        *index = workspace_room(&l->space, entries + 1, sizeof *index);
    double *value = workspace_room(&l->space, entries + 1, sizeof *value);

    l->M = (struct sparse) { l->r, l->r, start, index, value };
    if (l->space.failed)
        return;
    for (int i = 0; entries > 0 && i < c->n; i++)
        for (int e = a->start[i]; c->spot[i] >= 0 && e < a->start[i + 1]; e++)
            start[row[c->spot[i]] + 1] += c->spot[a->index[e]] >= 0;
    for (int i = 0; i < l->r; i++)
        start[i + 1] += start[i];
    for (int i = 0; entries > 0 && i < c->n; i++) {
        int at = c->spot[i] >= 0 ? start[row[c->spot[i]]] : 0;

        for (int e = a->start[i]; c->spot[i] >= 0 && e < a->start[i + 1]; e++)
            if (c->spot[a->index[e]] >= 0) {
                index[at] = row[c->spot[a->index[e]]];
                value[at++] = a->value[e];
            }
    }
}

/* B of (2) into Z, in the order of the factors. */
static void right_sides(const struct condense *c, const int *row, double *Z)
{
    const struct condense_lanczos *l = c->lanczos;
    size_t r = (size_t)l->r;
    int wide = (l->massive ? 2 : 1) * l->q;

    for (int t = PROGRAM_M; t <= PROGRAM_K; t += PROGRAM_K - PROGRAM_M) {
        const struct sparse *a = &c->p->constant[t];

        if (a->start != NULL)
            EACH_COUPLING(c, a, i, e)
                Z[(size_t)((t == PROGRAM_M ? l->q : 0) + c->place[a->index[e]]) * r
                  + (size_t)row[c->spot[i]]] += a->value[e];
    }
    for (int i = 0; i < c->n; i++)
        if (c->seat[i] >= 0)
            Z[(size_t)(wide + c->seat[i]) * r + (size_t)row[c->spot[i]]] = 1;
    wide += l->duals;
    for (int k = 0; k <= c->highest; k++) {
        for (int i = 0; i < c->loads; i++)
            if (c->load[i].k == k && c->spot[c->load[i].dof] >= 0) {
                double *z = Z + (size_t)wide * r + row[c->spot[c->load[i].dof]];

                z[0] += creal(c->load[i].value);
                z[r] += cimag(c->load[i].value);
            }
        wide += has_load(c, k) ? 2 : 0;
    }
}

/* The WIDE columns of Z to Q R, those that have more than LEAST (of their own size where RELATIVE)
 * beside the ones before: how many.  R in columns of LD. */
static int part(struct condense_lanczos *l, double *Z, int wide, double least, bool relative,
                double *R, int ld)
{
    size_t r = (size_t)l->r;
    int kept = 0;

    for (int j = 0; j < wide; j++) {
        double *z = Z + (size_t)kept * r, *h = R + (size_t)j * (size_t)ld, size;
        double bound = least * (relative ? cblas_dnrm2(l->r, Z + (size_t)j * r, 1) : 1);

        memset(h, 0, (size_t)wide * sizeof *h);
        if (j > kept)
            memcpy(z, Z + (size_t)j * r, r * sizeof *z);
        for (int pass = 0; pass < 2 && kept > 0; pass++) {
            cblas_dgemv(CblasColMajor, CblasTrans, l->r, kept, 1, Z, l->r, z, 1, 0, l->small, 1);
            cblas_dgemv(CblasColMajor, CblasNoTrans, l->r, kept, -1, Z, l->r, l->small, 1, 1, z,
                        1);
            cblas_daxpy(kept, 1, l->small, 1, h, 1);
        }
        size = cblas_dnrm2(l->r, z, 1);
        if (size > bound && isfinite(size)) {
            cblas_dscal(l->r, 1 / size, z, 1);
            h[kept++] = size;
        }
    }
    return kept;
}

/* The same by Cholesky's factors of Z^T Z, once more where these are not REGULAR; false: they are
 * singular, nearly, and Z is as it was. */
static bool part_at_once(struct condense_lanczos *l, double *Z, int wide, double *R, int ld)
{
    size_t w = (size_t)wide;
    double *G = l->small, *second = l->small + (size_t)l->sides * (size_t)l->sides, most = 0,
           least = 0;

    for (int pass = 0; pass < 2 && !(least > REGULAR * most); pass++) {
        double *to = pass == 0 ? G : second;

        cblas_dsyrk(CblasColMajor, CblasUpper, CblasTrans, wide, l->r, 1, Z, l->r, 0, to, wide);
        if (LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'U', wide, to, wide) != 0)
            return false;                               /* never at the second pass */
        for (size_t i = 0; pass == 0 && i < w; i++) {
            most = fmax(most, cblas_dnrm2((int)i + 1, G + i * w, 1));   /* a column's size */
            least = i == 0 ? G[0] : fmin(least, G[i * (w + 1)]);
        }
        if (!(least > TWICE * most))
            return false;
        cblas_dtrsm(CblasColMajor, CblasRight, CblasUpper, CblasNoTrans, CblasNonUnit, l->r, wide,
                    1, to, wide, Z, l->r);
    }
    if (!(least > REGULAR * most))
        cblas_dtrmm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, wide, wide,
                    1, second, wide, G, wide);
    for (size_t j = 0; j < w; j++)
        for (size_t i = 0; i < w; i++)
            R[j * (size_t)ld + i] = i <= j ? G[j * w + i] : 0;
    return true;
}

/* Operations of a factorization of L and its solutions: beside those of A_0 twice as many entries,
 * of complex numbers, four times the operations. */
static double once(const struct condense_lanczos *l)
{
    double fill = 2 * sparse_cholesky_fill(l->factors);

    return (8 * sparse_cholesky_flops(l->factors) + SPARSE_LU_ENTRY * fill) / BUDGET_DENSE
           + 8 * fill * l->answers;
}

/* Room for one step more; it has WIDE columns. */
static struct step *add_step(struct condense_lanczos *l, int wide)
{
    size_t w = (size_t)wide;
    struct step *s;

    if (l->steps == l->places) {
        int more = 2 * l->places + 16;

        s = realloc(l->step, (size_t)more * sizeof *s);
        if (s == NULL)
            return NULL;
        l->step = s;
        l->places = more;
    }
    s = &l->step[l->steps];
    *s = (struct step) { wide, 0, workspace_zeros(&l->blocks, w * w, sizeof *s->A),
                         workspace_zeros(&l->blocks, w * w, sizeof *s->B) };
    return l->blocks.failed ? NULL : s;
}

/* A_0 for S, and Q_1; false: there is no curve by it. */
static bool begin(struct condense *c, double s)
{
    struct condense_lanczos *l = c->lanczos;
    size_t sides = (size_t)l->sides, answers = (size_t)l->answers, r = (size_t)l->r;
    int *row, wide;
    const int *order;

    l->sigma2 = SHIFT * s * SHIFT * s;
    l->factors = factor_real(c, l->sigma2);
    if (l->factors == NULL)
        return false;
    l->once = once(l);
    order = sparse_cholesky_order(l->factors);
    row = workspace_room(&l->space, r, sizeof *row);
    for (int i = 0; i < 3; i++)
        l->Q[i] = workspace_zeros(&l->space, r * sides, sizeof *l->Q[i]);
    l->R = workspace_zeros(&l->space, sides * sides, sizeof *l->R);
    l->small = workspace_zeros(&l->space, 2 * sides * sides, sizeof *l->small);
    l->column = workspace_zeros(&l->space, r, sizeof *l->column);
    l->D = workspace_zeros(&l->space, sides * sides, sizeof *l->D);
    l->X = workspace_zeros(&l->space, sides * (answers + sides), sizeof *l->X);
    l->P = workspace_zeros(&l->space, sides * answers, sizeof *l->P);
    l->G = workspace_zeros(&l->space, 2 * answers * answers, sizeof *l->G);
    l->pivot = workspace_zeros(&l->space, sides, sizeof *l->pivot);
    l->size = workspace_zeros(&l->space, answers, sizeof *l->size);
    if (l->space.failed)
        return false;
    for (int i = 0; i < l->r; i++)
        row[order[i]] = i;
    order_mass(c, row, l);
    if (l->space.failed)
        return false;
    right_sides(c, row, l->Q[1]);
    if (!sparse_cholesky_half(l->factors, false, l->Q[1], l->sides))
        return false;
    wide = part(l, l->Q[1], l->sides, DEPENDENT, true, l->R, l->sides);
    return wide > 0 && add_step(l, wide) != NULL;
}

/* Operations that (3) may cost. */
static double ventured(const struct condense_lanczos *l)
{
    return VENTURE * l->points * l->asked * l->once;
}

/* W <- R^-T M_rr R^-1 W, WIDE columns. */
static bool apply(struct condense_lanczos *l, double *W, int wide)
{
    size_t r = (size_t)l->r;

    if (!sparse_cholesky_half(l->factors, true, W, wide))
        return false;
    for (int j = 0; j < wide; j++) {
        memset(l->column, 0, r * sizeof *l->column);
        sparse_multiply_add(&l->M, 1, W + (size_t)j * r, l->column);
        memcpy(W + (size_t)j * r, l->column, r * sizeof *W);
    }
    return sparse_cholesky_half(l->factors, false, W, wide);
}

/* A_j of Q, and W less its part of Q. */
static void take_diagonal(struct condense_lanczos *l, const double *Q, int wide, double *W,
                          double *A)
{
    size_t w = (size_t)wide;

    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, wide, wide, l->r, 1, Q, l->r, W, l->r, 0,
                A, wide);
    for (size_t j = 0; j < w; j++)
        for (size_t i = 0; i <= j; i++) {
            A[i * w + j] = A[j * w + i] = (A[i * w + j] + A[j * w + i]) / 2;
            l->scale = fmax(l->scale, fabs(A[i * w + j]));
        }
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, l->r, wide, wide, -1, Q, l->r, A, wide,
                1, W, l->r);
}

/* One step of (3); false: there is none, or no work or memory for it. */
static bool make_step(struct condense *c)
{
    struct condense_lanczos *l = c->lanczos;
    struct step *s = &l->step[l->steps];
    double *before = l->Q[0], *now = l->Q[1], *next = l->Q[2], work;
    int wide = s->wide;

    /* few columns: the factor is read for each step, at the rate of scattered numbers */
    work = wide * (4 * sparse_cholesky_fill(l->factors)
                   + (double)PRODUCTS * l->r * wide / (FASTER * BUDGET_DENSE));
    if (l->ended || l->spent + work > ventured(l))
        return false;
    l->spent += work;
    c->work += work;
    memcpy(next, now, (size_t)l->r * (size_t)wide * sizeof *next);
    l->ended = !apply(l, next, wide);
    if (l->ended)
        return false;
    if (l->steps > 0)
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, l->r, wide, s[-1].wide, -1, before,
                    l->r, s[-1].B, s[-1].wide, 1, next, l->r);
    take_diagonal(l, now, wide, next, s->A);
    s->next = part_at_once(l, next, wide, s->B, wide)
                  ? wide
                  : part(l, next, wide, DEPENDENT * l->scale, false, s->B, wide);
    l->Q[0] = now;
    l->Q[1] = next;
    l->Q[2] = before;
    wide = s->next;
    l->steps++;
    l->ended = wide == 0 || add_step(l, wide) == NULL;
    return true;
}

/* An eighth more steps; false: none is made. */
static bool grow(struct condense *c)
{
    struct condense_lanczos *l = c->lanczos;
    int before = l->steps, most = before + before / GROWTH + 1;

    while (l->steps < most && make_step(c))
        ;
    return l->steps > before;
}

/* The eigenvalues of T_j; false: no memory, or no work for them. */
static bool find_theta(struct condense *c)
{
    struct condense_lanczos *l = c->lanczos;
    int n = 0, reach = 0, at = 0;
    double *band, *theta, work;
    bool ok;

    for (int j = 0; j < l->steps; j++) {
        n += l->step[j].wide;
        reach = l->step[j].wide + l->step[j].next > reach ? l->step[j].wide + l->step[j].next
                                                          : reach;
    }
    work = REDUCTION * (double)n * n * reach / BUDGET_DENSE;
    if (l->spent + work > ventured(l))
        return false;
    l->spent += work;
    c->work += work;
    theta = realloc(l->theta, (4 * (size_t)n + 1) * sizeof *theta);
    band = calloc((size_t)n * (size_t)reach + 1, sizeof *band);
    l->theta = theta != NULL ? theta : l->theta;
    for (int j = 0; theta != NULL && band != NULL && j < l->steps; at += l->step[j++].wide) {
        const struct step *s = &l->step[j];

        for (int m = 0; m < s->wide; m++) {
            double *column = band + (size_t)(at + m) * (size_t)reach;

            for (int i = m; i < s->wide; i++)
                column[i - m] = s->A[m * s->wide + i];
            for (int i = 0; j + 1 < l->steps && i < s->next; i++)
                column[s->wide + i - m] = s->B[m * s->wide + i];
        }
    }
    ok = theta != NULL && band != NULL
         && LAPACKE_dsbev_work(LAPACK_COL_MAJOR, 'N', 'L', n, reach - 1, band, reach, theta, NULL,
                               n, theta + n) == 0;
    l->thetas = ok ? n : 0;
    l->thetas_of = ok ? l->steps : 0;
    free(band);
    return ok;
}

/* One s and the harmonic it is of: a and c of (1); steps of (4) that are done; of (5) the least so
 * far, and what is left without it; the largest part of S, and what rounding makes of S by it. */
struct at {
    int k, done;
    double s, least, left, most, rounded;
    double complex a, c;
};

/* Over all theta >= 0. */
static double least_of_all(const struct at *at)
{
    double complex turned = at->a * conj(at->c);

    return creal(turned) >= 0 ? cabs(at->a) : fabs(cimag(turned)) / cabs(at->c);
}

/* Over those of T_j; 0: it is not known. */
static double least_of_theta(struct condense *c, const struct at *at)
{
    const struct condense_lanczos *l = c->lanczos;
    double least = DBL_MAX;

    if (l->thetas_of != l->steps && !find_theta(c))
        return 0;
    for (int i = 0; i < l->thetas; i++)
        least = fmin(least, cabs(at->a + at->c * l->theta[i]));
    return least;
}

/* P_1 of (4). */
static void begin_sides(const struct condense *c, const struct at *at)
{
    struct condense_lanczos *l = c->lanczos;
    size_t w = (size_t)l->step[0].wide, sides = (size_t)l->sides, q = (size_t)l->q;
    const double *R = l->R;
    double complex by = CMPLX(1, l->beta * at->s), mass = CMPLX(-at->s * at->s, l->alpha * at->s),
                   *P = l->P;

    for (size_t j = 0; j < q; j++, R += sides, P += w)
        for (size_t i = 0; i < w; i++)
            P[i] = by * R[i] + (l->massive ? mass * R[q * sides + i] : 0);
    R += l->massive ? q * sides : 0;
    for (int j = 0; j < l->duals; j++, R += sides, P += w)
        for (size_t i = 0; i < w; i++)
            P[i] = R[i];
    memset(P, 0, w * sizeof *P);
    for (int k = 0; k <= c->highest; k++) {
        for (size_t i = 0; k == at->k && has_load(c, k) && i < w; i++)
            P[i] = CMPLX(R[i], R[sides + i]);
        R += has_load(c, k) ? 2 * sides : 0;
    }
}

/* Onto D, of step S: a + c A. */
static void add_diagonal(const struct step *s, const struct at *at, double complex *D)
{
    size_t w = (size_t)s->wide;

    for (size_t e = 0; e < w * w; e++)
        D[e] += at->c * s->A[e];
    for (size_t i = 0; i < w; i++)
        D[i * (w + 1)] += at->a;
}

/* Y <- by B X, X of COLUMNS. */
static void multiply_next(const struct step *s, double complex by, const double complex *X,
                          int columns, double complex *Y)
{
    size_t w = (size_t)s->wide, next = (size_t)s->next;

    memset(Y, 0, next * (size_t)columns * sizeof *Y);
    for (int j = 0; j < columns; j++)
        for (size_t m = 0; m < w; m++) {
            double complex x = by * X[(size_t)j * w + m];

            for (size_t i = 0; i < next; i++)
                Y[(size_t)j * next + i] += s->B[m * w + i] * x;
        }
}

/* Step S of (4): its part joins G, and P and D are those of the next, but for a + c A; the largest
 * entry of the part in S, or -1 where D is singular. */
static double eliminate(struct condense_lanczos *l, const struct step *s, const struct at *at)
{
    int n = l->answers, w = s->wide;
    size_t wide = (size_t)w, squares = (size_t)n * (size_t)n;
    double largest = 0;
    double complex one = 1, none = 0, *part = l->G + squares, *XB = l->X + wide * (size_t)n;

    memcpy(l->X, l->P, wide * (size_t)n * sizeof *l->X);
    for (size_t i = 0; i < (size_t)s->next; i++)
        for (size_t m = 0; m < wide; m++)
            XB[i * wide + m] = s->B[m * wide + i];
    if (LAPACKE_zgetrf_work(LAPACK_COL_MAJOR, w, w, l->D, w, l->pivot) != 0)
        return -1;
    LAPACKE_zgetrs_work(LAPACK_COL_MAJOR, 'N', w, n + s->next, l->D, w, l->pivot, l->X, w);
    cblas_zgemm(CblasColMajor, CblasTrans, CblasNoTrans, n, n, w, &one, l->P, w, l->X, w, &none,
                part, n);
    for (size_t e = 0; e < squares; e++)
        l->G[e] += part[e];
    multiply_next(s, -at->c, l->X, n, l->P);
    multiply_next(s, -at->c * at->c, XB, s->next, l->D);
    for (int j = 0; j < n; j++)
        l->size[j] = s->next > 0 ? cblas_dznrm2(s->next, l->P + (size_t)j * (size_t)s->next, 1) : 0;
    for (int j = 0; j < l->q; j++)
        largest = fmax(largest, numbers_modulus(part + (size_t)j * (size_t)n, (size_t)l->q));
    return largest;
}

/* S, p and the rows wanted of G into H. */
static void answer(struct condense *c, const struct at *at, struct condense_harmonic *h)
{
    const struct condense_lanczos *l = c->lanczos;
    size_t q = (size_t)l->q, n = (size_t)l->answers, seats = (size_t)c->seats;

    memset(h->S, 0, q * q * sizeof *h->S);
    memset(h->p, 0, q * sizeof *h->p);
    condense_kept_block(c, at->s, h->S);
    for (int i = 0; i < c->loads; i++)
        if (c->load[i].k == at->k && c->place[c->load[i].dof] >= 0)
            h->p[c->place[c->load[i].dof]] += c->load[i].value;
    for (size_t j = 0; j <= q; j++) {
        const double complex *G = l->G + (j < q ? j : n - 1) * n;
        double complex *out = j < q ? h->S + j * q : h->p;

        for (size_t i = 0; i < q; i++)
            out[i] -= G[i];
        for (size_t w = 0; w < seats; w++)
            h->row[j * seats + w] = G[q + w];
    }
}

/* (5) but for its denominator, relative: of S to its largest, of p to the loads, of rows wanted to
 * the motion of a kept dof that is 1 and to what the loads move. */
static double doubt(const struct condense *c, const struct at *at,
                    const struct condense_harmonic *h)
{
    const struct condense_lanczos *l = c->lanczos;
    double stiff = numbers_modulus(h->S, (size_t)l->q * (size_t)l->q), load = 0, moved, kept = 0,
           wanted = 0, loaded = l->size[l->answers - 1];

    for (int i = 0; i < c->loads; i++)
        load = c->load[i].k == at->k ? fmax(load, cabs(c->load[i].value)) : load;
    moved = fmax(numbers_modulus(h->row + (size_t)c->seats * (size_t)l->q, (size_t)c->seats),
                 load / stiff);
    for (int j = 0; j < l->q; j++)
        kept = fmax(kept, l->size[j]);
    for (int j = l->q; j < l->q + l->duals; j++)
        wanted = fmax(wanted, l->size[j]);
    return fmax(fmax(kept * kept / stiff, kept * wanted),
                loaded > 0 ? loaded * fmax(kept / load, wanted / moved) : 0);
}

/* What of S, relative, leaves S^-1 F as good as ROUGH: that over S's condition. */
static double rough_tolerance(struct condense_lanczos *l, const double complex *S)
{
    int q = l->q;
    double condition = 0, norm = 0;

    memcpy(l->X, S, (size_t)q * (size_t)q * sizeof *S);
    for (int j = 0; j < q; j++)
        norm = fmax(norm, cblas_dzasum(q, S + (size_t)j * (size_t)q, 1));
    if (LAPACKE_zgetrf_work(LAPACK_COL_MAJOR, q, q, l->X, q, l->pivot) != 0
        || LAPACKE_zgecon_work(LAPACK_COL_MAJOR, '1', q, l->X, q, norm, &condition,
                               l->G + (size_t)l->answers * (size_t)l->answers, l->small) != 0)
        return 0;
    return ROUGH * condition;
}

/* (4) before its first step. */
static void begin_elimination(struct condense *c, struct at *at)
{
    struct condense_lanczos *l = c->lanczos;

    at->least = least_of_all(at);
    begin_sides(c, at);
    memset(l->G, 0, 2 * (size_t)l->answers * (size_t)l->answers * sizeof *l->G);
    memset(l->D, 0, (size_t)l->sides * (size_t)l->sides * sizeof *l->D);
}

/* One step of (4) more into H, and (5) but for its denominator into AT; false: D is singular. */
static bool go_on(struct condense *c, struct at *at, struct condense_harmonic *h)
{
    struct condense_lanczos *l = c->lanczos;
    const struct step *s = &l->step[at->done++];
    double largest, columns = s->wide + l->answers,
           work = STEP + 8 * s->wide * columns * columns / BUDGET_DENSE;

    l->spent += work;
    c->work += work;
    add_diagonal(s, at, l->D);
    largest = eliminate(l, s, at);
    if (largest < 0)
        return false;
    at->most = fmax(at->most, largest);
    answer(c, at, h);
    at->left = doubt(c, at, h);
    at->rounded = DBL_EPSILON * at->most / numbers_modulus(h->S, (size_t)l->q * (size_t)l->q);
    h->doubt = at->left / at->least + at->rounded;
    return true;
}

/* The harmonic of AT by the steps that are made, from where it stood, into H; ROUGH: as an estimate
 * asks; false: they do not serve.  *NEAR: at an eigenvalue to rounding, where no more would. */
static bool serves(struct condense *c, struct at *at, bool rough, struct condense_harmonic *h,
                   bool *near)
{
    struct condense_lanczos *l = c->lanczos;
    double allowed = l->tolerance;

    if (l->steps == 0)
        return false;
    if (at->done == 0)
        begin_elimination(c, at);
    while (at->done < l->steps) {
        if (!go_on(c, at, h)) {
            *near = true;
            return false;
        }
        allowed = rough ? fmax(rough_tolerance(l, h->S), l->tolerance) : l->tolerance;
        if (at->least > CONDITION && h->doubt <= allowed)
            return true;
    }
    *near = at->rounded > (rough ? ROUGH : l->tolerance);
    /* small theta are near 0, and |a| is the most that `least` may be */
    if (*near || at->least > CONDITION || !(at->left / cabs(at->a) <= allowed))
        return false;
    at->least = least_of_theta(c, at);
    *near = !(at->least > CONDITION);
    h->doubt = at->left / at->least + at->rounded;
    at->least = 0;                                      /* theta move with the next steps */
    return !*near && h->doubt <= allowed;
}

/* Has (3) work for estimates: half of it is left to what is solved for? */
static bool spares(const struct condense_lanczos *l) { return 2 * l->spent < ventured(l); }

/* The harmonic of AT into H, after as many steps as it takes; false: none, or no work for it. */
static bool answer_by_steps(struct condense *c, struct at *at, bool rough,
                            struct condense_harmonic *h)
{
    struct condense_lanczos *l = c->lanczos;
    bool near = false;

    if (rough ? !spares(l) : l->spent >= ventured(l))
        return false;
    while (!serves(c, at, rough, h, &near))
        if (near || (rough && !spares(l)) || !grow(c))
            return false;
    return true;
}

bool condense_lanczos_answer(struct condense *c, int k, bool rough, struct condense_harmonic *h)
{
    struct condense_lanczos *l = c->lanczos;
    double s = k * c->omega;
    struct at at = { .k = k, .s = s };

    if (l->factors == NULL && (k == 0 || rough))
        return false;
    if (l->factors == NULL && !begin(c, s)) {
        double tolerance = l->tolerance;

        drop(c);                                /* and without memory each harmonic is factored */
        if (condense_basis_new(c, tolerance, NULL) != MODAL_OK)
            condense_basis_free(c);
        return false;
    }
    l->first = l->asked == 0 ? c->omega : l->first;
    l->asked += l->first == c->omega;
    at.a = CMPLX(1, l->beta * s);
    at.c = CMPLX(-s * s, l->alpha * s) - at.a * l->sigma2;
    if (!answer_by_steps(c, &at, rough, h))
        return false;
    h->rough = h->doubt > l->tolerance;
    l->served++;
    return true;
}

void condense_lanczos_missed(struct condense *c, bool rough)
{
    c->lanczos->failed += !rough;
    if (c->lanczos->failed > c->lanczos->served)
        drop(c);
}
