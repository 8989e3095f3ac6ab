/* identify_order.c - from a decomposition to the poles of an order: from above, by the ladder, and
 * of a very long record from its head on */
#include "modal/identify/identify_state.h"
#include "modal/identify/linear/rank.h"
#include <cblas.h>
#include <float.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/order/whiten.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/order/remainder.h"
#include "modal/identify/prepare/fold.h"
#include "modal/linalg/svd.h"

enum {
    LONG = 4096,                        /* rows: a fit costs L r^2, so that triplets */
    TRIPLETS_LONG = 32                  /* of longer records end earlier */
};
static const double
    LOW_BIC = 20,                       /* odds of e^10 that more poles are there, */
    LOW_LEFT = 0.7;                     /* which leave half of the energy that fewer did */

/* Where signals say that there are many modes. */
static const double
    EVALUATIONS_MANY = 64,              /* of all of them, as a search takes that begins near its
                                         * end; */
    EVALUATIONS_FAR = 1024;             /* and one that begins far from it, as where modes overlap:
                                         * 100 in 4000 x 20 take over 512, */

static enum modal_status projection_source(void *context, int r, double complex *lambda, int *count,
                                           struct modal_error *err)
{
    struct work *w = context;
    int dropped = 0;
    double start = work_clock(w);
    enum modal_status rc =
        projection_poles(&w->projection, w->opt.method, r, w->tau, lambda, count, &dropped, err);

    if (r == w->opt.rank.fixed)
        w->facts.dropped = dropped;
    w->eigenvalues += work_clock(w) - start;
    return rc;
}

/* How far the ladder goes: no more than the singular values above rounding, the rows there are less
 * a few (with fewer left over, any exponents reconstruct noise), or what was allowed. */
static int order_most(const struct work *w)
{
    int most = w->projected ? w->projection.count : w->pencil.count;

    if (most > w->facts.full_rank)
        most = w->facts.full_rank;
    if (most > w->data.Y->m - 1)
        most = w->data.Y->m - 1;
    if (w->opt.rank.rule == RANK_AUTO && most > work_rows_allow(w))
        most = work_rows_allow(w);
    if (w->opt.rank.most > 0 && most > w->opt.rank.most)
        most = w->opt.rank.most;
    return most < IDENTIFY_ORDER_MOST ? most : IDENTIFY_ORDER_MOST;
}

/* BIC is an expansion for many data: where unknowns nearly exhaust them it prefers to interpolate
 * noise.  An order beyond the sparing one is believed only if it reaches rounding. */
