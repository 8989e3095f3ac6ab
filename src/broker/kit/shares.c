/* shares.c - see shares.h */
#include "broker/kit/shares.h"
#include "broker/kit/memory.h"
#include <stdlib.h>

struct share { int64_t size; };

static struct share *find(const struct shares *shares, uint64_t turn)
{
    return map_find_number(&shares->by_turn, turn);
}

void shares_add(struct shares *shares, uint64_t turn, int64_t amount)
{
    struct share *share = find(shares, turn);

    shares->total += amount;
    if (turn == 0)
        return;
    if (share == NULL) {
        share = grab(sizeof *share);
        if (!map_put(&shares->by_turn, map_hash_number(turn), share))
            abort();
    }
    share->size += amount;
    if (share->size == 0) {
        map_remove(&shares->by_turn, map_hash_number(turn), share);
        free(share);
    }
    if (shares->by_turn.count == 0)
        map_done(&shares->by_turn);
}

int64_t shares_of(const struct shares *shares, uint64_t turn)
{
    const struct share *share = find(shares, turn);

    return share == NULL ? 0 : share->size;
}

bool shares_admit(const struct shares *shares, uint64_t turn, int64_t most)
{
    return shares_of(shares, turn) < most - shares->total;
}

void shares_done(struct shares *shares)
{
    struct share *share;

    for (size_t at = 0; (share = map_next(&shares->by_turn, &at)) != NULL;)
        free(share);
    map_done(&shares->by_turn);
    shares->total = 0;
}
