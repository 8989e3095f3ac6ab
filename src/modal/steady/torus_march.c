/*
 * torus_march.c - a motion of tones marched, and its lines read from the record; tested by
 * tests/unit/modal/steady/test_torus.c
 *
 * The spectrum of a kink ends slowly, and a balance needs samples of all phases for each of its
 * combinations; in time the same motion is a few states.  From where a balance has it the program's
 * own is marched, N samples a turn of the leading tone, t = 2 pi (r + m / N) / w_lead.  Under a
 * window W, sum W = 1, its line at combination k is
 *
 *     X_k = 2 sum_m e^{-2 pi i k_lead m / N} sum_r W x e^{-2 pi i s (r + m / N)},               (1)
 *     s = sum_j k_j nu_j of the other tones j,
 *
 * the mean half of that: one pass over the record for each s gives all k_lead at once.  W is
 * exp(pi B (sqrt(1 - u^2) - 1)), -1 < u < 1 over the record: of another line B or more turns of the
 * record away (1) has e^{-pi B} at most, and the same of what is left of the record when the lines
 * are taken out has the rest.  Lines nearer than that are one, that of the lower order.
 *
 * What no line explains is seen, over the whole record, of whose ends the window takes little; what
 * folds at N is told by the last lines below N / 2, and the march's own error by twice as many
 * samples.
 */
#include "modal/steady/torus_state.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/scene.h"
#include "modal/scene/simulate.h"
#include "modal/steady/condense.h"
#include "modal/steady/torus_laws.h"

enum {
    SAMPLES = 64,              /* of a turn, at first: x of a kink folds some 64^-4 */
    SAMPLES_MOST = 256,        /* doubled twice: of stiff contacts */
    TURNS = 256,               /* of a record, at first: tones one in 32 apart are told */
    TURNS_MOST = 4096,         /* tones one in 512 apart are told: past it a budget ends it */
    LONGER = 4,                /* the next: all before cost a third of it */
    SETTLING = 4,              /* a record's turns over those that go before it */
    CHECKED = 32,              /* turns that are marched once more */
    BINS = 8,                  /* B: e^{-8 pi} is 1e-11 */
    AFRESH = 32,               /* products of a wave: their rounding is some 1e-15 */
    OTHERS_MOST = 160,         /* |k_j| of one tone beside the leading one: slow envelopes of close
                                * tones have as many lines */
    OTHERS_OF_TWO_MOST = 12,   /* of two */
    NUMBERS_MOST = 20000000,   /* of a record: 160 MB */
    ORDERS_MOST = 1024,        /* beyond all of the sheet: SAMPLES_MOST and OTHERS_MOST twice */
};
static const double TOLERANCE = 1e-9;     /* of a step, relative: below what lines are told to;
                                           * what it comes to is measured (check_steps) */
static const double SPLIT = 0.2;          /* of the steps have an event, and are two */
static const double WAVE = 20;            /* budget.h: of a sample and an s, five passes */
static const double FEW = 1e-3;           /* of a motion that is not the one balanced: where its
                                           * lines leave more of it, it is none of these tones */
static const double LEFT = 0.3;           /* of the error asked for, as in torus_solve.c */
static const double LAST = 0.125;         /* of the lines below N / 2, as in torus_error.c */
static const double SAME = 1e-6;          /* turns of the record between lines that coincide: a
                                           * million records would not tell them */
static const double HALVED = 0.5;         /* of what a shorter record left: a longer one that leaves
                                           * more has what no line explains */
static const double AGREE = 3;            /* errors of a balance that its motion may be off */

/* A record and what its lines are told by.  Its outputs are the dofs that iterate, then those
 * reported that do not. */
