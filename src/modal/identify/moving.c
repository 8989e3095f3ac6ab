/*
 * moving.c - a window moves on by a hop; the answer is brought up to date, not found again
 *
 * Samples are reduced as they come.  Time is cut into blocks of B samples, and each full block Y_b, B x S, is kept as
 *
 *     C_b = Q^T Y_b,   k x S,     and the triangle of what is left, Y_b - Q C_b,                           (1)
 *
 * Q, B x k, being an orthonormal basis of l^m e^{lambda_a l}, m < MOMENTS, at the poles lambda_a of the last complete identification (the anchor).  A pole
 * that has since moved by delta is in its span up to |delta tau B / 2|^MOMENTS / MOMENTS!, and so is its derivative with one power less; past a
 * limit the anchor is moved to where the poles are now.  Left-overs, and the C_b of more than POD_CHANNELS_FEW channels, go through window_qr.c:
 * the triangle R of the window's rows, and with it their proper orthogonal modes (the right singular vectors of R times the channels' scales), without a pass
 * over the window and without ever subtracting a row.
 *
 * The least-squares problem of refine.c on L rows is then one on L k / B rows (moving_fit.c), begun at the poles of the window before: a few steps
 * to the same minimum that a batch of the window ends in.  Its answer is taken if nothing says that a batch would choose other poles:
 *
 *   - the fit settles, each pole pays for itself by the same margin within which order.c would try without it, and no pole wants to be two;
 *   - no other pair would: with E_c the residual, a pair at omega lowers -2 ln(likelihood) by
 *
 *         G(omega) = - sum_c L ln(1 - 2 |E_c(omega)|^2 / (L |e_c|^2)),                                     (2)
 *
 *     looked at on all frequencies of the FFT, over the window, and over its first and last quarter and sixteenth, where a pair that decays or grows has its
 *     energy.  LIKELY of a pair's price in BIC is the alarm: half of it because a frequency between two bins shows as little as 0.4 of its power;
 *   - the residual is white by the tests of colour.c, the halves of the window do not contradict the whole (parts.c, its first look), and no
 *     other special case of order.c or verdict.c is near.
 *
 * Otherwise the window is identified from nothing by modal_identify, so that in doubt the two agree because they are one.  A change of order
 * in mid-record is such a case, and is said.
 */
#include "modal/identify/moving.h"
#include <cblas.h>
#include <fftw3.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/colour.h"
#include "modal/identify/diagnose.h"
#include "modal/identify/exponents.h"
#include "modal/identify/modes.h"
#include "modal/identify/moving_fit.h"
#include "modal/identify/order.h"
#include "modal/identify/parts.h"
#include "modal/identify/pod.h"
#include "modal/identify/rounding.h"
#include "modal/identify/trend.h"
#include "modal/identify/verdict.h"
#include "modal/identify/widen.h"
#include "modal/linalg/qr.h"
#include "modal/linalg/svd.h"
#include "modal/linalg/window_qr.h"

enum { MOMENTS = 4, BLOCK_MOST = 1024 };
static const double LIKELY = 0.5;
static const double LEAK = 1e-11;                /* of |lambda|: what the anchor's span may cost an exponent */

const char *const moving_reasons[] = { "first", "options", "not_settled", "order_less", "order_more", "pole_splits", "offset", "undetermined", "not_white",
                                       "channels_by_noise", "parts_disagree", "weak_mode", "quantised", NULL };
enum reason { FIRST, OPTIONS, NOT_SETTLED, ORDER_LESS, ORDER_MORE, POLE_SPLITS, OFFSET, UNDETERMINED, NOT_WHITE, BY_NOISE, PARTS, WEAK_MODE, GRID, GOOD };

struct block { double *C, *rest; };              /* k x S; S x S triangle */

struct poles_of { double complex *lambda; int count; };

struct moving {
    struct moving_options opt;
    int S, L;
    double *rows; size_t held, room;             /* the last samples, row-major; the newest ends at `held` */
    uint64_t next;                               /* samples so far */

    bool possible;                               /* the options are those of an update */
    bool anchored;
    int reason;                                  /* where there is no anchor: why not */
    struct poles_of own, first;                  /* of the last result; before channels were weighed by their noise (count 0: they were not) */
    struct poles_of anchor;
    bool rest_white[2];                          /* the last complete identification kept only the orthogonal signals that stand out of white noise; weighed */
    int B, k;
    double *Q;
    struct block *blocks; int count, blocks_room;     /* oldest first */
    uint64_t block_from;                         /* index of the oldest block's first sample */
    struct window_qr *all, *rest;                /* triangles of the blocks: of the samples; of what Q does not hold */

    fftw_plan plan[3];                           /* L, L/4, L/16 */
    double *x; fftw_complex *X;
    uint64_t updates, batches;
};

/* ---- life ---- */

static void poles_free(struct poles_of *p)
{
    free(p->lambda);
    *p = (struct poles_of) { 0 };
}

static void drop_blocks(struct moving *m)
{
    for (int b = 0; b < m->count; b++)
        free(m->blocks[b].C);
    m->count = 0;
    if (m->all != NULL)
        window_qr_clear(m->all);
    if (m->rest != NULL)
        window_qr_clear(m->rest);
}

static void forget_anchor(struct moving *m)
{
    drop_blocks(m);
    poles_free(&m->own), poles_free(&m->first), poles_free(&m->anchor);
    free(m->Q);
    m->Q = NULL;
    m->anchored = false;
}

void moving_free(struct moving *m)
{
    if (m == NULL)
        return;
    forget_anchor(m);
    for (int i = 0; i < 3; i++)
        if (m->plan[i] != NULL)
            fftw_destroy_plan(m->plan[i]);
    fftw_free(m->x), fftw_free(m->X);
    window_qr_free(m->all), window_qr_free(m->rest);
    free(m->blocks);
    free(m->rows);
    free(m);
}

