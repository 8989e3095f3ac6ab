/* whole_file.c - see whole_file.h */
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "whole_file.h"

enum { NAMES = 100 };        /* tried beside one place: leavings of lives of the same PID */

enum modal_status whole_file_check(const char *path, const char *option, struct modal_error *err)
{
    const char *slash = path != NULL ? strrchr(path, '/') : NULL;
    char folder[4096] = ".";
    struct stat known;

    if (path == NULL)
        return MODAL_OK;
    if (slash != NULL)
        snprintf(folder, sizeof folder, "%.*s", slash == path ? 1 : (int)(slash - path), path);
    if (path[0] == 0 || access(folder, W_OK | X_OK) != 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, option,
                                "%s: %s; accepted: a file in a folder that can be written", path,
                                strerror(path[0] != 0 ? errno : ENOENT));
    if (stat(path, &known) == 0 ? S_ISREG(known.st_mode) : lstat(path, &known) != 0)
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, option, "%s is %s; accepted: a file, or none yet",
                            path, S_ISLNK(known.st_mode)   ? "a link to nothing"
                                  : S_ISDIR(known.st_mode) ? "a folder"
                                                           : "a device, FIFO or socket");
}

/* A file beside its place that was not there; NULL, errno set: there can be none. */
static FILE *open_beside(struct whole_file *out)
{
    struct stat known;
    bool is_there = stat(out->place, &known) == 0;
    int fd = -1;

    errno = EEXIST;
    for (int i = 0; fd < 0 && errno == EEXIST && i < NAMES; i++) {
        snprintf(out->beside, sizeof out->beside, "%s.%d-%d.new", out->place, (int)getpid(), i);
        fd = open(out->beside, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, is_there ? 0600 : 0666);
    }
    if (fd >= 0 && is_there && fchmod(fd, known.st_mode & 0777) != 0) {
        close(fd);
        remove(out->beside);
        return NULL;
    }
    return fd >= 0 ? fdopen(fd, "w") : NULL;
}

enum modal_status whole_file_begin(struct whole_file *out, const char *path, const char *option,
                                   struct modal_error *err)
{
    enum modal_status rc = whole_file_check(path, option, err);
    char *real = rc == MODAL_OK ? realpath(path, NULL) : NULL;
    int length;

    if (rc != MODAL_OK)
        return rc;
    out->option = option;
    length = snprintf(out->place, sizeof out->place, "%s", real != NULL ? real : path);
    free(real);
    errno = ENAMETOOLONG;
    if (length >= (int)sizeof out->place || (out->file = open_beside(out)) == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, option, "%s: %s", path, strerror(errno));
    return MODAL_OK;
}

enum modal_status whole_file_end(struct whole_file *out, struct modal_error *err)
{
    bool good = !ferror(out->file);

    if (fclose(out->file) == 0 && good && rename(out->beside, out->place) == 0)
        return MODAL_OK;
    modal_fail_field(err, MODAL_BAD_INPUT, out->option, "%s: %s", out->place, strerror(errno));
    remove(out->beside);
    return MODAL_BAD_INPUT;
}

void whole_file_drop(struct whole_file *out)
{
    fclose(out->file);
    remove(out->beside);
}
