/*
 * moving_signals.c - the signals of one window, from its compressed rows
 *
 * Owned here: `struct job`, the rows of the present window and what is fitted on them.  Many channels are reduced to proper orthogonal modes, the right
 * singular vectors of the window's triangle R times the channels' scales: pod.c's choice, without a pass over the window.
 */
#include "modal/identify/moving_state.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/pod.h"
#include "modal/linalg/qr.h"
#include "modal/linalg/svd.h"

enum { STEPS_MOST = 24, STEPS_LOOK = 3 };           /* of orthogonal iteration; between looks at the residual */
static const double FAR = 0.3;                   /* the first value of the rest over the last that is kept */
static const double SETTLED = 1e-13;             /* of the largest singular value */

void job_done(struct job *j)
{
    free(j->Y.x), free(j->R), free(j->rest), free(j->scale), free(j->weight), free(j->W), free(j->outside2), free(j->X.x), free(j->growth);
    moving_fit_done(&j->first), moving_fit_done(&j->own), moving_fit_done(&j->channels);
}

static void copy_samples(const struct job *j, uint64_t from, int count, int row)
{
    const double *y = moving_sample(j->m, from);

    for (int l = 0; l < count; l++)
        for (int c = 0; c < j->m->S; c++)
            j->Y.x[row + l + (size_t)c * (size_t)j->Y.ld] = y[(size_t)l * (size_t)j->m->S + (size_t)c];
}

/* The window's rows, compressed, and their triangles. */
enum modal_status job_take(struct job *j, struct modal_error *err)
{
    struct moving *m = j->m;
    uint64_t from = m->next - (uint64_t)m->L, last = m->count > 0 ? m->block_from + (uint64_t)m->count * (uint64_t)m->B : m->next;
    int S = m->S, lead = m->count > 0 ? (int)(m->block_from - from) : m->L, trail = (int)(m->next - last), n;
    struct matrix loose = { lead + trail, S, lead + trail, NULL };
    enum modal_status rc;

    j->rows = (struct moving_rows) { lead, m->count, trail, m->B, m->k, m->Q, m->opt.dt, m->table != NULL ? m->anchor.count : 0, m->anchor.lambda, m->table };
    n = moving_rows_count(&j->rows);
    j->Y = (struct matrix) { n, S, n, malloc(sizeof(double) * (size_t)n * (size_t)S) };
    j->R = malloc(sizeof(double) * (size_t)S * (size_t)S), j->rest = malloc(sizeof(double) * (size_t)S * (size_t)S);
    j->scale = calloc((size_t)S, sizeof(double)), j->weight = calloc((size_t)S, sizeof(double));
    j->W = malloc(sizeof(double) * (size_t)S * (size_t)S), j->outside2 = malloc(sizeof(double) * (size_t)S);
    j->X = (struct matrix) { n, S, n, malloc(sizeof(double) * (size_t)n * (size_t)S) };
    loose.x = malloc(sizeof(double) * (size_t)(loose.m + 1) * (size_t)S);
    if (j->Y.x == NULL || j->R == NULL || j->rest == NULL || j->scale == NULL || j->weight == NULL || j->W == NULL || j->outside2 == NULL
        || j->X.x == NULL || loose.x == NULL) {
        free(loose.x);
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", n, S);
    }
    copy_samples(j, from, lead, 0);
    copy_samples(j, last, trail, n - trail);
    for (int b = 0; b < m->count; b++)
        for (int c = 0; c < S; c++)
            memcpy(j->Y.x + lead + b * m->k + (size_t)c * (size_t)n, m->blocks[b].C + (size_t)c * (size_t)m->k, sizeof(double) * (size_t)m->k);
    for (int c = 0; c < S; c++) {
        memcpy(loose.x + (size_t)c * (size_t)loose.m, j->Y.x + (size_t)c * (size_t)n, sizeof(double) * (size_t)lead);
        memcpy(loose.x + lead + (size_t)c * (size_t)loose.m, j->Y.x + n - trail + (size_t)c * (size_t)n, sizeof(double) * (size_t)trail);
    }
    rc = window_qr_factor(m->all, &loose, j->R, err);
    if (rc == MODAL_OK)
        rc = window_qr_factor(m->rest, NULL, j->rest, err);
    for (int c = 0; c < S; c++) {
        j->scale[c] = safe_norm(j->R + (size_t)c * (size_t)S, (size_t)c + 1) / sqrt(m->L);
        j->weight[c] = 1;
    }
    free(loose.x);
    return rc;
}

static double channel_factor(const struct job *j, int c)
{
    return j->scale[c] > 0 ? j->weight[c] / j->scale[c] : 0;
}

/* How many of all singular values stand out of the rest: (1) of pod.c. */
static int above_rest(const struct moving *m, const double *s, int most)
{
    double L = m->L, S = m->S, rest = 0;

    for (int i = 0; i < m->S; i++)
        rest += s[i] * s[i];
    for (int k = 0; k < most && k < S; k++) {
        if (s[k] <= 1.02 * sqrt(fmax(rest, 0) / ((L - k) * (S - k))) * (sqrt(L - k) + sqrt(S - k)))
            return k;
        rest -= s[k] * s[k];
    }
    return most;
}

