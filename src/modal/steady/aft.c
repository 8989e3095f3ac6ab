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

enum { SWEEPS_MOST = 12 };
static const double TWO_PI = 6.283185307179586477, SWEEP_TOLERANCE = 1e-12;

struct aft_law {
    const struct law *law;
    int place[LAW_INPUTS_MOST], to[LAW_INPUTS_MOST];
    struct orbit in[LAW_INPUTS_MOST];
    struct law_pieces pieces;
    bool exact, acts, undetermined;
    long evaluations;
    int memory;
    double *f, *fd, *fv;                    /* samples: [i][N], [i][j][N] */
    double *z;                              /* memory, twice */
    double complex *F;                      /* [i][H+1] */
    double complex *gain, *damp;            /* [i][j][2H+1], two-sided m >= 0 */
};

struct aft {
    int q, H, N, laws, room, HJ;          /* HJ: of derivatives */
    bool located;
    double omega;
    struct orbit_grid *grid;
    struct aft_law *law;
    double complex *mask, *wave, *product;  /* 4H + 2 and more: see work_size */
    double *block, *cosine, *sine;          /* (2H+1)^2, 2H+1 */
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
    free(w->block);
    free(w->cosine);
    free(w->sine);
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
    a->z = calloc(2 * (size_t)a->memory + 1, sizeof *a->z);
    if (!a->exact) {
        a->f = calloc(n * N, sizeof *a->f);
        a->fd = calloc(n * n * N, sizeof *a->fd);
        a->fv = calloc(n * n * N, sizeof *a->fv);
    }
    if (a->F == NULL || a->gain == NULL || a->damp == NULL || a->z == NULL
        || (!a->exact && (a->f == NULL || a->fd == NULL || a->fv == NULL)))
        return modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for a law at %d harmonics, %d samples", w->H, w->N);
    return MODAL_OK;
}

enum modal_status aft_new(const struct program *p, const int *place, int q, int H, int N, bool located, struct aft **out,
                          struct modal_error *err)
{
    struct aft *w = calloc(1, sizeof *w);
    size_t order = 2 * (size_t)H + 1;
    enum modal_status rc = MODAL_OK;

