/* identify_decompose.c - signals to the pair of matrices that poles are read from, by pencil or by
 * projection, with as many triplets as there are signals */
#include "modal/identify/identify_state.h"
#include "modal/identify/linear/rank.h"
#include <stdlib.h>
#include "modal/identify/linear/hankel.h"
#include "modal/identify/prepare/ragged.h"

enum { COMPLETE_SIDE = 600 };           /* complete decompositions up to this */

/* What is searched from above: at most so many signals, found for so many multiplications; and
 * where many modes are seen to be there. */
enum {
    SIGNALS_MOST = 256,                 /* before many modes are seen */
    MANY_MOST = 1536,                   /* once they are: 500 pairs, and LAG's part above them */
    LAG = 5                             /* of the triplets one in so many: the last have not
                                         * converged */
};
static const double
    /* multiplications: of few modes what twice the triplets of few cost of the longest record that
     * is not searched by its head, of a square matrix of 2 L rows and columns, */
    SIGNALS_WORK = 2.0 * GROW * HEAD * (2 * TRIPLETS_MOST) * (2 * TRIPLETS_MOST);

/* The pencil uses every column there is. */
static bool every_column(const struct work *w)
{
    int rows = w->opt.rows, columns = 0;

    hankel_default_sizes(w->X->m, w->shift, &rows, &columns);
    return w->opt.columns == 0 || w->opt.columns == columns;
}

bool work_wants_projection(const struct work *w)
{
    return w->shift > 1 || !w->refine || w->opt.method != IDENTIFY_AUTO || !every_column(w)
        || (w->opt.rank.rule != RANK_AUTO && w->opt.rank.rule != RANK_FIXED);
}

const struct matrix *work_searched(const struct work *w)
{
    return w->pod.count == 0 && w->weighted.x != NULL ? &w->weighted : w->X;
}

static enum modal_status project(struct work *w, struct identify_result *out,
                                 struct modal_error *err)
{
    struct hankel h = { work_searched(w), 0, w->opt.rows, w->opt.columns, w->shift };
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

    /* each Lanczos vector is orthogonalised against all before it: side k^2 */
    return k <= (many ? MANY_MOST : SIGNALS_MOST)
        && side * k * k <= (many ? WORK_MANY : SIGNALS_WORK);
}

/* As high as it is wide the Hankel matrix has its noise lowest beside its signals, and more rows
 * cost more; it has room for FOLD times the triplets. */
static int rows_square(const struct work *w, int triplets)
{
    enum { FOLD = 4 };              /* room beside the signals for their noise */
    /* S rows = L - rows: the block Hankel matrix is square */
    int L = w->X->m, S = w->X->n, rows = L / (S + 1), least = FOLD * triplets / S + 1;

    rows = rows > least ? rows : least;
    return rows < (L + 2) / 3 ? rows : (L + 2) / 3;
}

/* Rows for many triplets, and for those that cannot be had of as many rows as few need. */
static int rows_of_many(const struct work *w, int triplets)
{
    if (w->opt.rows > 0 || triplets <= TRIPLETS_MOST
        || (!w->many && affords(w, w->pencil.rows, triplets)))
        return w->opt.rows;
    return rows_square(w, triplets);
}

/* Do as many triplets as few modes need leave much of the signals? Then many modes are there. What
 * follows its own amplitude has many directions too, and next to nothing in the later ones. */
static bool leaves_much(const struct pencil *p)
{
    double rest = p->energy;

    for (int i = 0; i < p->count; i++)
        rest -= p->s[i] * p->s[i];
    /* squares: the part of the norm that a ladder calls poor */
    return rest > ORDER_POOR * ORDER_POOR * p->energy;
}

/* Does the second quarter of the triplets, the last half of which has not converged, hold half of
 * the energy of the eighth before it or more?  Then values fall no faster than 1 / index, no few of
 * them make up for their sum, and many modes are there, though slow or strong ones have most of the
 * energy.  What follows its own amplitude has values that fall ever faster. */
