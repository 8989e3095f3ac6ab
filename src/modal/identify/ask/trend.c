/*
 * trend.c - one mode, watched over windows
 *
 * The model is called adequate where the residual of the chosen fit is white (colour.h), signals
 * that leave no more than REFINE_TIED apart, or where all of it is rounding.  Only an inadequate
 * fit, or one with a crowd of modes of one shape in one place, is looked at further: two close
 * modes of a linear system beat, and watched through windows as one they would seem to drift, but
 * their fit is adequate.
 *
 * Each window is identified on its own (pencil.c, order.c with few orders), to CHANGE of its rms
 * and no further: what changes by less is no matter, and without noise poles beyond would make up
 * for the change within the window.  Its strongest oscillating mode is compared over the windows.
 * A change counts where it exceeds CHANGE and CERTAIN times its own standard errors.  The sign of
 * every step that does agreeing with that of the amplitude's (Kendall's tau >= TAU_LEAST) makes it
 * amplitude dependence; anything else is a change of the system, unless the fit is adequate: among
 * modes that decay at rates of their own another may be the strongest in each window.  So is one
 * further off than TREND_CLOSE from all others, poles as well, beside an adequate fit: a crowd has
 * no such gap.  Windows are parts of what is heard above the noise that an adequate fit leaves.
 */
#include "modal/identify/ask/trend.h"
#include "modal/identify/ask/diagnose.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ask/verdict.h"
#include "modal/identify/fit/colour.h"
#include "modal/identify/fit/refine.h"
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/linear/pencil.h"
#include "modal/identify/order/order.h"
#include "modal/numbers.h"

enum {
    ORDERS = 2 * TREND_MODES,      /* of a window */
    ROWS_LEAST = 48,               /* of a window: four for each of those */
    LONG = 20000                   /* rows from which on there are TREND_WINDOWS_LONG */
};
enum {
    CROWD_MOST = 32,               /* poles of one mode that changes: work, and stack */
    WATCHED_TURNS = 2,             /* of a mode in a window, at least */
    WATCHED_LEAST = 3,             /* windows that show how something goes on */
    CERTAIN = 6                    /* standard errors: what windows differ by beyond chance */
};
static const double
    CHANGE = 1e-3,                 /* of a frequency, and of a window's rms: less is no matter */
    DAMPING_CHANGE = 0.25,         /* of a damping ratio */
    DECAYS = 0.7,                  /* of the first window's amplitude is left in the last */
    WANDERS = 0.2,                 /* of a frequency: what goes further is no amplitude's doing */
    TAU_LEAST = 0.7,               /* of 8 windows: 1.4 % of chance orders have more */
    POOR = 0.4;                    /* of the record's where they do not */

struct window {
    double t, frequency, damping, std_frequency, std_damping, amplitude, left;
    double energy;               /* mean square, of all signals together */
    bool found;
};

/* ---- is the fit adequate? ---- */

static enum modal_status adequate(const struct trend_input *in, bool *answer, double *left,
                                  struct modal_error *err)
{
    struct matrix E = matrix_new(in->X->m, in->X->n);
    struct synthesis fit = { 0 };
    enum modal_status rc;
    double total = 0, mean[COLOUR_LAGS];

    if (E.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "trend: no memory for %d x %d", E.m, E.n);
    rc = synthesis_fit(in->lambda, in->count, in->tau, in->X, &E, &fit, err);
    for (int c = 0; c < E.n && rc == MODAL_OK; c++)
        for (int k = 0; k < E.m; k++) {
            double y = in->X->x[k + (size_t)c * (size_t)in->X->ld];
            total += y * y;
            E.x[k + (size_t)c * (size_t)E.m] = y - E.x[k + (size_t)c * (size_t)E.m];
        }
    *left = total > 0 && rc == MODAL_OK ? fit.residual / sqrt(total) : 0;
    if (rc == MODAL_OK) {
        /* of a signal, or of all: what is left there is rounding */
        colour_leave_out(&E, in->X, REFINE_TIED);
        colour_left_by(in->lambda, in->count, in->tau, in->X->m, mean);
        *answer = fit.residual <= REFINE_TIED * sqrt(total) || colour_white_about(&E, mean, 0);
    }
    synthesis_done(&fit);
    free(E.x);
    return rc;
}

static bool in_crowd(double complex pole, double complex about)
{
    return cimag(pole) > 0 && fabs(cimag(pole) - cimag(about)) < TREND_CLOSE * cimag(about);
}

