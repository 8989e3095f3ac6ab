/* blas_core.h - the BLAS kernels a process computes with: the right ones, and which they are
 *
 * OpenBLAS chooses its kernels when the library loads.  Version 0.3.21 (Debian 12) does not know
 * processors newer than itself and takes SSE3 kernels there, at a fifth of the speed
 * (OpenMathLib/OpenBLAS issue 4267).  The choice can only be made in the environment before
 * loading, hence the re-execution.
 */
#ifndef JOB_BLAS_CORE_H
#define JOB_BLAS_CORE_H
#include <stdbool.h>

/*
 * Call first thing in main, before any thread, file or socket.  Where OpenBLAS runs kernels poorer
 * than this processor has instructions for, and OPENBLAS_CORETYPE is not set, set it and execute
 * this same program (/proc/self/exe) again with ARGV; then it does not return.  It returns where
 * all is well, where the environment has decided, where the process is already the second one
 * (MODALD_BLAS_CORE is set), or where execv failed: slow, but right.
 */
void blas_core_ensure(char *const argv[]);

/* The kernels in use, such as "SkylakeX": belongs to a result's provenance. */
const char *blas_core_name(void);

/* The OPENBLAS_CORETYPE that `running` kernels should give way to on this processor; NULL: none is
 * better. */
const char *blas_core_better(const char *running, bool avx2, bool avx512);
#endif
