/*
 * backbone.c - see backbone.h
 *
 * Unknowns are the harmonics u of all dofs, omega and zeta; with balance.h (1) for R, (1) of
 * backbone.h is
 *
 *     R(u; omega, zeta) = 0,   X_1^H M X_1 / a^2 = 1,   Im X_1 = 0 at the mode's largest dof,   (2)
 *
 * order + 2 real equations by Newton's method: dR/du exact, dR/domega by central differences (laws
 * may read rates), dR/dzeta = -2 i k omega^2 M X_k exact.  An amplitude not reached in one go is
 * approached in halves.
 *
 * Newton's matrix is J bordered by two columns and two rows,
 *
 *     [ J           dR/domega   dR/dzeta ] [ du     ]     [ R                   ]
 *     [ 2 (M X_1)^T 0           0        ] [ domega ] = - [ X_1^H M X_1 - a^2   ],              (3)
 *     [ e_lead^T    0           0        ] [ dzeta  ]     [ Im X_1 at `lead`    ]
 *
 * regular though J is singular along the motion's own phase.
 *
 * At an internal resonance a mode of higher frequency answers a harmonic: the curve runs out along
 * its tongue and back, and the amplitude with it.  There it is followed by its length s,
 *
 *     ds^2 = sum_k dX_k^H M dX_k / sum_k X_k^H M X_k + (domega / omega)^2 + dzeta^2,            (4)
 *
 * which units do not enter.  From the last two points (k - 1, k) a third is foretold, and what is
 * found for it lies in the plane through there, across to their secant in the metric of (4),
 *
 *     <y_k - y_(k-1), y - (foretold)> = 0                                                       (5)
 *
 * in place of the second of (2); y is (u, omega, zeta).  Towards a resonance its harmonic grows as
 * one over the distance, and on the tongue's other side it is of the other sign: steps that are
 * half the distance at most double it at most.  Longer ones could pass from one side to the other,
 * and are taken again by half.  Past the tongue's end, where X_1 is 0 and the other mode moves
 * alone, the curve comes back along the other side.
 *
 * [K15] Krack, Computers and Structures 154 (2015) 59-71: the extended periodic motion concept.
 */
#include "modal/steady/backbone.h"
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"
#include "modal/steady/aft.h"
#include "modal/steady/balance.h"
#include "modal/steady/condense.h"
#include "modal/steady/damped_mode.h"

static const double TWO_PI = 6.283185307179586477;   /* a period of theta */
/* A relative step this short ends Newton's method; below CLOSE one that did not shrink to a
 * STALLS-th does too: rounding. */
static const double TOLERANCE = 1e-12;
static const double CLOSE = 1e-8;
static const double STALLS = 4;
/* A step ten times the motion leads to another one. */
static const double ASTRAY = 10;
/* Of omega, its central difference: near the cube root of rounding. */
static const double DIFFERENCE = 1e-6;
/* Of (4): a decade of amplitude in 24 points where the shape stays; at least: harmonics of so small
 * a share grow to the whole within that of a resonance, and such tongues are passed over. */
static const double STEP_MOST = 0.1;
static const double STEP_LEAST = 1e-4;
/* Cosines between two secants: below SHARP a step is taken again by half, as the curve may have
 * been left for another part of it; below FLAT the next is no longer.  32 and 18 degrees. */
static const double SHARP = 0.85;
static const double FLAT = 0.95;
enum {
    ITERATIONS_EASY = 4,     /* of a step that may be longer: quadratic convergence takes as many */
    ITERATIONS_MOST = 30,   /* a rate of 0.4 meets TOLERANCE */
    HALVINGS_MOST = 12,      /* of the way to an amplitude, in its logarithm: steps of 1/4096 */
    SAMPLES_LEAST = 64,   /* where 4 H + 2 are fewer: a law has kinks */
    SAMPLES_SMOOTH = 32,     /* a harmonic, of laws that are neither polynomials nor of pieces */
    /* a harmonic: eight a cycle of the energy's highest, 2 H */
    SAMPLES_ENERGY = 16
};

