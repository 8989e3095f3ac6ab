/* long_rest.h - what a fit leaves of a very long record, all that is asked of it in one reading */
#ifndef MODAL_LONG_REST_H
#define MODAL_LONG_REST_H
#include "modal/identify/fit/colour.h"
#include "modal/identify/fit/refine.h"

/* Of Y - Phi C, columns over their noise, as remainder_of makes it. */
struct long_rest {
    bool known;                  /* false: the poles coincide, and the rest means nothing */
    double chi2;                 /* as remainder_peak, but of parts with SEEN rows or more twice */
    double angle;                /* radians a row: where, in the first ROWS of the record */
    int rows;
    struct colour_spread spread; /* of its columns, about the poles */
    struct colour_sum colour;
    double *beside;              /* per pole: as remainder_split; 0 for what is no pair */
};

/*
 * DATA has blocks, and FIT has been made of it; the first SEEN rows have been searched before.
 * *out is the caller's, to long_rest_done. Fails with MODAL_NO_MEMORY, and as refine_project does.
 */
enum modal_status long_rest_look(const struct refine_data *data, const struct refined *fit,
                                 int seen, struct long_rest *out, struct modal_error *err);

/*
 * Poles about the angle of REST, which is what FIT leaves of DATA: at most MOST into LAMBDA, a
 * start for a fit. *count is 0 where there are none. Fails as long_rest_look.
 */
enum modal_status long_rest_poles(const struct refine_data *data, const struct refined *fit,
                                  const struct long_rest *rest, int most, double complex *lambda,
                                  int *count, struct modal_error *err);
void long_rest_done(struct long_rest *r);
#endif
