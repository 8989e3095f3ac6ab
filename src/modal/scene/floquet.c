/*
 * floquet.c - see floquet.h
 *
 * Constant programs: the eigenvalues of A (statespace.h), 2 x 2 block by block in closed form where
 * the modes decouple. Periodic ones: the monodromy matrix Phi(T) by Magnus steps, its eigenvalues
 * rho.  An eigenvalue moves by at most kappa e to first order under a perturbation of norm e, kappa
 * = 1 / |y^H x| (left and right unit eigenvectors), and by about sqrt(e |Phi|) where two meet: the
 * smaller of both is its bar.  A multiplier that does not exceed its bar is below rounding and has
 * no exponent.  A double one that e parts by 2 d has kappa = 1 / (2 d) and e = d^2 where Phi's norm
 * is 1, so that kappa e is half of what it is off by: two within twice their bars together may be
 * one, and half of what parts them is added to both.
 *
 * Of a large or stiff periodic program the leading multipliers alone are asked for, each bar its
 * residual times kappa: of vectors carried over a period (leading.h), and where these do not settle
 * soon, as multipliers crowd or steps are too many, of windows of Hill's matrix (hill_leading.h).
 * Windows know as well what a multiplier that may be real moves by as entries of the matrices are
 * rounded, which is added to its residual: a rigid motion's stiffness is rounding alone.
 *
 * Of a map that takes seconds windows are asked for the whole spectrum first, but where a motion is
 * rigid, whose multiplier is double, with one vector, mostly.  As many as there are states, each
 * another motion, are all of them where their product is what Liouville's formula says,
 * ln|rho_1 ... rho_N| = T tr A; else the map is made.
 *
 * Windows look where first order in what pulsates says that leading ones may be: where vectors cost
 * little they are carried until the leading ones are known to 1e-6, and small windows refine those.
 *
 * A shaft on fixed axes that is constant on turning ones (turning.h) has the exponents lambda of
 * those, and over a period T that holds m half turns rho = (-1)^m exp(lambda T), R(W T) being +-I:
 * exact however stiff the shaft.
 *
 * ln|rho| near the circle is log1p((|rho| - 1)(|rho| + 1)) / 2 of the squared modulus, without
 * cancellation.
 */
#include "modal/scene/floquet.h"
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/eigen.h"
#include "modal/scene/dofwise.h"
#include "modal/scene/hill_found.h"
#include "modal/scene/hill_leading.h"
#include "modal/scene/leading.h"
#include "modal/scene/magnus.h"
#include "modal/scene/period_map.h"
#include "modal/scene/statespace.h"
#include "modal/scene/turning.h"

/* STATESPACE_RIGID and its rounding: a mode that was put there, and not one that is there */
static const double RIGID_SEEN = 1.0001e-7;
/* of a squared frequency, over the largest */
static const double RIGID_ROUNDING = 8 * DBL_EPSILON;
static const double WORK_FIRST = 3e8;   /* operations on vectors carried before windows: chosen */
static const double WORK_ALL = 1e9;     /* the same, on as many vectors as there are states */
static const double WORK_ROUGH = 1e10;  /* the same, where vectors are cheap: some eight seconds */
enum {
    CARRIED_LEAST = 4,                  /* vectors a multiplier, before which none settles */
    SETTLE = 4,                         /* so many states a vector, before leading ones settle */
    BELOW = 4,                          /* multipliers past the last that show it is the last */
};
static const double WORK_WHOLE = 2e12;  /* of whole maps, dense: chosen, minutes */
/* of the same, past which windows are asked for all multipliers first, for as much: chosen, two
 * seconds */
static const double WORK_MAP = 2e10;
static const double MAGNUS_WORK = 40;   /* products a radian of the fastest, some 20 exponentials */
static const double RESIDUAL = 1e-9;    /* of leading multipliers, over the largest of them */
/* of those that windows refine: a third fewer vectors, where moduli differ by less they are not
 * told apart: chosen */
static const double ROUGH = 1e-6;

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "floquet: out of memory");
}

