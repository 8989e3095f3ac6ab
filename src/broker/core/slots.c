/* slots.c - worker processes from outside: what is sent to them, and their end */
#include "broker/core/jobs.h"
#include "broker/core/slots.h"
#include "wire/frame.h"
#include <stdlib.h>

void worker_send(struct core *c, int slot, const char *verb, cJSON *header, struct blob *body)
{
    char *text = json_print(header);

    cJSON_Delete(header);
    if (text == NULL)
        abort();
    core_act(c, (struct action) {
                    .type = ACT_WORKER, .slot = slot, .verb = verb, .header = text, .body = body });
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

void worker_kill(struct core *c, int slot)
{
    if (slot < 0 || c->slots->at[slot].state == SLOT_KILLED
        || c->slots->at[slot].state == SLOT_EMPTY)
        return;
    c->slots->at[slot].state = SLOT_KILLED;
    core_act(c, (struct action) { .type = ACT_KILL, .slot = slot });
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

    for (int slot = 0; slot < c->slots->count; slot++)
        busy += c->slots->at[slot].state == SLOT_BUSY;
    return busy;
}

bool workers_idle(const struct core *c)
{
    for (int slot = 0; slot < c->slots->count; slot++)
        if (c->slots->at[slot].job != NULL)
            return false;
    return true;
}

void slots_init(struct core *c)
{
    c->slots = grab(sizeof *c->slots);
    c->slots->due_end = c->slots->round_end = &c->slots->due;
}

void slots_done(struct core *c)
{
    for (int slot = 0; slot < SLOTS_MOST; slot++)
        free(c->slots->at[slot].document);
    free(c->slots);
}
