/* response.h - what may be asked where the excitation is noise, or measured */
#ifndef MODAL_RESPONSE_H
#define MODAL_RESPONSE_H
#include "modal/identify/identify.h"

struct response_limits {
    const char *beside;          /* the options that serve, for the message */
    int signals_most;            /* of pod.rank; 0: nothing is said by pod.rank and pod.energy */
    int modes_most;              /* of rank.fixed, which is two a mode */
    bool periodic;               /* periodic systems too, with a period and then without a band */
};

/* Every option that was set serves, in range; otherwise MODAL_BAD_INPUT names it. */
enum modal_status response_check(const struct batch *batch, const struct identify_options *options,
                                 const struct response_limits *limits, struct modal_error *err);
#endif
