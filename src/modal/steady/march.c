/*
 * march.c - time integration to a periodic motion
 *
 * y' = g(t, y), y = (x, v), the laws' memory m carried from step to step: the stages of a step see
 * m at its start, and the step's end writes it.  Fixed steps use the classical Runge-Kutta method;
 * adaptive ones the pair of [DP80], its step from err^(-1/5).  Friction's turning points fall
 * inside steps, which both then take with an error of O(h^2): that is the comparison.  Shooting
 * solves y(T; y0) = y0 by Newton's method with difference quotients over (y, m).
 *
 * A step of s stages is
 *
 *     k_i = g(t + c_i h, y + h sum_{j<i} a_ij k_j),   y(t + h) = y + h sum_i b_i k_i,           (1)
 *
 * and the pair's error h sum_i e_i k_i, e of dp_error; steps are h' = 0.9 h (tolerance /
 * error)^(1/5).  With P the map of (y, m) over a period, shooting's step is
 *
 *     (I - dP/ds) ds = P(s) - s,                                                                (2)
 *
 * one period a column of dP/ds.
 *
 * [DP80] Dormand, Prince, J. Comp. Appl. Math. 6 (1980) 19-26.
 */
#include "modal/steady/march.h"
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"

/* What a step needs; STAGES of the larger pair, of which rk4 uses four. */
enum { STAGES = 7 };

/* Steps are chosen for this share of the tolerance, so that few are rejected. */
static const double SAFETY = 0.9;
/* One step is at most five times as long as the last, and at least a fifth: the error's estimate is
 * of one order and says no more. */
static const double FACTOR_MOST = 5;
static const double FACTOR_LEAST = 0.2;
/* A step this short against the time reached is accepted whatever its error: a law that jumps. */
static const double STEP_LEAST = 1e-12;
/* Of the largest state, a shooting difference: between the rounding of a period's map, near
 * adapt's tolerance, and its curvature. */
static const double DIFFERENCE = 1e-6;
enum {
    ORDER = 5,          /* of the step's local error in h */
    STEPS_FIRST = 64,   /* a period, until adapt has found its own */
    NEWTON_MOST = 30    /* of shooting; each takes one period and one a state */
};

struct march {
    const struct program *p;           /* borrowed */
    double omega;                      /* rad/s */
    int n, states, memory;             /* states = 2n */
    double *Minv;                      /* n x n */
    double *m, *m_next;                /* the laws' memory: at the step's start; scratch */
    double *force;                     /* n: p - C v - K x - laws */
    double *y, *k[STAGES], *trial;
    long evaluations;                  /* of all laws together */
    struct workspace space;            /* of the arrays */
};

/* Room, of w->space, and the inverse of the mass. */
static enum modal_status march_init(struct march *w, struct modal_error *err)
{
    size_t n = (size_t)w->n;
    struct matrix M;
    int *pivot;
    bool singular;

    for (int l = 0; l < w->p->laws; l++)
        w->memory += w->p->law[l].memory;
    w->states = 2 * w->n;
    w->Minv = workspace_zeros(&w->space, n * n, sizeof(double));
    w->m = workspace_zeros(&w->space, (size_t)w->memory, sizeof(double));
    w->m_next = workspace_zeros(&w->space, (size_t)w->memory, sizeof(double));
    w->force = workspace_zeros(&w->space, n, sizeof(double));
    w->y = workspace_zeros(&w->space, 2 * n, sizeof(double));
    w->trial = workspace_zeros(&w->space, 2 * n, sizeof(double));
    for (int i = 0; i < STAGES; i++)
        w->k[i] = workspace_zeros(&w->space, 2 * n, sizeof(double));
    pivot = workspace_zeros(&w->space, n, sizeof *pivot);
    if (w->space.failed)
        return modal_fail(err, MODAL_NO_MEMORY, "march: no memory for %d dofs", w->n);
    M = (struct matrix) { w->n, w->n, w->n, w->Minv };
    sparse_add_to_dense(&w->p->constant[PROGRAM_M], 1, &M);
    singular = LAPACKE_dgetrf(LAPACK_COL_MAJOR, w->n, w->n, w->Minv, w->n, pivot) != 0
            || LAPACKE_dgetri(LAPACK_COL_MAJOR, w->n, w->Minv, w->n, pivot) != 0;
    return singular ? modal_fail_field(err, MODAL_BAD_INPUT, "structure",
                                       "the mass is singular: time integration does not apply")
                    : MODAL_OK;
}

