/*
 * ambient_tones.c - a sinusoid among modes
 *
 * Of l channels whose spectrum is S a line's coefficients f have f^H S^-1 f = t, a gamma variable
 * of shape l, of which a sinusoid there takes all: its gain in the logarithm of the likelihood.
 * A model that was fitted with a sinusoid in it has S too large about it, and the pole of a mode
 * there too near the axis, by many of its standard errors: bins are as wide as modes ask for.  So t
 * is held against the sum u of those of the lines about it, of shape m l: with X and Y gamma
 * variables of shapes a and b, for each 0 < s < 1
 *
 *     P(X / Y > r) <= (1 - s)^-a (1 + s r)^-b,   least at  s = (b r - a) / (r (a + b)),         (1)
 *
 * [Chernoff 1952], whatever factor S has there.  The largest of t over all frequencies is that of
 * some sqrt(4 pi x / 3) times as many places as there are lines [Rice 1944], x the logarithm of how
 * many they are over ALARM: PLACES.  What is left about a sinusoid is no more than chance has,
 * by (1) again; of the answer to noise, more is.
 *
 * In the peak of a mode that is a few lines wide even this is hidden, for a model that was fitted
 * with the sinusoid has S larger by a share of all that it holds, and about it what is left is the
 * less.  There the largest line is taken for a sinusoid on trial, and the model fitted anew without
 * it: where that is likelier by more than (1) of chance, with b without end, it was one.
 *
 * Lines of a peak are not independent.  Of x' = lambda x + n the line j of N samples is
 *
 *     F_j = (n_j + (x(0) - x(N)) / sqrt(N)) / (i w_j - lambda),                                 (2)
 *
 * and what the record's ends add is the same in all: where they are apart, E |x|^2 = E |n|^2 / 2a
 * with a = -Re lambda makes it the share 1 / (a N) of a line's variance.  Its course over the lines
 * beyond the peak is a sinusoid's, which may gain of n lines n / (a N) times an exponential
 * variable that no likelihood of independent lines expects.  A trial asks for as much more, beside
 * the price of 20 to 30: for a peak that is one line wide some 20, for one of twelve some 2.
 *
 * Lines that were taken off before anything was known of the noise are where the column that shows
 * them best has them.  Where noise is nearly singular, another sum of columns may show them a
 * thousand times better, and what was left of them then looks like a pair.
 *
 * A pair may have been fitted to a sinusoid alone.  Its peak is narrow then, and it leaves the
 * model where the sinusoid is likelier: it has more unknowns and explains amplitudes of any course,
 * and each account is charged its price.
 */
#include "modal/identify/ambient/ambient_tones.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"

enum {
    L = WHITTLE_CHANNELS_MOST,
    NEAR = 3,                    /* lines on either side, of which a sinusoid fills all but 3 % */
    ABOUT = 12,                  /* that tell what is about it, */
    FAR = 32,                    /* and what a narrow pair tells */
    PLACES = 8,                  /* a line; x is 15 */
    TURNS = 30                   /* of the golden section: to a millionth of a line */
};
static const double
    ALARM = 0.01,                /* probability of a line that is none, of a record */
    FLOOR = 1e-3,                /* of S: of what it holds least, where it is singular */
    SLOPE = 1.5;                 /* a bin is a third as wide as a pole is far: at its edges S is
                                    (6/5)^2 of that in its middle at most */

/* One that was taken off before: its cycles over the record, its part of the transform. */
struct known { double cycles; double complex amplitude[L]; };

/* One that leaves: its cycles; which of the known it takes the place of, -1: none. */
struct tone { double cycles; int known; };

struct work {
    struct known known[AMBIENT_LINES_MOST];
    int known_count;
    struct tone tone[2 * AMBIENT_LINES_MOST];
    int tone_count;
    struct spectrum s;           /* less what was found; F owned */
    struct whittle *m;           /* less the pairs that were none; owned */
    double complex poles[WHITTLE_MODES_MOST];
    double x;                    /* what (1) must come to, of its negative logarithm, */
    double price;                /* and what a sinusoid must gain of the likelihood's */
    double *t, *between;         /* of lines, and halfway to the next, by their bins; owned */
    bool *closed;                /* lines that were looked at; owned */
};

/* Of (1), the negative logarithm; 0 where r is no more than the mean. */
static double surprise(double a, double b, double r)
{
    double s = (b * r - a) / (r * (a + b));

    return s > 0 ? a * log1p(-s) + b * log1p(s * r) : 0;
}

