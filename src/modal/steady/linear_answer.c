/*
 * linear_answer.c - see linear_answer.h
 *
 * With constant matrices a linear system a harmonic, with periodic ones a single system,
 * J X = -R(0), (1) of balance.h.
 */
#include "modal/steady/linear_answer.h"
#include "modal/scene/program.h"
#include "modal/steady/balance.h"
#include "modal/steady/condense.h"
#include "modal/steady/estimate.h"
#include "modal/steady/session.h"

/* Harmonics past the loads: what periodic matrices reach falls geometrically. */
enum { H_PERIODIC = 24 };

/* Constant matrices: what is left of the equation of motion is all there is to tell, the dofs taken
 * out included. */
static enum modal_status linear_residual(struct steady *s, struct steady_point *point,
                                         struct modal_error *err)
{
    struct condense_residual left;
    enum modal_status rc = condense_residual(s->c, point->X, &left, err);

    /* Nothing is truncated or sampled: rounding is the only error. */
    point->residual = left.relative;
    point->tail_rms = left.rms;
    point->tail_max = left.most;
    point->load_max = left.load;
    return rc;
}

enum modal_status linear_answer(struct steady *s, double omega, struct steady_point *point,
                                struct modal_error *err)
{
    int load = condense_highest_load(s->c), H = s->opt.harmonics > 0  ? s->opt.harmonics
                                                : s->p->harmonics > 0 ? load + H_PERIODIC
                                                : load > 0            ? load
                                                                      : 1;
    int q = condense_kept(s->c), sign;
    struct balance *b;
    enum modal_status rc = steady_balance(s, H, &b, err);

    if (rc == MODAL_OK)
        rc = point_init(s, point, q, H, 0, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, omega, 1, err);
    if (rc != MODAL_OK)
        return rc;
    point->method = "linear";
    point->residual = point->step = point->truncation = point->sampling = point->solver =
        point->error = 0;
    point->converged = true;
    if (q == 0)
        return linear_residual(s, point, err);
    rc = balance_residual(b, point->X, true, err);
    if (rc != MODAL_OK)
        return rc;
    if (!balance_factor(b, &sign)) {                    /* whole: nothing corrects what is left */
        point->converged = false;
        point->reason = "the linear equations are singular: an undamped resonance, "
                        "or a body that nothing holds";
        return MODAL_OK;
    }
    for (int i = 0; i < b->order; i++)
        b->R[i] = -b->R[i];                             /* J X = -R(0) */
    balance_solve(b, b->R);
    balance_unpack(b, b->R, point->X);                 /* from X = 0 the first step is the answer */
    rc = balance_residual(b, point->X, false, err);
    point->residual = balance_relative_residual(b, point->X);
    if (rc == MODAL_OK && s->p->harmonics > 0) {
        rc = estimate_errors(s, b, point, err);
        if (rc == MODAL_OK)
            rc = balance_set(b, omega, 1, err);
    } else if (rc == MODAL_OK)
        rc = linear_residual(s, point, err);
    return rc;
}
