/*
 * identify_families.c - a periodic system whose period is no whole number of samples: each
 * multiplier as the family of its lines
 *
 * Samples a period apart are none of the record's then, and no fold makes rows of it.  But the
 * response is a sum over the exponents of periodic functions times exponentials [BW], and so of
 *
 *     lines   g_jk e^{(lambda_j + i k Omega) t},   k = .., -1, 0, 1, ..                         (1)
 *
 * The poles of a constant system, one a line, know nothing of each other: there are as many
 * exponents as lines, and a weak line, which alone tells its exponent badly, is fitted as if it
 * were worth two unknowns.  Here all lines of a family have one exponent (refine.h, omega), so
 * that the unknowns of the search are the multipliers, whatever harmonics they have.
 *
 * Start: the record at even phases, by polynomials between samples (turns.h), is one of a whole
 * number of samples a period, with the same multipliers and the errors of the polynomials; it is
 * searched as such (identify_even.c).  Then, in the samples themselves, of all lines below
 * Nyquist, or where they are many of the slowest and those that what is left shows (lines_seen.h),
 * those are kept that pay, all exponents are refined, and families that do not pay leave,
 * by the criterion of all searches (criterion.h).  Where others' lines can stand in for those of a
 * family, as where the record does not resolve them, it leaves for them.  At last each family is
 * tried as two, which even phases of few periods did not tell apart.
 *
 * [D96] Djuric, IEEE Trans. Signal Process. 44 (1996) 1744-1751.
 */
#include "modal/identify/identify_state.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/colour.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/order/choose_lines.h"
#include "modal/identify/order/lines_seen.h"
#include "modal/identify/order/remainder.h"
#include "modal/linalg/svd.h"

static const double
    SAME = 0.01,                /* of omega: poles that begin one family, as modes.c has them, */
    ROWS_SHARE = 0.5;           /* of the rows, at most, as columns: the rest tell the noise */
enum {
    LINES_MOST = 256,           /* that are fitted to choose from: of more, those that are seen */
    ROUNDS = 4,                 /* of lines by exponents and exponents by lines */
    STEPS = 5,                  /* of a fit without a family, before it is asked whether it gains */
    STEPS_MOST = 60             /* in all, as many as any fit takes */
};
/* Without a family: others put in its lines' place, those refined, and chosen from. */
enum { PUT, REFINED, PRUNED, WAYS };

struct families {
    const struct work *w;
    double Omega;
    int count, begun;           /* begun: with so many exponents' numbers */
    double complex *head;       /* principal, Im in [0, Omega/2] */
    struct lines all;           /* that may be */
    int room;                   /* for them, wherever the heads come to lie */
    bool many;                  /* they are: a look is dear, and bounds say which are worth one */
    double rival;               /* criterion of the fit that stands; 0: none does */
    double work, spent;         /* multiplications there may still be; of all fits so far */
    bool given_up;              /* they are spent, or the rival has won */
    bool limited;               /* they were spent before all of the fit was tried */
    struct workspace space;
};

bool work_has_families(const struct work *w)
{
    return w->rec.period > 0 && w->shift == 1 && !w->rec.wide && w->blocks == NULL && w->refine
        && w->rec.shift_rad_s == 0 && w->opt.method == IDENTIFY_AUTO
        && w->opt.rank.rule == RANK_AUTO && w->opt.rank.most == 0
        && w->rec.Y.m >= 2 * w->rec.period / w->rec.step;
}

/* ---- the multipliers to begin with ---- */

static bool add_head(struct families *f, double complex lambda)
{
    double complex *all = workspace_zeros(&f->space, (size_t)f->count + 1, sizeof *all);

    if (f->space.failed)
        return false;
    for (int j = 0; j < f->count; j++)
        all[j] = f->head[j];
    all[f->count++] = lambda;
    f->head = all;
    return true;
}

/* Heads more: the multipliers of Y, of the signals or what is left of them, at even phases. */
static enum modal_status add_heads(struct families *f, const struct matrix *Y,
                                   struct modal_error *err)
{
    struct order_choice found = { .chosen = -1 };
    enum modal_status rc = work_choose_even(f->w, Y, &found, err);
    const struct refined *fit = found.chosen >= 0 ? &found.candidates[found.chosen].fit : NULL;

