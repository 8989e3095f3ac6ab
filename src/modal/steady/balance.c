/*
 * balance.c - residual and derivative of harmonic balance; see balance.h for (1)
 *
 * A periodic matrix Ac cos(kappa theta) + As sin(kappa theta) acts on y = x, x' or x'' as a gain
 * with G_kappa = (Ac - i As) / 2 alone, so that with aft.c (2) harmonic l of y reaches k = l +
 * kappa, |l - kappa| and kappa - l only.  Rows are divided by their largest entry before factoring:
 * harmonics k differ by k^2 omega^2 M in size.
 *
 * With the order HJ < H the derivative has rows and columns 0 .. HJ alone.  Where the laws' slope
 * is small beside S_k, that is S_k to (slope / |S_k|): the step past HJ is
 *
 *     S_k dX_k = -R_k,   k > HJ,                                                                (2)
 *
 * one of direct iteration.  Many dofs that few laws couple have J in blocks (blocks.h), few a full
 * matrix; one dof's S_k is a number.
 *
 * As a real matrix, harmonic k of dof i by l of j is the block of dX_k = T dX_l + H conj(dX_l),
 *
 *     [ Re T + Re H   Im H - Im T ]
 *     [ Im T + Im H   Re T - Re H ],                                                            (3)
 *
 * its first row alone for k = 0 and its first column alone for l = 0.
 */
#include "modal/steady/balance.h"
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/program.h"
#include "modal/steady/aft.h"
#include "modal/steady/blocks.h"
#include "modal/steady/budget.h"
#include "modal/steady/by_harmonic.h"
#include "modal/steady/by_inputs.h"
#include "modal/steady/condense.h"
#include "modal/steady/pattern.h"
#include "modal/steady/stiffness.h"

/* The least pivot over the largest below which some direction is held by nothing: hundreds of
 * roundings. */
static const double OPEN = 1e-13;
/* What GMRES leaves: Newton's steps then shrink as much each, and are long before another vector
 * costs less than another derivative; errors have three digits. */
static const double FORCING = 1e-3;
/* The same where another derivative costs no factors: below what a step of 1/16 must gain, 1/64. */
static const double FORCING_ON_INPUTS = 1.0 / 64;
/* Below this of the largest dof a dof's own scale counts as that: it is 0 by symmetry. */
static const double FAINT = 1e-12;
enum {
    ORDER_MOST = 12000,        /* a full matrix of it is 1.15 GB */
    ENTRIES_MOST = 1 << 24,    /* of S, full: 256 MB; */
    ENTRIES_SPARSE = 1 << 27,  /* sparse: 2 GB, a mesh of 14,000 dofs at 84 harmonics half of it */
    SOLUTIONS = 3,             /* of one derivative, with those of trial steps */
    SMALL_ORDER = 24           /* up to which a call of LAPACK costs more than its sums */
};

enum modal_status balance_new(const struct program *p, struct condense *c, int H, int N,
                              bool located, struct balance **out, struct modal_error *err)
{
    struct balance *b = calloc(1, sizeof *b);
    const struct pattern *pattern = condense_pattern(c);
    size_t q = (size_t)condense_kept(c), K = (size_t)H + 1, order = q * (2 * (size_t)H + 1);
    size_t entries = (size_t)pattern_entries(pattern) * K;
    size_t most = pattern->full ? ENTRIES_MOST : ENTRIES_SPARSE;
    enum modal_status rc = MODAL_OK;

    if (b == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "balance: no memory");
    *b = (struct balance) { .p = p, .c = c, .q = (int)q, .H = H, .order = (int)order,
                            .pattern = pattern, .level = 1, .HJ = H, .small = (int)order,
                            .forcing = FORCING };
    if (entries > most) {
        rc = modal_fail_field(err, MODAL_TOO_LARGE, "steady.harmonics",
                              "%d nonlinear dofs at %d harmonics have %zu dynamic "
                              "stiffnesses; the most is %zu", b->q, H, entries, most);
        goto out;
    }
    b->S = workspace_zeros(&b->space, entries, sizeof *b->S);
    b->load = workspace_zeros(&b->space, q * K, sizeof *b->load);
    b->F = workspace_zeros(&b->space, q * K, sizeof *b->F);
    b->R = workspace_zeros(&b->space, order, sizeof *b->R);
    b->row = workspace_zeros(&b->space, order, sizeof *b->row);
    b->gather = workspace_zeros(&b->space, order, sizeof *b->gather);
    b->kept = workspace_zeros(&b->space, pattern->full ? 0 : order, sizeof *b->kept);
    b->sum = workspace_zeros(&b->space, q, sizeof *b->sum);
    b->pivot = workspace_zeros(&b->space, order, sizeof *b->pivot);
    if (b->space.failed) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "balance: no memory for %zu unknowns", order);
        goto out;
    }
    rc = aft_new(p, condense_place(c), b->q, H, N, located, &b->aft, err);
    if (rc == MODAL_OK)
        rc = stiffness_new(pattern, H, &b->stiffness, err);
