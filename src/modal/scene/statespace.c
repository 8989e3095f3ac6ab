/* statespace.c - see statespace.h
 *
 * (1) of program.h left-multiplied by Phi^T, with q'' = y_2':
 *
 *     y_1' = diag(s) y_2
 *     y_2' = -Phi^T K Phi diag(1/s) y_1 - Phi^T C Phi y_2 + Phi^T F z + Phi^T p                 (2)
 *     z'   = E^-1 (A z + Bx x + Bv x' + Ba Phi y_2')                                            (3)
 *
 * What lies off the 2 x 2 blocks below (64 + n) eps of the largest entry is the rounding of these
 * products, and dropped when that makes the system fall into blocks.
 */
#include "modal/scene/statespace.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "statespace: out of memory");
}

/* M x n by columns, of SPACE.  NULL: no memory. */
static double *dense(const struct sparse *a, int m, int n, struct workspace *space)
{
    double *x = workspace_zeros(space, (size_t)m * (size_t)n, sizeof *x);
    struct matrix out = { m, n, m, x };  /* a view of x */

    if (x != NULL && a->m > 0)
        sparse_add_to_dense(a, 1, &out);
    return x;
}

/* Phi^T X Phi, n x n, of SPACE.  WORK n x n. */
static double *congruence(const struct statespace *ss, const struct sparse *X, double *work,
                          struct workspace *space)
{
    int n = ss->n;
    double *x = dense(X, n, n, space);  /* then its own result */

    if (x == NULL)
        return NULL;
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, n, n, 1, x, n, ss->phi, n, 0, work,
                n);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, n, n, n, 1, ss->phi, n, work, n, 0, x, n);
    return x;
}

/* What pulsates of mode I's stiffness, all parts at their largest. */
static double pulsating_stiffness(const struct statespace *ss, int i)
{
    const double *phi = ss->phi + (size_t)i * (size_t)ss->n;
    double all = 0;

    for (int h = 0; h < 2 * ss->p->harmonics; h++) {
        const struct program_harmonic *a = &ss->p->harmonic[h / 2];
        const struct sparse *K = h % 2 == 0 ? &a->cosine[PROGRAM_K] : &a->sine[PROGRAM_K];
        double part = 0;
        for (int r = 0; r < K->m; r++)
            for (int e = K->start[r]; e < K->start[r + 1]; e++)
                part += phi[r] * K->value[e] * phi[K->index[e]];
        all += fabs(part);
    }
    return all;
}

/* Phi of the symmetric part of K, M-orthonormal, and the scales s: a rigid mode's, whose
 * frequency is 0, is a small share of the largest, or what pulsates on it: else that over s
 * were beyond all other entries of A. */
static enum modal_status find_modes(struct statespace *ss, struct modal_error *err)
{
    int n = ss->n, info;
    struct workspace scratch = { 0 };  /* M: overwritten by its factor */
    double *M = dense(&ss->p->constant[PROGRAM_M], n, n, &scratch), largest = 0;

    ss->phi = dense(&ss->p->constant[PROGRAM_K], n, n, &ss->space);
    ss->s = workspace_zeros(&ss->space, (size_t)n, sizeof *ss->s);
    if (scratch.failed || ss->space.failed) {
        workspace_free(&scratch);
        return no_memory(err);
    }
    for (int j = 0; j < n; j++)
        for (int i = 0; i < j; i++)
            /* the symmetric part: Phi is a basis, not the answer */
            ss->phi[i + (size_t)j * (size_t)n] =
                (ss->phi[i + (size_t)j * (size_t)n] + ss->phi[j + (size_t)i * (size_t)n]) / 2;
    /* Phi^T M Phi = 1, ascending w^2 */
    info = LAPACKE_dsygvd(LAPACK_COL_MAJOR, 1, 'V', 'U', n, ss->phi, n, M, n, ss->s);
    workspace_free(&scratch);
    if (info != 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure",
                                "the pair of stiffness and mass has no modes (dsygvd: %d)", info);
    for (int i = 0; i < n; i++)
        largest = fmax(largest, sqrt(fabs(ss->s[i])));
    for (int i = 0; i < n; i++)
        ss->s[i] = fmax(fmax(sqrt(fabs(ss->s[i])), STATESPACE_RIGID * largest),
                        sqrt(pulsating_stiffness(ss, i)));
    for (int i = 0; i < n; i++)
        ss->s[i] = ss->s[i] > 0 ? ss->s[i] : 1;
    return MODAL_OK;
}

