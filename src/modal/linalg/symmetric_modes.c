/*
 * symmetric_modes.c - Lanczos's method for K^-1 M in the product of M, several starts at a time
 *
 * K^-1 M is symmetric in x^T M y, and its largest eigenvalues are 1 / lambda.  From STARTS vectors
 * each step makes K^-1 M v of the next vector v, takes off its parts along all vectors so far
 * (twice: they stay orthonormal to rounding) and adds what is left, [GU77]: of k steps T = V^T M
 * K^-1 M V is known, k x k, and what leads out of it, B.  With T y = theta y the pair (V y, theta)
 * has the residual |B y|.  Several starts find modes of one frequency, as those of a square plate.
 *
 * [GU77] Golub and Underwood, The block Lanczos method for computing eigenvalues, in Mathematical
 * Software III (1977) 361-377.
 */
#include "modal/linalg/symmetric_modes.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/eigen.h"
#include "modal/linalg/sparse_lu.h"
#include "modal/linalg/workspace.h"

enum {
    STARTS = 4,           /* the most modes of one frequency that are told apart at once */
    STEPS_A_MODE = 3,     /* at the most, */
    STEPS_MORE = 40,      /* and so many beside: far below it the lowest have settled */
    LOOK_EVERY = 8        /* steps between small eigenproblems, and a tenth of those so far */
};
/* Of a pair, relative to its 1 / lambda; lambda is off by its square. */
static const double SETTLED = 1e-9;
/* What M K^-1 M takes off but for so little is rounding. */
static const double ROUNDING = 1e-12;

struct search {
    const struct sparse *M;
    struct sparse_lu *factors;
    int n, most, vectors, steps;
    double *V, *H;                    /* n x most; most x most, [k most + i]: v_i^T M K^-1 M v_k */
    double *x, *y, *along, *scratch;  /* n, n, most, n + most */
    double *T, *theta;                /* steps x steps and its eigenvalues */
    struct workspace space;
};

bool symmetric_modes_join(const struct sparse *M, const double *V, int count, double least,
                          double *x, double *along, double *norm, double *scratch)
{
    int n = M->m;
    double before = 0, square;

    for (int i = 0; i < count; i++)
        along[i] = 0;
    for (int round = 0; round < 2; round++) {
        memset(scratch, 0, (size_t)n * sizeof *scratch);
        sparse_multiply_add(M, 1, x, scratch);
        before = round == 0 ? cblas_ddot(n, x, 1, scratch, 1) : before;
        if (count == 0)
            break;
        cblas_dgemv(CblasColMajor, CblasTrans, n, count, 1, V, n, scratch, 1, 0, scratch + n, 1);
        cblas_dgemv(CblasColMajor, CblasNoTrans, n, count, -1, V, n, scratch + n, 1, 1, x, 1);
        cblas_daxpy(count, 1, scratch + n, 1, along, 1);
    }
    memset(scratch, 0, (size_t)n * sizeof *scratch);
    sparse_multiply_add(M, 1, x, scratch);
    square = cblas_ddot(n, x, 1, scratch, 1);
    *norm = 0;
    if (!(square > least * least * before) || !isfinite(square))
        return false;
    *norm = sqrt(square);
    cblas_dscal(n, 1 / *norm, x, 1);
    return true;
}

/* y = K^-1 M x */
static void apply(struct search *s, const double *x, double *y)
{
    memset(s->scratch, 0, (size_t)s->n * sizeof *s->scratch);
    sparse_multiply_add(s->M, 1, x, s->scratch);
    sparse_lu_solve(s->factors, s->scratch, y);
}

/* s->x as one more vector; what it has along the others is in s->along. */
static bool add_vector(struct search *s, double *norm)
{
    if (s->vectors == s->most
        || !symmetric_modes_join(s->M, s->V, s->vectors, ROUNDING, s->x, s->along, norm,
                                 s->scratch))
        return false;
    memcpy(s->V + (size_t)s->vectors++ * (size_t)s->n, s->x, (size_t)s->n * sizeof *s->x);
    return true;
}

/* Vectors without a pattern: a congruence's. */
static void begin(struct search *s)
{
    unsigned state = 1;
    double norm;

    for (int j = 0; j < STARTS; j++) {
        for (int i = 0; i < s->n; i++) {
            state = state * 1664525u + 1013904223u;
            s->y[i] = (double)(state >> 8) / (1 << 24) - 0.5;
        }
        apply(s, s->y, s->x);
        add_vector(s, &norm);
    }
}

/* The next vector's image: one step. */
static void step(struct search *s)
{
    double norm = 0, *h = s->H + (size_t)s->steps * (size_t)s->most;
    int known = s->vectors;
    bool more;

    apply(s, s->V + (size_t)s->steps * (size_t)s->n, s->x);
    more = add_vector(s, &norm);
    if (!more && known == s->most)      /* no room: only what it has along those there are */
        symmetric_modes_join(s->M, s->V, known, ROUNDING, s->x, s->along, &norm, s->scratch);
    memcpy(h, s->along, (size_t)known * sizeof *h);
    if (more)
        h[known] = norm;
    s->steps++;
}

