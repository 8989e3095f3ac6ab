/*
 * hill_growth.c - see hill_growth.h
 *
 * The constant part is parted into one that takes energy and a few entries more, Q = Q+ + V_0: for
 * Re s >= g and real x
 *
 *     Re conj(s) x^H (s^2 M + s C + K) x >= g x^H (|s|^2 (M + C / Re s) + K) x                  (1)
 *
 * is positive where sym(C) + M g / 2 and sym(K) + M g^2 / 2 are, however C turns motions, so that
 * Q+ has no exponent there.  Those two are eliminated along their diagonals; what a pivot lacks is
 * put on its diagonal and taken back in V_0, as is the unsymmetric part of K.  With what pulsates,
 * V, the exponents right of g are the zeros of
 *
 *     D(s) = det(I + G V),   G = diag_k Q+^-1(s + i k W),                                       (2)
 *
 * which has no pole there, is 1 far to the right and has the period i W.  V has the rows and
 * columns of a few dofs alone, so that (2) is of these, banded by harmonics.  The count is the
 * turns of D along Re s = g, Nyquist's; D is real at s = g and, to the harmonics kept, at
 * s = g + i W / 2.
 *
 * Where stiffnesses pulsate slowly, however many, there is no need to count: with symmetric ones
 * the energy x'^H M x' + x^H (K(t) + g^2 M) x grows by no more than 2 g times itself where
 *
 *     C(t) + M g / 2,   K(t) + g^2 M,   2 g K(t) - K'(t) + g^3 M                                (3)
 *
 * are positive, for 2 g^2 x'^H M x <= g x'^H M x' + g^3 x^H M x.
 *
 * How many harmonics (2) needs: where (1) holds for g / 2 as well, F(s) = s Q+^-1(s) has a positive
 * hermitian part right of there, and so y^H F y moves by no more than Schwarz and Pick's lemma
 * lets it, from s = g + i w to any s' = g / 2 + r + i w':
 *
 *     |y^H F(s) y| <= (a + b) / (a - b) |y^H F(s') y|,   a, b = |g / 2 +- r + i (w - w')|,      (4)
 *
 * and |F| is at most twice the largest of these.  With r = w' one factorization bounds a whole
 * octave, however many motions lie there: what stiff rows make fast moves few ports.
 *
 * Of harmonics above some L all rows of G V, of |entries| summed, are to be at most q < 1: above
 * all motions by rows of M^-1 K, below that octave by octave by (4), both of displacements as they
 * are, so that the whole block left out has this norm.  It turns D by nothing, then, and adds to
 * what is kept what leads out and back.  With m times the highest harmonic of V kept beyond L, a
 * way out from there and back has 2 m steps at least, so that what it adds to the rows up to L,
 *
 *     |B| q q^2m / (1 - q) < 1 / |T^-1|,   |B| <= |T|, T of the harmonics kept,                 (5)
 *
 * leaves them regular on its way in from 0: where it is so along the line, the count stands.
 */
#include "modal/scene/hill_growth.h"
#include <cblas.h>
#include <complex.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/sparse_lu.h"
#include "modal/linalg/workspace.h"
#include "modal/scene/dofwise.h"
#include "modal/scene/hill_window.h"

enum {
    PORTS_MOST = 48,             /* dofs of V: chosen, its factors take their square */
    TERMS_MOST = 1000000,        /* harmonics: no int overflows */
    HALVED = 12,                 /* times that a stretch of the line may be */
    TIMES = 16,                  /* of the highest harmonic's cycle, at which (3) is asked */
    MARGIN = 7,                  /* m of (5), at first: of conditions up to 1600 */
    DENSE = 4,                   /* dense operations in the time of one, as BUDGET_DENSE */
};
static const double TURN = M_PI / 3;     /* from one point of the line to the next, at most */
static const double SLOWER = 0.5;        /* of g: what (3) is asked with, for between those times */
static const double WHOLE = 0.05;        /* of a half turn: what harmonics left out may take */
static const double GAIN = 0.5;          /* of what is left out, q of (5) */
static const double ESTIMATED = 10;      /* times |T^-1| is more than LAPACK tells, at most */
static const double SYMMETRIC = 1e-12;   /* of an entry: the one across differs by no more */
static const double ROUNDING = 1e-13;    /* of a diagonal entry: what its pivot is off by */
static const double PIVOT = 1e-3;        /* of its diagonal entry: less makes others large */
static const double STRETCH = 0.5;       /* of g, from point to point: no pole is nearer than g */
static const double COMPLEX = 8;         /* operations of one multiplied and added */
static const double SOLVED = 10;         /* operations an entry of the factors' pattern, solved */

