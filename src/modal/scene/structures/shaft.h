/* shaft.h - what the shaft's effects write into: a mesh that becomes entries once all of them are
 * known
 *
 * Supports in series, a massless journal and condensed ends depend on several effects at once, so
 * effects note their numbers here and the structure's `finish` lowers them, each under its effect's
 * row.
 */
#ifndef MODAL_STRUCTURES_SHAFT_H
#define MODAL_STRUCTURES_SHAFT_H
#include <stdbool.h>
#include "modal/scene/massless.h"
#include "modal/scene/lowering.h"

enum { SHAFT_ELEMENTS_MOST = 500 };   /* four dofs a node: past what statespace.h takes */
enum { SHAFT_LEFT, SHAFT_RIGHT };
extern const char *const shaft_ends[];         /* their names, NULL-terminated */

/* of a bearing or a coupling; a stiffness not given is no link of the series */
struct shaft_spring {
    bool listed, has_transverse, has_rotational;  /* given, and which links are */
    double transverse, rotational;  /* N/m, N m/rad */
    int effect;
};

struct shaft_end {
    struct shaft_spring bearing, coupling;  /* in series */
    double damping;                /* N s/m, of the bearing, on fixed axes */
    struct {
        bool listed;
        double gap, stiffness, dissipation, journal_mass;
        int effect;
    } clearance;
};

struct shaft {
    double length, EI[2], mass_per_length;     /* EI of plane y, plane z */
    int elements;  /* of equal length */
    int disk_node;  /* where it sits */
    double disk_mass, disk_radius;  /* kg, m; 0: no disk */
    double speed;  /* W, rad/s */
    bool fixed, massless;  /* the dofs' axes; the model */
    /* on turning axes (`fixed` is false), its face on fixed ones */
    bool seen_fixed;
    /* fixed axes: stiffness turns with cos, sin (harmonic omega t) = (2 speed t) */
    int harmonic;

    struct shaft_end end[2];
    double strain_rate;                        /* mu, s */
    int strain_rate_effect;  /* its row */
    bool gyroscopic;  /* Mg counts */
    int gyroscopic_effect;  /* its row */
    double I_rho;                              /* kg m, polar, of the cross-section */
    int rotary_effect;  /* its row */

    /* massless: the eight coordinates (uL, uR, uD, sD of plane y, then of z), where each is
     * found */
    struct condensed condensed;  /* of the eight */
    int dof[8];                                /* a dof, or -1 */
    int state;                                 /* first linear state, of condensed.b in order */
    int journal;                               /* the end with a massless journal, or -1 */
    double journal_stiffness[2];               /* of the shaft there, by plane */
    double journal_map[2][2];                  /* by plane: sD = map[0] uD + map[1] free end */
};

#endif
