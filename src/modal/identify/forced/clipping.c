/*
 * clipping.c - see clipping.h
 *
 * A converter at its stop records the same extreme value whatever the input was; so does a force
 * that truly holds its extreme, a relay's or a generator's.  The responses know which.  A clipped
 * input u was u + sum a_c s_c, a_c >= 0, with s_c over each run of samples at the input's largest
 * value some shape, over those at its smallest its negative, and else 0.  A run of n samples that
 * is entered and left at the slope r, r from the samples beside it, went on as a parabola by
 * r n / 4 where the input is smooth; where it is not, all went on by the same; and a hit of few
 * samples is more pointed, a parabola's square.  Of FEW samples each is a shape by itself.
 *
 * What was cut off reaches the responses by the same way as the rest: they are linear in the a_c.
 * What went on beyond would be taken for modes, many of them, by an account of u alone; but as it
 * is no modes' motion, a step of the a_c with all of that account (transfer.h) sees it in what they
 * leave.  One a_c after another joins, that which gains most, where the gain is worth one number
 * more and the choice among so many: where none is, nothing was cut off.
 *
 * One such mode stands in for it where all hits are alike: a filter that turns one hit into the
 * other.  So the account less one pole is asked as well, that in whose place the a_c promise most;
 * as the spectrum of a hit has zeros that move with it, from several heights.  An account with a_c
 * is believed where its BIC is the lower, so much charged for each, and where without them it is
 * worse by as much.
 *
 * An extreme value of continuous samples is met once, of coarse ones less often than the value next
 * to it; one that most samples have is where nothing pushes, between hits: none of these is asked.
 */
#include "modal/identify/forced/clipping.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    MET = 2,                     /* samples at an extreme at least */
    OF_ALL = 2,                  /* samples for each of those: where nothing pushes are more */
    FEW = 8,                     /* as many shapes as two of each kind */
    HEIGHTS = 4,                 /* of a shape to begin with, doubled from LOWEST */
    SWEEPS = 100,                /* over the a_c of a step: each halves what is left at least */
    ROUNDS = 8,                  /* steps: nearly linear, the third changes little */
    TRIES = 4                    /* of one, each half of the last */
};
static const double
    LOWEST = 0.125;              /* an a: what is cut off over what is not */

enum {
    EQUAL = 1,                   /* peaks as high as each other, not as their slopes have them */
    POINTED = 2,                 /* not round */
    KINDS = 4                    /* of peaks: either, both or neither of these */
};

/* ---- what was cut off ---- */

/* How many of x hold its extreme in the direction of SIGN, *value; 0 where it is none that was cut
 * off. */
static int count_held(const double *x, int L, double sign, double *value)
{
    double next = -HUGE_VAL, most = -HUGE_VAL;
    int held = 0, beside = 0;

    for (int k = 0; k < L; k++)
        most = fmax(most, sign * x[k]);
    for (int k = 0; k < L; k++)
        if (sign * x[k] < most)
            next = fmax(next, sign * x[k]);
    for (int k = 0; k < L; k++)
        held += sign * x[k] == most, beside += sign * x[k] == next;
    *value = sign * most;
    /* a hit that is cut off all along has its rest next to it */
    beside *= beside <= L / OF_ALL;
    return held >= MET && held <= L / OF_ALL && held > beside ? held : 0;
}

/* By how much x went on over samples FIRST .. end - 1, by the slopes beside them. */
static double height_of(const double *x, int L, double sign, int first, int end)
{
    double rise = first > 0 ? sign * (x[first] - x[first - 1]) : 0;
    double fall = end < L ? sign * (x[end - 1] - x[end]) : 0;

    /* the step on to the extreme was cut off too; the one before was not */
    if (first > 1)
        rise = fmax(rise, sign * (x[first - 1] - x[first - 2]));
    if (end + 1 < L)
        fall = fmax(fall, sign * (x[end] - x[end + 1]));
    return (rise + fall) / 2 * (end - first + 1) / 4;
}

