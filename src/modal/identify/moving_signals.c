/*
 * moving_signals.c - the signals of one window, from its compressed rows
 *
 * Owned here: `struct job`, the rows of the present window and what is fitted on them.  Many channels are reduced to proper orthogonal modes, the right
 * singular vectors of the window's triangle R times the channels' scales: pod.c's choice, without a pass over the window.
 */
#include "modal/identify/moving_state.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/pod.h"
#include "modal/linalg/svd.h"

void job_done(struct job *j)
{
    free(j->Y.x), free(j->R), free(j->rest), free(j->scale), free(j->weight), free(j->W), free(j->outside2), free(j->X.x), free(j->growth);
    moving_fit_done(&j->first), moving_fit_done(&j->own), moving_fit_done(&j->channels);
}

static void copy_samples(const struct job *j, uint64_t from, int count, int row)
{
    const double *y = moving_sample(j->m, from);

    for (int l = 0; l < count; l++)
        for (int c = 0; c < j->m->S; c++)
            j->Y.x[row + l + (size_t)c * (size_t)j->Y.ld] = y[(size_t)l * (size_t)j->m->S + (size_t)c];
}

/* The window's rows, compressed, and their triangles. */
enum modal_status job_take(struct job *j, struct modal_error *err)
{
    struct moving *m = j->m;
    uint64_t from = m->next - (uint64_t)m->L, last = m->count > 0 ? m->block_from + (uint64_t)m->count * (uint64_t)m->B : m->next;
    int S = m->S, lead = m->count > 0 ? (int)(m->block_from - from) : m->L, trail = (int)(m->next - last), n;
    struct matrix loose = { lead + trail, S, lead + trail, NULL };
    enum modal_status rc;

    j->rows = (struct moving_rows) { lead, m->count, trail, m->B, m->k, m->Q, m->opt.dt };
    n = moving_rows_count(&j->rows);
    j->Y = (struct matrix) { n, S, n, malloc(sizeof(double) * (size_t)n * (size_t)S) };
    j->R = malloc(sizeof(double) * (size_t)S * (size_t)S), j->rest = malloc(sizeof(double) * (size_t)S * (size_t)S);
    j->scale = calloc((size_t)S, sizeof(double)), j->weight = calloc((size_t)S, sizeof(double));
    j->W = malloc(sizeof(double) * (size_t)S * (size_t)S), j->outside2 = malloc(sizeof(double) * (size_t)S);
    j->X = (struct matrix) { n, S, n, malloc(sizeof(double) * (size_t)n * (size_t)S) };
    loose.x = malloc(sizeof(double) * (size_t)(loose.m + 1) * (size_t)S);
    if (j->Y.x == NULL || j->R == NULL || j->rest == NULL || j->scale == NULL || j->weight == NULL || j->W == NULL || j->outside2 == NULL
        || j->X.x == NULL || loose.x == NULL) {
        free(loose.x);
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", n, S);
    }
    copy_samples(j, from, lead, 0);
    copy_samples(j, last, trail, n - trail);
    for (int b = 0; b < m->count; b++)
        for (int c = 0; c < S; c++)
            memcpy(j->Y.x + lead + b * m->k + (size_t)c * (size_t)n, m->blocks[b].C + (size_t)c * (size_t)m->k, sizeof(double) * (size_t)m->k);
    for (int c = 0; c < S; c++) {
        memcpy(loose.x + (size_t)c * (size_t)loose.m, j->Y.x + (size_t)c * (size_t)n, sizeof(double) * (size_t)lead);
        memcpy(loose.x + lead + (size_t)c * (size_t)loose.m, j->Y.x + n - trail + (size_t)c * (size_t)n, sizeof(double) * (size_t)trail);
    }
    rc = window_qr_factor(m->all, &loose, j->R, err);
    if (rc == MODAL_OK)
        rc = window_qr_factor(m->rest, NULL, j->rest, err);
    for (int c = 0; c < S; c++) {
        j->scale[c] = safe_norm(j->R + (size_t)c * (size_t)S, (size_t)c + 1) / sqrt(m->L);
        j->weight[c] = 1;
    }
    free(loose.x);
    return rc;
}

