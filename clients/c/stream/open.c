/* open.c - see open.h */
#include "open.h"
#include "frames.h"
#include "ring.h"
#include "sender.h"
#include "text.h"
#include <locale.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum {
    TRIES = 1000,                /* to read an estimate that is being written: the writer has five
                                  * stores to make, and may be held up in them */
    VALUE_MOST = 128,            /* bytes of a variable that names the run: longer ones do not */
    RUN_BYTES = 2048,            /* of all of those, written out */
    UNITS_BYTES = 1024,          /* of the units, written out */
};
static const size_t ring_usual = 8388608;              /* bytes: as many as a window of frames */
static const size_t spill_usual = 1073741824;          /* bytes */
static const double size_most = 1e15;                  /* bytes that a variable may ask for */
static const double wait_usual = 5, wait_most = 1e6;   /* s that a close may take */

int modald_verdict(const modald_stream *s)
{
    return s == NULL || is_dead(s) ? MODALD_UNKNOWN
                                   : atomic_load_explicit(&s->verdict, memory_order_relaxed);
}

int modald_get_estimate(const modald_stream *s, struct modald_estimate *out)
{
    for (int tries = 0; s != NULL && !is_dead(s) && tries < TRIES; tries++) {
        unsigned before = atomic_load_explicit(&s->estimate_version, memory_order_acquire);
        if (before == atomic_load_explicit(&s->estimate_past, memory_order_relaxed))
            return 0;
        *out = s->estimate;
        atomic_thread_fence(memory_order_acquire);
        if (before % 2 == 0
            && atomic_load_explicit(&s->estimate_version, memory_order_relaxed) == before)
            return 1;
    }
    return 0;
}

void modald_get_report(const modald_stream *s, struct modald_report *out)
{
    memset(out, 0, sizeof *out);
    if (s == NULL || is_dead(s))
        return;
    out->pushed = (double)s->head;
    out->dropped = (double)atomic_load(&s->dropped);
    out->acknowledged = (double)atomic_load(&s->acknowledged);
    out->waiting = (double)waiting_in(s);
    out->spilled = (double)atomic_load(&s->spilled);
    out->resampling_error = s->resampling_error;
    out->refused = atomic_load(&s->refused);
}

static void append_attribute(char *text, size_t size, const char *key, const char *value,
                             bool *first)
{
    if (value == NULL || *value == 0)
        return;
    append(text, size, "%s\"%s\":", *first ? "" : ",", key);
    append_string(text, size, value);
    *first = false;
}

/* Which run a stream comes from. */
static char *describe_run(void)
{
    static const char *const environment[][2] = {
        { "slurm_job", "SLURM_JOB_ID" },
        { "slurm_array_task", "SLURM_ARRAY_TASK_ID" },
        { "slurm_node", "SLURMD_NODENAME" },
        { "slurm_restarts", "SLURM_RESTART_COUNT" },
    };
    char host[128] = "", *text = calloc(1, RUN_BYTES);
    bool first = true;

    if (text == NULL)
        return NULL;
    gethostname(host, sizeof host - 1);
    append(text, RUN_BYTES, "{");
    append_attribute(text, RUN_BYTES, "host", host, &first);
    for (size_t i = 0; i < sizeof environment / sizeof environment[0]; i++) {
        const char *value = getenv(environment[i][1]);
        bool fits = value != NULL && strlen(value) < VALUE_MOST;
        append_attribute(text, RUN_BYTES, environment[i][0], fits ? value : NULL, &first);
    }
    append(text, RUN_BYTES, "}");
    return text;
}

static double number_from(const char *name, double otherwise, double most)
{
    const char *text = getenv(name);
    char *end;
    double value = text && *text ? strtod(text, &end) : 0;

    return text && *text && *end == 0 && value >= 0 && value <= most ? value : otherwise;
}

static size_t size_from(const char *name, size_t otherwise)
{
    return (size_t)number_from(name, (double)otherwise, size_most);
}

/* PATH from the root, whatever the host's folder is later. */
static void absolute(char *out, size_t size, const char *path)
{
    char here[256];

    if (*path == '/' || getcwd(here, sizeof here) == NULL)
        snprintf(out, size, "%s", path);
    else
        snprintf(out, size, "%s/%s", here, path);
}

/* A closed stream's handle: what is done to it does nothing, until so many were closed after it. */
static void free_later(modald_stream *s)
{
    static modald_stream *closed[CLOSED_KEPT];
    static unsigned next;
    modald_stream *oldest;

    pthread_mutex_lock(&process_lock);
    oldest = closed[next];
    closed[next] = s;
    next = (next + 1) % CLOSED_KEPT;
    pthread_mutex_unlock(&process_lock);
    free(oldest);
}

static void stream_free(modald_stream *s)
{
    if (s->page != NULL)
        munmap(s->page, s->ring_bytes);
    loans_drop(s->loans);
    for (int i = 0; i < HISTORY; i++)
        free(s->history[i].y);
    free(s->rms);
    free(s->sample);
    free(s->names);
    free(s->units);
    free(s->options);
    free(s->alarms);
    free(s->url);
    free(s->keyfile);
    free(s->ring_file);
    free(s->open_text);
    free(s->run);
    sem_destroy(&s->begun);
    s->forks = CLOSED;
    free_later(s);
}

