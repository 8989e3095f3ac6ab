/* link.c - see link.h
 *
 * A DEALER to which nothing is given before its connection is ready.  The socket's monitor says
 * when that is, when it is lost, and why there was none; a lost connection ends its socket, and the
 * next has one of its own.  `generation` counts the losses, so that a question knows whether the
 * connection it was sent on still stands.
 *
 * As in modald_stream.c, no server may reach an assertion of libzmq's: input never stops
 * (ZMQ_RCVHWM 0), no heartbeat is ours, no pipe is taken away (no ZMQ_IMMEDIATE); a server that
 * says more than we take is hung up on.
 */
#include "link.h"
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include <zmq.h>
#include "wire/keyfile.h"
#include "wire/protocol.h"

static const double first_patience = 2;      /* s: nobody there at the start */
static const double lost_patience = 30;      /* s: in which a daemon that was there comes back */
static const double usual_patience = 5;      /* s: no answer, ask again */

static const double pause_least = 0.05, pause_most = 1;      /* s between two connections */

enum {
    BACKLOG_MOST = 67108864,                 /* bytes without a silence: the largest document's */
    PORT_MOST = 65535,                       /* 16 bits, RFC 9293 */
    MESSAGE_COST = 64,                       /* of a frame in libzmq's pipe, beside its bytes */
};

struct link {
    void *context, *socket, *monitor;        /* socket NULL: between two connections */
    char *endpoint;
    struct keyfile keys;                     /* "": none */
    bool ready, was_ready;
    bool lost, broken;                       /* broken: libzmq does not connect again by itself */
    enum { NOTHING, KEY_REFUSED, MECHANISM, HANDSHAKE } failure;   /* of the last try */
    unsigned sockets;                        /* made so far */
    unsigned generation;                     /* connections lost */
    unsigned told;                           /* losses that link_receive has reported */
    double since;                            /* of the connection's absence */
    double begin_at, pause;                  /* when the next socket is made; the pause */
    size_t heard;                            /* bytes since nothing was there to hear */
    bool deaf;                               /* a message was passed over for want of memory */
    int64_t next_id;
};

double link_now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

void link_message_done(struct link_message *message)
{
    cJSON_Delete(message->header);
    free(message->body);
    *message = (struct link_message) { 0 };
}

static char *default_endpoint(void)
{
    const char *url = getenv("MODALD_URL"), *runtime = getenv("XDG_RUNTIME_DIR");
    char *endpoint = NULL;

    if (url != NULL && url[0] != 0)
        return strdup(url);
    if (runtime != NULL && runtime[0] != 0 && access("/run/modald/modald.ipc", F_OK) != 0)
        return asprintf(&endpoint, "ipc://%s/modald/modald.ipc", runtime) < 0 ? NULL : endpoint;
    return strdup("ipc:///run/modald/modald.ipc");
}

static enum modal_status read_keys(struct link *link, const char *path, struct modal_error *err)
{
    enum modal_status rc;

    if (path == NULL)
        path = getenv("MODALD_KEYFILE");
    if (path == NULL || path[0] == 0)
        return MODAL_OK;
    rc = keyfile_read(path, &link->keys, err);
    if (rc == MODAL_OK && (!link->keys.public[0] || !link->keys.secret[0] || !link->keys.server[0]))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "keyfile",
                              "%s: accepted: a key file with public, secret and server keys", path);
    return rc;
}

static bool set_keys(const struct link *link)
{
    const struct keyfile *k = &link->keys;

    return zmq_setsockopt(link->socket, ZMQ_CURVE_SERVERKEY, k->server, sizeof k->server) == 0
        && zmq_setsockopt(link->socket, ZMQ_CURVE_PUBLICKEY, k->public, sizeof k->public) == 0
        && zmq_setsockopt(link->socket, ZMQ_CURVE_SECRETKEY, k->secret, sizeof k->secret) == 0;
}

