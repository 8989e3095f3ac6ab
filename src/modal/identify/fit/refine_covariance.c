/*
 * refine_covariance.c - the standard errors of refine.c: (5), and what the amplitudes' own noise
 * makes of it
 *
 * In (5) R_J is of the amplitudes as they were fitted, c + u: their noise u, of covariance
 * sigma_c^2 V, V = (R11^T R11)^{-1}, is independent of the residuals, and adds to R_J^T R_J, of the
 * true ones A, in the mean
 *
 *     N[a, b] = s^2 S tr(K_a^T G K_b V),   G = R22^T R22,                                       (1)
 *
 * K_a c column a of the K_c of (3) of refine.c, S signals that are there.  Of few signals that is
 * nothing; of a mode that many columns have a little of, as the samples of a period have, it is a
 * share of all.  Of F as a function of the exponents the mean has the curvature 2 A, as whatever
 * they are Phi takes the same of the noise; the gradient, -2 sum e^T P D K (c + u), has the
 * variance 4 s^2 (A + N), as P e and u are independent.  So
 *
 *     covariance = s^2 A^{-1} (A + N) A^{-1},   A = R_J^T R_J - N.                              (2)
 *
 * With R_J^{-T} N R_J^{-1} = U f U^T that is s^2 R_J^{-1} U (1 - f)^{-2} U^T R_J^{-T}.  Along a
 * direction R_J^T R_J is chi-squared of S degrees of freedom and more, noncentral by what A is in
 * N / S: A is told from nothing where it is above sqrt(2 S) of those, f below
 *
 *     1 / (1 + sqrt(2 / S)),                                                                    (3)
 *
 * and taken for that where it is not.
 *
 * All that is asked of columns of one noise: the samples of a period, and all channels of a batch
 * that were reduced for the search (refine_wide.c).  Other signals of a constant system are few,
 * and an update of a live window (live/moving_fit.c), which has not (1), must have the standard
 * errors of a batch.
 */
#include "modal/identify/fit/refine_state.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>
#include "modal/linalg/eigen.h"

double refine_rows(const struct work *w)
{
    /* for covariances and prices: correlated rows tell less */
    return w->L * (w->data->share > 0 ? w->data->share : 1);
}

double refine_freedom(const struct work *w)
{
    return w->S * (refine_rows(w) - w->order) - w->parameters;
}

bool refine_at_rounding(const struct work *w, const struct evaluation *e, int g)
{
    return e->rss[g] <= (double)w->L * w->phases * w->floor2[g];
}

double refine_rounding_part(const struct work *w, const struct evaluation *e)
{
    double sum = 0;

    for (int g = 0; g < w->groups; g++)
        sum += refine_at_rounding(w, e, g) ? w->weight[g] * w->weight[g] * e->rss[g] : 0;
    return sum;
}

/* Signals at rounding are weighed by a bound of it: beside noise they say nothing of
 * the noise. */
double refine_variance(const struct work *w, const struct evaluation *e)
{
    int noisy = 0;

    for (int g = 0; g < w->groups; g++)
        noisy += !refine_at_rounding(w, e, g);
    if (noisy == 0 || noisy == w->groups)
        return e->F / fmax(refine_freedom(w), 1);
    /* freedom in proportion: each signal has as many rows */
    return (e->F - refine_rounding_part(w, e)) / fmax(refine_freedom(w) * noisy / w->groups, 1);
}

/* 2 x 2, or 1 x 1 of a real pole: entries [row][column]. */
struct block { double x[2][2]; };

/* Rows and columns of poles I and J of A, q x q. */
static struct block block_of(const struct work *w, const double *A, int i, int j)
{
    int rows = w->kind[i] == POLE_PAIR ? 2 : 1, columns = w->kind[j] == POLE_PAIR ? 2 : 1;
    struct block b = { 0 };

    for (int r = 0; r < rows; r++)
        for (int c = 0; c < columns; c++)
            b.x[r][c] = A[w->column[i] + r + (size_t)(w->column[j] + c) * (size_t)w->order];
    return b;
}

/* K_a^T X of the second parameter of a pair, (3) of refine.c; of the first it is X. */
static struct block turn_rows(struct block b)
{
    return (struct block) { { { b.x[1][0], b.x[1][1] }, { -b.x[0][0], -b.x[0][1] } } };
}

static struct block transposed(struct block b)
{
    return (struct block) { { { b.x[0][0], b.x[1][0] }, { b.x[0][1], b.x[1][1] } } };
}

/* tr(A B^T) */
static double trace_of(struct block a, struct block b)
{
    double sum = 0;

    for (int r = 0; r < 2; r++)
        for (int c = 0; c < 2; c++)
            sum += a.x[r][c] * b.x[r][c];
    return sum;
}

