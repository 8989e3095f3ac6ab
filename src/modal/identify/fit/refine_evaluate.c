/* refine_evaluate.c - one evaluation of refine.c's (1), by QR, doubling or sums */
#include "modal/identify/fit/refine_state.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/linear/powers.h"
#include "modal/linalg/qr.h"

enum {
    PANEL_ENTRIES = 1 << 16,        /* of Y at a time, */
    PANEL_LEAST = 4,                /* but so many columns: one read of Q serves all of them */
    REFLECT = 2 * QR_BLOCK,         /* columns of a block of LAPACK's QR: QR_ROOM has as many */
    TALL = 4096                     /* rows from which a triangle is made by blocks of them */
};

/* What evaluations need. */
static void work_release(struct work *w)
{
    doubling_free(w->doubling), gram_free(w->gram);
    w->doubling = NULL, w->gram = NULL;
    workspace_free(&w->space);
}

void refine_free(struct work *w)
{
    work_release(w);
    workspace_free(&w->held);
}

/* What Im of pole J moves by with its own parameter: that of a real multiplier's line is a multiple
 * of i omega / 2, and stays. */
static int own_turn(const struct work *w, double complex lambda)
{
    double halves = w->data->omega > 0 ? cimag(lambda) / (w->data->omega / 2) : 0.5;

    return fabs(halves - nearbyint(halves)) <= REFINE_TIED ? 0 : 1;
}

/* The first pole before J that is a line of the same multiplier, -1: none; *turn: as it lies, or
 * its conjugate does. */
static int tied_to(const struct work *w, const double complex *lambda, int j, int *turn)
{
    double omega = w->data->omega;

    for (int i = 0; i < j && omega > 0; i++)
        for (int sign = 1; sign >= -1 && w->first[i] >= 0; sign -= 2) {
            double im = (sign * cimag(lambda[j]) - cimag(lambda[i])) / omega;
            if (fabs(creal(lambda[j] - lambda[i])) <= REFINE_TIED * omega
                && fabs(im - nearbyint(im)) <= REFINE_TIED) {
                *turn = w->turn[i] * sign;
                return i;
            }
        }
    return -1;
}

/* Columns and parameters of each pole; false: no memory. */
bool refine_layout(struct work *w, const double complex *lambda)
{
    w->kind = workspace_zeros(&w->held, (size_t)w->count, sizeof *w->kind);
    w->column = workspace_zeros(&w->held, (size_t)w->count, sizeof *w->column);
    w->first = workspace_zeros(&w->held, (size_t)w->count, sizeof *w->first);
    w->turn = workspace_zeros(&w->held, (size_t)w->count, sizeof *w->turn);
    w->shares = workspace_zeros(&w->held, (size_t)w->count, sizeof *w->shares);
    if (w->held.failed)
        return false;
    for (int j = 0; j < w->count; j++) {
        w->kind[j] = pole_kind(lambda[j], w->data->tau);
        int n = w->kind[j] == POLE_PAIR ? 2 : 1, head;
        w->column[j] = w->order;
        w->order += n;
        w->turn[j] = own_turn(w, lambda[j]);
        w->first[j] = w->fixed != NULL && w->fixed[j] ? -1 : w->parameters;
        head = w->first[j] < 0 ? -1 : tied_to(w, lambda, j, &w->turn[j]);
        w->shares[j] = head >= 0;
        w->tied |= head >= 0;
        if (head >= 0)
            w->first[j] = w->first[head];
        else if (w->first[j] >= 0)
            w->parameters += w->turn[j] != 0 ? n : 1;
    }
    return true;
}

static bool begin_doubling(struct work *w)
{
    w->doubling = doubling_new(w->L, w->columns, w->panel, w->blocks);
    w->cost = w->doubling != NULL ? doubling_cost(w->doubling, w->S) : 0;
    return w->doubling != NULL;
}

