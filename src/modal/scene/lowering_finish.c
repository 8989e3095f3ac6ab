/*
 * lowering_finish.c - see lowering.h
 *
 * Entries become compressed matrices, and the program is checked as a whole: its mass is positive
 * definite (banded Cholesky) and its period fits every harmonic.
 */
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include "modal/scene/lowering.h"

/* of a period's cycles: period and omega with ten digits */
static const double CYCLE_ROUNDING = 1e-9;

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
}

/* Entries into compressed rows; no entries: an empty matrix of m = 0, but for M, C, K
 * themselves. */
static enum modal_status compress(const struct lowering_entries *e, int m, int n, bool always,
                                  struct sparse *out, struct modal_error *err)
{
    if (e->count == 0 && !always)  /* m = 0 says: none */
        return MODAL_OK;
    return sparse_from_triplets(m, n, e->x, e->count, out, err);
}

/* Empty matrices of a harmonic stay empty, so that a step need not add zeros. */
static enum modal_status compress_harmonics(struct lowering *l, struct modal_error *err)
{
    struct program *p = l->p;
    enum modal_status rc = MODAL_OK;

    if (l->harmonics == 0)
        return MODAL_OK;
    if ((p->harmonic = calloc((size_t)l->harmonics, sizeof *p->harmonic)) == NULL)
        return no_memory(err);
    p->harmonics = l->harmonics;
    for (int h = 0; h < l->harmonics; h++) {
        p->harmonic[h].k = l->harmonic[h].k;  /* ascending already */
        for (int i = 0; i < 3 && rc == MODAL_OK; i++) {
            rc = compress(&l->harmonic[h].cosine[i], p->n, p->n, false, &p->harmonic[h].cosine[i],
                          err);
            if (rc == MODAL_OK)
                rc = compress(&l->harmonic[h].sine[i], p->n, p->n, false, &p->harmonic[h].sine[i],
                              err);
        }
    }
    return rc;
}

/* Triplets of one place add up here. */
static enum modal_status compress_all(struct lowering *l, struct modal_error *err)
{
    struct program *p = l->p;
    /* in the order of enum lowering_block */
    struct sparse *block[LOWER_BLOCKS] = { &p->E, &p->A, &p->Bx, &p->Bv, &p->Ba, &p->F };
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < 3 && rc == MODAL_OK; i++)
        rc = compress(&l->constant[i], p->n, p->n, true, &p->constant[i], err);
    if (rc == MODAL_OK)
        rc = compress_harmonics(l, err);
    for (int i = 0; i < LOWER_BLOCKS && rc == MODAL_OK && p->n_linear > 0; i++)
        rc = compress(&l->block[i], i == LOWER_F ? p->n : p->n_linear,
                      i == LOWER_E || i == LOWER_A || i == LOWER_F ? p->n_linear : p->n, true,
                      block[i], err);
    return rc;
}

/* M_0 positive definite, by a Cholesky factor of its band: n b^2 operations, b the bandwidth. */
static enum modal_status check_mass(const struct lowering *l, struct modal_error *err)
{
    const struct program *p = l->p;
    const struct sparse *M = &p->constant[PROGRAM_M];
    int b = 0, info;
    double *band;

    for (int i = 0; i < M->m; i++)
        for (int k = M->start[i]; k < M->start[i + 1]; k++)
            /* half the bandwidth */
            b = M->index[k] > i && M->index[k] - i > b ? M->index[k] - i : b;
    /* n (b + 1), not n^2: a beam's b is 7 */
    if ((band = calloc((size_t)(b + 1) * (size_t)p->n, sizeof *band)) == NULL)
        return no_memory(err);
    for (int i = 0; i < M->m; i++)
        for (int k = M->start[i]; k < M->start[i + 1]; k++)
            /* upper: entry (i, j) at [b + i - j + j (b + 1)] */
            if (M->index[k] >= i)
                band[(size_t)(b + i - M->index[k]) + (size_t)M->index[k] * (size_t)(b + 1)] =
                    M->value[k];
    /* fails at the first minor that is not positive */
    info = LAPACKE_dpbtrf(LAPACK_COL_MAJOR, 'U', p->n, b, band, b + 1);
    free(band);
    if (info == 0)
        return MODAL_OK;
    return modal_fail_field(
        err, MODAL_BAD_INPUT,
        json_member(json_member(l->scene, "structure"), "M") != NULL ? "structure.M" : "structure",
        "the mass matrix is not positive definite (at dof %s)", p->dofs[info > 0 ? info - 1 : 0]);
}

/* A period must hold a whole number of cycles of every harmonic. */
static enum modal_status check_period(const struct program *p, struct modal_error *err)
{
    for (int h = 0; h < p->harmonics && p->period > 0; h++) {
        /* k Omega T / 2 pi */
        double cycles = p->harmonic[h].k * p->omega * p->period / (2 * M_PI);
        if (!(fabs(cycles - round(cycles)) <= CYCLE_ROUNDING * cycles) || round(cycles) < 1)
            return modal_fail_field(err, MODAL_BAD_INPUT, "period",
                                    "the period %g s holds %.10g cycles of the scene's harmonic %d "
                                    "of omega = %g rad/s; "
                                    "it must hold a whole number",
                                    p->period, cycles, p->harmonic[h].k, p->omega);
    }
    return MODAL_OK;
}

enum modal_status lowering_finish(struct lowering *l, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (l->no_memory)  /* remembered since any adding */
        return no_memory(err);
    if (l->too_many)
        return modal_fail_field(
            err, MODAL_TOO_LARGE, "effects",
            "the scene lowers to more than %d entries of a matrix, %d linear states or %d "
            "couplings of dofs by laws",
            LOWERING_ENTRIES_MOST, LOWERING_STATES_MOST, LOWERING_COUPLINGS_MOST);
    rc = compress_all(l, err);
    if (rc == MODAL_OK)
        rc = check_mass(l, err);
    if (rc == MODAL_OK)
        rc = check_period(l->p, err);
    if (rc == MODAL_OK)
        program_hash(l->p);  /* last: it covers all of the program */
    return rc;
}
