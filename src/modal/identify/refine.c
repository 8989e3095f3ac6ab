/* refine.c - variable projection on the exponents
 *
 * With the basis Phi(lambda), L x q, of synthesis.h (for a pair the columns Re z^l and -Im z^l, for
 * a real multiplier z^l; z = e^{lambda tau}) and weights w_c = 1 / sigma_c the data are fitted by
 *
 *     min over lambda, C of  F = sum_c w_c^2 |y_c - Phi c_c|^2.                                 (1)
 *
 * C is linear: C = R11^{-1} Q1^T Y from Phi = Q1 R11 [GP73].  What is left is P y_c, P = I - Q1
 * Q1^T, and its derivative in a parameter alpha is, after Kaufman [K75] (the term dropped is of the
 * size of the residual),
 *
 *     d(P y_c) = -P (dPhi / dalpha) c_c.                                                        (2)
 *
 * Every derivative of Phi lies in the columns D = diag(l) Phi:  for c = b_r, b_i of a pair,
 *
 *     d/d(Re): b_r D_1 + b_i D_2,      d/d(Im): -b_i D_1 + b_r D_2,                             (3)
 *
 * so one QR of [Phi D] gives all:  P D = Q2 R22, and the least-squares problem for the step delta
 *
 *     min sum_c w_c^2 |Q2^T y_c - R22 K_c delta|^2,   K_c from (3),                             (4)
 *
 * has q rows a channel instead of L.  With few channels Y joins the QR, [Phi D Y]: Q^T Y is then
 * part of the triangle and the residuals are norms of what lies below it; with many, Q is formed
 * and Y read once, panel by panel; of a long record neither is made (doubling.h).  It is reduced to
 * a triangle R_J panel by panel (never J^T J), and damped after Levenberg and Marquardt with
 * Nielsen's rule for the damping [N99].  Since sum of squares of Q2 Q2^T is what (4) sees, with s^2
 * = F / (degrees of freedom),
 *
 *     covariance = s^2 (R_J^T R_J)^{-1}                                                         (5)
 *
 * is the Cramer-Rao bound of white Gaussian noise at the residual's own level, amplitudes and
 * phases unknown; a step is small against the standard errors of every combination of parameters at
 * once when |R_J delta| <= 1e-3 s.
 *
 * The sigma_c are unknown too: each signal's comes from its own residual, and (1) is solved again
 * until they settle, which is maximum likelihood and costs nothing against knowing them (the
 * information matrix is block diagonal).  Where a signal leaves too few degrees of freedom for
 * that, all share one.  Signals that carry less noise then weigh more.
 *
 * Rounding.  A phase theta l is known to theta l DBL_EPSILON / 2, so the residual of perfect data
 * is not DBL_EPSILON but about
 *
 *     floor = (4 + theta L / 4) DBL_EPSILON rms(y)                                              (6)
 *
 * (in a late part of a record, L plus twice the rows before it).
 *
 * Below it nothing is signal, nor below the grid that the samples were rounded to (`least`). The
 * larger one bounds sigma_c in the weights and the residuals in the criterion (criterion.c),
 * which compares one fit with another.
 *
 * Growth: columns are divided by their largest entry, and |Re lambda| tau L stays below
 * GROWTH_MOST, so nothing overflows.
 *
 * [GP73] Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432.  [K75] Kaufman, BIT 15 (1975)
 * 49-57.
 * [N99]  Nielsen, IMM-REP-1999-05, Technical University of Denmark.
 */
#include "modal/identify/refine.h"
#include "modal/identify/criterion.h"
#include "modal/identify/doubling.h"
#include "modal/identify/exponents.h"
#include "modal/identify/gram.h"
#include "modal/identify/powers.h"
#include "modal/identify/wide.h"
#include "modal/linalg/qr.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ln of the largest growth or decay over the record: e^700 is finite */
static const double GROWTH_MOST = 700;
/* ln of the fastest decay in one step: below it a column is its first entry */
static const double DECAY_MOST = 36;
static const double SETTLED = 1e-10;  /* standard errors between a settled answer and the minimum */
enum { ITERATIONS = 60, FAILURES_MOST = 12, ROUNDING_FAILURES = 3, SETTLE_STEPS = 16 };
enum { PANEL_ENTRIES = 1 << 16, FREEDOM_LEAST = 30, ROUNDS = 30, REFLECT = 64, JOIN_MOST = 16,
       TALL = 4096 };

/* Poles as the iteration moves them: per step, so that a = Re lambda tau, b = Im lambda tau. */
struct point { double *a, *b; };

struct work {
    const struct refine_data *data;
    const struct matrix *Y;
    int L, S, phases, groups;
    int count, order, parameters;
    const bool *fixed;
    enum pole_kind *kind;
    int *column, *first;      /* of each pole: its first column in Phi, its first parameter or -1 */
    bool look;                   /* no derivatives: Phi alone */
    int columns;                 /* of [Phi D], or of Phi */
    double cost, spent;          /* multiplications of one evaluation; of all so far */
    int most_columns;            /* min(L, columns): columns of Q */
    bool join;                   /* Y joins the QR */
    bool doubled;                /* long records: instead of a QR of all rows */
    struct doubling *doubling;   /* for that; NULL where blocks tell of no poles yet */
    struct compressed *blocks;   /* borrowed: what doubling reads instead of Y; or NULL */
    struct gram *gram;           /* many poles: instead of any QR; else NULL */
    int panel;                   /* columns of Y at a time */
    double *basis;               /* L x columns: [Phi D], then Q; L x (columns + S) where Y joins */
    double *triangle;            /* (columns + S)^2, for many rows; else NULL: the QR is in place */
    double *tau;                 /* Householder */
    double *R;                   /* most_columns x 2 order */
    double *Z;                   /* most_columns x panel: Q^T Y */
    /* borrowed, order x S: Q^T Y of all panels, where they are asked for (`look`); else NULL */
    double *all;
    double *C;                   /* order x panel */
    double *rest;                /* L x panel: P Y */
    double *stack;               /* rows of (4) of one panel below the triangle so far */
    int stack_rows;
    double *reflect;             /* workspace of LAPACK's QR, REFLECT blocks of columns */
    double *weight;              /* per group */
    double *energy;              /* per group: sum of squares of Y */
    double *floor2;              /* per group: (6)^2 */
    double *lowest;              /* per group: variance below which nothing is signal */
};

/* What one evaluation of (1) gives. */
struct evaluation {
    double F;                    /* weighted sum of squares */
    double *rss;                 /* per group, unweighted */
    double *near;                /* per group: of rss, what lies in the span of the derivatives */
    double *T;                   /* (parameters + 1)^2: triangle [R_J, g; 0, *] */
    bool degenerate;
};

