/* slots.c - workers from outside, processes of ours and those elsewhere: what is sent to them,
 * and their end */
#include "broker/core/inputs.h"
#include "broker/core/jobs.h"
#include "broker/core/slots.h"
#include "wire/frame.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A worker elsewhere says BEAT three times in its lease, and a host that fails is noticed in it. */
#define REMOTE_LEASE_NS (3 * SECOND)

void worker_send(struct core *c, int slot, const char *verb, cJSON *header, struct blob *body)
{
    char *text = json_print(header);

    cJSON_Delete(header);
    if (text == NULL)
        abort();
    worker_send_text(c, slot, verb, text, body);
}

void worker_send_text(struct core *c, int slot, const char *verb, char *text, struct blob *body)
{
    const struct remote *remote = c->slots->at[slot].remote;

    core_act(c, (struct action) {
                    .type = remote != NULL ? ACT_REMOTE : ACT_WORKER, .slot = slot,
                    .peer = remote != NULL ? remote->peer : 0, .verb = verb, .header = text,
                    .body = body });
}

void worker_go(struct core *c, int slot)
{
    cJSON *header;
    char ident[9];

    if (c->slots->at[slot].job == NULL || c->slots->at[slot].state != SLOT_BUSY)
        return;
    c->slots->at[slot].parts--;
    header = cJSON_CreateObject();
    job_ident(c, c->slots->at[slot].job, ident);
    cJSON_AddStringToObject(header, "job", ident);
    cJSON_AddNumberToObject(header, "attempt", c->slots->at[slot].attempt);
    worker_send(c, slot, "GO", header, NULL);
}

/* The worker of SLOT has nothing more to say; what it said stays. */
static void slot_unhear(struct core *c, int slot)
{
    struct remote *remote = c->slots->at[slot].remote;

    if (remote->heard)
        map_remove(&c->slots->peers, map_hash_number(remote->peer), remote);
    remote->heard = false;
}

void worker_kill(struct core *c, int slot)
{
    if (slot < 0 || c->slots->at[slot].state == SLOT_KILLED
        || c->slots->at[slot].state == SLOT_EMPTY)
        return;
    slot_set(c, slot, SLOT_KILLED);
    if (!slot_is_remote(slot)) {
        core_act(c, (struct action) { .type = ACT_KILL, .slot = slot });
        return;
    }
    /* its process is another host's affair: what it still says is not heard, and it ends here */
    worker_send(c, slot, "STOP", cJSON_CreateObject(), NULL);
    slot_unhear(c, slot);
    core_timer(c, c->now.mono_ns, TIMER_END, slot, 0);
}

/* A worker's error is text and code of this protocol, whatever it sent. */
void worker_error(const cJSON *error, struct modal_error *out)
{
    wire_error_read(error, out);
    if (out->status == MODAL_OK)
        out->status = MODAL_INTERNAL;
}

bool worker_is_finishing(const struct core *c, int slot)
{
    return c->slots->at[slot].finishing;
}

int workers_busy(const struct core *c)
{
    int busy = 0;

    for (int slot = slot_after(c, -1); slot >= 0; slot = slot_after(c, slot))
        busy += c->slots->at[slot].state == SLOT_BUSY;
    return busy;
}

int workers_elsewhere(const struct core *c)
{
    int elsewhere = 0;

    for (int slot = slot_after(c, -1); slot >= 0; slot = slot_after(c, slot))
        elsewhere += c->slots->at[slot].remote != NULL;
    return elsewhere;
}

struct blob *workers_names(const struct core *c)
{
    cJSON *names = cJSON_CreateArray();
    char *text;

    for (int slot = slot_after(c, SLOTS_MOST - 1); slot >= 0; slot = slot_after(c, slot))
        if (c->slots->at[slot].remote != NULL && c->slots->at[slot].remote->heard)
            cJSON_AddItemToArray(names, cJSON_CreateString(c->slots->at[slot].remote->name));
    text = cJSON_GetArraySize(names) > 0 ? json_print(names) : NULL;
    cJSON_Delete(names);
    return text == NULL ? NULL : blob_take(text, strlen(text));
}

