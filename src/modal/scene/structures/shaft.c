/*
 * shaft.c - a flexible shaft in two planes with a rigid disk, on turning or on fixed axes
 *
 * Plane y bends along the turning axis e2 with EI[0], plane z along e3 with EI[1]; node i lies at i h, its dofs are y<i>,
 * sy<i> = dy/dx, z<i>, sz<i> (slopes, so that both planes have one element matrix and turn alike).  With W = speed, J = [[0, -I],
 * [I, 0]] over (y, z), R(t) the rotation by W t, Mt the mass, Mg the polar inertia, Ks = diag(KA, KB) the shaft, Kc and Cb
 * stiffness and damping of the isotropic supports, mu the strain-rate damping, on turning axes
 *
 *     Mt q'' + [W (2 Mt - Mg) J + Cb + mu Ks] q' + [Ks + Kc - W^2 (Mt - Mg) + W Cb J] q = R^T f                (1)
 *
 * and on fixed axes, x = R q, with Ks(t) = R Ks R^T of period pi/W,
 *
 *     Mt x'' + [-W Mg J + Cb + mu Ks(t)] x' + [Ks(t) + Kc - mu W Ks(t) J] x = f,                               (2)
 *     Ks(t) = a I + d [[cos 2Wt, sin 2Wt], [sin 2Wt, -cos 2Wt]],  a = (KA + KB)/2,  d = (KA - KB)/2            (3)
 *
 * The disk has the mass M, diametral inertia M r^2/4 in Mt and (with `gyroscopic`) polar inertia M r^2/2 in Mg.  Bearing and coupling
 * at one end are springs in series; a stiffness that one of them does not state is not a link of that series.
 *
 * `model` massless keeps the disk alone: each side of the shaft is one exact element, its end's slope condensed with the
 * rotational spring there (so mu acts on that condensed stiffness), and the ends' displacements are eliminated by massless.h, becoming
 * first-order states where they are damped.  A massless journal in a clearance, r, replaces the disk's slope by the free end:
 * the place f = -(K_ru u + K_rs s)/K_rr where r would lie without contact, dof free_y<i> and free_z<i>.  Then the elastic energy
 * is that of the free end and (r - f)^T K_rr (r - f)/2, and contact acts on f as the law (2) of laws/journal_contact.c.
 *
 * Source: the rotor's model document (section 7.2 of the identification paper), equations of its sections 2 and 5.
 */
#include "modal/scene/structures/shaft.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/hermite.h"

enum { UL, UR, UD, SD, PLANE = 4 };            /* a plane's coordinates of the massless model */

static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "shaft: out of memory");
}

enum modal_status shaft_end_of(struct lowering *l, const struct scene_effect *e, int *end, struct modal_error *err)
{
    static const char *const ends[] = { "left", "right", NULL };
    const char *word = NULL;
    enum modal_status rc = json_need_string(e->json, e->path, "at", &word, err);

    (void)l;
    return rc == MODAL_OK ? json_get_choice(e->json, e->path, "at", ends, end, err) : rc;
}

/* ---- what turns ---- */

/* The other plane's dof of dof i, and J's sign: (A J)(i, partner j) = sign(j) A(i, j). */
static int partner_of(const struct shaft *s, int i)
{
    if (!s->massless)
        return i ^ 2;
    for (int c = 0; c < 2 * PLANE; c++)
        if (s->dof[c] == i)
            return s->dof[(c + PLANE) % (2 * PLANE)];
    return -1;
}

static double sign_of(const struct shaft *s, int i)
{
    if (!s->massless)
        return i & 2 ? 1 : -1;
    for (int c = 0; c < PLANE; c++)
        if (s->dof[c] == i)
            return -1;
    return 1;
}

/* matrix += value J, as an entry between dofs of one plane. */
static void add_J(struct lowering *l, int matrix, int i, int j, double value)
{
    const struct shaft *s = l->mesh;

    if (value != 0)
        lowering_add(l, matrix, i, partner_of(s, j), sign_of(s, j) * value);
}

/* An isotropic pair's polar inertia g: -W g J to C and, on turning axes, W^2 g to K. */
static void add_polar(struct lowering *l, int i, int j, double g)
{
    const struct shaft *s = l->mesh;

    add_J(l, PROGRAM_C, i, j, -s->speed * g);
    if (!s->fixed && g != 0 && s->speed != 0)
        lowering_add(l, PROGRAM_K, i, j, s->speed * s->speed * g);
}

