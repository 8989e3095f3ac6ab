/*
 * shaft_massless.c - a shaft without mass of its own: a disk between two exact elements
 */
#include "modal/scene/structures/shaft_parts.h"
#include <stdio.h>
#include <string.h>
#include "modal/scene/hermite.h"

/* The shaft over (uL, uR, uD, sD) of one plane: an exact element each side, the ends' slopes
 * condensed with their springs. */
static void massless_plane(const struct shaft *s, double EI, double out[16])
{
    /* where the disk is */
    double at = s->length * s->disk_node / s->elements, side[2] = { at, s->length - at }, k[16];
    /* -1: the slope to be condensed */
    static const int where[2][4] = { { UL, -1, UD, SD }, { UD, SD, UR, -1 } };

    memset(out, 0, 16 * sizeof *out);
    for (int end = 0; end < 2; end++) {
        int slope = end == SHAFT_LEFT ? 1 : 3;  /* the outer end's, in the element */

        hermite_stiffness(EI, side[end], k);
        double own = k[5 * slope] + shaft_rotational(&s->end[end]);
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++)
                if (i != slope && j != slope)
                    out[PLANE * where[end][i] + where[end][j]] +=
                        k[4 * i + j] - k[4 * i + slope] * k[4 * slope + j] / own;
    }
}

/* A(i, j) += value, eight coordinates a row. */
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

/* Masses and polar inertias of the eight coordinates: one value a coordinate, alike in both
 * planes. */
static void massless_inertia(const struct shaft *s, double mass[PLANE], double polar[PLANE])
{
    double tilting = s->disk_mass * s->disk_radius * s->disk_radius;  /* M r^2 */

    memset(polar, 0, PLANE * sizeof *polar);  /* but of the disk */
    mass[UL] = s->end[SHAFT_LEFT].clearance.journal_mass;
    mass[UR] = s->end[SHAFT_RIGHT].clearance.journal_mass;
    mass[UD] = s->disk_mass;
    mass[SD] = tilting / 4;  /* diametral */
    polar[SD] = s->gyroscopic ? tilting / 2 : 0;  /* twice the diametral: a thin disk */
}

/* (1) over the eight coordinates; on fixed axes (2) with Ks as it lies at t = 0. */
static void massless_matrices(const struct shaft *s, double Ks[2][16], double *M, double *C,
                              double *K)
{
    double mass[PLANE], polar[PLANE], W = s->fixed ? 0 : s->speed;

    massless_inertia(s, mass, polar);
    for (int i = 0; i < PLANE; i++) {
        const struct shaft_end *e = i == UL ? &s->end[SHAFT_LEFT] : &s->end[SHAFT_RIGHT];
        double spring = i < UD ? shaft_transverse(e) : 0, damper = i < UD ? e->damping : 0;

        put_J(C, i, i, W * (2 * mass[i] - polar[i]));  /* (1): 2 W Mt J - W Mg J */
        put_J(K, i, i, W * damper);  /* (1): W Cb J */
        for (int plane = 0; plane < 2; plane++) {
            int c = i + plane * PLANE;

            put(M, c, c, mass[i]);  /* alike in both planes */
            put(C, c, c, damper);  /* Cb */
            put(K, c, c, spring - W * W * (mass[i] - polar[i]));
            for (int j = 0; j < PLANE; j++) {
                put(K, c, j + plane * PLANE, Ks[plane][PLANE * i + j]);
                put(C, c, j + plane * PLANE, s->strain_rate * Ks[plane][PLANE * i + j]);
            }
        }
    }
}

/* B <- T^T A T, A <- A T: the disk's slope given by disk and free end; x runs (uD, sD) of plane
 * y, then of z. */
static void map_columns(const struct shaft *s, double *A, int rows)
{
    for (int i = 0; i < rows; i++)
        for (int plane = 0; plane < 2; plane++) {
            double *u = &A[4 * i + 2 * plane], *slope = u + 1;

            *u += s->journal_map[plane][0] * *slope;
            *slope *= s->journal_map[plane][1];
        }
}

/* The same from the left. */
static void map_rows(const struct shaft *s, double *A, int columns)
{
    for (int j = 0; j < columns; j++)
        for (int plane = 0; plane < 2; plane++) {
            double *u = &A[2 * plane * columns + j], *slope = u + columns;

            *u += s->journal_map[plane][0] * *slope;
            *slope *= s->journal_map[plane][1];
        }
}

/* From the disk's slope to the free end, by row r of Ks: f = -(K_ru u + K_rs s)/K_rr solved
 * for s. */