/* How the QR is made, and how many columns of Y at a time.  WHOLE: its rows are all there. */
static bool work_plan(struct work *w, bool whole)
{
    int n = w->columns, S = w->S;
    double L = w->L;

    w->panel = PANEL_ENTRIES / w->L;
    /* of a long record more than the cache holds, rather than Q once for each column */
    w->panel = w->panel < PANEL_LEAST ? PANEL_LEAST : w->panel;
    w->panel = w->panel > S ? S : w->panel;
    w->doubled = whole && doubling_pays(w->L, n, S);
    if (w->doubled) {
        w->blocks = w->data->blocks;
        return w->blocks != NULL || begin_doubling(w);
    }
    w->join = S <= JOIN_MOST && n + S <= w->L;  /* rows enough that [Phi D Y] has a triangle */
    w->panel = w->join ? S : w->panel;
    /* Householder's QR of n columns: L n^2; Q^T Y and P Y: L S (k + q) */
    w->cost = w->join ? L * (n + S) * (n + S) : L * n * n + L * S * (w->most_columns + w->order);
    return true;
}

/* Does (4) of N columns cost more than their turn and that of as many columns as Z has rows? QRs of
 * n (k - q) x P, n x k and k (k - q) x P. */
static bool turn_pays(const struct work *w, int n)
{
    double k = w->most_columns, P = w->parameters + 1, one = (k - w->order) * P * P;

    return n * k * k + k * one < n * one;
}

/* For a QR of all rows, or by doubling. */
static bool allocate_rows(struct work *w, bool whole)
{
    int q = w->order, P = w->parameters + 1;
    size_t L = (size_t)w->L, joined = (size_t)(w->columns + w->S);
    struct workspace *space = &w->space;

    if (!work_plan(w, whole))
        return false;
    /* R_J so far, and R22 K_c of (4) for each column */
    w->stack_rows = P + w->panel * (w->most_columns - q);
    w->basis = workspace_numbers(space, w->doubled ? 0 : L,
                                 (size_t)w->columns + (w->join ? (size_t)w->S : 0));
    w->triangle = w->join && w->L > TALL ? workspace_numbers(space, joined, joined) : NULL;
    w->tau = workspace_numbers(space, (size_t)w->columns + (size_t)w->panel, 1);
    w->R = workspace_numbers(space, (size_t)w->most_columns, (size_t)w->columns);
    w->Z = workspace_numbers(space, (size_t)w->most_columns, (size_t)w->panel);
    w->C = workspace_numbers(space, (size_t)q, (size_t)w->panel);
    w->rest = workspace_numbers(space, w->join ? 0 : w->doubled ? 1 : L, (size_t)w->panel);
    w->stack = workspace_numbers(space, (size_t)w->stack_rows, (size_t)P);
    if (turn_pays(w, w->panel))
        w->turned = workspace_numbers(space, (size_t)(w->panel + w->most_columns),
                                      (size_t)w->most_columns);
    w->reflect = workspace_numbers(space, REFLECT, (size_t)(w->columns + w->panel + P));
    return !w->space.failed;
}

/* For sums in closed form; rest is each column's weight, then what it leaves. */
static bool allocate_sums(struct work *w)
{
    size_t S = (size_t)w->S, K = (size_t)w->columns;
    struct workspace *space = &w->space;

    w->gram = gram_new(w->L, w->count, w->order, w->tied);
    w->R = workspace_numbers(space, K, K), w->Z = workspace_numbers(space, K, S);
    w->C = workspace_numbers(space, (size_t)w->order, S);
    /* of each column of Y: what is left of it, and its weight */
    w->rest = workspace_numbers(space, S, 2);
    w->cost = gram_work(w->L, w->order, w->S);
    return w->gram != NULL && !w->space.failed;
}

bool refine_allocate(struct work *w, bool whole)
{
    double **each[] = { &w->weight, &w->energy, &w->floor2, &w->lowest };
    size_t groups = (size_t)w->groups;

    w->columns = w->look ? w->order : 2 * w->order;  /* D has as many columns as Phi */
    w->most_columns = w->L < w->columns ? w->L : w->columns;
    for (size_t i = 0; i < sizeof each / sizeof *each; i++)
        *each[i] = workspace_numbers(&w->held, groups, 1);
    if (w->held.failed)
        return false;
    /* of phases refine_covariance.c reads R22 as it stands: not by pivots */
    bool plain = !w->tied || w->phases == 1;
    return whole && plain && gram_pays(w->L, w->order, w->S) ? allocate_sums(w)
                                                             : allocate_rows(w, whole);
}

