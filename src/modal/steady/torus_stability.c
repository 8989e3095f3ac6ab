/*
 * torus_stability.c - whether disturbances of a motion of several tones decay; tested by
 * tests/unit/modal/steady/test_torus.c
 *
 * Disturbances y of the motion obey
 *
 *     M y'' + (C + df/dv) y' + (K + df/dd) y = 0,                                               (1)
 *
 * the laws' slopes along the motion.  The leading Lyapunov exponents of (1) are the mean growth of
 * a few of them, kept orthogonal [BGGS80].  A step is Gauss's of one or two stages [HW96],
 * accelerations A_i at t + c_i h, with B = (a_ij)^2,
 *
 *     M A_i + C_i (v + h sum_j a_ij A_j) + K_i (y + c_i h v + h^2 sum_j B_ij A_j) = 0,          (2)
 *
 * C_i and K_i of (1) there: what decays in (1) with constant matrices decays in (2) at any h, so
 * that fast modes are no matter.  With one stage a mode w turns slower by (w h)^2 / 12, which may
 * move it out of a parametric resonance and its growth with it; with two by (w h)^4 / 720.  Two
 * are taken where their work is allowed, and no law remembers.  Where all laws are smooth the error
 * is even in h, and most of it is taken off by two lengths.
 *
 * What disturbances grow by in a turn is as quasi-periodic as the motion.  Its mean is taken under
 * the window exp(-1 / (u (1 - u))), 0 < u < 1 over the turns, whose error falls faster than any
 * power of their number [DSSY17], where that of a plain mean falls as its inverse; what the halves
 * of the turns tell under windows of their own is apart from it by more than that error, and is the
 * error stated, with what is left of h.
 *
 * Of a law that remembers the places z are states as well: over a step of one stage, at its middle,
 *
 *     dz <- (dz/dd) dd + (dz/dz) dz,   and (df/dz) dz joins the forces of (1),                  (3)
 *
 * by difference quotients of the law, which is a line between its regimes.  Where these change is
 * known to a step, so that the error is not even any more: what two lengths differ by is all of it.
 *
 * Each turn of the leading tone begins at its phase 0, so that what it adds to the motion is the
 * same in all: combinations that differ in its k alone, a row, have one factor that goes on,
 *
 *     d(t) = Re sum_rows e^{i (Omega_k - k_lead w) t} sum_k D_k e^{i k_lead w t},               (5)
 *
 * and a turn's inner sums are made once.
 *
 * A free tone may be shifted in time, and a body that nothing holds be moved: as many exponents are
 * 0, the nearest to it, and decide nothing.
 *
 * Of a balance the forces that its set has no combinations for, and those that its samples got
 * wrong, are left: r, of the laws' forces along the motion less those balanced.  To first order the
 * motion that starts with the balance's leaves it by e of
 *
 *     M e'' + (C + df/dv) e' + (K + df/dd) e = -r,                                              (4)
 *
 * one more column of (2), e 0 at first.  Estimates at fixed phases see no growth along them: where
 * a part of a slow phase is unstable, though disturbances decay over all of it, (4) grows through
 * that part, and the balance is no motion of the system there.
 *
 * [BGGS80] Benettin, Galgani, Giorgilli and Strelcyn, Meccanica 15 (1980) 9-20.
 * [HW96] Hairer and Wanner, Solving Ordinary Differential Equations II (1996), table IV.5.1.
 * [DSSY17] Das, Saiki, Sander and Yorke, Nonlinearity 30 (2017) 4111-4140.
 */
#include "modal/steady/torus_state.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/numbers.h"
#include "modal/steady/condense.h"
#include "modal/steady/torus_laws.h"

