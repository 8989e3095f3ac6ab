/* test_leave.c - when a worker elsewhere goes, and what it then says */
#include "check.h"
#include "worker/leave.h"

/* idle 5 s, 60 s in all, 20 s for the job; begun at 1000 ms */
static struct leave begun(void)
{
    const struct leave_options options = { .idle_ms = 5000, .until_ms = 60000, .grace_ms = 20000 };
    struct leave leave;

    leave_init(&leave, &options, 1000);
    return leave;
}

TEST(an_idle_worker_leaves_after_its_idle_time_and_says_so_once)
{
    struct leave leave = begun();

    CHECK(leave_next(&leave, false, 5999) == LEAVE_NOTHING);
    CHECK(leave_next(&leave, false, 6000) == LEAVE_SAY);
    CHECK(leave_next(&leave, false, 6001) == LEAVE_NOTHING);
}

TEST(a_job_is_no_idleness_and_its_end_begins_it_anew)
{
    struct leave leave = begun();

    leave_given(&leave, true, 2000);
    CHECK(leave_next(&leave, false, 30000) == LEAVE_NOTHING);
    leave_given(&leave, false, 30000);
    CHECK(leave_next(&leave, false, 34999) == LEAVE_NOTHING);
    CHECK(leave_next(&leave, false, 35000) == LEAVE_SAY);
}

TEST(who_is_asked_to_go_has_the_grace_for_its_job_and_then_gives_it_back)
{
    struct leave leave = begun();

    leave_given(&leave, true, 2000);
    CHECK(leave_next(&leave, true, 3000) == LEAVE_NOTHING);
    CHECK(leave_next(&leave, false, 22999) == LEAVE_NOTHING);
    CHECK(leave_next(&leave, false, 23000) == LEAVE_RELEASE);
    CHECK(strcmp(leave.why, "preempted") == 0);
    CHECK(leave_next(&leave, false, 90000) == LEAVE_NOTHING);
}

TEST(who_finishes_within_the_grace_leaves_at_once)
{
    struct leave leave = begun();

    leave_given(&leave, true, 2000);
    CHECK(leave_next(&leave, true, 3000) == LEAVE_NOTHING);
    leave_given(&leave, false, 4000);
    CHECK(leave_next(&leave, false, 4000) == LEAVE_SAY);
}

TEST(the_end_of_its_time_is_a_reason_to_go_and_what_is_left_of_it_is_told)
{
    struct leave leave = begun();
    const struct leave_options none = { .grace_ms = 20000 };

    CHECK_NEAR(leave_left_s(&leave, 1000), 60, 1e-12);
    CHECK_NEAR(leave_left_s(&leave, 43500), 17.5, 1e-12);
    CHECK_NEAR(leave_left_s(&leave, 99000), 0, 1e-12);
    leave_given(&leave, true, 60999);
    CHECK(leave_next(&leave, false, 60999) == LEAVE_NOTHING);
    CHECK(leave_next(&leave, false, 61000) == LEAVE_NOTHING);
    CHECK(strcmp(leave.why, "walltime") == 0);
    CHECK(leave_next(&leave, false, 81000) == LEAVE_RELEASE);
    leave_init(&leave, &none, 1000);
    CHECK(leave_left_s(&leave, 1000) < 0);
    CHECK(leave_next(&leave, false, INT64_C(1) << 50) == LEAVE_NOTHING);
}
