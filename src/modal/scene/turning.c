/*
 * turning.c - periodic on fixed axes, constant on turning ones
 *
 * J x has sign(i) x_partner(i) in row i (rows y: -x_z, rows z: x_y).  M, C, K of the program are
 * constant on turning axes exactly if each is a part that commutes with J plus one at cos, sin (2 W
 * t) that anticommutes with it:
 *
 *     A_0(Ji, Jj) = A_0(i, j),    A_c(Ji, Jj) = -A_c(i, j),    A_s = J A_c                      (1)
 *
 * (in 2 x 2 blocks a I + b J, and d [[cos, sin], [sin, -cos]] + e [[-sin, cos], [cos, sin]]).
 * Then, from their values at t = 0 and with x = R q, x' = R (q' + W J q), x'' = R (q'' + 2 W J q' -
 * W^2 q),
 *
 *     M q'' + (C + 2 W M J) q' + (K + W C J - W^2 M) q = R^T p                                  (2)
 */
#include "modal/scene/turning.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"

/* Entries of one pair of planes are sums of the same few terms: off by some hundred roundings. */
static const double ALIKE = 1e-13;         /* of the largest entry */
static const double SAME_SPEED = 1e-12;    /* of the speed: 2 W and the harmonic's frequency */

struct entries { struct triplet *x; int count, room; bool no_memory; };

/* A failure is kept in E and told once, by turn_matrices or turn_outputs. */
static void append(struct entries *e, int i, int j, double value)
{
    if (e->count == e->room) {
        int room = e->room == 0 ? 64 : 2 * e->room;
        struct triplet *more = realloc(e->x, (size_t)room * sizeof *more);
        if (more == NULL) {
            e->no_memory = true;
            return;
        }
        e->x = more;
        e->room = room;
    }
    e->x[e->count++] = (struct triplet) { i, j, value };
}

/* a(i, j); rows are short. */
static double entry(const struct sparse *a, int i, int j)
{
    for (int k = a->m > 0 ? a->start[i] : 0; a->m > 0 && k < a->start[i + 1]; k++)
        if (a->index[k] == j)
            return a->value[k];
    return 0;
}

/* What is small against the largest. */
static double tolerance_of(const struct sparse *a)
{
    return a->m > 0 ? ALIKE * numbers_largest(a->value, (size_t)a->start[a->m]) : 0;
}

/* |A(Ji, Jj) - side A(i, j)| for all entries, side 1 commutes, -1 anticommutes. */
static bool commutes(const struct program *p, const struct sparse *a, double side)
{
    double tolerance = tolerance_of(a);

    for (int i = 0; i < a->m; i++)
        for (int k = a->start[i]; k < a->start[i + 1]; k++) {
            int j = a->index[k];
            double turned = p->turn_sign[i] * p->turn_sign[j]
                            * entry(a, p->turn_partner[i], p->turn_partner[j]);
            if (!(fabs(turned - side * a->value[k]) <= tolerance))
                return false;
        }
    return true;
}

/* a (i, j) = sign(i) b (partner i, j) for all entries of a. */
static bool is_J_times(const struct program *p, const struct sparse *a, const struct sparse *b,
                       double sign)
{
    double tolerance = tolerance_of(a);

    for (int i = 0; i < a->m; i++)
        for (int k = a->start[i]; k < a->start[i + 1]; k++)
            if (!(fabs(sign * p->turn_sign[i] * entry(b, p->turn_partner[i], a->index[k])
                       - a->value[k])
                  <= tolerance))
                return false;
    return true;
}

/* Its two inputs are a dof and its partner, each against the ground. */
static bool turns_law(const struct program *p, const struct law *law)
{
    const struct law_end *end = law->end;

    return law->kind->turns && law->start[1] == 1 && law->start[2] == 2 && end[0].weight == 1
           && end[1].weight == 1 && end[1].dof == p->turn_partner[end[0].dof];
}

