/*
 * transfer.c - output error, by Gauss and Newton on the sums over lines
 *
 * Columns.  A pair's part is real-linear in the real and imaginary part of phi q, with the columns
 * f + g and i (f - g) of f = W/(z - r), g = W/(z - conj r), r = e^s; moving s moves f by
 * r W/(z - r)^2 ds.  These four for each pole and drive and the direct columns are C; all that a
 * step needs are its products G = C^T C and B = C^T Y (real parts), taken block by block.
 *
 * Elimination.  For given s and q a response is linear in its phi and D, whose columns V are sums
 * of those of C, the same for all responses: x = (V^T V)^-1 V^T Y.  With P the projection off V and
 * T_i the directions in C that s and q move response i in, the step solves
 *
 *     S d = sum_i w_i T_i^T C^T (Y_i - V x_i),    S = sum_i w_i T_i^T C^T P C T_i,      (1)
 *
 * w_i = 1/v_i, and S^-1 is the covariance of s and q: the bound's, shapes and direct terms unknown.
 * A number that is linear in x_i by the row v, and moves by the row c of C as s and q move, has the
 * variance
 *
 *     v_i |v|^2_(V^T V)^-1 + |T_i^T (c - C^T V (V^T V)^-1 v)|^2_S^-1.                  (2)
 *
 * The likelihood is that of unknown v_i, -M ln rss_i summed over responses, M lines of two parts
 * each; what V x_i leaves is taken from the lines themselves, as differences of sums would lose it.
 */
#include "modal/identify/forced/transfer.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/linalg/eigen.h"
#include "modal/linalg/workspace.h"

enum {
    BLOCK = 256,                 /* lines at a time: columns of a few poles stay in cache */
    PARTS = 4,                   /* columns of C a pole and drive */
    EIGEN = 16,                  /* n^3 of these: what eigenvalues and vectors of n take */
    TRIES = 12                   /* of one step, each ten times more careful */
};
static const double
    DEPENDENT = 1e-11,           /* of the largest eigenvalue: directions of V that are others */
    RIDGE = 1e-12,               /* of S's diagonal: what is not seen has 1e6 times its own error */
    CAREFUL = 1e-3,              /* first damping of a step */
    FASTEST = 4;                 /* ln of what is left of a motion after a sample: nothing */

struct sums {
    int K, V, g;                 /* columns of C and of V; unknowns in s and q */
    double *G, *B;               /* K x K; K x responses */
    double *GV, *A;              /* G V's columns; the inverse of V^T V */
    double *Q;                   /* K x V: V = C Q */
    double *S, *d;               /* g x g, g */
    double *block;               /* 2 BLOCK x (K + responses) */
    double spent, most;          /* work, and what a fit may take of it */
    struct workspace held;
};

int transfer_unknowns(const struct lines *l, int poles)
{
    return poles * 2 * (l->responses + l->drives) + l->direct * l->responses;
}

/* ---- what a fit costs: multiplications of its products ---- */

static double work_of_measure(const struct lines *l, int poles)
{
    double K = PARTS * poles * l->drives + l->direct, V = 2 * poles + l->direct;

    /* G of one triangle, B, the rest by V; then G Q and an eigenproblem of V */
    return 2.0 * l->count * (K * K / 2 + K * l->responses + K * V + V * l->responses)
         + K * K * V + EIGEN * V * V * V;
}

static double work_of_step(const struct lines *l, int poles)
{
    double K = PARTS * poles * l->drives + l->direct, V = 2 * poles + l->direct;
    double g = 2 * poles * l->drives;

    return K * V * (K + V) + l->responses * K * g * (K + g) + g * g * g;
}

double transfer_work(const struct lines *l, int poles)
{
    return work_of_measure(l, poles) + work_of_step(l, poles);
}

/* Of every pole whose drive is not the strongest by far any more; true where one changed. */
static bool hold_all(const struct lines *l, struct transfer *t)
{
    const double WEAK = 4;
    bool changed = false;

    for (int p = 0; p < t->poles; p++) {
        double most = 0;
        for (int j = 0; j < l->drives; j++)
            most = fmax(most, cabs(t->q[j + (size_t)p * l->drives]));
        if (most > WEAK)
            transfer_hold(l, t, p), changed = true;
    }
    return changed;
}

/* ---- columns ---- */

static void put(double *column, int rows, int n, double complex value)
{
    column[n] = creal(value);
    column[n + rows] = cimag(value);
}

