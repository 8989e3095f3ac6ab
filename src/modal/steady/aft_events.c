/*
 * aft_events.c - see aft_events.h
 *
 * A relative displacement is d(theta) = Re sum_{k=0..H} D_k e^{i k theta}.  A law that says where
 * its regime changes (pieces.h) has on each piece s a force that is a polynomial in d and v; with
 * the mask of s,
 *
 *     m_s = (1 / 2 pi) int_s e^{-i m theta} d theta = i (e^{-i m b} - e^{-i m a}) / (2 pi m),   (1)
 *
 * its harmonics are finite convolutions of masks and D, exact to rounding: no sampling, no
 * aliasing.  With g(theta) = sum_m G_m e^{i m theta} a gain, the harmonics of g d are
 *
 *     F_k = sum_{l=1..H} (G_{k-l} D_l + G_{k+l} conj D_l) + 2 G_k D_0,   k >= 1                 (2)
 *     F_0 = G_0 D_0 + Re sum_l conj(G_l) D_l
 */
#include "modal/steady/aft_events.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"

enum { DIRECT = 4 };     /* multiplications of (2) that two transforms cost, a sample */
/* A force so much smaller than its level has lost three digits to its spring: samples lose more. */
static const double CANCELLED = 1e-3;

/* One event's. */
double complex aft_rotation(double theta) { return CMPLX(cos(theta), -sin(theta)); }

typedef double pair __attribute__((vector_size(2 * sizeof(double))));      /* a complex number */

/* x as a vector of two: no unaligned access is assumed. */
static pair load(const double complex *x)
{
    pair p;

    memcpy(&p, x, sizeof p);
    return p;
}

/* And back. */
static void store(pair p, double complex *x) { memcpy(x, &p, sizeof p); }

/* e[m] = z^m, m = 0 .. most, |z| = 1: doubled from what there is, so that rounding grows with log m
 * alone. */
void aft_rotations(double complex z, int most, double complex *e)
{
    e[0] = 1;
    for (int m = 1; m <= most; m *= 2) {
        double complex by = m == 1 ? z : numbers_times(e[m / 2], e[m / 2]);
        int count = m <= most - m + 1 ? m : most - m + 1;
        pair re = { creal(by), creal(by) }, im = { -cimag(by), cimag(by) };

#pragma GCC unroll 4
        for (int i = 0; i < count; i++) {
            pair x = load(e + i);

            store(x * re + (pair) { x[1], x[0] } * im, e + m + i);  /* e[m + i] = z^m z^i */
        }
    }
}

/* (1) for m = 0 .. most into w->mask, of the rotations at both ends. */
void aft_mask(struct aft *w, double length, int most)
{
    w->mask[0] = length / TWO_PI;                       /* (1) as m goes to 0 */
    for (int m = 1; m <= most; m++)
        w->mask[m] = CMPLX(-(cimag(w->after[m]) - cimag(w->before[m])),
                           creal(w->after[m]) - creal(w->before[m]))
                     * w->inverse[m];
}

/* (2): F_k += of gain G (known to m = K + H) times motion D (0 .. H), k = 0 .. K. */
static void convolve_add(struct aft *w, const double complex *G, const double complex *D, int H,
                         int K, double complex *F)
{
    const pair back = { -1, 1 };
    double F0 = creal(G[0]) * creal(D[0]);

    w->summed += (double)H * K;

    for (int l = 1; l <= H; l++)                        /* (2), F_0 */
        F0 += creal(G[l]) * creal(D[l]) + cimag(G[l]) * cimag(D[l]);
    F[0] += F0;
    for (int k = 1; k <= K; k++) {
        /* Re D_l and Im D_l times pairs (Re, Im) */
        pair by_re = load(G + k) * (2 * creal(D[0])), by_im = { 0, 0 };
        int low = k < H ? k : H;

        for (int l = 1; l <= low; l++) {
            pair p = load(G + k - l), m = load(G + k + l);

            by_re += (p + m) * creal(D[l]);
            by_im += (p - m) * cimag(D[l]);
        }
        for (int l = low + 1; l <= H; l++) {            /* G_{k-l} = conj G_{l-k} */
            pair p = load(G + l - k) * -back, m = load(G + k + l);

            by_re += (p + m) * creal(D[l]);
            by_im += (p - m) * cimag(D[l]);
        }
        by_re += (pair) { by_im[1], by_im[0] } * back;  /* i times it */
        F[k] += CMPLX(by_re[0], by_re[1]);
    }
}