struct count {
    const struct program *p;
    double W, rate, most, work;
    int n, ports, terms, reach, unit;    /* harmonics to a side; the highest that pulsates */
    int core;                            /* L of (5) */
    double regular;                      /* 1 / (|T| |T^-1|), the least along the line */
    struct sparse part[3];               /* of Q+ */
    struct sparse all;                   /* where any of them has entries */
    double *value[3];                    /* there */
    double complex *q, *right, *x;       /* Q+ at a point; n each */
    struct sparse_lu *Q;
    double *root;                        /* n: of the masses */
    int *port, *place;                   /* dofs; of dof, or -1 */
    struct sparse extra[3];              /* V_0, of C and K */
    double complex *G, *T, *band;        /* ports^2 by terms; ports^2; (2) */
    double *row;                         /* of (2): |entries| summed */
    int *pivots;
    struct workspace space, room;        /* ROOM: of (2) */
};

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "growth: out of memory");
}

/* FACTOR A's entries, or those of its transpose, from E on; the end. */
static struct triplet *list(const struct sparse *A, double factor, bool across, struct triplet *e)
{
    for (int i = 0; i < A->m; i++)
        for (int k = A->start[i]; k < A->start[i + 1]; k++)
            *e++ = (struct triplet){ across ? A->index[k] : i, across ? i : A->index[k],
                                     factor * A->value[k] };
    return e;
}

/* OUT = a A + b A^T + c B, all of order n. */
static enum modal_status combine(int n, double a, double b, const struct sparse *A, double c,
                                 const struct sparse *B, struct sparse *out,
                                 struct modal_error *err)
{
    size_t most = (A->m > 0 ? 2 * (size_t)A->start[A->m] : 0)
                  + (B->m > 0 ? (size_t)B->start[B->m] : 0);
    struct triplet *e = malloc(most * sizeof *e + 1), *end = e;
    enum modal_status rc;

    if (e == NULL)
        return no_memory(err);
    end = a != 0 ? list(A, a, false, end) : end;
    end = b != 0 ? list(A, b, true, end) : end;
    end = c != 0 ? list(B, c, false, end) : end;
    rc = sparse_from_triplets(n, n, e, (int)(end - e), out, err);
    free(e);
    return rc;
}

/* What sym(A) + SHIFT M lacks of being positive into LACK, of the dofs whose pivots lack it; where
 * it is not positive a pivot that is small and no rounding lacks it too, lest those after it do. */
static enum modal_status find_lack(const struct count *s, const struct sparse *A, double shift,
                                   double *lack, struct modal_error *err)
{
    struct sparse sum = { 0 };
    enum modal_status rc = combine(s->n, 0.5, 0.5, A, shift, &s->p->constant[PROGRAM_M], &sum,
                                   err);
    struct sparse_lu *f = NULL;
    struct sparse_lu_pivot bad = { 0, 0 };

    if (rc == MODAL_OK)
        rc = sparse_lu_new(s->n, sum.start, sum.index, false, &f, err);
    if (rc == MODAL_OK && !sparse_lu_diagonal(f, sum.value, ROUNDING, &bad))
        bad.row = 0;
    for (int tries = 0; rc == MODAL_OK && bad.row >= 0; tries++) {
        if (tries > PORTS_MOST)
            rc = modal_fail(err, MODAL_TOO_LARGE, "%d dofs push away from rest", tries);
        else if (!sparse_lu_diagonal(f, sum.value, PIVOT, &bad))
            rc = modal_fail(err, MODAL_TOO_LARGE, "no pivots along the diagonal");
        if (rc == MODAL_OK && bad.row >= 0)
            for (int k = sum.start[bad.row]; k < sum.start[bad.row + 1]; k++)
                if (sum.index[k] == bad.row) {
                    double more = fabs(sum.value[k]) - bad.value;
                    sum.value[k] += more;
                    lack[bad.row] += more;
                }
    }
    sparse_lu_free(f);
    sparse_done(&sum);
    return rc;
}

