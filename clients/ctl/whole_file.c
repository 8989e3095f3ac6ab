/* whole_file.c - see whole_file.h */
#include <errno.h>
#include <stdbool.h>
#include <string.h>
#include "whole_file.h"

enum modal_status whole_file_begin(struct whole_file *out, const char *path, const char *option,
                                   struct modal_error *err)
{
    out->path = path;
    out->option = option;
    errno = ENAMETOOLONG;
    if (snprintf(out->beside, sizeof out->beside, "%s.new", path) >= (int)sizeof out->beside
        || (out->file = fopen(out->beside, "we")) == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, option, "%s: %s", path, strerror(errno));
    return MODAL_OK;
}

enum modal_status whole_file_end(struct whole_file *out, struct modal_error *err)
{
    bool good = !ferror(out->file);

    if (fclose(out->file) == 0 && good && rename(out->beside, out->path) == 0)
        return MODAL_OK;
    modal_fail_field(err, MODAL_BAD_INPUT, out->option, "%s: %s", out->path, strerror(errno));
    remove(out->beside);
    return MODAL_BAD_INPUT;
}
