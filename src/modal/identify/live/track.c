/*
 * track.c - the modes of successive windows, one by one over time
 *
 * A track foresees its exponent lambda by its slope v, a line through what it was seen at,
 *
 *     lambda(t + D) = lambda + min(D, M) v,       covariance  e^{min(D, M) / M} F P F^T,     (1)
 *
 * F = [1 min(D, M); 0 1], for real and imaginary part apart: what is older than M = MEMORY windows
 * weighs e times less, and farther than M nothing is drawn out.  Or it stays where the likelier of
 * the two ways had it, v being 0; of 1 to 1 before it was seen again, and as often as it did so by
 * then.  Both ways are filters that go on side by side, each with a history of its own, so that
 * one window that is off does not cost a drift its slope; the line begins anew where it stays once
 * the odds are SUBSTANTIAL against it.  While v is not known its standard error is
 * w / T: a line that moves by more than w, half its width, within its window's duration T is none,
 *
 *     w = max(pi / T, |Re lambda|).                                                          (2)
 *
 * A mode with standard errors s at the distance n from there has, with S = P_lambda + s^2 and
 * d^2 = sum n^2 / S over the p = 2 parts (1 of a real exponent), the density
 *
 *     p(n) = (1 - ALARM) <t(d^2) / |S|^{1/2}> + ALARM N(n; S + w^2),                          (3)
 *     t(d^2) = Gamma(a + p/2) / Gamma(a) (2 pi b)^{-p/2} (1 + d^2 / (2 b))^{-(a + p/2)},     (4)
 *
 * <> the mean of the two ways, Gauss's with a precision that is Gamma distributed, a and b being
 * half the count and half the sum of the d^2 of the way's own history: a mode that drifts as no
 * line does makes its bars wider for itself.  They are never narrower than they say, b >= a, for
 * windows that share samples err alike.  That is b of the next window: a line that is off by its
 * slope is off by k times as much at the k-th, where b is a + k^2 (b - a). IDENTIFY_ALARM is the
 * false alarm: a settled mode that jumps within its line is the same one, and both ways begin anew
 * where it is.
 *
 * Against "the track was missed, and the mode is new" that is worth
 *
 *     ln p(n) + ln o - ln beta + ln(2 w pi / dt),                                            (5)
 *
 * beta new modes a window, at any frequency below pi / dt, their decay known to its size; o the
 * odds that the track shows: of (shown + 1) to (asked - shown + 1) where the last window showed it,
 * else of one to as many as have missed it, and one, by Laplace's rule of succession.  A shape u of
 * n + 1 channels says in addition, by x = 1 - |u^H u'|^2, which for one mode is x ~ Gamma(n),
 *
 *     -(a + n) (ln(1 + x / b) - ln(1 + n / a)),  in -SHAPE_SAY .. 0,                         (6)
 *
 * a, b again of its own history: modes whose shapes agree may be two, and a shape may change.  To b
 * comes what the errors S of the exponent say: where white noise is all there is, each part of the
 * shape is known to
 *
 *     T^2 S / 12                                                                             (7)
 *
 * of its square.  A mode without standard errors is anywhere within its line, or, as often, known
 * like those that its track has had: what is known of that, P, is a mean of M of them, so that one
 * has
 *
 *     s^2 = M P;                                                                             (8)
 *
 * by the line alone another track that was missed would take it as soon as its own.
 * What is worth most in sum is taken (assign.h).  A Kalman filter takes in what
 * came; of a window that shares samples with the one before D / T is new, and its variance there
 * T / D times as large.
 *
 * [J61] Jeffreys, Theory of Probability, 3rd edition, 1961, appendix B.
 */
#include "modal/identify/live/track.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/identify/live/assign.h"
#include "modal/identify/result.h"

static const double MEMORY = 4;             /* windows: as few as leave a line some freedom */
static const double SUBSTANTIAL = 3.1622776601683795;    /* odds, 10^(1/2), as [J61] grades them */
static const double SHAPE_SAY = 6.9;        /* one in 1,000 */
static const double PRIOR = 2;              /* a, b of nothing: (4) has a variance only above 1 */
static const double SHAPE_PRIOR = 0.02;     /* b of nothing in (6): noise at a seventh of a shape */
enum { COUNTED_MOST = 64 };                 /* windows of (5): then both counts are halved */
/* Windows that do not show a track that counts, after which it has died: one may be missed. */
enum { MISSED_DIES = 2 };