/* Three or more vibrations within TREND_CLOSE of LAMBDA: what a mode that drifts is made of, to any
 * accuracy. */
static bool crowd_about(const struct trend_input *in, double complex lambda)
{
    int near = 0;

    for (int j = 0; j < in->count; j++)
        near += in_crowd(in->lambda[j], lambda);
    /* a pair may be two modes */
    return near >= TREND_CROWD;
}

/* sum_k conj(z_i^k) z_j^k of the columns of a fit, by the geometric series. */
static double complex overlap(const struct synthesis *f, const struct trend_input *in, int i, int j)
{
    double complex s = (conj(in->lambda[i]) + in->lambda[j]) * in->tau;
    /* columns are divided by their largest entry */
    double scale = -f->reference[i] - f->reference[j];

    /* below, the geometric series loses more digits by its differences than by being left out */
    return cabs(s) * f->rows < REFINE_HALVED
               ? f->rows * exp(scale)
               : (cexp(s * f->rows + scale) - exp(scale)) / (cexp(s) - 1);
}

/*
 * Have the COUNT poles NEAR one shape, as those of one mode have?  Their part of the signals is
 * B C, a column of exponentials and a row of coefficients a pole; of its energy tr P,
 * P = (B^H B) (C C^H), a shape has the share e at least only where
 * tr P^2 >= (e^2 + (1 - e)^2) (tr P)^2.  Poles that are not resolved cancel in it.
 */
static bool one_shape(const struct synthesis *f, const struct trend_input *in, const int *near,
                      int count)
{
    double complex P[CROWD_MOST * CROWD_MOST] = { 0 }, cc;
    double one = 0, two = 0, e = TREND_ONE_SHAPE;

    for (int i = 0; i < count; i++)
        for (int j = 0; j < count; j++)
            for (int k = 0; k < count; k++) {
                cc = numbers_row_dot(f->channels, f->coefficient + near[j], f->poles,
                                     f->coefficient + near[k], f->poles);
                P[i + count * j] += overlap(f, in, near[i], near[k]) * cc;
            }
    for (int i = 0; i < count; i++)
        for (int j = 0; j < count; j++) {
            one += i == j ? creal(P[i + count * i]) : 0;
            two += creal(P[i + count * j] * P[j + count * i]);  /* tr P^2 */
        }
    return two >= (e * e + (1 - e) * (1 - e)) * one * one;
}

/* Is there a crowd, of one shape as far as channels tell? */
static enum modal_status crowded(const struct trend_input *in, bool *yes, struct modal_error *err)
{
    struct synthesis f = { 0 };
    enum modal_status rc = MODAL_OK;

    *yes = false;
    for (int i = 0; i < in->count && !*yes && rc == MODAL_OK; i++) {
        int near[CROWD_MOST], count = 0;
        if (!crowd_about(in, in->lambda[i]))
            continue;
        if (f.coefficient == NULL)
            rc = synthesis_fit(in->lambda, in->count, in->tau, in->X, NULL, &f, err);
        for (int j = 0; j < in->count && count < CROWD_MOST; j++)
            if (in_crowd(in->lambda[j], in->lambda[i]))
                near[count++] = j;
        *yes = rc == MODAL_OK && (in->X->n < 2 || one_shape(&f, in, near, count));
    }
    synthesis_done(&f);
    return rc;
}

bool trend_crowds(const struct trend_input *in, double complex exponent)
{
    return crowd_about(in, exponent - I * 2 * M_PI * in->hertz);
}

/* ---- windows ---- */

struct source { struct pencil pencil; double tau; };

static enum modal_status poles_of(void *context, int r, double complex *lambda, int *count,
                                  struct modal_error *err)
{
    struct source *s = context;
    double complex rho[ORDERS + 1];
    enum modal_status rc = pencil_multipliers(&s->pencil, r, rho, err);

    if (rc == MODAL_OK)
        *count = poles_of_multipliers(rho, r, s->tau, 1e-300, lambda, NULL);
    return rc;
}

/* Mean square of pole j's part over the window, all signals. */
static double energy_of(const struct synthesis *f, int j, double complex lambda, double tau)
{
    double sum = 0, a = creal(lambda) * tau, reference = f->reference[j], weight = 0;

    for (int c = 0; c < f->channels; c++) {
        double complex b = f->coefficient[j + (size_t)c * (size_t)f->poles];
        sum += 0.5 * numbers_square(b);
    }
    for (int k = 0; k < f->rows; k++)
        /* the mean of cos^2 is a half: it stands before the sum over channels */
        weight += exp(2 * (a * k - reference)) / f->rows;
    return sum * weight;
}

