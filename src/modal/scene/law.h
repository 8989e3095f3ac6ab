/* law.h - a local nonlinear force: one table of functions a kind, the same for steady states and for stepping
 *
 * A law reads the relative displacements d[i] = x[dof[i]] - x[to[i]] (to = -1: ground) and their rates, and gives the
 * forces f[i] with which it resists: (1) of program.h has +f on dof[i], -f on to[i].
 */
#ifndef MODAL_LAW_H
#define MODAL_LAW_H
#include <stdbool.h>
#include "modal/error.h"

enum { LAW_INPUTS_MOST = 2 };

struct law;

struct law_point {                    /* one instant, reached from the one before */
    double t;                         /* s */
    const double *d, *v;              /* inputs each, now */
    const double *d_before;           /* at the step's start (laws with memory) */
    const double *memory_before;      /* `memory` doubles at the step's start; zeros at the very start */
};

struct law_force {
    double f[LAW_INPUTS_MOST];
    double fd[LAW_INPUTS_MOST][LAW_INPUTS_MOST];   /* df_i/dd_j, exact, memory_before and d_before held */
    double fv[LAW_INPUTS_MOST][LAW_INPUTS_MOST];   /* df_i/dv_j */
    double *memory;                                /* out: `memory` doubles after the step */
    bool acts;                                     /* slipping, in contact, ... : not in its rest regime */
    int regime;                                    /* which smooth piece this is: within one, f is analytic; 0 for smooth
                                                    * laws (stepping locates the instants where it changes) */
};

struct law_class {
    const char *name;
    int inputs;                       /* 1 or 2 */
    bool reads_velocity, reads_time;
    bool smooth;                      /* analytic in d and v: no events to locate */
    enum modal_status (*force)(const struct law *law, const struct law_point *at, struct law_force *out,
                               struct modal_error *err);
    void (*free)(struct law *law);    /* of law->data; NULL: free() */
};

struct law {
    const struct law_class *kind;
    int effect;                       /* row of program.effect */
    int dof[LAW_INPUTS_MOST], to[LAW_INPUTS_MOST];
    int memory;                       /* doubles of state (iwan: one a slider) */
    void *data;                       /* its numbers, as its class lays them out */
};

/* Release law->data; the struct itself is the caller's. */
void law_done(struct law *law);

/*
 * Constructors: fill OUT's kind, memory and data; who lowers the effect sets effect, dof and to.  Arrays are copied.
 * Ranges are checked by the caller, who knows the scene's paths; the constructors fail with MODAL_NO_MEMORY, and
 * law_lua with MODAL_BAD_INPUT (err->field: "source", which the caller prefixes) where the source does not compile or
 * defines no function `force`.
 */
enum modal_status law_polynomial_spring(const double *coefficients, int count, struct law *out, struct modal_error *err);
enum modal_status law_polynomial_damper(const double *coefficients, int count, struct law *out, struct modal_error *err);
enum modal_status law_jenkins(double stiffness, double limit, struct law *out, struct modal_error *err);
enum modal_status law_iwan(const double *stiffnesses, const double *limits, int count, struct law *out, struct modal_error *err);
enum modal_status law_gap(double stiffness, double clearance, double dissipation, bool both_sides, struct law *out,
                          struct modal_error *err);
enum modal_status law_coulomb(double limit, struct law *out, struct modal_error *err);
enum modal_status law_regularised_coulomb(double limit, double velocity, struct law *out, struct modal_error *err);
/* inputs: d[0] normal, d[1] tangential; the normal force is max(0, preload + normal_stiffness d[0]). */
enum modal_status law_contact_friction(double normal_stiffness, double preload, double tangential_stiffness, double mu,
                                       struct law *out, struct modal_error *err);
enum modal_status law_lua(const char *source, struct law *out, struct modal_error *err);

#endif
