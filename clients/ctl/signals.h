/* signals.h - a user's file of signals, read here, on the user's side
 *
 * What a file is, is told by its first bytes, not by its name: HDF5 (with it MATLAB 7.3), MATLAB 5
 * to 7, NPY, NPZ, UFF 58 and 58b, OpenFAST's .outb, sound (WAV, FLAC); else it is text, CSV or
 * OpenFAST's .out.  Each has a reader of its own in files/.
 */
#ifndef CTL_SIGNALS_H
#define CTL_SIGNALS_H
#include <stdbool.h>
#include "modal/batch.h"
#include "base/error.h"
#include "base/json.h"
#include "store/mapping.h"

/* The kinds, for messages. */
#define SIGNALS_FILES "HDF5, MATLAB, NPY, NPZ, UFF 58, OpenFAST, CSV, WAV, FLAC"

/* Limits of a file read here. */
#define SIGNALS_VALUES_MOST ((size_t)1 << 31)      /* doubles: 16 GB */
enum { SIGNALS_CHANNELS_MOST = 65536 };            /* columns that a line of text can have */

/* Two steps are the same within this part of them, where both are binary numbers. */
#define SIGNALS_DT_OFF 1e-9

struct signals {
    size_t samples, channels;
    double *x;                  /* sample k of channel s: x[k * channels + s]; NULL where they are
                                   mapped */
    struct mapping map;
    double dt, period;          /* s; 0: the file did not say */
    double dt_off;              /* s: what the digits that say dt leave open */
    const char *dt_from;        /* what says it: "its column of time" */
    char **names;               /* channels, or NULL */
    char *units;                /* or NULL */
    size_t preamble;            /* lines of text passed over before names or numbers */
    bool open_end;              /* text whose last line has no end: it may be cut */
    cJSON *attributes;          /* anything else that the file says: provenance; or NULL */
};

struct signals_options {
    const char *dataset;        /* which array, of files that have several; NULL: see arrays.h */
    double dt;                  /* 0: from the file; else the file must not say another */
    bool ignore_time;           /* whatever it says: rows are even, dt apart */
    double scale;               /* 0: 1 */
    bool map;                   /* signals beyond the memory limit may be mapped: no scale */
};

/*
 * Read PATH ("-": stdin, not for HDF5 and sound) into *OUT; signals_done frees what it holds.
 * MODAL_BAD_INPUT: no such file, not one of the kinds, damaged, cut short, not numbers, uneven time
 * (with its deviation), another dt than the one given (field "dt"), several arrays and none named
 * (field "dataset").  What a batch must be beyond that (length, dt, finite values) is identify's to
 * check.
 */
enum modal_status signals_read(const char *path, const struct signals_options *options,
                               struct signals *out, struct modal_error *err);
void signals_done(struct signals *signals);

/* As signals_read of a file that begins with TEXT, which is changed; *SHAPE for csv_row to read
 * what follows. */
struct csv_shape;
enum modal_status signals_read_rows(char *text, const char *path,
                                    const struct signals_options *options, struct signals *out,
                                    struct csv_shape *shape, struct modal_error *err);

/* A view: borrows everything from SIGNALS. */
struct batch signals_batch(const struct signals *signals);

/* A text file whole, but for a byte order mark, with a 0 behind it; the caller frees it.
 * MODAL_BAD_INPUT if it cannot be read, MODAL_TOO_LARGE. */
enum modal_status signals_read_text(const char *path, size_t most, char **text, size_t *length,
                                    struct modal_error *err);
/* MODAL_BAD_INPUT, FIELD, where such a text begins with the mark of UTF-16; ACCEPTED is what may be
 * there instead. */
enum modal_status signals_check_text(const char *text, size_t length, const char *path,
                                     const char *field, const char *accepted,
                                     struct modal_error *err);

#endif
