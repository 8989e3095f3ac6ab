/*
 * moving_signals.c - the signals of one window, from its compressed rows
 *
 * Owned here: `struct job`, the rows of the present window and what is fitted on them.  Many
 * channels are reduced to proper orthogonal modes, the right singular vectors of the window's
 * triangle R times the channels' scales: pod.c's choice, without a pass over the window.
 */
#include "modal/identify/live/moving_state.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/colour.h"
#include "modal/identify/fit/refine.h"
#include "modal/identify/prepare/pod.h"
#include "modal/linalg/qr.h"
#include "modal/linalg/svd.h"

enum {
    STEPS_MOST = 24,                /* of orthogonal iteration; then the window is decomposed */
    STEPS_LOOK = 3                  /* between looks at the residual */
};
static const double SHRINKS = 0.3;      /* in STEPS_LOOK, or all of STEPS_MOST would not do */
enum { TILE = 16 };                     /* samples and channels that are turned at once */
/* least diagonal of a triangle of unit channels that single precision is enough for */
static const double SINGLE = 1e-4;
static const double FAR = 0.3;          /* the first value of the rest over the last that is kept */
static const double SETTLED = 1e-13;             /* of the largest singular value */

void job_done(struct job *j)
{
    free(j->Y.x), free(j->X.x), free(j->full.x), free(j->Phi), free(j->growth);
    workspace_free(&j->space);
    moving_fit_done(&j->first), moving_fit_done(&j->own), moving_fit_done(&j->channels);
}

static void copy_samples(const struct job *j, uint64_t from, int count, int row)
{
    const double *y = moving_sample(j->m, from);

    for (int l = 0; l < count; l++)
        for (int c = 0; c < j->m->S; c++)
            j->Y.x[row + l + (size_t)c * (size_t)j->Y.ld] =
                y[(size_t)l * (size_t)j->m->S + (size_t)c];
}

/* The norms of channel c's samples in what is loose and in the blocks, or of what Q does not hold
 * of them; room for blocks + 2 in X. */
static double norm_of_channel(const struct job *j, int c, bool left, double *x)
{
    const struct moving *m = j->m;
    const double *y = j->Y.x + (size_t)c * (size_t)j->Y.ld;

    for (int b = 0; b < m->count; b++)
        x[b] = left ? m->blocks[b].left[c] : m->blocks[b].norm[c];
    /* loose rows are whole: Q leaves nothing of them out */
    x[m->count] = left ? 0 : quick_norm(y, (size_t)j->rows.lead);
    x[m->count + 1] = left ? 0 : quick_norm(y + j->Y.m - j->rows.trail, (size_t)j->rows.trail);
    return safe_norm(x, (size_t)m->count + 2);
}

/* j->R, from the blocks' triangle and the loose rows. */
static enum modal_status triangle_of_window(struct job *j, struct modal_error *err)
{
    int S = j->m->S, n = j->Y.m, lead = j->rows.lead, trail = j->rows.trail;
    struct matrix loose = { lead + trail, S, lead + trail,
                            malloc(sizeof(double) * (size_t)(lead + trail + 1) * (size_t)S) };
    enum modal_status rc;

    if (loose.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", loose.m, S);
    for (int c = 0; c < S; c++) {
        memcpy(loose.x + (size_t)c * (size_t)loose.m, j->Y.x + (size_t)c * (size_t)n,
               sizeof(double) * (size_t)lead);
        memcpy(loose.x + lead + (size_t)c * (size_t)loose.m,
               j->Y.x + n - trail + (size_t)c * (size_t)n, sizeof(double) * (size_t)trail);
    }
    rc = window_qr_factor(j->m->all, &loose, j->R, err);
    free(loose.x);
    return rc;
}

/* The window's rows, compressed, their norms, and their triangle where it is needed. */
enum modal_status job_take(struct job *j, struct modal_error *err)
{
    struct moving *m = j->m;
    uint64_t from = m->next - (uint64_t)m->L,
             last = m->count > 0 ? m->block_from + (uint64_t)m->count * (uint64_t)m->B : m->next;
    int S = m->S, lead = m->count > 0 ? (int)(m->block_from - from) : m->L,
        trail = (int)(m->next - last), n;
    size_t columns = (size_t)S;
    double *norms, **each[] = { &j->left, &j->scale, &j->weight, &j->outside2 };

