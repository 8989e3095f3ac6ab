/*
 * moving_judge.c - would a batch of this window choose other poles?
 *
 * Owned here: every alarm of moving.c, each with its limit.  In doubt the answer is yes, which
 * costs time and nothing else.
 */
#include "modal/identify/live/moving_state.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/colour.h"
#include "modal/identify/fit/criterion.h"
#include "modal/identify/fit/parts.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/order/order.h"

enum {
    EDGE_SAMPLES = 2,                   /* at either end, which have no line in a spectrum */
    PART_LEAST = 8                      /* samples that have a spectrum */
};
/* of a parameter's price: a constant that might rather decay; its gain is known to first order */
static const double MOVES = 0.8;
/* times what rounding leaves of a sum of squares: four in amplitude */
static const double ROUNDING_NEAR = 16;

enum reason judge_fit(const struct job *j, const struct moving_fit *f)
{
    double record = j->m->L * j->m->opt.dt, reach = fmax(ORDER_REACH * j->m->L * j->r, 100);
    bool chosen = j->m->opt.identify.rank.rule == RANK_AUTO;

    if (!f->settled)
        return NOT_SETTLED;
    for (int i = 0; i < f->poles; i++) {
        double size = cabs(f->lambda[i]), error = hypot(f->std_re[i], f->std_im[i]);
        if (!isfinite(error) || (size * record > ORDER_MOVED && error > 0.5 * size))
            return UNDETERMINED;
        if (pole_kind(f->lambda[i], j->m->opt.dt) == POLE_REAL && f->lambda[i] != 0
            && fabs(creal(f->lambda[i])) < 8 * f->std_re[i])
            return OFFSET;
    }
    if (chosen && f->least_drop < reach)  /* simplify() of order_improve.c would try without it */
        return ORDER_LESS;
    /* the constant might decay: one parameter more than it costs */
    if (f->most_free > MOVES * f->price)
        return OFFSET;
    if (chosen && f->most_split > ORDER_LOOK * f->pair_price)  /* order.c, pass 3 */
        return POLE_SPLITS;
    return GOOD;
}

/* ---- does a pole want to be two, by order.c's own question?  Asked of what is nearly rounding
 * only: in noise the ladder may find the two ---- */

static bool nearly_rounding(const struct job *j, const struct moving_fit *f)
{
    for (int g = 0; g < f->signals; g++)
        if (f->rss[g] > ROUNDING_NEAR * j->m->L * f->floor2[g])
            return false;
    return true;
}

/* BIC of LOOKED, which has a pair more, less that of F. */
static double bic_above(const struct job *j, const struct moving_fit *f,
                        const struct moving_fit *looked)
{
    double sum = f->pair_price;

    for (int g = 0; g < f->signals; g++) {
        double least = j->m->L * fmax(f->floor2[g], DBL_MIN);
        sum += f->energy[g] > 0
            ? j->m->L * log(fmax(looked->rss[g], least) / fmax(f->rss[g], least))
            : 0;
    }
    return sum;
}

/* Pole I as the two neighbours that order.c would begin with, into LAMBDA (room for one more);
 * false where order.c would not. */
static bool neighbours(const struct job *j, const struct moving_fit *f, int i,
                       double complex *lambda)
{
    double dt = j->m->opt.dt, apart = ORDER_SPLIT_HALF / (j->m->L * dt);

    memcpy(lambda, f->lambda, sizeof *lambda * (size_t)f->poles);
    lambda[i] = f->lambda[i] - I * apart, lambda[f->poles] = f->lambda[i] + I * apart;
    return cimag(f->lambda[i]) > 2 * apart && cimag(f->lambda[i]) < M_PI / dt - 2 * apart;
}

enum modal_status judge_split(struct job *j, const struct moving_fit *f, enum reason *why,
                              struct modal_error *err)
{
    struct moving_signals y = { j->X, j->outside2 };
    double complex *lambda;
    bool splits = !nearly_rounding(j, f) || moving_rows_count(&j->rows) < 2 * (f->order + 2) + j->r;
    enum modal_status rc = MODAL_OK;

