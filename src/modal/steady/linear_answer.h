/* linear_answer.h - the steady state of a program without laws */
#ifndef MODAL_LINEAR_ANSWER_H
#define MODAL_LINEAR_ANSWER_H
#include "base/error.h"

struct steady;
struct steady_point;

/*
 * POINT of S, which has no laws, at OMEGA rad/s, with its residual, or its errors where matrices
 * are periodic: not converged where the equations are singular (`reason`).  Fails with
 * MODAL_NO_MEMORY, as balance_set does, or MODAL_CANCELLED.
 */
enum modal_status linear_answer(struct steady *s, double omega, struct steady_point *point,
                                struct modal_error *err);
#endif
