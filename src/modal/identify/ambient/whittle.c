/*
 * whittle.c - Fisher scoring on the likelihood of a spectral matrix
 *
 * A linear system driven by white noise that nobody measured, seen through l channels with noise
 * of their own, whatever the hold of its samples, has one innovations form [Kai68], in modal
 * coordinates
 *
 *     S(w) = H R H^H,    H = 1 + sum_k phi_k kappa_k^T f(mu_k) + its conjugate poles',          (1)
 *
 * mu = exp(lambda), f = 1 / (z - mu), z = exp(iw), R = M M^T with a lower triangle M.  So many
 * unknowns as a system of that order has, no more: 4 l a pair (phi kappa^T has no scale of its
 * own: the largest entry of phi stays), and l (l + 1) / 2.  Whatever they are, S is positive: a
 * form that is not lets the likelihood grow without end where a bin holds fewer lines than there
 * are channels.
 *
 * A record of N samples is taken as if it repeated.  With z^N = 1 and its state x_0 at the
 * beginning, x_N at the end, its transform is H times that of the innovations and
 *
 *     C (z - A)^-1 z (x_0 - x_N),                                                              (2)
 *
 * the answer to one jump: an excitation as flat as the others, and by it no pole more.  A window
 * would make the jump a short random motion instead, seen at many lines alike, which fills the
 * directions that no force drives and looks like poles.  But x_N knows the innovations before it:
 * the covariances R_0, C A^(j-1) G are weighted by 1 - j/N, or exp(-j/N) for the lags that
 * matter, so each pole is found to decay by 1/N faster than it does (whittle_exponent).
 *
 * A bin's mean of S is an integral in closed form, for -i/mu log(1 - mu/z) is an antiderivative of
 * f: bins may be as wide as a part of a peak without a bias.  S = R_0 + X + X^H, X the sum of
 * phi_k g_k^T f(mu_k) and their conjugates', and G and R_0 follow from (1):
 *
 *     P = A P A^H + K R K^H,   G = A P C^H + K R,   R_0 = C P C^H + R.                          (3)
 *
 * The coefficients at different lines are nearly independent, complex Gaussian [Whi53]: with I the
 * mean of n lines
 *
 *     log p = - sum_b n_b (log det S_b + tr S_b^-1 I_b),                                       (4)
 *     d log p = sum_b n_b tr(S^-1 (I - S) S^-1 dS),                                            (5)
 *     J_ij = sum_b n_b tr(S^-1 dS_i S^-1 dS_j),                                                (6)
 *
 * J the information.  A bin's S = W W^H is near S = C C^H at its middle: for a while it is
 * taken as T S T^H with a constant T = W C^-1, which in (4) is the same as S itself and
 * T^-1 I T^-H in place of I, seen[] (whittle_correct); then T is found anew.  Where forces are
 * fewer than channels and noise is little, S is nearly singular and (4) would be ruled by what S
 * has least, (2) and the width of bins.  A share FLOOR of each bin's energy, added to S and I alike
 * (add_floor), keeps (4) to what is told: the mean of I is S still.  Every dS is
 * c a b^H + its adjoint, or a sum of two such, with vectors a, b from a short list; after C^-1, (6)
 * needs their Gram matrix only, which makes a bin's cost that of J's entries, not times l^2.  Steps
 * are damped after Levenberg and Marquardt in the scale of J's diagonal.
 *
 * [Kai68] Kailath, IEEE Trans. AC 13 (1968) 646-655.  [Whi53] Whittle, Ark. Mat. 2 (1953) 423-434.
 *
 * Tested by tests/unit/modal/identify/test_ambient.c.
 */
#include "modal/identify/ambient/whittle.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"

enum { L = WHITTLE_CHANNELS_MOST, OWN = 8, SHARED = 4, PAIRS = 2,
       STEPS_BLIND = 2 };         /* the first is damped: it tells little of what may be had */
