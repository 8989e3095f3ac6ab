/*
 * digits.c - rounding noise that goes with the size of the samples
 *
 * Where samples have few significant digits, the noise of sample k of channel c has the variance
 * q_ck^2 / 12, q_ck being the step of that sample (grid.c, (2)): loud where the response is.  A
 * fit that takes it as white weighs sample k of a pole lambda = sigma + i omega, whose amplitude is
 * sought too, by
 *
 *     w_k = e^(sigma t_k) (t_k - m),  m = sum t_k e^(2 sigma t_k) / sum e^(2 sigma t_k),        (1)
 *
 * and channel c by its amplitude over its mean noise, a_c / s_c^2, s_c^2 the mean of q_ck^2.  The
 * estimate's variance over that in white noise of the same s_c is then
 *
 *     sum_c a_c^2 / s_c^4 sum_k w_k^2 q_ck^2  /  (sum_c a_c^2 / s_c^2 sum_k w_k^2),             (2)
 *
 * for a pole that its neighbours do not disturb.  Of more than NUMBERS_MOST numbers, rows spread
 * over the record are taken.
 */
#include "modal/identify/ask/digits.h"
#include <math.h>
#include <stdlib.h>

enum { NUMBERS_MOST = 1 << 20 };     /* looked at; of more, rows spread over all */

struct rows {
    int count, every;
    double dt;                     /* s between them */
    double *q2;                    /* (k, c) at k + c * count */
    double *w2;                    /* count */
};

/* q_ck^2 of every row that is taken. */
static void take_steps(const struct digits_record *r, struct rows *rows)
{
    for (int c = 0; c < r->channels; c++) {
        double *q = rows->q2 + (size_t)c * (size_t)rows->count;

        if (!r->grid[c].floating
            || !(floating_steps(r->x + r->channel[c], r->stride * (size_t)rows->every, rows->count,
                                0, q) > 0))
            for (int k = 0; k < rows->count; k++)
                q[k] = r->grid[c].step;
        for (int k = 0; k < rows->count; k++)
            q[k] *= q[k];
    }
}

/* (1), squared; a pole that grows is seen from the record's end.  Returns the sum. */
static double weigh_rows(struct rows *rows, double sigma)
{
    double end = sigma > 0 ? (rows->count - 1) * rows->dt : 0, sum = 0, first = 0, total = 0;

    for (int k = 0; k < rows->count; k++) {
        double t = k * rows->dt, e2 = exp(2 * sigma * (t - end));
        rows->w2[k] = e2;
        sum += e2, first += e2 * t;
    }
    for (int k = 0; k < rows->count; k++) {
        double away = k * rows->dt - first / sum;
        rows->w2[k] *= away * away;
        total += rows->w2[k];
    }
    return total;
}

/* (2), its root. */
static double factor_of(const struct digits_record *r, const struct rows *rows,
                        const struct synthesis *fit, int j, double total)
{
    double over = 0, white = 0;

    for (int c = 0; c < r->channels; c++) {
        const double *q2 = rows->q2 + (size_t)c * (size_t)rows->count;
        double a = cabs(fit->coefficient[j + (size_t)c * (size_t)fit->poles]) * r->scale[c],
               mean = 0, sum = 0;
        for (int k = 0; k < rows->count; k++) {
            mean += q2[k] / rows->count;
            sum += rows->w2[k] * q2[k];
        }
        if (!(mean > 0) || !(r->scale[c] > 0))
            continue;
        over += a / mean * (a / mean) * sum;
        white += a * a / mean * total;
    }
    return over > 0 && white > 0 ? sqrt(over / white) : 1;
}

enum modal_status digits_factors(const struct digits_record *r, const double complex *lambda,
                                 const struct synthesis *fit, double *factor,
                                 struct modal_error *err)
{
    int most = NUMBERS_MOST / r->channels > 1 ? NUMBERS_MOST / r->channels : 1,
        every = (r->rows + most - 1) / most, count = r->rows / every;
    struct rows rows = { count, every, every * r->dt, NULL, NULL };
    enum modal_status rc = MODAL_OK;
    bool any = false;

    for (int c = 0; c < r->channels; c++)
        any |= r->grid[c].floating;
    for (int j = 0; j < fit->poles; j++)
        factor[j] = 1;
    if (!any)
        return MODAL_OK;
    rows.q2 = malloc(sizeof(double) * (size_t)count * (size_t)r->channels);
    rows.w2 = malloc(sizeof(double) * (size_t)count);
    if (rows.q2 == NULL || rows.w2 == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "digits: no memory for %d samples of %d channels",
                        count, r->channels);
    else
        take_steps(r, &rows);
    for (int j = 0; j < fit->poles && rc == MODAL_OK; j++)
        factor[j] = factor_of(r, &rows, fit, j, weigh_rows(&rows, creal(lambda[j])));
    free(rows.q2), free(rows.w2);
    return rc;
}