static void set_options(void *socket)
{
    static const struct { int name, value; } options[] = {
        { ZMQ_LINGER, 0 },
        { ZMQ_RECONNECT_IVL, 50 }, { ZMQ_RECONNECT_IVL_MAX, 1000 },      /* ms */
        { ZMQ_SNDHWM, 256 }, { ZMQ_RCVHWM, 0 },
        /* s: a peer that is gone is found in 15, whether something is under way or not */
        { ZMQ_TCP_KEEPALIVE, 1 }, { ZMQ_TCP_KEEPALIVE_IDLE, 5 },
        { ZMQ_TCP_KEEPALIVE_INTVL, 5 }, { ZMQ_TCP_KEEPALIVE_CNT, 2 }, { ZMQ_TCP_MAXRT, 15000 },
    };
    int64_t most = WIRE_BODY_MOST;

    for (size_t i = 0; i < sizeof options / sizeof options[0]; i++)
        zmq_setsockopt(socket, options[i].name, &options[i].value, sizeof options[i].value);
    zmq_setsockopt(socket, ZMQ_MAXMSGSIZE, &most, sizeof most);
}

/* The socket's own account of its connection, over inproc; it must never wait for us. */
static bool open_monitor(struct link *link)
{
    static const int events = ZMQ_EVENT_HANDSHAKE_SUCCEEDED | ZMQ_EVENT_DISCONNECTED
                            | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH | ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL
                            | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL;
    static const int none = 0;
    char name[64];

    snprintf(name, sizeof name, "inproc://monitor-%u", ++link->sockets);
    link->monitor = zmq_socket(link->context, ZMQ_PAIR);
    return link->monitor != NULL && zmq_socket_monitor(link->socket, name, events) == 0
        && zmq_setsockopt(link->monitor, ZMQ_LINGER, &none, sizeof none) == 0
        && zmq_setsockopt(link->monitor, ZMQ_RCVHWM, &none, sizeof none) == 0
        && zmq_connect(link->monitor, name) == 0;
}

static void close_socket(struct link *link)
{
    if (link->socket != NULL) {
        zmq_socket_monitor(link->socket, NULL, 0);
        zmq_close(link->socket);
    }
    if (link->monitor != NULL)
        zmq_close(link->monitor);
    link->socket = link->monitor = NULL;
    link->lost = link->broken = false;
    link->heard = 0;
}

/* What ENDPOINT is not that one is; NULL: libzmq may be asked, which takes ports modulo 65536. */
static const char *endpoint_fault(const char *endpoint)
{
    const char *port = strrchr(endpoint, ':');
    size_t digits = port != NULL ? strspn(port + 1, "0123456789") : 0;

    if (strncmp(endpoint, "ipc://", 6) == 0)
        return endpoint[6] != 0 ? NULL : "has no path";
    if (strncmp(endpoint, "tcp://", 6) != 0)
        return "begins with neither ipc:// nor tcp://";
    if (digits == 0 || port[1 + digits] != 0 || !(strtod(port + 1, NULL) <= PORT_MOST)
        || strtod(port + 1, NULL) < 1)
        return "ends in no port of 1 to 65535";
    return NULL;
}

/* A socket on its way to the endpoint; MODAL_BAD_INPUT: it is none. */
static enum modal_status open_socket(struct link *link, struct modal_error *err)
{
    const char *fault = endpoint_fault(link->endpoint);
    enum modal_status rc = MODAL_OK;

    link->socket = zmq_socket(link->context, ZMQ_DEALER);
    if (link->socket == NULL || !open_monitor(link)) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "no socket: %s", zmq_strerror(errno));
        goto out;
    }
    set_options(link->socket);
    if (fault != NULL)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "server", "\"%.200s\" %s; accepted: ipc://PATH "
                              "or tcp://HOST:PORT", link->endpoint, fault);
    else if (link->keys.server[0] != 0 && !set_keys(link))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "keyfile", "a key in it is no key");
    else if (zmq_connect(link->socket, link->endpoint) != 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "server",
                              "%.200s: %s; accepted: ipc://PATH or tcp://HOST:PORT",
                              link->endpoint, zmq_strerror(errno));
out:
    if (rc != MODAL_OK)
        close_socket(link);
    return rc;
}

enum modal_status link_open(const char *endpoint, const char *keyfile, struct link **out,
                            struct modal_error *err)
{
    struct link *link = calloc(1, sizeof *link);
    enum modal_status rc;

