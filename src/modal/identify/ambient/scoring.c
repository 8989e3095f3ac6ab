/*
 * scoring.c - the information about modes, by bins that tell of them
 *
 * By (4) of whittle.c, with H, R = M M^T and f(mu) of (1) there,
 *
 *     d log p = sum_b n_b tr(S^-1 (I - S) S^-1 dS),                                             (1)
 *     J_ij = sum_b n_b tr(S^-1 dS_i S^-1 dS_j),                                                 (2)
 *
 * J the information.  With B = R H^H S^-1 (I - S) S^-1 a bin's part of (1) is 2 Re tr(B dH), a
 * product of matrices for all modes.  In (2) every dS is c a b^H + its adjoint, or a sum of two
 * such, with vectors a, b from a short list; after C^-1, S = C C^H, it needs their Gram matrix
 * only, which makes a bin's cost that of J's entries, not times l^2.
 *
 * A step solves (2) whole by conjugate gradients: J times a step is a product for all bins, of dH
 * to dS, and then as (1).  Modes far apart hardly share a bin, so a J is formed for them to begin
 * with in which each mode has the bins of reach.h: its columns are zero in the others, but for the
 * block of a mode with itself.  Both keep J positive, and with modes in order of their turn it is
 * an envelope of blocks, those that are told everywhere at its end and M's own block last.
 *
 * For errors the bins are more, and a mode's own block has no others: what these would tell of it
 * alone is shared with the unknowns of other modes, and tells hardly more of its exponent.
 *
 * Tested by tests/unit/modal/identify/ambient/test_scoring.c.
 */
#include "modal/identify/ambient/scoring.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ambient/reach.h"
#include "modal/identify/fit/refine.h"
#include "modal/linalg/envelope.h"

enum { L = WHITTLE_CHANNELS_MOST, MODES = WHITTLE_MODES_MOST, SHARED = WHITTLE_TRANSFERS, OWN = 8,
       PAIRS = 2,                   /* of vectors: a pole's and its conjugate's */
       RUNS_OF_MODE = 6,            /* two of each part of phi, about its pivot, one of kappa's */
       PRODUCT = 16,                /* entries of a product of matrices take as long as one of J, */
       PAIR = 300,                  /* so many of J as the calls for two modes in a bin, or one, */
       LOOKS = 4,                   /* likelihoods as a gradient, and as J times a step: measured */
       PRODUCTS_MOST = 30,          /* of a step: what is not told by then is not gained by it */
       WHOLE = 60 };                /* products that forming all of J pays for: it serves more than
                                       one step */
/* The vectors of all modes are whittle_transfers(), channels of each; those of a mode follow. */
enum { F, F_CONJUGATE, SLOPE, SLOPE_CONJUGATE, PEAKS };
enum { V_SR, V_SI, V_QR, V_QI, V_PHI, V_PHIC, V_K, V_KC };
static const double
    LOSS[] = { 0.03, 1e-3 },     /* of what is told of an exponent: for steps, for errors */
    HELD_FIRST = 1e-14,          /* what holds an unknown that nothing tells, in that scale; */
    HELD_FACTOR = 100,           /* more, until the information has a factor, */
    ENOUGH = 0.1,                /* of the residual's square: a step gains all but as much */
    LOG_STEP = 1;                /* of a decay rate's logarithm in one step: a factor of e */

/* Unknowns first .. first + count - 1 of a block whose dS are v_i f^H + f v_i^H, v_i = vary + i. */
struct run { int block, first, count, vary, fixed; };

/* dS = sum of c a b^H + its adjoint; a, b: indices of vectors. */
struct pairs { int a[PAIRS], b[PAIRS]; double complex c[PAIRS]; };

/* A bin: C; units, H R, H, H M; S^-1 (I - S) S^-1. */
struct glance { bool seen; double complex C[L * L], shared[SHARED * L * L], Z[L * L]; };

/* What a bin is to (1): B, and both products with it of all modes, l x 2 count, a mode's and its
 * conjugate's side by side. */
struct pull {
    double complex B[L * L], BK[2 * MODES * L], BP[2 * MODES * L];
    double complex K[2 * MODES * L], P[2 * MODES * L];
    double complex left[4 * MODES * L], right[4 * MODES * L], root[L * L];   /* of a push */
};

