/*
 * ways.c - see ways.h
 *
 * Attempts, in order, until one converges: Newton (or direct iteration) from the given start; Newton from rest, whose
 * first step is the motion with every law linearised at rest (sliders stuck); from the motion with the laws left out
 * ([CG89], section 3.1); the load ramped up from LEVEL_LOW and down from LEVEL_HIGH, each level from the last; and fewer
 * harmonics first.  Direct iteration goes first only where its gain, slope max |S_k^-1|, is below GAIN_DIRECT.
 *
 * [CG89] Cameron and Griffin, J. Appl. Mech. 56 (1989) 149-154.
 */
#include "modal/steady/ways.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/steady/iterate.h"
#include "modal/steady/solutions.h"

enum { LEVELS_MOST = 60, FEW = 4, H_ROUGH = 5 };
static const double GAIN_DIRECT = 0.3, LEVEL_LOW = 1e-3, LEVEL_HIGH = 1e3, ROUGH = 1e-2, HALF = 0.5, ROUGHER = 5, ON_THE_WAY = 1e-3;

/* One attempt's best iterate, kept if it is better than what POINT has. */
static void record(const struct balance *b, const double complex *X, const struct iterate_report *r, const char *method,
                 struct steady_point *point)
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

static enum modal_status try_newton(struct steady *s, struct balance *b, const char *method, double complex *X,
                                    struct steady_point *point, struct modal_error *err)
{
    struct iterate_options opt = steady_iterate_options(s);
    struct iterate_report r;
    enum modal_status rc = iterate_newton(b, &opt, X, &r, err);

    if (rc == MODAL_OK)
        record(b, X, &r, method, point);
    return rc;
}

static enum modal_status try_direct(struct steady *s, struct balance *b, double complex *X, struct steady_point *point,
                                    struct modal_error *err)
{
    struct iterate_options opt = steady_iterate_options(s);
    struct iterate_report r;
    enum modal_status rc;

    opt.most = s->opt.max_iterations > 0 ? s->opt.max_iterations : s->opt.method == STEADY_DIRECT ? 1000 : 60;
    rc = iterate_direct(b, &opt, X, &r, err);
    if (rc == MODAL_OK)
        record(b, X, &r, "direct", point);
    return rc;
}

/* S^-1 p where S is regular: the laws left out. */
static void laws_left_out(const struct balance *b, double complex *X)
{
    int q = b->q, K = b->H + 1;
    double complex *rhs = malloc(((size_t)q + 1) * sizeof *rhs);

    for (int k = 0; rhs != NULL && k < K; k++) {
        memcpy(rhs, b->load + k * q, (size_t)q * sizeof *rhs);
        if (stiffness_solve(b->stiffness, k, rhs))
            for (int i = 0; i < q; i++)
                X[i * K + k] = isfinite(cabs(rhs[i])) ? rhs[i] : 0;
    }
    free(rhs);
}

/* Whether X lies further from GOOD than a motion in proportion to its load would, three times over: another branch. */
static bool leaps(const double complex *X, const double complex *good, size_t size, double step)
{
    double far = 0, scale = 0;

    for (size_t i = 0; i < size; i++) {
        far = fmax(far, cabs(X[i] - good[i]));
        scale = fmax(scale, cabs(good[i]));
    }
    return far > 3 * expm1(fabs(step)) * scale;
}

/* From level FROM to 1, each from the last; the step of log(level) halves on failure and grows on success. */
static enum modal_status ramp(struct steady *s, struct balance *b, double from, double complex *X, struct steady_point *point,
                              struct modal_error *err)
{
    struct iterate_options opt = steady_iterate_options(s);
    size_t size = (size_t)b->q * ((size_t)b->H + 1);
    double complex *good = calloc(size + 1, sizeof *good);
    double at = log(from), step = -at / 8, level_done = NAN;
    struct iterate_report r;
    enum modal_status rc = MODAL_OK;

