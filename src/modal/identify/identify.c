/*
 * identify.c - the way from a batch to modes; see identify.h for the stations
 *
 * Two decompositions lead to the poles of every order:
 *
 *   pencil.c       H by FFT products, one-sample shift: the default for systems without a period
 *   projection.c   the pair (14) with any shift, its own error bars: periodic systems, a named
 *                  method, a rank by singular values
 *
 * and order.c climbs either, refining by variable projection.  Very long records are decomposed by
 * their head only, and a fit to all rows begins there.  A named `method` is the paper's procedure:
 * no refinement unless asked for. Periodic systems shift by one period where that is a whole number
 * of samples; where not, by one sample, and modes.c folds the exponents modulo i Omega.
 */
#include "modal/identify/identify.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ambient.h"
#include "modal/identify/compressed.h"
#include "modal/identify/diagnose.h"
#include "modal/identify/digits.h"
#include "modal/identify/exponents.h"
#include "modal/identify/fold.h"
#include "modal/identify/forced.h"
#include "modal/identify/grid.h"
#include "modal/identify/hankel.h"
#include "modal/identify/merge.h"
#include "modal/identify/modes.h"
#include "modal/identify/order.h"
#include "modal/identify/pencil.h"
#include "modal/identify/pod.h"
#include "modal/identify/polish.h"
#include "modal/identify/projection.h"
#include "modal/identify/record.h"
#include "modal/identify/screen.h"
#include "modal/identify/trend.h"
#include "modal/identify/verdict.h"
#include "modal/identify/widen.h"
#include "modal/linalg/svd.h"

const char *const identify_method_names[IDENTIFY_METHOD_COUNT + 1] = {
    "auto",           "partial-floquet",     "partial-floquet-full",
    "autoregressive", "autoregressive-full", NULL,
};

/* A step over all channels, in standard errors of all parameters: up to STEP_SHORT the linear model
 * holds and one pass is enough (from an efficient start it is a few); longer ones, where channels
 * of much noise spoilt the start, are repeated while they shrink; past STEP_MOST they are not
 * believed. */
static const double STEP_SHORT = 8, STEP_MOST = 1e4;
enum { STEPS = 4 };
/* More channels than this are reduced to proper orthogonal signals; values that the ladder looks
 * at; complete decompositions up to this side. */
enum { TRIPLETS = 32, COMPLETE_SIDE = 600, FREEDOM = 3 };
/* The pencil begins with few triplets and doubles them while the order is near their number; long
 * records end earlier: a fit costs L r^2. */
enum { TRIPLETS_FIRST = 16, TRIPLETS_MOST = 64, TRIPLETS_LONG = 32, LONG = 4096 };

/* In records longer than this a ladder that is near the number of triplets is not refined before
 * they are doubled: it is thrown away, and costs seconds. */
enum { VERY_LONG = 32768 };

/* A pencil reads its record dozens of times, with many times its memory. Nearly all modes are told
 * by the head of a very long one, and a fit to GROW times the rows can begin there: it is in reach
 * of their errors, which for a frequency fall with rows^(3/2), and what only more rows tell stands
 * out of what it leaves. */
enum { HEAD = 16384, GROW = 8 };

/* What is searched from above: at most so many signals, found for so many multiplications; and
 * where many modes are seen to be there. */
enum { SIGNALS_MOST = 256, MANY_MOST = 1024, LAG = 5 };
static const double SIGNALS_WORK = 4e9, MANY_WORK = 1e11;

enum { WEIGH_MOST = 5 };
/* Records that end below the grid: steps from the end's value, rows that must be left, and the
 * share of all above which they stay whole. */
enum { GRID_ROWS = 64 };
static const double GRID_ABOVE = 1.9, GRID_WORTH = 0.9;
/* Channels that are not mixed are weighed from this ratio on, or where the first answer is in
 * doubt: their fits weigh each by its own noise already. */
static const double NOISE_FEW = 10;
/* Poles this near, of the frequency, may be one mode that changes (merge.c); two shapes of one mode
 * have at least so much in common: the square of their cosine. */
static const double NEIGHBOUR = 0.05, SAME_SHAPE = 0.9;
static const double SPARING = 0.6, WEIGH_FALL = 10, WEIGH_RANGE = 1e-6;
/* Multiplications (refine.h) that all ladders of an answer may take, those of very long records,
 * and one that begins after they are spent: a second or two. */
static const double WORK_MOST = 1.6e10, WORK_LONG = 5e9, WORK_LEAST = 5e8;
/* The same of a first search among few channels that have not been weighed by their noise: if that
 * differs much the search may find no end. */
static const double WORK_TRIAL = 1e9;
/* Where signals say that there are many modes: as many evaluations of all of them as a search takes
 * that begins near its end. */
static const double EVALUATIONS_MANY = 64;

struct work {
    struct identify_options opt;    /* defaults filled in */
    struct record rec;
    struct pod pod;
    struct matrix weighted;         /* rec.Y, each channel over its noise; x NULL: not made */
    double *noise;                  /* per channel: what it was weighed by; NULL: nothing */
    double *weight;                 /* per channel of weighted, over rec.Y; NULL: 1 */
    struct grid *grid;              /* per channel, in the batch's unit; NULL: not looked for */
    int cut;                        /* rows kept of a record that ends below its grid; 0: all */
    double *least;                /* per signal: what its grid leaves (refine.h); NULL: no matter */
    const struct matrix *X;         /* the signals: rec.Y or pod.signals */
    struct matrix folded;
    struct refine_data data;        /* what is refined: X, or X folded */
    struct compressed *blocks;      /* owned, of very long records; else NULL */
    int seen_rows;                  /* that were searched before those */
    int shift;
    double tau;
    bool refine;
    struct pencil pencil;
    int triplets;                   /* asked of the pencil */
    struct projection projection;
    bool projected;                 /* which of the two was made */
    double spent;                   /* work of the ladders so far */
    bool trial;                     /* this search has WORK_TRIAL only */
    bool many;                      /* modes, to judge by TRIPLETS_MOST triplets */
    bool known;                     /* the last search found one set of modes: out->unweighed */
    struct identify_chosen seen;    /* modes of the first rows of a long record; count 0: none */
    struct order_choice choice;
    int rank;                       /* of the chosen candidate */
    struct poles poles;
    struct synthesis all;           /* of a wide batch's channels */
    struct diagnose_facts facts;
    double clock;                   /* when the stage began */
    double eigenvalues;      /* s, of that in eigenvalues: the stage "eig", wherever it was spent */
};

static void poles_done(struct poles *p)
{
    free(p->lambda);
    free(p->std_re);
    free(p->std_im);
    free(p->bar);
    free(p->angle);
    free(p->growth);
}

static void work_done(struct work *w)
{
    record_done(&w->rec);
    pod_done(&w->pod);
    free(w->weighted.x), free(w->noise), free(w->weight), free(w->grid), free(w->least);
    free(w->folded.x);
    compressed_free(w->blocks);
    pencil_done(&w->pencil);
    projection_done(&w->projection);
    order_done(&w->choice);
    free(w->seen.lambda);
    poles_done(&w->poles);
    synthesis_done(&w->all);
}

void identify_result_done(struct identify_result *r)
{
    for (int i = 0; i < r->mode_count; i++) {
        free(r->modes[i].harmonics);
        free(r->modes[i].shape);
    }
    for (int i = 0; i < r->cluster_count; i++)
        free(r->clusters[i].members);
    free(r->modes), free(r->offset), free(r->singular), free(r->channel), free(r->rms_error),
        free(r->relative_error);
    free(r->candidates), free(r->poles), free(r->clusters), free(r->trend);
    free(r->chosen.lambda), free(r->unweighed.lambda);
    free(r->frf.input), free(r->frf.hertz), free(r->frf.value), free(r->frf.std);
    memset(r, 0, sizeof *r);
}

static double clock_of(const struct work *w)
{
    return w->opt.clock != NULL ? w->opt.clock(w->opt.context) : 0;
}

/* A stage's seconds; a second time over they are added. */
static void note_stage(struct identify_result *out, const char *name, double seconds)
{
    int i = 0;

    while (i < out->stage_count && strcmp(out->stages[i].name, name) != 0)
        i++;
    if (i == IDENTIFY_STAGES)
        return;
    out->stages[i].name = name;
    out->stages[i].seconds += seconds;
    out->stage_count = i < out->stage_count ? out->stage_count : i + 1;
}

/* A stage ends: its seconds are noted, and a cancelled job stops. */
static enum modal_status stage(struct work *w, const char *name, struct identify_result *out,
                               struct modal_error *err)
{
    double now = clock_of(w);

    note_stage(out, name, now - w->clock);
    w->clock = now;
    if (w->opt.cancelled != NULL && w->opt.cancelled(w->opt.context))
        return modal_fail(err, MODAL_CANCELLED, "cancelled after the stage %s", name);
    return MODAL_OK;
}

/* ---- options ---- */

static enum modal_status check_range(const char *field, double value, double low, double high,
                                     struct modal_error *err)
{
    if (!(value >= low && value <= high))
        return modal_fail_field(err, MODAL_BAD_INPUT, field, "%s is %g; accepted: %g to %g", field,
                                value, low, high);
    return MODAL_OK;
}

static enum modal_status check_options(const struct identify_options *o, struct modal_error *err)
{
    const struct { const char *field; double value, low, high; } limits[] = {
        { "method", o->method, 0, IDENTIFY_METHOD_COUNT - 1 },
        { "detrend", o->detrend, 0, DETREND_COUNT - 1 },
        { "scale", o->scale, 0, SCALE_COUNT - 1 },
        { "rank.rule", o->rank.rule, 0, RANK_RULE_COUNT - 1 },
        { "pod.energy", o->pod_energy, 0, 1 },
        { "pod.rank", o->pod_rank, 0, IDENTIFY_ORDER_MOST },
        { "rank.energy", o->rank.energy, 0, 1 },
        { "rank.threshold", o->rank.threshold, 0, 1 },
        { "rank.fixed", o->rank.fixed, o->rank.rule == RANK_FIXED, IDENTIFY_ORDER_MOST },
        { "rank.most", o->rank.most, 0, IDENTIFY_ORDER_MOST },
        { "rows", o->rows, 0, INT32_MAX },
        { "columns", o->columns, 0, INT32_MAX },
        { "stride", o->stride, 0, INT32_MAX },
        { "target.error", o->target_error, 0, HUGE_VAL },
        { "target.seconds", o->target_seconds, 0, HUGE_VAL },
    };
    enum modal_status rc = MODAL_OK;

