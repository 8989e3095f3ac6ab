/* budget.h - the work one solution may cost, counted,
 * so that the same scene ends at the same place on every machine
 *
 * The unit is an operation on a number read from a scattered place; those of factorizations run
 * BUDGET_DENSE times as fast.
 */
#ifndef MODAL_BUDGET_H
#define MODAL_BUDGET_H
#include <stdbool.h>
#include <stddef.h>

struct budget { double spent, most; };     /* most 0: no limit */

/* SAMPLE: of a law at one instant, its transforms included. */
enum { BUDGET_DENSE = 4, BUDGET_SAMPLE = 60 };

/* BUDGET may be NULL: nothing is counted, nothing spent. */
static inline void budget_add(struct budget *budget, double operations)
{
    if (budget != NULL)
        budget->spent += operations;
}

static inline bool budget_spent(const struct budget *budget)
{
    return budget != NULL && budget->most > 0 && budget->spent >= budget->most;
}

#define BUDGET_REASON "the work allowed was spent before any way in led to a balance"
#endif
