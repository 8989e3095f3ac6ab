/*
 * path.c - pseudo-arc-length continuation of a balance
 *
 * With v = u / size and mu = lambda / span, each step predicts along the unit tangent t = (t_v,
 * t_mu) and corrects on the plane through the prediction normal to t, by Newton's method on
 *
 *     [ size J   span R_lambda ] [dv ]     [ R ]
 *     [ t_v^T    t_mu          ] [dmu] = - [ n ],                                               (1)
 *
 * n the distance from the plane.  (1) is regular at folds; its matrix with right-hand side e_last
 * gives the next tangent.  The step grows by 1.4 after quick corrections and halves after a failure
 * or a bend of more than BEND.
 *
 * Between two points where t_mu changes sign there is a fold: the distance along the first tangent
 * is found by regula falsi (Illinois) on t_mu.  lambda is stationary there, so that its error is of
 * the second order in the distance's.  Where the determinant of (1) changes sign without a fold,
 * two branches cross.
 *
 * With distances a < b where t_mu is f_a and f_b, of different signs, the next is
 *
 *     s = (a f_b - b f_a) / (f_b - f_a),                                                        (2)
 *
 * and an end that stays twice in a row has its f halved.  A branch point has no such f: the sign of
 * the determinant is bisected.
 */
#include "modal/steady/path.h"
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/numbers.h"
#include "modal/steady/balance.h"
#include "modal/steady/blocks.h"
#include "modal/steady/budget.h"
#include "modal/steady/pattern.h"

/* A correction this short, in units of u's size and of `span`, is the last one. */
static const double TOLERANCE = 1e-12;
/* On a way where only its end is wanted: what is left is squared by the next one's. */
static const double TOLERANCE_ROUGH = 1e-4;
/* Shorter than this, one that no longer shrinks by SLOW is rounding's, and the last one too. */
static const double FLOOR = 1e-8;
static const double SLOW = 0.3;
/* Arc lengths of the first and of the longest step where the problem names none: a fiftieth and a
 * tenth of the range, so that a peak a tenth of it wide is not stepped over. */
static const double STEP_FIRST = 0.02;
static const double STEP_MOST = 0.1;
/* A walk that asks for shorter steps has met a corner or a singular point: it ends. */
static const double STEP_LEAST = 1e-7;
/* Steps below this many of the least are taken however the branch bends: the corner of a
 * piecewise law stays one at any length. */
static const double BENT = 100;
/* The least cosine of the angle between two tangents: 26 degrees a step. */
static const double BEND = 0.9;
/* And where only the way's end is wanted: 60 degrees, past which a step would go back as much as
 * on; its step doubles, too, as corners of piecewise laws have made it short. */
static const double BEND_ROUGH = 0.5;
static const double GROW_ROUGH = 2;
/* A step grows after at most QUICK corrections and shrinks after SLOWLY many, so that it settles
 * where four or five are needed. */
static const double GROW = 1.4;
static const double SHRINK = 0.7;
/* Relative step of the difference quotient in lambda, near the cube root of rounding, which is the
 * best for a central one; and what of the span a lambda near 0 counts as. */
static const double DIFFERENCE = 1e-6;
static const double NEAR_ZERO = 1e-3;
/* A special point is known to rounding of lambda; at a branch point, where lambda is not
 * stationary, the bracket's length is looked at too. */
static const double LOCATED = 1e-14;
static const double BRACKET = 1e-10;
/* Newton's method at one lambda has left the branch when a step is ten times the motion's size. */
static const double ASTRAY = 10;
enum {
    POINTS_MOST = 5000,       /* a curve drawn from more is no better */
    CORRECTIONS_MOST = 9,     /* quadratic convergence needs five from 0.1 to 1e-12 */
    QUICK = 3,   /* see GROW */
    SLOWLY = 6,   /* see GROW */
    LOCATE_MOST = 60          /* bisection alone halves a step to rounding in 53 */
};

