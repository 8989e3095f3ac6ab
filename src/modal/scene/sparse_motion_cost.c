/* sparse_motion_cost.c - which way a program's motion is the cheaper; see sparse_motion.h */
#include <math.h>
#include "modal/scene/dofwise.h"
#include "modal/scene/dormand_prince.h"
#include "modal/scene/sparse_motion.h"
#include "modal/scene/statespace.h"

enum {
    UNKNOWNS_DENSE = 100,      /* of the dense way's step: their cube is a millisecond; */
    UNKNOWNS_FEW = 20,         /* fewer, and it is microseconds, as all else of either way */
    DOFS_DENSE = 400,          /* dense exponentials of 800 states: some seconds */
    DENSE_STAGES = 4,          /* see collocation.h */
    DENSE_ITERATIONS = 4,      /* of its Newton's method, a step */
    DENSE_MAP = 30,            /* cubes of its states for one of its maps: 20 were seen */
    DENSE_FASTER = 4,          /* products of matrices, in the time of one on scattered numbers */
};
/* what a dense step, twice as accurate by nature, may cost more: finer leaps, and parts beside */
static const double SMALL_MARGIN = 4;

/* Unknowns of the dense way's step. */
static double unknowns_dense(const struct program *p)
{
    int inputs = 0;

    for (int l = 0; l < p->laws; l++)
        inputs += p->law[l].kind->inputs;
    return DENSE_STAGES * inputs;
}

bool sparse_motion_small(const struct program *p)
{
    return unknowns_dense(p) <= UNKNOWNS_DENSE && p->n <= DOFS_DENSE;
}

/* Operations of a second's motion, by radians of the fastest and what is stored of the program. */
static double work_of_second(const struct program *p)
{
    double frequency, decay, n = p->n, entries = 0;

    dofwise_fastest(p, &frequency, &decay);
    for (int i = 0; i < 3; i++)
        entries += p->constant[i].m > 0 ? p->constant[i].start[p->n] : 0;
    return DORMAND_PRINCE_ALL * fmax(frequency, decay)
           * (2 * entries + 2 * DORMAND_PRINCE_ALL * (n + p->laws));
}

/* These over those of a dense step, by its unknowns and what its map makes of them. */
static double dense_steps(const struct program *p)
{
    double u = unknowns_dense(p);

    return work_of_second(p) / (DENSE_ITERATIONS * u * u * (2 * u / 3 + 2 * (double)p->n));
}

bool sparse_motion_wins(const struct program *p, const struct scene_time *time)
{
    if (!dofwise_serves(p))
        return false;
    if (p->n > STATESPACE_DOFS_MOST)
        return true;
    return p->laws > 0 && !sparse_motion_small(p) && dense_steps(p) * time->dt < 1;
}

int64_t sparse_motion_worth(const struct program *p, const struct scene_time *time)
{
    double steps;

    if (unknowns_dense(p) < UNKNOWNS_FEW || !sparse_motion_small(p) || !dofwise_serves(p))
        return 0;
    steps = SMALL_MARGIN * dense_steps(p) * (time->start + time->duration);
    return steps < INT64_MAX / 2 ? (int64_t)steps + 1 : 0;
}

double sparse_motion_maps(const struct program *p, const struct scene_time *time)
{
    double N = 2.0 * p->n, steps = (double)time->samples * 2 * N * N,
           work = work_of_second(p) * (time->start + time->duration);

    /* a motion that is linear has one map, or few, and these are exact */
    if (N < UNKNOWNS_DENSE || (p->laws == 0 && p->n <= DOFS_DENSE) || !dofwise_serves(p))
        return HUGE_VAL;
    return fmax(SMALL_MARGIN * DENSE_FASTER * work - steps, 0) / (DENSE_MAP * N * N * N);
}

bool sparse_motion_strides(const struct program *p, const struct scene_time *time)
{
    double frequency, decay;

    if (!dofwise_serves(p) || dofwise_slides(p))
        return false;
    dofwise_fastest(p, &frequency, &decay);
    return fmax(frequency, decay) * time->dt < 1;        /* a leap is some three radians */
}