/* C's rows of `rows` lines from FIRST on, real parts above imaginary ones. */
static void fill_columns(const struct lines *l, const struct transfer *t, int first, int rows,
                         double *C)
{
    size_t ld = 2 * (size_t)rows;

    for (int p = 0; p < t->poles; p++) {
        double complex r = cexp(t->s[p]), u = conj(r);
        for (int n = 0; n < rows; n++) {
            double complex z = l->z[first + n], a = 1 / (z - r), b = 1 / (z - u);
            double complex da = r * a * a, db = u * b * b;  /* d/ds of 1 / (z - e^s) */
            for (int j = 0; j < l->drives; j++) {
                double complex w = l->W[first + n + (size_t)j * l->count];
                double *c = C + ld * PARTS * ((size_t)p * l->drives + j);
                put(c, rows, n, w * (a + b));  /* f + g of the text, by the real part of phi q */
                put(c + ld, rows, n, I * w * (a - b));  /* and by the imaginary one */
                put(c + 2 * ld, rows, n, w * (da + db));
                put(c + 3 * ld, rows, n, I * w * (da - db));
            }
        }
    }
    for (int k = 0; k < l->direct; k++)
        for (int n = 0; n < rows; n++)
            put(C + ld * (PARTS * (size_t)t->poles * l->drives + k), rows, n,
                l->X[first + n + (size_t)k * l->count]);
}

static void fill_responses(const struct lines *l, int first, int rows, double *Y)
{
    for (int i = 0; i < l->responses; i++)
        for (int n = 0; n < rows; n++)
            put(Y + 2 * (size_t)rows * i, rows, n, l->Y[first + n + (size_t)i * l->count]);
}

/* Of the unit real and imaginary part of phi, by q. */
static void fill_Q(const struct lines *l, const struct transfer *t, struct sums *s)
{
    memset(s->Q, 0, sizeof *s->Q * (size_t)s->K * s->V);
    for (int p = 0; p < t->poles; p++)
        for (int j = 0; j < l->drives; j++) {
            double complex q = t->q[j + (size_t)p * l->drives];
            double *re = s->Q + PARTS * ((size_t)p * l->drives + j) + (size_t)s->K * 2 * p;
            double *im = re + s->K;
            re[0] = creal(q), re[1] = cimag(q);
            im[0] = -cimag(q), im[1] = creal(q);
        }
    for (int k = 0; k < l->direct; k++)
        s->Q[PARTS * t->poles * l->drives + k + (size_t)s->K * (2 * t->poles + k)] = 1;
}

static enum modal_status sums_new(const struct lines *l, int poles, struct sums *s,
                                  struct modal_error *err)
{
    size_t K = (size_t)(PARTS * poles * l->drives + l->direct), V = (size_t)(2 * poles + l->direct);
    size_t g = (size_t)(2 * poles * l->drives), R = (size_t)l->responses;

    *s = (struct sums) { .K = (int)K, .V = (int)V, .g = (int)g };
    s->G = workspace_zeros(&s->held, K * K, sizeof(double));
    s->B = workspace_zeros(&s->held, K * R, sizeof(double));
    s->GV = workspace_zeros(&s->held, K * V, sizeof(double));
    s->A = workspace_zeros(&s->held, V * V, sizeof(double));
    s->Q = workspace_zeros(&s->held, K * V, sizeof(double));
    s->S = workspace_zeros(&s->held, g * g, sizeof(double));
    s->d = workspace_zeros(&s->held, g, sizeof(double));
    s->block = workspace_zeros(&s->held, 2 * BLOCK * (K + V + 2 * R), sizeof(double));
    return workspace_check(&s->held, "transfer: no memory for the sums over lines", err);
}

/* G and B. */
static void take_sums(const struct lines *l, const struct transfer *t, struct sums *s)
{
    int K = s->K;

    for (int first = 0; first < l->count; first += BLOCK) {
        int rows = l->count - first < BLOCK ? l->count - first : BLOCK, two = 2 * rows;
        double *C = s->block, *Y = C + (size_t)two * K;
        fill_columns(l, t, first, rows, C);
        fill_responses(l, first, rows, Y);
        cblas_dsyrk(CblasColMajor, CblasUpper, CblasTrans, K, two, 1, C, two, first > 0, s->G, K);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, K, l->responses, two, 1, C, two, Y,
                    two, first > 0, s->B, K);
    }
    for (int c = 0; c < K; c++)
        for (int r = 0; r < c; r++)
            s->G[c + (size_t)r * K] = s->G[r + (size_t)c * K];
}

