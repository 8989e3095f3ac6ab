/*
 * identify_stop.c - whether a response stops where its modes would last
 *
 * A response that a hand damps, a switch or a simulation ends, is followed by noise alone. Modes of
 * all rows make up for it: each that lasted there becomes a crowd whose parts cancel after the
 * stop, and which may leave white noise, with small errors that are wrong. Against such an answer
 * stands another model of the same rows: the modes of those before the stop, and after it a
 * constant. Channel c is left with r_c over its m rows; both are told by
 *
 *     B = sum_c m ln(r_c) + (order (1 + S) + constants) ln m,                                 (1)
 *
 * twice the negative logarithm of the likelihood and a price for each number, as everywhere. Of
 * fixed models the ratio of likelihoods exceeds x in at most 1/x of the records that the worse one
 * is true of, for its mean there is 1 (Markov); with every row a place to stop at,
 *
 *     B(all rows) - B(stop) > 2 ln(rows / ALARM)                                              (2)
 *
 * in at most ALARM of them. What dies away by its modes is no stop: these draw it in both, and the
 * first needs no constant. Nor is a response whose first part is no set of modes in white noise
 * with a verdict, such as one that friction ends.
 *
 * A second identification is worth its seconds only where the end of the record is white noise, and
 * the modes of all rows, with the amplitudes that they have before it, leave more of it than there
 * is.
 */
#include "modal/identify/identify_stop.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ask/diagnose.h"
#include "modal/identify/ask/verdict.h"
#include "modal/identify/fit/refine.h"
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/identify_state.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/prepare/event.h"
#include "modal/identify/prepare/record.h"

enum {
    ROUNDS = 3,                  /* each is told the stop by the modes of the one before */
    PART = 8,                    /* of the rows before a stop that is told by the energy of parts */
    ANEW = 64                    /* rows: powers of multipliers gather rounding until then */
};

void stop_done(struct stop *s)
{
    free(s->Y.x), free(s->left), free(s->sum), free(s->own);
}

/* The channels that are looked at, each over its largest; none that is zero. Sums are of what rows
 * differ by from the last: of an offset far beyond the noise their variance would be rounding. */
