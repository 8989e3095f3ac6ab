/*
 * moving_report.c - an update as an identify_result
 *
 * Owned here: which fields an update knows, and that they are those of a batch; modes.c scales,
 * spreads and ranks them, verdict.c and diagnose.c judge.
 */
#include "modal/identify/live/moving_state.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/answer/modes.h"
#include "modal/identify/ask/diagnose.h"
#include "modal/identify/ask/trend.h"
#include "modal/identify/ask/verdict.h"
#include "modal/identify/linear/exponents.h"

/* Of the pole whose columns stand from COLUMN on. */
static double energy_of(const struct job *j, const struct moving_fit *f, int column, int columns)
{
    int n = moving_rows_count(&j->rows), second = columns > 1 ? n : 0;
    const double *x = j->Phi + (size_t)column * (size_t)n;
    double sum = 0, G[3];

    /* Gram matrix of the pole's columns, on compressed rows: Q keeps inner products */
    G[0] = cblas_ddot(n, x, 1, x, 1), G[1] = cblas_ddot(n, x, 1, x + second, 1),
    G[2] = cblas_ddot(n, x + second, 1, x + second, 1);
    for (int c = 0; c < f->signals; c++) {
        const double *b = f->C + column + (size_t)c * (size_t)f->order;
        sum += columns == 2 ? b[0] * b[0] * G[0] + 2 * b[0] * b[1] * G[1] + b[1] * b[1] * G[2]
                            : b[0] * b[0] * G[0];
    }
    return sum;
}

/* In the channels' own units, largest component 1. */
static enum modal_status shape_of(const struct job *j, const struct moving_fit *f, int i,
                                  int column, struct identify_mode *mode, struct modal_error *err)
{
    int S = f->signals;
    bool pair = pole_kind(f->lambda[i], j->m->opt.dt) == POLE_PAIR;

    mode->shape = malloc(sizeof *mode->shape * ((size_t)S + 1));
    if (mode->shape == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for a shape of %d channels", S);
    for (int c = 0; c < S; c++) {
        const double *b = f->C + column + (size_t)c * (size_t)f->order;
        mode->shape[c] = CMPLX(b[0], pair ? b[1] : 0) * j->scale[c];
    }
    modes_scale_shape(mode, S);
    return MODAL_OK;
}

static const struct moving_fit *channels_of(const struct job *j)
{
    return moving_reduced(j->m) ? &j->channels : &j->own;
}

static enum modal_status report_offset(const struct job *j, const struct moving_fit *f, int column,
                                       struct identify_result *out, struct modal_error *err)
{
    out->offset = calloc((size_t)j->m->S + 1, sizeof *out->offset);
    if (out->offset == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", j->m->S);
    for (int c = 0; c < j->m->S; c++)
        out->offset[c] = f->C[column + (size_t)c * (size_t)f->order] * j->scale[c];
    return MODAL_OK;
}

static enum modal_status report_modes(struct job *j, struct identify_result *out,
                                      struct modal_error *err)
{
    const struct moving_fit *f = &j->own, *all = channels_of(j);
    double dt = j->m->opt.dt, live = 0;
    enum modal_status rc = job_basis(j, f, err);

    out->modes = calloc((size_t)f->poles + 1, sizeof *out->modes);
    if (rc == MODAL_OK && out->modes == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d modes", f->poles);
    for (int c = 0; c < j->m->S; c++)
        live += j->scale[c] > 0;
    for (int i = 0, column = 0; i < f->poles && rc == MODAL_OK;
         column += pole_order(f->lambda[i], dt), i++) {
        struct identify_mode *mode = &out->modes[out->mode_count];
        if (f->lambda[i] == 0) {    /* fixed: the constant, which is no mode */
            rc = report_offset(j, all, column, out, err);
            continue;
        }
        out->mode_count++;
        *mode = (struct identify_mode){ .exponent = f->lambda[i],
                                        .resolved = f->lambda[i],
                                        .multiplier = multiplier_of(f->lambda[i], dt),
                                        .persistence = NAN,
                                        .residual = NAN,
                                        .bar = NAN,
                                        .std_re = f->std_re[i],
                                        .std_im = f->std_im[i],
                                        .growth = j->growth[i] };
        /* rms over samples and living channels, as modes.c */
        mode->amplitude = sqrt(energy_of(j, all, column, pole_order(f->lambda[i], dt))
                               / (j->m->L * live));
        modes_spread_std(mode, dt, j->m->L * dt);
        if (j->m->opt.identify.shapes)
            rc = shape_of(j, all, i, column, mode, err);
    }
    modes_rank(out);
    return rc;
}

static enum modal_status report_channels(const struct job *j, struct identify_result *out,
                                         struct modal_error *err)
{
    int S = j->m->S, L = j->m->L;
    double all = 0, rest = 0;
    const struct moving_fit *f = channels_of(j);

    out->channel_count = S;
    out->channel = malloc(sizeof *out->channel * ((size_t)S + 1));
    out->rms_error = malloc(sizeof *out->rms_error * ((size_t)S + 1));
    out->relative_error = malloc(sizeof *out->relative_error * ((size_t)S + 1));
    if (out->channel == NULL || out->rms_error == NULL || out->relative_error == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
    for (int c = 0; c < S; c++) {
        double r = sqrt(f->rss[c] / L);
        out->channel[c] = c;
        out->rms_error[c] = j->scale[c] * r;
        out->relative_error[c] = j->scale[c] > 0 ? r : NAN;  /* channels have unit rms here */
        rest += f->rss[c], all += j->scale[c] > 0 ? L : 0;
    }
    out->total_relative_error = all > 0 ? sqrt(rest / all) : NAN;
    return MODAL_OK;
}

static void report_settings(const struct job *j, struct identify_result *out)
{
    const struct moving *m = j->m;

    out->pod_rank = moving_reduced(m) ? j->r : m->S;
    out->hankel_rank = j->own.order;
    out->rule = m->opt.identify.rank.rule;
    out->energy = 1;                /* nothing was cut off by singular values */
    out->dt = m->opt.dt;
    out->samples = m->L;
    out->decimation = out->shift = 1;
    out->freedom = m->L - j->own.order;
    out->used = m->opt.identify;
    out->used.refine = CHOICE_YES;
    out->used.stride = 1;
    out->used.period = 0;
    out->used.channels = NULL, out->used.clock = NULL, out->used.cancelled = NULL,
    out->used.context = NULL;
}

enum modal_status moving_report(struct job *j, struct identify_result *out, struct modal_error *err)
{
    struct moving *m = j->m;
    struct diagnose_facts facts = { .converged = true,
                                    .asked_rank = m->opt.identify.rank.rule == RANK_FIXED
                                        ? m->opt.identify.rank.fixed
                                        : 0,
                                    .full_rank = IDENTIFY_ORDER_MOST,
                                    .rows = m->L,
                                    .order = j->own.order,
                                    .record = m->L * m->opt.dt,
                                    .tau = m->opt.dt,
                                    .doubt = { .colour = 1 } };
    enum modal_status rc;

    report_settings(j, out);
    if ((rc = report_modes(j, out, err)) != MODAL_OK
        || (rc = report_channels(j, out, err)) != MODAL_OK
        || (rc = verdict_clusters(out, facts.record, err)) != MODAL_OK)
        return rc;
    trend_mark_harmonics(out);
    verdict_stability(out, facts.record);
    diagnose(out, &facts);
    trend_of_modes(facts.record, out);
    return MODAL_OK;
}