    if (w == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "aft: no memory");
    *w = (struct aft) { .q = q, .H = H, .HJ = H, .N = N, .located = located, .laws = p->laws };
    w->room = 8 * H + 8 > N ? 8 * H + 8 : N;
    w->law = calloc((size_t)p->laws + 1, sizeof *w->law);
    w->mask = calloc((size_t)w->room, sizeof *w->mask);
    w->wave = calloc((size_t)w->room, sizeof *w->wave);
    w->product = calloc((size_t)w->room, sizeof *w->product);
    w->cosine = calloc(order, sizeof *w->cosine);
    w->sine = calloc(order, sizeof *w->sine);
    w->inverse = calloc((size_t)w->room, sizeof *w->inverse);
    if (w->law == NULL || w->mask == NULL || w->wave == NULL || w->product == NULL
        || w->cosine == NULL || w->sine == NULL || w->inverse == NULL)
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

/* (1) for m = 0 .. most into w->mask. */
static void mask_of(struct aft *w, double from, double to, int most)
{
    double ca = cos(from), sa = -sin(from), cb = cos(to), sb = -sin(to), ra = 1, ia = 0, rb = 1, ib = 0;

    w->mask[0] = (to - from) / TWO_PI;
    for (int m = 1; m <= most; m++) {
        double t;

        if (m % 64 == 0) {                       /* the rotations' rounding starts afresh */
            ra = cos(m * from);
            ia = -sin(m * from);
            rb = cos(m * to);
            ib = -sin(m * to);
        } else {
            t = ra * ca - ia * sa;
            ia = ra * sa + ia * ca;
            ra = t;
            t = rb * cb - ib * sb;
            ib = rb * sb + ib * cb;
            rb = t;
        }
        w->mask[m] = CMPLX(-(ib - ia), rb - ra) * w->inverse[m];
    }
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

/* What a law's pieces weigh: waves of level, gain, damp and cross, two-sided, up to `most`. */
enum wave { WAVE_GAIN, WAVE_DAMP, WAVE_CROSS, WAVE_LEVEL };

static double weight(const struct law_piece *s, enum wave wave, int j)
{
    switch (wave) {
    case WAVE_GAIN: return s->gain[j];
    case WAVE_DAMP: return j == 0 ? s->damp : 0;
    case WAVE_CROSS: return j == 0 ? s->cross : 0;
    case WAVE_LEVEL: return s->level;
    }
    return 0;
}

/* The wave of output i, input j up to MOST into G; false where it is 0 throughout. */
static bool wave_of(struct aft *w, const struct aft_law *a, int i, int j, enum wave wave, int most, double complex *G)
{
    bool any = false;

    memset(G, 0, ((size_t)most + 1) * sizeof *G);
    for (int s = 0; s < a->pieces.count; s++) {
        const struct law_piece *piece = &a->pieces.piece[s];
        double value = piece->output == i ? weight(piece, wave, j) : 0;

        if (value == 0)
            continue;
        any = true;
        mask_of(w, piece->from, piece->to, most);
        for (int m = 0; m <= most; m++)
            G[m] += value * w->mask[m];
    }
    return any;
}

/* Harmonics 0 .. K of output i of the pieces into F; scratch: w->wave, w->product (K + 2H < room). */
static void pieces_force(struct aft *w, struct aft_law *a, int i, int K, double complex *F, double complex *work)
{
    int H = w->H, inputs = a->law->kind->inputs;

    memset(F, 0, ((size_t)K + 1) * sizeof *F);
    if (wave_of(w, a, i, 0, WAVE_LEVEL, K, w->wave))
        for (int k = 0; k <= K; k++)
            F[k] += (k > 0 ? 2 : 1) * w->wave[k];
    for (int j = 0; j < inputs; j++) {
        if (wave_of(w, a, i, j, WAVE_GAIN, K + H, w->wave))
            convolve_add(w->wave, a->in[j].D, H, K, F);
        if (wave_of(w, a, i, j, WAVE_DAMP, K + H, w->wave)) {
            rate_of(a->in[0].D, H, w->omega, work);
            convolve_add(w->wave, work, H, K, F);
        }
        if (wave_of(w, a, i, j, WAVE_CROSS, K + 2 * H, w->wave)) {      /* d v = (d^2)' / 2 */
            double complex *two = w->product;

            for (int m = 0; m <= H; m++)
                two[m] = m > 0 ? a->in[0].D[m] / 2 : a->in[0].D[0];
            for (int m = H + 1; m <= 3 * H; m++)
                two[m] = 0;
            memset(work, 0, (2 * (size_t)H + 1) * sizeof *work);
            convolve_add(two, a->in[0].D, H, 2 * H, work);
            for (int m = 0; m <= 2 * H; m++)
                work[m] *= I * (m * w->omega / 2);
            convolve_add(w->wave, work, 2 * H, K, F);
        }
    }
}

/* The gains of pieces, as waves up to 2H: cross adds its v to df/dd and its d to df/dv. */
static void pieces_gains(struct aft *w, struct aft_law *a, double complex *work)
{
    int H = w->H, inputs = a->law->kind->inputs;
    size_t stride = 2 * (size_t)H + 1;

    for (int i = 0; i < inputs; i++)
        for (int j = 0; j < inputs; j++) {
            double complex *gain = a->gain + (size_t)(i * inputs + j) * stride;
            double complex *damp = a->damp + (size_t)(i * inputs + j) * stride;

            wave_of(w, a, i, j, WAVE_GAIN, 2 * w->HJ, gain);
            wave_of(w, a, i, j, WAVE_DAMP, 2 * w->HJ, damp);
            if (!wave_of(w, a, i, j, WAVE_CROSS, 3 * H, w->wave))
                continue;
            memset(w->product, 0, stride * sizeof *w->product);
            convolve_add(w->wave, a->in[0].D, H, 2 * H, w->product);
            for (int m = 0; m <= 2 * H; m++)
                damp[m] += w->product[m] / (m > 0 ? 2 : 1);
            rate_of(a->in[0].D, H, w->omega, work);
            memset(w->product, 0, stride * sizeof *w->product);
            convolve_add(w->wave, work, H, 2 * H, w->product);
            for (int m = 0; m <= 2 * H; m++)
                gain[m] += w->product[m] / (m > 0 ? 2 : 1);
        }
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

static void analyze_samples(struct aft *w, struct aft_law *a, bool derivative)
{
    int inputs = a->law->kind->inputs, H = w->H, N = w->N;
    size_t stride = 2 * (size_t)H + 1;

    for (int i = 0; i < inputs; i++)
        orbit_analyze(w->grid, a->f + (size_t)i * (size_t)N, H, a->F + (size_t)i * ((size_t)H + 1));
    for (int g = 0; derivative && g < inputs * inputs; g++) {
        double complex *gain = a->gain + (size_t)g * stride, *damp = a->damp + (size_t)g * stride;

        orbit_analyze_gain(w->grid, a->fd + (size_t)g * (size_t)N, 2 * H, gain);
        if (a->law->kind->reads_velocity)
            orbit_analyze_gain(w->grid, a->fv + (size_t)g * (size_t)N, 2 * H, damp);
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

static enum modal_status law_forces(struct aft *w, struct aft_law *a, bool derivative, struct modal_error *err)
{
    bool borrow = !a->exact && a->law->kind->pieces != NULL;    /* sampled on request: the derivative is that of pieces */
    enum modal_status rc = MODAL_OK;

    if (a->exact || (borrow && derivative))
        rc = find_pieces(w, a, err);
    if (rc == MODAL_OK && !a->exact)
        rc = sample_law(w, a, err);
    if (rc != MODAL_OK)
        return rc;
    if (a->exact)
        for (int i = 0; i < a->law->kind->inputs; i++)
            pieces_force(w, a, i, w->H, a->F + (size_t)i * ((size_t)w->H + 1), w->product + 3 * w->H + 2);
    else
        analyze_samples(w, a, derivative && !borrow);
    if (derivative && (a->exact || borrow))
        pieces_gains(w, a, w->product + 3 * w->H + 2);
    return MODAL_OK;
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

enum modal_status aft_force(struct aft *w, double omega, const double complex *X, bool derivative, double complex *F,
                            struct modal_error *err)
{
    size_t count = (size_t)w->q * ((size_t)w->H + 1);
    enum modal_status rc = MODAL_OK;

    if (!finite_motion(X, count))
        return modal_fail(err, MODAL_OVERFLOW, "aft: the motion is not finite");
    if (derivative && w->block == NULL) {
        size_t order = 2 * (size_t)w->H + 1;

        w->block = malloc(order * order * sizeof *w->block);
        if (w->block == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for a derivative of %d harmonics", w->H);
    }
    w->omega = omega;
    for (int i = 0; rc == MODAL_OK && i < w->laws; i++) {
        set_motion(w, &w->law[i], X);
        rc = law_forces(w, &w->law[i], derivative, err);
    }
    if (rc != MODAL_OK)
        return rc;
    memset(F, 0, count * sizeof *F);
    for (int i = 0; i < w->laws; i++)
        scatter_force(w, &w->law[i], w->law[i].F, w->H + 1, F);
    return finite_motion(F, count) ? MODAL_OK : modal_fail(err, MODAL_OVERFLOW, "aft: a force is not finite");
}

enum modal_status aft_force_beyond(struct aft *w, int H2, double complex *F, struct modal_error *err)
{
    size_t K = (size_t)H2 + 1;
    int room = 3 * (H2 + 2 * w->H) + 8;
    double complex *f = calloc(LAW_INPUTS_MOST * K + 1, sizeof *f), *work = calloc((size_t)room, sizeof *work);
    enum modal_status rc = MODAL_OK;

    if (room > w->room) {
        double complex *mask = realloc(w->mask, (size_t)room * sizeof *mask), *wave, *product;
        double *inverse;

        w->mask = mask != NULL ? mask : w->mask;
        wave = realloc(w->wave, (size_t)room * sizeof *wave);
        w->wave = wave != NULL ? wave : w->wave;
        product = realloc(w->product, (size_t)room * sizeof *product);
        w->product = product != NULL ? product : w->product;
        inverse = realloc(w->inverse, (size_t)room * sizeof *inverse);
        w->inverse = inverse != NULL ? inverse : w->inverse;
        if (mask != NULL && wave != NULL && product != NULL && inverse != NULL) {
            for (int m = 1; m < room; m++)
                w->inverse[m] = 1 / (TWO_PI * m);
            w->room = room;
        }
    }
    if (f == NULL || work == NULL || room > w->room) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for %d harmonics", H2);
        goto out;
    }
    memset(F, 0, (size_t)w->q * K * sizeof *F);
    for (int l = 0; l < w->laws; l++) {
        struct aft_law *a = &w->law[l];

        for (int i = 0; i < a->law->kind->inputs; i++)
            if (a->exact)
                pieces_force(w, a, i, H2, f + (size_t)i * K, work);
            else
                orbit_analyze(w->grid, a->f + (size_t)i * (size_t)w->N, H2, f + (size_t)i * K);
        scatter_force(w, a, f, H2 + 1, F);
    }
out:
    free(f);
    free(work);
    return rc;
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

static void wave_at(struct aft *w, double theta)                  /* cos and sin of k theta, k = 0 .. H */
{
    double c = cos(theta), s = sin(theta);

    w->cosine[0] = 1;
    w->sine[0] = 0;
    for (int k = 1; k <= w->HJ; k++) {
        w->cosine[k] = w->cosine[k - 1] * c - w->sine[k - 1] * s;
        w->sine[k] = w->cosine[k - 1] * s + w->sine[k - 1] * c;
    }
}

/* block += column (masks or jumps, one-sided) x row (displacement, or rate, at an angle) */
static void outer_block(struct aft *w, const double complex *column, double factor, bool rate)
{
    int H = w->HJ, n = 2 * H + 1;

    for (int l = rate ? 1 : 0; l <= H; l++) {
        double a = factor * (rate ? -l * w->sine[l] : w->cosine[l]);
        double b = factor * (rate ? -l * w->cosine[l] : -w->sine[l]);
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
            mask_of(w, piece->from, piece->to, w->HJ);
            for (int k = 1; k <= w->HJ; k++)
                w->mask[k] *= 2;
            wave_at(w, piece->at);
            outer_block(w, w->mask, piece->ref[j], false);
        }
        if (piece->jump != 0 && piece->slope != 0 && j == 0) {
            wave_at(w, piece->from);
            for (int k = 0; k <= w->HJ; k++)
                w->mask[k] = (k > 0 ? 2 : 1) / TWO_PI * CMPLX(w->cosine[k], -w->sine[k]);
            outer_block(w, w->mask, piece->jump / piece->slope, true);
        }
    }
}

static void add_block(const struct aft *w, double sign, int row, int column, double *J, int ld)
{
    int n = 2 * w->HJ + 1;

    if (row < 0 || column < 0)
        return;
    for (int c = 0; c < n; c++) {
        double *out = J + (size_t)(column * n + c) * (size_t)ld + row * n;
        const double *in = w->block + (size_t)c * (size_t)n;

        for (int r = 0; r < n; r++)
            out[r] += sign * in[r];
    }
}

void aft_add_derivative(struct aft *w, double *J, int ld)
{
    size_t stride = 2 * (size_t)w->H + 1;

    for (int l = 0; l < w->laws; l++) {
        struct aft_law *a = &w->law[l];
        int inputs = a->law->kind->inputs;

        for (int i = 0; i < inputs; i++)
            for (int j = 0; j < inputs; j++) {
                size_t at = (size_t)(i * inputs + j) * stride;

                gain_block(w, a->gain + at, a->damp + at);
                level_blocks(w, a, i, j);
                add_block(w, 1, a->place[i], a->place[j], J, ld);
                add_block(w, -1, a->place[i], a->to[j], J, ld);
                add_block(w, -1, a->to[i], a->place[j], J, ld);
                add_block(w, 1, a->to[i], a->to[j], J, ld);
            }
    }
}

void aft_set_order(struct aft *w, int HJ) { w->HJ = HJ; }
int aft_samples(const struct aft *w) { return w->N; }
long aft_transforms(const struct aft *w) { return orbit_grid_transforms(w->grid); }
long aft_evaluations(const struct aft *w, int law) { return w->law[law].evaluations; }
bool aft_acts(const struct aft *w, int law) { return w->law[law].acts; }
bool aft_undetermined(const struct aft *w, int law) { return w->law[law].undetermined; }
bool aft_sampled(const struct aft *w, int law) { return !w->law[law].exact; }
const struct law_pieces *aft_pieces(const struct aft *w, int law) { return w->law[law].exact ? &w->law[law].pieces : NULL; }
const double *aft_gains(const struct aft *w, int law, bool over_v) { return over_v ? w->law[law].fv : w->law[law].fd; }

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
