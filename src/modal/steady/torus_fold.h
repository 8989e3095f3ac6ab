/* torus_fold.h - tones that are small whole multiples of one frequency: their motion has one tone
 *
 * The phases of such tones hang together.  A balance over all phases asks for more: of a slider
 * that they leave at rest it may say that it moves, for at others it would, and a motion that is
 * unstable at some phases it misses at all.  With w_j = n_j w a combination k is harmonic
 *
 *     h = sum_j n_j k_j                                                                         (1)
 *
 * of w, which is all that the motion has; told again as the k of lowest order with that h.  Of
 * three tones two may be of that kind and the third not: then w and that third are two tones.
 */
#ifndef MODAL_TORUS_FOLD_H
#define MODAL_TORUS_FOLD_H
#include "modal/scene/program.h"
#include "modal/steady/torus_solve.h"

struct torus_fold {
    int count, number[TORUS_TONES_MOST];  /* of tones; n_j, 1 of a third that is none of w's */
    int into[TORUS_TONES_MOST];           /* which of the fold's tones j becomes: 0 is w */
    int tones;                            /* the fold's own */
    double omega[TORUS_TONES_MOST];       /* w, and the third, rad/s */
    struct program view;                  /* the program, its loads at combinations of these */
    struct torus_options opt;             /* with the start folded, too */
    struct torus_point start;
};

/* Whether COUNT tones OMEGA, or two of them, are w's multiples but for rounding, and with no common
 * divisor none above what a march has samples for: F's numbers and tones. */
bool torus_fold_finds(const double *omega, int count, struct torus_fold *f);
/* F's program and options, those of P and OPT; false: a load names more tones.  The start is
 * copied. */
enum modal_status torus_fold_make(struct torus_fold *f, const struct program *p,
                                  const struct torus_options *opt, struct modal_error *err);
/* OUT, solved as a motion of F's tones, told as one of tones OMEGA; of a part of w as one of as
 * large a part of one of these. */
enum modal_status torus_fold_undo(struct torus_fold *f, const double *omega,
                                  struct torus_point *out, struct modal_error *err);
void torus_fold_done(struct torus_fold *f);
#endif
