/*
 * forced_order.c - poles one after another, by what they are worth
 *
 * Where.  At a candidate s the drives pass the filter 1/(z - e^s) to columns b; of what is left
 * over, over its standard deviation, they take the part L^-1 b^H R with b^H b = L L^H. A mode takes
 * the strongest singular direction of that, for it has one shape, and that direction is also its q.
 * Candidates lie half a band apart in frequency and GRADE apart in damping, and are held against
 * the lines within REACH of their half bands.  Close pairs: one mode in the place of two leaves a
 * rest that the second is found in, and the fit moves both.
 *
 * How many.  A pair pays where it raises 2 ln likelihood by more than the price of its unknowns,
 * 2 (responses + drives) of them, and of the search for its exponent, as criterion.c has it.
 *
 * Against what.  Where it is strongest coloured noise would be pole after pole, each fitted beside
 * all others: what a pair takes off a band of lines must pay by the level left there as well, where
 * that is above the level of all.  It is the level that the pair itself leaves, or a mode would be
 * taken for its noise; and no lower one than that of all, which the fit does not care for.  What is
 * left is looked at by one level, as long as that leads to modes, then by those of bands: a weak
 * mode where noise is weak is not the strongest of all.  Errors are widened as forced.c has it.
 *
 * How long.  Multiplications are counted, not seconds: the best so far is the answer where they are
 * spent, and says so.
 */
#include "modal/identify/forced/forced_order.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/criterion.h"
#include "modal/numbers.h"

enum {
    STEPS_LAST = 60,             /* of the answer's */
    GRADES = 3,                  /* of damping: ratios of 0.003 to 0.05 */
    TURNS = 24,                  /* of the power iteration: a second one is nearly as good */
    AGAIN = 3                    /* candidates that may fail one after another */
};
static const double
    DAMPING_FIRST = 0.003,       /* ratio of the first grade */
    GRADE = 4,                   /* a damping off by 2 shows 8 / 9 of a mode */
    RATE = 1.5,                  /* of a real one over that before it */
    ENOUGH_LAST = 1e-6,          /* a thousandth of a standard error */
    REACH = 6,                   /* 90 % of a mode's energy */
    PATIENCE = 1000,             /* of 2 ln likelihood: what neighbours may make up for */
    APART = 0.7,                 /* of a record's line: no band is narrower than that */
    WORK_MOST = 8e10,            /* multiplications, ten seconds': 27 modes in 8 responses of 8000
                                    samples take 4e10, 16 of 2 inputs in 20,000 5e10, */
    WORK_LINE = 2e6;             /* and for each line of a long record: 10 modes take 7e5 */

struct work {
    const struct lines *l;
    const struct forced_limits *limits;
    struct forced_search *out;
    struct transfer trial, real;
    double complex *R;           /* what is left over, over its standard deviation */
    double complex *b;           /* columns of a candidate */
    double complex *taken;       /* drives x responses */
    struct { double from, to; } closed[AGAIN];   /* frequencies */
    int failed;                  /* of these, since the last success */
    double work, settling;       /* multiplications left: of the search; of the answer's fit */
};

struct candidate { double complex s; double gain; double complex q[LINES_DRIVES_MOST]; };

/* ---- what models are worth ---- */

static double price_of(const struct lines *l, const struct transfer *t)
{
    double numbers = 2.0 * l->count;
    int order = 0;
    struct criterion c = { .groups = l->responses, .phases = 1, .numbers = numbers, .own = numbers,
                           .energy = l->energy };

    /* beside shapes and exponents, how the drives but one reach a pole, searched for by nobody: a
     * record's state is told by that record's numbers alone; for records alike, which cost most */
    for (int p = 0; p < t->poles; p++)
        order += cimag(t->s[p]) > 0 ? 2 : 1;
    return criterion_price(&c, t->poles, order + l->direct, order)
         + (l->inputs - 1) * order * log(numbers * l->responses)
         + l->records * order * log(numbers / l->records * l->responses);
}

