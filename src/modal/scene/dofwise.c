/*
 * dofwise.c - see dofwise.h
 *
 * The laws' forces come after the rows' own: a law adds to both its ends, whether these are in the
 * set or not; what lands outside is read by nobody.
 */
#include "modal/scene/dofwise.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/statespace.h"

enum { MEMORY_MOST = 1024 };         /* doubles that a law may remember: on the stack, 8 kB */
enum {
    GROUND = -1,                     /* in place of a dof */
    NONE = -2,                       /* past the last of a thing's dofs */
    PARTS = 3,                       /* M, C, K, of cosines as of sines */
};
/* of a step: where events are looked for from on (leap_events.c) */
static const double MOMENT = 1e-4;

/* of what a slider holds: pulled by nearly as much where another's piece ends, it slips too */
static const double ALMOST = 1e-9;
/* of that: stages of a step of a radian see so much of what a harmonic pulls by between them */
static const double NEARLY = 0.5;

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "stepping: out of memory");
}

bool dofwise_slides(const struct program *p)
{
    for (int l = 0; l < p->laws; l++)
        if (p->law[l].kind->set_valued)
            return true;
    return false;
}

/* Does each rigid slider hold one dof to the ground that no other holds, nor a law with memory, and
 * is M diagonal? */
static bool sliders_apart(const struct program *p)
{
    const struct sparse *m = &p->constant[PROGRAM_M];
    bool *held = calloc((size_t)p->n + 1, sizeof *held), apart = held != NULL;

    for (int i = 0; apart && i < p->n; i++)
        apart = m->start[i + 1] - m->start[i] == 1 && m->index[m->start[i]] == i;
    for (int l = 0; apart && l < p->laws; l++)
        if (p->law[l].kind->set_valued) {
            apart = law_ends(&p->law[l]) == 1 && !held[p->law[l].end[0].dof];
            if (apart)
                held[p->law[l].end[0].dof] = true;
        }
    for (int l = 0; apart && l < p->laws; l++)
        for (int e = 0; p->law[l].memory > 0 && e < law_ends(&p->law[l]); e++)
            apart = apart && !held[p->law[l].end[e].dof];
    free(held);
    return apart;
}

bool dofwise_serves(const struct program *p)
{
    if (!program_of_dofs(p))
        return false;
    for (int l = 0; l < p->loads; l++)
        if (p->load[l].dof_sine >= 0)
            return false;
    for (int l = 0; l < p->laws; l++)
        if (p->law[l].kind->restart != NULL || p->law[l].memory > MEMORY_MOST)
            return false;
    return !dofwise_slides(p) || sliders_apart(p);
}

/* Every matrix of the program that couples dofs, by number; NULL past the last. */
static const struct sparse *coupling(const struct program *p, int i)
{
    int h = (i - PARTS) / (2 * PARTS), part = (i - PARTS) % (2 * PARTS);

    if (i < PARTS)
        return &p->constant[i];
    return h >= p->harmonics ? NULL
           : part < PARTS    ? &p->harmonic[h].cosine[part]
                             : &p->harmonic[h].sine[part - PARTS];
}

/* Pairs of dofs that law L couples, into AT; how many. */
static int law_pairs(const struct law *l, struct triplet *at)
{
    int count = law_ends(l), pairs = 0;

    for (int i = 0; i < count; i++)
        for (int j = 0; j < count; j++)
            if (l->end[i].dof != l->end[j].dof)
                at[pairs++] = (struct triplet){ l->end[i].dof, l->end[j].dof, 1 };
    return pairs;
}

/* Who is coupled with whom, both ways. */
static enum modal_status make_graph(struct dofwise *f, struct modal_error *err)
{
    const struct program *p = f->p;
    size_t room = 1;
    struct triplet *pair;
    int count = 0;
    enum modal_status rc;

    for (int l = 0; l < p->laws; l++)
        room += (size_t)law_ends(&p->law[l]) * (size_t)law_ends(&p->law[l]);
    for (int i = 0; coupling(p, i) != NULL; i++)
        room += coupling(p, i)->m > 0 ? 2 * (size_t)coupling(p, i)->start[coupling(p, i)->m] : 0;
    if (room > INT32_MAX || (pair = malloc(room * sizeof *pair)) == NULL)
        return no_memory(err);
    for (int i = 0; coupling(p, i) != NULL; i++) {
        const struct sparse *a = coupling(p, i);
        for (int r = 0; r < a->m; r++)
            for (int k = a->start[r]; k < a->start[r + 1]; k++)
                if (a->index[k] != r) {
                    pair[count++] = (struct triplet){ r, a->index[k], 1 };
                    pair[count++] = (struct triplet){ a->index[k], r, 1 };
                }
    }
    for (int l = 0; l < p->laws; l++)
        count += law_pairs(&p->law[l], pair + count);
    rc = sparse_from_triplets(f->n, f->n, pair, count, &f->graph, err);
    free(pair);
    return rc;
}

