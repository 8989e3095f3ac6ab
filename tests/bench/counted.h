/* counted.h - what this thread executes: instructions, which a machine that does something else
 * does not change */
#ifndef BENCH_COUNTED_H
#define BENCH_COUNTED_H
#include <linux/perf_event.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

/* A counter of instructions in user mode; -1: the machine has none, or keeps it to itself. */
static inline int counted_open(void)
{
    struct perf_event_attr a;

    memset(&a, 0, sizeof a);
    a.size = sizeof a;
    a.type = PERF_TYPE_HARDWARE;
    a.config = PERF_COUNT_HW_INSTRUCTIONS;
    a.exclude_kernel = a.exclude_hv = 1;
    return (int)syscall(SYS_perf_event_open, &a, 0, -1, -1, 0);
}

/* How many so far; 0 where COUNTER is -1. */
static inline double counted(int counter)
{
    long long n = 0;

    return read(counter, &n, sizeof n) == (ssize_t)sizeof n ? (double)n : 0;
}
#endif
