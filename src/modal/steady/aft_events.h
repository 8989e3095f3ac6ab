/* aft_events.h - the forces of laws with pieces, exact for the motion given: sums over its
 * events */
#ifndef MODAL_AFT_EVENTS_H
#define MODAL_AFT_EVENTS_H
#include "modal/steady/aft_state.h"

/* Whether samples are ever taken back to harmonics: of a law that is sampled, or of products with
 * so many of them that this is the shorter way. */
bool aft_analyzes(const struct aft *w);
/* The slopes of law A that is sampled, along the motion of its last force, unless they are there.
 * Fails as the law does. */
enum modal_status aft_make_slopes(struct aft *w, struct aft_law *a, struct modal_error *err);
/* The pieces of law A along its motion a->in.  Fails with MODAL_NO_MEMORY or as the law does. */
enum modal_status aft_find_pieces(struct aft *w, struct aft_law *a, struct modal_error *err);
/* The pieces found as waves: a->level to m = H, gain and damp to 2 H, cross to 3 H. */
void aft_waves(struct aft *w, struct aft_law *a);
/* Harmonics 0 .. H of output I of the waves into F; WORK holds 2 H + 1 numbers. */
void aft_waves_force(struct aft *w, struct aft_law *a, int i, double complex *F,
                     double complex *work);
/* Of the derivative: cross adds its v to df/dd and its d to df/dv, in a->gain and a->damp; WORK as
 * above. */
void aft_cross_gains(struct aft *w, struct aft_law *a, double complex *work);

/* e^{-i theta}. */
double complex aft_rotation(double theta);
/* e[m] = z^m, m = 0 .. MOST, |z| = 1. */
void aft_rotations(double complex z, int most, double complex *e);
/* (1) of aft_events.c of a piece of LENGTH for m = 0 .. MOST into w->mask, of the rotations at its
 * ends, w->before and w->after. */
void aft_mask(struct aft *w, double length, int most);
#endif