    for (int j = 0; fit != NULL && j < fit->poles && rc == MODAL_OK; j++)
        if (!add_head(f, fit->lambda[j]))
            rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d families", f->count);
    order_done(&found);
    return rc;
}

/* The principal value, Im in [0, Omega/2], of an exponent or its conjugate. */
static double complex principal(const struct families *f, double complex lambda)
{
    double im = cimag(lambda);

    return CMPLX(creal(lambda), fabs(im - nearbyint(im / f->Omega) * f->Omega));
}

/* Heads more: poles of FIT, each for itself, but those that are lines of one before, within their
 * errors. */
static enum modal_status add_poles(struct families *f, const struct refined *fit,
                                   struct modal_error *err)
{
    for (int j = 0; j < fit->poles; j++) {
        double complex head = principal(f, fit->lambda[j]);
        double apart = SAME * f->Omega + REFINE_APART * hypot(fit->std_re[j], fit->std_im[j]);
        bool known = fit->lambda[j] == 0;
        for (int i = 0; i < f->count; i++)
            known |= !(cabs(f->head[i] - head) > apart);     /* of unknown errors: NAN */
        if (!known && !add_head(f, head))
            return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d families",
                              f->count);
    }
    return MODAL_OK;
}

/* ---- lines ---- */

static bool lines_new(struct families *f, struct lines *l, int room)
{
    l->lambda = workspace_zeros(&f->space, (size_t)room, sizeof *l->lambda);
    l->family = workspace_zeros(&f->space, (size_t)room, sizeof *l->family);
    l->count = 0;
    return !f->space.failed;
}

/* Line k of family j, as one of a pair with Im >= 0. */
static void add_line(const struct families *f, int j, int k, struct lines *l)
{
    double im = cimag(f->head[j]) + k * f->Omega;

    l->family[l->count] = j;
    l->lambda[l->count++] = CMPLX(creal(f->head[j]), fabs(im));
}

/* (1) below FASTEST rad/s.  A real multiplier's lines are pairs of k and -k, or of k and -1-k. */
static void all_lines(struct families *f, double fastest)
{
    f->all.count = 0;
    for (int j = 0; j < f->count; j++) {
        double im = cimag(f->head[j]);
        bool real = im <= REFINE_TIED * f->Omega || f->Omega / 2 - im <= REFINE_TIED * f->Omega;
        int most = (int)((fastest + im) / f->Omega);
        if (real)
            f->head[j] = CMPLX(creal(f->head[j]), im < f->Omega / 4 ? 0 : f->Omega / 2);
        for (int k = real ? 0 : -most; k <= most; k++)
            if (fabs(cimag(f->head[j]) + k * f->Omega) <= fastest)
                add_line(f, j, k, &f->all);
    }
}

static void copy_lines(const struct lines *from, struct lines *to)
{
    memcpy(to->lambda, from->lambda, sizeof *to->lambda * (size_t)from->count);
    memcpy(to->family, from->family, sizeof *to->family * (size_t)from->count);
    to->count = from->count;
}

static int lines_columns(const struct families *f, const struct lines *l)
{
    return poles_order(l->lambda, l->count, f->w->tau);
}

/* As fast as there are rows for, and Nyquist allows. */
static void make_lines(struct families *f)
{
    double fastest = DIAGNOSE_NYQUIST * M_PI / f->w->tau;

    all_lines(f, fastest);
    while ((f->all.count > LINES_MOST
            || lines_columns(f, &f->all) > ROWS_SHARE * f->w->data.Y->m) && fastest > f->Omega) {
        fastest -= f->Omega / 2;
        all_lines(f, fastest);
    }
}

/* ---- exponents ---- */

/* What a line's column must gain at least. */
static double a_column(const struct families *f)
{
    return f->w->data.Y->n * log((double)f->w->data.Y->m * f->w->data.Y->n);
}

/* HEAD by the lines of FIT, of L. */
static void take_heads(const struct families *f, const struct lines *l, const struct refined *fit,
                       double complex *head)
{
    for (int i = l->count - 1; i >= 0; i--)
        head[l->family[i]] = principal(f, fit->lambda[i]);
}

static struct heads heads_of(const struct families *f)
{
    return (struct heads) { f->head, f->count, f->Omega, f->w->tau, f->w->data.Y->m };
}

