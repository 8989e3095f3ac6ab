/*
 * iterate.c - direct iteration and Newton's method on one balance
 *
 * Direct iteration [CG89] (7), X <- S^-1 (p - F(X)), multiplies an error by at most max |dF/dX|
 * |S_k^-1|; with under-relaxation r the factor of an eigenvalue -g of the map's derivative is 1 - r
 * (1 + g).
 *
 * Newton: J dX = -R.  A step lambda dX is taken if the simplified step J^-1 R(X + lambda dX), with
 * the same J, is shorter than (1 - lambda / 4) |dX|: a test that no scaling of R changes [D04,
 * section 3.2].  The derivative of piecewise laws jumps where a regime appears, so that full steps
 * may cycle; damping breaks the cycle.
 *
 * With u the real vector of X and |.| the relative size of balance_relative,
 *
 *     J(u) d = -R(u),                                                                           (1)
 *     J(u) d' = -R(u + lambda d),      |d'| <= (1 - lambda / 4) |d|,                            (2)
 *     d' = (1 - lambda) d + e,         J(u) e = (1 - lambda) R(u) - R(u + lambda d):            (3)
 *
 * an iterative solution needs no more digits of e, which curvature makes, for a short step than for
 * a long one.
 *
 * Near the solution, where |d| is below CLOSE and shrinks, (2) is not asked for.  With a rate r =
 * |d| / |d_before| < 1 the distance left after a step is at most r / (1 - r) |d|, if the rate
 * holds: a loose tolerance is compared with that.  Of a matrix of few harmonics (balance.h) (1)
 * holds for those alone and the rest move by (7); it converges linearly, at the rate of their gain.
 *
 * Whole steps with |d_k+1| <= w / 2 |d_k|^2, w a bound over a ball about the start, stay within it,
 * and what they lead to is the only solution there, if
 *
 *     h_0 = w |d_0| < 2                                                                         (4)
 *
 * [D04, theorem 2.2]: it moves continuously with all that h_0 grows with.  w here is the largest
 * that steps down to CLOSE show, of the iterates alone and in a norm that changes with them: a
 * sign, which random scenes of smooth laws bear out (ways.c), and no proof.
 *
 * Where J is singular it is stiffened, J + mu max|J| I, which leaves the solution where it is and
 * only delays it.
 *
 * [CG89] Cameron and Griffin, J. Appl. Mech. 56 (1989) 149-154.
 * [D04]  Deuflhard, Newton Methods for Nonlinear Problems, Springer 2004.
 */
#include "modal/steady/iterate.h"
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/numbers.h"
#include "modal/scene/program.h"
#include "modal/steady/aft.h"
#include "modal/steady/balance.h"
#include "modal/steady/blocks.h"
#include "modal/steady/budget.h"
#include "modal/steady/pattern.h"
#include "modal/steady/stiffness.h"

/* The relative step that ends an iteration where the options name none. */
static const double TOLERANCE = 1e-12;
/* Below this a step that no longer shrinks is rounding: that of a J of condition 1e7. */
static const double FLOOR = 1e-9;
/* A loose tolerance is met by the step after this one if they shrink at least this fast. */
static const double SHRINKS = 0.25;
/* Rates above which steps of rounding's size have stopped to shrink: of a whole matrix, which
 * converges quadratically until then; and of a short one, which converges linearly. */
static const double STALLS = 0.25;
static const double STALLS_SHORT = 0.9;
/* The relative residual of a motion that balances to rounding, though steps may be long: something
 * is held by nothing. */
static const double BALANCED = 1e-13;
/* Steps below this of the largest dof are rounding, soft dofs beside stiff ones; and below the
 * residual that rounding leaves of stiff laws: what slips is held by the structure alone, which the
 * forces deform by the motion itself. */
static const double SMALL = 1e-9;
/* A residual above this that the last step did not reduce by a tenth is of a singular J. */
static const double UNBALANCED = 1e-6;
static const double REDUCED = 0.9;
/* Steps shorter than this share of the motion are taken whole while they shrink: the radius of
 * Newton's convergence is of the order of the motion's own scale. */
static const double CLOSE = 0.02;
/* Of many dofs those that move less than this share of the largest do not shorten a step: they
 * follow the others, and their laws change none of these. */