    for (size_t i = 0; i < sizeof limits / sizeof *limits && rc == MODAL_OK; i++)
        rc = check_range(limits[i].field, limits[i].value, limits[i].low, limits[i].high, err);
    return rc;
}

/* The shift, and whether it suits the period. */
static enum modal_status choose_shift(struct work *w, struct modal_error *err)
{
    const struct record *r = &w->rec;
    int stride = w->opt.stride;

    w->shift = r->per_period > 0 ? r->per_period : 1;
    if (stride > 0 && r->per_period > 0 && stride != r->per_period)
        return modal_fail_field(err, MODAL_BAD_INPUT, "stride",
                                "a stride of %d samples for a period of %d; accepted: %d, or "
                                "`period` 0 for constant coefficients",
                                stride, r->per_period, r->per_period);
    if (stride > 1 && r->period > 0 && r->per_period == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "stride",
                                "a stride of %d samples, and a period of %.9g samples; accepted: 1",
                                stride, r->period / r->step);
    if (stride > 0)
        w->shift = stride;
    if (w->shift > r->Y.m / 2)
        return modal_fail_field(err, MODAL_BAD_INPUT, "stride",
                                "a stride of %d in %d samples; accepted: 1 to %d", w->shift, r->Y.m,
                                r->Y.m / 2);
    w->tau = w->shift * r->step;
    w->opt.stride = w->shift;
    return MODAL_OK;
}

/* More proper orthogonal signals than channels, or than rows, there are none of. */
static enum modal_status check_pod_rank(const struct work *w, struct modal_error *err)
{
    int channels = w->rec.channels, rows = w->rec.Y.m, most = channels < rows ? channels : rows;

    if (w->opt.pod_rank <= most)
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, "pod.rank", "pod.rank is %d of %d channel%s and "
                            "%d samples; accepted: 1 to %d", w->opt.pod_rank, channels,
                            channels > 1 ? "s" : "", rows, most);
}

/* ---- signals ---- */

/* The variance of the grid in each signal: independent in each channel, and so weighed by squares.
 * A difference over a period has it twice, a filter its own gain of it. */
static enum modal_status grid_noise(struct work *w, struct modal_error *err)
{
    int S = w->rec.channels;
    double *least = calloc((size_t)w->X->n + 1, sizeof *least), times = w->opt.difference ? 2 : 1;

    if (least == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for the noise of %d signals",
                          w->X->n);
    for (int i = 0; i < w->X->n; i++)
        for (int c = 0; c < S; c++) {
            double part =
                w->pod.count > 0 ? w->pod.modes.x[c + (size_t)i * (size_t)w->pod.modes.ld] : c == i;
            double q = w->rec.scale[c] > 0 ? part * w->grid[c].step / w->rec.scale[c]
                    * (w->weight != NULL && w->pod.count > 0 ? w->weight[c] : 1)
                                           : 0;
            least[i] += times * w->rec.gain * GRID_NOISE_MOST * q * q;
        }
    free(w->least);
    w->least = least;
    return MODAL_OK;
}

/* Orthogonal signals that are no larger than their grid makes them hold nothing else; they are the
 * weakest. */
static void drop_below_grid(struct work *w)
{
    int kept = w->pod.count;

    while (kept > 1 && w->pod.s[kept - 1] * w->pod.s[kept - 1] <= w->X->m * w->least[kept - 1])
        kept--;
    w->pod.count = w->pod.signals.n = w->pod.modes.n = kept;
}

static enum modal_status reduce(struct work *w, struct identify_result *out,
                                struct modal_error *err)
{
    struct pod_options opt = { .energy = w->opt.pod_energy, .rank = w->opt.pod_rank };
    bool asked = opt.energy > 0 || opt.rank > 0;
    enum modal_status rc = MODAL_OK;

    w->X = &w->rec.Y;
    out->pod_rank = w->rec.channels;
    out->energy = 1;
    if (!w->opt.signals_all && (asked || w->rec.channels > POD_CHANNELS_FEW)) {
        /* refined on all channels afterwards */
        struct wide_options wide = { opt, w->refine ? 1e-4 : 1e-9 };
        if (w->pod.count == 0)
            rc = w->rec.wide
                ? wide_pod(&w->rec.view, &wide, &w->pod, NULL, err)
                : pod_reduce(w->weighted.x != NULL ? &w->weighted : &w->rec.Y, &opt, &w->pod, err);
        w->X = &w->pod.signals;
        out->pod_rank = w->pod.count;
        out->energy = w->pod.energy;
    }
    w->data = (struct refine_data) { .Y = w->X, .tau = w->tau, .phases = 1, .share = w->rec.share };
    if (rc == MODAL_OK && w->least != NULL)
        rc = grid_noise(w, err);
    if (rc == MODAL_OK && w->least != NULL && w->pod.count > 0) {
        drop_below_grid(w);
        out->pod_rank = w->pod.count;
    }
    w->data.least = w->least;
    if (rc == MODAL_OK && w->shift > 1) {
        rc = fold(w->X, w->shift, &w->folded, err);
        w->data = (struct refine_data) { .Y = &w->folded, .tau = w->tau, .phases = w->shift,
                                         .least = w->least };
    }
    return rc;
}

/* ---- decomposition ---- */

/* The pencil uses every column there is. */
static bool every_column(const struct work *w)
{
    int rows = w->opt.rows, columns = 0;

    hankel_default_sizes(w->X->m, w->shift, &rows, &columns);
    return w->opt.columns == 0 || w->opt.columns == columns;
}

static bool wants_projection(const struct work *w)
{
    return w->shift > 1 || !w->refine || w->opt.method != IDENTIFY_AUTO || !every_column(w)
        || (w->opt.rank.rule != RANK_AUTO && w->opt.rank.rule != RANK_FIXED);
}

/* What the poles are looked for in: few channels weighed by their noise, though each is fitted as
 * it is, with its own noise. */
static const struct matrix *searched(const struct work *w)
{
    return w->pod.count == 0 && w->weighted.x != NULL ? &w->weighted : w->X;
}

static enum modal_status project(struct work *w, struct identify_result *out,
                                 struct modal_error *err)
{
    struct hankel h = { searched(w), 0, w->opt.rows, w->opt.columns, w->shift };
    bool all = w->opt.rank.rule > RANK_FIXED;
    int side, wanted = w->opt.rank.rule == RANK_FIXED ? w->opt.rank.fixed + 4 : TRIPLETS;
    enum modal_status rc;

    hankel_default_sizes(w->X->m, w->shift, &h.rows, &h.columns);
    rc = hankel_check(&h, err);
    if (rc != MODAL_OK)
        return rc;
    side = h.rows * w->X->n < h.columns ? h.rows * w->X->n : h.columns;
    if (w->opt.rank.rule == RANK_FIXED && w->opt.rank.fixed > side)
        return modal_fail_field(err, MODAL_BAD_INPUT, "rank.fixed",
                                "rank %d of a Hankel matrix of %d x %d; accepted: 1 to %d",
                                w->opt.rank.fixed, h.rows * w->X->n, h.columns, side);
    if (all)
        wanted = side <= COMPLETE_SIDE ? side : 8 * TRIPLETS;
    rc = projection_make(&h, wanted, &w->projection, err);
    w->projected = rc == MODAL_OK;
    out->rows = h.rows, out->columns = h.columns;
    return rc;
}

/* Can so many triplets of a Hankel matrix of so many rows be had for the work? Many modes of a
 * very long record are found in its head. */
static bool affords(const struct work *w, int rows, int triplets)
{
    bool many = w->many && w->X->m < GROW * HEAD;
    double k = triplets, side = (double)rows * w->X->n + w->X->m - rows;

    return k <= (many ? MANY_MOST : SIGNALS_MOST)
        && side * k * k <= (many ? MANY_WORK : SIGNALS_WORK);
}

/* Rows for many triplets, and for those that cannot be had of as many rows as few need: as high
 * as it is wide the Hankel matrix has its noise lowest beside its signals, and more rows cost
 * more; it has room for FOLD times the triplets. */
static int rows_of_many(const struct work *w, int triplets)
{
    enum { FOLD = 4 };
    int L = w->X->m, S = w->X->n, rows = L / (S + 1), least = FOLD * triplets / S + 1;

    if (w->opt.rows > 0 || triplets <= TRIPLETS_MOST
        || (!w->many && affords(w, w->pencil.rows, triplets)))
        return w->opt.rows;
    rows = rows > least ? rows : least;
    return rows < (L + 2) / 3 ? rows : (L + 2) / 3;
}

/* Do as many triplets as few modes need leave much of the signals? Then many modes are there. What
 * follows its own amplitude has many directions too, and next to nothing in the later ones. */
static bool leaves_much(const struct pencil *p)
{
    double rest = p->energy;

    for (int i = 0; i < p->count; i++)
        rest -= p->s[i] * p->s[i];
    return rest > ORDER_POOR * ORDER_POOR * p->energy;
}

/* Do signals fill the triplets, so that there may be more of them? Lanczos ends as soon as it has
 * their number, and the last have not converged: they are less than the signals, by a tenth of the
 * number as seen. Where what they leave is mostly more of the same, its edge is high as well, and
 * half of the number above it are as many as few modes in noise do not have. */
static bool signals_fill(const struct work *w, const struct pencil *p)
{
    int lag = leaves_much(p) ? p->count / 2 : w->many ? p->count / LAG : 0;

    return pencil_signals(p) + lag + ORDER_AHEAD > p->count;
}

/* Can twice the triplets be had? */
static bool can_double(const struct work *w, const struct pencil *p)
{
    int more = 2 * p->count, rows = rows_of_many(w, more);

    return p->count < w->X->m / 4 && affords(w, rows > 0 ? rows : p->rows, more);
}

/* A response that noise drives has no end of signals: of those not even many are searched. Where
 * they end, more than TRIPLETS_MOST are many, however little the first of them leave. */
