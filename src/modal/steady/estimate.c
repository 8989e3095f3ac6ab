/*
 * estimate.c - see estimate.h
 *
 * Let X solve the balance at H and N, and let E extend it: harmonics H+1 .. H2 by one direct
 * iteration
 *
 *     E_k = S_k^-1 (p_k - F_k(X)),   H < k <= H2,                                               (1)
 *
 * F_k beyond H from exact pieces or from finer samples, and the first H corrected by one chord step
 *
 *     E_low = X - J^-1 R_low(X + tail),                                                         (2)
 *
 * R with N2 samples.  Then E - X estimates the whole error to first order in it; with the tail left
 * out of (2), E' - X is the sampling's part and E - E' the truncation's; a last Newton step's is
 * the solver's.  Each is put in the unit of x as max over time and dofs.
 *
 * Rigid friction jumps where the motion turns, and X(H) = X + c_1 / H + c_2 / H^2 + ..  Of three
 * motions, each of twice the harmonics of the one before, A, B and C,
 *
 *     a = 2 B - A,   c = 2 C - B,   X = (4 c - a) / 3                                           (3)
 *
 * takes out both terms; |X - c| is what the second one was.
 */
#include "modal/steady/estimate.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/orbit.h"
#include "modal/scene/program.h"
#include "modal/steady/aft.h"
#include "modal/steady/balance.h"
#include "modal/steady/condense.h"
#include "modal/steady/graze.h"
#include "modal/steady/iterate.h"
#include "modal/steady/pattern.h"
#include "modal/steady/session.h"
#include "modal/steady/stiffness.h"
#include "modal/steady/unheld.h"

/* Of the largest low harmonic, what a round moves them by once it has nothing to add but
 * rounding. */
static const double STILL = 4 * DBL_EPSILON;
/* Of the forces past H those below this of the largest move nothing, if not by a resonance that is
 * a million times sharper than the others. */
static const double UNMOVED = 1e-6;
enum {
    EXTENSIONS = 5,             /* rounds of (1) and (2), each an order nearer where laws are
                                 * smooth */
    EXTENSIONS_OF_JUMPS = 40,   /* where they jump, each gains a factor alone */
    SHARP = 2048,               /* harmonics of the finest of three motions of rigid friction */
    LEVELS = 3,                 /* these */
    WIDE_FEW = 16,              /* harmonics below which H2 is WIDE_LEAST, past it, and where each
                                 * has sparse factors, four times as many: */
    WIDE_LEAST = 64,            /* harmonics that fall as k^-3 are 64 times smaller there */
    WIDEN = 4,   /* k^-3 falls to a 64th */
    WIDEN_ON_INPUTS = 2,        /* of the modes that few harmonics need; to an eighth */
    WIDE_MORE = 64,             /* where four times as many are too many */
    WIDE_KEPT = 1 << 16         /* stiffnesses that a wide balance is kept with: a megabyte */
};

/* s->peaks of N samples: one is planned for longer than it is used. */
static enum modal_status set_peaks(struct steady *s, int N, struct modal_error *err)
{
    enum modal_status rc;

    if (s->peak_samples == N)
        return MODAL_OK;
    orbit_grid_free(s->peaks);
    s->peaks = NULL;
    rc = orbit_grid_to_time(N, &s->peaks, err);
    s->peak_samples = rc == MODAL_OK ? N : 0;
    return rc;
}

/* The peak over time and counted dofs of the motion whose kept part is E - X (loads cancel); that
 * of X into *AMPLITUDE, if that is not NULL, OPEN about its mean. */