static const double FAINT = 1e-3;
/* The shortest damped step.  Three digits below a whole one, the direction is of no use. */
static const double LAMBDA_LEAST = 1e-4;
/* A damped step is first halved, then cut further: most need one halving or many. */
static const double DAMP_FIRST = 0.5;
static const double DAMP = 0.35;
/* Direct iteration runs away when steps are a million times the least; it is given up after
 * DIRECT_PATIENCE iterations when they are as long as the motion and never were short. */
static const double RUNS_AWAY = 1e6;
static const double LONG_STEP = 0.5;
static const double SHORT_STEP = 0.1;
/* Damped steps after which their pace is looked at: one bad step among a few is no pace. */
static const int PACE_STEPS = 8;
/* What may be left of e in (3): where (2) is near, e is of lambda |d|, and this an eighth of the
 * margin. */
static const double FORCING_TRIAL = 1.0 / 32;
/* A singular J is stiffened by this share of its largest entry, then by a thousand times more:
 * past 1 nothing of it is left. */
static const double STIFFEN = 1e-6;
static const double STIFFEN_MORE = 1e3;
/* Harmonics with a gain below this are left to (7): each iteration then leaves a tenth of them. */
static const double TAIL_GAIN = 0.1;
/* A short matrix is used again while steps shrink at least this fast. */
static const double RATE_SHORT = 0.3;
/* Rounding's share of the laws' forces at which a motion that converged has run away. */
static const double LOST = 1e-3;
enum {
    ITERATIONS_MOST = 60,   /* a rate of 0.63 comes to 1e-12 */
    /* a rate of 0.9 would have made a step of 1 shorter than SHORT_STEP in half */
    DIRECT_PATIENCE = 40,
    ORDER_TAIL = 21,       /* of matrices below it a factorization costs less than finding HJ */
    TAIL_LEAST = 4,        /* harmonics that are never left to (7) */
    GAIN_DOFS_MOST = 4     /* dofs that iterate_gain decomposes */
};
#define AWAY_REASON \
    "the motion runs away: it is so large that the laws' forces are lost in its rounding"

/* Whether the caller wants no answer any more. */
static bool stopped(const struct iterate_options *opt)
{
    return opt->cancelled != NULL && opt->cancelled(opt->context);
}

/* A step's length against each dof's own motion, or FAINT of the largest; HUGE_VAL where there is
 * no number. */
static double norm_above(const struct balance *b, double faint, const double *step,
                         const double complex *X)
{
    double r = balance_relative(b, faint, step, X);

    return isnan(r) ? HUGE_VAL : r;
}

/* The same against its own motion, however faint. */
static double norm_relative(const struct balance *b, const double *step, const double complex *X)
{
    return norm_above(b, 0, step, X);
}

/* The step against the largest of all dofs: where some are 0 by symmetry, rounding is all they
 * have. */
static double overall_step(const struct balance *b, const double *step, const double complex *X)
{
    double scale = numbers_modulus(X, (size_t)b->q * ((size_t)b->H + 1));

    return scale > 0 ? numbers_largest(step, (size_t)b->order) / scale : HUGE_VAL;
}

/* *OK false: some S_k is singular. */
static void direct_step(struct balance *b, double relaxation, double complex *X,
                        double complex *rhs, double *step, bool *ok)
{
    int q = b->q, K = b->H + 1, n = 2 * b->H + 1;

    for (int k = 0; k < K; k++) {
        for (int i = 0; i < q; i++)
            rhs[i] = b->load[k * q + i] - b->F[i * K + k];  /* p_k - F_k(X) of (7) */
        if (!(*ok = stiffness_solve(b->stiffness, k, rhs)))
            return;
        for (int i = 0; i < q; i++) {
            /* r of the opening comment */
            double complex change = relaxation * (rhs[i] - X[i * K + k]);

            X[i * K + k] += change;
            step[i * n + (k > 0 ? 2 * k - 1 : 0)] = creal(change);
            if (k > 0)
                step[i * n + 2 * k] = cimag(change);
        }
    }
}

struct direct_work {
    double complex *rhs, *best;       /* q; the X of the least step */
    double *step;
    struct workspace space;           /* of the arrays */
};

