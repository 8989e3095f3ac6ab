/* track.h - the modes of successive windows of a stream: which is which over time */
#ifndef MODAL_TRACK_H
#define MODAL_TRACK_H
#include <complex.h>
#include <stdbool.h>
#include <stdint.h>
#include "base/error.h"

enum {
    TRACKS_MOST = 256,        /* followed: more than any window of 1 MiB tells */
    TRACK_SHAPE = 8,          /* numbers kept of a shape */
};

/* A mode as a window shows it. */
struct track_mode {
    double complex exponent;                /* 1/s, Im >= 0 */
    double std_re, std_im;                  /* NAN: unknown */
    double complex shape[TRACK_SHAPE];      /* by track_shape; all 0: not known */
};

/* Covariance of a number and its slope. */
struct track_error { double value, both, slope; };

/* A way that a mode may go on, with its own history. */
struct track_way {
    double complex exponent, slope;         /* at sample `last`; 1/s, 1/s^2 */
    struct track_error re, im;
    double freedom, misfit;                 /* of what came against what was foreseen: (4) */
};

struct track {
    int64_t number;                         /* 0, 1, .. in the order of their beginning */
    struct track_way line;                  /* it goes on as it went */
    struct track_way still;                 /* it stays where the likelier of the two had it */
    double stays;                           /* how likely it does */
    double shown, asked;                    /* windows, fading: (5) */
    double complex shape[TRACK_SHAPE];
    double shape_freedom, shape_misfit;     /* (6) */
    uint64_t since, last;                   /* ends of windows: the first that showed it without a
                                               miss since, and the last that did */
    int missed;                             /* windows since `last` */
    bool counts, native, died;
};

/* What is known of a stream; all zero: nothing. */
struct tracks {
    int64_t next;                           /* number */
    uint64_t epoch, first_to, to;
    bool begun;
    double born, windows;                   /* fading: (5) */
    struct track track[TRACKS_MOST]; int count;
};

/* Samples FROM to TO of an epoch, `dt` seconds apart. */
struct track_window { uint64_t epoch, from, to; double dt; };

enum track_state { TRACK_BORN, TRACK_DIED, TRACK_BACK };
/* "born", "died", "back" */
extern const char *const track_states[];
struct track_edge { int64_t number; enum track_state state; double complex exponent; };

/* The numbers that are kept of a shape of COUNT channels, of unit norm: the shape itself, or where
 * it has more channels sums of it with fixed signs.  Shapes that are one but for a factor stay so.
 */
void track_shape(const double complex *shape, int count, double complex out[TRACK_SHAPE]);

/*
 * A window showed MODES (COUNT, at most TRACKS_MOST): each gets the number of its track, an old one
 * or one that begins, no two the same.
 *
 *   number   COUNT
 *   edges    room for 2 TRACKS_MOST; *EDGE_COUNT of them.  A track is born once every window has
 *            shown it for as long as a window is, unless it was there from the epoch's first window
 *            on; it has died when two windows, and all of a window's length, have not shown it, or
 *            one in which the mode of another track may be its own, and is back when one does.
 *
 * Another epoch, or a window that does not end behind the last one, begins anew; numbers go on.
 * Fails with MODAL_BAD_INPUT (too many modes, an exponent that is none) and MODAL_NO_MEMORY, and
 * leaves *T as it was.
 */
enum modal_status tracks_follow(struct tracks *t, const struct track_window *w,
                                const struct track_mode *modes, int count, int64_t *number,
                                struct track_edge *edges, int *edge_count, struct modal_error *err);
#endif
