/* service.c - see service.h
 *
 * HELLO, then EVENTS from the number after the last that is kept.  Where none is kept, or the data
 * folder is another, EVENTS from now on says what the next number is; that subscription is ended
 * for one that begins SERVICE_HISTORY events earlier, so that pictures have a past.
 */
#include "service.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/log.h"
#include "ctl/field.h"
#include "wire/protocol.h"

enum { MESSAGES_A_STEP = 256 };              /* then readers have their turn */

static const double pause_between = 0.5;     /* s from one try to the next */

static void log_edge(const struct service *s, const char *event)
{
    char *line = log_text("level=info event=%s server=\"%s\" user=\"%s\" role=%s", event, s->server,
                          s->user, s->role);

    fprintf(stderr, "%s\n", line != NULL ? line : event);
    free(line);
}

static void go_away(struct service *s)
{
    if (s->here) {
        log_edge(s, "daemon_away");
        feed_say(s->feed, "event: daemon\ndata: away\n\n");
        s->changed(s->context);
    }
    s->here = s->asking = false;
    s->ask_at = link_now() + pause_between;
}

static bool is_reply(const struct link_message *answer)
{
    return answer != NULL && answer->type == LINK_REPLY;
}

static void copy(char to[SERVICE_WORD_MOST + 1], const cJSON *from, const char *key)
{
    snprintf(to, SERVICE_WORD_MOST + 1, "%s", field_word(from, key, "-"));
}

static cJSON *events_header(const char *op)
{
    static const char *const kinds[] = { "state", "modes", "track", "alarm" };
    cJSON *header = cJSON_CreateObject(), *list;

    cJSON_AddStringToObject(header, "op", op);
    if (strcmp(op, "subscribe") == 0) {
        list = cJSON_AddArrayToObject(header, "kinds");
        for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++)
            cJSON_AddItemToArray(list, cJSON_CreateString(kinds[i]));
    }
    return header;
}

static void subscribe(struct service *s, ask_done *done, int64_t from)
{
    cJSON *header = events_header("subscribe");

    if (from >= 0)
        cJSON_AddNumberToObject(header, "from", (double)from);
    if (!ask(&s->ask, "EVENTS", header, done, s))
        go_away(s);
}

static void on_subscribed(void *context, const struct link_message *answer)
{
    struct service *s = context;

    if (!is_reply(answer)) {
        go_away(s);
        return;
    }
    copy(s->subscription, answer->header, "subscription");
    s->asking = false;
    s->here = true;
    log_edge(s, "daemon_here");
    feed_say(s->feed, "event: daemon\ndata: here\n\n");
    s->changed(s->context);
}

static void on_ended(void *context, const struct link_message *answer)
{
    (void)context, (void)answer;
}

/* The number of the next event is known: begin before it. */
static void on_next(void *context, const struct link_message *answer)
{
    struct service *s = context;
    double next = is_reply(answer) ? field_number(answer->header, "next", -1) : -1;
    cJSON *header;

    if (!(next >= 0 && next <= WIRE_INTEGER_MOST)) {
        s->store[0] = 0;                     /* what is kept is of another's numbers yet */
        go_away(s);
        return;
    }
    header = events_header("cancel");
    cJSON_AddStringToObject(header, "subscription",
                            field_word(answer->header, "subscription", ""));
    ask(&s->ask, "EVENTS", header, on_ended, s);
    feed_clear(s->feed, next > SERVICE_HISTORY ? (int64_t)next - SERVICE_HISTORY : 0);
    board_clear(&s->board);
    subscribe(s, on_subscribed, feed_first(s->feed));
}

static void on_hello(void *context, const struct link_message *answer)
{
    struct service *s = context;
    char before[SERVICE_WORD_MOST + 1];

    if (!is_reply(answer)) {
        go_away(s);
        return;
    }
    memcpy(before, s->store, sizeof before);
    copy(s->store, answer->header, "store");
    copy(s->server, answer->header, "server");
    copy(s->user, answer->header, "user");
    copy(s->role, answer->header, "role");
    if (strcmp(before, s->store) == 0)
        subscribe(s, on_subscribed, feed_number(s->feed) + 1);
    else
        subscribe(s, on_next, -1);
}

static void on_event(struct service *s, cJSON *event)
{
    if (!s->here || strcmp(field_word(event, "subscription", ""), s->subscription) != 0)
        return;
    cJSON_DeleteItemFromObjectCaseSensitive(event, "subscription");
    feed_add(s->feed, event);
    board_add(&s->board, event);
}

static bool is_ours_ended(const struct link_message *m)
{
    return m->type == LINK_ERROR && strcmp(field_word(m->header, "verb", ""), "EVENTS") == 0;
}

bool service_init(struct service *service, struct link *link)
{
    service->ask.link = link;
    service->feed = feed_new();
    return service->feed != NULL;
}

void service_done(struct service *service)
{
    ask_fail(&service->ask);
    feed_free(service->feed);
    board_clear(&service->board);
}

void service_step(struct service *s)
{
    struct link_message message;
    struct modal_error ignored;
    enum modal_status rc = MODAL_OK;
    int64_t number = feed_number(s->feed);

    for (int i = 0; i < MESSAGES_A_STEP && rc == MODAL_OK; i++) {
        rc = link_receive(s->ask.link, 0, &message, &ignored);
        if (rc != MODAL_OK)
            break;
        if (message.type == LINK_EVENT)
            on_event(s, message.header);
        else if (!ask_answer(&s->ask, &message) && is_ours_ended(&message))
            go_away(s);                       /* the key was revoked, or the like */
        link_message_done(&message);
    }
    if (rc == MODAL_NO_SERVER) {
        go_away(s);
        ask_fail(&s->ask);
        s->asking = false;
    }
    ask_expire(&s->ask);
    if (!s->here && !s->asking && link_now() >= s->ask_at) {
        s->asking = ask(&s->ask, "HELLO", cJSON_CreateObject(), on_hello, s);
        s->ask_at = link_now() + pause_between;
    }
    if (number != feed_number(s->feed))
        s->changed(s->context);
}
