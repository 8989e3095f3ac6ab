/* ambient_wander.h - modes of a turning system whose speed wanders (see ambient_wander.c) */
#ifndef MODAL_AMBIENT_WANDER_H
#define MODAL_AMBIENT_WANDER_H
#include "modal/identify/ambient/whittle.h"

/* What is fitted to: Z, a row a turn, of signals of unit variance; longer[m]: the length of turn m
 * over the mean one, less 1. */
struct ambient_wander {
    const struct matrix *Z;
    const double *longer;
    int phases;                      /* rows of the record a turn: no mode moves faster */
    double price;                    /* of a pair, in the logarithm of the likelihood */
    bool fixed;                      /* as many pairs as there are, whatever they are worth */
    bool (*cancelled)(void *context);
    void *context;
};

/*
 * *M, a model of turns that are all alike, becomes that of the mean turn, with its errors, the
 * exponents as whittle_exponent() takes them; pairs that drew what the lengths explain leave.
 * Without convergence m->converged is false.  meet[k][j]: turns of the record differ by so much
 * that a multiplier of pair k meets one of pair j, or its own conjugate where j is k, and the
 * record tells that; the errors of both are wrong then.  Fails with MODAL_NO_MEMORY,
 * MODAL_CANCELLED.
 */
enum modal_status ambient_wander_fit(const struct ambient_wander *in, struct whittle *m,
                                     bool meet[WHITTLE_MODES_MOST][WHITTLE_MODES_MOST],
                                     struct modal_error *err);
#endif