struct path {
    const struct path_problem *problem;
    struct balance *b;               /* at the last lambda asked for */
    int n;                           /* order */
    double size, span;               /* the units of u and lambda */
    double *u, *t, *old_t;           /* the accepted point, its tangent (n + 1), the one before */
    double lambda;                   /* of the accepted point */
    int orientation;                 /* sign of (1)'s determinant there */
    double *w, *R, *Rl, *B, *x;      /* trial u; residual; dR/dlambda; (1); right-hand side */
    int *pivot;
    struct blocks *border;           /* (1) in place of B, where the derivative is of blocks */
    double complex *X;               /* of u or w, for whoever asks for harmonics */
    struct workspace space;          /* of the arrays */
    struct path_report *report;
    int corrections;                 /* of the last correction: the step follows them */
};

/* Frees what P holds. */
static void path_done(struct path *p)
{
    workspace_free(&p->space);
    blocks_free(p->border);
    p->b->whole = false;
}

/* Room for a balance of p->n unknowns; path_done frees it, made or half made. */
static enum modal_status path_init(struct path *p, struct modal_error *err)
{
    size_t n = (size_t)p->n + 2;
    bool full = p->b->pattern->full;

    p->b->whole = true;
    p->u = workspace_zeros(&p->space, n, sizeof *p->u);
    p->t = workspace_zeros(&p->space, n, sizeof *p->t);
    p->old_t = workspace_zeros(&p->space, n, sizeof *p->old_t);
    p->w = workspace_zeros(&p->space, n, sizeof *p->w);
    p->R = workspace_zeros(&p->space, n, sizeof *p->R);
    p->Rl = workspace_zeros(&p->space, n, sizeof *p->Rl);
    p->B = full ? workspace_zeros(&p->space, n * n, sizeof *p->B) : NULL;
    p->x = workspace_zeros(&p->space, n, sizeof *p->x);
    p->pivot = workspace_zeros(&p->space, n, sizeof *p->pivot);
    p->X = workspace_zeros(&p->space, n, sizeof *p->X);
    if (p->space.failed)
        return modal_fail(err, MODAL_NO_MEMORY, "path: no memory for %d unknowns", p->n);
    return full ? MODAL_OK : blocks_new(p->b->pattern, p->b->H, true, &p->border, err);
}

/* Residual (and derivative) of u at lambda, into p->b. */
static enum modal_status evaluate(struct path *p, const double *u, double lambda, bool derivative,
                                  struct modal_error *err)
{
    enum modal_status rc = p->problem->at(p->problem->context, lambda, &p->b, err);

    if (rc != MODAL_OK)
        return rc;
    balance_unpack(p->b, u, p->X);
    return balance_residual(p->b, p->X, derivative, err);
}

/* dR/dlambda by a central difference. */
static enum modal_status slope(struct path *p, const double *u, double lambda,
                               struct modal_error *err)
{
    double h =
        DIFFERENCE
        * fmin(p->span, fabs(lambda) > 0 ? fmax(fabs(lambda), NEAR_ZERO * p->span) : p->span);
    enum modal_status rc = evaluate(p, u, lambda - h, false, err);

    memcpy(p->R, p->b->R, (size_t)p->n * sizeof *p->R);
    if (rc == MODAL_OK)
        rc = evaluate(p, u, lambda + h, false, err);
    for (int i = 0; rc == MODAL_OK && i < p->n; i++)
        p->Rl[i] = (p->b->R[i] - p->R[i]) / (2 * h);    /* off by h^2 and by rounding over h */
    return rc;
}

/* (1) of blocks, whose rows are scaled as they are factored. */
static bool bordered_blocks(struct path *p, const double *t, double *row, int *sign)
{
    double before = blocks_work(p->border);
    bool ok;

    for (int i = 0; i < p->n; i++) {
        p->x[i] = p->Rl[i] * p->span;
        row[i] = 1;
    }
    row[p->n] = 1;
    blocks_set_border(p->border, p->b->blocks, p->size, p->x, t, t[p->n]);
    ok = blocks_factor(p->border, sign);
    budget_add(p->b->budget, (blocks_work(p->border) - before) / BUDGET_DENSE);
    return ok;
}

