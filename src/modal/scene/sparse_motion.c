/*
 * sparse_motion.c - see sparse_motion.h
 *
 * The whole leaps over h by a method of order 8 (leap.h), its laws as they are, kinks and all.
 * A kink at t_e spoils the law's dofs from there on: a force that is off by J (t - t_e) moves
 * its own dof by J h^3 / 6 and one at distance r, through springs k and dampers c of mass m, by
 *
 *     J h^2 (k h^2 / m)^r / (2 r + 3)!   or   J h^2 (c h / m)^r / (r + 3)!                      (1)
 *
 * of it.  So where a law has left its smooth piece within the leap the dofs up to a distance
 * `depth` from it are a part that is stepped again, from event to event, the others' motion given.
 * Parts that touch are one.  Whether depth was enough is seen: what a part's outermost dofs differ
 * by from the whole's must be within the tolerance, and those beyond, by (1), differ by less; else
 * depth is doubled, and all parts are made again.  A leap's length is bounded so that all parts
 * together cost as much as a few leaps of the whole.
 *
 * Rigid sliders stick or slip one way over all of a leap; where that ends, the acceleration leaps:
 * h in (1) has one power less then.
 *
 * Error and step.  Each component is weighed to the root of an energy, sqrt(K_ii) x_i and
 * sqrt(M_ii) v_i; the error of a leap, and of a part's, is kept below tolerance times the largest
 * of them so far.
 */
#include "modal/scene/sparse_motion.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/dofwise.h"
#include "modal/scene/leap.h"
#include "modal/scene/leap_events.h"
#include "modal/scene/leap_record.h"

enum {
    ORDER = 8,                 /* of the leaps: an error goes with that power of h */
    DEPTH = 4,                 /* of parts at first: (1) is some 1e-9 of J h^2 where k h^2 = m */
    CUTS_MOST = 12,            /* each gains as many digits as the last; the end is taken then */
    TURNING_CUTS = 4,          /* after so many cuts an event is a turning point: see TURNING */
    STEPS_OF_EVENT = 4,        /* of a part: 3.6 to 4.3 were counted, the cuts to it included */
    SHARES = 6,                /* of a leap that are weighed: down to 2^-6 of it */
    TINY_MOST = 4,             /* tiny steps on end: one may be a coincidence of two events */
    BLIND = 10,                /* a step without events is h / 2^10: a kink costs h^2 of a force */
    STEPS_MOST = 100000,       /* of parts within one leap: a rattle that dies out */
    ASK_EVERY = 16,            /* leaps between two looks at `cancelled` */
};
static const double SAFETY = 0.9;          /* of the step that the error's order foretells */
/* of a step, at once: what the error foretells further off is no more than a direction */
static const double GROW_MOST = 5;
static const double SHRINK_MOST = 0.2;
static const double FIRST = 0.01;          /* of the fastest motion's radian: the first leap */
static const double AGREED = 1e-10;        /* of a step: end and event, no kink inside to this */
static const double TURNING = 1e-6;        /* a turning point is known to sqrt(eps), and some */
static const double PAST_END = 1.2;        /* a step that was cut too early is found too short */
static const double WHOLE = 1e-14;         /* of a leap: sums of steps are off by as much */
static const double TINY = 1e-9;           /* of what was asked: an event right at the start */
static const double SHORTEST = 1e-12;      /* of dt: below it t + h is t but for rounding */
static const double BESIDE = 1e-12;        /* of dt: a corner so near is here */
static const double LIMIT = 1e300;         /* on the state: past it sums of squares overflow */
static const double TOLERANCE = 1e-10;     /* by default, as the dense way's */
/* in place of the dense way, which makes no error in what is linear: as good as it over thousands
 * of leaps, by order 8 at 1.8 times the cost */
static const double TOLERANCE_SMALL = 1e-12;
static const double PARTS_MOST = 4;        /* leaps of the whole that parts cost; then shorter */
static const double PARTS_LEAST = 1;       /* below it longer ones are tried again */
/* two shorter leaps halve it; one takes longer to come back */
static const double SHORTER = 0.7;
static const double LONGER = 1.2;