/* V_k = i k omega D_k. */
static void rate_of(const double complex *D, int H, double omega, double complex *V)
{
    for (int k = 0; k <= H; k++)
        V[k] = I * (k * omega) * D[k];                  /* d/dt */
}

/* A wave under construction: sum of weight e^{-i m theta} over events, m = 1 .. most, and its mean;
 * not `any`: it is 0. */
struct event_sum { double complex *wave; int most; double mean; bool any; };

/* Level, damp, cross, and a gain for each input. */
enum { SUMS = 3 + LAW_PIECE_INPUTS };

/* What a piece weighs in each of the sums. */
static void event_weights(const struct law_piece *piece, double weight[SUMS])
{
    weight[0] = piece->level;
    weight[1] = piece->damp;
    weight[2] = piece->cross;
    for (int j = 0; j < LAW_PIECE_INPUTS; j++)
        weight[3 + j] = piece->gain[j];
}

/* y += a x, from 1 on */
static void add_scaled(int most, double a, const double complex *x, double complex *y)
{
    pair by = { a, a };

#pragma GCC unroll 4
    for (int m = 1; m <= most; m++)
        store(load(y + m) + by * load(x + m), y + m);
}

/* An event where weights change by AFTER - BEFORE (NULL: nothing before, or after): e^{-i theta} is
 * z. */
static void add_event(struct aft *w, double complex z, const double *before, const double *after,
                      struct event_sum sum[SUMS])
{
    double change[SUMS];
    int most = 0;

    for (int i = 0; i < SUMS; i++) {
        /* of the weight, downwards */
        change[i] = (before != NULL ? before[i] : 0) - (after != NULL ? after[i] : 0);
        most = change[i] != 0 && sum[i].most > most ? sum[i].most : most;
    }
    if (most > 0)
        aft_rotations(z, most, w->after);
    for (int i = 0; i < SUMS; i++)
        if (change[i] != 0)
            add_scaled(sum[i].most, change[i], w->after, sum[i].wave);
}

/* Sums of (1): i / (2 pi m) times what the events left, and the mean. */
static void end_sums(const struct aft *w, struct event_sum sum[SUMS])
{
    for (int i = 0; i < SUMS; i++) {
        if (!sum[i].any)
            continue;
        sum[i].wave[0] = sum[i].mean;                   /* m = 0 of (1) */
        for (int m = 1; m <= sum[i].most; m++)
            sum[i].wave[m] = CMPLX(-cimag(sum[i].wave[m]) * w->inverse[m],
                                   creal(sum[i].wave[m]) * w->inverse[m]);
    }
}

/* What the pieces of output i weigh: pieces follow each other, so that one's end is mostly the next
 * one's beginning. */
static void sum_pieces(struct aft *w, struct aft_law *a, int output, struct event_sum sum[SUMS])
{
    double weight[2][SUMS], *before = NULL, at = NAN;
    double complex z = 1;

    for (int s = 0; s < a->pieces.count; s++) {
        const struct law_piece *piece = &a->pieces.piece[s];
        double *now = before == weight[0] ? weight[1] : weight[0];

        if (piece->output != output)
            continue;
        event_weights(piece, now);
        for (int i = 0; i < SUMS; i++) {
            sum[i].any |= now[i] != 0;
            sum[i].mean += now[i] * (piece->to - piece->from) / TWO_PI;
        }
        /* A gap between pieces, where the force is 0: the last one ends by itself. */
        if (before != NULL && piece->from != at)
            add_event(w, z, before, NULL, sum);
        a->ends[2 * s] = before != NULL && piece->from == at ? z : aft_rotation(piece->from);
        add_event(w, a->ends[2 * s], piece->from == at ? before : NULL, now, sum);
        a->ends[2 * s + 1] = z = aft_rotation(piece->to);
        at = piece->to;
        before = now;
    }
    if (before != NULL)
        add_event(w, z, before, NULL, sum);
    end_sums(w, sum);
}

/* Which waves the pieces have; those and the last evaluation's are cleared, the others are 0
 * (cross_gains adds to gain and damp). */
static void clear_waves(struct aft_law *a, size_t inputs, size_t stride, size_t longest)
{
    bool level = a->levels, gain = a->gains || a->crosses, damp = a->damps || a->crosses,
         cross = a->crosses;

    a->levels = a->gains = a->damps = a->crosses = false;
    for (int s = 0; s < a->pieces.count; s++) {
        const struct law_piece *piece = &a->pieces.piece[s];

        a->levels |= piece->level != 0;
        a->damps |= piece->damp != 0;
        a->crosses |= piece->cross != 0;
        for (size_t j = 0; j < inputs; j++)
            a->gains |= piece->gain[j] != 0;
    }
    if (level || a->levels)
        memset(a->level, 0, inputs * stride * sizeof *a->level);
    if (gain || a->gains)
        memset(a->gain, 0, inputs * inputs * stride * sizeof *a->gain);
    if (damp || a->damps)
        memset(a->damp, 0, inputs * inputs * stride * sizeof *a->damp);
    if (cross || a->crosses)
        memset(a->cross, 0, longest * sizeof *a->cross);
}