/* Arrays of COUNT exponents; floquet_done frees them, on failure too. */
static enum modal_status make(int count, struct floquet *f, struct modal_error *err)
{
    f->count = count;
    f->multiplier = workspace_zeros(&f->space, (size_t)count, sizeof *f->multiplier);
    f->exponent = workspace_zeros(&f->space, (size_t)count, sizeof *f->exponent);
    f->bar = workspace_zeros(&f->space, (size_t)count, sizeof *f->bar);
    f->resolved = workspace_zeros(&f->space, (size_t)count, sizeof *f->resolved);
    return f->space.failed ? no_memory(err) : MODAL_OK;
}

void floquet_done(struct floquet *f)
{
    workspace_free(&f->space);
    memset(f, 0, sizeof *f);
}

/* The Frobenius norm: e times it is what rounding does to a matrix that is computed with. */
static double norm_of(int n, const double *A)
{
    double sum = 0;

    for (size_t i = 0; i < (size_t)n * (size_t)n; i++)
        sum += A[i] * A[i];
    return sqrt(sum);
}

/* Eigenvalues of the block [0 s; -k/s -c]: roots of lambda^2 + c lambda + k. */
static void block_roots(double c, double k, double complex root[2])
{
    double d = c * c / 4 - k;  /* a quarter of the discriminant */

    if (d < 0) {
        root[0] = CMPLX(-c / 2, sqrt(-d));
        root[1] = CMPLX(-c / 2, -sqrt(-d));
    } else {                     /* the larger in magnitude first: the other by their product */
        double far = -c / 2 - copysign(sqrt(d), c);
        root[0] = far;
        root[1] = far != 0 ? k / far : 0;  /* no cancellation: root_0 root_1 = k */
    }
}

/* What rounding of the modal products leaves in every squared frequency; 0: all of them stand above
 * it (no rigid motion).  Within it exponents are +-sqrt(-k) of rounding alone. */
static double rigid_rounding(const struct statespace *ss)
{
    double largest = 0, least = HUGE_VAL;

    for (int i = 0; i < ss->n; i++) {
        largest = fmax(largest, ss->s[i]);
        least = fmin(least, ss->s[i]);
    }
    return least <= RIGID_SEEN * largest ? RIGID_ROUNDING * largest * largest : 0;
}

/* Each 2 x 2 block [[0, s], [-a, -b]] has the roots of its own quadratic. */
static void decoupled_exponents(const struct statespace *ss, struct floquet *f)
{
    int n = ss->n;
    size_t N = (size_t)ss->N;
    /* damping: the largest, whose rounding the modal products leave in all */
    double damping = 0, rigid = rigid_rounding(ss);

    for (int i = 0; i < n; i++)
        damping = fmax(damping, fabs(ss->A[(size_t)(n + i) + (size_t)(n + i) * N]));
    for (int i = 0; i < n; i++) {
        double s = ss->A[(size_t)i + (size_t)(n + i) * N],
               k = -ss->A[(size_t)(n + i) + (size_t)i * N] * s;
        double c = -ss->A[(size_t)(n + i) + (size_t)(n + i) * N];
        block_roots(c, k, f->exponent + 2 * i);
        for (int j = 0; j < 2; j++)
            f->bar[2 * i + j] = fabs(k) <= rigid ? sqrt(fabs(k) + rigid)
                                                 : 8 * DBL_EPSILON * (damping + DBL_EPSILON * s);
    }
}

/* Eigenvalues of the whole A, each with its condition from the left and right vectors. */
static enum modal_status coupled_exponents(const struct statespace *ss, struct floquet *f,
                                           struct modal_error *err)
{
    size_t count = (size_t)ss->N * (size_t)ss->N;
    double *copy = malloc(count * sizeof *copy + 1),
           *condition = malloc((size_t)ss->N * sizeof *condition + 1), e,
           rigid = rigid_rounding(ss);
    struct matrix A = { ss->N, ss->N, ss->N, copy };
    enum modal_status rc = copy != NULL && condition != NULL ? MODAL_OK : no_memory(err);

