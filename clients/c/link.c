/* link.c - see link.h
 *
 * A DEALER with ZMQ_IMMEDIATE: what is sent goes to a finished connection or waits here.  The socket's monitor says
 * when a connection is ready and when it is lost; `generation` counts the losses, so that a question knows whether the
 * connection it was sent on still stands.
 */
#include "link.h"
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include <zmq.h>
#include "keyfile.h"
#include "wire/limits.h"

static const double first_patience = 2;      /* s: nobody there at the start */
static const double lost_patience = 30;      /* s: a daemon that was there comes back in this time */
static const double usual_patience = 5;      /* s: no answer, ask again */

struct link {
    void *context, *socket, *monitor;
    char *endpoint;
    bool ready, was_ready, refused;
    unsigned generation;                     /* connections lost */
    unsigned told;                           /* losses that link_receive has reported */
    double since;                            /* of the connection's absence */
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

static enum modal_status set_keys(struct link *link, const char *path, struct modal_error *err)
{
    struct keyfile keys;
    enum modal_status rc;

    if (path == NULL)
        path = getenv("MODALD_KEYFILE");
    if (path == NULL || path[0] == 0)
        return MODAL_OK;
    rc = keyfile_read(path, &keys, err);
    if (rc == MODAL_OK && (keys.server[0] == 0 || zmq_setsockopt(link->socket, ZMQ_CURVE_SERVERKEY, keys.server, strlen(keys.server) + 1) != 0
                           || zmq_setsockopt(link->socket, ZMQ_CURVE_PUBLICKEY, keys.public, strlen(keys.public) + 1) != 0
                           || zmq_setsockopt(link->socket, ZMQ_CURVE_SECRETKEY, keys.secret, strlen(keys.secret) + 1) != 0))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "keyfile", "%s: accepted: a key file with public, secret and server keys", path);
    keyfile_wipe(&keys);
    return rc;
}

static void set_options(void *socket)
{
    static const struct { int name, value; } options[] = {
        { ZMQ_LINGER, 0 }, { ZMQ_IMMEDIATE, 1 }, { ZMQ_RECONNECT_IVL, 50 }, { ZMQ_RECONNECT_IVL_MAX, 1000 },
        { ZMQ_HEARTBEAT_IVL, 5000 }, { ZMQ_HEARTBEAT_TIMEOUT, 15000 }, { ZMQ_SNDHWM, 256 }, { ZMQ_RCVHWM, 4096 },
    };
    int64_t most = WIRE_BODY_MOST;

    for (size_t i = 0; i < sizeof options / sizeof options[0]; i++)
        zmq_setsockopt(socket, options[i].name, &options[i].value, sizeof options[i].value);
    zmq_setsockopt(socket, ZMQ_MAXMSGSIZE, &most, sizeof most);
}

/* The socket's own account of its connection, over inproc. */
static bool open_monitor(struct link *link)
{
    static const int events = ZMQ_EVENT_HANDSHAKE_SUCCEEDED | ZMQ_EVENT_DISCONNECTED | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH
                            | ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL;
    static const int none = 0;
    char name[64];

    snprintf(name, sizeof name, "inproc://monitor-%p", (void *)link);
    link->monitor = zmq_socket(link->context, ZMQ_PAIR);
    return link->monitor != NULL && zmq_socket_monitor(link->socket, name, events) == 0
        && zmq_setsockopt(link->monitor, ZMQ_LINGER, &none, sizeof none) == 0 && zmq_connect(link->monitor, name) == 0;
}

enum modal_status link_open(const char *endpoint, const char *keyfile, struct link **out, struct modal_error *err)
{
    struct link *link = calloc(1, sizeof *link);
    enum modal_status rc = MODAL_OK;

    if (link == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory for a connection");
    link->since = link_now();
    link->next_id = 1;
    link->endpoint = endpoint ? strdup(endpoint) : default_endpoint();
    link->context = zmq_ctx_new();
    link->socket = link->context ? zmq_socket(link->context, ZMQ_DEALER) : NULL;
    if (link->endpoint == NULL || link->socket == NULL || !open_monitor(link)) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "no socket: %s", zmq_strerror(errno));
        goto out;
    }
    set_options(link->socket);
    rc = set_keys(link, keyfile, err);
    if (rc == MODAL_OK && zmq_connect(link->socket, link->endpoint) != 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "server", "%.200s: %s; accepted: ipc://PATH or tcp://HOST:PORT", link->endpoint, zmq_strerror(errno));
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
    if (link->socket != NULL) {
        zmq_socket_monitor(link->socket, NULL, 0);
        zmq_close(link->socket);
    }
    if (link->monitor != NULL)
        zmq_close(link->monitor);
    if (link->context != NULL)
        zmq_ctx_term(link->context);
    free(link->endpoint);
    free(link);
}

