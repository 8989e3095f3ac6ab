/*
 * condense_modes.c - the linear dofs eliminated by their modes; see condense.h for (1) and (2)
 *
 * Modes, where M and K are symmetric and C = alpha M + beta K: K_rr Phi = M_rr Phi diag(lambda),
 * Phi^T M_rr Phi = 1, c_j = alpha + beta lambda_j; with a_j(s) = phi_j^T L_rq(s) and b_j = phi_j^T
 * P_r,
 *
 *     S = L_qq - sum_j a_j^T a_j / (lambda_j - s^2 + i s c_j),
 *     p = P_q - sum_j a_j^T b_j / (lambda_j - s^2 + i s c_j).                                   (3)
 *
 * With proportional damping L_rq = (1 + i s beta) K_rq - s^2 M_rq + i s alpha M_rq, so that a_i a_j
 * is a sum of products of k_i = phi^T K_rq and m_i = phi^T M_rq with powers of s: these are made
 * once, and each harmonic of each frequency costs a sum over modes for a pair of kept dofs,
 *
 *     1 / (x + i y) = (x - i y) / (x^2 + y^2),   x = lambda - s^2,   y = s c,                   (5)
 *
 * eight harmonics at a time.  alpha and M_rq both not 0 are left to factoring, and so is rest,
 * once: where nothing holds a body, (3) leaves S_0 what rounding made of lambda.
 *
 * A tridiagonal K_rr with diagonal M_rr, a chain, has its modes in O(n^2).
 */
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/steady/condense_state.h"
#include "modal/steady/pattern.h"

enum { PASSES = 3 };              /* of the fit: what is, what that leaves, how far off */
/* Damping off alpha M + beta K by less than this, relative, is proportional: texts of 15 digits. */
static const double PROPORTIONAL = 1e-12;
/* M and K are told apart where the squared sine of the angle between them exceeds this. */
static const double APART = 1e-12;
/* Entries off symmetry by less are symmetric: rounding of an assembly. */
static const double SYMMETRIC = 1e-14;
/* A dense eigenproblem of as many takes minutes. */
enum { MODES_MOST = 3000 };

/* Eight harmonics at a time: a register of the widest machines. */
typedef double lanes __attribute__((vector_size(8 * sizeof(double))));
enum { LANES = 8 };   /* doubles of 512 bits */

/* sum_j weight_j / (lambda_j - s^2 + i s c_j) at eight s */
static void modal_sums(const struct condense *c, const double *weight, const double s[LANES],
                       double complex out[LANES])
{
    lanes s1, s2, re = { 0 }, im = { 0 };

    memcpy(&s1, s, sizeof s1);                          /* eight frequencies in one register */
    s2 = s1 * s1;
    for (int m = 0; m < c->r; m++) {
        /* 1 / (x + i y) = (x - i y) / (x^2 + y^2) */
        lanes x = c->lambda[m] - s2, y = s1 * c->damping[m], scale = weight[m] / (x * x + y * y);

        re += x * scale;
        im -= y * scale;
    }
    for (int i = 0; i < LANES; i++)
        out[i] = CMPLX(re[i], im[i]);
}

/* (3) for harmonics first .. first + 7 (those <= H), by products of the weights' parts: L_rq = (1 +
 * i s beta) K_rq - s^2 M_rq has a_i a_j = (1 + i s beta)^2 k_i k_j - s^2 (1 + i s beta)(k_i m_j +
 * m_i k_j) + s^4 m_i m_j. */