/* The pieces as waves: level to m = H, gain and damp to 2H, cross to 3H. */
void aft_waves(struct aft *w, struct aft_law *a)
{
    int H = w->H, inputs = a->law->kind->inputs;
    size_t stride = 2 * (size_t)H + 1;

    clear_waves(a, (size_t)inputs, stride, 3 * (size_t)H + 1);
    for (int i = 0; i < inputs; i++) {
        struct event_sum sum[SUMS] = { { a->level + (size_t)i * stride, H, 0, false },
                                       { a->damp + (size_t)(i * inputs) * stride, 2 * H, 0, false },
                                       { a->cross, 3 * H, 0, false } };

        for (int j = 0; j < inputs; j++)
            sum[3 + j] =
                (struct event_sum){ a->gain + (size_t)(i * inputs + j) * stride, 2 * H, 0, false };
        sum_pieces(w, a, i, sum);
    }
}

/* The same of cross, by way of samples: to 3H, times d v to 2H, and of N > 6H none of that falls on
 * 0 .. H. */
static void sampled_cross_add(struct aft *w, const struct aft_law *a, double complex *F)
{
    int H = w->H;

    for (int m = 0; m <= 3 * H; m++)
        w->wave[m] = (m > 0 ? 2 : 1) * a->cross[m];
    orbit_synthesize(w->grid, 3 * H, w->wave, 0, w->samples);
    for (int n = 0; n < w->N; n++)
        w->samples[n] *= w->omega * a->in[0].d[n] * a->in[0].v[n];
    orbit_analyze(w->grid, w->samples, H, w->wave);
    for (int k = 0; k <= H; k++)
        F[k] += w->wave[k];
}

/* F += harmonics of cross d v, d v = (d^2)' / 2: laws of one input. */
static void cross_force(struct aft *w, const struct aft_law *a, double complex *F,
                        double complex *work)
{
    int H = w->H;
    double complex *two = w->product;

    for (int m = 0; m <= H; m++)
        two[m] = m > 0 ? a->in[0].D[m] / 2 : a->in[0].D[0];
    for (int m = H + 1; m <= 3 * H; m++)
        two[m] = 0;
    memset(work, 0, (2 * (size_t)H + 1) * sizeof *work);
    convolve_add(w, two, a->in[0].D, H, 2 * H, work);   /* d^2 */
    for (int m = 0; m <= 2 * H; m++)
        work[m] *= I * (m * w->omega / 2);              /* (d^2)' / 2 */
    convolve_add(w, a->cross, work, 2 * H, H, F);       /* times the mask of cross */
}

/* (2), of a gain to m = 2H and a motion whose N samples are D, by way of samples: products reach
 * 3H, and of N > 4H samples none of that falls on 0 .. H. */
static void sampled_product_add(struct aft *w, const double complex *gain, const double *d,
                                double scale, double complex *F)
{
    int H = w->H;

    for (int m = 0; m <= 2 * H; m++)
        w->wave[m] = (m > 0 ? 2 : 1) * gain[m];
    orbit_synthesize(w->grid, 2 * H, w->wave, 0, w->samples);
    for (int n = 0; n < w->N; n++)
        w->samples[n] *= scale * d[n];                  /* the product, in time */
    orbit_analyze(w->grid, w->samples, H, w->wave);
    for (int k = 0; k <= H; k++)
        F[k] += w->wave[k];
}

/* Whether N samples carry a gain times a motion of TOP harmonics, and are the shorter way. */
static bool product_pays(const struct aft *w, int top)
{
    return w->N > 4 * w->H && w->H * top > DIRECT * w->N;
}

/* The same of cross d v, of 2 H by 2 H. */
static bool cross_pays(const struct aft *w)
{
    return w->N > 6 * w->H && (2L * w->H) * (2L * w->H) > DIRECT * w->N;
}

bool aft_analyzes(const struct aft *w)
{
    bool any = product_pays(w, w->H) || cross_pays(w);

    for (int l = 0; l < w->laws; l++)
        any |= !w->law[l].exact;
    return any;
}