    j->rows = (struct moving_rows) { lead, m->count, trail, m->B, m->k, m->Q, m->opt.dt,
                                     m->table != NULL ? m->anchor.count : 0, m->anchor.lambda,
                                     m->table };
    n = moving_rows_count(&j->rows);
    j->Y = matrix_new(n, S);
    j->X = matrix_new(n, S);
    j->R = workspace_room(&j->space, columns * columns, sizeof *j->R);
    j->W = workspace_room(&j->space, columns * columns, sizeof *j->W);
    for (size_t i = 0; i < sizeof each / sizeof *each; i++)
        *each[i] = workspace_numbers(&j->space, columns, 1);
    norms = workspace_room(&j->space, (size_t)m->count + 2, sizeof *norms);
    if (j->Y.x == NULL || j->X.x == NULL || j->space.failed)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", n, S);
    copy_samples(j, from, lead, 0);
    copy_samples(j, last, trail, n - trail);
    for (int b = 0; b < m->count; b++)
        matrix_copy(m->k, S, m->blocks[b].C, m->k, j->Y.x + lead + b * m->k, n);
    for (int c = 0; c < S; c++) {
        j->scale[c] = norm_of_channel(j, c, false, norms) / sqrt(m->L),
        j->left[c] = norm_of_channel(j, c, true, norms);
        j->weight[c] = 1;
    }
    return moving_reduced(m) ? triangle_of_window(j, err) : MODAL_OK;
}

static double channel_factor(const struct job *j, int c)
{
    return j->scale[c] > 0 ? j->weight[c] / j->scale[c] : 0;
}

/* How many of the first MOST singular values stand out of the rest; TOTAL: the sum of squares of
 * all.  *rest: that of the others. */
static int above_rest(const struct moving *m, const double *s, int most, double total, double *rest)
{
    *rest = total;
    for (int k = 0; k < most && k < m->S; k++) {
        if (s[k] <= pod_edge(m->L - k, m->S - k, *rest))
            return k;
        *rest -= s[k] * s[k];
    }
    return most;
}

static double square_of(const double *x, size_t count)
{
    double norm = quick_norm(x, count);

    return norm * norm;
}

/* How many are more than rounding. */
static int above_rounding(const struct job *j, const double *s)
{
    int k = 0;

    while (k < j->m->S && s[k] > j->m->L * DBL_EPSILON * s[0])
        k++;                        /* as pod.c on clean data */
    return k;
}

/* All singular values of A, and its right vectors. */
static enum modal_status all_triplets(struct matrix *A, double *s, struct matrix *VT,
                                      struct modal_error *err)
{
    int S = A->n;
    struct matrix U = matrix_new(S, S);
    enum modal_status rc = U.x == NULL
        ? modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S)
        : svd_thin(A, s, &U, VT, err);

    free(U.x);
    return rc;
}

/* V (S x r, orthonormal), turned so that A V = U diag(s); U is S x r.  *residual: the largest |A^T
 * u - s v| over s[0]. */
static enum modal_status ritz(const struct matrix *A, struct matrix *V, struct matrix *U, double *s,
                              double *residual, struct modal_error *err)
{
    int S = A->n, r = V->n;
    size_t size = (size_t)S * (size_t)r;
    double *x = malloc(sizeof *x * (2 * size + (size_t)r * (size_t)r)), *turn = x + 2 * size;
    struct matrix AV = { S, r, S, x }, T = { r, r, r, turn };
    enum modal_status rc;

    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, S, r, S, 1, A->x, S, V->x, S, 0, AV.x,
                S);
    rc = svd_thin(&AV, s, U, &T, err);
    if (rc == MODAL_OK) {
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, S, r, r, 1, V->x, S, turn, r, 0,
                    x + size, S);
        memcpy(V->x, x + size, sizeof *x * size);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, S, r, S, 1, A->x, S, U->x, S, 0, x, S);
    }
    *residual = 0;
    for (int i = 0; i < r && rc == MODAL_OK; i++) {
        cblas_daxpy(S, -s[i], V->x + (size_t)i * (size_t)S, 1, x + (size_t)i * (size_t)S, 1);
        /* |A^T u - s v| bounds the error of s; A v = s u holds by construction */
        *residual = fmax(*residual, cblas_dnrm2(S, x + (size_t)i * (size_t)S, 1) / s[0]);
    }
    free(x);
    return rc;
}

