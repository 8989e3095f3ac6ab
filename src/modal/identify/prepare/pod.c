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

/* Times (1), which holds as both sides grow: by Tracy's and Widom's law the largest value of one
 * white 1,000 x 20 in a hundred is 1.8 % above it, of larger ones less. */
static const double ABOVE_EDGE = 1.02;

struct triplets { int count; double *s; struct matrix V, UT; };   /* Y = V diag(s) UT */

static void triplets_done(struct triplets *t)
{
    free(t->s);
    free(t->V.x);
    free(t->UT.x);
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

/* The same of many rows: Y = Q R, R = W diag(s) U^T, and V = Q W is Y U over s, so that Q is not
 * made.  What s_1 rounds to is lost in a small s either way. */
static enum modal_status tall(const struct matrix *Y, struct triplets *t, struct modal_error *err)
{
    int n = Y->n;
    size_t N = (size_t)n;
    struct matrix R = { n, n, n, malloc(2 * N * N * sizeof(double)) }, W = { n, n, n, NULL };
    enum modal_status rc = allocate(t, Y, n, err);

    if (R.x == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d channels", n);
    W.x = R.x != NULL ? R.x + N * N : NULL;
    for (int c = 0; c < n && rc == MODAL_OK; c++)
        memcpy(t->V.x + (size_t)c * (size_t)Y->m, Y->x + (size_t)c * (size_t)Y->ld,
               sizeof(double) * (size_t)Y->m);
    if (rc == MODAL_OK)
        rc = qr_triangle(&t->V, &R, err);
    if (rc == MODAL_OK)
        rc = svd_thin(&R, t->s, &W, &t->UT, err);
    if (rc == MODAL_OK)
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, Y->m, n, n, 1, Y->x, Y->ld, t->UT.x,
                    t->UT.ld, 0, t->V.x, t->V.ld);
    for (int i = 0; i < n && rc == MODAL_OK; i++)
        /* unit columns of Y U = V diag(s) */
        cblas_dscal(Y->m, t->s[i] > 0 ? 1 / t->s[i] : 0, t->V.x + (size_t)i * (size_t)t->V.ld, 1);
    t->count = rc == MODAL_OK ? n : 0;
    free(R.x);
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

/* Every triplet is known: the first k from which on no value stands out of the rest as (1) would
 * have it, if the rest is white in time as well; many equal signals would look like noise to (1)
 * alone. */
static int above_rest(const struct triplets *t, const struct matrix *Y, int k_most, double total)
{
    double L = Y->m, S = Y->n, rest = total;

    for (int k = 0; k < k_most && k < S && k < L; k++) {
        double edge = pod_edge(L - k, S - k, rest);
        struct matrix tail = { t->V.m, t->count - k, t->V.ld,
                               t->V.x + (size_t)k * (size_t)t->V.ld };
        /* white in time too: a flat spectrum of singular values is noise only then */
        if (t->s[k] <= edge)
            return colour_white(&tail) ? k : k_most;
        /* from the largest down: what is left of the energy is the others' */
        rest -= t->s[k] * t->s[k];
    }
    return k_most;
}

/* (1) from all the triplets found, then from those above the edge, until that settles: from above,
 * so that too many are kept, not too few. */
static int above_noise(const struct triplets *t, const struct matrix *Y, double total)
{
    double L = Y->m, S = Y->n, edge = (L > S ? L : S) * DBL_EPSILON * t->s[0];
    int k, before = t->count + 1;

    for (k = 0; k < t->count && t->s[k] > edge; )
        k++;
    if (t->count == (L < S ? L : S))
        k = above_rest(t, Y, k, total);
    while (k > 0 && k < before && k < L && k < S && t->count < L && t->count < S) {
        double rest = total;
        before = k;
        for (int i = 0; i < k; i++)
            rest -= t->s[i] * t->s[i];
        edge = ABOVE_EDGE * sqrt(fmax(rest, 0) / ((L - k) * (S - k))) * (sqrt(L) + sqrt(S));
        while (k > 0 && t->s[k - 1] <= edge)
            k--;
    }
    return k > 1 ? k : 1;
}

static int kept(const struct triplets *t, const struct matrix *Y, const struct pod_options *opt,
                double total)
{
    double all = 0, sum = 0;
    int r = 0;

    if (opt->rank > 0)
        return opt->rank < t->count ? opt->rank : t->count;
    if (opt->energy <= 0)
        return above_noise(t, Y, total);
    for (int i = 0; i < t->count; i++)
        all += t->s[i];
    while (r < t->count && sum < opt->energy * all)
        sum += t->s[r++];
    return r;
}

enum modal_status pod_reduce(const struct matrix *Y, const struct pod_options *opt, struct pod *out,
                             struct modal_error *err)
{
    int side = Y->m < Y->n ? Y->m : Y->n, most = opt->most > 0 ? opt->most : POD_SIGNALS_MOST, r;
    struct triplets t = { 0, NULL, { 0 }, { 0 } };
    struct pod pod = { .energy = 1 };
    double all = 0, sum = 0;
    enum modal_status rc;

    if (opt->rank > most)
        most = opt->rank;
    rc = side <= DENSE_SIDE && Y->m >= TALL ? tall(Y, &t, err)
       : side <= DENSE_SIDE                 ? dense(Y, &t, err)
                                            : leading(Y, most < side ? most : side, &t, err);
    if (rc != MODAL_OK)
        goto out;
    r = t.count > 0 ? kept(&t, Y, opt, square_sum(Y)) : 0;
    if (r > most && opt->energy <= 0)
        r = most;
    pod.s = malloc(sizeof *pod.s * (r + 1));
    pod.signals = matrix_new(Y->m, r);
    pod.modes = matrix_new(Y->n, r);
    if (pod.s == NULL || pod.signals.x == NULL || pod.modes.x == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d signals", r);
        goto out;
    }
    for (int i = 0; i < t.count; i++)
        all += t.s[i];
    for (int i = 0; i < r; i++) {
        sum += pod.s[i] = t.s[i];
        for (int l = 0; l < Y->m; l++)
            pod.signals.x[l + (size_t)i * Y->m] = t.s[i] * t.V.x[l + (size_t)i * t.V.ld];
        for (int c = 0; c < Y->n; c++)
            pod.modes.x[c + (size_t)i * Y->n] = t.UT.x[i + (size_t)c * t.UT.ld];
    }
    pod.count = r;
    pod.energy = all > 0 ? sum / all : 1;
    *out = pod;
    memset(&pod, 0, sizeof pod);
out:
    pod_done(&pod);
    triplets_done(&t);
    return rc;
}

void pod_done(struct pod *p)
{
    free(p->signals.x);
    free(p->modes.x);
    free(p->s);
    memset(p, 0, sizeof *p);
}