/* Of all lines those join OTHER that what FIT leaves shows. */
static enum modal_status add_seen(const struct families *f, const struct refined *fit,
                                  struct lines *other, struct modal_error *err)
{
    struct heads h = heads_of(f);
    struct matrix E = { 0 };
    enum modal_status rc = remainder_of(&f->w->data, fit, &E, err);

    if (rc == MODAL_OK && E.x != NULL)
        rc = lines_seen(&h, &E, ORDER_LOOK * 2 * a_column(f), &f->all, other, err);
    free(E.x);
    return rc;
}

/* The slowest lines, and with their exponents as they are those that what they leave shows, until
 * it shows none: a strong line that is left out would draw other families to it. */
static enum modal_status begin_lines(struct families *f, struct lines *other,
                                     struct modal_error *err)
{
    const struct refine_options look = { .iterations = -1 };
    enum modal_status rc = MODAL_OK;

    make_lines(f);
    copy_lines(&f->all, other);
    all_lines(f, DIAGNOSE_NYQUIST * M_PI / f->w->tau);
    for (int had = 0; rc == MODAL_OK && other->count > had;) {
        struct refined fit;
        rc = lines_choose(&f->w->data, other, err);
        if (rc != MODAL_OK || other->count <= had)
            break;                              /* of what was seen none pays */
        had = other->count;
        rc = refine_poles(&f->w->data, other->lambda, other->count, NULL, &look, &fit, err);
        if (rc != MODAL_OK)
            break;
        f->spent += fit.work, f->work = fmax(f->work - fit.work, 1);
        rc = add_seen(f, &fit, other, err);
        refined_done(&fit);
    }
    return rc;
}

/* Lines to choose from: all; of more than are fitted at once, once there is a *FIT, of L, those
 * that it has and those that what it leaves shows. */
static enum modal_status lines_to_try(struct families *f, const struct lines *l,
                                      const struct refined *fit, struct lines *other,
                                      struct modal_error *err)
{
    all_lines(f, DIAGNOSE_NYQUIST * M_PI / f->w->tau);
    /* pairs twice as many as are begun with fill no more than the share of the rows */
    f->many = f->all.count > LINES_MOST && 4 * LINES_MOST <= ROWS_SHARE * f->w->data.Y->m;
    if (!f->many) {
        make_lines(f);
        copy_lines(&f->all, other);
        return MODAL_OK;
    }
    if (l->count == 0)
        return begin_lines(f, other, err);
    copy_lines(l, other);
    memcpy(other->lambda, fit->lambda, sizeof *fit->lambda * (size_t)l->count);
    return add_seen(f, fit, other, err);
}

/* Exponents by lines and lines by exponents, until the lines stay; those of L, where there are any,
 * have *FIT, and stay where others are no better.  Where there are none, *FIT, if any, is that of
 * more families, and L stays empty where that stands. */
static enum modal_status settle_lines(struct families *f, struct lines *l, struct refined *fit,
                                      struct modal_error *err)
{
    struct lines other;
    int before = -1;
    enum modal_status rc = MODAL_OK;

    if (!lines_new(f, &other, f->room))
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d lines", f->room);
    for (int i = 0; i < ROUNDS && rc == MODAL_OK && !f->given_up; i++) {
        struct refine_options opt = { .rival = f->rival, .work = f->work };
        struct refined look;
        bool better, stands;
        if ((rc = lines_to_try(f, l, fit, &other, err)) != MODAL_OK
            || (rc = lines_choose(&f->w->data, &other, err)) != MODAL_OK || other.count == before)
            break;
        before = other.count;
        rc = refine_poles(&f->w->data, other.lambda, other.count, NULL, &opt, &look, err);
        if (rc != MODAL_OK)
            break;
        f->spent += look.work, f->work = fmax(f->work - look.work, 1);
        f->limited |= look.end == REFINE_STOPPED;
        /* what the work allowed has ended is no reason to leave what converged, or is better */
        stands = look.end == REFINE_STOPPED && fit->poles > 0
              && (refined_converged(fit) || fit->bic <= look.bic);
        better = !stands && (l->count == 0 || look.bic < fit->bic);
        f->given_up = stands;
        if (better) {
            take_heads(f, &other, &look, f->head);
            copy_lines(&other, l);
            refined_done(fit);
            *fit = look;
            f->given_up = fit->end == REFINE_HOPELESS || fit->end == REFINE_STOPPED;
        } else {
            refined_done(&look);
            break;
        }
    }
    return rc == MODAL_NO_CONVERGENCE && l->count > 0 ? MODAL_OK : rc;
}

