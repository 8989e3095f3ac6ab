/*
 * craig_bampton.c - see craig_bampton.h; tested by tests/unit/modal/scene/test_craig_bampton.c
 *
 * What (1) leaves out moves only what inertia and damping push: with W = A_ib + A_ii Psi, A = M and
 * C, and what of it Phi does not take, W' = W - M_ii Phi Phi^T W, the dofs left out answer
 * K_ii^-1 W' x_b, but for terms in s^2 / lambda of the modes not in Phi.  So `finer`, which has
 * twice the modes and these statics, knows the error of `reduced` up to its own modes' frequency.
 */
#include "modal/scene/craig_bampton.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/sparse_lu.h"
#include "modal/linalg/symmetric_modes.h"

enum { PANEL = 32 };              /* columns multiplied at once */
/* Numbers of T, (1), and as many of the search for modes: 1 GB. */
static const size_t NUMBERS_MOST = (size_t)1 << 27;
/* Entries off symmetry by less, relative, are symmetric: rounding of an assembly. */
static const double SYMMETRIC = 1e-12;
/* Of a vector that others have made but for so much, the rest is their rounding. */
static const double DEPENDENT = 1e-6;
/* Least over largest pivot of K_ii below which it may be 0. */
static const double PIVOT_RATIO = 64 * DBL_EPSILON;

/* The program split, and T = [Psi, Phi, statics]. */
struct making {
    const struct program *p;
    struct craig_bampton *out;
    int b, r, columns, modes;         /* r: interior; columns of T so far; modes of finer */
    int *place, *spot;                /* of each dof among those kept, among the others; or -1 */
    struct sparse ii[3], ib[3], bi[3], bb[3];
    struct sparse_lu *factors;        /* of K_ii */
    struct symmetric_modes phi;
    double *T, *right, *scratch;      /* r x most columns; r; r + columns */
    double *G, *Y;                    /* T^T A T; r x PANEL */
    struct workspace space;
};

/* The rows and columns of A that ROW and COLUMN number, both ascending, in M x N. */
static enum modal_status part_of(const struct sparse *a, const int *row, const int *column, int m,
                                 int n, struct sparse *out, struct modal_error *err)
{
    size_t entries = a->start != NULL ? (size_t)a->start[a->m] : 0;

    *out = (struct sparse){ .m = m, .n = n, .start = calloc((size_t)m + 1, sizeof *out->start),
                            .index = malloc((entries + 1) * sizeof *out->index),
                            .value = malloc((entries + 1) * sizeof *out->value) };
    if (out->start == NULL || out->index == NULL || out->value == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "reduction: no memory for %zu entries", entries);
    for (int i = 0, count = 0, last = 0; a->start != NULL && i < a->m; i++) {
        for (int e = a->start[i]; row[i] >= 0 && e < a->start[i + 1]; e++)
            if (column[a->index[e]] >= 0) {
                out->index[count] = column[a->index[e]];
                out->value[count++] = a->value[e];
            }
        for (; row[i] >= 0 && last <= row[i]; last++)
            out->start[last + 1] = count;
    }
    for (int i = 1; i <= m; i++)
        if (out->start[i] < out->start[i - 1])
            out->start[i] = out->start[i - 1];
    return MODAL_OK;
}

/* Those kept are 1 in place, which was 0; then their numbers, and the others' in spot. */
static void choose_kept(struct making *m, const int *dofs, int count)
{
    const struct program *p = m->p;

    for (int i = 0; i < count; i++)
        m->place[dofs[i]] = 1;
    for (int l = 0; l < p->laws; l++)
        for (int e = 0; e < law_ends(&p->law[l]); e++)
            m->place[p->law[l].end[e].dof] = 1;
    for (int l = 0; l < p->loads; l++) {
        m->place[p->load[l].dof] = 1;
        if (p->load[l].dof_sine >= 0)
            m->place[p->load[l].dof_sine] = 1;
    }
    for (int h = 0; h < p->harmonics; h++)
        for (int t = 0; t < 3; t++) {
            sparse_mark(&p->harmonic[h].cosine[t], m->place);
            sparse_mark(&p->harmonic[h].sine[t], m->place);
        }
    for (int i = 0; i < p->n; i++) {
        bool keep = m->place[i] != 0;

        m->place[i] = keep ? m->b++ : -1;
        m->spot[i] = keep ? -1 : m->r++;
    }
}

