/* condense_known.c - the harmonics of one frequency that are known, and whom else they serve; see
 * condense_state.h; tested by tests/unit/modal/steady/test_condense.c
 *
 * S_k and the solutions for the kept dofs, (2) of condense.h, depend on the matrices alone, p_k and
 * the solution for the loads on those of harmonic k too, linearly.  So a scene with another law, or
 * with loads of another size, has nothing to factor.
 */
#include <complex.h>
#include <stdlib.h>
#include <string.h>
#include "modal/steady/condense_state.h"
#include "modal/steady/pattern.h"

void condense_forget(struct condense *c, int keep)
{
    for (int k = keep; k < c->known; k++) {
        free(c->harmonic[k].S);
        free(c->harmonic[k].p);
        free(c->harmonic[k].row);
    }
    c->known = c->known < keep ? c->known : keep;
}

enum modal_status condense_add_harmonic(struct condense *c, struct modal_error *err)
{
    size_t q = (size_t)c->q, entries = (size_t)pattern_entries(c->pattern);
    struct condense_harmonic *h;

    if (c->known == c->harmonics) {
        size_t more = 2 * (size_t)c->harmonics + 16;

        h = realloc(c->harmonic, more * sizeof *h);
        if (h == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "condense: no memory for a harmonic");
        c->harmonic = h;
        c->harmonics = (int)more;
    }
    h = &c->harmonic[c->known++];
    *h = (struct condense_harmonic) { calloc(entries + 1, sizeof *h->S),
                                      calloc(q + 1, sizeof *h->p),
                                      calloc((size_t)c->seats * (q + 1) + 1, sizeof *h->row),
                                      .stale = true };
    return h->S != NULL && h->p != NULL && h->row != NULL
               ? MODAL_OK
               : modal_fail(err, MODAL_NO_MEMORY, "condense: no memory for a harmonic");
}

bool condense_lacks(const struct condense *c, int k)
{
    const struct condense_harmonic *h = &c->harmonic[k];
    bool driven = false;

    if (c->force == NULL || k <= c->exact)
        return h->stale || h->rough;
    for (int i = 0; i < c->q && k <= c->top; i++)
        driven |= c->force[i * (c->top + 1) + k] != 0;
    return h->stale && driven;
}

static bool same_matrix(const struct sparse *a, const struct sparse *b)
{
    size_t rows = (size_t)a->m + 1, entries;

    if (a->m != b->m || (a->start == NULL) != (b->start == NULL))
        return false;
    if (a->start == NULL)
        return true;
    entries = (size_t)a->start[a->m];
    return memcmp(a->start, b->start, rows * sizeof *a->start) == 0
           && memcmp(a->index, b->index, entries * sizeof *a->index) == 0
           && memcmp(a->value, b->value, entries * sizeof *a->value) == 0;
}

/* The same matrices on the same kept and wanted dofs, sparse. */
static bool same_linear_part(const struct condense *a, const struct condense *b)
{
    size_t n = (size_t)a->n;
    bool same = a->sparse && b->sparse && a->n == b->n && a->q == b->q
                && pattern_entries(a->pattern) == pattern_entries(b->pattern)
                && memcmp(a->place, b->place, n * sizeof *a->place) == 0
                && memcmp(a->seat, b->seat, n * sizeof *a->seat) == 0;

    for (int t = 0; same && t < 3; t++)
        same = same_matrix(&a->p->constant[t], &b->p->constant[t]);
    return same;
}

/* The I-th load of harmonic K, or NULL. */
static const struct condense_load *load_at(const struct condense *c, int k, int i)
{
    for (int l = 0; l < c->loads; l++)
        if (c->load[l].k == k && i-- == 0)
            return &c->load[l];
    return NULL;
}

/* Whether the loads of harmonic K are those of FROM times *FACTOR, to the last bit: of one load
 * they are, of several where the factor is 1. */
static bool same_loads(const struct condense *c, const struct condense *from, int k,
                       double complex *factor)
{
    const struct condense_load *a, *b;
    bool same = true;
    int i = 0;

    do {
        a = load_at(c, k, i);
        b = load_at(from, k, i);
        same = (a == NULL) == (b == NULL)
               && (a == NULL || (a->dof == b->dof && (i == 0 || a->value == b->value)));
        if (i == 0)
            *factor = a != NULL && same ? a->value / b->value : 1;
        else if (a != NULL && *factor != 1)
            same = false;
        i++;
    } while (same && a != NULL);
    return same;
}

void condense_inherit(struct condense *c, struct condense *from)
{
    struct condense_harmonic *own = c->harmonic;
    size_t q = (size_t)c->q, seats = (size_t)c->seats;
    int places = c->harmonics;

    if (c->known > 0 || !same_linear_part(c, from))
        return;
    for (int k = 0; k < from->known; k++) {
        struct condense_harmonic *h = &from->harmonic[k];
        double complex factor = 1;

        if (!same_loads(c, from, k, &factor))
            h->stale = true;
        for (size_t i = 0; factor != 1 && i < q; i++)
            h->p[i] *= factor;
        for (size_t i = 0; factor != 1 && i < seats; i++)
            h->row[q * seats + i] *= factor;
    }
    c->harmonic = from->harmonic;
    c->known = from->known;
    c->harmonics = from->harmonics;
    c->known_at = from->known_at;
    from->harmonic = own;
    from->known = 0;
    from->harmonics = places;
}
