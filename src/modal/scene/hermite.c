/*
 * hermite.c - the cubic Bernoulli element
 *
 * w(xi) = N(xi)^T [w_1, s_1, w_2, s_2], xi = x/h, with
 *
 *     N = [1 - 3 xi^2 + 2 xi^3,  h (xi - 2 xi^2 + xi^3),  3 xi^2 - 2 xi^3,  h (xi^3 - xi^2)]    (1)
 *
 * The three matrices are the integrals over the element of N'' N''^T, N N^T and N' N'^T in closed
 * form.  For loads at the nodes of a beam without mass the element is exact, since (1) spans the
 * solutions of w'''' = 0.
 */
#include "modal/scene/hermite.h"
#include "modal/linalg/matrix.h"
#include <stddef.h>

/* Integer tables times `scale`; h multiplies once for each slope among row and column. */
static void scaled(const int table[16], double scale, double h, double out[16])
{
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            out[4 * i + j] = scale * table[4 * i + j] * (i % 2 ? h : 1) * (j % 2 ? h : 1);
}

void hermite_stiffness(double EI, double h, double k[16])
{
    static const int table[16] = { 12, 6, -12, 6, 6, 4, -6, 2, -12, -6, 12, -6, 6, 2, -6, 4 };
    scaled(table, EI / (h * h * h), h, k);
}

void hermite_mass(double m, double h, double mass[16])
{
    static const int table[16] = { 156, 22, 54,  -13, 22,  4,  13,  -3,
                                   54,  13, 156, -22, -13, -3, -22, 4 };
    scaled(table, m * h / 420, h, mass);
}

void hermite_slope(double h, double g[16])
{
    static const int table[16] = { 36, 3, -36, 3, 3, 4, -3, -1, -36, -3, 36, -3, 3, -1, -3, 4 };
    scaled(table, 1 / (30 * h), h, g);
}

void hermite_shape(double h, double xi, double n[4], double slope[4])
{
    n[0] = 1 - xi * xi * (3 - 2 * xi);
    n[1] = h * xi * (1 - xi) * (1 - xi);
    n[2] = xi * xi * (3 - 2 * xi);
    n[3] = -h * xi * xi * (1 - xi);
    if (slope != NULL) {
        slope[0] = -6 * xi * (1 - xi) / h;
        slope[1] = (1 - xi) * (1 - 3 * xi);
        slope[2] = -slope[0];
        slope[3] = xi * (3 * xi - 2);
    }
}
