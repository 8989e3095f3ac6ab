/*
 * hill_leading.c - see hill_leading.h
 *
 * The exponents of the constant part next to 0 are cut into groups, and around each group as many
 * exponents of the whole are asked for as the group has, and some more.  What pulsates moves them
 * within their neighbourhood.  Stretch after stretch of the axis is looked at, until the outermost
 * part of all has no leading one; beyond it a few places up to the fastest motion are, for a damper
 * may leave motions alone that are not slow.  Hints are followed where they are not among those
 * found.  A leading one at the rim of its window gets a window of its own.  Windows with leading
 * ones are searched twice, from different starts: a value that is double shows its second vector
 * then.  Where hints are all that is asked for, each has a small window of its own.
 *
 * A sum of two frequencies that a harmonic pulsates with may make motions grow that lie past where
 * that walk ends.  The constant part's exponents cost a tenth of the whole's: all are taken up to
 * the highest such sum, and small windows are looked through where pairs of them say so
 * (hill_sums.h).
 *
 * What grows faster than W / 8 is counted (hill_growth.h).  First order serves for what is slower
 * where less pulsates than what holds: else what is faster than W / 1024 is counted too.
 */
#include "modal/scene/hill_leading.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/dofwise.h"
#include "modal/scene/hill_found.h"
#include "modal/scene/hill_growth.h"
#include "modal/scene/hill_sums.h"
#include "modal/scene/hill_window.h"

enum {
    HARMONICS = 6,               /* to begin with, of the highest that pulsates */
    HARMONICS_MOST = 400,        /* of a window: chosen */
    OVERLAPS = 4,                /* tries at a stretch that meets the one before: chosen */
    GROUP = 24,                  /* exponents of a window: chosen */
    MORE = 4,                    /* beyond what is known to be there: chosen */
    SAMPLES = 8,                 /* places up to the fastest motion: chosen */
    WINDOWS_MOST = 64,           /* chosen */
    FEW = 4,                     /* windows that a search has, at least: chosen */
    SUM = 8,                     /* exponents of a window where a sum may be: chosen */
};
static const double OFF_AXIS = 1e-3;     /* of W: windows' middles; no exponent is there, mostly */
static const double BESIDE = 1e-5;       /* of W: the same of a hint's own: others are farther */
static const double NEAR = 0.5;          /* of W: a group's radius at most */
static const double OVERLAP = 0.8;       /* of a radius, to the middle of the next stretch */
static const double REACH = 0.7;         /* of what was looked at: leading ones may lie there */
static const double INNER = 0.7;         /* of a window's radius: who lies there has neighbours */
static const double EDGE = 1e-11;        /* share past which more harmonics are kept */
static const double KNOWN = 1e-9;        /* multipliers of two searches that are one agree to it */
static const double FLAT = 0.9;          /* of a radius: so far a stretch off the axis is whole */
static const double MARGIN = 0.5;        /* of what first order raises by, for what it lacks */
static const double FAST = 0.125;         /* of W: from there on those that grow are counted */
static const double SLOW = 1.0 / 1024;   /* the same where what pulsates is more than what holds */
static const double WORK_GROWTH = 2e10;  /* operations to count them: chosen, some 20 seconds */
static const double WORK_SUMS = 4e10;    /* operations to find pairs: chosen, some 30 seconds */

struct disc {                    /* a window that was looked through */
    double complex middle;
    double radius;
    int count;
    double away[GROUP + MORE];   /* of what it found, ascending; windows are of no more */
    int leading;                 /* so many of these, up to the farthest leading one */
};

struct search {
    const struct program *p;
    double most, work, factors;          /* operations; of the constant part's factors */
    int n, pulsating, harmonics, windows;
    bool all_sums, missed;               /* as asked; a window did not reach what it was for */
    double sums_to;                      /* as struct hill_leading's */
    int growing;                         /* the same */
    bool counted;                        /* all that are wanted are among them, and were found */
    struct hill_found found;
    struct disc disc[WINDOWS_MOST];      /* that were looked through */
    int discs;
    struct disc looked;                  /* the last of all searches */
};

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "multipliers: out of memory");
}

