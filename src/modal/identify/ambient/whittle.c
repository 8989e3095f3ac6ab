/*
 * whittle.c - the likelihood of a spectral matrix
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
 *     log p = - sum_b n_b (log det S_b + tr S_b^-1 I_b).                                       (4)
 *
 * A bin's S = W W^H is near S = C C^H at its middle: for a while it is
 * taken as T S T^H with a constant T = W C^-1, which in (4) is the same as S itself and
 * T^-1 I T^-H in place of I, seen[] (whittle_correct); then T is found anew.  Where forces are
 * fewer than channels and noise is little, S is nearly singular and (4) would be ruled by what S
 * has least, (2) and the width of bins.  A share FLOOR of each bin's energy, added to S and I alike
 * (add_floor), keeps (4) to what is told: the mean of I is S still.
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
#include "modal/numbers.h"

enum {
    L = WHITTLE_CHANNELS_MOST,
    WORK_CHANNEL = 200,          /* of a bin, measured with 1 to 12 channels and 3 to 60 modes: */
    WORK_SHAPE = 4               /* a channel, and what each mode does to it */
};

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
    double decay = fmax(-creal(q->lambda) - 1. / samples, WHITTLE_DECAY_LEAST / samples);

    return CMPLX(-decay, fabs(cimag(q->lambda)));
}

/* ---- the model ---- */

void whittle_poles(const struct whittle *m, double complex *poles)
{
    for (int k = 0; k < m->count; k++)
        poles[k] = cexp(m->mode[k].lambda);
}

struct whittle_peak whittle_peak(double complex pole, double complex z)
{
    double complex from = z - pole;
    double square = numbers_square(from);
    double complex u = CMPLX(creal(from) / square, -cimag(from) / square);

    return (struct whittle_peak) { u, pole * u * u };
}

double whittle_middle(const struct bins *s, int b)
{
    return (s->from[b] + s->to[b]) / 2;
}

/* f, its mean over bin B. */
static double complex mean_peak(double complex lambda, const struct bins *s, int b)
{
    double complex mu = cexp(lambda), z1 = cexp(CMPLX(0, s->from[b])),
                   z2 = cexp(CMPLX(0, s->to[b]));

    return s->lines[b] == 1 ? whittle_peak(mu, cexp(CMPLX(0, whittle_middle(s, b)))).f
                            /* the integral of 1 / (e^{iw} - mu) in closed form: a bin as wide as
                             * the peak hides nothing of it */
                            : clog((1 - mu / z2) / (1 - mu / z1)) / (I * mu)
                                  / (s->to[b] - s->from[b]);
}

/* S + the sum over modes of f[0] phi right^T and f[1] of their conjugates. */
static void add_pairs(const struct whittle *m, double complex (*f)[2],
                      const double complex *const *right, double complex *S)
{
    const double complex one = 1;
    double complex A[2 * WHITTLE_MODES_MOST * L], B[2 * WHITTLE_MODES_MOST * L];
    int l = m->channels;

    for (int k = 0; k < m->count; k++)
        for (int i = 0; i < l; i++) {
            double complex a = m->mode[k].phi[i], b = right[k][i];
            A[2 * k * l + i] = a * f[k][0], A[(2 * k + 1) * l + i] = conj(a) * f[k][1];
            B[2 * k * l + i] = b, B[(2 * k + 1) * l + i] = conj(b);
        }
    if (m->count > 0)
        cblas_zgemm(CblasColMajor, CblasNoTrans, CblasTrans, l, l, 2 * m->count, &one, A, l, B, l,
                    &one, S, l);
}

