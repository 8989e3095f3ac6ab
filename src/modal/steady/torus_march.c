/*
 * torus_march.c - a motion of tones marched, and its lines read from the record; tested by
 * tests/unit/modal/steady/test_torus.c
 *
 * The spectrum of a kink ends slowly, and a balance needs samples of all phases for each of its
 * combinations; in time the same motion is a few states.  From where a balance has it the program's
 * own is marched, and its lines are read (torus_lines.h).  The march's own error is told by finer
 * steps.
 *
 * Where laws are lines between their events it is followed exactly (torus_pieces.h), from the
 * scene's own start, and no balance is asked for.  Disturbances that go along tell when what it
 * began with has decayed to DECAYED of the error asked for, and their growth is the motion's
 * stability.  Records are doubled, each a continuation of the one before.
 *
 * A line is off by those that the record does not tell from it and by what leaks; both fall as the
 * record grows.  What lines move by as it doubles is what they were off by before, and as errors
 * fall from record to record by a ratio, the last is off by that ratio of the last move.  What is
 * left of the record has no line larger than its largest Fourier coefficient: that bounds the lines
 * that are not told, wherever they are.  Such an estimate knows nothing of two lines that no record
 * so far has told apart: of those the last lengths would say the same.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/scene.h"
#include "modal/scene/simulate.h"
#include "modal/steady/condense.h"
#include "modal/steady/torus_laws.h"
#include "modal/steady/torus_lines.h"
#include "modal/steady/torus_pieces.h"

enum {
    SAMPLES = 64,              /* of a turn, at first: x of a kink folds some 64^-4 */
    SAMPLES_MOST = 256,        /* doubled twice: of stiff contacts */
    SAMPLES_EXACT = 32,        /* of one followed exactly: some 32^-4, where that is enough */
    TURNS = 64,                /* of a record, at first: tones one in 40 apart are told */
    LONGER = 4,                /* the next: all before cost a third of it */
    SETTLING = 4,              /* a record's turns over those that go before it */
    CHECKED = 16,              /* turns that are marched once more */
    LEAPS = 16,                /* a turn: sliders of a few events, measured */
    TURNS_EXACT = 32,          /* of a record followed exactly, at first, and twice as many again */
    TURNS_ONE = 4,             /* of one tone, whose turns are alike: the least that tells a row */
    PACE_MOST = 8,             /* as torus_fold.c has it */
    SETTLED_MOST = 4096,       /* turns: what loses less than 2e-4 of itself in a radian */
    LOOK = 8,                  /* turns between looks at what has decayed */
    TOLD_APART = 512,          /* turns that tell tones one in 340 apart: before them a record may
                                * explain nothing, and the next all */
    GROWTH_LEAST = 128,        /* turns of disturbances, as many as torus_stability.c begins with:
                                * their growth is known to some hundredths then */
    TURNS_PART = 256,          /* that tell parts of tones: tones one in 170 apart */
    SLOWLY = 256,              /* turns from which on the rest is foreseen */
};
static const double TOLERANCE = 1e-4;     /* of the error asked for, of a step: what it leaves is
                                           * noise in a thousand lines, and costs leaps little; what
                                           * it comes to is measured */
static const double TOLERANCE_LEAST = 1e-11;  /* near rounding */
static const double FINER = 1.0 / 64;     /* of the tolerance: that measure's */
static const double SPLIT = 0.2;          /* of the steps have an event, and are two */
static const double HALVED = 0.5;         /* of what a shorter record left: a longer one that leaves
                                           * more has what no line explains */
static const double PLAINLY = 0.01;       /* of a motion that decays to one: lines that leave more
                                           * of it are not its own, as torus_stand.c has it: of
                                           * thousands some are near any frequency */
static const double TRULY = 0.1;          /* of what the tones' lines leave: as many of a part that
                                           * is none of the motion's leave about as much */
static const double DECAYED = 0.01;       /* of the error asked for: of what a march began with */
static const double CLOSER = 0.7;         /* of the error of a record a quarter as long: one that is
                                           * not better ends the march */
