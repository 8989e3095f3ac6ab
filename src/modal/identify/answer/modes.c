/*
 * modes.c - modes from poles
 *
 * One least-squares fit of all poles to all channels (synthesis.c) gives the coefficients b;
 * everything reported follows from them.
 *
 *   constant       one pole, one mode
 *   p-sample       one pole, one mode; its coefficient is periodic, b[k] at the p phases, and
 *                  harmonics.c gives its Fourier series
 *   one-sample     a periodic system sampled at T/dt not whole: pole lambda + i k Omega is harmonic
 *                  k of the mode lambda.  Poles that agree modulo i Omega (or whose conjugates do)
 *                  are one mode; each is an independent estimate of lambda, and they are averaged
 *                  with the inverse of their variances, or with their energies where those are
 *                  unknown.  Nothing is rounded to whole samples.                              (1)
 *                  A band of a periodic system is the same: the demodulation moved its lines by a
 *                  known frequency, and only those inside are seen
 *
 * Energy of a mode over the record: with the real basis columns x_i of its poles and their Gram
 * matrix G, sum_c b_c^T G b_c.
 *
 * Offset: an isolated real exponent that is zero within its error and, for a periodic system, whose
 * coefficient is the same at all phases.
 *
 * Modal phase collinearity [PEL93], from the second moments of Re and Im of the shape about zero:
 *
 *     ((Sxx - Syy)^2 + 4 Sxy^2) / (Sxx + Syy)^2.                                                (2)
 *
 * [PEL93] Pappa, Elliott and Schenk, J. Guidance Control Dyn. 16 (1993) 832-838.
 */
#include "modal/identify/answer/modes.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/answer/harmonics.h"
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/fit/refine.h"
#include "modal/identify/prepare/fold.h"
#include "modal/linalg/svd.h"
#include "modal/numbers.h"

/* How far two poles may be apart modulo i Omega and still be one mode, in units of Omega, beside
 * five standard deviations. */
static const double FOLD_APART = 2e-3;
/* An offset is the same at all phases. */
static const double OFFSET_EXACT = 1e-6;    /* of it, where there is no noise, */
static const double OFFSET_SIGMAS = 6;      /* errors of its coefficients, where there is */

struct work {
    const struct record *rec;
    const struct poles *poles;
    const struct identify_options *opt;
    struct matrix folded;              /* owned where shift > 1 */
    const struct matrix *Y;       /* what was fitted: channels as columns, or phases and channels */
    struct synthesis fit;
    struct matrix products;            /* of the basis' columns, scaled as coefficients want */
    int *column;                       /* of each pole's first */
    int *mode;           /* of each pole: the mode it belongs to; -1: the offset; -2: out of band */
    int *harmonic;                     /* of each pole: its k in (1), 0 elsewhere */
    bool *flipped;                     /* (1): it is the conjugate that agrees */
    int modes;
    double live;                       /* channels that are not zero */
};

static void work_done(struct work *w)
{
    free(w->folded.x);
    synthesis_done(&w->fit);
    free(w->products.x);
    free(w->column);
    free(w->mode);
    free(w->harmonic);
    free(w->flipped);
}

static enum modal_status work_start(struct work *w, struct modal_error *err)
{
    const struct poles *p = w->poles;
    int n = poles_order(p->lambda, p->count, p->tau);
    enum modal_status rc = MODAL_OK;

