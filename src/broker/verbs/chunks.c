/* chunks.c - inputs to workers elsewhere, which pull them piece by piece at their own pace: the
 * daemon keeps nothing of it but a count */
#include "base/crc32c.h"
#include "broker/core/jobs.h"
#include "broker/core/slots.h"
#include "broker/verbs/verbs.h"
#include "wire/frame.h"
#include <math.h>

const char *piece_request(struct core *c, int slot, const struct wire_message *m)
{
    struct slot *s = &c->slots->at[slot];
    double offset = -1, length = -1;
    struct task *task;

    if (m->body_count != 0
        || json_need_number(m->header, "", "offset", 0, WIRE_INTEGER_MOST, &offset, NULL)
               != MODAL_OK
        || json_need_number(m->header, "", "length", 1, WIRE_BODY_MOST, &length, NULL) != MODAL_OK
        || offset != floor(offset) || length != floor(length))
        return "INPUT without its place";
    if (s->remote->pulls == WIRE_PULLS_MOST)
        return "more INPUTs than may wait for their CHUNK";
    task = input_piece(s->job->input, (uint64_t)offset, (uint64_t)length);
    if (task == NULL)
        return "INPUT of bytes that there are not";
    s->remote->pulls++;
    slot_pulled(c, slot, (uint64_t)length);
    task->after = after_new(AFTER_PIECE, NULL);
    task->after->value = s->job->id;
    task->after->attempts = s->attempt;
    task->after->length = slot;
    core_task(c, task, user_turn(s->job->user, 0));
    return NULL;
}

/* Nobody waits for it where the job has another attempt, or is over. */
void piece_read(struct core *c, struct task *task)
{
    const struct after *after = task->after;
    const int slot = (int)after->length;
    struct slot *s = &c->slots->at[slot];
    cJSON *header;
    char ident[IDENT_TEXT];

    sums_keep(c, task);
    if (s->remote == NULL || s->job == NULL || s->job->id != after->value
        || s->attempt != after->attempts || s->state != SLOT_BUSY)
        return;
    s->remote->pulls--;
    header = cJSON_CreateObject();
    job_ident(c, s->job, ident);
    cJSON_AddStringToObject(header, "job", ident);
    cJSON_AddNumberToObject(header, "attempt", s->attempt);
    cJSON_AddNumberToObject(header, "offset", (double)task->offset);
    if (task->status != MODAL_OK) {
        cJSON_AddItemToObject(header, "error", wire_error_object(&task->err, NULL));
        worker_send(c, slot, "CHUNK", header, NULL);
        return;
    }
    cJSON_AddNumberToObject(header, "crc32c", crc32c(0, task->text->data, task->text->size));
    worker_send(c, slot, "CHUNK", header, blob_share(task->text));
}
