/* The ladder of settings: a made-up method whose error and time are known closed forms, on a clock
 * the test turns. */
#include "modal/ladder.h"
#include "check.h"

/* Rung i costs 2^i seconds and errs by 10^-i, down to a floor; rung `dead` has no answer. */
struct method { double now; double floor; int dead, calls; enum modal_status failure; };

static enum modal_status climb(void *context, int i, double *error, struct modal_error *err)
{
    struct method *m = context;

    m->calls++;
    m->now += ldexp(1, i);
    if (i == m->dead)
        return modal_fail(err, m->failure, "rung %d", i);
    *error = fmax(pow(10, -i), m->floor);
    return MODAL_OK;
}

static double now(void *context) { return ((struct method *)context)->now; }
static bool yes(void *context) { (void)context; return true; }

static struct ladder ladder_over(struct method *m, int rungs)
{
    return (struct ladder) { .rungs = rungs, .climb = climb, .clock = now, .context = m };
}

TEST(without_targets_every_rung_runs_and_the_most_exact_answers)
{
    struct method m = { .dead = -1 };
    struct ladder l = ladder_over(&m, 6);
    struct ladder_rung r[6];
    struct ladder_outcome o;

    CHECK(ladder_run(&l, r, &o, NULL) == MODAL_OK);
    CHECK(o.ran == 6 && o.chosen == 5 && o.stop == LADDER_RUN_OUT);
    CHECK_NEAR(r[4].seconds, 16, 0);
    CHECK_NEAR(r[4].error, 1e-4, 1e-18);
    for (int i = 0; i < 6; i++)
        CHECK(r[i].pareto);
}

TEST(a_target_error_stops_at_the_first_rung_within_it)
{
    struct method m = { .dead = -1 };
    struct ladder l = ladder_over(&m, 6);
    struct ladder_rung r[6];
    struct ladder_outcome o;

    l.target_error = 2e-3;
    CHECK(ladder_run(&l, r, &o, NULL) == MODAL_OK);
    CHECK(o.ran == 4 && o.chosen == 3 && o.stop == LADDER_AT_ERROR && o.recommended == 3);
    CHECK(!r[4].ran && isnan(r[4].error));
}

/* 1 + 2 + 4 = 7 s are used; the next rung would take 8 more and end at 15. */
TEST(a_target_time_is_not_passed_by_a_rung_that_doubles)
{
    struct method m = { .dead = -1 };
    struct ladder l = ladder_over(&m, 6);
    struct ladder_rung r[6];
    struct ladder_outcome o;

    l.target_seconds = 14.5;
    CHECK(ladder_run(&l, r, &o, NULL) == MODAL_OK);
    CHECK(o.ran == 3 && o.chosen == 2 && o.stop == LADDER_AT_SECONDS);
    CHECK_NEAR(r[3].seconds, 8, 0);
    CHECK(m.now <= 14.5);
}

TEST(repetitions_give_the_median_time)
{
    struct method m = { .dead = -1 };
    struct ladder l = ladder_over(&m, 2);
    struct ladder_rung r[2];
    struct ladder_outcome o;

    l.repetitions = 5;
    CHECK(ladder_run(&l, r, &o, NULL) == MODAL_OK);
    CHECK(m.calls == 10);
    CHECK_NEAR(r[1].seconds, 2, 0);
}

TEST(a_rung_without_an_answer_is_passed_over_and_any_other_failure_ends_the_climb)
{
    struct method m = { .dead = 2, .failure = MODAL_NO_CONVERGENCE };
    struct ladder l = ladder_over(&m, 4);
    struct ladder_rung r[4];
    struct ladder_outcome o = { .ran = 77 };
    struct modal_error err;

    CHECK(ladder_run(&l, r, &o, &err) == MODAL_OK);
    CHECK(o.ran == 4 && o.chosen == 3 && isinf(r[2].error) && !r[2].pareto);
    m.failure = MODAL_IO;
    o.ran = 77;
    CHECK(ladder_run(&l, r, &o, &err) == MODAL_IO);
    CHECK(o.ran == 77);
}

TEST(counts_and_targets_out_of_range_are_bad_input_and_a_cancel_is_heard)
{
    struct method m = { .dead = -1 };
    struct ladder l = ladder_over(&m, 0);
    struct ladder_rung r[2];
    struct ladder_outcome o;
    struct modal_error err;

    CHECK(ladder_run(&l, r, &o, &err) == MODAL_BAD_INPUT);
    l.rungs = 2, l.repetitions = LADDER_REPETITIONS_MOST + 1;
    CHECK(ladder_run(&l, r, &o, &err) == MODAL_BAD_INPUT);
    l.repetitions = 1, l.target_error = NAN;
    CHECK(ladder_run(&l, r, &o, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "target.error");
    l.target_error = 0, l.cancelled = yes;
    CHECK(ladder_run(&l, r, &o, &err) == MODAL_CANCELLED);
}

/* Rungs 2 and 3 reach the data's own error 1e-2: rung 2 does so in half the time, and 3 to 5 are
 * dominated by it. */
TEST(what_is_below_the_datas_own_error_buys_nothing_and_is_not_recommended)
{
    struct method m = { .dead = -1, .floor = 1e-2 };
    struct ladder l = ladder_over(&m, 6);
    struct ladder_rung r[6];
    struct ladder_outcome o;

    l.floor = 1e-2;
    CHECK(ladder_run(&l, r, &o, NULL) == MODAL_OK);
    CHECK(o.recommended == 2 && r[2].pareto && !r[3].pareto && !r[5].pareto);
}

/* log-log: (0, 0), (1, -4), (10, -5): the middle rung has nearly all of the accuracy for a tenth of
 * the time. */
TEST(without_a_target_the_knee_is_recommended)
{
    struct ladder_rung r[3] = { { true, false, 1, 1 },
                                { true, false, 1e-4, exp(1) },
                                { true, false, 1e-5, exp(10) } };

    CHECK(ladder_mark(r, 3, 0) == 1);
}

TEST(nothing_run_recommends_nothing)
{
    struct ladder_rung r[1] = { { false, true, NAN, NAN } };

    CHECK(ladder_mark(r, 1, 0) == -1);
    CHECK(!r[0].pareto);
}
