/*
 * ways.c - see ways.h
 *
 * A table, at the end, of starts for Newton's method (iterate.h) on one balance R(X) = 0, (1) of
 * balance.h, gone through until one converges.  From rest its first step is the motion with every
 * law linearised there, sliders stuck.  With the laws left out, as sliders that slip all the time
 * nearly are, it is
 *
 *     X_k = S_k^-1 p_k                                                                          (1)
 *
 * [CG89, section 3.1].  With p scaled by a level, solutions of small and of large loads are near
 * that of rest and near (1): either is followed to level 1, each from the last.  Direct iteration
 * goes first only where its gain, slope max |S_k^-1|, is below GAIN_DIRECT.
 *
 * A ramp scales p by a level e^a, a from log LEVEL_LOW or log LEVEL_HIGH to 0, and begins each
 * level at the last one's X.  With a changed by s a motion in proportion to its load changes by e^s
 * - 1 of itself; one that changes by LEAP times that is on another branch, and the step is taken
 * again, shorter.  Laws whose forces grow in proportion are the same at every level.  Dampers to
 * the ground (balance.h) part them: with those of DAMPING_MOST waves that come back from far ends
 * and contacts that wake others are gone, and little is left but (1); they are taken away in
 * proportion down to DAMPING_LEAST,
 *
 *     damping = DAMPING_LEAST (e^a - 1),    a from log(DAMPING_MOST / DAMPING_LEAST) to 0.      (2)
 *
 * Springs of sliders are made softer, none stiffer than
 *
 *     k = e^a k_max,    a from log(|S| / k_max) to 0,                                           (3)
 *
 * k_max the stiffest of them and |S| the structure's own.  Where they are far stiffer a motion
 * tends to that of rigid friction, and changes by a share of 1 / k; Newton's method from afar, with
 * all that moves by |S| over k turned over at each step, finds none.
 *
 * To many harmonics the way is gone with few first: H_ROUGH, three times as many, and so on,
 * roughly, each the start of the next.  A short matrix is small in the cube, and what it leaves out
 * is small.
 *
 * [CG89] Cameron and Griffin, J. Appl. Mech. 56 (1989) 149-154.
 */
#include "modal/steady/ways.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"
#include "modal/steady/aft.h"
#include "modal/steady/balance.h"
#include "modal/steady/by_cycle.h"
#include "modal/steady/condense.h"
#include "modal/steady/iterate.h"
#include "modal/steady/pattern.h"
#include "modal/steady/session.h"
#include "modal/steady/solutions.h"
#include "modal/steady/stiffness.h"

enum {
    LEVELS_MOST = 60,       /* of a ramp, those that failed included */
    ITERATIONS_NEAR = 4,    /* that Newton's method takes from rest where laws are weak */
    H_ROUGH = 5,            /* the fewest harmonics that a start is sought with */
    H_TIMES = 3,            /* from one order of these to the next */
    ORDER_SMALL = 60,       /* unknowns up to which Newton's method costs less than a gain */
    H_FEW = 12,             /* up to which fewer harmonics are too few to be a way */
    FOLDS = 2,              /* levels that failed in a row, the second two fifths as far as the
                             * first, before the branch is followed around its folds */
    QUICK = 6,              /* iterations below which the step of a ramp grows */
    DIRECT_MOST = 1000,     /* iterations of the direct method, asked for */
    STEPS_OF_RAMP = 8       /* the first, of log(level) */
};
/* The gain below which direct iteration gains half a digit a step: no slower than factoring. */
static const double GAIN_DIRECT = 0.3;
/* Levels of the loads at which a ramp sets out: laws that are nearly linear about rest, or nearly
 * lost beside the loads. */
static const double LEVEL_LOW = 1e-3;
static const double LEVEL_HIGH = 1e3;
/* Dampers of balance_set_damping with which a ramp sets out: ten times a dof's stiffness leaves the
 * laws little to do; and those that are as good as none. */
