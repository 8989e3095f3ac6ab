/*
 * journal_contact.c - a journal in a circular race: contact across a radial gap, the journal with
 * mass or without
 *
 * With mass the inputs d = (y, z) are the journal's own position.  Contact is radial and
 * frictionless,
 *
 *     f = N d/|d|,    N = k a (1 + mu a'),  a = |d| - gap > 0,  a' = d.v/|d|,  never pulling    (1)
 *
 * Without mass the journal's position r balances contact against the shaft, whose end would lie at
 * d without contact and has the stiffness K = diag(K_y, K_z) there:  K (r - d) + nu r = 0 with nu
 * |r| = k (|r| - gap), nu >= 0:
 *
 *     r = (K + nu I)^-1 K d,      psi(nu) = 1/|r(nu)| - (1 - nu/k)/gap = 0,      f = K (d - r)  (2)
 *
 * 1/|r| is increasing and concave in nu, so psi is; Newton from nu = 0, where psi < 0 exactly in
 * contact, never passes the root and converges quadratically.  The rate a' acts for k mu/K s only,
 * 1e-10 s, and is left out. The race being a circle, (1) and (2) hold on fixed and on turning axes
 * alike where K is given on those axes.
 *
 * With B = K + nu I + (k gap/|r|^3) r r^T, dr/dd = B^-1 K, so df/dd = K - K B^-1 K: symmetric.
 *
 * [HC75] Hunt and Crossley, J. Appl. Mech. 42 (1975) 440-445, for (1); the secular equation's
 * reciprocal form as in trust-region methods: Reinsch, Numer. Math. 16 (1971) 451-454.
 */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include "modal/scene/law.h"

struct clearance {
    double gap, stiffness, dissipation;  /* m, N/m, s/m */
    bool massless;  /* (2) and not (1) */
    double shaft[2];               /* K of (2) */
};

/* (1), |d| > gap. */
static void impact(const struct clearance *c, const double *d, const double *v,
                   struct law_force *out)
{
    double radius = hypot(d[0], d[1]), depth = radius - c->gap,  /* of (1): a is the depth */
           n[2] = { d[0] / radius, d[1] / radius };
    double rate = n[0] * v[0] + n[1] * v[1], grip = 1 + c->dissipation * rate,  /* a' of (1) */
           N = c->stiffness * depth * grip;

    if (!(grip > 0)) {
        out->regime = 2;           /* in touch, not pulling */
        return;
    }
    out->regime = 1;
    for (int i = 0; i < 2; i++) {
        out->f[i] = N * n[i];  /* (1) */
        for (int j = 0; j < 2; j++) {
            /* dn_i/dd_j radius, da'/dd_j */
            double across = (i == j) - n[i] * n[j], turn = (v[j] - rate * n[j]) / radius;

            out->fd[i][j] = c->stiffness * n[i] * (grip * n[j] + depth * c->dissipation * turn)
                            + N / radius * across;
            out->fv[i][j] = c->stiffness * depth * c->dissipation * n[i] * n[j];  /* dN/da' n n^T */
        }
    }
}

/* |r(nu)| and its slope by nu. */
static double radius_at(const struct clearance *c, const double *d, double nu, double *slope)
{
    double r[2], radius;

    for (int i = 0; i < 2; i++)
        r[i] = c->shaft[i] / (c->shaft[i] + nu) * d[i];  /* (2) */
    radius = hypot(r[0], r[1]);
    *slope = -(r[0] * r[0] / (c->shaft[0] + nu) + r[1] * r[1] / (c->shaft[1] + nu)) / radius;
    return radius;
}

/* The root of (2), |d| > gap; without gap it is k. */
static double contact_stiffness(const struct clearance *c, const double *d)
{
    double nu = 0, slope;

    if (c->gap == 0)
        return c->stiffness;
    for (int step = 0; step < 60; step++) {
        double radius = radius_at(c, d, nu, &slope);
        double psi = 1 / radius - (1 - nu / c->stiffness) / c->gap;  /* (2) */
        /* Newton's step; psi' > 0 */
        double more = -psi / (-slope / (radius * radius) + 1 / (c->stiffness * c->gap));

        nu += more;  /* monotone from below: see the opening */
        if (!(more > 4 * DBL_EPSILON * nu))
            break;
    }
    return fmax(nu, 0);
}

/* (2): force and slope of a journal without mass. */
static void balance(const struct clearance *c, const double *d, struct law_force *out)
{
    double nu = contact_stiffness(c, d), r[2], B[2][2], radius, bend;

    for (int i = 0; i < 2; i++)
        r[i] = c->shaft[i] / (c->shaft[i] + nu) * d[i];
    radius = hypot(r[0], r[1]);
    bend = radius > 0 ? c->stiffness * c->gap / (radius * radius * radius) : 0;
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++)
            B[i][j] = (i == j ? c->shaft[i] + nu : 0) + bend * r[i] * r[j];
    double det = B[0][0] * B[1][1] - B[0][1] * B[1][0];
    for (int i = 0; i < 2; i++) {
        /* = K (d - r), without its cancellation */
        out->f[i] = nu * r[i];
        for (int j = 0; j < 2; j++)
            out->fd[i][j] = (i == j ? c->shaft[i] : 0) -
                            c->shaft[i] * (i == j ? B[1 - i][1 - i] : -B[i][j]) / det * c->shaft[j];
    }
    out->regime = 1;
}

/* Outside the gap by (1) or (2); inside, nothing, and the derivatives are zeros. */
static enum modal_status clearance_force(const struct law *law, const struct law_point *at,
                                         struct law_force *out, struct modal_error *err)
{
    const struct clearance *c = law->data;

    (void)err;
    for (int i = 0; i < 2; i++) {
        out->f[i] = 0;
        for (int j = 0; j < 2; j++)
            out->fd[i][j] = out->fv[i][j] = 0;
    }
    out->regime = 0;
    out->acts = hypot(at->d[0], at->d[1]) > c->gap;
    if (out->acts && c->stiffness > 0) {
        if (c->massless)
            balance(c, at->d, out);
        else
            impact(c, at->d, at->v, out);
    }
    return MODAL_OK;
}

static const struct law_class with_mass = { .name = "clearance",
                                            .inputs = 2,
                                            .reads_velocity = true,
                                            .turns = true,
                                            .force = clearance_force };
static const struct law_class massless = { .name = "clearance of a massless journal",
                                           .inputs = 2,
                                           .force = clearance_force };

enum modal_status law_clearance(double gap, double stiffness, double dissipation,
                                const double *shaft, struct law *out, struct modal_error *err)
{
    struct clearance *c = malloc(sizeof *c);

    if (c == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "clearance: out of memory");
    *c = (struct clearance){ .gap = gap,
                             .stiffness = stiffness,
                             .dissipation = dissipation,
                             .massless = shaft != NULL };
    for (int i = 0; shaft != NULL && i < 2; i++)
        c->shaft[i] = shaft[i];
    law_clear(out, shaft != NULL ? &massless : &with_mass);
    out->data = c;
    return MODAL_OK;
}
