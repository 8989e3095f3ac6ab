/* torus_set.c - the combinations that a motion is balanced on, each with its linear part, and the
 * grid that they need; tested by tests/unit/modal/steady/test_torus.c */
#include "modal/steady/torus_state.h"
#include <lapacke.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/scene.h"
#include "modal/scene/sparse_motion.h"
#include "modal/steady/condense.h"
#include "modal/steady/torus_laws.h"

enum {
    CANDIDATES_LEAST = 24,     /* two shells around the first set: below them an estimate of the
                                * rest is none */
};
static const double LOOKING = 2e8;        /* budget.h: what linear parts of a look may cost, and
                                           * its share of events */
static const double CONDENSING = 100;     /* budget.h's units, a dof and a column: measured */
static const double STEP = 4e3;           /* budget.h: a step of few states and one law, measured;
                                           * each more takes half of that again */
static const double MAPS = 6;             /* products a step: an exponential's 30 for a map, of the
                                           * fifth of all steps that an event cuts */

static const double LEAP = 5e3;           /* a leap of few states, measured */
static const double LEAP_ENTRY = 120;     /* and of an entry or a law in all its stages: of 10 to 80
                                           * dofs, measured */

enum modal_status torus_read_loads(struct torus_solver *s, struct modal_error *err)
{
    for (int i = 0; i < s->p->loads; i++) {
        const struct program_load *load = &s->p->load[i];
        char field[48];
        bool flipped, known = false;
        struct torus_index k = { { load->tone[0], load->tone[1], load->tone[2] } };

        snprintf(field, sizeof field, "excitation[%d]", i);
        if (load->type != LOAD_HARMONIC || load->dof_sine >= 0)
            return modal_fail_field(err, MODAL_BAD_INPUT, field,
                                    "%s: several tones accept only harmonics (k, cos, sin) on the "
                                    "structure's own axes",
                                    field);
        if (s->tone.index >= 0 && k.k[s->tone.index] != 0)
            return modal_fail_field(err, MODAL_BAD_INPUT, field,
                                    "%s: tone %d is free, the motion's own; no load has it", field,
                                    s->tone.index + 1);
        if (load->tones > s->tones.count)
            return modal_fail_field(err, MODAL_BAD_INPUT, field,
                                    "%s.k has %d numbers, tones %d; as many at most", field,
                                    load->tones, s->tones.count);
        k = torus_signed(&s->tones, k, &flipped);
        for (int g = 1; g <= s->groups; g++)
            known |= torus_equal(s->group[g], k);
        if (!known && s->groups == TORUS_LOADS_MOST)
            return modal_fail_field(err, MODAL_TOO_LARGE, field,
                                    "%s: loads at more than %d combinations of tones", field,
                                    TORUS_LOADS_MOST);
        if (!known)
            s->group[++s->groups] = k;
    }
    return MODAL_OK;
}

enum modal_status torus_new_group(struct torus_solver *s, int g, struct modal_error *err)
{
    struct program_load *load = calloc((size_t)s->p->loads + 1, sizeof *load);
    int count = 0;
    enum modal_status rc;