static bool overfitted(const struct work *w)
{
    const struct refined *fit =
        w->choice.chosen >= 0 ? &w->choice.candidates[w->choice.chosen].fit : NULL;

    return fit != NULL && fit->order > work_sparing_order(w)
        && fit->residual > REFINE_EXACT * safe_matrix_norm(w->data.Y);
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

/* Does noise drive this record, or begins a very long one with what is no free response? Then there
 * is no set of modes for a search to end at, what drives it has signals without end, and all of the
 * work there may be was spent on them. */
static bool driven(const struct work *w)
{
    bool begins = w->rec.proposed[1] > 0 && !w->rec.parted;

    return w->ragged > 0 || (begins && w->X->m > RECORD_PARTED);
}

/* The ladder within what is left of the work; a rank that was given is refined to its end. */
static enum modal_status climb(struct work *w, const struct order_source *source,
                               struct order_options *opt, struct modal_error *err)
{
    enum modal_status rc;

    /* a ladder of a long record that is near the number of triplets is not refined before they are
     * doubled; it is thrown away, and costs seconds */
    opt->cut = w->data.Y->m > RECORD_PARTED && more_triplets(w) ? w->pencil.count : 0;
    opt->work = w->opt.rank.rule != RANK_AUTO ? 0
              : work_left(w, w->trial || driven(w), w->data.Y->m > RECORD_PARTED);
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
        || c->fit.residual <= REFINE_EXACT * safe_matrix_norm(w->data.Y);
    out->hankel_rank = c->fit.order;
}

/* How far a search for the modes of an order that is told may go before it comes back to it. */
static int order_beyond(int told)
{
    int most = told + 2 * ORDER_AHEAD;

    return most < IDENTIFY_ORDER_MOST ? most : IDENTIFY_ORDER_MOST;
}

static enum modal_status choose_order(struct work *w, struct identify_result *out,
                                      struct modal_error *err)
{
    struct order_source source = { .most = order_most(w), .context = w,
                                   .poles = w->projected ? projection_source
                                                         : work_pencil_source };
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
    if (opt.fixed > 0 && !w->projected)
        source.signals = pencil_signals(&w->pencil);
    if (opt.fixed > 0 && w->known)
        source.known = out->unweighed.lambda, source.known_count = out->unweighed.count;
    opt.look = before_gap(w);
    opt.no_offset = !w->refine;
    opt.thorough = w->shift > 1;
    opt.order_most = w->opt.rank.rule == RANK_AUTO ? work_rows_allow(w)
                   : w->projected                  ? 0
                                                   : order_beyond(opt.fixed);
    rc = climb(w, &source, &opt, err);
    if (rc == MODAL_OK && w->opt.rank.rule == RANK_AUTO && overfitted(w)) {
        opt.order_most = work_sparing_order(w);
        /* splitting poles may have gone beyond the triplets there are */
        if (source.most > opt.order_most)
            source.most = opt.order_most;
        rc = climb(w, &source, &opt, err);
    }
    if (rc == MODAL_OK && w->choice.chosen >= 0 && !w->choice.cut && w->opt.rank.rule == RANK_AUTO
        /* modes must be worth more than none */
        && w->choice.candidates[w->choice.chosen].fit.bic >= work_bic_of_nothing(&w->data))
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
    struct order_options opt = { .order_most = work_rows_allow(w), .cancelled = w->opt.cancelled,
                                 .context = w->opt.context };
    struct order_source source = { .most = order_most(w), .signals = pencil_signals(&w->pencil),
                                   .poles = work_pencil_source, .context = w };
    const struct identify_chosen *begin = begins_at(w, out);
    int many = source.signals;
    double one;
    enum modal_status rc;

    if (begin != NULL) {
        many = poles_order(begin->lambda, begin->count, w->tau);
        source.most = source.signals = 0;
        source.known = begin->lambda, source.known_count = begin->count;
    } else {
        opt.look = before_gap(w);
    }
    opt.work = work_left(w, w->trial, false);
    opt.many = w->many || source.known != NULL;
    opt.seen = w->seen_rows;
    one = refine_work(&w->data, many);
    if (opt.many)
        opt.work = fmax(opt.work, fmax(EVALUATIONS_MANY * one,
                                       fmin(EVALUATIONS_FAR * one, WORK_MANY) - w->descents));
    rc = order_from_above(&w->data, &source, &opt, &w->choice, err);
    w->descents += rc == MODAL_OK ? w->choice.work : 0;
    if (rc != MODAL_OK || w->choice.chosen < 0)
        return rc;
    if (w->choice.candidates[w->choice.chosen].fit.bic >= work_bic_of_nothing(&w->data)
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
    w->facts.work_limit = w->many && w->choice.limited;
    note_chosen(w, out);
    return work_report_values(w, out, err);
}

/* Constant systems from above.  What interpolates noise is left out: above->choice is empty. */
static enum modal_status choose_from_above(struct work *w, struct identify_result *out,
                                           struct found *above, struct modal_error *err)
{
    struct pencil few = w->pencil, all;
    enum modal_status rc;

    if (!w->refine || w->opt.method != IDENTIFY_AUTO || w->opt.rank.rule != RANK_AUTO
        || w->opt.rank.most > 0 || driven(w))
        return MODAL_OK;
    if (w->shift > 1)
        return work_choose_periodic(w, &above->choice, err);
    if (w->projected)
        return MODAL_OK;
    all = w->full.s != NULL ? w->full : w->pencil, w->full = (struct pencil) { 0 };
    rc = w->counted || begins_at(w, out) != NULL ? MODAL_OK : work_pencil_of_all(w, &all, err);
    w->pencil = all;
    if (rc == MODAL_OK)
        rc = work_report_values(w, out, err);
    order_done(&w->choice);
    w->choice = (struct order_choice) { .chosen = -1 };
    if (rc == MODAL_OK && !driven(w) && !w->endless && !work_many_by_head(w))
        rc = descend(w, out, err);
    above->pencil = w->pencil, above->choice = w->choice;
    w->pencil = few, w->choice = (struct order_choice) { .chosen = -1 };
    if (above->pencil.s == few.s)
        above->pencil = (struct pencil) { 0 };
    return rc == MODAL_OK ? work_report_values(w, out, err) : rc;
}

enum modal_status work_keep_chosen(const struct work *w, struct identify_chosen *to,
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
    to->count = n;
    return MODAL_OK;
}

/* ---- very long records ---- */

bool work_begins_at_head(const struct work *w)
{
    return w->X->m >= GROW * HEAD && !work_wants_projection(w) && w->opt.rows == 0
        && w->opt.rank.rule == RANK_AUTO && w->opt.rank.most == 0 && !driven(w);
}

/* What is searched of a record: its first rows, or its last (LATE). */
struct end { struct matrix all, weighted, part; bool late; };

static void search_rows(struct work *w, struct end *e, int rows)
{
    int skip = e->late ? e->all.m - rows : 0;

    e->part = e->all, e->part.m = rows, e->part.x += skip;
    w->X = w->data.Y = &e->part;
    w->weighted = e->weighted;
    if (w->weighted.x != NULL)
        w->weighted.m = rows, w->weighted.x += skip;
}

/* A fit to all rows, or more, by BLOCKS or as they are, that begins with what F found in fewer. */
static enum modal_status search_on(struct work *w, struct identify_result *out, struct found *f,
                                   bool blocks, struct modal_error *err)
{
    enum modal_status rc;

    w->seen_rows = w->blocks != NULL ? w->blocks->Y.m : HEAD;
    compressed_free(w->blocks);
    w->data.blocks = w->blocks = NULL;
#ifdef __GLIBC__
    malloc_trim(0);                     /* what the search before had, beside rows to come */
#endif
    if (blocks) {
        w->data.blocks = w->blocks = compressed_new(w->X);
        if (w->blocks == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d signals",
                              w->X->n);
    }
    w->choice = f->choice, f->choice = (struct order_choice) { .chosen = -1 };
    rc = work_keep_chosen(w, &w->seen, err);
    order_done(&w->choice);
    if (rc == MODAL_OK)
        rc = descend(w, out, err);
    f->choice = w->choice, w->choice = (struct order_choice) { .chosen = -1 };
    free(w->seen.lambda);
    w->seen = (struct identify_chosen) { 0 };
    return rc;
}

static enum modal_status choose_by_head(struct work *w, struct identify_result *out,
                                        struct found *above, struct modal_error *err);

/* What the first rows show, or where they show nothing the last: of what grows. */
static enum modal_status search_end(struct work *w, struct identify_result *out, struct end *e,
                                    int rows, struct found *f, struct modal_error *err)
{
    enum modal_status rc;

    search_rows(w, e, rows);
    rc = work_decompose(w, out, err);
    if (rc == MODAL_OK)
        rc = choose_by_head(w, out, f, err);
    if (rc != MODAL_OK || e->late || f->choice.chosen >= 0 || driven(w) || w->endless)
        return rc;
    e->late = true;
    found_done(f);
    *f = (struct found) { .choice = { .chosen = -1 } };
    pencil_done(&w->pencil);
    return search_end(w, out, e, rows, f, err);
}

static bool converged(const struct order_choice *k)
{
    return k->chosen >= 0 && refined_converged(&k->candidates[k->chosen].fit);
}

/* Did work or steps end the search before its poles were there? They are what that bought: a search
 * of more rows begins with them, and one from nothing has less to spend. */
static bool unfinished(const struct order_choice *k)
{
    return k->chosen >= 0 && (k->limited || !converged(k));
}

/* *f: the modes of a HEAD of so many rows, and from there on in all; w->pencil is the head's. */
static enum modal_status grow_from(struct work *w, struct identify_result *out, int head,
                                   struct found *f, struct modal_error *err)
{
    const struct matrix *all = w->X;
    struct end e = { .all = *all, .weighted = w->weighted };
    int rows = head, most;
    double grow = all->m / (double)head;
    enum modal_status rc;

    for (most = 1; pow(GROW, most) < grow;)
        most++;
    grow = pow(grow, 1.0 / most);
    rc = search_end(w, out, &e, head, f, err);
    while (rc == MODAL_OK && rows < all->m
           && (f->choice.clean || (head == HEAD_MANY && unfinished(&f->choice)))) {
        rows = --most > 0 ? (int)(grow * rows) : all->m;
        search_rows(w, &e, rows);
        rc = search_on(w, out, f, all->m >= GROW * HEAD, err);
    }
    w->X = w->data.Y = all, w->weighted = e.weighted;
    return rc;
}

/* From above, where many modes are seen by a head that has them all, if there is one. */
static enum modal_status choose_by_head(struct work *w, struct identify_result *out,
                                        struct found *above, struct modal_error *err)
{
    struct pencil few;
    enum modal_status rc;

    w->descents = w->known ? w->descents : 0;
    rc = choose_from_above(w, out, above, err);
    if (rc != MODAL_OK || !work_many_by_head(w))
        return rc;
    found_done(above);
    *above = (struct found) { .choice = { .chosen = -1 } };
    few = w->pencil, w->pencil = (struct pencil) { 0 };
    rc = grow_from(w, out, HEAD_MANY, above, err);
    if (above->pencil.s == NULL)
        above->pencil = w->pencil;
    else
        pencil_done(&w->pencil);
    w->pencil = few;
    w->many = true;
    if (rc == MODAL_OK
        && (unfinished(&above->choice) || (above->choice.clean && !above->choice.crowded)))
        return MODAL_OK;
    found_done(above);
    *above = (struct found) { .choice = { .chosen = -1 } };
    w->headless = true, w->ragged = 0;  /* what was said of the head is not said of all */
    return rc == MODAL_OK ? choose_from_above(w, out, above, err) : rc;
}

/* *found: one set of modes in white noise, in all rows; or none, where noise drives the head. Else
 * nothing is. */
enum modal_status work_grow_from_head(struct work *w, struct identify_result *out, bool *found,
                                      struct modal_error *err)
{
    struct found f = { .choice = { .chosen = -1 } };
    enum modal_status rc = grow_from(w, out, HEAD, &f, err);

    *found = rc == MODAL_OK && f.choice.clean && !f.choice.crowded;
    if (*found)
        rc = put_found(w, &f, out, err);
    else
        pencil_done(&w->pencil);
    *found |= rc == MODAL_OK && driven(w);
    if (w->choice.chosen < 0) {
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
        rc = work_decompose(w, out, err);
        if (rc == MODAL_OK)
            rc = choose_order(w, out, err);
    }
    return rc;
}

/* Is there nothing better than what came from above where work cut that off?  A ladder that
 * explains little is no better for having ended; but the modes of a periodic system are looked for
 * again. */
static bool serves_unfinished(const struct work *w, double ladder)
{
    return w->many && w->rec.period == 0 && ladder > ORDER_POOR * safe_matrix_norm(w->data.Y);
}

/* Does what came from above explain much more than the ladder's choice?  What is not one set of
 * modes in white noise may draw noise, but never as much as that. */
static bool explains_more(const struct work *w, const struct order_choice *above)
{
    double worse = above->clean ? ORDER_WORSE : ORDER_DRAWN,
           ladder = w->choice.chosen < 0 ? HUGE_VAL
                  : w->choice.candidates[w->choice.chosen].fit.residual;

    return above->chosen >= 0 && (!above->limited || serves_unfinished(w, ladder))
        && ladder > worse * above->candidates[above->chosen].fit.residual;
}

/* By the criterion, but no fit that did not converge before one that did. */
static bool is_better(const struct order_choice *a, const struct order_choice *b)
{
    return work_bic_chosen(a) < work_bic_chosen(b) && (converged(a) || !converged(b));
}

/* From above, and where that does not settle it by the ladder. Of a periodic system the better of
 * the two counts: poles that rounding hides are found by many starts. */
static enum modal_status choose_poles(struct work *w, struct identify_result *out,
                                      struct modal_error *err)
{
    struct found above = { .choice = { .chosen = -1 } };
    enum modal_status rc = choose_by_head(w, out, &above, err);
    bool put = rc == MODAL_OK && above.choice.clean
            && (w->shift > 1 ? !w->data.exact && converged(&above.choice)
                             : !above.choice.crowded);

    if (rc == MODAL_OK && !put) {
        rc = climb_all(w, out, err);
        put = rc == MODAL_OK && (w->shift > 1 ? is_better(&above.choice, &w->choice)
                                              : explains_more(w, &above.choice));
    }
    if (put)
        rc = put_found(w, &above, out, err);
    if (put && w->many)
        w->trial = false;               /* many had as much work as they ever have */
    if (rc == MODAL_OK && !put && w->trial && w->facts.work_limit) {
        w->counted = true;
        w->full = above.pencil, above.pencil = (struct pencil) { 0 };
    }
    found_done(&above);
    return rc;
}

static enum modal_status put_families(struct work *w, struct found *families,
                                      struct identify_result *out, struct modal_error *err)
{
    enum modal_status rc = put_found(w, families, out, err);

    w->facts.work_limit = w->choice.limited;
    /* one that is there and was not looked for moves the others by more than their errors */
    w->facts.converged &= !w->choice.limited;
    w->data.omega = 2 * M_PI / w->rec.period;
    return rc;
}

/* Poles each for itself; or FAMILIES, where they are the better; or families that begin with those
 * poles, and are better or fewer. */
static enum modal_status choose_beside(struct work *w, struct found *families,
                                       struct identify_result *out, struct modal_error *err)
{
    struct found begun = { .choice = { .chosen = -1 } };
    bool fewer = false;
    enum modal_status rc = choose_poles(w, out, err);

    if (rc == MODAL_OK && is_better(&families->choice, &w->choice))
        return put_families(w, families, out, err);
    if (rc == MODAL_OK && w->choice.chosen >= 0)
        rc = work_choose_families(w, &w->choice.candidates[w->choice.chosen].fit, &begun.choice,
                                  &fewer, err);
    if (rc == MODAL_OK && (fewer || is_better(&begun.choice, &w->choice)))
        rc = put_families(w, &begun, out, err);
    found_done(&begun);
    return rc;
}

/* Of a period that is no whole number of samples multipliers with their lines first, which are the
 * answer where they leave no more than noise. */
enum modal_status work_choose_order(struct work *w, struct identify_result *out,
                                    struct modal_error *err)
{
    struct found families = { .choice = { .chosen = -1 } };
    bool fewer;
    enum modal_status rc;

    if (!work_has_families(w))
        return choose_poles(w, out, err);
    rc = work_choose_families(w, NULL, &families.choice, &fewer, err);
    if (rc == MODAL_OK)
        rc = families.choice.clean ? put_families(w, &families, out, err)
                                   : choose_beside(w, &families, out, err);
    found_done(&families);
    return rc;
}

enum modal_status work_begin_at_known(struct work *w, struct identify_result *out, bool *found,
                                      struct modal_error *err)
{
    struct found f = { .choice = { .chosen = -1 } };
    enum modal_status rc = MODAL_OK;

    *found = false;
    if (w->shift > 1 && w->refine && w->opt.method == IDENTIFY_AUTO
        && w->opt.rank.rule == RANK_AUTO && w->opt.rank.most == 0)
        rc = work_try_known(w, &f.choice, found, err);
    out->begun = *found;
    if (f.choice.chosen >= 0)
        rc = put_found(w, &f, out, err);
    else
        w->choice = (struct order_choice) { .chosen = -1 };
    found_done(&f);
    return rc;
}

/* What a fixed or ruled rank left out: one more direction fits far better, and completes a pair? */
enum modal_status work_look_above(struct work *w, struct modal_error *err)
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
        : work_pencil_source(w, r, lambda, &count, err);
    if (rc != MODAL_OK || count < 1)
        return rc;
    rc = refine_poles(&w->data, lambda, count, NULL, &look, &above, err);
    if (rc != MODAL_OK)
        return rc;
    for (int j = 0; j < fit->poles; j++)
        reals += pole_order(fit->lambda[j], w->tau) == 1;
    for (int j = 0; j < count; j++)
        more += pole_order(lambda[j], w->tau) == 1;
    w->facts.rank_low = above.bic < fit->bic - LOW_BIC
        && above.residual < LOW_LEFT * fit->residual;
    w->facts.cut_pair = w->facts.rank_low && more < reals;
    refined_done(&above);
    return MODAL_OK;
}
