/*
 * ambient_wander.c - multipliers that the length of each turn moves
 *
 * Let the coefficients of a system turn with an angle whose speed wanders, while the rest of it
 * keeps to time: A(angle) x, samples at even angles.  Turn m, longer than the mean one by the share
 * d_m, has a multiplier of its own,
 *
 *     log rho(d) = lambda + nu d + ..,                                                          (1)
 *
 * nu = lambda + i k 2 pi where the mode moves as exp(lambda t) at the k-th harmonic alone, 0 where
 * all that has a rate keeps to the angle: it is one complex unknown a mode, and as d is known and
 * zero in the mean nothing that lambda tells is lost to it.  Taken as equal, turns make a line as
 * wide as they differ, beside its own width, and where it is by the turns in which the mode
 * happened to be strong.  Such a record is not stationary and has no spectral matrix, but it has
 * its innovations e: with (1) of whittle.c in time, to first order in d,
 *
 *     q(m+1) = e^(nu d_m) (1 + d_m eta) (e^lambda q(m) + kappa^T e(m)),
 *     z(m) = e(m) + 2 Re sum (phi + d_m chi) q(m):                                              (2)
 *
 * what e(m) tells of the state is as far from the next turn as the state is, and what a mode does
 * within a turn is longer too.  By eta a mode moves the others and the conjugates, its own as well:
 * what it does to lambda is of the second order, over the distance of the multipliers, so that it
 * counts where two of them nearly lock, and those that are NEAR are taken.
 *
 * (1) and (2) are the first terms of series in d.  Where two multipliers meet rho has a root, and
 * beyond that d (1) does not converge; a motion that grows there is most of the record, so that it
 * is fitted where (2) is worst.  A wander that leaves the mean turn by OFTEN of its rms, as one
 * turn of twenty does, and so comes to where they meet, has no errors that (2) knows.
 *
 * N/2 log det of the covariance of e falls to its least [Lju99, ch. 7] by Gauss and Newton, damped
 * after Levenberg and Marquardt, from the model of equal turns; q(0) is unknown too.  A line that
 * is drawn wide can take two pairs: any that is not worth its price in (2) leaves.  What is beyond
 * the first order in d shows most in the weakest signals, where noise is least, and would rule the
 * fit.  By the model of equal turns, whose innovations hold what turns do, all that a turn tells of
 * its state is in as many combinations of signals as the state has numbers [And79, ch. 6]: (2) is
 * fitted to these.
 *
 * [Lju99] Ljung, System Identification, Prentice Hall 1999.  [And79] Anderson and Moore, Optimal
 * Filtering, Prentice Hall 1979.
 *
 * Tested by tests/unit/modal/identify/ambient/test_ambient_wander.c.
 */
#include "modal/identify/ambient/ambient_wander.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/ambient/ambient_order.h"
#include "modal/linalg/svd.h"
#include "modal/linalg/workspace.h"

enum { L = WHITTLE_CHANNELS_MOST, MODES = WHITTLE_MODES_MOST };
/* Unknowns of a mode: of each a real and an imaginary part; chi, kappa behind phi. */
enum { LAMBDA = 0, NU = 2, BEGUN = 4, PHI = 6 };
enum { NEAR = 3 };               /* of a pair: as many others as two pairs have */
enum { STEPS_BLIND = 2 };         /* the first is damped: it tells little of what may be had */
enum { BLOCK = 16 };             /* turns whose derivatives are one product: J passes by once */
enum {
    CALLS = 400                  /* multiplications in the time of a turn's calls, measured */
};
static const double
    GAIN = 1e-3,                 /* of the logarithm of the likelihood: a twentieth of an error */
    HOPE = 10,                   /* steps like the last, as in whittle_fit.c */
    OFTEN = 2,                   /* rms: what a twentieth of normal turns is beyond */
    CHANCE = 6,                  /* chi-square of two: a twentieth of what is none is beyond */
    WORK_MOST = 2e10,            /* multiplications of all fits: ten seconds */
    WORK_BEGIN = 1e9;            /* of where nu begins: a twentieth, no more than a few steps */

struct model {
    struct whittle m;
    double complex nu[MODES], begun[MODES];       /* begun: q(0) */
    double complex chi[MODES][L];
    double complex eta[MODES][2 * MODES];         /* by q_j at 2 j, its conjugate at 2 j + 1 */
};

