/* Requests that wait for the ledger are taken in turn, and nobody's fill the room of all. */
/* Tests as well: received.c shares.c */
#include "broker/kit/shares.h"
#include "broker/shell/door.h"
#include "check.h"
#include <stdlib.h>

/* Of TURN, its number beside, with a body of SIZE bytes. */
static struct received make(const char *verb, uint64_t number, size_t size)
{
    struct received r = { .count = 3, .number = number };

    r.frames[0] = blob_copy("MODALD1", 7);
    r.frames[1] = blob_copy(verb, strlen(verb));
    r.frames[2] = blob_take(calloc(1, size), size);
    return r;
}

static bool put(struct door *door, const char *verb, uint64_t turn, uint64_t number, size_t size)
{
    struct received r = make(verb, number, size);
    bool admitted = door_admits(door, &r, turn);

    if (admitted)
        door_put(door, &r, turn);
    received_release(&r);
    return admitted;
}

static uint64_t take(struct door *door)
{
    struct received r;
    uint64_t turn;

    if (!door_take(door, NULL, NULL, &r, &turn))
        return 0;
    received_release(&r);
    return r.number;
}

TEST(who_has_one_waits_for_one_of_each_other_and_of_one_all_come_in_their_order)
{
    static const uint64_t order[] = { 101, 201, 301, 102, 202, 103, 0 };
    struct door door = { 0 };

    for (uint64_t i = 1; i <= 3; i++)
        CHECK(put(&door, "SUBMIT", 1, 100 + i, 100));
    for (uint64_t i = 1; i <= 2; i++)
        CHECK(put(&door, "SUBMIT", 2, 200 + i, 100));
    CHECK(put(&door, "UPLOAD", 3, 301, 100));
    for (size_t i = 0; i < sizeof order / sizeof *order; i++)
        CHECK(take(&door) == order[i]);
}

static bool is_not(const void *number, uint64_t turn)
{
    return turn != *(const uint64_t *)number;
}

TEST(who_may_not_enter_is_passed_over_and_keeps_his_place)
{
    static const uint64_t order[] = { 201, 202, 203 }, then[] = { 101, 204, 102, 0 };
    uint64_t one = 1, turn;
    struct door door = { 0 };
    struct received r;

    for (uint64_t i = 1; i <= 2; i++)
        CHECK(put(&door, "SUBMIT", 1, 100 + i, 100));
    for (uint64_t i = 1; i <= 4; i++)
        CHECK(put(&door, "SUBMIT", 2, 200 + i, 100));
    for (size_t i = 0; i < sizeof order / sizeof *order; i++) {
        CHECK(door_take(&door, is_not, &one, &r, &turn) && r.number == order[i] && turn == 2);
        received_release(&r);
    }
    for (size_t i = 0; i < sizeof then / sizeof *then; i++)
        CHECK(take(&door) == then[i]);
    CHECK(put(&door, "SUBMIT", 1, 103, 100));
    CHECK(!door_take(&door, is_not, &one, &r, &turn));
    CHECK(put(&door, "SUBMIT", 2, 205, 100));      /* behind one that was passed over */
    CHECK(take(&door) == 103 && take(&door) == 205 && take(&door) == 0);
}

/* What N turns come to by UNIT each in turn, each while he may, of 1000. */
static void fill(struct shares *shares, uint64_t n, int64_t unit)
{
    for (bool more = true; more;) {
        more = false;
        for (uint64_t turn = 1; turn <= n; turn++)
            if (shares_admit(shares, turn, 1000)) {
                shares_add(shares, turn, unit);
                more = true;
            }
    }
}

TEST(one_alone_comes_to_a_half_nine_to_nine_tenths_and_another_may_still)
{
    static const struct { uint64_t n; int64_t total; } cases[] = { { 1, 500 }, { 9, 900 } };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct shares shares = { 0 };

        fill(&shares, cases[i].n, 1);
        CHECK(shares.total == cases[i].total && !shares_admit(&shares, 1, 1000));
        CHECK(shares_admit(&shares, 77, 1000));
        shares_add(&shares, 77, 1);
        shares_add(&shares, 0, 1000);              /* nobody's, and of no part */
        CHECK(!shares_admit(&shares, 78, 1000));
        shares_add(&shares, 0, -1000);
        shares_add(&shares, 1, -cases[i].total / (int64_t)cases[i].n);
        CHECK(shares_admit(&shares, 1, 1000));
        shares_done(&shares);
        CHECK(shares.total == 0 && shares_admit(&shares, 77, 1));
    }
}

TEST(who_fills_the_room_is_refused_and_another_is_not)
{
    enum { SIZE = 1 << 20 };
    struct door door = { 0 };
    int own = 0, others = 0;

    while (put(&door, "SUBMIT", 1, 1, SIZE))
        own++;
    CHECK(own == DOOR_MOST / (SIZE + 1024));       /* alone he has all of it */
    while (put(&door, "SUBMIT", 2, 2, SIZE))
        others++;
    CHECK(others >= DOOR_MOST / SIZE / 3 - 1 && others <= DOOR_MOST / SIZE / 2);
    CHECK(!put(&door, "SUBMIT", 1, 1, 8));
    CHECK(put(&door, "CANCEL", 3, 3, 8));          /* whoever has none yet */
    door_done(&door);
    CHECK(door.waiting.size == 0 && take(&door) == 0);
}

/* A push refused among others would be a gap. */
TEST(pushes_of_streams_are_never_refused)
{
    struct door door = { 0 };

    for (int i = 0; i < 3 * 64; i++)
        CHECK(put(&door, "STREAM", 1, 1, 1 << 20));
    CHECK(door.waiting.size > DOOR_FULL);
    door_done(&door);
}
