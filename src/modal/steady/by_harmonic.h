/* by_harmonic.h - a derivative in blocks (blocks.h) solved by GMRES, harmonics factored apart
 *
 * Where few dofs couple harmonics, or many dofs each other, factors of the blocks fill far more
 * than those of one harmonic do. */
#ifndef MODAL_BY_HARMONIC_H
#define MODAL_BY_HARMONIC_H
#include <stdbool.h>

struct blocks;
struct pattern;

struct by_harmonic;

/* For blocks of PATTERN (borrowed) without a border, of harmonics 0 .. HJ; NULL where there is no
 * memory. */
struct by_harmonic *by_harmonic_new(const struct pattern *pattern, int HJ);
/* Frees S; NULL is none. */
void by_harmonic_free(struct by_harmonic *s);
/* What each harmonic of B does to itself, factored, unless factors from before still serve; false
 * where that is singular to rounding. */
bool by_harmonic_factor(struct by_harmonic *s, const struct blocks *b);
/* The least pivot over the largest of all of them. */
double by_harmonic_rcond(const struct by_harmonic *s);
/* y <- B^-1 y of the B last factored, unchanged since, to LEFT of the first step, preconditioned;
 * false where it is not reached: y is near. */
bool by_harmonic_solve(struct by_harmonic *s, const struct blocks *b, double left, double *y);
/* Operations (budget.h, scattered) of factors and solutions so far, */
double by_harmonic_work(const struct by_harmonic *s);
/* what one more solution costs, as far as that is usual, */
double by_harmonic_solution(const struct by_harmonic *s, const struct blocks *b);
/* and what factors of the blocks themselves would. */
double by_harmonic_of_blocks(const struct by_harmonic *s);
#endif
