/*
 * gmres.c - see gmres.h
 *
 * Orthonormal vectors v_0, v_1, ... of which some, v_of[0], v_of[1], ..., have been multiplied;
 * H's columns are the products in these vectors, which Givens' rotations Q make triangular:
 *
 *     A v_of[j] = sum_i v_i H_ij,   Q H = R above zeros,   y = sum_i v_i t_i.                   (1)
 *
 * The combination of v_of that leaves least of y leaves |Q t| of the rows past R [SS86].  Begun
 * with y alone this is Arnoldi's method, and H Hessenberg's matrix.  A right-hand side after
 * others, of the same A, finds their vectors there and brings one more: what is multiplied next is
 * always that vector, of those that are not yet, which what is left of y has most of.  No restarts
 * within a solution; where MOST products do not reach a later right-hand side, it is begun anew
 * without the vectors of the others.
 *
 * [SS86] Saad and Schultz, SIAM J. Sci. Stat. Comput. 7 (1986) 856-869.
 */
#include "modal/linalg/gmres.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* What is left of a vector after its parts along the others, below which these are taken once more:
 * three digits of orthogonality may go; and below which nothing but rounding is left. */
static const double CANCELS = 1e-3;
static const double ROUNDING = 4 * DBL_EPSILON;

/* Of rows A and B. */
struct rotation { int a, b; double c, s; };

struct gmres {
    size_t n;
    int most, room;                     /* products of a solution; vectors, as many again and one */
    int vectors, rows, columns, turns;
    double work;
    double **vector;                    /* made when first used */
    int *of;                            /* the vector that column j is the product of */
    bool *multiplied;
    double *R;                          /* column k of the triangle at R + k room */
    struct rotation *turn;
    double *t, *g, *left;               /* (1); Q t; what is left of y */
};

struct gmres *gmres_new(size_t n, int most)
{
    struct gmres *g = calloc(1, sizeof *g);
    size_t m = 2 * (size_t)most + 1;

    if (g == NULL)
        return NULL;
    /* m (m - 1) / 2 entries below a diagonal */
    *g = (struct gmres) { .n = n, .most = most, .room = (int)m,
                          .vector = calloc(m, sizeof *g->vector),
                          .of = calloc(m, sizeof *g->of),
                          .multiplied = calloc(m, sizeof *g->multiplied),
                          .R = calloc(m * m, sizeof *g->R),
                          .turn = calloc(m * m / 2 + 1, sizeof *g->turn),
                          .t = calloc(m, sizeof *g->t),
                          .g = calloc(m, sizeof *g->g),
                          .left = calloc(m, sizeof *g->left) };
    if (g->vector != NULL && g->of != NULL && g->multiplied != NULL && g->R != NULL
        && g->turn != NULL && g->t != NULL && g->g != NULL && g->left != NULL)
        return g;
    gmres_free(g);
    return NULL;
}

void gmres_free(struct gmres *g)
{
    if (g == NULL)
        return;
    for (int i = 0; g->vector != NULL && i < g->room; i++)
        free(g->vector[i]);
    free(g->vector);
    free(g->of);
    free(g->multiplied);
    free(g->R);
    free(g->turn);
    free(g->t);
    free(g->g);
    free(g->left);
    free(g);
}

int gmres_vectors(const struct gmres *g) { return g->vectors; }
double gmres_work(const struct gmres *g) { return g->work; }

void gmres_forget(struct gmres *g) { g->rows = g->columns = g->turns = 0; }

/* Vector I, there from now on; false: no memory. */
static bool have_vector(struct gmres *g, int i)
{
    if (g->vector[i] == NULL)
        g->vector[i] = malloc((g->n + 1) * sizeof **g->vector);
    return g->vector[i] != NULL;
}

/* x <- Q x, from rotation FIRST on. */
static void rotate(const struct gmres *g, int first, double *x)
{
    for (int i = first; i < g->turns; i++) {
        const struct rotation *r = &g->turn[i];
        double a = x[r->a], b = x[r->b];

        x[r->a] = r->c * a + r->s * b;
        x[r->b] = r->c * b - r->s * a;
    }
}

/* w less its parts along all vectors, which are added to COEFFICIENT. */
static void project(struct gmres *g, double *w, double *coefficient)
{
    int n = (int)g->n;

    for (int j = 0; j < g->rows; j++) {
        double along = cblas_ddot(n, g->vector[j], 1, w, 1);

        coefficient[j] += along;
        cblas_daxpy(n, -along, g->vector[j], 1, w, 1);
    }
    g->work += 2.0 * g->rows * n;
}

