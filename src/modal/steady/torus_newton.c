/*
 * torus_newton.c - one balance of combinations solved; tested by
 * tests/unit/modal/steady/test_torus.c
 *
 * Newton's step solves J delta = -R by GMRES [SS86], J's products by difference quotients of the
 * forces alone, S being known, so that what sliders remember is in them.  The preconditioner is the
 * dense derivative of the combinations that come first (torus_derivative) and, of the others, S_k
 * with the laws' mean slopes; norms are of preconditioned residuals, which are motions.
 *
 * [SS86] Saad and Schultz, SIAM J. Sci. Stat. Comput. 7 (1986) 856-869.
 */
#include "modal/steady/torus_state.h"
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/simulate.h"
#include "modal/steady/condense.h"
#include "modal/steady/torus_laws.h"

enum {
    KRYLOV_MOST = 40,          /* vectors of GMRES: past them the step is no Newton's */
    ITERATIONS_USUAL = 60,     /* as with one tone */
    HALVINGS_MOST = 8,         /* of a Newton step, or of a step of the loads' level */
    MARCH_TURNS = 200,         /* of the fastest tone, to settle and again to look: what is lighter
                                * damped still shows where to begin */
    MARCH_SAMPLES = 16,        /* of a turn: some eight harmonics, more than a start needs */
};
static const double DIFFERENCE = 1e-6;    /* relative: between rounding and curvature */
static const double LITTLE = 1e-6;        /* of the stiffness at the leading tone: far above
                                           * rounding, and far below a law that holds */
static const double FORCING = 0.03;       /* of a Newton step's own equation: a few more steps
                                           * for far fewer products */
static const double MARCH_WORK = 1.2e9;   /* budget.h: of a march, less than half of all */
static const double MARCH_TOLERANCE = 1e-4;   /* of a start */
static const double TOLD = 0.9;           /* of a record's highest frequency: what folds back from
                                           * as far beyond is little */
static const double FLOOR = 1e-8;         /* a relative step that no longer shrinks is the floor
                                           * of differences and located events */
static const double FAR = 0.25;           /* of a free tone: further a step does not take it */
static const double SHRINKS = 0.25;       /* of the step before: it still does */
static const double ENOUGH = 0.01;        /* relative: a last step, as torus_solve.c's ROUGH */

/* sum over all, as real numbers. */
static double dot(size_t n, const double complex *a, const double complex *b)
{
    double sum = 0;

    for (size_t i = 0; i < n; i++)
        sum += creal(a[i]) * creal(b[i]) + cimag(a[i]) * cimag(b[i]);
    return sum;
}

static double norm(size_t n, const double complex *a) { return sqrt(dot(n, a, a)); }

static bool cancelled(const struct torus_solver *s)
{
    return s->opt->cancelled != NULL && s->opt->cancelled(s->opt->context);
}

/* Whether no more work may be begun; of a balance that is to be told, beside its estimate. */
static bool is_over(const struct torus_solver *s) { return !budget_pays(s->work, s->ahead); }

/* Forces of X at the set's combinations into F. */
static enum modal_status forces(struct torus_solver *s, const double complex *X, double complex *F,
                                struct modal_error *err)
{
    if (cancelled(s))
        return modal_fail(err, MODAL_CANCELLED, "cancelled");
    return torus_forces(s->laws, s->grid, s->count, s->index, X, s->count, s->index, F, err);
}

/* What an estimate at s->X will cost, of the last forces, is kept back where one follows. */
static void keep_back(struct torus_solver *s) { s->ahead = s->told ? torus_estimate_work(s) : 0; }

/* The same as forces, and what they cost. */
static enum modal_status ask(struct torus_solver *s, const double complex *X, double complex *F,
                             struct modal_error *err)
{
    double before = s->work->spent;
    enum modal_status rc = forces(s, X, F, err);

    s->asking = s->work->spent - before;
    return rc;
}

/* y = S x of all combinations; the mean's is real. */
static void apply_linear(const struct torus_solver *s, const double complex *x, double complex *y)
{
    size_t K = (size_t)s->count, q = (size_t)s->q;

    for (size_t m = 0; m < K; m++)
        for (size_t i = 0; i < q; i++) {
            double complex sum = 0;

            for (size_t j = 0; j < q; j++)
                sum += s->linear[m].S[j * q + i] * x[j * K + m];
            y[i * K + m] = m == 0 ? creal(sum) : sum;
        }
}

