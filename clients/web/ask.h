/* ask.h - questions to the daemon that do not wait: each is told its answer, or that none came */
#ifndef WEB_ASK_H
#define WEB_ASK_H
#include "link.h"

enum {
    ASK_MOST = 256,          /* questions in flight: as many as visitors */
    ASK_PATIENCE_S = 4,      /* without an answer, which takes milliseconds: it is away */
};

/* ANSWER is a REPLY or an ERROR, borrowed; NULL: none came. */
typedef void ask_done(void *context, const struct link_message *answer);

struct asking { int64_t id; double until; ask_done *done; void *context; };
struct ask { struct link *link; struct asking asking[ASK_MOST]; int count; };

/* Ask VERB with HEADER, which is taken over; DONE is told once, never before ask() returns true.
 * False: it cannot be asked now, for the daemon is away or too much is in flight. */
bool ask(struct ask *ask, const char *verb, cJSON *header, ask_done *done, void *context);
/* Tell whose question MESSAGE answers; false: it is of none of them. */
bool ask_answer(struct ask *ask, const struct link_message *message);
/* Tell those who have waited too long that there is no answer. */
void ask_expire(struct ask *ask);
/* Tell all that there is none: the connection was lost, or we end. */
void ask_fail(struct ask *ask);
#endif