/* Everything that record.c and identify.c do before the signals are fitted is here a scale: no other preparation. */
static bool is_possible(const struct moving_options *o)
{
    const struct identify_options *i = &o->identify;
    bool whole = i->window[0] == 0 && i->window[1] == 0 && i->band[0] == 0 && i->band[1] == 0;

    return o->channels <= MOVING_CHANNELS_MOST && o->window > 2 * o->channels && i->method == IDENTIFY_AUTO && i->channels == NULL && i->pod_energy == 0
        && i->pod_rank == 0 && i->detrend == DETREND_NONE && i->scale == SCALE_RMS && i->rows == 0 && i->columns == 0 && i->stride <= 1 && whole
        && (i->period < 0 || (i->period == 0 && o->period == 0)) && !i->difference && i->refine != CHOICE_NO
        && (i->rank.rule == RANK_AUTO || i->rank.rule == RANK_FIXED) && i->target_error == 0 && i->target_seconds == 0;
}

enum modal_status moving_new(const struct moving_options *options, struct moving **out, struct modal_error *err)
{
    struct moving *m;
    enum modal_status rc = MODAL_OK;

    if (options->channels < 1 || options->window < IDENTIFY_SAMPLES_LEAST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "window", "a window of %d samples of %d channels; accepted: %d samples or more", options->window,
                                options->channels, IDENTIFY_SAMPLES_LEAST);
    m = calloc(1, sizeof *m);
    if (m == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory");
    m->opt = *options;
    m->S = options->channels, m->L = options->window;
    m->possible = is_possible(options);
    m->room = 2 * (size_t)m->L + 1;
    m->rows = malloc(sizeof *m->rows * m->room * (size_t)m->S);
    if (m->rows == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for a window of %d samples of %d channels", m->L, m->S);
    if (rc == MODAL_OK && m->possible)
        rc = window_qr_new(m->S, &m->all, err);
    if (rc == MODAL_OK && m->possible)
        rc = window_qr_new(m->S, &m->rest, err);
    if (rc != MODAL_OK)
        moving_free(m);
    else
        *out = m;
    return rc;
}

void moving_clear(struct moving *m)
{
    forget_anchor(m);
    m->held = 0;
}

int moving_samples(const struct moving *m)
{
    return m->held < (size_t)m->L ? (int)m->held : m->L;
}

/* ---- samples to blocks ---- */

/* Sample number I (of all), which must be held. */
static const double *sample(const struct moving *m, uint64_t i)
{
    return m->rows + (size_t)(i + m->held - m->next) * (size_t)m->S;
}

const double *moving_window(const struct moving *m)
{
    return moving_samples(m) < m->L ? NULL : sample(m, m->next - (uint64_t)m->L);
}

/* (1) for the block that begins at sample I. */
static enum modal_status reduce_block(struct moving *m, uint64_t i, struct modal_error *err)
{
    int S = m->S, B = m->B, k = m->k;
    const double *y = sample(m, i);
    struct block block = { malloc(sizeof *block.C * (size_t)k * (size_t)S), NULL };
    double *Y = malloc(sizeof *Y * 2 * (size_t)B * (size_t)S), *E = Y + (size_t)B * (size_t)S;
    struct matrix rows = { B, S, B, Y }, left = { B, S, B, E };
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
    memcpy(E, Y, sizeof *Y * (size_t)B * (size_t)S);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, k, S, B, 1, m->Q, B, Y, B, 0, block.C, k);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, B, S, k, -1, m->Q, B, block.C, k, 1, E, B);
    rc = window_qr_push(m->rest, &left, err);
    if (rc == MODAL_OK)
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
    enum modal_status rc = window_qr_pop(m->all, err);

    if (rc == MODAL_OK)
        rc = window_qr_pop(m->rest, err);
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
    first = (from + B - 1) / B * B;
    while (m->count > 0 && m->block_from < first && rc == MODAL_OK)
        rc = drop_oldest(m, err);
    i = m->count > 0 ? m->block_from + (uint64_t)m->count * B : first;
    for (; i + B <= m->next && rc == MODAL_OK; i += B)
        rc = reduce_block(m, i, err);
    return rc;
}

enum modal_status moving_push(struct moving *m, const double *samples, size_t count, struct modal_error *err)
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

/* The block's length: hops and windows that are whole blocks leave no rows over; 0 where blocks would not shorten the window. */
static int block_length(const struct moving *m, int k)
{
    int g = gcd(m->L, m->opt.hop > 0 ? m->opt.hop : m->L), least = 3 * k > m->S ? 3 * k : m->S, most = 2 * least, length = 2 * least;

    if (most < BLOCK_MOST / 4)
        most = BLOCK_MOST / 4;
    for (int d = least; d <= most; d++)
        if (g % d == 0)
            length = d;
    return length <= m->L / 3 && length <= BLOCK_MOST ? length : 0;
}

/* l^i e^{lambda l} about the block's middle, l from -1 to 1, over their largest entry; one or two columns. */
static int moment_columns(double complex lambda, double tau, int B, int i, double *x)
{
    double a = creal(lambda) * tau, b = cimag(lambda) * tau, middle = 0.5 * (B - 1), reference = fabs(a) * middle;
    int columns = pole_kind(lambda, tau) == POLE_PAIR ? 2 : 1;

    for (int l = 0; l < B; l++) {
        double t = l - middle, e = exp(a * t - reference) * pow(t / (middle > 0 ? middle : 1), i);
        x[l] = e * cos(b * (columns == 2 ? t : l));
        if (columns == 2)
            x[l + B] = e * sin(b * t);
    }
    return columns;
}

static enum modal_status set_anchor(struct moving *m, const struct poles_of *p, struct modal_error *err)
{
    int q = poles_order(p->lambda, p->count, m->opt.dt), n = 0;
    struct matrix Q;
    enum modal_status rc = MODAL_OK;

    drop_blocks(m);
    free(m->Q);
    m->Q = NULL;
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
    return rc == MODAL_OK ? keep_blocks(m, err) : rc;
}

/* Do the poles still lie where the anchor's span holds them?  The residual is noise, so that what the span lacks of a derivative costs an exponent that
 * share of its standard error. */
static bool is_near(const struct moving *m, const struct moving_fit *f)
{
    double fact = 1;

    for (int i = 2; i < MOMENTS; i++)
        fact *= i;
    for (int j = 0; j < f->poles && m->B > 0; j++) {
        double x = cabs(f->lambda[j] - m->anchor.lambda[j]) * m->opt.dt * m->B / 2, std = hypot(f->std_re[j], f->std_im[j]);
        if (!(pow(x, MOMENTS - 1) / fact * std <= LEAK * fmax(cabs(f->lambda[j]), DBL_MIN)) && f->lambda[j] != 0)
            return false;
    }
    return true;
}

