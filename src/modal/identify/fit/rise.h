/* rise.h - what the sum of squares rises by without one pole of a set, from the set's triangle */
#ifndef MODAL_RISE_H
#define MODAL_RISE_H
#include <complex.h>
#include "modal/identify/fit/refine.h"

/*
 * With Phi = Q R and Z = Q^T Y the amplitudes of channel c are C = R^{-1} Z_c, and without the
 * columns J of a pole, all others fitted anew, the sum of squares rises by
 *
 *     C_J^T (B B^T)^{-1} C_J,   B = rows J of R^{-1},                              (1)
 *
 * since B B^T is block J of (Phi^T Phi)^{-1}.  All of them come from one inverse of a triangle.
 *
 *   p      not degenerate, its order that of LAMBDA (COUNT poles, columns in their order)
 *   ld     leading dimension of p->R and p->Z
 *   room   ld x (p->order + p->columns) numbers of the caller's, overwritten
 *   rise   groups x COUNT: (1) in each signal
 *
 * False where the triangle is singular: *rise means nothing then.
 */
bool rise_without(const struct projected *p, int ld, const double complex *lambda, int count,
                  double tau, double *room, double *rise);
#endif
