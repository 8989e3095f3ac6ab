/* torus_from.c - a motion begun at one near by, whose tones or scene differ a little; tested by
 * tests/unit/modal/steady/test_torus.c */
#include "modal/steady/torus_state.h"
#include <math.h>
#include <stdlib.h>

static const double LEFT = 0.1;           /* of the error asked for: what all that is left out of a
                                           * start may come to */

/* max over dofs of combination M of the start. */
static double size_at(const struct torus_point *start, int m)
{
    double most = 0;

    for (int i = 0; i < start->q; i++)
        most = fmax(most, cabs(start->start[(size_t)i * (size_t)start->count + (size_t)m]));
    return most;
}

/* Those of the start's combinations that matter and the set lacks.  Of a march's, as many as its
 * record tells, a balance takes none. */
static enum modal_status grow_to_start(struct torus_solver *s, struct modal_error *err)
{
    const struct torus_point *start = s->opt->start;
    double target = torus_target(s);
    double least = LEFT * target * start->amplitude / (start->count + 1);
    struct torus_index *more = malloc(((size_t)start->count + 1) * sizeof *more);
    int count = 0;
    enum modal_status rc;

    if (more == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a start");
    for (int m = 0; !start->marched && m < start->count; m++) {
        bool flipped;
        struct torus_index k = torus_signed(&s->tones, start->index[m], &flipped);

        if (!torus_in_set(s, k) && size_at(start, m) > least)
            more[count++] = k;
    }
    rc = count > 0 ? torus_grow(s, more, count, err) : MODAL_OK;
    free(more);
    return rc;
}

/* The start's motion where the set has its combinations; some may have changed their sign. */
static void take_motion(struct torus_solver *s)
{
    const struct torus_point *start = s->opt->start;

    for (int m = 0; m < start->count; m++) {
        bool flipped;
        struct torus_index k = torus_signed(&s->tones, start->index[m], &flipped);

        for (int l = 0; l < s->count; l++)
            for (int i = 0; i < s->q && torus_equal(s->index[l], k); i++) {
                double complex X = start->start[(size_t)i * (size_t)start->count + (size_t)m];

                s->X[(size_t)i * (size_t)s->count + (size_t)l] = flipped ? conj(X) : X;
            }
    }
}

/* The free tone where the start has it, its phase that of the dof that moves most. */
static enum modal_status take_tone(struct torus_solver *s, struct modal_error *err)
{
    struct torus_tone *t = &s->tone;
    struct torus_index k = { { 0 } };
    size_t K = (size_t)s->count;
    double complex turn;

    t->damping = calloc((size_t)s->q + 1, sizeof *t->damping);
    if (t->damping == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
    k.k[t->index] = 1;
    for (int m = 0; m < s->count; m++)
        t->at = torus_equal(s->index[m], k) ? m : t->at;
    for (int i = 0; i < s->q; i++)
        if (cabs(s->X[(size_t)i * K + (size_t)t->at]) > cabs(s->X[torus_tone_place(s)]))
            t->lead = i;
    turn = conj(s->X[torus_tone_place(s)]);
    turn = cabs(turn) > 0 ? turn / cabs(turn) : 1;
    for (size_t e = 0; e < (size_t)s->q * K; e++)
        s->X[e] *= cpow(turn, s->index[e % K].k[t->index]);
    torus_tone_keep(s);
    return MODAL_OK;
}

enum modal_status torus_begin_from(struct torus_solver *s, int order, struct modal_error *err)
{
    enum modal_status rc = torus_grow_to_order(s, order, err);

    if (rc == MODAL_OK && s->opt->order == 0)
        rc = grow_to_start(s, err);
    if (rc == MODAL_OK)
        take_motion(s);
    return rc == MODAL_OK && s->tone.index >= 0 ? take_tone(s, err) : rc;
}
