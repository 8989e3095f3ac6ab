/*
 * monodromy.c - see monodromy.h
 *
 * In theta = omega t the first-order form of (1) of stability.h is w' = A(theta) w, w = (y,
 * dy/dtheta, z, c / gain).  The period is cut at every event of the exact laws and, where A varies
 * in between, into equal steps.  On a cut with constant A, exp(h A) is exact; elsewhere the
 * sixth-order Magnus method of [BCOR09] (their section 5.4, three Gauss points A_1 .. A_3),
 *
 *     a1 = h A_2, a2 = sqrt(15)/3 h (A_3 - A_1), a3 = 10/3 h (A_3 - 2 A_2 + A_1),  C1 = [a1, a2],
 *     C2 = -1/60 [a1, 2 a3 + C1],  Omega = a1 + a3/12 + [-20 a1 - a3 + C1, a2 + C2] / 240,      (1)
 *
 * its steps doubled by stability.c until the multipliers settle.  Exponentials by scaling and
 * squaring of the diagonal Pade approximant of degree 6, at norm 1/2 good to 3e-16 [ML03, method
 * 3].
 *
 * At a cut, a slider that comes to rest takes c = sum ref_j y_j (pieces.h), one that leaves it
 * loses c; the motion's speed is continuous there, so nothing else jumps.
 *
 * [BCOR09] Blanes, Casas, Oteo, Ros, Physics Reports 470 (2009) 151-238.
 * [ML03]   Moler, Van Loan, SIAM Review 45 (2003) 3-49.
 */
#include "modal/steady/monodromy.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/expm.h"
#include "modal/numbers.h"
#include "modal/scene/pieces.h"
#include "modal/scene/program.h"
#include "modal/steady/budget.h"
#include "modal/steady/disturbance.h"
#include "modal/steady/point.h"

static const double TWO_PI = 6.283185307179586477;   /* a period of theta */
/* A pivot of M so far below its scale that its inverse leaves the range of doubles. */
static const double SINGULAR = 1e300;
/* The norm at which the approximant of degree PADE is exact to rounding [ML03]. */
static const double PADE_NORM = 0.5;
enum {
    PADE = 6,   /* rounding at PADE_NORM */
    SQUARINGS_MOST = 1000,   /* halvings of a norm that is finite */
    /* of matrices of the order: 5 of the approximant, a solve, the map's */
    PRODUCTS_STEP = 8,
    PRODUCTS_MAGNUS = 6,     /* of (1) */
    SMALL_ORDER = 8          /* up to which a call of BLAS costs more than its sums */
};

void monodromy_done(struct monodromy *m)
{
    workspace_free(&m->space);
}

/* (omega^2 M)^-1 at THETA into Minv. */
static bool invert_mass(struct monodromy *m, double theta)
{
    int n = m->n;
    double scale = 0, least = HUGE_VAL, square = m->point->omega * m->point->omega;
    struct matrix M = { n, n, n, m->Minv };

    memset(m->Minv, 0, (size_t)n * (size_t)n * sizeof *m->Minv);
    sparse_add_to_dense(&m->p->constant[PROGRAM_M], square, &M);
    for (int h = 0; m->mass_varies && h < m->p->harmonics; h++) {
        const struct program_harmonic *a = &m->p->harmonic[h];

        sparse_add_to_dense(&a->cosine[PROGRAM_M], square * cos(a->k * theta), &M);
        sparse_add_to_dense(&a->sine[PROGRAM_M], square * sin(a->k * theta), &M);
    }
    scale = numbers_largest(m->Minv, (size_t)n * (size_t)n);
    if (LAPACKE_dgetrf_work(LAPACK_COL_MAJOR, n, n, m->Minv, n, m->pivot) != 0)
        return false;
    for (int i = 0; i < n; i++)
        least = fmin(least, fabs(m->Minv[i * n + i]));
    if (!(least > 0) || scale / least > SINGULAR)
        return false;
    return LAPACKE_dgetri(LAPACK_COL_MAJOR, n, m->Minv, n, m->pivot) == 0;
}

/* E z' = A z + Bx y + Bv x' + Ba x'' (program.h, (2)) as dz/dtheta = z0 z + z1 y + z2 dy/dtheta +
 * z3 d2y/dtheta2. */