/* The largest edge of the motions that are H's own. */
static double edge_of(const struct search *s, const struct hill_window *h)
{
    double edge = 0;

    for (int i = 0; i < h->count; i++)
        edge = abs(h->middle[i]) <= 2 * s->found.reach ? fmax(edge, h->edge[i]) : edge;
    return edge;
}

/* Dofs that something pulsating acts on or sees. */
static enum modal_status count_pulsating(struct search *s, struct modal_error *err)
{
    struct workspace scratch = { 0 };
    bool *seen = workspace_zeros(&scratch, (size_t)s->n, sizeof *seen);
    enum modal_status rc = seen == NULL ? no_memory(err) : MODAL_OK;

    for (int h = 0; rc == MODAL_OK && h < 4 * s->p->harmonics; h++) {
        const struct program_harmonic *a = &s->p->harmonic[h / 4];
        const struct sparse *A = h % 2 == 0 ? &a->cosine[PROGRAM_C + h / 2 % 2]
                                            : &a->sine[PROGRAM_C + h / 2 % 2];
        for (int i = 0; i < A->m; i++)
            for (int e = A->start[i]; e < A->start[i + 1]; e++)
                seen[i] = seen[A->index[e]] = true;
    }
    for (int i = 0; rc == MODAL_OK && i < s->n; i++)
        s->pulsating += seen[i];
    workspace_free(&scratch);
    return rc;
}

/*
 * A window of WANTED exponents, and HARMONICS, unless it takes more work than is left.  Its factors
 * take those of the constant part for each harmonic, and of what couples the harmonics either dense
 * ones, of the pulsating dofs, or the constant part's with a block in place of each number.  Half
 * of the vectors that there is room for are taken to do: all are four times the work, so that a
 * window of more than a part in FEW of what may be spent is not begun.
 */
static enum modal_status open_window(struct search *s, double complex shift, int harmonics,
                                     int wanted, int seed, struct hill_window *h,
                                     struct modal_error *err)
{
    double terms = 2.0 * harmonics + 1,
           coupled = fmin(pow(terms, 3) * s->factors, 8.0 / 3 * pow(terms * s->pulsating, 3)),
           work = hill_window_work(terms * s->n, hill_window_vectors(wanted) / 2,
                                   terms * s->factors + (harmonics > 0 ? coupled : 0));
    enum modal_status rc;

    if (s->most > 0 && (s->work + work > s->most || FEW * work > s->most))
        return modal_fail(err, MODAL_TOO_LARGE, "a window of %d harmonics takes about %.3g "
                          "operations, and %.3g of %.3g are spent", harmonics, work, s->work,
                          s->most);
    rc = hill_window(s->p, s->found.period, shift, harmonics, wanted, seed, h, err);
    if (rc != MODAL_OK)
        return rc;
    s->work += h->work;
    s->factors = harmonics == 0 ? fmax(s->factors, h->factors) : s->factors;
    return MODAL_OK;
}

/* WANTED exponents next to SHIFT, with as many harmonics as they need, from a start of SEED. */
static enum modal_status look(struct search *s, double complex shift, int wanted, int seed,
                              struct modal_error *err)
{
    struct hill_window h;
    enum modal_status rc;
    bool more;