static const double DAMPING_MOST = 10;
static const double DAMPING_LEAST = 1e-4;
/* The relative tolerance of a level on the way: the next begins further from its own solution. */
static const double ON_THE_WAY = 1e-3;
/* What the step of log(level) is multiplied by after a quick solution and after a failure. */
static const double GROW = 1.6;
static const double SHRINK = 0.4;
/* A step of log(level) this short has met a fold; a level this near 1, in its logarithm, is 1. */
static const double STEP_LEAST = 1e-4;
static const double ARRIVED = 1e-9;
/* A motion changes with its load in proportion; several times as much is another branch. */
static const double LEAP = 3;
/* The relative tolerance of the first, fewest harmonics; each order later is solved so many times
 * better, as harmonics fall that left out of it matter less. */
static const double ROUGH = 1e-2;
static const double ROUGHER = 5;
/* Of the budget, what each way along a branch of small loads may cost: other ways are left, and
 * other orders, where the branch is shorter. */
static const double SHARE_OF_WALK = 0.25;
/* (4) of iterate.c.  w is a bound of what few iterates show: of 900 random scenes of cubic and
 * square springs, taken to twice this, no answer was of another branch. */
static const double BEND_MOST = 2;
/* Laws left out are a start where they leave less than half of the residual of rest. */
static const double HALF_LEFT = 0.5;

/* One attempt's best iterate, kept if it is better than what POINT has. */
static void record(const struct balance *b, const double complex *X, const struct iterate_report *r,
                   const char *method, struct steady_point *point)
{
    point->attempts++;
    point->iterations += r->iterations;
    if (!r->converged && point->residual >= 0 && !(r->residual < point->residual))
        return;
    point->converged = r->converged;
    point->residual = r->residual;
    point->step = r->step;
    point->method = method;
    point->reason = r->converged ? NULL : r->reason;
    memcpy(point->X, X, (size_t)b->q * ((size_t)b->H + 1) * sizeof *X);
}

/* Newton's method from X, which becomes its last iterate. */
static enum modal_status try_newton(struct steady *s, struct balance *b, const char *method,
                                    double complex *X, struct steady_point *point,
                                    struct modal_error *err)
{
    struct iterate_options opt = steady_iterate_options(s);
    struct iterate_report r;
    enum modal_status rc = iterate_newton(b, &opt, X, &r, err);

    if (rc == MODAL_OK)
        record(b, X, &r, method, point);
    return rc;
}

/* Direct iteration, [CG89] (7), from X. */
static enum modal_status try_direct(struct steady *s, struct balance *b, double complex *X,
                                    struct steady_point *point, struct modal_error *err)
{
    struct iterate_options opt = steady_iterate_options(s);
    struct iterate_report r;
    enum modal_status rc;

    opt.most = s->opt.max_iterations > 0        ? s->opt.max_iterations
               : s->opt.method == STEADY_DIRECT ? DIRECT_MOST
                                                : 60;
    rc = iterate_direct(b, &opt, X, &r, err);
    if (rc == MODAL_OK)
        record(b, X, &r, "direct", point);
    return rc;
}

/* (1) where S is regular. */
static void laws_left_out(const struct balance *b, double complex *X)
{
    int q = b->q, K = b->H + 1;
    double complex *rhs = malloc(((size_t)q + 1) * sizeof *rhs);

    for (int k = 0; rhs != NULL && k < K; k++) {
        /* what no load drives rests, whatever S_k is */
        bool driven = numbers_modulus(b->load + k * q, (size_t)q) > 0;

        memcpy(rhs, b->load + k * q, (size_t)q * sizeof *rhs);
        if (!driven || stiffness_solve(b->stiffness, k, rhs))
            for (int i = 0; i < q; i++)
                X[i * K + k] = driven && isfinite(cabs(rhs[i])) ? rhs[i] : 0;
    }
    free(rhs);
}

/* Whether X lies further from GOOD than a motion in proportion to its load would, three times over:
 * another branch. */
static bool leaps(const double complex *X, const double complex *good, size_t size, double step)
{
    double far = 0, scale = 0;

    for (size_t i = 0; i < size; i++) {
        far = fmax(far, cabs(X[i] - good[i]));
        scale = fmax(scale, cabs(good[i]));
    }
    return far > LEAP * expm1(fabs(step)) * scale;
}

