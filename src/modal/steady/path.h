/* path.h - a branch of steady states over one parameter, by pseudo-arc-length continuation
 *
 * The balance R(u, lambda) = 0 is followed as a curve: u in units of its own size, lambda in units
 * of `span`, so that the branch is traced around folds, where lambda turns back. */
#ifndef MODAL_PATH_H
#define MODAL_PATH_H
#include <complex.h>
#include <stdbool.h>
#include "base/error.h"

struct balance;
struct budget;

struct path_point {
    double lambda;
    const double complex *X;       /* kept dofs; borrowed for the call */
    double turn;                   /* d lambda / d s, in [-1, 1]: 0 at a fold, < 0 where the
                                    * branch runs back */
    int iterations;
};

enum path_special { PATH_FOLD, PATH_BRANCH, PATH_OWN };   /* OWN: a zero of the caller's test */

struct path_problem {
    /* The balance at LAMBDA, set and ready; borrowed until the next call.  MODAL_NO_CONVERGENCE:
     * none there. */
    enum modal_status (*at)(void *context, double lambda, struct balance **out,
                            struct modal_error *err);
    /* Every accepted point, the first and last included.  *STOP ends the path. */
    enum modal_status (*point)(void *context, const struct path_point *p, struct balance *b,
                               bool *stop, struct modal_error *err);
    /* A point where the branch folds or branches, located; may be NULL. */
    enum modal_status (*special)(void *context, enum path_special kind, const struct path_point *p,
                                 struct balance *b, struct modal_error *err);
    bool (*cancelled)(void *context);     /* may be NULL */
    void *context;

    double from, to, span;
    bool past;                     /* go on past `to` and back: report each crossing of it by
                                    * `point`, end by `stop` or limits */
    double step_first, step_most;  /* of arc length, in units of span and size; 0: 0.02 and 0.1 */
    int points_most;               /* 0: 5000 */
    bool rough;                    /* only `to` is wanted: points on the way are near the branch,
                                    * and steps as long as may be */
    const struct budget *budget;   /* spent, it ends the walk, which counts to that of its
                                    * balances; NULL: a walk for its own sake, whose points have
                                    * one each */
    double low, high;              /* with `past`: end where lambda leaves [low, high] */
};

struct path_report {
    bool complete;                 /* reached `to` (or, with `past`, was stopped or left [low,
                                    * high]) */
    int points, rejected;
    const char *reason;            /* why not complete */
};

/* Follow from X (harmonics of the kept dofs at `from`, converged or nearly) in the direction of
 * `to`. */
enum modal_status path_follow(const struct path_problem *problem, const double complex *X,
                              struct path_report *report, struct modal_error *err);
#endif