    if (link == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory for a connection");
    link->since = link_now();
    link->next_id = 1;
    link->pause = pause_least;
    link->endpoint = endpoint ? strdup(endpoint) : default_endpoint();
    link->context = zmq_ctx_new();
    if (link->endpoint == NULL || link->context == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "no socket: %s", zmq_strerror(errno));
        goto out;
    }
    rc = read_keys(link, keyfile, err);
    if (rc == MODAL_OK)
        rc = open_socket(link, err);
out:
    if (rc == MODAL_OK)
        *out = link;
    else
        link_close(link);
    return rc;
}

void link_close(struct link *link)
{
    if (link == NULL)
        return;
    close_socket(link);
    if (link->context != NULL)
        zmq_ctx_term(link->context);
    keyfile_wipe(&link->keys);
    free(link->endpoint);
    free(link);
}

const char *link_endpoint(const struct link *link)
{
    return link->endpoint;
}

/* What came on this connection is heard, or shall not be: its socket ends with it. */
static void renew(struct link *link)
{
    close_socket(link);
    link->begin_at = link_now() + link->pause;
    link->pause = fmin(2 * link->pause, pause_most);
}

static void on_monitor_event(struct link *link, uint16_t event, uint32_t value)
{
    switch (event) {
    case ZMQ_EVENT_HANDSHAKE_SUCCEEDED:
        link->ready = link->was_ready = true;
        link->failure = NOTHING;
        break;
    case ZMQ_EVENT_DISCONNECTED:
        link->generation += link->ready;
        link->since = link->ready ? link_now() : link->since;
        link->lost |= link->ready || link->broken;
        link->ready = false;
        break;
    case ZMQ_EVENT_HANDSHAKE_FAILED_AUTH:
        link->failure = KEY_REFUSED;
        link->broken = true;
        break;
    case ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL:
        link->failure = value == ZMQ_PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH ? MECHANISM : HANDSHAKE;
        link->broken = true;
        break;
    case ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL:
        link->failure = HANDSHAKE;
        break;
    }
}

/* Take in what the monitor has to say; begin the next connection when it is time. */
static void read_monitor(struct link *link)
{
    struct modal_error ignored;
    zmq_msg_t frame;
    uint16_t event;
    uint32_t value;

    if (link->socket == NULL && link_now() >= link->begin_at
        && open_socket(link, &ignored) != MODAL_OK)
        link->begin_at = link_now() + pause_most;
    if (link->socket == NULL)
        return;
    zmq_msg_init(&frame);
    while (zmq_msg_recv(&frame, link->monitor, ZMQ_DONTWAIT) >= 0) {
        if (!zmq_msg_more(&frame) || zmq_msg_size(&frame) < sizeof event + sizeof value)
            continue;
        memcpy(&event, zmq_msg_data(&frame), sizeof event);
        memcpy(&value, (const char *)zmq_msg_data(&frame) + sizeof event, sizeof value);
        on_monitor_event(link, event, value);
    }
    zmq_msg_close(&frame);
}

void link_sleep(struct link *link, int fd, double seconds)
{
    double s = fmin(fmax(seconds, 0), 1000);
    zmq_pollitem_t items[] = {
        { NULL, fd, ZMQ_POLLIN, 0 },
        { link->socket, 0, ZMQ_POLLIN, 0 }, { link->monitor, 0, ZMQ_POLLIN, 0 }
    };
    int first = fd < 0;

    if (link->socket == NULL)
        s = fmin(s, fmax(link->begin_at - link_now(), 0));
    zmq_poll(items + first, (link->socket != NULL ? 3 : 1) - first, (long)ceil(1000 * s));
    read_monitor(link);
}

static bool send_frame(struct link *link, const void *data, size_t length, int flags)
{
    return zmq_send(link->socket, data, length, flags | ZMQ_DONTWAIT) >= 0;
}

/* All frames or none: once the first is accepted the others are. */
static bool send_now(struct link *link, const struct link_ask *ask, const char *header)
{
    if (!link->ready || !send_frame(link, WIRE_VERSION, strlen(WIRE_VERSION), ZMQ_SNDMORE))
        return false;
    return send_frame(link, ask->verb, strlen(ask->verb), ZMQ_SNDMORE)
        && send_frame(link, header, strlen(header), ask->body ? ZMQ_SNDMORE : 0)
        && (ask->body == NULL || send_frame(link, ask->body, ask->length, 0));
}