/* L without family J. */
static void without(const struct lines *l, int j, struct lines *less)
{
    less->count = 0;
    for (int i = 0; i < l->count; i++)
        if (l->family[i] != j) {
            less->family[less->count] = l->family[i];
            less->lambda[less->count++] = l->lambda[i];
        }
}

/* LESS, without family J, with what may stand in for its lines: of all others the lines nearest to
 * them, which among lines that the record does not resolve have left one by one. */
static void stand_in(const struct families *f, const struct lines *l, int j, struct lines *less)
{
    for (int i = 0; i < l->count; i++)
        for (int a = 0; l->family[i] == j && a < f->all.count && less->count < f->room; a++) {
            bool has = f->all.family[a] == j
                    || fabs(cimag(f->all.lambda[a] - l->lambda[i])) > f->Omega / 2;
            for (int b = 0; b < less->count && !has; b++)
                has = less->family[b] == f->all.family[a]
                   && cabs(less->lambda[b] - f->all.lambda[a]) < REFINE_TIED * f->Omega;
            if (has)
                continue;
            less->family[less->count] = f->all.family[a];
            less->lambda[less->count++] = f->all.lambda[a];
        }
}

/* What the criterion asks too little of a multiplier's numbers beside lines: its prices are ln n
 * each, as of an amplitude, whose information goes with the rows; that of an exponent goes with
 * their cube [D96]. Poles are all short of it alike; families and lines are not. */
static double short_of(const struct families *f, int exponents)
{
    double L = f->w->data.Y->m, S = f->w->data.Y->n;

    return exponents * fmax(3 * log(L) - (1 + 1 / S) * log(L * S), 0);
}

/* Real numbers in the heads FIRST to LAST - 1. */
static int exponents_of(const struct families *f, int first, int last)
{
    int count = 0;

    for (int j = first; j < last; j++)
        count += cimag(f->head[j]) > 0 && cimag(f->head[j]) < f->Omega / 2 ? 2 : 1;
    return count;
}

/* Is there another that the record does not tell from family J? */
static bool has_neighbour(const struct families *f, int j)
{
    bool has = false;

    for (int i = 0; i < f->count; i++)
        has |= i != j
            && cabs(f->head[i] - f->head[j]) < M_PI / (f->w->tau * f->w->data.Y->m);
    return has;
}

/* LESS made ready for WAY; *ready: it is another than the way before had. */
static enum modal_status go_way(const struct families *f, const struct lines *l, int j, int way,
                                struct lines *less, bool *ready, struct modal_error *err)
{
    int before = less->count;
    enum modal_status rc = MODAL_OK;

    if (way == PUT)
        stand_in(f, l, j, less);
    if (way == PRUNED)
        rc = lines_choose(&f->w->data, less, err);
    *ready = way == REFINED || less->count != before;
    return rc;
}

/* *LOOK, the caller's: LESS by OPT, which may ask for a look only; else so many STEPS at a time,
 * until it has converged, or these leave more than half of what it LACKS of OWN: in reach of its
 * end a search leaves less with each step.  LESS then lies where it ended. */
static enum modal_status refine_without(struct families *f, struct lines *less,
                                        struct refine_options *opt, double own, double lacks,
                                        struct refined *look, struct modal_error *err)
{
    bool asked = opt->iterations < 0, goes_on = true;
    enum modal_status rc = MODAL_OK;

    *look = (struct refined) { 0 };
    for (int steps = 0; goes_on && rc == MODAL_OK; steps += STEPS) {
        double before = lacks;
        refined_done(look);
        opt->iterations = asked ? -1 : f->many ? STEPS : STEPS_MOST, opt->work = f->work;
        rc = refine_poles(&f->w->data, less->lambda, less->count, NULL, opt, look, err);
        if (rc != MODAL_OK)
            break;
        f->spent += look->work, f->work = fmax(f->work - look->work, 1);
        if (asked)
            break;
        memcpy(less->lambda, look->lambda, sizeof *look->lambda * (size_t)less->count);
        lacks = look->bic - own;
        goes_on = f->many && look->end == REFINE_STALLED && steps < STEPS_MOST
               && (lacks < before / 2 || lacks < ORDER_SPLIT_REACH);
    }
    return rc;
}