static enum modal_status refuse(struct modal_error *err, const char *why)
{
    return modal_fail_field(err, MODAL_BAD_INPUT, "reduce", "%s", why);
}

/* What (1) asks of the program. */
static enum modal_status check(const struct making *m, struct modal_error *err)
{
    const struct program *p = m->p;

    if (p->n_linear > 0 || p->seen_fixed)
        return refuse(err, "reduce takes no linear states (airloads, a massless shaft): leave it "
                      "out");
    if (m->r == 0)
        return refuse(err, "every dof has a law, a load or a sensor, or is reported: there is "
                      "nothing to reduce; name the dofs to report in dofs");
    if (!sparse_symmetric(&p->constant[PROGRAM_M], SYMMETRIC)
        || !sparse_symmetric(&p->constant[PROGRAM_K], SYMMETRIC))
        return refuse(err, "reduce needs symmetric M and K: leave it out");
    return MODAL_OK;
}

static enum modal_status split(struct making *m, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int t = 0; rc == MODAL_OK && t < 3; t++) {
        const struct sparse *a = &m->p->constant[t];

        rc = part_of(a, m->spot, m->spot, m->r, m->r, &m->ii[t], err);
        if (rc == MODAL_OK)
            rc = part_of(a, m->spot, m->place, m->r, m->b, &m->ib[t], err);
        if (rc == MODAL_OK)
            rc = part_of(a, m->place, m->spot, m->b, m->r, &m->bi[t], err);
        if (rc == MODAL_OK)
            rc = part_of(a, m->place, m->place, m->b, m->b, &m->bb[t], err);
    }
    return rc;
}

static double *column(const struct making *m, int j)
{
    return m->T + (size_t)j * (size_t)m->r;
}

/* Psi: -K_ib's column j is, K being symmetric, that row of K_bi. */
static enum modal_status find_statics(struct making *m, struct modal_error *err)
{
    const struct sparse *K = &m->ii[PROGRAM_K], *B = &m->bi[PROGRAM_K];
    enum modal_status rc = sparse_lu_new(m->r, K->start, K->index, false, &m->factors, err);

    if (rc != MODAL_OK)
        return rc;
    if (!sparse_lu_factor(m->factors, K->value) || sparse_lu_rcond(m->factors) < PIVOT_RATIO)
        return refuse(err, "the other dofs are loose while those kept (of laws, loads, sensors and "
                      "reports) are held fast: report some more of them in dofs");
    for (int j = 0; j < m->b; j++) {
        memset(m->right, 0, (size_t)m->r * sizeof *m->right);
        for (int e = B->start[j]; e < B->start[j + 1]; e++)
            m->right[B->index[e]] = -B->value[e];
        sparse_lu_solve(m->factors, m->right, column(m, j));
    }
    m->columns = m->b;
    return MODAL_OK;
}

/* Phi, twice as many as asked for. */
static enum modal_status find_modes(struct making *m, int modes, struct modal_error *err)
{
    int wanted = 2 * modes < m->r ? 2 * modes : m->r;
    enum modal_status rc = symmetric_modes(m->factors, &m->ii[PROGRAM_M], wanted, &m->phi, err);
    struct craig_bampton *o = m->out;
    bool all = m->phi.count < wanted || wanted == m->r;

    if (rc != MODAL_OK)
        return rc;
    m->modes = m->phi.count;
    memcpy(column(m, m->b), m->phi.phi, (size_t)m->r * (size_t)m->modes * sizeof *m->T);
    m->columns = m->b + m->modes;
    o->modes = modes < m->modes ? modes : m->modes;
    o->highest = o->modes > 0 ? sqrt(fabs(m->phi.lambda[o->modes - 1])) : 0;
    o->next = o->modes < m->modes ? sqrt(fabs(m->phi.lambda[o->modes])) : HUGE_VAL;
    o->reach = all ? HUGE_VAL : sqrt(fabs(m->phi.lambda[m->modes - 1]));
    return MODAL_OK;
}

