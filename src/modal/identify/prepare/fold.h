/* fold.h - a record of p samples a period, arranged as rows of whole periods */
#ifndef MODAL_FOLD_H
#define MODAL_FOLD_H
#include "base/error.h"
#include "modal/linalg/matrix.h"

/* Row l, column k + p s of OUT is sample k + l p of signal s: floor(K/p) whole periods; the caller
 * frees out->x. */
enum modal_status fold(const struct matrix *Y, int p, struct matrix *out, struct modal_error *err);
#endif
