/*
 * hill_found.c - see hill_found.h
 *
 * One motion is found by several windows: it is the same where multipliers agree within their bars
 * and motions at t = 0 have one direction, or, where a multiplier is double, lie in one plane.
 *
 * What the matrices' entries are rounded by moves a multiplier that is real, as of a rigid motion,
 * along the axis.  A pair of symmetric matrices, with or without what turns motions, moves along
 * the circle instead and leaves that only where two meet, Krein's theorem: what damps such a pair
 * it changes by a share alone.  Of pairs by matrices that circulate it is left out.
 */
#include "modal/scene/hill_found.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/hill_window.h"

static const double KNOWN = 1e-9;        /* multipliers of two searches that are one agree to it */
static const double ROUNDING = 8 * DBL_EPSILON;  /* of lambda T and its exponential, a few times */
static const double SAME = 1e-6;         /* squared sine: so do their vectors, to 1e-3 */

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "multipliers: out of memory");
}

double hill_motion_bar(double residual, double condition)
{
    double least = fmax(residual, DBL_EPSILON);

    return fmin(condition * least, fmax(sqrt(least), least));
}

bool hill_motion_real(const struct hill_motion *f)
{
    return f->turn * cabs(f->multiplier) <= f->bar;
}

/* Of the ROUNDING that F's multiplier may move by what its modulus may: all where that reaches the
 * real axis, none where F stays one of a pair. */
static double rounding_of(const struct hill_motion *f, double rounding)
{
    double bar = hill_motion_bar(f->residual + rounding, f->condition);

    return f->turn * cabs(f->multiplier) <= bar ? rounding : 0;
}

/* Is I of H, the motion F, a copy of an earlier one, or the lower one of a pair both of which are
 * there?  Two that rounding parts from the real axis, as of a double one, are no pair. */
static bool repeated(const struct hill_found *s, const struct hill_window *h, int i,
                     const struct hill_motion *f)
{
    double complex here = h->exponent[i];
    double near = KNOWN * s->W;

    for (int j = 0; j < h->count; j++) {
        if (j < i && h->middle[j] != h->middle[i] && cabs(h->exponent[j] - here) <= near)
            return true;
        if (j != i && cimag(here) < -near && !hill_motion_real(f)
            && cabs(conj(h->exponent[j]) - here) <= near)
            return true;
    }
    return false;
}

/* Are both of one direction? */
static bool aligned(const struct hill_found *s, const double complex *a, const double complex *b)
{
    double complex dot;

    cblas_zdotc_sub(2 * s->n, a, 1, b, 1, &dot);
    return 1 - creal(dot) * creal(dot) - cimag(dot) * cimag(dot) <= SAME;
}

/* Are both one multiplier, as far as is known? */
static bool agree(const struct hill_motion *a, const struct hill_motion *b)
{
    return cabs(a->multiplier - b->multiplier) <= a->bar + b->bar + KNOWN;
}

/* X of length N less its parts along COUNT orthonormal columns of V; the square of its norm. */
static double leave(const double complex *V, int n, int count, double complex *x)
{
    double complex dot;
    double left;

    for (int i = 0; i < count; i++) {
        cblas_zdotc_sub(n, V + (size_t)i * (size_t)n, 1, x, 1, &dot);
        dot = -dot;
        cblas_zaxpy(n, &dot, V + (size_t)i * (size_t)n, 1, x, 1);
    }
    left = cblas_dznrm2(n, x, 1);
    return left * left;
}

/* One of those found that F's search has not seen, where F's start lies among the starts of its
 * multiplier: every search has other vectors of a multiplier that is double.  NULL: there is none,
 * or no memory. */
static struct hill_motion *spanned(struct hill_found *s, const struct hill_motion *f)
{
    struct hill_motion *unseen = NULL;
    struct workspace scratch = { 0 };
    int n = 2 * s->n, same = 0, count = 0;
    double complex *V;

    for (int i = 0; i < s->count; i++)
        same += agree(&s->motion[i], f);
    V = same > 1 ? workspace_zeros(&scratch, ((size_t)same + 1) * (size_t)n, sizeof *V) : NULL;
    for (int i = 0; V != NULL && i < s->count; i++) {
        struct hill_motion *g = &s->motion[i];
        double complex *here = V + (size_t)count * (size_t)n;
        double left;
        if (!agree(g, f))
            continue;
        unseen = g->run != f->run ? g : unseen;
        memcpy(here, g->start, (size_t)n * sizeof *here);
        left = leave(V, n, count, here);
        if (left > SAME) {
            cblas_zdscal(n, 1 / sqrt(left), here, 1);
            count++;
        }
    }
    if (unseen != NULL) {
        memcpy(V + (size_t)count * (size_t)n, f->start, (size_t)n * sizeof *V);
        unseen = leave(V, n, count, V + (size_t)count * (size_t)n) <= SAME ? unseen : NULL;
    }
    workspace_free(&scratch);
    return unseen;
}

