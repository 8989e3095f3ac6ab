/* matrix_market.h - a matrix from a file in Matrix Market's format, as the compressed rows that a
 * scene takes */
#ifndef CTL_MATRIX_MARKET_H
#define CTL_MATRIX_MARKET_H
#include "base/error.h"
#include "base/json.h"

/*
 * Read the file at PATH, `coordinate` or `array`, `real` or `integer`, `general`, `symmetric` or
 * `skew-symmetric`, into the sparse form of modal/scene/scene.h; the caller frees *OUT.  Entries of
 * one place add up.  Fails with MODAL_BAD_INPUT, at FIELD: no such file, or the line that is wrong.
 */
enum modal_status matrix_market_read(const char *path, const char *field, cJSON **out,
                                     struct modal_error *err);

/* The form of a sparse matrix in a scene: M x N, COUNT entries by compressed rows; the caller
 * frees. */
cJSON *matrix_market_rows(size_t m, size_t n, const double *pointers, const double *columns,
                          const double *values, size_t count);

#endif
