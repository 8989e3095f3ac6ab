/*
 * torus_stability.c - whether disturbances of a motion of several tones decay; tested by
 * tests/unit/modal/steady/test_torus.c
 *
 * Disturbances y of the motion obey
 *
 *     M y'' + (C + df/dv) y' + (K + df/dd) y = 0,                                               (1)
 *
 * the laws' slopes along the motion.  The leading Lyapunov exponents of (1) are the mean growth of
 * a few of them, kept orthogonal [BGGS80].  A step is the implicit midpoint's,
 *
 *     (2 M / h + C + h K / 2) u = 2 M v / h - K y,   y <- y + h u,   v <- 2 u - v,              (2)
 *
 * u the mean rate: what decays in (1) with constant matrices decays in (2) at any h, so that fast
 * modes are no matter.  Its error is even in h and is taken off by two lengths; what is left, and
 * the scatter of batches of turns, is the error stated.
 *
 * Of a law that remembers the places z are states as well: over a step, the motion at its middle,
 *
 *     dz <- (dz/dd) dd + (dz/dz) dz,   and (df/dz) dz joins the forces of (1),                  (3)
 *
 * by difference quotients of the law, which is a line between its regimes.  Where these change is
 * known to a step, so that the error is not even any more: what two lengths differ by is all of it.
 *
 * A free tone may be shifted in time: one exponent is 0, the nearest to it, and decides nothing.
 *
 * [BGGS80] Benettin, Galgani, Giorgilli and Strelcyn, Meccanica 15 (1980) 9-20.
 */
#include "modal/steady/torus_state.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/steady/torus_laws.h"

enum {
    STEPS = 64,                /* of a turn of the fastest tone, and twice as many */
    BATCHES = 8,               /* of turns: their scatter is told to a quarter of itself */
    TURNS = 16,                /* of a batch; as many as two batches go before all of them */
    LONGER_MOST = 2,           /* times that turns are multiplied by LONGER while undecided */
    LONGER = 4,                /* halves what the scatter leaves */
};
static const double WORK = 1e9;           /* budget.h: some second */
static const double SURE = 3;             /* errors away from 0 */
static const double SMALL = 1e-10;        /* of the largest combination: it bends no slope */
static const double DIFFERENCE = 1e-6;    /* of the largest combination: so rarely another regime */

struct flow {
    const struct torus_solver *s;
    size_t n, m;                          /* dofs, disturbances */
    double complex *input;                /* [law][input][k]: of laws' displacements */
    double complex *wave, *turn;          /* e^{i Omega_k t}, and over a step */
    double *M, *C, *K, *Ct, *Kt;          /* n x n by columns */
    double *y, *v, *rhs;                  /* n x m */
    size_t places;                        /* that laws remember */
    double *z, *zd;                       /* of the motion; places x m, of the disturbances */
    double *Fz, *Zd, *Zz;                 /* (3), by columns: n x, x n and x places */
    double *step;                         /* places x m: of dz */
    double apart;                         /* m: of a difference quotient */
    int *pivot;
    struct workspace space;
};

/* A law's inputs and their rates where the waves stand. */
static void see(const struct flow *f, int law, double *d, double *v)
{
    const struct torus_solver *s = f->s;

    for (int j = 0; j < s->p->law[law].kind->inputs; j++) {
        const double complex *D =
            f->input + (size_t)(law * LAW_INPUTS_MOST + j) * (size_t)s->count;

        d[j] = v[j] = 0;
        for (int k = 0; k < s->count; k++) {
            if (D[k] == 0)
                continue;
            d[j] += creal(D[k] * f->wave[k]);
            v[j] -= torus_frequency(&s->tones, s->index[k]) * cimag(D[k] * f->wave[k]);
        }
    }
}

/* WEIGHT of a law's input J, onto the dofs of its ends, at A[dof stride]. */
static void spread(const struct law *law, int j, double weight, double *a, size_t stride)
{
    for (int e = law->start[j]; e < law->start[j + 1]; e++)
        a[(size_t)law->end[e].dof * stride] += weight * law->end[e].weight;
}

/* (3) of law L, whose places begin at FIRST, seen at D and V with OUT; its places move on. */
static enum modal_status places_now(struct flow *f, const struct law *law, size_t first,
                                    const double *d, const double *v, struct law_force *out,
                                    struct modal_error *err)
{
    size_t P = f->places;
    double near[LAW_INPUTS_MOST], before[LAW_TERMS_MOST], after[LAW_TERMS_MOST];
    struct law_point at = { .d = near, .v = v, .d_before = near, .memory_before = before };
    struct law_force other = { .memory = after };
    enum modal_status rc = MODAL_OK;