    if (load == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
    for (int i = 0; g > 0 && i < s->p->loads; i++) {
        struct torus_index k = { { s->p->load[i].tone[0], s->p->load[i].tone[1],
                                   s->p->load[i].tone[2] } };
        bool flipped;

        k = torus_signed(&s->tones, k, &flipped);
        if (!torus_equal(k, s->group[g]))
            continue;
        load[count] = s->p->load[i];
        load[count].k = torus_order(k) > 0;
        load[count].tones = 0;
        load[count].sine *= flipped ? -1 : 1;      /* b sin(-phase) */
        count++;
    }
    s->view.load = load;
    s->view.loads = count;
    rc = condense_new(&s->view, CONDENSE_LINEAR, &s->condense[g], err);
    if (rc == MODAL_OK)
        condense_want(s->condense[g], s->opt->dofs, s->opt->dofs_count);
    s->view.load = NULL;
    s->view.loads = 0;
    free(load);
    return rc;
}

int torus_group(const struct torus_solver *s, struct torus_index k)
{
    for (int g = 1; g <= s->groups; g++)
        if (torus_equal(s->group[g], k))
            return g;
    return 0;
}

double torus_base(const struct torus_solver *s, struct torus_index k)
{
    return torus_order(k) > 0 ? fabs(torus_frequency(&s->tones, k))
                              : s->tones.omega[s->tones.lead];
}

void torus_linear_done(struct torus_linear *l)
{
    free(l->S), free(l->LU), free(l->p), free(l->pivot);
    *l = (struct torus_linear) { 0 };
}

double torus_linear_work(const struct torus_solver *s)
{
    double q = s->q;

    return CONDENSING * s->p->n * (q + 1) + q * q * q;
}

/* S where Omega_k < 0, as a tone that moves may leave it, and the gain's share of it. */
static void bend(const struct torus_solver *s, struct torus_index k, double complex *S)
{
    const struct torus_tone *t = &s->tone;
    size_t q = (size_t)s->q;

    if (t->index < 0)
        return;
    if (torus_frequency(&s->tones, k) < 0)              /* of a real system: S(-w) = conj S(w) */
        for (size_t i = 0; i < q * q; i++)
            S[i] = conj(S[i]);
    for (size_t i = 0; t->held && i < q; i++)
        S[i * q + i] += I * t->gain * k.k[t->index] * t->damping[i];
}

enum modal_status torus_linear_at(struct torus_solver *s, struct torus_index k,
                                  struct torus_linear *l, struct modal_error *err)
{
    size_t q = (size_t)s->q, size = q * q;
    int at = torus_order(k) > 0;
    double complex *S = malloc(2 * (size + 1) * sizeof *S), *p = malloc(2 * (q + 1) * sizeof *p);
    enum modal_status rc = MODAL_OK;

    *l = (struct torus_linear) { .S = malloc((size + 1) * sizeof *l->S),
                           .LU = malloc((size + 1) * sizeof *l->LU),
                           .p = malloc((q + 1) * sizeof *l->p),
                           .pivot = malloc((q + 1) * sizeof *l->pivot),
                           .group = torus_group(s, k) };
    if (S == NULL || p == NULL || l->S == NULL || l->LU == NULL || l->p == NULL || l->pivot == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %zu x %zu", q, q);
    budget_add(s->work, torus_linear_work(s));
    if (rc == MODAL_OK)
        rc = condense_at(s->condense[l->group], torus_base(s, k), 1, at, S, p, err);
    if (rc == MODAL_OK) {
        memcpy(l->S, S + (at ? size : 0), size * sizeof *S);
        memcpy(l->p, p + (at ? q : 0), q * sizeof *p);
        bend(s, k, l->S);
        memcpy(l->LU, l->S, size * sizeof *S);
        /* A singular S_k, an undamped resonance, is held by laws alone: its factors are not used.
         * */
        if (q > 0 && LAPACKE_zgetrf_work(LAPACK_COL_MAJOR, s->q, s->q, l->LU, s->q, l->pivot) != 0)
            l->pivot[0] = 0;
    }
    if (rc != MODAL_OK)
        torus_linear_done(l);
    free(S);
    free(p);
    return rc;
}

void torus_linear_solve(const struct torus_solver *s, const struct torus_linear *l,
                        double complex *x)
{
    if (s->q > 0 && l->pivot[0] > 0)
        LAPACKE_zgetrs_work(LAPACK_COL_MAJOR, 'N', s->q, 1, l->LU, s->q, l->pivot, x, s->q);
}

double torus_step_work(const struct torus_solver *s, const struct scene_time *time, bool *leaps)
{
    double states = 2.0 * s->p->n + s->p->n_linear, maps = torus_smooth(s->laws) ? 0 : MAPS;
    double entries = s->p->n + s->p->laws;

    for (int i = 0; i < 3; i++)
        entries += s->p->constant[i].m > 0 ? s->p->constant[i].start[s->p->n] : 0;
    *leaps = sparse_motion_strides(s->p, time);
    return *leaps || sparse_motion_wins(s->p, time)
               ? LEAP + LEAP_ENTRY * entries
               : STEP * (1 + s->p->laws) / 2 + 2 * states * states
                     + maps * pow(states, 3) / BUDGET_DENSE;
}

bool torus_in_set(const struct torus_solver *s, struct torus_index k)
{
    for (int m = 0; m < s->count; m++)
        if (torus_equal(s->index[m], k))
            return true;
    return false;
}

enum modal_status torus_grow(struct torus_solver *s, const struct torus_index *more, int added,
                              struct modal_error *err)
{
    int count = s->count + added;
    size_t size = (size_t)s->q * (size_t)count + 1;
    struct torus_index *index = realloc(s->index, (size_t)count * sizeof *index);
    struct torus_linear *linear;
    double complex *X = calloc(size, sizeof *X), *F = calloc(size, sizeof *F),
                   *R = calloc(size, sizeof *R);
    enum modal_status rc = MODAL_OK;

