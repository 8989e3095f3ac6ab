/*
 * pod.c - proper orthogonal modes
 *
 * Y^T = U diag(s) V^T, Y being L samples x S channels: signal i is s_i v_i (22)-(23), and Y =
 * signals * U^T.  The paper's Lanczos iteration on [0 T; T^T 0] (24) is replaced by Golub-Kahan
 * bidiagonalisation (lanczos.c), or by the SVD of Y itself where the thin side is small.
 *
 * With no energy asked for, what is kept is what stands above the noise.  White noise of variance v
 * has no singular value above sqrt(v) (sqrt(L) + sqrt(S)) asymptotically; v follows from what the
 * leading k modes leave,
 *
 *     v = (|Y|_F^2 - sum_{i<=k} s_i^2) / ((L - k)(S - k)).                                      (1)
 *
 * On clean data the floor is rounding, max(L,S) DBL_EPSILON s_1.
 */
#include "modal/identify/prepare/pod.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/colour.h"
#include "modal/linalg/lanczos.h"
#include "modal/linalg/qr.h"
#include "modal/linalg/svd.h"

enum {
    DENSE_SIDE = 64,                /* up to it all triplets are made, without iteration */
    TALL = 1 << 15                  /* rows from which on a triangle is made first */
};
_Static_assert((int)TALL > QR_KEPT((int)DENSE_SIDE), "the triangle of tall records leaves them");

/* Times (1), which holds as both sides grow: by Tracy's and Widom's law the largest value of one
 * white 1,000 x 20 in a hundred is 1.8 % above it, of larger ones less. */
static const double ABOVE_EDGE = 1.02;

/* Y = V diag(s) UT; V.x NULL: it is Y P, over s. */
struct triplets { int count; double *s; struct matrix V, UT, P; };

static void triplets_done(struct triplets *t)
{
    free(t->s);
    free(t->V.x);
    free(t->UT.x);
    free(t->P.x);
}

static enum modal_status allocate(struct triplets *t, const struct matrix *Y, int k,
                                  struct modal_error *err)
{
    t->s = calloc((size_t)k + 1, sizeof(double));
    t->V = matrix_new(Y->m, k);
    t->UT = matrix_new(k, Y->n);
    if (t->s == NULL || t->V.x == NULL || t->UT.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d modes of %d channels", k,
                          Y->n);
    return MODAL_OK;
}

static enum modal_status dense(const struct matrix *Y, struct triplets *t, struct modal_error *err)
{
    int k = Y->m < Y->n ? Y->m : Y->n;
    struct matrix copy = matrix_new(Y->m, Y->n);
    enum modal_status rc = allocate(t, Y, k, err);

    if (copy.x == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d x %d", Y->m, Y->n);
    if (rc == MODAL_OK) {
        matrix_copy(Y->m, Y->n, Y->x, Y->ld, copy.x, Y->m);
        rc = svd_thin(&copy, t->s, &t->V, &t->UT, err);
        t->count = k;
    }
    free(copy.x);
    return rc;
}

/* The same of many rows, weighed: with Y = Q R that is Q R D, and R D = W diag(s) U^T. So V = Q W
 * is Y D U over s: neither Q is made nor a copy of Y.  What s_1 rounds to is lost in a small s
 * either way. */
static enum modal_status tall(const struct matrix *Y, const double *weight, struct triplets *t,
                              struct modal_error *err)
{
    int n = Y->n;
    struct matrix kept = *Y, R = matrix_new(n, n), W = matrix_new(n, n);
    enum modal_status rc = MODAL_OK;

    t->s = calloc((size_t)n + 1, sizeof(double));
    t->UT = matrix_new(n, n), t->P = matrix_new(n, n);
    if (t->s == NULL || t->UT.x == NULL || t->P.x == NULL || R.x == NULL || W.x == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d channels", n);
    if (rc == MODAL_OK)
        rc = qr_triangle(&kept, &R, err);
    for (int c = 0; c < n && rc == MODAL_OK && weight != NULL; c++)
        cblas_dscal(n, weight[c], R.x + (size_t)c * (size_t)n, 1);
    if (rc == MODAL_OK)
        rc = svd_thin(&R, t->s, &W, &t->UT, err);
    for (int c = 0; c < n && rc == MODAL_OK; c++)
        for (int i = 0; i < n; i++)
            t->P.x[c + i * n] = (weight != NULL ? weight[c] : 1) * t->UT.x[i + c * n];
    t->count = rc == MODAL_OK ? n : 0;
    free(R.x), free(W.x);
    return rc;
}

static enum modal_status leading(const struct matrix *Y, int wanted, struct triplets *t,
                                 struct modal_error *err)
{
    struct linear_operator A = dense_operator(Y);
    /* of s_1: signals are weighed by s, and noise in measured ones is larger */
    struct lanczos_options opt = { .wanted = wanted, .tolerance = 1e-12 };
    struct lanczos_result result;
    enum modal_status rc = allocate(t, Y, wanted, err);