/* p->x <- its solution with (1). */
static void solve_bordered(struct path *p)
{
    int m = p->n + 1;

    if (p->border != NULL)
        blocks_solve(p->border, p->x);
    else
        LAPACKE_dgetrs_work(LAPACK_COL_MAJOR, 'N', m, 1, p->B, m, p->pivot, p->x, m);
}

/* (1), rows scaled; factored.  The sign of its determinant into *SIGN; false where singular:
 * p->x is undefined then. */
static bool bordered(struct path *p, const double *t, double *row, int *sign)
{
    int n = p->n, m = n + 1, s = 1;

    if (p->border != NULL)
        return bordered_blocks(p, t, row, sign);
    budget_add(p->b->budget, balance_dense_work(m));

    for (int i = 0; i < n; i++)
        row[i] = fabs(p->Rl[i]) * p->span;
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++) {
            double v = p->b->J[(size_t)j * (size_t)n + (size_t)i] * p->size;

            p->B[(size_t)j * (size_t)m + (size_t)i] = v;
            /* scales differ by the square of the frequency from row to row */
            row[i] = fmax(row[i], fabs(v));
        }
    for (int i = 0; i < n; i++) {
        if (!(row[i] > 0) || !isfinite(row[i]))
            return false;
        row[i] = 1 / row[i];
        p->B[(size_t)n * (size_t)m + (size_t)i] = p->Rl[i] * p->span * row[i];
    }
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++)
            /* rows of (1) at 1, so that a pivot tells of singularity */
            p->B[(size_t)j * (size_t)m + (size_t)i] *= row[i];
    for (int j = 0; j < m; j++)
        p->B[(size_t)j * (size_t)m + (size_t)n] = t[j];  /* the last row of (1) */
    row[n] = 1;
    if (LAPACKE_dgetrf_work(LAPACK_COL_MAJOR, m, m, p->B, m, p->pivot) != 0)
        return false;
    for (int i = 0; i < m; i++)
        s *= (p->B[(size_t)i * (size_t)(m + 1)] < 0 ? -1 : 1) * (p->pivot[i] != i + 1 ? -1 : 1);
    *sign = s;
    return true;
}

/* The length in the scaled unknowns (v, mu). */
static double norm(const double *x, int n)
{
    double sum = 0;

    for (int i = 0; i < n; i++)
        sum += x[i] * x[i];
    return sqrt(sum);
}

/* Correct p->w, *LAMBDA on the plane through (w0, lambda0), the prediction, normal to t.  *OK:
 * converged; then the tangent is in p->x and its determinant's sign in *SIGN. */
static enum modal_status correct(struct path *p, const double *t, double *lambda, int *sign,
                                 bool *ok, struct modal_error *err)
{
    int n = p->n, m = n + 1;
    double *row = malloc(((size_t)n + 1) * sizeof *row), *w0 = malloc(((size_t)n + 1) * sizeof *w0),
           lambda0 = *lambda, last = HUGE_VAL;
    enum modal_status rc =
        row == NULL || w0 == NULL ? modal_fail(err, MODAL_NO_MEMORY, "path: no memory") : MODAL_OK;

    *ok = false;
    if (rc == MODAL_OK) {
        memcpy(w0, p->w, (size_t)n * sizeof *w0);
        rc = slope(p, p->w, *lambda, err);
    }
    for (int i = 0; rc == MODAL_OK && i < CORRECTIONS_MOST; i++) {
        double plane = t[n] * (*lambda - lambda0) / p->span, step;  /* n of (1) */

        rc = evaluate(p, p->w, *lambda, true, err);
        if (rc != MODAL_OK)
            break;
        if (!bordered(p, t, row, sign))
            break;
        for (int e = 0; e < n; e++) {
            p->x[e] = -p->b->R[e] * row[e];             /* scaled as the rows are */
            plane += t[e] * (p->w[e] - w0[e]) / p->size;
        }
        p->x[n] = -plane;                               /* right-hand side of (1) */
        solve_bordered(p);
        step = norm(p->x, m);
        /* too far from the branch */
        if (!isfinite(step) || (i > 1 && step > 2 * last) || step > 1)
            break;
        for (int e = 0; e < n; e++)
            p->w[e] += p->size * p->x[e];
        *lambda += p->span * p->x[n];
        p->corrections = i + 1;
        if (step <= (p->problem->rough ? TOLERANCE_ROUGH : TOLERANCE)
            || (step < FLOOR && step > SLOW * last)) {
            *ok = true;
            break;
        }
        last = step;
    }
    /* The factors are those of the last correction, nearer the branch than the tangent needs. */
    if (rc == MODAL_OK && *ok) {
        memset(p->x, 0, (size_t)m * sizeof *p->x);
        p->x[n] = 1;                                    /* (1) with e_last: the tangent */
        solve_bordered(p);
        double length = norm(p->x, m);
        for (int e = 0; e < m; e++)
            p->x[e] /= length;
    }
    /* A prediction too far out: the step is halved, not the walk ended. */
    if (rc == MODAL_OVERFLOW || rc == MODAL_NO_CONVERGENCE)
        rc = MODAL_OK;
    free(row);
    free(w0);
    return rc;
}