/* Whether the way by samples is shorter than (2) for input j, and as good: stiff springs leave a
 * force far smaller than its terms. */
static bool by_samples(const struct aft *w, const struct aft_law *a, int j)
{
    return !a->stiff && product_pays(w, a->in[j].top);
}

/* Gain and damp times the motion, each the shorter way. */
static void gain_force(struct aft *w, const struct aft_law *a, int i, double complex *F,
                       double complex *work)
{
    int H = w->H, inputs = a->law->kind->inputs;
    size_t stride = 2 * (size_t)H + 1;

    for (int j = 0; a->gains && j < inputs; j++)
        if (by_samples(w, a, j))
            sampled_product_add(w, a->gain + (size_t)(i * inputs + j) * stride, a->in[j].d, 1, F);
        else
            convolve_add(w, a->gain + (size_t)(i * inputs + j) * stride, a->in[j].D, a->in[j].top,
                         H, F);
    if (a->damps && by_samples(w, a, 0))
        sampled_product_add(w, a->damp + (size_t)(i * inputs) * stride, a->in[0].v, w->omega, F);
    else if (a->damps) {
        rate_of(a->in[0].D, H, w->omega, work);
        convolve_add(w, a->damp + (size_t)(i * inputs) * stride, work, H, H, F);
    }
}

/* The largest |Re| + |Im|: as good as |.| to compare by. */
static double largest(const double complex *X, int K)
{
    double most = 0;

    for (int k = 0; k < K; k++) {
        double size = fabs(creal(X[k])) + fabs(cimag(X[k]));

        most = size > most ? size : most;
    }
    return most;
}

/* Harmonics of output i of the pieces into F. */
void aft_waves_force(struct aft *w, struct aft_law *a, int i, double complex *F,
                     double complex *work)
{
    int H = w->H;
    const double complex *level = a->level + (size_t)i * (2 * (size_t)H + 1);

    for (int k = 0; k <= H; k++)
        F[k] = (k > 0 ? 2 : 1) * level[k];              /* two-sided to one-sided */
    gain_force(w, a, i, F, work);
    /* The sum lost digits: this law is too stiff for samples, from now on. */
    if (by_samples(w, a, 0) && largest(F, H + 1) < CANCELLED * largest(level, H + 1)) {
        a->stiff = true;
        aft_waves_force(w, a, i, F, work);
        return;
    }
    if (a->crosses && !a->stiff && cross_pays(w))
        sampled_cross_add(w, a, F);
    else if (a->crosses)
        cross_force(w, a, F, work);
}

/* Of the pieces' derivative: cross adds its v to df/dd and its d to df/dv. */
void aft_cross_gains(struct aft *w, struct aft_law *a, double complex *work)
{
    int H = w->H;
    size_t stride = 2 * (size_t)H + 1;

    if (!a->crosses)                                    /* no damping times displacement */
        return;
    memset(w->product, 0, stride * sizeof *w->product);
    convolve_add(w, a->cross, a->in[0].D, H, 2 * H, w->product);
    for (int m = 0; m <= 2 * H; m++)
        a->damp[m] += w->product[m] / (m > 0 ? 2 : 1);  /* d(cross d v)/dv = cross d */
    rate_of(a->in[0].D, H, w->omega, work);
    memset(w->product, 0, stride * sizeof *w->product);
    convolve_add(w, a->cross, work, H, 2 * H, w->product);
    for (int m = 0; m <= 2 * H; m++)
        a->gain[m] += w->product[m] / (m > 0 ? 2 : 1);  /* d(cross d v)/dd = cross v */
}

enum modal_status aft_find_pieces(struct aft *w, struct aft_law *a, struct modal_error *err)
{
    const struct orbit *input[LAW_PIECE_INPUTS] = { &a->in[0], &a->in[1] };
    enum modal_status rc = MODAL_OK;

    pieces_clear(&a->pieces);
    for (int j = 0; rc == MODAL_OK && j < a->law->kind->inputs; j++)
        rc = orbit_find_turns(&a->in[j], err);
    if (rc == MODAL_OK)
        rc = a->law->kind->pieces(a->law, input, &a->pieces, err);
    a->acts = a->pieces.acts;
    a->undetermined = a->pieces.undetermined;
    a->evaluations += w->N;                             /* what sampling it would have cost */
    if (rc == MODAL_OK && a->ends_room < a->pieces.count) {
        double complex *more = realloc(a->ends, 2 * (size_t)a->pieces.room * sizeof *more);

        if (more == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for %d pieces",
                              a->pieces.count);
        a->ends = more;
        a->ends_room = a->pieces.room;
    }
    return rc;
}