static int signals_kept(const struct job *j, const double *s)
{
    int k = 0;

    while (k < j->m->S && s[k] > j->m->L * DBL_EPSILON * s[0])
        k++;
    if (j->m->rest_white[j->weighed])
        k = above_rest(j->m, s, k);
    return k < 1 ? 1 : k > POD_SIGNALS_MOST ? POD_SIGNALS_MOST : k;
}

/* All singular values of A, and its right vectors. */
static enum modal_status all_triplets(struct matrix *A, double *s, struct matrix *VT, struct modal_error *err)
{
    int S = A->n;
    struct matrix U = { S, S, S, malloc(sizeof(double) * (size_t)S * (size_t)S) };
    enum modal_status rc = U.x == NULL ? modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S) : svd_thin(A, s, &U, VT, err);

    free(U.x);
    return rc;
}

/* The singular values of A - A V V^T, descending, V^T being the first r rows of VT: of what is left, to half the digits, which is enough to compare. */
static enum modal_status values_of_rest(const struct matrix *A, const struct matrix *VT, int r, double *s, struct modal_error *err)
{
    int S = A->n;
    size_t size = (size_t)S * (size_t)S;
    double *B = malloc(sizeof *B * (2 * size + (size_t)r * (size_t)S)), *G = B + size, *AV = G + size;
    enum modal_status rc = MODAL_OK;

    if (B == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
    memcpy(B, A->x, sizeof *B * size);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, S, r, S, 1, A->x, S, VT->x, VT->ld, 0, AV, S);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, S, S, r, -1, AV, S, VT->x, VT->ld, 1, B, S);
    cblas_dsyrk(CblasColMajor, CblasUpper, CblasTrans, S, S, 1, B, S, 0, G, S);
    if (LAPACKE_dsyevd(LAPACK_COL_MAJOR, 'N', 'U', S, G, S, AV) != 0)
        rc = modal_fail(err, MODAL_NO_CONVERGENCE, "moving: singular values of %d channels", S);
    for (int i = 0; i < S - r && rc == MODAL_OK; i++)
        s[i] = sqrt(fmax(AV[S - 1 - i], 0));
    free(B);
    return rc;
}

/* V (S x r, orthonormal), turned so that A V = U diag(s); U is S x r.  *residual: the largest |A^T u - s v| over s[0]. */
static enum modal_status ritz(const struct matrix *A, struct matrix *V, struct matrix *U, double *s, double *residual, struct modal_error *err)
{
    int S = A->n, r = V->n;
    size_t size = (size_t)S * (size_t)r;
    double *x = malloc(sizeof *x * (2 * size + (size_t)r * (size_t)r)), *turn = x + 2 * size;
    struct matrix AV = { S, r, S, x }, T = { r, r, r, turn };
    enum modal_status rc;

    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, S, r, S, 1, A->x, S, V->x, S, 0, AV.x, S);
    rc = svd_thin(&AV, s, U, &T, err);
    if (rc == MODAL_OK) {
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, S, r, r, 1, V->x, S, turn, r, 0, x + size, S);
        memcpy(V->x, x + size, sizeof *x * size);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, S, r, S, 1, A->x, S, U->x, S, 0, x, S);
    }
    *residual = 0;
    for (int i = 0; i < r && rc == MODAL_OK; i++) {
        cblas_daxpy(S, -s[i], V->x + (size_t)i * (size_t)S, 1, x + (size_t)i * (size_t)S, 1);
        *residual = fmax(*residual, cblas_dnrm2(S, x + (size_t)i * (size_t)S, 1) / s[0]);
    }
    free(x);
    return rc;
}

/*
 * V, S x r, from the window before to the r leading right vectors of A, by orthogonal iteration: the angle to them shrinks by (s[r] / s[r-1])^2 a step, and
 * what stands out of noise stands far out of it, as a rule.  *done is false where it does not, within STEPS_MOST.
 */
static enum modal_status iterate(const struct matrix *A, struct matrix *V, double *s, bool *done, struct modal_error *err)
{
    int S = A->n, r = V->n;
    struct matrix U = { S, r, S, malloc(sizeof(double) * (size_t)S * (size_t)r) };
    double residual = HUGE_VAL, before;
    enum modal_status rc = U.x == NULL ? modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S) : MODAL_OK;

    *done = false;
    for (int i = 0; i < STEPS_MOST && rc == MODAL_OK && !*done; i += STEPS_LOOK) {
        for (int k = 0; k < STEPS_LOOK && rc == MODAL_OK; k++) {
            cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, S, r, S, 1, A->x, S, V->x, S, 0, U.x, S);
            cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, S, r, S, 1, A->x, S, U.x, S, 0, V->x, S);
            rc = qr_orthonormal(V, NULL, err);
        }
        before = residual;
        if (rc == MODAL_OK)
            rc = ritz(A, V, &U, s, &residual, err);
        *done = residual <= SETTLED;
        if (!*done && !(residual < 0.3 * before))
            break;
    }
    free(U.x);
    return rc;
}

