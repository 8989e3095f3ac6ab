/*
 * torus_error.c - what a balance leaves out; tested by tests/unit/modal/steady/test_torus.c
 *
 * The forces of the solution are evaluated once more on twice the samples and lines, at the
 * combinations kept and at those around them.  What differs at those kept is the sampling's error
 * of the forces, and J^-1 of it that of the motion; of the others, S_k^-1 F_k is the motion left
 * out, and J^-1 of what it changes in the forces its effect on the rest.
 */
#include "modal/steady/torus_state.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/steady/condense.h"
#include "modal/steady/torus_laws.h"

enum {
    BINS = 1024,                          /* of keys: one holds a thousandth of the points, about */
};
static const double LAST = 0.125;         /* of the highest combinations that grids serve */
static const double SLOW = 0.15;          /* chosen: slow combinations are looked at to orders
                                           * some seven times as high as fast ones */

/* Kept dofs' combination M of X, of K, as harmonic AT, 0 or 1, of condense_recover's motion. */
static void torus_spread(const struct torus_solver *s, const double complex *X, size_t K, size_t m,
                         int at, double complex *one)
{
    for (size_t i = 0; i < (size_t)s->q; i++) {
        one[(size_t)(at + 1) * i] = 0;
        one[(size_t)(at + 1) * i + (size_t)at] = X[i * K + m];
    }
}

enum modal_status torus_recover(struct torus_solver *s, int count, const int *dofs,
                                double complex *X, struct modal_error *err)
{
    size_t K = (size_t)s->count, q = (size_t)s->q;
    double complex *S = malloc(2 * (q * q + 1) * sizeof *S), *p = malloc(2 * (q + 1) * sizeof *p),
                   *one = calloc(2 * q + 1, sizeof *one), two[2];
    enum modal_status rc = S == NULL || p == NULL || one == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory")
                               : MODAL_OK;

    for (size_t m = 0; rc == MODAL_OK && m < K; m++) {
        int at = torus_order(s->index[m]) > 0;
        struct condense *c = s->condense[torus_group(s, s->index[m])];

        rc = condense_at(c, torus_base(s, s->index[m]), 1, at, S, p, err);
        torus_spread(s, s->X, K, m, at, one);
        for (int i = 0; rc == MODAL_OK && i < count; i++)
            if ((rc = condense_recover(c, dofs[i], at, one, at, two, err)) == MODAL_OK)
                X[(size_t)i * K + m] = two[at];
    }
    free(S), free(p), free(one);
    return rc;
}

enum modal_status torus_largest(struct torus_solver *s, struct torus_grid *g, int count,
                                 const struct torus_index *index, const double complex *D,
                                 double *most, struct modal_error *err)
{
    size_t points = (size_t)torus_grid_lines(g) * (size_t)torus_grid_samples(g), K = (size_t)count;
    size_t q = (size_t)s->q, dofs = (size_t)s->opt->dofs_count;
    const int *place = condense_place(s->condense[0]);
    double *x = malloc((points + 1) * sizeof *x);
    double complex *Y = calloc(dofs * K + 1, sizeof *Y), *S = malloc(2 * (q * q + 1) * sizeof *S),
                   *p = malloc(2 * (q + 1) * sizeof *p), *one = calloc(2 * q + 1, sizeof *one);
    double complex two[2];
    bool others = torus_reports_others(s);
    enum modal_status rc = x == NULL || Y == NULL || S == NULL || p == NULL || one == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory")
                               : MODAL_OK;

    for (size_t m = 0; rc == MODAL_OK && m < K; m++) {
        int at = torus_order(index[m]) > 0;

        /* without loads: what the others do of the kept ones' motion alone */
        if (others)
            budget_add(s->work, torus_linear_work(s));
        if (others)
            rc = condense_at(s->condense[0], torus_base(s, index[m]), 1, at, S, p, err);
        torus_spread(s, D, K, m, at, one);
        for (size_t i = 0; rc == MODAL_OK && i < dofs; i++) {
            int dof = s->opt->dofs[i];

            if (place[dof] >= 0)
                Y[i * K + m] = D[(size_t)place[dof] * K + m];
            else if ((rc = condense_recover(s->condense[0], dof, at, one, at, two, err))
                     == MODAL_OK)
                Y[i * K + m] = two[at];
        }
    }
    *most = 0;
    budget_add(s->work, rc == MODAL_OK ? (double)(dofs * points) * BUDGET_SAMPLE / 4 : 0);
    for (size_t i = 0; rc == MODAL_OK && i < dofs; i++) {
        torus_synthesize(g, count, index, Y + i * K, x);
        for (size_t j = 0; j < points; j++)
            *most = fabs(x[j]) > *most ? fabs(x[j]) : *most;
    }
    free(x), free(Y), free(S), free(p), free(one);
    return rc;
}