/* What evaluations need. */
static void work_release(struct work *w)
{
    doubling_free(w->doubling), gram_free(w->gram);
    w->doubling = NULL, w->gram = NULL;
    free(w->basis), free(w->triangle), free(w->tau), free(w->R), free(w->Z), free(w->C);
    free(w->rest), free(w->stack), free(w->reflect);
    w->basis = w->triangle = w->tau = w->R = w->Z = w->C = NULL;
    w->rest = w->stack = w->reflect = NULL;
}

static void work_done(struct work *w)
{
    free(w->kind), free(w->column), free(w->first);
    work_release(w);
    free(w->weight), free(w->energy), free(w->floor2), free(w->lowest);
}

static double *numbers(size_t m, size_t n)
{
    return calloc(m * n > 0 ? m * n : 1, sizeof(double));
}

/* Columns and parameters of each pole; false: no memory. */
static bool work_layout(struct work *w, const double complex *lambda)
{
    w->kind = malloc((size_t)w->count * sizeof *w->kind);
    w->column = malloc((size_t)w->count * sizeof *w->column);
    w->first = malloc((size_t)w->count * sizeof *w->first);
    if (w->kind == NULL || w->column == NULL || w->first == NULL)
        return false;
    for (int j = 0; j < w->count; j++) {
        w->kind[j] = pole_kind(lambda[j], w->data->tau);
        int n = w->kind[j] == POLE_PAIR ? 2 : 1;
        w->column[j] = w->order;
        w->order += n;
        w->first[j] = w->fixed != NULL && w->fixed[j] ? -1 : w->parameters;
        w->parameters += w->first[j] < 0 ? 0 : n;
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
    w->panel = w->panel < 4 ? 4 : w->panel;
    w->panel = w->panel > S ? S : w->panel;
    w->doubled = whole && doubling_pays(w->L, n, S);
    if (w->doubled) {
        w->blocks = w->data->blocks;
        return w->blocks != NULL || begin_doubling(w);
    }
    w->join = S <= JOIN_MOST && n + S <= w->L;
    w->panel = w->join ? S : w->panel;
    w->cost = w->join ? L * (n + S) * (n + S) : L * n * n + L * S * (w->most_columns + w->order);
    return true;
}

/* For a QR of all rows, or by doubling. */
static bool allocate_rows(struct work *w, bool whole)
{
    int q = w->order, P = w->parameters + 1;
    size_t L = (size_t)w->L;

    if (!work_plan(w, whole))
        return false;
    w->stack_rows = P + w->panel * (w->most_columns - q);
    w->basis =
        numbers(w->doubled ? 0 : L, (size_t)w->columns + (w->join ? (size_t)w->S : 0));
    if (w->join && w->L > TALL) {
        w->triangle = numbers((size_t)(w->columns + w->S), (size_t)(w->columns + w->S));
        if (w->triangle == NULL)
            return false;
    }
    w->tau = numbers((size_t)w->columns + (size_t)w->panel, 1);
    w->R = numbers((size_t)w->most_columns, (size_t)w->columns);
    w->Z = numbers((size_t)w->most_columns, (size_t)w->panel),
    w->C = numbers((size_t)q, (size_t)w->panel);
    w->rest = numbers(w->join ? 0 : w->doubled ? 1 : L, (size_t)w->panel);
    w->stack = numbers((size_t)w->stack_rows, (size_t)P);
    w->reflect = numbers(REFLECT, (size_t)(w->columns + w->panel + P));
    return w->basis != NULL && w->tau != NULL && w->R != NULL && w->Z != NULL && w->C != NULL
        && w->rest != NULL && w->stack != NULL && w->reflect != NULL;
}

/* For sums in closed form; rest is each column's weight, then what it leaves. */
static bool allocate_sums(struct work *w)
{
    size_t S = (size_t)w->S, K = (size_t)w->columns;

    w->gram = gram_new(w->L, w->count, w->order);
    w->R = numbers(K, K), w->Z = numbers(K, S), w->C = numbers((size_t)w->order, S);
    w->rest = numbers(S, 2);
    w->cost = gram_work(w->L, w->order, w->S);
    return w->gram != NULL && w->R != NULL && w->Z != NULL && w->C != NULL && w->rest != NULL;
}

static bool work_allocate(struct work *w, bool whole)
{
    size_t groups = (size_t)w->groups;

    w->columns = w->look ? w->order : 2 * w->order;
    w->most_columns = w->L < w->columns ? w->L : w->columns;
    w->weight = numbers(groups, 1), w->energy = numbers(groups, 1);
    w->floor2 = numbers(groups, 1), w->lowest = numbers(groups, 1);
    if (w->weight == NULL || w->energy == NULL || w->floor2 == NULL || w->lowest == NULL)
        return false;
    return whole && gram_pays(w->L, w->order, w->S) ? allocate_sums(w) : allocate_rows(w, whole);
}

/* [Phi D]; D is centred where the column has its weight, which changes it by a multiple of the
 * column only. */
static void fill_basis(struct work *w, const struct point *at)
{
    int L = w->L;

    for (int j = 0; j < w->count; j++) {
        double *x = w->basis + (size_t)w->column[j] * (size_t)L;
        double a = at->a[j];
        double centre = a == 0 ? 0.5 * (L - 1)
            : a > 0            ? L - 1 - fmin(0.5 * L, 1 / a)
                               : fmin(0.5 * L, -1 / a);
        powers_of(w->kind[j], a, at->b[j], L, x, L);
        for (int c = 0; !w->look && c < (w->kind[j] == POLE_PAIR ? 2 : 1); c++) {
            double *d = x + (size_t)(w->order + c) * (size_t)L, *p = x + (size_t)c * (size_t)L;
            for (int l = 0; l < L; l++)
                d[l] = (l - centre) * p[l];
        }
    }
}

/* Is Phi numerically of full rank? */
static bool regular(const struct work *w)
{
    int k = w->most_columns;

    for (int j = 0; j < w->order; j++)
        if (!(fabs(w->R[j + j * k]) > 32 * DBL_EPSILON * cblas_dnrm2(j + 1, w->R + j * k, 1)))
            return false;
    return true;
}

/* [Phi D] = Q R. */
static enum modal_status factor(struct work *w, struct modal_error *err)
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
        for (int j = 0; j < n; j++)
            memcpy(w->basis + (size_t)j * (size_t)L, T.x + (size_t)j * (size_t)n,
                   (size_t)n * sizeof(double));
    } else if (LAPACKE_dgeqrf_work(LAPACK_COL_MAJOR, L, n, w->basis, L, w->tau, w->reflect,
                                   REFLECT * n)
               != 0) {
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

/* The rows of (4) of channel c of a panel, at ROW of the stack. */
static void channel_rows(struct work *w, int c, double weight, int row)
{
    int q = w->order, k = w->most_columns, P = w->parameters + 1, ld = w->stack_rows, rows = k - q;
    const double *R22 = w->R + q + q * k, *C = w->C + c * q;

    for (int j = 0; j < w->count; j++) {
        int i = w->column[j], p = w->first[j];
        if (p < 0)
            continue;
        double *x = w->stack + row + p * ld;
        const double *d1 = R22 + i * k, *d2 = d1 + k;
        for (int l = 0; l < rows; l++) {
            if (w->kind[j] != POLE_PAIR) {
                x[l] = weight * C[i] * d1[l];
            } else {
                x[l] = weight * (C[i] * d1[l] + C[i + 1] * d2[l]);                         /* (3) */
                x[l + ld] = weight * (C[i] * d2[l] - C[i + 1] * d1[l]);
            }
        }
    }
    for (int l = 0; l < rows; l++)
        w->stack[row + l + (P - 1) * ld] = weight * w->Z[q + l + c * k];
}

/* The stack's triangle back to its top. */
static enum modal_status reduce_stack(struct work *w, int rows, double *T, struct modal_error *err)
{
    int P = w->parameters + 1, n = rows < P ? rows : P;
    double tau[REFINE_ORDER_MOST + 1];

    if (P > REFINE_ORDER_MOST + 1)
        return modal_fail(err, MODAL_BAD_INPUT, "refine: %d parameters; accepted: %d", P - 1,
                          REFINE_ORDER_MOST);
    if (LAPACKE_dgeqrf_work(LAPACK_COL_MAJOR, rows, P, w->stack, w->stack_rows, tau, w->reflect,
                            REFLECT * P)
        != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "refine: QR of %d x %d", rows, P);
    memset(T, 0, (size_t)P * (size_t)P * sizeof *T);
    for (int j = 0; j < P; j++)
        for (int i = 0; i <= j && i < n; i++)
            T[i + j * P] = w->stack[i + j * w->stack_rows];
    return MODAL_OK;
}

static void triangle_to_stack(struct work *w, const double *T)
{
    int P = w->parameters + 1;

    for (int j = 0; j < P; j++)
        memcpy(w->stack + j * w->stack_rows, T + j * P, (size_t)P * sizeof *T);
}

/* Projections and residuals where Y joined the QR: the triangle has Q^T Y above row k and the rest
 * in S rows below. */
static void project_joined(struct work *w, struct evaluation *e)
{
    int k = w->most_columns, q = w->order;

    for (int c = 0; c < w->S; c++) {
        const double *x = w->basis + (size_t)(w->columns + c) * (size_t)w->L;
        double r = cblas_dnrm2(k + c + 1 - q, x + q, 1);
        memcpy(w->Z + c * k, x, (size_t)k * sizeof *x);
        e->rss[c / w->phases] += r * r;
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

/* One panel: its projections, its residuals, its rows of (4). */
static enum modal_status panel_pass(struct work *w, int c0, int n, struct evaluation *e,
                                    struct modal_error *err)
{
    int q = w->order, k = w->most_columns, P = w->parameters + 1;
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
    for (int c = 0; c < n; c++)
        memcpy(w->C + c * q, w->Z + c * k, (size_t)q * sizeof *w->C);
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, q, n, 1, w->R, k,
                w->C, q);
    for (int c = 0; c < n; c++)
        channel_rows(w, c, w->weight[(c0 + c) / w->phases], P + c * (k - q));
    triangle_to_stack(w, e->T);
    return reduce_stack(w, P + n * (k - q), e->T, err);
}

static void weigh(const struct work *w, struct evaluation *e)
{
    e->F = 0;
    for (int g = 0; g < w->groups; g++)
        e->F += w->weight[g] * w->weight[g] * e->rss[g];
}

/* One evaluation by sums; false where they do not tell enough. */
static bool evaluate_sums(struct work *w, const struct doubling_poles *poles,
                          struct evaluation *e)
{
    int q = w->order, K = w->columns, S = w->S;
    double *rest = w->rest, *weight = w->rest + S;

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
        || gram_triangle(w->gram, w->R, w->C, w->Z, S, weight, w->first, w->parameters, e->T);
}

/* The blocks tell of POLES, at the cost of an evaluation of all rows where they did not. */
static enum modal_status hold(struct work *w, const struct doubling_poles *poles,
                              struct modal_error *err)
{
    if (w->blocks != NULL && !compressed_holds(w->blocks, poles)) {
        enum modal_status rc = compressed_about(w->blocks, poles, err);
        if (rc != MODAL_OK)
            return rc;
        w->spent += (double)w->L * w->S * w->columns;
        doubling_free(w->doubling), w->doubling = NULL;
    }
    return !w->doubled || w->doubling != NULL || begin_doubling(w)
               ? MODAL_OK
               : modal_fail(err, MODAL_NO_MEMORY, "refine: no memory for %d x %d, order %d", w->L,
                            w->S, w->order);
}

static enum modal_status evaluate(struct work *w, const struct point *at, struct evaluation *e,
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
        fill_basis(w, at);
    rc = w->doubled ? doubling_factor(w->doubling, &poles, w->R, err) : factor(w, err);
    if (rc != MODAL_OK || !regular(w))
        return rc;
    for (int c = 0; c < w->S && rc == MODAL_OK; c += w->panel)
        rc = panel_pass(w, c, w->S - c < w->panel ? w->S - c : w->panel, e, err);
    weigh(w, e);
    e->degenerate = !isfinite(e->F);
    return rc;
}

/* Rows that are independent: all, unless a filter left the noise only a share of them. */
static double rows(const struct work *w)
{
    return w->L * (w->data->share > 0 ? w->data->share : 1);
}

static struct criterion criterion_for(const struct work *w)
{
    double n = (double)w->L * w->phases;

    return (struct criterion) { w->groups, w->phases, n, rows(w) * w->phases, w->energy,
                                w->lowest };
}

static double freedom(const struct work *w)
{
    return w->S * (rows(w) - w->order) - w->parameters;
}

static bool at_rounding(const struct work *w, const struct evaluation *e, int g)
{
    return e->rss[g] <= (double)w->L * w->phases * w->floor2[g];
}

static bool is_rounding(const struct work *w, const struct evaluation *e)
{
    for (int g = 0; g < w->groups; g++)
        if (!at_rounding(w, e, g))
            return false;
    return true;
}

/* What signals at rounding have in F: the part of it that no step can lower, nor tell. */
static double rounding_part(const struct work *w, const struct evaluation *e)
{
    double sum = 0;

    for (int g = 0; g < w->groups; g++)
        sum += at_rounding(w, e, g) ? w->weight[g] * w->weight[g] * e->rss[g] : 0;
    return sum;
}

/* s^2 of (5).  Signals at rounding are weighed by a bound of it: beside noise they say nothing of
 * the noise. */
static double variance(const struct work *w, const struct evaluation *e)
{
    int noisy = 0;

    for (int g = 0; g < w->groups; g++)
        noisy += !at_rounding(w, e, g);
    if (noisy == 0 || noisy == w->groups)
        return e->F / fmax(freedom(w), 1);
    return (e->F - rounding_part(w, e)) / fmax(freedom(w) * noisy / w->groups, 1);
}

/* Weights from residuals; an all-zero signal has none.  Returns the largest relative change. */
static double set_weights(struct work *w, const double *rss, bool equal)
{
    double n = (double)w->L * w->phases, own = freedom(w) / w->groups, change = 0, pooled = 0,
           share = 0;

    for (int g = 0; g < w->groups; g++) {
        pooled += fmax(rss[g], n * w->lowest[g]);
        share += w->energy[g] > 0;
    }
    for (int g = 0; g < w->groups; g++) {
        double alone = fmax(rss[g], n * w->lowest[g]);
        double rest = equal || own < FREEDOM_LEAST ? pooled / fmax(share, 1) : alone;
        double weight = w->energy[g] > 0 ? 1 / sqrt(fmax(rest / fmax(own, 1), DBL_MIN)) : 0;
        if (w->energy[g] > 0)
            change = fmax(change, w->weight[g] > 0 ? fabs(weight / w->weight[g] - 1) : 1);
        w->weight[g] = weight;
    }
    return change;
}

/* The damped step: min |[R_J; sqrt(mu) diag] delta - [g; 0]|. False where it has no solution. */
static bool damped_step(int n, const double *T, double mu, double *A, double *delta)
{
    int ld = 2 * n, P = n + 1;

    memset(A, 0, (size_t)ld * (size_t)n * sizeof *A);
    memset(delta, 0, (size_t)ld * sizeof *delta);
    for (int j = 0; j < n; j++) {
        memcpy(A + j * ld, T + j * P, (size_t)(j + 1) * sizeof *A);
        double norm = cblas_dnrm2(j + 1, T + j * P, 1);
        A[n + j + j * ld] = sqrt(mu) * (norm > 0 ? norm : 1);
    }
    memcpy(delta, T + n * P, (size_t)n * sizeof *delta);
    if (LAPACKE_dgels(LAPACK_COL_MAJOR, 'N', ld, n, 1, A, ld, delta, ld) != 0)
        return false;
    for (int i = 0; i < n; i++)
        if (!isfinite(delta[i]))
            return false;
    return true;
}

/* |g|^2 - |g - R_J delta|^2: what (4) promises. */
static double promised(int n, const double *T, const double *delta)
{
    double sum = 0;

    for (int i = 0; i < n; i++) {
        double x = 0, g = T[i + n * (n + 1)];
        for (int j = i; j < n; j++)
            x += T[i + j * (n + 1)] * delta[j];
        sum += x * (2 * g - x);
    }
    return sum;
}

static double guard(const struct work *w, double a)
{
    return fmin(fmax(a, -fmin(DECAY_MOST, GROWTH_MOST)), GROWTH_MOST / w->L);
}

static bool at_guard(const struct work *w, const struct point *at)
{
    for (int j = 0; j < w->count; j++)
        if (w->first[j] >= 0 && (at->a[j] <= -DECAY_MOST || at->a[j] >= GROWTH_MOST / w->L))
            return true;
    return false;
}

/* No step turns a phase over the record by more than a few radians: another line is another
 * minimum. */
static void take_step(const struct work *w, const struct point *from, const double *delta,
                      struct point *to)
{
    double most = 0, scale;

    for (int i = 0; i < w->parameters; i++)
        most = fmax(most, fabs(delta[i]) * w->L);
    scale = most > 6 ? 6 / most : 1;
    for (int j = 0; j < w->count; j++) {
        int p = w->first[j];
        to->a[j] = from->a[j], to->b[j] = from->b[j];
        if (p < 0)
            continue;
        to->a[j] = guard(w, from->a[j] + scale * delta[p]);
        if (w->kind[j] == POLE_PAIR) {
            double b = fabs(from->b[j] + scale * delta[p + 1]);   /* conjugates are the same pair */
            to->b[j] = fmin(b > M_PI ? fabs(2 * M_PI - b) : b, nextafter(M_PI, 0));
            to->b[j] = fmax(to->b[j], 1e-12);
        }
    }
}

struct search {
    struct point at, trial;
    struct evaluation now, next;
    double *A, *delta;            /* of damped_step */
    int iterations, evaluations;
};

static bool point_new(struct point *p, int count)
{
    p->a = numbers((size_t)count, 1), p->b = numbers((size_t)count, 1);
    return p->a != NULL && p->b != NULL;
}

static bool evaluation_new(struct evaluation *e, const struct work *w)
{
    e->rss = numbers((size_t)w->groups, 1), e->near = numbers((size_t)w->groups, 1);
    e->T = numbers((size_t)w->parameters + 1, (size_t)w->parameters + 1);
    return e->rss != NULL && e->near != NULL && e->T != NULL;
}

static bool search_new(struct search *s, const struct work *w)
{
    size_t n = (size_t)w->parameters;

    s->A = numbers(2 * n, n), s->delta = numbers(2 * n, 1);
    return point_new(&s->at, w->count) && point_new(&s->trial, w->count)
        && evaluation_new(&s->now, w) && evaluation_new(&s->next, w) && s->A != NULL
        && s->delta != NULL;
}

static void search_done(struct search *s)
{
    free(s->at.a), free(s->at.b), free(s->trial.a), free(s->trial.b);
    free(s->now.rss), free(s->now.near), free(s->now.T), free(s->next.rss), free(s->next.near),
        free(s->next.T), free(s->A), free(s->delta);
}

static void swap_in(struct search *s)
{
    struct point p = s->at;
    struct evaluation e = s->now;

    s->at = s->trial, s->trial = p;
    s->now = s->next, s->next = e;
}

/* The criterion, every residual times FACTOR. */
static double worth(const struct work *w, const double *rss, double factor)
{
    struct criterion c = criterion_for(w);

    return criterion_of(&c, rss, factor, w->order, w->parameters);
}

/* Is a signal left with little but the poles' errors?  Its residual may fall by any factor, and its
 * weight rise with it. */
static bool collapses(const struct work *w, const struct evaluation *e)
{
    for (int g = 0; g < w->groups; g++)
        if (e->near[g] > 0.5 * e->rss[g] && !at_rounding(w, e, g))
            return true;
    return false;
}

/*
 * The linear model (4) promises to lower F by |g|^2.  Where twice as much would leave the BIC above
 * the rival's, the rival has won.
 */
static bool hopeless(const struct work *w, const struct search *s, double rival)
{
    int n = w->parameters;
    double g = cblas_dnrm2(n, s->now.T + n * (n + 1), 1), left = 1 - 2 * g * g / s->now.F;

    return rival != 0 && left > 0 && !collapses(w, &s->now) && worth(w, s->now.rss, left) > rival;
}

/* Levenberg-Marquardt's damping after Nielsen, and how often in a row it failed. */
struct damping { double mu, grow; int failures; };

static void damp_more(struct damping *d)
{
    d->mu = fmax(d->mu, 1e-12) * d->grow, d->grow *= 2, d->failures++;
}

/* GAIN: what F fell by over what was promised. */
static void damp_less(struct damping *d, double gain)
{
    d->mu *= fmax(1.0 / 9, 1 - pow(2 * fmin(gain, 1) - 1, 3)), d->grow = 2, d->failures = 0;
}

/* |g|^2, what (4) could lower F by, is no more than F is known to: no step can be told from
 * another.  With the fit known to (6), e a number, and orthogonal to what it leaves, r, the square
 * of r is known to 2 |r| e + n e^2. */
static bool below_rounding(const struct work *w, const struct evaluation *e)
{
    int n = w->parameters;
    double g = cblas_dnrm2(n, e->T + n * (n + 1), 1), known = rounding_part(w, e);

    for (int i = 0; i < w->groups; i++)
        known += w->weight[i] * w->weight[i]
            * (2 * sqrt(e->rss[i] * w->floor2[i]) + (double)w->L * w->phases * w->floor2[i]);
    return g * g <= known;
}

static enum refine_end at_rounding_end(const struct work *w, const struct evaluation *e)
{
    return is_rounding(w, e) ? REFINE_ROUNDING : REFINE_CONVERGED;
}

/* Is there a reason not to take another step? */
static bool ended(const struct work *w, const struct search *s, const struct refine_options *opt,
                  const struct damping *d, enum refine_end *end)
{
    int n = w->parameters;
    double step = opt->step > 0 ? opt->step : 1e-3;

    if (cblas_dnrm2(n, s->now.T + n * (n + 1), 1) <= step * sqrt(variance(w, &s->now)))
        *end = REFINE_CONVERGED;
    else if (d->failures >= ROUNDING_FAILURES && below_rounding(w, &s->now))
        *end = at_rounding_end(w, &s->now);
    else if (d->failures > FAILURES_MOST)
        *end = REFINE_STALLED;
    else if (hopeless(w, s, opt->rival))
        *end = REFINE_HOPELESS;
    else if (opt->work > 0 && w->spent + w->cost > opt->work)
        *end = REFINE_STOPPED;
    else
        return false;
    return true;
}

/* The damped step tried, and taken where F falls.  *still: F fell by nothing that counts, and is
 * rounding. */
static enum modal_status try_step(struct work *w, struct search *s, struct damping *d, bool *still,
                                  struct modal_error *err)
{
    int n = w->parameters;
    double fall, promise;
    enum modal_status rc;

    s->iterations++, s->evaluations++;
    if (!damped_step(n, s->now.T, d->mu, s->A, s->delta)) {
        damp_more(d);
        return MODAL_OK;
    }
    take_step(w, &s->at, s->delta, &s->trial);
    rc = evaluate(w, &s->trial, &s->next, err);
    if (rc != MODAL_OK)
        return rc;
    promise = promised(n, s->now.T, s->delta);
    fall = s->now.F - s->next.F;
    if (s->next.degenerate || !(fall > 0)) {
        damp_more(d);
        return MODAL_OK;
    }
    *still = fall <= 1e-9 * s->now.F && is_rounding(w, &s->next);
    swap_in(s);
    damp_less(d, fall / promise);
    return MODAL_OK;
}

/* Levenberg-Marquardt with the weights as they are. */
static enum modal_status descend(struct work *w, struct search *s, const struct refine_options *opt,
                                 enum refine_end *end, struct modal_error *err)
{
    int most = opt->iterations > 0 ? opt->iterations : ITERATIONS;
    struct damping d = { 1e-4, 2, 0 };
    bool still = false;

    *end = REFINE_STALLED;
    while (s->iterations < most && !ended(w, s, opt, &d, end)) {
        enum modal_status rc = try_step(w, s, &d, &still, err);
        if (rc != MODAL_OK)
            return rc;
        if (still) {
            *end = REFINE_ROUNDING;
            break;
        }
    }
    return MODAL_OK;
}

static double gradient(const struct work *w, const struct evaluation *e)
{
    int n = w->parameters;

    return cblas_dnrm2(n, e->T + n * (n + 1), 1) / sqrt(variance(w, e));
}

/*
 * To the minimum itself: whole steps, each with the weights of the residuals before it, until the
 * gradient is as small as asked for or as rounding lets it be.  Near the minimum F no longer tells
 * better from worse (its fall is the square of the step), the gradient does; weights and exponents
 * settle by turns, so it is compared with the one before the last.
 */
static enum modal_status settle(struct work *w, struct search *s, bool equal,
                                struct modal_error *err)
{
    double before = HUGE_VAL, now = HUGE_VAL;

    for (int i = 0; i < SETTLE_STEPS && now > SETTLED; i++) {
        enum modal_status rc;
        double next;
        if (!damped_step(w->parameters, s->now.T, 0, s->A, s->delta))
            break;
        take_step(w, &s->at, s->delta, &s->trial);
        set_weights(w, s->now.rss, equal);
        rc = evaluate(w, &s->trial, &s->next, err);
        s->evaluations++;
        if (rc != MODAL_OK || s->next.degenerate || (next = gradient(w, &s->next)) >= before)
            return rc;
        before = now, now = next;
        swap_in(s);
    }
    return MODAL_OK;
}

/* Descend, weigh anew, until the weights settle. */
static enum modal_status search(struct work *w, struct search *s,
                                const struct refine_options *asked, struct refined *r,
                                enum refine_end *end, struct modal_error *err)
{
    struct refine_options own = *asked, *opt = &own;
    enum modal_status rc;

    for (int g = 0; g < w->groups; g++)
        w->weight[g] = 1;
    rc = evaluate(w, &s->at, &s->now, err);
    *end = REFINE_DEGENERATE;
    if (rc != MODAL_OK || s->now.degenerate)
        return rc;
    r->start = 0;
    for (int g = 0; g < w->groups; g++)
        r->start += s->now.rss[g];
    r->start = sqrt(r->start);
    r->start_bic = worth(w, s->now.rss, 1);
    if (opt->gain > 0)
        opt->rival = r->start_bic - opt->gain;
    for (int round = 0; round < ROUNDS; round++) {
        if (set_weights(w, s->now.rss, opt->equal_noise) < 0.02 && round > 0)
            break;
        if (w->parameters == 0 || w->look) {
            *end = w->look ? REFINE_LOOKED : REFINE_CONVERGED;
            return MODAL_OK;
        }
        s->evaluations++;
        rc = evaluate(w, &s->at, &s->now, err);       /* the triangle under the new weights */
        if (rc != MODAL_OK)
            return rc;
        rc = descend(w, s, opt, end, err);
        if (rc != MODAL_OK || *end == REFINE_STALLED || *end == REFINE_HOPELESS
            || *end == REFINE_STOPPED)
            return rc;
    }
    if (at_guard(w, &s->at))
        *end = REFINE_BOUNDED;
    return opt->settle && *end == REFINE_CONVERGED ? settle(w, s, opt->equal_noise, err) : MODAL_OK;
}

/* (5): covariance = s2 R^{-1} R^{-T}, in 1/s^2; NAN where R is singular. */
static void covariance(const struct work *w, const struct evaluation *e, double tau, double *cov)
{
    int n = w->parameters, P = n + 1;
    double s2 = fmax(variance(w, e), DBL_MIN) / (tau * tau);
    double *R = cov;              /* invert in place, then multiply up */

    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++)
            R[i + j * n] = i <= j ? e->T[i + j * P] : 0;
    bool singular = n > 0 && LAPACKE_dtrtri(LAPACK_COL_MAJOR, 'U', 'N', n, R, n) != 0;
    if (n > 0 && !singular)
        singular = LAPACKE_dlauum(LAPACK_COL_MAJOR, 'U', n, R, n) != 0;
    for (int j = 0; j < n; j++)
        for (int i = 0; i <= j; i++)
            R[i + j * n] = singular ? NAN : s2 * R[i + j * n];
    for (int j = 0; j < n; j++)
        for (int i = j + 1; i < n; i++)
            R[i + j * n] = R[j + i * n];
}

static bool refined_new(struct refined *r, const struct work *w)
{
    size_t count = (size_t)w->count, n = (size_t)w->parameters, groups = (size_t)w->groups;

    *r = (struct refined) { .poles = w->count, .order = w->order, .parameters = w->parameters,
                            .groups = w->groups };
    r->lambda = calloc(count, sizeof *r->lambda);
    r->first = calloc(count, sizeof *r->first);
    r->covariance = numbers(n, n);
    r->std_re = numbers(count, 1), r->std_im = numbers(count, 1);
    r->noise = numbers(groups, 1), r->floor = numbers(groups, 1);
    return r->lambda != NULL && r->first != NULL && r->covariance != NULL && r->std_re != NULL
        && r->std_im != NULL && r->noise != NULL && r->floor != NULL;
}

void refined_done(struct refined *r)
{
    free(r->lambda), free(r->first), free(r->covariance), free(r->std_re), free(r->std_im),
        free(r->noise);
    free(r->floor);
    *r = (struct refined) { 0 };
}

bool refined_converged(const struct refined *r)
{
    return r->end == REFINE_CONVERGED || r->end == REFINE_ROUNDING;
}

static void report(const struct work *w, const struct search *s, double tau, struct refined *r)
{
    double own = fmax(freedom(w) / w->groups, 1), total = 0;
    bool known = !s->now.degenerate, errors = known && !w->look;

    memcpy(r->first, w->first, (size_t)w->count * sizeof *r->first);
    covariance(w, &s->now, tau, r->covariance);
    for (int j = 0; j < w->count; j++) {
        int p = w->first[j], P = w->parameters;
        double b = w->kind[j] == POLE_PAIR ? s->at.b[j] / tau
            : w->kind[j] == POLE_NEGATIVE  ? M_PI / tau
                                           : 0;
        if (p >= 0 && errors)
            r->lambda[j] = CMPLX(s->at.a[j] / tau, b);
        r->std_re[j] = p < 0 ? 0 : errors ? sqrt(r->covariance[p + p * P]) : NAN;
        r->std_im[j] = p < 0 || w->kind[j] != POLE_PAIR ? 0
            : errors                                    ? sqrt(r->covariance[p + 1 + (p + 1) * P])
                                                        : NAN;
    }
    for (int g = 0; g < w->groups; g++) {
        r->noise[g] = known ? sqrt(s->now.rss[g] / own) : NAN;
        r->floor[g] = sqrt(w->floor2[g]);
        total += s->now.rss[g];
    }
    r->residual = known ? sqrt(total) : NAN;
    r->bic = known ? worth(w, s->now.rss, 1) : HUGE_VAL;
    r->iterations = s->iterations, r->evaluations = s->evaluations;
    r->work = w->spent;
}

static enum modal_status check(const struct refine_data *d, const double complex *start, int count,
                               struct modal_error *err)
{
    int phases = d->phases > 0 ? d->phases : 1, order = 0;

    if (d->Y->m < 2 || d->Y->n < 1 || !(d->tau > 0) || d->Y->n % phases != 0)
        return modal_fail(err, MODAL_BAD_INPUT, "refine: %d rows, %d columns, %d phases, step %g",
                          d->Y->m, d->Y->n, phases, d->tau);
    for (int j = 0; j < count; j++) {
        if (!isfinite(creal(start[j])) || !isfinite(cimag(start[j])))
            return modal_fail(err, MODAL_BAD_INPUT, "refine: pole %d is not finite", j);
        order += pole_order(start[j], d->tau);
    }
    if (count < 1 || order > REFINE_ORDER_MOST || order >= d->Y->m)
        return modal_fail(err, MODAL_BAD_INPUT,
                          "refine: order %d; accepted: 1 to %d and below the %d rows", order,
                          REFINE_ORDER_MOST, d->Y->m);
    return MODAL_OK;
}

/* Sum of squares of the steps from row to row. */
static double swing(const double *y, int L)
{
    double sum = 0;

    for (int l = 1; l < L; l++)
        sum += (y[l] - y[l - 1]) * (y[l] - y[l - 1]);
    return sum;
}

/* Energies, and (6).  A part at angle theta steps by 2 sin(theta / 2) of its size: theta of a
 * signal is that of all its parts, by their energies, and the same whatever poles are tried. */
static void set_energy(struct work *w)
{
    double n = (double)w->L * w->phases;

    for (int c = 0; c < w->S; c++) {
        const struct compressed *b = w->data->blocks;
        const double *y = w->Y->x + (size_t)c * (size_t)w->Y->ld;
        double r = b != NULL ? sqrt(b->energy[c]) : cblas_dnrm2(w->L, y, 1);
        w->energy[c / w->phases] += r * r;
        w->floor2[c / w->phases] += b != NULL ? b->swing[c] : swing(y, w->L);
    }
    for (int g = 0; g < w->groups; g++) {
        double chord = w->energy[g] > 0 ? sqrt(w->floor2[g] / w->energy[g]) : 0,
               theta = 2 * asin(fmin(chord / 2, 1));
        double f = (4 + theta * (w->L + 2.0 * w->data->before) / 4) * DBL_EPSILON;
        w->floor2[g] = f * f * w->energy[g] / n;
        w->lowest[g] = w->data->least != NULL ? fmax(w->floor2[g],
                                                     w->data->least[g]) : w->floor2[g];
    }
}

enum modal_status refine_poles(const struct refine_data *data, const double complex *start,
                               int count, const bool *fixed, const struct refine_options *options,
                               struct refined *out, struct modal_error *err)
{
    struct refine_options opt = options != NULL ? *options : (struct refine_options) { 0 };
    struct work w = { .data = data,
                      .Y = data->Y,
                      .L = data->Y->m,
                      .S = data->Y->n,
                      .count = count,
                      .fixed = fixed,
                      .phases = data->phases > 0 ? data->phases : 1,
                      .look = opt.iterations < 0 };
    struct search s = { 0 };
    struct refined r = { 0 };
    enum modal_status rc = check(data, start, count, err);

    if (rc != MODAL_OK)
        return rc;
    w.groups = w.S / w.phases;
    if (!work_layout(&w, start) || !work_allocate(&w, true) || !search_new(&s, &w)
        || !refined_new(&r, &w)) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "refine: no memory for %d x %d, order %d", w.L, w.S,
                        w.order);
        goto out;
    }
    set_energy(&w);
    for (int j = 0; j < count; j++) {
        s.at.a[j] =
            w.first[j] < 0 ? creal(start[j]) * data->tau : guard(&w, creal(start[j]) * data->tau);
        s.at.b[j] = cimag(start[j]) * data->tau;
        r.lambda[j] = start[j];
    }
    rc = search(&w, &s, &opt, &r, &r.end, err);
    if (rc != MODAL_OK)
        goto out;
    report(&w, &s, data->tau, &r);
    *out = r;
    r = (struct refined) { 0 };
