/* simulate.c - see simulate.h
 *
 * One loop for every class: the next stop is a sample or a corner of the excitation, whichever
 * comes first, and the stepper carries the state there.  A corner within 1e-12 steps of a sample is
 * the sample's.
 */
#include "modal/scene/simulate.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include "modal/scene/readout.h"
#include "modal/scene/sources.h"
#include "modal/scene/sparse_motion.h"
#include "modal/scene/statespace.h"
#include "modal/scene/stepper.h"
#include "modal/scene/turning.h"

enum {
    ASK_EVERY = 4096,       /* samples: milliseconds */
    START_MOST = 100000,    /* steps before the first sample, a second or so */
};
static const double MAPS_COUNTED = 1e9;        /* more are not made */
static const double LIMIT = 1e300;             /* on the state: past it sums of squares overflow */

/* of dt: a corner so near a sample is the sample's */
static const double BESIDE = 1e-12;

struct motion {
    struct statespace *ss;
    struct sources *src;    /* made by `start`, as what follows */
    struct stepper *stepper;
    struct readout *readout;
    double *y, *F;  /* state; what loads and laws add */
    double t;  /* s: where y stands */
    int corner;                                /* the next one */
    double dt;  /* s */
};

static enum modal_status (*const steppers[])(const struct statespace *, const struct sources *,
                                             const struct stepper_options *, struct stepper **,
                                             struct modal_error *) = {
    [PROGRAM_LINEAR_CONSTANT] = linear_stepper_new,
    [PROGRAM_LINEAR_PERIODIC] = periodic_stepper_new,
    [PROGRAM_NONLINEAR] = nonlinear_stepper_new,
};

/* The stepper of the program's class, at t = 0 from its initial state; its state space is made. */
static enum modal_status start(struct program *p, const struct scene_time *time,
                               const struct simulate_options *opt, double maps_most,
                               struct motion *m, struct modal_error *err)
{
    struct stepper_options how = { .dt = time->dt,
                                   .tolerance = opt->tolerance,
                                   .substeps = opt->substeps,
                                   .steps_most = opt->steps_most,
                                   .maps_most = maps_most < MAPS_COUNTED ? (int64_t)maps_most : 0,
                                   .cancelled = opt->cancelled,
                                   .context = opt->context };
    enum modal_status rc = sources_new(p, true, &m->src, err);

    if (rc == MODAL_OK)
        rc = (opt->rk4 ? rk4_stepper_new
                       : steppers[p->seen_fixed && p->laws == 0 ? PROGRAM_LINEAR_CONSTANT
                                                                : program_class(p)])(
            m->ss, m->src, &how, &m->stepper, err);
    if (rc == MODAL_OK)
        rc = readout_new(m->ss, &m->readout, err);
    if (rc != MODAL_OK)
        return rc;
    m->dt = time->dt;  /* for "beside a sample" */
    m->y = calloc((size_t)m->ss->N + 1, sizeof *m->y);
    m->F = calloc((size_t)m->ss->N + 1, sizeof *m->F);
    if (m->y == NULL || m->F == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "simulate: out of memory");
    statespace_start(m->ss, m->y);
    return MODAL_OK;
}

/* Also of a motion half made. */
static void done(struct motion *m)
{
    if (m->stepper != NULL)
        m->stepper->free(m->stepper);  /* it borrows all the others */
    readout_free(m->readout);  /* before what it borrows */
    sources_free(m->src);
    statespace_free(m->ss);
    free(m->y);
    free(m->F);
}

/* The state carried over h; past LIMIT it is MODAL_OVERFLOW. */
static enum modal_status advance(struct motion *m, double h, struct modal_error *err)
{
    double t = m->t;
    enum modal_status rc = m->stepper->advance(m->stepper, t, h, m->y, err);

    if (rc == MODAL_OVERFLOW)
        return modal_fail(err, rc, "the motion leaves the range of doubles after t = %.9g s", t);
    for (int i = 0; rc == MODAL_OK && i < m->ss->N; i++)
        if (!(fabs(m->y[i]) < LIMIT))  /* a NaN too */
            return modal_fail(err, MODAL_OVERFLOW,
                              "the motion leaves the range of doubles between t = %.9g and %.9g s",
                              t, t + h);
    return rc;
}