/* ---- signals of a window ---- */

/* What the fits of one window work on. */
struct job {
    struct moving *m;
    struct moving_rows rows;
    struct matrix Y;              /* rows x S: compressed samples of the channels, as they are */
    double *R, *rest;             /* S x S: triangles of all rows; of what Q does not hold */
    double *scale;                /* rms of each channel; 0: a zero channel */
    double *weight;               /* of each channel beside 1/scale: 1, or the least noise over its own */
    bool weighed;
    double *W; int r;             /* S x r: signals = samples W */
    double *outside2;
    struct matrix X;              /* rows x r */
    struct moving_fit first, own, channels;      /* on signals as sent, weighed; own poles on the channels, where they are not the signals */
    double work;
    enum growth *growth;          /* of each of own's poles */
    bool exact;                   /* what is left is rounding */
};

static void job_done(struct job *j)
{
    free(j->Y.x), free(j->R), free(j->rest), free(j->scale), free(j->weight), free(j->W), free(j->outside2), free(j->X.x), free(j->growth);
    moving_fit_done(&j->first), moving_fit_done(&j->own), moving_fit_done(&j->channels);
}

static void copy_samples(const struct job *j, uint64_t from, int count, int row)
{
    const double *y = sample(j->m, from);

    for (int l = 0; l < count; l++)
        for (int c = 0; c < j->m->S; c++)
            j->Y.x[row + l + (size_t)c * (size_t)j->Y.ld] = y[(size_t)l * (size_t)j->m->S + (size_t)c];
}

/* The window's rows, compressed, and their triangles. */
static enum modal_status take_window(struct job *j, struct modal_error *err)
{
    struct moving *m = j->m;
    uint64_t from = m->next - (uint64_t)m->L, last = m->count > 0 ? m->block_from + (uint64_t)m->count * (uint64_t)m->B : m->next;
    int S = m->S, lead = m->count > 0 ? (int)(m->block_from - from) : m->L, trail = (int)(m->next - last), n;
    struct matrix loose = { lead + trail, S, lead + trail, NULL };
    enum modal_status rc;

    j->rows = (struct moving_rows) { lead, m->count, trail, m->B, m->k, m->Q, m->opt.dt };
    n = moving_rows_count(&j->rows);
    j->Y = (struct matrix) { n, S, n, malloc(sizeof(double) * (size_t)n * (size_t)S) };
    j->R = malloc(sizeof(double) * (size_t)S * (size_t)S), j->rest = malloc(sizeof(double) * (size_t)S * (size_t)S);
    j->scale = calloc((size_t)S, sizeof(double)), j->weight = calloc((size_t)S, sizeof(double));
    j->W = malloc(sizeof(double) * (size_t)S * (size_t)S), j->outside2 = malloc(sizeof(double) * (size_t)S);
    j->X = (struct matrix) { n, S, n, malloc(sizeof(double) * (size_t)n * (size_t)S) };
    loose.x = malloc(sizeof(double) * (size_t)(loose.m + 1) * (size_t)S);
    if (j->Y.x == NULL || j->R == NULL || j->rest == NULL || j->scale == NULL || j->weight == NULL || j->W == NULL || j->outside2 == NULL
        || j->X.x == NULL || loose.x == NULL) {
        free(loose.x);
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", n, S);
    }
    copy_samples(j, from, lead, 0);
    copy_samples(j, last, trail, n - trail);
    for (int b = 0; b < m->count; b++)
        for (int c = 0; c < S; c++)
            memcpy(j->Y.x + lead + b * m->k + (size_t)c * (size_t)n, m->blocks[b].C + (size_t)c * (size_t)m->k, sizeof(double) * (size_t)m->k);
    for (int c = 0; c < S; c++) {
        memcpy(loose.x + (size_t)c * (size_t)loose.m, j->Y.x + (size_t)c * (size_t)n, sizeof(double) * (size_t)lead);
        memcpy(loose.x + lead + (size_t)c * (size_t)loose.m, j->Y.x + n - trail + (size_t)c * (size_t)n, sizeof(double) * (size_t)trail);
    }
    rc = window_qr_factor(m->all, &loose, j->R, err);
    if (rc == MODAL_OK)
        rc = window_qr_factor(m->rest, NULL, j->rest, err);
    for (int c = 0; c < S; c++) {
        j->scale[c] = safe_norm(j->R + (size_t)c * (size_t)S, (size_t)c + 1) / sqrt(m->L);
        j->weight[c] = 1;
    }
    free(loose.x);
    return rc;
}

static double channel_factor(const struct job *j, int c)
{
    return j->scale[c] > 0 ? j->weight[c] / j->scale[c] : 0;
}

/* The first value that does not stand out of the rest as (1) of pod.c has it; all above rounding where none. */
static int above_rest(const struct moving *m, const double *s, int most)
{
    double L = m->L, S = m->S, rest = 0;

    for (int i = 0; i < m->S; i++)
        rest += s[i] * s[i];
    for (int k = 0; k < most && k < S; k++) {
        if (s[k] <= 1.02 * sqrt(fmax(rest, 0) / ((L - k) * (S - k))) * (sqrt(L - k) + sqrt(S - k)))
            return k;
        rest -= s[k] * s[k];
    }
    return most;
}

static int signals_kept(const struct job *j, const double *s)
{
    int k = 0;

    while (k < j->m->S && s[k] > j->m->L * DBL_EPSILON * s[0])
        k++;
    if (j->m->rest_white[j->weighed])
        k = above_rest(j->m, s, k);
    return k < 1 ? 1 : k > POD_SIGNALS_MOST ? POD_SIGNALS_MOST : k;
}

/* Proper orthogonal modes from the triangle: pod.c's choice of how many, where it knows all singular values. */
static enum modal_status orthogonal_modes(struct job *j, struct modal_error *err)
{
    int S = j->m->S;
    size_t size = (size_t)S * (size_t)S;
    double *x = malloc(sizeof *x * (3 * size + (size_t)S)), *s = x + 3 * size;
    struct matrix A = { S, S, S, x }, U = { S, S, S, x + size }, VT = { S, S, S, x + 2 * size };
    enum modal_status rc = MODAL_OK;