struct scoring {
    struct workspace memory;
    enum scoring_use use;
    int channels, count, unknowns;
    int pivot[MODES];                 /* the entry of phi that stays */
    bool *tells;                      /* bins x modes */
    struct envelope J;                /* blocks of each mode, and of M */
    struct run *runs;                 /* of a bin */
    struct pairs *exponent;           /* of the modes of a bin, two each */
    double complex *V, *G;            /* channels x vectors; their Gram matrix */
    struct glance *glance;            /* of each bin, where the gradient was taken */
    double complex (*peak)[PEAKS];    /* bins x modes */
    double *residual, *preconditioned, *ahead, *image; /* of conjugate gradients */
    struct pull *pull;
    double factored;                  /* the damping in the factor; NAN: there is none */
    double *gradient, *step, *scale;
    double entries, work;             /* of J, of all bins; what was done so far */
};

void scoring_free(struct scoring *w)
{
    if (w != NULL)
        workspace_free(&w->memory);
    free(w);
}

double scoring_work(const struct scoring *w)
{
    return w->work + w->J.work / PRODUCT;
}

static void whiten(int l, const double complex *C, double complex *V, int count)
{
    const double complex one = 1;

    cblas_ztrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, l, count, &one, C,
                l, V, l);
}

/* The first block that shares a bin with each; what a bin takes. */
static void find_envelope(struct scoring *w, const struct bins *s)
{
    int l = w->channels, count = w->count, each = whittle_unknowns_of_mode(l);
    struct envelope_block *block = w->J.block;

    for (int k = 0; k < count; k++)
        block[k] = (struct envelope_block) { .first = k, .rows = each };
    block[count] = (struct envelope_block) { .rows = l * (l + 1) / 2 };
    for (int b = 0; b < s->count; b++) {
        const bool *tells = w->tells + (size_t)count * b;
        int first = count, told = 0;
        double entries = block[count].rows;
        for (int k = count - 1; k >= 0; k--)
            if (tells[k])
                first = k, told++;
        entries += (double)told * each;
        for (int k = first; k < count; k++)
            if (tells[k] && first < block[k].first)
                block[k].first = first;
        w->entries += entries * entries + PAIR * (told * (told + 1.) / 2 + count - told);
    }
    envelope_room(&w->J, &w->memory);
}

/* The whole J takes its entries in each bin, a product an l-th of a row: it is formed at once where
 * it takes no more than so many. */
static double loss_for(const struct scoring *w)
{
    return w->unknowns <= WHOLE * w->channels ? 0 : LOSS[w->use];
}

static int largest(const double complex *x, int n)
{
    int at = 0;

    for (int i = 1; i < n; i++)
        if (cabs(x[i]) > cabs(x[at]))
            at = i;
    return at;
}

enum modal_status scoring_new(struct whittle *m, const struct bins *s, enum scoring_use use,
                              struct scoring **out, struct modal_error *err)
{
    size_t n = (size_t)whittle_unknowns(m), v = (size_t)(SHARED * m->channels + OWN * m->count);
    struct scoring *w = calloc(1, sizeof *w);
    enum modal_status rc;

