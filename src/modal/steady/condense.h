/* condense.h - the linear part of a program, harmonic by harmonic, on the dofs that iterate
 *
 * With x = Re sum_k X_k e^{i k omega t} and s = k omega, the constant part of a program is Lambda_k
 * X_k = P_k,
 *
 *     Lambda_k = K - s^2 M + i s C - F (i s E - A)^-1 (Bx + i s Bv - s^2 Ba).                   (1)
 *
 * Dofs are `kept` (those of laws and of periodic matrices) or linear; the linear ones are
 * eliminated exactly:
 *
 *     S_k = L_qq - L_qr L_rr^-1 L_rq,   p_k = P_q - L_qr L_rr^-1 P_r.                           (2)
 *
 * S_k stays regular where Lambda_k is singular (an undamped resonance): only the kept dofs held
 * fast must not resonate. */
#ifndef MODAL_STEADY_CONDENSE_H
#define MODAL_STEADY_CONDENSE_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct pattern;
struct program;

struct condense;

/* The dofs of laws and of periodic matrices; 0 too where there is no memory to count them. */
int condense_nonlinear(const struct program *p);

/* Which dofs are kept: those of laws and periodic matrices; every dof; every dof, with the
 * program's own structure. */
enum condense_keep { CONDENSE_LINEAR, CONDENSE_NONE, CONDENSE_SPARSE };

/*
 * Of P (borrowed); CONDENSE_SPARSE asks that it has no linear states, and of its S the pattern is
 * not full.  Fails with MODAL_BAD_INPUT for a load that is not harmonic (err->field "excitation")
 * or, fixed in space, not periodic on axes that turn ("excitation[i].frame"; at every omega of
 * condense_at too), MODAL_TOO_LARGE, MODAL_NO_MEMORY.
 */
enum modal_status condense_new(const struct program *p, enum condense_keep keep,
                               struct condense **out, struct modal_error *err);
/* Frees C and all that it made, not the program; NULL is none. */
void condense_free(struct condense *c);

/*
 * Once per scene, where many frequencies follow: bring the linear dofs to their modes with the kept
 * ones fixed, so that (2) is a sum over modes, nothing to factor.  *DONE is false where it does not
 * apply (damping that modes do not share, matrices not symmetric, linear states); condense_at then
 * factors for each frequency, as without.
 */
enum modal_status condense_reduce(struct condense *c, bool *done, struct modal_error *err);

/* Of many linear dofs, few of them wanted, and symmetric matrices: harmonics and frequencies share
 * a basis that leaves each S_k, p_k and row wanted an error of TOLERANCE at most, relative and by
 * its own estimate; where it does not serve, condense_at factors as without.  POINTS frequencies
 * follow, nearly: what may be spent on the first. */
enum modal_status condense_share(struct condense *c, double tolerance, int points,
                                 struct modal_error *err);
/* That estimate of harmonic K of the last condense_at; 0: it was factored. */
double condense_doubt(const struct condense *c, int k);

/* From now on harmonics past H are asked for by an estimate alone, of S_k^-1 F_k, F[i (TOP + 1) +
 * k] of kept dof i (borrowed): of many linear dofs those that nothing drives are left 0, and what
 * is shared serves where its error is that of two or three digits of the largest of them, or its
 * TOLERANCE where that is more, and takes no more than half of its room and work for them.  Those
 * that may move next to nothing are left 0 too.  NULL: all are asked for, and made anew where they
 * were for an estimate. */
void condense_rough(struct condense *c, int H, const double complex *F, int top);
/* What these last may move a dof by altogether, at most, in the unit of x. */
double condense_left(const struct condense *c);

/* The dofs that condense_recover is asked for, COUNT of them (NULL: all): of many linear dofs only
 * theirs are held. */
void condense_want(struct condense *c, const int *dofs, int count);
/* Operations (budget.h) of sparse factors and their solutions so far. */
double condense_work(const struct condense *c);

/* Whether P has so many linear dofs, and no linear states. */
bool condense_many(const struct program *p);
/* Whether the linear dofs are so many that each harmonic takes sparse factors, known or not. */
bool condense_factors(const struct condense *c);

/* q, how many dofs are kept. */
int condense_kept(const struct condense *c);
/* The q kept dofs, ascending; C owns them, as what the next two give. */
const int *condense_dofs(const struct condense *c);
/* Of each of n dofs its index among the kept, or -1. */
const int *condense_place(const struct condense *c);
/* Which entries S has. */
const struct pattern *condense_pattern(const struct condense *c);
/* largest k excited; 0: none or a mean load only */
int condense_highest_load(const struct condense *c);

/*
 * What FROM, which gives it away, knows of its last frequency becomes C's where that is the same:
 * of two scenes with the same constant matrices and kept dofs, many linear ones, and the same dofs
 * wanted.  A harmonic whose loads are those of FROM but for one factor has it; others are factored
 * when they are asked for.  Nothing is approximated.
 */
void condense_inherit(struct condense *c, struct condense *from);

/*
 * S[k entries + e], e an entry of the pattern (full: S[(k q + j) q + i]), and p[k q + i], k = 0 ..
 * H, at OMEGA; loads are scaled by LEVEL.  Fails with MODAL_NO_CONVERGENCE where L_rr is singular
 * to rounding: the text says at which harmonic.
 */
enum modal_status condense_at(struct condense *c, double omega, double level, int H,
                              double complex *S, double complex *p, struct modal_error *err);

/* What condense_recover takes the loads' level to be. */
void condense_set_level(struct condense *c, double level);

/*
 * The motion of one dof, X[0..H], of the kept ones' Xq[i (Hq+1) + k], at the omega and H of the
 * last condense_at; kept dofs are copied.  Harmonics past Hq of Xq count as 0; a dof that is not
 * wanted, too.
 */
enum modal_status condense_recover(struct condense *c, int dof, int Hq, const double complex *Xq,
                                   int H, double complex *X, struct modal_error *err);

struct condense_residual {
    double relative;          /* max |R_k| over `scale`, or the linear states' like where that is
                               * more */
    double scale;             /* max(|P_k|, |Lambda_k X_k|) */
    double rms, most, load;   /* N: of R in time; its peak and that of the loads, each at most
                               * the sum over harmonics */
};

/*
 * R_k = Lambda_k X_k - P_k of the motion of all dofs that Xq[i (H+1) + k] belongs to, at the omega
 * and H of the last condense_at, multiplied out from the program's matrices.  Nothing is evaluated
 * or transformed.
 */
enum modal_status condense_residual(struct condense *c, const double complex *Xq,
                                    struct condense_residual *out, struct modal_error *err);
#endif
