/*
 * choose_lines.c - lines that leave, one after the other
 *
 * Of amplitudes X, of covariance C in noise of variance 1, those of columns I leave behind
 *
 *     X - C_.I C_II^-1 X_I,    C - C_.I C_II^-1 C_I.,    rss + X_I' C_II^-1 X_I,           (1)
 *
 * the fit without them.  The last term over the noise's variance is chi-squared, what the line
 * gains.  Lines that the record does not resolve have little each beside the others, and all of it
 * once those have gone: to leave out all that gain little at once would lose what they explain
 * together.  (1) costs columns^2 a line; of all lines together about as much as one fit.
 */
#include "modal/identify/order/choose_lines.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include "modal/identify/linear/exponents.h"

/* What is left of some lines. */
struct leaving {
    const struct lines *all;
    double tau;
    int rows;
    struct projected p;         /* R is C and Z is X, of all columns at the start */
    double *had;                /* C_ii then; 0: it has left */
    int *column;                /* per line: its first; -1: it has left */
    double *chi2;               /* per line: what it gains */
    int order, lines;           /* columns, lines that are left */
};

/* -2 ln(likelihood) that one of so many POLES, with so many of their COLUMNS, must gain, the
 * exponents being there. */
static double price_of(const struct criterion *c, int poles, int order, int columns)
{
    return criterion_price(c, poles, order, 0) - criterion_price(c, poles - 1, order - columns, 0);
}

/* What the variance of signal g is, as far as FREE rows tell. */
static double noise_of(const struct projected *p, int g, int free_rows)
{
    return fmax(p->rss[g] / (free_rows > 1 ? free_rows : 1), p->criterion.floor2[g]);
}

static int columns_of(const struct leaving *v, int i)
{
    return pole_order(v->all->lambda[i], v->tau);
}

/* C and X from the triangle and Q^T Y. */
static bool covariance(struct projected *p)
{
    size_t q = (size_t)p->order;
    double *C = p->R;

    if (LAPACKE_dtrtri(LAPACK_COL_MAJOR, 'U', 'N', p->order, C, p->order) != 0)
        return false;
    cblas_dtrmm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, p->order,
                p->columns, 1, C, p->order, p->Z, p->order);
    LAPACKE_dlauum(LAPACK_COL_MAJOR, 'U', p->order, C, p->order);
    for (size_t i = 0; i < q; i++)
        for (size_t j = 0; j < i; j++)
            C[i + j * q] = C[j + i * q];
    return true;
}

static enum modal_status leaving_new(const struct refine_data *data, const struct lines *l,
                                     struct leaving *v, struct modal_error *err)
{
    enum modal_status rc = refine_project(data, l->lambda, l->count, NULL, &v->p, err);
    size_t q = (size_t)v->p.order;

    v->all = l, v->tau = data->tau, v->rows = data->Y->m;
    v->had = workspace_numbers(&v->p.space, q, 1);
    v->chi2 = workspace_numbers(&v->p.space, (size_t)l->count, 1);
    v->column = workspace_zeros(&v->p.space, (size_t)l->count, sizeof *v->column);
    v->order = v->p.order, v->lines = l->count;
    if (rc != MODAL_OK)
        return rc;
    if (v->p.space.failed)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d lines", l->count);
    if (v->p.degenerate || !covariance(&v->p))
        return modal_fail(err, MODAL_NO_CONVERGENCE, "identify: lines that coincide");
    for (size_t i = 0; i < q; i++)
        v->had[i] = v->p.R[i + i * q];
    for (int i = 0, c = 0; i < l->count; c += columns_of(v, i++))
        v->column[i] = c;
    return MODAL_OK;
}

/* The last term of (1) in signal s, of N columns from c on. */
static double share_of(const struct leaving *v, int c, int n, int s)
{
    size_t q = (size_t)v->p.order;
    const double *C = v->p.R + (size_t)c + (size_t)c * q, *x = v->p.Z + (size_t)c + (size_t)s * q;
    double a = C[0], b = n > 1 ? C[1] : 0, d = n > 1 ? C[1 + q] : 1, x1 = n > 1 ? x[1] : 0,
           det = a * d - b * b;

    return det > 0 ? fmax((d * x[0] * x[0] - 2 * b * x[0] * x1 + a * x1 * x1) / det, 0) : 0;
}

static void weigh_lines(struct leaving *v)
{
    for (int i = 0; i < v->all->count; i++) {
        v->chi2[i] = 0;
        for (int s = 0; s < v->p.columns && v->column[i] >= 0; s++)
            v->chi2[i] += share_of(v, v->column[i], columns_of(v, i), s)
                        / noise_of(&v->p, s, v->rows - v->order);
    }
}

static bool best_of_family(const struct leaving *v, int i)
{
    const int *family = v->all->family;
    bool best = true;

    for (int j = 0; j < v->all->count && best; j++)
        best = v->column[j] < 0 || family[j] != family[i] || v->chi2[j] < v->chi2[i]
            || (v->chi2[j] == v->chi2[i] && j >= i);
    return best;
}

/* The line that lacks most of what it must gain, but the best of a family; -1: none lacks any. */
static int find_least(const struct leaving *v)
{
    const struct criterion *c = &v->p.criterion;
    double price[] = { price_of(c, v->lines, v->order, 1), price_of(c, v->lines, v->order, 2) },
           most = 0;
    int least = -1;

    for (int i = 0; i < v->all->count; i++) {
        double lacks = price[columns_of(v, i) - 1] - v->chi2[i];
        if (v->column[i] >= 0 && lacks > most && !best_of_family(v, i))
            most = lacks, least = i;
    }
    return least;
}