/* [Phi D]; D is centred where the column has its weight, which changes it by a multiple of the
 * column only. */
void refine_fill_basis(struct work *w, const struct point *at)
{
    int L = w->L;

    for (int j = 0; j < w->count; j++) {
        double *x = w->basis + (size_t)w->column[j] * (size_t)L;
        double a = at->a[j], centre = powers_centre(a, L);
        powers_of(w->kind[j], a, at->b[j], L, x, L);
        for (int c = 0; !w->look && c < (w->kind[j] == POLE_PAIR ? 2 : 1); c++) {
            double *d = x + (size_t)(w->order + c) * (size_t)L, *p = x + (size_t)c * (size_t)L;
            for (int l = 0; l < L; l++)
                d[l] = (l - centre) * p[l];
        }
    }
}

/* Is Phi numerically of full rank? */
bool refine_regular(const struct work *w)
{
    for (int j = 0; j < w->order; j++)
        /* Phi alone: D may depend on it where rows are few */
        if (qr_dependent(w->R + j * w->most_columns, j))
            return false;
    return true;
}

/* [Phi D] = Q R. */
enum modal_status refine_factor(struct work *w, struct modal_error *err)
{
    int L = w->L, k = w->most_columns, n = w->columns + (w->join ? w->S : 0);

    for (int c = 0; w->join && c < w->S; c++)
        memcpy(w->basis + (size_t)(w->columns + c) * (size_t)L,
               w->Y->x + (size_t)c * (size_t)w->Y->ld, (size_t)L * sizeof(double));
    /* Q is not needed: the triangle alone, back at the top of the basis */
    if (w->triangle != NULL) {
        struct matrix A = { L, n, L, w->basis }, T = { n, n, n, w->triangle };
        enum modal_status rc = qr_triangle(&A, &T, err);
        if (rc != MODAL_OK)
            return rc;
        matrix_copy(n, n, T.x, n, w->basis, L);
    } else if (w->join ? !qr_in_place(L, n, w->basis, L, w->reflect)
                       : LAPACKE_dgeqrf_work(LAPACK_COL_MAJOR, L, n, w->basis, L, w->tau,
                                             w->reflect, REFLECT * n) != 0) {
        return modal_fail(err, MODAL_NO_CONVERGENCE, "refine: QR of %d x %d", L, n);
    }
    for (int j = 0; j < w->columns; j++)
        for (int i = 0; i < k; i++)
            w->R[i + j * k] = i <= j ? w->basis[i + (size_t)j * (size_t)L] : 0;
    if (!w->join
        && LAPACKE_dorgqr_work(LAPACK_COL_MAJOR, L, k, k, w->basis, L, w->tau, w->reflect,
                               REFLECT * w->columns)
            != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "refine: QR of %d x %d", L, k);
    return MODAL_OK;
}

/* The same of pole J that shares its parameters with the poles before it, or has no Im among them:
 * C, D and X are its own first ones, ROWS of them; derivatives of lines of one exponent add up. */
static void add_line(const struct work *w, int j, double weight, const double *C, const double *d1,
                     int rows, double *x)
{
    const double *d2 = d1 + w->most_columns;
    double keep = w->shares[j] ? 1 : 0, b1 = weight * C[0];
    double b2 = w->kind[j] == POLE_PAIR ? weight * C[1] : 0, turn = w->turn[j];

    for (int l = 0; l < rows && w->kind[j] != POLE_PAIR; l++)
        x[l] = (keep > 0 ? x[l] : 0) + b1 * d1[l];
    for (int l = 0; l < rows && w->kind[j] == POLE_PAIR; l++) {
        double *y = x + w->stack_rows + l;
        x[l] = (keep > 0 ? x[l] : 0) + b1 * d1[l] + b2 * d2[l];
        if (turn != 0)
            *y = (keep > 0 ? *y : 0) + turn * (b1 * d2[l] - b2 * d1[l]);
    }
}

