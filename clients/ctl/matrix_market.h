/* matrix_market.h - a matrix from a file in Matrix Market's format, as the compressed rows that
 * stand behind a scene's text */
#ifndef CTL_MATRIX_MARKET_H
#define CTL_MATRIX_MARKET_H
#include "base/error.h"
#include "base/json.h"
#include "modal/scene/scene_arrays.h"

/*
 * Read the file at PATH, one of CalculiX's where it is called .sti or .mas, else `coordinate` or
 * `array`, `real` or `integer`, `general`, `symmetric` or `skew-symmetric`, into ARRAYS; what the
 * scene's text says of it into *OUT, the caller's.  Entries of one place add up.  Fails with
 * MODAL_BAD_INPUT, at FIELD: no such file, or the line that is wrong.
 */
enum modal_status matrix_market_read(const char *path, const char *field,
                                     struct scene_arrays_made *arrays, cJSON **out,
                                     struct modal_error *err);

#endif
