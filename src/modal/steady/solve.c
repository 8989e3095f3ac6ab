/*
 * solve.c - from a program to one steady state
 *
 * Attempts, in order, until one converges: Newton (or direct iteration) from the given start; Newton from rest, whose
 * first step is the motion with every law linearised at rest (sliders stuck); from the motion with the laws left out
 * ([CG89], section 3.1); the load ramped up from LEVEL_LOW and down from LEVEL_HIGH, each level from the last; and fewer
 * harmonics first.  Direct iteration goes first only where its gain, slope max |S_k^-1|, is below GAIN_DIRECT.
 *
 * Errors.  Let X solve the balance at H and N, and let E extend it: harmonics H+1 .. H2 by one direct iteration
 *
 *     E_k = S_k^-1 (p_k - F_k(X)),   H < k <= H2,                                                       (1)
 *
 * F_k beyond H from exact pieces or from finer samples, and the first H corrected by one chord step
 *
 *     E_low = X - J^-1 R_low(X + tail),                                                                 (2)
 *
 * R with N2 samples.  Then E - X estimates the whole error to first order in it; with the tail left out of (2), E' - X is the
 * sampling's part and E - E' the truncation's; a last Newton step's is the solver's.  Each is put in the unit of x as max over time and dofs.
 *
 * [CG89] Cameron and Griffin, J. Appl. Mech. 56 (1989) 149-154.
 */
#include "modal/steady/solve.h"
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/steady/cycle.h"
#include "modal/steady/iterate.h"
#include "modal/steady/march.h"
#include "modal/steady/solutions.h"

enum { REDUCE_LEAST = 48, H_AUTO_MOST = 256, H_LINEAR_MOST = 4096, N_LEAST = 64, N_MOST = 1 << 17,
       LEVELS_MOST = 60, BALANCES = 24, EXTENSIONS = 5, EXTENSIONS_OF_JUMPS = 40, SHARP = 2048,
       H_CYCLE_MOST = 1024, FEW = 4, H_ROUGH = 5, SPARSE_LEAST = 10, SPARSE_LINEAR = 100,
       FAILED_MOST = 2, ORDER_FAILED = 600, ORDER_AUTO_MOST = 3000, H_SEARCH = 8, SEARCHES = 3600,
       ASKED = 100 };
static const double GAIN_DIRECT = 0.3, LEVEL_LOW = 1e-3, LEVEL_HIGH = 1e3, TARGET = 1e-6,
    ROUGH = 1e-2, HALF = 0.5, ROUGHER = 5, ON_THE_WAY = 1e-3, WORK = 3e9;

struct steady {
    const struct program *p;
    struct steady_options opt;
    struct condense *c;
    bool exact, linear;         /* every law has pieces; there is none */
    int degree;                 /* the largest of polynomial laws; 0: none */
    bool sampled;               /* some law is neither */
    bool jumps;                 /* rigid friction, located */
    bool brief;                 /* fewer harmonics were tried and these are costly: Newton's method from near, no ways round */
    bool current;               /* the last residual of the balance at hand was of the point's X */
    double slope;               /* the laws' largest, as the last rough start showed it; 0: not yet */
    struct balance *balance[BALANCES];
    int balances;
    struct budget budget;       /* of the solution under way */
};

static int power_of_two(long least)
{
    int N = 1;

    while (N < least && N < N_MOST)
        N *= 2;
    return N;
}

/* A power of two, or three quarters of one, which transforms as fast a sample. */
static int short_product(long least)
{
    int N = power_of_two(least);

    return N / 4 * 3 >= least && N > N_LEAST ? N / 4 * 3 : N;
}

int steady_samples(const struct steady *s, int H)
{
    long least = N_LEAST;

    if (s->opt.samples > 0)
        return s->opt.samples;
    least = 4 * H + 2 > least ? 4 * H + 2 : least;
    if (s->degree > 0 && (s->degree + 1) * H + 1 > least)
        least = (s->degree + 1) * H + 1;
    if (s->sampled && 32 * H > least)
        least = 32 * H;
    return short_product(least);
}

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

static enum modal_status check_options(const struct steady *s, struct modal_error *err)
{
    const struct steady_options *o = &s->opt;
    int most = s->linear ? H_LINEAR_MOST : ORBIT_HARMONICS_MOST;

    if (o->harmonics < 0 || o->harmonics > most)
        return modal_fail_field(err, MODAL_BAD_INPUT, "steady.harmonics", "%d harmonics; accepted: 1 to %d", o->harmonics, most);
    if (o->samples < 0 || o->samples > ORBIT_SAMPLES_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "steady.samples", "%d samples; accepted: 3 to %d", o->samples, ORBIT_SAMPLES_MOST);
    if (o->harmonics > 0 && o->samples > 0 && o->samples <= 2 * o->harmonics)
        return modal_fail_field(err, MODAL_BAD_INPUT, "steady.samples", "%d samples cannot carry %d harmonics; accepted: at least %d", o->samples, o->harmonics, 2 * o->harmonics + 1);
    if (o->harmonics > 0 && condense_highest_load(s->c) > o->harmonics)
        return modal_fail_field(err, MODAL_BAD_INPUT, "steady.harmonics", "%d harmonics do not hold the excitation at harmonic %d; accepted: at least that", o->harmonics, condense_highest_load(s->c));
    return MODAL_OK;
}

/* Whether KEPT dofs that iterate are too many for a full matrix of them, and not so few that the
 * others are better taken out. */
static bool sparse_pays(const struct program *p, const struct steady_options *opt, int kept)
{
    return p->n_linear == 0 && !opt->by_differences && kept >= SPARSE_LEAST
        && p->n <= SPARSE_LINEAR * kept;
}

static enum condense_keep structure(const struct program *p, const struct steady_options *opt)
{
    int kept = condense_nonlinear(p);

    return sparse_pays(p, opt, kept) ? CONDENSE_SPARSE : CONDENSE_LINEAR;
}

enum modal_status steady_new(const struct program *p, const struct steady_options *opt, struct steady **out, struct modal_error *err)
{
    struct steady *s = calloc(1, sizeof *s);
    enum modal_status rc;

    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    s->p = p;
    s->opt = *opt;
    classify(s);
    rc = condense_new(p, structure(p, opt), &s->c, err);
    if (rc == MODAL_OK)
        rc = check_options(s, err);
    if (rc != MODAL_OK) {
        steady_free(s);
        return rc;
    }
    *out = s;
    return MODAL_OK;
}

void steady_free(struct steady *s)
{
    if (s == NULL)
        return;
    for (int i = 0; i < s->balances; i++)
        balance_free(s->balance[i]);
    condense_free(s->c);
    free(s);
}

/* What a factorization costs at H, nearly. */
static double factor_work(const struct steady *s, int H)
{
    double q = condense_kept(s->c), m = 2.0 * H + 1;

    return condense_pattern(s->c)->full ? balance_dense_work((int)(q * m)) : 2 * q * m * m * m;
}

/* A solution's budget begins: a hundred dofs that iterate may spend twice what one may, and
 * whoever asks for many harmonics as
 * much as some attempts at them take. */
