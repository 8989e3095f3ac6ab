/* window_turns.h - whose window is next where there are more than workers; for windows.c */
#ifndef BROKER_WINDOW_TURNS_H
#define BROKER_WINDOW_TURNS_H
#include "broker/verbs/verbs.h"

/* Has S the samples of a window that is due? */
bool window_is_due(struct stream *s);
/* Has the worker of SLOT the window of S before? */
bool window_is_with(const struct core *c, const struct stream *s, int slot);
/* S, whose window is due, waits for a worker. */
void turn_wait(struct core *c, struct stream *s);
/* The stream whose turn it is at the worker of SLOT, which waits no more; NULL: none's. */
struct stream *turn_take(struct core *c, int slot);
/* S's window, which another worker had before or none, is the worker's of SLOT from now on. */
void turn_move(struct core *c, struct stream *s, int slot);
/* No worker is to go on with S; who has it next, has what came due of it so far, too. */
void turn_leave(struct core *c, struct stream *s);
/* The worker of SLOT has ended the window of S, which took COST_S of a processor. */
void turn_took(struct core *c, struct stream *s, int slot, double cost_s);
/* S had its latest window in ROUND, before the daemon started: who had none in it is first. */
void turn_recall(struct core *c, struct stream *s, int64_t round);
/* The worker of SLOT is gone: those that it was to go on with wait for any. */
void turns_free(struct core *c, int slot);
#endif
