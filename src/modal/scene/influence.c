/* influence.c - see influence.h
 *
 * States of the two programs, y = (s q, q', z) each in its own modes, are related by y = D y', D =
 * diag(S Phi^T M Phi' / S', Phi^T M Phi', 1), since x is the same: A' of (1) is D A' D^-1.
 * Eigenvalues are matched by the largest overlaps |l_i D r'_j|, |r'| = 1, greedily.  Where the
 * numbers of linear states differ, the common part of the states is compared.
 *
 * The change of the monodromy matrix to first order is the corner of that of twice the states:
 *
 *     Y' = [A dA; 0 A] Y,   dA(t) = A'(t) - A(t),   Y(T) = [Phi dPhi; 0 Phi].                   (2)
 */
#include "modal/scene/influence.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/eigen.h"
#include "modal/scene/magnus.h"
#include "modal/scene/statespace.h"

/* Relative, of maps over a period: two digits above rounding for what is compared, one less for
 * what is only a first-order estimate. */
static const double MAP_TOLERANCE = 1e-12;
static const double CHANGE_TOLERANCE = 1e-11;
static const double NO_EXPONENT = 1e-13;   /* |rho|: below it a multiplier is the map's rounding */

struct side {
    struct statespace *ss;
    double *X;                       /* N x N */
    /* eigenvalues, right eigenvectors, and (of `from`) left ones as rows */
    double complex *value, *V, *L;
    struct workspace space;          /* of the arrays */
};

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "influence: out of memory");
}

/* A where both are constant, else the monodromy matrix of this side. */
static enum modal_status matrix_of(struct side *side, bool periodic, double period,
                                   struct modal_error *err)
{
    struct statespace *ss = side->ss;
    size_t bytes = (size_t)ss->N * (size_t)ss->N * sizeof *side->X;
    struct magnus *m = NULL;
    int substeps = 16;  /* doubled from there */
    double error;
    enum modal_status rc;

    if ((side->X = workspace_zeros(&side->space, bytes, 1)) == NULL)
        return no_memory(err);
    if (!periodic) {
        memcpy(side->X, ss->A, bytes);  /* constant: A itself */
        return MODAL_OK;
    }
    rc = magnus_new(ss, NULL, &m, err);
    if (rc == MODAL_OK)
        rc = magnus_converge(m, 0, period, MAP_TOLERANCE, &substeps, side->X, &error, err);
    magnus_free(m);
    return rc;
}

/* Its eigenvalues with left and right vectors. */
static enum modal_status solve(struct side *side, bool periodic, double period,
                               struct modal_error *err)
{
    int N = side->ss->N;
    size_t count = (size_t)N * (size_t)N;
    double *copy = malloc(count * sizeof *copy + 1);
    struct matrix A = { N, N, N, copy };
    enum modal_status rc = matrix_of(side, periodic, period, err);

    side->value = workspace_zeros(&side->space, (size_t)N, sizeof *side->value);
    side->V = workspace_zeros(&side->space, count, sizeof *side->V);
    if (rc == MODAL_OK && (copy == NULL || side->space.failed))
        rc = no_memory(err);
    if (rc == MODAL_OK) {
        memcpy(copy, side->X, count * sizeof *copy);
        /* A is overwritten: it is a copy */
        rc = eigen_general(&A, side->value, NULL, side->V, err);
    }
    free(copy);
    return rc;
}

/* Rows of V^-1.  A defective matrix has none: the rows are then NAN. */
static enum modal_status left_vectors(struct side *side, struct modal_error *err)
{
    int N = side->ss->N;
    size_t count = (size_t)N * (size_t)N;
    double complex *copy = malloc(count * sizeof *copy + 1);
    int *pivot = malloc((size_t)N * sizeof *pivot + 1), info = -1;

    side->L = workspace_zeros(&side->space, count, sizeof *side->L);
    if (copy != NULL && pivot != NULL && side->L != NULL) {
        memcpy(copy, side->V, count * sizeof *copy);
        for (int i = 0; i < N; i++)
            side->L[(size_t)i * ((size_t)N + 1)] = 1;  /* the identity: V L = 1 */
        info = LAPACKE_zgesv(LAPACK_COL_MAJOR, N, N, copy, N, pivot, side->L, N);
        for (size_t i = 0; info != 0 && i < count; i++)
            side->L[i] = NAN;  /* defective: told as such */
    }
    free(copy);
    free(pivot);
    return info >= 0 ? MODAL_OK : no_memory(err);
}