    if (splits)
        return MODAL_OK;
    lambda = malloc(sizeof *lambda * (size_t)(f->poles + 1));
    if (lambda == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d poles", f->poles + 1);
    for (int i = 0; i < f->poles && rc == MODAL_OK && !splits; i++) {
        struct moving_fit looked = { 0 };
        if (!neighbours(j, f, i, lambda))
            continue;
        rc = moving_look(&j->rows, &y, lambda, f->poles + 1, &looked, err);
        splits =
            rc == MODAL_OK && (!looked.settled || bic_above(j, f, &looked) < 2 * ORDER_SPLIT_REACH);
        j->work += looked.work;
        moving_fit_done(&looked);
    }
    if (rc == MODAL_OK && !splits)
        *why = GOOD;
    free(lambda);
    return rc;
}

/* What a fit leaves: E, L x r, of the whole window; of the compressed blocks, blocks k x r. */
struct residual { double *E, *inside; int rows; };

static enum modal_status residual_of(struct job *j, const struct moving_fit *f,
                                     struct residual *left, struct modal_error *err)
{
    struct moving *m = j->m;
    struct moving_rows all = { .lead = m->L, .tau = m->opt.dt };
    int L = m->L, r = j->r, n = moving_rows_count(&j->rows);
    double *Phi = malloc(sizeof *Phi * ((size_t)L * (size_t)(f->order + 1)
                                        + moving_columns_scratch(&all)));
    enum modal_status rc = Phi == NULL
        ? modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", L, f->order)
        : MODAL_OK;

    left->rows = j->rows.blocks * j->rows.k;
    if (rc == MODAL_OK && left->rows > 0)
        rc = job_basis(j, f, err);
    if (rc == MODAL_OK) {
        moving_basis(&all, f->lambda, f->poles, Phi, Phi + (size_t)L * (size_t)(f->order + 1));
        memcpy(left->E, j->full.x, sizeof(double) * (size_t)L * (size_t)r);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, L, r, f->order, -1, Phi, L, f->C,
                    f->order, 1, left->E, L);
    }
    if (rc == MODAL_OK && left->rows > 0) {
        matrix_copy(left->rows, r, j->X.x + j->rows.lead, j->X.ld, left->inside, left->rows);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, left->rows, r, f->order, -1,
                    j->Phi + j->rows.lead, n, f->C, f->order, 1, left->inside, left->rows);
    }
    free(Phi);
    return rc;
}

/* m->x: |X_k|^2 of N samples of E, k = 0 .. N/2. */
static void spectrum_of(struct moving *m, const double *e, int n, fftw_plan plan)
{
    memcpy(m->x, e, sizeof *m->x * (size_t)n);
    fftw_execute(plan);
    for (int k = 0; k <= n / 2; k++) {
        double re = creal(m->X[k]), im = cimag(m->X[k]);
        m->x[k] = re * re + im * im;
    }
}

/* The line at each bin as a part of a sum of squares OWN, from |X_k|^2: in place. */
static void shares_of(double *x, int n, double own)
{
    double scale = 2 / (n * own);

    x[0] *= 0.5;                   /* the constant, and the highest frequency, have one number */
    if (n % 2 == 0)
        x[n / 2] *= 0.5;
    for (int k = 0; k <= n / 2; k++)
        x[k] *= scale;
}

/* Samples first .. first + n - 1 of E: the largest gain (2) of any frequency; or a BOUND of it by
 * -ln(1 - x) <= x / (1 - x), x at most the largest of all.  GAINS has room for n/2 + 1.  POWER (may
 * be NULL): the columns' spectra, each of unit norm, are added. */
static double largest_gain(const struct job *j, const struct moving_fit *f, const double *E,
                           int first, int n, fftw_plan plan, bool bound, double *gains,
                           double *power)
{
    struct moving *m = j->m;
    double most = 0, top = 0;

    memset(gains, 0, sizeof *gains * (size_t)(n / 2 + 1));
    for (int g = 0; g < j->r; g++) {
        const double *e = E + (size_t)g * (size_t)m->L + first;
        double norm2 = power != NULL ? cblas_ddot(n, e, 1, e, 1) : 0, own = f->rss[g];
        bool counts = own > m->L * f->floor2[g];
        if (!counts && !(norm2 > 0))
            continue;
        spectrum_of(m, e, n, plan);
        if (norm2 > 0)
            cblas_daxpy(n / 2 + 1, 1 / norm2, m->x, 1, power, 1);
        if (!counts)
            continue;
        shares_of(m->x, n, own);
        for (int k = 0; k <= n / 2; k++) {
            double share = m->x[k];
            top = share > top ? share : top;
            /* L ln(rss / (rss - |X_k|^2)): what a line at bin k would gain */
            gains[k] += bound ? share : -log1p(-fmin(share, 1 - DBL_EPSILON));
        }
    }
    for (int k = 0; k <= n / 2; k++)
        most = gains[k] > most ? gains[k] : most;
    return m->L * most * (bound ? 1 / fmax(1 - top, DBL_EPSILON) : 1);
}

static bool plans(struct moving *m)
{
    if (m->x == NULL)
        m->x = fftw_alloc_real((size_t)m->L), m->X = fftw_alloc_complex((size_t)m->L / 2 + 1);
    for (int i = 0, n = m->L; m->x != NULL && m->X != NULL && i < 3; i++, n /= 4)
        if (m->plan[i] == NULL && n >= PART_LEAST)
            m->plan[i] = fftw_plan_dft_r2c_1d(n, m->x, m->X, FFTW_ESTIMATE);
    return m->plan[0] != NULL;
}

