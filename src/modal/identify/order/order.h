/* order.h - the order of the model by Bayes' information criterion over a ladder of refined fits */
#ifndef MODAL_ORDER_H
#define MODAL_ORDER_H
#include "modal/identify/fit/refine.h"
#include "modal/identify/order/long_rest.h"

/* What refining may bring, of -2 ln(likelihood) for a datum (order.c (1)). */
#define ORDER_REACH 0.02

/* A pole as two neighbours is worth refining where their BIC, as they are put, is no more than this
 * above its own; half the distance of the two, in parts of 1 / record. */
#define ORDER_SPLIT_REACH 60.0
#define ORDER_SPLIT_HALF 0.5

/* rad or e-foldings over the record: a pole that moves less is known by its size, not its share. */
#define ORDER_MOVED 3.0

enum { ORDER_AHEAD = 4 };       /* the ladder ends this many rungs past its best */

/* Of a pole's price: so much it must pay before it is refined; what is left then is more than
 * noise. */
#define ORDER_LOOK 0.5

/* A fit is much the worse where it leaves so many times more. */
#define ORDER_WORSE 1.5

/* And so many times more where poles may have drawn noise: far fewer than rows never take 99 % of
 * its energy. */
#define ORDER_DRAWN 10

/* A fit that leaves more than this of the signals' norm explains little of them: the ladder goes
 * on. */
#define ORDER_POOR 0.3

/* Where candidates come from: the poles of order r (room for r in LAMBDA), of one decomposition. */
struct order_source {
    int most;                   /* largest r */
    /* singular values above the edge of noise (pencil.h); 0: not known */
    int signals;
    /* from above, or an order that is told: poles to begin with, borrowed; NULL: only those of the
     * decomposition */
    const double complex *known; int known_count;
    enum modal_status (*poles)(void *context, int r, double complex *lambda, int *count,
                               struct modal_error *err);
    void *context;
};

struct order_options {
    struct refine_options refine;
    int look;                   /* look at least so far, whatever the fits say */
    int fixed;                  /* only this r is tried; 0: the ladder */
    int order_most;             /* no candidate of a higher order; 0: one less than the rows */
    bool thorough;              /* refine every candidate: where rows are few, a pencil's fit is no
                                 * guide to the refined one's */
    double work;                /* most multiplications, as refine.h counts them, before another
                                 * candidate or step; 0: no limit */
    int seen;                   /* of data in blocks: rows that a search before this has seen */
    bool many;                  /* from above: many modes, in noise; steps go by sums (gram.h) */
    bool renewed;               /* from above: the poles that are known were the answer to nearly
                                 * the same data: another is tried where it may pay alone */
    int cut;                    /* > 0: where the least looked at has r + ORDER_AHEAD above this, do
                                 * not refine: the caller has a larger source */
    bool no_offset;             /* do not try a slow real pole as a constant */
    bool (*cancelled)(void *context);   /* may be NULL */
    void *context;
};

struct order_candidate {
    int r;                      /* asked of the source; 0: derived from another candidate */
    bool refined;               /* else its BIC is that of the unrefined poles, and far off */
    struct refined fit;
};

struct order_choice {
    struct order_candidate *candidates; int count;   /* in the order they were tried */
    int chosen;            /* index; -1: no candidate could be fitted (noise, or an empty source) */
    double work;                /* multiplications spent */
    bool limited;     /* options.work ended the search: better candidates may not have been tried */
    bool cut;                   /* options.cut: the chosen one was only looked at */
    /* order_from_above: the model holds; nothing else need be tried, unless it is: */
    bool clean;
    bool crowded;               /* two pairs are nearer than half a beat over the record */
    struct long_rest rest;      /* of data in blocks: of the chosen one, where it is clean */
    bool offset;                /* the chosen fit's pole 0 is the null exponent, fixed */
};

/*
 * Climb r = 1, 2, ...; refine those that can win; take the least BIC.  *out is the caller's, to
 * order_done.  With `work` the search ends with the best so far once that is spent: half of it may
 * go into looking, and what it overruns is one evaluation.  The choice is the same on every
 * machine. Fails as refine_poles and the source do, and with MODAL_CANCELLED.
 */
enum modal_status order_choose(const struct refine_data *data, const struct order_source *source,
                               const struct order_options *opt, struct order_choice *out,
                               struct modal_error *err);

/*
 * The same from the whole signal subspace downwards (order.c), with a source that holds all of
 * it. `clean` says whether what it found is one set of constant modes in white noise. Else it is
 * one more candidate, which may be far from the sparing answer.
 */
enum modal_status order_from_above(const struct refine_data *data,
                                   const struct order_source *source,
                                       const struct order_options *opt,
                                   struct order_choice *out, struct modal_error *err);
void order_done(struct order_choice *choice);
#endif
