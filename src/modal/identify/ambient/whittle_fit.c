/*
 * whittle_fit.c - Fisher scoring
 *
 * A step is that of scoring.h, damped after Levenberg and Marquardt in the scale of the
 * information's diagonal.  What is formed of the information only begins the solution of a step,
 * and changes little along a climb: it is kept while steps settle and gain.
 */
#include "modal/identify/ambient/whittle_fit.h"
#include <math.h>
#include "modal/identify/ambient/scoring.h"

enum { STEPS_BLIND = 2 };        /* the first is damped: it tells little of what may be had */
static const double
    UNSETTLED = 100,             /* times more damping, not 10, where a step that does not gain took
                                    all of its products: a little more would settle as little */
    HOPE = 10;                   /* steps like the last: what gains less by a tenth each sums to */

struct climb {
    struct scoring *scoring;
    double damping, least;       /* least: a step that is damped less takes all of its products */
    double left;                 /* left: what a step that is hardly damped promises, else gained */
    double likelihoods, work;    /* the work of those; of all that was charged for */
    bool informed, there;        /* J is of a place near by that serves; it is of this place */
};

static void inform(struct climb *c, const struct whittle *m, const struct bins *s)
{
    scoring_inform(c->scoring, m, s);
    c->informed = c->there = true;
}

static void weigh(struct climb *c, struct whittle *m, const struct bins *s)
{
    m->likelihood = whittle_likelihood(m, s);
    c->likelihoods += whittle_work(m, s);
}

/* The step of this gradient, damped as far as it takes; false where none gains. */
static bool try_steps(struct climb *c, struct whittle *m, const struct bins *s)
{
    struct whittle trial;
    struct scoring_step step;
    double gained;

    for (; c->damping < WHITTLE_DAMPING_MOST; c->damping *= step.settled ? 10 : UNSETTLED) {
        step.settled = true;
        if (!scoring_step(c->scoring, m, s, c->damping, &step))
            continue;
        trial = *m;
        scoring_move(c->scoring, s, &trial);
        weigh(c, &trial, s);
        gained = trial.likelihood - m->likelihood;
        c->left = c->damping <= WHITTLE_DAMPING_FIRST ? step.promised : gained;
        if (gained >= 0) {
            *m = trial;
            if (!step.settled)
                c->least = 10 * c->damping;
            c->damping = fmax(c->damping / 10, c->least);
            c->informed = step.settled;
            c->there = false;
            return true;
        }
        if (!c->there)
            return false;
    }
    return false;
}

/* One step uphill; false where there is none. */
static bool step_up(struct climb *c, struct whittle *m, const struct bins *s)
{
    scoring_gradient(c->scoring, m, s);
    if (c->informed && try_steps(c, m, s))
        return true;
    if (!c->there)
        inform(c, m, s);
    return try_steps(c, m, s);
}

static enum modal_status climb(struct climb *c, struct whittle *m, const struct bins *s,
                               const struct whittle_limits *limits, struct modal_error *err)
{
    double spent;
    int steps = 0;

    m->converged = false;
    weigh(c, m, s);
    c->damping = WHITTLE_DAMPING_FIRST, c->least = WHITTLE_DAMPING_LEAST, c->left = HUGE_VAL;
    for (; steps < limits->most && !m->converged && *limits->work > 0
               && (steps < STEPS_BLIND || m->likelihood + HOPE * c->left > limits->needed);
         steps++) {
        if (limits->cancelled != NULL && limits->cancelled(limits->context))
            return modal_fail(err, MODAL_CANCELLED, "identify: cancelled");
        m->converged = !step_up(c, m, s) || c->left < limits->gain;
        spent = scoring_work(c->scoring) + c->likelihoods;
        *limits->work += c->work - spent;
        c->work = spent;
    }
    m->steps += steps;
    return MODAL_OK;
}

static enum modal_status find_errors(struct whittle *m, const struct bins *s,
                                     struct modal_error *err)
{
    struct scoring *w;
    enum modal_status rc = scoring_new(m, s, SCORING_ERRORS, &w, err);

    if (rc == MODAL_OK) {
        scoring_gradient(w, m, s);
        scoring_inform(w, m, s);
        scoring_errors(w, m);
    }
    scoring_free(w);
    return rc;
}

enum modal_status whittle_fit(struct whittle *m, struct bins *s,
                              const struct whittle_limits *limits, struct modal_error *err)
{
    struct climb c = { 0 };
    enum modal_status rc = scoring_new(m, s, SCORING_STEPS, &c.scoring, err);

    m->steps = 0;
    for (int i = 0; rc == MODAL_OK && i <= limits->corrections; i++) {
        if (i > 0)
            whittle_correct(m, s);
        rc = climb(&c, m, s, limits, err);
    }
    scoring_free(c.scoring);
    return rc == MODAL_OK && limits->errors && m->converged ? find_errors(m, s, err) : rc;
}