const char *const track_states[] = { "born", "died", "back" };

/* ---- shapes ---- */

void track_shape(const double complex *shape, int count, double complex out[TRACK_SHAPE])
{
    double norm = 0;

    memset(out, 0, sizeof *out * TRACK_SHAPE);
    for (int c = 0; c < count; c++) {
        /* a bit of c times a number without a pattern: no sum of neighbours that differ in sign */
        bool minus = count > TRACK_SHAPE && ((uint32_t)c * UINT32_C(0x9e3779b9)) >> 31;
        out[c % TRACK_SHAPE] += minus ? -shape[c] : shape[c];
    }
    for (int i = 0; i < TRACK_SHAPE; i++)
        norm = hypot(norm, cabs(out[i]));
    for (int i = 0; i < TRACK_SHAPE; i++)
        out[i] = norm > 0 && isfinite(norm) ? out[i] / norm : 0;
}

static double complex product(const double complex *a, const double complex *b)
{
    double complex sum = 0;

    for (int i = 0; i < TRACK_SHAPE; i++)
        sum += conj(a[i]) * b[i];
    return sum;
}

/* How far shapes are apart, 0..1; -1: one is not known. */
static double shape_distance(const double complex *a, const double complex *b)
{
    double complex p = product(a, b);

    if (creal(product(a, a)) == 0 || creal(product(b, b)) == 0)
        return -1;
    return fmax(0, 1 - creal(p * conj(p)));
}

static double shape_freedom(const double complex *shape)
{
    int components = 0;

    for (int i = 0; i < TRACK_SHAPE; i++)
        components += shape[i] != 0;
    return components - 1;
}

/* (6), (7) */
static double shape_says(const struct track *t, const struct track_mode *m, double turned2)
{
    double x = shape_distance(t->shape, m->shape), n = shape_freedom(t->shape);
    double a = t->shape_freedom, b = t->shape_misfit + a * turned2 / 12;

    if (x < 0 || n < 1)
        return 0;
    return fmax(-SHAPE_SAY, fmin(0, -(a + n) * (log1p(x / b) - log1p(n / a))));
}

/* ---- what is foreseen ---- */

/* A way at the end of a window. */
struct ahead {
    double complex exponent, slope;
    struct track_error re, im;
    double weight;                          /* of what is older: e^{-D / M} */
    double freedom, misfit;                 /* a, b of (4) */
    double ln_density;                      /* of (4) where d and ln S are 0 */
};
struct both_ways { struct ahead on, still; };

static double half_line(double complex lambda, double seconds)
{
    return fmax(M_PI / seconds, fabs(creal(lambda)));
}

static struct track_error error_ahead(struct track_error e, double by, double weight)
{
    return (struct track_error) { (e.value + 2 * by * e.both + by * by * e.slope) / weight,
                                  (e.both + by * e.slope) / weight, e.slope / weight };
}

static double duration(const struct track_window *w)
{
    return (double)(w->to + 1 - w->from) * w->dt;
}

/* Student's density: normal, its variance known as a gamma's */
static double ln_student(double a, double b, bool pair)
{
    double half = pair ? 1 : 0.5;

    return lgamma(a + half) - lgamma(a) - half * log(2 * M_PI * b);
}

/* (1) */
static struct both_ways foresee(const struct track *t, const struct track_window *w)
{
    /* no further ahead than is remembered */
    double memory = MEMORY * duration(w), by = fmin((double)(w->to - t->last) * w->dt, memory);
    double weight = exp(-by / memory), k = t->missed + 1;
    const struct track_way *line = &t->line, *still = &t->still;
    double misfit = line->freedom + k * k * (line->misfit - line->freedom);
    bool pair = cimag(still->exponent) != 0;