    if (x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
    for (int c = 0; c < S; c++)
        for (int i = 0; i < S; i++)
            A.x[i + (size_t)c * (size_t)S] = j->R[i + (size_t)c * (size_t)S] * channel_factor(j, c);
    rc = svd_thin(&A, s, &U, &VT, err);
    if (rc == MODAL_OK) {
        j->r = signals_kept(j, s);
        for (int i = 0; i < j->r; i++)
            for (int c = 0; c < S; c++)
                j->W[c + (size_t)i * (size_t)S] = VT.x[i + (size_t)c * (size_t)S] * channel_factor(j, c);
    }
    free(x);
    return rc;
}

/* Channels themselves, to unit rms. */
static void plain_signals(struct job *j)
{
    int S = j->m->S;

    j->r = S;
    memset(j->W, 0, sizeof *j->W * (size_t)S * (size_t)S);
    for (int c = 0; c < S; c++)
        j->W[c + (size_t)c * (size_t)S] = channel_factor(j, c);
}

static bool reduced(const struct moving *m)
{
    return m->S > POD_CHANNELS_FEW && !m->opt.identify.signals_all;
}

/* X = Y W, and of what Q does not hold the sums of squares. */
static enum modal_status make_signals(struct job *j, bool modes, struct modal_error *err)
{
    int S = j->m->S;
    double *T;
    enum modal_status rc = MODAL_OK;

    if (modes)
        rc = orthogonal_modes(j, err);
    else
        plain_signals(j);
    if (rc != MODAL_OK)
        return rc;
    T = malloc(sizeof *T * (size_t)S * (size_t)j->r);
    if (T == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d signals", j->r);
    j->X.n = j->r;
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, j->Y.m, j->r, S, 1, j->Y.x, j->Y.ld, j->W, S, 0, j->X.x, j->X.ld);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, S, j->r, S, 1, j->rest, S, j->W, S, 0, T, S);
    for (int g = 0; g < j->r; g++)
        j->outside2[g] = cblas_ddot(S, T + (size_t)g * (size_t)S, 1, T + (size_t)g * (size_t)S, 1);
    free(T);
    return MODAL_OK;
}

/* ---- is it the answer of a batch? ---- */

static enum reason judge_fit(const struct job *j, const struct moving_fit *f)
{
    double record = j->m->L * j->m->opt.dt, reach = fmax(ORDER_REACH * j->m->L * j->r, 100);
    bool chosen = j->m->opt.identify.rank.rule == RANK_AUTO;

    if (!f->settled)
        return NOT_SETTLED;
    for (int i = 0; i < f->poles; i++) {
        double size = cabs(f->lambda[i]), error = hypot(f->std_re[i], f->std_im[i]);
        if (!isfinite(error) || (size * record > 3 && error > 0.5 * size))
            return UNDETERMINED;
        if (pole_kind(f->lambda[i], j->m->opt.dt) == POLE_REAL && f->lambda[i] != 0 && fabs(creal(f->lambda[i])) < 8 * f->std_re[i])
            return OFFSET;
    }
    if (chosen && f->least_drop < reach)
        return ORDER_LESS;
    if (chosen && f->most_split > LIKELY * f->pair_price)
        return POLE_SPLITS;
    return GOOD;
}

/* E = signals less their fit, L x r, of the whole window. */
static enum modal_status residual_of(const struct job *j, const struct moving_fit *f, double *E, struct modal_error *err)
{
    struct moving *m = j->m;
    struct moving_rows all = { .lead = m->L, .tau = m->opt.dt };
    int L = m->L, at = 0;
    double *Phi = malloc(sizeof *Phi * (size_t)L * (size_t)(f->order + 1));

    if (Phi == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", L, f->order);
    for (int i = 0; i < f->poles; i++) {
        moving_column(&all, f->lambda[i], Phi + (size_t)at * (size_t)L, Phi + (size_t)(at + 1) * (size_t)L, NULL, NULL);
        at += pole_order(f->lambda[i], m->opt.dt);
    }
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, L, j->r, m->S, 1, sample(m, m->next - (uint64_t)L), m->S, j->W, m->S, 0, E, L);
    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, L, j->r, f->order, -1, Phi, L, f->C, f->order, 1, E, L);
    free(Phi);
    return MODAL_OK;
}

/* Samples first .. first + n - 1 of E, one gain (2) a frequency; the largest. */
static double largest_gain(const struct job *j, const struct moving_fit *f, const double *E, int first, int n, fftw_plan plan, double *gains)
{
    struct moving *m = j->m;
    double most = 0;

    memset(gains, 0, sizeof *gains * (size_t)(n / 2 + 1));
    for (int g = 0; g < j->r; g++) {
        if (!(f->rss[g] > m->L * f->floor2[g]))
            continue;
        memcpy(m->x, E + (size_t)g * (size_t)m->L + first, sizeof *m->x * (size_t)n);
        fftw_execute(plan);
        for (int k = 0; k <= n / 2; k++) {
            double share = (k == 0 || 2 * k == n ? 1.0 : 2.0) / n * (creal(m->X[k]) * creal(m->X[k]) + cimag(m->X[k]) * cimag(m->X[k])) / f->rss[g];
            gains[k] -= m->L * log1p(-fmin(share, 1 - DBL_EPSILON));
        }
    }
    for (int k = 0; k <= n / 2; k++)
        most = fmax(most, gains[k]);
    return most;
}

static bool plans(struct moving *m)
{
    if (m->x == NULL)
        m->x = fftw_alloc_real((size_t)m->L), m->X = fftw_alloc_complex((size_t)m->L / 2 + 1);
    for (int i = 0, n = m->L; m->x != NULL && m->X != NULL && i < 3; i++, n /= 4)
        if (m->plan[i] == NULL && n >= 8)
            m->plan[i] = fftw_plan_dft_r2c_1d(n, m->x, m->X, FFTW_ESTIMATE);
    return m->plan[0] != NULL;
}

/* ---- do the halves of the window contradict the whole?  parts.c, as far as its first look goes ---- */

