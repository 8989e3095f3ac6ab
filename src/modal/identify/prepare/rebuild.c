/* rebuild.c - see rebuild.h: the periods of a record are fitted, and put back into samples */
#include "modal/identify/prepare/rebuild.h"
#include <stdlib.h>
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/prepare/fold.h"

int rebuild_order(const struct rebuild_model *p)
{
    return p->shift * poles_order(p->lambda, p->count, p->tau);
}

/* Periods, each channel's phases one after another, back into samples. */
static void unfold(const struct matrix *periods, int shift, struct matrix *F)
{
    for (int c = 0; c < periods->n; c++)
        for (int l = 0; l < periods->m; l++)
            F->x[c % shift + l * shift + (size_t)(c / shift) * (size_t)F->ld] =
                periods->x[l + (size_t)c * (size_t)periods->ld];
}

enum modal_status rebuild_record(const struct rebuild_model *p, const struct matrix *Y,
                                 struct matrix *F, struct synthesis *fit, struct modal_error *err)
{
    struct matrix periods = { 0 }, rebuilt = { 0 };
    enum modal_status rc;

    if (p->shift == 1)
        return synthesis_fit(p->lambda, p->count, p->tau, Y, F, fit, err);
    rc = fold(Y, p->shift, &periods, err);
    if (rc == MODAL_OK && F != NULL) {
        rebuilt = matrix_new(periods.m, periods.n);
        if (rebuilt.x == NULL)
            rc = modal_fail(err, MODAL_NO_MEMORY, "rebuild: no memory for %d rows", Y->m);
    }
    if (rc == MODAL_OK)
        rc = synthesis_fit(p->lambda, p->count, p->tau, &periods, F != NULL ? &rebuilt : NULL, fit,
                           err);
    if (rc == MODAL_OK && F != NULL) {
        matrix_copy(Y->m, Y->n, Y->x, Y->ld, F->x, F->ld);
        unfold(&rebuilt, p->shift, F);
    }
    free(periods.x), free(rebuilt.x);
    return rc;
}