/* K_ii^-1 W' of matrix T, one column more for each dof kept that gives one. */
static void add_statics_of(struct making *m, int t)
{
    double *along = m->scratch + (size_t)m->r + (size_t)m->columns + (size_t)m->b, norm;

    for (int j = 0; j < m->b; j++) {
        memset(m->right, 0, (size_t)m->r * sizeof *m->right);
        sparse_multiply_add(&m->ii[t], 1, column(m, j), m->right);
        for (int i = 0; i < m->r; i++)
            for (int e = m->ib[t].start[i]; e < m->ib[t].start[i + 1]; e++)
                m->right[i] += m->ib[t].index[e] == j ? m->ib[t].value[e] : 0;
        /* Phi takes Phi^T W: off in x = K^-1 W too, as K^-1 M Phi = Phi / lambda */
        sparse_lu_solve(m->factors, m->right, column(m, m->columns));
        m->columns += symmetric_modes_join(&m->ii[PROGRAM_M], column(m, m->b), m->columns - m->b,
                                           DEPENDENT, column(m, m->columns), along, &norm,
                                           m->scratch);
    }
}

/* G = T^T A T of matrix T (the number) and all columns, by those of each block. */
static void project(struct making *m, int t)
{
    int c = m->columns, r = m->r;

    for (int j = 0; j < c; j += PANEL) {
        int wide = c - j < PANEL ? c - j : PANEL;

        memset(m->Y, 0, (size_t)r * PANEL * sizeof *m->Y);
        for (int k = 0; k < wide; k++)
            sparse_multiply_add(&m->ii[t], 1, column(m, j + k), m->Y + (size_t)k * (size_t)r);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, c, wide, r, 1, m->T, r, m->Y, r, 0,
                    m->G + (size_t)j * (size_t)c, c);
    }
    for (int j = 0; j < c; j++)
        sparse_multiply_add(&m->bi[t], 1, column(m, j), m->G + (size_t)j * (size_t)c);
    for (int i = 0; i < r; i++)
        for (int e = m->ib[t].start[i]; e < m->ib[t].start[i + 1]; e++)
            cblas_daxpy(c, m->ib[t].value[e], m->T + i, r,
                        m->G + (size_t)m->ib[t].index[e] * (size_t)c, 1);
    sparse_add_to_dense(&m->bb[t], 1, &(struct matrix){ .m = c, .n = c, .ld = c, .x = m->G });
}

/* Damping below this that modes share is rounding of their products, of r terms each. */
static double shared_rounding(const struct making *m)
{
    size_t c = (size_t)m->columns;
    double largest = 0;

    for (size_t i = (size_t)m->b; i < (size_t)(m->b + m->modes); i++)
        largest = fmax(largest, fabs(m->G[i * c + i]));
    return (64 + m->r) * DBL_EPSILON * largest;
}

/* What rounding left of what is exact goes: symmetry, that statics and modes share no stiffness,
 * and modes neither that nor mass, nor damping where theirs is Rayleigh's. */
static void clean(struct making *m, int t)
{
    size_t c = (size_t)m->columns, b = (size_t)m->b, modes = b + (size_t)m->modes;
    bool symmetric = sparse_symmetric(&m->p->constant[t], SYMMETRIC);
    double shared = t == PROGRAM_C ? shared_rounding(m) : HUGE_VAL;

    for (size_t j = 0; j < c; j++)
        for (size_t i = 0; i < j; i++) {
            double *above = &m->G[j * c + i], *below = &m->G[i * c + j];

            if (symmetric)
                *above = *below = (*above + *below) / 2;
            if ((t == PROGRAM_K && i < b && j >= b)
                || (i >= b && j < modes && fmax(fabs(*above), fabs(*below)) <= shared))
                *above = *below = 0;
        }
}

/* The first N rows and columns of G. */
static enum modal_status write_matrix(const struct making *m, int n, struct sparse *out,
                                      struct modal_error *err)
{
    struct triplet *all = malloc(((size_t)n * (size_t)n + 1) * sizeof *all);
    int count = 0;
    enum modal_status rc;

