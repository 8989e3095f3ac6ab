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
 * An estimate leaves out what moves little by any account.  Lambda of condense.h is a lambda + i
 * alpha s - s^2 on modes of mass 1, lambda their eigenvalues, and nowhere less than d, so that
 * forces F_k on kept dofs move no dof by more than
 *
 *     |F_k| / (m d),   d = (alpha + beta s^2) s / |a|,                                          (6)
 *
 * m the least mass of those dofs, which is what M has on its diagonal beside the rest of a row.
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
#include "modal/linalg/block_lanczos.h"
#include "modal/linalg/block_schur.h"
#include "modal/linalg/lanes.h"
#include "modal/linalg/sparse_cholesky.h"
#include "modal/linalg/sparse_lu.h"
#include "modal/numbers.h"
#include "modal/steady/budget.h"
#include "modal/steady/condense_state.h"
#include "modal/steady/pattern.h"

enum {
    DUALS_MOST = 32,        /* dofs wanted, each of which is one more column of B */
    FASTER = 5,             /* products of full matrices, of 10,000 rows: 20 operations a ns */
    BETWEEN = 4,            /* steps of (4) from one that (5) is asked of to the next */
    GROWTH = 8,             /* an eighth of the steps is made before s is asked anew */
    STEP = 1000,            /* of budget.h: a microsecond, of the calls that a step of (4) makes */
    REDUCTION = 12          /* n x n x reach: a band to its eigenvalues, and half by rotations */
};
/* Entries off symmetry by less, relative, are symmetric: rounding of an assembly. */
static const double SYMMETRIC = 1e-12;
/* sigma over the s first asked for, the highest that is solved for.  Polynomials in theta = 1 /
 * (lambda + sigma^2), of all theta in 0 .. 1 / sigma^2, part neighbours at lambda = s^2 as well as
 * s sigma / (s^2 + sigma^2) is large: at s by half, as well at three times s, for an error, as at s
 * itself with sqrt 3; and at s / 3 by half of that. */
static const double SHIFT = 1.7;
/* Of what factors would cost along all points, what (3) and (4) may. */
static const double VENTURE = 0.5;
/* What S^-1 F may be off by, relative and by (5), where an estimate asks: it needs a digit or two.
 */
static const double ROUGH = 0.03;
/* Of the largest motion of an estimate, what the harmonics that it leaves out may move: chosen; it
 * is added to the error, which is so much too large. */
static const double LEAVES = 0.25;
/* The least |a + c theta| that tells anything. */
static const double CONDITION = 64 * DBL_EPSILON;

struct condense_lanczos {
    double tolerance, alpha, beta, sigma2;
    int r, q, duals, answers;       /* answers: columns of F, q + duals + 1 */
    bool massive;                   /* M_rq is not 0 */
    int sides;                      /* columns of B */
    struct sparse_cholesky *factors;    /* of A_0; NULL: before the first question */
    struct sparse M;                /* M_rr in the factors' order; its arrays are `space`'s */
    struct block_lanczos b;         /* (3) */
    int points, asked;              /* that follow; harmonics of the first of them, as known */
    double first;                   /* rad/s: of the first */
    double spent, once;             /* operations, of all of it; of one factorization of L */
    int served, failed;             /* harmonics */
    double mass;                    /* m of (6); < 0: not known */
    struct block_schur sum;         /* (4) */
    double complex *S;              /* q x q, and room for its condition */
    int *pivot;
    double *size;                   /* |P_j+1 e_m| of (5) */
    double *theta;                  /* eigenvalues of T_j, ascending */
    int thetas, thetas_of;          /* how many, of how many steps; 0: not known */
    struct workspace space;
};

