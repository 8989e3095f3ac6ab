/* wide.h - batches too wide or too large to copy: read where they lie, panel by panel */
#ifndef MODAL_WIDE_H
#define MODAL_WIDE_H
#include <complex.h>
#include <stdbool.h>
#include <stddef.h>
#include "base/error.h"
#include "modal/identify/prepare/grid.h"
#include "modal/identify/prepare/pod.h"
#include "modal/linalg/lanczos.h"

/*
 * Sample k of channel c is x[k * stride + c], as a batch has it (in memory or mapped); it counts
 * divided by scale[c], and a channel of scale 0 counts as zero.  Everything is borrowed.
 */
struct wide {
    const double *x;
    size_t stride;
    int L, S;                /* samples, channels */
    const double *scale;     /* S; NULL: all 1 */
    bool by_rows;         /* read whole samples only, in order: for what does not fit into memory */
    void (*release)(const void *from, size_t bytes);  /* or NULL; as batch.h has it, with by_rows */
    const double *rms;       /* S, of the channels where `scale` is not that; NULL: it is */
};

/* Root mean squares of the channels, 0 for a zero channel; *varies: some channel is not constant.
 * One pass; any finite scale. MODAL_BAD_INPUT names the first sample that is not finite. */
enum modal_status wide_scales(const struct wide *w, double *scale, bool *varies,
                              struct modal_error *err);

struct wide_options {
    struct pod_options pod;
    double tolerance;        /* relative residual of the triplets kept; 0: 1e-8 */
};

/*
 * Leading proper orthogonal modes as pod_reduce gives them, `signals` in scaled units.  Memory:
 * about S + L times some 100 numbers, and never a copy of the data.
 */
enum modal_status wide_pod(const struct wide *w, const struct wide_options *opt, struct pod *out,
                           struct modal_error *err);

/*
 * In order and unscaled, Q being L x k of leading dimension L:
 *
 *   wide_project     Z = Q^T A, k x S
 *   wide_rests       rest2[c] = |A_c - Q Z_c|^2, S of them, Z being k x S of leading dimension ld;
 *                    MODAL_NO_MEMORY
 */
void wide_project(const struct wide *w, const double *Q, int k, double *Z);
enum modal_status wide_rests(const struct wide *w, const double *Q, int k, const double *Z, int ld,
                             double *rest2, struct modal_error *err);

enum {
    WIDE_GRID_NUMBERS = 1 << 22,     /* read at most, where that leaves */
    WIDE_GRID_ROWS = 128             /* of each channel */
};

/*
 * The grid of each channel (grid.h), S of them, 0 where there is none; *any: there is one.  Seen in
 * up to WIDE_GRID_NUMBERS numbers, of the first rows and of others spread over the record; where
 * GRID_CHANNELS channels spread over all have none, no others are looked at: a converter or a
 * printed table rounds them alike. MODAL_NO_MEMORY.
 */
enum modal_status wide_grids(const struct wide *w, struct grid *grid, bool *any,
                             struct modal_error *err);

/* Rows up to the last in which some channel is STEPS steps or more from where it ends; L where a
 * channel has no fixed grid.  One pass, from the first row on. */
int wide_rows_above(const struct wide *w, const struct grid *grid, double steps);

/* Row k has been read, of a pass that reads row after row: give back what lies behind, now and
 * then. */
void wide_passed(const struct wide *w, int k);

/* Root mean square of channel c, unscaled; scale or rms is given. */
double wide_rms(const struct wide *w, int c);

/*
 * All channels at once at given poles, in one pass: one Gauss-Newton step from START with every
 * channel weighted by its own residual, which from an efficient start on a part of the data (the
 * proper orthogonal signals) is the efficient estimate on all of them.
 *
 *   lambda, std_re, std_im   COUNT each: the poles after the step, their standard deviations, 1/s
 *   coefficient              COUNT x S (j + c*COUNT), or NULL: of each channel, unscaled units, at
 *                            START: y = Re sum_j B_j e^{lambda_j t}, columns divided by their
 *                            largest magnitude as in synthesis.h
 *   rest                     S: root mean square of what START leaves of each channel, unscaled
 *                            units
 *   scale of `w` is needed, and it or rms is as wide_scales gives it.
 *   taken                    false: the step was longer than `most` standard errors and was not
 *                            taken (lambda is START)
 */
struct wide_step {
    double complex *lambda;
    double *std_re, *std_im;
    double complex *coefficient;
    double *rest;
    double length;           /* of the step in standard errors: |R_J delta| / s */
    bool taken;
};
/* *OUT from START, as above: no step longer than MOST standard errors is taken. */
enum modal_status wide_refine(const struct wide *w, double tau, const double complex *start,
                              int count, const bool *fixed, double most, struct wide_step *out,
                              struct modal_error *err);
#endif
