/*
 * unilateral_contact.c - contact across a clearance, on one side or both, with dissipation
 *
 *     f = k (d - c)(1 + mu v) where d > c and 1 + mu v > 0, else 0            (1)
 *
 * and with both sides also -f(-d, -v).  (1) is continuous: it starts at d = c from 0, whatever v,
 * and ends at d = c or where it would begin to pull, 1 + mu v = 0.  [HC75] has the form;
 * dissipation in s/m.
 *
 * [HC75] Hunt and Crossley, J. Appl. Mech. 42 (1975) 440-445.
 */
#include <math.h>
#include <stdlib.h>
#include "modal/scene/law.h"
#include "modal/scene/orbit.h"
#include "modal/scene/pieces.h"

struct gap {
    double stiffness, clearance, dissipation;   /* N/m, m, s/m */
    bool both_sides;  /* and -f(-d, -v) */
};

/* (1) for one side; false where there is no contact */
static bool one_side(const struct gap *g, double d, double v, double *f, double *fd, double *fv)
{
    double depth = d - g->clearance, grip = 1 + g->dissipation * v;  /* (1) */

    *f = *fd = *fv = 0;
    if (!(depth > 0))
        return false;
    if (grip > 0) {  /* else it would pull: no force */
        *f = g->stiffness * depth * grip;
        *fd = g->stiffness * grip;  /* d(1)/dd */
        *fv = g->stiffness * depth * g->dissipation;  /* d(1)/dv */
    }
    return true;
}

/* (1) on either side; regime 2 is touch without grip, where it would pull. */
static enum modal_status gap_force(const struct law *law, const struct law_point *at,
                                   struct law_force *out, struct modal_error *err)
{
    const struct gap *g = law->data;

    (void)err;
    out->acts = one_side(g, at->d[0], at->v[0], &out->f[0], &out->fd[0][0], &out->fv[0][0]);
    if (!out->acts && g->both_sides) {
        out->acts = one_side(g, -at->d[0], -at->v[0], &out->f[0], &out->fd[0][0], &out->fv[0][0]);
        out->f[0] = -out->f[0];  /* the mirror image; its slopes are the same */
        out->regime = out->acts ? out->fd[0][0] != 0 ? -1 : -2 : 0;
    } else
        out->regime = out->acts ? out->fd[0][0] != 0 ? 1 : 2 : 0;
    return MODAL_OK;
}

/* Side +1 or -1 in contact on [from, to): (1) spread out as (1) of pieces.h. */
static enum modal_status contact_piece(const struct gap *g, double side, double from, double to,
                                       struct law_pieces *out, struct modal_error *err)
{
    struct law_piece piece = { .from = from,
                               .to = to,
                               .level = -side * g->stiffness * g->clearance,
                               .gain = { g->stiffness },
                               .damp = -g->stiffness * g->clearance * g->dissipation,
                               .cross = side * g->stiffness * g->dissipation,
                               .slider = -1 };

    out->acts = true;
    return pieces_add(out, &piece, err);
}

/* A contact's interval, cut where it would pull: 1 + mu v = 0, v the rate towards the stop. */
static enum modal_status contact(const struct gap *g, const struct orbit *o, double side,
                                 double from, double to, struct law_pieces *out,
                                 struct modal_error *err)
{
    double h = 2 * M_PI / o->N, bound, a = from, at[3], next;
    enum modal_status rc = MODAL_OK;
    bool grips;

    if (g->dissipation == 0)
        return contact_piece(g, side, from, to, out, err);
    bound = -side / (g->dissipation * o->omega);                     /* of the rate per radian */
    orbit_at(o, from, at);
    grips = side * (at[1] - bound) > 0;  /* 1 + mu v > 0 */
    for (double theta = from; rc == MODAL_OK && theta < to; theta = next) {
        bool now;

        /* from sample to sample: v is smooth between */
        next = fmin(h * (floor(theta / h + 1e-9) + 1), to);
        orbit_at(o, next, at);
        now = side * (at[1] - bound) > 0;
        if (now == grips)
            continue;
        double event = orbit_rate_crossing(o, theta, next, bound);
        if (grips)
            rc = contact_piece(g, side, a, event, out, err);
        a = event;
        grips = now;
    }
    return rc == MODAL_OK && grips ? contact_piece(g, side, a, to, out, err) : rc;
}

/* Every interval where side d > clearance. */
static enum modal_status one_side_pieces(const struct gap *g, const struct orbit *o, double side,
                                         struct law_pieces *out, struct modal_error *err)
{
    double level = side * g->clearance, first = -1, from = -1;
    enum modal_status rc = MODAL_OK;

    if (o->turns < 2)
        return side * o->d[0] > g->clearance ? contact(g, o, side, 0, 2 * M_PI, out, err)
                                             : MODAL_OK;
    for (int i = 0; rc == MODAL_OK && i < o->turns; i++) {
        struct orbit_end p = orbit_turn_end(o, i), q = orbit_turn_end(o, i + 1);
        bool was = side * (p.d - level) > 0, is = side * (q.d - level) > 0;
        double event;

        if (was == is)  /* no crossing on this branch */
            continue;
        event = orbit_crossing(o, p, q, level);
        if (is)
            from = event;
        else if (from >= 0)
            rc = contact(g, o, side, from, event, out, err);
        else
            first = event;                       /* of a contact that begins before 0 */
    }
    if (rc == MODAL_OK && first >= 0)
        rc = contact(g, o, side, from, first + 2 * M_PI, out, err);
    else if (rc == MODAL_OK && from < 0 && side * (o->turn[0].d - level) > 0)
        rc = contact(g, o, side, 0, 2 * M_PI, out, err);
    return rc;
}

/* Each side by itself: they never act together. */
static enum modal_status gap_pieces(const struct law *law, const struct orbit *const *input,
                                    struct law_pieces *out, struct modal_error *err)
{
    const struct gap *g = law->data;
    enum modal_status rc = one_side_pieces(g, input[0], 1, out, err);

    return rc == MODAL_OK && g->both_sides ? one_side_pieces(g, input[0], -1, out, err) : rc;
}

/* Open at rest and throughout, or closed: then it must be a spring. */
static bool gap_stays(const struct law *law, const double *mean, const double *reach)
{
    const struct gap *g = law->data;

    if (g->clearance < 0)
        return g->dissipation == 0 && mean[0] - reach[0] >= g->clearance;
    return mean[0] + reach[0] <= g->clearance
           && (!g->both_sides || mean[0] - reach[0] >= -g->clearance);
}

static const struct law_class gap_class = {
    .name = "gap", .inputs = 1, .reads_velocity = true, .force = gap_force, .pieces = gap_pieces,
    .stays = gap_stays
};

enum modal_status law_gap(double stiffness, double clearance, double dissipation, bool both_sides,
                          struct law *out, struct modal_error *err)
{
    struct gap *g;

    if (law_check("stiffness", stiffness, 0, err) != MODAL_OK
        || law_check("dissipation", dissipation, 0, err) != MODAL_OK
        || law_check("clearance", clearance, both_sides ? 0 : -1e300, err) != MODAL_OK)
        return MODAL_BAD_INPUT;
    g = malloc(sizeof *g);
    if (g == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "gap: no memory");
    *g = (struct gap) { stiffness, clearance, dissipation, both_sides };
    law_clear(out, &gap_class);
    out->data = g;
    return MODAL_OK;
}