/* What a ramp changes, at a = AT. */
typedef enum modal_status set_ramp(struct balance *b, double at, struct modal_error *err);

/* e^AT of the loads. */
static enum modal_status set_level(struct balance *b, double at, struct modal_error *err)
{
    (void)err;
    balance_set_level(b, exp(at));
    return MODAL_OK;
}

/* The dampers of (2) at a = AT; none are none to the last bit. */
static enum modal_status set_damping(struct balance *b, double at, struct modal_error *err)
{
    balance_set_damping(b, DAMPING_LEAST * expm1(at));
    return at == 0 ? balance_set(b, b->omega, 1, err) : MODAL_OK;
}

/* (3) */
static enum modal_status set_softness(struct balance *b, double at, struct modal_error *err)
{
    return aft_soften(b->aft, at == 0 ? HUGE_VAL : exp(at) * aft_stiffest(b->aft), err);
}

/* Options of a search for the one solution that counts. */
static struct solutions_options for_one(const struct steady *s)
{
    return (struct solutions_options) { .most = 1, .cancelled = s->opt.cancelled,
                                        .context = s->opt.context };
}

/* The first of those FOUND, which are given back, by Newton's method; RC: whether they are. */
static enum modal_status try_first(struct steady *s, struct balance *b, enum modal_status rc,
                                   struct solutions *found, double complex *X,
                                   struct steady_point *point, struct modal_error *err)
{
    if (rc == MODAL_OK)
        rc = balance_set(b, b->omega, 1, err);
    if (rc == MODAL_OK && found->count > 0) {
        memcpy(X, found->X[0], (size_t)b->q * ((size_t)b->H + 1) * sizeof *X);
        rc = try_newton(s, b, "continuation", X, point, err);
    }
    solutions_done(found);
    return rc;
}

/* A ramp over the dampers has met a fold at a = AT, its solution GOOD: around it. */
static enum modal_status around_dampers(struct steady *s, struct balance *b, double at,
                                        const double complex *good, double complex *X,
                                        struct steady_point *point, struct modal_error *err)
{
    struct solutions_options opt = for_one(s);
    struct solutions found = { 0 };
    enum modal_status rc = solutions_along_damping(b, DAMPING_LEAST * expm1(at), good, &opt,
                                                   &found, err);

    return try_first(s, b, rc, &found, X, point, err);
}

/* From a = log FROM to 0, each from the last, SET what a stands for; the step of a shrinks on
 * failure and grows on success. */
static enum modal_status ramp(struct steady *s, struct balance *b, double from,
                              set_ramp *set, double complex *X, struct steady_point *point,
                              struct modal_error *err)
{
    struct iterate_options opt = steady_iterate_options(s);
    size_t size = (size_t)b->q * ((size_t)b->H + 1);
    double complex *good = calloc(size + 1, sizeof *good);
    double at = log(from), step = -at / STEPS_OF_RAMP, level_done = NAN;
    bool round = false;                                 /* folds were gone around */
    int failed = 0;                                     /* in a row */
    struct iterate_report r;
    enum modal_status rc = MODAL_OK;