/* w into its parts along all vectors and its rest, the next vector: there is room for it. */
static void divide(struct gmres *g, double *w, double *coefficient)
{
    int n = (int)g->n;
    double first = cblas_dnrm2(n, w, 1), size;

    memset(coefficient, 0, (size_t)g->room * sizeof *coefficient);
    project(g, w, coefficient);
    size = cblas_dnrm2(n, w, 1);
    if (size < CANCELS * first) {
        project(g, w, coefficient);
        size = cblas_dnrm2(n, w, 1);
    }
    if (!(size > ROUNDING * first))
        return;
    for (size_t i = 0; i < g->n; i++)
        g->vector[g->rows][i] = w[i] / size;
    g->multiplied[g->rows] = false;
    g->t[g->rows] = g->g[g->rows] = 0;                  /* where it is a product's */
    coefficient[g->rows++] = size;
}

/* The column COLUMNS is there: turned until nothing is below its diagonal, and g with it.  One of
 * rounding alone, A being singular, is none. */
static void turn(struct gmres *g)
{
    int k = g->columns, first = g->turns;
    double *h = g->R + (size_t)k * (size_t)g->room, all = cblas_dnrm2(g->rows, h, 1);

    rotate(g, 0, h);
    if (!(cblas_dnrm2(g->rows - k, h + k, 1) > ROUNDING * all))
        return;
    for (int i = g->rows - 1; i > k; i--) {
        double size = hypot(h[i - 1], h[i]);

        if (h[i] == 0)
            continue;
        g->turn[g->turns++] = (struct rotation){ i - 1, i, h[i - 1] / size, h[i] / size };
        h[i - 1] = size;
        h[i] = 0;
    }
    rotate(g, first, g->g);
    g->columns++;
}

/* |Q t| past R. */
static double norm_left(const struct gmres *g)
{
    return cblas_dnrm2(g->rows - g->columns, g->g + g->columns, 1);
}

/* The vector not multiplied yet that what is left has most of; -1: none. */
static int next_vector(struct gmres *g)
{
    int best = -1;

    for (int i = 0; i < g->rows; i++)
        g->left[i] = i < g->columns ? 0 : g->g[i];
    for (int i = g->turns - 1; i >= 0; i--) {            /* turned back */
        const struct rotation *r = &g->turn[i];
        double a = g->left[r->a], b = g->left[r->b];

        g->left[r->a] = r->c * a - r->s * b;
        g->left[r->b] = r->c * b + r->s * a;
    }
    for (int i = 0; i < g->rows; i++)
        if (!g->multiplied[i] && (best < 0 || fabs(g->left[i]) > fabs(g->left[best])))
            best = i;
    return best;
}

/* y <- the combination that leaves least. */
static void combine(struct gmres *g, double *y)
{
    size_t stride = (size_t)g->room;

    memset(y, 0, g->n * sizeof *y);
    for (int i = g->columns - 1; i >= 0; i--) {
        double size = g->R[(size_t)i * stride + (size_t)i];

        for (int j = i + 1; j < g->columns; j++)
            g->g[i] -= g->R[(size_t)j * stride + (size_t)i] * g->g[j];
        g->g[i] = size != 0 ? g->g[i] / size : 0;
        cblas_daxpy((int)g->n, g->g[i], g->vector[g->of[i]], 1, y, 1);
    }
}

/* (1) of Y, whose rest stays in it; false: no memory. */
static bool take(struct gmres *g, double *y)
{
    if (!have_vector(g, g->rows))
        return false;
    divide(g, y, g->t);
    memcpy(g->g, g->t, (size_t)g->rows * sizeof *g->g);
    rotate(g, 0, g->g);
    return true;
}

/* Products until LEFT remains or there is no more memory or vector; MOST of them. */
static void expand(struct gmres *g, void (*apply)(void *context, const double *in, double *out),
                   void *context, double left)
{
    int next;

    for (int i = 0; i < g->most && norm_left(g) > left && have_vector(g, g->rows)
                    && (next = next_vector(g)) >= 0; i++) {
        double *w = g->vector[g->rows], *h = g->R + (size_t)g->columns * (size_t)g->room;

        apply(context, g->vector[next], w);
        g->multiplied[next] = true;
        g->of[g->columns] = next;
        divide(g, w, h);
        turn(g);
        g->vectors++;
    }
}

bool gmres_solve(struct gmres *g, void (*apply)(void *context, const double *in, double *out),
                 void *context, double left, double *y)
{
    double first = cblas_dnrm2((int)g->n, y, 1);
    bool begun;

    g->vectors = 0;
    g->work = 0;
    if (g->rows >= g->most)                             /* there must be room for all */
        gmres_forget(g);
    begun = g->columns > 0;
    if (!isfinite(first) || !take(g, y))
        return false;
    expand(g, apply, context, left * first);
    if (norm_left(g) > left * first && begun) {
        memset(y, 0, g->n * sizeof *y);                 /* it has no rest by now */
        for (int i = 0; i < g->rows; i++)
            cblas_daxpy((int)g->n, g->t[i], g->vector[i], 1, y, 1);
        gmres_forget(g);
        if (!take(g, y))
            return false;
        expand(g, apply, context, left * first);
    }
    left *= first;
    first = norm_left(g);
    combine(g, y);
    return first <= left;
}
