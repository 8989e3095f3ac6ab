/*
 * spell.c - see spell.h
 *
 * Who asks one thing after the other has no more than that before the ledger; who floods has
 * megabytes, and a group of commits takes as long as all that is in it.  Where each took part in
 * each group, the first would have one thing done in the time that those megabytes take: what a
 * flood sends would be his price.  So time is shared.  What is heavy, of one who has much there or
 * had to wait at the door, enters in spells: once a group with some of it is committed no more
 * enters, and when the last is committed they rest for as long as that took.  In the rest the
 * others are alone with the ledger, so that they have half of what they have alone, whatever is
 * sent, and besides what goes along in a spell's groups.  What one asks now and then waits for one
 * spell at most.
 *
 * Whoever had little may have much all at once, and enters in a rest too, and while a spell is
 * ending.  Neither lasts longer for that, or many who do so in turn would keep those who wait from
 * the ledger for ever: a spell ends with what was under way when it began to end, for commits come
 * back in their order, and what comes back in a rest is no spell.
 *
 * There is no rest where nobody else has asked anything since the last one: who is alone has the
 * whole ledger, several who flood have it in turn.  One of those whose requests enter at once now
 * and then is not somebody else; whoever had less in the spells than half of an equal part is.
 */
#include "broker/core/spell.h"
#include "broker/core/state.h"

/* A group that took longer was held up by a disk that stood still: what stands is not shared. */
#define REST_MOST SECOND

/* Had TURN less in the spells than half of an equal part? */
static bool is_light(const struct spell *spell, uint64_t turn)
{
    const struct shares *now = &spell->now, *before = &spell->before;
    const size_t users = now->by_turn.count > before->by_turn.count ? now->by_turn.count
                                                                    : before->by_turn.count;
    const int64_t own = shares_of(now, turn) + shares_of(before, turn);

    return 2 * own * (int64_t)users < now->total + before->total;
}

void spell_other(struct spell *spell, uint64_t turn)
{
    if (turn != 0 && is_light(spell, turn))
        spell->others = true;
}

void spell_put(struct spell *spell, const struct transaction *t, int64_t now_ns)
{
    if (spell->under_way++ == 0)
        spell->since_ns = now_ns;
    shares_add(&spell->now, t->turn, t->cost);
}

/* The next begins, of which this one is the one before. */
static void renew(struct spell *spell, int64_t now_ns)
{
    shares_done(&spell->before);
    spell->before = spell->now;
    spell->now = (struct shares) { 0 };
    spell->since_ns = now_ns;
    spell->ending = false;
}

void spell_take(struct spell *spell, int64_t count, int64_t now_ns)
{
    /* what the rest does not bar may begin in it */
    const int64_t began = spell->since_ns > spell->rest_until_ns ? spell->since_ns
                                                                 : spell->rest_until_ns;
    const int64_t took = now_ns - began;

    if (count == 0)
        return;
    spell->under_way -= count;
    if (now_ns < spell->rest_until_ns)
        return;
    spell->left = spell->ending ? spell->left - count : spell->under_way;
    spell->ending = spell->others;
    if (spell->ending && spell->left > 0)
        return;
    if (spell->others)
        spell->rest_until_ns = now_ns + (took < REST_MOST ? took : REST_MOST);
    spell->others = false;
    renew(spell, now_ns);
}

int64_t spell_next_ns(const struct spell *spell)
{
    return spell->ending ? INT64_MAX : spell->rest_until_ns;
}

bool spell_bars(const struct spell *spell, uint64_t turn, int64_t now_ns)
{
    return spell_next_ns(spell) > now_ns && !is_light(spell, turn);
}

void spell_done(struct spell *spell)
{
    shares_done(&spell->now);
    shares_done(&spell->before);
    *spell = (struct spell) { 0 };
}