    if (good == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a ramp");
    memset(X, 0, size * sizeof *X);
    if (from > 1) {
        rc = set(b, at, err);
        laws_left_out(b, X);
    }
    for (int i = 0; rc == MODAL_OK && i < LEVELS_MOST; i++) {
        rc = set(b, at, err);
        opt.rough = at != 0 && !b->pattern->full;       /* on the way nothing is an answer */
        opt.tolerance = opt.rough ? ON_THE_WAY : s->opt.tolerance;
        if (rc != MODAL_OK || (rc = iterate_newton(b, &opt, X, &r, err)) != MODAL_OK)
            break;
        point->iterations += r.iterations;
        if (r.converged && !isnan(level_done) && leaps(X, good, size, at - level_done))
            r.converged = false;                        /* the branch followed lies nearer */
        if (r.converged) {
            level_done = at;
            if (at == 0)
                break;
            memcpy(good, X, size * sizeof *X);
            step *= r.iterations < QUICK ? GROW : 1;
            failed = 0;
        } else {
            /* the first level failed: no branch to follow */
            if (isnan(level_done) || fabs(step) < STEP_LEAST)
                break;
            if (set == set_damping && ++failed == FOLDS && !round) {
                round = true;                           /* once */
                rc = around_dampers(s, b, level_done, good, X, point, err);
                if (point->converged)
                    break;
            }
            step *= SHRINK;
            memcpy(X, good, size * sizeof *X);
        }
        at = isnan(level_done) ? at : level_done + step;  /* in the logarithm */
        if ((from < 1 ? at > 0 : at < 0) || fabs(at) < ARRIVED)  /* past level 1 */
            at = 0;
    }
    if (rc == MODAL_OK)
        rc = balance_set(b, b->omega, 1, err);
    if (rc == MODAL_OK && level_done == 0 && r.converged)
        record(b, X, &r, "newton-ramped", point);
    free(good);
    return rc;
}

/* Around the folds of the branch over the level; its first crossing of 1. */
static enum modal_status along_levels(struct steady *s, struct balance *b, double complex *X,
                                      struct steady_point *point, struct modal_error *err)
{
    struct solutions_options opt = for_one(s);
    struct solutions found = { 0 };
    enum modal_status rc = solutions_along_levels(b, &opt, &found, err);

    return try_first(s, b, rc, &found, X, point, err);
}

/* What is begun now may spend its share of MOST, the whole budget. */
static void share_budget(struct steady *s, double most)
{
    s->budget.most = fmin(most, s->budget.spent + SHARE_OF_WALK * most);
}

/* Newton's method took long from rest, as when it leaps between solutions of smooth laws: the
 * branch that grows out of small loads is the one to give, at its first crossing of the load. */
static enum modal_status from_low(struct steady *s, struct balance *b, double complex *X,
                                  struct steady_point *point, struct modal_error *err)
{
    struct steady_point low = *point;
    size_t size = (size_t)b->q * ((size_t)b->H + 1);
    double most = s->budget.most;
    enum modal_status rc;

    low.X = calloc(size + 1, sizeof *low.X);
    if (low.X == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    low.converged = false;
    low.residual = -1;                                  /* no iterate yet */
    share_budget(s, most);
    rc = b->pattern->full ? MODAL_OK : ramp(s, b, LEVEL_LOW, set_level, X, &low, err);
    share_budget(s, most);
    if (rc == MODAL_OK && !low.converged && !b->pattern->full)
        rc = ramp(s, b, DAMPING_MOST / DAMPING_LEAST, set_damping, X, &low, err);
    share_budget(s, most);
    if (rc == MODAL_OK && !low.converged)
        rc = along_levels(s, b, X, &low, err);
    s->budget.most = most;
    if (rc == MODAL_OK && low.converged) {
        memcpy(point->X, low.X, size * sizeof *low.X);
        free(low.X);
        low.X = point->X;
        *point = low;
    } else
        free(low.X);
    return rc;
}

/* The start of balance B: what START holds; if that is nothing, the motion with the laws left out
 * ([CG89], section 3.1) where it balances better than rest, which it does where sliders slip.
 * *KNOWN: B's residual is that of the start. */
static enum modal_status rough_guess(struct balance *b, const struct steady_start *start,
                                     bool nothing, double complex *Y, bool *known,
                                     struct modal_error *err)
{
    enum modal_status rc;

    start_write(b, start, Y);
    *known = false;
    if (!nothing)
        return MODAL_OK;
    laws_left_out(b, Y);
    rc = balance_residual(b, Y, false, err);
    *known = rc == MODAL_OK && balance_relative_residual(b, Y) < HALF_LEFT;
    if (!*known)
        start_write(b, NULL, Y);
    return rc == MODAL_OVERFLOW ? MODAL_OK : rc;
}

/* X of balance B improved with H of its harmonics, to TOLERANCE, from rest if it is NOTHING; left
 * alone where that does not converge. */
static enum modal_status rough_level(struct steady *s, const struct balance *b, int H, double omega,
                                     double tolerance, bool nothing, double complex *X,
                                     struct steady_point *point, bool *ok, struct modal_error *err)
{
    struct iterate_options opt = steady_iterate_options(s);
    struct steady_start start = { b->q, b->H, X };
    struct iterate_report r = { 0 };
    struct balance *few;
    double complex *Y = NULL;
    enum modal_status rc = steady_balance(s, H, &few, err);