/* Room for direct iteration on B, of w->space. */
static enum modal_status direct_init(struct direct_work *w, const struct balance *b,
                                     struct modal_error *err)
{
    size_t q = (size_t)b->q, K = (size_t)b->H + 1;

    *w = (struct direct_work) { 0 };
    w->rhs = workspace_zeros(&w->space, q + 1, sizeof *w->rhs);
    w->best = workspace_zeros(&w->space, q * K + 1, sizeof *w->best);
    w->step = workspace_zeros(&w->space, (size_t)b->order, sizeof *w->step);
    return workspace_check(&w->space, "direct iteration: no memory", err);
}

/* (7) until it settles, runs away or has gone on for long; X is the best iterate. */
static enum modal_status repeat_direct(struct balance *b, const struct iterate_options *opt,
                                       struct direct_work *w, double complex *X,
                                       struct iterate_report *report, struct modal_error *err)
{
    size_t size = (size_t)b->q * ((size_t)b->H + 1) * sizeof *X;
    double tolerance = opt->tolerance > 0 ? opt->tolerance : TOLERANCE, least = HUGE_VAL;
    int most = opt->most > 0 ? opt->most : ITERATIONS_MOST;
    bool ok = true;
    enum modal_status rc = MODAL_OK;

    memcpy(w->best, X, size);
    for (int i = 0; rc == MODAL_OK && i < most && !report->converged; i++) {
        rc = stopped(opt) ? modal_fail(err, MODAL_CANCELLED, "cancelled")
                          : balance_residual(b, X, false, err);
        if (rc != MODAL_OK || budget_spent(b->budget))
            break;
        direct_step(b, opt->relaxation > 0 ? opt->relaxation : 1, X, w->rhs, w->step, &ok);
        if (!ok) {
            report->reason =
                "the linear part is singular at a harmonic, so direct iteration does not apply";
            break;
        }
        report->iterations++;
        report->step = norm_relative(b, w->step, X);
        report->converged = report->step <= tolerance;  /* relative to each dof */
        if (report->step < least) {
            least = report->step;
            memcpy(w->best, X, size);
        } else if (report->step > RUNS_AWAY * least
                   || (i > DIRECT_PATIENCE && report->step > LONG_STEP && least > SHORT_STEP))
            break;
    }
    if (!report->converged)
        memcpy(X, w->best, size);
    return rc == MODAL_OVERFLOW ? MODAL_OK : rc;
}

enum modal_status iterate_direct(struct balance *b, const struct iterate_options *opt,
                                 double complex *X, struct iterate_report *report,
                                 struct modal_error *err)
{
    struct direct_work w;
    enum modal_status rc = direct_init(&w, b, err);

    *report = (struct iterate_report) { .reason = "direct iteration did not settle",
                                        .residual = HUGE_VAL };
    if (rc == MODAL_OK)
        rc = repeat_direct(b, opt, &w, X, report, err);
    if (rc == MODAL_OK && (rc = balance_residual(b, X, false, err)) == MODAL_OK)
        report->residual = balance_relative_residual(b, X);
    workspace_free(&w.space);
    return rc;
}

double iterate_gain(const struct balance *b, double slope)
{
    int q = b->q;
    double most = 0;

    for (int k = 0; k <= b->H; k++) {
        double complex A[GAIN_DOFS_MOST * GAIN_DOFS_MOST];
        double s[GAIN_DOFS_MOST], superb[GAIN_DOFS_MOST];

        if (q > GAIN_DOFS_MOST)
            return HUGE_VAL;
        memcpy(A, b->S + (size_t)k * (size_t)q * (size_t)q, (size_t)q * (size_t)q * sizeof *A);
        if (q == 1)
            s[0] = cabs(A[0]);
        else if (LAPACKE_zgesvd(LAPACK_COL_MAJOR, 'N', 'N', q, q, A, q, s, NULL, 1, NULL, 1, superb)
                 != 0)
            return HUGE_VAL;
        /* |S_k^-1| is one over the least singular value */
        most = fmax(most, s[q - 1] > 0 ? slope / s[q - 1] : HUGE_VAL);
    }
    return most;
}