/* Q+ and V_0 of the opening. */
static enum modal_status part(struct count *s, struct modal_error *err)
{
    const struct sparse none = { 0 };
    struct workspace scratch = { 0 };
    enum modal_status rc = combine(s->n, 1, 0, &s->p->constant[PROGRAM_M], 0, &none,
                                   &s->part[PROGRAM_M], err);

    for (int which = PROGRAM_C; rc == MODAL_OK && which <= PROGRAM_K; which++) {
        const struct sparse *A = &s->p->constant[which];
        double shift = which == PROGRAM_C ? s->rate / 2 : s->rate * s->rate / 2,
               *lack = workspace_zeros(&scratch, (size_t)s->n, sizeof *lack);
        struct triplet *e = workspace_zeros(&scratch, (size_t)s->n, sizeof *e);
        struct sparse more = { 0 };
        int count = 0;

        rc = scratch.failed ? no_memory(err) : find_lack(s, A, shift, lack, err);
        for (int i = 0; rc == MODAL_OK && i < s->n; i++)
            if (lack[i] > 0)
                e[count++] = (struct triplet){ i, i, lack[i] };
        if (rc == MODAL_OK)
            rc = sparse_from_triplets(s->n, s->n, e, count, &more, err);
        if (rc == MODAL_OK)      /* what turns motions takes no energy as a damping alone */
            rc = which == PROGRAM_C ? combine(s->n, 1, 0, A, 1, &more, &s->part[which], err)
                                    : combine(s->n, 0.5, 0.5, A, 1, &more, &s->part[which], err);
        if (rc == MODAL_OK)
            rc = which == PROGRAM_C ? combine(s->n, 0, 0, A, -1, &more, &s->extra[which], err)
                                    : combine(s->n, 0.5, -0.5, A, -1, &more, &s->extra[which], err);
        sparse_done(&more);
    }
    workspace_free(&scratch);
    return rc;
}

/* The dofs of A's entries become ports. */
static void see(struct count *s, const struct sparse *A)
{
    for (int i = 0; i < A->m; i++)
        for (int k = A->start[i]; k < A->start[i + 1]; k++)
            if (A->value[k] != 0)
                s->place[i] = s->place[A->index[k]] = 0;
}

static enum modal_status find_ports(struct count *s, struct modal_error *err)
{
    s->place = workspace_zeros(&s->space, (size_t)s->n, sizeof *s->place);
    s->port = workspace_zeros(&s->space, (size_t)s->n, sizeof *s->port);
    if (s->space.failed)
        return no_memory(err);
    for (int i = 0; i < s->n; i++)
        s->place[i] = -1;
    for (int which = PROGRAM_C; which <= PROGRAM_K; which++) {
        see(s, &s->extra[which]);
        for (int h = 0; h < s->p->harmonics; h++) {
            see(s, &s->p->harmonic[h].cosine[which]);
            see(s, &s->p->harmonic[h].sine[which]);
        }
    }
    for (int i = 0; i < s->n; i++)
        if (s->place[i] == 0) {
            s->place[i] = s->ports;
            s->port[s->ports++] = i;
        }
    if (s->ports > PORTS_MOST)
        return modal_fail(err, MODAL_TOO_LARGE, "%d dofs pulsate or push away from rest", s->ports);
    return MODAL_OK;
}

/* One structure for M, C and K of Q+, by rows. */
static enum modal_status join(struct count *s, struct modal_error *err)
{
    struct triplet *e, *end;
    size_t count = 0, ports = (size_t)s->ports;
    enum modal_status rc;