struct march {
    struct torus_solver *s;
    struct workspace space;
    int N, turns, outputs, *dofs;
    bool *reported;                       /* of each output */
    double *x0, *v0;                      /* by dof: where the march begins */
    int others[TORUS_TONES_MOST - 1];     /* the tones but the lead; -1: none */
    int highest, rows;                    /* most of |k_j|; sets of them, told once each: an s of
                                           * (1) a row */
    double start;                         /* s: of its first sample, whole turns */
    double *x, *left, *window;            /* [sample][output]; what no line explains; W */
    int count;
    struct torus_index *index;            /* lines told, the mean first, by rising order */
    double complex *X;                    /* [output count + m] */
    double nearest[ORDERS_MOST];          /* of each order's combinations that have no line: to one
                                           * that has, in turns of the record; B: all have */
};

/* A line of the sheet of (1): its combination with the sign of torus.h's (1), size and place. */
struct line { struct torus_index k; double size; int row, lead; bool flipped; };

bool torus_march_takes(const struct torus_solver *s, bool balanced)
{
    bool takes = s->tone.index < 0 && s->opt->order == 0 && s->q > 0
        && !(balanced && torus_smooth(s->laws));

    for (int l = 0; l < s->p->laws; l++)
        takes = takes && !torus_undetermined(s->laws, l);
    return takes;
}

/* Row ROW's numbers of the other tones, into K; row 0: none. */
static void row_of(const struct march *a, int row, struct torus_index *k)
{
    int wide = 2 * a->highest + 1;

    *k = (struct torus_index) { { 0 } };
    if (a->others[1] < 0) {
        k->k[a->others[0]] = row;
        return;
    }
    row += a->highest;                    /* (0, 0 ..), then (1, -highest ..) */
    k->k[a->others[0]] = row % wide - a->highest;
    k->k[a->others[1]] = row / wide;
}

/* Omega_k over that of the leading tone: of a turn's lines, N / 2 are below what folds. */
static double turns_of(const struct march *a, struct torus_index k)
{
    return torus_frequency(&a->s->tones, k) / a->s->tones.omega[a->s->tones.lead];
}

/* wave = e^{sign 2 pi i s (r + m / N)} at sample N of the record. */
static double complex wave_at(const struct march *a, double s, int sign, long sample)
{
    double turns = s * (a->start / (2 * M_PI / a->s->tones.omega[a->s->tones.lead])
                        + (double)sample / a->N);

    return cexp(sign * 2 * M_PI * I * fmod(turns, 1));
}

/* The sums over r of (1) of output I of SIGNAL, row ROW: into SUM, N. */
static void gather(const struct march *a, const double *signal, int i, int row,
                   double complex *sum)
{
    struct torus_index k;
    double s;
    double complex wave = 1, advance;
    long samples = (long)a->N * a->turns;

    row_of(a, row, &k);
    s = turns_of(a, k);
    advance = cexp(-2 * M_PI * I * s / a->N);
    memset(sum, 0, (size_t)a->N * sizeof *sum);
    for (long n = 0; n < samples; n++) {
        double y = a->window[n] * signal[n * a->outputs + i];

        wave = n % AFRESH == 0 ? wave_at(a, s, -1, n) : wave * advance;
        sum[n % a->N] += CMPLX(y * creal(wave), y * cimag(wave));
    }
}

/* (1) of k_lead from SUM; e^{2 pi i m / N} is TURN. */
static double complex line_at(const struct march *a, const double complex *sum, int lead,
                              const double complex *turn)
{
    double complex X = 0;

    /* N products for each line, of some hundreds a row: little beside the record's own */
    for (int m = 0; m < a->N; m++)
        X += sum[m] * conj(turn[(((long)lead * m) % a->N + a->N) % a->N]);
    return X;
}