/* The vectors of all modes, channels of each: units, H R e_j, H e_i, H M e_j; and those of a
 * mode, in this order after them. */
enum { V_UNIT, V_HR, V_H, V_HM };
enum { V_SR, V_SI, V_QR, V_QI, V_PHI, V_PHIC, V_K, V_KC };
static const double
    DAMPING_FIRST = 1e-3,        /* of Levenberg and Marquardt, in the scale of J's diagonal */
    DAMPING_MOST = 1e8,          /* no step gains: the summit, to rounding */
    DAMPING_LEAST = 1e-12,       /* as good as none */
    HELD_FIRST = 1e-14,          /* what holds an unknown that nothing tells, in that scale; */
    HELD_FACTOR = 100,           /* more, until the information has a factor, */
    HELD_MOST = 1e-8,            /* and no more than half of the digits */
    DECAY_LEAST = 0.1,           /* over the record: what is slower is a line, whatever it is */
    HOPE = 10,                   /* steps like the last: what gains less by a tenth each sums to */
    LOG_STEP = 1;                /* of a decay rate's logarithm in one step: a factor of e */

int whittle_unknowns_of_mode(int channels)
{
    return 4 * channels;
}

int whittle_unknowns(const struct whittle *m)
{
    return m->count * whittle_unknowns_of_mode(m->channels) + m->channels * (m->channels + 1) / 2;
}

double complex whittle_exponent(const struct whittle_mode *q, int samples)
{
    /* a record that repeats shows each pole as decaying by 1/N faster */
    double decay = fmax(-creal(q->lambda) - 1. / samples, DECAY_LEAST / samples);

    return CMPLX(-decay, fabs(cimag(q->lambda)));
}

/* ---- the model ---- */

struct peak { double complex f, slope; };        /* f, and its derivative by lambda */

static struct peak peak_at(double complex lambda, double w)
{
    /* a pole at mu, seen from the circle at e^{iw} */
    double complex mu = cexp(lambda), u = 1 / (cexp(CMPLX(0, w)) - mu);

    return (struct peak) { u, mu * u * u };
}

static double middle_of(const struct bins *s, int b)
{
    return (s->from[b] + s->to[b]) / 2;
}

/* f, its mean over bin B. */
static double complex mean_peak(double complex lambda, const struct bins *s, int b)
{
    double complex mu = cexp(lambda), z1 = cexp(CMPLX(0, s->from[b])),
                   z2 = cexp(CMPLX(0, s->to[b]));

    return s->lines[b] == 1 ? peak_at(lambda, middle_of(s, b)).f
                            /* the integral of 1 / (e^{iw} - mu) in closed form: a bin as wide as
                             * the peak hides nothing of it */
                            : clog((1 - mu / z2) / (1 - mu / z1)) / (I * mu)
                                  / (s->to[b] - s->from[b]);
}

static void add_outer(double complex *S, int l, double complex f, const double complex *a,
                      const double complex *b, bool conjugate)
{
    for (int c = 0; c < l; c++)
        for (int r = 0; r < l; r++)
            S[r + l * c] += f * (conjugate ? conj(a[r] * b[c]) : a[r] * b[c]);
}

/* H of (1) at w. */
static void transfer_of(const struct whittle *m, double w, double complex *H)
{
    int l = m->channels;

    for (int i = 0; i < l * l; i++)
        H[i] = i % (l + 1) == 0;
    for (int k = 0; k < m->count; k++) {
        const struct whittle_mode *q = &m->mode[k];
        add_outer(H, l, peak_at(q->lambda, w).f, q->phi, q->kappa, false);
        add_outer(H, l, peak_at(conj(q->lambda), w).f, q->phi, q->kappa, true);
    }
}

/* H M. */
static void transfer_times_root(const struct whittle *m, const double complex *H,
                                double complex *HM)
{
    int l = m->channels;

    for (int c = 0; c < l; c++)
        for (int r = 0; r < l; r++) {
            HM[r + l * c] = 0;
            for (int i = c; i < l; i++)
                HM[r + l * c] += H[r + l * i] * m->root[i + l * c];
        }
}

