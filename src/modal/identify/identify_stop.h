/* identify_stop.h - a response that stops where its modes would last */
#ifndef MODAL_IDENTIFY_STOP_H
#define MODAL_IDENTIFY_STOP_H
#include "base/error.h"
#include "modal/batch.h"
#include "modal/identify/result.h"
#include "modal/linalg/matrix.h"

/* The rows that an answer is of, as they were sent, and what models leave of them. */
struct stop {
    struct matrix Y;             /* m x S */
    size_t first;                /* of the batch */
    double dt;
    double *left;                /* (m + 1) x S: sum of squares of the rows before, less modes */
    double *sum, *own;           /* (m + 1) x S: of the rows from there on, less the last, and of
                                  * their squares */
    double all;                  /* the criterion (1) of the answer to all rows */
    int at, next;                /* the row where it stops, as identified and as told by that */
    int round;
    bool is;                     /* stopping at AT is likelier than all rows are */
};

/* Does the response that ALL, an answer of B, is of seem to stop? Fails with MODAL_NO_MEMORY or
 * MODAL_NO_CONVERGENCE; whatever is returned, *s is the caller's to stop_done. */
enum modal_status stop_begin(struct stop *s, const struct batch *b,
                             const struct identify_result *all, struct modal_error *err);
/* Where it does, and that is not settled: the window of B that is to be identified. */
bool stop_asks(struct stop *s, double window[2]);
/* BEFORE is what that window shows: s->is, and it proposes the window. Fails as stop_begin(). */
enum modal_status stop_tell(struct stop *s, struct identify_result *before,
                            struct modal_error *err);
void stop_done(struct stop *s);
/* ALL says so, proposes what BEFORE is of, and has no standard errors and no verdict. */
void stop_report(struct identify_result *all, const struct identify_result *before);
#endif