/* Adds to s a parabola for each run of VALUE in x, zero in the samples beside it. */
static void add_peaks(const double *x, int L, double value, double sign, int how,
                      double *s)
{
    for (int k = 0, first = 0; k <= L; k++)
        if (k == L || x[k] != value) {
            double n = k - first + 1, height = 0;
            if (first < k)
                height = how & EQUAL ? fabs(value) : height_of(x, L, sign, first, k);
            for (int i = first; i < k; i++) {
                double round = 4 * (i - first + 1) * (k - i) / (n * n);
                s[i] = sign * height * (how & POINTED ? round * round : round);
            }
            first = k + 1;
        }
}

struct shapes {
    int count;
    int *input;                  /* of each */
    struct matrix s;             /* a column each */
};

/* *C of an input x; shapes of it. */
static int count_shapes(const double *x, int L, struct clipping *c)
{
    c->samples = count_held(x, L, 1, &c->high) + count_held(x, L, -1, &c->low);
    return c->samples == 0 ? 0 : KINDS + (c->samples <= FEW ? c->samples : 0);
}

/* All of the input J, x, of which *C is told; zero before. */
static void add_shapes(struct shapes *h, const double *x, int j, const struct clipping *c)
{
    double end;
    int L = h->s.m, high = count_held(x, L, 1, &end), low = count_held(x, L, -1, &end);

    for (int how = 0; how < KINDS && c->samples > 0; how++) {
        double *s = h->s.x + (size_t)h->s.ld * h->count;
        if (high > 0)
            add_peaks(x, L, c->high, 1, how, s);
        if (low > 0)
            add_peaks(x, L, c->low, -1, how, s);
        h->input[h->count++] = j;
    }
    for (int k = 0; k < L && c->samples <= FEW; k++)
        if ((high > 0 && x[k] == c->high) || (low > 0 && x[k] == c->low)) {
            h->s.x[k + (size_t)h->s.ld * h->count] = x[k] == c->high ? fabs(x[k]) : -fabs(x[k]);
            h->input[h->count++] = j;
        }
}

/* ---- do the responses know of it? ---- */

struct account { struct lines lines; struct transfer model; };

struct work {
    const struct clipping_record *record;
    struct account own;          /* the lines, its model borrowed */
    const struct forced_limits *limits;
    struct shapes shapes;
    struct lines cut;            /* W: the shapes */
    struct transfer_more more;   /* these */
    struct matrix u;             /* inputs and a times the shapes */
    double *a, *trial, *step, *M;
    bool *asked;
    int only;                    /* that may join; -1: any */
    double bic, price;           /* the own one; of an a that is not 0, in 2 ln likelihood */
    double work;                 /* multiplications left, of a search's */
};

static void account_done(struct account *k)
{
    transfer_done(&k->model);
    lines_done(&k->lines);
}

static enum modal_status set_lines(struct work *w, struct lines *out, struct modal_error *err)
{
    const struct clipping_record *r = w->record;
    const struct shapes *h = &w->shapes;

    for (int j = 0; j < w->u.n; j++)
        memcpy(w->u.x + (size_t)w->u.ld * j, r->inputs->x + (size_t)r->inputs->ld * j,
               sizeof *w->u.x * (size_t)w->u.m);
    for (int c = 0; c < h->count; c++)
        cblas_daxpy(w->u.m, w->trial[c], h->s.x + (size_t)h->s.ld * c, 1,
                    w->u.x + (size_t)w->u.ld * h->input[c], 1);
    return lines_make(r->responses, &w->u, &r->records, r->band, out, err);
}

/* The poles of FROM but one (-1: all), fitted by so many steps, with w->trial. */
static enum modal_status fit(struct work *w, const struct account *from, int but, int steps,
                             struct account *out, struct modal_error *err)
{
    int drives = from->lines.drives;
    double complex q[LINES_DRIVES_MOST];
    struct transfer_limits limits = { steps, FORCED_ENOUGH_EACH, &w->work, w->limits->cancelled,
                                      w->limits->context };
    enum modal_status rc = set_lines(w, &out->lines, err);