/* What the poles I and J add to N. */
static void add_pair(const struct work *w, const double *G, const double *V, int i, int j,
                     double *N)
{
    int n = w->parameters, a = w->first[i], b = w->first[j];
    bool turns = w->kind[i] == POLE_PAIR && w->turn[i] != 0,
         others = w->kind[j] == POLE_PAIR && w->turn[j] != 0;
    struct block g = block_of(w, G, i, j), v = block_of(w, V, i, j), h;

    h = transposed(turn_rows(transposed(g)));
    N[a + b * n] += trace_of(g, v);
    if (turns)
        N[a + 1 + b * n] += w->turn[i] * trace_of(turn_rows(g), v);
    if (others)
        N[a + (b + 1) * n] += w->turn[j] * trace_of(h, v);
    if (turns && others)
        N[a + 1 + (b + 1) * n] += w->turn[i] * w->turn[j] * trace_of(turn_rows(h), v);
}

/* V and G of (1), q x q both; false: V is not there. */
static bool grams(const struct work *w, double *V, double *G)
{
    int q = w->order, k = w->most_columns;

    for (int j = 0; j < q; j++)
        for (int i = 0; i < q; i++)
            V[i + j * q] = i <= j ? w->R[i + j * k] : 0;
    if (LAPACKE_dtrtri(LAPACK_COL_MAJOR, 'U', 'N', q, V, q) != 0
        || LAPACKE_dlauum(LAPACK_COL_MAJOR, 'U', q, V, q) != 0)
        return false;
    cblas_dsyrk(CblasColMajor, CblasUpper, CblasTrans, q, k - q, 1, w->R + q + q * k, k, 0, G, q);
    for (int j = 0; j < q; j++)
        for (int i = 0; i < j; i++)
            V[j + i * q] = V[i + j * q], G[j + i * q] = G[i + j * q];
    return true;
}

/* The f of (2), into F, and U into N, which is that of (1). */
static bool shares(const struct work *w, const double *R, double *N, double *f)
{
    int n = w->parameters;
    struct matrix A = { n, n, n, N };

    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasTrans, CblasNonUnit, n, n, 1, R, n, N,
                n);
    cblas_dtrsm(CblasColMajor, CblasRight, CblasUpper, CblasNoTrans, CblasNonUnit, n, n, 1, R, n,
                N, n);
    return eigen_symmetric(&A, f, NULL) == MODAL_OK;
}

/* U / (1 - f) of (2) into ROOT, n x n. */
static bool weigh(const struct work *w, double S, double s2, const double *R, double *root)
{
    size_t n = (size_t)w->parameters, q = (size_t)w->order;
    struct workspace space = { 0 };
    double *N = workspace_numbers(&space, n, n), *f = workspace_numbers(&space, n, 1),
           *V = workspace_numbers(&space, q, q), *G = workspace_numbers(&space, q, q);
    bool ok = !space.failed && grams(w, V, G);

    for (int i = 0; i < w->count && ok; i++)
        for (int j = 0; j < w->count; j++)
            if (w->first[i] >= 0 && w->first[j] >= 0)
                add_pair(w, G, V, i, j, N);
    cblas_dscal(w->parameters * w->parameters, s2 * S, N, 1);
    ok = ok && shares(w, R, N, f);
    for (size_t j = 0; j < n && ok; j++) {
        double share = fmin(fmax(f[j], 0), 1 / (1 + sqrt(2 / S)));                     /* (3) */
        cblas_dscal((int)n, 1 / (1 - share), N + j * n, 1);
    }
    if (ok)
        memcpy(root, N, n * n * sizeof *root);
    workspace_free(&space);
    return ok;
}

/* R^{-1} into ROOT, n x n and 0, times what the amplitudes' noise makes of it. */
static bool root_of(const struct work *w, double S, double s2, const double *R, double *root)
{
    int n = w->parameters;

    for (int j = 0; j < n; j++)
        root[j + j * n] = 1;
    if (w->phases > 1 && !weigh(w, S, s2, R, root))
        return false;
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, n, n, 1, R, n,
                root, n);
    return true;
}

void refine_covariance(const struct work *w, const struct evaluation *e, double columns,
                       double tau, double *cov)
{
    int n = w->parameters, P = n + 1;
    size_t all = (size_t)n * (size_t)n;
    double s2 = fmax(refine_variance(w, e), DBL_MIN);
    struct workspace space = { 0 };
    double *R = workspace_numbers(&space, (size_t)n, (size_t)n),
           *root = workspace_numbers(&space, (size_t)n, (size_t)n);
    bool known = !space.failed && !w->look;

    for (int j = 0; j < n && known; j++) {
        for (int i = 0; i <= j; i++)
            R[i + j * n] = e->T[i + j * P];
        known = R[j + j * n] != 0;
    }
    if (known && n > 0)
        known = root_of(w, columns, s2, R, root);
    if (known && n > 0)
        cblas_dsyrk(CblasColMajor, CblasUpper, CblasNoTrans, n, n, s2 / (tau * tau), root, n, 0,
                    cov, n);
    for (size_t i = 0; i < all && !known; i++)
        cov[i] = NAN;
    for (int j = 0; j < n; j++)
        for (int i = j + 1; i < n; i++)
            cov[i + j * n] = cov[j + i * n];
    workspace_free(&space);
}
