/* Who floods the ledger leaves half of its time to whoever else asks, and has all of it alone. */
#include "broker/core/core.h"
#include "broker/core/spell.h"
#include "check.h"

enum { FLOOD = 11, SECOND_FLOOD = 12, ONE = 13 };

static void put(struct spell *spell, uint64_t turn, int64_t now)
{
    const struct transaction t = { .turn = turn, .cost = 70000 };

    spell_put(spell, &t, now);
}

TEST(a_flood_without_anybody_else_never_rests)
{
    struct spell spell = { 0 };

    for (int64_t now = 0; now < 1000; now += 10) {
        for (int i = 0; i < 5; i++) {
            CHECK(spell_next_ns(&spell) <= now);
            put(&spell, FLOOD, now);
        }
        spell_take(&spell, now == 0 ? 4 : 5, now + 9);
    }
    spell_done(&spell);
}

/* Groups of 10 ns: two are under way when somebody else comes, and from then on half of the time
 * is his. */
TEST(once_another_asks_it_enters_no_more_after_a_group_and_rests_as_long_as_it_took)
{
    struct spell spell = { 0 };

    put(&spell, FLOOD, 0);
    spell_other(&spell, ONE);
    CHECK(spell_next_ns(&spell) <= 1);
    put(&spell, FLOOD, 1);
    spell_take(&spell, 1, 10);
    CHECK(spell_next_ns(&spell) == INT64_MAX);
    spell_take(&spell, 0, 15);                         /* a group without any of it */
    CHECK(spell_next_ns(&spell) == INT64_MAX);
    spell_take(&spell, 1, 20);
    CHECK(spell_next_ns(&spell) == 40 && spell_bars(&spell, FLOOD, 39)
          && !spell_bars(&spell, ONE, 39) && !spell_bars(&spell, FLOOD, 40));
    spell_other(&spell, ONE);                          /* in the rest, for the next spell */
    put(&spell, FLOOD, 40);
    spell_take(&spell, 1, 55);
    CHECK(spell_next_ns(&spell) == 70);
    put(&spell, FLOOD, 70);
    spell_take(&spell, 1, 85);                         /* the other asked nothing since */
    CHECK(spell_next_ns(&spell) <= 85);
    spell_done(&spell);
}

TEST(those_who_flood_are_not_another_to_each_other_when_one_is_let_in_at_once)
{
    struct spell spell = { 0 };

    for (int i = 0; i < 4; i++) {
        put(&spell, FLOOD, 0);
        put(&spell, SECOND_FLOOD, 0);
    }
    spell_other(&spell, SECOND_FLOOD);
    spell_take(&spell, 8, 10);
    CHECK(spell_next_ns(&spell) <= 10);
    put(&spell, FLOOD, 10);
    spell_other(&spell, SECOND_FLOOD);                 /* by the spell before */
    spell_take(&spell, 1, 20);
    CHECK(spell_next_ns(&spell) <= 20);
    spell_done(&spell);
}

TEST(a_group_that_stood_still_is_rested_for_a_second_at_most)
{
    struct spell spell = { 0 };

    put(&spell, FLOOD, 0);
    spell_other(&spell, ONE);
    spell_take(&spell, 1, INT64_C(60000000000));
    CHECK(spell_next_ns(&spell) == INT64_C(61000000000));
    spell_done(&spell);
}
