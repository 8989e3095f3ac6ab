/* whole_file.h - a file that who looks at it sees whole: written beside its place, then moved
 * there */
#ifndef CTL_WHOLE_FILE_H
#define CTL_WHOLE_FILE_H
#include <stdio.h>
#include "base/error.h"

/* `file` writes to `beside`, which was not there before; `place` is what it will be in place of. */
struct whole_file { FILE *file; const char *option; char place[4096], beside[4096 + 32]; };

/* Can PATH (NULL: none) be written?  Asked before the work is done.  It is a file, a link to one,
 * or nothing yet in a folder that can be written: a device, FIFO or socket would be gone.  Else
 * MODAL_BAD_INPUT, field OPTION. */
enum modal_status whole_file_check(const char *path, const char *option, struct modal_error *err);

/* Begin to write PATH, which OPTION named (borrowed until the end), or what PATH links to; with the
 * mode of what is there.  Fails as whole_file_check. */
enum modal_status whole_file_begin(struct whole_file *out, const char *path, const char *option,
                                   struct modal_error *err);
/* Move what was written to its place; where that fails nothing is left, and the file that was there
 * stays. */
enum modal_status whole_file_end(struct whole_file *out, struct modal_error *err);
/* It could not be written: nothing is left. */
void whole_file_drop(struct whole_file *out);
#endif