/* A := A^-1 on the directions that are there, columns over their norms. */
static enum modal_status invert(double *A, int n, struct modal_error *err)
{
    double *size = calloc((size_t)n + 1, sizeof *size), *w = calloc((size_t)n + 1, sizeof *w);
    double *V = calloc((size_t)n * n + 1, sizeof *V);
    enum modal_status rc = size != NULL && w != NULL && V != NULL
        ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "transfer: no memory for %d unknowns", n);

    for (int i = 0; i < n && rc == MODAL_OK; i++)
        /* units of columns are no condition */
        size[i] = A[i + (size_t)n * i] > 0 ? 1 / sqrt(A[i + (size_t)n * i]) : 0;
    for (int i = 0; i < n * n && rc == MODAL_OK; i++)
        V[i] = A[i] * size[i % n] * size[i / n];
    if (rc == MODAL_OK)
        rc = eigen_symmetric(&(struct matrix) { n, n, n, V }, w, err);
    if (rc == MODAL_OK) {
        memset(A, 0, sizeof *A * (size_t)n * n);
        for (int k = 0; k < n; k++)
            /* a pseudoinverse: columns that others make get no amplitude of their own */
            if (w[k] > DEPENDENT * w[n - 1])
                cblas_dger(CblasColMajor, n, n, 1 / w[k], V + (size_t)n * k, 1, V + (size_t)n * k,
                           1, A, n);
        for (int i = 0; i < n * n; i++)
            A[i] *= size[i % n] * size[i / n];
    }
    free(size), free(w), free(V);
    return rc;
}

/* Y - V x of a block of lines, below its columns V. */
static double *block_rest(const struct lines *l, const struct transfer *t, struct sums *s,
                          int first, int rows)
{
    int two = 2 * rows, K = s->K;
    double *C = s->block, *V = C + (size_t)two * K, *Y = V + (size_t)two * s->V;

    fill_columns(l, t, first, rows, C);
    fill_responses(l, first, rows, Y);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, two, s->V, K, 1, C, two, s->Q, K, 0, V,
                two);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, two, l->responses, s->V, -1, V, two,
                t->x, s->V, 1, Y, two);
    return Y;
}

/* rss, v and the likelihood. */
static void weigh(const struct lines *l, struct transfer *t, struct sums *s)
{
    double shared = (double)s->g / l->responses, numbers = 2.0 * l->count;

    memset(t->rss, 0, sizeof *t->rss * (size_t)l->responses);
    memset(t->band, 0, sizeof *t->band * (size_t)l->responses * l->bands);
    for (int first = 0, band = 0, end = lines_band_end(l, 0), rows; first < l->count;
         first += rows) {
        double *rest;
        if (first == end)
            band++, end = lines_band_end(l, first);
        rows = end - first < BLOCK ? end - first : BLOCK;
        rest = block_rest(l, t, s, first, rows);
        for (int i = 0; i < l->responses; i++) {
            double *r = rest + 2 * (size_t)rows * i, sum = cblas_ddot(2 * rows, r, 1, r, 1);
            t->rss[i] += sum;
            t->band[band + (size_t)l->bands * i] += sum;
        }
    }
    t->likelihood = 0, t->exact = true;
    for (int i = 0; i < l->responses; i++) {
        double least = REFINE_EXACT * REFINE_EXACT * l->energy[i];  /* a recursion's rounding */
        if (l->energy[i] == 0) {
            t->variance[i] = HUGE_VAL;
            continue;
        }
        t->exact = t->exact && t->rss[i] <= least;
        /* each response has V numbers of its own, and its share of s and q */
        t->variance[i] = fmax(t->rss[i], least) / fmax(numbers - s->V - shared, 1);
        /* over the energy: only differences count, and no overflow */
        t->likelihood -= l->count * log(fmax(t->rss[i], least) / l->energy[i]);
    }
}

/* All sums at *T. */
static enum modal_status take_all(const struct lines *l, const struct transfer *t, struct sums *s,
                                  struct modal_error *err)
{
    int K = s->K, V = s->V;

    s->spent += work_of_measure(l, t->poles);
    fill_Q(l, t, s);
    take_sums(l, t, s);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, K, V, K, 1, s->G, K, s->Q, K, 0, s->GV,
                K);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, V, V, K, 1, s->Q, K, s->GV, K, 0, s->A, V);
    return invert(s->A, V, err);
}

/* These, its shapes and direct terms, its likelihood. */
static enum modal_status measure(const struct lines *l, struct transfer *t, struct sums *s,
                                 struct modal_error *err)
{
    int K = s->K, V = s->V;
    double *b = calloc((size_t)V * l->responses + 1, sizeof *b);
    enum modal_status rc = b != NULL ? take_all(l, t, s, err)
        : modal_fail(err, MODAL_NO_MEMORY, "transfer: no memory for %d responses", l->responses);

    if (rc == MODAL_OK) {
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, V, l->responses, K, 1, s->Q, K, s->B,
                    K, 0, b, V);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, V, l->responses, V, 1, s->A, V, b, V,
                    0, t->x, V);
        weigh(l, t, s);
    }
    free(b);
    return rc;
}

