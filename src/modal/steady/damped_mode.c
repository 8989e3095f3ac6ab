/* damped_mode.c - see damped_mode.h
 *
 * lambda (x, lambda x) = A (x, lambda x), A = [0, 1; -M^-1 K, -M^-1 C], by dgeev.
 */
#include "modal/steady/damped_mode.h"
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"

/* A motion that swings, its vector from column AT on. */
struct swing { double omega, rate; int at; };

static int by_frequency(const void *a, const void *b)
{
    const struct swing *x = a, *y = b;

    return (x->omega > y->omega) - (x->omega < y->omega);
}

/* M^-1 K and M^-1 C in place of K and C. */
static enum modal_status over_mass(const double *M, double *K, double *C, int n,
                                   struct workspace *room, struct modal_error *err)
{
    double *LU = workspace_zeros(room, (size_t)n * (size_t)n, sizeof *LU);
    int *pivot = workspace_zeros(room, (size_t)n, sizeof *pivot);

    if (room->failed)
        return modal_fail(err, MODAL_NO_MEMORY, "damped mode: no memory for %d dofs", n);
    memcpy(LU, M, (size_t)n * (size_t)n * sizeof *LU);
    if (LAPACKE_dgesv(LAPACK_COL_MAJOR, n, n, LU, n, pivot, K, n) != 0
        || LAPACKE_dgetrs(LAPACK_COL_MAJOR, 'N', n, n, LU, n, pivot, C, n) != 0)
        return modal_fail(err, MODAL_BAD_INPUT, "damped mode: the mass matrix is singular");
    return MODAL_OK;
}

/* Re and im into SHAPE, as the header has it. */
static void scale_shape(const double *M, const double *re, const double *im, int n,
                        double complex *shape)
{
    double square = 0;
    int lead = 0;

    for (int i = 0; i < n; i++) {
        shape[i] = CMPLX(re[i], im[i]);
        lead = cabs(shape[i]) > cabs(shape[lead]) ? i : lead;
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            square += creal(conj(shape[i]) * M[j * n + i] * shape[j]);
    double complex unit = conj(shape[lead]) / cabs(shape[lead]) / sqrt(square);

    for (int i = 0; i < n; i++)
        shape[i] *= unit;
}

enum modal_status damped_mode(const double *M, double *K, double *C, int n, int mode,
                              double complex *shape, struct damped_mode *out,
                              struct modal_error *err)
{
    size_t N = 2 * (size_t)n;
    struct workspace room = { 0 };
    double *A = workspace_zeros(&room, N * N, sizeof *A),
           *V = workspace_zeros(&room, N * N, sizeof *V),
           *re = workspace_zeros(&room, N, sizeof *re), *im = workspace_zeros(&room, N, sizeof *im);
    struct swing *own = workspace_zeros(&room, N, sizeof *own);
    enum modal_status rc = over_mass(M, K, C, n, &room, err);
    int count = 0;

    for (size_t j = 0; rc == MODAL_OK && j < (size_t)n; j++) {
        A[((size_t)n + j) * N + j] = 1;
        for (size_t i = 0; i < (size_t)n; i++) {
            A[j * N + (size_t)n + i] = -K[j * (size_t)n + i];
            A[((size_t)n + j) * N + (size_t)n + i] = -C[j * (size_t)n + i];
        }
    }
    if (rc == MODAL_OK
        && LAPACKE_dgeev(LAPACK_COL_MAJOR, 'N', 'V', 2 * n, A, 2 * n, re, im, NULL, 1, V, 2 * n)
               != 0)
        rc = modal_fail(err, MODAL_NO_CONVERGENCE, "damped mode: dgeev failed on %d dofs", n);
    for (int j = 0; rc == MODAL_OK && j < 2 * n; j++)
        if (im[j] > 0)
            own[count++] = (struct swing) { hypot(re[j], im[j]), -re[j], j };
    if (rc == MODAL_OK) {
        qsort(own, (size_t)count, sizeof *own, by_frequency);
        *out = (struct damped_mode) { .swinging = count };
    }
    if (rc == MODAL_OK && mode <= count) {
        const double *x = V + (size_t)own[mode - 1].at * N;

        out->omega = own[mode - 1].omega;
        out->damping_ratio = own[mode - 1].rate / out->omega;
        scale_shape(M, x, x + N, n, shape);
    }
    workspace_free(&room);
    return rc;
}