out:
    if (rc == MODAL_OK)
        *out = b;
    else
        balance_free(b);
    return rc;
}

void balance_free(struct balance *b)
{
    if (b == NULL)
        return;
    aft_free(b->aft);
    stiffness_free(b->stiffness);
    blocks_free(b->blocks);
    by_harmonic_free(b->apart);
    by_inputs_free(b->inputs);
    free(b->J);
    workspace_free(&b->space);
    free(b);
}

enum modal_status balance_set(struct balance *b, double omega, double level,
                              struct modal_error *err)
{
    b->omega = omega;
    b->level = level;
    b->damping = 0;
    b->factored = false;                                /* J is of another frequency */
    stiffness_set(b->stiffness, b->S);
    return condense_at(b->c, omega, level, b->H, b->S, b->load, err);
}

void balance_set_level(struct balance *b, double level)
{
    double by = level / b->level;                       /* loads are proportional to it */

    for (int i = 0; i < b->q * (b->H + 1); i++)
        b->load[i] *= by;
    b->level = level;
    condense_set_level(b->c, level);
}

void balance_set_damping(struct balance *b, double share)
{
    size_t entries = (size_t)pattern_entries(b->pattern);
    double more = share - b->damping;

    for (int i = 0; i < b->q; i++) {
        double complex *S = b->S + pattern_find(b->pattern, i, i);
        double own = fmax(fabs(creal(S[0])), b->H > 0 ? fabs(creal(S[entries])) : 0);

        for (int k = 1; k <= b->H; k++)
            S[(size_t)k * entries] += CMPLX(0, k * more * own);
    }
    b->damping = share;
    b->factored = false;
    stiffness_set(b->stiffness, b->S);
}

void balance_pack(const struct balance *b, const double complex *X, double *u)
{
    int n = 2 * b->H + 1, K = b->H + 1;

    for (int i = 0; i < b->q; i++) {
        u[i * n] = creal(X[i * K]);                     /* the mean is real */
        for (int k = 1; k < K; k++) {
            u[i * n + 2 * k - 1] = creal(X[i * K + k]);  /* aft.h: Re, then Im */
            u[i * n + 2 * k] = cimag(X[i * K + k]);
        }
    }
}

void balance_unpack(const struct balance *b, const double *u, double complex *X)
{
    int n = 2 * b->H + 1, K = b->H + 1;

    for (int i = 0; i < b->q; i++) {
        X[i * K] = u[i * n];
        for (int k = 1; k < K; k++)
            X[i * K + k] = CMPLX(u[i * n + 2 * k - 1], u[i * n + 2 * k]);  /* and back */
    }
}

/* What x becomes as x (K), i s x (C) or -s^2 x (M), s = l omega. */
static double complex rate_factor(const struct balance *b, int t, int l)
{
    double s = l * b->omega;

    return t == PROGRAM_M ? -s * s : t == PROGRAM_C ? I * s : 1;
}

/* One entry G (two-sided) of a periodic matrix at KAPPA, rows i, columns j (kept), on y of type
 * t. */
static void periodic_force(struct balance *b, double complex G, int kappa, int t, int i, int j,
                           const double complex *X)
{
    int H = b->H, K = H + 1;
    double complex *F = b->F + i * K;
    const double complex *x = X + j * K;

    if (kappa <= H && t == PROGRAM_K)
        F[kappa] += 2 * G * creal(x[0]);                /* one-sided: twice G */
    for (int l = 1; l <= H; l++) {
        double complex y = rate_factor(b, t, l) * x[l];

        if (l + kappa <= H)
            F[l + kappa] += G * y;                      /* k = l + kappa */
        if (l > kappa)
            F[l - kappa] += conj(G) * y;                /* k = l - kappa: G_-kappa = conj G */
        else if (l < kappa && kappa - l <= H)
            F[kappa - l] += G * conj(y);                /* k = kappa - l: y_-l = conj y */
        else if (l == kappa)
            F[0] += creal(conj(G) * y);                 /* (2) of aft_events.c has half of both */
    }
}