static int by_size(const void *a, const void *b)
{
    double x = ((const struct torus_candidate *)a)->size,
           y = ((const struct torus_candidate *)b)->size;

    return (x < y) - (x > y);
}

static bool serves(const struct torus_solver *s, struct torus_index k)
{
    for (int j = 0; j < s->tones.count; j++)
        if (abs(k.k[j]) > torus_highest(s, j))
            return false;
    return true;
}

/* How soon a combination is looked at. */
struct rank { struct torus_index k; double key; };

static int by_key(const void *a, const void *b)
{
    double x = ((const struct rank *)a)->key, y = ((const struct rank *)b)->key;

    return (x > y) - (x < y);
}

static int bin_of(double key, double most) { return (int)(key / most * (BINS - 1)); }

/* Those of RANK among which the WANTED lowest are, as they stand, to its begin: how many.  To sort
 * all points of a fine grid takes as long as a law does at them. */
static int lowest(struct rank *rank, int ranks, int wanted)
{
    int in[BINS] = { 0 }, bin = 0, kept = 0;
    double most = 1;

    for (int r = 0; r < ranks; r++)
        most = fmax(most, rank[r].key);
    for (int r = 0; r < ranks; r++)
        in[bin_of(rank[r].key, most)]++;
    for (int sum = in[0]; sum < wanted && bin < BINS - 1; sum += in[bin])
        bin++;
    for (int r = 0; r < ranks; r++)
        if (bin_of(rank[r].key, most) <= bin)
            rank[kept++] = rank[r];
    return kept;
}

/*
 * What is looked at: the set first, then of the combinations around it that grid G holds those of
 * low order, and of high ones those that are slow.  A slider that forgets where it began gives
 * forces that fall but slowly along k . w near 0, and it is there that a structure answers.
 */
static int look_at(const struct torus_solver *s, const struct torus_grid *g,
                   struct torus_index *out)
{
    int points = torus_grid_lines(g) * torus_grid_samples(g), count = s->count, ranks = 0;
    struct torus_index *all = malloc((size_t)points * sizeof *all);
    struct rank *rank = malloc((size_t)points * sizeof *rank);
    int most = torus_looked_at(s, (double)torus_grid_lines(g) / torus_grid_lines(s->grid));
    int known = all != NULL && rank != NULL ? torus_grid_indices(g, all) : 0;

    memcpy(out, s->index, (size_t)s->count * sizeof *out);
    for (int i = 0; i < known; i++) {
        double turns = torus_frequency(&s->tones, all[i]) / s->tones.omega[s->tones.lead];

        rank[ranks++] = (struct rank) { all[i], torus_order(all[i])
                                                    * fmin(1, fmax(SLOW, turns * turns / 4)) };
    }
    ranks = lowest(rank, ranks, s->count + most);
    if (ranks > 0)
        qsort(rank, (size_t)ranks, sizeof *rank, by_key);
    for (int i = 0; i < ranks && count < s->count + most; i++)
        if (!torus_in_set(s, rank[i].k))
            out[count++] = rank[i].k;
    free(all);
    free(rank);
    return count;
}