struct work {
    const struct ambient_wander *in;
    struct workspace memory;
    int l, p, unknowns, near_count;
    int near[MODES][NEAR];       /* of eta, what is not zero */
    bool apart;                  /* nothing is, yet */
    const double *z;             /* l x turns: what is fitted to */
    double complex *x, *dx;      /* q; its derivatives, p x unknowns */
    double complex *alone, *lone;        /* both before modes move each other */
    double *H;                   /* 2p x 2p: eta in reals */
    double *C, *slope, *at, *K;  /* l x 2p: phi, chi, both of a turn; 2p x l: (2) in reals */
    double *e;                   /* l x turns */
    double *de, *unit;           /* of a block: l rows a turn x unknowns; the e's, both whitened */
    double *J, *factor, *gradient, *step, *scale;
    double left;                 /* of WORK_MOST */
};

static int each(const struct work *w)
{
    return PHI + 6 * w->l + 2 * NEAR;
}

static enum modal_status make_room(struct work *w, int pairs, struct modal_error *err)
{
    struct workspace *s = &w->memory;
    size_t l = (size_t)w->l, p = (size_t)pairs, n = p * (size_t)each(w);

    workspace_free(s);
    w->p = pairs, w->unknowns = (int)n;
    w->x = workspace_zeros(s, p + 1, sizeof *w->x);
    w->dx = workspace_zeros(s, p * n + 1, sizeof *w->dx);
    w->alone = workspace_zeros(s, p + 1, sizeof *w->alone);
    w->lone = workspace_zeros(s, p * n + 1, sizeof *w->lone);
    w->H = workspace_numbers(s, 2 * p, 2 * p);
    w->C = workspace_numbers(s, l, 2 * p), w->K = workspace_numbers(s, l, 2 * p);
    w->slope = workspace_numbers(s, l, 2 * p), w->at = workspace_numbers(s, l, 2 * p);
    w->e = workspace_numbers(s, l, (size_t)w->in->Z->m);
    w->de = workspace_numbers(s, BLOCK * l, n), w->unit = workspace_numbers(s, BLOCK, l);
    w->J = workspace_numbers(s, n, n), w->factor = workspace_numbers(s, n, n);
    w->gradient = workspace_numbers(s, n, 1), w->step = workspace_numbers(s, n, 1);
    w->scale = workspace_numbers(s, n, 1);
    return workspace_check(s, "identify: no memory for a system whose speed wanders", err);
}

/* ---- the innovations ---- */

static void set_eta(struct work *w, const struct model *t)
{
    int n = 2 * w->p;

    for (int k = 0; k < w->p; k++)
        for (int j = 0; j < w->p; j++) {
            double complex own = t->eta[k][2 * j], turned = t->eta[k][2 * j + 1];
            double *re = w->H + 2 * k + (size_t)n * 2 * j, *im = re + n;
            re[0] = creal(own + turned), re[1] = cimag(own + turned);
            im[0] = cimag(turned - own), im[1] = creal(own - turned);
        }
}

static void set_matrices(struct work *w, const struct model *t)
{
    set_eta(w, t);
    for (int k = 0; k < w->p; k++)
        for (int i = 0; i < w->l; i++) {
            double complex phi = t->m.mode[k].phi[i], kappa = t->m.mode[k].kappa[i];
            w->C[i + w->l * 2 * k] = 2 * creal(phi), w->C[i + w->l * (2 * k + 1)] = -2 * cimag(phi);
            w->slope[i + w->l * 2 * k] = 2 * creal(t->chi[k][i]);
            w->slope[i + w->l * (2 * k + 1)] = -2 * cimag(t->chi[k][i]);
            w->K[2 * k + 2 * w->p * i] = creal(kappa);
            w->K[2 * k + 1 + 2 * w->p * i] = cimag(kappa);
        }
}

/* (2) from turn M to the next, whose innovations are in place. */
static void turn_over(struct work *w, const struct model *t, int m)
{
    const double *e = w->e + (size_t)w->l * m;

    for (int k = 0; k < w->p; k++)
        w->x[k] *= cexp(t->m.mode[k].lambda);
    if (w->p > 0)
        cblas_dgemv(CblasColMajor, CblasNoTrans, 2 * w->p, w->l, 1, w->K, 2 * w->p, e, 1, 1,
                    (double *)w->x, 1);
    memcpy(w->alone, w->x, sizeof *w->x * (size_t)w->p);
    if (w->p > 0)
        cblas_dgemv(CblasColMajor, CblasNoTrans, 2 * w->p, 2 * w->p, w->in->longer[m], w->H,
                    2 * w->p, (double *)w->alone, 1, 1, (double *)w->x, 1);
    for (int k = 0; k < w->p; k++)
        w->x[k] *= cexp(t->nu[k] * w->in->longer[m]);
}