/* The strongest oscillation of a window's fit. */
static enum modal_status strongest(const struct matrix *Y, double tau, const struct refined *fit,
                                   struct window *w, int *which, struct modal_error *err)
{
    struct synthesis f = { 0 };
    enum modal_status rc = synthesis_fit(fit->lambda, fit->poles, tau, Y, NULL, &f, err);
    double most = 0, total = 0;

    if (rc != MODAL_OK)
        return rc;
    for (int c = 0; c < Y->n; c++)
        for (int k = 0; k < Y->m; k++)
            total += Y->x[k + (size_t)c * (size_t)Y->ld] * Y->x[k + (size_t)c * (size_t)Y->ld];
    w->left = total > 0 ? f.residual / sqrt(total) : 0;
    for (int j = 0; j < fit->poles; j++) {
        double complex z = fit->lambda[j];
        double energy = energy_of(&f, j, z, tau), turns = cimag(z) * tau * Y->m / (2 * M_PI);
        if (pole_kind(z, tau) != POLE_PAIR || turns < WATCHED_TURNS
            || fabs(creal(z)) > 0.5 * cimag(z) || energy <= most)
            continue;
        most = energy, *which = j;
        w->found = true, w->amplitude = sqrt(energy);
        w->frequency = cabs(z) / (2 * M_PI), w->damping = damping_ratio_of(z);
        refined_std(fit, j, &w->std_frequency, &w->std_damping);
    }
    synthesis_done(&f);
    return rc;
}

/* The strongest oscillation of a window, as one: poles crowded about it are left out and the rest
 * refined, so that a mode which changes within the window is averaged, not split. */
static enum modal_status strongest_alone(const struct refine_data *data, const struct refined *fit,
                                         struct window *w, struct modal_error *err)
{
    double complex *lambda = malloc(sizeof *lambda * (size_t)fit->poles);
    struct refined alone = { 0 };
    int which = -1, n = 0;
    enum modal_status rc = strongest(data->Y, data->tau, fit, w, &which, err);

    if (lambda == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "trend: no memory for %d poles", fit->poles);
    for (int j = 0; j < fit->poles && rc == MODAL_OK && which >= 0; j++) {
        double im = cimag(fit->lambda[which]);
        if (j == which || fabs(cimag(fit->lambda[j]) - im) > TREND_CLOSE * im)
            lambda[n++] = fit->lambda[j];
    }
    if (rc == MODAL_OK && n > 0 && n < fit->poles) {
        rc = refine_poles(data, lambda, n, NULL, NULL, &alone, err);
        if (rc == MODAL_OK && alone.end != REFINE_DEGENERATE)
            rc = strongest(data->Y, data->tau, &alone, w, &which, err);
    }
    refined_done(&alone);
    free(lambda);
    return rc;
}

/* The best fit of few orders to DATA, into CHOICE. */
static enum modal_status fit_part(const struct trend_input *in, const struct refine_data *data,
                                  struct order_choice *choice, struct modal_error *err)
{
    struct source s = { .tau = in->tau };
    struct order_source source = { .poles = poles_of, .context = &s };
    struct order_options opt = { .refine = { .iterations = 30 },
                                 .cancelled = in->cancelled,
                                 .context = in->context };
    const struct pencil_options few = { .wanted = ORDERS };
    enum modal_status rc = pencil_new(data->Y, &few, &s.pencil, err);

    source.most = s.pencil.count;
    if (rc == MODAL_OK)
        rc = order_choose(data, &source, &opt, choice, err);
    pencil_done(&s.pencil);
    return rc;
}

/* LEAST has room for a number a signal. */
static enum modal_status look_at(const struct trend_input *in, int first, int rows, double *least,
                                 struct window *w, struct modal_error *err)
{
    struct matrix Y = { rows, in->X->n, in->X->ld, in->X->x + first };
    struct refine_data data = { .Y = &Y, .tau = in->tau, .phases = 1, .least = least };
    struct order_choice choice = { .chosen = -1 };
    enum modal_status rc;