enum {
    STEPS = 64,                /* of a turn of the fastest tone, and twice as many */
    TURNS = 128,               /* at first: tones one in 30 apart are told */
    SETTLING = 4,              /* turns over those that go before them */
    LONGER = 4,                /* the next, while undecided: all before cost a third of it */
    WINDOWS = 3,               /* all turns, the first half of them and the last */
    STAGES_MOST = 2,           /* of (2): three would solve for half as much again */
};
#define SQRT3 1.7320508075688772          /* of the points of Gauss's second method */
static const double WORK = 1e9;           /* budget.h: some second, of the longest */
static const double SURE = 3;             /* errors away from 0 */
static const double DIFFERENCE = 1e-6;    /* of the largest combination: so rarely another regime */

/* Gauss's methods, (2). */
static const struct gauss {
    double order, a[STAGES_MOST][STAGES_MOST], b[STAGES_MOST], c[STAGES_MOST];
} gauss[STAGES_MOST] = {
    { 2, { { 0.5 } }, { 1 }, { 0.5 } },
    { 4, { { 0.25, 0.25 - SQRT3 / 6 }, { 0.25 + SQRT3 / 6, 0.25 } }, { 0.5, 0.5 },
      { 0.5 - SQRT3 / 6, 0.5 + SQRT3 / 6 } },
};

struct flow {
    struct torus_solver *s;
    size_t n, m, columns;                 /* dofs, disturbances, and e of (4) where it is asked */
    int count, *kept;                     /* combinations followed, and which those are */
    int lanes, inputs;                    /* what has combinations: laws' inputs, then, where e is
                                           * asked for, the forces balanced */
    double complex *lane;                 /* [lane][k] */
    double *left;                         /* n: r of (4) where the waves stand */
    double most;                          /* m: of e over the reported dofs, once settled */
    int stages, rows, *row;               /* of each k; -1 - that of -k, whose conjugate it adds */
    double *omega, *beat;                 /* Omega_k; of a row */
    double complex *wave, *hop;           /* e^{-i beat t}; [stage][row], to the next stage */
    double complex *turn, *now;           /* (5), [step][stage][lane][row], of inputs their rates
                                           * beside them; where the waves stand */
    double summed;                        /* numbers of (5) gone through, to make it and to see */
    double *seen;                         /* lanes there, rates beside inputs */
    double *M, *C, *K, *Ct, *Kt;          /* n x n by columns */
    double *y, *v;                        /* n x columns */
    double *W, *A;                        /* (2), of all stages: by columns; its right side and A */
    size_t places;                        /* that laws remember */
    double *z, *zd;                       /* of the motion; places x columns, of disturbances */
    double *Fz, *Zd, *Zz;                 /* (3), by columns: n x, x n and x places */
    double *step;                         /* places x columns: of dz */
    double apart;                         /* m: of a difference quotient */
    int *pivot;
    struct workspace space;
};

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
    struct law_point at = { .d = near, .v = v, .memory_before = before };
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

/* (5) where the waves stand; r of (4) less the laws' forces, which are added as they are seen. */
static void see(struct flow *f)
{
    const int *dof = condense_dofs(f->s->condense[0]);
    int rates = f->inputs;

    f->summed += (f->lanes + rates) * (double)f->rows;
    cblas_dgemv(CblasRowMajor, CblasNoTrans, f->lanes + rates, 2 * f->rows, 1,
                (const double *)f->now, 2 * f->rows, (const double *)f->wave, 1, 0, f->seen, 1);
    memset(f->left, 0, f->n * sizeof *f->left);
    for (int i = f->inputs; i < f->lanes; i++)
        f->left[dof[i - f->inputs]] = -f->seen[i + rates];
}

/* Ct and Kt of (1), (3) and r of (4), where the waves stand. */
static enum modal_status slopes_now(struct flow *f, struct modal_error *err)
{
    const struct program *p = f->s->p;
    size_t place = 0;
    int lane = 0;
    enum modal_status rc = MODAL_OK;