double forced_bic(const struct lines *l, const struct transfer *t)
{
    return -2 * t->likelihood + price_of(l, t);
}

/* Variance of what T leaves of response I in BAND, lines FIRST to END, of either part: of all lines
 * but where there is more beyond chance. */
static double level_of(const struct lines *l, const struct transfer *t, int i, int band, int first,
                       int end)
{
    double all = t->variance[i], own = t->band[band + (size_t)l->bands * i] / (2.0 * (end - first));

    return own > all * (1 + FORCED_CHANCE / sqrt(end - first)) ? own : all;
}

/* What the poles of T that LESS has not take off it, in 2 ln likelihood of noise of T's levels. */
static double worth_of(const struct lines *l, const struct transfer *t, const struct transfer *less)
{
    double worth = 0;

    for (int i = 0; i < l->responses; i++)
        for (int n = 0, band = 0, end; n < l->count && l->energy[i] > 0; n = end, band++) {
            size_t at = band + (size_t)l->bands * i;
            end = lines_band_end(l, n);
            worth += (less->band[at] - t->band[at]) / level_of(l, t, i, band, n, end);
        }
    return worth;
}

/* Is T, of more poles, worth their price?  By one level of noise, and by those of its bands. */
static bool pays(const struct lines *l, const struct transfer *t, const struct transfer *less)
{
    return forced_bic(l, t) < forced_bic(l, less)
        && worth_of(l, t, less) > price_of(l, t) - price_of(l, less);
}

static double residual_of(const struct lines *l, const struct transfer *t)
{
    double left = 0, all = 0;

    for (int i = 0; i < l->responses; i++)
        if (l->energy[i] > 0)
            left += t->rss[i] / l->energy[i], all++;
    return all > 0 ? sqrt(left / all) : 0;
}

static enum modal_status keep_rung(struct work *w, const struct transfer *t,
                                   struct modal_error *err)
{
    struct forced_search *o = w->out;
    struct forced_rung *r;
    size_t n = (size_t)t->poles;

