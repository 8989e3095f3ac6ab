/*
 * transfer_gain.c - what more of the inputs would explain of what a model of transfer.h leaves
 *
 * Letters are those of transfer_sums.c.  Column c moves response i by Y_ic, H_i of the model times
 * u_c; Y_i0 is the response itself.  All else fitted anew takes from each
 *
 *     D_ic = P Y_ic - P C T_i S^-1 J_c,    J_c = sum_i w_i T_i^T C^T P Y_ic,             (1)
 *
 * so that sum_i w_i D_ic . D_ik is the score, one of the two being 0, or the information.  The
 * score's covariance is the information where what is left over is white.  Whatever it is, but of
 * any phase at each line, what line n adds to the scores is the real part of
 * r_c = sum_i w_i D_i0 conj D_ic there, whose imaginary part could as well be it: the covariance is
 * the real part of sum_n r_c conj r_k / 2.  Responses move together where what moves them does.
 */
#include <cblas.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/identify/forced/transfer_sums.h"

double transfer_gain_work(const struct lines *l, int poles, int columns)
{
    double K = SUMS_PARTS * poles * l->drives + l->direct, n = columns + 1;

    return transfer_work(l, poles) + 2.0 * l->count * l->responses * n * (K + n);
}

/* Of a block of lines at a time. */
struct answers {
    int n;                       /* of each response: itself, and what it does by each column */
    double complex *v, *U;       /* a line's rows; the columns */
    double complex *H;           /* responses by inputs that have columns */
    double *Y;                   /* those n of a response, real parts above imaginary ones */
    double *each;                /* r of lines, by columns, as Y */
    double *B, *YY;              /* over all lines: C^T Y of each response, Y^T Y over v of all */
    double *T, *TV, *VY, *X, *J, *SJ;
    struct workspace held;
};

static enum modal_status answers_new(const struct lines *l, const struct sums *s, int n,
                                     struct answers *a, struct modal_error *err)
{
    size_t K = (size_t)s->K, V = (size_t)s->V, g = (size_t)s->g, N = (size_t)n;

    *a = (struct answers) { .n = n };
    a->v = workspace_zeros(&a->held, V + K, sizeof *a->v);
    a->U = workspace_zeros(&a->held, SUMS_BLOCK * N, sizeof *a->U);
    a->H = workspace_zeros(&a->held, (size_t)SUMS_BLOCK * l->responses * l->inputs, sizeof *a->H);
    a->Y = workspace_zeros(&a->held, 2 * SUMS_BLOCK * N, sizeof *a->Y);
    a->each = workspace_zeros(&a->held, 2 * SUMS_BLOCK * N, sizeof *a->each);
    a->B = workspace_zeros(&a->held, K * N * l->responses, sizeof *a->B);
    a->YY = workspace_zeros(&a->held, N * N, sizeof *a->YY);
    a->T = workspace_zeros(&a->held, K * g, sizeof *a->T);
    a->TV = workspace_zeros(&a->held, g * V, sizeof *a->TV);
    a->VY = workspace_zeros(&a->held, V * N, sizeof *a->VY);
    a->X = workspace_zeros(&a->held, V * N, sizeof *a->X);
    a->J = workspace_zeros(&a->held, g * N, sizeof *a->J);
    a->SJ = workspace_zeros(&a->held, g * N, sizeof *a->SJ);
    return workspace_check(&a->held, "transfer: no memory for more of the inputs", err);
}

/* a->U and a->H of `rows` lines from FIRST on. */
static void fill_columns(const struct lines *l, const struct transfer *t,
                         const struct transfer_more *more, int first, int rows,
                         struct answers *a)
{
    int V = 2 * t->poles + l->direct;

    for (int c = 0; c < more->count; c++) {
        int j = more->input[c];
        more->fill(more->of, c, first, rows, a->U + (size_t)rows * c);
        for (int n = 0; n < rows && (c == 0 || j != more->input[c - 1]); n++) {
            sums_rows(l, t, l->z[first + n], j, a->v, a->v + V);
            for (int i = 0; i < l->responses; i++) {
                double complex h = 0;
                for (int k = 0; k < V; k++)
                    h += a->v[k] * t->x[k + (size_t)V * i];
                a->H[n + (size_t)rows * (i + (size_t)l->responses * j)] = h;
            }
        }
    }
}

/* a->Y of response i at these, by them. */
static void fill_Y(const struct lines *l, const struct transfer_more *more, int i, int first,
                   int rows, struct answers *a)
{
    for (int n = 0; n < rows; n++)
        sums_put(a->Y, rows, n, l->Y[first + n + (size_t)i * l->count]);
    for (int c = 0; c < more->count; c++) {
        const double complex *h
            = a->H + (size_t)rows * (i + (size_t)l->responses * more->input[c]);
        const double complex *u = a->U + (size_t)rows * c;
        for (int n = 0; n < rows; n++)
            sums_put(a->Y + 2 * (size_t)rows * (c + 1), rows, n, h[n] * u[n]);
    }
}

/* a->B and a->YY. */
static void take_answers(const struct lines *l, const struct transfer *t,
                         const struct transfer_more *more, struct sums *s, struct answers *a)
{
    int K = s->K, N = a->n;

    for (int first = 0; first < l->count; first += SUMS_BLOCK) {
        int rows = l->count - first < SUMS_BLOCK ? l->count - first : SUMS_BLOCK, two = 2 * rows;
        sums_columns(l, t, first, rows, s->block);
        fill_columns(l, t, more, first, rows, a);
        for (int i = 0; i < l->responses; i++) {
            fill_Y(l, more, i, first, rows, a);
            cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, K, N, two, 1, s->block, two, a->Y,
                        two, 1, a->B + (size_t)K * N * i, K);
            cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, N, N, two, 1 / t->variance[i],
                        a->Y, two, a->Y, two, 1, a->YY, N);
        }
    }
}

