/*
 * period_map.c - see period_map.h
 *
 * A period is cut at the parts' cuts and in between into equal steps.  With s = (t - t0) / h, x(s)
 * = sum_k X_k s^k and g(s) = sum_m G_m s^m, (1) of period_map.h is, power by power,
 *
 *     (k+2)(k+1)/h^2 M X_(k+2) = -K X_k - (k+1)/h C X_(k+1) - sum_e b_e sum_m G_m U_(k-m),      (2)
 *
 * U_k the coefficients of u_e.  The series converges everywhere; terms are added until two in turn
 * are below rounding of the state, all in the roots of energies.  A step is as long as the fastest
 * motion turns by STEP radians in: rounding grows by at most e^STEP, and a radian costs the fewest
 * products about there.
 */
#include "modal/scene/period_map.h"
#include <complex.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/sparse_lu.h"
#include "modal/linalg/workspace.h"
#include "modal/scene/dofwise.h"
#include "modal/scene/program.h"

static const double STEP = 4;        /* radians: e^4 loses less than two digits */
static const double SMALL = 1e-16;   /* of the state: a term below it is rounding */
enum {
    DEGREE_USUAL = 33,               /* 4^33 / 33! is 1e-17 */
    DEGREE_MOST = 80,                /* of a series: 4^80 / 80! is 1e-71, so a step was too long */
    HALVINGS_MOST = 12               /* of steps: the bound of frequencies is not that far off */
};

/* From a step on FUNCTION has these coefficients. */
struct change { int function, count; double *coefficient; };
struct step { double t, h; int first_change, changes, first_reset, resets; };

struct period_map {
    const struct program *p;             /* borrowed */
    int n, states, columns, functions;   /* columns: n + held */
    struct period_channel *channel;
    int channels;
    double ends;                         /* of all channels */
    struct period_reset *reset;
    struct change *change, *now;         /* now: of each function */
    int changes;
    size_t doubles;                      /* of all coefficients */
    struct step *step;
    int steps;
    int *start, *index;                  /* rows of K and C in one pattern */
    double *stiffness, *damping;         /* their entries in it */
    double *inverse_mass;                /* n, of a diagonal M; else NULL: */
    struct sparse_lu *factor;            /* of M */
    double *weight;                      /* states */
    double *X, *U, *force, *solved;      /* (2): by degree; by channel; n each */
    int degree;                          /* of the longest series so far */
    struct workspace space, series;      /* of the arrays; of what steps hold */
};

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "period map: out of memory");
}

bool period_map_serves(const struct program *p)
{
    return program_of_dofs(p);
}

void period_map_free(struct period_map *m)
{
    if (m == NULL)
        return;
    sparse_lu_free(m->factor);
    workspace_free(&m->series);
    workspace_free(&m->space);
    free(m);
}

int period_map_states(const struct period_map *m) { return m->states; }
int period_map_steps(const struct period_map *m) { return m->steps; }

double period_map_frequency(const struct period_map *m, const double complex *y)
{
    double place = 0, speed = 0;

    for (int i = 0; i < m->n; i++) {
        double a = cabs(y[i]) * m->weight[m->n + i] / m->weight[i], b = cabs(y[m->n + i]);
        place += a * a;
        speed += b * b;
    }
    return place > 0 ? sqrt(speed / place) : 0;
}

double period_map_work(const struct period_map *m)
{
    const struct sparse *K = &m->p->constant[PROGRAM_K], *C = &m->p->constant[PROGRAM_C];
    double products = (double)m->steps * m->degree, sums = (double)m->doubles * m->degree / 2;
    double row = (K->m > 0 ? K->start[m->n] : 0) + (C->m > 0 ? C->start[m->n] : 0) + 4.0 * m->n;

    /* sums run through memory in order, as fast as dense ones */
    return products * (row + m->channels + m->ends
                       + (m->factor != NULL ? sparse_lu_work(m->factor) / m->n : 0))
           + sums / 4;
}

