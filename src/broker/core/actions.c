/* actions.c - what the core asks for, in the order in which it does; its timers */
#include "base/log.h"
#include "broker/core/state.h"
#include <stdarg.h>
#include <stdlib.h>

void core_act(struct core *c, struct action action)
{
    if (c->out.count == c->out.room) {
        c->out.room = c->out.room ? 2 * c->out.room : 32;
        c->out.items = regrab(c->out.items, c->out.room * sizeof *c->out.items);
    }
    c->out.items[c->out.count++] = action;
}

void core_log(struct core *c, const char *format, ...)
{
    va_list args;
    char *line;

    va_start(args, format);
    line = log_vtext(format, args);
    va_end(args);
    if (line == NULL)
        abort();
    core_act(c, (struct action) { .type = ACT_LOG, .header = line });
}

void core_timer(struct core *c, int64_t when_ns, enum timer what, int64_t order, int64_t extra)
{
    void *value = (void *)(intptr_t)extra;

    if (!heap_push(&c->timers, (struct heap_item) { when_ns, order, value, what }))
        abort();
}
