/* diagnose.h - what may be wrong with an answer, each by a stable code with advice */
#ifndef MODAL_DIAGNOSE_H
#define MODAL_DIAGNOSE_H
#include "modal/identify/ask/widen.h"
#include "modal/identify/result.h"

/* Add a diagnostic; more than IDENTIFY_DIAGNOSTICS_MOST are dropped. */
void identify_diagnose(struct identify_result *result, const char *code, int channel,
                       const char *format, ...) __attribute__((format(printf, 4, 5)));

/* Of the Nyquist frequency: what turns faster is not told from what folds there. */
#define DIAGNOSE_NYQUIST 0.95
/* near_nyquist, where mode I turns by so much of it. */
void diagnose_near_nyquist(struct identify_result *result, int i, double turn);

/* zero_channel of those without an error: what is constant was left out. */
void diagnose_still_channels(struct identify_result *result);

/* Facts that only the pipeline knows. */
struct diagnose_facts {
    int asked_rank;           /* as fixed or by rule; 0: chosen by BIC */
    int full_rank;            /* singular values above rounding */
    int rows;                 /* L: equations for each phase and signal */
    int order;                /* r: unknowns */
    int dropped;              /* multipliers that are zero to rounding */
    double record;            /* s */
    double tau;               /* s: the multipliers' step */
    bool cut_pair, rank_low;  /* one more direction completes a pair; fits far better */
    bool converged;           /* the refinement; true where none was asked for */
    bool work_limit;          /* the search for an order ended where its work was spent */
    struct widened doubt;     /* why standard errors were widened */
    bool rejected;            /* parts contradict the model, and it leaves the verdict open */
    const bool *below;    /* per channel: nothing but rounding, left out (rounding.h); NULL: none */
    double told;              /* of the noise's variance, by neighbours in a period (whiten.h) */
    bool orbit;               /* a multiplier of 1 whose coefficient varies over the period */
};

/*
 * Codes: no_modes, rank_at_rounding, cut_pair, rank_too_low, too_many_unknowns, order_work_limit,
 * not_converged, offset, periodic_orbit, fast_decay, growth_hides, near_nyquist, short_record,
 * unresolved_pair, aliases, near_tie, near_defective, dominated_signal, poor_reconstruction,
 * coloured_residual, ends_below_grid, below_rounding, parts_disagree, growth_unconfirmed
 * (verdict.c), not_free_throughout (event.h, identify_stop.h), wild_samples (wild.h),
 * step (steps.h), wrong_period, period_drifts (identify_slip.c).
 */
void diagnose(struct identify_result *result, const struct diagnose_facts *facts);
#endif