static void drop_endless(struct work *w, struct pencil *all)
{
    bool endless = signals_fill(w, all), many = w->many;

    w->many = !endless && (many || pencil_signals(all) > TRIPLETS_MOST);
    if (!endless || !many)
        return;
    if (all->s != w->pencil.s)
        pencil_done(all);
    *all = w->pencil;
}

/* *all: a pencil of as many triplets as there are signals, w->pencil where that has them. */
static enum modal_status pencil_of_all(struct work *w, struct pencil *all, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    *all = w->pencil;
    w->many = false;
    while (rc == MODAL_OK && signals_fill(w, all) && can_double(w, all)) {
        struct pencil_options opt = { rows_of_many(w, 2 * all->count), 2 * all->count };
        struct pencil more = { 0 };
        rc = pencil_new(searched(w), &opt, &more, err);
        if (all->s != w->pencil.s)
            pencil_done(all);
        *all = rc == MODAL_OK ? more : w->pencil;
        if (all->count == TRIPLETS_MOST)
            w->many = leaves_much(all);
        if (more.count < opt.wanted)
            break;
    }
    drop_endless(w, all);
    return rc;
}

static enum modal_status pencil(struct work *w, struct identify_result *out,
                                struct modal_error *err)
{
    int fixed = w->opt.rank.rule == RANK_FIXED ? w->opt.rank.fixed : 0, most = (w->X->m - 1) / 2;
    struct pencil_options opt = { w->opt.rows, fixed > 0 ? fixed + 4 : w->triplets };
    enum modal_status rc;

    if (fixed > most)
        return modal_fail_field(err, MODAL_BAD_INPUT, "rank.fixed",
                                "rank %d of %d samples; accepted: 1 to %d", fixed, w->X->m, most);
    rc = pencil_new(searched(w), &opt, &w->pencil, err);
    out->rows = w->pencil.rows, out->columns = w->X->m - w->pencil.rows;
    return rc;
}

/* The singular values of the decomposition, for the answer. */
static enum modal_status report_values(struct work *w, struct identify_result *out,
                                       struct modal_error *err)
{
    int count = w->projected ? w->projection.count : w->pencil.count;
    const double *s = w->projected ? w->projection.s : w->pencil.s;

    free(out->singular);
    out->singular = malloc(sizeof *s * (count + 1));
    if (out->singular == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d singular values",
                          count);
    for (int i = 0; i < count; i++)
        out->singular[i] = s[0] > 0 ? s[i] / s[0] : 0;
    out->singular_count = count;
    w->facts.full_rank = rank_above_rounding(s, count, out->rows * w->X->n, out->columns);
    return MODAL_OK;
}

static enum modal_status decompose(struct work *w, struct identify_result *out,
                                   struct modal_error *err)
{
    enum modal_status rc = wants_projection(w) ? project(w, out, err) : pencil(w, out, err);

    return rc == MODAL_OK ? report_values(w, out, err) : rc;
}

/* ---- order ---- */

static enum modal_status projection_source(void *context, int r, double complex *lambda, int *count,
                                           struct modal_error *err)
{
    struct work *w = context;
    int dropped = 0;
    double start = clock_of(w);
    enum modal_status rc =
        projection_poles(&w->projection, w->opt.method, r, w->tau, lambda, count, &dropped, err);

    if (r == w->opt.rank.fixed)
        w->facts.dropped = dropped;
    w->eigenvalues += clock_of(w) - start;
    return rc;
}

static enum modal_status pencil_source(void *context, int r, double complex *lambda, int *count,
                                       struct modal_error *err)
{
    struct work *w = context;
    double complex rho[IDENTIFY_ORDER_MOST + TRIPLETS];
    double start = clock_of(w);
    enum modal_status rc = pencil_multipliers(&w->pencil, r, rho, err);

    if (rc == MODAL_OK)
        *count = poles_of_multipliers(rho, r, w->tau, 1e-300, lambda, &w->facts.dropped);
    w->eigenvalues += clock_of(w) - start;
    return rc;
}

/* The order that leaves FREEDOM rows over, but a pair wherever it can be fitted at all. */
static int rows_allow(const struct work *w)
{
    int L = w->data.Y->m;

    return L - FREEDOM > 2 ? L - FREEDOM : L > 2 ? 2 : 1;
}

/* How far the ladder goes: no more than the singular values above rounding, the rows there are less
 * FREEDOM (with fewer left over, any exponents reconstruct noise), or what was allowed. */
static int order_most(const struct work *w)
{
    int most = w->projected ? w->projection.count : w->pencil.count;

    if (most > w->facts.full_rank)
        most = w->facts.full_rank;
    if (most > w->data.Y->m - 1)
        most = w->data.Y->m - 1;
    if (w->opt.rank.rule == RANK_AUTO && most > rows_allow(w))
        most = rows_allow(w);
    if (w->opt.rank.most > 0 && most > w->opt.rank.most)
        most = w->opt.rank.most;
    return most < IDENTIFY_ORDER_MOST ? most : IDENTIFY_ORDER_MOST;
}

/* The criterion (7) of refine.c for no poles at all. */
static double bic_of_nothing(const struct refine_data *d)
{
    double n = (double)d->Y->m * d->phases, own = d->share > 0 ? d->share * n : n, sum = 0;

    for (int g = 0; g < d->Y->n / d->phases; g++) {
        double energy = 0;
        for (int k = 0; k < d->phases; k++) {
            double norm = safe_norm(d->Y->x + (size_t)(g * d->phases + k) * d->Y->ld, d->Y->m);
            energy += norm * norm;
        }
        sum += energy > 0 ? own * log(fmax(energy / n, d->least != NULL ? d->least[g] : 0)) : 0;
    }
    return sum;
}

/* The order whose unknowns are SPARING of the independent numbers: S rows of them to fit, S + 1
 * unknowns for each order. */
static int sparing_order(const struct work *w)
{
    double rows = w->data.Y->m * (w->data.share > 0 ? w->data.share : 1), S = w->data.Y->n;
    int order = (int)(SPARING * rows * S / (S + 1)), least = w->data.Y->m > 2 ? 2 : 1;

    return order > least ? order : least;
}

/* BIC is an expansion for many data: where unknowns nearly exhaust them it prefers to interpolate
 * noise.  An order beyond the sparing one is believed only if it reaches rounding. */
static bool overfitted(const struct work *w)
{
    const struct refined *fit =
        w->choice.chosen >= 0 ? &w->choice.candidates[w->choice.chosen].fit : NULL;

    return fit != NULL && fit->order > sparing_order(w)
        && fit->residual > 1e-12 * safe_matrix_norm(w->data.Y);
}

/* Can the ladder be cut off by the number of triplets, so that more of them may help? */
static bool more_triplets(const struct work *w)
{
    int most = w->X->m > LONG ? TRIPLETS_LONG : TRIPLETS_MOST;

    return !w->projected && w->opt.rank.rule == RANK_AUTO && w->triplets < most
        && w->pencil.count == w->triplets && w->facts.full_rank == w->pencil.count;
}

/* Was it, and not by its own end?  Or is little explained by all there are? */
static bool cut_off(const struct work *w)
{
    if (!more_triplets(w) || w->choice.chosen < 0 || w->choice.limited)
        return false;
    return w->rank + ORDER_AHEAD > w->pencil.count
        || w->choice.candidates[w->choice.chosen].fit.residual
        > ORDER_POOR * safe_matrix_norm(w->data.Y);
}

/* Is this a very long record that begins with what is no free response? Then there is no set of
 * modes for a search to end at, what drives it has signals without end, and all of the work there
 * may be was spent on them. */
static bool driven(const struct work *w)
{
    return w->rec.proposed[1] > 0 && w->opt.window[0] != WINDOW_AUTO && w->X->m > VERY_LONG;
}

/* The ladder within what is left of the work; a rank that was given is refined to its end. */
static enum modal_status climb(struct work *w, const struct order_source *source,
                               struct order_options *opt, struct modal_error *err)
{
    enum modal_status rc;

    opt->cut = w->data.Y->m > VERY_LONG && more_triplets(w) ? w->pencil.count : 0;
    opt->work = w->opt.rank.rule != RANK_AUTO ? 0
              : w->trial || driven(w) ? fmax(WORK_TRIAL - w->spent, DBL_MIN)
              : fmax((w->data.Y->m > VERY_LONG ? WORK_LONG : WORK_MOST) - w->spent, WORK_LEAST);
    order_done(&w->choice);
    rc = order_choose(&w->data, source, opt, &w->choice, err);
    w->spent += w->choice.work;
    w->facts.work_limit = rc == MODAL_OK && w->choice.limited;
    return rc;
}

/* Values before the last clear gap: that many exponents must be looked at, however badly fewer fit.
 * */
static int before_gap(const struct work *w)
{
    const double *s = w->projected ? w->projection.s : w->pencil.s, GAP = 3;
    int count = w->projected ? w->projection.count : w->pencil.count, at = 0;

    for (int i = 1; i < count && s[i - 1] > 0; i++)
        if (s[i - 1] > GAP * s[i])
            at = i;
    return at < w->facts.full_rank ? at : w->facts.full_rank;
}

/* The chosen candidate is the answer. */
static void note_chosen(struct work *w, struct identify_result *out)
{
    const struct order_candidate *c = &w->choice.candidates[w->choice.chosen];

    w->rank = c->r > 0 ? c->r : c->fit.order;
    w->facts.order = c->fit.order;
    w->facts.converged = !w->refine || refined_converged(&c->fit)
        || c->fit.residual <= 1e-12 * safe_matrix_norm(w->data.Y);
    out->hankel_rank = c->fit.order;
}

static enum modal_status choose_order(struct work *w, struct identify_result *out,
                                      struct modal_error *err)
{
    struct order_source source = { .most = order_most(w), .context = w,
                                   .poles = w->projected ? projection_source
                                                         : pencil_source };
    struct order_options opt = { .refine = { .iterations = w->refine ? 0 : -1 },
                                 .cancelled = w->opt.cancelled,
                                 .context = w->opt.context };
    const struct projection *p = &w->projection;
    enum modal_status rc;