/* SIGNAL less the lines X, whose places are LIST, by row. */
static void take_out(const struct march *a, double *signal, const struct line *list,
                     const double complex *X, double complex *sum, const double complex *turn)
{
    long samples = (long)a->N * a->turns;

    for (int first = 0, next; first < a->count; first = next) {
        struct torus_index k;
        double s;

        row_of(a, list[first].row, &k);
        s = turns_of(a, k);
        for (next = first; next < a->count && list[next].row == list[first].row; next++)
            ;
        for (int i = 0; i < a->outputs; i++) {
            double complex wave = 1, advance = cexp(2 * M_PI * I * s / a->N);

            memset(sum, 0, (size_t)a->N * sizeof *sum);
            for (int l = first; l < next; l++) {
                double complex Z = X[(size_t)i * (size_t)a->count + (size_t)l];

                for (int m = 0; m < a->N; m++)
                    sum[m] += Z * turn[(((long)list[l].lead * m) % a->N + a->N) % a->N];
            }
            for (long n = 0; n < samples; n++) {
                wave = n % AFRESH == 0 ? wave_at(a, s, 1, n) : wave * advance;
                signal[n * a->outputs + i] -= creal(sum[n % a->N]) * creal(wave)
                    - cimag(sum[n % a->N]) * cimag(wave);
            }
        }
    }
}

/* By falling size: what is left out last is least. */
static int by_size(const void *a, const void *b)
{
    double x = ((const struct line *)a)->size, y = ((const struct line *)b)->size;

    return (x < y) - (x > y);
}

static int by_order(const void *a, const void *b)
{
    int order = torus_order(((const struct line *)a)->k) - torus_order(((const struct line *)b)->k);

    return order != 0 ? order : by_size(a, b);
}

/* Of two lines that the record does not tell apart one is where the motion is, and larger; where
 * they coincide it is that of the lower order. */
static int by_claim(const void *a, const void *b)
{
    const struct line *x = a, *y = b;
    double p = x->size / (1 + torus_order(x->k)), q = y->size / (1 + torus_order(y->k));

    return p != q ? (p < q) - (p > q) : by_order(a, b);
}

/* Lines of a row share their waves. */
static int by_row(const void *a, const void *b)
{
    return ((const struct line *)a)->row - ((const struct line *)b)->row;
}

/* All lines below N / 2 of the record into LIST; SUM: N. */
static int sheet(const struct march *a, struct line *list, double complex *sum,
                 const double complex *turn)
{
    int count = 0;

    for (int row = 0; row < a->rows; row++) {
        int first = count;
        struct torus_index k;

        row_of(a, row, &k);
        for (int lead = row > 0 ? -a->N : 0; lead < a->N; lead++) {
            struct line l = { .row = row, .lead = lead };

            k.k[a->s->tones.lead] = lead;
            l.k = torus_signed(&a->s->tones, k, &l.flipped);
            if (2 * turns_of(a, l.k) < a->N)
                list[count++] = l;
        }
        for (int i = 0; i < a->outputs; i++) {
            gather(a, a->x, i, row, sum);
            for (int l = first; l < count; l++)
                list[l].size = fmax(list[l].size, 2 * cabs(line_at(a, sum, list[l].lead, turn)));
        }
    }
    return count;
}

/* Of claim(): two lines are never in one, for it is as wide as they are apart at least. */
static int cells_of(const struct march *a) { return a->N * a->turns / (2 * BINS) + 3; }

/* How far FREQUENCY, in turns, is from the nearest that is taken, one a cell of as many at most, in
 * turns of the record; from B on it is then among them. */
static double claim(const struct march *a, double frequency, double *taken)
{
    double least = (double)BINS / a->turns, nearest = BINS;
    int cell = 1 + (int)(frequency / least);

    for (int c = cell - 1; c <= cell + 1; c++)
        if (taken[c] >= 0)
            nearest = fmin(nearest, fabs(taken[c] - frequency) * a->turns);
    if (nearest >= BINS)
        taken[cell] = frequency;
    return nearest;
}

/* Of ALL lines those to keep at the front of LIST, by row: apart from each other, and so many that
 * the rest sum to less than LEAVE; the mean always. */