/* ---- steps ---- */

/* T_i: K x g, of which pole p's columns are 2 drives p and on. */
static void fill_T(const struct lines *l, const struct transfer *t, int i, int K, double *T)
{
    int V = 2 * t->poles + l->direct;

    memset(T, 0, sizeof *T * (size_t)K * (size_t)(2 * t->poles * l->drives));
    for (int p = 0; p < t->poles; p++) {
        const double *x = t->x + 2 * p + (size_t)V * i;
        double complex phi = CMPLX(x[0], x[1]);
        double *at = T + (size_t)K * 2 * l->drives * p, *free_q = at + 2 * (size_t)K;
        for (int j = 0; j < l->drives; j++) {
            int c = PARTS * (p * l->drives + j);
            double complex k = phi * t->q[j + (size_t)p * l->drives];
            /* moving s moves columns 2 and 3, its derivatives */
            at[c + 2] = creal(k), at[c + 3] = cimag(k);
            at[c + 2 + K] = -cimag(k), at[c + 3 + K] = creal(k);
            if (j == t->held[p])
                continue;
            /* moving q moves the columns themselves */
            free_q[c] = creal(phi), free_q[c + 1] = cimag(phi);
            free_q[c + K] = -cimag(phi), free_q[c + 1 + K] = creal(phi);
            free_q += 2 * (size_t)K;
        }
    }
}

/* S and the right side of (1). */
static enum modal_status make_step(const struct lines *l, const struct transfer *t, struct sums *s,
                                   struct modal_error *err)
{
    int K = s->K, V = s->V, g = s->g;
    double *P = malloc(sizeof *P * ((size_t)K * K + (size_t)K * V + 2 * (size_t)K * g + K));
    double *AV = P + (size_t)K * K, *T = AV + (size_t)K * V, *PT = T + (size_t)K * g;
    double *rest = PT + (size_t)K * g;

    if (P == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "transfer: no memory for %d unknowns", g);
    s->spent += work_of_step(l, t->poles);
    memcpy(P, s->G, sizeof *P * (size_t)K * K);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, K, V, V, 1, s->GV, K, s->A, V, 0, AV, K);
    /* C^T P C of (1) */
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, K, K, V, -1, AV, K, s->GV, K, 1, P, K);
    memset(s->S, 0, sizeof *s->S * (size_t)g * g);
    memset(s->d, 0, sizeof *s->d * (size_t)g);
    for (int i = 0; i < l->responses; i++) {
        fill_T(l, t, i, K, T);
        memcpy(rest, s->B + (size_t)K * i, sizeof *rest * K);
        cblas_dgemv(CblasColMajor, CblasNoTrans, K, V, -1, s->GV, K, t->x + (size_t)V * i, 1, 1,
                    rest, 1);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, K, g, K, 1, P, K, T, K, 0, PT, K);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, g, g, K, 1 / t->variance[i], T, K, PT,
                    K, 1, s->S, g);
        cblas_dgemv(CblasColMajor, CblasTrans, K, g, 1 / t->variance[i], T, K, rest, 1, 1, s->d, 1);
    }
    free(P);
    return MODAL_OK;
}

/* (S + damping diag S) d := d, S overwritten; what that promises of the likelihood, NAN where S is
 * not definite. */
static double solve(double *S, double *d, int g, double damping)
{
    double promise = 0;
    double *size = malloc(sizeof *size * (2 * (size_t)g + 1)), *right = size + g;
    bool good = size != NULL;

    for (int i = 0; i < g && good; i++) {
        size[i] = S[i + (size_t)g * i] > 0 ? 1 / sqrt(S[i + (size_t)g * i]) : 1;
        right[i] = d[i];
    }
    for (int i = 0; i < g * g && good; i++)
        S[i] *= size[i % g] * size[i / g];
    for (int i = 0; i < g && good; i++) {
        S[i + (size_t)g * i] = 1 + damping + RIDGE;
        d[i] *= size[i];
    }
    good = good && LAPACKE_dposv(LAPACK_COL_MAJOR, 'U', g, 1, S, g, d, g) == 0;
    for (int i = 0; i < g && good; i++) {
        d[i] *= size[i];
        promise += d[i] * right[i] / 2;
    }
    free(size);
    return good ? promise : NAN;
}

/* *T moved by d; false where a pole leaves the upper half plane.  Of one on the real axis the
 * second columns are zero, and so is their part of d. */