    if (w->opt.rank.rule != RANK_AUTO)
        opt.fixed = w->projected ? rank_estimate(p->s, p->count, p->m, p->n, &w->opt.rank)
                                 : w->opt.rank.fixed;
    if (w->opt.rank.rule != RANK_AUTO)
        w->opt.rank.fixed = w->facts.asked_rank = opt.fixed;
    if (opt.fixed > w->facts.full_rank)
        /* what lies beyond is made of rounding; said by a diagnostic */
        opt.fixed = w->facts.full_rank;
    if (opt.fixed > source.most)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "rank.fixed",
            "rank %d where there are %d directions and %d rows; accepted: 1 to %d", opt.fixed,
            w->projected ? p->count : w->pencil.count, w->data.Y->m, source.most);
    opt.look = before_gap(w);
    opt.no_offset = !w->refine;
    opt.thorough = w->shift > 1;
    opt.order_most = w->opt.rank.rule == RANK_AUTO ? rows_allow(w) : 0;
    rc = climb(w, &source, &opt, err);
    if (rc == MODAL_OK && w->opt.rank.rule == RANK_AUTO && overfitted(w)) {
        opt.order_most = sparing_order(w);
        /* splitting poles may have gone beyond the triplets there are */
        if (source.most > opt.order_most)
            source.most = opt.order_most;
        rc = climb(w, &source, &opt, err);
    }
    if (rc == MODAL_OK && w->choice.chosen >= 0 && !w->choice.cut && w->opt.rank.rule == RANK_AUTO
        && w->choice.candidates[w->choice.chosen].fit.bic >= bic_of_nothing(&w->data))
        w->choice.chosen = -1;                    /* order 0: no pole pays for itself */
    if (rc == MODAL_OK && w->choice.chosen >= 0)
        note_chosen(w, out);
    return rc;
}

/* The poles that a search begins at: those of fewer rows, or many of one set that channels not yet
 * weighed showed. NULL: none. */
static const struct identify_chosen *begins_at(const struct work *w,
                                               const struct identify_result *out)
{
    const struct identify_chosen *k = &out->unweighed;

    if (w->seen.count > 0)
        return &w->seen;
    return w->known && poles_order(k->lambda, k->count, w->tau) > TRIPLETS_MOST ? k : NULL;
}

/* From all signals downwards, in w->pencil, for w->choice. */
static enum modal_status descend(struct work *w, const struct identify_result *out,
                                 struct modal_error *err)
{
    struct order_options opt = { .order_most = rows_allow(w), .cancelled = w->opt.cancelled,
                                 .context = w->opt.context };
    struct order_source source = { .most = order_most(w), .signals = pencil_signals(&w->pencil),
                                   .poles = pencil_source, .context = w };
    const struct identify_chosen *begin = begins_at(w, out);
    int many = source.signals;
    enum modal_status rc;

    if (begin != NULL) {
        many = poles_order(begin->lambda, begin->count, w->tau);
        source.most = source.signals = 0;
        source.known = begin->lambda, source.known_count = begin->count;
    } else {
        opt.look = before_gap(w);
    }
    opt.work = w->trial ? fmax(WORK_TRIAL - w->spent, DBL_MIN)
             : fmax(WORK_MOST - w->spent, WORK_LEAST);
    opt.many = w->many || source.known != NULL;
    opt.seen = w->seen_rows;
    if (opt.many)
        opt.work = fmax(opt.work, EVALUATIONS_MANY * refine_work(&w->data, many));
    rc = order_from_above(&w->data, &source, &opt, &w->choice, err);
    if (rc != MODAL_OK || w->choice.chosen < 0)
        return rc;
    if (w->choice.candidates[w->choice.chosen].fit.bic >= bic_of_nothing(&w->data)
        || overfitted(w)) {
        order_done(&w->choice);
        w->choice = (struct order_choice) { .chosen = -1 };
    }
    return MODAL_OK;
}

/* What a search found, and where; pencil.s NULL: in w->pencil. */
struct found { struct pencil pencil; struct order_choice choice; };

static void found_done(struct found *f)
{
    pencil_done(&f->pencil);
    order_done(&f->choice);
}

/* What was found takes the place of what W has. */
static enum modal_status put_found(struct work *w, struct found *f, struct identify_result *out,
                                   struct modal_error *err)
{
    if (f->pencil.s != NULL) {
        pencil_done(&w->pencil);
        w->pencil = f->pencil, f->pencil = (struct pencil) { 0 };
    }
    order_done(&w->choice);
    w->choice = f->choice, f->choice = (struct order_choice) { .chosen = -1 };
    w->spent += w->choice.work;
    w->facts.work_limit = false;
    note_chosen(w, out);
    return report_values(w, out, err);
}

/* Constant systems from above.  What interpolates noise is left out: above->choice is empty. */
static enum modal_status choose_from_above(struct work *w, struct identify_result *out,
                                           struct found *above, struct modal_error *err)
{
    struct pencil few = w->pencil, all;
    enum modal_status rc;

    if (w->projected || !w->refine || w->opt.rank.rule != RANK_AUTO || w->opt.rank.most > 0
        || driven(w))
        return MODAL_OK;
    all = w->pencil;
    rc = begins_at(w, out) != NULL ? MODAL_OK : pencil_of_all(w, &all, err);
    w->pencil = all;
    if (rc == MODAL_OK)
        rc = report_values(w, out, err);
    if (rc == MODAL_OK)
        rc = descend(w, out, err);
    above->pencil = w->pencil, above->choice = w->choice;
    w->pencil = few, w->choice = (struct order_choice) { .chosen = -1 };
    if (above->pencil.s == few.s)
        above->pencil = (struct pencil) { 0 };
    return rc == MODAL_OK ? report_values(w, out, err) : rc;
}

static enum modal_status keep_chosen(const struct work *w, struct identify_chosen *to,
                                     struct modal_error *err)
{
    const struct refined *fit = w->choice.chosen >= 0
                              ? &w->choice.candidates[w->choice.chosen].fit : NULL;
    int n = fit != NULL ? fit->poles : 0;

    to->lambda = malloc(sizeof *to->lambda * ((size_t)n + 1));
    if (to->lambda == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles", n);
    if (n > 0)
        memcpy(to->lambda, fit->lambda, sizeof *to->lambda * n);
    to->count = n, to->signals = w->X->n;
    return MODAL_OK;
}

/* ---- very long records ---- */

static bool begins_at_head(const struct work *w)
{
    return w->X->m >= GROW * HEAD && !wants_projection(w) && w->opt.rows == 0
        && w->opt.rank.rule == RANK_AUTO && w->opt.rank.most == 0 && !driven(w);
}

/* ROWS of all are searched. */
static void search_rows(struct work *w, const struct matrix *all, int rows, struct matrix *part)
{
    *part = *all, part->m = rows;
    w->X = w->data.Y = rows < all->m ? part : all;
    w->weighted.m = w->weighted.x != NULL ? rows : 0;
}

/* A fit to all rows, or more, that begins with what F found in fewer. */
static enum modal_status search_on(struct work *w, struct identify_result *out, struct found *f,
                                   struct modal_error *err)
{
    enum modal_status rc;

    w->seen_rows = w->blocks != NULL ? w->blocks->Y.m : HEAD;
    compressed_free(w->blocks);
    w->data.blocks = w->blocks = compressed_new(w->X);
    if (w->blocks == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d signals", w->X->n);
    w->choice = f->choice, f->choice = (struct order_choice) { .chosen = -1 };
    rc = keep_chosen(w, &w->seen, err);
    order_done(&w->choice);
    if (rc == MODAL_OK)
        rc = descend(w, out, err);
    f->choice = w->choice, w->choice = (struct order_choice) { .chosen = -1 };
    free(w->seen.lambda);
    w->seen = (struct identify_chosen) { 0 };
    return rc;
}

/* *found: one set of modes in white noise, in all rows; else nothing is. */
static enum modal_status grow_from_head(struct work *w, struct identify_result *out, bool *found,
                                        struct modal_error *err)
{
    const struct matrix *all = w->X;
    struct found f = { .choice = { .chosen = -1 } };
    struct matrix part;
    int rows = HEAD, most;
    double grow = all->m / (double)HEAD;
    enum modal_status rc;

    for (most = 1; pow(GROW, most) < grow;)
        most++;
    grow = pow(grow, 1.0 / most);
    search_rows(w, all, rows, &part);
    rc = decompose(w, out, err);
    if (rc == MODAL_OK)
        rc = choose_from_above(w, out, &f, err);
    while (rc == MODAL_OK && f.choice.clean && rows < all->m) {
        rows = --most > 0 ? (int)(grow * rows) : all->m;
        search_rows(w, all, rows, &part);
        rc = search_on(w, out, &f, err);
    }
    *found = rc == MODAL_OK && f.choice.clean && !f.choice.crowded;
    search_rows(w, all, all->m, &part);
    if (*found)
        rc = put_found(w, &f, out, err);
    else
        pencil_done(&w->pencil);
    if (!*found) {
        compressed_free(w->blocks);
        w->data.blocks = w->blocks = NULL;
    }
    found_done(&f);
    return rc;
}

/* Twice the triplets, until the ladder ends by itself. */
static enum modal_status climb_all(struct work *w, struct identify_result *out,
                                   struct modal_error *err)
{
    enum modal_status rc = choose_order(w, out, err);

    while (rc == MODAL_OK && cut_off(w)) {
        w->triplets *= 2;
        pencil_done(&w->pencil);
        order_done(&w->choice);
        rc = decompose(w, out, err);
        if (rc == MODAL_OK)
            rc = choose_order(w, out, err);
    }
    return rc;
}

/* Does what came from above explain much more than the ladder's choice?  What is not one set of
 * modes in white noise may draw noise, but never as much as that. */
static bool explains_more(const struct work *w, const struct order_choice *above)
{
    double worse = above->clean ? ORDER_WORSE : ORDER_DRAWN;

    if (above->chosen < 0 || above->limited)
        return false;
    return w->choice.chosen < 0
        || w->choice.candidates[w->choice.chosen].fit.residual
               > worse * above->candidates[above->chosen].fit.residual;
}

/* From above, and where that does not settle it by the ladder. */
static enum modal_status choose_order_of_all(struct work *w, struct identify_result *out,
                                             struct modal_error *err)
{
    struct found above = { .choice = { .chosen = -1 } };
    enum modal_status rc = choose_from_above(w, out, &above, err);
    bool put = rc == MODAL_OK && above.choice.clean && !above.choice.crowded;