/* (1). */
static bool turns(const struct program *p)
{
    const struct program_harmonic *h = p->harmonic;

    if (p->turn_partner == NULL || p->n_linear > 0 || p->harmonics > 1)
        return false;
    if (p->harmonics == 1
        && !(fabs(h->k * p->omega - 2 * p->turn_speed) <= SAME_SPEED * p->turn_speed))
        return false;
    for (int i = 0; i < p->laws; i++)
        if (!turns_law(p, &p->law[i]))
            return false;
    for (int q = 0; q < 3; q++)
        if (!commutes(p, &p->constant[q], 1)
            || (p->harmonics == 1
                && (!commutes(p, &h->cosine[q], -1) || !is_J_times(p, &h->sine[q], &h->cosine[q], 1)
                    || !is_J_times(p, &h->cosine[q], &h->sine[q], -1))))
            return false;
    return true;
}

/* factor A(0) J^power into E. */
static void add_at_0(const struct program *p, int which, double factor, bool times_J,
                     struct entries *e)
{
    const struct sparse *parts[2] = { &p->constant[which],
                                      p->harmonics == 1 ? &p->harmonic->cosine[which] : NULL };

    for (int part = 0; part < 2 && parts[part] != NULL; part++)
        for (int i = 0; i < parts[part]->m; i++)
            for (int k = parts[part]->start[i]; k < parts[part]->start[i + 1]; k++) {
                int j = parts[part]->index[k];
                double value = factor * parts[part]->value[k];

                append(e, i, times_J ? p->turn_partner[j] : j,
                       times_J ? p->turn_sign[j] * value : value);
            }
}

/* (2). */
static enum modal_status turn_matrices(const struct program *p, struct program *q,
                                       struct modal_error *err)
{
    struct entries e[3] = { 0 };
    double W = p->turn_speed;  /* of (2) */
    enum modal_status rc = MODAL_OK;

    add_at_0(p, PROGRAM_M, 1, false, &e[PROGRAM_M]);
    add_at_0(p, PROGRAM_C, 1, false, &e[PROGRAM_C]);
    add_at_0(p, PROGRAM_M, 2 * W, true, &e[PROGRAM_C]);  /* 2 W M J */
    add_at_0(p, PROGRAM_K, 1, false, &e[PROGRAM_K]);
    add_at_0(p, PROGRAM_C, W, true, &e[PROGRAM_K]);  /* W C J */
    add_at_0(p, PROGRAM_M, -W * W, false, &e[PROGRAM_K]);  /* -W^2 M */
    for (int i = 0; i < 3; i++) {
        if (rc == MODAL_OK)
            rc = e[i].no_memory
                     ? modal_fail(err, MODAL_NO_MEMORY, "turning: out of memory")
                     : sparse_from_triplets(p->n, p->n, e[i].x, e[i].count, &q->constant[i], err);
        free(e[i].x);
    }
    return rc;
}

/* The rows of an output of x^(quantity) on dof j, times value, over q: cos D_j + sign(j) sin
 * D_partner, D = q, q' + W J q, ... */
static void turn_term(const struct program *p, const struct triplet *t, struct entries *e)
{
    double W = p->turn_speed;

    for (int side = 0; side < 2; side++) {
        int own = side == 0 ? t->j : p->turn_partner[t->j], other = p->turn_partner[own],
            shift = side == 0 ? 4 : 8;
        double value = side == 0 ? t->value : t->value * p->turn_sign[t->j], J = p->turn_sign[own];

        append(e, t->i + shift, own, value);
        if (t->i == 1)
            append(e, shift, other, value * W * J);
        if (t->i == 2) {
            append(e, 1 + shift, other, value * 2 * W * J);
            append(e, shift, own, -value * W * W);
        }
    }
}

/* Each term becomes those of turn_term. */
static enum modal_status turn_outputs(const struct program *p, struct program *q,
                                      struct modal_error *err)
{
    q->output = calloc((size_t)p->outputs + 1, sizeof *q->output);
    for (int i = 0; q->output != NULL && i < p->outputs; i++) {
        struct entries e = { 0 };

        for (int t = 0; t < p->output[i].count; t++)
            turn_term(p, &p->output[i].terms[t], &e);
        q->output[i] = (struct program_output) { strdup(p->output[i].name), e.x, e.count };
        q->outputs = i + 1;
        if (e.no_memory || q->output[i].name == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "turning: out of memory");
    }
    return q->output != NULL ? MODAL_OK
                             : modal_fail(err, MODAL_NO_MEMORY, "turning: out of memory");
}

