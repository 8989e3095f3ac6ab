/* ring.c - see ring.h */
#include "ring.h"
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#ifndef MADV_POPULATE_WRITE
#define MADV_POPULATE_WRITE 23      /* of Linux 5.14; one of before says no, and nothing is lost */
#endif

/* s a piece: to give it back and have another ready takes the sender 0.05 ms, here at most a
 * hundredth of its time.  So a stream of up to 25 MB/s has what it uses, a faster one its ring. */
static const double piece_slow = 0.005;

/* Room for one slot, or NULL: full, the sample is counted as a gap; or not ours. */
static inline double *next_slot(modald_stream *s)
{
    if (is_dead(s))
        return NULL;
    if (s->head - s->tail_seen >= s->slots) {
        s->tail_seen = atomic_load_explicit(&s->page->tail, memory_order_acquire);
        if (s->head - s->tail_seen >= s->slots) {
            atomic_fetch_add_explicit(&s->dropped, 1, memory_order_relaxed);
            s->index++;
            return NULL;
        }
    }
    return s->ring + s->cursor * s->stride;
}

static inline void publish(modald_stream *s, double *at, double t)
{
    uint64_t index = s->index++;

    memcpy(at, &index, sizeof index);
    at[1] = t;
    s->cursor = s->cursor + 1 < s->slots ? s->cursor + 1 : 0;
    atomic_store_explicit(&s->page->head, ++s->head, memory_order_release);
    size_t length = s->stride * sizeof *at < AHEAD_MOST ? s->stride * sizeof *at : AHEAD_MOST;
    for (size_t i = 0; i < length; i += LINE)           /* beyond the ring's end it is harmless */
        __builtin_prefetch((const char *)at + AHEAD + i, 1);
}

/* Few values one by one: each comes straight from the host's own store, made a moment ago.  A wider
 * load over several of those has to wait until they are in the cache, and whatever the host
 * computed them from before that: 100 ns of a step of 1 us.  (Volatile, so that no compiler makes a
 * memcpy of it.) */
static inline void copy_sample(double *to, const double *y, int channels)
{
    if (channels > NARROW_MOST) {
        memcpy(to, y, (size_t)channels * sizeof *y);
        return;
    }
    for (int i = 0; i < channels; i++)
        *(volatile double *)(to + i) = y[i];
}

void modald_push(modald_stream *s, const double *y)
{
    double *at;

    if (s == NULL || (at = next_slot(s)) == NULL)
        return;
    copy_sample(at + 2, y, s->channels);
    publish(s, at, NAN);
}

void modald_push_block(modald_stream *s, const double *y, size_t count)
{
    for (; s != NULL && count > 0; count--, y += s->channels)
        modald_push(s, y);
}

void modald_push_float(modald_stream *s, const float *y)
{
    double *at;

    if (s == NULL || (at = next_slot(s)) == NULL)
        return;
    for (int i = 0; i < s->channels; i++)
        *(volatile double *)(at + 2 + i) = y[i];
    publish(s, at, NAN);
}

void modald_push_at(modald_stream *s, double t, const double *y)
{
    double *at;

    if (s == NULL || !isfinite(t) || (at = next_slot(s)) == NULL)
        return;
    copy_sample(at + 2, y, s->channels);
    publish(s, at, t);
}

void modald_seek(modald_stream *s, double index)
{
    if (s != NULL && !is_dead(s) && index >= 0 && index < integer_most)
        s->index = (uint64_t)index;
}

/* Whole pages of the ring that the slots from FROM to TO fill alone, to WHAT of madvise(2); they go
 * round the ring's end once at most. */
static void advise(const modald_stream *s, uint64_t from, uint64_t to, const int *what, int count)
{
    size_t slot = s->stride * sizeof(double), begin = from % s->slots * slot,
           length = (size_t)(to - from) * slot, end = s->slots * slot;

    for (size_t part; length > 0; length -= part, begin = 0) {
        part = begin + length > end ? end - begin : length;
        uintptr_t first = ((uintptr_t)s->ring + begin + PAGE - 1) / PAGE * PAGE,
                  last = ((uintptr_t)s->ring + begin + part) / PAGE * PAGE;
        for (int i = 0; i < count && first < last; i++)
            madvise((char *)s->page + (first - (uintptr_t)s->page), last - first, what[i]);
    }
}

/* Does a ring outlive its host?  Then it holds all that the daemon has not. */
static bool outlives_host(const modald_stream *s)
{
    return s->ring_fd >= 0;
}

/* Slots before TAIL are the host's once there is a piece of them, which a slow stream gives back to
 * the system before. */
