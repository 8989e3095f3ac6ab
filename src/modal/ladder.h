/* ladder.h - accuracy against time: a warm-started ladder of settings, its stopping rule and its
 * Pareto rungs
 *
 * One runner for every kind of job.  The rungs go from cheap and rough to dear and exact; each may
 * start from what the rung before left behind (warm start).  `target_error` and `target_seconds`
 * stop the climb; without them it is run out, which is the tradeoff.  Times come from the caller's
 * clock, since the numerics have none.
 */
#ifndef MODAL_LADDER_H
#define MODAL_LADDER_H
#include <stdbool.h>
#include "base/error.h"

enum {
    /* several times the settings of any kind: their tables have fixed sizes */
    LADDER_RUNGS_MOST = 256,
    /* a median of so many moves no more; their seconds lie on the stack */
    LADDER_REPETITIONS_MOST = 99,
};

struct ladder {
    int rungs;                 /* 1 .. LADDER_RUNGS_MOST */
    int repetitions;           /* seconds are the median of so many runs of a rung; 0 means 1 */
    double target_error;       /* stop once a rung's error is at most this; 0: no such target */
    /* do not begin a rung expected to pass this total of clock seconds; 0: no such target */
    double target_seconds;
    double floor;              /* the error the data themselves leave (Cramer-Rao); 0: none */

    /*
     * Run rung I, 0 .. rungs - 1, and put its error (an estimate, or against a reference the
     * context holds; NAN: unknown) into *error.  MODAL_NO_CONVERGENCE and MODAL_TOO_LARGE mean that
     * this rung has no answer (error infinite) and the climb goes on; any other failure ends it.
     * Called `repetitions` times in a row with the same I: it must do the same work each time, so a
     * warm start is taken from rung I - 1, never from I.
     */
    enum modal_status (*climb)(void *context, int i, double *error, struct modal_error *err);
    double (*clock)(void *context);              /* seconds of processor time used so far */
    bool (*cancelled)(void *context);            /* may be NULL */
    /* rung I is about to run, outside its time; may be NULL */
    void (*begins)(void *context, int i);
    void *context;
};

struct ladder_rung {
    bool ran;
    /* no other rung is both at least as good and at least as fast, and better in one */
    bool pareto;
    double error;     /* HUGE_VAL: no answer; NAN: not run */
    double seconds;   /* where not run: the forecast that kept it from running, or NAN */
};

enum ladder_stop { LADDER_RUN_OUT, LADDER_AT_ERROR, LADDER_AT_SECONDS };

struct ladder_outcome {
    int ran;                   /* rungs run: 0 .. ran - 1 */
    /* the rung that answers: least error of those run; the first within the target; -1: none */
    int chosen;
    int recommended;           /* see ladder_mark */
    enum ladder_stop stop;
};

/*
 * Climb.  RUNGS holds ladder->rungs entries, all filled on success.  The first rung always runs.
 * Fails with MODAL_BAD_INPUT (counts out of range, a negative or NaN target), MODAL_CANCELLED, or
 * as climb does.
 */
enum modal_status ladder_run(const struct ladder *ladder, struct ladder_rung *rungs,
                             struct ladder_outcome *out, struct modal_error *err);

/*
 * Mark the Pareto rungs among COUNT (those that ran with a finite error) and return the recommended
 * one, -1 if there is none.  It is the fastest Pareto rung whose error is at most `enough` (> 0: a
 * target, or the data's own error); where none is, or `enough` is 0, the knee: the Pareto rung
 * furthest below the chord from the fastest to the most exact in the plane of log seconds and log
 * error.
 */
int ladder_mark(struct ladder_rung *rungs, int count, double enough);
#endif
