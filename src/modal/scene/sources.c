/* sources.c - see sources.h
 *
 *     harmonic            w = (cos k Omega t, sin k Omega t), or (1) for k = 0
 *     step                w = (a)
 *     half_sine           w = (cos b tau, sin b tau), b = pi / duration, tau = t - start
 *     one_minus_cosine    w = (1, cos b tau, sin b tau), b = 2 pi / duration
 *     table               w = (f, f') within each interval
 *
 * On turning axes, theta = frame_speed t: w becomes (w cos theta, w sin theta), S becomes [S, -W;
 * W, S], W = frame_speed.
 */
#include "modal/scene/sources.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* States of w that a load has before turning. */
static int states_of(const struct program_load *load)
{
    static const int states[] = {
        [LOAD_HARMONIC] = 2,         [LOAD_IMPULSE] = 0, [LOAD_HALF_SINE] = 2,
        [LOAD_ONE_MINUS_COSINE] = 3, [LOAD_STEP] = 1,    [LOAD_TABLE] = 2
    };

    return load->type == LOAD_HARMONIC && load->k == 0 && load->tones == 0 ? 1 : states[load->type];
}

/* The oscillator's frequency, 0: none; OUT gets its first row and what each row adds to the
 * force. */
static double shape_of(const struct program *p, const struct program_load *load, int *oscillator,
                       double weight[3])
{
    memset(weight, 0, 3 * sizeof *weight);
    *oscillator = 0;
    switch (load->type) {
    case LOAD_HARMONIC:
        weight[0] = load->cosine;
        weight[1] = load->sine;
        return program_load_frequency(p, load);
    case LOAD_HALF_SINE:
        weight[1] = load->amplitude;  /* a sin: w_2 */
        return M_PI / load->duration;
    case LOAD_ONE_MINUS_COSINE:
        *oscillator = 1;  /* after the constant */
        weight[0] = load->amplitude;
        weight[1] = -load->amplitude;  /* -a cos: 1 - cos needs w_1 too */
        return 2 * M_PI / load->duration;
    case LOAD_STEP:
        weight[0] = load->amplitude;
        return 0;
    case LOAD_TABLE:
        weight[0] = 1;
        return 0;
    case LOAD_IMPULSE:
        break;
    }
    return 0;
}

/* x(i, j) += value. */
static void set(double *x, int rows, int i, int j, double value)
{
    x[i + (size_t)j * (size_t)rows] += value;
}

/* The block, and where there are S and P their rows FIRST .., of a load of COUNT states (before
 * turning). */
static void fill(struct sources *s, const struct program_load *load, int first, int count)
{
    double weight[3], W = s->p->frame_speed;
    int at, copies = load->dof_sine >= 0 ? 2 : 1;
    double b = shape_of(s->p, load, &at, weight);

    s->block[s->blocks++] = (struct source_block) { first, copies * count };
    if (s->S == NULL)
        return;
    for (int copy = 0; copy < copies; copy++) {
        int row = first + copy * count, dof = copy == 0 ? load->dof : load->dof_sine;
        if (b != 0 && count >= at + 2) {
            set(s->S, s->nw, row + at, row + at + 1, -b);  /* cos' = -b sin */
            set(s->S, s->nw, row + at + 1, row + at, b);  /* sin' = b cos */
        }
        if (load->type == LOAD_TABLE)
            set(s->S, s->nw, row, row + 1, 1);  /* f' of a line */
        for (int i = 0; i < count; i++)
            set(s->P, s->n, dof, row + i, weight[i] * (copy == 0 ? 1 : load->turn));
    }
    for (int i = 0; copies == 2 && i < count; i++) {
        set(s->S, s->nw, first + i, first + count + i, -W);  /* [S, -W; W, S] */
        set(s->S, s->nw, first + count + i, first + i, W);
    }
}

/* What lies before t = 0 or never comes is no corner. */
static void add_corner(struct sources *s, double t, int dof, double impulse)
{
    if (t >= 0 && isfinite(t))
        s->corner[s->corners++] = (struct source_corner) { t, dof, impulse };
}

/* Where a load is not analytic: steps end there. */
static void add_corners(struct sources *s, const struct program_load *load)
{
    double W = s->p->frame_speed;

    if (load->type == LOAD_IMPULSE) {
        double turn = load->dof_sine >= 0 ? W * load->start : 0;  /* where the axes are by then */
        add_corner(s, load->start, load->dof, load->amplitude * cos(turn));
        if (load->dof_sine >= 0)
            add_corner(s, load->start, load->dof_sine, load->turn * load->amplitude * sin(turn));
    } else if (load->type == LOAD_TABLE) {
        for (int i = 0; i < load->points; i++)
            add_corner(s, load->start + load->time[i], -1, 0);
    } else if (load->type != LOAD_HARMONIC) {
        add_corner(s, load->start, -1, 0);
        add_corner(s, load->start + load->duration, -1, 0);
    }
}

/* For qsort: ascending in t. */
static int compare(const void *a, const void *b)
{
    const struct source_corner *x = a, *y = b;

    return (x->t > y->t) - (x->t < y->t);
}

