/* choose_lines.h - which of a periodic system's lines a record shows */
#ifndef MODAL_CHOOSE_LINES_H
#define MODAL_CHOOSE_LINES_H
#include <complex.h>
#include "base/error.h"
#include "modal/identify/fit/refine.h"

/* Lines of families: poles that have one multiplier. */
struct lines {
    int count;
    double complex *lambda;
    int *family;                /* per line */
};

/*
 * Of L, of DATA, those that pay for their amplitudes by the criterion, their exponents being there,
 * and the best of each family.  Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE (lines that
 * coincide); as refine_project() has it.
 */
enum modal_status lines_choose(const struct refine_data *data, struct lines *l,
                               struct modal_error *err);
#endif
