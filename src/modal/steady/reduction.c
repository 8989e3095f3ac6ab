/*
 * reduction.c - see reduction.h; tested by tests/unit/modal/scene/test_craig_bampton.c
 *
 * What the modes left out answer at s = k omega is a sum over them of s^4 m m^T / (lambda - s^2);
 * finer has its terms of lambda up to reach^2 and 1 / lambda of the others.  These lack s^2 /
 * (lambda - s^2) of themselves, at most all where s^2 <= reach^2 / 2: so far finer knows the error
 * to a factor of two at the worst, and past it nothing is claimed.
 */
#include "modal/steady/reduction.h"
#include <math.h>
#include <stdlib.h>
#include "modal/scene/craig_bampton.h"
#include "modal/steady/condense.h"
#include "modal/steady/session.h"
#include "modal/steady/solve.h"

/* The session of finer, made when first asked for, at H harmonics. */
static enum modal_status need_finer(struct steady *s, int H, struct modal_error *err)
{
    struct steady_options opt = s->opt;

    if (s->finer != NULL && s->finer->opt.harmonics == H)
        return MODAL_OK;
    steady_free(s->finer);
    s->finer = NULL;
    opt.reduce = 0;
    opt.reduced = true;
    opt.harmonics = H;
    opt.estimate_later = true;
    return steady_new(&s->reduction->finer, &opt, &s->finer, err);
}

/* POINT as finer's kept dofs have it: those of the reduced program are its first. */
static enum modal_status start_of(struct steady *s, const struct steady_point *point,
                                  struct steady_start *start, struct modal_error *err)
{
    int q = condense_kept(s->finer->c), K = point->H + 1;
    const int *dofs = condense_dofs(s->finer->c);
    double complex *X = calloc((size_t)q * (size_t)K + 1, sizeof *X);
    enum modal_status rc = X != NULL ? MODAL_OK
                                     : modal_fail(err, MODAL_NO_MEMORY, "reduction: no memory");

    for (int i = 0; rc == MODAL_OK && i < q; i++)
        if (dofs[i] < s->p->n)
            rc = condense_recover(point->linear != NULL ? point->linear : s->c, dofs[i], point->H,
                                  point->X, point->H, X + i * K, err);
    *start = (struct steady_start){ q, point->H, X };
    return rc;
}

enum modal_status reduction_solve(struct steady *s, const struct steady_point *point,
                                  struct steady **finer, struct steady_point *out,
                                  struct modal_error *err)
{
    struct steady_start start = { 0 };
    enum modal_status rc;

    *out = (struct steady_point){ 0 };
    if (s->reduction == NULL || !point->converged)
        return MODAL_OK;
    rc = need_finer(s, point->H, err);
    if (rc == MODAL_OK)
        rc = start_of(s, point, &start, err);
    if (rc == MODAL_OK) {
        s->finer->rested = s->rested;
        rc = steady_solve(s->finer, point->omega, &start, out, err);
    }
    free((void *)start.X);
    *finer = s->finer;
    return rc;
}

/* How far A of S and B of FINER are apart, at the counted dof that moves most; the amplitude, where
 * no estimate gave it. */
static enum modal_status apart(struct steady *s, struct steady_point *a, struct steady *finer,
                               const struct steady_point *b, double *out, struct modal_error *err)
{
    /* the last s at which finer's statics are off by no more than they are */
    double known = s->reduction->reach / sqrt(2), amplitude = 0;
    size_t K = (size_t)a->H + 1;
    double complex *x = calloc(2 * K, sizeof *x), *y = x + K;
    enum modal_status rc = x != NULL ? MODAL_OK
                                     : modal_fail(err, MODAL_NO_MEMORY, "reduction: no memory");

    *out = 0;
    for (int i = 0; rc == MODAL_OK && i < s->opt.dofs_count; i++) {
        double sum = 0, size = 0;

        rc = condense_recover(a->linear != NULL ? a->linear : s->c, s->opt.dofs[i], a->H, a->X,
                              a->H, x, err);
        if (rc == MODAL_OK)
            rc = condense_recover(b->linear != NULL ? b->linear : finer->c, s->opt.dofs[i], b->H,
                                  b->X, a->H, y, err);
        /* over time at most the sum over harmonics */
        for (int k = 0; k <= a->H; k++) {
            sum += cabs(x[k] - y[k]) + (k * a->omega > known ? cabs(y[k]) : 0);
            size += cabs(x[k]);
        }
        *out = fmax(*out, sum);
        amplitude = fmax(amplitude, size);
    }
    a->amplitude = a->amplitude > 0 ? a->amplitude : amplitude;
    free(x);
    return rc;
}

enum modal_status reduction_error(struct steady *s, struct steady_point *point,
                                  struct modal_error *err)
{
    struct steady_point other;
    struct steady *finer;
    enum modal_status rc = reduction_solve(s, point, &finer, &other, err);

    point->reduction = s->reduction == NULL ? 0 : NAN;
    if (rc == MODAL_OK && other.converged)
        rc = apart(s, point, finer, &other, &point->reduction, err);
    if (rc == MODAL_OK && s->reduction != NULL)
        point->error += point->reduction;
    steady_point_done(&other);
    return rc;
}
