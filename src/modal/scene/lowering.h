/* lowering.h - what structures and effects write a scene into: entries, states, laws, by name and
 * path
 *
 * How to add an effect: write src/modal/scene/effects/<name>.c with what its keys are read into, a
 * row for each key (scene_key.h), one function `lower` and one row for the effect,
 *
 *     struct spring { struct local_ends at; double stiffness; };
 *
 *     static const struct scene_key keys[] = {
 *         { "stiffness", SCENE_NUMBER, offsetof(struct spring, stiffness), "N/m", -HUGE_VAL,
 *           HUGE_VAL, .needed = true, .means = "k in f = k d, of any sign", .example = "1000" },
 *         { 0 },
 *     };
 *
 *     static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
 *                                    struct modal_error *err)
 *     {
 *         const struct spring *s = e->values;
 *
 *         (void)err;
 *         lowering_along(l, PROGRAM_K, s->at.along, s->stiffness);
 *         return MODAL_OK;
 *     }
 *
 *     const struct scene_effect_kind effect_spring = {
 *         .name = "spring", .keys = { lowering_ends_keys, keys }, .size = sizeof(struct spring),
 *         .law = "minus stiffness d on dof", .lower = lower,
 *     };
 *
 * and name the row in effects.c.  A structure is the same: one file, one row, one line in
 * structures.c.
 *
 * The structure is lowered first, then the effects in the scene's order, then excitation, initial
 * state and sensors. Adding never fails: running out of memory is remembered and reported once, by
 * scene_lower.
 */
#ifndef MODAL_LOWERING_H
#define MODAL_LOWERING_H
#include <stdbool.h>
#include "base/error.h"
#include "base/json.h"
#include "modal/scene/program.h"
#include "modal/scene/scene_key.h"

enum {
    LOWERING_DOFS_MOST = 1000000, /* what sparse factors of a steady state are made for */
    /* of a matrix: 1.6 GB as triplets; as many dofs of a solid, 81 a row, have 81 million */
    LOWERING_ENTRIES_MOST = 100000000,
    LOWERING_COUPLINGS_MOST = 20000000,  /* of the ends of a law, each with each: as entries */
    LOWERING_STATES_MOST = 2000,  /* dense, as stepping needs them */
    LOWERING_HARMONIC_MOST = 1000,  /* past any gear; k omega t keeps 12 digits */
    LOWERING_LOADS_MOST = 4096,  /* as many as effects (scene.h) */
    LOWERING_POINTS_MOST = 1000000,    /* of a table */
};

struct lowering;

struct scene_effect {                  /* one entry of the scene's effects */
    const cJSON *json;  /* as the scene has it */
    const char *path;                  /* "effects[2]" */
    int index;                         /* its row of program.effect */
    /* its keys, read as the rows of its kind say; freed after `lower` */
    void *values;
};

struct scene_effect_kind {
    const char *name;
    /* read before `lower` into `size` zeroed bytes */
    const struct scene_key *keys[SCENE_TABLES_MOST];
    size_t size;
    const char *const *structures;     /* that take it, NULL-terminated; NULL: all */
    /* the force or matrix that it adds, with its sign; one line */
    const char *law;
    enum modal_status (*lower)(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err);
};

struct scene_structure_kind {
    const char *name;
    /* read before `lower` into `size` zeroed bytes */
    const struct scene_key *keys[SCENE_TABLES_MOST];
    size_t size;
    const char *law;                   /* its equation of motion; one line */
    /* what `sensor` reads, ended by one without `list`; NULL: none */
    const struct scene_table *sensors;
    /* Dofs, then M, C, K entries; what effects will ask for goes into l->mesh.  VALUES: its keys,
     * at the path "structure"; freed afterwards. */
    enum modal_status (*lower)(struct lowering *l, void *values, struct modal_error *err);
    /* strain_rate_damping, C = mu K of the elastic members; NULL: mu times the structure's own
     * K. */
    enum modal_status (*strain_rate)(struct lowering *l, double mu, struct modal_error *err);
    /* A sensor that names no dof of the program or names a frame (wing: station, position), into
     * the output row, `name` too; NULL: none. */
    enum modal_status (*sensor)(struct lowering *l, const cJSON *json, const char *path,
                                struct program_output *out, struct modal_error *err);
    /* After all effects, before excitation: what depends on them all (ends in series, ...);
     * NULL: nothing. */
    enum modal_status (*finish)(struct lowering *l, struct modal_error *err);
    void (*mesh_free)(void *mesh);     /* NULL: free() */
};

struct lowering_entries { struct triplet *x; int count, room; };

struct lowering_harmonic {             /* cosine and sine entries of M, C, K at one k */
    int k;
    struct lowering_entries cosine[3], sine[3];
};

enum lowering_block { LOWER_E, LOWER_A, LOWER_BX, LOWER_BV, LOWER_BA, LOWER_F, LOWER_BLOCKS };

struct scene_options;

struct lowering {
    /* borrowed, with the options it is lowered by (may be NULL) */
    const cJSON *scene;
    const struct scene_options *options;
    /* its n, dofs, omega, laws, loads, outputs grow here; matrices come at the end */
    struct program *p;
    const struct scene_structure_kind *structure;  /* NULL until it is found */
    void *mesh;                        /* the structure's own numbers, freed by mesh_free */
    int effect;                        /* row of program.effect being lowered; -1: the structure */
    /* of a distributed structure, for viscous_damping; 0: none */
    double mass_per_length;
    /* On turning axes, a load fixed in space on dof i also acts on turn_partner[i], times
     * turn_sign[i] (see program_load.dof_sine); both NULL: axes do not turn.  The lowering frees
     * them. */
    int *turn_partner;
    double *turn_sign;
    bool names_frames;                 /* loads may say "frame": "fixed" or "rotating" */

