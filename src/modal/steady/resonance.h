/* resonance.h - the proof that no periodic motion exists: an undamped resonance no law holds */
#ifndef MODAL_STEADY_RESONANCE_H
#define MODAL_STEADY_RESONANCE_H
#include <stdbool.h>

struct program;

/* Dofs up to which the proof is sought: O(dofs^3) a harmonic of the loads, where none was found. */
enum { RESONANCE_DOFS_MOST = 64 };

/*
 * True, with *HARMONIC, where it is certain that P under its loads has no motion of period
 * 2 pi / OMEGA.  False says nothing.
 */
bool resonance_unheld(const struct program *p, double omega, int *harmonic);

#endif
