/*
 * stability.c - see stability.h
 *
 * The multipliers are the eigenvalues of the monodromy matrix (monodromy.h), its steps doubled
 * until they settle.  A linear scene has its own whatever the motion, so has one of many laws that
 * all rest (at_rest.h), and a motion followed from event to event comes with them.  Of more than
 * STABILITY_STATES_MOST states, or where two maps cost more than is allowed, the leading
 * multipliers alone are asked for (large_stability.h).
 *
 * A multiplier rho is of modulus 1 where ||rho| - 1| is below its error.  With error e_m the change
 * of the multipliers at the m-th doubling of the steps, doubling ends when
 *
 *     e_m <= max(SETTLED, 16 eps steps) max(1, |rho_1|)   or   e_m > e_{m-1} / 2,               (1)
 *
 * settled, or rounding.  The work allowed is that of a solution, point.c (1): a scene whose map
 * costs more has no verdict, one whose second map does has a verdict without its error.
 */
#include "modal/steady/stability.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/eigen.h"
#include "modal/scene/floquet.h"
#include "modal/scene/period_map.h"
#include "modal/scene/program.h"
#include "modal/steady/at_rest.h"
#include "modal/steady/disturbance.h"
#include "modal/steady/large_stability.h"
#include "modal/steady/monodromy.h"
#include "modal/steady/reduction.h"
#include "modal/steady/session.h"

static const double TWO_PI = 6.283185307179586477;   /* a period of theta */
/* So many estimated errors of the multipliers count as one: the estimate is of the last
 * doubling. */
static const double ERRORS = 10;
/* The change at a doubling that says the multipliers have settled, for one near 1: ERRORS of it are
 * within what is on the circle whatever they are.  They are good to a 63rd of it, as the steps are
 * of the sixth order. */
static const double SETTLED = STABILITY_ON_CIRCLE / 10;
/* Rounding of a product of maps, in units of the last place a step. */
static const double ROUNDING = 16;
/* A doubling that does not halve the change has met rounding: the method is of the sixth order. */
static const double STALLS = 0.5;
/* Share of a map's counted work that squarings are besides, in steps that resolve the structure:
 * chosen, three in fourteen products. */
static const double SQUARINGS = 0.25;
enum {
    STEPS_FIRST = 32,   /* of sixth order: smooth matrices end at once */
    STEPS_RESOLVE = 512,    /* up to which steps resolve the motion's harmonics, two each */
    STEPS_MOST = 16384,   /* nine doublings: 2^54 in the sixth order */
    ROOM_TO_DOUBLE = 4      /* of the steps, left for the errors' sake */
};

/* The multipliers: eigenvalues of the map. */
static enum modal_status eigenvalues(struct monodromy *m, double complex *out,
                                     struct modal_error *err)
{
    int n = m->order;
    struct matrix A = { n, n, n, m->work[0] };

    memcpy(A.x, m->map, (size_t)n * (size_t)n * sizeof *m->map);
    return eigen_by_size(&A, out, err);
}

/* Whether more steps are of no use: the multipliers are as exact as they get. */
static bool has_settled(const struct stability *out, int steps, double last)
{
    double rounding =
        fmax(SETTLED, ROUNDING * DBL_EPSILON * steps) * fmax(1, cabs(out->multiplier[0]));

    return out->error <= rounding || out->error > STALLS * last;
}

/* Steps that resolve the motion, its harmonics and the structure's. */
static int first_steps(const struct monodromy *m)
{
    int steps = STEPS_FIRST;

    while ((steps < 2 * m->point->H && steps < STEPS_RESOLVE)
           || (steps < 2 * monodromy_fastest(m) && steps < STEPS_MOST / ROOM_TO_DOUBLE))
        steps *= 2;
    return steps;
}

/* Whether two maps, the second of twice the steps, cost more than is allowed. */
static bool costs_too_much(const struct monodromy *m)
{
    int steps = m->of->varies ? first_steps(m) : 0;

    return m->budget->spent
               + (monodromy_work(m, steps) + monodromy_work(m, 2 * steps)) * (1 + SQUARINGS)
           > m->budget->most;
}

/* How far the N multipliers A are from those of B at most, each from the nearest. */
static double farthest(const double complex *a, const double complex *b, int n)
{
    double most = 0;

    for (int i = 0; i < n; i++) {
        double nearest = HUGE_VAL;

        for (int k = 0; k < n; k++)
            nearest = fmin(nearest, cabs(a[i] - b[k]));
        most = fmax(most, nearest);
    }
    return most;
}

/* How far N multipliers NOW are from those BEFORE a doubling: many of one modulus, as where damping
 * is in proportion to mass, have no order.  Both ways, or one that is lost would be none. */
static double change(const double complex *now, const double complex *before, int n)
{
    return fmax(farthest(now, before, n), farthest(before, now, n));
}

/* Steps doubled until the multipliers settle, to SETTLED or the rounding of as many products.  A
 * map that overflows is tried again with more steps, in case they were too long for a stiff dof. */
