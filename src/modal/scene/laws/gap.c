/*
 * gap.c - contact across a clearance, on one side or both, with dissipation
 *
 *     f = k (d - c)(1 + mu v) where d > c and 1 + mu v > 0, else 0            (1)
 *
 * and with both sides also -f(-d, -v).  (1) is continuous: it starts at d = c from 0, whatever v, and ends at d = c or
 * where it would begin to pull, 1 + mu v = 0.  [HC75] has the form; dissipation in s/m.
 *
 * [HC75] Hunt and Crossley, J. Appl. Mech. 42 (1975) 440-445.
 */
#include <stdlib.h>
#include "modal/scene/law.h"
#include "modal/scene/laws/gap.h"

/* (1) for one side; false where there is no contact */
static bool one_side(const struct gap *g, double d, double v, double *f, double *fd, double *fv)
{
    double depth = d - g->clearance, grip = 1 + g->dissipation * v;

    *f = *fd = *fv = 0;
    if (!(depth > 0))
        return false;
    if (grip > 0) {
        *f = g->stiffness * depth * grip;
        *fd = g->stiffness * grip;
        *fv = g->stiffness * depth * g->dissipation;
    }
    return true;
}

static enum modal_status gap_force(const struct law *law, const struct law_point *at, struct law_force *out,
                                   struct modal_error *err)
{
    const struct gap *g = law->data;

    (void)err;
    out->acts = one_side(g, at->d[0], at->v[0], &out->f[0], &out->fd[0][0], &out->fv[0][0]);
    if (!out->acts && g->both_sides) {
        out->acts = one_side(g, -at->d[0], -at->v[0], &out->f[0], &out->fd[0][0], &out->fv[0][0]);
        out->f[0] = -out->f[0];
        out->regime = out->acts ? out->fd[0][0] != 0 ? -1 : -2 : 0;
    } else
        out->regime = out->acts ? out->fd[0][0] != 0 ? 1 : 2 : 0;
    return MODAL_OK;
}

static const struct law_class gap_class = { .name = "gap", .inputs = 1, .reads_velocity = true, .force = gap_force };

enum modal_status law_gap(double stiffness, double clearance, double dissipation, bool both_sides, struct law *out,
                          struct modal_error *err)
{
    struct gap *g;

    if (law_check("stiffness", stiffness, 0, err) != MODAL_OK || law_check("dissipation", dissipation, 0, err) != MODAL_OK
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