struct backbone {
    const struct program *p;
    struct condense *c;               /* every dof kept: M, C and K as they are */
    struct balance *b;                /* its S and loads are set here, not by balance_set */
    int n, H, order, lead;            /* lead: the mode's largest dof */
    double *M, *C, *K;                /* n x n */
    double complex *shape;            /* of unit modal mass */
    double omega, zeta;               /* linear */
    double a, at_omega, at_zeta;      /* of the last motion found; a = 0: none */
    double complex *X, *good;
    double *A, *rhs, *side;           /* (order + 2)^2; order + 2; order */
    bool walks;                       /* `before` is a point of the curve */
    double length, size;              /* of the next step; X's part of (4) of the last motion */
    int still;                        /* the unknown that holds the phase, when foretold */
    double *y, *before, *last;        /* (5)'s unknowns now, at the point before, at the last */
    double *foretold, *secant, *plane;
    int *pivot;
    struct workspace space;           /* of the arrays */
};

void backbone_free(struct backbone *b)
{
    if (b == NULL)
        return;
    balance_free(b->b);
    condense_free(b->c);
    workspace_free(&b->space);
    free(b);
}

/* Scenes that have no nonlinear modes of this kind: refused by name. */
static enum modal_status refuse(const struct program *p, struct modal_error *err)
{
    if (p->harmonics > 0 || p->n_linear > 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "backbone",
                                "nonlinear modes are of constant matrices without linear states");
    for (int l = 0; l < p->laws; l++) {
        const struct law_class *kind = p->law[l].kind;

        if (kind->set_valued || kind->reads_time || kind->restart != NULL)
            return modal_fail_field(
                err, MODAL_BAD_INPUT, "backbone",
                "effect %s has no nonlinear modes: accepted are laws of motion alone, not rigid",
                p->effect[p->law[l].effect].type);
    }
    return MODAL_OK;
}

/* K and C with every law's slopes at rest; *RATES: C has some of them. */
static enum modal_status slopes_at_rest(const struct backbone *b, double *K, double *C, bool *rates,
                                        struct modal_error *err)
{
    const double zero[LAW_INPUTS_MOST] = { 0 };
    int n = b->n;
    enum modal_status rc = MODAL_OK;

    *rates = false;
    memcpy(K, b->K, (size_t)n * (size_t)n * sizeof *K);
    memcpy(C, b->C, (size_t)n * (size_t)n * sizeof *C);
    for (int l = 0; rc == MODAL_OK && l < b->p->laws; l++)
        rc = law_spread_slopes(&b->p->law[l], zero, n, K, C, rates, err);
    return rc;
}

/* The linear mode by all of C at rest, where so many swing. */
static enum modal_status mode_of_rates(struct backbone *b, int mode, struct modal_error *err)
{
    size_t square = (size_t)b->n * (size_t)b->n;
    struct workspace room = { 0 };
    double *K = workspace_zeros(&room, square, sizeof *K),
           *C = workspace_zeros(&room, square, sizeof *C);
    struct damped_mode own;
    bool rates;
    enum modal_status rc = room.failed ? modal_fail(err, MODAL_NO_MEMORY, "backbone: no memory")
                                       : slopes_at_rest(b, K, C, &rates, err);

    if (rc == MODAL_OK)
        rc = damped_mode(b->M, K, C, b->n, mode, b->shape, &own, err);
    if (rc == MODAL_OK && mode <= own.swinging) {
        b->omega = own.omega;
        b->zeta = own.damping_ratio;
        for (int i = 0; i < b->n; i++)
            b->lead = cabs(b->shape[i]) > cabs(b->shape[b->lead]) ? i : b->lead;
    }
    workspace_free(&room);
    return rc;
}

/* The linear mode: shape, omega and the damping ratio that C gives it; where laws resist rates at
 * rest, as rounded friction does, that of all of C. */
static enum modal_status linear_mode(struct backbone *b, int mode, struct modal_error *err)
{
    size_t n = (size_t)b->n;
    struct workspace room = { 0 };
    double *K = workspace_zeros(&room, n * n, sizeof *K),
           *M = workspace_zeros(&room, n * n, sizeof *M),
           *C = workspace_zeros(&room, n * n, sizeof *C),
           *w = workspace_zeros(&room, n, sizeof *w), c = 0;
    bool rates;
    enum modal_status rc = room.failed ? modal_fail(err, MODAL_NO_MEMORY, "backbone: no memory")
                                       : slopes_at_rest(b, K, C, &rates, err);

