/*
 * gmres.c - see gmres.h
 *
 * Arnoldi's vectors by modified Gram and Schmidt, the least squares of Hessenberg's matrix by
 * Givens' rotations, column by column [SS86]; no restarts.
 *
 * [SS86] Saad and Schultz, SIAM J. Sci. Stat. Comput. 7 (1986) 856-869.
 */
#include "modal/linalg/gmres.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

struct gmres {
    size_t n;
    int most, vectors;
    double **vector;                    /* most + 1, made when first used */
    double *R, *g, *c, *s;              /* column k of the triangle at R + k (most + 1) */
};

struct gmres *gmres_new(size_t n, int most)
{
    struct gmres *g = calloc(1, sizeof *g);
    size_t m = (size_t)most;

    if (g == NULL)
        return NULL;
    *g = (struct gmres) { .n = n, .most = most,
                          .vector = calloc(m + 1, sizeof *g->vector),
                          .R = calloc((m + 1) * (m + 1), sizeof *g->R),
                          .g = calloc(m + 1, sizeof *g->g),
                          .c = calloc(m + 1, sizeof *g->c),
                          .s = calloc(m + 1, sizeof *g->s) };
    if (g->vector != NULL && g->R != NULL && g->g != NULL && g->c != NULL && g->s != NULL)
        return g;
    gmres_free(g);
    return NULL;
}

void gmres_free(struct gmres *g)
{
    if (g == NULL)
        return;
    for (int i = 0; g->vector != NULL && i <= g->most; i++)
        free(g->vector[i]);
    free(g->vector);
    free(g->R);
    free(g->g);
    free(g->c);
    free(g->s);
    free(g);
}

int gmres_vectors(const struct gmres *g) { return g->vectors; }

/* Vector I, there from now on; false: no memory. */
static bool have_vector(struct gmres *g, int i)
{
    if (g->vector[i] == NULL)
        g->vector[i] = malloc((g->n + 1) * sizeof **g->vector);
    return g->vector[i] != NULL;
}

/* Column K of Hessenberg's matrix is new.  Where all of it vanishes, A being singular, it takes
 * nothing from what is left: the turn is by a right angle. */
static void turn(struct gmres *g, int k)
{
    double *h = g->R + (size_t)k * ((size_t)g->most + 1), size;

    for (int j = 0; j < k; j++) {                       /* the rotations of those before */
        double t = g->c[j] * h[j] + g->s[j] * h[j + 1];

        h[j + 1] = g->c[j] * h[j + 1] - g->s[j] * h[j];
        h[j] = t;
    }
    size = hypot(h[k], h[k + 1]);
    g->c[k] = size > 0 ? h[k] / size : 0;
    g->s[k] = size > 0 ? h[k + 1] / size : 1;
    h[k] = size;
    g->g[k + 1] = -g->s[k] * g->g[k];
    g->g[k] *= g->c[k];
}

/* y <- the combination of the first K vectors that leaves least. */
static void combine(struct gmres *g, int k, double *y)
{
    size_t stride = (size_t)g->most + 1;

    memset(y, 0, g->n * sizeof *y);
    for (int i = k - 1; i >= 0; i--) {
        double size = g->R[(size_t)i * stride + (size_t)i];

        for (int j = i + 1; j < k; j++)
            g->g[i] -= g->R[(size_t)j * stride + (size_t)i] * g->g[j];
        g->g[i] = size != 0 ? g->g[i] / size : 0;
        cblas_daxpy((int)g->n, g->g[i], g->vector[i], 1, y, 1);
    }
}

bool gmres_solve(struct gmres *g, void (*apply)(void *context, const double *in, double *out),
                 void *context, double left, double *y)
{
    double first, size = 1;                 /* size: of the newest vector, 0 where there is none */
    bool ok;
    int k = 0, n = (int)g->n;

    g->vectors = 0;
    if (!have_vector(g, 0))
        return false;
    first = g->g[0] = cblas_dnrm2(n, y, 1);
    for (size_t i = 0; i < g->n; i++)
        g->vector[0][i] = first > 0 ? y[i] / first : 0;
    for (; fabs(g->g[k]) > left * first && size > 0 && k < g->most && have_vector(g, k + 1); k++) {
        double *w = g->vector[k + 1], *h = g->R + (size_t)k * ((size_t)g->most + 1);

        apply(context, g->vector[k], w);
        for (int j = 0; j <= k; j++) {
            h[j] = cblas_ddot(n, g->vector[j], 1, w, 1);
            cblas_daxpy(n, -h[j], g->vector[j], 1, w, 1);
        }
        h[k + 1] = size = cblas_dnrm2(n, w, 1);
        for (size_t i = 0; size > 0 && i < g->n; i++)
            w[i] /= size;
        turn(g, k);
    }
    g->vectors = k;
    ok = isfinite(first) && fabs(g->g[k]) <= left * first;
    combine(g, k, y);
    return ok;
}
