/* near.h - which of the words that there are may have been meant by one that there is not */
#ifndef BASE_NEAR_H
#define BASE_NEAR_H
#include <stddef.h>

enum { NEAR_TEXT = 160 };            /* room for the words that a message suggests */

/*
 * "; did you mean a, b?" of those of NAMES (NULL-terminated) that begin with WORD or are a third of
 * its letters away at most, in their order; "" where there is none.
 */
void near_text(const char *word, const char *const *names, char out[NEAR_TEXT]);

/* The same of COUNT names that people gave, of dofs and channels.  NULL is no name; what differs
 * from WORD in its digits alone is another of a row, and not meant. */
void near_given(const char *word, const char *const *names, size_t count, char out[NEAR_TEXT]);

enum { NEAR_ACCEPTED = 800 };        /* room for these and all that is accepted */

/* The same, then "; accepted: " and all NAMES: how a message ends that refuses a word. */
void near_accepted(const char *word, const char *const *names, char out[NEAR_ACCEPTED]);
#endif