static int keep(struct march *a, struct line *list, int all, double leave, double *taken)
{
    int most = (TORUS_UNKNOWNS_MOST / a->s->q + 1) / 2, count = 0;
    double sum = 0;

    for (int c = 0; c < cells_of(a); c++)
        taken[c] = -1;
    for (int o = 0; o < ORDERS_MOST; o++)
        a->nearest[o] = BINS;
    for (int l = 0; l < all; l++)
        if (torus_order(list[l].k) == 0)
            list[l].size = HUGE_VAL;
    qsort(list, (size_t)all, sizeof *list, by_claim);
    for (int l = 0; l < all; l++) {
        int order = torus_order(list[l].k);
        double far = claim(a, turns_of(a, list[l].k), taken);

        if (far >= BINS)
            list[count++] = list[l];
        else if (far > SAME && order < ORDERS_MOST)
            a->nearest[order] = fmin(a->nearest[order], far);
    }
    qsort(list, (size_t)count, sizeof *list, by_size);
    while (count > 1 && sum + list[count - 1].size <= leave)
        sum += list[--count].size;
    count = count < most ? count : most;
    qsort(list, (size_t)count, sizeof *list, by_row);
    return count;
}

/*
 * What a line may hide of another that the record does not tell from it, in m.  F turns of the
 * record away they drift apart by pi F to its ends, and LEFT is the most that is seen there; and it
 * is no larger than the lines kept of its order and above.
 */
static double hidden(const struct march *a, const struct line *list, double left)
{
    double most = 0;

    for (int order = 0; order < ORDERS_MOST; order++) {
        double size = 0;

        if (a->nearest[order] >= BINS)
            continue;
        for (int l = 0; l < a->count; l++)
            size = torus_order(list[l].k) >= order && isfinite(list[l].size)
                       ? fmax(size, list[l].size) : size;
        most = fmax(most, fmin(2 * size, left / fmin(1, M_PI / 2 * a->nearest[order])));
    }
    return most;
}

/* X += the lines at LIST of what is left of the record, and they are taken out of it. */
static void read_lines(struct march *a, const struct line *list, double complex *more,
                       double complex *sum, const double complex *turn)
{
    size_t K = (size_t)a->count;

    for (int i = 0; i < a->outputs; i++)
        for (int l = 0; l < a->count; l++) {
            double complex X;

            if (l == 0 || list[l].row != list[l - 1].row)
                gather(a, a->left, i, list[l].row, sum);
            X = line_at(a, sum, list[l].lead, turn);
            more[(size_t)i * K + (size_t)l] =
                torus_order(list[l].k) == 0 ? creal(X) : 2 * X;
        }
    take_out(a, a->left, list, more, sum, turn);
    for (size_t j = 0; j < (size_t)a->outputs * K; j++)
        a->X[j] += more[j];
}

/* The largest of output I of SIGNAL, over all of the record: its ends too, where W has next to
 * nothing and lines told wrongly have drifted apart. */
static double largest(const struct march *a, const double *signal, int i)
{
    double most = 0;

    for (long n = 0; n < (long)a->N * a->turns; n++)
        most = fmax(most, fabs(signal[n * a->outputs + i]));
    return most;
}

/* What was read, by rising order and with torus.h's signs. */
static enum modal_status sort_lines(struct march *a, const struct line *list, double complex *room,
                                    struct modal_error *err)
{
    size_t K = (size_t)a->count;
    struct line *sorted = workspace_zeros(&a->space, K, sizeof *sorted);
    enum modal_status rc = workspace_check(&a->space, "torus: no memory for a record", err);

    if (rc != MODAL_OK)
        return rc;
    for (size_t l = 0; l < K; l++) {
        sorted[l] = list[l];
        sorted[l].row = (int)l;                    /* where its X is */
    }
    qsort(sorted, K, sizeof *sorted, by_order);
    memcpy(room, a->X, (size_t)a->outputs * K * sizeof *room);
    for (size_t l = 0; l < K; l++) {
        a->index[l] = sorted[l].k;
        for (size_t i = 0; i < (size_t)a->outputs; i++) {
            double complex X = room[i * K + (size_t)sorted[l].row];

            a->X[i * K + l] = sorted[l].flipped ? conj(X) : X;
        }
    }
    return MODAL_OK;
}