/* Line J by M, whose poles a sample are POLES: its t; the logarithm of the determinant, NAN where S
 * is not positive.  C: room for its factor. */
static double weigh(const struct work *w, const struct whittle *m, const double complex *poles,
                    int j, double *t, double complex *C)
{
    double complex seen[L * L], E[L * L], V[WHITTLE_TRANSFERS * L * L];
    const double complex *F = w->s.F + (size_t)j * w->s.channels;
    double turn = 2 * M_PI * (w->s.first + j) / w->s.samples, floor = 0, log_det;
    int l = w->s.channels, lines = 1;
    struct bins bin = { 1, l, w->s.samples, &j, &lines, &turn, &turn, NULL, &floor, seen };

    whittle_transfers(m, poles, turn, V);
    /* of what is seen it would hide a sinusoid by its own energy */
    for (int i = 0; i < l * l; i++)
        floor += FLOOR / l * numbers_square(V[WHITTLE_HM * l * l + i]);
    for (int c = 0; c < l; c++)
        for (int r = 0; r < l; r++)
            seen[r + l * c] = F[r] * conj(F[c]) + (r == c) * floor;
    log_det = whittle_residual(m, poles, &bin, 0, C, E);
    *t = l;
    for (int c = 0; c < l; c++)
        *t += creal(E[c + l * c]);
    return log_det;
}

/* The sum of t over the lines from FIRST to LAST, and how many they are. */
static double sum_of(const struct work *w, const struct whittle *m, const double complex *poles,
                     int first, int last, int *count)
{
    double complex C[L * L];
    double sum = 0, t;

    *count = 0;
    for (int j = first < 0 ? 0 : first; j <= last && j < w->s.lines; j++, ++*count)
        sum += isnan(weigh(w, m, poles, j, &t, C)) ? NAN : t;
    return sum;
}

/* ---- a sinusoid ---- */

/* The transform of exp(i w t) where w is DELTA lines away, over the samples. */
static double complex leakage(const struct work *w, double delta)
{
    double N = w->s.samples, half = M_PI * delta / N;
    double size = delta == 0 ? 1 : sin(M_PI * delta) / (N * sin(half));

    return size * cexp(CMPLX(0, half * (N - 1)));
}

/* The least squares a[] of a sinusoid at POSITION, in lines, on those about J; its t by C. */
static double gain_at(const struct work *w, const double complex *C, int j, double position,
                      double complex *a)
{
    double size = 0, gain;
    double complex b[L];
    int l = w->s.channels;

    memset(a, 0, sizeof *a * l);
    for (int i = j - NEAR; i <= j + NEAR; i++) {
        if (i < 0 || i >= w->s.lines)
            continue;
        double complex g = leakage(w, position - i);
        for (int c = 0; c < l; c++)
            a[c] += conj(g) * w->s.F[(size_t)i * l + c];
        size += numbers_square(g);
    }
    for (int c = 0; c < l; c++)
        b[c] = a[c] / sqrt(size), a[c] /= size;
    cblas_ztrsv(CblasColMajor, CblasLower, CblasNoTrans, CblasNonUnit, l, C, l, b, 1);
    gain = cblas_dznrm2(l, b, 1);
    return gain * gain;
}

/* Where about line J a sinusoid gains most, by the factor C; a[]: its transform. */
static double summit(const struct work *w, const double complex *C, int j, double complex *a,
                     double *gain)
{
    const double golden = (sqrt(5) - 1) / 2;
    double low = j - 1, high = j + 1;

    for (int turn = 0; turn < TURNS; turn++) {
        double p = high - golden * (high - low), q = low + golden * (high - low);
        if (gain_at(w, C, j, p, a) > gain_at(w, C, j, q, a))
            high = q;
        else
            low = p;
    }
    *gain = gain_at(w, C, j, (low + high) / 2, a);
    return (low + high) / 2;
}

/* A sinusoid of A at POSITION out of all lines, its leakage with it; back into them where SIGN is
 * -1. */
static void subtract(struct work *w, double position, const double complex *a, double sign)
{
    int l = w->s.channels;

    for (int j = 0; j < w->s.lines; j++) {
        double complex g = sign * leakage(w, position - j);
        for (int c = 0; c < l; c++)
            w->s.F[(size_t)j * l + c] -= g * a[c];
    }
}