/* Column C of block (i, j), in the one matrix or in blocks; entry r at [r]. */
static inline double *column_at(struct balance *b, int i, int j, int c)
{
    int n = 2 * b->HJ + 1;

    if (!b->pattern->full)
        return blocks_column(b->blocks, i, j, c);
    return b->J + (size_t)(j * n + c) * (size_t)b->small + i * n;
}

double *balance_column(struct balance *b, int i, int j, int c) { return column_at(b, i, j, c); }

/* The same as the target that aft.h asks for. */
static double *column_of(void *context, int i, int j, int c)
{
    return column_at(context, i, j, c);
}

/* Harmonic k of dof i changes by T dX_l + Hc conj(dX_l) with X_l of dof j: a real 2 x 2 block. */
static void add_complex(struct balance *b, int i, int k, int j, int l, double complex T,
                        double complex Hc)
{
    double *re = column_at(b, i, j, l > 0 ? 2 * l - 1 : 0);
    double *im = l > 0 ? column_at(b, i, j, 2 * l) : NULL;
    double Tr = creal(T), Ti = cimag(T), Hr = creal(Hc), Hi = cimag(Hc);

    if (k == 0) {
        re[0] += Tr + Hr;
        if (l > 0)
            im[0] += Hi - Ti;
        return;
    }
    re[2 * k - 1] += Tr + Hr;                           /* (3) */
    re[2 * k] += Ti + Hi;
    if (l == 0)
        return;
    im[2 * k - 1] += Hi - Ti;
    im[2 * k] += Tr - Hr;
}

/* The same entry into the derivative: of F by X_l and by its conjugate. */
static void periodic_derivative(struct balance *b, double complex G, int kappa, int t, int i, int j)
{
    int H = b->HJ;

    if (kappa <= H && t == PROGRAM_K)
        add_complex(b, i, kappa, j, 0, 2 * G, 0);
    for (int l = 1; l <= H; l++) {
        double complex y = rate_factor(b, t, l);

        if (l + kappa <= H)
            add_complex(b, i, l + kappa, j, l, G * y, 0);
        if (l > kappa)
            add_complex(b, i, l - kappa, j, l, conj(G) * y, 0);
        else if (l < kappa && kappa - l <= H)
            add_complex(b, i, kappa - l, j, l, 0, G * conj(y));
        else if (l == kappa)
            add_complex(b, i, 0, j, l, conj(G) * y, 0);
    }
}

/* X NULL: the derivative */
/* Every entry of the periodic matrices: their force on X, or where X is NULL their derivative. */
static void each_periodic(struct balance *b, const double complex *X)
{
    const int *place = condense_place(b->c);

    for (int h = 0; h < b->p->harmonics; h++)
        for (int t = 0; t < 6; t++) {
            const struct program_harmonic *harmonic = &b->p->harmonic[h];
            /* three of cos, three of sin */
            const struct sparse *a = t < 3 ? &harmonic->cosine[t] : &harmonic->sine[t - 3];

            for (int i = 0; a->start != NULL && i < a->m; i++)
                for (int e = a->start[i]; e < a->start[i + 1]; e++) {
                    /* G of the opening comment */
                    double complex G = (t < 3 ? 1 : -I) * (a->value[e] / 2);

                    if (X != NULL)
                        periodic_force(b, G, harmonic->k, t % 3, place[i], place[a->index[e]], X);
                    else
                        periodic_derivative(b, G, harmonic->k, t % 3, place[i], place[a->index[e]]);
                }
        }
}

/* y += S_k X_k; of one dof or few a call would cost as much as the sum. */
static inline void add_stiffness(const struct balance *b, int k, const double complex *X,
                                 double complex *y)
{
    int q = b->q, K = b->H + 1;
    const double complex *S = b->S + (size_t)k * (size_t)q * (size_t)q;

    if (!b->pattern->full) {
        stiffness_multiply_add(b->pattern, b->S, k, X + k, K, y);
        return;
    }
    for (int j = 0; j < q; j++)
        for (int i = 0; i < q; i++)
            y[i] += S[j * q + i] * X[j * K + k];
}