/* Lists of things by dof: OWNER(i, k) is the k-th dof of thing i, GROUND or NONE past the last. */
static void list_by_dof(int n, int things, int (*owner)(const struct program *, int, int),
                        const struct program *p, int *start, int *list)
{
    for (int i = 0; i < things; i++)
        for (int k = 0, dof; (dof = owner(p, i, k)) != NONE; k++)
            if (dof != GROUND)
                start[dof]++;
    for (int i = 0; i < n; i++)
        start[i + 1] += start[i];                /* ends; [n] stays */
    for (int i = things - 1; i >= 0; i--)
        for (int k = 0, dof; (dof = owner(p, i, k)) != NONE; k++)
            if (dof != GROUND)
                list[--start[dof]] = i;          /* from behind, down to its start */
}

static int owner_of_law(const struct program *p, int law, int k)
{
    const struct law *l = &p->law[law];

    return k < law_ends(l) ? l->end[k].dof : NONE;
}

static int owner_of_load(const struct program *p, int load, int k)
{
    /* an impulse is a corner and no force */
    return k > 0 ? NONE : p->load[load].type == LOAD_IMPULSE ? GROUND : p->load[load].dof;
}

/* M by its diagonal, or its factors. */
static enum modal_status take_mass(struct dofwise *f, struct modal_error *err)
{
    const struct sparse *m = &f->p->constant[PROGRAM_M];
    enum modal_status rc;

    for (int i = 0; i < f->n; i++)
        if (m->start[i + 1] - m->start[i] != 1 || m->index[m->start[i]] != i) {
            /* symmetric: its rows are its columns */
            rc = sparse_lu_new(f->n, m->start, m->index, false, &f->factor, err);
            if (rc == MODAL_OK && !sparse_lu_factor(f->factor, m->value))
                rc = modal_fail_field(err, MODAL_BAD_INPUT, "structure.M",
                                      "the mass matrix is singular to rounding");
            return rc;
        }
    f->mass = workspace_zeros(&f->space, (size_t)f->n, sizeof *f->mass);
    for (int i = 0; f->mass != NULL && i < f->n; i++)
        f->mass[i] = m->value[m->start[i]];
    return workspace_check(&f->space, "stepping: out of memory", err);
}

/* Arrays by dof and by law. */
static enum modal_status allocate(struct dofwise *f, struct modal_error *err)
{
    const struct program *p = f->p;
    size_t n = (size_t)f->n, laws = (size_t)p->laws, ends = 0;

    for (int l = 0; l < p->laws; l++)
        ends += (size_t)law_ends(&p->law[l]);
    f->force = workspace_zeros(&f->space, n, sizeof *f->force);
    f->solved = workspace_zeros(&f->space, n, sizeof *f->solved);
    f->law_start = workspace_zeros(&f->space, n + 1, sizeof *f->law_start);
    f->law_of = workspace_zeros(&f->space, ends, sizeof *f->law_of);
    f->load_start = workspace_zeros(&f->space, n + 1, sizeof *f->load_start);
    f->load_of = workspace_zeros(&f->space, (size_t)p->loads, sizeof *f->load_of);
    f->memory = workspace_zeros(&f->space, laws, sizeof *f->memory);
    f->watch = workspace_zeros(&f->space, laws, sizeof *f->watch);
    f->evaluations = workspace_zeros(&f->space, laws, sizeof *f->evaluations);
    f->acted = workspace_zeros(&f->space, laws, sizeof *f->acted);
    return workspace_check(&f->space, "stepping: out of memory", err);
}

enum modal_status dofwise_new(const struct program *p, struct dofwise **out,
                              struct modal_error *err)
{
    struct dofwise *f = calloc(1, sizeof *f);
    enum modal_status rc;