    struct lowering_entries constant[3];  /* M, C, K of program.h */
    /* of constant[i], the first so many are the structure's own */
    int structural[3];
    struct lowering_harmonic *harmonic;  /* ascending k */
    int harmonics;
    struct lowering_entries block[LOWER_BLOCKS];  /* by enum lowering_block */
    double couplings;                  /* of all laws, each end with each of its law */
    bool no_memory, too_many;  /* remembered, and told by scene_lower */
};

/* Dofs, by the structure: appended in order; the name is copied.  Returns the index. */
int lowering_add_dof(struct lowering *l, const char *name);

/* Entries; an index of -1 (ground, a support) adds nothing. */
void lowering_add(struct lowering *l, int matrix, int i, int j, double value);
/* A damper that does not turn: C and, on turning axes, the K entry that its circulation is there
 * (frame_speed c J). */
void lowering_add_still_damping(struct lowering *l, int i, int j, double c);
/* The constant part of a harmonic matrix: cosine * cos(k Omega t) + sine * sin(k Omega t).  k =
 * 0 is lowering_add of cosine. */
void lowering_add_harmonic(struct lowering *l, int matrix, int k, int i, int j, double cosine,
                           double sine);
/* N x N element matrix (row-major) at dofs INDEX. */
void lowering_add_element(struct lowering *l, int matrix, int n, const int *index,
                          const double *values);
/* COUNT linear states for the effect being lowered; the first one's index. */
int lowering_add_states(struct lowering *l, int count);
/* An entry of E, A, Bx, Bv, Ba or F of program.h; index -1 and zeros add nothing. */
void lowering_add_block(struct lowering *l, enum lowering_block block, int i, int j, double value);
/* The law becomes the program's (LAW is emptied), with the effect being lowered; its ends are
 * already placed. */
void lowering_add_law(struct lowering *l, struct law *law);
/* What a channel's name ends with that reads the 0th, 1st, 2nd derivative of what it is called
 * after. */
extern const char *const lowering_suffix[3];
/* A term of an output row: quantity 0 x, 1 x', 2 x'', 3 z (program.h lists the turning ones). */
void lowering_add_term(struct lowering *l, struct program_output *out, int quantity, int j,
                       double value);

/* The scene's next entry of effects of TYPE after AFTER (NULL: the first), unless left out; NULL:
 * none.  For structures whose dofs depend on an effect; the entry has not been checked yet. */
const cJSON *lowering_lists(const struct lowering *l, const char *type, const cJSON *after);

/* The dof that KEY of JSON names, -1 for "ground"; *DOF keeps its value where KEY is absent.
 * Unknown: MODAL_BAD_INPUT with the path. */
enum modal_status lowering_dof(const struct lowering *l, const cJSON *json, const char *base,
                               const char *key, int *dof, struct modal_error *err);

/* The weights by dof name that VALUE, at PATH, has, or if it may be NAMED the dof that it names,
 * into *OUT; free(out->x), on failure too.  MODAL_BAD_INPUT for none, an unknown dof, or one of no
 * weight; MODAL_TOO_LARGE past LAW_ENDS_MOST. */
enum modal_status lowering_ends_of(const struct lowering *l, const cJSON *value, const char *path,
                                   bool named, struct scene_ends *out, struct modal_error *err);
/* The same of KEY of JSON; *OUT stays empty where it is absent. */
enum modal_status lowering_ends(const struct lowering *l, const cJSON *json, const char *base,
                                const char *key, bool named, struct scene_ends *out,
                                struct modal_error *err);

/* `type`, and `dof` and `to` (default ground) or `direction` of a local effect, whose values begin
 * with its ends.  `lower` reads `along` alone: where this table is one of an effect's, dof and to
 * are checked and become their two ends there. */
struct local_ends { int dof, to; struct scene_ends along; };
extern const struct scene_key lowering_ends_keys[];

/* C = mu K of the structure's elastic members, for the effect being lowered. */
enum modal_status lowering_strain_rate(struct lowering *l, double mu, struct modal_error *err);

/* value * w w^T of the ends' weights w: [1 -1; -1 1] between two dofs. */
void lowering_along(struct lowering *l, int matrix, struct scene_ends at, double value);
/* The same of K, pulsating: cosine cos(k Omega t) + sine sin(k Omega t). */
void lowering_along_harmonic(struct lowering *l, int k, struct scene_ends at,
                             double cosine, double sine);
/* INPUT of LAW looks and pushes at AT; inputs in their order, before lowering_add_law. */
void lowering_place(struct lowering *l, struct law *law, int input, struct scene_ends at);

/* omega > 0, or MODAL_BAD_INPUT at "omega": for effects and loads that need it. */
enum modal_status lowering_need_omega(const struct lowering *l, const char *who,
                                      struct modal_error *err);

/* The structure's own matrix (no effects), dense n x n by columns; the caller frees it.  NULL:
 * no memory. */
double *lowering_structural_dense(const struct lowering *l, int matrix);

/* From entries to the program's matrices, and what only the whole can be checked for.  Fails with
 * MODAL_NO_MEMORY, MODAL_TOO_LARGE at "effects", MODAL_BAD_INPUT at "structure", "period". */
enum modal_status lowering_finish(struct lowering *l, struct modal_error *err);

#endif