static void modes_at(struct condense *c, int first, int H, double complex *S, double complex *p)
{
    int q = c->q, terms = c->massless ? 1 : 4;
    double s[LANES];
    double complex sum[4][LANES];

    for (int i = 0; i < LANES; i++)
        s[i] = (first + i <= H ? first + i : first) * c->omega;
    for (int i = 0; i < q; i++)
        for (int j = 0; j <= q; j++) {
            const double *weight = c->weight + (size_t)(i * (q + 1) + j) * 4 * (size_t)c->r;

            for (int t = 0; t < terms && j < q; t++)
                modal_sums(c, weight + (size_t)t * (size_t)c->r, s, sum[t]);
            for (int k = first; j < q && k < first + LANES && k <= H; k++) {
                double sk = k * c->omega;
                /* L_rq = b K_rq - s^2 M_rq */
                double complex b = 1 + I * (sk * c->beta), total = b * b * sum[0][k - first];

                if (terms > 1)
                    /* the mixed terms and that of the masses */
                    total += -sk * sk * b * (sum[1][k - first] + sum[2][k - first])
                             + sk * sk * sk * sk * sum[3][k - first];
                S[((size_t)k * (size_t)q + (size_t)j) * (size_t)q + (size_t)i] -= total;
            }
        }
    for (int l = 0; l < c->loads; l++) {
        const struct condense_load *load = &c->load[l];
        double sk = load->k * c->omega;
        const double *phi;

        if (load->k < first || load->k >= first + LANES || load->k > H || c->spot[load->dof] < 0)
            continue;
        phi = c->phi + c->spot[load->dof];
        for (int i = 0; i < q; i++) {
            double complex total = 0, value = c->level * load->value;

            for (int m = 0; m < c->r; m++) {
                double x = c->lambda[m] - sk * sk, y = sk * c->damping[m],
                       scale = phi[(size_t)m * (size_t)c->r] / (x * x + y * y);
                size_t at = (size_t)i * (size_t)c->r + (size_t)m;
                /* a_j(s) */
                double complex a = CMPLX(c->ak[at] - sk * sk * c->am[at], sk * c->beta * c->ak[at]);

                total += a * CMPLX(x * scale, -y * scale);
            }
            p[load->k * q + i] -= total * value;        /* (3), p */
        }
    }
}

/* Where entries are in the pattern is the same at every s: it is searched once. */
static bool look_up(struct condense *c)
{
    const struct sparse *a = c->p->constant;
    size_t entries = 0, at = 0;

    for (int t = 0; t < 3; t++)
        entries += a[t].m > 0 ? (size_t)a[t].start[a[t].m] : 0;
    c->entry = workspace_zeros(&c->space, entries + 1, sizeof *c->entry);
    for (int t = 0; c->entry != NULL && t < 3; t++)
        for (int i = 0; i < a[t].m; i++)
            for (int e = a[t].start[i]; e < a[t].start[i + 1]; e++)
                c->entry[at++] =
                    pattern_find(c->pattern, c->place[i], c->place[a[t].index[e]]);
    return c->entry != NULL;
}

bool condense_whole(struct condense *c, double s, double complex *S)
{
    const int *entry;

    if (c->order > 0 || c->pattern->full || (c->entry == NULL && !look_up(c)))
        return false;
    entry = c->entry;
    for (int t = 0; t < 3; t++) {
        const struct sparse *a = &c->p->constant[t];
        int entries = a->m > 0 ? a->start[a->m] : 0;
        double complex factor = factor_of(t, s);

        for (int e = 0; e < entries; e++)
            S[entry[e]] += factor * a->value[e];        /* (1) of condense.h */
        entry += entries;
    }
    return true;
}

void condense_kept_block(struct condense *c, double s, double complex *S)
{
    for (int t = 0; t < 3; t++)
        for (int i = 0; i < c->q; i++)
            for (int e = c->p->constant[t].start[c->kept[i]];
                 e < c->p->constant[t].start[c->kept[i] + 1]; e++) {
                int j = c->place[c->p->constant[t].index[e]];

                if (j >= 0)
                    S[j * c->q + i] += factor_of(t, s) * c->p->constant[t].value[e];
            }
}

void condense_reduced_at(struct condense *c, int H, double complex *S, double complex *p)
{
    size_t q = (size_t)c->q;

    for (int k = 1; k <= H; k++)
        condense_kept_block(c, k * c->omega, S + (size_t)k * q * q);
    for (int l = 0; l < c->loads; l++) {
        const struct condense_load *load = &c->load[l];

        if (load->k > 0 && load->k <= H && c->place[load->dof] >= 0)
            p[load->k * c->q + c->place[load->dof]] += c->level * load->value;
    }
    for (int first = 1; first <= H; first += LANES)     /* the last may be of fewer */
        modes_at(c, first, H, S, p);
}

/* Rows of the linear dofs of constant[t]: the square part into A (r x r), the columns of kept dofs
 * into B (r x q). */
static void spread(const struct condense *c, int t, double *A, double *B)
{
    const struct sparse *a = &c->p->constant[t];

    for (int i = 0; i < c->n; i++)
        for (int e = c->spot[i] >= 0 ? a->start[i] : 0; c->spot[i] >= 0 && e < a->start[i + 1];
             e++) {
            int j = a->index[e];

            if (c->spot[j] >= 0)
                A[(size_t)c->spot[j] * (size_t)c->r + (size_t)c->spot[i]] += a->value[e];
            else
                B[(size_t)c->place[j] * (size_t)c->r + (size_t)c->spot[i]] += a->value[e];
        }
}

