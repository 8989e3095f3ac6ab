/* test_massless.c - massless dofs eliminated: the dynamic stiffness seen by the dofs with mass
 * stays what it was */
#include "check.h"
#include <complex.h>
#include <float.h>
#include <lapacke.h>
#include "modal/scene/massless.h"

/* D(s) = s^2 M + s C + K reduced to the dofs KEPT by solving for the others: the inverse's block
 * inverted. */
static void reduced(int n, const double *M, const double *C, const double *K, double complex s,
                    const int *kept, int m, double complex *out)
{
    double complex D[CONDENSE_ROOM], inverse[CONDENSE_ROOM] = { 0 }, block[CONDENSE_ROOM];
    lapack_int pivot[CONDENSE_MOST];

    for (int i = 0; i < n * n; i++)
        D[i] = s * s * M[i] + s * C[i] + K[i];
    for (int i = 0; i < n; i++)
        inverse[i * n + i] = 1;
    CHECK(LAPACKE_zgesv(LAPACK_ROW_MAJOR, n, n, D, n, pivot, inverse, n) == 0);
    for (int i = 0; i < m; i++)
        for (int j = 0; j < m; j++) {
            block[i * m + j] = inverse[kept[i] * n + kept[j]];
            out[i * m + j] = i == j;
        }
    CHECK(LAPACKE_zgesv(LAPACK_ROW_MAJOR, m, m, block, m, pivot, out, m) == 0);
}

/* s^2 M + s C + K - F (s E - A)^-1 (Bx + s Bv). */
static void condensed_at(const struct condensed *c, double complex s, double complex *out)
{
    double complex P[CONDENSE_ROOM], B[CONDENSE_ROOM];
    lapack_int pivot[CONDENSE_MOST];
    int nx = c->nx, nb = c->nb;

    for (int i = 0; i < nb * nb; i++)
        P[i] = s * c->E[i] - c->A[i];
    for (int i = 0; i < nb * nx; i++)
        B[i] = c->Bx[i] + s * c->Bv[i];
    if (nb > 0)
        CHECK(LAPACKE_zgesv(LAPACK_ROW_MAJOR, nb, nx, P, nb, pivot, B, nx) == 0);
    for (int i = 0; i < nx; i++)
        for (int j = 0; j < nx; j++) {
            out[i * nx + j] = s * s * c->M[i * nx + j] + s * c->C[i * nx + j] + c->K[i * nx + j];
            for (int k = 0; k < nb; k++)
                out[i * nx + j] -= c->F[i * nb + k] * B[k * nx + j];
        }
}

static double pattern(int i)
{
    return sin(1.7 * i * i + 0.3);
}

/* Dofs 1 and 4 have mass, 0 and 3 are damped, 2 is static; C and K unsymmetric, as circulation
 * makes them. */
TEST(the_dynamic_stiffness_is_kept_at_any_s)
{
    enum { n = 5 };
    double M[n * n] = { 0 }, C[n * n], K[n * n];
    const double complex at[3] = { 0.7 + 1.3 * I, -2.1 + 0.4 * I, 30 * I };
    struct condensed c;

    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            C[i * n + j] = i == 2 || j == 2 ? 0 : 0.3 * pattern(7 * i + j) + 2 * (i == j);
            K[i * n + j] = pattern(100 + 5 * i + j) + 6 * (i == j);
        }
    M[1 * n + 1] = 2.3;
    M[4 * n + 4] = 1.1;
    M[1 * n + 4] = M[4 * n + 1] = 0.2;
    CHECK(condense_massless(n, M, C, K, &c, NULL) == MODAL_OK);
    CHECK(c.nx == 2 && c.nb == 2 && c.na == 1 && c.x[0] == 1 && c.x[1] == 4 && c.b[0] == 0 &&
          c.b[1] == 3 && c.a[0] == 2);
    for (int q = 0; q < 3; q++) {
        double complex got[4], expected[4];

        condensed_at(&c, at[q], got);
        reduced(n, M, C, K, at[q], c.x, 2, expected);
        for (int i = 0; i < 4; i++)
            CHECK_NEAR(cabs(got[i] - expected[i]), 0, 1e-13 * cabs(expected[0]));
    }
}

/* Static dofs follow: a = Rx x solves their own row. */
TEST(static_dofs_are_recovered)
{
    const double M[9] = { 1.7 }, C[9] = { 0.4 }, K[9] = { 9, -4, 0, -4, 7, -3, 0, -3, 5 };
    struct condensed c;

    CHECK(condense_massless(3, M, C, K, &c, NULL) == MODAL_OK);
    CHECK(c.nx == 1 && c.nb == 0 && c.na == 2);
    CHECK_NEAR(-4 + 7 * c.Rx[0] - 3 * c.Rx[1], 0, 20 * DBL_EPSILON);
    CHECK_NEAR(-3 * c.Rx[0] + 5 * c.Rx[1], 0, 20 * DBL_EPSILON);
    CHECK_NEAR(c.K[0], 9 - 4 * c.Rx[0], 20 * DBL_EPSILON);
}

TEST(a_massless_dof_held_by_nothing_is_refused)
{
    const double M[4] = { 1 }, C[4] = { 0.1 }, K[4] = { 3 };
    struct condensed c = { .nx = 77 };

    CHECK(condense_massless(2, M, C, K, &c, NULL) == MODAL_BAD_INPUT);
    CHECK(c.nx == 77);
}