    if (rc == MODAL_OK)
        rc = transfer_new(&out->lines, &out->model, err);
    for (int p = 0; p < from->model.poles && rc == MODAL_OK; p++) {
        for (int j = 0; j < drives; j++)
            /* of units that changed with the input */
            q[j] = from->model.q[j + (size_t)p * drives] * out->lines.size[j] / from->lines.size[j];
        if (p != but)
            transfer_add(&out->lines, &out->model, from->model.s[p], q);
    }
    return rc == MODAL_OK ? transfer_fit(&out->lines, &limits, &out->model, err) : rc;
}

/* That in the place of *BEST, and w->trial of w->a, where it is likelier; *more: it is. */
static enum modal_status try(struct work *w, const struct account *from, int but,
                             struct account *best, bool *more, struct modal_error *err)
{
    struct account next = { 0 }, last = *best;
    enum modal_status rc = fit(w, from, but, FORCED_STEPS_EACH, &next, err);

    *more = rc == MODAL_OK && next.model.likelihood > best->model.likelihood;
    if (*more) {
        *best = next, next = last;
        memcpy(w->a, w->trial, sizeof *w->a * (size_t)w->shapes.count);
    }
    account_done(&next);
    return rc;
}

static double score_of(const struct work *w, int c)
{
    return w->M[(size_t)(w->shapes.count + 1) * (c + 1)];
}

static double information(const struct work *w, int c, int k)
{
    return w->M[c + 1 + (size_t)(w->shapes.count + 1) * (k + 1)];
}

/* One sweep over the d that are ASKED; how many changed. */
static int sweep(struct work *w, double *d)
{
    int n = w->shapes.count, changed = 0;

    for (int c = 0; c < n; c++) {
        double slope = score_of(w, c), own = information(w, c, c), last = d[c];
        if (!w->asked[c] || !(own > 0))
            continue;
        for (int k = 0; k < n; k++)
            slope -= information(w, c, k) * d[k];
        d[c] = fmax(d[c] + slope / own, -w->a[c]);
        changed += d[c] != last;
        w->work -= n;
    }
    return changed;
}

/* The most of score . d - d . information d / 2 over a + d >= 0, d 0 but where ASKED. */
static double climb(struct work *w, double *d)
{
    int n = w->shapes.count;
    double all = 0;

    memset(d, 0, sizeof *d * (size_t)n);
    for (int i = 0; i < SWEEPS && sweep(w, d) > 0; i++)
        continue;
    w->work -= (double)n * n;
    for (int c = 0; c < n; c++) {
        double slope = score_of(w, c);
        for (int k = 0; k < n; k++)
            slope -= information(w, c, k) * d[k] / 2;
        all += slope * d[c];
    }
    return all;
}

/* *d, the step of all a that are not 0 and of those that join them; what it promises in ln
 * likelihood.  LEADING, where it is asked for: the first to join. */
static double choose(struct work *w, double *d, int *leading)
{
    int n = w->shapes.count, best, joined = 0;
    double before;

    for (int c = 0; c < n; c++)
        w->asked[c] = w->a[c] > 0;
    do {
        double most = before = climb(w, d);
        best = -1;
        for (int c = 0; c < n; c++)
            if (!w->asked[c] && (w->only < 0 || w->only == c) && w->work > 0) {
                double with;
                w->asked[c] = true;
                with = climb(w, d);
                w->asked[c] = false;
                if (2 * (with - before) > w->price && with > most)
                    most = with, best = c;
            }
        if (best >= 0)
            w->asked[best] = true;
        if (best >= 0 && joined++ == 0 && leading != NULL)
            *leading = best;
    } while (best >= 0 && w->work > 0);
    return climb(w, d);
}

/* w->M of *K. */
static enum modal_status gain(struct work *w, struct account *k, struct modal_error *err)
{
    if (w->limits->cancelled != NULL && w->limits->cancelled(w->limits->context))
        return modal_fail(err, MODAL_CANCELLED, "cancelled");
    w->work -= transfer_gain_work(&k->lines, k->model.poles, w->shapes.count);
    return transfer_gain(&k->lines, &k->model, &w->more, w->M, NULL, err);
}