static enum modal_status linear_states(struct monodromy *m, struct modal_error *err)
{
    const struct sparse *in[4] = { &m->p->A, &m->p->Bx, &m->p->Bv, &m->p->Ba };
    /* d/dt = omega d/dtheta */
    double omega = m->point->omega, scale[4] = { 1 / omega, 1 / omega, 1, omega };
    int nz = m->nz, n = m->n;
    double *E = workspace_zeros(&m->space, (size_t)nz * (size_t)nz, sizeof *E);
    int *pivot = workspace_zeros(&m->space, (size_t)nz, sizeof *pivot);
    struct matrix full = { nz, nz, nz, E };
    enum modal_status rc = workspace_check(&m->space, "stability: no memory", err);

    if (rc == MODAL_OK)
        sparse_add_to_dense(&m->p->E, 1, &full);
    if (rc == MODAL_OK && LAPACKE_dgetrf_work(LAPACK_COL_MAJOR, nz, nz, E, nz, pivot) != 0)
        m->of->reason = "the linear states' equations are singular";
    for (int i = 0; rc == MODAL_OK && m->of->reason == NULL && i < 4; i++) {
        int columns = i == 0 ? nz : n;
        struct matrix out = { nz, columns, nz, NULL };

        out.x = m->z[i] =
            workspace_zeros(&m->space, (size_t)nz * (size_t)columns, sizeof *out.x);
        if (out.x == NULL) {
            rc = modal_fail(err, MODAL_NO_MEMORY, "stability: no memory for %d linear states", nz);
            break;
        }
        if (in[i]->m > 0)
            sparse_add_to_dense(in[i], scale[i], &out);
        /* E^-1 of each */
        LAPACKE_dgetrs_work(LAPACK_COL_MAJOR, 'N', nz, columns, E, nz, pivot, out.x, nz);
    }
    return rc;
}

/* column c of (omega^2 M)^-1 B, sign included, added times -value into rows of y'' */
static void force_column(struct monodromy *m, double *A, const struct law *law, int column,
                         double value)
{
    int n = m->n, order = m->order, last = law->kind->inputs - 1;  /* what its sliders resist */

    for (int e = law->start[last]; e < law->start[last + 1]; e++)
        for (int i = 0; i < n; i++)
            A[(size_t)column * (size_t)order + (size_t)(n + i)] -=  /* rows of y'' */
                law->end[e].weight * m->Minv[law->end[e].dof * n + i] * value;
}

/* The periodic matrices at theta onto K and omega C. */
static void periodic_part(struct monodromy *m, double theta, double *K, double *C)
{
    struct matrix Km = { m->n, m->n, m->n, K }, Cm = { m->n, m->n, m->n, C };

    for (int h = 0; h < m->p->harmonics; h++) {
        const struct program_harmonic *a = &m->p->harmonic[h];
        double c = cos(a->k * theta), s = sin(a->k * theta);

        sparse_add_to_dense(&a->cosine[PROGRAM_K], c, &Km);
        sparse_add_to_dense(&a->sine[PROGRAM_K], s, &Km);
        sparse_add_to_dense(&a->cosine[PROGRAM_C], c * m->point->omega, &Cm);
        sparse_add_to_dense(&a->sine[PROGRAM_C], s * m->point->omega, &Cm);
    }
}

/* Columns of z in the rows of y'', then the rows of z: z3 times those of y'' and what acts on z
 * itself. */
static void build_linear_states(const struct monodromy *m, double *A)
{
    int n = m->n, nz = m->nz, order = m->order;
    const struct sparse *F = &m->p->F;

    for (int i = 0; F->m > 0 && i < n; i++)
        for (int e = F->start[i]; e < F->start[i + 1]; e++)
            cblas_daxpy(n, F->value[e], m->Minv + (size_t)i * (size_t)n, 1,
                        A + (size_t)(2 * n + F->index[e]) * (size_t)order + n, 1);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, nz, order, n, 1, m->z[3], nz, A + n,
                order, 0, A + 2 * n, order);
    for (int i = 0; i < 3; i++) {
        int columns = i == 0 ? nz : n, first = i == 0 ? 2 * n : i == 1 ? 0 : n;

        for (int c = 0; c < columns; c++)
            cblas_daxpy(nz, 1, m->z[i] + (size_t)c * (size_t)nz, 1,
                        A + (size_t)(first + c) * (size_t)order + 2 * n, 1);
    }
}

/* A(theta): w = (y, dy/dtheta, z, c / gain), rows in this order. */
static enum modal_status build(struct monodromy *m, double theta, double *A,
                               struct modal_error *err)
{
    int n = m->n, order = m->order;
    double *K = m->work[4], *C = m->work[5], held[LAW_TERMS_MOST];
    enum modal_status rc = MODAL_OK;