/* D (a->N x b->N): states of b in the coordinates of a. */
static double *change(const struct statespace *a, const struct statespace *b)
{
    int n = a->n, nz = a->nz < b->nz ? a->nz : b->nz;
    size_t Na = (size_t)a->N;
    double *D = calloc(Na * (size_t)b->N + 1, sizeof *D),
           *work = calloc((size_t)n * (size_t)n + 1, sizeof *work);
    const struct sparse *M = &a->p->constant[PROGRAM_M];

    for (int j = 0; D != NULL && work != NULL && j < n; j++)
        sparse_multiply_add(M, 1, b->phi + (size_t)j * (size_t)n, work + (size_t)j * (size_t)n);
    if (D != NULL && work != NULL)
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, n, n, n, 1, a->phi, n, work, n, 0,
                    D + (size_t)n + (size_t)n * Na, (int)Na);
    for (int j = 0; D != NULL && j < n; j++)
        for (int i = 0; i < n; i++)
            D[(size_t)i + (size_t)j * Na] =
                a->s[i] * D[(size_t)(n + i) + (size_t)(n + j) * Na] / b->s[j];
    for (int k = 0; D != NULL && k < nz; k++)
        D[(size_t)(2 * n + k) + (size_t)(2 * n + k) * Na] = 1;
    if (work == NULL) {
        free(D);
        D = NULL;
    }
    free(work);
    return D;
}

/* OUT = D X_b D^-1, all N x N; X NULL: 0. */
static void carry(int N, const double *D, const double *X, const double *back, double *work,
                  double *out)
{
    if (X == NULL) {
        memset(out, 0, (size_t)N * (size_t)N * sizeof *out);
        return;
    }
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, N, N, N, 1, X, N, back, N, 0, work, N);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, N, N, N, 1, D, N, work, N, 0, out, N);
}

/* [X dX; 0 X] of 2 N, OF's, from X (NULL: 0) and MOVED = X + dX. */
static double *doubled(struct statespace *of, int N, const double *X, const double *moved)
{
    size_t n = (size_t)N;
    double *out = workspace_zeros(&of->space, 4 * n * n, sizeof *out);

    for (size_t j = 0; out != NULL && j < n; j++)
        for (size_t i = 0; i < n; i++) {
            double x = X != NULL ? X[i + j * n] : 0;
            out[i + j * 2 * n] = out[n + i + (n + j) * 2 * n] = x;
            out[i + (n + j) * 2 * n] = moved[i + j * n] - x;
        }
    return out;
}

/* NULL: this side has no such harmonic. */
static const struct statespace_harmonic *harmonic_of(const struct statespace *ss, int k)
{
    for (int h = 0; h < ss->harmonics; h++)
        if (ss->harmonic[h].k == k)
            return &ss->harmonic[h];
    return NULL;
}

/* What pulsates with K in either, doubled, behind those of OUT. */
static bool add_harmonic(struct statespace *out, const struct side *a, const struct side *b, int k,
                         const double *D, const double *back, double *work)
{
    int N = a->ss->N;
    size_t count = (size_t)N * (size_t)N;
    const struct statespace_harmonic *from = harmonic_of(a->ss, k), *to = harmonic_of(b->ss, k);
    struct statespace_harmonic *h = &out->harmonic[out->harmonics++];

    h->k = k;  /* of both sides */
    carry(N, D, to != NULL ? to->cosine : NULL, back, work, work + count);
    h->cosine = doubled(out, N, from != NULL ? from->cosine : NULL, work + count);
    carry(N, D, to != NULL ? to->sine : NULL, back, work, work + count);
    h->sine = doubled(out, N, from != NULL ? from->sine : NULL, work + count);
    return !out->space.failed;
}

/* The system (2): room for it is OUT's, which statespace_free frees. */
static enum modal_status doubled_system(const struct side *a, const struct side *b, const double *D,
                                        const double *back, double *work, struct statespace *out,
                                        struct modal_error *err)
{
    int N = a->ss->N;
    size_t count = (size_t)N * (size_t)N;
    bool whole;

    out->p = a->ss->p->harmonics > 0 ? a->ss->p : b->ss->p;
    out->N = 2 * N;  /* twice the states */
    out->harmonic = workspace_zeros(
        &out->space, (size_t)(a->ss->harmonics + b->ss->harmonics), sizeof *out->harmonic);
    carry(N, D, b->ss->A, back, work, work + count);
    out->A = doubled(out, N, a->ss->A, work + count);
    whole = !out->space.failed;
    for (int h = 0; whole && h < a->ss->harmonics; h++)
        whole = add_harmonic(out, a, b, a->ss->harmonic[h].k, D, back, work);
    for (int h = 0; whole && h < b->ss->harmonics; h++)
        if (harmonic_of(a->ss, b->ss->harmonic[h].k) == NULL)
            whole = add_harmonic(out, a, b, b->ss->harmonic[h].k, D, back, work);
    return whole ? MODAL_OK : no_memory(err);
}

