/* turns.h - samples at even steps of an angle, where turns hold no whole number of samples */
#ifndef MODAL_TURNS_H
#define MODAL_TURNS_H
#include <stddef.h>
#include "modal/identify/prepare/record.h"

/*
 * turn[k]: what the angle x[k * stride], k < rows, has turned by then, from 0 on and never back.
 * It begins anew each turn: of 360 (degrees), 2 pi or 1, the least that holds all of it.  Fails
 * with MODAL_BAD_INPUT, field "azimuth", where it leaves that, does not turn, or turns back.
 */
enum modal_status turns_read(const double *x, size_t stride, int rows, double *turn,
                             struct modal_error *err);

/* How many rows a turn has, of TURN's ROWS rows. */
double turns_rows_each(const double *turn, int rows);

enum { TURNS_POINTS = 8 };      /* of a polynomial between rows, at most */

/*
 * The columns of Y at the angles i / phases, i = 0, 1, .., of the turns that their rows are at:
 * polynomials through the POINTS rows about each, TURNS_POINTS at most.  Fails with
 * MODAL_NO_MEMORY.
 */
enum modal_status turns_resample(struct matrix *Y, const double *turn, int phases, int points,
                                 struct modal_error *err);

/* longer[i], i < turns: by what share of the mean turn the i-th of TURN's ROWS is longer than that;
 * of one that the rows do not hold whole 0. */
void turns_lengths(const double *turn, int rows, int turns, double *longer);

/*
 * R's rows at even angles, a whole number a turn, and its period and step as they are in the mean:
 * of channel *AZIMUTH of B, which R was cut from, or, NULL, of its period.  *longer, the caller's,
 * of an azimuth: turns_lengths() of the turns that R then has whole.  Fails with MODAL_NO_MEMORY
 * and as turns_read() does.
 */
enum modal_status turns_even(struct record *r, const struct batch *b, const int *azimuth,
                             double **longer, struct modal_error *err);

/* R's rows at even angles of TURN, of each row of it, and its period and step as they are in the
 * mean.  Fails with MODAL_NO_MEMORY. */
enum modal_status turns_even_out(struct record *r, const double *turn, struct modal_error *err);

/* *cut without its azimuth among the channels, and without a period; nothing where it has none.
 * The caller frees *LIST, which holds them.  Fails with MODAL_NO_MEMORY, MODAL_BAD_INPUT where no
 * channel is left. */
enum modal_status turns_leave_azimuth(const struct batch *b, struct identify_options *cut,
                                      int **list, struct modal_error *err);
#endif