/* What the criterion may gain where a family leaves, and which and how. */
struct idle { double best; int family; double complex *head; };

/* L without family J for *IDLE, where that is less: as the exponents are, what it is TOLD, and
 * where that does not do, with what may stand in for its lines if they can, refined where that is
 * near, or one is that may take its place, and then less the lines that do not pay. */
static enum modal_status try_without(struct families *f, const struct lines *l, int j,
                                     const struct refined *fit, const struct lines_family *told,
                                     struct lines *less, struct idle *idle,
                                     struct modal_error *err)
{
    double own = fit->bic + short_of(f, exponents_of(f, j, j + 1));
    bool exact = fit->residual <= REFINE_EXACT * safe_matrix_norm(f->w->data.Y),
         put = !exact && (!f->many || told->least < own + ORDER_SPLIT_REACH),
         near = has_neighbour(f, j) || told->alone < own + ORDER_SPLIT_REACH, ready,
         idles = told->alone < own;
    int alone;
    enum modal_status rc = MODAL_OK;

    without(l, j, less), alone = lines_columns(f, less);
    if (told->alone - own < idle->best) {
        idle->best = told->alone - own, idle->family = j;
        memcpy(idle->head, f->head, sizeof *f->head * (size_t)f->count);
    }
    for (int way = put ? PUT : REFINED; way < WAYS && rc == MODAL_OK && (way < REFINED || near)
         && !idles; way++) {
        struct refine_options opt = { .iterations = way < REFINED ? -1 : 0, .work = f->work };
        struct refined look;
        if (f->work <= 1) {
            f->limited = true;
            break;
        }
        rc = go_way(f, l, j, way, less, &ready, err);
        if (rc != MODAL_OK || !ready)
            continue;
        /* lines put in its place may leave again */
        opt.rival = own + a_column(f) * (lines_columns(f, less) - alone);
        rc = refine_without(f, less, &opt, own, told->alone - own, &look, err);
        if (rc != MODAL_OK)
            break;
        near |= look.bic < own + ORDER_SPLIT_REACH;
        idles = look.bic < own && look.end != REFINE_DEGENERATE;
        if (look.bic - own < idle->best && look.end != REFINE_DEGENERATE) {
            idle->best = look.bic - own, idle->family = j;
            take_heads(f, less, &look, idle->head);
        }
        f->limited |= look.end == REFINE_STOPPED;
        refined_done(&look);
    }
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}

/* What leaving out each family costs, by one evaluation for all; the caller frees it. */
static enum modal_status tell_families(struct families *f, const struct lines *l,
                                       struct lines_family **told, struct modal_error *err)
{
    struct lines_family *each = workspace_zeros(&f->space, (size_t)f->count, sizeof *each);
    double *share = workspace_numbers(&f->space, (size_t)f->count, 1);
    struct heads h = heads_of(f);
    enum modal_status rc = workspace_check(&f->space, "identify: no memory for families", err);

    if (rc == MODAL_OK)
        rc = lines_shares(&h, share, err);
    for (int j = 0; j < f->count && rc == MODAL_OK; j++)
        each[j] = (struct lines_family) { exponents_of(f, j, j + 1), share[j], HUGE_VAL,
                                          -HUGE_VAL };
    if (rc == MODAL_OK)
        rc = lines_without(&f->w->data, l, f->count, each, err);
    *told = each;
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;  /* lines that coincide: each is tried */
}

/* The family that the lines do best without, and heads, others in their place, as they are
 * then; -1: all pay. */
