/* arrays.h - a file of named arrays (NPY, NPZ, MATLAB, HDF5): which are the signals, which the step
 *
 * The signals are the array that --dataset names, else `signals`, else the only matrix of numbers
 * beside those that say the step: `dt` [s], `fs` or `Fs` [Hz], `time` or `t` [s], a time a sample.
 * In HDF5 these say their unit by an attribute `units`.  Where none of them is, a vector with a
 * value a sample that grows and is named as times with a unit (`t_s`, `time_ms`) says it: beside a
 * `dt` it may be a temperature.
 * These stand in the folder of the signals, or at the top.  Rows are samples; an array of one row,
 * or one that has a column for each time, is turned.
 */
#ifndef CTL_FILES_ARRAYS_H
#define CTL_FILES_ARRAYS_H
#include "bytes.h"
#include "ctl/signals.h"

enum { ARRAYS_MOST = 10000 };       /* in one file */

struct array {
    char *name;
    const char *type;               /* what is in it, for lists: "double", "struct" */
    bool numbers;                   /* a scalar, a vector or a matrix of real numbers */
    size_t rows, columns;
    bool by_columns;                /* as it lies: column behind column */
    bool single;                    /* of 24 bits */
    const char *unit;               /* that it says of itself, of a time or rate; NULL: none */
    struct number_type kind;        /* the reader's own: how, where and how long it lies */
    size_t at, length, inner;
};

struct arrays {
    const char *path;
    const void *from;               /* the reader's own */
    /* rows * columns numbers of ARRAY, as they lie, INTO */
    enum modal_status (*load)(const struct arrays *arrays, const struct array *array,
                              struct numbers *into, struct modal_error *err);
    struct array *list;
    size_t count, room;
};

/* One more, whose NAME of LENGTH bytes is copied; NULL: no memory, or ARRAYS_MOST. */
struct array *arrays_add(struct arrays *arrays, const char *name, size_t length);
void arrays_done(struct arrays *arrays);

/* The signals among ARRAYS: MODAL_BAD_INPUT, field "dataset", lists what there is. */
enum modal_status arrays_pick(const struct arrays *arrays, const char *dataset,
                              const struct array **out, struct modal_error *err);

/* The step of the signals ARRAY into OUT, where there is one, and whether they are to be turned.
 * MODAL_BAD_INPUT: it is no positive number, uneven, or said twice, not the same. */
enum modal_status arrays_step(const struct arrays *arrays, const struct array *array,
                              const struct signals_options *options, struct signals *out,
                              bool *turned, struct modal_error *err);

/* Both, and the numbers. */
enum modal_status arrays_read(const struct arrays *arrays, const struct signals_options *options,
                              struct signals *out, struct modal_error *err);

/* X, which lies as ROWS of COLUMNS, as COLUMNS of ROWS: in a new place, the old one is freed, where
 * these are not the same. */
enum modal_status arrays_turn(double **x, size_t rows, size_t columns, struct modal_error *err);
#endif
