/* leave.h - when a worker on another host is to go: asked to, idle for too long, or its time over
 *
 * Times are in ms of the caller's monotonic clock.  Whoever goes finishes the job that it has, as
 * far as the grace lets it; then it gives the job back.
 */
#ifndef WORKER_LEAVE_H
#define WORKER_LEAVE_H
#include <stdbool.h>
#include <stdint.h>

struct leave_options {
    int64_t idle_ms, until_ms;    /* without a job; of its whole time; 0: no limit */
    int64_t grace_ms;             /* for the job that it has, from then on */
};

struct leave {
    struct leave_options options;
    int64_t begun_ms, idle_since_ms;
    int64_t going_ms;             /* when it was to go; 0: not yet */
    const char *why;              /* RELEASE's "why" */
    bool given;                   /* it has a job */
    bool left;                    /* LEAVE or RELEASE was sent */
};

enum leave_act { LEAVE_NOTHING, LEAVE_SAY, LEAVE_RELEASE };

/* The life begins, without a job. */
void leave_init(struct leave *leave, const struct leave_options *options, int64_t now_ms);
/* It has a job (GIVEN), or is ready for one. */
void leave_given(struct leave *leave, bool given, int64_t now_ms);
/* What is to be sent now; ASKED: a signal has come. */
enum leave_act leave_next(struct leave *leave, bool asked, int64_t now_ms);
/* Seconds that are left at NOW_MS; below 0: no limit. */
double leave_left_s(const struct leave *leave, int64_t now_ms);

#endif
