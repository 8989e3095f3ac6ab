/*
 * torus_pieces.c - see torus_pieces.h; tested by tests/unit/modal/steady/test_torus.c
 *
 * While no law changes its regime each is a line, f = level + gain d, and a step of the motion is
 * its Taylor's polynomials (torus_taylor.h): exact to rounding.  Where laws see turns or change
 * their regimes within a step, these are found on the polynomials, the earliest first, and what
 * changes there is added to the dofs that feel it before the step ends.  So a step costs what the
 * program's entries do and an event what its neighbours do, of a chain of any length the same.
 *
 * Of few dofs a step is less as a product with one matrix (torus_maps.h), made for each set of
 * regimes that has been stepped through as often as making it costs steps; and so are 2, 4, 8 ..
 * steps together: to the next sample, or over some of which there is no record.  Most of a motion
 * is slow beside the structure's fastest, which the steps follow: such a stride is taken where each
 * law's input does within it what the cubic through its ends says, and that has no event.  How far
 * off the cubic may be its second rates tell: with X and x' right at both ends of 0 <= s <= 1 and
 * x'' off by D_0 and D_1, the quintic is beyond it by
 *
 *     1/2 s^2 (1 - s)^2 ((1 - s) D_0 + s D_1),                                                  (1)
 *
 * at most |D| / 32, and its rate by |D| / 6; of what turns within a stride several times, x or its
 * rates at the ends have as much.  TRUST times (1) is to make no event either; else both halves are
 * strides of their own.
 *
 * A law is asked at a step's end and at each turn of its input: between them paths are monotone.
 * Where its regime is another there its two lines agree somewhere before, (level - level') + (gain
 * - gain') d = 0.  Of two turns of an input within one step the cubic through its ends has both; a
 * step is so short that three are none of a motion's.  A scene stiffer than its samples takes as
 * many steps to each.
 *
 * What is wrong is rounding, and turns or events that a step hides: a law that changes and changes
 * back between two samples with no turn of its input among them.  Its input would have to turn, and
 * a step is a small part of the fastest period, a stride what (1) bounds.
 *
 * Disturbances are further columns of u, without waves, and the level of a slider that holds moves
 * with them: z is where d was as it began to hold, so that its level is -gain times what d was
 * disturbed by then; the force is continuous, and nothing jumps.  Once a turn they are made
 * orthogonal.
 */
#include "modal/steady/torus_pieces.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/law.h"
#include "modal/steady/torus_maps.h"

enum {
    SUBSTEPS_MOST = 6,         /* of a sample, 2^6: stiffer scenes are marched otherwise */
    STRIDES_MOST = 14,         /* where strides take them together: 5e5 steps a turn of the beam
                                * that has them */
    TOGETHER = 2,              /* 2^2 samples of which there is no record: an eighth of a turn of
                                * 32, and of longer strides few have no event */
    REGIMES_A_LAW = 3,         /* a slider's: it holds, or slips to either side */
    CUTS_MOST = 64,            /* of a step and law: more are no events of a motion, but of
                                * rounding */
    LEAST_ORDER = 3,           /* as torus_solve.c begins with */
    STILL = 16,                /* turns, before which nothing is said of who rests */
    MENDED = 3,                /* steps of Newton's method from the cubic's 1e-6 of a piece */
    HALVINGS = 60,             /* of an interval: all digits */
};
static const double JUST = 1e-9;          /* of a piece: a turn so near its begin is the one that it
                                           * begins at, whose rate is 0 but for rounding */
static const double SHORT = 1e-3;         /* of a step: in what first arrives there is no turn */
static const double NONE = 0.1;           /* of a piece: a turn mended is nearer by far */
static const double SAME = 1e-15;         /* of a step: instants that are one */
static const double NEVER = 2;            /* of a step: past its end */
static const double TRUST = 4;            /* times (1), an estimate of the first term left out */
static const double FAR = 1e100;          /* m: past any clearance or slider */

/* A law on its way: what input it had last and its rate, a slider's place, and its line, f = level
 * + gain d.  Of a law that is asked ahead of the motion the same, where that would be. */
struct hold { double d, v, z, level, gain; int regime; };

/* A law's next turn or change within a step, after FREE; what it will be there, and whether it is
 * looked for. */
struct due { double at, free; bool changes, listed; struct hold to; };