    shift += OFF_AXIS * s->found.W;
    wanted = wanted < 2 * s->n ? wanted : 2 * s->n;
    wanted = wanted < GROUP + MORE ? wanted : GROUP + MORE;
    do {
        rc = open_window(s, shift, s->harmonics, wanted, seed, &h, err);
        more = rc == MODAL_OK && edge_of(s, &h) > EDGE && s->harmonics < HARMONICS_MOST;
        if (more) {
            hill_window_done(&h);
            s->harmonics += s->harmonics / 2 + 1;
        }
    } while (more);
    if (rc != MODAL_OK)
        return rc;
    s->windows++;
    s->looked = (struct disc){ .middle = shift, .radius = h.radius, .count = h.count };
    for (int i = 0; i < h.count; i++)
        s->looked.away[i] = cabs(h.exponent[i] - I * (h.middle[i] * s->found.W) - shift);
    if (seed == 1 && h.count > 0)
        s->disc[s->discs++] = s->looked;
    rc = hill_found_add(&s->found, &h, err);
    hill_window_done(&h);
    return rc;
}

/* From D's middle to Z, or to what is conjugate to it where that is nearer. */
static double away_of(const struct disc *d, double complex z)
{
    return fmin(cabs(z - d->middle), cabs(conj(z) - d->middle));
}

/* Of the windows that have Z, or what is conjugate to it, within SHARE of their radius the one
 * where it lies deepest; -1: none. */
static int window_of(const struct search *s, double complex z, double share)
{
    double least = share;
    int deepest = -1;

    for (int i = 0; i < s->discs; i++)
        if (away_of(&s->disc[i], z) <= least * s->disc[i].radius) {
            least = away_of(&s->disc[i], z) / s->disc[i].radius;
            deepest = i;
        }
    return deepest;
}

/* Does one of the first LAST lie farther out than RADIUS? */
static bool reaches(const struct search *s, int last, double radius)
{
    for (int i = 0; i < last && i < s->found.count; i++)
        if (cabs(s->found.motion[i].exponent) > radius)
            return true;
    return false;
}

/* The middle of a window that has HERE at its lower rim: the constant exponent a third of a group
 * above. */
static double complex middle_of(const struct search *s, const struct hill_window *constant,
                                double complex here)
{
    double complex middle = here;
    int above = 0;

    for (int j = 0; j < constant->count && above < GROUP / 3; j++)
        if (cimag(constant->exponent[j]) > cimag(here)
            && cabs(constant->exponent[j] - here) <= NEAR * s->found.W) {
            middle = constant->exponent[j];
            above++;
        }
    return middle;
}

/* Windows over the constant exponents beyond FROM that none has yet, and whose multipliers are not
 * below LEAST. */
static enum modal_status cover(struct search *s, const struct hill_window *constant, double from,
                               double least, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < constant->count && s->discs < WINDOWS_MOST; i++) {
        double complex here = constant->exponent[i], middle;
        int group = 0;

        if (cimag(here) < -KNOWN * s->found.W || cabs(here) < from || window_of(s, here, 1) >= 0
            || exp(creal(here) * s->found.period) < least)
            continue;
        middle = middle_of(s, constant, here);
        for (int j = 0; j < constant->count && group < GROUP; j++)
            group += cabs(constant->exponent[j] - middle) <= NEAR * s->found.W;
        rc = look(s, middle, group + MORE, 1, err);
        if (rc == MODAL_OK && window_of(s, here, 1) < 0)
            rc = look(s, here, group + MORE, 1, err);
        s->missed = s->missed || (rc == MODAL_OK && window_of(s, here, 1) < 0);
    }
    return rc;
}

/* The constant exponents of the next stretch of the axis, from *EDGE on, which becomes its end. */
static enum modal_status step_outwards(struct search *s, double *edge, double *radius,
                                       bool *vanish, struct modal_error *err)
{
    int asked = 2 * s->found.wanted + MORE < 2 * s->n ? 2 * s->found.wanted + MORE : 2 * s->n;
    enum modal_status rc;

    for (int again = 0; again < OVERLAPS; again++) {
        double middle = *edge > 0 ? *edge + OVERLAP * *radius : 0;
        struct hill_window constant;
        bool last;

        rc = open_window(s, CMPLX(OFF_AXIS * s->found.W, middle), 0, asked, 1, &constant, err);
        if (rc != MODAL_OK)
            return rc;
        last = middle - constant.radius <= *edge || again == OVERLAPS - 1;
        *radius = constant.radius;
        if (last) {
            rc = cover(s, &constant, 0, KNOWN * hill_found_largest(&s->found), err);
            *vanish = true;
            for (int i = constant.count / 2; i < constant.count; i++)
                *vanish = *vanish && exp(creal(constant.exponent[i]) * s->found.period)
                                         < KNOWN * hill_found_largest(&s->found);
            *edge = constant.count == 2 * s->n ? HUGE_VAL : fmax(*edge, middle + constant.radius);
        }
        hill_window_done(&constant);
        if (last)
            return rc;
    }
    return MODAL_OK;
}