/* M by its inverse diagonal, or its factors. */
static enum modal_status take_mass(struct period_map *m, struct modal_error *err)
{
    const struct sparse *M = &m->p->constant[PROGRAM_M];
    bool diagonal = M->m == m->n && M->start[m->n] == m->n;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; diagonal && i < m->n; i++)
        diagonal = M->index[i] == i;
    if (!diagonal) {                     /* symmetric: its rows are its columns */
        rc = sparse_lu_new(m->n, M->start, M->index, false, &m->factor, err);
        if (rc == MODAL_OK && !sparse_lu_factor(m->factor, M->value))
            rc = modal_fail_field(err, MODAL_BAD_INPUT, "structure.M",
                                  "the mass matrix is singular to rounding");
        return rc;
    }
    m->inverse_mass = workspace_zeros(&m->space, (size_t)m->n, sizeof *m->inverse_mass);
    for (int i = 0; m->inverse_mass != NULL && i < m->n; i++)
        m->inverse_mass[i] = 1 / M->value[i];
    return workspace_check(&m->space, "period map: out of memory", err);
}

/* K's and C's rows, ascending, in one pattern: a pass over memory in place of two. */
static enum modal_status join_rows(struct period_map *m, struct modal_error *err)
{
    const struct sparse *K = &m->p->constant[PROGRAM_K], *C = &m->p->constant[PROGRAM_C];
    size_t n = (size_t)m->n,
           room = (size_t)(K->m > 0 ? K->start[n] : 0) + (size_t)(C->m > 0 ? C->start[n] : 0);
    int at = 0;

    m->start = workspace_zeros(&m->space, n + 1, sizeof *m->start);
    m->index = workspace_zeros(&m->space, room, sizeof *m->index);
    m->stiffness = workspace_zeros(&m->space, room, sizeof *m->stiffness);
    m->damping = workspace_zeros(&m->space, room, sizeof *m->damping);
    for (int i = 0; !m->space.failed && i < m->n; i++) {
        int k = K->m > 0 ? K->start[i] : 0, k_end = K->m > 0 ? K->start[i + 1] : 0,
            c = C->m > 0 ? C->start[i] : 0, c_end = C->m > 0 ? C->start[i + 1] : 0;
        for (; k < k_end || c < c_end; at++) {
            int of_k = k < k_end ? K->index[k] : INT_MAX, of_c = c < c_end ? C->index[c] : INT_MAX;
            m->index[at] = of_k < of_c ? of_k : of_c;
            m->stiffness[at] = of_k <= of_c ? K->value[k++] : 0;
            m->damping[at] = of_c <= of_k ? C->value[c++] : 0;
        }
        m->start[i + 1] = at;
    }
    return workspace_check(&m->space, "period map: out of memory", err);
}

/* How many entries the program's own harmonics have. */
static int own_entries(const struct program *p)
{
    int count = 0;

    for (int h = 0; h < p->harmonics; h++)
        for (int part = PROGRAM_C; part <= PROGRAM_K; part++) {
            const struct sparse *c = &p->harmonic[h].cosine[part], *s = &p->harmonic[h].sine[part];
            count += (c->m > 0 ? c->start[c->m] : 0) + (s->m > 0 ? s->start[s->m] : 0);
        }
    return count;
}

/* All entries of A, times FUNCTION. */
static void add_matrix(struct period_map *m, const struct sparse *a, bool rate, int function,
                       struct law_end **end)
{
    for (int i = 0; i < a->m; i++)
        for (int k = a->start[i]; k < a->start[i + 1]; k++, *end += 2) {
            (*end)[0] = (struct law_end){ a->index[k], 1 };
            (*end)[1] = (struct law_end){ i, a->value[k] };
            m->channel[m->channels++] =
                (struct period_channel){ *end, *end + 1, 1, 1, rate, function };
        }
}

/* The parts' channels and the program's, whose functions come after: cosine and sine of each
 * harmonic in turn. */