    memcpy(f->Ct, f->C, f->n * f->n * sizeof *f->C);
    memcpy(f->Kt, f->K, f->n * f->n * sizeof *f->K);
    memset(f->Fz, 0, f->places * (2 * f->n + f->places) * sizeof *f->Fz);
    see(f);
    for (int l = 0; rc == MODAL_OK && l < p->laws; l++) {
        const struct law *law = &p->law[l];
        double d[LAW_INPUTS_MOST], v[LAW_INPUTS_MOST], after[LAW_TERMS_MOST];
        struct law_point at = { .d = d, .v = v, .memory_before = f->z + place };
        struct law_force out = { .memory = after };

        for (int i = 0; i < law->kind->inputs; i++, lane++)
            d[i] = f->seen[2 * lane], v[i] = f->seen[2 * lane + 1];
        rc = law->kind->force(law, &at, &out, err);
        if (rc == MODAL_OK && law->memory > 0)
            rc = places_now(f, law, place, d, v, &out, err);
        place += (size_t)law->memory;
        for (int i = 0; i < law->kind->inputs; i++)
            spread(law, i, out.f[i], f->left, 1);
        for (int i = 0; rc == MODAL_OK && i < law->kind->inputs; i++)
            for (int j = 0; j < law->kind->inputs; j++) {
                law_spread(law, i, j, out.fd[i][j], p->n, f->Kt);
                law_spread(law, i, j, out.fv[i][j], p->n, f->Ct);
            }
    }
    return rc;
}

/* (3) of all disturbances, A of one stage being known. */
static void move_places(struct flow *f, double h)
{
    int n = (int)f->n, m = (int)f->columns, P = (int)f->places;

    if (P == 0)
        return;
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, P, m, n, 1, f->Zd, P, f->y, n, 0,
                f->step, P);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, P, m, n, h / 2, f->Zd, P, f->v, n, 1,
                f->step, P);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, P, m, n, h * h / 4, f->Zd, P, f->A, n,
                1, f->step, P);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, P, m, P, 1, f->Zz, P, f->zd, P, 1,
                f->step, P);
    memcpy(f->zd, f->step, f->places * f->columns * sizeof *f->zd);
}

/* (2) and (4) of stage I of a step over H, the waves there: its rows of W and of the right side. */
static void fill_stage(struct flow *f, int i, double h)
{
    const struct gauss *g = &gauss[f->stages - 1];
    int n = (int)f->n, m = (int)f->columns, P = (int)f->places, rows = f->stages * n;
    double *right = f->A + i * n;

    for (int j = 0; j < f->stages; j++) {
        double a = h * g->a[i][j], aa = 0, one = i == j;

        for (int l = 0; l < f->stages; l++)
            aa += h * h * g->a[i][l] * g->a[l][j];
        for (int c = 0; c < n; c++)
            for (int r = 0; r < n; r++)
                f->W[(size_t)(j * n + c) * (size_t)rows + (size_t)(i * n + r)] =
                    one * f->M[c * n + r] + a * f->Ct[c * n + r] + aa * f->Kt[c * n + r];
    }
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, m, n, -1, f->Kt, n, f->y, n, 0,
                right, rows);
    cblas_daxpy(n * n, g->c[i] * h, f->Kt, 1, f->Ct, 1);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, m, n, -1, f->Ct, n, f->v, n, 1,
                right, rows);
    if (P > 0)
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, n, m, P, -1, f->Fz, n, f->zd, P, 1,
                    right, rows);
    if (f->columns > f->m)
        cblas_daxpy(n, -1, f->left, 1, right + f->m * (size_t)rows, 1);
}

/* Numbers of (5) at one instant. */
static size_t block_of(const struct flow *f)
{
    return (size_t)(f->lanes + f->inputs) * (size_t)f->rows;
}

/* A step over H, the waves at its first stage; then at the next step's. */
static enum modal_status step_over(struct flow *f, double h, struct modal_error *err)
{
    const struct gauss *g = &gauss[f->stages - 1];
    int n = (int)f->n, m = (int)f->columns, rows = f->stages * n;

