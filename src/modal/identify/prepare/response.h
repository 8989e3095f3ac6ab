/* response.h - what may be asked where the excitation is noise, or measured
 *
 * identify_options are those of free responses; ambient.h and forced.h take fewer.  What would say
 * nothing is refused, not passed over.
 */
#ifndef MODAL_RESPONSE_H
#define MODAL_RESPONSE_H
#include "base/error.h"
#include "modal/batch.h"
#include "modal/identify/result.h"

/* What one of the two takes. */
struct response_limits {
    const char *beside;          /* the options that serve, for the message */
    int signals_most;            /* of pod.rank; 0: nothing is said by pod.rank and pod.energy */
    int modes_most;              /* of rank.fixed, which is two a mode */
    bool periodic;               /* periodic systems too, with a period and then without a band */
};

/* MODAL_OK where every option that was set serves and is in range, for this BATCH's period and
 * channels; else MODAL_BAD_INPUT, its field the option, its text what would be accepted. */
enum modal_status response_check(const struct batch *batch, const struct identify_options *options,
                                 const struct response_limits *limits, struct modal_error *err);

/* What lasted from *CLOCK to now, by the OPTIONS' clock, is the stage NAME of *OUT; NULL: the first
 * begins. */
void response_stage(const struct identify_options *options, double *clock, const char *name,
                    struct identify_result *out);
#endif
