/*
 * at_rest.c - see at_rest.h
 *
 * With B the ends' weights of the laws, f their levels and G their slopes at rest,
 *
 *     M x'' + C x' + (K + B G B^T) x = p(t) - B f,                              (1)
 *
 * constant and linear: nothing iterates, and a thousand contacts cost what their springs cost.  An
 * input moves within mean +- reach, reach = sum_{k>0} |D_k|: a bound, exact for one harmonic.
 */
#include "modal/steady/at_rest.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/workspace.h"
#include "modal/scene/program.h"
#include "modal/steady/condense.h"

/* Of fewer laws one residual costs no more than the linear solution, which would be had in vain
 * wherever they act: a damper's point took 28.2 us in place of 26.4. */
enum { LAWS_LEAST = 16 };

struct at_rest {
    const struct program *p;
    struct program linear;       /* (1): P's own parts, but for K and the loads */
    struct condense *c;
    bool *holds;                 /* of each law: a slider holds, anywhere */
    double complex *X, *D;       /* of one dof, of one input: `room` each */
    int room;
    struct workspace space;
};

/* Many laws that all rest, in a program that does not pulsate. */
static bool applies(const struct program *p)
{
    for (int l = 0; l < p->laws; l++)
        if (p->law[l].kind->stays == NULL)
            return false;
    return p->laws >= LAWS_LEAST && p->harmonics == 0;
}

/* Law L at rest onto ENTRY, loads from LOAD on; how many entries. */
static int add_law(struct at_rest *a, const struct law *law, struct triplet *entry,
                   struct program_load *load, enum modal_status *rc, struct modal_error *err)
{
    struct law_force f;
    int count = 0, last = law->kind->inputs - 1;

    *rc = law_rest(law, &f, err);
    if (*rc != MODAL_OK)
        return 0;
    a->holds[law - a->p->law] = law->memory > 0 && f.fd[last][last] != 0;
    for (int i = 0; i < law->kind->inputs; i++)
        for (int e = law->start[i]; e < law->start[i + 1]; e++) {
            struct law_end row = law->end[e];

            load[e] = (struct program_load) { .dof = row.dof, .type = LOAD_HARMONIC,
                                              .cosine = -row.weight * f.f[i], .dof_sine = -1 };
            for (int j = 0; j < law->kind->inputs; j++)
                for (int g = law->start[j]; f.fd[i][j] != 0 && g < law->start[j + 1]; g++)
                    entry[count++] = (struct triplet) { row.dof, law->end[g].dof,
                                                        row.weight * law->end[g].weight
                                                        * f.fd[i][j] };
        }
    return count;
}

/* Entries of K's own, then the laws'. */
static int add_stiffness(const struct sparse *K, struct triplet *entry)
{
    int count = 0;

    for (int i = 0; i < K->m; i++)
        for (int e = K->start[i]; e < K->start[i + 1]; e++)
            entry[count++] = (struct triplet) { i, K->index[e], K->value[e] };
    return count;
}

/* (1) from the program. */
static enum modal_status make_linear(struct at_rest *a, struct modal_error *err)
{
    const struct program *p = a->p;
    const struct sparse *K = &p->constant[PROGRAM_K];
    size_t ends = 0, entries = K->m > 0 ? (size_t)K->start[K->m] : 0;
    struct triplet *entry;
    int count;
    enum modal_status rc = MODAL_OK;

    for (int l = 0; l < p->laws; l++) {
        ends += (size_t)law_ends(&p->law[l]);
        entries += (size_t)law_ends(&p->law[l]) * (size_t)law_ends(&p->law[l]);
    }
    a->linear = *p;
    a->linear.laws = 0;
    a->linear.law = NULL;
    a->linear.load = workspace_zeros(&a->space, (size_t)p->loads + ends, sizeof *p->load);
    a->holds = workspace_zeros(&a->space, (size_t)p->laws, sizeof *a->holds);
    entry = malloc((entries + 1) * sizeof *entry);
    if (entry == NULL || a->space.failed) {
        free(entry);
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for %d laws", p->laws);
    }
    if (p->loads > 0)
        memcpy(a->linear.load, p->load, (size_t)p->loads * sizeof *p->load);
    count = add_stiffness(K, entry);
    for (int l = 0; rc == MODAL_OK && l < p->laws; l++) {
        count += add_law(a, &p->law[l], entry + count, a->linear.load + a->linear.loads, &rc, err);
        a->linear.loads += law_ends(&p->law[l]);
    }
    memset(&a->linear.constant[PROGRAM_K], 0, sizeof a->linear.constant[PROGRAM_K]);
    if (rc == MODAL_OK)
        rc = sparse_from_triplets(p->n, p->n, entry, count, &a->linear.constant[PROGRAM_K], err);
    free(entry);
    return rc;
}

/* The dofs to recover: those asked for and the laws' own. */
static enum modal_status want(struct at_rest *a, const int *dofs, int count,
                              struct modal_error *err)
{
    const struct program *p = a->p;
    char *wanted = calloc((size_t)p->n + 1, sizeof *wanted);
    int *list = malloc(((size_t)p->n + 1) * sizeof *list), found = 0;