/* Row I of A onto ROW; its columns that were not SEEN before join the COUNT of COLUMN. */
static int scatter(const struct sparse *A, int i, double *row, bool *seen, int *column, int count)
{
    for (int e = A->start[i]; e < A->start[i + 1]; e++) {
        row[A->index[e]] += A->value[e];
        if (!seen[A->index[e]])
            column[count++] = A->index[e];
        seen[A->index[e]] = true;
    }
    return count;
}

/* Sums over the entries of all matrices, of which alpha and beta are made and checked. */
struct fit { double mm, mk, kk, cm, ck, scale, worst; };

/* The entries m, d, k of M, C and K at one place into F: their products, and what ALPHA and BETA
 * leave. */
static void fit_entry(struct fit *f, double m, double d, double k, double alpha, double beta)
{
    double left = d - alpha * m - beta * k;

    f->mm += m * m;                       /* normal equations of what is left of C */
    f->mk += m * k;
    f->kk += k * k;
    f->cm += left * m;
    f->ck += left * k;
    f->worst = fmax(f->worst, fabs(left));
    f->scale = fmax(f->scale, fabs(d));
}

bool condense_proportional(const struct condense *c, double *alpha, double *beta)
{
    const struct sparse *A = c->p->constant;
    struct workspace space = { 0 };
    size_t n = (size_t)c->n;
    double *row = workspace_zeros(&space, 3 * n, sizeof *row);
    bool *seen = workspace_zeros(&space, n, sizeof *seen), ok = !space.failed;
    int *column = workspace_zeros(&space, n, sizeof *column);
    struct fit f = { 0 };

    *alpha = *beta = 0;
    ok = ok && column != NULL;
    /* Least squares over all entries for alpha and beta, once more for what that leaves, as sums
     * of 100,000 entries are rounded, then how far off they are. */
    for (int pass = 0; ok && pass < PASSES; pass++) {
        double det = f.mm * f.kk - f.mk * f.mk;

        if (pass > 0) {
            *alpha += det > APART * f.mm * f.kk ? (f.cm * f.kk - f.ck * f.mk) / det
                      : f.mm > 0 ? f.cm / f.mm : 0;
            *beta += det > APART * f.mm * f.kk ? (f.ck * f.mm - f.cm * f.mk) / det : 0;
        }
        f = (struct fit) { 0 };
        for (int i = 0; i < c->n; i++) {
            int count = 0;

            for (int t = 0; t < 3; t++)
                if (A[t].start != NULL)
                    count = scatter(&A[t], i, row + (size_t)t * n, seen, column, count);
            for (int e = 0; e < count; e++) {
                double *at = row + column[e];

                fit_entry(&f, at[PROGRAM_M * n], at[PROGRAM_C * n], at[PROGRAM_K * n], *alpha,
                          *beta);
                at[0] = at[n] = at[2 * n] = 0;
                seen[column[e]] = false;
            }
        }
    }
    workspace_free(&space);
    return ok && f.worst <= PROPORTIONAL * f.scale;
}

/* K_rr phi = M_rr phi lambda; a tridiagonal K with diagonal M by its own solver. */
static bool modes_of(struct condense *c, double *K, double *M)
{
    int r = c->r;
    bool tridiagonal = true;

    for (int j = 0; j < r && tridiagonal; j++)
        for (int i = 0; i < r; i++)
            if ((K[(size_t)j * (size_t)r + (size_t)i] != 0 && abs(i - j) > 1)
                || (M[(size_t)j * (size_t)r + (size_t)i] != 0 && i != j)) {
                tridiagonal = false;
                break;
            }
    /* A chain: in M^1/2 x the problem is tridiagonal and symmetric. */
    if (tridiagonal) {
        double *e = calloc((size_t)r + 1, sizeof *e), *root = calloc((size_t)r + 1, sizeof *root);
        bool ok = e != NULL && root != NULL;

        for (int i = 0; ok && i < r; i++) {
            double mass = M[(size_t)i * (size_t)(r + 1)];

            ok = mass > 0;
            root[i] = sqrt(mass);                       /* M = root root^T */
        }
        for (int i = 0; ok && i < r; i++) {
            /* root^-1 K root^-1 */
            c->lambda[i] = K[(size_t)i * (size_t)(r + 1)] / (root[i] * root[i]);
            e[i] = i + 1 < r ? K[(size_t)i * (size_t)(r + 1) + 1] / (root[i] * root[i + 1]) : 0;
        }
        ok = ok && LAPACKE_dstevd(LAPACK_COL_MAJOR, 'V', r, c->lambda, e, c->phi, r) == 0;
        for (int j = 0; ok && j < r; j++)
            for (int i = 0; i < r; i++)
                c->phi[(size_t)j * (size_t)r + (size_t)i] /= root[i];  /* back: phi^T M phi = 1 */
        free(e);
        free(root);
        return ok;
    }
    /* Else the dense generalised problem, which fails where M is not positive. */
    if (LAPACKE_dsygvd(LAPACK_COL_MAJOR, 1, 'V', 'L', r, K, r, M, r, c->lambda) != 0)
        return false;
    memcpy(c->phi, K, (size_t)r * (size_t)r * sizeof *K);
    return true;
}