static bool move(const struct lines *l, struct transfer *t, const double *d)
{
    bool inside = true;

    for (int p = 0; p < t->poles; p++) {
        const double *at = d + 2 * (size_t)l->drives * p, *q = at + 2;
        bool swings = cimag(t->s[p]) > 0;
        t->s[p] = swings ? t->s[p] + CMPLX(at[0], at[1]) : creal(t->s[p]) + at[0];
        inside = inside && (cimag(t->s[p]) > 0) == swings && cimag(t->s[p]) < M_PI
            && fabs(creal(t->s[p])) < FASTEST;
        for (int j = 0; j < l->drives; j++)
            if (j != t->held[p]) {
                t->q[j + (size_t)p * l->drives] += CMPLX(q[0], q[1]);
                q += 2;
            }
    }
    return inside;
}

/* S := S^-1, both triangles; false where it is not definite. */
static bool covariance(double *S, int g)
{
    double *size = malloc(sizeof *size * ((size_t)g + 1));
    bool good = size != NULL;

    for (int i = 0; i < g && good; i++)
        size[i] = S[i + (size_t)g * i] > 0 ? 1 / sqrt(S[i + (size_t)g * i]) : 1;
    for (int i = 0; i < g * g && good; i++)
        S[i] *= size[i % g] * size[i / g];
    for (int i = 0; i < g && good; i++)
        S[i + (size_t)g * i] = 1 + RIDGE;
    good = good && LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'U', g, S, g) == 0
        && LAPACKE_dpotri(LAPACK_COL_MAJOR, 'U', g, S, g) == 0;
    for (int j = 0; j < g && good; j++)
        for (int i = 0; i <= j; i++)
            S[j + (size_t)g * i] = S[i + (size_t)g * j] *= size[i] * size[j];
    free(size);
    return good;
}

/* Standard deviations of s from S at *T. */
static enum modal_status spread(const struct lines *l, struct transfer *t, struct sums *s,
                                struct modal_error *err)
{
    enum modal_status rc = make_step(l, t, s, err);
    bool good = rc == MODAL_OK && covariance(s->S, s->g);

    for (int i = 0; i < 2 * t->poles && rc == MODAL_OK; i++) {
        size_t at = (size_t)(i / 2 * 2 * l->drives + i % 2);
        t->spread[i] = !good ? NAN
                     : i % 2 == 1 && cimag(t->s[i / 2]) == 0 ? 0
                     : sqrt(s->S[at + (size_t)s->g * at]);
    }
    return rc;
}

/* Of each pole's part: x^T V^T V x of its own columns. */
static void share_energy(const struct lines *l, struct transfer *t, const struct sums *s)
{
    for (int p = 0; p < t->poles; p++) {
        t->energy[p] = 0;
        for (int i = 0; i < l->responses; i++) {
            const double *x = t->x + 2 * p + (size_t)s->V * i;
            for (int a = 0; a < 2; a++)
                for (int b = 0; b < 2; b++)
                    t->energy[p] += x[a] * x[b]
                        * cblas_ddot(s->K, s->Q + (size_t)s->K * (2 * p + a), 1,
                                     s->GV + (size_t)s->K * (2 * p + b), 1);
        }
    }
}

/* One step that raises the likelihood, if there is one; *left is what a whole one promises.  The
 * sums are those of *NEXT where it MOVED. */
static enum modal_status advance(const struct lines *l, struct transfer *t, struct transfer *next,
                                 struct sums *s, double enough, double *damping, double *left,
                                 bool *moved, struct modal_error *err)
{
    size_t g = (size_t)s->g;
    double *kept = malloc(sizeof *kept * (g * g + g + 1));
    enum modal_status rc = kept != NULL ? make_step(l, t, s, err)
                                        : modal_fail(err, MODAL_NO_MEMORY,
                                                     "transfer: no memory for %d unknowns", s->g);

    *moved = false;
    if (rc == MODAL_OK) {
        memcpy(kept, s->S, sizeof *kept * g * g);
        memcpy(kept + g * g, s->d, sizeof *kept * g);
        *left = solve(s->S, s->d, s->g, 0);
    }
    for (int i = 0; i < TRIES && rc == MODAL_OK && !*moved && !(*left <= enough)
         && s->spent < s->most; i++) {
        memcpy(s->S, kept, sizeof *kept * g * g);
        memcpy(s->d, kept + g * g, sizeof *kept * g);
        transfer_copy(l, t, next);
        if (isfinite(solve(s->S, s->d, s->g, *damping)) && move(l, next, s->d)) {
            rc = measure(l, next, s, err);
            *moved = rc == MODAL_OK && next->likelihood > t->likelihood;
        }
        *damping = *moved ? *damping / 10 : fmax(10 * *damping, CAREFUL);
    }
    free(kept);
    return rc;
}

