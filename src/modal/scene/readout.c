/*
 * readout.c - see readout.h
 *
 * The rows are put together once over the vector e = (y, q''), so that one product R e reads all
 * channels; terms that turn with cos or sin of frame_speed t have their own matrix.  q'' is formed
 * only where a channel reads accelerations.
 */
#include "modal/scene/readout.h"
#include <cblas.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"

struct readout {
    const struct statespace *ss;  /* borrowed */
    int channels, width;             /* width N + n */
    /* channels x width by columns: plain, times cos, times sin; NULL: none */
    double *R[3];
    bool accelerations;  /* any row reads q'' */
    double *e, *A;                   /* (y, q''); A(t), where it pulsates and is needed */
    struct workspace space;          /* of the arrays */
};

/* Output term of quantity q (0 x, 1 x', 2 x'', 3 z) into its row. */
static void add_term(struct readout *r, int row, int quantity, const struct triplet *term,
                     double *R)
{
    const struct statespace *ss = r->ss;
    static const int start[] = { 0, 1, 2 };
    int n = ss->n;

    if (quantity == 3) {
        R[row + (size_t)(2 * n + term->j) * (size_t)r->channels] += term->value;
        return;
    }
    for (int j = 0; j < n; j++) {
        int column = quantity == 2 ? ss->N + j : start[quantity] * n + j;
        double phi = ss->phi[term->j + (size_t)j * (size_t)n];  /* x = Phi q, q = y_1 / s */
        R[row + (size_t)column * (size_t)r->channels] +=
            term->value * phi / (quantity == 0 ? ss->s[j] : 1);
    }
}

/* Terms of all outputs into R, a matrix for each way of turning that occurs. */
static enum modal_status fill(struct readout *r, struct modal_error *err)
{
    const struct program *p = r->ss->p;

    for (int row = 0; row < p->outputs; row++)
        for (int k = 0; k < p->output[row].count; k++) {
            const struct triplet *term = &p->output[row].terms[k];
            int turn = term->i / 4, quantity = term->i % 4;  /* program_output.terms */
            if (r->R[turn] == NULL)
                r->R[turn] = workspace_zeros(&r->space, (size_t)r->channels * (size_t)r->width,
                                             sizeof *r->R[turn]);
            if (r->R[turn] == NULL)
                return modal_fail(err, MODAL_NO_MEMORY, "readout: out of memory");
            add_term(r, row, quantity, term, r->R[turn]);
            r->accelerations = r->accelerations || quantity == 2;
        }
    return MODAL_OK;
}

enum modal_status readout_new(const struct statespace *ss, struct readout **out,
                              struct modal_error *err)
{
    struct readout *r = calloc(1, sizeof *r);
    enum modal_status rc;

    if (r == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "readout: out of memory");
    r->ss = ss;
    r->channels = ss->p->outputs;
    r->width = ss->N + ss->n;
    r->e = workspace_zeros(&r->space, (size_t)r->width, sizeof *r->e);
    if (ss->harmonics > 0)
        r->A = workspace_zeros(&r->space, (size_t)ss->N * (size_t)ss->N, sizeof *r->A);
    rc = workspace_check(&r->space, "readout: out of memory", err);
    if (rc == MODAL_OK)
        rc = fill(r, err);
    if (rc == MODAL_OK)
        *out = r;
    else
        readout_free(r);
    return rc;
}

void readout_free(struct readout *r)
{
    if (r == NULL)
        return;
    workspace_free(&r->space);
    free(r);
}

void readout_at(struct readout *r, double t, const double *y, const double *F, double *out)
{
    const struct statespace *ss = r->ss;
    int n = ss->n, N = ss->N;
    double turn = ss->p->frame_speed * t, factor[3] = { 1, cos(turn), sin(turn) };

    memcpy(r->e, y, (size_t)N * sizeof *y);
    if (r->accelerations) {
        const double *A = ss->A;  /* constant, unless it pulsates */
        if (ss->harmonics > 0) {
            statespace_at(ss, t, r->A);
            A = r->A;
        }
        for (int i = 0; i < n; i++)
            r->e[N + i] = F != NULL ? F[n + i] : 0;  /* q'' = A y + F, rows n .. 2 n - 1 */
        cblas_dgemv(CblasColMajor, CblasNoTrans, n, N, 1, A + n, N, y, 1, 1, r->e + N, 1);
    }
    memset(out, 0, (size_t)r->channels * sizeof *out);
    for (int i = 0; i < 3; i++)
        if (r->R[i] != NULL)
            cblas_dgemv(CblasColMajor, CblasNoTrans, r->channels, r->accelerations ? r->width : N,
                        factor[i], r->R[i], r->channels, r->e, 1, 1, out, 1);
}