static void give_slots(modald_stream *s, uint64_t tail)
{
    static const int back[] = { MADV_DONTNEED, MADV_HUGEPAGE };
    uint64_t was = atomic_load_explicit(&s->page->tail, memory_order_relaxed);

    if (tail - was < s->piece)
        return;
    if (s->piece > 0) {
        double at = now();
        if (at - s->piece_at > piece_slow)
            advise(s, was, tail, back, 2);
        s->piece_at = at;
    }
    atomic_store_explicit(&s->page->tail, tail, memory_order_release);
}

static void release(modald_stream *s, uint64_t end)
{
    if (end <= atomic_load_explicit(&s->released, memory_order_relaxed))
        return;
    atomic_store_explicit(&s->released, end, memory_order_relaxed);
    if (outlives_host(s))
        give_slots(s, end);
}

static void release_copied(modald_stream *s)
{
    if (!outlives_host(s))
        give_slots(s, s->taken);
}

static uint64_t waiting_in(const modald_stream *s)
{
    return atomic_load_explicit(&s->page->head, memory_order_acquire)
         - atomic_load_explicit(&s->released, memory_order_relaxed);
}

static bool may_copy(const modald_stream *s)
{
    return outlives_host(s)
        || s->taken - atomic_load_explicit(&s->released, memory_order_relaxed) < s->slots;
}

static bool overflows(const modald_stream *s)
{
    uint64_t half = s->slots / 2;

    if (outlives_host(s) || !s->opened)
        return waiting_in(s) >= half;
    /* The host may have pushed on since we took: with room in frames that is taken next. */
    return (s->frames == WINDOW || !may_copy(s))
        && atomic_load_explicit(&s->page->head, memory_order_acquire) - s->taken >= half;
}

/* Small pages for a slow stream, huge ones for another.  A host that overtook us has its pages by
 * itself. */
static void keep_ahead(modald_stream *s)
{
    static const int there[] = { MADV_NOHUGEPAGE, MADV_POPULATE_WRITE };
    uint64_t head = atomic_load_explicit(&s->page->head, memory_order_acquire),
             ahead = RING_AHEAD / (s->stride * sizeof(double)),
             room = atomic_load_explicit(&s->page->tail, memory_order_relaxed) + s->slots;

    if (s->piece == 0 || head + ahead / 2 < s->touched)
        return;
    uint64_t from = head > s->touched ? head : s->touched, to = head + ahead;
    to = to < room ? to : room;
    double at = now();
    bool slow = at - s->touched_at > piece_slow * (RING_AHEAD / 2) / RING_PIECE;
    if (head <= s->touched && from < to)
        advise(s, from, to, slow ? there : there + 1, slow ? 2 : 1);
    s->touched = to > from ? to : from;
    s->touched_at = at;
}

/* Every page is there, and known to this processor, before the first push. */
static void touch_pages(void *base, size_t bytes)
{
    for (volatile char *p = base; p < (volatile char *)base + bytes; p += PAGE)
        *p = *p;
}

/* Zeroed, of *BYTES or a little more, its first RING_TOUCHED bytes there, the rest in huge pages
 * where the system gives them and it fills one: then those begin behind what is there. */