/* dPhi of (2) into OUT; WORK holds 2 N^2. */
static enum modal_status monodromy_change(const struct side *a, const struct side *b, double period,
                                          const double *D, const double *back, double *work,
                                          double *out, struct modal_error *err)
{
    int N = a->ss->N, substeps = 16;
    struct statespace *ss = calloc(1, sizeof *ss);
    struct magnus *m = NULL;
    double *map = malloc(4 * (size_t)N * (size_t)N * sizeof *map + 1), error;
    enum modal_status rc =
        ss != NULL && map != NULL ? doubled_system(a, b, D, back, work, ss, err) : no_memory(err);

    if (rc == MODAL_OK)
        rc = magnus_new(ss, NULL, &m, err);
    if (rc == MODAL_OK)
        rc = magnus_converge(m, 0, period, CHANGE_TOLERANCE, &substeps, map, &error, err);
    for (size_t j = 0, n = (size_t)N; rc == MODAL_OK && j < n; j++)
        memcpy(out + j * n, map + (n + j) * 2 * n, n * sizeof *out);
    magnus_free(m);
    statespace_free(ss);
    free(map);
    return rc;
}

/* l_i X r_i for every eigenvalue of a. */
static void project(const struct side *a, const double *X, double complex *out)
{
    size_t N = (size_t)a->ss->N;

    for (size_t i = 0; i < N; i++) {
        out[i] = 0;
        for (size_t k = 0; k < N; k++) {
            double complex row = 0;
            for (size_t j = 0; j < N; j++)
                row += a->L[i + j * N] * X[j + k * N];  /* l_i X */
            out[i] += row * a->V[k + i * N];  /* .. r_i */
        }
    }
}

/* (1) for every eigenvalue of a. */
static enum modal_status estimate(const struct side *a, const struct side *b,
                                  const struct influence *f, double complex *out,
                                  struct modal_error *err)
{
    int N = a->ss->N;
    size_t count = (size_t)N * (size_t)N;
    double *D = change(a->ss, b->ss), *back = change(b->ss, a->ss),  /* D and D^-1 */
           *work = malloc(2 * count * sizeof *work + 1),
           *difference = malloc(count * sizeof *work + 1);
    enum modal_status rc =
        D != NULL && back != NULL && work != NULL && difference != NULL ? MODAL_OK : no_memory(err);

    if (rc == MODAL_OK && f->periodic)
        rc = monodromy_change(a, b, f->period, D, back, work, difference, err);
    else if (rc == MODAL_OK) {
        carry(N, D, b->X, back, work, difference);
        cblas_daxpy((int)count, -1, a->X, 1, difference, 1);  /* dX = A' - A */
    }
    if (rc == MODAL_OK)
        project(a, difference, out);
    free(D);
    free(back);
    free(work);
    free(difference);
    return rc;
}

/* match[i]: which eigenvalue of b is i's, -1 none. */
static enum modal_status pair_up(const struct side *a, const struct side *b, int *match,
                                 struct modal_error *err)
{
    int Na = a->ss->N, Nb = b->ss->N;
    double *D = change(a->ss, b->ss),
           *overlap = calloc((size_t)Na * (size_t)Nb + 1, sizeof *overlap);
    double complex *moved = calloc((size_t)Na + 1, sizeof *moved);
    enum modal_status rc =
        D != NULL && overlap != NULL && moved != NULL ? MODAL_OK : no_memory(err);

    for (int j = 0; rc == MODAL_OK && j < Nb; j++) {
        for (int i = 0; i < Na; i++) {
            moved[i] = 0;  /* D r'_j */
            for (int k = 0; k < Nb; k++)
                moved[i] += D[(size_t)i + (size_t)k * (size_t)Na]
                            * b->V[(size_t)k + (size_t)j * (size_t)Nb];
        }
        for (int i = 0; i < Na; i++) {
            double complex sum = 0;
            for (int k = 0; k < Na; k++)
                sum += a->L[(size_t)i + (size_t)k * (size_t)Na] * moved[k];
            overlap[(size_t)i + (size_t)j * (size_t)Na] =
                isnan(cabs(sum)) ? 1 / (1 + cabs(a->value[i] - b->value[j])) : cabs(sum);
        }
    }
    for (int i = 0; i < Na; i++)
        match[i] = -1;
    for (int pairs = 0; rc == MODAL_OK && pairs < Na && pairs < Nb; pairs++) {
        size_t best = 0;
        for (size_t k = 0; k < (size_t)Na * (size_t)Nb; k++)
            if (overlap[k] > overlap[best])
                best = k;
        int i = (int)(best % (size_t)Na), j = (int)(best / (size_t)Na);
        if (overlap[best] < 0)  /* all of a or of b are taken */
            break;
        match[i] = j;  /* the best of all that are left */
        for (int k = 0; k < Nb; k++)
            overlap[(size_t)i + (size_t)k * (size_t)Na] = -1;
        for (int k = 0; k < Na; k++)
            overlap[(size_t)k + (size_t)j * (size_t)Na] = -1;
    }
    free(D);
    free(overlap);
    free(moved);
    return rc;
}