    if (rc == MODAL_OK)
        memcpy(M, b->M, n * n * sizeof *M);
    if (rc == MODAL_OK
        && LAPACKE_dsygv(LAPACK_COL_MAJOR, 1, 'V', 'L', b->n, K, b->n, M, b->n, w) != 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "backbone",
                              "the mass matrix is not positive definite");
    if (rc == MODAL_OK && !(w[mode - 1] > 0))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "backbone",
                              "mode %d has no stiffness at rest: omega^2 = %g", mode, w[mode - 1]);
    for (size_t i = 0; rc == MODAL_OK && i < n; i++) {
        b->shape[i] = K[(size_t)(mode - 1) * n + i];
        b->lead = cabs(b->shape[i]) > cabs(b->shape[b->lead]) ? (int)i : b->lead;
    }
    for (size_t i = 0; rc == MODAL_OK && i < n; i++)
        for (size_t j = 0; j < n; j++)
            /* phi^T C phi = 2 zeta omega, M-normalised */
            c += creal(b->shape[i] * b->C[j * n + i] * b->shape[j]);
    if (rc == MODAL_OK) {
        double sign = creal(b->shape[b->lead]) < 0 ? -1 : 1;

        for (size_t i = 0; i < n; i++)
            b->shape[i] *= sign;
        b->omega = sqrt(w[mode - 1]);                   /* w ascends */
        b->zeta = c / (2 * b->omega);
    }
    workspace_free(&room);
    if (rc == MODAL_OK && rates)
        rc = mode_of_rates(b, mode, err);
    return rc;
}

/* Room for order + 2 unknowns and the dense matrices. */
static enum modal_status allocate(struct backbone *b, struct modal_error *err)
{
    size_t n = (size_t)b->n, order = (size_t)b->order, size = n * ((size_t)b->H + 1);
    struct matrix M = { b->n, b->n, b->n, NULL }, C = M, K = M;

    M.x = b->M = workspace_zeros(&b->space, n * n, sizeof *b->M);
    C.x = b->C = workspace_zeros(&b->space, n * n, sizeof *b->C);
    K.x = b->K = workspace_zeros(&b->space, n * n, sizeof *b->K);
    b->shape = workspace_zeros(&b->space, n, sizeof *b->shape);
    b->X = workspace_zeros(&b->space, size, sizeof *b->X);
    b->good = workspace_zeros(&b->space, size, sizeof *b->good);
    b->A = workspace_zeros(&b->space, (order + 2) * (order + 2), sizeof *b->A);
    b->rhs = workspace_zeros(&b->space, order + 2, sizeof *b->rhs);
    b->side = workspace_zeros(&b->space, order + 2, sizeof *b->side);
    b->y = workspace_zeros(&b->space, order + 2, sizeof *b->y);
    b->before = workspace_zeros(&b->space, order + 2, sizeof *b->before);
    b->last = workspace_zeros(&b->space, order + 2, sizeof *b->last);
    b->foretold = workspace_zeros(&b->space, order + 2, sizeof *b->foretold);
    b->secant = workspace_zeros(&b->space, order + 2, sizeof *b->secant);
    b->plane = workspace_zeros(&b->space, order + 2, sizeof *b->plane);
    b->pivot = workspace_zeros(&b->space, order + 2, sizeof *b->pivot);
    if (b->space.failed)
        return modal_fail(err, MODAL_NO_MEMORY, "backbone: no memory for %d unknowns", b->order);
    sparse_add_to_dense(&b->p->constant[PROGRAM_M], 1, &M);
    sparse_add_to_dense(&b->p->constant[PROGRAM_C], 1, &C);
    sparse_add_to_dense(&b->p->constant[PROGRAM_K], 1, &K);
    return MODAL_OK;
}