static void allow_work(struct steady *s)
{
    s->budget = (struct budget) { .most =
        WORK * (1 + condense_kept(s->c) / 100.0) + ASKED * factor_work(s, s->opt.harmonics) };
}

struct condense *steady_condense(struct steady *s) { return s->c; }
const struct program *steady_program(const struct steady *s) { return s->p; }

enum modal_status steady_reduce(struct steady *s, struct modal_error *err)
{
    bool done;

    return s->p->n - condense_kept(s->c) < REDUCE_LEAST ? MODAL_OK : condense_reduce(s->c, &done, err);
}

enum modal_status steady_balance(struct steady *s, int H, struct balance **out, struct modal_error *err)
{
    enum modal_status rc;

    for (int i = 0; i < s->balances; i++)
        if (s->balance[i]->H == H) {
            *out = s->balance[i];
            return MODAL_OK;
        }
    if (s->balances == BALANCES) {
        balance_free(s->balance[0]);
        memmove(s->balance, s->balance + 1, (BALANCES - 1) * sizeof s->balance[0]);
        s->balances--;
    }
    rc = balance_new(s->p, s->c, H, steady_samples(s, H), !s->opt.unlocated, &s->balance[s->balances], err);
    if (rc == MODAL_OK) {
        s->balance[s->balances]->budget = &s->budget;
        *out = s->balance[s->balances++];
    }
    return rc;
}

static struct iterate_options iterate_options_of(const struct steady *s)
{
    return (struct iterate_options) { .tolerance = s->opt.tolerance, .most = s->opt.max_iterations, .relaxation = s->opt.relaxation,
                                      .by_differences = s->opt.by_differences, .cutoff = s->opt.cutoff, .slope = s->slope,
                                      .cancelled = s->opt.cancelled, .context = s->opt.context };
}

/* One attempt's best iterate, kept if it is better than what POINT has. */
static void keep(const struct balance *b, const double complex *X, const struct iterate_report *r, const char *method,
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

static void put_start(const struct balance *b, const struct steady_start *start, double complex *X)
{
    memset(X, 0, (size_t)b->q * ((size_t)b->H + 1) * sizeof *X);
    for (int i = 0; start != NULL && i < b->q && i < start->q; i++)
        for (int k = 0; k <= b->H && k <= start->H; k++)
            X[i * (b->H + 1) + k] = start->X[i * (start->H + 1) + k];
}

static enum modal_status try_newton(struct steady *s, struct balance *b, const char *method, double complex *X,
                                    struct steady_point *point, struct modal_error *err)
{
    struct iterate_options opt = iterate_options_of(s);
    struct iterate_report r;
    enum modal_status rc = iterate_newton(b, &opt, X, &r, err);

    if (rc == MODAL_OK)
        keep(b, X, &r, method, point);
    return rc;
}

static enum modal_status try_direct(struct steady *s, struct balance *b, double complex *X, struct steady_point *point,
                                    struct modal_error *err)
{
    struct iterate_options opt = iterate_options_of(s);
    struct iterate_report r;
    enum modal_status rc;

    opt.most = s->opt.max_iterations > 0 ? s->opt.max_iterations : s->opt.method == STEADY_DIRECT ? 1000 : 60;
    rc = iterate_direct(b, &opt, X, &r, err);
    if (rc == MODAL_OK)
        keep(b, X, &r, "direct", point);
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
    struct iterate_options opt = iterate_options_of(s);
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
        keep(b, X, &r, "newton-ramped", point);
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

/* A coarse balance's answer as the start of B. */
static enum modal_status fewer_harmonics(struct steady *s, struct balance *b, double complex *X, struct steady_point *point,
                                         struct modal_error *err);

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

    put_start(b, start, Y);
    *known = false;
    if (!nothing)
        return MODAL_OK;
    laws_left_out(b, Y);
    rc = balance_residual(b, Y, false, err);
    *known = rc == MODAL_OK && balance_relative_residual(b, Y) < HALF;
    if (!*known)
        put_start(b, NULL, Y);
    return rc == MODAL_OVERFLOW ? MODAL_OK : rc;
}

/* X of balance B improved with H of its harmonics, to TOLERANCE, from rest if it is NOTHING; left alone where that does not converge. */
static enum modal_status rough_level(struct steady *s, const struct balance *b, int H, double omega, double tolerance, bool nothing, double complex *X,
                                     struct steady_point *point, bool *ok, struct modal_error *err)
{
    struct iterate_options opt = iterate_options_of(s);
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
        put_start(b, &start, X);
        point->iterations += r.iterations;
        s->slope = aft_slope(few->aft);
        *ok = true;
    }
    free(Y);
    return rc;
}

/* X of balance B, not yet set, from START, or from rest: to many harmonics the way is gone with few, roughly, then with three times as
 * many, as long as that is far fewer. */
static enum modal_status begin(struct steady *s, const struct balance *b, double omega, const struct steady_start *start, double complex *X,
                               struct steady_point *point, struct modal_error *err)
{
    int load = condense_highest_load(s->c), H = load + 1 > H_ROUGH ? load + 1 : H_ROUGH;
    double tolerance = ROUGH;
    bool ok = true, nothing = true;
    enum modal_status rc = MODAL_OK;

    put_start(b, start, X);
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

/* From X, which `begin` has filled from START. */
static enum modal_status attempts(struct steady *s, struct balance *b, const struct steady_start *start, double complex *X,
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
    rc = begin(s, few, b->omega, NULL, X, &sub, err);
    if (rc == MODAL_OK)
        rc = balance_set(few, b->omega, 1, err);
    if (rc == MODAL_OK)
        rc = attempts(s, few, NULL, X, &sub, err);
    s->current = false;
    point->iterations += sub.iterations;
    if (rc == MODAL_OK)
        rc = balance_set(b, b->omega, 1, err);
    if (rc == MODAL_OK && sub.converged) {
        start = (struct steady_start) { few->q, H, sub.X };
        put_start(b, &start, X);
        rc = try_newton(s, b, "newton-extended", X, point, err);
    }
    free(sub.X);
    return rc;
}

void steady_point_done(struct steady_point *point)
{
    free(point->X);
    free(point->evaluations);
    free(point->acts);
    free(point->undetermined);
    free(point->multiplier);
    memset(point, 0, sizeof *point);
}

static enum modal_status point_init(struct steady *s, struct steady_point *point, int q, int H, int N, struct modal_error *err)
{
    double complex *X = calloc((size_t)q * ((size_t)H + 1) + 1, sizeof *X);