/* w->a with *K, from where both are. */
static enum modal_status seek(struct work *w, struct account *k, struct modal_error *err)
{
    bool more = true;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < ROUNDS && rc == MODAL_OK && more && w->work > 0; i++) {
        rc = gain(w, k, err);
        more = false;
        if (rc != MODAL_OK || !(choose(w, w->step, NULL) > FORCED_ENOUGH_EACH))
            break;
        for (int t = 0; t < TRIES && rc == MODAL_OK && !more; t++) {
            for (int c = 0; c < w->shapes.count; c++)
                w->trial[c] = w->a[c] + ldexp(w->step[c], -t);
            rc = try(w, k, -1, k, &more, err);
        }
    }
    return rc;
}

static void copy_shape(const void *of, int column, int first, int rows, double complex *U)
{
    const struct lines *cut = of;

    memcpy(U, cut->W + first + (size_t)column * cut->count, sizeof *U * (size_t)rows);
}

static void clear(const struct work *w, double *a)
{
    memset(a, 0, sizeof *a * (size_t)w->shapes.count);
}

/* Is the account *K with w->a better than the own one, and than itself without? */
static enum modal_status is_better(struct work *w, const struct account *k, bool *better,
                                   struct modal_error *err)
{
    struct account none = { 0 };
    double price = 0;
    enum modal_status rc = MODAL_OK;

    for (int c = 0; c < w->shapes.count; c++)
        price += w->a[c] > 0 ? w->price : 0;
    *better = price > 0 && forced_bic(&k->lines, &k->model) + price < w->bic;
    clear(w, w->trial);
    if (*better)
        rc = fit(w, k, -1, FORCED_STEPS_EACH, &none, err);
    *better = *better && rc == MODAL_OK
        && 2 * (k->model.likelihood - none.model.likelihood) > price;
    account_done(&none);
    return rc;
}

/* The pole of the own account in whose place shapes promise most, and the SHAPE that does; -1: none
 * promises anything. */
static enum modal_status find_pole(struct work *w, int *pole, int *shape, struct modal_error *err)
{
    double most = -HUGE_VAL;
    enum modal_status rc = MODAL_OK;

    *pole = -1;
    clear(w, w->trial), clear(w, w->a);
    for (int p = 0; p < w->own.model.poles && rc == MODAL_OK && w->work > 0; p++) {
        struct account less = { 0 };
        double promise = 0;
        int leading;
        rc = fit(w, &w->own, p, 0, &less, err);
        if (rc == MODAL_OK)
            rc = gain(w, &less, err);
        if (rc == MODAL_OK)
            promise = choose(w, w->step, &leading);
        if (promise > 0 && less.model.likelihood + promise > most) {
            most = less.model.likelihood + promise;
            *pole = p, *shape = leading;
        }
        account_done(&less);
    }
    return rc;
}

/* The own account, LESS one pole where that is asked for, with the likeliest w->a. */
static enum modal_status find_account(struct work *w, bool less, struct account *out,
                                      struct modal_error *err)
{
    int pole = -1, shape = 0;
    bool more;
    enum modal_status rc = less ? find_pole(w, &pole, &shape, err) : MODAL_OK;

    if (rc != MODAL_OK || (less && pole < 0))
        return rc;
    clear(w, w->trial);
    rc = fit(w, &w->own, pole, FORCED_STEPS_EACH, out, err);
    for (int i = 0; i < HEIGHTS && rc == MODAL_OK && less; i++) {
        w->trial[shape] = ldexp(LOWEST, i);
        rc = try(w, &w->own, pole, out, &more, err);
    }
    /* the way from several heights is one number's */
    w->only = less ? shape : -1;
    for (; rc == MODAL_OK && w->only >= 0; w->only = -1) {
        rc = seek(w, out, err);
        memcpy(w->trial, w->a, sizeof *w->a * (size_t)w->shapes.count);
        /* poles that the way bent, where it began */
        if (rc == MODAL_OK)
            rc = try(w, &w->own, pole, out, &more, err);
    }
    return rc == MODAL_OK ? seek(w, out, err) : rc;
}