    for (int which = PROGRAM_M; which <= PROGRAM_K; which++)
        count += (size_t)s->part[which].start[s->n];
    e = end = malloc(count * sizeof *e + 1);
    if (e == NULL)
        return no_memory(err);
    for (int which = PROGRAM_M; which <= PROGRAM_K; which++)
        end = list(&s->part[which], 1, false, end);
    for (size_t i = 0; i < count; i++)
        e[i].value = 1;
    rc = sparse_from_triplets(s->n, s->n, e, (int)count, &s->all, err);
    free(e);
    if (rc != MODAL_OK)
        return rc;
    count = (size_t)s->all.start[s->n];
    for (int which = PROGRAM_M; which <= PROGRAM_K; which++) {
        const struct sparse *A = &s->part[which];
        double *value = workspace_zeros(&s->space, count, sizeof *value);
        for (int i = 0; value != NULL && i < s->n; i++)
            for (int k = A->start[i], at = s->all.start[i]; k < A->start[i + 1]; k++) {
                while (s->all.index[at] < A->index[k])
                    at++;
                value[at] = A->value[k];
            }
        s->value[which] = value;
    }
    s->q = workspace_zeros(&s->space, count, sizeof *s->q);
    s->right = workspace_zeros(&s->space, (size_t)s->n, sizeof *s->right);
    s->x = workspace_zeros(&s->space, (size_t)s->n + ports * ports, sizeof *s->x);
    s->T = workspace_zeros(&s->space, ports * ports, sizeof *s->T);
    s->root = workspace_zeros(&s->space, (size_t)s->n, sizeof *s->root);
    if (s->space.failed)
        return no_memory(err);
    for (int i = 0; i < s->n; i++)
        for (int k = s->all.start[i]; k < s->all.start[i + 1]; k++)
            if (s->all.index[k] == i)
                s->root[i] = sqrt(fabs(s->value[PROGRAM_M][k]));
    return sparse_lu_new(s->n, s->all.start, s->all.index, true, &s->Q, err);
}

/* What ports see of Q+ at RATE: G(i, j), column by column. */
static enum modal_status respond(struct count *s, double complex rate, double complex *G,
                                 struct modal_error *err)
{
    size_t ports = (size_t)s->ports;

    for (int k = 0; k < s->all.start[s->n]; k++)
        s->q[k] = rate * rate * s->value[PROGRAM_M][k] + rate * s->value[PROGRAM_C][k]
                  + s->value[PROGRAM_K][k];
    if (!sparse_lu_factor(s->Q, s->q))   /* of rows taken for columns */
        return modal_fail(err, MODAL_NO_CONVERGENCE, "growth: no factors at %g%+gi",
                          creal(rate), cimag(rate));
    for (size_t i = 0; i < ports; i++) {
        s->right[s->port[i]] = 1;
        sparse_lu_solve(s->Q, s->right, s->x);
        s->right[s->port[i]] = 0;
        for (size_t j = 0; j < ports; j++)
            G[i + j * ports] = s->x[s->port[j]];
    }
    s->work += sparse_lu_work(s->Q) / DENSE + SOLVED * (double)ports * s->all.start[s->n];
    return MODAL_OK;
}

/* Is A, symmetric, positive? */
static enum modal_status is_definite(const struct sparse *A, bool *positive,
                                     struct modal_error *err)
{
    struct sparse_lu *f = NULL;
    struct sparse_lu_pivot lacks;
    enum modal_status rc = sparse_lu_new(A->m, A->start, A->index, false, &f, err);

    *positive = rc == MODAL_OK && sparse_lu_diagonal(f, A->value, ROUNDING, &lacks)
                && lacks.row < 0;
    sparse_lu_free(f);
    return rc;
}

/* Does (1) hold for g / 2 as well? */
static enum modal_status is_passive(const struct count *s, bool *passive, struct modal_error *err)
{
    double g = s->rate / 2;
    enum modal_status rc = MODAL_OK;

    *passive = true;
    for (int which = PROGRAM_C; rc == MODAL_OK && *passive && which <= PROGRAM_K; which++) {
        struct sparse sum = { 0 };
        rc = combine(s->n, 0.5, 0.5, &s->part[which], which == PROGRAM_C ? g / 2 : g * g / 2,
                     &s->part[PROGRAM_M], &sum, err);
        if (rc == MODAL_OK)
            rc = is_definite(&sum, passive, err);
        sparse_done(&sum);
    }
    return rc;
}

/* From where on rows of V times Q+^-1 are below GAIN, rad/s: |s|^2 is more than |s C + K| there by
 * what V is over GAIN, which comes from rates higher by its harmonics. */
