/*
 * airloads.c - a wing in a stream: apparent mass, circulatory lift at stations, and an inflow
 * model's states
 *
 * wing_model.c has the loads, inflow/ the models.  `speed`, `density`, `lift_slope` (2 pi), `x_qc`
 * (aft positive from the elastic axis), `stations` (9), `inflow` (none), `inflow_states` (the
 * model's standard: see the rows of inflow/).
 */
#include "modal/scene/lowering.h"
#include "modal/scene/structures/wing.h"

enum {
    INFLOW_STATES_ABSENT = -1,             /* the model's standard */
    /* any count is read, so that the model tells what it accepts */
    INFLOW_STATES_TOLD = 1000000,
};

/* ROWS, n x n, into MATRIX; zeros of the product are no entries. */
static void add_rows(struct lowering *l, int matrix, const double *rows, int n)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            if (rows[i * n + j] != 0)
                lowering_add(l, matrix, i, j, rows[i * n + j]);
}

/* ROWS, m x n, into BLOCK from (i0, j0) on. */
static void add_block(struct lowering *l, enum lowering_block block, int i0, int j0,
                      const double *rows, int m, int n)
{
    for (int i = 0; i < m; i++)
        for (int j = 0; j < n; j++)
            lowering_add_block(l, block, i0 + i, j0 + j, rows[i * n + j]);
}

struct airloads_keys { struct airloads a; int inflow; };

static const struct scene_key keys[] = {
    { "speed", SCENE_NUMBER, offsetof(struct airloads_keys, a.speed), "m/s", 0, SCENE_LARGE,
      .needed = true, .means = "of the stream, U", .example = "30" },
    { "density", SCENE_NUMBER, offsetof(struct airloads_keys, a.density), "kg/m^3", 0, SCENE_LARGE,
      .needed = true, .means = "of the air, rho", .example = "1.2" },
    { "lift_slope", SCENE_NUMBER, offsetof(struct airloads_keys, a.lift_slope), "1/rad", 0,
      SCENE_LARGE, .standard = 2 * M_PI, .means = "a0",
      .example = "5.7" },
    { "x_qc", SCENE_NUMBER, offsetof(struct airloads_keys, a.x_qc), "m", -SCENE_LARGE, SCENE_LARGE,
      .needed = true, .means = "quarter chord from the elastic axis, aft positive",
      .example = "-0.1" },
    { "stations", SCENE_WHOLE, offsetof(struct airloads_keys, a.stations), "", 1,
      WING_STATIONS_MOST, .standard = 9, .means = "of the quadrature along the span",
      .example = "9" },
    { "inflow", SCENE_WORD, offsetof(struct airloads_keys, inflow), .words = inflow_names,
      .means = "induced velocity: jones: of Wagner's 1 - 0.165 exp(-0.0455 s) - 0.335 exp(-0.3 s), "
               "s = U t/b; peters_2d: Peters, Karunamoorthy and Cao (1995); peters_he: Peters and "
               "He (1995), the wing and its mirror image a lifting line",
      .example = "\"peters_2d\"" },
    { "inflow_states", SCENE_WHOLE, offsetof(struct airloads_keys, a.inflow_states), "", 0,
      INFLOW_STATES_TOLD, .standard = INFLOW_STATES_ABSENT,
      .otherwise = "6 for peters_2d, 2 for jones, "
                   "30 for peters_he",
      .means = "states of each station; for peters_he of the wing", .example = "6" },
    { 0 },
};

/* The inflow's model and its states, which the model itself judges. */
static enum modal_status find_inflow(const struct scene_effect *e, struct airloads_keys *k,
                                     struct modal_error *err)
{
    struct airloads *a = &k->a;
    char where[128];

    a->inflow = inflow_kinds[k->inflow];
    if (a->inflow_states == INFLOW_STATES_ABSENT)
        a->inflow_states = a->inflow->standard;
    if (a->inflow->valid(a->inflow_states))
        return MODAL_OK;
    json_path(where, e->path, "inflow_states");
    return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s is %d; %s accepts %s", where,
                            a->inflow_states, a->inflow->name, a->inflow->accepted);
}

/* All of (1), (2) of program.h that the stream adds: apparent mass in M, C, K, circulation by
 * F and the states' E, A, Bx, Bv, Ba. */
static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    struct wing_mesh *mesh = l->mesh;
    struct airloads_matrices *air = &mesh->air;
    struct airloads_keys *k = e->values;
    enum modal_status rc = find_inflow(e, k, err);

    if (rc == MODAL_OK && mesh->in_air)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, e->path, "%s: airloads are listed already",
                              e->path);
    if (rc != MODAL_OK)
        return rc;
    mesh->in_air = true;                               /* from here on there is something to free */
    rc = airloads_new(&mesh->wing, &k->a, air, err);
    if (rc != MODAL_OK)
        return rc;
    mesh->state = air->nz > 0 ? lowering_add_states(l, air->nz) : 0;
    if (mesh->state < 0)
        return MODAL_OK;                               /* too many: scene_lower says so */
    add_rows(l, PROGRAM_M, air->M, air->n);
    add_rows(l, PROGRAM_C, air->C, air->n);
    add_rows(l, PROGRAM_K, air->K, air->n);
    add_block(l, LOWER_F, 0, mesh->state, air->F, air->n, air->nz);
    add_block(l, LOWER_BX, mesh->state, 0, air->Bx, air->nz, air->n);
    add_block(l, LOWER_BV, mesh->state, 0, air->Bv, air->nz, air->n);
    add_block(l, LOWER_BA, mesh->state, 0, air->Ba, air->nz, air->n);
    add_block(l, LOWER_E, mesh->state, mesh->state, air->flow.E, air->nz, air->nz);
    add_block(l, LOWER_A, mesh->state, mesh->state, air->flow.A, air->nz, air->nz);
    return MODAL_OK;
}

static const char *const structures[] = { "wing", NULL };
const struct scene_effect_kind effect_airloads = {
    .name = "airloads", .keys = { scene_type_keys, keys }, .size = sizeof(struct airloads_keys),
    .structures = structures,
    .law = "per length up A (-w_tt + U phi_t - b e phi_tt) + Lc; nose-up "
           "A (-b e w_tt - U h phi_t - b^2 (1/8 + e^2) phi_tt) - x_qc Lc; A = pi rho b^2, "
           "b = chord/2, e = -x_qc/b - 1/2, h = b + x_qc, "
           "Lc = a0 rho U b (U phi - w_t + h phi_t - inflow)",
    .lower = lower,
};