static enum modal_status take_channels(struct period_map *m, const struct period_parts *parts,
                                       struct modal_error *err)
{
    int given = parts != NULL ? parts->channels : 0, first = parts != NULL ? parts->functions : 0;
    size_t own = (size_t)own_entries(m->p), room = (size_t)given + own;
    struct law_end *end = workspace_zeros(&m->space, 2 * own, sizeof *end);

    m->functions = first + 2 * m->p->harmonics;
    m->channel = workspace_zeros(&m->space, room, sizeof *m->channel);
    m->now = workspace_zeros(&m->space, (size_t)m->functions, sizeof *m->now);
    if (m->space.failed)
        return no_memory(err);
    for (int i = 0; i < given; i++)
        m->channel[m->channels++] = parts->channel[i];
    for (int h = 0; h < m->p->harmonics; h++)
        for (int part = PROGRAM_C; part <= PROGRAM_K; part++) {
            const struct program_harmonic *a = &m->p->harmonic[h];
            add_matrix(m, &a->cosine[part], part == PROGRAM_C, first + 2 * h, &end);
            add_matrix(m, &a->sine[part], part == PROGRAM_C, first + 2 * h + 1, &end);
        }
    for (int i = 0; i < m->channels; i++)
        m->ends += m->channel[i].ins + m->channel[i].outs;
    return MODAL_OK;
}

/* Coefficients of a harmonic's cosine (sine: a quarter turn later) from T on. */
static int turn_taylor(double rate, double t, double h, bool sine, double *out)
{
    double factor = 1, angle = rate * t - (sine ? M_PI_2 : 0), turn = rate * h;
    int count = 0;

    for (int k = 0; k < DEGREE_MOST; k++) {
        out[k] = factor * cos(angle + k * M_PI_2);   /* the k-th derivative, h^k / k! times */
        factor *= turn / (k + 1);
        count = fabs(factor) > SMALL || k < 1 ? k + 1 : count;
    }
    return count < DEGREE_MOST ? count + 1 : DEGREE_MOST;
}

/* The coefficients of FUNCTION over the step, among the changes where they are new. */
static enum modal_status take_function(struct period_map *m, const struct period_parts *parts,
                                       int function, struct step *step, struct modal_error *err)
{
    double room[DEGREE_MOST];
    int given = parts != NULL ? parts->functions : 0, k = function - given, count;
    struct change *last = &m->now[function], *c = &m->change[m->changes];

    count = k < 0 ? parts->taylor(parts->context, function, step->t, step->h, DEGREE_MOST, room)
                  : turn_taylor(m->p->omega * m->p->harmonic[k / 2].k, step->t, step->h,
                                k % 2 == 1, room);
    if (count == last->count && memcmp(room, last->coefficient, (size_t)count * sizeof *room) == 0)
        return MODAL_OK;
    m->doubles += (size_t)count;
    if (m->doubles > PERIOD_MAP_DOUBLES)
        return modal_fail(err, MODAL_TOO_LARGE, "the functions of a period take more than %d "
                          "numbers", PERIOD_MAP_DOUBLES);
    *c = (struct change){ function, count,
                          workspace_zeros(&m->series, (size_t)count, sizeof *room) };
    if (c->coefficient == NULL)
        return no_memory(err);
    memcpy(c->coefficient, room, (size_t)count * sizeof *room);
    *last = *c;
    step->changes++;
    m->changes++;
    return MODAL_OK;
}

