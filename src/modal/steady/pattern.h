/* pattern.h - which of the dofs that iterate act on which: the structure of S_k and of a
 * balance's derivative */
#ifndef MODAL_PATTERN_H
#define MODAL_PATTERN_H
#include <stdbool.h>
#include "base/error.h"

struct program;

/* Column j has rows index[start[j]] .. index[start[j+1] - 1], the diagonal among them, ascending.
 * */
struct pattern {
    int q;
    int *start, *index;
    bool *mixes;          /* per entry: a law or a periodic matrix couples harmonics there */
    bool full;            /* every entry is there: start[j] = j q */
    int ends;             /* the most, over dofs, of the ends of all laws there: to ground 1,
                           * else 2 */
};

/*
 * Of P, PLACE[dof] a dof's index among the q that iterate, or -1; (j, i) is there with each (i, j).
 * FULL: every entry, for the linear dofs taken out couple all others.  Fails with
 * MODAL_NO_MEMORY; pattern_free takes NULL.
 */
enum modal_status pattern_new(const struct program *p, const int *place, int q, bool full,
                              struct pattern **out, struct modal_error *err);
/* Frees S; NULL is none. */
void pattern_free(struct pattern *s);
/* Entries in all: start[q]. */
int pattern_entries(const struct pattern *s);
/* The number of entry (i, j), which is there. */
int pattern_find(const struct pattern *s, int i, int j);
#endif
