/*
 * linear_stepper.c - exact steps of y' = A y + B P w, w' = S w
 *
 *     y(t + h) = E y(t) + G w(t),   [E G; 0 *] = exp(h [A BP; 0 S])                             (1)
 *
 * is exact for every excitation of sources.h.  Where A falls into 2 x 2 blocks so do E and G: E_i
 * in closed form, whose determinant e^(h tr A_i) is exact to rounding (energy is kept over any
 * number of steps), and G_i block by block of S. The maps of the last few h are kept: the sample
 * step's is computed once, those to and from corners as they come.
 */
#include <cblas.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/expm.h"
#include "modal/scene/stepper.h"

enum { MAPS_KEPT = 4 };   /* the sample step's, to a corner and from it, and one more */

struct map {
    double h;  /* s */
    int64_t used;                 /* when last; 0: empty */
    /* modal: 4 per mode and 2 x nw per mode; dense: N x N and N x nw */
    double *E, *G;
};

struct linear_stepper {
    struct stepper face;  /* first: a stepper is cast to its own */
    const struct statespace *ss;  /* borrowed */
    const struct sources *src;  /* borrowed */
    double *BP, *w, *next;  /* B P; sources now; y of the next step */
    struct map kept[MAPS_KEPT];
    int64_t clock;  /* counts uses: `used` of the kept */
    struct expm *exponential;     /* dense: N + nw */
    double *augmented, *result;  /* (1), size N + nw */
    struct workspace space;       /* of these arrays and the maps' */
};

/* G of mode I for one block of S, by the exponential of the small augmented matrix of (1). */
static enum modal_status modal_forcing(struct linear_stepper *s, struct expm *w, int i,
                                       const struct source_block *b, double h, double *G,
                                       struct modal_error *err)
{
    double X[64] = { 0 }, Y[64] = { 0 };  /* (2 + SOURCES_BLOCK_MOST)^2 */
    int n = s->ss->n, N = s->ss->N, size = 2 + b->count, nw = s->src->nw;
    enum modal_status rc;

    for (int c = 0; c < 2; c++)
        for (int r = 0; r < 2; r++)
            X[r + c * size] = h * s->ss->A[(size_t)(i + r * n) + (size_t)(i + c * n) * (size_t)N];
    for (int k = 0; k < b->count; k++) {
        for (int r = 0; r < 2; r++)
            X[r + (2 + k) * size] =
                h * s->BP[(size_t)(i + r * n) + (size_t)(b->first + k) * (size_t)N];
        for (int r = 0; r < b->count; r++)
            X[2 + r + (2 + k) * size] =
                h * s->src->S[(size_t)(b->first + r) + (size_t)(b->first + k) * (size_t)nw];
    }
    rc = expm_driven(w, 2, X, Y, err);  /* the first two rows are driven, the rest is S */
    for (int k = 0; rc == MODAL_OK && k < b->count; k++)
        for (int r = 0; r < 2; r++)
            G[r + 2 * (b->first + k)] = Y[r + (2 + k) * size];
    return rc;
}

/* (1) mode by mode; exponentials of one size share their workspace. */
static enum modal_status modal_map(struct linear_stepper *s, double h, struct map *m,
                                   struct modal_error *err)
{
    int n = s->ss->n, N = s->ss->N;
    /* by the size of a source's block */
    struct expm *two = NULL, *small[SOURCES_BLOCK_MOST + 1] = { NULL };
    enum modal_status rc = expm_new(2, &two, err);