/* Signals at samples first .. first + count - 1 of the window, into rows ROW .. of X; their residual's squares are taken off `rest2`. */
static void put_loose(const struct job *j, const double *E, int first, int count, struct matrix *X, int row, double *rest2)
{
    struct moving *m = j->m;

    if (count == 0)
        return;
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, count, j->r, m->S, 1, sample(m, m->next - (uint64_t)(m->L - first)), m->S, j->W, m->S, 0,
                X->x + row, X->ld);
    for (int g = 0; g < j->r; g++)
        rest2[g] -= cblas_ddot(count, E + first + (size_t)g * (size_t)m->L, 1, E + first + (size_t)g * (size_t)m->L, 1);
}

/* Samples first .. first + count - 1 as rows of their own: blocks that lie within, the rest loose. */
static struct moving_rows half_rows(const struct job *j, int first, int count, int *block)
{
    const struct moving_rows *r = &j->rows;
    struct moving_rows half = *r;
    int B = r->length > 0 ? r->length : 1, from = first > r->lead ? (first - r->lead + B - 1) / B : 0;
    int to = first + count > r->lead ? (first + count - r->lead) / B : 0;

    to = to < r->blocks ? to : r->blocks;
    *block = from;
    half.blocks = to > from ? to - from : 0;
    half.lead = half.blocks > 0 ? r->lead + from * B - first : count;
    half.trail = count - half.lead - half.blocks * B * (half.blocks > 0);
    return half;
}

/*
 * Signals of one half.  What Q holds of the residual is small beside what it does not, so that the squares of the latter are those of the residual less
 * those of its part in Q.
 */
static enum modal_status half_signals(const struct job *j, const struct moving_fit *f, const double *E, int first, const struct moving_rows *half, int block,
                                      struct matrix *X, double *outside2, struct modal_error *err)
{
    int L = j->m->L, k = half->k, n = moving_rows_count(half), count = moving_rows_samples(half), whole = moving_rows_count(&j->rows), at = 0;
    int from = j->rows.lead + block * k, rows = half->blocks * k;
    double *Phi = malloc(sizeof *Phi * (size_t)whole * (size_t)(f->order + 1)), *rest = malloc(sizeof *rest * ((size_t)rows + 1) * (size_t)j->r);

    if (Phi == NULL || rest == NULL) {
        free(Phi), free(rest);
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", whole, f->order);
    }
    for (int g = 0; g < j->r; g++)
        outside2[g] = cblas_ddot(count, E + first + (size_t)g * (size_t)L, 1, E + first + (size_t)g * (size_t)L, 1);
    put_loose(j, E, first, half->lead, X, 0, outside2);
    put_loose(j, E, first + count - half->trail, half->trail, X, n - half->trail, outside2);
    for (int i = 0; i < f->poles && rows > 0; at += pole_order(f->lambda[i], j->m->opt.dt), i++)
        moving_column(&j->rows, f->lambda[i], Phi + (size_t)at * (size_t)whole, Phi + (size_t)(at + 1) * (size_t)whole, NULL, NULL);
    for (int g = 0; g < j->r && rows > 0; g++) {
        double *e = rest + (size_t)g * (size_t)rows;
        memcpy(X->x + half->lead + (size_t)g * (size_t)X->ld, j->X.x + from + (size_t)g * (size_t)j->X.ld, sizeof *e * (size_t)rows);
        memcpy(e, j->X.x + from + (size_t)g * (size_t)j->X.ld, sizeof *e * (size_t)rows);
    }
    if (rows > 0)
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, rows, j->r, f->order, -1, Phi + from, whole, f->C, f->order, 1, rest, rows);
    for (int g = 0; g < j->r && rows > 0; g++)
        outside2[g] -= cblas_ddot(rows, rest + (size_t)g * (size_t)rows, 1, rest + (size_t)g * (size_t)rows, 1);
    for (int g = 0; g < j->r; g++)
        outside2[g] = fmax(outside2[g], 0);
    free(Phi), free(rest);
    return MODAL_OK;
}

static enum modal_status ask_half(struct job *j, const struct moving_fit *f, const double *E, int first, int count, enum reason *why, struct modal_error *err)
{
    int block;
    struct moving_rows half = half_rows(j, first, count, &block);
    int n = moving_rows_count(&half);
    struct matrix X = { n, j->r, n, malloc(sizeof(double) * (size_t)n * (size_t)j->r) };
    double *outside2 = malloc(sizeof *outside2 * (size_t)j->r), parameters = f->parameters;
    struct moving_signals y = { X, outside2 };
    struct moving_fit own = { 0 };
    enum modal_status rc = MODAL_OK;

    if (X.x == NULL || outside2 == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", n, j->r);
    if (rc == MODAL_OK)
        rc = half_signals(j, f, E, first, &half, block, &X, outside2, err);
    if (rc == MODAL_OK && n < 2 * f->order + j->r)
        *why = PARTS;
    else if (rc == MODAL_OK)
        rc = moving_probe(&half, &y, f->lambda, f->poles, &own, err);
    j->work += own.work;
    if (rc == MODAL_OK && *why == GOOD && !(own.could_gain < parameters + PARTS_DEVIATIONS * sqrt(2 * parameters) + PARTS_SLACK))
        *why = PARTS;
    for (int i = 0; i < f->poles && rc == MODAL_OK && *why == GOOD; i++)
        if (creal(f->lambda[i]) > PARTS_CLEAR * own.std_re[i])
            j->growth[i] = GROWTH_IN_HALF;
    moving_fit_done(&own);
    free(X.x), free(outside2);
    return rc;
}

static enum modal_status ask_halves(struct job *j, const struct moving_fit *f, const double *E, enum reason *why, struct modal_error *err)
{
    int L = j->m->L, rows = L / 2;
    enum modal_status rc = MODAL_OK;

    if (rows < 2 * f->order + PARTS_SPARE)
        return MODAL_OK;
    for (int i = 0; i < f->poles; i++)
        j->growth[i] = GROWTH_UNSEEN;
    for (int first = 0; first <= L - rows && rc == MODAL_OK && *why == GOOD; first += L - rows)
        rc = ask_half(j, f, E, first, rows, why, err);
    return rc;
}

static enum modal_status judge_residual(struct job *j, struct moving_fit *f, enum reason *why, struct modal_error *err)
{
    struct moving *m = j->m;
    int L = m->L;
    double *E = malloc(sizeof *E * ((size_t)L * (size_t)j->r + (size_t)L + 2 * (size_t)f->poles)), *gains = E + (size_t)L * (size_t)j->r, *theta = gains + L;
    struct matrix view = { L, j->r, L, E };
    enum modal_status rc;