/* A change of this step: whose, and how far it was felt. */
struct felt { int law, hops; };

struct torus_pieces {
    struct torus_solver *s;
    struct workspace space;
    struct torus_taylor t;
    struct torus_maps maps;
    int N, sample;                                 /* samples a turn, 2^sample steps to each */
    int columns, disturbances;                     /* of u, and how many follow the motion */
    int n, laws, waves, *key;                      /* key: as torus_maps_find has it */
    double *wave, *then;                           /* [wave][2]: cos and sin, now and at m->to */
    double *u, *to;                                /* x, then v, [i columns + c] */
    struct hold *hold, *ahead;                     /* of laws */
    struct due *due;
    int *list, listed;                             /* laws that are looked at in this step */
    struct felt *felt;
    bool *acted, settling, leaves;
    long *when, turns, asked;                      /* when: the turn of a law's last change */
    double work;
};

/* What law L sees of the motion in U, and its rate *V. */
static double sees(const struct torus_pieces *m, int l, const double *u, double *v)
{
    const struct torus_ends *see = &m->t.see;
    double d = 0;

    *v = 0;
    for (int e = see->start[l]; e < see->start[l + 1]; e++) {
        d += see->weight[e] * u[see->dof[e] * m->columns];
        *v += see->weight[e] * u[(m->n + see->dof[e]) * m->columns];
    }
    return d;
}

/* LAW at D, come from FROM by a monotone path: its place, regime and line there into TO.  False: it
 * fails, or its force reads the rate and is no line of d. */
static bool ask(const struct law *law, double d, double v, const struct hold *from,
                struct hold *to)
{
    struct law_force out = { .memory = &to->z };
    struct law_point at = { .d = &d, .v = &v, .memory_before = &from->z };
    bool fine = law->kind->force(law, &at, &out, NULL) == MODAL_OK && out.fv[0][0] == 0;

    to->d = d, to->v = v;
    to->gain = out.fd[0][0];
    to->level = out.f[0] - to->gain * d;
    to->regime = out.regime;
    return fine;
}

/* m->maps know the laws' regimes. */
static void find_regime(struct torus_pieces *m)
{
    for (int l = 0; l < m->laws; l++)
        m->key[l] = m->hold[l].regime;
    torus_maps_find(&m->maps, m->key);
}

/* A whole step into m->to, laws as they are; *MADE: its polynomials are at hand, too. */
static void step_whole(struct torus_pieces *m, bool *made)
{
    *made = !torus_maps_has(&m->maps, true);
    if (*made)
        torus_taylor_make(&m->t, m->u, m->wave, m->to);
    else
        torus_maps_stride(&m->maps, 0, m->u, m->wave, m->to);
    m->work += (*made ? torus_taylor_work(&m->t) : torus_maps_work(&m->maps))
        + 20.0 * (1 + m->laws);
}

/* The polynomials of the step from m->u. */
static void tell_step(struct torus_pieces *m)
{
    if (torus_maps_tells(&m->maps)) {
        torus_taylor_begin(&m->t, m->wave);
        torus_maps_tell(&m->maps, m->u, m->wave);
        m->work += torus_maps_tell_work(&m->maps);
    } else {
        torus_taylor_make(&m->t, m->u, m->wave, m->to);
        m->work += torus_taylor_work(&m->t);
    }
}

/* Law L has GAIN and LEVEL from TAU on, and its regime is REGIME: how many hops that is felt. */
static int tell_change(struct torus_pieces *m, int l, double tau, int regime, double gain,
                       const double *level)
{
    double wave[2 * TORUS_LOADS_MOST];
    int hops;

    m->key[l] = regime;
    if (m->maps.most > 0)
        torus_maps_find(&m->maps, m->key);
    if (torus_maps_tells(&m->maps)) {
        torus_taylor_stop(&m->t, tau, wave);
        torus_taylor_set_line(&m->t, l, gain, level);
        torus_maps_tell(&m->maps, m->t.u, wave);
        m->work += torus_maps_tell_work(&m->maps);
        return m->t.reach[l].hops - 1;
    }
    hops = torus_taylor_change(&m->t, l, tau, gain, level);
    m->work += torus_taylor_change_work(&m->t, l, hops);
    return hops;
}

