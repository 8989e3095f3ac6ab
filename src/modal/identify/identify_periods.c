/* identify_periods.c - from periods to the multipliers of a periodic system: from above, from many
 * starts, in noise made white from sample to sample */
#include "modal/identify/identify_state.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/order/another.h"
#include "modal/identify/order/remainder.h"
#include "modal/identify/order/whiten.h"
#include "modal/linalg/eigen.h"
#include "modal/linalg/svd.h"

static const double
    SAME = 1;                   /* of -2 ln(likelihood): searches no further apart ended at one */

enum {
    FOLDED_MOST = 4 * TRIPLETS_MOST,    /* directions that are asked for whole: their decomposition
                                         * is as dear as some steps of a refinement */
    MORE = 4,                    /* times as many directions: three pencils at most */
    ANEW_MOST = 6                /* searches beside the first: the fifth saw the noise as it is in
                                  * all records tried */
};

static bool at_rounding(const struct work *w, const struct order_choice *k)
{
    return k->chosen >= 0
        && k->candidates[k->chosen].fit.residual <= REFINE_EXACT * safe_matrix_norm(w->data.Y);
}

/* Periods are few and each has many samples: a pencil of a few periods' height, whose columns are
 * nearly as many as the periods, sees all multipliers at once. One height errs where another does
 * not, and poles from too many directions where fewer lead: (height, share of directions; 0: those
 * above the edge of the noise, which in white noise lead to the same end for a tenth of the work of
 * all; they are all that is asked of pencils with more than TRIPLETS_MOST). */
static const struct { double height, directions; } STARTS[] = {
    { 1 / 4.0, 0 }, { 1 / 8.0, 0 }, { 0, 0 }, { 0, 1 }, { 1 / 8.0, 1 }, { 1 / 4.0, 1 },
    { 0, 5 / 6.0 }, { 1 / 8.0, 5 / 6.0 }, { 1 / 4.0, 5 / 6.0 }, { 0, 2 / 3.0 },
    { 1 / 8.0, 2 / 3.0 }, { 1 / 4.0, 2 / 3.0 }
};

/* What the search has come to. */
struct ends {
    int again;                  /* how often others ended at the best, beside the first */
    bool told;                  /* the order of all these is the number of signals of their pencils:
                                 * two ways to count that have little in common */
};

/* Triplets above the edge of the noise that those after them are (pencil_signals(), where all there
 * are were asked). */
static int signals_of_all(const struct pencil *p)
{
    double rest = 0, edge = PENCIL_EDGE * (1 / sqrt(p->height) + 1 / sqrt(p->columns));
    int count = 0;

    for (int i = 0; i < p->count; i++)
        rest += p->s[i] * p->s[i];
    for (; count < p->count && p->s[count] > edge * sqrt(fmax(rest, 0)); count++)
        rest -= p->s[count] * p->s[count];
    return count;
}

/* No order has more poles than rows tell of. */
static int folded_most(const struct work *w)
{
    int rows = work_rows_allow(w), sparing = work_sparing_order(w);

    return !w->data.exact && sparing < rows ? sparing : rows;
}

static enum modal_status descend_from(struct work *w, const struct order_source *source,
                                      struct order_choice *choice, struct modal_error *err)
{
    struct order_options opt = { .order_most = folded_most(w), .many = true,
                                 .work = work_left(w, false, w->brief),
                                 .renewed = source->known != NULL,
                                 .cancelled = w->opt.cancelled, .context = w->opt.context };
    enum modal_status rc = order_from_above(&w->data, source, &opt, choice, err);

    w->spent += rc == MODAL_OK ? choice->work : 0;
    return rc;
}

/* From w->pencil downwards, from the SHARE of so many directions. */
static enum modal_status descend_folded(struct work *w, int count, double share,
                                        struct order_choice *choice, struct modal_error *err)
{
    struct order_source source = { .poles = work_pencil_source, .context = w };
    int most = folded_most(w);