static enum modal_status find_idle(struct families *f, const struct lines *l,
                                   const struct refined *fit, int *family, struct modal_error *err)
{
    struct lines less;
    struct lines_family *told;
    struct idle idle = { 0, -1, workspace_zeros(&f->space, (size_t)f->count, sizeof *idle.head) };
    enum modal_status rc = MODAL_OK;

    *family = -1;
    if (idle.head == NULL || !lines_new(f, &less, f->room))
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d lines", f->room);
    if (f->count < 2)
        return MODAL_OK;
    rc = tell_families(f, l, &told, err);
    all_lines(f, DIAGNOSE_NYQUIST * M_PI / f->w->tau);
    for (int j = 0; j < f->count && rc == MODAL_OK; j++)
        rc = try_without(f, l, j, fit, &told[j], &less, &idle, err);
    *family = idle.family;
    f->head = idle.family >= 0 ? idle.head : f->head;
    return rc;
}

static void drop_family(struct families *f, int j)
{
    memmove(f->head + j, f->head + j + 1, sizeof *f->head * (size_t)(f->count - j - 1));
    f->count--;
}

/* Room for the lines of all families, from -Nyquist to Nyquist and one at either end. */
static enum modal_status make_room(struct families *f, struct lines *l, struct modal_error *err)
{
    f->room = f->count * ((int)(2 * M_PI / f->w->tau / f->Omega) + 2);
    return lines_new(f, &f->all, f->room) && lines_new(f, l, f->room)
        ? MODAL_OK
        : modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d lines", f->room);
}

/* ---- one family as two ---- */

/* Family J of F in G as two: along the axis that it lies on, or that a record does not tell it
 * from, else along its frequency. So put they explain what the one and its derivative do, but for
 * (half t)^2 / 2 of its amplitude: 3 % at the ends of the record, where strong families can spare
 * no more. */
static bool part_family(const struct families *f, int j, struct families *g)
{
    double half = ORDER_SPLIT_HALF / 2 / (f->w->tau * f->w->data.Y->m), re = creal(f->head[j]),
           im = cimag(f->head[j]), axis = im < f->Omega / 4 ? 0 : f->Omega / 2;
    bool real = fabs(im - axis) < 4 * M_PI * half;

    *g = *f;
    g->space = (struct workspace) { 0 };
    g->head = NULL, g->count = 0;
    for (int i = 0; i < f->count; i++)
        if (!add_head(g, f->head[i]))
            return false;
    g->head[j] = real ? CMPLX(re + half, axis) : CMPLX(re, im + half);
    return add_head(g, real ? CMPLX(re - half, axis) : CMPLX(re, im - half));
}

/* Of all lines of G those that L has of its families. */
static void part_lines(const struct families *g, const struct lines *l, int j, struct lines *more)
{
    double near = 3 * M_PI * ORDER_SPLIT_HALF / (g->w->tau * g->w->data.Y->m);

    for (int a = 0; a < g->all.count; a++) {
        int family = g->all.family[a] < g->count - 1 ? g->all.family[a] : j;
        bool has = false;
        for (int i = 0; i < l->count && !has; i++)
            has = l->family[i] == family
               && fabs(cimag(l->lambda[i]) - cimag(g->all.lambda[a])) < near;
        if (!has)
            continue;
        more->family[more->count] = g->all.family[a];
        more->lambda[more->count++] = g->all.lambda[a];
    }
}

/* G, with MORE lines like those of L, refined where that comes near the criterion OWN; *look, the
 * caller's: below it, or empty. */
static enum modal_status fit_parted(struct families *g, const struct lines *l, int j, double own,
                                    struct lines *more, struct refined *look,
                                    struct modal_error *err)
{
    double dearer = short_of(g, exponents_of(g, 0, g->count)), worth = -HUGE_VAL;
    enum modal_status rc = make_room(g, more, err);

    if (rc != MODAL_OK)
        return rc;
    all_lines(g, DIAGNOSE_NYQUIST * M_PI / g->w->tau);
    part_lines(g, l, j, more);
    if (lines_columns(g, more) > ROWS_SHARE * g->w->data.Y->m)
        return MODAL_OK;
    rc = lines_choose(&g->w->data, more, err);
    for (int most = -1; most <= 0 && rc == MODAL_OK && worth < own + ORDER_SPLIT_REACH; most++) {
        struct refine_options opt = { .iterations = most, .work = g->work,
                                      .rival = own - dearer };
        refined_done(look);
        rc = refine_poles(&g->w->data, more->lambda, more->count, NULL, &opt, look, err);
        if (rc != MODAL_OK)
            break;
        worth = look->end == REFINE_DEGENERATE ? HUGE_VAL : look->bic + dearer;
        g->spent += look->work, g->work = fmax(g->work - look->work, 1);
        g->limited |= look->end == REFINE_STOPPED;
    }
    if (rc == MODAL_OK && worth < own && refined_converged(look))
        take_heads(g, more, look, g->head);
    else
        refined_done(look);
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;       /* lines that coincide: it stays one */
}