    if (E == NULL || !plans(m)) {
        free(E);
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d x %d", L, j->r);
    }
    rc = residual_of(j, f, E, err);
    if (rc == MODAL_OK && !colour_white(&view))
        *why = NOT_WHITE;
    for (int i = 0, n = L; rc == MODAL_OK && *why == GOOD && i < 3 && n >= 8; i++, n /= 4) {
        double most = largest_gain(j, f, E, 0, n, m->plan[i], gains);
        if (i > 0)
            most = fmax(most, largest_gain(j, f, E, L - n, n, m->plan[i], gains));
        if (most > LIKELY * f->pair_price)
            *why = ORDER_MORE;
    }
    for (int i = 0; i < f->poles; i++)
        theta[i] = fabs(cimag(f->lambda[i])) * m->opt.dt;
    if (rc == MODAL_OK && *why == GOOD)
        rc = colour_factors(&view, theta, f->poles, theta + f->poles, err);
    for (int i = 0; i < f->poles && rc == MODAL_OK && *why == GOOD; i++)
        if (theta[f->poles + i] > 1)
            *why = NOT_WHITE;
    if (rc == MODAL_OK && *why == GOOD)
        rc = ask_halves(j, f, E, why, err);
    free(E);
    return rc;
}

/* ---- channels by their noise, as identify.c ---- */

static enum modal_status look_at_channels(struct job *j, const struct moving_fit *f, struct moving_fit *out, struct modal_error *err)
{
    struct moving_signals y;
    enum modal_status rc;

    for (int c = 0; c < j->m->S; c++)
        j->weight[c] = 1;
    j->weighed = false;
    rc = make_signals(j, false, err);
    y = (struct moving_signals) { j->X, j->outside2 };
    if (rc == MODAL_OK)
        rc = moving_look(&j->rows, &y, f->lambda, f->poles, out, err);
    j->work += out->work;
    return rc;
}

/* Whether the channels are to be weighed; their weights. */
static enum modal_status weigh_channels(struct job *j, const struct moving_fit *f, bool *weighed, struct modal_error *err)
{
    int S = j->m->S;
    double least = HUGE_VAL, most = 0, total = 0, rest = 0;
    struct moving_fit look = { 0 };
    enum modal_status rc = look_at_channels(j, f, &look, err);

    *weighed = false;
    for (int c = 0; c < S && rc == MODAL_OK; c++) {
        double noise = fmax(sqrt(look.rss[c] / j->m->L), NOISE_QUIETEST);
        total += j->scale[c] > 0 ? j->m->L : 0, rest += look.rss[c];
        least = j->scale[c] > 0 ? fmin(least, noise) : least, most = j->scale[c] > 0 ? fmax(most, noise) : most;
    }
    if (rc == MODAL_OK && sqrt(rest) > 1e-12 * sqrt(total) && most > NOISE_ALIKE * least) {
        *weighed = j->weighed = true;
        for (int c = 0; c < S; c++)
            j->weight[c] = least / fmax(sqrt(look.rss[c] / j->m->L), NOISE_QUIETEST);
    }
    moving_fit_done(&look);
    return rc;
}

static enum modal_status fit(struct job *j, const struct poles_of *start, bool modes, struct moving_fit *out, enum reason *why, struct modal_error *err)
{
    struct moving_signals y;
    enum modal_status rc = make_signals(j, modes, err);

    y = (struct moving_signals) { j->X, j->outside2 };
    if (rc == MODAL_OK)
        rc = moving_fit(&j->rows, &y, start->lambda, start->count, out, err);
    j->work += out->work;
    if (rc == MODAL_OK)
        *why = judge_fit(j, out);
    return rc;
}

/* Signals, poles, and whether they stand. */
static enum modal_status fit_window(struct job *j, enum reason *why, struct modal_error *err)
{
    struct moving *m = j->m;
    bool weighed = false, before = m->first.count > 0;
    enum modal_status rc = fit(j, before ? &m->first : &m->own, reduced(m), before ? &j->first : &j->own, why, err);

    if (rc == MODAL_OK && *why == GOOD && reduced(m)) {
        rc = weigh_channels(j, before ? &j->first : &j->own, &weighed, err);
        if (rc == MODAL_OK && weighed != before)
            *why = BY_NOISE;
        if (rc == MODAL_OK && *why == GOOD && before)
            rc = fit(j, &m->own, true, &j->own, why, err);
        else if (rc == MODAL_OK && *why == GOOD)
            rc = make_signals(j, true, err);             /* back from the channels to the signals that were fitted */
    }
    return rc;
}

/* ---- the answer ---- */

/* Rows of the basis of pole i, columns as the coefficients want them. */
static double energy_of(const struct job *j, const struct moving_fit *f, int i, int column, double *x)
{
    int n = moving_rows_count(&j->rows), columns = pole_order(f->lambda[i], j->m->opt.dt);
    double sum = 0, G[3];

    moving_column(&j->rows, f->lambda[i], x, x + n, NULL, NULL);
    G[0] = cblas_ddot(n, x, 1, x, 1), G[1] = cblas_ddot(n, x, 1, x + n, 1), G[2] = cblas_ddot(n, x + n, 1, x + n, 1);
    for (int c = 0; c < f->signals; c++) {
        const double *b = f->C + column + (size_t)c * (size_t)f->order;
        sum += columns == 2 ? b[0] * b[0] * G[0] + 2 * b[0] * b[1] * G[1] + b[1] * b[1] * G[2] : b[0] * b[0] * G[0];
    }
    return sum;
}

/* In the channels' own units, largest component 1. */
static enum modal_status shape_of(const struct job *j, const struct moving_fit *f, int i, int column, struct identify_mode *mode, struct modal_error *err)
{
    int S = f->signals;
    bool pair = pole_kind(f->lambda[i], j->m->opt.dt) == POLE_PAIR;

