/*
 * wide.c - proper orthogonal modes of data read in panels
 *
 * With A the scaled data, L x S, the leading singular subspace is found by a block Krylov iteration
 * on the Gram operator,
 *
 *     Z = A^T (A X)   or   Z = A (A^T X),                                                       (1)
 *
 * both products taken while a panel of A is in the cache, so that each block costs one pass over
 * the data.  X lives on the shorter side, or on the channels' where samples must be read in order.
 * With K the orthonormal blocks so far, Rayleigh-Ritz on
 *
 *     H = K^T A^T A K,   H w = s^2 w,                                                           (2)
 *
 * gives s and the vectors K w; the part of Z outside K gives the residual |A^T A v - s^2 v| [HMT11,
 * sec. 4.5; MM15].  (2) squares: values below sqrt(DBL_EPSILON) s_1 are lost and those below 1e-6
 * s_1 keep only a few digits.  Where such are wanted, that is where no noise stands above 1e-6 s_1,
 * Golub-Kahan-Lanczos on A itself takes over (lanczos.c).
 *
 * What is kept is what stands above white noise, as in pod.c; |A|_F^2 needs no pass of its own
 * where channels have unit rms.
 *
 * [HMT11] Halko, Martinsson and Tropp, SIAM Rev. 53 (2011) 217-288.  [MM15] Musco and Musco, NIPS
 * 2015.
 */
#include "modal/identify/prepare/wide.h"
#include "modal/identify/prepare/grid.h"
#include "modal/linalg/eigen.h"
#include "modal/linalg/qr.h"
#include "modal/linalg/svd.h"
#include "modal/linalg/workspace.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    BLOCK = 16,                     /* vectors that one pass over the data multiplies */
    BLOCKS_MOST = 12,               /* of K */
    PANEL_BYTES = 1 << 21,          /* of the data, in a cache at a time, */
    PANEL_LEAST = 16,               /* but so many rows or channels at least: as many as vectors */
    SCALED_AT_ONCE = 512            /* channels: with BLOCK of them 64 kB on the stack */
};
static const double
    PLAIN_MOST = 1e250;             /* and none that overflows once multiplied */
static const double GUARD = 1e-6;      /* least s_i / s_1 that (2) is trusted with */
/* margin over the edge of white noise: scaled channels carry unequal noise, whose edge lies higher
 * */
static const double EDGE = 1.2;

/* Whether X lives on the channels. */
static bool on_channels(const struct wide *w)
{
    return w->by_rows || w->S <= w->L;
}

static double over(const struct wide *w, int c)
{
    return w->scale == NULL ? 1 : w->scale[c] > 0 ? 1 / w->scale[c] : 0;
}

static void scale_rows(const struct wide *w, int c0, int n, int b, double *x, int ld)
{
    for (int j = 0; w->scale != NULL && j < b; j++)
        for (int i = 0; i < n; i++)
            x[i + (size_t)j * (size_t)ld] *= over(w, c0 + i);
}

/* Samples in a panel that is read in order. */
static int panel_rows(const struct wide *w)
{
    int most = PANEL_BYTES / (int)sizeof(double) / w->S;

    return most < PANEL_LEAST ? PANEL_LEAST : most;
}

/* Rows k .. k+l-1 are read. */
static void give_back(const struct wide *w, int k, int l)
{
    if (w->release != NULL && l > 0)
        w->release(w->x + (size_t)k * w->stride,
                   ((size_t)(l - 1) * w->stride + (size_t)w->S) * sizeof *w->x);
}

void wide_passed(const struct wide *w, int k)
{
    int most = panel_rows(w), first = k / most * most;

    if (k + 1 == w->L || k + 1 == first + most)
        give_back(w, first, k + 1 - first);
}

/* (1), X on the samples: panels of n channels are n x L matrices of leading dimension `stride`.  T
 * (S x b) = A^T X of the text. */