/* The innovations of turn M. */
static void innovate(struct work *w, int m)
{
    double *e = w->e + (size_t)w->l * m;

    for (int i = 0; i < 2 * w->l * w->p; i++)
        w->at[i] = w->C[i] + w->in->longer[m] * w->slope[i];
    cblas_dcopy(w->l, w->z + (size_t)w->l * m, 1, e, 1);
    cblas_dgemv(CblasColMajor, CblasNoTrans, w->l, 2 * w->p, -1, w->at, w->l, (double *)w->x, 1, 1,
                e, 1);
}

/* Multiplications of predict(). */
static double predict_work(const struct work *w)
{
    return w->in->Z->m * (4.0 * (w->l * (2 * w->p + w->l) + w->p * w->p) + CALLS);
}

/* All innovations of T, the root of their covariance and the likelihood; -HUGE_VAL: none. */
static void predict(struct work *w, struct model *t)
{
    int N = w->in->Z->m, l = w->l;
    double *R = t->m.root;

    set_matrices(w, t);
    memcpy(w->x, t->begun, sizeof *w->x * (size_t)w->p);
    for (int m = 0; m < N; m++) {
        innovate(w, m);
        turn_over(w, t, m);
    }
    w->left -= predict_work(w);
    cblas_dsyrk(CblasColMajor, CblasLower, CblasNoTrans, l, N, 1.0 / N, w->e, l, 0, R, l);
    t->m.likelihood = -HUGE_VAL;
    if (!isfinite(cblas_dasum(l * l, R, 1))
        || LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', l, R, l) != 0)
        return;
    t->m.likelihood = 0;
    for (int i = 0; i < l; i++)
        t->m.likelihood -= N * log(R[i + l * i]);
}

/* ---- a step ---- */

/* The entry of phi that stays: phi kappa^T has no scale. */
static int pivot_of(const struct work *w, const struct whittle_mode *q)
{
    return (int)cblas_izamax(w->l, q->phi, 1);
}

/* de of turn M, from one unknown to the next of them BLOCK l. */
static double *de_of(const struct work *w, int m)
{
    return w->de + w->l * (m % BLOCK);
}

/* de += what phi and chi alone do, of turn M. */
static void vary_shapes(struct work *w, const struct model *t, int m)
{
    double longer = w->in->longer[m];
    int ld = BLOCK * w->l;

    for (int k = 0; k < w->p; k++) {
        double *de = de_of(w, m) + (size_t)ld * (each(w) * k + PHI);
        int pivot = pivot_of(w, &t->m.mode[k]);
        for (int i = 0; i < w->l; i++)
            if (i != pivot) {
                de[i + ld * 2 * i] -= 2 * creal(w->x[k]);
                de[i + ld * (2 * i + 1)] += 2 * cimag(w->x[k]);
                de[i + ld * 2 * (w->l + i)] -= 2 * creal(w->x[k]) * longer;
                de[i + ld * (2 * (w->l + i) + 1)] += 2 * cimag(w->x[k]) * longer;
            }
    }
}

/* dx += what lambda and kappa alone do, of turn M, before nu. */
static void vary_states(struct work *w, const struct model *t, int m)
{
    const double *e = w->e + (size_t)w->l * m;

    for (int k = 0; k < w->p; k++) {
        double complex moved = w->x[k] * cexp(t->m.mode[k].lambda);
        double complex *dx = w->dx + k + (size_t)w->p * (each(w) * k);
        for (int part = 0; part < 2; part++) {
            double complex unit = part == 0 ? 1 : I;
            dx[w->p * (LAMBDA + part)] += unit * moved;
            for (int i = 0; i < w->l; i++)
                dx[w->p * (PHI + 4 * w->l + 2 * i + part)] += unit * e[i];
        }
    }
}

/* dx by what the others do within turn M: as eta is, and by eta alone. */
static void vary_eta(struct work *w, int m)
{
    int p = w->p, n = w->unknowns;
    double longer = w->in->longer[m];

    if (w->near_count == 0)
        return;
    memcpy(w->lone, w->dx, sizeof *w->dx * (size_t)p * (size_t)n);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, 2 * p, n, 2 * p, longer, w->H, 2 * p,
                (double *)w->lone, 2 * p, 1, (double *)w->dx, 2 * p);
    for (int k = 0; k < p; k++)
        for (int i = 0; i < w->near_count; i++) {
            double complex *dx = w->dx + k + (size_t)p * (each(w) * k + PHI + 6 * w->l + 2 * i);
            double complex by = w->alone[w->near[k][i] / 2] * longer;
            if (w->near[k][i] % 2 == 1)
                by = conj(by);
            dx[0] += by, dx[p] += I * by;
        }
}

