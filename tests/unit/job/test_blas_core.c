/* The choice of BLAS kernels: names from OpenBLAS's own list (cpuid_x86.c of 0.3.21), instructions
 * from the processor. */
#include "job/blas_core.h"
#include <stdlib.h>
#include "check.h"

TEST(sse3_kernels_on_an_avx512_processor_give_way_to_SkylakeX)
{
    CHECK_STRING(blas_core_better("Prescott", true, true), "SkylakeX");
    CHECK_STRING(blas_core_better("Nehalem", true, true), "SkylakeX");
}

TEST(sse3_kernels_on_an_avx2_processor_give_way_to_Haswell)
{
    CHECK_STRING(blas_core_better("Prescott", true, false), "Haswell");
}

TEST(kernels_that_fit_are_left_alone)
{
    CHECK(blas_core_better("SkylakeX", true, true) == NULL);
    CHECK(blas_core_better("Cooperlake", true, true) == NULL);
    CHECK(blas_core_better("Haswell", true, true) == NULL);
    CHECK(blas_core_better("Zen", true, false) == NULL);
    CHECK(blas_core_better("Prescott", false, false) == NULL);
}

/* A decision in the environment stands: were it overruled, this process would start again and never
 * come back here. */
TEST(a_choice_in_the_environment_is_not_overruled)
{
    char program[] = "test", *argv[] = { program, NULL };

    CHECK(setenv("OPENBLAS_CORETYPE", "Prescott", 1) == 0);
    blas_core_ensure(argv);
    CHECK_STRING(getenv("OPENBLAS_CORETYPE"), "Prescott");
    CHECK(blas_core_name() != NULL && blas_core_name()[0] != 0);
}