    for (int e = 0; rc == MODAL_OK && e < law->kind->inputs + law->memory; e++) {
        int i = e - law->kind->inputs;

        memcpy(near, d, sizeof near);
        memcpy(before, f->z + first, (size_t)law->memory * sizeof *before);
        *(i < 0 ? &near[e] : &before[i]) += f->apart;
        rc = law->kind->force(law, &at, &other, err);
        for (int k = 0; rc == MODAL_OK && k < law->memory; k++) {
            double slope = (after[k] - out->memory[k]) / f->apart;

            if (i < 0)
                spread(law, e, slope, f->Zd + first + (size_t)k, P);
            else
                f->Zz[(first + (size_t)i) * P + first + (size_t)k] = slope;
        }
        for (int k = 0; i >= 0 && k < law->kind->inputs; k++)
            spread(law, k, (other.f[k] - out->f[k]) / f->apart,
                   f->Fz + (first + (size_t)i) * f->n, 1);
    }
    memcpy(f->z + first, out->memory, (size_t)law->memory * sizeof *f->z);
    return rc;
}

/* Ct and Kt of (1), and (3), where the waves stand. */
static enum modal_status slopes_now(struct flow *f, struct modal_error *err)
{
    const struct program *p = f->s->p;
    size_t place = 0;
    enum modal_status rc = MODAL_OK;

    memcpy(f->Ct, f->C, f->n * f->n * sizeof *f->C);
    memcpy(f->Kt, f->K, f->n * f->n * sizeof *f->K);
    memset(f->Fz, 0, f->places * (2 * f->n + f->places) * sizeof *f->Fz);
    for (int l = 0; rc == MODAL_OK && l < p->laws; l++) {
        const struct law *law = &p->law[l];
        double d[LAW_INPUTS_MOST], v[LAW_INPUTS_MOST], after[LAW_TERMS_MOST];
        struct law_point at = { .d = d, .v = v, .d_before = d, .memory_before = f->z + place };
        struct law_force out = { .memory = after };

        see(f, l, d, v);
        rc = law->kind->force(law, &at, &out, err);
        if (rc == MODAL_OK && law->memory > 0)
            rc = places_now(f, law, place, d, v, &out, err);
        place += (size_t)law->memory;
        for (int i = 0; rc == MODAL_OK && i < law->kind->inputs; i++)
            for (int j = 0; j < law->kind->inputs; j++) {
                law_spread(law, i, j, out.fd[i][j], p->n, f->Kt);
                law_spread(law, i, j, out.fv[i][j], p->n, f->Ct);
            }
    }
    return rc;
}

/* (3) of all disturbances, the mean rate of each in f->rhs. */
static void move_places(struct flow *f, double h)
{
    int n = (int)f->n, m = (int)f->m, P = (int)f->places;

    if (P == 0)
        return;
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, P, m, n, 1, f->Zd, P, f->y, n, 0,
                f->step, P);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, P, m, n, h / 2, f->Zd, P, f->rhs, n, 1,
                f->step, P);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, P, m, P, 1, f->Zz, P, f->zd, P, 1,
                f->step, P);
    memcpy(f->zd, f->step, f->places * f->m * sizeof *f->zd);
}

/* (2) over H, the waves at its middle. */
static enum modal_status step_over(struct flow *f, double h, struct modal_error *err)
{
    int n = (int)f->n, m = (int)f->m, P = (int)f->places;
    enum modal_status rc = slopes_now(f, err);

    if (rc != MODAL_OK)
        return rc;
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, m, n, 2 / h, f->M, n, f->v, n, 0,
                f->rhs, n);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, m, n, -1, f->Kt, n, f->y, n, 1,
                f->rhs, n);
    if (P > 0)
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, m, P, -1, f->Fz, n, f->zd, P, 1,
                    f->rhs, n);
    for (size_t e = 0; e < f->n * f->n; e++)
        f->Kt[e] = 2 / h * f->M[e] + f->Ct[e] + h / 2 * f->Kt[e];
    if (LAPACKE_dgesv_work(LAPACK_COL_MAJOR, n, m, f->Kt, n, f->pivot, f->rhs, n) != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "torus: a step of disturbances is singular");
    move_places(f, h);
    for (size_t e = 0; e < f->n * f->m; e++) {
        f->y[e] += h * f->rhs[e];
        f->v[e] = 2 * f->rhs[e] - f->v[e];
    }
    return MODAL_OK;
}

