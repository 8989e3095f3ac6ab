/* estimate.h - the errors of a point: of its truncation, its sampling and its solver */
#ifndef MODAL_ESTIMATE_H
#define MODAL_ESTIMATE_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct balance;
struct steady;
struct steady_point;

/* Fill a converged point's estimates of error (done by steady_solve unless estimate_later). */
enum modal_status steady_estimate_point(struct steady *s, struct steady_point *point,
                                        struct modal_error *err);

/* The kept dofs' motion of a converged POINT carried on to H2 > point->H harmonics and corrected
 * for them (estimate.c, (1) and (2)): E[i (H2+1) + k], nearer the exact motion than the point is.
 * How far its first harmonics may be from where such corrections end into *LEFT, in the unit of x.
 * False in *DONE where the derivative is singular there, or one correction is larger than the
 * motion: they run away. */
enum modal_status steady_extend(struct steady *s, const struct steady_point *point, int H2,
                                double complex *E, double *left, bool *done,
                                struct modal_error *err);

/* The errors of POINT, which solves B of S, into it: NAN where its derivative is singular or a step
 * overflows. */
enum modal_status estimate_errors(struct steady *s, struct balance *b, struct steady_point *point,
                                  struct modal_error *err);
/* POINT of S by Newton's method on B from X, which becomes its last iterate, with its errors;
 * *FOUND false: it leads to none. */
enum modal_status estimate_near(struct steady *s, struct balance *b, double complex *X,
                                struct steady_point *point, bool *found, struct modal_error *err);
/* Of a POINT with rigid friction, converged: its harmonics extrapolated to none missing, and its
 * errors. */
enum modal_status estimate_sharpen(struct steady *s, struct balance *b, struct steady_point *point,
                                   struct modal_error *err);
#endif
