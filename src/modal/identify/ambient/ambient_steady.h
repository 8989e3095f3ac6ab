/* ambient_steady.h - is the record of one excitation throughout, and each of its channels? */
#ifndef MODAL_AMBIENT_STEADY_H
#define MODAL_AMBIENT_STEADY_H
#include "base/error.h"
#include "modal/identify/result.h"
#include "modal/linalg/matrix.h"

struct record;
struct spectrum;

enum { AMBIENT_STEADY_UNITS = 64 };  /* equal parts that the record is looked at in */

/*
 * Adds to the result's diagnostics not_ambient, which makes it driven, or not_stationary, of all
 * signals or else of channels, a few at most; see ambient.h.
 */
struct ambient_steady_input {
    const struct matrix *Z;          /* signals of unit variance, and */
    const struct spectrum *spectrum; /* all of their lines */
    const struct record *rec;        /* channels; NULL: are not asked for themselves */
    const double *back;              /* channels x signals: from those to them */
};
/* Fails with MODAL_NO_MEMORY. */
enum modal_status ambient_steady_tell(const struct ambient_steady_input *in,
                                      struct identify_result *r, struct modal_error *err);
#endif