    count = count < w->pencil.count ? count : w->pencil.count;
    count = count < most ? count : most;
    source.most = (int)ceil(share * count);
    return descend_from(w, &source, choice, err);
}

/* The better of two searches into *BEST, and how they ended; SIGNALS of the other's pencil. */
static void keep_better(struct order_choice *best, struct order_choice *other, int signals,
                        struct ends *ends)
{
    double gain = work_bic_chosen(best) - work_bic_chosen(other);
    struct order_choice worse = *other;
    bool same = isfinite(gain) && fabs(gain) < SAME,
         told = other->clean && other->candidates[other->chosen].fit.order == signals;

    if (same)
        *ends = (struct ends) { ends->again + 1, ends->told && told };
    else if (gain > 0)
        *ends = (struct ends) { 0, told };
    if (gain > 0)
        worse = *best, *best = *other;
    order_done(&worse);
    *other = (struct order_choice) { .chosen = -1 };
}

/* As remainder_of() has it; without a FIT (NULL) all is noise, each signal's of its own size. */
static enum modal_status rest_of(const struct work *w, const struct refined *fit, struct matrix *E,
                                 struct modal_error *err)
{
    const struct matrix *Y = w->data.Y;
    int phases = w->data.phases;

    if (fit != NULL)
        return remainder_of(&w->data, fit, E, err);
    *E = matrix_new(Y->m, Y->n);
    if (E->x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d periods", Y->m);
    matrix_copy(Y->m, Y->n, Y->x, Y->ld, E->x, E->ld);
    for (int c = 0; c < Y->n; c += phases) {
        double *x = E->x + (size_t)c * (size_t)E->ld;
        size_t count = (size_t)Y->m * (size_t)phases;
        double rms = safe_norm(x, count) / sqrt((double)count);
        for (size_t i = 0; i < count && rms > 0; i++)
            x[i] /= rms;
    }
    return MODAL_OK;
}

/* The share of its columns in which what FIT leaves is free (whiten.h): 1 where chance may be all;
 * next to nothing where rows are too few to tell. */
static enum modal_status white_share(const struct work *w, const struct refined *fit, double *share,
                                     struct modal_error *err)
{
    struct matrix E = { 0 };
    int free_rows = w->data.Y->m - (fit != NULL ? fit->order : 0);
    double spread = 0;
    enum modal_status rc = rest_of(w, fit, &E, err);

    if (rc == MODAL_OK && E.x != NULL)
        rc = noise_spread(&E, free_rows, &spread, err);
    *share = spread > 1 + NOISE_CHANCE / free_rows ? 1 / spread : 1;
    if (spread > 0 && free_rows <= NOISE_CHANCE)
        *share = DBL_EPSILON;
    free(E.x);
    return rc;
}

/* Is the least singular value there is more than squares lose? */
static bool noise_shows(const struct work *w)
{
    const struct projection *p = &w->projection;

    return p->count > 0 && p->s[p->count - 1] > PENCIL_SQUARES * p->s[0];
}

/* w->pencil of so much height: of many periods few directions are asked for first, MORE times as
 * many as long as signals fill half of them. */
static enum modal_status pencil_folded(struct work *w, const struct matrix *Y,
                                       const struct matrix *products, int height,
                                       struct modal_error *err)
{
    int all = Y->m - height, most = all <= FOLDED_MOST ? all : TRIPLETS_MOST;
    struct lanczos *run = NULL;
    struct pencil_options how = { .rows = height, .products = products, .run = &run,
                                  .wanted = all <= TRIPLETS_MOST ? all : TRIPLETS_FIRST };
    enum modal_status rc = pencil_new(Y, &how, &w->pencil, err);

