/* check.h - unit tests whose names are sentences, on cmocka
 *
 *     TEST(a_sentence_that_can_be_false) { CHECK(1 + 1 == 2); CHECK_NEAR(x, 2.385, 1e-12); }
 *
 * Each TEST registers itself; the program that includes this header runs all of its own and
 * ends with cmocka's closing lines.  Include it once, in the test's only file.
 */
#ifndef TESTS_CHECK_H
#define TESTS_CHECK_H
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

static struct CMUnitTest check_tests[512];
static size_t check_count;

#define TEST(NAME) \
    static void test_##NAME(void); \
    static void check_run_##NAME(void **state) \
    { \
        (void)state; \
        test_##NAME(); \
    } \
    __attribute__((constructor)) static void check_add_##NAME(void) \
    { \
        check_tests[check_count++] = \
            (struct CMUnitTest) { #NAME, check_run_##NAME, NULL, NULL, NULL }; \
    } \
    static void test_##NAME(void)

#define CHECK(CONDITION)                                                         \
    do {                                                                         \
        if (!(CONDITION))                                                        \
            fail_msg("%s:%d: false: %s", __FILE__, __LINE__, #CONDITION);        \
    } while (0)

/* |GOT - EXPECTED| <= TOLERANCE; a NaN on either side fails.  */
#define CHECK_NEAR(GOT, EXPECTED, TOLERANCE) \
    do { \
        double got_ = (GOT), expected_ = (EXPECTED), tolerance_ = (TOLERANCE); \
        if (!(fabs(got_ - expected_) <= tolerance_)) \
            fail_msg("%s:%d: %s is %.17g, not %.17g within %.3g (off by %.3g)", __FILE__, \
                     __LINE__, #GOT, got_, expected_, tolerance_, fabs(got_ - expected_)); \
    } while (0)

#define CHECK_STRING(GOT, EXPECTED) \
    do { \
        const char *got_ = (GOT), *expected_ = (EXPECTED); \
        if (got_ == NULL || strcmp(got_, expected_) != 0) \
            fail_msg("%s:%d: %s is \"%s\", not \"%s\"", __FILE__, __LINE__, #GOT, \
                     got_ ? got_ : "(null)", expected_); \
    } while (0)

/* Of draws that chance alone tells apart, ALL in the nightly run (MODALD_LONG) and FEW before. */
static inline int check_draws(int few, int all)
{
    return getenv("MODALD_LONG") != NULL ? all : few;
}

/* Leaves a test of seconds, whose code others of its file run as well, to the nights where
 * sanitizers make tens of seconds of it. */
static inline void check_slow(void)
{
#ifdef __SANITIZE_ADDRESS__
    if (getenv("MODALD_LONG") == NULL)
        skip();
#endif
}

/* Leaves a test of half a minute, smaller kin of which stand beside it, to the nights. */
static inline void check_night(void)
{
    if (getenv("MODALD_LONG") == NULL)
        skip();
}

int main(void)
{
    return _cmocka_run_group_tests(__FILE__, check_tests, check_count, NULL, NULL);
}
#endif