static const double LEFT = 0.3;           /* of the error asked for, as in torus_solve.c */
static const double FOLDS = 1e-5;         /* the least error asked for that SAMPLES_EXACT serve */
static const double NEAR = 1e-9;          /* of a load's frequency: its rounding, and far more */
static const double BESIDE = 1.05;        /* of a tone: samples of its turns serve one so near */

/* Whether a load of S has tone J. */
static bool is_loaded(const struct torus_solver *s, int j)
{
    for (int i = 0; i < s->p->loads; i++) {
        const struct program_load *load = &s->p->load[i];

        if (load->tone[j] != 0 && (load->cosine != 0 || load->sine != 0))
            return true;
    }
    return false;
}

/* S's tones, led by the fastest that a load has: turns of another are none of the motion's. */
static struct torus_tones led_by_loads(const struct torus_solver *s)
{
    struct torus_tones t = s->tones;
    double fastest = 0;

    for (int j = 0; j < t.count; j++)
        if (is_loaded(s, j) && t.omega[j] > fastest)
            fastest = t.omega[j], t.lead = j;
    torus_tones_move(&t, t.lead, t.omega[t.lead]);
    return t;
}

/* Whether loads beat with each other or the mean more slowly than the longest record tells: it
 * would have their motion at one phase of the beat. */
static bool beats_too_slowly(const struct torus_solver *s)
{
    const struct torus_tones t = led_by_loads(s);
    double apart = torus_sheet_apart(&t, TORUS_TURNS_MOST, true);
    bool loaded[TORUS_LOADS_MOST + 1] = { true }, slowly = false, flipped;

    for (int i = 0; i < s->p->loads; i++) {
        const struct program_load *load = &s->p->load[i];
        struct torus_index k = { { load->tone[0], load->tone[1], load->tone[2] } };

        if (load->cosine != 0 || load->sine != 0)
            loaded[torus_group(s, torus_signed(&s->tones, k, &flipped))] = true;
    }
    for (int g = 1; g <= s->groups; g++)
        for (int h = 0; h < g; h++) {
            double beat = fabs(torus_frequency(&t, s->group[g]) - torus_frequency(&t, s->group[h]));

            slowly = slowly || (loaded[g] && loaded[h] && beat < apart
                                && beat > torus_rounding(&t, s->group[g])
                                              + torus_rounding(&t, s->group[h]));
        }
    return slowly;
}

bool torus_march_takes(const struct torus_solver *s, bool balanced)
{
    bool takes = s->tone.index < 0 && s->opt->order == 0 && s->q > 0 && !s->opt->near
        && !beats_too_slowly(s);
    bool events = !balanced;

    for (int l = 0; l < s->p->laws; l++) {
        takes = takes && (balanced || !torus_undetermined(s->laws, l));
        events = events || (!s->p->law[l].kind->smooth && torus_acts(s->laws, l));
    }
    return takes && events;
}

/* Turns of the fastest load in one of the lead's, or up to twice as many, a power of two: records
 * are sampled, and disturbances seen, as often as that asks for. */
static int pace_of(const struct torus_solver *s)
{
    double fastest = 0;
    int pace = 1;

    for (int g = 1; g <= s->groups; g++)
        fastest = fmax(fastest, torus_frequency(&s->tones, s->group[g]));
    while (pace < PACE_MOST && pace * s->tones.omega[s->tones.lead] < (1 - NEAR) * fastest)
        pace *= 2;
    return pace;
}

/* The program's motion from the start over the outputs, into SIGNALS; TOLERANCE of a step. */
static enum modal_status record(struct torus_sheet *a, struct scene_time *time, double tolerance,
                                double *signals, struct modal_error *err)
{
    const struct torus_solver *s = a->s;
    struct program view = *s->p;
    struct simulate_options how = { .tolerance = tolerance, .cancelled = s->opt->cancelled,
                                    .context = s->opt->context };
    struct simulate_result done = { 0 };
    double work = torus_step_work(s, time, &how.leaps);
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
    how.steps_most = (int64_t)fmax((s->work->most - s->work->spent) / work, 1);
    rc = simulate(&view, time, &how, signals, &done, err);
    budget_add(s->work, work * (double)(rc == MODAL_OK ? done.steps : how.steps_most));
    if (rc == MODAL_OK)
        a->a_turn = work * (double)done.steps
            / ((time->start + time->duration) * s->tones.omega[s->tones.lead] / (2 * M_PI));
    return rc;
}

