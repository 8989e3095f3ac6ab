/* torus_lines.h - the lines of a record: combinations of tones, by weighed least squares */
#ifndef MODAL_TORUS_LINES_H
#define MODAL_TORUS_LINES_H
#include "modal/linalg/workspace.h"
#include "modal/steady/torus_state.h"

enum {
    TORUS_SHEET_NODES = 64,           /* of the sum that V is: W and cos(pi B u) are smooth */
    TORUS_SHEET_ORDERS = 1024,        /* beyond all that a record tells */
    TORUS_SHEET_MOST = 20000000,      /* numbers of a record: 160 MB */
};

/* A record and what its lines are told by.  Its outputs are the dofs that iterate, then those
 * reported that do not. */
struct torus_sheet {
    struct torus_solver *s;
    struct workspace space;
    int N, turns, outputs, *dofs;
    bool *reported;                       /* of each output */
    double *x0, *v0;                      /* by dof: where the march begins */
    double wanted, tolerance, bins;       /* of the amplitude; of a step; B */
    double apart;                         /* rad/s: nearer combinations are one line */
    double node[TORUS_SHEET_NODES];                   /* W at 0 < u < 1, of sum 1 */
    int others[TORUS_TONES_MOST - 1];     /* the tones but the lead; -1: none */
    int highest, rows;                    /* most of |k_j|; sets of them, told once each: an s of
                                           * (1) a row */
    double start;                         /* s: of its first sample, whole turns */
    double a_turn;                        /* what one was seen to cost, in budget.h's units */
    double *x, *left, *window;            /* [sample][output], the caller's or A's; what no line
                                           * explains; W */
    double *weighed, *wave, *sum;         /* of torus_lines.c: W x, waves, their sums */
    double last;                          /* m: what the last lines below N / 2 sum to */
    int count;
    struct torus_index *index;            /* lines told, the mean first, by rising order */
    double complex *X;                    /* [output count + m] */
    double nearest[TORUS_SHEET_ORDERS];   /* of each order's combinations that have no line: to one
                                           * that has, in turns of the record; APART: all have */
};

/* A, its outputs known, for N samples, a power of two, of each of TURNS turns from A's start, and
 * an error of WANTED; false: more than TORUS_SHEET_MOST. */
bool torus_sheet_lay(struct torus_sheet *a, int N, int turns, double wanted);
/* What reading it costs, in budget.h's units. */
double torus_sheet_work(const struct torus_sheet *a);
/* The arrays of a record, in A's space: x, unless there is one, is the caller's to fill.
 * MODAL_NO_MEMORY. */
enum modal_status torus_sheet_room(struct torus_sheet *a, struct modal_error *err);
/* The lines of x, and their errors into *E; AMPLITUDE: the reported outputs'.  MODAL_NO_MEMORY. */
enum modal_status torus_sheet_read(struct torus_sheet *a, struct torus_errors *e,
                                   double *amplitude, struct modal_error *err);
#endif