out:
    refined_done(&r);
    search_done(&s);
    work_done(&w);
    return rc;
}

double refine_work(const struct refine_data *data, int order)
{
    int L = data->Y->m, S = data->Y->n;
    double columns = 2.0 * order + S;

    return gram_pays(L, order, S) ? gram_work(L, order, S) : L * columns * columns;
}

void projected_done(struct projected *p)
{
    free(p->R), free(p->Z), free(p->rss), free(p->energy), free(p->lowest);
    *p = (struct projected) { 0 };
}

static bool projected_new(struct projected *p, const struct work *w)
{
    size_t q = (size_t)w->order, groups = (size_t)w->groups;

    *p = (struct projected) { .order = w->order, .parameters = w->parameters, .columns = w->S };
    p->R = numbers(q, q), p->Z = numbers(q, (size_t)w->S), p->rss = numbers(groups, 1);
    p->energy = numbers(groups, 1), p->lowest = numbers(groups, 1);
    return p->R != NULL && p->Z != NULL && p->rss != NULL && p->energy != NULL && p->lowest != NULL;
}

/* What the evaluation left, into *p. */
static void projected_take(struct projected *p, const struct work *w, const struct evaluation *e)
{
    size_t bytes = (size_t)w->groups * sizeof *p->rss;

    memcpy(p->R, w->R, (size_t)w->order * (size_t)w->order * sizeof *p->R);
    memcpy(p->rss, e->rss, bytes), memcpy(p->energy, w->energy, bytes),
        memcpy(p->lowest, w->lowest, bytes);
    p->criterion = criterion_for(w);
    p->criterion.energy = p->energy, p->criterion.floor2 = p->lowest;
    p->degenerate = e->degenerate;
    p->work = w->spent;
}

