/*
 * sparse_lu.c - UMFPACK [D04] behind one face for real and complex values
 *
 * The analysis orders columns and rows for little fill, once a structure; a factorization pivots
 * within it by size, so that a diagonal which vanishes (a part of a structure that resonates by
 * itself) costs no digits.  Rows are scaled by their sums.  Who iterates needs no refinement.
 *
 * [D04] Davis, Algorithm 832: UMFPACK V4.3, ACM Trans. Math. Softw. 30 (2004) 196-199.
 */
#include "modal/linalg/sparse_lu.h"
#include "modal/linalg/workspace.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <suitesparse/umfpack.h>

struct sparse_lu {
    int n, *start, *index;
    bool of_complex;
    void *symbolic, *numeric;
    const double *value;          /* of the last factorization */
    double control[UMFPACK_CONTROL], work, flops, fill, rcond;
    int *room;                    /* n, of solutions */
    double *scratch;              /* n, or 4 n of complex ones */
    struct workspace space;       /* of the arrays */
};

enum modal_status sparse_lu_new(int n, const int *start, const int *index, bool of_complex,
                                struct sparse_lu **out, struct modal_error *err)
{
    struct sparse_lu *f = calloc(1, sizeof *f);
    size_t order = (size_t)n, entries = (size_t)start[n];

    if (f == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "sparse factors: no memory");
    f->n = n;
    f->of_complex = of_complex;
    f->start = workspace_zeros(&f->space, order + 1, sizeof *f->start);
    f->index = workspace_zeros(&f->space, entries + 1, sizeof *f->index);
    f->room = workspace_zeros(&f->space, order + 1, sizeof *f->room);
    /* what umfpack_*_wsolve asks for */
    f->scratch = workspace_zeros(&f->space, 4 * order, sizeof *f->scratch);
    if (f->space.failed) {
        sparse_lu_free(f);
        return modal_fail(err, MODAL_NO_MEMORY, "sparse factors: no memory for %zu entries",
                          entries);
    }
    memcpy(f->start, start, (order + 1) * sizeof *start);
    memcpy(f->index, index, entries * sizeof *index);
    umfpack_di_defaults(f->control);
    f->control[UMFPACK_IRSTEP] = 0;               /* no refinement: who iterates corrects itself */
    *out = f;
    return MODAL_OK;
}

static void drop_numeric(struct sparse_lu *f)
{
    if (f->numeric != NULL && f->of_complex)
        umfpack_zi_free_numeric(&f->numeric);
    else if (f->numeric != NULL)
        umfpack_di_free_numeric(&f->numeric);
    f->numeric = NULL;
}

void sparse_lu_free(struct sparse_lu *f)
{
    if (f == NULL)
        return;
    drop_numeric(f);
    if (f->symbolic != NULL && f->of_complex)
        umfpack_zi_free_symbolic(&f->symbolic);
    else if (f->symbolic != NULL)
        umfpack_di_free_symbolic(&f->symbolic);
    workspace_free(&f->space);
    free(f);
}

/* The ordering looks at the sizes of the first matrix's entries, and serves the others as well. */
static bool analyse(struct sparse_lu *f, const double *value)
{
    if (f->symbolic != NULL)
        return true;
    if (f->of_complex)
        umfpack_zi_symbolic(f->n, f->n, f->start, f->index, value, NULL, &f->symbolic, f->control,
                            NULL);
    else
        umfpack_di_symbolic(f->n, f->n, f->start, f->index, value, &f->symbolic, f->control, NULL);
    return f->symbolic != NULL;
}

static bool finite_values(const double *value, size_t count)
{
    double sum = 0;

    for (size_t i = 0; i < count; i++)
        sum += fabs(value[i]);          /* one NaN or infinity stays in a sum */
    return isfinite(sum);
}

