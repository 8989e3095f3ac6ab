/*
 * subspace.c - canonical correlations of past and future
 *
 * With Y- = (y(t-1), y(t-2), ..), Y+ = (y(t), y(t+1), ..), their covariances T-, T+ = L L^T and
 * H = E Y+ Y-^T, the singular value decomposition L+^-1 H L-^-T = U s V^T gives the state
 * x = V^T L-^-1 Y-, of covariance 1, and regressions on it, of y(t), and of x(t+1) on x and y,
 * the innovations form
 *
 *     y = C x + e,   x(t+1) = A x + K e,   R = E e e^T = E y y^T - C C^T,                     (1)
 *     K = (E x(t+1) y^T - A C^T) R^-1,
 *
 * all from covariances.  Those are taken from the lines, as of a record that repeats: they are
 * those of some stationary process, so that every A is stable and every R positive, whatever the
 * order, without a Riccati equation.  For a long past (1) is as good as likelihood [Bau05].
 *
 * [Bau05] Bauer, Journal of Econometrics 125 (2005) 47-80.
 */
#include <fftw3.h>       /* before complex.h, which makes its numbers the compiler's */
#include "modal/identify/ambient/subspace.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/linalg/eigen.h"
#include "modal/linalg/svd.h"

enum {
    LAGS_MOST = 100,             /* in a past */
    LAGS_LEAST = 2,              /* in a past: it is told by what a sample changes */
    SAMPLES_EACH = 8,            /* of the record for each row of H at least */
    ORDER_MOST = 2 * WHITTLE_MODES_MOST,     /* two poles a mode */
    RIDGES = 8                   /* that are tried: none, and RIDGE_FIRST to 1e-7 */
};
static const double
    RIDGE_FIRST = 1e-13,         /* of unit variance: white noise added where rounding is more */
    RIDGE_FACTOR = 10,           /* from one to the next */
    BESIDE = 0.5;                /* of its decay rate: how far a real pole's pair turns */

void subspace_done(struct subspace *s)
{
    free(s->A), free(s->C), free(s->M), free(s->zero);
    memset(s, 0, sizeof *s);
}

struct work {
    const struct spectrum *s;
    int l, lags, side;           /* side = l lags */
    double *R;                   /* l x l each, lag 0 .. 2 lags */
    double *H, *past, *future, *next;     /* side x side */
    double *VT, *U, *singular;
    double *K;                   /* order x side: x = K Y- */
    double *KT;                  /* order x side: K next */
};

static void work_done(struct work *w)
{
    free(w->R), free(w->H), free(w->past), free(w->future), free(w->next);
    free(w->VT), free(w->U), free(w->singular), free(w->K), free(w->KT);
}

static enum modal_status work_init(struct work *w, const struct spectrum *s, int side,
                                   struct modal_error *err)
{
    size_t n;

    *w = (struct work) { .s = s, .l = s->channels };
    w->lags = (int)fmin(fmin(side / w->l, LAGS_MOST), s->samples / (SAMPLES_EACH * w->l));
    if (w->lags < LAGS_LEAST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%d samples of %d channels are "
                                "too few for their correlations; accepted: at least %d",
                                s->samples, w->l, LAGS_LEAST * SAMPLES_EACH * w->l);
    w->side = w->l * w->lags;
    n = (size_t)w->side;
    w->R = malloc(sizeof *w->R * (size_t)(w->l * w->l) * (size_t)(2 * w->lags + 1));
    w->H = malloc(sizeof *w->H * n * n), w->past = malloc(sizeof *w->past * n * n);
    w->future = malloc(sizeof *w->future * n * n), w->next = malloc(sizeof *w->next * n * n);
    w->VT = malloc(sizeof *w->VT * n * n), w->U = malloc(sizeof *w->U * n * n);
    w->singular = malloc(sizeof *w->singular * n);
    w->K = malloc(sizeof *w->K * n * n), w->KT = malloc(sizeof *w->KT * n * n);
    return w->R != NULL && w->H != NULL && w->past != NULL && w->future != NULL && w->next != NULL
                   && w->VT != NULL && w->U != NULL && w->singular != NULL && w->K != NULL
                   && w->KT != NULL
               ? MODAL_OK
               : modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d covariances",
                            w->side);
}

/* ---- covariances ---- */

/* E y_r(t+k) y_c(t), k from -2 lags to 2 lags, of one pair of channels. */
static void correlate(struct work *w, int r, int c, fftw_complex *X, double *x, fftw_plan plan)
{
    const struct spectrum *s = w->s;
    int N = s->samples, l2 = w->l * w->l;

    memset(X, 0, sizeof *X * (size_t)(N / 2 + 1));
    for (int j = 0; j < s->lines; j++) {
        const double complex *f = s->F + (size_t)j * w->l;
        double complex p = f[r] * conj(f[c]);
        /* Wiener and Khinchin: covariances are the cross spectrum's transform, circular over the
         * record */
        X[s->first + j][0] = creal(p), X[s->first + j][1] = cimag(p);
    }
    fftw_execute(plan);
    for (int k = 0; k <= 2 * w->lags; k++) {
        w->R[l2 * k + r + w->l * c] = x[k] / N;
        w->R[l2 * k + c + w->l * r] = x[(N - k) % N] / N;  /* R(-k) = R(k)^T */
    }
}