    if (rc == MODAL_OK)
        rc = lanczos_svd(&A, &opt, t->s, &t->V, &t->UT, &result, err);
    t->count = rc == MODAL_OK ? result.count : 0;
    return rc;
}

static double square_sum(const struct matrix *Y)
{
    double sum = 0;

    for (int c = 0; c < Y->n; c++)
        sum += cblas_ddot(Y->m, Y->x + (size_t)c * Y->ld, 1, Y->x + (size_t)c * Y->ld, 1);
    return sum;
}

double pod_edge(double L, double S, double rest)
{
    return ABOVE_EDGE * sqrt(fmax(rest, 0) / (L * S)) * (sqrt(L) + sqrt(S));
}

/* Are the columns of V from K on white noise? */
static enum modal_status rest_white(const struct triplets *t, const struct matrix *Y, int k,
                                    bool *white, struct modal_error *err)
{
    static const double none[COLOUR_LAGS] = { 0 };
    struct matrix tail = { t->V.m, t->count - k, t->V.ld, NULL };
    struct colour_sum sum = { 0 };
    double *v = t->V.x == NULL ? malloc((size_t)Y->m * sizeof *v) : NULL;
    enum modal_status rc = MODAL_OK;

    if (t->V.x != NULL) {
        tail.x = t->V.x + (size_t)k * (size_t)t->V.ld;
        *white = colour_white(&tail);
        return MODAL_OK;
    }
    if (v == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d samples", Y->m);
    for (; k < t->count && rc == MODAL_OK; k++) {
        /* a multiple of V's column has its colour */
        cblas_dgemv(CblasColMajor, CblasNoTrans, Y->m, Y->n, 1, Y->x, Y->ld,
                    t->P.x + (size_t)k * (size_t)t->P.ld, 1, 0, v, 1);
        rc = colour_add(v, Y->m, &sum, err);
    }
    *white = colour_sum_white(&sum, none, 0);
    free(v), free(sum.power);
    return rc;
}

/* Every triplet is known: the first k from which on no value stands out of the rest as (1) would
 * have it, if the rest is white in time as well; many equal signals would look like noise to (1)
 * alone. */
static enum modal_status above_rest(const struct triplets *t, const struct matrix *Y, double total,
                                    int *k_most, struct modal_error *err)
{
    double L = Y->m, S = Y->n, rest = total;

    for (int k = 0; k < *k_most && k < S && k < L; k++) {
        double edge = pod_edge(L - k, S - k, rest);
        if (t->s[k] <= edge) {
            /* white in time too: a flat spectrum of singular values is noise only then */
            bool white = false;
            enum modal_status rc = rest_white(t, Y, k, &white, err);
            *k_most = rc == MODAL_OK && white ? k : *k_most;
            return rc;
        }
        /* from the largest down: what is left of the energy is the others' */
        rest -= t->s[k] * t->s[k];
    }
    return MODAL_OK;
}

/* (1) from all the triplets found, then from those above the edge, until that settles: from above,
 * so that too many are kept, not too few. */
static enum modal_status above_noise(const struct triplets *t, const struct matrix *Y,
                                     double total, int *kept, struct modal_error *err)
{
    double L = Y->m, S = Y->n, edge = (L > S ? L : S) * DBL_EPSILON * t->s[0];
    int k, before = t->count + 1;
    enum modal_status rc = MODAL_OK;

    for (k = 0; k < t->count && t->s[k] > edge; )
        k++;
    if (t->count == (L < S ? L : S))
        rc = above_rest(t, Y, total, &k, err);
    while (k > 0 && k < before && k < L && k < S && t->count < L && t->count < S) {
        double rest = total;
        before = k;
        for (int i = 0; i < k; i++)
            rest -= t->s[i] * t->s[i];
        edge = ABOVE_EDGE * sqrt(fmax(rest, 0) / ((L - k) * (S - k))) * (sqrt(L) + sqrt(S));
        while (k > 0 && t->s[k - 1] <= edge)
            k--;
    }
    *kept = k > 1 ? k : 1;
    return rc;
}

/* How many triplets are kept; TOTAL: the squares of Y. */
static enum modal_status keep(const struct triplets *t, const struct matrix *Y,
                              const struct pod_options *opt, double total, int *kept,
                              struct modal_error *err)
{
    double all = 0, sum = 0;

    *kept = 0;
    if (t->count == 0)
        return MODAL_OK;
    if (opt->rank > 0) {
        *kept = opt->rank < t->count ? opt->rank : t->count;
        return MODAL_OK;
    }
    if (opt->energy <= 0)
        return above_noise(t, Y, total, kept, err);
    for (int i = 0; i < t->count; i++)
        all += t->s[i];
    while (*kept < t->count && sum < opt->energy * all)
        sum += t->s[(*kept)++];
    return MODAL_OK;
}

/* Y with each column weighed. */
static enum modal_status weigh(const struct matrix *Y, const double *weight, struct matrix *out,
                               struct modal_error *err)
{
    *out = matrix_new(Y->m, Y->n);
    if (out->x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d x %d", Y->m, Y->n);
    for (int c = 0; c < Y->n; c++)
        for (int l = 0; l < Y->m; l++)
            out->x[l + (size_t)c * (size_t)out->ld] =
                Y->x[l + (size_t)c * (size_t)Y->ld] * weight[c];
    return MODAL_OK;
}

/* The leading r of the triplets as signals and modes. */
static enum modal_status take(const struct triplets *t, const struct matrix *Y, int r,
                              struct pod *pod, struct modal_error *err)
{
    double all = 0, sum = 0;

    pod->s = malloc(sizeof *pod->s * ((size_t)r + 1));
    pod->signals = matrix_new(Y->m, r);
    pod->modes = matrix_new(Y->n, r);
    if (pod->s == NULL || pod->signals.x == NULL || pod->modes.x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d signals", r);
    for (int i = 0; i < t->count; i++)
        all += t->s[i];
    if (t->V.x == NULL && r > 0)
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, Y->m, r, Y->n, 1, Y->x, Y->ld,
                    t->P.x, t->P.ld, 0, pod->signals.x, Y->m);
    for (int i = 0; i < r; i++) {
        sum += pod->s[i] = t->s[i];
        for (int l = 0; l < Y->m && t->V.x != NULL; l++)
            pod->signals.x[l + (size_t)i * Y->m] = t->s[i] * t->V.x[l + (size_t)i * t->V.ld];
        for (int c = 0; c < Y->n; c++)
            pod->modes.x[c + (size_t)i * Y->n] = t->UT.x[i + (size_t)c * t->UT.ld];
    }
    pod->count = r;
    pod->energy = all > 0 ? sum / all : 1;
    return MODAL_OK;
}

enum modal_status pod_reduce(const struct matrix *Y, const struct pod_options *opt, struct pod *out,
                             struct modal_error *err)
{
    int side = Y->m < Y->n ? Y->m : Y->n, most = opt->most > 0 ? opt->most : POD_SIGNALS_MOST, r;
    bool high = side <= DENSE_SIDE && Y->m >= TALL;
    struct triplets t = { 0 };
    struct pod pod = { .energy = 1 };
    struct matrix weighed = { 0 };
    double total = 0;
    enum modal_status rc = MODAL_OK;

    if (opt->rank > most)
        most = opt->rank;
    if (opt->weight != NULL && !high) {
        rc = weigh(Y, opt->weight, &weighed, err);
        Y = &weighed;
    }
    if (rc == MODAL_OK)
        rc = high               ? tall(Y, opt->weight, &t, err)
           : side <= DENSE_SIDE ? dense(Y, &t, err)
                                : leading(Y, most < side ? most : side, &t, err);
    for (int i = 0; i < t.count && high; i++)
        total += t.s[i] * t.s[i];       /* all of them */
    if (rc == MODAL_OK)
        rc = keep(&t, Y, opt, high ? total : square_sum(Y), &r, err);
    if (rc == MODAL_OK)
        rc = take(&t, Y, r > most && opt->energy <= 0 ? most : r, &pod, err);
    if (rc == MODAL_OK)
        *out = pod;
    else
        pod_done(&pod);
    triplets_done(&t);
    free(weighed.x);
    return rc;
}

void pod_done(struct pod *p)
{
    free(p->signals.x);
    free(p->modes.x);
    free(p->s);
    memset(p, 0, sizeof *p);
}