/* Gram and Schmidt on (y, v / RATE, dz); logarithms of what each had grown to. */
static void orthogonal(struct flow *f, double rate, double *grown)
{
    int n = (int)f->n, P = (int)f->places;
    double w = 1 / (rate * rate);

    for (size_t j = 0; j < f->m; j++) {
        double *y = f->y + j * f->n, *v = f->v + j * f->n, *z = f->zd + j * f->places, size;

        for (size_t i = 0; i < j; i++) {
            const double *yi = f->y + i * f->n, *vi = f->v + i * f->n, *zi = f->zd + i * f->places;
            double share = cblas_ddot(n, yi, 1, y, 1) + w * cblas_ddot(n, vi, 1, v, 1)
                + cblas_ddot(P, zi, 1, z, 1);

            cblas_daxpy(n, -share, yi, 1, y, 1);
            cblas_daxpy(n, -share, vi, 1, v, 1);
            cblas_daxpy(P, -share, zi, 1, z, 1);
        }
        size = sqrt(cblas_ddot(n, y, 1, y, 1) + w * cblas_ddot(n, v, 1, v, 1)
                    + cblas_ddot(P, z, 1, z, 1));
        cblas_dscal(n, 1 / fmax(size, 1e-300), y, 1);
        cblas_dscal(n, 1 / fmax(size, 1e-300), v, 1);
        cblas_dscal(P, 1 / fmax(size, 1e-300), z, 1);
        grown[j] = log(fmax(size, 1e-300));
    }
}

/* Mean growth, 1/s, of each batch [batch][m] of TURNS turns, of N steps each. */
static enum modal_status grow(struct flow *f, int turns, int N, double *growth,
                              struct modal_error *err)
{
    const struct torus_solver *s = f->s;
    double rate = s->tones.omega[s->tones.lead], period = 2 * M_PI / rate, h = period / N;
    double grown[TORUS_EXPONENTS];
    enum modal_status rc = MODAL_OK;

    memset(growth, 0, BATCHES * f->m * sizeof *growth);
    memset(f->z, 0, f->places * (1 + f->m) * sizeof *f->z);
    for (size_t e = 0; e < f->n * f->m; e++) {       /* no two alike, none along an axis */
        f->y[e] = cos(1 + 2.4 * (double)e);
        f->v[e] = rate * sin(2 + 1.7 * (double)e);
    }
    for (int k = 0; k < s->count; k++)
        f->turn[k] = cexp(I * torus_frequency(&s->tones, s->index[k]) * h);
    for (int turn = -2 * turns; rc == MODAL_OK && turn < BATCHES * turns; turn++) {
        for (int k = 0; k < s->count; k++)           /* afresh each turn: no rounding gathers */
            f->wave[k] = cexp(I * torus_frequency(&s->tones, s->index[k])
                              * (turn * period + h / 2));
        for (int i = 0; rc == MODAL_OK && i < N; i++) {
            rc = step_over(f, h, err);
            for (int k = 0; k < s->count; k++)
                f->wave[k] *= f->turn[k];
        }
        orthogonal(f, rate, grown);
        for (size_t j = 0; turn >= 0 && j < f->m; j++)
            growth[(size_t)(turn / turns) * f->m + j] += grown[j] / (turns * period);
    }
    return rc;
}

static size_t places_of(const struct program *p)
{
    size_t places = 0;

    for (int l = 0; l < p->laws; l++)
        places += (size_t)p->law[l].memory;
    return places;
}

/* Inputs' combinations, matrices, and room. */
static enum modal_status set_out(struct flow *f, const int *place, struct modal_error *err)
{
    const struct torus_solver *s = f->s;
    size_t K = (size_t)s->count, n = f->n;
    struct matrix to[3];
    double most = 0;

    f->input = workspace_zeros(&f->space, (size_t)s->p->laws * LAW_INPUTS_MOST * K,
                               sizeof *f->input);
    f->wave = workspace_zeros(&f->space, 2 * K, sizeof *f->wave);
    f->M = workspace_zeros(&f->space, 5 * n * n, sizeof *f->M);
    f->y = workspace_zeros(&f->space, 3 * n * f->m, sizeof *f->y);
    f->pivot = workspace_zeros(&f->space, n, sizeof *f->pivot);
    f->places = places_of(s->p);
    f->z = workspace_zeros(&f->space, f->places * (1 + 2 * f->m) + 1, sizeof *f->z);
    f->Fz = workspace_zeros(&f->space, f->places * (2 * n + f->places) + 1, sizeof *f->Fz);
    if (f->space.failed)
        return workspace_check(&f->space, "torus: no memory for disturbances", err);
    f->turn = f->wave + K;
    f->C = f->M + n * n, f->K = f->C + n * n, f->Ct = f->K + n * n, f->Kt = f->Ct + n * n;
    f->v = f->y + n * f->m, f->rhs = f->v + n * f->m;
    f->zd = f->z + f->places, f->step = f->zd + f->places * f->m;
    f->Zd = f->Fz + f->places * n, f->Zz = f->Zd + f->places * n;
    for (int a = 0; a < 3; a++) {
        to[a] = (struct matrix) { (int)n, (int)n, (int)n, f->M + (size_t)a * n * n };
        sparse_add_to_dense(&s->p->constant[a], 1, &to[a]);
    }
    for (size_t e = 0; e < (size_t)s->q * K; e++)
        most = fmax(most, cabs(s->X[e]));
    f->apart = DIFFERENCE * most;
    for (int l = 0; l < s->p->laws; l++)
        for (int j = 0; j < s->p->law[l].kind->inputs; j++)
            for (int e = s->p->law[l].start[j]; e < s->p->law[l].start[j + 1]; e++)
                for (size_t k = 0; k < K; k++) {
                    const struct law_end *end = &s->p->law[l].end[e];
                    double complex X = s->X[(size_t)place[end->dof] * K + k];

                    if (cabs(X) > SMALL * most)
                        f->input[(size_t)(l * LAW_INPUTS_MOST + j) * K + k] += end->weight * X;
                }
    return MODAL_OK;
}