/*
 * V, S x r, from the window before to the r leading right vectors of A, by orthogonal iteration:
 * the angle to them shrinks by (s[r] / s[r-1])^2 a step, and what stands out of noise stands far
 * out of it, as a rule.  *done is false where it does not, within STEPS_MOST.
 */
static enum modal_status iterate(const struct matrix *A, struct matrix *V, double *s, bool *done,
                                 struct modal_error *err)
{
    int S = A->n, r = V->n;
    struct matrix U = matrix_new(S, r);
    double residual = HUGE_VAL, before;
    enum modal_status rc = U.x == NULL
        ? modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S)
        : MODAL_OK;

    *done = false;
    for (int i = 0; i < STEPS_MOST && rc == MODAL_OK && !*done; i += STEPS_LOOK) {
        for (int k = 0; k < STEPS_LOOK && rc == MODAL_OK; k++) {
            cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, S, r, S, 1, A->x, S, V->x, S, 0,
                        U.x, S);
            cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, S, r, S, 1, A->x, S, U.x, S, 0,
                        V->x, S);
            rc = qr_orthonormal(V, NULL, err);
        }
        before = residual;
        if (rc == MODAL_OK)
            rc = ritz(A, V, &U, s, &residual, err);
        *done = residual <= SETTLED;
        /* at this rate STEPS_MOST do not reach SETTLED */
        if (!*done && !(residual < SHRINKS * before))
            break;
    }
    free(U.x);
    return rc;
}

/* Whether every singular value of B = A - A V V^T, V^T being the first r rows of VT, is below EDGE:
 * edge^2 - B^T B has a Cholesky factor.  To half the digits, which is enough to compare. */
static enum modal_status rest_is_below(const struct matrix *A, const struct matrix *VT, int r,
                                       double edge, bool *below, struct modal_error *err)
{
    int S = A->n;
    size_t size = (size_t)S * (size_t)S;
    double *B = malloc(sizeof *B * (2 * size + (size_t)r * (size_t)S)), *G = B + size,
           *AV = G + size;

    if (B == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
    memcpy(B, A->x, sizeof *B * size);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, S, r, S, 1, A->x, S, VT->x, VT->ld, 0, AV,
                S);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, S, S, r, -1, AV, S, VT->x, VT->ld, 1, B,
                S);
    cblas_dsyrk(CblasColMajor, CblasUpper, CblasTrans, S, S, -1, B, S, 0, G, S);
    for (int i = 0; i < S; i++)
        G[i + (size_t)i * (size_t)S] += edge * edge;
    /* definite: |B x| < edge |x| for every x */
    *below = edge > 0 && LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'U', S, G, S) == 0;
    free(B);
    return MODAL_OK;
}

/*
 * ---- is what the kept modes leave white in time? ----
 *
 * colour.h's test asks for the mean autocorrelation of the other left singular vectors, which is a
 * trace: of all columns of an orthonormal basis of the window's column space, Y R^{-1}, less that
 * of the kept ones.  The first part serves both choices of weights.
 */

/* Add SIGN times the autocorrelations of E's columns, each over its square, at lags 1 ..
 * COLOUR_LAGS. */
static void add_lags(const struct matrix *E, double sign, double *lags)
{
    for (int c = 0; c < E->n; c++) {
        const double *e = E->x + (size_t)c * (size_t)E->ld;
        double square = cblas_ddot(E->m, e, 1, e, 1);
        for (int l = 1; l <= COLOUR_LAGS && square > 0; l++)
            /* biased, as a spectrum's: it is definite */
            lags[l - 1] += sign * (cblas_ddot(E->m - l, e, 1, e + l, 1) / square);
    }
}

