/*
 * by_cycle.c - see by_cycle.h
 *
 * What the point's H harmonics leave of the equation of motion in time, the sliders' forces f_l
 * those of the cycle:
 *
 *     r = Re sum_k (S_k X_k - p_k) e^{i k theta} + sum_l B_l f_l.                               (1)
 *
 * f jumps where a body turns, and there r is of the jump's size at any H, as a truncated series is:
 * its rms falls as H^-1/2.
 *
 * A series of N samples folds harmonics k > N / 2 onto those below.  With X'_k of half the samples,
 *
 *     |X_k - X'_k| = (8 - 1) times what N samples fold onto k                                   (2)
 *
 * where harmonics fall as k^-3; faster, it is less.  The truncation is looked at in time, against
 * the samples themselves, which are the motion to the stepper's tolerance.
 */
#include "modal/steady/by_cycle.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/orbit.h"
#include "modal/scene/program.h"
#include "modal/steady/balance.h"
#include "modal/steady/condense.h"
#include "modal/steady/cycle.h"
#include "modal/steady/estimate.h"
#include "modal/steady/session.h"
#include "modal/steady/settle.h"
#include "modal/steady/stiffness.h"
#include "modal/steady/unheld.h"

/* Harmonics fall as k^-3 and faster, so that half the samples fold eight times as much: their
 * difference is seven times what the whole folds. */
static const double FOLDS = 7;
static const double TWO_PI = 6.283185307179586477;   /* a period of theta */
/* Of the budget, what a motion sought in time may cost: it serves the balances of all orders, which
 * have the rest; and of what is left of it, what one sought beside an unstable answer may. */
static const double SHARE_OF_TIME = 0.5;
/* Budgets more for a motion that closes in time where no balance, or none that is stable, is found:
 * all that was spent is in vain without it, and its own steps are dear. */
static const double READY = 2;
/* The same of a look at an answer in time, which is near. */
static const double SHARE_OF_LOOK = 0.1;
/* Errors are of first order, and multipliers of the motion as the series has it: both hold while
 * what that leaves of the equation of motion is little beside the forces that act.  From a tenth
 * of these on a contact may be met at other instants than it is, and time is asked. */
static const double MUCH_LEFT = 0.1;
/* Of its stated error, what a point may be off. */
static const double OFF_MOST = 3;
enum {
    H_CYCLE_MOST = 1024,    /* an eighth of the samples: what folds onto them is small */
    H_LEAST = 8,   /* as solve.c begins */
    FINER_MOST = 8,         /* times the harmonics given: what contacts leave falls as 1 / H */
    LOAD_FEW = 4            /* highest load past which the search begins at twice that */
};

/* Displacements and rates at t = 0 of START, by dof. */
static enum modal_status state_of_start(struct steady *s, double omega,
                                        const struct steady_start *start, double *x, double *v,
                                        struct modal_error *err)
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
        start_write(b, start, kept);
    for (int i = 0; rc == MODAL_OK && i < s->p->n; i++) {
        rc = condense_recover(s->c, i, H, kept, H, X, err);
        for (int k = 0; rc == MODAL_OK && k <= H; k++) {
            x[i] += creal(X[k]);                        /* at t = 0 */
            v[i] -= k * omega * cimag(X[k]);            /* Re i k omega X */
        }
    }
    free(X);
    free(kept);
    return rc;
}

/* max over time and counted dofs of what is left of the cycle's samples without harmonics past H,
 * and of the samples themselves. */
static enum modal_status tail_of_samples(struct steady *s, struct orbit_grid *g,
                                         const struct cycle *c, int H, double *tail,
                                         double *amplitude, struct modal_error *err)
{
    int count = s->opt.dofs != NULL ? s->opt.dofs_count : s->p->n;
    double complex *X = calloc((size_t)H + 1, sizeof *X);
    double *x = calloc(CYCLE_SAMPLES, sizeof *x);
    enum modal_status rc =
        X == NULL || x == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory") : MODAL_OK;

    *tail = *amplitude = 0;
    for (int i = 0; rc == MODAL_OK && i < count; i++) {
        const double *exact = c->x + (size_t)steady_counted_dof(s, i) * CYCLE_SAMPLES;

        orbit_analyze(g, exact, H, X);
        orbit_synthesize(g, H, X, 0, x);
        for (int j = 0; j < CYCLE_SAMPLES; j++) {
            *tail = fmax(*tail, fabs(x[j] - exact[j]));  /* the truncation, in time */
            *amplitude = fmax(*amplitude, fabs(exact[j]));
        }
    }
    free(X);
    free(x);
    return rc;
}

