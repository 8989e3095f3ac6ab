/* offset.h - where sliders that stick for good are put: at zero, or as near to it as their strength
 * allows
 *
 * A body that rigid friction holds all period long may be held anywhere near: with it moved by a
 * constant, and the structure by what follows statically, every velocity stays, and so does every
 * force but those that hold.  Which of these motions a history ends in says nothing about the
 * system; the one with its slider at zero is the one to give. */
#ifndef MODAL_OFFSET_H
#define MODAL_OFFSET_H
#include <stdbool.h>
#include "base/error.h"

struct ports;
struct statespace;

enum { OFFSET_LAWS_MOST = 60 };   /* as many as a motion followed has dofs (CYCLE_STATES_MOST) */

struct offset_motion {
    int samples;                  /* of one period, equally spaced */
    double *x;                    /* of dof i at x[i * samples + j] */
    double *force;                /* of law l at force[l * samples + j] */
    bool *still;                  /* per law, out: it stays where it is */
};

/*
 * The periodic MOTION under rigid friction alone and constant matrices, its still sliders moved
 * towards zero while none of them holds with more than its limit.  Left alone where nothing fixes
 * the structure.  Fails with MODAL_NO_MEMORY.
 */
enum modal_status offset_remove(const struct statespace *ss, const struct ports *ports,
                                struct offset_motion *motion, struct modal_error *err);
#endif