/* The point at distance S along the tangent from the accepted one. */
static enum modal_status at_distance(struct path *p, double s, double *lambda, int *sign, bool *ok,
                                     struct modal_error *err)
{
    for (int i = 0; i < p->n; i++)
        p->w[i] = p->u[i] + s * p->size * p->t[i];      /* the prediction */
    *lambda = p->lambda + s * p->span * p->t[p->n];     /* both in units of their own */
    return correct(p, p->t, lambda, sign, ok, err);
}

/* What was found to whoever asked: an accepted point, or a SPECIAL one (>= 0) beside them. */
static enum modal_status report_point(struct path *p, const double *u, double lambda, double turn,
                                      int special, bool *stop, struct modal_error *err)
{
    struct path_point point = { .lambda = lambda, .turn = turn, .iterations = p->corrections };
    enum modal_status rc = p->problem->at(p->problem->context, lambda, &p->b, err);

    if (rc != MODAL_OK)
        return rc;
    balance_unpack(p->b, u, p->X);
    point.X = p->X;
    if (special >= 0)
        return p->problem->special != NULL
                   ? p->problem->special(p->problem->context, (enum path_special)special, &point,
                                         p->b, err)
                   : MODAL_OK;
    p->report->points++;
    return p->problem->point(p->problem->context, &point, p->b, stop, err);
}

/* The fold (or, by the determinant's sign, the branch point) within distance FAR of the accepted
 * point. */
static enum modal_status locate(struct path *p, double far, double turn_far, int sign_far,
                                enum path_special kind, struct modal_error *err)
{
    double a = 0, b = far, fa = p->t[p->n], fb = turn_far, lambda = NAN, before = NAN;
    double *kept = malloc(((size_t)p->n + 1) * sizeof *kept);
    int side = 0, sign;
    enum modal_status rc =
        kept == NULL ? modal_fail(err, MODAL_NO_MEMORY, "path: no memory") : MODAL_OK;
    bool found = false;

    /* A bracket [a, b] of distances: fa and fb, t_mu there, have different signs. */
    for (int i = 0; rc == MODAL_OK && i < LOCATE_MOST; i++) {
        double s = kind == PATH_FOLD ? (a * fb - b * fa) / (fb - fa) : 0.5 * (a + b), f;
        bool ok;

        if (!(s > a && s < b))
            s = 0.5 * (a + b);
        rc = at_distance(p, s, &lambda, &sign, &ok, err);
        if (rc != MODAL_OK || !ok)
            break;
        found = true;
        memcpy(kept, p->w, (size_t)p->n * sizeof *kept);
        /* t_mu, or a sign alone: bisection */
        f = kind == PATH_FOLD ? p->x[p->n] : sign == sign_far ? -1.0 : 1.0;
        if (fabs(lambda - before) <= LOCATED * p->span + 4 * DBL_EPSILON * fabs(lambda) && i > 2
            && (kind == PATH_FOLD || b - a < BRACKET))
            break;
        before = lambda;
        if ((f > 0) == (fa > 0 || kind != PATH_FOLD)) {
            a = s;
            fa = f;
            fb = side == -1 ? fb / 2 : fb;             /* Illinois: an end kept twice weighs half */
            side = -1;
        } else {
            b = s;
            fb = f;
            fa = side == 1 ? fa / 2 : fa;               /* so that both ends close in */
            side = 1;
        }
    }
    if (rc == MODAL_OK && found)
        rc = report_point(p, kept, lambda, kind == PATH_FOLD ? 0 : p->t[p->n], kind, NULL, err);
    free(kept);
    return rc;
}