/* E = samples W, L x n. */
static void combine_samples(const struct moving *m, const double *W, struct matrix *E)
{
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, m->L, E->n, m->S, 1,
                moving_sample(m, m->next - (uint64_t)m->L), m->S, W, m->S, 0, E->x, m->L);
}

/* The triangle of channels of norm 1 into R; a channel that those before it span to rounding is
 * left out: unit[c] zero, and unit in R.  The least diagonal. */
static double unit_triangle(const struct job *j, double *R, double *unit)
{
    int S = j->m->S;
    double least = 1;

    for (int c = 0; c < S; c++) {
        unit[c] = j->scale[c] > 0 ? 1 / (j->scale[c] * sqrt(j->m->L)) : 0;
        for (int i = 0; i < S; i++)
            R[i + (size_t)c * (size_t)S] = unit[c] * j->R[i + (size_t)c * (size_t)S];
    }
    for (int c = 0; c < S; c++) {
        /* of a channel, beside the others: below rounding the channels before it span it */
        double diagonal = fabs(R[c + (size_t)c * (size_t)S]);
        for (int i = 0; i < S && !(diagonal > REFINE_EXACT); i++)
            R[c + (size_t)i * (size_t)S] = R[i + (size_t)c * (size_t)S] = i == c;
        unit[c] = diagonal > REFINE_EXACT ? unit[c] : 0;
        least = diagonal > REFINE_EXACT ? fmin(least, diagonal) : least;
    }
    return least;
}

/* The window's samples times UNIT, channel by channel, into E in double precision or F in single.
 * */
static void unit_samples(const struct job *j, const double *unit, double *E, float *F)
{
    int S = j->m->S, L = j->m->L;
    const double *y = moving_sample(j->m, j->m->next - (uint64_t)L);

    for (int l = 0; l < L; l += TILE)
        for (int c = 0; c < S; c++)
            for (int i = l; i < L && i < l + TILE; i++) {
                double v = unit[c] * y[(size_t)i * (size_t)S + (size_t)c];
                if (F != NULL)
                    F[(size_t)i + (size_t)c * (size_t)L] = (float)v;
                else
                    E[(size_t)i + (size_t)c * (size_t)L] = v;
            }
}

/* Add the autocorrelations of E's columns at lags 1 .. COLOUR_LAGS. */
static void add_lags_single(int L, int S, const float *E, double *lags)
{
    for (int c = 0; c < S; c++) {
        const float *e = E + (size_t)c * (size_t)L;
        double square = cblas_dsdot(L, e, 1, e, 1);
        for (int l = 1; l <= COLOUR_LAGS && square > 0; l++)
            lags[l - 1] += cblas_sdot(L - l, e, 1, e + l, 1) / square;
    }
}

/* j->lags, once a window.  In single precision where the triangle's condition leaves three digits:
 * the limit is ten times what white noise shows. */
static enum modal_status lags_of_all(struct job *j, struct modal_error *err)
{
    int S = j->m->S, L = j->m->L;
    size_t square = (size_t)S * (size_t)S, size = (size_t)L * (size_t)S;
    double *R = malloc(sizeof *R * (square + (size_t)S + size)), *unit = R + square;
    struct matrix E = { L, S, L, unit + S };
    float *T = malloc(sizeof *T * square), *F = (float *)E.x;
    bool single;

    if (R == NULL || T == NULL) {
        free(R), free(T);
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", L, S);
    }
    single = unit_triangle(j, R, unit) > SINGLE;
    unit_samples(j, unit, E.x, single ? F : NULL);
    for (size_t i = 0; i < square; i++)
        T[i] = (float)R[i];
    if (single) {
        cblas_strsm(CblasColMajor, CblasRight, CblasUpper, CblasNoTrans, CblasNonUnit, L, S, 1, T,
                    S, F, L);
        add_lags_single(L, S, F, j->lags);
    } else {
        cblas_dtrsm(CblasColMajor, CblasRight, CblasUpper, CblasNoTrans, CblasNonUnit, L, S, 1, R,
                    S, E.x, L);
        add_lags(&E, 1, j->lags);
    }
    j->lags_known = true;
    free(R), free(T);
    return MODAL_OK;
}

