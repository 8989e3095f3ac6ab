/* leave.c - see leave.h */
#include "worker/leave.h"
#include <stddef.h>

void leave_init(struct leave *leave, const struct leave_options *options, int64_t now_ms)
{
    *leave = (struct leave) { .options = *options, .begun_ms = now_ms, .idle_since_ms = now_ms };
}

void leave_given(struct leave *leave, bool given, int64_t now_ms)
{
    leave->given = given;
    leave->idle_since_ms = now_ms;
}

/* RELEASE's "why" at NOW_MS; NULL: it stays. */
static const char *reason(const struct leave *leave, bool asked, int64_t now_ms)
{
    const struct leave_options *o = &leave->options;

    if (asked)
        return "preempted";
    if (o->until_ms > 0 && now_ms - leave->begun_ms >= o->until_ms)
        return "walltime";
    return !leave->given && o->idle_ms > 0 && now_ms - leave->idle_since_ms >= o->idle_ms ? "drain"
                                                                                          : NULL;
}

enum leave_act leave_next(struct leave *leave, bool asked, int64_t now_ms)
{
    if (leave->why == NULL) {
        leave->why = reason(leave, asked, now_ms);
        leave->going_ms = now_ms;
    }
    if (leave->why == NULL || leave->left
        || (leave->given && now_ms - leave->going_ms < leave->options.grace_ms))
        return LEAVE_NOTHING;
    leave->left = true;
    return leave->given ? LEAVE_RELEASE : LEAVE_SAY;
}

double leave_left_s(const struct leave *leave, int64_t now_ms)
{
    const int64_t end_ms = leave->begun_ms + leave->options.until_ms;

    if (leave->options.until_ms == 0)
        return -1;
    return end_ms > now_ms ? (double)(end_ms - now_ms) / 1000 : 0;
}
