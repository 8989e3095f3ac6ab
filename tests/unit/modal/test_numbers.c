/* test_numbers.c - an array in order, and its largest magnitude */
#include "modal/numbers.h"
#include <math.h>
#include "check.h"

TEST(numbers_are_sorted_ascending_with_their_signs_and_repeats)
{
    double x[] = { 2.385, -7.5, 0.25, 2.385, -0.125, HUGE_VAL };
    const double sorted[] = { -7.5, -0.125, 0.25, 2.385, 2.385, HUGE_VAL };

    numbers_sort(x, 6);
    for (int i = 0; i < 6; i++)
        CHECK(x[i] == sorted[i]);
    numbers_sort(x, 0);
    CHECK(x[0] == -7.5);
}

TEST(the_largest_magnitude_may_be_negative_and_passes_over_what_is_no_number)
{
    const double x[] = { 2.385, NAN, -7.5, 0.25 };
    const double complex z[] = { CMPLX(3, 0), CMPLX(-3, 4), CMPLX(0, NAN), CMPLX(0, -4.5) };

    CHECK(numbers_largest(x, 4) == 7.5);
    CHECK(numbers_largest(x, 2) == 2.385);
    CHECK(numbers_largest(x, 0) == 0);
    CHECK(numbers_modulus(z, 4) == 5);
    CHECK(numbers_modulus(z, 0) == 0);
}
