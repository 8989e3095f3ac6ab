/* identify_state.h - what the stations of identify.c share: one record at work */
#ifndef MODAL_IDENTIFY_STATE_H
#define MODAL_IDENTIFY_STATE_H
#include "base/error.h"
#include "modal/batch.h"
#include "modal/identify/answer/modes.h"
#include "modal/identify/ask/diagnose.h"
#include "modal/identify/fit/compressed.h"
#include "modal/identify/linear/pencil.h"
#include "modal/identify/linear/projection.h"
#include "modal/identify/order/order.h"
#include "modal/identify/prepare/grid.h"
#include "modal/identify/prepare/pod.h"
#include "modal/identify/prepare/record.h"
#include "modal/identify/prepare/slip.h"
#include "modal/identify/prepare/steps.h"
#include "modal/identify/prepare/wild.h"
#include "modal/identify/result.h"

/* The pencil begins with few triplets and doubles them while the order is near their number. */
enum {
    TRIPLETS = 32,                  /* values that the ladder looks at */
    TRIPLETS_FIRST = 16,            /* asked of a pencil */
    TRIPLETS_MOST = 64              /* modes of more than these are many */
};

/* A pencil reads its record dozens of times, with many times its memory. Nearly all modes are told
 * by the head of a very long one, and a fit to GROW times the rows can begin there: it is in reach
 * of their errors, which for a frequency fall with rows^(3/2), and what only more rows tell stands
 * out of what it leaves. */
enum {
    HEAD = 16384,                   /* rows */
    HEAD_MANY = HEAD / 4,           /* where many modes are seen, which cost a pencil so much more:
                                     * slow ones have not outlived the others there */
    GROW = 8                        /* the errors of frequencies fall by 23 from one to the next */
};

/* Multiplications of a pencil of many modes, and of a search that begins far from their poles. */
#define WORK_MANY 1e11

struct work {
    struct identify_options opt;    /* defaults filled in */
    struct record rec;
    const struct slip *slip;        /* that its turns are evened out by; NULL: the period holds */
    struct pod pod;
    struct matrix weighted;         /* rec.Y, each channel over its noise; x NULL: not made, or they
                                     * are many, and reduced by their weights */
    double *noise;                  /* per channel: what it was weighed by; NULL: nothing */
    double *weight;                 /* per channel, of weighted over rec.Y; NULL: 1 */
    struct grid *grid;              /* per channel, in the batch's unit; NULL: not looked for */
    int cut;                        /* rows kept of a record that ends below its grid; 0: all */
    int grown;                      /* so of one that grows until rounding hides all else */
    /* rec.Y and rec.scale before that; x NULL: as they are */
    struct matrix whole; double *whole_scale;
    struct wild wild;               /* what rec.Y lacks of the record */
    struct steps steps;             /* so, sizes in the batch's unit */
    struct steps spikes;            /* so: that rec.Y was without before poles were looked for */
    double *least;                /* per signal: what its grid leaves (refine.h); NULL: no matter */
    const struct matrix *X;         /* the signals: rec.Y or pod.signals */
    struct matrix folded;
    int samples;                    /* of a folded signal (whiten.h) */
    struct refine_data data;        /* what is refined: X, or X folded */
    struct compressed *blocks;      /* owned, of very long records; else NULL */
    int seen_rows;                  /* that were searched before those */
    int shift;
    double tau;
    bool refine;
    struct pencil pencil;
    struct pencil full;             /* of all signals, from a trial that did not end; s NULL: none,
                                     * or, where they were counted, w->pencil has them */
    bool counted;
    int triplets;                   /* asked of the pencil */
    struct projection projection;
    bool projected;                 /* which of the two was made */
    double spent;                   /* work of the ladders so far */
    double descents;                /* of one search from above and those that it led to: of many
                                     * modes they share what there is */
    bool trial;                     /* this search has WORK_TRIAL only */
    bool brief;                     /* so has this one of periods, in coloured noise: WORK_LONG */
    bool many;                      /* modes, to judge by TRIPLETS_MOST triplets */
    bool headless;                  /* their head did not show them all */
    int ragged;                     /* rows whose spectrum is that of a driven response (ragged.h);
                                     * 0: none */
    bool endless;                   /* so is what stands out of the noise, or the weaker part of
                                     * it: nothing is searched from above */
    bool known;                     /* the last search found one set of modes, or what it had of
                                     * many: out->unweighed */
    struct identify_chosen seen;    /* modes of the first rows of a long record; count 0: none */
    struct order_choice choice;
    int rank;                       /* of the chosen candidate */
    struct poles poles;
    struct synthesis all;           /* of a wide batch's channels */
    struct diagnose_facts facts;
    double clock;                   /* when the stage began */
    double eigenvalues;      /* s, of that in eigenvalues: the stage "eig", wherever it was spent */
};

static inline double work_clock(const struct work *w)
{
    return w->opt.clock != NULL ? w->opt.clock(w->opt.context) : 0;
}

/* ---- identify_signals.c: functions fail with MODAL_NO_MEMORY, MODAL_NO_CONVERGENCE ---- */