/* The laws' forces subtracted from w->force; memory after into w->m_next. */
static enum modal_status law_forces(struct march *w, double t, const double *y,
                                    struct modal_error *err)
{
    int at = 0;

    for (int l = 0; l < w->p->laws; l++) {
        const struct law *law = &w->p->law[l];
        double d[LAW_INPUTS_MOST], v[LAW_INPUTS_MOST];
        struct law_point point = { t, d, v, w->m + at };
        struct law_force f = { .alone = true, .memory = w->m_next + at };
        enum modal_status rc;

        for (int j = 0; j < law->kind->inputs; j++) {
            d[j] = law_sees(law, j, y);
            v[j] = law_sees(law, j, y + w->n);
        }
        /* memory from the step's start, so that stages repeat */
        rc = law->kind->force(law, &point, &f, err);
        if (rc != MODAL_OK)
            return rc;
        for (int j = 0; j < law->kind->inputs; j++)
            law_push(law, j, -f.f[j], w->force);
        w->evaluations++;
        at += law->memory;
    }
    return MODAL_OK;
}

/*
 * y' = (v, M^-1 (p(t) - C(t) v - K(t) x - sum of the laws' forces)), (1) of program.h without its
 * linear states; the mass is constant here and its inverse dense.
 */
static enum modal_status rate(struct march *w, double t, const double *y, double *out,
                              struct modal_error *err)
{
    int n = w->n;
    enum modal_status rc;

    memset(w->force, 0, (size_t)n * sizeof *w->force);
    for (int i = 0; i < w->p->loads; i++) {
        const struct program_load *load = &w->p->load[i];

        double force =
            load->cosine * cos(load->k * w->omega * t) + load->sine * sin(load->k * w->omega * t);

        if (load->dof_sine >= 0) {                     /* fixed in space on turning axes */
            /* (4) of condense.c, in time */
            w->force[load->dof_sine] += load->turn * force * sin(w->p->frame_speed * t);
            force *= cos(w->p->frame_speed * t);
        }
        w->force[load->dof] += force;
    }
    sparse_multiply_add(&w->p->constant[PROGRAM_C], -1, y + n, w->force);
    sparse_multiply_add(&w->p->constant[PROGRAM_K], -1, y, w->force);
    for (int h = 0; h < w->p->harmonics; h++) {
        const struct program_harmonic *a = &w->p->harmonic[h];
        /* periodic matrices at t */
        double c = cos(a->k * w->omega * t), s = sin(a->k * w->omega * t);

        if (a->cosine[PROGRAM_K].start != NULL)
            sparse_multiply_add(&a->cosine[PROGRAM_K], -c, y, w->force);
        if (a->sine[PROGRAM_K].start != NULL)
            sparse_multiply_add(&a->sine[PROGRAM_K], -s, y, w->force);
        if (a->cosine[PROGRAM_C].start != NULL)
            sparse_multiply_add(&a->cosine[PROGRAM_C], -c, y + n, w->force);
        if (a->sine[PROGRAM_C].start != NULL)
            sparse_multiply_add(&a->sine[PROGRAM_C], -s, y + n, w->force);
    }
    rc = law_forces(w, t, y, err);
    for (int i = 0; i < n; i++) {
        double sum = 0;

        for (int j = 0; j < n; j++)
            sum += w->Minv[j * n + i] * w->force[j];    /* M^-1 times what is left */
        out[i] = y[n + i];                              /* x' = v */
        out[n + i] = sum;
    }
    return rc;
}

/* The step's end: memory from its start to now, at the new y. */
static enum modal_status commit(struct march *w, double t, struct modal_error *err)
{
    enum modal_status rc = law_forces(w, t, w->y, err);

