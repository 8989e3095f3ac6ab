/*
 * verdict.c - what the multipliers say, with their errors
 *
 * Half width.  A mode's Re lambda is known to b = VERDICT_CLEAR std where the Jacobian gave it;
 * else to bar / (|rho| span), the bar being the largest of jackknife and backward estimate
 * (projection.c).  With hardly more equations than unknowns the Jacobian's residual is no measure
 * of the noise, and both are added.  b is never below rounding, REFINE_EXACT / span, nor, in a
 * near-defective cluster that is not resolved, below twice its radius.  Resolved: no two members
 * are nearer than REFINE_CLEAR of their errors together; what the errors say of them then holds,
 * however close they are.
 *
 * Near-defective.  Two exponents that meet form a Jordan block, and their coefficients grow like
 * 1/distance with opposite signs while the sum of the two parts stays finite:
 *
 *     cancellation = (|part_1|^2 + |part_2|^2) / |part_1 + part_2|^2 >> 1.                      (1)
 *
 * A perturbation e of the data moves each by sqrt(e), their mean by e: so what is reported is the
 * centroid and the radius, at least the members' own bars, and each member's bar is at least the
 * radius.  (1) is judged by the energies of the modes against that of the signals, which is 1 by
 * scaling.
 */
#include "modal/identify/ask/verdict.h"
#include "modal/identify/ask/diagnose.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/fit/refine.h"
#include "modal/identify/linear/exponents.h"

static const double
    CANCELLATION = 4;               /* of (1), where both parts are twice what they make */
/* rad over the record: rounding e of the data splits a Jordan block by sqrt(e), 1e-8, times some
 * hundreds for the record's sensitivity, whatever the fit is to. */
static const double SPLIT = 1e-4;

static double span_of(const struct identify_result *r)
{
    return r->period > 0 ? r->period : r->dt / (r->decimation > 0 ? r->decimation : 1);
}

static const double
    FAR_STRONGER = 30,              /* energy over energy */
    SLOW = 3 * M_PI,                /* rad over the record: one and a half turns */
    RISE = 3,                       /* growth over the record, e^3 = 20 */
    PERSISTENT = 0.5;               /* share of the orders */

static double cluster_radius(const struct identify_result *r, int mode)
{
    for (int i = 0; i < r->cluster_count; i++)
        for (int k = 0; k < r->clusters[i].member_count && r->clusters[i].near_defective
             && !r->clusters[i].resolved;
             k++)
            if (r->clusters[i].members[k] == mode)
                return r->clusters[i].radius;
    return 0;
}

static double half_width(const struct identify_result *r, int i)
{
    const struct identify_mode *m = &r->modes[i];
    double span = span_of(r), b = VERDICT_CLEAR * m->std_re, size = cabs(m->multiplier) * span,
           bar = size > 0 && isfinite(m->bar) ? m->bar / size : HUGE_VAL;

    if (!(b > 0) || !isfinite(b))
        b = bar;
    else if (r->freedom < REFINE_SPARE_LEAST)
        b += bar;                   /* so few residuals tell their own variance badly */
    if (size > 0)
        b = fmax(b, 2 * cluster_radius(r, i) / size);
    /* of a multiplier, as above */
    return fmax(b, REFINE_EXACT / span);
}

/*
 * The upper end of the growth.  What is known to b near Re lambda is |rho| to |rho| span b: of a
 * motion gone within a period the multiplier is known to be nearly 0 where its logarithm is not
 * known at all, and |rho| (1 + span b) < 1 decays.  Where |rho| is below the least number, |rho| +
 * bar is the bar.
 */
static double most_growth(const struct identify_result *r, int i)
{
    const struct identify_mode *m = &r->modes[i];
    double span = span_of(r);

    if (cabs(m->multiplier) == 0 && m->bar >= 0)
        return log(m->bar) / span;  /* rho = 0: all that is known is |rho| <= bar */
    /* ln(|rho| (1 + span b)) / span */
    return creal(m->exponent) + log1p(span * half_width(r, i)) / span;
}

/* A far stronger mode within one beat over the record: what is weak beside it may be the shape of
 * its decay. */
static bool overshadowed(const struct identify_result *r, int i, double duration)
{
    for (int j = 0; j < r->mode_count; j++)
        if (r->modes[j].energy > FAR_STRONGER * r->modes[i].energy
            && fabs(cimag(r->modes[j].resolved) - cimag(r->modes[i].resolved)) * duration
                < 2 * M_PI)
            return true;
    return false;
}

/* Does growth known to B for sure rise by less than drift may, over so many seconds? */
static bool rises_little(double growth, double b, double seconds)
{
    return (growth - b) * seconds < RISE;
}

bool verdict_slow(double complex lambda, double std_re, double seconds)
{
    return cabs(lambda) * seconds < SLOW
        && rises_little(creal(lambda), VERDICT_CLEAR * std_re, seconds);
}

/* Is growth beyond its error believed?  What makes up for something that the model lacks has little
 * energy, or is slower than the record. */