static void gram_on_samples(const struct wide *w, const double *X, int b, double *Z, double *T)
{
    /* channels whose rows are read once for both products of (1) */
    int most = PANEL_BYTES / (int)sizeof(double) / w->L;

    most = most < PANEL_LEAST ? PANEL_LEAST : most;
    memset(Z, 0, sizeof *Z * (size_t)w->L * (size_t)b);
    for (int c = 0; c < w->S; c += most) {
        int n = w->S - c < most ? w->S - c : most;
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, b, w->L, 1, w->x + c,
                    (int)w->stride, X, w->L, 0, T + c, w->S);
        scale_rows(w, c, n, b, T + c, w->S);
        if (w->scale == NULL) {
            cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, w->L, b, n, 1, w->x + c,
                        (int)w->stride, T + c, w->S, 1, Z, w->L);
            continue;
        }
        /* A = scale^-1 data: (1) needs the scale twice, T of the text once */
        double twice[BLOCK * SCALED_AT_ONCE];
        for (int c2 = 0; c2 < n; c2 += SCALED_AT_ONCE) {
            int n2 = n - c2 < SCALED_AT_ONCE ? n - c2 : SCALED_AT_ONCE;
            matrix_copy(n2, b, T + c + c2, w->S, twice, n2);
            scale_rows(w, c + c2, n2, b, twice, n2);
            cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, w->L, b, n2, 1, w->x + c + c2,
                        (int)w->stride, twice, n2, 1, Z, w->L);
        }
    }
}

/* (1), X on the channels (already scaled, S x b): panels of l samples are S x l matrices.  T (L x
 * b) = A X. */
static void gram_on_channels(const struct wide *w, const double *X, int b, double *Z, double *T)
{
    int most = panel_rows(w);

    memset(Z, 0, sizeof *Z * (size_t)w->S * (size_t)b);
    for (int k = 0; k < w->L; k += most) {
        int l = w->L - k < most ? w->L - k : most;
        const double *A = w->x + (size_t)k * w->stride;
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, l, b, w->S, 1, A, (int)w->stride, X,
                    w->S, 0, T + k, w->L);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, w->S, b, l, 1, A, (int)w->stride,
                    T + k, w->L, 1, Z, w->S);
        give_back(w, k, l);
    }
    scale_rows(w, 0, w->S, b, Z, w->S);
}

struct krylov {
    const struct wide *w;
    bool channels;
    int near, far;             /* length of X, of T */
    int count;                 /* columns of K with their Z and T */
    int room;
    double *K, *T;             /* near x room, far x room */
    double *H;                 /* room x room: (2) */
    double *Z;                 /* near x BLOCK: of the last block, then what of it is outside K */
    double *scaled;            /* near x BLOCK */
    double *R;                 /* BLOCK x BLOCK: |what is outside| */
    double *theta, *W;         /* eigenvalues descending, vectors as columns */
    struct workspace space;    /* of all these */
};

static bool krylov_new(struct krylov *k, const struct wide *w)
{
    struct workspace *space = &k->space;

    k->w = w, k->channels = on_channels(w);
    k->near = k->channels ? w->S : w->L, k->far = k->channels ? w->L : w->S;
    k->room = BLOCK * BLOCKS_MOST < k->near ? BLOCK * BLOCKS_MOST : k->near;
    size_t n = (size_t)k->near, m = (size_t)k->room;
    k->K = workspace_room(space, n * (m + BLOCK), sizeof *k->K);
    k->T = workspace_room(space, (size_t)k->far * (m + BLOCK), sizeof *k->T);
    k->H = workspace_numbers(space, m + BLOCK, m + BLOCK);
    k->W = workspace_room(space, m * m, sizeof *k->W);
    k->Z = workspace_room(space, n * BLOCK, sizeof *k->Z);
    k->scaled = workspace_room(space, n * BLOCK, sizeof *k->scaled);
    k->R = workspace_numbers(space, BLOCK, BLOCK);
    k->theta = workspace_room(space, m, sizeof *k->theta);
    return !space->failed;
}

