/*
 * torus_pieces.c - see torus_pieces.h; tested by tests/unit/modal/steady/test_torus.c
 *
 * While no law changes its regime each is a line, f = level + gain d, and with the waves of the
 * loads the motion is that of constant coefficients,
 *
 *     u' = A u,   u = (x, v, levels, cosines, sines),                                           (1)
 *
 * A one matrix for each set of regimes: a step is a product with e^{A h}, exact.  A step is cut
 * where an input's rate changes sign, so that laws see monotone pieces, and where a regime changes:
 * there both lines agree, (level - level') + (gain - gain') d = 0.  Both instants are found on the
 * cubic through the ends of a piece and mended by one step of Newton's method on (1) itself, by
 * Taylor's series.
 *
 * Of two turns of an input within one step the cubic's rate, a quadratic, has both; a step is so
 * short that three are none of a motion's.  A scene stiffer than its samples takes as many steps
 * to each.
 *
 * The map of a set of regimes is made when it is first met: a scene of L laws with r regimes each
 * meets few of the r^L.  Cost: of n dofs, L laws and W waves 2 n (2 n + L + 2 W) products a step
 * and column, and an event some 50 steps.
 *
 * What is wrong is rounding, and turns or events that a step hides: a law that changes and changes
 * back between two samples with no turn of its input among them.  Its input would have to turn, and
 * a step is a small part of the fastest period.
 *
 * Disturbances are further columns of u, without waves, and the level of a slider that holds moves
 * with them: z is where d was as it began to hold, so that its level is -gain times what d was
 * disturbed by then; the force is continuous, and nothing jumps.  Once a turn they are made
 * orthogonal.
 */
#include "modal/steady/torus_pieces.h"
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/law.h"

enum {
    DOFS_MOST = 16,            /* a step is a product of their square: past them a march of sparse
                                * steps is cheaper */
    LAWS_MOST = 16,
    REGIMES_MOST = 256,        /* sets of them: 8 MB of maps at the most */
    SUBSTEPS_MOST = 64,        /* of a sample: stiffer scenes are marched otherwise */
    CUTS_MOST = 64,            /* of a step: more are no events of a motion, but of rounding */
    TERMS_MOST = 40,           /* of a series whose argument is FAST or less: 12 are rounding */
    HALVINGS = 40,             /* of an interval on the cubic */
};
static const double FAST = 0.5;           /* rad a step of the fastest frequency: of two turns in
                                           * one step the cubic sees both */
static const double ROUNDING = 1e-17;     /* of u: what a term of a series is left out at */
static const double JUST = 1e-9;          /* of a piece: a turn so near its begin is the one that it
                                           * begins at, whose rate is 0 but for rounding */
static const double SHORT = 1e-3;         /* of a step: in what first arrives there is no turn */
static const double NONE = 0.1;           /* of a piece: a turn mended is nearer by far */
static const double SAME = 1e-14;         /* of a step: cuts that are one */

/* A law's line in each of some regimes; fast: rad/s, a bound of A's growth. */
struct regime { int key[LAWS_MOST]; double *A, *P, fast; };

/* A law on its way: what input it had last, a slider's place, and its line, f = level + gain d.
 * Of a law that is asked ahead of the motion the same, where that would be. */
struct hold { double d, z, level, gain; int regime; };

struct torus_pieces {
    struct torus_solver *s;
    struct workspace space;
    int N, substeps, columns;                      /* samples a turn, steps a sample */
    int n, laws, waves, D;                         /* D: numbers of u */
    double h;                                      /* s */
    double *M;                                     /* M^-1, then M^-1 K and M^-1 C, n x n */
    double *see, *push;                            /* [law][n]: ends' weights; M^-1 of them */
    double *omega, *load;                          /* of waves; [wave][2][n]: M^-1 p */
    double *turn;                                  /* [wave][2]: cos and sin of omega h */
    struct regime *regime, *now;
    int regimes;
    double *u, *to, *term;                         /* D x (1 + columns), by columns */
    struct hold hold[LAWS_MOST], ahead[LAWS_MOST];
    bool acted[LAWS_MOST], stiff;
    long turns, asked;
    double work;
};

/* Numbers of the motion and its disturbances. */
static size_t places(const struct torus_pieces *m)
{
    return (size_t)m->D * (size_t)(1 + m->columns);
}

