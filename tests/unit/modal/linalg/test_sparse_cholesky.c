/* test_sparse_cholesky.c - factors of sparse symmetric matrices */
#include "check.h"
#include <string.h>
#include "modal/linalg/sparse_cholesky.h"

/* [4 1 0; 1 3 -1; 0 -1 2] but for its last diagonal entry; both triangles. */
static const int start[] = { 0, 2, 5, 7 }, row[] = { 0, 1, 0, 1, 2, 1, 2 };

static struct sparse_cholesky *factors(double last)
{
    const double value[] = { 4, 1, 1, 3, -1, -1, last };
    struct modal_error err = { 0 };
    struct sparse_cholesky *f;

    CHECK(sparse_cholesky_new(3, start, row, value, &f, &err) == MODAL_OK);
    return f;
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

TEST(a_matrix_that_is_not_positive_has_no_factors)
{
    CHECK(factors(0.1) == NULL);
    sparse_cholesky_free(NULL);
}