/* At exactly LAMBDA, from the guess p->w: Newton's method there. */
static enum modal_status at_parameter(struct path *p, double lambda, bool *ok,
                                      struct modal_error *err)
{
    double last = HUGE_VAL;
    enum modal_status rc = MODAL_OK;

    *ok = false;
    for (int i = 0; i < 3 * CORRECTIONS_MOST; i++) {
        double step;

        rc = evaluate(p, p->w, lambda, true, err);
        if (rc != MODAL_OK || !balance_factor(p->b, NULL))
            break;
        for (int e = 0; e < p->n; e++)
            p->R[e] = -p->b->R[e];
        balance_solve(p->b, p->R);
        step = norm(p->R, p->n) / p->size;
        if (!isfinite(step) || step > ASTRAY)
            break;
        for (int e = 0; e < p->n; e++)
            p->w[e] += p->R[e];
        p->corrections = i + 1;
        if (step <= TOLERANCE || (step < FLOOR && step > SLOW * last)) {
            *ok = true;
            break;
        }
        last = step;
    }
    return rc == MODAL_OVERFLOW ? MODAL_OK : rc;
}

/* The unit of u, so that a step is a share of the motion: its largest entry, or its length where
 * dofs are many, which a step moves together. */
static void measure(struct path *p)
{
    double most = p->b->pattern->full ? numbers_largest(p->u, (size_t)p->n) : norm(p->u, p->n);

    p->size = most > 0 ? most : 1;
}

/* The tangent where the branch sets out, towards `to`: (1) bordered by e_last. */
static enum modal_status first_tangent(struct path *p, bool *ok, struct modal_error *err)
{
    double *row = malloc(((size_t)p->n + 1) * sizeof *row), length;
    enum modal_status rc = row == NULL ? modal_fail(err, MODAL_NO_MEMORY, "path: no memory")
                                       : slope(p, p->u, p->lambda, err);

    *ok = false;
    if (rc == MODAL_OK)
        rc = evaluate(p, p->u, p->lambda, true, err);
    memset(p->t, 0, ((size_t)p->n + 1) * sizeof *p->t);
    p->t[p->n] = 1;                          /* e_last in place of a tangent: (1) at fixed lambda */
    if (rc == MODAL_OK && bordered(p, p->t, row, &p->orientation)) {
        memset(p->x, 0, ((size_t)p->n + 1) * sizeof *p->x);
        p->x[p->n] = 1;
        solve_bordered(p);
        memcpy(p->t, p->x, ((size_t)p->n + 1) * sizeof *p->t);
        /* its sign turns it towards `to` */
        length = norm(p->t, p->n + 1) * (p->problem->to >= p->problem->from ? 1 : -1);
        *ok = isfinite(length) && length != 0;
        for (int i = 0; *ok && i <= p->n; i++)
            p->t[i] /= length;
    }
    free(row);
    return rc;
}

/* Report the crossing of `to` on the step just accepted (end point in p->w), by Newton's method at
 * exactly `to`. */
static enum modal_status cross(struct path *p, double fraction, double turn, bool *ok,
                               bool *stop, struct modal_error *err)
{
    double *end = malloc(((size_t)p->n + 1) * sizeof *end);
    enum modal_status rc =
        end == NULL ? modal_fail(err, MODAL_NO_MEMORY, "path: no memory") : MODAL_OK;

    if (rc == MODAL_OK) {
        memcpy(end, p->w, (size_t)p->n * sizeof *end);
        for (int i = 0; i < p->n; i++)
            /* the chord at `to`: Newton needs no better */
            p->w[i] = p->u[i] + fraction * (end[i] - p->u[i]);
        rc = at_parameter(p, p->problem->to, ok, err);
        if (rc == MODAL_OK && *ok)
            rc = report_point(p, p->w, p->problem->to, turn, -1, stop, err);
        memcpy(p->w, end, (size_t)p->n * sizeof *end);
    }
    free(end);
    return rc;
}

