/*
 * solve.c - see solve.h
 *
 * From a program to one steady state.  No laws: linear_answer.c.  Rigid friction, alone or
 * beside laws without restart: followed in time (by_cycle.h).  All else: a balance at H harmonics,
 * found by the ways of ways.h, whose order is
 *
 *     H, 2 H, 4 H, ..   until   error(H) <= target max |x|,                                     (1)
 *
 * error of estimate.h, each begun from the last.  An order costs up to eight times the one before
 * (a full matrix of q (2 H + 1) unknowns is factored in its cube), so that all before cost a
 * seventh of the last.  Where linear dofs taken out resonate with the kept ones held, all are kept.
 */
#include "modal/steady/solve.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/craig_bampton.h"
#include "modal/scene/orbit.h"
#include "modal/scene/program.h"
#include "modal/steady/aft.h"
#include "modal/steady/at_rest.h"
#include "modal/steady/balance.h"
#include "modal/steady/by_cycle.h"
#include "modal/steady/by_inputs.h"
#include "modal/steady/condense.h"
#include "modal/steady/cycle.h"
#include "modal/steady/estimate.h"
#include "modal/steady/iterate.h"
#include "modal/steady/linear_answer.h"
#include "modal/steady/march.h"
#include "modal/steady/pattern.h"
#include "modal/steady/session.h"
#include "modal/steady/solutions.h"
#include "modal/steady/ways.h"

/* Time integration that is compared ends a tenth nearer than the target asks, and takes a tolerance
 * that is meant for steps, not the balance's. */
static const double PERIODIC = 10;
static const double TOLERANCE_OF_STEPS = 1e-11;
/* Operations that sparse factors may take a linear dof: half a minute for a hundred thousand. */
static const double WORK_LINEAR = 3e5;
/* Of the budget, what orders past the first may cost until the answer has its verdict: beside an
 * unstable one a stable one is sought with the rest. */
static const double SHARE_OF_ORDERS = 0.5;
/* Of what is left of the budget, what a search for others than the motion known may cost before
 * what it found is carried on, which has the rest.  Nobody knows whether there are others: past
 * this share of the least budget the search costs no more than the motion and its verdict did, so
 * that of many dofs both take at most twice what is known. */
static const double SHARE_OF_SEARCH = 0.5;
enum {
    H_AUTO_MOST = 256,       /* the last one that is tried unasked */
    H_LINEAR_MOST = 4096,   /* no iteration: each harmonic is one solve */
    STEPS_NEXT = 4,          /* Newton's steps that an order from near takes, at least */
    COST_NEXT = 4,           /* times this order's, of a sparse one: twice the blocks, more fill; */
    COST_FULL = 8,           /* of a full one, its cube */
    SPARSE_LEAST = 10,       /* kept dofs from which sparse factors pay, */
    SPARSE_LINEAR = 100,     /* and the dofs beside each that are cheaper kept than taken out */
    FAILED_MOST = 2,         /* orders in a row that failed from near, after which no more is
                              * tried */
    ORDER_FAILED = 600,      /* unknowns of which a failure is costly */
    ORDER_AUTO_MOST = 3000,  /* unknowns of a full matrix that are tried unasked: 72 MB */
    H_SEARCH = 8,            /* the fewest harmonics that all solutions are sought with */
    SEARCHES = 7200,         /* factorizations of such a search: starts times their steps */
    SEARCH_SHARE = 3,        /* the budget over what these may cost: what is found is carried on,
                              * and the answer came first */
    MARCH_SAMPLES = 512,     /* of time integration, unasked; and the harmonics taken from them */
    MARCH_HARMONICS = 256   /* half of the samples */
};

/* What the session's laws are, for the choice of method and of samples. */
static void classify(struct steady *s)
{
    s->exact = true;
    s->linear = s->p->laws == 0;
    for (int l = 0; l < s->p->laws; l++) {
        const struct law *law = &s->p->law[l];
        bool exact = law->kind->pieces != NULL && !s->opt.unlocated;

        s->exact &= exact;
        s->jumps |= exact && law->kind->set_valued;
        s->degree = law->degree > s->degree ? law->degree : s->degree;
        s->sampled |= !exact && law->degree == 0;
    }
}

