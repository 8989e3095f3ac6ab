/* order_state.h - what the files of order.c share: one search at work, and its candidates */
#ifndef MODAL_ORDER_STATE_H
#define MODAL_ORDER_STATE_H
#include "modal/identify/order/order.h"

static const double
    LOOK_SHARE = 0.5;               /* of the work, for looking before anything is refined */
enum { MORE_MOST = 16 };            /* directions looked for in what a fit leaves */

struct climb {
    const struct refine_data *data;
    const struct order_source *source;
    const struct order_options *opt;
    struct order_choice choice;
    int room;
    int poles_most;                 /* room in: */
    double complex *lambda;
    bool *fixed;
    struct long_rest rest;          /* of data in blocks: what candidate `rest_of` leaves */
    int rest_of;                    /* -1: none yet */
};

/* ---- order_climb.c ---- */

/* The criterion of candidate I; infinite for -1, where there is none. */
double climb_bic(const struct climb *c, int i);
/* No candidate has a higher order. */
int climb_order_most(const struct climb *c);
/* Is SHARE of the work spent?  Asked where there is more to try. */
bool climb_spent(struct climb *c, double share);
/* refine_poles within the work that is left, against a RIVAL (refine.h); the caller frees *fit. */
enum modal_status climb_fit(struct climb *c, const double complex *lambda, int count,
                            const bool *fixed, bool refine, double rival, struct refined *fit,
                            struct modal_error *err);
/* Fit COUNT poles, refined or not, and append the candidate; *at is its index, -1 where there is
 * nothing to fit. */
enum modal_status climb_try(struct climb *c, int r, const double complex *lambda, int count,
                            const bool *fixed, bool refine, double rival, int *at,
                            struct modal_error *err);
/* Candidate I, looked at so far, refined in its place; a fit that refining made worse is kept as it
 * was. */
enum modal_status climb_refine(struct climb *c, int i, double rival, struct modal_error *err);
/* Candidate I, looked at, taken a few STEPS further: no longer as the pencil has it, not yet
 * refined. */
enum modal_status climb_steps(struct climb *c, int i, int steps, struct modal_error *err);
/* The poles that do not pay SHARE of their price leave (trim.h), MOST at a time (0: any number). */
enum modal_status climb_trim(struct climb *c, double complex *lambda, int *count, double share,
                             double reach, int most, struct modal_error *err);
/* Candidate *best without the poles that do not pay, MOST at a time (0: any number), refined, until
 * all do.  REACH: what refining may recover of a loss; where there is any, what cannot win is not
 * refined to its end. */
enum modal_status climb_weed(struct climb *c, double reach, int most, int *best,
                             struct modal_error *err);
/* The price of one pair more than FIT has. */
double climb_pair_price(const struct climb *c, const struct refined *fit);
/* Data in blocks: c->rest becomes that of candidate AT. */
enum modal_status climb_rest(struct climb *c, int at, struct modal_error *err);
/* What must be seen of another pole, in COUNT places, before it is tried; SPREAD: of what is left
 * (colour.h), NULL: its columns are independent. */
double climb_worth_looking(const struct climb *c, const struct refined *fit, double count,
                           const struct colour_spread *spread);

/* ---- order_above.c ---- */

/* The whole signal subspace, at the sizes that the singular values suggest; the best of them
 * refined, and completed. */
enum modal_status climb_descend(struct climb *c, int *best, struct modal_error *err);
/* *best, looked at, of an order that is told, with poles of noise in place of modes that hide among
 * them: its poles that pay, refined, those that what they leave shows to pay, and up to its order
 * those that it shows most of. */
enum modal_status climb_complete(struct climb *c, int *best, struct modal_error *err);
/* Poles in what the best leaves, as long as there are any. */
enum modal_status climb_search_remainder(struct climb *c, int *best, struct modal_error *err);

/* ---- order_improve.c ---- */

/* Passes 3 and 4; ABOVE: the best came from above, and what it leaves says where to split. */
enum modal_status climb_improve(struct climb *c, bool above, int *best, struct modal_error *err);
#endif
