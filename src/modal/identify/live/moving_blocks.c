/*
 * moving_blocks.c - the samples of a moving window, reduced as they come; equation (1) of moving.c
 *
 * Owned here: the samples themselves, the blocks C_b, the queue of triangles, and the anchor, whose
 * poles span Q.
 */
#include "modal/identify/live/moving_state.h"
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/linear/exponents.h"
#include "modal/linalg/qr.h"
#include "modal/linalg/svd.h"

enum {
    MOMENTS = 4,                    /* of each pole: its column, and three for where it moves to */
    BLOCK_MOST = 1024               /* rows */
};
static const double LEAK = 1e-11;     /* of |lambda|: what the anchor's span may cost an exponent */

static void poles_free(struct poles_of *p)
{
    free(p->lambda);
    *p = (struct poles_of) { 0 };
}

bool poles_take(struct poles_of *to, const double complex *lambda, int count)
{
    poles_free(to);
    to->lambda = malloc(sizeof *lambda * ((size_t)count + 1));
    if (to->lambda == NULL)
        return false;
    if (count > 0)
        memcpy(to->lambda, lambda, sizeof *lambda * (size_t)count);
    to->count = count;
    return true;
}

static void drop_blocks(struct moving *m)
{
    for (int b = 0; b < m->count; b++)
        free(m->blocks[b].C);
    m->count = 0;
    if (m->all != NULL)
        window_qr_clear(m->all);
}

void anchor_forget(struct moving *m)
{
    drop_blocks(m);
    poles_free(&m->own), poles_free(&m->first), poles_free(&m->anchor);
    free(m->Q), free(m->table);
    m->Q = m->table = NULL;
    m->anchored = false;
}

void moving_clear(struct moving *m)
{
    drop_blocks(m);
    m->held = 0;
}

int moving_samples(const struct moving *m)
{
    return m->held < (size_t)m->L ? (int)m->held : m->L;
}

/* Sample number I (of all), which must be held. */
const double *moving_sample(const struct moving *m, uint64_t i)
{
    return m->rows + (size_t)(i + m->held - m->next) * (size_t)m->S;
}

const double *moving_window(const struct moving *m)
{
    return moving_samples(m) < m->L ? NULL : moving_sample(m, m->next - (uint64_t)m->L);
}

/* (1) for the block that begins at sample I. */
static enum modal_status reduce_block(struct moving *m, uint64_t i, struct modal_error *err)
{
    int S = m->S, B = m->B, k = m->k;
    const double *y = moving_sample(m, i);
    struct block block = { malloc(sizeof *block.C * (size_t)(k + 2) * (size_t)S), NULL, NULL };
    double *Y = malloc(sizeof *Y * 2 * (size_t)B * (size_t)S), *E = Y + (size_t)B * (size_t)S;
    struct matrix rows = { B, S, B, Y };
    enum modal_status rc = MODAL_OK;

    if (m->count == m->blocks_room) {
        struct block *more = realloc(m->blocks, sizeof *more * (size_t)(2 * m->blocks_room + 16));
        if (more != NULL)
            m->blocks = more, m->blocks_room = 2 * m->blocks_room + 16;
    }
    if (block.C == NULL || Y == NULL || m->count == m->blocks_room) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for a block");
        goto out;
    }
    for (int l = 0; l < B; l++)
        for (int c = 0; c < S; c++)
            Y[l + (size_t)c * (size_t)B] = y[(size_t)l * (size_t)S + (size_t)c];
    /* E = Y - Q Q^T Y by rows: norms alone would lose half of its digits */
    memcpy(E, Y, sizeof *Y * (size_t)B * (size_t)S);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, k, S, B, 1, m->Q, B, Y, B, 0, block.C, k);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, B, S, k, -1, m->Q, B, block.C, k, 1, E,
                B);
    block.norm = block.C + (size_t)k * (size_t)S, block.left = block.norm + S;
    for (int c = 0; c < S; c++)
        block.norm[c] = quick_norm(Y + (size_t)c * (size_t)B, (size_t)B),
        block.left[c] = quick_norm(E + (size_t)c * (size_t)B, (size_t)B);
    if (m->all != NULL)
        rc = window_qr_push(m->all, &rows, err);
    if (rc != MODAL_OK)
        goto out;
    if (m->count == 0)
        m->block_from = i;
    m->blocks[m->count++] = block;
    block.C = NULL;