/* Options that contradict each other or the loads, by their fields. */
static enum modal_status check_options(const struct steady *s, struct modal_error *err)
{
    const struct steady_options *o = &s->opt;
    int most = s->linear ? H_LINEAR_MOST : ORBIT_HARMONICS_MOST;

    if (o->harmonics < 0 || o->harmonics > most)
        return modal_fail_field(err, MODAL_BAD_INPUT, "steady.harmonics",
                                "%d harmonics; accepted: 1 to %d", o->harmonics, most);
    if (o->samples < 0 || o->samples > ORBIT_SAMPLES_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "steady.samples",
                                "%d samples; accepted: 3 to %d", o->samples, ORBIT_SAMPLES_MOST);
    if (o->harmonics > 0 && o->samples > 0 && o->samples <= 2 * o->harmonics)
        return modal_fail_field(err, MODAL_BAD_INPUT, "steady.samples",
                                "%d samples cannot carry %d harmonics; accepted: at least %d",
                                o->samples, o->harmonics, 2 * o->harmonics + 1);
    if (o->harmonics > 0 && condense_highest_load(s->c) > o->harmonics)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "steady.harmonics",
            "%d harmonics do not hold the excitation at harmonic %d; accepted: at least that",
            o->harmonics, condense_highest_load(s->c));
    return MODAL_OK;
}

/* Whether KEPT dofs that iterate are too many for a full matrix of them, and not so few that the
 * others are better taken out. */
static bool sparse_pays(const struct program *p, const struct steady_options *opt, int kept)
{
    return p->n_linear == 0 && !opt->by_differences && !opt->reduced && kept >= SPARSE_LEAST
        && p->n <= SPARSE_LINEAR * kept;
}

/* Which dofs iterate, and whether their pattern is kept. */
static enum condense_keep structure(const struct program *p, const struct steady_options *opt)
{
    int kept = condense_nonlinear(p);

    return sparse_pays(p, opt, kept) ? CONDENSE_SPARSE : CONDENSE_LINEAR;
}

/* The program reduced takes its place, and its numbers those of dofs. */
static enum modal_status reduce(struct steady *s, struct modal_error *err)
{
    enum modal_status rc = craig_bampton_new(s->p, s->opt.keep, s->opt.keep_count, s->opt.reduce,
                                             &s->reduction, err);

    if (rc != MODAL_OK)
        return rc;
    s->counted = calloc((size_t)s->opt.dofs_count + 1, sizeof *s->counted);
    if (s->counted == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    for (int i = 0; i < s->opt.dofs_count; i++)
        s->counted[i] = craig_bampton_find(s->reduction, s->opt.dofs[i]);
    s->p = &s->reduction->reduced;
    s->opt.dofs = s->counted;
    s->opt.reduced = true;
    return MODAL_OK;
}

enum modal_status steady_new(const struct program *p, const struct steady_options *opt,
                             struct steady **out, struct modal_error *err)
{
    struct steady *s = calloc(1, sizeof *s);
    enum modal_status rc;

    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    s->p = p;
    s->opt = *opt;
    classify(s);
    rc = opt->reduce > 0 ? reduce(s, err) : MODAL_OK;
    if (rc == MODAL_OK)
        rc = condense_new(s->p, structure(s->p, &s->opt), &s->c, err);
    if (rc == MODAL_OK && !s->opt.by_differences)
        rc = joint_new(s->p, condense_place(s->c), condense_pattern(s->c), &s->joint, err);
    if (rc == MODAL_OK && s->opt.dofs != NULL)
        condense_want(s->c, s->opt.dofs, s->opt.dofs_count);
    if (rc == MODAL_OK && s->opt.krylov > 0)
        rc = condense_share(s->c, s->opt.krylov, 1, err);
    if (rc == MODAL_OK)
        rc = check_options(s, err);
    if (rc != MODAL_OK) {
        steady_free(s);
        return rc;
    }
    *out = s;
    return MODAL_OK;
}

void steady_inherit(struct steady *s, struct steady *before)
{
    condense_inherit(s->c, before->c);
    s->in_vain = before->in_vain;
}

void steady_free(struct steady *s)
{
    if (s == NULL)
        return;
    steady_drop_balances(s);
    orbit_grid_free(s->peaks);
    joint_free(s->joint);
    condense_free(s->c);
    at_rest_free(s->rest);
    steady_free(s->finer);
    craig_bampton_free(s->reduction);
    free(s->counted);
    free(s);
}

/* At one H. */
static enum modal_status solve_at(struct steady *s, int H, double omega,
                                  const struct steady_start *start, struct steady_point *point,
                                  struct modal_error *err)
{
    struct balance *b;
    double complex *X = NULL;
    long *before = calloc((size_t)s->p->laws + 1, sizeof *before), ffts;
    enum modal_status rc = steady_balance(s, H, &b, err);