static void drop(struct condense *c)
{
    struct condense_lanczos *l = c->lanczos;

    sparse_cholesky_free(l->factors);
    block_schur_done(&l->sum);
    block_lanczos_done(&l->b);
    workspace_free(&l->space);
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
                                     .answers = c->q + c->seats + 1, .points = points,
                                     .mass = -1 };
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
    if (value != NULL)
        out = sparse_cholesky_new(c->r, pattern->start, pattern->index, value);
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
    size_t ld = (size_t)l->b.ld;
    int wide = (l->massive ? 2 : 1) * l->q;

    for (int t = PROGRAM_M; t <= PROGRAM_K; t += PROGRAM_K - PROGRAM_M) {
        const struct sparse *a = &c->p->constant[t];

        if (a->start != NULL)
            EACH_COUPLING(c, a, i, e)
                Z[(size_t)row[c->spot[i]] * ld
                  + (size_t)((t == PROGRAM_M ? l->q : 0) + c->place[a->index[e]])] += a->value[e];
    }
    for (int i = 0; i < c->n; i++)
        if (c->seat[i] >= 0)
            Z[(size_t)row[c->spot[i]] * ld + (size_t)(wide + c->seat[i])] = 1;
    wide += l->duals;
    for (int k = 0; k <= c->highest; k++) {
        for (int i = 0; i < c->loads; i++)
            if (c->load[i].k == k && c->spot[c->load[i].dof] >= 0) {
                double *z = Z + (size_t)row[c->spot[c->load[i].dof]] * ld + wide;

                z[0] += creal(c->load[i].value);
                z[1] += cimag(c->load[i].value);
            }
        wide += has_load(c, k) ? 2 : 0;
    }
}

/* Operations of a factorization of L and its solutions: beside those of A_0 twice as many entries,
 * of complex numbers, four times the operations. */
static double once(const struct condense_lanczos *l)
{
    double fill = 2 * sparse_cholesky_fill(l->factors);

    return (8 * sparse_cholesky_flops(l->factors) + SPARSE_LU_ENTRY * fill) / BUDGET_DENSE
           + 8 * fill * l->answers;
}

/* A_0 for S, and Q_1; false: there is no curve by it. */
static bool begin(struct condense *c, double s)
{
    struct condense_lanczos *l = c->lanczos;
    const int *order;
    int *row;
    size_t q = (size_t)l->q;

    l->sigma2 = SHIFT * s * SHIFT * s;
    l->factors = factor_real(c, l->sigma2);
    if (l->factors == NULL)
        return false;
    l->once = once(l);
    order = sparse_cholesky_order(l->factors);
    row = workspace_room(&l->space, (size_t)l->r, sizeof *row);
    l->S = workspace_zeros(&l->space, q * q + 4 * q, sizeof *l->S);
    l->pivot = workspace_zeros(&l->space, q, sizeof *l->pivot);
    l->size = workspace_zeros(&l->space, (size_t)l->answers, sizeof *l->size);
    if (!block_lanczos_init(&l->b, l->r, l->sides)
        || !block_schur_init(&l->sum, l->answers, l->sides) || l->space.failed)
        return false;
    for (int i = 0; i < l->r; i++)
        row[order[i]] = i;
    order_mass(c, row, l);
    if (l->space.failed)
        return false;
    right_sides(c, row, l->b.Q[1]);
    return sparse_cholesky_half(l->factors, false, l->b.Q[1], l->b.ld, l->b.ld)
           && block_lanczos_begin(&l->b);
}

/* Operations that (3) may cost. */
static double ventured(const struct condense_lanczos *l)
{
    return VENTURE * l->points * l->asked * l->once;
}

