/*
 * link.c - two threads and a pair of sockets; see link.h
 *
 *     job's thread --PAIR inproc--> link's thread --DEALER--> daemon
 *
 * A ZeroMQ socket belongs to one thread.  ZMQ_IMMEDIATE makes the DEALER writable only once the
 * connection stands, so that everything that needs socket(2) or connect(2) is over before the
 * worker is confined; it never connects again.  A lost connection is not told by ZeroMQ: that the
 * daemon is gone is told by the descriptor that is watched, and ends the process from this thread,
 * whatever the job's is doing.
 */
#include "worker/link.h"
#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include <zmq.h>
#include "worker/words.h"

enum {
    LINGER_MS    = 1000,                 /* for the last answer, on a loaded host */
    MESSAGE_MOST = 2 * WIRE_BODY_MOST,   /* a body, and a header of WIRE_WORKER_HEADER_MOST */
    DAY_MS       = 86400000,             /* who has no connection ends long before */
    TICK_MS      = 200,                  /* a signal that wakes another thread waits so long */
    BEATS        = 3,                    /* in a lease: two may be lost */
    AT_ONCE      = 64,                   /* messages one way: then it is seen to BEAT */
};

/* A message of the job's thread that waits for others. */
struct kept {
    struct kept *next;
    zmq_msg_t parts[4];           /* version, verb, header, body */
    int count;
};

struct link {
    void *context, *dealer;       /* the dealer is the thread's */
    void *ours, *theirs;          /* the ends of the pair */
    pthread_t thread;
    bool started;
    int beat_ms, watched;

    bool elsewhere;               /* the daemon is on another host; then: */
    void *monitor;                /* the connection's end */
    struct elsewhere welcome;
    struct leave leave;           /* the thread's */
    struct words words;           /* the thread's, while it runs */

    pthread_mutex_t mutex;        /* over what BEAT says */
    char job[WIRE_ID_MOST + 1];
    int attempt;

    zmq_msg_t parts[WIRE_FRAMES_MOST];   /* of the message last received */
    int part_count;
    struct wire_message message;
    bool open;
    struct kept *kept, **kept_end;       /* the first of them, since when */
    int64_t kept_ms;
};

static enum modal_status fail(struct modal_error *err, const char *what)
{
    return modal_fail(err, errno == ENOMEM ? MODAL_NO_MEMORY : MODAL_NO_SERVER, "worker: %s: %s",
                      what, zmq_strerror(errno));
}

/* --- the link's thread --- */

static int64_t now_ms(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

static void beat(struct link *link)
{
    char header[WIRE_ID_MOST * 2 + 64] = "{}";

    pthread_mutex_lock(&link->mutex);
    if (link->job[0] != 0)
        snprintf(header, sizeof header, "{\"job\":\"%s\",\"attempt\":%d}", link->job,
                 link->attempt);
    pthread_mutex_unlock(&link->mutex);
    if (zmq_send_const(link->dealer, WIRE_WORKER, strlen(WIRE_WORKER), ZMQ_SNDMORE | ZMQ_DONTWAIT)
        < 0)
        return;                         /* no room: what is under way says as much */
    zmq_send_const(link->dealer, "BEAT", 4, ZMQ_SNDMORE);
    zmq_send(link->dealer, header, strlen(header), 0);
}

/* Has SOCKET a message?  Without a system call where one is known already. */
static bool has_message(void *socket)
{
    int events = 0;
    size_t size = sizeof events;

    return zmq_getsockopt(socket, ZMQ_EVENTS, &events, &size) == 0 && (events & ZMQ_POLLIN) != 0;
}

/* One whole message from one socket to the other; false where the pair was closed or the daemon is
 * gone. */
static bool pass(void *from, void *to)
{
    int more = 1;

    while (more) {
        zmq_msg_t part;
        zmq_msg_init(&part);
        if (zmq_msg_recv(&part, from, 0) < 0) {
            zmq_msg_close(&part);
            return errno == EINTR;
        }
        more = zmq_msg_more(&part);
        if (zmq_msg_send(&part, to, more ? ZMQ_SNDMORE : 0) < 0) {
            zmq_msg_close(&part);
            return false;
        }
    }
    return true;
}

/* An empty message on the pair ends the thread. */
static bool pass_out(struct link *link)
{
    zmq_msg_t first;
    bool more;

    zmq_msg_init(&first);
    if (zmq_msg_recv(&first, link->theirs, 0) < 0)
        return errno == EINTR;
    more = zmq_msg_more(&first);
    if (!more || zmq_msg_send(&first, link->dealer, ZMQ_SNDMORE) < 0) {
        zmq_msg_close(&first);
        return false;
    }
    return pass(link->theirs, link->dealer);
}

/* --- the same to a daemon on another host --- */

static volatile sig_atomic_t asked_to_go;

static void on_signal(int number)
{
    (void)number;
    asked_to_go = 1;
}

static void hear_signals(void)
{
    const struct sigaction action = { .sa_handler = on_signal, .sa_flags = SA_RESTART };

    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGUSR1, &action, NULL);
}