/* The rows of (4) of channel c of a panel, at ROW of the stack. */
void refine_channel_rows(struct work *w, int c, double weight, int row)
{
    int q = w->order, k = w->most_columns, P = w->parameters + 1, ld = w->stack_rows, rows = k - q;
    const double *R22 = w->R + q + q * k, *C = w->C + c * q;

    for (int j = 0; j < w->count; j++) {
        int i = w->column[j], p = w->first[j];
        if (p < 0)
            continue;
        double *x = w->stack + row + p * ld;
        const double *d1 = R22 + i * k, *d2 = d1 + k;
        if (w->shares[j] || (w->kind[j] == POLE_PAIR && w->turn[j] == 0)) {
            add_line(w, j, weight, C + i, d1, rows, x);
            continue;
        }
        for (int l = 0; l < rows; l++) {
            if (w->kind[j] != POLE_PAIR) {
                x[l] = weight * C[i] * d1[l];  /* d/d(Re) of (3) is all that a real pole has */
            } else {
                x[l] = weight * (C[i] * d1[l] + C[i + 1] * d2[l]);                         /* (3) */
                x[l + ld] = weight * (C[i] * d2[l] - C[i + 1] * d1[l]);
            }
        }
    }
    for (int l = 0; l < rows; l++)
        /* (4)'s right side, Q2^T y_c */
        w->stack[row + l + (P - 1) * ld] = weight * w->Z[q + l + c * k];
}

/* The stack's triangle back to its top. */
enum modal_status refine_reduce_stack(struct work *w, int rows, double *T, struct modal_error *err)
{
    int P = w->parameters + 1, n = rows < P ? rows : P;

    if (!qr_in_place(rows, P, w->stack, w->stack_rows, w->reflect))
        return modal_fail(err, MODAL_NO_CONVERGENCE, "refine: QR of %d x %d", rows, P);
    memset(T, 0, (size_t)P * (size_t)P * sizeof *T);
    for (int j = 0; j < P; j++)
        for (int i = 0; i <= j && i < n; i++)
            /* row by row a panel is forgotten: R^T R adds up, and is never formed */
            T[i + j * P] = w->stack[i + j * w->stack_rows];
    return MODAL_OK;
}

void refine_triangle_to_stack(struct work *w, const double *T)
{
    int P = w->parameters + 1;

    matrix_copy(P, P, T, P, w->stack, w->stack_rows);
}

/* Projections and residuals where Y joined the QR: the triangle has Q^T Y above row k and the rest
 * in S rows below. */
static void project_joined(struct work *w, struct evaluation *e)
{
    int k = w->most_columns, q = w->order;

    for (int c = 0; c < w->S; c++) {
        const double *x = w->basis + (size_t)(w->columns + c) * (size_t)w->L;
        /* the triangle ends at row columns + c: what is left of y_c lies above that */
        double r = cblas_dnrm2(k + c + 1 - q, x + q, 1);
        memcpy(w->Z + c * k, x, (size_t)k * sizeof *x);
        e->rss[c / w->phases] += r * r;
        /* |Q2^T y|^2, all that a step of (4) can take away */
        e->near[c / w->phases] += cblas_ddot(k - q, x + q, 1, x + q, 1);
    }
}

/* The same of channels c0 .. c0+n-1 where the QR was made by doubling. */
static enum modal_status project_doubled(struct work *w, int c0, int n, struct evaluation *e,
                                         struct modal_error *err)
{
    int q = w->order, k = w->most_columns;
    enum modal_status rc = doubling_project(w->doubling, w->Y, c0, n, w->Z, w->rest, err);

    for (int c = 0; c < n; c++) {
        double near = cblas_ddot(k - q, w->Z + c * k + q, 1, w->Z + c * k + q, 1);
        /* |P y|^2 = |Q2^T y|^2 and what neither Phi nor D holds */
        e->rss[(c0 + c) / w->phases] += near + w->rest[c];
        e->near[(c0 + c) / w->phases] += near;
    }
    return rc;
}

