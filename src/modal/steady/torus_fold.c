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

/* A combination of one side, and where its motion is on the other. */
struct told { struct torus_index k; int order, from, place; double at; bool flipped; };

/* w of the tones of SET, bits, and F's numbers of them; 0: they have none. */
static double common(const double *omega, unsigned set, struct torus_fold *f)
{
    int first = 0;

    while (!(set >> first & 1))
        first++;
    for (int n = 1; n <= NUMBER_MOST; n++) {
        double w = omega[first] / n;
        bool found = true;

        for (int j = 0; found && j < f->count; j++) {
            double number = round(omega[j] / w);

            f->number[j] = 1;
            if (!(set >> j & 1))
                continue;
            found = number >= 1 && number <= NUMBER_MOST
                && fabs(omega[j] - number * w) <= SAME * omega[j];
            f->number[j] = found ? (int)number : 1;
        }
        if (found)
            return w;
    }
    return 0;
}

bool torus_fold_finds(const double *omega, int count, struct torus_fold *f)
{
    static const unsigned sets[] = { 7, 3, 5, 6 };         /* all first */
    unsigned set = 0;
    double w = 0;

    *f = (struct torus_fold) { .count = count };
    for (size_t e = 0; w == 0 && e < sizeof sets / sizeof *sets; e++) {
        set = sets[e] & ((1u << count) - 1);
        if ((set & (set - 1)) != 0)                        /* two at least */
            w = common(omega, set, f);
    }
    if (w == 0)
        return false;
    f->omega[f->tones++] = w;
    for (int j = 0; j < count; j++)
        if (!(set >> j & 1))
            f->into[j] = f->tones, f->omega[f->tones++] = omega[j];
    return true;
}

/* (1), and the third's number. */
static struct torus_index folded(const struct torus_fold *f, const int *k)
{
    struct torus_index h = { { 0 } };

    for (int j = 0; j < f->count; j++)
        h.k[f->into[j]] += f->number[j] * k[j];
    return h;
}

static int by_order(const void *a, const void *b)
{
    const struct told *x = a, *y = b;

    if (x->order != y->order)
        return x->order - y->order;
    return x->at != y->at ? (x->at > y->at) - (x->at < y->at) : x->from - y->from;
}

/* The start's motion at F's combinations, those that are one summed; what it balanced with is of no
 * use then. */
static enum modal_status fold_start(struct torus_fold *f, const struct torus_point *was,
                                    struct modal_error *err)
{
    size_t count = (size_t)was->count;
    struct told *list = malloc((count + 1) * sizeof *list);
    struct torus_point *to = &f->start;

    *to = (struct torus_point) { .converged = was->converged, .marched = was->marched, .q = was->q,
                                 .amplitude = was->amplitude,
                                 .tones = torus_tones_of(f->omega, f->tones),
                                 .index = calloc(count + 1, sizeof *to->index),
                                 .start = calloc((size_t)was->q * count + 1,
                                                 sizeof *to->start) };
    if (to->index == NULL || to->start == NULL || list == NULL) {
        free(list);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a start");
    }
    for (int m = 0; m < was->count; m++) {
        list[m].k = torus_signed(&to->tones, folded(f, was->index[m].k), &list[m].flipped);
        list[m].order = torus_order(list[m].k), list[m].from = m;
        list[m].at = torus_frequency(&to->tones, list[m].k);
    }
    qsort(list, count, sizeof *list, by_order);
    for (size_t m = 0; m < count; m++) {
        if (m == 0 || !torus_equal(list[m].k, list[m - 1].k))
            to->index[to->count++] = list[m].k;
        list[m].place = to->count - 1;
    }
    for (int i = 0; i < was->q; i++)
        for (size_t m = 0; m < count; m++) {
            double complex X = was->start[(size_t)i * count + (size_t)list[m].from];

            to->start[i * to->count + list[m].place] += list[m].flipped ? conj(X) : X;
        }
    free(list);
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
        bool some = load->tones > 0 || load->k != 0;           /* else it is no harmonic of any */

