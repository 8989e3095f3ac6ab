/* steady_print.h - one steady state as the document of contracts.md */
#ifndef JOB_STEADY_PRINT_H
#define JOB_STEADY_PRINT_H
#include "base/error.h"
#include "base/json.h"

struct program;
struct stability;
struct steady;
struct steady_point;
struct steady_settings;

/* What undetermined_mean says. */
#define STEADY_MEAN_IS_FREE "nothing holds the body in place but what slips: its mean follows " \
                            "from history; it is given without error, the motion about it with"

/* The document of POINT of session S; SETTINGS says which dofs and how many samples.  STABILITY
 * may be NULL (not looked at): its verdict and its largest multiplier are null then. */
enum modal_status steady_print(struct steady *s, const struct program *p,
                               const struct steady_settings *settings,
                               const struct steady_point *point, const struct stability *stability,
                               cJSON **out, struct modal_error *err);
/* Counts and activity of POINT into P's effects, for its plan; ACTIVE ones stay so. */
void steady_count(struct program *p, const struct steady_point *point);
/* The same of what each of so many LAWS did. */
void steady_count_laws(struct program *p, int laws, const long *evaluations, const bool *acts);
/* Before the first steady_count: effects with laws start inactive. */
void steady_count_start(struct program *p);
#endif