/* The same from Q for channels c0 .. c0+n-1. */
static void project_panel(struct work *w, int c0, int n, struct evaluation *e)
{
    int L = w->L, q = w->order, k = w->most_columns;
    const double *Y = w->Y->x + (size_t)c0 * (size_t)w->Y->ld;

    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, k, n, L, 1, w->basis, L, Y, w->Y->ld, 0,
                w->Z, k);
    for (int c = 0; c < n; c++)
        /* residuals from the rows: |y|^2 - |Q1^T y|^2 would have half of the digits */
        memcpy(w->rest + (size_t)c * (size_t)L, Y + (size_t)c * (size_t)w->Y->ld,
               (size_t)L * sizeof *Y);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, L, n, q, -1, w->basis, L, w->Z, k, 1,
                w->rest, L);
    for (int c = 0; c < n; c++) {
        double r = cblas_dnrm2(L, w->rest + (size_t)c * (size_t)L, 1);
        e->rss[(c0 + c) / w->phases] += r * r;
        e->near[(c0 + c) / w->phases] +=
            cblas_ddot(k - q, w->Z + c * k + q, 1, w->Z + c * k + q, 1);
    }
}

/* (4) sums over columns, and their turn by an orthogonal matrix is no matter: of N in a panel, more
 * than Z has rows, as many as rows. */
static enum modal_status turn_panel(struct work *w, int c0, int *n, bool *turned,
                                    struct modal_error *err)
{
    int k = w->most_columns;
    struct matrix A = { *n, k, *n, w->turned }, T = { k, k, k, NULL };
    enum modal_status rc;

    *turned = turn_pays(w, *n);
    if (!*turned)
        return MODAL_OK;
    T.x = A.x + (size_t)*n * (size_t)k;
    for (int c = 0; c < *n; c++)
        for (int l = 0; l < k; l++)
            A.x[c + (size_t)l * (size_t)*n] = w->weight[(c0 + c) / w->phases] * w->Z[l + c * k];
    rc = qr_triangle(&A, &T, err);
    for (int c = 0; c < k && rc == MODAL_OK; c++)
        for (int l = 0; l < k; l++)
            w->Z[l + c * k] = T.x[c + (size_t)l * (size_t)k];
    *n = k;
    return rc;
}

/* One panel: its projections, its residuals, its rows of (4). */
static enum modal_status panel_pass(struct work *w, int c0, int n, struct evaluation *e,
                                    struct modal_error *err)
{
    int q = w->order, k = w->most_columns, P = w->parameters + 1;
    bool turned = false;
    enum modal_status rc = MODAL_OK;

    if (w->doubled)
        rc = project_doubled(w, c0, n, e, err);
    else if (w->join)
        project_joined(w, e);
    else
        project_panel(w, c0, n, e);
    for (int c = 0; c < n && rc == MODAL_OK && w->all != NULL; c++)
        memcpy(w->all + (size_t)(c0 + c) * (size_t)q, w->Z + c * k, (size_t)q * sizeof *w->all);
    if (rc != MODAL_OK || w->parameters == 0 || k == q)
        return rc;
    if ((rc = turn_panel(w, c0, &n, &turned, err)) != MODAL_OK)
        return rc;
    matrix_copy(q, n, w->Z, k, w->C, q);
    /* C = R11^{-1} Q1^T Y */
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, q, n, 1, w->R, k,
                w->C, q);
    for (int c = 0; c < n; c++)
        refine_channel_rows(w, c, turned ? 1 : w->weight[(c0 + c) / w->phases], P + c * (k - q));
    refine_triangle_to_stack(w, e->T);
    return refine_reduce_stack(w, P + n * (k - q), e->T, err);
}

static void weigh(const struct work *w, struct evaluation *e)
{
    e->F = 0;
    for (int g = 0; g < w->groups; g++)
        e->F += w->weight[g] * w->weight[g] * e->rss[g];  /* (1) */
}

/* One evaluation by sums; false where they do not tell enough. */
static bool evaluate_sums(struct work *w, const struct doubling_poles *poles,
                          struct evaluation *e)
{
    int q = w->order, K = w->columns, S = w->S;
    double *rest = w->rest, *weight = w->rest + S;
    const struct gram_parameters p = { w->parameters, w->first, w->turn };

