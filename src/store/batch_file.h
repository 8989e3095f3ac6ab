/* batch_file.h - a user's batch: an HDF5 file read into memory or mapped, and one written
 *
 * For clients only: the daemon opens no file it did not write.  The file's layout is that of the
 * contract: dataset `signals`, or another that is named, n_samples x n_channels (or n_samples: one
 * channel) of any number type, with attributes `dt` [s],
 * `period` [s], `units` and `channels` (names) on it or on the file's root; other attributes are
 * kept as provenance.
 */
#ifndef STORE_BATCH_FILE_H
#define STORE_BATCH_FILE_H
#include <stddef.h>
#include "modal/batch.h"
#include "base/error.h"
#include "base/json.h"
#include "store/mapping.h"

struct batch_file {
    struct batch batch;      /* points into what follows */
    double *signals;         /* NULL where they are mapped */
    struct mapping map;
    char **names;            /* NULL where the file names no channels */
    char *units;             /* or NULL */
    cJSON *attributes;       /* all others, an object: numbers, strings and lists of them */
};

/*
 * Read dataset SET of PATH; the caller ends *OUT with batch_file_done.  DT [s] holds where the file
 * says none; 0: the file must say it. MODAL_BAD_INPUT, with the dataset or attribute in err->field,
 * for what is not such a file: no HDF5 file, truncated, no dataset SET (field "signals"), its type
 * or rank wrong, `dt` missing or not one positive number, not one name for each channel, no such
 * file (field "file").  MODAL_TOO_LARGE, MODAL_NO_MEMORY.  The samples themselves are judged by the
 * job.
 */
enum modal_status batch_file_read(const char *path, const char *set, double dt,
                                  struct batch_file *out, struct modal_error *err);
/*
 * The same, but signals of more than 16 MB are not read: where they lie in the file in one piece,
 * as this machine's doubles, they are mapped, and batch.spare is set; of more than KEPT bytes they
 * are mapped in any case, and batch.release is set too.
 */
enum modal_status batch_file_map(const char *path, const char *set, double dt, uint64_t kept,
                                 struct batch_file *out, struct modal_error *err);
void batch_file_done(struct batch_file *file);

/* Write BATCH to PATH with ATTRIBUTES (an object, or NULL); where that fails, PATH is gone. */
enum modal_status batch_file_write(const char *path, const struct batch *batch,
                                   const cJSON *attributes, struct modal_error *err);

#endif