    if (rc == MODAL_OK) {
        memcpy(copy, ss->A, count * sizeof *copy);
        e = DBL_EPSILON * norm_of(ss->N, copy);  /* backward error of the eigenvalues */
        rc = eigen_general(&A, f->exponent, condition, NULL, err);
        for (int i = 0; rc == MODAL_OK && i < ss->N; i++)
            /* kappa e, or the root where two meet */
            f->bar[i] = fmin(condition[i] * e, e / sqrt(DBL_EPSILON));
        for (int i = 0; rc == MODAL_OK && i < ss->N; i++)
            if (cabs(f->exponent[i]) * cabs(f->exponent[i]) <= rigid)
                f->bar[i] = fmax(f->bar[i], sqrt(2 * rigid));
    }
    free(copy);
    free(condition);
    return rc;
}

/* Exponents by themselves; multipliers e^(lambda T) where a period is given. */
static enum modal_status constant(const struct statespace *ss, double period, struct floquet *f,
                                  struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (ss->modal)
        decoupled_exponents(ss, f);
    else
        rc = coupled_exponents(ss, f, err);
    f->period = period;
    for (int i = 0; rc == MODAL_OK && i < f->count; i++) {
        if (!isfinite(cabs(f->exponent[i])))
            rc = modal_fail(err, MODAL_OVERFLOW, "an exponent leaves the range of doubles: masses "
                            "and stiffnesses are too far apart");
        f->resolved[i] = true;
        /* exact but for rounding: nothing is mapped */
        f->multiplier[i] = period > 0 ? cexp(f->exponent[i] * period) : 0;
    }
    return rc;
}

/* The principal value: Im in (-pi, pi] / T. */
static double complex exponent_of(double complex rho, double period)
{
    double re = fabs(creal(rho)), im = cimag(rho), square = re * re + im * im;
    double log_modulus =
        square > 0.5 && square < 2 ? log1p((re - 1) * (re + 1) + im * im) / 2 : log(cabs(rho));
    double angle = atan2(im == 0 ? 0.0 : im, creal(rho));  /* -0 would turn pi into -pi */

    return CMPLX(log_modulus / period, angle / period);
}

/* What rigid modes' stiffness, which is 0 but for rounding, does in a period to an eigenvector X
 * of the map: it stands in A over a scale that is small. */
static double rigid_share(const struct statespace *ss, double period, const double complex *x)
{
    double square = 0, share = 0;

    for (int i = 0; i < ss->n; i++)
        square = fmax(square, ss->s[i] * ss->s[i]);
    for (int i = 0; i < ss->n; i++) {
        double k = fabs(ss->A[(size_t)(ss->n + i) + (size_t)i * (size_t)ss->N]) * ss->s[i];
        if (k <= RIGID_ROUNDING * square)
            share += cabs(x[i]) * (k + DBL_EPSILON * square) / ss->s[i] * period;
    }
    return share;
}

/* Eigenvalues of the monodromy matrix, mapped by Magnus steps. */
static enum modal_status periodic(const struct statespace *ss, double period,
                                  const struct floquet_options *opt, struct floquet *f,
                                  struct modal_error *err)
{
    size_t count = (size_t)ss->N * (size_t)ss->N;
    struct workspace space = { 0 };
    double *Phi = workspace_zeros(&space, count, sizeof *Phi),
           *condition = workspace_zeros(&space, (size_t)ss->N, sizeof *condition), norm = 0, e = 0;
    double complex *V = workspace_zeros(&space, count, sizeof *V);
    struct matrix A = { ss->N, ss->N, ss->N, Phi };
    struct magnus *m = NULL;
    double tolerance = opt != NULL && opt->tolerance > 0 ? opt->tolerance : 1e-12;
    enum modal_status rc = space.failed ? no_memory(err) : magnus_new(ss, NULL, &m, err);

    f->substeps = 16;
    if (rc == MODAL_OK)
        rc = magnus_converge(m, 0, period, tolerance, &f->substeps, Phi, &f->error, err);
    if (rc == MODAL_OVERFLOW)
        modal_fail(err, rc, "the growth over one period of %g s leaves the range of doubles",
                   period);
    if (rc == MODAL_OK) {
        norm = norm_of(ss->N, Phi);
        e = fmax(f->error, DBL_EPSILON) * norm;  /* what Phi is off by */
        rc = eigen_general(&A, f->multiplier, condition, V, err);
    }
    for (int i = 0; rc == MODAL_OK && i < ss->N; i++) {
        double off = e + rigid_share(ss, period, V + (size_t)i * (size_t)ss->N);

        f->bar[i] = fmin(condition[i] * off, sqrt(off * norm));  /* as the opening has it */
        /* else its logarithm is of rounding */
        f->resolved[i] = cabs(f->multiplier[i]) > f->bar[i];
        f->exponent[i] = f->resolved[i] ? exponent_of(f->multiplier[i], period) : 0;
    }
    f->periodic = true;
    f->period = period;
    magnus_free(m);
    workspace_free(&space);
    return rc;
}