/* Rows n .. 2n-1 of A: -Phi^T K Phi / s, -Phi^T C Phi, each times FACTOR. */
static enum modal_status add_second_order(const struct statespace *ss, const struct sparse *C,
                                          const struct sparse *K, double *A, double *work,
                                          struct modal_error *err)
{
    int n = ss->n;
    size_t N = (size_t)ss->N;
    struct workspace scratch = { 0 };
    double *c = congruence(ss, C, work, &scratch), *k = congruence(ss, K, work, &scratch);
    enum modal_status rc = scratch.failed ? no_memory(err) : MODAL_OK;

    for (int j = 0; rc == MODAL_OK && j < n; j++)
        for (int i = 0; i < n; i++) {
            /* (2) */
            A[(size_t)(n + i) + (size_t)j * N] -= k[i + (size_t)j * (size_t)n] / ss->s[j];
            A[(size_t)(n + i) + (size_t)(n + j) * N] -= c[i + (size_t)j * (size_t)n];  /* (2) */
        }
    workspace_free(&scratch);
    return rc;
}

/* X (m x n sparse) times Phi (and 1/s where SCALED), added into A at ROW, COLUMN. */
static void add_times_phi(const struct statespace *ss, const struct sparse *X, bool scaled,
                          double *A, int row, int column)
{
    for (int i = 0; i < X->m; i++)
        for (int k = X->start[i]; k < X->start[i + 1]; k++)
            for (int j = 0; j < ss->n; j++)
                A[(size_t)(row + i) + (size_t)(column + j) * (size_t)ss->N] +=
                    X->value[k] * ss->phi[X->index[k] + (size_t)j * (size_t)ss->n]
                    / (scaled ? ss->s[j] : 1);
}

/* Phi^T F into rows n .. 2n-1, columns of z. */
static void add_force_of_states(const struct statespace *ss, double *A)
{
    const struct sparse *F = &ss->p->F;

    for (int i = 0; i < F->m; i++)
        for (int k = F->start[i]; k < F->start[i + 1]; k++)
            for (int j = 0; j < ss->n; j++)
                A[(size_t)(ss->n + j) + (size_t)(2 * ss->n + F->index[k]) * (size_t)ss->N] +=
                    ss->phi[i + (size_t)j * (size_t)ss->n] * F->value[k];
}

/* (3): the rows of z in A and in B, divided by E. */
static enum modal_status add_states(struct statespace *ss, struct modal_error *err)
{
    const struct program *p = ss->p;
    int n = ss->n, nz = ss->nz, N = ss->N;
    struct workspace scratch = { 0 };
    double *E = dense(&p->E, nz, nz, &scratch);  /* then its factors */
    double *Ba = workspace_zeros(&scratch, (size_t)nz * (size_t)n, sizeof *Ba);
    int *pivot = workspace_zeros(&scratch, (size_t)nz, sizeof *pivot), info = 0;  /* of E */