    if (rc == MODAL_OK && !put) {
        rc = climb_all(w, out, err);
        put = rc == MODAL_OK && explains_more(w, &above.choice);
    }
    if (put)
        rc = put_found(w, &above, out, err);
    found_done(&above);
    return rc;
}

/* What a fixed or ruled rank left out: one more direction fits far better, and completes a pair? */
static enum modal_status look_above(struct work *w, struct modal_error *err)
{
    const struct refined *fit = &w->choice.candidates[w->choice.chosen].fit;
    struct refine_options look = { .iterations = -1 };
    double complex lambda[IDENTIFY_ORDER_MOST + 2];
    int r = w->facts.asked_rank + 1, count = 0, reals = 0, more = 0;
    struct refined above;
    enum modal_status rc = MODAL_OK;

    if (w->facts.asked_rank < 1 || r > w->facts.full_rank || r > order_most(w)
        || r >= w->data.Y->m - 1)
        return MODAL_OK;
    rc = w->projected
        ? projection_poles(&w->projection, w->opt.method, r, w->tau, lambda, &count, NULL, err)
        : pencil_source(w, r, lambda, &count, err);
    if (rc != MODAL_OK || count < 1)
        return rc;
    rc = refine_poles(&w->data, lambda, count, NULL, &look, &above, err);
    if (rc != MODAL_OK)
        return rc;
    for (int j = 0; j < fit->poles; j++)
        reals += pole_order(fit->lambda[j], w->tau) == 1;
    for (int j = 0; j < count; j++)
        more += pole_order(lambda[j], w->tau) == 1;
    w->facts.rank_low = above.bic < fit->bic - 20 && above.residual < 0.7 * fit->residual;
    w->facts.cut_pair = w->facts.rank_low && more < reals;
    refined_done(&above);
    return MODAL_OK;
}

/* ---- channels by their noise ---- */

/*
 * Proper orthogonal signals of channels scaled to unit rms mix channels of little noise with
 * channels of much, and no weight on the mixture can undo that: a channel that hears hardly
 * anything but noise then costs a factor in the error of all.  So, once a first answer tells the
 * noise of each channel, they are divided by it, and reduced and identified again.  Where that
 * leaves a channel WEIGH_FALL times less than before, what was taken for its noise was the error
 * that the others' noise made: once more.  Weights differ by WEIGH_RANGE at most, so that a mode
 * which only noisy channels hear stays far above the rounding of the others.  Few channels are not
 * mixed, but a pencil of all alike may miss what much more noise in one hides in the others.
 */
static bool may_weigh(const struct work *w)
{
    return w->refine && !w->rec.wide && w->rec.channels > 1 && !w->opt.signals_all
        && w->opt.rank.rule <= RANK_FIXED && w->opt.pod_rank == 0 && w->opt.pod_energy == 0
        && w->opt.scale == SCALE_RMS;
}

static bool worth_weighing(const struct work *w)
{
    return may_weigh(w) && w->choice.chosen >= 0
        && w->choice.candidates[w->choice.chosen].fit.residual
        > 1e-12 * safe_matrix_norm(w->data.Y);
}

/* The amplitudes of poles in the signals Y, by blocks where those are they. */
static enum modal_status fit_signals(const struct work *w, const double complex *lambda, int count,
                                     const struct matrix *Y, struct synthesis *out,
                                     struct modal_error *err)
{
    struct compressed *b = w->data.blocks;

    return b != NULL && b->Y.x == Y->x && b->Y.m == Y->m
               ? synthesis_fit_blocks(lambda, count, w->tau, b, out, err)
               : synthesis_fit(lambda, count, w->tau, Y, NULL, out, err);
}

/* The rms that the chosen poles leave in each channel of unit rms. */
static enum modal_status channel_noise(const struct work *w, double *noise, struct modal_error *err)
{
    const struct refined *fit = &w->choice.candidates[w->choice.chosen].fit;
    struct matrix folded = { 0 };
    const struct matrix *Y = &w->rec.Y;
    struct synthesis s = { 0 };
    enum modal_status rc = MODAL_OK;

    if (w->shift > 1) {
        rc = fold(&w->rec.Y, w->shift, &folded, err);
        Y = &folded;
    }
    if (rc == MODAL_OK)
        rc = fit_signals(w, fit->lambda, fit->poles, Y, &s, err);
    for (int c = 0; c < w->rec.channels && rc == MODAL_OK; c++)
        noise[c] = safe_norm(s.channel_residual + (size_t)c * w->shift, w->shift)
            / sqrt((double)Y->m * w->shift);
    synthesis_done(&s);
    free(folded.x);
    return rc;
}

/* Is a channel much quieter than was thought, or, at first, are they not alike? */
static bool weights_differ(const struct work *w, const double *noise)
{
    double least = HUGE_VAL, most = 0;
    bool fell = false;

    for (int c = 0; c < w->rec.channels; c++) {
        if (!(w->rec.scale[c] > 0))
            continue;
        least = fmin(least, noise[c]), most = fmax(most, noise[c]);
        fell |= w->noise != NULL && noise[c] < w->noise[c] / WEIGH_FALL;
    }
    bool doubtful = w->pod.count > 0 || w->facts.work_limit;
    return w->noise == NULL ? most > (doubtful ? NOISE_ALIKE : NOISE_FEW) * least : fell;
}

/* weighted = rec.Y over the noise, the quietest channel at 1. */
static enum modal_status divide_by_noise(struct work *w, struct modal_error *err)
{
    const struct matrix *Y = &w->rec.Y;
    double least = HUGE_VAL;

    if (w->weighted.x == NULL) {
        w->weighted = (struct matrix) { Y->m, Y->n, Y->m, malloc(sizeof(double) * Y->m * Y->n) };
        w->weight = malloc(sizeof *w->weight * (size_t)w->rec.channels);
    }
    if (w->weighted.x == NULL || w->weight == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d samples of %d channels",
                          Y->m, Y->n);
    for (int c = 0; c < Y->n; c++)
        least = w->rec.scale[c] > 0 ? fmin(least, w->noise[c]) : least;
    for (int c = 0; c < Y->n; c++) {
        w->weight[c] = least / w->noise[c];
        for (int l = 0; l < Y->m; l++)
            w->weighted.x[l + (size_t)c * Y->m] = Y->x[l + (size_t)c * Y->ld] * w->weight[c];
    }
    return MODAL_OK;
}

/* Weigh the channels by what the chosen poles leave in them; *again: they are weighed anew. */
static enum modal_status weigh_channels(struct work *w, bool *again, struct modal_error *err)
{
    double *noise = malloc(sizeof *noise * w->rec.channels), most = 0;
    enum modal_status rc;

    *again = false;
    if (noise == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for the noise of %d channels",
                          w->rec.channels);
    rc = channel_noise(w, noise, err);
    for (int c = 0; c < w->rec.channels && rc == MODAL_OK; c++)
        most = fmax(most, noise[c]);
    for (int c = 0; c < w->rec.channels && rc == MODAL_OK; c++)
        noise[c] = fmax(noise[c], fmax(WEIGH_RANGE * most, NOISE_QUIETEST));
    *again = rc == MODAL_OK && weights_differ(w, noise);
    if (*again) {
        free(w->noise);
        w->noise = noise, noise = NULL;
        rc = divide_by_noise(w, err);
    }
    free(noise);
    return rc;
}

/* What the search for the order spent: on eigenvalues, and on the rest of it. */
static enum modal_status stage_order(struct work *w, struct identify_result *out,
                                     struct modal_error *err)
{
    note_stage(out, "eig", w->eigenvalues);
    w->clock += w->eigenvalues;
    w->eigenvalues = 0;
    return stage(w, w->refine ? "refine" : "eig", out, err);
}

/* From signals to the chosen order. */
static enum modal_status analyse(struct work *w, struct identify_result *out,
                                 struct modal_error *err)
{
    bool found = false;
    enum modal_status rc;

    w->triplets = TRIPLETS_FIRST;
    if ((rc = reduce(w, out, err)) != MODAL_OK
        || (rc = stage(w, "pod", out, err)) != MODAL_OK
        || (begins_at_head(w) && (rc = grow_from_head(w, out, &found, err)) != MODAL_OK)
        || (!found && (rc = decompose(w, out, err)) != MODAL_OK)
        || (!found && (rc = stage(w, "svd", out, err)) != MODAL_OK)
        || (!found && (rc = choose_order_of_all(w, out, err)) != MODAL_OK)
        || (w->choice.chosen >= 0 && (rc = look_above(w, err)) != MODAL_OK)
        || (rc = stage_order(w, out, err)) != MODAL_OK)
        return rc;
    return MODAL_OK;
}

/* All but the signals of a wide batch, which cost passes over it and stay the same. */
static void forget_analysis(struct work *w, struct identify_result *out)
{
    if (!w->rec.wide)
        pod_done(&w->pod);
    pencil_done(&w->pencil);
    projection_done(&w->projection);
    order_done(&w->choice);
    free(w->folded.x), w->folded.x = NULL;
    free(out->singular), out->singular = NULL;
    w->projected = false;
    w->facts = (struct diagnose_facts) { .converged = true };
}

/* ---- samples on a grid ---- */

/* The grid of each channel, as it was sent.  True: there is one. */
static enum modal_status find_grids(struct work *w, const struct batch *b, bool *any,
                                    struct modal_error *err)
{
    size_t first = (size_t)llround(w->rec.t0 / b->dt);
    int rows = w->rec.Y.m * w->rec.decimation;