/* F, its lines L and *FIT become G's. */
static enum modal_status take_parted(struct families *f, const struct families *g,
                                     const struct lines *more, struct refined *look,
                                     struct lines *l, struct refined *fit,
                                     struct modal_error *err)
{
    enum modal_status rc;

    for (int i = 0; i < f->count; i++)
        f->head[i] = g->head[i];
    if (!add_head(f, g->head[g->count - 1]))
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d families", g->count);
    rc = make_room(f, l, err);
    if (rc != MODAL_OK)
        return rc;
    copy_lines(more, l);
    refined_done(fit);
    *fit = *look, *look = (struct refined) { 0 };
    return MODAL_OK;
}

/* The first family of L that is better as two becomes so, *parted: there is one.  What FIT leaves,
 * E, says which of them are tried. */
static enum modal_status part_one(struct families *f, struct lines *l, struct refined *fit,
                                  const struct matrix *E, bool *parted, struct modal_error *err)
{
    double own = fit->bic + short_of(f, exponents_of(f, 0, f->count)),
           dearer = 2 * a_column(f) / f->w->data.Y->n + short_of(f, 2);   /* of an exponent */
    int count = f->count;
    double *share = workspace_numbers(&f->space, (size_t)count, 1);
    struct heads h = heads_of(f);
    enum modal_status rc = workspace_check(&f->space, "identify: no memory for families", err);

    *parted = false;
    if (rc == MODAL_OK)
        rc = lines_shares(&h, share, err);
    for (int j = 0; j < count && rc == MODAL_OK && !*parted; j++) {
        struct families g;
        double pays = HUGE_VAL;
        if (E->x != NULL)
            rc = lines_beside(E, f->w->tau, l, j, share[j], ORDER_LOOK * 2 * a_column(f), &pays,
                              err);
        if (rc != MODAL_OK || pays < ORDER_LOOK * dearer)
            continue;
        struct lines more = { 0 };
        struct refined look = { 0 };
        rc = part_family(f, j, &g) ? fit_parted(&g, l, j, own, &more, &look, err)
                                   : modal_fail(err, MODAL_NO_MEMORY,
                                                "identify: no memory for %d families", count);
        f->spent = g.spent, f->work = g.work, f->limited = g.limited;
        *parted = rc == MODAL_OK && look.poles > 0;
        if (*parted)
            rc = take_parted(f, &g, &more, &look, l, fit, err);
        refined_done(&look);
        workspace_free(&g.space);
    }
    return rc;
}

static enum modal_status try_parts(struct families *f, struct lines *l, struct refined *fit,
                                   bool *parted, struct modal_error *err)
{
    struct matrix E = { 0 };
    enum modal_status rc = f->many ? remainder_of(&f->w->data, fit, &E, err) : MODAL_OK;

    if (rc == MODAL_OK)
        rc = part_one(f, l, fit, &E, parted, err);
    free(E.x);
    return rc;
}

/* *FIT: families that pay, and their lines. */
static enum modal_status fit_families(struct families *f, struct refined *fit,
                                      struct modal_error *err)
{
    struct lines l = { 0 };
    double least = HUGE_VAL;                         /* of what was better as more families */
    double complex *stood = NULL;                    /* heads of *FIT while one is left out */
    bool parted = false;
    int idle = 0;
    enum modal_status rc = make_room(f, &l, err);

    while (rc == MODAL_OK && (idle >= 0 || parted) && !f->given_up) {
        rc = settle_lines(f, &l, fit, err);
        if (f->given_up && l.count == 0)
            f->head = stood, f->count++;
        for (int i = 0; i < l.count && rc == MODAL_OK; i++)
            l.lambda[i] = fit->lambda[i];
        parted = false;
        if (rc != MODAL_OK || f->given_up)
            break;
        stood = f->head;
        rc = find_idle(f, &l, fit, &idle, err);
        if (rc == MODAL_OK && idle >= 0)
            drop_family(f, idle), l.count = 0;
        if (rc != MODAL_OK || idle >= 0 || !(fit->bic < least))
            continue;
        least = fit->bic;
        rc = try_parts(f, &l, fit, &parted, err);
    }
    return rc;
}