/* The motion past what grids serve, where nothing is looked at: as that of their last part and the
 * part before falls on, by as much in each such part; at the least the last part itself. */
static double beyond(const struct torus_solver *s)
{
    double part[2] = { 0 }, fall;

    for (int m = 0; m < s->count; m++) {
        double most = 0;
        int at = 2;

        for (int j = 0; j < s->tones.count; j++) {
            double left = (1 - (double)abs(s->index[m].k[j]) / torus_highest(s, j)) / LAST;

            at = (int)fmin(at, fmax(left, 0));
        }
        for (int i = 0; at < 2 && i < s->q; i++)
            most = fmax(most, cabs(s->X[(size_t)i * (size_t)s->count + (size_t)m]));
        if (at < 2)
            part[at] += most;
    }
    fall = part[1] > 0 ? fmin(part[0] / part[1], 1 - LAST) : 0;
    return part[0] * fmax(1, fall / (1 - fall));
}

/* What a motion X says of the free tone, in rad/s, taken out of it. */
static double tone_error(const struct torus_solver *s, double complex *x)
{
    return s->tone.unit * s->tone.omega_kept * fabs(cimag(torus_tone_take(s, x)));
}

/*
 * The motion left out, by X, the set's and S^-1 of what F, the forces of the set's motion, make of
 * the others: *MOST of it and of its effect on the set, and *CHANGE, what it makes in turn of
 * itself; its effect on the free tone is added to *TONE.  D: room for two motions of the set.
 */
static enum modal_status truncation(struct torus_solver *s, struct torus_grid *fine, int all,
                                    const struct torus_index *look, double complex *X,
                                    const double complex *F, double complex *d, double *most,
                                    double *change, double *tone, struct modal_error *err)
{
    size_t K = (size_t)s->count, q = (size_t)s->q, n = q * K, A = (size_t)all;
    double complex *G = malloc((q * A + 1) * sizeof *G), *column = malloc((q + 1) * sizeof *column);
    enum modal_status rc = G == NULL || column == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory")
                               : torus_forces(s->laws, fine, all, look, X, all, look, G, err);

    for (size_t i = 0; rc == MODAL_OK && i < q; i++)
        for (size_t m = 0; m < K; m++)
            d[i * K + m] = F[i * A + m] - G[i * A + m];
    if (rc == MODAL_OK) {
        torus_precondition(s, d);
        rc = torus_newton_step(s, d, d + n, err);
    }
    *tone += tone_error(s, d + n);
    for (size_t i = 0; rc == MODAL_OK && i < q; i++)
        for (size_t m = 0; m < K; m++)
            X[i * A + m] = d[n + i * K + m];
    if (rc == MODAL_OK)
        rc = torus_largest(s, fine, all, look, X, most, err);
    for (size_t a = K; rc == MODAL_OK && a < A; a++) {
        struct torus_linear l;

        rc = torus_linear_at(s, look[a], &l, err);
        for (size_t i = 0; rc == MODAL_OK && i < q; i++)
            column[i] = F[i * A + a] - G[i * A + a];
        if (rc == MODAL_OK) {
            torus_linear_solve(s, &l, column);
            torus_linear_done(&l);
        }
        for (size_t i = 0; i < q; i++)
            X[i * A + a] = column[i];
    }
    for (size_t i = 0; i < q; i++)
        for (size_t m = 0; m < K; m++)
            X[i * A + m] = 0;
    if (rc == MODAL_OK)
        rc = torus_largest(s, fine, all, look, X, change, err);
    free(G), free(column);
    return rc;
}

/* The motions that F, forces at LOOK, make at all but the set's combinations: into X, and as
 * *COUNT candidates into LIST and ROOM.  What no grid serves is added up in *BEYOND.  COLUMN: q. */