    w->Y = &w->rec->Y;
    if (p->shift > 1) {
        rc = fold(&w->rec->Y, p->shift, &w->folded, err);
        w->Y = &w->folded;
    }
    if (rc != MODAL_OK)
        return rc;
    w->column = calloc(p->count + 1, sizeof *w->column);
    w->mode = calloc(p->count + 1, sizeof *w->mode);
    w->harmonic = calloc(p->count + 1, sizeof *w->harmonic);
    w->flipped = calloc(p->count + 1, sizeof *w->flipped);
    w->products = matrix_new(n, n);
    if (w->column == NULL || w->mode == NULL || w->harmonic == NULL || w->flipped == NULL
        || w->products.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "modes: no memory for %d poles", p->count);
    synthesis_products(p->lambda, p->count, p->tau, w->Y->m, w->products.x);
    for (int j = 0, c = 0; j < p->count; j++) {
        w->column[j] = c;
        c += pole_order(p->lambda[j], p->tau);
    }
    for (int c = 0; c < w->rec->channels; c++)
        w->live += w->rec->scale[c] > 0;
    if (p->fit == NULL)
        return synthesis_fit(p->lambda, p->count, p->tau, w->Y, NULL, &w->fit, err);
    w->fit = *p->fit;
    *p->fit = (struct synthesis) { 0 };
    return MODAL_OK;
}

/* Energy of the poles for which mode[] == which, over all columns of Y. */
static double energy_of(const struct work *w, int which)
{
    const struct poles *p = w->poles;
    int *index = malloc(sizeof *index * (w->products.n + 1)), n = 0;
    double *G = NULL, *b = NULL, sum = 0;

    for (int j = 0; j < p->count && index != NULL; j++)
        for (int i = 0; w->mode[j] == which && i < pole_order(p->lambda[j], p->tau); i++)
            index[n++] = w->column[j] + i;
    G = malloc(sizeof *G * ((size_t)n * n + n + 1));
    if (index == NULL || G == NULL) {
        free(index), free(G);
        return NAN;
    }
    b = G + (size_t)n * n;
    for (int i = 0; i < n; i++)
        for (int k = 0; k < n; k++)
            G[i + k * n] = w->products.x[index[i] + (size_t)index[k] * (size_t)w->products.ld];
    for (int c = 0; c < w->Y->n; c++) {
        n = 0;
        for (int j = 0; j < p->count; j++) {
            double complex z = w->fit.coefficient[j + (size_t)c * p->count];
            if (w->mode[j] != which)
                continue;
            b[n++] = creal(z);
            if (pole_kind(p->lambda[j], p->tau) == POLE_PAIR)
                b[n++] = cimag(z);
        }
        for (int i = 0; i < n; i++)
            for (int k = 0; k < n; k++)
                /* |Phi b|^2 = b^T Phi^T Phi b: the energy without the rows */
                sum += b[i] * G[i + k * n] * b[k];
    }
    free(index), free(G);
    return sum > 0 ? sum : 0;
}

/* |coefficient_j|^2 over all columns. */
static double weight_of(const struct work *w, int j)
{
    double sum = 0;

    for (int c = 0; c < w->Y->n; c++) {
        double complex z = w->fit.coefficient[j + (size_t)c * w->poles->count];
        sum += numbers_square(z);
    }
    return sum;
}

/* ---- offset ---- */

/* Is the coefficient of pole j the same at every phase, within what the fit leaves? */
static bool same_at_all_phases(const struct work *w, int j)
{
    int p = w->poles->shift;
    double spread = 0, size = 0,
           /* of a constant: the residual's rms over sqrt(rows) */
           noise = w->fit.residual / sqrt((double)w->Y->m * w->Y->n) / sqrt(w->Y->m);

    for (int s = 0; s < w->rec->channels; s++) {
        double mean = 0;
        for (int k = 0; k < p; k++)
            mean += creal(w->fit.coefficient[j + (size_t)(k + p * s) * w->poles->count]) / p;
        for (int k = 0; k < p; k++) {
            double d = creal(w->fit.coefficient[j + (size_t)(k + p * s) * w->poles->count]) - mean;
            spread += d * d;
            size += mean * mean;
        }
    }
    return sqrt(spread) <= OFFSET_EXACT * sqrt(size)
        + OFFSET_SIGMAS * noise * sqrt((double)w->rec->channels * p);
}