    memset(A, 0, (size_t)order * (size_t)order * sizeof *A);
    if (m->mass_varies && !invert_mass(m, theta))
        m->of->reason = "the mass matrix is singular somewhere in the period";
    memcpy(K, m->K, (size_t)n * (size_t)n * sizeof *K);  /* the constant part */
    memcpy(C, m->C, (size_t)n * (size_t)n * sizeof *C);
    periodic_part(m, theta, K, C);
    for (int l = 0; rc == MODAL_OK && l < m->p->laws; l++) {
        const struct law *law = &m->p->law[l];
        double gd[LAW_INPUTS_MOST][LAW_INPUTS_MOST], gv[LAW_INPUTS_MOST][LAW_INPUTS_MOST];

        rc = disturbance_slopes(m->of, l, theta, gd, gv, held, err);
        for (int i = 0; i < law->kind->inputs; i++)
            for (int j = 0; j < law->kind->inputs; j++)
                {
                    /* K + sum B g_d B^T of stability.h, (1) */
                    law_spread(law, i, j, gd[i][j], n, K);
                    /* omega (C + sum B g_v B^T) */
                    law_spread(law, i, j, m->point->omega * gv[i][j], n, C);
                }
        for (int e = 0; m->of->exact[l] && e < law->memory; e++)
            if (held[e] != 0)
                force_column(m, A, law, 2 * n + m->nz + m->of->first_slider[l] + e, held[e]);
    }
    for (int i = 0; i < n; i++)
        A[(size_t)(n + i) * (size_t)order + (size_t)i] = 1;  /* dy/dtheta */
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, n, n, -1, m->Minv, n, K, n, 1, A + n,
                order);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, n, n, -1, m->Minv, n, C, n, 1,
                A + (size_t)n * (size_t)order + n, order);
    if (m->nz > 0)
        build_linear_states(m, A);
    return rc;
}

/* Operations (budget.h) of square_multiply(); short sums run slower than BLAS. */
static double product_work(int n)
{
    return 2.0 * n * n * n / (n > SMALL_ORDER ? BUDGET_DENSE : 0.5);
}

/* Of a step, as monodromy_around counts them, but for an exponential's squarings. */
static double step_work(const struct monodromy *m)
{
    int matrices = m->of->varies ? 3 : 1;
    double build = 2 * product_work(m->n) + m->order * m->order
                 + m->p->laws * (BUDGET_SAMPLE + (m->of->varies ? BUDGET_SUM * m->of->H : 0.0));

    return matrices * build + (m->of->varies ? PRODUCTS_MAGNUS + PRODUCTS_STEP : PRODUCTS_STEP)
                              * product_work(m->order);
}

double monodromy_work(const struct monodromy *m, int steps)
{
    return (m->of->cuts + (m->of->varies ? steps : 0.0)) * step_work(m);
}

/* X <- exp(X) = (Q^-1 P)(X / 2^s)^(2^s), P and Q the Pade approximant's; P, Q, T scratch.  The
 * squarings are counted in WORK. */
static bool exponential(int n, double *X, double *P, double *Q, double *T, int *pivot,
                        struct budget *work)
{
    static const double c[PADE + 1] = { 1,         0.5,         5.0 / 44,    1.0 / 66,
                                        1.0 / 792, 1.0 / 15840, 1.0 / 665280 };
    size_t size = (size_t)n * (size_t)n;
    double norm = 0, sum;
    int squarings = 0;

    for (int i = 0; i < n; i++) {
        sum = 0;
        for (int j = 0; j < n; j++)
            sum += fabs(X[(size_t)j * (size_t)n + (size_t)i]);
        norm = fmax(norm, sum);                         /* the norm of rows */
    }
    if (!isfinite(norm))
        return false;
    while (norm > PADE_NORM && squarings < SQUARINGS_MOST) {
        norm /= 2;
        squarings++;
    }
    for (size_t i = 0; i < size; i++)
        X[i] = ldexp(X[i], -squarings);
    memset(P, 0, size * sizeof *P);
    memset(Q, 0, size * sizeof *Q);
    memcpy(T, X, size * sizeof *T);
    for (int i = 0; i < n; i++)
        P[(size_t)i * (size_t)(n + 1)] = Q[(size_t)i * (size_t)(n + 1)] = 1;
    double *power = T, *next = malloc(size * sizeof *next);
    if (next == NULL)
        return false;
    for (int d = 1; d <= PADE; d++) {
        for (size_t i = 0; i < size; i++) {
            P[i] += c[d] * power[i];                    /* sum c_d X^d */
            Q[i] += (d % 2 ? -c[d] : c[d]) * power[i];  /* the same of -X */
        }
        if (d < PADE) {
            square_multiply(n, 1, X, power, 0, next);
            memcpy(power, next, size * sizeof *power);
        }
    }
    free(next);
    if (LAPACKE_dgesv_work(LAPACK_COL_MAJOR, n, n, Q, n, pivot, P, n) != 0)
        return false;
    budget_add(work, squarings * product_work(n));
    for (int s = 0; s < squarings; s++) {
        square_multiply(n, 1, P, P, 0, T);                     /* undoes a halving */
        memcpy(P, T, size * sizeof *P);
    }
    memcpy(X, P, size * sizeof *X);
    return true;
}

