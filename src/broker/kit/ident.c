/*
 * ident.c - a number below 2^40 as 8 letters and digits that tell nothing about it
 *
 * Four rounds of a Feistel network on two halves of 20 bits, the round function a keyed mix; a
 * bijection, so that no two numbers share a text.  It hides how many jobs others have; it is no
 * secret that guards anything.
 */
#include "broker/kit/ident.h"
#include "broker/kit/map.h"
#include <string.h>

static const char letters[] = "0123456789abcdefghjkmnpqrstvwxyz";

enum {
    HALF_BITS = 20,           /* of numbers below 2^40 */
    HALF = (1 << HALF_BITS) - 1,
    ROUNDS = 4,               /* with four a Feistel network is a strong permutation */
    SIGNS = 8,                /* of 5 bits */
};

static uint32_t mix(uint64_t secret, int round, uint32_t half)
{
    return (uint32_t)map_hash_number(secret ^ (uint64_t)round << 56 ^ half) & HALF;
}

void ident_text(char out[9], uint64_t secret, int64_t number)
{
    uint32_t left = (uint32_t)(number >> HALF_BITS) & HALF, right = (uint32_t)number & HALF;
    uint64_t mixed;

    for (int round = 0; round < ROUNDS; round++) {
        uint32_t next = left ^ mix(secret, round, right);
        left = right;
        right = next;
    }
    mixed = (uint64_t)left << HALF_BITS | right;
    for (int i = SIGNS - 1; i >= 0; i--, mixed >>= 5)
        out[i] = letters[mixed & 31];
    out[SIGNS] = 0;
}

int64_t ident_number(uint64_t secret, const char *text)
{
    uint64_t mixed = 0;
    uint32_t left, right;

    if (strlen(text) != SIGNS)
        return -1;
    for (int i = 0; i < SIGNS; i++) {
        const char *letter = strchr(letters, text[i]);
        if (letter == NULL)
            return -1;
        mixed = mixed << 5 | (uint64_t)(letter - letters);
    }
    left = (uint32_t)(mixed >> HALF_BITS), right = (uint32_t)mixed & HALF;
    for (int round = ROUNDS - 1; round >= 0; round--) {
        uint32_t before = right ^ mix(secret, round, left);
        right = left;
        left = before;
    }
    return (int64_t)((uint64_t)left << HALF_BITS | right);
}
