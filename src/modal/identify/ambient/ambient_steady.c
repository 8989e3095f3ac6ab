/*
 * ambient_steady.c - mean squares of parts of the record
 *
 * The mean square of a part of M samples of a Gaussian record with spectrum S has the variance
 * 2/M <tr S^2>, <> the mean over all frequencies; over the square of its mean <tr S> that is v, and
 * were the part's energy a gamma variable, its logarithm's variance trigamma(1/v), which is v + v^2
 * to what matters here.  The sum of squares of the parts' logarithms about their
 * mean over that is held against chi-squared.  For lines beside each other, with coefficients f
 * and g, |f^H g|^2 has the mean tr S^2.
 */
#include "modal/identify/ambient/ambient_steady.h"
#include <cblas.h>
#include <complex.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include "modal/identify/ambient/spectrum.h"
#include "modal/identify/ask/diagnose.h"
#include "modal/identify/prepare/record.h"

enum {
    PARTS = 8,                   /* of the record */
    UNITS = AMBIENT_STEADY_UNITS   /* and for the part that holds most of the energy */
};
static const double
    UNSTEADY = 40,               /* chi-squared of 7 degrees of freedom: 1e-6 */
    SHORT = 0.25,                /* a part of the record as short as this, */
    NEARLY_ALL = 0.9;            /* with so much of its energy, is where the motion was */

/* Mean squares of UNITS equal parts of signals. */
static void energies_of_parts(const struct matrix *Z, double *energy)
{
    int rows = Z->m / UNITS;

    for (int u = 0; u < UNITS; u++) {
        energy[u] = 0;
        for (int j = 0; j < Z->n; j++) {
            const double *z = Z->x + (size_t)j * Z->ld + (size_t)u * rows;
            energy[u] += cblas_ddot(rows, z, 1, z, 1) / rows;
        }
    }
}

/* v of a part of so many samples. */
static double variance_of_part(const struct spectrum *s, double samples)
{
    double square = 0, mean = 0;
    int l = s->channels;

    for (int j = 0; j < s->lines; j++) {
        const double complex *f = s->F + (size_t)j * l;
        double complex both = 0;
        for (int c = 0; c < l; c++) {
            mean += creal(f[c] * conj(f[c])) / s->lines;
            both += j > 0 ? f[c] * conj(f[c - l]) : 0;
        }
        square += creal(both * conj(both)) / s->lines;
    }
    return 2 / samples * square / (mean * mean);
}

/* Is nearly all the energy in a short part? */
static bool is_short(const double *energy, double *share)
{
    int reach = (int)(SHORT * UNITS);
    double all = 0, least = HUGE_VAL;

    *share = 0;
    for (int u = 0; u < UNITS; u++)
        /* noise lasts throughout: what is over it is the motion's */
        least = fmin(least, energy[u]);
    for (int u = 0; u < UNITS; u++)
        all += energy[u] - least;
    for (int first = 0; first + reach <= UNITS; first++) {
        double part = 0;
        for (int u = first; u < first + reach; u++)
            part += energy[u] - least;
        *share = fmax(*share, part / all);
    }
    return *share > NEARLY_ALL;
}

/* The sum that is held against chi-squared, of the mean squares of UNITS parts. */
static double unsteadiness(const double *energy, double v)
{
    double part[PARTS] = { 0 }, mean = 0, sum = 0;

    for (int u = 0; u < UNITS; u++)
        part[u * PARTS / UNITS] += energy[u];
    for (int i = 0; i < PARTS; i++) {
        part[i] = log(fmax(part[i], DBL_MIN));
        mean += part[i] / PARTS;
    }
    for (int i = 0; i < PARTS; i++)
        sum += (part[i] - mean) * (part[i] - mean) / (v + v * v);
    return sum;
}

/* Were the signals, taken together, steady? */
static bool tell_together(const struct ambient_steady_input *in, struct identify_result *r)
{
    double energy[UNITS], share, sum;

    energies_of_parts(in->Z, energy);
    sum = unsteadiness(energy, variance_of_part(in->spectrum, in->Z->m / (double)PARTS));
    if (!(sum > UNSTEADY))
        return true;
    if (is_short(energy, &share)) {
        r->driven = true;
        identify_diagnose(r, "not_ambient", -1, "%.0f %% of the energy lie in a quarter of the "
                          "record: a free decay or a hit, not the answer to a lasting excitation, "
                          "of which there are no standard errors and no verdict; give "
                          "response=free, or `window` to look at another part", 100 * share);
    } else
        identify_diagnose(r, "not_stationary", -1, "eighths of the record differ in energy by "
                          "more than a steady excitation explains (chi-squared %.3g of %d degrees "
                          "of freedom): modes are a mean over it and their errors may be too "
                          "small; identify parts by `window`", sum, PARTS - 1);
    return false;
}

/* Is channel C steady?  F: room for its coefficients.  The sum. */
static double channel_unsteadiness(const struct ambient_steady_input *in, int c, double complex *F)
{
    const struct spectrum *s = in->spectrum;
    const struct matrix *Y = &in->rec->Y;
    struct spectrum one = { 1, s->samples, s->first, s->lines, F };
    struct matrix y = { Y->m, 1, Y->ld, Y->x + (size_t)c * Y->ld };
    double energy[UNITS];

    for (int j = 0; j < s->lines; j++) {
        F[j] = 0;
        for (int i = 0; i < s->channels; i++)
            F[j] += in->back[c + (size_t)Y->n * i] * s->F[(size_t)j * s->channels + i];
    }
    energies_of_parts(&y, energy);
    return unsteadiness(energy, variance_of_part(&one, y.m / (double)PARTS));
}

enum modal_status ambient_steady_tell(const struct ambient_steady_input *in,
                                      struct identify_result *r, struct modal_error *err)
{
    int told = 0;
    double complex *F;

    if (!tell_together(in, r) || in->rec == NULL)
        return MODAL_OK;
    F = malloc(sizeof *F * (size_t)in->spectrum->lines);
    if (F == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d lines",
                          in->spectrum->lines);
    for (int c = 0; c < in->rec->Y.n && told < IDENTIFY_TOLD; c++) {
        double sum = in->rec->scale[c] > 0 ? channel_unsteadiness(in, c, F) : 0;
        int channel = in->rec->channel[c];
        if (!(sum > UNSTEADY))
            continue;
        told++;
        identify_diagnose(r, "not_stationary", channel, "eighths of channel %d differ in energy by "
                          "more than a steady excitation explains (chi-squared %.3g of %d degrees "
                          "of freedom), those of all together do not: a sensor that failed or was "
                          "changed looks so, and shows modes twice; leave it out by `signals`",
                          channel, sum, PARTS - 1);
    }
    free(F);
    return MODAL_OK;
}