    if (rc != MODAL_OK)
        goto out;
    X = calloc((size_t)b->q * ((size_t)H + 1) + 1, sizeof *X);
    if (X == NULL || before == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
        goto out;
    }
    rc = point_init(s, point, b->q, H, aft_samples(b->aft), err);
    if (rc == MODAL_OK)
        rc = ways_begin(s, b, omega, start, X, point, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, omega, 1, err);
    if (rc != MODAL_OK)
        goto out;
    for (int l = 0; l < s->p->laws; l++)
        before[l] = aft_evaluations(b->aft, l);
    ffts = aft_transforms(b->aft);
    s->current = false;
    /* Counts of the balance run over all solutions: this one's are the difference. */
    rc = ways_try(s, b, start, X, point, err);
    if (rc == MODAL_OK && point->converged && !s->current)
        rc = balance_residual(b, point->X, false, err);
    if (rc != MODAL_OK)
        goto out;
    point_count(b, before, ffts, point);
    if (!point->converged && s->jumps)
        point->reason = "no motion without stops closes under rigid friction; where the body "
                        "stops, give the friction a stiffness (type friction)";
    /* Rigid friction has estimates of its own: its series falls slowly. */
    if (point->converged && s->jumps)
        rc = estimate_sharpen(s, b, point, err);
    else if (point->converged && !(s->opt.estimate_later && s->opt.harmonics > 0)) {
        rc = estimate_errors(s, b, point, err);
        if (rc == MODAL_OK)
            rc = balance_set(b, omega, 1, err);            /* recovery at this H again */
    }
out:
    free(before);
    free(X);
    return rc;
}

/* A point of every solution in FOUND, errors estimated. */
static enum modal_status points_of_all(struct steady *s, struct balance *b,
                                       const struct solutions *found, const char *method,
                                       struct steady_point *points, int *count,
                                       struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < found->count; i++) {
        rc = balance_set(b, b->omega, 1, err);          /* the search left another level */
        if (rc == MODAL_OK)
            rc = steady_point_of(s, b, found->X[i], &points[*count], err);
        if (rc != MODAL_OK)
            break;
        points[*count].method = method;
        points[*count].attempts = 1;                    /* of each, from a start of its own */
        rc = estimate_errors(s, b, &points[(*count)++], err);
    }
    return rc;
}

/* From X of FEW its like of B, in place, by Newton's method from near: harmonics double, as a jump
 * to many at once is no step from near where laws have events.  NEXT has as much room as X. */
static enum modal_status widen_one(struct steady *s, const struct balance *few, struct balance *b,
                                   double complex *X, double complex *next, bool *done,
                                   struct modal_error *err)
{
    struct iterate_options opt = steady_iterate_options(s);
    struct iterate_report r = { .converged = true };
    double omega = few->omega;
    enum modal_status rc = MODAL_OK;

    for (int H = few->H, wide; rc == MODAL_OK && r.converged && H < b->H; H = wide) {
        const struct steady_start start = { few->q, H, X };
        struct balance *at = b;

        wide = 2 * H < b->H ? 2 * H : b->H;
        if (wide < b->H)
            rc = steady_balance(s, wide, &at, err);
        if (rc == MODAL_OK)
            rc = balance_set(at, omega, 1, err);
        if (rc != MODAL_OK)
            break;
        start_write(at, &start, next);
        rc = iterate_newton(at, &opt, next, &r, err);
        memcpy(X, next, (size_t)b->q * ((size_t)wide + 1) * sizeof *X);
    }
    *done = rc == MODAL_OK && r.converged;
    return rc;
}