static void map_to_free_end(struct shaft *s, double Ks[2][16])
{
    struct condensed *c = &s->condensed;
    int r = s->journal == SHAFT_LEFT ? UL : UR;  /* the free end's coordinate */

    for (int plane = 0; plane < 2; plane++) {
        const double *row = &Ks[plane][PLANE * r];  /* K_ru, K_rs, K_rr */

        s->journal_stiffness[plane] = row[r];  /* K_rr */
        s->journal_map[plane][0] = -row[UD] / row[SD];  /* s of (f, u) */
        s->journal_map[plane][1] = -row[r] / row[SD];
    }
    for (int q = 0; q < 3; q++) {
        double *A = q == 0 ? c->M : q == 1 ? c->C : c->K;

        map_columns(s, A, c->nx);
        map_rows(s, A, c->nx);
    }
    map_rows(s, c->F, c->nb);  /* F pushes on x */
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
        dof[i] = s->dof[c->x[i]];  /* program's dofs of what was kept */
    for (int i = 0; i < c->nx; i++)
        for (int j = 0; j < c->nx; j++) {
            lowering_add(l, PROGRAM_C, dof[i], dof[j], c->C[i * c->nx + j]);
            if (!s->fixed)
                lowering_add(l, PROGRAM_K, dof[i], dof[j], c->K[i * c->nx + j]);
        }
    for (int half = c->nx / 2, i = 0; s->fixed && i < half; i++)
        for (int j = 0; j < half; j++)
            shaft_add_elastic(l, PROGRAM_K, (int[]){ dof[i], dof[i + half] },
                              (int[]){ dof[j], dof[j + half] }, c->K[i * c->nx + j],
                              c->K[(i + half) * c->nx + j + half]);
    s->state = c->nb > 0 ? lowering_add_states(l, c->nb) : -1;  /* E, A, Bx, Bv, F of program.h */
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

/* A clearance whose journal has no mass, as the scene lists it (its keys are checked when it is
 * lowered). */
static int massless_journal(const struct lowering *l)
{
    for (const cJSON *e = lowering_lists(l, "clearance", NULL); e != NULL;
         e = lowering_lists(l, "clearance", e)) {
        const cJSON *mass = cJSON_GetObjectItemCaseSensitive(e, "journal_mass"),
                    *at = cJSON_GetObjectItemCaseSensitive(e, "at");

        if ((!cJSON_IsNumber(mass) || mass->valuedouble == 0) && cJSON_IsString(at))
            /* another word is told when it is lowered */
            return strcmp(at->valuestring, "left") == 0 ? SHAFT_LEFT : SHAFT_RIGHT;
    }
    return -1;
}

/* Whether END's journal is a dof of its own. */
static bool journal_with_mass(const struct lowering *l, int end)
{
    for (const cJSON *e = lowering_lists(l, "clearance", NULL); e != NULL;
         e = lowering_lists(l, "clearance", e)) {
        const cJSON *mass = cJSON_GetObjectItemCaseSensitive(e, "journal_mass"),
                    *at = cJSON_GetObjectItemCaseSensitive(e, "at");

        if (cJSON_IsNumber(mass) && mass->valuedouble > 0 && cJSON_IsString(at)
            && strcmp(at->valuestring, end == SHAFT_LEFT ? "left" : "right") == 0)
            return true;
    }
    return false;
}

/* Coordinate c as a name; FREE: the free end instead of the disk's slope. */
void shaft_coordinate_name(const struct shaft *s, int c, bool free_end, char out[32])
{
    /* which of (uL, uR, uD, sD) */
    int q = c % PLANE, node = q == UL ? 0 : q == UR ? s->elements : s->disk_node;
    const char *plane = c < PLANE ? "y" : "z";

    if (free_end)
        snprintf(out, 32, "free_%s%d", plane, s->journal == SHAFT_LEFT ? 0 : s->elements);
    else
        snprintf(out, 32, "%s%s%d", q == SD ? "s" : "", plane, node);
}

/* What the ends' states need: damping somewhere, or a journal without mass.  Whether left out or
 * not, so that ablation keeps the axes. */
bool shaft_has_end_states(const struct lowering *l)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(l->scene, "effects"), *e;

    cJSON_ArrayForEach(e, list) {
        const char *type = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(e, "type"));
        const cJSON *damping = cJSON_GetObjectItemCaseSensitive(e, "damping"),
                    *mu = cJSON_GetObjectItemCaseSensitive(e, "mu");
        const cJSON *mass = cJSON_GetObjectItemCaseSensitive(e, "journal_mass");

        if (type == NULL)  /* told when it is lowered */
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
 * End states have constant equations on turning axes only.  There the scene is lowered, and seen
 * from fixed axes; what an effect between single dofs, or one of the whole structure's matrices,
 * means on fixed axes it would not mean there.
 */
enum modal_status shaft_see_from_fixed_axes(struct lowering *l, struct modal_error *err)
{
    static const char *const turning[] = { "bearing", "coupling", "gyroscopic",
                                           "strain_rate_damping", "clearance" };
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(l->scene, "effects"), *e;
    struct shaft *s = l->mesh;
    int position = 0;

    cJSON_ArrayForEach(e, list) {
        const char *type = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(e, "type"));
        bool turns = type == NULL;  /* told when it is lowered */

        for (size_t i = 0; i < sizeof turning / sizeof *turning; i++)
            turns = turns || strcmp(type, turning[i]) == 0;
        if (!turns) {
            char where[32];
            snprintf(where, sizeof where, "effects[%d]", position);
            return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                    "%s: the damped ends of a massless shaft are states on turning "
                                    "axes, where a %.40s on "
                                    "fixed ones is not constant: use structure.frame \"rotating\" "
                                    "or model \"finite_elements\"",
                                    where, type);
        }
        position++;
    }
    s->fixed = false;  /* dofs turn; the face does not */
    s->seen_fixed = l->p->seen_fixed = true;
    return MODAL_OK;
}

