/*
 * collocation.c - see collocation.h
 *
 * The nodes are Radau's on the right: roots of P_s(2c - 1) - P_(s-1)(2c - 1), so that the
 * quadrature at the end is of order 2 s - 1.  In c = t / h, phi(c) = sum_k a_k c^k / k!, a = V^-1
 * (phi_j), V_jk = c_j^k / k!, and
 *
 *     d/dc (y, u_0, .., u_(s-1), w) = [hA  hU 0 ..  hB_s;  u_k' = u_(k+1);  hS] (y, u, w)       (3)
 *
 * whose exponential over c_i holds E_i, the integrals of e^(hA(c_i - c)) hU c^k / k!, and G_i.
 * Where A falls into 2 x 2 blocks, (3) is solved mode by mode with one unit channel on the rate;
 * E_i then is the closed form of expm.c.
 */
#include "modal/scene/collocation.h"
#include <cblas.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/expm.h"
#include "modal/scene/stepper.h"

enum { S = COLLOCATION_STAGES, MAPS_KEPT = 24 };

struct collocation {
    const struct statespace *ss;  /* borrowed */
    const struct sources *src;  /* borrowed */
    int N, nw, m, r;  /* states, sources, channels, rows */
    double *U, *R, *BP;  /* as collocation_new has them, and B P */
    double node[S], at_zero[S], inverse[S * S];       /* V^-1, (k, j) at k + j S */
    struct collocation_map kept[MAPS_KEPT];
    int64_t used[MAPS_KEPT], clock, made;  /* when last, by a count of uses */
    int size;                                         /* of (3): dense, or of one mode */
    struct expm *exponential, *two;
    /* (3) and its exponential; N x N; N x (m S) */
    double *X, *Y, *full, *block;
    struct workspace space;  /* of all these arrays but the maps' */
};

/* P_n(x) by its three-term recurrence, stable on [-1, 1]. */
static double legendre(int n, double x)
{
    double a = 1, b = x;

    if (n == 0)
        return 1;
    for (int k = 2; k <= n; k++) {
        double c = ((2 * k - 1) * x * b - (k - 1) * a) / k;
        a = b;
        b = c;
    }
    return b;
}

/* Zero at Radau's nodes: on [0, 1], c = 1 among them. */
static double radau(double c)
{
    return legendre(S, 2 * c - 1) - legendre(S - 1, 2 * c - 1);
}

/* Roots by bisection between sign changes on a fine grid; the last is 1. */
static void find_nodes(double *node)
{
    int found = 0;

    for (int i = 0; i < 1000 && found < S - 1; i++) {
        /* narrower than any two roots of S <= 12 are apart */
        double a = i / 1000.0, b = (i + 1) / 1000.0;
        if (radau(a) * radau(b) > 0)  /* no root here */
            continue;
        for (int k = 0; k < 60; k++) {  /* bisected to the last bit */
            double c = (a + b) / 2;
            if (radau(a) * radau(c) <= 0)
                b = c;
            else
                a = c;
        }
        node[found++] = (a + b) / 2;
    }
    node[S - 1] = 1;  /* Radau's own: the end of the step */
}

/* l_j(theta) of the nodes: 1 at node j, 0 at the others. */
static double lagrange(const double *node, int j, double theta)
{
    double l = 1;

    for (int i = 0; i < S; i++)
        l *= i == j ? 1 : (theta - node[i]) / (node[j] - node[i]);
    return l;
}

/* Column j of V^-1: the coefficients of l_j in c^k / k!. */
static void monomials(const double *node, int j, double *column)
{
    /* ascending powers of prod (c - c_i) / (c_j - c_i) */
    double a[S + 1] = { 1 };
    double factorial = 1;

    for (int i = 0, degree = 0; i < S; i++) {
        if (i == j)
            continue;
        degree++;
        for (int k = degree; k >= 0; k--)
            a[k] =
                ((k > 0 ? a[k - 1] : 0) - node[i] * (k < degree ? a[k] : 0)) / (node[j] - node[i]);
    }
    for (int k = 0; k < S; k++) {
        column[k] = a[k] * factorial;  /* of c^k / k! */
        factorial *= k + 1;  /* k! of c^k / k! */
    }
}

const double *collocation_nodes(const struct collocation *c) { return c->node; }
const double *collocation_at_zero(const struct collocation *c) { return c->at_zero; }
int64_t collocation_maps_made(const struct collocation *c) { return c->made; }

