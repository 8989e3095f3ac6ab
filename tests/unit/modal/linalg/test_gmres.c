/* GMRES beside what is known without it. */
#include "check.h"
#include <math.h>
#include <stdlib.h>
#include "modal/linalg/gmres.h"

enum { N = 30 };

/* out <- (tridiagonal) in: 3 on the diagonal, -1 above it, -1.5 below. */
static void tridiagonal(void *context, const double *in, double *out)
{
    ++*(int *)context;
    for (int i = 0; i < N; i++)
        out[i] = 3 * in[i] - (i > 0 ? 1.5 * in[i - 1] : 0) - (i < N - 1 ? in[i + 1] : 0);
}

TEST(what_was_multiplied_is_found_again_with_a_vector_a_product)
{
    struct gmres *g = gmres_new(N, N);
    double x[N], y[N];
    int products = 0;

    for (int i = 0; i < N; i++)
        x[i] = sin(i + 1.0);
    tridiagonal(&products, x, y);
    products = 0;
    CHECK(gmres_solve(g, tridiagonal, &products, 1e-13, y));
    CHECK(gmres_vectors(g) == products && products <= N);
    for (int i = 0; i < N; i++)
        CHECK_NEAR(y[i], x[i], 1e-11);
    gmres_free(g);
}

TEST(what_so_few_vectors_do_not_reach_is_near_and_said_not_to_be_reached)
{
    struct gmres *g = gmres_new(N, 5);
    double x[N], y[N], zero[N] = { 0 };
    int products = 0;

    for (int i = 0; i < N; i++)
        x[i] = sin(i + 1.0);
    tridiagonal(&products, x, y);
    CHECK(!gmres_solve(g, tridiagonal, &products, 1e-13, y) && gmres_vectors(g) == 5);
    for (int i = 0; i < N; i++)
        CHECK_NEAR(y[i], x[i], 0.2);
    CHECK(gmres_solve(g, tridiagonal, &products, 1e-3, zero) && zero[0] == 0 && zero[N - 1] == 0);
    gmres_free(g);
}

/* out <- (0, in_0): of no vector the first is made. */
static void shift(void *context, const double *in, double *out)
{
    ++*(int *)context;
    out[0] = 0;
    out[1] = in[0];
}

TEST(what_a_singular_operator_does_not_reach_is_said_not_to_be_reached)
{
    struct gmres *g = gmres_new(2, 2);
    double y[2] = { 1, 0 };
    int products = 0;

    CHECK(!gmres_solve(g, shift, &products, 1e-3, y) && isfinite(y[0]) && isfinite(y[1]));
    gmres_free(g);
}