/* From each solution of FEW its like of B into FOUND. */
static enum modal_status widen_all(struct steady *s, const struct balance *few,
                                   const struct solutions *from, struct balance *b,
                                   struct solutions *found, struct modal_error *err)
{
    size_t size = (size_t)b->q * ((size_t)b->H + 1);
    double complex *X = calloc(2 * size + 1, sizeof *X);
    bool done = false;
    enum modal_status rc = X == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory")
        : MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < from->count; i++) {
        memcpy(X, from->X[i], (size_t)b->q * ((size_t)few->H + 1) * sizeof *X);
        rc = widen_one(s, few, b, X, X + size, &done, err);
        if (rc == MODAL_OK && done)
            solutions_add(found, b, X);
    }
    free(X);
    return rc == MODAL_OK ? balance_set(b, few->omega, 1, err) : rc;
}

/* What a search for others may cost, beside a motion that is KNOWN. */
static double search_may_cost(const struct steady *s, bool known)
{
    double left = fmax(0, s->budget.most - s->budget.spent),
           least = SHARE_OF_SEARCH * steady_least_work();

    return known ? fmin(SHARE_OF_SEARCH * left, fmax(least, s->budget.spent)) : left;
}

/* All solutions of B, whose one is X if that is not NULL: sought with so few harmonics that MAY
 * operations reach, and carried on; *ENDED: they were spent before. */
static enum modal_status search(struct steady *s, struct balance *b, const double complex *X,
                                double may, struct solutions *found, bool *ended,
                                struct modal_error *err)
{
    struct solutions_options opt = { .cancelled = s->opt.cancelled, .context = s->opt.context };
    struct solutions coarse = { 0 };
    int load = condense_highest_load(s->c), H = b->H;
    struct balance *few = b;
    double omega = b->omega, most = s->budget.most, starts = fmin(most / SEARCH_SHARE, may);
    bool same;
    enum modal_status rc = MODAL_OK;

    while ((H + 1) / 2 >= H_SEARCH && H / 2 > 2 * load
           && SEARCHES * steady_factor_work(s, H) > starts)
        H = (H + 1) / 2;                             /* cheaper by eight where the matrix is full */
    same = H == b->H || s->opt.samples > 0;
    if (X != NULL)
        solutions_add(found, b, X);
    if (!same)
        rc = steady_balance(s, H, &few, err);
    if (rc == MODAL_OK)
        rc = balance_set(few, omega, 1, err);
    s->budget.most = fmin(most, s->budget.spent + may);
    if (rc == MODAL_OK)
        rc = solutions_along_levels(few, &opt, same ? found : &coarse, err);
    if (rc == MODAL_OK)
        rc = solutions_from_starts(few, &opt, same ? found : &coarse, err);
    *ended = budget_spent(&s->budget);
    s->budget.most = most;
    if (rc == MODAL_OK && !same)
        rc = widen_all(s, few, &coarse, b, found, err);
    /* A search at the balance's own order has nothing to carry on. */
    solutions_done(&coarse);
    return rc;
}

enum modal_status steady_solve_all(struct steady *s, double omega, const struct steady_start *start,
                                   const struct steady_point *known, struct steady_point **points,
                                       int *count,
                                   struct modal_error *err)
{
    struct solutions found = { 0 };
    struct steady_point *list = calloc(SOLUTIONS_MOST + 1, sizeof *list);
    struct balance *b = NULL;
    struct budget before = s->budget;
    bool ended = false;
    enum modal_status rc;