/* Constant exponents at places farther out than EDGE: windows where they may be leading ones.  Of
 * those within EDGE a place far away knows nothing but its own rounding. */
static enum modal_status sample(struct search *s, double edge, struct modal_error *err)
{
    double frequency, decay;
    enum modal_status rc = MODAL_OK;

    dofwise_fastest(s->p, &frequency, &decay);
    for (int i = 1; rc == MODAL_OK && i <= SAMPLES && s->discs < WINDOWS_MOST; i++) {
        double place = frequency * i / SAMPLES;
        struct hill_window constant;

        if (place <= edge)
            continue;
        rc = open_window(s, CMPLX(OFF_AXIS * s->found.W, place), 0,
                         2 * MORE < 2 * s->n ? 2 * MORE : 2 * s->n, 1, &constant, err);
        if (rc != MODAL_OK)
            return rc;
        rc = cover(s, &constant, edge, hill_found_least(&s->found), err);
        hill_window_done(&constant);
    }
    return rc;
}

/* The next stretch of constant exponents from *EDGE on, which becomes its end, into SUMS; windows
 * where one of them may be leading.  *NEXT: the middle of the one after.  False: none was found. */
static enum modal_status step_sums(struct search *s, struct hill_sums *sums, double *edge,
                                   double complex *next, bool *found, struct modal_error *err)
{
    int asked = GROUP < 2 * s->n ? GROUP : 2 * s->n;

    *found = false;
    for (int again = 0; again < OVERLAPS && !*found; again++) {
        double complex middle = *next;
        struct hill_window constant;
        enum modal_status rc = open_window(s, middle, 0, asked, 1, &constant, err);
        double half, to;

        if (rc != MODAL_OK)
            return rc;
        half = constant.count == 2 * s->n ? HUGE_VAL : FLAT * constant.radius;
        to = cimag(middle) + half;
        *next = CMPLX(creal(middle), *edge + OVERLAP * half);
        if (cimag(middle) - half <= *edge && to > *edge) {
            *found = true;
            rc = hill_sums_add(sums, &constant, *edge, to, err);
            if (rc == MODAL_OK && *edge > 0)
                rc = cover(s, &constant, 0, hill_found_least(&s->found), err);
            for (int i = 0; i < constant.count; i++)     /* as the outermost of them is damped */
                if (i == 0 || cimag(constant.exponent[i]) > to - half / 2)
                    *next = CMPLX(creal(constant.exponent[i]) + OFF_AXIS * s->found.W,
                                  to + OVERLAP * half);
            *edge = to;
        }
        hill_window_done(&constant);
        if (rc != MODAL_OK)
            return rc;
    }
    return MODAL_OK;
}

/* Windows where pairs of SUMS may have leading ones, the largest first. */
static enum modal_status look_at_pairs(struct search *s, const struct hill_sums *sums,
                                       bool *settled, struct modal_error *err)
{
    struct hill_sum *pair = NULL;
    int pairs = 0;
    double least = fmax(hill_found_least(&s->found), KNOWN * hill_found_largest(&s->found));
    enum modal_status rc =
        hill_sums_find(sums, log(least) / s->found.period, MARGIN, &pair, &pairs, err);

    for (int i = 0; rc == MODAL_OK && i < pairs; i++) {
        double reached = creal(pair[i].exponent) + MARGIN * fmax(pair[i].raised, 0);

        if (window_of(s, pair[i].exponent, 1) >= 0
            || reached * s->found.period < log(hill_found_least(&s->found)))
            continue;
        *settled = *settled && s->discs < WINDOWS_MOST;
        if (s->discs == WINDOWS_MOST)
            break;
        rc = look(s, pair[i].exponent, SUM, 1, err);
        s->missed = s->missed || (rc == MODAL_OK && window_of(s, pair[i].exponent, 1) < 0);
    }
    free(pair);
    return rc;
}

