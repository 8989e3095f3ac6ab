/* blas_core.c - see blas_core.h */
#include "job/blas_core.h"
#include <cblas.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum width { SSE = 0, AVX2 = 1, AVX512 = 2 };

/* What OpenBLAS 0.3.21 to 0.3.28 call kernels on x86-64 that use wide registers; every other name
 * there is SSE or AVX. */
static const struct core { const char *name; enum width width; } cores[] = {
    { "Haswell", AVX2 },    { "Zen", AVX2 },            { "Excavator", AVX2 },
    { "SkylakeX", AVX512 }, { "Cooperlake", AVX512 },   { "SapphireRapids", AVX512 },
};

static enum width width_of(const char *name)
{
    for (size_t i = 0; i < sizeof cores / sizeof cores[0]; i++)
        if (strcasecmp(cores[i].name, name) == 0)
            return cores[i].width;
    return SSE;
}

const char *blas_core_better(const char *running, bool avx2, bool avx512)
{
    enum width has = avx512 ? AVX512 : avx2 ? AVX2 : SSE, runs = width_of(running);

    /* Zen with AVX-512 is known to OpenBLAS and its choice of 256 bits is deliberate: only SSE
     * gives way. */
    if (runs != SSE || has == SSE)
        return NULL;
    return has == AVX512 ? "SkylakeX" : "Haswell";
}

const char *blas_core_name(void)
{
    return openblas_get_corename();
}

#if defined(__x86_64__)
static const char *better_here(void)
{
    /* the compiler's check asks the operating system for the registers too */
    __builtin_cpu_init();
    return blas_core_better(blas_core_name(),
                            __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"),
                            __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl")
                                && __builtin_cpu_supports("avx512dq")
                                && __builtin_cpu_supports("avx512bw"));
}
#else
static const char *better_here(void) { return NULL; }
#endif

void blas_core_ensure(char *const argv[])
{
    const char *better = better_here();

    if (better == NULL || getenv("OPENBLAS_CORETYPE") != NULL || getenv("MODALD_BLAS_CORE") != NULL)
        return;
    if (setenv("MODALD_BLAS_CORE", better, 1) != 0 || setenv("OPENBLAS_CORETYPE", better, 1) != 0)
        return;
    execv("/proc/self/exe", argv);
    unsetenv("OPENBLAS_CORETYPE");      /* only here if execv failed: leave no false trace */
    unsetenv("MODALD_BLAS_CORE");
}
