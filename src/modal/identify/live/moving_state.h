/* moving_state.h - what the files of moving.c share: samples and blocks, one window at work, why an
 * update is no answer */
#ifndef MODAL_MOVING_STATE_H
#define MODAL_MOVING_STATE_H
#include <complex.h>
#include <fftw3.h>
#include <stdbool.h>
#include "modal/identify/fit/colour.h"
#include "modal/identify/live/moving.h"
#include "modal/identify/live/moving_fit.h"
#include "modal/linalg/window_qr.h"
#include "modal/linalg/workspace.h"

/* Words of moving.c; GOOD: the update is the answer. */
enum reason {
    FIRST,
    OPTIONS,
    NOT_SETTLED,
    ORDER_LESS,
    ORDER_MORE,
    POLE_SPLITS,
    OFFSET,
    UNDETERMINED,
    NOT_WHITE,
    BY_NOISE,
    PARTS,
    WEAK_MODE,
    GRID,
    GOOD
};

/* k x S; norms of its columns, and of what Q does not hold of them: in one piece with C */
struct block { double *C, *norm, *left; };

/* S x count: proper orthogonal modes that were fitted */
struct kept_modes { double *V; int count; };

struct poles_of { double complex *lambda; int count; };

struct moving {
    struct moving_options opt;
    int S, L;
    double *rows; size_t held, room;    /* the last samples, row-major; the newest ends at `held` */
    uint64_t next;                               /* samples so far */

    bool possible;                               /* the options are those of an update */
    bool periodic;                               /* the next window begins at `own`, in periods */
    bool anchored;
    int reason;                                  /* where there is no anchor: why not */
    struct poles_of own, first;                  /* of the last result; before channels were weighed
                                                  * by their noise (count 0: they were not) */
    struct poles_of anchor;
    struct kept_modes kept[2];                   /* of the window before; of weighed channels */
    int B, k;
    double *Q, *table;                           /* table: moving_columns.h, of the anchor */
    struct block *blocks; int count, blocks_room;     /* oldest first */
    uint64_t block_from;                         /* index of the oldest block's first sample */
    struct window_qr *all;                       /* triangle of the blocks' samples, where signals
                                                  * are reduced; else NULL */

    fftw_plan plan[3];                           /* L, L/4, L/16 */
    double *x; fftw_complex *X;
    uint64_t updates, batches;
};

/* What the fits of one window work on. */
struct job {
    struct moving *m;
    struct moving_rows rows;
    struct matrix Y;              /* rows x S: compressed samples of the channels, as they are */
    double *R;                    /* S x S: triangle of all rows, where signals are reduced */
    double *left;                 /* S: norms of what Q does not hold of the channels */
    double *scale;                /* rms of each channel; 0: a zero channel */
    double *weight;         /* of each channel beside 1/scale: 1, or the least noise over its own */
    bool weighed;
    double *W; int r;             /* S x r: signals = samples W */
    double *outside2;
    struct matrix X, full;        /* rows x r; samples W, L x r */
    /* autocorrelations of an orthonormal basis of the window's columns, added */
    double lags[COLOUR_LAGS]; bool lags_known;
    struct moving_fit first, own, channels;      /* on signals as sent, weighed; own poles on the
                                                  * channels, where they are not the signals */
    double *Phi;                  /* rows x order: columns of own's poles; NULL: not made yet */
    double work;
    enum growth *growth;          /* of each of own's poles */
    bool exact;                   /* what is left is rounding */
    struct workspace space;       /* of R, W and the channels' numbers */
};

/* ---- moving_blocks.c ---- */

/* Poles copied; false where there is no memory. */
bool poles_take(struct poles_of *to, const double complex *lambda, int count);

/* Sample number I (of all), which must be held. */
const double *moving_sample(const struct moving *m, uint64_t i);

/* The basis Q at poles P, and all blocks of the window anew.  Fails with MODAL_NO_MEMORY. */
enum modal_status anchor_set(struct moving *m, const struct poles_of *p, struct modal_error *err);
void anchor_forget(struct moving *m);

/* Do the poles still lie where the anchor's span holds them? */
bool anchor_is_near(const struct moving *m, const struct moving_fit *f);

/* ---- moving_signals.c ---- */

/* The window's rows, compressed, and their triangles.  JOB is freed with job_done, on failure too.
 * */
enum modal_status job_take(struct job *j, struct modal_error *err);
void job_done(struct job *j);

/* Are the signals proper orthogonal modes of many channels? */
bool moving_reduced(const struct moving *m);

/* X = Y W: proper orthogonal modes, or the channels to unit rms. */
enum modal_status job_signals(struct job *j, bool modes, struct modal_error *err);

/* The channels to unit rms, whatever J's signals are: X, rows x S, and OUTSIDE2, S. */
void job_channels(const struct job *j, struct matrix *X, double *outside2);

/* j->Phi at the poles of F, which are own's. */
enum modal_status job_basis(struct job *j, const struct moving_fit *f, struct modal_error *err);

/* ---- moving_judge.c ---- */

/* Whether the fit says that a batch would choose other poles. */
enum reason judge_fit(const struct job *j, const struct moving_fit *f);

/* *why, POLE_SPLITS so far, is GOOD where all but rounding is explained and no pole as two
 * neighbours fits so well that order.c would refine them. */
enum modal_status judge_split(struct job *j, const struct moving_fit *f, enum reason *why,
                              struct modal_error *err);

/* Whether what it leaves says so; j->growth is filled. */
enum modal_status judge_residual(struct job *j, struct moving_fit *f, enum reason *why,
                                 struct modal_error *err);

/* ---- moving_report.c ---- */

/* *OUT: what the fits of J say, as modal_identify() would have it of the window. */
enum modal_status moving_report(struct job *j, struct identify_result *out,
                                struct modal_error *err);
#endif
