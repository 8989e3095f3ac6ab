/* hankel.c - the Hankel pair, formed or applied; see hankel.h for the indices */
#include "modal/identify/linear/hankel.h"
#include <cblas.h>
#include <string.h>

enum modal_status hankel_check(const struct hankel *h, struct modal_error *err)
{
    long most_rows = (long)h->Y->m - h->start - h->shift;
    long most_columns = ((long)h->Y->m - h->start - h->rows) / h->shift;

    if (h->rows < 1 || h->rows > most_rows)
        return modal_fail_field(err, MODAL_BAD_INPUT, "rows",
                                "%d rows per signal do not fit %d samples with one column shift of "
                                "%d; accepted: 1 to %ld",
                                h->rows, h->Y->m, h->shift, most_rows > 0 ? most_rows : 0);
    if (h->columns < 1 || h->columns > most_columns)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "columns",
            "%d columns %d samples apart do not fit %d samples with %d rows; accepted: 1 to %ld",
            h->columns, h->shift, h->Y->m, h->rows, most_columns > 0 ? most_columns : 0);
    return MODAL_OK;
}

/* limits/identification.md: rows between a third and a half of the samples are best before
 * refinement and indifferent after it. */
void hankel_default_sizes(int samples, int shift, int *rows, int *columns)
{
    /* < 1: too many columns, which the check will say */
    long left = samples - (long)*columns * shift;

    if (*rows <= 0 && *columns > 0 && left > 0)
        *rows = (int)left;
    else if (*rows <= 0)
        /* of a periodic system one period: columns then lie whole periods apart */
        *rows = shift > 1 ? shift : (samples + 2) / 3;
    if (*columns <= 0)
        *columns = (samples - *rows) / shift;
}

static const double *block(const struct hankel *h, int s)
{
    return h->Y->x + (size_t)s * h->Y->ld + h->start;
}

void hankel_form(const struct hankel *h, struct matrix *out)
{
    for (int s = 0; s < h->Y->n; s++)
        for (int l = 0; l < h->columns; l++)
            memcpy(out->x + (size_t)s * h->rows + (size_t)l * out->ld,
                   block(h, s) + (size_t)l * h->shift, sizeof(double) * h->rows);
}

/* Columns of a block lie `shift` apart: a matrix of that leading dimension where it is allowed,
 * shift >= rows. */
void hankel_apply(const struct hankel *h, const double *x, double *y)
{
    for (int s = 0; s < h->Y->n; s++) {
        double *at = y + (size_t)s * h->rows;
        const double *b = block(h, s);
        if (h->shift >= h->rows) {
            cblas_dgemv(CblasColMajor, CblasNoTrans, h->rows, h->columns, 1, b, h->shift, x, 1, 0,
                        at, 1);
            continue;
        }
        memset(at, 0, sizeof *at * h->rows);
        for (int l = 0; l < h->columns; l++)
            cblas_daxpy(h->rows, x[l], b + (size_t)l * h->shift, 1, at, 1);
    }
}

void hankel_apply_transpose(const struct hankel *h, const double *y, double *x)
{
    memset(x, 0, sizeof *x * h->columns);
    for (int s = 0; s < h->Y->n; s++) {
        const double *at = y + (size_t)s * h->rows, *b = block(h, s);
        if (h->shift >= h->rows) {
            cblas_dgemv(CblasColMajor, CblasTrans, h->rows, h->columns, 1, b, h->shift, at, 1, 1, x,
                        1);
            continue;
        }
        for (int l = 0; l < h->columns; l++)
            /* columns overlap: no leading dimension is that short */
            x[l] += cblas_ddot(h->rows, b + (size_t)l * h->shift, 1, at, 1);
    }
}