enum modal_status refine_project(const struct refine_data *data, const double complex *lambda,
                                 int count, const bool *fixed,
                                 struct projected *out, struct modal_error *err)
{
    struct work w = { .data = data, .Y = data->Y, .L = data->Y->m, .S = data->Y->n, .count = count,
                      .fixed = fixed,
                      .phases = data->phases > 0 ? data->phases : 1, .look = true };
    struct search s = { 0 };
    struct projected p = { 0 };
    enum modal_status rc = check(data, lambda, count, err);

    if (rc != MODAL_OK)
        return rc;
    w.groups = w.S / w.phases;
    if (!work_layout(&w, lambda) || !work_allocate(&w, true) || !search_new(&s, &w)
        || !projected_new(&p, &w)) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "refine: no memory for %d x %d, order %d", w.L, w.S,
                        w.order);
        goto out;
    }
    set_energy(&w);
    for (int g = 0; g < w.groups; g++)
        w.weight[g] = 1;
    for (int j = 0; j < count; j++) {
        double a = creal(lambda[j]) * data->tau;
        s.at.a[j] = w.first[j] < 0 ? a : guard(&w, a);
        s.at.b[j] = cimag(lambda[j]) * data->tau;
    }
    w.all = p.Z;
    rc = evaluate(&w, &s.at, &s.now, err);
    if (rc != MODAL_OK)
        goto out;
    projected_take(&p, &w, &s.now);
    *out = p;
    p = (struct projected) { 0 };
