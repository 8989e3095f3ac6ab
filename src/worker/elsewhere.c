/* elsewhere.c - see elsewhere.h */
#include "worker/elsewhere.h"
#include <errno.h>
#include <netdb.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>
#include <zmq.h>
#include "base/json.h"
#include "wire/frame.h"

enum {
    CREDIT_MOST = 64,      /* that is believed: of the largest pieces 64 MiB under way */
    LEASE_MOST_S = 3600,   /* as the daemon's configuration has it */
    HIGH_BYTE = 8,         /* bits of a little-endian event's number below it */
};

/* ---- where ----------------------------------------------------------------------------------- */

enum modal_status elsewhere_find(const char *from, char *to, size_t size, struct modal_error *err)
{
    const struct addrinfo wanted = { .ai_socktype = SOCK_STREAM };
    const char *colon = strrchr(from, ':');
    const char *host = from + strlen("tcp://");
    char name[256], number[64];
    struct addrinfo *found = NULL;
    size_t length;
    int error;

    if (strncmp(from, "tcp://", 6) != 0 || colon <= host || (size_t)(colon - host) >= sizeof name)
        return modal_fail_field(err, MODAL_BAD_INPUT, "connect",
                                "\"%.200s\"; accepted with --keyfile: tcp://HOST:PORT", from);
    length = (size_t)(colon - host);
    if (host[0] == '[' && host[length - 1] == ']') {
        host++;
        length -= 2;
    }
    snprintf(name, sizeof name, "%.*s", (int)length, host);
    error = getaddrinfo(name, NULL, &wanted, &found);
    if (error == 0)
        error = getnameinfo(found->ai_addr, found->ai_addrlen, number, sizeof number, NULL, 0,
                            NI_NUMERICHOST);
    if (error != 0) {
        if (found != NULL)
            freeaddrinfo(found);
        return modal_fail(err, MODAL_NO_SERVER, "worker: %s: %s", name, gai_strerror(error));
    }
    snprintf(to, size, found->ai_family == AF_INET6 ? "tcp://[%s]%s" : "tcp://%s%s", number, colon);
    freeaddrinfo(found);
    return MODAL_OK;
}

/* Without what a name may not have. */
static void add_word(char *out, size_t size, const char *word)
{
    size_t length = strlen(out);

    for (; *word != 0 && length + 1 < size; word++)
        out[length++] = (unsigned char)*word > 0x20 && (unsigned char)*word < 0x7f ? *word : '_';
    out[length] = 0;
}

void elsewhere_name(struct elsewhere_options *out)
{
    const char *node = getenv("SLURMD_NODENAME"), *job = getenv("SLURM_ARRAY_JOB_ID");
    const char *task = getenv("SLURM_ARRAY_TASK_ID");
    char host[64] = "", text[160];

    gethostname(host, sizeof host - 1);
    add_word(out->node, sizeof out->node, node != NULL ? node : host);
    if (job == NULL)
        job = getenv("SLURM_JOB_ID");
    if (job != NULL)
        snprintf(text, sizeof text, "%.60s%s%.30s", job, task != NULL ? "_" : "",
                 task != NULL ? task : "");
    else
        snprintf(text, sizeof text, "%.60s.%d", host, (int)getpid());
    add_word(out->name, sizeof out->name, text);
}

/* ---- keys ------------------------------------------------------------------------------------ */

enum modal_status elsewhere_keys(const char *path, struct elsewhere_options *out,
                                 struct modal_error *err)
{
    enum modal_status rc = keyfile_read(path, &out->keys, err);

    return rc != MODAL_OK || out->keys.server[0] != 0
               ? rc
               : modal_fail_field(err, MODAL_BAD_INPUT, "keyfile",
                                  "%s has no server-key; accepted: a file made by modalctl keygen "
                                  "FILE SERVER-KEY", path);
}

enum modal_status elsewhere_guard(void *dealer, struct elsewhere_options *options,
                                  struct modal_error *err)
{
    const int yes = 1, often_ms = 1000, silent_ms = 10000;
    const struct keyfile *keys = &options->keys;
    enum modal_status rc = MODAL_OK;

    if (zmq_setsockopt(dealer, ZMQ_CURVE_SERVERKEY, keys->server, 40) != 0
        || zmq_setsockopt(dealer, ZMQ_CURVE_PUBLICKEY, keys->public, 40) != 0
        || zmq_setsockopt(dealer, ZMQ_CURVE_SECRETKEY, keys->secret, 40) != 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "keyfile", "a key in it is no key");
    keyfile_wipe(&options->keys);
    zmq_setsockopt(dealer, ZMQ_IPV6, &yes, sizeof yes);
    zmq_setsockopt(dealer, ZMQ_HEARTBEAT_IVL, &often_ms, sizeof often_ms);
    zmq_setsockopt(dealer, ZMQ_HEARTBEAT_TIMEOUT, &silent_ms, sizeof silent_ms);
    return rc;
}

enum modal_status elsewhere_monitor(void *context, void *dealer, void **out,
                                    struct modal_error *err)
{
    const int events = ZMQ_EVENT_DISCONNECTED | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH
                       | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL
                       | ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL;
    const int none = 0;