/* COUNT samples from time START, N a turn. */
static struct scene_time times_of(const struct torus_sheet *a, int N, long count, double start)
{
    double dt = 2 * M_PI / a->s->tones.omega[a->s->tones.lead] / N;

    return (struct scene_time) { .dt = dt, .start = start, .samples = count,
                                 .duration = (double)(count - 1) * dt };
}

/* How far the first turns are off those on twice as many samples with FINER of the tolerance, into
 * *MOST: the finer march has a small part of the other's error. */
static enum modal_status check_steps(struct torus_sheet *a, double *most, struct modal_error *err)
{
    long count = (long)CHECKED * a->N;
    size_t wide = (size_t)a->outputs;
    double *coarse = workspace_zeros(&a->space, (size_t)count * wide, sizeof *coarse),
           *fine = workspace_zeros(&a->space, 2 * (size_t)count * wide, sizeof *fine);
    struct scene_time once = times_of(a, a->N, count, 0), twice = times_of(a, 2 * a->N,
                                                                           2 * count, 0);
    enum modal_status rc = workspace_check(&a->space, "torus: no memory for a record", err);

    if (rc == MODAL_OK)
        rc = record(a, &once, a->tolerance, coarse, err);
    if (rc == MODAL_OK)
        rc = record(a, &twice, FINER * a->tolerance, fine, err);
    for (size_t n = 0; rc == MODAL_OK && n < (size_t)count; n++)
        for (size_t i = 0; i < wide; i++)
            *most = fmax(*most, a->reported[i] ? fabs(coarse[n * wide + i] - fine[2 * n * wide + i])
                                               : 0);
    return rc;
}

/* The outputs, and where a march begins: where the balance has the motion, or where the scene
 * has. */
static enum modal_status set_out(struct torus_sheet *a, bool balanced, struct modal_error *err)
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
    for (int j = 0; j < s->tones.count; j++)
        a->idle[j] = !is_loaded(s, j);
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

/* A record of N samples of each of TURNS turns laid out; false: more than the work left, or than a
 * record may hold.  The march is priced with its settling, its check and what events cut in
 * pieces. */
static bool size_record(struct torus_sheet *a, int N, int turns, double wanted)
{
    const struct torus_tones *t = &a->s->tones;
    double all = (1 + 1.0 / SETTLING) * turns + 3.0 * CHECKED, work;
    bool fits = torus_sheet_lay(a, N, turns, wanted);
    struct scene_time time = times_of(a, N, 1, 0);
    bool leaps = false;
    double step = torus_step_work(a->s, &time, &leaps);

    a->start = turns / SETTLING * 2 * M_PI / t->omega[t->lead];
    a->tolerance = fmax(TOLERANCE * wanted, TOLERANCE_LEAST);
    work = all * fmax(a->a_turn, (leaps ? LEAPS : N * (1 + SPLIT)) * step);
    return fits && a->s->work->spent + work + torus_sheet_work(a) <= a->s->work->most;
}

/* Whether A tells a line of K. */
static bool has_line(const struct torus_sheet *a, struct torus_index k)
{
    bool has = false;

    for (int l = 0; l < a->count && !has; l++)
        has = torus_equal(a->index[l], k);
    return has;
}

/* The record's lines, read with the errors E, into OUT: beside them those of loads that it does not
 * tell from others, or that move no law, for other dofs follow from them as well. */
