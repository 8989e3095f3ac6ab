/* wild.h - samples that are neither motion nor noise: spikes of a telemetry, dropouts */
#ifndef MODAL_WILD_H
#define MODAL_WILD_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"
#include "modal/identify/prepare/rebuild.h"
#include "modal/linalg/matrix.h"

struct wild_sample { int row, channel; double sent; };

/* What was taken out of a record, by channels and rows. */
struct wild {
    struct wild_sample *at; int count;     /* owned */
    double share;          /* of what the record tells, that was in them: of its numbers, or of the
                            * motion's energy where that is more */
    const struct wild_sample *known; int known_count;  /* borrowed, by channels and rows: wild
                            * whatever the poles say (stuck.h) */
    bool no_others;        /* are looked for */
};

/* (1) of wild.c, by bisection: standard deviations that one of N numbers of white noise exceeds so
 * seldom. */
double wild_standing_out(double n);
/* Standard deviation of COUNT numbers of normal noise by the median of their magnitudes, which half
 * of them may spoil; ROOM for as many. */
double wild_size(const double *e, int count, double *room);

/*
 * The samples of Y (L x S) that stand out of what the poles leave (wild.c), and
 * that the poles rebuild in their place: a fit to Y is then one to the others, but for steps of
 * `share` of the way. What *w has was taken out of Y before, and is put back first. None, and Y
 * whole, where they are no few: w->count 0.
 *
 * Fails with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE, and *w is then still what Y lacks.
 */
enum modal_status wild_take(const struct rebuild_model *poles, struct matrix *Y, struct wild *w,
                            struct modal_error *err);
/*
 * The strongest of the poles, into BEST, that has room for them: as many as the medians of what
 * they leave ask for, by Bayes' criterion. Poles may have drawn wild samples, of which a median
 * knows nothing. Fails as wild_take does.
 */
enum modal_status wild_strongest(const struct rebuild_model *poles, const struct matrix *Y,
                                 double complex *best, int *best_count, struct modal_error *err);
/* Y is whole again, *w empty. */
void wild_put_back(struct matrix *Y, struct wild *w);
void wild_done(struct wild *w);
#endif