/* Steps of a period in which RATE turns by STEP radians at most, none past a cut. */
static enum modal_status make_steps(struct period_map *m, const struct period_parts *parts,
                                    double period, double rate, struct modal_error *err)
{
    int cuts = parts != NULL && parts->cuts > 0 ? parts->cuts : 1, next = 0;
    double most = period * rate / STEP + cuts + 1;
    enum modal_status rc = MODAL_OK;

    workspace_free(&m->series);
    m->steps = m->changes = 0;
    m->doubles = 0;
    memset(m->now, 0, (size_t)m->functions * sizeof *m->now);
    if (most * (1.0 + m->functions) > PERIOD_MAP_DOUBLES)
        return modal_fail(err, MODAL_TOO_LARGE,
                          "a period takes %.3g steps of %d functions", most, m->functions);
    m->step = workspace_zeros(&m->series, (size_t)most, sizeof *m->step);
    m->change = workspace_zeros(&m->series, (size_t)(most * m->functions), sizeof *m->change);
    if (m->series.failed)
        return no_memory(err);
    for (int c = 0; rc == MODAL_OK && c < cuts; c++) {
        double a = cuts > 1 ? parts->cut[c] : 0,
               b = c + 1 < cuts ? parts->cut[c + 1] : period;
        int here = (int)fmax(ceil((b - a) * rate / STEP), 1), first = next;

        while (parts != NULL && next < parts->resets && parts->reset[next].cut == c)
            next++;
        for (int i = 0; rc == MODAL_OK && i < here && (b > a || next > first); i++) {
            struct step *s = &m->step[m->steps++];

            *s = (struct step){ a + (b - a) * i / here, (b - a) / here, m->changes, 0, first,
                                i == 0 ? next - first : 0 };
            for (int f = 0; rc == MODAL_OK && s->h > 0 && f < m->functions; f++)
                rc = take_function(m, parts, f, s, err);
        }
    }
    return rc;
}

/* What COUNT ends see of X. */
static double see(const struct law_end *end, int count, const double *x)
{
    double sum = 0;

    for (int i = 0; i < count; i++)
        sum += end[i].weight * x[end[i].dof];
    return sum;
}

/* Whether G, constant, makes nothing of power K of what is seen AT: it is 0 now, or what is held
 * has no such power. */
static bool adds_nothing(const struct period_map *m, const struct period_channel *at,
                         const struct change *g, int k)
{
    bool held = at->ins == 1 && at->in->dof >= m->n;

    return g->count == 1 && (g->coefficient[0] == 0 || (held && k > 0));
}

/* What (2)'s sum adds at power K. */
static void add_channels(struct period_map *m, int k, double h)
{
    for (int c = 0; c < m->channels; c++) {
        const struct period_channel *at = &m->channel[c];
        const struct change *g = &m->now[at->function];
        double *U = m->U + (size_t)c * (DEGREE_MOST + 1), sum = 0;
        int power = at->rate ? k + 1 : k;

        if (adds_nothing(m, at, g, k))
            continue;
        U[k] = see(at->in, at->ins, m->X + (size_t)power * (size_t)m->columns)
             * (at->rate ? power / h : 1);
        for (int i = 0; i <= k && i < g->count; i++)
            sum += g->coefficient[i] * U[k - i];
        for (int e = 0; sum != 0 && e < at->outs; e++)
            m->force[at->out[e].dof] += at->out[e].weight * sum;
    }
}

/* The square of term K in energies. */
static double term_size(const struct period_map *m, int k, double h)
{
    const double *X = m->X + (size_t)k * (size_t)m->columns;
    double place = 0, speed = 0;

    for (int i = 0; i < m->n; i++) {
        double a = m->weight[i] * X[i], b = m->weight[m->n + i] * X[i];
        place += a * a;
        speed += b * b;
    }
    return place + speed * (k / h) * (k / h);
}

/* (2)'s right side at power K, of what is joined, onto the force. */
static void add_rows(struct period_map *m, int k, double h)
{
    const double *x = m->X + (size_t)k * (size_t)m->columns, *v = x + m->columns;
    double rate = (k + 1) / h;

    for (int i = 0; i < m->n; i++) {
        double held = 0, damped = 0;
        for (int e = m->start[i]; e < m->start[i + 1]; e++) {
            held += m->stiffness[e] * x[m->index[e]];
            damped += m->damping[e] * v[m->index[e]];
        }
        m->force[i] += held + rate * damped;
    }
}

