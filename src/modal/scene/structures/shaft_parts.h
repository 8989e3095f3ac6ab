/* shaft_parts.h - what the files of the shaft share with each other and nobody else; equations:
 * shaft.c */
#ifndef MODAL_SHAFT_PARTS_H
#define MODAL_SHAFT_PARTS_H
#include "modal/scene/structures/shaft.h"

/* A plane's coordinates of the massless model: ends left and right, the disk, its slope; plane z
 * follows plane y. */
enum { UL, UR, UD, SD, PLANE = 4 };

/* The other plane's dof of dof I, and J's sign there: (A J)(i, partner j) = sign(j) A(i, j). */
int shaft_partner(const struct shaft *s, int i);
/* -1 in plane y, +1 in plane z. */
double shaft_sign(const struct shaft *s, int i);

/* Adding to (1), (2) of shaft.c.  I and J of the last two are (y, z) pairs of dofs, kA and kB what
 * planes y and z have there; none can fail (lowering.h). */
/* An isotropic pair's polar inertia g: -W g J to C and, on turning axes, W^2 g to K. */
void shaft_add_polar(struct lowering *l, int i, int j, double g);
/* Ks to MATRIX, of constant entries on turning axes, by (3) on fixed ones. */
void shaft_add_elastic(struct lowering *l, int matrix, const int i[2], const int j[2], double kA,
                       double kB);
/* mu Ks to C and, on fixed axes, -mu W Ks(t) J to K. */
void shaft_add_strain_rate(struct lowering *l, const int i[2], const int j[2], double kA,
                           double kB);
/* Every mass entry m written so far, on turning axes: 2 W m J to C, -W^2 m to K. */
void shaft_turn_mass(struct lowering *l);

/* The springs of an end in series, N/m and N m/rad; 0: none. */
double shaft_transverse(const struct shaft_end *e);
/* Against the end's slope. */
double shaft_rotational(const struct shaft_end *e);
/* Say in the program's rows which of the shaft's effects act. */
void shaft_mark_active(struct lowering *l);
/* MODAL_BAD_INPUT where an end has a clearance and a bearing or coupling too. */
enum modal_status shaft_check_ends(const struct shaft *s, struct modal_error *err);
/* The clearance of END as a law on dofs Y and Z; STIFFNESS: of the shaft there, by plane, where its
 * journal has no mass, else NULL. */
enum modal_status shaft_add_clearance(struct lowering *l, int end, int y, int z,
                                      const double *stiffness, struct modal_error *err);

/* The massless model: do its ends, damped or of a massless journal, need states of their own? */
bool shaft_has_end_states(const struct lowering *l);
/* They then stand on turning axes, and the scene sees them from fixed ones; an effect that would
 * mean another thing there is MODAL_BAD_INPUT. */
enum modal_status shaft_see_from_fixed_axes(struct lowering *l, struct modal_error *err);
/* Coordinate C = 0 .. 2 PLANE - 1 as a name; FREE_END: the free end in place of the disk's
 * slope. */
void shaft_coordinate_name(const struct shaft *s, int c, bool free_end, char out[32]);
/* Its dofs and their mass; then, all effects being known, the rest. */
void shaft_lower_massless(struct lowering *l);
/* Fails with MODAL_BAD_INPUT where the ends leave no equation to eliminate by. */
enum modal_status shaft_finish_massless(struct lowering *l, struct modal_error *err);

enum { SHAFT_ROTATING, SHAFT_FIXED };
extern const char *const shaft_frames[];       /* "rotating", "fixed", NULL */
/* scene_structure_kind.sensor of the shaft, and the table it reads by. */
extern const struct scene_table shaft_sensors[];
/* Fails with MODAL_BAD_INPUT at `dof` or `frame`. */
enum modal_status shaft_sensor(struct lowering *l, const cJSON *json, const char *path,
                               struct program_output *out, struct modal_error *err);
#endif