/* A fixed start: the same answer every time. */
static void fill(double *x, size_t count)
{
    unsigned z = 2463534242u;

    for (size_t i = 0; i < count; i++) {
        z = 1664525u * z + 1013904223u;
        x[i] = z / 4294967296.0 - 0.5;
    }
}

/* The pass of block K[:, count .. count+b): T, Z, and its rows of H. */
static void pass(struct krylov *k, int b)
{
    double *X = k->K + (size_t)k->count * (size_t)k->near,
           *T = k->T + (size_t)k->count * (size_t)k->far;
    int all = k->count + b;

    if (k->channels) {
        memcpy(k->scaled, X, sizeof *X * (size_t)k->near * (size_t)b);
        scale_rows(k->w, 0, k->near, b, k->scaled, k->near);
        gram_on_channels(k->w, k->scaled, b, k->Z, T);
    } else {
        gram_on_samples(k->w, X, b, k->Z, T);
    }
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, all, b, k->near, 1, k->K, k->near, k->Z,
                k->near, 0, k->H + (size_t)k->count * (size_t)k->room, k->room);
    for (int j = k->count; j < all; j++)
        for (int i = 0; i < k->count; i++)
            k->H[j + (size_t)i * (size_t)k->room] = k->H[i + (size_t)j * (size_t)k->room];
    k->count = all;
}

/* B columns X less their parts in K. */
static void leave_outside(const struct krylov *k, int b, double *X)
{
    double *work = k->scaled;

    for (int j = 0; j < k->count; j += BLOCK) {
        int n = k->count - j < BLOCK ? k->count - j : BLOCK;
        double *Kj = k->K + (size_t)j * (size_t)k->near;
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, n, b, k->near, 1, Kj, k->near, X,
                    k->near, 0, work, n);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, k->near, b, n, -1, Kj, k->near, work,
                    n, 1, X, k->near);
    }
}

/* Z outside K becomes the next block; R its size.  Twice is enough. */
static enum modal_status next_block(struct krylov *k, int b, int *next, struct modal_error *err)
{
    double *X = k->K + (size_t)k->count * (size_t)k->near;
    struct matrix Q = { k->near, b, k->near, X }, R = { b, b, b, k->R };
    enum modal_status rc;

    memcpy(X, k->Z, sizeof *X * (size_t)k->near * (size_t)b);
    /* after one pass rounding leaves eps |Z| of K, large beside a small rest */
    for (int twice = 0; twice < 2; twice++)
        leave_outside(k, b, X);
    rc = qr_orthonormal(&Q, &R, err);
    if (rc != MODAL_OK)
        return rc;
    leave_outside(k, b, X);    /* columns that were rounding are orthonormal, but not to K */
    struct matrix none = { b, b, b, NULL };
    rc = qr_orthonormal(&Q, &none, err);
    /* K fills the near side: beyond its length there is nothing */
    *next = k->room - k->count < b ? k->room - k->count : b;
    return rc;
}

/* (2): theta descending and W. */
static enum modal_status ritz(struct krylov *k, struct modal_error *err)
{
    int n = k->count;
    struct matrix A = { n, n, n, k->W };
    enum modal_status rc;

    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++)
            k->W[i + (size_t)j * (size_t)n] = 0.5
                * (k->H[i + (size_t)j * (size_t)k->room] + k->H[j + (size_t)i * (size_t)k->room]);
    rc = eigen_symmetric(&A, k->theta, err);
    for (int i = 0; i < n / 2; i++) {
        double t = k->theta[i];
        k->theta[i] = k->theta[n - 1 - i], k->theta[n - 1 - i] = t;
        cblas_dswap(n, k->W + (size_t)i * (size_t)n, 1, k->W + (size_t)(n - 1 - i) * (size_t)n, 1);
    }
    return rc;
}

/* |A^T A v_i - theta_i v_i|: R times the part of w_i in the last block. */
static double residual(const struct krylov *k, int i, int b)
{
    double y[BLOCK] = { 0 };
    const double *w = k->W + (size_t)i * (size_t)k->count + k->count - b;

    for (int r = 0; r < b; r++)
        for (int c = r; c < b; c++)
            y[r] += k->R[r + c * b] * w[c];
    return cblas_dnrm2(b, y, 1);
}