    if (f == NULL)
        return no_memory(err);
    f->p = p;
    f->n = p->n;
    rc = allocate(f, err);
    if (rc == MODAL_OK)
        rc = sources_new(p, false, &f->src, err);
    if (rc == MODAL_OK)
        rc = make_graph(f, err);
    if (rc == MODAL_OK)
        rc = take_mass(f, err);
    if (rc == MODAL_OK) {
        list_by_dof(f->n, p->laws, owner_of_law, p, f->law_start, f->law_of);
        list_by_dof(f->n, p->loads, owner_of_load, p, f->load_start, f->load_of);
        for (int l = 0; l < p->laws; l++) {
            f->memory[l] = f->memories;
            f->memories += p->law[l].kind->set_valued ? 1 : p->law[l].memory;
            f->sliders += p->law[l].kind->set_valued;
        }
        f->ended = -1;
        rc = dofwise_set_new(f, &f->all, err);
    }
    if (rc != MODAL_OK) {
        dofwise_free(f);
        return rc;
    }
    f->all.runs = f->all.whole = 1;
    f->all.run[0] = (struct dof_run){ 0, f->n };
    f->all.laws = p->laws;
    for (int l = 0; l < p->laws; l++)
        f->all.law[l] = l;
    *out = f;
    return MODAL_OK;
}

void dofwise_free(struct dofwise *f)
{
    if (f == NULL)
        return;
    sources_free(f->src);
    sparse_done(&f->graph);
    sparse_lu_free(f->factor);
    workspace_free(&f->space);
    free(f);
}

enum modal_status dofwise_set_new(struct dofwise *f, struct dof_set *out, struct modal_error *err)
{
    *out = (struct dof_set){
        .run = workspace_zeros(&f->space, (size_t)f->n, sizeof *out->run),
        .law = workspace_zeros(&f->space, (size_t)f->p->laws + 1, sizeof *out->law),
        .rim = workspace_zeros(&f->space, (size_t)f->n, sizeof *out->rim),
    };
    return workspace_check(&f->space, "stepping: out of memory", err);
}

/* For qsort. */
static int ascending(const void *a, const void *b)
{
    int x = *(const int *)a, y = *(const int *)b;

    return (x > y) - (x < y);
}

/* In place, ascending and each once; how many are left. */
static int sorted_once(int *x, int count)
{
    int kept = 0;

    qsort(x, (size_t)count, sizeof *x, ascending);
    for (int i = 0; i < count; i++)
        if (kept == 0 || x[kept - 1] != x[i])
            x[kept++] = x[i];
    return kept;
}

/* Whether DOF is in SET. */
static bool holds(const struct dof_set *set, int dof)
{
    int low = 0, high = set->runs;

    while (low < high) {
        int middle = (low + high) / 2;
        if (set->run[middle].to <= dof)
            low = middle + 1;
        else
            high = middle;
    }
    return low < set->runs && set->run[low].from <= dof;
}

void dofwise_set(struct dofwise *f, const int *dof, int count, struct dof_set *out)
{
    out->runs = out->laws = out->rims = 0;
    out->whole = count == f->n;
    for (int i = 0; i < count; i++)
        if (out->runs > 0 && out->run[out->runs - 1].to == dof[i])
            out->run[out->runs - 1].to++;
        else
            out->run[out->runs++] = (struct dof_run){ dof[i], dof[i] + 1 };
    /* a law is listed by each of its dofs: where room ends, doubles are dropped */
    for (int i = 0; i < count; i++)
        for (int k = f->law_start[dof[i]]; k < f->law_start[dof[i] + 1]; k++) {
            if (out->laws > f->p->laws)
                out->laws = sorted_once(out->law, out->laws);
            out->law[out->laws++] = f->law_of[k];
        }
    out->laws = sorted_once(out->law, out->laws);
    for (int i = 0; i < count; i++)
        for (int k = f->graph.start[dof[i]]; k < f->graph.start[dof[i] + 1]; k++) {
            if (holds(out, f->graph.index[k]))
                continue;
            if (out->rims == f->n)
                out->rims = sorted_once(out->rim, out->rims);
            out->rim[out->rims++] = f->graph.index[k];
        }
    out->rims = sorted_once(out->rim, out->rims);
}

/* -scale A x over rows FROM .. TO - 1 */
static void take_rows(const struct sparse *a, struct dof_run run, double scale, const double *x,
                      double *out)
{
    for (int i = run.from; i < run.to && i < a->m; i++) {
        double sum = 0;
        for (int k = a->start[i]; k < a->start[i + 1]; k++)
            sum += a->value[k] * x[a->index[k]];
        out[i] -= scale * sum;
    }
}