/* H of (1) at w. */
static void transfer_of(const struct whittle *m, const double complex *poles, double w,
                        double complex *H)
{
    double complex f[WHITTLE_MODES_MOST][2], z = cexp(CMPLX(0, w));
    const double complex *right[WHITTLE_MODES_MOST];
    int l = m->channels;

    for (int i = 0; i < l * l; i++)
        H[i] = i % (l + 1) == 0;
    for (int k = 0; k < m->count; k++) {
        f[k][0] = whittle_peak(poles[k], z).f;
        f[k][1] = whittle_peak(conj(poles[k]), z).f;
        right[k] = m->mode[k].kappa;
    }
    add_pairs(m, f, right, H);
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

void whittle_transfers(const struct whittle *m, const double complex *poles, double w,
                       double complex *V)
{
    int l = m->channels, block = l * l;

    memset(V, 0, sizeof *V * block);
    for (int i = 0; i < l; i++)
        V[i + l * i] = 1;
    transfer_of(m, poles, w, V + WHITTLE_H * block);
    transfer_times_root(m, V + WHITTLE_H * block, V + WHITTLE_HM * block);
    for (int c = 0; c < l; c++)
        for (int r = 0; r < l; r++) {
            V[WHITTLE_HR * block + r + l * c] = 0;
            for (int i = 0; i <= c; i++)
                V[WHITTLE_HR * block + r + l * c]
                    += V[WHITTLE_HM * block + r + l * i] * m->root[c + l * i];
        }
}

/* S of (1) at w. */
static void spectrum_at(const struct whittle *m, const double complex *poles, double w,
                        double complex *S)
{
    const double complex one = 1, zero = 0;
    double complex H[L * L], HM[L * L];
    int l = m->channels;

    transfer_of(m, poles, w, H);
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
    double complex X[L * L] = { 0 }, f[WHITTLE_MODES_MOST][2];
    const double complex *right[WHITTLE_MODES_MOST];
    int l = m->channels;

    for (int k = 0; k < m->count; k++) {
        f[k][0] = mean_peak(m->mode[k].lambda, s, b);
        f[k][1] = mean_peak(conj(m->mode[k].lambda), s, b);
        right[k] = v->g[k];
    }
    add_pairs(m, f, right, X);
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
static void correct_bin(const struct whittle *m, const double complex *poles,
                        const struct whittle_covariances *v, const struct bins *s, int b,
                        double complex *seen)
{
    const double complex one = 1;
    double complex C[L * L], W[L * L], E[L * L];
    int l = m->channels;

    spectrum_at(m, poles, whittle_middle(s, b), C);
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
    double complex poles[WHITTLE_MODES_MOST];
    int l = m->channels;

    whittle_covariances(m, &v);
    whittle_poles(m, poles);
    for (int b = 0; b < s->count; b++) {
        double complex *seen = s->seen + (size_t)b * l * l;
        memcpy(seen, s->mean + (size_t)b * l * l, sizeof *seen * l * l);
        add_floor(s, b, seen);
        if (s->lines[b] > 1)
            correct_bin(m, poles, &v, s, b, seen);
    }
}

double whittle_residual(const struct whittle *m, const double complex *poles,
                        const struct bins *s, int b, double complex *C, double complex *E)
{
    double determinant;
    int l = m->channels;

    spectrum_at(m, poles, whittle_middle(s, b), C);
    add_floor(s, b, C);
    determinant = factor(l, C);
    if (isnan(determinant))
        return NAN;
    whiten(l, C, s->seen + (size_t)b * l * l, E);
    for (int i = 0; i < l; i++)
        E[i + l * i] -= 1;
    return determinant;
}

double whittle_work(const struct whittle *m, const struct bins *s)
{
    return (double)s->count * m->channels * (WORK_CHANNEL + WORK_SHAPE * m->count);
}

double whittle_likelihood(const struct whittle *m, const struct bins *s)
{
    double complex C[L * L], E[L * L], poles[WHITTLE_MODES_MOST];
    double sum = 0;
    int l = m->channels;

    whittle_poles(m, poles);
    for (int b = 0; b < s->count; b++) {
        double each = whittle_residual(m, poles, s, b, C, E) + l;
        for (int i = 0; i < l; i++)
            each += creal(E[i + l * i]);
        sum -= s->lines[b] * each;
    }
    return isfinite(sum) ? sum : -HUGE_VAL;
}