/* Bytes of the lines of all channels. */
static size_t size_of(const struct work *w)
{
    return sizeof *w->s.F * (size_t)w->s.lines * (size_t)w->s.channels;
}

/* A copy of the lines, which the caller frees; NULL: no memory. */
static double complex *copy_of(const struct work *w)
{
    double complex *F = malloc(size_of(w));

    return F != NULL ? memcpy(F, w->s.F, size_of(w)) : NULL;
}

/* The lines are as in the copy F again. */
static void restore(struct work *w, const double complex *F)
{
    memcpy(w->s.F, F, size_of(w));
}

/* The copy F is as the lines are now. */
static void keep(const struct work *w, double complex *F)
{
    memcpy(F, w->s.F, size_of(w));
}

/* ---- what is known ---- */

/* Where a known sinusoid gains most, by the factor C of line J: it is put back, and leaves from
 * there.  *more: what that gains over where it was. */
static double move(struct work *w, const struct known *known, const double complex *C,
                   int j, double *more)
{
    double complex a[L];
    double at = known->cycles - w->s.first, position, before;

    subtract(w, at, known->amplitude, -1);
    before = gain_at(w, C, j, at, a);
    position = summit(w, C, j, a, more);
    subtract(w, position, a, 1);
    *more -= before;
    return position;
}

/* Among what was found; what is more than the record's lines have room for is left in them. */
static void add(struct work *w, double position, int known)
{
    if (w->tone_count < 2 * AMBIENT_LINES_MOST)
        w->tone[w->tone_count++] = (struct tone) { w->s.first + position, known };
}

/* The known that gain more than chance where they are not: noise is not the same in all
 * directions, which nobody knew when they were taken off. */
static enum modal_status correct(struct work *w, struct modal_error *err)
{
    double complex C[L * L], *F = copy_of(w);
    double more, t, position;

    if (F == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d lines", w->s.lines);
    for (int k = 0; k < w->known_count; k++) {
        int j = (int)lround(w->known[k].cycles - w->s.first);
        if (j < 0 || j >= w->s.lines || isnan(weigh(w, w->m, w->poles, j, &t, C)))
            continue;
        position = move(w, &w->known[k], C, j, &more);
        if (more > w->x)
            add(w, position, k), keep(w, F);
        else
            restore(w, F);
    }
    free(F);
    return MODAL_OK;
}

/* ---- pairs ---- */

/* The known within a few lines of mode K; -1: none. */
static int known_near(const struct work *w, int k)
{
    double at = fabs(cimag(w->m->mode[k].lambda)) * w->s.samples / (2 * M_PI);

    for (int i = 0; i < w->known_count; i++)
        if (fabs(w->known[i].cycles - at) < NEAR)
            return i;
    return -1;
}

/* Of the logarithm of the likelihood, what pair K gains over LESS, the model without it, and the
 * best sinusoid over that, one more, or *known where it should be.  W's lines are less it then. */
static void compare(struct work *w, int k, const struct whittle *less,
                    const struct known *known, double *pair, double *sinusoid)
{
    double complex C[L * L], poles[WHITTLE_MODES_MOST], a[L];
    double at = fabs(cimag(w->m->mode[k].lambda)) * w->s.samples / (2 * M_PI) - w->s.first;
    double most = 0, all = 0;
    int middle = (int)lround(at), best = middle, count;

    *pair = 0, *sinusoid = 0;
    whittle_poles(less, poles);
    for (int j = middle - FAR; j <= middle + FAR; j++) {
        double t, u;
        if (j < 0 || j >= w->s.lines)
            continue;
        *pair += weigh(w, less, poles, j, &u, C) - weigh(w, w->m, w->poles, j, &t, C) + u - t;
        all += u;
        if (u > most && abs(j - middle) <= NEAR)
            most = u, best = j;
    }
    if (known != NULL)
        best = (int)lround(known->cycles - w->s.first);
    if (!isfinite(*pair) || best < 0 || best >= w->s.lines
        || isnan(weigh(w, less, poles, best, &most, C)))
        return;
    if (known != NULL)
        move(w, known, C, best, &most);
    else
        subtract(w, summit(w, C, best, a, &most), a, 1);
    *sinusoid = all - sum_of(w, less, poles, middle - FAR, middle + FAR, &count);
}

/* Pairs that are sinusoids, or what is left of known ones that were taken off beside where they
 * are, leave W's model. */
static enum modal_status drop_pairs(struct work *w, struct modal_error *err)
{
    struct whittle *less = malloc(sizeof *less);
    double price = ambient_price(w->s.channels, w->s.lines), pair, sinusoid;
    double complex *F = copy_of(w);