    if (all == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "reduction: no memory for %d dofs", n);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double value = m->G[(size_t)j * (size_t)m->columns + (size_t)i];

            if (value != 0)
                all[count++] = (struct triplet){ i, j, value };
        }
    rc = sparse_from_triplets(n, n, all, count, out, err);
    free(all);
    return rc;
}

/* Laws and loads on the dofs kept, which both programs share. */
static enum modal_status write_ends(struct making *m, struct program *q, struct workspace *space,
                                    struct modal_error *err)
{
    const struct program *p = m->p;

    q->law = workspace_zeros(space, (size_t)p->laws, sizeof *q->law);
    q->load = workspace_zeros(space, (size_t)p->loads, sizeof *q->load);
    for (int l = 0; l < p->laws && !space->failed; l++) {
        int ends = law_ends(&p->law[l]);

        q->law[l] = p->law[l];
        q->law[l].end = workspace_zeros(space, (size_t)ends, sizeof *q->law[l].end);
        for (int e = 0; e < ends && !space->failed; e++)
            q->law[l].end[e] = (struct law_end){ m->place[p->law[l].end[e].dof],
                                                 p->law[l].end[e].weight };
    }
    for (int l = 0; l < p->loads && !space->failed; l++) {
        q->load[l] = p->load[l];
        q->load[l].dof = m->place[p->load[l].dof];
        if (p->load[l].dof_sine >= 0)
            q->load[l].dof_sine = m->place[p->load[l].dof_sine];
    }
    return workspace_check(space, "reduction: no memory", err);
}

/* Names, rest and periodic matrices of Q, of N dofs; the others are modes. */
static enum modal_status write_rest(struct making *m, struct program *q, int n,
                                    struct workspace *space, struct modal_error *err)
{
    const struct program *p = m->p;
    size_t size = (size_t)n;
    enum modal_status rc = MODAL_OK;

    q->n = n;
    q->by_name = NULL;
    q->outputs = 0;
    q->output = NULL;
    q->turn_partner = NULL;
    q->turn_sign = NULL;
    q->dofs = workspace_zeros(space, size, sizeof *q->dofs);
    q->x0 = workspace_zeros(space, size, sizeof *q->x0);
    q->v0 = workspace_zeros(space, size, sizeof *q->v0);
    q->harmonic = workspace_zeros(space, (size_t)p->harmonics, sizeof *q->harmonic);
    if (space->failed)
        return workspace_check(space, "reduction: no memory", err);
    for (int i = 0; i < n; i++)
        q->dofs[i] = i < m->b ? p->dofs[m->out->dofs[i]] : (char *)"a mode";  /* never freed */
    for (int h = 0; h < p->harmonics; h++) {
        q->harmonic[h].k = p->harmonic[h].k;
        for (int t = 0; rc == MODAL_OK && t < 3; t++) {
            rc = part_of(&p->harmonic[h].cosine[t], m->place, m->place, n, n,
                         &q->harmonic[h].cosine[t], err);
            if (rc == MODAL_OK)
                rc = part_of(&p->harmonic[h].sine[t], m->place, m->place, n, n,
                             &q->harmonic[h].sine[t], err);
        }
    }
    return rc;
}

static enum modal_status write_programs(struct making *m, struct modal_error *err)
{
    struct craig_bampton *o = m->out;
    int n = m->b + o->modes;
    enum modal_status rc;

    for (int i = 0; i < m->p->n; i++)
        if (m->place[i] >= 0)
            o->dofs[m->place[i]] = i;
    o->reduced = *m->p;
    memset(o->reduced.constant, 0, sizeof o->reduced.constant);
    o->reduced.harmonic = NULL;                          /* its own come below */
    rc = write_ends(m, &o->reduced, &o->space, err);
    o->finer = o->reduced;
    if (rc == MODAL_OK)
        rc = write_rest(m, &o->reduced, n, &o->space, err);
    if (rc == MODAL_OK)
        rc = write_rest(m, &o->finer, m->columns, &o->space, err);
    for (int t = 0; rc == MODAL_OK && t < 3; t++) {
        project(m, t);
        clean(m, t);
        rc = write_matrix(m, n, &o->reduced.constant[t], err);
        if (rc == MODAL_OK)
            rc = write_matrix(m, m->columns, &o->finer.constant[t], err);
    }
    return rc;
}