static double far_out(const struct count *s)
{
    struct program own = { .n = s->n };
    double frequency, decay, stiffness, rate;

    memcpy(own.constant, s->part, sizeof own.constant);
    dofwise_fastest(&own, &frequency, &decay);
    stiffness = frequency * frequency;
    rate = decay;
    for (int h = -1; h < 2 * s->p->harmonics; h++) {
        const struct program_harmonic *a = h >= 0 ? &s->p->harmonic[h / 2] : NULL;
        const struct sparse *of = a == NULL ? s->extra : h % 2 == 0 ? a->cosine : a->sine;
        memcpy(&own.constant[PROGRAM_C], of + PROGRAM_C, 2 * sizeof *of);
        dofwise_fastest(&own, &frequency, &decay);
        stiffness += (frequency * frequency + s->reach * s->W * decay) / GAIN;
        rate += decay / GAIN;
    }
    return sqrt(stiffness) + rate;
}

/* V's matrices WHICH, all added: of their rows' |entries| over the root of each row's mass, the
 * length over the least root of a mass.  A row of G V is no more than that times the length of G's
 * with both sides times the roots. */
static double size_of(const struct count *s, int which)
{
    double square = 0, least = HUGE_VAL;

    for (int i = 0; i < s->ports; i++) {
        int dof = s->port[i];
        double row = 0;

        for (int h = -1; h < 2 * s->p->harmonics; h++) {
            const struct program_harmonic *a = h >= 0 ? &s->p->harmonic[h / 2] : NULL;
            const struct sparse *A =
                a == NULL ? &s->extra[which] : h % 2 == 0 ? &a->cosine[which] : &a->sine[which];
            for (int k = A->m > 0 ? A->start[dof] : 0; A->m > 0 && k < A->start[dof + 1]; k++)
                row += fabs(A->value[k]);
        }
        square += row / s->root[dof] * row / s->root[dof];
        least = fmin(least, s->root[dof]);
    }
    return sqrt(square) / least;
}

/* (4)'s bound of rows of G V at all frequencies from 2/3 to 4/3 of PLACE. */
static enum modal_status bound_of(struct count *s, double place, double *bound,
                                  struct modal_error *err)
{
    size_t ports = (size_t)s->ports;
    double deep = s->rate - s->rate / 2, square = 0, shortest = place * 2 / 3,
           /* whence V leads there, at most */
           from = s->rate + place * 4 / 3 + s->reach * s->W;
    double complex here = CMPLX(s->rate / 2 + place, place);
    double a = hypot(deep + place, place / 3), b = hypot(deep - place, place / 3);
    enum modal_status rc = respond(s, here, s->T, err);

    for (size_t j = 0; j < ports; j++)
        for (size_t i = 0; i < ports; i++) {
            double g = cabs(s->T[i + j * ports]) * s->root[s->port[i]] * s->root[s->port[j]];
            square += g * g;
        }
    *bound = 2 * (a + b) * (a + b) / (4 * deep * place) * cabs(here) * sqrt(square) / shortest
             * (size_of(s, PROGRAM_K) + from * size_of(s, PROGRAM_C));
    return rc;
}

/* L of (5): below all motions octave by octave, where (4) holds. */
static enum modal_status choose_core(struct count *s, struct modal_error *err)
{
    double top = far_out(s), place, bound = 0;
    bool passive = false;
    enum modal_status rc = is_passive(s, &passive, err);

    for (place = top; rc == MODAL_OK && passive && place > s->reach * s->W; place /= 2) {
        rc = bound_of(s, place * 3 / 4, &bound, err);
        if (!(bound < GAIN))
            break;
    }
    if (rc == MODAL_OK && !(place / s->W < TERMS_MOST))
        return modal_fail(err, MODAL_TOO_LARGE, "growth: harmonics up to %g rad/s", place);
    s->core = rc == MODAL_OK ? (int)ceil(place / s->W) : 0;
    return rc;
}

/* T += FACTOR A at the ports. */
static void add(const struct count *s, const struct sparse *A, double complex factor)
{
    for (int i = 0; A->m > 0 && i < s->ports; i++)
        for (int k = A->start[s->port[i]]; k < A->start[s->port[i] + 1]; k++)
            if (s->place[A->index[k]] >= 0)
                s->T[i + s->place[A->index[k]] * s->ports] += factor * A->value[k];
}

/* T of (2): V from a motion at RATE, SIDE H up in harmonic; H 0: V_0. */
static void couple(struct count *s, const struct program_harmonic *a, int side,
                   double complex rate)
{
    memset(s->T, 0, (size_t)s->ports * (size_t)s->ports * sizeof *s->T);
    for (int which = PROGRAM_C; which <= PROGRAM_K; which++) {
        double complex factor = which == PROGRAM_C ? rate : 1;
        if (a == NULL) {
            add(s, &s->extra[which], factor);
            continue;
        }
        add(s, &a->cosine[which], factor / 2);
        add(s, &a->sine[which], -I * side * factor / 2);
    }
}

