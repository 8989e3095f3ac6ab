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

/* A family of them: real numbers of its exponent, and what of a line of it the others cannot stand
 * in for (lines_seen.h); then the criterion without it, all other exponents as they are: of the
 * lines as they are, and the least, were all that may stand in for its own there for nothing. */
struct lines_family { int exponents; double share, alone, least; };

/* Without each of COUNT families of L in turn.  Fails as lines_choose(). */
enum modal_status lines_without(const struct refine_data *data, const struct lines *l, int count,
                                struct lines_family *each, struct modal_error *err);
#endif
