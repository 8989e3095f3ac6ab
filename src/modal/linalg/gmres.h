/* gmres.h - linear equations by GMRES, the operator known by its products only */
#ifndef MODAL_GMRES_H
#define MODAL_GMRES_H
#include <stdbool.h>
#include <stddef.h>

struct gmres;

/* For N unknowns and at most MOST products a solution, each with a vector, made when it is first
 * used; NULL: no memory.  Right-hand sides of one A after each other begin with what those before
 * found of it, as far as there is room for as many vectors again, until gmres_forget(). */
struct gmres *gmres_new(size_t n, int most);
/* Frees G; NULL is none. */
void gmres_free(struct gmres *g);
/* A is another from now on. */
void gmres_forget(struct gmres *g);
/* Vectors of the last solution: products with its operator. */
int gmres_vectors(const struct gmres *g);
/* Its multiplications and additions beside those. */
double gmres_work(const struct gmres *g);
/* y <- A^-1 y until the residual is LEFT of |y|; APPLY: out <- A in, not overlapping.
 * False where it is not reached, or for want of memory: y is near, as far as there is memory. */
bool gmres_solve(struct gmres *g, void (*apply)(void *context, const double *in, double *out),
                 void *context, double left, double *y);
#endif
