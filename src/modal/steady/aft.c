/*
 * aft.c - local nonlinear forces, from harmonics to harmonics through time
 *
 * A relative displacement is d(theta) = Re sum_{k=0..H} D_k e^{i k theta}.  A law that says where its regime changes
 * (pieces.h) has on each piece s a force that is a polynomial in d and v; with the mask of s,
 *
 *     m_s = (1 / 2 pi) int_s e^{-i m theta} d theta = i (e^{-i m b} - e^{-i m a}) / (2 pi m),           (1)
 *
 * its harmonics are finite convolutions of masks and D, exact to rounding: no sampling, no aliasing.  With g(theta) =
 * sum_m G_m e^{i m theta} a gain, the harmonics of g d are
 *
 *     F_k = sum_{l=1..H} (G_{k-l} D_l + G_{k+l} conj D_l) + 2 G_k D_0,   k >= 1                          (2)
 *     F_0 = G_0 D_0 + Re sum_l conj(G_l) D_l
 *
 * and the derivative of the force is (2) again, applied to delta D, with the levels' own changes (pieces.h, (2)): for
 * each stuck phase one product of its mask with the motion where it began.  Rigid friction jumps at turns theta_b, which
 * move: delta F_k = -(jump / pi) e^{-i k theta_b} delta theta_b.                                         (3)
 *
 * Other laws are sampled as in [CG89] (their section 3.1): f at theta_j = 2 pi j / N and back by a discrete transform;
 * a polynomial of degree p is exact once N > (p + 1) H.  Gains g are df/dd and df/dv at the samples.  Their
 * gains' harmonics have period N, so that (2) is the exact derivative of what is sampled, aliasing and all.  A law with memory is
 * marched until its memory repeats: twice around for sliders (their map over a period is one clip), up to SWEEPS_MOST
 * times for others.
 *
 * [CG89] Cameron and Griffin, J. Appl. Mech. 56 (1989) 149-154.
 */
#include "modal/steady/aft.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SWEEPS_MOST = 12, DIRECT = 4 };     /* DIRECT: multiplications of (2) that two transforms cost, a sample */
static const double TWO_PI = 6.283185307179586477, SWEEP_TOLERANCE = 1e-12, CANCELLED = 1e-3;

struct aft_law {
    const struct law *law;
    int place[LAW_INPUTS_MOST], to[LAW_INPUTS_MOST];
    struct orbit in[LAW_INPUTS_MOST];
    struct law_pieces pieces;
    bool exact, acts, undetermined, stiff;
    long evaluations;
    int memory;
    double *f, *fd, *fv;                    /* samples: [i][N], [i][j][N] */
    double *z;                              /* memory, twice */
    double complex *F;                      /* [i][H+1] */
    double complex *gain, *damp;            /* [i][j][2H+1], two-sided m >= 0 */
    double complex *level, *cross;          /* pieces': [i][2H+1], [3H+1] */
    bool levels, gains, damps, crosses;     /* which of them are not 0 throughout */
    double complex *ends;                   /* e^{-i theta} where piece s begins, [2 s], and ends */
    int ends_room;
};

struct aft {
    int q, H, N, laws, room, HJ;          /* HJ: of derivatives */
    bool located;
    double omega;
    struct orbit_grid *grid;
    struct aft_law *law;
    double complex *mask, *wave, *product;  /* `room` each */
    double complex *before, *after;         /* e^{-i m theta} where a piece begins and ends, `room` each */
    double *block, *samples;                /* (2H+1)^2; N */
    double *inverse;                        /* 1 / (2 pi m) */
};

static void law_free(struct aft_law *a)
{
    for (int j = 0; j < LAW_INPUTS_MOST; j++)
        orbit_done(&a->in[j]);
    pieces_done(&a->pieces);
    free(a->f);
    free(a->fd);
    free(a->fv);
    free(a->z);
    free(a->F);
    free(a->gain);
    free(a->damp);
    free(a->level);
    free(a->cross);
    free(a->ends);
}