    return (struct both_ways) {
        { line->exponent + by * line->slope, line->slope, error_ahead(line->re, by, weight),
          error_ahead(line->im, by, weight), weight, line->freedom, misfit,
          ln_student(line->freedom, misfit, pair) },
        { still->exponent, 0, error_ahead(still->re, 0, weight), error_ahead(still->im, 0, weight),
          weight, still->freedom, still->misfit,
          ln_student(still->freedom, still->misfit, pair) },
    };
}

/* ---- what a pair is worth ---- */

static double variance(double std, double complex lambda, double line)
{
    /* no error: anywhere within its line; updates and batches agree to REFINE_TIED of |lambda| */
    return isfinite(std) ? fmax(std * std, pow(REFINE_TIED * cabs(lambda), 2)) : line * line;
}

/* What a mode is off by, and the variances of that. */
struct miss { double re, im, S_re, S_im, line; bool pair; };

static struct miss miss_of(const struct ahead *a, const struct track_mode *m, double seconds)
{
    double line = half_line(m->exponent, seconds);
    double complex off = m->exponent - a->exponent;

    return (struct miss) { creal(off), cimag(off),
                           a->re.value + variance(m->std_re, m->exponent, line),
                           a->im.value + variance(m->std_im, m->exponent, line), line,
                           cimag(m->exponent) != 0 };
}

/* d^2 */
static double distance2(const struct miss *x)
{
    return x->re * x->re / x->S_re + (x->pair ? x->im * x->im / x->S_im : 0);
}

/* ln of the first part of (3), the way that has the probability P */
static double ln_near(const struct ahead *way, const struct miss *x, double p)
{
    double half = x->pair ? 1 : 0.5;

    return way->ln_density - (way->freedom + half) * log1p(distance2(x) / (2 * way->misfit))
        - 0.5 * (log(x->S_re) + (x->pair ? log(x->S_im) : 0)) + log((1 - IDENTIFY_ALARM) * p);
}

static double ln_normal(double x, double variance)
{
    return -0.5 * (x * x / variance + log(2 * M_PI * variance));
}

/* ln of the second */
static double ln_far(const struct miss *x)
{
    double line2 = x->line * x->line;

    return log(IDENTIFY_ALARM) + ln_normal(x->re, x->S_re + line2)
        + (x->pair ? ln_normal(x->im, x->S_im + line2) : 0);
}

static double ln_sum(double a, double b)
{
    return fmax(a, b) + log1p(exp(-fabs(a - b)));  /* ln(e^a + e^b) without overflow */
}

/* ln o of (5) */
static double ln_odds(const struct track *t)
{
    return t->missed > 0 ? -log1p(t->missed) : log((t->shown + 1) / (t->asked - t->shown + 1));
}

/* ln p(n) of (3), and (6) */
static double ln_near_track(const struct track *t, const struct both_ways *a,
                            const struct track_mode *m, double seconds)
{
    struct miss on = miss_of(&a->on, m, seconds), still = miss_of(&a->still, m, seconds);

    return ln_sum(ln_sum(ln_near(&a->on, &on, 1 - t->stays), ln_near(&a->still, &still, t->stays)),
                  ln_far(&on))
        + shape_says(t, m, seconds * seconds * fmin(on.S_re, still.S_re));
}

/* M as it were if its errors, which it does not know, were (8). */
static struct track_mode as_others(const struct both_ways *a, const struct track_mode *m)
{
    struct track_mode like = *m;

    if (!isfinite(m->std_re))
        like.std_re = sqrt(MEMORY * a->still.re.value);
    if (!isfinite(m->std_im))
        like.std_im = sqrt(MEMORY * a->still.im.value);
    return like;
}

/* (5), (6); not above 0: they do not go together. */
static double worth(const struct tracks *all, const struct track *t, const struct both_ways *a,
                    const struct track_mode *m, const struct track_window *w)
{
    double seconds = duration(w), line = half_line(m->exponent, seconds), ln_p;
    bool pair = cimag(m->exponent) != 0;
    /* Jeffreys' prior: of none seen half a one */
    double ln_beta = log((all->born + 0.5) / (all->windows + 1));
    /* a mode that is new may be anywhere: its density is 1 over that */
    double ln_room = log(2 * line) + (pair ? log(M_PI / w->dt) : 0);

    if ((cimag(t->still.exponent) != 0) != pair)
        return -HUGE_VAL;
    ln_p = ln_near_track(t, a, m, seconds);
    if (!isfinite(m->std_re) || !isfinite(m->std_im)) {
        const struct track_mode like = as_others(a, m);
        ln_p = ln_sum(ln_p, ln_near_track(t, a, &like, seconds)) - M_LN2;
    }
    return ln_p + ln_room + ln_odds(t) - ln_beta;
}

