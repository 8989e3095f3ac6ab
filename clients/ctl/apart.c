/* apart.c - see apart.h */
#include "apart.h"
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include "base/json.h"
#include "base/sanitized.h"

/* What the child may take before it has said what it reads, and on top of that: names, groups and
 * attributes, of which files of 10,000 datasets take 0.4 s and some 40 MB. */
static const double SECONDS_LEAST = 5;
static const double BYTES_LEAST = 256 << 20;

/* Packed numbers become 1 GiB in 4 s (gzip) to 30 s (n-bit, the slowest): a quarter of that. */
static const double BYTES_A_SECOND = 8 << 20;

/* Chunks of one row are checked and read in 4 to 10 us each, by what finds and packs them (gzip):
 * a quarter of the slowest. */
static const double PIECES_A_SECOND = 25000;

enum {
    CANNOT_TELL     = 1,      /* status of a child without memory for what it found */
    LIBRARY_MISSING = 127,    /* what lazy/lazy.S ends a process with, and has said why: it is no
                               * fault of the file */
};

/* Bytes of its own that this process holds, as RLIMIT_DATA counts them; -1: unknown. */
static double held(void)
{
    unsigned long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    bool told = file != NULL && fscanf(file, "%*u %*u %*u %*u %*u %lu", &pages) == 1;

    if (file != NULL)
        fclose(file);
    return told ? (double)pages * (double)sysconf(_SC_PAGESIZE) : -1;
}

/* What was allowed before, a hard limit, stays one. */
static void set_limit(int what, double value)
{
    struct rlimit limit;

    if (getrlimit(what, &limit) != 0)
        return;
    limit.rlim_cur = limit.rlim_max != RLIM_INFINITY && (double)limit.rlim_max < value
                         ? limit.rlim_max : (rlim_t)value;
    setrlimit(what, &limit);
}

void apart_allow(double bytes, double pieces)
{
    struct rusage used = { 0 };
    double holds = held();

    getrusage(RUSAGE_SELF, &used);
    set_limit(RLIMIT_CPU, (double)used.ru_utime.tv_sec + (double)used.ru_stime.tv_sec + 1
                              + SECONDS_LEAST + bytes / BYTES_A_SECOND
                              + pieces / PIECES_A_SECOND);
    if (!SANITIZED && holds >= 0)             /* whose shadow of all memory is counted */
        set_limit(RLIMIT_DATA, holds + BYTES_LEAST + bytes);
}

/* ---- texts ---- */

bool apart_tell_text(const char *text, FILE *to)
{
    size_t length = text != NULL ? strlen(text) : SIZE_MAX;

    return fwrite(&length, sizeof length, 1, to) == 1
           && (text == NULL || fwrite(text, 1, length, to) == length);
}

bool apart_hear_text(char **text, FILE *from)
{
    size_t length;

    *text = NULL;
    if (fread(&length, sizeof length, 1, from) != 1)
        return false;
    if (length == SIZE_MAX)
        return true;
    *text = calloc(length + 1, 1);
    return *text != NULL && fread(*text, 1, length, from) == length;
}

/* ---- the child ---- */

struct outcome { enum modal_status rc; struct modal_error err; };

/* Is SIGNAL the end of a program over what it does itself? */
static bool is_breakdown(int signal)
{
    return signal == SIGSEGV || signal == SIGBUS || signal == SIGFPE || signal == SIGABRT
           || signal == SIGILL;
}

/* What the parent catches is not for the child, which it would interrupt as it tells. */
static void catch_nothing(void)
{
    struct sigaction of;

    for (int i = 1; i < NSIG; i++)
        if (!is_breakdown(i) && sigaction(i, NULL, &of) == 0 && of.sa_handler != SIG_IGN)
            signal(i, SIG_DFL);
    signal(SIGXCPU, SIG_DFL);
}

static void *allocate_or_end(size_t size)
{
    void *block = malloc(size);

    if (block == NULL)
        _exit(CANNOT_TELL);
    return block;
}

