/* test_wing_model.c - the paper's wing against the reference's frequencies and exact exponents
 *
 * Wing and densities of the reference (ft, slug, s); its tables print 6 decimals, the bar is 1e-5
 * of |lambda|.
 */
#include "check.h"
#include <complex.h>
#include <cblas.h>
#include <lapacke.h>
#include <stdlib.h>
#include "modal/linalg/eigen.h"
#include "modal/scene/wing_model.h"

/* Matrices this small gain nothing from threads, which wait for each other on a busy machine. */
__attribute__((constructor)) static void one_thread(void)
{
    openblas_set_num_threads(1);
}

static const struct wing goland = { 20, 6, 4, 2.4e7, 2.4e6, 0.75, 1.95, 0.6 };

static void assemble(const struct wing *w, double *M, double *K)
{
    double m[64], k[64];
    int n = wing_dofs(w), dof[8];

    wing_element(w, m, k);
    for (int e = 0; e < w->elements; e++) {
        wing_element_dofs(w, e, dof);
        for (int i = 0; i < 8; i++)
            for (int j = 0; j < 8; j++)
                if (dof[i] >= 0 && dof[j] >= 0) {
                    M[dof[i] * n + dof[j]] += m[8 * i + j];
                    K[dof[i] * n + dof[j]] += k[8 * i + j];
                }
    }
}

static void add_rows(double *to, int ld, int i0, int j0, const double *from, int m, int n,
                     double factor)
{
    for (int i = 0; i < m; i++)
        for (int j = 0; j < n; j++)
            to[(i0 + i) * ld + j0 + j] += factor * from[i * n + j];
}

/* Exponents of M x'' + C x' + K x = F z, E z' = A z + Bx x + Bv x' + Ba x'': left [I, M -; -Ba E]
 * times rates. */
static int exponents(const struct wing *w, const struct airloads *a, double complex *lambda)
{
    struct airloads_matrices air;
    int n = wing_dofs(w);

    CHECK(airloads_new(w, a, &air, NULL) == MODAL_OK);
    int nz = air.nz, N = 2 * n + nz;
    double *M = calloc((size_t)(n * n), sizeof *M), *K = calloc((size_t)(n * n), sizeof *K);
    double *L = calloc((size_t)(N * N), sizeof *L), *R = calloc((size_t)(N * N), sizeof *R);
    lapack_int *pivot = malloc((size_t)N * sizeof *pivot);

    assemble(w, M, K);
    for (int i = 0; i < n; i++)
        L[i * N + i] = R[i * N + n + i] = 1;
    add_rows(L, N, n, n, M, n, n, 1);
    add_rows(L, N, n, n, air.M, n, n, 1);
    add_rows(L, N, 2 * n, n, air.Ba, nz, n, -1);
    add_rows(L, N, 2 * n, 2 * n, air.flow.E, nz, nz, 1);
    add_rows(R, N, n, 0, K, n, n, -1);
    add_rows(R, N, n, 0, air.K, n, n, -1);
    add_rows(R, N, n, n, air.C, n, n, -1);
    add_rows(R, N, n, 2 * n, air.F, n, nz, 1);
    add_rows(R, N, 2 * n, 0, air.Bx, nz, n, 1);
    add_rows(R, N, 2 * n, n, air.Bv, nz, n, 1);
    add_rows(R, N, 2 * n, 2 * n, air.flow.A, nz, nz, 1);
    CHECK(LAPACKE_dgesv(LAPACK_ROW_MAJOR, N, N, L, N, pivot, R, N) == 0);
    struct matrix state = { N, N, N, R };              /* transposed: the same eigenvalues */
    CHECK(eigen_general(&state, lambda, NULL, NULL, NULL) == MODAL_OK);
    free(M);
    free(K);
    free(L);
    free(R);
    free(pivot);
    airloads_done(&air);
    return N;
}

static double distance(const double complex *lambda, int count, double complex to)
{
    double least = HUGE_VAL;

    for (int i = 0; i < count; i++)
        least = fmin(least, cabs(lambda[i] - to));
    return least;
}