/* A power of two of samples: 4 H of pieces, whose forces are exact, (p + 1) H of polynomials. */
static int samples(const struct program *p, int H)
{
    int least = 4 * H + 2, N = SAMPLES_LEAST;

    for (int l = 0; l < p->laws; l++) {
        int need = p->law[l].degree > 0             ? (p->law[l].degree + 1) * H + 1
                   : p->law[l].kind->pieces != NULL ? 0
                                                    : SAMPLES_SMOOTH * H;

        least = need > least ? need : least;
    }
    while (N < least)
        N *= 2;
    return N;
}

enum modal_status backbone_new(const struct program *p, int mode, int H, int N,
                               struct backbone **out, struct modal_error *err)
{
    struct backbone *b;
    enum modal_status rc = refuse(p, err);

    if (rc != MODAL_OK)
        return rc;
    if (mode < 1 || mode > p->n)
        return modal_fail_field(err, MODAL_BAD_INPUT, "backbone", "mode %d; accepted: 1 to %d",
                                mode, p->n);
    if ((double)p->n * (2.0 * H + 1) > BACKBONE_UNKNOWNS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "backbone",
                                "%d dofs at %d harmonics; at most %d unknowns", p->n, H,
                                BACKBONE_UNKNOWNS_MOST);
    b = calloc(1, sizeof *b);
    if (b == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "backbone: no memory");
    *b = (struct backbone) { .p = p, .n = p->n, .H = H, .order = p->n * (2 * H + 1) };
    rc = allocate(b, err);
    if (rc == MODAL_OK)
        rc = linear_mode(b, mode, err);
    if (rc == MODAL_OK)
        rc = condense_new(p, CONDENSE_NONE, &b->c, err);
    if (rc == MODAL_OK)
        rc = balance_new(p, b->c, H, N > 0 ? N : samples(p, H), true, &b->b, err);
    if (rc == MODAL_OK)
        *out = b;
    else
        backbone_free(b);
    return rc;
}

double backbone_linear(const struct backbone *b, double *damping_ratio)
{
    *damping_ratio = b->zeta;
    return b->omega;
}

long backbone_evaluations(const struct backbone *b, int law)
{
    return aft_evaluations(b->b->aft, law);
}

bool backbone_acts(const struct backbone *b, int law)
{
    return aft_acts(b->b->aft, law);
}

/* The balance's S of (1): K - s^2 M + i s (C - 2 zeta omega M), s = k omega; no loads. */
static void set(struct backbone *b, double omega, double zeta)
{
    int n = b->n;

    b->b->omega = omega;            /* the balance is driven by hand: it has no loads to condense */
    memset(b->b->load, 0, (size_t)n * ((size_t)b->H + 1) * sizeof *b->b->load);
    for (int k = 0; k <= b->H; k++)
        for (int e = 0; e < n * n; e++) {
            double s = k * omega;

            b->b->S[k * n * n + e] =
                CMPLX(b->K[e] - s * s * b->M[e], s * (b->C[e] - 2 * zeta * omega * b->M[e]));
        }
}

/* dR/domega into b->side. */
static enum modal_status over_omega(struct backbone *b, double omega, double zeta,
                                    struct modal_error *err)
{
    double h = DIFFERENCE * omega;
    enum modal_status rc;

    set(b, omega + h, zeta);
    rc = balance_residual(b->b, b->X, false, err);
    memcpy(b->side, b->b->R, (size_t)b->order * sizeof *b->side);
    set(b, omega - h, zeta);
    if (rc == MODAL_OK)
        rc = balance_residual(b->b, b->X, false, err);
    for (int i = 0; i < b->order; i++)
        b->side[i] = (b->side[i] - b->b->R[i]) / (2 * h);  /* off by h^2 */
    set(b, omega, zeta);                                /* back: the derivative is taken there */
    return rc;
}

/* X_1^H M X_1, and 2 M X_1 by real unknowns into ROW (stride LD) if not NULL. */
static double modal_square(const struct backbone *b, double *row, int ld)
{
    int n = b->n, K = b->H + 1, m = 2 * b->H + 1;
    double sum = 0;

    for (int i = 0; i < n; i++) {
        double complex MX = 0;

        for (int j = 0; j < n; j++)
            MX += b->M[j * n + i] * b->X[j * K + 1];
        sum += creal(conj(b->X[i * K + 1]) * MX);       /* X_1^H M X_1 is real */
        if (row != NULL) {
            row[(size_t)(i * m + 1) * (size_t)ld] = 2 * creal(MX);  /* d/d Re X_1 */
            row[(size_t)(i * m + 2) * (size_t)ld] = 2 * cimag(MX);  /* d/d Im X_1 */
        }
    }
    return sum;
}