/* VERB, about JOB where there is one, ahead of whatever the job's thread sends. */
static void say(struct link *link, const char *verb, const char *job, int attempt)
{
    char header[WIRE_ID_MOST * 2 + 96] = "{}";

    if (job[0] != 0)
        snprintf(header, sizeof header, "{\"job\":\"%s\",\"attempt\":%d,\"why\":\"%s\"}", job,
                 attempt, link->leave.why);
    zmq_send_const(link->dealer, WIRE_WORKER, strlen(WIRE_WORKER), ZMQ_SNDMORE);
    zmq_send(link->dealer, verb, strlen(verb), ZMQ_SNDMORE);
    zmq_send(link->dealer, header, strlen(header), 0);
}

/* The whole message at FROM into PARTS; how many there are, -1: its sender is gone. */
static int take_in(void *from, zmq_msg_t parts[WIRE_FRAMES_MOST])
{
    int count = 0, more = 1;

    while (more) {
        zmq_msg_t part;
        zmq_msg_init(&part);
        if (zmq_msg_recv(&part, from, 0) < 0) {
            zmq_msg_close(&part);
            if (errno == EINTR)
                continue;
            return -1;
        }
        more = zmq_msg_more(&part);
        if (count < WIRE_FRAMES_MOST)
            parts[count++] = part;
        else
            zmq_msg_close(&part);
    }
    return count;
}

static bool is_verb(zmq_msg_t *parts, int count, const char *verb)
{
    return count > 1 && zmq_msg_size(&parts[1]) == strlen(verb)
           && memcmp(zmq_msg_data(&parts[1]), verb, strlen(verb)) == 0;
}

static bool pass_on(zmq_msg_t *parts, int count, void *to)
{
    for (int i = 0; i < count; i++)
        if (zmq_msg_send(&parts[i], to, i + 1 < count ? ZMQ_SNDMORE : 0) < 0)
            return false;
    return true;
}

/* A RUN that met the LEAVE under way goes back as it came. */
static void give_back(struct link *link, zmq_msg_t *parts, int count)
{
    struct wire_frame frames[WIRE_FRAMES_MOST];
    struct wire_message message;
    const char *job = "";
    int attempt = 0;

    for (int i = 0; i < count; i++)
        frames[i] = (struct wire_frame) { zmq_msg_data(&parts[i]), zmq_msg_size(&parts[i]) };
    if (wire_open(frames, count, WIRE_WORKER, false, &message, NULL) == MODAL_OK) {
        json_get_string(message.header, "", "job", &job, NULL);
        json_get_int(message.header, "", "attempt", 0, INT32_MAX, &attempt, NULL);
        if (strlen(job) <= WIRE_ID_MOST && strpbrk(job, "\"\\") == NULL)
            say(link, "RELEASE", job, attempt);
    }
    wire_close(&message);
}

