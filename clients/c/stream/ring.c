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

/* s: what a burst took is given back once it was not used for so long.  To give all of a ring back
 * and touch it again takes some 3 ms, a few thousandths of that. */
static const double rest_after = 1;

/* Does a ring outlive its host?  Then it holds all that the daemon has not. */
static bool outlives_host(const modald_stream *s)
{
    return s->ring_fd >= 0;
}

/* BYTES at AT, which the host writes soon. */
static inline void read_on(const char *at, size_t bytes)
{
    for (size_t i = 0; i < bytes; i += LINE)
        __builtin_prefetch(at + i, 1);
}

/* The next piece for the host: of those that are free the first, so that a stream which its sender
 * keeps up with goes round in the same few.  False: none is free.  No push before has asked for the
 * lines of its first AHEAD bytes, 1.6 % of a piece of 8 MB: more than one push in a hundred would
 * wait for its own. */
static bool find_room(modald_stream *s)
{
    uint64_t free = atomic_load_explicit(&s->free_pieces, memory_order_relaxed), first = 0;

    if (outlives_host(s)) {
        s->end = atomic_load_explicit(&s->page->tail, memory_order_acquire) + s->slots;
        return s->end > s->head;
    }
    for (; free != 0; free &= ~first) {
        first = free & -free;                      /* the sender may have it, to give it back */
        free = atomic_fetch_and_explicit(&s->free_pieces, ~first, memory_order_acquire);
        if (free & first)
            break;
    }
    if (free == 0)
        return false;
    unsigned piece = (unsigned)__builtin_ctzll(first);
    s->order[s->head / s->piece % s->pieces] = (unsigned char)piece;
    s->cursor = piece * s->piece;
    s->end = s->head + s->piece;
    read_on((const char *)(s->ring + s->cursor * s->stride), AHEAD);
    return true;
}

/* Room for one slot, or NULL: full, or not ours. */
static inline double *next_slot(modald_stream *s)
{
    if (is_dead(s))
        return NULL;
    if (s->head == s->end && !find_room(s)) {
        atomic_fetch_add_explicit(&s->dropped, 1, memory_order_relaxed);
        s->index++;
        return NULL;
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
    read_on((const char *)at + AHEAD, length);          /* beyond the ring's end it is harmless */
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

static const double *slot_at(const modald_stream *s, uint64_t count)
{
    uint64_t place = outlives_host(s) ? count % s->slots
                   : s->order[count / s->piece % s->pieces] * s->piece + count % s->piece;

    return s->ring + place * s->stride;
}

static void release(modald_stream *s, uint64_t end)
{
    if (end <= atomic_load_explicit(&s->released, memory_order_relaxed))
        return;
    atomic_store_explicit(&s->released, end, memory_order_relaxed);
    if (outlives_host(s))
        atomic_store_explicit(&s->page->tail, end, memory_order_release);
}

static void release_copied(modald_stream *s)
{
    for (; !outlives_host(s) && s->given + s->piece <= s->taken; s->given += s->piece) {
        uint64_t piece = UINT64_C(1) << s->order[s->given / s->piece % s->pieces];
        s->touched |= piece;
        s->recent |= piece;
        atomic_fetch_or_explicit(&s->free_pieces, piece, memory_order_release);
    }
}

/* The pages that PIECE fills alone, which nobody has, to the system. */
static void give_piece(const modald_stream *s, unsigned piece)
{
    size_t bytes = s->piece * s->stride * sizeof(double);
    uintptr_t begin = (uintptr_t)s->ring + piece * bytes,
              first = (begin + PAGE - 1) / PAGE * PAGE, last = (begin + bytes) / PAGE * PAGE;

    if (first < last)
        madvise((char *)s->page + (first - (uintptr_t)s->page), last - first, MADV_DONTNEED);
}

static void rest_ring(modald_stream *s)
{
    double at;

    if ((s->touched & ~s->near) == 0 || (at = now()) < s->rest_at + rest_after)
        return;
    for (uint64_t idle = s->touched & ~s->recent & ~s->near; idle != 0; idle &= idle - 1) {
        uint64_t piece = idle & -idle;
        uint64_t before = atomic_fetch_and_explicit(&s->free_pieces, ~piece, memory_order_acquire);
        if ((before & piece) == 0)                 /* the host has it */
            continue;
        give_piece(s, (unsigned)__builtin_ctzll(piece));
        atomic_fetch_or_explicit(&s->free_pieces, piece, memory_order_release);
        s->touched &= ~piece;
    }
    s->recent = 0;
    s->rest_at = at;
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

/* A ring in memory is so many pieces, all free, of which the first are there. */
static void cut_pieces(modald_stream *s, size_t slot)
{
    uint64_t near;

    s->piece = (s->slots + PIECES - 1) / PIECES;
    s->pieces = s->slots / s->piece;
    s->slots = s->pieces * s->piece;
    near = (RING_TOUCHED - RING_HEAD) / (s->piece * slot);
    s->near = near < PIECES ? (UINT64_C(1) << near) - 1 : UINT64_MAX;
    atomic_store(&s->free_pieces, UINT64_MAX >> (PIECES - s->pieces));
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
        cut_pieces(s, slot);
    }
    if (s->page == NULL)
        return false;
    s->ring = (double *)((char *)s->page + RING_HEAD);
    if (!is_ring_of(s, s->page))
        fill_head(s, s->page);
    s->head = atomic_load(&s->page->head);
    s->taken = atomic_load(&s->page->tail);
    s->end = outlives_host(s) ? s->taken + s->slots : s->head;
    atomic_store(&s->released, s->taken);
    s->cursor = s->head % s->slots;
    return true;
}