    s->searching = true;  /* the search is of the orders of laws that act */
    rc = list == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory")
         : known != NULL && known->linear == NULL ? point_copy(known, &list[0], err)
                                                  : steady_solve(s, omega, start, &list[0], err);
    if (known != NULL && known->linear != NULL)         /* it was solved anew, of KNOWN's budget */
        s->budget = (struct budget){ before.spent + s->budget.spent, before.most, before.apart };
    s->searching = false;
    *count = rc == MODAL_OK ? 1 : 0;
    if (rc != MODAL_OK || s->linear || list[0].followed || (s->jumps && !list[0].converged))
        /* rigid friction followed in time, in vain or not, has no balance to search in */
        goto out;
    rc = steady_balance(s, list[0].H, &b, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, omega, 1, err);
    if (known == NULL)
        steady_allow_work(s);                           /* of KNOWN's budget the search is part */
    if (rc == MODAL_OK)
        rc = search(s, b, list[0].converged ? list[0].X : NULL,
                    search_may_cost(s, known != NULL), &found, &ended, err);
    if (rc == MODAL_OK && found.count > 0) {
        /* The first way that led to any of them names all. */
        const char *method = list[0].converged ? list[0].method : "multi-start";

        struct budget work = known == NULL ? list[0].work : (struct budget){ 0 };

        steady_point_done(&list[0]);
        *count = 0;
        rc = points_of_all(s, b, &found, method, list, count, err);
        for (int i = 0; i < *count; i++)
            list[i].work = (struct budget) { .spent = work.spent + s->budget.spent,
                                             .most = work.most + s->budget.most };
    }
    list[0].unsought = ended;
    if (rc == MODAL_OK)
        rc = balance_set(b, omega, 1, err);
out:
    solutions_done(&found);
    if (rc != MODAL_OK) {
        for (int i = 0; list != NULL && i < *count; i++)
            steady_point_done(&list[i]);
        free(list);
        *count = 0;
        return rc;
    }
    *points = list;
    return MODAL_OK;
}

/* POINT, which did not converge, becomes BEST, which did with fewer harmonics; the counts stay
 * its own. */
static enum modal_status give_best(struct steady *s, struct steady_point *best,
                                   struct steady_point *point, struct modal_error *err)
{
    struct steady_point last = *point;
    struct balance *b;
    enum modal_status rc = steady_balance(s, best->H, &b, err);

    *point = *best;                                     /* motion, flags and errors */
    point->converged = false;
    point->fewer = true;                  /* its errors are known, though there is no proof of it */
    point->reason = "it closes with the harmonics given, but not with more";
    point->iterations = last.iterations;
    point->attempts = last.attempts;
    point->ffts = last.ffts;
    point->evaluations = last.evaluations;
    *best = last;
    best->evaluations = NULL;                           /* the point's, as its counts are */
    return rc == MODAL_OK ? balance_set(b, point->omega, 1, err)
        : rc;         /* recovery at this H */
}

/* Whether H is the last order that is tried with SHARE of the budget, and if all the work allowed
 * is what stops it, *WANTING.  SPENT: what H cost from near, at most; 0, unknown. */
static bool last_order(const struct steady *s, int H, int most, double share, double spent,
                       bool *wanting)
{
    double order = (double)condense_kept(s->c) * (4.0 * H + 1);
    bool full = condense_pattern(s->c)->full;

    /* Some steps, or what it cost and more. */
    double steps = STEPS_NEXT * steady_factor_work(s, 2 * H),
           next = spent == 0 ? steps : full ? fmin(steps, COST_FULL * spent) : COST_NEXT * spent;

    double linear = condense_work(s->c), allowed = WORK_LINEAR * (s->p->n - condense_kept(s->c));

    next += s->budget.spent;
    *wanting = next > s->budget.most                    /* the target's */
        || (linear > 0 && 2 * linear > allowed)         /* twice the harmonics */
        || (full && order > ORDER_AUTO_MOST);
    return H >= most || *wanting || next > share * s->budget.most
        || (s->opt.samples > 0 && 4 * H >= s->opt.samples);
}

/* H doubled, each from the last, until the estimate meets the target or the work allowed does not
 * reach for the next order, whose factors cost up to eight times as much; the best so far is the
 * answer.  Past the first H, more than ORDER_FAILED unknowns are tried from near alone; after
 * FAILED_MOST failures in a row, not at all.  COARSE, converged, or NULL: the best so far, whose
 * verdict is known. */