    /* Stages saw the memory at the step's start; now it is that of its end. */
    memcpy(w->m, w->m_next, (size_t)w->memory * sizeof *w->m);
    for (int i = 0; rc == MODAL_OK && i < w->states; i++)
        if (!isfinite(w->y[i]))
            return modal_fail(err, MODAL_OVERFLOW,
                              "march: the motion left the range of doubles at t = %.6g s", t);
    return rc;
}

/* The classical method: a weight of 1, 2, 2, 1 sixths, local error h^5. */
static enum modal_status step_rk4(struct march *w, double t, double h, struct modal_error *err)
{
    static const double at[4] = { 0, 0.5, 0.5, 1 };
    enum modal_status rc = MODAL_OK;

    for (int s = 0; rc == MODAL_OK && s < 4; s++) {
        for (int i = 0; i < w->states; i++)
            /* each stage from the one before */
            w->trial[i] = w->y[i] + (s > 0 ? h * at[s] * w->k[s - 1][i] : 0);
        rc = rate(w, t + at[s] * h, w->trial, w->k[s], err);
    }
    for (int i = 0; i < w->states; i++)
        /* the four slopes */
        w->y[i] += h / 6 * (w->k[0][i] + 2 * w->k[1][i] + 2 * w->k[2][i] + w->k[3][i]);
    return rc == MODAL_OK ? commit(w, t + h, err) : rc;
}

/* The pair of [DP80]: nodes, stages (the last is the fifth-order step itself), and the difference
 * of the fifth- and fourth-order weights. */
static const double dp_c[STAGES] = { 0, 1.0 / 5, 3.0 / 10, 4.0 / 5, 8.0 / 9, 1, 1 };
static const double dp_a[STAGES][STAGES - 1] = {
    { 0 }, { 1.0 / 5 }, { 3.0 / 40, 9.0 / 40 }, { 44.0 / 45, -56.0 / 15, 32.0 / 9 },
    { 19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729 },
    { 9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656 },
    { 35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84 } };
static const double dp_error[STAGES] = { 71.0 / 57600,      0,          -71.0 / 16695, 71.0 / 1920,
                                    -17253.0 / 339200, 22.0 / 525, -1.0 / 40 };

/* From t to END in steps that keep the error estimate below tolerance times the scales; *H the step
 * to begin with, and after. */
static enum modal_status adapt(struct march *w, double t, double end, double tolerance,
                               double *scale, double *h, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && t < end * (1 - 4 * DBL_EPSILON)) {
        double step = fmin(*h, end - t), worst = 0, factor;

        for (int s = 0; rc == MODAL_OK && s < STAGES; s++) {
            for (int i = 0; i < w->states; i++) {
                double sum = 0;

                for (int j = 0; j < s; j++)
                    sum += dp_a[s][j] * w->k[j][i];
                w->trial[i] = w->y[i] + step * sum;
            }
            rc = rate(w, t + dp_c[s] * step, w->trial, w->k[s], err);
        }
        for (int i = 0; i < w->states; i++) {
            double e = 0;

            for (int s = 0; s < STAGES; s++)
                e += dp_error[s] * w->k[s][i];
            scale[i >= w->n] = fmax(scale[i >= w->n], fabs(w->trial[i]));
            /* displacements and rates by scales of their own */
            worst = fmax(worst, fabs(step * e) / (tolerance * fmax(scale[i >= w->n], DBL_MIN)));
        }
        factor = worst > 0 ? SAFETY * pow(worst, -1.0 / ORDER) : FACTOR_MOST;
        /* The step is taken: its end was the last stage. */
        if (worst <= 1 || step < STEP_LEAST * end) {
            memcpy(w->y, w->trial, (size_t)w->states * sizeof *w->y);
            t += step;
            rc = rc == MODAL_OK ? commit(w, t, err) : rc;
        }
        if (worst > 1 || step == *h)
            *h = step * fmin(FACTOR_MOST, fmax(FACTOR_LEAST, factor));
    }
    return rc;
}