/* w->X and w->data: the record's channels, or proper orthogonal signals of them. */
enum modal_status work_reduce(struct work *w, struct identify_result *out,
                              struct modal_error *err);
/* w->least: the variance that the channels' grids leave in each signal. */
enum modal_status work_grid_noise(struct work *w, struct modal_error *err);
/* The amplitudes of poles in the signals Y, by blocks where those are they. */
enum modal_status work_fit_signals(const struct work *w, const double complex *lambda, int count,
                                   const struct matrix *Y, struct synthesis *out,
                                   struct modal_error *err);
/* The rms that the chosen poles leave in each channel of unit rms. */
enum modal_status work_channel_noise(const struct work *w, double *noise,
                                     struct modal_error *err);
/* Do the options leave it to the program how channels are weighed, and then: does it pay? */
bool work_may_weigh(const struct work *w);
bool work_worth_weighing(const struct work *w);
/* Weigh the channels by what the chosen poles leave in them; *again: they are weighed anew. */
enum modal_status work_weigh_channels(struct work *w, bool *again, struct modal_error *err);
/* Rows of B that the record is of, from its first on. */
int work_rows_sent(const struct work *w, const struct batch *b);
/* The grid of each channel, as it was sent.  *any: there is one. */
enum modal_status work_find_grids(struct work *w, const struct batch *b, bool *any,
                                  struct modal_error *err);
/* Is what the fit leaves in a signal about what its grid makes? */
bool work_grid_matters(const struct work *w);
/* Are all signals explained to the rounding of their samples?  Nothing is then left that could
 * change in the record, or be driven. */
bool work_is_explained(const struct work *w, const struct identify_result *out);
/* The record ends where the response has died away below its grid. */
enum modal_status work_cut_below_grid(struct work *w, struct modal_error *err);
/* Which channels lie on a grid that matters, and what was cut. */
void work_report_grids(const struct work *w, struct identify_result *out);

/* ---- identify_wild.c ---- */

/* w->wild: the samples that rec.Y was mended of before all else, and lone spikes. */
enum modal_status work_begin_wild(struct work *w, struct modal_error *err);
/* Are wild samples looked for in such a record, and put back? */
bool work_may_take_wild(const struct work *w);
/* rec.Y without the samples that stand out of what the chosen poles leave: w->wild. Of records
 * that are in memory and no longer than a pencil reads. */
enum modal_status work_take_wild(struct work *w, struct modal_error *err);
/* rec.Y as it was sent. */
void work_put_wild_back(struct work *w);
/* Are the chosen poles one set of modes in white noise? */
bool work_is_clean(const struct work *w);
/* Standard errors by the samples that are left, with steps that were fitted. */
enum modal_status work_widen_for_lacking(const struct work *w, struct poles *p,
                                         struct modal_error *err);
/* In which channels, and how many. */
void work_report_wild(const struct work *w, struct identify_result *out);

/* ---- identify_steps.c: as work_may_take_wild() has it ---- */

/* w->steps and w->spikes, which rec.Y then is without. */
enum modal_status work_begin_steps(struct work *w, struct modal_error *err);
/* Steps and poles together: *settled, or rec.Y is another. */
enum modal_status work_fit_steps(struct work *w, bool *settled, struct modal_error *err);
/* Do the chosen poles have the steps for what they are? */
bool work_are_steps(const struct work *w);
/* rec.Y as it was sent, w->steps empty. */
void work_put_steps_back(struct work *w);
/* In which channels, when, and how high. */
void work_report_steps(const struct work *w, struct identify_result *out);

/* ---- identify_growth.c: as work_may_take_wild() has it ---- */

/* *cut: the record ends where rounding of what grows comes near what the chosen poles leave. */
enum modal_status work_cut_growth(struct work *w, bool *cut, struct modal_error *err);
/* The record as it was before; it was cut. */
void work_put_growth_back(struct work *w);
/* Where it was cut. */
void work_report_growth(const struct work *w, struct identify_result *out);

/* ---- identify_decompose.c ---- */

/* Which of the two decompositions the options ask for. */
bool work_wants_projection(const struct work *w);
/* What the poles are looked for in: few channels weighed by their noise, though each is fitted as
 * it is, with its own noise. */
const struct matrix *work_searched(const struct work *w);
/* w->pencil or w->projection of the signals, and its singular values for the answer. */
enum modal_status work_decompose(struct work *w, struct identify_result *out,
                                 struct modal_error *err);
/* *all: a pencil of as many triplets as there are signals, w->pencil where that has them; or of
 * fewer, where work_many_by_head(). */
enum modal_status work_pencil_of_all(struct work *w, struct pencil *all, struct modal_error *err);
/* Are many modes seen, in rows enough that they are searched by their head first? */
bool work_many_by_head(const struct work *w);
/* The singular values of the decomposition, for the answer. */
enum modal_status work_report_values(struct work *w, struct identify_result *out,
                                     struct modal_error *err);

/* ---- identify_limits.c ---- */

