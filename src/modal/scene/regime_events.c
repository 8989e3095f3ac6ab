/*
 * regime_events.c - see regime_events.h
 *
 * Between the knots a probe is the Hermite polynomial of its displacements and rates (degree 2
 * STAGES + 1).  The piece of a law at theta is the regime it reports; of a law with memory, that of
 * its place at theta reached from its memory a moment before, taken back along the rate, so that a
 * slider that has turned round shows.  (Not a moment after: a contact taken to close that much
 * early sets its slider down that much off its place, an error of first order in the step.)  A
 * set-valued law that slips leaves its piece where its rate changes sign, one that sticks where the
 * force that holds it passes its limit: the polynomial of its forces, put right at the start by
 * SHIFT (1 - theta).  One that starts to slip does so at a rate of 0, give or take rounding: it
 * cannot leave a piece that it has not been seen in.
 *
 * The step is looked at in GRID points; the first change against the piece at the first of them is
 * bisected.
 */
#include "modal/scene/regime_events.h"
#include <math.h>

enum { S = COLLOCATION_STAGES, KNOTS = S + 1, TERMS = 2 * KNOTS, INPUTS = LAW_INPUTS_MOST };
static const double GRID[] = { 1e-4, 0.04, 0.09, 0.16, 0.25, 0.35, 0.45, 0.55,
                               0.65, 0.75, 0.84, 0.92, 1.0,  1.1,  1.2 };
enum { POINTS = sizeof GRID / sizeof *GRID };
enum { BISECTIONS = 60 };                      /* of a step: down to one unit in the last place */
static const double APART = 1e-14;             /* of a step: closer, theta is rounding */
static const double MOMENT = 2e-5;             /* of a step: a fifth of the first grid point */

struct view {                    /* one law over one step */
    struct ports *p;  /* borrowed, as all here */
    const struct collocation *c;
    const struct port_law *law;
    int index;  /* of the law in ports */
    double t, h;  /* the step */
    double x[TERMS];             /* knots, each twice */
    double a[INPUTS][TERMS];     /* Newton coefficients of each input */
    const double *memory, *phi;  /* at its start; forces at its nodes */
    double shift;                /* of a stuck slider's force at theta = 0 */
    /* a rate of this size may be rounding: its own; of displacements that differ little in a
     * short step */
    double quiet, blur;
};

/* Newton's divided differences on doubled knots: values d and slopes h v. */
static void interpolate(struct view *view, int input, const double *knots)
{
    int q = view->p->probes, at = view->law->channel + input;
    double *a = view->a[input], difference[TERMS];
    const double *node = collocation_nodes(view->c);

    for (int i = 0; i < TERMS; i++) {
        view->x[i] = i < 2 ? 0 : node[i / 2 - 1];  /* doubled knots: values and slopes */
        difference[i] = knots[(size_t)(i / 2) * 2 * (size_t)q + (size_t)at];
    }
    a[0] = difference[0];
    for (int order = 1; order < TERMS; order++) {
        for (int i = 0; i + order < TERMS; i++) {
            double width = view->x[i + order] - view->x[i];
            difference[i] =
                width == 0 ? view->h * knots[(size_t)(i / 2) * 2 * (size_t)q + (size_t)(q + at)]
                           : (difference[i + 1] - difference[i]) / width;
        }
        a[order] = difference[0];  /* Newton's coefficient */
    }
}

/* Displacements and rates of the interpolant at theta, by Horner's rule on Newton's form. */
static void motion(const struct view *view, double theta, double *d, double *v)
{
    for (int i = 0; i < view->law->law->kind->inputs; i++) {
        double value = view->a[i][TERMS - 1], slope = 0;
        for (int k = TERMS - 2; k >= 0; k--) {
            /* before value: Horner with its derivative */
            slope = slope * (theta - view->x[k]) + value;
            value = value * (theta - view->x[k]) + view->a[i][k];
        }
        d[i] = value;
        v[i] = slope / view->h;  /* per second */
    }
}

/* A rigid slider's piece: slipping on, or the side on which its force leaves the limit. */
static int set_valued_piece(const struct view *view, double theta)
{
    double l[S], force = 0, d[INPUTS], v[INPUTS], limit = view->law->law->limit;

    if (view->law->held != 0) {
        motion(view, theta, d, v);
        /* one just let go starts at a rate of 0, give or take rounding */
        return v[0] * view->law->held > -view->quiet;
    }
    collocation_lagrange(view->c, theta, l);
    for (int j = 0; j < S; j++)
        force +=
            l[j] * view->phi[(size_t)j * (size_t)view->p->channels + (size_t)view->law->channel];
    force += view->shift * (1 - theta);
    return force > limit ? 1 : force < -limit ? -1 : 0;  /* which way it will slip */
}

