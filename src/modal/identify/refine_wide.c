/* refine_wide.c - one Gauss-Newton step over all channels of a wide batch; see wide.h */
#include "modal/identify/fit/refine_state.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/prepare/wide.h"

/* Of all channels, where samples must be read in order: Q^T A, and what is left of them by the
 * samples themselves, or NULL. */
struct in_order { double *Z, *rest2; };

static void in_order_done(struct in_order *all)
{
    free(all->Z), free(all->rest2);
}

/* Energy less what the poles explain of it; false where they cancel. */
static bool rest_by_energies(const struct work *w, const struct wide *d, int channel,
                             const double *z, double *rest2)
{
    double rms = wide_rms(d, channel), energy = w->L * rms * rms;
    double sum = cblas_ddot(w->order, z, 1, z, 1);

    /* what is left by difference has half of the channel's digits */
    *rest2 = energy - sum;          /* Pythagoras: Z are products with an orthonormal basis */
    return *rest2 > REFINE_HALVED * energy;
}

/* One pass, and another where energies cancel. */
static enum modal_status read_in_order(const struct work *w, const struct wide *d,
                                       struct in_order *all, struct modal_error *err)
{
    size_t k = (size_t)w->most_columns, S = (size_t)d->S;
    bool plain = true;
    double unused;

    all->Z = malloc(sizeof *all->Z * k * S);
    if (all->Z == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "refine: no memory for order %d of %d channels",
                          w->order, d->S);
    wide_project(d, w->basis, w->most_columns, all->Z);
    for (size_t c = 0; c < S; c++)
        plain &= d->scale[c] == 0 || rest_by_energies(w, d, (int)c, all->Z + c * k, &unused);
    if (plain)
        return MODAL_OK;
    all->rest2 = malloc(sizeof *all->rest2 * S);
    if (all->rest2 == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "refine: no memory for %d channels", d->S);
    return wide_rests(d, w->basis, w->order, all->Z, w->most_columns, all->rest2, err);
}

/* What is left of channel c of a panel: by energies, and by the samples themselves where those
 * cancel. */
static double wide_rest(const struct work *w, const struct wide *d, const struct in_order *all,
                        int c0, int c)
{
    int k = w->most_columns, q = w->order, L = w->L;
    double sum;

    if (rest_by_energies(w, d, c0 + c, w->Z + c * k, &sum))
        return sum;
    if (all->rest2 != NULL)
        return all->rest2[c0 + c];
    cblas_dcopy(L, d->x + c0 + c, (int)d->stride, w->rest, 1);
    cblas_dgemv(CblasColMajor, CblasNoTrans, L, q, -1, w->basis, L, w->Z + c * k, 1, 1, w->rest, 1);
    sum = cblas_dnrm2(L, w->rest, 1);
    return sum * sum;
}

/* Panel c0 .. c0+n-1: residuals, weights from them, coefficients, rows of (4). */
static enum modal_status wide_panel(struct work *w, const struct wide *d,
                                    const struct in_order *all, int c0, int n, struct evaluation *e,
                                    struct wide_step *out, struct modal_error *err)
{
    int q = w->order, k = w->most_columns, P = w->parameters + 1, live = 0;
    /* (6), the fastest phase a step in floor2[0] */
    double floor = (4 + w->floor2[0] * w->L / 4) * DBL_EPSILON;

    if (all->Z != NULL)
        memcpy(w->Z, all->Z + (size_t)c0 * (size_t)k, (size_t)k * (size_t)n * sizeof *w->Z);
    else
        cblas_dgemm(CblasColMajor, CblasTrans, CblasTrans, k, n, w->L, 1, w->basis, w->L, d->x + c0,
                    (int)d->stride, 0, w->Z, k);
    matrix_copy(q, n, w->Z, k, w->C, q);
    /* C = R11^{-1} Q1^T Y */
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, q, n, 1, w->R, k,
                w->C, q);
    for (int c = 0; c < n; c++) {
        double rms = d->scale[c0 + c] > 0 ? wide_rms(d, c0 + c) : 0, least = floor * rms;
        double rss = rms > 0 ? wide_rest(w, d, all, c0, c) : 0;
        /* each channel's own, profiled out: what it leaves in its free rows, and no less than
         * rounding */
        double variance = fmax(rss / fmax(w->L - q, 1), least * least);
        out->rest[c0 + c] = sqrt(rss / w->L);
        for (int j = 0; out->coefficient != NULL && j < w->count; j++)
            out->coefficient[j + (size_t)(c0 + c) * (size_t)w->count] =
                CMPLX(w->C[w->column[j] + c * q],
                      w->kind[j] == POLE_PAIR ? w->C[w->column[j] + 1 + c * q] : 0);
        if (variance <= 0)          /* a zero channel tells nothing */
            continue;
        e->F += rss / variance;     /* (1) with w_c = 1 / sigma_c */
        refine_channel_rows(w, c, 1 / sqrt(variance), P + live++ * (k - q));
    }
    if (w->parameters == 0 || k == q || live == 0)
        return MODAL_OK;
    refine_triangle_to_stack(w, e->T);
    return refine_reduce_stack(w, P + live * (k - q), e->T, err);
}