/* TO = FACTOR A U of one column: (1) row by row.  x' is v, levels stand, and a wave's cosine and
 * sine turn into each other; only v' needs A. */
static void act_once(const struct torus_pieces *m, const double *A, double factor, const double *u,
                     double *to)
{
    int n = m->n, D = m->D, first = 2 * n + m->laws;

    for (int i = 0; i < n; i++)
        to[i] = factor * u[n + i];
    for (int i = 0; i < n; i++) {
        double sum = 0;

        for (int j = 0; j < D; j++)
            sum += A[i * D + j] * u[j];
        to[n + i] = factor * sum;
    }
    memset(to + 2 * n, 0, (size_t)m->laws * sizeof *to);
    for (int w = 0; w < m->waves; w++) {
        to[first + 2 * w] = -factor * m->omega[w] * u[first + 2 * w + 1];
        to[first + 2 * w + 1] = factor * m->omega[w] * u[first + 2 * w];
    }
}

/* e^{A t} U, COUNT columns, into TO: of R's series as many terms as matter.  What follows term k is
 * about (fast t)^k / k! of u. */
static void series(const struct torus_pieces *m, const struct regime *r, double t, int count,
                   const double *u, double *to)
{
    size_t D = (size_t)m->D;
    int terms = 2;

    for (double left = r->fast * fabs(t); left > ROUNDING && terms < TERMS_MOST; terms++)
        left *= r->fast * fabs(t) / terms;
    for (int c = 0; c < count; c++, u += D, to += D) {
        double *now = m->term, *next = m->term + D;

        memcpy(now, u, D * sizeof *now);
        memcpy(to, u, D * sizeof *to);
        for (int k = 1; k <= terms; k++) {
            double *was = now;

            act_once(m, r->A, t / k, now, next);
            for (size_t i = 0; i < D; i++)
                to[i] += next[i];
            now = next, next = was;
        }
    }
}

/*
 * U a substep on, into TO: x and v by the map of the regimes at hand, waves by their own turn.
 * Levels stand; those of disturbances count, but they have no waves.
 */
static void step_whole(const struct torus_pieces *m, const double *u, double *to)
{
    int n = 2 * m->n, D = m->D, first = n + m->laws;
    const double *P = m->now->P;

    for (int c = 0; c <= m->columns; c++, u += D, to += D) {
        int most = c == 0 ? D : first;

        for (int i = 0; i < n; i++) {
            double sum = 0;

            for (int j = 0; j < most; j++)
                sum += P[i * D + j] * u[j];
            to[i] = sum;
        }
        for (int i = n; i < first; i++)
            to[i] = u[i];
        for (int w = 0; w < m->waves; w++) {
            double a = u[first + 2 * w], b = u[first + 2 * w + 1];

            to[first + 2 * w] = a * m->turn[2 * w] - b * m->turn[2 * w + 1];
            to[first + 2 * w + 1] = a * m->turn[2 * w + 1] + b * m->turn[2 * w];
        }
    }
}

/* What law L sees of a column of U, of the motion or of a disturbance: d, and its rate V. */
static double sees(const struct torus_pieces *m, int l, const double *u, double *v)
{
    const double *w = m->see + l * m->n;
    double d = 0;

    *v = 0;
    for (int i = 0; i < m->n; i++) {
        d += w[i] * u[i];
        *v += w[i] * u[m->n + i];
    }
    return d;
}

/* Law L at D, come from FROM by a monotone path: its place, regime and line there into TO.  False:
 * it fails, or its force reads the rate and is no line of d. */
static bool ask(const struct torus_pieces *m, int l, double d, double v, const struct hold *from,
                struct hold *to)
{
    const struct law *law = &m->s->p->law[l];
    struct law_force out = { .memory = &to->z };
    struct law_point at = { .d = &d, .v = &v, .d_before = &from->d, .memory_before = &from->z };
    bool fine = law->kind->force(law, &at, &out, NULL) == MODAL_OK && out.fv[0][0] == 0;

    to->d = d;
    to->gain = out.fd[0][0];
    to->level = out.f[0] - to->gain * d;
    to->regime = out.regime;
    return fine;
}

/*
 * A and P of the regimes that m->hold has; false: there are too many, or they are too stiff.
 *
 * P is the series of each unit vector, so that a whole step and its pieces are of one kind: what a
 * cut step ends at is, to rounding, what the whole one would have.
 */
