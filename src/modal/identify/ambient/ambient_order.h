/* ambient_order.h - how many pairs the spectra of an ambient record show, and which */
#ifndef MODAL_AMBIENT_ORDER_H
#define MODAL_AMBIENT_ORDER_H
#include "modal/identify/ambient/whittle.h"

/* Of the answer's climb, with a speed that wanders or without. */
enum { AMBIENT_STEPS_MOST = 60 };

/* Prices: what a fit may make up for where a pair leaves. */
#define AMBIENT_PATIENCE 8.0

struct ambient_limits {
    int fixed, most;                 /* pairs; fixed 0: as many as pay, at most `most` */
    bool (*cancelled)(void *context);
    void *context;
    double work;                     /* of the answer's own fits (whittle_fit.h); 0: as much as
                                        they may take */
};

/* What the search saw: the fit of each number of pairs. */
struct ambient_rung { int count; double likelihood; struct whittle_mode *mode; bool converged; };

struct ambient_search {
    struct whittle *model;           /* the answer, with its errors */
    struct bins bins;                /* that it was fitted to */
    struct ambient_rung rung[WHITTLE_MODES_MOST + 1];
    int rungs;
    bool limit;                      /* the search ended for want of work or pairs */
};

/* The gain in the logarithm of the likelihood that a pair must bring; see ambient_order.c. */
double ambient_price(int channels, int lines);

/* Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE (the spectra are singular), MODAL_CANCELLED.
 * The caller gives *OUT to ambient_search_done, whatever comes. */
enum modal_status ambient_search(const struct spectrum *s, const struct ambient_limits *limits,
                                 struct ambient_search *out, struct modal_error *err);
void ambient_search_done(struct ambient_search *a);

/* M climbs on, as one of many fits does, by what S holds.  Fails with MODAL_NO_MEMORY,
 * MODAL_CANCELLED. */
enum modal_status ambient_refit(const struct spectrum *s, const struct ambient_limits *limits,
                                struct whittle *m, struct modal_error *err);
#endif
