/* torus_solve.c - see torus_solve.h; tested by tests/unit/modal/steady/test_torus.c */
#include "modal/steady/torus_solve.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/steady/condense.h"
#include "modal/steady/torus_fold.h"
#include "modal/steady/torus_laws.h"
#include "modal/steady/torus_state.h"

enum {
    ROUNDS_MOST = 24,          /* of growth: each adds a good part of what there is */
    FIRST_ORDER = 3,           /* combinations that a search begins with */
    GROWTH_LEAST = 24,         /* combinations that a round may add, or as many as there are */
};
static const double WORK_MOST = 2.6e9;    /* budget.h: some three and a half seconds at rest, less
                                           * than five beside others */
static const double WORK_NEAR = 3e8;      /* of a branch's point, which has many beside it */
static const double GROWTH = 0.25;        /* of it: then no more is begun, for a round may take
                                           * several times what those before it took */
static const double LEFT = 0.3;           /* of the error asked for: what one of its parts may be */
static const double HALF = 0.5;           /* of it: truncation that growth is worth while for */
static const double BESIDE = 0.1;         /* of truncation: sampling that more lines are worth
                                           * while for; of what no growth mends: what of the rest
                                           * it need not */
static const double LITTLE = 0.01;        /* of a motion that has settled: lines known so well are
                                           * worth more than a first balance, whatever they leave */
static const double BEHIND = 0.1;         /* of a balance's error: lines that have less it does not
                                           * reach by growing two or three times */
static const double SMALL = 0.01;         /* of a balance's error, which its disturbances are to
                                           * see: what combinations not followed may sum to */
static const double THIN = 1e-3;          /* of a motion marched, and no more than its error: what
                                           * combinations not followed sum to; of one with gaps a
                                           * hundredth made what decays grow */
static const double ROUGH = 0.01;         /* of a motion that a march begins at: the first set
                                           * leaves out as much */

/* How many of LIST to take: so that what is left sums to less than LEAVE, no more than there are.
 * */
static int choose(const struct torus_solver *s, const struct torus_candidate *list, int count,
                  double leave)
{
    int take = count, most = s->count > GROWTH_LEAST ? s->count : GROWTH_LEAST;
    double sum = 0;

    while (take > 0 && sum + list[take - 1].size <= leave)
        sum += list[--take].size;
    take = take < most ? take : most;
    while (take > 0 && (double)s->q * (2.0 * (s->count + take) - 1) > TORUS_UNKNOWNS_MOST)
        take--;
    return take;
}

/*
 * One solution and its errors; the combinations around it into LIST.  Where LINES, NULL: none, are
 * an answer, it may take what leaves room for growth, and no more: a first set alone is never as
 * good.  Its error is without bound where nothing is left, for an estimate costs as much.
 */
static enum modal_status solve_round(struct torus_solver *s, const struct torus_lines *lines,
                                     struct torus_candidate *list, int *count,
                                     double complex *room, struct torus_errors *e,
                                     struct torus_point *out, struct modal_error *err)
{
    double most = s->work->most;
    bool stand = lines != NULL && torus_lines_stand(s, lines, NULL), enough;
    enum modal_status rc;

    torus_grid_free(s->grid);
    s->grid = NULL;
    rc = torus_grid_for(s, 0, s->finer, &s->grid, err);
    s->work->most *= stand ? GROWTH : 1;
    s->told = !stand && !s->opt->near;           /* a branch has many points beside it */
    if (rc == MODAL_OK)
        rc = torus_solve_set(s, &out->converged, err);
    s->told = false;
    s->ahead = 0;
    enough = stand && budget_spent(s->work);
    s->work->most = most;
    enough |= rc == MODAL_OK && stand && !budget_pays(s->work, torus_estimate_work(s));
    if (enough)
        out->error = HUGE_VAL;
    if (rc == MODAL_OK && out->converged && !enough)
        rc = torus_estimate(s, list, count, room, e, &out->amplitude, err);
    return rc;
}