static enum modal_status correlate_all(struct work *w, struct modal_error *err)
{
    int N = w->s->samples;
    double *x = fftw_alloc_real((size_t)N);
    fftw_complex *X = fftw_alloc_complex((size_t)N / 2 + 1);
    fftw_plan plan = x != NULL && X != NULL ? fftw_plan_dft_c2r_1d(N, X, x, FFTW_ESTIMATE) : NULL;

    for (int c = 0; c < w->l && plan != NULL; c++)
        for (int r = c; r < w->l; r++)
            correlate(w, r, c, X, x, plan);
    if (plan != NULL)
        fftw_destroy_plan(plan);
    fftw_free(x), fftw_free(X);
    return plan != NULL ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY,
                                                "identify: no memory for %d samples", N);
}

/* Block (a, b) of OUT, side x side, for all a and b: R of lag base + rows a + columns b. */
static void lay(const struct work *w, int base, int rows, int columns, double *out)
{
    int l = w->l, l2 = l * l;

    for (int b = 0; b < w->lags; b++)
        for (int a = 0; a < w->lags; a++) {
            int lag = base + rows * a + columns * b;
            const double *R = w->R + l2 * abs(lag);
            for (int c = 0; c < l; c++)
                for (int r = 0; r < l; r++)
                    out[a * l + r + (size_t)w->side * (b * l + c)]
                        = lag < 0 ? R[c + l * r] : R[r + l * c];
        }
}

/* Both covariances factored, with as much white noise as that takes; false where none helps. */
static bool factor_both(struct work *w)
{
    double ridge = 0;

    for (int i = 0; i < RIDGES; i++) {
        lay(w, 0, -1, 1, w->past);
        lay(w, 0, 1, -1, w->future);
        for (int j = 0; j < w->side; j++) {
            /* as if so much white noise lay on every channel */
            w->past[j * (size_t)(w->side + 1)] += ridge;
            w->future[j * (size_t)(w->side + 1)] += ridge;
        }
        if (LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'L', w->side, w->past, w->side) == 0
            && LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'L', w->side, w->future, w->side) == 0)
            return true;
        ridge = i == 0 ? RIDGE_FIRST : ridge * RIDGE_FACTOR;
    }
    return false;
}

static enum modal_status decompose(struct work *w, struct modal_error *err)
{
    int n = w->side;
    struct matrix H = { n, n, n, w->H }, U = { n, n, n, w->U }, VT = { n, n, n, w->VT };

    if (!factor_both(w))
        return modal_fail_field(err, MODAL_NO_CONVERGENCE, "signals", "the covariances of the "
                                "signals are singular; leave channels out that are sums of others");
    lay(w, 1, 1, 1, w->H);
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, n, n, 1,
                w->future, n, w->H, n);
    cblas_dtrsm(CblasColMajor, CblasRight, CblasLower, CblasTrans, CblasNonUnit, n, n, 1, w->past,
                n, w->H, n);
    return svd_thin(&H, w->singular, &U, &VT, err);
}

/* ---- regressions ---- */

static enum modal_status regress(struct work *w, struct subspace *out, struct modal_error *err)
{
    int n = w->side, l = w->l, q = n < ORDER_MOST ? n : ORDER_MOST;

    *out = (struct subspace) { l, q, malloc(sizeof(double) * (size_t)q * (size_t)q),
                               malloc(sizeof(double) * (size_t)q * (size_t)l),
                               malloc(sizeof(double) * (size_t)q * (size_t)l),
                               malloc(sizeof(double) * (size_t)(l * l)) };
    if (out->A == NULL || out->C == NULL || out->M == NULL || out->zero == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d states", q);
    for (int c = 0; c < n; c++)
        memcpy(w->K + (size_t)q * c, w->VT + (size_t)n * c, sizeof *w->K * (size_t)q);
    cblas_dtrsm(CblasColMajor, CblasRight, CblasLower, CblasNoTrans, CblasNonUnit, q, n, 1,
                w->past, n, w->K, q);
    lay(w, 1, -1, 1, w->next);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, q, n, n, 1, w->K, q, w->next, n, 0,
                w->KT, q);
    /* E x(t+1) x(t)^T, and E x x^T = 1: the states are canonical */
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, q, q, n, 1, w->KT, q, w->K, q, 0, out->A,
                q);
    lay(w, 1, 1, 1, w->H);                             /* its first rows are E y(t) Y-^T */
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, l, q, n, 1, w->H, n, w->K, q, 0, out->C,
                l);
    lay(w, 0, -1, 1, w->past);                         /* its first columns: E Y-(t+1) y(t)^T */
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, q, l, n, 1, w->K, q, w->past, n, 0,
                out->M, q);
    memcpy(out->zero, w->R, sizeof *out->zero * (size_t)(l * l));
    return MODAL_OK;
}

enum modal_status subspace_make(const struct spectrum *s, int side, struct subspace *out,
                                struct modal_error *err)
{
    struct work w;
    enum modal_status rc = work_init(&w, s, side, err);

