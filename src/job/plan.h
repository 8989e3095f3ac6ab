/* plan.h - `plan` of every job on a scene: class, states, integrator, hash, and each effect with
 * what it cost */
#ifndef JOB_PLAN_H
#define JOB_PLAN_H
#include "base/json.h"
#include "modal/scene/program.h"

/*
 * {"class", "states", "integrator", "hash", "effects": [{"type", "states", "evaluations",
 * "seconds", "active"}]}, effects in the scene's order.  `seconds` is evaluations times the unit
 * cost of the effect's laws, measured here on this machine (once per effect that was evaluated).
 */
cJSON *plan_print(const struct program *p, const char *integrator);

struct craig_bampton;

/* "reduction": {"kept", "modes", "highest", "next"} of R into PLAN; NULL: nothing. */
void plan_add_reduction(cJSON *plan, const struct craig_bampton *r);

#endif