/*
 * How many of theta stand above the noise that the rest of the energy makes, counted from the
 * largest down: the rest still holds the signals not yet counted, but spread over all its
 * directions they stay below the next one unless there are as many as the short side's root.
 * *trusted: those counted, and the noise itself, are within what (2) can tell.
 */
static int above_noise(const struct krylov *k, double energy, int most, bool *trusted)
{
    double L = k->w->L, S = k->w->S, rest = energy, edge = 0;
    int n;

    for (n = 0; n < k->count && n < most; n++) {
        /* pod.c's (1): the largest singular value of white noise of the variance that is left */
        edge = EDGE * sqrt(fmax(rest, 0) / fmax((L - n) * (S - n), 1)) * (sqrt(L) + sqrt(S));
        if (!(k->theta[n] > edge * edge) || !(k->theta[n] > GUARD * GUARD * k->theta[0]))
            break;
        rest -= k->theta[n];        /* |A|_F^2 is the sum of all s^2 */
    }
    /* noise itself is seen through squares only above sqrt(eps) s_1 */
    *trusted = edge > GUARD * sqrt(fmax(k->theta[0], 0));
    return n > 1 ? n : 1;
}

static int wanted(const struct krylov *k, const struct pod_options *opt, double energy,
                  bool *trusted)
{
    int most = opt->most > 0 ? opt->most : POD_SIGNALS_MOST, n;
    double all = 0, sum = 0;

    if (opt->rank > 0 || opt->energy > 0) {
        for (int i = 0; i < k->count; i++)
            all += sqrt(fmax(k->theta[i], 0));
        for (n = 0; n < k->count && (opt->rank > 0 ? n < opt->rank : sum < opt->energy * all); n++)
            sum += sqrt(fmax(k->theta[n], 0));
        *trusted = n > 0 && k->theta[n - 1] > GUARD * GUARD * k->theta[0];
        return n;
    }
    return above_noise(k, energy, most, trusted);
}

static enum modal_status iterate(struct krylov *k, const struct wide_options *opt, double energy,
                                 int *kept, bool *trusted, struct modal_error *err)
{
    /* of s^2: the vectors then turn by no more over the gap [HMT11] */
    double tolerance = opt->tolerance > 0 ? opt->tolerance : 1e-8;
    int b = BLOCK < k->near ? BLOCK : k->near, next = b;
    struct matrix X = { k->near, b, k->near, k->K }, none = { 0 };
    enum modal_status rc;

    fill(k->K, (size_t)k->near * (size_t)b);
    /* random directions meet every singular vector but with probability 0 */
    rc = qr_orthonormal(&X, &none, err);
    *trusted = true;
    for (bool settled = false; rc == MODAL_OK && !settled && next > 0;) {
        b = next;
        pass(k, b);
        rc = next_block(k, b, &next, err);
        if (rc == MODAL_OK)
            rc = ritz(k, err);
        if (rc != MODAL_OK)
            return rc;
        *kept = wanted(k, &opt->pod, energy, trusted);
        /* half a block past those kept: what stands above the edge has been looked for there */
        settled = *kept < k->count - b / 2 && k->count > b;
        for (int i = 0; i < *kept && settled; i++)
            settled = residual(k, i, b) <= tolerance * k->theta[i];
    }
    return rc;
}

/* Signals and modes of the KEPT leading vectors; T is cleaned by an SVD of its own, so that modes
 * are orthonormal. */
static enum modal_status finish(struct krylov *k, int kept, struct pod *pod,
                                struct modal_error *err)
{
    int n = k->count, near = k->near, far = k->far;
    double *v = malloc(sizeof *v * (size_t)near * (size_t)kept),
           *t = malloc(sizeof *t * (size_t)far * (size_t)kept);
    struct matrix T = { far, kept, far, t },
                  Q = matrix_new(far, kept);
    struct matrix PT = matrix_new(kept, kept);
    double *rotated = malloc(sizeof *v * (size_t)near * (size_t)kept);
    enum modal_status rc = MODAL_OK;