    while (rc == MODAL_OK && how.wanted < most && pencil_signals(&w->pencil) > how.wanted / 2) {
        how.wanted = MORE * how.wanted < most ? MORE * how.wanted : most;
        pencil_done(&w->pencil);
        rc = pencil_new(Y, &how, &w->pencil, err);
    }
    lanczos_free(run);
    return rc;
}

/* The periods that a pencil reads: those that are fitted, few channels weighed by their noise
 * (work_searched). */
static enum modal_status searched_periods(const struct work *w, struct matrix *Y,
                                          struct modal_error *err)
{
    const struct matrix *from = w->data.Y;
    size_t L = (size_t)from->m;
    bool weigh = work_searched(w) == &w->weighted;

    *Y = (struct matrix) { from->m, from->n, from->m, malloc(L * (size_t)from->n * sizeof *Y->x) };
    if (Y->x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d periods", from->m);
    for (int c = 0; c < from->n; c++) {
        memcpy(Y->x + (size_t)c * L, from->x + (size_t)c * (size_t)from->ld, L * sizeof *Y->x);
        cblas_dscal(from->m, weigh ? w->weight[c / w->shift] : 1, Y->x + (size_t)c * L, 1);
    }
    return MODAL_OK;
}

/* The signals are made white as far as what FIT leaves tells them not to be, by more than LEAST of
 * -2 ln(likelihood) (whiten.h), which may cost a period.  *changed: they were not. */
static enum modal_status whiten_left(struct work *w, const struct refined *fit, double least,
                                     bool *changed, struct modal_error *err)
{
    struct matrix E = { 0 };
    struct periods all = { &w->folded, w->shift, w->samples };
    double told = 0;
    enum modal_status rc = remainder_of(&w->data, fit, &E, err);

    if (rc == MODAL_OK && E.x != NULL)
        rc = whiten_periods(&all, &E, fit->order, least, &told, err);
    w->samples = all.samples;
    w->facts.told = 1 - (1 - w->facts.told) * (1 - told);
    *changed = told > 0;
    free(E.x);
    return rc;
}

/* -2 ln(likelihood) that a pair of multipliers must gain which are none. */
static double least_gain(const struct work *w)
{
    double S = w->data.Y->n;

    return criterion_noise_pair(S, 1, S * w->data.Y->m);
}

/* Before any fit: a first search in noise taken for white, correlated by 0.9, ends only where all
 * its work is spent, and what it draws tells little of the noise. */
static enum modal_status begin_white(struct work *w, struct modal_error *err)
{
    struct periods all = { &w->folded, w->shift, w->samples };
    enum modal_status rc = whiten_first(&all, work_searched(w) == &w->weighted ? w->weight : NULL,
                                        least_gain(w), &w->facts.told, err);

    w->samples = all.samples;
    return rc;
}

/* Is what the best leaves not white within a period, by more than a pair of multipliers that do
 * not pay could make it?  Then the signals are made so, and the best is none. */
static enum modal_status begin_whiter(struct work *w, struct order_choice *best, bool *anew,
                                      struct modal_error *err)
{
    enum modal_status rc = whiten_left(w, &best->candidates[best->chosen].fit, least_gain(w), anew,
                                       err);

    if (*anew) {
        order_done(best);
        *best = (struct order_choice) { .chosen = -1 };
    }
    return rc;
}

/* What whitened the signals knew them by a fit with other poles, and errors go with the noise near
 * them: both anew until they agree. */
static enum modal_status settle_white(struct work *w, struct order_choice *best,
                                      struct modal_error *err)
{
    struct refine_options opt = { .settle = true };
    struct order_candidate *k = &best->candidates[best->chosen];
    bool changed = true;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < ANEW_MOST && rc == MODAL_OK && changed && !best->offset; i++) {
        struct refined fit;
        rc = whiten_left(w, &k->fit, 0, &changed, err);
        if (rc != MODAL_OK || !changed)
            break;
        rc = refine_poles(&w->data, k->fit.lambda, k->fit.poles, NULL, &opt, &fit, err);
        if (rc != MODAL_OK)
            break;
        refined_done(&k->fit);
        k->fit = fit;
    }
    return rc;
}

/* One start: a pencil of Y, products K, and from there downwards. */
static enum modal_status start_folded(struct work *w, const struct matrix *Y,
                                      const struct matrix *K, int height, double share,
                                      struct order_choice *best, struct ends *ends,
                                      struct modal_error *err)
{
    bool whole = Y->m - height <= TRIPLETS_MOST;
    struct order_choice other = { .chosen = -1 };
    int signals = 0, count;
    enum modal_status rc = pencil_folded(w, Y, K->x != NULL ? K : NULL, height, err);

