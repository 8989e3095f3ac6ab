/* clipping.h - inputs whose peaks were cut off before they were recorded */
#ifndef MODAL_CLIPPING_H
#define MODAL_CLIPPING_H
#include "modal/identify/forced/forced_order.h"

/* What lines are made of (lines_make). */
struct clipping_record {
    const struct matrix *responses, *inputs;
    struct lines_records records;
    double band[2];
};

/* Of an input. */
struct clipping {
    double low, high;            /* its extremes */
    int samples;                 /* that hold one of them as if it were cut off there; 0: none do */
};

/*
 * Did inputs go on beyond extremes that they hold?  Of RECORD, whose own account is OWN; OUT: of
 * each input.  *cut: yes, those whose samples are not 0.  See clipping.c.  It fails as transfer_fit
 * does.
 */
enum modal_status clipping_find(const struct clipping_record *record,
                                const struct forced_search *own, const struct forced_limits *limits,
                                struct clipping *out, bool *cut, struct modal_error *err);
#endif
