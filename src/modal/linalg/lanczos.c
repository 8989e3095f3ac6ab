/*
 * lanczos.c - Golub-Kahan bidiagonalisation with full reorthogonalisation
 *
 * From a start vector v_1 the recurrences
 *
 *     alpha_k u_k     = A v_k - beta_{k-1} u_{k-1},                                   (1)
 *     beta_k  v_{k+1} = A^T u_k - alpha_k v_k                                         (2)
 *
 * build A V_k = U_k B_k, B_k upper bidiagonal with alpha on and beta above the diagonal [GK65].
 * With the SVD B_k = P S Q^T the triplets (s_i, U_k p_i, V_k q_i) satisfy A v = s u exactly and
 *
 *     |A^T u - s v| = beta_k |P(k, i)|,                                               (3)
 *
 * which decides convergence.  In floating point (1), (2) lose orthogonality as soon as a triplet
 * converges; each new vector is therefore orthogonalised against all before it, and again where
 * that took most of it away ("twice is enough" [GvL, 10.3]).  The augmented matrix [0 A; A^T 0],
 * whose plain Lanczos iteration the identification paper proposes (24), needs twice the products
 * for each dimension and returns both signs.
 *
 * Rounding floor: lengths below max(m,n) DBL_EPSILON times the largest alpha or beta so far are a
 * breakdown.
 *
 * [GK65] Golub and Kahan, SIAM J. Numer. Anal. B 2 (1965) 205-224.  [GvL] Golub and Van Loan,
 * Matrix Computations.
 */
#include "modal/linalg/lanczos.h"
#include <cblas.h>
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* What is left of a unit vector once the basis is taken out is rounding below about
 * sqrt(DBL_EPSILON): such a rest would be normalised to noise that is not orthogonal to anything.
 */
static const double LEAST_REST = 1e-8;
static const double LEAST_KEPT = 0.1;      /* of a vector, orthogonal after one pass */
enum { PANEL = 16 };                       /* vectors of 16,000 numbers fit a cache of 2 MB */

/* Steps between two looks at the small SVD, at least; later a quarter of the steps so far, so that
 * all looks together cost a constant multiple of the last. */
enum { STEPS_BETWEEN_LOOKS = 3 };

/* The vectors so far, growing by halves. */
struct basis { int length, count, room; double *x; };

struct lanczos {
    struct basis U, V;
    double *work;              /* 3 `most` + 3 numbers, of which: */
    double *alpha, *beta;      /* room for `most` */
    int most;
    double scale;              /* the largest alpha or beta so far */
    bool restarted, exhausted;
};

static double *basis_next(struct basis *b)
{
    if (b->count == b->room) {
        int room = b->room == 0 ? 16 : b->room + b->room / 2;
        double *x = realloc(b->x, sizeof *x * (size_t)room * b->length);
        if (x == NULL)
            return NULL;
        b->x = x;
        b->room = room;
    }
    return b->x + (size_t)b->count * b->length;
}

/* x -= B (B^T x), a panel of B at a time, which stays in the cache from one product to the next;
 * work holds PANEL numbers. Again where little is left; else what rounding left of B in x
 * is below DBL_EPSILON / LEAST_KEPT of it. */
static void orthogonalise(const struct basis *b, double *x, double *work)
{
    double before = cblas_dnrm2(b->length, x, 1), after = before;

    for (int pass = 0; pass < 2 && b->count > 0; pass++, before = after) {
        for (int c = 0; c < b->count; c += PANEL) {
            const double *B = b->x + (size_t)c * (size_t)b->length;
            int n = b->count - c < PANEL ? b->count - c : PANEL;
            cblas_dgemv(CblasColMajor, CblasTrans, b->length, n, 1, B, b->length, x, 1, 0, work, 1);
            cblas_dgemv(CblasColMajor, CblasNoTrans, b->length, n, -1, B, b->length, work, 1, 1, x,
                        1);
        }
        after = cblas_dnrm2(b->length, x, 1);
        if (after > LEAST_KEPT * before)
            return;
    }
}

