/* state.c - see state.h */
#include "state.h"
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>

static double now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void sleep_for(double seconds)
{
    struct timespec t = { (time_t)seconds, (long)(1e9 * (seconds - floor(seconds))) };

    nanosleep(&t, NULL);
}

/* A child of the host has a copy of each stream, but no thread to send, and of a ring in a file the
 * very same: there its streams do nothing.  Nor does one that is closed. */
enum { CLOSED = 0x7fffffff };
static atomic_uint forks;
static pthread_once_t fork_once = PTHREAD_ONCE_INIT;

static void count_fork(void)
{
    atomic_fetch_add_explicit(&forks, 1, memory_order_relaxed);
}

static void watch_forks(void)
{
    pthread_atfork(NULL, NULL, count_fork);
}

static inline bool is_dead(const modald_stream *s)
{
    return s->forks != atomic_load_explicit(&forks, memory_order_relaxed);
}

/* One line on stderr: no lock of stdio's is taken, and where nobody reads it the signal is not the
 * host's. */
static void warn(const char *name, const char *what)
{
    char text[1024];
    sigset_t pipe, before, pending;
    int n = snprintf(text, sizeof text, "modald: %s%s%s%.700s\n", name ? "stream " : "",
                     name ? name : "", name ? ": " : "", what);

    for (int i = 0; i < n - 1; i++)                     /* a server's words, too */
        text[i] = (unsigned char)text[i] < 0x20 || text[i] == 0x7f ? '?' : text[i];
    sigemptyset(&pipe);
    sigaddset(&pipe, SIGPIPE);
    sigpending(&pending);
    pthread_sigmask(SIG_BLOCK, &pipe, &before);
    if (write(2, text, (size_t)n) < 0 && errno == EPIPE && !sigismember(&pending, SIGPIPE))
        sigtimedwait(&pipe, NULL, &(struct timespec) { 0, 0 });
    pthread_sigmask(SIG_SETMASK, &before, NULL);
}

/* The same, once a stream. */
static void warn_once(modald_stream *s, const char *what)
{
    if (!s->warned)
        warn(s->name, what);
    s->warned = true;
}

static double *loan_new(size_t bytes)
{
    struct loan *loan = aligned_alloc(LINE, (sizeof *loan + bytes + LINE - 1) / LINE * LINE);

    if (loan == NULL)
        return NULL;
    atomic_init(&loan->holders, 1);
    return loan->data;
}

static struct loan *loan_of(double *data)
{
    return (struct loan *)((char *)data - offsetof(struct loan, data));
}

static void loan_drop(double *data)
{
    if (data != NULL
        && atomic_fetch_sub_explicit(&loan_of(data)->holders, 1, memory_order_acq_rel) == 1)
        free(loan_of(data));
}

static void give_back(void *data, void *hint)
{
    (void)hint;
    loan_drop(data);
}

/* Room of BYTES that may be written: *DATA, or in its place other room while a message of an old
 * connection still has that.  False: no memory. */
static bool loan_own(double **data, size_t bytes)
{
    double *other;

    if (atomic_load_explicit(&loan_of(*data)->holders, memory_order_acquire) == 1)
        return true;
    other = loan_new(bytes);
    if (other == NULL)
        return false;
    loan_drop(*data);
    *data = other;
    return true;
}

static size_t bytes_of(const modald_stream *s, uint64_t count)
{
    return count * (size_t)s->channels * sizeof(double);
}

static struct frame *frame_at(modald_stream *s, int i)
{
    return &s->window[(s->first_frame + i) % WINDOW];
}