/* factor Ks between (y, z) pairs i and j: (3) on fixed axes. */
static void add_elastic(struct lowering *l, int matrix, const int i[2], const int j[2], double kA, double kB)
{
    const struct shaft *s = l->mesh;
    double a = (kA + kB) / 2, d = (kA - kB) / 2;

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

/* mu Ks to C; on fixed axes also -mu W Ks(t) J to K, Ks J = [[d sin, -(a + d cos)], [a - d cos, -d sin]]. */
static void add_strain_rate(struct lowering *l, const int i[2], const int j[2], double kA, double kB)
{
    const struct shaft *s = l->mesh;
    double mu = s->strain_rate, rate = -mu * s->speed, a = (kA + kB) / 2, d = (kA - kB) / 2;

    add_elastic(l, PROGRAM_C, i, j, mu * kA, mu * kB);
    if (!s->fixed)
        return;
    for (int plane = 0; plane < 2; plane++) {
        double side = plane == 0 ? 1 : -1;

        lowering_add(l, PROGRAM_K, i[plane], j[1 - plane], -side * rate * a);
        lowering_add_harmonic(l, PROGRAM_K, s->harmonic, i[plane], j[1 - plane], -rate * d, 0);
        lowering_add_harmonic(l, PROGRAM_K, s->harmonic, i[plane], j[plane], 0, side * rate * d);
    }
}

/* (1): every mass entry m written so far, on turning axes: 2 W m J to C, -W^2 m to K. */
static void turn_mass(struct lowering *l)
{
    const struct shaft *s = l->mesh;
    int count = l->constant[PROGRAM_M].count;

    if (s->fixed || s->speed == 0)
        return;
    for (int e = 0; e < count; e++) {
        struct triplet t = l->constant[PROGRAM_M].x[e];

        add_J(l, PROGRAM_C, t.i, t.j, 2 * s->speed * t.value);
        lowering_add(l, PROGRAM_K, t.i, t.j, -s->speed * s->speed * t.value);
    }
}

/* ---- supports ---- */

/* Bearing and coupling in series: what is not given is no link; none given: no spring. */
static double series(bool has_a, double a, bool has_b, double b)
{
    if (has_a && has_b)
        return a > 0 && b > 0 ? 1 / (1 / a + 1 / b) : 0;
    return has_a ? a : has_b ? b : 0;
}

static double transverse_at(const struct shaft_end *e)
{
    return series(e->bearing.has_transverse, e->bearing.transverse, e->coupling.has_transverse, e->coupling.transverse);
}

static double rotational_at(const struct shaft_end *e)
{
    return series(e->bearing.has_rotational, e->bearing.rotational, e->coupling.has_rotational, e->coupling.rotational);
}

static void mark(struct lowering *l, int effect, bool acts)
{
    if (acts)
        l->p->effect[effect].active = true;
}

static void mark_active(struct lowering *l)
{
    const struct shaft *s = l->mesh;

    for (int end = 0; end < 2; end++) {
        const struct shaft_end *e = &s->end[end];

        if (e->bearing.listed)
            mark(l, e->bearing.effect, e->bearing.transverse > 0 || e->bearing.rotational > 0 || e->damping > 0);
        if (e->coupling.listed)
            mark(l, e->coupling.effect, e->coupling.transverse > 0 || e->coupling.rotational > 0);
    }
    if (s->strain_rate != 0)
        mark(l, s->strain_rate_effect, true);
    if (s->gyroscopic)
        mark(l, s->gyroscopic_effect, s->speed != 0 && (s->disk_mass > 0 || s->I_rho > 0));
    if (s->I_rho > 0)
        mark(l, s->rotary_effect, true);
}

/* Bearing and clearance are two ways to hold one end. */
static enum modal_status check_ends(const struct shaft *s, struct modal_error *err)
{
    char where[64];

    for (int end = 0; end < 2; end++) {
        const struct shaft_end *e = &s->end[end];
        int other = e->bearing.listed ? e->bearing.effect : e->coupling.effect;

        if (!e->clearance.listed || !(e->bearing.listed || e->coupling.listed))
            continue;
        snprintf(where, sizeof where, "effects[%d].at", e->clearance.effect > other ? e->clearance.effect : other);
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: the shaft's %s end has a clearance, which takes the place of bearing and "
                                "coupling there", where, end == SHAFT_LEFT ? "left" : "right");
    }
    return MODAL_OK;
}

static enum modal_status add_clearance(struct lowering *l, int end, int y, int z, const double *stiffness,
                                       struct modal_error *err)
{
    const struct shaft *s = l->mesh;
    struct law law;
    enum modal_status rc = law_clearance(s->end[end].clearance.gap, s->end[end].clearance.stiffness,
                                         s->end[end].clearance.dissipation, stiffness, &law, err);

    if (rc != MODAL_OK)
        return rc;
    law.dof[0] = y;
    law.dof[1] = z;
    l->effect = s->end[end].clearance.effect;
    lowering_add_law(l, &law);
    l->effect = -1;
    return MODAL_OK;
}

/* ---- finite elements ---- */

/* The (y, z) pair of local dof i = 0 .. 3 of ELEMENT. */
static void element_pair(int element, int i, int pair[2])
{
    pair[0] = 4 * (element + i / 2) + i % 2;
    pair[1] = pair[0] + 2;
}