static bool make_regime(struct torus_pieces *m)
{
    int n = m->n, D = m->D, first = 2 * n + m->laws;
    struct regime *r = &m->regime[m->regimes];
    double most = 0, damp = 0, *one;

    if (m->regimes == REGIMES_MOST)
        return false;
    r->A = workspace_zeros(&m->space, (size_t)(n * D), sizeof *r->A);
    r->P = workspace_zeros(&m->space, (size_t)(2 * n * D), sizeof *r->P);
    one = workspace_zeros(&m->space, 2 * (size_t)D, sizeof *one);
    if (m->space.failed)
        return false;
    for (int i = 0; i < n; i++) {
        double sum = 0, more = 0;

        for (int j = 0; j < n; j++) {
            double K = m->M[(n + i) * n + j];

            for (int l = 0; l < m->laws; l++)
                K += m->push[l * n + i] * m->hold[l].gain * m->see[l * n + j];
            r->A[i * D + j] = -K;
            r->A[i * D + n + j] = -m->M[(2 * n + i) * n + j];
            sum += fabs(K), more += fabs(m->M[(2 * n + i) * n + j]);
        }
        for (int l = 0; l < m->laws; l++)
            r->A[i * D + 2 * n + l] = -m->push[l * n + i];
        for (int w = 0; w < 2 * m->waves; w++)
            r->A[i * D + first + w] = m->load[w * n + i];
        most = fmax(most, sum), damp = fmax(damp, more);
    }
    r->fast = sqrt(most) + damp;
    m->stiff = r->fast * m->h > FAST;
    for (int w = 0; w < m->waves; w++)
        r->fast = fmax(r->fast, m->omega[w]);
    if (m->stiff)
        return false;
    for (int j = 0; j < D; j++) {
        memset(one, 0, (size_t)D * sizeof *one);
        one[j] = 1;
        series(m, r, m->h, 1, one, one + D);
        for (int i = 0; i < 2 * n; i++)
            r->P[i * D + j] = one[D + i];
    }
    for (int l = 0; l < m->laws; l++)
        r->key[l] = m->hold[l].regime;
    m->now = r;
    m->regimes++;
    return true;
}

/* m->now is that of m->hold: found among those met before, for a motion has few and meets them
 * again and again, or made. */
static bool find_regime(struct torus_pieces *m)
{
    for (int r = 0; r < m->regimes; r++) {
        bool same = true;

        for (int l = 0; l < m->laws; l++)
            same = same && m->regime[r].key[l] == m->hold[l].regime;
        if (same) {
            m->now = &m->regime[r];
            return true;
        }
    }
    return make_regime(m);
}

/* Law L from now on as TO has it: levels of the motion and of its disturbances.  One that begins to
 * hold does so at the d of this instant, disturbed as that is; all others have levels of their own
 * numbers alone. */
static void change(struct torus_pieces *m, int l, const struct hold *to)
{
    double gained = to->gain - m->hold[l].gain;
    bool keeps = m->s->p->law[l].memory > 0 && gained > 0;

    for (int c = 0; c <= m->columns; c++) {
        double *u = m->u + c * m->D, none;

        u[2 * m->n + l] = c == 0 ? to->level : keeps ? -gained * sees(m, l, u, &none) : 0;
    }
    m->hold[l].level = to->level, m->hold[l].gain = to->gain, m->hold[l].regime = to->regime;
    m->acted[l] = true;
}

/* The cubic from D0, V0 to D1, V1 over T: its place and rate, per T, at fraction S.  Its error is
 * (h^4 / 384) d'''': instants found on it are mended. */
static double cubic(double d0, double v0, double d1, double v1, double T, double s, double *rate)
{
    double a = v0 * T, b = v1 * T, rise = d1 - d0, c2 = 3 * rise - 2 * a - b, c3 = a + b - 2 * rise;

    *rate = a + s * (2 * c2 + 3 * s * c3);
    return d0 + s * (a + s * (c2 + s * c3));
}

/* Where the rate of that cubic is first 0 in 0 < s < 1; 1: nowhere.  Its rate is a quadratic. */
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

/* The first turn of any law's input over T, from m->u to m->to, as a fraction of T, and whose it
 * is; 1 and -1: none turns.  Between turns a slider's law and a gap's see monotone paths. */
