/* leap_record.c - see leap_record.h
 *
 * Outputs are linear in x, v and a, so that a part's samples are those of the whole and its dofs'
 * differences.  Accelerations are asked of the equation of motion, not of the interpolant, which
 * knows them to one order less.
 */
#include "modal/scene/leap_record.h"
#include <math.h>
#include <string.h>
#include "modal/scene/dofwise.h"

static const double BESIDE = 1e-12;            /* of dt: a time so near is the same */

/* Terms of all outputs, by dof. */
static void list_terms(struct leap_record *r)
{
    const struct program *p = r->of->p;

    for (int o = 0; o < p->outputs; o++)
        for (int k = 0; k < p->output[o].count; k++)
            r->start[p->output[o].terms[k].j]++;
    for (int i = 0; i < p->n; i++)
        r->start[i + 1] += r->start[i];
    for (int o = p->outputs - 1; o >= 0; o--)
        for (int k = p->output[o].count - 1; k >= 0; k--) {
            const struct triplet *t = &p->output[o].terms[k];
            r->term[--r->start[t->j]] = (struct triplet){ o, t->i, t->value };
            r->accelerations |= t->i == 2;
        }
}

enum modal_status leap_record_init(struct leap_record *r, const struct dofwise *of,
                                   const struct scene_time *time, double *signals,
                                   struct workspace *space, struct modal_error *err)
{
    size_t terms = 0, states = 2 * (size_t)of->n;

    *r = (struct leap_record){ .of = of, .time = time, .signals = signals };
    for (int o = 0; o < of->p->outputs; o++)
        terms += (size_t)of->p->output[o].count;
    r->start = workspace_zeros(space, (size_t)of->n + 1, sizeof *r->start);
    r->term = workspace_zeros(space, terms, sizeof *r->term);
    r->y = workspace_zeros(space, states, sizeof *r->y);
    r->slope = workspace_zeros(space, states, sizeof *r->slope);
    r->other = workspace_zeros(space, states, sizeof *r->other);
    if (!space->failed)
        list_terms(r);
    return workspace_check(space, "stepping: out of memory", err);
}

double leap_record_time(const struct leap_record *r, long k)
{
    return r->time->start + (double)k * r->time->dt;
}

/* Accelerations of L's set at time T into SLOPE. */
static enum modal_status accelerations_at(struct leap_record *r, const struct leap *l, double t,
                                          const double *memory, double *slope,
                                          struct modal_error *err)
{
    int n = r->of->n;

    if (!r->accelerations)
        return MODAL_OK;
    for (int k = 0; k < l->set->runs; k++)
        for (int i = l->set->run[k].from; i < l->set->run[k].to; i++) {
            r->y[i] = leap_value(l, i, t);
            r->y[n + i] = leap_value(l, n + i, t);
        }
    return leap_slope(l, t, r->y, memory, slope, err);
}

/* What dof I's term reads at T. */
static double value_of(const struct leap_record *r, const struct leap *l, int i, int quantity,
                       double t, const double *slope)
{
    int n = r->of->n;

    return quantity == 2 ? slope[n + i] : leap_value(l, quantity * n + i, t);
}

enum modal_status leap_record_whole(struct leap_record *r, const struct leap *l,
                                    const double *memory, bool last, struct modal_error *err)
{
    size_t channels = (size_t)r->of->p->outputs;
    double end = l->t + l->h - BESIDE * r->time->dt;
    enum modal_status rc = MODAL_OK;

    for (r->end = r->first; r->end < r->time->samples && rc == MODAL_OK; r->end++) {
        double t = leap_record_time(r, r->end), *row = r->signals + (size_t)r->end * channels;
        if (t >= end && !last)       /* the next leap's: an impulse may lie between */
            break;
        t = fmin(fmax(t, l->t), l->t + l->h);
        memset(row, 0, channels * sizeof *row);
        rc = accelerations_at(r, l, t, memory, r->slope, err);
        for (int i = 0; i < r->of->n; i++)
            for (int k = r->start[i]; k < r->start[i + 1]; k++)
                row[r->term[k].i] +=
                    r->term[k].value * value_of(r, l, i, r->term[k].j, t, r->slope);
    }
    return rc;
}

enum modal_status leap_record_part(struct leap_record *r, const struct leap *whole,
                                   const double *memory, const struct leap *part,
                                   const double *part_memory, bool last, long *k,
                                   struct modal_error *err)
{
    size_t channels = (size_t)r->of->p->outputs;
    struct leap seen = *whole;       /* the whole's motion of the part's dofs */
    enum modal_status rc = MODAL_OK;

    seen.set = part->set;
    for (; *k < r->end && rc == MODAL_OK; ++*k) {
        double t = leap_record_time(r, *k), *row = r->signals + (size_t)*k * channels;
        if (t >= part->t + part->h && !last)
            break;
        t = fmin(fmax(t, part->t), part->t + part->h);
        rc = accelerations_at(r, &seen, t, memory, r->other, err);
        if (rc == MODAL_OK)
            rc = accelerations_at(r, part, t, part_memory, r->slope, err);
        for (int run = 0; run < part->set->runs; run++)
            for (int i = part->set->run[run].from; i < part->set->run[run].to; i++)
                for (int e = r->start[i]; e < r->start[i + 1]; e++)
                    row[r->term[e].i] +=
                        r->term[e].value * (value_of(r, part, i, r->term[e].j, t, r->slope)
                                            - value_of(r, &seen, i, r->term[e].j, t, r->other));
    }
    return rc;
}
