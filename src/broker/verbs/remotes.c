/*
 * remotes.c - workers elsewhere: who joins, and who is not heard any more
 *
 * A worker on another host is a slot as one of ours is; it begins with JOIN, by a key of role
 * worker that is asked for with each message and each reload, and ends with its connection, its
 * lease or its leave.  Its name is for people: two may have the same.
 */
#include "base/utf8.h"
#include "broker/core/slots.h"
#include "broker/verbs/verbs.h"
#include "wire/frame.h"
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double LEFT_MOST_S = 1e9;     /* thirty years: as good as for ever */

static void tell(struct core *c, uint64_t peer, const char *verb, cJSON *header)
{
    char *text = json_print(header);

    cJSON_Delete(header);
    if (text == NULL)
        abort();
    core_act(c, (struct action) {
                    .type = ACT_REMOTE, .slot = -1, .peer = peer, .verb = verb, .header = text });
}

static void refuse(struct core *c, uint64_t peer, const struct modal_error *err)
{
    cJSON *header = cJSON_CreateObject();

    core_log(c, "level=notice event=worker_refused code=%s message=\"%s\"",
             modal_status_code(err->status), err->message);
    cJSON_AddItemToObject(header, "error", wire_error_object(err, NULL));
    tell(c, peer, "NO", header);
}

/* A text of HEADER that stands in documents and lines. */
static enum modal_status need_name(const cJSON *header, const char *key, char out[NAME_MOST],
                                   struct modal_error *err)
{
    const char *text = NULL, *end;
    enum modal_status rc = json_need_string(header, "", key, &text, err);

    if (rc != MODAL_OK)
        return rc;
    end = utf8_control(text);
    if (*end != 0 || strchr(text, ' ') != NULL || end == text || end - text >= NAME_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, key,
                                "%s is no name; accepted: 1 to %d bytes without spaces or control "
                                "characters", key, NAME_MOST - 1);
    snprintf(out, NAME_MOST, "%s", text);
    return MODAL_OK;
}

/* What JOIN's HEADER says, into OUT. */
static enum modal_status read_join(const struct core *c, const cJSON *header, struct remote *out,
                                   struct modal_error *err)
{
    const char *version = NULL;
    double memory = 0, left_s = -1;
    enum modal_status rc = json_need_string(header, "", "version", &version, err);

    if (rc == MODAL_OK && strcmp(version, MODALD_VERSION) != 0)
        rc = modal_fail_field(err, MODAL_BAD_VERSION, "version",
                              "version is \"%.40s\"; accepted: %s, the daemon's own, for the same "
                              "numbers everywhere", version, MODALD_VERSION);
    if (rc == MODAL_OK)
        rc = need_name(header, "name", out->name, err);
    if (rc == MODAL_OK)
        rc = need_name(header, "node", out->node, err);
    if (rc == MODAL_OK)
        rc = json_need_number(header, "", "memory_bytes", 0, WIRE_INTEGER_MOST, &memory, err);
    if (rc == MODAL_OK)
        rc = json_get_number(header, "", "left_s", 0, LEFT_MOST_S, &left_s, err);
    out->memory = (uint64_t)memory;
    out->end_ns = left_s < 0 ? INT64_MAX : c->now.mono_ns + (int64_t)(left_s * 1e9);
    return rc;
}

static void welcome(struct core *c, const struct remote *remote)
{
    cJSON *header = cJSON_CreateObject();

    cJSON_AddNumberToObject(header, "lease_s", (double)slot_lease_ns(c, remote->slot) / 1e9);
    cJSON_AddStringToObject(header, "store", c->settings.store_id);
    cJSON_AddNumberToObject(header, "chunk", WIRE_BODY_MOST);
    cJSON_AddNumberToObject(header, "credit", WIRE_PULLS_MOST);
    tell(c, remote->peer, "WELCOME", header);
}

static void join(struct core *c, const struct event *e)
{
    struct remote said = { 0 }, *remote;
    struct modal_error err;

    if (read_join(c, e->message->header, &said, &err) != MODAL_OK) {
        refuse(c, e->peer, &err);
        return;
    }
    remote = c->terminating ? NULL : slot_join(c, e->peer);
    if (remote == NULL) {
        modal_fail(&err, MODAL_BUSY, "%d workers have joined, which is the most, or the daemon is "
                   "stopping", c->slots->remotes);
        refuse(c, e->peer, &err);
        return;
    }
    memcpy(remote->name, said.name, sizeof remote->name);
    memcpy(remote->node, said.node, sizeof remote->node);
    snprintf(remote->key, sizeof remote->key, "%s", e->key);
    remote->memory = said.memory;
    remote->end_ns = said.end_ns;
    core_log(c, "level=notice event=worker_joined slot=%d name=%s node=%s", remote->slot,
             remote->name, remote->node);
    welcome(c, remote);
    worker_watch(c, remote->slot);
}

void remote_message(struct core *c, const struct event *e)
{
    const bool joins = e->message != NULL && strcmp(e->message->verb, "JOIN") == 0;
    struct event own = *e;
    struct modal_error err;

    own.slot = slot_of_peer(c, e->peer);
    if (!key_is_worker(c, e->key)) {
        modal_fail(&err, MODAL_DENIED, "this key is not, or no longer, a worker's");
        if (own.slot >= 0)
            worker_dismiss(c, own.slot);
        if (own.slot >= 0 || joins)
            refuse(c, e->peer, &err);
    } else if (own.slot >= 0)
        worker_message(c, &own);
    else if (joins)
        join(c, e);
}

void remotes_revoke(struct core *c)
{
    for (int slot = slot_after(c, SLOTS_MOST - 1); slot >= 0; slot = slot_after(c, slot)) {
        const struct remote *remote = c->slots->at[slot].remote;

        if (remote != NULL && remote->heard && !key_is_worker(c, remote->key))
            worker_dismiss(c, slot);
    }
}

void remote_gone(struct core *c, uint64_t peer)
{
    int slot = slot_of_peer(c, peer);

    if (slot >= 0)
        worker_exit(c, slot, SIGKILL, c->slots->at[slot].remote->said);
}