static double first_turn(const struct torus_pieces *m, double T, int *law)
{
    double first = 1;

    *law = -1;
    for (int l = 0; l < m->laws; l++) {
        double v0, v1, d0 = sees(m, l, m->u, &v0), d1 = sees(m, l, m->to, &v1);
        double s = turns_at(d0, v0, d1, v1, T);

        if (s < first)
            first = s, *law = l;
    }
    return first;
}

/* The fraction of T where law L's lines, of now and of NEXT, agree: on the cubic.  A slider that
 * begins to slip leaves its spring's line for its limit there; one that holds again does so at a
 * turn, where the piece begins, and a gap closes or opens at its clearance. */
static double crossing(const struct torus_pieces *m, int l, double T, const struct hold *next)
{
    const struct hold *now = &m->hold[l];
    double v0, v1, d0 = sees(m, l, m->u, &v0), d1 = sees(m, l, m->to, &v1), rate;
    double level = now->level - next->level, gain = now->gain - next->gain;
    double low = 0, high = 1, end = level + gain * d1, begin = level + gain * d0;

    if (begin == 0 || begin * end > 0)     /* it is at its bound already, but for rounding */
        return 0;
    for (int i = 0; i < HALVINGS; i++) {
        double half = 0.5 * (low + high);

        *((level + gain * cubic(d0, v0, d1, v1, T, half, &rate)) * end > 0 ? &high : &low) = half;
    }
    return high;
}

/* m->to becomes m->u after T, of the motion alone: disturbances go along as it arrives. */
static void go_to(const struct torus_pieces *m, double T)
{
    series(m, m->now, T, 1, m->u, m->to);
}

/* How far from m->to, at T, law L's rate is 0: Newton's step. */
static double to_turn(const struct torus_pieces *m, int l)
{
    double v, bend = 0;

    sees(m, l, m->to, &v);
    for (int i = 0; i < m->n; i++) {
        double a = 0;

        for (int j = 0; j < m->D; j++)
            a += m->now->A[i * m->D + j] * m->to[j];
        bend += m->see[l * m->n + i] * a;
    }
    return bend != 0 ? -v / bend : v != 0 ? HUGE_VAL : 0;
}

/* The instant of a turn of law L, near T and before END, mended: its rate is 0.  Newton's step from
 * the cubic's 1e-6 of a piece leaves 1e-12; it may not take the piece away, nor double it.  0: it
 * is none.  Where motion has only begun to arrive, as a high power of time, the cubic has turns
 * that it has not. */
static double mend_turn(const struct torus_pieces *m, int l, double T, double end)
{
    double off;

    go_to(m, T);
    off = to_turn(m, l);
    T = fabs(off) < HUGE_VAL ? fmin(fmax(T + off, 0.5 * T), fmin(2 * T, end)) : T;
    go_to(m, T);
    return fabs(to_turn(m, l)) < NONE * T ? T : 0;
}

/* The same of a crossing to NEXT. */
static double mend_crossing(const struct torus_pieces *m, int l, double T, double end,
                            const struct hold *next)
{
    const struct hold *now = &m->hold[l];
    double v, d, gain = now->gain - next->gain, off;

    go_to(m, T);
    d = sees(m, l, m->to, &v);
    off = now->level - next->level + gain * d;
    return gain * v != 0 ? fmin(fmax(T - off / (gain * v), 0.5 * T), fmin(2 * T, end)) : T;
}

/* What all laws are at m->to, a monotone path from where they are: into m->ahead; *CHANGED: some
 * have another regime.  False: one fails. */
static bool ask_all(struct torus_pieces *m, bool *changed)
{
    bool fine = true;

    *changed = false;
    m->asked++;
    for (int l = 0; l < m->laws; l++) {
        double v, d = sees(m, l, m->to, &v);

        fine = fine && ask(m, l, d, v, &m->hold[l], &m->ahead[l]);
        *changed |= m->ahead[l].regime != m->hold[l].regime;
    }
    return fine;
}

/* It is where m->to is, after T; of 0: the disturbances are there. */
static void arrive(struct torus_pieces *m, double T)
{
    double *u = m->u;

    if (T > 0)
        series(m, m->now, T, m->columns, m->u + m->D, m->to + m->D);
    m->u = m->to, m->to = u;
    for (int l = 0; l < m->laws; l++)
        m->hold[l].d = m->ahead[l].d, m->hold[l].z = m->ahead[l].z;
}

