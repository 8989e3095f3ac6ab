/* torus_reach.c - what a change of one law reaches within a step; tested by
 * tests/unit/modal/steady/test_torus.c */
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/steady/torus_taylor.h"

/* Who feels dof j at once, by columns of K and C: next[start[j]] on; and which laws look at it. */
struct graph { int *start, *next, *law_start, *law; };

/* Lists by key from COUNT pairs: START, keys + 1 zeros, counted; then filled by its caller. */
static void starts_of(int keys, int *start)
{
    for (int j = 0; j < keys; j++)
        start[j + 1] += start[j];
}

/* Both of T's entries, in SPACE: counted, then filled, as both are by rows or by laws and wanted by
 * dofs. */
static void set_graph(struct torus_taylor *t, struct workspace *space, struct graph *g)
{
    const struct sparse *both[] = { &t->K, &t->C };
    size_t entries = (size_t)t->K.start[t->n] + (size_t)t->C.start[t->n];
    int n = t->n, *at = workspace_zeros(space, (size_t)n + 1, sizeof *at);

    g->start = workspace_zeros(space, (size_t)n + 1, sizeof *g->start);
    g->law_start = workspace_zeros(space, (size_t)n + 1, sizeof *g->law_start);
    g->next = workspace_zeros(space, entries, sizeof *g->next);
    g->law = workspace_zeros(space, (size_t)t->see.start[t->laws], sizeof *g->law);
    if (space->failed)
        return;
    for (int a = 0; a < 2; a++)
        for (int e = 0; e < both[a]->start[n]; e++)
            g->start[both[a]->index[e] + 1]++;
    starts_of(n, g->start);
    memcpy(at, g->start, (size_t)n * sizeof *at);
    for (int a = 0; a < 2; a++)
        for (int i = 0; i < n; i++)
            for (int e = both[a]->start[i]; e < both[a]->start[i + 1]; e++)
                g->next[at[both[a]->index[e]]++] = i;
    for (int e = 0; e < t->see.start[t->laws]; e++)
        g->law_start[t->see.dof[e] + 1]++;
    starts_of(n, g->law_start);
    memcpy(at, g->law_start, (size_t)n * sizeof *at);
    for (int l = 0; l < t->laws; l++)
        for (int e = t->see.start[l]; e < t->see.start[l + 1]; e++)
            g->law[at[t->see.dof[e]]++] = l;
}

/* The lists of what law L reaches, MARK and LAW_MARK being who has been met for it: of n and of
 * laws; LIST and LAWS room for as many. */
struct search { int *mark, *law_mark, *list, *laws; };

/* Dof I at the end of the list, COUNT long, of law L, unless it is there. */
static void add_dof(struct search *a, int l, int i, int *count)
{
    if (a->mark[i] != l + 1)
        a->mark[i] = l + 1, a->list[(*count)++] = i;
}

/*
 * t->reach of law L, by breadth: what its push moves first, then hop by hop who feels those at
 * once, through a spring, a damper or another law.  A term of the series goes one hop, so that no
 * more than its terms are asked for; where all are reached before, the lists end.
 */
static void find_reach(struct torus_taylor *t, const struct graph *g, struct search *a, int l)
{
    struct torus_reach *r = &t->reach[l];
    int count = 0, laws = 0, done = 0, looked = 0;

    r->dofs = workspace_zeros(&t->space, TORUS_TERMS_MOST, sizeof *r->dofs);
    r->laws = workspace_zeros(&t->space, TORUS_TERMS_MOST, sizeof *r->laws);
    if (t->space.failed)
        return;
    for (int e = t->push.start[l]; e < t->push.start[l + 1]; e++)
        add_dof(a, l, t->push.dof[e], &count);
    r->felt = -1;
    for (r->hops = 0; r->hops < TORUS_TERMS_MOST; r->hops++) {
        for (; looked < count; looked++)
            for (int e = g->law_start[a->list[looked]]; e < g->law_start[a->list[looked] + 1];
                 e++)
                if (a->law_mark[g->law[e]] != l + 1)
                    a->law_mark[g->law[e]] = l + 1, a->laws[laws++] = g->law[e];
        r->dofs[r->hops] = count, r->laws[r->hops] = laws;
        for (; done < r->dofs[r->hops]; done++)
            for (int e = g->start[a->list[done]]; e < g->start[a->list[done] + 1]; e++)
                add_dof(a, l, g->next[e], &count);
        for (int b = r->hops > 0 ? r->laws[r->hops - 1] : 0; b < r->laws[r->hops]; b++)
            for (int e = t->push.start[a->laws[b]]; e < t->push.start[a->laws[b] + 1]; e++)
                add_dof(a, l, t->push.dof[e], &count);
        if (count == r->dofs[r->hops]) {
            r->hops++;
            break;
        }
    }
    count = r->dofs[r->hops - 1];
    r->dof = workspace_room(&t->space, (size_t)count, sizeof *r->dof);
    r->law = workspace_room(&t->space, (size_t)laws, sizeof *r->law);
    if (t->space.failed)
        return;
    memcpy(r->dof, a->list, (size_t)count * sizeof *r->dof);
    memcpy(r->law, a->laws, (size_t)laws * sizeof *r->law);
}

void torus_taylor_set_reach(struct torus_taylor *t)
{
    struct workspace space = { 0 };
    size_t n = (size_t)t->n, L = (size_t)t->laws;
    struct graph g;
    struct search a = { .mark = workspace_zeros(&space, n, sizeof *a.mark),
                        .law_mark = workspace_zeros(&space, L, sizeof *a.law_mark),
                        .list = workspace_zeros(&space, n, sizeof *a.list),
                        .laws = workspace_zeros(&space, L, sizeof *a.laws) };

    set_graph(t, &space, &g);
    t->reach = workspace_zeros(&t->space, L, sizeof *t->reach);
    for (int l = 0; !space.failed && !t->space.failed && l < t->laws; l++)
        find_reach(t, &g, &a, l);
    t->space.failed |= space.failed;
    workspace_free(&space);
}