static void add_elements(struct lowering *l, void (*add)(struct lowering *, const int *, const int *, double, double),
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

static void put_mass(struct lowering *l, const int i[2], const int j[2], double a, double b)
{
    lowering_add(l, PROGRAM_M, i[0], j[0], a);
    lowering_add(l, PROGRAM_M, i[1], j[1], b);
}

static void put_polar(struct lowering *l, const int i[2], const int j[2], double a, double b)
{
    add_polar(l, i[0], j[0], a);
    add_polar(l, i[1], j[1], b);
}

static void put_elastic(struct lowering *l, const int i[2], const int j[2], double a, double b)
{
    add_elastic(l, PROGRAM_K, i, j, a, b);
}

static void tilt(double I, double h, double out[16])
{
    hermite_slope(h, out);
    for (int i = 0; i < 16; i++)
        out[i] *= I;
}

static void add_node_mass(struct lowering *l, int node, int slope, double m)
{
    int pair[2] = { 4 * node + slope, 4 * node + slope + 2 };

    if (m != 0)
        put_mass(l, pair, pair, m, m);
}

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

static void finish_end(struct lowering *l, int end)
{
    const struct shaft *s = l->mesh;
    const struct shaft_end *e = &s->end[end];
    int node = end == SHAFT_LEFT ? 0 : s->elements;
    double k = transverse_at(e), rotational = rotational_at(e);

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
    turn_mass(l);
    if (s->gyroscopic) {
        put_polar(l, disk, disk, polar, polar);
        if (s->I_rho > 0)
            add_elements(l, put_polar, s->I_rho, s->I_rho, tilt);
    }
    if (s->strain_rate != 0)
        add_elements(l, add_strain_rate, s->EI[0], s->EI[1], hermite_stiffness);
    for (int end = 0; end < 2 && rc == MODAL_OK; end++) {
        int y = 4 * (end == SHAFT_LEFT ? 0 : s->elements);

        if (s->end[end].clearance.listed)
            rc = add_clearance(l, end, y, y + 2, NULL, err);
    }
    return rc;
}

/* ---- massless ---- */

/* The shaft over (uL, uR, uD, sD) of one plane: an exact element each side, the ends' slopes condensed with their springs. */
static void massless_plane(const struct shaft *s, double EI, double out[16])
{
    double at = s->length * s->disk_node / s->elements, side[2] = { at, s->length - at }, k[16];
    static const int where[2][4] = { { UL, -1, UD, SD }, { UD, SD, UR, -1 } };     /* -1: the slope to be condensed */

    memset(out, 0, 16 * sizeof *out);
    for (int end = 0; end < 2; end++) {
        int slope = end == SHAFT_LEFT ? 1 : 3;

        hermite_stiffness(EI, side[end], k);
        double own = k[5 * slope] + rotational_at(&s->end[end]);
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++)
                if (i != slope && j != slope)
                    out[PLANE * where[end][i] + where[end][j]] += k[4 * i + j] - k[4 * i + slope] * k[4 * slope + j] / own;
    }
}

static void put(double *A, int i, int j, double value)
{
    A[2 * PLANE * i + j] += value;
}

/* value J between coordinates i, j < PLANE of plane y and their partners. */
static void put_J(double *A, int i, int j, double value)
{
    put(A, i, j + PLANE, -value);
    put(A, i + PLANE, j, value);
}

/* Masses and polar inertias of the eight coordinates: one value a coordinate, alike in both planes. */
static void massless_inertia(const struct shaft *s, double mass[PLANE], double polar[PLANE])
{
    double tilting = s->disk_mass * s->disk_radius * s->disk_radius;

    memset(polar, 0, PLANE * sizeof *polar);
    mass[UL] = s->end[SHAFT_LEFT].clearance.journal_mass;
    mass[UR] = s->end[SHAFT_RIGHT].clearance.journal_mass;
    mass[UD] = s->disk_mass;
    mass[SD] = tilting / 4;
    polar[SD] = s->gyroscopic ? tilting / 2 : 0;
}

/* (1) over the eight coordinates; on fixed axes (2) with Ks as it lies at t = 0. */
static void massless_matrices(const struct shaft *s, double Ks[2][16], double *M, double *C, double *K)
{
    double mass[PLANE], polar[PLANE], W = s->fixed ? 0 : s->speed;

    massless_inertia(s, mass, polar);
    for (int i = 0; i < PLANE; i++) {
        const struct shaft_end *e = i == UL ? &s->end[SHAFT_LEFT] : &s->end[SHAFT_RIGHT];
        double spring = i < UD ? transverse_at(e) : 0, damper = i < UD ? e->damping : 0;

        put_J(C, i, i, W * (2 * mass[i] - polar[i]));
        put_J(K, i, i, W * damper);
        for (int plane = 0; plane < 2; plane++) {
            int c = i + plane * PLANE;

            put(M, c, c, mass[i]);
            put(C, c, c, damper);
            put(K, c, c, spring - W * W * (mass[i] - polar[i]));
            for (int j = 0; j < PLANE; j++) {
                put(K, c, j + plane * PLANE, Ks[plane][PLANE * i + j]);
                put(C, c, j + plane * PLANE, s->strain_rate * Ks[plane][PLANE * i + j]);
            }
        }
    }
}

/* B <- T^T A T, A <- A T: the disk's slope given by disk and free end; x runs (uD, sD) of plane y, then of z. */
static void map_columns(const struct shaft *s, double *A, int rows)
{
    for (int i = 0; i < rows; i++)
        for (int plane = 0; plane < 2; plane++) {
            double *u = &A[4 * i + 2 * plane], *slope = u + 1;

            *u += s->journal_map[plane][0] * *slope;
            *slope *= s->journal_map[plane][1];
        }
}