/* Of a value of `matrix_of`: itself, or the principal logarithm over the period. */
static double complex exponent(double complex value, const struct influence *f)
{
    if (!f->periodic)
        return value;
    return cabs(value) > NO_EXPONENT ? clog(value) / f->period : CMPLX(NAN, NAN);
}

/* -max Re exponent of those that are above rounding. */
static double margin(const double complex *value, int count, const struct influence *f)
{
    double most = -HUGE_VAL;

    for (int i = 0; i < count; i++)
        most = fmax(most, creal(exponent(value[i], f)));
    return -most;
}

/* (1) and the matched pairs into F. */
static enum modal_status fill(struct influence *f, const struct side *a, const struct side *b,
                              struct modal_error *err)
{
    int N = a->ss->N, *match = malloc((size_t)N * sizeof *match + 1);
    bool alike = a->ss->nz == b->ss->nz;  /* else (1) compares different states */
    enum modal_status rc;

    f->count = N;
    f->from = workspace_zeros(&f->space, (size_t)N, sizeof *f->from);
    f->to = workspace_zeros(&f->space, (size_t)N, sizeof *f->to);
    f->first_order = workspace_zeros(&f->space, (size_t)N, sizeof *f->first_order);
    rc = match != NULL && !f->space.failed
             ? pair_up(a, b, match, err)
             : no_memory(err);
    if (rc == MODAL_OK && alike)
        rc = estimate(a, b, f, f->first_order, err);
    for (int i = 0; rc == MODAL_OK && i < N; i++) {
        f->from[i] = exponent(a->value[i], f);
        f->to[i] = match[i] >= 0 ? exponent(b->value[match[i]], f) : CMPLX(NAN, NAN);
        f->first_order[i] = !alike        ? CMPLX(NAN, NAN)
                            : f->periodic ? f->first_order[i] / (a->value[i] * f->period)
                                          : f->first_order[i];
    }
    f->margin_from = margin(a->value, N, f);
    f->margin_to = margin(b->value, b->ss->N, f);
    free(match);
    return rc;
}

/* Also of a side half made. */
static void side_done(struct side *s)
{
    statespace_free(s->ss);
    workspace_free(&s->space);
}

enum modal_status influence(const struct program *from, const struct program *to,
                            struct influence *out, struct modal_error *err)
{
    struct influence f = { .periodic = from->harmonics > 0 || to->harmonics > 0 };
    struct side a = { 0 }, b = { 0 };
    enum modal_status rc = MODAL_OK;

    /* of either: they are one scene but for an effect */
    f.period = from->period > 0 ? from->period : from->omega > 0 ? 2 * M_PI / from->omega : 0;
    if (from->laws > 0 || to->laws > 0 || from->n != to->n)
        return modal_fail_field(err, MODAL_BAD_INPUT, "effects",
                                from->n != to->n ? "the two scenes differ in their dofs"
                                                 : "exponents are of linear scenes; give the scene "
                                                   "an excitation, and steady states are compared");
    rc = statespace_new(from, &a.ss, err);
    if (rc == MODAL_OK)
        rc = statespace_new(to, &b.ss, err);
    if (rc == MODAL_OK)
        rc = solve(&a, f.periodic, f.period, err);
    if (rc == MODAL_OK)
        rc = solve(&b, f.periodic, f.period, err);
    if (rc == MODAL_OK)
        rc = left_vectors(&a, err);
    if (rc == MODAL_OK)
        rc = fill(&f, &a, &b, err);
    side_done(&a);
    side_done(&b);
    if (rc == MODAL_OK)
        *out = f;
    else
        influence_done(&f);
    return rc;
}

void influence_done(struct influence *f)
{
    workspace_free(&f->space);
    memset(f, 0, sizeof *f);
}
