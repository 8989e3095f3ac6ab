/* torus_job.h - kind `steady` under several tones: its options checked, its document printed */
#ifndef JOB_TORUS_JOB_H
#define JOB_TORUS_JOB_H
#include <stdbool.h>
#include "base/error.h"
#include "base/json.h"

struct cost;
struct program;
struct steady_settings;
struct torus_point;

/* Options that are of one period: MODAL_BAD_INPUT, field the option. */
enum modal_status torus_check(const struct steady_settings *s, struct modal_error *err);
/* Whether two of the tones are the same. */
bool torus_alike(const struct steady_settings *s);
/* P's steady state under SETTINGS' tones, begun at START, NULL: at rest; NEAR: of its branch; as
 * torus_solve. */
enum modal_status torus_at(struct program *p, const struct steady_settings *settings,
                           const struct torus_point *start, bool near, struct torus_point *point,
                           struct modal_error *err);
/* Its document, the caller's; what P's effects did is added to theirs. */
cJSON *torus_print(const struct program *p, const struct steady_settings *settings,
                   const struct torus_point *point);
void torus_count(struct program *p, const struct torus_point *point);

/* The document of P's steady state under SETTINGS' tones.  MODAL_BAD_INPUT, field the option, for
 * what several tones do not take; else as torus_solve. */
enum modal_status torus_run(struct program *p, const struct steady_settings *settings,
                            struct cost *cost, cJSON **doc, struct modal_error *err);
#endif