static void map_rows(const struct shaft *s, double *A, int columns)
{
    for (int j = 0; j < columns; j++)
        for (int plane = 0; plane < 2; plane++) {
            double *u = &A[2 * plane * columns + j], *slope = u + columns;

            *u += s->journal_map[plane][0] * *slope;
            *slope *= s->journal_map[plane][1];
        }
}

static void map_to_free_end(struct shaft *s, double Ks[2][16])
{
    struct condensed *c = &s->condensed;
    int r = s->journal == SHAFT_LEFT ? UL : UR;

    for (int plane = 0; plane < 2; plane++) {
        const double *row = &Ks[plane][PLANE * r];

        s->journal_stiffness[plane] = row[r];
        s->journal_map[plane][0] = -row[UD] / row[SD];
        s->journal_map[plane][1] = -row[r] / row[SD];
    }
    for (int q = 0; q < 3; q++) {
        double *A = q == 0 ? c->M : q == 1 ? c->C : c->K;

        map_columns(s, A, c->nx);
        map_rows(s, A, c->nx);
    }
    map_rows(s, c->F, c->nb);
    map_columns(s, c->Bx, c->nb);
    map_columns(s, c->Bv, c->nb);
    map_columns(s, c->Rx, c->na);
}

/* The condensed matrices as entries; on fixed axes their planes' stiffness turns. */
static void write_condensed(struct lowering *l)
{
    struct shaft *s = l->mesh;
    const struct condensed *c = &s->condensed;
    int dof[CONDENSE_MOST];

    for (int i = 0; i < c->nx; i++)
        dof[i] = s->dof[c->x[i]];
    for (int i = 0; i < c->nx; i++)
        for (int j = 0; j < c->nx; j++) {
            lowering_add(l, PROGRAM_C, dof[i], dof[j], c->C[i * c->nx + j]);
            if (!s->fixed)
                lowering_add(l, PROGRAM_K, dof[i], dof[j], c->K[i * c->nx + j]);
        }
    for (int half = c->nx / 2, i = 0; s->fixed && i < half; i++)
        for (int j = 0; j < half; j++)
            add_elastic(l, PROGRAM_K, (int[]) { dof[i], dof[i + half] }, (int[]) { dof[j], dof[j + half] },
                        c->K[i * c->nx + j], c->K[(i + half) * c->nx + j + half]);
    s->state = c->nb > 0 ? lowering_add_states(l, c->nb) : -1;
    for (int i = 0; i < c->nb && s->state >= 0; i++) {
        for (int j = 0; j < c->nb; j++) {
            lowering_add_block(l, LOWER_E, s->state + i, s->state + j, c->E[i * c->nb + j]);
            lowering_add_block(l, LOWER_A, s->state + i, s->state + j, c->A[i * c->nb + j]);
        }
        for (int j = 0; j < c->nx; j++) {
            lowering_add_block(l, LOWER_BX, s->state + i, dof[j], c->Bx[i * c->nx + j]);
            lowering_add_block(l, LOWER_BV, s->state + i, dof[j], c->Bv[i * c->nx + j]);
            lowering_add_block(l, LOWER_F, dof[j], s->state + i, c->F[j * c->nb + i]);
        }
    }
}

/* A clearance whose journal has no mass, as the scene lists it (its keys are checked when it is lowered). */
static int massless_journal(const struct lowering *l)
{
    for (const cJSON *e = lowering_lists(l, "clearance", NULL); e != NULL; e = lowering_lists(l, "clearance", e)) {
        const cJSON *mass = cJSON_GetObjectItemCaseSensitive(e, "journal_mass"), *at = cJSON_GetObjectItemCaseSensitive(e, "at");

        if ((!cJSON_IsNumber(mass) || mass->valuedouble == 0) && cJSON_IsString(at))
            return strcmp(at->valuestring, "left") == 0 ? SHAFT_LEFT : SHAFT_RIGHT;
    }
    return -1;
}

static bool journal_with_mass(const struct lowering *l, int end)
{
    for (const cJSON *e = lowering_lists(l, "clearance", NULL); e != NULL; e = lowering_lists(l, "clearance", e)) {
        const cJSON *mass = cJSON_GetObjectItemCaseSensitive(e, "journal_mass"), *at = cJSON_GetObjectItemCaseSensitive(e, "at");

        if (cJSON_IsNumber(mass) && mass->valuedouble > 0 && cJSON_IsString(at)
            && strcmp(at->valuestring, end == SHAFT_LEFT ? "left" : "right") == 0)
            return true;
    }
    return false;
}

/* Coordinate c as a name; FREE: the free end instead of the disk's slope. */
static void coordinate_name(const struct shaft *s, int c, bool free_end, char out[32])
{
    int q = c % PLANE, node = q == UL ? 0 : q == UR ? s->elements : s->disk_node;
    const char *plane = c < PLANE ? "y" : "z";

    if (free_end)
        snprintf(out, 32, "free_%s%d", plane, s->journal == SHAFT_LEFT ? 0 : s->elements);
    else
        snprintf(out, 32, "%s%s%d", q == SD ? "s" : "", plane, node);
}