/* The one real pole that is zero within its error, if nothing else is near it; -1: none. */
static int find_offset(const struct work *w)
{
    const struct poles *p = w->poles;
    double record = p->tau * w->Y->m;
    int found = -1;

    if (w->rec->shift_rad_s != 0)
        return -1;
    for (int j = 0; j < p->count; j++) {
        double error = p->std_re[j] > 0 ? 4 * p->std_re[j] : 0,
               most = fmin(fmax(error, 1e-7 / record), 0.3 / record);
        if (frequency_of(p->lambda[j]) * record > 0.5 && !(frequency_of(p->lambda[j]) < 2 * most))
            continue;
        if (pole_kind(p->lambda[j], p->tau) != POLE_REAL || found >= 0
            || !(fabs(creal(p->lambda[j])) <= most))
            return -1;                    /* a second slow pole: a cluster at zero, not an offset */
        found = j;
    }
    return found >= 0 && (p->shift == 1 || same_at_all_phases(w, found)) ? found : -1;
}

static enum modal_status report_offset(const struct work *w, int j, struct identify_result *result,
                                       struct modal_error *err)
{
    int p = w->poles->shift;

    result->offset = calloc(w->rec->channels + 1, sizeof *result->offset);
    if (result->offset == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "modes: no memory for %d channels",
                          w->rec->channels);
    for (int s = 0; s < w->rec->channels; s++)
        for (int k = 0; k < p; k++)
            result->offset[s] += w->rec->scale[s]
                * (creal(w->fit.coefficient[j + (size_t)(k + p * s) * w->poles->count]) / p);
    return MODAL_OK;
}

/* ---- which poles are one mode ---- */

/* Pole j where it was before a band was demodulated. */
static double complex line(const struct work *w, int j)
{
    return w->poles->lambda[j] + CMPLX(0, w->rec->shift_rad_s);
}

/* Does pole j, or its conjugate, equal lambda + i k Omega?  (1) */
static bool folds_onto(const struct work *w, int j, double complex lambda, double std, int *k,
                       bool *flipped)
{
    double Omega = 2 * M_PI / w->rec->period;

    /* of a pair one is listed, Im > 0: the other may be the one that folds */
    for (int sign = 1; sign >= -1; sign -= 2) {
        double im = sign * cimag(line(w, j)) - cimag(lambda), turns = nearbyint(im / Omega);
        double apart = hypot(creal(w->poles->lambda[j]) - creal(lambda), im - turns * Omega);
        double own = w->poles->std_re[j] > 0 ? hypot(w->poles->std_re[j], w->poles->std_im[j]) : 0;
        double may = w->poles->tied ? REFINE_TIED * Omega
                                    : FOLD_APART * Omega + 5 * hypot(std, own);
        /* exponents of a periodic system are known modulo i Omega only */
        if (apart <= may) {
            *k = (int)turns;
            *flipped = sign < 0;
            return true;
        }
    }
    return false;
}

/* Strongest first: each pole not yet taken starts a mode and takes those that agree with it modulo
 * i Omega. */
static void group_poles(struct work *w)
{
    const struct poles *p = w->poles;
    bool fold_them = w->rec->period > 0 && p->shift == 1;

    for (int j = 0; j < p->count; j++)
        if (w->mode[j] == -3 && !fold_them)
            w->mode[j] = w->modes++;
    while (fold_them) {
        double most = -1;
        int head = -1, which;
        for (int j = 0; j < p->count; j++)
            if (w->mode[j] == -3 && weight_of(w, j) > most)
                most = weight_of(w, j), head = j;
        if (head < 0)
            break;
        which = w->modes++;
        w->mode[head] = which;
        for (int j = 0; j < p->count; j++)
            if (w->mode[j] == -3
                && folds_onto(w, j, line(w, head),
                              p->std_re[head] > 0 ? hypot(p->std_re[head], p->std_im[head]) : 0,
                              &w->harmonic[j], &w->flipped[j]))
                w->mode[j] = which;
    }
}

/* ---- one mode ---- */

/* Principal value, Im in [0, Omega/2], and the shift of k that takes there: lambda = principal + i
 * k Omega, or its conjugate.  A pair beside the real axis would show two lines; one line at 0 or
 * Omega/2, within its error, is a real multiplier. */
