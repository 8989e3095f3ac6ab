/* sparse.c - see sparse.h */
#include "modal/linalg/sparse.h"
#include <math.h>
#include <stdlib.h>

struct ordered { struct triplet t; int rank; };

static int compare(const void *a, const void *b)
{
    const struct ordered *x = a, *y = b;

    if (x->t.i != y->t.i)
        return x->t.i < y->t.i ? -1 : 1;
    if (x->t.j != y->t.j)
        return x->t.j < y->t.j ? -1 : 1;
    /* equal places in the order given: the sum is reproducible */
    return x->rank < y->rank ? -1 : 1;
}

enum modal_status sparse_from_triplets(int m, int n, const struct triplet *entries, int count,
                                       struct sparse *out, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    struct ordered *sorted = malloc(((size_t)count + 1) * sizeof *sorted);
    struct sparse a = { .m = m, .n = n };

    a.start = calloc((size_t)m + 1, sizeof *a.start);
    a.index = malloc(((size_t)count + 1) * sizeof *a.index);
    a.value = malloc(((size_t)count + 1) * sizeof *a.value);
    if (sorted == NULL || a.start == NULL || a.index == NULL || a.value == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "sparse: out of memory for %d entries", count);
        goto out;
    }
    for (int k = 0; k < count; k++)
        sorted[k] = (struct ordered) { entries[k], k };
    qsort(sorted, (size_t)count, sizeof *sorted, compare);
    int filled = 0;
    for (int k = 0; k < count;) {
        struct triplet t = sorted[k++].t;
        while (k < count && sorted[k].t.i == t.i && sorted[k].t.j == t.j)
            t.value += sorted[k++].t.value;
        if (t.value == 0)
            continue;                     /* what cancels is no part of the structure */
        a.index[filled] = t.j;
        a.value[filled++] = t.value;
        a.start[t.i + 1] = filled;        /* the end of row i so far */
    }
    for (int i = 1; i <= m; i++)          /* rows without entries end where the row before does */
        if (a.start[i] < a.start[i - 1])
            a.start[i] = a.start[i - 1];
    *out = a;
    a = (struct sparse) { 0 };
out:
    free(sorted);
    sparse_done(&a);
    return rc;
}

void sparse_done(struct sparse *a)
{
    free(a->start);
    free(a->index);
    free(a->value);
    *a = (struct sparse) { 0 };
}

void sparse_multiply_add(const struct sparse *a, double alpha, const double *x, double *y)
{
    for (int i = 0; i < a->m; i++) {
        double sum = 0;
        for (int k = a->start[i]; k < a->start[i + 1]; k++)
            sum += a->value[k] * x[a->index[k]];
        y[i] += alpha * sum;
    }
}

void sparse_add_to_dense(const struct sparse *a, double alpha, struct matrix *out)
{
    for (int i = 0; i < a->m; i++)
        for (int k = a->start[i]; k < a->start[i + 1]; k++)
            out->x[i + (size_t)a->index[k] * (size_t)out->ld] += alpha * a->value[k];
}

/* The value at (i, j), whose columns ascend; 0 where there is none. */
static double value_at(const struct sparse *a, int i, int j)
{
    int low = a->start[i], high = a->start[i + 1];

    while (low < high) {
        int middle = (low + high) / 2;

        if (a->index[middle] < j)
            low = middle + 1;
        else
            high = middle;
    }
    return low < a->start[i + 1] && a->index[low] == j ? a->value[low] : 0;
}

void sparse_mark(const struct sparse *a, int *place)
{
    for (int i = 0; a->start != NULL && i < a->m; i++)
        for (int e = a->start[i]; e < a->start[i + 1]; e++)
            place[i] = place[a->index[e]] = 1;
}

bool sparse_symmetric(const struct sparse *a, double tolerance)
{
    for (int i = 0; a->start != NULL && i < a->m; i++)
        for (int e = a->start[i]; e < a->start[i + 1]; e++)
            if (fabs(value_at(a, a->index[e], i) - a->value[e]) > tolerance * fabs(a->value[e]))
                return false;
    return true;
}