/* A relative path of ipc is the host's folder's too, where the longer name fits (URL_PATH_MOST). */
static char *copy_url(const char *url)
{
    char path[URL_PATH_MOST + 256];

    if (strncmp(url, "ipc://", 6) != 0 || url[6] == '/' || url[6] == '@')
        return strdup(url);
    snprintf(path, 7, "ipc://");
    absolute(path + 6, sizeof path - 6, url + 6);
    return strdup(strlen(path) - 6 <= URL_PATH_MOST ? path : url);
}

/* The file that the variable NAME names, from the root; NULL: none. */
static char *copy_path(const char *name)
{
    const char *file = getenv(name);
    char path[1024];

    if (file == NULL || *file == 0)
        return NULL;
    absolute(path, sizeof path, file);
    return strdup(path);
}

static char *copy_of(const char *name)
{
    const char *text = getenv(name);

    return text && *text ? strdup(text) : NULL;
}

static modald_stream *stream_new(const char *name, int channels, double dt, const char *url)
{
    const char *folder = getenv("MODALD_SPILL"), *tmp = getenv("TMPDIR");
    modald_stream *s = aligned_alloc(LINE, sizeof *s);

    if (s == NULL)
        return NULL;
    memset((void *)s, 0, sizeof *s);
    snprintf(s->name, sizeof s->name, "%s", name);
    pthread_once(&fork_once, watch_forks);
    s->forks = atomic_load(&forks);
    s->channels = channels;
    s->dt = dt;
    s->spill_fd = s->ring_fd = -1;
    sem_init(&s->begun, 0, 0);
    s->spill_most = size_from("MODALD_SPILL_MAX", spill_usual);
    absolute(s->spill_folder, sizeof s->spill_folder,
             folder && *folder ? folder : tmp && *tmp ? tmp : "/tmp");
    s->close_wait = number_from("MODALD_CLOSE_WAIT", wait_usual, wait_most);
    s->window_samples = (long)size_from("MODALD_WINDOW", 0);
    s->window_hop = (long)size_from("MODALD_HOP", 0);
    s->credit = FRAME_BYTES;
    s->url = copy_url(url);
    s->keyfile = copy_path("MODALD_KEYFILE");
    s->options = copy_of("MODALD_OPTIONS");
    s->alarms = copy_of("MODALD_ALARMS");
    s->run = describe_run();
    if (s->url == NULL || !frames_new(s)) {
        stream_free(s);
        return NULL;
    }
    return s;
}

static void link_free(struct link *l)
{
    sem_destroy(&l->begun);
    free(l->url);
    free(l->keyfile);
    free(l);
}

static struct link *link_new(const modald_stream *s)
{
    struct link *l = calloc(1, sizeof *l);

    if (l == NULL)
        return NULL;
    sem_init(&l->begun, 0, 0);
    l->url = strdup(s->url);
    l->keyfile = s->keyfile != NULL ? strdup(s->keyfile) : NULL;
    if (l->url != NULL && (l->keyfile != NULL || s->keyfile == NULL))
        return l;
    link_free(l);
    return NULL;
}

/* The sender's thread; no signal is ever its own.  A host with more of its own data a thread than
 * SENDER_STACK gets the usual stack. */
static bool start(struct link *l)
{
    pthread_attr_t attr;
    sigset_t all, before;
    bool good;

    sigfillset(&all);
    pthread_sigmask(SIG_BLOCK, &all, &before);
    pthread_attr_init(&attr);
    pthread_attr_setstacksize(&attr, SENDER_STACK);
    good = pthread_create(&l->thread, &attr, sender, l) == 0
        || pthread_create(&l->thread, NULL, sender, l) == 0;
    pthread_attr_destroy(&attr);
    while (good && sem_wait(&l->begun) != 0)
        ;
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return good;
}

/* The link for S, where the process has it and it goes. */
static struct link *link_find(const modald_stream *s)
{
    for (struct link *l = links; l != NULL; l = l->next)
        if (strcmp(l->url, s->url) == 0 && l->users < LINK_STREAMS && !atomic_load(&l->refused)
            && strcmp(l->keyfile ? l->keyfile : "", s->keyfile ? s->keyfile : "") == 0)
            return l;
    return NULL;
}

static struct link *link_begin(const modald_stream *s)
{
    struct link *l = link_new(s);

    if (l != NULL && !start(l)) {
        link_free(l);
        return NULL;
    }
    if (l != NULL) {
        l->next = links;
        links = l;
    }
    return l;
}

/* S to its link, begun where there is none.  Its ring is there, or, where it is in a file, the
 * sender opens it.  False: no thread or no memory. */
