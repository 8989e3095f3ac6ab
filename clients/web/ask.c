/* ask.c - see ask.h */
#include "ask.h"

bool ask(struct ask *ask, const char *verb, cJSON *header, ask_done *done, void *context)
{
    struct link_ask question = { .verb = verb, .header = header };
    struct modal_error ignored;
    int64_t id;

    if (ask->count == ASK_MOST) {
        cJSON_Delete(header);
        return false;
    }
    if (link_send(ask->link, &question, 0, &id, &ignored) != MODAL_OK)
        return false;
    ask->asking[ask->count++] = (struct asking) { id, link_now() + ASK_PATIENCE_S, done, context };
    return true;
}

/* Out of the list first: who is told may ask again. */
static void tell(struct ask *ask, int i, const struct link_message *answer)
{
    struct asking a = ask->asking[i];

    ask->asking[i] = ask->asking[--ask->count];
    a.done(a.context, answer);
}

bool ask_answer(struct ask *ask, const struct link_message *message)
{
    int64_t id = link_message_id(message);

    for (int i = 0; message->type != LINK_EVENT && i < ask->count; i++)
        if (ask->asking[i].id == id) {
            tell(ask, i, message);
            return true;
        }
    return false;
}

void ask_expire(struct ask *ask)
{
    double now = link_now();

    for (int i = ask->count - 1; i >= 0; i--)
        if (i < ask->count && ask->asking[i].until < now)
            tell(ask, i, NULL);
}

void ask_fail(struct ask *ask)
{
    for (int i = ask->count; i > 0 && ask->count > 0; i--)
        tell(ask, 0, NULL);
}