/* S of (1) at w. */
static void spectrum_at(const struct whittle *m, double w, double complex *S)
{
    const double complex one = 1, zero = 0;
    double complex H[L * L], HM[L * L];
    int l = m->channels;

    transfer_of(m, w, H);
    transfer_times_root(m, H, HM);
    cblas_zgemm(CblasColMajor, CblasNoTrans, CblasConjTrans, l, l, l, &one, HM, l, HM, l, &zero, S,
                l);
}

/* ---- (3) ---- */

/* kappa^T M of pole j: modes first, then their conjugates. */
static void drive_of(const struct whittle *m, int j, double complex *d)
{
    int l = m->channels, k = j % m->count;

    for (int c = 0; c < l; c++) {
        double complex sum = 0;
        for (int i = c; i < l; i++)
            sum += m->mode[k].kappa[i] * m->root[i + l * c];
        d[c] = j < m->count ? sum : conj(sum);
    }
}

/* Row k of P C^H, of a mode. */
static void row_of(const struct whittle *m, int k, double complex *row)
{
    double complex own[L], other[L];
    int l = m->channels;

    drive_of(m, k, own);
    memset(row, 0, sizeof *row * l);
    for (int j = 0; j < 2 * m->count; j++) {
        const struct whittle_mode *q = &m->mode[j % m->count];
        double complex lambda = j < m->count ? conj(q->lambda) : q->lambda, p = 0;
        drive_of(m, j, other);
        for (int c = 0; c < l; c++)
            p += own[c] * conj(other[c]);
        p /= 1 - cexp(m->mode[k].lambda + lambda);
        for (int c = 0; c < l; c++)
            row[c] += p * (j < m->count ? conj(q->phi[c]) : q->phi[c]);
    }
}

void whittle_covariances(const struct whittle *m, struct whittle_covariances *out)
{
    int l = m->channels;
    double complex d[L], row[L];

    for (int c = 0; c < l; c++)
        for (int r = 0; r < l; r++) {
            out->zero[r + l * c] = 0;
            for (int i = 0; i <= (r < c ? r : c); i++)
                out->zero[r + l * c] += m->root[r + l * i] * m->root[c + l * i];
        }
    for (int k = 0; k < m->count; k++) {
        const struct whittle_mode *q = &m->mode[k];
        row_of(m, k, row);
        drive_of(m, k, d);
        for (int c = 0; c < l; c++) {
            out->g[k][c] = cexp(q->lambda) * row[c];
            for (int i = 0; i <= c; i++)
                out->g[k][c] += d[i] * m->root[c + l * i];
            out->row[k][c] = row[c];
            for (int r = 0; r < l; r++)
                out->zero[r + l * c] += 2 * creal(q->phi[r] * row[c]);
        }
    }
}

void whittle_spectrum(const struct whittle *m, const struct whittle_covariances *v,
                      const struct bins *s, int b, double complex *S)
{
    double complex X[L * L] = { 0 };
    int l = m->channels;

    for (int k = 0; k < m->count; k++) {
        const struct whittle_mode *q = &m->mode[k];
        add_outer(X, l, mean_peak(q->lambda, s, b), q->phi, v->g[k], false);
        add_outer(X, l, mean_peak(conj(q->lambda), s, b), q->phi, v->g[k], true);
    }
    for (int c = 0; c < l; c++)
        for (int r = 0; r < l; r++)
            S[r + l * c] = (v->zero[r + l * c] + v->zero[c + l * r]) / 2 + X[r + l * c]
                           + conj(X[c + l * r]);
}