void aft_free(struct aft *w)
{
    if (w == NULL)
        return;
    for (int i = 0; w->law != NULL && i < w->laws; i++)
        law_free(&w->law[i]);
    free(w->law);
    free(w->mask);
    free(w->wave);
    free(w->product);
    free(w->before);
    free(w->after);
    free(w->block);
    free(w->samples);
    free(w->inverse);
    orbit_grid_free(w->grid);
    free(w);
}

static enum modal_status law_init(struct aft *w, struct aft_law *a, const struct law *law, const int *place,
                                  struct modal_error *err)
{
    int inputs = law->kind->inputs;
    size_t N = (size_t)w->N, n = (size_t)inputs, H = (size_t)w->H;
    enum modal_status rc = MODAL_OK;

    a->law = law;
    a->exact = w->located && law->kind->pieces != NULL;
    a->memory = law->memory;
    for (int j = 0; rc == MODAL_OK && j < inputs; j++) {
        a->place[j] = law->dof[j] >= 0 ? place[law->dof[j]] : -1;
        a->to[j] = law->to[j] >= 0 ? place[law->to[j]] : -1;
        rc = orbit_init(&a->in[j], w->H, w->N, err);
    }
    if (rc != MODAL_OK)
        return rc;
    a->F = calloc(n * (H + 1), sizeof *a->F);
    a->gain = calloc(n * n * (2 * H + 1), sizeof *a->gain);
    a->damp = calloc(n * n * (2 * H + 1), sizeof *a->damp);
    a->level = calloc(n * (2 * H + 1), sizeof *a->level);
    a->cross = calloc(3 * H + 1, sizeof *a->cross);
    a->z = calloc(2 * (size_t)a->memory + 1, sizeof *a->z);
    if (!a->exact) {
        a->f = calloc(n * N, sizeof *a->f);
        a->fd = calloc(n * n * N, sizeof *a->fd);
        a->fv = calloc(n * n * N, sizeof *a->fv);
    }
    if (a->F == NULL || a->gain == NULL || a->damp == NULL || a->level == NULL || a->cross == NULL || a->z == NULL
        || (!a->exact && (a->f == NULL || a->fd == NULL || a->fv == NULL)))
        return modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for a law at %d harmonics, %d samples", w->H, w->N);
    return MODAL_OK;
}

enum modal_status aft_new(const struct program *p, const int *place, int q, int H, int N, bool located, struct aft **out,
                          struct modal_error *err)
{
    struct aft *w = calloc(1, sizeof *w);
    enum modal_status rc = MODAL_OK;