    *ok = false;
    if (rc == MODAL_OK && (Y = malloc(((size_t)few->q * ((size_t)H + 1) + 1) * sizeof *Y)) == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    if (rc == MODAL_OK)
        rc = balance_set(few, omega, 1, err);
    if (rc == MODAL_OK)
        rc = rough_guess(few, &start, nothing, Y, &opt.evaluated, err);
    if (rc == MODAL_OK) {
        opt.tolerance = tolerance;
        opt.rough = true;
        rc = iterate_newton(few, &opt, Y, &r, err);
    }
    if (rc == MODAL_OK && r.converged) {
        start = (struct steady_start) { few->q, H, Y };
        start_write(b, &start, X);
        point->iterations += r.iterations;
        s->slope = aft_slope(few->aft);               /* as good for the order of the next matrix */
        *ok = true;
    }
    free(Y);
    return rc;
}

/* X of balance B, not yet set, from START, or from rest: to many harmonics the way is gone with
 * few, roughly, then with three times as many, as long as that is far fewer. */
enum modal_status ways_begin(struct steady *s, const struct balance *b, double omega,
                             const struct steady_start *start, double complex *X,
                             struct steady_point *point, struct modal_error *err)
{
    int load = condense_highest_load(s->c), H = load + 1 > H_ROUGH ? load + 1 : H_ROUGH;
    double tolerance = ROUGH;
    bool ok = true, nothing = true;
    enum modal_status rc = MODAL_OK;

    start_write(b, start, X);
    if (start != NULL || s->opt.method == STEADY_DIRECT || !s->exact || s->opt.by_differences
        || s->opt.cutoff > 0)
        return MODAL_OK;
    for (; rc == MODAL_OK && ok && 2 * H <= b->H;
         H *= H_TIMES, tolerance /= ROUGHER, nothing = false)
        rc = rough_level(s, b, H, omega, tolerance, nothing, X, point, &ok, err);
    return rc;
}

/* Direct iteration, where its gain promises that it converges and the system is large enough for it
 * to pay. */
static enum modal_status try_gain(struct steady *s, struct balance *b, double complex *X,
                                  struct steady_point *point, struct modal_error *err)
{
    enum modal_status rc = s->slope > 0 ? MODAL_OK : balance_residual(b, X, false, err);

    if (rc == MODAL_OK
        && iterate_gain(b, s->slope > 0 ? s->slope : aft_slope(b->aft)) < GAIN_DIRECT)
        rc = try_direct(s, b, X, point, err);
    return rc;
}

/* Newton's method anew from rest, or from the motion with the laws left out. */
static enum modal_status try_again(struct steady *s, struct balance *b, bool left_out,
                                   double complex *X, struct steady_point *point,
                                   struct modal_error *err)
{
    memset(X, 0, (size_t)b->q * ((size_t)b->H + 1) * sizeof *X);
    if (left_out)
        laws_left_out(b, X);
    return try_newton(s, b, "newton", X, point, err);
}

/* A coarse balance's answer as the start of B. */
static enum modal_status fewer_harmonics(struct steady *s, struct balance *b, double complex *X,
                                         struct steady_point *point, struct modal_error *err)
{
    int H = b->H / H_TIMES > condense_highest_load(s->c) ? b->H / H_TIMES
                                                         : condense_highest_load(s->c);
    struct balance *few;
    struct steady_point sub = { .residual = -1 };
    struct steady_start start;
    enum modal_status rc;

