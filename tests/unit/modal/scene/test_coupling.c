/* Forces that are polynomials of several displacements, by hand. */
/* Tests as well: polynomial_coupling.c */
#include <float.h>
#include "check.h"
#include "modal/scene/law.h"

/* f_2 = 3 d_0^2 d_1 - d_2 d_1, f_0 = d_1^3 at (2, 5, -1). */
TEST(a_coupling_and_its_slopes_are_those_worked_out_by_hand)
{
    static const struct law_term terms[] = { { 3, 2, { 2, 1 } }, { -1, 2, { 0, 1, 1 } },
                                             { 1, 0, { 0, 3 } } };
    static const double slopes[3][3] = { { 0, 75, 0 }, { 0, 0, 0 }, { 60, 13, -5 } };
    const double d[] = { 2, 5, -1 }, f[] = { 125, 0, 65 };
    struct law law;
    struct law_force out;

    for (size_t i = 0; i < sizeof out; i++)
        ((unsigned char *)&out)[i] = 0x55;            /* nothing may be left as it stood */
    CHECK(law_coupling(terms, 3, 3, &law, NULL) == MODAL_OK);
    CHECK(law.kind->inputs == 3 && law.degree == 3 && law.memory == 0);
    CHECK(law.kind->force(&law, &(struct law_point) { .d = d, .v = d }, &out, NULL) == MODAL_OK);
    for (int i = 0; i < 3; i++) {
        CHECK_NEAR(out.f[i], f[i], 0);
        for (int j = 0; j < 3; j++) {
            CHECK_NEAR(out.fd[i][j], slopes[i][j], 0);
            CHECK_NEAR(out.fv[i][j], 0, 0);
        }
    }
    law_done(&law);
}

/* At rest slopes of powers above 1 are 0, and 0^0 is 1. */
TEST(at_rest_a_coupling_has_no_slope_and_no_nan)
{
    static const struct law_term terms[] = { { 3, 0, { 2, 1 } }, { 7, 1, { 1, 1 } } };
    const double d[] = { 0, 0 };
    struct law law;
    struct law_force out;

    CHECK(law_coupling(terms, 2, 2, &law, NULL) == MODAL_OK);
    CHECK(law.kind->force(&law, &(struct law_point) { .d = d, .v = d }, &out, NULL) == MODAL_OK);
    for (int i = 0; i < 2; i++)
        CHECK(out.f[i] == 0 && out.fd[i][0] == 0 && out.fd[i][1] == 0);
    law_done(&law);
}

/* A direction's force and slope: w f and gain w w^T. */
TEST(ends_weigh_what_is_seen_what_is_pushed_and_what_couples)
{
    static const struct law_end first[] = { { 1, 2 }, { 3, -0.5 } }, second = { 0, 4 };
    static const struct law_term term = { 1, 1, { 1, 1 } };
    const double x[] = { 10, 20, 30, 40 };
    double f[4] = { 0 }, K[16] = { 0 };
    struct law law;

    CHECK(law_coupling(&term, 1, 2, &law, NULL) == MODAL_OK);
    CHECK(law_ends(&law) == 0 && law_sees(&law, 0, x) == 0);
    CHECK(law_add_ends(&law, 0, first, 2) && law_add_ends(&law, 1, &second, 1));
    CHECK(law_ends(&law) == 3);
    CHECK_NEAR(law_sees(&law, 0, x), 20, 0);
    CHECK_NEAR(law_sees(&law, 1, x), 40, 0);
    law_push(&law, 0, 3, f);
    CHECK(f[0] == 0 && f[1] == 6 && f[2] == 0 && f[3] == -1.5);
    law_spread(&law, 1, 0, 5, 4, K);                  /* force 1 by displacement 0 */
    for (int i = 0; i < 16; i++)
        CHECK_NEAR(K[i], i == 0 + 4 * 1 ? 40 : i == 0 + 4 * 3 ? -10 : 0, 0);
    law_done(&law);
}
