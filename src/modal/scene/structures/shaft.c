/*
 * shaft.c - a flexible shaft in two planes with a rigid disk, on turning or on fixed axes
 *
 * Plane y bends along the turning axis e2 with EI[0], plane z along e3 with EI[1]; node i lies at i
 * h, its dofs are y<i>, sy<i> = dy/dx, z<i>, sz<i> (slopes, so that both planes have one element
 * matrix and turn alike).  With W = speed, J = [[0, -I],
 * [I, 0]] over (y, z), R(t) the rotation by W t, Mt the mass, Mg the polar inertia, Ks = diag(KA,
 * KB) the shaft, Kc and Cb stiffness and damping of the isotropic supports, mu the strain-rate
 * damping, on turning axes
 *
 *     Mt q'' + [W (2 Mt - Mg) J + Cb + mu Ks] q' + [Ks + Kc - W^2 (Mt - Mg) + W Cb J] q = R^T f (1)
 *
 * and on fixed axes, x = R q, with Ks(t) = R Ks R^T of period pi/W,
 *
 *     Mt x'' + [-W Mg J + Cb + mu Ks(t)] x' + [Ks(t) + Kc - mu W Ks(t) J] x = f,                (2)
 *     Ks(t) = a I + d [[cos 2Wt, sin 2Wt], [sin 2Wt, -cos 2Wt]],  a = (KA + KB)/2,
 *     d = (KA - KB)/2                                                                           (3)
 *
 * The disk has the mass M, diametral inertia M r^2/4 in Mt and (with `gyroscopic`) polar inertia M
 * r^2/2 in Mg.  Bearing and coupling at one end are springs in series; a stiffness that one of them
 * does not state is not a link of that series.
 *
 * `model` massless keeps the disk alone: each side of the shaft is one exact element, its end's
 * slope condensed with the rotational spring there (so mu acts on that condensed stiffness), and
 * the ends' displacements are eliminated by massless.h, becoming first-order states where they are
 * damped.  A massless journal in a clearance, r, replaces the disk's slope by the free end: the
 * place f = -(K_ru u + K_rs s)/K_rr where r would lie without contact, dof free_y<i> and free_z<i>.
 * Then the elastic energy is that of the free end and (r - f)^T K_rr (r - f)/2, and contact acts on
 * f as the law (2) of laws/journal_contact.c.
 *
 * Source: the rotor's model document (section 7.2 of the identification paper), equations of its
 * sections 2 and 5.
 */
#include "modal/scene/structures/shaft_parts.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "modal/scene/hermite.h"

/* A decimal fraction such as 0.3 is off its double by DBL_EPSILON/2, and so is its product with the
 * elements; these are what a person means to write, not what rounding does to it. */
/* of the elements: how far a position is off its node */
static const double NODE_ROUNDING = 1e-9;
static const double OMEGA_ROUNDING = 1e-12;    /* of the speed: how far 2 speed is off k omega */

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "shaft: out of memory");
}

/* ---- finite elements ---- */

/* The (y, z) pair of local dof i = 0 .. 3 of ELEMENT. */
static void element_pair(int element, int i, int pair[2])
{
    pair[0] = 4 * (element + i / 2) + i % 2;
    pair[1] = pair[0] + 2;
}

/* ADD every entry of MATRIX(A, h) in plane y and MATRIX(B, h) in plane z. */
static void add_elements(struct lowering *l,
                         void (*add)(struct lowering *, const int *, const int *, double, double),
                         double A, double B, void (*matrix)(double, double, double *))
{
    const struct shaft *s = l->mesh;
    double h = s->length / s->elements, a[16], b[16];
    int pi[2], pj[2];

    matrix(A, h, a);
    matrix(B, h, b);
    for (int e = 0; e < s->elements; e++)
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) {
                element_pair(e, i, pi);
                element_pair(e, j, pj);
                add(l, pi, pj, a[4 * i + j], b[4 * i + j]);
            }
}

/* Into M, on any axes: masses are alike in both planes. */
static void put_mass(struct lowering *l, const int i[2], const int j[2], double a, double b)
{
    lowering_add(l, PROGRAM_M, i[0], j[0], a);
    lowering_add(l, PROGRAM_M, i[1], j[1], b);
}

/* Mg's part of (1), (2). */
static void put_polar(struct lowering *l, const int i[2], const int j[2], double a, double b)
{
    shaft_add_polar(l, i[0], j[0], a);
    shaft_add_polar(l, i[1], j[1], b);
}