static enum modal_status peak_of_change(struct steady *s, const double complex *E,
                                        const double complex *X, int H, bool open, double *out,
                                        double *amplitude, struct modal_error *err)
{
    int N = steady_power_of_two(4L * (H + 1)),
        count = s->opt.dofs != NULL ? s->opt.dofs_count : s->p->n;
    double complex *a = calloc((size_t)H + 1, sizeof *a), *b = calloc((size_t)H + 1, sizeof *b);
    double *x = calloc((size_t)N, sizeof *x);
    enum modal_status rc = set_peaks(s, N, err);

    if (rc == MODAL_OK && (a == NULL || b == NULL || x == NULL))
        rc = modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for an estimate");
    *out = 0;
    for (int i = 0; rc == MODAL_OK && i < count; i++) {
        rc = condense_recover(s->c, steady_counted_dof(s, i), H, E, H, a, err);
        if (rc == MODAL_OK)
            rc = condense_recover(s->c, steady_counted_dof(s, i), H, X, H, b, err);
        if (rc != MODAL_OK)
            break;
        for (int k = 0; k <= H; k++)
            a[k] -= b[k];                               /* loads cancel in the difference */
        b[0] *= open ? 0 : 1;                           /* one of many is no measure */
        if (amplitude != NULL)
            *amplitude = fmax(*amplitude, orbit_peak(s->peaks, H, b, x));
        *out = fmax(*out, orbit_peak(s->peaks, H, a, x));
    }
    free(a);
    free(b);
    free(x);
    return rc;
}

/* X of H harmonics as one of H2, the new ones 0. */
static void widen_motion(const double complex *X, int q, int H, int H2, double complex *E)
{
    memset(E, 0, (size_t)q * ((size_t)H2 + 1) * sizeof *E);
    for (int i = 0; i < q; i++)
        memcpy(E + i * (H2 + 1), X + i * (H + 1), ((size_t)H + 1) * sizeof *E);
}

/* In place of (1), what R of E drives through S_k and the laws as springs, of all harmonics at once
 * where that is cheap; *DONE false: it is not. */
static enum modal_status tail_together(struct balance *wide, int H, double complex *E, bool *done,
                                       struct modal_error *err)
{
    int q = wide->q, K = wide->H + 1, n = 2 * wide->H + 1;
    double *y = NULL;

    *done = balance_on_inputs(wide);
    if (!*done)
        return MODAL_OK;
    y = calloc((size_t)wide->order + 1, sizeof *y);
    if (y == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a tail");
    for (int i = 0; i < q; i++)
        for (int r = 2 * H + 1; r < n; r++)
            y[i * n + r] = -wide->R[i * n + r];
    *done = balance_solve_springs(wide, y);
    for (int i = 0; *done && i < q; i++)
        for (int k = H + 1; k < K; k++)
            E[i * K + k] += CMPLX(y[i * n + 2 * k - 1], y[i * n + 2 * k]);
    free(y);
    return MODAL_OK;
}

/* (1): harmonics past H of E from the wide balance's F */
static enum modal_status tail_of(struct balance *wide, int H, double complex *E,
                                 struct modal_error *err)
{
    int q = wide->q, K = wide->H + 1;
    double complex *rhs;
    bool done;
    enum modal_status rc = tail_together(wide, H, E, &done, err);

    if (rc != MODAL_OK || done)
        return rc;
    rhs = malloc(((size_t)q + 1) * sizeof *rhs);
    if (rhs == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for a tail");
    for (int k = H + 1; k < K; k++) {
        for (int i = 0; i < q; i++)
            rhs[i] = wide->load[k * q + i] - wide->F[i * K + k];  /* p_k - F_k of (1) */
        if (stiffness_solve(wide->stiffness, k, rhs))   /* else 0: a resonance past H */
            for (int i = 0; i < q; i++)
                E[i * K + k] = rhs[i];
    }
    free(rhs);
    return MODAL_OK;
}

/* The chord step of (2) on harmonics 0 .. H: E_low = X_low - J^-1 R_low(wide), J factored in b, but
 * for the means of M. */
static void chord(struct balance *b, const struct unheld *m, const struct balance *wide,
                  const double complex *X, double *y, double complex *E)
{
    int n = 2 * b->H + 1, n2 = 2 * wide->H + 1, K = b->H + 1, K2 = wide->H + 1;

    for (int i = 0; i < b->q; i++)
        for (int r = 0; r < n; r++)
            y[i * n + r] = -wide->R[i * n2 + r];        /* -R_low of (2) */
    balance_solve(b, y);                     /* J^-1 of (2), as the point's last step factored it */
    unheld_leave(b, m, y);
    for (int i = 0; i < b->q; i++)
        for (int k = 0; k < K; k++)
            E[i * K2 + k] =
                X[i * K + k] + (k == 0 ? y[i * n] : CMPLX(y[i * n + 2 * k - 1], y[i * n + 2 * k]));
}

/* What X of H harmonics, wide->F and R of it, leaves of the equation of motion: past H, F_k - p_k;
 * of those up to H, which a point balances, what it leaves where IN_ALL.  Its rms, and at most its
 * sum in time. */
static void left_in_time(const struct balance *wide, int H, bool in_all,
                         struct steady_point *point)
{
    int K = wide->H + 1, n = 2 * wide->H + 1;
    double squares = 0;