/* Loads, stiffness and damping of (1) over one run. */
static void linear_part(struct dofwise *f, struct dof_run run, double t, const double *x,
                        const double *v)
{
    const struct program *p = f->p;
    double *force = f->force;

    memset(force + run.from, 0, (size_t)(run.to - run.from) * sizeof *force);
    for (int k = f->load_start[run.from]; !f->unloaded && k < f->load_start[run.to]; k++)
        force[p->load[f->load_of[k]].dof] += sources_force(f->src, f->load_of[k], t);
    take_rows(&p->constant[PROGRAM_K], run, 1, x, force);
    take_rows(&p->constant[PROGRAM_C], run, 1, v, force);
    for (int h = 0; h < p->harmonics; h++) {
        const struct program_harmonic *at = &p->harmonic[h];
        double c = cos(at->k * p->omega * t), s = sin(at->k * p->omega * t);
        take_rows(&at->cosine[PROGRAM_K], run, c, x, force);
        take_rows(&at->sine[PROGRAM_K], run, s, x, force);
        take_rows(&at->cosine[PROGRAM_C], run, c, v, force);
        take_rows(&at->sine[PROGRAM_C], run, s, v, force);
    }
}

/* Relative displacements and rates of a law's inputs. */
static void inputs_of(const struct law *l, const double *x, const double *v, double *d,
                      double *rate)
{
    for (int k = 0; k < l->kind->inputs; k++) {
        double at = 0, moves = 0;

        for (int e = l->start[k]; e < l->start[k + 1]; e++) {     /* law_sees, of both at once */
            at += l->end[e].weight * x[l->end[e].dof];
            moves += l->end[e].weight * v[l->end[e].dof];
        }
        d[k] = at;
        rate[k] = moves;
    }
}

/* One law asked and watched. */
static enum modal_status law_part(struct dofwise *f, int law, double t, const double *x,
                                  const double *v, const double *memory, struct modal_error *err)
{
    const struct law *l = &f->p->law[law];
    double d[LAW_INPUTS_MOST], rate[LAW_INPUTS_MOST], after[MEMORY_MOST];
    struct law_point at = { t, d, rate, memory + f->memory[law] };
    struct law_force out;
    struct law_watch *watch = &f->watch[law];
    enum modal_status rc;

    out.alone = false;
    out.memory = after;
    out.acts = false;
    out.regime = 0;
    /* of its inputs alone: the whole of it takes longer than a law with one */
    for (int i = 0; i < l->kind->inputs; i++) {
        out.f[i] = 0;
        for (int j = 0; j < l->kind->inputs; j++)
            out.fd[i][j] = out.fv[i][j] = 0;
    }
    inputs_of(l, x, v, d, rate);
    rc = l->kind->force(l, &at, &out, err);
    f->evaluations[law]++;
    if (!watch->seen)
        watch->regime = out.regime;
    watch->seen = true;
    watch->mixed |= out.regime != watch->regime;
    for (int k = 0; k < l->kind->inputs; k++) {
        watch->mixed |= rate[k] * watch->rate[k] < 0;
        law_push(l, k, -out.f[k], f->force);     /* it resists */
    }
    return rc;
}

/* A law that is asked for its force alone: no event of it is ever looked for. */
static void smooth_part(struct dofwise *f, int law, const double *x, const double *v)
{
    const struct law *l = &f->p->law[law];
    double d = 0, rate = 0, force;

    for (int e = l->start[0]; e < l->start[1]; e++) {
        d += l->end[e].weight * x[l->end[e].dof];
        rate += l->end[e].weight * v[l->end[e].dof];
    }
    force = l->kind->alone(l, d, rate);
    for (int e = l->start[0]; e < l->start[1]; e++)
        f->force[l->end[e].dof] -= l->end[e].weight * force;     /* it resists */
    f->evaluations[law]++;
}

/* Any but a rigid slider. */
static enum modal_status yielding_part(struct dofwise *f, int law, double t, const double *x,
                                       const double *v, const double *memory,
                                       struct modal_error *err)
{
    if (f->p->law[law].kind->alone == NULL)
        return law_part(f, law, t, x, v, memory, err);
    smooth_part(f, law, x, v);
    return MODAL_OK;
}

/*
 * A rigid slider on its dof's FORCE, which has all else that acts there: it takes all of that where
 * it sticks, and its limit where it slips.  A piece that ends and begins again between two stages
 * shows at none: one that is pulled by NEARLY what it holds is watched, and one that would stand
 * still within the step, going on as it does.
 */