    pod->s = malloc(sizeof *pod->s * (size_t)kept);
    if (v == NULL || t == NULL || Q.x == NULL || PT.x == NULL || rotated == NULL
        || pod->s == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d modes of %d channels", kept,
                        k->w->S);
        goto out;
    }
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, near, kept, n, 1, k->K, near, k->W, n, 0,
                v, near);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, far, kept, n, 1, k->T, far, k->W, n, 0,
                t, far);
    rc = svd_thin(&T, pod->s, &Q, &PT, err);   /* A v = Q s PT: left vectors Q, right ones v PT^T */
    if (rc != MODAL_OK)
        goto out;
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, near, kept, kept, 1, v, near, PT.x, kept,
                0, rotated, near);
    pod->count = kept;
    pod->modes = (struct matrix) { k->w->S, kept, k->w->S, k->channels ? rotated : Q.x };
    pod->signals = (struct matrix) { k->w->L, kept, k->w->L, k->channels ? Q.x : rotated };
    for (int i = 0; i < kept; i++)
        cblas_dscal(k->w->L, pod->s[i], pod->signals.x + (size_t)i * (size_t)k->w->L, 1);
    rotated = NULL, Q.x = NULL;
out:
    free(v), free(t), free(Q.x), free(PT.x), free(rotated);
    return rc;
}

/* The operator keeps no work of its own: scaling goes through the vectors. */
static enum modal_status operator_apply(void *context, const double *x, double *y,
                                        struct modal_error *err)
{
    const struct wide *w = context;
    double *scaled = malloc(sizeof *scaled * (size_t)w->S);

    if (scaled == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d channels", w->S);
    memcpy(scaled, x, sizeof *x * (size_t)w->S);
    scale_rows(w, 0, w->S, 1, scaled, w->S);
    for (int k = 0, most = w->by_rows ? panel_rows(w) : w->L; k < w->L; k += most) {
        int l = w->L - k < most ? w->L - k : most;
        cblas_dgemv(CblasColMajor, CblasTrans, w->S, l, 1, w->x + (size_t)k * w->stride,
                    (int)w->stride, scaled, 1, 0, y + k, 1);
        give_back(w, k, l);
    }
    free(scaled);
    return MODAL_OK;
}

static enum modal_status operator_transpose(void *context, const double *y, double *x,
                                            struct modal_error *err)
{
    const struct wide *w = context;

    (void)err;
    for (int k = 0, most = w->by_rows ? panel_rows(w) : w->L; k < w->L; k += most) {
        int l = w->L - k < most ? w->L - k : most;
        cblas_dgemv(CblasColMajor, CblasNoTrans, w->S, l, 1, w->x + (size_t)k * w->stride,
                    (int)w->stride, y + k, 1, k > 0, x, 1);
        give_back(w, k, l);
    }
    scale_rows(w, 0, w->S, 1, x, w->S);
    return MODAL_OK;
}

/* The scaled data as an operator, L x S; `w` is borrowed. */
static struct linear_operator wide_operator(const struct wide *w)
{
    return (struct linear_operator) { w->L, w->S, (void *)w, operator_apply, operator_transpose };
}

/* The graded case: triplets of A itself, down to rounding. */
static enum modal_status by_lanczos(const struct wide *w, const struct pod_options *opt,
                                    struct pod *pod, struct modal_error *err)
{
    int most = opt->rank > 0 ? opt->rank
        : opt->most > 0      ? opt->most
                             : POD_SIGNALS_MOST,
        side = w->L < w->S ? w->L : w->S, n = 0;
    struct linear_operator A = wide_operator(w);
    struct matrix UT = { 0 };
    struct lanczos_result found;
    double floor, all = 0, sum = 0;
    enum modal_status rc;