const char *link_endpoint(const struct link *link)
{
    return link->endpoint;
}

/* Take in what the monitor has to say. */
static void listen(struct link *link)
{
    zmq_msg_t frame;
    uint16_t event;

    zmq_msg_init(&frame);
    while (zmq_msg_recv(&frame, link->monitor, ZMQ_DONTWAIT) >= 0) {
        bool first = zmq_msg_more(&frame) && zmq_msg_size(&frame) >= 6;
        memcpy(&event, zmq_msg_data(&frame), first ? sizeof event : 0);
        if (!first)
            continue;
        if (event == ZMQ_EVENT_HANDSHAKE_SUCCEEDED) {
            link->ready = link->was_ready = true;
        } else if (event == ZMQ_EVENT_DISCONNECTED) {
            link->generation += link->ready;
            link->since = link->ready ? link_now() : link->since;
            link->ready = false;
        } else if (event == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH) {
            link->refused = true;
        }
    }
    zmq_msg_close(&frame);
}

/* Sleep until something happens, at most SECONDS. */
static void sleep_on(struct link *link, double seconds)
{
    zmq_pollitem_t items[] = { { link->socket, 0, ZMQ_POLLIN, 0 }, { link->monitor, 0, ZMQ_POLLIN, 0 } };
    double ms = ceil(1000 * seconds);

    zmq_poll(items, 2, ms < 0 ? 0 : ms > 1e6 ? 1000000 : (long)ms);
    listen(link);
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
static void take_frame(int count, zmq_msg_t *frame, struct link_message *out, bool *good)
{
    const char *data = zmq_msg_data(frame);
    size_t length = zmq_msg_size(frame);
    struct modal_error ignored;

    switch (count) {
    case 0:
        *good = length == strlen(WIRE_VERSION) && memcmp(data, WIRE_VERSION, length) == 0;
        break;
    case 1:
        out->type = length == 5 && memcmp(data, "REPLY", 5) == 0 ? LINK_REPLY : length == 5 && memcmp(data, "EVENT", 5) == 0 ? LINK_EVENT : LINK_ERROR;
        break;
    case 2:
        *good = *good && json_read(data, length, &out->header, &ignored) == MODAL_OK;
        break;
    case 3:
        out->body = malloc(length + 1);
        if (out->body != NULL) {
            memcpy(out->body, data, length);
            out->body[length] = 0;
            out->length = length;
        }
        break;
    }
}

/* One message if there is one; what is no message of the protocol is dropped. */
static bool receive_now(struct link *link, struct link_message *out)
{
    zmq_msg_t frame;
    bool good = false, more = true;
    int count = 0;

    *out = (struct link_message) { 0 };
    zmq_msg_init(&frame);
    while (more && zmq_msg_recv(&frame, link->socket, ZMQ_DONTWAIT) >= 0) {
        more = zmq_msg_more(&frame);
        take_frame(count++, &frame, out, &good);
    }
    zmq_msg_close(&frame);
    if (good && out->header != NULL)
        return true;
    link_message_done(out);
    return false;
}

int64_t link_message_id(const struct link_message *message)
{
    const cJSON *id = cJSON_GetObjectItemCaseSensitive(message->header, "id");

    return cJSON_IsNumber(id) ? (int64_t)id->valuedouble : -1;
}

enum modal_status link_error(const struct link_message *message, cJSON **detail, struct modal_error *err)
{
    const cJSON *error = cJSON_GetObjectItemCaseSensitive(message->header, "error");
    const char *code = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(error, "code"));
    const char *text = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(error, "message"));
    const char *field = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(error, "field"));
    const cJSON *more = cJSON_GetObjectItemCaseSensitive(error, "detail");

    if (detail != NULL && more != NULL)
        *detail = cJSON_Duplicate(more, true);
    return modal_fail_field(err, modal_status_from_code(code), field ? field : "", "%s", text ? text : "the daemon gave no reason");
}

/* Has nobody been there for too long to go on hoping? */
static bool given_up(const struct link *link, double now)
{
    if (link->ready)
        return false;
    return link->was_ready ? now > link->since + lost_patience : link->refused || now > link->since + first_patience;
}

bool link_lost(const struct link *link)
{
    return given_up(link, link_now());
}

