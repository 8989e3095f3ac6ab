/* widen.h - standard errors where the model is in doubt */
#ifndef MODAL_WIDEN_H
#define MODAL_WIDEN_H
#include <stdbool.h>
#include "base/error.h"

struct order_choice;
struct poles;
struct refine_data;
struct refined;

/* Standard errors of a fit that ends at rounding are so many times larger: rounding is not
 * independent from sample to sample. */
#define WIDEN_ROUNDING 4.0

struct widened {
    bool exact;             /* to rounding: nothing is doubted, and none of the below asked */
    double colour;          /* largest factor for a residual that is not white; 1: none */
    double contradiction;   /* by half of the record: parts.h; above 1 it counts */
};

/*
 * The standard errors of POLES, the chosen candidate of CHOICE for DATA, made to hold where white
 * noise about constant exponents is not the whole truth; see widen.c.  They only grow, and where
 * the model holds they stay.  Also sets poles->growth.  Fails with MODAL_NO_MEMORY,
 * MODAL_NO_CONVERGENCE.
 */
enum modal_status widen_poles(const struct refine_data *data, const struct order_choice *choice,
                              struct poles *poles, struct widened *out, struct modal_error *err);

/*
 * The same, beside that, of a constant system in white noise whose POLES are those of FIT to DATA,
 * converged: by poles that do not pay, and that noise hardly has.
 */
enum modal_status widen_for_others(const struct refine_data *data, const struct refined *fit,
                                   struct poles *poles, struct modal_error *err);
#endif