/* Operations of a whole map, dense, nearly. */
static double map_work(const struct program *p, double period)
{
    double frequency, decay, n = 2.0 * p->n;

    dofwise_fastest(p, &frequency, &decay);
    return period * (frequency + decay) * MAGNUS_WORK * n * n * n;
}

/* The products that WORK pays: carried, and each a vector beside all before. */
static int products_most(const struct period_map *map, double work)
{
    double carried = period_map_work(map);
    int m = CARRIED_LEAST;

    while (m < ARNOLDI_MOST && m * (carried + leading_vector_work(map, m)) < work)
        m++;
    return m;
}

/* Vectors carried before windows: all that there are, where these cost little more. */
static int first_products(const struct period_map *map)
{
    int all = period_map_states(map);

    return products_most(map, WORK_ALL) >= all ? all : products_most(map, WORK_FIRST);
}

/* COUNT multipliers into F, with bars as the opening has them; ROUNDING NULL: of none. */
static enum modal_status take_leading(int count, const double complex *w, const double *residual,
                                      const double *rounding, const double *condition,
                                      double period, struct floquet *f, struct modal_error *err)
{
    enum modal_status rc = make(count, f, err);
    double *own = rc == MODAL_OK ? workspace_zeros(&f->space, (size_t)count, sizeof *own) : NULL;

    if (rc == MODAL_OK && own == NULL)
        return no_memory(err);
    for (int i = 0; rc == MODAL_OK && i < count; i++)
        own[i] = hill_motion_bar(residual[i] + (rounding != NULL ? rounding[i] : 0), condition[i]);
    for (int i = 0; rc == MODAL_OK && i < count; i++) {
        double parted = 0;                       /* from those that may be the same */

        for (int j = 0; j < count; j++)
            if (cabs(w[i] - w[j]) <= 2 * (own[i] + own[j]))
                parted = fmax(parted, cabs(w[i] - w[j]));
        f->multiplier[i] = w[i];
        f->bar[i] = own[i] + parted / 2;
        f->error = fmax(f->error, residual[i]);
        f->resolved[i] = cabs(f->multiplier[i]) > f->bar[i];
        f->exponent[i] = f->resolved[i] ? exponent_of(f->multiplier[i], period) : 0;
    }
    return rc;
}

/* Is a vector carried for less than a product with a dense map takes, which is not so of what is
 * stiff, and are enough of them paid for that leading multipliers settle roughly? */
static bool is_cheap(const struct period_map *map)
{
    double states = period_map_states(map);

    return period_map_work(map) <= states * states
           && products_most(map, WORK_ROUGH) >= states / SETTLE;
}

/* What L has, as hints: not folded, by the frequency that each motion has most of. */
static enum modal_status take_hints(const struct leading *l, double period,
                                    struct hill_hint **out, struct modal_error *err)
{
    double W = 2 * M_PI / period;

    *out = calloc((size_t)l->found.count + 1, sizeof **out);
    for (int i = 0; *out != NULL && i < l->found.count; i++) {
        double complex folded = exponent_of(l->found.w[i], period);
        double turns = round((l->frequency[i] - fabs(cimag(folded))) / W),
               other = round((l->frequency[i] + fabs(cimag(folded))) / W),
               near = fabs(fabs(cimag(folded)) + turns * W - l->frequency[i]),
               mirrored = fabs(other * W - fabs(cimag(folded)) - l->frequency[i]);
        double im = near <= mirrored ? fabs(cimag(folded)) + turns * W
                                     : other * W - fabs(cimag(folded));

        (*out)[i] = (struct hill_hint){ CMPLX(creal(folded), im), l->found.w[i],
                                        l->found.residual[i]
                                            * (l->found.settled ? l->found.condition[i] : 1) };
    }
    return *out != NULL ? MODAL_OK : no_memory(err);
}