        memcpy(load->tone, folded(f, load->tone).k, sizeof load->tone);
        load->tones = some ? f->tones : 0;
    }
    if (opt->start == NULL || opt->start->tones.count != f->count || opt->start->start == NULL
        || opt->start->part.of > 0)
        return MODAL_OK;
    f->opt.start = &f->start;
    return fold_start(f, opt->start, err);
}

/*
 * H as the combination of lowest order.  n_L of tone j are n_j of the tone L whose number is the
 * largest, and no more: so of others it has less than n_L.
 */
static struct torus_index unfolded(const struct torus_fold *f, struct torus_index h)
{
    struct torus_index best = { { 0 } };
    int least = -1, lead = -1, other[2] = { -1, -1 }, others = 0, most;

    for (int j = 0; j < f->count; j++)
        if (f->into[j] == 0 && (lead < 0 || f->number[j] > f->number[lead]))
            lead = j;
    for (int j = 0; j < f->count; j++)
        if (f->into[j] == 0 && j != lead)
            other[others++] = j;
    most = f->number[lead];
    for (int a = -most; a <= most; a++)
        for (int b = -most; b <= most; b++) {
            struct torus_index k = { { 0 } };
            int left;

            if (others < 2 && b != 0)
                continue;
            k.k[other[0]] = a;
            if (others == 2)
                k.k[other[1]] = b;
            left = h.k[0] - folded(f, k.k).k[0];
            if (left % f->number[lead] != 0)
                continue;
            k.k[lead] = left / f->number[lead];
            if (least < 0 || torus_order(k) < least)
                best = k, least = torus_order(k);
        }
    for (int j = 0; j < f->count; j++)
        if (f->into[j] > 0)
            best.k[j] = h.k[f->into[j]];
    return best;
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

/* The common divisor of two numbers above 0. */
static int divisor_of(int a, int b) { return b == 0 ? a : divisor_of(b, a % b); }

/* F's numbers where it was PART that was solved for, and which part of whose tones that is.  Of w
 * it is one of a tone whose number has no divisor in common with PART's: of numbers that have none
 * together, and a part of a prime's power, there is one. */
static struct torus_part unfold_part(struct torus_fold *f, struct torus_part part)
{
    struct torus_part own = { -1, part.of };

    for (int j = 0; part.of > 0 && j < f->count; j++)
        if (own.tone < 0 && f->into[j] == part.tone && divisor_of(f->number[j], part.of) == 1)
            own.tone = j;
    for (int j = 0; part.of > 0 && j < f->count; j++)
        if (f->into[j] == part.tone && j != own.tone)
            f->number[j] *= part.of;
    return part.of > 0 ? own : part;
}

enum modal_status torus_fold_undo(struct torus_fold *f, const double *omega,
                                  struct torus_point *out, struct modal_error *err)
{
    size_t count = (size_t)out->count;
    struct told *list = malloc((count + 1) * sizeof *list);
    double complex *room = malloc((count + 1) * sizeof *room);

    if (list == NULL || room == NULL) {
        free(list), free(room);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for combinations");
    }
    out->part = unfold_part(f, out->part);
    for (int m = 0; m < out->count; m++) {
        struct torus_index k = unfolded(f, out->index[m]);

        list[m] = (struct told) { .k = k, .order = torus_order(k), .from = m,
                                  .at = torus_frequency(&out->tones, out->index[m]) };
    }
    qsort(list, count, sizeof *list, by_order);
    for (int m = 0; m < out->count; m++)
        out->index[m] = list[m].k;
    reorder(f->opt.dofs_count, out->count, list, room, out->X);
    reorder(out->q, out->count, list, room, out->start);
    out->tones = torus_tones_of(omega, f->count);
    if (out->part.of > 0)
        torus_tones_move(&out->tones, out->part.tone, omega[out->part.tone] / out->part.of);
    free(list), free(room);
    return MODAL_OK;
}

void torus_fold_done(struct torus_fold *f)
{
    free(f->view.load), free(f->start.index), free(f->start.start);
    f->view.load = NULL;
    f->start = (struct torus_point) { 0 };
}
