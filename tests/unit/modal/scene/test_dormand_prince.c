#include "check.h"
#include <float.h>
#include "modal/scene/dormand_prince.h"

/* Each stage is exact for y' = 1: its weights add up to its node. */
TEST(stages_stand_at_their_nodes)
{
    for (int s = 0; s < DORMAND_PRINCE_ALL; s++) {
        double sum = 0, size = 1;
        for (int j = 0; j < s; j++) {
            sum += dormand_prince_weight[s][j];
            size += fabs(dormand_prince_weight[s][j]);
        }
        CHECK_NEAR(sum, dormand_prince_node[s], DORMAND_PRINCE_ALL * DBL_EPSILON * size);
    }
}

/* Quadrature of order 8: sum_j b_j c_j^q = 1 / (q + 1), q < 8; at 8 it is not. */
TEST(the_step_integrates_powers_below_the_eighth_exactly)
{
    const double *b = dormand_prince_weight[DORMAND_PRINCE_END];

    for (int q = 0; q <= 8; q++) {
        double sum = 0;
        for (int j = 0; j < DORMAND_PRINCE_END; j++)
            sum += b[j] * pow(dormand_prince_node[j], q);
        if (q < 8)
            CHECK_NEAR(sum, 1.0 / (q + 1), 1e-13);
        else
            CHECK(fabs(sum - 1.0 / (q + 1)) > 1e-6);
    }
}

/* Both error estimates, and the interpolant's higher coefficients, vanish for y' = 1. */
TEST(errors_and_higher_coefficients_of_a_line_vanish)
{
    double third = 0, fifth = 0;

    for (int j = 0; j < DORMAND_PRINCE_ALL; j++) {
        third += dormand_prince_error3[j];
        fifth += dormand_prince_error5[j];
    }
    CHECK_NEAR(third, 0, 1e-14);
    CHECK_NEAR(fifth, 0, 1e-14);
    for (int i = 0; i < DORMAND_PRINCE_DENSE - 3; i++) {
        double sum = 0;
        for (int j = 0; j < DORMAND_PRINCE_ALL; j++)
            sum += dormand_prince_dense[i][j];
        CHECK_NEAR(sum, 0, 1e-12);
    }
}