static enum modal_status nobody(const struct link *link, struct modal_error *err)
{
    if (link->refused)
        return modal_fail(err, MODAL_DENIED, "%s: our key was refused", link->endpoint);
    return modal_fail(err, MODAL_NO_SERVER, "no modald at %s; start one, name another with --server or $MODALD_URL, or use --local", link->endpoint);
}

/* HEADER, which is freed, as text with the next id; the caller frees it. */
static enum modal_status header_text(struct link *link, cJSON *header, int64_t *id, char **out, struct modal_error *err)
{
    char *text;

    *id = link->next_id++;
    cJSON_DeleteItemFromObjectCaseSensitive(header, "id");
    cJSON_AddNumberToObject(header, "id", (double)*id);
    text = json_print(header);
    cJSON_Delete(header);
    if (text == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory for a message");
    if (strlen(text) > WIRE_HEADER_MOST) {
        size_t length = strlen(text);
        free(text);
        return modal_fail_field(err, MODAL_TOO_LARGE, "header", "options, names and attributes are %zu bytes of a message; accepted: at most %d",
                                length, WIRE_HEADER_MOST);
    }
    *out = text;
    return MODAL_OK;
}

enum modal_status link_send(struct link *link, const struct link_ask *ask, double deadline, int64_t *id, struct modal_error *err)
{
    char *header;
    enum modal_status rc = header_text(link, ask->header, id, &header, err);

    if (rc != MODAL_OK)
        return rc;
    listen(link);
    while (!send_now(link, ask, header)) {
        double now = link_now();
        if (given_up(link, now)) {
            rc = nobody(link, err);
            break;
        }
        if (now >= deadline) {
            rc = link->ready ? modal_fail(err, MODAL_TIMEOUT, "%s takes no more messages", link->endpoint) : nobody(link, err);
            break;
        }
        sleep_on(link, fmin(deadline - now, link->ready ? 0.002 : 0.1));
    }
    free(header);
    return rc;
}

enum modal_status link_receive(struct link *link, double deadline, struct link_message *out, struct modal_error *err)
{
    for (;;) {
        listen(link);
        if (receive_now(link, out))
            return MODAL_OK;
        if (link->told != link->generation) {
            link->told = link->generation;
            return modal_fail(err, MODAL_NO_SERVER, "%s: the connection was lost", link->endpoint);
        }
        double now = link_now();
        if (now >= deadline)
            return modal_fail(err, MODAL_TIMEOUT, "%s: nothing came in time", link->endpoint);
        sleep_on(link, fmin(deadline - now, 1));
    }
}

struct sending { bool sent; unsigned generation; double at; };

/* Bring the question on its way, once a connection; false: it may not be asked again. */
static bool keep_asking(struct link *link, const struct link_ask *ask, const char *header, struct sending *state)
{
    double patience = ask->patience > 0 ? ask->patience : usual_patience, now = link_now();
    bool lost = state->sent && (state->generation != link->generation || now > state->at + patience);

    if (lost && ask->once)
        return state->generation == link->generation;
    if ((!state->sent || lost) && send_now(link, ask, header))
        *state = (struct sending) { true, link->generation, now };
    return true;
}

/* An error whose id is null answers a header that could not be read: ours, the only one on its way. */
static bool is_of_nobody(const struct link_message *message)
{
    return message->type == LINK_ERROR && cJSON_IsNull(cJSON_GetObjectItemCaseSensitive(message->header, "id"));
}

static enum modal_status wait_answer(struct link *link, const struct link_ask *ask, const char *header, int64_t id, double deadline,
                                     struct link_message *out, struct modal_error *err)
{
    struct sending state = { 0 };

    for (;;) {
        listen(link);
        if (!keep_asking(link, ask, header, &state))
            return modal_fail(err, MODAL_NO_SERVER, "%s: the connection was lost before the answer; the job may have been accepted or not", link->endpoint);
        while (receive_now(link, out)) {
            if (out->type != LINK_EVENT && (link_message_id(out) == id || is_of_nobody(out)))
                return MODAL_OK;
            link_message_done(out);             /* a late answer to what was given up */
        }
        double now = link_now();
        if (given_up(link, now))
            return nobody(link, err);
        if (now >= deadline)
            return link->ready ? modal_fail(err, MODAL_TIMEOUT, "%s: no answer to %s in time", link->endpoint, ask->verb) : nobody(link, err);
        sleep_on(link, fmin(deadline - now, state.sent ? 1 : 0.05));
    }
}

enum modal_status link_question(struct link *link, const struct link_ask *ask, double deadline, struct link_message *out,
                                cJSON **detail, struct modal_error *err)
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