/* ---- what came is taken in ---- */

/* Kalman's step: N, off what was foreseen with the variance E, seen with the variance R.  Of two
 * states, value and slope, the value is seen; what is left of the slope's variance is not a
 * difference of two that are nearly one where R is small, which may come out below 0. */
static double take_in(struct track_error *e, double n, double R, double *slope)
{
    double S = e->value + R, apart = fmax(0, e->value * e->slope - e->both * e->both);
    double gain = e->value / S, left = R / S;

    *slope += e->both / S * n;
    e->slope = apart / S + e->slope * left;
    e->both *= left;
    e->value *= left;
    return gain * n;
}

static void take_shape(struct track *t, const struct track_mode *m, double weight)
{
    double x = shape_distance(t->shape, m->shape), norm = 0;
    double complex p = product(m->shape, t->shape), turn = p != 0 ? p / cabs(p) : 1;

    if (x < 0) {
        memcpy(t->shape, m->shape, sizeof t->shape);
        return;
    }
    t->shape_freedom = weight * t->shape_freedom + (1 - weight) * PRIOR + shape_freedom(t->shape);
    t->shape_misfit = weight * t->shape_misfit + (1 - weight) * SHAPE_PRIOR + x;
    for (int i = 0; i < TRACK_SHAPE; i++) {
        t->shape[i] = weight * t->shape[i] + (1 - weight) * m->shape[i] * turn;
        norm = hypot(norm, cabs(t->shape[i]));
    }
    for (int i = 0; i < TRACK_SHAPE; i++)
        t->shape[i] /= norm;
}

/* At M, its slope known to SLOPE (a variance); what it was off by before, A and B, stays. */
static struct track_way way_at(const struct track_mode *m, double line, double slope, double a,
                               double b)
{
    struct track_way way = { m->exponent, 0, { variance(m->std_re, m->exponent, line), 0, slope },
                             { variance(m->std_im, m->exponent, line), 0, slope }, a, b };

    return way;
}

/* A way that was foreseen as AHEAD takes in M, off by X, whose samples are new to a share NEWLY. */
static void way_see(struct track_way *y, const struct ahead *ahead, const struct track_mode *m,
                    const struct miss *x, double newly)
{
    double slope_re = creal(ahead->slope), slope_im = cimag(ahead->slope), re, im;
    double next = y->misfit / ahead->misfit;              /* d^2 as it were of the next window */

    y->freedom = ahead->weight * y->freedom + (1 - ahead->weight) * PRIOR + (x->pair ? 1 : 0.5);
    y->misfit = ahead->weight * y->misfit + (1 - ahead->weight) * PRIOR
        + 0.5 * next * distance2(x);
    y->misfit = fmax(y->misfit, y->freedom);
    y->re = ahead->re, y->im = ahead->im;
    re = take_in(&y->re, x->re, variance(m->std_re, m->exponent, x->line) / newly, &slope_re);
    im = take_in(&y->im, x->im, variance(m->std_im, m->exponent, x->line) / newly, &slope_im);
    y->exponent = CMPLX(creal(ahead->exponent) + re, cimag(ahead->exponent) + im);
    y->slope = CMPLX(slope_re, slope_im);
}

/* The likelier way is where it stays; the line is that too where it is much the less likely. */
static void settle_ways(struct track *t, double p_still, double turn2)
{
    if (p_still > SUBSTANTIAL * (1 - p_still)) {
        t->line.exponent = t->still.exponent, t->line.slope = 0;
        t->line.re = (struct track_error) { t->still.re.value, 0, turn2 };
        t->line.im = (struct track_error) { t->still.im.value, 0, turn2 };
    }
    if (p_still < 0.5) {
        t->still.exponent = t->line.exponent;
        t->still.re.value = t->line.re.value, t->still.im.value = t->line.im.value;
    }
}