/* (1) of balance.h, F and T being in b->F: its real entries into b->R. */
static void linear_residual(struct balance *b, const double complex *X)
{
    int q = b->q, K = b->H + 1, n = 2 * b->H + 1;

    for (int k = 0; k < K; k++) {
        for (int i = 0; i < q; i++)
            b->sum[i] = b->F[i * K + k] - b->load[k * q + i];  /* F + T - p */
        add_stiffness(b, k, X, b->sum);                 /* + S X */
        for (int i = 0; i < q; i++) {
            b->R[i * n + (k > 0 ? 2 * k - 1 : 0)] = creal(b->sum[i]);
            if (k > 0)
                b->R[i * n + 2 * k] = cimag(b->sum[i]);
        }
    }
}

/* What laws see, each of which is a motion to be followed. */
static double inputs_of(const struct program *p)
{
    double inputs = 0;

    for (int l = 0; l < p->laws; l++)
        inputs += p->law[l].kind->inputs;
    return inputs;
}

enum modal_status balance_residual(struct balance *b, const double complex *X, bool derivative,
                                   struct modal_error *err)
{
    double summed = aft_summed(b->aft);
    enum modal_status rc = aft_force(b->aft, b->omega, X, b->F, err);

    budget_add(b->budget, inputs_of(b->p) * aft_samples(b->aft) * BUDGET_SAMPLE
               + BUDGET_PRODUCT * (aft_summed(b->aft) - summed)
               + (double)aft_events(b->aft) * BUDGET_EVENT * b->H
               + 8.0 * pattern_entries(b->pattern) * (b->H + 1));
    if (rc != MODAL_OK)
        return rc;
    each_periodic(b, X);                                /* T onto F */
    linear_residual(b, X);
    return derivative ? balance_derivative(b, err) : MODAL_OK;
}

/* Room for the derivative of harmonics 0 .. HJ, all 0. */
static enum modal_status clear_derivative(struct balance *b, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (b->pattern->full && b->order > ORDER_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "steady.harmonics",
                                "%d nonlinear dofs at %d harmonics are %d unknowns; the most "
                                "is %d", b->q, b->H, b->order, ORDER_MOST);
    if (b->pattern->full && b->J == NULL)
        b->J = malloc(((size_t)b->order * (size_t)b->order + 1) * sizeof *b->J);
    if (b->pattern->full && b->J == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "balance: no memory for a derivative of order %d",
                          b->order);
    if (b->pattern->full) {
        memset(b->J, 0, (size_t)b->small * (size_t)b->small * sizeof *b->J);
        return MODAL_OK;
    }
    if (b->blocks != NULL && blocks_harmonics(b->blocks) != b->HJ) {
        blocks_free(b->blocks);
        by_harmonic_free(b->apart);
        b->blocks = NULL;
        b->apart = NULL;
        b->direct = false;
    }
    if (b->blocks == NULL)
        rc = blocks_new(b->pattern, b->HJ, false, &b->blocks, err);
    if (rc == MODAL_OK)
        blocks_clear(b->blocks);
    return rc;
}

/* S_k onto the diagonal of harmonics, and the periodic matrices' exact derivative. */
static void add_matrices(struct balance *b)
{
    const struct pattern *p = b->pattern;

    each_periodic(b, NULL);                             /* dT/dX */
    for (int k = 0; k <= b->HJ; k++) {
        const double complex *S = b->S + (size_t)k * (size_t)pattern_entries(p);

        for (int j = 0; j < b->q; j++)
            for (int e = p->start[j]; e < p->start[j + 1]; e++)
                add_complex(b, p->index[e], k, j, k, S[e], 0);
    }
}

bool balance_on_inputs(const struct balance *b)
{
    return !b->whole && b->damping == 0 && joint_serves(b->joint);
}

/* The derivative on what laws read alone. */
static enum modal_status derivative_on_inputs(struct balance *b, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (b->inputs != NULL && by_inputs_harmonics(b->inputs) != b->HJ) {
        by_inputs_free(b->inputs);
        b->inputs = NULL;
    }
    if (b->inputs == NULL)
        rc = by_inputs_new(b->joint, b->HJ, true, &b->inputs, err);
    return rc == MODAL_OK ? by_inputs_set(b->inputs, b->aft, err) : rc;
}

enum modal_status balance_derivative(struct balance *b, struct modal_error *err)
{
    const struct aft_target into = { column_of, b };
    enum modal_status rc;

