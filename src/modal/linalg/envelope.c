/*
 * envelope.c - Cholesky's factor of a matrix of blocks, row by row [GL81]
 *
 * The factor F has the envelope of its matrix: with columns before the first block of either row
 * left out,
 *
 *     F_kj = (A_kj - sum_i F_ki F_ji^T) F_jj^-T,    F_kk F_kk^T = A_kk - sum_i F_ki F_ki^T.
 *
 * [GL81] George and Liu, Computer Solution of Large Sparse Positive Definite Systems, 1981.
 *
 * Tested by tests/unit/modal/linalg/test_envelope.c.
 */
#include "modal/linalg/envelope.h"
#include <cblas.h>
#include <lapacke.h>
#include <string.h>

void envelope_room(struct envelope *e, struct workspace *memory)
{
    int start = 0;

    for (int k = 0; k < e->count; k++) {
        e->block[k].start = start;
        start += e->block[k].rows;
    }
    for (int k = 0; k < e->count; k++) {
        struct envelope_block *p = &e->block[k];
        p->size = (size_t)p->rows * (size_t)(p->start + p->rows - e->block[p->first].start);
        p->entries = workspace_zeros(memory, p->size, sizeof *p->entries);
        p->factor = workspace_zeros(memory, p->size, sizeof *p->factor);
    }
}

void envelope_clear(struct envelope *e)
{
    for (int k = 0; k < e->count; k++)
        memset(e->block[k].entries, 0, sizeof(double) * e->block[k].size);
}

/* Where block OTHER of the rows of block K begins. */
static double *part_of(const struct envelope *e, double *rows, int k, int other)
{
    return rows + (size_t)e->block[k].rows
                      * (size_t)(e->block[other].start - e->block[e->block[k].first].start);
}

double *envelope_entry(const struct envelope *e, int block, int row, int other, int column)
{
    const struct envelope_block *p = &e->block[block];

    return part_of(e, p->entries, block, other) + row + (size_t)p->rows * (size_t)column;
}

/* Row K, scaled to a unit diagonal, plus DAMPING on it. */
static void scale_rows(struct envelope *e, int k, const double *scale, double damping)
{
    const struct envelope_block *p = &e->block[k];
    int from = e->block[p->first].start;
    double *own;

    for (int c = from; c < p->start + p->rows; c++)
        for (int r = 0; r < p->rows; r++) {
            size_t at = (size_t)r + (size_t)p->rows * (size_t)(c - from);
            p->factor[at] = p->entries[at] * scale[p->start + r] * scale[c];
        }
    own = part_of(e, p->factor, k, k);
    for (int r = 0; r < p->rows; r++)
        own[r * (p->rows + 1)] = 1 + damping;
}

bool envelope_factor(struct envelope *e, const double *scale, double damping)
{
    for (int k = 0; k < e->count; k++) {
        const struct envelope_block *p = &e->block[k];
        double *own = part_of(e, p->factor, k, k);
        scale_rows(e, k, scale, damping);
        for (int j = p->first; j < k; j++) {
            const struct envelope_block *q = &e->block[j];
            int from = p->first > q->first ? p->first : q->first;
            int n = q->start - e->block[from].start;
            double *here = part_of(e, p->factor, k, j);
            cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, p->rows, q->rows, n, -1,
                        part_of(e, p->factor, k, from), p->rows, part_of(e, q->factor, j, from),
                        q->rows, 1, here, p->rows);
            cblas_dtrsm(CblasColMajor, CblasRight, CblasLower, CblasTrans, CblasNonUnit, p->rows,
                        q->rows, 1, part_of(e, q->factor, j, j), q->rows, here, p->rows);
        }
        cblas_dsyrk(CblasColMajor, CblasLower, CblasNoTrans, p->rows,
                    p->start - e->block[p->first].start, -1, p->factor, p->rows, 1, own, p->rows);
        if (LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'L', p->rows, own, p->rows) != 0)
            return false;
        e->work += (double)p->size * (double)(p->size / (size_t)p->rows);
    }
    return true;
}

void envelope_forward(const struct envelope *e, int from, double *x)
{
    for (int k = from; k < e->count; k++) {
        const struct envelope_block *p = &e->block[k];
        int first = p->first > from ? p->first : from, start = e->block[first].start;
        cblas_dgemv(CblasColMajor, CblasNoTrans, p->rows, p->start - start, -1,
                    part_of(e, p->factor, k, first), p->rows, x + start, 1, 1, x + p->start, 1);
        cblas_dtrsv(CblasColMajor, CblasLower, CblasNoTrans, CblasNonUnit, p->rows,
                    part_of(e, p->factor, k, k), p->rows, x + p->start, 1);
    }
}

void envelope_back(const struct envelope *e, double *x)
{
    for (int k = e->count - 1; k >= 0; k--) {
        const struct envelope_block *p = &e->block[k];
        int start = e->block[p->first].start;
        cblas_dtrsv(CblasColMajor, CblasLower, CblasTrans, CblasNonUnit, p->rows,
                    part_of(e, p->factor, k, k), p->rows, x + p->start, 1);
        cblas_dgemv(CblasColMajor, CblasTrans, p->rows, p->start - start, -1, p->factor, p->rows,
                    x + p->start, 1, 1, x + start, 1);
    }
}