/* What FIT leaves, the caller's to free; *clean: at rounding, or one set of multipliers that leave
 * white noise. */
static enum modal_status look_at_rest(const struct families *f, const struct refined *fit,
                                      struct matrix *E, bool *clean, struct modal_error *err)
{
    const struct refine_data *d = &f->w->data;
    double mean[COLOUR_LAGS];
    enum modal_status rc = remainder_of(d, fit, E, err);

    colour_left_by(fit->lambda, fit->poles, d->tau, d->Y->m, mean);
    *clean = rc == MODAL_OK
          && (fit->residual <= REFINE_EXACT * safe_matrix_norm(d->Y)
              || (refined_converged(fit) && E->x != NULL && colour_white_about(E, mean, 0)));
    return rc;
}

/* The families become the one candidate of *choice. */
static enum modal_status hold_candidate(struct refined *fit, bool clean, bool limited,
                                        struct order_choice *choice, struct modal_error *err)
{
    choice->candidates = calloc(1, sizeof *choice->candidates);
    if (choice->candidates == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for a candidate");
    choice->candidates[0] = (struct order_candidate) { 0, true, *fit };
    choice->count = 1, choice->chosen = 0, choice->clean = clean, choice->limited = limited;
    *fit = (struct refined) { 0 };
    return MODAL_OK;
}

/* Families that begin with the poles of KNOWN, or with those of the signals where it is NULL, and
 * with those in what they leave, until that is noise or brings no better fit; *best, empty, is the
 * caller's; *limited: its work was spent before all of it was tried. */
static enum modal_status search_families(struct families *f, const struct refined *known,
                                         struct refined *best, bool *clean, bool *limited,
                                         struct modal_error *err)
{
    struct matrix E = { 0 };
    enum modal_status rc = known != NULL ? add_poles(f, known, err)
                                         : add_heads(f, f->w->data.Y, err);

    f->begun = exponents_of(f, 0, f->count);
    for (int i = 0, had = 0; i < ROUNDS && rc == MODAL_OK && f->count > had && !*clean; i++) {
        struct refined fit = { 0 };
        f->limited = false;
        rc = fit_families(f, &fit, err);
        if (rc == MODAL_NO_CONVERGENCE || rc == MODAL_BAD_INPUT) {
            refined_done(&fit);                      /* lines that coincide: those before stand */
            return MODAL_OK;
        }
        if (rc != MODAL_OK || (best->poles > 0 && (f->given_up || fit.bic >= best->bic))) {
            refined_done(&fit);
            break;
        }
        refined_done(best);
        *best = fit, *limited = f->limited;
        had = f->count;
        /* what stands may be all there is: to look for more costs no more than that did */
        f->rival = best->bic, f->work = fmin(f->work, f->spent);
        rc = look_at_rest(f, best, &E, clean, err);
        if (rc == MODAL_OK && !*clean && E.x != NULL)
            rc = add_heads(f, &E, err);
        free(E.x), E.x = NULL;
    }
    return rc;
}

enum modal_status work_choose_families(struct work *w, const struct refined *known,
                                       struct order_choice *choice, bool *fewer,
                                       struct modal_error *err)
{
    struct families f = { .w = w, .Omega = 2 * M_PI / w->rec.period,
                          .work = work_left(w, false, false) };
    struct refined fit = { 0 };
    bool clean = false, limited = false;
    enum modal_status rc;

    w->data.omega = f.Omega;
    rc = search_families(&f, known, &fit, &clean, &limited, err);
    *fewer = rc == MODAL_OK && known != NULL && fit.poles > 0
          && exponents_of(&f, 0, f.count) < f.begun
          && fit.bic < known->bic + short_of(&f, f.begun - exponents_of(&f, 0, f.count));
    if (rc == MODAL_OK && fit.poles > 0)
        rc = hold_candidate(&fit, clean, limited, choice, err);
    w->data.omega = 0;
    w->spent += f.spent;
    refined_done(&fit);
    workspace_free(&f.space);
    return rc;
}
