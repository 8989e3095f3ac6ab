/* stepper.h - one way to carry a state over a time, the same face for every class of program */
#ifndef MODAL_STEPPER_H
#define MODAL_STEPPER_H
#include <stdbool.h>
#include <stdint.h>
#include "modal/scene/sources.h"
#include "modal/scene/statespace.h"

struct ports;

struct stepper_options {
    double dt;                   /* the step that will be asked for most */
    /* relative error of a step where it is not exact; 0: 1e-12 linear, 1e-10 nonlinear */
    double tolerance;
    int substeps;                /* of dt, by rk4; 0: 1 */
    /* Nonlinear: more in all, rejected ones too, are MODAL_TOO_LARGE; 0: no limit. */
    int64_t steps_most;
    int64_t maps_most;           /* the same of maps */
    bool (*cancelled)(void *context);   /* may be NULL */
    void *context;
    /* Nonlinear: every accepted step, from t over h to y, with its rigid sliders'
     * ports->law[].held; may be NULL. */
    void (*accepted)(void *watcher, double t, double h, const double *y, struct ports *ports);
    void *watcher;
};

struct stepper {
    const char *name;            /* plan.integrator */
    /* y(t) -> y(t + h); no corner of the sources lies inside.  Fails with MODAL_OVERFLOW,
     * MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE, MODAL_ELEMENT_FAILED, MODAL_CANCELLED. */
    enum modal_status (*advance)(struct stepper *s, double t, double h, double *y,
                                 struct modal_error *err);
    /* What loads and laws add to y' at (t, y), N numbers, for accelerations. */
    enum modal_status (*force)(struct stepper *s, double t, const double *y, double *F,
                               struct modal_error *err);
    /* Counters and activity of laws into the program's effects; NULL: it has none. */
    void (*report)(struct stepper *s, struct program *p);
    void (*free)(struct stepper *s);
    int64_t products;            /* dense exponential products (or n 2 x 2 modal blocks) applied */
    int64_t maps;                /* exponentials computed */
    int64_t steps, rejected;     /* of an adaptive one */
    double tolerance;            /* nonlinear: of a step; may be changed between two calls */
    /* Nonlinear and rk4: what laws remember, MEMORIES numbers, between two calls; to begin another
     * motion write its own there and set `anew`. */
    double *memory;
    int memories;
    bool anew;
};

/* Exact steps of a constant program: 2 x 2 blocks where its modes decouple, one dense
 * exponential elsewhere. */
enum modal_status linear_stepper_new(const struct statespace *ss, const struct sources *src,
                                     const struct stepper_options *opt, struct stepper **out,
                                     struct modal_error *err);
/* Magnus maps of a periodic program, kept and repeated every period where the step divides a few
 * of them. */
enum modal_status periodic_stepper_new(const struct statespace *ss, const struct sources *src,
                                       const struct stepper_options *opt, struct stepper **out,
                                       struct modal_error *err);
/* Exponential collocation, laws iterated at their own dofs. */
enum modal_status nonlinear_stepper_new(const struct statespace *ss, const struct sources *src,
                                        const struct stepper_options *opt, struct stepper **out,
                                        struct modal_error *err);

/* Classical Runge-Kutta steps dt / substeps of any program: the peer of trade-offs. */
enum modal_status rk4_stepper_new(const struct statespace *ss, const struct sources *src,
                                  const struct stepper_options *opt, struct stepper **out,
                                  struct modal_error *err);

/* B P: what each row of w does to y', N x nw by columns, of SPACE.  NULL: no memory. */
double *stepper_source_matrix(const struct statespace *ss, const struct sources *src,
                              struct workspace *space);

/* F += BP w(t), N rows by columns; W becomes the sources at t, s. */
void stepper_add_loads(const struct sources *src, const double *BP, int N, double t, double *w,
                       double *F);
#endif