void collocation_lagrange(const struct collocation *c, double theta, double *l)
{
    for (int j = 0; j < S; j++)
        l[j] = lagrange(c->node, j, theta);
}

/* C's own; NULL: no memory. */
static double *copy_of(const double *x, size_t count, struct collocation *c)
{
    double *y = workspace_zeros(&c->space, count, sizeof *y);

    if (y != NULL)
        memcpy(y, x, count * sizeof *y);  /* the caller's may go */
    return y;
}

enum modal_status collocation_new(const struct statespace *ss, const struct sources *src, int m,
                                  const double *U, int r, const double *R, struct collocation **out,
                                  struct modal_error *err)
{
    struct collocation *c = calloc(1, sizeof *c);
    enum modal_status rc;

    if (c == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "collocation: out of memory");
    c->ss = ss;
    c->src = src;
    c->N = ss->N;
    c->nw = src->nw;
    c->m = m;
    c->r = r;
    find_nodes(c->node);
    for (int j = 0; j < S; j++) {
        c->at_zero[j] = lagrange(c->node, j, 0);
        monomials(c->node, j, c->inverse + S * j);
    }
    /* (3) of one mode, or of all states */
    c->size = ss->modal ? 2 + S + c->nw : c->N + m * S + c->nw;
    c->U = copy_of(U, (size_t)c->N * (size_t)m, c);
    c->R = copy_of(R, (size_t)r * (size_t)c->N, c);
    c->BP = stepper_source_matrix(ss, src, &c->space);  /* hB_s of (3) */
    c->X = workspace_zeros(&c->space, (size_t)c->size * (size_t)c->size, sizeof *c->X);
    c->Y = workspace_zeros(&c->space, (size_t)c->size * (size_t)c->size, sizeof *c->Y);
    c->full = workspace_zeros(&c->space, (size_t)c->N * (size_t)c->N, sizeof *c->full);
    c->block = workspace_zeros(&c->space, (size_t)c->N * (size_t)(2 * m * S + c->nw),
                               sizeof *c->block);
    rc = expm_new(c->size, &c->exponential, err);  /* one workspace for all maps */
    if (rc == MODAL_OK)
        rc = expm_new(2, &c->two, err);
    if (rc == MODAL_OK)
        rc = workspace_check(&c->space, "collocation: out of memory", err);
    if (rc == MODAL_OK)
        *out = c;
    else
        collocation_free(c);
    return rc;
}

/* Also of a map half made: what is not there is NULL. */
static void map_done(struct collocation_map *m)
{
    workspace_free(&m->space);
    memset(m, 0, sizeof *m);
}

void collocation_free(struct collocation *c)
{
    if (c == NULL)
        return;
    for (int i = 0; i < MAPS_KEPT; i++)
        map_done(&c->kept[i]);  /* all that were ever used */
    expm_free(c->exponential);
    expm_free(c->two);
    workspace_free(&c->space);
    free(c);
}

/* (3), times c_i: X for the dense system. */
static void assemble_dense(struct collocation *c, double h, double ci)
{
    size_t N = (size_t)c->N, m = (size_t)c->m, nw = (size_t)c->nw, size = (size_t)c->size,
           first = N + m * S;

    memset(c->X, 0, size * size * sizeof *c->X);  /* most of (3) is zeros */
    for (size_t j = 0; j < N; j++)  /* A of (3) */
        for (size_t i = 0; i < N; i++)
            c->X[i + j * size] = ci * h * c->ss->A[i + j * N];
    for (size_t j = 0; j < m; j++)
        for (size_t i = 0; i < N; i++)
            c->X[i + (N + j) * size] = ci * h * c->U[i + j * N];
    for (size_t k = 0; k + 1 < S; k++)
        for (size_t j = 0; j < m; j++)
            c->X[N + k * m + j + (N + (k + 1) * m + j) * size] = ci;
    for (size_t j = 0; j < nw; j++) {
        for (size_t i = 0; i < N; i++)
            c->X[i + (first + j) * size] = ci * h * c->BP[i + j * N];
        for (size_t i = 0; i < nw; i++)
            c->X[first + i + (first + j) * size] = ci * h * c->src->S[i + j * nw];
    }
}