/* The lines of the record and their errors into *E, AMPLITUDE the motion's. */
static enum modal_status read_record(struct march *a, double wanted, struct torus_errors *e,
                                     double *amplitude, struct modal_error *err)
{
    size_t most = 2 * (size_t)a->rows * (size_t)a->N, numbers = (size_t)a->N * (size_t)a->turns;
    struct line *list = workspace_zeros(&a->space, most, sizeof *list);
    double *taken = workspace_zeros(&a->space, (size_t)cells_of(a), sizeof *taken);
    double complex *sum = workspace_zeros(&a->space, 2 * (size_t)a->N, sizeof *sum),
                   *turn = sum + a->N, *more;
    enum modal_status rc = workspace_check(&a->space, "torus: no memory for a record", err);

    if (rc != MODAL_OK)
        return rc;
    *amplitude = 0;
    for (int i = 0; i < a->outputs; i++)
        *amplitude = fmax(*amplitude, a->reported[i] ? largest(a, a->x, i) : 0);
    for (int m = 0; m < a->N; m++)
        turn[m] = cexp(2 * M_PI * I * m / a->N);
    a->count = keep(a, list, sheet(a, list, sum, turn), LEFT * wanted * *amplitude, taken);
    most = (size_t)a->outputs * (size_t)a->count;
    a->index = workspace_zeros(&a->space, (size_t)a->count, sizeof *a->index);
    a->X = workspace_zeros(&a->space, most, sizeof *a->X);
    more = workspace_zeros(&a->space, most, sizeof *more);
    rc = workspace_check(&a->space, "torus: no memory for a record", err);
    if (rc != MODAL_OK)
        return rc;
    memcpy(a->left, a->x, numbers * (size_t)a->outputs * sizeof *a->left);
    for (int pass = 0; pass < 2; pass++)
        read_lines(a, list, more, sum, turn);
    for (int i = 0; i < a->outputs; i++)
        e->truncation = fmax(e->truncation, a->reported[i] ? largest(a, a->left, i) : 0);
    e->change = e->truncation;
    e->truncation = fmax(e->truncation, hidden(a, list, e->truncation));
    for (int l = 0; l < a->count; l++)
        e->sampling += 2 * turns_of(a, list[l].k) > (1 - LAST) * a->N ? list[l].size : 0;
    budget_add(a->s->work, WAVE * (double)a->rows * (double)numbers * a->outputs);
    return sort_lines(a, list, more, err);
}

/* The program's motion from the start over the outputs, into SIGNALS. */
static enum modal_status record(struct march *a, struct scene_time *time, double *signals,
                                struct modal_error *err)
{
    const struct torus_solver *s = a->s;
    struct program view = *s->p;
    struct simulate_options how = { .tolerance = TOLERANCE, .cancelled = s->opt->cancelled,
                                    .context = s->opt->context };
    struct simulate_result done = { 0 };
    struct triplet *term = workspace_zeros(&a->space, (size_t)a->outputs, sizeof *term);
    enum modal_status rc;

    view.output = workspace_zeros(&a->space, (size_t)a->outputs, sizeof *view.output);
    rc = workspace_check(&a->space, "torus: no memory for a record", err);
    if (rc != MODAL_OK)
        return rc;
    view.outputs = a->outputs;
    view.x0 = a->x0, view.v0 = a->v0;
    view.omega = s->tones.omega[0];       /* what a load's k that is one number counts */
    for (int j = 0; j < s->tones.count; j++)
        view.tones[j] = s->tones.omega[j];
    for (int i = 0; i < a->outputs; i++) {
        term[i] = (struct triplet) { 0, a->dofs[i], 1 };
        view.output[i] = (struct program_output) { view.dofs[a->dofs[i]], &term[i], 1 };
    }
    how.steps_most = (int64_t)fmax((s->work->most - s->work->spent) / torus_step_work(s), 1);
    rc = simulate(&view, time, &how, signals, &done, err);
    budget_add(s->work, torus_step_work(s)
                            * (double)(rc == MODAL_OK ? done.steps : how.steps_most));
    return rc;
}

