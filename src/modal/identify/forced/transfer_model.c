/* transfer_model.c - models of transfer.h: room, copies, one pole more or less */
#include "modal/identify/forced/transfer.h"
#include <stdlib.h>
#include <string.h>

void transfer_done(struct transfer *t)
{
    free(t->s), free(t->q), free(t->held), free(t->x), free(t->rss), free(t->band);
    free(t->variance);
    free(t->spread), free(t->energy);
    memset(t, 0, sizeof *t);
}

static size_t size_of_x(const struct lines *l, int poles)
{
    return (size_t)(2 * poles + l->direct) * (size_t)l->responses;
}

enum modal_status transfer_new(const struct lines *l, struct transfer *out, struct modal_error *err)
{
    const size_t most = TRANSFER_POLES_MOST, responses = (size_t)l->responses;

    *out = (struct transfer) {
        .s = calloc(most, sizeof *out->s),
        .q = calloc(most * (size_t)l->drives, sizeof *out->q),
        .held = calloc(most, sizeof *out->held),
        .x = calloc(size_of_x(l, TRANSFER_POLES_MOST), sizeof *out->x),
        .rss = calloc(responses, sizeof *out->rss),
        .band = calloc(responses * (size_t)l->bands, sizeof *out->band),
        .variance = calloc(responses, sizeof *out->variance),
        .spread = calloc(2 * most, sizeof *out->spread),
        .energy = calloc(most, sizeof *out->energy) };
    if (out->s != NULL && out->q != NULL && out->held != NULL && out->x != NULL && out->rss != NULL
        && out->band != NULL && out->variance != NULL && out->spread != NULL && out->energy != NULL)
        return MODAL_OK;
    transfer_done(out);
    return modal_fail(err, MODAL_NO_MEMORY, "transfer: no memory for %d responses", l->responses);
}

void transfer_copy(const struct lines *l, const struct transfer *from, struct transfer *to)
{
    size_t n = (size_t)from->poles, responses = (size_t)l->responses;
    struct transfer own = *to;

    *to = *from;
    to->s = memcpy(own.s, from->s, sizeof *own.s * n);
    to->q = memcpy(own.q, from->q, sizeof *own.q * n * (size_t)l->drives);
    to->held = memcpy(own.held, from->held, sizeof *own.held * n);
    to->x = memcpy(own.x, from->x, sizeof *own.x * size_of_x(l, from->poles));
    to->rss = memcpy(own.rss, from->rss, sizeof *own.rss * responses);
    to->band = memcpy(own.band, from->band, sizeof *own.band * responses * (size_t)l->bands);
    to->variance = memcpy(own.variance, from->variance, sizeof *own.variance * responses);
    to->spread = memcpy(own.spread, from->spread, sizeof *own.spread * 2 * n);
    to->energy = memcpy(own.energy, from->energy, sizeof *own.energy * n);
}

void transfer_hold(const struct lines *l, struct transfer *t, int p)
{
    double complex *q = t->q + (size_t)p * l->drives, one;
    int at = 0;

    for (int j = 1; j < l->drives; j++)
        if (cabs(q[j]) > cabs(q[at]))
            at = j;
    /* phi q^T is one product: a factor moves from one to the other, and one entry holds it */
    one = q[at];
    for (int j = 0; j < l->drives; j++)
        q[j] = one != 0 ? q[j] / one : j == at;
    q[at] = 1;
    t->held[p] = at;
}

void transfer_add(const struct lines *l, struct transfer *t, double complex s,
                  const double complex *q)
{
    int p = t->poles++;

    t->s[p] = s;
    memcpy(t->q + (size_t)p * l->drives, q, sizeof *q * (size_t)l->drives);
    transfer_hold(l, t, p);
}

void transfer_drop(const struct lines *l, struct transfer *t, int pole)
{
    size_t behind = (size_t)(--t->poles - pole), drives = (size_t)l->drives;

    memmove(t->s + pole, t->s + pole + 1, sizeof *t->s * behind);
    memmove(t->held + pole, t->held + pole + 1, sizeof *t->held * behind);
    memmove(t->q + (size_t)pole * drives, t->q + ((size_t)pole + 1) * drives,
            sizeof *t->q * behind * drives);
}
