/*
 * shaft_axes.c - what turning does to a shaft's matrices: (1) to (3) of shaft.c, entry by entry
 */
#include "modal/scene/structures/shaft_parts.h"
#include <stddef.h>

const char *const shaft_frames[] = {
    [SHAFT_ROTATING] = "rotating", [SHAFT_FIXED] = "fixed", NULL,
};

/* The other plane's dof of dof i, and J's sign: (A J)(i, partner j) = sign(j) A(i, j). */
int shaft_partner(const struct shaft *s, int i)
{
    if (!s->massless)
        return i ^ 2;  /* y, sy, z, sz of a node: y <-> z, sy <-> sz */
    for (int c = 0; c < 2 * PLANE; c++)
        if (s->dof[c] == i)
            return s->dof[(c + PLANE) % (2 * PLANE)];
    return -1;
}

double shaft_sign(const struct shaft *s, int i)
{
    if (!s->massless)
        return i & 2 ? 1 : -1;  /* (J q)_y = -q_z, (J q)_z = q_y */
    for (int c = 0; c < PLANE; c++)
        if (s->dof[c] == i)
            return -1;
    return 1;
}

/* C += value J, as an entry between dofs of one plane. */
static void add_J(struct lowering *l, int i, int j, double value)
{
    const struct shaft *s = l->mesh;

    if (value != 0)
        lowering_add(l, PROGRAM_C, i, shaft_partner(s, j), shaft_sign(s, j) * value);
}

/* An isotropic pair's polar inertia g: -W g J to C and, on turning axes, W^2 g to K. */
void shaft_add_polar(struct lowering *l, int i, int j, double g)
{
    const struct shaft *s = l->mesh;

    add_J(l, i, j, -s->speed * g);  /* -W Mg J */
    if (!s->fixed && g != 0 && s->speed != 0)
        lowering_add(l, PROGRAM_K, i, j, s->speed * s->speed * g);
}

/* factor Ks between (y, z) pairs i and j: (3) on fixed axes. */
void shaft_add_elastic(struct lowering *l, int matrix, const int i[2], const int j[2], double kA,
                       double kB)
{
    const struct shaft *s = l->mesh;
    double a = (kA + kB) / 2, d = (kA - kB) / 2;  /* of (3) */

    if (!s->fixed) {
        lowering_add(l, matrix, i[0], j[0], kA);
        lowering_add(l, matrix, i[1], j[1], kB);
        return;
    }
    for (int plane = 0; plane < 2; plane++) {
        lowering_add(l, matrix, i[plane], j[plane], a);
        lowering_add_harmonic(l, matrix, s->harmonic, i[plane], j[plane], plane == 0 ? d : -d, 0);
        lowering_add_harmonic(l, matrix, s->harmonic, i[plane], j[1 - plane], 0, d);
    }
}

/* mu Ks to C; on fixed axes also -mu W Ks(t) J to K, Ks J = [[d sin, -(a + d cos)], [a - d cos,
 * -d sin]]. */
void shaft_add_strain_rate(struct lowering *l, const int i[2], const int j[2], double kA, double kB)
{
    const struct shaft *s = l->mesh;
    double mu = s->strain_rate, rate = -mu * s->speed, a = (kA + kB) / 2, d = (kA - kB) / 2;

    shaft_add_elastic(l, PROGRAM_C, i, j, mu * kA, mu * kB);
    if (!s->fixed)
        return;
    for (int plane = 0; plane < 2; plane++) {
        double side = plane == 0 ? 1 : -1;  /* sign of the row in Ks J */

        lowering_add(l, PROGRAM_K, i[plane], j[1 - plane], -side * rate * a);
        lowering_add_harmonic(l, PROGRAM_K, s->harmonic, i[plane], j[1 - plane], -rate * d, 0);
        lowering_add_harmonic(l, PROGRAM_K, s->harmonic, i[plane], j[plane], 0, side * rate * d);
    }
}

/* (1): every mass entry m written so far, on turning axes: 2 W m J to C, -W^2 m to K. */
void shaft_turn_mass(struct lowering *l)
{
    const struct shaft *s = l->mesh;
    int count = l->constant[PROGRAM_M].count;

    if (s->fixed || s->speed == 0)
        return;
    for (int e = 0; e < count; e++) {
        struct triplet t = l->constant[PROGRAM_M].x[e];

        add_J(l, t.i, t.j, 2 * s->speed * t.value);  /* 2 W Mt J */
        lowering_add(l, PROGRAM_K, t.i, t.j, -s->speed * s->speed * t.value);  /* -W^2 Mt */
    }
}
