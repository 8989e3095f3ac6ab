/* test_sparse_cholesky.c - factors of sparse symmetric matrices */
#include "check.h"
#include <string.h>
#include "modal/linalg/lanes.h"
#include "modal/linalg/sparse_cholesky.h"

/* [4 1 0; 1 3 -1; 0 -1 2] but for its last diagonal entry; both triangles. */
static const int start[] = { 0, 2, 5, 7 }, row[] = { 0, 1, 0, 1, 2, 1, 2 };

static struct sparse_cholesky *factors(double last)
{
    const double value[] = { 4, 1, 1, 3, -1, -1, last };

    return sparse_cholesky_new(3, start, row, value);
}

TEST(several_right_hand_sides_are_solved_at_once)
{
    static const double x[] = { 1, 2, 3, -1, 0, 0.5 };
    /* A x, column by column */
    double y[] = { 6, 4, 4, -4, -1.5, 1 };
    struct sparse_cholesky *f = factors(2);

    assert_non_null(f);
    CHECK(sparse_cholesky_solve(f, y, 2));
    for (int i = 0; i < 6; i++)
        CHECK_NEAR(y[i], x[i], 1e-15);
    CHECK(sparse_cholesky_fill(f) == 5);
    sparse_cholesky_free(f);
}

/* L L^T in the order of elimination is A there: its inverse times a unit vector, by A's inverse
 * [5 -2 -1; -2 8 4; -1 4 11] / 18. */
TEST(half_a_solution_and_its_transpose_are_a_solution_in_the_order_of_elimination)
{
    enum { LD = LANES + 1 };
    static const double inverse[3][3] = { { 5, -2, -1 }, { -2, 8, 4 }, { -1, 4, 11 } };
    struct sparse_cholesky *f = factors(2);
    const int *order = sparse_cholesky_order(f);

    for (int j = 0; j < 3; j++) {
        double x[3][LD] = { 0 };

        x[j][j] = 1;                                    /* its column may be any */
        x[j][LD - 1] = -2;
        CHECK(sparse_cholesky_half(f, false, x[0], LANES, LD));
        CHECK(sparse_cholesky_half(f, true, x[0], LANES, LD));
        for (int i = 0; i < 3; i++) {
            CHECK_NEAR(x[i][j], inverse[order[i]][order[j]] / 18, 1e-15);
            CHECK(x[i][LD - 1] == (i == j ? -2 : 0));   /* past COLUMNS */
        }
    }
    sparse_cholesky_free(f);
}

/* Of a mesh of 40 x 40, whose panels are of one column and of dozens: CHOLMOD's own solution. */
TEST(half_a_solution_of_more_columns_than_four_registers_hold_is_half_of_cholmods)
{
    enum { SIDE = 40, N = SIDE * SIDE, COLUMNS = 5 * LANES };
    static int first[N + 1], of[5 * N];
    static double value[5 * N], x[N][COLUMNS], whole[COLUMNS][N];
    struct sparse_cholesky *f;
    int e = 0;

    for (int i = 0; i < N; i++) {
        int at = i % SIDE;
        const int next[] = { i - SIDE, at > 0 ? i - 1 : -1, i, at < SIDE - 1 ? i + 1 : -1,
                             i + SIDE < N ? i + SIDE : -1 };

        first[i] = e;
        for (int j = 0; j < 5; j++)
            if (next[j] >= 0) {
                value[e] = next[j] == i ? 4.5 : -1;
                of[e++] = next[j];
            }
        for (int j = 0; j < COLUMNS; j++)
            whole[j][i] = (i * (j + 3) % 17 - 8) / 8.0;
    }
    first[N] = e;
    f = sparse_cholesky_new(N, first, of, value);
    assert_non_null(f);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < COLUMNS; j++)
            x[i][j] = whole[j][sparse_cholesky_order(f)[i]];
    CHECK(sparse_cholesky_half(f, false, x[0], COLUMNS, COLUMNS));
    CHECK(sparse_cholesky_half(f, true, x[0], COLUMNS, COLUMNS));
    CHECK(sparse_cholesky_solve(f, whole[0], COLUMNS));
    for (int i = 0; i < N; i++)
        for (int j = 0; j < COLUMNS; j++)
            CHECK_NEAR(x[i][j], whole[j][sparse_cholesky_order(f)[i]], 1e-13);
    sparse_cholesky_free(f);
}

TEST(a_matrix_that_is_not_positive_has_no_factors)
{
    CHECK(factors(0.1) == NULL);
    sparse_cholesky_free(NULL);
}
