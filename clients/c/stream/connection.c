/* connection.c - see connection.h */
#include "connection.h"
#include "messages.h"
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zmq.h>

/* The daemon is there, and does not let us in. */
static void warn_refused(modald_stream *s, uint16_t event, uint32_t value)
{
    bool keys = s->keys[0][0] != 0;

    if (event == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH)
        warn_once(s, "the daemon refused our key; the run goes on without it");
    else if (value == ZMQ_PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH)
        warn_once(s, keys ? "the daemon takes no keys (MODALD_KEYFILE); the run goes on without it"
                          : "the daemon wants a key (MODALD_KEYFILE); the run goes on without it");
}

/* A daemon that hangs up before its reason is read gives none: the failures are counted. */
static void on_monitor_event(modald_stream *s, uint16_t event, uint32_t value)
{
    if (event == ZMQ_EVENT_HANDSHAKE_SUCCEEDED) {
        reset_link(s);
        s->ready = true;
    } else if (event == ZMQ_EVENT_DISCONNECTED) {
        s->lost = true;
        if (!s->ready && ++s->failures == FAILURES && !s->warned)
            warn(s->name, "somebody is there, but no handshake succeeds: it may want a key, or "
                          "another than ours (MODALD_KEYFILE), or be no modald; the run goes on");
    } else {
        warn_refused(s, event, value);
    }
}

static void read_monitor(modald_stream *s)
{
    zmq_msg_t part;
    uint16_t event;
    uint32_t value;

    zmq_msg_init(&part);
    while (zmq_msg_recv(&part, s->monitor, ZMQ_DONTWAIT) >= 0) {
        if (!zmq_msg_more(&part) || zmq_msg_size(&part) < sizeof event + sizeof value)
            continue;
        memcpy(&event, zmq_msg_data(&part), sizeof event);
        memcpy(&value, (const char *)zmq_msg_data(&part) + sizeof event, sizeof value);
        on_monitor_event(s, event, value);
    }
    zmq_msg_close(&part);
}

/* The key of NAME in TEXT, where a line begins NAME = "40 signs"; comments do not. */
static bool read_key(char key[KEY_SIGNS + 1], const char *text, const char *name)
{
    char of[32], mark;

    for (; text != NULL && *text != 0; text = strchr(text, '\n'), text += text != NULL)
        if (sscanf(text, " %31[a-z-] = \"%40[^\"\n]%c", of, key, &mark) == 3 && mark == '"'
            && strcmp(of, name) == 0 && strlen(key) == KEY_SIGNS)
            return true;
    return false;
}

/* Once, at the start: a host may give up the right to read them. */
static bool read_keys(modald_stream *s)
{
    static const char *const names[KEYS] = { "public-key", "secret-key", "server-key" };
    char text[1024] = "";
    struct stat st;
    int fd;
    bool good;

    if (s->keyfile == NULL)
        return true;
    fd = open(s->keyfile, O_RDONLY | O_CLOEXEC);
    good = fd >= 0 && fstat(fd, &st) == 0 && (st.st_mode & 077) == 0
        && read(fd, text, sizeof text - 1) > 0;
    for (int i = 0; good && i < KEYS; i++)
        good = read_key(s->keys[i], text, names[i]);
    explicit_bzero(text, sizeof text);
    if (fd >= 0)
        close(fd);
    return good;
}

static void *wait_at_gate(void *gate)
{
    pthread_mutex_lock(gate);
    pthread_mutex_unlock(gate);
    return NULL;
}

/* libzmq ends the process where it gets no thread or no descriptor: there are as many as it takes,
 * tried together. */
static bool may_begin(void)
{
    pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER;
    pthread_t threads[2];
    int fds[DESCRIPTORS], made = 0, opened = 0;

    pthread_mutex_lock(&gate);
    while (made < 2 && pthread_create(&threads[made], NULL, wait_at_gate, &gate) == 0)
        made++;
    while (opened < DESCRIPTORS && (fds[opened] = eventfd(0, EFD_CLOEXEC)) >= 0)
        opened++;
    pthread_mutex_unlock(&gate);
    for (int i = 0; i < made; i++)
        pthread_join(threads[i], NULL);
    for (int i = 0; i < opened; i++)
        close(fds[i]);
    return made == 2 && opened == DESCRIPTORS;
}