    free(point->X);
    point->X = X;
    point->q = q;
    point->H = H;
    point->N = N;
    point->c = s->c;
    point->laws = s->p->laws;
    point->residual = -1;
    point->converged = false;
    if (point->evaluations == NULL) {
        point->evaluations = calloc((size_t)s->p->laws + 1, sizeof *point->evaluations);
        point->acts = calloc((size_t)s->p->laws + 1, sizeof *point->acts);
        point->undetermined = calloc((size_t)s->p->laws + 1, sizeof *point->undetermined);
    }
    if (X == NULL || point->evaluations == NULL || point->acts == NULL || point->undetermined == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a point");
    return MODAL_OK;
}

static int dof_of(const struct steady *s, int i)
{
    return s->opt.dofs != NULL ? s->opt.dofs[i] : i;
}

/* max over time of |Re sum_{k<=K} Z_k e^{ik theta}| on a grid of at least 4K samples. */
static double peak(struct orbit_grid *g, const double complex *Z, int K, double *x)
{
    double most = 0;

    orbit_synthesize(g, K, Z, 0, x);
    for (int j = 0; j < orbit_grid_samples(g); j++)
        most = fmax(most, fabs(x[j]));
    return most;
}

/* The peak over time and counted dofs of the motion whose kept part is E - X (loads cancel). */
static enum modal_status peak_of_change(struct steady *s, const double complex *E, const double complex *X, int q, int H, double *out,
                                        double *amplitude, struct modal_error *err)
{
    int N = power_of_two(4L * (H + 1)), count = s->opt.dofs != NULL ? s->opt.dofs_count : s->p->n;
    double complex *a = calloc((size_t)H + 1, sizeof *a), *b = calloc((size_t)H + 1, sizeof *b);
    double *x = calloc((size_t)N, sizeof *x);
    struct orbit_grid *g = NULL;
    enum modal_status rc = orbit_grid_new(N, &g, err);

    (void)q;
    if (rc == MODAL_OK && (a == NULL || b == NULL || x == NULL))
        rc = modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for an estimate");
    *out = 0;
    for (int i = 0; rc == MODAL_OK && i < count; i++) {
        rc = condense_recover(s->c, dof_of(s, i), H, E, H, a, err);
        if (rc == MODAL_OK)
            rc = condense_recover(s->c, dof_of(s, i), H, X, H, b, err);
        if (rc != MODAL_OK)
            break;
        if (amplitude != NULL)
            *amplitude = fmax(*amplitude, peak(g, b, H, x));
        for (int k = 0; k <= H; k++)
            a[k] -= b[k];
        *out = fmax(*out, peak(g, a, H, x));
    }
    free(a);
    free(b);
    free(x);
    orbit_grid_free(g);
    return rc;
}

static void widen_motion(const double complex *X, int q, int H, int H2, double complex *E)
{
    memset(E, 0, (size_t)q * ((size_t)H2 + 1) * sizeof *E);
    for (int i = 0; i < q; i++)
        memcpy(E + i * (H2 + 1), X + i * (H + 1), ((size_t)H + 1) * sizeof *E);
}

/* (1): harmonics past H of E from the wide balance's F */
static enum modal_status tail_of(const struct balance *wide, int H, double complex *E, struct modal_error *err)
{
    int q = wide->q, K = wide->H + 1;
    double complex *rhs = malloc(((size_t)q + 1) * sizeof *rhs);

    if (rhs == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a tail");
    for (int k = H + 1; k < K; k++) {
        for (int i = 0; i < q; i++)
            rhs[i] = wide->load[k * q + i] - wide->F[i * K + k];
        if (stiffness_solve(wide->stiffness, k, rhs))
            for (int i = 0; i < q; i++)
                E[i * K + k] = rhs[i];
    }
    free(rhs);
    return MODAL_OK;
}

/* The chord step of (2) on harmonics 0 .. H: E_low = X_low - J^-1 R_low(wide), J factored in b. */
static void chord(struct balance *b, const struct balance *wide, const double complex *X, double *y, double complex *E)
{
    int n = 2 * b->H + 1, n2 = 2 * wide->H + 1, K = b->H + 1, K2 = wide->H + 1;

    for (int i = 0; i < b->q; i++)
        for (int r = 0; r < n; r++)
            y[i * n + r] = -wide->R[i * n2 + r];
    balance_solve(b, y, 1);
    for (int i = 0; i < b->q; i++)
        for (int k = 0; k < K; k++)
            E[i * K2 + k] = X[i * K + k] + (k == 0 ? y[i * n] : CMPLX(y[i * n + 2 * k - 1], y[i * n + 2 * k]));
    for (int i = 0; balance_open(b) && i < b->q; i++)
        E[i * K2] = X[i * K];                                /* a mean that is free has no error */
}

static void tail_in_time(const struct balance *wide, int H, struct steady_point *point)
{
    int K = wide->H + 1;
    double squares = 0;

    point->tail_max = point->load_max = 0;
    for (int i = 0; i < wide->q; i++) {
        double sum = 0, load = 0;

        for (int k = H + 1; k < K; k++) {
            squares += pow(cabs(wide->F[i * K + k] - wide->load[k * wide->q + i]), 2) / 2;
            sum += cabs(wide->F[i * K + k] - wide->load[k * wide->q + i]);
        }
        for (int k = 0; k < K; k++)
            load += cabs(wide->load[k * wide->q + i]) + (k <= H ? cabs(wide->F[i * K + k]) : 0);
        point->tail_max = fmax(point->tail_max, sum);
        point->load_max = fmax(point->load_max, load);
    }
    point->tail_rms = sqrt(squares);
}

struct estimate {
    int H2;
    struct balance *wide;                   /* of H2 harmonics */
    double complex *W, *sampled, *E;        /* X widened; its chord step, (2) without the tail; and with it */
    double *y;
};

static void estimate_done(struct estimate *e)
{
    balance_free(e->wide);
    free(e->W);
    free(e->sampled);
    free(e->E);
    free(e->y);
}

static enum modal_status estimate_init(struct steady *s, const struct balance *b, struct estimate *e, struct modal_error *err)
{
    int H = b->H, H2 = H < 16 ? 64 : 4 * H < ORBIT_HARMONICS_MOST / 2 ? 4 * H : H + 64;
    long sampled = b->aft != NULL ? 2L * aft_samples(b->aft) : 0;
    int N2 = power_of_two(s->exact ? 4L * H2 : sampled > 8L * H2 ? sampled : 8L * H2);
    size_t size = (size_t)b->q * ((size_t)H2 + 1);

    *e = (struct estimate) { .H2 = H2, .W = calloc(size + 1, sizeof *e->W), .sampled = calloc(size + 1, sizeof *e->sampled),
                             .E = calloc(size + 1, sizeof *e->E), .y = calloc((size_t)b->order + 1, sizeof *e->y) };
    if (e->W == NULL || e->sampled == NULL || e->E == NULL || e->y == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for an estimate");
    return balance_new(s->p, s->c, H2, N2, !s->opt.unlocated || s->exact, &e->wide, err);
}

/* The chord step without the tail into e->sampled: what sampling alone moves. */
static enum modal_status move_by_samples(struct balance *b, struct estimate *e, struct steady_point *point, struct modal_error *err)
{
    enum modal_status rc = balance_set(e->wide, b->omega, b->level, err);

