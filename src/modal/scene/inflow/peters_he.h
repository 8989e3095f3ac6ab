/* peters_he.h - the matrices of Peters and He's dynamic inflow, for a wing as two radii of a
 * disk in edgewise flow */
#ifndef MODAL_PETERS_HE_H
#define MODAL_PETERS_HE_H

enum {
    PETERS_HE_ORDER_MOST = 15,     /* rounding of phi is 1e-11 there, and grows */
    PETERS_HE_STATES_MOST = 72,    /* of that order: (16 + 1)^2 / 4, whole */
};

struct peters_he_index { int m, n; };

/* Cosine states of order N: all m = 0 .. N, n = m + 1, m + 3, .. with n - 1 <= N, in this order;
 * their count. */
int peters_he_states(int order, struct peters_he_index index[PETERS_HE_STATES_MOST]);
/* The order that has so many cosine states; -1: none. */
int peters_he_order(int states);

/* K of the apparent mass, diagonal: (4) of peters_he.c. */
double peters_he_K(struct peters_he_index i);
/* Edgewise flow, X = tan(chi/2) = 1. */
double peters_he_L(struct peters_he_index row, struct peters_he_index column);

#endif