/* A fixed sequence in (-1/2, 1/2), different for each vector. */
static void fill(double *x, int n, uint32_t seed)
{
    uint32_t z = 2463534242u + 97u * seed;

    for (int i = 0; i < n; i++) {
        z = 1664525u * z + 1013904223u;
        x[i] = z / 4294967296.0 - 0.5;
    }
}

/* The basis's next vector: any unit vector orthogonal to it; false where it spans everything. */
static bool fresh(const struct basis *b, double *work)
{
    double norm, *x = b->x + (size_t)b->count * (size_t)b->length;

    fill(x, b->length, (uint32_t)b->count);
    norm = cblas_dnrm2(b->length, x, 1);
    cblas_dscal(b->length, 1 / norm, x, 1);
    orthogonalise(b, x, work);
    norm = cblas_dnrm2(b->length, x, 1);
    if (b->count >= b->length || norm < LEAST_REST)
        return false;
    cblas_dscal(b->length, 1 / norm, x, 1);
    return true;
}

/*
 * (1), or (2) by A^T: one side's next vector and its coefficient out of the other side's last; the
 * coefficient is 0 where what is left is rounding, max(m, n) eps of the largest so far, for then
 * so is its direction.
 */
static enum modal_status next_vector(struct lanczos *L, const struct linear_operator *A,
                                     bool transposed, double *work, struct modal_error *err)
{
    const struct basis *from = transposed ? &L->U : &L->V;
    struct basis *to = transposed ? &L->V : &L->U;
    double *norm = &(transposed ? L->beta : L->alpha)[from->count - 1], *x = basis_next(to);
    enum modal_status rc;

    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "lanczos: no memory for %d vectors of %d",
                          to->count + 1, to->length);
    rc = (transposed ? A->apply_transpose : A->apply)(
        A->context, from->x + (size_t)(from->count - 1) * (size_t)from->length, x, err);
    if (rc != MODAL_OK)
        return rc;
    orthogonalise(to, x, work);       /* takes the other side's coefficient off as well */
    *norm = cblas_dnrm2(to->length, x, 1);
    L->scale = fmax(L->scale, *norm);
    if (*norm > fmax(A->m, A->n) * DBL_EPSILON * L->scale)
        cblas_dscal(to->length, 1 / *norm, x, 1);
    else
        *norm = 0;
    return MODAL_OK;
}

/* (1): u_k from v_k.  Where A maps a fresh v_k to nothing, the rank is exhausted. */
static enum modal_status step_left(struct lanczos *L, const struct linear_operator *A,
                                   bool restarted, double *work, struct modal_error *err)
{
    enum modal_status rc = next_vector(L, A, false, work, err);

    if (rc != MODAL_OK)
        return rc;
    L->exhausted = L->alpha[L->V.count - 1] == 0 && (restarted || !fresh(&L->U, work));
    L->U.count += !L->exhausted;
    L->V.count -= L->exhausted;                 /* v_k is no part of the answer then */
    return MODAL_OK;
}

/* (2): v_{k+1} from u_k; a breakdown goes on with a fresh vector and beta_k = 0. */
static enum modal_status step_right(struct lanczos *L, const struct linear_operator *A,
                                    bool *restarted, double *work, struct modal_error *err)
{
    enum modal_status rc = next_vector(L, A, true, work, err);

    if (rc != MODAL_OK)
        return rc;
    *restarted = L->beta[L->U.count - 1] == 0;
    L->exhausted = *restarted && !fresh(&L->V, work);
    L->V.count += !L->exhausted;
    return MODAL_OK;
}

/* The SVD of B_k: s (k numbers), P and QT (k x k), in one block of memory that `s` owns. */
struct small { int k; double *s, *P, *QT; };