/* M of transfer_gain(), by these, all sums and S^-1; a->B of each response: what C takes of its
 * columns but for (1)'s second part, of which SJ are the steps. */
static void take_gain(const struct lines *l, const struct transfer *t, const struct sums *s,
                      struct answers *a, double *M)
{
    int K = s->K, V = s->V, g = s->g, n = a->n;
    double *VY = a->VY, *X = a->X, *J = a->J, *SJ = a->SJ;

    memcpy(M, a->YY, sizeof *M * (size_t)n * n);
    for (int i = 0; i < l->responses; i++) {
        double w = 1 / t->variance[i], *B = a->B + (size_t)K * n * i;
        sums_directions(l, t, i, K, a->T);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, V, n, K, 1, s->Q, K, B, K, 0, VY, V);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, V, n, V, 1, s->A, V, VY, V, 0, X, V);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, K, n, V, -1, s->GV, K, X, V, 1, B,
                    K);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, n, n, V, -w, X, V, VY, V, 1, M, n);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, g, n, K, w, a->T, K, B, K, 1, J, g);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, K, n, V, 1, s->Q, K, X, V, 0, B, K);
    }
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, g, n, g, 1, s->S, g, J, g, 0, SJ, g);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, n, n, g, -1, J, g, SJ, g, 1, M, n);
    for (int c = 1; c < n; c++)
        if (!(M[c + (size_t)n * c] > REFINE_TIED * a->YY[c + (size_t)n * c]))
            M[n * c] = 0;           /* what all else leaves of it is rounding of its square */
}

/* a->B of each response: what C takes of its columns, D = Y - C B. */
static void take_rest(const struct lines *l, const struct transfer *t, const struct sums *s,
                      struct answers *a)
{
    int K = s->K, V = s->V, g = s->g, n = a->n;
    double *moved = a->VY, *X = a->X;

    for (int i = 0; i < l->responses; i++) {
        double *B = a->B + (size_t)K * n * i;
        sums_directions(l, t, i, K, a->T);
        /* P C T SJ of (1), by C: T SJ less what V makes up of that */
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, K, n, g, 1, a->T, K, a->SJ, g, 1, B,
                    K);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, g, V, K, 1, a->T, K, s->GV, K, 0,
                    a->TV, g);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, V, n, g, 1, a->TV, g, a->SJ, g, 0,
                    moved, V);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, V, n, V, 1, s->A, V, moved, V, 0, X,
                    V);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, K, n, V, -1, s->Q, K, X, V, 1, B,
                    K);
    }
}

/* Adds to a->each what response i does, of a->Y there and by what C takes of it. */
static void add_each(const struct transfer *t, const struct sums *s, int i, int rows,
                     struct answers *a)
{
    int K = s->K, n = a->n, two = 2 * rows;
    double *D = a->Y, w = 1 / t->variance[i];

    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, two, n, K, -1, s->block, two,
                a->B + (size_t)K * n * i, K, 1, D, two);
    for (int c = 1; c < n; c++) {
        const double *re = D + (size_t)two * c, *im = re + rows;
        double *each = a->each + (size_t)two * (c - 1);
        for (int k = 0; k < rows; k++) {
            each[k] += w * (D[k] * re[k] + D[k + rows] * im[k]);
            each[k + rows] += w * (D[k + rows] * re[k] - D[k] * im[k]);
        }
    }
}

/* OWN of transfer_gain(). */
static void take_own(const struct lines *l, const struct transfer *t,
                     const struct transfer_more *more, const struct sums *s, struct answers *a,
                     double *own)
{
    int columns = more->count;

    take_rest(l, t, s, a);
    for (int first = 0; first < l->count; first += SUMS_BLOCK) {
        int rows = l->count - first < SUMS_BLOCK ? l->count - first : SUMS_BLOCK, two = 2 * rows;
        sums_columns(l, t, first, rows, s->block);
        fill_columns(l, t, more, first, rows, a);
        memset(a->each, 0, sizeof *a->each * (size_t)two * columns);
        for (int i = 0; i < l->responses; i++) {
            fill_Y(l, more, i, first, rows, a);
            add_each(t, s, i, rows, a);
        }
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, columns, columns, two, 0.5, a->each,
                    two, a->each, two, first > 0, own, columns);
    }
}

enum modal_status transfer_gain(const struct lines *l, struct transfer *t,
                                const struct transfer_more *more, double *M, double *own,
                                struct modal_error *err)
{
    struct sums s = { 0 };
    struct answers a = { 0 };
    enum modal_status rc = sums_new(l, t->poles, &s, err);

    if (rc == MODAL_OK)
        rc = answers_new(l, &s, more->count + 1, &a, err);
    if (rc == MODAL_OK)
        rc = sums_take(l, t, &s, err);
    if (rc == MODAL_OK)
        rc = sums_step(l, t, &s, err);
    if (rc == MODAL_OK && s.g > 0 && !sums_covariance(s.S, s.g))
        memset(s.S, 0, sizeof *s.S * (size_t)s.g * s.g);    /* s and q then stay where they are */
    if (rc == MODAL_OK) {
        take_answers(l, t, more, &s, &a);
        take_gain(l, t, &s, &a, M);
    }
    if (rc == MODAL_OK && own != NULL)
        take_own(l, t, more, &s, &a, own);
    workspace_free(&s.held), workspace_free(&a.held);
    return rc;
}