    s->index = index != NULL ? index : s->index;
    linear = realloc(s->linear, (size_t)count * sizeof *linear);
    s->linear = linear != NULL ? linear : s->linear;
    if (index == NULL || linear == NULL || X == NULL || F == NULL || R == NULL) {
        free(X), free(F), free(R);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %d combinations", count);
    }
    for (int i = 0; i < s->q; i++)
        for (int m = 0; m < s->count; m++)
            X[(size_t)i * (size_t)count + (size_t)m] =
                s->X[(size_t)i * (size_t)s->count + (size_t)m];
    free(s->X), free(s->F), free(s->R);
    s->X = X, s->F = F, s->R = R;
    for (int a = 0; rc == MODAL_OK && a < added; a++) {
        s->index[s->count + a] = more[a];
        rc = torus_linear_at(s, more[a], &s->linear[s->count + a], err);
        if (rc != MODAL_OK)
            while (a-- > 0)
                torus_linear_done(&s->linear[s->count + a]);
    }
    if (rc == MODAL_OK)
        s->count = count;
    return rc;
}

/* How many combinations have at most ORDER, k and -k told once. */
static double count_of(const struct torus_solver *s, double order)
{
    double both = s->tones.count > 2   ? (2 * order + 1) * (2 * order * order + 2 * order + 3) / 3
                  : s->tones.count > 1 ? 2 * order * order + 2 * order + 1
                                       : 2 * order + 1;

    return (both + 1) / 2;
}

double torus_unknowns(const struct torus_solver *s, int order)
{
    return s->q * (2 * (count_of(s, order) + s->groups) - 1);
}

enum modal_status torus_grow_to_order(struct torus_solver *s, int order, struct modal_error *err)
{
    double unknowns = torus_unknowns(s, order);
    int side = 2 * order + 1, count = 0;
    int second = s->tones.count > 1 ? side : 1, third = s->tones.count > 2 ? side : 1;
    size_t box = (size_t)side * (size_t)second * (size_t)third, room = box + (size_t)s->groups;
    struct torus_index *more;
    enum modal_status rc;