    H = H < H_ROUGH ? H_ROUGH : H;
    if (H >= b->H || s->opt.samples > 0)
        return MODAL_OK;
    rc = steady_balance(s, H, &few, err);
    if (rc != MODAL_OK)
        return rc;
    sub.X = calloc((size_t)few->q * ((size_t)H + 1) + 1, sizeof *sub.X);  /* its best iterate */
    if (sub.X == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    rc = ways_begin(s, few, b->omega, NULL, X, &sub, err);
    if (rc == MODAL_OK)
        rc = balance_set(few, b->omega, 1, err);
    if (rc == MODAL_OK)
        rc = ways_try(s, few, NULL, X, &sub, err);
    s->current = false;
    point->iterations += sub.iterations;
    if (rc == MODAL_OK)
        rc = balance_set(b, b->omega, 1, err);
    if (rc == MODAL_OK && sub.converged) {
        start = (struct steady_start) { few->q, H, sub.X };
        start_write(b, &start, X);
        rc = try_newton(s, b, "newton-extended", X, point, err);
    }
    free(sub.X);
    return rc;
}

/* One balance on its way to a solution. */
struct attempt {
    struct steady *s;
    struct balance *b;
    const struct steady_start *start;   /* NULL: from rest */
    double complex *X;                  /* filled by ways_begin from it, the next way's start */
    struct steady_point *point;
    bool ended;                         /* nothing is tried after this way */
    bool rested;                        /* Newton's method set out from rest */
    bool nearest;                       /* and nothing lies between that and its end */
    bool timed;                         /* a motion in time was sought */
    bool ramped;                        /* loads were ramped up and dampers down */
    bool stiffened;                     /* laws were ramped up from soft ones */
    bool walked;                        /* the branch over levels was followed */
    bool fewer;                         /* fewer harmonics were tried */
};

/* The ways that are gone until one has converged. */
static bool unsolved(const struct attempt *a) { return !a->point->converged; }

/* The same of those that set out from rest: not after a motion in time that closes. */
static bool may_rise(const struct attempt *a)
{
    return unsolved(a) && !(a->timed && time_closed(a->s));
}

/* Nothing is near, and all ways from far are dear with so many harmonics of so many dofs. */
static bool is_wide(const struct attempt *a)
{
    size_t size = (size_t)a->b->q * ((size_t)a->b->H + 1);

    return a->s->opt.method == STEADY_AUTO && !a->b->pattern->full && a->b->H > H_FEW
        && a->start == NULL && !a->s->jumps && a->s->opt.max_iterations == 0
        && numbers_modulus(a->X, size) == 0;
}

/* Direct iteration is what was asked for. */
static bool is_direct(const struct attempt *a) { return a->s->opt.method == STEADY_DIRECT; }

/* From (1), or the start given. */
static enum modal_status direct_alone(struct attempt *a, struct modal_error *err)
{
    if (a->start == NULL)
        laws_left_out(a->b, a->X);
    a->ended = true;
    return try_direct(a->s, a->b, a->X, a->point, err);
}

/* Small systems are solved by Newton's method sooner than a gain is found. */
static bool is_large(const struct attempt *a)
{
    return a->s->opt.method == STEADY_AUTO && a->b->order > ORDER_SMALL
           && !a->s->opt.by_differences;
}

/* An overflow on the way is no failure of the job, but nothing else is tried. */
static enum modal_status direct_by_gain(struct attempt *a, struct modal_error *err)
{
    enum modal_status rc = try_gain(a->s, a->b, a->X, a->point, err);

    a->ended = rc != MODAL_OK;
    return rc == MODAL_OVERFLOW ? MODAL_OK : rc;
}

/* Its last residual is that of the answer, which need not be evaluated again. */
static enum modal_status newton_near(struct attempt *a, struct modal_error *err)
{
    struct iterate_options opt = steady_iterate_options(a->s);
    struct iterate_report r;
    enum modal_status rc;