static enum modal_status solve_to_target(struct steady *s, double omega,
                                         const struct steady_start *start,
                                         const struct steady_point *coarse,
                                         struct steady_point *point, struct modal_error *err)
{
    double target = steady_target(s),
           share = s->opt.prefers_stable && coarse == NULL ? SHARE_OF_ORDERS : 1;
    int load = condense_highest_load(s->c), H = coarse != NULL ? 2 * coarse->H
                                                                : steady_first_order(s),
        most = H_AUTO_MOST > load ? H_AUTO_MOST : load;
    struct steady_point best = { 0 };
    int failed = 0;
    enum modal_status rc = coarse != NULL ? point_copy(coarse, &best, err) : MODAL_OK;

    for (bool last = false; rc == MODAL_OK && !last; H = 2 * H < most ? 2 * H : most) {
        /* from the best so far, not the start given */
        struct steady_start next = { best.q, best.H, best.X };
        double before = best.converged || s->jumps ? s->budget.spent : INFINITY;

        /* no ways round from a motion that is near */
        s->brief = best.attempts > 0 && condense_kept(s->c) * (2 * H + 1) > ORDER_FAILED;
        rc = solve_at(s, H, omega, best.converged ? &next : start, point, err);
        s->brief = false;
        if (rc != MODAL_OK)
            break;
        failed = point->converged ? 0 : failed + 1;     /* in a row */
        last = (point->converged && point->error <= target * point->amplitude)  /* (1) */
            || (failed >= FAILED_MOST && condense_kept(s->c) * (4 * H + 1) > ORDER_FAILED)
            || last_order(s, H, most, share, fmax(0, s->budget.spent - before), &point->wanting);
        best.attempts = point->attempts;                /* counted over all orders */
        if (point->converged && !last)
            rc = point_copy(point, &best, err);
        if (rc == MODAL_OK && last && !point->converged && best.converged)
            rc = give_best(s, &best, point, err);
    }
    steady_point_done(&best);
    if (rc == MODAL_OK && point->converged && point->error > point->amplitude) {
        point->converged = false;                       /* it tells nothing of the motion */
        point->fewer = true;
        point->reason = "it closes, but its error is larger than the motion";
    }
    return rc;
}

/* By time integration, for comparison: the last period's harmonics; its own errors are not
 * estimated. */
static enum modal_status solve_by_marching(struct steady *s, double omega,
                                           struct steady_point *point, struct modal_error *err)
{
    /* In the order of enum steady_method, from STEADY_RK4 on. */
    static const char *const names[] = { "rk4", "adaptive", "shooting" };
    int which = s->opt.method - STEADY_RK4, N = s->opt.samples > 0 ? s->opt.samples : MARCH_SAMPLES;
    int H = s->opt.harmonics > 0 ? s->opt.harmonics
            : (N - 1) / 2 < MARCH_HARMONICS ? (N - 1) / 2
                                            : MARCH_HARMONICS,
        q = condense_kept(s->c);
    double target = steady_target(s);
    struct march_options opt = { .method = (enum march_method)which,
                                 .samples = N,
                                 .periodic = target / PERIODIC,
                                 .cancelled = s->opt.cancelled,
                                 .tolerance = s->opt.tolerance > TOLERANCE_OF_STEPS
                                                  ? s->opt.tolerance
                                                  : target,
                                 .context = s->opt.context };
    struct march_report report;
    struct orbit_grid *g = NULL;
    double *x;
    struct balance *b;
    enum modal_status rc;

    if (condense_highest_load(s->c) > H)
        return modal_fail_field(err, MODAL_BAD_INPUT, "steady.samples",
                                "%d samples do not hold the excitation at harmonic %d", N,
                                condense_highest_load(s->c));
    x = malloc(((size_t)s->p->n * (size_t)N + 1) * sizeof *x);
    rc = x == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory")
                   : march_run(s->p, omega, &opt, x, &report, err);
    if (rc == MODAL_OK)
        rc = orbit_grid_new(N, &g, err);
    if (rc == MODAL_OK)
        rc = point_init(s, point, q, H, N, err);
    for (int i = 0; rc == MODAL_OK && i < q; i++)
        orbit_analyze(g, x + (size_t)condense_dofs(s->c)[i] * (size_t)N, H, point->X + i * (H + 1));
    if (rc == MODAL_OK)
        rc = steady_balance(s, H, &b, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, omega, 1, err);
    if (rc == MODAL_OK) {
        point->method = names[which];
        point->converged = report.converged;
        point->reason =
            report.converged ? NULL : "time integration did not reach a periodic motion";
        point->iterations = report.periods;
        point->step = report.change;
        point->residual = report.change;
        point->error = point->truncation = point->sampling = point->solver = NAN;
        for (int l = 0; l < point->laws; l++) {
            point->evaluations[l] = report.evaluations;
            point->acts[l] = true;                      /* not told apart in time */
        }
    }
    free(x);
    orbit_grid_free(g);
    return rc;
}

