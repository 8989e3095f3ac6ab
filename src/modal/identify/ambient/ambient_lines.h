/* ambient_lines.h - lines of constant amplitude taken off a record: what turns, the mains */
#ifndef MODAL_AMBIENT_LINES_H
#define MODAL_AMBIENT_LINES_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/* In one record: two sources with a dozen harmonics each. */
enum { AMBIENT_LINES_MOST = 24 };

/* One line: cycles a sample, and what it was of the columns' mean square. */
struct ambient_line { double frequency, share; };

/*
 * From the columns of Y, of zero mean and unit rms, the strongest first: lines that stand a hundred
 * times above what is about them and leave less than a hundredth of themselves when one sinusoid is
 * fitted to each column.  Of a mode more is left where it decays within ten records.  A column that
 * holds nothing else becomes zero.  Fails with MODAL_NO_MEMORY.
 */
enum modal_status ambient_lines_take(struct matrix *Y, struct ambient_line *out, int *count,
                                     struct modal_error *err);
#endif
