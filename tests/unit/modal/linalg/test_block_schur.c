/* test_block_schur.c - F^T (a + c T)^-1 F, block after block */
#include "check.h"
#include <complex.h>
#include <float.h>
#include "modal/linalg/block_schur.h"

/* T = [2 1 0; 1 3 -1; 0 -1 5] in blocks of 2 and 1; F has (1, 0, 0) and (0, i, 0). */
static double block[] = { 2, 1, 1, 3 }, below[] = { 0, 0, -1, 0 }, last[] = { 5 };
static const struct block_step step[] = { { 2, 1, block, below }, { 1, 0, last, NULL } };

static double begin(struct block_schur *f, double complex a)
{
    CHECK(block_schur_init(f, 2, 2));
    block_schur_begin(f);
    block_schur_set(f, 0, 0, 1);
    block_schur_set(f, 1, 1, I);
    return block_schur_step(f, &step[0], a, 1, 2);
}

/* T^-1 has [14 -5; -5 10] / 23 there, T_1^-1 [3 -1; -1 2] / 5; left is [0 -1] T_1^-1 P_1. */
TEST(the_sum_is_of_the_inverse_of_all_blocks_so_far)
{
    struct block_schur f;

    CHECK(begin(&f, 0) > 0);
    CHECK_NEAR(creal(block_schur_sum(&f, 0, 0)), 3.0 / 5, 1e-15);
    CHECK_NEAR(cimag(block_schur_sum(&f, 0, 1)), -1.0 / 5, 1e-15);
    CHECK_NEAR(creal(block_schur_sum(&f, 1, 1)), -2.0 / 5, 1e-15);
    CHECK_NEAR(block_schur_left(&f, 0), 1.0 / 5, 1e-15);
    CHECK_NEAR(block_schur_left(&f, 1), 2.0 / 5, 1e-15);
    CHECK(block_schur_step(&f, &step[1], 0, 1, 2) > 0);
    CHECK_NEAR(creal(block_schur_sum(&f, 0, 0)), 14.0 / 23, 1e-15);
    CHECK_NEAR(cimag(block_schur_sum(&f, 1, 0)), -5.0 / 23, 1e-15);
    CHECK_NEAR(creal(block_schur_sum(&f, 1, 1)), -10.0 / 23, 1e-15);
    CHECK(block_schur_left(&f, 0) == 0);
    block_schur_done(&f);
}

/* At a = -2 the first diagonal entry is 0, and D_1 regular: [0 1; 1 1]^-1 = [-1 1; 1 0]. */
TEST(a_diagonal_entry_of_0_is_no_pivot_while_others_are_there)
{
    struct block_schur f;

    CHECK(begin(&f, -2) > 0);
    CHECK_NEAR(creal(block_schur_sum(&f, 0, 0)), -1, 1e-15);
    CHECK_NEAR(cimag(block_schur_sum(&f, 0, 1)), 1, 1e-15);
    CHECK_NEAR(creal(block_schur_sum(&f, 1, 1)), 0, 1e-15);
    block_schur_done(&f);
}

/* What a pivot brings is as large as it is small: 1e10 of 1e-10. */
TEST(a_singular_block_is_told_and_one_next_to_it_shows)
{
    static double zero[] = { 1, 1, 1, 1 }, nearly[] = { 1, 1, 1, 1 + 1e-10 };
    struct block_schur f;

    CHECK(block_schur_init(&f, 1, 2));
    for (int i = 0; i < 2; i++) {
        block_schur_begin(&f);
        block_schur_set(&f, 0, 0, 1);
        if (i == 0)
            CHECK(block_schur_step(&f, &(struct block_step) { 2, 0, zero, NULL }, 0, 1, 1) == -1);
        else
            CHECK(block_schur_step(&f, &(struct block_step) { 2, 0, nearly, NULL }, 0, 1, 1) > 9e9);
    }
    block_schur_done(&f);
}