/* The point of H harmonics of a cycle; a series of N samples folds what lies past N/2, which falls
 * as k^-3 and faster: half the samples would fold eight times as much. */
static enum modal_status point_of_cycle(struct steady *s, const struct cycle *c,
                                        struct orbit_grid *g, int H, struct steady_point *point,
                                        struct modal_error *err)
{
    int q = condense_kept(s->c), K = H + 1;
    double *half = calloc(CYCLE_SAMPLES / 2, sizeof *half);
    double complex *X = calloc((size_t)K, sizeof *X);
    struct orbit_grid *coarse = NULL;
    enum modal_status rc = half == NULL || X == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory")
                               : orbit_grid_new(CYCLE_SAMPLES / 2, &coarse, err);

    if (rc == MODAL_OK)
        rc = point_init(s, point, q, H, CYCLE_SAMPLES, err);
    point->sampling = 0;
    for (int i = 0; rc == MODAL_OK && i < q; i++) {
        const double *x = c->x + (size_t)condense_dofs(s->c)[i] * CYCLE_SAMPLES;
        double sum = 0;

        orbit_analyze(g, x, H, point->X + i * K);
        for (int j = 0; j < CYCLE_SAMPLES / 2; j++)
            half[j] = x[2 * j];                         /* every second sample */
        orbit_analyze(coarse, half, H, X);
        for (int k = 0; k < K; k++)
            sum += cabs(X[k] - point->X[i * K + k]) / FOLDS;
        point->sampling = fmax(point->sampling, sum);
    }
    orbit_grid_free(coarse);
    free(half);
    free(X);
    return rc;
}

/* The sliders' forces of (1) on the I-th kept dof, onto r. */
static void add_forces(const struct steady *s, const struct cycle *c, int i, double *r)
{
    for (int l = 0; l < s->p->laws; l++) {
        const double *f = c->force + (size_t)l * CYCLE_SAMPLES;
        const struct law *law = &s->p->law[l];

        for (int e = 0; e < law->start[1]; e++)
            for (int j = 0; law->end[e].dof == condense_dofs(s->c)[i] && j < CYCLE_SAMPLES; j++)
                r[j] += law->end[e].weight * f[j];
    }
}

static enum modal_status residual_of_cycle(const struct steady *s, struct balance *b,
                                           const struct cycle *c, struct orbit_grid *g,
                                           struct steady_point *point, struct modal_error *err)
{
    int q = b->q, K = b->H + 1;
    double complex *G = calloc((size_t)K, sizeof *G);
    double *r = calloc(CYCLE_SAMPLES, sizeof *r), squares = 0;
    enum modal_status rc =
        G == NULL || r == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory") : MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < q; i++) {
        double load = 0;

        for (int k = 0; k < K; k++) {
            memset(b->sum, 0, (size_t)q * sizeof *b->sum);
            stiffness_multiply_add(b->pattern, b->S, k, point->X + k, K, b->sum);
            G[k] = b->sum[i] - b->load[k * q + i];      /* S_k X_k - p_k of (1) */
            load += cabs(b->load[k * q + i]);
        }
        orbit_synthesize(g, b->H, G, 0, r);
        add_forces(s, c, i, r);                                                    /* (1) */
        for (int j = 0; j < CYCLE_SAMPLES; j++) {
            squares += r[j] * r[j] / CYCLE_SAMPLES;     /* the mean over the period */
            point->tail_max = fmax(point->tail_max, fabs(r[j]));
        }
        point->load_max = fmax(point->load_max, load);
    }
    point->tail_rms = sqrt(squares);
    free(G);
    free(r);
    return rc;
}

/* Whether rigid friction of the cycle never slips: its force turns where rounding has it, and has
 * no derivative. */