/* J by central differences of R, column by column; h relative to the dof's largest harmonic. */
static enum modal_status difference_derivative(struct balance *b, double complex *X,
                                               double *scratch, struct modal_error *err)
{
    int n = 2 * b->H + 1, K = b->H + 1;
    double *R0 = scratch, *up = scratch + b->order;
    enum modal_status rc = balance_residual(b, X, false, err);
    double *J = rc == MODAL_OK ? malloc((size_t)b->order * (size_t)b->order * sizeof *J) : NULL;

    if (rc != MODAL_OK)
        return rc;
    if (J == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "newton: no memory for %d unknowns", b->order);
    memcpy(R0, b->R, (size_t)b->order * sizeof *R0);
    /* One column an unknown, two residuals each: the price of 1989. */
    for (int c = 0; rc == MODAL_OK && c < b->order; c++) {
        int i = c / n, r = c % n, k = (r + 1) / 2;    /* dof, real entry and harmonic of column c */
        double complex kept = X[i * K + k], unit = r > 0 && r % 2 == 0 ? I : 1;
        double scale = 0, h;

        for (int l = 0; l < K; l++)
            scale = fmax(scale, cabs(X[i * K + l]));
        /* rounding over h and curvature h^2 are equal there */
        h = cbrt(DBL_EPSILON) * (scale > 0 ? scale : 1);
        X[i * K + k] = kept + h * unit;                 /* Re X_k or Im X_k */
        rc = balance_residual(b, X, false, err);
        memcpy(up, b->R, (size_t)b->order * sizeof *up);
        X[i * K + k] = kept - h * unit;
        if (rc == MODAL_OK)
            rc = balance_residual(b, X, false, err);
        X[i * K + k] = kept;
        for (int e = 0; rc == MODAL_OK && e < b->order; e++)
            J[(size_t)c * (size_t)b->order + (size_t)e] = (up[e] - b->R[e]) / (2 * h);
    }
    if (rc == MODAL_OK) {
        rc = balance_residual(b, X, true, err);            /* for its room */
        memcpy(b->J, J, (size_t)b->order * (size_t)b->order * sizeof *J);
        b->factored = false;
    }
    free(J);
    return rc;
}

/* Rows of insignificant harmonics of dof i, `cut` of them: only their own S_kk is kept. */
static void cut_rows(struct balance *b, int i, int j, double complex S[], const bool *cut)
{
    int n = 2 * b->H + 1;

    for (int c = 0; c < n; c++) {
        double *column = balance_column(b, i, j, c);
        int k = (c + 1) / 2;

        for (int r = 1; r < n; r++) {
            bool row_real = r % 2 == 1, column_real = c % 2 == 1, there = (r + 1) / 2 == k;

            /* other columns of the row are the laws' */
            if (cut[r] && (there || b->pattern->mixes[pattern_find(b->pattern, i, j)]))
                column[r] = !there ? 0 : row_real == column_real ? creal(S[k])
                          : row_real ? -cimag(S[k]) : cimag(S[k]);
        }
    }
}

/* Insignificant harmonics move by (7). */
static void cut_off(struct balance *b, double cutoff, const double complex *X, bool *cut,
                    double complex *S)
{
    int n = 2 * b->H + 1, K = b->H + 1, entries = pattern_entries(b->pattern);

    for (int i = 0; i < b->q; i++) {
        double most = 0;

        for (int k = 0; k < K; k++)
            most = fmax(most, cabs(X[i * K + k]));
        for (int r = 1; r < n; r++)
            /* the mean is never cut */
            cut[i * n + r] = cabs(X[i * K + (r + 1) / 2]) < cutoff * most;
    }
    for (int j = 0; j < b->q; j++)
        for (int e = b->pattern->start[j]; e < b->pattern->start[j + 1]; e++) {
            int i = b->pattern->index[e];

            for (int k = 0; k < K; k++)
                S[k] = b->S[(size_t)k * (size_t)entries + (size_t)e];
            cut_rows(b, i, j, S, cut + i * n);
        }
}

/* A singular derivative gets a little stiffness, which only delays convergence; SOFT: it is one,
 * though not to rounding. */