/* S = C C^H, its logarithm of the determinant; NAN where it is not positive. */
static double factor(int l, double complex *S)
{
    double sum = 0;

    if (LAPACKE_zpotrf_work(LAPACK_COL_MAJOR, 'L', l, S, l) != 0)
        return NAN;
    for (int i = 0; i < l; i++)
        sum += 2 * log(creal(S[i + l * i]));
    return sum;
}

/* E = C^-1 A C^-H of a Hermitian A. */
static void whiten(int l, const double complex *C, const double complex *A, double complex *E)
{
    const double complex one = 1;

    memcpy(E, A, sizeof *E * l * l);
    cblas_ztrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, l, l, &one, C, l,
                E, l);
    cblas_ztrsm(CblasColMajor, CblasRight, CblasLower, CblasConjTrans, CblasNonUnit, l, l, &one, C,
                l, E, l);
}

/* The floor of bin B on a spectrum of it. */
static void add_floor(const struct bins *s, int b, double complex *S)
{
    for (int i = 0; i < s->channels; i++)
        S[i + s->channels * i] += s->floor[b];
}

/* T^-1 I T^-H of bin B in place of I; C C^H is S in its middle, W W^H over its width. */
static void correct_bin(const struct whittle *m, const struct whittle_covariances *v,
                        const struct bins *s, int b, double complex *seen)
{
    const double complex one = 1;
    double complex C[L * L], W[L * L], E[L * L];
    int l = m->channels;

    spectrum_at(m, middle_of(s, b), C);
    whittle_spectrum(m, v, s, b, W);
    add_floor(s, b, C), add_floor(s, b, W);
    if (isnan(factor(l, C)) || isnan(factor(l, W)))
        return;
    whiten(l, W, seen, E);
    cblas_ztrmm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, l, l, &one, C, l,
                E, l);
    cblas_ztrmm(CblasColMajor, CblasRight, CblasLower, CblasConjTrans, CblasNonUnit, l, l, &one, C,
                l, E, l);
    memcpy(seen, E, sizeof *seen * l * l);
}

void whittle_correct(const struct whittle *m, struct bins *s)
{
    struct whittle_covariances v;
    int l = m->channels;

    whittle_covariances(m, &v);
    for (int b = 0; b < s->count; b++) {
        double complex *seen = s->seen + (size_t)b * l * l;
        memcpy(seen, s->mean + (size_t)b * l * l, sizeof *seen * l * l);
        add_floor(s, b, seen);
        if (s->lines[b] > 1)
            correct_bin(m, &v, s, b, seen);
    }
}

/* C of S = C C^H in the middle of bin B, and E = C^-1 I C^-H - 1 of what is seen there; the
 * logarithm of det S, NAN where S is not positive. */
static double residual_seen(const struct whittle *m, const struct bins *s, int b,
                            double complex *C, double complex *E)
{
    double determinant;
    int l = m->channels;

    spectrum_at(m, middle_of(s, b), C);
    add_floor(s, b, C);
    determinant = factor(l, C);
    if (isnan(determinant))
        return NAN;
    whiten(l, C, s->seen + (size_t)b * l * l, E);
    for (int i = 0; i < l; i++)
        E[i + l * i] -= 1;
    return determinant;
}

double whittle_likelihood(const struct whittle *m, const struct bins *s)
{
    double complex C[L * L], E[L * L];
    double sum = 0;
    int l = m->channels;

    for (int b = 0; b < s->count; b++) {
        double each = residual_seen(m, s, b, C, E) + l;
        for (int i = 0; i < l; i++)
            each += creal(E[i + l * i]);
        sum -= s->lines[b] * each;
    }
    return isfinite(sum) ? sum : -HUGE_VAL;
}

/* ---- the information ---- */

/* dS = sum of c a b^H + adjoint; a, b: indices of vectors. */
struct unknown { int pairs, a[PAIRS], b[PAIRS]; double complex c[PAIRS]; };

/* Unknowns first .. first + count - 1 whose dS are v_i f^H + f v_i^H, v_i = vary + i. */
struct run { int first, count, vary, fixed; };