static enum modal_status stop_read(struct stop *s, const struct batch *b,
                                   const struct identify_result *of, struct modal_error *err)
{
    /* of many: a response stops in all of them */
    int wanted = of->channel_count < RECORD_FEW ? of->channel_count : RECORD_FEW;
    int m = of->samples, shown = 0;
    size_t room = ((size_t)m + 1) * RECORD_FEW;

    s->Y = matrix_new(m, RECORD_FEW);
    s->left = calloc(room, sizeof(double)), s->sum = calloc(room, sizeof(double));
    s->own = calloc(room, sizeof(double));
    if (s->Y.x == NULL || s->left == NULL || s->sum == NULL || s->own == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d rows", m);
    for (int i = 0; i < wanted; i++) {
        size_t c = (size_t)of->channel[(long)i * of->channel_count / wanted];
        double *y = s->Y.x + (size_t)shown * (size_t)s->Y.ld, most = 0;
        for (int k = 0; k < m; k++) {
            y[k] = b->signals[(s->first + (size_t)k) * b->channels + c];
            most = fmax(most, fabs(y[k]));
        }
        for (int k = 0; k < m && most > 0; k++)
            y[k] /= most;
        for (int k = m - 1; k >= 0; k--) {
            size_t at = (size_t)k + (size_t)shown * ((size_t)m + 1);
            double d = y[k] - y[m - 1];
            s->sum[at] = s->sum[at + 1] + d, s->own[at] = s->own[at + 1] + d * d;
        }
        shown += most > 0 && isfinite(most);
    }
    s->Y.n = shown, s->at = s->next = m;
    return MODAL_OK;
}

/* s->left: modes of the amplitudes F, from powers POWER of their multipliers. */
static void take_off(struct stop *s, const struct identify_chosen *modes,
                     const struct synthesis *f, double complex *power)
{
    int n = f->poles;

    for (int k = 0; k < s->Y.m; k++) {
        for (int j = 0; j < n; j++)
            power[j] = k % ANEW == 0 ? cexp(modes->lambda[j] * s->dt * k - f->reference[j])
                                     : power[j] * power[n + j];
        for (int c = 0; c < s->Y.n; c++) {
            double *left = s->left + (size_t)c * ((size_t)s->Y.m + 1);
            double e = s->Y.x[(size_t)k + (size_t)c * (size_t)s->Y.ld];
            for (int j = 0; j < n; j++)
                e -= creal(f->coefficient[j + c * n] * power[j]);
            /* what grows beyond any number is worth nothing there */
            left[k + 1] = fmin(left[k] + e * e, sqrt(DBL_MAX));
        }
    }
}

/* s->left: the modes, with the amplitudes that the first HEAD rows give them. */
static enum modal_status draw(struct stop *s, const struct identify_chosen *modes, int head,
                              struct modal_error *err)
{
    struct synthesis f = { 0 };
    struct matrix Y = s->Y;
    double complex *power = malloc(sizeof *power * 2 * (size_t)modes->count);
    enum modal_status rc = MODAL_OK;

    Y.m = head;
    if (power == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles", modes->count);
    for (int j = 0; j < modes->count && rc == MODAL_OK; j++)
        power[modes->count + j] = multiplier_of(modes->lambda[j], s->dt);
    if (rc == MODAL_OK)
        rc = synthesis_fit(modes->lambda, modes->count, s->dt, &Y, NULL, &f, err);
    if (rc == MODAL_OK)
        take_off(s, modes, &f, power);
    synthesis_done(&f);
    free(power);
    return rc;
}

/* What the rows leave where the response stops at row K, over its rows: its logarithm, of all. */
static double left_by_stop(const struct stop *s, int k)
{
    double all = 0, m = s->Y.m;

    for (int c = 0; c < s->Y.n; c++) {
        size_t at = (size_t)k + (size_t)c * ((size_t)s->Y.m + 1);
        double after = k < s->Y.m ? s->own[at] - s->sum[at] * s->sum[at] / (m - k) : 0;
        /* of samples of order 1 rounding is left, of modes and an offset no less than of rest */
        all += m * log(fmax(s->left[at] + fmax(after, 0), m * REFINE_EXACT * REFINE_EXACT));
    }
    return all;
}

/* The row that the response likeliest stops at; the last: it does not. */
static int likeliest_stop(const struct stop *s)
{
    int at = s->Y.m;
    double least = left_by_stop(s, at);

    for (int k = IDENTIFY_SAMPLES_LEAST; k < s->Y.m; k++) {
        double one = left_by_stop(s, k);
        if (one < least)
            least = one, at = k;
    }
    return at;
}

static double threshold(int rows)
{
    return 2 * log(rows / IDENTIFY_ALARM);  /* (2) */
}

/* The price of the numbers of MODES: (1). */
static double price(const struct stop *s, const struct identify_chosen *modes)
{
    return poles_order(modes->lambda, modes->count, s->dt) * (1.0 + s->Y.n) * log(s->Y.m);
}

/* Is one of COUNT codes told of R? */
static bool is_told(const struct identify_result *r, const char *const *codes, int count)
{
    for (int i = 0; i < r->diagnostic_count; i++)
        for (int j = 0; j < count; j++)
            if (strcmp(r->diagnostics[i].code, codes[j]) == 0)
                return true;
    return false;
}

/* Is OF an answer by the default procedure, of rows that are the batch's, in memory, and were all
 * searched? */
static bool may_stop(const struct batch *b, const struct identify_result *of)
{
    /* its rows were mended: what the batch has in their place no modes draw */
    static const char *const codes[] = { "clipped", "drift", "step", "wild_samples" };

    return of->used.method == IDENTIFY_AUTO && of->used.refine == CHOICE_YES && b->release == NULL
        && of->used.rank.rule == RANK_AUTO && of->used.detrend == DETREND_NONE
        && of->used.band[1] == 0 && !of->used.difference && of->period == 0 && of->shift == 1
        && of->decimation <= 1 && !of->at_grid && of->chosen.count > 0
        && of->samples < GROW * HEAD && !is_told(of, codes, sizeof codes / sizeof *codes);
}

/* Are R's modes not for sure all there is? The verdict is open, too, on a response that friction
 * ends, drawn by pairs of modes that cancel there. */
static bool is_doubtful(const struct identify_result *r)
{
    static const char *const codes[] = {
        "amplitude_dependent", "changes_in_record", "coloured_residual", "not_free_throughout",
        "order_work_limit", "parts_disagree"
    };

    return r->mode_count == 0 || r->verdict == VERDICT_UNDECIDED
        || is_told(r, codes, sizeof codes / sizeof *codes);
}

/* s->next: the row that the response seems to stop at, before row END of white noise. Amplitudes by
 * rows before it: END is told to 1/64 of all, and mostly is 8 such parts or more. */
static enum modal_status suspect(struct stop *s, const struct identify_chosen *modes, int end,
                                 struct modal_error *err)
{
    int head = end / PART * (PART - 1), k;
    enum modal_status rc;

    if (s->Y.n == 0 || head < 2 * IDENTIFY_SAMPLES_LEAST)
        return MODAL_OK;
    rc = draw(s, modes, head, err);
    k = likeliest_stop(s);
    if (rc != MODAL_OK || left_by_stop(s, s->Y.m) - left_by_stop(s, k) <= threshold(s->Y.m))
        return rc;
    s->next = k;
    rc = draw(s, modes, s->Y.m, err);
    s->all = left_by_stop(s, s->Y.m) + price(s, modes);
    return rc;
}

enum modal_status stop_begin(struct stop *s, const struct batch *b,
                             const struct identify_result *all, struct modal_error *err)
{
    struct event_rows rows;
    size_t end;
    enum modal_status rc;

    *s = (struct stop) { .dt = b->dt };
    if (!may_stop(b, all))
        return MODAL_OK;
    s->first = (size_t)nearbyint(all->used.window[0] / b->dt);
    rows = (struct event_rows) { s->first, s->first + (size_t)all->samples - 1 };
    rc = event_end(b, all->channel, all->channel_count, rows, &end, err);
    if (rc != MODAL_OK || end > rows.last || (rc = stop_read(s, b, all, err)) != MODAL_OK)
        return rc;
    return suspect(s, &all->chosen, (int)(end - s->first), err);
}

bool stop_asks(struct stop *s, double window[2])
{
    if (s->next == s->Y.m || s->next == s->at || s->round++ == ROUNDS)
        return false;
    s->at = s->next;
    window[0] = (double)s->first * s->dt;
    window[1] = (double)(s->first + (size_t)s->at - 1) * s->dt;
    return true;
}

enum modal_status stop_tell(struct stop *s, struct identify_result *before,
                            struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    s->is = false, s->next = s->Y.m;
    if (before->chosen.count == 0 || is_doubtful(before)
        || (rc = draw(s, &before->chosen, s->at, err)) != MODAL_OK)
        return rc;
    s->next = likeliest_stop(s);
    s->is = s->next < s->Y.m
         && s->all - left_by_stop(s, s->at) - price(s, &before->chosen) - s->Y.n * log(s->Y.m)
            > threshold(s->Y.m);
    memcpy(before->proposed, before->used.window, sizeof before->proposed);
    return MODAL_OK;
}

void stop_report(struct identify_result *all, const struct identify_result *before)
{
    memcpy(all->proposed, before->proposed, sizeof all->proposed);
    verdict_withhold(all);
    identify_diagnose(all, "not_free_throughout", -1, "the response stops at %.6g s, where its "
                      "modes would last: after that there is noise alone, as where it was damped "
                      "by hand, or ended by a switch; modes of all rows make up for it, so that "
                      "there are no standard errors and no verdict; `-o window=auto` identifies "
                      "what comes before, %.6g to %.6g s, alone: %d mode%s", before->proposed[1],
                      before->proposed[0], before->proposed[1], before->mode_count,
                      before->mode_count == 1 ? "" : "s");
}
