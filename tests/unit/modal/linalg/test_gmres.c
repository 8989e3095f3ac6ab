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

TEST(a_second_right_hand_side_begins_with_what_the_first_found)
{
    struct gmres *g = gmres_new(N, N), *alone = gmres_new(N, N);
    double x[3][N], y[3][N], again[N];
    int products = 0, of_the_first;

    for (int j = 0; j < 3; j++) {
        for (int i = 0; i < N; i++)                     /* the third: of the first's and a little */
            x[j][i] = j < 2 ? sin((i + 1.0) * (j + 1)) : x[0][i] + 1e-3 * (i % 7);
        tridiagonal(&products, x[j], y[j]);
    }
    for (int i = 0; i < N; i++)
        again[i] = y[2][i];
    CHECK(gmres_solve(alone, tridiagonal, &products, 1e-4, again));
    CHECK(gmres_solve(g, tridiagonal, &products, 1e-4, y[0]));
    of_the_first = gmres_vectors(g);
    CHECK(of_the_first > 10);
    CHECK(gmres_solve(g, tridiagonal, &products, 1e-4, y[2]));
    CHECK(gmres_vectors(g) < gmres_vectors(alone));
    CHECK(gmres_solve(g, tridiagonal, &products, 1e-4, y[1]));
    for (int j = 0; j < 3; j++)
        for (int i = 0; i < N; i++)
            CHECK_NEAR(y[j][i], x[j][i], 1e-2);
    gmres_free(alone);
    gmres_free(g);
}

TEST(what_was_solved_before_is_there_without_a_product_until_the_operator_is_another)
{
    struct gmres *g = gmres_new(N, N);
    double y[N], again[N];
    int products = 0;

    for (int i = 0; i < N; i++)
        y[i] = again[i] = cos(i * i);
    CHECK(gmres_solve(g, tridiagonal, &products, 1e-4, y) && products > 0);
    CHECK(gmres_solve(g, tridiagonal, &products, 1e-3, again) && gmres_vectors(g) == 0);
    for (int i = 0; i < N; i++)
        CHECK_NEAR(again[i], y[i], 1e-2);
    gmres_forget(g);
    CHECK(gmres_solve(g, tridiagonal, &products, 1e-3, again) && gmres_vectors(g) > 0);
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
