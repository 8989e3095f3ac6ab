/* beam.h - the mesh that the structure `beam` leaves for its effects */
#ifndef MODAL_SCENE_BEAM_H
#define MODAL_SCENE_BEAM_H

/* (l / h)^4 is 1.6e13 there: of rounding two digits are left */
enum { BEAM_ELEMENTS_MOST = 2000 };

struct beam_mesh {
    int elements;  /* of length h */
    double h;                                   /* m, of one element */
    /* w and th of node i at 2 i, 2 i + 1; -1: held by a support */
    int dof[2 * (BEAM_ELEMENTS_MOST + 1)];
};

#endif