/* What grows by sums of frequencies wherever it is; *SETTLED as before where all were looked at. */
static enum modal_status search_sums(struct search *s, bool *settled, struct modal_error *err)
{
    struct hill_sums sums;
    double frequency, decay, edge = 0, goal, begun = s->work;
    double complex next = OFF_AXIS * s->found.W;
    bool found = true;
    enum modal_status rc = hill_sums_new(s->p, s->found.period, &sums, err);

    dofwise_fastest(s->p, &frequency, &decay);
    goal = fmin(s->found.reach * s->found.W, frequency);
    while (rc == MODAL_OK && found && edge < goal && s->work - begun < WORK_SUMS)
        rc = step_sums(s, &sums, &edge, &next, &found, err);
    if (rc == MODAL_OK)
        rc = look_at_pairs(s, &sums, settled, err);
    s->sums_to = edge < goal ? edge : 0;
    *settled = *settled && !(edge < goal) && rc == MODAL_OK;
    rc = rc == MODAL_TOO_LARGE ? MODAL_OK : rc;
    hill_sums_done(&sums);
    return rc;
}

/* Outwards until what was looked at farther out added nothing, or all is alike past the highest
 * harmonic that pulsates, below which both frequencies lie whose sum it is; *SETTLED: it is so. */
static enum modal_status search_outwards(struct search *s, bool *settled, struct modal_error *err)
{
    double edge = 0, radius = 0;
    bool alike = false, vanish = false;
    enum modal_status rc = MODAL_OK;

    *settled = false;
    while (rc == MODAL_OK && !*settled && s->discs < WINDOWS_MOST) {
        int last;

        rc = step_outwards(s, &edge, &radius, &vanish, err);
        last = hill_found_last(&s->found);
        *settled = vanish || (last <= s->found.count && !reaches(s, last, REACH * edge)
                              && (!s->all_sums || edge > s->found.reach * s->found.W));
        alike = last <= s->found.count && hill_found_alike(&s->found, last)
                && edge > s->found.reach * s->found.W;
        if (edge == HUGE_VAL || alike)
            break;
    }
    *settled = *settled || alike;
    if (rc == MODAL_OK && *settled && !alike)
        rc = sample(s, edge, err);
    if (rc == MODAL_OK && *settled && !alike && !vanish && !s->all_sums)
        rc = search_sums(s, settled, err);
    return rc;
}

/* Windows about leading ones that lie at the rim of theirs, until none does. */
static enum modal_status spread(struct search *s, bool *settled, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    int rim;

    do {
        int last = hill_found_last(&s->found);

        rim = -1;
        for (int i = 0;
             i < last && i < s->found.count && rim < 0 && !hill_found_alike(&s->found, last); i++)
            rim = window_of(s, s->found.motion[i].exponent, INNER) < 0 ? i : -1;
        if (rim >= 0 && s->discs == WINDOWS_MOST)
            *settled = false;
        else if (rim >= 0)
            rc = look(s, s->found.motion[rim].exponent, GROUP, 1, err);
    } while (rc == MODAL_OK && rim >= 0 && *settled);
    return rc;
}

/* Does the window looked through last reach all of the first LAST that the I-th has? */
static bool saw_leading(const struct search *s, int i, int last)
{
    for (int k = 0; k < last && k < s->found.count; k++) {
        double complex z = s->found.motion[k].exponent;
        if (window_of(s, z, 1) == i
            && !(away_of(&s->looked, z) <= s->looked.radius + KNOWN * s->found.W))
            return false;
    }
    return true;
}