    for (int i = 0; i < f->stages; i++) {
        enum modal_status rc = slopes_now(f, err);

        if (rc != MODAL_OK)
            return rc;
        fill_stage(f, i, h);
        for (int r = 0; r < f->rows; r++)
            f->wave[r] = numbers_times(f->wave[r], f->hop[i * f->rows + r]);
        f->now += block_of(f);
    }
    if (LAPACKE_dgesv_work(LAPACK_COL_MAJOR, rows, m, f->W, rows, f->pivot, f->A, rows) != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "torus: a step of disturbances is singular");
    move_places(f, h);
    cblas_daxpy(n * m, h, f->v, 1, f->y, 1);
    for (int j = 0; j < f->stages; j++) {
        double ba = 0;

        for (int l = 0; l < f->stages; l++)
            ba += g->b[l] * g->a[l][j];
        for (int c = 0; c < m; c++) {
            const double *A = f->A + c * rows + j * n;

            cblas_daxpy(n, h * h * ba, A, 1, f->y + c * n, 1);
            cblas_daxpy(n, h * g->b[j], A, 1, f->v + c * n, 1);
        }
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

/* The window over all turns, and over each half of them: of turn TURN of TURNS, into WEIGHT. */
static void windows_at(int turn, int turns, double *weight)
{
    static const double from[WINDOWS] = { 0, 0, 0.5 }, until[WINDOWS] = { 1, 0.5, 1 };

    for (int w = 0; w < WINDOWS; w++) {
        double u = ((turn + 0.5) / turns - from[w]) / (until[w] - from[w]);

        weight[w] = u > 0 && u < 1 ? exp(-1 / (u * (1 - u))) : 0;
    }
}

/* The largest of e, taken in where the waves stand. */
static void take_largest(struct flow *f)
{
    const struct torus_options *opt = f->s->opt;

    for (int i = 0; f->columns > f->m && i < opt->dofs_count; i++)
        f->most = fmax(f->most, fabs(f->y[f->m * f->n + (size_t)opt->dofs[i]]));
}

/* Where disturbances begin: no two alike, none along an axis. */
static void begin(struct flow *f, double rate)
{
    memset(f->z, 0, f->places * (1 + f->columns) * sizeof *f->z);
    memset(f->y, 0, f->n * f->columns * sizeof *f->y);
    memset(f->v, 0, f->n * f->columns * sizeof *f->v);
    for (size_t e = 0; e < f->n * f->m; e++) {
        f->y[e] = cos(1 + 2.4 * (double)e);
        f->v[e] = rate * sin(2 + 1.7 * (double)e);
    }
    f->most = 0;
}

/* (5) at the stages of N steps. */
static void fill_turn(struct flow *f, int N)
{
    const struct torus_solver *s = f->s;
    const double *c = gauss[f->stages - 1].c;
    size_t K = (size_t)f->count, rows = (size_t)f->rows;
    double complex *now = f->turn;

    memset(now, 0, (size_t)(N * f->stages) * block_of(f) * sizeof *now);
    for (int i = 0; i < N * f->stages; i++, now += block_of(f)) {
        double phase = 2 * M_PI / N * (i / f->stages + c[i % f->stages]);

        for (size_t k = 0; k < K; k++) {
            int row = f->row[k], sign = row < 0 ? -1 : 1;
            double complex wave = cexp(I * phase * s->index[f->kept[k]].k[s->tones.lead]);
            double complex *to = now + (row < 0 ? -1 - row : row);

            f->summed += f->lanes;
            for (size_t l = 0; l < (size_t)f->lanes; l++, to += rows) {
                double complex x = numbers_times(f->lane[l * K + k], wave);

                *to += CMPLX(creal(x), sign * cimag(x));
                if (l < (size_t)f->inputs)
                    *(to += rows) += f->omega[k] * CMPLX(-cimag(x), sign * creal(x));
            }
        }
    }
}

/* Mean growth, 1/s, under each window [window][m] of TURNS turns, of N steps each. */
static enum modal_status grow(struct flow *f, int turns, int N, double *growth,
                              struct modal_error *err)
{
    const struct torus_solver *s = f->s;
    double rate = s->tones.omega[s->tones.lead], period = 2 * M_PI / rate, h = period / N;
    double grown[TORUS_EXPONENTS], weight[WINDOWS], sum[WINDOWS] = { 0 };
    const double *c = gauss[f->stages - 1].c;
    enum modal_status rc = MODAL_OK;

    memset(growth, 0, WINDOWS * f->m * sizeof *growth);
    begin(f, rate);
    fill_turn(f, N);
    for (int i = 0; i < f->stages; i++)
        for (int r = 0; r < f->rows; r++)
            f->hop[i * f->rows + r] =
                cexp(-I * f->beat[r] * h * (i + 1 < f->stages ? c[i + 1] - c[i] : 1 + c[0] - c[i]));
    for (int turn = -turns / SETTLING; rc == MODAL_OK && turn < turns; turn++) {
        for (int r = 0; r < f->rows; r++)            /* afresh each turn: no rounding gathers */
            f->wave[r] = cexp(-I * f->beat[r] * (turn * period + c[0] * h));
        f->now = f->turn;
        for (int i = 0; rc == MODAL_OK && i < N; i++) {
            rc = step_over(f, h, err);
            if (turn >= 0)
                take_largest(f);
        }
        orthogonal(f, rate, grown);
        windows_at(turn, turns, weight);
        for (size_t w = 0; turn >= 0 && w < WINDOWS; w++) {
            sum[w] += weight[w];
            for (size_t j = 0; j < f->m; j++)
                growth[w * f->m + j] += weight[w] * grown[j] / period;
        }
    }
    for (size_t e = 0; e < WINDOWS * f->m; e++)
        growth[e] /= sum[e / f->m];
    return rc;
}

static size_t places_of(const struct program *p)
{
    size_t places = 0;

    for (int l = 0; l < p->laws; l++)
        places += (size_t)p->law[l].memory;
    return places;
}

/* A combination and its largest motion. */
struct part { int at; double size; };

static int by_size(const void *a, const void *b)
{
    double x = ((const struct part *)a)->size, y = ((const struct part *)b)->size;

    return (x < y) - (x > y);
}

/* The rows of the combinations followed, and the lanes. */
static enum modal_status find_rows(struct flow *f, struct modal_error *err)
{
    const struct torus_solver *s = f->s;
    int lead = s->tones.lead;
    struct torus_index *beat = workspace_zeros(&f->space, (size_t)f->count, sizeof *beat);

    f->row = workspace_zeros(&f->space, (size_t)f->count, sizeof *f->row);
    f->beat = workspace_zeros(&f->space, (size_t)f->count, sizeof *f->beat);
    if (f->space.failed)
        return workspace_check(&f->space, "torus: no memory for disturbances", err);
    for (int k = 0; k < f->count; k++) {
        struct torus_index of = s->index[f->kept[k]], back = { { 0 } };
        double of_lead = of.k[lead] * s->tones.omega[lead];
        int r = 0;

        of.k[lead] = 0;
        for (int j = 0; j < TORUS_TONES_MOST; j++)
            back.k[j] = -of.k[j];
        while (r < f->rows && !torus_equal(beat[r], of) && !torus_equal(beat[r], back))
            r++;
        if (r == f->rows) {
            f->beat[r] = f->omega[k] - of_lead;
            beat[f->rows++] = of;
        }
        f->row[k] = torus_equal(beat[r], of) ? r : -1 - r;
    }
    for (int l = 0; l < s->p->laws; l++)
        f->inputs += s->p->law[l].kind->inputs;
    f->lanes = f->inputs + (f->columns > f->m ? s->q : 0);
    return MODAL_OK;
}

/* The combinations followed: those left out sum to LEAVE, in m. */
static enum modal_status choose(struct flow *f, double leave, struct modal_error *err)
{
    const struct torus_solver *s = f->s;
    size_t K = (size_t)s->count;
    struct part *part = workspace_zeros(&f->space, K, sizeof *part);
    double sum = 0;

    f->kept = workspace_zeros(&f->space, K, sizeof *f->kept);
    f->omega = workspace_zeros(&f->space, K, sizeof *f->omega);
    if (f->space.failed)
        return workspace_check(&f->space, "torus: no memory for disturbances", err);
    for (size_t k = 0; k < K; k++) {
        part[k].at = (int)k;
        for (size_t i = 0; i < (size_t)s->q; i++)
            part[k].size = fmax(part[k].size, cabs(s->X[i * K + k]));
    }
    qsort(part, K, sizeof *part, by_size);
    f->count = s->count;
    while (f->count > 1 && sum + part[f->count - 1].size <= leave)
        sum += part[--f->count].size;
    for (int k = 0; k < f->count; k++) {
        f->kept[k] = part[k].at;
        f->omega[k] = torus_frequency(&s->tones, s->index[part[k].at]);
    }
    f->apart = DIFFERENCE * part[0].size;
    return find_rows(f, err);
}

/* Inputs' combinations, matrices, and room. */
static enum modal_status set_out(struct flow *f, const int *place, struct modal_error *err)
{
    const struct torus_solver *s = f->s;
    size_t K = (size_t)f->count, n = f->n, S = (size_t)f->stages, lane = 0;
    struct matrix to[3];

    f->lane = workspace_zeros(&f->space, (size_t)f->lanes * K, sizeof *f->lane);
    f->turn = workspace_zeros(&f->space, 2 * STEPS * S * block_of(f), sizeof *f->turn);
    f->left = workspace_zeros(&f->space, n, sizeof *f->left);
    f->seen = workspace_zeros(&f->space, (size_t)(f->lanes + f->inputs), sizeof *f->seen);
    f->wave = workspace_zeros(&f->space, (1 + S) * (size_t)f->rows, sizeof *f->wave);
    f->M = workspace_zeros(&f->space, 5 * n * n, sizeof *f->M);
    f->y = workspace_zeros(&f->space, 2 * n * f->columns, sizeof *f->y);
    f->W = workspace_zeros(&f->space, S * n * S * n, sizeof *f->W);
    f->A = workspace_zeros(&f->space, S * n * f->columns, sizeof *f->A);
    f->pivot = workspace_zeros(&f->space, S * n, sizeof *f->pivot);
    f->z = workspace_zeros(&f->space, f->places * (1 + 2 * f->columns) + 1, sizeof *f->z);
    f->Fz = workspace_zeros(&f->space, f->places * (2 * n + f->places) + 1, sizeof *f->Fz);
    if (f->space.failed)
        return workspace_check(&f->space, "torus: no memory for disturbances", err);
    f->hop = f->wave + f->rows;
    f->C = f->M + n * n, f->K = f->C + n * n, f->Ct = f->K + n * n, f->Kt = f->Ct + n * n;
    f->v = f->y + n * f->columns;
    f->zd = f->z + f->places, f->step = f->zd + f->places * f->columns;
    f->Zd = f->Fz + f->places * n, f->Zz = f->Zd + f->places * n;
    for (int a = 0; a < 3; a++) {
        to[a] = (struct matrix) { (int)n, (int)n, (int)n, f->M + (size_t)a * n * n };
        sparse_add_to_dense(&s->p->constant[a], 1, &to[a]);
    }
    for (int l = 0; l < s->p->laws; l++)
        for (int j = 0; j < s->p->law[l].kind->inputs; j++, lane++)
            for (int e = s->p->law[l].start[j]; e < s->p->law[l].start[j + 1]; e++)
                for (size_t k = 0; k < K; k++) {
                    const struct law_end *end = &s->p->law[l].end[e];
                    double complex X = s->X[(size_t)place[end->dof] * (size_t)s->count
                                            + (size_t)f->kept[k]];

                    f->lane[lane * K + k] += end->weight * X;
                }
    return MODAL_OK;
}

/* Exponents by falling size with errors, of growths with STEPS and twice as many, whose errors'
 * ratio is 1 + EVEN. */
static void sum_up(const double *coarse, const double *fine, size_t m, double even, double *value,
                   double *error)
{
    for (size_t j = 0; j < m; j++) {
        double off = (fine[j] - coarse[j]) / fmax(even, 1), halves = 0;

        for (size_t w = 1; w < WINDOWS; w++)
            halves = fmax(halves, fabs(fine[w * m + j] - fine[j]));
        value[j] = fine[j] + (even > 0 ? off : 0);
        error[j] = fabs(off) + halves;
    }
    for (size_t i = 1; i < m; i++)
        for (size_t j = i; j > 0 && value[j] > value[j - 1]; j--) {
            double v = value[j], e = error[j];

            value[j] = value[j - 1], error[j] = error[j - 1];
            value[j - 1] = v, error[j - 1] = e;
        }
}

/* The verdict on the exponents but those that are 0 anyway; none where these are not told from the
 * one that decides yet. */
static void judge(const struct torus_solver *s, struct torus_stability *out)
{
    bool own[TORUS_EXPONENTS] = { false };
    double most = 0;
    int first = 0;

    for (int n = (s->tone.index >= 0) + s->open; n > 0; n--) {
        int nearest = -1;

        for (int j = 0; j < out->count; j++)
            if (!own[j] && (nearest < 0 || fabs(out->exponent[j]) < fabs(out->exponent[nearest])))
                nearest = j;
        if (nearest >= 0) {
            own[nearest] = true;
            most = fmax(most, fabs(out->exponent[nearest]) + out->errors[nearest]);
        }
    }
    while (first < out->count && own[first])
        first++;
    out->margin = out->error = 0;
    out->verdict = 0;
    if (first == out->count)
        return;
    out->margin = -out->exponent[first];
    out->error = out->errors[first];
    if (fabs(out->margin) > fmax(SURE * out->error, most))
        out->verdict = out->margin > 0 ? 1 : -1;
}

void torus_judge_growth(const struct torus_solver *s, const double *growth, int turns, int columns,
                        struct torus_stability *out)
{
    double period = 2 * M_PI / s->tones.omega[s->tones.lead], weight[WINDOWS], sum[WINDOWS] = { 0 };
    double mean[WINDOWS * TORUS_EXPONENTS] = { 0 };

    for (int turn = 0; turn < turns; turn++) {
        windows_at(turn, turns, weight);
        for (int w = 0; w < WINDOWS; w++) {
            sum[w] += weight[w];
            for (int j = 0; j < columns; j++)
                mean[w * columns + j] += weight[w] / period * growth[turn * columns + j];
        }
    }
    for (int e = 0; e < WINDOWS * columns; e++)
        mean[e] /= sum[e / columns];
    *out = (struct torus_stability) { .count = columns };
    sum_up(mean, mean, (size_t)columns, 0, out->exponent, out->errors);
    judge(s, out);
}

/* The forces balanced; e is asked for then. */
static enum modal_status set_balance(struct flow *f, struct modal_error *err)
{
    struct torus_solver *s = f->s;
    size_t K = (size_t)s->count, kept = (size_t)f->count;
    double complex *F = workspace_zeros(&f->space, (size_t)s->q * K, sizeof *F);
    enum modal_status rc = workspace_check(&f->space, "torus: no memory for disturbances", err);

    if (rc == MODAL_OK)
        rc = torus_forces(s->laws, s->grid, s->count, s->index, s->X, s->count, s->index, F, err);
    for (size_t i = 0; rc == MODAL_OK && i < (size_t)s->q; i++)
        for (size_t k = 0; k < kept; k++)
            f->lane[((size_t)f->inputs + i) * kept + k] = F[i * K + (size_t)f->kept[k]];
    return rc;
}

/* Numbers of (5) that are gone through to make it, of both lengths of steps. */
static double made_of(const struct flow *f)
{
    return 3.0 * STEPS * f->stages * f->count * f->lanes;
}

/* And to see it, in the first length of turns. */
static double seen_of(const struct flow *f)
{
    return 3.0 * STEPS * f->stages * TURNS * (1 + 1.0 / SETTLING) * (double)block_of(f);
}

/* What steps cost in all, of the first length of turns, but for sums. */
static double work_of(const struct flow *f)
{
    double S = f->stages, n = S * (double)f->n;
    double steps = 3.0 * STEPS * TURNS * (1 + 1.0 / SETTLING);

    return steps * (n * n * n / BUDGET_DENSE + 4 * n * n
                    + S * BUDGET_SAMPLE * (double)f->s->p->laws
                    + BUDGET_SAMPLE * (double)f->places);
}

/* Exponents over more and more turns, from WORK and what sums take on, until they decide; *MISSED
 * as torus_judge has it: what two lengths of steps agree on. */
static enum modal_status follow(struct flow *f, double work, bool rests,
                                struct torus_stability *out, double *missed,
                                struct modal_error *err)
{
    struct torus_solver *s = f->s;
    double even = torus_smooth(s->laws) ? pow(2, gauss[f->stages - 1].order) - 1 : 0;
    double growth[2][WINDOWS * TORUS_EXPONENTS], e[2];
    double made = made_of(f), sums = seen_of(f);
    enum modal_status rc = MODAL_OK;

    for (int turns = TURNS; rc == MODAL_OK && out->verdict == 0 && work + sums + made <= WORK
                            && (out->count == 0
                                || s->work->spent + work + sums + made <= s->work->most);
         turns *= LONGER, work *= LONGER, sums *= LONGER) {
        budget_add(s->work, work);
        f->summed = 0;
        for (int i = 0; rc == MODAL_OK && i < 2; i++) {
            rc = grow(f, turns, STEPS << i, growth[i], err);
            e[i] = f->most;
        }
        budget_add(s->work, f->summed);
        if (rc != MODAL_OK)
            break;
        out->count = (int)f->m;
        sum_up(growth[0], growth[1], f->m, even, out->exponent, out->errors);
        judge(s, out);
        *missed = fmax(0, e[1] - fabs(e[1] - e[0]));
        if (rests && out->verdict > 0) {
            *out = (struct torus_stability) { .reason = TORUS_RESTS };
            break;
        }
    }
    if (out->verdict < 0)
        *missed = 0;
    return rc;
}

enum modal_status torus_judge(struct torus_solver *s, const int *place, struct torus_stability *out,
                              double leave, double *missed, struct modal_error *err)
{
    struct flow f = { .s = s, .n = (size_t)s->p->n };
    bool rests = false;
    double work;
    enum modal_status rc;

    *out = (struct torus_stability) { 0 };
    *missed = 0;
    for (int l = 0; l < s->p->laws; l++)
        rests = rests || torus_undetermined(s->laws, l);
    f.m = 2 * f.n < TORUS_EXPONENTS ? 2 * f.n : TORUS_EXPONENTS;
    f.columns = f.m + (s->marched == 0 && !rests && s->tone.index < 0 && s->grid != NULL);
    f.places = places_of(s->p);
    rc = choose(&f, leave, err);
    f.stages = f.places > 0 ? 1 : STAGES_MOST;
    if (work_of(&f) + seen_of(&f) + made_of(&f) > WORK)
        f.stages = 1;
    work = work_of(&f);
    if (work + seen_of(&f) + made_of(&f) > WORK)
        out->reason = "of so many dofs, laws and combinations disturbances are not followed";
    if (s->p->n_linear > 0)
        out->reason = "linear states are not followed beside a motion of tones";
    if (rc == MODAL_OK && out->reason == NULL)
        rc = set_out(&f, place, err);
    if (rc == MODAL_OK && out->reason == NULL && f.columns > f.m)
        rc = set_balance(&f, err);
    if (rc == MODAL_OK && out->reason == NULL)
        rc = follow(&f, work, rests, out, missed, err);
    workspace_free(&f.space);
    return rc;
}
