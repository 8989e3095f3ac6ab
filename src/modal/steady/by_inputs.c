/*
 * by_inputs.c - see by_inputs.h
 *
 * With w = B d what the laws read of a motion d, D their slopes, all harmonics together, and D_0 a
 * constant slope of each input by itself, the derivative is
 *
 *     J = S + B^T D B = A + B^T (D - D_0) B,    A_k = K_0 - s^2 M + i s C,   s = k omega,       (1)
 *
 * K_0 = K + B^T D_0 B.  Its harmonics are coupled by what the laws read alone:
 *
 *     w + G (D - D_0) w = B A^-1 y,   G = B A^-1 B^T;    d = A^-1 (y - B^T (D - D_0) w),        (2)
 *
 * w by GMRES.  All A_k share K_0's real factors and the modes K_0 phi = lambda M phi, phi^T M phi =
 * 1, of least lambda,
 *
 *     A_k^-1 = K_0^-1 + Phi [(Lambda - s^2 + i s Phi^T C Phi)^-1 - Lambda^-1] Phi^T,            (3)
 *
 * but for s^2 / lambda and s c / lambda of the modes that are not there.  So (2) is a correction,
 * repeated with what (1) has left of y, which is evaluated as it is.  G is of (3) as well: one real
 * matrix for all harmonics, and a part of few modes.
 */
#include "modal/steady/by_inputs.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/gmres.h"
#include "modal/linalg/sparse.h"
#include "modal/linalg/sparse_cholesky.h"
#include "modal/linalg/sparse_lu.h"
#include "modal/linalg/symmetric_modes.h"
#include "modal/linalg/workspace.h"
#include "modal/numbers.h"
#include "modal/scene/law.h"
#include "modal/scene/program.h"
#include "modal/steady/aft.h"
#include "modal/steady/budget.h"
#include "modal/steady/pattern.h"
#include "modal/steady/stiffness.h"

enum {
    INPUTS_LEAST = 20,      /* fewer are condensed to, or cheap as they are */
    DOFS_LEAST = 4,         /* dofs an input: below, factors of each harmonic fill little more */
    MODES = 120,            /* of (3), chosen: of a joint of 20 x 20 contacts 80 do not reach twice
                             * the 21 harmonics of its first resonance, for its error, and their
                             * factors cost more than the search for 40 more */
    PANEL = 64,             /* right-hand sides at once */
    VECTORS_MOST = 150,     /* of GMRES: joints that slide everywhere were seen to take 100 */
    CORRECTIONS_MOST = 16,  /* each at least SLOW of the one before, or w better known */
    FAILURES_MOST = 3       /* of solutions, after which it is not tried any more */
};
/* What GMRES leaves of w at first; FINER of it wherever a correction leaves more than SHRINKS of
 * the forces, as of nearly singular J, whose w is far more sensitive than that; down to
 * INNER_LEAST, where w has half of all digits. */
static const double INNER = 0.01;
static const double INNER_LEAST = 1e-8;
static const double FINER = 0.1;
static const double SHRINKS = 0.5;
/* Corrections that leave more than so, w known well, do not come there: modes are missing. */
static const double SLOW = 0.8;

struct joint {
    const struct program *p;
    const struct pattern *pattern;
    int q, r;
    int *input;                         /* of each law LAW_INPUTS_MOST: its number among r */
    int *start, *at;                    /* ends of input u: start[u] .. start[u + 1] - 1 */
    double *weight, *slope;             /* of each end; D_0 */
    bool made, serves;
    int failures;
    struct sparse_cholesky *factors;    /* of K_0 */
    struct symmetric_modes modes;
    double *flexibility;                /* B K_0^-1 B^T, r x r */
    double *seen, *damping;             /* B Phi, r x modes; Phi^T C Phi */
    double work;
    struct workspace space;
};

