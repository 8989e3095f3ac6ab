/* connection.c - see connection.h */
#include "connection.h"
#include "messages.h"
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zmq.h>

enum { PORT_MOST = 65535 };       /* 16 bits, RFC 9293 */

static void warn_all(struct link *l, const char *what)
{
    if (!l->warned)
        warn(NULL, what);
    l->warned = true;
}

/* The daemon is there, and does not let us in. */
static void warn_refused(struct link *l, uint16_t event, uint32_t value)
{
    bool keys = l->keys[0][0] != 0;

    if (event == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH)
        warn_all(l, "the daemon refused our key; the run goes on without it");
    else if (value == ZMQ_PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH)
        warn_all(l, keys ? "the daemon takes no keys (MODALD_KEYFILE); the run goes on without it"
                         : "the daemon wants a key (MODALD_KEYFILE); the run goes on without it");
}

static void begin_all_anew(struct link *l)
{
    for (int i = 0; i < l->slots; i++)
        if (l->streams[i] != NULL)
            begin_anew(l->streams[i]);
}

/* A daemon that hangs up before its reason is read gives none: the failures are counted. */
static void on_monitor_event(struct link *l, uint16_t event, uint32_t value)
{
    if (event == ZMQ_EVENT_HANDSHAKE_SUCCEEDED) {
        begin_all_anew(l);
        l->ready = true;
        l->heard_at = now();
        l->vain_until = 0;
    } else if (event == ZMQ_EVENT_DISCONNECTED) {
        l->lost = true;
        if (!l->ready && ++l->failures == FAILURES && !l->warned)
            warn(NULL, "somebody is there, but no handshake succeeds: it may want a key, or "
                       "another than ours (MODALD_KEYFILE), or be no modald; the run goes on");
    } else {
        warn_refused(l, event, value);
    }
}

