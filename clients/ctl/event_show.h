/* event_show.h - an event as who watches reads it: one line, or its JSON */
#ifndef CTL_EVENT_SHOW_H
#define CTL_EVENT_SHOW_H
#include <stdbool.h>
#include "base/error.h"
#include "base/json.h"

/* EVENT on stdout at once, without its `subscription`, which is taken from it. Fails as
 * outcome_json does. */
enum modal_status event_show(cJSON *event, bool json, struct modal_error *err);
#endif
