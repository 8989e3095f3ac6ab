/* ways.h - the ways into one balance: where Newton's method starts from, one after another until
 * one converges */
#ifndef MODAL_WAYS_H
#define MODAL_WAYS_H
#include <complex.h>
#include "base/error.h"

struct balance;
struct steady;
struct steady_point;
struct steady_start;

/*
 * X of balance B, not yet set to OMEGA, from START, or from rest (NULL): to many harmonics the way
 * is gone with few, roughly, then with three times as many, as long as that is far fewer.  POINT
 * counts the iterations.  Fails with MODAL_NO_MEMORY, as balance_set does, or MODAL_CANCELLED.
 */
enum modal_status ways_begin(struct steady *s, const struct balance *b, double omega,
                             const struct steady_start *start, double complex *X,
                             struct steady_point *point, struct modal_error *err);

/*
 * Every way in turn from X, which ways_begin has filled from START, until one converges: POINT has
 * the best iterate, its method, and the reason where none did.  X is scratch afterwards.  Fails
 * with MODAL_NO_MEMORY, as balance_set does, or MODAL_CANCELLED.
 */
enum modal_status ways_try(struct steady *s, struct balance *b, const struct steady_start *start,
                           double complex *X, struct steady_point *point, struct modal_error *err);
#endif