/* dR/dzeta = -2 i k omega^2 M X_k into COLUMN. */
static void over_zeta(const struct backbone *b, double omega, double *column)
{
    int n = b->n, K = b->H + 1, m = 2 * b->H + 1;

    for (int i = 0; i < n; i++)
        for (int k = 1; k <= b->H; k++) {
            double complex MX = 0;

            for (int j = 0; j < n; j++)
                MX += b->M[j * n + i] * b->X[j * K + k];
            MX *= -2 * I * k * omega * omega;           /* of S in set() */
            column[i * m + 2 * k - 1] = creal(MX);
            column[i * m + 2 * k] = cimag(MX);
        }
}

/* Rows to a largest entry of 1: harmonics differ by k^2, and a^2 by much. */
static void scale_rows(double *A, double *rhs, int n)
{
    for (int i = 0; i < n; i++) {
        double most = DBL_MIN;

        for (int j = 0; j < n; j++)
            most = fmax(most, fabs(A[(size_t)j * (size_t)n + (size_t)i]));
        for (int j = 0; j < n; j++)
            A[(size_t)j * (size_t)n + (size_t)i] /= most;
        rhs[i] /= most;
    }
}

/* X, OMEGA and ZETA as the unknowns Y, and back. */
static void pack(const struct backbone *b, const double complex *X, double omega, double zeta,
                 double *y)
{
    int m = 2 * b->H + 1, K = b->H + 1;

    for (int i = 0; i < b->n; i++)
        for (int k = 0; k < K; k++) {
            y[i * m + (k == 0 ? 0 : 2 * k - 1)] = creal(X[i * K + k]);
            if (k > 0)
                y[i * m + 2 * k] = cimag(X[i * K + k]);
        }
    y[b->order] = omega;
    y[b->order + 1] = zeta;
}

static void unpack(const struct backbone *b, const double *y, double complex *X)
{
    int m = 2 * b->H + 1, K = b->H + 1;

    for (int i = 0; i < b->n; i++)
        for (int k = 0; k < K; k++)
            X[i * K + k] = k == 0 ? y[i * m] : CMPLX(y[i * m + 2 * k - 1], y[i * m + 2 * k]);
}

/* The squared length (4) of the change D beside SIZE, X's part of (4), and omega; and what times D
 * is that into ROW. */
static double metric(const struct backbone *b, const double *d, double size, double *row)
{
    int n = b->n, m = 2 * b->H + 1;
    double sum = 0;

    for (int i = 0; i < n; i++)
        for (int c = 0; c < m; c++) {
            double Md = 0;

            for (int j = 0; j < n; j++)
                Md += b->M[j * n + i] * d[j * m + c];
            row[i * m + c] = Md / size;
            sum += d[i * m + c] * row[i * m + c];
        }
    row[b->order] = d[b->order] / (b->at_omega * b->at_omega);
    row[b->order + 1] = d[b->order + 1];
    return sum + d[b->order] * row[b->order] + d[b->order + 1] * row[b->order + 1];
}

static double dot(const double *x, const double *y, int n)
{
    double sum = 0;

    for (int i = 0; i < n; i++)
        sum += x[i] * y[i];
    return sum;
}

/* One Newton step of (2) at amplitude A, or with (5) where A is 0; its relative size into *SIZE,
 * NAN where the derivative is singular. */