bool sparse_lu_factor(struct sparse_lu *f, const void *value)
{
    double info[UMFPACK_INFO];
    size_t numbers = (size_t)f->start[f->n] * (f->of_complex ? 2 : 1);
    int status;

    drop_numeric(f);
    f->value = value;
    if (!finite_values(value, numbers) || !analyse(f, value))
        return false;
    status = f->of_complex
           ? umfpack_zi_numeric(f->start, f->index, value, NULL, f->symbolic, &f->numeric,
                                f->control, info)
           : umfpack_di_numeric(f->start, f->index, value, f->symbolic, &f->numeric, f->control,
                                info);
    f->flops = info[UMFPACK_FLOPS];
    f->fill = info[UMFPACK_LNZ] + info[UMFPACK_UNZ];
    f->work = f->flops + SPARSE_LU_ENTRY * (f->start[f->n] + f->fill);
    f->rcond = info[UMFPACK_RCOND];
    /* pivots that differ by 1 / DBL_EPSILON^2 are those of a singular matrix, however its rows are
     * scaled */
    if (status == UMFPACK_OK && info[UMFPACK_RCOND] > 4 * DBL_EPSILON * DBL_EPSILON)
        return true;
    drop_numeric(f);
    return false;
}

/* The diagonal's entry of column J. */
static double diagonal_of(const struct sparse_lu *f, int j)
{
    for (int k = f->start[j]; k < f->start[j + 1]; k++)
        if (f->index[k] == j)
            return f->value[k];
    return 0;
}

bool sparse_lu_diagonal(struct sparse_lu *f, const double *value, double least,
                        struct sparse_lu_pivot *out)
{
    struct workspace space = { 0 };
    int *row = workspace_zeros(&space, (size_t)f->n, sizeof *row),
        *column = workspace_zeros(&space, (size_t)f->n, sizeof *column), inverted;
    double *pivot = workspace_zeros(&space, (size_t)f->n, sizeof *pivot);
    bool serves;

    f->control[UMFPACK_STRATEGY] = UMFPACK_STRATEGY_SYMMETRIC;
    f->control[UMFPACK_SYM_PIVOT_TOLERANCE] = 0;
    f->control[UMFPACK_SCALE] = UMFPACK_SCALE_NONE;
    serves = !space.failed && sparse_lu_factor(f, value)
             && umfpack_di_get_numeric(NULL, NULL, NULL, NULL, NULL, NULL, row, column, pivot,
                                       &inverted, NULL, f->numeric) == UMFPACK_OK;
    *out = (struct sparse_lu_pivot){ -1, 0 };
    for (int i = 0; serves && i < f->n && out->row < 0; i++) {
        serves = row[i] == column[i];
        if (!(pivot[i] > least * fabs(diagonal_of(f, row[i]))))
            *out = (struct sparse_lu_pivot){ row[i], pivot[i] };
    }
    workspace_free(&space);
    return serves;
}

/* SYSTEM: UMFPACK_A, or UMFPACK_At, which is of complex matrices their adjoint. */
static void solve(struct sparse_lu *f, int system, const void *b, void *x)
{
    if (f->of_complex)
        umfpack_zi_wsolve(system, f->start, f->index, f->value, NULL, x, NULL, b, NULL,
                          f->numeric, f->control, NULL, f->room, f->scratch);
    else
        umfpack_di_wsolve(system, f->start, f->index, f->value, x, b, f->numeric, f->control,
                          NULL, f->room, f->scratch);
}

void sparse_lu_solve(struct sparse_lu *f, const void *b, void *x) { solve(f, UMFPACK_A, b, x); }

void sparse_lu_solve_adjoint(struct sparse_lu *f, const void *b, void *x)
{
    solve(f, UMFPACK_At, b, x);
}

int sparse_lu_sign(struct sparse_lu *f)
{
    double mantissa, exponent;

    umfpack_di_get_determinant(&mantissa, &exponent, f->numeric, NULL);
    return mantissa < 0 ? -1 : 1;
}

double sparse_lu_rcond(const struct sparse_lu *f) { return f->rcond; }
double sparse_lu_work(const struct sparse_lu *f) { return f->work; }
double sparse_lu_flops(const struct sparse_lu *f) { return f->flops; }
double sparse_lu_fill(const struct sparse_lu *f) { return f->fill; }