enum modal_status transfer_fit(const struct lines *l, const struct transfer_limits *limits,
                               struct transfer *t, struct modal_error *err)
{
    struct transfer next = { 0 };
    struct sums s = { 0 };
    double damping = CAREFUL, left = HUGE_VAL;
    bool moved = true;
    enum modal_status rc = sums_new(l, t->poles, &s, err);

    s.most = *limits->work;
    if (rc == MODAL_OK)
        rc = transfer_new(l, &next, err);
    if (rc == MODAL_OK)
        rc = measure(l, t, &s, err);
    t->converged = t->poles == 0;
    for (int i = 0; i < limits->steps && rc == MODAL_OK && moved && !t->converged
         && s.spent < s.most; i++) {
        if (limits->cancelled != NULL && limits->cancelled(limits->context))
            rc = modal_fail(err, MODAL_CANCELLED, "cancelled");
        else
            rc = advance(l, t, &next, &s, limits->enough, &damping, &left, &moved, err);
        if (rc == MODAL_OK && moved)
            transfer_copy(l, &next, t);
        if (rc == MODAL_OK && (hold_all(l, t) || !moved))
            rc = measure(l, t, &s, err);
        t->converged = left <= limits->enough || (!moved && t->exact);
    }
    if (rc == MODAL_OK && t->poles > 0)
        rc = spread(l, t, &s, err);
    if (rc == MODAL_OK)
        share_energy(l, t, &s);
    *limits->work -= s.spent;
    transfer_done(&next);
    workspace_free(&s.held);
    return rc;
}

enum modal_status transfer_rest(const struct lines *l, const struct transfer *t, double complex *R,
                                struct modal_error *err)
{
    struct sums s = { 0 };
    enum modal_status rc = sums_new(l, t->poles, &s, err);

    if (rc == MODAL_OK)
        fill_Q(l, t, &s);
    for (int first = 0; first < l->count && rc == MODAL_OK; first += BLOCK) {
        int rows = l->count - first < BLOCK ? l->count - first : BLOCK;
        const double *rest = block_rest(l, t, &s, first, rows);
        for (int i = 0; i < l->responses; i++)
            for (int n = 0; n < rows; n++)
                R[first + n + (size_t)i * l->count]
                    = CMPLX(rest[n + 2 * (size_t)rows * i], rest[n + rows + 2 * (size_t)rows * i]);
    }
    workspace_free(&s.held);
    return rc;
}

/* ---- frequency responses ---- */

/* V's and C's rows at z for a unit of input j alone. */
static void fill_rows(const struct lines *l, const struct transfer *t, double complex z, int j,
                      double complex *v, double complex *c)
{
    int V = 2 * t->poles, K = PARTS * t->poles * l->drives;

    memset(c, 0, sizeof *c * (size_t)K);
    for (int p = 0; p < t->poles; p++) {
        double complex r = cexp(t->s[p]), u = conj(r), a = 1 / (z - r), b = 1 / (z - u);
        double complex q = t->q[j + (size_t)p * l->drives], w = 1 / l->size[j];
        double complex *own = c + PARTS * ((size_t)p * l->drives + j);
        own[0] = w * (a + b), own[1] = I * w * (a - b);
        own[2] = w * (r * a * a + u * b * b), own[3] = I * w * (r * a * a - u * b * b);
        v[2 * p] = w * (q * a + conj(q) * b), v[2 * p + 1] = I * w * (q * a - conj(q) * b);
    }
    lines_direct(l, z, j, v + V);
    memcpy(c + K, v + V, sizeof *c * (size_t)l->direct);
}

/* x^T M x, M n x n. */
static double square_in(const double *M, int n, const double *x, double *room)
{
    cblas_dgemv(CblasColMajor, CblasNoTrans, n, n, 1, M, n, x, 1, 0, room, 1);
    return cblas_ddot(n, x, 1, room, 1);
}

struct rows { double complex *v, *c; double *part, *moved, *room, *T; struct workspace held; };