static bool join(modald_stream *s)
{
    struct link *l;

    pthread_mutex_lock(&process_lock);
    l = link_find(s);
    l = l != NULL ? l : link_begin(s);
    if (l != NULL) {
        l->users++;
        s->link = l;
        s->next = atomic_load(&l->arrived);
        while (!atomic_compare_exchange_weak(&l->arrived, &s->next, s))
            ;
    }
    pthread_mutex_unlock(&process_lock);
    while (l != NULL && s->ring_file != NULL && sem_wait(&s->begun) != 0)
        ;
    return l != NULL;
}

static void unlist(const struct link *l)
{
    struct link **at = &links;

    while (*at != NULL && *at != l)
        at = &(*at)->next;
    if (*at != NULL)
        *at = l->next;
}

/* One stream of L less; the last ends it.  LEFT: its thread hangs in a file system, and no other
 * stream comes to it, nor does anybody wait for it. */
static void part(struct link *l, bool left)
{
    bool last, wait;

    pthread_mutex_lock(&process_lock);
    l->left |= left;
    last = --l->users == 0;
    wait = last && !l->left;
    if (last || left)
        unlist(l);
    pthread_mutex_unlock(&process_lock);
    if (!last)
        return;
    if (!wait)
        pthread_detach(l->thread);
    atomic_store(&l->stop, true);
    if (wait) {
        pthread_join(l->thread, NULL);
        link_free(l);
    }
}

modald_stream *modald_open(const char *name, int channels, double dt)
{
    const char *url = getenv("MODALD_URL");
    modald_stream *s;

    if (url == NULL || *url == 0)
        return NULL;
    if (name == NULL || *name == 0 || strlen(name) > NAME_MOST || channels < 1
        || channels > CHANNELS_MOST || !(dt > 0) || !isfinite(dt)) {
        warn(NULL, "modald_open: a name of 1 to 128 bytes, 1 to 65536 channels and a positive dt "
                   "are needed");
        return NULL;
    }
    /* numbers have a point */
    locale_t c = newlocale(LC_ALL_MASK, "C", (locale_t)0), before = uselocale(c);
    s = stream_new(name, channels, dt, url);
    if (s != NULL) {
        s->ring_bytes = size_from("MODALD_RING", ring_usual);
        s->ring_file = copy_path("MODALD_RING_FILE");
    }
    uselocale(before);
    freelocale(c);
    if (s != NULL && !((s->ring_file != NULL || ring_open(s, s->ring_bytes, NULL)) && join(s))) {
        stream_free(s);
        s = NULL;
    } else if (s != NULL && s->page == NULL) {
        part(s->link, false);
        stream_free(s);
        s = NULL;
    }
    if (s == NULL)
        warn(name, "no memory or no thread; the run goes on without it");
    return s;
}

void modald_describe(modald_stream *s, const char *const *names, const char *units, double period)
{
    size_t size = HEADER_MOST / 2;

    if (s == NULL || is_dead(s))
        return;
    s->period = period;
    if (names != NULL && s->names == NULL && (s->names = calloc(1, size)) != NULL) {
        for (int i = 0; i < s->channels; i++) {
            append(s->names, size, i ? "," : "[");
            append_string(s->names, size, names[i]);
        }
        append(s->names, size, "]");
    }
    if (units != NULL && s->units == NULL && (s->units = calloc(1, UNITS_BYTES)) != NULL)
        append_string(s->units, UNITS_BYTES, units);
}

void modald_window(modald_stream *s, long samples, long hop, const char *options)
{
    if (s == NULL || is_dead(s))
        return;
    s->window_samples = samples;
    s->window_hop = hop;
    if (options != NULL) {
        free(s->options);
        s->options = strdup(options);
    }
}

void modald_alarms(modald_stream *s, const char *rules)
{
    if (s == NULL || is_dead(s))
        return;
    free(s->alarms);
    s->alarms = rules != NULL ? strdup(rules) : NULL;
}

/* S is to end as HOW says. */
static void ask_end(modald_stream *s, int how)
{
    if (s != NULL && !is_dead(s))
        atomic_store(&s->stop, how);
}

/* S, which was asked to end, has until then. */
static void await_end(modald_stream *s, double until)
{
    bool finished;

    if (s == NULL || is_dead(s))
        return;
    while (!atomic_load(&s->finished) && now() < until)
        sleep_for(moment);
    finished = atomic_load(&s->finished);
    part(s->link, !finished);
    if (finished)
        stream_free(s);
    else
        s->forks = CLOSED;
}

static double patience_of(const modald_stream *s)
{
    return s == NULL || is_dead(s) ? 0 : s->close_wait + 1;
}

static void end_stream(modald_stream *s, int how)
{
    double until = now() + patience_of(s);

    ask_end(s, how);
    await_end(s, until);
}

void modald_close(modald_stream *s)
{
    end_stream(s, 1);
}

void modald_close_all(modald_stream *const *streams, size_t count)
{
    double begun = now();

    for (size_t i = 0; i < count; i++)
        ask_end(streams[i], 1);
    for (size_t i = 0; i < count; i++)
        await_end(streams[i], begun + patience_of(streams[i]));
}

void modald_abandon(modald_stream *s)
{
    end_stream(s, 2);
}
