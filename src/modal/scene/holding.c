/*
 * holding.c - see holding.h
 *
 * With y' = A y + B P w + U phi, the rates R_C y of the stuck sliders C stay 0 where
 *
 *     R_C U_C phi_C = -R_C (A y + B P w + U_S phi_S),                                           (1)
 *
 * S all other channels.  The rows R A, R B P and R U of all rigid sliders are made once.
 */
#include "modal/scene/holding.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include "modal/scene/stepper.h"

struct holding {
    const struct ports *ports;  /* borrowed */
    int count, N, nw;              /* rigid sliders, states, sources */
    int *law;  /* rows of ports->law */
    double *RA, *RB, *RU;          /* N, nw and channels numbers a slider */
    double *G, *phi;               /* count x count, count */
    int *pivot;  /* of G */
    struct workspace space;        /* of the arrays */
};

void holding_free(struct holding *h)
{
    if (h == NULL)
        return;
    workspace_free(&h->space);
    free(h);
}

/* What the channels' forces do to the sliders' own rates, once for all steps. */
static void fill(struct holding *h, const double *BP)
{
    const struct ports *p = h->ports;
    int N = h->N, r = 2 * p->probes;

    for (int i = 0; i < h->count; i++) {
        /* the row of the slider's rate */
        const double *R = p->R + p->probes + p->law[h->law[i]].channel;

        cblas_dgemv(CblasColMajor, CblasTrans, N, N, 1, p->ss->A, N, R, r, 0,
                    h->RA + (size_t)i * (size_t)N, 1);
        if (h->nw > 0)
            cblas_dgemv(CblasColMajor, CblasTrans, N, h->nw, 1, BP, N, R, r, 0,
                        h->RB + (size_t)i * (size_t)h->nw, 1);
        cblas_dgemv(CblasColMajor, CblasTrans, N, p->channels, 1, p->U, N, R, r, 0,
                    h->RU + (size_t)i * (size_t)p->channels, 1);
    }
}

enum modal_status holding_new(const struct ports *ports, const struct sources *src,
                              struct holding **out, struct modal_error *err)
{
    struct holding *h = calloc(1, sizeof *h);
    double *BP;
    size_t most;
    enum modal_status rc;

    if (h == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "holding: out of memory");
    h->ports = ports;
    h->N = ports->ss->N;
    h->nw = src->nw;
    BP = stepper_source_matrix(ports->ss, src, &h->space);
    h->law = workspace_zeros(&h->space, (size_t)ports->laws, sizeof *h->law);
    for (int l = 0; h->law != NULL && l < ports->laws; l++)
        if (ports->law[l].law->kind->set_valued)
            h->law[h->count++] = l;  /* rigid sliders alone */
    most = (size_t)h->count;
    h->RA = workspace_zeros(&h->space, most * (size_t)h->N, sizeof *h->RA);
    h->RB = workspace_zeros(&h->space, most * (size_t)h->nw, sizeof *h->RB);
    h->RU = workspace_zeros(&h->space, most * (size_t)ports->channels, sizeof *h->RU);
    h->G = workspace_zeros(&h->space, most * most, sizeof *h->G);
    h->phi = workspace_zeros(&h->space, most, sizeof *h->phi);
    h->pivot = workspace_zeros(&h->space, most, sizeof *h->pivot);
    rc = workspace_check(&h->space, "holding: out of memory", err);
    if (rc == MODAL_OK) {
        fill(h, BP);
        *out = h;
    } else
        holding_free(h);
    return rc;
}

/* The right side of (1) for slider I. */
static double driven(const struct holding *h, int i, const double *y, const double *w,
                     const double *force)
{
    const struct ports *p = h->ports;
    const double *RU = h->RU + (size_t)i * (size_t)p->channels;
    double sum = cblas_ddot(h->N, h->RA + (size_t)i * (size_t)h->N, 1, y, 1)
                 + cblas_ddot(h->nw, h->RB + (size_t)i * (size_t)h->nw, 1, w, 1);

    sum += cblas_ddot(p->channels, RU, 1, force, 1);  /* all channels, then less the stuck ones */
    for (int k = 0; k < h->count; k++)
        if (p->law[h->law[k]].held == 0)
            sum -= RU[p->law[h->law[k]].channel] * force[p->law[h->law[k]].channel];
    return -sum;  /* right side of (1) */
}

bool holding_forces(struct holding *h, const double *y, const double *w, double *force)
{
    const struct ports *p = h->ports;
    int stuck = 0;

    for (int i = 0; i < h->count; i++)
        stuck += p->law[h->law[i]].held == 0;
    for (int i = 0, row = 0; i < h->count; i++) {
        if (p->law[h->law[i]].held != 0)
            continue;
        for (int k = 0, column = 0; k < h->count; k++)
            if (p->law[h->law[k]].held == 0)
                h->G[row + stuck * column++] =
                    h->RU[(size_t)i * (size_t)p->channels + (size_t)p->law[h->law[k]].channel];
        h->phi[row++] = driven(h, i, y, w, force);  /* its unknown's place */
    }
    if (stuck > 0
        && LAPACKE_dgesv_work(LAPACK_COL_MAJOR, stuck, 1, h->G, stuck, h->pivot, h->phi, stuck)
               != 0)
        return false;
    for (int i = 0, row = 0; i < h->count; i++)
        if (p->law[h->law[i]].held == 0)
            force[p->law[h->law[i]].channel] = h->phi[row++];
    return true;
}

void holding_within_limits(struct holding *h, const double *y, const double *w, double *force)
{
    const struct ports *p = h->ports;

    if (!holding_forces(h, y, w, force))
        return;
    for (int i = 0; i < h->count; i++)
        if (p->law[h->law[i]].held == 0) {
            double *held = &force[p->law[h->law[i]].channel], limit = p->law[h->law[i]].law->limit;
            *held = fmin(fmax(*held, -limit), limit);
        }
}