/* Where the cubic from D0, V0 to D1, V1 over T turns first, as a fraction 0 < s < 1 of T; 1:
 * nowhere.  Its rate is a quadratic. */
static double turns_at(double d0, double v0, double d1, double v1, double T)
{
    double a = v0 * T, b = v1 * T, rise = d1 - d0;
    double A = 3 * (a + b - 2 * rise), B = 2 * (3 * rise - 2 * a - b), C = a;
    double under = B * B - 4 * A * C, q, s1, s2, first = 1;

    if (a * b >= 0 && (under <= 0 || A == 0 || -B / (2 * A) <= 0 || -B / (2 * A) >= 1))
        return 1;
    q = -0.5 * (B + copysign(sqrt(fmax(under, 0)), B));
    s1 = q != 0 ? C / q : 1, s2 = A != 0 ? q / A : 1;
    if (s1 > JUST && s1 < first)
        first = s1;
    if (s2 > JUST && s2 < first)
        first = s2;
    return first;
}

/* How far from TAU the rate of P is 0: Newton's step. */
static double to_turn(const struct torus_taylor *t, const double *p, double tau)
{
    double v = 0, bend = 0, after = tau - t->base;

    for (int k = t->used; k > 0; k--) {
        bend = bend * after + v;
        v = v * after + k * p[k];
    }
    return bend != 0 ? -v / bend : v != 0 ? HUGE_VAL : 0;
}

/* The turn of P near TAU, between FROM and END, mended; it may not take the piece from FROM away,
 * nor double it.  FROM: it is none.  Where motion has only begun to arrive, as a high power of
 * time, the cubic has turns that it has not. */
static double mend_turn(const struct torus_taylor *t, const double *p, double tau, double from,
                        double end)
{
    for (int i = 0; i < MENDED; i++) {
        double off = to_turn(t, p, tau), piece = tau - from;

        if (fabs(off) < HUGE_VAL)
            tau = fmin(fmax(tau + off, from + 0.5 * piece), fmin(from + 2 * piece, end));
    }
    return fabs(to_turn(t, p, tau)) < NONE * (tau - from) ? tau : from;
}

/* Where between FROM and END of P the lines NOW and NEXT agree.  A slider that begins to slip
 * leaves its spring's line for its limit there; one that holds again does so at a turn, where the
 * piece begins, and a gap closes or opens at its clearance. */
static double crossing(const struct torus_taylor *t, const double *p, double from, double end,
                       const struct hold *now, const struct hold *next)
{
    double level = now->level - next->level, gain = now->gain - next->gain, rate;
    double begin = level + gain * torus_taylor_at(t, p, from, &rate);
    double last = level + gain * torus_taylor_at(t, p, end, &rate);
    double low = from, high = end, tau = end;

    if (begin == 0 || begin * last > 0)    /* it is at its bound already, but for rounding */
        return from;
    for (int i = 0; i < HALVINGS && high - low > SAME; i++) {
        double off = i == 0 ? last : level + gain * torus_taylor_at(t, p, tau, &rate), was = tau;

        *(off * last > 0 ? &high : &low) = tau;
        tau -= gain * rate != 0 ? off / (gain * rate) : HUGE_VAL;
        if (!(tau > low && tau < high))
            tau = 0.5 * (low + high);
        if (fabs(tau - was) <= SAME)
            break;
    }
    return tau;
}

/*
 * Law L's next turn or change after FROM into m->due; false: it cannot be asked.  After a change it
 * is JUST later, or one at a turn, whose rate is 0, would be taken back and made again.  Two
 * regimes whose lines are parallel have another between them: a slider that slips back within the
 * step holds before it does, and it is asked nearer by.
 */
