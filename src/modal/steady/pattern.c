/*
 * pattern.c - see pattern.h
 *
 * The pairs of kept dofs that act on each other, listed with repetitions, sorted, and each put
 * once: counted in a first pass over the program and written in a second.
 *
 * A pair (i, j) is one number, j 2^33 + i 2 + (0 where harmonics mix, else 1): sorted, pairs are in
 * the order of columns and rows, and of a place that is listed as both the one that mixes comes
 * first.
 */
#include "modal/steady/pattern.h"
#include <stdint.h>
#include <stdlib.h>
#include "modal/scene/program.h"

/* The list; NULL while they are counted. */
struct pairs {
    uint64_t *list;
    size_t count;
};

/* Dof j acts on i, both kept (else negative); counted alone where there is no list. */
static void add_pair(struct pairs *p, int i, int j, bool mixes)
{
    if (i < 0 || j < 0)
        return;
    if (p->list != NULL)
        p->list[p->count] = (uint64_t)j << 33 | (uint64_t)i << 1 | !mixes;
    p->count++;
}

/* Every entry of a matrix, and its mirror image: where rounding left something in one of two that
 * are equal but for it, the pattern is symmetric all the same. */
static void add_matrix(struct pairs *p, const struct sparse *a, const int *place, bool mixes)
{
    for (int i = 0; a->start != NULL && i < a->m; i++)
        for (int e = a->start[i]; e < a->start[i + 1]; e++) {
            add_pair(p, place[i], place[a->index[e]], mixes);
            add_pair(p, place[a->index[e]], place[i], mixes);
        }
}

/* Every end of a law acts on every other, at all harmonics. */
static void add_law(struct pairs *p, const struct law *law, const int *place)
{
    int count = law_ends(law);

    for (int i = 0; i < count; i++)
        for (int j = 0; j < count; j++)
            add_pair(p, place[law->end[i].dof], place[law->end[j].dof], true);
}

/* All pairs of the program; only counted where there is no list yet. */
static void add_program(struct pairs *s, const struct program *p, const int *place, int q)
{
    s->count = 0;
    for (int i = 0; i < q; i++)
        add_pair(s, i, i, false);                       /* a diagonal, which factorizations need */
    /* M, C and K couple dofs at one harmonic; periodic ones mix harmonics, as laws do. */
    for (int t = 0; t < 3; t++)
        add_matrix(s, &p->constant[t], place, false);
    for (int h = 0; h < p->harmonics; h++)
        for (int t = 0; t < 3; t++) {
            add_matrix(s, &p->harmonic[h].cosine[t], place, true);
            add_matrix(s, &p->harmonic[h].sine[t], place, true);
        }
    for (int l = 0; l < p->laws; l++)
        add_law(s, &p->law[l], place);
}

/* qsort: ascending. */
static int by_value(const void *a, const void *b)
{
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;

    return (x > y) - (x < y);
}

/* The list, sorted, into S by columns. */
static void fill_sparse(struct pattern *s, struct pairs *pairs)
{
    int entries = 0;

    qsort(pairs->list, pairs->count, sizeof *pairs->list, by_value);
    for (size_t e = 0; e < pairs->count; e++) {
        uint64_t pair = pairs->list[e];

        /* the same place; the first one said whether it mixes */
        if (e > 0 && pair >> 1 == pairs->list[e - 1] >> 1)
            continue;
        s->index[entries] = (int)(pair >> 1 & 0xffffffff);  /* the row */
        s->mixes[entries++] = !(pair & 1);              /* the least bit, turned */
        s->start[(pair >> 33) + 1] = entries;  /* every column has its diagonal: none is left out */
    }
}

/* Every pair. */
static void fill_full(struct pattern *s)
{
    int q = s->q;

    for (int j = 0; j < q; j++) {
        s->start[j + 1] = (j + 1) * q;
        for (int i = 0; i < q; i++) {
            s->index[j * q + i] = i;
            s->mixes[j * q + i] = true;                 /* what was taken out couples all */
        }
    }
}

/* The most ends of laws that share a dof's force: how many slopes add up there. */
static int most_ends(const struct program *p, const int *place, int *count)
{
    int most = 0;

    for (int l = 0; l < p->laws; l++) {
        const struct law *law = &p->law[l];
        int ends = law_ends(law);

        for (int e = 0; e < ends; e++) {
            int at = place[law->end[e].dof];

            if (at >= 0 && (count[at] += ends) > most)  /* every end pulls at this one */
                most = count[at];
        }
    }
    return most;
}

enum modal_status pattern_new(const struct program *p, const int *place, int q, bool full,
                              struct pattern **out, struct modal_error *err)
{
    struct pattern *s = calloc(1, sizeof *s);
    struct pairs pairs = { 0 };
    int *count = calloc((size_t)q + 1, sizeof *count);
    size_t entries;
    enum modal_status rc = MODAL_OK;

    /* The first pass: how many. */
    if (!full)
        add_program(&pairs, p, place, q);
    entries = full ? (size_t)q * (size_t)q : pairs.count;
    if (s != NULL) {
        *s = (struct pattern) { .q = q, .full = full };
        s->start = calloc((size_t)q + 1, sizeof *s->start);
        s->index = malloc((entries + 1) * sizeof *s->index);
        s->mixes = malloc((entries + 1) * sizeof *s->mixes);
        pairs.list = full ? NULL : malloc((entries + 1) * sizeof *pairs.list);
    }
    if (s == NULL || count == NULL || s->start == NULL || s->index == NULL || s->mixes == NULL
        || (!full && pairs.list == NULL)) {
        pattern_free(s);
        rc = modal_fail(err, MODAL_NO_MEMORY, "pattern: no memory for %zu entries", entries);
    } else {
        /* The second. */
        if (!full)
            add_program(&pairs, p, place, q);
        full ? fill_full(s) : fill_sparse(s, &pairs);
        s->ends = most_ends(p, place, count);
        *out = s;
    }
    free(pairs.list);
    free(count);
    return rc;
}

void pattern_free(struct pattern *s)
{
    if (s == NULL)
        return;
    free(s->start);
    free(s->index);
    free(s->mixes);
    free(s);
}

int pattern_entries(const struct pattern *s) { return s->start[s->q]; }

int pattern_find(const struct pattern *s, int i, int j)
{
    int low = s->start[j], high = s->start[j + 1] - 1;

    if (s->full)
        return j * s->q + i;
    while (low < high) {                                /* rows ascend down a column */
        int middle = (low + high) / 2;

        if (s->index[middle] < i)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}