    for (int i = 0; i < o->rungs; i++)
        if (o->rung[i].poles == t->poles) {
            free(o->rung[i].s), free(o->rung[i].spread);
            o->rung[i] = o->rung[--o->rungs];
        }
    r = &o->rung[o->rungs];
    *r = (struct forced_rung) { t->poles, forced_bic(w->l, t), residual_of(w->l, t), t->converged,
                                malloc(sizeof *r->s * (n + 1)),
                                malloc(sizeof *r->spread * (2 * n + 1)) };
    o->rungs++;
    if (r->s == NULL || r->spread == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles", t->poles);
    memcpy(r->s, t->s, sizeof *r->s * n);
    memcpy(r->spread, t->spread, sizeof *r->spread * 2 * n);
    return MODAL_OK;
}

/* ---- where ---- */

/* Of the lower triangle of G (n x n, Hermitian): L in place; false where columns depend. */
static bool factor(double complex *G, int n)
{
    const double DEPENDENT = 1e-10;

    for (int j = 0; j < n; j++) {
        double own = creal(G[j + n * j]), d = own;
        for (int k = 0; k < j; k++)
            d -= creal(G[j + n * k] * conj(G[j + n * k]));
        if (!(d > DEPENDENT * own))
            return false;
        G[j + n * j] = sqrt(d);
        for (int i = j + 1; i < n; i++) {
            for (int k = 0; k < j; k++)
                G[i + n * j] -= G[i + n * k] * conj(G[j + n * k]);
            G[i + n * j] /= G[j + n * j];
        }
    }
    return true;
}

/* The strongest singular value squared of M (n x columns), its left direction in v. */
static double strongest(const double complex *M, int n, int columns, double complex *v)
{
    double complex next[LINES_DRIVES_MOST], p;
    double gain = 0;

    for (int i = 0; i < n; i++) {
        v[i] = numbers_row_dot(columns, M, n, M + i, n) + (i == 0);
    }
    for (int turn = 0; turn < TURNS; turn++) {
        double size = cblas_dznrm2(n, v, 1);
        memset(next, 0, sizeof next);
        for (int i = 0; i < n; i++)
            v[i] = size > 0 ? v[i] / size : i == 0;
        for (int c = 0; c < columns; c++) {
            cblas_zdotc_sub(n, v, 1, M + (size_t)n * c, 1, &p);
            for (int i = 0; i < n; i++)
                next[i] += M[i + (size_t)n * c] * conj(p);
        }
        gain = cblas_dznrm2(n, next, 1);
        memcpy(v, next, sizeof *v * (size_t)n);
    }
    return gain;
}

/* No peak is narrower, rad a sample: that of so long a record as one of them is. */
static double line_of_a_record(const struct lines *l)
{
    return 2 * M_PI / l->samples * l->records;
}

/* The candidate at c->s: its gain and q. */
static void weigh_candidate(struct work *w, struct candidate *c)
{
    const struct lines *l = w->l;
    double turn = 2 * M_PI / l->samples, half = fmax(-creal(c->s), line_of_a_record(l));
    double at = cimag(c->s);
    int base = (int)lround(carg(l->z[0]) / turn), n = l->drives;
    int first = (int)fmax(0, floor((at - REACH * half) / turn) - base);
    int last = (int)fmin(l->count - 1, ceil((at + REACH * half) / turn) - base);
    int rows = last - first + 1;
    double complex G[LINES_DRIVES_MOST * LINES_DRIVES_MOST], r = cexp(c->s);

    c->gain = 0;
    if (rows < 2 * n)
        return;
    w->work -= 4.0 * rows * n * (n + l->responses);
    for (int k = 0; k < rows; k++) {
        double complex filter = 1 / (l->z[first + k] - r);
        for (int j = 0; j < n; j++)
            w->b[k + (size_t)j * rows] = filter * l->W[first + k + (size_t)j * l->count];
    }
    for (int j = 0; j < n; j++) {
        for (int i = j; i < n; i++)
            cblas_zdotc_sub(rows, w->b + (size_t)i * rows, 1, w->b + (size_t)j * rows, 1,
                            &G[i + n * j]);
        for (int i = 0; i < l->responses; i++)
            cblas_zdotc_sub(rows, w->b + (size_t)j * rows, 1, w->R + first + (size_t)i * l->count,
                            1, &w->taken[j + (size_t)n * i]);
    }
    if (!factor(G, n))
        return;
    cblas_ztrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, n, l->responses,
                &(double complex) { 1 }, G, n, w->taken, n);
    c->gain = strongest(w->taken, n, l->responses, c->q);
    cblas_ztrsv(CblasColMajor, CblasLower, CblasConjTrans, CblasNonUnit, n, G, n, c->q, 1);
}

/* Has a band of what T leaves more than its share? */
static bool is_coloured(const struct lines *l, const struct transfer *t)
{
    for (int i = 0; i < l->responses; i++)
        for (int n = 0, band = 0, end; n < l->count; n = end, band++) {
            end = lines_band_end(l, n);
            if (level_of(l, t, i, band, n, end) > t->variance[i])
                return true;
        }
    return false;
}

static bool is_closed(const struct work *w, double at)
{
    for (int i = 0; i < w->failed; i++)
        if (at >= w->closed[i].from && at <= w->closed[i].to)
            return true;
    return false;
}

/* The best of real ones, with a real q. */
static void look_at_real(struct work *w, struct candidate *best)
{
    for (double rate = line_of_a_record(w->l); rate < 1 && !is_closed(w, 0); rate *= RATE) {
        struct candidate c = { .s = -rate };
        double complex most = 0;
        weigh_candidate(w, &c);
        if (!(c.gain > best->gain))
            continue;
        *best = c;
        for (int j = 0; j < w->l->drives; j++)
            most = cabs(c.q[j]) > cabs(most) ? c.q[j] : most;
        for (int j = 0; j < w->l->drives; j++)
            best->q[j] = creal(c.q[j] / most);
    }
}