/* The process ends here, whatever the job's thread is doing. */
static void end(struct link *link, int status)
{
    words_close(&link->words);
    _exit(status);
}

/* A message of the daemon's; false: the link is over. */
static bool hear(struct link *link)
{
    zmq_msg_t parts[WIRE_FRAMES_MOST];
    const int count = take_in(link->dealer, parts);
    const bool runs = is_verb(parts, count, "RUN");
    bool passed = true;

    if (is_verb(parts, count, "STOP") && link->leave.given)
        end(link, link->leave.left ? 0 : 1);
    if (runs && link->leave.left)
        give_back(link, parts, count);
    else {
        if (runs)
            leave_given(&link->leave, true, now_ms());
        passed = count > 0 && pass_on(parts, count, link->theirs);
    }
    for (int i = 0; i < count; i++)
        zmq_msg_close(&parts[i]);
    return passed;
}

/* A message of the job's thread; false: it wants to end. */
static bool speak(struct link *link)
{
    zmq_msg_t parts[WIRE_FRAMES_MOST];
    const int count = take_in(link->theirs, parts);
    bool passed = count > 1;

    if (is_verb(parts, count, "READY")) {
        leave_given(&link->leave, false, now_ms());
        if (leave_next(&link->leave, asked_to_go != 0, now_ms()) == LEAVE_SAY)
            say(link, "LEAVE", "", 0);
        else
            passed = pass_on(parts, count, link->dealer);
    } else if (passed)
        passed = pass_on(parts, count, link->dealer);
    for (int i = 0; i < count; i++)
        zmq_msg_close(&parts[i]);
    return passed;
}

/* STDERR with the words that came since the last one: once a beat, or when they are the last. */
static void say_words(struct link *link)
{
    struct words *words = &link->words;

    if (zmq_send_const(link->dealer, WIRE_WORKER, strlen(WIRE_WORKER), ZMQ_SNDMORE | ZMQ_DONTWAIT)
        < 0)
        return;                         /* no room: with the next beat */
    zmq_send_const(link->dealer, "STDERR", 6, ZMQ_SNDMORE);
    zmq_send_const(link->dealer, "{}", 2, ZMQ_SNDMORE);
    zmq_send(link->dealer, words->text, words->length, 0);
    words_sent(words);
}

/* Is it time to go?  Who gave a job back ends with the daemon's STOP, or without. */
static void consider_leaving(struct link *link)
{
    const int64_t now = now_ms();
    const enum leave_act act = leave_next(&link->leave, asked_to_go != 0, now);
    char job[WIRE_ID_MOST + 1];
    int attempt;

    if (act == LEAVE_SAY)
        say(link, "LEAVE", "", 0);
    if (act == LEAVE_RELEASE) {
        pthread_mutex_lock(&link->mutex);
        memcpy(job, link->job, sizeof job);
        attempt = link->attempt;
        pthread_mutex_unlock(&link->mutex);
        if (job[0] != 0)
            say(link, "RELEASE", job, attempt);
        say(link, "LEAVE", "", 0);
    }
    if (link->leave.left && now - link->leave.going_ms > link->leave.options.grace_ms + LINGER_MS)
        end(link, 0);
}

/* --- the thread --- */

/* What has come is passed, of a daemon on this host all that there is, but for what comes
 * meanwhile; false: the link is over. */
static bool pass_messages(struct link *link, bool in, bool out)
{
    bool alive = true;

    if (link->elsewhere && in)
        alive = hear(link);
    if (link->elsewhere)
        return alive && out ? speak(link) : alive;
    for (int n = 0; alive && in && n < AT_ONCE; n++) {
        alive = pass(link->dealer, link->theirs);
        in = has_message(link->dealer);
    }
    for (int n = 0; alive && out && n < AT_ONCE; n++) {
        alive = pass_out(link);
        out = has_message(link->theirs);
    }
    return alive;
}

