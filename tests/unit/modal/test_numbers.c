/* test_numbers.c - an array in order, its largest magnitude, and rows of matrices */
#include "modal/numbers.h"
#include <math.h>
#include <stdint.h>
#include <string.h>
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

/* Of orders that a median of three halves well, badly and not at all: ascending, descending, all
 * the same, few values, up and down again, dice. */
TEST(the_number_of_any_rank_is_that_of_the_sorted_array)
{
    enum { MOST = 3000, ORDERS = 6 };
    static const size_t counts[] = { 1, 2, 3, 64, 65, 66, 67, 100, 1000, MOST };
    static double x[MOST], sorted[MOST];
    uint64_t dice = 5;

    for (size_t c = 0; c < sizeof counts / sizeof *counts; c++)
        for (int order = 0; order < ORDERS; order++) {
            const size_t n = counts[c];
            for (size_t k = 0; k < n; k += n > 100 ? n / 7 : 1) {
                for (size_t i = 0; i < n; i++) {
                    const double of[ORDERS] = { (double)i, -(double)i, 4, (double)(i % 3),
                                                fmin((double)i, (double)(n - i)),
                                                (double)(dice >> 40) };
                    dice = dice * 6364136223846793005u + 1442695040888963407u;
                    x[i] = sorted[i] = of[order];
                }
                numbers_sort(sorted, n);
                CHECK(numbers_ranked(x, n, k) == sorted[k]);
                numbers_sort(x, n);                   /* the same ones are still there */
                CHECK(memcmp(x, sorted, n * sizeof *x) == 0);
            }
        }
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