static enum modal_status keep_lines(const struct torus_sheet *a, const struct torus_errors *e,
                                    double amplitude, struct torus_lines *out,
                                    struct modal_error *err)
{
    size_t told = (size_t)a->count, K = told, q = (size_t)a->s->q;
    struct torus_index *index = malloc((told + (size_t)a->s->groups) * sizeof *index);
    double complex *X = calloc(q * (told + (size_t)a->s->groups) + 1, sizeof *X);

    if (index == NULL || X == NULL) {
        free(index), free(X);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %d combinations", a->count);
    }
    memcpy(index, a->index, told * sizeof *index);
    for (int g = 1; g <= a->s->groups; g++)
        if (!has_line(a, a->s->group[g]))
            index[K++] = a->s->group[g];
    for (size_t i = 0; i < q; i++)
        memcpy(X + i * K, a->X + i * told, told * sizeof *X);
    torus_lines_done(out);
    *out = (struct torus_lines) { .count = (int)K, .samples = a->N * a->turns, .turns = a->turns,
                                  .index = index, .apart = a->apart,
                                  .X = X, .e = *e, .amplitude = amplitude,
                                  .error = e->truncation + e->sampling + e->solver,
                                  .line = fmin(e->line, e->truncation) + e->folded + e->solver };
    return MODAL_OK;
}

/* A line of two records, of dof 0 on: combination, whose record, where. */
struct told { struct torus_index k; const double complex *X; int step; };

static int by_combination(const void *a, const void *b)
{
    return memcmp(&((const struct told *)a)->k, &((const struct told *)b)->k,
                  sizeof(struct torus_index));
}

/* How far the lines of A are from those of a record half as long: what one has alone counts
 * whole. */