static void slider_part(struct dofwise *f, int law, const double *v, const double *memory)
{
    int dof = f->p->law[law].end[0].dof;
    double way = memory[f->memory[law]], *force = &f->force[dof], holds = dofwise_holds(f, law);

    f->evaluations[law]++;
    f->watch[law].mixed |= way == 0 ? fabs(*force) > NEARLY * holds
        : way * v[dof] < f->step * fabs(*force - way * holds) / f->mass[dof];
    *force = way == 0 ? 0 : *force - way * holds;
}

/* The piece that law AT is on a moment after the start of a step of H: an event before the step's
 * first stage leaves all of these on one side. */
static enum modal_status begin_watch(struct dofwise *f, int law, double t, double h,
                                     const double *x, const double *v, const double *memory,
                                     struct modal_error *err)
{
    double d[LAW_INPUTS_MOST], after[MEMORY_MOST];
    const struct law *l = &f->p->law[law];
    struct law_watch *watch = &f->watch[law];
    struct law_point at = { t + MOMENT * h, d, watch->rate, memory + f->memory[law] };
    struct law_force out = { .memory = after };
    enum modal_status rc;

    /* with two inputs a piece may end while neither turns: a slider whose bound changes */
    *watch = (struct law_watch){ .mixed = l->kind->inputs > 1 };
    if (l->kind->smooth)                         /* no piece of it ends */
        return MODAL_OK;
    inputs_of(l, x, v, d, watch->rate);
    if (watch->mixed || l->kind->set_valued)
        return MODAL_OK;
    for (int k = 0; k < l->kind->inputs; k++)
        d[k] += MOMENT * h * watch->rate[k];
    rc = l->kind->force(l, &at, &out, err);
    f->evaluations[law]++;
    watch->regime = out.regime;
    watch->seen = true;
    return rc;
}

enum modal_status dofwise_watch(struct dofwise *f, const struct dof_set *set, double t, double h,
                                const double *x, const double *v, const double *memory,
                                struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    f->step = h;
    for (int k = 0; k < set->laws && rc == MODAL_OK; k++)
        rc = begin_watch(f, set->law[k], t, h, x, v, memory, err);
    return rc;
}

enum modal_status dofwise_accelerate(struct dofwise *f, const struct dof_set *set, double t,
                                     const double *x, const double *v, const double *memory,
                                     double *a, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int r = 0; r < set->runs; r++)
        linear_part(f, set->run[r], t, x, v);
    for (int k = 0; k < set->laws && rc == MODAL_OK; k++)
        if (!f->p->law[set->law[k]].kind->set_valued)
            rc = yielding_part(f, set->law[k], t, x, v, memory, err);
    for (int k = 0; f->sliders > 0 && k < set->laws; k++)
        if (f->p->law[set->law[k]].kind->set_valued)
            slider_part(f, set->law[k], v, memory);
    if (f->mass == NULL) {
        sparse_lu_solve(f->factor, f->force, a);
        return rc;
    }
    for (int r = 0; r < set->runs; r++)
        for (int i = set->run[r].from; i < set->run[r].to; i++)
            a[i] = f->force[i] / f->mass[i];     /* (1) */
    return rc;
}

double dofwise_holds(const struct dofwise *f, int law)
{
    const struct law *l = &f->p->law[law];

    return fabs(l->end[0].weight) * l->limit;
}

enum modal_status dofwise_pull(struct dofwise *f, int law, double t, const double *x,
                               const double *v, const double *memory, double *pull,
                               struct modal_error *err)
{
    int dof = f->p->law[law].end[0].dof;
    enum modal_status rc = MODAL_OK;

    linear_part(f, (struct dof_run){ dof, dof + 1 }, t, x, v);
    for (int k = f->law_start[dof]; k < f->law_start[dof + 1] && rc == MODAL_OK; k++)
        if (f->law_of[k] != law)
            rc = yielding_part(f, f->law_of[k], t, x, v, memory, err);
    *pull = f->force[dof];
    return rc;
}

/* The way of slider LAW at (t, X, V) into AFTER. */
static enum modal_status choose_way(struct dofwise *f, int law, double t, const double *x,
                                    const double *v, const double *memory, double *after,
                                    struct modal_error *err)
{
    int dof = f->p->law[law].end[0].dof;
    double *way = &after[f->memory[law]], before = memory[f->memory[law]], pull,
           holds = dofwise_holds(f, law) * (1 - (f->ended >= 0 ? ALMOST : 0));
    enum modal_status rc = MODAL_OK;