    point->tail_max = point->load_max = 0;
    for (int i = 0; i < wide->q; i++) {
        const double *R = wide->R + i * n;
        double sum = 0, load = 0;

        for (int k = in_all ? 0 : H + 1; k < K; k++) {
            double left = k > H ? cabs(wide->F[i * K + k] - wide->load[k * wide->q + i])
                          : k > 0 ? hypot(R[2 * k - 1], R[2 * k]) : fabs(R[0]);

            /* a harmonic's mean square is half of |.|^2 */
            squares += left * left / (k > 0 ? 2 : 1);
            sum += left;                                /* its peak is at most the sum */
        }
        for (int k = 0; k < K; k++)
            load += cabs(wide->load[k * wide->q + i]) + (k <= H ? cabs(wide->F[i * K + k]) : 0);
        point->tail_max = fmax(point->tail_max, sum);
        point->load_max = fmax(point->load_max, load);
    }
    point->tail_rms = sqrt(squares);
}

/* A balance of H2 harmonics that is not kept, its work counted as that of the session's. */
static enum modal_status wide_balance(struct steady *s, int H2, int N2, bool located,
                                      struct balance **out, struct modal_error *err)
{
    enum modal_status rc = balance_new(s->p, s->c, H2, N2, located, out, err);

    if (rc == MODAL_OK) {
        (*out)->budget = &s->budget;
        (*out)->joint = s->joint;
    }
    return rc;
}

/* The same for estimates, the session's: the last serves again where it is such a one, as from
 * point to point of a curve. */
static enum modal_status kept_wide(struct steady *s, int H2, int N2, struct balance **out,
                                   struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (s->wide == NULL || s->wide->H != H2 || aft_samples(s->wide->aft) != N2) {
        balance_free(s->wide);
        s->wide = NULL;
        rc = wide_balance(s, H2, N2, !s->opt.unlocated || s->exact, &s->wide, err);
    }
    *out = s->wide;
    return rc;
}

struct estimate {
    int H2;
    struct unheld mean;
    struct balance *wide;                   /* of H2 harmonics, the session's */
    double complex *W, *sampled, *E;        /* X widened; its chord step, (2) without the tail;
                                             * and with it */
    double *y;
};

/* Frees what E holds, and S's wide balance where it is large: filling it costs more than a plan. */
static void estimate_done(struct steady *s, struct estimate *e)
{
    if (s->wide != NULL && (long)pattern_entries(s->wide->pattern) * s->wide->H > WIDE_KEPT) {
        balance_free(s->wide);
        s->wide = NULL;
    }
    unheld_done(&e->mean);
    free(e->W);
    free(e->sampled);
    free(e->E);
    free(e->y);
}

/* Room and the wide balance, of H2 harmonics and of twice the samples at least. */
static enum modal_status estimate_init(struct steady *s, const struct balance *b,
                                       struct estimate *e, struct modal_error *err)
{
    int H = b->H, H2 = balance_on_inputs(b) && H >= WIDE_FEW ? WIDEN_ON_INPUTS * H
                       : H < WIDE_FEW && !condense_factors(s->c) ? WIDE_LEAST
                       : WIDEN * H < ORBIT_HARMONICS_MOST / 2 ? WIDEN * H
                                                              : H + WIDE_MORE;
    long sampled = b->aft != NULL ? 2L * aft_samples(b->aft) : 0;
    int N2 = steady_power_of_two(s->exact ? 4L * H2 : sampled > 8L * H2 ? sampled : 8L * H2);
    size_t size = (size_t)b->q * ((size_t)H2 + 1);