static double complex principal(double complex lambda, double Omega, double error, int *k,
                                bool *flipped)
{
    double im = cimag(lambda), turns = ceil(im / Omega - 0.5);

    im -= turns * Omega;
    *k = (int)turns;                /* e^{lambda T} is the same for all of lambda + i k Omega */
    *flipped = im < 0;
    im = fabs(im);
    if (im < error)
        im = 0;
    if (Omega / 2 - im < error)
        im = Omega / 2;
    return CMPLX(creal(lambda), im);
}

/* Has an earlier pole of the same mode the same exponent, as a line of the same multiplier that was
 * fitted as one (refine.h, omega)?  It tells nothing more then. */
static bool told_before(const struct work *w, int j)
{
    double Omega = 2 * M_PI / w->rec->period;
    bool told = false;

    for (int i = 0; i < j && !told; i++)
        for (int sign = 1; sign >= -1 && w->mode[i] == w->mode[j]; sign -= 2) {
            double im = (sign * cimag(line(w, j)) - cimag(line(w, i))) / Omega;
            told |= fabs(im - nearbyint(im)) <= REFINE_TIED
                 && fabs(creal(line(w, j) - line(w, i))) <= REFINE_TIED * Omega;
        }
    return told;
}

/* (1): the mean of a mode's poles, brought to the head's branch; std of the mean. */
static double complex mean_pole(const struct work *w, int which, double *std_re, double *std_im)
{
    const struct poles *p = w->poles;
    double Omega = w->rec->period > 0 ? 2 * M_PI / w->rec->period : 0, wr = 0, wi = 0, re = 0,
           im = 0;
    bool known = true;

    for (int j = 0; j < p->count; j++)
        if (w->mode[j] == which)
            known &= p->std_re[j] > 0 && isfinite(p->std_re[j]);
    for (int j = 0; j < p->count; j++) {
        double weight = weight_of(w, j), a, b, at;
        if (w->mode[j] != which || told_before(w, j))
            continue;
        /* the mean of least variance, where variances are known */
        a = known ? 1 / (p->std_re[j] * p->std_re[j]) : weight;
        b = known && p->std_im[j] > 0 ? 1 / (p->std_im[j] * p->std_im[j]) : known ? a : weight;
        at = (w->flipped[j] ? -cimag(line(w, j)) : cimag(line(w, j))) - w->harmonic[j] * Omega;
        re += a * creal(p->lambda[j]), wr += a;
        im += b * at, wi += b;
    }
    *std_re = known ? 1 / sqrt(wr) : NAN;
    *std_im = known ? 1 / sqrt(wi) : NAN;
    return CMPLX(wr > 0 ? re / wr : 0, wi > 0 ? im / wi : 0);
}

static enum modal_status keep_harmonics(struct identify_mode *m,
                                        const struct identify_harmonic *list, int count,
                                        struct modal_error *err)
{
    m->harmonics = malloc(sizeof *list * (count + 1));
    if (m->harmonics == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "modes: no memory for harmonics");
    memcpy(m->harmonics, list, sizeof *list * count);
    m->harmonic_count = count;
    return MODAL_OK;
}

/* Harmonics of pole j by the phases of its coefficient. */
static enum modal_status phase_harmonics(const struct work *w, int j, struct identify_mode *m,
                                         struct modal_error *err)
{
    struct identify_harmonic list[HARMONICS_REPORTED];
    int count;
    enum modal_status rc = harmonics_of(w->fit.coefficient + j, w->poles->count, w->poles->shift,
                                        w->rec->channels, w->poles->lambda[j], w->rec->period, list,
                                        &count, &m->resolved_k, &m->runner_up, err);

    return rc == MODAL_OK ? keep_harmonics(m, list, count, err) : rc;
}

/* Harmonics of a mode whose poles are its comb, relative to its principal value. */
static enum modal_status comb_harmonics(const struct work *w, int which, int turns, bool flipped,
                                        struct identify_mode *m, struct modal_error *err)
{
    struct identify_harmonic *list = malloc(sizeof *list * (2 * w->poles->count + 1));
    int count = 0;
    enum modal_status rc;