/* Multiplications that a search may take (refine.h): a TRIAL, or one of a record LONGER than
 * most. */
double work_left(const struct work *w, bool trial, bool longer);
/* The order that leaves a few rows over, but a pair wherever it can be fitted at all. */
int work_rows_allow(const struct work *w);
/* The order whose unknowns are a share of the independent numbers: S rows of them to fit, S + 1
 * unknowns for each order. Of a periodic system noise says how many. */
int work_sparing_order(const struct work *w);
/* The criterion (7) of refine.c for no poles at all; that of the chosen candidate. */
double work_bic_of_nothing(const struct refine_data *d);
double work_bic_chosen(const struct order_choice *k);
/* The poles of w->pencil, of w CONTEXT, as order_source has them. */
enum modal_status work_pencil_source(void *context, int r, double complex *lambda, int *count,
                                     struct modal_error *err);

/* ---- identify_order.c ---- */

/* Is the record one that is searched by its head first? */
bool work_begins_at_head(const struct work *w);
/* *found: one set of modes in white noise, in all rows; or none, where noise drives the head. Else
 * nothing is. */
enum modal_status work_grow_from_head(struct work *w, struct identify_result *out, bool *found,
                                      struct modal_error *err);
/* *found, out->begun: the poles of w->opt.known are the answer. Else nothing is. */
enum modal_status work_begin_at_known(struct work *w, struct identify_result *out, bool *found,
                                      struct modal_error *err);
/* w->choice: from above, and where that does not settle it by the ladder. */
enum modal_status work_choose_order(struct work *w, struct identify_result *out,
                                    struct modal_error *err);
/* What a fixed or ruled rank left out: one more direction fits far better, and completes a pair? */
enum modal_status work_look_above(struct work *w, struct modal_error *err);
/* The chosen poles into TO, whose memory is the caller's to free. */
enum modal_status work_keep_chosen(const struct work *w, struct identify_chosen *to,
                                   struct modal_error *err);

/* ---- identify_slip.c ---- */

/* The record at the even angles of w->slip; its period by that. */
enum modal_status work_even_out(struct work *w, struct modal_error *err);
/* *slip of the record against its period, ends 0: none, or nothing that is asked. */
enum modal_status work_find_slip(const struct work *w, struct slip *slip, struct modal_error *err);
/* Is SECOND, by the turns that SLIP tells, the answer, and not FIRST, by the period given?  Then it
 * says so. */
bool work_slips(const struct slip *slip, const struct identify_result *first,
                struct identify_result *second);

/* ---- identify_even.c ---- */

/* *found, empty: the multipliers of Y, the signals of a record that has families or what is left
 * of them, at even phases. */
enum modal_status work_choose_even(const struct work *w, const struct matrix *Y,
                                   struct order_choice *found, struct modal_error *err);

/* ---- identify_families.c ---- */

/* Is the record of a period that is no whole number of samples, and in memory? */
bool work_has_families(const struct work *w);
/* *choice, empty: its multipliers, each with its lines, from the poles of KNOWN, or with NULL from
 * the record at even phases; none where there are none to begin with.  *fewer: there
 * are fewer multipliers than KNOWN has, and worth more. */
enum modal_status work_choose_families(struct work *w, const struct refined *known,
                                       struct order_choice *choice, bool *fewer,
                                       struct modal_error *err);

/* ---- identify_periods.c ---- */

/* *best, empty, of the periods w->data.Y: multipliers in noise taken for white. */
enum modal_status work_descend_periods(struct work *w, struct order_choice *best,
                                       struct modal_error *err);
/* *best, empty, of a periodic system: its multipliers, from above. */
enum modal_status work_choose_periodic(struct work *w, struct order_choice *best,
                                       struct modal_error *err);

/* *best, empty: the poles of w->opt.known, refined and completed as any from above, where they
 * leave noise that no search would take for anything else; else it stays empty.  *found: they are
 * the answer; or there are none, where none were known, no pole pays and all is such noise. */
enum modal_status work_try_known(struct work *w, struct order_choice *best, bool *found,
                                 struct modal_error *err);

/* ---- identify_poles.c ---- */

/* w->poles: the chosen ones with their errors, of a wide batch by a step over all channels. */
enum modal_status work_take_poles(struct work *w, struct modal_error *err);
/* Standard errors by all that is doubted; growth that rounding to a grid makes is marked. */
enum modal_status work_widen(struct work *w, const struct batch *b,
                             const struct identify_result *out, struct modal_error *err);
/* The candidates, their poles, and the modes' persistence among them. */
enum modal_status work_report_ladder(struct work *w, struct identify_result *out,
                                     struct modal_error *err);

/* ---- identify_doubt.c ---- */

/* Is one set of exponents the right model?  A mode that follows its amplitude is reported as one,
 * not as the crowd of poles that makes up for it. */
enum modal_status work_doubt(struct work *w, struct identify_result *out, struct modal_error *err);
/* Clusters, the verdict and the diagnostics. */
enum modal_status work_conclude(struct work *w, const struct batch *batch,
                                struct identify_result *out, struct modal_error *err);
#endif