/* From m->u to the first event within T, m->to being after T and m->ahead the laws there; *DONE:
 * how far.  Of several laws that change before T the first does; the others are asked again. */
static bool to_event(struct torus_pieces *m, double T, double *done)
{
    double first = 2;
    int law = 0;
    struct hold next;

    for (int l = 0; l < m->laws; l++)
        if (m->ahead[l].regime != m->hold[l].regime) {
            double s = crossing(m, l, T, &m->ahead[l]);

            if (s < first)
                first = s, law = l;
        }
    next = m->ahead[law];
    *done = first > SAME ? mend_crossing(m, law, first * T, T, &next) : 0;
    if (*done > 0) {
        go_to(m, *done);
        for (int l = 0; l < m->laws; l++) {
            double v;

            m->ahead[l] = m->hold[l];
            m->ahead[l].d = sees(m, l, m->to, &v);
            if (m->hold[l].regime != 0 && m->s->p->law[l].memory > 0
                && !ask(m, l, m->ahead[l].d, v, &m->hold[l], &m->ahead[l]))
                return false;
        }
        arrive(m, *done);
    }
    change(m, law, &next);
    return find_regime(m);
}

/* A substep in pieces, each to its first turn, first event or end; false: it cannot be followed.
 * The whole rest of the step is the first trial of each. */
static bool step_cut(struct torus_pieces *m)
{
    double left = m->h, reach = left;

    for (int cuts = 0; cuts < CUTS_MOST; cuts++) {
        double T = reach, whole = left, s, gone;
        bool changed;
        int law;

        go_to(m, reach);
        s = first_turn(m, reach, &law);
        if (law >= 0)
            T = mend_turn(m, law, s * reach, reach);
        if (T == 0 && reach > SHORT * m->h) {      /* of shorter ones the cubic knows more */
            reach /= 2;
            continue;
        }
        if (T == 0)
            go_to(m, T = reach);
        if (!ask_all(m, &changed))
            return false;
        if (changed) {
            if (!to_event(m, T, &gone))
                return false;
            left -= gone;
        } else {
            arrive(m, T);
            left -= T;
        }
        reach = reach < whole ? fmin(left, 2 * reach) : left;
        m->work += 40.0 * m->n * m->D * (2 + m->columns);
        if (left <= SAME * m->h)
            return true;
    }
    return false;
}

/* A substep: whole where nothing happens in it.  Most have no event and no turn, and are one
 * product with the map and a look at each law. */
static bool step(struct torus_pieces *m)
{
    bool changed;
    int law;

    step_whole(m, m->u, m->to);
    m->work += 2.0 * m->n * m->D * (1 + m->columns) + 20 * (1 + m->laws);
    if (first_turn(m, m->h, &law) < 1)
        return step_cut(m);
    if (!ask_all(m, &changed))
        return false;
    if (changed)
        return step_cut(m);
    arrive(m, 0);
    return true;
}

/* The waves at time T, of U's first column: afresh each turn, so that no rounding gathers in their
 * products. */
static void set_waves(struct torus_pieces *m, double t)
{
    double *u = m->u + 2 * m->n + m->laws;

    for (int w = 0; w < m->waves; w++) {
        double phase = fmod(m->omega[w] * t, 2 * M_PI);

        u[2 * w] = cos(phase), u[2 * w + 1] = sin(phase);
    }
}

/* The disturbances made orthogonal, by Gram and Schmidt: of x and v, v over the leading tone's
 * frequency, so that both weigh alike; their levels go along.  GROWN: log of what each grew by
 * since the last time. */
static void orthogonal(struct torus_pieces *m, double *grown)
{
    int n = 2 * m->n, D = m->D;
    double lead = m->s->tones.omega[m->s->tones.lead];

    for (int c = 1; c <= m->columns; c++) {
        double *u = m->u + c * D, size = 0;

        for (int b = 1; b < c; b++) {
            const double *w = m->u + b * D;
            double dot = 0;

            for (int i = 0; i < n; i++)
                dot += u[i] * w[i] / (i < m->n ? 1 : lead * lead);
            for (int i = 0; i < n + m->laws; i++)
                u[i] -= dot * w[i];
        }
        for (int i = 0; i < n; i++)
            size += u[i] * u[i] / (i < m->n ? 1 : lead * lead);
        size = sqrt(size);
        for (int i = 0; i < n + m->laws; i++)
            u[i] /= size > 0 ? size : 1;
        if (grown != NULL)
            grown[c - 1] = log(fmax(size, 1e-300));
    }
}