struct sparse_motion {
    struct dofwise *f;               /* its own */
    struct leap whole, part;         /* whole.from is the state */
    struct dof_set set;              /* of the part */
    struct leap_record record;
    const struct simulate_options *opt;
    double *weight;                  /* 2 n: see the opening */
    double *memory, *after;          /* of the laws, at the leap's start and at its end */
    double *result;                  /* 2 n: the leap's end with its parts' */
    double *event;                   /* of each law: the first in the leap, HUGE_VAL: none */
    double *parted;                  /* of each law: 1: a part has carried its memory */
    int *mark;                       /* of each dof: its distance from an event, -1: too far */
    int *queue;                      /* n of room */
    int *inside;                     /* of each part: the laws with an event in it */
    int *list, *begin;               /* marked dofs, part after part, each ascending; where each */
                                     /* begins, and the last ends: n + 1 of room */
    bool *listed;                    /* of each dof */
    bool shortened;                  /* from where it stands: once, for an event that is seen at */
                                     /* the same share of every leap would do so for ever */
    int events, depth;               /* in the last leap; of parts */
    double t, dt, h, most;           /* s: now; samples; the next leap, and its bound by parts */
    double tolerance, scale;         /* scale: the largest weighed component so far */
    double done;                     /* dofs x stages of parts in this leap, over the whole's */
    double radian;                   /* s: the longest that sliders' pull allows */
    double part_most;                /* s: the longest step that every part's error allows */
    int64_t steps, rejected;
};

/* The largest weighed component of Y; HUGE_VAL where one is not finite. */
static double size_of(const struct sparse_motion *m, const double *y)
{
    double largest = 0;

    for (int i = 0; i < 2 * m->f->n; i++) {
        if (!(fabs(y[i]) < LIMIT))
            return HUGE_VAL;
        largest = fmax(largest, fabs(y[i]) * m->weight[i]);
    }
    return largest;
}

/* Where laws change in the leap just made. */
static enum modal_status find_events(struct sparse_motion *m, struct modal_error *err)
{
    const struct program *p = m->f->p;
    enum modal_status rc = MODAL_OK;

    m->events = 0;
    for (int l = 0; l < p->laws && rc == MODAL_OK; l++) {
        m->event[l] = HUGE_VAL;
        m->parted[l] = 0;
        if (!p->law[l].kind->smooth && m->f->watch[l].mixed)
            rc = leap_find_event(&m->whole, m->memory, l, 1, &m->event[l], err);
        m->events += m->event[l] <= 1;
    }
    return rc;
}

/* A dof to be walked on from, at DISTANCE from an event. */
static int reach(struct sparse_motion *m, int dof, int distance, int count)
{
    if (m->mark[dof] >= 0)
        return count;
    m->mark[dof] = distance;
    m->queue[count] = dof;
    return count + 1;
}

/* Marks: every dof up to `depth` from one on which a law acts with an event up to LIMIT of the
 * leap; all of them where M couples every acceleration. */
static void spread(struct sparse_motion *m, double limit)
{
    const struct program *p = m->f->p;
    const struct sparse *g = &m->f->graph;
    int count = 0;

    for (int i = 0; i < p->n; i++)
        m->mark[i] = m->f->mass == NULL && m->events > 0 ? 0 : -1;
    for (int l = 0; l < p->laws; l++)
        for (int e = 0; m->event[l] <= limit && e < law_ends(&p->law[l]); e++)
            count = reach(m, p->law[l].end[e].dof, 0, count);
    for (int at = 0; at < count; at++)
        for (int k = g->start[m->queue[at]];
             m->mark[m->queue[at]] < m->depth && k < g->start[m->queue[at] + 1]; k++)
            count = reach(m, g->index[k], m->mark[m->queue[at]] + 1, count);
}

static int ascending(const void *a, const void *b)
{
    const int *x = a, *y = b;

    return (*x > *y) - (*x < *y);
}