bool workers_idle(const struct core *c)
{
    for (int slot = slot_after(c, -1); slot >= 0; slot = slot_after(c, slot))
        if (c->slots->at[slot].job != NULL)
            return false;
    return true;
}

void slots_init(struct core *c)
{
    c->slots = grab(sizeof *c->slots);
}

void slots_done(struct core *c)
{
    for (int slot = 0; slot < SLOTS_MOST + REMOTES_MOST; slot++) {
        free(c->slots->at[slot].document);
        for (int which = 0; which < 2; which++)
            heap_done(&c->slots->at[slot].due[which].streams);
        slot_leave(c, slot);
    }
    for (int which = 0; which < 2; which++)
        heap_done(&c->slots->due[which].streams);
    map_done(&c->slots->peers);
    free(c->slots);
}

/* ---- workers elsewhere ----------------------------------------------------------------------- */

bool slot_is_remote(int slot)
{
    return slot >= SLOTS_MOST;
}

int slot_after(const struct core *c, int slot)
{
    slot++;
    if (slot >= c->slots->count && slot < SLOTS_MOST)
        slot = SLOTS_MOST;
    return slot < SLOTS_MOST + c->slots->remotes || slot < c->slots->count ? slot : -1;
}

bool slot_owes_ready(const struct slot *s)
{
    return s->state == SLOT_STARTING || s->state == SLOT_TAKEN;
}

void slot_set(struct core *c, int slot, enum slot_state state)
{
    enum slot_state *now = &c->slots->at[slot].state;

    if (slot_is_remote(slot))
        c->slots->remotes_idle += (state == SLOT_IDLE) - (*now == SLOT_IDLE);
    *now = state;
}

int64_t slot_lease_ns(const struct core *c, int slot)
{
    return slot_is_remote(slot) && c->settings.lease_ns > REMOTE_LEASE_NS ? REMOTE_LEASE_NS
                                                                           : c->settings.lease_ns;
}

int slot_of_peer(const struct core *c, uint64_t peer)
{
    const struct remote *remote = map_find_number(&c->slots->peers, peer);

    return remote == NULL ? -1 : remote->slot;
}

struct remote *slot_join(struct core *c, uint64_t peer)
{
    int slot = SLOTS_MOST;
    struct remote *remote;

    while (slot < SLOTS_MOST + REMOTES_MOST && c->slots->at[slot].state != SLOT_EMPTY)
        slot++;
    if (slot == SLOTS_MOST + REMOTES_MOST)
        return NULL;
    if (slot - SLOTS_MOST >= c->slots->remotes)
        c->slots->remotes = slot - SLOTS_MOST + 1;
    remote = grab(sizeof *remote);
    *remote = (struct remote) { .slot = slot, .peer = peer, .heard = true };
    c->slots->at[slot].remote = remote;
    c->slots->at[slot].process++;
    c->slots->at[slot].heard_ns = c->now.mono_ns;
    slot_set(c, slot, SLOT_STARTING);
    if (!map_put(&c->slots->peers, map_hash_number(peer), remote))
        abort();
    return remote;
}

void slot_leave(struct core *c, int slot)
{
    struct slot *s = &c->slots->at[slot];

    if (s->remote == NULL)
        return;
    slot_unhear(c, slot);
    slot_set(c, slot, SLOT_EMPTY);
    free(s->remote->said);
    free(s->remote);
    s->remote = NULL;
    while (c->slots->remotes > 0
           && c->slots->at[SLOTS_MOST + c->slots->remotes - 1].state == SLOT_EMPTY)
        c->slots->remotes--;
}

/* How long it is expected to run: what it may at most, where it says so, or what its user's jobs
 * take in the mean.  The daemon's own limit says nothing of a job. */
static double expected_ns(const struct job *job)
{
    return job->run_limit_ns > 0 ? (double)job->run_limit_ns : job->user->cost_s * 1e9;
}