    if (scratch.failed) {
        workspace_free(&scratch);
        return no_memory(err);
    }
    add_force_of_states(ss, ss->A);  /* Phi^T F z of (2) */
    /* the block of z in A */
    struct matrix az = { nz, nz, N, ss->A + 2 * n + 2 * (size_t)n * (size_t)N };
    sparse_add_to_dense(&p->A, 1, &az);
    add_times_phi(ss, &p->Bx, true, ss->A, 2 * n, 0);
    add_times_phi(ss, &p->Bv, false, ss->A, 2 * n, n);
    for (int i = 0; i < nz; i++)                         /* Ba Phi */
        for (int k = p->Ba.start[i]; k < p->Ba.start[i + 1]; k++)
            for (int j = 0; j < n; j++)
                Ba[i + (size_t)j * (size_t)nz] +=
                    p->Ba.value[k] * ss->phi[p->Ba.index[k] + (size_t)j * (size_t)n];
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, nz, N, n, 1, Ba, nz, ss->A + n, N, 1,
                ss->A + 2 * n, N);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, nz, n, n, 1, Ba, nz, ss->B + n, N, 0,
                ss->B + 2 * n, N);
    info = LAPACKE_dgetrf(LAPACK_COL_MAJOR, nz, nz, E, nz, pivot);  /* E^-1 of (3) */
    if (info == 0) {
        LAPACKE_dgetrs(LAPACK_COL_MAJOR, 'N', nz, N, E, nz, pivot, ss->A + 2 * n, N);
        LAPACKE_dgetrs(LAPACK_COL_MAJOR, 'N', nz, n, E, nz, pivot, ss->B + 2 * n, N);
    }
    workspace_free(&scratch);
    return info == 0 ? MODAL_OK
                     : modal_fail_field(err, MODAL_BAD_INPUT, "effects",
                                        "the linear states have a singular matrix E");
}

/* Whether A falls into 2 x 2 blocks; what is off them by rounding only is then cleared. */
static bool decouple(struct statespace *ss)
{
    size_t N = (size_t)ss->N, n = (size_t)ss->n;
    double rounding;

    if (ss->nz > 0)  /* linear states couple modes */
        return false;
    /* of products of n terms, by the largest */
    rounding = (double)(64 + n) * DBL_EPSILON * numbers_largest(ss->A, N * N);
    for (size_t j = 0; j < N; j++)
        for (size_t i = 0; i < N; i++)
            if (i % n != j % n && fabs(ss->A[i + j * N]) > rounding)
                return false;
    for (size_t j = 0; j < N; j++)
        for (size_t i = 0; i < N; i++)
            if (i % n != j % n)  /* off the blocks (y_1i, y_2i) */
                ss->A[i + j * N] = 0;
    return true;
}

/* (2) of each harmonic, of C and K. */
static enum modal_status add_harmonics(struct statespace *ss, double *work, struct modal_error *err)
{
    const struct program *p = ss->p;
    size_t size = (size_t)ss->N * (size_t)ss->N;

    if (p->harmonics == 0)
        return MODAL_OK;
    ss->harmonic = workspace_zeros(&ss->space, (size_t)p->harmonics, sizeof *ss->harmonic);
    if (ss->harmonic == NULL)
        return no_memory(err);
    ss->harmonics = p->harmonics;
    for (int h = 0; h < p->harmonics; h++) {
        const struct program_harmonic *from = &p->harmonic[h];
        struct statespace_harmonic *to = &ss->harmonic[h];
        enum modal_status rc;
        to->k = from->k;  /* (3) of program.h */
        to->cosine = workspace_zeros(&ss->space, size, sizeof *to->cosine);
        to->sine = workspace_zeros(&ss->space, size, sizeof *to->sine);
        if (ss->space.failed)
            return no_memory(err);
        if (from->cosine[PROGRAM_M].m > 0 || from->sine[PROGRAM_M].m > 0)
            return modal_fail_field(err, MODAL_BAD_INPUT, "effects",
                                    "a pulsating mass cannot be stepped");
        rc = add_second_order(ss, &from->cosine[PROGRAM_C], &from->cosine[PROGRAM_K], to->cosine,
                              work, err);
        if (rc == MODAL_OK)
            rc = add_second_order(ss, &from->sine[PROGRAM_C], &from->sine[PROGRAM_K], to->sine,
                                  work, err);
        if (rc != MODAL_OK)
            return rc;
    }
    return MODAL_OK;
}

/* (2) and (3) into A and B. */
static enum modal_status fill(struct statespace *ss, struct modal_error *err)
{
    const struct program *p = ss->p;
    int n = ss->n;
    size_t N = (size_t)ss->N;
    double *work = malloc((size_t)n * (size_t)n * sizeof *work + 1);  /* of the congruences */
    enum modal_status rc;