static enum modal_status small_svd(const struct lanczos *L, int k, struct small *out,
                                   struct modal_error *err)
{
    double *block = malloc(sizeof *block * (2 * (size_t)k * k + 2 * (size_t)k)), *e, q = 0;
    int info, iq = 0;

    free(out->s);
    *out = (struct small) { .s = block };
    if (block == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "lanczos: no memory for %d steps", k);
    *out = (struct small) { k, block, block + k, block + k + (size_t)k * k };
    e = out->QT + (size_t)k * k;
    memcpy(out->s, L->alpha, sizeof *e * k);
    memcpy(e, L->beta, sizeof *e * k);
    info = LAPACKE_dbdsdc(LAPACK_COL_MAJOR, 'U', 'I', k, out->s, e, out->P, k, out->QT, k, &q, &iq);
    if (info != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "lanczos: dbdsdc failed on %d steps (info %d)",
                          k, info);
    return MODAL_OK;
}

/* How many of the leading triplets satisfy (3) with the tolerance, and their largest residual. */
static int count_converged(const struct lanczos *L, const struct small *B,
                           const struct lanczos_options *opt, double *residual)
{
    double tolerance = (opt->tolerance > 0 ? opt->tolerance : 1e-14) * B->s[0];
    /* beta_k of (3); nothing couples to a space that is exhausted or whole */
    double last = L->exhausted || B->k == L->V.length ? 0 : L->beta[B->k - 1];
    int i;

    *residual = 0;
    for (i = 0; i < B->k && i < opt->wanted; i++) {
        double r = last * fabs(B->P[B->k - 1 + (size_t)i * B->k]);
        if (r > tolerance)
            break;
        if (opt->residuals != NULL)
            opt->residuals[i] = r;
        if (r > *residual)
            *residual = r;
    }
    return i;
}

/* The leading COUNT combinations of the basis: columns of OUT, or rows where it is stored
 * transposed.  C is k x k and holds combination i in column i, or in row i (c_rows). */
static void combine(const struct basis *b, int k, int count, const double *C, bool c_rows,
                    struct matrix *out, bool out_rows)
{
    if (out == NULL || out->x == NULL || count == 0)
        return;
    if (out_rows)
        cblas_dgemm(CblasColMajor, c_rows ? CblasNoTrans : CblasTrans, CblasTrans, count, b->length,
                    k, 1, C, k, b->x, b->length, 0, out->x, out->ld);
    else
        cblas_dgemm(CblasColMajor, CblasNoTrans, c_rows ? CblasTrans : CblasNoTrans, b->length,
                    count, k, 1, b->x, b->length, C, k, 0, out->x, out->ld);
}

/* Steps until the wanted triplets have converged, the rank is exhausted, or `most` is reached. */
static enum modal_status iterate(struct lanczos *L, const struct linear_operator *A,
                                 const struct lanczos_options *opt, struct small *B,
                                 struct lanczos_result *out, struct modal_error *err)
{
    /* fewer steps cannot have that many triplets */
    int check = opt->least > opt->wanted + 2 ? opt->least : opt->wanted + 2;
    /* those of a call before may do */
    bool look = L->U.count > 0 && (L->U.count >= opt->least || L->exhausted);
    enum modal_status rc = MODAL_OK;

    out->steps = L->U.count;
    while (rc == MODAL_OK && out->count < opt->wanted
           && (look || (out->steps < L->most && !L->exhausted))) {
        if (!look) {
            rc = step_left(L, A, L->restarted, L->work, err);
            if (rc == MODAL_OK && !L->exhausted)
                rc = step_right(L, A, &L->restarted, L->work, err);
            out->steps = L->U.count;
        }
        look = false;
        if (rc != MODAL_OK || out->steps == 0 ||
            (out->steps < check && out->steps < L->most && !L->exhausted))
            continue;
        rc = small_svd(L, out->steps, B, err);
        if (rc == MODAL_OK)
            out->count = count_converged(L, B, opt, &out->residual);
        check = out->steps + (out->steps / 4 > STEPS_BETWEEN_LOOKS ? out->steps / 4
                                                                   : STEPS_BETWEEN_LOOKS);
    }
    return rc;
}