/* phi^T B, r x q */
static void project(const struct condense *c, const double *B, double *out)
{
    for (int j = 0; j < c->q; j++)
        for (int m = 0; m < c->r; m++) {
            double sum = 0;

            for (int i = 0; i < c->r; i++)
                sum += c->phi[(size_t)m * (size_t)c->r + (size_t)i]
                       * B[(size_t)j * (size_t)c->r + (size_t)i];
            out[(size_t)j * (size_t)c->r + (size_t)m] = sum;
        }
}

/* The products that modes_at sums: k_i k_j, k_i m_j, m_i k_j, m_i m_j. */
static void weights(struct condense *c)
{
    size_t r = (size_t)c->r;

    c->massless = true;
    for (size_t e = 0; e < r * (size_t)c->q; e++)
        c->massless &= c->am[e] == 0;
    for (int i = 0; i < c->q; i++)
        for (int j = 0; j < c->q; j++) {
            double *w = c->weight + (size_t)(i * (c->q + 1) + j) * 4 * r;
            const double *ki = c->ak + (size_t)i * r, *kj = c->ak + (size_t)j * r,
                         *mi = c->am + (size_t)i * r, *mj = c->am + (size_t)j * r;

            for (size_t m = 0; m < r; m++) {
                w[m] = ki[m] * kj[m];                   /* in the order of modes_at */
                w[r + m] = ki[m] * mj[m];
                w[2 * r + m] = mi[m] * kj[m];
                w[3 * r + m] = mi[m] * mj[m];
            }
        }
}

enum modal_status condense_reduce(struct condense *c, bool *done, struct modal_error *err)
{
    size_t r = (size_t)c->r, q = (size_t)c->q;
    double *K = NULL, *M = NULL, *Bk = NULL, *Bm = NULL, alpha = 0;
    enum modal_status rc = MODAL_OK;

    *done = c->reduced;
    if (c->reduced || c->r < 1 || c->q < 1 || c->r > MODES_MOST || c->p->n_linear > 0
        || !sparse_symmetric(&c->p->constant[PROGRAM_M], SYMMETRIC)
        || !sparse_symmetric(&c->p->constant[PROGRAM_K], SYMMETRIC)
        || !condense_proportional(c, &alpha, &c->beta))
        return MODAL_OK;
    K = calloc(r * r, sizeof *K);
    M = calloc(r * r, sizeof *M);
    Bk = calloc(r * q, sizeof *Bk);
    Bm = calloc(r * q, sizeof *Bm);
    c->phi = workspace_zeros(&c->space, r * r, sizeof *c->phi);
    c->lambda = workspace_zeros(&c->space, r, sizeof *c->lambda);
    c->damping = workspace_zeros(&c->space, r, sizeof *c->damping);
    c->ak = workspace_zeros(&c->space, r * q, sizeof *c->ak);
    c->am = workspace_zeros(&c->space, r * q, sizeof *c->am);
    c->weight = workspace_zeros(&c->space, 4 * q * (q + 1) * r, sizeof *c->weight);
    if (K == NULL || M == NULL || Bk == NULL || Bm == NULL || c->space.failed) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "condense: no memory for %d modes", c->r);
        goto out;
    }
    spread(c, PROGRAM_K, K, Bk);
    spread(c, PROGRAM_M, M, Bm);
    if (!modes_of(c, K, M))
        goto out;
    for (size_t m = 0; m < r; m++)
        c->damping[m] = alpha + c->beta * c->lambda[m];  /* c_j */
    project(c, Bk, c->ak);
    project(c, Bm, c->am);
    /* C_rq = alpha M_rq + beta K_rq; (3) has the beta part only, so a mass that couples needs alpha
     * to be 0 */
    weights(c);
    *done = c->reduced = c->massless || alpha == 0;
out:
    free(K);
    free(M);
    free(Bk);
    free(Bm);
    return rc;
}