/* Ks of (1), or of (3) on fixed axes. */
static void put_elastic(struct lowering *l, const int i[2], const int j[2], double a, double b)
{
    shaft_add_elastic(l, PROGRAM_K, i, j, a, b);
}

/* I integral N' N'^T: rotary inertia per length, as hermite.h has it. */
static void tilt(double I, double h, double out[16])
{
    hermite_slope(h, out);
    for (int i = 0; i < 16; i++)
        out[i] *= I;
}

/* A point mass or, at a slope, a point inertia of NODE in both planes. */
static void add_node_mass(struct lowering *l, int node, int slope, double m)
{
    int pair[2] = { 4 * node + slope, 4 * node + slope + 2 };

    if (m != 0)
        put_mass(l, pair, pair, m, m);
}

/* Dofs node by node, mass and stiffness of shaft and disk. */
static void lower_elements(struct lowering *l)
{
    const struct shaft *s = l->mesh;
    static const char *const names[4] = { "y", "sy", "z", "sz" };
    char name[32];

    for (int i = 0; i < 4 * (s->elements + 1); i++) {
        snprintf(name, sizeof name, "%s%d", names[i % 4], i / 4);
        lowering_add_dof(l, name);
    }
    add_elements(l, put_mass, s->mass_per_length, s->mass_per_length, hermite_mass);
    add_node_mass(l, s->disk_node, 0, s->disk_mass);
    add_node_mass(l, s->disk_node, 1, s->disk_mass * s->disk_radius * s->disk_radius / 4);
    add_elements(l, put_elastic, s->EI[0], s->EI[1], hermite_stiffness);
}

/* Supports and journal of one end, by now all known. */
static void finish_end(struct lowering *l, int end)
{
    const struct shaft *s = l->mesh;
    const struct shaft_end *e = &s->end[end];
    int node = end == SHAFT_LEFT ? 0 : s->elements;
    double k = shaft_transverse(e), rotational = shaft_rotational(e);

    for (int plane = 0; plane < 2; plane++) {
        int u = 4 * node + 2 * plane;

        if (k != 0)
            lowering_add(l, PROGRAM_K, u, u, k);
        if (rotational != 0)
            lowering_add(l, PROGRAM_K, u + 1, u + 1, rotational);
        if (e->damping != 0)
            lowering_add_still_damping(l, u, u, e->damping);
    }
    if (e->clearance.listed)
        add_node_mass(l, node, 0, e->clearance.journal_mass);
}

/* Mass first: turn_mass reads all of it. */
static enum modal_status finish_elements(struct lowering *l, struct modal_error *err)
{
    const struct shaft *s = l->mesh;
    double polar = s->disk_mass * s->disk_radius * s->disk_radius / 2;
    int disk[2] = { 4 * s->disk_node + 1, 4 * s->disk_node + 3 };
    enum modal_status rc = MODAL_OK;

    if (s->I_rho > 0)
        add_elements(l, put_mass, s->I_rho / 2, s->I_rho / 2, tilt);
    for (int end = 0; end < 2; end++)
        finish_end(l, end);
    shaft_turn_mass(l);  /* after all of the mass, before polar inertia */
    if (s->gyroscopic) {
        put_polar(l, disk, disk, polar, polar);
        if (s->I_rho > 0)
            add_elements(l, put_polar, s->I_rho, s->I_rho, tilt);
    }
    if (s->strain_rate != 0)
        add_elements(l, shaft_add_strain_rate, s->EI[0], s->EI[1], hermite_stiffness);
    for (int end = 0; end < 2 && rc == MODAL_OK; end++) {
        int y = 4 * (end == SHAFT_LEFT ? 0 : s->elements);

        if (s->end[end].clearance.listed)
            rc = shaft_add_clearance(l, end, y, y + 2, NULL, err);
    }
    return rc;
}

/* ---- the row ---- */

struct disk { double position, mass, radius; };

static const struct scene_key disk_keys[] = {
    { "position", SCENE_NUMBER, offsetof(struct disk, position), "", 0, 1,
      .standard = 0.5, .means = "of the length from the left end; on a node", .example = "0.5" },
    { "mass", SCENE_NUMBER, offsetof(struct disk, mass), "kg", 0, SCENE_LARGE,
      .needed = true, .means = "M; > 0 on a massless shaft", .example = "5" },
    { "radius", SCENE_NUMBER, offsetof(struct disk, radius), "m", 0, SCENE_LARGE,
      .means = "r of the diametral inertia M r^2/4 and the polar M r^2/2", .example = "0.1" },
    { 0 },
};

