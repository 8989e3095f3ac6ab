/*
 * solutions.c - see solutions.h
 *
 * Three ways, none of which promises all.  The branch over the level of the loads, from one near 0,
 * passes 1 at every solution that is connected to rest.  Random starts,
 *
 *     X_k = size e^{i 2 pi u},   size = scale 10^s, s from -2 to 1.2 in equal steps,            (1)
 *
 * at one harmonic of those excited, a tenth of it at the others, find isolated ones.  Of each
 * found, those beside it along the direction v that its derivative J holds least (J^-1 repeated),
 * at distances 10^-4 .. 10^-0.5 of it; and its images
 *
 *     +-X_k e^{i k pi j / m},   j = 0 .. 2 m - 1,                                               (2)
 *
 * m what divides the harmonic of every load: a shift by 2 pi / m maps solutions on solutions, and
 * half of one with the sign turned does where laws and loads are odd.
 */
#include "modal/steady/solutions.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"
#include "modal/scene/program.h"
#include "modal/steady/balance.h"
#include "modal/steady/iterate.h"
#include "modal/steady/path.h"

/* Two motions nearer than this, relative, are one: Newton's method leaves 1e-9 (iterate.c). */
static const double SAME = 1e-6;
/* Motions smaller than this are 0: their squares are near the least of doubles. */
static const double NOTHING = 1e-150;
/* Levels of the loads: where the branch sets out, its laws still linear; in place of 0, which has
 * no loads to be relative to; and the range in which the branch is followed, past the folds that a
 * level of 1 has near it. */
static const double LEVEL_START = 1e-3;
static const double LEVEL_ZERO = 1e-12;
static const double LEVEL_LOW = -0.5;
static const double LEVEL_HIGH = 4;
/* As much of dampers as a dof's own stiffness: a branch that comes back to it leads nowhere. */
static const double DAMPING_HIGH = 1;
/* Of arc length, where path.h has a fiftieth and a tenth: the range is four times its span. */
static const double STEP_FIRST = 0.01;
static const double STEP_MOST = 0.15;
/* (1): the exponent of the smallest start and the range of it; and the share of the others. */
static const double SIZE_LEAST = -2;
static const double SIZE_RANGE = 3.2;
static const double OTHERS = 0.1;
/* Distances beside a solution: the exponent of the least and the range. */
static const double BESIDE_LEAST = -4;
static const double BESIDE_RANGE = 3.5;
/* Entries of the vector that inverse iteration begins with differ by this, so that no symmetry of
 * the balance makes it orthogonal to the answer. */
static const double UNEVEN = 0.37;
enum {
    STARTS = 240,   /* at STEPS each; a motion of one start in fifty is missed once in a hundred */
    STEPS = 30,          /* of Newton's method from one: what takes more is chance */
    LEVEL_POINTS = 600,   /* of STEP_MOST: twenty times the range */
    DISTANCES = 15,   /* four in each decade of BESIDE_RANGE, both ways */
    SHIFTS = 6,   /* of each sign */
    INVERSES = 3,        /* each gains the ratio of the two least singular values */
    SEED = 20240611      /* the same starts in every run */
};

/* Harmonics of a motion. */
static size_t size_of(const struct balance *b) { return (size_t)b->q * ((size_t)b->H + 1); }

bool solutions_add(struct solutions *s, const struct balance *b, const double complex *X)
{
    size_t n = size_of(b);
    double size = numbers_modulus(X, n) > NOTHING ? numbers_modulus(X, n)
        : 0;       /* Newton's method shrinks what is 0 until it underflows */
    double complex *copy;

    for (int i = 0; i < s->count; i++) {
        double far = 0;

        for (size_t e = 0; e < n; e++)
            far = fmax(far, cabs(X[e] - s->X[i][e]));
        if (far <= fmax(NOTHING, SAME * fmax(size, numbers_modulus(s->X[i], n))))
            return false;                               /* known already */
    }
    if (s->count == SOLUTIONS_MOST || (copy = malloc((n + 1) * sizeof *copy)) == NULL)
        return false;
    for (size_t e = 0; e < n; e++)
        copy[e] = size > 0 ? X[e] : 0;
    s->X[s->count++] = copy;
    return true;
}

void solutions_done(struct solutions *s)
{
    for (int i = 0; i < s->count; i++)
        free(s->X[i]);
    s->count = 0;
}

/* What the walk over levels, or over dampers, carries. */
struct climb {
    struct balance *b;
    const struct solutions_options *opt;
    struct solutions *out;            /* crossings of `to` */
    double to;                        /* level 1, no dampers */
};

/* path.h: the balance at a level. */
static enum modal_status at_level(void *context, double level, struct balance **b,
                                  struct modal_error *err)
{
    struct climb *c = context;