    b->factored = false;
    budget_add(b->budget, (double)b->p->laws * 16 * (b->HJ + 1) * (b->HJ + 1));
    if ((b->on_inputs = balance_on_inputs(b)))
        return derivative_on_inputs(b, err);
    rc = clear_derivative(b, err);
    if (rc == MODAL_OK)
        rc = aft_add_derivative(b->aft, &into, err);
    if (rc == MODAL_OK)
        add_matrices(b);
    return rc;
}

/* Blocks of the derivative that is kept on the inputs; false for want of memory. */
static bool write_blocks(struct balance *b)
{
    const struct aft_target into = { column_of, b };

    if (!b->on_inputs)
        return true;
    if (clear_derivative(b, NULL) != MODAL_OK)
        return false;
    by_inputs_add(b->inputs, &into);
    add_matrices(b);
    b->on_inputs = false;
    return true;
}

/* As dgetrf; of such orders the library spends more on being called than on its sums. */
static void factor_small(int n, double *A, int *pivot)
{
    for (int j = 0; j < n; j++) {
        double *column = A + j * n, inverse;
        int p = j;

        for (int i = j + 1; i < n; i++)
            p = fabs(column[i]) > fabs(column[p]) ? i : p;
        pivot[j] = p + 1;
        for (int c = 0; p != j && c < n; c++) {
            double t = A[c * n + j];

            A[c * n + j] = A[c * n + p];
            A[c * n + p] = t;
        }
        inverse = column[j] != 0 ? 1 / column[j] : 0;
        for (int i = j + 1; i < n; i++)
            column[i] *= inverse;
        for (int c = j + 1; c < n; c++)
            for (int i = j + 1; i < n; i++)
                A[c * n + i] -= column[i] * A[c * n + j];
    }
}

/* As dgetrs, of factor_small's. */
static void solve_small(int n, const double *A, const int *pivot, double *y)
{
    for (int i = 0; i < n; i++) {
        double t = y[pivot[i] - 1];

        y[pivot[i] - 1] = y[i];
        y[i] = t;
    }
    for (int j = 0; j < n; j++)
        for (int i = j + 1; i < n; i++)
            y[i] -= A[j * n + i] * y[j];
    for (int j = n - 1; j >= 0; j--) {
        y[j] /= A[j * n + j];
        for (int i = 0; i < j; i++)
            y[i] -= A[j * n + i] * y[j];
    }
}

/* Rows of J divided by their largest entry, 1 / which goes into b->row; false where one is not
 * finite. */
static bool scale_rows(struct balance *b)
{
    int n = b->small;

    memset(b->row, 0, (size_t)n * sizeof *b->row);
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++) {
            double size = fabs(b->J[(size_t)j * (size_t)n + (size_t)i]);

            b->row[i] = size > b->row[i] || isnan(size) ? size : b->row[i];
        }
    for (int i = 0; i < n; i++) {
        if (!isfinite(b->row[i]))
            return false;
        b->row[i] = b->row[i] > 0 ? 1 / b->row[i] : 1;
    }
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++)
            b->J[(size_t)j * (size_t)n + (size_t)i] *= b->row[i];
    return true;
}

bool balance_open(const struct balance *b) { return b->rcond < OPEN; }
double balance_dense_work(int n) { return (2.0 / 3 * n / BUDGET_DENSE + 4) * n * n; }

/* The blocks factored whole. */
static bool factor_blocks(struct balance *b, int *sign)
{
    double before = blocks_work(b->blocks);

    b->iterates = false;
    b->factored = blocks_factor(b->blocks, sign);
    b->rcond = b->factored ? blocks_rcond(b->blocks) : 0;
    budget_add(b->budget, (blocks_work(b->blocks) - before) / BUDGET_DENSE);
    return b->factored;
}

/* Harmonic by harmonic, where solutions are cheaper so: *DONE. */
static bool factor_apart(struct balance *b)
{
    double before;

    if (b->direct || (b->apart == NULL
                      && (b->apart = by_harmonic_new(b->pattern, b->HJ)) == NULL))
        return false;
    before = by_harmonic_work(b->apart);
    b->iterates = by_harmonic_factor(b->apart, b->blocks);
    before = by_harmonic_work(b->apart) - before;
    budget_add(b->budget, before);
    b->direct = b->iterates && before > 0               /* else it was asked before */
             && before + SOLUTIONS * by_harmonic_solution(b->apart, b->blocks)
                > by_harmonic_of_blocks(b->apart);
    b->iterates = b->iterates && !b->direct;
    b->factored = b->iterates;
    b->rcond = by_harmonic_rcond(b->apart);
    return b->iterates;
}

