/*
 * room.c - whether the disk is full: what was refused for want of it, and until when
 *
 * The gauge is up from the first refusal until there is room for what was refused, asked for once
 * a second, or something was stored since.
 */
#include "broker/core/state.h"

/* Something was refused for want of BYTES of disk.  The log tells the edges, the metrics the
 * state in between. */
void room_want(struct core *c, uint64_t bytes)
{
    c->disk.found = false;
    c->disk.wanted = bytes > c->disk.wanted ? bytes : c->disk.wanted;
    if (c->disk.full)
        return;
    c->disk.full = true;
    core_log(c, "level=warning event=storage_full needed=%llu "
             "message=\"submissions are refused for want of disk\"",
             (unsigned long long)bytes);
    core_timer(c, c->now.mono_ns + SECOND, TIMER_ROOM, 0, 0);
}

void room_ask(struct core *c)
{
    core_task(c, task_new(TASK_ROOM, 0), TURN_NOBODY);
}

void room_told(struct core *c, const struct task *task)
{
    bool enough = task->status == MODAL_OK && task->total >= c->disk.wanted;

    if (!enough && !c->disk.found) {
        core_timer(c, c->now.mono_ns + SECOND, TIMER_ROOM, 0, 0);
        return;
    }
    c->disk.full = c->disk.found = false;
    c->disk.wanted = 0;
    core_log(c, "level=notice event=storage_room free=%llu", (unsigned long long)task->total);
}

uint64_t task_bytes(const struct task *task)
{
    return task->type == TASK_RESULT_PUT ? task->text->size
         : task->type != TASK_BEGIN && task->type != TASK_STREAM_SEAL ? 0
         : input_bytes(&task->shape);
}

/* An input larger than what is free, on a disk with room for others, makes no full disk. */
void room_judge(struct core *c, const struct task *task)
{
    uint64_t bytes = task_bytes(task);

    if (task->status == MODAL_STORAGE_FULL && task->total < RESERVE_BYTES)
        room_want(c, bytes < RESERVE_BYTES ? bytes : RESERVE_BYTES);
    else if (task->status == MODAL_OK && task->type == TASK_BEGIN)
        c->disk.found = true;
}

bool room_is_full(const struct core *c)
{
    return c->now.mono_ns < c->disk.full_until;
}