    w->grid = calloc((size_t)w->rec.channels + 1, sizeof *w->grid);
    if (w->grid == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for the grids of %d channels",
                          w->rec.channels);
    if (w->rec.wide)
        return wide_grids(&w->rec.view, w->grid, any, err);
    for (int c = 0; c < w->rec.channels; c++) {
        if (w->rec.scale[c] > 0)
            w->grid[c] = grid_of(b->signals + first * b->channels + w->rec.channel[c],
                                 b->channels, rows);
        *any |= w->grid[c].step > 0;
    }
    return MODAL_OK;
}

static bool floats(const struct work *w)
{
    for (int c = 0; c < w->rec.channels; c++)
        if (w->grid[c].floating)
            return true;
    return false;
}

/* At most what is left of a signal where its grid makes it, over w->least. */
static const double BELOW = 2;

/* Is what a fit leaves in a signal about what its grid makes?  Far less: the numbers are exact, and
 * happen to lie on a grid. */
static bool leaves_grid(const struct work *w, const struct refined *fit)
{
    const double EXACT = 1e-4;
    bool any = false;

    for (int g = 0; g < fit->groups && w->least != NULL && fit->noise != NULL; g++) {
        double left = fit->noise[g] * fit->noise[g];
        any |= left > EXACT * w->least[g] && left < BELOW * w->least[g];
    }
    return any;
}

/* Significant digits make their noise where the response is large, and enough poles may follow all
 * of it: fewer that leave it count as well. */
static bool grid_matters(const struct work *w)
{
    const struct order_choice *o = &w->choice;
    bool any = leaves_grid(w, &o->candidates[o->chosen].fit);

    for (int i = 0; i < o->count && !any && floats(w); i++)
        any = o->candidates[i].fit.poles < o->candidates[o->chosen].fit.poles
            && leaves_grid(w, &o->candidates[i].fit);
    return any;
}

/* Are all signals explained to the rounding of their samples?  Nothing is then left that could
 * change in the record, or be driven. */
static bool is_explained(const struct work *w, const struct identify_result *out)
{
    const struct refined *fit =
        w->choice.chosen >= 0 ? &w->choice.candidates[w->choice.chosen].fit : NULL;
    bool all = out->at_grid && fit != NULL && w->least != NULL && w->facts.converged;

    for (int g = 0; all && g < fit->groups; g++)
        all = fit->noise[g] * fit->noise[g] < BELOW * w->least[g];
    return all;
}

/* Rows up to the last in which some channel, as it was sent, is GRID_ABOVE steps from where it
 * ends. */
static int rows_above_grid(const struct work *w)
{
    const struct matrix *Y = &w->rec.Y;
    int rows = 0;

    if (w->rec.wide)
        return wide_rows_above(&w->rec.view, w->grid, GRID_ABOVE);
    for (int c = 0; c < Y->n; c++) {
        const double *y = Y->x + (size_t)c * Y->ld;
        double least = w->rec.scale[c] > 0 ? GRID_ABOVE * w->grid[c].step / w->rec.scale[c] : 0;
        if (w->rec.scale[c] > 0 && !grid_ends(&w->grid[c]))
            return Y->m;
        for (int k = Y->m - 1; k >= rows && w->rec.scale[c] > 0; k--)
            if (fabs(y[k] - y[Y->m - 1]) >= least)
                rows = k + 1;
    }
    return rows;
}

/* A response that has died away below the grid was rounded to nothing: no noise, but part of
 * itself, and longer records of it make the answer worse. */
static enum modal_status cut_below_grid(struct work *w, struct modal_error *err)
{
    int L = w->rec.Y.m,
        rows = w->rec.decimation == 1 && !w->opt.difference ? rows_above_grid(w) : L;

    rows = (rows + w->shift - 1) / w->shift * w->shift;
    if (rows > GRID_WORTH * L || rows < GRID_ROWS * w->shift)
        return MODAL_OK;
    pod_done(&w->pod);
    w->cut = rows;
    return record_cut(&w->rec, rows, w->opt.scale, err);
}

/* Once more, with a floor, where a fit without one came down to the grid: rounding is no white
 * noise, and more poles follow it. */
static enum modal_status analyse_above_grid(struct work *w, const struct batch *b,
                                            struct identify_result *out, struct modal_error *err)
{
    bool any = false;
    enum modal_status rc;

    if (!w->refine || w->choice.chosen < 0)
        return MODAL_OK;
    rc = find_grids(w, b, &any, err);
    if (rc != MODAL_OK || !any)
        return rc;
    rc = grid_noise(w, err);
    out->at_grid = rc == MODAL_OK && grid_matters(w);
    if (!out->at_grid) {
        free(w->least), w->least = NULL;
        return rc;
    }
    forget_analysis(w, out);
    w->spent = 0;                      /* what the first one spent was spent on rounding */
    rc = cut_below_grid(w, err);
    return rc == MODAL_OK ? analyse(w, out, err) : rc;
}

static void report_grids(const struct work *w, struct identify_result *out)
{
    for (int c = 0; c < w->rec.channels && c < SCREEN_CHANNELS && out->at_grid; c++) {
        bool said = w->grid[c].step == 0;
        for (int i = 0; i < out->diagnostic_count; i++)
            said |= strcmp(out->diagnostics[i].code, "quantised") == 0
                && out->diagnostics[i].channel == w->rec.channel[c];
        if (!said)
            identify_diagnose(out, "quantised", w->rec.channel[c],
                              "the values of channel %d %s%g, and what the modes "
                              "leave of them is no more than its rounding, %g: "
                              "whatever is smaller than half a step is not looked for",
                              w->rec.channel[c],
                              w->grid[c].floating ? "have few digits, in the root mean square "
                                                    "to steps of "
                                                  : "lie on a grid of ",
                              w->grid[c].step, w->grid[c].step / sqrt(12));
    }
    if (w->cut > 0)
        identify_diagnose(out, "ends_below_grid", -1,
                          "after %.6g s no channel is two steps of its grid from where it ends: "
                          "what was left of the response was rounded to nothing, and the rest of "
                          "the record is not used",
                          w->rec.t0 + w->cut * w->rec.step);
}

/* Once more, on channels weighed by the noise that the answer before left, until that settles. */
static enum modal_status analyse_weighed(struct work *w, struct identify_result *out,
                                         struct modal_error *err)
{
    for (int round = 0; round < WEIGH_MOST && worth_weighing(w); round++) {
        bool again;
        enum modal_status rc = weigh_channels(w, &again, err);
        if (rc != MODAL_OK || !again)
            return rc;
        w->spent = round == 0 ? 0 : w->spent;      /* what was spent on signals that noise hid */
        w->trial = false;
        if (round == 0)
            rc = keep_chosen(w, &out->unweighed, err);
        w->known = round == 0 && w->choice.clean && !w->choice.crowded;
        if (rc != MODAL_OK)
            return rc;
        forget_analysis(w, out);
        rc = analyse(w, out, err);
        if (rc != MODAL_OK)
            return rc;
    }
    return MODAL_OK;
}

/* The same, and what a trial did not end. */
static enum modal_status analyse_again(struct work *w, struct identify_result *out,
                                       struct modal_error *err)
{
    enum modal_status rc = analyse_weighed(w, out, err);

    if (rc != MODAL_OK || !w->trial || !w->facts.work_limit)
        return rc;
    w->trial = false, w->spent = 0;
    forget_analysis(w, out);
    rc = analyse(w, out, err);
    return rc == MODAL_OK ? analyse_weighed(w, out, err) : rc;
}

/* ---- the chosen poles with their errors ---- */

/* Steps over all channels until one is short; the last leaves its start in p->lambda and its end in
 * step->lambda.  Where they do not shrink the standard deviations are as long as the step that was
 * not believed. */
static enum modal_status step_wide(struct work *w, const bool *fixed, struct wide_step *step,
                                   struct modal_error *err)
{
    struct poles *p = &w->poles;
    double most = w->refine ? STEP_MOST : 0;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < STEPS && rc == MODAL_OK; i++) {
        rc = wide_refine(&w->rec.view, p->tau, p->lambda, p->count, fixed, most, step, err);
        if (rc != MODAL_OK || !step->taken || step->length <= STEP_SHORT)
            break;
        most = step->length / 2;
        memcpy(p->lambda, step->lambda, sizeof *p->lambda * p->count);
    }
    for (int j = 0; j < p->count && rc == MODAL_OK && w->refine && !step->taken; j++) {
        step->std_re[j] *= fmax(1, step->length);
        step->std_im[j] *= fmax(1, step->length);
    }
    return rc;
}

/* A wide batch: the step over all its channels, which also gives their coefficients. */
static enum modal_status refine_wide(struct work *w, struct modal_error *err)
{
    struct poles *p = &w->poles;
    int S = w->rec.channels, n = p->count;
    double *rest = calloc(S, sizeof *rest), *std = calloc(2 * (size_t)n + 1, sizeof *std), all = 0;
    double complex *lambda = calloc(n + 1, sizeof *lambda);
    bool *fixed = calloc(n + 1, sizeof *fixed);
    struct synthesis *f = &w->all;
    struct wide_step step = { lambda, std, std + n, NULL, rest, 0, false };
    enum modal_status rc;

    *f = (struct synthesis) { .poles = n, .order = poles_order(p->lambda, n, p->tau),
                              .rows = w->rec.Y.m, .channels = S };
    f->coefficient = step.coefficient = calloc((size_t)n * S + 1, sizeof *f->coefficient);
    f->channel_residual = calloc((size_t)S + 1, sizeof *f->channel_residual);
    f->reference = calloc(n + 1, sizeof *f->reference);
    if (rest == NULL || std == NULL || lambda == NULL || fixed == NULL || f->coefficient == NULL
        || f->channel_residual == NULL || f->reference == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles in %d channels", n,
                        S);
        goto out;
    }
    for (int j = 0; j < n; j++)
        fixed[j] = p->lambda[j] == 0;
    for (int c = 0; c < S && n == 0; c++)
        rest[c] = w->rec.scale[c];             /* no poles leave all of it */
    rc = n > 0 ? step_wide(w, fixed, &step, err) : MODAL_OK;
    for (int c = 0; rc == MODAL_OK && c < S; c++) {
        double over = w->rec.scale[c] > 0 ? 1 / w->rec.scale[c] : 0;
        for (int j = 0; j < n; j++)
            f->coefficient[j + (size_t)c * n] *= over;
        f->channel_residual[c] = rest[c] * over * sqrt(f->rows);
        all += f->channel_residual[c] * f->channel_residual[c];
    }
    f->residual = sqrt(all);
    for (int j = 0; rc == MODAL_OK && w->refine && j < n; j++)
        p->lambda[j] = lambda[j], p->std_re[j] = std[j], p->std_im[j] = std[n + j];
    p->fit = f;
out:
    free(rest), free(std), free(lambda), free(fixed);
    return rc;
}


