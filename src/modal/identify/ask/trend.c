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
 * A change counts where it exceeds CHANGE and six times its own standard errors.  The sign of every
 * step agreeing with that of the amplitude's (Kendall's tau >= TAU_LEAST) makes it amplitude
 * dependence; anything else is a change of the system, unless the fit is adequate: among modes that
 * decay at rates of their own another may be the strongest in each window.  So is one further off
 * than TREND_CLOSE from all others, beside an adequate fit: a crowd is no wider.
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
    WATCHED_LEAST = 3              /* windows that show how something goes on */
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
        if (pole_kind(z, tau) != POLE_PAIR || turns < 2 || fabs(creal(z)) > 0.5 * cimag(z)
            || energy <= most)
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
static const double
    HARMONIC_WEAK = 0.05,          /* a harmonic of a nonlinearity: of its mode's energy, */
    HARMONIC_NEAR = 5e-3,          /* off its frequency, */
    HARMONIC_DECAY = 0.3,          /* and off its decay rate */
    MAINS_NEAR = 1e-3,             /* off a frequency of the mains: as far as grids let it go */
    MAINS_DAMPING = 2e-4,          /* ratio: less than structures have */
    DRIFT_SLOW = 1.5,              /* rad over the record: a quarter of a turn */
    DRIFT_LEAST = 0.01;            /* of the energy */
enum { MAINS_HARMONICS = 5 };      /* of the mains' frequency */
/* Coincidences that a record of independent modes may be expected to have: one in twenty. */
static const double HARMONIC_CHANCE = 0.05;

/* 2 or 3, where LAMBDA lies at so many times the frequency of BASE; else 0. */
static int multiple_of(double complex lambda, double complex base)
{
    /* quadratic and cubic forces answer at twice and three times */
    double f = cimag(lambda) / cimag(base), n = nearbyint(f);

    return cimag(base) > 0 && (n == 2 || n == 3) && fabs(f - n) < HARMONIC_NEAR * n ? (int)n : 0;
}

/* Does pole j stand at twice or three times a far stronger one? */
static bool may_be_harmonic(const struct refined *fit, const double *energy, int j)
{
    for (int i = 0; i < fit->poles; i++)
        if (energy[j] < HARMONIC_WEAK * energy[i]
            && multiple_of(fit->lambda[j], fit->lambda[i]) > 0)
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

/* Kendall's tau of x against y. */
static double kendall(const struct window *w, int n, double (*x)(const struct window *))
{
    int sum = 0, pairs = 0;

    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) {
            /* > 0: both rise or both fall */
            double d = (x(&w[i]) - x(&w[j])) * (w[i].amplitude - w[j].amplitude);
            sum += (d > 0) - (d < 0);
            pairs++;
        }
    return pairs > 0 ? (double)sum / pairs : 0;
}

static double frequency_at(const struct window *w) { return w->frequency; }
static double damping_at(const struct window *w) { return w->damping; }

/* Do two windows differ in x by more than `least` of its size and six of their standard errors?
 * The extremes alone do not say: the last window has the least signal, and errors to suit. */