static bool factor_somehow(struct balance *b, double *kept, bool soft)
{
    size_t size = (size_t)b->small * (size_t)b->small;
    bool full = b->pattern->full;

    if (full)
        memcpy(kept, b->J, size * sizeof *kept);
    if (balance_factor(b, NULL) && !soft)
        return true;
    for (double mu = STIFFEN; mu < 2; mu *= STIFFEN_MORE) {
        double most = full ? numbers_largest(kept, size) : 0;

        if (full && (!isfinite(most) || most == 0))
            return false;
        if (full)
            memcpy(b->J, kept, size * sizeof *kept);
        for (int i = 0; full && i < b->small; i++)
            b->J[(size_t)i * ((size_t)b->small + 1)] += mu * most;
        if (full ? balance_factor(b, NULL) : balance_factor_stiffened(b, mu))
            return true;
    }
    return false;
}

struct newton_work {
    double *step, *trial_step, *u, *R, *kept, *scratch;
    double complex *trial;
    bool *cut;
    double logs;                      /* of damped steps, as many: see arrives() */
    int damped;
    struct workspace space;           /* of the arrays */
};

/* X <- u + lambda step. */
static void point_at(const struct balance *b, const double *u, double lambda, const double *step,
                 double *scratch, double complex *X)
{
    for (int i = 0; i < b->order; i++)
        scratch[i] = u[i] + lambda * step[i];
    balance_unpack(b, scratch, X);
}

/* The damped step from u along w->step; X is the accepted point.  False: none was. */
static enum modal_status damp(struct balance *b, struct newton_work *w, double complex *X,
                              double *taken, bool *ok, struct modal_error *err)
{
    double faint = b->pattern->full ? 0 : FAINT, size = norm_above(b, faint, w->step, X),
           forcing = b->forcing;
    enum modal_status rc;

    *ok = false;
    memcpy(w->R, b->R, (size_t)b->order * sizeof *w->R);
    for (double lambda = 1; lambda >= LAMBDA_LEAST; lambda *= lambda == 1 ? DAMP_FIRST : DAMP) {
        double next;

        point_at(b, w->u, lambda, w->step, w->scratch, w->trial);
        rc = balance_residual(b, w->trial, false, err);
        if (rc == MODAL_OVERFLOW)
            continue;
        if (rc != MODAL_OK)
            return rc;
        for (int i = 0; i < b->order; i++)
            w->trial_step[i] = (1 - lambda) * w->R[i] - b->R[i];
        b->forcing = FORCING_TRIAL;
        balance_solve(b, w->trial_step);                /* (3) */
        b->forcing = forcing;
        for (int i = 0; i < b->order; i++)
            w->trial_step[i] += (1 - lambda) * w->step[i];
        next = norm_above(b, faint, w->trial_step, X);  /* of the simplified step, the same J */
        if (next <= (1 - lambda / 4) * size || next < FLOOR) {
            *ok = true;
            *taken = lambda;
            memcpy(X, w->trial, (size_t)b->q * ((size_t)b->H + 1) * sizeof *X);
            return MODAL_OK;
        }
    }
    return MODAL_OK;
}

int iterate_order(const struct balance *b, double slope)
{
    int HJ = b->H;

    slope = slope > 0 ? slope : aft_slope(b->aft);
    slope *= b->q > 1 ? b->pattern->ends : 1;           /* laws that meet at a dof add up */
    while (HJ > TAIL_LEAST && stiffness_least(b->pattern, b->S, HJ) * TAIL_GAIN > slope)
        HJ--;                                         /* S_k grows as k^2 past the last resonance */
    return b->p->harmonics == 0 && HJ < 2 * b->H / 3 ? HJ : b->H;
}

/* The harmonics of the matrix of Newton's method. */
static int matrix_order(const struct balance *b, const struct iterate_options *opt)
{
    bool whole = b->order < ORDER_TAIL || opt->by_differences || opt->cutoff > 0
                 || balance_on_inputs(b);

    return whole ? b->H : iterate_order(b, opt->slope);
}

/* The relative residual that rounding leaves at X: a displacement is a sum of 2H + 1 terms, each of
 * which stiff laws make a force of. */
static double rounded(const struct balance *b, const double complex *X)
{
    return fmax(BALANCED, (2 * b->H + 1) * balance_lost(b, X));
}