/* dx to the next turn, and x. */
static void move_derivatives(struct work *w, const struct model *t, int m)
{
    int l = w->l, p = w->p, n = w->unknowns;

    for (int k = 0; k < p; k++)
        cblas_zscal(n, &(double complex) { cexp(t->m.mode[k].lambda) }, w->dx + k, p);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, 2 * p, n, l, 1, w->K, 2 * p,
                de_of(w, m), BLOCK * l, 1, (double *)w->dx, 2 * p);
    vary_states(w, t, m);
    turn_over(w, t, m);
    vary_eta(w, m);
    for (int k = 0; k < p; k++) {
        double complex *dx = w->dx + k + (size_t)p * (each(w) * k + NU);
        double longer = w->in->longer[m];
        cblas_zscal(n, &(double complex) { cexp(t->nu[k] * longer) }, w->dx + k, p);
        dx[0] += w->x[k] * longer, dx[p] += I * w->x[k] * longer;
    }
}

/* J and the gradient by what is in the block that ends with turn M. */
static void take_block(struct work *w, int m)
{
    int rows = w->l * (m % BLOCK + 1), ld = BLOCK * w->l, n = w->unknowns;

    cblas_dsyrk(CblasColMajor, CblasLower, CblasTrans, n, rows, 1, w->de, ld, 1, w->J, n);
    cblas_dgemv(CblasColMajor, CblasTrans, rows, n, -1, w->de, ld, w->unit, 1, 1, w->gradient, 1);
}

/* J and the gradient at T, whose innovations are known. */
static void inform(struct work *w, const struct model *t)
{
    int N = w->in->Z->m, l = w->l, p = w->p, n = w->unknowns, ld = BLOCK * l;

    memset(w->dx, 0, sizeof *w->dx * (size_t)p * (size_t)n);
    memset(w->J, 0, sizeof *w->J * (size_t)n * (size_t)n);
    memset(w->gradient, 0, sizeof *w->gradient * (size_t)n);
    memcpy(w->x, t->begun, sizeof *w->x * (size_t)p);
    for (int k = 0; k < p; k++)
        for (int part = 0; part < 2; part++)
            w->dx[k + (size_t)p * (each(w) * k + BEGUN + part)] = part == 0 ? 1 : I;
    for (int m = 0; m < N; m++) {
        double *de = de_of(w, m), *e = w->unit + l * (m % BLOCK);
        innovate(w, m);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, l, n, 2 * p, -1, w->at, l,
                    (double *)w->dx, 2 * p, 0, de, ld);
        vary_shapes(w, t, m);
        move_derivatives(w, t, m);
        memcpy(e, w->e + (size_t)l * m, sizeof *e * (size_t)l);
        cblas_dtrsv(CblasColMajor, CblasLower, CblasNoTrans, CblasNonUnit, l, t->m.root, l, e, 1);
        cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, l, n, 1,
                    t->m.root, l, de, ld);
        if (m % BLOCK == BLOCK - 1 || m == N - 1)
            take_block(w, m);
    }
    w->left -= (double)N * n * (4.0 * p * (p + l) + l * l + 0.5 * l * n);
    /* what moves nothing stays where it is */
    for (int i = 0; i < n; i++) {
        double own = w->J[i + (size_t)n * i];
        w->scale[i] = own > 0 ? 1 / sqrt(own) : 1;
        w->J[i + (size_t)n * i] = own > 0 ? own : 1;
    }
}

/* The factor of J in the scale of its diagonal, DAMPING added; false where it has none. */
static bool factor(struct work *w, double damping)
{
    int n = w->unknowns;

    for (int j = 0; j < n; j++) {
        for (int i = j; i < n; i++)
            w->factor[i + (size_t)n * j] = w->J[i + (size_t)n * j] * w->scale[i] * w->scale[j];
        w->factor[j + (size_t)n * j] += damping;
    }
    w->left -= (double)n * n * n / 6;
    return LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', n, w->factor, n) == 0;
}