out:
    projected_done(&p);
    search_done(&s);
    work_done(&w);
    return rc;
}

void refined_std(const struct refined *r, int pole, double tau, double *frequency_hz,
                 double *damping_ratio, double *multiplier)
{
    double re = creal(r->lambda[pole]), im = cimag(r->lambda[pole]), w = hypot(re, im);
    double vr = r->std_re[pole] * r->std_re[pole], vi = r->std_im[pole] * r->std_im[pole],
           cross = 0;
    int p = r->first[pole], n = r->parameters;

    if (p >= 0 && p + 1 < n && r->std_im[pole] > 0)
        cross = r->covariance[p + (p + 1) * n];
    if (frequency_hz != NULL)         /* d|lambda| = (re dre + im dim) / |lambda| */
        *frequency_hz = w > 0
            ? sqrt(fmax(re * re * vr + im * im * vi + 2 * re * im * cross, 0)) / w / (2 * M_PI)
            : sqrt(vr) / (2 * M_PI);
    if (damping_ratio != NULL)        /* d(-re/|lambda|) = (-im^2 dre + re im dim) / |lambda|^3 */
        *damping_ratio = w > 0 ? fabs(im)
                * sqrt(fmax(im * im * vr + re * re * vi - 2 * re * im * cross, 0)) / (w * w * w)
                               : NAN;
    if (multiplier != NULL)
        *multiplier = exp(re * tau) * tau * sqrt(vr + vi);
}