/* [A, B] = A B - B A. */
static void commutator(int n, const double *A, const double *B, double *out)
{
    square_multiply(n, 1, A, B, 0, out);
    square_multiply(n, -1, B, A, 1, out);
}

/* (1), from A at the three Gauss points in m->A; Omega into m->A[0]. */
static void magnus(struct monodromy *m, double h)
{
    int n = m->order;
    size_t size = (size_t)n * (size_t)n;
    double *a1 = m->work[0], *a2 = m->work[1], *a3 = m->work[2], *C1 = m->work[3], *C2 = m->work[4],
           *t = m->work[5];

    for (size_t i = 0; i < size; i++) {
        double A1 = m->A[0][i], A2 = m->A[1][i], A3 = m->A[2][i];

        a1[i] = h * A2;                                 /* (1), from here on */
        a2[i] = sqrt(15) / 3 * h * (A3 - A1);
        a3[i] = 10.0 / 3 * h * (A3 - 2 * A2 + A1);
    }
    /* C1 = [a1, a2], then C2 with [a1, 2 a3 + C1]. */
    commutator(n, a1, a2, C1);
    for (size_t i = 0; i < size; i++)
        t[i] = 2 * a3[i] + C1[i];                       /* 2 a3 + C1 */
    commutator(n, a1, t, C2);
    for (size_t i = 0; i < size; i++) {
        C2[i] = a2[i] - C2[i] / 60;                     /* a2 + C2 */
        t[i] = -20 * a1[i] - a3[i] + C1[i];             /* the bracket's first */
    }
    commutator(n, t, C2, m->A[0]);
    for (size_t i = 0; i < size; i++)
        m->A[0][i] = a1[i] + a3[i] / 12 + m->A[0][i] / 240;  /* Omega */
}

/* Sliders that come to rest, or leave it, at theta: rows of c in the map. */
static void at_cut(struct monodromy *m, double theta)
{
    int order = m->order;

    for (int l = 0; l < m->p->laws; l++)
        for (int i = 0; m->of->exact[l] && i < m->of->pieces[l].count; i++) {
            const struct law_piece *piece = &m->of->pieces[l].piece[i];
            const struct law *law = &m->p->law[l];
            int row = 2 * m->n + m->nz + m->of->first_slider[l] + piece->slider,
                inputs = law->kind->inputs;
            double gain = piece->gain[inputs - 1];

            if (piece->slider < 0 || disturbance_wrap(piece->from) != theta
                || (piece->holds && !piece->starts))
                continue;
            for (int c = 0; c < order; c++) {
                double sum = 0;

                for (int j = 0; piece->holds && j < inputs; j++)
                    sum += piece->ref[j] * law_sees(law, j, m->map + c * order);
                m->map[c * order + row] = piece->holds ? sum / gain : 0;  /* c / gain */
            }
        }
}

bool monodromy_is_finite(const struct monodromy *m)
{
    for (int i = 0; i < m->order * m->order; i++)
        if (!isfinite(m->map[i]))
            return false;
    return true;
}

/* A slider that opens or slips at the end of a piece with no piece after it (a contact parted)
 * loses c too: build() gives it no weight, and at_cut sets it anew.  Ends early where the map
 * overflows. */
