/*
 * slider.c - friction with a spring: Jenkins, Iwan, and contact with friction
 *
 * A slider at z, reached through a spring k, holds up to L:
 *
 *     f = k (d - z),   z = d - clip(d - z_before, -L / k, L / k)              (1)
 *
 * which is the whole law: the slider stays while the spring can, and follows at its bound.  Iwan's is a sum of (1).  In
 * contact with friction L = mu N is that of the moment, N = max(0, preload + kn d_n); without contact L = 0 and the
 * slider follows.  (1) is exact for a monotone path from z_before's instant to now with L constant.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/law.h"
#include "modal/scene/laws/slider.h"

/* (1): the force, true where the slider has moved */
static bool slide(double k, double L, double d, double *z, double *f)
{
    double trial = k * (d - *z);

    *f = trial;
    if (fabs(trial) <= L)
        return false;
    *f = copysign(L, trial);
    *z = d - *f / k;
    return true;
}

static enum modal_status sliders_force(const struct law *law, const struct law_point *at, struct law_force *out,
                                       struct modal_error *err)
{
    const struct sliders *s = law->data;

    (void)err;
    out->f[0] = out->fd[0][0] = out->fv[0][0] = 0;
    out->acts = false;
    out->regime = 0;
    for (int i = 0; i < s->count; i++) {
        double f, z = at->memory_before[i];
        bool slips = slide(s->element[i].stiffness, s->element[i].limit, at->d[0], &z, &f);

        out->f[0] += f;
        out->fd[0][0] += slips ? 0 : s->element[i].stiffness;
        out->acts |= slips;
        out->memory[i] = z;
        out->regime = 3 * out->regime % 1000003 + (slips ? f > 0 ? 1 : 2 : 0);
    }
    return MODAL_OK;
}

static enum modal_status contact_force(const struct law *law, const struct law_point *at, struct law_force *out,
                                       struct modal_error *err)
{
    const struct contact *c = law->data;
    double N = c->preload + c->normal_stiffness * at->d[0], z = at->memory_before[0], f;
    bool closed = N > 0, slips;

    (void)err;
    memset(out->fd, 0, sizeof out->fd);
    memset(out->fv, 0, sizeof out->fv);
    out->f[0] = closed ? N : 0;
    out->fd[0][0] = closed ? c->normal_stiffness : 0;
    slips = slide(c->tangential_stiffness, c->mu * out->f[0], at->d[1], &z, &f);
    out->f[1] = f;
    out->fd[1][0] = slips && closed ? copysign(c->mu * c->normal_stiffness, f) : 0;
    out->fd[1][1] = slips || !closed ? 0 : c->tangential_stiffness;
    out->memory[0] = z;
    out->acts = slips || !closed;
    out->regime = !closed ? 3 : slips ? f > 0 ? 1 : 2 : 0;
    return MODAL_OK;
}

static const struct law_class jenkins_class = { .name = "friction", .inputs = 1, .force = sliders_force };
static const struct law_class iwan_class = { .name = "iwan", .inputs = 1, .force = sliders_force };
static const struct law_class contact_class = { .name = "contact_friction", .inputs = 2, .force = contact_force };

static enum modal_status sliders_new(const struct law_class *kind, const double *stiffness, const double *limit, int count,
                                     struct law *out, struct modal_error *err)
{
    struct sliders *s;

    if (count < 1 || count > LAW_TERMS_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "stiffnesses", "%d sliders; accepted: 1 to %d", count, LAW_TERMS_MOST);
    for (int i = 0; i < count; i++)
        if (law_check("stiffness", stiffness[i], 0, err) != MODAL_OK || law_check("limit", limit[i], 0, err) != MODAL_OK)
            return MODAL_BAD_INPUT;
    s = malloc(sizeof *s + (size_t)count * sizeof s->element[0]);
    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "sliders: no memory for %d", count);
    s->count = count;
    for (int i = 0; i < count; i++)
        s->element[i] = (struct slider) { stiffness[i], limit[i] };
    law_clear(out, kind);
    out->data = s;
    out->memory = count;
    return MODAL_OK;
}

enum modal_status law_jenkins(double stiffness, double limit, struct law *out, struct modal_error *err)
{
    return sliders_new(&jenkins_class, &stiffness, &limit, 1, out, err);
}

enum modal_status law_iwan(const double *stiffness, const double *limit, int count, struct law *out,
                           struct modal_error *err)
{
    return sliders_new(&iwan_class, stiffness, limit, count, out, err);
}

enum modal_status law_contact_friction(double normal_stiffness, double preload, double tangential_stiffness, double mu,
                                       struct law *out, struct modal_error *err)
{
    struct contact *c;

    if (law_check("normal_stiffness", normal_stiffness, 0, err) != MODAL_OK || law_check("preload", preload, -1e300, err) != MODAL_OK
        || law_check("tangential_stiffness", tangential_stiffness, 0, err) != MODAL_OK || law_check("mu", mu, 0, err) != MODAL_OK)
        return MODAL_BAD_INPUT;
    c = malloc(sizeof *c);
    if (c == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "contact_friction: no memory");
    *c = (struct contact) { normal_stiffness, preload, tangential_stiffness, mu };
    law_clear(out, &contact_class);
    out->data = c;
    out->memory = 1;
    return MODAL_OK;
}
