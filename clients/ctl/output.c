/* output.c - see output.h */
#include "output.h"
#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>
#include "result_file.h"
#include "store/batch_file.h"
#include "table_file.h"

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

enum modal_status output_check_place(const char *path, const char *field, struct modal_error *err)
{
    const char *slash = path != NULL ? strrchr(path, '/') : NULL;
    char folder[4096] = ".";

    if (path == NULL)
        return MODAL_OK;
    if (slash != NULL)
        snprintf(folder, sizeof folder, "%.*s", slash == path ? 1 : (int)(slash - path), path);
    if (path[0] != 0 && access(folder, W_OK | X_OK) == 0)
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, field,
                            "%s: %s; accepted: a file in a folder that can be written", path,
                            strerror(path[0] != 0 ? errno : ENOENT));
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
    if (is_csv(path))
        return table_file_write(path, doc, batch, err);
    if (batch->samples == 0)
        return result_file_write(path, doc, err);
    return batch_file_write(path, batch, cJSON_GetObjectItemCaseSensitive(doc, "provenance"), err);
}