    widen_motion(point->X, b->q, b->H, e->H2, e->W);
    if (rc == MODAL_OK)
        rc = balance_residual(e->wide, e->W, false, err);
    if (rc != MODAL_OK)
        return rc;
    tail_in_time(e->wide, b->H, point);
    memcpy(e->sampled, e->W, (size_t)b->q * ((size_t)e->H2 + 1) * sizeof *e->W);
    chord(b, e->wide, point->X, e->y, e->sampled);
    return MODAL_OK;
}

/* The tail and the chord step with it into e->E, by (1) and (2). */
static enum modal_status move_by_tail(struct balance *b, struct estimate *e, const struct steady_point *point, struct modal_error *err)
{
    enum modal_status rc;

    memcpy(e->E, e->W, (size_t)b->q * ((size_t)e->H2 + 1) * sizeof *e->W);
    rc = tail_of(e->wide, b->H, e->E, err);                                        /* (1) */
    if (rc == MODAL_OK)
        rc = balance_residual(e->wide, e->E, false, err);
    if (rc != MODAL_OK)
        return rc;
    chord(b, e->wide, point->X, e->y, e->E);                                       /* (2) */
    return tail_of(e->wide, b->H, e->E, err);
}

/* The point's errors: NAN where its derivative is singular or a step overflows. */
static enum modal_status estimate(struct steady *s, struct balance *b, struct steady_point *point, struct modal_error *err)
{
    struct estimate e;
    enum modal_status rc = estimate_init(s, b, &e, err);

    point->truncation = point->sampling = point->solver = point->error = NAN;
    if (rc == MODAL_OK)
        rc = balance_residual(b, point->X, false, err);
    if (rc == MODAL_OK && !b->pattern->full)
        balance_set_order(b, iterate_order(b, 0));           /* off by its gain, a tenth,
            where it is short */
    if (rc == MODAL_OK)
        rc = balance_derivative(b, err);
    point->open = rc == MODAL_OK && balance_factor(b, NULL) && balance_open(b);
    if (rc != MODAL_OK || !b->factored || (rc = move_by_samples(b, &e, point, err)) != MODAL_OK)
        goto out;
    point->amplitude = 0;
    rc = peak_of_change(s, e.sampled, e.W, b->q, e.H2, &point->sampling, &point->amplitude, err);
    if (rc == MODAL_OK)
        rc = move_by_tail(b, &e, point, err);
    if (rc == MODAL_OK)
        rc = peak_of_change(s, e.E, e.W, b->q, e.H2, &point->error, NULL, err);
    if (rc == MODAL_OK)
        rc = peak_of_change(s, e.E, e.sampled, b->q, e.H2, &point->truncation, NULL, err);    /* what sampling does not explain */
    if (rc == MODAL_OK) {
        point->solver = point->step * point->amplitude;
        point->error += point->solver;
    }
out:
    balance_set_order(b, b->H);
    estimate_done(&e);
    return rc == MODAL_OVERFLOW ? MODAL_OK : rc;
}

enum modal_status steady_extend(struct steady *s, const struct steady_point *point, int H2, double complex *E, bool *done,
                                struct modal_error *err)
{
    struct balance *wide = NULL, *b;
    double *y = NULL;
    enum modal_status rc = steady_balance(s, point->H, &b, err);

    *done = false;
    if (rc == MODAL_OK)
        rc = balance_set(b, point->omega, 1, err);
    if (rc == MODAL_OK)
        rc = balance_residual(b, point->X, true, err);
    if (rc != MODAL_OK || !balance_factor(b, NULL))
        return rc;
    y = calloc((size_t)b->order + 1, sizeof *y);
    rc = y == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory") : balance_new(s->p, s->c, H2, power_of_two(4L * H2), true, &wide, err);
    if (rc == MODAL_OK)
        rc = balance_set(wide, point->omega, 1, err);
    if (rc == MODAL_OK)
        widen_motion(point->X, b->q, b->H, H2, E);
    for (int round = 0; rc == MODAL_OK && round < (s->jumps ? EXTENSIONS_OF_JUMPS : EXTENSIONS); round++) {
        double complex *low = malloc(((size_t)b->q * ((size_t)b->H + 1) + 1) * sizeof *low);

        rc = low == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory") : balance_residual(wide, E, false, err);
        for (int i = 0; rc == MODAL_OK && i < b->q; i++)
            memcpy(low + i * (b->H + 1), E + i * (H2 + 1), ((size_t)b->H + 1) * sizeof *low);
        if (rc == MODAL_OK) {
            chord(b, wide, low, y, E);
            rc = tail_of(wide, b->H, E, err);
        }
        free(low);
    }
    *done = rc == MODAL_OK;
    if (rc == MODAL_OK)
        rc = balance_set(b, point->omega, 1, err);
    free(y);
    balance_free(wide);
    return rc;
}

enum modal_status steady_recover(struct steady *s, const struct steady_point *point, int dof, double complex *X, struct modal_error *err)
{
    return condense_recover(s->c, dof, point->H, point->X, point->H, X, err);
}

/*
 * Rigid friction jumps where the motion turns, and there a series of H harmonics has its worst error: the turns, and with
 * them every harmonic, are off by c_1/H + c_2/H^2 + ...  The motion is carried on to SHARP/4, SHARP/2 and SHARP harmonics and its first
 * H extrapolated to none missing; what is left is the tail that the H harmonics given do not hold.
 */
static enum modal_status sharpen(struct steady *s, struct balance *b, struct steady_point *point, struct modal_error *err)
{
    int H = point->H, least = H < SHARP / 8 ? SHARP / 4 : 2 * H, H2 = 4 * least, q = point->q, K2 = H2 + 1;
    size_t size = (size_t)q * (size_t)K2 + 1;
    double complex *E = calloc(size, sizeof *E), *low = calloc(size, sizeof *low);
    double complex *S = calloc((size_t)pattern_entries(b->pattern) * (size_t)K2 + 1, sizeof *S);
    double complex *load = calloc(size, sizeof *load), *R = calloc(3 * (size_t)q * ((size_t)H + 1) + 1, sizeof *R);
    size_t part = (size_t)q * ((size_t)H + 1);
    bool done = true;
    enum modal_status rc = E == NULL || low == NULL || S == NULL || load == NULL || R == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory") : MODAL_OK;