/* T by the step of this damping. */
static void move(const struct work *w, struct model *t)
{
    for (int k = 0; k < w->p; k++) {
        const double complex *d = (const double complex *)(w->step + each(w) * k);
        struct whittle_mode *q = &t->m.mode[k];
        double slowest = WHITTLE_DECAY_LEAST / w->in->Z->m;     /* what is slower is a line */
        q->lambda += d[LAMBDA / 2], t->nu[k] += d[NU / 2], t->begun[k] += d[BEGUN / 2];
        q->lambda = CMPLX(fmin(creal(q->lambda), -slowest), cimag(q->lambda));
        for (int i = 0; i < w->l; i++) {
            q->phi[i] += d[PHI / 2 + i];
            t->chi[k][i] += d[PHI / 2 + w->l + i];
            q->kappa[i] += d[PHI / 2 + 2 * w->l + i];
        }
        for (int i = 0; i < w->near_count; i++)
            t->eta[k][w->near[k][i]] += d[PHI / 2 + 3 * w->l + i];
    }
}

/* One step uphill, *gained by it: 0 where none gains.  TRIAL: room. */
static void step_up(struct work *w, struct model *t, struct model *trial, double *damping,
                    double *gained)
{
    int n = w->unknowns;

    *gained = 0;
    inform(w, t);
    for (; *damping < WHITTLE_DAMPING_MOST; *damping *= 10) {
        if (!factor(w, *damping))
            continue;
        for (int i = 0; i < n; i++)
            w->step[i] = w->gradient[i] * w->scale[i];
        LAPACKE_dpotrs(LAPACK_COL_MAJOR, 'L', n, 1, w->factor, n, w->step, n);
        for (int i = 0; i < n; i++)
            w->step[i] *= w->scale[i];
        *trial = *t;
        move(w, trial);
        predict(w, trial);
        if (trial->m.likelihood >= t->m.likelihood) {
            *gained = trial->m.likelihood - t->m.likelihood;
            *t = *trial;
            *damping = fmax(*damping / 10, WHITTLE_DAMPING_LEAST);
            return;
        }
    }
}

static double complex multiplier(const struct model *t, int j)
{
    double complex rho = cexp(t->m.mode[j / 2].lambda);

    return j % 2 == 0 ? rho : conj(rho);
}

/* What a turn's length does to it. */
static double complex slope_of(const struct model *t, int j)
{
    return multiplier(t, j) * (j % 2 == 0 ? t->nu[j / 2] : conj(t->nu[j / 2]));
}

/* Of each mode of T the multipliers next to its own. */
static void find_near(struct work *w, const struct model *t)
{
    w->near_count = w->apart ? 0 : 2 * w->p - 1 < NEAR ? 2 * w->p - 1 : NEAR;
    for (int k = 0; k < w->p; k++) {
        double far[NEAR + 1];
        int count = 0, near[NEAR + 1] = { 0 };
        for (int j = 0; j < 2 * w->p; j++) {
            double distance = cabs(multiplier(t, j) - multiplier(t, 2 * k));
            int i = count;
            if (j == 2 * k)
                continue;
            for (; i > 0 && far[i - 1] > distance; i--)
                far[i] = far[i - 1], near[i] = near[i - 1];
            far[i] = distance, near[i] = j;
            count = count < NEAR ? count + 1 : NEAR;
        }
        memcpy(w->near[k], near, sizeof w->near[k]);
    }
}

/* T at its summit; m->converged where it came there, and it does not try where steps like the last
 * do not lead to what is NEEDED of its likelihood. */
static enum modal_status climb(struct work *w, struct model *t, double needed, struct model *trial,
                               struct modal_error *err)
{
    double damping = WHITTLE_DAMPING_FIRST, gained = HUGE_VAL;  /* as whittle_fit.c climbs */

    t->m.converged = w->p == 0;
    find_near(w, t);
    predict(w, t);
    for (int i = 0; i < AMBIENT_STEPS_MOST && !t->m.converged && w->left > 0
                        && isfinite(t->m.likelihood)
                        && (i < STEPS_BLIND || t->m.likelihood + HOPE * gained > needed); i++) {
        if (w->in->cancelled != NULL && w->in->cancelled(w->in->context))
            return modal_fail(err, MODAL_CANCELLED, "identify: cancelled");
        step_up(w, t, trial, &damping, &gained);
        t->m.converged = gained < GAIN;
    }
    return MODAL_OK;
}