static enum modal_status step(struct backbone *b, double a, double *omega, double *zeta,
                              double *size, struct modal_error *err)
{
    int order = b->order, all = order + 2, m = 2 * b->H + 1, K = b->H + 1;
    double scale = 0, most = 0;
    enum modal_status rc = over_omega(b, *omega, *zeta, err);

    if (rc == MODAL_OK)
        rc = balance_residual(b->b, b->X, true, err);
    if (rc != MODAL_OK)
        return rc;
    /* The matrix of (2): rows R, amplitude, phase; columns u, omega, zeta. */
    memset(b->A, 0, (size_t)all * (size_t)all * sizeof *b->A);
    matrix_copy(order, order, b->b->J, order, b->A, all);
    /* last but one */
    memcpy(b->A + (size_t)order * (size_t)all, b->side, (size_t)order * sizeof *b->A);
    over_zeta(b, *omega, b->A + (size_t)(order + 1) * (size_t)all);  /* last column */
    for (int i = 0; i < order; i++)
        b->rhs[i] = -b->b->R[i];
    if (a > 0)
        /* the second of (2), times a^2 */
        b->rhs[order] = a * a - modal_square(b, b->A + order, all);
    else {
        pack(b, b->X, *omega, *zeta, b->y);
        for (int j = 0; j < all; j++)
            b->A[(size_t)j * (size_t)all + (size_t)order] = b->plane[j];
        b->rhs[order] = dot(b->plane, b->foretold, all) - dot(b->plane, b->y, all);  /* (5) */
    }
    if (a > 0) {
        /* the third of (2): of Im X_1 alone */
        b->A[(size_t)(b->lead * m + 2) * (size_t)all + (size_t)order + 1] = 1;
        b->rhs[order + 1] = -cimag(b->X[b->lead * K + 1]);
    } else {
        /* the angle of what moves most, as at the last point: X_1 may vanish */
        double re = b->last[b->still], im = b->last[b->still + 1];

        b->A[(size_t)b->still * (size_t)all + (size_t)order + 1] = -im;
        b->A[(size_t)(b->still + 1) * (size_t)all + (size_t)order + 1] = re;
        b->rhs[order + 1] = im * b->y[b->still] - re * b->y[b->still + 1];
    }
    scale_rows(b->A, b->rhs, all);
    *size = NAN;
    /* Singular: no step, and *SIZE says so. */
    if (LAPACKE_dgesv_work(LAPACK_COL_MAJOR, all, 1, b->A, all, b->pivot, b->rhs, all) != 0)
        return MODAL_OK;
    for (int i = 0; i < b->n; i++)
        for (int k = 0; k < K; k++) {
            double complex d =
                k == 0 ? b->rhs[i * m] : CMPLX(b->rhs[i * m + 2 * k - 1], b->rhs[i * m + 2 * k]);

            b->X[i * K + k] += d;
            most = fmax(most, cabs(d));
            scale = fmax(scale, cabs(b->X[i * K + k]));
        }
    *omega += b->rhs[order];
    *zeta += b->rhs[order + 1];
    *size = fmax(most / scale, fmax(fabs(b->rhs[order]) / fabs(*omega), fabs(b->rhs[order + 1])));
    return MODAL_OK;
}

/* (2), or (5) where A is 0, from where `out` and b->X stand, until it settles or runs away. */
static enum modal_status newton(struct backbone *b, double a, struct backbone_point *out,
                                struct modal_error *err)
{
    double last = HUGE_VAL;
    enum modal_status rc = MODAL_OK;

    /* omega and zeta of `out` are unknowns, too. */
    for (int i = 0; rc == MODAL_OK && i < ITERATIONS_MOST && !out->converged; i++) {
        rc = step(b, a, &out->omega, &out->damping_ratio, &out->step, err);
        out->iterations++;
        if (rc == MODAL_OVERFLOW || !(out->step < ASTRAY) || !(out->omega > 0))
            return MODAL_OK;
        out->converged = out->step <= TOLERANCE || (out->step < CLOSE && out->step > last / STALLS);
        last = out->step;
    }
    set(b, out->omega, out->damping_ratio);
    if (rc == MODAL_OK)
        rc = balance_residual(b->b, b->X, false, err);
    out->residual = rc == MODAL_OK ? balance_relative_residual(b->b, b->X) : NAN;
    return rc;
}