/* At rounding, and yet a pole that is known to no more than nine digits: the arithmetic limits it,
 * not the data. */
static bool ill_determined(const struct work *w)
{
    const struct poles *p = &w->poles;
    bool ill = false;

    for (int j = 0; j < p->count; j++)
        ill |= p->lambda[j] != 0 && !(p->std_re[j] <= 1e-9 * cabs(p->lambda[j]));
    return ill && w->refine && !w->rec.wide
        && w->choice.candidates[w->choice.chosen].fit.residual
        <= 1e-12 * safe_matrix_norm(w->data.Y);
}

static enum modal_status take_poles(struct work *w, struct modal_error *err)
{
    static const struct refined none = { 0 };
    const struct refined *fit =
        w->choice.chosen >= 0 ? &w->choice.candidates[w->choice.chosen].fit : &none;
    const struct matrix *VT = w->projected ? &w->projection.VT : &w->pencil.VT;
    struct poles *p = &w->poles;
    int n = fit->poles, r = w->rank < VT->m ? w->rank : VT->m;
    enum modal_status rc = MODAL_OK;

    *p = (struct poles) { .count = n, .shift = w->shift, .tau = w->tau, .refined = w->refine };
    p->lambda = malloc(sizeof *p->lambda * (n + 1));
    p->std_re = malloc(sizeof(double) * (n + 1)), p->std_im = malloc(sizeof(double) * (n + 1));
    p->bar = malloc(sizeof(double) * (n + 1)), p->angle = malloc(sizeof(double) * (n + 1));
    p->growth = calloc((size_t)n + 1, sizeof *p->growth);
    if (p->growth == NULL || p->lambda == NULL || p->std_re == NULL || p->std_im == NULL
        || p->bar == NULL || p->angle == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles", n);
    for (int j = 0; j < n; j++) {
        p->lambda[j] = fit->lambda[j];
        p->std_re[j] = w->refine ? fit->std_re[j] : NAN;
        p->std_im[j] = w->refine ? fit->std_im[j] : NAN;
        p->bar[j] = NAN;
        p->angle[j] = projection_angle(VT, r, fit->lambda[j], w->tau);
    }
    if (ill_determined(w))
        rc = polish_poles(&w->data, p->lambda, n, p->std_re, p->std_im, err);
    if (rc == MODAL_OK && w->projected && n > 0) {
        int columns = w->shift > 1 || w->projection.n < 20 ? 1 : w->projection.n / 10;
        rc = projection_bars(&w->projection, r, columns, w->tau, p->lambda, n, p->bar, err);
    }
    if (w->rec.wide && rc == MODAL_OK)
        rc = refine_wide(w, err);
    return rc;
}

/* Does pole j stay below half a step in every channel? */
static bool below_grid(const struct work *w, const struct synthesis *f, int j)
{
    for (int c = 0; c < w->rec.channels; c++) {
        double size = cabs(f->coefficient[j + (size_t)c * f->poles]) * w->rec.scale[c],
               step = w->grid[c].step;
        if (step == 0 ? w->rec.scale[c] > 0 : size > step / 2)
            return false;
    }
    return true;
}

/* Growth that rounding makes. */
static void doubt_growth_below_grid(struct work *w, const struct synthesis *f)
{
    struct poles *p = &w->poles;

    for (int j = 0; j < p->count; j++)
        if (creal(p->lambda[j]) > 0 && below_grid(w, f, j))
            p->growth[j] = GROWTH_BELOW_GRID;
}

static enum modal_status weigh_by_digits(struct work *w, const struct batch *b,
                                         const struct synthesis *f, struct modal_error *err)
{
    struct poles *p = &w->poles;
    size_t first = (size_t)llround(w->rec.t0 / b->dt);
    struct digits_record r = { b->signals + first * b->channels,
                               b->channels,
                               w->rec.Y.m * w->rec.decimation,
                               w->rec.channels,
                               b->dt,
                               w->rec.channel,
                               w->rec.scale,
                               w->grid };
    double *factor = malloc(sizeof *factor * (size_t)p->count);
    enum modal_status rc = factor == NULL
        ? modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles", p->count)
        : digits_factors(&r, p->lambda, f, factor, err);

    for (int j = 0; j < p->count && rc == MODAL_OK; j++)
        p->std_re[j] *= factor[j], p->std_im[j] *= factor[j];
    free(factor);
    return rc;
}

/* Standard errors by all that is doubted. */
static enum modal_status widen(struct work *w, const struct batch *b,
                               const struct identify_result *out, struct modal_error *err)
{
    struct poles *p = &w->poles;
    struct synthesis own = { 0 };
    const struct synthesis *f = p->fit != NULL ? p->fit : &own;
    bool rounded = out->at_grid && w->shift == 1 && p->count > 0;
    enum modal_status rc = MODAL_OK;

    if (rounded && p->fit == NULL)
        rc = fit_signals(w, p->lambda, p->count, &w->rec.Y, &own, err);
    if (rc == MODAL_OK && rounded)
        rc = weigh_by_digits(w, b, f, err);
    if (rc == MODAL_OK)
        rc = widen_poles(&w->data, &w->choice, p, &w->facts.doubt, err);
    if (rc == MODAL_OK && rounded)
        doubt_growth_below_grid(w, f);
    synthesis_done(&own);
    return rc;
}

/* ---- what the ladder saw ---- */

static double pole_distance(double complex a, double complex b)
{
    return hypot(creal(a) - creal(b), fabs(cimag(a)) - fabs(cimag(b)));
}

/* The mode whose exponent a candidate's pole shows, within 1 % or five standard deviations; -1:
 * none. */
static int mode_of_pole(const struct work *w, const struct identify_result *r,
                        double complex lambda)
{
    double Omega = r->period > 0 ? 2 * M_PI / r->period : 0, nearest = HUGE_VAL;
    int which = -1;

    for (int i = 0; i < r->mode_count; i++) {
        const struct identify_mode *m = &r->modes[i];
        double std = m->std_re > 0 ? 5 * hypot(m->std_re, m->std_im) : 0,
               d = pole_distance(m->exponent, lambda);
        if (Omega > 0 && w->shift == 1) {
            double im = remainder(cimag(lambda), Omega);
            d = pole_distance(m->exponent, CMPLX(creal(lambda), im));
        }
        if (d <= fmax(std, 0.01 * frequency_of(m->exponent)) && d < nearest)
            nearest = d, which = i;
    }
    return which;
}

static enum modal_status report_ladder(struct work *w, struct identify_result *out,
                                       struct modal_error *err)
{
    const struct order_choice *c = &w->choice;
    int poles = 0, least = c->chosen >= 0 ? c->candidates[c->chosen].fit.order : 0;

    for (int i = 0; i < c->count; i++)
        poles += c->candidates[i].fit.poles;
    out->candidates = calloc(c->count + 1, sizeof *out->candidates);
    out->poles = calloc(poles + 1, sizeof *out->poles);
    if (out->candidates == NULL || out->poles == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d candidates", c->count);
    for (int i = 0; i < c->count; i++) {
        const struct refined *f = &c->candidates[i].fit;
        out->candidates[out->candidate_count++] =
            (struct identify_candidate){ f->order,
                                         f->bic,
                                         f->residual,
                                         c->candidates[i].refined && w->refine,
                                         refined_converged(f),
                                         i == c->chosen };
        for (int j = 0; j < f->poles; j++) {
            double complex z = f->lambda[j] + CMPLX(0, w->rec.shift_rad_s);
            out->poles[out->pole_count++] =
                (struct identify_pole){ f->order, z, w->refine ? f->std_re[j] : NAN,
                                        w->refine ? f->std_im[j] : NAN, mode_of_pole(w, out, z) };
        }
    }
    for (int m = 0; m < out->mode_count; m++) {
        int shown = 0, all = 0;
        for (int i = 0, at = 0; i < c->count; at += c->candidates[i++].fit.poles) {
            bool here = false;
            for (int j = 0; j < c->candidates[i].fit.poles; j++)
                here |= out->poles[at + j].mode == m;
            if (c->candidates[i].fit.order < least)
                continue;
            all++;
            shown += here;
        }
        out->modes[m].persistence = all > 1 ? (double)shown / all : NAN;
    }
    return MODAL_OK;
}

/* A multiplier of 1 that is no offset, in a periodic system: the orbit itself. */
static bool has_orbit(const struct work *w, const struct identify_result *r)
{
    bool found = false;

    for (int i = 0; i < r->mode_count && r->period > 0 && !w->opt.difference; i++) {
        const struct identify_mode *m = &r->modes[i];
        double bar = fmax(1e-9,
                          fmin(0.05,
                               3
                                   * (isfinite(m->std_multiplier) ? m->std_multiplier
                                          : isfinite(m->bar)      ? m->bar
                                                                  : 0)));
        found |=
            fabs(creal(m->multiplier) - 1) <= bar && cimag(m->multiplier) == 0 && m->energy > 0.01;
    }
    return found;
}

/* Has the strongest pole a neighbour with a shape of its own?  Poles of one mode share it. */
static bool shapes_differ(const struct synthesis *f, const double complex *lambda)
{
    int at = -1, n = f->poles;
    double most = 0, one = 1, aa = 0;

    for (int j = 0; j < n; j++) {
        double size = cblas_dznrm2(f->channels, f->coefficient + j, n);
        if (cimag(lambda[j]) != 0 && size > most)
            at = j, most = size;
    }
    aa = most * most;
    for (int j = 0; j < n && at >= 0; j++) {
        double complex ab;
        double bb = cblas_dznrm2(f->channels, f->coefficient + j, n);
        if (j == at || fabs(cimag(lambda[j]) / cimag(lambda[at]) - 1) > NEIGHBOUR)
            continue;
        cblas_zdotc_sub(f->channels, f->coefficient + at, n, f->coefficient + j, n, &ab);
        one = fmin(one, creal(ab * conj(ab)) / (aa * bb * bb));
    }
    return one < SAME_SHAPE;
}

/* Lines that the record resolves, in white noise, with shapes of their own: no one mode changes. */
static enum modal_status neighbours_beat(const struct work *w, bool *beat, struct modal_error *err)
{
    const struct poles *p = &w->poles;
    struct synthesis f = { 0 };
    enum modal_status rc;