/* y <- J^-1 y where the derivative is kept on the inputs; false where that does not come there, and
 * y is as it was, the derivative in factors by themselves. */
static bool solve_on_inputs(struct balance *b, double *y)
{
    double before;
    bool ok;

    if (!b->on_inputs)
        return false;
    before = by_inputs_work(b->inputs);
    memcpy(b->kept, y, (size_t)b->small * sizeof *y);
    ok = by_inputs_solve(b->inputs, b->S, b->omega, fmax(b->forcing, FORCING_ON_INPUTS), y);
    budget_add(b->budget, by_inputs_work(b->inputs) - before);
    if (ok)
        return true;
    memcpy(y, b->kept, (size_t)b->small * sizeof *y);
    b->factored = write_blocks(b) && (factor_apart(b) || factor_blocks(b, NULL));
    return false;
}

/* y <- J^-1 y, b->small entries.  Where GMRES does not come there, the blocks are factored whole if
 * the budget pays for it. */
static void solve_blocks(struct balance *b, double *y)
{
    double before;
    bool ok;

    if (solve_on_inputs(b, y) || !b->factored)
        return;
    if (!b->iterates) {
        blocks_solve(b->blocks, y);
        return;
    }
    before = by_harmonic_work(b->apart);
    memcpy(b->kept, y, (size_t)b->small * sizeof *y);
    ok = by_harmonic_solve(b->apart, b->blocks, b->forcing, y);
    budget_add(b->budget, by_harmonic_work(b->apart) - before);
    if (ok || !budget_pays(b->budget, by_harmonic_of_blocks(b->apart)) || !factor_blocks(b, NULL))
        return;
    memcpy(y, b->kept, (size_t)b->small * sizeof *y);
    blocks_solve(b->blocks, y);
}

bool balance_factor(struct balance *b, int *sign)
{
    int n = b->small, s = 1;
    double most = 0, least = HUGE_VAL;

    if (b->on_inputs && sign == NULL) {                 /* nothing to factor */
        b->rcond = 1;
        return b->factored = true;
    }
    if (!write_blocks(b))
        return false;
    if (!b->pattern->full)
        return (sign == NULL && factor_apart(b)) || factor_blocks(b, sign);
    b->factored = false;
    b->rcond = NAN;                                     /* no factors yet */
    budget_add(b->budget, balance_dense_work(n));
    if (!scale_rows(b))
        return false;
    if (n <= SMALL_ORDER)
        factor_small(n, b->J, b->pivot);
    else
        LAPACKE_dgetrf_work(LAPACK_COL_MAJOR, n, n, b->J, n, b->pivot);
    for (int i = 0; i < n; i++) {
        double u = b->J[(size_t)i * (size_t)n + (size_t)i];

        most = fmax(most, fabs(u));
        least = fmin(least, fabs(u));
        /* the sign of the product of pivots, and of their exchanges */
        s *= (u < 0 ? -1 : 1) * (b->pivot[i] != i + 1 ? -1 : 1);
    }
    if (sign != NULL)
        *sign = s;
    b->rcond = most > 0 ? least / most : 0;
    /* to rounding of rounding: a pivot that is not 0 */
    b->factored = least > 4 * DBL_EPSILON * DBL_EPSILON * most;
    return b->factored;
}

bool balance_factor_stiffened(struct balance *b, double mu)
{
    b->iterates = false;
    return b->factored = write_blocks(b) && blocks_factor_stiffened(b->blocks, mu);
}

void balance_set_order(struct balance *b, int HJ)
{
    b->HJ = HJ;
    b->small = b->q * (2 * HJ + 1);
    b->factored = false;
    aft_set_order(b->aft, HJ);
}

/* Harmonics past HJ of y, by (2). */
static void solve_tail(struct balance *b, double *y)
{
    int n = 2 * b->H + 1;

    for (int k = b->HJ + 1; k <= b->H; k++) {
        double *at = y + 2 * k - 1;

        for (int i = 0; i < b->q; i++)
            b->sum[i] = CMPLX(at[i * n], at[i * n + 1]);  /* R_k of all dofs */
        if (b->q == 1)
            b->sum[0] /= b->S[k];                       /* one dof: S_k is a number */
        else
            stiffness_solve(b->stiffness, k, b->sum);
        for (int i = 0; i < b->q; i++) {
            at[i * n] = creal(b->sum[i]);
            at[i * n + 1] = cimag(b->sum[i]);
        }
    }
}