struct scoring {
    struct workspace memory;
    int channels, unknowns, vectors;
    int pivot[WHITTLE_MODES_MOST];    /* the entry of phi that stays */
    struct unknown *unknown;
    struct run *runs;                 /* all unknowns but the exponents' */
    int run_count;
    double complex *V, *G, *EV;       /* channels x vectors; their Gram matrix; E V */
    double *J, *gradient, *step, *factor, *scale;
};

static enum modal_status scoring_init(struct scoring *w, const struct whittle *m,
                                      struct modal_error *err)
{
    size_t n = (size_t)whittle_unknowns(m), v = (size_t)(SHARED * m->channels + OWN * m->count);

    *w = (struct scoring) { .channels = m->channels, .unknowns = (int)n, .vectors = (int)v };
    w->unknown = workspace_zeros(&w->memory, n, sizeof *w->unknown);
    w->runs = workspace_zeros(&w->memory, (size_t)(6 * m->count + m->channels),
                              sizeof *w->runs);
    w->V = workspace_zeros(&w->memory, v * (size_t)m->channels, sizeof *w->V);
    w->EV = workspace_zeros(&w->memory, v * (size_t)m->channels, sizeof *w->EV);
    w->G = workspace_zeros(&w->memory, v * v, sizeof *w->G);
    w->J = workspace_zeros(&w->memory, n * n, sizeof *w->J);
    w->factor = workspace_zeros(&w->memory, n * n, sizeof *w->factor);
    w->gradient = workspace_zeros(&w->memory, n, sizeof *w->gradient);
    w->step = workspace_zeros(&w->memory, n, sizeof *w->step);
    w->scale = workspace_zeros(&w->memory, n, sizeof *w->scale);
    return workspace_check(&w->memory, "identify: no memory for the information matrix", err);
}

static int largest(const double complex *x, int n)
{
    int at = 0;

    for (int i = 1; i < n; i++)
        if (cabs(x[i]) > cabs(x[at]))
            at = i;
    return at;
}

/* The unknowns that a bin has no part in: all but those of the exponents, in this order: a mode's
 * log decay and turn, its phi without the pivot and its kappa, each real parts first; then M by
 * columns. */
static void list_unknowns(struct scoring *w, const struct whittle *m)
{
    int l = m->channels, n = 0;

    for (int k = 0; k < m->count; k++) {
        int at = SHARED * l + OWN * k;
        w->pivot[k] = largest(m->mode[k].phi, l);
        n += 2;
        for (int part = 0; part < 2; part++)
            for (int i = 0; i < l; i++)
                if (i != w->pivot[k])
                    w->unknown[n++] = (struct unknown) { 1, { V_UNIT * l + i },
                                                         { at + V_SR + part }, { 1 } };
        for (int part = 0; part < 2; part++)
            for (int i = 0; i < l; i++)
                w->unknown[n++] = (struct unknown) { 1, { at + V_QR + part }, { V_HR * l + i },
                                                     { 1 } };
    }
    for (int c = 0; c < l; c++)
        for (int r = c; r < l; r++)
            w->unknown[n++] = (struct unknown) { 1, { V_H * l + r }, { V_HM * l + c }, { 1 } };
}

/* Vectors of all modes at w. */
static void list_shared(struct scoring *w, const struct whittle *m, double at)
{
    double complex *V = w->V;
    int l = m->channels, block = l * l;

    memset(V, 0, sizeof *V * block);
    for (int i = 0; i < l; i++)
        V[i + l * i] = 1;
    transfer_of(m, at, V + V_H * block);
    transfer_times_root(m, V + V_H * block, V + V_HM * block);
    for (int c = 0; c < l; c++)
        for (int r = 0; r < l; r++) {
            V[V_HR * block + r + l * c] = 0;
            for (int i = 0; i <= c; i++)
                V[V_HR * block + r + l * c] += V[V_HM * block + r + l * i] * m->root[c + l * i];
        }
}