/* What the ends' states need: damping somewhere, or a journal without mass.  Whether left out or not, so that ablation keeps the axes. */
static bool has_end_states(const struct lowering *l)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(l->scene, "effects"), *e;

    cJSON_ArrayForEach(e, list) {
        const char *type = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(e, "type"));
        const cJSON *damping = cJSON_GetObjectItemCaseSensitive(e, "damping"), *mu = cJSON_GetObjectItemCaseSensitive(e, "mu");
        const cJSON *mass = cJSON_GetObjectItemCaseSensitive(e, "journal_mass");

        if (type == NULL)
            continue;
        if (strcmp(type, "bearing") == 0 && cJSON_IsNumber(damping) && damping->valuedouble > 0)
            return true;
        if (strcmp(type, "strain_rate_damping") == 0 && cJSON_IsNumber(mu) && mu->valuedouble != 0)
            return true;
        if (strcmp(type, "clearance") == 0 && !(cJSON_IsNumber(mass) && mass->valuedouble > 0))
            return true;
    }
    return false;
}

/*
 * End states have constant equations on turning axes only.  There the scene is lowered, and seen from fixed axes; what an effect between
 * single dofs, or one of the whole structure's matrices, means on fixed axes it would not mean there.
 */
static enum modal_status see_from_fixed_axes(struct lowering *l, struct modal_error *err)
{
    static const char *const turning[] = { "bearing", "coupling", "gyroscopic", "strain_rate_damping", "clearance" };
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(l->scene, "effects"), *e;
    struct shaft *s = l->mesh;
    int position = 0;

    cJSON_ArrayForEach(e, list) {
        const char *type = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(e, "type"));
        bool turns = type == NULL;

        for (size_t i = 0; i < sizeof turning / sizeof *turning; i++)
            turns = turns || strcmp(type, turning[i]) == 0;
        if (!turns) {
            char where[32];
            snprintf(where, sizeof where, "effects[%d]", position);
            return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: the damped ends of a massless shaft are states on turning axes, where a %.40s on "
                                    "fixed ones is not constant: use structure.frame \"rotating\" or model \"finite_elements\"", where, type);
        }
        position++;
    }
    s->fixed = false;
    s->seen_fixed = l->p->seen_fixed = true;
    return MODAL_OK;
}

static void lower_massless(struct lowering *l)
{
    struct shaft *s = l->mesh;
    char name[32];

    s->journal = massless_journal(l);
    for (int c = 0; c < 2 * PLANE; c++) {
        int q = c % PLANE;
        bool kept = q == UD || (q == SD && s->disk_radius > 0) || (q < UD && journal_with_mass(l, q == UL ? SHAFT_LEFT : SHAFT_RIGHT));

        coordinate_name(s, c, q == SD && s->journal >= 0, name);
        s->dof[c] = kept ? lowering_add_dof(l, name) : -1;
    }
    for (int plane = 0; plane < 2; plane++) {
        int u = s->dof[UD + plane * PLANE], slope = s->dof[SD + plane * PLANE];

        if (s->journal < 0) {                          /* else the mass is known once all effects are */
            lowering_add(l, PROGRAM_M, u, u, s->disk_mass);
            lowering_add(l, PROGRAM_M, slope, slope, s->disk_mass * s->disk_radius * s->disk_radius / 4);
        }
    }
}

static enum modal_status check_massless(const struct shaft *s, struct modal_error *err)
{
    char where[64] = "effects[0]";