/* The largest kinetic energy, on a grid that resolves its 2H harmonics. */
static double kinetic_peak(const struct backbone *b, double omega)
{
    int N = SAMPLES_ENERGY * (b->H + 1), n = b->n, K = b->H + 1;
    double most = 0, *v = b->side;

    for (int j = 0; j < N; j++) {
        double sum = 0;

        for (int i = 0; i < n; i++) {
            v[i] = 0;
            for (int k = 1; k < K; k++)
                v[i] += creal(I * (k * omega) * b->X[i * K + k]  /* the velocity at instant j */
                              * cexp(I * (TWO_PI * (double)((long)k * j % N) / N)));
        }
        for (int i = 0; i < n; i++)
            for (int l = 0; l < n; l++)
                sum += 0.5 * v[i] * b->M[l * n + i] * v[l];  /* kinetic energy */
        most = fmax(most, sum);
    }
    return most;
}

/* Where to begin at amplitude a: the last motion in proportion, or the linear mode. */
static void start_at(struct backbone *b, double a, struct backbone_point *out)
{
    int K = b->H + 1;

    *out = (struct backbone_point) { .amplitude = a,
                                     .omega = b->a > 0 ? b->at_omega : b->omega,
                                     .damping_ratio = b->a > 0 ? b->at_zeta : b->zeta,
                                     .X = b->X };
    for (int i = 0; i < b->n * K; i++)
        b->X[i] = b->a > 0 ? b->good[i] * (a / b->a) : i % K == 1 ? a * b->shape[i / K] : 0;
}

/* The motion begins where X_1 of `lead` is real and positive. */
static void begin_at_peak(struct backbone *b)
{
    int K = b->H + 1;
    double complex X = b->X[b->lead * K + 1];

    for (int e = 0; e < b->n * K && X != 0; e++)
        b->X[e] *= cexp(-I * (e % K) * carg(X));
}

/* What was found is the last motion. */
static void keep(struct backbone *b, double a, const struct backbone_point *out)
{
    memcpy(b->good, b->X, (size_t)b->n * ((size_t)b->H + 1) * sizeof *b->good);
    b->a = a;
    b->at_omega = out->omega;
    b->at_zeta = out->damping_ratio;
}

enum modal_status backbone_at(struct backbone *b, double a, struct backbone_point *out,
                              struct modal_error *err)
{
    double share = 1;
    int iterations = 0;
    enum modal_status rc = MODAL_OK;

    /* Amplitudes from the last one found towards a: all of the way, or a share of its logarithm. */
    for (int halvings = 0; rc == MODAL_OK && halvings < HALVINGS_MOST; ) {
        /* amplitudes in proportion, share of the way by its logarithm */
        double from = b->a > 0 ? b->a : a, next = share < 1 ? from * pow(a / from, share) : a;

        start_at(b, next, out);
        rc = newton(b, next, out, err);
        iterations += out->iterations;
        if (rc != MODAL_OK || (out->converged && next == a))
            break;
        if (out->converged) {
            keep(b, next, out);
            share = 1;
        } else {
            if (b->a == 0)
                break;
            share /= 2;
        }
        halvings += !out->converged;
    }
    out->iterations = iterations;
    out->amplitude = a;
    b->walks = false;
    if (rc == MODAL_OK && out->converged) {
        keep(b, a, out);
        if (creal(b->X[b->lead * (b->H + 1) + 1]) < 0)
            begin_at_peak(b);
        out->energy = kinetic_peak(b, out->omega);
    }
    return rc;
}

/* Does no harmonic that counts change by more than half of itself from the last motion to Y?  The
 * first is left out: it vanishes at a tongue's end, where curves branch, and Newton's method has to
 * be some way off on either side. */
static bool gradual(const struct backbone *b)
{
    int n = b->n, m = 2 * b->H + 1;

    for (int c = 0; c < m; c += c > 0 ? 2 : 3) {
        double change = 0, now = 0, then = 0;

        for (int e = 0; e < (c > 0 ? 2 : 1) * n * n; e++) {
            int part = c + e / (n * n), i = e % n * m + part, j = e / n % n * m + part;
            double M = b->M[e % (n * n)];

            change += M * (b->y[i] - b->last[i]) * (b->y[j] - b->last[j]);
            now += M * b->y[i] * b->y[j];
            then += M * b->last[i] * b->last[j];
        }
        if (fmax(now, then) > STEP_LEAST * STEP_LEAST * b->size && change > fmax(now, then) / 4)
            return false;
    }
    return true;
}