    if (law != f->ended && fabs(v[dof]) * sqrt(f->mass[dof]) > f->at_rest)
        *way = v[dof] > 0 ? 1 : -1;
    else {
        rc = dofwise_pull(f, law, t, x, v, memory, &pull, err);
        holds = law == f->ended && before == 0 ? 0 : holds;
        *way = pull > holds ? 1 : pull < -holds ? -1 : 0;
    }
    f->switched |= *way != before;
    f->acted[law] |= *way != 0;
    return rc;
}

void dofwise_hold(const struct dofwise *f, const struct dof_set *set, const double *memory,
                  double *v)
{
    for (int k = 0; f->sliders > 0 && k < set->laws; k++) {
        const struct law *l = &f->p->law[set->law[k]];
        if (l->kind->set_valued && memory[f->memory[set->law[k]]] == 0)
            v[l->end[0].dof] = 0;
    }
}

enum modal_status dofwise_remember(struct dofwise *f, const struct dof_set *set, double t,
                                   const double *x, const double *v, const double *memory,
                                   double *after, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int k = 0; k < set->laws && rc == MODAL_OK; k++) {
        const struct law *l = &f->p->law[set->law[k]];
        double d[LAW_INPUTS_MOST], rate[LAW_INPUTS_MOST], left[MEMORY_MOST];
        int place = f->memory[set->law[k]];
        struct law_point at = { t, d, rate, memory + place };
        struct law_force out = { .memory = left };
        if (l->kind->set_valued) {
            rc = choose_way(f, set->law[k], t, x, v, memory, after, err);
            continue;
        }
        inputs_of(l, x, v, d, rate);
        rc = l->kind->force(l, &at, &out, err);
        memcpy(after + place, left, (size_t)l->memory * sizeof *left);
        f->acted[set->law[k]] |= out.acts;
    }
    return rc;
}

/* The diagonal's entry of row I, 0 where there is none. */
static double diagonal(const struct sparse *a, int i)
{
    for (int k = i < a->m ? a->start[i] : 0; i < a->m && k < a->start[i + 1]; k++)
        if (a->index[k] == i)
            return a->value[k];
    return 0;
}

/* The largest sum of a row's sizes over its mass. */
static double largest_row(const struct sparse *a, const struct sparse *mass)
{
    double largest = 0;

    for (int i = 0; i < a->m; i++) {
        double sum = 0, m = diagonal(mass, i);
        for (int k = a->start[i]; k < a->start[i + 1]; k++)
            sum += fabs(a->value[k]);
        largest = m > 0 ? fmax(largest, sum / m) : largest;
    }
    return largest;
}

void dofwise_fastest(const struct program *p, double *frequency, double *decay)
{
    /* Gershgorin's circles of M^-1 K and M^-1 C */
    *frequency = sqrt(largest_row(&p->constant[PROGRAM_K], &p->constant[PROGRAM_M]));
    *decay = largest_row(&p->constant[PROGRAM_C], &p->constant[PROGRAM_M]);
}

/* Of one load at t, rad/s; a pulse's is that of its sine, while it lasts. */
static double load_frequency(const struct program *p, const struct program_load *load, double t)
{
    bool lasts = t >= load->start && t <= load->start + load->duration;

    switch (load->type) {
    case LOAD_HARMONIC:
        return fabs(program_load_frequency(p, load));
    case LOAD_HALF_SINE:
        return lasts ? M_PI / load->duration : 0;
    case LOAD_ONE_MINUS_COSINE:
        return lasts ? 2 * M_PI / load->duration : 0;
    default:
        return 0;
    }
}

double dofwise_radian(const struct program *p, double t)
{
    double fastest = p->harmonics > 0 ? p->harmonic[p->harmonics - 1].k * fabs(p->omega) : 0;

    for (int l = 0; l < p->loads; l++)
        fastest = fmax(fastest, load_frequency(p, &p->load[l], t));
    return fastest > 0 ? 1 / fastest : HUGE_VAL;
}

void dofwise_weights(const struct program *p, double duration, double *weight)
{
    double frequency, decay, softest;

    dofwise_fastest(p, &frequency, &decay);
    softest = frequency > 0 ? STATESPACE_RIGID * frequency : 1 / duration;
    for (int i = 0; i < p->n; i++) {
        weight[p->n + i] = sqrt(fabs(diagonal(&p->constant[PROGRAM_M], i)));
        weight[i] = fmax(sqrt(fabs(diagonal(&p->constant[PROGRAM_K], i))),
                         softest * weight[p->n + i]);
    }
}