/* ---- all channels of a wide batch, one step ---- */

/* Of all channels, where samples must be read in order: Q^T A, and what is left of them by the
 * samples themselves, or NULL. */
struct in_order { double *Z, *rest2; };

static void in_order_done(struct in_order *all)
{
    free(all->Z), free(all->rest2);
}

/* Energy less what the poles explain of it; false where they cancel. */
static bool rest_by_energies(const struct work *w, const struct wide *d, int channel,
                             const double *z, double *rest2)
{
    double rms = wide_rms(d, channel), energy = w->L * rms * rms;
    double sum = cblas_ddot(w->order, z, 1, z, 1);

    *rest2 = energy - sum;
    return *rest2 > 1e-8 * energy;
}

/* One pass, and another where energies cancel. */
static enum modal_status read_in_order(const struct work *w, const struct wide *d,
                                       struct in_order *all, struct modal_error *err)
{
    size_t k = (size_t)w->most_columns, S = (size_t)d->S;
    bool plain = true;
    double unused;

    all->Z = malloc(sizeof *all->Z * k * S);
    if (all->Z == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "refine: no memory for order %d of %d channels",
                          w->order, d->S);
    wide_project(d, w->basis, w->most_columns, all->Z);
    for (size_t c = 0; c < S; c++)
        plain &= d->scale[c] == 0 || rest_by_energies(w, d, (int)c, all->Z + c * k, &unused);
    if (plain)
        return MODAL_OK;
    all->rest2 = malloc(sizeof *all->rest2 * S);
    if (all->rest2 == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "refine: no memory for %d channels", d->S);
    return wide_rests(d, w->basis, w->order, all->Z, w->most_columns, all->rest2, err);
}

