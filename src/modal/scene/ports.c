/* ports.c - see ports.h
 *
 * The pulsating part of C and K is applied here, row by row of the dofs that it touches, because a
 * nonlinear program's linear part must be constant to be answered exactly (collocation.h).
 */
#include "modal/scene/ports.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LAW_MEMORY_MOST = 1024 };   /* doubles on the stack of each evaluation: 8 kB */

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "ports: out of memory");
}

/* Dofs that a pulsating entry touches, as row or column; INDEX[dof] is its place, -1 none. */
static int touched(const struct program *p, int *index)
{
    int count = 0;

    for (int i = 0; i < p->n; i++)
        index[i] = -1;
    for (int h = 0; h < p->harmonics; h++)
        for (int part = 0; part < 6; part++) {
            const struct sparse *a =
                part <= PROGRAM_K ? &p->harmonic[h].cosine[part] : &p->harmonic[h].sine[part - 3];
            for (int i = 0; i < a->m; i++)
                for (int k = a->start[i]; k < a->start[i + 1]; k++)
                    /* row and column: it is looked at and pushed */
                    index[i] = index[a->index[k]] = 0;
        }
    for (int i = 0; i < p->n; i++)
        if (index[i] == 0)
            index[i] = count++;
    return count;
}

/* A over the rows that pulsate, dense. */
static double *spread(struct ports *p, const struct sparse *a, const int *index)
{
    size_t rows = (size_t)p->rows;
    double *x = workspace_zeros(&p->space, rows * rows, sizeof *x);

    for (int i = 0; x != NULL && i < a->m; i++)
        for (int k = a->start[i]; k < a->start[i + 1]; k++)
            x[(size_t)index[i] + (size_t)index[a->index[k]] * rows] += a->value[k];
    return x;
}

/* C and K alone: a pulsating mass cannot be stepped. */
static enum modal_status fill_harmonics(struct ports *p, const int *index, struct modal_error *err)
{
    const struct program *program = p->ss->p;
    static const int matrix[2] = { PROGRAM_C, PROGRAM_K };

    p->harmonic = workspace_zeros(&p->space, (size_t)program->harmonics, sizeof *p->harmonic);
    for (int h = 0; p->harmonic != NULL && h < program->harmonics; h++) {
        p->harmonic[h].k = program->harmonic[h].k;
        for (int i = 0; i < 2; i++) {
            p->harmonic[h].cosine[i] =
                spread(p, &program->harmonic[h].cosine[matrix[i]], index);
            p->harmonic[h].sine[i] = spread(p, &program->harmonic[h].sine[matrix[i]], index);
        }
    }
    for (int i = 0; i < program->n; i++)
        if (index[i] >= 0)
            p->row_dof[index[i]] = i;
    return p->space.failed ? no_memory(err) : MODAL_OK;
}

/* Channel and probe C at END. */
static void connect(struct ports *p, int c, struct law_end end)
{
    const struct statespace *ss = p->ss;
    size_t N = (size_t)ss->N, r = 2 * (size_t)p->probes, n = (size_t)ss->n, dof = (size_t)end.dof;

    for (size_t i = 0; i < N; i++)
        /* a law's force resists */
        p->U[i + (size_t)c * N] -= end.weight * ss->B[i + dof * N];
    for (size_t j = 0; j < n; j++) {
        double phi = end.weight * ss->phi[dof + j * n];
        p->R[(size_t)c + j * r] += phi / ss->s[j];  /* y_1 = s q */
        p->R[(size_t)(p->probes + c) + (n + j) * r] += phi;  /* y_2 = q' */
    }
}

/* Channels of laws in their order, then one a pulsating dof. */
static enum modal_status fill(struct ports *p, const int *index, struct modal_error *err)
{
    const struct program *program = p->ss->p;
    int channel = 0;

    for (int i = 0; i < program->laws; i++) {
        const struct law *law = &program->law[i];
        p->law[i] = (struct port_law) { .law = law, .channel = channel, .memory = p->memory };
        p->memory += law->memory;  /* places one after the other */
        for (int k = 0; k < law->kind->inputs; k++, channel++)  /* inputs of one law lie together */
            for (int e = law->start[k]; e < law->start[k + 1]; e++)
                connect(p, channel, law->end[e]);
        if (law->memory > LAW_MEMORY_MOST)
            return modal_fail_field(err, MODAL_TOO_LARGE, "effects",
                                    "a law remembers %d numbers; at most %d", law->memory,
                                    LAW_MEMORY_MOST);
    }
    for (int i = 0; i < program->n; i++)
        if (index[i] >= 0)
            connect(p, p->inputs + index[i], (struct law_end) { i, 1 });
    return fill_harmonics(p, index, err);
}

enum modal_status ports_new(const struct statespace *ss, struct ports **out,
                            struct modal_error *err)
{
    struct ports *p = calloc(1, sizeof *p);
    const struct program *program = ss->p;
    int *index = malloc(((size_t)program->n + 1) * sizeof *index);  /* dof to pulsating row */
    enum modal_status rc = p != NULL && index != NULL ? MODAL_OK : no_memory(err);

