/* identify_even.c - the multipliers of a period that is no whole number of samples, by phases that
 * polynomials between samples make even: where identify_families.c begins */
#include "modal/identify/identify_state.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include "modal/identify/prepare/fold.h"
#include "modal/identify/prepare/turns.h"

/* Y at even phases, PHASES a period of EACH rows, by polynomials through so many points; the
 * caller frees even->x. */
static enum modal_status resample(const struct matrix *Y, double each, int phases, int points,
                                  struct matrix *even, struct modal_error *err)
{
    double *turn = malloc(sizeof *turn * (size_t)Y->m);
    enum modal_status rc = MODAL_OK;

    *even = matrix_new(Y->m, Y->n);
    if (turn == NULL || even->x == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d rows", Y->m);
    for (int k = 0; k < Y->m && rc == MODAL_OK; k++)
        turn[k] = k / each;
    if (rc == MODAL_OK) {
        matrix_copy(Y->m, Y->n, Y->x, Y->ld, even->x, even->ld);
        rc = turns_resample(even, turn, phases, points, err);
    }
    free(turn);
    return rc;
}

/* T: Y's periods at even phases, searched for no less than what polynomials of a lesser degree
 * differ by, which is more than what these err by. */
static enum modal_status periods_even(const struct work *w, const struct matrix *Y,
                                      struct work *t, struct matrix *even, struct modal_error *err)
{
    double each = w->rec.period / w->rec.step;
    struct matrix coarse = { 0 };
    enum modal_status rc;

    t->shift = (int)lround(each), t->tau = w->rec.period;
    t->least = calloc((size_t)Y->n, sizeof *t->least);
    if (t->least == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d signals", Y->n);
    if ((rc = resample(Y, each, t->shift, TURNS_POINTS, even, err)) != MODAL_OK
        || (rc = resample(Y, each, t->shift, TURNS_POINTS - 2, &coarse, err)) != MODAL_OK
        || (rc = fold(even, t->shift, &t->folded, err)) != MODAL_OK)
        goto out;
    for (int g = 0; g < Y->n; g++) {
        double *x = coarse.x + (size_t)g * (size_t)coarse.ld;
        cblas_daxpy(even->m, -1, even->x + (size_t)g * (size_t)even->ld, 1, x, 1);
        t->least[g] = cblas_ddot(even->m, x, 1, x, 1) / even->m;
    }
    t->X = even, t->samples = even->m / t->shift * t->shift;
    t->data = (struct refine_data) { .Y = &t->folded, .tau = t->tau, .phases = t->shift,
                                     .least = t->least };
out:
    free(coarse.x);
    return rc;
}

enum modal_status work_choose_even(const struct work *w, const struct matrix *Y,
                                   struct order_choice *found, struct modal_error *err)
{
    struct work t = { .opt = w->opt, .refine = true, .brief = true };
    struct matrix even = { 0 };
    enum modal_status rc = periods_even(w, Y, &t, &even, err);

    if (rc == MODAL_OK && t.folded.m > 2)
        rc = work_descend_periods(&t, found, err);
    free(even.x), free(t.folded.x), free(t.least);
    return rc;
}