/* NULL where X is NULL, or no memory: the caller tells them apart by COUNT. */
static double *copied(const double *x, int count)
{
    double *copy = x != NULL ? malloc(((size_t)count + 1) * sizeof *copy) : NULL;

    if (copy != NULL)
        memcpy(copy, x, (size_t)count * sizeof *copy);
    return copy;
}

/* A load that stands still in space turns on these axes: two dofs. */
static enum modal_status turn_loads(const struct program *p, struct program *q,
                                    struct modal_error *err)
{
    q->load = calloc((size_t)p->loads + 1, sizeof *q->load);
    for (int i = 0; q->load != NULL && i < p->loads; i++) {
        q->load[i] = p->load[i];
        q->load[i].time = copied(p->load[i].time, p->load[i].points);
        q->load[i].force = copied(p->load[i].force, p->load[i].points);
        q->load[i].dof_sine = p->turn_partner[p->load[i].dof];
        q->load[i].turn = p->turn_sign[p->load[i].dof];
        q->loads = i + 1;
        if (p->load[i].points > 0 && (q->load[i].time == NULL || q->load[i].force == NULL))
            return modal_fail(err, MODAL_NO_MEMORY, "turning: out of memory");
    }
    return q->load != NULL ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "turning: out of memory");
}

/* Names, effects' rows (counters alone) and the initial state, q' = x' - W J x at t = 0. */
static enum modal_status turn_rest(const struct program *p, struct program *q,
                                   struct modal_error *err)
{
    q->dofs = calloc((size_t)p->n + 1, sizeof *q->dofs);
    q->effect = calloc((size_t)p->effects + 1, sizeof *q->effect);
    q->law = malloc(((size_t)p->laws + 1) * sizeof *q->law);
    q->x0 = copied(p->x0, p->n);
    q->v0 = copied(p->v0, p->n);
    if (q->dofs == NULL || q->effect == NULL || q->law == NULL || q->x0 == NULL || q->v0 == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "turning: out of memory");
    for (int i = 0; i < p->n; i++) {
        if ((q->dofs[i] = strdup(p->dofs[i])) == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "turning: out of memory");
        /* q' = x' - W J x */
        q->v0[i] -= p->turn_speed * p->turn_sign[i] * p->x0[p->turn_partner[i]];
    }
    for (int i = 0; i < p->effects; i++) {
        q->effect[i] = (struct program_effect){ .type = strdup(p->effect[i].type),
                                                .states = p->effect[i].states,
                                                .active = p->effect[i].active };
        q->effects = i + 1;
        if (q->effect[i].type == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "turning: out of memory");
    }
    for (int i = 0; i < p->laws; i++)
        q->law[i] = p->law[i];
    q->laws = p->laws;
    return MODAL_OK;
}

enum modal_status program_turned(const struct program *p, struct program **out,
                                 struct modal_error *err)
{
    struct program *q;
    enum modal_status rc;

    *out = NULL;
    if (!turns(p))
        return MODAL_OK;
    if ((q = calloc(1, sizeof *q)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "turning: out of memory");
    q->n = p->n;
    q->omega = p->omega;
    q->period = p->period;
    q->frame_speed = p->turn_speed;
    rc = turn_rest(p, q, err);
    if (rc == MODAL_OK)
        rc = turn_matrices(p, q, err);
    if (rc == MODAL_OK)
        rc = turn_outputs(p, q, err);
    if (rc == MODAL_OK)
        rc = turn_loads(p, q, err);
    if (rc == MODAL_OK)
        *out = q;
    else
        program_turned_free(q);
    return rc;
}

void program_turned_free(struct program *turned)
{
    if (turned != NULL)
        turned->laws = 0;                              /* borrowed */
    program_free(turned);
}