void shaft_lower_massless(struct lowering *l)
{
    struct shaft *s = l->mesh;
    char name[32];

    s->journal = massless_journal(l);  /* before dofs: it changes which there are */
    for (int c = 0; c < 2 * PLANE; c++) {
        int q = c % PLANE;
        bool kept = q == UD || (q == SD && s->disk_radius > 0)  /* what carries mass */
                    || (q < UD && journal_with_mass(l, q == UL ? SHAFT_LEFT : SHAFT_RIGHT));

        shaft_coordinate_name(s, c, q == SD && s->journal >= 0, name);
        s->dof[c] = kept ? lowering_add_dof(l, name) : -1;
    }
    for (int plane = 0; plane < 2; plane++) {
        int u = s->dof[UD + plane * PLANE], slope = s->dof[SD + plane * PLANE];

        /* else the mass is known once all effects are */
        if (s->journal < 0) {  /* no journal without mass */
            lowering_add(l, PROGRAM_M, u, u, s->disk_mass);
            lowering_add(l, PROGRAM_M, slope, slope,
                         s->disk_mass * s->disk_radius * s->disk_radius / 4);
        }
    }
}

/* What a massless journal leaves no room for. */
static enum modal_status check_massless(const struct shaft *s, struct modal_error *err)
{
    char where[64] = "effects[0]";

    if (s->journal < 0)
        return MODAL_OK;
    snprintf(where, sizeof where, "effects[%d]", s->end[s->journal].clearance.effect);
    if (s->strain_rate != 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, where,
                                "%s: with strain_rate_damping the journal needs a journal_mass",
                                where);
    if (!(s->disk_radius > 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.disk.radius",
                                "a massless journal needs a disk with a radius > 0");
    if (s->end[1 - s->journal].clearance.listed)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, where,
            "%s: a massless shaft has one clearance without journal_mass and none beside it",
            where);
    return MODAL_OK;
}

/* Whose row the damped ends' states stand in. */
static int damping_effect(const struct shaft *s)
{
    for (int end = 0; end < 2; end++)
        if (s->end[end].damping > 0)
            return s->end[end].bearing.effect;
    return s->strain_rate != 0 ? s->strain_rate_effect : -1;  /* the structure's own, if no row's */
}

/* What structure.lower did not write of the condensed mass: journals, or the whole of it on free
 * ends. */
static void write_mass(struct lowering *l)
{
    const struct shaft *s = l->mesh;
    const struct condensed *c = &s->condensed;

    for (int i = 0; i < c->nx; i++)
        for (int j = 0; j < c->nx; j++)
            if (s->journal >= 0 || c->x[i] % PLANE < UD)
                lowering_add(l, PROGRAM_M, s->dof[c->x[i]], s->dof[c->x[j]], c->M[i * c->nx + j]);
}

enum modal_status shaft_finish_massless(struct lowering *l, struct modal_error *err)
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
                shaft_add_polar(l, slope, slope,
                                s->disk_mass * s->disk_radius * s->disk_radius / 2);
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
            rc = shaft_add_clearance(l, end, s->dof[q], s->dof[q + PLANE],
                                     end == s->journal ? s->journal_stiffness : NULL, err);
    }
    return rc;
}