/* Whether the step just computed is the last: below the tolerance, or of rounding's size and no
 * longer shrinking. */
static bool settled(const struct balance *b, const struct newton_work *w, const double complex *X,
                    double tolerance, double last, double lambda, struct iterate_report *report)
{
    /* a short matrix converges linearly */
    double rate = report->step / last, stalls = b->HJ < b->H ? STALLS_SHORT : STALLS;

    if (!(report->step <= tolerance || (report->step < FLOOR && rate > stalls && lambda == 1)
          /* a loose one: the next step will be */
          || (tolerance > FLOOR && last < HUGE_VAL && rate < SHRINKS && lambda == 1
              && report->step * rate / (1 - rate) <= tolerance / 2))) {
        double overall = overall_step(b, w->step, X);

        /* rounding of the large ones is all that moves the small */
        if (!(rate > stalls && report->residual <= rounded(b, X)
              && overall <= fmax(SMALL, rounded(b, X))))
            return false;
        report->step = overall;
    }
    report->step *= last < HUGE_VAL ? fmin(1, rate) : 1;  /* the next step, which is not taken */
    report->converged = true;
    return true;
}

/* The residual at the answer: a small step of a singular derivative leaves it where it was. */
static enum modal_status verify(struct balance *b, const double complex *X,
                                struct iterate_report *report, struct modal_error *err)
{
    double before = report->residual;
    enum modal_status rc = balance_residual(b, X, false, err);

    if (rc != MODAL_OK)
        return rc;
    report->residual = balance_relative_residual(b, X);
    if (report->residual > UNBALANCED && report->residual > REDUCED * before) {
        report->converged = false;
        report->reason = "the derivative is singular";
    }
    return MODAL_OK;
}

/* Whether what converged is an answer; DOUBTED: its residual is looked at, too. */
static enum modal_status conclude(struct balance *b, bool doubted, const double complex *X,
                                  struct iterate_report *report, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (report->converged && doubted && !report->open)
        rc = verify(b, X, report, err);
    if (rc == MODAL_OK && report->converged && balance_lost(b, X) > LOST) {
        report->converged = false;
        report->reason = AWAY_REASON;
    }
    return rc;
}

/* Room for Newton's method on B, of w->space. */
static enum modal_status work_init(struct newton_work *w, const struct balance *b,
                                   struct modal_error *err)
{
    size_t n = (size_t)b->order, small = b->pattern->full ? (size_t)b->small * (size_t)b->small : 0;

    *w = (struct newton_work){ 0 };
    w->step = workspace_zeros(&w->space, n, sizeof *w->step);
    w->trial_step = workspace_zeros(&w->space, n, sizeof *w->trial_step);
    w->u = workspace_zeros(&w->space, n, sizeof *w->u);
    w->R = workspace_zeros(&w->space, n, sizeof *w->R);
    w->kept = workspace_zeros(&w->space, small, sizeof *w->kept);
    w->scratch = workspace_zeros(&w->space, 2 * n, sizeof *w->scratch);
    w->trial = workspace_zeros(&w->space, (size_t)b->q * ((size_t)b->H + 1), sizeof *w->trial);
    w->cut = workspace_zeros(&w->space, n, sizeof *w->cut);
    if (w->space.failed)
        return modal_fail(err, MODAL_NO_MEMORY, "newton: no memory for %d unknowns", b->order);
    return MODAL_OK;
}

/* at X, from before: nothing; the residual; a derivative near enough */
enum known { NOTHING, FORCE, SLOPE };

/* Residual and derivative at X, as far as they are not KNOWN. */
static enum modal_status evaluate(struct balance *b, const struct iterate_options *opt,
                                  enum known known, double complex *X, struct newton_work *w,
                                  struct modal_error *err)
{
    if (opt->by_differences)
        return difference_derivative(b, X, w->scratch, err);
    return known == FORCE ? balance_derivative(b, err)
                          : balance_residual(b, X, known == NOTHING, err);
}

/* The next step into w->step and the point it leads to into w->trial.  *OK false: there is none,
 * and the report says why. */
static enum modal_status propose(struct balance *b, const struct iterate_options *opt,
                                 enum known known, double complex *X, struct newton_work *w,
                                 bool soft, struct iterate_report *report, bool *ok,
                                 struct modal_error *err)
{
    enum modal_status rc = evaluate(b, opt, known, X, w, err);