/* The vectors of mode k at w, and how its exponent's unknowns are made of them. */
static void list_mode(struct scoring *w, const struct whittle *m, int k, double at)
{
    const struct whittle_mode *q = &m->mode[k];
    struct peak two[2] = { peak_at(q->lambda, at), peak_at(conj(q->lambda), at) };
    int l = m->channels, first = SHARED * l + OWN * k, n = k * whittle_unknowns_of_mode(l);
    double complex f = two[0].f, h = two[1].f, *V = w->V + (size_t)first * l;
    const double complex *HR = w->V + (size_t)V_HR * l * l;
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
    for (int part = 0; part < 2; part++)
        w->unknown[n + part] = (struct unknown) {
            2, { first + V_PHI, first + V_PHIC }, { first + V_KC, first + V_K },
            { two[0].slope * turn[part], two[1].slope * conj(turn[part]) } };
}

/* Re(conj(u) v), without a look at infinities. */
static inline double real_part(double complex u, double complex v)
{
    return creal(u) * creal(v) + cimag(u) * cimag(v);
}

/* tr of the product of two whitened dS, (6): with G = V^H V,
 * 2 Re(c d conj(G_xb) G_ya + c conj(d) conj(G_yb) G_xa) for pairs c a b^H and d x y^H. */
static double product(const struct scoring *w, const struct unknown *p, const struct unknown *q)
{
    double sum = 0;

    for (int i = 0; i < p->pairs; i++) {
        const double complex *Ga = w->G + (size_t)w->vectors * p->a[i],
                             *Gb = w->G + (size_t)w->vectors * p->b[i];
        for (int j = 0; j < q->pairs; j++) {
            int x = q->a[j], y = q->b[j];
            double complex c = p->c[i], d = q->c[j];
            if (cimag(c) == 0 && cimag(d) == 0)
                sum += 2 * creal(c) * creal(d)
                       * (real_part(Gb[x], Ga[y]) + real_part(Gb[y], Ga[x]));
            else
                sum += 2 * creal(c * (d * conj(Gb[x]) * Ga[y] + conj(d) * conj(Gb[y]) * Ga[x]));
        }
    }
    return sum;
}

/* The block of J of two runs, without the lines: with G = V^H V,
 * 2 Re(conj(G_jf) G_hi + conj(G_hf) G_ji) for v_i f^H and v_j h^H. */
static void add_block(struct scoring *w, const struct run *p, const struct run *q, double lines)
{
    size_t v = (size_t)w->vectors, n = (size_t)w->unknowns;
    const double complex *f = w->G + v * p->fixed + q->vary;
    double complex hf = w->G[q->fixed + v * p->fixed];

    for (int i = 0; i < p->count; i++) {
        const double complex *a = w->G + v * (p->vary + i), *ja = a + q->vary;
        double complex hi = a[q->fixed];
        double *J = w->J + q->first + n * (p->first + i);
        for (int j = 0; j < q->count; j++)
            J[j] += 2 * lines * (real_part(f[j], hi) + real_part(hf, ja[j]));
    }
}

/* The runs of the unknowns other than exponents: the pivot of phi ends one. */
static int list_runs(const struct scoring *w, const struct whittle *m, struct run *runs)
{
    int l = m->channels, n = 0, u = 0;

    for (int k = 0; k < m->count; k++) {
        int at = SHARED * l + OWN * k, p = w->pivot[k];
        u += 2;
        for (int part = 0; part < 2; part++) {
            runs[n++] = (struct run) { u, p, V_UNIT * l, at + V_SR + part };
            u += p;
            runs[n++] = (struct run) { u, l - 1 - p, V_UNIT * l + p + 1, at + V_SR + part };
            u += l - 1 - p;
        }
        for (int part = 0; part < 2; part++, u += l)
            runs[n++] = (struct run) { u, l, V_HR * l, at + V_QR + part };
    }
    for (int c = 0; c < l; u += l - c, c++)
        runs[n++] = (struct run) { u, l - c, V_H * l + c, V_HM * l + c };
    return n;
}