    /* known to the square of the condition only: where that is too little, rows decide */
    if (!gram_factor(w->gram, poles, w->look, w->R)
        || !gram_project(w->gram, w->Y, w->R, w->C, w->Z, rest))
        return false;
    for (int c = 0; c < S; c++) {
        const double *z = w->Z + (size_t)c * (size_t)K;
        weight[c] = w->weight[c / w->phases];
        e->rss[c / w->phases] += rest[c];
        e->near[c / w->phases] += cblas_ddot(K - q, z + q, 1, z + q, 1);
        if (w->all != NULL)
            memcpy(w->all + (size_t)c * (size_t)q, z, (size_t)q * sizeof *w->all);
    }
    weigh(w, e);
    e->degenerate = !isfinite(e->F);
    return w->look || w->parameters == 0
        || gram_triangle(w->gram, w->R, w->C, w->Z, S, weight, &p, e->T);
}

/* The blocks tell of POLES, at the cost of an evaluation of all rows where they did not. */
static enum modal_status hold(struct work *w, const struct doubling_poles *poles,
                              struct modal_error *err)
{
    if (w->blocks != NULL && !compressed_holds(w->blocks, poles)) {
        enum modal_status rc = compressed_about(w->blocks, poles, err);
        if (rc != MODAL_OK)
            return rc;
        /* counted by sizes, so that work ends alike on every machine */
        w->spent += (double)w->L * w->S * w->columns;
        doubling_free(w->doubling), w->doubling = NULL;
    }
    return !w->doubled || w->doubling != NULL || begin_doubling(w)
               ? MODAL_OK
               : modal_fail(err, MODAL_NO_MEMORY, "refine: no memory for %d x %d, order %d", w->L,
                            w->S, w->order);
}

enum modal_status refine_evaluate(struct work *w, const struct point *at, struct evaluation *e,
                                  struct modal_error *err)
{
    const struct doubling_poles poles = { w->count, w->order, w->kind, w->column, at->a, at->b };
    enum modal_status rc;

    e->F = HUGE_VAL, e->degenerate = true;
    w->spent += w->cost;
    memset(e->rss, 0, (size_t)w->groups * sizeof *e->rss);
    memset(e->near, 0, (size_t)w->groups * sizeof *e->near);
    if (w->gram != NULL) {
        if (evaluate_sums(w, &poles, e))
            return MODAL_OK;
        work_release(w);                    /* from here on by rows */
        if (!allocate_rows(w, true))
            return modal_fail(err, MODAL_NO_MEMORY, "refine: no memory for %d x %d, order %d",
                              w->L, w->S, w->order);
        w->spent += w->cost;
    }
    e->F = HUGE_VAL, e->degenerate = true;
    memset(e->rss, 0, (size_t)w->groups * sizeof *e->rss);
    memset(e->near, 0, (size_t)w->groups * sizeof *e->near);
    memset(e->T, 0, (size_t)(w->parameters + 1) * (size_t)(w->parameters + 1) * sizeof *e->T);
    if ((rc = hold(w, &poles, err)) != MODAL_OK)
        return rc;
    if (!w->doubled)
        refine_fill_basis(w, at);
    rc = w->doubled ? doubling_factor(w->doubling, &poles, w->R, err) : refine_factor(w, err);
    if (rc != MODAL_OK || !refine_regular(w))
        return rc;
    for (int c = 0; c < w->S && rc == MODAL_OK; c += w->panel)
        rc = panel_pass(w, c, w->S - c < w->panel ? w->S - c : w->panel, e, err);
    weigh(w, e);
    e->degenerate = !isfinite(e->F);
    return rc;
}

enum modal_status refine_hold(const struct work *w, const struct point *at,
                              struct modal_error *err)
{
    const struct doubling_poles poles = { w->count, w->order, w->kind, w->column, at->a, at->b };

    return compressed_holds(w->data->blocks, &poles)
               ? MODAL_OK
               : compressed_about(w->data->blocks, &poles, err);
}