    for (int round = 0; rc == MODAL_OK && done && round < 3; round++) {
        int Hr = least << round;

        rc = steady_extend(s, point, Hr, E, &done, err);
        for (int i = 0; i < q; i++)
            for (int k = 0; k <= H; k++)
                R[(size_t)round * part + (size_t)(i * (H + 1) + k)] = E[i * (Hr + 1) + k];
    }
    if (rc != MODAL_OK || !done)
        goto out;
    point->solver = point->sampling = point->amplitude = 0;
    for (size_t i = 0; i < part; i++) {
        double complex a = 2 * R[part + i] - R[i], c = 2 * R[2 * part + i] - R[part + i];

        point->X[i] = (4 * c - a) / 3;
        point->sampling = fmax(point->sampling, cabs(point->X[i] - c));
    }
    for (int i = 0; i < q; i++)
        for (int k = 0; k <= H; k++)
            E[i * K2 + k] = low[i * K2 + k] = point->X[i * (H + 1) + k];
    rc = condense_at(s->c, point->omega, 1, H2, S, load, err);
    if (rc == MODAL_OK)
        rc = peak_of_change(s, E, low, q, H2, &point->error, &point->amplitude, err);
    point->truncation = point->error;
    point->error += point->sampling;
    point->solver = point->step * point->amplitude;
    if (rc == MODAL_OK)
        rc = balance_set(b, point->omega, 1, err);
out:
    free(E);
    free(low);
    free(S);
    free(load);
    free(R);
    return rc;
}

static void take_counts(const struct balance *b, const long *before, long ffts_before, struct steady_point *point)
{
    for (int l = 0; l < point->laws; l++) {
        point->evaluations[l] += aft_evaluations(b->aft, l) - before[l];
        point->acts[l] = aft_acts(b->aft, l);
        point->undetermined[l] = aft_undetermined(b->aft, l);
    }
    point->ffts += aft_transforms(b->aft) - ffts_before;
}

/* At one H. */
static enum modal_status solve_at(struct steady *s, int H, double omega, const struct steady_start *start, struct steady_point *point,
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
        rc = begin(s, b, omega, start, X, point, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, omega, 1, err);
    if (rc != MODAL_OK)
        goto out;
    for (int l = 0; l < s->p->laws; l++)
        before[l] = aft_evaluations(b->aft, l);
    ffts = aft_transforms(b->aft);
    s->current = false;
    rc = attempts(s, b, start, X, point, err);
    if (rc == MODAL_OK && point->converged && !s->current)
        rc = balance_residual(b, point->X, false, err);
    if (rc != MODAL_OK)
        goto out;
    take_counts(b, before, ffts, point);
    if (!point->converged && s->jumps)
        point->reason = "no motion without stops closes under rigid friction; where the body stops, give the friction a stiffness (type friction)";
    if (point->converged && s->jumps)
        rc = sharpen(s, b, point, err);
    else if (point->converged && !(s->opt.estimate_later && s->opt.harmonics > 0)) {
        rc = estimate(s, b, point, err);
        if (rc == MODAL_OK)
            rc = balance_set(b, omega, 1, err);            /* recovery at this H again */
    }
out:
    free(before);
    free(X);
    return rc;
}

/* Constant matrices: what is left of the equation of motion is all there is to tell, the dofs taken out included. */
static enum modal_status linear_residual(struct steady *s, struct steady_point *point, struct modal_error *err)
{
    struct condense_residual left;
    enum modal_status rc = condense_residual(s->c, point->X, &left, err);

    point->residual = left.relative;
    point->tail_rms = left.rms;
    point->tail_max = left.most;
    point->load_max = left.load;
    return rc;
}

/* No laws: with constant matrices one solve a harmonic; with periodic ones a single linear system. */
static enum modal_status solve_linear(struct steady *s, double omega, struct steady_point *point, struct modal_error *err)
{
    int load = condense_highest_load(s->c), H = s->opt.harmonics > 0 ? s->opt.harmonics : s->p->harmonics > 0 ? load + 24 : load > 0 ? load : 1;
    int q = condense_kept(s->c);
    struct balance *b;
    enum modal_status rc = steady_balance(s, H, &b, err);

    if (rc == MODAL_OK)
        rc = point_init(s, point, q, H, 0, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, omega, 1, err);
    if (rc != MODAL_OK)
        return rc;
    point->method = "linear";
    point->residual = point->step = point->truncation = point->sampling = point->solver = point->error = 0;
    point->converged = true;
    if (q == 0)
        return linear_residual(s, point, err);
    rc = balance_residual(b, point->X, true, err);
    if (rc != MODAL_OK)
        return rc;
    if (!balance_factor(b, NULL)) {
        point->converged = false;
        point->reason = "the linear equations are singular: an undamped resonance, "
                        "or a body that nothing holds";
        return MODAL_OK;
    }
    for (int i = 0; i < b->order; i++)
        b->R[i] = -b->R[i];
    balance_solve(b, b->R, 1);
    balance_unpack(b, b->R, point->X);
    rc = balance_residual(b, point->X, false, err);
    point->residual = balance_relative_residual(b, point->X);
    if (rc == MODAL_OK && s->p->harmonics > 0) {
        rc = estimate(s, b, point, err);
        if (rc == MODAL_OK)
            rc = balance_set(b, omega, 1, err);
    } else if (rc == MODAL_OK)
        rc = linear_residual(s, point, err);
    return rc;
}

enum modal_status steady_estimate_point(struct steady *s, struct steady_point *point, struct modal_error *err)
{
    struct balance *b;
    enum modal_status rc;

    if (s->linear || s->jumps || point->followed)
        return MODAL_OK;
    if (!s->opt.estimate_later && point->error > 0)
        return MODAL_OK;                                   /* it has them */
    allow_work(s);
    rc = steady_balance(s, point->H, &b, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, point->omega, 1, err);
    if (rc == MODAL_OK)
        rc = estimate(s, b, point, err);
    return rc == MODAL_OK ? balance_set(b, point->omega, 1, err) : rc;
}

enum modal_status steady_point_take(struct steady *s, struct balance *b, const double complex *X, struct steady_point *point,
                                    struct modal_error *err)
{
    long *before = calloc((size_t)s->p->laws + 1, sizeof *before), ffts = aft_transforms(b->aft);
    enum modal_status rc;

    memset(point, 0, sizeof *point);
    if (before == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    for (int l = 0; l < s->p->laws; l++)
        before[l] = aft_evaluations(b->aft, l);
    rc = point_init(s, point, b->q, b->H, aft_samples(b->aft), err);
    if (rc == MODAL_OK)
        rc = balance_residual(b, X, false, err);
    if (rc == MODAL_OK) {
        memcpy(point->X, X, (size_t)b->q * ((size_t)b->H + 1) * sizeof *X);
        take_counts(b, before, ffts, point);
        point->residual = balance_relative_residual(b, X);
        point->omega = b->omega;
        point->level = b->level;
        point->converged = true;
        point->error = point->truncation = point->sampling = point->solver = NAN;
    } else
        steady_point_done(point);
    free(before);
    return rc;
}

/* A point of every solution in FOUND, errors estimated. */
static enum modal_status take_all(struct steady *s, struct balance *b, const struct solutions *found, const char *method,
                                  struct steady_point *points, int *count, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < found->count; i++) {
        rc = balance_set(b, b->omega, 1, err);
        if (rc == MODAL_OK)
            rc = steady_point_take(s, b, found->X[i], &points[*count], err);
        if (rc != MODAL_OK)
            break;
        points[*count].method = method;
        points[*count].attempts = 1;
        rc = estimate(s, b, &points[(*count)++], err);
    }
    return rc;
}

/* From each solution of FEW its like of B, by Newton's method from near, into FOUND. */
static enum modal_status widen_all(struct steady *s, const struct balance *few,
                                   const struct solutions *from, struct balance *b,
                                   struct solutions *found, struct modal_error *err)
{
    struct iterate_options opt = iterate_options_of(s);
    double complex *X = calloc((size_t)b->q * ((size_t)b->H + 1) + 1, sizeof *X);
    struct iterate_report r;
    enum modal_status rc = X == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory")
        : balance_set(b, few->omega, 1, err);