static bool look_ahead(struct torus_pieces *m, int l, double from)
{
    struct due *due = &m->due[l];
    const struct hold *now = &m->hold[l];
    double p[TORUS_TERMS_MOST + 1], reach = 1, v0, d0;

    torus_taylor_sees(&m->t, l, 0, p);
    from = fmax(from, due->free);
    d0 = torus_taylor_at(&m->t, p, from, &v0);
    due->at = NEVER;
    while (from < reach) {
        double v, d = torus_taylor_at(&m->t, p, reach, &v), end = reach;
        double s = turns_at(d0, v0, d, v, reach - from);

        if (s < 1)
            end = mend_turn(&m->t, p, from + s * (reach - from), from, reach);
        if (end == from && reach - from > SHORT) {   /* of shorter ones the cubic knows more */
            reach = 0.5 * (from + reach);
            continue;
        }
        end = end > from ? end : reach;
        d = torus_taylor_at(&m->t, p, end, &v);
        if (!ask(&m->s->p->law[l], d, v / m->t.h, now, &due->to))
            return false;
        due->changes = due->to.regime != now->regime;
        if (due->changes && due->to.gain == now->gain && due->to.level != now->level
            && end - from > SAME) {
            reach = 0.5 * (from + end);
            continue;
        }
        due->at = due->changes ? crossing(&m->t, p, from, end, now, &due->to)
                : end < 1      ? end
                               : NEVER;
        return true;
    }
    return true;
}

/* Law L feels another's change at FROM and is looked at from there on: it is asked there, for a
 * turn of its own at that instant is none of what follows. */
static bool put_down(struct torus_pieces *m, int l, double from)
{
    struct hold *now = &m->hold[l], to;
    double p[TORUS_TERMS_MOST + 1], v, d;

    torus_taylor_sees(&m->t, l, 0, p);
    d = torus_taylor_at(&m->t, p, from, &v);
    if (!ask(&m->s->p->law[l], d, v / m->t.h, now, &to))
        return false;
    if (to.regime == now->regime)
        now->d = to.d, now->v = to.v, now->z = to.z;
    if (!m->due[l].listed)
        m->list[m->listed++] = l, m->due[l].free = 0;
    m->due[l].listed = true;
    return look_ahead(m, l, from);
}

/*
 * Law L, at m->due, has changed: levels of the motion and of its disturbances.  One that begins to
 * hold does so at the d of this instant, disturbed as that is; all others have levels of their own
 * numbers alone.  FELT: how far.
 */
static void change(struct torus_pieces *m, int l, struct felt *felt)
{
    const struct due *due = &m->due[l];
    struct hold *now = &m->hold[l];
    double gained = due->to.gain - now->gain, level[TORUS_WIDE] = { due->to.level };
    bool keeps = m->s->p->law[l].memory > 0 && gained > 0;

    for (int c = 1; keeps && c <= m->disturbances; c++) {
        double p[TORUS_TERMS_MOST + 1], rate;

        torus_taylor_sees(&m->t, l, c, p);
        level[c] = -gained * torus_taylor_at(&m->t, p, due->at, &rate);
    }
    *felt = (struct felt) { l, tell_change(m, l, due->at, due->to.regime, due->to.gain, level) };
    now->level = due->to.level, now->gain = due->to.gain, now->regime = due->to.regime;
    m->acted[l] = true, m->when[l] = m->turns;
}

/* The law whose turn or change is next; -1: there is none in this step.  Of those at one instant
 * the first by number, so that the order is the same on every machine. */
static int earliest(const struct torus_pieces *m)
{
    int first = -1;

    for (int a = 0; a < m->listed; a++)
        if (m->due[m->list[a]].at <= (first < 0 ? 1 : m->due[first].at)
            && (first < 0 || m->due[m->list[a]].at < m->due[first].at || m->list[a] < first))
            first = m->list[a];
    return first;
}

/* It is where m->to is; laws are as m->ahead has them. */
static void arrive(struct torus_pieces *m)
{
    double *u = m->u;

    m->u = m->to, m->to = u;
    for (int l = 0; l < m->laws; l++) {
        m->hold[l].d = m->ahead[l].d, m->hold[l].v = m->ahead[l].v;
        m->hold[l].z = m->ahead[l].z;
    }
}

/* The step's turns and changes, those of m->list being known, in the order of time; how many
 * changes, in m->felt; -1: they cannot be followed. */
static int follow(struct torus_pieces *m)
{
    int changes = 0, l;

    for (int cuts = 0; (l = earliest(m)) >= 0; cuts++) {
        struct due *due = &m->due[l];
        const struct torus_reach *r = &m->t.reach[l];
        double at = due->at;
        bool fine = true;

        if (cuts == CUTS_MOST * (1 + m->laws) || changes == CUTS_MOST * (1 + m->laws))
            return -1;
        if (due->changes) {
            struct felt *felt = &m->felt[changes++];

            change(m, l, felt);
            due->free = at + JUST;
            for (int a = 0; fine && a < r->laws[felt->hops]; a++)
                fine = put_down(m, r->law[a], at);
        } else {
            m->hold[l].d = due->to.d, m->hold[l].v = due->to.v, m->hold[l].z = due->to.z;
            fine = look_ahead(m, l, at);
        }
        if (!fine)
            return -1;
        m->work += 100;
    }
    return changes;
}

