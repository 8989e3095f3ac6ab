/* readout.h - a program's outputs from the state of statespace.h */
#ifndef MODAL_READOUT_H
#define MODAL_READOUT_H
#include "modal/scene/statespace.h"

struct readout;

/* borrows ss */
enum modal_status readout_new(const struct statespace *ss, struct readout **out,
                              struct modal_error *err);
/* NULL is accepted. */
void readout_free(struct readout *r);

/*
 * The outputs at time t: Y y, with accelerations from y' = A(t) y + F, F (N numbers) what loads and
 * laws add, or NULL for none.  OUT holds p->outputs numbers.
 */
void readout_at(struct readout *r, double t, const double *y, const double *F, double *out);

#endif
