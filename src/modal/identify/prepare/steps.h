/* steps.h - a channel's mean that jumps and stays: a sensor that slips, a load that goes; and one
 * sample that is off by itself */
#ifndef MODAL_STEPS_H
#define MODAL_STEPS_H
#include <stdbool.h>
#include "base/error.h"
#include "modal/identify/prepare/rebuild.h"
#include "modal/linalg/matrix.h"

/* CHANNEL is SIZE higher from ROW on. */
struct step { int row, channel; double size, std; };
struct steps { struct step *at; int count; };         /* owned; by channels */

/*
 * The steps of Y (L x S) and its lone SPIKES, SIZE off, told by what samples are by those about
 * them (steps.c), their std 0. Of a record without any one in 1 / IDENTIFY_ALARM has one. Both
 * are the caller's to steps_done. Fails with MODAL_NO_MEMORY.
 */
enum modal_status steps_find(const struct matrix *Y, struct steps *out, struct steps *spikes,
                             struct modal_error *err);

/* Y without the steps that it has, or with them again (SENSE -1). */
void steps_take(const struct steps *s, int sense, struct matrix *Y);

/*
 * Rows, sizes and std, of Y without the steps as they were, by least squares of poles and steps
 * together; *moved: the longest change, in its std; *left: -2 ln(likelihood), but for a constant,
 * of what they leave in channels whose noise each has its own size. Fails with MODAL_NO_MEMORY,
 * MODAL_NO_CONVERGENCE.
 */
enum modal_status steps_fit(const struct rebuild_model *poles, const struct matrix *Y,
                            struct steps *s, double *moved, double *left,
                            struct modal_error *err);
void steps_done(struct steps *s);
#endif