static void *link_run(void *argument)
{
    struct link *link = argument;
    int64_t next = now_ms();
    bool alive = true;

    while (alive) {
        zmq_pollitem_t items[4] = { { link->dealer, 0, ZMQ_POLLIN, 0 },
                                    { link->theirs, 0, ZMQ_POLLIN, 0 },
                                    { NULL, link->watched, ZMQ_POLLERR, 0 },
                                    { NULL, link->words.pipe, ZMQ_POLLIN, 0 } };
        int count = link->words.pipe >= 0                       ? 4
                    : link->elsewhere || link->watched > 0 ? 3 : 2;
        int64_t wait = next - now_ms();
        if (link->elsewhere) {
            items[2] = (zmq_pollitem_t) { link->monitor, 0, ZMQ_POLLIN, 0 };
            wait = wait < TICK_MS ? wait : TICK_MS;
        }
        if (zmq_poll(items, count, wait > 0 ? (long)wait : 0) < 0 && errno != EINTR)
            break;
        if (items[3].revents != 0)
            words_read(&link->words);
        if (items[2].revents != 0)
            end(link, 1);
        if (link->words.fresh && (now_ms() >= next || words_last()))
            say_words(link);
        if (now_ms() >= next) {
            beat(link);
            next = now_ms() + link->beat_ms;
        }
        if (link->elsewhere)
            consider_leaving(link);
        alive = pass_messages(link, items[0].revents & ZMQ_POLLIN, items[1].revents & ZMQ_POLLIN);
    }
    zmq_close(link->dealer);
    zmq_close(link->theirs);
    if (link->monitor != NULL)
        zmq_close(link->monitor);
    return NULL;
}

/* --- the job's thread --- */

static int wait_ms(const struct link_options *options)
{
    return options->connect_ms > 0 ? options->connect_ms : 10000;
}

/* The daemon on another host takes us in. */
static enum modal_status join(struct link *link, const struct link_options *options,
                              struct modal_error *err)
{
    enum modal_status rc;

    leave_init(&link->leave, &options->leave, now_ms());
    rc = elsewhere_join(link->dealer, link->monitor, options->elsewhere,
                        leave_left_s(&link->leave, now_ms()), wait_ms(options), &link->welcome,
                        err);
    link->beat_ms = link->welcome.lease_ms / BEATS;
    hear_signals();
    return rc;
}

static enum modal_status connect_dealer(struct link *link, const struct link_options *options,
                                        struct modal_error *err)
{
    /* to -1 libzmq 4.3.4 answers by looking for the host's interfaces, which the walls forbid */
    const int never = link->elsewhere ? DAY_MS : -1;
    const int linger = LINGER_MS, immediate = 1, high = 64;
    const int64_t most = MESSAGE_MOST;
    zmq_pollitem_t item = { NULL, 0, ZMQ_POLLOUT, 0 };

    link->dealer = zmq_socket(link->context, ZMQ_DEALER);
    if (link->dealer == NULL)
        return fail(err, "socket");
    zmq_setsockopt(link->dealer, ZMQ_LINGER, &linger, sizeof linger);
    zmq_setsockopt(link->dealer, ZMQ_IMMEDIATE, &immediate, sizeof immediate);
    zmq_setsockopt(link->dealer, ZMQ_RECONNECT_IVL, &never, sizeof never);
    zmq_setsockopt(link->dealer, ZMQ_SNDHWM, &high, sizeof high);
    zmq_setsockopt(link->dealer, ZMQ_RCVHWM, &high, sizeof high);
    zmq_setsockopt(link->dealer, ZMQ_MAXMSGSIZE, &most, sizeof most);
    if (link->elsewhere) {
        enum modal_status rc = elsewhere_guard(link->dealer, options->elsewhere, err);
        if (rc == MODAL_OK)
            rc = elsewhere_monitor(link->context, link->dealer, &link->monitor, err);
        if (rc != MODAL_OK)
            return rc;
    }
    if (zmq_connect(link->dealer, options->endpoint) < 0)
        return fail(err, options->endpoint);
    item.socket = link->dealer;
    if (link->elsewhere)
        return MODAL_OK;
    if (zmq_poll(&item, 1, wait_ms(options)) < 1)
        return modal_fail(err, MODAL_NO_SERVER, "worker: nobody answers at %s", options->endpoint);
    return MODAL_OK;
}