/* Both ways take in M. */
static void ways_see(struct track *t, const struct both_ways *ways, const struct track_mode *m,
                     const struct track_window *w)
{
    double seconds = duration(w), line = half_line(m->exponent, seconds);
    double turn2 = line * line / (seconds * seconds);
    double newly = fmin(1, (double)(w->to - t->last) * w->dt / seconds), p_still;
    struct miss on = miss_of(&ways->on, m, seconds), still = miss_of(&ways->still, m, seconds);
    double ln_on = ln_near(&ways->on, &on, 1 - t->stays);
    double ln_still = ln_near(&ways->still, &still, t->stays);

    if (ln_far(&on) > fmax(ln_on, ln_still)) {            /* it has jumped: nothing is known */
        t->line = way_at(m, line, turn2, t->line.freedom, t->line.misfit);
        t->still = way_at(m, line, 0, t->still.freedom, t->still.misfit);
        return;
    }
    p_still = exp(ln_still - ln_sum(ln_on, ln_still));
    t->stays += (p_still - t->stays) / (t->shown + 2);
    way_see(&t->line, &ways->on, m, &on, newly);
    way_see(&t->still, &ways->still, m, &still, newly);
    settle_ways(t, p_still, turn2);
}

static void track_see(struct track *t, const struct both_ways *ways, const struct track_mode *m,
                      const struct track_window *w)
{
    ways_see(t, ways, m, w);
    take_shape(t, m, ways->on.weight);
    if (t->missed > 0 && !t->counts)
        t->since = w->to;
    t->last = w->to, t->missed = 0;
}

static struct track track_begin(const struct track_mode *m, const struct track_window *w)
{
    double seconds = duration(w), line = half_line(m->exponent, seconds);
    struct track t = { .since = w->to, .last = w->to, .stays = 0.5,
                       .line = way_at(m, line, line * line / (seconds * seconds), PRIOR, PRIOR),
                       .still = way_at(m, line, 0, PRIOR, PRIOR),
                       .shape_freedom = PRIOR, .shape_misfit = SHAPE_PRIOR };

    memcpy(t.shape, m->shape, sizeof t.shape);
    return t;
}

/* ---- births and deaths ---- */

static void tell(const struct track *t, enum track_state state, struct track_edge *edges,
                 int *edge_count)
{
    edges[(*edge_count)++] = (struct track_edge) { t->number, state, t->still.exponent };
}

/* HIDDEN: where it was missed, what another track has may be its own: which of the two goes on,
 * only the next windows tell, and one mode has no two tracks that live. */
static void judge(struct track *t, const struct track_window *w, bool hidden,
                  struct track_edge *edges, int *edge_count)
{
    uint64_t length = w->to + 1 - w->from;

    if (t->missed == 0 && t->died) {
        t->died = false;
        tell(t, TRACK_BACK, edges, edge_count);
    } else if (t->missed == 0 && !t->counts && w->to - t->since >= length) {
        t->counts = true;
        if (!t->native)
            tell(t, TRACK_BORN, edges, edge_count);
    } else if (t->counts && !t->died && t->missed > 0
               && (hidden || (t->missed >= MISSED_DIES && w->to - t->last >= length))) {
        t->died = true;
        tell(t, TRACK_DIED, edges, edge_count);
    }
}

/* What does not count yet is forgotten as soon as it would have died. */
static bool is_over(const struct track *t, const struct track_window *w)
{
    return !t->counts && t->missed >= MISSED_DIES && w->to - t->last >= w->to + 1 - w->from;
}

static void forget_over(struct tracks *t, const struct track_window *w)
{
    int kept = 0;

    for (int i = 0; i < t->count; i++)
        if (!is_over(&t->track[i], w))
            t->track[kept++] = t->track[i];
    t->count = kept;
}

/* The one that was seen longest ago makes room. */
static void make_room(struct tracks *t)
{
    int oldest = 0;

    for (int i = 1; i < t->count; i++)
        if (t->track[i].last < t->track[oldest].last)
            oldest = i;
    t->track[oldest] = t->track[--t->count];
}