static bool believed(const struct identify_result *r, int i, double duration)
{
    const struct identify_mode *m = &r->modes[i];
    bool shadow = overshadowed(r, i, duration), weak = m->energy < VERDICT_WEAK,
         slow = cabs(m->resolved) * duration < SLOW;

    if (m->growth == GROWTH_BELOW_GRID || m->growth == GROWTH_IN_CROWD)
        return false;
    if (m->growth == GROWTH_EXACT || !(weak || slow || shadow))
        return true;
    if (m->growth == GROWTH_UNASKED)
        return !weak;
    if (slow && (weak || (rises_little(creal(m->exponent), half_width(r, i), duration)
                          && m->growth != GROWTH_IN_HALVES)))
        return false;
    return (m->growth == GROWTH_IN_HALF || m->growth == GROWTH_IN_HALVES) && !shadow;
}

static bool spurious(const struct identify_mode *m)
{
    /* NAN is not less */
    return m->harmonic || (m->energy < VERDICT_WEAK && m->persistence < PERSISTENT);
}

/* The mode's own say; unknown persistence (NAN) counts as full. */
static int verdict_of(struct identify_result *r, int i, double duration)
{
    const struct identify_mode *m = &r->modes[i];
    double g = creal(m->exponent), b = half_width(r, i);

    if (most_growth(r, i) < 0 || (g < 0 && m->growth == GROWTH_NEVER))
        return VERDICT_STABLE;
    if (!(g - b > 0))
        return VERDICT_UNDECIDED;
    if (believed(r, i, duration))
        return VERDICT_UNSTABLE;
    identify_diagnose(r, "growth_unconfirmed", -1, "mode %d (%.5g Hz) grows in the fit to the "
                      "whole record, but %s; record longer", i, cabs(m->exponent) / (2 * M_PI),
                      m->growth == GROWTH_IN_CROWD
                          ? "has a neighbour within a beat over it, and with one mode more there, "
                            "of which none grows, it is explained as well"
                          : "has little energy or is slower than the record, and is not clearly "
                            "seen to grow in either half: it may make up for drift or "
                            "nonlinearity, and is not taken for an instability");
    return VERDICT_UNDECIDED;
}

static void report_largest(struct identify_result *r)
{
    r->max_multiplier = r->margin = r->margin_std = NAN;
    for (int i = 0; i < r->mode_count; i++) {
        const struct identify_mode *m = &r->modes[i];
        double g = creal(m->exponent), b = half_width(r, i);
        if (!(cabs(m->multiplier) <= r->max_multiplier))
            r->max_multiplier = cabs(m->multiplier);
        if (!(-g >= r->margin)) {
            r->margin = 0 - g;
            r->margin_std = isfinite(b) ? b / VERDICT_CLEAR : NAN;
        }
    }
}

/* One mode that grows makes unstable, one in doubt makes undecided; the one that does so most
 * clearly decides: by the lower end of its growth if unstable, the upper end if in doubt, the
 * growth itself if all decay. */
void verdict_stability(struct identify_result *r, double duration)
{
    static const int
        rank[3] = { [VERDICT_STABLE] = 0, [VERDICT_UNDECIDED] = 1, [VERDICT_UNSTABLE] = 2 },
        end[3] = { 0, 1, -1 };
    int most = -1;
    double by = 0;

    r->verdict = VERDICT_UNDECIDED;
    r->decides = -1;
    report_largest(r);
    for (int i = 0; i < r->mode_count; i++) {
        int says = spurious(&r->modes[i]) ? -1 : verdict_of(r, i, duration);
        double at = says < 0 ? 0
                             : creal(r->modes[i].exponent)
                + (end[rank[says]] != 0 ? end[rank[says]] * half_width(r, i) : 0);
        if (says < 0 || rank[says] < most || (rank[says] == most && !(at > by)))
            continue;
        most = rank[says], by = at;
        r->verdict = says;
        r->decides = i;
    }
}

void verdict_withhold(struct identify_result *r)
{
    r->verdict = VERDICT_UNDECIDED;
    r->decides = -1;
    r->margin_std = NAN;
    for (int i = 0; i < r->mode_count; i++) {
        struct identify_mode *m = &r->modes[i];
        m->std_re = m->std_im = m->std_multiplier = m->bar = NAN;
        m->std_frequency_hz = m->std_damping_ratio = NAN;
    }
}

bool verdict_crowd_grows(const struct identify_result *r)
{
    int count = 0;

    for (int i = 0; i < r->mode_count; i++)
        count += creal(r->modes[i].exponent) > REFINE_CLEAR * r->modes[i].std_re;
    return count > 2;
}

/* ---- clusters ---- */

/* Energy of the two parts against the signals': modes that cancel carry more than the signals hold.
 * (1) */
static bool cancels(const struct identify_mode *a, const struct identify_mode *b)
{
    double own = a->amplitude * a->amplitude + (b != NULL ? b->amplitude * b->amplitude : 0);

    return own > CANCELLATION;      /* channels have unit rms: all of them together hold 1 */
}

