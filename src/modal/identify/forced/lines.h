/* lines.h - measured excitation and the responses to it, line by line of their Fourier transform */
#ifndef MODAL_LINES_H
#define MODAL_LINES_H
#include <complex.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

/* Where records that lie one after another in the same rows begin: row[0] = 0, below the next. */
struct lines_records { const int *row; int count; };

/*
 * Line n is the frequency z_n = exp(2 pi i k / samples) of a whole number k of turns in the record,
 * 0 < k < samples/2: without the mean, whatever it is.  Transforms are over sqrt(samples), so that
 * white noise of variance v has the variance v at each line, v/2 in either part.
 *
 * Drives are what poles filter: the inputs, of unit rms, and last the unknown state where each
 * record begins (see (3) of lines.c).  Direct columns are what reaches a response without a pole,
 * each of unit norm.
 */
struct lines {
    int count, samples;
    int responses, inputs, records;
    int drives, direct;          /* drives: inputs + records */
    int bands;                   /* of lines_band_end */
    double complex *z;           /* count */
    double complex *Y;           /* count x responses */
    double complex *W;           /* count x drives */
    double complex *X;           /* count x direct */
    double *energy;              /* responses: sum of |Y|^2 */
    double *size;                /* drives: what W was divided by */
    double *norm;                /* direct: what X was divided by */
};

/*
 * RESPONSES and INPUTS have a column a channel and the same rows, those of RECORDS; BAND, turns a
 * sample, is where the lines are (both 0: everywhere).  *OUT is empty on failure, lines_done frees
 * it.  Fails with MODAL_NO_MEMORY; MODAL_BAD_INPUT where fewer than LINES_LEAST are left.
 */
enum modal_status lines_make(const struct matrix *responses, const struct matrix *inputs,
                             const struct lines_records *records, const double band[2],
                             struct lines *out, struct modal_error *err);
void lines_done(struct lines *l);

/* Noise that is coloured has a level of its own in each band of lines: where that which begins at
 * line FIRST ends, the first of the next. */
int lines_band_end(const struct lines *l, int first);

/* The lines from FIRST on of what is X in COUNT samples from ROW on and zero in all others. */
void lines_pulse(const struct lines *l, const double *x, int count, int row, int first, int rows,
                 double complex *out);

/* The direct columns at any z for a unit of INPUT alone, nothing at the record's ends: `direct`
 * numbers. */
void lines_direct(const struct lines *l, double complex z, int input, double complex *row);

enum {
    LINES_LEAST = 8,                        /* of a band */
    LINES_DRIVES_MOST = 48                  /* IDENTIFY_INPUTS_MOST + IDENTIFY_RECORDS_MOST */
};
#endif