/* ---- do the halves of the window contradict the whole?  parts.c, as far as its first look goes
 * ---- */

/* Signals at samples first .. first + count - 1 of the window, into rows ROW .. of X; their
 * residual's squares are taken off `rest2`. */
static void put_loose(const struct job *j, const double *E, int first, int count, struct matrix *X,
                      int row, double *rest2)
{
    size_t L = (size_t)j->m->L;

    for (int g = 0; g < j->r && count > 0; g++) {
        const double *e = E + first + (size_t)g * L;
        memcpy(X->x + row + (size_t)g * (size_t)X->ld, j->full.x + first + (size_t)g * L,
               sizeof *e * (size_t)count);
        rest2[g] -= cblas_ddot(count, e, 1, e, 1);
    }
}

/* Samples first .. first + count - 1 as rows of their own: blocks that lie within, the rest loose.
 * */
static struct moving_rows half_rows(const struct job *j, int first, int count, int *block)
{
    const struct moving_rows *r = &j->rows;
    struct moving_rows half = *r;
    int B = r->length > 0 ? r->length : 1,
        from = first > r->lead ? (first - r->lead + B - 1) / B : 0;
    int to = first + count > r->lead ? (first + count - r->lead) / B : 0;

    to = to < r->blocks ? to : r->blocks;
    *block = from;
    half.blocks = to > from ? to - from : 0;
    half.lead = half.blocks > 0 ? r->lead + from * B - first : count;
    half.trail = count - half.lead - half.blocks * B * (half.blocks > 0);
    return half;
}

/*
 * Signals of one half.  What Q holds of the residual is small beside what it does not, so that the
 * squares of the latter are those of the residual less those of its part in Q.
 */
static void half_signals(const struct job *j, const struct residual *left, int first,
                         const struct moving_rows *half, int block, struct matrix *X,
                         double *outside2)
{
    int L = j->m->L, k = half->k, n = moving_rows_count(half), count = moving_rows_samples(half),
        from = block * k, rows = half->blocks * k;

    for (int g = 0; g < j->r; g++) {
        const double *e = left->E + first + (size_t)g * (size_t)L;
        outside2[g] = cblas_ddot(count, e, 1, e, 1);
    }
    put_loose(j, left->E, first, half->lead, X, 0, outside2);
    put_loose(j, left->E, first + count - half->trail, half->trail, X, n - half->trail, outside2);
    for (int g = 0; g < j->r && rows > 0; g++) {
        const double *e = left->inside + from + (size_t)g * (size_t)left->rows;
        memcpy(X->x + half->lead + (size_t)g * (size_t)X->ld,
               j->X.x + j->rows.lead + from + (size_t)g * (size_t)j->X.ld,
               sizeof *e * (size_t)rows);
        /* Q is orthonormal in each block: squares of e = those in Q + those outside */
        outside2[g] -= cblas_ddot(rows, e, 1, e, 1);
    }
    for (int g = 0; g < j->r; g++)
        outside2[g] = fmax(outside2[g], 0);
}

static enum modal_status ask_half(struct job *j, const struct moving_fit *f,
                                  const struct residual *left, int first, int count,
                                  enum reason *why, struct modal_error *err)
{
    int block;
    struct moving_rows half = half_rows(j, first, count, &block);
    int n = moving_rows_count(&half);
    struct matrix X = matrix_new(n, j->r);
    double *outside2 = malloc(sizeof *outside2 * (size_t)j->r), parameters = f->parameters;
    struct moving_signals y = { X, outside2 };
    struct moving_fit own = { 0 };
    enum modal_status rc = MODAL_OK;

    if (X.x == NULL || outside2 == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", n, j->r);
    if (rc == MODAL_OK)
        half_signals(j, left, first, &half, block, &X, outside2);
    if (rc == MODAL_OK && n < 2 * f->order + j->r)
        *why = PARTS;               /* too few rows for a fit of their own */
    else if (rc == MODAL_OK)
        rc = moving_probe(&half, &y, f->lambda, f->poles, &own, err);
    j->work += own.work;
    if (rc == MODAL_OK && *why == GOOD
        && !(own.could_gain < parameters + PARTS_DEVIATIONS * sqrt(2 * parameters) + PARTS_SLACK))
        *why = PARTS;
    for (int i = 0; i < f->poles && rc == MODAL_OK && *why == GOOD; i++)
        if (creal(f->lambda[i]) > REFINE_CLEAR * own.std_re[i])
            j->growth[i] = GROWTH_IN_HALF;
    moving_fit_done(&own);
    free(X.x), free(outside2);
    return rc;
}

static enum modal_status ask_halves(struct job *j, const struct moving_fit *f,
                                    const struct residual *left, enum reason *why,
                                    struct modal_error *err)
{
    int L = j->m->L, rows = L / 2;
    enum modal_status rc = MODAL_OK;