/* s->R of X, whose forces are F. */
static void residual_of(struct torus_solver *s, const double complex *X, const double complex *F)
{
    size_t K = (size_t)s->count;

    apply_linear(s, X, s->R);
    for (size_t i = 0; i < (size_t)s->q; i++)
        for (size_t m = 0; m < K; m++)
            s->R[i * K + m] += F[i * K + m] - s->level * s->linear[m].p[i];
}

/* max |R| over the largest of S X, F and p. */
static double relative_residual(const struct torus_solver *s, const double complex *work)
{
    double most = 0, scale = 0;
    size_t K = (size_t)s->count;

    for (size_t i = 0; i < (size_t)s->q; i++)
        for (size_t m = 0; m < K; m++) {
            most = fmax(most, cabs(s->R[i * K + m]));
            scale = fmax(scale, fmax(cabs(s->F[i * K + m]),
                                     fmax(cabs(work[i * K + m]),
                                          s->level * cabs(s->linear[m].p[i]))));
        }
    return scale > 0 ? most / scale : 0;
}

/* What the balance at s->X, held memory, gains with the free tone's frequency and gain. */
static enum modal_status slopes(struct torus_solver *s, struct modal_error *err)
{
    struct torus_tone *t = &s->tone;
    size_t K = (size_t)s->count, n = (size_t)s->q * K;
    double h = DIFFERENCE * t->omega_kept, size = norm(n, s->X);
    double complex *F = malloc(n * sizeof *F + 1), *y = malloc(n * sizeof *y + 1);
    enum modal_status rc = MODAL_OK;

    free(t->by_omega), free(t->by_gain);
    t->by_omega = calloc(n + 1, sizeof *t->by_omega);
    t->by_gain = calloc(n + 1, sizeof *t->by_gain);
    if (F == NULL || y == NULL || t->by_omega == NULL || t->by_gain == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a free tone");
    t->unit = 1 / fmax(size, 1e-300);
    torus_hold(s->laws, true);
    for (int sign = -1; rc == MODAL_OK && sign <= 1; sign += 2) {
        rc = torus_tone_move(s, t->omega_kept + sign * h, t->gain_kept, err);
        if (rc == MODAL_OK)
            rc = forces(s, s->X, F, err);
        if (rc == MODAL_OK)
            apply_linear(s, s->X, y);
        for (size_t i = 0; rc == MODAL_OK && i < n; i++)
            t->by_omega[i] += sign * t->omega_kept * t->unit / (2 * h) * (y[i] + F[i]);
    }
    torus_hold(s->laws, false);
    if (rc == MODAL_OK)
        rc = torus_tone_move(s, t->omega_kept, t->gain_kept, err);
    for (size_t i = 0; rc == MODAL_OK && i < n; i++)
        t->by_gain[i] = I * t->unit * s->index[i % K].k[t->index] * t->damping[i / K] * s->X[i];
    free(F);
    free(y);
    return rc;
}

/* The columns of the free tone's place in the dense derivative. */
static void put_slopes(struct torus_solver *s, size_t n)
{
    const struct torus_tone *t = &s->tone;
    size_t order = (size_t)s->q * n, K = (size_t)s->count;
    double *im = s->J + ((size_t)t->lead * n + 2 * (size_t)t->at) * order, *re = im - order;

    for (size_t i = 0; i < (size_t)s->q; i++)
        for (size_t m = 0; m < (size_t)s->core; m++) {
            size_t row = i * n + (m > 0 ? 2 * m - 1 : 0);

            im[row] = creal(t->by_omega[i * K + m]);
            if (m > 0)
                im[row + 1] = cimag(t->by_omega[i * K + m]);
            if (!t->held)
                continue;
            re[row] = creal(t->by_gain[i * K + m]);
            if (m > 0)
                re[row + 1] = cimag(t->by_gain[i * K + m]);
        }
}

/* S with the laws' mean slopes of all combinations past the core, factored. */
static enum modal_status factor_outer(struct torus_solver *s, bool *regular,
                                      struct modal_error *err)
{
    size_t q = (size_t)s->q, others = (size_t)(s->count - s->core);
    double *mean = calloc(2 * q * q + 1, sizeof *mean);