    if (good == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a ramp");
    memset(X, 0, size * sizeof *X);
    if (from > 1) {
        rc = balance_set(b, b->omega, from, err);
        if (rc == MODAL_OK)
            laws_left_out(b, X);
    }
    for (int i = 0; rc == MODAL_OK && i < LEVELS_MOST; i++) {
        balance_set_level(b, exp(at));
        opt.rough = at != 0 && !b->pattern->full;
        opt.tolerance = opt.rough ? ON_THE_WAY : s->opt.tolerance;
        if ((rc = iterate_newton(b, &opt, X, &r, err)) != MODAL_OK)
            break;
        point->iterations += r.iterations;
        if (r.converged && !isnan(level_done) && leaps(X, good, size, at - level_done))
            r.converged = false;
        if (r.converged) {
            level_done = at;
            if (at == 0)
                break;
            memcpy(good, X, size * sizeof *X);
            step *= r.iterations < 6 ? 1.6 : 1;
        } else {
            if (isnan(level_done) || fabs(step) < 1e-4)
                break;
            step *= 0.4;
            memcpy(X, good, size * sizeof *X);
        }
        at = isnan(level_done) ? at : level_done + step;
        if ((from < 1 ? at > 0 : at < 0) || fabs(at) < 1e-9)
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
static enum modal_status along_levels(struct steady *s, struct balance *b, double complex *X, struct steady_point *point,
                                      struct modal_error *err)
{
    struct solutions_options opt = { .most = 1, .cancelled = s->opt.cancelled, .context = s->opt.context };
    struct solutions found = { 0 };
    enum modal_status rc = solutions_along_levels(b, &opt, &found, err);

    if (rc == MODAL_OK)
        rc = balance_set(b, b->omega, 1, err);
    if (rc == MODAL_OK && found.count > 0) {
        memcpy(X, found.X[0], (size_t)b->q * ((size_t)b->H + 1) * sizeof *X);
        rc = try_newton(s, b, "continuation", X, point, err);
    }
    solutions_done(&found);
    return rc;
}

/* Newton's method took long from rest, as when it leaps between solutions of smooth laws: the branch that grows out of small
 * loads is the one to give, at its first crossing of the load. */
static enum modal_status from_low(struct steady *s, struct balance *b, double complex *X, struct steady_point *point, struct modal_error *err)
{
    struct steady_point low = *point;
    size_t size = (size_t)b->q * ((size_t)b->H + 1);
    enum modal_status rc;

    low.X = calloc(size + 1, sizeof *low.X);
    if (low.X == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    low.converged = false;
    low.residual = -1;
    rc = b->pattern->full ? MODAL_OK : ramp(s, b, LEVEL_LOW, X, &low, err);
    if (rc == MODAL_OK && !low.converged)
        rc = along_levels(s, b, X, &low, err);
    if (rc == MODAL_OK && low.converged) {
        memcpy(point->X, low.X, size * sizeof *low.X);
        free(low.X);
        low.X = point->X;
        *point = low;
    } else
        free(low.X);
    return rc;
}

/* The start of balance B: what START holds; if that is nothing, the motion with the laws left out ([CG89], section 3.1) where it balances
 * better than rest, which it does where sliders slip.  *KNOWN: B's residual is that of the start. */
static enum modal_status rough_guess(struct balance *b, const struct steady_start *start, bool nothing, double complex *Y, bool *known,
                                     struct modal_error *err)
{
    enum modal_status rc;

    start_write(b, start, Y);
    *known = false;
    if (!nothing)
        return MODAL_OK;
    laws_left_out(b, Y);
    rc = balance_residual(b, Y, false, err);
    *known = rc == MODAL_OK && balance_relative_residual(b, Y) < HALF;
    if (!*known)
        start_write(b, NULL, Y);
    return rc == MODAL_OVERFLOW ? MODAL_OK : rc;
}

/* X of balance B improved with H of its harmonics, to TOLERANCE, from rest if it is NOTHING; left alone where that does not converge. */
static enum modal_status rough_level(struct steady *s, const struct balance *b, int H, double omega, double tolerance, bool nothing, double complex *X,
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
        s->slope = aft_slope(few->aft);
        *ok = true;
    }
    free(Y);
    return rc;
}

/* X of balance B, not yet set, from START, or from rest: to many harmonics the way is gone with few, roughly, then with three times as
 * many, as long as that is far fewer. */
enum modal_status ways_begin(struct steady *s, const struct balance *b, double omega, const struct steady_start *start, double complex *X,
                               struct steady_point *point, struct modal_error *err)
{
    int load = condense_highest_load(s->c), H = load + 1 > H_ROUGH ? load + 1 : H_ROUGH;
    double tolerance = ROUGH;
    bool ok = true, nothing = true;
    enum modal_status rc = MODAL_OK;

    start_write(b, start, X);
    if (start != NULL || s->opt.method == STEADY_DIRECT || !s->exact || s->opt.by_differences || s->opt.cutoff > 0)
        return MODAL_OK;
    for (; rc == MODAL_OK && ok && 2 * H <= b->H; H *= 3, tolerance /= ROUGHER, nothing = false)
        rc = rough_level(s, b, H, omega, tolerance, nothing, X, point, &ok, err);
    return rc;
}

/* Direct iteration, where its gain promises that it converges and the system is large enough for it to pay. */
static enum modal_status try_gain(struct steady *s, struct balance *b, double complex *X, struct steady_point *point, struct modal_error *err)
{
    enum modal_status rc = s->slope > 0 ? MODAL_OK : balance_residual(b, X, false, err);

    if (rc == MODAL_OK && iterate_gain(b, s->slope > 0 ? s->slope : aft_slope(b->aft)) < GAIN_DIRECT)
        rc = try_direct(s, b, X, point, err);
    return rc;
}

/* Newton's method anew from rest, or from the motion with the laws left out. */
static enum modal_status try_again(struct steady *s, struct balance *b, bool left_out, double complex *X, struct steady_point *point,
                                   struct modal_error *err)
{
    memset(X, 0, (size_t)b->q * ((size_t)b->H + 1) * sizeof *X);
    if (left_out)
        laws_left_out(b, X);
    return try_newton(s, b, "newton", X, point, err);
}

/* A coarse balance's answer as the start of B. */
static enum modal_status fewer_harmonics(struct steady *s, struct balance *b, double complex *X, struct steady_point *point,
                                         struct modal_error *err)
{
    int H = b->H / 3 > condense_highest_load(s->c) ? b->H / 3 : condense_highest_load(s->c);
    struct balance *few;
    struct steady_point sub = { .residual = -1 };
    struct steady_start start;
    enum modal_status rc;

    H = H < 5 ? 5 : H;
    if (H >= b->H || s->opt.samples > 0)
        return MODAL_OK;
    rc = steady_balance(s, H, &few, err);
    if (rc != MODAL_OK)
        return rc;
    sub.X = calloc((size_t)few->q * ((size_t)H + 1) + 1, sizeof *sub.X);
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

/* What is left when Newton's method fails from everywhere near: ways in from other orders and levels. */
static enum modal_status roundabout(struct steady *s, struct balance *b, double complex *X, struct steady_point *point, struct modal_error *err)
{
    enum modal_status rc = b->H > 12 ? fewer_harmonics(s, b, X, point, err) : MODAL_OK;

    if (rc == MODAL_OK && !point->converged)
        rc = ramp(s, b, LEVEL_LOW, X, point, err);
    if (rc == MODAL_OK && !point->converged)
        rc = ramp(s, b, LEVEL_HIGH, X, point, err);
    if (rc == MODAL_OK && !point->converged)
        rc = along_levels(s, b, X, point, err);
    return rc;
}

/* From X, which `ways_begin` has filled from START. */
enum modal_status ways_try(struct steady *s, struct balance *b, const struct steady_start *start, double complex *X,
                                  struct steady_point *point, struct modal_error *err)
{
    enum steady_method method = s->opt.method;
    enum modal_status rc = MODAL_OK;

    if (method == STEADY_DIRECT) {
        if (start == NULL)
            laws_left_out(b, X);
        return try_direct(s, b, X, point, err);
    }
    if (method == STEADY_AUTO && b->order > 60 && !s->opt.by_differences && (rc = try_gain(s, b, X, point, err)) != MODAL_OK)
        return rc == MODAL_OVERFLOW ? MODAL_OK : rc;
    if (!point->converged) {
        rc = try_newton(s, b, "newton", X, point, err);
        s->current = rc == MODAL_OK && point->converged;
    }
    if (rc == MODAL_OK && method == STEADY_AUTO && start == NULL && s->degree > 0 && !s->exact && point->iterations > FEW) {
        s->current = false;
        rc = from_low(s, b, X, point, err);
    }
    if (rc == MODAL_OK && !point->converged && start != NULL)
        rc = try_again(s, b, false, X, point, err);
    if (rc == MODAL_OK && !point->converged)
        rc = try_again(s, b, true, X, point, err);
    if (rc == MODAL_OK && !point->converged && !s->jumps && !s->brief)    /* what stops has no balance to ramp to */
        rc = roundabout(s, b, X, point, err);
    return rc;
}
