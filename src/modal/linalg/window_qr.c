/*
 * window_qr.c - two stacks of triangles
 *
 * Adding rows to a triangle is orthogonal and safe; taking rows away (downdating) is hyperbolic,
 * and loses in a few thousand windows what the smallest singular value has of digits.  So nothing
 * is ever taken away.  A queue is made of two stacks:
 *
 *     back    blocks b_i, in their order, and the triangle of all of them
 *     front   triangles f_i of blocks i, i+1, ... up to the newest that the front knows; the oldest
 *             on top
 *
 * push adds to the back's triangle; pop drops the front's top; where the front is empty the back's
 * blocks are turned over into it,
 *
 *     f_i = triangle of [b_i; f_{i+1}],                                                         (1)
 *
 * one QR of two triangles each.  Every block passes three QRs, whatever the window's length, and
 * the factor is that of [f_top; back]: its depth is at most the number of blocks in the window, so
 * that its error does not grow with the length of the stream.
 */
#include "modal/linalg/window_qr.h"
#include <lapacke.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/qr.h"

/* columns a step of dtpqrt: a panel of 16 and its triangle of 16 x 16 stay in the first cache */
enum { PANEL = 16 };

struct stack { double *x; int count, room; };        /* triangles, n x n each */

struct window_qr {
    int n;
    struct stack blocks, front;                      /* the back's blocks; f_i */
    double *back;                                    /* triangle of the back's blocks */
};

static size_t size_of(const struct window_qr *q)
{
    return (size_t)q->n * (size_t)q->n;
}

enum modal_status window_qr_new(int n, struct window_qr **out, struct modal_error *err)
{
    struct window_qr *q;

    if (n < 1)
        return modal_fail(err, MODAL_BAD_INPUT, "window_qr: %d columns; accepted: 1 or more", n);
    q = calloc(1, sizeof *q);
    if (q != NULL) {
        q->n = n;
        q->back = calloc(size_of(q), sizeof *q->back);
    }
    if (q == NULL || q->back == NULL) {
        window_qr_free(q);
        return modal_fail(err, MODAL_NO_MEMORY, "window_qr: no memory for %d columns", n);
    }
    *out = q;
    return MODAL_OK;
}

void window_qr_free(struct window_qr *q)
{
    if (q == NULL)
        return;
    free(q->blocks.x);
    free(q->front.x);
    free(q->back);
    free(q);
}

void window_qr_clear(struct window_qr *q)
{
    q->blocks.count = q->front.count = 0;
    memset(q->back, 0, sizeof *q->back * size_of(q));
}

/* Room for one more; its place, or NULL. */
static double *grow(const struct window_qr *q, struct stack *s)
{
    if (s->count == s->room) {
        int room = 2 * s->room + 8;
        double *x = realloc(s->x, sizeof *x * size_of(q) * (size_t)room);
        if (x == NULL)
            return NULL;
        s->x = x, s->room = room;
    }
    return s->x + size_of(q) * (size_t)s->count;
}

/* R = triangle of the rows of A, kept, fewer than n or not. */
static enum modal_status triangle_of(int n, const struct matrix *A, double *R,
                                     struct modal_error *err)
{
    int ld = A->m > n ? A->m : n;
    struct matrix all = { ld, n, ld, calloc((size_t)ld * (size_t)n, sizeof(double)) },
                  T = { n, n, n, R };
    enum modal_status rc;

    if (all.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "window_qr: no memory for %d x %d", ld, n);
    matrix_copy(A->m, n, A->x, A->ld, all.x, ld);
    rc = qr_triangle(&all, &T, err);
    free(all.x);
    return rc;
}

/* R = triangle of the triangle A (R may be its storage) and the rows of B, both kept.  Zeros above
 * and within B, where it is a triangle too (TALL false), are not worked on: [Householder QR of a
 * pentagonal pair, LAPACK's dtpqrt], n^3 / 3 reflections' work instead of 5 n^3 / 3. */
static enum modal_status join(int n, const double *A, const struct matrix *B, bool tall, double *R,
                              struct modal_error *err)
{
    int m = B->m, nb = n < PANEL ? n : PANEL;
    size_t size = (size_t)m * (size_t)n, room = (size_t)nb * (size_t)n;
    double *x = malloc(sizeof *x * (size + 2 * room));

    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "window_qr: no memory for %d x %d", m, n);
    matrix_copy(m, n, B->x, B->ld, x, m);
    if (R != A)
        memcpy(R, A, sizeof *R * (size_t)n * (size_t)n);
    LAPACKE_dtpqrt_work(LAPACK_COL_MAJOR, m, n, tall ? 0 : n, nb, R, n, x, m, x + size, nb,
                        x + size + room);
    free(x);
    return MODAL_OK;
}

static struct matrix triangle(const struct window_qr *q, double *x)
{
    return (struct matrix) { q->n, q->n, q->n, x };
}

enum modal_status window_qr_push(struct window_qr *q, struct matrix *rows, struct modal_error *err)
{
    double *block = grow(q, &q->blocks);
    struct matrix own;
    enum modal_status rc;

    if (block == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "window_qr: no memory for a block");
    rc = triangle_of(q->n, rows, block, err);
    own = triangle(q, block);
    if (rc == MODAL_OK)
        rc = join(q->n, q->back, &own, false, q->back, err);
    if (rc == MODAL_OK)
        q->blocks.count++;
    return rc;
}

/* (1) */
static enum modal_status turn_over(struct window_qr *q, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    while (q->blocks.count > 0 && rc == MODAL_OK) {
        double *place = grow(q, &q->front);
        struct matrix block = triangle(q, q->blocks.x + size_of(q) * (size_t)(q->blocks.count - 1));
        if (place == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "window_qr: no memory for a block");
        if (q->front.count > 0)
            rc = join(q->n, place - size_of(q), &block, false, place, err);
        else
            memcpy(place, block.x, sizeof *place * size_of(q));
        q->front.count += rc == MODAL_OK;
        q->blocks.count -= rc == MODAL_OK;
    }
    memset(q->back, 0, sizeof *q->back * size_of(q));
    return rc;
}

enum modal_status window_qr_pop(struct window_qr *q, struct modal_error *err)
{
    enum modal_status rc = q->front.count == 0 ? turn_over(q, err) : MODAL_OK;

    if (rc == MODAL_OK && q->front.count > 0)
        q->front.count--;
    return rc;
}

enum modal_status window_qr_factor(const struct window_qr *q, const struct matrix *more, double *R,
                                   struct modal_error *err)
{
    struct matrix back = triangle(q, q->back);
    enum modal_status rc = MODAL_OK;

    if (q->front.count > 0 && q->blocks.count > 0) {
        rc = join(q->n, q->front.x + size_of(q) * (size_t)(q->front.count - 1), &back, false, R,
                  err);
    } else if (q->front.count > 0) {
        memcpy(R, q->front.x + size_of(q) * (size_t)(q->front.count - 1), sizeof *R * size_of(q));
    } else {
        memcpy(R, q->back, sizeof *R * size_of(q));
    }
    if (rc == MODAL_OK && more != NULL && more->m > 0)
        rc = join(q->n, R, more, true, R, err);
    return rc;
}