static enum modal_status ask(struct work *w, bool *cut, struct modal_error *err)
{
    const struct clipping_record *r = w->record;
    enum modal_status rc = lines_make(r->responses, &w->shapes.s, &r->records, r->band, &w->cut,
                                      err);

    for (int c = 0; c < w->shapes.count && rc == MODAL_OK; c++)
        cblas_zdscal(w->cut.count, w->cut.size[c], w->cut.W + (size_t)c * w->cut.count, 1);
    if (rc == MODAL_OK)
        rc = set_lines(w, &w->own.lines, err);
    w->work = rc == MODAL_OK ? forced_work(&w->own.lines, w->limits) : 0;
    w->more = (struct transfer_more) { w->shapes.count, w->shapes.input, copy_shape, &w->cut };
    for (int less = 0; less <= 1 && rc == MODAL_OK && !*cut; less++) {
        struct account k = { 0 };
        rc = find_account(w, less > 0, &k, err);
        if (rc == MODAL_OK)
            rc = is_better(w, &k, cut, err);
        account_done(&k);
    }
    return rc;
}

/* As the search left it. */
static double own_bic(const struct forced_search *own)
{
    int i = 0;

    while (own->rung[i].poles != own->model.poles)
        i++;
    return own->rung[i].bic;
}

/* Of so many shapes. */
static enum modal_status work_init(struct work *w, size_t most, struct modal_error *err)
{
    const struct matrix *u = w->record->inputs;

    w->only = -1;
    w->u = matrix_new(u->m, u->n);
    w->shapes.s = matrix_new(u->m, (int)most);
    if (w->shapes.s.x != NULL)
        memset(w->shapes.s.x, 0, sizeof *w->shapes.s.x * (size_t)u->m * most);
    w->shapes.input = malloc(sizeof *w->shapes.input * most);
    w->a = calloc(most, sizeof *w->a), w->trial = calloc(most, sizeof *w->trial);
    w->step = calloc(most, sizeof *w->step);
    w->asked = malloc(sizeof *w->asked * most);
    w->M = malloc(sizeof *w->M * (most + 1) * (most + 1));
    return w->u.x != NULL && w->shapes.s.x != NULL && w->shapes.input != NULL && w->a != NULL
            && w->trial != NULL && w->step != NULL && w->asked != NULL && w->M != NULL
        ? MODAL_OK
        : modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d inputs", u->n);
}

enum modal_status clipping_find(const struct clipping_record *r, const struct forced_search *own,
                                const struct forced_limits *limits, struct clipping *out, bool *cut,
                                struct modal_error *err)
{
    struct work w = { .record = r, .own.model = own->model, .bic = own_bic(own),
                      .limits = limits };
    const struct matrix *u = r->inputs;
    int L = u->m, n = 0;
    enum modal_status rc;

    *cut = false;
    for (int j = 0; j < u->n; j++)
        n += count_shapes(u->x + (size_t)u->ld * j, L, &out[j]);
    if (n == 0 || own->model.poles == 0)
        return MODAL_OK;
    rc = work_init(&w, (size_t)n, err);
    for (int j = 0; j < u->n && rc == MODAL_OK; j++)
        add_shapes(&w.shapes, u->x + (size_t)u->ld * j, j, &out[j]);
    /* as a number costs there, and one of so many */
    w.price = log((double)L * r->responses->n) + 2 * log(n);
    if (rc == MODAL_OK)
        rc = ask(&w, cut, err);
    for (int j = 0; j < r->inputs->n && *cut; j++) {
        bool any = false;
        for (int c = 0; c < n; c++)
            any = any || (w.shapes.input[c] == j && w.a[c] > 0);
        out[j].samples *= any;
    }
    lines_done(&w.cut), lines_done(&w.own.lines);
    free(w.u.x), free(w.shapes.s.x), free(w.shapes.input);
    free(w.a), free(w.trial), free(w.step), free(w.asked), free(w.M);
    *cut = *cut && rc == MODAL_OK;
    return rc;
}