    (void)err;
    if (level == 0)
        level = LEVEL_ZERO;
    balance_set_level(c->b, level);
    *b = c->b;
    return MODAL_OK;
}

/* path.h: the balance with so much of the dampers. */
static enum modal_status at_damping(void *context, double share, struct balance **b,
                                    struct modal_error *err)
{
    struct climb *c = context;

    (void)err;
    balance_set_damping(c->b, share);
    *b = c->b;
    return MODAL_OK;
}

/* path.h: a crossing of `to` is a solution. */
static enum modal_status point_on_path(void *context, const struct path_point *p,
                                        struct balance *b, bool *stop, struct modal_error *err)
{
    struct climb *c = context;

    (void)err;
    if (p->lambda != c->to)
        return MODAL_OK;
    solutions_add(c->out, b, p->X);
    *stop = c->out->count >= (c->opt->most > 0 ? c->opt->most : SOLUTIONS_MOST);
    return MODAL_OK;
}

/* path.h: the caller's. */
static bool climb_cancelled(void *context)
{
    const struct climb *c = context;

    return c->opt->cancelled != NULL && c->opt->cancelled(c->opt->context);
}

enum modal_status solutions_along_levels(struct balance *b, const struct solutions_options *opt,
                                         struct solutions *out, struct modal_error *err)
{
    struct climb climb = { b, opt, out, 1 };
    struct path_problem problem = { .at = at_level,
                                    .point = point_on_path,
                                    .cancelled = climb_cancelled,
                                    .context = &climb,
                                    .from = LEVEL_START,
                                    .to = 1,
                                    .span = 1,
                                    .past = true,
                                    .points_most = LEVEL_POINTS,
                                    .low = LEVEL_LOW,
                                    .high = LEVEL_HIGH,
                                    .step_first = STEP_FIRST,
                                    .step_most = STEP_MOST,
                                    .budget = b->budget };
    struct iterate_options newton = { .cancelled = opt->cancelled, .context = opt->context };
    struct iterate_report r;
    struct path_report report;
    double complex *X = calloc(size_of(b) + 1, sizeof *X);
    enum modal_status rc = MODAL_OK;

    if (X == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "solutions: no memory");
    /* Without loads there is no branch over their level. */
    if (numbers_modulus(b->load, size_of(b)) > 0) {
        balance_set_level(b, LEVEL_START);
        rc = iterate_newton(b, &newton, X, &r, err);
        if (rc == MODAL_OK && r.converged)
            rc = path_follow(&problem, X, &report, err);
        balance_set_level(b, 1);
    }
    free(X);
    return rc;
}

enum modal_status solutions_along_damping(struct balance *b, double share, const double complex *X,
                                          const struct solutions_options *opt,
                                          struct solutions *out, struct modal_error *err)
{
    struct climb climb = { b, opt, out, 0 };
    struct path_problem problem = { .at = at_damping,
                                    .point = point_on_path,
                                    .cancelled = climb_cancelled,
                                    .context = &climb,
                                    .from = share,
                                    .to = 0,
                                    .past = true,
                                    .points_most = LEVEL_POINTS,
                                    .low = -share,
                                    .high = DAMPING_HIGH,
                                    .rough = true,
                                    .budget = b->budget };
    struct path_report report;

    return path_follow(&problem, X, &report, err);
}

/* In [0, 1): 53 bits of a linear congruence, the same on every machine. */
static double uniform(uint64_t *seed)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(*seed >> 11) / 9007199254740992.0;
}

/* Newton's method from X, which becomes its end; what converged is added. */
static enum modal_status try(struct balance *b, const struct solutions_options *opt,
                             double complex *X, struct solutions *out, struct modal_error *err)
{
    struct iterate_options newton = { .most = STEPS,
                                      .cancelled = opt->cancelled,
                                      .context = opt->context };
    struct iterate_report r;
    enum modal_status rc = iterate_newton(b, &newton, X, &r, err);

    if (rc == MODAL_OK && r.converged)
        solutions_add(out, b, X);
    return rc;
}

/* The greatest common divisor. */
static int divisor(int a, int b) { return b == 0 ? a : divisor(b, a % b); }

/* What divides the harmonic of every load: a shift by the period over it maps solutions on
 * solutions. */
static int symmetry(const struct balance *b)
{
    int m = 0;

    for (int k = 1; k <= b->H; k++)
        for (int i = 0; i < b->q; i++)
            if (cabs(b->load[k * b->q + i]) > 0)
                m = divisor(m, k);
    for (int h = 0; h < b->p->harmonics; h++)
        m = divisor(m, b->p->harmonic[h].k);
    return m > 0 ? m : 1;
}