    if (less == NULL || F == NULL) {
        free(less), free(F);
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for a model of spectra");
    }
    for (int k = w->m->count - 1; k >= 0; k--) {
        int i = known_near(w, k);
        if (-creal(w->m->mode[k].lambda) * w->s.samples > 2 * M_PI * NEAR)
            continue;
        *less = *w->m;
        less->count--;
        memmove(less->mode + k, less->mode + k + 1, sizeof *less->mode * (size_t)(less->count - k));
        compare(w, k, less, i >= 0 ? &w->known[i] : NULL, &pair, &sinusoid);
        restore(w, F);
        if (!(sinusoid - (i >= 0 ? 0 : w->price) > pair - price))
            continue;
        *w->m = *less;
        whittle_poles(w->m, w->poles);
    }
    free(less), free(F);
    return MODAL_OK;
}

/* ---- lines ---- */

/* t of all lines and of all places between, by the factor of their bin's middle. */
static void screen(struct work *w, const struct bins *bins)
{
    double complex C[L * L], E[L * L], f[L];
    int l = w->s.channels;

    for (int b = 0; b < bins->count; b++) {
        bool known = !isnan(whittle_residual(w->m, w->poles, bins, b, C, E));
        for (int j = bins->first[b]; j < bins->first[b] + bins->lines[b]; j++)
            for (int half = 0; half < 2; half++) {
                const double complex *F = w->s.F + (size_t)j * l;
                double *t = half ? w->between : w->t;
                t[j] = 0;
                if (!known || j + half == w->s.lines)
                    continue;
                for (int c = 0; c < l; c++)
                    f[c] = half ? (F[c] - F[c + l]) / sqrt(2) : F[c];
                cblas_ztrsv(CblasColMajor, CblasLower, CblasNoTrans, CblasNonUnit, l, C, l, f, 1);
                for (int c = 0; c < l; c++)
                    t[j] += numbers_square(f[c]);
            }
    }
}

/* How much the place J, or that beyond it, stands out of those about it. */
static double stands_out(const struct work *w, int j)
{
    double about = 0, t = SLOPE * fmax(w->t[j], w->between[j]);
    int count = 0, l = w->s.channels;

    for (int i = j - ABOUT; i <= j + 1 + ABOUT; i++)
        if (i >= 0 && i < w->s.lines && (i < j - 1 || i > j + 2))
            about += w->t[i], count++;
    return about > 0 ? surprise(l, count * l, t / about) : 0;
}

/* The line that stands out most, of those not closed; -1: none. */
static int strongest(const struct work *w)
{
    double most = w->x;
    int at = -1;

    for (int j = 0; j < w->s.lines; j++) {
        double out = w->closed[j] ? 0 : stands_out(w, j);
        if (out > most)
            most = out, at = j;
    }
    return at;
}

/* Is a sinusoid that gains so much, taken off about line J, more than chance, and is no more left
 * there? */
static bool is_sinusoid(const struct work *w, int j, double gain)
{
    double complex C[L * L];
    double about, t;
    int count, l = w->s.channels;

    about = sum_of(w, w->m, w->poles, j - ABOUT, j + ABOUT, &count);
    /* one of these lines was the sinusoid's */
    if (!(surprise(l, (count - 1) * l, gain / about) > w->x))
        return false;
    for (int i = j - NEAR; i <= j + NEAR; i++)
        if (i >= 0 && i < w->s.lines && !isnan(weigh(w, w->m, w->poles, i, &t, C))
            && surprise(l, (count - 2) * l, t / (about - t)) > w->x)
            return false;
    return true;
}

/* Whichever about J holds most, within what one sinusoid covers: places beside it may stand out as
 * it does. */
static int highest(const struct work *w, int j)
{
    int best = j;

    for (int i = j - NEAR; i <= j + NEAR; i++)
        if (i >= 0 && i < w->s.lines && w->t[i] > w->t[best])
            best = i;
    return best;
}

/* What is at J is taken off where it is one sinusoid and no narrow mode; it is not looked at again,
 * either way. */
static void take(struct work *w, int j)
{
    double complex C[L * L], a[L];
    double gain, position;

    j = highest(w, j);
    if (!isnan(weigh(w, w->m, w->poles, j, &gain, C))) {
        position = summit(w, C, j, a, &gain);
        subtract(w, position, a, 1);
        if (is_sinusoid(w, j, gain))
            add(w, position, -1);
        else
            subtract(w, position, a, -1);
    }
    for (int i = j - NEAR; i <= j + NEAR; i++)
        if (i >= 0 && i < w->s.lines)
            w->closed[i] = true;
}

/* The strongest first: what it leaks over others is gone before they are judged. */
static void take_all(struct work *w, const struct bins *bins)
{
    int at, tries = 0;

    screen(w, bins);
    while (tries++ < 2 * AMBIENT_LINES_MOST && (at = strongest(w)) >= 0) {
        int found = w->tone_count;
        take(w, at);
        if (w->tone_count > found)
            screen(w, bins);
    }
}

/* ---- what a peak hides ---- */

/* The line about mode K that holds most by the factor C of its middle; the lines from *first to
 * *last are its peak and what is about it. */
static int largest_about(const struct work *w, const struct whittle_mode *q, double complex *C,
                         int *first, int *last)
{
    double complex f[L];
    double middle = fabs(cimag(q->lambda)) * w->s.samples / (2 * M_PI) - w->s.first, t, most = 0;
    double width = -creal(q->lambda) * w->s.samples / (2 * M_PI);
    int at = -1, j = (int)lround(middle), l = w->s.channels;

    *first = (int)fmax(j - width - ABOUT, 0), *last = (int)fmin(j + width + ABOUT, w->s.lines - 1);
    if (j < 0 || j >= w->s.lines || isnan(weigh(w, w->m, w->poles, j, &t, C)))
        return -1;
    for (int i = *first; i <= *last; i++) {
        memcpy(f, w->s.F + (size_t)i * l, sizeof *f * l);
        cblas_ztrsv(CblasColMajor, CblasLower, CblasNoTrans, CblasNonUnit, l, C, l, f, 1);
        t = cblas_dznrm2(l, f, 1);
        if (t > most)
            most = t, at = i;
    }
    return at;
}

/* The logarithm of the likelihood of lines from FIRST to LAST. */
static double likelihood_of(const struct work *w, const struct whittle *m, int first, int last)
{
    double complex C[L * L], poles[WHITTLE_MODES_MOST];
    double sum = 0, t;

    whittle_poles(m, poles);
    for (int j = first; j <= last; j++) {
        sum -= weigh(w, m, poles, j, &t, C);
        sum -= t;
    }
    return sum;
}

/* What a sinusoid beside mode Q may gain of the lines beyond its peak by the ends of the record,
 * (2), in one record of 1 / ALARM. */
static double price_of_ends(const struct work *w, const struct whittle_mode *q)
{
    return 2 * ABOUT / (-creal(q->lambda) * w->s.samples) * log(w->m->count / ALARM);
}

/* The largest line about mode K as a sinusoid, where the others, fitted without it, are likelier by
 * more than its price.  Chance is that of a record without one, whose mode is as wide as it was
 * fitted to all lines. */
static enum modal_status unmask(struct work *w, int k, const struct ambient_limits *limits,
                                struct whittle *room, struct modal_error *err)
{
    double complex C[L * L], a[L];
    double gain, before, position, price = w->price + price_of_ends(w, &w->m->mode[k]);
    int first, last, j = largest_about(w, &w->m->mode[k], C, &first, &last);
    enum modal_status rc;

