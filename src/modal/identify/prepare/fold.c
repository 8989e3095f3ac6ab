/* fold.c - see fold.h: what makes one Vandermonde basis serve all phases of a period */
#include "modal/identify/prepare/fold.h"
#include <stdlib.h>

enum modal_status fold(const struct matrix *Y, int p, struct matrix *out, struct modal_error *err)
{
    int L = Y->m / p;
    size_t columns = (size_t)Y->n * p;
    double *x = malloc(sizeof *x * (L * columns + 1));

    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "fold: no memory for %d periods of %zu columns", L,
                          columns);
    for (int s = 0; s < Y->n; s++)
        for (int k = 0; k < p; k++)
            for (int l = 0; l < L; l++)
                /* (14): at one phase a periodic system is a constant one, of the same
                 * multipliers */
                x[l + (k + (size_t)p * s) * L] = Y->x[k + (size_t)l * p + (size_t)s * Y->ld];
    *out = (struct matrix) { L, (int)columns, L > 0 ? L : 1, x };
    return MODAL_OK;
}
