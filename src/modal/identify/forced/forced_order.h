/* forced_order.h - how many modes answer to measured inputs, and where */
#ifndef MODAL_FORCED_ORDER_H
#define MODAL_FORCED_ORDER_H
#include "modal/identify/forced/lines.h"
#include "modal/identify/forced/transfer.h"

/* Of a fit that is one of many, of poles or of what was cut off: its steps, and when it ends, of ln
 * likelihood, where 1 is the chance: what it may still gain does not decide between two. */
enum { FORCED_STEPS_EACH = 12 };
#define FORCED_ENOUGH_EACH 0.1

/* Damping ratio from which a response has no peak: |H|^2 falls from omega = 0 on, for the square of
 * where it has its top, omega^2 (1 - 2 zeta^2), is negative. */
#define FORCED_NO_PEAK M_SQRT1_2
#define FORCED_CHANCE 4.0            /* standard deviations of noise among the lines of a band */

/* One model on the way. */
struct forced_rung {
    int poles;
    double bic, residual;        /* residual: relative, of all responses */
    bool converged;
    double complex *s;           /* poles; owned */
    double *spread;              /* as transfer.h has it; owned */
};

struct forced_search {
    struct transfer model;       /* the answer */
    struct forced_rung rung[TRANSFER_POLES_MOST + 1];
    int rungs;                   /* 0, 1, 2, .. poles, and the answer where poles were dropped */
    bool limit;                  /* ended at the most, or the work, allowed: more may pay */
    bool climbing;               /* while pair after pair did */
};

struct forced_limits {
    int fixed;                   /* pairs; 0: by the criterion */
    int most;
    double work;                 /* multiplications that the search may take, and again the answer's
                                    fit; 0: some seconds' */
    bool (*cancelled)(void *context);
    void *context;
};

/*
 * Pairs are added where what is left over answers most to an input, as long as the criterion of
 * criterion.h falls, and dropped where it falls without them.  forced_search_done frees *OUT, of
 * failures too.  Fails as transfer_fit does.
 */
enum modal_status forced_search(const struct lines *lines, const struct forced_limits *limits,
                                struct forced_search *out, struct modal_error *err);
/* Multiplications that a search by LIMITS may take. */
double forced_work(const struct lines *lines, const struct forced_limits *limits);

/* What T costs: the less, the better an account. */
double forced_bic(const struct lines *lines, const struct transfer *t);
void forced_search_done(struct forced_search *search);
#endif