struct by_inputs {
    struct joint *j;
    int K, m;                           /* K = HJ + 1, m = 2 HJ + 1 */
    double *D;                          /* of law l from offset[l] on: [i][j][m][m]; NULL: D_0 */
    size_t *offset;
    const double complex *S;            /* of the solution under way */
    double omega, made_at;              /* of Z; 0: not made */
    double inner;                       /* of GMRES, now */
    double complex *Z;                  /* of (3), modes x modes of each k */
    double *rows, *left, *sum, *kept;   /* m q: of K_0^-1, transposed; what is left; d; scratch */
    double *w, *f, *g;                  /* m r */
    double *t, *u;                      /* m modes */
    double complex *x, *y;              /* the larger of q and modes */
    struct gmres *gmres;
    double work;
    struct workspace space;
};

/* Whether input I of A and J of B are the same. */
static bool same_ends(const struct law *a, int i, const struct law *b, int j)
{
    int count = a->start[i + 1] - a->start[i];
    bool same = count == b->start[j + 1] - b->start[j];

    for (int e = 0; same && e < count; e++) {
        const struct law_end *x = &a->end[a->start[i] + e], *y = &b->end[b->start[j] + e];

        same = x->dof == y->dof && x->weight == y->weight;
    }
    return same;
}

/* Inputs by number, ends one after the other; those that the law before reads too are the same. */
static void number_inputs(struct joint *j, const int *place)
{
    int ends = 0;

    for (int l = 0; l < j->p->laws; l++) {
        const struct law *law = &j->p->law[l], *before = l > 0 ? law - 1 : NULL;

        for (int i = 0; i < law->kind->inputs; i++) {
            int *input = &j->input[l * LAW_INPUTS_MOST + i], known = -1;

            for (int o = 0; before != NULL && o < before->kind->inputs; o++)
                known = same_ends(law, i, before, o) ? input[o - i - LAW_INPUTS_MOST] : known;
            *input = known >= 0 ? known : j->r++;
            if (known >= 0)                             /* a contact's normal, of both its sides */
                continue;
            for (int e = law->start[i]; e < law->start[i + 1]; e++) {
                j->at[ends] = place[law->end[e].dof];
                j->weight[ends++] = law->end[e].weight;
            }
            j->start[j->r] = ends;
        }
    }
}

enum modal_status joint_new(const struct program *p, const int *place,
                            const struct pattern *pattern, struct joint **out,
                            struct modal_error *err)
{
    size_t inputs = 0, ends = 0;
    struct joint *j;
    enum modal_status rc;

    *out = NULL;
    for (int l = 0; l < p->laws; l++) {
        inputs += (size_t)p->law[l].kind->inputs;
        ends += (size_t)law_ends(&p->law[l]);
    }
    /* periodic matrices couple harmonics in S itself */
    if (pattern->full || p->harmonics > 0 || inputs < INPUTS_LEAST)
        return MODAL_OK;
    j = calloc(1, sizeof *j);
    if (j == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "joint: no memory");
    *j = (struct joint) { .p = p, .pattern = pattern, .q = pattern->q, .serves = true };
    j->input = workspace_zeros(&j->space, (size_t)p->laws * LAW_INPUTS_MOST + 1, sizeof *j->input);
    j->start = workspace_zeros(&j->space, inputs + 1, sizeof *j->start);
    j->at = workspace_zeros(&j->space, ends + 1, sizeof *j->at);
    j->weight = workspace_zeros(&j->space, ends + 1, sizeof *j->weight);
    j->slope = workspace_zeros(&j->space, inputs + 1, sizeof *j->slope);
    rc = workspace_check(&j->space, "joint: no memory", err);
    if (rc == MODAL_OK)
        number_inputs(j, place);
    if (rc == MODAL_OK && j->r >= INPUTS_LEAST && j->r * DOFS_LEAST <= j->q)
        *out = j;
    else
        joint_free(j);
    return rc;
}

void joint_free(struct joint *j)
{
    if (j == NULL)
        return;
    sparse_cholesky_free(j->factors);
    symmetric_modes_done(&j->modes);
    free(j->flexibility);
    free(j->seen);
    free(j->damping);
    workspace_free(&j->space);
    free(j);
}

bool joint_serves(const struct joint *j) { return j != NULL && j->serves; }

/* Entry (i, j) of the pattern, its symmetric half. */
static double mean_entry(const struct pattern *p, const double complex *S, int i, int j)
{
    return (creal(S[pattern_find(p, i, j)]) + creal(S[pattern_find(p, j, i)])) / 2;
}