/* j->W, j->full and j->r of the first r rows of VT. */
static enum modal_status take_modes(struct job *j, const struct matrix *VT, int r,
                                    struct modal_error *err)
{
    int S = j->m->S, L = j->m->L;

    free(j->full.x);
    j->full = matrix_new(L, r);
    if (j->full.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", L, r);
    j->r = r;
    for (int i = 0; i < r; i++)
        for (int c = 0; c < S; c++)
            j->W[c + (size_t)i * (size_t)S] =
                VT->x[i + (size_t)c * (size_t)VT->ld] * channel_factor(j, c);
    if (r > 0)
        combine_samples(j->m, j->W, &j->full);
    return MODAL_OK;
}

/* VT's first r rows are the kept ones' right vectors, which become J's. */
static enum modal_status rest_is_white(struct job *j, const struct matrix *VT, int r, bool *white,
                                       struct modal_error *err)
{
    int S = j->m->S, L = j->m->L;
    double lags[COLOUR_LAGS], sum = 0, n = (double)L * (S - r);
    enum modal_status rc = take_modes(j, VT, r, err);

    if (rc == MODAL_OK && !j->lags_known)
        rc = lags_of_all(j, err);
    memcpy(lags, j->lags, sizeof lags);
    if (rc == MODAL_OK)
        add_lags(&j->full, -1, lags);
    for (int l = 0; l < COLOUR_LAGS; l++)
        sum += lags[l] / (S - r) * (lags[l] / (S - r));
    *white = n * sum <= COLOUR_LIMIT;  /* each lag of white noise has variance 1/n: colour.h */
    return rc;
}

/* Only the triplets that stand out, as many as in the window before and found from them, and for
 * the next value a bound; *enough is false where that is not their number now. */
static enum modal_status leading_triplets(struct job *j, const struct matrix *A, double *s,
                                          struct matrix *VT, bool *enough, struct modal_error *err)
{
    const struct kept_modes *kept = &j->m->kept[j->weighed];
    int S = A->n, r = kept->count;
    struct matrix V = { S, r, S, NULL };
    double rest;
    enum modal_status rc;

    *enough = false;
    if (r < 1 || 3 * r > S)
        return MODAL_OK;
    V.x = malloc(sizeof *V.x * (size_t)S * (size_t)r);
    if (V.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
    memcpy(V.x, kept->V, sizeof *V.x * (size_t)S * (size_t)r);
    rc = iterate(A, &V, s, enough, err);
    for (int i = 0; i < r; i++)
        cblas_dcopy(S, V.x + (size_t)i * (size_t)S, 1, VT->x + i, VT->ld);
    free(V.x);
    if (rc != MODAL_OK || !*enough
        || above_rest(j->m, s, r, square_of(A->x, (size_t)S * (size_t)S), &rest) != r)
        return *enough = false, rc;
    s[r] = pod_edge(j->m->L - r, j->m->S - r, rest);           /* no more than this, if it is */
    if (s[r] < s[r - 1])
        rc = rest_is_below(A, VT, r, s[r], enough, err);
    if (rc == MODAL_OK && *enough && s[r] < s[r - 1])
        rc = rest_is_white(j, VT, r, enough, err);
    else
        *enough = false;
    return rc;
}

/* All of them, and how many are kept: those that stand out of the rest where that is white, all but
 * rounding where it is not. */
static enum modal_status every_triplet(struct job *j, const struct matrix *A, double *s,
                                       struct matrix *VT, struct modal_error *err)
{
    size_t size = (size_t)A->n * (size_t)A->n;
    struct matrix copy = matrix_new(A->n, A->n);
    bool white = false;
    double rest;
    int most, k;
    enum modal_status rc;

