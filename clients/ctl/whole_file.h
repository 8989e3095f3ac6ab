/* whole_file.h - a text file that who looks at it sees whole: written beside its place, then moved
 * there */
#ifndef CTL_WHOLE_FILE_H
#define CTL_WHOLE_FILE_H
#include <stdio.h>
#include "base/error.h"

struct whole_file { FILE *file; const char *path, *option; char beside[4096]; };

/* Begin to write PATH (borrowed until the end), which OPTION named.  Fails with MODAL_BAD_INPUT,
 * field OPTION. */
enum modal_status whole_file_begin(struct whole_file *out, const char *path, const char *option,
                                   struct modal_error *err);
/* Move what was written to its place; where that fails nothing is left, and the file that was there
 * stays. */
enum modal_status whole_file_end(struct whole_file *out, struct modal_error *err);
#endif