    *w = (struct window) { .t = in->t0 + (first + 0.5 * rows) * in->tau, .left = 1 };
    for (int c = 0; c < Y.n; c++) {
        const double *y = Y.x + (size_t)c * (size_t)Y.ld;
        least[c] = cblas_ddot(rows, y, 1, y, 1) / rows;
        w->energy += least[c];
        least[c] *= CHANGE * CHANGE;  /* a variance: what a fit need not explain */
    }
    rc = fit_part(in, &data, &choice, err);
    if (rc == MODAL_OK && choice.chosen >= 0)
        rc = strongest_alone(&data, &choice.candidates[choice.chosen].fit, w, err);
    order_done(&choice);
    return rc;
}

/* ---- growth in a part ---- */

enum { GROWING_MOST = 2 };         /* poles: more make up for something else */

/* Does pole j stand at twice or three times a far stronger one? */
static bool may_be_harmonic(const struct refined *fit, const double *energy, int j)
{
    for (int i = 0; i < fit->poles; i++)
        if (energy[j] < TREND_HARMONIC * energy[i]
            && trend_multiple_of(fit->lambda[j], fit->lambda[i]) > 0)
            return true;
    return false;
}

/* Poles of FIT that grow beyond REFINE_CLEAR of their errors, are more than VERDICT_WEAK, no
 * harmonics, no drift; *sign: 1 where one of them lies at FREQUENCY, as far as the rows resolve it,
 * -1 where all that lies there decays as clearly, else 0. */
static int growing(const struct refined *fit, const struct synthesis *f, double tau,
                   double frequency, int *sign)
{
    double total = 0, energy[IDENTIFY_ORDER_MOST], beat = 2 * M_PI / (tau * f->rows);
    int count = 0, here = 0, up = 0, down = 0;

    for (int j = 0; j < fit->poles; j++)
        total += energy[j] = energy_of(f, j, fit->lambda[j], tau);
    for (int j = 0; j < fit->poles; j++) {
        double complex z = fit->lambda[j];
        /* rows resolve one beat over their length */
        bool strong = energy[j] > VERDICT_WEAK * total, at = fabs(cimag(z) - frequency) < beat;
        bool grows = strong && creal(z) > REFINE_CLEAR * fit->std_re[j]
            && !may_be_harmonic(fit, energy, j)
            && !verdict_slow(z, fit->std_re[j], tau * f->rows);
        count += grows;
        here += strong && at, up += grows && at;
        down += strong && at && creal(z) < -REFINE_CLEAR * fit->std_re[j];
    }
    *sign = up > 0 ? 1 : here > 0 && down == here ? -1 : 0;
    return count;
}

/* What the fit to a part leaves is white, and few of its poles grow: *sign as above. */
static enum modal_status part_grows(const struct trend_input *in, const struct matrix *Y,
                                    const struct refined *fit, double frequency, int *sign,
                                    struct modal_error *err)
{
    struct trend_input part = {
        .X = Y, .tau = in->tau, .lambda = fit->lambda, .count = fit->poles
    };
    struct synthesis f = { 0 };
    bool good = false;
    double left;
    enum modal_status rc = adequate(&part, &good, &left, err);

    if (rc == MODAL_OK && good)
        rc = synthesis_fit(fit->lambda, fit->poles, in->tau, Y, NULL, &f, err);
    if (rc == MODAL_OK && good && growing(fit, &f, in->tau, frequency, sign) > GROWING_MOST)
        *sign = 0;
    synthesis_done(&f);
    return rc;
}

/* How many of PARTS equal parts grow at FREQUENCY, since the last that decays there. */
static enum modal_status parts_that_grow(const struct trend_input *in, int parts, double frequency,
                                         int *count, struct modal_error *err)
{
    int rows = in->X->m / parts;

    *count = 0;
    for (int i = 0; i < parts && rows >= ROWS_LEAST; i++) {
        struct matrix Y = { rows, in->X->n, in->X->ld, in->X->x + (size_t)i * (size_t)rows };
        struct refine_data data = { .Y = &Y, .tau = in->tau, .phases = 1 };
        struct order_choice choice = { .chosen = -1 };
        int sign = 0;
        enum modal_status rc = fit_part(in, &data, &choice, err);
        if (rc == MODAL_OK && choice.chosen >= 0)
            rc = part_grows(in, &Y, &choice.candidates[choice.chosen].fit, frequency, &sign, err);
        order_done(&choice);
        *count = sign < 0 ? 0 : *count + sign;  /* a part that decays ends what grew before it */
        if (rc != MODAL_OK && rc != MODAL_NO_CONVERGENCE)
            return rc;
    }
    return MODAL_OK;
}

