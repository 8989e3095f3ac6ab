/* whole_file.c - see whole_file.h */
#include "whole_file.h"
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

enum { NAME = 128 };         /* bytes of that of a file beside a place, with its end */
enum { LOOKED_AT = 10000 };  /* names of a folder: a few ms, though it has millions */

/* ---- what a signal ends ---- */

static const int ends[] = { SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGXCPU, SIGXFSZ };
enum { ENDS = sizeof ends / sizeof *ends };

static struct sigaction was[ENDS];             /* of each, while a file is being written */
static _Atomic(struct whole_file *) last;      /* that was begun and has not ended */

/* Who caught the signal before catches it still; else what is not whole goes, and we end by it. */
static void end_by(int number)
{
    int i = 0;

    while (ends[i] != number)
        i++;
    if (was[i].sa_handler != SIG_DFL) {
        void (*handler)(int) = was[i].sa_handler;
        if (was[i].sa_flags & SA_RESETHAND)
            was[i].sa_handler = SIG_DFL;
        handler(number);
        return;
    }
    for (struct whole_file *out = atomic_load(&last); out != NULL; out = out->next)
        unlink(out->beside);
    signal(number, SIG_DFL);
    raise(number);
}

/* From here until `restore` the thread hears none of them. */
static void hold(sigset_t *before)
{
    sigset_t held;

    sigemptyset(&held);
    for (int i = 0; i < ENDS; i++)
        sigaddset(&held, ends[i]);
    pthread_sigmask(SIG_BLOCK, &held, before);
}

/* What is ignored stays ignored. */
static void catch_ends(void)
{
    struct sigaction action = { .sa_handler = end_by, .sa_flags = SA_RESTART };

    sigemptyset(&action.sa_mask);
    for (int i = 0; i < ENDS; i++)
        if (sigaction(ends[i], NULL, &was[i]) == 0 && was[i].sa_handler != SIG_IGN)
            sigaction(ends[i], &action, NULL);
}

static void leave_ends(void)
{
    for (int i = 0; i < ENDS; i++)
        if (was[i].sa_handler != SIG_IGN)
            sigaction(ends[i], &was[i], NULL);
}

static void put_on(struct whole_file *out)
{
    if ((out->next = atomic_load(&last)) == NULL)
        catch_ends();
    atomic_store(&last, out);
}

static void take_off(struct whole_file *out)
{
    struct whole_file *other = atomic_load(&last);

    if (other == out)
        atomic_store(&last, out->next);
    while (other != out && other->next != out)
        other = other->next;
    other->next = out->next;
    if (atomic_load(&last) == NULL)
        leave_ends();
}

/* ---- where it is written ---- */

/* How many bytes of PLACE name its folder, with the slash; 0: the current one. */
static int folder_length(const char *place)
{
    const char *slash = strrchr(place, '/');

    return slash != NULL ? (int)(slash - place) + 1 : 0;
}

/* PLACE is what would be replaced: PATH, or what it leads to. */
static enum modal_status find_place(const char *path, const char *option,
                                    char place[WHOLE_FILE_PATH], struct modal_error *err)
{
    char folder[WHOLE_FILE_PATH + 2];
    char *real = realpath(path, NULL);
    int missing = real == NULL ? errno : 0, length;
    struct stat known = { 0 };

    length = snprintf(place, WHOLE_FILE_PATH, "%s", real != NULL ? real : path);
    free(real);
    if (missing == ENOENT && path[0] != 0 && lstat(path, &known) != 0)
        missing = 0;
    else if (missing == ENOENT && path[0] != 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, option, "%s is a link to nothing; accepted: "
                                "a file, or none yet", path);
    if (missing == 0 && length >= WHOLE_FILE_PATH)
        missing = ENAMETOOLONG;
    snprintf(folder, sizeof folder, "%.*s.", folder_length(place), place);
    if (missing == 0 && access(folder, W_OK | X_OK) != 0)
        missing = errno;
    if (missing != 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, option,
                                "%s: %s; accepted: a file in a folder that can be written", path,
                                strerror(missing));
    if (stat(place, &known) != 0 || S_ISREG(known.st_mode))
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, option, "%s is %s; accepted: a file, or none yet",
                            path, S_ISDIR(known.st_mode) ? "a folder"
                                                         : "a device, FIFO or socket");
}

enum modal_status whole_file_check(const char *path, const char *option, struct modal_error *err)
{
    char place[WHOLE_FILE_PATH];

    return path != NULL ? find_place(path, option, place, err) : MODAL_OK;
}

/* What the names of files begin with that we, or who shares our PIDs, write beside a place: the
 * life of the kernel and the name space of the PID that follows.  Is that known?  A lock would tell
 * as well who still writes, but meets HDF5's of the same file, on NFS whichever kind it is. */
static bool name_start(char start[NAME])
{
    FILE *file = fopen("/proc/sys/kernel/random/boot_id", "re");
    char life[37] = "";
    struct stat pids = { 0 };
    bool known = file != NULL && fscanf(file, "%36[0-9a-f-]", life) == 1
                 && stat("/proc/self/ns/pid", &pids) == 0;

    if (file != NULL)
        fclose(file);
    snprintf(start, NAME, ".modalctl-%s-%ju-", known ? life : "0", (uintmax_t)pids.st_ino);
    return known;
}