/* Of a job that seems to have taken none: as users.c counts the shortest. */
static const double work_least_s = 1e-3;

/* A link that was slow is tried again: a large input in ten minutes is lost to it at most. */
static const int64_t link_known_ns = 600 * INT64_C(1000000000);

void slot_pulled(struct core *c, int slot, uint64_t length)
{
    struct remote *remote = c->slots->at[slot].remote;
    const uint64_t bytes = c->slots->at[slot].job->input->bytes;
    const bool was_last = remote->asked >= bytes;
    double seconds, came;

    if (remote->asked == 0)
        remote->asked_ns = c->now.mono_ns;
    remote->asked += length;
    if (!input_is_large(c->slots->at[slot].job->input) || was_last || remote->asked < bytes)
        return;
    came = (double)bytes - (double)(WIRE_PULLS_MOST * WIRE_BODY_MOST);
    seconds = fmax((double)(c->now.mono_ns - remote->asked_ns) / 1e9, 1e-9);
    remote->pull_s = seconds * (double)bytes / came;
    c->slots->link_bytes_s = came / seconds;
    c->slots->link_ns = c->now.mono_ns;
    core_log(c, "level=info event=link slot=%d name=%s mb_s=%.3g", slot, remote->name,
             c->slots->link_bytes_s / 1e6);
}

double slot_work_s_byte(const struct core *c, int slot)
{
    const struct slot *s = &c->slots->at[slot];
    const double all_s = (double)(c->now.mono_ns - s->started_ns) / 1e9,
                 pull_s = s->remote == NULL ? 0 : s->remote->pull_s;

    return input_is_large(s->job->input) && (s->remote == NULL || pull_s > 0)
               ? fmax(all_s - pull_s, work_least_s) / (double)s->job->input->bytes : 0;
}

/* A large input goes elsewhere where the link is no slower than the job: both per byte, for what a
 * job takes grows with its input as well.  Where this host has no workers there is no other way. */
bool slots_link_pays(const struct core *c, const struct user *user)
{
    const struct slots *s = c->slots;

    return c->settings.workers == 0 || s->link_ns == 0
        || c->now.mono_ns - s->link_ns > link_known_ns || user->work_s_byte <= 0
        || s->link_bytes_s * user->work_s_byte >= 1;
}

bool slot_fits(const struct core *c, int slot, const struct job *job)
{
    const struct remote *remote = c->slots->at[slot].remote;

    return remote == NULL
        || (job->input->bytes <= remote->memory
            && (!input_is_large(job->input) || slots_link_pays(c, job->user))
            && (remote->end_ns == INT64_MAX
                || expected_ns(job) <= (double)(remote->end_ns - c->now.mono_ns)));
}

/* A way that was long is tried again: a window in a minute is late by it at most. */
static const int64_t way_known_ns = 60 * INT64_C(1000000000);

bool slot_takes_windows(const struct core *c, int slot)
{
    const struct remote *remote = c->slots->at[slot].remote;
    const int64_t most_ns = c->settings.windows_elsewhere_ns;

    return remote == NULL
        || (most_ns > 0 && remote->memory >= WIRE_BODY_MOST
            && (remote->way_told_ns == 0 || remote->way_ns <= most_ns
                || c->now.mono_ns - remote->way_told_ns > way_known_ns));
}

void slot_window_back(struct core *c, int slot, double cpu_s)
{
    const struct slot *s = &c->slots->at[slot];
    const int64_t way_ns = c->now.mono_ns - s->started_ns - (int64_t)(cpu_s * 1e9);

    if (s->remote == NULL)
        return;
    s->remote->way_ns = way_ns > 0 ? way_ns : 0;
    s->remote->way_told_ns = c->now.mono_ns;
    if (way_ns > c->settings.windows_elsewhere_ns)
        core_log(c, "level=info event=far slot=%d name=%s way_ms=%.3g", slot, s->remote->name,
                 (double)way_ns / 1e6);
}