struct keys {
    double length, mass_per_length, speed;  /* as the rows below */
    int elements, frame, model;
    struct scene_numbers EI;
    const cJSON *disk;
};

static const char *const models[] = { "finite_elements", "massless", NULL };

static const struct scene_key keys[] = {
    { "frame", SCENE_WORD, offsetof(struct keys, frame), .words = shaft_frames,
      .means = "axes of the dofs: \"rotating\", constant coefficients; \"fixed\", periodic ones",
      .example = "\"rotating\"" },
    { "model", SCENE_WORD, offsetof(struct keys, model), .words = models,
      .means = "\"massless\": the disk alone has mass", .example = "\"finite_elements\"" },
    { "length", SCENE_NUMBER, offsetof(struct keys, length), "m", SCENE_POSITIVE, SCENE_LARGE,
      .needed = true, .means = "between the ends", .example = "0.6" },
    { "elements", SCENE_WHOLE, offsetof(struct keys, elements), "", 1, SHAFT_ELEMENTS_MOST,
      .needed = true, .unless = "model", .standard = 0, .otherwise = "2 where massless",
      .means = "of equal length; where massless they say where the disk may be", .example = "4" },
    { "EI", SCENE_NUMBERS, offsetof(struct keys, EI), "N m^2", SCENE_POSITIVE, SCENE_LARGE,
      .needed = true, .means = "bending stiffness of plane y (along e2) and plane z (along e3)",
      .example = "[98.9, 175]" },
    { "mass_per_length", SCENE_NUMBER, offsetof(struct keys, mass_per_length), "kg/m", 0,
      SCENE_LARGE, .needed = true, .unless = "model", .otherwise = "none where massless",
      .means = "of the shaft; > 0 but where massless", .example = "0.8" },
    { "speed", SCENE_NUMBER, offsetof(struct keys, speed), "rad/s", 0, SCENE_LARGE,
      .means = "W, from e2 to e3 positive; omega's default", .example = "24" },
    { "disk", SCENE_OWN, offsetof(struct keys, disk), .otherwise = "none, but where massless",
      .members = disk_keys, .means = "a rigid disk",
      .example = "{\"position\": 0.5, \"mass\": 5}" },
    { 0 },
};

/* JSON NULL: none.  A disk sits on a node. */
static enum modal_status read_disk(const cJSON *json, struct shaft *s, struct modal_error *err)
{
    static const struct scene_key *const tables[] = { disk_keys, NULL };
    const char *path = "structure.disk";
    struct disk disk = { 0 };
    double node;

    if (json == NULL)
        return s->massless
                   ? modal_fail_field(err, MODAL_BAD_INPUT, path, "a massless shaft needs a disk")
                   : MODAL_OK;
    if (!cJSON_IsObject(json))
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "structure.disk must be an object {position, mass, radius}");
    enum modal_status rc = scene_keys_read(NULL, json, path, tables, &disk, err);
    if (rc != MODAL_OK)
        return rc;
    if (s->massless && disk.mass < SCENE_POSITIVE)
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.disk.mass",
                                "structure.disk.mass is %g; "
                                "accepted where nothing else has mass: a positive number (kg)",
                                disk.mass);
    node = round(disk.position * s->elements);  /* its node */
    if (fabs(node - disk.position * s->elements) > NODE_ROUNDING * s->elements)
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.disk.position",
                                "position %g of %d elements is no node; accepted: i/%d",
                                disk.position, s->elements, s->elements);
    s->disk_mass = disk.mass;
    s->disk_radius = disk.radius;
    s->disk_node = (int)node;
    if (s->massless && (s->disk_node == 0 || s->disk_node == s->elements))
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.disk.position",
                                "the disk of a massless shaft lies between its ends");
    return MODAL_OK;
}

/* Values into the mesh; what two keys say together is checked here. */
static enum modal_status read_shaft(const struct keys *k, struct shaft *s, struct modal_error *err)
{
    s->massless = k->model == 1;
    s->length = k->length;
    s->elements = k->elements > 0 || !s->massless ? k->elements : 2;
    s->mass_per_length = k->mass_per_length;
    s->speed = k->speed;
    s->fixed = k->frame == SHAFT_FIXED && s->speed > 0;
    if (s->elements == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.elements",
                                "structure.elements is needed: 1 .. %d", SHAFT_ELEMENTS_MOST);
    if (k->EI.count != 2)
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.EI",
                                "structure.EI must be [EI of plane y, EI of plane z], in N m^2");
    for (int i = 0; i < 2; i++)
        s->EI[i] = k->EI.x[i];
    if (!s->massless && s->mass_per_length < SCENE_POSITIVE)
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.mass_per_length",
                                "structure.mass_per_length is %g; "
                                "accepted but with model \"massless\": a positive number (kg/m)",
                                s->mass_per_length);
    return read_disk(k->disk, s, err);
}

