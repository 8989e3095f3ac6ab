/* near.c - see near.h; tested by tests/unit/base/test_json.c */
#include "base/near.h"
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

enum { WORD_MOST = 64 };             /* letters of a word that is compared: none of ours has more */

static int least(int a, int b)
{
    return a < b ? a : b;
}

/* Slips (a letter changed, put in or left out, two neighbours exchanged) that make A of B, up to
 * MOST + 1. */
static int distance(const char *a, const char *b, int most)
{
    int rows[3][WORD_MOST + 1], n = (int)strlen(b);

    if (strlen(a) > WORD_MOST || n > WORD_MOST)
        return most + 1;
    for (int j = 0; j <= n; j++)
        rows[0][j] = j;
    for (int i = 1; a[i - 1] != 0; i++) {
        int *row = rows[i % 3], *above = rows[(i + 2) % 3], *before = rows[(i + 1) % 3];
        row[0] = i;
        for (int j = 1; j <= n; j++) {
            row[j] = least(above[j - 1] + (a[i - 1] != b[j - 1]), least(above[j], row[j - 1]) + 1);
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
                row[j] = least(row[j], before[j - 2] + 1);
        }
    }
    return least(rows[strlen(a) % 3][n], most + 1);
}

static bool may_mean(const char *word, const char *name)
{
    size_t length = strlen(word);
    int most = (int)(length / 3);

    return length > 1 && (strncmp(word, name, length) == 0 || distance(word, name, most) <= most);
}

/* NAME behind what OUT suggests, of which USED bytes are written; how many are then. */
static size_t suggest(char out[NEAR_TEXT], size_t used, const char *name)
{
    return used + (size_t)snprintf(out + used, NEAR_TEXT - used, "%s%s",
                                   used > 0 ? ", " : "; did you mean ", name);
}

static void end_suggestions(char out[NEAR_TEXT], size_t used)
{
    if (used > 0 && used < NEAR_TEXT - 1)
        memcpy(out + used, "?", sizeof "?");
}

void near_text(const char *word, const char *const *names, char out[NEAR_TEXT])
{
    size_t used = 0;

    out[0] = '\0';
    for (; *names != NULL && used < NEAR_TEXT; names++)
        if (may_mean(word, *names))
            used = suggest(out, used, *names);
    end_suggestions(out, used);
}

/* Are A and B the same but for digits? */
static bool differ_in_digits(const char *a, const char *b)
{
    static const char digits[] = "0123456789";

    do {
        a += strspn(a, digits);
        b += strspn(b, digits);
        if (*a != *b)
            return false;
    } while (*a++ != 0 && *b++ != 0);
    return true;
}

void near_given(const char *word, const char *const *names, size_t count, char out[NEAR_TEXT])
{
    size_t used = 0;

    out[0] = '\0';
    for (size_t i = 0; i < count && used < NEAR_TEXT; i++)
        if (names[i] != NULL && may_mean(word, names[i]) && !differ_in_digits(word, names[i]))
            used = suggest(out, used, names[i]);
    end_suggestions(out, used);
}

void near_accepted(const char *word, const char *const *names, char out[NEAR_ACCEPTED])
{
    size_t used;

    near_text(word, names, out);
    used = strlen(out);
    for (int i = 0; names[i] != NULL && used < NEAR_ACCEPTED; i++)
        used += (size_t)snprintf(out + used, NEAR_ACCEPTED - used, "%s%s",
                                 i > 0 ? ", " : "; accepted: ", names[i]);
}
