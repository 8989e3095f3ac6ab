/* merge.c - one pole for one mode that changes as it decays
 *
 * A mode with friction, or with a stiffness that depends on its amplitude, is no sum of
 * exponentials.  A linear fit spends several poles on it, as close together as its frequency
 * wanders, and none of them is a mode.  What can be said of such a mode is its mean over the record
 * and how far it goes:
 *
 *   members   strongest first, a pole takes every weaker one within its reach: TREND_CLOSE of the
 *             frequency of the mode that was watched, and elsewhere as much as that one wandered,
 *             relatively (other modes go through the same joints)
 *   start     the mean of the members, weighed by their energies, refined with all other poles
 *   error     half the range over the windows, or the members' own rms distance from the mean where
 *             no window tells
 *
 * and again as long as the refined means are within reach of each other: of friction a linear fit
 * draws a comb, wider than one reach.  However far its damping goes, a mode that decays in each of
 * its windows grows nowhere.
 */
#include "modal/identify/ask/merge.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ask/trend.h"
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/linear/exponents.h"
#include "modal/numbers.h"


/* The windows' extremes. */
struct range {
    double low, high, slow, fast;       /* Hz in the data; decay rates, 1/s */
    bool decays;                        /* in every window, by REFINE_CLEAR of its own errors */
};

struct crowd {
    double complex mean;
    double re, im;        /* errors */
    int members;
    bool decays;          /* the watched mode, wherever it was watched */
};

static struct range range_of(const struct identify_window *w, int count, double hertz)
{
    struct range r = { HUGE_VAL, 0, HUGE_VAL, -HUGE_VAL, true };

    for (int i = 0; i < count; i++) {
        /* the data's frequency: a band was shifted, decay rates were not */
        double decay = w[i].damping_ratio * 2 * M_PI * (w[i].frequency_hz - hertz);
        r.low = fmin(r.low, w[i].frequency_hz - hertz),
        r.high = fmax(r.high, w[i].frequency_hz - hertz);
        r.slow = fmin(r.slow, decay), r.fast = fmax(r.fast, decay);
        r.decays &= w[i].damping_ratio > REFINE_CLEAR * w[i].std_damping_ratio;
    }
    return r;
}

/* Mean square of each pole's part, up to a factor. */
static enum modal_status energies(const struct refine_data *d, const struct poles *p,
                                  double *energy, struct modal_error *err)
{
    struct synthesis f = { 0 };
    enum modal_status rc = synthesis_fit(p->lambda, p->count, p->tau, d->Y, NULL, &f, err);

    for (int j = 0; j < p->count && rc == MODAL_OK; j++) {
        double a = creal(p->lambda[j]) * p->tau, weight = 0;
        energy[j] = 0;
        for (int k = 0; k < d->Y->m; k++)
            /* the half of cos^2 is the same for all */
            weight += exp(2 * (a * k - f.reference[j]));
        for (int c = 0; c < f.channels; c++) {
            double complex b = f.coefficient[j + (size_t)c * (size_t)f.poles];
            energy[j] += weight * numbers_square(b);
        }
    }
    synthesis_done(&f);
    return rc;
}

static int strongest(const struct poles *p, const double *energy, const int *crowd)
{
    int at = -1;

    for (int j = 0; j < p->count; j++)
        if (crowd[j] < 0 && (at < 0 || energy[j] > energy[at]))
            at = j;
    return at;
}

static bool watched(const struct range *r, double complex lambda)
{
    double hz = cimag(lambda) / (2 * M_PI);

    return hz > r->low * (1 - TREND_CLOSE) && hz < r->high * (1 + TREND_CLOSE);
}

/* crowd[j]: the number of pole j's crowd.  The count of crowds. */
static int form_crowds(const struct poles *p, const double *energy, const struct range *r,
                       int *crowd)
{
    double wander = (r->high - r->low) / r->low;
    int count = 0, head;

    for (int j = 0; j < p->count; j++)
        crowd[j] = -1;
    while ((head = strongest(p, energy, crowd)) >= 0) {
        double reach = cimag(p->lambda[head])
                     * (watched(r, p->lambda[head]) ? fmax(TREND_CLOSE, wander) : wander);
        for (int j = 0; j < p->count; j++)
            if (crowd[j] < 0 && cimag(p->lambda[j]) > 0
                && fabs(cimag(p->lambda[j]) - cimag(p->lambda[head])) <= reach)
                crowd[j] = count;
        crowd[head] = count++;
    }
    return count;
}

