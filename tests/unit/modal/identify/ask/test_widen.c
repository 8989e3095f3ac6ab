/* What a record hides about its modes, against the modes that it is made of. */
#include "answer.h"
#include "check.h"
#include "signals.h"
#include <stdlib.h>

enum { L = 400, S = 14 };

/*
 * A mode of a tenth of another's amplitudes, a third of a turn over the record from it, gains some
 * 170 of chi-squared beside it: more than the 101 that white noise gives in one of a thousand
 * records (criterion.h), less than its price, 2 (S + 1 + 1/S) ln(L S) = 260.  Mostly it is left
 * out, and bends the other by up to 6 of the errors that this would have alone.  Of 2 x 12 normal
 * errors one is beyond 4 with a chance of 2e-3.
 */
TEST(a_mode_too_weak_to_pay_widens_the_errors_of_the_one_that_it_bends_and_no_growth_is_told)
{
    const double complex lambda[] = { CMPLX(-0.02, 12.7) / L, CMPLX(-0.02, 14.5) / L };
    static double y[L * S];
    int left_out = 0;

    for (uint64_t seed = 1; seed <= 12; seed++) {
        struct random rng = { seed };
        double complex a[2];
        for (int c = 0; c < S; c++) {
            for (int j = 0; j < 2; j++)
                a[j] = (j == 0 ? 4 : 0.4) * CMPLX(random_normal(&rng), random_normal(&rng));
            for (int l = 0; l < L; l++)
                y[l * S + c] = creal(a[0] * cexp(lambda[0] * l) + a[1] * cexp(lambda[1] * l))
                             + random_normal(&rng);
        }
        struct identify_result r = identified(y, L, S, 0, 0);
        CHECK(r.verdict != VERDICT_UNSTABLE);
        if (r.mode_count == 1)
            CHECK(isnan(r.modes[0].std_re) || shows(&r, lambda[0], 4));
        left_out += r.mode_count == 1;
        identify_result_done(&r);
    }
    CHECK(left_out >= 6);
}