/* The dofs that are joined to FIRST through marked ones, into `list` from COUNT on; where they
 * end. */
static int join(struct sparse_motion *m, int first, int count)
{
    const struct sparse *g = &m->f->graph;
    int begin = count;

    m->list[count++] = first;
    m->listed[first] = true;
    for (int at = begin; at < count; at++)
        for (int k = g->start[m->list[at]]; k < g->start[m->list[at] + 1]; k++) {
            int j = g->index[k];
            if (m->mark[j] < 0 || m->listed[j])
                continue;
            m->list[count++] = j;
            m->listed[j] = true;
        }
    qsort(m->list + begin, (size_t)(count - begin), sizeof *m->list, ascending);
    return count;
}

/* Components of what is marked, into `list`; how many.  Where M couples all they are one. */
static int components(struct sparse_motion *m)
{
    int found = 0, count = 0;

    for (int i = 0; m->f->mass == NULL && i < m->f->n; i++)
        m->list[count++] = i;
    if (m->f->mass == NULL) {
        m->begin[0] = 0;
        m->begin[1] = count;
        return 1;
    }
    memset(m->listed, 0, (size_t)m->f->n * sizeof *m->listed);
    for (int i = 0; i < m->f->n; i++)
        if (m->mark[i] >= 0 && !m->listed[i]) {
            m->begin[found++] = count;
            count = join(m, i, count);
        }
    m->begin[found] = count;
    return found;
}

/* What parts up to the LIMIT of the leap just made take, over a leap of the whole: a part is
 * stepped from each of its events to the next. */
static double cost_of_parts(struct sparse_motion *m, double limit)
{
    const struct program *p = m->f->p;
    double cost = 0;
    int parts;

    spread(m, limit);
    parts = components(m);
    for (int c = 0; c < parts; c++)
        for (int k = m->begin[c]; k < m->begin[c + 1]; k++)
            m->queue[m->list[k]] = c;            /* whose part a dof is of */
    memset(m->inside, 0, (size_t)parts * sizeof *m->inside);
    for (int l = 0; l < p->laws; l++)
        if (m->event[l] <= limit && law_ends(&p->law[l]) > 0)
            m->inside[m->queue[p->law[l].end[0].dof]]++;
    for (int c = 0; c < parts; c++)
        cost += (m->begin[c + 1] - m->begin[c]) / (double)m->f->n
                * (1 + STEPS_OF_EVENT * m->inside[c]);
    return cost;
}

/*
 * Of the leap just made the share that gets on for least: where many laws change, their parts grow
 * together, and each of the events in them is a step of them all; a shorter leap has fewer and
 * smaller ones, but is made again.  One that ends before the first of them spares none: it would be
 * put off from leap to leap, and come nearer for ever.  The marks are those of the whole leap.
 */
static double cheapest_share(struct sparse_motion *m)
{
    double cost = 1 + cost_of_parts(m, 1), best = cost, share = 1, tried = 1, first = HUGE_VAL;

    for (int l = 0; l < m->f->p->laws; l++)
        first = fmin(first, m->event[l]);
    for (int i = 0; i < SHARES && best > 1 + PARTS_MOST && first <= tried / 2; i++) {
        double again;

        tried /= 2;
        again = 1 + (1 + cost_of_parts(m, tried)) / tried;
        if (again < best) {
            best = again;
            share = tried;
        }
    }
    if (cost > 1 + PARTS_MOST)
        spread(m, 1);
    return share;
}

/* OUT = IN over the part's dofs. */
static void copy_set(const struct sparse_motion *m, const double *in, double *out)
{
    for (int r = 0; r < m->set.runs; r++) {
        struct dof_run run = m->set.run[r];
        size_t size = (size_t)(run.to - run.from) * sizeof *in;
        memcpy(out + run.from, in + run.from, size);
        memcpy(out + m->f->n + run.from, in + m->f->n + run.from, size);
    }
}