/* Room for T and what is made of it. */
static enum modal_status need_room(struct making *m, int modes, struct modal_error *err)
{
    int twice = 2 * modes < m->r ? 2 * modes : m->r;
    size_t r = (size_t)m->r, b = (size_t)m->b, columns = 3 * b + (size_t)twice;

    if (r * (columns + (size_t)twice) > NUMBERS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "reduce",
                                "%d modes and %d dofs kept of %d take more than %zu numbers", modes,
                                m->b, m->p->n, NUMBERS_MOST);
    m->T = workspace_zeros(&m->space, r * columns, sizeof *m->T);
    m->right = workspace_zeros(&m->space, r, sizeof *m->right);
    m->scratch = workspace_zeros(&m->space, r + 3 * columns, sizeof *m->scratch);
    m->G = workspace_zeros(&m->space, columns * columns, sizeof *m->G);
    m->Y = workspace_zeros(&m->space, r * PANEL, sizeof *m->Y);
    m->out->dofs = workspace_zeros(&m->out->space, b, sizeof *m->out->dofs);
    m->out->kept = m->b;
    return m->out->space.failed ? modal_fail(err, MODAL_NO_MEMORY, "reduction: no memory")
                                : workspace_check(&m->space, "reduction: no memory", err);
}

static void making_done(struct making *m)
{
    for (int t = 0; t < 3; t++) {
        sparse_done(&m->ii[t]);
        sparse_done(&m->ib[t]);
        sparse_done(&m->bi[t]);
        sparse_done(&m->bb[t]);
    }
    sparse_lu_free(m->factors);
    symmetric_modes_done(&m->phi);
    workspace_free(&m->space);
}

enum modal_status craig_bampton_new(const struct program *p, const int *dofs, int count, int modes,
                                    struct craig_bampton **out, struct modal_error *err)
{
    struct making m = { .p = p, .out = calloc(1, sizeof *m.out) };
    enum modal_status rc;

    m.place = workspace_zeros(&m.space, (size_t)p->n, sizeof *m.place);
    m.spot = workspace_zeros(&m.space, (size_t)p->n, sizeof *m.spot);
    rc = m.out == NULL ? modal_fail(err, MODAL_NO_MEMORY, "reduction: no memory")
                       : workspace_check(&m.space, "reduction: no memory", err);
    if (rc == MODAL_OK) {
        choose_kept(&m, dofs, count);
        rc = check(&m, err);
    }
    if (rc == MODAL_OK)
        rc = need_room(&m, modes, err);
    if (rc == MODAL_OK)
        rc = split(&m, err);
    if (rc == MODAL_OK)
        rc = find_statics(&m, err);
    if (rc == MODAL_OK)
        rc = find_modes(&m, modes, err);
    if (rc == MODAL_OK) {
        add_statics_of(&m, PROGRAM_M);
        add_statics_of(&m, PROGRAM_C);
        rc = write_programs(&m, err);
    }
    making_done(&m);
    if (rc == MODAL_OK)
        *out = m.out;
    else
        craig_bampton_free(m.out);
    return rc;
}

/* The matrices that write_rest and write_matrix made. */
static void free_matrices_of(struct program *q)
{
    for (int t = 0; t < 3; t++) {
        sparse_done(&q->constant[t]);
        for (int h = 0; q->harmonic != NULL && h < q->harmonics; h++) {
            sparse_done(&q->harmonic[h].cosine[t]);
            sparse_done(&q->harmonic[h].sine[t]);
        }
    }
}

void craig_bampton_free(struct craig_bampton *a)
{
    if (a == NULL)
        return;
    free_matrices_of(&a->reduced);
    free_matrices_of(&a->finer);
    workspace_free(&a->space);
    free(a);
}

int craig_bampton_find(const struct craig_bampton *a, int dof)
{
    int low = 0, high = a->kept;

    while (low < high) {
        int middle = (low + high) / 2;

        if (a->dofs[middle] < dof)
            low = middle + 1;
        else
            high = middle;
    }
    return low < a->kept && a->dofs[low] == dof ? low : -1;
}