/* Whether laws may all be at rest, of their own accord: asked unless the method, the samples or a
 * motion in which they act is given. */
static bool may_rest(const struct steady *s, const struct steady_start *start)
{
    const struct steady_options *o = &s->opt;

    return o->method == STEADY_AUTO && o->samples == 0 && o->cutoff == 0 && !o->unlocated
        && !o->by_differences && !s->searching && (start == NULL || s->rested);
}

/* The motion in which every law rests: where there is none the point is not converged. */
static enum modal_status solve_at_rest(struct steady *s, double omega, struct steady_point *point,
                                       struct modal_error *err)
{
    bool found = false;
    double before;
    enum modal_status rc = MODAL_OK;

    if (!s->rest_asked)
        rc = at_rest_new(s->p, s->opt.dofs, s->opt.dofs_count, &s->rest, err);
    s->rest_asked = true;
    if (rc != MODAL_OK || s->rest == NULL)
        return rc;
    before = at_rest_work(s->rest);
    rc = point_init(s, point, condense_kept(s->c),
                    s->opt.harmonics > 0 ? s->opt.harmonics : at_rest_harmonics(s->rest), 0, err);
    if (rc == MODAL_OK)
        rc = at_rest_solve(s->rest, omega, point, &found, err);
    budget_add(&s->budget, at_rest_work(s->rest) - before);
    s->rested = rc == MODAL_OK && found;
    return rc;
}

/* The method that options and laws choose. */
static enum modal_status solve_any(struct steady *s, double omega, const struct steady_start *start,
                                   struct steady_point *point, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (s->linear)
        return linear_answer(s, omega, point, err);
    if (s->opt.method >= STEADY_RK4)
        return solve_by_marching(s, omega, point, err);
    if (may_rest(s, start))
        rc = solve_at_rest(s, omega, point, err);
    if (rc != MODAL_OK || point->converged)
        return rc;
    /* More harmonics than a quarter of the cycle's samples are not in them. */
    if (s->jumps && s->opt.method == STEADY_AUTO && cycle_takes(s->p)
        && s->opt.harmonics < CYCLE_SAMPLES / 4)
        rc = solve_by_cycle(s, omega, start, point, err);
    if (rc != MODAL_OK || point->converged)
        return rc;
    rc = s->opt.harmonics > 0 ? solve_at(s, s->opt.harmonics, omega, start, point, err)
                              : solve_to_target(s, omega, start, NULL, point, err);
    /* What repeats in time is an answer where no balance settles; nothing else is left to pay. */
    if (rc == MODAL_OK && !point->converged)
        rc = time_answer(s, omega, fmax(0, s->budget.most - s->budget.spent), point, err);
    time_forget(s);
    if (rc == MODAL_OK)
        rc = time_look(s, point, err);
    return rc;
}

enum modal_status steady_refine(struct steady *s, struct steady_point *point,
                                struct modal_error *err)
{
    struct steady_point fine = { .omega = point->omega, .level = 1 };
    struct budget work = point->work;
    struct balance *b;
    /* of a sparse order not all before it, which is no bound of the next */
    double spent = condense_pattern(s->c)->full ? point->work.spent : 0;
    enum modal_status rc = MODAL_OK;

    if (s->linear || s->jumps || point->followed || point->linear != NULL)
        return MODAL_OK;
    if (s->opt.harmonics == 0 && point->error > steady_target(s) * point->amplitude
        && !last_order(s, point->H, H_AUTO_MOST, 1, spent, &point->wanting)) {
        rc = solve_to_target(s, point->omega, NULL, point, &fine, err);
        work = s->budget;
    }
    if (rc == MODAL_OK && fine.converged && fine.error < point->error) {
        struct steady_point last = *point;

        *point = fine;
        point->method = last.method;
        fine = last;
    }
    point->work = work;
    steady_point_done(&fine);
    if (rc == MODAL_OK)
        rc = steady_balance(s, point->H, &b, err);
    return rc == MODAL_OK ? balance_set(b, point->omega, 1, err) : rc;  /* recovery at its order */
}