/* COUNT samples from time START, N a turn. */
static struct scene_time times_of(const struct march *a, int N, long count, double start)
{
    double dt = 2 * M_PI / a->s->tones.omega[a->s->tones.lead] / N;

    return (struct scene_time) { .dt = dt, .start = start, .samples = count,
                                 .duration = (double)(count - 1) * dt };
}

/* How far the first turns are off those on twice as many samples, into *MOST.  Steps are no longer
 * than samples are apart, so that the finer march has a small part of the other's error. */
static enum modal_status check_steps(struct march *a, double *most, struct modal_error *err)
{
    long count = (long)CHECKED * a->N;
    size_t wide = (size_t)a->outputs;
    double *coarse = workspace_zeros(&a->space, (size_t)count * wide, sizeof *coarse),
           *fine = workspace_zeros(&a->space, 2 * (size_t)count * wide, sizeof *fine);
    struct scene_time once = times_of(a, a->N, count, 0), twice = times_of(a, 2 * a->N,
                                                                           2 * count, 0);
    enum modal_status rc = workspace_check(&a->space, "torus: no memory for a record", err);

    if (rc == MODAL_OK)
        rc = record(a, &once, coarse, err);
    if (rc == MODAL_OK)
        rc = record(a, &twice, fine, err);
    for (size_t n = 0; rc == MODAL_OK && n < (size_t)count; n++)
        for (size_t i = 0; i < wide; i++)
            *most = fmax(*most, a->reported[i] ? fabs(coarse[n * wide + i] - fine[2 * n * wide + i])
                                               : 0);
    return rc;
}

/* The outputs, and where a march begins: where the balance has the motion, or where the scene
 * has. */
static enum modal_status set_out(struct march *a, bool balanced, struct modal_error *err)
{
    const struct torus_solver *s = a->s;
    const int *place = condense_place(s->condense[0]);
    size_t n = (size_t)s->p->n, K = (size_t)s->count;
    double complex *X;
    enum modal_status rc;

    a->dofs = workspace_zeros(&a->space, n, sizeof *a->dofs);
    a->reported = workspace_zeros(&a->space, n, sizeof *a->reported);
    a->x0 = workspace_zeros(&a->space, n, sizeof *a->x0);
    a->v0 = workspace_zeros(&a->space, n, sizeof *a->v0);
    X = workspace_zeros(&a->space, n * K, sizeof *X);
    if ((rc = workspace_check(&a->space, "torus: no memory for a record", err)) != MODAL_OK)
        return rc;
    memcpy(a->dofs, condense_dofs(s->condense[0]), (size_t)s->q * sizeof *a->dofs);
    a->outputs = s->q;
    for (int i = 0; i < s->opt->dofs_count; i++) {
        int dof = s->opt->dofs[i], at = place[dof] >= 0 ? place[dof] : a->outputs++;

        a->dofs[at] = dof;
        a->reported[at] = true;
    }
    memcpy(a->x0, s->p->x0, n * sizeof *a->x0);
    memcpy(a->v0, s->p->v0, n * sizeof *a->v0);
    if (balanced)
        rc = torus_recover(a->s, a->outputs, a->dofs, X, err);
    for (int i = 0; rc == MODAL_OK && balanced && i < a->outputs; i++) {
        a->x0[a->dofs[i]] = a->v0[a->dofs[i]] = 0;
        for (size_t m = 0; m < K; m++) {
            a->x0[a->dofs[i]] += creal(X[(size_t)i * K + m]);
            a->v0[a->dofs[i]] -= torus_frequency(&s->tones, s->index[m])
                * cimag(X[(size_t)i * K + m]);
        }
    }
    return rc;
}

