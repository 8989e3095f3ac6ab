/* table_file.h - what -O writes into a .csv: a header, then numbers with all their digits */
#ifndef CTL_TABLE_FILE_H
#define CTL_TABLE_FILE_H
#include "modal/batch.h"
#include "base/error.h"
#include "base/json.h"

/*
 * Write DOC of kind steady, curve or backbone to PATH, or, where BATCH has samples, those:
 *
 *   signals          t [s], then a column a channel
 *   steady           the waveform where it was asked for (-o time=true): t, then a column a dof;
 *                    else the spectrum: k, then DOF_re and DOF_im of each dof
 *   curve, backbone  a row a point: what is varied, converged, stable (1, 0, empty: not known),
 *                    total_error, then DOF_re_K and DOF_im_K of each dof and harmonic
 *
 * What is null in DOC is an empty cell.  Fails with MODAL_BAD_INPUT, field "output": it cannot be
 * written; nothing is left then.
 */
enum modal_status table_file_write(const char *path, const cJSON *doc, const struct batch *batch,
                                   struct modal_error *err);
#endif
