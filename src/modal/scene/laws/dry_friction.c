/*
 * dry_friction.c - friction without a spring: rigid, and rounded off
 *
 *     rigid    f = limit sign(v), at rest any f in [-limit, limit]            (1)
 *     rounded  f = limit tanh(v / v0)                                         (2)
 *
 * (1) is set-valued: what holds a body at rest follows from the balance, not from the motion, so
 * `force` gives 0 at v = 0 and the class says `set_valued`.  (2) is analytic, with a boundary layer
 * of v0 that a sampling must resolve.
 */
#include <math.h>
#include <stdlib.h>
#include "modal/scene/law.h"
#include "modal/scene/orbit.h"
#include "modal/scene/pieces.h"

struct coulomb {
    double limit, velocity;  /* N, m/s */
};

/* (1); at rest 0, and who steps it knows that it holds (ports.h). */
static enum modal_status rigid_force(const struct law *law, const struct law_point *at,
                                     struct law_force *out, struct modal_error *err)
{
    const struct coulomb *c = law->data;

    (void)err;
    out->f[0] = at->v[0] > 0 ? c->limit : at->v[0] < 0 ? -c->limit : 0;    /* (1) */
    out->fd[0][0] = out->fv[0][0] = 0;
    out->acts = at->v[0] != 0;  /* it slips */
    out->regime = (at->v[0] > 0) - (at->v[0] < 0);
    return MODAL_OK;
}

/* (2); its slope by (1 - tanh)(1 + tanh), which keeps its digits where tanh is near 1. */
static enum modal_status rounded_force(const struct law *law, const struct law_point *at,
                                       struct law_force *out, struct modal_error *err)
{
    const struct coulomb *c = law->data;
    double tanh_v = tanh(at->v[0] / c->velocity);

    (void)err;
    out->f[0] = c->limit * tanh_v;                                          /* (2) */
    out->fd[0][0] = 0;
    out->fv[0][0] = c->limit / c->velocity * (1 - tanh_v) * (1 + tanh_v);
    out->acts = true;
    out->regime = 0;
    return MODAL_OK;
}

/* (2) by itself. */
static double rounded_alone(const struct law *law, double d, double v)
{
    const struct coulomb *c = law->data;

    (void)d;
    return c->limit * tanh(v / c->velocity);
}

/* Without stops: +limit while d rises, -limit while it falls, with a jump at every turn. */
static enum modal_status rigid_pieces(const struct law *law, const struct orbit *const *input,
                                      struct law_pieces *out, struct modal_error *err)
{
    const struct coulomb *c = law->data;
    const struct orbit *o = input[0];
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < o->turns; i++) {
        const struct orbit_turn *p = &o->turn[i], *q = &o->turn[(i + 1) % o->turns];
        double sign = q->d > p->d ? 1 : -1, at[3];  /* between turns d is monotone */
        struct law_piece piece = { .from = p->theta,
                                   .to = q->theta + (i + 1 < o->turns ? 0 : 2 * M_PI),
                                   .level = sign * c->limit,
                                   .jump = 2 * sign * c->limit,
                                   .slider = -1 };

        orbit_at(o, p->theta, at);
        piece.slope = at[2];  /* (3) of pieces.h */
        rc = pieces_add(out, &piece, err);
    }
    out->acts = o->turns > 0;
    return rc;
}

static const struct law_class rigid_class = { .name = "coulomb",
                                              .inputs = 1,
                                              .reads_velocity = true,
                                              .set_valued = true,
                                              .force = rigid_force,
                                              .pieces = rigid_pieces };
static const struct law_class rounded_class = { .name = "regularised_coulomb",
                                                .inputs = 1,
                                                .reads_velocity = true,
                                                .smooth = true,
                                                .force = rounded_force,
                                                .alone = rounded_alone };

/* Of either class; a rigid one has no use for VELOCITY. */
static enum modal_status coulomb_new(const struct law_class *kind, double limit, double velocity,
                                     struct law *out, struct modal_error *err)
{
    struct coulomb *c;

    if (law_check("limit", limit, 0, err) != MODAL_OK)
        return MODAL_BAD_INPUT;
    if (!(velocity > 0) || !isfinite(velocity))
        return modal_fail_field(err, MODAL_BAD_INPUT, "velocity",
                                "velocity is %g; accepted: finite and > 0", velocity);
    c = malloc(sizeof *c);
    if (c == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "coulomb: no memory");
    *c = (struct coulomb) { limit, velocity };
    law_clear(out, kind);
    out->data = c;
    out->limit = limit;
    return MODAL_OK;
}

enum modal_status law_coulomb(double limit, struct law *out, struct modal_error *err)
{
    return coulomb_new(&rigid_class, limit, 1, out, err);
}

enum modal_status law_regularised_coulomb(double limit, double velocity, struct law *out,
                                          struct modal_error *err)
{
    return coulomb_new(&rounded_class, limit, velocity, out, err);
}