    *e = (struct estimate){ .H2 = H2,
                            .W = calloc(size + 1, sizeof *e->W),
                            .sampled = calloc(size + 1, sizeof *e->sampled),
                            .E = calloc(size + 1, sizeof *e->E),
                            .y = calloc((size_t)b->order + 1, sizeof *e->y) };
    if (e->W == NULL || e->sampled == NULL || e->E == NULL || e->y == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for an estimate");
    return kept_wide(s, H2, N2, &e->wide, err);
}

/* The wide balance at the frequency of B: of many linear dofs, of which each harmonic takes sparse
 * factors, it has those alone that (1) moves.  Of a motion that is its own reverse half a period
 * later these are every other one, of cubic laws none past 3 H. */
static enum modal_status set_wide(const struct balance *b, struct estimate *e,
                                  struct modal_error *err)
{
    struct balance *w = e->wide;
    int K = w->H + 1;
    double most = 0;
    bool some = condense_factors(b->c) && b->p->harmonics == 0;
    enum modal_status rc = MODAL_OK;

    if (some)
        rc = aft_force(w->aft, b->omega, e->W, w->F, err);
    if (rc != MODAL_OK)
        return rc;
    for (int k = b->H + 1; k < K; k++)
        for (int i = 0; i < w->q; i++)
            most = fmax(most, cabs(w->F[i * K + k]));
    for (int k = b->H + 1; k < K; k++)
        for (int i = 0; i < w->q; i++)
            w->F[i * K + k] *= cabs(w->F[i * K + k]) > UNMOVED * most ? 1 : 0;
    if (some)                                           /* no load is past H */
        condense_rough(b->c, b->H, w->F, w->H);
    rc = balance_set(w, b->omega, b->level, err);
    condense_rough(b->c, 0, NULL, 0);
    return rc;
}

/* The chord step without the tail into e->sampled: what sampling alone moves. */
static enum modal_status move_by_samples(struct balance *b, struct estimate *e,
                                         struct steady_point *point, struct modal_error *err)
{
    enum modal_status rc;

    widen_motion(point->X, b->q, b->H, e->H2, e->W);
    rc = set_wide(b, e, err);
    if (rc == MODAL_OK)
        rc = balance_residual(e->wide, e->W, false, err);
    if (rc != MODAL_OK)
        return rc;
    left_in_time(e->wide, b->H, false, point);          /* of the point itself */
    memcpy(e->sampled, e->W, (size_t)b->q * ((size_t)e->H2 + 1) * sizeof *e->W);
    chord(b, &e->mean, e->wide, point->X, e->y, e->sampled);
    return MODAL_OK;
}

/* The tail and the chord step with it into e->E, by (1) and (2). */
static enum modal_status move_by_tail(struct balance *b, struct estimate *e,
                                      const struct steady_point *point, struct modal_error *err)
{
    enum modal_status rc;

    memcpy(e->E, e->W, (size_t)b->q * ((size_t)e->H2 + 1) * sizeof *e->W);
    rc = tail_of(e->wide, b->H, e->E, err);                                        /* (1) */
    if (rc == MODAL_OK)
        rc = balance_residual(e->wide, e->E, false, err);
    if (rc != MODAL_OK)
        return rc;
    chord(b, &e->mean, e->wide, point->X, e->y, e->E);                             /* (2) */
    return tail_of(e->wide, b->H, e->E, err);
}

/* What the receptances' own doubt makes of the motion: forces of that share of S_k X_k, their signs
 * in turn, taken through J^-1; over time at most the sum over harmonics. */
static enum modal_status doubt_of(struct balance *b, const struct unheld *m,
                                  const struct steady_point *point, double *y, double *out,
                                  struct modal_error *err)
{
    int K = b->H + 1, n = 2 * b->H + 1;
    double complex *force = calloc((size_t)b->q + 1, sizeof *force);
    double doubts = 0;

