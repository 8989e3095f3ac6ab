/* assign.h - who goes with whom: the assignment of greatest worth */
#ifndef MODAL_ASSIGN_H
#define MODAL_ASSIGN_H
#include "base/error.h"

/*
 * Each of M rows goes with at most one of N columns, no two rows with the same, so that the sum of
 * worth[i * n + j] over the pairs is greatest; none that is not above 0 is made, -HUGE_VAL forbids.
 *
 *   column   M: each row's column; -1: none
 *
 * Of M^2 (M + N) operations at most.  Fails with MODAL_NO_MEMORY.
 */
enum modal_status assign_best(const double *worth, int m, int n, int *column,
                              struct modal_error *err);
#endif
