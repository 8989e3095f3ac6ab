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

/* Hosts that push much all at once, in turn, each of which had nothing before: commits come back in
 * their order, and the one of 20 is the last that the flood has. */
TEST(a_spell_ends_though_others_who_had_little_put_much_one_after_the_other)
{
    struct spell spell = { 0 };

    put(&spell, FLOOD, 0);
    put(&spell, FLOOD, 0);
    put(&spell, FLOOD, 0);
    spell_other(&spell, ONE);
    spell_take(&spell, 1, 10);
    put(&spell, ONE, 11);
    spell_take(&spell, 1, 15);
    CHECK(spell_next_ns(&spell) == INT64_MAX);
    put(&spell, ONE + 1, 16);
    spell_take(&spell, 1, 20);
    CHECK(spell_next_ns(&spell) == 40);
    spell_done(&spell);
}

TEST(a_rest_is_no_longer_for_what_others_put_in_it)
{
    struct spell spell = { 0 };

    put(&spell, FLOOD, 0);
    spell_other(&spell, ONE);
    spell_take(&spell, 1, 20);
    CHECK(spell_next_ns(&spell) == 40);
    for (int k = 0; k < 6; k++) {                      /* hosts of which each had nothing before */
        const uint64_t host = ONE + (uint64_t)k;
        const int64_t now = 21 + 3 * k;
        CHECK(!spell_bars(&spell, host, now));
        spell_other(&spell, host);
        put(&spell, host, now);
        spell_take(&spell, 1, now + 2);
        CHECK(spell_next_ns(&spell) == 40 && (k > 0 || spell_bars(&spell, FLOOD, now + 2)));
    }
    spell_done(&spell);
}

/* What has 20 ns in a rest that ends at 40, and comes back at 50, had 10 of a spell. */
TEST(what_goes_on_beyond_a_rest_is_a_spell_from_the_end_of_the_rest_on)
{
    struct spell spell = { 0 };

    put(&spell, FLOOD, 0);
    spell_other(&spell, ONE);
    spell_take(&spell, 1, 20);
    spell_other(&spell, ONE);
    put(&spell, ONE, 30);
    spell_take(&spell, 1, 50);
    CHECK(spell_next_ns(&spell) == 60);
    spell_done(&spell);
}