    for (int i = 0; rc == MODAL_OK && i < from->count; i++) {
        const struct steady_start start = { few->q, few->H, from->X[i] };

        put_start(b, &start, X);
        rc = iterate_newton(b, &opt, X, &r, err);
        if (rc == MODAL_OK && r.converged)
            solutions_add(found, b, X);
    }
    free(X);
    return rc;
}

/* All solutions of B, whose one is X if that is not NULL: sought with so few harmonics that the
 * budget reaches, and carried on. */
static enum modal_status search(struct steady *s, struct balance *b, const double complex *X,
                                struct solutions *found, struct modal_error *err)
{
    struct solutions_options opt = { .cancelled = s->opt.cancelled, .context = s->opt.context };
    struct solutions coarse = { 0 };
    int load = condense_highest_load(s->c), H = b->H;
    struct balance *few = b;
    double omega = b->omega;
    bool same;
    enum modal_status rc = MODAL_OK;

    allow_work(s);
    while (H / 2 >= H_SEARCH && H / 2 > 2 * load && SEARCHES * factor_work(s, H) > s->budget.most)
        H /= 2;
    same = H == b->H || s->opt.samples > 0;
    if (X != NULL)
        solutions_add(found, b, X);
    if (!same)
        rc = steady_balance(s, H, &few, err);
    if (rc == MODAL_OK)
        rc = balance_set(few, omega, 1, err);
    if (rc == MODAL_OK)
        rc = solutions_along_levels(few, &opt, same ? found : &coarse, err);
    if (rc == MODAL_OK)
        rc = solutions_from_starts(few, &opt, same ? found : &coarse, err);
    if (rc == MODAL_OK && !same)
        rc = widen_all(s, few, &coarse, b, found, err);
    solutions_done(&coarse);
    return rc;
}

/* BEST is POINT's motion, flags and errors, its arrays its own. */
static enum modal_status keep_best(const struct steady_point *point, struct steady_point *best,
                                   struct modal_error *err)
{
    size_t size = (size_t)point->q * ((size_t)point->H + 1), laws = (size_t)point->laws;

    free(best->X);
    free(best->acts);
    free(best->undetermined);
    *best = *point;
    best->evaluations = NULL;
    best->multiplier = NULL;
    best->X = malloc((size + 1) * sizeof *best->X);
    best->acts = malloc((laws + 1) * sizeof *best->acts);
    best->undetermined = malloc((laws + 1) * sizeof *best->undetermined);
    if (best->X == NULL || best->acts == NULL || best->undetermined == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a point");
    memcpy(best->X, point->X, size * sizeof *best->X);
    memcpy(best->acts, point->acts, laws * sizeof *best->acts);
    memcpy(best->undetermined, point->undetermined, laws * sizeof *best->undetermined);
    return MODAL_OK;
}

enum modal_status steady_solve_all(struct steady *s, double omega, const struct steady_start *start,
                                   const struct steady_point *known, struct steady_point **points,
                                       int *count,
                                   struct modal_error *err)
{
    struct solutions found = { 0 };
    struct steady_point *list = calloc(SOLUTIONS_MOST + 1, sizeof *list);
    struct balance *b = NULL;
    enum modal_status rc = list == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory")
                         : known != NULL ? keep_best(known, &list[0], err)
                             : steady_solve(s, omega, start, &list[0], err);

    *count = rc == MODAL_OK ? 1 : 0;
    if (rc != MODAL_OK || s->linear || list[0].followed)
        goto out;                                          /* rigid friction followed in time has no balance to search in */
    rc = steady_balance(s, list[0].H, &b, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, omega, 1, err);
    if (rc == MODAL_OK)
        rc = search(s, b, list[0].converged ? list[0].X : NULL, &found, err);
    if (rc == MODAL_OK && found.count > 0) {
        const char *method = list[0].converged ? list[0].method : "multi-start";

        struct budget work = list[0].work;

        steady_point_done(&list[0]);
        *count = 0;
        rc = take_all(s, b, &found, method, list, count, err);
        for (int i = 0; i < *count; i++)
            list[i].work = (struct budget) { work.spent + s->budget.spent,
                                             work.most + s->budget.most };
    }
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

    *point = *best;
    point->converged = false;
    point->fewer = true;
    point->reason = "it closes with the harmonics given, but not with more";
    point->iterations = last.iterations;
    point->attempts = last.attempts;
    point->ffts = last.ffts;
    point->evaluations = last.evaluations;
    *best = last;
    best->evaluations = NULL;
    return rc == MODAL_OK ? balance_set(b, point->omega, 1, err)
        : rc;         /* recovery at this H */
}

/* Whether H is the last order that is tried, and if work is what stops it, *SHORT. */
static bool last_order(const struct steady *s, int H, int most, double spent, bool *wanting)
{
    double order = (double)condense_kept(s->c) * (4.0 * H + 1);
    bool full = condense_pattern(s->c)->full;

    /* Some steps, or what it cost and more. */
    double next = full ? FEW * factor_work(s, 2 * H) : 4 * spent;

    *wanting = s->budget.spent + next > s->budget.most
        || (full && order > ORDER_AUTO_MOST);
    return H >= most || *wanting || (s->opt.samples > 0 && 4 * H >= s->opt.samples);
}

/* H doubled, each from the last, until the estimate meets the target or the work allowed does not
 * reach for the next order, whose
 * factors cost up to eight times as much; the best so far is the answer.  Past the first H, more
 * than ORDER_FAILED unknowns are
 * tried from near alone; after FAILED_MOST failures in a row, not at all. */
static enum modal_status solve_to_target(struct steady *s, double omega, const struct steady_start *start, struct steady_point *point,
                                         struct modal_error *err)
{
    double target = s->opt.target_error > 0 ? s->opt.target_error : TARGET;
    int load = condense_highest_load(s->c), H = 2 * load + 1 > 8 ? 2 * load + 1 : 8, most = H_AUTO_MOST > load ? H_AUTO_MOST : load;
    struct steady_point best = { 0 };
    int failed = 0;
    enum modal_status rc = MODAL_OK;

