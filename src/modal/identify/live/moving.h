/* moving.h - the identification of a moving window: samples come, the modes of the last so many are
 * asked for again and again */
#ifndef MODAL_MOVING_H
#define MODAL_MOVING_H
#include <stddef.h>
#include <stdint.h>
#include "base/error.h"
#include "modal/identify/identify.h"

enum { MOVING_CHANNELS_MOST = 64 };       /* more, and each window is identified from nothing */

struct moving_options {
    int channels, window;                 /* window: samples */
    int hop;                              /* samples between results, as far as is known: 0 unknown.
                                           * Only the cost depends on it */
    double dt, period;                    /* of the batch */
    struct identify_options identify;     /* pointers borrowed; `clock` and `cancelled` serve
                                           * windows identified from nothing */
};

/* How a result came about. */
struct moving_cost {
    bool updated;                      /* from the result before; false: from nothing, as a batch */
    const char *why;            /* where it was from nothing: a word of moving.c; else NULL */
    double work;                    /* multiplications of the update's fits; 0 where from nothing,
                                     * and of a periodic system */
    uint64_t updates, batches;            /* of this window so far */
};

struct moving;

/*
 * The caller frees *out with moving_free.  Fails with MODAL_BAD_INPUT (no channels, a window of
 * fewer than IDENTIFY_SAMPLES_LEAST), MODAL_NO_MEMORY. Options that identify refuses are refused by
 * moving_identify.
 */
enum modal_status moving_new(const struct moving_options *options, struct moving **out,
                             struct modal_error *err);
void moving_free(struct moving *m);

/* COUNT samples, each `channels` numbers, behind those before. Fails with MODAL_NO_MEMORY. */
enum modal_status moving_push(struct moving *m, const double *samples, size_t count,
                              struct modal_error *err);

/* All samples are forgotten; what comes next is not joined to them (a gap). The poles stay, for the
 * next window to begin at. */
void moving_clear(struct moving *m);

/* How many samples the window has, at most `window`. */
int moving_samples(const struct moving *m);

/* The last `window` samples, row by row, until the next push; NULL where there are fewer. */
const double *moving_window(const struct moving *m);

/*
 * The modes of the last `window` samples: those that modal_identify finds in the same samples, with
 * the same errors, verdict and diagnostics, to within 1e-9 and rounding.  What an update does not
 * know is NAN or empty: `residual` and `persistence` of a mode, singular values, candidates, poles;
 * clipped samples are looked for only in windows identified from nothing. *out as from
 * modal_identify; COST may be NULL.  Fails as modal_identify does, and with MODAL_BAD_INPUT where
 * the window is not full.
 */
enum modal_status moving_identify(struct moving *m, struct identify_result *out,
                                  struct moving_cost *cost, struct modal_error *err);
#endif