/* The best over frequencies and grades. */
static struct candidate look(struct work *w)
{
    const struct lines *l = w->l;
    double turn = line_of_a_record(l), low = carg(l->z[0]), high = carg(l->z[l->count - 1]);
    struct candidate best = { .gain = 0 };

    look_at_real(w, &best);
    for (int g = 0; g < GRADES; g++) {
        double damping = DAMPING_FIRST * pow(GRADE, g);
        for (double at = low; at <= high; at += fmax(damping * at, APART * turn)) {
            struct candidate c = { .s = CMPLX(-fmax(damping * at, APART * turn / 2), at) };
            if (is_closed(w, at))
                continue;
            weigh_candidate(w, &c);
            if (c.gain > best.gain)
                best = c;
        }
    }
    return best;
}

/* What the model leaves, over its standard deviation: by LEVELS that of each band. */
static enum modal_status take_rest(struct work *w, bool levels, struct modal_error *err)
{
    const struct lines *l = w->l;
    const struct transfer *t = &w->out->model;
    enum modal_status rc = transfer_rest(l, t, w->R, err);

    for (int i = 0; i < l->responses && rc == MODAL_OK; i++)
        for (int n = 0, band = 0, end; n < l->count; n = end, band++) {
            double variance = t->variance[i];
            end = lines_band_end(l, n);
            if (levels)
                variance = level_of(l, t, i, band, n, end);
            cblas_zdscal(end - n, 1 / sqrt(2 * variance), w->R + n + (size_t)i * l->count, 1);
        }
    return rc;
}

/* ---- up and down ---- */

static enum modal_status fit(struct work *w, int steps, struct transfer *t, struct modal_error *err)
{
    double enough = steps < STEPS_LAST ? FORCED_ENOUGH_EACH : ENOUGH_LAST;
    double *work = steps < STEPS_LAST ? &w->work : &w->settling;
    struct transfer_limits limits = { steps, enough, work, w->limits->cancelled,
                                      w->limits->context };

    return transfer_fit(w->l, &limits, t, err);
}

/* A pair that shows no peak is a real pole where that is worth more: pairs cannot pass the axis. */
static enum modal_status settle(struct work *w, struct transfer *t, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int p = 0; p < t->poles && rc == MODAL_OK; p++) {
        if (cimag(t->s[p]) == 0 || -creal(t->s[p]) < FORCED_NO_PEAK * cabs(t->s[p]))
            continue;
        transfer_copy(w->l, t, &w->real);
        w->real.s[p] = -cabs(t->s[p]);
        for (int j = 0; j < w->l->drives; j++)
            w->real.q[j + p * w->l->drives] = creal(t->q[j + p * w->l->drives]);
        rc = fit(w, FORCED_STEPS_EACH, &w->real, err);
        if (rc == MODAL_OK && forced_bic(w->l, &w->real) < forced_bic(w->l, t))
            transfer_copy(w->l, &w->real, t);
    }
    return rc;
}

/* One pair more where it is worth most; *more is whether it pays. */
static enum modal_status climb(struct work *w, bool *more, struct modal_error *err)
{
    struct transfer *t = &w->out->model;
    enum modal_status rc = MODAL_OK;

    *more = false;
    for (w->failed = 0; w->failed < AGAIN && rc == MODAL_OK && !*more && w->work > 0;
         w->failed++) {
        struct candidate c = look(w);
        double reach = 2 * fmax(-creal(c.s), line_of_a_record(w->l));
        if (!(c.gain > 0))
            break;
        transfer_copy(w->l, t, &w->trial);
        transfer_add(w->l, &w->trial, c.s, c.q);
        rc = fit(w, FORCED_STEPS_EACH, &w->trial, err);
        if (rc == MODAL_OK)
            rc = settle(w, &w->trial, err);
        *more = rc == MODAL_OK && (w->limits->fixed > 0 || pays(w->l, &w->trial, t));
        reach *= cimag(c.s) > 0;
        w->closed[w->failed].from = cimag(c.s) - reach;
        w->closed[w->failed].to = cimag(c.s) + reach;
    }
    if (rc == MODAL_OK && *more) {
        transfer_copy(w->l, &w->trial, t);
        rc = keep_rung(w, t, err);
    }
    return rc;
}

