/* live_events.c - see live_events.h */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "event_show.h"
#include "field.h"
#include "live_events.h"

static struct link_ask question(const struct live_events *live)
{
    cJSON *header = cJSON_CreateObject();

    cJSON_AddStringToObject(header, "stream", live->stream);
    if (live->next >= 0)
        cJSON_AddNumberToObject(header, "from", live->next);
    return (struct link_ask) { .verb = "EVENTS", .header = header };
}

/* The samples are taken all the same. */
static void refuse(struct live_events *live, const struct modal_error *err)
{
    fprintf(stderr, "modalctl: stream: live modes are not shown: %s\n", err->message);
    live->refused = true;
}

enum modal_status live_events_begin(struct live_events *live, double deadline,
                                    struct modal_error *err)
{
    struct link_ask ask = question(live);
    struct link_message answer;
    enum modal_status rc = link_question(live->link, &ask, deadline, &answer, NULL, err);

    live->subscribed = rc == MODAL_OK;
    if (rc == MODAL_BUSY) {
        refuse(live, err);
        return MODAL_OK;
    }
    if (rc != MODAL_OK)
        return rc;
    live->next = field_number(answer.header, "next", -1);
    link_message_done(&answer);
    return MODAL_OK;
}

/* The mode of least damping; NULL: none has one. */
static const cJSON *least_damped(const cJSON *event)
{
    const cJSON *mode, *least = NULL;
    double lowest = HUGE_VAL;

    cJSON_ArrayForEach(mode, field_get(event, "modes")) {
        double ratio = field_real(mode, "damping_ratio");
        if (ratio < lowest)
            lowest = ratio, least = mode;
    }
    return least;
}

/* KEY of EVENT, where it has none VALUE; null: not finite. */
static double fill(cJSON *event, const char *key, double value)
{
    if (!cJSON_HasObjectItem(event, key))
        json_set_number(event, key, value);
    return field_real(event, key);
}

/* What a host reads of a window, also from a daemon that did not tell it flat. */
static void add_flat(cJSON *event)
{
    static const char *const keys[][2] = {
        { "frequency_hz", "frequency_hz_std" }, { "damping_ratio", "damping_ratio_std" },
    };
    const cJSON *mode = least_damped(event);
    cJSON *std = cJSON_CreateObject();

    if (!cJSON_HasObjectItem(event, "verdict"))
        cJSON_AddStringToObject(event, "verdict", live_modes_verdict(event, "unknown"));
    for (int i = 0; i < 2; i++) {
        double error = field_real(field_get(mode, "std"), keys[i][0]);
        fill(event, keys[i][0], field_real(mode, keys[i][0]));
        json_set_number(std, keys[i][0], field_number(event, keys[i][1], error));
    }
    cJSON_AddItemToObject(event, "std", std);
}

static void show(struct live_events *live, cJSON *event)
{
    const bool window = strcmp(field_word(event, "event", ""), "modes") == 0;

    live->next = fmax(live->next, field_number(event, "number", -1) + 1);
    live_modes_trend(&live->modes, event);
    if (live->json && cJSON_HasObjectItem(event, "to"))
        fill(event, "sample", field_real(event, "to"));
    if (live->json && window)
        add_flat(event);
    event_show(event, live->json, NULL);
    if (window)
        live->sample = field_number(event, "to", live->sample);
}

/* Messages until DEADLINE, or the answer to question UNTIL (-1: none). */
static void read_all(struct live_events *live, double deadline, int64_t until)
{
    struct link_message message;
    struct modal_error err = { 0 };
    enum modal_status rc = MODAL_OK;
    bool answered = false;

    while (!answered) {
        rc = link_receive(live->link, deadline, &message, NULL);
        if (rc != MODAL_OK)
            break;
        answered = until >= 0 && link_message_id(&message) == until;
        if (message.type == LINK_EVENT)
            show(live, message.header);
        else if (message.type == LINK_ERROR && !answered) {
            link_error(&message, NULL, &err);
            refuse(live, &err);
        }
        link_message_done(&message);
    }
    if (!answered && rc == MODAL_NO_SERVER)
        live->subscribed = false;
}

/* The connection was lost: asked for again, nobody waiting for the answer, which comes among the
 * events.  Without a connection the next call does so. */
static void subscribe_again(struct live_events *live)
{
    struct link_ask ask = question(live);
    int64_t id;

    live->subscribed = link_send(live->link, &ask, link_now(), &id, NULL) == MODAL_OK;
}

void live_events_show(struct live_events *live)
{
    if (!live->subscribed && !live->refused)
        subscribe_again(live);
    read_all(live, 0, -1);
}

/* Messages keep their order: what was told before a question comes before its answer. */
void live_events_finish(struct live_events *live, double deadline)
{
    struct link_ask ask = { .verb = "HELLO", .header = cJSON_CreateObject() };
    int64_t id;

    if (link_send(live->link, &ask, deadline, &id, NULL) == MODAL_OK)
        read_all(live, deadline, id);
}