static enum modal_status left_out(struct torus_solver *s, int all, const struct torus_index *look,
                                  const double complex *F, double complex *X,
                                  struct torus_candidate *list, int *count, double complex *room,
                                  double *beyond, double complex *column,
                                  struct modal_error *err)
{
    size_t q = (size_t)s->q;

    *count = 0;
    for (int a = s->count; a < all; a++) {
        struct torus_candidate *c = &list[*count];
        struct torus_linear l;
        enum modal_status rc = torus_linear_at(s, look[a], &l, err);

        if (rc != MODAL_OK)
            return rc;
        for (size_t i = 0; i < q; i++)
            column[i] = -F[i * (size_t)all + (size_t)a];
        torus_linear_solve(s, &l, column);
        torus_linear_done(&l);
        *c = (struct torus_candidate) { look[a], 0, room + (size_t)*count * q };
        for (size_t i = 0; i < q; i++) {
            c->X[i] = column[i];
            c->size = fmax(c->size, cabs(column[i]));
            X[i * (size_t)all + (size_t)a] = column[i];
        }
        if (serves(s, look[a]))
            ++*count;
        else
            *beyond += c->size;
    }
    return MODAL_OK;
}

enum modal_status torus_estimate(struct torus_solver *s, struct torus_candidate *list, int *count,
                                  double complex *room, struct torus_errors *e, double *amplitude,
                                  struct modal_error *err)
{
    size_t K = (size_t)s->count, q = (size_t)s->q, n = q * K;
    struct torus_grid *fine = NULL;
    struct torus_index *look = malloc((K + TORUS_CANDIDATES_MOST) * sizeof *look);
    double complex *F = malloc(q * (K + TORUS_CANDIDATES_MOST) * sizeof *F + 1),
                   *X = calloc(q * (K + TORUS_CANDIDATES_MOST) + 1, sizeof *X),
                   *d = malloc((2 * n + 1) * sizeof *d), *column = malloc((q + 1) * sizeof *column);
    double past, before = s->work->spent;
    int all = 0;
    enum modal_status rc = look == NULL || F == NULL || X == NULL || d == NULL || column == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory")
                               : torus_grid_for(s, 1, s->finer, &fine, err);

    if (rc == MODAL_OK) {
        all = look_at(s, fine, look);
        rc = torus_forces(s->laws, fine, s->count, s->index, s->X, all, look, F, err);
    }
    if (rc == MODAL_OK)
        rc = left_out(s, all, look, F, X, list, count, room, &e->beyond, column, err);
    /* sampling: J^-1 of what the finer grid says of the set's forces */
    for (size_t i = 0; rc == MODAL_OK && i < q; i++)
        for (size_t m = 0; m < K; m++) {
            d[i * K + m] = s->F[i * K + m] - F[i * (size_t)all + m];
            X[i * (size_t)all + m] = s->X[i * K + m];
        }
    s->ahead = s->work->spent - before;           /* what truncation asks for is as much again */
    if (rc == MODAL_OK) {
        torus_precondition(s, d);
        rc = torus_newton_step(s, d, d + n, err);
    }
    s->ahead = 0;
    e->tone = tone_error(s, d + n);
    if (rc == MODAL_OK)
        rc = torus_largest(s, fine, s->count, s->index, d + n, &e->sampling, err);
    if (rc == MODAL_OK)
        rc = torus_largest(s, fine, s->count, s->index, s->X, amplitude, err);
    if (rc == MODAL_OK)
        rc = truncation(s, fine, all, look, X, F, d, &e->truncation, &e->change,
                        &e->tone, err);
    past = beyond(s);
    e->truncation += past, e->beyond += past;
    e->solver = s->step * *amplitude;
    e->tone += s->tone.index < 0 ? 0 : s->step * s->tone.omega_kept;
    if (rc == MODAL_OK)
        qsort(list, (size_t)*count, sizeof *list, by_size);
    torus_grid_free(fine);
    free(look), free(F), free(X), free(d), free(column);
    return rc;
}
