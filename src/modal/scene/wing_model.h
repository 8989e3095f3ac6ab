/* wing_model.h - a wing that bends and twists, and its airloads at stations, as matrices
 *
 * w up, phi nose-up, y from the clamped root to the tip, x aft from the elastic axis: a point moves
 * by w - x phi.  One consistent system of units (SI, or ft, slug, s, lb).  Bending by cubic Hermite
 * elements, twist by cubic Lagrange elements with nodes at thirds; dofs w_1, w_1', w_2, ... w_E'
 * and then phi_1 .. phi_3E: n = 5 E, the root's absent.
 */
#ifndef MODAL_WING_MODEL_H
#define MODAL_WING_MODEL_H
#include "base/error.h"
#include "modal/scene/inflow/inflow.h"

enum {
    WING_ELEMENTS_MOST = 100,    /* of bending and torsion; error h^4 is then 1e-8 */
    WING_STATIONS_MOST = 64,     /* of a quadrature exact to degree 127 */
};

struct wing {
    double length, chord;  /* m */
    int elements;  /* of equal length */
    double EI, GJ, mass_per_length;  /* N m^2, N m^2, kg/m */
    double I_rho;          /* mass moment of inertia per length about the elastic axis */
    double x_cg;           /* aft positive */
};

/* n = 5 elements: two of bending and three of twist each. */
int wing_dofs(const struct wing *w);

/* One element's matrices, 8 x 8 by rows, over [w_1, w_1', w_2, w_2', phi at 0, h/3, 2h/3, h], and
 * the global dof of each (-1: at the clamped root) of element E = 0 .. elements - 1. */
void wing_element(const struct wing *w, double M[64], double K[64]);
/* -1: at the clamped root, where there is none. */
void wing_element_dofs(const struct wing *w, int element, int dof[8]);

/* Rows over the n dofs of the values at y in [0, length]: w, phi (either may be NULL;
 * overwritten). */
void wing_rows(const struct wing *w, double y, double *row_w, double *row_phi);

struct airloads {
    double speed, density, lift_slope;  /* U, rho, a0 of wing_model.c */
    double x_qc;           /* quarter chord, aft positive from the elastic axis */
    int stations;
    const struct inflow_kind *inflow;
    int inflow_states;     /* as the scene counts them */
};

/* Stations, and rows of what acts there per length: lift and moment are
 * row . (x, x', x'') + row . z, given for station s at [s * n], [s * nz]. */
struct airloads_matrices {
    int n, ns, nz;  /* dofs, stations, states */
    double *position, *weight;                 /* ns */
    double *lift[3], *moment[3];               /* ns x n by rows: on x, x', x'' */
    double *lift_z, *moment_z;                 /* ns x nz */
    /* n x n by rows: what the airloads add to the left-hand side */
    double *M, *C, *K;
    double *F;                                 /* n x nz: their force F z */
    double *Bx, *Bv, *Ba;                      /* nz x n: E z' = A z + Bx x + Bv x' + Ba x'' */
    struct inflow flow;                        /* its E and A */
};

/* Fails with MODAL_NO_MEMORY; airloads_done frees. */
enum modal_status airloads_new(const struct wing *w, const struct airloads *a,
                               struct airloads_matrices *out, struct modal_error *err);
/* M's arrays; M itself is the caller's and becomes zeros. */
void airloads_done(struct airloads_matrices *m);

#endif