    if (wanted != NULL && list != NULL) {
        for (int i = 0; i < count; i++)
            wanted[dofs[i]] = 1;
        for (int l = 0; l < p->laws; l++)
            for (int e = 0; e < law_ends(&p->law[l]); e++)
                wanted[p->law[l].end[e].dof] = 1;
        for (int i = 0; i < p->n; i++)
            if (wanted[i])
                list[found++] = i;
        condense_want(a->c, list, found);
    }
    bool failed = wanted == NULL || list == NULL;
    free(wanted);
    free(list);
    return failed ? modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for %d dofs", p->n)
                  : MODAL_OK;
}

enum modal_status at_rest_new(const struct program *p, const int *dofs, int count,
                              struct at_rest **out, struct modal_error *err)
{
    struct at_rest *a;
    enum modal_status rc;

    *out = NULL;
    if (!applies(p))
        return MODAL_OK;
    a = calloc(1, sizeof *a);
    if (a == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory");
    a->p = p;
    rc = make_linear(a, err);
    if (rc == MODAL_OK)
        rc = condense_new(&a->linear, CONDENSE_LINEAR, &a->c, err);
    if (rc == MODAL_OK && dofs != NULL)
        rc = want(a, dofs, count, err);
    if (rc == MODAL_OK)
        *out = a;
    else
        at_rest_free(a);
    return rc;
}

void at_rest_free(struct at_rest *a)
{
    if (a == NULL)
        return;
    condense_free(a->c);
    sparse_done(&a->linear.constant[PROGRAM_K]);
    free(a->X);
    free(a->D);
    workspace_free(&a->space);
    free(a);
}

int at_rest_harmonics(const struct at_rest *a)
{
    return condense_highest_load(a->c) > 1 ? condense_highest_load(a->c) : 1;
}

const struct program *at_rest_program(const struct at_rest *a) { return &a->linear; }
double at_rest_work(const struct at_rest *a) { return condense_work(a->c); }

/* Whether law LAW stays where it rests in the motion at hand. */
static enum modal_status law_stays(struct at_rest *a, const struct law *law, int H, bool *stays,
                                   struct modal_error *err)
{
    double mean[LAW_INPUTS_MOST], reach[LAW_INPUTS_MOST];
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < law->kind->inputs; i++) {
        memset(a->D, 0, ((size_t)H + 1) * sizeof *a->D);
        for (int e = law->start[i]; rc == MODAL_OK && e < law->start[i + 1]; e++) {
            rc = condense_recover(a->c, law->end[e].dof, H, a->X, H, a->X, err);
            for (int k = 0; k <= H; k++)
                a->D[k] += law->end[e].weight * a->X[k];
        }
        mean[i] = creal(a->D[0]);
        reach[i] = 0;
        for (int k = 1; k <= H; k++)
            reach[i] += cabs(a->D[k]);
    }
    *stays = law->kind->stays(law, mean, reach);
    return rc;
}

/* What is told of the laws and of the balance. */
static enum modal_status tell(struct at_rest *a, struct steady_point *point,
                              struct modal_error *err)
{
    struct condense_residual left;
    enum modal_status rc = condense_residual(a->c, a->X, &left, err);

    point->method = "linear";
    point->converged = true;
    point->linear = a->c;
    point->residual = left.relative;
    point->tail_rms = left.rms;
    point->tail_max = left.most;
    point->load_max = left.load;
    /* Nothing is truncated or sampled: rounding is the only error. */
    point->step = point->truncation = point->sampling = point->solver = point->error = 0;
    for (int l = 0; l < point->laws; l++) {
        point->evaluations[l]++;
        point->acts[l] = false;
        point->undetermined[l] = a->holds[l];
    }
    return rc;
}

enum modal_status at_rest_solve(struct at_rest *a, double omega, struct steady_point *point,
                                bool *found, struct modal_error *err)
{
    int H = point->H;
    double complex nothing;  /* no dof is kept */
    enum modal_status rc;

    *found = false;
    if (a->room <= H) {
        free(a->X);
        free(a->D);
        a->room = H + 1;
        a->X = calloc((size_t)a->room, sizeof *a->X);
        a->D = calloc((size_t)a->room, sizeof *a->D);
        if (a->X == NULL || a->D == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "steady: no memory for %d harmonics", H);
    }
    rc = condense_at(a->c, omega, 1, H, &nothing, &nothing, err);
    *found = rc == MODAL_OK;
    for (int l = 0; rc == MODAL_OK && *found && l < a->p->laws; l++)
        rc = law_stays(a, &a->p->law[l], H, found, err);
    for (int i = 0; rc == MODAL_OK && *found && i < point->q; i++)
        rc = condense_recover(a->c, condense_dofs(point->c)[i], H, a->X, H,
                              point->X + (size_t)i * ((size_t)H + 1), err);
    if (rc == MODAL_OK && *found)
        rc = tell(a, point, err);
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;  /* singular: held by what slips, or not */
}