/* (2)'s block from harmonic FROM to TO, in LAPACK's band. */
static void add_block(struct count *s, int to, int from, int width)
{
    const double complex one = 1, zero = 0;
    int p = s->ports, ld = 3 * width + 1;
    double complex *block = s->x;        /* at least ports^2 */

    cblas_zgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, p, p, p, &one,
                s->G + (size_t)(to + s->terms) * (size_t)p * (size_t)p, p, s->T, p, &zero, block,
                p);
    for (int j = 0; j < p; j++)
        for (int i = 0; i < p; i++) {
            int row = (to + s->terms) * p + i, column = (from + s->terms) * p + j;
            s->band[(size_t)(2 * width + row - column) + (size_t)column * (size_t)ld] +=
                block[i + j * p];
        }
}

/* The factors of (2), N rows in a band of WIDTH to a side, and how regular it is. */
static enum modal_status factor(struct count *s, int N, int width, struct modal_error *err)
{
    int ld = 3 * width + 1;
    double norm = 0, regular = 0;

    memset(s->row, 0, (size_t)N * sizeof *s->row);
    for (int j = 0; j < N; j++)
        for (int i = j > width ? j - width : 0; i < N && i <= j + width; i++)
            s->row[i] += cabs(s->band[(size_t)(2 * width + i - j) + (size_t)j * (size_t)ld]);
    for (int i = 0; i < N; i++)
        norm = fmax(norm, s->row[i]);
    if (LAPACKE_zgbtrf(LAPACK_COL_MAJOR, N, N, width, width, s->band, ld, s->pivots) != 0
        || LAPACKE_zgbcon(LAPACK_COL_MAJOR, 'I', N, width, width, s->band, ld, s->pivots, norm,
                          &regular) != 0 || !(regular > 0))
        return modal_fail(err, MODAL_NO_CONVERGENCE, "growth: an exponent lies on the line");
    s->regular = fmin(s->regular, regular);
    s->work += COMPLEX * N * width * width / DENSE;
    return MODAL_OK;
}

/* The direction of D at the line's point TURN, over W. */
static enum modal_status determine(struct count *s, double turn, double complex *direction,
                                   struct modal_error *err)
{
    int p = s->ports, width = p * (s->reach + 1) - 1, N = p * (2 * s->terms + 1),
        ld = 3 * width + 1;
    enum modal_status rc = MODAL_OK;

    for (int k = -s->terms; rc == MODAL_OK && k <= s->terms; k++)
        rc = respond(s, CMPLX(s->rate, (turn + k) * s->W),
                     s->G + (size_t)(k + s->terms) * (size_t)p * (size_t)p, err);
    if (rc != MODAL_OK)
        return rc;
    memset(s->band, 0, (size_t)N * (size_t)ld * sizeof *s->band);
    for (int i = 0; i < N; i++)
        s->band[(size_t)(2 * width) + (size_t)i * (size_t)ld] = 1;
    for (int k = -s->terms; k <= s->terms; k++) {
        double complex rate = CMPLX(s->rate, (turn + k) * s->W);
        couple(s, NULL, 0, rate);
        add_block(s, k, k, width);
        for (int h = 0; h < 2 * s->p->harmonics; h++) {
            const struct program_harmonic *a = &s->p->harmonic[h / 2];
            int side = h % 2 == 0 ? 1 : -1, to = k + side * (a->k / s->unit);
            if (abs(to) > s->terms)
                continue;
            couple(s, a, side, rate);
            add_block(s, to, k, width);
        }
    }
    rc = factor(s, N, width, err);
    *direction = 1;
    for (int i = 0; rc == MODAL_OK && i < N; i++) {
        double complex u = s->band[(size_t)(2 * width) + (size_t)i * (size_t)ld];
        *direction *= (s->pivots[i] == i + 1 ? 1 : -1) * u / cabs(u);
    }
    return rc;
}