    *out = w;
    if (w == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for the information");
    w->channels = m->channels, w->count = m->count, w->unknowns = (int)n, w->use = use;
    w->tells = workspace_zeros(&w->memory, (size_t)s->count * (size_t)m->count, sizeof *w->tells);
    w->J.count = m->count + 1;
    w->J.block = workspace_zeros(&w->memory, (size_t)m->count + 1, sizeof *w->J.block);
    w->runs = workspace_zeros(&w->memory, (size_t)(RUNS_OF_MODE * m->count + m->channels),
                              sizeof *w->runs);
    w->exponent = workspace_zeros(&w->memory, (size_t)(2 * m->count), sizeof *w->exponent);
    w->V = workspace_zeros(&w->memory, v * (size_t)m->channels, sizeof *w->V);
    w->G = workspace_zeros(&w->memory, v * v, sizeof *w->G);
    w->gradient = workspace_zeros(&w->memory, n, sizeof *w->gradient);
    w->step = workspace_zeros(&w->memory, n, sizeof *w->step);
    w->scale = workspace_zeros(&w->memory, n, sizeof *w->scale);
    w->residual = workspace_zeros(&w->memory, n, sizeof *w->residual);
    w->preconditioned = workspace_zeros(&w->memory, n, sizeof *w->preconditioned);
    w->ahead = workspace_zeros(&w->memory, n, sizeof *w->ahead);
    w->image = workspace_zeros(&w->memory, n, sizeof *w->image);
    w->glance = workspace_zeros(&w->memory, (size_t)s->count, sizeof *w->glance);
    w->peak = workspace_zeros(&w->memory, (size_t)s->count * (size_t)m->count, sizeof *w->peak);
    w->pull = workspace_zeros(&w->memory, 1, sizeof *w->pull);
    rc = workspace_check(&w->memory, "identify: no memory for the information", err);
    if (rc == MODAL_OK)
        rc = reach_find(m, s, loss_for(w), w->tells, err);
    if (rc != MODAL_OK)
        return rc;
    find_envelope(w, s);
    for (int k = 0; k < m->count; k++)
        w->pivot[k] = largest(m->mode[k].phi, m->channels);
    return workspace_check(&w->memory, "identify: no memory for the information", err);
}

/* ---- (1) ---- */

static void pull_of(const struct whittle *m, struct pull *p)
{
    const double complex one = 1, zero = 0;
    int l = m->channels, n = 2 * m->count;

    if (n == 0)
        return;
    cblas_zgemm(CblasColMajor, CblasTrans, CblasNoTrans, l, n, l, &one, p->B, l, p->K, l, &zero,
                p->BK, l);
    cblas_zgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, l, n, l, &one, p->B, l, p->P, l, &zero,
                p->BP, l);
}

/* Unknowns first .. first + l - 1 but the pivot (-1: none): their real parts, and the imaginary
 * ones after them; of f x + h y. */
static int pull_vector(int l, int pivot, double lines, const double complex *f,
                       const double complex *x, double *out)
{
    int n = 0, each = pivot < 0 ? l : l - 1;

    for (int i = 0; i < l; i++)
        if (i != pivot) {
            double complex a = f[F] * x[i], b = f[F_CONJUGATE] * x[l + i];
            out[n] += 2 * lines * (creal(a) + creal(b));
            out[n++ + each] += 2 * lines * (cimag(b) - cimag(a));
        }
    return 2 * each;
}

static void pull_mode(const struct scoring *w, const struct whittle *m, int k,
                      const double complex *f, double lines, double *out)
{
    const struct pull *p = w->pull;
    double complex t[2] = { 0, 0 };
    int l = m->channels;
    double *g = out + w->J.block[k].start;

    for (int i = 0; i < l; i++) {
        t[0] += p->K[2 * k * l + i] * p->BP[2 * k * l + i];
        t[1] += p->K[(2 * k + 1) * l + i] * p->BP[(2 * k + 1) * l + i];
    }
    t[0] *= f[SLOPE], t[1] *= f[SLOPE_CONJUGATE];
    /* of the log decay, the turn */
    g[0] += 2 * lines * creal(m->mode[k].lambda) * (creal(t[0]) + creal(t[1]));
    g[1] += 2 * lines * (cimag(t[1]) - cimag(t[0]));
    g += 2;
    g += pull_vector(l, w->pivot[k], lines, f, p->BK + 2 * k * l, g);
    pull_vector(l, -1, lines, f, p->BP + 2 * k * l, g);
}

/* Of M by columns: 2 Re (M^T H^H Z H)^T. */
static void pull_root(const struct scoring *w, const double complex *V, const double complex *Z,
                      double lines, double *out)
{
    const double complex one = 1, zero = 0;
    double complex ZH[L * L], T[L * L];
    int l = w->channels, n = w->J.block[w->count].start;

    cblas_zgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, l, l, l, &one, Z, l,
                V + WHITTLE_H * l * l, l, &zero, ZH, l);
    cblas_zgemm(CblasColMajor, CblasConjTrans, CblasNoTrans, l, l, l, &one, V + WHITTLE_HM * l * l,
                l, ZH, l, &zero, T, l);
    for (int c = 0; c < l; c++)
        for (int r = c; r < l; r++)
            out[n++] += 2 * lines * creal(T[c + l * r]);
}

/* tr(Z dS) by all unknowns, of bin B, added to OUT. */
static void pull_bin(struct scoring *w, const struct whittle *m, int b, const double complex *Z,
                     double lines, double *out)
{
    const double complex one = 1, zero = 0, *V = w->glance[b].shared;
    int l = m->channels;

    cblas_zgemm(CblasColMajor, CblasConjTrans, CblasNoTrans, l, l, l, &one, V + WHITTLE_HR * l * l,
                l, Z, l, &zero, w->pull->B, l);
    pull_of(m, w->pull);
    for (int k = 0; k < m->count; k++)
        pull_mode(w, m, k, w->peak[(size_t)b * m->count + k], lines, out);
    pull_root(w, V, Z, lines, out);
}

