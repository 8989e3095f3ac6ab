/* output.h - what -O writes, in the format that the file's suffix names */
#ifndef CTL_OUTPUT_H
#define CTL_OUTPUT_H
#include "modal/batch.h"
#include "base/error.h"
#include "base/json.h"

/* PATH (NULL: none asked for) ends in .csv, in .h5 or .hdf5, or has no suffix and becomes HDF5;
 * else MODAL_BAD_INPUT, field "output". */
enum modal_status output_check(const char *path, struct modal_error *err);

/* Write BATCH where it has samples, else DOC, of a kind of result_file.h, to PATH: as table_file.h
 * or as batch_file.h and result_file.h have it.  Fails as output_check, and as they do. */
enum modal_status output_write(const char *path, const cJSON *doc, const struct batch *batch,
                               struct modal_error *err);
#endif