    *out = 0;
    if (force == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for an estimate");
    for (int k = 0; k < K; k++) {
        double size = 0, doubt = condense_doubt(b->c, k);

        memset(force, 0, (size_t)b->q * sizeof *force);
        if (doubt > 0)
            stiffness_multiply_add(b->pattern, b->S, k, point->X + k, K, force);
        for (int i = 0; i < b->q; i++)
            size = fmax(size, cabs(force[i]));
        for (int i = 0; i < b->q; i++)
            for (int r = k > 0 ? 2 * k - 1 : 0; r <= 2 * k; r++)
                y[i * n + r] = ((i + r) % 2 == 0 ? 1 : -1) * doubt * size;
        doubts = fmax(doubts, doubt);
    }
    free(force);
    if (doubts == 0)
        return MODAL_OK;
    balance_solve(b, y);
    unheld_leave(b, m, y);
    for (int i = 0; i < b->q; i++) {
        double sum = 0;

        for (int k = 0; k < K; k++)
            sum += k == 0 ? fabs(y[i * n]) : hypot(y[i * n + 2 * k - 1], y[i * n + 2 * k]);
        *out = fmax(*out, sum);
    }
    *out += doubts * point->amplitude;                  /* of what is recovered */
    return MODAL_OK;
}

/* The point's errors: NAN where its derivative is singular or a step overflows. */
enum modal_status estimate_errors(struct steady *s, struct balance *b, struct steady_point *point,
                                  struct modal_error *err)
{
    const struct iterate_options opt = steady_iterate_options(s);
    struct estimate e;
    double doubtful = 0;
    enum modal_status rc = estimate_init(s, b, &e, err);

    point->truncation = point->sampling = point->solver = point->error = NAN;
    if (rc == MODAL_OK)
        rc = balance_residual(b, point->X, false, err);
    if (rc == MODAL_OK)
        rc = graze_leave(b, &opt, point->X, err);
    if (rc == MODAL_OK)
        point->residual = balance_relative_residual(b, point->X);
    /* A chord needs no better matrix than the one its steps had. */
    if (rc == MODAL_OK && !b->pattern->full)
        /* off by its gain, a tenth, where it is short */
        balance_set_order(b, iterate_order(b, 0));
    if (rc == MODAL_OK)
        rc = balance_derivative(b, err);
    if (rc == MODAL_OK)
        rc = unheld_factor(b, &e.mean, err);
    if (rc == MODAL_OK && unheld_any(&e.mean) && b->factored) {
        rc = unheld_settle(b, &e.mean, &opt, point->X, &point->residual, err);
        unheld_done(&e.mean);
        if (rc == MODAL_OK)
            rc = balance_derivative(b, err);
        if (rc == MODAL_OK)
            rc = unheld_factor(b, &e.mean, err);
    }
    point->open = rc == MODAL_OK && unheld_any(&e.mean);
    if (rc != MODAL_OK || !b->factored || (rc = move_by_samples(b, &e, point, err)) != MODAL_OK)
        goto out;
    point->amplitude = 0;
    rc = peak_of_change(s, e.sampled, e.W, e.H2, point->open, &point->sampling,
                        &point->amplitude, err);
    if (rc == MODAL_OK)
        rc = move_by_tail(b, &e, point, err);
    if (rc == MODAL_OK)
        rc = peak_of_change(s, e.E, e.W, e.H2, false, &point->error, NULL, err);
    if (rc == MODAL_OK)
        /* what sampling does not explain */
        rc = peak_of_change(s, e.E, e.sampled, e.H2, false, &point->truncation, NULL, err);
    if (rc == MODAL_OK)
        rc = doubt_of(b, &e.mean, point, e.y, &doubtful, err);
    if (rc == MODAL_OK) {
        point->truncation += condense_left(b->c);
        point->error += condense_left(b->c);            /* of harmonics that (1) has not */
        point->solver = point->step * point->amplitude + doubtful;
        point->error += point->solver;                  /* independent of both */
    }
out:
    balance_set_order(b, b->H);
    estimate_done(s, &e);
    return rc == MODAL_OVERFLOW ? MODAL_OK : rc;
}

enum modal_status estimate_near(struct steady *s, struct balance *b, double complex *X,
                                struct steady_point *point, bool *found, struct modal_error *err)
{
    struct iterate_options opt = steady_iterate_options(s);
    struct iterate_report r = { 0 };
    enum modal_status rc = iterate_newton(b, &opt, X, &r, err);

