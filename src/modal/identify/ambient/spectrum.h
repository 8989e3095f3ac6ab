/* spectrum.h - the spectral matrix of a record: its Fourier coefficients, averaged over bins */
#ifndef MODAL_SPECTRUM_H
#define MODAL_SPECTRUM_H
#include <complex.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

/*
 * Line j, 0 <= j < lines, is at 2 pi (first + j) / samples rad a sample; its coefficients are
 * F[j * channels], scaled so that the mean of F F^H is the spectral matrix: white noise of unit
 * variance has 1 everywhere.  Below an END it is the spectrum of a record of fewer samples, further
 * apart, as long.
 */
struct spectrum {
    int channels, samples, first, lines;
    double complex *F;                    /* owned */
};

/* The lines of Y (samples x channels, borrowed) from FIRST on, 1 at least, strictly below the
 * Nyquist frequency, up to a quarter beyond END (cycles a sample; 0: all).  Fails with
 * MODAL_BAD_INPUT where there are too few, MODAL_NO_MEMORY. */
enum modal_status spectrum_make(const struct matrix *Y, int first, double end,
                                struct spectrum *out, struct modal_error *err);
void spectrum_done(struct spectrum *s);

/* Bin b is the mean of lines[b] lines from first[b] on (of the spectrum's); mean[b * channels^2] is
 * its Hermitian matrix by columns. */
struct bins {
    int count, channels, samples;
    int *first, *lines;
    double *from, *to;                    /* rad a sample: half a line beyond its own lines */
    double complex *mean;
    double *floor;                        /* on every channel: a share of their energy */
    double complex *seen;                 /* mean and floor; see whittle_correct() */
};

/*
 * Bins no wider than SHARE of the distance to the nearest of COUNT poles (exponents a
 * sample) and than one WIDEST-th of the spectrum, but of one line at least.
 */
enum modal_status bins_make(const struct spectrum *s, const double complex *poles, int count,
                            double share, int widest, struct bins *out, struct modal_error *err);
void bins_done(struct bins *b);
#endif