    mode->shape = malloc(sizeof *mode->shape * ((size_t)S + 1));
    if (mode->shape == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for a shape of %d channels", S);
    for (int c = 0; c < S; c++) {
        const double *b = f->C + column + (size_t)c * (size_t)f->order;
        mode->shape[c] = CMPLX(b[0], pair ? b[1] : 0) * j->scale[c];
    }
    modes_scale_shape(mode, S);
    return MODAL_OK;
}

static const struct moving_fit *channels_of(const struct job *j)
{
    return reduced(j->m) ? &j->channels : &j->own;
}

static enum modal_status report_modes(const struct job *j, struct identify_result *out, struct modal_error *err)
{
    const struct moving_fit *f = &j->own, *all = channels_of(j);
    double dt = j->m->opt.dt, live = 0, *x = malloc(sizeof *x * 2 * (size_t)moving_rows_count(&j->rows));
    enum modal_status rc = MODAL_OK;

    out->modes = calloc((size_t)f->poles + 1, sizeof *out->modes);
    if (x == NULL || out->modes == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d modes", f->poles);
    for (int c = 0; c < j->m->S; c++)
        live += j->scale[c] > 0;
    for (int i = 0, column = 0; i < f->poles && rc == MODAL_OK; column += pole_order(f->lambda[i], dt), i++) {
        struct identify_mode *mode = &out->modes[out->mode_count++];
        *mode = (struct identify_mode) { .exponent = f->lambda[i], .resolved = f->lambda[i], .multiplier = multiplier_of(f->lambda[i], dt),
                                         .persistence = NAN, .residual = NAN, .bar = NAN, .std_re = f->std_re[i], .std_im = f->std_im[i],
                                         .growth = j->growth[i] };
        mode->amplitude = sqrt(energy_of(j, all, i, column, x) / (j->m->L * live));
        modes_spread_std(mode, dt, j->m->L * dt);
        if (j->m->opt.identify.shapes)
            rc = shape_of(j, all, i, column, mode, err);
    }
    modes_rank(out);
    free(x);
    return rc;
}

static enum modal_status report_channels(const struct job *j, struct identify_result *out, struct modal_error *err)
{
    int S = j->m->S, L = j->m->L;
    double all = 0, rest = 0;
    const struct moving_fit *f = channels_of(j);

    out->channel_count = S;
    out->channel = malloc(sizeof *out->channel * ((size_t)S + 1));
    out->rms_error = malloc(sizeof *out->rms_error * ((size_t)S + 1));
    out->relative_error = malloc(sizeof *out->relative_error * ((size_t)S + 1));
    if (out->channel == NULL || out->rms_error == NULL || out->relative_error == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d channels", S);
    for (int c = 0; c < S; c++) {
        double r = sqrt(f->rss[c] / L);
        out->channel[c] = c;
        out->rms_error[c] = j->scale[c] * r;
        out->relative_error[c] = j->scale[c] > 0 ? r : NAN;
        rest += f->rss[c], all += j->scale[c] > 0 ? L : 0;
    }
    out->total_relative_error = all > 0 ? sqrt(rest / all) : NAN;
    return MODAL_OK;
}

static void report_settings(const struct job *j, struct identify_result *out)
{
    const struct moving *m = j->m;

    out->pod_rank = reduced(m) ? j->r : m->S;
    out->hankel_rank = j->own.order;
    out->rule = m->opt.identify.rank.rule;
    out->energy = 1;
    out->dt = m->opt.dt;
    out->samples = m->L;
    out->decimation = out->shift = 1;
    out->freedom = m->L - j->own.order;
    out->used = m->opt.identify;
    out->used.refine = CHOICE_YES;
    out->used.stride = 1;
    out->used.period = 0;
    out->used.channels = NULL, out->used.clock = NULL, out->used.cancelled = NULL, out->used.context = NULL;
}

static enum modal_status report(struct job *j, struct identify_result *out, struct modal_error *err)
{
    struct moving *m = j->m;
    struct diagnose_facts facts = { .converged = true, .asked_rank = m->opt.identify.rank.rule == RANK_FIXED ? m->opt.identify.rank.fixed : 0,
                                    .full_rank = IDENTIFY_ORDER_MOST, .rows = m->L, .order = j->own.order, .record = m->L * m->opt.dt, .tau = m->opt.dt,
                                    .doubt = { .colour = 1 } };
    enum modal_status rc;

    report_settings(j, out);
    if ((rc = report_modes(j, out, err)) != MODAL_OK || (rc = report_channels(j, out, err)) != MODAL_OK
        || (rc = verdict_clusters(out, facts.record, err)) != MODAL_OK)
        return rc;
    verdict_stability(out, facts.record);
    diagnose(out, &facts);
    trend_of_modes(facts.record, out);
    return MODAL_OK;
}

/* ---- update, or from nothing ---- */

static bool take_poles(struct poles_of *to, const double complex *lambda, int count)
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

/* Does a batch do something beside the fit with these poles?  An offset is reported apart, a crowd is looked at window by window. */
static bool special(const struct moving *m, const double complex *lambda, int count)
{
    for (int i = 0; i < count; i++) {
        int near = 0;
        for (int j = 0; j < count; j++)
            near += cimag(lambda[j]) > 0 && fabs(cimag(lambda[j]) - cimag(lambda[i])) < 0.05 * cimag(lambda[i]);
        if (near >= 3 || (pole_kind(lambda[i], m->opt.dt) == POLE_REAL && fabs(creal(lambda[i])) * m->L * m->opt.dt < 0.3))
            return true;
    }
    return count == 0;
}

/* Whether pod.c, which sees the signals themselves, kept only those that stand out of the rest: as sent, and weighed. */
static enum modal_status learn_rest(struct moving *m, const struct identify_result *batch, struct modal_error *err)
{
    struct job j = { .m = m };
    bool weighed = m->first.count > 0;
    enum reason why = GOOD;
    enum modal_status rc;