/* The first event of the part's step just made, up to LIMIT; law FORCED is asked in any case. */
static enum modal_status first_event(struct sparse_motion *m, int forced, double limit,
                                     double *theta, int *law, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    *theta = HUGE_VAL;
    *law = -1;
    for (int k = 0; k < m->set.laws && rc == MODAL_OK; k++) {
        int l = m->set.law[k];
        double at = HUGE_VAL;
        if (!m->f->p->law[l].kind->smooth && (m->f->watch[l].mixed || l == forced))
            rc = leap_find_event(&m->part, m->after, l, limit, &at, err);
        if (at < *theta) {
            *theta = at;
            *law = l;
        }
    }
    return rc;
}

/* The part's step of at most H, cut at its first event: *CUT says that one ended it. */
static enum modal_status step_to_event(struct sparse_motion *m, double h, bool blind, bool *cut,
                                       struct modal_error *err)
{
    double asked = h, theta, off = HUGE_VAL;
    int law = -1;
    enum modal_status rc = MODAL_OK;

    *cut = false;
    m->f->ended = -1;
    for (int k = 0; k < CUTS_MOST && rc == MODAL_OK; k++) {
        m->part.h = h;
        rc = leap_make(&m->part, m->after, err);
        for (int r = 0; r < m->set.runs; r++)
            m->done += (m->set.run[r].to - m->set.run[r].from) / (double)m->f->n;
        if (rc != MODAL_OK || blind)
            return rc;
        rc = first_event(m, law, *cut ? PAST_END : 1, &theta, &law, err);
        off = fabs(theta - 1);
        if (law < 0 || off < AGREED || (k >= TURNING_CUTS && off < TURNING))
            break;
        *cut = true;
        h = fmin(h * theta, asked);  /* the event becomes the step's end */
    }
    m->f->ended = off < TURNING ? law : -1;
    return rc;
}

/* The length that ERROR, over what is allowed, lets a step have, over its own. */
static double length_of(double error)
{
    return SAFETY * pow(fmax(error, DBL_EPSILON), -1.0 / ORDER);
}

/* How much longer or shorter the next step is to be. */
static double factor_of(double error)
{
    return fmin(GROW_MOST, fmax(SHRINK_MOST, length_of(error)));
}

/* The part's step is taken: its end is its state. */
static enum modal_status take_step(struct sparse_motion *m, bool last, long *k,
                                   struct modal_error *err)
{
    enum modal_status rc = leap_record_part(&m->record, &m->whole, m->memory, &m->part, m->after,
                                            last, k, err);

    m->f->switched = false;
    if (rc == MODAL_OK)
        rc = dofwise_remember(m->f, &m->set, m->part.t + m->part.h, m->part.to,
                              m->part.to + m->f->n, m->after, m->after, err);
    m->f->ended = -1;
    dofwise_hold(m->f, &m->set, m->after, m->part.to + m->f->n);
    copy_set(m, m->part.to, m->part.from);
    copy_set(m, m->part.slope[DORMAND_PRINCE_END], m->part.slope[0]);
    m->part.t += m->part.h;
    m->steps++;
    if (rc == MODAL_OK && m->f->switched)        /* the acceleration leaps */
        rc = leap_slope(&m->part, m->part.t, m->part.from, m->after, m->part.slope[0], err);
    return rc;
}

/* Fewer events than can be told apart. */
static enum modal_status stalled(const struct sparse_motion *m, struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_CONVERGENCE,
                      "contacts or slips accumulate at t = %.9g s: %d steps did not pass %g s",
                      m->part.t, STEPS_MOST, m->whole.h);
}

/* m->scale, and what the part's step comes to where that is more: a slider that slips after all
 * have been at rest. */
static double part_scale(const struct sparse_motion *m)
{
    double scale = m->scale;

    for (int r = 0; r < m->set.runs; r++)
        for (int i = m->set.run[r].from; i < m->set.run[r].to; i++)
            for (int c = i; c < 2 * m->f->n; c += m->f->n)
                scale = fmax(scale, fabs(m->part.to[c]) * m->weight[c]);
    return scale;
}