enum modal_status torus_pieces_go(struct torus_pieces *m, int turns, int count, const int *dofs,
                                  double *x, double *growth, bool *followed,
                                  struct modal_error *err)
{
    double turn = 2 * M_PI / m->s->tones.omega[m->s->tones.lead];

    m->work = 0;
    for (int t = 0; t < turns && *followed; t++) {
        if (m->s->opt->cancelled != NULL && m->s->opt->cancelled(m->s->opt->context))
            return modal_fail(err, MODAL_CANCELLED, "cancelled");
        set_waves(m, (double)m->turns * turn);
        for (int n = 0; n < m->N; n++) {
            for (int i = 0; i < count; i++)
                *x++ = m->u[dofs[i]];
            for (int k = 0; k < m->substeps && *followed; k++)
                *followed = step(m);
        }
        for (int i = 0; i < 2 * m->n; i++)
            *followed = *followed && isfinite(m->u[i]);
        if (m->columns > 0 && *followed)
            orthogonal(m, growth != NULL ? growth + (size_t)t * (size_t)m->columns : NULL);
        m->turns++;
    }
    budget_add(m->s->work, m->work);
    m->work /= turns;
    return MODAL_OK;
}

long torus_pieces_turns(const struct torus_pieces *m) { return m->turns; }
double torus_pieces_work(const struct torus_pieces *m) { return m->work; }
bool torus_pieces_acted(const struct torus_pieces *m, int l) { return m->acted[l]; }
long torus_pieces_asked(const struct torus_pieces *m) { return m->asked; }
void torus_pieces_alone(struct torus_pieces *m) { m->columns = 0; }
void torus_pieces_forget(struct torus_pieces *m) { memset(m->acted, 0, sizeof m->acted); }

/* Whether the scene is one of these: every law of one input, with lines between its events
 * (law.h's pieces) and a place at most; where a gap has dissipation, ask() finds out. */
static bool serves(const struct torus_solver *s)
{
    bool fine = s->p->n <= DOFS_MOST && s->p->laws <= LAWS_MOST && s->p->n_linear == 0
        && s->tone.index < 0;

    for (int l = 0; l < s->p->laws; l++)
        fine = fine && s->p->law[l].kind->pieces != NULL && s->p->law[l].kind->inputs == 1
            && s->p->law[l].memory <= 1;
    return fine;
}

/* M^-1, M^-1 K, M^-1 C by rows; false: masses are missing, and a dof follows the others at once,
 * which (1) has no place for. */
static bool set_matrices(struct torus_pieces *m)
{
    int n = m->n, pivot[DOFS_MOST];
    double dense[3][DOFS_MOST * DOFS_MOST] = { { 0 } };
    const int which[] = { PROGRAM_M, PROGRAM_K, PROGRAM_C };

    for (int a = 0; a < 3; a++) {
        struct matrix to = { n, n, n, dense[a] };

        sparse_add_to_dense(&m->s->p->constant[which[a]], 1, &to);
    }
    if (LAPACKE_dgetrf_work(LAPACK_COL_MAJOR, n, n, dense[0], n, pivot) != 0)
        return false;
    for (int i = 0; i < n; i++)
        m->M[i * n + i] = 1;               /* by columns until here is done */
    LAPACKE_dgetrs_work(LAPACK_COL_MAJOR, 'N', n, n, dense[0], n, pivot, m->M, n);
    for (int a = 1; a < 3; a++) {
        LAPACKE_dgetrs_work(LAPACK_COL_MAJOR, 'N', n, n, dense[0], n, pivot, dense[a], n);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                m->M[(a * n + i) * n + j] = dense[a][j * n + i];
    }
    return true;
}