/* An exponent's unknown with all others. */
static void add_exponent(struct scoring *w, int j, double lines)
{
    size_t n = (size_t)w->unknowns;

    for (int i = 0; i < (int)n; i++) {
        size_t at = i > j ? i + n * j : j + n * i;
        if (i >= j || w->unknown[i].pairs == 1)
            w->J[at] += lines * product(w, &w->unknown[j], &w->unknown[i]);
    }
}

static void add_bin(struct scoring *w, double lines)
{
    int l = w->channels, n = w->unknowns;
    double complex dot;

    for (int i = 0; i < w->run_count; i++)
        for (int j = i; j < w->run_count; j++)
            add_block(w, &w->runs[i], &w->runs[j], lines);
    for (int j = 0; j < n; j++) {
        const struct unknown *p = &w->unknown[j];
        if (p->pairs > 1)
            add_exponent(w, j, lines);
        for (int i = 0; i < p->pairs; i++) {                        /* (5) */
            cblas_zdotc_sub(l, w->V + (size_t)p->b[i] * l, 1, w->EV + (size_t)p->a[i] * l, 1, &dot);
            w->gradient[j] += lines * 2 * creal(p->c[i] * dot);
        }
    }
}

/* V of a bin whitened, its Gram matrix, and E V. */
static void whiten_vectors(struct scoring *w, const double complex *C, const double complex *E)
{
    const double complex one = 1, zero = 0;
    int l = w->channels, v = w->vectors;

    cblas_ztrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, l, v, &one, C, l,
                w->V, l);
    cblas_zgemm(CblasColMajor, CblasConjTrans, CblasNoTrans, v, v, l, &one, w->V, l, w->V, l, &zero,
                w->G, v);
    cblas_zgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, l, v, l, &one, E, l, w->V, l, &zero,
                w->EV, l);
}

/* (5) and (6) at M. */
static void inform(struct scoring *w, const struct whittle *m, const struct bins *s)
{
    double complex C[L * L], E[L * L];
    int n = w->unknowns;

    list_unknowns(w, m);
    w->run_count = list_runs(w, m, w->runs);
    memset(w->J, 0, sizeof *w->J * n * n);
    memset(w->gradient, 0, sizeof *w->gradient * n);
    for (int b = 0; b < s->count; b++) {
        if (isnan(residual_seen(m, s, b, C, E)))
            continue;
        list_shared(w, m, middle_of(s, b));
        for (int k = 0; k < m->count; k++)
            list_mode(w, m, k, middle_of(s, b));
        whiten_vectors(w, C, E);
        add_bin(w, s->lines[b]);
    }
    for (int i = 0; i < n; i++) {
        double d = w->J[i + (size_t)n * i];
        w->scale[i] = d > 0 ? 1 / sqrt(d) : 0;
    }
}

/* J scaled to a unit diagonal, plus DAMPING on it, factored; false where it is not positive. */
static bool factor_information(struct scoring *w, double damping)
{
    size_t n = (size_t)w->unknowns;

    for (size_t j = 0; j < n; j++) {
        for (size_t i = j; i < n; i++)
            w->factor[i + n * j] = w->J[i + n * j] * w->scale[i] * w->scale[j];
        w->factor[j + n * j] = 1 + damping;
    }
    return LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'L', (int)n, w->factor, (int)n) == 0;
}

/* ---- the climb ---- */