/* Once more through the windows that have leading ones, for as many as reach these and some more:
 * a second of what is double is among those. */
static enum modal_status repeat(struct search *s, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    int last = hill_found_last(&s->found);

    for (int k = 0; k < last && k < s->found.count; k++) {
        double complex z = s->found.motion[k].exponent;
        int i = window_of(s, z, 1), within = 0;
        for (int j = 0; i >= 0 && j < s->disc[i].count; j++)
            within += s->disc[i].away[j] <= away_of(&s->disc[i], z) + KNOWN * s->found.W;
        if (i >= 0)
            s->disc[i].leading = within > s->disc[i].leading ? within : s->disc[i].leading;
    }
    for (int i = 0; rc == MODAL_OK && i < s->discs; i++)
        if (s->disc[i].leading > 0) {
            rc = look(s, s->disc[i].middle - OFF_AXIS * s->found.W, s->disc[i].leading + MORE, 2,
                      err);
            s->missed = s->missed || (rc == MODAL_OK && !saw_leading(s, i, last));
        }
    return rc;
}

/* Is H a multiplier that was found, or too small to matter?  Or not settled, and others were found
 * where it is? */
static bool explained(struct search *s, const struct hill_hint *h)
{
    double near = fmax(h->residual, KNOWN);

    if (cabs(h->multiplier) <= hill_found_least(&s->found) + KNOWN
        || (h->residual > KNOWN && window_of(s, h->exponent, 1) >= 0))
        return true;
    for (int i = 0; i < s->found.count; i++) {
        const struct hill_motion *f = &s->found.motion[i];
        if (fmin(cabs(h->multiplier - f->multiplier), cabs(conj(h->multiplier) - f->multiplier))
            <= f->bar + near)
            return true;
    }
    return false;
}

/* Windows where hints are not explained; *SETTLED: they are now. */
static enum modal_status follow(struct search *s, const struct hill_hint *hint, int hints,
                                bool *settled, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < hints && s->discs < WINDOWS_MOST; i++)
        if (!explained(s, &hint[i]))
            rc = look(s, hint[i].exponent, GROUP, 1, err);
    for (int i = 0; rc == MODAL_OK && i < hints; i++)
        *settled = *settled && explained(s, &hint[i]);
    return rc;
}

/* Small windows about hints, of pairs the upper one, that are in none yet; *SETTLED as only_hints
 * has it. */
static enum modal_status refine_hints(struct search *s, const struct hill_hint *hint, int hints,
                                      bool *settled, struct modal_error *err)
{
    double rest = HUGE_VAL;
    enum modal_status rc = MODAL_OK;

    *settled = true;
    for (int i = 0; rc == MODAL_OK && i < hints; i++) {
        struct hill_motion *own;

        rest = fmin(rest, cabs(hint[i].multiplier) + hint[i].residual);
        if (cimag(hint[i].multiplier) < 0)
            continue;
        if (hill_found_own(&s->found, &hint[i]) == NULL && s->discs < WINDOWS_MOST)
            rc = look(s, hint[i].exponent - (OFF_AXIS - BESIDE) * s->found.W, 1, 1, err);
        own = hill_found_own(&s->found, &hint[i]);
        *settled = *settled && own != NULL;
        if (own != NULL)
            own->taken = true;
    }
    *settled = *settled && (hill_found_least(&s->found) > rest
                            || hill_found_alike(&s->found, hill_found_last(&s->found)));
    return rc;
}

/* The first LAST, both of each pair. */
static enum modal_status report(struct search *s, int last, struct hill_leading *out,
                                struct modal_error *err)
{
    size_t most = 2 * (size_t)last, states = 2 * (size_t)s->n;