/* Frame COUNT of a message into what it is; frames that do not belong are dropped. */
static void read_frame(struct link *link, int count, zmq_msg_t *frame, struct link_message *out,
                       bool *good)
{
    const char *data = zmq_msg_data(frame);
    size_t length = zmq_msg_size(frame);
    struct modal_error ignored;
    enum modal_status rc;

    switch (count) {
    case 0:
        *good = length == strlen(WIRE_VERSION) && memcmp(data, WIRE_VERSION, length) == 0;
        break;
    case 1:
        out->type = length == 5 && memcmp(data, "REPLY", 5) == 0 ? LINK_REPLY
                  : length == 5 && memcmp(data, "EVENT", 5) == 0 ? LINK_EVENT
                                                                 : LINK_ERROR;
        break;
    case 2:
        rc = json_read(data, length, &out->header, &ignored);
        *good = *good && rc == MODAL_OK;
        link->deaf |= rc == MODAL_NO_MEMORY;
        break;
    case 3:
        out->body = malloc(length + 1);
        if (out->body != NULL) {
            memcpy(out->body, data, length);
            out->body[length] = 0;
            out->length = length;
        }
        *good = *good && out->body != NULL;
        link->deaf |= out->body == NULL;
        break;
    }
}

/* The next message's frames, into OUT as far as they are of the protocol; how many there are. */
static int receive_frames(struct link *link, struct link_message *out, bool *good)
{
    zmq_msg_t frame;
    bool more = true;
    int count = 0;

    zmq_msg_init(&frame);
    while (more && link->heard <= BACKLOG_MOST
           && zmq_msg_recv(&frame, link->socket, ZMQ_DONTWAIT) >= 0) {
        more = zmq_msg_more(&frame);
        link->heard += MESSAGE_COST + zmq_msg_size(&frame);
        read_frame(link, count++, &frame, out, good);
    }
    zmq_msg_close(&frame);
    return count;
}

/* The server says more than we take: the connection is lost by our own doing. */
static void hang_up(struct link *link)
{
    on_monitor_event(link, ZMQ_EVENT_DISCONNECTED, 0);
    link->pause = pause_most;
    renew(link);
}

/* One message if there is one; what is no message of the protocol is passed over. */
static bool receive_now(struct link *link, struct link_message *out)
{
    bool good = false;

    *out = (struct link_message) { 0 };
    while (link->socket != NULL && receive_frames(link, out, &good) > 0) {
        if (link->heard > BACKLOG_MOST) {
            hang_up(link);
        } else if (good && out->header != NULL) {
            link->pause = pause_least;
            return true;
        }
        link_message_done(out);
        good = false;
    }
    link->heard = 0;
    if (link->lost)
        renew(link);
    return false;
}

int64_t link_message_id(const struct link_message *message)
{
    const cJSON *id = cJSON_GetObjectItemCaseSensitive(message->header, "id");

    bool good = cJSON_IsNumber(id) && fabs(id->valuedouble) <= WIRE_INTEGER_MOST;

    return good ? (int64_t)id->valuedouble : -1;
}

enum modal_status link_error(const struct link_message *message, cJSON **detail,
                             struct modal_error *err)
{
    const cJSON *error = cJSON_GetObjectItemCaseSensitive(message->header, "error");
    const char *code = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(error, "code"));
    const char *text = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(error, "message"));
    const char *field = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(error, "field"));
    const cJSON *more = cJSON_GetObjectItemCaseSensitive(error, "detail");

    if (detail != NULL && more != NULL)
        *detail = cJSON_Duplicate(more, true);
    return modal_fail_field(err, modal_status_from_code(code), field ? field : "", "%s",
                            text ? text : "the daemon gave no reason");
}

/* Is the endpoint a socket of this host that we may not open? */
static bool is_closed_to_us(const struct link *link)
{
    const char *path = strncmp(link->endpoint, "ipc://", 6) == 0 ? link->endpoint + 6 : "@";

    return *path != '@' && faccessat(AT_FDCWD, path, W_OK, AT_EACCESS) != 0 && errno == EACCES;
}