    most = most < side ? most : side;
    pod->s = calloc((size_t)most, sizeof *pod->s);
    pod->signals = (struct matrix) { w->L, most, w->L,
                                     calloc((size_t)w->L * (size_t)most, sizeof(double)) };
    pod->modes = (struct matrix) { w->S, most, w->S,
                                   calloc((size_t)w->S * (size_t)most, sizeof(double)) };
    UT = (struct matrix) { most, w->S, most, calloc((size_t)w->S * (size_t)most, sizeof(double)) };
    if (pod->s == NULL || pod->signals.x == NULL || pod->modes.x == NULL || UT.x == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d modes of %d channels", most,
                        w->S);
        goto out;
    }
    rc = lanczos_svd(&A, &(struct lanczos_options){ .wanted = most, .tolerance = 1e-12 }, pod->s,
                     &pod->signals, &UT, &found, err);
    if (rc != MODAL_OK)
        goto out;
    floor = (w->L > w->S ? w->L : w->S) * DBL_EPSILON * pod->s[0];
    for (int i = 0; i < found.count; i++)
        all += pod->s[i];
    while (n < found.count && pod->s[n] > floor && (opt->energy <= 0 || sum < opt->energy * all))
        sum += pod->s[n++];
    n = n > 0 ? n : 1;
    for (int i = 0; i < n; i++) {
        cblas_dscal(w->L, pod->s[i], pod->signals.x + (size_t)i * (size_t)w->L, 1);
        for (int c = 0; c < w->S; c++)
            pod->modes.x[c + (size_t)i * (size_t)w->S] = UT.x[i + (size_t)c * (size_t)most];
    }
    pod->count = pod->signals.n = pod->modes.n = n;
out:
    free(UT.x);
    return rc;
}

double wide_rms(const struct wide *w, int c)
{
    return w->rms != NULL ? w->rms[c] : w->scale[c];
}

/* |A|_F^2: L for every channel of unit rms, a pass where there is no scale. */
static double energy_of(const struct wide *w)
{
    double sum = 0;

    if (w->scale != NULL) {
        for (int c = 0; c < w->S; c++) {
            double size = w->scale[c] > 0 ? wide_rms(w, c) / w->scale[c] : 0;
            sum += size * size * w->L;
        }
        return sum;
    }
    for (int k = 0; k < w->L; k++) {
        double r = cblas_dnrm2(w->S, w->x + (size_t)k * w->stride, 1);
        sum += r * r;
        wide_passed(w, k);
    }
    return sum;
}

enum modal_status wide_pod(const struct wide *w, const struct wide_options *options,
                           struct pod *out, struct modal_error *err)
{
    struct wide_options opt = options != NULL ? *options : (struct wide_options) { .tolerance = 0 };
    struct krylov k = { 0 };
    struct pod pod = { .energy = 1 };
    double energy = energy_of(w), sum = 0, all = 0;
    int kept = 0;
    bool trusted = true;
    enum modal_status rc = MODAL_OK;

    if (w->L < 1 || w->S < 1)
        return modal_fail(err, MODAL_BAD_INPUT, "pod: %d samples of %d channels", w->L, w->S);
    if (!krylov_new(&k, w)) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d samples of %d channels", w->L,
                        w->S);
        goto out;
    }
    rc = iterate(&k, &opt, energy, &kept, &trusted, err);
    if (rc != MODAL_OK)
        goto out;
    rc = trusted ? finish(&k, kept, &pod, err) : by_lanczos(w, &opt.pod, &pod, err);
    if (rc != MODAL_OK)
        goto out;
    for (int i = 0; trusted && i < k.count; i++)
        all += sqrt(fmax(k.theta[i], 0));
    for (int i = 0; i < pod.count; i++)
        sum += pod.s[i];
    pod.energy = trusted && all > 0 ? fmin(sum / all, 1) : 1;
    *out = pod;
    pod = (struct pod) { 0 };
out:
    pod_done(&pod);
    workspace_free(&k.space);
    return rc;
}