/* Every dof kept: the linear ones, held at the kept, resonate. */
static enum modal_status condense_nothing(struct steady *s, struct modal_error *err)
{
    struct condense *all;
    bool sparse = sparse_pays(s->p, &s->opt, s->p->n);
    enum modal_status rc = condense_new(s->p, sparse ? CONDENSE_SPARSE : CONDENSE_NONE, &all, err);

    if (rc != MODAL_OK)
        return rc;
    steady_drop_balances(s);                            /* they were of the other kept dofs */
    condense_free(s->c);
    s->c = all;
    return MODAL_OK;
}

/* No laws and a singular Lambda: the answer is that there is none. */
static enum modal_status no_linear_answer(struct steady *s, struct steady_point *point,
                                          struct modal_error *err)
{
    enum modal_status rc = point_init(s, point, condense_kept(s->c),
                                      s->opt.harmonics > 0 ? s->opt.harmonics : 1, 0, err);

    point->method = "linear";
    point->reason = "the linear equations are singular at an excited harmonic: an undamped "
                    "resonance, or a body that nothing holds";
    return rc;
}

enum modal_status steady_solve(struct steady *s, double omega, const struct steady_start *start,
                               struct steady_point *point, struct modal_error *err)
{
    struct modal_error singular;
    enum modal_status rc;

    memset(point, 0, sizeof *point);
    point->omega = omega;
    point->level = 1;
    steady_allow_work(s);
    if (!(omega > 0) || !isfinite(omega))
        return modal_fail_field(err, MODAL_BAD_INPUT, "omega",
                                "omega is %g; accepted: finite and > 0", omega);
    rc = solve_any(s, omega, start, point, &singular);
    /* Condensation failed: L_rr of condense.h, (2), is singular at some harmonic. */
    if (rc == MODAL_NO_CONVERGENCE && s->linear && s->p->harmonics == 0)
        rc = no_linear_answer(s, point, err);
    else if (rc == MODAL_NO_CONVERGENCE && condense_kept(s->c) < s->p->n) {
        rc = condense_nothing(s, err);
        if (rc == MODAL_OK)
            rc = solve_any(s, omega, NULL, point, err);
    } else if (rc != MODAL_OK && err != NULL)
        *err = singular;
    point->work = s->budget;
    if (rc != MODAL_OK)
        steady_point_done(point);
    return rc;
}

const struct budget *steady_work(const struct steady *s) { return &s->budget; }

enum modal_status steady_solve_attractor(struct steady *s, const struct steady_point *like,
                                         struct steady_point *point, bool *found,
                                         struct modal_error *err)
{
    struct balance *b;
    double complex *X = NULL;
    enum modal_status rc = steady_balance(s, like->H, &b, err);

    *found = false;
    memset(point, 0, sizeof *point);
    if (rc == MODAL_OK)
        X = calloc((size_t)b->q * ((size_t)b->H + 1) + 1, sizeof *X);
    if (rc == MODAL_OK)
        rc = X == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory")
                       : balance_set(b, like->omega, 1, err);
    if (rc == MODAL_OK)
        rc = time_attractor(s, b, X, found, err);
    if (rc == MODAL_OK && *found)
        rc = estimate_near(s, b, X, point, found, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, like->omega, 1, err);       /* recovery at this order */
    free(X);
    return rc;
}

enum modal_status steady_follow_attractor(struct steady *s, double omega,
                                          struct steady_point *point, bool *found,
                                          struct modal_error *err)
{
    enum modal_status rc;

    memset(point, 0, sizeof *point);
    point->omega = omega;
    point->level = 1;
    rc = time_answer(s, omega, 0, point, err);
    *found = rc == MODAL_OK && point->converged;
    point->attempts = 1;
    point->work = s->budget;
    return rc;
}