    if (w == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "aft: no memory");
    *w = (struct aft) { .q = q, .H = H, .HJ = H, .N = N, .located = located, .laws = p->laws };
    w->room = 8 * H + 8 > N ? 8 * H + 8 : N;
    w->law = calloc((size_t)p->laws + 1, sizeof *w->law);
    w->mask = calloc((size_t)w->room, sizeof *w->mask);
    w->wave = calloc((size_t)w->room, sizeof *w->wave);
    w->product = calloc((size_t)w->room, sizeof *w->product);
    w->before = calloc((size_t)w->room, sizeof *w->before);
    w->after = calloc((size_t)w->room, sizeof *w->after);
    w->samples = calloc((size_t)N, sizeof *w->samples);
    w->inverse = calloc((size_t)w->room, sizeof *w->inverse);
    if (w->law == NULL || w->mask == NULL || w->wave == NULL || w->product == NULL || w->before == NULL || w->after == NULL || w->samples == NULL
        || w->inverse == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for %d harmonics", H);
    for (int m = 1; rc == MODAL_OK && m < w->room; m++)
        w->inverse[m] = 1 / (TWO_PI * m);
    if (rc == MODAL_OK)
        rc = orbit_grid_new(N, &w->grid, err);
    for (int i = 0; rc == MODAL_OK && i < p->laws; i++)
        rc = law_init(w, &w->law[i], &p->law[i], place, err);
    if (rc != MODAL_OK) {
        aft_free(w);
        return rc;
    }
    *out = w;
    return MODAL_OK;
}

static double complex times(double complex a, double complex b)      /* of finite numbers */
{
    return CMPLX(creal(a) * creal(b) - cimag(a) * cimag(b), creal(a) * cimag(b) + cimag(a) * creal(b));
}

static double complex rotation(double theta) { return CMPLX(cos(theta), -sin(theta)); }

typedef double pair __attribute__((vector_size(2 * sizeof(double))));      /* a complex number */

static pair load(const double complex *x)
{
    pair p;

    memcpy(&p, x, sizeof p);
    return p;
}

static void store(pair p, double complex *x) { memcpy(x, &p, sizeof p); }

/* e[m] = z^m, m = 0 .. most, |z| = 1: doubled from what there is, so that rounding grows with log m alone. */
static void rotations(double complex z, int most, double complex *e)
{
    e[0] = 1;
    for (int m = 1; m <= most; m *= 2) {
        double complex by = m == 1 ? z : times(e[m / 2], e[m / 2]);
        int count = m <= most - m + 1 ? m : most - m + 1;
        pair re = { creal(by), creal(by) }, im = { -cimag(by), cimag(by) };

#pragma GCC unroll 4
        for (int i = 0; i < count; i++) {
            pair x = load(e + i);

            store(x * re + (pair) { x[1], x[0] } * im, e + m + i);
        }
    }
}

/* (1) for m = 0 .. most into w->mask, of the rotations at both ends. */
static void mask_of(struct aft *w, double length, int most)
{
    w->mask[0] = length / TWO_PI;
    for (int m = 1; m <= most; m++)
        w->mask[m] = CMPLX(-(cimag(w->after[m]) - cimag(w->before[m])), creal(w->after[m]) - creal(w->before[m])) * w->inverse[m];
}

/* (2): F_k += of gain G (known to m = K + H) times motion D (0 .. H), k = 0 .. K. */
static void convolve_add(const double complex *G, const double complex *D, int H, int K, double complex *F)
{
    double F0 = creal(G[0]) * creal(D[0]);

    for (int l = 1; l <= H; l++)
        F0 += creal(G[l]) * creal(D[l]) + cimag(G[l]) * cimag(D[l]);
    F[0] += F0;
    for (int k = 1; k <= K; k++) {
        double re = 2 * creal(G[k]) * creal(D[0]), im = 2 * cimag(G[k]) * creal(D[0]);

        int low = k < H ? k : H;

        for (int l = 1; l <= low; l++) {
            double pr = creal(G[k - l]), pi = cimag(G[k - l]), mr = creal(G[k + l]), mi = cimag(G[k + l]);
            double Dr = creal(D[l]), Di = cimag(D[l]);

            re += (pr + mr) * Dr + (mi - pi) * Di;
            im += (pi + mi) * Dr + (pr - mr) * Di;
        }
        for (int l = low + 1; l <= H; l++) {                       /* G_{k-l} = conj G_{l-k} */
            double pr = creal(G[l - k]), pi = -cimag(G[l - k]), mr = creal(G[k + l]), mi = cimag(G[k + l]);
            double Dr = creal(D[l]), Di = cimag(D[l]);

            re += (pr + mr) * Dr + (mi - pi) * Di;
            im += (pi + mi) * Dr + (pr - mr) * Di;
        }
        F[k] += CMPLX(re, im);
    }
}

static void rate_of(const double complex *D, int H, double omega, double complex *V)
{
    for (int k = 0; k <= H; k++)
        V[k] = I * (k * omega) * D[k];
}

/* A wave under construction: sum of weight e^{-i m theta} over events, m = 1 .. most, and its mean; not `any`: it is 0. */
struct event_sum { double complex *wave; int most; double mean; bool any; };

enum { SUMS = 3 + LAW_INPUTS_MOST };

static void event_weights(const struct law_piece *piece, double weight[SUMS])
{
    weight[0] = piece->level;
    weight[1] = piece->damp;
    weight[2] = piece->cross;
    for (int j = 0; j < LAW_INPUTS_MOST; j++)
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

/* An event where weights change by AFTER - BEFORE (NULL: nothing before, or after): e^{-i theta} is z. */
static void add_event(struct aft *w, double complex z, const double *before, const double *after, struct event_sum sum[SUMS])
{
    double change[SUMS];
    int most = 0;

    for (int i = 0; i < SUMS; i++) {
        change[i] = (before != NULL ? before[i] : 0) - (after != NULL ? after[i] : 0);
        most = change[i] != 0 && sum[i].most > most ? sum[i].most : most;
    }
    if (most > 0)
        rotations(z, most, w->after);
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
        sum[i].wave[0] = sum[i].mean;
        for (int m = 1; m <= sum[i].most; m++)
            sum[i].wave[m] = CMPLX(-cimag(sum[i].wave[m]) * w->inverse[m], creal(sum[i].wave[m]) * w->inverse[m]);
    }
}

/* What the pieces of output i weigh: pieces follow each other, so that one's end is mostly the next one's beginning. */
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
        if (before != NULL && piece->from != at)
            add_event(w, z, before, NULL, sum);
        a->ends[2 * s] = before != NULL && piece->from == at ? z : rotation(piece->from);
        add_event(w, a->ends[2 * s], piece->from == at ? before : NULL, now, sum);
        a->ends[2 * s + 1] = z = rotation(piece->to);
        at = piece->to;
        before = now;
    }
    if (before != NULL)
        add_event(w, z, before, NULL, sum);
    end_sums(w, sum);
}