    free(s->outer), free(s->outer_pivot);
    s->outer = malloc((others * q * q + 1) * sizeof *s->outer);
    s->outer_pivot = malloc((others * q + 1) * sizeof *s->outer_pivot);
    if (mean == NULL || s->outer == NULL || s->outer_pivot == NULL) {
        free(mean);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a preconditioner");
    }
    torus_mean_slopes(s->laws, mean, mean + q * q);
    for (size_t m = 0; *regular && m < others; m++) {
        const struct torus_linear *l = &s->linear[(size_t)s->core + m];
        double w = torus_frequency(&s->tones, s->index[(size_t)s->core + m]);
        double complex *to = s->outer + m * q * q;

        for (size_t e = 0; e < q * q; e++)
            to[e] = l->S[e] + CMPLX(mean[e], w * mean[q * q + e]);
        *regular = LAPACKE_zgetrf_work(LAPACK_COL_MAJOR, s->q, s->q, to, s->q,
                                       s->outer_pivot + m * q) == 0;
    }
    budget_add(s->work, (double)others * 8 * pow(s->q, 3) / (3 * BUDGET_DENSE));
    free(mean);
    return MODAL_OK;
}

/* A little stiffness for the mean along what the structure leaves open, into s->J: where no law
 * holds it either it may be anywhere, and there J is singular.  Its products are without it, so the
 * solution is where it was. */
static void stiffen_ways(struct torus_solver *s, size_t n)
{
    size_t q = (size_t)s->q, order = q * n;

    for (int w = 0; w < s->ways; w++)
        for (size_t i = 0; i < q; i++)
            for (size_t j = 0; j < q; j++)
                s->J[j * n * order + i * n] += LITTLE * pow(s->unit[i] * s->unit[j], 2)
                    * s->way[(size_t)w * q + i] * s->way[(size_t)w * q + j];
}

/* Numbers of the dense derivative at the most: so many that a factorization costs what the products
 * of a step without it may, and TORUS_CORE_LEAST anyway. */
static int core_most(const struct torus_solver *s)
{
    double points = (double)torus_grid_lines(s->grid) * torus_grid_samples(s->grid);
    double product = points * s->p->laws * BUDGET_SAMPLE * 0.75;

    return (int)fmin(fmax(cbrt(3.0 * BUDGET_DENSE * KRYLOV_MOST * product), TORUS_CORE_LEAST),
                     TORUS_CORE_MOST);
}

/* The preconditioner at the motion of the last forces: false where it is singular. */
static enum modal_status precondition_new(struct torus_solver *s, bool *regular,
                                          struct modal_error *err)
{
    int core = s->count, most = core_most(s), n, order;
    size_t q = (size_t)s->q;

