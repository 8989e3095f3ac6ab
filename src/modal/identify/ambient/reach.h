/* reach.h - which bins of a spectrum tell of which mode */
#ifndef MODAL_REACH_H
#define MODAL_REACH_H
#include <stdbool.h>
#include "modal/identify/ambient/whittle.h"

/*
 * tells[mode + modes * bin], the caller's: the bins about each mode's turn that tell all but a
 * share LOSS of what is told of its exponent.  The modes of M are sorted by their
 * turn, those that more than half of the bins tell of last.  Fails with MODAL_NO_MEMORY.
 */
enum modal_status reach_find(struct whittle *m, const struct bins *bins, double loss, bool *tells,
                             struct modal_error *err);
#endif