/* X_(K+2) by (2), added to X and V; its square in energies. */
static double add_term(struct period_map *m, int k, double h, double *x, double *v)
{
    double *next = m->X + (size_t)(k + 2) * (size_t)m->columns, *solved = m->force,
           scale = -h * h / ((k + 2.0) * (k + 1)), rate = (k + 2) / h, place = 0, speed = 0;

    if (m->factor != NULL)
        sparse_lu_solve(m->factor, m->force, solved = m->solved);
    for (int i = 0; i < m->n; i++) {
        double term = scale * solved[i] * (m->factor != NULL ? 1 : m->inverse_mass[i]),
               a = m->weight[i] * term, b = m->weight[m->n + i] * term;
        next[i] = term;
        x[i] += term;
        v[i] += rate * term;
        place += a * a;
        speed += b * b;
    }
    return place + speed * rate * rate;
}

/* X over step S: X_0, X_1 and what is held become the step's end.  False: no end of the series. */
static bool make_step(struct period_map *m, const struct step *s, double *x, double *v)
{
    size_t n = (size_t)m->n, columns = (size_t)m->columns;
    double h = s->h, largest, before = HUGE_VAL, size = HUGE_VAL;
    int k;

    for (size_t i = 0; i < n; i++) {
        m->X[i] = x[i];
        m->X[columns + i] = h * v[i];
        x[i] += h * v[i];
    }
    largest = term_size(m, 0, h) + term_size(m, 1, h);
    for (k = 0; k + 2 <= DEGREE_MOST && fmax(size, before) > SMALL * SMALL * largest; k++) {
        memset(m->force, 0, n * sizeof *m->force);
        add_channels(m, k, h);
        add_rows(m, k, h);
        before = size;
        size = add_term(m, k, h, x, v);
        largest = fmax(largest, size);
    }
    m->degree = k > m->degree ? k : m->degree;
    return fmax(size, before) <= SMALL * SMALL * largest;
}

enum modal_status period_map_carry(struct period_map *m, const double *x, double *y,
                                   struct modal_error *err)
{
    size_t n = (size_t)m->n;
    double *v = y + n, *held = m->X + n;         /* of X_0: later ones have none */

    for (size_t i = 0; i < (size_t)m->states; i++)
        y[i] = x[i] / m->weight[i];
    memcpy(held, y + 2 * n, ((size_t)m->states - 2 * n) * sizeof *held);
    for (int s = 0; s < m->steps; s++) {
        const struct step *step = &m->step[s];

        for (int c = 0; c < step->changes; c++)
            m->now[m->change[step->first_change + c].function] = m->change[step->first_change + c];
        for (int r = 0; r < step->resets; r++) {
            const struct period_reset *reset = &m->reset[step->first_reset + r];
            held[reset->held] = see(reset->end, reset->count, y);
        }
        if (step->h > 0 && !make_step(m, step, y, v))
            return modal_fail(err, isfinite(y[0] + v[0]) ? MODAL_NO_CONVERGENCE : MODAL_OVERFLOW,
                              "the series of a step of a period has no end");
    }
    memcpy(y + 2 * n, held, ((size_t)m->states - 2 * n) * sizeof *held);
    for (size_t i = 0; i < (size_t)m->states; i++) {
        y[i] *= m->weight[i];
        if (!isfinite(y[i]))
            return modal_fail(err, MODAL_OVERFLOW,
                              "the growth over one period leaves the range of doubles");
    }
    return MODAL_OK;
}

/* The weights of x and x', and of what is held the largest of the dofs it is set from. */
static void make_weights(struct period_map *m, const struct period_parts *parts, double period)
{
    double *held = m->weight + 2 * m->n;

    dofwise_weights(m->p, period, m->weight);
    for (int r = 0; parts != NULL && r < parts->resets; r++)
        for (int i = 0; i < parts->reset[r].count; i++)
            held[parts->reset[r].held] = fmax(held[parts->reset[r].held],
                                              m->weight[parts->reset[r].end[i].dof]);
    for (int i = 2 * m->n; i < m->states; i++)
        m->weight[i] = m->weight[i] > 0 ? m->weight[i] : 1;
}