static double channel_factor(const struct job *j, int c)
{
    return j->scale[c] > 0 ? j->weight[c] / j->scale[c] : 0;
}

/* The first value that does not stand out of the rest as (1) of pod.c has it; all above rounding where none. */
static int above_rest(const struct moving *m, const double *s, int most)
{
    double L = m->L, S = m->S, rest = 0;

    for (int i = 0; i < m->S; i++)
        rest += s[i] * s[i];
    for (int k = 0; k < most && k < S; k++) {
        if (s[k] <= 1.02 * sqrt(fmax(rest, 0) / ((L - k) * (S - k))) * (sqrt(L - k) + sqrt(S - k)))
            return k;
        rest -= s[k] * s[k];
    }
    return most;
}

static int signals_kept(const struct job *j, const double *s)
{
    int k = 0;

    while (k < j->m->S && s[k] > j->m->L * DBL_EPSILON * s[0])
        k++;
    if (j->m->rest_white[j->weighed])
        k = above_rest(j->m, s, k);
    return k < 1 ? 1 : k > POD_SIGNALS_MOST ? POD_SIGNALS_MOST : k;
}

/* Proper orthogonal modes from the triangle: pod.c's choice of how many, where it knows all singular values. */
static enum modal_status orthogonal_modes(struct job *j, struct modal_error *err)
{
    int S = j->m->S;
    size_t size = (size_t)S * (size_t)S;
    double *x = malloc(sizeof *x * (3 * size + (size_t)S)), *s = x + 3 * size;
    struct matrix A = { S, S, S, x }, U = { S, S, S, x + size }, VT = { S, S, S, x + 2 * size };
    enum modal_status rc = MODAL_OK;

    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
    for (int c = 0; c < S; c++)
        for (int i = 0; i < S; i++)
            A.x[i + (size_t)c * (size_t)S] = j->R[i + (size_t)c * (size_t)S] * channel_factor(j, c);
    rc = svd_thin(&A, s, &U, &VT, err);
    if (rc == MODAL_OK) {
        j->r = signals_kept(j, s);
        for (int i = 0; i < j->r; i++)
            for (int c = 0; c < S; c++)
                j->W[c + (size_t)i * (size_t)S] = VT.x[i + (size_t)c * (size_t)S] * channel_factor(j, c);
    }
    free(x);
    return rc;
}

/* Channels themselves, to unit rms. */
static void plain_signals(struct job *j)
{
    int S = j->m->S;

    j->r = S;
    memset(j->W, 0, sizeof *j->W * (size_t)S * (size_t)S);
    for (int c = 0; c < S; c++)
        j->W[c + (size_t)c * (size_t)S] = channel_factor(j, c);
}

bool moving_reduced(const struct moving *m)
{
    return m->S > POD_CHANNELS_FEW && !m->opt.identify.signals_all;
}

/* X = Y W, and of what Q does not hold the sums of squares. */
enum modal_status job_signals(struct job *j, bool modes, struct modal_error *err)
{
    int S = j->m->S;
    double *T;
    enum modal_status rc = MODAL_OK;

    if (modes)
        rc = orthogonal_modes(j, err);
    else
        plain_signals(j);
    if (rc != MODAL_OK)
        return rc;
    T = malloc(sizeof *T * (size_t)S * (size_t)j->r);
    if (T == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d signals", j->r);
    j->X.n = j->r;
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, j->Y.m, j->r, S, 1, j->Y.x, j->Y.ld, j->W, S, 0, j->X.x, j->X.ld);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, S, j->r, S, 1, j->rest, S, j->W, S, 0, T, S);
    for (int g = 0; g < j->r; g++)
        j->outside2[g] = cblas_ddot(S, T + (size_t)g * (size_t)S, 1, T + (size_t)g * (size_t)S, 1);
    free(T);
    return MODAL_OK;
}