    for (int i = 0; rc == MODAL_OK && i < n; i++) {
        double X[4];
        for (int c = 0; c < 4; c++)
            X[c] = h * s->ss->A[(size_t)(i + c % 2 * n) + (size_t)(i + c / 2 * n) * (size_t)N];
        rc = expm(two, X, m->E + 4 * (size_t)i, err);
        for (int b = 0; rc == MODAL_OK && b < s->src->blocks; b++) {
            int count = s->src->block[b].count;
            if (small[count] == NULL)
                rc = expm_new(2 + count, &small[count], err);
            if (rc == MODAL_OK)
                rc = modal_forcing(s, small[count], i, &s->src->block[b], h,
                                   m->G + 2 * (size_t)i * (size_t)s->src->nw, err);
        }
    }
    expm_free(two);
    for (int k = 0; k <= SOURCES_BLOCK_MOST; k++)
        expm_free(small[k]);
    return rc;
}

/* (1) as it stands, the sources' states below the system's. */
static enum modal_status dense_map(struct linear_stepper *s, double h, struct map *m,
                                   struct modal_error *err)
{
    size_t N = (size_t)s->ss->N, nw = (size_t)s->src->nw, size = N + nw;
    enum modal_status rc;

    memset(s->augmented, 0, size * size * sizeof *s->augmented);
    for (size_t j = 0; j < N; j++)
        for (size_t i = 0; i < N; i++)
            s->augmented[i + j * size] = h * s->ss->A[i + j * N];  /* A of (1) */
    for (size_t j = 0; j < nw; j++) {
        for (size_t i = 0; i < N; i++)
            s->augmented[i + (N + j) * size] = h * s->BP[i + j * N];  /* B P */
        for (size_t i = 0; i < nw; i++)
            s->augmented[N + i + (N + j) * size] = h * s->src->S[i + j * nw]; /* (1), lower right */
    }
    rc = expm_driven(s->exponential, (int)N, s->augmented, s->result, err);
    for (size_t j = 0; rc == MODAL_OK && j < size; j++)
        memcpy(j < N ? m->E + j * N : m->G + (j - N) * N, s->result + j * size,
               N * sizeof *s->result);
    return rc;
}

/* The map of h, computed where none of those kept is its. */
static enum modal_status find_map(struct linear_stepper *s, double h, struct map **out,
                                  struct modal_error *err)
{
    struct map *oldest = &s->kept[0];
    size_t N = (size_t)s->ss->N, nw = (size_t)s->src->nw;
    enum modal_status rc;

    for (int i = 0; i < MAPS_KEPT; i++) {
        if (s->kept[i].used > 0 && s->kept[i].h == h) {
            *out = &s->kept[i];
            return MODAL_OK;
        }
        if (s->kept[i].used < oldest->used)  /* least recently used */
            oldest = &s->kept[i];
    }
    if (oldest->E == NULL)
        oldest->E = workspace_zeros(&s->space, s->ss->modal ? 2 * N : N * N, sizeof *oldest->E);
    if (oldest->G == NULL)
        oldest->G = workspace_zeros(&s->space, N * nw, sizeof *oldest->G);
    oldest->used = 0;  /* not to be found if what follows fails */
    if (oldest->E == NULL || oldest->G == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "stepping: out of memory");
    rc = s->ss->modal ? modal_map(s, h, oldest, err) : dense_map(s, h, oldest, err);
    if (rc != MODAL_OK)
        return rc;
    oldest->h = h;
    oldest->used = 1;
    s->face.maps++;
    *out = oldest;
    return MODAL_OK;
}

/* y(t + h) of each mode, in place. */
static void apply_modal(const struct linear_stepper *s, const struct map *m, double *y)
{
    int n = s->ss->n, nw = s->src->nw;

    for (int i = 0; i < n; i++) {
        const double *E = m->E + 4 * (size_t)i, *G = m->G + 2 * (size_t)i * (size_t)nw;
        /* y_1 of the mode, b its y_2 */
        double a = E[0] * y[i] + E[2] * y[n + i], b = E[1] * y[i] + E[3] * y[n + i];
        for (int k = 0; k < nw; k++) {
            a += G[2 * k] * s->w[k];
            b += G[2 * k + 1] * s->w[k];
        }
        y[i] = a;
        y[n + i] = b;
    }
}