    *ok = false;
    if (rc != MODAL_OK)
        return rc;
    report->residual = balance_relative_residual(b, X);
    if (opt->cutoff > 0)
        cut_off(b, opt->cutoff, X, w->cut, w->trial);
    if (known != SLOPE && !factor_somehow(b, w->kept, soft)) {
        report->reason = "the derivative is singular";
        return MODAL_OK;
    }
    for (int i = 0; i < b->order; i++)
        w->step[i] = -b->R[i];
    balance_solve(b, w->step);                          /* J dX = -R */
    balance_pack(b, X, w->u);
    point_at(b, w->u, 1, w->step, w->scratch, w->trial);
    report->iterations++;
    report->step = fmin(norm_relative(b, w->step, X), norm_relative(b, w->step, w->trial));
    *ok = true;
    return MODAL_OK;
}

/* Whether the next step can do with this derivative: a short matrix converges linearly anyhow; a
 * whole one is off by twice the rate at the next point, which is enough if that is the last. */
static bool reusable(const struct balance *b, const struct iterate_options *opt, double tolerance,
                     double step, double last)
{
    double rate = step / last;

    if (opt->by_differences || opt->cutoff > 0 || !(step < CLOSE))
        return false;
    return b->HJ < b->H ? rate < RATE_SHORT || last == HUGE_VAL : 2 * rate * step <= tolerance;
}

/* No step was taken.  Steps of rounding, soft beside stiff, are an answer. */
static void give_up(const struct balance *b, const struct newton_work *w, const double complex *X,
                    struct iterate_report *report)
{
    double overall = overall_step(b, w->step, X);

    /* A residual of rounding: steps that nothing shortens are along what nothing holds. */
    report->open = balance_open(b) && report->residual <= BALANCED;
    report->converged = report->open || (report->residual <= rounded(b, X)
                                        && overall <= fmax(SMALL, rounded(b, X)));
    report->step = report->open ? report->residual : report->converged ? overall : report->step;
    report->reason = "no step of Newton's method shortens the next";
}

/* Whether the budget pays for another step; else that is the reason. */
static bool has_work_left(const struct balance *b, struct iterate_report *report)
{
    if (budget_spent(b->budget))
        report->reason = BUDGET_REASON;
    return !budget_spent(b->budget);
}

/* From nothing, the linear answer, whole; near the solution steps shrink by themselves. */
static bool goes_whole(const struct balance *b, const struct iterate_report *report, double last)
{
    return report->iterations == 1
        || (report->step < CLOSE && report->step < (b->HJ < b->H ? 1 : 0.5) * last);
}

/*
 * Whether Newton's method, a step of LAMBDA taken, comes to CLOSE within the MOST iterations: with
 * the pace of (2), w->logs the sum of -log(1 - lambda / 4) over w->damped steps, as many are due as
 *
 *     log(|d| / CLOSE) damped / logs.
 *
 * A full matrix is small, and waits.
 */
static bool arrives(const struct balance *b, struct newton_work *w, double lambda, int most,
                    struct iterate_report *report)
{
    w->logs -= log1p(-lambda / 4);
    if (b->pattern->full || ++w->damped < PACE_STEPS
        || report->iterations + log(report->step / CLOSE) * w->damped / w->logs <= most)
        return true;
    report->reason = "Newton's method would need too many steps";
    return false;
}

/* An overflow ends the iteration, not the job. */
static enum modal_status pardon(enum modal_status rc, struct iterate_report *report)
{
    if (rc != MODAL_OVERFLOW)
        return rc;
    report->reason = "the iterates overflow";
    return MODAL_OK;
}

/* (4): what the step just computed shows, after one of LAST that was taken to LAMBDA. */
static void see_bend(struct iterate_report *report, double first, double last, double lambda)
{
    if (report->iterations > 1 && last >= CLOSE)
        report->bend = fmax(report->bend, lambda < 1 ? HUGE_VAL
                                          : 2 * report->step / (last * last) * first);
}

