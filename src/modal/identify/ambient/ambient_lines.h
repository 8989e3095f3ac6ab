/* ambient_lines.h - lines of constant amplitude taken off a record: what turns, the mains */
#ifndef MODAL_AMBIENT_LINES_H
#define MODAL_AMBIENT_LINES_H
#include <complex.h>
#include "base/error.h"
#include "modal/linalg/matrix.h"

/* In one record: two sources with a dozen harmonics each. */
enum { AMBIENT_LINES_MOST = 24 };

/* One line: cycles a sample, and what it was of the columns' mean square; of each column z in
 * Re(z exp(2 pi i frequency k)), k from 0 on: owned. */
struct ambient_line { double frequency, share; double complex *z; };

/* z of COUNT lines is free; it may be NULL. */
void ambient_lines_done(struct ambient_line *line, int count);

/*
 * From the columns of Y, of zero mean and unit rms, the strongest first: lines that stand a hundred
 * times above what is about them and leave less than a hundredth of themselves when one sinusoid is
 * fitted to each column.  Of a mode more is left where it decays within ten records.  A column that
 * holds nothing else becomes zero.  Fails with MODAL_NO_MEMORY.
 */
enum modal_status ambient_lines_take(struct matrix *Y, struct ambient_line *out, int *count,
                                     struct modal_error *err);

/* One more, of FREQUENCY cycles a sample; fails with MODAL_NO_MEMORY.  One
 * back, that is done then. */
enum modal_status ambient_lines_take_at(struct matrix *Y, double frequency,
                                        struct ambient_line *out, struct modal_error *err);
void ambient_lines_put_back(struct matrix *Y, struct ambient_line *line);

/* Where lines were taken from Y: columns less the means that they had in them; zero where nothing
 * is left. */
void ambient_lines_settle(struct matrix *Y);
#endif