/* M moved by the step, its decay rates by a factor of exp(LOG_STEP) at most. */
static void move(const struct scoring *w, const struct bins *s, struct whittle *m)
{
    int l = m->channels, n = 0, each = whittle_unknowns_of_mode(l);
    const double *x = w->step;
    double most = 0, part;

    for (int k = 0; k < m->count; k++)
        most = fmax(most, fabs(x[k * each]));
    part = most > LOG_STEP ? LOG_STEP / most : 1;
    for (int k = 0; k < m->count; k++) {
        struct whittle_mode *q = &m->mode[k];
        q->lambda = CMPLX(fmin(creal(q->lambda) * exp(part * x[n]), -DECAY_LEAST / s->samples),
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

/* One step uphill, damped as far as it takes; false where there is none.  *left: what a step that
 * is hardly damped promises, else what it gained. */
static bool step_up(struct scoring *w, struct whittle *m, const struct bins *s, double *damping,
                    double *left)
{
    struct whittle trial;
    double gained;
    int n = w->unknowns;

    for (; *damping < DAMPING_MOST; *damping *= 10) {
        if (!factor_information(w, *damping))
            continue;
        for (int i = 0; i < n; i++)
            w->step[i] = w->gradient[i] * w->scale[i];
        LAPACKE_dpotrs_work(LAPACK_COL_MAJOR, 'L', n, 1, w->factor, n, w->step, n);
        for (int i = 0; i < n; i++)
            w->step[i] *= w->scale[i];
        trial = *m;
        move(w, s, &trial);
        trial.likelihood = whittle_likelihood(&trial, s);
        gained = trial.likelihood - m->likelihood;
        *left = *damping <= DAMPING_FIRST ? cblas_ddot(n, w->gradient, 1, w->step, 1) / 2 : gained;
        if (gained >= 0) {
            *m = trial;
            *damping = fmax(*damping / 10, DAMPING_LEAST);
            return true;
        }
    }
    return false;
}

/* The covariance of each exponent: its two columns of J's inverse. */
static void report_errors(struct scoring *w, struct whittle *m)
{
    int n = w->unknowns, each = whittle_unknowns_of_mode(m->channels);
    bool known = factor_information(w, 0);

    /* what cannot be told at all, like the turn of a pair on the axis, is held where it is */
    for (double held = HELD_FIRST; !known && held <= HELD_MOST; held *= HELD_FACTOR)
        known = factor_information(w, held);

    for (int k = 0; k < m->count; k++) {
        struct whittle_mode *q = &m->mode[k];
        double v[2] = { NAN, NAN };
        int at = k * each;
        for (int part = 0; part < 2 && known; part++) {
            memset(w->step, 0, sizeof *w->step * n);
            w->step[at + part] = w->scale[at + part];
            LAPACKE_dpotrs_work(LAPACK_COL_MAJOR, 'L', n, 1, w->factor, n, w->step, n);
            v[part] = w->step[at + part] * w->scale[at + part];
        }
        q->std_decay = -creal(q->lambda) * sqrt(v[0]);
        q->std_turn = sqrt(v[1]);
    }
}

enum modal_status whittle_fit(struct whittle *m, const struct bins *s,
                              const struct whittle_limits *limits, struct modal_error *err)
{
    struct scoring w;
    enum modal_status rc = scoring_init(&w, m, err);
    double damping = DAMPING_FIRST, left = HUGE_VAL;

    m->converged = false;
    if (rc == MODAL_OK)
        m->likelihood = whittle_likelihood(m, s);
    for (m->steps = 0; rc == MODAL_OK && m->steps < limits->most && !m->converged
                           && *limits->work > 0
                           && (m->steps < STEPS_BLIND
                               || m->likelihood + HOPE * left > limits->needed); m->steps++) {
        if (limits->cancelled != NULL && limits->cancelled(limits->context))
            rc = modal_fail(err, MODAL_CANCELLED, "identify: cancelled");
        inform(&w, m, s);
        *limits->work -= s->count * (double)w.unknowns * w.unknowns;
        m->converged = !step_up(&w, m, s, &damping, &left) || left < limits->gain;
    }
    if (rc == MODAL_OK && limits->errors && m->converged) {
        inform(&w, m, s);
        report_errors(&w, m);
    }
    workspace_free(&w.memory);
    return rc;
}