/* Response i by its rows, and (2), real and imaginary part together. */
static double complex respond(const struct lines *l, const struct transfer *t, const struct sums *s,
                              const struct rows *r, int i, double *variance)
{
    double complex H = 0;

    *variance = 0;
    for (int k = 0; k < s->V; k++)
        H += r->v[k] * t->x[k + (size_t)s->V * i];
    fill_T(l, t, i, s->K, r->T);
    for (int half = 0; half < 2; half++) {
        for (int k = 0; k < s->V; k++)
            r->part[k] = half == 0 ? creal(r->v[k]) : cimag(r->v[k]);
        cblas_dgemv(CblasColMajor, CblasNoTrans, s->V, s->V, 1, s->A, s->V, r->part, 1, 0, r->moved,
                    1);
        *variance += t->variance[i] * cblas_ddot(s->V, r->part, 1, r->moved, 1);
        for (int k = 0; k < s->K; k++)
            r->room[k] = half == 0 ? creal(r->c[k]) : cimag(r->c[k]);
        cblas_dgemv(CblasColMajor, CblasNoTrans, s->K, s->V, -1, s->GV, s->K, r->moved, 1, 1,
                    r->room, 1);
        if (s->g > 0) {
            cblas_dgemv(CblasColMajor, CblasTrans, s->K, s->g, 1, r->T, s->K, r->room, 1, 0,
                        r->part, 1);
            *variance += square_in(s->S, s->g, r->part, r->moved);
        }
    }
    return H;
}

static enum modal_status rows_new(const struct sums *s, struct rows *r, struct modal_error *err)
{
    size_t K = (size_t)s->K, most = K + (size_t)s->V + (size_t)s->g;

    *r = (struct rows) { 0 };
    r->v = workspace_zeros(&r->held, (size_t)s->V, sizeof *r->v);
    r->c = workspace_zeros(&r->held, K, sizeof *r->c);
    r->part = workspace_zeros(&r->held, most, sizeof *r->part);
    r->moved = workspace_zeros(&r->held, most, sizeof *r->moved);
    r->room = workspace_zeros(&r->held, most, sizeof *r->room);
    r->T = workspace_zeros(&r->held, K * (size_t)s->g, sizeof *r->T);
    return workspace_check(&r->held, "transfer: no memory for frequency responses", err);
}

enum modal_status transfer_frf(const struct lines *l, struct transfer *t, const double *turn,
                               int count, double complex *H, double *spread_of,
                               struct modal_error *err)
{
    struct sums s = { 0 };
    struct rows r = { 0 };
    bool good = false;
    enum modal_status rc = sums_new(l, t->poles, &s, err);

    if (rc == MODAL_OK && (rc = rows_new(&s, &r, err)) == MODAL_OK)
        rc = measure(l, t, &s, err);
    if (rc == MODAL_OK && t->poles > 0)
        rc = make_step(l, t, &s, err);
    if (rc == MODAL_OK)
        good = t->poles == 0 || covariance(s.S, s.g);
    for (int j = 0; j < l->inputs && rc == MODAL_OK; j++)
        for (int f = 0; f < count; f++) {
            fill_rows(l, t, cexp(CMPLX(0, turn[f])), j, r.v, r.c);
            for (int i = 0; i < l->responses; i++) {
                size_t at = f + (size_t)count * (i + (size_t)l->responses * j);
                double variance;
                H[at] = respond(l, t, &s, &r, i, &variance);
                spread_of[at] = good ? sqrt(variance) : NAN;
            }
        }
    workspace_free(&s.held), workspace_free(&r.held);
    return rc;
}

/* ---- more of the inputs ---- */

double transfer_gain_work(const struct lines *l, int poles, int columns)
{
    double K = PARTS * poles * l->drives + l->direct, n = columns + 1;

    return transfer_work(l, poles) + 2.0 * l->count * l->responses * n * (K + n);
}

/* Of a block of lines at a time. */
struct answers {
    int n;                       /* of each response: itself, and what it does by each column */
    double complex *v, *H;       /* a line's rows; responses by inputs that have columns */
    double *Y;                   /* those n of a response, real parts above imaginary ones */
    double *B, *YY;              /* over all lines: C^T Y of each response, Y^T Y over v of all */
    double *T, *VY, *X, *J, *SJ;
    struct workspace held;
};

static enum modal_status answers_new(const struct lines *l, const struct sums *s, int n,
                                     struct answers *a, struct modal_error *err)
{
    size_t K = (size_t)s->K, V = (size_t)s->V, g = (size_t)s->g, N = (size_t)n;

    *a = (struct answers) { .n = n };
    a->v = workspace_zeros(&a->held, V + K, sizeof *a->v);
    a->H = workspace_zeros(&a->held, (size_t)BLOCK * l->responses * l->inputs, sizeof *a->H);
    a->Y = workspace_zeros(&a->held, 2 * BLOCK * N, sizeof *a->Y);
    a->B = workspace_zeros(&a->held, K * N * l->responses, sizeof *a->B);
    a->YY = workspace_zeros(&a->held, N * N, sizeof *a->YY);
    a->T = workspace_zeros(&a->held, K * g, sizeof *a->T);
    a->VY = workspace_zeros(&a->held, V * N, sizeof *a->VY);
    a->X = workspace_zeros(&a->held, V * N, sizeof *a->X);
    a->J = workspace_zeros(&a->held, g * N, sizeof *a->J);
    a->SJ = workspace_zeros(&a->held, g * N, sizeof *a->SJ);
    return workspace_check(&a->held, "transfer: no memory for more of the inputs", err);
}

