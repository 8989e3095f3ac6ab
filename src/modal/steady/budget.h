/* budget.h - the work one solution may cost, counted, so that the same scene ends at the same place
 * on every machine
 *
 * The unit is an operation on a number read from a scattered place, about a nanosecond; those of
 * factorizations and products of matrices run BUDGET_DENSE times as fast.  What is counted:
 *
 *     a law's input at one instant, with its transforms  BUDGET_SAMPLE        (balance.c, cycle.c)
 *     an event or a turn of a law's motion               BUDGET_EVENT H       (balance.c)
 *     a gain's product with a motion, term by term       BUDGET_PRODUCT H^2   (balance.c)
 *     a residual's products with S_k                     8 an entry           (balance.c)
 *     a law's derivative                                 16 (HJ + 1)^2        (balance.c)
 *     a factorization                                    balance_dense_work or blocks_work
 *     a step through rigid friction and its map          price_steps          (cycle.c)
 *     a step of disturbances                             step_work            (monodromy.c)
 *     slopes over such a step, of many states            taylor_work          (large_stability.c)
 *     a window of their Hill's matrix                    hill_window_work     (hill_window.c)
 */
#ifndef MODAL_BUDGET_H
#define MODAL_BUDGET_H
#include <stdbool.h>
#include <stddef.h>

struct budget {
    double spent, most;        /* most 0: no limit */
    double apart;              /* of most, what verdicts were given beside what an answer may */
};

enum {
    BUDGET_DENSE = 4,      /* dense operations in the time of one on a scattered number */
    BUDGET_SAMPLE = 60,    /* of a law's input at one instant, its transforms included */
    BUDGET_SUM = 2,        /* a harmonic of a motion and its rates at one instant */
    BUDGET_EVENT = 20,     /* a harmonic: some five sums to polish it, and its waves to 3 H */
    BUDGET_PRODUCT = 2     /* of a piece's gain and a motion's harmonic: eight numbers read */
};

/* BUDGET may be NULL: nothing is counted, nothing spent. */
static inline void budget_add(struct budget *budget, double operations)
{
    if (budget != NULL)
        budget->spent += operations;
}

/* Whether all of it is; an end that whoever works looks for between its steps. */
static inline bool budget_spent(const struct budget *budget)
{
    return budget != NULL && budget->most > 0 && budget->spent >= budget->most;
}

/* Whether so many more operations are allowed. */
static inline bool budget_pays(const struct budget *budget, double operations)
{
    return budget == NULL || budget->most <= 0 || budget->spent + operations < budget->most;
}

/* What a point says that ended so. */
#define BUDGET_REASON "the work allowed was spent before any way in led to a balance"
#endif