/* C^-H X C^-1 in place of X. */
static void whiten_again(int l, const double complex *C, double complex *X)
{
    const double complex one = 1;

    cblas_ztrsm(CblasColMajor, CblasLeft, CblasLower, CblasConjTrans, CblasNonUnit, l, l, &one, C,
                l, X, l);
    cblas_ztrsm(CblasColMajor, CblasRight, CblasLower, CblasNoTrans, CblasNonUnit, l, l, &one, C, l,
                X, l);
}

static void look(struct scoring *w, const struct whittle *m, const double complex *poles,
                 const struct bins *s, int b)
{
    struct glance *g = &w->glance[b];
    double at = whittle_middle(s, b);
    double complex z = cexp(CMPLX(0, at));

    g->seen = !isnan(whittle_residual(m, poles, s, b, g->C, g->Z));
    if (!g->seen)
        return;
    whiten_again(m->channels, g->C, g->Z);
    whittle_transfers(m, poles, at, g->shared);
    for (int k = 0; k < m->count; k++) {
        struct whittle_peak f = whittle_peak(poles[k], z), h = whittle_peak(conj(poles[k]), z);
        double complex *p = w->peak[(size_t)b * m->count + k];
        p[F] = f.f, p[F_CONJUGATE] = h.f, p[SLOPE] = f.slope, p[SLOPE_CONJUGATE] = h.slope;
    }
}

void scoring_gradient(struct scoring *w, const struct whittle *m, const struct bins *s)
{
    struct pull *p = w->pull;
    double complex poles[MODES];
    int l = m->channels;

    w->work += LOOKS * whittle_work(m, s);
    whittle_poles(m, poles);
    memset(w->gradient, 0, sizeof *w->gradient * (size_t)w->unknowns);
    for (int k = 0; k < m->count; k++)
        for (int i = 0; i < l; i++) {
            p->K[2 * k * l + i] = m->mode[k].kappa[i], p->P[2 * k * l + i] = m->mode[k].phi[i];
            p->K[(2 * k + 1) * l + i] = conj(m->mode[k].kappa[i]);
            p->P[(2 * k + 1) * l + i] = conj(m->mode[k].phi[i]);
        }
    for (int b = 0; b < s->count; b++) {
        look(w, m, poles, s, b);
        if (w->glance[b].seen)
            pull_bin(w, m, b, w->glance[b].Z, s->lines[b], w->gradient);
    }
}

/* ---- (2) times a step ---- */

/* The parts of dH = sum left right^T by X that are alike in all bins: kappa, that of the conjugate,
 * d kappa, and its conjugate's; and dM. */
static void push_begin(struct scoring *w, const double *x)
{
    struct pull *p = w->pull;
    int l = w->channels, n = w->J.block[w->count].start;

    for (int k = 0; k < w->count; k++) {
        const double *dk = x + w->J.block[k].start + 2 * l;
        memcpy(p->right + 4 * k * l, p->K + 2 * k * l, sizeof *p->K * 2 * l);
        for (int i = 0; i < l; i++) {
            p->right[(4 * k + 2) * l + i] = CMPLX(dk[i], dk[l + i]);
            p->right[(4 * k + 3) * l + i] = CMPLX(dk[i], -dk[l + i]);
        }
    }
    memset(p->root, 0, sizeof p->root);
    for (int c = 0; c < l; c++)
        for (int r = c; r < l; r++)
            p->root[r + l * c] = x[n++];
}

/* The other parts: d(f phi), that of the conjugate, f phi and its conjugate's. */
static void push_mode(struct scoring *w, const struct whittle *m, int k, const double complex *f,
                      const double *x)
{
    const struct whittle_mode *q = &m->mode[k];
    int l = w->channels, n = 2;
    double complex *left = w->pull->left + 4 * k * l,
                   turn = CMPLX(creal(q->lambda) * x[0], x[1]),
                   df = f[SLOPE] * turn, dh = f[SLOPE_CONJUGATE] * conj(turn);

    for (int i = 0; i < l; i++) {
        double complex p = q->phi[i], d = 0;
        if (i != w->pivot[k])
            d = CMPLX(x[n], x[n + l - 1]), n++;
        left[i] = f[F] * d + df * p;
        left[l + i] = f[F_CONJUGATE] * conj(d) + dh * conj(p);
        left[2 * l + i] = f[F] * p;
        left[3 * l + i] = f[F_CONJUGATE] * conj(p);
    }
}

