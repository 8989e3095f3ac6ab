/* record.h - the batch as identification works on it: checked, cut, scaled, in columns */
#ifndef MODAL_RECORD_H
#define MODAL_RECORD_H
#include "base/error.h"
#include "modal/batch.h"
#include "modal/identify/prepare/wide.h"
#include "modal/identify/prepare/wild.h"
#include "modal/identify/result.h"
#include "modal/linalg/matrix.h"

/*
 * Y is L x S: column s is one channel at equal steps, contiguous. What was cut from channel c of
 * the batch is scale[c] times column c; a zero channel has scale 0 and a zero column.
 */
struct record {
    struct matrix Y;            /* owned */
    double step;                /* s between rows */
    double dt;                  /* of the batch as sent */
    double t0;                  /* of row 0, s from the batch's first sample */
    double proposed[2];         /* s: where one free response begins and ends (event.h); both 0:
                                   with the rows that were asked for */
    bool parted;                /* Y is what was proposed */
    double period;              /* s; 0: none */
    int per_period;             /* period / step where that is an integer; 0: it is not, or there is
                                 * no period */
    int decimation;             /* step = decimation * dt */
    double shift_rad_s;         /* band: the demodulation frequency; 0: none */
    double leak;        /* band: rms that the stop band may let through, in a channel of unit rms */
    double gain;       /* variance of white noise after the filter over that before; 1: no filter */
    double share;               /* band: what white noise fills of the new Nyquist band, in power;
                                 * 0: no filter */
    int *channel; int channels; /* owned: indices into the batch */
    double *scale;              /* owned, per channel: rms of what was cut, or the largest */
    double *rms;                /* owned, per channel: where a wide record has a common scale */
    bool *below;    /* owned, per channel: nothing but rounding, made a zero channel (rounding.h) */
    struct wild stuck;          /* that were mended before all else (stuck.h), rows a dt apart;
                                 * `sent` in the batch's unit */
    bool wide;                  /* too large to copy: Y has its sizes but no x, the batch is read
                                 * where it lies through: */
    struct wide view;
};

/* A batch is left where it lies from this many samples times channels on, where nothing is asked
 * that needs a copy. */
enum {
    RECORD_WIDE_CHANNELS = 256,         /* fewer are no work beside their samples */
    RECORD_WIDE_ENTRIES = 1 << 22       /* 32 MB, what a last cache holds */
};

/* Of many channels so many are asked what all of them show: a strike, a stop, motion without
 * end. */
enum { RECORD_FEW = 4 };

/* Rows from which on a record of free responses whose beginning is none is that response alone,
 * unless a window is named: a search for modes in all of it has no end, and costs seconds. */
enum { RECORD_PARTED = 32768 };

/* Seconds between samples that are taken: exponents of 1/dt and their squares stay finite. */
#define RECORD_STEP_MOST 1e100

/* BATCH, borrowed, as OPT asks for it; MODAL_BAD_INPUT names what is wrong with either. */
enum modal_status record_make(const struct batch *batch, const struct identify_options *opt,
                              struct record *out, struct modal_error *err);
/* Keep the first ROWS rows, scaled anew. */
enum modal_status record_cut(struct record *r, int rows, enum identify_scale how,
                             struct modal_error *err);
/* Lagrange's weights W for a point AT among the nodes 0 .. COUNT-1; of a node exactly its own. */
void record_lagrange(double at, int count, double *w);
/* Root mean square of channel c of a wide record, over its scale. */
double record_wide_size(const struct record *r, int c);
void record_done(struct record *r);
#endif