/* Exponents by falling size with errors, of growths with STEPS and twice as many; EVEN: their
 * error is. */
static void sum_up(const double *coarse, const double *fine, size_t m, bool even, double *value,
                   double *error)
{
    for (size_t j = 0; j < m; j++) {
        double mean[2] = { 0 }, scatter = 0;

        for (size_t b = 0; b < BATCHES; b++) {
            mean[0] += coarse[b * m + j] / BATCHES;
            mean[1] += fine[b * m + j] / BATCHES;
        }
        for (size_t b = 0; b < BATCHES; b++)
            scatter += pow(fine[b * m + j] - mean[1], 2) / (BATCHES * (BATCHES - 1));
        value[j] = mean[1] + (even ? (mean[1] - mean[0]) / 3 : 0);
        error[j] = fabs(mean[1] - mean[0]) / (even ? 3 : 1) + sqrt(scatter);
    }
    for (size_t i = 1; i < m; i++)
        for (size_t j = i; j > 0 && value[j] > value[j - 1]; j--) {
            double v = value[j], e = error[j];

            value[j] = value[j - 1], error[j] = error[j - 1];
            value[j - 1] = v, error[j - 1] = e;
        }
}

/* The verdict on the exponents but one of a free tone. */
static void judge(const struct torus_solver *s, struct torus_stability *out)
{
    int own = -1, first;

    for (int j = 0; s->tone.index >= 0 && j < out->count; j++)
        if (own < 0 || fabs(out->exponent[j]) < fabs(out->exponent[own]))
            own = j;
    first = own == 0 ? 1 : 0;
    out->margin = -out->exponent[first];
    out->error = out->errors[first];
    out->verdict = out->margin > SURE * out->error    ? 1
                   : out->margin < -SURE * out->error ? -1
                                                      : 0;
}

enum modal_status torus_judge(struct torus_solver *s, const int *place, struct torus_stability *out,
                              struct modal_error *err)
{
    struct flow f = { .s = s, .n = (size_t)s->p->n };
    double growth[2][BATCHES * TORUS_EXPONENTS];
    double n = s->p->n, steps = 3.0 * STEPS * TURNS * (BATCHES + 2);
    double work = steps * (n * n * n / BUDGET_DENSE + 4 * n * n
                           + (double)s->p->laws * (BUDGET_SAMPLE + 4.0 * s->count))
        + steps * BUDGET_SAMPLE * places_of(s->p);
    int turns = TURNS;
    bool rests = false;
    enum modal_status rc;

    *out = (struct torus_stability) { 0 };
    if (work > WORK)
        out->reason = "of so many dofs, laws and combinations disturbances are not followed";
    if (s->p->n_linear > 0)
        out->reason = "linear states are not followed beside a motion of tones";
    if (out->reason != NULL)
        return MODAL_OK;
    for (int l = 0; l < s->p->laws; l++)
        rests = rests || torus_undetermined(s->laws, l);
    f.m = 2 * f.n < TORUS_EXPONENTS ? 2 * f.n : TORUS_EXPONENTS;
    rc = set_out(&f, place, err);
    for (int l = 0; rc == MODAL_OK && l <= LONGER_MOST && out->verdict == 0 && work <= WORK; l++) {
        budget_add(s->work, work);
        for (int i = 0; rc == MODAL_OK && i < 2; i++)
            rc = grow(&f, turns, STEPS << i, growth[i], err);
        if (rc == MODAL_OK) {
            out->count = (int)f.m;
            sum_up(growth[0], growth[1], f.m, f.places == 0, out->exponent, out->errors);
            judge(s, out);
        }
        if (rests && out->verdict >= 0) {
            *out = (struct torus_stability) {
                .reason = "a slider comes to rest, and no disturbance of its place decays" };
            break;
        }
        turns *= LONGER, work *= LONGER;
    }
    workspace_free(&f.space);
    return rc;
}
