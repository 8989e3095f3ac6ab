/* machine.h - what of the machine is ours: its memory, as far as control groups leave it */
#ifndef BASE_MACHINE_H
#define BASE_MACHINE_H
#include <stdint.h>

/* Bytes: the machine's memory, or less where a control group of ours, or one that it lies in,
 * has a limit (memory.max). */
int64_t machine_memory(void);

/* An equal part of MEMORY for each of WORKERS and one for the daemon and the system, at least
 * WORKER_MEMORY_LEAST: what a worker may have where nobody said otherwise. */
#define WORKER_MEMORY_LEAST (INT64_C(1) << 30)    /* work arrays of a batch of any size, below half
                                                     of it, and OpenBLAS's 128 MB a thread */
int64_t machine_worker_memory(int64_t memory, int workers);
#endif