    if (unknowns > TORUS_UNKNOWNS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "steady.harmonics",
                                "%d dofs of laws at %.0f combinations of tones are %.0f unknowns; "
                                "at most %d",
                                s->q, count_of(s, order), unknowns, TORUS_UNKNOWNS_MOST);
    more = malloc(room * sizeof *more);
    if (more == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %zu combinations", room);
    for (int total = 0; total <= order; total++)         /* by rising order: the core comes first */
        for (size_t i = 0; i < box; i++) {
            struct torus_index k = { { (int)(i % (size_t)side) - order,
                                       second > 1 ? (int)(i / (size_t)side % (size_t)side) - order
                                                  : 0,
                                       third > 1 ? (int)(i / (size_t)side / (size_t)side) - order
                                                 : 0 } };

            if (torus_order(k) == total && torus_told(&s->tones, k)
                && !torus_in_set(s, k))
                more[count++] = k;
        }
    for (int g = 1; g <= s->groups; g++)
        if (torus_order(s->group[g]) > order)
            more[count++] = s->group[g];
    rc = torus_grow(s, more, count, err);
    free(more);
    return rc;
}

static int power_of_two(double least)
{
    int n = 16;

    while (n < least && n < TORUS_POINTS_MOST)
        n *= 2;
    return n;
}

/* A polynomial's harmonics reach degree H, and alias past N - H; other laws' have no end. */
static int samples_of(const struct torus_solver *s, int k)
{
    int degree = 2;

    for (int l = 0; l < s->p->laws; l++)
        degree = s->p->law[l].degree > degree ? s->p->law[l].degree : degree;
    return (degree + 1) * k + 1;
}

int torus_highest(const struct torus_solver *s, int j)
{
    /* samples of the lead, lines */
    static const int most[][2] = { { 16384, 1 }, { 1024, 512 }, { 64, 64 } };

    return (most[s->tones.count - 1][j != s->tones.lead] - 1) / (samples_of(s, 1) - 1);
}

/* N and LINES of a grid for the set; how many samples that is. */
static double size_grid(const struct torus_solver *s, int finer, int lines_finer, int *N,
                        int lines[TORUS_TONES_MOST])
{
    int most[TORUS_TONES_MOST] = { 0 }, turns = s->tones.count > 2 ? 8 : 16;
    bool smooth = torus_smooth(s->laws);
    double highest = 0, points, factor = 1 << finer;
    int share = s->rough > 0 ? 2 : 1;        /* of samples along each phase */

    for (int m = 0; m < s->count; m++) {
        highest = fmax(highest, torus_frequency(&s->tones, s->index[m])
                                    / s->tones.omega[s->tones.lead]);
        for (int j = 0; j < s->tones.count; j++)
            most[j] = abs(s->index[m].k[j]) > most[j] ? abs(s->index[m].k[j]) : most[j];
    }
    /* A kink's instant is found between samples by a cubic: eight a turn of what moves most. */
    *N = power_of_two(factor * fmax(samples_of(s, most[s->tones.lead]),
                                    smooth ? 4 * highest
                                           : fmax(64, 8 * fmin(highest, turns)) / share));
    points = *N;
    for (int j = 0; j < TORUS_TONES_MOST; j++) {
        lines[j] = 1;
        if (j < s->tones.count && j != s->tones.lead) {
            lines[j] = power_of_two(factor * (1 << lines_finer)
                                    * fmax(samples_of(s, most[j]), smooth ? 8 : 32 / share));
            points *= lines[j];
        }
    }
    return points;
}

double torus_grid_size(const struct torus_solver *s, int finer, int lines_finer)
{
    int N, lines[TORUS_TONES_MOST];

    return size_grid(s, finer, lines_finer, &N, lines);
}

enum modal_status torus_grid_for(const struct torus_solver *s, int finer, int lines_finer,
                                 struct torus_grid **out, struct modal_error *err)
{
    int N, lines[TORUS_TONES_MOST];
    double points = size_grid(s, finer, lines_finer, &N, lines);

    if (points > TORUS_POINTS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "steady.harmonics",
                                "%d combinations of tones need %.0f samples to tell their error; "
                                "at most %d", s->count, points, TORUS_POINTS_MOST);
    return torus_grid_new(&s->tones, N, lines, out, err);
}

int torus_looked_at(const struct torus_solver *s, double lines)
{
    double one = fmax(torus_linear_work(s), lines * torus_events_work(s->laws));

    return (int)fmin(TORUS_CANDIDATES_MOST, fmax(CANDIDATES_LEAST, LOOKING / one));
}

bool torus_reports_others(const struct torus_solver *s)
{
    const int *place = condense_place(s->condense[0]);
    bool others = false;

    for (int i = 0; i < s->opt->dofs_count; i++)
        others |= place[s->opt->dofs[i]] < 0;
    return others;
}

double torus_estimate_work(const struct torus_solver *s)
{
    double points = (double)torus_grid_lines(s->grid) * torus_grid_samples(s->grid);
    double finer = torus_grid_size(s, 1, s->finer) / points, lines = finer / 2;
    double look = torus_looked_at(s, lines), all = s->count + look;
    double passes = finer * s->asking + look * lines * torus_events_work(s->laws);
    double sizes = 4 * finer * points * s->opt->dofs_count * BUDGET_SAMPLE / 4;
    double parts = 2 * look + (torus_reports_others(s) ? 2 * (s->count + all) : 0);

    return 2 * passes + sizes + parts * torus_linear_work(s);
}