/* ---- the way ---- */

/* nu to begin with: of those that (1) may have the likeliest, mode by mode; of many phases only the
 * slowest that there is work for, the climb goes on from them. */
static void begin(struct work *w, struct model *t)
{
    double room = WORK_BEGIN / (2 * predict_work(w) * (w->p + 1));
    int highest = (int)fmin(w->in->phases / 2, room);

    for (int k = 0; k < w->p; k++)
        t->nu[k] = t->begun[k] = 0;
    predict(w, t);
    for (int k = 0; k < w->p; k++) {
        double complex best = 0;
        double most = t->m.likelihood;
        for (int j = -highest; j <= highest; j++) {
            t->nu[k] = t->m.mode[k].lambda + CMPLX(0, 2 * M_PI * j);
            predict(w, t);
            if (t->m.likelihood > most)
                most = t->m.likelihood, best = t->nu[k];
        }
        t->nu[k] = best;
    }
}

static void leave_out(struct model *t, int k)
{
    size_t behind = (size_t)(--t->m.count - k);

    memmove(t->m.mode + k, t->m.mode + k + 1, sizeof *t->m.mode * behind);
    memmove(t->nu + k, t->nu + k + 1, sizeof *t->nu * behind);
    memmove(t->begun + k, t->begun + k + 1, sizeof *t->begun * behind);
    memmove(t->chi + k, t->chi + k + 1, sizeof *t->chi * behind);
    memmove(t->eta + k, t->eta + k + 1, sizeof *t->eta * behind);
    for (int i = 0; i < t->m.count; i++)
        memmove(t->eta[i] + 2 * k, t->eta[i] + 2 * k + 2, 2 * sizeof **t->eta * behind);
}

/* What is lost with each pair of T, before the rest is fitted anew. */
static void weigh(struct work *w, const struct model *t, struct model *fewer, double *loss)
{
    for (int k = 0; k < t->m.count; k++) {
        *fewer = *t;
        leave_out(fewer, k);
        predict(w, fewer);
        loss[k] = t->m.likelihood - fewer->m.likelihood;
    }
}

/* One pair that is not worth its price leaves, those first that tell least; *less: there was
 * one. */
static enum modal_status shrink(struct work *w, struct model *t, struct model *fewer,
                                struct model *trial, bool *less, struct modal_error *err)
{
    enum modal_status rc = make_room(w, t->m.count - 1, err);
    double loss[MODES], enough = t->m.likelihood - w->in->price;

    *less = false;
    if (rc == MODAL_OK)
        weigh(w, t, fewer, loss);
    while (rc == MODAL_OK && !*less && w->left > 0) {
        int k = 0;
        for (int i = 1; i < t->m.count; i++)
            k = loss[i] < loss[k] ? i : k;
        if (!(loss[k] <= AMBIENT_PATIENCE * w->in->price))
            break;
        loss[k] = HUGE_VAL;
        *fewer = *t;
        leave_out(fewer, k);
        rc = climb(w, fewer, enough, trial, err);
        *less = fewer->m.likelihood > enough;
        if (*less)
            *t = *fewer;
    }
    return rc;
}

/* The inverse of the information at T in the scale of its diagonal; false where it has none. */
static bool find_covariance(struct work *w, const struct model *t)
{
    int n = w->unknowns;

    inform(w, t);
    return factor(w, 0) && LAPACKE_dpotri(LAPACK_COL_MAJOR, 'L', n, w->factor, n) == 0;
}

static double covariance(const struct work *w, int i, int j)
{
    size_t low = (size_t)(i > j ? i : j), column = (size_t)(i > j ? j : i);

    return w->scale[i] * w->scale[j] * w->factor[low + (size_t)w->unknowns * column];
}

static double std_of(const struct work *w, int i)
{
    return sqrt(covariance(w, i, i));
}

/* Does the record tell eta, by which multiplier J moves the mode K? */
static bool moves(const struct work *w, const struct model *t, int k, int j)
{
    double re = creal(t->eta[k][j]), im = cimag(t->eta[k][j]);

    for (int i = 0; i < w->near_count; i++)
        if (w->near[k][i] == j) {
            int at = each(w) * k + PHI + 6 * w->l + 2 * i;
            double a = covariance(w, at, at), b = covariance(w, at + 1, at + 1);
            double c = covariance(w, at, at + 1);
            return b * re * re - 2 * c * re * im + a * im * im > CHANCE * (a * b - c * c);
        }
    return false;
}