/* Impulses and corners up to t (and rounding past it); the state stands at the last of them. */
static void pass_corners(struct motion *m, double t)
{
    const struct sources *src = m->src;

    while (m->corner < src->corners && src->corner[m->corner].t <= t + BESIDE * m->dt) {
        const struct source_corner *c = &src->corner[m->corner++];
        /* what holds from the corner on is asked at its own time */
        m->t = fmax(m->t, c->t);
        if (c->dof >= 0)
            cblas_daxpy(m->ss->N, c->impulse, m->ss->B + (size_t)c->dof * (size_t)m->ss->N, 1, m->y,
                        1);
    }
}

/* To time t: STEP its nominal distance from the last sample where no corner lies between. */
static enum modal_status move_to(struct motion *m, double t, double step, struct modal_error *err)
{
    bool whole = true;

    while (m->corner < m->src->corners && m->src->corner[m->corner].t < t - BESIDE * m->dt) {
        double at = m->src->corner[m->corner].t;  /* the next before t */
        enum modal_status rc = at > m->t ? advance(m, at - m->t, err) : MODAL_OK;
        if (rc != MODAL_OK)
            return rc;
        m->t = at;
        pass_corners(m, at);
        whole = false;  /* what is left is no whole step: its map is of its own */
    }
    if (t > m->t) {
        enum modal_status rc = advance(m, whole ? step : t - m->t, err);
        if (rc != MODAL_OK)
            return rc;
        m->t = t;  /* not m->t + h: samples are at their own times */
    }
    pass_corners(m, t);
    return MODAL_OK;
}

/* One row of the record; what loads and laws add is part of its accelerations. */
static enum modal_status read_sample(struct motion *m, double *out, struct modal_error *err)
{
    enum modal_status rc = m->stepper->force(m->stepper, m->t, m->y, m->F, err);

    if (rc == MODAL_OK)
        readout_at(m->readout, m->t, m->y, m->F, out);
    for (int i = 0; rc == MODAL_OK && i < m->ss->p->outputs; i++)
        if (!isfinite(out[i]))               /* a force on next to no mass */
            rc = modal_fail(err, MODAL_OVERFLOW,
                            "output \"%.40s\" leaves the range of doubles at t = %.9g s",
                            m->ss->p->output[i].name, m->t);
    return rc;
}

/*
 * To the first sample, in equal steps of dt or less often than START_MOST: the map of one long step
 * is that of a short one squared over and over, and each squaring doubles what rounding left of the
 * slow motions beside stiff ones.
 */
static enum modal_status move_to_start(struct motion *m, const struct scene_time *time,
                                       const struct simulate_options *opt, struct modal_error *err)
{
    double steps = fmin(fmax(ceil(time->start / time->dt - 1e-9), 1), START_MOST);
    enum modal_status rc = MODAL_OK;

    for (long k = 1; rc == MODAL_OK && k <= (long)steps; k++) {
        if (k % ASK_EVERY == 0 && opt->cancelled != NULL && opt->cancelled(opt->context))
            return modal_fail(err, MODAL_CANCELLED, "simulate: cancelled at t = %.9g s", m->t);
        rc = move_to(m, time->start * ((double)k / steps), time->start / steps, err);
    }
    return rc;
}

/* From stop to stop: samples are counted, not summed, so that the last is at its time. */
static enum modal_status run(struct motion *m, const struct scene_time *time,
                             const struct simulate_options *opt, double *signals,
                             struct modal_error *err)
{
    size_t channels = (size_t)m->ss->p->outputs;
    enum modal_status rc = MODAL_OK;

    pass_corners(m, 0);
    for (long k = 0; rc == MODAL_OK && k < time->samples; k++) {
        if (k % ASK_EVERY == 0 && opt->cancelled != NULL && opt->cancelled(opt->context))
            return modal_fail(err, MODAL_CANCELLED, "simulate: cancelled at t = %.9g s", m->t);
        if (k % ASK_EVERY == 0 && opt->progress != NULL)
            opt->progress(opt->context, (double)k / (double)time->samples);
        rc = k == 0 ? move_to_start(m, time, opt, err)
                    : move_to(m, time->start + (double)k * time->dt, time->dt, err);
        if (rc == MODAL_OK)
            rc = read_sample(m, signals + (size_t)k * channels, err);
    }
    return rc;
}