/* What is left of channel c of a panel: by energies, and by the samples themselves where those
 * cancel. */
static double wide_rest(const struct work *w, const struct wide *d, const struct in_order *all,
                        int c0, int c)
{
    int k = w->most_columns, q = w->order, L = w->L;
    double sum;

    if (rest_by_energies(w, d, c0 + c, w->Z + c * k, &sum))
        return sum;
    if (all->rest2 != NULL)
        return all->rest2[c0 + c];
    cblas_dcopy(L, d->x + c0 + c, (int)d->stride, w->rest, 1);
    cblas_dgemv(CblasColMajor, CblasNoTrans, L, q, -1, w->basis, L, w->Z + c * k, 1, 1, w->rest, 1);
    sum = cblas_dnrm2(L, w->rest, 1);
    return sum * sum;
}

/* Panel c0 .. c0+n-1: residuals, weights from them, coefficients, rows of (4). */
static enum modal_status wide_panel(struct work *w, const struct wide *d,
                                    const struct in_order *all, int c0, int n, struct evaluation *e,
                                    struct wide_step *out, struct modal_error *err)
{
    int q = w->order, k = w->most_columns, P = w->parameters + 1, live = 0;
    double floor = (4 + w->floor2[0] * w->L / 4) * DBL_EPSILON;

