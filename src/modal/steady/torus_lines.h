/* torus_lines.h - the lines of a record: combinations of tones, by least squares */
#ifndef MODAL_TORUS_LINES_H
#define MODAL_TORUS_LINES_H
#include "modal/linalg/workspace.h"
#include "modal/steady/torus_state.h"

enum {
    TORUS_SHEET_ORDERS = 1024,        /* beyond all that a record tells */
    TORUS_SHEET_MOST = 20000000,      /* numbers of a record: 160 MB */
    TORUS_TURNS_MOST = 4096,          /* of a record: tones one in 2700 apart are told */
    TORUS_TURNS_A_ROW = 3,            /* two columns a row: as many as two thirds of the turns, so
                                       * that what is left is a measure of what they miss */
    TORUS_KINDS = 2,                  /* of its columns: cosines and sines */
};

/* A row: its place, whole turns of s and the rest, and its column of each kind; -1: none. */
struct torus_row { int row, whole, at[TORUS_KINDS]; double s; bool real; };

/* A record and what its lines are told by.  Its outputs are the dofs that iterate, then those
 * reported that do not. */
struct torus_sheet {
    struct torus_solver *s;
    struct workspace space;
    int N, turns, outputs, *dofs;
    bool settled;                         /* nothing is in it but lines and rounding */
    bool *reported;                       /* of each output */
    double *x0, *v0;                      /* by dof: where the march begins */
    double wanted, tolerance;             /* of the amplitude; of a step */
    double apart;                         /* rad/s: nearer combinations are one line */
    int others[TORUS_TONES_MOST - 1];     /* the tones but the lead; -1: none */
    bool idle[TORUS_TONES_MOST];          /* tones that no load has: lines of others come first */
    int highest, rows;                    /* most of |k_j|; sets of them, each with all its leads */
    double start;                         /* s: of its first sample, whole turns */
    double a_turn;                        /* what one was seen to cost, in budget.h's units */
    double *x, *left;                     /* [sample][output], the caller's or A's; what no line
                                           * explains */
    struct torus_row *row;                /* of torus_lines.c: rows told, and their columns of */
    int told, columns[TORUS_KINDS];       /* cosines and of sines */
    double *wave, *sum;                   /* of each kind [column][turn]; [column][m][output] */
    double complex *Y, *z;                /* lines of rows, [row][output][lead]; a turn's room */
    double *mean;                         /* of columns' products, of one other tone */
    double last;                          /* m: what the last lines below N / 2 sum to */
    int count;
    struct torus_index *index;            /* lines told, the mean first, by rising order */
    double complex *X;                    /* [output count + m] */
    double nearest[TORUS_SHEET_ORDERS];   /* of each order's rows that are not told: the root of
                                           * what is in no other, the least, or 0: they may hide
                                           * each other; 1: all are told */
    int beats;                            /* the least order of one whose beat with a line told no
                                           * record sees, so that what lines move by says nothing
                                           * of it */
};

/* ---- torus_sheet.c ---- */

/* A, its outputs known, for N samples of each of TURNS turns, both powers of two, from A's start,
 * and an error of WANTED; false: more than TORUS_SHEET_MOST. */
bool torus_sheet_lay(struct torus_sheet *a, int N, int turns, double wanted);
/* What reading it costs, in budget.h's units. */
double torus_sheet_work(const struct torus_sheet *a);
/* The arrays of a record, in A's space: x, unless there is one, is the caller's to fill.
 * MODAL_NO_MEMORY. */
enum modal_status torus_sheet_room(struct torus_sheet *a, struct modal_error *err);

/* ---- torus_lines.c ---- */

/* rad/s: combinations nearer than that are one line of a record of TURNS, SETTLED as above. */
double torus_sheet_apart(const struct torus_tones *t, int turns, bool settled);
/* The lines of x, and their errors into *E; AMPLITUDE: the reported outputs'.  MODAL_NO_MEMORY. */
enum modal_status torus_sheet_read(struct torus_sheet *a, struct torus_errors *e,
                                   double *amplitude, struct modal_error *err);
#endif