/* How far D turns from A on, where its direction is OF_A, to B, where it is OF_B. */
static enum modal_status turn(struct count *s, double a, double b, double complex of_a,
                              double complex of_b, int left, double *sum, struct modal_error *err)
{
    double here = carg(of_b / of_a);
    double complex middle;
    enum modal_status rc;

    if (left == 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "growth: an exponent lies on the line");
    if (s->work > s->most)
        return modal_fail(err, MODAL_TOO_LARGE, "growth: %g operations", s->work);
    rc = determine(s, (a + b) / 2, &middle, err);
    if (rc == MODAL_OK && fabs(here) <= TURN && fabs(carg(middle / of_a)) <= TURN
        && fabs(carg(of_b / middle)) <= TURN) {
        *sum += here;                    /* a whole turn more would show in the middle, mostly */
        return MODAL_OK;
    }
    if (rc == MODAL_OK)
        rc = turn(s, a, (a + b) / 2, of_a, middle, left - 1, sum, err);
    if (rc == MODAL_OK)
        rc = turn(s, (a + b) / 2, b, middle, of_b, left - 1, sum, err);
    return rc;
}

/* Room for (2), and whether it is not too much. */
static enum modal_status prepare(struct count *s, int points, struct modal_error *err)
{
    size_t p = (size_t)s->ports, terms = 2 * (size_t)s->terms + 1,
           width = p * ((size_t)s->reach + 1), size = terms * p * (3 * width + 1);
    double begun = s->work;
    enum modal_status rc;

    if (COMPLEX * (double)(terms * p * width * width) / DENSE * points > s->most)
        return modal_fail(err, MODAL_TOO_LARGE, "growth: %zu harmonics of %zu dofs", terms, p);
    workspace_free(&s->room);
    s->G = workspace_zeros(&s->room, terms * p * p, sizeof *s->G);
    s->band = workspace_zeros(&s->room, size, sizeof *s->band);
    s->row = workspace_zeros(&s->room, terms * p, sizeof *s->row);
    s->pivots = workspace_zeros(&s->room, terms * p, sizeof *s->pivots);
    if (s->room.failed)
        return no_memory(err);
    rc = respond(s, s->rate, s->G, err);
    if (rc == MODAL_OK)                  /* the next is as dear, without the analysis */
        rc = respond(s, CMPLX(s->rate, s->W), s->G, err);
    if (rc == MODAL_OK && (s->work - begun) / 2 * (double)terms * points > s->most)
        rc = modal_fail(err, MODAL_TOO_LARGE, "growth: %zu harmonics at %d points", terms, points);
    return rc;
}

/* The half turns of D from s = g to s = g + i W / 2. */
static enum modal_status count_turns(struct count *s, int *count, struct modal_error *err)
{
    int points = (int)ceil(s->W / 2 / (STRETCH * s->rate)) + 1;
    double sum = 0, whole;
    double complex last = 0, next;
    enum modal_status rc = prepare(s, points, err);

    for (int i = 0; rc == MODAL_OK && i < points; i++) {
        rc = determine(s, 0.5 * i / (points - 1), &next, err);
        if (rc == MODAL_OK && i > 0)
            rc = turn(s, 0.5 * (i - 1) / (points - 1), 0.5 * i / (points - 1), last, next, HALVED,
                      &sum, err);
        last = next;
    }
    whole = round(sum / M_PI);
    if (rc == MODAL_OK && !(fabs(sum / M_PI - whole) <= WHOLE && whole <= 0))
        rc = modal_fail(err, MODAL_NO_CONVERGENCE, "growth: D ends at %g half turns", sum / M_PI);
    *count = rc == MODAL_OK ? -(int)whole : 0;
    return rc;
}

/* By (2), of so many harmonics that (5) holds. */
static enum modal_status count_all(struct count *s, int *count, struct modal_error *err)
{
    enum modal_status rc = part(s, err);

    if (rc == MODAL_OK)
        rc = find_ports(s, err);
    if (rc == MODAL_OK)
        rc = join(s, err);
    if (rc == MODAL_OK)
        rc = choose_core(s, err);
    for (int margin = 0, next = MARGIN; rc == MODAL_OK && next > margin;) {
        margin = next;
        s->terms = s->core + margin * s->reach;
        s->regular = 1;
        rc = count_turns(s, count, err);
        next = 1 + (int)(log(s->regular / ESTIMATED * (1 - GAIN) / GAIN) / log(GAIN) / 2);
    }
    return rc;
}