    out->multiplier = workspace_zeros(&out->space, most, sizeof *out->multiplier);
    out->residual = workspace_zeros(&out->space, most, sizeof *out->residual);
    out->rounding = workspace_zeros(&out->space, most, sizeof *out->rounding);
    out->condition = workspace_zeros(&out->space, most, sizeof *out->condition);
    out->start = workspace_zeros(&out->space, most * states, sizeof *out->start);
    if (out->space.failed)
        return no_memory(err);
    for (int i = 0; i < last; i++)
        for (int side = 0; side < (hill_motion_real(&s->found.motion[i]) ? 1 : 2); side++) {
            const struct hill_motion *f = &s->found.motion[i];
            size_t at = (size_t)out->count++;
            out->multiplier[at] = side == 0 ? f->multiplier : conj(f->multiplier);
            if (hill_motion_real(f) && fabs(cimag(f->multiplier)) <= KNOWN * cabs(f->multiplier))
                out->multiplier[at] = creal(f->multiplier);  /* else its vector is not real */
            out->residual[at] = f->residual;
            out->rounding[at] = f->rounding;
            out->condition[at] = f->condition;
            for (size_t k = 0; k < states; k++)
                out->start[k + at * states] = side == 0 ? f->start[k] : conj(f->start[k]);
        }
    return MODAL_OK;
}

/* Are fewer found that grow by more than RATE than there are, and is there room to look? */
static bool lacks(const struct search *s, double rate)
{
    return hill_found_growing(&s->found, rate) < s->growing && s->discs < WINDOWS_MOST;
}

/* Constant exponents next to the right half of the real axis, stretch after stretch, and windows
 * about those that grow, until as many are found as there are. */
static enum modal_status search_real(struct search *s, double rate, struct modal_error *err)
{
    double frequency, decay, edge = rate, least = exp(rate * s->found.period);
    enum modal_status rc = MODAL_OK;

    dofwise_fastest(s->p, &frequency, &decay);
    while (rc == MODAL_OK && edge < frequency + decay && lacks(s, rate)) {
        struct hill_window constant;
        rc = open_window(s, 2 * edge, 0, 2 * MORE < 2 * s->n ? 2 * MORE : 2 * s->n, 1, &constant,
                         err);
        if (rc != MODAL_OK)
            return rc;
        rc = cover(s, &constant, 0, least, err);
        edge = fmax(2 * edge, 2 * edge + constant.radius);
        hill_window_done(&constant);
    }
    return rc;
}

/* Windows right of the axis, each row twice as far as the one before: at whole and half multiples
 * of W, as far apart as their harmonics reach, until as many are found as there are. */
static enum modal_status search_right(struct search *s, double rate, struct modal_error *err)
{
    double frequency, decay;
    enum modal_status rc = MODAL_OK;

    dofwise_fastest(s->p, &frequency, &decay);
    for (double right = 2 * rate; right < frequency + decay && lacks(s, rate); right *= 2)
        for (double up = 0; up < frequency && rc == MODAL_OK && lacks(s, rate);
             up += s->harmonics * s->found.W)
            for (int side = 0; side < 2 && rc == MODAL_OK && lacks(s, rate); side++) {
                double complex here = CMPLX(right, up + side * s->found.W / 2);
                if (window_of(s, here, 1) < 0)
                    rc = look(s, here, MORE, 1, err);
            }
    return rc == MODAL_TOO_LARGE || rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}

/* Counts those that grow by more than RATE, and looks for what is lacking; *FOUND: all are, false
 * as well where they cannot be counted. */
static enum modal_status count_faster(struct search *s, double rate, bool *counted, bool *found,
                                      struct modal_error *err)
{
    double most = s->most > 0 ? fmin(WORK_GROWTH, s->most - s->work) : WORK_GROWTH;
    int growing = -1;
    bool missed = s->missed;             /* the count tells here whether one is */
    enum modal_status rc = hill_growth(s->p, s->found.period, rate, most, &growing, &s->work, err);