/* K_0 and M of S_0 and S_1, their symmetric parts; C as it is. */
static void read_matrices(const struct joint *j, const double complex *S, double omega, double *K,
                          double *M, double *C)
{
    const struct pattern *p = j->pattern;
    int entries = pattern_entries(p);
    const double complex *S1 = S + entries;

    for (int c = 0; c < p->q; c++)
        for (int e = p->start[c]; e < p->start[c + 1]; e++) {
            K[e] = mean_entry(p, S, p->index[e], c);
            /* Re S_1 = K - omega^2 M, Im S_1 = omega C; good to rounding of K over omega^2 M */
            M[e] = (K[e] - mean_entry(p, S1, p->index[e], c)) / (omega * omega);
            C[e] = cimag(S1[e]) / omega;
        }
    /* B^T D_0 B: a law's ends are coupled in the pattern */
    for (int u = 0; u < j->r; u++)
        for (int a = j->start[u]; a < j->start[u + 1]; a++)
            for (int b = j->start[u]; b < j->start[u + 1]; b++)
                K[pattern_find(p, j->at[a], j->at[b])] += j->slope[u] * j->weight[a] * j->weight[b];
}

/* B K_0^-1 B^T, some columns at once. */
static bool find_flexibility(struct joint *j)
{
    size_t q = (size_t)j->q, r = (size_t)j->r;
    double *X = malloc(q * PANEL * sizeof *X);
    bool ok = X != NULL && (j->flexibility = calloc(r * r + 1, sizeof *j->flexibility)) != NULL;

    for (int from = 0; ok && from < j->r; from += PANEL) {
        int columns = j->r - from < PANEL ? j->r - from : PANEL;

        memset(X, 0, q * (size_t)columns * sizeof *X);
        for (int c = 0; c < columns; c++)
            for (int e = j->start[from + c]; e < j->start[from + c + 1]; e++)
                X[(size_t)c * q + (size_t)j->at[e]] += j->weight[e];    /* B^T */
        ok = sparse_cholesky_solve(j->factors, X, columns);
        for (int c = 0; ok && c < columns; c++)
            for (int u = 0; u < j->r; u++)
                for (int e = j->start[u]; e < j->start[u + 1]; e++)
                    j->flexibility[(size_t)(from + c) * r + (size_t)u] +=
                        j->weight[e] * X[(size_t)c * q + (size_t)j->at[e]];
    }
    free(X);
    /* forth and back, an entry each two operations */
    j->work += 4 * sparse_cholesky_fill(j->factors) * j->r / BUDGET_DENSE;
    return ok;
}

/* The modes, what the inputs see of them, and their damping; factors of K_0 once more, as their
 * search asks for. */
static bool find_modes(struct joint *j, const double *K, const double *M, const double *C)
{
    const struct pattern *p = j->pattern;
    struct sparse mass = { .m = p->q, .n = p->q, .start = p->start, .index = p->index,
                           .value = (double *)(uintptr_t)M };
    struct sparse_lu *lu = NULL;
    int modes = MODES < j->q / 4 ? MODES : j->q / 4;    /* symmetric, M's rows are its columns */
    size_t count, q = (size_t)j->q;
    double *CPhi = NULL;
    bool ok = sparse_lu_new(p->q, p->start, p->index, false, &lu, NULL) == MODAL_OK
              && sparse_lu_factor(lu, K)
              && symmetric_modes(lu, &mass, modes, &j->modes, NULL) == MODAL_OK;

    sparse_lu_free(lu);
    if (!ok)
        return false;
    count = (size_t)j->modes.count;
    j->seen = calloc((size_t)j->r * count + 1, sizeof *j->seen);
    j->damping = calloc(count * count + 1, sizeof *j->damping);
    CPhi = calloc(q * count + 1, sizeof *CPhi);
    ok = j->seen != NULL && j->damping != NULL && CPhi != NULL;
    for (size_t c = 0; ok && c < count; c++) {
        const double *phi = j->modes.phi + c * q;

        for (int u = 0; u < j->r; u++)
            for (int e = j->start[u]; e < j->start[u + 1]; e++)
                j->seen[c * (size_t)j->r + (size_t)u] += j->weight[e] * phi[j->at[e]];
        /* column i of C, by columns as the pattern is */
        for (int i = 0; i < p->q; i++)
            for (int e = p->start[i]; e < p->start[i + 1]; e++)
                CPhi[c * q + (size_t)p->index[e]] += C[e] * phi[i];
    }
    if (ok)
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, (int)count, (int)count, j->q, 1,
                    j->modes.phi, j->q, CPhi, j->q, 0, j->damping, (int)count);
    free(CPhi);
    return ok;
}