/* a->H of `rows` lines from FIRST on. */
static void fill_H(const struct lines *l, const struct transfer *t,
                   const struct transfer_more *more, int first, int rows, struct answers *a)
{
    int V = 2 * t->poles + l->direct;

    for (int c = 0; c < more->count; c++) {
        int j = more->input[c];
        for (int n = 0; n < rows && (c == 0 || j != more->input[c - 1]); n++) {
            fill_rows(l, t, l->z[first + n], j, a->v, a->v + V);
            for (int i = 0; i < l->responses; i++) {
                double complex h = 0;
                for (int k = 0; k < V; k++)
                    h += a->v[k] * t->x[k + (size_t)V * i];
                a->H[n + (size_t)rows * (i + (size_t)l->responses * j)] = h;
            }
        }
    }
}

/* a->B and a->YY. */
static void take_answers(const struct lines *l, const struct transfer *t,
                         const struct transfer_more *more, struct sums *s, struct answers *a)
{
    int K = s->K, N = a->n;

    for (int first = 0; first < l->count; first += BLOCK) {
        int rows = l->count - first < BLOCK ? l->count - first : BLOCK, two = 2 * rows;
        fill_columns(l, t, first, rows, s->block);
        fill_H(l, t, more, first, rows, a);
        for (int i = 0; i < l->responses; i++) {
            for (int n = 0; n < rows; n++)
                put(a->Y, rows, n, l->Y[first + n + (size_t)i * l->count]);
            for (int c = 0; c < more->count; c++) {
                const double complex *u = more->U + first + (size_t)c * l->count;
                const double complex *h
                    = a->H + (size_t)rows * (i + (size_t)l->responses * more->input[c]);
                for (int n = 0; n < rows; n++)
                    put(a->Y + (size_t)two * (c + 1), rows, n, h[n] * u[n]);
            }
            cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, K, N, two, 1, s->block, two, a->Y,
                        two, 1, a->B + (size_t)K * N * i, K);
            cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, N, N, two, 1 / t->variance[i],
                        a->Y, two, a->Y, two, 1, a->YY, N);
        }
    }
}

/* M of transfer_gain(), by these, all sums and S^-1. */
static void take_gain(const struct lines *l, const struct transfer *t, const struct sums *s,
                      struct answers *a, double *M)
{
    int K = s->K, V = s->V, g = s->g, n = a->n;
    double *VY = a->VY, *X = a->X, *J = a->J, *SJ = a->SJ;

    memcpy(M, a->YY, sizeof *M * (size_t)n * n);
    for (int i = 0; i < l->responses; i++) {
        double w = 1 / t->variance[i], *B = a->B + (size_t)K * n * i;
        fill_T(l, t, i, K, a->T);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, V, n, K, 1, s->Q, K, B, K, 0, VY, V);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, V, n, V, 1, s->A, V, VY, V, 0, X, V);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, K, n, V, -1, s->GV, K, X, V, 1, B,
                    K);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, n, n, V, -w, X, V, VY, V, 1, M, n);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, g, n, K, w, a->T, K, B, K, 1, J, g);
    }
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, g, n, g, 1, s->S, g, J, g, 0, SJ, g);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, n, n, g, -1, J, g, SJ, g, 1, M, n);
    for (int c = 1; c < n; c++)
        if (!(M[c + (size_t)n * c] > REFINE_TIED * a->YY[c + (size_t)n * c]))
            M[n * c] = 0;           /* what all else leaves of it is rounding of its square */
}

enum modal_status transfer_gain(const struct lines *l, struct transfer *t,
                                const struct transfer_more *more, double *M,
                                struct modal_error *err)
{
    struct sums s = { 0 };
    struct answers a = { 0 };
    enum modal_status rc = sums_new(l, t->poles, &s, err);

    if (rc == MODAL_OK)
        rc = answers_new(l, &s, more->count + 1, &a, err);
    if (rc == MODAL_OK)
        rc = take_all(l, t, &s, err);
    if (rc == MODAL_OK)
        rc = make_step(l, t, &s, err);
    if (rc == MODAL_OK && s.g > 0 && !covariance(s.S, s.g))
        memset(s.S, 0, sizeof *s.S * (size_t)s.g * s.g);    /* s and q then stay where they are */
    if (rc == MODAL_OK) {
        take_answers(l, t, more, &s, &a);
        take_gain(l, t, &s, &a, M);
    }
    workspace_free(&s.held), workspace_free(&a.held);
    return rc;
}