/* The part over all of the leap, from event to event. */
static enum modal_status step_part(struct sparse_motion *m, struct modal_error *err)
{
    double left = m->whole.h, want = left, allowed = 0;
    long k = m->record.first;
    int tiny = 0, steps = 0;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < m->set.laws; i++)
        want = fmin(want, m->event[m->set.law[i]] * m->whole.h);
    while (left > WHOLE * m->whole.h && rc == MODAL_OK) {
        bool cut, blind = tiny > TINY_MOST, last = want >= left * (1 - TINY);
        double h = last ? left : want, error;
        if (blind)                   /* caught and let go at one place: past it */
            h = fmin(h, ldexp(m->whole.h, -BLIND));
        rc = step_to_event(m, h, blind, &cut, err);
        if (rc != MODAL_OK)
            return rc;
        if (++steps > STEPS_MOST)
            return stalled(m, err);
        error = leap_error(&m->part, m->weight, NULL) / (m->tolerance * part_scale(m));
        if (!(error <= 1)) {
            m->rejected++;
            want = m->part.h * fmin(factor_of(error), SAFETY);
            if (!(want > SHORTEST * m->dt))
                return stalled(m, err);
            continue;
        }
        allowed = fmax(allowed, m->part.h * length_of(error));
        left -= m->part.h;
        tiny = m->part.h < TINY * h ? tiny + 1 : 0;
        rc = take_step(m, left <= WHOLE * m->whole.h, &k, err);
        want = cut ? left : fmax(h, m->part.h) * factor_of(error);
    }
    m->part_most = fmin(m->part_most, allowed);
    return rc;
}

/* Do the part's outermost dofs end where the whole's do? */
static bool deep_enough(const struct sparse_motion *m)
{
    for (int r = 0; r < m->set.runs && !m->set.whole; r++)
        for (int i = m->set.run[r].from; i < m->set.run[r].to; i++)
            for (int c = i; m->mark[i] == m->depth && c < 2 * m->f->n; c += m->f->n)
                if (!(fabs(m->part.from[c] - m->whole.to[c]) * m->weight[c]
                      <= m->tolerance * m->scale))
                    return false;
    return true;
}

/* One component made a part and stepped; *DEEP whether it reached far enough. */
static enum modal_status one_part(struct sparse_motion *m, int component, bool *deep,
                                  struct modal_error *err)
{
    int from = m->begin[component];
    enum modal_status rc;

    dofwise_set(m->f, m->list + from, m->begin[component + 1] - from, &m->set);
    for (int k = 0; k < m->set.laws; k++)
        m->parted[m->set.law[k]] = 1;
    m->part.set = &m->set;
    m->part.around = &m->whole;
    m->part.t = m->whole.t;
    copy_set(m, m->whole.from, m->part.from);
    copy_set(m, m->whole.slope[0], m->part.slope[0]);
    rc = step_part(m, err);
    *deep = *deep && rc == MODAL_OK && deep_enough(m);
    copy_set(m, m->part.from, m->result);
    return rc;
}

/* All parts of the leap, as deep as need be.  *SHARE: 1, or how much shorter a leap is cheaper,
 * and then they are not made. */
static enum modal_status make_parts(struct sparse_motion *m, bool last, double *share,
                                    struct modal_error *err)
{
    bool deep = false;
    enum modal_status rc = MODAL_OK;

    *share = 1;
    while (!deep && rc == MODAL_OK) {
        int parts;

        *share = m->shortened ? 1 : cheapest_share(m);
        if (*share < 1)
            return MODAL_OK;
        parts = components(m);
        deep = true;
        memcpy(m->result, m->whole.to, 2 * (size_t)m->f->n * sizeof *m->result);
        memcpy(m->after, m->memory, (size_t)m->f->memories * sizeof *m->after);
        rc = leap_record_whole(&m->record, &m->whole, m->memory, last, err);
        for (int c = 0; c < parts && deep && rc == MODAL_OK; c++)
            rc = one_part(m, c, &deep, err);
        if (!deep && rc == MODAL_OK) {
            m->depth *= 2;
            spread(m, 1);
        }
    }
    return rc;
}

