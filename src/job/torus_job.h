/* torus_job.h - kind `steady` under several tones: its options checked, its document printed */
#ifndef JOB_TORUS_JOB_H
#define JOB_TORUS_JOB_H
#include "base/error.h"
#include "base/json.h"

struct cost;
struct program;
struct steady_settings;

/* The document of P's steady state under SETTINGS' tones.  MODAL_BAD_INPUT, field the option, for
 * what several tones do not take; else as torus_solve. */
enum modal_status torus_run(struct program *p, const struct steady_settings *settings,
                            struct cost *cost, cJSON **doc, struct modal_error *err);
#endif
