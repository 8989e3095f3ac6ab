/* refine_state.h - what the files of refine.c share: one fit at work, an evaluation, a search;
 * numbers in brackets are refine.c's equations */
#ifndef MODAL_REFINE_STATE_H
#define MODAL_REFINE_STATE_H
#include <stddef.h>
#include "modal/identify/fit/compressed.h"
#include "modal/identify/fit/criterion.h"
#include "modal/identify/fit/doubling.h"
#include "modal/identify/fit/gram.h"
#include "modal/identify/fit/refine.h"
#include "modal/identify/linear/exponents.h"

enum { JOIN_MOST = 16 };           /* columns of Y that join the QR */

/* Poles as the iteration moves them: per step, so that a = Re lambda tau, b = Im lambda tau. */
struct point { double *a, *b; };

struct work {
    const struct refine_data *data;
    const struct matrix *Y;
    int L, S, phases, groups;
    int count, order, parameters;
    const bool *fixed;
    enum pole_kind *kind;
    int *column, *first;      /* of each pole: its first column in Phi, its first parameter or -1 */
    int *turn;                /* of each pole: what Im moves by with its parameter (refine.h) */
    bool *shares;             /* of each pole: an earlier one has the same parameters */
    bool tied;                /* some pole does */
    bool look;                   /* no derivatives: Phi alone */
    int columns;                 /* of [Phi D], or of Phi */
    double cost, spent;          /* multiplications of one evaluation; of all so far */
    int most_columns;            /* min(L, columns): columns of Q */
    bool join;                   /* Y joins the QR */
    bool doubled;                /* long records: instead of a QR of all rows */
    struct doubling *doubling;   /* for that; NULL where blocks tell of no poles yet */
    struct compressed *blocks;   /* borrowed: what doubling reads instead of Y; or NULL */
    struct gram *gram;           /* many poles: instead of any QR; else NULL */
    int panel;                   /* columns of Y at a time */
    double *basis;               /* L x columns: [Phi D], then Q; L x (columns + S) where Y joins */
    double *triangle;            /* (columns + S)^2, for many rows; else NULL: the QR is in place */
    double *tau;                 /* Householder */
    double *R;                   /* most_columns x 2 order */
    double *Z;                   /* most_columns x panel: Q^T Y */
    /* borrowed, order x S: Q^T Y of all panels, where they are asked for (`look`); else NULL */
    double *all;
    double *C;                   /* order x panel */
    double *rest;                /* L x panel: P Y */
    double *turned;              /* panel x most_columns, and a triangle; NULL: columns are few */
    double *stack;               /* rows of (4) of one panel below the triangle so far */
    int stack_rows;
    double *reflect;             /* workspace of LAPACK's QR, REFLECT blocks of columns */
    struct workspace space, held;   /* of an evaluation's arrays; of poles' and groups' */
    double *weight;              /* per group */
    double *energy;              /* per group: sum of squares of Y */
    double *floor2;              /* per group: (6)^2 */
    double *lowest;              /* per group: variance below which nothing is signal */
};

/* What one evaluation of (1) gives. */
struct evaluation {
    double F;                    /* weighted sum of squares */
    double *rss;                 /* per group, unweighted */
    double *near;                /* per group: of rss, what lies in the span of the derivatives */
    double *T;                   /* (parameters + 1)^2: triangle [R_J, g; 0, *] */
    bool degenerate;
};

struct search {
    struct point at, trial;
    struct evaluation now, next;
    double *A, *delta;            /* of damped_step */
    double *step;                 /* delta, of the exponents themselves */
    int *partner;                 /* of each pole: the one that it is stepped together with, -1 */
    bool beside;                  /* the last evaluation is not that of `now` */
    int iterations, evaluations;
};

/* ---- refine_evaluate.c ---- */

/* Columns and parameters of each pole; false: no memory. */
bool refine_layout(struct work *w, const double complex *lambda);
/* What evaluations need; WHOLE: all rows of Y are there.  False: no memory. */
bool refine_allocate(struct work *w, bool whole);
/* All that those two took. */
void refine_free(struct work *w);
/* (1) at AT, for F, residuals and the triangle of (4).  Fails with MODAL_NO_MEMORY,
 * MODAL_NO_CONVERGENCE. */
enum modal_status refine_evaluate(struct work *w, const struct point *at, struct evaluation *e,
                                  struct modal_error *err);

/* What poles AT have in data->blocks, which sums in closed form and rows do not read.  Fails with
 * MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE. */
enum modal_status refine_hold(const struct work *w, const struct point *at,
                              struct modal_error *err);

/* Steps of it, for samples that lie elsewhere: w->basis = [Phi D] and then Q; w->R; whether Phi has
 * full rank. */
void refine_fill_basis(struct work *w, const struct point *at);
enum modal_status refine_factor(struct work *w, struct modal_error *err);
bool refine_regular(const struct work *w);
/* Rows of (4) of channel C of a panel, at ROW of the stack. */
void refine_channel_rows(struct work *w, int c, double weight, int row);
/* The triangle T to the top of the stack, and ROWS of that to T. */
void refine_triangle_to_stack(struct work *w, const double *T);
enum modal_status refine_reduce_stack(struct work *w, int rows, double *T,
                                      struct modal_error *err);

/* ---- refine_search.c ---- */

/* Room for a search of W, given back with it; false: no memory. */
bool refine_search_new(struct search *s, struct work *w);
/* Descend from s->at, weigh anew, until the weights settle: *end; r->start and start_bic. */
enum modal_status refine_search(struct work *w, struct search *s,
                                const struct refine_options *asked, struct refined *r,
                                enum refine_end *end, struct modal_error *err);
/* A growth or decay in one step that no column overflows of. */
double refine_guard(const struct work *w, double a);
/* The whole step: min |R_J delta - g|.  False where it has no solution. */
bool refine_undamped_step(int n, const double *T, double *A, double *delta);
/* No step turns a phase over the record by more than a few radians: another line is another
 * minimum. */
void refine_take_step(const struct work *w, const struct point *from, const double *delta,
                      struct point *to);
/* What its fits are compared by. */
struct criterion refine_criterion(const struct work *w);
/* The criterion, every residual times FACTOR. */
double refine_worth(const struct work *w, const double *rss, double factor);
/* What it is more where two real poles, of LAMBDA in 1/s, each pay for themselves. */
double refine_dearer(const struct work *w, const double complex *lambda, double tau);

/* ---- refine_covariance.c ---- */

/* Rows that are independent: all, unless a filter left the noise only a share of them. */
double refine_rows(const struct work *w);
/* Degrees of freedom, for (5). */
double refine_freedom(const struct work *w);
/* Is what a group leaves no more than (6)? */
bool refine_at_rounding(const struct work *w, const struct evaluation *e, int g);
/* What signals at rounding have in F: the part of it that no step can lower, nor tell. */
double refine_rounding_part(const struct work *w, const struct evaluation *e);
/* s^2 of (5). */
double refine_variance(const struct work *w, const struct evaluation *e);
/* The covariance of the parameters, in 1/s^2, from the last evaluation, E, of so many COLUMNS that
 * are not zero; NAN where their triangle is singular. */
void refine_covariance(const struct work *w, const struct evaluation *e, double columns,
                       double tau, double *cov);

/* ---- refine.c ---- */

/* MODAL_BAD_INPUT: data or poles that cannot be refined. */
enum modal_status refine_check(const struct refine_data *d, const double complex *start, int count,
                               struct modal_error *err);
#endif