/* P's matrix WHICH at phase W t by STILL and its derivative by MOVING, and SHIFT M: is the sum
 * positive? */
static enum modal_status is_positive(const struct program *p, int which, double phase,
                                     double still, double moving, double shift, bool *positive,
                                     struct modal_error *err)
{
    struct sparse sum = { 0 }, more;
    enum modal_status rc = combine(p->n, still, 0, &p->constant[which], shift,
                                   &p->constant[PROGRAM_M], &sum, err);

    for (int h = 0; rc == MODAL_OK && h < 2 * p->harmonics; h++) {
        const struct program_harmonic *a = &p->harmonic[h / 2];
        double angle = a->k * phase, c = cos(angle), d = a->k * p->omega * sin(angle);
        double factor = h % 2 == 0 ? still * c - moving * d
                                   : still * sin(angle) + moving * a->k * p->omega * c;
        rc = combine(p->n, 1, 0, &sum, factor, h % 2 == 0 ? &a->cosine[which] : &a->sine[which],
                     &more, err);
        if (rc == MODAL_OK) {
            sparse_done(&sum);
            sum = more;
        }
    }
    *positive = false;
    if (rc == MODAL_OK && sparse_symmetric(&sum, SYMMETRIC))
        rc = is_definite(&sum, positive, err);
    sparse_done(&sum);
    return rc;
}

/* Does (3) say that nothing grows by RATE? */
static enum modal_status is_slow(const struct program *p, int reach, double rate, bool *slow,
                                 struct modal_error *err)
{
    double g = SLOWER * rate, W = reach > 0 ? p->harmonic[p->harmonics - 1].k / reach : 1;
    enum modal_status rc = MODAL_OK;

    *slow = true;
    for (int i = 0; rc == MODAL_OK && *slow && i < TIMES * reach; i++) {
        double phase = 2 * M_PI * i / (TIMES * reach) / W;
        rc = is_positive(p, PROGRAM_C, phase, 1, 0, g / 2, slow, err);
        if (rc == MODAL_OK && *slow)
            rc = is_positive(p, PROGRAM_K, phase, 1, 0, g * g, slow, err);
        if (rc == MODAL_OK && *slow)
            rc = is_positive(p, PROGRAM_K, phase, 2 * g, -1, g * g * g, slow, err);
    }
    return rc;
}

/* Frees what S holds. */
static void count_done(struct count *s)
{
    sparse_lu_free(s->Q);
    for (int which = PROGRAM_M; which <= PROGRAM_K; which++) {
        sparse_done(&s->part[which]);
        sparse_done(&s->extra[which]);
    }
    sparse_done(&s->all);
    workspace_free(&s->space);
    workspace_free(&s->room);
}

enum modal_status hill_is_held(const struct program *p, double period, double rate, bool *held,
                               struct modal_error *err)
{
    struct count s = { .p = p, .W = hill_window_frequency(p, period), .rate = rate, .n = p->n,
                       .reach = hill_window_reach(p) };
    struct program own = *p;
    double unit = s.reach > 0 ? p->harmonic[p->harmonics - 1].k / s.reach : 1;
    enum modal_status rc = part(&s, err);

    own.constant[PROGRAM_K] = s.part[PROGRAM_K];
    *held = rc == MODAL_OK;
    for (int i = 0; rc == MODAL_OK && *held && i < TIMES * s.reach; i++)
        rc = is_positive(&own, PROGRAM_K, 2 * M_PI * i / (TIMES * s.reach) / unit, 1, 0,
                         rate * rate, held, err);
    count_done(&s);
    return rc;
}

enum modal_status hill_growth(const struct program *p, double period, double rate, double most,
                              int *count, double *work, struct modal_error *err)
{
    struct count s = { .p = p, .W = hill_window_frequency(p, period), .rate = rate, .most = most,
                       .n = p->n, .reach = hill_window_reach(p) };
    bool slow;
    enum modal_status rc;

    *count = 0;
    s.unit = s.reach > 0 ? p->harmonic[p->harmonics - 1].k / s.reach : 1;
    rc = is_slow(p, s.reach, rate, &slow, err);
    if (rc == MODAL_OK && !slow)
        rc = count_all(&s, count, err);
    *work += s.work;
    count_done(&s);
    return rc;
}