/* Does a part of SECONDS not resolve the mode that decides from a stronger one? */
static bool hidden(const struct identify_result *r, double seconds)
{
    const struct identify_mode *m = &r->modes[r->decides];
    bool yes = false;

    for (int i = 0; i < r->mode_count; i++)
        yes |= r->modes[i].energy > m->energy
            && fabs(cimag(r->modes[i].exponent) - cimag(m->exponent)) * seconds < 2 * M_PI;
    return yes;
}

enum modal_status trend_growth(const struct trend_input *in, const struct identify_result *result,
                               bool *shown, struct modal_error *err)
{
    enum { TWO = 2 };                  /* the blow may fall just before the end of one */
    double frequency = cimag(result->modes[result->decides].exponent) - 2 * M_PI * in->hertz;
    enum modal_status rc = MODAL_OK;
    int count = 0;

    *shown = in->X->m < 2 * ROWS_LEAST;
    for (int parts = 8; parts >= 2 && !*shown && rc == MODAL_OK; parts /= 2) {
        if (hidden(result, in->tau * (in->X->m / parts)))
            continue;
        rc = parts_that_grow(in, parts, frequency, &count, err);
        *shown = count >= TWO;
    }
    return rc;
}

/* ---- what the windows say ---- */

static double frequency_at(const struct window *w) { return w->frequency; }
static double damping_at(const struct window *w) { return w->damping; }

/* What x of two windows may differ by where it is one: CERTAIN of their standard errors. */
static double by_error(const struct window *a, const struct window *b, bool damping)
{
    return CERTAIN * (damping ? hypot(a->std_damping, b->std_damping)
                              : hypot(a->std_frequency, b->std_frequency));
}

/* Kendall's tau of x against the amplitude, of the pairs whose x differ beyond their errors: others
 * say nothing, such as windows of the same x in the end. */
static double kendall(const struct window *w, int n, double (*x)(const struct window *),
                      bool damping)
{
    int sum = 0, pairs = 0;

    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) {
            double apart = x(&w[i]) - x(&w[j]), d = apart * (w[i].amplitude - w[j].amplitude);
            if (!(fabs(apart) > by_error(&w[i], &w[j], damping)))
                continue;
            /* > 0: both rise or both fall */
            sum += (d > 0) - (d < 0);
            pairs++;
        }
    return pairs > 0 ? (double)sum / pairs : 0;
}

/* Do two windows differ in x by more than `least` of its size and their standard errors?
 * The extremes alone do not say: the last window has the least signal, and errors to suit. */
static bool changes(const struct window *w, int n, double (*x)(const struct window *), bool damping,
                    double least)
{
    bool any = false;

    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) {
            double size = fmax(fabs(x(&w[i])), fabs(x(&w[j])));
            /* what windows of one system range over by chance stays below */
            any |= fabs(x(&w[i]) - x(&w[j]))
                 > fmax(least * size, by_error(&w[i], &w[j], damping));
        }
    return any;
}

/* "0.9 s 3.741 Hz 0.0069; …" */
static void write_table(const struct window *w, int n, char *text, size_t size)
{
    text[0] = 0;
    for (int i = 0; i < n; i++)
        snprintf(text + strlen(text), size - strlen(text), "%s%.3g s %.5g Hz %.2g",
                 i > 0 ? "; " : "", w[i].t, w[i].frequency, w[i].damping);
}

/* The windows into the result, which owns them; without memory for them the message has to do. */
static void keep(const struct window *w, int n, struct identify_result *result)
{
    result->trend = malloc(sizeof *result->trend * (size_t)n);
    for (int i = 0; result->trend != NULL && i < n; i++)
        result->trend[result->trend_count++] = (struct identify_window) {
            w[i].t, w[i].frequency, w[i].damping, w[i].std_frequency, w[i].std_damping,
            w[i].amplitude };
}

/* The least of the windows' frequencies above HZ; of poles, too, which are the crowd of a mode that
 * wanders so far within a window. */