/* One product by the map of h. */
static enum modal_status advance(struct stepper *face, double t, double h, double *y,
                                 struct modal_error *err)
{
    struct linear_stepper *s = (struct linear_stepper *)face;
    int N = s->ss->N, nw = s->src->nw;
    struct map *m = NULL;
    enum modal_status rc = find_map(s, h, &m, err);

    if (rc != MODAL_OK)
        return rc;
    m->used = ++s->clock;
    sources_at(s->src, t, s->w);
    face->products++;
    if (s->ss->modal) {
        apply_modal(s, m, y);
        return MODAL_OK;
    }
    cblas_dgemv(CblasColMajor, CblasNoTrans, N, N, 1, m->E, N, y, 1, 0, s->next, 1);
    if (nw > 0)
        cblas_dgemv(CblasColMajor, CblasNoTrans, N, nw, 1, m->G, N, s->w, 1, 1, s->next, 1);
    memcpy(y, s->next, (size_t)N * sizeof *y);
    return MODAL_OK;
}

/* A linear program's loads alone. */
static enum modal_status force(struct stepper *face, double t, const double *y, double *F,
                               struct modal_error *err)
{
    struct linear_stepper *s = (struct linear_stepper *)face;

    (void)y;
    (void)err;
    memset(F, 0, (size_t)s->ss->N * sizeof *F);
    stepper_add_loads(s->src, s->BP, s->ss->N, t, s->w, F);
    return MODAL_OK;
}

/* stepper.free; also of one half made. */
static void linear_free(struct stepper *face)
{
    struct linear_stepper *s = (struct linear_stepper *)face;

    expm_free(s->exponential);
    workspace_free(&s->space);
    free(s);
}

double *stepper_source_matrix(const struct statespace *ss, const struct sources *src,
                              struct workspace *space)
{
    double *BP = workspace_zeros(space, (size_t)ss->N * (size_t)src->nw, sizeof *BP);

    if (BP != NULL && src->nw > 0)
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, ss->N, src->nw, ss->n, 1, ss->B,
                    ss->N, src->P, ss->n, 0, BP, ss->N);
    return BP;
}

void stepper_add_loads(const struct sources *src, const double *BP, int N, double t, double *w,
                       double *F)
{
    sources_at(src, t, w);
    if (src->nw > 0)
        cblas_dgemv(CblasColMajor, CblasNoTrans, N, src->nw, 1, BP, N, w, 1, 1, F, 1);
}

enum modal_status linear_stepper_new(const struct statespace *ss, const struct sources *src,
                                     const struct stepper_options *opt, struct stepper **out,
                                     struct modal_error *err)
{
    struct linear_stepper *s = calloc(1, sizeof *s);
    size_t size = (size_t)ss->N + (size_t)src->nw;
    enum modal_status rc = MODAL_OK;

    (void)opt;
    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "stepping: out of memory");
    s->face = (struct stepper){ .name = ss->modal ? "modal-exponential" : "dense-exponential",
                                .advance = advance,
                                .force = force,
                                .free = linear_free };
    s->ss = ss;
    s->src = src;
    s->BP = stepper_source_matrix(ss, src, &s->space);
    s->w = workspace_zeros(&s->space, (size_t)src->nw, sizeof *s->w);
    s->next = workspace_zeros(&s->space, (size_t)ss->N, sizeof *s->next);
    if (!ss->modal) {
        s->augmented = workspace_zeros(&s->space, size * size, sizeof *s->augmented);
        s->result = workspace_zeros(&s->space, size * size, sizeof *s->result);
        rc = expm_new((int)size, &s->exponential, err);
    }
    if (rc == MODAL_OK)
        rc = workspace_check(&s->space, "stepping: out of memory", err);
    if (rc == MODAL_OK)
        *out = &s->face;
    else
        linear_free(&s->face);
    return rc;
}
