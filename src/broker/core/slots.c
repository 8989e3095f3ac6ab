/* slots.c - worker processes from outside: what is sent to them, and their end */
#include "broker/core/state.h"
#include <stdlib.h>

void worker_send(struct core *c, int slot, const char *verb, cJSON *header, struct blob *body)
{
    char *text = json_print(header);

    cJSON_Delete(header);
    if (text == NULL)
        abort();
    core_act(c, (struct action) { .type = ACT_WORKER, .slot = slot, .verb = verb, .header = text, .body = body });
}

void worker_go(struct core *c, int slot)
{
    cJSON *header;
    char ident[9];

    if (c->slots[slot].job == NULL || c->slots[slot].state != SLOT_BUSY)
        return;
    c->slots[slot].parts--;
    header = cJSON_CreateObject();
    job_ident(c, c->slots[slot].job, ident);
    cJSON_AddStringToObject(header, "job", ident);
    cJSON_AddNumberToObject(header, "attempt", c->slots[slot].attempt);
    worker_send(c, slot, "GO", header, NULL);
}

void worker_kill(struct core *c, int slot)
{
    if (slot < 0 || c->slots[slot].state == SLOT_KILLED || c->slots[slot].state == SLOT_EMPTY)
        return;
    c->slots[slot].state = SLOT_KILLED;
    core_act(c, (struct action) { .type = ACT_KILL, .slot = slot });
}

/* A worker's error is text and code of this protocol, whatever it sent. */
void worker_error(const cJSON *error, struct modal_error *out)
{
    wire_error_read(error, out);
    if (out->status == MODAL_OK)
        out->status = MODAL_INTERNAL;
}