/* A step with turns or changes; false: it cannot be followed.  Each is asked once more at its end,
 * where it may be somewhere else than was foreseen. */
static bool step_cut(struct torus_pieces *m)
{
    int changes = follow(m);
    bool fine = changes >= 0;

    for (int a = 0; a < changes; a++) {
        const struct torus_reach *r = &m->t.reach[m->felt[a].law];

        torus_taylor_end(&m->t, r->dof, r->dofs[m->felt[a].hops], m->to);
    }
    for (int a = 0; a < m->listed; a++) {
        int l = m->list[a];
        double v, d = sees(m, l, m->to, &v);

        m->due[l].listed = false;
        fine = fine && ask(&m->s->p->law[l], d, v, &m->hold[l], &m->ahead[l]);
    }
    m->listed = 0;
    if (fine)
        arrive(m);
    if (fine && changes > 0)
        find_regime(m);
    return fine;
}

/* A step: most have no change and no turn, and are one product and a look at each law. */
static bool step(struct torus_pieces *m)
{
    bool made, fine = true;

    step_whole(m, &made);
    m->asked++;
    for (int l = 0; fine && l < m->laws; l++) {
        const struct hold *now = &m->hold[l];
        double v, d = sees(m, l, m->to, &v);

        fine = ask(&m->s->p->law[l], d, v, now, &m->ahead[l]);
        if (m->ahead[l].regime != now->regime || turns_at(now->d, now->v, d, v, m->t.h) < 1)
            m->list[m->listed++] = l;
    }
    if (fine && m->listed > 0) {
        if (!made)
            tell_step(m);
        for (int a = 0; fine && a < m->listed; a++) {
            m->due[m->list[a]].listed = true, m->due[m->list[a]].free = 0;
            fine = look_ahead(m, m->list[a], 0);
        }
        fine = fine && step_cut(m);
    } else if (fine)
        arrive(m);
    torus_maps_turn(&m->maps, 0, m->wave);
    return fine;
}

/* A law's input over a stride, s from 0 to 1: the cubic d0 + s (a + s (c2 + s c3)), and how far off
 * it the input's second rates are at its ends. */
struct path { double d0, a, c2, c3, off; };

static double path_at(const struct path *p, double s)
{
    return p->d0 + s * (p->a + s * (p->c2 + s * p->c3));
}

/* The least of its rate along its way at the begin; < 0: it turns. */
static double least_rate(const struct path *p)
{
    double sign = copysign(1, p->a), bend = -p->c2 / (3 * p->c3);
    double least = fmin(sign * p->a, sign * (p->a + 2 * p->c2 + 3 * p->c3));

    if (bend > 0 && bend < 1)
        least = fmin(least, sign * (p->a + p->c2 * bend));
    return least;
}

/* Its least and largest place. */
static void range_of(const struct path *p, double *low, double *high)
{
    double root = sqrt(fmax(p->c2 * p->c2 - 3 * p->c3 * p->a, 0));
    double q = -(p->c2 + copysign(root, p->c2));        /* of its rate, a + 2 c2 s + 3 c3 s^2 */
    double at[] = { 0, 1, q != 0 ? p->a / q : 0, p->c3 != 0 ? q / (3 * p->c3) : 0 };

    *low = HUGE_VAL, *high = -HUGE_VAL;
    for (size_t e = 0; e < sizeof at / sizeof *at; e++)
        if (at[e] >= 0 && at[e] <= 1) {
            *low = fmin(*low, path_at(p, at[e]));
            *high = fmax(*high, path_at(p, at[e]));
        }
}

/* Whether law L stays as it is at D, come from where it is. */
static bool stays(const struct torus_pieces *m, int l, double d)
{
    struct hold to;

    return ask(&m->s->p->law[l], d, 0, &m->hold[l], &to) && to.regime == m->hold[l].regime;
}

/* Whether law L has no event along P, nor as far beside it as (1) has it: of a motion that does not
 * come back nothing is behind its begin. */