/* Has nobody been there for too long to go on hoping? */
static bool given_up(const struct link *link, double now)
{
    if (link->ready)
        return false;
    if (link->was_ready)
        return now > link->since + lost_patience;
    return link->failure == KEY_REFUSED || link->failure == MECHANISM
        || now > link->since + first_patience || is_closed_to_us(link);
}

bool link_lost(const struct link *link)
{
    return given_up(link, link_now());
}

static enum modal_status denied_by_mode(const struct link *link, struct modal_error *err)
{
    char buffer[1024];
    struct group group, *found = NULL;
    struct stat st;

    if (stat(link->endpoint + 6, &st) != 0)
        return modal_fail(err, MODAL_DENIED, "%.200s: permission denied: a folder on "
                          "its way is closed to us", link->endpoint);
    if (getgrgid_r(st.st_gid, &group, buffer, sizeof buffer, &found) != 0)
        found = NULL;
    return modal_fail(err, MODAL_DENIED, "%.200s: permission denied: the socket has mode %03o and "
                      "group %s; ipc_mode of the daemon and being of that group let one in",
                      link->endpoint, (unsigned)st.st_mode & 0777,
                      found != NULL ? group.gr_name : "unknown");
}

/* Why there is no connection. */
static enum modal_status nobody(const struct link *link, struct modal_error *err)
{
    static const char none[] = "no modald at %.200s; start one, name another with --server or "
                               "$MODALD_URL, or use --local";
    static const struct { enum modal_status rc; const char *text; } why[4][2] = {
        /* without keys, with */
        [NOTHING] = { { MODAL_NO_SERVER, none }, { MODAL_NO_SERVER, none } },
        [KEY_REFUSED] = {
            { MODAL_DENIED, "%.200s: the daemon refused us" },
            { MODAL_DENIED, "%.200s: our key was refused: the daemon's keys file "
                            "does not have it" },
        },
        [MECHANISM] = {
            { MODAL_DENIED, "%.200s: the daemon wants a key: --keyfile or $MODALD_KEYFILE names a "
                            "file that modalctl keygen made" },
            { MODAL_DENIED, "%.200s: the daemon takes no keys: leave out --keyfile "
                            "and $MODALD_KEYFILE" },
        },
        [HANDSHAKE] = {
            { MODAL_NO_SERVER, "%.200s: somebody is there, but no modald, or one that wants a key "
                               "(--keyfile, $MODALD_KEYFILE)" },
            { MODAL_DENIED, "%.200s: somebody is there, but does not answer to our keys: "
                            "server-key in the key file is another daemon's, or the daemon takes "
                            "no keys" },
        },
    };
    bool keys = link->keys.server[0] != 0;

    if (is_closed_to_us(link))
        return denied_by_mode(link, err);
    return modal_fail(err, why[link->failure][keys].rc, why[link->failure][keys].text,
                      link->endpoint);
}

/* HEADER, which is freed, as text with the next id; the caller frees it. */
static enum modal_status header_text(struct link *link, cJSON *header, int64_t *id, char **out,
                                     struct modal_error *err)
{
    char *text;

