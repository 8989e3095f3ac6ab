/*
 * leap_events.c - see leap_events.h
 *
 * As in regime_events.c the piece of a law at theta is the regime that it reports, and that of one
 * with memory is asked from its place a moment before, taken back along the rate, so that a slider
 * that has turned round shows.  The leap is looked at in GRID points; the first change is bisected.
 *
 * A rigid slider's piece is the way that it remembers, wherever it is just after it began to slip,
 * where its rate is rounding: it ends where its dof goes back, or of one that sticks where more
 * pulls at that than it holds.  What is left until then is one number over the leap, whose minima
 * between points are looked for: a dof that goes back and on within a tenth of a leap had stood.
 */
#include "modal/scene/leap_events.h"
#include <math.h>
#include "modal/scene/dofwise.h"

static const double GRID[] = { 1e-4, 0.05, 0.12, 0.2, 0.3, 0.4, 0.5, 0.6,
                               0.7,  0.8,  0.9,  1.0, 1.1, 1.2 };
enum { POINTS = sizeof GRID / sizeof *GRID };
enum { BISECTIONS = 60 };                      /* of a leap: down to one unit in the last place */
enum { PARABOLAS = 6 };                        /* to rounding of a minimum: digits by 1.3 each */
static const double APART = 1e-14;             /* of a leap: closer, theta is rounding */
static const double MOMENT = 2e-5;             /* of a leap: a fifth of the first grid point */
enum { MEMORY_MOST = 1024 };                   /* doubles of a law, as in dofwise.c */

/* Displacements and rates that LAW sees at theta. */
static void motion(const struct leap *l, const struct law *law, double theta, double *d, double *v)
{
    double t = l->t + theta * l->h;
    int n = l->of->n;

    for (int k = 0; k < law->kind->inputs; k++) {
        d[k] = v[k] = 0;
        for (int e = law->start[k]; e < law->start[k + 1]; e++) {
            d[k] += law->end[e].weight * leap_value(l, law->end[e].dof, t);
            v[k] += law->end[e].weight * leap_value(l, n + law->end[e].dof, t);
        }
    }
}

/* What is LEFT of rigid slider LAW's piece at theta: its dof's rate along its way, or what it would
 * hold beyond the pull; below 0 it is over. */
static enum modal_status slider_left(const struct leap *l, const double *memory, int law,
                                     double theta, double *left, struct modal_error *err)
{
    struct dofwise *of = l->of;
    int n = of->n, dof = of->p->law[law].end[0].dof;
    double t = l->t + theta * l->h, way = memory[of->memory[law]], pull = 0, *y = l->stage;
    enum modal_status rc;

    if (way != 0) {
        *left = way * leap_value(l, n + dof, t);
        return MODAL_OK;
    }
    for (int k = of->graph.start[dof] - 1; k < of->graph.start[dof + 1]; k++) {
        int j = k < of->graph.start[dof] ? dof : of->graph.index[k];
        y[j] = leap_value(l, j, t);
        y[n + j] = leap_value(l, n + j, t);
    }
    rc = dofwise_pull(of, law, t, y, y + n, memory, &pull, err);
    *left = dofwise_holds(of, law) - fabs(pull);
    return rc;
}

/* The regime at theta, with memory reached from a moment before. */
static enum modal_status piece_at(const struct leap *l, const double *memory, int law, double theta,
                                  int *piece, struct modal_error *err)
{
    const struct law *at = &l->of->p->law[law];
    double d[LAW_INPUTS_MOST], v[LAW_INPUTS_MOST], before[LAW_INPUTS_MOST];
    double turned[MEMORY_MOST], unused[MEMORY_MOST];
    struct law_point earlier = { l->t + theta * l->h, before, v,
                                 memory + l->of->memory[law] },
                     now = { l->t + theta * l->h, d, v, turned };
    struct law_force force = { .memory = turned };
    enum modal_status rc = MODAL_OK;

    if (at->kind->set_valued) {
        double left = 0;
        rc = slider_left(l, memory, law, theta, &left, err);
        *piece = left < 0;
        return rc;
    }
    motion(l, at, theta, d, v);
    for (int k = 0; k < at->kind->inputs; k++)
        before[k] = d[k] - MOMENT * l->h * v[k];
    if (at->memory > 0)
        rc = at->kind->force(at, &earlier, &force, err);
    force.memory = unused;
    if (rc == MODAL_OK)
        rc = at->kind->force(at, &now, &force, err);
    l->of->evaluations[law] += at->memory > 0 ? 2 : 1;
    *piece = force.regime;
    return rc;
}