/* block_product: Y <- R^-T M_rr R^-1 X. */
static bool apply(void *context, int columns, int ld, double *X, double *Y)
{
    const struct condense_lanczos *l = context;
    size_t width = (size_t)columns, stride = (size_t)ld;

    if (!sparse_cholesky_half(l->factors, true, X, columns, ld))
        return false;
    for (int i = 0; i < l->r; i++) {
        double *y = Y + (size_t)i * stride;

        memset(y, 0, width * sizeof *y);
        for (int e = l->M.start[i]; e < l->M.start[i + 1]; e++) {
            const double *x = X + (size_t)l->M.index[e] * stride;

            for (size_t v = 0; v < width; v += LANES)
                *(lanes *)(y + v) += l->M.value[e] * *(const lanes *)(x + v);
        }
    }
    return sparse_cholesky_half(l->factors, false, Y, columns, ld);
}

/* One step of (3); false: there is none, or no work or memory for it. */
static bool make_step(struct condense *c)
{
    struct condense_lanczos *l = c->lanczos;
    double panels, rest;

    if (l->b.ended)
        return false;
    panels = 4 * sparse_cholesky_fill(l->factors) * l->b.step[l->b.steps].wide;
    rest = block_lanczos_work(&l->b) / (FASTER * BUDGET_DENSE);
    /* on some curves all is in vain: what is ventured is counted as if the factor were scattered */
    if (l->spent + panels + rest > ventured(l))
        return false;
    l->spent += panels + rest;
    c->work += panels / BUDGET_DENSE + rest;
    return block_lanczos_step(&l->b, apply, l);
}

/* An eighth more steps; false: none is made. */
static bool grow(struct condense *c)
{
    struct condense_lanczos *l = c->lanczos;
    int before = l->b.steps, most = before + before / GROWTH + 1;

    while (l->b.steps < most && make_step(c))
        ;
    return l->b.steps > before;
}

/* The eigenvalues of T_j; false: no memory, or no work for them. */
static bool find_theta(struct condense *c)
{
    struct condense_lanczos *l = c->lanczos;
    int n = 0, reach = 0, at = 0;
    double *band, *theta, work;
    bool ok;

    for (int j = 0; j < l->b.steps; j++) {
        n += l->b.step[j].wide;
        if (l->b.step[j].wide + l->b.step[j].next > reach)
            reach = l->b.step[j].wide + l->b.step[j].next;
    }
    work = REDUCTION * (double)n * n * reach / BUDGET_DENSE;
    if (l->spent + work > ventured(l))
        return false;
    l->spent += work;
    c->work += work;
    theta = realloc(l->theta, (4 * (size_t)n + 1) * sizeof *theta);
    band = calloc((size_t)n * (size_t)reach + 1, sizeof *band);
    l->theta = theta != NULL ? theta : l->theta;
    for (int j = 0; theta != NULL && band != NULL && j < l->b.steps; at += l->b.step[j++].wide) {
        const struct block_step *s = &l->b.step[j];

        for (int m = 0; m < s->wide; m++) {
            double *column = band + (size_t)(at + m) * (size_t)reach;

            for (int i = m; i < s->wide; i++)
                column[i - m] = s->A[m * s->wide + i];
            for (int i = 0; j + 1 < l->b.steps && i < s->next; i++)
                column[s->wide + i - m] = s->B[m * s->wide + i];
        }
    }
    ok = theta != NULL && band != NULL
         && LAPACKE_dsbev_work(LAPACK_COL_MAJOR, 'N', 'L', n, reach - 1, band, reach, theta, NULL,
                               n, theta + n) == 0;
    l->thetas = ok ? n : 0;
    l->thetas_of = ok ? l->b.steps : 0;
    free(band);
    return ok;
}

/* One s and the harmonic it is of: a and c of (1); steps of (4) that are done; of (5) the least so
 * far, and what is left without it; the largest part of S, and what rounding makes of S by it; of
 * an estimate what it moves. */
struct at {
    int k, done;
    double s, least, left, most, rounded, moved;
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

    if (l->thetas_of != l->b.steps && !find_theta(c))
        return 0;
    for (int i = 0; i < l->thetas; i++)
        least = fmin(least, cabs(at->a + at->c * l->theta[i]));
    return least;
}