/* Only the triplets that stand out, as many as in the window before and found from them, and of the rest the values; *enough is false where that is not their
 * number now. */
static enum modal_status leading_triplets(const struct job *j, const struct matrix *A, double *s, struct matrix *VT, bool *enough, struct modal_error *err)
{
    const struct kept_modes *kept = &j->m->kept[j->weighed];
    int S = A->n, r = kept->count;
    struct matrix V = { S, r, S, NULL };
    enum modal_status rc;

    *enough = false;
    if (r < 1 || 3 * r > S || !j->m->rest_white[j->weighed])
        return MODAL_OK;
    V.x = malloc(sizeof *V.x * (size_t)S * (size_t)r);
    if (V.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
    memcpy(V.x, kept->V, sizeof *V.x * (size_t)S * (size_t)r);
    rc = iterate(A, &V, s, enough, err);
    for (int i = 0; i < r; i++)
        cblas_dcopy(S, V.x + (size_t)i * (size_t)S, 1, VT->x + i, VT->ld);
    free(V.x);
    if (rc == MODAL_OK && *enough)
        rc = values_of_rest(A, VT, r, s + r, err);
    *enough = rc == MODAL_OK && *enough && s[r] < s[r - 1] && signals_kept(j, s) == r;
    return rc;
}

/* For the next window, where they stand far enough out of the rest for an iteration to find them. */
static bool keep_modes(struct job *j, const double *s, const struct matrix *VT)
{
    struct kept_modes *kept = &j->m->kept[j->weighed];
    int S = VT->n;

    free(kept->V);
    kept->V = malloc(sizeof *kept->V * (size_t)S * (size_t)j->r);
    kept->count = kept->V != NULL && j->r < S && s[j->r] < FAR * s[j->r - 1] ? j->r : 0;
    for (int i = 0; i < kept->count; i++)
        cblas_dcopy(S, VT->x + i, VT->ld, kept->V + (size_t)i * (size_t)S, 1);
    return kept->V != NULL;
}

/* Proper orthogonal modes from the triangle: pod.c's choice of how many, where it knows all singular values. */
static enum modal_status orthogonal_modes(struct job *j, struct modal_error *err)
{
    int S = j->m->S;
    size_t size = (size_t)S * (size_t)S;
    double *x = malloc(sizeof *x * (2 * size + (size_t)S)), *s = x + 2 * size;
    struct matrix A = { S, S, S, x }, VT = { S, S, S, x + size };
    bool enough = false;
    enum modal_status rc;

    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
    for (int c = 0; c < S; c++)
        for (int i = 0; i < S; i++)
            A.x[i + (size_t)c * (size_t)S] = j->R[i + (size_t)c * (size_t)S] * channel_factor(j, c);
    rc = leading_triplets(j, &A, s, &VT, &enough, err);
    if (rc == MODAL_NO_CONVERGENCE || (rc == MODAL_OK && !enough))
        rc = all_triplets(&A, s, &VT, err);
    if (rc == MODAL_OK) {
        j->r = signals_kept(j, s);
        if (!keep_modes(j, s, &VT))
            rc = modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
        for (int i = 0; i < j->r; i++)
            for (int c = 0; c < S; c++)
                j->W[c + (size_t)i * (size_t)S] = VT.x[i + (size_t)c * (size_t)S] * channel_factor(j, c);
    }
    free(x);
    return rc;
}

/* Channels themselves, to unit rms. */
static void plain_signals(struct job *j)
{
    int S = j->m->S;

    j->r = S;
    memset(j->W, 0, sizeof *j->W * (size_t)S * (size_t)S);
    for (int c = 0; c < S; c++)
        j->W[c + (size_t)c * (size_t)S] = channel_factor(j, c);
}

bool moving_reduced(const struct moving *m)
{
    return m->S > POD_CHANNELS_FEW && !m->opt.identify.signals_all;
}

/* X = Y W, and of what Q does not hold the sums of squares. */
static enum modal_status project(struct job *j, struct modal_error *err)
{
    int S = j->m->S;
    double *T = malloc(sizeof *T * (size_t)S * (size_t)j->r);

    if (T == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d signals", j->r);
    j->X.n = j->r;
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, j->Y.m, j->r, S, 1, j->Y.x, j->Y.ld, j->W, S, 0, j->X.x, j->X.ld);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, S, j->r, S, 1, j->rest, S, j->W, S, 0, T, S);
    for (int g = 0; g < j->r; g++)
        j->outside2[g] = cblas_ddot(S, T + (size_t)g * (size_t)S, 1, T + (size_t)g * (size_t)S, 1);
    free(T);
    return MODAL_OK;
}

enum modal_status job_signals(struct job *j, bool modes, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (modes)
        rc = orthogonal_modes(j, err);
    else
        plain_signals(j);
    return rc == MODAL_OK ? project(j, err) : rc;
}

enum modal_status job_signals_of(struct job *j, const double *W, int r, struct modal_error *err)
{
    j->r = r;
    memcpy(j->W, W, sizeof *W * (size_t)j->m->S * (size_t)r);
    return project(j, err);
}