/* S^-1 dS S^-1 of bin B by X. */
static void push_bin(struct scoring *w, const struct whittle *m, int b, const double *x,
                     double complex *Z)
{
    const double complex one = 1, zero = 0;
    const struct glance *g = &w->glance[b];
    struct pull *p = w->pull;
    double complex dH[L * L] = { 0 }, T[L * L];
    int l = w->channels;

    for (int k = 0; k < w->count; k++)
        push_mode(w, m, k, w->peak[(size_t)b * m->count + k], x + w->J.block[k].start);
    if (w->count > 0)
        cblas_zgemm(CblasColMajor, CblasNoTrans, CblasTrans, l, l, 4 * w->count, &one, p->left, l,
                    p->right, l, &zero, dH, l);
    /* dH (H R)^H + H dM (H M)^H, and its adjoint */
    cblas_zgemm(CblasColMajor, CblasNoTrans, CblasConjTrans, l, l, l, &one, dH, l,
                g->shared + WHITTLE_HR * l * l, l, &zero, T, l);
    cblas_zgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, l, l, l, &one,
                g->shared + WHITTLE_H * l * l, l, p->root, l, &zero, dH, l);
    cblas_zgemm(CblasColMajor, CblasNoTrans, CblasConjTrans, l, l, l, &one, dH, l,
                g->shared + WHITTLE_HM * l * l, l, &one, T, l);
    for (int c = 0; c < l; c++)
        for (int r = 0; r < l; r++)
            Z[r + l * c] = T[r + l * c] + conj(T[c + l * r]);
    cblas_ztrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, l, l, &one, g->C,
                l, Z, l);
    cblas_ztrsm(CblasColMajor, CblasRight, CblasLower, CblasConjTrans, CblasNonUnit, l, l, &one,
                g->C, l, Z, l);
    whiten_again(l, g->C, Z);
}

/* OUT = J x, whole. */
static void multiply(struct scoring *w, const struct whittle *m, const struct bins *s,
                     const double *x, double *out)
{
    double complex Z[L * L];

    w->work += LOOKS * whittle_work(m, s);
    memset(out, 0, sizeof *out * (size_t)w->unknowns);
    push_begin(w, x);
    for (int b = 0; b < s->count; b++)
        if (w->glance[b].seen) {
            push_bin(w, m, b, x, Z);
            pull_bin(w, m, b, Z, s->lines[b], out);
        }
}

/* ---- (2) ---- */

/* The vectors of mode K in bin B, of place A among those of it, after C^-1, and how its exponent's
 * unknowns, the log decay and the turn, are made of them. */
static void list_mode(struct scoring *w, const struct whittle *m, int k, int a, int b)
{
    const struct whittle_mode *q = &m->mode[k];
    const double complex *peak = w->peak[(size_t)b * m->count + k];
    int l = m->channels, first = SHARED * l + OWN * a;
    double complex f = peak[F], h = peak[F_CONJUGATE], *V = w->V + (size_t)first * l;
    const double complex *HR = w->glance[b].shared + (size_t)WHITTLE_HR * l * l;
    double complex turn[2] = { creal(q->lambda), I };    /* d lambda: by the log decay, the turn */

    for (int i = 0; i < l; i++) {
        double complex p = q->phi[i], x = 0, y = 0;      /* H R kappa, H R of its conjugate */
        for (int c = 0; c < l; c++) {
            x += HR[i + l * c] * q->kappa[c];
            y += HR[i + l * c] * conj(q->kappa[c]);
        }
        V[i + l * V_SR] = conj(f) * y + conj(h) * x;
        V[i + l * V_SI] = -I * conj(f) * y + I * conj(h) * x;
        V[i + l * V_QR] = f * p + h * conj(p);
        V[i + l * V_QI] = I * f * p - I * h * conj(p);
        V[i + l * V_PHI] = p, V[i + l * V_PHIC] = conj(p);
        V[i + l * V_K] = x, V[i + l * V_KC] = y;
    }
    whiten(l, w->glance[b].C, V, OWN);
    for (int part = 0; part < 2; part++)
        w->exponent[2 * a + part] = (struct pairs) {
            { first + V_PHI, first + V_PHIC }, { first + V_KC, first + V_K },
            { peak[SLOPE] * turn[part], peak[SLOPE_CONJUGATE] * conj(turn[part]) } };
}