static enum modal_status settle(struct monodromy *m, struct stability *out, struct modal_error *err)
{
    double complex *before = calloc((size_t)m->order + 1, sizeof *before);
    double next = 0, last = HUGE_VAL;
    int steps = first_steps(m), passes = 0;          /* one alone says nothing of its error */
    enum modal_status rc =
        before == NULL ? modal_fail(err, MODAL_NO_MEMORY, "stability: no memory") : MODAL_OK;

    for (; rc == MODAL_OK; steps *= 2) {
        double before_work = m->budget->spent;

        /* what the last map cost twice, and the first at least this */
        if (before_work + fmax(next, monodromy_work(m, steps)) > m->budget->most) {
            m->of->reason = passes == 0 ? "too many states and steps for the monodromy matrix"
                : m->of->reason;
            break;
        }
        rc = monodromy_around(m, steps, err);
        next = 2 * (m->budget->spent - before_work);
        /* steps too long for a stiff dof */
        if (rc == MODAL_OK && m->of->reason == NULL && !monodromy_is_finite(m)) {
            /* a stiff dof wants shorter ones */
            m->of->reason =
                m->of->varies && steps < STEPS_MOST ? NULL : "the disturbances overflow";
            passes = 0;
            if (m->of->reason == NULL)
                continue;
        }
        if (rc != MODAL_OK || m->of->reason != NULL
            || (rc = eigenvalues(m, out->multiplier, err)) != MODAL_OK)
            break;
        /* one pass says nothing of its error */
        out->error = passes++ > 0 || !m->of->varies ? 0 : NAN;
        if (passes > 1)
            out->error = change(out->multiplier, before, m->order);
        memcpy(before, out->multiplier, (size_t)m->order * sizeof *before);
        if (!m->of->varies || steps >= STEPS_MOST || (passes > 1 && has_settled(out, steps, last)))
            break;
        last = passes > 1 ? out->error : HUGE_VAL;
    }
    free(before);
    return rc;
}

/* The verdict from the multipliers found, |.| descending. */
static void judge(struct stability *out)
{
    /* A multiplier is told from 1 by no less than its own error. */
    double margin = fmax(STABILITY_ON_CIRCLE, ERRORS * out->error);

    out->largest = cabs(out->multiplier[0]);
    out->verdict = fabs(out->largest - 1) <= margin ? STABILITY_UNDECIDED
                   : out->largest < 1               ? STABILITY_STABLE
                                                    : STABILITY_UNSTABLE;
}

/* No laws: the program's own multipliers, whatever the motion. */
static enum modal_status linear_stability(const struct program *p, double omega,
                                          struct stability *out, struct modal_error *err)
{
    struct program linear = *p;
    struct floquet f = { 0 };
    struct modal_error why;
    enum modal_status rc;

    linear.omega = omega;
    linear.period = TWO_PI / omega;           /* of the loads: multipliers are over one of theirs */
    rc = floquet(&linear, NULL, &f, &why);
    if (rc != MODAL_OK) {
        out->reason = rc == MODAL_OVERFLOW ? "the disturbances overflow"
                      : rc == MODAL_TOO_LARGE
                          ? "more states than multipliers are computed for"
                          : "the multipliers of the linear scene could not be computed";
        return rc == MODAL_NO_MEMORY || rc == MODAL_CANCELLED
                   ? modal_fail(err, rc, "%s", why.message)
                   : MODAL_OK;
    }
    out->multiplier = calloc((size_t)f.count + 1, sizeof *out->multiplier);
    if (out->multiplier == NULL) {
        floquet_done(&f);
        return modal_fail(err, MODAL_NO_MEMORY, "stability: no memory");
    }
    memcpy(out->multiplier, f.multiplier, (size_t)f.count * sizeof *f.multiplier);
    out->count = f.count;
    out->largest = f.max_multiplier;
    out->error = f.error;
    out->verdict = f.stable == FLOQUET_STABLE     ? STABILITY_STABLE
                   : f.stable == FLOQUET_UNSTABLE ? STABILITY_UNSTABLE
                                                  : STABILITY_UNDECIDED;
    floquet_done(&f);
    return MODAL_OK;
}

/* Of a motion followed from event to event: its multipliers came with it. */
static enum modal_status known_stability(const struct steady_point *point, struct stability *out,
                                         struct modal_error *err)
{
    out->multiplier = calloc((size_t)point->states + 1, sizeof *out->multiplier);
    if (out->multiplier == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "stability: no memory");
    memcpy(out->multiplier, point->multiplier, (size_t)point->states * sizeof *out->multiplier);
    out->count = point->states;
    out->error = point->multiplier_error;
    judge(out);
    return MODAL_OK;
}

/* Of a motion in which every law rests: disturbances see springs, and what a slider holds
 * stays, a multiplier of 1 each. */
static enum modal_status stability_at_rest(const struct steady *s, const struct steady_point *point,
                                           struct stability *out, struct modal_error *err)
{
    const struct program *p = s->p;
    double complex *all;
    int held = 0;
    enum modal_status rc = linear_stability(at_rest_program(s->rest), point->omega, out, err);

