/* torus_laws.c - see torus_laws.h; tested by tests/unit/modal/steady/test_torus.c
 *
 * Quadrature.  Along a line the force f has kinks.  With a jump [f'] of its slope and [f''] of its
 * curvature at theta_e, xi = frac(theta_e / h), h = 2 pi / N, g = f e^{-i Omega theta},
 *
 *     int g = h sum_n g(n h) + h^2 / 2 B_2(xi) [g'] - h^3 / 6 B_3(xi) [g''] + O(h^4),           (1)
 *     [g'] = [f'] e, [g''] = ([f''] - 2 i Omega [f']) e,   e = e^{-i Omega theta_e},
 *
 * Euler and Maclaurin's formula on both sides of the kink, B_m Bernoulli's polynomials.  Across the
 * lines the integrals are smooth but where an event begins, and even sums serve.
 *
 * Between samples the motion is the cubic through both ends and their rates.  A path is cut where a
 * rate changes sign, so that a slider's law sees monotone pieces (slider.c (1)).
 *
 * Memory.  The map of a slider's place over any stretch is one clip, to [low, high]: both are found
 * by starting above and below all motion.  Clips of earlier turns are set before those of later
 * ones until they leave one place: then the past is forgotten, on each line after its own number of
 * turns.  Where the motion is too small for that the slider rests for good, at the place nearest to
 * zero.
 */
#include "modal/steady/torus_laws_state.h"
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/numbers.h"
#include "modal/scene/program.h"
#include "modal/steady/budget.h"

enum {
    TURNS_MOST = 512,         /* of history: ten slow beats of tones one per cent apart need 300 */
    MORE = 1,                 /* turns of motions beside one whose history is known: what it just
                               * forgets they may just remember */
    HALVINGS = 46,            /* of an interval: to rounding */
    EVENTS_OF_A_STEP = 16,    /* sliders of one law that change regime in one sample */
};
static const double FORGOTTEN = 1e-11;    /* of the largest motion: places that agree */
static const double FAR = 1e290;          /* beyond any motion, and finite */

/* A law on its way along a line: where it is, and what it has come with. */
struct walker {
    double d[LAW_INPUTS_MOST];
    struct law_force force;             /* its memory is z */
    double z[LAW_TERMS_MOST];           /* as many as the law remembers */
};

/* One interval between samples. */
struct stretch {
    int inputs;
    double length;                                   /* s */
    double d[2][LAW_INPUTS_MOST], v[2][LAW_INPUTS_MOST];
};

enum modal_status torus_laws_new(const struct program *p, const struct torus_tones *t,
                                 const int *place, int q, struct budget *work,
                                 struct torus_laws **out, struct modal_error *err)
{
    struct torus_laws *w = calloc(1, sizeof *w);

    if (w == NULL || (w->law = calloc((size_t)p->laws + 1, sizeof *w->law)) == NULL) {
        free(w);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
    }
    w->tones = *t;
    w->q = q, w->laws = p->laws, w->work = work;
    for (int l = 0; l < p->laws; l++) {
        const struct law *law = &p->law[l];

        w->law[l].law = law;
        w->law[l].place = calloc((size_t)law_ends(law) + 1, sizeof *w->law[l].place);
        if (w->law[l].place == NULL) {
            torus_laws_free(w);
            return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
        }
        for (int e = 0; e < law_ends(law); e++)
            w->law[l].place[e] = place[law->end[e].dof];
        if (law->kind->set_valued || law->kind->reads_time || law->kind->restart != NULL) {
            torus_laws_free(w);
            return modal_fail_field(err, MODAL_BAD_INPUT, "tones",
                                    "tones: %s is not accepted with several tones: %s",
                                    p->effect[law->effect].type,
                                    law->kind->set_valued
                                        ? "its force at rest is not a function of the motion; give "
                                          "friction with a stiffness, or regularised_coulomb"
                                        : "it may keep a time and a memory of its own");
        }
    }
    *out = w;
    return MODAL_OK;
}

static void free_room(struct torus_laws *w)
{
    free(w->d), free(w->v), free(w->f), free(w->fd), free(w->fv);
    w->d = w->v = w->f = w->fd = w->fv = NULL;
    for (int l = 0; l < w->laws; l++) {
        free(w->law[l].slopes);
        w->law[l].slopes = NULL;
    }
    w->points = 0;
}