static bool has_none(const struct torus_pieces *m, int l, const struct path *p)
{
    double beyond = TRUST / 32 * p->off, low, high;

    range_of(p, &low, &high);
    if (least_rate(p) > TRUST / 6 * p->off)
        return stays(m, l, p->a > 0 ? high + beyond : low - beyond);
    return stays(m, l, low - beyond) && stays(m, l, high + beyond);
}

/* 2^J steps at once: false, and all as it was, where a law may have an event within them. */
static bool leap(struct torus_pieces *m, int j)
{
    double T = ldexp(m->t.h, j), square = ldexp(1, 2 * j);
    bool fine = true;

    torus_maps_stride(&m->maps, j, m->u, m->wave, m->to);
    memcpy(m->then, m->wave, 2 * (size_t)m->waves * sizeof *m->then);
    torus_maps_turn(&m->maps, j, m->then);
    m->work += torus_maps_work(&m->maps) + 20.0 * (1 + m->laws) + 2.0 * m->laws * m->maps.columns;
    m->asked++;
    for (int l = 0; fine && l < m->laws; l++) {
        double v, d = sees(m, l, m->to, &v), rise = d - m->hold[l].d;
        struct path p = { .d0 = m->hold[l].d, .a = m->hold[l].v * T };

        p.c2 = 3 * rise - 2 * p.a - v * T, p.c3 = p.a + v * T - 2 * rise;
        p.off = fmax(fabs(square * torus_maps_bend(&m->maps, l, m->u, m->wave) - 2 * p.c2),
                     fabs(square * torus_maps_bend(&m->maps, l, m->to, m->then) - 2 * p.c2
                          - 6 * p.c3));
        fine = has_none(m, l, &p) && ask(&m->s->p->law[l], d, v, &m->hold[l], &m->ahead[l]);
    }
    if (fine) {
        arrive(m);
        memcpy(m->wave, m->then, 2 * (size_t)m->waves * sizeof *m->wave);
    }
    return fine;
}

/* 2^J steps; false: they cannot be followed. */
static bool stride(struct torus_pieces *m, int j)
{
    if (j == 0)
        return step(m);
    return (torus_maps_has(&m->maps, false) && leap(m, j))
        || (stride(m, j - 1) && stride(m, j - 1));
}

/* The waves at time T: afresh each turn, so that no rounding gathers in their products. */
static void set_waves(struct torus_pieces *m, double t)
{
    for (int w = 0; w < m->waves; w++) {
        double phase = fmod(m->t.omega[w] * t, 2 * M_PI);

        m->wave[2 * w] = cos(phase), m->wave[2 * w + 1] = sin(phase);
    }
}

/* Column C of m->u and of the laws' levels takes BY times column B. */
static void take_column(struct torus_pieces *m, int c, int b, double by)
{
    int C = m->columns;

    for (int i = 0; i < 2 * m->n; i++)
        m->u[i * C + c] -= by * m->u[i * C + b];
    for (int l = 0; l < m->laws; l++)
        m->t.level[l * C + c] -= by * m->t.level[l * C + b];
}

/* Of columns B and C of x and v, v over the leading tone's frequency, so that both weigh alike. */
static double dot(const struct torus_pieces *m, int b, int c)
{
    double sum = 0, lead = m->s->tones.omega[m->s->tones.lead];

    for (int i = 0; i < 2 * m->n; i++)
        sum += m->u[i * m->columns + b] * m->u[i * m->columns + c]
            / (i < m->n ? 1 : lead * lead);
    return sum;
}

/* Whether law L has changed in the later half of all turns. */
static bool moves(const struct torus_pieces *m, int l)
{
    return m->when[l] >= m->turns / 2;
}

/*
 * Sliders that come to rest: what their places were disturbed by stays for ever, and of a march
 * that settles it is no part of what it began with.  One that has been still for half of all turns
 * is taken to rest; where it moves again it has its disturbance from there on.
 */
static void leave_at_rest(struct torus_pieces *m)
{
    for (int l = 0; l < m->laws; l++)
        if (m->s->p->law[l].memory > 0 && m->turns >= STILL && !moves(m, l))
            for (int c = 1; c <= m->disturbances; c++)
                m->t.level[l * m->columns + c] = 0;
}

