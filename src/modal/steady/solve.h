/* solve.h - one steady state of a program: the method chosen, tried, and its errors estimated
 *
 * Of a program (program.h), M x'' + C x' + K x + sum_l B_l f_l = p(t), p of period 2 pi / omega,
 * the motion
 *
 *     x(t) = Re sum_{k=0..H} X_k e^{i k omega t},   X_0 real,                                   (1)
 *
 * that balances harmonics 0 .. H of it, [CG89] (4).  A session serves many frequencies and starts
 * of one program: it keeps what they share, the linear part (condense.h) and a balance for each
 * order.  What it answers at a frequency is a point (point.h), with errors (estimate.h).
 *
 * [CG89] Cameron and Griffin, J. Appl. Mech. 56 (1989) 149-154. */
#ifndef MODAL_SOLVE_H
#define MODAL_SOLVE_H
#include "modal/steady/point.h"

/* What BEFORE, a session of another program that is freed next, knows of the linear part becomes
 * S's where that is the same (condense_inherit). */
void steady_inherit(struct steady *s, struct steady *before);

/* P is borrowed until steady_free.  Fails with MODAL_BAD_INPUT (steady.harmonics, steady.samples,
 * excitation), MODAL_TOO_LARGE, MODAL_NO_MEMORY. */
enum modal_status steady_new(const struct program *p, const struct steady_options *opt,
                             struct steady **out, struct modal_error *err);
/* Frees S and all that it made; points are done with before.  NULL is none. */
void steady_free(struct steady *s);

/*
 * Solve at OMEGA from START (NULL: from rest).  No convergence is an answer: MODAL_OK with
 * point->converged false, the best iterate and a reason.  steady_point_done frees what POINT holds.
 */
enum modal_status steady_solve(struct steady *s, double omega, const struct steady_start *start,
                               struct steady_point *point, struct modal_error *err);

/* The work of one answer is one budget: what steady_solve has left is what a search that sets out
 * from its answer may spend, by steady_solve_attractor, steady_follow_attractor, steady_refine and
 * steady_solve_all with KNOWN; verdicts (stability.h) count, and what they cost is
 * allowed beside it, up to as much again of all of them.  A motion that has closed in time is
 * carried to its answer by as much beside as by_cycle.c has. */
const struct budget *steady_work(const struct steady *s);

/*
 * Every solution found at OMEGA: along the level of the loads and from many starts; points,
 * *COUNT of them, the caller's.
 * KNOWN, of this session at OMEGA and converged, is one of them; NULL: steady_solve finds the
 * first, from START.
 */
enum modal_status steady_solve_all(struct steady *s, double omega, const struct steady_start *start,
                                   const struct steady_point *known, struct steady_point **points,
                                       int *count,
                                   struct modal_error *err);

/*
 * The motion of S from rest that attracts, if time integration comes near it (settle.h), into
 * POINT, at the omega and the order of LIKE; *FOUND false: none, and POINT is empty.  Fails as
 * steady_solve.
 */
enum modal_status steady_solve_attractor(struct steady *s, const struct steady_point *like,
                                         struct steady_point *point, bool *found,
                                         struct modal_error *err);

/* What time integration came near just before by steady_solve_attractor, followed to its end in
 * time, with its own multipliers: where no balance, or one that is unstable, came of it, the series
 * is off and not the motion.  time_forget ends it.  *FOUND, POINT and failures as there. */
enum modal_status steady_follow_attractor(struct steady *s, double omega,
                                          struct steady_point *point, bool *found,
                                          struct modal_error *err);

/* POINT, converged with default harmonics and an error above the target, is carried on from near
 * with more of them, as far as the budget reaches; it stays as it is where that fails or makes
 * its error no smaller, and is `wanting` where the budget does not reach.  Its
 * other dofs can be recovered then, those of points with other harmonics not. */
enum modal_status steady_refine(struct steady *s, struct steady_point *point,
                                struct modal_error *err);
#endif