/* P_1 of (4). */
static void begin_sides(const struct condense *c, const struct at *at)
{
    struct condense_lanczos *l = c->lanczos;
    size_t w = (size_t)l->b.step[0].wide, sides = (size_t)l->sides, q = (size_t)l->q, j = 0;
    double complex by = CMPLX(1, l->beta * at->s), mass = CMPLX(-at->s * at->s, l->alpha * at->s);
    const double *R = l->b.R;

    for (; j < q; j++, R += sides)
        for (size_t i = 0; i < w; i++)
            block_schur_set(&l->sum, i, j,
                      by * R[i] + (l->massive ? mass * R[q * sides + i] : 0));
    R += l->massive ? q * sides : 0;
    for (; j < q + (size_t)l->duals; j++, R += sides)
        for (size_t i = 0; i < w; i++)
            block_schur_set(&l->sum, i, j, R[i]);
    for (int k = 0; k <= c->highest; k++) {
        for (size_t i = 0; k == at->k && has_load(c, k) && i < w; i++)
            block_schur_set(&l->sum, i, j, CMPLX(R[i], R[sides + i]));
        R += has_load(c, k) ? 2 * sides : 0;
    }
}

/* S, p and the rows wanted of the sum into H. */
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
        size_t of = j < q ? j : n - 1;
        double complex *out = j < q ? h->S + j * q : h->p;

        for (size_t i = 0; i < q; i++)
            out[i] -= block_schur_sum(&l->sum, of, i);
        for (size_t w = 0; w < seats; w++)
            h->row[j * seats + w] = block_schur_sum(&l->sum, of, q + w);
    }
}

/* What the entries of S may be off by, over the largest, for S^-1 F to be as good as ROUGH of the
 * largest of an estimate so far, `share` of itself; S stays regular below 1 / q of its condition.
 * |S^-1 F| into AT. */
static double rough_tolerance(const struct condense *c, struct at *at, const double complex *S)
{
    struct condense_lanczos *l = c->lanczos;
    int q = l->q;
    double condition = 0, norm = 0, share;
    double complex *x = l->S + q * q;

    memcpy(l->S, S, (size_t)q * (size_t)q * sizeof *S);
    for (int j = 0; j < q; j++)
        norm = fmax(norm, cblas_dzasum(q, S + (size_t)j * (size_t)q, 1));
    if (LAPACKE_zgetrf_work(LAPACK_COL_MAJOR, q, q, l->S, q, l->pivot) != 0
        || LAPACKE_zgecon_work(LAPACK_COL_MAJOR, '1', q, l->S, q, norm, &condition, x,
                               (double *)(x + 2 * q)) != 0)
        return 0;
    for (int i = 0; i < q; i++)
        x[i] = c->force[i * (c->top + 1) + at->k];
    LAPACKE_zgetrs_work(LAPACK_COL_MAJOR, 'N', q, 1, l->S, q, l->pivot, x, q);
    at->moved = numbers_modulus(x, (size_t)q);
    share = ROUGH * fmax(c->moved / at->moved, 1);
    return condition / (1 / share + q);
}

/* (4) before its first step. */
static void begin_elimination(struct condense *c, struct at *at)
{
    struct condense_lanczos *l = c->lanczos;

    at->least = least_of_all(at);
    block_schur_begin(&l->sum);
    begin_sides(c, at);
}

/* One step of (4) more; false: D is singular. */
static bool go_on(struct condense *c, struct at *at)
{
    struct condense_lanczos *l = c->lanczos;
    const struct block_step *s = &l->b.step[at->done++];
    double largest, columns = s->wide + l->answers,
           work = STEP + 8 * s->wide * columns * columns / BUDGET_DENSE;

    l->spent += work;
    c->work += work;
    largest = block_schur_step(&l->sum, s, at->a, at->c, l->q);
    at->most = fmax(at->most, largest);
    return largest >= 0;
}