    a->rested = numbers_modulus(a->X, (size_t)a->b->q * ((size_t)a->b->H + 1)) == 0;
    rc = iterate_newton(a->b, &opt, a->X, &r, err);
    if (rc == MODAL_OK)
        record(a->b, a->X, &r, "newton", a->point);
    a->s->current = rc == MODAL_OK && a->point->converged;
    a->nearest = a->rested && a->s->current && r.bend < BEND_MOST;
    return rc;
}

/* Whether Newton's method may have leapt between the solutions of smooth laws: from rest h_0 of (4)
 * of iterate.c falls with the load, and where it is small the solution is that of the branch out of
 * rest. */
static bool may_have_leapt(const struct attempt *a)
{
    return a->s->opt.method == STEADY_AUTO && a->start == NULL && a->s->degree > 0 && !a->s->exact
        && a->point->iterations > ITERATIONS_NEAR && !a->nearest
        && !(a->fewer && a->point->converged);
}

/* Whatever converged, the branch of small loads is preferred. */
static enum modal_status branch_from_low(struct attempt *a, struct modal_error *err)
{
    a->s->current = false;
    a->ramped = !a->b->pattern->full;
    a->walked = true;
    return from_low(a->s, a->b, a->X, a->point, err);
}

/* Rest has been tried already where no start was given. */
static bool had_start(const struct attempt *a) { return unsolved(a) && a->start != NULL; }

/* X = 0: what was near led nowhere. */
static enum modal_status newton_from_rest(struct attempt *a, struct modal_error *err)
{
    return try_again(a->s, a->b, false, a->X, a->point, err);
}

/* From (1), which Newton's first step from rest led to where laws have no slope there, as gaps. */
static enum modal_status newton_without_laws(struct attempt *a, struct modal_error *err)
{
    size_t size = (size_t)a->b->q * ((size_t)a->b->H + 1);
    enum modal_status rc = MODAL_OK;

    memset(a->X, 0, size * sizeof *a->X);
    if (a->rested && (rc = balance_residual(a->b, a->X, false, err)) == MODAL_OK
        && aft_slope(a->b->aft) == 0 && numbers_modulus(a->b->F, size) == 0)
        return MODAL_OK;
    if (rc != MODAL_OK && rc != MODAL_OVERFLOW)
        return rc;
    return try_again(a->s, a->b, true, a->X, a->point, err);
}

/* What stops has no balance to ramp to. */
static bool may_go_far(const struct attempt *a)
{
    return unsolved(a) && !a->s->jumps && !a->s->brief;
}

/* Where a motion in time stands ready to be the answer (by_cycle.h), what its balance lacks are
 * harmonics, and no way from afar. */
static bool goes_round(const struct attempt *a)
{
    return may_go_far(a) && !time_closed(a->s);
}

/* Enough harmonics for a third of them to be a problem of its own. */
static bool has_many_harmonics(const struct attempt *a)
{
    return goes_round(a) && a->b->H > H_FEW && !a->fewer;
}

/* A third of the harmonics, by all ways; then the rest from it. */
static enum modal_status from_fewer(struct attempt *a, struct modal_error *err)
{
    a->fewer = true;
    return fewer_harmonics(a->s, a->b, a->X, a->point, err);
}

/* Nobody has said how, or how long, to look, and it was not looked before. */
static bool is_free(const struct attempt *a)
{
    const struct steady_options *o = &a->s->opt;

    return may_go_far(a) && o->method == STEADY_AUTO && o->max_iterations == 0 && !a->timed;
}

/* A ramp of many dofs is cheaper than their motion in time; of few, the motion. */
static bool is_small(const struct attempt *a) { return is_free(a) && a->b->pattern->full; }

/* It was sought for another order, and found. */
static bool is_ready(const struct attempt *a) { return is_free(a) && time_closed(a->s); }

/* The motion that is reached in time, as far as the balance has its harmonics. */
static enum modal_status from_time(struct attempt *a, struct modal_error *err)
{
    bool found;
    enum modal_status rc;

    a->timed = true;
    rc = time_start(a->s, a->b, a->start, a->X, &found, err);
    if (rc == MODAL_OK && found)
        rc = try_newton(a->s, a->b, "newton", a->X, a->point, err);
    return rc;
}

/* Neither ramp was gone. */
static bool may_ramp(const struct attempt *a) { return goes_round(a) && !a->ramped; }

/* The branch was not followed. */
static bool may_walk(const struct attempt *a) { return goes_round(a) && !a->walked; }

/* Of few dofs the motion in time was sought already, which leads to as many. */
static bool may_damp(const struct attempt *a) { return may_ramp(a) && !a->b->pattern->full; }

/* A ramp that may spend its share, as others are left. */
static enum modal_status ramp_within(struct attempt *a, double from, set_ramp *set,
                                     struct modal_error *err)
{
    double most = a->s->budget.most;
    enum modal_status rc;

