/* quadrature.h - Gauss-Legendre points */
#ifndef MODAL_QUADRATURE_H
#define MODAL_QUADRATURE_H

/* COUNT points on (0, length), ascending, and their weights: exact for polynomials of degree 2
 * COUNT - 1. */
void gauss_legendre(int count, double length, double *position, double *weight);

#endif