/* All of it from the structure's S at OMEGA, once; D_0 is set. */
static bool make(struct joint *j, const double complex *S, double omega)
{
    size_t entries = (size_t)pattern_entries(j->pattern);
    double *K = malloc((3 * entries + 1) * sizeof *K), *M, *C;

    j->made = true;
    j->serves = K != NULL;
    if (K == NULL)
        return false;
    M = K + entries;
    C = M + entries;
    read_matrices(j, S, omega, K, M, C);
    j->factors = sparse_cholesky_new(j->q, j->pattern->start, j->pattern->index, K);
    j->serves = j->factors != NULL && find_flexibility(j) && find_modes(j, K, M, C);
    free(K);
    return j->serves;
}

enum modal_status by_inputs_new(struct joint *j, int HJ, bool slopes, struct by_inputs **out,
                                struct modal_error *err)
{
    struct by_inputs *s = calloc(1, sizeof *s);
    size_t m = 2 * (size_t)HJ + 1, q = (size_t)j->q, numbers = 0, modes = MODES;
    enum modal_status rc;

    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "by inputs: no memory");
    *s = (struct by_inputs) { .j = j, .K = HJ + 1, .m = (int)m };
    s->offset = workspace_zeros(&s->space, (size_t)j->p->laws + 1, sizeof *s->offset);
    for (int l = 0; !s->space.failed && l < j->p->laws; l++) {
        size_t inputs = (size_t)j->p->law[l].kind->inputs;

        s->offset[l] = numbers;
        numbers += inputs * inputs * m * m;
    }
    s->D = slopes ? workspace_zeros(&s->space, numbers + 1, sizeof *s->D) : NULL;
    s->Z = workspace_zeros(&s->space, modes * modes * (size_t)s->K, sizeof *s->Z);
    s->rows = workspace_zeros(&s->space, m * q, sizeof *s->rows);
    s->left = workspace_zeros(&s->space, m * q, sizeof *s->left);
    s->sum = workspace_zeros(&s->space, m * q, sizeof *s->sum);
    s->kept = workspace_zeros(&s->space, m * q, sizeof *s->kept);
    s->w = workspace_zeros(&s->space, m * (size_t)j->r, sizeof *s->w);
    s->f = workspace_zeros(&s->space, m * (size_t)j->r, sizeof *s->f);
    s->g = workspace_zeros(&s->space, m * (size_t)j->r, sizeof *s->g);
    s->t = workspace_zeros(&s->space, m * modes, sizeof *s->t);
    s->u = workspace_zeros(&s->space, m * modes, sizeof *s->u);
    s->x = workspace_zeros(&s->space, q + modes, sizeof *s->x);
    s->y = workspace_zeros(&s->space, q + modes, sizeof *s->y);
    s->gmres = gmres_new(m * (size_t)j->r, VECTORS_MOST);
    rc = s->gmres == NULL ? modal_fail(err, MODAL_NO_MEMORY, "by inputs: no memory")
                          : workspace_check(&s->space, "by inputs: no memory", err);
    if (rc == MODAL_OK)
        *out = s;
    else
        by_inputs_free(s);
    return rc;
}

void by_inputs_free(struct by_inputs *s)
{
    if (s == NULL)
        return;
    gmres_free(s->gmres);
    workspace_free(&s->space);
    free(s);
}

int by_inputs_harmonics(const struct by_inputs *s) { return s->K - 1; }
double by_inputs_work(const struct by_inputs *s) { return s->work + s->j->work; }

/* Block (i, k) of law L. */
static double *block_of(const struct by_inputs *s, int l, int i, int k)
{
    size_t size = (size_t)s->m * (size_t)s->m;
    int inputs = s->j->p->law[l].kind->inputs;

    return s->D + s->offset[l] + (size_t)(i * inputs + k) * size;
}