void wide_project(const struct wide *w, const double *Q, int k, double *Z)
{
    int most = panel_rows(w);

    for (int i = 0; i < w->L; i += most) {
        int l = w->L - i < most ? w->L - i : most;
        cblas_dgemm(CblasColMajor, CblasTrans, CblasTrans, k, w->S, l, 1, Q + i, w->L,
                    w->x + (size_t)i * w->stride, (int)w->stride, i > 0, Z, k);
        give_back(w, i, l);
    }
}

enum modal_status wide_rests(const struct wide *w, const double *Q, int k, const double *Z, int ld,
                             double *rest2, struct modal_error *err)
{
    int most = panel_rows(w), S = w->S;
    double *E = malloc(sizeof *E * (size_t)most * (size_t)S);

    if (E == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d channels", S);
    memset(rest2, 0, sizeof *rest2 * (size_t)S);
    for (int i = 0; i < w->L; i += most) {
        int l = w->L - i < most ? w->L - i : most;
        for (int j = 0; j < l; j++)
            memcpy(E + (size_t)j * (size_t)S, w->x + (size_t)(i + j) * w->stride,
                   sizeof *E * (size_t)S);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasTrans, S, l, k, -1, Z, ld, Q + i, w->L, 1, E,
                    S);
        for (int j = 0; j < l; j++)
            for (int c = 0; c < S; c++)
                rest2[c] += E[c + (size_t)j * (size_t)S] * E[c + (size_t)j * (size_t)S];
        give_back(w, i, l);
    }
    free(E);
    return MODAL_OK;
}

/* Sums of squares, each row a contiguous loop over the channels. */
static void square_sums(const struct wide *w, const double *over_most, double *sum)
{
    memset(sum, 0, sizeof *sum * (size_t)w->S);
    for (int k = 0; k < w->L; k++) {
        const double *x = w->x + (size_t)k * w->stride;
        if (over_most == NULL)
            for (int c = 0; c < w->S; c++)
                sum[c] += x[c] * x[c];
        else
            for (int c = 0; c < w->S; c++)
                sum[c] += (x[c] * over_most[c]) * (x[c] * over_most[c]);
        wide_passed(w, k);
    }
}

/* The same where squares overflow or vanish: by each channel's largest magnitude. */
static enum modal_status careful_scales(const struct wide *w, double *scale,
                                        struct modal_error *err)
{
    double *most = calloc((size_t)w->S, sizeof *most);

    if (most == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d channels", w->S);
    for (int k = 0; k < w->L; k++) {
        for (int c = 0; c < w->S; c++) {
            double x = w->x[(size_t)k * w->stride + (size_t)c];
            if (!isfinite(x)) {
                free(most);
                return modal_fail_field(
                    err, MODAL_BAD_INPUT, "signals",
                    "signals: %s at sample %d of channel %d; finite numbers are needed",
                    isnan(x) ? "NaN" : "infinity", k, c);
            }
            most[c] = fmax(most[c], fabs(x));
        }
        wide_passed(w, k);
    }
    for (int c = 0; c < w->S; c++)
        scale[c] = most[c] > 0 ? 1 / fmax(most[c], DBL_MIN) : 0;
    double *sum = calloc((size_t)w->S, sizeof *sum);
    if (sum != NULL) {
        square_sums(w, scale, sum);
        for (int c = 0; c < w->S; c++)
            scale[c] = most[c] * sqrt(sum[c] / w->L);
    }
    free(most);
    free(sum);
    return sum != NULL ? MODAL_OK
                       : modal_fail(err, MODAL_NO_MEMORY, "pod: no memory for %d channels", w->S);
}

static bool has_variation(const struct wide *w)
{
    for (int k = 1; k < w->L; k++) {
        if (memcmp(w->x, w->x + (size_t)k * w->stride, sizeof *w->x * (size_t)w->S) != 0)
            return true;
        wide_passed(w, k);
    }
    return false;
}

enum modal_status wide_scales(const struct wide *w, double *scale, bool *varies,
                              struct modal_error *err)
{
    bool plain = true;