/* The disturbances made orthogonal, by Gram and Schmidt; their levels go along.  GROWN: log of what
 * each grew by since the last time. */
static void orthogonal(struct torus_pieces *m, double *grown)
{
    if (m->settling && m->leaves)
        leave_at_rest(m);
    for (int c = 1; c <= m->disturbances; c++) {
        double size;

        for (int b = 1; b < c; b++)
            take_column(m, c, b, dot(m, b, c));
        size = sqrt(dot(m, c, c));
        take_column(m, c, c, 1 - 1 / (size > 0 ? size : 1));
        if (grown != NULL)
            grown[c - 1] = log(fmax(size, 1e-300));
    }
}

enum modal_status torus_pieces_go(struct torus_pieces *m, int turns, int count, const int *dofs,
                                  double *x, double *growth, bool *followed,
                                  struct modal_error *err)
{
    double turn = 2 * M_PI / m->s->tones.omega[m->s->tones.lead];
    int samples = count > 0 ? 1 : 1 << (m->maps.longest - m->sample);

    m->work = 0;
    for (int t = 0; t < turns && *followed; t++) {
        if (m->s->opt->cancelled != NULL && m->s->opt->cancelled(m->s->opt->context))
            return modal_fail(err, MODAL_CANCELLED, "cancelled");
        set_waves(m, (double)m->turns * turn);
        for (int n = 0; n < m->N; n += samples) {
            for (int i = 0; i < count; i++)
                *x++ = m->u[dofs[i] * m->columns];
            *followed = *followed && budget_pays(m->s->work, m->work)
                && stride(m, count > 0 ? m->sample : m->maps.longest);
        }
        for (int i = 0; i < 2 * m->n; i++)
            *followed = *followed && isfinite(m->u[i * m->columns]);
        if (m->disturbances > 0 && *followed)
            orthogonal(m, growth != NULL ? growth + (size_t)t * (size_t)m->disturbances : NULL);
        m->turns++;
    }
    budget_add(m->s->work, m->work);
    m->work /= turns;
    return MODAL_OK;
}

long torus_pieces_turns(const struct torus_pieces *m) { return m->turns; }
double torus_pieces_work(const struct torus_pieces *m) { return m->work; }
bool torus_pieces_acted(const struct torus_pieces *m, int l) { return m->acted[l]; }
bool torus_pieces_leaves(const struct torus_pieces *m) { return m->leaves; }
long torus_pieces_asked(const struct torus_pieces *m) { return m->asked; }

void torus_pieces_forget(struct torus_pieces *m)
{
    memset(m->acted, 0, (size_t)m->laws * sizeof *m->acted);
    m->settling = false;
}

void torus_pieces_alone(struct torus_pieces *m)
{
    for (int i = 0; i < 2 * m->n; i++)
        m->u[i] = m->u[i * m->columns];
    for (int l = 0; l < m->laws; l++)
        m->t.level[l] = m->t.level[l * m->columns];
    m->columns = 1, m->disturbances = 0;
    torus_taylor_narrow(&m->t, 1);
}

/* Whether the scene is one of these: every law of one input, with lines between its events
 * (law.h's pieces) and a place at most, no rate read.  STEEPEST, or NULL: each law's largest gain,
 * of its rest and of what lies far beyond. */
static bool serves(const struct torus_solver *s, double *steepest)
{
    bool fine = s->p->n_linear == 0 && s->tone.index < 0;

    for (int l = 0; fine && l < s->p->laws; l++) {
        const struct law *law = &s->p->law[l];

        fine = law->kind->pieces != NULL && law->kind->inputs == 1 && law->memory <= 1;
        steepest[l] = 0;
        for (int side = -1; fine && side <= 1; side++) {
            struct hold from = { 0 }, to;

            fine = ask(law, side * FAR, 0, &from, &to);
            steepest[l] = fine ? fmax(steepest[l], fabs(to.gain)) : 0;
        }
    }
    return fine;
}

