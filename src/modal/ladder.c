/* ladder.c - see ladder.h
 *
 * The forecast of a rung not yet run is the growth seen so far: with t_i the seconds of rung i,
 *
 *     t_{i+1} ~ t_i max(1, t_i / t_{i-1}),                                                      (1)
 *
 * so that a ladder whose rungs cost r times the one below is forecast exactly, and a first rung is
 * forecast as its like.
 *
 * The knee: with x = log t, y = log e, both scaled to [0, 1] over the Pareto rungs, the chord from
 * the fastest (0, 1) to the most exact (1, 0) is x + y = 1 and a rung's distance below it is
 * proportional to
 *
 *     1 - x - y.                                                                                (2)
 */
#include "modal/ladder.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include "modal/numbers.h"

static double median(double *x, int count)
{
    numbers_sort(x, (size_t)count);
    return count % 2 ? x[count / 2] : 0.5 * (x[count / 2 - 1] + x[count / 2]);
}

static bool has_no_answer(enum modal_status rc)
{
    return rc == MODAL_NO_CONVERGENCE || rc == MODAL_TOO_LARGE;
}

static enum modal_status run_rung(const struct ladder *ladder, int i, struct ladder_rung *rung,
                                  struct modal_error *err)
{
    double seconds[LADDER_REPETITIONS_MOST];
    int repetitions = ladder->repetitions > 0 ? ladder->repetitions : 1;
    enum modal_status rc = MODAL_OK;

    if (ladder->begins != NULL)
        ladder->begins(ladder->context, i);
    for (int k = 0; k < repetitions; k++) {
        double start = ladder->clock(ladder->context), error = NAN;

        rc = ladder->climb(ladder->context, i, &error, err);
        if (rc != MODAL_OK && !has_no_answer(rc))
            return rc;
        seconds[k] = fmax(ladder->clock(ladder->context) - start, 0);
        rung->error = rc == MODAL_OK ? error : HUGE_VAL;
    }
    rung->ran = true;
    rung->seconds = median(seconds, repetitions);
    return MODAL_OK;
}

static double forecast(const struct ladder_rung *rungs, int i)   /* (1) */
{
    double last = rungs[i - 1].seconds, growth = 1;

    if (i >= 2 && rungs[i - 2].seconds > 0)
        growth = fmax(1, last / rungs[i - 2].seconds);
    return last * growth;
}

static int best_of(const struct ladder_rung *rungs, int count)
{
    int best = -1;

    for (int i = 0; i < count; i++)
        if (rungs[i].ran && rungs[i].error < HUGE_VAL &&
            (best < 0 || rungs[i].error < rungs[best].error))
            best = i;
    return best;
}

