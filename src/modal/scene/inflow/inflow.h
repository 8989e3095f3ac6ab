/* inflow.h - induced-flow models of airloads: linear states between the normalwash of stations and
 * their lift
 *
 * At ns stations of a straight wing with semichord b, span L, speed U and lift slope a0, the
 * normalwash v (m/s) gives the circulatory lift per length
 *
 *     Lc = a0 rho U b (direct v - Lambda z)                                                     (1)
 *     E z' = A z + P v + Q v'                                                                   (2)
 *
 * with nz states z.  Each model is one row: its name, the states it may have, and the function that
 * fills (1), (2). Nothing here knows rho: the models are linear in the lift over rho.
 */
#ifndef MODAL_INFLOW_H
#define MODAL_INFLOW_H
#include "base/error.h"

struct inflow_wing {              /* what a model may read */
    double length, semichord;     /* one unit of length, m or ft */
    double speed, lift_slope;
    int stations;  /* ns */
    const double *position;       /* from the root, ascending, in (0, length) */
    const double *weight;         /* of quadrature, summing to length */
};

struct inflow {
    int states;                   /* nz */
    double direct;  /* the share of v that lifts at once */
    double *E, *A;                /* nz x nz, row-major */
    double *P, *Q;                /* nz x ns, row-major */
    double *Lambda;               /* ns x nz, row-major */
};

struct inflow_kind {
    const char *name;  /* as the scene says it */
    int standard;                 /* `inflow_states` where the scene gives none */
    const char *accepted;         /* for messages: "1 .. 12 per station" */
    int (*valid)(int states);     /* may inflow_states be so many? */
    enum modal_status (*fill)(const struct inflow_wing *wing, int states, struct inflow *out,
                              struct modal_error *err);
};

extern const struct inflow_kind inflow_none, inflow_peters_2d, inflow_jones, inflow_peters_he;
extern const struct inflow_kind *const inflow_kinds[];    /* NULL-terminated */
/* theirs, in the same order, NULL-terminated */
extern const char *const inflow_names[];

/* Row KIND at WING into *OUT with `inflow_states` STATES (valid); inflow_done frees.  Fails with
 * MODAL_NO_MEMORY. */
enum modal_status inflow_new(const struct inflow_kind *kind, const struct inflow_wing *wing,
                             int states, struct inflow *out, struct modal_error *err);
/* F's matrices; F itself is the caller's and becomes zeros. */
void inflow_done(struct inflow *f);

/* For a `fill`: zeroed matrices for STATES states in all; inflow_done frees them also where the
 * fill fails later. */
enum modal_status inflow_allocate(const struct inflow_wing *wing, int states, struct inflow *out,
                                  struct modal_error *err);

#endif