    if (rc == MODAL_OK) {
        signals = whole ? signals_of_all(&w->pencil) : pencil_signals(&w->pencil);
        count = whole && share > 0 ? w->pencil.count : signals + ORDER_AHEAD;
        rc = descend_folded(w, count, share > 0 ? share : 1, &other, err);
    }
    pencil_done(&w->pencil);
    if (rc == MODAL_OK)
        keep_better(best, &other, signals, ends);
    return rc;
}

/* Periodic systems from above, from one start after another until three end at the same best, or
 * two whose order their pencils tell as well, or the signals are explained to rounding. */
enum modal_status work_descend_periods(struct work *w, struct order_choice *best,
                                       struct modal_error *err)
{
    struct matrix Y = { 0 }, K = { 0 };
    struct pencil kept = w->pencil;
    struct ends ends = { 0 };
    bool ended = false;
    enum modal_status rc = searched_periods(w, &Y, err);

    if (rc == MODAL_OK && noise_shows(w) && pencil_products_pay(Y.m, Y.n))
        rc = pencil_products(&Y, &K, err);
    for (size_t i = 0; i < sizeof STARTS / sizeof *STARTS && rc == MODAL_OK && !ended; i++) {
        int height = fmax(2, STARTS[i].height * Y.m);
        if (Y.m - height < 1)
            break;                            /* periods too few for any; the ladder says so */
        if (STARTS[i].directions == 0 && Y.m - height > TRIPLETS_MOST)
            continue;                         /* no others are asked for */
        rc = start_folded(w, &Y, &K, height, STARTS[i].directions, best, &ends, err);
        ended = (ends.again > (ends.told ? 0 : 1) || at_rounding(w, best)) && best->clean;
    }
    if (rc == MODAL_OK && work_bic_chosen(best) >= work_bic_of_nothing(&w->data)) {
        order_done(best);
        *best = (struct order_choice) { .chosen = -1 };
    }
    w->pencil = kept;
    free(Y.x), free(K.x);
    return rc;
}

/* A pole beside those of the best that is worth its price, which no start led to: as long as there
 * is one it is added. */
static enum modal_status add_another(struct work *w, struct order_choice *best,
                                     struct modal_error *err)
{
    bool more = best->chosen >= 0 && !best->offset;
    enum modal_status rc = MODAL_OK;

    while (more && rc == MODAL_OK) {
        struct refined *fit = &best->candidates[best->chosen].fit;
        struct another a;
        if (fit->order + 2 > folded_most(w))
            break;
        rc = another_pole(&w->data, fit, &a, err);
        more = rc == MODAL_OK && a.fit.poles > 0 && a.fit.bic < fit->bic;
        if (more) {
            struct refined old = *fit;
            *fit = a.fit, a.fit = old;
        }
        refined_done(&a.fit);
    }
    return rc;
}

/* Noise is taken for white in all columns first: a model too large leaves what shows that it is
 * not.  Then the search is begun anew with what it is, the better seen the less of it is drawn. */
enum modal_status work_choose_periodic(struct work *w, struct order_choice *best,
                                       struct modal_error *err)
{
    double share = 1, before = 1, spent = w->spent;
    int L = w->data.Y->m, S = w->data.Y->n;
    bool anew, brief;
    enum modal_status rc = MODAL_OK;