/* Memories of the laws that no part has carried. */
static enum modal_status remember_rest(struct sparse_motion *m, struct modal_error *err)
{
    m->set.laws = 0;
    for (int l = 0; l < m->f->p->laws; l++)
        if (m->parted[l] == 0)
            m->set.law[m->set.laws++] = l;
    return dofwise_remember(m->f, &m->set, m->whole.t + m->whole.h, m->whole.to,
                            m->whole.to + m->f->n, m->memory, m->after, err);
}

/* The leap is taken: its end, with its parts', is the state. */
static enum modal_status take_leap(struct sparse_motion *m, struct modal_error *err)
{
    double *taken = m->events > 0 ? m->result : m->whole.to;
    size_t states = 2 * (size_t)m->f->n;
    enum modal_status rc;

    m->f->switched = false;
    rc = remember_rest(m, err);
    memcpy(m->memory, m->after, (size_t)m->f->memories * sizeof *m->memory);
    memcpy(m->whole.from, taken, states * sizeof *taken);
    dofwise_hold(m->f, &m->f->all, m->memory, m->whole.from + m->f->n);
    m->scale = fmax(m->scale, size_of(m, m->whole.from));
    m->t = m->whole.t + m->whole.h;
    m->record.first = m->record.end;
    m->steps++;
    if (m->events == 0 && !m->f->switched)
        memcpy(m->whole.slope[0], m->whole.slope[DORMAND_PRINCE_END], states * sizeof *taken);
    else if (rc == MODAL_OK)
        rc = leap_slope(&m->whole, m->t, m->whole.from, m->memory, m->whole.slope[0], err);
    return rc;
}

/* The next leap's length, from this one's ERROR and what its parts cost. */
static void choose_length(struct sparse_motion *m, double error)
{
    if (m->done > PARTS_MOST)
        m->most = m->whole.h * SHORTER;
    else if (m->done < PARTS_LEAST)
        m->most = fmax(m->most, m->whole.h) * LONGER;
    /* the whole's error says nothing of its parts, whose motion is as fast */
    m->h = fmin(m->whole.h * factor_of(error), fmin(fmin(m->most, m->part_most), m->radian));
    if (m->depth > DEPTH)
        m->depth--;                  /* a shorter leap needs less, by (1) */
}

/* One leap of at most H; LAST: it ends the record.  *TAKEN says whether it was. */
static enum modal_status leap(struct sparse_motion *m, double h, bool last, bool *taken,
                              struct modal_error *err)
{
    double before = m->scale, size, error, share = 1;
    enum modal_status rc;

    m->whole.t = m->t;
    m->whole.h = h;
    m->done = 0;
    m->part_most = HUGE_VAL;
    rc = leap_make(&m->whole, m->memory, err);
    size = rc == MODAL_OK ? size_of(m, m->whole.to) : HUGE_VAL;
    if (rc == MODAL_OK && size < HUGE_VAL)
        rc = find_events(m, err);
    if (rc != MODAL_OK)
        return rc;
    spread(m, 1);
    m->scale = fmax(fmax(before, size), DBL_MIN);
    m->f->at_rest = m->tolerance * m->scale;
    error = size < HUGE_VAL ? leap_error(&m->whole, m->weight, m->events > 0 ? m->mark : NULL)
                                  / (m->tolerance * m->scale)
                            : HUGE_VAL;
    *taken = error <= 1;
    if (!*taken) {
        m->scale = before;           /* an unstable trial says nothing of the motion */
        m->rejected++;
        m->h = h * fmin(factor_of(error), SAFETY);
        return MODAL_OK;
    }
    rc = m->events > 0 ? make_parts(m, last, &share, err)
                       : leap_record_whole(&m->record, &m->whole, m->memory, last, err);
    m->scale = before;
    m->shortened = rc == MODAL_OK && share < 1;
    if (m->shortened) {
        *taken = false;
        m->rejected++;
        m->most = m->h = h * share;
        return MODAL_OK;
    }
    if (rc == MODAL_OK)
        rc = take_leap(m, err);
    if (rc == MODAL_OK)
        choose_length(m, error);
    return rc;
}