    m->rest_white[0] = m->rest_white[1] = true;
    rc = take_window(&j, err);
    if (rc == MODAL_OK)
        rc = make_signals(&j, true, err);
    m->rest_white[0] = rc == MODAL_OK && j.r == (weighed ? batch->unweighed.signals : batch->chosen.signals);
    if (rc == MODAL_OK && weighed)
        rc = fit(&j, &m->first, true, &j.first, &why, err);
    if (rc == MODAL_OK && weighed)
        rc = weigh_channels(&j, &j.first, &weighed, err);
    if (rc == MODAL_OK && weighed)
        rc = make_signals(&j, true, err);
    m->rest_white[1] = rc == MODAL_OK && weighed && j.r == batch->chosen.signals;
    job_done(&j);
    return rc;
}

static enum modal_status from_nothing(struct moving *m, struct identify_result *out, struct modal_error *err)
{
    struct batch batch = { .samples = (size_t)m->L, .channels = (size_t)m->S, .signals = sample(m, m->next - (uint64_t)m->L), .dt = m->opt.dt, .period = m->opt.period };
    enum modal_status rc = modal_identify(&batch, &m->opt.identify, out, err);

    m->batches++;
    forget_anchor(m);
    m->reason = FIRST;
    if (rc != MODAL_OK || !m->possible)
        return rc;
    if (out->at_grid) {
        m->reason = GRID;
        return rc;
    }
    if (special(m, out->chosen.lambda, out->chosen.count)) {
        m->reason = out->chosen.count == 0 ? NOT_SETTLED : OFFSET;
        return rc;
    }
    if (!take_poles(&m->own, out->chosen.lambda, out->chosen.count) || !take_poles(&m->first, out->unweighed.lambda, out->unweighed.count)
        || set_anchor(m, &m->own, NULL) != MODAL_OK)
        forget_anchor(m);                        /* the answer stands; the next one is from nothing too */
    if (m->anchored && reduced(m))
        return learn_rest(m, out, err);
    return MODAL_OK;
}

/* One try from the anchor as it is. */
static enum modal_status update(struct job *j, enum reason *why, struct modal_error *err)
{
    enum modal_status rc = take_window(j, err);

    if (rc == MODAL_OK && moving_rows_count(&j->rows) < 2 * poles_order(j->m->own.lambda, j->m->own.count, j->m->opt.dt) + j->m->S) {
        *why = OPTIONS;
        return MODAL_OK;
    }
    if (rc == MODAL_OK)
        rc = fit_window(j, why, err);
    return rc;
}

static bool below_rounding(const struct job *j)
{
    double most = largest_magnitude(j->scale, (size_t)j->m->S);

    for (int c = 0; c < j->m->S; c++)
        if (j->scale[c] > 0 && j->scale[c] < 10 * ROUNDING_RATIO * most)
            return true;
    return false;
}

/* What widen.c does: nothing where the fit is exact, beside rounding. */
static enum modal_status doubt(struct job *j, enum reason *why, struct modal_error *err)
{
    struct moving_fit *f = &j->own;
    double rest = 0, all = 0;

    j->growth = calloc((size_t)f->poles + 1, sizeof *j->growth);
    if (j->growth == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d poles", f->poles);
    for (int g = 0; g < f->signals; g++)
        rest += f->rss[g], all += f->energy[g];
    j->exact = sqrt(rest) <= 1e-12 * sqrt(all);
    for (int i = 0; i < f->poles; i++) {
        j->growth[i] = GROWTH_EXACT;
        f->std_re[i] *= j->exact ? WIDEN_ROUNDING : 1, f->std_im[i] *= j->exact ? WIDEN_ROUNDING : 1;
    }
    if (below_rounding(j))
        *why = OPTIONS;
    return *why != GOOD || j->exact ? MODAL_OK : judge_residual(j, f, why, err);
}

static enum modal_status try_update(struct moving *m, struct job *j, enum reason *why, struct modal_error *err)
{
    enum modal_status rc = update(j, why, err);

    if (rc == MODAL_OK && *why == GOOD && !is_near(m, &j->own)) {        /* once more, from an anchor where the poles are now */
        struct poles_of here = { j->own.lambda, j->own.poles };
        double work = j->work;
        rc = set_anchor(m, &here, err);
        job_done(j);
        *j = (struct job) { .m = m, .work = work };
        if (rc == MODAL_OK)
            rc = update(j, why, err);
    }
    if (rc == MODAL_OK && *why == GOOD && special(m, j->own.lambda, j->own.poles))
        *why = OFFSET;
    if (rc == MODAL_OK && *why == GOOD)
        rc = doubt(j, why, err);
    if (rc == MODAL_OK && *why == GOOD && reduced(m))
        rc = look_at_channels(j, &j->own, &j->channels, err);
    return rc;
}

static bool has_weak_mode(const struct identify_result *r)
{
    bool any = false;

    for (int i = 0; i < r->mode_count; i++)
        any |= r->modes[i].energy < VERDICT_WEAK;
    return any;
}

enum modal_status moving_identify(struct moving *m, struct identify_result *out, struct moving_cost *cost, struct modal_error *err)
{
    struct job j = { .m = m };
    enum reason why = m->possible ? (enum reason)m->reason : OPTIONS;
    enum modal_status rc = MODAL_OK;

    memset(out, 0, sizeof *out);
    if (moving_samples(m) < m->L)
        return modal_fail(err, MODAL_BAD_INPUT, "moving: %d of %d samples", moving_samples(m), m->L);
    if (m->anchored)
        rc = try_update(m, &j, &why, err);
    if (rc == MODAL_OK && m->anchored && why == GOOD) {
        rc = report(&j, out, err);
        if (rc == MODAL_OK && has_weak_mode(out)) {      /* its say needs its persistence, which only a ladder of orders knows */
            identify_result_done(out);
            why = WEAK_MODE;
            rc = from_nothing(m, out, err);
        } else if (rc == MODAL_OK && (!take_poles(&m->own, j.own.lambda, j.own.poles) || !take_poles(&m->first, j.first.lambda, j.first.poles)))
            rc = modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for %d poles", j.own.poles);
        m->updates += rc == MODAL_OK && why == GOOD;
    } else if (rc == MODAL_OK || rc == MODAL_NO_CONVERGENCE) {
        rc = from_nothing(m, out, err);
    }
    if (rc != MODAL_OK)
        identify_result_done(out);
    if (cost != NULL)
        *cost = (struct moving_cost) { why == GOOD, why == GOOD ? NULL : moving_reasons[why], why == GOOD ? j.work : 0, m->updates, m->batches };
    job_done(&j);
    return rc;
}