/* The runs of mode K, of place A: its phi without the pivot and its kappa, real parts first. */
static int list_runs(const struct scoring *w, int k, int a, struct run *runs)
{
    int l = w->channels, at = SHARED * l + OWN * a, p = w->pivot[k], u = 2, n = 0;

    for (int part = 0; part < 2; part++) {
        runs[n++] = (struct run) { k, u, p, WHITTLE_UNITS * l, at + V_SR + part };
        u += p;
        runs[n++] = (struct run) { k, u, l - 1 - p, WHITTLE_UNITS * l + p + 1, at + V_SR + part };
        u += l - 1 - p;
    }
    for (int part = 0; part < 2; part++, u += l)
        runs[n++] = (struct run) { k, u, l, WHITTLE_HR * l, at + V_QR + part };
    return n;
}

/* Re(conj(u) v), without a look at infinities. */
static inline double real_part(double complex u, double complex v)
{
    return creal(u) * creal(v) + cimag(u) * cimag(v);
}

/* The block of J of two runs, without the lines: with G = V^H V,
 * 2 Re(conj(G_jf) G_hi + conj(G_hf) G_ji) for v_i f^H and v_j h^H. */
static void add_block(struct scoring *w, int v, const struct run *p, const struct run *q,
                      double lines)
{
    const double complex *f = w->G + (size_t)v * p->fixed + q->vary;
    double complex hf = w->G[q->fixed + (size_t)v * p->fixed];

    for (int i = 0; i < p->count; i++) {
        const double complex *a = w->G + (size_t)v * (p->vary + i), *ja = a + q->vary;
        double complex hi = a[q->fixed];
        double *J = envelope_entry(&w->J, q->block, q->first, p->block, p->first + i);
        for (int j = 0; j < q->count; j++)
            J[j] += 2 * lines * (real_part(f[j], hi) + real_part(hf, ja[j]));
    }
}

/* The unknown PART of mode K's exponent with a run: 2 Re(c conj(G_xb) G_ya + c conj(G_yb) G_xa) for
 * c a b^H and x y^H. */
static void add_exponent(struct scoring *w, int v, int k, int part, const struct pairs *p,
                         const struct run *q, double lines)
{
    bool below = q->block >= k;
    double *J = below ? envelope_entry(&w->J, q->block, q->first, k, part)
                      : envelope_entry(&w->J, k, part, q->block, q->first);
    int stride = below ? 1 : w->J.block[k].rows;

    for (int i = 0; i < PAIRS; i++) {
        const double complex *Ga = w->G + (size_t)v * p->a[i], *Gb = w->G + (size_t)v * p->b[i];
        double complex s = 2 * lines * p->c[i] * Ga[q->fixed],
                       t = conj(2 * lines * p->c[i] * conj(Gb[q->fixed]));
        for (int j = 0; j < q->count; j++)
            J[j * stride] += real_part(Gb[q->vary + j], s)
                             + real_part(t, Ga[q->vary + j]);
    }
}

/* Those of two exponents: 2 Re(c d conj(G_xb) G_ya + c conj(d) conj(G_yb) G_xa) for c a b^H and
 * d x y^H. */
static double product(const struct scoring *w, int v, const struct pairs *p, const struct pairs *q)
{
    double sum = 0;

    for (int i = 0; i < PAIRS; i++)
        for (int j = 0; j < PAIRS; j++) {
            const double complex *Ga = w->G + (size_t)v * p->a[i], *Gb = w->G + (size_t)v * p->b[i];
            int x = q->a[j], y = q->b[j];
            double complex c = p->c[i], d = q->c[j];
            sum += 2 * creal(c * (d * conj(Gb[x]) * Ga[y] + conj(d) * conj(Gb[y]) * Ga[x]));
        }
    return sum;
}