/* The program as it was lowered, not turned.  How many maps its events take is seen by stepping
 * alone. */
static enum modal_status simulate_on_its_axes(struct program *p, const struct scene_time *time,
                                              const struct simulate_options *opt, double *signals,
                                              struct simulate_result *out, struct modal_error *err)
{
    struct motion m = { 0 };
    enum modal_status rc = statespace_new(p, &m.ss, err);
    double maps = rc != MODAL_OK || opt->rk4 || opt->tolerance > 0 || m.ss->modal
                      ? HUGE_VAL : sparse_motion_maps(p, time);
    bool leaps = maps < 1;

    if (rc == MODAL_OK && !leaps)
        rc = start(p, time, opt, maps, &m, err);
    if (rc == MODAL_OK && !leaps) {
        rc = run(&m, time, opt, signals, err);
        leaps = rc == MODAL_TOO_LARGE && (double)m.stepper->maps > maps;
    }
    if (rc == MODAL_OK && !leaps && m.stepper->report != NULL)
        m.stepper->report(m.stepper, p);
    if (rc == MODAL_OK && !leaps)
        *out = (struct simulate_result){ m.stepper->name, m.stepper->products, m.stepper->maps,
                                         m.stepper->steps, m.stepper->rejected };
    done(&m);
    return leaps ? sparse_motion(p, time, opt, signals, out, err) : rc;
}

/* A periodic program that turning axes make constant is stepped there, its channels read out on
 * its own. */
static enum modal_status simulate_turned(struct program *p, struct program *turned,
                                         const struct scene_time *time,
                                         const struct simulate_options *opt, double *signals,
                                         struct simulate_result *out, struct modal_error *err)
{
    enum modal_status rc = simulate_on_its_axes(turned, time, opt, signals, out, err);

    for (int i = 0; i < p->effects; i++) {
        p->effect[i].evaluations = turned->effect[i].evaluations;
        p->effect[i].seconds = turned->effect[i].seconds;
        p->effect[i].active = turned->effect[i].active;
    }
    return rc;
}

enum modal_status simulate(struct program *p, const struct scene_time *time,
                           const struct simulate_options *opt, double *signals,
                           struct simulate_result *out, struct modal_error *err)
{
    static const struct simulate_options none;
    struct program *turned = NULL;
    struct simulate_options bounded;
    enum modal_status rc;

    if (opt == NULL)
        opt = &none;
    bounded = *opt;
    if (p->outputs == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "sensors",
                                "sensors is an empty list: a simulation has nothing to record; "
                                "list at least one, or leave it out for every dof");
    if ((double)time->samples * p->outputs > SIMULATE_VALUES_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "time",
                                "%ld samples of %d channels are more than %d numbers",
                                time->samples, p->outputs, SIMULATE_VALUES_MOST);
    if (!opt->rk4 && (opt->leaps || sparse_motion_wins(p, time)))
        return sparse_motion(p, time, opt, signals, out, err);
    /* How often laws change, and cut the steps of the whole, is seen by stepping alone; who names a
     * tolerance has the way that makes no error in what is linear. */
    if (!opt->rk4 && opt->steps_most == 0 && opt->tolerance == 0)
        bounded.steps_most = sparse_motion_worth(p, time);
    rc = p->harmonics > 0 ? program_turned(p, &turned, err) : MODAL_OK;
    if (rc == MODAL_OK)
        rc = turned != NULL ? simulate_turned(p, turned, time, &bounded, signals, out, err)
                            : simulate_on_its_axes(p, time, &bounded, signals, out, err);
    program_turned_free(turned);
    if (rc == MODAL_TOO_LARGE && bounded.steps_most > opt->steps_most)
        rc = sparse_motion(p, time, opt, signals, out, err);
    return rc;
}