/* NUMBER is drawn: no other file ever had the name, so one that goes is the one that was seen. */
static void put_name(char name[NAME], const char *start, int pid, uint64_t number)
{
    snprintf(name, NAME, "%.90s%d-%016" PRIx64, start, pid, number);
}

/* NAME in FOLDER goes if a process whose names begin with START made it, and is no more. */
static void remove_left(int folder, const char *name, const char *start)
{
    char same[NAME];
    int pid = 0;
    uint64_t number;
    struct stat known;

    if (strncmp(name, start, strlen(start)) != 0
        || sscanf(name + strlen(start), "%9d-%16" SCNx64, &pid, &number) != 2 || pid <= 0)
        return;
    put_name(same, start, pid, number);
    if (strcmp(name, same) == 0 && fstatat(folder, name, &known, AT_SYMLINK_NOFOLLOW) == 0
        && S_ISREG(known.st_mode) && known.st_uid == geteuid()
        && kill(pid, 0) != 0 && errno == ESRCH)
        unlinkat(folder, name, 0);
}

/* What those who were killed left in the folder of PLACE, of the first folder that is written
 * to. */
static void remove_all_left(const char *place, const char *start)
{
    static atomic_bool done;
    char folder[WHOLE_FILE_PATH + 2];
    struct dirent *entry;
    DIR *all;

    snprintf(folder, sizeof folder, "%.*s.", folder_length(place), place);
    if (atomic_exchange(&done, true) || (all = opendir(folder)) == NULL)
        return;
    for (int i = 0; i < LOOKED_AT && (entry = readdir(all)) != NULL; i++)
        remove_left(dirfd(all), entry->d_name, start);
    closedir(all);
}

/* A file that was not there, with MODE; -1: none. */
static int open_new(struct whole_file *out, mode_t mode)
{
    char start[NAME], name[NAME];
    uint64_t number;

    if (name_start(start))
        remove_all_left(out->place, start);
    if (getrandom(&number, sizeof number, 0) != sizeof number)
        return -1;
    put_name(name, start, (int)getpid(), number);
    snprintf(out->beside, sizeof out->beside, "%.*s%s", folder_length(out->place), out->place,
             name);
    return open(out->beside, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
}

/* A file beside its place that was not there, in a name that is short whatever the place's is;
 * NULL, errno set: there can be none.  It is opened by name once more, so its owner can write to it
 * until the end, whatever its mode will be. */
static FILE *open_beside(struct whole_file *out)
{
    struct stat known;
    bool is_there = stat(out->place, &known) == 0, good;
    int fd, why;

    fd = open_new(out, is_there ? 0600 : 0666);
    if (fd < 0)
        return NULL;
    good = is_there || fstat(fd, &known) == 0;
    out->mode = known.st_mode & 0777;
    out->uid = is_there ? known.st_uid : (uid_t)-1;
    out->gid = is_there ? known.st_gid : (gid_t)-1;
    if (good && !is_there && (out->mode & 0600) != 0600)
        good = fchmod(fd, out->mode | 0600) == 0;
    snprintf(out->way, sizeof out->way, "/proc/self/fd/%d", fd);
    if (access(out->way, F_OK) != 0)
        memcpy(out->way, out->beside, sizeof out->way);
    if (good && (out->file = fdopen(fd, "w")) != NULL)
        return out->file;
    why = errno;
    close(fd);
    remove(out->beside);
    errno = why;
    return NULL;
}

enum modal_status whole_file_begin(struct whole_file *out, const char *path, const char *option,
                                   struct modal_error *err)
{
    sigset_t before;
    enum modal_status rc;

    out->file = NULL;
    out->option = option;
    if ((rc = find_place(path, option, out->place, err)) != MODAL_OK)
        return rc;
    hold(&before);
    if (open_beside(out) != NULL)
        put_on(out);
    else
        rc = modal_fail_field(err, MODAL_BAD_INPUT, option, "%s: %s", path, strerror(errno));
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return rc;
}

/* Owner, group and mode of what is replaced.  Where we cannot give it the group, ours has no rights
 * that the other had. */
static bool give_rights(const struct whole_file *out)
{
    int fd = fileno(out->file);
    mode_t mode = out->mode;
    struct stat now;

    if (fstat(fd, &now) != 0)
        return false;
    if (fchown(fd, out->uid, out->gid) != 0 && fchown(fd, (uid_t)-1, out->gid) != 0)
        mode &= ~(mode_t)0070;
    return (now.st_mode & 0777) == mode || fchmod(fd, mode) == 0;
}

/* It is no longer written; where it is not GOOD it goes. */
static void close_off(struct whole_file *out, bool good)
{
    sigset_t before;

    hold(&before);
    out->file = NULL;
    take_off(out);
    if (!good)
        remove(out->beside);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
}

enum modal_status whole_file_end(struct whole_file *out, struct modal_error *err)
{
    bool good = !ferror(out->file) && give_rights(out);

    good = fclose(out->file) == 0 && good && rename(out->beside, out->place) == 0;
    if (!good)
        modal_fail_field(err, MODAL_BAD_INPUT, out->option, "%s: %s", out->place, strerror(errno));
    close_off(out, good);
    return good ? MODAL_OK : MODAL_BAD_INPUT;
}

void whole_file_drop(struct whole_file *out)
{
    fclose(out->file);
    close_off(out, false);
}