    *found = rc == MODAL_OK && r.converged;
    if (!*found)
        return rc;
    rc = steady_point_of(s, b, X, point, err);
    if (rc == MODAL_OK) {
        point->method = "newton";
        point->attempts = 1;
        point->iterations = r.iterations;
        point->step = r.step;
        point->work = s->budget;
        rc = estimate_errors(s, b, point, err);
    }
    *found = rc == MODAL_OK;
    return rc;
}

enum modal_status steady_estimate_point(struct steady *s, struct steady_point *point,
                                        struct modal_error *err)
{
    struct balance *b;
    enum modal_status rc;

    if (s->linear || s->jumps || point->followed)
        return MODAL_OK;
    if (!s->opt.estimate_later && point->error > 0)
        return MODAL_OK;                                   /* it has them */
    steady_allow_work(s);
    rc = steady_balance(s, point->H, &b, err);
    if (rc == MODAL_OK)
        rc = balance_set(b, point->omega, 1, err);
    if (rc == MODAL_OK)
        rc = estimate_errors(s, b, point, err);
    return rc == MODAL_OK ? balance_set(b, point->omega, 1, err) : rc;
}

/* What rounds of (1) and (2) show: each multiplies the distance to their end by a factor, which is
 * no less than 1 where the laws' slopes past H are not small against S_k. */
struct rounds {
    int done, largest;          /* how many; the one of them that moved most */
    double moved, most;         /* the first harmonics, by the last one and by that, */
    double size;                /* of which this was the largest before the last */
};

/* One round of (1) and (2) on E, counted in *R.  LOW has room for the first harmonics. */
static enum modal_status extend_once(struct balance *b, const struct unheld *m,
                                     struct balance *wide, double complex *low, double *y,
                                     double complex *E, struct rounds *r, struct modal_error *err)
{
    int K = b->H + 1, K2 = wide->H + 1;
    enum modal_status rc = balance_residual(wide, E, false, err);

    if (rc != MODAL_OK)
        return rc;
    for (int i = 0; i < b->q; i++)
        memcpy(low + i * K, E + i * K2, (size_t)K * sizeof *low);
    chord(b, m, wide, low, y, E);                                                     /* (2) */
    r->moved = r->size = 0;
    for (int i = 0; i < b->q; i++)
        for (int k = 0; k < K; k++) {
            r->moved = fmax(r->moved, cabs(E[i * K2 + k] - low[i * K + k]));
            r->size = fmax(r->size, cabs(low[i * K + k]));
        }
    if (r->done++ == 0 || r->moved > r->most) {
        r->most = r->moved;
        r->largest = r->done;
    }
    return tail_of(wide, b->H, E, err);                                            /* (1) */
}

/* How far rounds are from their end: at a rate r a round since the largest, r / (1 - r) times the
 * last.  What shrinks no more is rounding, or drifts: it goes on for as many rounds as it had. */
static double left_of(const struct rounds *r)
{
    int since = r->done - r->largest;
    double rate = since > 0 ? pow(r->moved / r->most, 1.0 / since) : 1;

    return r->moved * (rate < 1 ? fmin(rate / (1 - rate), r->done) : r->done);
}

enum modal_status steady_extend(struct steady *s, const struct steady_point *point, int H2,
                                double complex *E, double *left, bool *done,
                                struct modal_error *err)
{
    struct balance *wide = NULL, *b;
    struct unheld mean = { .count = 0 };
    struct rounds r = { .done = 0 };
    double complex *low = NULL;
    double *y = NULL;
    int most = s->jumps ? EXTENSIONS_OF_JUMPS : EXTENSIONS;
    bool away = false, still = false;
    enum modal_status rc = steady_balance(s, point->H, &b, err);