/* Ways of rigid sliders where loads or rates may have leapt, in `memory`: laws else remember what
 * they did. */
static enum modal_status choose_ways(struct sparse_motion *m, struct modal_error *err)
{
    double *x = m->whole.from, *v = x + m->f->n;
    enum modal_status rc =
        dofwise_remember(m->f, &m->f->all, m->t, x, v, m->memory, m->memory, err);

    dofwise_hold(m->f, &m->f->all, m->memory, v);
    return rc;
}

/* Impulses and corners up to now; the next corner's time, HUGE_VAL: none. */
static enum modal_status pass_corners(struct sparse_motion *m, int *corner, double *next,
                                      struct modal_error *err)
{
    const struct sources *src = m->f->src;
    double *v = m->whole.from + m->f->n;
    bool any = false;
    enum modal_status rc = MODAL_OK;

    for (; *corner < src->corners && src->corner[*corner].t <= m->t + BESIDE * m->dt; ++*corner) {
        const struct source_corner *c = &src->corner[*corner];
        any = true;
        if (c->dof < 0)
            continue;
        if (m->f->mass != NULL) {
            v[c->dof] += c->impulse / m->f->mass[c->dof];
            continue;
        }
        memset(m->f->force, 0, (size_t)m->f->n * sizeof *m->f->force);
        m->f->force[c->dof] = c->impulse;
        sparse_lu_solve(m->f->factor, m->f->force, m->f->solved);
        for (int i = 0; i < m->f->n; i++)
            v[i] += m->f->solved[i];
    }
    *next = *corner < src->corners ? src->corner[*corner].t : HUGE_VAL;
    /* where all sliders stick no error tells how fast they are pulled; pulses begin and end at
     * corners */
    if ((any || m->t == 0) && m->f->sliders > 0)
        m->radian = dofwise_radian(m->f->p, (m->t + *next) / 2);
    m->h = fmin(m->h, m->radian);
    if (any && m->f->sliders > 0)
        rc = choose_ways(m, err);
    return any && rc == MODAL_OK
               ? leap_slope(&m->whole, m->t, m->whole.from, m->memory, m->whole.slope[0], err)
               : rc;
}

/* From corner to corner up to the last sample. */
static enum modal_status run(struct sparse_motion *m, const struct scene_time *time,
                             struct modal_error *err)
{
    double end = fmax(leap_record_time(&m->record, time->samples - 1), 0), next;
    const struct simulate_options *opt = m->opt;
    int corner = 0;
    enum modal_status rc = pass_corners(m, &corner, &next, err);

    for (int64_t k = 0; rc == MODAL_OK && m->record.first < time->samples; k++) {
        double stop = fmin(end, next), left = stop - m->t;
        bool taken = false, last = m->h >= left * (1 - TINY);
        if (k % ASK_EVERY == 0 && opt->cancelled != NULL && opt->cancelled(opt->context))
            return modal_fail(err, MODAL_CANCELLED, "simulate: cancelled at t = %.9g s", m->t);
        if (k % ASK_EVERY == 0 && opt->progress != NULL)
            opt->progress(opt->context, m->t / fmax(end, DBL_MIN));
        if (size_of(m, m->whole.from) == HUGE_VAL)
            return modal_fail(err, MODAL_OVERFLOW,
                              "the motion leaves the range of doubles before t = %.9g s", m->t);
        rc = leap(m, last ? left : m->h, last && stop == end, &taken, err);
        if (rc == MODAL_OK && !taken && !(m->h > SHORTEST * m->dt))
            return modal_fail(err, MODAL_NO_CONVERGENCE,
                              "steps of %g s at t = %.9g s still miss the tolerance %g", m->h, m->t,
                              m->tolerance);
        if (taken && last)
            m->t = stop;             /* not the sum of steps */
        if (taken && rc == MODAL_OK)
            rc = pass_corners(m, &corner, &next, err);
    }
    return rc;
}