static double next_above(const struct trend_input *in, const struct window *w, int n, double hz,
                         bool poles)
{
    double next = HUGE_VAL;

    for (int j = 0; j < n; j++)
        if (w[j].frequency > hz)
            next = fmin(next, w[j].frequency);
    for (int j = 0; j < in->count && poles; j++) {
        double pole = cimag(in->lambda[j]) / (2 * M_PI) + in->hertz;
        if (pole > hz)
            next = fmin(next, pole);
    }
    return next;
}

/* Is there a gap between the frequencies that no one mode wanders over? */
static bool leaps(const struct trend_input *in, const struct window *w, int n)
{
    bool far = false;

    for (int i = 0; i < n; i++) {
        double last = next_above(in, w, n, w[i].frequency, false), hz = w[i].frequency, next;
        for (; last < HUGE_VAL && hz < last && !far; hz = next) {
            next = next_above(in, w, n, hz, true);
            far = next > hz * (1 + TREND_CLOSE);
        }
    }
    return far;
}

/* Does the energy of ALL windows rise meanwhile?  What follows its amplitude has one rate at each
 * and comes to none twice; modes of a linear system that beat do.  A vibration of WATCHED_TURNS and
 * more has a mean square within 1 / (4 pi WATCHED_TURNS) of half the square of its amplitude. */
static bool rises(const struct window *all, int n)
{
    const double ripple = 1 / (4 * M_PI * WATCHED_TURNS);
    double least = HUGE_VAL;
    bool any = false;

    for (int i = 0; i < n; i++) {
        any |= all[i].energy * (1 - ripple) > least * (1 + ripple);
        least = fmin(least, all[i].energy);
    }
    return any;
}

/* What the windows W that were found say; BEATS: beside an adequate fit their energy says that no
 * mode follows its amplitude. */
static void judge(const struct trend_input *in, const struct window *w, int n, bool good,
                  bool beats, struct identify_result *result, bool *follows)
{
    bool f = changes(w, n, frequency_at, false, CHANGE),
         z = changes(w, n, damping_at, true, DAMPING_CHANGE);
    double tau_f = fabs(kendall(w, n, frequency_at, false)),
           tau_z = fabs(kendall(w, n, damping_at, true)), range = 0;
    bool decays = w[n - 1].amplitude < DECAYS * w[0].amplitude;
    char table[240];

    if (!f && !z)
        return;
    for (int i = 1; i < n; i++)
        range = fmax(range, fabs(w[i].frequency - w[0].frequency) / w[0].frequency);
    write_table(w, n, table, sizeof table);
    *follows = decays && range < WANDERS && !(good && (beats || leaps(in, w, n)))
        && ((f && tau_f >= TAU_LEAST) || (z && tau_z >= TAU_LEAST));
    if (good && !*follows)
        return;
    if (f || decays)
        keep(w, n, result);
    if (*follows)
        identify_diagnose(
            result, "amplitude_dependent", -1,
            "the mode changes as it decays, close pairs may be one mode; window by window: %s",
            table);
    else if (f)
        identify_diagnose(result, "changes_in_record", -1,
                          "not one system throughout, identify each part by `window`: %s", table);
}

/* Does the energy rise and fall again, as that of decaying and growing modes does not? A sum of
 * exponentials is in no window more than both in an earlier and in a later one; on top of it may be
 * what the fit leaves, LEFT of the rms. */
static bool rises_and_falls(const struct window *w, int n, double left)
{
    double before = w[0].energy, rest = 0;

    for (int i = 0; i < n; i++)
        rest += left * left * w[i].energy / n;
    for (int i = 1; i + 1 < n; i++) {
        double after = HUGE_VAL;
        for (int k = i + 1; k < n; k++)
            after = fmin(after, w[k].energy);
        if (w[i].energy > fmax(before, after) + rest)
            return true;
        before = fmin(before, w[i].energy);
    }
    return false;
}

/* Few windows that decaying modes rebuild, in a record that they do not rebuild either. */
static bool is_driven(const struct window *w, int n, bool good, double left,
                      struct identify_result *result)
{
    int well = 0;