    if (zmq_socket_monitor(dealer, "inproc://monitor", events) == 0)
        *out = zmq_socket(context, ZMQ_PAIR);
    if (*out == NULL || zmq_setsockopt(*out, ZMQ_LINGER, &none, sizeof none) != 0
        || zmq_connect(*out, "inproc://monitor") != 0)
        return modal_fail(err, MODAL_INTERNAL, "worker: monitor: %s", zmq_strerror(errno));
    return MODAL_OK;
}

/* ---- JOIN ------------------------------------------------------------------------------------ */

/* The event that MONITOR has: a refusal, or the end. */
static enum modal_status ended(void *monitor, struct modal_error *err)
{
    unsigned char event[2] = { 0 };
    const int got = zmq_recv(monitor, event, sizeof event, ZMQ_DONTWAIT);
    const int what = event[0] | event[1] << HIGH_BYTE;

    if (got >= 2 && what == ZMQ_EVENT_DISCONNECTED)
        return modal_fail(err, MODAL_NO_SERVER, "worker: the daemon ended the connection");
    return modal_fail(err, MODAL_DENIED, "worker: the daemon does not admit this key here: a key "
                      "of role worker is wanted, at an endpoint of worker_bind");
}

static enum modal_status send_join(void *dealer, const struct elsewhere_options *options,
                                   double left_s, struct modal_error *err)
{
    cJSON *header = cJSON_CreateObject();
    char *text;
    bool sent;

    cJSON_AddStringToObject(header, "version", MODALD_VERSION);
    cJSON_AddStringToObject(header, "name", options->name);
    cJSON_AddStringToObject(header, "node", options->node);
    cJSON_AddNumberToObject(header, "memory_bytes", (double)options->memory);
    if (left_s >= 0)
        cJSON_AddNumberToObject(header, "left_s", left_s);
    text = json_print(header);
    cJSON_Delete(header);
    sent = text != NULL
           && zmq_send_const(dealer, WIRE_WORKER, strlen(WIRE_WORKER), ZMQ_SNDMORE) >= 0
           && zmq_send_const(dealer, "JOIN", 4, ZMQ_SNDMORE) >= 0
           && zmq_send(dealer, text, strlen(text), 0) >= 0;
    free(text);
    return sent ? MODAL_OK
                : modal_fail(err, MODAL_NO_SERVER, "worker: JOIN: %s", zmq_strerror(errno));
}

static enum modal_status read_welcome(const struct wire_message *m, struct elsewhere *out,
                                      struct modal_error *err)
{
    double lease_s = 0;
    enum modal_status rc;

    if (strcmp(m->verb, "NO") == 0) {
        wire_error_read(cJSON_GetObjectItemCaseSensitive(m->header, "error"), err);
        return err->status != MODAL_OK ? err->status : MODAL_INTERNAL;
    }
    if (strcmp(m->verb, "WELCOME") != 0)
        return modal_fail(err, MODAL_BAD_FRAME, "worker: the daemon answers JOIN with %s", m->verb);
    rc = json_need_number(m->header, "", "lease_s", 0.1, LEASE_MOST_S, &lease_s, err);
    if (rc == MODAL_OK)
        rc = json_get_int(m->header, "", "credit", 1, CREDIT_MOST, &out->credit, err);
    if (rc == MODAL_OK)
        rc = json_get_int(m->header, "", "chunk", 1, WIRE_BODY_MOST, &out->chunk, err);
    out->lease_ms = (int)(lease_s * 1000);
    return rc;
}

static enum modal_status receive(void *dealer, struct elsewhere *out, struct modal_error *err)
{
    zmq_msg_t parts[WIRE_FRAMES_LEAST];
    struct wire_frame frames[WIRE_FRAMES_LEAST];
    struct wire_message message;
    enum modal_status rc;
    int count = 0, more = 1;

    while (more) {
        zmq_msg_t part;
        zmq_msg_init(&part);
        if (zmq_msg_recv(&part, dealer, 0) < 0)
            break;
        more = zmq_msg_more(&part);
        if (count < WIRE_FRAMES_LEAST)
            parts[count++] = part;
        else
            zmq_msg_close(&part);
    }
    for (int i = 0; i < count; i++)
        frames[i] = (struct wire_frame) { zmq_msg_data(&parts[i]), zmq_msg_size(&parts[i]) };
    rc = wire_open(frames, count, WIRE_WORKER, false, &message, err);
    if (rc == MODAL_OK)
        rc = read_welcome(&message, out, err);
    wire_close(&message);
    while (count > 0)
        zmq_msg_close(&parts[--count]);
    return rc;
}

enum modal_status elsewhere_join(void *dealer, void *monitor,
                                 const struct elsewhere_options *options, double left_s,
                                 int wait_ms, struct elsewhere *out, struct modal_error *err)
{
    zmq_pollitem_t items[2] = { { dealer, 0, ZMQ_POLLOUT, 0 }, { monitor, 0, ZMQ_POLLIN, 0 } };
    enum modal_status rc = MODAL_OK;

    *out = (struct elsewhere) { .credit = 1, .chunk = WIRE_BODY_MOST };
    for (int turn = 0; rc == MODAL_OK && turn < 2; turn++) {
        if (zmq_poll(items, 2, wait_ms) < 1)
            rc = modal_fail(err, MODAL_NO_SERVER, "worker: nobody answers");
        else if (items[1].revents != 0)
            rc = ended(monitor, err);
        else if (turn == 0)
            rc = send_join(dealer, options, left_s, err);
        else
            rc = receive(dealer, out, err);
        items[0].events = ZMQ_POLLIN;
    }
    return rc;
}
