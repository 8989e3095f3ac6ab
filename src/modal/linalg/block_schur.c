/*
 * block_schur.c - see block_schur.h
 *
 * A step is one symmetric elimination of the rows [P D c B^T], pivots on D's diagonal: with z the
 * row at pivot d as it then is, the sum of z z^T / d over the pivots is, of P and P, what joins the
 * sum of (1), of B and B c^2 B D^-1 B^T, and of B and P c B D^-1 P.  The largest pivot left is
 * taken first; one next to 0, which is so only where D is not definite, shows in what it brings.
 */
#include "modal/linalg/block_schur.h"
#include <math.h>
#include <string.h>
#include "modal/linalg/lanes.h"

/* N, filled up to whole lanes. */
static size_t whole(size_t n) { return (n + LANES - 1) / LANES * LANES; }

bool block_schur_init(struct block_schur *f, int columns, int widest)
{
    size_t most = (size_t)widest, n = (size_t)columns;

    *f = (struct block_schur) { .columns = columns, .widest = widest, .of_D = whole(n) };
    f->stride = f->of_D + 2 * whole(most);
    f->row = workspace_zeros(&f->space, 2 * f->stride * most, sizeof *f->row);
    f->next = workspace_zeros(&f->space, 2 * f->stride * most, sizeof *f->next);
    f->sum = workspace_zeros(&f->space, 2 * f->stride * n, sizeof *f->sum);
    f->done = workspace_zeros(&f->space, most, sizeof *f->done);
    return !f->space.failed;
}

void block_schur_done(struct block_schur *f) { workspace_free(&f->space); }

/* Entry J of a row. */
static double complex entry(const struct block_schur *f, const double *row, size_t j)
{
    return CMPLX(row[j], row[f->stride + j]);
}

static double square(const struct block_schur *f, const double *row, size_t j)
{
    return row[j] * row[j] + row[f->stride + j] * row[f->stride + j];
}

static void set_entry(const struct block_schur *f, double *row, size_t j, double complex value)
{
    row[j] = creal(value);
    row[f->stride + j] = cimag(value);
}

void block_schur_begin(struct block_schur *f)
{
    f->wide = 0;
    memset(f->row, 0, 2 * f->stride * (size_t)f->widest * sizeof *f->row);
    memset(f->sum, 0, 2 * f->stride * (size_t)f->columns * sizeof *f->sum);
}

void block_schur_set(struct block_schur *f, size_t i, size_t j, double complex value)
{
    set_entry(f, f->row + 2 * i * f->stride, j, value);
}

/* Of step S: a + c A onto what the step before left in D's place, and c B^T beside it. */
static void complete_rows(struct block_schur *f, const struct block_step *s, double complex a,
                          double complex c)
{
    size_t w = (size_t)s->wide, next = (size_t)s->next, of_B = f->of_D + whole(w);

    for (size_t i = 0; i < w; i++) {
        double *row = f->row + 2 * i * f->stride;

        for (size_t j = 0; j < w; j++)
            set_entry(f, row, f->of_D + j, entry(f, row, f->of_D + j) + c * s->A[j * w + i]
                                               + (i == j ? a : 0));
        for (size_t part = 0; part < 2; part++) {       /* what fills lanes is 0 */
            memset(row + part * f->stride + f->of_D + w, 0, (whole(w) - w) * sizeof *row);
            memset(row + part * f->stride + of_B, 0, whole(next) * sizeof *row);
        }
        for (size_t j = 0; j < next; j++)
            set_entry(f, row, of_B + j, c * s->B[i * w + j]);
    }
}

/* Y -= F X, LEN numbers of rows. */
LANES_BODY void subtract(const struct block_schur *f, size_t len, double complex F, const double *X,
                     double *Y)
{
    double re = creal(F), im = cimag(F);

    for (size_t i = 0; i < len; i += LANES) {
        lanes x = *(const lanes *)(X + i), y = *(const lanes *)(X + f->stride + i);

        *(lanes *)(Y + i) -= re * x - im * y;
        *(lanes *)(Y + f->stride + i) -= re * y + im * x;
    }
}

/* The row of W that is not done with the largest diagonal entry, its square in *MOST. */
static size_t choose_pivot(const struct block_schur *f, size_t w, double *most)
{
    size_t pivot = 0;

    *most = 0;
    for (size_t i = 0; i < w; i++) {
        double size = square(f, f->row + 2 * i * f->stride, f->of_D + i);

        if (f->done[i] == 0 && size > *most) {
            *most = size;
            pivot = i;
        }
    }
    return pivot;
}

/* What a row at its pivot 1 / BY, of W in its block, brings to the sum and to the next rows. */
LANES_BODY void bring(struct block_schur *f, const double *row, double complex by, size_t w,
                      size_t next)
{
    size_t of_B = f->of_D + whole(w);

    for (size_t i = 0; i < (size_t)f->columns; i++)
        subtract(f, f->of_D, -entry(f, row, i) * by, row, f->sum + 2 * i * f->stride);
    for (size_t i = 0; i < next; i++) {
        double complex part = entry(f, row, of_B + i) * by;
        double *to = f->next + 2 * i * f->stride;

        subtract(f, f->of_D, part, row, to);                                    /* P_j+1 */
        subtract(f, whole(next), part, row + of_B, to + f->of_D);               /* D_j+1 */
    }
}

/* The pivots of a step of W rows, NEXT in the block after it: as block_schur_step. */
LANES_BODY double eliminate(struct block_schur *f, size_t w, size_t next, size_t watched)
{
    double largest = 0, size;

    for (size_t step = 0; step < w; step++) {
        size_t p = choose_pivot(f, w, &size);
        const double *row = f->row + 2 * p * f->stride;
        double complex by;

        if (!(size > 0 && isfinite(size)))
            return -1;
        by = 1 / entry(f, row, f->of_D + p);
        f->done[p] = 1;
        for (size_t i = 0; i < w; i++)
            if (f->done[i] == 0)
                subtract(f, f->of_D + whole(w) + whole(next), entry(f, row, f->of_D + i) * by, row,
                         f->row + 2 * i * f->stride);
        bring(f, row, by, w, next);
        for (size_t i = 0; i < watched; i++)
            largest = fmax(largest, square(f, row, i) / sqrt(size));
    }
    return largest;
}

LANES_NARROW double eliminate_narrow(struct block_schur *f, size_t w, size_t next, size_t watched)
{
    return eliminate(f, w, next, watched);
}

LANES_WIDE double eliminate_wide(struct block_schur *f, size_t w, size_t next, size_t watched)
{
    return eliminate(f, w, next, watched);
}

double block_schur_step(struct block_schur *f, const struct block_step *s, double complex a,
                        double complex c, int watched)
{
    size_t w = (size_t)s->wide, next = (size_t)s->next;
    double largest, *swap = f->row;

    complete_rows(f, s, a, c);
    memset(f->next, 0, 2 * f->stride * next * sizeof *f->next);
    memset(f->done, 0, w * sizeof *f->done);
    largest = (lanes_wide() ? eliminate_wide : eliminate_narrow)(f, w, next, (size_t)watched);
    if (largest < 0)
        return -1;
    f->row = f->next;
    f->next = swap;
    f->wide = s->next;
    return largest;
}

double complex block_schur_sum(const struct block_schur *f, size_t i, size_t j)
{
    return entry(f, f->sum + 2 * i * f->stride, j);
}

double block_schur_left(const struct block_schur *f, size_t j)
{
    double sum = 0;

    for (size_t i = 0; i < (size_t)f->wide; i++)
        sum += square(f, f->row + 2 * i * f->stride, j);
    return sqrt(sum);
}
