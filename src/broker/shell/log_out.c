/*
 * log_out.c - see log_out.h
 *
 * Who reads the log may stop, be it a pager, a terminal held by ^S or a collector of logs that
 * hangs: a daemon that waited for him would answer nobody.  O_NONBLOCK belongs to an open file,
 * which stderr shares with whoever started us, so that a pipe or a terminal is opened once more,
 * for ourselves; a socket, as systemd's, takes the flag with each message instead; files do not
 * make wait.  Where a pipe cannot be opened (it belongs to another user) the flag is set on what is
 * shared, which is better than to stand still.
 */
#include "broker/shell/log_out.h"
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

enum {
    KEPT_MOST   = 1 << 16,   /* bytes of lines: as much as a pipe holds */
    LAST_MS     = 1000,      /* for who reads slowly, at the end */
};

static struct {
    char text[KEPT_MOST];
    size_t length;
    unsigned long dropped;
    bool refused;                /* the last that was written: its place is full, or nobody's */
} kept;

void log_out_begin(void)
{
    struct stat known;
    int fd = -1;

    for (int i = 0; i <= STDERR_FILENO; i++)
        if (fcntl(i, F_GETFD) < 0)
            fd = open("/dev/null", O_RDWR);          /* the lowest that is free: I */
    if (fstat(STDERR_FILENO, &known) != 0 || !(S_ISFIFO(known.st_mode) || S_ISCHR(known.st_mode)))
        return;
    fd = open("/proc/self/fd/2", O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    if (fd < 0)
        fcntl(STDERR_FILENO, F_SETFL, fcntl(STDERR_FILENO, F_GETFL) | O_NONBLOCK);
    else {
        dup2(fd, STDERR_FILENO);
        close(fd);
    }
}

static void keep(const char *text, size_t length)
{
    memcpy(kept.text + kept.length, text, length);
    kept.length += length;
}

void log_out_put(const char *stamp, const char *text)
{
    const size_t before = strlen(stamp), length = strlen(text);

    if ((kept.dropped > 0 && !kept.refused)
        || before + length + 1 > sizeof kept.text - kept.length) {
        kept.dropped++;
        return;
    }
    keep(stamp, before);
    keep(text, length);
    keep("\n", 1);
}

static ssize_t put(const char *text, size_t length)
{
    ssize_t put = send(STDERR_FILENO, text, length, MSG_DONTWAIT | MSG_NOSIGNAL);

    return put < 0 && errno == ENOTSOCK ? write(STDERR_FILENO, text, length) : put;
}

/* They cannot be written, as the next may be. */
static void drop_all(void)
{
    for (size_t i = 0; i < kept.length; i++)
        kept.dropped += kept.text[i] == '\n';
    kept.length = 0;
}

static void write_kept(void)
{
    size_t done = 0;
    ssize_t n = 0;

    if (kept.length == 0)
        return;
    while (done < kept.length && ((n = put(kept.text + done, kept.length - done)) > 0
                                  || (n < 0 && errno == EINTR)))
        done += n > 0 ? (size_t)n : 0;
    memmove(kept.text, kept.text + done, kept.length - done);
    kept.length -= done;
    kept.refused = kept.length > 0 && n < 0 && errno != EAGAIN;
    if (kept.refused)
        drop_all();
}

unsigned long log_out_flush(void)
{
    unsigned long dropped;

    write_kept();
    if (kept.length > 0 || kept.refused)
        return 0;
    dropped = kept.dropped;
    kept.dropped = 0;
    return dropped;
}

bool log_out_waits(void)
{
    return kept.length > 0;
}

void log_out_last(const char *text)
{
    put(text, strlen(text));
}

void log_out_end(void)
{
    struct pollfd reader = { .fd = STDERR_FILENO, .events = POLLOUT };

    log_out_flush();
    while (kept.length > 0 && poll(&reader, 1, LAST_MS) > 0 && kept.length > 0)
        log_out_flush();
}