/* Before the first step of T, which is not wider than high. */
static enum modal_status begin(struct lanczos *L, const struct linear_operator *T, int steps,
                               struct modal_error *err)
{
    *L = (struct lanczos) { .U = { .length = T->m }, .V = { .length = T->n }, .most = T->n,
                            .restarted = true };
    if (steps > 0 && steps < L->most)
        L->most = steps;
    L->work = calloc((size_t)3 * L->most + 3, sizeof *L->work);
    if (L->work == NULL || basis_next(&L->V) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "lanczos: no memory for %d steps, %d x %d",
                          L->most, T->m, T->n);
    L->alpha = L->work + L->most + 1, L->beta = L->alpha + L->most;
    fresh(&L->V, L->work);
    L->V.count = 1;
    return MODAL_OK;
}

void lanczos_free(struct lanczos *L)
{
    if (L == NULL)
        return;
    free(L->work), free(L->U.x), free(L->V.x);
    free(L);
}

/* With m < n the transposed operator is iterated: only then does V_k fill its space, and the rank
 * is exhausted, at k = min(m, n). */
enum modal_status lanczos_more(struct lanczos **run, const struct linear_operator *A,
                               const struct lanczos_options *opt, double *s, struct matrix *U,
                               struct matrix *VT, struct lanczos_result *out,
                               struct modal_error *err)
{
    bool flip = A->m < A->n;
    struct linear_operator T =
        flip ? (struct linear_operator) { A->n, A->m, A->context, A->apply_transpose, A->apply }
             : *A;
    struct lanczos_result found = { 0, 0, 0 };
    struct small B = { 0, NULL, NULL, NULL };
    enum modal_status rc = MODAL_OK;

    if (T.n > 0 && opt->wanted > 0) {
        if (*run == NULL) {
            *run = calloc(1, sizeof **run);
            rc = *run == NULL ? modal_fail(err, MODAL_NO_MEMORY, "lanczos: no memory")
                              : begin(*run, &T, opt->steps, err);
        }
        if (rc == MODAL_OK)
            rc = iterate(*run, &T, opt, &B, &found, err);
    }
    if (rc == MODAL_OK) {
        if (found.count > 0) {
            memcpy(s, B.s, sizeof *s * found.count);
            combine(&(*run)->U, B.k, found.count, B.P, false, flip ? VT : U, flip);
            combine(&(*run)->V, B.k, found.count, B.QT, true, flip ? U : VT, !flip);
        }
        *out = found;
    }
    free(B.s);
    return rc;
}

enum modal_status lanczos_svd(const struct linear_operator *A, const struct lanczos_options *opt,
                              double *s, struct matrix *U, struct matrix *VT,
                              struct lanczos_result *out, struct modal_error *err)
{
    struct lanczos *run = NULL;
    enum modal_status rc = lanczos_more(&run, A, opt, s, U, VT, out, err);

    lanczos_free(run);
    return rc;
}

static enum modal_status dense_apply(void *context, const double *x, double *y,
                                     struct modal_error *err)
{
    const struct matrix *A = context;

    (void)err;
    cblas_dgemv(CblasColMajor, CblasNoTrans, A->m, A->n, 1, A->x, A->ld, x, 1, 0, y, 1);
    return MODAL_OK;
}

static enum modal_status dense_apply_transpose(void *context, const double *y, double *x,
                                               struct modal_error *err)
{
    const struct matrix *A = context;

    (void)err;
    cblas_dgemv(CblasColMajor, CblasTrans, A->m, A->n, 1, A->x, A->ld, y, 1, 0, x, 1);
    return MODAL_OK;
}

struct linear_operator dense_operator(const struct matrix *A)
{
    return (struct linear_operator) { A->m, A->n, (void *)A, dense_apply, dense_apply_transpose };
}