    w->data.exact = w->facts.full_rank < w->projection.count;
    if (!w->data.exact && noise_shows(w) && (L < S ? L : S) <= FOLDED_MOST)
        rc = begin_white(w, err);
    w->brief = brief = w->facts.told > 0;
    if (rc == MODAL_OK)
        rc = work_descend_periods(w, best, err);
    w->brief = false;
    for (int i = 0; i < ANEW_MOST && rc == MODAL_OK && best->chosen >= 0 && !w->data.exact; i++) {
        rc = begin_whiter(w, best, &anew, err);
        if (rc == MODAL_OK && !anew)
            rc = white_share(w, &best->candidates[best->chosen].fit, &share, err);
        if (rc != MODAL_OK || (!anew && share >= before && (!brief || best->clean)))
            break;
        brief = false;
        w->data.white = before = anew ? 1 : share;
        order_done(best);
        *best = (struct order_choice) { .chosen = -1 };
        w->spent = spent;                            /* what a wrong price cost is no search */
        rc = work_descend_periods(w, best, err);
    }
    if (rc == MODAL_OK && w->facts.told > 0 && best->chosen >= 0)
        rc = settle_white(w, best, err);
    else if (rc == MODAL_OK && !w->data.exact && share >= 1)
        rc = add_another(w, best, err);
    return rc;
}

/* Is what FIT (NULL: none) leaves white in all columns, and from sample to sample, so that no
 * search would begin anew with other noise? */
static enum modal_status noise_is_white(const struct work *w, const struct refined *fit,
                                        bool *white, struct modal_error *err)
{
    struct matrix E = { 0 }, Y = matrix_new(w->folded.m, w->folded.n);
    struct periods copy = { &Y, w->shift, w->samples };
    double share = 0, told = 1;
    enum modal_status rc = Y.x != NULL ? white_share(w, fit, &share, err)
                                       : modal_fail(err, MODAL_NO_MEMORY,
                                                    "identify: no memory for %d periods", Y.m);

    if (rc == MODAL_OK && share >= 1)
        rc = rest_of(w, fit, &E, err);
    if (rc == MODAL_OK && E.x != NULL) {
        matrix_copy(Y.m, Y.n, w->folded.x, w->folded.ld, Y.x, Y.ld);
        rc = whiten_periods(&copy, &E, fit != NULL ? fit->order : 0, least_gain(w), &told, err);
    }
    *white = rc == MODAL_OK && share >= 1 && told == 0;
    free(E.x), free(Y.x);
    return rc;
}

/* The pole that the signals show most of. */
static enum modal_status strongest_of_all(const struct work *w, double complex *lambda,
                                          struct modal_error *err)
{
    struct matrix E = { 0 };
    double chi2;
    enum modal_status rc = rest_of(w, NULL, &E, err);

    if (rc == MODAL_OK)
        rc = remainder_peak(&E, w->data.tau, lambda, &chi2, err);
    free(E.x);
    return rc;
}

enum modal_status work_try_known(struct work *w, struct order_choice *best, bool *found,
                                 struct modal_error *err)
{
    double complex strongest = 0;
    struct order_source source = { .known = w->opt.known->lambda,
                                   .known_count = w->opt.known->count };
    const struct refined *fit = NULL;
    bool pays = false;
    enum modal_status rc = MODAL_OK;

    *found = false;
    if (source.known_count == 0) {                   /* still none, unless this one pays */
        rc = strongest_of_all(w, &strongest, err);
        source.known = &strongest, source.known_count = 1;
    }
    if (rc == MODAL_OK)
        rc = descend_from(w, &source, best, err);
    pays = rc == MODAL_OK && best->clean && work_bic_chosen(best) < work_bic_of_nothing(&w->data);
    if (pays)
        fit = &best->candidates[best->chosen].fit;
    if (rc == MODAL_OK && (pays || w->opt.known->count == 0))
        rc = noise_is_white(w, fit, found, err);
    if (!*found || !pays) {
        order_done(best);
        *best = (struct order_choice) { .chosen = -1 };
    }
    if (!*found)
        w->spent = 0;                                /* what is tried first is no search's cost */
    return rc;
}