/* By windows of Hill's matrix, of what has settled in L alone, each residual measured on MAP where
 * there is one; all that there are for WORK_MAP at most. */
static enum modal_status windows(const struct program *p, double period, int wanted,
                                 struct period_map *map, const struct leading *l,
                                 struct floquet *f, struct modal_error *err)
{
    struct hill_leading h = { 0 };
    struct hill_hint *hint = NULL;
    enum modal_status rc = take_hints(l, period, &hint, err);

    if (rc == MODAL_OK)
        rc = hill_leading(p, period, &(struct hill_ask){ .wanted = wanted, .hint = hint,
                                                         .hints = l->found.count,
                                                         .most = wanted == 2 * p->n ? WORK_MAP : 0,
                                                         .only_hints = l->found.settled },
                          &h, err);
    for (int i = 0; rc == MODAL_OK && map != NULL && i < h.count; i++)
        rc = leading_residual(map, h.multiplier[i], h.start + (size_t)i * 2 * (size_t)p->n,
                              &h.residual[i], err);
    if (rc == MODAL_OK)
        rc = take_leading(h.count, h.multiplier, h.residual, h.rounding, h.condition, period, f,
                          err);
    if (rc == MODAL_OK) {
        f->unsettled = !h.settled || f->error > RESIDUAL * cabs(h.multiplier[0]);
        f->alike = h.alike;
        f->windows = h.windows;
        f->sums_to = h.sums_to;
        f->growing = h.growing;
        f->substeps = 2 * h.harmonics + 1;
    }
    hill_leading_done(&h);
    free(hint);
    return rc;
}

/* By vectors carried until leading ones are known ROUGHly, which windows then refine.  F has none
 * where that leaves in doubt which of them are leading. */
static enum modal_status roughly(const struct program *p, double period, int wanted,
                                 struct period_map *map, struct leading *l, struct floquet *f,
                                 struct modal_error *err)
{
    enum modal_status rc = leading_multipliers(map, wanted + BELOW, ROUGH,
                                               products_most(map, WORK_ROUGH), l, err);

    f->periods = l->periods;
    if (rc != MODAL_OK || !l->found.settled)
        return rc;
    rc = windows(p, period, wanted, map, l, f, err);
    if (rc == MODAL_OK && !f->unsettled)
        return MODAL_OK;
    floquet_done(f);
    leading_done(l);
    return rc == MODAL_TOO_LARGE || rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}

/* By carrying vectors, or where these do not settle soon by windows. */
static enum modal_status leading(const struct program *p, double period, int wanted,
                                 struct floquet *f, struct modal_error *err)
{
    struct leading l = { 0 };
    struct period_map *map = NULL;
    bool cheap = false;
    enum modal_status rc =
        period_map_new(p, NULL, period, WORK_FIRST / (CARRIED_LEAST * wanted), &map, err);

    if (rc == MODAL_OK && first_products(map) < period_map_states(map) && is_cheap(map)) {
        cheap = true;
        rc = roughly(p, period, wanted, map, &l, f, err);
    }
    if (rc == MODAL_OK && f->count == 0 && l.found.count == 0)
        rc = leading_multipliers(map, wanted, RESIDUAL,
                                 cheap ? products_most(map, WORK_ROUGH) : first_products(map), &l,
                                 err);
    if (rc == MODAL_OK && f->count == 0 && l.found.settled) {
        f->substeps = period_map_steps(map);
        rc = take_leading(l.found.count, l.found.w, l.found.residual, NULL, l.found.condition,
                          period, f, err);
    } else if ((rc == MODAL_OK && f->count == 0) || rc == MODAL_TOO_LARGE)
        rc = windows(p, period, wanted, map, &l, f, err);
    f->periodic = f->leading = true;
    f->periods = f->periods > l.periods ? f->periods : l.periods;
    f->period = period;
    period_map_free(map);
    leading_done(&l);
    return rc;
}

/* The multipliers over PERIOD on fixed axes, from the exponents on axes turning at SPEED. */
static enum modal_status turning(const struct statespace *ss, double speed, double period,
                                 struct floquet *f, struct modal_error *err)
{
    /* (-1)^m of the opening */
    double side = fmod(round(speed * period / M_PI), 2) == 0 ? 1 : -1, largest = 1;
    enum modal_status rc = constant(ss, period, f, err);

