/*
 * magnus.c - see magnus.h
 *
 * Over a step h from t, with A_1, A_2, A_3 at the Gauss points t + h (1/2 - sqrt(15)/10, 1/2, 1/2 +
 * sqrt(15)/10),
 *
 *     a1 = h A_2,  a2 = sqrt(15)/3 h (A_3 - A_1),  a3 = 10/3 h (A_3 - 2 A_2 + A_1),             (1)
 *     C1 = [a1, a2],  C2 = -[a1, 2 a3 + C1] / 60,
 *     Omega = a1 + a3 / 12 + [-20 a1 - a3 + C1, a2 + C2] / 240,
 *     y(t + h) = exp(Omega) y(t) + O(h^7)                                                       (2)
 *
 * [BCOR] Blanes, Casas, Oteo and Ros, Phys. Rep. 470 (2009) 151-238, the sixth-order method in
 * three commutators.  The step is symmetric in time, so the error of a product of m of them is a
 * series in even powers of h from h^6 on: from m and 2 m substeps, (64 Phi_2m - Phi_m) / 63 is of
 * order 8.  (The order is shown by halving steps in the tests.) Where A is constant (1) gives
 * exp(hA): a periodic part that is small beside a stiff constant one costs few substeps.
 */
#include "modal/scene/magnus.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/expm.h"
#include "modal/linalg/workspace.h"

enum {
    ORDER_SIX = 64,              /* 2^6: by what two maps differ more than the finer is off */
    EXTRAPOLATED = 1000,         /* 2^10: the difference over what order 8 leaves, cautiously */
};
static const double FLOOR = 1e-11;             /* relative: where rounding ends the convergence */
static const double SUBSTEP_ROUNDING = 1e-16;  /* each product adds half a unit in the last place */

struct magnus_work {
    double *BP, *S;              /* borrowed shapes: N x nw (owned), nw x nw (of the sources) */
    int nw;
    struct expm *exponential;
    /* as the opening calls them */
    double *A[3], *C1, *C2, *X, *Y, *Omega, *E, *coarse, *product, *small;
    struct workspace space;      /* of these and BP */
};

enum modal_status magnus_new(const struct statespace *ss, const struct sources *src,
                             struct magnus **out, struct modal_error *err)
{
    struct magnus *m = calloc(1, sizeof *m);
    struct magnus_work *w = m != NULL ? m->work = calloc(1, sizeof *w) : NULL;
    enum modal_status rc =
        w != NULL ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "magnus: out of memory");

    if (rc == MODAL_OK) {
        size_t N = (size_t)ss->N, size;
        double **all[] = { &w->A[0], &w->A[1],  &w->A[2], &w->C1,     &w->C2,     &w->X,
                           &w->Y,    &w->Omega, &w->E,    &w->coarse, &w->product };
        m->ss = ss;
        w->nw = src != NULL ? src->nw : 0;
        w->S = src != NULL ? src->S : NULL;
        m->size = ss->N + w->nw;
        size = (size_t)m->size;
        for (size_t i = 0; i < sizeof all / sizeof *all; i++)
            *all[i] = workspace_zeros(&w->space, size * size, sizeof **all[i]);
        w->small = workspace_zeros(&w->space, N * N, sizeof *w->small);
        w->BP = workspace_zeros(&w->space, N * (size_t)w->nw, sizeof *w->BP);
        rc = workspace_check(&w->space, "magnus: out of memory", err);
        if (rc == MODAL_OK && w->nw > 0)
            cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, ss->N, w->nw, ss->n, 1, ss->B,
                        ss->N, src->P, ss->n, 0, w->BP, ss->N);
        if (rc == MODAL_OK)
            rc = expm_new(m->size, &w->exponential, err);
    }
    if (rc == MODAL_OK)
        *out = m;
    else
        magnus_free(m);
    return rc;
}

void magnus_free(struct magnus *m)
{
    struct magnus_work *w = m != NULL ? m->work : NULL;

    if (w != NULL) {
        workspace_free(&w->space);
        expm_free(w->exponential);
        free(w);
    }
    free(m);
}

/* A(t), with [A BP; 0 S] around it where there are sources. */
static void evaluate(struct magnus *m, double t, double *out)
{
    struct magnus_work *w = m->work;
    size_t N = (size_t)m->ss->N, nw = (size_t)w->nw, size = (size_t)m->size;

    if (nw == 0) {
        statespace_at(m->ss, t, out);
        return;
    }
    statespace_at(m->ss, t, w->small);
    for (size_t j = 0; j < N; j++)
        memcpy(out + j * size, w->small + j * N, N * sizeof *out);
    for (size_t j = 0; j < nw; j++) {
        memcpy(out + (N + j) * size, w->BP + j * N, N * sizeof *out);
        memcpy(out + (N + j) * size + N, w->S + j * nw, nw * sizeof *out);
    }
}

/* C = factor [A, B] */
static void commutator(int n, double factor, const double *A, const double *B, double *C)
{
    square_multiply(n, factor, A, B, 0, C);
    square_multiply(n, -factor, B, A, 1, C);
}