    if (s->journal < 0)
        return MODAL_OK;
    snprintf(where, sizeof where, "effects[%d]", s->end[s->journal].clearance.effect);
    if (s->strain_rate != 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: with strain_rate_damping the journal needs a journal_mass", where);
    if (!(s->disk_radius > 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.disk.radius", "a massless journal needs a disk with a radius > 0");
    if (s->end[1 - s->journal].clearance.listed)
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: a massless shaft has one clearance without journal_mass and none beside it",
                                where);
    return MODAL_OK;
}

/* Whose row the damped ends' states stand in. */
static int damping_effect(const struct shaft *s)
{
    for (int end = 0; end < 2; end++)
        if (s->end[end].damping > 0)
            return s->end[end].bearing.effect;
    return s->strain_rate != 0 ? s->strain_rate_effect : -1;
}

/* What structure.lower did not write of the condensed mass: journals, or the whole of it on free ends. */
static void write_mass(struct lowering *l)
{
    const struct shaft *s = l->mesh;
    const struct condensed *c = &s->condensed;

    for (int i = 0; i < c->nx; i++)
        for (int j = 0; j < c->nx; j++)
            if (s->journal >= 0 || c->x[i] % PLANE < UD)
                lowering_add(l, PROGRAM_M, s->dof[c->x[i]], s->dof[c->x[j]], c->M[i * c->nx + j]);
}

static enum modal_status finish_massless(struct lowering *l, struct modal_error *err)
{
    struct shaft *s = l->mesh;
    double Ks[2][16], M[CONDENSE_ROOM] = { 0 }, C[CONDENSE_ROOM] = { 0 }, K[CONDENSE_ROOM] = { 0 };
    enum modal_status rc = check_massless(s, err);

    if (rc != MODAL_OK)
        return rc;
    massless_plane(s, s->EI[0], Ks[0]);
    massless_plane(s, s->EI[1], Ks[1]);
    massless_matrices(s, Ks, M, C, K);
    if (s->fixed)                                       /* (2)'s gyroscopic term, W being 0 above */
        for (int plane = 0; plane < 2; plane++) {
            int slope = s->dof[SD + plane * PLANE];
            if (s->gyroscopic && slope >= 0)
                add_polar(l, slope, slope, s->disk_mass * s->disk_radius * s->disk_radius / 2);
        }
    rc = condense_massless(2 * PLANE, M, C, K, &s->condensed, err);
    if (rc != MODAL_OK)
        return rc;
    if (s->journal >= 0)
        map_to_free_end(s, Ks);
    l->effect = damping_effect(s);
    write_condensed(l);
    l->effect = -1;
    write_mass(l);
    for (int end = 0; end < 2 && rc == MODAL_OK; end++) {
        int q = end == s->journal ? SD : end == SHAFT_LEFT ? UL : UR;

        if (s->end[end].clearance.listed)
            rc = add_clearance(l, end, s->dof[q], s->dof[q + PLANE], end == s->journal ? s->journal_stiffness : NULL, err);
    }
    return rc;
}

/* ---- the row ---- */

static enum modal_status read_disk(const cJSON *json, struct shaft *s, struct modal_error *err)
{
    static const char *const keys[] = { "position", "mass", "radius", NULL };
    const cJSON *disk = cJSON_GetObjectItemCaseSensitive(json, "disk");
    const char *path = "structure.disk";
    double position = 0.5, node;
    enum modal_status rc;

    if (disk == NULL)
        return s->massless ? modal_fail_field(err, MODAL_BAD_INPUT, path, "a massless shaft needs a disk") : MODAL_OK;
    if (!cJSON_IsObject(disk))
        return modal_fail_field(err, MODAL_BAD_INPUT, path, "structure.disk must be an object {position, mass, radius}");
    rc = json_keys(disk, path, keys, err);
    if (rc == MODAL_OK)
        rc = json_get_number(disk, path, "position", 0, 1, &position, err);
    if (rc == MODAL_OK)
        rc = json_need_number(disk, path, "mass", s->massless ? 1e-300 : 0, 1e300, &s->disk_mass, err);
    if (rc == MODAL_OK)
        rc = json_get_number(disk, path, "radius", 0, 1e300, &s->disk_radius, err);
    if (rc != MODAL_OK)
        return rc;
    node = round(position * s->elements);
    if (fabs(node - position * s->elements) > 1e-9 * s->elements)
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.disk.position", "position %g of %d elements is no node; accepted: i/%d",
                                position, s->elements, s->elements);
    s->disk = true;
    s->disk_node = (int)node;
    if (s->massless && (s->disk_node == 0 || s->disk_node == s->elements))
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.disk.position", "the disk of a massless shaft lies between its ends");
    return MODAL_OK;
}

static enum modal_status read_stiffness(const cJSON *json, struct shaft *s, struct modal_error *err)
{
    double *EI = NULL;
    size_t count = 0;
    enum modal_status rc = json_get_numbers(json, "structure", "EI", 1e-300, 1e300, &EI, &count, err);

    if (rc == MODAL_OK && count != 2)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "structure.EI", "structure.EI must be [EI of plane y, EI of plane z], in N m^2");
    for (int i = 0; rc == MODAL_OK && i < 2; i++)
        s->EI[i] = EI[i];
    free(EI);
    return rc;
}

static enum modal_status read_shaft(const cJSON *json, struct shaft *s, struct modal_error *err)
{
    static const char *const frames[] = { "rotating", "fixed", NULL }, *const models[] = { "finite_elements", "massless", NULL };
    const char *path = "structure";
    int frame = 0, model = 0;
    enum modal_status rc = json_get_choice(json, path, "frame", frames, &frame, err);

    if (rc == MODAL_OK)
        rc = json_get_choice(json, path, "model", models, &model, err);
    s->massless = model == 1;
    s->elements = s->massless ? 2 : 0;
    if (rc == MODAL_OK)
        rc = json_need_number(json, path, "length", 1e-300, 1e300, &s->length, err);
    if (rc == MODAL_OK)
        rc = json_get_int(json, path, "elements", 1, SHAFT_ELEMENTS_MOST, &s->elements, err);
    if (rc == MODAL_OK && s->elements == 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "structure.elements", "structure.elements is needed: 1 .. %d", SHAFT_ELEMENTS_MOST);
    if (rc == MODAL_OK)
        rc = read_stiffness(json, s, err);
    if (rc == MODAL_OK)
        rc = s->massless ? json_get_number(json, path, "mass_per_length", 0, 1e300, &s->mass_per_length, err)
                         : json_need_number(json, path, "mass_per_length", 1e-300, 1e300, &s->mass_per_length, err);
    if (rc == MODAL_OK)
        rc = json_get_number(json, path, "speed", 0, 1e300, &s->speed, err);
    s->fixed = frame == 1 && s->speed > 0;
    return rc == MODAL_OK ? read_disk(json, s, err) : rc;
}

