/* torus_fold.c - see torus_fold.h; tested by tests/unit/modal/steady/test_torus.c */
#include "modal/steady/torus_fold.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { NUMBER_MOST = 8 };                 /* n_j: a march settles and is sampled turn by turn of
                                           * the fastest tone, and by turns of w costs up to as many
                                           * times what its record needs */
static const double SAME = 4 * DBL_EPSILON;   /* of a tone: a quotient, a product, and as many where
                                               * it was made */

/* A combination, its harmonic, and where the motion of that is. */
struct told { struct torus_index k; int order, h, from; };

bool torus_fold_finds(const double *omega, int count, struct torus_fold *f)
{
    bool found = false;

    *f = (struct torus_fold) { .count = count };
    for (int n = 1; count > 1 && !found && n <= NUMBER_MOST; n++) {
        f->omega = omega[0] / n;
        found = true;
        for (int j = 0; found && j < count; j++) {
            double number = round(omega[j] / f->omega);

            found = number >= 1 && number <= NUMBER_MOST
                && fabs(omega[j] - number * f->omega) <= SAME * omega[j];
            f->number[j] = found ? (int)number : 0;
        }
    }
    return found;
}

/* (1). */
static int harmonic(const struct torus_fold *f, const int *k)
{
    int h = 0;

    for (int j = 0; j < f->count; j++)
        h += f->number[j] * k[j];
    return h;
}

/* The start's motion at harmonics, combinations of one harmonic summed; what it balanced with is of
 * no use then. */
static enum modal_status fold_start(struct torus_fold *f, const struct torus_point *was,
                                    struct modal_error *err)
{
    size_t count = (size_t)was->count;
    struct torus_point *to = &f->start;
    int highest = 0, *place;

    *to = (struct torus_point) { .converged = was->converged, .marched = was->marched, .q = was->q,
                                 .amplitude = was->amplitude,
                                 .tones = torus_tones_of(&f->omega, 1),
                                 .index = calloc(count + 1, sizeof *to->index),
                                 .start = calloc((size_t)was->q * count + 1,
                                                 sizeof *to->start) };
    for (size_t m = 0; m < count; m++)
        highest = (int)fmax(highest, abs(harmonic(f, was->index[m].k)));
    place = calloc((size_t)highest + 1, sizeof *place);
    if (to->index == NULL || to->start == NULL || place == NULL) {
        free(place);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a start");
    }
    for (size_t m = 0; m < count; m++) {                       /* 1 + where it comes to */
        int h = abs(harmonic(f, was->index[m].k));

        if (place[h] == 0)
            to->index[to->count].k[0] = h, place[h] = ++to->count;
    }
    for (size_t m = 0; m < count; m++) {
        int h = harmonic(f, was->index[m].k);

        for (int i = 0; i < was->q; i++) {
            double complex X = was->start[(size_t)i * count + m];

            to->start[i * to->count + place[abs(h)] - 1] += h < 0 ? conj(X) : X;
        }
    }
    free(place);
    return MODAL_OK;
}

enum modal_status torus_fold_make(struct torus_fold *f, const struct program *p,
                                  const struct torus_options *opt, struct modal_error *err)
{
    size_t loads = (size_t)p->loads;

    f->view = *p;
    f->opt = *opt;
    f->view.load = malloc((loads + 1) * sizeof *f->view.load);
    if (f->view.load == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for loads");
    if (loads > 0)
        memcpy(f->view.load, p->load, loads * sizeof *p->load);
    for (size_t i = 0; i < loads; i++) {
        struct program_load *load = &f->view.load[i];
        int h = harmonic(f, load->tone);

        memset(load->tone, 0, sizeof load->tone);
        load->tone[0] = h;
        load->tones = load->tones > 0 || load->k != 0;         /* else it is no harmonic of any */
    }
    if (opt->start == NULL || opt->start->tones.count != f->count || opt->start->start == NULL)
        return MODAL_OK;
    f->opt.start = &f->start;
    return fold_start(f, opt->start, err);
}

/*
 * Harmonic H as the combination of lowest order.  n_L of tone j are n_j of the tone L whose number
 * is the largest, and no more: so of others it has less than n_L.
 */
static struct torus_index unfolded(const struct torus_fold *f, int h)
{
    struct torus_index best = { { 0 } };
    int least = -1, lead = 0, other[2] = { -1, -1 }, others = 0;

    for (int j = 1; j < f->count; j++)
        lead = f->number[j] > f->number[lead] ? j : lead;
    for (int j = 0; j < f->count; j++)
        if (j != lead)
            other[others++] = j;
    for (int a = -NUMBER_MOST; a <= NUMBER_MOST; a++)
        for (int b = -NUMBER_MOST; b <= NUMBER_MOST; b++) {
            struct torus_index k = { { 0 } };
            int left;

            if (others < 2 && b != 0)
                continue;
            k.k[other[0]] = a;
            if (others == 2)
                k.k[other[1]] = b;
            left = h - harmonic(f, k.k);
            if (left % f->number[lead] != 0)
                continue;
            k.k[lead] = left / f->number[lead];
            if (least < 0 || torus_order(k) < least)
                best = k, least = torus_order(k);
        }
    return best;
}

static int by_order(const void *a, const void *b)
{
    const struct told *x = a, *y = b;

    return x->order != y->order ? x->order - y->order : x->h - y->h;
}

/* X of DOFS dofs with its combinations in the order of LIST; ROOM as many as those. */
static void reorder(int dofs, int count, const struct told *list, double complex *room,
                    double complex *X)
{
    for (int i = 0; i < dofs; i++, X += count) {
        memcpy(room, X, (size_t)count * sizeof *X);
        for (int m = 0; m < count; m++)
            X[m] = room[list[m].from];
    }
}

enum modal_status torus_fold_undo(const struct torus_fold *f, const double *omega,
                                  struct torus_point *out, struct modal_error *err)
{
    size_t count = (size_t)out->count;
    struct told *list = malloc((count + 1) * sizeof *list);
    double complex *room = malloc((count + 1) * sizeof *room);

    if (list == NULL || room == NULL) {
        free(list), free(room);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for combinations");
    }
    for (int m = 0; m < out->count; m++) {
        struct torus_index k = unfolded(f, out->index[m].k[0]);

        list[m] = (struct told) { k, torus_order(k), out->index[m].k[0], m };
    }
    qsort(list, count, sizeof *list, by_order);
    for (int m = 0; m < out->count; m++)
        out->index[m] = list[m].k;
    reorder(f->opt.dofs_count, out->count, list, room, out->X);
    reorder(out->q, out->count, list, room, out->start);
    out->tones = torus_tones_of(omega, f->count);
    free(list), free(room);
    return MODAL_OK;
}

void torus_fold_done(struct torus_fold *f)
{
    free(f->view.load), free(f->start.index), free(f->start.start);
    f->view.load = NULL;
    f->start = (struct torus_point) { 0 };
}