    if (rc == MODAL_OK) {
        p->ss = ss;
        p->laws = program->laws;  /* in their order */
        for (int i = 0; i < program->laws; i++)
            p->inputs += program->law[i].kind->inputs;
        p->rows = touched(program, index);  /* before room is made: channels depend on it */
        p->channels = p->probes = p->inputs + p->rows;  /* a channel looks where it pushes */
        p->law = workspace_zeros(&p->space, (size_t)p->laws, sizeof *p->law);
        p->U = workspace_zeros(&p->space, (size_t)ss->N * (size_t)p->channels, sizeof *p->U);
        p->R = workspace_zeros(&p->space, (size_t)ss->N * 2 * (size_t)p->probes, sizeof *p->R);
        p->row_dof = workspace_zeros(&p->space, (size_t)p->rows, sizeof *p->row_dof);
        rc = p->space.failed ? no_memory(err) : fill(p, index, err);
    }
    free(index);  /* row_dof has the other direction */
    if (rc == MODAL_OK)
        *out = p;
    else
        ports_free(p);
    return rc;
}

void ports_free(struct ports *p)
{
    if (p == NULL)
        return;
    workspace_free(&p->space);
    free(p);
}

enum modal_status ports_law(struct ports *p, int law, double t, const double *d, const double *v,
                            const double *memory, double *after, int *regime,
                            struct modal_error *err)
{
    struct port_law *l = &p->law[law];
    struct law_point at = { t, d, v, memory };
    struct law_force f = { .alone = true, .memory = after };  /* room for what it remembers */
    enum modal_status rc = l->law->kind->force(l->law, &at, &f, err);

    l->evaluations++;  /* plan.effects */
    *regime = f.regime;
    return rc;
}

/* One law's part of ports_force. */
static enum modal_status law_part(struct ports *p, struct port_law *l, double t,
                                  const double *probe, const double *memory, double *force,
                                  double *slope, double *after, struct modal_error *err)
{
    /* its probes have its channels' numbers */
    int inputs = l->law->kind->inputs, c = l->channel, q = p->probes;
    double scratch[LAW_MEMORY_MOST];  /* a law always writes its memory */
    struct law_point at = { t, probe + c, probe + q + c, memory + l->memory };
    struct law_force f = { .alone = slope == NULL,
                           .memory = after != NULL ? after + l->memory : scratch };
    enum modal_status rc;

    if (l->law->kind->set_valued) {
        force[c] = l->held * l->law->limit;  /* +-limit where it slips, 0 where it sticks */
        l->acted = l->acted || l->held != 0;
        return MODAL_OK;
    }
    rc = l->law->kind->force(l->law, &at, &f, err);
    l->evaluations++;
    for (int i = 0; i < inputs; i++) {
        force[c + i] = f.f[i];
        for (int j = 0; slope != NULL && j < inputs; j++) {
            slope[(size_t)(c + i) + (size_t)(c + j) * (size_t)p->channels] = f.fd[i][j];
            slope[(size_t)(c + i) + (size_t)(q + c + j) * (size_t)p->channels] = f.fv[i][j];
        }
    }
    if (after != NULL)  /* at the step's end, not at every iterate */
        l->acted = l->acted || f.acts;
    return rc;
}

/* The pulsating rows: f = (C(t) v + K(t) x). */
static void pulsating_part(struct ports *p, double t, const double *probe, double *force,
                           double *slope)
{
    int q = p->probes, rows = p->rows;

    for (int h = 0; h < p->ss->p->harmonics; h++) {
        /* (3) of program.h, by k Omega t */
        double theta = p->harmonic[h].k * p->ss->p->omega * t, c = cos(theta), s = sin(theta);
        for (int j = 0; j < rows; j++)
            for (int i = 0; i < rows; i++) {
                size_t at = (size_t)i + (size_t)j * (size_t)rows;
                double damping = c * p->harmonic[h].cosine[0][at] + s * p->harmonic[h].sine[0][at];
                double stiffness =
                    c * p->harmonic[h].cosine[1][at] + s * p->harmonic[h].sine[1][at];
                force[p->inputs + i] +=
                    stiffness * probe[p->inputs + j] + damping * probe[q + p->inputs + j];
                if (slope != NULL) {
                    slope[(size_t)(p->inputs + i)
                          + (size_t)(p->inputs + j) * (size_t)p->channels] += stiffness;
                    slope[(size_t)(p->inputs + i)
                          + (size_t)(q + p->inputs + j) * (size_t)p->channels] += damping;
                }
            }
    }
}

enum modal_status ports_force(struct ports *p, double t, const double *probe,
                              const double *memory, double *force, double *slope, double *after,
                              struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    memset(force, 0, (size_t)p->channels * sizeof *force);  /* pulsating rows add up */
    if (slope != NULL)
        memset(slope, 0, (size_t)p->channels * 2 * (size_t)p->probes * sizeof *slope);
    for (int i = 0; i < p->laws && rc == MODAL_OK; i++)
        rc = law_part(p, &p->law[i], t, probe, memory, force, slope, after, err);
    if (rc == MODAL_OK && p->rows > 0)
        pulsating_part(p, t, probe, force, slope);
    return rc;
}

void ports_report(const struct ports *p, struct program *program)
{
    for (int i = 0; i < p->laws; i++) {
        struct program_effect *e = &program->effect[program->law[i].effect];
        e->evaluations += p->law[i].evaluations;
        e->active |= p->law[i].acted;
    }
}
