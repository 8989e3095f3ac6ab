/* scene.h - a scene (JSON) read, checked, and lowered to a program
 *
 * Keys, signs and defaults: the scene sections of the project's contracts, mirrored in the rows of
 * structures.c and effects.c.  What a scene does not list leaves no trace in the program.
 *
 * Matrices of the structure `matrices` are nested lists, or compressed rows, counted from 0: as
 *     {"shape":[m,n], "row_pointers":[...m+1], "columns":[...], "values":[...]}
 * or, as clients make it of a file's, arrays behind the scene's text (scene_arrays.h).  A "file"
 * key is refused here: files are opened by clients.
 */
#ifndef MODAL_SCENE_H
#define MODAL_SCENE_H
#include <stdbool.h>
#include "base/error.h"
#include "base/json.h"
#include "modal/scene/program.h"

struct scene_arrays;
struct scene_effect_kind;
struct scene_structure_kind;
struct scene_table;

enum { SCENE_EFFECTS_MOST = 4096 };   /* WIRE_SCENE_MOST leaves 4 KiB to each */

struct scene_options {
    /* The effects' table, NULL-terminated; NULL: all of them (tests remove rows to show that
     * nothing is left). */
    const struct scene_effect_kind *const *effects;
    /* true: leave out this entry of the scene's effects (ablation); plan rows close up */
    bool without[SCENE_EFFECTS_MOST];
    const struct scene_arrays *arrays;   /* what stands behind the scene's text; NULL: nothing */
};

/*
 * Lower SCENE to *OUT; program_free frees it.  OPTIONS may be NULL.  Fails with MODAL_BAD_INPUT
 * (err->field is the path: "effects[2].stiffness", "initial.x.w9"), MODAL_TOO_LARGE (a limit of
 * lowering.h), MODAL_NO_MEMORY; *OUT is then left alone.
 */
enum modal_status scene_lower(const cJSON *scene, const struct scene_options *options,
                              struct program **out, struct modal_error *err);

/* `time` of a scene. */
struct scene_time {
    double dt;                /* s */
    double start;             /* s: of the record; the motion always starts at t = 0 */
    long samples;             /* duration / dt + 1 */
    double duration;          /* s, of the record */
};
enum { SCENE_SAMPLES_MOST = 100000000 };   /* 0.8 GB a channel, in memory */
/* Fails with MODAL_BAD_INPUT where `time` is absent or does not say a length, MODAL_TOO_LARGE
 * past SCENE_SAMPLES_MOST; *OUT is then left alone. */
enum modal_status scene_time(const cJSON *scene, const struct program *p, struct scene_time *out,
                             struct modal_error *err);

/* The accepted names of effects and structures, NULL-terminated, for messages and documents. */
extern const struct scene_effect_kind *const scene_effects[];
extern const struct scene_structure_kind *const scene_structures[];

/*
 * The I-th of all tables of keys (scene_key.h) into *OUT, from 0: the scene's own, structures,
 * effects, excitations, sensors; false past the last.  Whoever tells what a scene may hold walks
 * them.
 */
bool scene_tables(int i, struct scene_table *out);

#endif