static void keep_block(void *context, int l, int i, int k, const double *block)
{
    struct by_inputs *s = context;

    memcpy(block_of(s, l, i, k), block, (size_t)s->m * (size_t)s->m * sizeof *block);
}

/* D_0: the slopes that the first harmonic sees, of each input by itself. */
static void choose_slopes(struct by_inputs *s)
{
    struct joint *j = s->j;

    for (int l = 0; l < j->p->laws; l++)
        for (int i = 0; i < j->p->law[l].kind->inputs; i++)
            j->slope[j->input[l * LAW_INPUTS_MOST + i]] +=
                fmax(0, block_of(s, l, i, i)[s->m + 1]);    /* Re F_1 by Re D_1 */
}

enum modal_status by_inputs_set(struct by_inputs *s, struct aft *w, struct modal_error *err)
{
    enum modal_status rc = aft_each_slope(w, keep_block, s, err);

    gmres_forget(s->gmres);                             /* D is another */
    if (rc == MODAL_OK && !s->j->made)
        choose_slopes(s);
    return rc;
}

void by_inputs_add(const struct by_inputs *s, const struct aft_target *into)
{
    const struct joint *j = s->j;

    for (int l = 0; l < j->p->laws; l++)
        for (int i = 0; i < j->p->law[l].kind->inputs; i++)
            for (int k = 0; k < j->p->law[l].kind->inputs; k++) {
                int u = j->input[l * LAW_INPUTS_MOST + i], v = j->input[l * LAW_INPUTS_MOST + k];
                const double *block = block_of(s, l, i, k);

                for (int a = j->start[u]; a < j->start[u + 1]; a++)
                    for (int b = j->start[v]; b < j->start[v + 1]; b++)
                        for (int c = 0; c < s->m; c++)
                            cblas_daxpy(s->m, j->weight[a] * j->weight[b], block + c * s->m, 1,
                                        into->column(into->context, j->at[a], j->at[b], c), 1);
            }
}

/* [(Lambda - s^2 + i s Phi^T C Phi)^-1 - Lambda^-1] of each harmonic; false: a resonance. */
static bool make_changes(struct by_inputs *s)
{
    const struct joint *j = s->j;
    int n = j->modes.count;
    size_t size = (size_t)n * (size_t)n;
    int *pivot = calloc((size_t)n + 1, sizeof *pivot);
    bool ok = pivot != NULL;

    for (int k = 0; ok && k < s->K; k++) {
        double complex *Z = s->Z + (size_t)k * size;
        double at = k * s->omega;

        for (size_t e = 0; e < size; e++)
            Z[e] = CMPLX(0, at * j->damping[e]);
        for (int i = 0; i < n; i++)
            Z[(size_t)i * ((size_t)n + 1)] += j->modes.lambda[i] - at * at;
        /* some dozens: the inverse itself is what is multiplied with */
        ok = LAPACKE_zgetrf(LAPACK_COL_MAJOR, n, n, Z, n, pivot) == 0
             && LAPACKE_zgetri(LAPACK_COL_MAJOR, n, Z, n, pivot) == 0;
        for (int i = 0; i < n; i++)                     /* K_0^-1 has them already */
            Z[(size_t)i * ((size_t)n + 1)] -= 1 / j->modes.lambda[i];
    }
    free(pivot);
    s->made_at = ok ? s->omega : 0;
    gmres_forget(s->gmres);                             /* and G */
    return ok;
}

/* u <- the changes of (3) on t, m x modes. */
static void change(struct by_inputs *s)
{
    const double complex one = 1, none = 0;
    int n = s->j->modes.count, m = s->m;

    /* harmonic k in rows 2 k - 1 and 2 k, the mean in the first */
    for (int k = 0; k < s->K; k++) {
        int re = k > 0 ? 2 * k - 1 : 0;

        for (int i = 0; i < n; i++)
            s->x[i] = CMPLX(s->t[i * m + re], k > 0 ? s->t[i * m + re + 1] : 0);
        cblas_zgemv(CblasColMajor, CblasNoTrans, n, n, &one,
                    s->Z + (size_t)k * (size_t)n * (size_t)n, n, s->x, 1, &none, s->y, 1);
        for (int i = 0; i < n; i++) {
            s->u[i * m + re] = creal(s->y[i]);
            if (k > 0)
                s->u[i * m + re + 1] = cimag(s->y[i]);
        }
    }
}