/* All of a bin between the modes that it tells of. */
static void add_bin(struct scoring *w, const int *mode, int count, double lines)
{
    int l = w->channels, v = SHARED * l + OWN * count, n = 0;

    for (int a = 0; a < count; a++)
        n += list_runs(w, mode[a], a, w->runs + n);
    for (int c = 0, u = 0; c < l; u += l - c, c++)
        w->runs[n++] = (struct run) { w->count, u, l - c, WHITTLE_H * l + c, WHITTLE_HM * l + c };
    for (int i = 0; i < n; i++)
        for (int j = i; j < n; j++)
            add_block(w, v, &w->runs[i], &w->runs[j], lines);
    for (int e = 0; e < 2 * count; e++) {
        for (int j = 0; j < n; j++)
            add_exponent(w, v, mode[e / 2], e % 2, &w->exponent[e], &w->runs[j], lines);
        for (int d = 0; d <= e; d++)
            *envelope_entry(&w->J, mode[e / 2], e % 2, mode[d / 2], d % 2)
                += lines * product(w, v, &w->exponent[e], &w->exponent[d]);
    }
}

/* Of a mode alone, with itself. */
static void add_alone(struct scoring *w, int k, double lines)
{
    int v = SHARED * w->channels + OWN, n = list_runs(w, k, 0, w->runs);

    for (int i = 0; i < n; i++)
        for (int j = i; j < n; j++)
            add_block(w, v, &w->runs[i], &w->runs[j], lines);
    for (int e = 0; e < 2; e++) {
        for (int j = 0; j < n; j++)
            add_exponent(w, v, k, e, &w->exponent[e], &w->runs[j], lines);
        for (int d = 0; d <= e; d++)
            *envelope_entry(&w->J, k, e, k, d)
                += lines * product(w, v, &w->exponent[e], &w->exponent[d]);
    }
}

/* The Gram matrix of the first V vectors, from column FROM on, and its rows from there. */
static void gram(struct scoring *w, int v, int from)
{
    const double complex one = 1, zero = 0;
    int l = w->channels;

    cblas_zgemm(CblasColMajor, CblasConjTrans, CblasNoTrans, v, v - from, l, &one, w->V, l,
                w->V + (size_t)from * l, l, &zero, w->G + (size_t)from * v, v);
    for (int c = 0; c < from; c++)
        for (int r = from; r < v; r++)
            w->G[r + (size_t)v * c] = conj(w->G[c + (size_t)v * r]);
}

static void inform_bin(struct scoring *w, const struct whittle *m, const struct bins *s, int b)
{
    const struct glance *g = &w->glance[b];
    const bool *tells = w->tells + (size_t)w->count * b;
    int l = m->channels, fixed = SHARED * l, count = 0, mode[MODES];

    memcpy(w->V, g->shared, sizeof *w->V * (size_t)(fixed * l));
    whiten(l, g->C, w->V, fixed);
    for (int k = 0; k < w->count; k++)
        if (tells[k]) {
            list_mode(w, m, k, count, b);
            mode[count++] = k;
        }
    gram(w, fixed + OWN * count, 0);
    add_bin(w, mode, count, s->lines[b]);
    if (w->use == SCORING_ERRORS || count == w->count)
        return;
    gram(w, fixed + OWN, 0);
    for (int k = 0; k < w->count; k++)
        if (!tells[k]) {
            list_mode(w, m, k, 0, b);
            gram(w, fixed + OWN, fixed);
            add_alone(w, k, s->lines[b]);
        }
}

void scoring_inform(struct scoring *w, const struct whittle *m, const struct bins *s)
{
    envelope_clear(&w->J);
    for (int b = 0; b < s->count; b++)
        if (w->glance[b].seen)
            inform_bin(w, m, s, b);
    w->work += w->entries + (double)s->count * w->unknowns * whittle_unknowns_of_mode(m->channels);
    w->factored = NAN;
    for (int k = 0; k <= w->count; k++)
        for (int i = 0; i < w->J.block[k].rows; i++) {
            double d = *envelope_entry(&w->J, k, i, k, i);
            w->scale[w->J.block[k].start + i] = d > 0 ? 1 / sqrt(d) : 0;
        }
}

/* The envelope's answer to r, in the scale of J's diagonal. */
static void precondition(const struct scoring *w, const double *r, double *x)
{
    memcpy(x, r, sizeof *x * (size_t)w->unknowns);
    envelope_forward(&w->J, 0, x);
    envelope_back(&w->J, x);
}

