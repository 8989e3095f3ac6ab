/* test_numbers.c - an array in order, its largest magnitude, and rows of matrices */
#include "modal/numbers.h"
#include <math.h>
#include <sys/mman.h>
#include <unistd.h>
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

/* Two rows of a 2 x 3 matrix by columns: (1 + i, 2, -i) and (3, i, 4), whose last number is the
 * last of its page. */
TEST(rows_of_a_matrix_are_multiplied_and_nothing_beyond_them_is_read)
{
    const size_t page = (size_t)sysconf(_SC_PAGESIZE);
    char *pages = mmap(NULL, 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    double complex *m = (double complex *)(pages + page) - 6, dot;

    CHECK(pages != MAP_FAILED && mprotect(pages + page, page, PROT_NONE) == 0);
    m[0] = CMPLX(1, 1), m[2] = 2, m[4] = CMPLX(0, -1);
    m[1] = 3, m[3] = CMPLX(0, 1), m[5] = 4;
    dot = numbers_row_dot(3, m, 2, m + 1, 2);
    CHECK(creal(dot) == 3 && cimag(dot) == 3);       /* 3 - 3 i + 2 i + 4 i */
    CHECK(numbers_row_dot(0, m, 2, m, 2) == 0);
    munmap(pages, 2 * page);
}
