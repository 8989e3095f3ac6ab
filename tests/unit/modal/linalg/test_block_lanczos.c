/* test_block_lanczos.c - a symmetric matrix in block tridiagonal form */
#include "check.h"
#include <math.h>
#include <string.h>
#include "modal/linalg/block_lanczos.h"

enum { N = 12, SIDES = 3 };

/* Reflected: eigenvalues 1 .. N, vectors those of 1 - 2 v v^T / v^T v. */
static double entry(int i, int j)
{
    double v[N], size = 0, sum = 0;

    for (int k = 0; k < N; k++) {
        v[k] = 1 + 0.37 * k;
        size += v[k] * v[k];
    }
    for (int k = 0; k < N; k++)
        sum += (k + 1) * ((i == k) - 2 * v[i] * v[k] / size) * ((j == k) - 2 * v[j] * v[k] / size);
    return sum;
}

static bool product(void *context, int columns, int ld, double *X, double *Y)
{
    (void)context;
    for (int i = 0; i < N; i++)
        for (int v = 0; v < columns; v++) {
            Y[i * ld + v] = 0;
            for (int j = 0; j < N; j++)
                Y[i * ld + v] += entry(i, j) * X[j * ld + v];
        }
    return true;
}

/* The trace of N is the sum of its eigenvalues, that of its square of their squares: T's, once it
 * spans everything. */
TEST(its_blocks_have_the_traces_of_the_matrix_and_its_square_once_they_are_as_many)
{
    struct block_lanczos l;
    double trace = 0, squares = 0;
    int order = 0;

    CHECK(block_lanczos_init(&l, N, SIDES));
    for (int i = 0; i < N; i++)
        for (int v = 0; v < SIDES; v++)
            l.Q[1][i * l.ld + v] = sin(1 + i + 5.3 * v * i);
    CHECK(block_lanczos_begin(&l));
    for (int j = 0; j < N / SIDES; j++)
        CHECK(block_lanczos_step(&l, product, NULL));
    for (int j = 0; j < l.steps; j++) {
        const struct block_step *s = &l.step[j];

        order += s->wide;
        for (int i = 0; i < s->wide; i++) {
            trace += s->A[i * s->wide + i];
            for (int m = 0; m < s->wide; m++)
                squares += s->A[i * s->wide + m] * s->A[i * s->wide + m];
        }
        for (int i = 0; j + 1 < l.steps && i < s->next; i++)
            for (int m = 0; m < s->wide; m++)
                squares += 2 * s->B[m * s->wide + i] * s->B[m * s->wide + i];
    }
    CHECK(order == N);
    CHECK_NEAR(trace, 78, 1e-10);
    CHECK_NEAR(squares, 650, 1e-9);
    block_lanczos_done(&l);
}

/* The third is the sum of the others, and of N's eigenvectors two are spanned: one step. */
TEST(vectors_that_depend_on_others_are_left_out_and_a_space_that_is_whole_ends_it)
{
    struct block_lanczos l;
    double v[N], size = 0;

    for (int k = 0; k < N; k++) {
        v[k] = 1 + 0.37 * k;
        size += v[k] * v[k];
    }
    CHECK(block_lanczos_init(&l, N, SIDES));
    for (int i = 0; i < N; i++) {
        l.Q[1][i * l.ld] = (i == 4) - 2 * v[i] * v[4] / size;
        l.Q[1][i * l.ld + 1] = 3 * ((i == 7) - 2 * v[i] * v[7] / size);
        l.Q[1][i * l.ld + 2] = l.Q[1][i * l.ld] + l.Q[1][i * l.ld + 1];
    }
    CHECK(block_lanczos_begin(&l));
    CHECK(l.step[0].wide == 2);
    CHECK_NEAR(fabs(l.R[SIDES + 1]), 3, 1e-14);
    CHECK(block_lanczos_step(&l, product, NULL));
    CHECK(l.steps == 1 && l.ended && !block_lanczos_step(&l, product, NULL));
    CHECK_NEAR(l.step[0].A[0], 5, 1e-13);
    CHECK_NEAR(l.step[0].A[3], 8, 1e-13);
    CHECK_NEAR(l.step[0].A[1], 0, 1e-13);
    block_lanczos_done(&l);
}