/* `omega` defaults to the speed; on fixed axes the stiffness turns with a whole harmonic of it. */
static enum modal_status read_omega(struct lowering *l, struct modal_error *err)
{
    struct shaft *s = l->mesh;
    double k;

    if (l->p->omega == 0)
        l->p->omega = s->speed;
    if (!s->fixed)
        l->p->frame_speed = s->speed;
    if (!s->fixed && !s->seen_fixed)
        return MODAL_OK;
    k = round(2 * s->speed / l->p->omega);
    if (k < 1 || k > LOWERING_HARMONIC_MOST || fabs(k * l->p->omega - 2 * s->speed) > 1e-12 * s->speed)
        return modal_fail_field(err, MODAL_BAD_INPUT, "omega", "on fixed axes twice the speed, %g rad/s, must be a whole multiple of omega = %g",
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
        partner[i] = partner_of(s, i);
        sign[i] = sign_of(s, i);
    }
    l->names_frames = true;
    *(s->fixed ? &l->p->turn_partner : &l->turn_partner) = partner;
    *(s->fixed ? &l->p->turn_sign : &l->turn_sign) = sign;
    l->p->turn_speed = s->fixed || s->seen_fixed ? s->speed : 0;
    return partner != NULL && sign != NULL ? MODAL_OK : no_memory(err);
}

static enum modal_status lower(struct lowering *l, const cJSON *json, const char *path, struct modal_error *err)
{
    struct shaft *s = calloc(1, sizeof *s);
    enum modal_status rc;

    (void)path;
    if ((l->mesh = s) == NULL)
        return no_memory(err);
    s->journal = s->state = -1;
    rc = read_shaft(json, s, err);
    if (rc == MODAL_OK && s->massless && s->fixed && has_end_states(l))
        rc = see_from_fixed_axes(l, err);
    if (rc == MODAL_OK)
        rc = read_omega(l, err);
    if (rc != MODAL_OK)
        return rc;
    if (s->massless) {
        lower_massless(l);
    } else {
        l->mass_per_length = s->mass_per_length;
        lower_elements(l);
    }
    return l->no_memory ? no_memory(err) : turn_axes(l, err);
}

static enum modal_status strain_rate(struct lowering *l, double mu, struct modal_error *err)
{
    struct shaft *s = l->mesh;

    (void)err;
    s->strain_rate += mu;
    s->strain_rate_effect = l->effect;
    return MODAL_OK;
}

static enum modal_status finish(struct lowering *l, struct modal_error *err)
{
    struct shaft *s = l->mesh;
    enum modal_status rc = check_ends(s, err);

    if (rc == MODAL_OK)
        rc = s->massless ? finish_massless(l, err) : finish_elements(l, err);
    if (rc == MODAL_OK)
        mark_active(l);
    return rc;
}

/* ---- sensors ---- */

/* Dof or coordinate NAME as a coordinate: massless 0 .. 7, else the dof itself in plane y's or z's place; -1: none. */
static int coordinate_of(const struct lowering *l, const char *name)
{
    const struct shaft *s = l->mesh;
    char other[32];

    if (!s->massless)
        return program_dof(l->p, name);
    for (int c = 0; c < 2 * PLANE; c++) {
        coordinate_name(s, c, false, other);
        if (strcmp(name, other) == 0)
            return c;
    }
    return -1;
}

static int index_in(const int *list, int count, int what)
{
    for (int i = 0; i < count; i++)
        if (list[i] == what)
            return i;
    return -1;
}

/* The journal's own place: r = f + [row f of (M x'' + C x' + K x - F b)]/K_rr, the law being all else that acts on f. */
static bool journal_terms(struct lowering *l, int plane, double factor, struct program_output *out)
{
    const struct shaft *s = l->mesh;
    const struct condensed *c = &s->condensed;
    int row = 2 * plane + 1, f = s->dof[SD + plane * PLANE];
    double scale = factor / s->journal_stiffness[plane];

    for (int i = 0; i < l->p->loads; i++)
        if (l->p->load[i].dof == f || l->p->load[i].dof_sine == f)
            return false;
    lowering_add_term(l, out, 0, f, factor);
    for (int j = 0; j < c->nx; j++) {
        lowering_add_term(l, out, 0, s->dof[c->x[j]], scale * c->K[row * c->nx + j]);
        lowering_add_term(l, out, 1, s->dof[c->x[j]], scale * c->C[row * c->nx + j]);
        lowering_add_term(l, out, 2, s->dof[c->x[j]], scale * c->M[row * c->nx + j]);
    }
    for (int j = 0; j < c->nb; j++)
        lowering_add_term(l, out, 3, s->state + j, -scale * c->F[row * c->nb + j]);
    return true;
}