static bool holds_rigidly(const struct steady *s, const struct cycle *c)
{
    for (int l = 0; l < s->p->laws; l++)
        if (s->p->law[l].kind->set_valued && !c->acts[l])
            return true;
    return false;
}

/* Whether nothing holds the mean of POINT, of balance B, but what slips: the derivative there maps
 * a motion of all as one body to nothing.  It has as many unknowns as B, and is made where its
 * factors are cheap beside the search itself. */
static enum modal_status ask_mean(struct steady *s, const struct cycle *c, struct balance *b,
                                  struct steady_point *point, struct modal_error *err)
{
    enum modal_status rc;

    if (holds_rigidly(s, c) || steady_factor_work(s, b->H) > SHARE_OF_LOOK * s->budget.most)
        return MODAL_OK;
    rc = balance_residual(b, point->X, false, err);
    if (rc == MODAL_OK)
        rc = unheld_ask(b, &point->open, err);
    return rc == MODAL_OVERFLOW ? MODAL_OK : rc;
}

/* The cycle as the point's answer, at the options' H or at the least that meets the target. */
static enum modal_status cycle_point(struct steady *s, const struct cycle *c, double omega,
                                     struct steady_point *point, struct modal_error *err)
{
    double target = steady_target(s);
    int load = condense_highest_load(s->c), H = s->opt.harmonics > 0 ? s->opt.harmonics
                                                : load > LOAD_FEW    ? 2 * load
                                                                     : H_LEAST;
    struct orbit_grid *g = NULL;
    struct balance *b;
    enum modal_status rc = orbit_grid_new(CYCLE_SAMPLES, &g, err);

    /* The least H of those doubled whose truncation is half the target: the other half is the
     * rest's. */
    for (; rc == MODAL_OK; H *= 2) {
        rc = tail_of_samples(s, g, c, H, &point->truncation, &point->amplitude, err);
        if (s->opt.harmonics > 0 || point->truncation <= target * point->amplitude / 2
            || 2 * H > H_CYCLE_MOST)
            break;
    }
    if (rc == MODAL_OK)
        rc = point_of_cycle(s, c, g, H, point, err);
    if (rc == MODAL_OK)
        rc = steady_balance(s, H, &b, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, omega, 1, err);                /* recovery at this H */
    if (rc == MODAL_OK && c->closed)
        rc = ask_mean(s, c, b, point, err);
    if (rc == MODAL_OK && c->closed && c->force != NULL)
        rc = residual_of_cycle(s, b, c, g, point, err);
    else
        /* beside other laws nobody samples their forces */
        point->tail_rms = point->tail_max = NAN;
    orbit_grid_free(g);
    return rc;
}

/* POINT, which has the cycle's motion, told what C knows of it; its multipliers become POINT's. */
static void describe(const struct steady *s, struct cycle *c, struct steady_point *point)
{
    point->method = "events";
    point->converged = point->followed = c->closed;
    point->reason = c->closed ? NULL : "the motion followed through its events does not repeat";
    point->residual = point->step = c->closure;
    point->solver = c->closure * point->amplitude;      /* what a period leaves open */
    point->error = point->truncation + point->sampling + point->solver;
    for (int l = 0; l < point->laws; l++) {
        const struct law *law = &s->p->law[l];

        point->evaluations[l] = c->evaluations;
        point->acts[l] = c->acts[l];
        /* one that never slips holds what it did at the start */
        point->undetermined[l] = !c->acts[l] && (law->kind->set_valued || law->memory > 0);
    }
    if (!c->closed)                                     /* multipliers are of no motion */
        return;
    point->states = c->states;
    point->multiplier = c->multiplier;
    point->multiplier_error = c->error;
    c->multiplier = NULL;                               /* the point's now */
}

/* Rigid friction, alone: followed in time from event to event, stops and all. */
enum modal_status solve_by_cycle(struct steady *s, double omega, const struct steady_start *start,
                                 struct steady_point *point, struct modal_error *err)
{
    struct cycle_options opt = { s->opt.cancelled, s->opt.context, &s->budget };
    struct cycle c = { 0 };
    double *x = calloc(2 * (size_t)s->p->n + 1, sizeof *x);
    enum modal_status rc =
        x == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory") : MODAL_OK;