    if (copy.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", A->n);
    memcpy(copy.x, A->x, sizeof(double) * size);
    rc = all_triplets(&copy, s, VT, err);
    free(copy.x);
    if (rc != MODAL_OK)
        return rc;
    most = above_rounding(j, s), k = above_rest(j->m, s, most, square_of(s, (size_t)A->n), &rest);
    if (k < most)
        rc = rest_is_white(j, VT, k, &white, err);
    j->r = white ? k : most;
    return rc;
}

/* For the next window, where they stand far enough out of the rest for an iteration to find them.
 * */
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

/* Proper orthogonal modes from the triangle: pod.c's choice of how many, where it knows all
 * singular values. */
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
    j->r = j->m->kept[j->weighed].count;
    rc = leading_triplets(j, &A, s, &VT, &enough, err);
    if (rc == MODAL_NO_CONVERGENCE || (rc == MODAL_OK && !enough)) {
        rc = every_triplet(j, &A, s, &VT, err);
        if (rc == MODAL_OK)
            rc = take_modes(j, &VT,
                            j->r < 1                      ? 1
                                : j->r > POD_SIGNALS_MOST ? POD_SIGNALS_MOST
                                                          : j->r,
                            err);
    }
    if (rc == MODAL_OK && !keep_modes(j, s, &VT))
        rc = modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
    free(x);
    return rc;
}

bool moving_reduced(const struct moving *m)
{
    return m->S > POD_CHANNELS_FEW && !m->opt.identify.signals_all;
}

/* X = Y W, and of what Q does not hold the sums of squares. */
static enum modal_status project(struct job *j, struct modal_error *err)
{
    const struct moving_rows *r = &j->rows;
    int L = j->m->L;
    double *e = malloc(sizeof *e * (size_t)(r->length + 1) * (size_t)j->r);

    if (e == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d signals", j->r);
    j->X.n = j->r;
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, j->Y.m, j->r, j->m->S, 1, j->Y.x,
                j->Y.ld, j->W, j->m->S, 0, j->X.x, j->X.ld);
    memset(j->outside2, 0, sizeof *j->outside2 * (size_t)j->r);
    for (int b = 0; b < r->blocks; b++) {
        matrix_copy(r->length, j->r, j->full.x + r->lead + b * r->length, L, e, r->length);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, r->length, j->r, r->k, -1, r->Q,
                    r->length, j->X.x + r->lead + b * r->k, j->X.ld, 1, e, r->length);
        for (int g = 0; g < j->r; g++)
            j->outside2[g] += cblas_ddot(r->length, e + (size_t)g * (size_t)r->length, 1,
                                         e + (size_t)g * (size_t)r->length, 1);
    }
    free(e);
    return MODAL_OK;
}

void job_channels(const struct job *j, struct matrix *X, double *outside2)
{
    for (int c = 0; c < j->m->S; c++) {
        double factor = j->scale[c] > 0 ? 1 / j->scale[c] : 0, left = factor * j->left[c];
        for (int l = 0; l < j->Y.m; l++)
            X->x[l + (size_t)c * (size_t)X->ld] = factor * j->Y.x[l + (size_t)c * (size_t)j->Y.ld];
        outside2[c] = left * left;
    }
}

/* Channels themselves, to unit rms, not weighed. */
static enum modal_status plain_signals(struct job *j, struct modal_error *err)
{
    int S = j->m->S, L = j->m->L;
    const double *y = moving_sample(j->m, j->m->next - (uint64_t)L);

    free(j->full.x);
    j->full = matrix_new(L, S);
    if (j->full.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", L, S);
    j->r = j->X.n = S;
    for (int c = 0; c < S; c++)
        for (int l = 0; l < L; l++)
            j->full.x[l + (size_t)c * (size_t)L] =
                channel_factor(j, c) * y[(size_t)l * (size_t)S + (size_t)c];
    job_channels(j, &j->X, j->outside2);
    return MODAL_OK;
}

enum modal_status job_signals(struct job *j, bool modes, struct modal_error *err)
{
    enum modal_status rc = modes ? orthogonal_modes(j, err) : plain_signals(j, err);

    return rc == MODAL_OK && modes ? project(j, err) : rc;
}

enum modal_status job_basis(struct job *j, const struct moving_fit *f, struct modal_error *err)
{
    size_t size = (size_t)moving_rows_count(&j->rows) * (size_t)(f->order + 1);

    if (j->Phi != NULL)
        return MODAL_OK;
    j->Phi = malloc(sizeof *j->Phi * (size + moving_columns_scratch(&j->rows)));
    if (j->Phi == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d columns", f->order);
    moving_basis(&j->rows, f->lambda, f->poles, j->Phi, j->Phi + size);
    return MODAL_OK;
}