static enum modal_status check(const struct ladder *ladder, struct modal_error *err)
{
    if (ladder->rungs < 1 || ladder->rungs > LADDER_RUNGS_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "rungs", "%d rungs; accepted: 1 to %d",
                                ladder->rungs, LADDER_RUNGS_MOST);
    if (ladder->repetitions < 0 || ladder->repetitions > LADDER_REPETITIONS_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "repetitions",
                                "%d repetitions; accepted: 1 to %d", ladder->repetitions,
                                LADDER_REPETITIONS_MOST);
    if (!(ladder->target_error >= 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, "target.error",
                                "%g; accepted: a positive number", ladder->target_error);
    if (!(ladder->target_seconds >= 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, "target.seconds",
                                "%g; accepted: a positive number", ladder->target_seconds);
    return MODAL_OK;
}

enum modal_status ladder_run(const struct ladder *ladder, struct ladder_rung *rungs,
                             struct ladder_outcome *out, struct modal_error *err)
{
    struct ladder_outcome outcome = { .chosen = -1, .stop = LADDER_RUN_OUT };
    enum modal_status rc = check(ladder, err);
    double start;

    if (rc != MODAL_OK)
        return rc;
    for (int i = 0; i < ladder->rungs; i++)
        rungs[i] = (struct ladder_rung) { .error = NAN, .seconds = NAN };
    start = ladder->clock(ladder->context);
    for (int i = 0; i < ladder->rungs; i++) {
        if (ladder->cancelled != NULL && ladder->cancelled(ladder->context))
            return modal_fail(err, MODAL_CANCELLED, "cancelled before rung %d of %d", i,
                              ladder->rungs);
        if (i > 0 && ladder->target_seconds > 0) {
            double next = forecast(rungs, i);
            if (ladder->clock(ladder->context) - start + next > ladder->target_seconds) {
                rungs[i].seconds = next;
                outcome.stop = LADDER_AT_SECONDS;
                break;
            }
        }
        rc = run_rung(ladder, i, &rungs[i], err);
        if (rc != MODAL_OK)
            return rc;
        outcome.ran = i + 1;
        if (ladder->target_error > 0 && rungs[i].error <= ladder->target_error) {
            outcome.stop = LADDER_AT_ERROR;
            break;
        }
    }
    outcome.chosen = outcome.stop == LADDER_AT_ERROR ? outcome.ran - 1
                                                     : best_of(rungs, outcome.ran);
    outcome.recommended =
        ladder_mark(rungs, ladder->rungs, fmax(ladder->target_error, ladder->floor));
    *out = outcome;
    return MODAL_OK;
}

static bool counts(const struct ladder_rung *rung)
{
    return rung->ran && rung->error < HUGE_VAL;   /* false for NAN */
}

static bool dominates(const struct ladder_rung *a, const struct ladder_rung *b)
{
    return a->error <= b->error && a->seconds <= b->seconds &&
           (a->error < b->error || a->seconds < b->seconds);
}

static void mark_pareto(struct ladder_rung *rungs, int count)
{
    for (int i = 0; i < count; i++) {
        rungs[i].pareto = counts(&rungs[i]);
        for (int j = 0; j < count && rungs[i].pareto; j++)
            if (counts(&rungs[j]) && dominates(&rungs[j], &rungs[i]))
                rungs[i].pareto = false;
    }
}

/* A zero time or error is below the clock's or the arithmetic's resolution, not infinitely good. */
static double log_of(double x, double least)
{
    return log(fmax(x, least));
}

static int knee(const struct ladder_rung *rungs, int count)
{
    double x0 = HUGE_VAL, x1 = -HUGE_VAL, y0 = HUGE_VAL, y1 = -HUGE_VAL, best = -HUGE_VAL;
    int at = -1;

    for (int i = 0; i < count; i++) {
        if (!rungs[i].pareto)
            continue;
        x0 = fmin(x0, log_of(rungs[i].seconds, 1e-9)),
        x1 = fmax(x1, log_of(rungs[i].seconds, 1e-9));
        y0 = fmin(y0, log_of(rungs[i].error, DBL_EPSILON)),
        y1 = fmax(y1, log_of(rungs[i].error, DBL_EPSILON));
    }
    for (int i = 0; i < count; i++) {
        if (!rungs[i].pareto)
            continue;
        double x = x1 > x0 ? (log_of(rungs[i].seconds, 1e-9) - x0) / (x1 - x0) : 0;
        double y = y1 > y0 ? (log_of(rungs[i].error, DBL_EPSILON) - y0) / (y1 - y0) : 0;
        if (1 - x - y > best)   /* (2) */
            best = 1 - x - y, at = i;
    }
    return at;
}

int ladder_mark(struct ladder_rung *rungs, int count, double enough)
{
    int at = -1;

    mark_pareto(rungs, count);
    for (int i = 0; i < count; i++)
        if (rungs[i].pareto && rungs[i].error <= enough &&
            (at < 0 || rungs[i].seconds < rungs[at].seconds))
            at = i;
    return at >= 0 ? at : knee(rungs, count);
}
