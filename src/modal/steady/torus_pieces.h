/* torus_pieces.h - a motion of tones marched exactly, where laws are lines between their events */
#ifndef MODAL_TORUS_PIECES_H
#define MODAL_TORUS_PIECES_H
#include "modal/steady/torus_state.h"

struct torus_pieces;

/*
 * A march of S's program from its initial state at t = 0, N samples a turn of the leading tone,
 * with what COLUMNS disturbances grow by.  *OUT is NULL where it does not serve: laws of more than
 * one input or place, or with damping; linear states; too many dofs, or too stiff for N samples.
 * Fails with MODAL_NO_MEMORY.  torus_pieces_free takes NULL.
 */
enum modal_status torus_pieces_new(struct torus_solver *s, int N, int columns,
                                   struct torus_pieces **out, struct modal_error *err);
void torus_pieces_free(struct torus_pieces *m);
/* What a turn costs, in budget.h's units; seen once one has gone by. */
double torus_pieces_work(const struct torus_pieces *m);
/*
 * TURNS more turns.  X NULL, or room for what DOFS, COUNT of them, do at each sample,
 * [sample][dof]; GROWTH NULL, or room for the logarithm of what each disturbance grows by a turn,
 * [turn][column].
 * *FOLLOWED false: it is not followed further, as too many regimes or events a step come, the work
 * ends, or the motion leaves the range of doubles.  Fails with MODAL_CANCELLED, or as a law does.
 */
enum modal_status torus_pieces_go(struct torus_pieces *m, int turns, int count, const int *dofs,
                                  double *x, double *growth, bool *followed,
                                  struct modal_error *err);
/* Turns that have gone by; how often each law was asked; whether law L has changed its regime since
 * the start, or since that was forgotten; whether until then, while it settled, sliders that rest
 * were not disturbed in their places: of more dofs than a balance of such a motion serves, which
 * would choose the places, and without a dense derivative of its least set finds none. */
long torus_pieces_turns(const struct torus_pieces *m);
long torus_pieces_asked(const struct torus_pieces *m);
bool torus_pieces_acted(const struct torus_pieces *m, int l);
bool torus_pieces_leaves(const struct torus_pieces *m);
void torus_pieces_forget(struct torus_pieces *m);
/* From now on without disturbances. */
void torus_pieces_alone(struct torus_pieces *m);
#endif
