/* result_file.h - a steady state's, curve's or backbone's result as an HDF5 file
 *
 *     /points            n: the parameter (omega, or the curve's PATH; a backbone's amplitude), its
 *                        attribute `parameter` the name
 *     /omega             n, rad/s
 *     /converged         n: 0 or 1        /stable  n: 1, 0, or -1 where unknown or undecided
 *     /error             n: the estimate, in the unit of x; NaN where there is none
 *     /damping_ratio, /energy             n, of a backbone
 *     /re, /im           n x dofs x harmonics from 0: x(t) = Re sum_k (re + i im) e^{i k omega t};
 *                        0 past a point's own H
 *     /dofs              their names
 *     /t, /x             samples; dofs x samples: of one steady state with its waveform
 *
 * The root's attributes are `kind`, `provenance` and `plan` (JSON).
 */
#ifndef CTL_RESULT_FILE_H
#define CTL_RESULT_FILE_H
#include "base/error.h"
#include "base/json.h"

/* Whether DOC is of a kind written here. */
bool result_file_fits(const cJSON *doc);
/* Write it to PATH, in place of what is there.  Fails with MODAL_BAD_INPUT (field "output"). */
enum modal_status result_file_write(const char *path, const cJSON *doc, struct modal_error *err);
#endif