/* Is carrying a vector within MOST, with what is still to be SPENT on its behalf? */
static enum modal_status check_work(const struct period_map *m, double rate, double spent,
                                    double most, struct modal_error *err)
{
    if (period_map_work(m) + spent <= most)
        return MODAL_OK;
    return modal_fail(err, MODAL_TOO_LARGE, "the fastest motion, of up to %.3g rad/s, takes %d "
                      "steps a period: more work than is spent", rate, m->steps);
}

/* Steps whose series end: tried on a vector, shorter ones where they do not. */
static enum modal_status choose_steps(struct period_map *m, const struct period_parts *parts,
                                      double period, double most, struct modal_error *err)
{
    double *trial = workspace_zeros(&m->space, (size_t)m->states, sizeof *trial), frequency, decay,
           rate, step_work = parts != NULL ? parts->step_work : 0;
    int cuts = parts != NULL ? parts->cuts : 0;
    enum modal_status rc = workspace_check(&m->space, "period map: out of memory", err);

    dofwise_fastest(m->p, &frequency, &decay);
    rate = frequency + decay + (parts != NULL ? parts->fastest : 0);
    for (int i = 0; i < HALVINGS_MOST && rc == MODAL_OK; i++, rate *= 2) {
        m->steps = (int)fmin(period * rate / STEP + 1, INT_MAX);
        m->degree = DEGREE_USUAL;
        m->doubles = 0;                  /* before any is made, */
        rc = check_work(m, rate, ((double)m->steps + cuts) * step_work, most, err);
        if (rc == MODAL_OK)
            rc = make_steps(m, parts, period, rate, err);
        if (rc == MODAL_OK)              /* and as they are */
            rc = check_work(m, rate, 0, most, err);
        m->degree = 0;
        for (int k = 0; rc == MODAL_OK && k < m->states; k++)
            trial[k] = k % 2 == 0 ? 1 : -1;      /* moves fast and slow */
        if (rc == MODAL_OK)
            rc = period_map_carry(m, trial, trial, err);
        if (rc != MODAL_NO_CONVERGENCE)
            return rc;
        rc = i + 1 < HALVINGS_MOST ? MODAL_OK : rc;
    }
    return rc;
}

enum modal_status period_map_new(const struct program *p, const struct period_parts *parts,
                                 double period, double most, struct period_map **out,
                                 struct modal_error *err)
{
    struct period_map *m = calloc(1, sizeof *m);
    int held = parts != NULL ? parts->held : 0;
    enum modal_status rc;

    if (m == NULL)
        return no_memory(err);
    m->p = p;
    m->n = p->n;
    m->columns = p->n + held;
    m->states = 2 * p->n + held;
    rc = take_mass(m, err);
    if (rc == MODAL_OK)
        rc = join_rows(m, err);
    if (rc == MODAL_OK)
        rc = take_channels(m, parts, err);
    if (rc == MODAL_OK) {
        size_t n = (size_t)m->n, resets = parts != NULL ? (size_t)parts->resets : 0;

        m->weight = workspace_zeros(&m->space, (size_t)m->states, sizeof *m->weight);
        m->X = workspace_zeros(&m->space, (DEGREE_MOST + 3) * (size_t)m->columns, sizeof *m->X);
        m->U = workspace_zeros(&m->space, (DEGREE_MOST + 1) * (size_t)m->channels, sizeof *m->U);
        m->force = workspace_zeros(&m->space, n, sizeof *m->force);
        m->solved = workspace_zeros(&m->space, n, sizeof *m->solved);
        m->reset = workspace_zeros(&m->space, resets, sizeof *m->reset);
        rc = workspace_check(&m->space, "period map: out of memory", err);
        if (rc == MODAL_OK && resets > 0)
            memcpy(m->reset, parts->reset, resets * sizeof *m->reset);
    }
    if (rc == MODAL_OK) {
        make_weights(m, parts, period);
        rc = choose_steps(m, parts, period, most, err);
    }
    if (rc != MODAL_OK) {
        period_map_free(m);
        return rc;
    }
    *out = m;
    return MODAL_OK;
}