static double apart(const struct identify_mode *a, const struct identify_mode *b)
{
    return cabs(a->multiplier - b->multiplier);
}

/* What a mode's multiplier may be off by; a bar of the size of the multiplier itself says nothing
 * about neighbours. */
static double reach(const struct identify_mode *m)
{
    double bar = isfinite(m->std_multiplier) ? 2 * m->std_multiplier
        : isfinite(m->bar)                   ? m->bar
                                             : 0;

    return fmin(bar, 0.1 * cabs(m->multiplier));
}

static bool together(const struct identify_mode *a, const struct identify_mode *b, double duration)
{
    /* half a turn of one against the other in the record */
    double width = cabs(a->exponent - b->exponent);

    return apart(a, b) <= reach(a) + reach(b) || (width * duration < M_PI && cancels(a, b));
}

/* A pair beside the real axis: the half distance to its conjugate, and whether cosine and sine
 * cancel over the record. */
static bool meets_its_conjugate(const struct identify_result *r, const struct identify_mode *m,
                                double duration)
{
    double im = fabs(cimag(m->multiplier)), span = span_of(r),
           turn = fabs(carg(m->multiplier)) / span, other = M_PI / span - turn;
    double nearest = fmin(turn, other);

    return im > 0 && nearest * duration < 0.5 && cancels(m, NULL);
}

/* Known errors, and no two members, nor one and its own conjugate, within REFINE_CLEAR of them or
 * where rounding splits a Jordan block. */
static bool is_resolved(const struct identify_result *r, const struct identify_cluster *c, bool own,
                        double duration)
{
    /* a Jordan block's eigenvalues part by the root of what rounding does */
    double split = SPLIT * cabs(c->centroid) * span_of(r) / duration;
    bool yes = true;

    for (int i = 0; i < c->member_count; i++) {
        const struct identify_mode *a = &r->modes[c->members[i]];
        yes &= isfinite(a->std_multiplier)
            && (!own
                || 2 * fabs(cimag(a->multiplier)) > fmax(REFINE_CLEAR * 2 * reach(a), split));
        for (int k = 0; k < i; k++)
            yes &= apart(a, &r->modes[c->members[k]])
                > fmax(REFINE_CLEAR * (reach(a) + reach(&r->modes[c->members[k]])), split);
    }
    return yes;
}

static enum modal_status add_cluster(struct identify_result *r, const int *label, int which,
                                     int count, bool own, double duration, struct modal_error *err)
{
    struct identify_cluster *c = &r->clusters[r->cluster_count];
    double complex sum = 0;

    c->members = malloc(sizeof *c->members * count);
    if (c->members == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "verdict: no memory for a cluster of %d", count);
    r->cluster_count++;
    for (int i = 0; i < r->mode_count; i++)
        if (label[i] == which) {
            c->members[c->member_count++] = i;
            sum += r->modes[i].multiplier;
        }
    c->centroid = own ? creal(sum) / count : sum / count;  /* with its conjugate the mean is real */
    for (int i = 0; i < count; i++) {
        const struct identify_mode *m = &r->modes[c->members[i]];
        c->radius = fmax(c->radius, cabs(m->multiplier - c->centroid));
        c->near_defective |= cancels(m, NULL);
    }
    c->resolved = is_resolved(r, c, own, duration);
    for (int i = 0; i < count && c->near_defective; i++)
        if (isfinite(r->modes[c->members[i]].bar))
            c->radius = fmax(c->radius, r->modes[c->members[i]].bar);
    for (int i = 0; i < count; i++)
        if (!(r->modes[c->members[i]].bar >= c->radius))
            r->modes[c->members[i]].bar = c->radius;
    return MODAL_OK;
}

enum modal_status verdict_clusters(struct identify_result *r, double duration,
                                   struct modal_error *err)
{
    int n = r->mode_count, *label = malloc(sizeof *label * (n + 1));
    enum modal_status rc = MODAL_OK;

    r->clusters = calloc(n + 1, sizeof *r->clusters);
    if (label == NULL || r->clusters == NULL) {
        free(label);
        return modal_fail(err, MODAL_NO_MEMORY, "verdict: no memory for %d modes", n);
    }
    for (int i = 0; i < n; i++)
        label[i] = i;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++)
            if (label[i] != label[j] && together(&r->modes[i], &r->modes[j], duration))
                for (int k = 0, from = label[i], to = label[j]; k < n; k++)
                    label[k] = label[k] == from ? to : label[k];
    for (int which = 0; which < n && rc == MODAL_OK; which++) {
        int count = 0, at = -1;
        for (int i = 0; i < n; i++)
            if (label[i] == which)
                count++, at = i;
        if (count > 1)
            rc = add_cluster(r, label, which, count, false, duration, err);
        else if (count == 1 && meets_its_conjugate(r, &r->modes[at], duration))
            rc = add_cluster(r, label, which, count, true, duration, err);
    }
    free(label);
    return rc;
}