/* F, whose start lies elsewhere, among those found, or in place of the same one less exact. */
static enum modal_status add(struct hill_found *s, struct hill_motion *f, struct modal_error *err)
{
    size_t bytes = 2 * (size_t)s->n * sizeof *f->start;
    struct hill_motion *at = NULL, *more;
    double complex *start;

    for (int i = 0; i < s->count && at == NULL; i++) {
        struct hill_motion *g = &s->motion[i];
        if (g->run != f->run && agree(g, f) && aligned(s, g->start, f->start))
            at = g;
    }
    more = at != NULL && at->residual <= f->residual ? at : at == NULL ? spanned(s, f) : NULL;
    if (more != NULL) {
        more->run = f->run;              /* it is seen once a search */
        return MODAL_OK;
    }
    if (at == NULL && s->count == s->room) {
        more = realloc(s->motion, (2 * (size_t)s->room + 16) * sizeof *more);
        if (more == NULL)
            return no_memory(err);
        s->motion = more;
        s->room = 2 * s->room + 16;
    }
    start = at != NULL ? at->start : malloc(bytes + 1);
    if (start == NULL)
        return no_memory(err);
    memcpy(start, f->start, bytes);
    at = at != NULL ? at : &s->motion[s->count++];
    *at = *f;
    at->start = start;
    return MODAL_OK;
}

enum modal_status hill_found_add(struct hill_found *s, const struct hill_window *h,
                                    struct modal_error *err)
{
    size_t states = 2 * (size_t)s->n;
    enum modal_status rc = MODAL_OK;

    s->runs++;
    for (int i = 0; rc == MODAL_OK && i < h->count; i++) {
        struct hill_motion f = { .exponent = h->exponent[i],
                                 .multiplier = cexp(h->exponent[i] * s->period),
                                 .condition = h->condition[i],
                                 .turn = sin(2 * M_PI
                                             * remainder(cimag(h->exponent[i]) / s->W, 1)),
                                 .start = h->start + (size_t)i * states, .run = s->runs };
        double size = cabs(f.multiplier);
        bool lower = f.turn < 0;

        if (abs(h->middle[i]) > 2 * s->reach || !isfinite(size))
            continue;
        /* what lambda T is rounded by turns the multiplier */
        f.residual = (h->residual[i] + ROUNDING * cabs(h->exponent[i]) * s->period) * size;
        f.bar = hill_motion_bar(f.residual, f.condition);
        f.turn = fabs(f.turn);
        f.rounding = rounding_of(&f, h->rounding[i] * size);
        if (repeated(s, h, i, &f))
            continue;
        if (lower && !hill_motion_real(&f)) {
            f.multiplier = conj(f.multiplier);
            f.exponent = conj(f.exponent);
            for (size_t k = 0; k < states; k++)
                f.start[k] = conj(f.start[k]);
        }
        rc = add(s, &f, err);
    }
    return rc;
}

/* Descending in modulus. */
static int compare(const void *a, const void *b)
{
    double x = cabs(((const struct hill_motion *)a)->multiplier),
           y = cabs(((const struct hill_motion *)b)->multiplier);

    return (x < y) - (x > y);
}

int hill_found_last(struct hill_found *s)
{
    int values = 0, i = 0;

    qsort(s->motion, (size_t)s->count, sizeof *s->motion, compare);
    for (; i < s->count && values < s->wanted; i++)
        values += hill_motion_real(&s->motion[i]) ? 1 : 2;
    return values < s->wanted ? s->count + 1 : i;
}

bool hill_found_alike(const struct hill_found *s, int last)
{
    const struct hill_motion *f = s->motion;

    return last < s->count && last > 0
           && cabs(f[last - 1].multiplier) - cabs(f[last].multiplier)
                  <= f[last - 1].bar + f[last].bar;
}

double hill_found_least(struct hill_found *s)
{
    int last = hill_found_last(s);

    return last <= s->count ? cabs(s->motion[last - 1].multiplier) : 0;
}

double hill_found_largest(const struct hill_found *s)
{
    double largest = s->count > 0 ? 0 : 1;

    for (int i = 0; i < s->count; i++)
        largest = fmax(largest, cabs(s->motion[i].multiplier));
    return largest;
}

struct hill_motion *hill_found_own(struct hill_found *s, const struct hill_hint *h)
{
    struct hill_motion *nearest = NULL;
    double least = HUGE_VAL;

    for (int i = 0; i < s->count; i++) {
        struct hill_motion *f = &s->motion[i];
        double off = fmin(cabs(h->multiplier - f->multiplier),
                          cabs(conj(h->multiplier) - f->multiplier));
        if (!f->taken && off < least && off <= f->bar + h->residual + KNOWN) {
            nearest = f;
            least = off;
        }
    }
    return nearest;
}

int hill_found_growing(const struct hill_found *s, double rate)
{
    int count = 0;

    for (int i = 0; i < s->count; i++)
        if (creal(s->motion[i].exponent) > rate)
            count += hill_motion_real(&s->motion[i]) ? 1 : 2;
    return count;
}

void hill_found_done(struct hill_found *s)
{
    for (int i = 0; i < s->count; i++)
        free(s->motion[i].start);
    free(s->motion);
    *s = (struct hill_found){ 0 };
}