    if (list == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "modes: no memory for harmonics");
    for (int j = 0; j < w->poles->count; j++) {
        int k;
        if (w->mode[j] != which)
            continue;
        /* of the head's branch, then of the principal value, then of its conjugate; a real signal
         * holds both signs of a real kind */
        k = w->harmonic[j] + turns;
        if (flipped)
            k = -k;
        list[count++] = (struct identify_harmonic) { k, sqrt(weight_of(w, j)) };
    }
    harmonics_choose(list, count, m->exponent, w->rec->period, &m->resolved_k, &m->runner_up);
    rc = keep_harmonics(m, list, count < HARMONICS_REPORTED ? count : HARMONICS_REPORTED, err);
    free(list);
    return rc;
}

/* Component of channel c: the coefficient itself, or its Fourier coefficient at resolved_k. */
static double complex component(const struct work *w, int j, int c, const struct identify_mode *m)
{
    const struct poles *p = w->poles;
    double complex sum = 0;

    if (p->shift == 1 || w->rec->period <= 0)
        return w->fit.coefficient[j + (size_t)c * p->shift * p->count];
    for (int k = 0; k < p->shift; k++) {
        double t = k * w->rec->period / p->shift,
               /* e^{-lambda t} leaves the periodic part, of which one harmonic is taken */
               turn = -(cimag(p->lambda[j]) * t + 2 * M_PI * m->resolved_k * k / p->shift);
        sum += w->fit.coefficient[j + (size_t)(k + p->shift * c) * p->count]
            * exp(-creal(p->lambda[j]) * t) * CMPLX(cos(turn), sin(turn)) / p->shift;
    }
    return sum;
}

/* (2) */
double modes_mpc(const double complex *shape, int count)
{
    double xx = 0, yy = 0, xy = 0;

    for (int c = 0; c < count; c++) {
        xx += creal(shape[c]) * creal(shape[c]);
        yy += cimag(shape[c]) * cimag(shape[c]);
        xy += creal(shape[c]) * cimag(shape[c]);
    }
    return xx + yy > 0 ? ((xx - yy) * (xx - yy) + 4 * xy * xy) / ((xx + yy) * (xx + yy)) : NAN;
}

void modes_scale_shape(struct identify_mode *m, int count)
{
    int largest = 0;
    double complex unit;

    for (int c = 1; c < count; c++)
        if (cabs(m->shape[c]) > cabs(m->shape[largest]))
            largest = c;
    unit = m->shape[largest];
    for (int c = 0; c < count && cabs(unit) > 0; c++)
        m->shape[c] = c == largest ? 1 : m->shape[c] / unit;  /* 1 exactly, not to rounding */
    m->mpc = modes_mpc(m->shape, count);
}

/* In the channels' own units, largest component 1. */
static enum modal_status shape_of(const struct work *w, int j, struct identify_mode *m,
                                  struct modal_error *err)
{
    int S = w->rec->channels;
    double most = largest_magnitude(w->rec->scale, S);

    m->shape = malloc(sizeof *m->shape * (S + 1));
    if (m->shape == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "modes: no memory for a shape of %d channels", S);
    for (int c = 0; c < S; c++)
        /* channels had unit rms */
        m->shape[c] = component(w, j, c, m) * (w->rec->scale[c] / most);
    modes_scale_shape(m, S);
    return MODAL_OK;
}

/* d|lambda| and d zeta from those of Re and Im, taken as independent; never below rounding, which
 * is that of lambda itself and that of e^{lambda t} over the record. */