    /* From rest where no start is given. */
    if (rc == MODAL_OK && start != NULL)
        rc = state_of_start(s, omega, start, x, x + s->p->n, err);
    if (rc == MODAL_OK)
        rc = cycle_find(s->p, omega, x, x + s->p->n, &opt, &c, err);
    if (rc == MODAL_OK)
        rc = cycle_point(s, &c, omega, point, err);
    if (rc == MODAL_OK) {
        describe(s, &c, point);
        point->iterations = c.periods;
        point->attempts = 1;
    }
    cycle_done(&c);
    free(x);
    return rc;
}

/* max over counted dofs and instants of |X - OTHER|, the latter as settle_look gives it; X itself
 * into SEEN, in the same places, if that is not NULL. */
static enum modal_status distance_to(struct steady *s, const struct steady_point *point,
                                     const double *other, double *seen, double *far,
                                     struct modal_error *err)
{
    int count = s->opt.dofs != NULL ? s->opt.dofs_count : s->p->n, H = point->H;
    double complex *X = calloc((size_t)H + 1, sizeof *X);
    enum modal_status rc =
        X == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory") : MODAL_OK;

    *far = 0;
    for (int i = 0; rc == MODAL_OK && i < count; i++) {
        int dof = steady_counted_dof(s, i);

        rc = condense_recover(s->c, dof, H, point->X, H, X, err);
        for (int j = 0; rc == MODAL_OK && j < SETTLE_INSTANTS; j++) {
            double x = 0;

            for (int k = 0; k <= H; k++)
                x += creal(X[k] * cexp(I * TWO_PI * ((double)j * k / SETTLE_INSTANTS)));
            *far = fmax(*far, fabs(x - other[dof * SETTLE_INSTANTS + j]));
            if (seen != NULL)
                seen[dof * SETTLE_INSTANTS + j] = x;
        }
    }
    free(X);
    return rc;
}

/* Whether some law has events. */
static bool has_events(const struct program *p)
{
    for (int l = 0; l < p->laws; l++)
        if (p->law[l].kind->pieces != NULL)
            return true;
    return false;
}

/* Whether what is left of the equation of motion is too much for errors of first order. */
static bool leaves_much(const struct steady_point *point)
{
    return point->tail_max > MUCH_LEFT * point->load_max;
}

/* Whether the answer may be asked for in time: laws have events, nobody said how to solve, and what
 * its series leaves is much.  Fewer than H_LEAST harmonics are asked for as what they are, a
 * describing function. */
static bool wants_look(const struct steady *s, const struct steady_point *point)
{
    const struct steady_options *o = &s->opt;

    return point->converged && !point->followed && point->linear == NULL && !s->jumps
        && !s->searching && o->method == STEADY_AUTO && o->cutoff == 0 && !o->unlocated
        && !o->by_differences && !o->reduced && o->samples == 0 && isfinite(point->error)
        && point->H >= H_LEAST && has_events(s->p)
        && leaves_much(point) && settle_takes(s->p);
}

/* FINER, the like of POINT at twice its harmonics or up to FINER_MOST times as many, the least
 * that leave little; *FOUND false: there is none.  A period is marched from x and v at t = 0; of
 * harmonics that fall as k^-3 what lies past H is 1 / H of v beside 1 / H^2 of x, so that a march
 * from few of them sets out with rates H times further off than displacements are, and may end
 * anywhere though the motion is there. */
static enum modal_status find_finer(struct steady *s, const struct steady_point *point,
                                    struct steady_point *finer, bool *found,
                                    struct modal_error *err)
{
    const struct steady_point *from = point;
    double complex *X;
    struct balance *b;
    enum modal_status rc = MODAL_OK;