static bool goes_on(const struct pencil *p)
{
    double eighth = 0, quarter = 0;

    for (int i = p->count / 8; i < p->count / 4; i++)
        eighth += p->s[i] * p->s[i];
    for (int i = p->count / 4; i < p->count / 2; i++)
        quarter += p->s[i] * p->s[i];
    return quarter > eighth / 2;
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

/* How many triplets the next pencil has: twice those of P, or what is left up to the most. */
static int count_next(const struct work *w, const struct pencil *p)
{
    return w->many && p->count < MANY_MOST && 2 * p->count > MANY_MOST ? MANY_MOST : 2 * p->count;
}

/* Can they be had?  Twice none are none: signals that are zero have no triplet. */
static bool can_grow(const struct work *w, const struct pencil *p)
{
    int more = count_next(w, p), rows = rows_of_many(w, more);

    return p->count > 0 && p->count < w->X->m / 4 && affords(w, rows > 0 ? rows : p->rows, more);
}

/* Once more triplets are filled than few modes do, and before those are refined, or more are made
 * at the square of their cost: does noise drive the response? */
static enum modal_status ask_driven(struct work *w, const struct pencil *all,
                                    struct modal_error *err)
{
    struct ragged is = { 0 };
    enum modal_status rc = MODAL_OK;

    if (all->count > TRIPLETS_MOST)
        w->many |= goes_on(all);
    if (all->count != TRIPLETS && all->count != TRIPLETS_MOST)
        return MODAL_OK;
    w->many = all->count == TRIPLETS_MOST && leaves_much(all);
    if (signals_fill(w, all))
        rc = ragged_spectrum(work_searched(w), &is, err);
    w->ragged = is.driven ? w->X->m : 0;
    w->endless = is.endless;
    return rc;
}

/* A response that noise drives has no end of signals: of those not even many are searched. Where
 * they end, more than TRIPLETS_MOST are many, however little the first of them leave. */
static void drop_endless(struct work *w, struct pencil *all)
{
    bool endless = w->endless || signals_fill(w, all), many = w->endless || w->many;

    w->many = !endless && (many || pencil_signals(all) > TRIPLETS_MOST);
    if (!endless || !many)
        return;
    if (all->s != w->pencil.s)
        pencil_done(all);
    *all = w->pencil;
}

bool work_many_by_head(const struct work *w)
{
    return w->many && !w->headless && w->X->m >= 2 * HEAD_MANY && w->opt.rows == 0;
}

enum modal_status work_pencil_of_all(struct work *w, struct pencil *all, struct modal_error *err)
{
    struct lanczos *run = NULL;
    enum modal_status rc = MODAL_OK;

    *all = w->pencil;
    w->many = w->endless = false;
    while (rc == MODAL_OK && !w->endless && signals_fill(w, all) && can_grow(w, all)
           && !work_many_by_head(w)) {
        int next = count_next(w, all);
        struct pencil_options opt = { .rows = rows_of_many(w, next), .wanted = next, .run = &run };
        struct pencil more = { 0 };
        if (opt.rows > 0 && opt.rows != all->rows)      /* another matrix */
            lanczos_free(run), run = NULL;
        rc = pencil_new(work_searched(w), &opt, &more, err);
        if (all->s != w->pencil.s)
            pencil_done(all);
        *all = rc == MODAL_OK ? more : w->pencil;
        if (rc == MODAL_OK)
            rc = ask_driven(w, all, err);
        if (more.count < opt.wanted)
            break;
    }
    lanczos_free(run);
    if (!work_many_by_head(w))
        drop_endless(w, all);
    return rc;
}

/* The pencil of an order that was told, and where there are more signals of as many as there are,
 * up to twice the order: of those the told ones are chosen (order.c). */
static enum modal_status pencil_told(struct work *w, int told, struct modal_error *err)
{
    struct lanczos *run = NULL;
    struct pencil_options opt = {
        .rows = w->opt.rows > 0 ? w->opt.rows : rows_square(w, told),
        .wanted = told + ORDER_AHEAD, .sure = told, .run = &run
    };
    enum modal_status rc = pencil_new(work_searched(w), &opt, &w->pencil, err);

    if (rc == MODAL_OK && pencil_signals(&w->pencil) == opt.wanted && w->refine) {
        pencil_done(&w->pencil);
        opt.wanted = 2 * told + ORDER_AHEAD, opt.sure = 2 * told;
        rc = pencil_new(work_searched(w), &opt, &w->pencil, err);
    }
    lanczos_free(run);
    return rc;
}

static enum modal_status pencil(struct work *w, struct identify_result *out,
                                struct modal_error *err)
{
    int fixed = w->opt.rank.rule == RANK_FIXED ? w->opt.rank.fixed : 0, most = (w->X->m - 1) / 2;
    struct pencil_options opt = { .rows = w->opt.rows, .wanted = w->triplets };
    enum modal_status rc = MODAL_OK;

    if (fixed > most)
        return modal_fail_field(err, MODAL_BAD_INPUT, "rank.fixed",
                                "rank %d of %d samples; accepted: 1 to %d", fixed, w->X->m, most);
    if (fixed == 0)
        rc = pencil_new(work_searched(w), &opt, &w->pencil, err);
    else if (w->pencil.s == NULL)           /* that of channels not yet weighed serves */
        rc = pencil_told(w, fixed, err);
    out->rows = w->pencil.rows, out->columns = w->X->m - w->pencil.rows;
    return rc;
}

/* The singular values of the decomposition, for the answer. */
enum modal_status work_report_values(struct work *w, struct identify_result *out,
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

enum modal_status work_decompose(struct work *w, struct identify_result *out,
                                 struct modal_error *err)
{
    enum modal_status rc = work_wants_projection(w) ? project(w, out, err) : pencil(w, out, err);

    return rc == MODAL_OK ? work_report_values(w, out, err) : rc;
}