    square_sums(w, NULL, scale);
    for (int c = 0; c < w->S; c++) {
        /* false for NaN, infinity, and what squares to nothing: neither the sum of squares
         * underflows nor its reciprocal */
        plain &= scale[c] > 1 / PLAIN_MOST && scale[c] < PLAIN_MOST;
    }
    *varies = has_variation(w);
    if (!plain)
        return careful_scales(w, scale, err);
    for (int c = 0; c < w->S; c++)
        scale[c] = sqrt(scale[c] / w->L);
    return MODAL_OK;
}

enum { GRID_BLOCK = 1 << 19 };         /* numbers looked at together: 4 MB, whatever the batch */

/* Rows to look for a grid in. */
static int grid_rows(const struct wide *w)
{
    int rows = WIDE_GRID_NUMBERS / w->S;

    rows = rows > WIDE_GRID_ROWS ? rows : WIDE_GRID_ROWS;
    rows = rows < GRID_SAMPLES ? rows : GRID_SAMPLES;
    return rows < w->L ? rows : w->L;
}

/* Half of them the first, where there is most to see; the others spread over the rest, so that late
 * rows of a decayed record are among them.  In order. */
static int grid_row(const struct wide *w, int i, int rows)
{
    int head = rows == w->L ? rows : rows / 2;

    return i < head ? i
                    : head
            + (int)((double)(i - head) * (w->L - head - 1)
                    / (rows - head > 1 ? rows - head - 1 : 1));
}

/* Of COUNT channels from FIRST on, EVERY apart; X has room for ROWS of each. */
static bool grids_of(const struct wide *w, int rows, int first, int every, int count, double *x,
                     struct grid *grid)
{
    int head = rows == w->L ? 0 : rows / 2;
    bool any = false;

    for (int i = 0; i < rows; i++) {
        int k = grid_row(w, i, rows);
        const double *row = w->x + (size_t)k * w->stride;
        for (int j = 0; j < count; j++)
            x[(size_t)i * (size_t)count + (size_t)j] = row[first + j * every];
        give_back(w, k, 1);
    }
    for (int j = 0; j < count; j++) {
        int c = first + j * every;
        if (w->scale == NULL || w->scale[c] > 0)
            grid[c] = grid_of_rows(x + j, (size_t)count, rows, head, 1);
        any |= grid[c].step > 0;
    }
    return any;
}

enum modal_status wide_grids(const struct wide *w, struct grid *grid, bool *any,
                             struct modal_error *err)
{
    int rows = grid_rows(w), every = (w->S + GRID_CHANNELS - 1) / GRID_CHANNELS,
        block = GRID_BLOCK / rows;
    double *x;

    block = block > GRID_CHANNELS ? block : GRID_CHANNELS;
    x = malloc(sizeof *x * (size_t)rows * (size_t)block);
    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "wide: no memory for %d samples of %d channels",
                          rows, block);
    memset(grid, 0, sizeof *grid * (size_t)w->S);
    *any = grids_of(w, rows, 0, every, (w->S + every - 1) / every, x, grid);
    for (int c = 0; c < w->S && *any; c += block)
        grids_of(w, rows, c, 1, w->S - c < block ? w->S - c : block, x, grid);
    free(x);
    return MODAL_OK;
}

int wide_rows_above(const struct wide *w, const struct grid *grid, double steps)
{
    const double *end = w->x + (size_t)(w->L - 1) * w->stride;
    int rows = 0;

    for (int c = 0; c < w->S; c++)
        if (!grid_ends(&grid[c]) && (w->scale == NULL || w->scale[c] > 0))
            return w->L;
    for (int k = 0; k < w->L; k++) {
        const double *x = w->x + (size_t)k * w->stride;
        for (int c = 0; c < w->S && rows <= k; c++)
            if (fabs(x[c] - end[c]) >= steps * grid[c].step && grid[c].step > 0)
                rows = k + 1;
        wide_passed(w, k);
    }
    return rows;
}