    *found = false;
    for (int times = 2; rc == MODAL_OK && !*found && times <= FINER_MOST
                        && times * point->H <= H_CYCLE_MOST; times *= 2) {
        const struct steady_start start = { from->q, from->H, from->X };
        struct steady_point next;

        rc = steady_balance(s, times * point->H, &b, err);
        if (rc == MODAL_OK)
            rc = balance_set(b, point->omega, 1, err);
        if (rc != MODAL_OK)
            return rc;
        X = calloc((size_t)b->q * ((size_t)b->H + 1) + 1, sizeof *X);
        if (X == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
        start_write(b, &start, X);
        rc = estimate_near(s, b, X, &next, found, err);
        free(X);
        if (rc != MODAL_OK || !*found)
            return rc;
        steady_point_done(finer);
        *finer = next;
        from = finer;
        *found = !leaves_much(finer);
    }
    return rc;
}

/* A period went FAR from POINT, and none closes near: the harmonics given may be too few to march
 * from.  With as many more as leave little it is what they say, which its error must reach. */
static enum modal_status ask_finer(struct steady *s, struct steady_point *point,
                                   struct modal_error *err)
{
    double *none = calloc(2 * SETTLE_INSTANTS * (size_t)s->p->n + 1, sizeof *none),
           *x = none + SETTLE_INSTANTS * (size_t)s->p->n, off = 0;
    struct steady_point finer = { 0 };
    struct balance *b;
    bool found = false;
    enum modal_status rc =
        none == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory")
                     : find_finer(s, point, &finer, &found, err);

    if (rc == MODAL_OK && found)
        rc = distance_to(s, &finer, none, x, &off, err);
    if (rc == MODAL_OK)
        rc = steady_balance(s, point->H, &b, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, point->omega, 1, err);      /* recovery at this H again */
    if (rc == MODAL_OK && found)
        rc = distance_to(s, point, x, NULL, &off, err);
    off += finer.error;
    if (rc == MODAL_OK && found && off < point->amplitude) {
        point->truncation += fmax(0, off - point->error);
        point->error = fmax(point->error, off);
    } else if (rc == MODAL_OK) {
        point->converged = false;
        point->fewer = true;
        point->reason = "a period that is marched from it does not end where it began";
    }
    steady_point_done(&finer);
    free(none);
    return rc;
}

/* POINT becomes the cycle C, if that closes; if not, and a period went FAR, more harmonics are
 * asked whether it is one. */
static enum modal_status take_cycle(struct steady *s, struct settle *search, struct cycle *c,
                                    double far, struct steady_point *point,
                                    struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (!c->closed)
        return far > OFF_MOST * point->error ? ask_finer(s, point, err) : MODAL_OK;
    rc = settle_multipliers(search, SHARE_OF_LOOK * s->budget.most, c, err);
    if (rc == MODAL_OK)
        rc = cycle_point(s, c, point->omega, point, err);
    if (rc == MODAL_OK)
        describe(s, c, point);
    return rc;
}

enum modal_status time_look(struct steady *s, struct steady_point *point, struct modal_error *err)
{
    struct cycle_options opt = { s->opt.cancelled, s->opt.context, &s->budget };
    const struct steady_start start = { point->q, point->H, point->X };
    size_t n = (size_t)s->p->n;
    double *x = calloc((2 + SETTLE_INSTANTS) * n + 1, sizeof *x), far = 0,
           most = SHARE_OF_LOOK * s->budget.most;
    struct settle *search = NULL;
    struct cycle c = { 0 };
    bool ended = false;
    enum modal_status rc;

    if (!wants_look(s, point)) {
        free(x);
        return MODAL_OK;
    }
    rc = x == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory")
                   : settle_new(s->p, point->omega, &opt, &search, err);
    if (rc == MODAL_OK)
        rc = state_of_start(s, point->omega, &start, x, x + n, err);
    if (rc == MODAL_OK)
        rc = settle_look(search, x, x + n, most, x + 2 * n, &ended, err);
    if (rc == MODAL_OK && ended)
        rc = distance_to(s, point, x + 2 * n, NULL, &far, err);
    if (rc == MODAL_OK && ended) {
        rc = settle_close_from(search, most, &c, err);
        if (rc == MODAL_OK)
            rc = take_cycle(s, search, &c, far, point, err);
    }
    cycle_done(&c);
    settle_free(search);
    free(x);
    /* what has no such states is not followed */
    return rc == MODAL_BAD_INPUT || rc == MODAL_TOO_LARGE ? MODAL_OK : rc;
}

/* A search in time and what it found. */
struct settled {
    struct settle *search;            /* NULL: it does not apply */
    struct cycle motion;
};

/* s->settled, from START or from rest; ATTRACTED: settle.h. */
static enum modal_status search_in_time(struct steady *s, double omega,
                                        const struct steady_start *start, bool attracted,
                                        struct modal_error *err)
{
    struct cycle_options opt = { s->opt.cancelled, s->opt.context, &s->budget };
    double *x = calloc(2 * (size_t)s->p->n + 1, sizeof *x), most;
    enum modal_status rc = MODAL_OK;