static enum modal_status wide_evaluate(struct work *w, const struct wide *d, const struct point *at,
                                       struct evaluation *e, struct wide_step *out,
                                       struct modal_error *err)
{
    struct in_order all = { 0 };
    enum modal_status rc;

    e->F = 0;
    refine_fill_basis(w, at);
    rc = refine_factor(w, err);
    if (rc == MODAL_OK && !refine_regular(w))
        return modal_fail(err, MODAL_NO_CONVERGENCE, "refine: the poles coincide");
    if (rc == MODAL_OK && d->by_rows)
        rc = read_in_order(w, d, &all, err);
    for (int c = 0; c < d->S && rc == MODAL_OK; c += w->panel)
        rc = wide_panel(w, d, &all, c, d->S - c < w->panel ? d->S - c : w->panel, e, out, err);
    in_order_done(&all);
    return rc;
}

enum modal_status wide_refine(const struct wide *d, double tau, const double complex *start,
                              int count, const bool *fixed, double most, struct wide_step *out,
                              struct modal_error *err)
{
    /* never joined */
    struct matrix shape = { d->L, JOIN_MOST + 1 < d->S ? d->S : JOIN_MOST + 1, d->L, NULL };
    struct refine_data data = { .Y = &shape, .tau = tau };
    struct work w = { .data = &data,
                      .Y = &shape,
                      .L = d->L,
                      .S = shape.n,
                      .groups = 1,
                      .phases = shape.n,
                      .count = count,
                      .fixed = fixed };
    struct search s = { 0 };
    double *cov = NULL, step = 0;
    int live = 0;
    enum modal_status rc = refine_check(&data, start, count, err);

    if (rc != MODAL_OK)
        return rc;
    if (!refine_layout(&w, start) || !refine_allocate(&w, false) || !refine_search_new(&s, &w)
        || (cov = workspace_numbers(&w.held, (size_t)w.parameters, (size_t)w.parameters)) == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "refine: no memory for order %d of %d channels",
                        w.order, d->S);
        goto out;
    }
    w.S = d->S;  /* the shape had columns enough that Y does not join; residuals are of these */
    for (int j = 0; j < count; j++) {
        s.at.a[j] = creal(start[j]) * tau, s.at.b[j] = cimag(start[j]) * tau;
        w.floor2[0] = fmax(w.floor2[0], fabs(s.at.b[j]));         /* the fastest phase, for (6) */
    }
    rc = wide_evaluate(&w, d, &s.at, &s.now, out, err);
    if (rc != MODAL_OK)
        goto out;
    /* |R_J delta| / s of (5), as g = R_J delta where nothing damps: the step in standard errors
     * of all parameters at once */
    step = cblas_dnrm2(w.parameters, s.now.T + w.parameters * (w.parameters + 1), 1)
        / sqrt(fmax(s.now.F / fmax(refine_freedom(&w), 1), DBL_MIN));
    out->length = step;
    out->taken = step <= most && refine_undamped_step(w.parameters, s.now.T, s.A, s.delta);
    if (out->taken)
        refine_take_step(&w, &s.at, s.delta, &s.trial);
    for (int c = 0; c < d->S; c++)
        live += d->scale[c] > 0;
    refine_covariance(&w, &s.now, live, tau, cov);
    for (int j = 0; j < count; j++) {
        int p = w.first[j], P = w.parameters;
        out->lambda[j] = start[j];
        if (p >= 0 && out->taken)
            out->lambda[j] = CMPLX(s.trial.a[j] / tau,
                                   w.kind[j] == POLE_PAIR ? s.trial.b[j] / tau : cimag(start[j]));
        out->std_re[j] = p < 0 ? 0 : sqrt(cov[p + p * P]);
        out->std_im[j] = p < 0 || w.kind[j] != POLE_PAIR ? 0 : sqrt(cov[p + 1 + (p + 1) * P]);
    }
out:
    refine_free(&w);
    return rc;
}