    *counted = rc == MODAL_OK;
    *found = false;
    if (rc == MODAL_TOO_LARGE || rc == MODAL_NO_CONVERGENCE)
        return MODAL_OK;
    s->growing = rc == MODAL_OK ? growing : s->growing;
    if (rc == MODAL_OK)
        rc = search_real(s, rate, err);
    if (rc == MODAL_OK)
        rc = search_right(s, rate, err);
    s->missed = missed;
    *found = rc == MODAL_OK && hill_found_growing(&s->found, rate) == s->growing;
    return rc;
}

/* Are all found that grow fast?  Else *SETTLED: not.  Slow ones are counted too where they may be
 * none of those that first order knows of. */
static enum modal_status check_growth(struct search *s, bool uncounted, bool *settled,
                                      struct modal_error *err)
{
    double rate = FAST * s->found.W;
    bool counted, found, held = true;
    enum modal_status rc = count_faster(s, rate, &counted, &found, err);

    if (rc == MODAL_OK && !counted) {
        *settled = *settled && uncounted;
        return MODAL_OK;
    }
    s->counted = found && s->growing >= s->found.wanted;
    if (rc == MODAL_OK && *settled && found && !s->counted && !uncounted)
        rc = hill_is_held(s->p, s->found.period, rate, &held, err);
    if (rc == MODAL_OK && !held)
        rc = count_faster(s, SLOW * s->found.W, &counted, &found, err);
    *settled = found && (*settled || s->counted);
    return rc;
}

/* All that may be leading.  Of the whole spectrum none is left to be counted. */
static enum modal_status find_all(struct search *s, const struct hill_ask *ask, bool *settled,
                                  struct modal_error *err)
{
    enum modal_status rc = search_outwards(s, settled, err);
    bool whole = s->found.wanted >= 2 * s->n;

    if (rc == MODAL_OK && *settled)
        rc = spread(s, settled, err);
    if (rc == MODAL_OK)
        rc = follow(s, ask->hint, ask->hints, settled, err);
    if (rc == MODAL_OK && !whole)
        rc = check_growth(s, ask->uncounted, settled, err);
    if (rc == MODAL_OK)
        rc = repeat(s, err);
    s->counted = s->counted || (whole && hill_found_last(&s->found) <= s->found.count);
    return rc;
}

enum modal_status hill_leading(const struct program *p, double period, const struct hill_ask *ask,
                               struct hill_leading *out, struct modal_error *err)
{
    struct search s = { .p = p, .n = p->n, .most = ask->most, .all_sums = ask->all_sums,
                        .growing = -1,
                        .found = { .n = p->n, .wanted = ask->wanted, .period = period,
                                   .reach = hill_window_reach(p),
                                   .W = hill_window_frequency(p, period) } };
    int last;
    enum modal_status rc = count_pulsating(&s, err);

    *out = (struct hill_leading){ 0 };
    s.harmonics = (ask->harmonics > 0 ? ask->harmonics : HARMONICS) * s.found.reach;
    if (rc == MODAL_OK)
        rc = ask->only_hints ? refine_hints(&s, ask->hint, ask->hints, &out->settled, err)
                             : find_all(&s, ask, &out->settled, err);
    last = hill_found_last(&s.found);
    if (rc == MODAL_OK && s.found.count == 0)
        rc = modal_fail(err, MODAL_NO_CONVERGENCE, "no multiplier was found");
    if (rc == MODAL_OK) {
        out->alike = hill_found_alike(&s.found, last);
        out->settled = s.counted || (out->settled && !s.missed);
        out->windows = s.windows;
        out->harmonics = s.harmonics;
        out->sums_to = s.sums_to;
        out->growing = s.growing;
        rc = report(&s, last <= s.found.count ? last : s.found.count, out, err);
    }
    hill_found_done(&s.found);
    if (rc != MODAL_OK)
        hill_leading_done(out);
    out->work = s.work;
    return rc;
}

void hill_leading_done(struct hill_leading *h)
{
    workspace_free(&h->space);
    *h = (struct hill_leading){ 0 };
}