    ss->A = workspace_zeros(&ss->space, N * N, sizeof *ss->A);
    ss->B = workspace_zeros(&ss->space, N * (size_t)n, sizeof *ss->B);
    if (work == NULL || ss->space.failed) {
        free(work);  /* of the congruences alone */
        return no_memory(err);
    }
    for (int i = 0; i < n; i++)
        ss->A[(size_t)i + (size_t)(n + i) * N] = ss->s[i];  /* y_1' = s y_2 */
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++)
            ss->B[(size_t)(n + i) + (size_t)j * N] = ss->phi[j + (size_t)i * (size_t)n];
    rc = add_second_order(ss, &p->constant[PROGRAM_C], &p->constant[PROGRAM_K], ss->A, work, err);
    if (rc == MODAL_OK && ss->nz > 0)
        rc = add_states(ss, err);
    if (rc == MODAL_OK)
        rc = add_harmonics(ss, work, err);
    if (rc == MODAL_OK)
        ss->modal = decouple(ss);  /* last: all of A is known */
    free(work);
    return rc;
}

enum modal_status statespace_new(const struct program *p, struct statespace **out,
                                 struct modal_error *err)
{
    struct statespace *ss;
    enum modal_status rc;

    if (p->n > STATESPACE_DOFS_MOST || 2 * p->n + p->n_linear > STATESPACE_STATES_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "structure",
                                "%d dofs and %d linear states are too many for dense stepping; at "
                                "most %d dofs and %d states",
                                p->n, p->n_linear, STATESPACE_DOFS_MOST, STATESPACE_STATES_MOST);
    if ((ss = calloc(1, sizeof *ss)) == NULL)
        return no_memory(err);
    ss->p = p;
    ss->n = p->n;
    ss->nz = p->n_linear;  /* z */
    ss->N = 2 * p->n + p->n_linear;  /* (y_1, y_2, z) */
    rc = find_modes(ss, err);
    if (rc == MODAL_OK)
        rc = fill(ss, err);
    if (rc == MODAL_OK)
        *out = ss;
    else
        statespace_free(ss);
    return rc;
}

void statespace_free(struct statespace *ss)
{
    if (ss == NULL)
        return;
    workspace_free(&ss->space);
    free(ss);
}

void statespace_start(const struct statespace *ss, double *y)
{
    const struct sparse *M = &ss->p->constant[PROGRAM_M];
    int n = ss->n;

    memset(y, 0, (size_t)ss->N * sizeof *y);  /* z starts at 0 */
    for (int i = 0; i < n; i++)                            /* q = Phi^T M x */
        for (int k = M->start[i]; k < M->start[i + 1]; k++)
            for (int j = 0; j < n; j++) {
                double f = ss->phi[i + (size_t)j * (size_t)n] * M->value[k];
                y[j] += ss->s[j] * f * ss->p->x0[M->index[k]];  /* y_1 = s q */
                y[n + j] += f * ss->p->v0[M->index[k]];  /* y_2 = q' */
            }
}

void statespace_at(const struct statespace *ss, double t, double *out)
{
    size_t size = (size_t)ss->N * (size_t)ss->N;

    memcpy(out, ss->A, size * sizeof *out);  /* the constant part */
    for (int h = 0; h < ss->harmonics; h++) {
        const struct statespace_harmonic *a = &ss->harmonic[h];
        double theta = a->k * ss->p->omega * t, c = cos(theta), s = sin(theta);
        for (size_t i = 0; i < size; i++)
            out[i] += c * a->cosine[i] + s * a->sine[i];
    }
}

void statespace_motion(const struct statespace *ss, const double *y, double *x)
{
    int n = ss->n;

    memset(x, 0, (size_t)n * sizeof *x);
    for (int j = 0; j < n; j++)
        cblas_daxpy(n, y[j] / ss->s[j], ss->phi + (size_t)j * (size_t)n, 1, x, 1);
}
