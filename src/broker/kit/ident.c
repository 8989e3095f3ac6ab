/*
 * ident.c - a number below 2^40 as 8 letters and digits that tell nothing about it
 *
 * Four rounds of a Feistel network on two halves of 20 bits, the round function a keyed mix; a bijection, so that no two
 * numbers share a text.  It hides how many jobs others have; it is no secret that guards anything.
 */
#include "broker/kit/ident.h"
#include "broker/kit/map.h"
#include <string.h>

static const char letters[] = "0123456789abcdefghjkmnpqrstvwxyz";

static uint32_t mix(uint64_t secret, int round, uint32_t half)
{
    return (uint32_t)map_hash_number(secret ^ (uint64_t)round << 56 ^ half) & 0xfffff;
}

void ident_text(char out[9], uint64_t secret, int64_t number)
{
    uint32_t left = (uint32_t)(number >> 20) & 0xfffff, right = (uint32_t)number & 0xfffff;
    uint64_t mixed;

    for (int round = 0; round < 4; round++) {
        uint32_t next = left ^ mix(secret, round, right);
        left = right;
        right = next;
    }
    mixed = (uint64_t)left << 20 | right;
    for (int i = 7; i >= 0; i--, mixed >>= 5)
        out[i] = letters[mixed & 31];
    out[8] = 0;
}

int64_t ident_number(uint64_t secret, const char *text)
{
    uint64_t mixed = 0;
    uint32_t left, right;

    if (strlen(text) != 8)
        return -1;
    for (int i = 0; i < 8; i++) {
        const char *letter = strchr(letters, text[i]);
        if (letter == NULL)
            return -1;
        mixed = mixed << 5 | (uint64_t)(letter - letters);
    }
    left = (uint32_t)(mixed >> 20), right = (uint32_t)mixed & 0xfffff;
    for (int round = 3; round >= 0; round--) {
        uint32_t before = right ^ mix(secret, round, left);
        right = left;
        left = before;
    }
    return (int64_t)((uint64_t)left << 20 | right);
}