    *done = false;                                      /* until the last round */
    *left = HUGE_VAL;
    if (rc == MODAL_OK)
        rc = balance_set(b, point->omega, 1, err);
    if (rc == MODAL_OK)
        rc = balance_residual(b, point->X, true, err);
    if (rc == MODAL_OK)
        rc = unheld_factor(b, &mean, err);
    if (rc != MODAL_OK || !b->factored) {
        unheld_done(&mean);
        return rc;
    }
    y = calloc((size_t)b->order + 1, sizeof *y);
    low = calloc((size_t)b->q * ((size_t)b->H + 1) + 1, sizeof *low);
    rc = y == NULL || low == NULL ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory")
                                  : wide_balance(s, H2, steady_power_of_two(4L * H2 + 1), true,
                                                 &wide, err);
    if (rc == MODAL_OK)
        rc = balance_set(wide, point->omega, 1, err);
    if (rc == MODAL_OK)
        widen_motion(point->X, b->q, b->H, H2, E);
    while (rc == MODAL_OK && r.done < most && !still && !away && !budget_spent(b->budget)) {
        rc = extend_once(b, &mean, wide, low, y, E, &r, err);
        still = r.moved <= STILL * r.size;
        away = !still && !(r.moved < r.size);           /* no correction of this motion */
    }
    *done = rc == MODAL_OK && !away && (r.done == most || still);
    if (*done)
        *left = left_of(&r);
    if (rc == MODAL_OK)
        rc = balance_set(b, point->omega, 1, err);
    free(y);
    free(low);
    unheld_done(&mean);
    balance_free(wide);
    return rc;
}

/* The first harmonics of POINT carried on to LEAST, twice and four times as many into R, one after
 * the other, the last motion into E; how far what (3) makes of them may be from its end into
 * *UNSETTLED. */
static enum modal_status extend_thrice(struct steady *s, const struct steady_point *point,
                                       int least, double complex *E, double complex *R,
                                       double *unsettled, bool *done, struct modal_error *err)
{
    double left[LEVELS] = { 0 };
    enum modal_status rc = MODAL_OK;

    *done = true;
    for (int level = 0; rc == MODAL_OK && *done && level < LEVELS; level++) {
        int H = least << level;

        rc = steady_extend(s, point, H, E, &left[level], done, err);
        for (int i = 0; i < point->q; i++)
            for (int k = 0; k <= point->H; k++)
                *R++ = E[i * (H + 1) + k];
    }
    *unsettled = (8 * left[2] + 6 * left[1] + left[0]) / 3;                        /* (3) */
    return rc;
}

/* Where nothing holds the mean of POINT, which solves B, it is as near 0 as it may be. */
static enum modal_status settle_mean(struct steady *s, struct balance *b,
                                     struct steady_point *point, struct modal_error *err)
{
    const struct iterate_options opt = steady_iterate_options(s);
    struct unheld mean = { .count = 0 };
    enum modal_status rc = balance_residual(b, point->X, true, err);