/* The regime at theta, with memory reached from a moment before. */
static enum modal_status piece_at(const struct view *view, double theta, int *piece,
                                  struct modal_error *err)
{
    double d[INPUTS], v[INPUTS], before[INPUTS], turned[1024], unused[1024],
        moment = MOMENT * view->h;
    double t = view->t + theta * view->h;
    int regime;
    enum modal_status rc;

    if (view->law->law->kind->set_valued) {
        *piece = set_valued_piece(view, theta);
        return MODAL_OK;
    }
    motion(view, theta, d, v);
    if (view->law->law->memory == 0)
        return ports_law(view->p, view->index, t, d, v, view->memory, unused, piece, err);
    for (int i = 0; i < view->law->law->kind->inputs; i++)
        before[i] = d[i] - moment * v[i];  /* taken back along the rate */
    rc = ports_law(view->p, view->index, t, before, v, view->memory, turned, &regime, err);
    if (rc == MODAL_OK)
        rc = ports_law(view->p, view->index, t, d, v, turned, unused, piece, err);
    return rc;
}

/* The instant between LOW, in PIECE, and HIGH, out of it: the end that is out. */
static enum modal_status bisect(const struct view *view, int piece, double low, double high,
                                double *theta, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < BISECTIONS && high - low > APART && rc == MODAL_OK; i++) {
        double middle = (low + high) / 2;
        int now;
        rc = piece_at(view, middle, &now, err);
        if (now == piece)
            low = middle;
        else
            high = middle;
    }
    *theta = high;  /* out of the piece: the step ends past it, by rounding */
    return rc;
}

/* What the polynomial of a stuck slider's force is off the exact one at the start. */
static double shift_of(const struct view *view, double hold)
{
    double l[S], force = 0;

    if (isnan(hold) || view->law->held != 0)
        return 0;
    collocation_lagrange(view->c, 0, l);
    for (int j = 0; j < S; j++)
        force +=
            l[j] * view->phi[(size_t)j * (size_t)view->p->channels + (size_t)view->law->channel];
    return hold - force;
}

/* A slider is known to be in its piece; one that slips, where its rate says so. */
static enum modal_status find_in_set_valued(struct view *view, double limit, double *theta,
                                            struct modal_error *err)
{
    int own = view->law->held != 0, now = own;
    bool seen = !own;
    double low = 0;

    if (own) {
        double d[INPUTS], v[INPUTS];

        motion(view, 0, d, v);
        seen = v[0] * view->law->held > view->quiet;
        view->quiet += seen ? 0 : view->blur;  /* just loose: its rate is a small difference */
    }
    for (int i = 0; i < POINTS && GRID[i] <= limit; i++) {
        now = set_valued_piece(view, GRID[i]);
        if (now != own && seen)
            return bisect(view, own, low, GRID[i], theta, err);
        seen |= now == own;  /* it cannot leave what it was not seen in */
        low = GRID[i];
    }
    return MODAL_OK;
}

/* The first change of one law's piece on the grid, or HUGE_VAL. */
static enum modal_status find_in(struct view *view, double limit, double *theta,
                                 struct modal_error *err)
{
    int first, now;
    enum modal_status rc;

    *theta = HUGE_VAL;
    if (view->law->law->kind->set_valued)
        return find_in_set_valued(view, limit, theta, err);
    rc = piece_at(view, GRID[0], &first, err);
    for (int i = 1; i < POINTS && GRID[i] <= limit && rc == MODAL_OK; i++) {
        rc = piece_at(view, GRID[i], &now, err);
        if (rc == MODAL_OK && now != first)
            return bisect(view, first, GRID[i - 1], GRID[i], theta, err);
    }
    return rc;
}

enum modal_status events_find(struct ports *p, const struct collocation *c, double t, double h,
                              const double *knots, const double *phi, const double *memory,
                              const double *quiet, const double *blur, const double *hold,
                              double limit, struct event *out, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    *out = (struct event) { HUGE_VAL, -1 };
    for (int i = 0; i < p->laws && rc == MODAL_OK; i++) {
        const struct law *law = p->law[i].law;
        struct view view = { .p = p,
                             .c = c,
                             .law = &p->law[i],
                             .index = i,
                             .t = t,
                             .h = h,
                             .memory = memory + p->law[i].memory,
                             .phi = phi,
                             .quiet = quiet[p->law[i].channel],
                             .blur = blur[p->law[i].channel] / h };
        double theta;
        /* no events, or not to be asked twice */
        if (law->kind->smooth || law->kind->restart != NULL)
            continue;
        for (int k = 0; k < law->kind->inputs; k++)
            interpolate(&view, k, knots);
        if (law->kind->set_valued)
            view.shift = shift_of(&view, hold[p->law[i].channel]);
        rc = find_in(&view, limit, &theta, err);
        if (rc == MODAL_OK && theta < out->theta)
            *out = (struct event) { theta, i };
    }
    return rc;
}