/* The standard error of |slope_of()| between the mode K and its conjugate, 2 |Im (rho nu)|. */
static double std_of_slope(const struct work *w, const struct model *t, int k)
{
    double complex rho = multiplier(t, 2 * k);
    double re = cimag(rho), im = creal(rho);    /* of nu's parts */
    int nu = each(w) * k + NU;

    return 2 * sqrt(fmax(0, re * re * covariance(w, nu, nu)
                            + 2 * re * im * covariance(w, nu, nu + 1)
                            + im * im * covariance(w, nu + 1, nu + 1)));
}

/* Do turns that are FAR from the mean one bring the multiplier J to that of the mode K, by (1)?
 * Those of two modes pass each other unless each moves the other.  A mode and its conjugate always
 * may meet, but beside the real axis little takes them there, and chance does: a slope counts that
 * takes them there less its standard error. */
static bool meets(const struct work *w, const struct model *t, int k, int j, double far)
{
    double gap = cabs(multiplier(t, j) - multiplier(t, 2 * k));
    double slope = cabs(slope_of(t, j) - slope_of(t, 2 * k));

    if (j == 2 * k + 1)
        return gap < far * (slope - std_of_slope(w, t, k));
    return gap < far * slope && moves(w, t, k, j)
        && moves(w, t, j / 2, j % 2 == 0 ? 2 * k : 2 * k + 1);
}

static void find_meetings(const struct work *w, const struct model *t, bool meet[MODES][MODES])
{
    double far = OFTEN * cblas_dnrm2(w->in->Z->m, w->in->longer, 1) / sqrt(w->in->Z->m);

    for (int k = 0; k < w->p; k++)
        for (int j = 0; j < 2 * w->p; j++)
            if (j != 2 * k && meets(w, t, k, j, far))
                meet[k][j / 2] = true;
}

/* From the information at T; where the climb ended below the summit, only what meets. */
static void find_errors(struct work *w, struct model *t, bool meet[MODES][MODES])
{
    bool known;

    find_near(w, t);
    predict(w, t);
    known = isfinite(t->m.likelihood) && find_covariance(w, t);
    if (known)
        find_meetings(w, t, meet);
    for (int k = 0; k < w->p && t->m.converged; k++) {
        int at = each(w) * k + LAMBDA;
        t->m.mode[k].std_decay = known ? std_of(w, at) : NAN;
        t->m.mode[k].std_turn = known ? std_of(w, at + 1) : NAN;
    }
    t->m.converged = t->m.converged && known;
}

/* Each pair apart first: a second one on the same line and the first would move each other. */
static enum modal_status fit(struct work *w, struct model *t, struct model *fewer,
                             struct model *trial, bool meet[MODES][MODES],
                             struct modal_error *err)
{
    bool less = !w->in->fixed;
    enum modal_status rc = make_room(w, t->m.count, err);

    w->apart = true;
    if (rc == MODAL_OK) {
        begin(w, t);
        rc = climb(w, t, -HUGE_VAL, trial, err);
    }
    while (rc == MODAL_OK && less && t->m.count > 0)
        rc = shrink(w, t, fewer, trial, &less, err);
    w->apart = false;
    if (rc == MODAL_OK)
        rc = make_room(w, t->m.count, err);
    if (rc == MODAL_OK && t->m.count > 0)
        rc = climb(w, t, -HUGE_VAL, trial, err);
    if (rc == MODAL_OK && t->m.count > 0)
        find_errors(w, t, meet);
    return rc;
}

/* ---- what tells of the state ---- */

/* U: in units of the innovations of M, an orthonormal basis of its shapes, *rank of them. */
static enum modal_status find_basis(const struct whittle *m, double *U, int *rank,
                                    struct modal_error *err)
{
    int l = m->channels, columns = 2 * m->count;
    double s[L], x[L * 2 * MODES], vt[L * 2 * MODES];
    struct matrix shapes = { l, columns, l, x };
    int most = l < columns ? l : columns;
    struct matrix left = { l, most, l, U }, right = { most, columns, most, vt };
    enum modal_status rc;