static bool changes(const struct window *w, int n, double (*x)(const struct window *), bool damping,
                    double least)
{
    bool any = false;

    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) {
            double error = damping ? hypot(w[i].std_damping, w[j].std_damping)
                                   : hypot(w[i].std_frequency, w[j].std_frequency);
            double size = fmax(fabs(x(&w[i])), fabs(x(&w[j])));
            /* what windows of one system range over by chance stays below */
            any |= fabs(x(&w[i]) - x(&w[j])) > fmax(least * size, 6 * error);
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

/* Is there a gap between the frequencies that no one mode wanders over? */
static bool leaps(const struct window *w, int n)
{
    bool far = false;

    for (int i = 0; i < n; i++) {
        double next = HUGE_VAL;
        for (int j = 0; j < n; j++)
            if (w[j].frequency > w[i].frequency)
                next = fmin(next, w[j].frequency);
        far |= next < HUGE_VAL && next > w[i].frequency * (1 + TREND_CLOSE);
    }
    return far;
}

static void judge(const struct window *w, int n, bool good, struct identify_result *result,
                  bool *follows)
{
    bool f = changes(w, n, frequency_at, false, CHANGE),
         z = changes(w, n, damping_at, true, DAMPING_CHANGE);
    double tau_f = fabs(kendall(w, n, frequency_at)), tau_z = fabs(kendall(w, n, damping_at)),
           range = 0;
    bool decays = w[n - 1].amplitude < DECAYS * w[0].amplitude;
    char table[240];

    if (!f && !z)
        return;
    for (int i = 1; i < n; i++)
        range = fmax(range, fabs(w[i].frequency - w[0].frequency) / w[0].frequency);
    write_table(w, n, table, sizeof table);
    *follows = decays && range < WANDERS && !(good && leaps(w, n))
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
        judge(found, count, good, result, follows);
    return MODAL_OK;
}

/* ---- what the modes say ---- */

/* Weak enough beside A to be its harmonic? */
static bool is_weak(const struct identify_mode *b, const struct identify_mode *a)
{
    return b->energy <= HARMONIC_WEAK * a->energy;
}

/*
 * What independent modes do by chance. LOOKS pairs of a mode and two or three times another are
 * there to coincide; with frequencies anywhere up to the HIGHEST and damping ratios anywhere over
 * their own RANGE, in natural logarithms, one comes as near as a pair at distances d and e, or as
 * its errors let us tell, with chances p = 2 d / HIGHEST and q = 2 e / RANGE, at most 1. So many
 * are expected to have no greater a product of the two:
 *
 *     LOOKS p q (1 - ln p q),                                                           (1)
 *
 * LOOKS p where all damping ratios are alike.
 */
struct chance { double looks, highest, range; };

static struct chance chance_of(const struct identify_result *r)
{
    struct chance c = { 0 };
    double least = HUGE_VAL, most = 0;

    for (int i = 0; i < r->mode_count; i++) {
        double zeta = fabs(damping_ratio_of(r->modes[i].exponent));
        c.highest = fmax(c.highest, cimag(r->modes[i].exponent));
        if (zeta > 0 && cimag(r->modes[i].exponent) > 0)
            least = fmin(least, zeta), most = fmax(most, zeta);
    }
    c.range = most > least ? log(most / least) : 0;
    for (int i = 0; i < r->mode_count; i++)
        for (int j = 0; j < r->mode_count; j++)
            for (int n = 2; n <= 3; n++) {
                double f = n * cimag(r->modes[i].exponent);
                c.looks += f > 0 && f <= c.highest && is_weak(&r->modes[j], &r->modes[i]);
            }
    return c;
}

/* (1) for B at N times A. */
static double by_chance(const struct chance *c, const struct identify_mode *b,
                        const struct identify_mode *a, int n)
{
    double rate = creal(b->exponent) / creal(a->exponent) / n;
    double d = fabs(cimag(b->exponent) - n * cimag(a->exponent)), e = fabs(log(rate));

    if (b->std_im >= 0 && a->std_im >= 0) {
        d = fmax(d, hypot(b->std_im, n * a->std_im));  /* no nearer than errors tell */
        e = fmax(e, hypot(b->std_re / creal(b->exponent), a->std_re / creal(a->exponent)));
    }
    d = fmin(1, 2 * d / c->highest);
    e = c->range > 0 ? d * fmin(1, 2 * e / c->range) : d;
    /* (1): P(p q <= e) of two uniform numbers is e (1 - ln e) */
    return c->looks * (c->range > 0 && e > 0 ? e * (1 - log(e)) : e);
}

/* 2 or 3, where B is that harmonic of A: it decays as that power of it, too, and is nearer than
 * modes come by chance; else 0. */
static int harmonic_of(const struct chance *c, const struct identify_mode *b,
                       const struct identify_mode *a)
{
    int n = is_weak(b, a) ? multiple_of(b->exponent, a->exponent) : 0;

    return n > 0 && fabs(creal(b->exponent) / creal(a->exponent) / n - 1) < HARMONIC_DECAY
        && by_chance(c, b, a, n) < HARMONIC_CHANCE ? n : 0;
}

void trend_mark_harmonics(struct identify_result *r)
{
    struct chance c = chance_of(r);

    for (int i = 0; i < r->mode_count; i++)
        for (int j = 0; j < r->mode_count; j++)
            r->modes[j].harmonic |= harmonic_of(&c, &r->modes[j], &r->modes[i]) > 0;
}

static void look_for_harmonics(struct identify_result *r)
{
    struct chance c = chance_of(r);

    for (int i = 0; i < r->mode_count; i++)
        for (int j = 0; j < r->mode_count; j++) {
            const struct identify_mode *a = &r->modes[i], *b = &r->modes[j];
            int n = harmonic_of(&c, b, a);
            if (n > 0)
                identify_diagnose(r, "harmonic_of_mode", -1, "%.5g Hz is %d times %.5g Hz and "
                                  "decays as its power: a harmonic of that mode "
                                  "(nonlinearity), not a mode", cimag(b->exponent) / (2 * M_PI), n,
                                  cimag(a->exponent) / (2 * M_PI));
        }
}

static void look_for_mains(struct identify_result *r)
{
    static const double mains[] = { 50, 60 };

    for (int i = 0; i < r->mode_count; i++)
        for (int m = 0; m < 2; m++) {
            double hz = cimag(r->modes[i].exponent) / (2 * M_PI), n = nearbyint(hz / mains[m]);
            if (n >= 1 && n <= MAINS_HARMONICS && fabs(hz - n * mains[m]) < MAINS_NEAR * mains[m]
                && fabs(damping_ratio_of(r->modes[i].exponent)) < MAINS_DAMPING)
                identify_diagnose(
                    r, "mains_line", -1,
                    "%.5g Hz is an undamped line at %g times %g Hz: mains, not a mode", hz, n,
                    mains[m]);
        }
}

/* What neither decays nor grows by its error, when that is known to UNDAMPED over the record. */
static void look_for_undamped(struct identify_result *r, double record)
{
    const double UNDAMPED = 0.01;

    for (int i = 0; i < r->mode_count; i++) {
        const struct identify_mode *m = &r->modes[i];
        double bar = REFINE_CLEAR * m->std_re;
        if (cimag(m->exponent) * record > 4 * M_PI && fabs(creal(m->exponent)) <= bar
            && bar * record < UNDAMPED)
            identify_diagnose(r, "undamped", -1, "mode %d (%.5g Hz) keeps its amplitude over the "
                              "record to %.2g: a steady force, a limit cycle or a mode without "
                              "damping, which the record cannot tell apart", i,
                              cimag(m->exponent) / (2 * M_PI), bar * record);
    }
}

static void look_for_drift(struct identify_result *r, double record)
{
    bool vibrates = false;

    for (int i = 0; i < r->mode_count; i++)
        vibrates |= cimag(r->modes[i].exponent) * record > 4 * M_PI;
    for (int i = 0; i < r->mode_count && vibrates; i++)
        /* less than a quarter of a turn: offset, slope and curvature are all that is seen */
        if (cabs(r->modes[i].exponent) * record < DRIFT_SLOW && r->modes[i].energy > DRIFT_LEAST) {
            identify_diagnose(r, "drift", -1,
                              "%.2g of the energy moves more slowly than the record of %g s: drift "
                              "or a rigid motion; its exponent says little, "
                              "and `detrend` or `band` removes it",
                              r->modes[i].energy, record);
            return;
        }
}

enum modal_status trend_watch(const struct trend_input *in, struct identify_result *result,
                              bool *follows, struct modal_error *err)
{
    bool none = in->count == 0 && in->ragged > 0, good = !none, crowd = false;
    double left = none ? 1 : in->white;
    enum modal_status rc = MODAL_OK;

    *follows = false;
    if (left == 0 && in->count > 0 && in->X->m > 2 * in->count + 2)
        rc = adequate(in, &good, &left, err);
    if (rc == MODAL_OK && good)
        rc = crowded(in, &crowd, err);
    if (rc == MODAL_OK && (!good || crowd))
        rc = watch(in, good, left, result, follows, err);
    return rc;
}

void trend_of_modes(double record, struct identify_result *result)
{
    look_for_harmonics(result);
    look_for_mains(result);
    look_for_undamped(result, record);
    look_for_drift(result, record);
}