static enum modal_status make_pair(struct link *link, struct modal_error *err)
{
    const int none = 0;

    link->ours = zmq_socket(link->context, ZMQ_PAIR);
    link->theirs = zmq_socket(link->context, ZMQ_PAIR);
    if (link->ours == NULL || link->theirs == NULL)
        return fail(err, "socket");
    zmq_setsockopt(link->ours, ZMQ_LINGER, &none, sizeof none);
    zmq_setsockopt(link->theirs, ZMQ_LINGER, &none, sizeof none);
    if (zmq_bind(link->ours, "inproc://link") < 0 || zmq_connect(link->theirs, "inproc://link") < 0)
        return fail(err, "inproc");
    return MODAL_OK;
}

enum modal_status link_open(const struct link_options *options, struct link **out,
                            struct modal_error *err)
{
    struct link *link = calloc(1, sizeof *link);
    enum modal_status rc = MODAL_OK;

    if (link == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "worker: no memory for a link");
    pthread_mutex_init(&link->mutex, NULL);
    words_init(&link->words);
    link->beat_ms = options->beat_ms > 0 ? options->beat_ms : 1000;
    link->watched = options->watched;
    link->elsewhere = options->elsewhere != NULL;
    link->context = zmq_ctx_new();
    if (link->context == NULL)
        rc = fail(err, "context");
    if (rc == MODAL_OK)
        rc = make_pair(link, err);
    if (rc == MODAL_OK)
        rc = connect_dealer(link, options, err);
    if (rc == MODAL_OK && link->elsewhere)
        rc = join(link, options, err);
    if (rc == MODAL_OK && link->elsewhere)
        rc = words_open(&link->words, err);
    if (rc == MODAL_OK && pthread_create(&link->thread, NULL, link_run, link) != 0)
        rc = modal_fail(err, MODAL_NO_MEMORY, "worker: no thread");
    link->started = rc == MODAL_OK;
    if (rc != MODAL_OK) {
        link_close(link);
        return rc;
    }
    *out = link;
    return MODAL_OK;
}

static struct kept *take_kept(struct link *link)
{
    struct kept *kept = link->kept;

    link->kept = kept->next;
    return kept;
}

static void kept_free(struct kept *kept)
{
    while (kept->count > 0)
        zmq_msg_close(&kept->parts[--kept->count]);
    free(kept);
}

static void drop_message(struct link *link)
{
    if (link->open)
        wire_close(&link->message);
    link->open = false;
    while (link->part_count > 0)
        zmq_msg_close(&link->parts[--link->part_count]);
}

void link_close(struct link *link)
{
    if (link == NULL)
        return;
    drop_message(link);
    while (link->kept != NULL)
        kept_free(take_kept(link));
    if (link->started) {
        zmq_send(link->ours, "", 0, 0);
        pthread_join(link->thread, NULL);
    } else {
        if (link->dealer != NULL)
            zmq_close(link->dealer);
        if (link->theirs != NULL)
            zmq_close(link->theirs);
        if (link->monitor != NULL)
            zmq_close(link->monitor);
    }
    if (link->ours != NULL)
        zmq_close(link->ours);
    if (link->context != NULL)
        zmq_ctx_term(link->context);
    words_close(&link->words);
    pthread_mutex_destroy(&link->mutex);
    free(link);
}