static enum modal_status climb_all(struct work *w, struct modal_error *err)
{
    int most = w->limits->fixed > 0 ? w->limits->fixed : w->limits->most;
    bool more = true, levels = false;
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && more && !w->out->model.exact && w->out->model.poles < most
           && w->work > transfer_work(w->l, w->out->model.poles + 1)) {
        rc = take_rest(w, levels, err);
        if (rc == MODAL_OK)
            rc = climb(w, &more, err);
        /* where noise is strongest nothing may pay, and something elsewhere */
        if (rc == MODAL_OK && !more && !levels && is_coloured(w->l, &w->out->model))
            more = levels = true;
    }
    w->out->climbing = more && !w->out->model.exact
        && (w->limits->fixed == 0 || w->out->model.poles < most);
    return rc;
}

/* Any pair that is not worth its price, the rest fitted anew, out again; that they were fitted
 * anew is worth less than the PATIENCE that it would take. */
static enum modal_status prune(struct work *w, struct modal_error *err)
{
    struct transfer *t = &w->out->model;
    enum modal_status rc = MODAL_OK;

    for (int p = 0; p < t->poles && rc == MODAL_OK && w->limits->fixed == 0 && w->work > 0;) {
        double bic = forced_bic(w->l, t);
        transfer_copy(w->l, t, &w->trial);
        transfer_drop(w->l, &w->trial, p);
        rc = fit(w, 0, &w->trial, err);
        if (rc == MODAL_OK && forced_bic(w->l, &w->trial) < bic + PATIENCE)
            rc = fit(w, FORCED_STEPS_EACH, &w->trial, err);
        if (rc == MODAL_OK && !pays(w->l, t, &w->trial)) {
            transfer_copy(w->l, &w->trial, t);
            p = 0;
        } else
            p++;
    }
    return rc;
}

void forced_search_done(struct forced_search *s)
{
    for (int i = 0; i < s->rungs; i++)
        free(s->rung[i].s), free(s->rung[i].spread);
    transfer_done(&s->model);
    memset(s, 0, sizeof *s);
}

double forced_work(const struct lines *l, const struct forced_limits *limits)
{
    return limits->work > 0 ? limits->work : fmax(WORK_MOST, WORK_LINE * l->count);
}

enum modal_status forced_search(const struct lines *l, const struct forced_limits *limits,
                                struct forced_search *out, struct modal_error *err)
{
    double work = forced_work(l, limits);
    struct work w = { .l = l, .limits = limits, .out = out, .work = work, .settling = work };
    size_t n = (size_t)l->count;
    enum modal_status rc = transfer_new(l, &out->model, err);

    w.R = malloc(sizeof *w.R * n * (size_t)l->responses);
    w.b = malloc(sizeof *w.b * n * (size_t)l->drives);
    w.taken = malloc(sizeof *w.taken * (size_t)l->drives * (size_t)l->responses);
    if (rc == MODAL_OK)
        rc = transfer_new(l, &w.trial, err);
    if (rc == MODAL_OK)
        rc = transfer_new(l, &w.real, err);
    if (rc == MODAL_OK && (w.R == NULL || w.b == NULL || w.taken == NULL))
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d lines", l->count);
    if (rc == MODAL_OK)
        rc = fit(&w, 1, &out->model, err);
    if (rc == MODAL_OK)
        rc = keep_rung(&w, &out->model, err);
    if (rc == MODAL_OK)
        rc = climb_all(&w, err);
    if (rc == MODAL_OK)
        rc = prune(&w, err);
    out->limit = out->climbing || w.work <= 0;
    if (rc == MODAL_OK)
        rc = fit(&w, STEPS_LAST, &out->model, err);
    if (rc == MODAL_OK)
        rc = keep_rung(&w, &out->model, err);
    transfer_done(&w.trial), transfer_done(&w.real);
    free(w.R), free(w.b), free(w.taken);
    return rc;
}
