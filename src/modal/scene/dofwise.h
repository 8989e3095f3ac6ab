/* dofwise.h - a program's accelerations dof by dof, as sparse as the program itself
 *
 *     M a = p(t) - C(t) v - K(t) x - sum_laws f(d, d', memory)                                  (1)
 *
 * over all dofs, or over a set of them while the others' motion is given.  No matrix of dofs by
 * dofs is made: where M is diagonal (1) costs what the entries and laws of the set's rows cost;
 * another M is factored once.
 */
#ifndef MODAL_DOFWISE_H
#define MODAL_DOFWISE_H
#include <stdbool.h>
#include <stdint.h>
#include "modal/linalg/sparse.h"
#include "modal/linalg/sparse_lu.h"
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"
#include "modal/scene/sources.h"

struct dof_run { int from, to; };    /* dofs from .. to - 1 */

struct dof_set {
    int runs, laws, rims;
    struct dof_run *run;             /* ascending, apart */
    int *law;                        /* those that act on a dof of the set */
    int *rim;                        /* dofs outside that a row or a law of the set looks at */
    bool whole;                      /* all dofs: no rim */
};

/* What the stages of one step have shown of a law. */
struct law_watch {
    bool seen;                       /* anywhere yet */
    int regime;                      /* at the first place: a moment after the start */
    double rate[LAW_INPUTS_MOST];    /* at the step's start */
    bool mixed;                      /* its piece may have ended: another regime or sign of rate */
};

struct dofwise {
    const struct program *p;         /* borrowed */
    int n;
    struct sources *src;             /* its own */
    bool unloaded;                   /* loads are left out of (1) */
    double *mass;                    /* n, of a diagonal M; else NULL: */
    struct sparse_lu *factor;        /* of M */
    double *force, *solved;          /* n: right side of (1); M's solution */
    struct sparse graph;             /* dofs that (1) couples, without the diagonal */
    int *law_start, *law_of;         /* laws of dof i: law_of[law_start[i] ..] */
    int *load_start, *load_of;       /* its loads */
    int *memory;                     /* of each law: its first place in memories */
    int memories;                    /* doubles, of all laws; of a rigid slider the way that its */
                                     /* dof slips, 1 or -1, and 0 where it sticks */
    int sliders;                     /* rigid ones */
    int ended;                       /* the law whose piece ends where laws remember; -1: none */
    double step;                     /* s: that whose stages laws are watched in */
    double at_rest;                  /* in roots of energies: a slider no faster may stick */
    bool switched;                   /* a slider has, since it was last set to false */
    struct law_watch *watch;         /* of each law */
    int64_t *evaluations;            /* of each law, so far */
    bool *acted;                     /* at the end of any step */
    struct dof_set all;
    struct workspace space;          /* of the arrays */
};

/* Can P be asked dof by dof?  Not with linear states, turning axes, a mass that pulsates, nor laws
 * with a history of their own; with rigid sliders where each holds a dof of its own to the ground,
 * no law with memory acts there and M is diagonal: what holds one that sticks is what pulls at its
 * dof then. */
bool dofwise_serves(const struct program *p);
/* Is any law of P a rigid slider? */
bool dofwise_slides(const struct program *p);

/* Fails with MODAL_NO_MEMORY, or MODAL_BAD_INPUT where M is singular. */
enum modal_status dofwise_new(const struct program *p, struct dofwise **out,
                              struct modal_error *err);
/* NULL is accepted. */
void dofwise_free(struct dofwise *f);

/* Room for any set; set_of fills it. */
enum modal_status dofwise_set_new(struct dofwise *f, struct dof_set *out, struct modal_error *err);
/* OUT becomes the COUNT dofs of DOF, ascending. */
void dofwise_set(struct dofwise *f, const int *dof, int count, struct dof_set *out);

/* The laws of SET are watched from here on: a step of H begins at T and (X, V), MEMORY what laws
 * remember there.  Fails as their force does. */
enum modal_status dofwise_watch(struct dofwise *f, const struct dof_set *set, double t, double h,
                                const double *x, const double *v, const double *memory,
                                struct modal_error *err);

/*
 * (1) over SET at time t into A (n numbers, the set's alone are written): X and V must hold the
 * set's dofs and its rim's, MEMORY what laws remember from the step's start.  Where M is not
 * diagonal only the whole is asked.
 */
enum modal_status dofwise_accelerate(struct dofwise *f, const struct dof_set *set, double t,
                                     const double *x, const double *v, const double *memory,
                                     double *a, struct modal_error *err);

/* What the laws of SET remember once they have come to (t, X, V) from MEMORY, into AFTER (which may
 * be MEMORY); whether they act is noted.  A rigid slider goes its dof's way, and at rest the way
 * that it is pulled where that is more than it holds. */
enum modal_status dofwise_remember(struct dofwise *f, const struct dof_set *set, double t,
                                   const double *x, const double *v, const double *memory,
                                   double *after, struct modal_error *err);

/* The rates V of dofs whose sliders stick, of SET, become 0. */
void dofwise_hold(const struct dofwise *f, const struct dof_set *set, const double *memory,
                  double *v);

/* What pulls at rigid slider LAW's dof but itself, into PULL; X and V must hold that dof and those
 * that the graph has beside it.  Fails as laws' force does. */
enum modal_status dofwise_pull(struct dofwise *f, int law, double t, const double *x,
                               const double *v, const double *memory, double *pull,
                               struct modal_error *err);
/* What LAW, a rigid slider, holds against that, N. */
double dofwise_holds(const struct dofwise *f, int law);

/* s: a radian of the fastest that P's loads and matrices pulsate by at T; HUGE_VAL where none does.
 */
double dofwise_radian(const struct program *p, double t);

/* Into WEIGHT, 2 n: what makes x and v the roots of energies, sqrt(K_ii) and sqrt(M_ii).  A dof
 * without stiffness has the softest that can be told from one; where none has any, 1 / DURATION is
 * the frequency. */
void dofwise_weights(const struct program *p, double duration, double *weight);

/* Upper bounds of the fastest frequency and rate of decay of the linear part, rad/s and 1/s: by
 * rows, each over its mass. */
void dofwise_fastest(const struct program *p, double *frequency, double *decay);

#endif
