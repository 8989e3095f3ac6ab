/* identify_limits.c - how far a search of one record may go: its order, its work, and what no model
 * at all is worth */
#include "modal/identify/identify_state.h"
#include <float.h>
#include <math.h>
#include "modal/identify/linear/exponents.h"
#include "modal/linalg/svd.h"

static const double SPARING = 0.6;      /* of the independent numbers */

/* Multiplications (refine.h). */
static const double
    WORK_MOST = 1.6e10,                 /* of all ladders of an answer, */
    WORK_LONG = 5e9,                    /* those of very long records, */
    WORK_LEAST = 5e8;                   /* and one that begins after they are spent: a second or
                                         * two */

/* A trial's channels have not been weighed by their noise: if that differs much it finds no end. */
double work_left(const struct work *w, bool trial, bool longer)
{
    return trial ? fmax(REFINE_WORK_ASKED - w->spent, DBL_MIN)
                 : fmax((longer ? WORK_LONG : WORK_MOST) - w->spent, WORK_LEAST);
}

int work_rows_allow(const struct work *w)
{
    int L = w->data.Y->m;

    /* rows over, at least; two in any case, which a real pole has */
    return L - REFINE_SPARE_LEAST > 2 ? L - REFINE_SPARE_LEAST : L > 2 ? 2 : 1;
}

int work_sparing_order(const struct work *w)
{
    double rows = w->data.Y->m * (w->data.share > 0 ? w->data.share : 1), S = w->data.Y->n;
    int order = (int)(SPARING * rows * S / (S + 1)), least = w->data.Y->m > 2 ? 2 : 1,
        told = w->shift > 1 ? criterion_order_told(S, rows * S) : 0;

    order = order > told ? order : told;
    return order > least ? order : least;
}

double work_bic_of_nothing(const struct refine_data *d)
{
    double n = (double)d->Y->m * d->phases, own = d->share > 0 ? d->share * n : n, sum = 0;

    for (int g = 0; g < d->Y->n / d->phases; g++) {
        double energy = 0;
        for (int k = 0; k < d->phases; k++) {
            double norm = refine_column_norm(d, g * d->phases + k);
            energy += norm * norm;
        }
        sum += energy > 0 ? own * log(fmax(energy / n, d->least != NULL ? d->least[g] : 0)) : 0;
    }
    return sum;
}

double work_bic_chosen(const struct order_choice *k)
{
    return k->chosen < 0 ? HUGE_VAL : k->candidates[k->chosen].fit.bic;
}

enum modal_status work_pencil_source(void *context, int r, double complex *lambda, int *count,
                                     struct modal_error *err)
{
    struct work *w = context;
    double complex rho[IDENTIFY_ORDER_MOST + TRIPLETS];
    double start = work_clock(w);
    enum modal_status rc = pencil_multipliers(&w->pencil, r, rho, err);

    if (rc == MODAL_OK)
        /* denormal numbers have lost digits */
        *count = poles_of_multipliers(rho, r, w->tau, 1e-300, lambda, &w->facts.dropped);
    w->eigenvalues += work_clock(w) - start;
    return rc;
}