    for (int i = 0; i < n; i++)
        well += w[i].left < TREND_REBUILT;
    if (left >= POOR ? 5 * well >= n
                     : good || left < TREND_REBUILT || !rises_and_falls(w, n, left))
        return false;
    result->driven = true;
    if (left < POOR) {
        identify_diagnose(result, "not_free_decay", -1, "the energy rises and falls over %d "
                          "windows, and what modes leave, %.2g of the rms, is no white noise: the "
                          "response is driven, or was set off anew, of which there are no "
                          "standard errors and no verdict; give response=ambient where nobody "
                          "measured the excitation, response=forced and its channels as inputs "
                          "where it was measured, or window a part after it has ended", n, left);
        return true;
    }
    identify_diagnose(result, "not_free_decay", -1, "only %d of %d windows are rebuilt by decaying "
                      "modes to %g %%: the response is driven, or noise, of which there are no "
                      "standard errors and no verdict; give response=ambient where nobody measured "
                      "the excitation, response=forced and its channels as inputs where it was "
                      "measured, or window a part after it has ended", well, n,
                      100 * TREND_REBUILT);
    return true;
}

static enum modal_status watch(const struct trend_input *in, bool good, double left,
                               struct identify_result *result, bool *follows,
                               struct modal_error *err)
{
    struct window all[TREND_WINDOWS_LONG], found[TREND_WINDOWS_LONG];
    int most = in->X->m > LONG && in->ragged == 0 ? TREND_WINDOWS_LONG : TREND_WINDOWS;
    int n = in->X->m / ROWS_LEAST < most ? in->X->m / ROWS_LEAST : most, rows, count = 0;
    enum modal_status rc = MODAL_OK;
    double *least;

    if (n < WATCHED_LEAST)
        return MODAL_OK;
    least = malloc(sizeof *least * (size_t)in->X->n);
    if (least == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "trend: no memory for %d signals", in->X->n);
    rows = in->X->m / n;
    for (int i = 0; i < n && rc == MODAL_OK; i++) {
        rc = look_at(in, i * rows, in->ragged > 0 && in->ragged < rows ? in->ragged : rows, least,
                     &all[i], err);
        if (rc == MODAL_NO_CONVERGENCE)
            rc = MODAL_OK;
        all[i].frequency += in->hertz;
        if (all[i].found && all[i].left < TREND_REBUILT)
            found[count++] = all[i];
    }
    free(least);
    if (rc != MODAL_OK)
        return rc;
    if (!is_driven(all, n, good, left, result) && count >= WATCHED_LEAST)
        judge(in, found, count, good, rises(all, n), result, follows);
    return MODAL_OK;
}

static double row_square(const struct matrix *X, int k)
{
    double sum = 0;

    for (int c = 0; c < X->n; c++) {
        double x = X->x[k + (size_t)c * (size_t)X->ld];
        sum += x * x;
    }
    return sum;
}

/* Rows until what a fit leaves, LEFT of the signals' rms, would be TREND_REBUILT of a window and
 * more: after them no window shows a mode.  All, where windows before them are too few. */
static int rows_heard(const struct matrix *X, double left)
{
    double all = 0, few = 0;

    for (int c = 0; c < X->n; c++) {
        const double *x = X->x + (size_t)c * (size_t)X->ld;
        all += cblas_ddot(X->m, x, 1, x, 1);
    }
    for (int k = X->m - 1; k >= 0; k--) {
        few += row_square(X, k) - (k + ROWS_LEAST < X->m ? row_square(X, k + ROWS_LEAST) : 0);
        if (k + ROWS_LEAST <= X->m
            && few / ROWS_LEAST * TREND_REBUILT * TREND_REBUILT > all / X->m * left * left)
            return k + ROWS_LEAST >= WATCHED_LEAST * ROWS_LEAST ? k + ROWS_LEAST : X->m;
    }
    return X->m;
}

enum modal_status trend_watch(const struct trend_input *in, struct identify_result *result,
                              bool *follows, struct modal_error *err)
{
    bool none = in->count == 0 && in->ragged > 0, good = !none, crowd = false;
    double left = none ? 1 : in->white;
    struct trend_input part = *in;
    struct matrix heard;
    enum modal_status rc = MODAL_OK;

    *follows = false;
    if (left == 0 && in->count > 0 && in->X->m > 2 * in->count + 2)
        rc = adequate(in, &good, &left, err);
    /* few exponentials that draw all to rounding are the motion: a crowd makes up for another to
     * any accuracy, but not with all digits */
    if (rc == MODAL_OK && good && left > REFINE_EXACT)
        rc = crowded(in, &crowd, err);
    heard = *in->X;
    if (good && crowd)
        part.X = &heard, heard.m = rows_heard(in->X, left);
    if (rc == MODAL_OK && (!good || crowd))
        rc = watch(&part, good, left, result, follows, err);
    return rc;
}