/* y <- A^-1 y by (3), m x q */
static bool invert(struct by_inputs *s, double *y)
{
    const struct joint *j = s->j;
    int q = j->q, m = s->m, n = j->modes.count;

    /* Rows are harmonics here, of all dofs: Phi is multiplied from the right. */
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, m, n, q, 1, y, m, j->modes.phi, q, 0,
                s->t, m);
    change(s);                                          /* of the modes, (3) */
    /* CHOLMOD wants one column a right-hand side. */
    for (int i = 0; i < q; i++)
        for (int r = 0; r < m; r++)
            s->rows[(size_t)r * (size_t)q + (size_t)i] = y[(size_t)i * (size_t)m + (size_t)r];
    if (!sparse_cholesky_solve(j->factors, s->rows, m)) /* K_0^-1, all harmonics at once */
        return false;
    for (int i = 0; i < q; i++)
        for (int r = 0; r < m; r++)
            y[(size_t)i * (size_t)m + (size_t)r] = s->rows[(size_t)r * (size_t)q + (size_t)i];
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, m, q, n, 1, s->u, m, j->modes.phi, q, 1, y,
                m);
    s->work += m * (4 * sparse_cholesky_fill(j->factors) + 4.0 * q * n + 8.0 * n * n)
        / BUDGET_DENSE;
    return true;
}

/* out <- D in, m x r; less D_0 in where that is asked for.  Without D, D_0 is in its place. */
static void slopes_on(const struct by_inputs *s, bool less, const double *in, double *out)
{
    const struct joint *j = s->j;
    int m = s->m;

    for (int u = 0; u < j->r; u++)
        for (int c = 0; c < m; c++)
            out[u * m + c] = less == (s->D != NULL) ? (less ? -1 : 1) * j->slope[u] * in[u * m + c]
                                                    : 0;
    for (int l = 0; s->D != NULL && l < j->p->laws; l++) {
        const int *input = j->input + l * LAW_INPUTS_MOST;

        for (int i = 0; i < j->p->law[l].kind->inputs; i++)
            for (int k = 0; k < j->p->law[l].kind->inputs; k++)
                cblas_dgemv(CblasColMajor, CblasNoTrans, m, m, 1, block_of(s, l, i, k), m,
                            in + input[k] * m, 1, 1, out + input[i] * m, 1);
    }
}

/* out <- in + G (D - D_0) in */
static void product(void *context, const double *in, double *out)
{
    struct by_inputs *s = context;
    const struct joint *j = s->j;
    int m = s->m, r = j->r, n = j->modes.count;

    slopes_on(s, true, in, s->g);                       /* (D - D_0) w of (2) */
    memcpy(out, in, (size_t)m * (size_t)r * sizeof *in);
    /* G's real part, which all harmonics share, */
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, m, r, r, 1, s->g, m, j->flexibility, r,
                1, out, m);
    /* and that of the modes */
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, m, n, r, 1, s->g, m, j->seen, r, 0, s->t,
                m);
    change(s);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, m, r, n, 1, s->u, m, j->seen, r, 1, out,
                m);
}

/* w <- B y */
static void read_inputs(const struct by_inputs *s, const double *y, double *w)
{
    const struct joint *j = s->j;

    for (int u = 0; u < j->r; u++) {
        memset(w + u * s->m, 0, (size_t)s->m * sizeof *w);
        for (int e = j->start[u]; e < j->start[u + 1]; e++)
            cblas_daxpy(s->m, j->weight[e], y + (size_t)j->at[e] * (size_t)s->m, 1, w + u * s->m,
                        1);
    }
}

/* y -= B^T f */
static void pull(const struct by_inputs *s, const double *f, double *y)
{
    const struct joint *j = s->j;

    for (int u = 0; u < j->r; u++)
        for (int e = j->start[u]; e < j->start[u + 1]; e++)
            cblas_daxpy(s->m, -j->weight[e], f + u * s->m, 1,
                        y + (size_t)j->at[e] * (size_t)s->m, 1);
}