/* E, W (N x m S by monomials in c->block, then by nodes) and G at node i, dense. */
static enum modal_status node_dense(struct collocation *c, double h, int i, double *E, double *W,
                                    double *G, struct modal_error *err)
{
    size_t N = (size_t)c->N, m = (size_t)c->m, size = (size_t)c->size;
    enum modal_status rc;

    assemble_dense(c, h, c->node[i]);
    if ((rc = expm_driven(c->exponential, c->N, c->X, c->Y, err)) != MODAL_OK)
        return rc;
    for (size_t j = 0; j < N; j++)
        memcpy(E + j * N, c->Y + j * size, N * sizeof *E);
    memset(W, 0, N * m * S * sizeof *W);
    for (size_t j = 0; j < S; j++)
        for (size_t k = 0; k < S; k++)
            for (size_t ch = 0; ch < m; ch++)
                cblas_daxpy((int)N, c->inverse[k + S * j], c->Y + (N + k * m + ch) * size, 1,
                            W + (j * m + ch) * N, 1);
    for (int j = 0; j < c->nw; j++)
        memcpy(G + (size_t)j * N, c->Y + (N + m * S + (size_t)j) * size, N * sizeof *G);
    return MODAL_OK;
}

/* (3) for one mode: its 2 x 2 block, one unit channel on the rate, the sources. */
static void assemble_mode(struct collocation *c, int mode, double h, double ci)
{
    int n = c->ss->n, N = c->N, size = c->size, first = 2 + S;

    memset(c->X, 0, (size_t)size * (size_t)size * sizeof *c->X);
    for (int a = 0; a < 2; a++)
        for (int b = 0; b < 2; b++)
            c->X[a + b * size] =
                ci * h * c->ss->A[(size_t)(mode + a * n) + (size_t)(mode + b * n) * (size_t)N];
    c->X[1 + 2 * size] = ci * h;
    for (int k = 0; k + 1 < S; k++)
        c->X[2 + k + (3 + k) * size] = ci;
    for (int j = 0; j < c->nw; j++) {
        for (int a = 0; a < 2; a++)
            c->X[a + (first + j) * size] =
                ci * h * c->BP[(size_t)(mode + a * n) + (size_t)j * (size_t)N];
        for (int i = 0; i < c->nw; i++)
            c->X[first + i + (first + j) * size] = ci * h * c->src->S[i + j * c->nw];
    }
}

/* The same by modes; E holds 4 numbers a mode. */
static enum modal_status node_modal(struct collocation *c, double h, int i, double *E, double *W,
                                    double *G, struct modal_error *err)
{
    int n = c->ss->n, m = c->m, size = c->size;
    size_t N = (size_t)c->N;
    enum modal_status rc = MODAL_OK;

    for (int mode = 0; mode < n && rc == MODAL_OK; mode++) {
        double two[4];
        assemble_mode(c, mode, h, c->node[i]);
        for (int k = 0; k < 4; k++)
            two[k] = c->X[k % 2 + k / 2 * size];
        rc = expm(c->two, two, E + 4 * mode, err);
        if (rc == MODAL_OK)
            rc = expm_driven(c->exponential, 2, c->X, c->Y, err);
        for (int a = 0; a < 2 && rc == MODAL_OK; a++) {
            size_t row = (size_t)(mode + a * n);
            for (int j = 0; j < S; j++) {
                double weight = 0;
                for (int k = 0; k < S; k++)
                    weight += c->Y[a + (2 + k) * size] * c->inverse[k + S * j];
                /* U acts on rates only where there are no linear states */
                for (int ch = 0; ch < m; ch++)
                    W[row + (size_t)(j * m + ch) * N] =
                        weight * c->U[(size_t)(n + mode) + (size_t)ch * N];
            }
            for (int j = 0; j < c->nw; j++)
                G[row + (size_t)j * N] = c->Y[a + (2 + S + j) * size];
        }
    }
    return rc;
}

/* R times the E of 2 x 2 blocks. */
static void rows_times_blocks(const struct collocation *c, const double *E, double *RE)
{
    int n = c->ss->n;

    for (int mode = 0; mode < n; mode++)
        for (int a = 0; a < c->r; a++) {
            double x = c->R[a + (size_t)mode * (size_t)c->r],
                   v = c->R[a + (size_t)(n + mode) * (size_t)c->r];
            RE[a + (size_t)mode * (size_t)c->r] = x * E[4 * mode] + v * E[4 * mode + 1];
            RE[a + (size_t)(n + mode) * (size_t)c->r] = x * E[4 * mode + 2] + v * E[4 * mode + 3];
        }
}