/* `omega` defaults to the speed; on fixed axes the stiffness turns with a whole harmonic of it. */
static enum modal_status read_omega(struct lowering *l, struct modal_error *err)
{
    struct shaft *s = l->mesh;
    double k;

    if (l->p->omega == 0)
        l->p->omega = s->speed;  /* the default that contracts state */
    if (!s->fixed)
        l->p->frame_speed = s->speed;
    if (!s->fixed && !s->seen_fixed)
        return MODAL_OK;
    k = round(2 * s->speed / l->p->omega);  /* (3): 2 W is harmonic k of omega */
    if (k < 1 || k > LOWERING_HARMONIC_MOST
        || fabs(k * l->p->omega - 2 * s->speed) > OMEGA_ROUNDING * s->speed)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "omega",
            "on fixed axes twice the speed, %g rad/s, must be a whole multiple of omega = %g",
            2 * s->speed, l->p->omega);
    s->harmonic = (int)k;
    return MODAL_OK;
}

/* Who turns with whom: the lowering's where the dofs turn, the program's where they do not. */
static enum modal_status turn_axes(struct lowering *l, struct modal_error *err)
{
    const struct shaft *s = l->mesh;
    size_t n = (size_t)l->p->n;
    int *partner = calloc(n + 1, sizeof *partner);
    double *sign = calloc(n + 1, sizeof *sign);

    for (int i = 0; partner != NULL && sign != NULL && i < l->p->n; i++) {
        partner[i] = shaft_partner(s, i);
        sign[i] = shaft_sign(s, i);
    }
    l->names_frames = true;
    *(s->fixed ? &l->p->turn_partner : &l->turn_partner) = partner;
    *(s->fixed ? &l->p->turn_sign : &l->turn_sign) = sign;
    l->p->turn_speed = s->fixed || s->seen_fixed ? s->speed : 0;
    return partner != NULL && sign != NULL ? MODAL_OK : no_memory(err);
}

/* On which axes the dofs are, then the dofs themselves. */
static enum modal_status lower(struct lowering *l, void *values, struct modal_error *err)
{
    struct shaft *s = calloc(1, sizeof *s);
    enum modal_status rc;

    if ((l->mesh = s) == NULL)
        return no_memory(err);
    s->journal = s->state = -1;  /* none yet */
    rc = read_shaft(values, s, err);
    if (rc == MODAL_OK && s->massless && s->fixed && shaft_has_end_states(l))
        rc = shaft_see_from_fixed_axes(l, err);
    if (rc == MODAL_OK)
        rc = read_omega(l, err);
    if (rc != MODAL_OK)
        return rc;
    if (s->massless) {
        shaft_lower_massless(l);
    } else {
        l->mass_per_length = s->mass_per_length;  /* for viscous_damping */
        lower_elements(l);
    }
    return l->no_memory ? no_memory(err) : turn_axes(l, err);
}

/* Only noted: on turning axes it also adds to K. */
static enum modal_status strain_rate(struct lowering *l, double mu, struct modal_error *err)
{
    struct shaft *s = l->mesh;

    (void)err;
    s->strain_rate += mu;
    s->strain_rate_effect = l->effect;
    return MODAL_OK;
}

/* scene_structure_kind.finish: the ends once all effects have spoken. */
static enum modal_status finish(struct lowering *l, struct modal_error *err)
{
    struct shaft *s = l->mesh;
    enum modal_status rc = shaft_check_ends(s, err);

    if (rc == MODAL_OK)
        rc = s->massless ? shaft_finish_massless(l, err) : finish_elements(l, err);
    if (rc == MODAL_OK)
        shaft_mark_active(l);
    return rc;
}

const struct scene_structure_kind structure_shaft = {
    .name = "shaft", .keys = { scene_type_keys, keys }, .size = sizeof(struct keys),
    .law = "two planes of bending and a disk, turning at speed: (1), (2) of shaft.c",
    .sensors = shaft_sensors, .lower = lower, .strain_rate = strain_rate, .sensor = shaft_sensor,
    .finish = finish,
};
