/*
 * leading.c - see leading.h
 *
 * Vectors are weighed to the root of energies (dofwise_weights), u = W y, so that norms and
 * residuals do not depend on units: the map is W Phi W^-1.  A period is so many equal leaps that
 * the fastest motion turns by a radian at most in one; the error of that is seen by the residual of
 * the vectors found in the map of half the step.
 */
#include "modal/scene/leading.h"
#include <math.h>
#include <stdlib.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/dofwise.h"
#include "modal/scene/leap.h"

struct period_map {
    struct dofwise *f;
    struct leap leap;
    double period, *weight;
    int leaps;
};

/* y = W Phi W^-1 x */
static enum modal_status carry(void *context, const double *x, double *y, struct modal_error *err)
{
    struct period_map *m = context;
    int states = 2 * m->f->n;
    struct leap *l = &m->leap;
    enum modal_status rc;

    l->h = m->period / m->leaps;
    l->t = 0;
    for (int i = 0; i < states; i++)
        l->from[i] = x[i] / m->weight[i];
    rc = leap_slope(l, 0, l->from, NULL, l->slope[0], err);
    for (int k = 0; k < m->leaps && rc == MODAL_OK; k++) {
        double *end = l->to, *slope = l->slope[DORMAND_PRINCE_END];
        l->t = k * l->h;
        rc = leap_end(l, NULL, err);
        l->to = l->from;             /* the end begins the next leap */
        l->from = end;
        l->slope[DORMAND_PRINCE_END] = l->slope[0];
        l->slope[0] = slope;
    }
    for (int i = 0; i < states && rc == MODAL_OK; i++) {
        y[i] = l->from[i] * m->weight[i];
        if (!isfinite(y[i]))
            return modal_fail(err, MODAL_OVERFLOW,
                              "the growth over one period of %g s leaves the range of doubles",
                              m->period);
    }
    return rc;
}

/* Residuals of the vectors in the map of half the step; *WORST over the largest modulus. */
static enum modal_status verify(struct period_map *m, struct arnoldi *a, double *worst,
                                struct modal_error *err)
{
    size_t states = 2 * (size_t)m->f->n;
    double *x = calloc(4 * states + 1, sizeof *x), *y = x + 2 * states, largest = 0;
    enum modal_status rc = x != NULL ? MODAL_OK
                                     : modal_fail(err, MODAL_NO_MEMORY, "floquet: out of memory");

    *worst = 0;
    m->leaps *= 2;
    for (int c = 0; rc == MODAL_OK && c < a->count; c++) {
        double sum = 0;
        for (size_t i = 0; i < states; i++) {
            x[i] = creal(a->V[i + (size_t)c * states]);
            x[states + i] = cimag(a->V[i + (size_t)c * states]);
        }
        rc = carry(m, x, y, err);
        if (rc == MODAL_OK)
            rc = carry(m, x + states, y + states, err);
        for (size_t i = 0; i < states; i++) {
            double complex off = CMPLX(y[i], y[states + i]) - a->w[c] * CMPLX(x[i], x[states + i]);
            sum += creal(off) * creal(off) + cimag(off) * cimag(off);
        }
        a->residual[c] = sqrt(sum);
        *worst = fmax(*worst, a->residual[c]);
        largest = fmax(largest, cabs(a->w[c]));
    }
    m->leaps /= 2;
    *worst /= largest;
    free(x);
    return rc;
}

/* Maps of ever smaller steps until the finer one agrees. */
static enum modal_status refine(struct period_map *m, int wanted, double tolerance,
                                struct leading *out, struct modal_error *err)
{
    struct linear_operator A = { 2 * m->f->n, 2 * m->f->n, m, carry, NULL };

    for (int k = 0; k <= LEADING_HALVINGS; k++, m->leaps *= 2) {
        double worst;
        /* a tenth: the rest is for what steps are off by */
        enum modal_status rc = arnoldi(&A, wanted, tolerance / 10, &out->found, err);
        if (rc != MODAL_OK)
            return rc;
        rc = verify(m, &out->found, &worst, err);
        out->leaps = m->leaps;
        if (rc == MODAL_OK && worst <= tolerance)
            return MODAL_OK;
        arnoldi_done(&out->found);
        if (rc != MODAL_OK)
            return rc;
    }
    return modal_fail(err, MODAL_NO_CONVERGENCE,
                      "multipliers by %d steps of a period still miss the tolerance %g", out->leaps,
                      tolerance);
}

enum modal_status leading_multipliers(const struct program *p, double period, int wanted,
                                      double tolerance, struct leading *out,
                                      struct modal_error *err)
{
    struct period_map m = { .period = period };
    struct workspace space = { 0 };
    size_t states = 2 * (size_t)p->n;
    double *stage = workspace_zeros(&space, states, sizeof *stage), frequency, decay;
    enum modal_status rc = dofwise_new(p, &m.f, err);

    m.weight = workspace_zeros(&space, states, sizeof *m.weight);
    if (rc == MODAL_OK) {
        leap_init(&m.leap, m.f, stage, &space);
        rc = workspace_check(&space, "floquet: out of memory", err);
    }
    if (rc == MODAL_OK) {
        m.leap.set = &m.f->all;
        m.f->unloaded = true;        /* a map is of what is free */
        dofwise_weights(p, period, m.weight);
        dofwise_fastest(p, &frequency, &decay);
        m.leaps = (int)fmin(ceil(period * fmax(frequency, decay)) + 1, INT32_MAX / 256.0);
        rc = refine(&m, wanted, tolerance, out, err);
    }
    workspace_free(&space);
    dofwise_free(m.f);
    return rc;
}