void torus_laws_free(struct torus_laws *w)
{
    if (w == NULL)
        return;
    free_room(w);
    for (int l = 0; l < w->laws; l++)
        free(w->law[l].event), free(w->law[l].place), free(w->law[l].turns);
    free(w->law), free(w->D), free(w);
}

/* Room for samples of grid G and COUNT combinations. */
static enum modal_status make_room(struct torus_laws *w, const struct torus_grid *g, int count,
                                   struct modal_error *err)
{
    size_t points = (size_t)torus_grid_lines(g) * (size_t)torus_grid_samples(g), m = 1;
    bool failed = false;

    for (int l = 0; l < w->laws; l++)
        m = (size_t)w->law[l].law->kind->inputs > m ? (size_t)w->law[l].law->kind->inputs : m;

    if (points != w->points) {
        free_room(w);
        w->d = malloc(m * points * sizeof *w->d), w->v = malloc(m * points * sizeof *w->v);
        w->f = malloc(m * points * sizeof *w->f);
        w->fd = malloc(m * m * points * sizeof *w->fd);
        w->fv = malloc(m * m * points * sizeof *w->fv);
        for (int l = 0; l < w->laws; l++) {
            size_t n = (size_t)w->law[l].law->kind->inputs;

            w->law[l].slopes = malloc(2 * n * n * points * sizeof(double));
            failed |= w->law[l].slopes == NULL;
        }
        w->points = points;
    }
    if (count > w->combinations) {
        free(w->D);
        w->D = malloc((size_t)count * sizeof *w->D);
        w->combinations = w->D != NULL ? count : 0;
    }
    if (w->d == NULL || w->v == NULL || w->f == NULL || w->fd == NULL || w->fv == NULL
        || w->D == NULL || failed) {
        free_room(w);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %zu samples", points);
    }
    return MODAL_OK;
}

/* d and v of a law's inputs, TURN turns on. */
static void sample_inputs(struct torus_laws *w, const struct torus_law *a, struct torus_grid *g,
                          int count, const struct torus_index *index, const double complex *X,
                          int turn)
{
    for (int j = 0; j < a->law->kind->inputs; j++) {
        memset(w->D, 0, (size_t)count * sizeof *w->D);
        for (int e = a->law->start[j]; e < a->law->start[j + 1]; e++)
            for (int m = 0; m < count; m++)
                w->D[m] += a->law->end[e].weight * X[a->place[e] * count + m];
        torus_synthesize_both(g, count, index, w->D, turn, w->d + (size_t)j * w->points,
                              w->v + (size_t)j * w->points);
    }
    budget_add(w->work, (double)w->points * a->law->kind->inputs * BUDGET_SAMPLE / 4);
}

/* The motion at fraction S of a stretch: place, rate and the rate of that. */
static void motion_at(const struct stretch *x, double s, double *d, double *v, double *a)
{
    for (int j = 0; j < x->inputs; j++) {
        double T = x->length, v0 = x->v[0][j] * T, v1 = x->v[1][j] * T;
        double rise = x->d[1][j] - x->d[0][j];
        double c2 = 3 * rise - 2 * v0 - v1, c3 = v0 + v1 - 2 * rise;

        d[j] = x->d[0][j] + s * (v0 + s * (c2 + s * c3));
        v[j] = (v0 + s * (2 * c2 + 3 * s * c3)) / T;
        a[j] = (2 * c2 + 6 * s * c3) / (T * T);
    }
}

/* The law at fraction S, come from FROM. */
static enum modal_status law_at(struct torus_law *a, const struct stretch *x, double s,
                                const struct walker *from, struct walker *to,
                                struct modal_error *err)
{
    double v[LAW_INPUTS_MOST], bend[LAW_INPUTS_MOST];
    struct law_point at = { .d = to->d, .v = v, .memory_before = from->z };

    motion_at(x, s, to->d, v, bend);
    to->force = (struct law_force) { .memory = to->z };
    a->evaluations++;
    return a->law->kind->force(a->law, &at, &to->force, err);
}