    for (int i = 0; rc == MODAL_OK && i < f->count; i++) {
        f->multiplier[i] *= side;  /* R(W T) = +-I */
        largest = fmax(largest, cabs(f->multiplier[i]));
    }
    if (rc == MODAL_OK && !isfinite(largest))
        return modal_fail(err, MODAL_OVERFLOW,
                          "the growth over one period of %g s leaves the range of doubles", period);
    for (int i = 0; rc == MODAL_OK && i < f->count; i++) {
        double size = cabs(f->multiplier[i]);

        f->bar[i] = size * (f->bar[i] * period + DBL_EPSILON);
        f->resolved[i] = size > DBL_EPSILON * largest;  /* beside the largest it is nothing */
        f->exponent[i] = f->resolved[i] ? CMPLX(creal(f->exponent[i]),
                                                cimag(exponent_of(f->multiplier[i], period)))
                                        : 0;
    }
    f->periodic = true;
    return rc;
}

/* What value I is ordered by: |rho| (periodic) or Re lambda, on the boundary of stability where
 * its bar holds that. */
static double size_of(const struct floquet *f, int i)
{
    double x = f->periodic ? cabs(f->multiplier[i]) : creal(f->exponent[i]),
           boundary = f->periodic ? 1 : 0;

    return fabs(x - boundary) <= f->bar[i] ? boundary : x;
}

/* Descending in size, then ascending in |Im|, pairs together, the one with positive imaginary
 * part first. */
static bool comes_before(const struct floquet *f, int a, int b)
{
    double x = size_of(f, a), y = size_of(f, b);
    double complex u = f->periodic ? f->multiplier[a] : f->exponent[a],
                   v = f->periodic ? f->multiplier[b] : f->exponent[b];

    if (x != y)
        return x > y;
    if (fabs(cimag(u)) != fabs(cimag(v)))
        return fabs(cimag(u)) < fabs(cimag(v));
    return creal(u) != creal(v) ? creal(u) > creal(v) : cimag(u) > cimag(v);
}

/* All four arrays move together. */
static void swap(struct floquet *f, int a, int b)
{
    double complex m = f->multiplier[a], l = f->exponent[a];
    double bar = f->bar[a];
    bool resolved = f->resolved[a];

    f->multiplier[a] = f->multiplier[b], f->multiplier[b] = m;
    f->exponent[a] = f->exponent[b], f->exponent[b] = l;
    f->bar[a] = f->bar[b], f->bar[b] = bar;
    f->resolved[a] = f->resolved[b], f->resolved[b] = resolved;
}

/* Descending: multipliers by magnitude, exponents by real part. */
static void sort(struct floquet *f)
{
    for (int i = 1; i < f->count; i++)
        /* by insertion: nearly sorted, and pairs stay together */
        for (int j = i; j > 0 && comes_before(f, j, j - 1); j--)
            swap(f, j, j - 1);
}

/* The verdict: undecided where the largest is within its bar of the boundary. */
static void judge(struct floquet *f)
{
    bool unstable = f->growing > 0, stable = !f->unsettled;       /* a larger one may be missed */

    f->margin = HUGE_VAL;
    for (int i = 0; i < f->count; i++) {
        double over = f->periodic ? cabs(f->multiplier[i]) - 1 : creal(f->exponent[i]);
        unstable = unstable || over > f->bar[i];  /* one beyond its bar is enough */
        stable = stable && over < -f->bar[i];  /* all must lie within theirs */
        if (f->resolved[i])
            f->margin = fmin(f->margin, -creal(f->exponent[i]));
        if (f->period > 0)
            f->max_multiplier = fmax(f->max_multiplier, cabs(f->multiplier[i]));
    }
    f->stable = unstable ? FLOQUET_UNSTABLE : stable ? FLOQUET_STABLE : FLOQUET_UNDECIDED;
}