static void *map_memory(size_t *bytes)
{
    size_t spare = *bytes >= HUGE_PAGE ? 2 * HUGE_PAGE : 0, before;
    char *base = mmap(NULL, *bytes + spare, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1,
                      0);

    if (base == MAP_FAILED && spare > 0) {
        spare = 0;
        base = mmap(NULL, *bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    }
    if (base == MAP_FAILED)
        return NULL;
    if (spare > 0) {
        size_t end = RING_TOUCHED
                   + (*bytes - RING_TOUCHED + HUGE_PAGE - 1) / HUGE_PAGE * HUGE_PAGE;
        before = (HUGE_PAGE - ((uintptr_t)base + RING_TOUCHED) % HUGE_PAGE) % HUGE_PAGE;
        if (before > 0)
            munmap(base, before);
        if (before + end < *bytes + spare)
            munmap(base + before + end, *bytes + spare - before - end);
        base += before;
        madvise(base + RING_TOUCHED, end - RING_TOUCHED, MADV_HUGEPAGE);
        *bytes = end;
    }
    touch_pages(base, *bytes < RING_TOUCHED ? *bytes : RING_TOUCHED);
    return base;
}

/* Has the file of FD room for BYTES?  Its blocks too: a mapped page that the disk is too full for
 * would end the host. */
static bool allocate(int fd, size_t bytes)
{
    struct stat st;

    return fstat(fd, &st) == 0 && posix_fallocate(fd, 0, (off_t)bytes) == 0
        && ((size_t)st.st_size <= bytes || ftruncate(fd, (off_t)bytes) == 0);
}

/* What an earlier run left in the file is kept: is it a ring like ours? */
static bool is_ring_of(const modald_stream *s, const struct ring_page *page)
{
    uint64_t waiting = atomic_load(&page->head) - atomic_load(&page->tail);

    return memcmp(page->magic, ring_magic, sizeof ring_magic) == 0
        && page->channels == (uint64_t)s->channels && page->slots == s->slots && page->dt == s->dt
        && strcmp(page->name, s->name) == 0 && waiting <= s->slots;
}

static void fill_head(const modald_stream *s, struct ring_page *page)
{
    memset((void *)page, 0, sizeof *page);
    page->channels = (uint64_t)s->channels;
    page->slots = s->slots;
    page->dt = s->dt;
    snprintf(page->name, sizeof page->name, "%s", s->name);
    memcpy(page->magic, ring_magic, sizeof ring_magic);
}

/* A file that is new has its head at once: a host killed while the rest is made leaves an empty
 * ring, not a file of nothing. */
static bool begin_file(const modald_stream *s, int fd, bool *fresh)
{
    struct ring_page page;
    struct rlimit most;
    struct stat st;

    if (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode) || getrlimit(RLIMIT_FSIZE, &most) != 0
        || most.rlim_cur < s->ring_bytes)
        return false; /* a file past that limit is a signal to the host */
    *fresh = st.st_size == 0;
    fill_head(s, &page);
    return !*fresh || pwrite(fd, &page, sizeof page, 0) == (ssize_t)sizeof page;
}

/* The ring in the file at PATH (%s: the stream's name), locked as long as it is ours; NULL: it
 * cannot be there. */
static void *map_file(modald_stream *s, const char *file)
{
    const char *mark = strstr(file, "%s");
    char path[512], name[sizeof s->name];
    void *base = MAP_FAILED;
    bool fresh = false;
    int fd, n;

    snprintf(name, sizeof name, "%s", s->name);
    for (char *p = name; *p != 0; p++)
        *p = *p == '/' ? '_' : *p;
    n = snprintf(path, sizeof path, "%.*s%s%s", mark ? (int)(mark - file) : (int)strlen(file), file,
                 mark ? name : "", mark ? mark + 2 : "");
    fd = n < (int)sizeof path ? open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600) : -1;
    if (fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
        warn(s->name, "another stream has the ring's file; this one is kept in memory");
    else if (fd >= 0 && begin_file(s, fd, &fresh) && allocate(fd, s->ring_bytes))
        base = mmap(NULL, s->ring_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    else
        warn(s->name, "the ring's file cannot be used; it is kept in memory");
    if (base == MAP_FAILED) {
        if (fresh)
            unlink(path);
        if (fd >= 0)
            close(fd);
        return NULL;
    }
    touch_pages(base, s->ring_bytes);
    s->ring_fd = fd;
    return base;
}

/* The ring, in memory or in a file. */
static bool ring_open(modald_stream *s, size_t bytes, const char *file)
{
    size_t slot;

    s->stride = (size_t)s->channels + 2;
    slot = s->stride * sizeof(double);
    if (file != NULL && *file != 0) {
        s->slots = bytes / slot < SLOTS_LEAST ? SLOTS_LEAST : bytes / slot;
        s->ring_bytes = RING_HEAD + s->slots * slot;
        s->page = map_file(s, file);
    }
    if (s->page == NULL) { /* its head included, so that 8 MiB are four huge pages */
        s->slots = bytes < RING_HEAD + SLOTS_LEAST * slot ? SLOTS_LEAST
                 : (bytes - RING_HEAD) / slot;
        s->ring_bytes = RING_HEAD + s->slots * slot;
        s->page = map_memory(&s->ring_bytes);
        if (s->slots * slot >= RING_TOUCHED)
            s->piece = slot < RING_PIECE ? RING_PIECE / slot : 1;
    }
    if (s->page == NULL)
        return false;
    s->touched = (RING_TOUCHED - RING_HEAD) / slot;
    s->touched_at = s->piece_at = now();
    s->ring = (double *)((char *)s->page + RING_HEAD);
    if (!is_ring_of(s, s->page))
        fill_head(s, s->page);
    s->head = atomic_load(&s->page->head);
    s->taken = s->tail_seen = atomic_load(&s->page->tail);
    atomic_store(&s->released, s->taken);
    s->cursor = s->head % s->slots;
    return true;
}