/* Ends by _exit: what the parent has to print or to close is the parent's. */
static _Noreturn void be_child(const struct apart *how, void *context, pid_t parent, int fd)
{
    const struct rlimit none = { 0, 0 };
    struct outcome outcome = { .rc = MODAL_OK };
    FILE *to = fdopen(fd, "w");

    json_memory_by(allocate_or_end);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (to == NULL || getppid() != parent)
        _exit(CANNOT_TELL);
    setrlimit(RLIMIT_CORE, &none);
    catch_nothing();
    apart_allow(0, 0);
    outcome.rc = how->work(context, &outcome.err);
    _exit(fwrite(&outcome, sizeof outcome, 1, to) == 1
          && (outcome.rc != MODAL_OK || how->tell(context, to)) && fflush(to) == 0
          ? 0 : CANNOT_TELL);
}

/* ---- the parent ---- */

/* A signal that the parent catches is no end of what it hears. */
static ssize_t read_on(void *fd, char *to, size_t room)
{
    ssize_t got;

    do
        got = read(*(const int *)fd, to, room);
    while (got < 0 && errno == EINTR);
    return got;
}

/* Why a child that ended with STATUS has not told all. */
static enum modal_status fallen(int status, const char *path, const char *field,
                                struct modal_error *err)
{
    int by = WIFSIGNALED(status) ? WTERMSIG(status) : 0;

    if (WIFEXITED(status) && WEXITSTATUS(status) == LIBRARY_MISSING)
        exit(LIBRARY_MISSING);
    if (by == SIGXCPU)
        return modal_fail_field(err, MODAL_BAD_INPUT, field, "%s: reading it was ended at its "
                                "limit of processor time, %g s and one more for each %.3g MB and "
                                "each %g chunks that it says; a sound file is read faster as "
                                "`h5repack -l CONTI -f NONE` makes it", path, SECONDS_LEAST,
                                BYTES_A_SECOND / 1e6, PIECES_A_SECOND);
    if (by == SIGKILL)
        return modal_fail_field(err, MODAL_NO_MEMORY, field, "%s: who read it was killed, by the "
                                "system for want of memory or by hand", path);
    if (WIFEXITED(status) && WEXITSTATUS(status) == CANNOT_TELL)
        return modal_fail_field(err, MODAL_NO_MEMORY, field, "%s: no memory to tell what was read",
                                path);
    if (by != 0 && !is_breakdown(by))
        return modal_fail_field(err, MODAL_IO, field, "%s: who read it was ended: %s", path,
                                strsignal(by));
    return modal_fail_field(err, MODAL_BAD_INPUT, field, "%s: its library broke down over it%s%s: "
                            "it is damaged", path, by != 0 ? ": " : "", by != 0 ? strsignal(by)
                                                                                : "");
}

static enum modal_status be_parent(const struct apart *how, void *context, const char *path,
                                   const char *field, pid_t child, int fd, struct modal_error *err)
{
    struct outcome outcome = { .rc = MODAL_OK };
    FILE *from = fopencookie(&fd, "r", (cookie_io_functions_t){ .read = read_on });
    bool told = from != NULL && fread(&outcome, sizeof outcome, 1, from) == 1, lacks;
    int status = 0;

    if (told && outcome.rc == MODAL_OK)
        told = how->hear(context, from);
    lacks = from == NULL || (!told && !feof(from));       /* it tells more than we could hear */
    if (from != NULL)
        fclose(from);
    close(fd);
    while (waitpid(child, &status, 0) < 0 && errno == EINTR)
        continue;
    if (lacks)
        return modal_fail_field(err, MODAL_NO_MEMORY, field, "%s: no memory for what was read",
                                path);
    if (!told)
        return fallen(status, path, field, err);
    if (outcome.rc != MODAL_OK && err != NULL)
        *err = outcome.err;
    return outcome.rc;
}

enum modal_status apart_do(const struct apart *how, void *context, const char *path,
                           const char *field, struct modal_error *err)
{
    pid_t self = getpid(), child;
    int ends[2];

    if (pipe2(ends, O_CLOEXEC) != 0)
        return modal_fail(err, MODAL_IO, "%s: no pipe: %s", path, strerror(errno));
    child = fork();
    if (child == 0) {
        close(ends[0]);
        be_child(how, context, self, ends[1]);
    }
    close(ends[1]);
    if (child > 0)
        return be_parent(how, context, path, field, child, ends[0], err);
    close(ends[0]);
    return modal_fail(err, MODAL_IO, "%s: no process to read it: %s", path, strerror(errno));
}