    memset(out, 0, sizeof *out);
    if (rc == MODAL_OK && (rc = correlate_all(&w, err)) == MODAL_OK
        && (rc = decompose(&w, err)) == MODAL_OK)
        rc = regress(&w, out, err);
    work_done(&w);
    if (rc != MODAL_OK)
        subspace_done(out);
    return rc;
}

/* ---- models ---- */

struct modal_form {
    double *A, *K;               /* n x n, destroyed; n x l */
    double complex *mu, *V, *Q;  /* n; n x n; n x l: V^-1 K */
    lapack_int *swap;
};

/* R's root and K of (1); false where R is not positive. */
static bool innovations(const struct subspace *s, int n, struct whittle *out, double *K)
{
    int l = s->channels, q = s->order;

    memcpy(out->root, s->zero, sizeof *out->root * (size_t)(l * l));
    cblas_dsyrk(CblasColMajor, CblasLower, CblasNoTrans, l, n, -1, s->C, l, 1, out->root, l);
    if (LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'L', l, out->root, l) != 0)
        return false;
    for (int c = 0; c < l; c++) {
        memcpy(K + (size_t)n * c, s->M + (size_t)q * c, sizeof *K * (size_t)n);
        for (int r = 0; r < c; r++)
            out->root[r + l * c] = 0;
    }
    if (n == 0)
        return true;
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, n, l, n, -1, s->A, q, s->C, l, 1, K, n);
    cblas_dtrsm(CblasColMajor, CblasRight, CblasLower, CblasTrans, CblasNonUnit, n, l, 1,
                out->root, l, K, n);
    cblas_dtrsm(CblasColMajor, CblasRight, CblasLower, CblasNoTrans, CblasNonUnit, n, l, 1,
                out->root, l, K, n);
    return true;
}

static bool diagonal(const struct subspace *s, int n, struct modal_form *f)
{
    struct matrix A = { n, n, n, f->A };
    struct modal_error ignored;

    for (int c = 0; c < n; c++)
        memcpy(f->A + (size_t)n * c, s->A + (size_t)s->order * c, sizeof *f->A * (size_t)n);
    if (eigen_general(&A, f->mu, NULL, f->V, &ignored) != MODAL_OK)
        return false;
    for (int i = 0; i < n * s->channels; i++)
        f->Q[i] = f->K[i];
    return true;
}

/* Pole j as a pair. */
static void add_pair(const struct subspace *s, int n, const struct modal_form *f, int j,
                     struct whittle *out)
{
    struct whittle_mode *m = &out->mode[out->count++];
    double complex lambda = clog(f->mu[j]);
    bool real = cimag(f->mu[j]) == 0;
    /* a model of vibrations has pairs only: a real pole begins beside the axis; and where rounding
     * makes a pole slower than REFINE_TIED a sample it decays by that */
    double decay = fmax(-creal(lambda), REFINE_TIED), turn = fmin(BESIDE * decay, 1);

    if (real)
        lambda = CMPLX(0, creal(f->mu[j]) > 0 ? turn : M_PI - turn);
    *m = (struct whittle_mode) { .lambda = CMPLX(-decay, cimag(lambda)), .std_decay = NAN,
                                 .std_turn = NAN };
    for (int c = 0; c < s->channels; c++) {
        for (int i = 0; i < n; i++)
            m->phi[c] += s->C[c + s->channels * i] * f->V[i + (size_t)n * j];
        /* both of the pair take half of it */
        m->kappa[c] = f->Q[j + (size_t)n * c] / (real ? 2 : 1);
    }
}

bool subspace_model(const struct subspace *s, int n, struct whittle *out)
{
    size_t m = (size_t)n, l = (size_t)s->channels;
    struct modal_form f = { malloc(sizeof(double) * (m * m + 1)),
                            malloc(sizeof(double) * (m * l + 1)),
                            malloc(sizeof(double complex) * (m + 1)),
                            malloc(sizeof(double complex) * (2 * m * m + 1)),
                            malloc(sizeof(double complex) * (m * l + 1)),
                            malloc(sizeof(lapack_int) * (m + 1)) };
    bool done = f.A != NULL && f.K != NULL && f.mu != NULL && f.V != NULL && f.Q != NULL
        && f.swap != NULL;

    memset(out, 0, sizeof *out);
    out->channels = s->channels;
    done = done && n <= s->order && innovations(s, n, out, f.K);
    if (done && n > 0) {
        double complex *copy = f.V + m * m;
        done = diagonal(s, n, &f);
        memcpy(copy, f.V, sizeof *copy * m * m);
        done = done && LAPACKE_zgesv_work(LAPACK_COL_MAJOR, n, s->channels, copy, n, f.swap, f.Q,
                                          n) == 0;
    }
    for (int j = 0; j < n && done && out->count < WHITTLE_MODES_MOST; j++)
        if (cimag(f.mu[j]) >= 0)
            add_pair(s, n, &f, j, out);
    free(f.A), free(f.K), free(f.mu), free(f.V), free(f.Q), free(f.swap);
    return done;
}