/* y -= J x */
static void subtract(struct by_inputs *s, const double *x, double *y)
{
    int q = s->j->q, m = s->m;

    for (int k = 0; k < s->K; k++) {
        int re = k > 0 ? 2 * k - 1 : 0;

        for (int i = 0; i < q; i++) {
            const double *at = x + (size_t)i * (size_t)m + re;

            s->x[i] = CMPLX(at[0], k > 0 ? at[1] : 0);
            s->y[i] = 0;
        }
        stiffness_multiply_add(s->j->pattern, s->S, k, s->x, 1, s->y);  /* S as it is, no (3) */
        for (int i = 0; i < q; i++) {
            double *at = y + (size_t)i * (size_t)m + re;

            at[0] -= creal(s->y[i]);
            if (k > 0)
                at[1] -= cimag(s->y[i]);
        }
    }
    read_inputs(s, x, s->w);
    slopes_on(s, false, s->w, s->f);
    pull(s, s->f, y);                                   /* and B^T D B */
    s->work += 8.0 * s->K * pattern_entries(s->j->pattern);
}

/* y <- the correction (2) of y. */
static bool correct(struct by_inputs *s, double *y)
{
    const struct joint *j = s->j;
    size_t size = (size_t)s->m * (size_t)j->q;
    double r = j->r, m = s->m;
    bool ok;

    memcpy(s->kept, y, size * sizeof *y);
    if (!invert(s, y))
        return false;
    read_inputs(s, y, s->w);                            /* the right-hand side of (2) */
    ok = gmres_solve(s->gmres, product, s, s->inner, s->w);
    s->work += (gmres_work(s->gmres) + gmres_vectors(s->gmres)
        * (2 * m * r * (r + 2.0 * j->modes.count) + 2.0 * j->p->laws * 4 * m * m)) / BUDGET_DENSE;
    slopes_on(s, true, s->w, s->f);                     /* and d of it, by A^-1 once more */
    memcpy(y, s->kept, size * sizeof *y);
    pull(s, s->f, y);
    return invert(s, y) && ok;
}

/* Whether the modes there are suffice at S: a correction leaves s^2 / lambda of those that are not.
 */
static bool reaches(const struct joint *j, double s)
{
    int count = j->modes.count;

    return count == j->q || (count > 0 && s * s < SLOW * j->modes.lambda[count - 1]);
}

bool by_inputs_solve(struct by_inputs *s, const double complex *S, double omega, double left,
                     double *y)
{
    int size = s->m * s->j->q;
    double first = cblas_dnrm2(size, y, 1), before = HUGE_VAL, rest = first;
    bool ok;

    s->S = S;
    s->omega = omega;
    s->inner = INNER;
    ok = s->j->serves && (s->j->made || make(s->j, S, omega)) && reaches(s->j, (s->K - 1) * omega)
         && (s->made_at == omega || make_changes(s));
    memcpy(s->left, y, (size_t)size * sizeof *y);
    memset(s->sum, 0, (size_t)size * sizeof *y);
    for (int i = 0; ok && rest > left * first && i < CORRECTIONS_MOST; i++) {
        memcpy(y, s->left, (size_t)size * sizeof *y);
        ok = correct(s, y);                             /* (2) */
        cblas_daxpy(size, 1, y, 1, s->sum, 1);
        subtract(s, y, s->left);                        /* what (1) has left, exactly */
        before = rest;
        /* of forces, not of motions: nothing near a resonance stands out */
        rest = cblas_dnrm2(size, s->left, 1);
        ok = ok && isfinite(rest) && (rest < before || i == 0)
            && (rest < SLOW * before || s->inner > INNER_LEAST);
        s->inner *= rest < SHRINKS * before ? 1 : FINER;
    }
    ok = ok && rest <= left * first;
    memcpy(y, s->sum, (size_t)size * sizeof *y);
    /* springs alone, far past the modes that the derivative needs, tell nothing of it */
    s->j->failures += !ok && s->D != NULL;
    s->j->serves = s->j->serves && s->j->failures < FAILURES_MOST;
    return ok;
}
