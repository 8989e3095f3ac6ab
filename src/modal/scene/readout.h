/* readout.h - a program's outputs from the state of statespace.h
 *
 * y = Yx x + Yv x' + Ya x'' + Yz z of program.h; terms of turning axes are brought to fixed ones.
 */
#ifndef MODAL_READOUT_H
#define MODAL_READOUT_H
#include "modal/scene/statespace.h"

struct readout;

/* For the outputs of ss->p.  SS is borrowed until readout_free.  Fails with MODAL_NO_MEMORY. */
enum modal_status readout_new(const struct statespace *ss, struct readout **out,
                              struct modal_error *err);
/* NULL is accepted. */
void readout_free(struct readout *r);

/*
 * The outputs at time t (s) from the state Y (N numbers), into OUT, p->outputs numbers.
 * Accelerations come from y' = A(t) y + F, F (N numbers) what loads and laws add (stepper.force),
 * or NULL for none.  Writes into R's own storage: one thread at a time.
 */
void readout_at(struct readout *r, double t, const double *y, const double *F, double *out);

#endif