/* At most so many, for room. */
static int corners_of(const struct program_load *load)
{
    return load->type == LOAD_TABLE ? load->points : 2;
}

enum modal_status sources_new(const struct program *p, bool stepped, struct sources **out,
                              struct modal_error *err)
{
    struct sources *s = calloc(1, sizeof *s);
    size_t corners = 0;

    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "sources: out of memory");
    s->p = p;
    s->n = p->n;
    for (int i = 0; i < p->loads; i++) {
        if (p->load[i].tones > 0 && !(p->tones[p->load[i].tones - 1] > 0)) {
            free(s);
            return modal_fail_field(err, MODAL_BAD_INPUT, "excitation",
                                    "excitation[%d].k names %d tones; give as many as "
                                    "steady.tones", i, p->load[i].tones);
        }
        s->nw += states_of(&p->load[i]) * (p->load[i].dof_sine >= 0 ? 2 : 1);
        corners += (size_t)corners_of(&p->load[i]);
    }
    if (stepped) {
        s->S = workspace_zeros(&s->space, (size_t)s->nw * (size_t)s->nw, sizeof *s->S);
        s->P = workspace_zeros(&s->space, (size_t)s->n * (size_t)s->nw, sizeof *s->P);
    }
    s->block = workspace_zeros(&s->space, (size_t)p->loads, sizeof *s->block);
    s->corner = workspace_zeros(&s->space, corners, sizeof *s->corner);
    s->first = workspace_zeros(&s->space, (size_t)p->loads, sizeof *s->first);
    if (s->space.failed) {
        sources_free(s);
        return modal_fail(err, MODAL_NO_MEMORY, "sources: out of memory");
    }
    for (int i = 0, row = 0; i < p->loads; i++) {
        int count = states_of(&p->load[i]);
        s->first[i] = count > 0 ? row : -1;
        if (count > 0)
            fill(s, &p->load[i], row, count);
        add_corners(s, &p->load[i]);
        row += count * (p->load[i].dof_sine >= 0 ? 2 : 1);
    }
    qsort(s->corner, (size_t)s->corners, sizeof *s->corner, compare);
    *out = s;
    return MODAL_OK;
}

void sources_free(struct sources *s)
{
    if (s == NULL)
        return;
    workspace_free(&s->space);
    free(s);
}

/* The interval of a table that holds tau, by bisection: f and f' there; outside, zeros. */
static void table_at(const struct program_load *load, double t, double w[2])
{
    int low = 0, high = load->points - 1;

    w[0] = w[1] = 0;
    if (!(t >= load->start + load->time[0]) || t >= load->start + load->time[high])
        return;
    while (high - low > 1) {
        int middle = (low + high) / 2;  /* ascending points */
        if (t >= load->start + load->time[middle])
            low = middle;
        else
            high = middle;
    }
    w[1] = (load->force[high] - load->force[low]) / (load->time[high] - load->time[low]);
    w[0] = load->force[low] + w[1] * (t - (load->start + load->time[low]));
}

/* w of one load before turning; 0 outside its time. */
static void load_at(const struct program *p, const struct program_load *load, double t, double *w)
{
    double tau = t - load->start, weight[3], b;
    bool on = t >= load->start && t < load->start + load->duration;
    int at;

    if (load->type == LOAD_TABLE) {
        table_at(load, t, w);
        return;
    }
    b = shape_of(p, load, &at, weight);
    if (load->type == LOAD_HARMONIC) {
        tau = t;
        on = true;
    }
    w[0] = on;
    if (b != 0) {
        w[at] = on ? cos(b * tau) : 0;
        w[at + 1] = on ? sin(b * tau) : 0;
    }
}

double sources_force(struct sources *s, int load, double t)
{
    const struct program_load *of = &s->p->load[load];
    double w[3] = { 0 }, weight[3], b;
    int at;

    if (of->type == LOAD_HARMONIC && (b = program_load_frequency(s->p, of)) != 0) {
        if (b != s->turns || t != s->turned_at) {        /* many loads turn alike */
            s->turns = b;
            s->turned_at = t;
            s->cosine = cos(b * t);
            s->sine = sin(b * t);
        }
        return of->cosine * s->cosine + of->sine * s->sine;
    }
    shape_of(s->p, &s->p->load[load], &at, weight);
    load_at(s->p, &s->p->load[load], t, w);
    return weight[0] * w[0] + weight[1] * w[1] + weight[2] * w[2];
}

void sources_at(const struct sources *s, double t, double *w)
{
    double c = cos(s->p->frame_speed * t), d = sin(s->p->frame_speed * t);

    for (int i = 0; i < s->p->loads; i++) {
        const struct program_load *load = &s->p->load[i];
        int count = states_of(load);
        double *row = w + s->first[i];
        if (count == 0)
            continue;
        load_at(s->p, load, t, row);
        for (int k = 0; load->dof_sine >= 0 && k < count; k++) {
            row[count + k] = row[k] * d;  /* w sin theta, before row[k] is turned */
            row[k] *= c;
        }
    }
}