    for (bool last = false; rc == MODAL_OK && !last; H = 2 * H < most ? 2 * H : most) {
        struct steady_start next = { best.q, best.H, best.X };
        double before = s->budget.spent;

        s->brief = best.attempts > 0 && condense_kept(s->c) * (2 * H + 1) > ORDER_FAILED;
        rc = solve_at(s, H, omega, best.converged ? &next : start, point, err);
        s->brief = false;
        if (rc != MODAL_OK)
            break;
        failed = point->converged ? 0 : failed + 1;
        last = (point->converged && point->error <= target * point->amplitude)
            || (failed >= FAILED_MOST && condense_kept(s->c) * (4 * H + 1) > ORDER_FAILED)
            || last_order(s, H, most, s->budget.spent - before, &point->wanting);
        best.attempts = point->attempts;
        if (point->converged && !last)
            rc = keep_best(point, &best, err);
        if (rc == MODAL_OK && last && !point->converged && best.converged)
            rc = give_best(s, &best, point, err);
    }
    steady_point_done(&best);
    return rc;
}

/* By time integration, for comparison: the last period's harmonics; its own errors are not estimated. */
static enum modal_status solve_by_marching(struct steady *s, double omega, struct steady_point *point, struct modal_error *err)
{
    static const char *const names[] = { "rk4", "adaptive", "shooting" };
    int which = s->opt.method - STEADY_RK4, N = s->opt.samples > 0 ? s->opt.samples : 512;
    int H = s->opt.harmonics > 0 ? s->opt.harmonics : (N - 1) / 2 < 256 ? (N - 1) / 2 : 256, q = condense_kept(s->c);
    double target = s->opt.target_error > 0 ? s->opt.target_error : TARGET;
    struct march_options opt = { .method = (enum march_method)which, .samples = N, .periodic = target / 10, .cancelled = s->opt.cancelled,
                                 .tolerance = s->opt.tolerance > 1e-11 ? s->opt.tolerance : target, .context = s->opt.context };
    struct march_report report;
    struct orbit_grid *g = NULL;
    double *x;
    struct balance *b;
    enum modal_status rc;

    if (condense_highest_load(s->c) > H)
        return modal_fail_field(err, MODAL_BAD_INPUT, "steady.samples", "%d samples do not hold the excitation at harmonic %d", N, condense_highest_load(s->c));
    x = malloc(((size_t)s->p->n * (size_t)N + 1) * sizeof *x);
    rc = x == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory") : march_run(s->p, omega, &opt, x, &report, err);
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
        point->reason = report.converged ? NULL : "time integration did not reach a periodic motion";
        point->iterations = report.periods;
        point->step = report.change;
        point->residual = report.change;
        point->error = point->truncation = point->sampling = point->solver = NAN;
        for (int l = 0; l < point->laws; l++) {
            point->evaluations[l] = report.evaluations;
            point->acts[l] = true;
        }
    }
    free(x);
    orbit_grid_free(g);
    return rc;
}

/* Displacements and rates at t = 0 of START, by dof. */
static enum modal_status state_of_start(struct steady *s, double omega, const struct steady_start *start, double *x, double *v, struct modal_error *err)
{
    int H = start->H;
    double complex *X = calloc((size_t)H + 1, sizeof *X), *kept = NULL;
    struct balance *b;
    enum modal_status rc = steady_balance(s, H, &b, err);

    if (rc == MODAL_OK)
        rc = balance_set(b, omega, 1, err);
    kept = rc == MODAL_OK ? calloc((size_t)b->q * ((size_t)H + 1) + 1, sizeof *kept) : NULL;
    if (rc == MODAL_OK && (X == NULL || kept == NULL))
        rc = modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    if (rc == MODAL_OK)
        put_start(b, start, kept);
    for (int i = 0; rc == MODAL_OK && i < s->p->n; i++) {
        rc = condense_recover(s->c, i, H, kept, H, X, err);
        for (int k = 0; rc == MODAL_OK && k <= H; k++) {
            x[i] += creal(X[k]);
            v[i] -= k * omega * cimag(X[k]);
        }
    }
    free(X);
    free(kept);
    return rc;
}

/* max over time and counted dofs of what is left of the cycle's samples without harmonics past H, and of the samples themselves. */
static enum modal_status tail_of_samples(struct steady *s, struct orbit_grid *g, const struct cycle *c, int H, double *tail, double *amplitude,
                                         struct modal_error *err)
{
    int count = s->opt.dofs != NULL ? s->opt.dofs_count : s->p->n;
    double complex *X = calloc((size_t)H + 1, sizeof *X);
    double *x = calloc(CYCLE_SAMPLES, sizeof *x);
    enum modal_status rc = X == NULL || x == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory") : MODAL_OK;

    *tail = *amplitude = 0;
    for (int i = 0; rc == MODAL_OK && i < count; i++) {
        const double *exact = c->x + (size_t)dof_of(s, i) * CYCLE_SAMPLES;

        orbit_analyze(g, exact, H, X);
        orbit_synthesize(g, H, X, 0, x);
        for (int j = 0; j < CYCLE_SAMPLES; j++) {
            *tail = fmax(*tail, fabs(x[j] - exact[j]));
            *amplitude = fmax(*amplitude, fabs(exact[j]));
        }
    }
    free(X);
    free(x);
    return rc;
}

/* The point of H harmonics of a cycle; a series of N samples folds what lies past N/2, which falls as k^-3 and faster: half the
 * samples would fold eight times as much. */
static enum modal_status take_cycle(struct steady *s, const struct cycle *c, struct orbit_grid *g, int H, struct steady_point *point, struct modal_error *err)
{
    int q = condense_kept(s->c), K = H + 1;
    double *half = calloc(CYCLE_SAMPLES / 2, sizeof *half);
    double complex *X = calloc((size_t)K, sizeof *X);
    struct orbit_grid *coarse = NULL;
    enum modal_status rc = half == NULL || X == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory") : orbit_grid_new(CYCLE_SAMPLES / 2, &coarse, err);

    if (rc == MODAL_OK)
        rc = point_init(s, point, q, H, CYCLE_SAMPLES, err);
    point->sampling = 0;
    for (int i = 0; rc == MODAL_OK && i < q; i++) {
        const double *x = c->x + (size_t)condense_dofs(s->c)[i] * CYCLE_SAMPLES;
        double sum = 0;

        orbit_analyze(g, x, H, point->X + i * K);
        for (int j = 0; j < CYCLE_SAMPLES / 2; j++)
            half[j] = x[2 * j];
        orbit_analyze(coarse, half, H, X);
        for (int k = 0; k < K; k++)
            sum += cabs(X[k] - point->X[i * K + k]) / 7;
        point->sampling = fmax(point->sampling, sum);
    }
    orbit_grid_free(coarse);
    free(half);
    free(X);
    return rc;
}

/*
 * What the point's H harmonics leave of the equation of motion in time, the sliders' forces f_l those of the cycle:
 *
 *     r = Re sum_k (S_k X_k - p_k) e^{i k theta} + sum_l B_l f_l.                                           (3)
 *
 * f jumps where a body turns, and there r is of the jump's size at any H, as a truncated series is: its rms falls as H^-1/2.
 */
static void add_forces(const struct steady *s, const struct cycle *c, int i, double *r)
{
    for (int l = 0; l < s->p->laws; l++) {
        const double *f = c->force + (size_t)l * CYCLE_SAMPLES;
        int dof = condense_dofs(s->c)[i], sign = (s->p->law[l].dof[0] == dof) - (s->p->law[l].to[0] == dof);

        for (int j = 0; sign != 0 && j < CYCLE_SAMPLES; j++)
            r[j] += sign * f[j];
    }
}

static enum modal_status residual_of_cycle(const struct steady *s, struct balance *b,
                                           const struct cycle *c, struct orbit_grid *g,
                                           struct steady_point *point, struct modal_error *err)
{
    int q = b->q, K = b->H + 1;
    double complex *G = calloc((size_t)K, sizeof *G);
    double *r = calloc(CYCLE_SAMPLES, sizeof *r), squares = 0;
    enum modal_status rc = G == NULL || r == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory") : MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < q; i++) {
        double load = 0;