/* Every row of a table up to 1.05 of the flutter speed, both modes. */
static void check_table(const char *file, const struct inflow_kind *inflow, double density,
                        double flutter)
{
    double complex lambda[512];
    char line[512];
    int rows = 0;
    FILE *f = fopen(file, "r");

    CHECK(f != NULL && fgets(line, sizeof line, f) != NULL);
    while (fgets(line, sizeof line, f) != NULL) {
        double U, hz, w1, s1, zeta, w2, s2;

        CHECK(sscanf(line, "%lf,%lf,%lf,%lf,%lf,%lf,%lf,%lf", &U, &hz, &w1, &s1, &zeta, &hz, &w2,
                     &s2) == 8);
        if (U > 1.05 * flutter)
            continue;
        struct airloads a = { U, density, 6.28, -0.5, 9, inflow, inflow->standard };
        int count = exponents(&goland, &a, lambda);
        CHECK_NEAR(distance(lambda, count, s1 + w1 * I), 0, 1e-5 * hypot(s1, w1));
        CHECK_NEAR(distance(lambda, count, s2 + w2 * I), 0, 1e-5 * hypot(s2, w2));
        rows++;
    }
    fclose(f);
    CHECK(rows > 15);
}

static const double sea_level = 0.0023769, at_102 = 0.0019791267362890986;

TEST(peters_he_matches_the_reference_up_to_flutter)
{
    check_table(TEST_DATA "/wing/rho102_ph3d.csv", &inflow_peters_he, at_102, 585.6);
    check_table(TEST_DATA "/wing/rhoSL_ph3d.csv", &inflow_peters_he, sea_level, 552.153);
}

TEST(peters_2d_matches_the_reference_up_to_flutter)
{
    check_table(TEST_DATA "/wing/rho102_peters2d.csv", &inflow_peters_2d, at_102, 475.315);
    check_table(TEST_DATA "/wing/rhoSL_peters2d.csv", &inflow_peters_2d, sea_level, 443.795);
}

TEST(jones_matches_the_reference_up_to_flutter)
{
    check_table(TEST_DATA "/wing/rho102_jones.csv", &inflow_jones, at_102, 479.216);
    check_table(TEST_DATA "/wing/rhoSL_jones.csv", &inflow_jones, sea_level, 447.91);
}

/* Frequencies of unit_checks.json: in vacuum, and at rest in air (added mass only). */
TEST(vacuum_frequencies_are_the_reference_s)
{
    static const double vacuum[6] = { 48.365058344041,  95.792261728703, 244.187111637672,
                                      349.034544212196, 444.87350174063, 601.833429358974 },
                        added[4] = { 46.553220656847, 93.93452205883, 235.569235436094,
                                     340.299844752646 };
    double complex lambda[64];
    struct airloads a = { 0, 0, 6.28, -0.5, 9, &inflow_none, 0 };
    int count = exponents(&goland, &a, lambda);

    for (int i = 0; i < 6; i++)
        CHECK_NEAR(distance(lambda, count, vacuum[i] * I), 0, 1e-9 * vacuum[i]);
    a.density = at_102;
    count = exponents(&goland, &a, lambda);
    for (int i = 0; i < 4; i++)
        CHECK_NEAR(distance(lambda, count, added[i] * I), 0, 1e-9 * added[i]);
}

/* Without offset the wing is a beam and a rod: torsion's exact first frequency is (pi/2L)
 * sqrt(GJ/I_rho), the beam's (1.8751040687/L)^2 sqrt(EI/m); a cubic element's error is (beta
 * h)^4/1440 of the frequency, 3.4e-5 for the beam of four. */
TEST(uncoupled_frequencies_converge_to_beam_and_rod)
{
    struct wing w = goland;
    double complex lambda[64];
    struct airloads a = { 0, 0, 6.28, -0.5, 9, &inflow_none, 0 };

    w.x_cg = 0;
    int count = exponents(&w, &a, lambda);
    double torsion = M_PI / 40 * sqrt(2.4e6 / 1.95),
           bending = pow(1.87510406871196 / 20, 2) * sqrt(2.4e7 / 0.75);
    CHECK_NEAR(distance(lambda, count, torsion * I), 0, 1e-5 * torsion);
    CHECK_NEAR(distance(lambda, count, bending * I), 0, 4e-5 * bending);
}

/* Cubics reproduce cubics: w = y^2 (Hermite) and phi = y are interpolated exactly anywhere. */
TEST(rows_interpolate_polynomials_exactly)
{
    double x[20], rw[20], rp[20];

    for (int i = 0; i < 4; i++) {
        x[2 * i] = 25.0 * (i + 1) * (i + 1);
        x[2 * i + 1] = 10.0 * (i + 1);
    }
    for (int i = 0; i < 12; i++)
        x[8 + i] = 5.0 / 3 * (i + 1);
    for (double y = 0; y <= 20; y += 0.7183) {
        double w = 0, phi = 0;

        wing_rows(&goland, y, rw, rp);
        for (int i = 0; i < 20; i++) {
            w += rw[i] * x[i];
            phi += rp[i] * x[i];
        }
        CHECK_NEAR(w, y * y, 1e-12 * 400);
        CHECK_NEAR(phi, y, 1e-13 * 20);
    }
}