/* w becomes the point that the next step sets out from; its tangent is brought to the new size. */
static void accept(struct path *p, double lambda, int sign, const double *tangent)
{
    double old_size = p->size, length;

    memcpy(p->u, p->w, (size_t)p->n * sizeof *p->u);
    memcpy(p->t, tangent, ((size_t)p->n + 1) * sizeof *p->t);
    p->lambda = lambda;
    p->orientation = sign;
    measure(p);
    for (int i = 0; i < p->n; i++)
        p->t[i] *= old_size / p->size;                  /* v = u / size */
    length = norm(p->t, p->n + 1);
    for (int i = 0; i <= p->n; i++)
        p->t[i] /= length;
}

/* One step of the walk: where it led, before it is accepted. */
struct stride {
    double ds, lambda;
    double *tangent, *kept;      /* n + 1 each: the tangent there; w, aside while an event is
                                  * located */
    int sign;
    bool stop, ended;
};

/* Whether the walk has points and work left. */
static enum modal_status may_go_on(struct path *p, struct stride *s, struct modal_error *err)
{
    const struct path_problem *q = p->problem;

    if (q->cancelled != NULL && q->cancelled(q->context))
        return modal_fail(err, MODAL_CANCELLED, "cancelled");
    if (budget_spent(q->budget)) {
        p->report->reason = "the work allowed was spent";
        s->ended = true;
    } else if (p->report->points >= (q->points_most > 0 ? q->points_most : POINTS_MOST)) {
        p->report->reason = "the branch has more points than are followed";
        s->ended = true;
    }
    return MODAL_OK;
}

/* The point at distance ds, *found, or a shorter ds. */
static enum modal_status step_out(struct path *p, struct stride *s, bool *found,
                                  struct modal_error *err)
{
    double dot = 0;
    bool ok;
    enum modal_status rc = at_distance(p, s->ds, &s->lambda, &s->sign, &ok, err);

    if (rc != MODAL_OK)
        return rc;
    memcpy(s->tangent, p->x, ((size_t)p->n + 1) * sizeof *s->tangent);
    for (int i = 0; ok && i <= p->n; i++)
        dot += s->tangent[i] * p->t[i];                 /* the cosine of the bend */
    *found = ok && !(dot < (p->problem->rough ? BEND_ROUGH : BEND) && s->ds > BENT * STEP_LEAST);
    if (*found)
        return MODAL_OK;
    p->report->rejected++;
    s->ds /= 2;
    if (s->ds < STEP_LEAST) {
        p->report->reason = "the step of the continuation became too small";
        s->ended = true;
    }
    return MODAL_OK;
}

/* The fold or the branch point that the step passed, if any. */
static enum modal_status locate_passed(struct path *p, const struct stride *s,
                                       struct modal_error *err)
{
    bool fold = s->tangent[p->n] * p->t[p->n] < 0,      /* lambda turned back on the way */
         /* the first point has no sign to compare */
         branch = s->sign != p->orientation && p->report->points > 1;
    enum modal_status rc;

    if (p->problem->special == NULL || (!fold && !branch))
        return MODAL_OK;
    memcpy(s->kept, p->w, (size_t)p->n * sizeof *s->kept);  /* locate works in w */
    rc = locate(p, s->ds, s->tangent[p->n], s->sign, fold ? PATH_FOLD : PATH_BRANCH, err);
    memcpy(p->w, s->kept, (size_t)p->n * sizeof *s->kept);
    return rc;
}

/* Where the end of the range lies within the step, its point; *again: not found, a shorter step is
 * needed. */
static enum modal_status cross_end(struct path *p, struct stride *s, bool *again,
                                   struct modal_error *err)
{
    double to = p->problem->to;
    bool ok;
    enum modal_status rc;

