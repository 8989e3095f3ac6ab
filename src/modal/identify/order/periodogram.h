/* periodogram.h - ordinates of long columns, each transformed where it lies */
#ifndef MODAL_PERIODOGRAM_H
#define MODAL_PERIODOGRAM_H
#include "base/error.h"

/* Of columns of LENGTH real numbers; its tables grow with the root of that. */
struct periodogram;

/*
 * ROWS or more: a length that its factors suit, of which an ordinate is every 2 pi / length. Fails
 * with MODAL_NO_MEMORY; the caller frees *out with periodogram_free. X, of so many numbers, is what
 * columns will lie in, and is kept.
 */
enum modal_status periodogram_new(int rows, double *x, struct periodogram **out,
                                  struct modal_error *err);
void periodogram_free(struct periodogram *p);
int periodogram_length(int rows);
/* How many ordinates: 0 to pi. */
int periodogram_count(const struct periodogram *p);

/* Add SCALE times the squared magnitudes of the transform of x, which is destroyed, to POWER; those
 * at 0 and pi, which are one number, count half. In no order: */
void periodogram_add(struct periodogram *p, double scale, float *power);
/* the angle of POWER's number I, radians a row. */
double periodogram_angle(const struct periodogram *p, int i);
#endif