/* One period from the state in w; samples into x. */
static enum modal_status one_period(struct march *w, const struct march_options *opt, double *x,
                                    double *scale, double *h, struct modal_error *err)
{
    double T = 2 * M_PI / w->omega;                     /* the period */
    int N = opt->samples;
    enum modal_status rc = MODAL_OK;

    for (int j = 0; rc == MODAL_OK && j < N; j++) {
        for (int i = 0; i < w->n; i++)
            x[(size_t)i * (size_t)N + (size_t)j] = w->y[i];
        rc = opt->method == MARCH_ADAPTIVE
                 ? adapt(w, T * j / N, T * (j + 1) / N, opt->tolerance, scale, h, err)
                 : step_rk4(w, T * j / N, T / N, err);
    }
    return rc;
}

/* max |a - b| over max |a|. */
static double difference(const double *a, const double *b, size_t n)
{
    double most = 0, scale = 0;

    for (size_t i = 0; i < n; i++) {
        most = fmax(most, fabs(a[i] - b[i]));
        scale = fmax(scale, fabs(a[i]));
    }
    return scale > 0 ? most / scale : 0;                /* a motion that is 0 repeats */
}

/* Periods from rest until one repeats the last to opt->periodic: transients die as damping lets
 * them. */
static enum modal_status to_periodicity(struct march *w, const struct march_options *opt, double *x,
                                        struct march_report *report, struct modal_error *err)
{
    size_t size = (size_t)w->n * (size_t)opt->samples;
    double *last = malloc((size + 1) * sizeof *last), scale[2] = { 0, 0 },
           h = 2 * M_PI / w->omega / STEPS_FIRST;
    enum modal_status rc =
        last == NULL ? modal_fail(err, MODAL_NO_MEMORY, "march: no memory") : MODAL_OK;

    while (rc == MODAL_OK && !report->converged && report->periods < MARCH_PERIODS_MOST) {
        if (opt->cancelled != NULL && opt->cancelled(opt->context)) {
            rc = modal_fail(err, MODAL_CANCELLED, "cancelled");
            break;
        }
        memcpy(last, x, size * sizeof *last);
        rc = one_period(w, opt, x, scale, &h, err);
        report->periods++;
        report->change = difference(x, last, size);
        report->converged = report->periods > 1 && report->change <= opt->periodic;
    }
    free(last);
    return rc;
}

/* The state that the period map acts on: y, then the laws' memory. */
static void get_state(const struct march *w, double *s)
{
    memcpy(s, w->y, (size_t)w->states * sizeof *s);
    /* disturbances of a memory are states, too */
    memcpy(s + w->states, w->m, (size_t)w->memory * sizeof *s);
}

/* Back. */
static void put_state(struct march *w, const double *s)
{
    memcpy(w->y, s, (size_t)w->states * sizeof *s);
    memcpy(w->m, s + w->states, (size_t)w->memory * sizeof *s);
}

/* Newton's method on the period map, after two periods of marching. */
struct shooting {
    int n;                            /* states and memory */
    double *s, *end, *J, *moved;      /* start, where its period ends, I - dP/ds, work; n, n, n x
                                       * n, n */
    int *pivot;
    double scale[2], h, size;         /* adapt's; max |s| */
    struct workspace space;           /* of the arrays */
};

/* Room for N states and memories, of g->space. */
static enum modal_status shooting_init(struct shooting *g, int n, struct modal_error *err)
{
    size_t m = (size_t)n;

    *g = (struct shooting){ .n = n };
    g->s = workspace_zeros(&g->space, m, sizeof *g->s);
    g->end = workspace_zeros(&g->space, m, sizeof *g->end);
    g->J = workspace_zeros(&g->space, m * m, sizeof *g->J);
    g->moved = workspace_zeros(&g->space, m, sizeof *g->moved);
    g->pivot = workspace_zeros(&g->space, m, sizeof *g->pivot);
    return workspace_check(&g->space, "march: no memory", err);
}

/* A period from FROM, its end into TO. */
static enum modal_status shoot_period(struct march *w, struct shooting *g,
                                      const struct march_options *opt, const double *from,
                                      double *to, double *x, struct modal_error *err)
{
    enum modal_status rc;

    put_state(w, from);
    rc = one_period(w, opt, x, g->scale, &g->h, err);
    get_state(w, to);
    return rc;
}