/* How many multipliers of P are asked for alone; 0: its whole spectrum. */
static int leading_of(const struct program *p, double period, const struct floquet_options *opt)
{
    int wanted = opt != NULL ? opt->multipliers : 0;

    if (p->harmonics == 0 || !period_map_serves(p))
        return 0;
    if (wanted == 0 && (2 * p->n > FLOQUET_STATES_DENSE || map_work(p, period) > WORK_WHOLE))
        wanted = FLOQUET_LEADING;
    return wanted < 2 * p->n ? wanted : 0;
}

/* Are all multipliers of P asked for, and its map dear? */
static bool is_dear(const struct program *p, double period, const struct floquet_options *opt)
{
    return p->harmonics > 0 && !p->seen_fixed && (opt == NULL || opt->multipliers == 0)
           && 2 * p->n <= FLOQUET_STATES_DENSE && period_map_serves(p)
           && map_work(p, period) > WORK_MAP;
}

/* All multipliers of P by windows; F has none where some are not found. */
static enum modal_status all_by_windows(const struct program *p, double period, struct floquet *f,
                                        struct modal_error *err)
{
    struct statespace *ss = NULL;
    struct leading none = { 0 };
    double balance = 0, bar = 0;
    bool known = true;
    enum modal_status rc = statespace_new(p, &ss, err);

    if (rc != MODAL_OK || rigid_rounding(ss) > 0) {
        statespace_free(ss);
        return rc;
    }
    rc = windows(p, period, ss->N, NULL, &none, f, err);
    for (int i = 0; i < ss->N; i++)
        balance -= period * ss->A[(size_t)i * ((size_t)ss->N + 1)];
    for (int i = 0; i < f->count; i++) {
        balance += log(cabs(f->multiplier[i]));
        bar += f->bar[i] / cabs(f->multiplier[i]);
        known = known && f->resolved[i];         /* else its logarithm says nothing */
    }
    if (rc != MODAL_OK || f->unsettled || f->count != ss->N || !known || !(fabs(balance) <= bar))
        floquet_done(f);
    statespace_free(ss);
    f->alike = false;                            /* no other is left */
    f->periodic = true;
    f->period = period;
    return rc == MODAL_TOO_LARGE || rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}

/* All exponents of P, by those of TURNED where that is not NULL. */
static enum modal_status whole(const struct program *p, const struct program *turned, double period,
                               const struct floquet_options *opt, struct floquet *f,
                               struct modal_error *err)
{
    struct statespace *ss = NULL;
    enum modal_status rc = statespace_new(turned != NULL ? turned : p, &ss, err);

    if (rc == MODAL_OK)
        rc = make(ss->N, f, err);
    if (rc == MODAL_OK)
        rc = turned != NULL || p->seen_fixed ? turning(ss, p->turn_speed, period, f, err)
             : ss->harmonics > 0             ? periodic(ss, period, opt, f, err)
                                             : constant(ss, p->period, f, err);
    statespace_free(ss);
    return rc;
}

enum modal_status floquet(const struct program *p, const struct floquet_options *opt,
                          struct floquet *out, struct modal_error *err)
{
    struct floquet f = { 0 };
    struct program *turned = NULL;
    int wanted;
    double period = p->period > 0 ? p->period : p->omega > 0 ? 2 * M_PI / p->omega : 0;
    enum modal_status rc;

    if (p->laws > 0) {
        char path[32];
        snprintf(path, sizeof path, "effects[%d]", p->law[0].effect);
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "floquet is of linear scenes; the %s is not linear (steady gives "
                                "the stability of its orbits)",
                                p->effect[p->law[0].effect].type);
    }
    /* constant on turning axes: then exactly */
    rc = p->harmonics > 0 ? program_turned(p, &turned, err) : MODAL_OK;
    wanted = turned == NULL ? leading_of(p, period, opt) : 0;
    if (rc == MODAL_OK && turned == NULL && is_dear(p, period, opt))
        rc = all_by_windows(p, period, &f, err);
    if (rc == MODAL_OK && f.count == 0)
        rc = wanted > 0 ? leading(p, period, wanted, &f, err)
                        : whole(p, turned, period, opt, &f, err);
    program_turned_free(turned);
    if (rc != MODAL_OK) {
        floquet_done(&f);
        return rc;
    }
    sort(&f);
    judge(&f);
    *out = f;
    return MODAL_OK;
}