/* The set grown by the first TAKE of LIST, begun at what their forces make; S->was: as it was. */
static enum modal_status take_in(struct torus_solver *s, const struct torus_candidate *list,
                                 int take, struct modal_error *err)
{
    struct torus_index *more = malloc(((size_t)take + 1) * sizeof *more);
    size_t n;
    enum modal_status rc;

    if (more == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %d combinations", take);
    for (int a = 0; a < take; a++)
        more[a] = list[a].k;
    rc = torus_grow(s, more, take, err);
    free(more);
    n = (size_t)s->q * (size_t)s->count;
    free(s->was);
    s->was = malloc((n + 1) * sizeof *s->was);
    if (rc == MODAL_OK && s->was == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %d combinations", s->count);
    if (rc == MODAL_OK)
        memcpy(s->was, s->X, n * sizeof *s->X);
    for (int i = 0; rc == MODAL_OK && i < s->q; i++)
        for (int a = 0; a < take; a++)
            s->X[(size_t)i * (size_t)s->count + (size_t)(s->count - take + a)] = list[a].X[i];
    return rc;
}

/* Where a grown set led nowhere: what balanced before it grew, whose errors OUT still has, with its
 * RESIDUAL and its free tone at OMEGA. */
static enum modal_status go_back(struct torus_solver *s, double residual, double omega,
                                 struct torus_point *out, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    memcpy(s->X, s->was, (size_t)s->q * (size_t)s->count * sizeof *s->X);
    s->residual = residual;
    if (s->tone.index >= 0)
        rc = torus_tone_move(s, omega, 0, err);
    torus_tone_keep(s);
    out->converged = out->error < out->amplitude;      /* else nothing is known of it */
    return rc;
}

/* How far the solution moved as the set grew last: what its truncation was before. */
static enum modal_status moved(struct torus_solver *s, double *most, struct modal_error *err)
{
    size_t n = (size_t)s->q * (size_t)s->count;

    for (size_t i = 0; i < n; i++)
        s->was[i] = s->X[i] - s->was[i];
    return torus_largest(s, s->grid, s->count, s->index, s->was, most, err);
}

/* Of laws with events: the first set's motion, roughly, and a march from there, or from the scene's
 * start where none was found; *MET: its lines are the answer, at TARGET or since other ways to a
 * balance would cost more than is left.  The rough one took as much for each of its samples as one
 * with its error told will twice: where that is not left, lines that agree with the rough one are
 * not held against a better: a balance has the same motion, and so their error may be as large as a
 * balance's that is kept (go_back), where torus_stand.c bounds what nothing else confirms. */
static enum modal_status march_first(struct torus_solver *s, double target,
                                     struct torus_lines *lines, struct torus_point *out, bool *met,
                                     struct modal_error *err)
{
    double spent = s->work->spent, points, price;
    enum modal_status rc;

    s->rough = ROUGH;
    points = torus_grid_size(s, 0, 0);
    rc = torus_grid_for(s, 0, 0, &s->grid, err);
    if (rc == MODAL_OK)
        rc = torus_solve_set(s, &out->converged, err);
    s->rough = 0;
    price = 2 * (s->work->spent - spent) * torus_grid_size(s, 0, 0) / points;
    if (rc == MODAL_OK && torus_march_takes(s, out->converged))
        rc = torus_march(s, target, out->converged, lines, err);
    *met = rc == MODAL_OK && lines->count > 0
        && (lines->line <= target * lines->amplitude
            || (s->work->spent > GROWTH * s->work->most && torus_lines_stand(s, lines, NULL))
            || (!budget_pays(s->work, price) && out->converged && lines->error < lines->amplitude
                && torus_lines_agree(s, lines)));
    if (*met)
        torus_adopt(s, lines, target, out);
    return rc;
}

/* Of laws with events that are lines between them: marched exactly; *MET: its lines are the answer,
 * at the target. */
static enum modal_status march_exactly(struct torus_solver *s, struct torus_lines *lines,
                                       struct torus_point *out, bool *met,
                                       struct modal_error *err)
{
    double target = torus_target(s);
    enum modal_status rc = torus_march_exactly(s, target, lines, err);

    *met = rc == MODAL_OK && lines->count > 0 && lines->line <= target * lines->amplitude
        && torus_lines_stand(s, lines, NULL);
    if (*met)
        torus_adopt(s, lines, target, out);
    else if (lines->line > LITTLE * lines->amplitude || lines->error > lines->amplitude)
        torus_lines_done(lines);
    if (!*met && lines->count == 0)
        s->followed = (struct torus_stability) { 0 };
    return rc;
}

/* E of a balance into OUT, whose truncation is taken to be MISSED times what was seen. */
static void state_errors(const struct torus_errors *e, double missed, double wanted,
                         struct torus_point *out)
{
    out->truncation = missed * e->truncation, out->sampling = e->sampling;
    out->solver = e->solver;
    out->tone_error = missed * e->tone;
    out->error = out->line = out->truncation + e->sampling + e->solver;
    out->wanting = out->error > wanted;
}

/* LINES where they are better than what was balanced, of a march from the scene's start where
 * nothing was. */
static enum modal_status take_lines(struct torus_solver *s, double target,
                                    struct torus_lines *lines, struct torus_point *out,
                                    struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (!out->converged && lines->count == 0 && torus_march_takes(s, false))
        rc = torus_march(s, target, false, lines, err);
    if (rc == MODAL_OK && torus_lines_stand(s, lines, out)
        && (!out->converged || lines->error < out->error))
        torus_adopt(s, lines, target, out);
    return rc;
}

/* Does a round with TAKE combinations more pass the budget, and leave nothing for a verdict, where
 * the last one took TOOK? Of rows that are full the work is the cube of their number. */
static bool is_too_dear(const struct torus_solver *s, double took, int take)
{
    double grows = 1 + (double)take / s->count;

    return s->work->spent + took * grows * grows * grows > s->work->most;
}

/* Solve, estimate, grow, until the errors are small enough or no more is allowed.  What the
 * estimate of truncation missed in one round it is taken to miss in the next. */
static enum modal_status solve_grown(struct torus_solver *s, struct torus_lines *lines,
                                     struct torus_point *out, struct modal_error *err)
{
    double target = torus_target(s), before = 0;
    struct torus_candidate *list = malloc(TORUS_CANDIDATES_MOST * sizeof *list);
    double complex *room = malloc(((size_t)s->q * TORUS_CANDIDATES_MOST + 1) * sizeof *room);
    enum modal_status rc = list == NULL || room == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory")
                               : MODAL_OK;
    bool met = false;

    if (rc == MODAL_OK && !torus_smooth(s->laws) && torus_march_takes(s, false)
        && lines->count == 0)
        rc = march_first(s, target, lines, out, &met, err);
    for (int round = 0; rc == MODAL_OK && !met && round < ROUNDS_MOST; round++) {
        struct torus_errors e = { 0 };
        double wanted, missed, leave, went = 0;
        double residual = s->residual, omega = s->tone.omega_kept, spent = s->work->spent;
        int count = 0, take;
        bool more_lines;

        rc = solve_round(s, round == 0 ? lines : NULL, list, &count, room, &e, out, err);
        if (rc == MODAL_OK && !out->converged && round > 0) {
            rc = go_back(s, residual, omega, out, err);
            break;
        }
        if (rc == MODAL_OK && out->converged && round > 0)
            rc = moved(s, &went, err);
        if (rc != MODAL_OK || !out->converged || out->error == HUGE_VAL)
            break;
        wanted = target * out->amplitude;
        missed = fmax(before > 0 ? went / before : 1,
                      e.truncation > 0 ? 1 + fmin(e.change / e.truncation, 1) : 1);
        before = e.truncation;
        state_errors(&e, missed, wanted, out);
        if (round == 0 && out->wanting && lines->count == 0 && torus_march_takes(s, true))
            rc = torus_march(s, target, true, lines, err);
        if (!out->wanting
            || (lines->error < BEHIND * out->error && torus_lines_stand(s, lines, out))
            || s->opt->order > 0 || s->work->spent > GROWTH * s->work->most)
            break;
        leave = fmax(LEFT * wanted / missed, BESIDE * e.beyond);
        take = out->truncation > HALF * wanted ? choose(s, list, count, leave) : 0;
        more_lines = e.sampling > fmax(LEFT * wanted, BESIDE * out->truncation)
            && s->finer < TORUS_FINER_MOST
            && torus_grid_size(s, 1, s->finer + 1) <= TORUS_POINTS_MOST;
        if ((take == 0 && !more_lines) || is_too_dear(s, s->work->spent - spent, take))
            break;
        s->finer += more_lines;
        rc = take_in(s, list, take, err);
    }
    if (rc == MODAL_OK && !met)
        rc = take_lines(s, target, lines, out, err);
    free(list), free(room);
    return rc;
}

/* The motion of the reported dofs into OUT, which takes the set and the kept ones' motion too. */
static enum modal_status report(struct torus_solver *s, struct torus_point *out,
                                struct modal_error *err)
{
    int dofs = s->opt->dofs_count;
    enum modal_status rc;

    out->X = calloc((size_t)dofs * (size_t)s->count + 1, sizeof *out->X);
    if (out->X == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
    rc = torus_recover(s, dofs, s->opt->dofs, out->X, err);
    out->count = s->count, out->q = s->q;
    out->index = s->index, out->start = s->X;
    s->index = NULL, s->X = NULL;
    return rc;
}

/* What the laws did and what was asked of them, into OUT, with how the motion was found. */
static void count_laws(const struct torus_solver *s, struct torus_point *out)
{
    out->laws = s->p->laws;
    for (int l = 0; l < s->p->laws; l++) {
        out->evaluations[l] = torus_evaluations(s->laws, l);
        out->acts[l] = torus_acts(s->laws, l);
        out->undetermined[l] = torus_undetermined(s->laws, l);
    }
    out->iterations = s->iterations;
    out->residual = s->residual;
    out->reason = s->reason;
    out->marched = s->marched > 0;
    out->from_start = s->marched > 0 && s->followed.count > 0;
    out->samples = s->marched > 0   ? s->marched
                   : s->grid != NULL ? torus_grid_lines(s->grid) * torus_grid_samples(s->grid)
                                     : 0;
}

/* All that S has; what it had not made yet is NULL. */
static void solver_done(struct torus_solver *s)
{
    for (int g = 0; g <= TORUS_LOADS_MOST; g++)
        condense_free(s->condense[g]);
    for (int m = 0; s->linear != NULL && m < s->count; m++)
        torus_linear_done(&s->linear[m]);
    torus_laws_free(s->laws);
    torus_grid_free(s->grid);
    free(s->linear), free(s->index), free(s->X), free(s->F), free(s->R), free(s->J);
    free(s->pivot), free(s->was), free(s->outer), free(s->outer_pivot);
    free(s->way), free(s->unit);
    free(s->tone.damping), free(s->tone.by_omega), free(s->tone.by_gain);
    free(s);
}

/* Whether the start given is one of a system like this. */
static bool has_start(const struct torus_solver *s, const struct torus_point *out)
{
    const struct torus_point *start = s->opt->start;

    return start != NULL && start->converged && s->q > 0 && start->q == s->q
        && start->tones.count == s->tones.count && start->part.of == out->part.of
        && start->part.tone == out->part.tone;
}

/* The first set of OUT's motion, or that of the order asked for, and with a free tone a motion on
 * it; *BEGUN. */
static enum modal_status begin(struct torus_solver *s, const struct torus_point *out, bool *begun,
                               struct modal_error *err)
{
    int order = s->q == 0 ? 0 : s->opt->order > 0 ? s->opt->order : FIRST_ORDER;
    enum modal_status rc = MODAL_OK;

    *begun = true;
    if (has_start(s, out))
        return torus_begin_from(s, order, err);
    if (s->tone.index >= 0 && s->q > 0)
        rc = torus_begin(s, begun, err);
    if (rc == MODAL_OK && (s->tone.index < 0 || s->opt->order > 0))
        rc = torus_grow_to_order(s, order, err);
    return rc;
}

/* Stability, and the error where the system's own motion has more than was seen at fixed phases. */
static enum modal_status judge(struct torus_solver *s, struct torus_point *out,
                               struct modal_error *err)
{
    double missed = 0, target = torus_target(s), leave;
    enum modal_status rc;

    if (s->marched > 0 && s->followed.count > 0) {
        out->stability = s->followed;
        for (int l = 0; out->stability.verdict > 0 && l < s->p->laws; l++)
            if (torus_undetermined(s->laws, l))
                out->stability = (struct torus_stability) { .reason = TORUS_RESTS };
        return MODAL_OK;
    }
    leave = s->marched > 0 ? fmin(out->error, THIN * out->amplitude) : SMALL * out->error;
    rc = torus_judge(s, condense_place(s->condense[0]), &out->stability, leave, &missed, err);
    if (s->marched > 0 && out->stability.verdict < 0)
        out->stability.verdict = 0;       /* a march leaves what grows: that is of those left out */
    if (rc != MODAL_OK || missed <= out->error)
        return rc;
    out->truncation += missed - out->error;
    out->error = out->line = missed;
    out->wanting = out->error > target * out->amplitude;
    if (out->error >= out->amplitude) {
        out->converged = false;
        out->stability = (struct torus_stability) { 0 };
        s->reason = "the motion balanced does not last: along a part of the phases what it leaves "
                    "out grows to its own size";
    }
    return rc;
}

/* The motion: of laws with events marched exactly, which asks for no balance and so serves any
 * number of dofs; else balanced.  Lines that are not as good as was asked stand where there are too
 * many dofs to balance. */
static enum modal_status find_motion(struct torus_solver *s, struct torus_point *out,
                                     struct modal_error *err)
{
    struct torus_lines lines = { 0 };
    bool met = false, begun = false;
    enum modal_status rc = MODAL_OK;

    if (s->q > 0 && !torus_smooth(s->laws) && torus_march_takes(s, false))
        rc = march_exactly(s, &lines, out, &met, err);
    if (rc == MODAL_OK && !met && s->part.of == 0)
        rc = begin(s, out, &begun, err);
    if (rc == MODAL_TOO_LARGE && lines.count > 0 && torus_lines_stand(s, &lines, NULL)) {
        torus_adopt(s, &lines, torus_target(s), out);
        return MODAL_OK;
    }
    if (rc == MODAL_OK && s->q == 0)
        out->converged = true;
    else if (rc == MODAL_OK && begun)
        rc = solve_grown(s, &lines, out, err);
    torus_lines_done(&lines);
    return rc;
}

/* What a program comes to before any motion is looked for: its loads' combinations and the linear
 * part of each, its laws, and the directions that its structure leaves open. */
static enum modal_status set_up(struct torus_solver *s, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (s->p->harmonics > 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "tones",
                                "tones: the scene's matrices have a period of their own");
    rc = torus_read_loads(s, err);
    for (int g = 0; rc == MODAL_OK && g <= s->groups; g++)
        rc = torus_new_group(s, g, err);
    if (rc != MODAL_OK)
        return rc;
    s->q = condense_kept(s->condense[0]);
    if (s->tone.index >= 0 && s->q == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "tones",
                                "tones: a free tone needs a law; a linear system has no motion "
                                "that lasts by itself");
    rc = torus_laws_new(s->p, &s->tones, condense_place(s->condense[0]), s->q, s->work, &s->laws,
                        err);
    return rc == MODAL_OK && s->q > 0 ? torus_find_ways(s, err) : rc;
}

/* torus_solve of tones that are not folded, PART in the place of one, its work SPENT more; where
 * the motion marched to repeats after some turns of one OUT is none, and those are *FOUND. */
static enum modal_status solve_tones(const struct program *p, const double *omega, int count,
                                     const struct torus_options *opt, struct torus_part part,
                                     double spent, struct torus_point *out,
                                     struct torus_part *found, struct modal_error *err)
{
    struct torus_solver *s = calloc(1, sizeof *s);
    double tones[TORUS_TONES_MOST] = { 0 };
    bool known = opt->start != NULL && opt->start->tones.count == count;
    enum modal_status rc;

    memcpy(tones, omega, (size_t)count * sizeof *omega);
    if (opt->free > 0)                     /* slower than any other until it is known */
        tones[opt->free - 1] = known       ? opt->start->tones.omega[opt->free - 1]
                               : count > 1 ? 1e-3 * omega[opt->free > 1 ? 0 : 1]
                                           : 1;
    *out = (struct torus_point) { .tones = torus_tones_of(tones, count),
                                  .part = part,
                                  .work = { spent, opt->near ? WORK_NEAR : WORK_MOST },
                                  .evaluations = calloc((size_t)p->laws + 1, sizeof(long)),
                                  .acts = calloc((size_t)p->laws + 1, sizeof(bool)),
                                  .undetermined = calloc((size_t)p->laws + 1, sizeof(bool)) };
    if (s == NULL || out->evaluations == NULL || out->acts == NULL || out->undetermined == NULL) {
        free(s);
        torus_point_done(out);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
    }
    *s = (struct torus_solver) { .view = *p, .p = p, .opt = opt, .tones = out->tones,
                                 .work = &out->work, .tone = { .index = opt->free - 1 },
                                 .level = 1 };
    rc = set_up(s, err);
    if (rc == MODAL_OK)
        rc = find_motion(s, out, err);
    if (rc == MODAL_OK && out->converged && s->q > 0)
        rc = torus_open(s, err);
    out->open = s->open > 0;
    if (rc == MODAL_OK && out->converged && opt->stability)
        rc = judge(s, out, err);
    if (rc == MODAL_OK) {
        out->tones = s->tones;
        count_laws(s, out);
        rc = report(s, out, err);
    }
    *found = s->part;
    solver_done(s);
    if (rc != MODAL_OK)
        torus_point_done(out);
    return rc;
}

/* Why there is no motion of the tones. */
static const char *repeats_later(struct torus_part part)
{
#define AFTER(of, tone) \
    "marched from the scene's initial state it settles and repeats after " #of " turns of the " \
    tone " tone, but its lines at parts of that tone were not told"
#define PARTS(tone) { [2] = AFTER(2, tone), AFTER(3, tone), AFTER(4, tone), AFTER(5, tone) }
    static const char *const text[TORUS_TONES_MOST][TORUS_PARTS_MOST + 1] = {
        PARTS("first"), PARTS("second"), PARTS("third")
    };
#undef PARTS
#undef AFTER

    return text[part.tone][part.of];
}

/* solve_tones of tones given, with PART in place of its own, of which loads have as many times
 * their number. */
static enum modal_status solve_part(const struct program *p, const double *omega, int count,
                                    const struct torus_options *opt, struct torus_part part,
                                    double spent, struct torus_point *out,
                                    struct modal_error *err)
{
    struct program view = *p;
    struct torus_part more;
    double divided[TORUS_TONES_MOST] = { 0 };
    enum modal_status rc;

    view.load = malloc(((size_t)p->loads + 1) * sizeof *view.load);
    if (view.load == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for loads");
    for (int i = 0; i < p->loads; i++) {
        view.load[i] = p->load[i];
        if (p->load[i].k != 0)            /* one number counts the first, 0 none */
            view.load[i].tones = count;
        view.load[i].tone[part.tone] *= part.of;
    }
    memcpy(divided, omega, (size_t)count * sizeof *omega);
    divided[part.tone] /= part.of;
    rc = solve_tones(&view, divided, count, opt, part, spent, out, &more, err);
    if (rc == MODAL_OK && !out->converged)
        out->reason = repeats_later(part);
    free(view.load);
    return rc;
}

/* Whether a load of P names more than COUNT tones: it has no place among as many. */
static bool has_more_tones(const struct program *p, int count)
{
    bool more = false;

    for (int i = 0; i < p->loads; i++)
        more = more || p->load[i].tones > count;
    return more;
}

/* torus_solve of these tones, or of a part of one of them where its turns ask for that. */
static enum modal_status solve_or_part(const struct program *p, const double *omega, int count,
                                       const struct torus_options *opt, struct torus_point *out,
                                       struct modal_error *err)
{
    struct torus_part part = { 0 };
    double spent;
    enum modal_status rc = solve_tones(p, omega, count, opt, part, 0, out, &part, err);

    if (rc != MODAL_OK || part.of == 0)
        return rc;
    spent = out->work.spent;
    torus_point_done(out);
    return solve_part(p, omega, count, opt, part, spent, out, err);
}

enum modal_status torus_solve(const struct program *p, const double *omega, int count,
                              const struct torus_options *opt, struct torus_point *out,
                              struct modal_error *err)
{
    struct torus_fold fold;
    enum modal_status rc;

    if (opt->near && opt->start != NULL && opt->start->part.of > 0)
        return solve_part(p, omega, count, opt, opt->start->part, 0, out, err);
    if (opt->free > 0 || opt->order > 0 || has_more_tones(p, count)
        || !torus_fold_finds(omega, count, &fold))
        return solve_or_part(p, omega, count, opt, out, err);
    rc = torus_fold_make(&fold, p, opt, err);
    if (rc == MODAL_OK)
        rc = solve_or_part(&fold.view, fold.omega, fold.tones, &fold.opt, out, err);
    if (rc == MODAL_OK && (rc = torus_fold_undo(&fold, omega, out, err)) != MODAL_OK)
        torus_point_done(out);
    torus_fold_done(&fold);
    return rc;
}

void torus_point_done(struct torus_point *point)
{
    free(point->index), free(point->X), free(point->evaluations), free(point->acts);
    free(point->undetermined), free(point->start);
    *point = (struct torus_point) { 0 };
}