    if (rows < 2 * f->order + PARTS_SPARE)
        return MODAL_OK;
    for (int i = 0; i < f->poles; i++)
        j->growth[i] = GROWTH_UNSEEN;
    for (int first = 0; first <= L - rows && rc == MODAL_OK && *why == GOOD; first += L - rows)
        rc = ask_half(j, f, left, first, rows, why, err);
    return rc;
}

/* The most that anything confined to COUNT samples from FIRST on could gain: a decay of few
 * samples, or a growth, has no line in a spectrum. */
static double gain_of_samples(const struct job *j, const struct moving_fit *f, const double *E,
                              int first, int count)
{
    double sum = 0;

    for (int g = 0; g < j->r; g++) {
        const double *e = E + first + (size_t)g * (size_t)j->m->L;
        if (f->rss[g] > j->m->L * f->floor2[g])
            /* white noise: -2 ln(likelihood) is L ln(rss), and less by this without the samples */
            sum -=
                j->m->L * log1p(-fmin(cblas_ddot(count, e, 1, e, 1) / f->rss[g], 1 - DBL_EPSILON));
    }
    return sum;
}

/* Would a pair anywhere gain what it costs, or what noise does not give?  GAINS has room for L/2 +
 * 1; POWER, as many zeros, becomes colour.h's spectrum. */
static bool wants_a_pair(const struct job *j, const struct moving_fit *f, const double *E,
                         double *gains, double *power)
{
    struct moving *m = j->m;
    /* what may not pay, but widens a batch's errors (widen.c, another) */
    double noise = criterion_noise_pair(j->r, 1, (double)m->L * j->r),
           limit = fmin(ORDER_LOOK * f->pair_price, noise);

    for (int count = 1; count <= EDGE_SAMPLES; count++)
        if (gain_of_samples(j, f, E, 0, count) > limit
            || gain_of_samples(j, f, E, m->L - count, count) > limit)
            return true;
    for (int i = 0, n = m->L; i < 3 && n >= PART_LEAST; i++, n /= 4)
        for (int first = 0; first <= m->L - n; first += i > 0 ? m->L - n : 1)
            if (largest_gain(j, f, E, first, n, m->plan[i], true, gains, i == 0 ? power : NULL)
                    > limit
                && largest_gain(j, f, E, first, n, m->plan[i], false, gains, NULL) > limit)
                return true;
    return false;
}

/* Numbers for a residual, gains, a spectrum, angles and factors. */
static bool room_for(const struct job *j, const struct moving_fit *f, struct residual *left,
                     double **gains, double **power, double **theta)
{
    size_t L = (size_t)j->m->L, size = L * (size_t)j->r,
           inside = (size_t)(j->rows.blocks * j->rows.k) * (size_t)j->r;
    double *x = malloc(sizeof *x * (size + inside + 2 * (L / 2 + 1) + 2 * (size_t)f->poles));

    if (x == NULL)
        return false;
    left->E = x, left->inside = x + size;
    *gains = left->inside + inside, *power = *gains + L / 2 + 1, *theta = *power + L / 2 + 1;
    memset(*power, 0, sizeof **power * (L / 2 + 1));
    return true;
}

enum modal_status judge_residual(struct job *j, struct moving_fit *f, enum reason *why,
                                 struct modal_error *err)
{
    struct moving *m = j->m;
    struct residual left = { 0 };
    double *gains, *power, *theta;
    enum modal_status rc;

    if (j->exact && nearly_rounding(j, f))
        return MODAL_OK;
    if (!room_for(j, f, &left, &gains, &power, &theta) || !plans(m)) {
        free(left.E);
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", m->L, j->r);
    }
    rc = residual_of(j, f, &left, err);
    if (rc == MODAL_OK && !j->exact && !colour_white(&(struct matrix) { m->L, j->r, m->L, left.E }))
        *why = NOT_WHITE;
    if (rc == MODAL_OK && *why == GOOD && wants_a_pair(j, f, left.E, gains, power))
        *why = ORDER_MORE;
    if (rc != MODAL_OK || j->exact || *why != GOOD)
        goto out;
    for (int i = 0; i < f->poles; i++)
        theta[i] = fabs(cimag(f->lambda[i])) * m->opt.dt;
    colour_factors_of(power, m->L, theta, f->poles, theta + f->poles);
    for (int i = 0; i < f->poles; i++)
        if (theta[f->poles + i] > 1)
            *why = NOT_WHITE;
    if (*why == GOOD)
        rc = ask_halves(j, f, &left, why, err);
out:
    free(left.E);
    return rc;
}
