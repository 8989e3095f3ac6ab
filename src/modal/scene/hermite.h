/* hermite.h - the cubic Bernoulli element of beams, shafts and wings: its matrices and its shape
 * functions
 *
 * One element of length h between two nodes, dofs [w_1, s_1, w_2, s_2], s = dw/dx (a slope, not a
 * rotation vector). Matrices are symmetric, 4 x 4, entry (i, j) at [4 i + j].
 */
#ifndef MODAL_HERMITE_H
#define MODAL_HERMITE_H

/* EI integral N'' N''^T:  EI in N m^2. */
void hermite_stiffness(double EI, double h, double k[16]);

/* m integral N N^T:  m in kg/m. */
void hermite_mass(double m, double h, double mass[16]);

/* integral N' N'^T, in 1/m: times an axial load the geometric stiffness, times a mass moment of
 * inertia per length (kg m) the rotary inertia. */
void hermite_slope(double h, double g[16]);

/* N and, where not NULL, N' at x = xi h, 0 <= xi <= 1. */
void hermite_shape(double h, double xi, double n[4], double slope[4]);

#endif