int link_credit(const struct link *link)
{
    return link->welcome.credit;
}

int link_chunk(const struct link *link)
{
    return link->welcome.chunk;
}

void link_working(struct link *link, const char *job, int attempt)
{
    pthread_mutex_lock(&link->mutex);
    snprintf(link->job, sizeof link->job, "%s", job != NULL ? job : "");
    link->attempt = attempt;
    pthread_mutex_unlock(&link->mutex);
}

/* One frame of SIZE bytes of DATA, copied, behind those of KEPT. */
static bool add_part(struct kept *kept, const void *data, size_t size)
{
    zmq_msg_t *part = &kept->parts[kept->count];

    if (zmq_msg_init_size(part, size) < 0)
        return false;
    if (size > 0)
        memcpy(zmq_msg_data(part), data, size);
    kept->count++;
    return true;
}

enum modal_status link_keep(struct link *link, const char *verb, cJSON *header, const void *data,
                            size_t length, struct modal_error *err)
{
    char *text = json_print(header);
    struct kept *kept = calloc(1, sizeof *kept);
    bool made = text != NULL && kept != NULL
                && add_part(kept, WIRE_WORKER, strlen(WIRE_WORKER))
                && add_part(kept, verb, strlen(verb)) && add_part(kept, text, strlen(text))
                && (data == NULL || add_part(kept, data, length));

    cJSON_Delete(header);
    free(text);
    if (!made) {
        if (kept != NULL)
            kept_free(kept);
        return modal_fail(err, MODAL_NO_MEMORY, "worker: no memory for a message");
    }
    if (link->kept == NULL)
        link->kept_ms = now_ms();
    *(link->kept == NULL ? &link->kept : link->kept_end) = kept;
    link->kept_end = &kept->next;
    return MODAL_OK;
}

enum modal_status link_let_go(struct link *link, struct modal_error *err)
{
    bool sent = true;

    while (sent && link->kept != NULL) {
        struct kept *kept = take_kept(link);
        sent = pass_on(kept->parts, kept->count, link->ours);
        kept_free(kept);
    }
    return sent ? MODAL_OK : fail(err, "send");
}

int64_t link_kept_ms(const struct link *link)
{
    return link->kept != NULL ? link->kept_ms : 0;
}

enum modal_status link_send(struct link *link, const char *verb, cJSON *header, const void *data,
                            size_t length, struct modal_error *err)
{
    enum modal_status rc = link_keep(link, verb, header, data, length, err);

    return rc == MODAL_OK ? link_let_go(link, err) : rc;
}

bool link_waits(struct link *link)
{
    return has_message(link->ours);
}

static enum modal_status receive_parts(struct link *link, struct modal_error *err)
{
    int more = 1;

    while (more) {
        zmq_msg_t part;
        zmq_msg_init(&part);
        while (zmq_msg_recv(&part, link->ours, 0) < 0)
            if (errno != EINTR)
                return fail(err, "receive");
        more = zmq_msg_more(&part);
        if (link->part_count < WIRE_FRAMES_MOST)
            link->parts[link->part_count++] = part;
        else
            zmq_msg_close(&part);
    }
    return MODAL_OK;
}

enum modal_status link_receive(struct link *link, const struct wire_message **out,
                               struct modal_error *err)
{
    struct wire_frame frames[WIRE_FRAMES_MOST];
    enum modal_status rc;

    drop_message(link);
    rc = receive_parts(link, err);
    if (rc != MODAL_OK)
        return rc;
    for (int i = 0; i < link->part_count; i++)
        frames[i] = (struct wire_frame) { zmq_msg_data(&link->parts[i]),
                                          zmq_msg_size(&link->parts[i]) };
    rc = wire_open(frames, link->part_count, WIRE_WORKER, false, &link->message, err);
    link->open = true;
    *out = &link->message;
    return rc;
}
