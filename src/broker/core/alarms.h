/* alarms.h - what the modes of live windows must not do: damping below a limit, growth, a mode
 * that was not there */
#ifndef BROKER_ALARMS_H
#define BROKER_ALARMS_H
#include <stdint.h>
#include "base/error.h"
#include "base/json.h"

struct alarms;

/*
 * RULES: {"damping_below"?:z, "growth"?:bool, "new_mode"?:bool}.  WINDOW: samples of a live
 * window.  The caller frees *out with alarms_free; NULL where RULES asks for nothing.  Fails with
 * MODAL_BAD_INPUT, the field below `window.alarms`.
 */
enum modal_status alarms_new(const cJSON *rules, uint64_t window, struct alarms **out,
                             struct modal_error *err);
/* Accepts NULL. */
void alarms_free(struct alarms *a);

/* All is forgotten: another epoch.  Accepts NULL. */
void alarms_reset(struct alarms *a);

/*
 * The window of samples FROM to TO gave DOCUMENT, borrowed: {"modes","stability"}.  An array of
 * what is raised or cleared by it, the caller's:
 * {"rule","state":"raised"|"cleared","limit"?,"mode"?:{"track","frequency_hz","damping_ratio",
 * "std":{…}}};
 * NULL: nothing.  A NULL only.
 */
cJSON *alarms_judge(struct alarms *a, uint64_t from, uint64_t to, const cJSON *document);
#endif