    if (rc == MODAL_OK)
        rc = unheld_factor(b, &mean, err);
    point->open = rc == MODAL_OK && unheld_any(&mean);
    if (point->open && b->factored)
        rc = unheld_settle(b, &mean, &opt, point->X, &point->residual, err);
    unheld_done(&mean);
    return rc;
}

/* What POINT, as W of H2 harmonics, leaves of the equation of motion: its own H balance no more. */
static enum modal_status left_of_sharp(struct steady *s, const double complex *W, int H2,
                                       struct steady_point *point, struct modal_error *err)
{
    struct balance *wide = NULL;
    enum modal_status rc =
        wide_balance(s, H2, steady_power_of_two(4L * H2 + 1), true, &wide, err);

    if (rc == MODAL_OK)
        rc = balance_set(wide, point->omega, 1, err);
    if (rc == MODAL_OK)
        rc = balance_residual(wide, W, false, err);
    if (rc == MODAL_OK)
        left_in_time(wide, point->H, true, point);
    balance_free(wide);
    return rc;
}

/*
 * Rigid friction jumps where the motion turns, and there a series of H harmonics has its worst
 * error: the turns, and with them every harmonic, are off by c_1/H + c_2/H^2 + ...  The motion is
 * carried on to SHARP/4, SHARP/2 and SHARP harmonics and its first H extrapolated to none missing;
 * what is left is the tail that the H harmonics given do not hold.
 */
enum modal_status estimate_sharpen(struct steady *s, struct balance *b, struct steady_point *point,
                                   struct modal_error *err)
{
    int H = point->H, least = H < SHARP / 8 ? SHARP / 4 : 2 * H, H2 = 4 * least, q = point->q,
        K2 = H2 + 1;
    size_t size = (size_t)q * (size_t)K2 + 1;
    double complex *E = calloc(size, sizeof *E), *low = calloc(size, sizeof *low);
    double complex *S = calloc((size_t)pattern_entries(b->pattern) * (size_t)K2 + 1, sizeof *S);
    double complex *load = calloc(size, sizeof *load),
                   *R = calloc(3 * (size_t)q * ((size_t)H + 1) + 1, sizeof *R);
    double unsettled = 0;
    size_t part = (size_t)q * ((size_t)H + 1);
    bool done = false;
    enum modal_status rc = E == NULL || low == NULL || S == NULL || load == NULL || R == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory")
                               : MODAL_OK;

    if (rc == MODAL_OK)
        rc = settle_mean(s, b, point, err);
    if (rc == MODAL_OK)
        rc = extend_thrice(s, point, least, E, R, &unsettled, &done, err);
    if (rc == MODAL_OK && !done)
        rc = estimate_errors(s, b, point, err);         /* the motion as it is, and how far off */
    if (rc == MODAL_OK && !done)
        rc = balance_set(b, point->omega, 1, err);
    if (rc != MODAL_OK || !done)
        goto out;
    point->solver = point->sampling = point->amplitude = 0;
    for (size_t i = 0; i < part; i++) {
        /* c_1/H out */
        double complex a = 2 * R[part + i] - R[i], c = 2 * R[2 * part + i] - R[part + i];

        point->X[i] = (4 * c - a) / 3;                  /* c_2/H^2 out */
        point->sampling = fmax(point->sampling, cabs(point->X[i] - c));  /* what that moved */
    }
    widen_motion(point->X, q, H, H2, low);
    rc = left_of_sharp(s, low, H2, point, err);
    for (int i = 0; i < q; i++)
        for (int k = 0; k <= H; k++)
            E[i * K2 + k] = low[i * K2 + k];
    /* Recovery of the dofs taken out, at so many harmonics: S itself is not used. */
    if (rc == MODAL_OK)
        rc = condense_at(s->c, point->omega, 1, H2, S, load, err);
    if (rc == MODAL_OK)
        rc = peak_of_change(s, E, low, H2, point->open, &point->error, &point->amplitude, err);
    point->truncation = point->error;
    point->error += point->sampling + unsettled;
    point->solver = point->step * point->amplitude + unsettled;
    if (rc == MODAL_OK)
        rc = balance_set(b, point->omega, 1, err);
out:
    free(E);
    free(low);
    free(S);
    free(load);
    free(R);
    return rc;
}