/* (4) as it stands into H, and (5) but for its denominator into AT. */
static void look(struct condense *c, struct at *at, struct condense_harmonic *h)
{
    struct condense_lanczos *l = c->lanczos;

    for (int j = 0; j < l->answers; j++)
        l->size[j] = block_schur_left(&l->sum, (size_t)j);
    answer(c, at, h);
    /* (5) but for its denominator */
    at->left = condense_harmonic_doubt(c, at->k, h, l->size, l->answers - 1);
    at->rounded = DBL_EPSILON * at->most / numbers_modulus(h->S, (size_t)l->q * (size_t)l->q);
    h->doubt = at->left / at->least + at->rounded;
}

/* The harmonic of AT by the steps that are made, from where it stood, into H; ROUGH: as an estimate
 * asks; false: they do not serve.  *NEAR: at an eigenvalue to rounding, where no more would. */
static bool serves(struct condense *c, struct at *at, bool rough, struct condense_harmonic *h,
                   bool *near)
{
    struct condense_lanczos *l = c->lanczos;
    double allowed = l->tolerance;

    if (l->b.steps == 0)
        return false;
    if (at->done == 0)
        begin_elimination(c, at);
    while (at->done < l->b.steps) {
        if (!go_on(c, at)) {
            *near = true;
            return false;
        }
        if (at->done % BETWEEN != 0 && at->done < l->b.steps)
            continue;
        look(c, at, h);
        allowed = rough ? fmax(rough_tolerance(c, at, h->S), l->tolerance) : l->tolerance;
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

void condense_lanczos_expect(struct condense *c, int harmonics)
{
    struct condense_lanczos *l = c->lanczos;

    l->first = l->asked == 0 ? c->omega : l->first;
    l->asked += l->first == c->omega ? harmonics : 0;
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
    if (rough)
        condense_lanczos_expect(c, 1);
    at.a = CMPLX(1, l->beta * s);
    at.c = CMPLX(-s * s, l->alpha * s) - at.a * l->sigma2;
    if (!answer_by_steps(c, &at, rough, h))
        return false;
    h->rough = h->doubt > l->tolerance;
    c->moved = rough ? fmax(c->moved, at.moved) : c->moved;
    l->served++;
    return true;
}

/* The least over kept dofs and those wanted of what M has on its diagonal beside the rest of the
 * row; 0: there is a row that has nothing, and M^-1 no bound by it. */
static double least_mass(const struct condense *c)
{
    const struct sparse *M = &c->p->constant[PROGRAM_M];
    double least = HUGE_VAL;

    for (int i = 0; i < c->n; i++) {
        double mass = 0;

        for (int e = M->start != NULL ? M->start[i] : 0;
             M->start != NULL && e < M->start[i + 1]; e++)
            mass += M->index[e] == i ? M->value[e] : -fabs(M->value[e]);
        if (!(mass > 0))
            return 0;
        if (c->place[i] >= 0 || c->seat[i] >= 0)
            least = fmin(least, mass);
    }
    return least;
}

bool condense_lanczos_leaves(struct condense *c, int k)
{
    struct condense_lanczos *l = c->lanczos;
    double s = k * c->omega, apart = (l->alpha + l->beta * s * s) * s / hypot(1, l->beta * s),
           force = 0, moves;

    if (l->factors == NULL)
        return false;
    l->mass = l->mass < 0 ? least_mass(c) : l->mass;
    for (int i = 0; i < c->q; i++)
        force = hypot(force, cabs(c->force[i * (c->top + 1) + k]));
    moves = force / (l->mass * apart);                                                  /* (6) */
    if (!(moves <= LEAVES * c->moved - c->left))
        return false;
    c->left += moves;
    return true;
}

void condense_lanczos_missed(struct condense *c, bool rough)
{
    c->lanczos->failed += !rough;
    if (c->lanczos->failed > c->lanczos->served)
        drop(c);
}