out:
    free(block.C);
    free(Y);
    return rc;
}

static enum modal_status drop_oldest(struct moving *m, struct modal_error *err)
{
    enum modal_status rc = m->all != NULL ? window_qr_pop(m->all, err) : MODAL_OK;

    if (rc != MODAL_OK)
        return rc;
    free(m->blocks[0].C);
    memmove(m->blocks, m->blocks + 1, sizeof *m->blocks * (size_t)--m->count);
    m->block_from += (uint64_t)m->B;
    return MODAL_OK;
}

/* All full blocks of the present window, and no other. */
static enum modal_status keep_blocks(struct moving *m, struct modal_error *err)
{
    uint64_t B = (uint64_t)m->B, from = m->next - (uint64_t)moving_samples(m), first, i;
    enum modal_status rc = MODAL_OK;

    if (B == 0)
        return MODAL_OK;
    /* blocks lie on a grid of their own: a sample is in the same block in every window */
    first = (from + B - 1) / B * B;
    while (m->count > 0 && m->block_from < first && rc == MODAL_OK)
        rc = drop_oldest(m, err);
    i = m->count > 0 ? m->block_from + (uint64_t)m->count * B : first;
    for (; i + B <= m->next && rc == MODAL_OK; i += B)
        rc = reduce_block(m, i, err);
    return rc;
}

static bool all_finite(const double *x, size_t count)
{
    double sum = 0;

    for (size_t i = 0; i < count; i++)
        /* 0 unless a sample is infinite or NAN; vectorises, as isfinite() does not */
        sum += 0 * x[i];
    return sum == 0;
}

enum modal_status moving_push(struct moving *m, const double *samples, size_t count,
                              struct modal_error *err)
{
    size_t S = (size_t)m->S, L = (size_t)m->L;
    enum modal_status rc = MODAL_OK;

    while (count > 0 && rc == MODAL_OK) {
        size_t n = count < L ? count : L;
        if (m->held + n > m->room) {
            size_t keep = m->held < L ? m->held : L;
            memmove(m->rows, m->rows + (m->held - keep) * S, sizeof *m->rows * keep * S);
            m->held = keep;
        }
        memcpy(m->rows + m->held * S, samples, sizeof *samples * n * S);
        m->held += n, m->next += n;
        samples += n * S, count -= n;
        if (m->anchored && !all_finite(m->rows + (m->held - n) * S, n * S))
            anchor_forget(m);                    /* a batch says which sample */
        if (m->anchored)
            rc = keep_blocks(m, err);
    }
    return rc;
}

/* ---- the anchor ---- */

static int gcd(int a, int b)
{
    while (b > 0) {
        int c = a % b;
        a = b, b = c;
    }
    return a;
}

/* Rows of a window in blocks of B samples of k rows each, the mean over where windows a hop apart
 * begin. */
static double mean_rows(const struct moving *m, int B, int k)
{
    /* a window begins at multiples of the hop, modulo B at multiples of this */
    int step = gcd(B, m->opt.hop > 0 ? m->opt.hop : 1), phases = B / step;
    double sum = 0;

    for (int p = 0; p < phases; p++) {
        int lead = p * step, blocks = (m->L - lead) / B;
        sum += m->L - blocks * (B - k);  /* a whole block of B samples has k rows */
    }
    return sum / phases;
}

/* The block's length: the one that leaves the fewest rows; 0 where blocks would not shorten the
 * window. */