/* (2) */
static void series(struct magnus *m, double t, double h)
{
    struct magnus_work *w = m->work;
    size_t count = (size_t)m->size * (size_t)m->size;
    double r = sqrt(15.0);  /* of the Gauss points */

    for (int i = 0; i < 3; i++)
        evaluate(m, t + h * (0.5 + (i - 1) * r / 10), w->A[i]);  /* A_1, A_2, A_3 of the opening */
    for (size_t i = 0; i < count; i++) {
        double a = w->A[0][i], b = w->A[1][i], c = w->A[2][i];
        w->A[0][i] = h * b;                                  /* a1 */
        w->A[1][i] = r / 3 * h * (c - a);                    /* a2 */
        w->A[2][i] = 10.0 / 3 * h * (c - 2 * b + a);         /* a3 */
    }
    commutator(m->size, 1, w->A[0], w->A[1], w->C1);
    for (size_t i = 0; i < count; i++)
        w->X[i] = 2 * w->A[2][i] + w->C1[i];  /* 2 a3 + C1 */
    commutator(m->size, -1.0 / 60, w->A[0], w->X, w->C2);  /* C2 */
    for (size_t i = 0; i < count; i++) {
        w->X[i] = -20 * w->A[0][i] - w->A[2][i] + w->C1[i];  /* left of (2)'s last commutator */
        w->Y[i] = w->A[1][i] + w->C2[i];  /* and its right */
    }
    commutator(m->size, 1.0 / 240, w->X, w->Y, w->Omega);
    for (size_t i = 0; i < count; i++)
        w->Omega[i] += w->A[0][i] + w->A[2][i] / 12;  /* (2) */
}

/* The largest magnitude: the norm in which maps are compared. */
static double largest(const double *x, size_t count)
{
    double most = 0;

    for (size_t i = 0; i < count; i++)
        if (!(fabs(x[i]) <= most))  /* so that a NaN is the largest */
            most = fabs(x[i]);
    return most;
}

enum modal_status magnus_map(struct magnus *m, double t, double h, int substeps, double *out,
                             struct modal_error *err)
{
    struct magnus_work *w = m->work;
    size_t bytes = (size_t)m->size * (size_t)m->size * sizeof *out;
    double step = h / substeps;

    for (int k = 0; k < substeps; k++) {
        series(m, t + k * step, step);
        /* exp(Omega), sources' rows below */
        enum modal_status rc = expm_driven(w->exponential, m->ss->N, w->Omega, w->E, err);
        if (rc != MODAL_OK)
            return rc;
        if (k == 0)
            memcpy(out, w->E, bytes);
        else {
            square_multiply(m->size, 1, w->E, out, 0, w->product);  /* later steps from the left */
            memcpy(out, w->product, bytes);
        }
    }
    if (!isfinite(largest(out, (size_t)m->size * (size_t)m->size)))
        return modal_fail(err, MODAL_OVERFLOW, "the map over %g s leaves the range of doubles", h);
    return MODAL_OK;
}

/* The map with K substeps; where the series of a long step has run away, with 2 K, 4 K, ...
 * until steps are short beside A. */
static enum modal_status first_map(struct magnus *m, double t, double h, int *k, double *out,
                                   struct modal_error *err)
{
    enum modal_status rc;

    while ((rc = magnus_map(m, t, h, *k, out, err)) == MODAL_OVERFLOW
           && *k < MAGNUS_SUBSTEPS_MOST) {
        statespace_at(m->ss, t, m->work->small);
        if (h / *k * largest(m->work->small, (size_t)m->ss->N * (size_t)m->ss->N) < 0.5)
            break;
        *k *= 2;
    }
    return rc;
}

/* The largest change from COARSE to FINE beside the largest entry; of the columns of A and of
 * the loads apart, whose units differ. */
static double relative_change(const struct magnus *m, const double *fine, const double *coarse)
{
    size_t size = (size_t)m->size, split = (size_t)m->ss->N * size,
           part[3] = { 0, split, size * size };
    double worst = 0;

    for (int k = 0; k < 2; k++) {
        double change = 0, norm = largest(fine + part[k], part[k + 1] - part[k]);

        for (size_t i = part[k]; i < part[k + 1]; i++)
            change = fmax(change, fabs(fine[i] - coarse[i]));
        worst = fmax(worst, change / (norm > 0 ? norm : 1));  /* of its own unit */
    }
    return worst;
}

enum modal_status magnus_converge(struct magnus *m, double t, double h, double tolerance,
                                  int *substeps, double *out, double *error,
                                  struct modal_error *err)
{
    struct magnus_work *w = m->work;
    size_t count = (size_t)m->size * (size_t)m->size;
    int k = *substeps > 1 ? *substeps : 1;
    double before = HUGE_VAL;
    enum modal_status rc = first_map(m, t, h, &k, w->coarse, err);

    while (rc == MODAL_OK) {
        double difference;
        int fine = 2 * k;  /* twice the substeps: the even error series */
        bool settled;

        if (fine > MAGNUS_SUBSTEPS_MOST)
            return modal_fail(
                err, MODAL_NO_CONVERGENCE,
                "the map over %g s has not settled after %d substeps (relative change %g)", h, k,
                before);
        if ((rc = first_map(m, t, h, &fine, out, err)) != MODAL_OK)
            break;
        /* else they are not of one series */
        difference = fine == 2 * k ? relative_change(m, out, w->coarse) : HUGE_VAL;
        k = fine;
        /* rounding's floor */
        settled =
            difference <= ORDER_SIX * tolerance || (difference < FLOOR && difference > before / 4);
        if (settled) {
            for (size_t i = 0; i < count; i++)
                /* order 8, as the opening has it */
                out[i] += (out[i] - w->coarse[i]) / (ORDER_SIX - 1);
            *substeps = k;
            *error = fmax(difference / EXTRAPOLATED, SUBSTEP_ROUNDING * k);
            return MODAL_OK;
        }
        before = difference;
        memcpy(w->coarse, out, count * sizeof *out);
    }
    return rc;
}