    while (core > 1 && s->q * (2 * core - 1) > most)
        core--;
    n = 2 * core - 1, order = s->q * n;
    free(s->J), free(s->pivot);
    s->core = core;
    s->J = calloc((size_t)order * (size_t)order + 1, sizeof *s->J);
    s->pivot = malloc(((size_t)order + 1) * sizeof *s->pivot);
    if (s->J == NULL || s->pivot == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a derivative of %d", order);
    for (size_t i = 0; i < q; i++)
        for (size_t j = 0; j < q; j++)
            for (int m = 0; m < core; m++) {
                double complex S = s->linear[m].S[j * q + i];
                size_t r = i * (size_t)n + (m > 0 ? (size_t)(2 * m - 1) : 0);
                size_t c = j * (size_t)n + (m > 0 ? (size_t)(2 * m - 1) : 0);
                double *to = s->J + c * (size_t)order + r;

                to[0] += creal(S);
                if (m > 0) {
                    to[1] += cimag(S);
                    to[order] -= cimag(S), to[order + 1] += creal(S);
                }
            }
    torus_derivative(s->laws, s->grid, core, s->index, s->J);
    stiffen_ways(s, (size_t)n);
    if (s->tone.index >= 0) {
        enum modal_status rc = slopes(s, err);

        if (rc != MODAL_OK)
            return rc;
        put_slopes(s, (size_t)n);
    }
    *regular = order > 0
        && LAPACKE_dgetrf_work(LAPACK_COL_MAJOR, order, order, s->J, order, s->pivot) == 0;
    budget_add(s->work, pow(order, 3) / (3 * BUDGET_DENSE));
    return factor_outer(s, regular, err);
}

void torus_precondition(const struct torus_solver *s, double complex *x)
{
    size_t K = (size_t)s->count, q = (size_t)s->q, n = 2 * (size_t)s->core - 1;
    double *u = malloc(q * n * sizeof *u);
    double complex *column = malloc(q * sizeof *column);

    if (u == NULL || column == NULL) {            /* as it is: GMRES goes on without */
        free(u), free(column);
        return;
    }
    for (size_t i = 0; i < q; i++)
        for (size_t m = 0; m < (size_t)s->core; m++) {
            u[i * n + (m > 0 ? 2 * m - 1 : 0)] = creal(x[i * K + m]);
            if (m > 0)
                u[i * n + 2 * m] = cimag(x[i * K + m]);
        }
    LAPACKE_dgetrs_work(LAPACK_COL_MAJOR, 'N', (int)(q * n), 1, s->J, (int)(q * n), s->pivot, u,
                        (int)(q * n));
    for (size_t i = 0; i < q; i++)
        for (size_t m = 0; m < (size_t)s->core; m++)
            x[i * K + m] = CMPLX(u[i * n + (m > 0 ? 2 * m - 1 : 0)], m > 0 ? u[i * n + 2 * m] : 0);
    for (size_t m = (size_t)s->core; m < K; m++) {
        for (size_t i = 0; i < q; i++)
            column[i] = x[i * K + m];
        LAPACKE_zgetrs_work(LAPACK_COL_MAJOR, 'N', s->q, 1,
                            s->outer + (m - (size_t)s->core) * q * q, s->q,
                            s->outer_pivot + (m - (size_t)s->core) * q, column, s->q);
        for (size_t i = 0; i < q; i++)
            x[i * K + m] = column[i];
    }
    free(u);
    free(column);
}

/* y = P^-1 J v at s->X, whose forces are s->F; SCRATCH: three vectors. */
static enum modal_status apply(struct torus_solver *s, const double complex *v, double complex *y,
                               double complex *scratch, struct modal_error *err)
{
    size_t n = (size_t)s->q * (size_t)s->count;
    double size = norm(n, s->X), e = DIFFERENCE * (size > 0 ? size : 1) / fmax(norm(n, v), 1e-300);
    double complex *X = scratch, *F = scratch + n, *u = scratch + 2 * n, tone;
    enum modal_status rc;

    memcpy(u, v, n * sizeof *u);
    tone = torus_tone_take(s, u);
    for (size_t i = 0; i < n; i++)
        X[i] = s->X[i] + e * u[i];
    torus_hold(s->laws, true);
    rc = forces(s, X, F, err);
    torus_hold(s->laws, false);
    if (rc != MODAL_OK)
        return rc;
    apply_linear(s, u, y);
    for (size_t i = 0; i < n; i++)
        y[i] += (F[i] - s->F[i]) / e;
    for (size_t i = 0; s->tone.index >= 0 && i < n; i++)
        y[i] += creal(tone) * s->tone.by_gain[i] + cimag(tone) * s->tone.by_omega[i];
    torus_precondition(s, y);
    return MODAL_OK;
}

/* By GMRES. */
enum modal_status torus_newton_step(struct torus_solver *s, const double complex *b,
                                    double complex *x, struct modal_error *err)
{
    size_t n = (size_t)s->q * (size_t)s->count;
    double complex *V = malloc((KRYLOV_MOST + 4) * n * sizeof *V);
    double H[KRYLOV_MOST + 1][KRYLOV_MOST], c[KRYLOV_MOST], r[KRYLOV_MOST], g[KRYLOV_MOST + 1];
    double size = norm(n, b);
    int k = 0;
    enum modal_status rc = MODAL_OK;

    if (V == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a step");
    g[0] = size;
    for (size_t i = 0; i < n; i++)
        V[i] = size > 0 ? b[i] / size : 0;
    while (rc == MODAL_OK && size > 0 && k < KRYLOV_MOST && fabs(g[k]) > FORCING * size
           && !is_over(s)) {
        double complex *w = V + (size_t)(k + 1) * n;

        rc = apply(s, V + (size_t)k * n, w, V + (KRYLOV_MOST + 1) * n, err);
        for (int j = 0; j <= k; j++) {                     /* modified Gram and Schmidt */
            H[j][k] = dot(n, V + (size_t)j * n, w);
            for (size_t i = 0; i < n; i++)
                w[i] -= H[j][k] * V[(size_t)j * n + i];
        }
        H[k + 1][k] = norm(n, w);
        for (size_t i = 0; i < n; i++)
            w[i] /= H[k + 1][k] > 0 ? H[k + 1][k] : 1;
        for (int j = 0; j < k; j++) {                      /* Givens' rotations */
            double t = c[j] * H[j][k] + r[j] * H[j + 1][k];

            H[j + 1][k] = -r[j] * H[j][k] + c[j] * H[j + 1][k];
            H[j][k] = t;
        }
        c[k] = H[k][k] / fmax(hypot(H[k][k], H[k + 1][k]), 1e-300);
        r[k] = H[k + 1][k] / fmax(hypot(H[k][k], H[k + 1][k]), 1e-300);
        H[k][k] = hypot(H[k][k], H[k + 1][k]);
        g[k + 1] = -r[k] * g[k];
        g[k] *= c[k];
        k++;
    }
    /* Where no work is left the preconditioner's own answer stands. */
    for (size_t i = 0; i < n; i++)
        x[i] = k > 0 ? 0 : b[i];
    for (int j = k - 1; rc == MODAL_OK && j >= 0; j--) {
        for (int l = j + 1; l < k; l++)
            g[j] -= H[j][l] * g[l];
        g[j] /= H[j][j] != 0 ? H[j][j] : 1;
        for (size_t i = 0; i < n; i++)
            x[i] += g[j] * V[(size_t)j * n + i];
    }
    free(V);
    return rc;
}

/* X = s->X + FACTOR STEP, the free tone moved along. */
static enum modal_status try_step(struct torus_solver *s, const double complex *step, double factor,
                                  double complex *X, struct modal_error *err)
{
    struct torus_tone *t = &s->tone;
    size_t n = (size_t)s->q * (size_t)s->count;
    double complex tone;

    for (size_t j = 0; j < n; j++)
        X[j] = factor * step[j];
    tone = t->unit * torus_tone_take(s, X);
    for (size_t j = 0; j < n; j++)
        X[j] += s->X[j];
    return t->index < 0 ? MODAL_OK
                        : torus_tone_move(s, t->omega_kept * (1 + cimag(tone)),
                                          t->gain_kept + creal(tone), err);
}

/* The most of STEP that leaves the free tone where its linear parts still say something. */
static double longest(const struct torus_solver *s, const double complex *step)
{
    double moved = s->tone.index < 0
                       ? 0 : s->tone.unit * fabs(cimag(step[torus_tone_place(s)]));

    return moved > FAR ? FAR / moved : 1;
}

/* X = s->X + *FACTOR STEP, halved until the residual falls from SIZE; its forces F, *NOW: what is
 * left. */
static enum modal_status damp(struct torus_solver *s, const double complex *step, double size,
                              double complex *X, double complex *F, double *factor, double *now,
                              struct modal_error *err)
{
    size_t n = (size_t)s->q * (size_t)s->count;

    *factor = longest(s, step);
    for (int halving = 0; halving <= HALVINGS_MOST; halving++) {
        enum modal_status rc;

        *factor *= halving > 0 ? 0.5 : 1;
        rc = try_step(s, step, *factor, X, err);
        if (rc == MODAL_OK)
            rc = ask(s, X, F, err);
        if (rc != MODAL_OK)
            return rc;
        residual_of(s, X, F);
        torus_precondition(s, s->R);
        *now = norm(n, s->R);
        if (*now <= (1 - *factor / 4) * size || is_over(s))
            break;
    }
    return MODAL_OK;
}

/* A preconditioner for the next step, the one at hand where KEPT: false, with the reason, where
 * there is no such step. */
static enum modal_status prepare(struct torus_solver *s, bool kept, bool *ready,
                                 struct modal_error *err)
{
    double before = s->work->spent;
    enum modal_status rc = MODAL_OK;

    *ready = true;
    if (!kept) {
        rc = precondition_new(s, ready, err);
        s->making = s->work->spent - before;
    }
    if (rc != MODAL_OK || !*ready)
        s->reason = "the derivative is singular";
    else if (is_over(s)) {
        s->reason = BUDGET_REASON;
        *ready = false;
    }
    return rc;
}

/* s->X is X, with its forces F, unless the step led uphill, far: the free tone goes along. */
static enum modal_status keep_or_leave(struct torus_solver *s, const double complex *X,
                                       const double complex *F, bool fell, struct modal_error *err)
{
    size_t n = (size_t)s->q * (size_t)s->count;

    if (fell || s->step <= FLOOR) {
        memcpy(s->X, X, n * sizeof *X);
        memcpy(s->F, F, n * sizeof *F);
        torus_tone_keep(s);
        keep_back(s);
        return MODAL_OK;
    }
    return s->tone.index < 0
               ? MODAL_OK : torus_tone_move(s, s->tone.omega_kept, s->tone.gain_kept, err);
}

/* One step, the one before having been LAST long; *GOES_ON: another may help.  WORK: four
 * vectors.  A preconditioner serves as long as whole steps shrink what is left and their products
 * cost less than a new one: *KEPT, of this step, then of the next.  Where steps are cut the norm
 * that it makes leads nowhere, and a free tone moves the linear parts too. */
static enum modal_status advance(struct torus_solver *s, double complex *work, double last,
                                 bool *kept, bool *converged, bool *goes_on,
                                 struct modal_error *err)
{
    size_t n = (size_t)s->q * (size_t)s->count;
    double tolerance = s->opt->tolerance > 0 ? s->opt->tolerance : 1e-10;
    double complex *b = work, *step = work + n, *X = work + 2 * n, *F = work + 3 * n;
    double size, factor, now, begun, before = s->work->spent;
    bool ready = false, old = *kept;
    enum modal_status rc = prepare(s, old, &ready, err);

    *goes_on = false;
    if (rc != MODAL_OK || !ready)
        return rc;
    residual_of(s, s->X, s->F);
    for (size_t j = 0; j < n; j++)
        b[j] = -s->R[j];
    torus_precondition(s, b);
    size = norm(n, b);
    begun = s->work->spent;
    rc = torus_newton_step(s, b, step, err);
    *kept = s->tone.index < 0 && s->work->spent - begun < s->making;
    if (rc == MODAL_OK)
        rc = damp(s, step, size, X, F, &factor, &now, err);
    if (rc != MODAL_OK)
        return rc;
    s->iterations++;
    s->step = factor * norm(n, step) / fmax(norm(n, X), 1e-300);
    rc = keep_or_leave(s, X, F, now < size, err);
    /* A short step alone may be one that GMRES did not find: what is left must be little too.
     * Where nothing falls any more, the whole step is what is not known. */
    *converged = now <= FLOOR * norm(n, X)
        && (s->step <= tolerance || (s->step <= FLOOR && s->step > SHRINKS * last)
            || norm(n, X) == 0);
    if (!*converged && now <= FLOOR * norm(n, X) && !(now < size)) {
        s->step /= factor;
        *converged = s->step < FAR;
    }
    *converged |= s->rough > 0 && fmax(now, s->step * norm(n, X)) <= s->rough * norm(n, X);
    /* Another step not paid, a whole one that fell stands: what is left is a part of the error. */
    *converged |= s->told && factor == 1 && now <= SHRINKS * size && s->step <= ENOUGH
        && !budget_pays(s->work, s->ahead + s->work->spent - before);
    *goes_on = (!(now >= size) || old) && !*converged;
    *kept = *kept && now <= SHRINKS * size;
    return rc;
}

/* Newton's method at s->level from s->X; false: not converged, X as it was best. */
static enum modal_status newton(struct torus_solver *s, bool *converged, struct modal_error *err)
{
    size_t n = (size_t)s->q * (size_t)s->count;
    int most = s->opt->max_iterations > 0 ? s->opt->max_iterations : ITERATIONS_USUAL;
    double begun = s->tone.index >= 0 ? cabs(s->X[torus_tone_place(s)]) : 0;
    double complex *work = malloc(4 * n * sizeof *work + 1);
    bool goes_on = true, kept = false;
    enum modal_status rc = work == NULL ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory")
                                        : ask(s, s->X, s->F, err);

    *converged = false;
    if (rc == MODAL_OK)
        keep_back(s);
    s->reason = "Newton's method did not converge";
    for (int i = 0; rc == MODAL_OK && i < most && goes_on; i++)
        rc = advance(s, work, i > 0 ? s->step : HUGE_VAL, &kept, converged, &goes_on,
                     err);
    if (rc == MODAL_OK && s->tone.index >= 0
        && cabs(s->X[torus_tone_place(s)]) <= FLOOR * begun) {
        *converged = false;
        s->reason = "what was found is the motion without the free tone";
    }
    if (rc == MODAL_OK) {
        apply_linear(s, s->X, work);
        residual_of(s, s->X, s->F);
        s->residual = relative_residual(s, work);
    }
    free(work);
    return rc;
}

enum modal_status torus_record(struct torus_solver *s, struct scene_time *time, double *signals,
                               struct modal_error *err)
{
    struct program view = *s->p;
    const int *kept = condense_dofs(s->condense[0]);
    struct simulate_options how = { .tolerance = MARCH_TOLERANCE, .cancelled = s->opt->cancelled,
                                    .context = s->opt->context };
    struct simulate_result done = { 0 };
    double work = torus_step_work(s, time, &how.leaps);
    struct triplet *term = calloc((size_t)s->q + 1, sizeof *term);
    enum modal_status rc;

    how.steps_most = (int64_t)(fmin(MARCH_WORK, s->work->most - s->work->spent - s->ahead)
                               / work);
    view.output = calloc((size_t)s->q + 1, sizeof *view.output);
    view.outputs = s->q;
    view.omega = s->tones.omega[0];       /* what a load's k that is one number counts */
    for (int j = 0; j < s->tones.count; j++)      /* a free one has no loads, but has a place */
        view.tones[j] = s->tones.omega[j];
    if (term == NULL || view.output == NULL) {
        free(term), free(view.output);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
    }
    if (how.steps_most < 1) {             /* 0 would be no limit */
        free(term), free(view.output);
        return modal_fail(err, MODAL_NO_CONVERGENCE, "torus: no work is left for a march");
    }
    for (int i = 0; i < s->q; i++) {
        term[i] = (struct triplet) { 0, kept[i], 1 };
        view.output[i] = (struct program_output) { view.dofs[kept[i]], &term[i], 1 };
    }
    rc = simulate(&view, time, &how, signals, &done, err);
    budget_add(s->work, rc == MODAL_OK ? (double)done.steps * work
                                      : (double)how.steps_most * work);
    free(term);
    free(view.output);
    return rc;
}

enum modal_status torus_fit(const struct torus_tones *t, int count, const struct torus_index *index,
                            const struct scene_time *time, int q, const double *signals,
                            double complex *X, double *left, struct modal_error *err)
{
    int n = 2 * count - 1, rows = (int)time->samples;
    double *A = malloc((size_t)rows * (size_t)n * sizeof *A + 1),
           *b = malloc((size_t)rows * (size_t)q * sizeof *b + 1);
    enum modal_status rc = A == NULL || b == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a record")
                               : MODAL_OK;

    *left = HUGE_VAL;
    for (int m = 0; rc == MODAL_OK && m < count; m++)
        for (int r = 0; r < rows; r++) {
            double phase = torus_frequency(t, index[m]) * (time->start + r * time->dt);

            A[r + (size_t)(m > 0 ? 2 * m - 1 : 0) * (size_t)rows] = cos(phase);
            if (m > 0)
                A[r + (size_t)(2 * m) * (size_t)rows] = -sin(phase);
        }
    for (int i = 0; rc == MODAL_OK && i < q; i++)
        for (int r = 0; r < rows; r++)
            b[r + (size_t)i * (size_t)rows] = signals[(size_t)r * (size_t)q + (size_t)i];
    if (rc == MODAL_OK && n <= rows
        && LAPACKE_dgels(LAPACK_COL_MAJOR, 'N', rows, n, q, A, rows, b, rows) == 0) {
        *left = 0;
        for (int i = 0; i < q; i++) {
            const double *x = b + (size_t)i * (size_t)rows;

            for (int m = 0; X != NULL && m < count; m++)
                X[(size_t)i * (size_t)count + (size_t)m] =
                    m > 0 ? CMPLX(x[2 * m - 1], x[2 * m]) : x[0];
            for (int r = n; r < rows; r++)
                *left += x[r] * x[r];
        }
        *left = sqrt(*left);
    }
    free(A), free(b);
    return rc;
}

/* s->X of least squares over a record, of the combinations that its samples tell; the others are at
 * rest, for at half a turn a sample and beyond they are others' aliases. */
static enum modal_status fit_slow(struct torus_solver *s, const struct scene_time *time,
                                  const double *signals, struct modal_error *err)
{
    size_t K = (size_t)s->count, q = (size_t)s->q, slow = 0;
    struct torus_index *index = malloc(K * sizeof *index);
    size_t *at = malloc(K * sizeof *at);
    double complex *X = calloc(q * K, sizeof *X);
    double left;
    enum modal_status rc = MODAL_OK;

    if (index == NULL || at == NULL || X == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a record");
    for (size_t m = 0; rc == MODAL_OK && m < K; m++)
        if (torus_frequency(&s->tones, s->index[m]) * time->dt < TOLD * M_PI) {
            at[slow] = m;
            index[slow++] = s->index[m];
        }
    if (rc == MODAL_OK)
        rc = torus_fit(&s->tones, (int)slow, index, time, s->q, signals, X, &left, err);
    if (rc == MODAL_OK && left < HUGE_VAL) {
        memset(s->X, 0, q * K * sizeof *s->X);
        for (size_t i = 0; i < q; i++)
            for (size_t m = 0; m < slow; m++)
                s->X[i * K + at[m]] = X[i * slow + m];
    }
    free(index), free(at), free(X);
    return rc;
}

/* X of the set by least squares over a record of the motion itself: a start where Newton's method
 * knows of none.  A march that fails is none: X stays. */
static enum modal_status march(struct torus_solver *s, struct modal_error *err)
{
    int rows = MARCH_SAMPLES * MARCH_TURNS;
    double dt = 2 * M_PI / s->tones.omega[s->tones.lead] / MARCH_SAMPLES;
    struct scene_time time = { .dt = dt, .start = rows * dt, .samples = rows,
                               .duration = (rows - 1) * dt };
    double *signals = calloc((size_t)rows * (size_t)s->q + 1, sizeof *signals);
    struct modal_error own = { 0 };
    enum modal_status rc = signals == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a record")
                               : torus_record(s, &time, signals, &own);

    if (rc == MODAL_OK)
        rc = fit_slow(s, &time, signals, err);
    else if (own.status == MODAL_CANCELLED)
        *err = own;
    else if (signals != NULL)
        rc = MODAL_OK;
    free(signals);
    return rc;
}

enum modal_status torus_solve_set(struct torus_solver *s, bool *converged, struct modal_error *err)
{
    size_t n = (size_t)s->q * (size_t)s->count;
    double complex *kept = malloc(n * sizeof *kept + 1);
    double done = 0, step = 0.5;
    int halvings = 0;
    enum modal_status rc = kept == NULL ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory")
                                        : newton(s, converged, err);

    /* other ways in may lead to the motion without it, or are worth it later */
    if (s->tone.index >= 0 || s->rough > 0 || s->opt->near) {
        bool turned = false;

        free(kept);
        if (rc == MODAL_OK && *converged && s->tone.index >= 0)
            rc = torus_tone_told(s, &turned, err);
        return rc == MODAL_OK && turned ? newton(s, converged, err) : rc;
    }
    if (rc == MODAL_OK && !*converged)
        rc = march(s, err);
    if (rc == MODAL_OK && !*converged)
        rc = newton(s, converged, err);
    if (rc != MODAL_OK || *converged) {
        free(kept);
        return rc;
    }
    memset(s->X, 0, n * sizeof *s->X);
    while (rc == MODAL_OK && done < 1 && halvings < HALVINGS_MOST && !is_over(s)) {
        memcpy(kept, s->X, n * sizeof *kept);
        s->level = fmin(1, done + step);
        rc = newton(s, converged, err);
        if (*converged) {
            done = s->level;
            step *= 1.5;
        } else {
            memcpy(s->X, kept, n * sizeof *kept);
            step *= 0.5;
            halvings++;
        }
    }
    s->level = 1;
    *converged = done >= 1;
    free(kept);
    return rc;
}