/* m->push and m->load, of M^-1, still by columns. */
static void set_forces(struct torus_pieces *m)
{
    const struct torus_solver *s = m->s;
    int n = m->n;

    for (int l = 0; l < m->laws; l++)
        for (int e = 0; e < law_ends(&s->p->law[l]); e++) {
            const struct law_end *end = &s->p->law[l].end[e];

            m->see[l * n + end->dof] += end->weight;
            for (int i = 0; i < n; i++)
                m->push[l * n + i] += end->weight * m->M[end->dof * n + i];
        }
    for (int a = 0; a < s->p->loads; a++) {
        const struct program_load *load = &s->p->load[a];
        struct torus_index k = { { load->tone[0], load->tone[1], load->tone[2] } };
        bool flipped;
        int w;

        k = torus_signed(&s->tones, k, &flipped);
        w = torus_group(s, k) - 1;
        m->omega[w] = torus_frequency(&s->tones, k);
        for (int i = 0; i < n; i++) {
            m->load[2 * w * n + i] += load->cosine * m->M[load->dof * n + i];
            m->load[(2 * w + 1) * n + i] +=
                (flipped ? -1 : 1) * load->sine * m->M[load->dof * n + i];
        }
    }
}

/* The scene's start, and the laws there. */
static bool set_out(struct torus_pieces *m)
{
    memcpy(m->u, m->s->p->x0, (size_t)m->n * sizeof *m->u);
    memcpy(m->u + m->n, m->s->p->v0, (size_t)m->n * sizeof *m->u);
    for (int c = 1; c <= m->columns; c++)          /* of no special direction */
        for (int i = 0; i < 2 * m->n; i++)
            m->u[c * m->D + i] = cos(1 + i * c + 2 * c);
    orthogonal(m, NULL);
    for (int l = 0; l < m->laws; l++) {
        double v, d = sees(m, l, m->u, &v);
        struct hold from = { .d = d };

        if (!ask(m, l, d, v, &from, &m->hold[l]))
            return false;
        m->u[2 * m->n + l] = m->hold[l].level;
    }
    return find_regime(m);
}

/* The scene's start, in as many substeps of a sample as the laws' first regimes need.  A stiffer
 * regime met later ends the march, and leaves the scene to other ways. */
static bool begin(struct torus_pieces *m)
{
    double dt = 2 * M_PI / m->s->tones.omega[m->s->tones.lead] / m->N;

    for (m->substeps = 1; m->substeps <= SUBSTEPS_MOST; m->substeps *= 2) {
        m->h = dt / m->substeps;
        m->regimes = 0;
        for (int w = 0; w < m->waves; w++)
            m->turn[2 * w] = cos(m->omega[w] * m->h), m->turn[2 * w + 1] = sin(m->omega[w] * m->h);
        if (set_out(m))
            return true;
        if (!m->stiff)
            return false;
    }
    return false;
}

enum modal_status torus_pieces_new(struct torus_solver *s, int N, int columns,
                                   struct torus_pieces **out, struct modal_error *err)
{
    struct torus_pieces *m;
    size_t n = (size_t)s->p->n, L = (size_t)s->p->laws, W = (size_t)s->groups;

    *out = NULL;
    if (!serves(s))
        return MODAL_OK;
    m = calloc(1, sizeof *m);
    if (m == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a march");
    m->s = s, m->N = N, m->columns = columns, m->n = s->p->n, m->laws = s->p->laws;
    m->waves = s->groups, m->D = 2 * m->n + m->laws + 2 * m->waves;
    m->M = workspace_zeros(&m->space, 3 * n * n, sizeof *m->M);
    m->see = workspace_zeros(&m->space, 2 * L * n, sizeof *m->see);
    m->push = m->see + L * n;
    m->omega = workspace_zeros(&m->space, W, sizeof *m->omega);
    m->load = workspace_zeros(&m->space, 2 * W * n, sizeof *m->load);
    m->turn = workspace_zeros(&m->space, 2 * W, sizeof *m->turn);
    m->regime = workspace_zeros(&m->space, REGIMES_MOST, sizeof *m->regime);
    m->u = workspace_zeros(&m->space, places(m), sizeof *m->u);
    m->to = workspace_zeros(&m->space, places(m), sizeof *m->to);
    m->term = workspace_zeros(&m->space, 2 * (size_t)m->D, sizeof *m->term);
    if (m->space.failed) {
        torus_pieces_free(m);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a march");
    }
    if (set_matrices(m)) {
        set_forces(m);
        if (begin(m))
            *out = m;
    }
    if (*out == NULL)
        torus_pieces_free(m);
    return MODAL_OK;
}

void torus_pieces_free(struct torus_pieces *m)
{
    if (m == NULL)
        return;
    workspace_free(&m->space);
    free(m);
}