    for (int k = 0; k < m->count; k++)
        for (int i = 0; i < l; i++) {
            x[i + l * 2 * k] = creal(m->mode[k].phi[i]);
            x[i + l * (2 * k + 1)] = cimag(m->mode[k].phi[i]);
        }
    *rank = 0;
    if (columns == 0)
        return MODAL_OK;
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, l, columns, 1,
                m->root, l, x, l);
    rc = svd_thin(&shapes, s, &left, &right, err);
    while (rc == MODAL_OK && *rank < most && s[*rank] > DBL_EPSILON * l * s[0])
        (*rank)++;
    return rc;
}

/* Signals, shapes and how they are driven, along U; z: room for them. */
static void go_in(struct work *w, const double *U, const struct whittle *m, double *z,
                  struct model *t)
{
    int l = m->channels, r = w->l, N = w->in->Z->m;
    double unit[L], x[2 * L], y[2 * L];

    for (int turn = 0; turn < N; turn++) {
        cblas_dcopy(l, w->in->Z->x + turn, w->in->Z->ld, unit, 1);
        cblas_dtrsv(CblasColMajor, CblasLower, CblasNoTrans, CblasNonUnit, l, m->root, l, unit, 1);
        cblas_dgemv(CblasColMajor, CblasTrans, l, r, 1, U, l, unit, 1, 0, z + (size_t)r * turn, 1);
    }
    for (int k = 0; k < m->count; k++)
        for (int driven = 0; driven < 2; driven++) {
            const double complex *from = driven ? m->mode[k].kappa : m->mode[k].phi;
            double complex *to = driven ? t->m.mode[k].kappa : t->m.mode[k].phi;
            for (int i = 0; i < l; i++)
                x[i] = creal(from[i]), x[l + i] = cimag(from[i]);
            if (driven)
                cblas_dtrmm(CblasColMajor, CblasLeft, CblasLower, CblasTrans, CblasNonUnit, l, 2, 1,
                            m->root, l, x, l);
            else
                cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, l, 2,
                            1, m->root, l, x, l);
            cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, r, 2, l, 1, U, l, x, l, 0, y, r);
            for (int i = 0; i < r; i++)
                to[i] = CMPLX(y[i], y[r + i]);
        }
}

/* The way back, T to *M, whose innovations' covariance stays that of equal turns. */
static void go_out(const double *U, int r, const struct model *t, struct whittle *m)
{
    int l = m->channels;
    double x[2 * L], y[2 * L];

    for (int k = 0; k < t->m.count; k++) {
        struct whittle_mode *q = &m->mode[k];
        *q = t->m.mode[k];
        for (int driven = 0; driven < 2; driven++) {
            const double complex *from = driven ? t->m.mode[k].kappa : t->m.mode[k].phi;
            double complex *to = driven ? q->kappa : q->phi;
            for (int i = 0; i < r; i++)
                x[i] = creal(from[i]), x[r + i] = cimag(from[i]);
            cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, l, 2, r, 1, U, l, x, r, 0, y, l);
            if (driven)
                cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasTrans, CblasNonUnit, l, 2, 1,
                            m->root, l, y, l);
            else
                cblas_dtrmm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, l, 2,
                            1, m->root, l, y, l);
            for (int i = 0; i < l; i++)
                to[i] = CMPLX(y[i], y[l + i]);
        }
    }
    m->count = t->m.count, m->likelihood = t->m.likelihood, m->converged = t->m.converged;
}

enum modal_status ambient_wander_fit(const struct ambient_wander *in, struct whittle *m,
                                     bool meet[MODES][MODES], struct modal_error *err)
{
    struct work w = { .in = in, .left = WORK_MOST };
    struct model *t = calloc(3, sizeof *t);
    double *z = malloc(sizeof *z * (size_t)m->channels * (size_t)in->Z->m), U[L * L];
    double faster = 1. / in->Z->m;        /* than a record that repeats shows it (whittle.c) */
    enum modal_status rc = find_basis(m, U, &w.l, err);

    memset(meet, 0, sizeof *meet * MODES);
    if (rc == MODAL_OK && (t == NULL || z == NULL))
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for a model of turns");
    if (rc == MODAL_OK && w.l > 0) {
        t->m = *m, w.z = z;
        go_in(&w, U, m, z, t);
        for (int k = 0; k < m->count; k++)
            t->m.mode[k].lambda += faster;
        rc = fit(&w, t, t + 1, t + 2, meet, err);
        for (int k = 0; k < t->m.count; k++)
            t->m.mode[k].lambda -= faster;
        go_out(U, w.l, t, m);
    }
    workspace_free(&w.memory);
    free(t);
    free(z);
    return rc;
}