/* Eigenvalues of T and their vectors; whether the WANTED largest in size have settled. */
static enum modal_status look(struct search *s, int wanted, bool *settled, struct modal_error *err)
{
    int k = s->steps;
    struct matrix T = { .m = k, .n = k, .ld = k, .x = s->T };
    enum modal_status rc;

    for (int j = 0; j < k; j++)
        for (int i = 0; i < k; i++)
            s->T[j * k + i] = s->H[(size_t)(i < j ? j : i) * (size_t)s->most
                                   + (size_t)(i < j ? i : j)];
    rc = eigen_symmetric(&T, s->theta, err);
    *settled = rc == MODAL_OK && k >= wanted;
    for (int j = 0, low = 0, high = k - 1; *settled && j < wanted; j++) {
        int at = fabs(s->theta[low]) > fabs(s->theta[high]) ? low++ : high--;
        double square = 0;

        for (int i = k; i < s->vectors; i++) {           /* rows of B */
            double sum = 0;

            for (int c = k > STARTS ? k - STARTS : 0; c < k; c++)
                sum += s->H[(size_t)c * (size_t)s->most + (size_t)i] * s->T[at * k + c];
            square += sum * sum;
        }
        *settled = sqrt(square) <= SETTLED * fabs(s->theta[at]);
    }
    return rc;
}

/* The COUNT largest in size: lambda = 1 / theta, phi = V y. */
static enum modal_status write(const struct search *s, int count, struct symmetric_modes *out,
                               struct modal_error *err)
{
    int k = s->steps;

    *out = (struct symmetric_modes){ .count = count,
                                     .lambda = calloc((size_t)count + 1, sizeof *out->lambda),
                                     .phi = calloc((size_t)s->n * (size_t)count + 1,
                                                   sizeof *out->phi) };
    if (out->lambda == NULL || out->phi == NULL) {
        symmetric_modes_done(out);
        return modal_fail(err, MODAL_NO_MEMORY, "modes: no memory for %d of %d dofs", count, s->n);
    }
    for (int j = 0, low = 0, high = k - 1; j < count; j++) {
        int at = fabs(s->theta[low]) > fabs(s->theta[high]) ? low++ : high--;

        out->lambda[j] = 1 / s->theta[at];
        cblas_dgemv(CblasColMajor, CblasNoTrans, s->n, k, 1, s->V, s->n, s->T + at * k, 1, 0,
                    out->phi + (size_t)j * (size_t)s->n, 1);
    }
    return MODAL_OK;
}

static enum modal_status search_init(struct search *s, int wanted, struct modal_error *err)
{
    size_t n = (size_t)s->n, most;

    s->most = STEPS_A_MODE * wanted + STEPS_MORE < s->n ? STEPS_A_MODE * wanted + STEPS_MORE
                                                        : s->n;
    most = (size_t)s->most;
    s->V = workspace_zeros(&s->space, n * most, sizeof *s->V);
    s->H = workspace_zeros(&s->space, most * most, sizeof *s->H);
    s->x = workspace_zeros(&s->space, n, sizeof *s->x);
    s->y = workspace_zeros(&s->space, n, sizeof *s->y);
    s->along = workspace_zeros(&s->space, most, sizeof *s->along);
    s->scratch = workspace_zeros(&s->space, n + most, sizeof *s->scratch);
    s->T = workspace_zeros(&s->space, most * most, sizeof *s->T);
    s->theta = workspace_zeros(&s->space, most, sizeof *s->theta);
    return workspace_check(&s->space, "modes: no memory", err);
}

enum modal_status symmetric_modes(struct sparse_lu *factors, const struct sparse *M, int wanted,
                                  struct symmetric_modes *out, struct modal_error *err)
{
    struct search s = { .M = M, .factors = factors, .n = M->m };
    bool settled = false;
    int next = wanted + STARTS;
    enum modal_status rc = search_init(&s, wanted, err);

    if (rc == MODAL_OK)
        begin(&s);
    while (rc == MODAL_OK && !settled && s.steps < s.vectors) {
        step(&s);
        if (s.steps < next && s.steps < s.vectors)
            continue;
        rc = look(&s, wanted, &settled, err);
        next = s.steps + s.steps / 10 + LOOK_EVERY;
    }
    if (rc == MODAL_OK)
        rc = write(&s, wanted < s.steps ? wanted : s.steps, out, err);
    workspace_free(&s.space);
    return rc;
}

void symmetric_modes_done(struct symmetric_modes *a)
{
    free(a->lambda);
    free(a->phi);
    memset(a, 0, sizeof *a);
}