/* What of a walker there is. */
static void copy_walker(const struct torus_law *a, struct walker *to, const struct walker *from)
{
    memcpy(to, from, offsetof(struct walker, z) + (size_t)a->law->memory * sizeof *to->z);
}

/* [f'] and [f''] of (1) at fraction S, between the regimes of BEFORE and AFTER. */
static enum modal_status add_event(struct torus_law *a, const struct stretch *x, double s,
                                   const struct law_force *before, const struct law_force *after,
                                   int line, double theta, double rate, struct modal_error *err)
{
    double d[LAW_INPUTS_MOST], v[LAW_INPUTS_MOST], bend[LAW_INPUTS_MOST];
    struct event e = { .line = line, .theta = theta };

    motion_at(x, s, d, v, bend);
    for (int i = 0; i < x->inputs; i++)
        for (int j = 0; j < x->inputs; j++) {
            double jump_d = after->fd[i][j] - before->fd[i][j];
            double jump_v = after->fv[i][j] - before->fv[i][j];

            e.slope[i] += (jump_d * v[j] + jump_v * bend[j]) / rate;   /* per radian of theta */
            e.bend[i] += jump_d * bend[j] / (rate * rate);
        }
    if (a->events == a->room) {
        int room = 2 * a->room + 64;
        struct event *more = realloc(a->event, (size_t)room * sizeof *more);

        if (more == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %d events", room);
        a->event = more;
        a->room = room;
    }
    a->event[a->events++] = e;
    return MODAL_OK;
}

struct cursor { int line; double theta, step, rate; bool collect; };   /* where a stretch begins */

/* From fraction *S to END, monotone: every change of regime in between is an event. */
static enum modal_status advance(struct torus_law *a, const struct stretch *x, double s, double end,
                                 struct walker *at, const struct cursor *c, struct modal_error *err)
{
    struct walker next, left, right;
    enum modal_status rc = law_at(a, x, end, at, &next, err);

    for (int i = 0; rc == MODAL_OK && c->collect && i < EVENTS_OF_A_STEP
                    && next.force.regime != at->force.regime; i++) {
        double low = s, high = end;

        copy_walker(a, &left, at), copy_walker(a, &right, &next);
        for (int h = 0; rc == MODAL_OK && h < HALVINGS; h++) {
            struct walker middle;
            double half = 0.5 * (low + high);
            bool same;

            rc = law_at(a, x, half, at, &middle, err);
            same = middle.force.regime == at->force.regime;
            *(same ? &low : &high) = half;
            copy_walker(a, same ? &left : &right, &middle);
        }
        if (rc == MODAL_OK)
            rc = add_event(a, x, high, &left.force, &right.force, c->line,
                           c->theta + high * c->step, c->rate, err);
        copy_walker(a, at, &right);
        s = high;
        if (rc == MODAL_OK)
            rc = law_at(a, x, end, at, &next, err);
    }
    copy_walker(a, at, &next);
    return rc;
}

/* Along a stretch, cut where a rate changes sign. */
static enum modal_status walk(struct torus_law *a, const struct stretch *x, struct walker *at,
                              const struct cursor *c, struct modal_error *err)
{
    double cut[LAW_INPUTS_MOST + 1], s = 0;
    int cuts = 0;
    enum modal_status rc = MODAL_OK;

    for (int j = 0; j < x->inputs; j++)
        if (x->v[0][j] * x->v[1][j] < 0) {              /* the cubic's rate is a quadratic */
            double T = x->length, v0 = x->v[0][j] * T, v1 = x->v[1][j] * T;
            double rise = x->d[1][j] - x->d[0][j];
            double A = 3 * (v0 + v1 - 2 * rise), B = 2 * (3 * rise - 2 * v0 - v1);
            double root = sqrt(fmax(B * B - 4 * A * v0, 0)), m = -0.5 * (B + copysign(root, B));
            double s1 = m != 0 ? v0 / m : 0.5, s2 = A != 0 ? m / A : s1;

            cut[cuts++] = s1 > 0 && s1 < 1 ? s1 : s2 > 0 && s2 < 1 ? s2 : v0 / (v0 - v1);
        }
    if (cuts == 2 && cut[0] > cut[1]) {
        double first = cut[1];

        cut[1] = cut[0];
        cut[0] = first;
    }
    cut[cuts++] = 1;
    for (int i = 0; rc == MODAL_OK && i < cuts; i++) {
        rc = advance(a, x, s, cut[i], at, c, err);
        s = cut[i];
    }
    return rc;
}

/* A law's force, slopes and regime at sample N of line LINE into the arrays. */
static void keep_sample(struct torus_laws *w, struct torus_law *a, size_t point,
                        const struct law_force *out)
{
    int inputs = a->law->kind->inputs;

    for (int i = 0; i < inputs; i++) {
        w->f[(size_t)i * w->points + point] = out->f[i];
        for (int j = 0; j < inputs; j++) {
            w->fd[(size_t)(i * inputs + j) * w->points + point] = out->fd[i][j];
            w->fv[(size_t)(i * inputs + j) * w->points + point] = out->fv[i][j];
        }
    }
    a->acts |= out->acts;
}

/* From sample N - 1 to N of line LINE, or to N alone where there is none before. */
static enum modal_status step_to(struct torus_laws *w, struct torus_law *a, size_t point,
                                 bool first, struct walker *at, double *before,
                                 const struct cursor *c, struct modal_error *err)
{
    struct stretch x = { .inputs = a->law->kind->inputs, .length = c->step / c->rate };
    struct walker next;
    enum modal_status rc;

    for (int j = 0; j < x.inputs; j++) {
        x.d[0][j] = before[2 * j], x.v[0][j] = before[2 * j + 1];
        x.d[1][j] = w->d[(size_t)j * w->points + point];
        x.v[1][j] = w->v[(size_t)j * w->points + point];
        before[2 * j] = x.d[1][j], before[2 * j + 1] = x.v[1][j];
    }
    if (!first)
        return walk(a, &x, at, c, err);
    memcpy(at->d, x.d[1], sizeof at->d);
    rc = law_at(a, &x, 1, at, &next, err);
    copy_walker(a, at, &next);
    return rc;
}

/* Line LINE of the turn at hand, from the walker's state; KEEP: the samples and events are kept. */
static enum modal_status walk_line(struct torus_laws *w, struct torus_law *a,
                                   const struct torus_grid *g, int line, bool first, bool keep,
                                   struct walker *at, double *before, struct modal_error *err)
{
    int N = torus_grid_samples(g);
    double h = 2 * M_PI / N, rate = w->tones.omega[w->tones.lead];
    enum modal_status rc = MODAL_OK;

    for (int n = 0; rc == MODAL_OK && n < N; n++) {
        size_t point = (size_t)line * (size_t)N + (size_t)n;
        struct cursor c = { line, (n - 1) * h, h, rate, keep };

        rc = step_to(w, a, point, first && n == 0, at, before, &c, err);
        if (rc == MODAL_OK && keep)
            keep_sample(w, a, point, &at->force);
    }
    budget_add(w->work, (double)N * BUDGET_SAMPLE);
    return rc;
}

/* The motion to walk, that of torus_forces. */
struct motion { int count; const struct torus_index *index; const double complex *X; };

/* The walkers at the end of the turn before now, each begun at 0 as many turns before as its line
 * needs. */
static enum modal_status history(struct torus_laws *w, struct torus_law *a, struct torus_grid *g,
                                 const struct motion *x, struct walker *walker, double *before,
                                 struct modal_error *err)
{
    int lines = torus_grid_lines(g), most = 1;
    enum modal_status rc = MODAL_OK;

    memset(walker, 0, (size_t)lines * sizeof *walker);
    for (int line = 0; line < lines; line++)
        most = a->turns[line] + MORE > most ? a->turns[line] + MORE : most;
    for (int turn = most; rc == MODAL_OK && turn > 0; turn--) {
        sample_inputs(w, a, g, x->count, x->index, x->X, -turn);
        for (int line = 0; rc == MODAL_OK && line < lines; line++)
            if (a->turns[line] + MORE >= turn)
                rc = walk_line(w, a, g, line, a->turns[line] + MORE == turn, false, &walker[line],
                               before + 2 * LAW_INPUTS_MOST * line, err);
    }
    return rc;
}

/* The largest |d| of the samples at hand, and the range of the last input: a slider's. */
static double largest_motion(const struct torus_laws *w, const struct torus_law *a, double *range)
{
    size_t inputs = (size_t)a->law->kind->inputs;
    double low = HUGE_VAL, high = -HUGE_VAL;

    for (size_t i = w->points * (inputs - 1); i < w->points * inputs; i++)
        low = fmin(low, w->d[i]), high = fmax(high, w->d[i]);
    *range = high - low;
    return numbers_largest(w->d, w->points * inputs);
}

/* A walker whose places were changed, where it stands: its force and regime are theirs. */
static enum modal_status stand(struct torus_law *a, struct walker *at, const double *before,
                               struct modal_error *err)
{
    struct stretch x = { .inputs = a->law->kind->inputs, .length = 1 };
    struct walker next;
    enum modal_status rc;

    for (int j = 0; j < x.inputs; j++)
        x.d[1][j] = before[2 * j], x.v[1][j] = before[2 * j + 1];
    rc = law_at(a, &x, 1, at, &next, err);
    copy_walker(a, at, &next);
    return rc;
}

/* What a line remembers: its places' clip over all turns looked at, to the end of the last; where
 * it stands there; and how the turn after the next one to look at begins. */
struct memory {
    double low[LAW_TERMS_MOST], high[LAW_TERMS_MOST], reach;
    double end[2 * LAW_INPUTS_MOST], begin[2 * LAW_INPUTS_MOST];
    bool open;                          /* low and high differ still */
};

/* The clip of line LINE's turn at hand, TURN before now, before the ones that M has: from START,
 * beyond all motion, into PLACE; to the next turn's first sample, but of the last to its end. */
static enum modal_status clip_turn(struct torus_laws *w, struct torus_law *a,
                                   const struct torus_grid *g, int line, int turn, double start,
                                   struct memory *m, double *place, struct modal_error *err)
{
    int inputs = a->law->kind->inputs;
    double h = 2 * M_PI / torus_grid_samples(g), before[2 * LAW_INPUTS_MOST] = { 0 };
    struct cursor c = { line, 0, h, w->tones.omega[w->tones.lead], false };
    struct stretch x = { .inputs = inputs, .length = h / c.rate };
    struct walker at = { 0 }, from;
    size_t first = (size_t)line * (size_t)torus_grid_samples(g);
    enum modal_status rc;

    for (int i = 0; i < a->law->memory; i++)
        at.z[i] = start;
    for (int j = 0; j < inputs; j++)
        before[2 * j] = w->d[(size_t)j * w->points + first];
    copy_walker(a, &from, &at);
    for (int j = 0; j < inputs; j++)
        x.d[1][j] = before[2 * j];
    rc = law_at(a, &x, 1, &from, &at, err);
    for (int i = 0; i < a->law->memory; i++)      /* how far a slider acts from where it holds */
        m->reach = fmin(m->reach, fabs(at.z[i] - at.d[inputs - 1]));
    for (int i = 0; i < a->law->memory; i++)
        at.z[i] = start;
    if (rc == MODAL_OK)
        rc = walk_line(w, a, g, line, true, false, &at, before, err);
    if (turn == 1)
        memcpy(m->end, before, sizeof before);
    else
        for (int j = 0; j < inputs; j++) {
            x.d[0][j] = before[2 * j], x.v[0][j] = before[2 * j + 1];
            x.d[1][j] = m->begin[2 * j], x.v[1][j] = m->begin[2 * j + 1];
        }
    if (rc == MODAL_OK && turn > 1)
        rc = walk(a, &x, &at, &c, err);
    memcpy(place, at.z, (size_t)a->law->memory * sizeof *place);
    return rc;
}

/* One turn further back on LINE; MOST: the largest motion. */
static enum modal_status look_back(struct torus_laws *w, struct torus_law *a,
                                   const struct torus_grid *g, int line, int turn, double most,
                                   struct memory *m, struct modal_error *err)
{
    double low[LAW_TERMS_MOST], high[LAW_TERMS_MOST];
    size_t first = (size_t)line * (size_t)torus_grid_samples(g);
    enum modal_status rc = clip_turn(w, a, g, line, turn, -FAR, m, low, err);

    if (rc == MODAL_OK)
        rc = clip_turn(w, a, g, line, turn, FAR, m, high, err);
    m->open = false;
    for (int i = 0; rc == MODAL_OK && i < a->law->memory; i++) {
        m->low[i] = fmin(fmax(low[i], m->low[i]), m->high[i]);
        m->high[i] = fmin(fmax(high[i], m->low[i]), m->high[i]);
        m->open |= m->high[i] - m->low[i] > FORGOTTEN * most;
    }
    for (int j = 0; j < a->law->kind->inputs; j++) {
        m->begin[2 * j] = w->d[(size_t)j * w->points + first];
        m->begin[2 * j + 1] = w->v[(size_t)j * w->points + first];
    }
    return rc;
}

/* How many turns every line of A needs to be looked back along until its turns' clips leave one
 * place.  Where the motion's range is within a slider's reach on both sides it holds for good: A is
 * undetermined, and WALKER is what it holds at the end of the turn before now. */
static enum modal_status remember(struct torus_laws *w, struct torus_law *a, struct torus_grid *g,
                                  const struct motion *x, struct walker *walker, double *before,
                                  struct modal_error *err)
{
    int lines = torus_grid_lines(g), open = lines;
    struct memory *memory = malloc((size_t)lines * sizeof *memory);
    enum modal_status rc = memory == NULL ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory")
                                          : MODAL_OK;

    for (int line = 0; rc == MODAL_OK && line < lines; line++) {
        memory[line] = (struct memory) { .reach = HUGE_VAL, .open = true };
        for (int i = 0; i < a->law->memory; i++)
            memory[line].low[i] = -FAR, memory[line].high[i] = FAR;
    }
    for (int turn = 1; rc == MODAL_OK && open > 0 && turn <= TURNS_MOST; turn++) {
        double range, most, reach = HUGE_VAL;

        sample_inputs(w, a, g, x->count, x->index, x->X, -turn);
        most = largest_motion(w, a, &range);
        open = 0;
        for (int line = 0; rc == MODAL_OK && line < lines; line++) {
            if (memory[line].open) {
                rc = look_back(w, a, g, line, turn, most, &memory[line], err);
                a->turns[line] = turn;
            }
            reach = fmin(reach, memory[line].reach);
            open += memory[line].open;
        }
        if (range <= 2 * reach)
            break;
    }
    a->undetermined = open > 0;
    for (int line = 0; rc == MODAL_OK && a->undetermined && line < lines; line++) {
        const struct memory *m = &memory[line];

        memset(&walker[line], 0, sizeof walker[line]);
        memcpy(before + 2 * LAW_INPUTS_MOST * line, m->end, sizeof m->end);
        for (int j = 0; j < a->law->kind->inputs; j++)
            walker[line].d[j] = m->end[2 * j];
        for (int i = 0; i < a->law->memory; i++)     /* low's bound is the least place */
            walker[line].z[i] = fmax(fmin(0, m->high[i]), m->low[i]);
        rc = stand(a, &walker[line], before + 2 * LAW_INPUTS_MOST * line, err);
    }
    free(memory);
    return rc;
}

/* f, fd, fv at the samples, and the events between them. */
static enum modal_status evaluate(struct torus_laws *w, struct torus_law *a, struct torus_grid *g,
                                  const struct motion *x, struct modal_error *err)
{
    int lines = torus_grid_lines(g);
    struct walker *walker = malloc((size_t)lines * sizeof *walker);
    double *before = calloc((size_t)lines * 2 * LAW_INPUTS_MOST, sizeof *before);
    bool known = a->lines == lines;
    int *turns = known ? a->turns : realloc(a->turns, (size_t)lines * sizeof *turns);
    enum modal_status rc = MODAL_OK;

    a->turns = turns != NULL ? turns : a->turns;
    if (walker == NULL || before == NULL || turns == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %d lines", lines);
    a->acts = false;
    a->events = 0;
    for (int line = 0; rc == MODAL_OK && !known && line < lines; line++)
        a->turns[line] = 1;
    a->lines = rc == MODAL_OK ? lines : 0;
    if (rc == MODAL_OK && a->law->memory > 0 && !(w->held && known && !a->undetermined))
        rc = remember(w, a, g, x, walker, before, err);
    /* walked, so that it comes in its regime */
    if (rc == MODAL_OK && (a->law->memory == 0 || !a->undetermined))
        rc = history(w, a, g, x, walker, before, err);
    if (rc == MODAL_OK)
        sample_inputs(w, a, g, x->count, x->index, x->X, 0);
    for (int line = 0; rc == MODAL_OK && line < lines; line++)
        rc = walk_line(w, a, g, line, false, true, &walker[line],
                       before + 2 * LAW_INPUTS_MOST * line, err);
    free(walker);
    free(before);
    return rc;
}

/* The same of a law that is analytic: nothing to locate. */
static enum modal_status evaluate_smooth(struct torus_laws *w, struct torus_law *a,
                                         struct torus_grid *g, const struct motion *x,
                                         struct modal_error *err)
{
    int inputs = a->law->kind->inputs;
    enum modal_status rc = MODAL_OK;

    a->events = 0;
    sample_inputs(w, a, g, x->count, x->index, x->X, 0);
    for (size_t point = 0; rc == MODAL_OK && point < w->points; point++) {
        double d[LAW_INPUTS_MOST], v[LAW_INPUTS_MOST];
        struct law_point at = { .d = d, .v = v };
        struct law_force out = { 0 };

        for (int j = 0; j < inputs; j++) {
            d[j] = w->d[(size_t)j * w->points + point];
            v[j] = w->v[(size_t)j * w->points + point];
        }
        rc = a->law->kind->force(a->law, &at, &out, err);
        keep_sample(w, a, point, &out);
    }
    a->evaluations += (long)w->points;
    budget_add(w->work, (double)w->points * BUDGET_SAMPLE / 2);
    return rc;
}

/* e^{-i k theta}, k = -most .. most, into E[most + k]. */
static void rotations(double theta, int most, double complex *E)
{
    double complex turn = CMPLX(cos(theta), -sin(theta));

    E[most] = 1;
    for (int k = 1; k <= most; k++) {
        E[most + k] = k % 32 == 0 ? CMPLX(cos(k * theta), -sin(k * theta)) : E[most + k - 1] * turn;
        E[most - k] = conj(E[most + k]);
    }
}

/* The corrections of (1) to <f_i e^{-i k . theta}> of the combinations AT, added to MEAN. */
static enum modal_status correct(const struct torus_laws *w, const struct torus_law *a, int i,
                                 const struct torus_grid *g, int wanted,
                                 const struct torus_index *at, double complex *mean,
                                 struct modal_error *err)
{
    double h = 2 * M_PI / torus_grid_samples(g), scale = 1 / (2 * M_PI * torus_grid_lines(g));
    int most = 0;
    double complex *E;
    double *Omega = malloc(((size_t)wanted + 1) * sizeof *Omega);

    for (int m = 0; m < wanted; m++)
        for (int j = 0; j < w->tones.count; j++)
            most = abs(at[m].k[j]) > most ? abs(at[m].k[j]) : most;
    E = malloc((size_t)TORUS_TONES_MOST * (size_t)(2 * most + 1) * sizeof *E);
    if (E == NULL || Omega == NULL) {
        free(E), free(Omega);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %d combinations", wanted);
    }
    for (int m = 0; m < wanted; m++)
        Omega[m] = torus_frequency(&w->tones, at[m]) / w->tones.omega[w->tones.lead];
    for (int e = 0; e < a->events; e++) {
        const struct event *x = &a->event[e];
        double xi = x->theta / h - floor(x->theta / h);
        double B2 = xi * xi - xi + 1.0 / 6, B3 = xi * (xi - 0.5) * (xi - 1);
        double level = scale * (h * h / 2 * B2 * x->slope[i] - h * h * h / 6 * B3 * x->bend[i]);
        double turn = scale * h * h * h / 3 * B3 * x->slope[i];

        for (int j = 0; j < TORUS_TONES_MOST; j++)
            rotations(j < w->tones.count
                          ? torus_grid_phase(g, x->line, j) + w->tones.nu[j] * x->theta : 0,
                      most, E + (size_t)j * (size_t)(2 * most + 1));
        for (int m = 0; m < wanted; m++)
            mean[m] += CMPLX(level, turn * Omega[m]) * E[most + at[m].k[0]]
                * E[3 * most + 1 + at[m].k[1]] * E[5 * most + 2 + at[m].k[2]];
    }
    budget_add(w->work, (double)a->events * wanted * BUDGET_EVENT / 4);
    free(E), free(Omega);
    return MODAL_OK;
}

/* A law's force onto the dofs of its ends. */
static enum modal_status scatter(const struct torus_laws *w, const struct torus_law *a,
                                 struct torus_grid *g, int wanted, const struct torus_index *at,
                                 double complex *F, struct modal_error *err)
{
    double complex *mean = malloc(((size_t)wanted + 1) * sizeof *mean);
    enum modal_status rc = mean == NULL ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory")
                                        : MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < a->law->kind->inputs; i++) {
        torus_analyze(g, w->f + (size_t)i * w->points);
        for (int m = 0; m < wanted; m++)
            mean[m] = torus_coefficient(g, at[m]);
        if (a->events > 0)
            rc = correct(w, a, i, g, wanted, at, mean, err);
        for (int m = 0; m < wanted; m++)                     /* one-sided, torus.h (1) */
            mean[m] = torus_order(at[m]) == 0 ? creal(mean[m]) : 2 * mean[m];
        for (int e = a->law->start[i]; e < a->law->start[i + 1]; e++)
            for (int m = 0; m < wanted; m++)
                F[a->place[e] * wanted + m] += a->law->end[e].weight * mean[m];
    }
    free(mean);
    return rc;
}

enum modal_status torus_forces(struct torus_laws *w, struct torus_grid *g, int count,
                               const struct torus_index *index, const double complex *X, int wanted,
                               const struct torus_index *at, double complex *F,
                               struct modal_error *err)
{
    const struct motion x = { count, index, X };
    enum modal_status rc = make_room(w, g, count, err);

    for (int i = 0; rc == MODAL_OK && i < w->q * count; i++)
        if (!isfinite(creal(X[i])) || !isfinite(cimag(X[i])))
            rc = modal_fail(err, MODAL_OVERFLOW, "torus: the motion is not finite");
    if (rc == MODAL_OK)
        memset(F, 0, (size_t)w->q * (size_t)wanted * sizeof *F);
    for (int l = 0; rc == MODAL_OK && l < w->laws; l++) {
        struct torus_law *a = &w->law[l];
        size_t n = (size_t)a->law->kind->inputs, slopes = n * n * w->points;

        rc = a->law->kind->smooth && a->law->memory == 0 ? evaluate_smooth(w, a, g, &x, err)
                                                         : evaluate(w, a, g, &x, err);
        if (rc != MODAL_OK)
            break;
        memcpy(a->slopes, w->fd, slopes * sizeof *w->fd);
        memcpy(a->slopes + slopes, w->fv, slopes * sizeof *w->fv);
        rc = scatter(w, a, g, wanted, at, F, err);
    }
    return rc;
}

void torus_laws_retune(struct torus_laws *w, const struct torus_tones *t) { w->tones = *t; }
void torus_note(struct torus_laws *w, int law, bool acts, long evaluations)
{
    w->law[law].acts = acts;
    w->law[law].undetermined = w->law[law].law->memory > 0 && !acts;
    w->law[law].evaluations += evaluations;
}

void torus_hold(struct torus_laws *w, bool held) { w->held = held; }
long torus_evaluations(const struct torus_laws *w, int law) { return w->law[law].evaluations; }
double torus_events_work(const struct torus_laws *w)
{
    double events = 0;

    for (int l = 0; l < w->laws; l++)
        events += (double)w->law[l].events * w->law[l].law->kind->inputs;
    return events * BUDGET_EVENT / 4;
}

bool torus_acts(const struct torus_laws *w, int law) { return w->law[law].acts; }
bool torus_undetermined(const struct torus_laws *w, int law) { return w->law[law].undetermined; }

bool torus_smooth(const struct torus_laws *w)
{
    for (int l = 0; l < w->laws; l++)
        if (!w->law[l].law->kind->smooth || w->law[l].law->memory > 0)
            return false;
    return true;
}
