/* state.c - see state.h */
#include "state.h"
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
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

static pthread_mutex_t process_lock = PTHREAD_MUTEX_INITIALIZER;

static void count_fork(void)
{
    static const pthread_mutex_t unlocked = PTHREAD_MUTEX_INITIALIZER;

    atomic_fetch_add_explicit(&forks, 1, memory_order_relaxed);
    process_lock = unlocked;
    links = NULL;
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
    if (!s->warned && !(s->link != NULL && s->link->warned))
        warn(s->name, what);
    s->warned = true;
}

static bool loans_new(modald_stream *s, size_t size)
{
    size_t stride = (sizeof(struct loan) + size + PAGE - 1) / PAGE * PAGE,
           bytes = PAGE + LOANS * stride;
    struct loans *loans = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS,
                               -1, 0);

    if (loans == MAP_FAILED)
        return false;
    atomic_init(&loans->holders, 1);
    loans->bytes = bytes;
    loans->stride = stride;
    s->loans = loans;
    for (int i = 0; i < LOANS; i++)
        s->spare[i] = ((struct loan *)((char *)loans + PAGE + (size_t)i * stride))->data;
    s->spares = s->spares_least = LOANS;
    return true;
}

static struct loan *loan_of(double *data)
{
    return (struct loan *)((char *)data - offsetof(struct loan, data));
}

static double *loan_take(modald_stream *s)
{
    for (int i = s->spares - 1; i >= 0; i--) {
        double *data = s->spare[i];
        if (atomic_load_explicit(&loan_of(data)->holders, memory_order_acquire) > 0)
            continue;
        memmove(s->spare + i, s->spare + i + 1, (size_t)(--s->spares - i) * sizeof *s->spare);
        s->spares_least = s->spares < s->spares_least ? s->spares : s->spares_least;
        return data;
    }
    return NULL;
}

static void loan_put(modald_stream *s, double *data)
{
    if (data != NULL)
        s->spare[s->spares++] = data;
}

static void loans_drop(struct loans *loans)
{
    if (loans != NULL && atomic_fetch_sub(&loans->holders, 1) == 1)
        munmap(loans, loans->bytes);
}

static void give_back(void *data, void *hint)
{
    atomic_fetch_sub_explicit(&loan_of(data)->holders, 1, memory_order_release);
    loans_drop(hint);
}

static size_t bytes_of(const modald_stream *s, uint64_t count)
{
    return count * (size_t)s->channels * sizeof(double);
}

static struct frame *frame_at(modald_stream *s, int i)
{
    return &s->window[(s->first_frame + i) % WINDOW];
}