    most = SHARE_OF_TIME * (attracted ? s->budget.most - s->budget.spent : s->budget.most);
    s->settled = calloc(1, sizeof *s->settled);
    if (x == NULL || s->settled == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    if (rc == MODAL_OK && settle_takes(s->p))
        rc = settle_new(s->p, omega, &opt, &s->settled->search, err);
    /* what has no such states is not followed */
    if (rc == MODAL_BAD_INPUT || rc == MODAL_TOO_LARGE)
        rc = MODAL_OK;
    if (rc == MODAL_OK && s->settled->search != NULL && start != NULL)
        rc = state_of_start(s, omega, start, x, x + s->p->n, err);
    if (rc == MODAL_OK && s->settled->search != NULL)
        rc = settle_find(s->settled->search, x, x + s->p->n, most, attracted,
                         &s->settled->motion, err);
    free(x);
    return rc;
}

void time_forget(struct steady *s)
{
    if (s->settled == NULL)
        return;
    settle_free(s->settled->search);
    cycle_done(&s->settled->motion);
    free(s->settled);
    s->settled = NULL;
}

/* X of B's kept dofs from s->settled, as far as it is near; *FOUND: it is. */
static enum modal_status start_of_motion(struct steady *s, const struct balance *b,
                                         double complex *X, bool *found, struct modal_error *err)
{
    const struct cycle *c = &s->settled->motion;
    struct orbit_grid *g = NULL;
    enum modal_status rc = MODAL_OK;

    *found = s->settled->search != NULL && c->closure <= SETTLE_NEAR;
    if (*found)
        rc = orbit_grid_new(CYCLE_SAMPLES, &g, err);
    for (int i = 0; rc == MODAL_OK && *found && i < b->q; i++)
        orbit_analyze(g, c->x + (size_t)condense_dofs(s->c)[i] * CYCLE_SAMPLES, b->H,
                      X + i * (b->H + 1));
    orbit_grid_free(g);
    return rc;
}

enum modal_status time_start(struct steady *s, const struct balance *b,
                             const struct steady_start *start, double complex *X, bool *found,
                             struct modal_error *err)
{
    enum modal_status rc =
        s->settled != NULL ? MODAL_OK : search_in_time(s, b->omega, start, false, err);

    *found = false;
    return rc == MODAL_OK ? start_of_motion(s, b, X, found, err) : rc;
}

bool time_closed(const struct steady *s)
{
    return s->settled != NULL && s->settled->motion.closed;
}

enum modal_status time_attractor(struct steady *s, const struct balance *b, double complex *X,
                                 bool *found, struct modal_error *err)
{
    enum modal_status rc = search_in_time(s, b->omega, NULL, true, err);

    *found = false;
    return rc == MODAL_OK ? start_of_motion(s, b, X, found, err) : rc;
}

enum modal_status time_answer(struct steady *s, double omega, double rest,
                              struct steady_point *point, struct modal_error *err)
{
    const struct budget before = s->budget;
    const bool ready = time_closed(s);
    double most = ready ? READY * before.most : fmin(rest, SHARE_OF_TIME * before.most);
    enum modal_status rc = MODAL_OK;

    if (s->settled == NULL || s->settled->search == NULL || most <= 0)
        return MODAL_OK;
    s->budget.most += ready ? most : 0;
    rc = settle_close(s->settled->search, most, &s->settled->motion, err);
    if (ready && !s->settled->motion.closed)            /* the others have what they had */
        s->budget.most = before.most + (s->budget.spent - before.spent);
    if (rc != MODAL_OK || !s->settled->motion.closed)
        return rc;
    rc = settle_multipliers(s->settled->search, SHARE_OF_TIME * s->budget.most,
                            &s->settled->motion, err);
    if (rc == MODAL_OK)
        rc = cycle_point(s, &s->settled->motion, omega, point, err);
    if (rc == MODAL_OK)
        describe(s, &s->settled->motion, point);
    return rc;
}