static enum modal_status advance(struct monodromy *m, double a, double b, int steps,
                                 struct modal_error *err)
{
    static const double gauss[3] = { 0.5 - 0.38729833462074168852, 0.5,
                                     0.5 + 0.38729833462074168852 };
    int n = m->order;
    size_t size = (size_t)n * (size_t)n;
    double h = (b - a) / steps;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < steps && monodromy_is_finite(m); i++) {
        /* Three Gauss points a step where A varies, one matrix a cut where it does not. */
        if (m->of->varies) {
            for (int g = 0; rc == MODAL_OK && g < 3; g++)
                rc = build(m, a + (i + gauss[g]) * h, m->A[g], err);
            magnus(m, h);
        } else {
            rc = build(m, 0.5 * (a + b), m->A[0], err);  /* constant on the cut: anywhere inside */
            for (size_t e = 0; e < size; e++)
                m->A[0][e] *= h;
        }
        if (rc != MODAL_OK)
            return rc;
        if (!exponential(n, m->A[0], m->work[0], m->work[1], m->work[2], m->pivot,
                         m->budget)) {
            m->of->reason = "the disturbances overflow";
            return MODAL_OK;
        }
        budget_add(m->budget, step_work(m));
        if (budget_spent(m->budget)) {
            m->of->reason = "too many states and steps for the monodromy matrix";
            return MODAL_OK;
        }
        square_multiply(n, 1, m->A[0], m->map, 0, m->work[0]);  /* the later factor from the left */
        memcpy(m->map, m->work[0], size * sizeof *m->map);
    }
    return rc;
}

enum modal_status monodromy_around(struct monodromy *m, int steps, struct modal_error *err)
{
    size_t size = (size_t)m->order * (size_t)m->order;
    enum modal_status rc = MODAL_OK;

    memset(m->map, 0, size * sizeof *m->map);
    for (int i = 0; i < m->order; i++)
        m->map[(size_t)i * (size_t)(m->order + 1)] = 1;
    for (int i = 0; rc == MODAL_OK && m->of->reason == NULL && i < m->of->cuts
                    && monodromy_is_finite(m); i++) {
        double a = m->of->cut[i], b = m->of->cut[i + 1];
        int here = m->of->varies ? (int)ceil(steps * (b - a) / TWO_PI) : 1;

        at_cut(m, a);
        if (b - a > 0)
            rc = advance(m, a, b, here < 1 ? 1 : here, err);
    }
    return rc;
}

/* A bound of the angular frequency at rest, per radian of theta: sqrt |M^-1 K|. */
double monodromy_fastest(const struct monodromy *m)
{
    double most = 0;

    for (int i = 0; i < m->n; i++) {
        double sum = 0;

        for (int j = 0; j < m->n; j++) {
            double entry = 0;

            for (int k = 0; k < m->n; k++)
                entry += m->Minv[k * m->n + i] * m->K[j * m->n + k];
            sum += fabs(entry);
        }
        most = fmax(most, sum);
    }
    return sqrt(most);
}

enum modal_status monodromy_prepare(struct monodromy *m, struct modal_error *err)
{
    size_t n = (size_t)m->of->n, order;
    struct matrix K, C;
    enum modal_status rc = MODAL_OK;

    m->p = m->of->p;
    m->point = m->of->point;
    m->budget = m->of->budget;
    m->n = m->of->n;
    m->nz = m->of->nz;
    m->order = 2 * m->n + m->nz + m->of->sliders;
    for (int h = 0; h < m->p->harmonics; h++)
        m->mass_varies |= m->p->harmonic[h].cosine[PROGRAM_M].start != NULL
                         || m->p->harmonic[h].sine[PROGRAM_M].start != NULL;
    m->Minv = workspace_zeros(&m->space, n * n, sizeof *m->Minv);
    m->K = workspace_zeros(&m->space, n * n, sizeof *m->K);
    m->C = workspace_zeros(&m->space, n * n, sizeof *m->C);
    order = (size_t)m->order;
    for (int i = 0; i < 3; i++)
        m->A[i] = workspace_zeros(&m->space, order * order, sizeof(double));
    for (int i = 0; i < 6; i++)
        m->work[i] = workspace_zeros(&m->space, order * order, sizeof(double));
    m->map = workspace_zeros(&m->space, order * order, sizeof *m->map);
    m->pivot = workspace_zeros(&m->space, order, sizeof *m->pivot);
    if (m->space.failed)
        return modal_fail(err, MODAL_NO_MEMORY, "stability: no memory for %d states", m->order);
    K = (struct matrix) { m->n, m->n, m->n, m->K };
    C = (struct matrix) { m->n, m->n, m->n, m->C };
    sparse_add_to_dense(&m->p->constant[PROGRAM_K], 1, &K);
    sparse_add_to_dense(&m->p->constant[PROGRAM_C], m->point->omega, &C);
    if (!invert_mass(m, 0))
        m->of->reason = "the mass matrix is singular";
    if (m->nz > 0 && m->of->reason == NULL)
        rc = linear_states(m, err);
    return rc;
}