static bool set_options(const modald_stream *s)
{
    static const struct { int name, value; } options[] = {
        { ZMQ_LINGER, 0 },
        { ZMQ_RECONNECT_IVL, 50 }, { ZMQ_RECONNECT_IVL_MAX, 1000 },      /* ms */
        { ZMQ_SNDHWM, 64 }, { ZMQ_RCVHWM, 0 },
        /* s: a peer that is gone is found in 15, whether something is under way or not */
        { ZMQ_TCP_KEEPALIVE, 1 }, { ZMQ_TCP_KEEPALIVE_IDLE, 5 },
        { ZMQ_TCP_KEEPALIVE_INTVL, 5 }, { ZMQ_TCP_KEEPALIVE_CNT, 2 }, { ZMQ_TCP_MAXRT, 15000 },
    };
    static const int keys[KEYS] = { ZMQ_CURVE_PUBLICKEY, ZMQ_CURVE_SECRETKEY, ZMQ_CURVE_SERVERKEY };
    const size_t value = sizeof options[0].value;
    int64_t most = HEARD_MOST;
    bool good = zmq_setsockopt(s->socket, ZMQ_MAXMSGSIZE, &most, sizeof most) == 0;

    for (size_t i = 0; i < sizeof options / sizeof options[0]; i++)
        good &= zmq_setsockopt(s->socket, options[i].name, &options[i].value, value) == 0;
    for (int i = 0; i < KEYS && s->keys[i][0] != 0; i++)
        good &= zmq_setsockopt(s->socket, keys[i], s->keys[i], sizeof s->keys[i]) == 0;
    return good;
}

/* The socket's own account of its connection; it must never wait for us. */
static bool open_monitor(modald_stream *s)
{
    static const int events = ZMQ_EVENT_HANDSHAKE_SUCCEEDED | ZMQ_EVENT_DISCONNECTED
                            | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH
                            | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL, none = 0;
    char name[64];

    snprintf(name, sizeof name, "inproc://modald-%u", ++s->links);
    s->monitor = zmq_socket(s->context, ZMQ_PAIR);
    return s->monitor != NULL && zmq_socket_monitor(s->socket, name, events) == 0
        && zmq_setsockopt(s->monitor, ZMQ_LINGER, &none, sizeof none) == 0
        && zmq_setsockopt(s->monitor, ZMQ_RCVHWM, &none, sizeof none) == 0
        && zmq_connect(s->monitor, name) == 0;
}

static void close_link(modald_stream *s)
{
    if (s->socket != NULL) {
        zmq_socket_monitor(s->socket, NULL, 0);
        zmq_close(s->socket);
    }
    if (s->monitor != NULL)
        zmq_close(s->monitor);
    s->socket = s->monitor = NULL;
    s->ready = s->lost = false;
}

static bool open_link(modald_stream *s)
{
    s->socket = zmq_socket(s->context, ZMQ_DEALER);
    if (s->socket != NULL && set_options(s) && open_monitor(s)
        && zmq_connect(s->socket, s->url) == 0)
        return true;
    close_link(s);
    s->begin_at = now() + pause_most;
    return false;
}

/* Nothing more is said or heard on this link; the next begins after a pause. */
static void drop_link(modald_stream *s)
{
    reset_link(s);
    close_link(s);
    s->begin_at = now() + s->pause;
    s->pause = fmin(2 * s->pause, pause_most);
}

static bool connect_socket(modald_stream *s)
{
    if (!read_keys(s)) {
        warn_once(s, "the key file is not one of mode 0600 with three keys; "
               "the run goes on without modald");
        return false;
    }
    s->pause = pause_least;
    s->context = may_begin() ? zmq_ctx_new() : NULL;
    return s->context != NULL && open_link(s);
}

static void close_socket(modald_stream *s)
{
    close_link(s);
    if (s->context != NULL)
        zmq_ctx_term(s->context);
    s->context = NULL;
    explicit_bzero(s->keys, sizeof s->keys);
}