static void read_monitor(struct link *l)
{
    zmq_msg_t part;
    uint16_t event;
    uint32_t value;

    zmq_msg_init(&part);
    while (zmq_msg_recv(&part, l->monitor, ZMQ_DONTWAIT) >= 0) {
        if (!zmq_msg_more(&part) || zmq_msg_size(&part) < sizeof event + sizeof value)
            continue;
        memcpy(&event, zmq_msg_data(&part), sizeof event);
        memcpy(&value, (const char *)zmq_msg_data(&part) + sizeof event, sizeof value);
        on_monitor_event(l, event, value);
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
static bool read_keys(struct link *l)
{
    static const char *const names[KEYS] = { "public-key", "secret-key", "server-key" };
    char text[1024] = "";
    struct stat st;
    int fd;
    bool good;

    if (l->keyfile == NULL)
        return true;
    fd = open(l->keyfile, O_RDONLY | O_CLOEXEC | O_NONBLOCK);       /* a FIFO makes nobody wait */
    good = fd >= 0 && fstat(fd, &st) == 0 && (st.st_mode & 077) == 0
        && read(fd, text, sizeof text - 1) > 0;
    for (int i = 0; good && i < KEYS; i++)
        good = read_key(l->keys[i], text, names[i]);
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

static bool set_options(const struct link *l)
{
    static const struct { int name, value; } options[] = {
        { ZMQ_LINGER, 0 },
        { ZMQ_RECONNECT_IVL, 50 }, { ZMQ_RECONNECT_IVL_MAX, 1000 },      /* ms */
        { ZMQ_SNDHWM, SEND_MOST }, { ZMQ_RCVHWM, 0 },
        /* s: a peer that is gone is found in 15, whether something is under way or not */
        { ZMQ_TCP_KEEPALIVE, 1 }, { ZMQ_TCP_KEEPALIVE_IDLE, 5 },
        { ZMQ_TCP_KEEPALIVE_INTVL, 5 }, { ZMQ_TCP_KEEPALIVE_CNT, 2 }, { ZMQ_TCP_MAXRT, 15000 },
    };
    static const int keys[KEYS] = { ZMQ_CURVE_PUBLICKEY, ZMQ_CURVE_SECRETKEY, ZMQ_CURVE_SERVERKEY };
    const size_t value = sizeof options[0].value;
    int64_t most = HEARD_MOST;
    bool good = zmq_setsockopt(l->socket, ZMQ_MAXMSGSIZE, &most, sizeof most) == 0;

    for (size_t i = 0; i < sizeof options / sizeof options[0]; i++)
        good &= zmq_setsockopt(l->socket, options[i].name, &options[i].value, value) == 0;
    for (int i = 0; i < KEYS && l->keys[i][0] != 0; i++)
        good &= zmq_setsockopt(l->socket, keys[i], l->keys[i], sizeof l->keys[i]) == 0;
    return good;
}

/* The socket's own account of its connection; it must never wait for us. */
static bool open_monitor(struct link *l)
{
    static const int events = ZMQ_EVENT_HANDSHAKE_SUCCEEDED | ZMQ_EVENT_DISCONNECTED
                            | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH
                            | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL, none = 0;
    char name[64];

    snprintf(name, sizeof name, "inproc://modald-%u", ++l->connections);
    l->monitor = zmq_socket(l->context, ZMQ_PAIR);
    return l->monitor != NULL && zmq_socket_monitor(l->socket, name, events) == 0
        && zmq_setsockopt(l->monitor, ZMQ_LINGER, &none, sizeof none) == 0
        && zmq_setsockopt(l->monitor, ZMQ_RCVHWM, &none, sizeof none) == 0
        && zmq_connect(l->monitor, name) == 0;
}

static void close_link(struct link *l)
{
    if (l->socket != NULL) {
        zmq_socket_monitor(l->socket, NULL, 0);
        zmq_close(l->socket);
    }
    if (l->monitor != NULL)
        zmq_close(l->monitor);
    l->socket = l->monitor = NULL;
    l->ready = l->lost = false;
    l->parts_most = 0;
    forget_together(l);
}

/* As endpoint_fault of clients/c/link.c: libzmq takes a port modulo 65536, and passes over what
 * stands behind it; what else is no endpoint it tells itself. */
static bool has_port(const char *url)
{
    const char *port = strrchr(url, ':');
    size_t digits = port != NULL ? strspn(port + 1, "0123456789") : 0;

    if (strncmp(url, "tcp://", 6) != 0)
        return true;
    return digits > 0 && port[1 + digits] == 0 && strtod(port + 1, NULL) >= 1
        && strtod(port + 1, NULL) <= PORT_MOST;
}

static bool open_link(struct link *l)
{
    l->socket = zmq_socket(l->context, ZMQ_DEALER);
    if (l->socket != NULL && has_port(l->url) && set_options(l) && open_monitor(l)
        && zmq_connect(l->socket, l->url) == 0)
        return true;
    close_link(l);
    l->begin_at = now() + pause_most;
    return false;
}

/* Nothing more is said or heard on this link; the next begins after a pause. */
static void drop_link(struct link *l)
{
    begin_all_anew(l);
    close_link(l);
    l->begin_at = now() + l->pause;
    l->pause = fmin(2 * l->pause, pause_most);
}

static void make_context(struct link *l)
{
    l->context = may_begin() ? zmq_ctx_new() : NULL;
}

static bool connect_socket(struct link *l)
{
    if (!read_keys(l)) {
        warn_all(l, "the key file is not one of mode 0600 with three keys; "
              "the run goes on without modald");
        return false;
    }
    l->pause = pause_least;
    return l->context != NULL && open_link(l);
}

static void close_socket(struct link *l)
{
    close_link(l);
    if (l->context != NULL)
        zmq_ctx_term(l->context);
    l->context = NULL;
    free(l->letter);
    l->letter = NULL;
    explicit_bzero(l->keys, sizeof l->keys);
}
