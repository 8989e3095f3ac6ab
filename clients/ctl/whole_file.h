/* whole_file.h - a file that who looks at it sees whole: written beside its place, then moved
 * there */
#ifndef CTL_WHOLE_FILE_H
#define CTL_WHOLE_FILE_H
#include <stdio.h>
#include <sys/types.h>
#include "base/error.h"

enum { WHOLE_FILE_PATH = 4096 };   /* bytes of a path, with its end: Linux's PATH_MAX */

/* `file` writes to `beside`, which was not there before; `place` is what it will be in place of.
 * NULL once it was moved or dropped.  Who opens what is written by a name opens `way`: whoever may
 * write to the folder can put a link to another file where `beside` was. */
struct whole_file {
    FILE *file;
    const char *option;
    char place[WHOLE_FILE_PATH], beside[WHOLE_FILE_PATH + 128], way[WHOLE_FILE_PATH + 128];
    mode_t mode;                   /* that it ends with */
    uid_t uid; gid_t gid;          /* of what it replaces; -1: nothing yet */
    struct whole_file *next;       /* begun before this one */
};

/* Can PATH (NULL: none) be written?  Asked before the work is done.  It is a file, a link to one,
 * or nothing yet, in a folder that can be written, which of a link is where it leads: a device,
 * FIFO or socket would be gone.  Else MODAL_BAD_INPUT, field OPTION. */
enum modal_status whole_file_check(const char *path, const char *option, struct modal_error *err);

/* Begin to write PATH, which OPTION named (borrowed until the end), or what PATH links to; with the
 * mode of what is there, and its owner and group where we may.  A signal that ends the program
 * before the end leaves nothing: *OUT stays where it is until then; what SIGKILL left in that
 * folder goes when its user writes there again, on that machine before it is started anew.  Fails
 * as whole_file_check. */
enum modal_status whole_file_begin(struct whole_file *out, const char *path, const char *option,
                                   struct modal_error *err);
/* Move what was written to its place; where that fails nothing is left, and the file that was there
 * stays. */
enum modal_status whole_file_end(struct whole_file *out, struct modal_error *err);
/* It could not be written: nothing is left. */
void whole_file_drop(struct whole_file *out);
#endif
