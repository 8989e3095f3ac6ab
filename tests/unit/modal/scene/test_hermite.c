/* test_hermite.c - the cubic element against closed forms of beam theory and its own quadrature */
#include "check.h"
#include <float.h>
#include "modal/linalg/matrix.h"
#include "modal/scene/hermite.h"

/* Rigid motion: w = a + b x strains nothing. */
TEST(rigid_motion_strains_nothing)
{
    const double h = 0.37, EI = 98.9, q[4] = { 0.7, 1.3, 0.7 + 1.3 * 0.37, 1.3 };
    double k[16];

    hermite_stiffness(EI, h, k);
    for (int i = 0; i < 4; i++) {
        double sum = 0;
        for (int j = 0; j < 4; j++)
            sum += k[4 * i + j] * q[j];
        CHECK_NEAR(sum, 0, 50 * DBL_EPSILON * 12 * EI / (h * h * h));
    }
}

/* A cantilever's tip: w = F L^3 / 3 EI, s = F L^2 / 2 EI, exactly, from one element. */
TEST(a_cantilever_of_one_element_has_the_exact_tip_deflection)
{
    const double h = 0.73, EI = 175, F = 2.385;
    double k[16];

    hermite_stiffness(EI, h, k);
    double det = k[10] * k[15] - k[11] * k[14];
    CHECK_NEAR(F * k[15] / det, F * h * h * h / (3 * EI), 1e-14);
    CHECK_NEAR(-F * k[14] / det, F * h * h / (2 * EI), 1e-14);
}

/* The closed forms are the integrals of the shape functions: 4-point Gauss is exact for degree 7.
 */
TEST(the_matrices_are_the_integrals_of_the_shape_functions)
{
    static const double xi[4] = { 0.0694318442029737, 0.3300094782075719, 0.6699905217924281,
                                  0.9305681557970263 },
                        weight[4] = { 0.1739274225687269, 0.3260725774312731, 0.3260725774312731,
                                      0.1739274225687269 };
    const double h = 0.61, EI = 3.7, m = 0.83;
    double k[16], mass[16], g[16], n[4], s[4], K[16] = { 0 }, M[16] = { 0 }, G[16] = { 0 };

    hermite_stiffness(EI, h, k);
    hermite_mass(m, h, mass);
    hermite_slope(h, g);
    for (int q = 0; q < 4; q++) {
        /* N'' by hand */
        const double c[4] = { (12 * xi[q] - 6) / (h * h), (6 * xi[q] - 4) / h,
                              (6 - 12 * xi[q]) / (h * h), (6 * xi[q] - 2) / h };

        hermite_shape(h, xi[q], n, s);
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) {
                K[4 * i + j] += EI * h * weight[q] * c[i] * c[j];
                M[4 * i + j] += m * h * weight[q] * n[i] * n[j];
                G[4 * i + j] += h * weight[q] * s[i] * s[j];
            }
    }
    for (int i = 0; i < 16; i++) {
        CHECK_NEAR(k[i], K[i], 1e-13 * fabs(k[0]));
        CHECK_NEAR(mass[i], M[i], 1e-14);
        CHECK_NEAR(g[i], G[i], 1e-13);
    }
}