    if (all->Z != NULL)
        memcpy(w->Z, all->Z + (size_t)c0 * (size_t)k, (size_t)k * (size_t)n * sizeof *w->Z);
    else
        cblas_dgemm(CblasColMajor, CblasTrans, CblasTrans, k, n, w->L, 1, w->basis, w->L, d->x + c0,
                    (int)d->stride, 0, w->Z, k);
    for (int c = 0; c < n; c++)
        memcpy(w->C + c * q, w->Z + c * k, (size_t)q * sizeof *w->C);
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, q, n, 1, w->R, k,
                w->C, q);
    for (int c = 0; c < n; c++) {
        double rms = d->scale[c0 + c] > 0 ? wide_rms(d, c0 + c) : 0, least = floor * rms;
        double rss = rms > 0 ? wide_rest(w, d, all, c0, c) : 0;
        double variance = fmax(rss / fmax(w->L - q, 1), least * least);
        out->rest[c0 + c] = sqrt(rss / w->L);
        for (int j = 0; out->coefficient != NULL && j < w->count; j++)
            out->coefficient[j + (size_t)(c0 + c) * (size_t)w->count] =
                CMPLX(w->C[w->column[j] + c * q],
                      w->kind[j] == POLE_PAIR ? w->C[w->column[j] + 1 + c * q] : 0);
        if (variance <= 0)
            continue;
        e->F += rss / variance;
        channel_rows(w, c, 1 / sqrt(variance), P + live++ * (k - q));
    }
    if (w->parameters == 0 || k == q || live == 0)
        return MODAL_OK;
    triangle_to_stack(w, e->T);
    return reduce_stack(w, P + live * (k - q), e->T, err);
}

static enum modal_status wide_evaluate(struct work *w, const struct wide *d, const struct point *at,
                                       struct evaluation *e, struct wide_step *out,
                                       struct modal_error *err)
{
    struct in_order all = { 0 };
    enum modal_status rc;

    e->F = 0;
    fill_basis(w, at);
    rc = factor(w, err);
    if (rc == MODAL_OK && !regular(w))
        return modal_fail(err, MODAL_NO_CONVERGENCE, "refine: the poles coincide");
    if (rc == MODAL_OK && d->by_rows)
        rc = read_in_order(w, d, &all, err);
    for (int c = 0; c < d->S && rc == MODAL_OK; c += w->panel)
        rc = wide_panel(w, d, &all, c, d->S - c < w->panel ? d->S - c : w->panel, e, out, err);
    in_order_done(&all);
    return rc;
}

enum modal_status wide_refine(const struct wide *d, double tau, const double complex *start,
                              int count, const bool *fixed, double most, struct wide_step *out,
                              struct modal_error *err)
{
    /* never joined */
    struct matrix shape = { d->L, JOIN_MOST + 1 < d->S ? d->S : JOIN_MOST + 1, d->L, NULL };
    struct refine_data data = { .Y = &shape, .tau = tau };
    struct work w = { .data = &data,
                      .Y = &shape,
                      .L = d->L,
                      .S = shape.n,
                      .groups = 1,
                      .phases = shape.n,
                      .count = count,
                      .fixed = fixed };
    struct search s = { 0 };
    double *cov = NULL, step = 0;
    enum modal_status rc = check(&data, start, count, err);

    if (rc != MODAL_OK)
        return rc;
    if (!work_layout(&w, start) || !work_allocate(&w, false) || !search_new(&s, &w)
        || (cov = numbers((size_t)w.parameters, (size_t)w.parameters)) == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "refine: no memory for order %d of %d channels",
                        w.order, d->S);
        goto out;
    }
    w.S = d->S;
    for (int j = 0; j < count; j++) {
        s.at.a[j] = creal(start[j]) * tau, s.at.b[j] = cimag(start[j]) * tau;
        w.floor2[0] = fmax(w.floor2[0], fabs(s.at.b[j]));         /* the fastest phase, for (6) */
    }
    rc = wide_evaluate(&w, d, &s.at, &s.now, out, err);
    if (rc != MODAL_OK)
        goto out;
    step = cblas_dnrm2(w.parameters, s.now.T + w.parameters * (w.parameters + 1), 1)
        / sqrt(fmax(s.now.F / fmax(freedom(&w), 1), DBL_MIN));
    out->length = step;
    out->taken = step <= most && damped_step(w.parameters, s.now.T, 0, s.A, s.delta);
    if (out->taken)
        take_step(&w, &s.at, s.delta, &s.trial);
    covariance(&w, &s.now, tau, cov);
    for (int j = 0; j < count; j++) {
        int p = w.first[j], P = w.parameters;
        out->lambda[j] = start[j];
        if (p >= 0 && out->taken)
            out->lambda[j] = CMPLX(s.trial.a[j] / tau,
                                   w.kind[j] == POLE_PAIR ? s.trial.b[j] / tau : cimag(start[j]));
        out->std_re[j] = p < 0 ? 0 : sqrt(cov[p + p * P]);
        out->std_im[j] = p < 0 || w.kind[j] != POLE_PAIR ? 0 : sqrt(cov[p + 1 + (p + 1) * P]);
    }
out:
    free(cov);
    search_done(&s);
    work_done(&w);
    return rc;
}