/* (1) for column k; false: C is nothing there. */
static bool leave_column(struct leaving *v, int k)
{
    int q = v->p.order;
    double *c = v->p.R + (size_t)k * (size_t)q, pivot = c[k];

    v->had[k] = 0;
    if (!(pivot > 0))
        return false;
    for (int s = 0; s < v->p.columns; s++) {
        double *X = v->p.Z + (size_t)s * (size_t)q, x = X[k];
        v->p.rss[s] += x * x / pivot;
        cblas_daxpy(q, -x / pivot, c, 1, X, 1);
    }
    for (int j = 0; j < q; j++)
        if (v->had[j] > 0)
            cblas_daxpy(q, -c[j] / pivot, c, 1, v->p.R + (size_t)j * (size_t)q, 1);
    return true;
}

/* Line i leaves; *worn: C has lost half of its digits somewhere. */
static void leave_out(struct leaving *v, int i, bool *worn)
{
    size_t q = (size_t)v->p.order;
    int n = columns_of(v, i);

    for (int k = v->column[i]; k < v->column[i] + n; k++)
        *worn |= !leave_column(v, k);
    for (size_t j = 0; j < q; j++)
        *worn |= v->p.R[j + j * q] < sqrt(DBL_EPSILON) * v->had[j];
    v->column[i] = -1, v->order -= n, v->lines--;
}

static void keep_left(const struct leaving *v, struct lines *l)
{
    int kept = 0;

    for (int i = 0; i < l->count; i++)
        if (v->column[i] >= 0)
            l->lambda[kept] = l->lambda[i], l->family[kept++] = l->family[i];
    l->count = kept;
}

enum modal_status lines_choose(const struct refine_data *data, struct lines *l,
                               struct modal_error *err)
{
    bool worn = true;
    enum modal_status rc = MODAL_OK;

    /* begun anew where C is worn out */
    while (rc == MODAL_OK && worn) {
        struct leaving v = { 0 };
        int least = 0;
        rc = leaving_new(data, l, &v, err);
        for (worn = false; rc == MODAL_OK && !worn && least >= 0;) {
            weigh_lines(&v);
            least = find_least(&v);
            if (least >= 0)
                leave_out(&v, least, &worn);
        }
        if (rc == MODAL_OK)
            keep_left(&v, l);
        projected_done(&v.p);
    }
    return rc;
}

/* ---- families ---- */

/* The columns of family J. */
static int gather(const struct leaving *v, int j, int *column)
{
    int n = 0;

    for (int i = 0; i < v->all->count; i++)
        for (int c = 0; c < columns_of(v, i) && v->all->family[i] == j; c++)
            column[n++] = v->column[i] + c;
    return n;
}

/* The last term of (1) of N columns into GAIN, per signal; false: C_II is nothing there. */
static bool gain_of(const struct leaving *v, const int *column, int n, double *C, double *gain)
{
    size_t q = (size_t)v->p.order;
    double *x = C + (size_t)n * (size_t)n;

    for (int j = 0; j < n; j++)
        for (int i = 0; i <= j; i++)
            C[i + j * n] = v->p.R[(size_t)column[i] + (size_t)column[j] * q];
    if (LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'U', n, C, n) != 0)
        return false;
    for (int s = 0; s < v->p.columns; s++) {
        for (int i = 0; i < n; i++)
            x[i] = v->p.Z[(size_t)column[i] + (size_t)s * q];
        cblas_dtrsv(CblasColMajor, CblasUpper, CblasTrans, CblasNonUnit, n, C, n, x, 1);
        gain[s] = cblas_ddot(n, x, 1, x, 1);
    }
    return true;
}

/* The criterion less one family's COLUMNS and EXPONENTS, where SHARE of its GAIN is lost. */
static double worth_without(const struct leaving *v, int columns, int exponents, double share,
                            const double *gain, double *rss)
{
    int order = v->p.order - columns;

    for (int s = 0; s < v->p.columns; s++)
        rss[s] = v->p.rss[s] + share * gain[s];
    return criterion_of(&v->p.criterion, rss, 1, (order + 1) / 2, order,
                        v->p.parameters - exponents);
}

enum modal_status lines_without(const struct refine_data *data, const struct lines *l, int count,
                                struct lines_family *each, struct modal_error *err)
{
    struct leaving v = { 0 };
    enum modal_status rc = leaving_new(data, l, &v, err);
    size_t q = (size_t)v.p.order, S = (size_t)v.p.columns;
    int *column = workspace_zeros(&v.p.space, q, sizeof *column);
    double *C = workspace_numbers(&v.p.space, q + 1, q),
           *gain = workspace_numbers(&v.p.space, S, 2);

    if (rc == MODAL_OK && v.p.space.failed)
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d lines", l->count);
    for (int j = 0; j < count && rc == MODAL_OK; j++) {
        struct lines_family *f = &each[j];
        int n = gather(&v, j, column);
        bool told = gain_of(&v, column, n, C, gain);
        /* not told: it has to be tried */
        f->alone = told ? worth_without(&v, n, f->exponents, 1, gain, gain + S) : HUGE_VAL;
        f->least = told ? worth_without(&v, n, f->exponents, f->share, gain, gain + S) : -HUGE_VAL;
    }
    projected_done(&v.p);
    return rc;
}