    if ((s->lambda - to) * (p->lambda - to) > 0 || s->lambda == p->lambda || p->lambda == to)
        return MODAL_OK;
    rc = cross(p, (to - p->lambda) / (s->lambda - p->lambda), s->tangent[p->n], &ok, &s->stop,
               err);
    if (rc != MODAL_OK)
        return rc;
    if (ok && !p->problem->past)
        p->report->complete = s->ended = true;
    *again = !ok && s->ds > BENT * STEP_LEAST;
    if (*again)
        s->ds /= 2;
    s->ended |= s->stop;
    return MODAL_OK;
}

/* The branch has left the range that is asked for. */
static bool left(struct path *p)
{
    const struct path_problem *q = p->problem;
    double direction = q->to >= q->from ? 1 : -1;

    if (q->past ? p->lambda >= q->low && p->lambda <= q->high
                : (p->lambda - q->from) * direction >= -0.5 * p->span)
        return false;
    p->report->complete = q->past;
    p->report->reason = q->past ? NULL : "the branch turned back past where it set out";
    return true;
}

/* Steps of arc length until the range, the caller or the work allowed ends them. */
static enum modal_status walk(struct path *p, struct modal_error *err)
{
    const struct path_problem *q = p->problem;
    size_t room = ((size_t)p->n + 1) * sizeof(double);
    struct stride s = { .ds = q->step_first > 0 ? q->step_first : STEP_FIRST,
                        .tangent = malloc(room),
                        .kept = malloc(room) };
    double most = q->step_most > 0 ? q->step_most : STEP_MOST,
           grow = q->rough ? GROW_ROUGH : GROW;
    enum modal_status rc = s.tangent == NULL || s.kept == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "path: no memory")
                               : MODAL_OK;

    while (rc == MODAL_OK && !s.stop && !s.ended) {
        bool found = false, again = false;
        rc = may_go_on(p, &s, err);
        if (rc == MODAL_OK && !s.ended)
            rc = step_out(p, &s, &found, err);
        if (rc == MODAL_OK && found)
            rc = locate_passed(p, &s, err);
        if (rc == MODAL_OK && found)
            rc = cross_end(p, &s, &again, err);
        if (rc != MODAL_OK || s.ended || !found || again)
            continue;
        accept(p, s.lambda, s.sign, s.tangent);
        rc = report_point(p, p->u, p->lambda, p->t[p->n], -1, &s.stop, err);
        s.ended = left(p);
        s.ds = fmin(most, s.ds * (p->corrections <= QUICK    ? grow
                                 : p->corrections >= SLOWLY ? SHRINK
                                                            : 1));
    }
    p->report->complete |= s.stop;
    free(s.tangent);
    free(s.kept);
    return rc;
}

enum modal_status path_follow(const struct path_problem *problem, const double complex *X,
                              struct path_report *report, struct modal_error *err)
{
    struct path p = { .problem = problem,
                      .span = problem->span > 0 ? problem->span : fabs(problem->to - problem->from),
                      .lambda = problem->from,
                      .report = report };
    enum modal_status rc;
    bool ok, stop = false;

    memset(report, 0, sizeof *report);
    rc = problem->at(problem->context, problem->from, &p.b, err);
    if (rc != MODAL_OK)
        return rc;
    p.n = p.b->order;
    rc = path_init(&p, err);
    if (rc != MODAL_OK)
        goto out;
    balance_pack(p.b, X, p.u);
    measure(&p);
    memcpy(p.w, p.u, (size_t)p.n * sizeof *p.w);
    /* The start may be of another tolerance, or one that only nearly balances. */
    rc = at_parameter(&p, problem->from, &ok, err);
    if (rc != MODAL_OK || !ok) {
        report->reason = "the branch does not start: no solution at its first point";
        goto out;
    }
    memcpy(p.u, p.w, (size_t)p.n * sizeof *p.u);
    measure(&p);
    rc = first_tangent(&p, &ok, err);
    if (rc == MODAL_OK && !ok)
        report->reason = "the derivative is singular where the branch sets out";
    if (rc == MODAL_OK && ok)
        rc = report_point(&p, p.u, p.lambda, p.t[p.n], -1, &stop, err);
    if (rc == MODAL_OK && ok && !stop)
        rc = walk(&p, err);
out:
    path_done(&p);
    return rc;
}