/* Newton's method with the matrix of harmonics 0 .. HJ that B has now, (1) and (2). */
static enum modal_status newton(struct balance *b, const struct iterate_options *opt,
                                double complex *X, struct iterate_report *report,
                                struct modal_error *err)
{
    size_t size = (size_t)b->q * ((size_t)b->H + 1) * sizeof *X;
    double tolerance = opt->tolerance > 0 ? opt->tolerance : TOLERANCE, last = HUGE_VAL, lambda = 1,
           residual = 0, first = 0;
    int most = opt->most > 0 ? opt->most : ITERATIONS_MOST;
    struct newton_work w;
    enum modal_status rc = work_init(&w, b, err);
    enum known known = opt->evaluated ? FORCE : NOTHING;
    bool ok = true, shrinks = false;     /* the residual, as a loose tolerance leaves it */
    bool soft = false;                   /* some direction was found that nothing holds */

    *report = (struct iterate_report) { .reason = "Newton's method did not settle",
                                        .residual = HUGE_VAL };
    while (rc == MODAL_OK && report->iterations < most && has_work_left(b, report)) {
        rc = stopped(opt) ? modal_fail(err, MODAL_CANCELLED, "cancelled")
            : propose(b, opt, known, X, &w, soft, report, &ok, err);
        if (rc != MODAL_OK || !ok)
            break;
        first = report->iterations == 1 ? report->step : first;
        see_bend(report, first, last, lambda);
        /* A residual that a loose tolerance leaves is not looked at while it shrinks. */
        shrinks = report->iterations > 1 && tolerance > FLOOR && report->residual < 0.5 * residual;
        residual = report->residual;
        /* The step itself leads to w.trial. */
        if (settled(b, &w, X, tolerance, last, lambda, report)) {
            memcpy(X, w.trial, size);
            break;
        }
        if (goes_whole(b, report, last)) {
            known = reusable(b, opt, tolerance, report->step, last) ? SLOPE : NOTHING;
            last = report->step;
            memcpy(X, w.trial, size);
            continue;
        }
        last = report->step;
        if (known == SLOPE) {                              /* an old slope was not good enough */
            known = FORCE;                              /* its derivative is made at this point */
            continue;
        }
        /* Far from the solution: the whole step need not shorten the next. */
        rc = damp(b, &w, X, &lambda, &ok, err);
        known = FORCE;
        if (rc == MODAL_OK && !ok && balance_open(b) && !soft && report->residual > BALANCED) {
            soft = true;                               /* once: then J is stiffened at every step */
            known = NOTHING;
            continue;
        }
        if (rc == MODAL_OK && !ok)
            give_up(b, &w, X, report);
        if (rc == MODAL_OK && (!ok || !arrives(b, &w, lambda, most, report)))
            break;
    }
    if (rc == MODAL_OK)
        rc = conclude(b, !opt->rough && !shrinks, X, report, err);
    workspace_free(&w.space);
    return pardon(rc, report);
}

enum modal_status iterate_newton(struct balance *b, const struct iterate_options *opt,
                                 double complex *X, struct iterate_report *report,
                                 struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    int HJ;

    b->whole = opt->cutoff > 0;
    /* A slope to choose HJ by: of the options, or of the force at the start. */
    rc = b->order < ORDER_TAIL || opt->slope > 0 || opt->evaluated
             ? MODAL_OK
             : balance_residual(b, X, false, err);
    if (rc == MODAL_OVERFLOW)
        rc = MODAL_OK;
    HJ = rc == MODAL_OK ? matrix_order(b, opt) : b->H;
    if (rc == MODAL_OK && HJ < b->H) {
        size_t size = (size_t)b->q * ((size_t)b->H + 1);
        double complex *start = malloc((size + 1) * sizeof *start);

        if (start == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "newton: no memory");
        memcpy(start, X, size * sizeof *start);
        balance_set_order(b, HJ);                       /* rows past HJ by (7) */
        rc = newton(b, opt, X, report, err);
        balance_set_order(b, b->H);
        if (rc != MODAL_OK || report->converged) {
            free(start);
            return rc;
        }
        memcpy(X, start, size * sizeof *start);     /* with the whole matrix, from where it began */
        free(start);
    }
    return rc == MODAL_OK ? newton(b, opt, X, report, err) : rc;
}
