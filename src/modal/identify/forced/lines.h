/* lines.h - measured excitation and the responses to it, line by line of their Fourier transform */
#ifndef MODAL_LINES_H
#define MODAL_LINES_H
#include <complex.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

/*
 * Line n is the frequency z_n = exp(2 pi i k / samples) of a whole number k of turns in the record,
 * 0 < k < samples/2: without the mean, whatever it is.  Transforms are over sqrt(samples), so that
 * white noise of variance v has the variance v at each line, v/2 in either part.
 *
 * Drives are what poles filter: the inputs, of unit rms, and last z_n, the unknown initial state
 * (see (2) of lines.c).  Direct columns are what reaches a response without a pole, each of unit
 * norm.
 */
struct lines {
    int count, samples;
    int responses, drives, direct;
    double complex *z;           /* count */
    double complex *Y;           /* count x responses */
    double complex *W;           /* count x drives */
    double complex *X;           /* count x direct */
    double *energy;              /* responses: sum of |Y|^2 */
    double *size;                /* drives: what W was divided by */
    double *norm;                /* direct: what X was divided by */
};

/*
 * RESPONSES and INPUTS have a column a channel and the same rows; BAND, turns a sample, is where
 * the lines are (both 0: everywhere).  *OUT is empty on failure, lines_done frees it.  Fails with
 * MODAL_NO_MEMORY; MODAL_BAD_INPUT where fewer than LINES_LEAST are left.
 */
enum modal_status lines_make(const struct matrix *responses, const struct matrix *inputs,
                             const double band[2], struct lines *out, struct modal_error *err);
void lines_done(struct lines *l);

/* The direct columns at any z for a unit of INPUT alone, nothing at the record's ends: `direct`
 * numbers. */
void lines_direct(const struct lines *l, double complex z, int input, double complex *row);

enum {
    LINES_LEAST = 8,                        /* of a band */
    LINES_DRIVES_MOST = 17                  /* IDENTIFY_INPUTS_MOST, and the beginning */
};
#endif