    *beat = false;
    if (!w->choice.clean || w->choice.crowded || w->X->n < 2)
        return MODAL_OK;
    rc = fit_signals(w, p->lambda, p->count, w->X, &f, err);
    *beat = rc == MODAL_OK && shapes_differ(&f, p->lambda);
    synthesis_done(&f);
    return rc;
}

/* What a very long record's poles leave of it, where that was seen to be white noise when it was
 * searched; else 0. */
static double white_left(const struct work *w)
{
    if (!w->choice.clean || !w->choice.rest.known)
        return 0;
    return w->choice.candidates[w->choice.chosen].fit.residual / safe_matrix_norm(w->X);
}

/* Is one set of exponents the right model?  A mode that follows its amplitude is reported as one,
 * not as the crowd of poles that makes up for it. */
static enum modal_status doubt(struct work *w, struct identify_result *out, struct modal_error *err)
{
    struct poles *p = &w->poles;
    struct trend_input in = { w->X,
                              w->rec.step,
                              w->rec.t0,
                              p->lambda,
                              p->count,
                              w->rec.shift_rad_s / (2 * M_PI),
                              w->opt.cancelled,
                              w->opt.context,
                              white_left(w) };
    bool follows, beat;
    enum modal_status rc;

    if (!w->refine || w->shift > 1 || w->rec.period > 0 || is_explained(w, out))
        return MODAL_OK;
    rc = neighbours_beat(w, &beat, err);
    if (rc != MODAL_OK || beat)
        return rc;
    rc = trend_watch(&in, out, &follows, err);
    if (rc == MODAL_OK && follows && p->fit == NULL)
        rc = merge_crowds(&w->data, out->trend, out->trend_count, in.hertz, p, &w->facts.converged,
                          err);
    if (rc == MODAL_OK && follows)
        out->hankel_rank = poles_order(p->lambda, p->count, p->tau);
    return rc;
}

/* Is the fit that shows growth one that may be drawing something else: not at its least, leaving
 * noise, in need of many growing modes, or of a crowd where one line that drifts may be? Of that,
 * shapes tell more than one signal does.  Few modes draw nothing else to rounding. */
static bool growth_is_doubtful(const struct work *w, const struct trend_input *in,
                               const struct identify_result *r)
{
    return !w->facts.doubt.exact
        && (!w->facts.converged || w->facts.doubt.colour > 1 || w->facts.doubt.contradiction > 1
            || w->facts.doubt.rivals || verdict_crowd_grows(r)
            || (w->X->n < 2 && trend_crowds(in, r->modes[r->decides].exponent)));
}

/* Where it is, parts of the record must show growth for themselves. */
static enum modal_status confirm_growth(struct work *w, struct identify_result *out,
                                        struct modal_error *err)
{
    struct trend_input in = { w->X, w->rec.step, w->rec.t0, w->poles.lambda, w->poles.count,
                              w->rec.shift_rad_s / (2 * M_PI), w->opt.cancelled, w->opt.context,
                              0 };
    bool shown = true;
    enum modal_status rc = MODAL_OK;

    if (out->verdict == VERDICT_UNSTABLE && w->refine && w->shift == 1 && w->rec.period <= 0
        && growth_is_doubtful(w, &in, out))
        rc = trend_growth(&in, out, &shown, err);
    if (rc != MODAL_OK || shown)
        return rc;
    out->verdict = VERDICT_UNDECIDED;
    identify_diagnose(
        out, "growth_unconfirmed", -1,
        "mode %d (%.5g Hz) grows in the fit to the whole record, which does not hold throughout, "
        "and no part of the record grows for itself: a motion "
        "set off anew (an impact, a load that changes) looks so; identify a part by `window`",
        out->decides, cabs(out->modes[out->decides].exponent) / (2 * M_PI));
    return MODAL_OK;
}

/* Where poles nearly coalesce their parts are far larger than their sum,
 * and so is what rounding leaves. */
static bool at_rounding_of_parts(const struct work *w, const struct identify_result *r)
{
    const double ROUNDINGS = 16;
    double parts = 0;

    for (int i = 0; i < r->mode_count; i++)
        parts += r->modes[i].amplitude * r->modes[i].amplitude;
    return w->choice.chosen >= 0 && w->choice.candidates[w->choice.chosen].fit.residual
        <= ROUNDINGS * DBL_EPSILON * sqrt(parts) * safe_matrix_norm(w->data.Y);
}

static enum modal_status conclude(struct work *w, const struct batch *batch,
                                  struct identify_result *out, struct modal_error *err)
{
    double duration = w->data.Y->m * w->tau;
    enum modal_status rc = verdict_clusters(out, duration, err);

    if (rc != MODAL_OK)
        return rc;
    w->facts.converged |= at_rounding_of_parts(w, out);
    if (w->refine && w->shift == 1 && w->rec.period <= 0)
        trend_mark_harmonics(out);
    verdict_stability(out, duration);
    if ((rc = confirm_growth(w, out, err)) != MODAL_OK)
        return rc;
    w->facts.rows = w->data.Y->m;
    w->facts.record = duration;
    w->facts.tau = w->tau;
    w->facts.orbit = has_orbit(w, out);
    w->facts.below = w->rec.below;
    diagnose(out, &w->facts);
    screen_samples(batch, out);
    report_grids(w, out);
    if (w->refine && w->shift == 1 && w->rec.period <= 0)
        trend_of_modes(w->X->m * w->rec.step, out);
    if (!w->facts.converged || out->driven)
        verdict_withhold(out);
    return MODAL_OK;
}

/* What is proposed, and that it was not used. */
static void report_window(struct work *w, struct identify_result *out)
{
    const double *t = w->rec.proposed;
    bool automatic = w->opt.window[0] == WINDOW_AUTO;

    if (!automatic && is_explained(w, out))
        return;
    memcpy(out->proposed, t, sizeof out->proposed);
    if (automatic)
        memcpy(w->opt.window, t, sizeof w->opt.window);
    if (!automatic && t[1] > 0)
        identify_diagnose(out, "not_free_throughout", -1, "only %.6g to %.6g s of the record are "
                          "one free response: what comes before is quiet, or driven; "
                          "`-o window=auto` identifies that part alone", t[0], t[1]);
}

static void report_settings(struct work *w, struct identify_result *out)
{
    report_window(w, out);
    out->period = w->rec.period;
    out->dt = w->rec.step;
    out->decimation = w->rec.decimation;
    out->shift = w->shift;
    out->samples = w->shift > 1 ? w->data.Y->m * w->shift : w->rec.Y.m;
    out->freedom = w->data.Y->m - w->facts.order;
    out->rule = w->opt.rank.rule;
    w->opt.rows = out->rows, w->opt.columns = out->columns;
    w->opt.refine = w->refine ? CHOICE_YES : CHOICE_NO;
    w->opt.period = w->rec.period;
    out->used = w->opt;
    out->used.channels = NULL, out->used.clock = NULL, out->used.cancelled = NULL,
    out->used.context = NULL;
}

/* What modes_report would read all rows of a very long record for. */
static enum modal_status fit_long(struct work *w, struct modal_error *err)
{
    struct poles *p = &w->poles;
    enum modal_status rc;

    if (w->data.blocks == NULL || w->data.blocks->Y.x != w->rec.Y.x || p->fit != NULL)
        return MODAL_OK;
    rc = fit_signals(w, p->lambda, p->count, &w->rec.Y, &w->all, err);
    p->fit = rc == MODAL_OK ? &w->all : NULL;
    return rc;
}

enum modal_status modal_identify(const struct batch *batch, const struct identify_options *options,
                                 struct identify_result *out, struct modal_error *err)
{
    static const struct identify_options defaults = { 0 };
    struct work w = { .opt = options != NULL ? *options : defaults,
                      .facts = { .converged = true } };
    enum modal_status rc;

    memset(out, 0, sizeof *out);
    if (w.opt.response != RESPONSE_FREE) {
        rc = w.opt.response == RESPONSE_FORCED ? forced_identify(batch, &w.opt, out, err)
                                               : ambient_identify(batch, &w.opt, out, err);
        goto out;
    }
    w.refine = w.opt.refine == CHOICE_YES
        || (w.opt.refine == CHOICE_DEFAULT && w.opt.method == IDENTIFY_AUTO);
    w.clock = w.opt.clock != NULL ? w.opt.clock(w.opt.context) : 0;
    if ((rc = check_options(&w.opt, err)) != MODAL_OK
        || (rc = record_make(batch, &w.opt, &w.rec, err)) != MODAL_OK
        || (rc = check_pod_rank(&w, err)) != MODAL_OK
        || (rc = choose_shift(&w, err)) != MODAL_OK
        || (rc = stage(&w, "read", out, err)) != MODAL_OK)
        goto out;
    w.trial = may_weigh(&w) && w.rec.channels <= POD_CHANNELS_FEW;
    if ((rc = analyse(&w, out, err)) != MODAL_OK
        || (rc = analyse_above_grid(&w, batch, out, err)) != MODAL_OK
        || (rc = analyse_again(&w, out, err)) != MODAL_OK
        || (rc = keep_chosen(&w, &out->chosen, err)) != MODAL_OK
        || (rc = take_poles(&w, err)) != MODAL_OK
        || (rc = widen(&w, batch, out, err)) != MODAL_OK)
        goto out;
    report_settings(&w, out);
    if ((rc = doubt(&w, out, err)) != MODAL_OK
        || (rc = fit_long(&w, err)) != MODAL_OK
        || (rc = modes_report(&w.rec, &w.poles, &w.opt, out, err)) != MODAL_OK
        || (rc = stage(&w, "synthesis", out, err)) != MODAL_OK
        || (rc = report_ladder(&w, out, err)) != MODAL_OK
        || (rc = conclude(&w, batch, out, err)) != MODAL_OK
        || (rc = stage(&w, "verdict", out, err)) != MODAL_OK)
        goto out;
out:
    work_done(&w);
    if (rc != MODAL_OK)
        identify_result_done(out);
    return rc;
}