/* image = (J + damping) ahead, in that scale. */
static void multiply_scaled(struct scoring *w, const struct whittle *m, const struct bins *s,
                            double damping, double *room)
{
    int n = w->unknowns;

    for (int i = 0; i < n; i++)
        room[i] = w->scale[i] * w->ahead[i];
    multiply(w, m, s, room, w->image);
    for (int i = 0; i < n; i++)
        w->image[i] = w->image[i] * w->scale[i] + damping * w->ahead[i];
}

bool scoring_step(struct scoring *w, const struct whittle *m, const struct bins *s, double damping,
                  struct scoring_step *out)
{
    int n = w->unknowns;
    double *x = w->step, *r = w->residual, *z = w->preconditioned, first, now, size;

    /* what is less damped than the factor is served by it, for it only begins the solution */
    if (!(damping <= w->factored)) {
        w->factored = NAN;
        if (!envelope_factor(&w->J, w->scale, damping))
            return false;
        w->factored = damping;
    }
    memset(x, 0, sizeof *x * (size_t)n);
    for (int i = 0; i < n; i++)
        r[i] = w->gradient[i] * w->scale[i];
    precondition(w, r, w->ahead);
    first = now = cblas_ddot(n, r, 1, w->ahead, 1);
    for (int i = 0; i < PRODUCTS_MOST && now > ENOUGH * first; i++) {
        double before = now;
        multiply_scaled(w, m, s, damping, z);
        size = now / cblas_ddot(n, w->ahead, 1, w->image, 1);
        cblas_daxpy(n, size, w->ahead, 1, x, 1);
        cblas_daxpy(n, -size, w->image, 1, r, 1);
        precondition(w, r, z);
        now = cblas_ddot(n, r, 1, z, 1);
        cblas_dscal(n, now / before, w->ahead, 1);
        cblas_daxpy(n, 1, z, 1, w->ahead, 1);
    }
    for (int i = 0; i < n; i++)
        x[i] *= w->scale[i];
    out->settled = now <= ENOUGH * first;
    out->promised = cblas_ddot(n, w->gradient, 1, x, 1) / 2;
    return true;
}

void scoring_move(const struct scoring *w, const struct bins *s, struct whittle *m)
{
    int l = m->channels, n = 0;
    const double *x = w->step;
    double most = 0, part;

    for (int k = 0; k < m->count; k++)
        most = fmax(most, fabs(x[w->J.block[k].start]));
    part = most > LOG_STEP ? LOG_STEP / most : 1;
    for (int k = 0; k < m->count; k++) {
        struct whittle_mode *q = &m->mode[k];
        q->lambda = CMPLX(fmin(creal(q->lambda) * exp(part * x[n]),
                               -WHITTLE_DECAY_LEAST / s->samples),
                          remainder(cimag(q->lambda) + part * x[n + 1], 2 * M_PI));
        n += 2;
        for (int i = 0; i < l; i++)
            if (i != w->pivot[k])
                q->phi[i] += part * CMPLX(x[n], x[n + l - 1]), n++;
        n += l - 1;
        for (int i = 0; i < l; i++, n++)
            q->kappa[i] += part * CMPLX(x[n], x[n + l]);
        n += l;
    }
    for (int c = 0; c < l; c++)
        for (int r = c; r < l; r++, n++)
            m->root[r + l * c] += part * x[n];
}

/* Of an exponent's unknown, v = |F^-1 e|^2 with the factor F of J. */
void scoring_errors(struct scoring *w, struct whittle *m)
{
    bool known = envelope_factor(&w->J, w->scale, 0);

    /* what cannot be told at all, like the turn of a pair on the axis, is held where it is, by no
     * more than half of the digits */
    for (double held = HELD_FIRST; !known && held <= REFINE_HALVED; held *= HELD_FACTOR)
        known = envelope_factor(&w->J, w->scale, held);
    for (int k = 0; k < m->count; k++) {
        struct whittle_mode *q = &m->mode[k];
        double std[2] = { NAN, NAN };
        int at = w->J.block[k].start;
        for (int part = 0; part < 2 && known; part++) {
            memset(w->step, 0, sizeof *w->step * (size_t)w->unknowns);
            w->step[at + part] = w->scale[at + part];
            envelope_forward(&w->J, k, w->step);
            std[part] = cblas_dnrm2(w->unknowns - at, w->step + at, 1);
        }
        q->std_decay = -creal(q->lambda) * std[0];
        q->std_turn = std[1];
    }
}
