/* stuck.h - samples that a line dropped or held and a converter cut, told by their being equal */
#ifndef MODAL_STUCK_H
#define MODAL_STUCK_H
#include "base/error.h"
#include "modal/identify/prepare/wild.h"
#include "modal/linalg/matrix.h"

/*
 * The samples within the columns of Y (L x S, finite, as sent) that are exactly equal to others as
 * no motion is (stuck.c). In their place Y gets what those about them tell; it is as it was where
 * there are none. What is equal from the first row on, or to the last, is quiet, not stuck, unless
 * it is the column's extreme; and of a motion with a period of PERIOD rows, or less (0: none), what
 * it comes to in its last one.
 *
 * *out, the caller's to wild_done, has them by channels and rows, `sent` over what is in their
 * place now. Fails with MODAL_NO_MEMORY.
 */
enum modal_status stuck_mend(struct matrix *Y, int period, struct wild *out,
                             struct modal_error *err);
#endif