/* factor times the DERIVATIVE-th rate of coordinate c, on the program's own axes; false: it has no such row. */
static bool coordinate_terms(struct lowering *l, int c, int derivative, double factor, struct program_output *out)
{
    const struct shaft *s = l->mesh;
    const struct condensed *k = &s->condensed;
    int plane = c / PLANE, q = c % PLANE, at;

    if (!s->massless) {
        lowering_add_term(l, out, derivative, c, factor);
        return true;
    }
    if (s->journal >= 0 && q == (s->journal == SHAFT_LEFT ? UL : UR))
        return derivative == 0 && journal_terms(l, plane, factor, out);
    if (s->journal >= 0 && q == SD) {
        lowering_add_term(l, out, derivative, s->dof[UD + plane * PLANE], factor * s->journal_map[plane][0]);
        lowering_add_term(l, out, derivative, s->dof[c], factor * s->journal_map[plane][1]);
        return true;
    }
    if (s->dof[c] >= 0) {
        lowering_add_term(l, out, derivative, s->dof[c], factor);
        return true;
    }
    if ((at = index_in(k->b, k->nb, c)) >= 0) {
        lowering_add_term(l, out, 3, s->state + at, factor);
        return derivative == 0;
    }
    if ((at = index_in(k->a, k->na, c)) < 0 || s->fixed)
        return false;
    for (int j = 0; j < k->nx; j++)
        lowering_add_term(l, out, derivative, s->dof[k->x[j]], factor * k->Rx[at * k->nx + j]);
    for (int j = 0; j < k->nb; j++)
        lowering_add_term(l, out, 3, s->state + j, factor * k->Rb[at * k->nb + j]);
    return derivative == 0 || k->nb == 0;
}

/* The same coordinate seen from fixed axes: rows of D = q, q' + W J q, q'' + 2 W J q' - W^2 q, turned. */
static bool turned_terms(struct lowering *l, int c, int derivative, struct program_output *out)
{
    const struct shaft *s = l->mesh;
    int half = s->massless ? PLANE : 2, y = s->massless ? c % PLANE : c & ~2, plane = s->massless ? c / PLANE : (c & 2) / 2;
    double W = s->speed;
    bool found = true;

    for (int p = 0; p < 2; p++) {                       /* D_y, then D_z */
        int own = y + p * half, other = y + (1 - p) * half, first = out->count;
        double J = p == 0 ? -1 : 1;                     /* (J q)_y = -q_z, (J q)_z = q_y */
        double weight = plane == 0 && p == 1 ? -1 : 1;  /* y: cos D_y - sin D_z;  z: sin D_y + cos D_z */
        int shift = plane == p ? 4 : 8;

        found = found && coordinate_terms(l, own, derivative, weight, out);
        if (derivative == 1)
            found = found && coordinate_terms(l, other, 0, weight * W * J, out);
        if (derivative == 2) {
            found = found && coordinate_terms(l, other, 1, weight * 2 * W * J, out);
            found = found && coordinate_terms(l, own, 0, -weight * W * W, out);
        }
        for (int t = first; t < out->count; t++)
            out->terms[t].i += shift;
    }
    return found;
}

static enum modal_status sensor(struct lowering *l, const cJSON *json, const char *path, struct program_output *out,
                                struct modal_error *err)
{
    static const char *const keys[] = { "dof", "derivative", "frame", "name", NULL }, *const frames[] = { "rotating", "fixed", NULL };
    static const char *const suffix[] = { "", "_dot", "_ddot" };
    const struct shaft *s = l->mesh;
    const char *dof = NULL, *name = NULL;
    int derivative = 0, face = s->fixed || s->seen_fixed ? 1 : 0, frame = face, own = s->fixed ? 1 : 0, c;
    char where[128], text[96];
    enum modal_status rc = json_keys(json, path, keys, err);

    if (rc == MODAL_OK)
        rc = json_need_string(json, path, "dof", &dof, err);
    if (rc == MODAL_OK)
        rc = json_get_int(json, path, "derivative", 0, 2, &derivative, err);
    if (rc == MODAL_OK)
        rc = json_get_choice(json, path, "frame", frames, &frame, err);
    if (rc == MODAL_OK)
        rc = json_get_string(json, path, "name", &name, err);
    if (rc != MODAL_OK)
        return rc;
    json_path(where, path, "dof");
    if ((c = coordinate_of(l, dof)) < 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "no dof \"%.40s\" in this shaft; its dofs run from %s to %s", dof, l->p->dofs[0],
                                l->p->dofs[l->p->n - 1]);
    if (frame == 0 && face == 1) {
        json_path(where, path, "frame");
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: on fixed axes sensors are fixed too; use structure.frame \"rotating\"", where);
    }
    if (!(frame == own ? coordinate_terms(l, c, derivative, 1, out) : turned_terms(l, c, derivative, out)))
        return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s: \"%.40s\" has no output row of derivative %d in this model (an end without mass)",
                                where, dof, derivative);
    snprintf(text, sizeof text, "%.40s%s%s", dof, suffix[derivative], frame == face ? "" : "_fixed");
    out->name = strdup(name != NULL ? name : text);
    return out->name != NULL ? MODAL_OK : no_memory(err);
}

static const char *const keys[] = { "length", "elements", "EI", "mass_per_length", "disk", "speed", "frame", "model", NULL };
const struct scene_structure_kind structure_shaft = {
    .name = "shaft", .keys = keys, .lower = lower, .strain_rate = strain_rate, .sensor = sensor, .finish = finish,
};