    if (j < 0)
        return MODAL_OK;
    before = likelihood_of(w, w->m, first, last);
    position = summit(w, C, j, a, &gain);
    subtract(w, position, a, 1);
    *room = *w->m;
    rc = ambient_refit(&w->s, limits, room, err);
    if (rc == MODAL_OK && likelihood_of(w, room, first, last) - before > price) {
        add(w, position, -1);
        *w->m = *room;
        whittle_poles(w->m, w->poles);
    } else
        subtract(w, position, a, -1);
    return rc;
}

/* Peaks that are narrower than what is about a line hide it.  Where lines are gone the model is
 * fitted to what is left first: of one that has S of them the next trial's fit would gain what is
 * none of its sinusoid's. */
static enum modal_status unmask_all(struct work *w, const struct ambient_limits *limits,
                                    struct modal_error *err)
{
    struct whittle *room = malloc(sizeof *room);
    enum modal_status rc = room != NULL ? MODAL_OK
                                        : modal_fail(err, MODAL_NO_MEMORY, "identify: no memory "
                                                     "for a model of spectra");

    if (rc == MODAL_OK && w->tone_count > 0 && w->m->count > 0) {
        rc = ambient_refit(&w->s, limits, w->m, err);
        whittle_poles(w->m, w->poles);
    }
    for (int k = 0; rc == MODAL_OK && k < w->m->count; k++)
        if (-creal(w->m->mode[k].lambda) * w->s.samples < 2 * M_PI * ABOUT)
            rc = unmask(w, k, limits, room, err);
    free(room);
    return rc;
}

/* ---- the way ---- */

/* Frees W's own; the spectrum it looked at is the caller's. */
static void work_done(struct work *w)
{
    free(w->m), free(w->t), free(w->between), free(w->closed);
    free(w->s.F);
}

/* What a line was of the transform of the signals, each of unit variance. */
static struct known known_of(const struct ambient_tones_input *in, const struct ambient_line *line)
{
    const struct matrix *U = &in->pod->modes;
    struct known known = { line->frequency * in->Y->m, { 0 } };

