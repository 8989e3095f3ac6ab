/* replay.c - what a run left behind, a spill or a ring file, to the daemon */
#include "connection.h"
#include "open.h"
#include "ring.h"
#include "sender.h"
#include "spill.h"
#include "text.h"
#include <errno.h>
#include <fcntl.h>
#include <locale.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

/* S, which may be NULL, with its ring; NULL: no memory. */
static modald_stream *with_ring(modald_stream *s, size_t bytes, const char *file)
{
    if (s != NULL && !ring_open(s, bytes, file)) {
        stream_free(s);
        return NULL;
    }
    return s;
}

/* A stream whose spill file is FD: its head says what it was. */
static modald_stream *from_spill(int fd, const char *url, char *message, size_t size)
{
    char *text = calloc(1, HEADER_MOST + 1);
    uint32_t length = 0;
    modald_stream *s = NULL;
    char name[256] = "";

    if (flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
        snprintf(message, size, "a run still writes it");
        free(text);
        return NULL;
    }
    if (text != NULL
        && pread(fd, &length, sizeof length, sizeof spill_magic) == (ssize_t)sizeof length
        && length <= HEADER_MOST
        && pread(fd, text, length, sizeof spill_magic + sizeof length) == (ssize_t)length) {
        text[0] = '{';                                  /* as the message has an id before it */
        uint64_t channels = count_at(member(text, "channels"), 0);
        double dt = number_at(member(text, "dt"), 0);
        if (channels >= 1 && channels <= CHANNELS_MOST && dt > 0
            && read_string(member(text, "name"), name, sizeof name) && name[0] != 0)
            s = stream_new(name, (int)channels, dt, url);
        text[0] = ',';
    }
    s = with_ring(s, RING_HEAD, NULL);
    if (s == NULL) {
        snprintf(message, size, "its head cannot be read");
        free(text);
        return NULL;
    }
    s->open_text = text;
    s->spill_fd = fd;
    s->spill_most = 0;
    s->spill_start = s->spill_read = s->spill_acknowledged = sizeof spill_magic + sizeof length
                                                           + length;
    s->spill_end = (uint64_t)lseek(fd, 0, SEEK_END);
    return s;
}

/* Slots that a ring may say it has: the bytes of so many, of any channels, are still counted. */
static const uint64_t slots_most = (uint64_t)1 << 40;

/* A stream whose ring is the file at PATH. */
static modald_stream *from_ring(int fd, const char *path, const char *url, char *message,
                                size_t size)
{
    struct ring_page page;
    modald_stream *s = NULL;

    if (pread(fd, &page, sizeof page, 0) == (ssize_t)sizeof page && page.channels >= 1
        && page.channels <= CHANNELS_MOST && page.dt > 0 && page.slots >= SLOTS_LEAST
        && page.slots < slots_most && memchr(page.name, 0, sizeof page.name) != NULL)
        s = with_ring(stream_new(page.name, (int)page.channels, page.dt, url),
                      page.slots * (page.channels + 2) * sizeof(double), path);
    if (s == NULL)
        snprintf(message, size, "its head cannot be read");
    close(fd);
    if (s != NULL && s->ring_fd < 0) {
        snprintf(message, size, "a run still has it, or it cannot be written");
        stream_free(s);
        s = NULL;
    }
    return s;
}

/* What of a file was not what was written; "": all was. */
static void describe_damage(const modald_stream *s, char *message, size_t size)
{
    message[0] = 0;
    if (s->damaged > 0)
        append(message, size, "%llu samples were damaged and left out",
               (unsigned long long)s->damaged);
    if (s->torn > 0)
        append(message, size, "%sthe last %llu bytes were torn", s->damaged > 0 ? ", " : "",
               (unsigned long long)s->torn);
}

/* All of it by L, in at most TIMEOUT seconds? */
static bool send_all(struct link *l, modald_stream *s, double timeout, char *message, size_t size)
{
    bool good = false;

    make_context(l);
    if (!connect_socket(l)) {
        snprintf(message, size, "no socket to %s", s->url);
        return false;
    }
    s->link = l;
    s->seal = true;
    s->until = now() + timeout;
    take_in(l, s);
    while (!is_over(s)) {
        bool moved = receive_all(l);
        if (!serve(s) && !moved)
            sleep_for(moment);
    }
    good = drained(s) && s->closed;
    if (good)
        describe_damage(s, message, size);
    else
        snprintf(message, size, "%s",
                 s->refused ? "the daemon refused it"
                 : l->ready ? "not all of it was acknowledged in time"
                            : "no server");
    return good;
}

int modald_replay(const char *path, double timeout, double *samples, char *message, size_t size)
{
    const char *url = getenv("MODALD_URL");
    char magic[8] = "";
    int fd = open(path, O_RDWR | O_CLOEXEC);
    locale_t c = newlocale(LC_ALL_MASK, "C", (locale_t)0), before = uselocale(c);
    modald_stream *s = NULL;
    struct link *l;
    bool good = false;

    snprintf(message, size, "%s", fd < 0 ? strerror(errno) : "it is no spill or ring file");
    if (fd >= 0 && pread(fd, magic, sizeof magic, 0) == (ssize_t)sizeof magic
        && memcmp(magic, spill_magic, sizeof magic) == 0)
        s = from_spill(fd, url ? url : "", message, size);
    else if (fd >= 0 && memcmp(magic, ring_magic, sizeof magic) == 0)
        s = from_ring(fd, path, url ? url : "", message, size);
    l = s != NULL ? link_new(s) : NULL;
    if (s != NULL && l == NULL)
        snprintf(message, size, "no memory");
    if (l != NULL) {
        good = send_all(l, s, timeout, message, size);
        close_socket(l);
        link_free(l);
    }
    if (s != NULL) {
        *samples = (double)atomic_load(&s->acknowledged);
        if (s->spill_fd >= 0)
            close(s->spill_fd);
        if (s->ring_fd >= 0)
            close(s->ring_fd);
        stream_free(s);
    }
    uselocale(before);
    freelocale(c);
    return good;
}