/* The scene's start, and the laws there. */
static bool set_out(struct torus_pieces *m)
{
    int C = m->columns;

    for (int i = 0; i < 2 * m->n; i++) {
        m->u[i * C] = i < m->n ? m->s->p->x0[i] : m->s->p->v0[i - m->n];
        for (int c = 1; c <= m->disturbances; c++)     /* of no special direction */
            m->u[i * C + c] = cos(1 + i * c + 2 * c);
    }
    orthogonal(m, NULL);
    for (int l = 0; l < m->laws; l++) {
        double v, d = sees(m, l, m->u, &v);
        struct hold from = { .d = d };

        if (!ask(&m->s->p->law[l], d, v, &from, &m->hold[l]))
            return false;
        m->t.gain[l] = m->hold[l].gain;
        m->t.level[l * C] = m->hold[l].level;
    }
    find_regime(m);
    return true;
}

/* Steps as short as the scene needs, 2^m->sample a sample; false: it is too stiff.  Where all maps
 * that its laws may come to have room, a sample is a few products however many. */
static bool set_steps(struct torus_pieces *m)
{
    double dt = 2 * M_PI / m->s->tones.omega[m->s->tones.lead] / m->N;
    double sets = pow(REGIMES_A_LAW, m->laws);
    int most = torus_maps_fit(&m->t, STRIDES_MOST, sets) ? STRIDES_MOST : SUBSTEPS_MOST;

    for (m->sample = 0; !torus_taylor_set_step(&m->t, ldexp(dt, -m->sample)); m->sample++)
        if (m->sample == most)
            return false;
    return true;
}

/* M's arrays, of its sizes.  Of changes there is room for as many as a step may have. */
static enum modal_status pieces_room(struct torus_pieces *m, struct modal_error *err)
{
    size_t n = (size_t)m->n, L = (size_t)m->laws, W = (size_t)m->waves, C = (size_t)m->columns;

    m->wave = workspace_zeros(&m->space, 2 * W, sizeof *m->wave);
    m->then = workspace_zeros(&m->space, 2 * W, sizeof *m->then);
    m->key = workspace_zeros(&m->space, L, sizeof *m->key);
    m->u = workspace_zeros(&m->space, 2 * n * C, sizeof *m->u);
    m->to = workspace_zeros(&m->space, 2 * n * C, sizeof *m->to);
    m->hold = workspace_zeros(&m->space, L, sizeof *m->hold);
    m->ahead = workspace_zeros(&m->space, L, sizeof *m->ahead);
    m->due = workspace_zeros(&m->space, L, sizeof *m->due);
    m->list = workspace_zeros(&m->space, L, sizeof *m->list);
    m->felt = workspace_zeros(&m->space, CUTS_MOST * (1 + L), sizeof *m->felt);
    m->acted = workspace_zeros(&m->space, L, sizeof *m->acted);
    m->when = workspace_zeros(&m->space, L, sizeof *m->when);
    return workspace_check(&m->space, "torus: no memory for a march", err);
}

enum modal_status torus_pieces_new(struct torus_solver *s, int N, int columns,
                                   struct torus_pieces **out, struct modal_error *err)
{
    double *steepest = calloc((size_t)s->p->laws + 1, sizeof *steepest);
    struct torus_pieces *m = calloc(1, sizeof *m);
    bool fine = false;
    enum modal_status rc = MODAL_OK;

    *out = NULL;
    if (steepest == NULL || m == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a march");
    else if (serves(s, steepest)) {
        m->s = s, m->N = N, m->settling = true;
        m->leaves = torus_unknowns(s, LEAST_ORDER) > TORUS_CORE_MOST;
        m->disturbances = columns, m->columns = columns > 1 ? TORUS_WIDE : 1 + columns;
        m->n = s->p->n, m->laws = s->p->laws;
        m->waves = s->groups;
        rc = pieces_room(m, err);
        if (rc == MODAL_OK)
            rc = torus_taylor_init(&m->t, s, m->columns, steepest, &fine, err);
        fine = rc == MODAL_OK && fine && set_steps(m);
        if (fine)
            rc = torus_maps_init(&m->maps, &m->t, m->sample,
                                 m->sample + (N % (1 << TOGETHER) == 0 ? TOGETHER : 0), err);
        fine = fine && rc == MODAL_OK && set_out(m);
    }
    free(steepest);
    if (fine)
        *out = m;
    else
        torus_pieces_free(m);
    return rc;
}

void torus_pieces_free(struct torus_pieces *m)
{
    if (m == NULL)
        return;
    torus_maps_done(&m->maps);
    torus_taylor_done(&m->t);
    workspace_free(&m->space);
    free(m);
}