    for (int j = 0; j < in->spectrum->channels; j++)
        for (int c = 0; c < in->Y->n; c++)
            /* z = Y u sqrt(N) / s; half of a cosine turns this way, over the root of N samples */
            known.amplitude[j] += line->z[c] * U->x[c + (size_t)j * U->ld] * in->Y->m
                / (2 * in->pod->s[j]);
    return known;
}

/* The model's poles, a copy of its lines, and the price of a line: Chernoff's bound of what the
 * largest of PLACES a line reaches by chance, in `x` and in `price`. */
static enum modal_status work_init(struct work *w, const struct ambient_tones_input *in,
                                   const struct ambient_line *line, int count,
                                   struct modal_error *err)
{
    const struct spectrum *s = in->spectrum;
    size_t n = (size_t)s->lines;

    *w = (struct work) { .s = *s, .m = malloc(sizeof *w->m), .known_count = count,
                         .x = log(PLACES * (double)n / ALARM),
                         .t = malloc(sizeof *w->t * n), .between = malloc(sizeof *w->between * n),
                         .closed = calloc(n, sizeof *w->closed) };
    w->price = s->channels + sqrt(2 * s->channels * w->x) + w->x;
    w->s.F = malloc(size_of(w));
    if (w->m == NULL || w->t == NULL || w->between == NULL || w->closed == NULL || w->s.F == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d lines", s->lines);
    restore(w, s->F);
    *w->m = *in->model;
    whittle_poles(w->m, w->poles);
    for (int k = 0; k < count; k++)
        w->known[k] = known_of(in, &line[k]);
    return MODAL_OK;
}

/* What was found leaves Y, and is among the lines. */
static enum modal_status move_lines(const struct work *w, struct matrix *Y,
                                    struct ambient_line *line, int *count, bool *changed,
                                    struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < w->tone_count; i++) {
        int k = w->tone[i].known;
        if (k >= 0)
            ambient_lines_put_back(Y, &line[k]);
        else if (*count < AMBIENT_LINES_MOST)
            k = (*count)++;
        else
            continue;
        rc = ambient_lines_take_at(Y, w->tone[i].cycles / Y->m, &line[k], err);
        *changed = true;
    }
    if (rc == MODAL_OK && *changed)
        ambient_lines_settle(Y);
    return rc;
}

enum modal_status ambient_tones_take(const struct ambient_tones_input *in,
                                     struct ambient_line *line, int *count, bool *changed,
                                     struct modal_error *err)
{
    struct ambient_limits limits = { 0, 0, in->cancelled, in->context, 0 };
    struct work w;
    enum modal_status rc = work_init(&w, in, line, *count, err);

    *changed = false;
    if (rc == MODAL_OK)
        rc = drop_pairs(&w, err);
    if (rc == MODAL_OK)
        rc = correct(&w, err);
    if (rc == MODAL_OK) {
        take_all(&w, in->bins);
        rc = unmask_all(&w, &limits, err);
    }
    if (rc == MODAL_OK)
        rc = move_lines(&w, in->Y, line, count, changed, err);
    work_done(&w);
    return rc;
}
