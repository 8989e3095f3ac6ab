/*
 * linearised.c - see linearised.h
 *
 * A slope D(theta) between what it sees, a^T x, and what it pushes, b, is D b a^T among K or C: its
 * mean with the constant part, and at harmonic k the cosine Re D_k and the sine -Im D_k, with those
 * of the program: Re D_k e^(ik theta) = Re D_k cos k theta - Im D_k sin k theta.  K' and C' of
 * (3) of program.h are then exact: no law is left.
 *
 * A channel of E ends that are seen and pushed has E^2 entries in each harmonic's matrix, so that
 * Hill's matrix stays sparse where laws are local.  Harmonics that are 0 are not listed: what
 * pulsates with even ones alone, as a cubic spring in a motion of odd ones, has half as many.
 *
 * Units: D in N/m (place) or N s/m (rate).
 */
#include "modal/steady/linearised.h"
#include <string.h>
#include "modal/scene/period_map.h"

struct sum {                     /* of one matrix */
    const struct linearised_slope *slope;        /* all of them: those of other parts add nothing */
    int count, part, k;          /* of slopes; PROGRAM_C or PROGRAM_K; its harmonic, 0: the mean */
    bool sine;                   /* not the cosine; the mean has none */
};

/* What SLOPE's entries are multiplied with in S; 0: it is no part of it. */
static double factor_of(const struct sum *s, const struct linearised_slope *slope)
{
    if (s->k > slope->top || slope->channel->rate != (s->part == PROGRAM_C))
        return 0;
    return s->sine ? -cimag(slope->harmonic[s->k]) : creal(slope->harmonic[s->k]);
}

/* OWN and the slopes' part of S, into OUT; how many entries, OUT NULL: counted. */
static int list_entries(const struct sum *s, const struct sparse *own, struct triplet *out)
{
    int count = 0;

    for (int i = 0; i < own->m; i++)
        for (int e = own->start[i]; e < own->start[i + 1]; e++, count++)
            if (out != NULL)
                out[count] = (struct triplet){ i, own->index[e], own->value[e] };
    for (int c = 0; c < s->count; c++) {
        const struct period_channel *at = s->slope[c].channel;
        double factor = factor_of(s, &s->slope[c]);
        for (int i = 0; factor != 0 && i < at->outs; i++)
            for (int j = 0; j < at->ins; j++, count++)
                if (out != NULL)
                    out[count] =
                        (struct triplet){ at->out[i].dof, at->in[j].dof,
                                          factor * at->out[i].weight * at->in[j].weight };
    }
    return count;
}

/* OWN, which may be empty, and the slopes' part of S. */
static enum modal_status add_up(const struct sum *s, int n, const struct sparse *own,
                                struct sparse *out, struct modal_error *err)
{
    struct workspace scratch = { 0 };
    int count = list_entries(s, own, NULL);
    struct triplet *entry = workspace_zeros(&scratch, (size_t)count, sizeof *entry);
    enum modal_status rc = workspace_check(&scratch, "stability: no memory", err);

    if (rc == MODAL_OK && count > 0) {
        list_entries(s, own, entry);
        rc = sparse_from_triplets(n, n, entry, count, out, err);
    }
    workspace_free(&scratch);
    return rc;
}

/* Harmonic K of all, OWN those of the program or NULL. */
static enum modal_status add_harmonic(struct linearised *l, struct sum s,
                                      const struct program_harmonic *own, struct modal_error *err)
{
    struct program_harmonic *to = &l->program.harmonic[l->program.harmonics++];
    const struct sparse none = { 0 };
    enum modal_status rc = MODAL_OK;

    to->k = s.k;
    for (s.part = PROGRAM_C; rc == MODAL_OK && s.part <= PROGRAM_K; s.part++) {
        s.sine = false;
        rc = add_up(&s, l->program.n, own != NULL ? &own->cosine[s.part] : &none,
                    &to->cosine[s.part], err);
        s.sine = true;
        if (rc == MODAL_OK)
            rc = add_up(&s, l->program.n, own != NULL ? &own->sine[s.part] : &none,
                        &to->sine[s.part], err);
    }
    return rc;
}

enum modal_status linearised_make(const struct program *p, const struct linearised_slope *slope,
                                  int count, struct linearised *out, struct modal_error *err)
{
    struct sum s = { .slope = slope, .count = count };
    int top = 0, next = 0;
    enum modal_status rc;

    *out = (struct linearised){ .program = *p };
    for (int c = 0; c < count; c++)
        top = slope[c].top > top ? slope[c].top : top;
    out->program.laws = out->program.loads = out->program.harmonics = 0;
    /* not the borrowed ones: linearised_done frees these two */
    memset(&out->program.constant[PROGRAM_C], 0, 2 * sizeof *out->program.constant);
    out->program.harmonic = workspace_zeros(&out->space, (size_t)(top + p->harmonics),
                                            sizeof *out->program.harmonic);
    rc = workspace_check(&out->space, "stability: no memory", err);
    for (s.part = PROGRAM_C; rc == MODAL_OK && s.part <= PROGRAM_K; s.part++)
        rc = add_up(&s, p->n, &p->constant[s.part], &out->program.constant[s.part], err);
    for (s.k = 1; rc == MODAL_OK && (s.k <= top || next < p->harmonics); s.k++) {
        bool own = next < p->harmonics && p->harmonic[next].k == s.k, pulsates = own;

        for (int c = 0; c < count; c++)
            pulsates |= s.k <= slope[c].top && slope[c].harmonic[s.k] != 0;
        if (pulsates)
            rc = add_harmonic(out, s, own ? &p->harmonic[next] : NULL, err);
        next += own;
    }
    return rc;
}

void linearised_done(struct linearised *l)
{
    struct program *p = &l->program;

    for (int part = PROGRAM_C; part <= PROGRAM_K; part++) {
        sparse_done(&p->constant[part]);
        for (int h = 0; h < p->harmonics; h++) {
            sparse_done(&p->harmonic[h].cosine[part]);
            sparse_done(&p->harmonic[h].sine[part]);
        }
    }
    workspace_free(&l->space);
    *l = (struct linearised){ 0 };
}