/* From every image of every solution; out->count grows on the way. */
static enum modal_status images(struct balance *b, const struct solutions_options *opt,
                                struct solutions *out, double complex *X, struct modal_error *err)
{
    int m = symmetry(b), K = b->H + 1;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < out->count; i++)
        for (int j = 0; rc == MODAL_OK && j < 4 * m + 2 * SHIFTS; j++) {
            /* near a fold the other differs in phase */
            static const double small[SHIFTS] = { 0.01, 0.03, 0.06, 0.12, 0.25, 0.5 };
            int n = j - 4 * m;
            double shift = n < 0 ? 2 * M_PI * (j / 2) / (2 * m) : (n % 2 ? -1 : 1) * small[n / 2],
                   sign = n < 0 && j % 2 ? -1 : 1;

            for (int d = 0; d < b->q; d++)
                for (int k = 0; k < K; k++)
                    X[d * K + k] = sign * out->X[i][d * K + k] * cexp(I * k * shift);
            rc = try(b, opt, X, out, err);
        }
    return rc;
}

/* Beside every solution, along the direction in which its derivative is weakest: near a fold the
 * other one lies there. */
static enum modal_status beside(struct balance *b, const struct solutions_options *opt,
                                struct solutions *out, double complex *X, struct modal_error *err)
{
    double *v = malloc(((size_t)b->order + 1) * sizeof *v),
           *u = malloc(((size_t)b->order + 1) * sizeof *u);
    enum modal_status rc = v == NULL || u == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "solutions: no memory")
                               : MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < out->count; i++) {
        double size = numbers_modulus(out->X[i], size_of(b));

        /* Its derivative, for J^-1; one that is singular has no least direction to give. */
        rc = balance_residual(b, out->X[i], true, err);
        if (rc != MODAL_OK || !balance_factor(b, NULL))
            continue;
        for (int e = 0; e < b->order; e++)
            v[e] = 1 + UNEVEN * (e % 3);
        for (int round = 0; round < INVERSES; round++) {               /* inverse iteration */
            double most;

            balance_solve(b, v);                        /* J^-1 v, to size 1 below */
            most = numbers_largest(v, (size_t)b->order);
            for (int e = 0; e < b->order; e++)
                v[e] = most > 0 && isfinite(most) ? v[e] / most : 0;
        }
        for (int n = 0; rc == MODAL_OK && n < 2 * DISTANCES; n++) {
            double far = (n % 2 ? -1 : 1) * size
                         * pow(10, BESIDE_LEAST + BESIDE_RANGE * (n / 2) / (DISTANCES - 1));

            balance_pack(b, out->X[i], u);
            for (int e = 0; e < b->order; e++)
                u[e] += far * v[e];                     /* to either side */
            balance_unpack(b, u, X);
            rc = try(b, opt, X, out, err);
        }
    }
    free(v);
    free(u);
    return rc;
}

enum modal_status solutions_from_starts(struct balance *b, const struct solutions_options *opt,
                                        struct solutions *out, struct modal_error *err)
{
    int starts = opt->starts > 0 ? opt->starts : STARTS, K = b->H + 1, low = 1;
    double complex *X = calloc(size_of(b) + 1, sizeof *X);
    double scale = 0;
    uint64_t seed = SEED;
    enum modal_status rc =
        X == NULL ? modal_fail(err, MODAL_NO_MEMORY, "solutions: no memory") : MODAL_OK;

    for (int k = 1; k < K; k++)
        for (int i = 0; i < b->q; i++)
            low = cabs(b->load[k * b->q + i]) > 0 && k > low ? k : low;
    for (int i = 0; i < out->count; i++)
        scale = fmax(scale, numbers_modulus(out->X[i], size_of(b)));
    scale = scale > 0 ? scale : 1;
    for (int n = 0; rc == MODAL_OK && n < starts; n++) {
        double size = scale * pow(10, SIZE_LEAST + SIZE_RANGE * ((n + 0.5) / starts));
        int only = 1 + (int)(uniform(&seed) * low) % low;

        if (opt->cancelled != NULL && opt->cancelled(opt->context)) {
            rc = modal_fail(err, MODAL_CANCELLED, "cancelled");
            break;
        }
        memset(X, 0, size_of(b) * sizeof *X);
        for (int i = 0; i < b->q; i++) {
            for (int k = 1; k <= low; k++)
                /* others beside the one of (1) */
                X[i * K + k] = OTHERS * size * uniform(&seed) * cexp(2 * M_PI * I * uniform(&seed));
            X[i * K + only] = size * cexp(2 * M_PI * I * uniform(&seed));  /* (1) */
            /* every third with a mean */
            X[i * K] = n % 3 == 0 ? size * (uniform(&seed) - 0.5) : 0;
        }
        rc = try(b, opt, X, out, err);
    }
    if (rc == MODAL_OK)
        rc = beside(b, opt, out, X, err);
    if (rc == MODAL_OK)
        rc = images(b, opt, out, X, err);
    free(X);
    return rc;
}