static struct crowd describe(const struct poles *p, const double *energy, const struct range *r,
                             const int *crowd, int which)
{
    struct crowd c = { 0 };
    double all = 0, re = 0, im = 0;

    for (int j = 0; j < p->count; j++)
        if (crowd[j] == which) {
            /* by energy: a weak sideband moves it by little */
            c.mean += energy[j] * p->lambda[j], all += energy[j], c.members++;
            c.re = p->std_re[j], c.im = p->std_im[j];
        }
    c.mean /= all;
    for (int j = 0; j < p->count && c.members > 1; j++)
        if (crowd[j] == which) {
            /* their scatter is the error: each of them describes the same mode */
            re += energy[j] / all * pow(creal(p->lambda[j]) - creal(c.mean), 2);
            im += energy[j] / all * pow(cimag(p->lambda[j]) - cimag(c.mean), 2);
        }
    if (c.members > 1)
        c.re = sqrt(re), c.im = sqrt(im);
    if (c.members > 1 && watched(r, c.mean))
        /* half of what its windows range over: 2 pi / 2 */
        c.re = (r->fast - r->slow) / 2, c.im = M_PI * (r->high - r->low), c.decays = r->decays;
    return c;
}

/* The crowds' poles take the place of the old ones. */
static void replace(struct poles *p, const struct refined *fit, const struct crowd *crowds,
                    const int *crowd)
{
    for (int i = 0; i < fit->poles; i++) {
        int from = 0;
        while (crowd[from] != i)
            from++;
        p->lambda[i] = fit->lambda[i];
        p->std_re[i] = fmax(fit->std_re[i], crowds[i].re),
        p->std_im[i] = fmax(fit->std_im[i], crowds[i].im);
        p->bar[i] = NAN, p->angle[i] = crowds[i].members > 1 ? NAN : p->angle[from],
        p->growth[i] = crowds[i].decays ? GROWTH_NEVER : GROWTH_UNSEEN;
    }
    p->count = fit->poles;
}

static enum modal_status merge_once(const struct refine_data *data, const struct range *r,
                                    struct poles *p, bool *converged, bool *fewer,
                                    struct modal_error *err)
{
    size_t room = (size_t)p->count + 1;
    double *energy = calloc(room, sizeof *energy);
    int *crowd = calloc(room, sizeof *crowd), n;
    struct crowd *crowds = calloc(room, sizeof *crowds);
    double complex *lambda = calloc(room, sizeof *lambda);
    bool *fixed = calloc(room, sizeof *fixed);
    struct refined fit = { 0 };
    enum modal_status rc = MODAL_OK;

    *fewer = false;
    if (energy == NULL || crowd == NULL || crowds == NULL || lambda == NULL || fixed == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "merge: no memory for %d poles", p->count);
        goto out;
    }
    rc = energies(data, p, energy, err);
    if (rc != MODAL_OK)
        goto out;
    n = form_crowds(p, energy, r, crowd);
    for (int i = 0; i < n; i++) {
        crowds[i] = describe(p, energy, r, crowd, i);
        lambda[i] = crowds[i].mean;
        fixed[i] = lambda[i] == 0;  /* the constant stays one */
    }
    if (n == p->count)
        goto out;
    rc = refine_poles(data, lambda, n, fixed, NULL, &fit, err);
    if (rc == MODAL_OK && fit.end != REFINE_DEGENERATE) {
        replace(p, &fit, crowds, crowd);
        *converged |= refined_converged(&fit), *fewer = true;
    }
out:
    refined_done(&fit);
    free(energy), free(crowd), free(crowds), free(lambda), free(fixed);
    return rc;
}

enum modal_status merge_crowds(const struct refine_data *data, const struct identify_window *trend,
                               int count, double hertz, struct poles *p, bool *converged,
                               struct modal_error *err)
{
    struct range r = range_of(trend, count, hertz);
    enum modal_status rc = MODAL_OK;
    bool fewer = count > 0 && r.low > 0;

    while (fewer && rc == MODAL_OK)
        rc = merge_once(data, &r, p, converged, &fewer, err);
    return rc;
}
