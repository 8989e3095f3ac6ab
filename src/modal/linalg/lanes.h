/* lanes.h - rows of numbers, four at once
 *
 * By AVX where the machine has it, else by the pairs that every x86-64 has, or as the machine at
 * hand does it.  Products and sums are rounded apart in all of them, so that answers are the same
 * to the bit. */
#ifndef MODAL_LANES_H
#define MODAL_LANES_H
#include <stdbool.h>

enum { LANES = 4 };             /* a row's numbers come in a multiple of it */
/* Of a row at any place. */
typedef double lanes __attribute__((vector_size(LANES * sizeof(double)), aligned(8), may_alias));

/* A function of which there are two, LANES_NARROW and, called where lanes_wide() says so,
 * LANES_WIDE, each around one body of LANES_BODY. */
#define LANES_BODY static inline __attribute__((always_inline))
#define LANES_NARROW static __attribute__((noinline))
#if defined(__x86_64__)
#define LANES_WIDE static __attribute__((noinline, target("avx")))
static inline bool lanes_wide(void) { return __builtin_cpu_supports("avx"); }
#else
#define LANES_WIDE LANES_NARROW
static inline bool lanes_wide(void) { return false; }
#endif

#endif