void modes_spread_std(struct identify_mode *m, double span, double record)
{
    double complex z = m->resolved;
    double omega = frequency_of(z), a = creal(z), b = cimag(z),
           least = DBL_EPSILON * (omega + 1 / record);

    if (m->std_re > 0)
        m->std_re = fmax(m->std_re, least);
    if (m->std_im > 0)
        m->std_im = fmax(m->std_im, least);

    /* |d rho| = |rho| T |d lambda| */
    m->std_multiplier = hypot(m->std_re, m->std_im) * span * exp(a * span);
    /* d|lambda| = (a da + b db) / |lambda| */
    m->std_frequency_hz = omega > 0 ? hypot(a * m->std_re, b * m->std_im) / omega / (2 * M_PI)
                                    : m->std_re / (2 * M_PI);
    m->std_damping_ratio =
        /* d zeta = b (a db - b da) / |lambda|^3 */
        omega > 0 ? fabs(b) / (omega * omega) * hypot(b * m->std_re, a * m->std_im) / omega : NAN;
}

static int head_of(const struct work *w, int which)
{
    int head = -1;

    for (int j = 0; j < w->poles->count; j++)
        if (w->mode[j] == which && (head < 0 || weight_of(w, j) > weight_of(w, head)))
            head = j;
    return head;
}

static enum modal_status report_mode(const struct work *w, int which, struct identify_mode *m,
                                     struct modal_error *err)
{
    const struct record *rec = w->rec;
    const struct poles *p = w->poles;
    double Omega = rec->period > 0 ? 2 * M_PI / rec->period : 0,
           span = rec->period > 0 ? rec->period : rec->dt;
    int head = head_of(w, which), turns = 0;
    bool flipped = false, comb = rec->period > 0 && p->shift == 1;
    double complex lambda = comb ? mean_pole(w, which, &m->std_re, &m->std_im) : p->lambda[head];
    enum modal_status rc = MODAL_OK;

    if (!comb)
        m->std_re = p->std_re[head], m->std_im = p->std_im[head];
    m->exponent = m->resolved = comb ? lambda : line(w, head);
    m->persistence = NAN;
    m->residual = p->angle[head];
    m->growth = p->growth[head];
    m->amplitude = sqrt(energy_of(w, which) / ((double)w->Y->m * p->shift * w->live));
    if (comb)
        m->exponent =
            principal(lambda, Omega, fmax(1e-9 * Omega, m->std_im > 0 ? 3 * m->std_im : 0), &turns,
                      &flipped);
    if (comb)
        rc = comb_harmonics(w, which, turns, flipped, m, err);
    else if (rec->period > 0)
        rc = phase_harmonics(w, head, m, err);
    if (rc != MODAL_OK)
        return rc;
    m->resolved = m->exponent + CMPLX(0, m->resolved_k * Omega);
    m->multiplier = rec->period > 0 || rec->decimation == 1 ? multiplier_of(m->exponent, span)
                  : cexp(CMPLX(creal(m->exponent) * span, cimag(m->exponent) * span));
    modes_spread_std(m, span, w->Y->m * p->tau);
    /* of a multiplier over a shift to one over a sample, to first order */
    m->bar = p->bar[head] * (rec->period > 0 ? 1 : span / p->tau);
    if (w->opt->shapes) {
        int at = head;
        for (int j = 0; j < p->count && comb; j++)
            if (w->mode[j] == which
                && (flipped ? -(w->harmonic[j] + turns) : w->harmonic[j] + turns) == m->resolved_k)
                at = j;
        rc = shape_of(w, at, m, err);
    }
    return rc;
}

static enum modal_status report_reconstruction(const struct work *w, struct identify_result *r,
                                               struct modal_error *err)
{
    int S = w->rec->channels, p = w->poles->shift;
    double all = 0;

    r->channel_count = S;
    r->channel = malloc(sizeof *r->channel * (S + 1));
    r->rms_error = malloc(sizeof *r->rms_error * (S + 1));
    r->relative_error = malloc(sizeof *r->relative_error * (S + 1));
    if (r->channel == NULL || r->rms_error == NULL || r->relative_error == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "modes: no memory for %d channels", S);
    for (int s = 0; s < S; s++) {
        double rest = safe_norm(w->fit.channel_residual + (size_t)s * p, p);
        /* of what was identified: a window, without its mean */
        double size = w->rec->wide ? record_wide_size(w->rec, s) * sqrt(w->Y->m)
                    : safe_norm(w->rec->Y.x + (size_t)s * w->rec->Y.ld, (size_t)w->Y->m * p);
        r->channel[s] = w->rec->channel[s];
        r->rms_error[s] = w->rec->scale[s] * (rest / sqrt((double)w->Y->m * p));
        r->relative_error[s] = size > 0 ? rest / size : NAN;
        all += size * size;
    }
    r->total_relative_error = all > 0 ? w->fit.residual / sqrt(all) : NAN;
    return MODAL_OK;
}

