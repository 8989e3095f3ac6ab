/* leap.h - one long step of a set of dofs by an explicit method of order 8, with all that lies in
 * between
 *
 * The state is y = (x, v), 2 n numbers by dof; a leap touches those of its set only.  What the set
 * looks at beyond its rim comes from the leap around it, which has been made over the same time.
 */
#ifndef MODAL_LEAP_H
#define MODAL_LEAP_H
#include <stdbool.h>
#include "base/error.h"
#include "modal/scene/dormand_prince.h"

struct dof_set;
struct dofwise;
struct workspace;

struct leap {
    struct dofwise *of;              /* borrowed, as `set` and `around` */
    const struct dof_set *set;
    const struct leap *around;       /* NULL: of the whole */
    double t, h;                     /* s */
    double *from, *to;               /* y at t and at t + h */
    double *slope[DORMAND_PRINCE_ALL];       /* y' at the stages; the first is given */
    double *part[DORMAND_PRINCE_DENSE];      /* of the interpolant */
    double *stage;                   /* 2 n of room; shared by leaps that are made in turn */
};

/* Arrays of SPACE; STAGE is shared. */
void leap_init(struct leap *l, struct dofwise *of, double *stage, struct workspace *space);

/* y' at time T in Y, into SLOPE, over the leap's set; Y gets the rim's motion. */
enum modal_status leap_slope(const struct leap *l, double t, double *y, const double *memory,
                             double *slope, struct modal_error *err);

/* From `from` and slope[0] at t over h: `to`, the slopes as far as there, and the interpolant: all
 * other arrays.  MEMORY is that of t. */
enum modal_status leap_make(struct leap *l, const double *memory, struct modal_error *err);

/* Component I (dof, or n + dof) of the state at t + theta h; I is in the set or the leap is the
 * whole's. */
double leap_at(const struct leap *l, int i, double theta);
/* The same at T of any dof of the set or its rim: what lies outside is asked of the leap around. */
double leap_value(const struct leap *l, int i, double t);

/* The largest error of the leap's end, each component times WEIGHT (2 n), those of dofs with APART
 * (n, or NULL) set left out. */
double leap_error(const struct leap *l, const double *weight, const int *apart);
#endif