static int block_length(const struct moving *m, int k)
{
    /* shorter than 2 k a block saves less than half of its rows */
    int least = 2 * k > m->S ? 2 * k : m->S, most = m->L / 3 < BLOCK_MOST ? m->L / 3 : BLOCK_MOST,
        best = 0;
    double fewest = 0.8 * m->L;

    for (int B = least; B <= most && B <= 6 * least; B++) {
        double rows = mean_rows(m, B, k);
        if (rows < fewest)
            fewest = rows, best = B;
    }
    return best;
}

/* l^i e^{lambda l} about the block's middle, l from -1 to 1, over their largest entry; one or two
 * columns. */
static int moment_columns(double complex lambda, double tau, int B, int i, double *x)
{
    double a = creal(lambda) * tau, b = cimag(lambda) * tau, middle = 0.5 * (B - 1),
           reference = fabs(a) * middle;
    int columns = pole_kind(lambda, tau) == POLE_PAIR ? 2 : 1;

    for (int l = 0; l < B; l++) {
        double t = l - middle, e = exp(a * t - reference) * pow(t / (middle > 0 ? middle : 1), i);
        x[l] = e * cos(b * (columns == 2 ? t : l));
        if (columns == 2)
            x[l + B] = e * sin(b * t);
    }
    return columns;
}

enum modal_status anchor_set(struct moving *m, const struct poles_of *p, struct modal_error *err)
{
    int q = poles_order(p->lambda, p->count, m->opt.dt), n = 0;
    struct matrix Q;
    enum modal_status rc = MODAL_OK;

    drop_blocks(m);
    free(m->Q), free(m->table);
    m->Q = m->table = NULL;
    /* room for poles to move: to third order in their step, about the block's middle */
    m->k = MOMENTS * q;
    m->B = block_length(m, m->k);
    if (p->lambda != m->anchor.lambda) {
        poles_free(&m->anchor);
        m->anchor.lambda = malloc(sizeof *p->lambda * ((size_t)p->count + 1));
        if (m->anchor.lambda == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d poles", p->count);
        memcpy(m->anchor.lambda, p->lambda, sizeof *p->lambda * (size_t)p->count);
        m->anchor.count = p->count;
    }
    m->anchored = true;
    if (m->B == 0)
        return MODAL_OK;
    m->Q = malloc(sizeof *m->Q * (size_t)m->B * (size_t)m->k);
    if (m->Q == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", m->B, m->k);
    for (int j = 0; j < p->count; j++)
        for (int i = 0; i < MOMENTS; i++)
            n += moment_columns(p->lambda[j], m->opt.dt, m->B, i, m->Q + (size_t)n * (size_t)m->B);
    Q = (struct matrix) { m->B, n, m->B, m->Q };
    rc = qr_orthonormal(&Q, NULL, err);
    if (rc == MODAL_OK) {
        struct moving_rows rows = { .length = m->B,
                                    .k = m->k,
                                    .Q = m->Q,
                                    .tau = m->opt.dt,
                                    .anchors = p->count,
                                    .anchor = m->anchor.lambda };
        rc = moving_table(&rows, &m->table, err);
    }
    return rc == MODAL_OK ? keep_blocks(m, err) : rc;
}

/* Do the poles still lie where the anchor's span holds them?  The residual is noise, so that what
 * the span lacks of a derivative costs an exponent that share of its standard error. */
bool anchor_is_near(const struct moving *m, const struct moving_fit *f)
{
    double fact = 1;

    for (int i = 2; i < MOMENTS; i++)
        fact *= i;
    for (int j = 0; j < f->poles && m->B > 0; j++) {
        double x = cabs(f->lambda[j] - m->anchor.lambda[j]) * m->opt.dt * m->B / 2,
               std = hypot(f->std_re[j], f->std_im[j]);
        if (!(pow(x, MOMENTS - 1) / fact * std <= LEAK * fmax(cabs(f->lambda[j]), DBL_MIN))
            && f->lambda[j] != 0)
            return false;
    }
    return true;
}
