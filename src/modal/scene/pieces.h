/* pieces.h - the exact force of a law over one period, cut where its regime changes
 *
 * On the piece from <= theta < to, output i of a law of inputs d_j with rates v_j (per second) is
 *
 *     f_i = level + sum_j gain_j d_j(theta) + damp v_0(theta) + cross d_0(theta) v_0(theta)     (1)
 *
 * and `level` itself depends on the motion, through where a slider was left, as
 *
 *     delta level = sum_j ref_j delta d_j(at).                                                  (2)
 *
 * f is continuous from piece to piece, so that moving an event changes f's harmonics to second
 * order only; except at events of rigid friction, where f jumps by `jump` = f(from+) - f(from-) and
 *
 *     delta from = -delta v(from) / v'(from):  `slope` = d v / d theta there, per radian.       (3)
 */
#ifndef MODAL_PIECES_H
#define MODAL_PIECES_H
#include <stdbool.h>
#include "modal/scene/law.h"

struct law_piece {
    int output;  /* which f_i */
    double from, to;                 /* radians; to > from */
    double level, gain[LAW_PIECE_INPUTS], damp, cross;
    int slider;                      /* of the law's sliders, whose piece this is; -1: none's */
    bool holds;                      /* a slider stuck: (2) applies, else ref is 0 */
    /* `at` is this piece's own `from` (a slider just come to rest) */
    bool starts;
    double at, ref[LAW_PIECE_INPUTS];
    double jump, slope;              /* (3); jump 0: continuous */
};

struct law_pieces {
    int count, room;  /* pieces; places */
    struct law_piece *piece;
    bool acts;                       /* slipped, touched or parted somewhere in the period */
    /* a slider never slips: its place, and so the mean, follows from history alone; the one nearest
     * 0 is taken */
    bool undetermined;
};

/* No pieces; the room is kept for the next period. */
void pieces_clear(struct law_pieces *p);
/* The room too. */
void pieces_done(struct law_pieces *p);
/* A copy of PIECE at the end.  Fails with MODAL_NO_MEMORY. */
enum modal_status pieces_add(struct law_pieces *p, const struct law_piece *piece,
                             struct modal_error *err);

#endif