/* Which waves the pieces have; those and the last evaluation's are cleared, the others are 0 (cross_gains adds to gain and damp). */
static void clear_waves(struct aft_law *a, size_t inputs, size_t stride, size_t longest)
{
    bool level = a->levels, gain = a->gains || a->crosses, damp = a->damps || a->crosses, cross = a->crosses;

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
static void pieces_waves(struct aft *w, struct aft_law *a)
{
    int H = w->H, inputs = a->law->kind->inputs;
    size_t stride = 2 * (size_t)H + 1;

    clear_waves(a, (size_t)inputs, stride, 3 * (size_t)H + 1);
    for (int i = 0; i < inputs; i++) {
        struct event_sum sum[SUMS] = { { a->level + (size_t)i * stride, H, 0, false },
                                       { a->damp + (size_t)(i * inputs) * stride, 2 * H, 0, false }, { a->cross, 3 * H, 0, false } };

        for (int j = 0; j < inputs; j++)
            sum[3 + j] = (struct event_sum) { a->gain + (size_t)(i * inputs + j) * stride, 2 * H, 0, false };
        sum_pieces(w, a, i, sum);
    }
}

/* F += harmonics of cross d v, d v = (d^2)' / 2: laws of one input. */
static void cross_force(struct aft *w, const struct aft_law *a, double complex *F, double complex *work)
{
    int H = w->H;
    double complex *two = w->product;

    for (int m = 0; m <= H; m++)
        two[m] = m > 0 ? a->in[0].D[m] / 2 : a->in[0].D[0];
    for (int m = H + 1; m <= 3 * H; m++)
        two[m] = 0;
    memset(work, 0, (2 * (size_t)H + 1) * sizeof *work);
    convolve_add(two, a->in[0].D, H, 2 * H, work);
    for (int m = 0; m <= 2 * H; m++)
        work[m] *= I * (m * w->omega / 2);
    convolve_add(a->cross, work, 2 * H, H, F);
}

/* (2), of a gain to m = 2H and a motion whose N samples are D, by way of samples: products reach 3H, and of N > 4H samples none of that
 * falls on 0 .. H. */
static void sampled_product_add(struct aft *w, const double complex *gain, const double *d, double scale, double complex *F)
{
    int H = w->H;

    for (int m = 0; m <= 2 * H; m++)
        w->wave[m] = (m > 0 ? 2 : 1) * gain[m];
    orbit_synthesize(w->grid, 2 * H, w->wave, 0, w->samples);
    for (int n = 0; n < w->N; n++)
        w->samples[n] *= scale * d[n];
    orbit_analyze(w->grid, w->samples, H, w->wave);
    for (int k = 0; k <= H; k++)
        F[k] += w->wave[k];
}

/* Whether the way by samples is shorter than (2) for input j, and as good: stiff springs leave a force far smaller than its terms. */
static bool by_samples(const struct aft *w, const struct aft_law *a, int j)
{
    return !a->stiff && w->N > 4 * w->H && w->H * a->in[j].top > DIRECT * w->N;
}

static void gain_force(struct aft *w, const struct aft_law *a, int i, double complex *F, double complex *work)
{
    int H = w->H, inputs = a->law->kind->inputs;
    size_t stride = 2 * (size_t)H + 1;

    for (int j = 0; a->gains && j < inputs; j++)
        if (by_samples(w, a, j))
            sampled_product_add(w, a->gain + (size_t)(i * inputs + j) * stride, a->in[j].d, 1, F);
        else
            convolve_add(a->gain + (size_t)(i * inputs + j) * stride, a->in[j].D, a->in[j].top, H, F);
    if (a->damps && by_samples(w, a, 0))
        sampled_product_add(w, a->damp + (size_t)(i * inputs) * stride, a->in[0].v, w->omega, F);
    else if (a->damps) {
        rate_of(a->in[0].D, H, w->omega, work);
        convolve_add(a->damp + (size_t)(i * inputs) * stride, work, H, H, F);
    }
}

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
static void pieces_force(struct aft *w, struct aft_law *a, int i, double complex *F, double complex *work)
{
    int H = w->H;
    const double complex *level = a->level + (size_t)i * (2 * (size_t)H + 1);

    for (int k = 0; k <= H; k++)
        F[k] = (k > 0 ? 2 : 1) * level[k];
    gain_force(w, a, i, F, work);
    if (by_samples(w, a, 0) && largest(F, H + 1) < CANCELLED * largest(level, H + 1)) {
        a->stiff = true;
        pieces_force(w, a, i, F, work);
        return;
    }
    if (a->crosses)
        cross_force(w, a, F, work);
}

/* Of the pieces' derivative: cross adds its v to df/dd and its d to df/dv. */
static void cross_gains(struct aft *w, struct aft_law *a, double complex *work)
{
    int H = w->H;
    size_t stride = 2 * (size_t)H + 1;

    if (!a->crosses)
        return;
    memset(w->product, 0, stride * sizeof *w->product);
    convolve_add(a->cross, a->in[0].D, H, 2 * H, w->product);
    for (int m = 0; m <= 2 * H; m++)
        a->damp[m] += w->product[m] / (m > 0 ? 2 : 1);
    rate_of(a->in[0].D, H, w->omega, work);
    memset(w->product, 0, stride * sizeof *w->product);
    convolve_add(a->cross, work, H, 2 * H, w->product);
    for (int m = 0; m <= 2 * H; m++)
        a->gain[m] += w->product[m] / (m > 0 ? 2 : 1);
}

static enum modal_status find_pieces(struct aft *w, struct aft_law *a, struct modal_error *err)
{
    const struct orbit *input[LAW_INPUTS_MOST] = { &a->in[0], &a->in[1] };
    enum modal_status rc = MODAL_OK;

    pieces_clear(&a->pieces);
    for (int j = 0; rc == MODAL_OK && j < a->law->kind->inputs; j++)
        rc = orbit_find_turns(&a->in[j], err);
    if (rc == MODAL_OK)
        rc = a->law->kind->pieces(a->law, input, &a->pieces, err);
    a->acts = a->pieces.acts;
    a->undetermined = a->pieces.undetermined;
    a->evaluations += w->N;
    if (rc == MODAL_OK && a->ends_room < a->pieces.count) {
        double complex *more = realloc(a->ends, 2 * (size_t)a->pieces.room * sizeof *more);

        if (more == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for %d pieces", a->pieces.count);
        a->ends = more;
        a->ends_room = a->pieces.room;
    }
    return rc;
}

/* One sweep over the samples; memory in and out at a->z. */
static enum modal_status sweep(struct aft *w, struct aft_law *a, struct modal_error *err)
{
    int inputs = a->law->kind->inputs, N = w->N;
    double d[LAW_INPUTS_MOST], v[LAW_INPUTS_MOST], before[LAW_INPUTS_MOST];
    enum modal_status rc = MODAL_OK;

    a->acts = false;
    for (int n = 0; rc == MODAL_OK && n < N; n++) {
        struct law_point at = { .t = TWO_PI / w->omega * n / N, .d = d, .v = v, .d_before = before, .memory_before = a->z };
        struct law_force out = { .memory = a->z + a->memory };

        for (int j = 0; j < inputs; j++) {
            d[j] = a->in[j].d[n];
            v[j] = w->omega * a->in[j].v[n];
            before[j] = a->in[j].d[n > 0 ? n - 1 : N - 1];
        }
        rc = a->law->kind->force(a->law, &at, &out, err);
        for (int i = 0; rc == MODAL_OK && i < inputs; i++) {
            a->f[i * N + n] = out.f[i];
            for (int j = 0; j < inputs; j++) {
                a->fd[(i * inputs + j) * N + n] = out.fd[i][j];
                a->fv[(i * inputs + j) * N + n] = out.fv[i][j];
            }
        }
        memcpy(a->z, a->z + a->memory, (size_t)a->memory * sizeof *a->z);
        a->acts |= out.acts;
    }
    a->evaluations += N;
    return rc;
}

/* Sweep until the force at the end of a period repeats (laws without memory: once). */
static enum modal_status sample_law(struct aft *w, struct aft_law *a, struct modal_error *err)
{
    bool remembers = a->memory > 0 || a->law->kind->restart != NULL;
    double scale = 0, *last = w->law[0].f != NULL && remembers ? malloc((size_t)w->N * sizeof *last) : NULL, change;
    enum modal_status rc;

    memset(a->z, 0, (size_t)a->memory * sizeof *a->z);
    if (a->law->kind->restart != NULL)
        a->law->kind->restart(a->law);
    rc = sweep(w, a, err);
    for (int round = 1; rc == MODAL_OK && remembers && round < SWEEPS_MOST; round++) {
        if (last == NULL && (last = malloc((size_t)w->N * sizeof *last)) == NULL) {
            rc = modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for a sweep");
            break;
        }
        memcpy(last, a->f, (size_t)w->N * sizeof *last);
        rc = sweep(w, a, err);
        change = scale = 0;
        for (int n = 0; n < w->N; n++) {
            change = fmax(change, fabs(a->f[n] - last[n]));
            scale = fmax(scale, fabs(a->f[n]));
        }
        if (change <= SWEEP_TOLERANCE * scale)
            break;
    }
    free(last);
    return rc;
}

static void analyze_gains(struct aft *w, struct aft_law *a)
{
    int inputs = a->law->kind->inputs, H = w->H, N = w->N;
    size_t stride = 2 * (size_t)H + 1;

    for (int g = 0; g < inputs * inputs; g++) {
        orbit_analyze_gain(w->grid, a->fd + (size_t)g * (size_t)N, 2 * H, a->gain + (size_t)g * stride);
        if (a->law->kind->reads_velocity)
            orbit_analyze_gain(w->grid, a->fv + (size_t)g * (size_t)N, 2 * H, a->damp + (size_t)g * stride);
    }
}

static bool finite_motion(const double complex *X, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!isfinite(creal(X[i])) || !isfinite(cimag(X[i])))
            return false;
    return true;
}

static void set_motion(struct aft *w, struct aft_law *a, const double complex *X)
{
    int K = w->H + 1;

    for (int j = 0; j < a->law->kind->inputs; j++) {
        for (int k = 0; k < K; k++)
            a->in[j].D[k] = (a->place[j] >= 0 ? X[a->place[j] * K + k] : 0) - (a->to[j] >= 0 ? X[a->to[j] * K + k] : 0);
        orbit_sample(&a->in[j], w->grid, w->omega);
    }
}

static enum modal_status law_forces(struct aft *w, struct aft_law *a, struct modal_error *err)
{
    enum modal_status rc = a->exact ? find_pieces(w, a, err) : sample_law(w, a, err);
    size_t N = (size_t)w->N, K = (size_t)w->H + 1;

    if (rc != MODAL_OK)
        return rc;
    if (a->exact)
        pieces_waves(w, a);
    for (size_t i = 0; i < (size_t)a->law->kind->inputs; i++)
        if (a->exact)
            pieces_force(w, a, (int)i, a->F + i * K, w->product + 3 * w->H + 2);
        else
            orbit_analyze(w->grid, a->f + i * N, w->H, a->F + i * K);
    return MODAL_OK;
}

/* The gains of the last force's derivative.  A law sampled on request has that of its pieces. */
static enum modal_status law_gains(struct aft *w, struct aft_law *a, struct modal_error *err)
{
    bool borrow = !a->exact && a->law->kind->pieces != NULL;
    enum modal_status rc = borrow ? find_pieces(w, a, err) : MODAL_OK;

    if (rc == MODAL_OK && borrow)
        pieces_waves(w, a);
    if (rc == MODAL_OK && (a->exact || borrow))
        cross_gains(w, a, w->product + 3 * w->H + 2);
    else if (rc == MODAL_OK)
        analyze_gains(w, a);
    return rc;
}

static void scatter_force(const struct aft *w, const struct aft_law *a, const double complex *f, int K, double complex *F)
{
    (void)w;
    for (int i = 0; i < a->law->kind->inputs; i++)
        for (int k = 0; k < K; k++) {
            if (a->place[i] >= 0)
                F[a->place[i] * K + k] += f[i * K + k];
            if (a->to[i] >= 0)
                F[a->to[i] * K + k] -= f[i * K + k];
        }
}

enum modal_status aft_force(struct aft *w, double omega, const double complex *X, double complex *F, struct modal_error *err)
{
    size_t count = (size_t)w->q * ((size_t)w->H + 1);
    enum modal_status rc = MODAL_OK;

    if (!finite_motion(X, count))
        return modal_fail(err, MODAL_OVERFLOW, "aft: the motion is not finite");
    w->omega = omega;
    for (int i = 0; rc == MODAL_OK && i < w->laws; i++) {
        set_motion(w, &w->law[i], X);
        rc = law_forces(w, &w->law[i], err);
    }
    if (rc != MODAL_OK)
        return rc;
    memset(F, 0, count * sizeof *F);
    for (int i = 0; i < w->laws; i++)
        scatter_force(w, &w->law[i], w->law[i].F, w->H + 1, F);
    return finite_motion(F, count) ? MODAL_OK : modal_fail(err, MODAL_OVERFLOW, "aft: a force is not finite");
}

/* (2)'s derivative as a real matrix of order 2H+1 into w->block. */
static void gain_block(struct aft *w, const double complex *G, const double complex *V)
{
    int H = w->HJ, n = 2 * H + 1;
    double *B = w->block;

    B[0] = creal(G[0]);
    for (int k = 1; k <= H; k++) {
        B[2 * k - 1] = 2 * creal(G[k]);
        B[2 * k] = 2 * cimag(G[k]);
    }
    for (int l = 1; l <= H; l++) {
        double *re = B + (size_t)(2 * l - 1) * (size_t)n, *im = re + n, s = l * w->omega;

        re[0] = creal(G[l]) + s * cimag(V[l]);
        im[0] = cimag(G[l]) - s * creal(V[l]);
        for (int k = 1; k <= H; k++) {
            int p = k >= l ? k - l : l - k;
            double sign = k >= l ? 1 : -1;
            double Tr = creal(G[p]) - s * sign * cimag(V[p]), Ti = sign * cimag(G[p]) + s * creal(V[p]);
            double Hr = creal(G[k + l]) + s * cimag(V[k + l]), Hi = cimag(G[k + l]) - s * creal(V[k + l]);

            re[2 * k - 1] = Tr + Hr;
            re[2 * k] = Ti + Hi;
            im[2 * k - 1] = Hi - Ti;
            im[2 * k] = Tr - Hr;
        }
    }
}

/* block += column (masks or jumps, one-sided) x row (displacement, or rate, where the rotations are E) */
static void outer_block(struct aft *w, const double complex *column, double factor, bool rate, const double complex *e)
{
    int H = w->HJ, n = 2 * H + 1;

    for (int l = rate ? 1 : 0; l <= H; l++) {
        double a = factor * (rate ? l * cimag(e[l]) : creal(e[l]));
        double b = factor * (rate ? -l * creal(e[l]) : cimag(e[l]));
        double *re = w->block + (l > 0 ? (size_t)(2 * l - 1) * (size_t)n : 0), *im = re + n;

        re[0] += a * creal(column[0]);
        for (int k = 1; k <= H; k++) {
            re[2 * k - 1] += a * creal(column[k]);
            re[2 * k] += a * cimag(column[k]);
        }
        if (l == 0)
            continue;
        im[0] += b * creal(column[0]);
        for (int k = 1; k <= H; k++) {
            im[2 * k - 1] += b * creal(column[k]);
            im[2 * k] += b * cimag(column[k]);
        }
    }
}

/* pieces.h (2) and (3) for output i, input j */
static void level_blocks(struct aft *w, const struct aft_law *a, int i, int j)
{
    for (int s = 0; s < a->pieces.count; s++) {
        const struct law_piece *piece = &a->pieces.piece[s];

        if (piece->output != i)
            continue;
        if (piece->holds && piece->ref[j] != 0) {
            rotations(a->ends[2 * s], w->HJ, w->before);
            rotations(a->ends[2 * s + 1], w->HJ, w->after);
            mask_of(w, piece->to - piece->from, w->HJ);
            for (int k = 1; k <= w->HJ; k++)
                w->mask[k] *= 2;
            if (piece->at != piece->from)
                rotations(rotation(piece->at), w->HJ, w->before);
            outer_block(w, w->mask, piece->ref[j], false, w->before);
        }
        if (piece->jump != 0 && piece->slope != 0 && j == 0) {
            rotations(a->ends[2 * s], w->HJ, w->before);
            for (int k = 0; k <= w->HJ; k++)
                w->mask[k] = (k > 0 ? 2 : 1) / TWO_PI * w->before[k];
            outer_block(w, w->mask, piece->jump / piece->slope, true, w->before);
        }
    }
}

static void add_block(const struct aft *w, double sign, int row, int column,
                      const struct aft_target *into)
{
    int n = 2 * w->HJ + 1;

    if (row < 0 || column < 0)
        return;
    for (int c = 0; c < n; c++) {
        double *out = into->column(into->context, row, column, c);
        const double *in = w->block + (size_t)c * (size_t)n;

        for (int r = 0; r < n; r++)
            out[r] += sign * in[r];
    }
}

enum modal_status aft_add_derivative(struct aft *w, const struct aft_target *into,
                                     struct modal_error *err)
{
    size_t stride = 2 * (size_t)w->H + 1;
    enum modal_status rc = MODAL_OK;

    if (w->block == NULL && (w->block = malloc(stride * stride * sizeof *w->block)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for a derivative of %d harmonics", w->H);
    for (int l = 0; rc == MODAL_OK && l < w->laws; l++)
        rc = law_gains(w, &w->law[l], err);
    for (int l = 0; rc == MODAL_OK && l < w->laws; l++) {
        struct aft_law *a = &w->law[l];
        int inputs = a->law->kind->inputs;

        for (int i = 0; i < inputs; i++)
            for (int j = 0; j < inputs; j++) {
                size_t at = (size_t)(i * inputs + j) * stride;

                gain_block(w, a->gain + at, a->damp + at);
                level_blocks(w, a, i, j);
                add_block(w, 1, a->place[i], a->place[j], into);
                add_block(w, -1, a->place[i], a->to[j], into);
                add_block(w, -1, a->to[i], a->place[j], into);
                add_block(w, 1, a->to[i], a->to[j], into);
            }
    }
    return rc;
}

void aft_set_order(struct aft *w, int HJ) { w->HJ = HJ; }
int aft_samples(const struct aft *w) { return w->N; }
long aft_transforms(const struct aft *w) { return orbit_grid_transforms(w->grid); }
long aft_evaluations(const struct aft *w, int law) { return w->law[law].evaluations; }
bool aft_acts(const struct aft *w, int law) { return w->law[law].acts; }
bool aft_undetermined(const struct aft *w, int law) { return w->law[law].undetermined; }
bool aft_sampled(const struct aft *w, int law) { return !w->law[law].exact; }

double aft_slope(const struct aft *w)
{
    double most = 0;

    for (int l = 0; l < w->laws; l++) {
        const struct aft_law *a = &w->law[l];
        int inputs = a->law->kind->inputs;

        for (int s = 0; a->exact && s < a->pieces.count; s++)
            for (int j = 0; j < inputs; j++)
                most = fmax(most, fabs(a->pieces.piece[s].gain[j]));
        for (int n = 0; !a->exact && n < inputs * inputs * w->N; n++)
            most = fmax(most, fabs(a->fd[n]));
    }
    return most;
}