/* The rows of y that the derivative has into b->gather, scaled as those of J are, and back. */
static void gather(struct balance *b, const double *y)
{
    int n = 2 * b->H + 1, m = 2 * b->HJ + 1;

    for (int i = 0; i < b->q; i++)
        for (int r = 0; r < m; r++)
            b->gather[i * m + r] = b->pattern->full ? y[i * n + r] * b->row[i * m + r]
                : y[i * n + r];
}

/* b->gather back into the rows of y that the derivative has. */
static void scatter(const struct balance *b, double *y)
{
    int n = 2 * b->H + 1, m = 2 * b->HJ + 1;

    for (int i = 0; m < n && i < b->q; i++)
        memcpy(y + i * n, b->gather + i * m, (size_t)m * sizeof *y);
    if (m == n)
        memcpy(y, b->gather, (size_t)b->order * sizeof *y);
}

void balance_solve(struct balance *b, double *y)
{
    gather(b, y);
    if (!b->pattern->full)
        solve_blocks(b, b->gather);
    else if (b->small <= SMALL_ORDER)
        solve_small(b->small, b->J, b->pivot, b->gather);
    else
        LAPACKE_dgetrs_work(LAPACK_COL_MAJOR, 'N', b->small, 1, b->J, b->small, b->pivot,
                            b->gather, b->small);
    scatter(b, y);                                      /* rows past HJ of y are still R_k */
    if (b->HJ < b->H)
        solve_tail(b, y);
}

bool balance_solve_springs(struct balance *b, double *y)
{
    struct by_inputs *s = NULL;
    double before;
    bool ok;

    if (!balance_on_inputs(b) || by_inputs_new(b->joint, b->H, false, &s, NULL) != MODAL_OK)
        return false;
    before = by_inputs_work(s);
    ok = by_inputs_solve(s, b->S, b->omega, FORCING_ON_INPUTS, y);
    budget_add(b->budget, by_inputs_work(s) - before);
    by_inputs_free(s);
    return ok;
}

/* Of numbers, NaN apart: cheaper than fmax. */
static double larger(double a, double b) { return a > b ? a : b; }

/* The largest part of any of K complex numbers. */
static double scale_of(const double complex *X, int K)
{
    double most = 0;

    for (int k = 0; k < K; k++)
        most = larger(most, larger(fabs(creal(X[k])), fabs(cimag(X[k]))));
    return most;
}

double balance_lost(const struct balance *b, const double complex *X)
{
    size_t size = (size_t)b->q * ((size_t)b->H + 1);
    double forces = larger(scale_of(b->load, (int)size), scale_of(b->F, (int)size));

    /* rounding of X times the slope */
    return DBL_EPSILON * aft_slope(b->aft) * scale_of(X, (int)size) / (forces > 0 ? forces : 1);
}

double balance_relative(const struct balance *b, double faint, const double *step,
                        const double complex *X)
{
    int n = 2 * b->H + 1, K = b->H + 1;
    double overall = scale_of(X, b->q * K), worst = 0;

    for (int i = 0; i < b->q; i++) {
        double scale = fmax(scale_of(X + i * K, K), fmax(faint, FAINT) * overall), most = 0;

        for (int r = 0; r < n; r++) {
            double size = fabs(step[i * n + r]);

            most = size > most || isnan(size) ? size : most;
        }
        if (most > 0)
            worst = fmax(worst, scale > 0 ? most / scale : HUGE_VAL);
        if (isnan(most))
            return NAN;
    }
    return worst;
}

double balance_relative_residual(struct balance *b, const double complex *X)
{
    int K = b->H + 1, q = b->q;
    double scale = 0, most = 0;

    for (int i = 0; i < b->order; i++)
        most = fmax(most, fabs(b->R[i]));
    scale = larger(scale_of(b->load, q * K), scale_of(b->F, q * K));
    for (int k = 0; k < K; k++) {
        for (int i = 0; i < q; i++)
            b->sum[i] = 0;
        add_stiffness(b, k, X, b->sum);
        /* S_k X_k may be far larger than p where it resonates */
        scale = larger(scale, scale_of(b->sum, q));
    }
    return scale > 0 ? most / scale : most;
}
