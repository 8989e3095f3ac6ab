/* spell.h - of who has much before the ledger, and of whoever else asks, each has half of the
 * ledger's time */
#ifndef BROKER_SPELL_H
#define BROKER_SPELL_H
#include "broker/kit/shares.h"

struct transaction;

/* Zero: nobody has much. */
struct spell {
    struct shares now, before;     /* costs of what is heavy, in this spell and in the one before */
    int64_t under_way;             /* transactions of those, which are not committed yet */
    int64_t left;                  /* of these, those that it ends with, once it is ending */
    int64_t since_ns;              /* it began, monotonic */
    int64_t rest_until_ns;         /* it begins no earlier */
    bool others;                   /* somebody else has asked something since the last rest */
    bool ending;                   /* a group of it is committed, and others ask: no more enter */
};

/* TURN asks, and has not waited. */
void spell_other(struct spell *spell, uint64_t turn);
/* T, which is heavy, goes to the ledger. */
void spell_put(struct spell *spell, const struct transaction *t, int64_t now_ns);
/* COUNT such transactions have come back, of one or more whole groups. */
void spell_take(struct spell *spell, int64_t count, int64_t now_ns);
/* When those who wait may go in, monotonic; INT64_MAX: not before more come back. */
int64_t spell_next_ns(const struct spell *spell);
/* Is TURN one of those, who waits until then? */
bool spell_bars(const struct spell *spell, uint64_t turn, int64_t now_ns);
/* Nobody has had much. */
void spell_done(struct spell *spell);
#endif
