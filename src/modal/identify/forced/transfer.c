/*
 * transfer.c - output error, by Gauss and Newton on the sums over lines
 *
 * Columns and the elimination of shapes and direct terms are transfer_sums.c's, with (1) and (2).
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
#include "modal/identify/forced/transfer_sums.h"

enum {
    TRIES = 12                   /* of one step, each ten times more careful */
};
static const double
    CAREFUL = 1e-3,              /* first damping of a step */
    FASTEST = 4;                 /* ln of what is left of a motion after a sample: nothing */

int transfer_unknowns(const struct lines *l, int poles)
{
    return poles * 2 * (l->responses + l->drives) + l->direct * l->responses;
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

/* ---- the likelihood ---- */

/* Y - V x of a block of lines, below its columns V. */
static double *block_rest(const struct lines *l, const struct transfer *t, struct sums *s,
                          int first, int rows)
{
    int two = 2 * rows, K = s->K;
    double *C = s->block, *V = C + (size_t)two * K, *Y = V + (size_t)two * s->V;

    sums_columns(l, t, first, rows, C);
    sums_responses(l, first, rows, Y);
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
        rows = end - first < SUMS_BLOCK ? end - first : SUMS_BLOCK;
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

/* These, its shapes and direct terms, its likelihood. */
static enum modal_status measure(const struct lines *l, struct transfer *t, struct sums *s,
                                 struct modal_error *err)
{
    int K = s->K, V = s->V;
    double *b = calloc((size_t)V * l->responses + 1, sizeof *b);
    enum modal_status rc = b != NULL ? sums_take(l, t, s, err)
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
        S[i + (size_t)g * i] = 1 + damping + SUMS_RIDGE;
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

/* Standard deviations of s from S at *T. */
static enum modal_status spread(const struct lines *l, struct transfer *t, struct sums *s,
                                struct modal_error *err)
{
    enum modal_status rc = sums_step(l, t, s, err);
    bool good = rc == MODAL_OK && sums_covariance(s->S, s->g);

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
    enum modal_status rc = kept != NULL ? sums_step(l, t, s, err)
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
        sums_mix(l, t, &s);
    for (int first = 0; first < l->count && rc == MODAL_OK; first += SUMS_BLOCK) {
        int rows = l->count - first < SUMS_BLOCK ? l->count - first : SUMS_BLOCK;
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
    sums_directions(l, t, i, s->K, r->T);
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
        rc = sums_step(l, t, &s, err);
    if (rc == MODAL_OK)
        good = t->poles == 0 || sums_covariance(s.S, s.g);
    for (int j = 0; j < l->inputs && rc == MODAL_OK; j++)
        for (int f = 0; f < count; f++) {
            sums_rows(l, t, cexp(CMPLX(0, turn[f])), j, r.v, r.c);
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