/* Room for (1) at the end and for (2) at every node. */
static enum modal_status allocate(const struct collocation *c, struct collocation_map *map,
                                  struct modal_error *err)
{
    size_t N = (size_t)c->N, m = (size_t)c->m, r = (size_t)c->r, nw = (size_t)c->nw;

    if (map->E != NULL)
        return MODAL_OK;
    map->E = workspace_zeros(&map->space, c->ss->modal ? 2 * N : N * N, sizeof *map->E);
    map->G = workspace_zeros(&map->space, N * nw, sizeof *map->G);
    map->W = workspace_zeros(&map->space, N * m * S, sizeof *map->W);
    map->RE = workspace_zeros(&map->space, S * r * N, sizeof *map->RE);
    map->RG = workspace_zeros(&map->space, S * r * nw, sizeof *map->RG);
    map->H = workspace_zeros(&map->space, S * S * r * m, sizeof *map->H);
    if (map->space.failed)
        map_done(map);
    return map->E != NULL ? MODAL_OK
                          : modal_fail(err, MODAL_NO_MEMORY, "collocation: out of memory");
}

/* (1) and (2) of one h.  Only the last node's E, W, G are kept whole; the others' are read
 * through R at once. */
static enum modal_status compute(struct collocation *c, double h, struct collocation_map *map,
                                 struct modal_error *err)
{
    int N = c->N, m = c->m, r = c->r, nw = c->nw;
    enum modal_status rc = allocate(c, map, err);  /* a map half made is freed by map_done */

    for (int i = 0; i < S && rc == MODAL_OK; i++) {
        bool last = i == S - 1;  /* the end: its E, W, G are kept */
        double *E = last ? map->E : c->full, *W = last ? map->W : c->block,
               *G = last ? map->G : c->block + (size_t)N * (size_t)(m * S);
        double *RE = map->RE + (size_t)i * (size_t)r * (size_t)N,
               *H = map->H + (size_t)i * S * (size_t)r * (size_t)m;
        rc = c->ss->modal ? node_modal(c, h, i, E, W, G, err) : node_dense(c, h, i, E, W, G, err);
        if (rc != MODAL_OK)
            break;
        if (c->ss->modal)
            rows_times_blocks(c, E, RE);
        else
            cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, r, N, N, 1, c->R, r, E, N, 0, RE,
                        r);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, r, m * S, N, 1, c->R, r, W, N, 0, H,
                    r);
        if (nw > 0)
            cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, r, nw, N, 1, c->R, r, G, N, 0,
                        map->RG + (size_t)i * (size_t)r * (size_t)nw, r);
    }
    map->h = h;
    c->made++;  /* what a step costs, for the reader of `maps` */
    return rc;
}

enum modal_status collocation_map(struct collocation *c, double h,
                                  const struct collocation_map **out, struct modal_error *err)
{
    int oldest = 0;  /* least recently used */
    enum modal_status rc;

    for (int i = 0; i < MAPS_KEPT; i++) {
        if (c->used[i] > 0 && c->kept[i].h == h) {
            c->used[i] = ++c->clock;
            *out = &c->kept[i];
            return MODAL_OK;
        }
        if (c->used[i] < c->used[oldest])
            oldest = i;
    }
    c->used[oldest] = 0;
    rc = compute(c, h, &c->kept[oldest], err);
    if (rc != MODAL_OK)
        return rc;
    c->used[oldest] = ++c->clock;
    *out = &c->kept[oldest];
    return MODAL_OK;
}

void collocation_finish(const struct collocation *c, const struct collocation_map *map,
                        const double *w, const double *phi, double *y)
{
    int N = c->N, n = c->ss->n;

    if (c->ss->modal) {
        for (int i = 0; i < n; i++) {
            const double *E = map->E + 4 * (size_t)i;
            double a = E[0] * y[i] + E[2] * y[n + i], b = E[1] * y[i] + E[3] * y[n + i];
            y[i] = a;
            y[n + i] = b;
        }
    } else {
        cblas_dcopy(N, y, 1, c->full, 1);
        cblas_dgemv(CblasColMajor, CblasNoTrans, N, N, 1, map->E, N, c->full, 1, 0, y, 1);
    }
    if (c->nw > 0)
        cblas_dgemv(CblasColMajor, CblasNoTrans, N, c->nw, 1, map->G, N, w, 1, 1, y, 1);
    if (c->m > 0)
        cblas_dgemv(CblasColMajor, CblasNoTrans, N, c->m * S, 1, map->W, N, phi, 1, 1, y, 1);
}