static enum modal_status moved(const struct torus_sheet *a, const struct torus_lines *half,
                               double *most, struct modal_error *err)
{
    int all = a->count + half->count;
    struct told *told = malloc(((size_t)all + 1) * sizeof *told);

    *most = 0;
    if (told == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a record");
    for (int l = 0; l < all; l++)
        told[l] = l < a->count
                      ? (struct told) { a->index[l], a->X + l, a->count }
                      : (struct told) { half->index[l - a->count], half->X + l - a->count,
                                        half->count };
    qsort(told, (size_t)all, sizeof *told, by_combination);
    for (int l = 0; l < all; l++) {
        const struct told *one = &told[l], *other = NULL;

        if (l + 1 < all && by_combination(one, one + 1) == 0)
            other = &told[++l];
        for (int i = 0; i < a->s->q; i++) {
            double complex off = one->X[i * one->step] - (other ? other->X[i * other->step] : 0);

            *most = fmax(*most, cabs(off));
        }
    }
    free(told);
    return MODAL_OK;
}

/* One record: its lines are kept in place of a shorter record's, for what drifts slowly is seen in
 * the longest, and of one whose errors are larger.  A march that fails is none. */
static enum modal_status march_once(struct torus_sheet *a, struct torus_errors *e,
                                    struct torus_lines *best, bool *ended,
                                    struct modal_error *err)
{
    struct modal_error own = { 0 };
    struct scene_time time = times_of(a, a->N, (long)a->N * a->turns, a->start);
    double amplitude = 0;
    enum modal_status rc = torus_sheet_room(a, err);

    if (rc != MODAL_OK)
        return rc;
    *ended = true;
    rc = record(a, &time, a->tolerance, a->x, &own);
    if (rc == MODAL_OK)
        rc = check_steps(a, &e->solver, &own);
    if (rc != MODAL_OK) {
        if (rc == MODAL_CANCELLED)
            *err = own;
        return rc == MODAL_CANCELLED ? rc : MODAL_OK;
    }
    rc = torus_sheet_read(a, e, &amplitude, err);
    budget_add(a->s->work, torus_sheet_work(a));
    if (rc == MODAL_OK && (a->turns > best->turns
                           || e->truncation + e->sampling + e->solver < best->error))
        rc = keep_lines(a, e, amplitude, best, err);
    *ended = rc != MODAL_OK || best->error <= a->wanted * amplitude;
    return rc;
}

enum modal_status torus_march(struct torus_solver *s, double wanted, bool balanced,
                              struct torus_lines *best, struct modal_error *err)
{
    const struct torus_tones tones = s->tones;
    int N = SAMPLES, turns = TURNS, tried = 0;
    double left = HUGE_VAL, a_turn = 0;
    bool ended = false;
    enum modal_status rc = MODAL_OK;

    s->tones = led_by_loads(s);
    if (s->tones.lead != tones.lead && !(s->tones.nu[tones.lead] < BESIDE))
        N *= 2;                           /* as many of a turn of what was the fastest, about */
    while (rc == MODAL_OK && !ended && N <= SAMPLES_MOST && turns <= TORUS_TURNS_MOST) {
        struct torus_sheet a = { .s = s, .a_turn = a_turn };
        struct torus_errors e = { 0 };

        rc = set_out(&a, balanced, err);
        while (rc == MODAL_OK && !ended && !size_record(&a, N, turns, wanted)) {
            turns /= 2;
            ended = turns <= tried;
        }
        if (rc == MODAL_OK && !ended)
            rc = march_once(&a, &e, best, &ended, err);
        a_turn = a.a_turn;
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
    s->tones = tones;
    return rc;
}

/* A march followed exactly, and its record so far. */
struct exact {
    struct torus_solver *s;
    struct torus_pieces *m;
    double *x, *growth, start;            /* s */
    int turns, seen, columns;             /* seen: of the turns, with disturbances; 0: all */
    long begun;                           /* turns that went before */
    int pace;                             /* as pace_of has it */
};

/* Whether a slider of march M is at rest, so that its place is one of many, and a balance may
 * choose it. */
static bool leaves_place(const struct torus_solver *s, const struct torus_pieces *m)
{
    bool rests = false;

    for (int l = 0; l < s->p->laws; l++)
        rests = rests || (s->p->law[l].memory > 0 && !torus_pieces_acted(m, l));
    return rests && !torus_pieces_leaves(m);
}

/* Until what it began with has decayed: the leading disturbance; *SETTLED false: not in time. */
static enum modal_status settle(struct exact *a, double wanted, bool *settled,
                                struct modal_error *err)
{
    double growth[LOOK * TORUS_EXPONENTS], all = 0, enough = log(DECAYED * wanted);
    int look = LOOK / a->pace;
    bool followed = true;
    enum modal_status rc = MODAL_OK;

    *settled = false;
    for (int turns = look; rc == MODAL_OK && followed && !*settled && turns <= SETTLED_MOST
                           && (turns < SLOWLY || all * SETTLED_MOST / turns < enough)
                           && !budget_spent(a->s->work);
         turns += look) {
        rc = torus_pieces_go(a->m, look, 0, NULL, NULL, growth, &followed, err);
        for (int t = 0; t < look; t++)
            all += growth[t * a->columns];
        *settled = followed && all < enough;
    }
    torus_pieces_forget(a->m);
    return rc;
}

/* The record of TURNS turns, those of before and more, of sheet S's outputs, where they are asked
 * for; *FOLLOWED as torus_pieces_go has it. */
static enum modal_status extend(struct exact *a, const struct torus_sheet *s, int turns,
                                bool *followed, struct modal_error *err)
{
    size_t wide = s != NULL ? (size_t)s->N * (size_t)s->outputs : 0, more = (size_t)turns;
    double *x = s != NULL ? realloc(a->x, more * wide * sizeof *x) : a->x;
    double *growth = realloc(a->growth, more * (size_t)a->columns * sizeof *growth);
    enum modal_status rc;

    a->x = x != NULL ? x : a->x;
    a->growth = growth != NULL ? growth : a->growth;
    if ((s != NULL && x == NULL) || growth == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a record");
    rc = torus_pieces_go(a->m, turns - a->turns, s != NULL ? s->outputs : 0,
                         s != NULL ? s->dofs : NULL, x + (size_t)a->turns * wide,
                         a->seen == 0 ? growth + (size_t)a->turns * (size_t)a->columns : NULL,
                         followed, err);
    a->turns = turns;
    return rc;
}

/*
 * e->line: the largest line that is left, and how far off those told are.  A record half as long
 * was off by what they moved since, MOVES[1], as that of a quarter by MOVES[0]: this one by as much
 * less.
 */
static enum modal_status now_known(const struct torus_sheet *a, const struct torus_lines *half,
                                   double moves[2], struct torus_errors *e,
                                   struct modal_error *err)
{
    double most = HUGE_VAL;
    enum modal_status rc = half->count > 0 ? moved(a, half, &most, err) : MODAL_OK;

    moves[0] = moves[1];
    moves[1] = most;
    e->line += most < moves[0] && moves[0] < HUGE_VAL ? most * most / moves[0] : most;
    return rc;
}

/* The lines of the record of TURNS turns into BEST, whose lines are of half as many; *ENDED: they
 * are good enough, or none can be read. */
static enum modal_status read_exactly(struct torus_solver *s, struct exact *a, int N, int turns,
                                      double wanted, struct torus_lines *best, double moves[2],
                                      bool *ended, struct torus_errors *e,
                                      struct modal_error *err)
{
    struct torus_sheet sheet = { .s = s, .settled = true, .start = a->start };
    double amplitude = 0;
    bool followed = true;
    enum modal_status rc = set_out(&sheet, false, err);

    *ended = rc == MODAL_OK
        && (!torus_sheet_lay(&sheet, N, turns, wanted)
            || s->work->spent + torus_sheet_work(&sheet)
                   + torus_pieces_work(a->m) * (turns - a->turns) > s->work->most);
    if (rc == MODAL_OK && !*ended)
        rc = extend(a, &sheet, turns, &followed, err);
    if (rc == MODAL_OK && (!followed || leaves_place(s, a->m))) {
        torus_lines_done(best);
        *ended = true;
    }
    if (rc == MODAL_OK && !*ended) {
        sheet.x = a->x;
        rc = torus_sheet_room(&sheet, err);
        if (rc == MODAL_OK)
            rc = torus_sheet_read(&sheet, e, &amplitude, err);
        budget_add(s->work, torus_sheet_work(&sheet));
        if (rc == MODAL_OK)
            rc = now_known(&sheet, best, moves, e, err);
        if (rc == MODAL_OK)
            rc = keep_lines(&sheet, e, amplitude, best, err);
        *ended = rc != MODAL_OK || best->line <= wanted * amplitude;
    }
    workspace_free(&sheet.space);
    return rc;
}

/* Every STEP-th sample of those of A's record after SKIP turns, N a turn, into SHEET's own. */
static void thin_out(struct torus_sheet *sheet, const struct exact *a, int N, int skip, int step)
{
    size_t wide = (size_t)sheet->outputs, count = (size_t)sheet->N * (size_t)sheet->turns;
    const double *x = a->x + (size_t)skip * (size_t)N * wide;

    for (size_t n = 0; n < count; n++)
        memcpy(sheet->x + n * wide, x + n * (size_t)step * wide, wide * sizeof *x);
}

/* *LEFT: what lines of PART beside S's other tones leave of the record's first turns; HUGE_VAL:
 * they are not read, for want of work.  A part of the leading tone has as many samples a turn of
 * its own, every second to fifth: what they fold is on lines of the part again. */
static enum modal_status leaves(struct torus_solver *s, const struct exact *a, int N,
                                struct torus_part part, double wanted, double *left,
                                struct modal_error *err)
{
    const struct torus_tones tones = s->tones;
    int lead = part.tone == tones.lead ? part.of : 1;
    int turns = a->turns < TURNS_PART ? a->turns : TURNS_PART;
    int skip = (int)((lead - a->begun % lead) % lead), whole = 1;
    struct torus_sheet sheet = { .s = s, .settled = true,
                                 .start = a->start + skip * 2 * M_PI / tones.omega[tones.lead] };
    struct torus_errors e = { .change = HUGE_VAL };
    double amplitude;
    enum modal_status rc = set_out(&sheet, false, err);

    while (2 * whole * lead <= turns - skip)
        whole *= 2;
    torus_tones_move(&s->tones, part.tone, tones.omega[part.tone] / part.of);
    if (rc == MODAL_OK && torus_sheet_lay(&sheet, N, whole, wanted)
        && budget_pays(s->work, torus_sheet_work(&sheet))) {
        rc = torus_sheet_room(&sheet, err);
        if (rc == MODAL_OK) {
            thin_out(&sheet, a, N, skip, lead);
            rc = torus_sheet_read(&sheet, &e, &amplitude, err);
        }
        budget_add(s->work, torus_sheet_work(&sheet));
    }
    s->tones = tones;
    *left = e.change;
    workspace_free(&sheet.space);
    return rc;
}

/* s->part, where what decays to a motion of so large an AMPLITUDE has no lines of the tones: the
 * fewest turns that explain truly more, unless others explain far more than these.  What made it be
 * sought no part may leave. */
static enum modal_status find_part(struct torus_solver *s, const struct exact *a, int N,
                                   double wanted, double amplitude, struct modal_error *err)
{
    struct torus_part part = { 0, 1 };
    double least, left;
    enum modal_status rc = leaves(s, a, N, part, wanted, &least, err);

    least = least < HUGE_VAL ? fmin(TRULY * least, PLAINLY * amplitude) : 0;
    for (; rc == MODAL_OK && part.tone < s->tones.count; part.tone++)
        for (part.of = 2; rc == MODAL_OK && part.of <= TORUS_PARTS_MOST; part.of++) {
            rc = leaves(s, a, N, part, wanted, &left, err);
            if (rc == MODAL_OK && left < least)
                least = HALVED * left, s->part = part;
        }
    return rc;
}

/* What the growth of disturbances tells so far; where that decides, or nobody asks, they end.  The
 * shortest records decide too, but with errors of a third of what they tell. */
static void see_growth(struct torus_solver *s, struct exact *a)
{
    if (a->seen > 0)
        return;
    torus_judge_growth(s, a->growth, a->turns, a->columns, &s->followed);
    if (s->opt->stability && (s->followed.verdict == 0 || a->turns * a->pace < GROWTH_LEAST))
        return;
    a->seen = a->turns;
    torus_pieces_alone(a->m);
}

/* Further, with no record, until the growth of disturbances decides.  A motion whose growth is near
 * 0 is followed as far as the longest record, and stays undecided. */
static enum modal_status decide(struct torus_solver *s, struct exact *a, struct modal_error *err)
{
    bool followed = true;
    enum modal_status rc = MODAL_OK;

    see_growth(s, a);
    while (rc == MODAL_OK && followed && a->seen == 0 && 2 * a->turns <= TORUS_TURNS_MOST) {
        rc = extend(a, NULL, 2 * a->turns, &followed, err);
        if (rc == MODAL_OK && followed)
            see_growth(s, a);
    }
    return rc;
}

/* A copy of NOW into BEST where its lines are known better: a record longer than as many lines as
 * are told at the most knows no more. */
static enum modal_status keep_better(const struct torus_lines *now, int q, struct torus_lines *best,
                                     struct modal_error *err)
{
    size_t K = (size_t)now->count;
    struct torus_lines copy = *now;

    if (now->count == 0 || (best->count > 0 && best->line <= now->line))
        return MODAL_OK;
    copy.index = malloc(K * sizeof *copy.index);
    copy.X = malloc((size_t)q * K * sizeof *copy.X);
    if (copy.index == NULL || copy.X == NULL) {
        free(copy.index), free(copy.X);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %d combinations", now->count);
    }
    memcpy(copy.index, now->index, K * sizeof *copy.index);
    memcpy(copy.X, now->X, (size_t)q * K * sizeof *copy.X);
    torus_lines_done(best);
    *best = copy;
    return MODAL_OK;
}

/* What the laws did in the march M, with its lines. */
static enum modal_status keep_acts(const struct torus_solver *s, const struct torus_pieces *m,
                                   struct torus_lines *lines, struct modal_error *err)
{
    lines->acts = calloc((size_t)s->p->laws + 1, sizeof *lines->acts);
    if (lines->acts == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a march");
    for (int l = 0; l < s->p->laws; l++)
        lines->acts[l] = torus_pieces_acted(m, l);
    lines->asked = torus_pieces_asked(m);
    return MODAL_OK;
}

/* With N samples a turn; *FINER: it asks for more. */
static enum modal_status march_exactly(struct torus_solver *s, int N, double wanted,
                                       struct torus_lines *best, bool *finer,
                                       struct modal_error *err)
{
    int most = 2 * s->p->n < TORUS_EXPONENTS ? 2 * s->p->n : TORUS_EXPONENTS;
    struct exact a = { .s = s, .columns = s->opt->stability ? most : 1, .pace = pace_of(s) };
    int first = s->tones.count > 1 ? TURNS_EXACT : TURNS_ONE;
    int apart = s->tones.count > 1 ? TOLD_APART : first;       /* one tone has none beside it */
    double before[2] = { HUGE_VAL, HUGE_VAL }, moves[2] = { HUGE_VAL, HUGE_VAL };
    struct torus_lines now = { 0 };
    bool settled = false, ended = false;
    enum modal_status rc = torus_pieces_new(s, N, a.columns, &a.m, err);

    *finer = false;
    if (rc == MODAL_OK && a.m != NULL)
        rc = settle(&a, wanted, &settled, err);
    if (settled)
        a.begun = torus_pieces_turns(a.m);
    a.start = (double)a.begun * 2 * M_PI / s->tones.omega[s->tones.lead];
    for (int turns = first; rc == MODAL_OK && settled && !ended && turns <= TORUS_TURNS_MOST;
         turns *= 2) {
        struct torus_errors e = { 0 };

        rc = read_exactly(s, &a, N, turns, wanted, &now, moves, &ended, &e, err);
        *finer = !ended && e.folded > fmax(LEFT * wanted * now.amplitude, e.line);
        if (now.count == 0)
            torus_lines_done(best);
        if (rc == MODAL_OK)
            rc = keep_better(&now, s->q, best, err);
        if (rc == MODAL_OK && !ended && !*finer)
            see_growth(s, &a);
        ended = ended || *finer || (turns >= apart && now.line > CLOSER * before[0]);
        before[0] = before[1];
        before[1] = now.line;
    }
    torus_lines_done(&now);
    if (rc == MODAL_OK && best->count > 0 && !*finer)
        rc = decide(s, &a, err);
    if (rc == MODAL_OK && best->count > 0)
        rc = keep_acts(s, a.m, best, err);
    if (rc == MODAL_OK && s->followed.verdict >= 0 && s->tones.count > 1
        && best->e.change > PLAINLY * best->amplitude)
        rc = find_part(s, &a, N, wanted, best->amplitude, err);
    torus_pieces_free(a.m);
    free(a.x), free(a.growth);
    return rc;
}

enum modal_status torus_march_exactly(struct torus_solver *s, double wanted,
                                      struct torus_lines *best, struct modal_error *err)
{
    const struct torus_tones tones = s->tones;
    int N = wanted >= FOLDS ? SAMPLES_EXACT : SAMPLES, pace;
    bool finer = true;
    enum modal_status rc = MODAL_OK;

    s->tones = led_by_loads(s);
    pace = pace_of(s);
    for (N *= pace; rc == MODAL_OK && finer && N <= SAMPLES_MOST * pace; N *= 2) {
        struct torus_lines now = { 0 };

        rc = march_exactly(s, N, wanted, &now, &finer, err);
        if (rc == MODAL_OK && now.count > 0 && (best->count == 0 || now.line < best->line)) {
            torus_lines_done(best);
            *best = now;
        } else                            /* finer samples left no work for as long a record */
            torus_lines_done(&now);
    }
    s->tones = tones;
    return rc;
}