/* A's numbers for N samples of each of TURNS turns; false: more than the work left, or than a
 * record may hold.  The march is priced with its settling, its check and what events cut in
 * pieces. */
static bool size_record(struct march *a, int N, int turns)
{
    const struct torus_tones *t = &a->s->tones;
    int r = 0, most = t->count > 2 ? OTHERS_OF_TWO_MOST : OTHERS_MOST, wide;
    double samples = (double)N * turns, all = (1 + 1.0 / SETTLING) * samples, work;

    a->N = N, a->turns = turns;
    a->others[0] = a->others[1] = -1;
    for (int j = 0; j < t->count; j++)
        if (j != t->lead)
            a->others[r++] = j;
    a->highest = turns / BINS < most ? turns / BINS : most;
    wide = 2 * a->highest + 1;
    a->rows = t->count > 2 ? (wide * wide + 1) / 2 : a->highest + 1;
    a->start = turns / SETTLING * 2 * M_PI / t->omega[t->lead];
    work = (all + 3.0 * CHECKED * N) * (1 + SPLIT) * torus_step_work(a->s)
        + WAVE * a->rows * samples * a->outputs;
    return samples * a->outputs <= NUMBERS_MOST && a->s->work->spent + work <= a->s->work->most;
}

/* W of the opening comment, u in the middle of each sample; and the room of a record. */
static enum modal_status make_window(struct march *a, struct modal_error *err)
{
    size_t samples = (size_t)a->N * (size_t)a->turns;
    double sum = 0;
    enum modal_status rc;

    a->x = workspace_zeros(&a->space, samples * (size_t)a->outputs, sizeof *a->x);
    a->left = workspace_zeros(&a->space, samples * (size_t)a->outputs, sizeof *a->left);
    a->window = workspace_zeros(&a->space, samples, sizeof *a->window);
    rc = workspace_check(&a->space, "torus: no memory for a record", err);
    for (size_t n = 0; rc == MODAL_OK && n < samples; n++) {
        double u = (2 * (double)n + 1) / (double)samples - 1;

        sum += a->window[n] = exp(M_PI * BINS * (sqrt(1 - u * u) - 1));
    }
    for (size_t n = 0; rc == MODAL_OK && n < samples; n++)
        a->window[n] /= sum;
    return rc;
}

/* What the balance has of dof I where the record has line L: of all combinations that it does not
 * tell from that. */
static double complex balanced_at(const struct march *a, int i, int l)
{
    const struct torus_solver *s = a->s;
    double at = turns_of(a, a->index[l]);
    double complex X = 0;

    for (int m = 0; m < s->count; m++)
        if (fabs(turns_of(a, s->index[m]) - at) < (double)BINS / a->turns)
            X += s->X[(size_t)i * (size_t)s->count + (size_t)m];
    return l == 0 ? creal(X) : X;
}

/* Whether the lines are those of the balance, within its ERROR and more. */
static bool agrees(const struct march *a, double error)
{
    for (int i = 0; i < a->s->q; i++)
        for (int l = 0; l < a->count; l++)
            if (cabs(a->X[(size_t)i * (size_t)a->count + (size_t)l] - balanced_at(a, i, l))
                > AGREE * error)
                return false;
    return true;
}

void torus_lines_done(struct torus_lines *lines)
{
    free(lines->index), free(lines->X);
    *lines = (struct torus_lines) { 0 };
}

void torus_adopt(struct torus_solver *s, struct torus_lines *lines, double wanted,
                 struct torus_point *out)
{
    for (int m = 0; s->linear != NULL && m < s->count; m++)
        torus_linear_done(&s->linear[m]);
    free(s->linear), free(s->index), free(s->X);
    s->linear = NULL;
    s->index = lines->index, s->X = lines->X, s->count = lines->count;
    s->marched = lines->samples;
    s->residual = NAN;
    out->converged = true;
    out->amplitude = lines->amplitude;
    out->truncation = lines->e.truncation, out->sampling = lines->e.sampling;
    out->solver = lines->e.solver;
    out->error = lines->error;
    out->wanting = out->error > wanted * out->amplitude;
    *lines = (struct torus_lines) { 0 };
}