    *id = link->next_id++;
    cJSON_DeleteItemFromObjectCaseSensitive(header, "id");
    json_put_number(header, "id", (double)*id);
    text = header != NULL ? json_print(header) : NULL;
    cJSON_Delete(header);
    if (text == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory for a message");
    if (strlen(text) > WIRE_HEADER_MOST) {
        size_t length = strlen(text);
        free(text);
        return modal_fail_field(
            err, MODAL_TOO_LARGE, "header",
            "options, names and attributes are %zu bytes of a message; accepted: at most %d",
            length, WIRE_HEADER_MOST);
    }
    *out = text;
    return MODAL_OK;
}

enum modal_status link_send(struct link *link, const struct link_ask *ask, double deadline,
                            int64_t *id, struct modal_error *err)
{
    char *header;
    enum modal_status rc = header_text(link, ask->header, id, &header, err);

    if (rc != MODAL_OK)
        return rc;
    read_monitor(link);
    while (!send_now(link, ask, header)) {
        double now = link_now();
        if (given_up(link, now)) {
            rc = nobody(link, err);
            break;
        }
        if (now >= deadline) {
            rc = link->ready
                   ? modal_fail(err, MODAL_TIMEOUT, "%s takes no more messages", link->endpoint)
                   : nobody(link, err);
            break;
        }
        if (link->lost)
            renew(link);
        link_sleep(link, -1, fmin(deadline - now, link->ready ? 0.002 : 0.1));
    }
    free(header);
    return rc;
}

/* Whether a message was passed over for want of memory; it is told once. */
static bool was_deaf(struct link *link, struct modal_error *err)
{
    bool deaf = link->deaf;

    link->deaf = false;
    if (deaf)
        modal_fail(err, MODAL_NO_MEMORY, "no memory for what %s says; what it was asked for may be "
                   "done or not", link->endpoint);
    return deaf;
}

enum modal_status link_receive(struct link *link, double deadline, struct link_message *out,
                               struct modal_error *err)
{
    for (;;) {
        read_monitor(link);
        if (receive_now(link, out))
            return MODAL_OK;
        if (was_deaf(link, err))
            return MODAL_NO_MEMORY;
        if (link->told != link->generation) {
            link->told = link->generation;
            return modal_fail(err, MODAL_NO_SERVER, "%s: the connection was lost", link->endpoint);
        }
        double now = link_now();
        if (now >= deadline)
            return modal_fail(err, MODAL_TIMEOUT, "%s: nothing came in time", link->endpoint);
        link_sleep(link, -1, fmin(deadline - now, 1));
    }
}

struct sending { bool sent; unsigned generation; double at; };

/* Bring the question on its way, once a connection; false: it may not be asked again. */
static bool keep_asking(struct link *link, const struct link_ask *ask, const char *header,
                        struct sending *state)
{
    double patience = ask->patience > 0 ? ask->patience : usual_patience, now = link_now();
    bool lost = state->sent
             && (state->generation != link->generation || now > state->at + patience);

    if (lost && ask->once)
        return state->generation == link->generation;
    if ((!state->sent || lost) && send_now(link, ask, header))
        *state = (struct sending) { true, link->generation, now };
    return true;
}

/* An error whose id is null answers a header that could not be read: ours, the one on its way. */
static bool is_of_nobody(const struct link_message *message)
{
    return message->type == LINK_ERROR
        && cJSON_IsNull(cJSON_GetObjectItemCaseSensitive(message->header, "id"));
}

static enum modal_status wait_answer(struct link *link, const struct link_ask *ask,
                                     const char *header, int64_t id, double deadline,
                                     struct link_message *out, struct modal_error *err)
{
    struct sending state = { 0 };

    for (;;) {
        read_monitor(link);
        while (receive_now(link, out)) {
            if (out->type != LINK_EVENT && (link_message_id(out) == id || is_of_nobody(out)))
                return MODAL_OK;
            link_message_done(out);             /* a late answer to what was given up */
        }
        if (was_deaf(link, err))
            return MODAL_NO_MEMORY;
        if (!keep_asking(link, ask, header, &state))
            return modal_fail(err, MODAL_NO_SERVER, "%s: the connection was lost before the "
                              "answer; the job may have been accepted or not", link->endpoint);
        double now = link_now();
        if (given_up(link, now))
            return nobody(link, err);
        if (now >= deadline)
            return link->ready ? modal_fail(err, MODAL_TIMEOUT, "%s: no answer to %s in time",
                                            link->endpoint, ask->verb)
                               : nobody(link, err);
        link_sleep(link, -1, fmin(deadline - now, state.sent ? 1 : 0.05));
    }
}

enum modal_status link_question(struct link *link, const struct link_ask *ask, double deadline,
                                struct link_message *out, cJSON **detail, struct modal_error *err)
{
    int64_t id;
    char *header;
    enum modal_status rc = header_text(link, ask->header, &id, &header, err);

    if (rc != MODAL_OK)
        return rc;
    rc = wait_answer(link, ask, header, id, deadline, out, err);
    free(header);
    if (rc == MODAL_OK && out->type == LINK_ERROR) {
        rc = link_error(out, detail, err);
        link_message_done(out);
    }
    return rc;
}