/* The period map at g->s and its derivative by differences. */
static enum modal_status shooting_map(struct march *w, struct shooting *g,
                                      const struct march_options *opt, double *x,
                                      struct march_report *report, struct modal_error *err)
{
    size_t m = (size_t)g->n;
    enum modal_status rc = shoot_period(w, g, opt, g->s, g->end, x, err);
    double dx;

    g->size = 0;
    for (int i = 0; i < g->n; i++)
        g->size = fmax(g->size, fabs(g->s[i]));
    dx = DIFFERENCE * (g->size > 0 ? g->size : 1);
    for (size_t c = 0; rc == MODAL_OK && c < m; c++) {
        memcpy(g->moved, g->s, m * sizeof *g->moved);
        g->moved[c] += dx;                              /* one column of dP/ds */
        rc = shoot_period(w, g, opt, g->moved, g->moved, x, err);
        for (size_t i = 0; i < m; i++)
            g->J[c * m + i] = (i == c ? 1 : 0) - (g->moved[i] - g->end[i]) / dx;  /* I - dP/ds */
    }
    report->periods += 1 + g->n;                        /* a period a column, and one at s */
    return rc;
}

/* Newton's step of the period map; false where I - dP/ds is singular. */
static bool shooting_step(struct shooting *g, struct march_report *report)
{
    double step = 0;

    for (int i = 0; i < g->n; i++)
        g->moved[i] = g->end[i] - g->s[i];              /* P(s) - s */
    if (LAPACKE_dgesv(LAPACK_COL_MAJOR, g->n, 1, g->J, g->n, g->pivot, g->moved, g->n) != 0)
        return false;
    for (int i = 0; i < g->n; i++) {
        g->s[i] += g->moved[i];
        step = fmax(step, fabs(g->moved[i]));
    }
    report->change = g->size > 0 ? step / g->size : step;
    return true;
}

/* Two periods to come near, then Newton's method on P(s) - s = 0. */
static enum modal_status shoot(struct march *w, const struct march_options *opt, double *x,
                               struct march_report *report, struct modal_error *err)
{
    struct shooting g;
    enum modal_status rc = shooting_init(&g, w->states + w->memory, err);

    for (int i = 0; rc == MODAL_OK && i < 2; i++)
        rc = one_period(w, opt, x, g.scale, &g.h, err);
    if (rc == MODAL_OK)
        get_state(w, g.s);
    /* Each step costs a period a state: 30 of them are more than any that converges needs. */
    for (report->periods = 2;
         rc == MODAL_OK && !report->converged && report->periods < 2 + NEWTON_MOST * (g.n + 1);) {
        rc = shooting_map(w, &g, opt, x, report, err);
        if (rc != MODAL_OK || !shooting_step(&g, report))
            break;
        if (report->change <= opt->periodic) {
            rc = shoot_period(w, &g, opt, g.s, g.end, x, err);
            report->converged = rc == MODAL_OK;
        }
    }
    workspace_free(&g.space);
    return rc;
}

enum modal_status march_run(const struct program *p, double omega, const struct march_options *opt,
                            double *x, struct march_report *report, struct modal_error *err)
{
    struct march w = { .p = p, .omega = omega, .n = p->n };
    enum modal_status rc;

    memset(report, 0, sizeof *report);
    if (p->n > MARCH_DOFS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "structure",
                                "%d dofs; time integration takes at most %d", p->n,
                                MARCH_DOFS_MOST);
    if (p->n_linear > 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "method",
                                "time integration here takes no linear states of effects");
    for (int l = 0; l < p->laws; l++)
        if (p->law[l].kind->set_valued)
            return modal_fail_field(
                err, MODAL_BAD_INPUT, "method",
                "rigid friction has no rate to integrate here; accepted: auto, direct, newton");
    memset(x, 0, (size_t)p->n * (size_t)opt->samples * sizeof *x);
    rc = march_init(&w, err);
    if (rc == MODAL_OK)
        rc = opt->method == MARCH_SHOOTING ? shoot(&w, opt, x, report, err)
                                           : to_periodicity(&w, opt, x, report, err);
    report->evaluations = p->laws > 0 ? w.evaluations / p->laws : 0;
    workspace_free(&w.space);
    return rc;
}