/* The real part's place of the harmonic and dof that moves most in k times the root of mass. */
static int steadiest(const struct backbone *b)
{
    int m = 2 * b->H + 1, best = b->lead * m + 1;
    double most = 0;

    for (int i = 0; i < b->n; i++)
        for (int k = 1; k <= b->H; k++) {
            const double *y = b->last + i * m + 2 * k - 1;
            double square = b->M[i * b->n + i] * k * k * (y[0] * y[0] + y[1] * y[1]);

            if (square > most) {
                most = square;
                best = i * m + 2 * k - 1;
            }
        }
    return best;
}

/* The foretold point, LENGTH on along the secant of the last two, and the plane through it. */
static void foretell(struct backbone *b)
{
    int all = b->order + 2;
    double square;

    pack(b, b->good, b->at_omega, b->at_zeta, b->last);
    memcpy(b->secant, b->last, (size_t)b->order * sizeof *b->secant);
    b->secant[b->order] = b->secant[b->order + 1] = 0;
    b->size = metric(b, b->secant, 1, b->plane);
    b->still = steadiest(b);
    for (int i = 0; i < all; i++)
        b->secant[i] = b->last[i] - b->before[i];
    square = metric(b, b->secant, b->size, b->plane);
    for (int i = 0; i < all; i++) {
        b->secant[i] /= sqrt(square);
        b->plane[i] /= sqrt(square);
        b->foretold[i] = b->last[i] + b->length * b->secant[i];
    }
}

/* The cosine between the secant before and that to where `out` and b->X stand. */
static double turn(struct backbone *b, const struct backbone_point *out)
{
    int all = b->order + 2;
    double along;

    pack(b, b->X, out->omega, out->damping_ratio, b->y);
    for (int i = 0; i < all; i++)
        b->secant[i] = b->y[i] - b->last[i];
    along = dot(b->plane, b->secant, all);
    return along / sqrt(metric(b, b->secant, b->size, b->rhs));
}

/* The first step along the curve, from the motion found towards amplitude TO. */
static enum modal_status set_out(struct backbone *b, double to, struct backbone_point *out,
                                 struct modal_error *err)
{
    double a = to > b->a ? fmin(to, b->a * (1 + STEP_MOST / 2))
                         : fmax(to, b->a / (1 + STEP_MOST / 2));
    enum modal_status rc;

    pack(b, b->good, b->at_omega, b->at_zeta, b->before);
    b->length = STEP_MOST / 2;
    rc = backbone_at(b, a, out, err);
    b->walks = rc == MODAL_OK && out->converged;
    return rc;
}

enum modal_status backbone_next(struct backbone *b, double to, struct backbone_point *out,
                                struct modal_error *err)
{
    int iterations = 0;
    enum modal_status rc = MODAL_OK;

    if (!b->walks)
        return set_out(b, to, out, err);
    for (*out = (struct backbone_point) { 0 }; rc == MODAL_OK && b->length >= STEP_LEAST;) {
        double a, cosine = 0;

        foretell(b);
        unpack(b, b->foretold, b->X);
        *out = (struct backbone_point) { .omega = b->foretold[b->order],
                                         .damping_ratio = b->foretold[b->order + 1], .X = b->X };
        rc = newton(b, 0, out, err);
        out->iterations = iterations += out->iterations;
        a = sqrt(modal_square(b, NULL, 0));
        out->amplitude = a;
        if (rc == MODAL_OK && out->converged)
            cosine = turn(b, out);
        if (rc != MODAL_OK)
            break;
        if (!(cosine > SHARP) || (b->length > 2 * STEP_LEAST && !gradual(b))) {
            out->converged = false;
            b->length /= 2;
            continue;
        }
        if ((to - b->a) * (to - a) <= 0)
            return backbone_at(b, to, out, err);
        memcpy(b->before, b->last, ((size_t)b->order + 2) * sizeof *b->before);
        keep(b, a, out);
        begin_at_peak(b);
        out->energy = kinetic_peak(b, out->omega);
        if (cosine > FLAT && out->iterations <= ITERATIONS_EASY)
            b->length = fmin(1.5 * b->length, STEP_MOST);
        break;
    }
    return rc;
}
