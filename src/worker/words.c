/* words.c - see words.h */
#include "worker/words.h"
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "base/sanitized.h"

enum {
    PART         = 4096,            /* bytes of one read: a page */
    STACK        = 16384,           /* of a handler, where the stack itself is what overflowed */
    STEP_NS      = 10000000,        /* between two looks whether they were sent: 10 ms */
    WAITS_MOST   = 100,             /* steps, a second, until the link's thread has sent them */
    WAITS_ON_WAY = 20,              /* and for libzmq's thread to hand them to the system */
};

static volatile sig_atomic_t dying, sent;

/* The process goes on to die of it: the handler stands once, and the signal comes again. */
static void on_fatal(int number)
{
    const struct timespec step = { .tv_nsec = STEP_NS };
    char said[] = "modald-worker: ended by signal 00\n";

    said[sizeof said - 4] = (char)('0' + number / 10);
    said[sizeof said - 3] = (char)('0' + number % 10);
    if (write(STDERR_FILENO, said, sizeof said - 1) > 0)
        dying = 1;
    for (int waits = 0; dying && !sent && waits < WAITS_MOST; waits++)
        nanosleep(&step, NULL);
    for (int waits = 0; sent && waits < WAITS_ON_WAY; waits++)
        nanosleep(&step, NULL);
    raise(number);
}

static void hear_signals(void)
{
    static const int fatal[] = { SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT };
    static char room[STACK];
    const stack_t stack = { .ss_sp = room, .ss_size = sizeof room };
    const struct sigaction action = { .sa_handler = on_fatal,
                                      .sa_flags = (int)(SA_RESETHAND | SA_ONSTACK) };

    sigaltstack(&stack, NULL);
    for (size_t i = 0; i < sizeof fatal / sizeof *fatal; i++)
        sigaction(fatal[i], &action, NULL);
}

void words_init(struct words *words)
{
    words->pipe = words->was = -1;
    words->fresh = false;
    words->length = 0;
}

enum modal_status words_open(struct words *words, struct modal_error *err)
{
    int ends[2];

    if (SANITIZED)
        return MODAL_OK;
    if (pipe2(ends, O_CLOEXEC) < 0)
        return modal_fail(err, MODAL_IO, "worker: a pipe for stderr: %s", strerror(errno));
    words->pipe = ends[0];
    words->was = fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
    if (words->was < 0 || fcntl(ends[0], F_SETFL, O_NONBLOCK) < 0
        || dup2(ends[1], STDERR_FILENO) < 0) {
        modal_fail(err, MODAL_IO, "worker: a pipe for stderr: %s", strerror(errno));
        close(ends[1]);
        words_close(words);
        return MODAL_IO;
    }
    close(ends[1]);
    hear_signals();
    return MODAL_OK;
}

static void keep(struct words *words, const char *said, size_t size)
{
    size_t over = words->length + size > sizeof words->text
                      ? words->length + size - sizeof words->text : 0;

    memmove(words->text, words->text + over, words->length - over);
    words->length -= over;
    memcpy(words->text + words->length, said, size);
    words->length += size;
    words->fresh = true;
}

void words_read(struct words *words)
{
    char said[PART];
    ssize_t size;

    /* what a pipe holds, so that one who never stops talking does not hold up the link */
    for (size_t all = 0; all < sizeof words->text; all += (size_t)size) {
        size = read(words->pipe, said, sizeof said);
        if (size <= 0)
            break;
        for (ssize_t at = 0, n; at < size; at += n)
            if ((n = write(words->was, said + at, (size_t)(size - at))) <= 0)
                break;              /* whoever read it is gone, or it is as long as it may be */
        keep(words, said, (size_t)size);
    }
}

bool words_last(void)
{
    return dying != 0;
}

void words_sent(struct words *words)
{
    words->fresh = false;
    sent = dying;
}

/* By the calls that are left once the walls are up. */
void words_close(struct words *words)
{
    if (words->pipe < 0)
        return;
    if (words->was >= 0) {
        words_read(words);
        close(STDERR_FILENO);
        fcntl(words->was, F_DUPFD_CLOEXEC, STDERR_FILENO);
        close(words->was);
    }
    close(words->pipe);
    words_init(words);
}