static void add_track(struct tracks *t, const struct track_mode *m, const struct track_window *w,
                      int64_t *number)
{
    if (t->count == TRACKS_MOST)
        make_room(t);
    t->track[t->count] = track_begin(m, w);
    t->track[t->count].native = w->to == t->first_to;
    t->track[t->count].shown = t->track[t->count].asked = 1;
    *number = t->track[t->count++].number = t->next++;
}

/* ---- a window ---- */

static void halve(double *a, double *b)
{
    if (*b > COUNTED_MOST)
        *a /= 2, *b /= 2;
}

/* Each track that there is with its mode, if it has one. */
static void see_all(struct tracks *t, const struct both_ways *ahead,
                    const struct track_mode *modes,
                    int count, const int *column, const struct track_window *w, int64_t *number)
{
    for (int i = 0; i < t->count; i++) {
        t->track[i].missed++;
        t->track[i].asked++;
    }
    for (int j = 0; j < count; j++) {
        struct track *own = column[j] >= 0 ? &t->track[column[j]] : NULL;
        if (own == NULL)
            continue;
        own->missed--;
        track_see(own, &ahead[column[j]], &modes[j], w);
        own->shown++;
        number[j] = own->number;
    }
    for (int i = 0; i < t->count; i++)
        halve(&t->track[i].shown, &t->track[i].asked);
}

static void begin_anew(struct tracks *t, const struct track_window *w)
{
    *t = (struct tracks) { .next = t->next, .epoch = w->epoch, .first_to = w->to, .begun = true };
}

/* HIDDEN: of a track that has no mode, whether one that another has would go with it too. */
static enum modal_status assign(struct tracks *t, const struct track_window *w,
                                const struct track_mode *modes, int count, struct both_ways *ahead,
                                int *column, bool *hidden, struct modal_error *err)
{
    size_t n = (size_t)t->count;
    double *value = calloc((size_t)count * n + 1, sizeof *value);
    enum modal_status rc;

    if (value == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "track: no memory for %d modes", count);
    for (size_t i = 0; i < n; i++) {
        ahead[i] = foresee(&t->track[i], w);
        for (size_t j = 0; j < (size_t)count; j++)
            value[j * n + i] = worth(t, &t->track[i], &ahead[i], &modes[j], w);
    }
    rc = assign_best(value, count, t->count, column, err);
    for (size_t i = 0; i < n && rc == MODAL_OK; i++)
        for (size_t j = 0; j < (size_t)count; j++)
            hidden[i] |= column[j] >= 0 && value[j * n + i] > 0;
    free(value);
    return rc;
}

enum modal_status tracks_follow(struct tracks *t, const struct track_window *w,
                                const struct track_mode *modes, int count, int64_t *number,
                                struct track_edge *edges, int *edge_count, struct modal_error *err)
{
    struct both_ways ahead[TRACKS_MOST];
    int column[TRACKS_MOST];
    bool hidden[TRACKS_MOST] = { false };
    bool anew = !t->begun || w->epoch != t->epoch || w->to <= t->to;
    enum modal_status rc = MODAL_OK;

    *edge_count = 0;
    if (count > TRACKS_MOST)
        return modal_fail(err, MODAL_BAD_INPUT, "track: %d modes; accepted: at most %d", count,
                          TRACKS_MOST);
    for (int j = 0; j < count; j++) {
        column[j] = -1;
        if (!isfinite(creal(modes[j].exponent)) || !(cimag(modes[j].exponent) >= 0))
            return modal_fail(err, MODAL_BAD_INPUT, "track: mode %d has no exponent", j);
    }
    if (!anew)
        rc = assign(t, w, modes, count, ahead, column, hidden, err);
    if (rc != MODAL_OK)
        return rc;
    if (anew)
        begin_anew(t, w);
    see_all(t, ahead, modes, count, column, w, number);
    t->to = w->to;
    t->windows += !anew;
    for (int i = 0; i < t->count; i++)
        judge(&t->track[i], w, hidden[i], edges, edge_count);
    forget_over(t, w);
    for (int j = 0; j < count; j++)
        if (column[j] < 0) {
            add_track(t, &modes[j], w, &number[j]);
            t->born += !anew;
        }
    halve(&t->born, &t->windows);
    return MODAL_OK;
}
