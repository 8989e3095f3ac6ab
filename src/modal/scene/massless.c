/*
 * massless.c - exact elimination of massless dofs
 *
 * Rows a:  K_aa a = -K_ax x - K_ab b,  so  R = -K_aa^-1 K_a.,  K_pq <- K_pq + K_pa R_q
 * (1) Rows b:  C_bb b' = -K_bb b - K_bx x - C_bx x'
 * (2) Rows x:  M x'' + C_xx x' + K_xx x + K_xb b + C_xb b' = p, with b' from (2), W = C_xb C_bb^-1:
 *
 *     C = C_xx - W C_bx,   K = K_xx - W K_bx,   F = -(K_xb - W K_bb)                            (3)
 */
#include "modal/scene/massless.h"
#include <lapacke.h>
#include <string.h>

/* Exactly: a small mass is a mass. */
static int row_is_zero(int n, const double *A, int i)
{
    for (int j = 0; j < n; j++)
        if (A[i * n + j] != 0 || A[j * n + i] != 0)
            return 0;
    return 1;
}

/* The block of A at ROWS and COLUMNS, by rows. */
static void pick(const double *A, int n, const int *rows, int m, const int *columns, int k,
                 double *out)
{
    for (int i = 0; i < m; i++)
        for (int j = 0; j < k; j++)
            out[i * k + j] = A[rows[i] * n + columns[j]];
}

/* out (m x k) += factor A (m x l) B (l x k) */
static void add_product(double factor, const double *A, const double *B, int m, int l, int k,
                        double *out)
{
    for (int i = 0; i < m; i++)
        for (int j = 0; j < k; j++)
            for (int h = 0; h < l; h++)
                out[i * k + j] += factor * A[i * l + h] * B[h * k + j];
}

/* B <- A^-1 B (n x k), A kept; nonzero: A is singular. */
static int solve(const double *A, int n, double *B, int k)
{
    double factors[CONDENSE_ROOM];
    lapack_int pivot[CONDENSE_MOST];

    if (n == 0 || k == 0)
        return 0;
    memcpy(factors, A, (size_t)(n * n) * sizeof *A);
    return LAPACKE_dgesv(LAPACK_ROW_MAJOR, n, k, factors, n, pivot, B, k);  /* factors: A is kept */
}

/* x, b, a: with mass, damped without mass, static. */
static void sort_dofs(int n, const double *M, const double *C, struct condensed *c)
{
    for (int i = 0; i < n; i++)
        if (!row_is_zero(n, M, i))
            c->x[c->nx++] = i;
        else if (!row_is_zero(n, C, i))
            c->b[c->nb++] = i;
        else
            c->a[c->na++] = i;
}

/* (1): R into out, the corrected K of all dofs but a into full (n x n). */
static int drop_static(int n, const double *K, double *full, struct condensed *c)
{
    double Kaa[CONDENSE_ROOM], Kax[CONDENSE_ROOM], Kab[CONDENSE_ROOM], R[CONDENSE_ROOM] = { 0 },
                                                                       Ka[CONDENSE_ROOM];
    int all[CONDENSE_MOST];

    for (int i = 0; i < n; i++)
        all[i] = i;
    pick(K, n, c->a, c->na, c->a, c->na, Kaa);
    pick(K, n, c->a, c->na, c->x, c->nx, Kax);
    pick(K, n, c->a, c->na, c->b, c->nb, Kab);
    pick(K, n, c->a, c->na, all, n, R);  /* K_a. */
    pick(K, n, all, n, c->a, c->na, Ka);  /* K_.a */
    if (solve(Kaa, c->na, R, n) != 0 || solve(Kaa, c->na, Kax, c->nx) != 0
        || solve(Kaa, c->na, Kab, c->nb) != 0)
        return 1;
    memcpy(full, K, (size_t)(n * n) * sizeof *K);
    add_product(-1, Ka, R, n, c->na, n, full);  /* K_pq - K_pa K_aa^-1 K_aq: (1) */
    for (int i = 0; i < c->na * c->nx; i++)
        c->Rx[i] = -Kax[i];  /* R of (1), its columns x */
    for (int i = 0; i < c->na * c->nb; i++)
        c->Rb[i] = -Kab[i];  /* and b */
    return 0;
}

/* (2) and (3). */
static int split_damped(int n, const double *C, const double *K, struct condensed *c)
{
    double Cxb[CONDENSE_ROOM], Cbx[CONDENSE_ROOM], Kbx[CONDENSE_ROOM], Kbb[CONDENSE_ROOM],
        Kxb[CONDENSE_ROOM];
    int nx = c->nx, nb = c->nb;

    pick(C, n, c->x, nx, c->x, nx, c->C);
    pick(K, n, c->x, nx, c->x, nx, c->K);
    pick(C, n, c->b, nb, c->b, nb, c->E);  /* E of massless.h is C_bb */
    pick(C, n, c->x, nx, c->b, nb, Cxb);
    pick(K, n, c->x, nx, c->b, nb, Kxb);
    pick(C, n, c->b, nb, c->x, nx, Cbx);
    pick(K, n, c->b, nb, c->x, nx, Kbx);
    pick(K, n, c->b, nb, c->b, nb, Kbb);
    for (int i = 0; i < nb * nb; i++)
        c->A[i] = -Kbb[i];  /* (2) */
    for (int i = 0; i < nb * nx; i++) {
        c->Bx[i] = -Kbx[i];  /* (2) */
        c->Bv[i] = -Cbx[i];  /* (2) */
    }
    if (solve(c->E, nb, Cbx, nx) != 0 || solve(c->E, nb, Kbx, nx) != 0
        || solve(c->E, nb, Kbb, nb) != 0)
        return 1;
    add_product(-1, Cxb, Cbx, nx, nb, nx, c->C);  /* C of (3): Cbx is C_bb^-1 C_bx by now */
    add_product(-1, Cxb, Kbx, nx, nb, nx, c->K);  /* K of (3) */
    add_product(1, Cxb, Kbb, nx, nb, nb, c->F);  /* W K_bb of F in (3) */
    for (int i = 0; i < nx * nb; i++)
        c->F[i] -= Kxb[i];  /* and -K_xb */
    return 0;
}

enum modal_status condense_massless(int n, const double *M, const double *C, const double *K,
                                    struct condensed *out, struct modal_error *err)
{
    struct condensed c = { 0 };
    double full[CONDENSE_ROOM];

    sort_dofs(n, M, C, &c);
    pick(M, n, c.x, c.nx, c.x, c.nx, c.M);
    if (drop_static(n, K, full, &c) != 0)
        return modal_fail(err, MODAL_BAD_INPUT,
                          "condense: a dof without mass and damping has no stiffness");
    if (split_damped(n, C, full, &c) != 0)
        return modal_fail(err, MODAL_BAD_INPUT,
                          "condense: dofs without mass are damped only against each other");
    *out = c;
    return MODAL_OK;
}
