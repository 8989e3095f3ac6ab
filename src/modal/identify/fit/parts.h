/* parts.h - do the parts of a record say the same exponents as the whole? */
#ifndef MODAL_PARTS_H
#define MODAL_PARTS_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/identify/fit/refine.h"

/* A half tells of poles with so many samples to spare; beyond so many deviations, and this, it is
 * contradicted; its growth is clear beyond REFINE_CLEAR errors. */
#define PARTS_SPARE 8
#define PARTS_DEVIATIONS 6.0
#define PARTS_SLACK 12.0

/* What the halves say about one pole of the whole. */
struct part_say {
    double re, im;      /* by how much a half contradicts it, 1/s; 0 where none does */
    bool grows;         /* a half alone shows that Re > 0, by three of its own standard errors */
    bool steady;        /* both show so, and so clearly that a rate would be told which falls by
                         * three from one to the other, as that of a power of time does */
    double decay;       /* -Re over its own standard error, the least of the halves'; -HUGE_VAL
                         * where a half cannot say */
};

/*
 * The COUNT poles of a fit to the whole of DATA are fitted again to either half alone.
 *
 *   say       COUNT, or all zero where the record is too short to be halved
 *   strength  of the contradiction: what poles of its own win a half, in units of what noise lets
 *             them win; <= 1: none anywhere; < 0: too short
 *
 * Poles at zero stay there.  Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE.
 */
enum modal_status parts_ask(const struct refine_data *data, const double complex *lambda, int count,
                            struct part_say *say, double *strength, struct modal_error *err);
#endif