        for (int k = 0; k < K; k++) {
            memset(b->sum, 0, (size_t)q * sizeof *b->sum);
            stiffness_multiply_add(b->pattern, b->S, k, point->X + k, K, b->sum);
            G[k] = b->sum[i] - b->load[k * q + i];
            load += cabs(b->load[k * q + i]);
        }
        orbit_synthesize(g, b->H, G, 0, r);
        add_forces(s, c, i, r);                                                    /* (3) */
        for (int j = 0; j < CYCLE_SAMPLES; j++) {
            squares += r[j] * r[j] / CYCLE_SAMPLES;
            point->tail_max = fmax(point->tail_max, fabs(r[j]));
        }
        point->load_max = fmax(point->load_max, load);
    }
    point->tail_rms = sqrt(squares);
    free(G);
    free(r);
    return rc;
}

/* The cycle as the point's answer, at the options' H or at the least that meets the target. */
static enum modal_status cycle_point(struct steady *s, const struct cycle *c, double omega, struct steady_point *point, struct modal_error *err)
{
    double target = s->opt.target_error > 0 ? s->opt.target_error : TARGET;
    int load = condense_highest_load(s->c), H = s->opt.harmonics > 0 ? s->opt.harmonics : load > 4 ? 2 * load : 8;
    struct orbit_grid *g = NULL;
    struct balance *b;
    enum modal_status rc = orbit_grid_new(CYCLE_SAMPLES, &g, err);

    for (; rc == MODAL_OK; H *= 2) {
        rc = tail_of_samples(s, g, c, H, &point->truncation, &point->amplitude, err);
        if (s->opt.harmonics > 0 || point->truncation <= target * point->amplitude / 2 || 2 * H > H_CYCLE_MOST)
            break;
    }
    if (rc == MODAL_OK)
        rc = take_cycle(s, c, g, H, point, err);
    if (rc == MODAL_OK)
        rc = steady_balance(s, H, &b, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, omega, 1, err);                /* recovery at this H */
    if (rc == MODAL_OK && c->closed && c->force != NULL)
        rc = residual_of_cycle(s, b, c, g, point, err);
    else
        point->tail_rms = point->tail_max = NAN;           /* beside other laws nobody samples their forces */
    orbit_grid_free(g);
    return rc;
}

/* Rigid friction, alone: followed in time from event to event, stops and all. */
static enum modal_status solve_by_cycle(struct steady *s, double omega, const struct steady_start *start, struct steady_point *point,
                                        struct modal_error *err)
{
    struct cycle_options opt = { s->opt.cancelled, s->opt.context, &s->budget };
    struct cycle c = { 0 };
    double *x = calloc(2 * (size_t)s->p->n + 1, sizeof *x);
    enum modal_status rc = x == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory") : MODAL_OK;

    if (rc == MODAL_OK && start != NULL)
        rc = state_of_start(s, omega, start, x, x + s->p->n, err);
    if (rc == MODAL_OK)
        rc = cycle_find(s->p, omega, x, x + s->p->n, &opt, &c, err);
    if (rc == MODAL_OK)
        rc = cycle_point(s, &c, omega, point, err);
    if (rc == MODAL_OK) {
        point->method = "events";
        point->converged = c.closed;
        point->reason = c.closed ? NULL : "the motion followed through the events of rigid friction does not repeat";
        point->iterations = c.periods;
        point->attempts = 1;
        point->residual = point->step = c.closure;
        point->solver = c.closure * point->amplitude;
        point->error = point->truncation + point->sampling + point->solver;
        point->followed = true;
        point->states = c.states;
        point->multiplier = c.multiplier;
        point->multiplier_error = c.error;
        c.multiplier = NULL;
        for (int l = 0; l < point->laws; l++) {
            point->evaluations[l] = c.evaluations;
            const struct law *law = &s->p->law[l];

            point->acts[l] = c.acts[l];
            point->undetermined[l] = !c.acts[l] && (law->kind->set_valued || law->memory > 0);
        }
    }
    cycle_done(&c);
    free(x);
    return rc;
}

static enum modal_status solve_any(struct steady *s, double omega, const struct steady_start *start, struct steady_point *point,
                                   struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (s->linear)
        return solve_linear(s, omega, point, err);
    if (s->opt.method >= STEADY_RK4)
        return solve_by_marching(s, omega, point, err);
    if (s->jumps && s->opt.method == STEADY_AUTO && cycle_takes(s->p) && s->opt.harmonics < CYCLE_SAMPLES / 4)
        rc = solve_by_cycle(s, omega, start, point, err);
    if (rc != MODAL_OK || point->converged)
        return rc;
    return s->opt.harmonics > 0 ? solve_at(s, s->opt.harmonics, omega, start, point, err) : solve_to_target(s, omega, start, point, err);
}

/* Every dof kept: the linear ones, held at the kept, resonate. */
static enum modal_status keep_all(struct steady *s, struct modal_error *err)
{
    struct condense *all;
    bool sparse = sparse_pays(s->p, &s->opt, s->p->n);
    enum modal_status rc = condense_new(s->p, sparse ? CONDENSE_SPARSE : CONDENSE_NONE, &all, err);

    if (rc != MODAL_OK)
        return rc;
    for (int i = 0; i < s->balances; i++)
        balance_free(s->balance[i]);
    s->balances = 0;
    condense_free(s->c);
    s->c = all;
    return MODAL_OK;
}

/* No laws and a singular Lambda: the answer is that there is none. */
static enum modal_status no_linear_answer(struct steady *s, struct steady_point *point, struct modal_error *err)
{
    enum modal_status rc = point_init(s, point, condense_kept(s->c), s->opt.harmonics > 0 ? s->opt.harmonics : 1, 0, err);

    point->method = "linear";
    point->reason = "the linear equations are singular at an excited harmonic: an undamped resonance, or a body that nothing holds";
    return rc;
}

enum modal_status steady_solve(struct steady *s, double omega, const struct steady_start *start, struct steady_point *point,
                               struct modal_error *err)
{
    struct modal_error singular;
    enum modal_status rc;

    memset(point, 0, sizeof *point);
    point->omega = omega;
    point->level = 1;
    allow_work(s);
    if (!(omega > 0) || !isfinite(omega))
        return modal_fail_field(err, MODAL_BAD_INPUT, "omega", "omega is %g; accepted: finite and > 0", omega);
    rc = solve_any(s, omega, start, point, &singular);
    if (rc == MODAL_NO_CONVERGENCE && s->linear && s->p->harmonics == 0)
        rc = no_linear_answer(s, point, err);
    else if (rc == MODAL_NO_CONVERGENCE && condense_kept(s->c) < s->p->n) {
        rc = keep_all(s, err);
        if (rc == MODAL_OK)
            rc = solve_any(s, omega, NULL, point, err);
    } else if (rc != MODAL_OK && err != NULL)
        *err = singular;
    point->work = s->budget;
    if (rc != MODAL_OK)
        steady_point_done(point);
    return rc;
}