/* The record's lines, read with the errors E, into OUT. */
static enum modal_status keep_lines(const struct march *a, const struct torus_errors *e,
                                    double amplitude, struct torus_lines *out,
                                    struct modal_error *err)
{
    size_t K = (size_t)a->count, q = (size_t)a->s->q;
    struct torus_index *index = malloc(K * sizeof *index);
    double complex *X = malloc(q * K * sizeof *X);

    if (index == NULL || X == NULL) {
        free(index), free(X);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %d combinations", a->count);
    }
    memcpy(index, a->index, K * sizeof *index);
    memcpy(X, a->X, q * K * sizeof *X);
    torus_lines_done(out);
    *out = (struct torus_lines) { .count = a->count, .samples = a->N * a->turns, .index = index,
                                  .X = X, .e = *e, .amplitude = amplitude,
                                  .error = e->truncation + e->sampling + e->solver };
    return MODAL_OK;
}

/*
 * One record: its lines are kept where their error is less than POINT's, the balance's, and in
 * place of a shorter record's: what drifts slowly is seen in the longest.  A march may leave an
 * unstable motion for another.  Where its lines explain that well it is the answer; else it is
 * none, POINT's error stands, and more combinations are the way on.  A march that fails is none
 * either.
 */
static enum modal_status march_once(struct march *a, double wanted, struct torus_errors *e,
                                    const struct torus_point *point, struct torus_lines *best,
                                    bool *ended, struct modal_error *err)
{
    struct modal_error own = { 0 };
    struct scene_time time = times_of(a, a->N, (long)a->N * a->turns, a->start);
    double amplitude = 0, least, error;
    enum modal_status rc = make_window(a, err);

    if (rc != MODAL_OK)
        return rc;
    *ended = true;
    rc = record(a, &time, a->x, &own);
    if (rc == MODAL_OK)
        rc = check_steps(a, &e->solver, &own);
    if (rc != MODAL_OK) {
        if (rc == MODAL_CANCELLED)
            *err = own;
        return rc == MODAL_CANCELLED ? rc : MODAL_OK;
    }
    rc = read_record(a, wanted, e, &amplitude, err);
    error = e->truncation + e->sampling + e->solver;
    least = FEW * amplitude;
    if (point->converged && agrees(a, point->error))
        least = point->error;
    *ended = error <= wanted * amplitude;
    if (rc == MODAL_OK && error < least)
        rc = keep_lines(a, e, amplitude, best, err);
    return rc;
}

enum modal_status torus_march(struct torus_solver *s, double wanted,
                              const struct torus_point *point, struct torus_lines *best,
                              struct modal_error *err)
{
    int N = SAMPLES, turns = TURNS, tried = 0;
    double left = HUGE_VAL;
    bool ended = false;
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && !ended && N <= SAMPLES_MOST && turns <= TURNS_MOST) {
        struct march a = { .s = s };
        struct torus_errors e = { 0 };

        rc = set_out(&a, point->converged, err);
        while (rc == MODAL_OK && !ended && !size_record(&a, N, turns)) {
            turns /= 2;
            ended = turns <= tried;
        }
        if (rc == MODAL_OK && !ended)
            rc = march_once(&a, wanted, &e, point, best, &ended, err);
        workspace_free(&a.space);
        if (turns == LONGER * tried && e.change > HALVED * left)
            break;
        left = e.change;
        tried = turns;
        if (e.truncation < e.sampling + e.solver)
            N *= 2, tried = 0;
        else
            turns *= LONGER;
    }
    return rc;
}
