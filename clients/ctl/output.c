/* output.c - see output.h */
#include "output.h"
#include <stdbool.h>
#include <string.h>
#include <strings.h>
#include "result_file.h"
#include "store/batch_file.h"
#include "table_file.h"
#include "whole_file.h"

/* The last dot of a file's name and what follows it; NULL: no suffix. */
static const char *suffix_of(const char *path)
{
    const char *slash = strrchr(path, '/');

    return strrchr(slash != NULL ? slash : path, '.');
}

static bool is_csv(const char *path)
{
    const char *suffix = suffix_of(path);

    return suffix != NULL && strcasecmp(suffix, ".csv") == 0;
}

enum modal_status output_check(const char *path, struct modal_error *err)
{
    const char *suffix = path != NULL ? suffix_of(path) : NULL;

    if (suffix == NULL || is_csv(path))
        return MODAL_OK;
    if (strcasecmp(suffix, ".h5") == 0 || strcasecmp(suffix, ".hdf5") == 0)
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, "output", "%.300s: accepted: FILE.h5 or "
                            "FILE.hdf5 (HDF5), or FILE.csv", path);
}

/* HDF5 opens its files itself, by name. */
static enum modal_status write_hdf5(const char *path, const cJSON *doc, const struct batch *batch,
                                    struct modal_error *err)
{
    const cJSON *provenance = cJSON_GetObjectItemCaseSensitive(doc, "provenance");
    struct whole_file out;
    enum modal_status rc = whole_file_begin(&out, path, "output", err);

    if (rc != MODAL_OK)
        return rc;
    rc = batch->samples == 0 ? result_file_write(out.way, doc, err)
                             : batch_file_write(out.way, batch, provenance, err);
    if (rc == MODAL_OK)
        return whole_file_end(&out, err);
    whole_file_drop(&out);
    return rc;
}

enum modal_status output_write(const char *path, const cJSON *doc, const struct batch *batch,
                               struct modal_error *err)
{
    enum modal_status rc = output_check(path, err);

    if (rc != MODAL_OK)
        return rc;
    if (batch->samples == 0 && !result_file_fits(doc))
        return modal_fail_field(err, MODAL_BAD_INPUT, "output",
                                "this job gives no signals to write to %s", path);
    return is_csv(path) ? table_file_write(path, doc, batch, err)
                        : write_hdf5(path, doc, batch, err);
}
