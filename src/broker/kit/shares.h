/* shares.h - room that many have a part of, in which nobody's part makes the others' small */
#ifndef BROKER_SHARES_H
#define BROKER_SHARES_H
#include "broker/kit/map.h"

/* Zero: nobody has any. */
struct shares {
    struct map by_turn;
    int64_t total;                        /* of all parts, also of those of nobody */
};

/* AMOUNT, which may be below zero, to what TURN has; 0: nobody. */
void shares_add(struct shares *shares, uint64_t turn, int64_t amount);
/* What TURN has. */
int64_t shares_of(const struct shares *shares, uint64_t turn);
/* May TURN have more, of MOST?  Yes while he has less than is free: one alone comes to a half, n
 * come to one part of n + 1 each, and as much stays free for who has none yet. */
bool shares_admit(const struct shares *shares, uint64_t turn, int64_t most);
/* Nobody has any. */
void shares_done(struct shares *shares);
#endif