static int by_amplitude(const void *a, const void *b)
{
    const struct identify_mode *p = a, *q = b;

    if (p->amplitude != q->amplitude)
        return p->amplitude > q->amplitude ? -1 : 1;
    return (cimag(p->exponent) > cimag(q->exponent)) - (cimag(p->exponent) < cimag(q->exponent));
}

void modes_rank(struct identify_result *r)
{
    double total = 0;

    for (int i = 0; i < r->mode_count; i++)
        total += r->modes[i].amplitude * r->modes[i].amplitude;
    for (int i = 0; i < r->mode_count; i++)
        r->modes[i].energy = total > 0 ? r->modes[i].amplitude * r->modes[i].amplitude / total : 0;
    qsort(r->modes, (size_t)r->mode_count, sizeof *r->modes, by_amplitude);
}

/* What is no stronger than the stop band's leakage is an alias of something outside. */
static void drop_leakage(const struct work *w, struct identify_result *r)
{
    int kept = 0;

    for (int i = 0; i < r->mode_count; i++) {
        if (r->modes[i].amplitude > w->rec->leak) {  /* both are of channels of unit rms */
            r->modes[kept++] = r->modes[i];
            continue;
        }
        free(r->modes[i].harmonics);
        free(r->modes[i].shape);
    }
    r->mode_count = kept;
}

/* A band was asked for: what lies outside of it is the filter's skirt. */
static bool out_of_band(const struct work *w, int j)
{
    double hz = fabs(cimag(w->poles->lambda[j]) + w->rec->shift_rad_s) / (2 * M_PI);

    if (w->opt->band[1] == 0)
        return false;
    if (w->rec->shift_rad_s != 0 && pole_kind(w->poles->lambda[j], w->poles->tau) != POLE_PAIR)
        return true;
    return hz < w->opt->band[0] || hz > w->opt->band[1];
}

enum modal_status modes_report(const struct record *rec, const struct poles *poles,
                               const struct identify_options *opt, struct identify_result *result,
                               struct modal_error *err)
{
    struct work w = { .rec = rec, .poles = poles, .opt = opt };
    enum modal_status rc = work_start(&w, err);
    int offset;

    if (rc != MODAL_OK)
        goto out;
    offset = find_offset(&w);
    for (int j = 0; j < poles->count; j++)
        w.mode[j] = j == offset ? -1 : out_of_band(&w, j) ? -2 : -3;
    if (offset >= 0)
        rc = report_offset(&w, offset, result, err);
    group_poles(&w);
    result->modes = calloc(w.modes + 1, sizeof *result->modes);
    if (result->modes == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "modes: no memory for %d modes", w.modes);
    for (int i = 0; i < w.modes && rc == MODAL_OK; i++) {
        result->mode_count++;
        rc = report_mode(&w, i, &result->modes[i], err);
    }
    if (rec->leak > 0)
        drop_leakage(&w, result);
    if (rc == MODAL_OK)
        rc = report_reconstruction(&w, result, err);
    modes_rank(result);
out:
    work_done(&w);
    return rc;
}

int modes_nearest(const struct identify_result *r, double complex lambda)
{
    int at = -1;

    for (int i = 0; i < r->mode_count; i++)
        if (cabs(r->modes[i].exponent - lambda) < fabs(creal(r->modes[i].exponent))
            && (at < 0 || cabs(r->modes[i].exponent - lambda)
                              < cabs(r->modes[at].exponent - lambda)))
            at = i;
    return at;
}