/* The instant between LOW, in PIECE, and HIGH, out of it: the end that is out. */
static enum modal_status bisect(const struct leap *l, const double *memory, int law, int piece,
                                double low, double high, double *theta, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < BISECTIONS && high - low > APART && rc == MODAL_OK; i++) {
        double middle = (low + high) / 2;
        int now;
        rc = piece_at(l, memory, law, middle, &now, err);
        if (now == piece)
            low = middle;
        else
            high = middle;
    }
    *theta = high;                   /* out of the piece: the leap ends past it, by rounding */
    return rc;
}

/* Of LEFT at three instants AT, least in the middle: where a parabola through them is least. */
static double vertex(const double *at, const double *left)
{
    double a = (left[0] - left[1]) / (at[1] - at[0]), b = (left[2] - left[1]) / (at[2] - at[1]);

    return a + b > 0 ? ((at[0] + at[1]) * b + (at[1] + at[2]) * a) / (2 * (a + b)) : at[1];
}

/* Is slider LAW's piece over between the instants AT, where LEFT, at all above 0, is least in the
 * middle?  Then *THETA is one at which it is, else HUGE_VAL. */
static enum modal_status look_between(const struct leap *l, const double *memory, int law,
                                      double *at, double *left, double *theta,
                                      struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    *theta = HUGE_VAL;
    for (int i = 0; i < PARABOLAS && rc == MODAL_OK; i++) {
        double now = 0, t = vertex(at, left);
        int side = t < at[1] ? 0 : 2;
        if (!(fabs(t - at[1]) > APART))
            break;
        rc = slider_left(l, memory, law, t, &now, err);
        if (rc == MODAL_OK && now < 0) {
            *theta = t;
            break;
        }
        if (now < left[1]) {                       /* the middle becomes the other side */
            at[2 - side] = at[1], left[2 - side] = left[1];
            at[1] = t, left[1] = now;
        } else
            at[side] = t, left[side] = now;
    }
    return rc;
}

/* leap_find_event of a rigid slider. */
static enum modal_status find_slip(const struct leap *l, const double *memory, int law,
                                   double limit, double *theta, struct modal_error *err)
{
    double left[POINTS] = { 0 }, out;
    enum modal_status rc = slider_left(l, memory, law, GRID[0], &left[0], err);

    *theta = HUGE_VAL;
    for (int i = 1; i < POINTS && GRID[i] <= limit && rc == MODAL_OK; i++) {
        rc = slider_left(l, memory, law, GRID[i], &left[i], err);
        if (rc == MODAL_OK && left[i] < 0)
            return bisect(l, memory, law, 0, GRID[i - 1], GRID[i], theta, err);
        if (i < 2 || rc != MODAL_OK || !(left[i - 1] < left[i - 2] && left[i - 1] <= left[i]))
            continue;
        double at[3] = { GRID[i - 2], GRID[i - 1], GRID[i] },
               three[3] = { left[i - 2], left[i - 1], left[i] };
        rc = look_between(l, memory, law, at, three, &out, err);
        if (rc == MODAL_OK && out < HUGE_VAL)
            return bisect(l, memory, law, 0, at[0], out, theta, err);
    }
    return rc;
}

enum modal_status leap_find_event(const struct leap *l, const double *memory, int law, double limit,
                                  double *theta, struct modal_error *err)
{
    int first, now;
    enum modal_status rc;

    *theta = HUGE_VAL;
    if (l->of->p->law[law].kind->set_valued)
        return find_slip(l, memory, law, limit, theta, err);
    rc = piece_at(l, memory, law, GRID[0], &first, err);
    for (int i = 1; i < POINTS && GRID[i] <= limit && rc == MODAL_OK; i++) {
        rc = piece_at(l, memory, law, GRID[i], &now, err);
        if (rc == MODAL_OK && now != first)
            return bisect(l, memory, law, first, GRID[i - 1], GRID[i], theta, err);
    }
    return rc;
}