/* At t = 0, from the program's initial state. */
static enum modal_status start(struct sparse_motion *m, struct program *p,
                               const struct scene_time *time, double *signals,
                               struct workspace *space, struct modal_error *err)
{
    size_t n = (size_t)p->n, laws = (size_t)p->laws, memories = (size_t)m->f->memories;
    double *stage = workspace_zeros(space, 2 * n, sizeof *stage), frequency, decay;
    enum modal_status rc;

    leap_init(&m->whole, m->f, stage, space);
    leap_init(&m->part, m->f, stage, space);
    m->whole.set = &m->f->all;
    m->weight = workspace_zeros(space, 2 * n, sizeof *m->weight);
    m->result = workspace_zeros(space, 2 * n, sizeof *m->result);
    m->memory = workspace_zeros(space, memories, sizeof *m->memory);
    m->after = workspace_zeros(space, memories, sizeof *m->after);
    m->event = workspace_zeros(space, laws, sizeof *m->event);
    m->parted = workspace_zeros(space, laws, sizeof *m->parted);
    m->mark = workspace_zeros(space, n, sizeof *m->mark);
    m->queue = workspace_zeros(space, n, sizeof *m->queue);
    m->list = workspace_zeros(space, n, sizeof *m->list);
    m->begin = workspace_zeros(space, n + 1, sizeof *m->begin);
    m->listed = workspace_zeros(space, n, sizeof *m->listed);
    m->inside = workspace_zeros(space, n, sizeof *m->inside);
    rc = leap_record_init(&m->record, m->f, time, signals, space, err);
    if (rc == MODAL_OK)
        rc = dofwise_set_new(m->f, &m->set, err);
    if (rc != MODAL_OK)
        return rc;
    memcpy(m->whole.from, p->x0, n * sizeof *p->x0);
    memcpy(m->whole.from + n, p->v0, n * sizeof *p->v0);
    dofwise_weights(p, fmax(time->start + time->duration, time->dt), m->weight);
    m->scale = size_of(m, m->whole.from);
    m->f->at_rest = m->tolerance * m->scale;
    dofwise_fastest(p, &frequency, &decay);
    m->h = FIRST / fmax(fmax(frequency, decay), 1 / time->dt);
    m->most = HUGE_VAL;
    m->radian = HUGE_VAL;
    m->depth = DEPTH;
    /* a slider put past its bound has followed */
    rc = choose_ways(m, err);
    return rc == MODAL_OK ? leap_slope(&m->whole, 0, m->whole.from, m->memory, m->whole.slope[0],
                                       err)
                          : rc;
}

/* Counters of the laws into the effects' rows. */
static void report(const struct sparse_motion *m, struct program *p)
{
    for (int l = 0; l < p->laws; l++) {
        struct program_effect *e = &p->effect[p->law[l].effect];
        e->evaluations += m->f->evaluations[l];
        e->active = e->active || m->f->acted[l];
    }
}

enum modal_status sparse_motion(struct program *p, const struct scene_time *time,
                                const struct simulate_options *opt, double *signals,
                                struct simulate_result *out, struct modal_error *err)
{
    struct sparse_motion m = { .opt = opt, .dt = time->dt,
                               .tolerance = opt->tolerance > 0 ? opt->tolerance
                                            : sparse_motion_small(p) || p->laws == 0
                                                 ? TOLERANCE_SMALL : TOLERANCE };
    struct workspace space = { 0 };
    enum modal_status rc = dofwise_new(p, &m.f, err);

    if (rc == MODAL_OK)
        rc = start(&m, p, time, signals, &space, err);
    if (rc == MODAL_OK)
        rc = run(&m, time, err);
    if (rc == MODAL_OK) {
        report(&m, p);
        *out = (struct simulate_result){ .integrator = "dormand-prince-8", .steps = m.steps,
                                         .rejected = m.rejected };
    }
    workspace_free(&space);
    dofwise_free(m.f);
    return rc;
}