    for (int l = 0; l < p->laws; l++)
        held += point->undetermined[l] ? p->law[l].memory : 0;
    if (rc != MODAL_OK || held == 0 || out->multiplier == NULL)
        return rc;
    all = malloc(((size_t)out->count + (size_t)held) * sizeof *all);
    if (all == NULL) {
        stability_done(out);
        return modal_fail(err, MODAL_NO_MEMORY, "stability: no memory");
    }
    for (int i = 0, from = 0; i < out->count + held; i++) {
        bool own = from < out->count
            && (cabs(out->multiplier[from]) > 1 || i - from == held);

        all[i] = own ? out->multiplier[from++] : 1;     /* |.| descending */
    }
    free(out->multiplier);
    out->multiplier = all;
    out->count += held;
    judge(out);
    return MODAL_OK;
}

/* By the whole monodromy matrix, or of many states by the leading multipliers. */
static enum modal_status nonlinear_stability(struct disturbance *u, struct stability *out,
                                             struct modal_error *err)
{
    struct monodromy m = { .of = u };
    bool many = 2 * u->n + u->nz + u->sliders > STABILITY_STATES_MOST, large = many;
    enum modal_status rc = many ? MODAL_OK : monodromy_prepare(&m, err);

    if (rc == MODAL_OK && u->reason == NULL && !many)
        large = period_map_serves(u->p) && costs_too_much(&m);
    if (rc == MODAL_OK && u->reason == NULL && !large) {
        out->multiplier = calloc((size_t)m.order + 1, sizeof *out->multiplier);
        rc = out->multiplier == NULL ? modal_fail(err, MODAL_NO_MEMORY, "stability: no memory")
                                     : settle(&m, out, err);
    }
    if (rc == MODAL_OK && u->reason == NULL && !large) {
        out->count = m.order;
        judge(out);
    }
    monodromy_done(&m);
    return rc == MODAL_OK && large ? large_stability(u, out, err) : rc;
}

/* S's budget becomes ANSWER and the WORK of a verdict of it: what the answer has left stays, as far
 * as all its verdicts take no more than one may. */
static void charge_verdict(struct steady *s, struct budget answer, struct budget work)
{
    double apart = fmin(work.most, answer.apart + work.spent);

    s->budget.spent = answer.spent + work.spent;
    s->budget.most = answer.most > 0 ? answer.most + apart - answer.apart : 0;
    s->budget.apart = apart;
}

bool stability_pays(const struct budget *work, const struct stability *known)
{
    return !budget_spent(work) || work->apart < known->work.most;
}

/* Of S's own program. */
static enum modal_status stability_alone(struct steady *s, const struct steady_point *point,
                                         struct stability *out, struct modal_error *err)
{
    struct disturbance u = { .s = s, .p = steady_program(s), .point = point, .budget = &s->budget };
    struct budget answer;                               /* that this verdict is of */
    enum modal_status rc;

    memset(out, 0, sizeof *out);
    if (u.p->laws == 0)
        return linear_stability(u.p, point->omega, out, err);
    if (point->states > 0)
        return known_stability(point, out, err);
    if (point->linear != NULL)
        return stability_at_rest(s, point, out, err);
    answer = s->budget;
    steady_allow_work(s);
    if (point->followed)
        u.reason = "disturbances of rigid friction beside laws with a memory, or of more than 16 "
                   "dofs, are not followed";
    rc = disturbance_begin(&u, err);
    if (rc == MODAL_OK && u.reason == NULL)
        rc = disturbance_follow(&u, err);
    if (rc == MODAL_OK && u.reason == NULL)
        rc = nonlinear_stability(&u, out, err);
    out->work = s->budget;
    charge_verdict(s, answer, out->work);
    out->reason = u.reason;
    if (rc != MODAL_OK || u.reason != NULL) {
        free(out->multiplier);
        out->multiplier = NULL;
        out->count = 0;
    }
    disturbance_done(&u);
    return rc;
}

/* The error that a reduction leaves in the largest multiplier, by the like of a finer one. */
static enum modal_status add_reduction(struct steady *s, const struct steady_point *point,
                                       struct stability *out, struct modal_error *err)
{
    struct stability st = { 0 };
    struct steady_point other;
    struct steady *finer;
    enum modal_status rc = reduction_solve(s, point, &finer, &other, err);

    if (rc == MODAL_OK && other.converged)
        rc = stability_alone(finer, &other, &st, err);
    if (rc == MODAL_OK && st.verdict != STABILITY_UNKNOWN) {
        out->error += fabs(st.largest - out->largest);
        judge(out);
    } else if (rc == MODAL_OK) {
        out->verdict = STABILITY_UNKNOWN;
        out->reason = "its reduction's error could not be estimated";
    }
    stability_done(&st);
    steady_point_done(&other);
    return rc;
}

enum modal_status stability_of(struct steady *s, const struct steady_point *point,
                               struct stability *out, struct modal_error *err)
{
    enum modal_status rc = stability_alone(s, point, out, err);

    return rc == MODAL_OK && steady_reduction(s) != NULL && out->verdict != STABILITY_UNKNOWN
        ? add_reduction(s, point, out, err) : rc;
}

void stability_done(struct stability *s)
{
    free(s->multiplier);
    memset(s, 0, sizeof *s);
}