    share_budget(a->s, most);
    rc = ramp(a->s, a->b, from, set, a->X, a->point, err);
    a->s->budget.most = most;
    return rc;
}

/* With dampers that are taken away again, */
static enum modal_status damp_down(struct attempt *a, struct modal_error *err)
{
    return ramp_within(a, DAMPING_MOST / DAMPING_LEAST, set_damping, err);
}

/* The stiffness of the kept dofs, the largest. */
static double structure_stiffness(const struct balance *b)
{
    size_t entries = (size_t)pattern_entries(b->pattern);
    double most = 0;

    for (int i = 0; i < b->q; i++) {
        const double complex *S = b->S + pattern_find(b->pattern, i, i);

        most = fmax(most, fmax(fabs(creal(S[0])), b->H > 0 ? fabs(creal(S[entries])) : 0));
    }
    return most;
}

/* Some law has a stiffer spring; beside no stiffness at all it is stiff by no measure. */
static bool is_stiff(const struct attempt *a)
{
    return goes_round(a) && a->s->exact && !a->stiffened && structure_stiffness(a->b) > 0
        && aft_stiffest(a->b->aft) > structure_stiffness(a->b);
}

/* With springs of the laws that grow stiffer, */
static enum modal_status stiffen(struct attempt *a, struct modal_error *err)
{
    enum modal_status rc, back;

    a->stiffened = true;
    rc = ramp_within(a, structure_stiffness(a->b) / aft_stiffest(a->b->aft), set_softness, err);
    back = aft_soften(a->b->aft, HUGE_VAL, err);
    return rc == MODAL_OK ? back : rc;
}

/* Level by level from loads that leave the laws linear, */
static enum modal_status ramp_up(struct attempt *a, struct modal_error *err)
{
    return ramp_within(a, LEVEL_LOW, set_level, err);
}

/* from loads beside which the laws are lost, */
static enum modal_status ramp_down(struct attempt *a, struct modal_error *err)
{
    return ramp_within(a, LEVEL_HIGH, set_level, err);
}

/* and along the branch, around its folds (path.h). */
static enum modal_status over_levels(struct attempt *a, struct modal_error *err)
{
    struct budget *budget = &a->s->budget;
    double most = budget->most;
    enum modal_status rc;

    share_budget(a->s, most);
    rc = along_levels(a->s, a->b, a->X, a->point, err);
    budget->most = most;
    return rc;
}

/* The ways, in the order they are gone: near ones first, cheap before costly. */
static const struct {
    bool (*applies)(const struct attempt *a);
    enum modal_status (*go)(struct attempt *a, struct modal_error *err);
} ways[] = {
    { is_direct,          direct_alone },         /* as asked for, and nothing else */
    { is_large,           direct_by_gain },       /* where its gain promises that it converges */
    { is_wide,            from_fewer },
    { is_ready,           from_time },            /* settle.h */
    { may_rise,           newton_near },
    { may_have_leapt,     branch_from_low },      /* though it converged */
    { had_start,          newton_from_rest },
    { may_rise,           newton_without_laws },  /* [CG89], section 3.1 */
    { is_small,           from_time },
    { has_many_harmonics, from_fewer },
    { may_damp,           damp_down },            /* cheap, and of any law */
    { is_stiff,           stiffen },
    { may_ramp,           ramp_up },
    { goes_round,         ramp_down },
    { is_free,            from_time },
    { may_walk,           over_levels },
};

enum modal_status ways_try(struct steady *s, struct balance *b, const struct steady_start *start,
                           double complex *X, struct steady_point *point, struct modal_error *err)
{
    struct attempt a = { .s = s, .b = b, .start = start, .X = X, .point = point };
    enum modal_status rc = MODAL_OK;

    for (size_t i = 0; rc == MODAL_OK && !a.ended && i < sizeof ways / sizeof *ways; i++)
        if (ways[i].applies(&a))
            rc = ways[i].go(&a, err);
    return rc;
}
