/* rounding.c - a sensor on a node of every mode measures the last bits of its neighbours
 *
 * Such a channel, 1e-17 beside 1, scaled to unit rms like the rest, is noise as strong as any
 * signal.  Its size alone does not condemn it: channels have their own units, and a displacement in
 * metres beside a stress in pascals may be as small.  So two things are asked of a channel before
 * it is left out: that its rms is below ROUNDING_RATIO of the largest, and that it is not a free
 * response, neither of few exponents nor of those of the others.
 *
 * A free response of q exponents has a Hankel matrix of rank q: what its leading MODES triplets
 * leave of the energy,
 *
 *     1 - sum_{i<=MODES} s_i^2 / |H|_F^2,                                                       (1)
 *
 * is its noise.  Above NOISE (30 dB) the channel is one of rounding, or of more exponents: that of
 * an integration is not white, for it drives the modes that the motion left alone, but it drives
 * them at every step.  A free response of the others' exponents, any number, is a linear
 * combination of them and of what they are some samples later, and rounding is none:
 *
 *     x_l = sum_{c,d} a_cd y_{c,l+d},   c a large channel,  0 <= d < DELAYED / channels,     (2)
 *
 * by least squares over RATIO rows a coefficient, which explain 1 / RATIO of white noise.  What
 * (2) leaves more than NOISE of, too, is taken for rounding.
 */
#include "modal/identify/prepare/rounding.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/linear/pencil.h"
#include "modal/linalg/qr.h"
#include "modal/linalg/svd.h"

enum {
    MODES = 12,                     /* triplets */
    ROWS_MOST = 512,                /* of the record that are asked: its beginning */
    DELAYED = 256,                  /* coefficients of (2): 128 pairs; the QR takes 0.1 s */
    RATIO = 4                       /* rows a coefficient */
};
static const double NOISE = 1e-3;   /* of the energy: 30 dB */

/* |H|_F^2 of a column with `rows` rows in the Hankel matrix: sample k is in as many entries as its
 * antidiagonal has. */
static double hankel_energy(const double *x, int L, int rows)
{
    int columns = L - rows + 1, side = rows < columns ? rows : columns;
    double sum = 0;

    for (int k = 0; k < L; k++) {
        int entries = k + 1 < L - k ? k + 1 : L - k;
        sum += (entries < side ? entries : side) * x[k] * x[k];
    }
    return sum;
}

/* (1) for a column of unit rms, or its beginning. */
static enum modal_status is_free_response(const double *x, int L, bool *yes,
                                          struct modal_error *err)
{
    struct matrix Y = { L < ROWS_MOST ? L : ROWS_MOST, 1, L, (double *)x };
    struct pencil p = { 0 };
    double kept = 0, all;
    enum modal_status rc = pencil_new(&Y, &(struct pencil_options) { .wanted = MODES }, &p, err);

    for (int i = 0; i < p.count && rc == MODAL_OK; i++)
        kept += p.s[i] * p.s[i];
    all = hankel_energy(x, Y.m, p.rows);
    *yes = rc == MODAL_OK && kept >= (1 - NOISE) * all;
    pencil_done(&p);
    return rc;
}

/* Column c at unit rms, wherever it lies. */
static void read_column(const struct record *r, int c, double *x)
{
    double most = 0;

    for (int k = 0; k < r->Y.m; k++) {
        x[k] = r->wide ? r->view.x[c + (size_t)k * r->view.stride]
                       : r->Y.x[k + (size_t)c * (size_t)r->Y.ld];
        if (r->wide)
            wide_passed(&r->view, k);
    }
    most = largest_magnitude(x, r->Y.m);
    for (int k = 0; k < r->Y.m && most > 0; k++)
        x[k] /= most;
}

static bool is_large(const struct record *r, int c, double most)
{
    return r->scale[c] > 0 && r->scale[c] / most >= ROUNDING_RATIO;
}

/* What the large channels span, (2): columns orthonormal, of rows from the first on. */
static enum modal_status span_make(const struct record *r, double most, double *x, struct matrix *Q,
                                   struct modal_error *err)
{
    int large = 0, columns = r->Y.m / (RATIO + 1), delays, at = 0;
    struct matrix R = { 0 };

    columns = columns < DELAYED ? columns : DELAYED;
    for (int c = 0; c < r->channels; c++)
        large += is_large(r, c, most);
    large = large < columns ? large : columns;
    delays = large > 0 ? columns / large : 0;
    *Q = matrix_new(RATIO * large * delays, large * delays);
    if (Q->x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "rounding: no memory for %d columns", columns);
    for (int c = 0; c < r->channels && at < Q->n; c++) {
        if (!is_large(r, c, most))
            continue;
        read_column(r, c, x);
        for (int d = 0; d < delays; d++, at++)
            memcpy(Q->x + (size_t)at * (size_t)Q->ld, x + d, sizeof *x * (size_t)Q->m);
    }
    return Q->n > 0 ? qr_orthonormal(Q, &R, err) : MODAL_OK;
}

/* Does (2) leave less than NOISE of x? */
static bool is_spanned(const struct matrix *Q, const double *x)
{
    double all = cblas_ddot(Q->m, x, 1, x, 1), kept = 0;

    for (int j = 0; j < Q->n; j++)
        kept += pow(cblas_ddot(Q->m, Q->x + (size_t)j * (size_t)Q->ld, 1, x, 1), 2);
    return Q->n > 0 && kept >= (1 - NOISE) * all;
}

static void leave_out(struct record *r, int c)
{
    r->below[c] = true;
    if (!r->wide)
        memset(r->Y.x + (size_t)c * (size_t)r->Y.ld, 0, sizeof(double) * (size_t)r->Y.m);
}

/* Is channel C, a small one, rounding?  X and OTHER have room for a column. */
static enum modal_status is_rounding(const struct record *r, int c, double most, double *x,
                                     double *other, struct matrix *Q, bool *yes,
                                     struct modal_error *err)
{
    enum modal_status rc;

    read_column(r, c, x);
    rc = is_free_response(x, r->Y.m, yes, err);
    *yes = !*yes;
    if (rc != MODAL_OK || !*yes)
        return rc;
    if (Q->x == NULL && (rc = span_make(r, most, other, Q, err)) != MODAL_OK)
        return rc;
    *yes = !is_spanned(Q, x);
    return MODAL_OK;
}

enum modal_status rounding_channels(struct record *r, struct modal_error *err)
{
    double most = largest_magnitude(r->scale, r->channels), *x = NULL;
    struct matrix Q = { 0 };
    enum modal_status rc = MODAL_OK;

    for (int c = 0; c < r->channels && rc == MODAL_OK; c++) {
        bool rounding = false;
        if (r->scale[c] == 0 || is_large(r, c, most))
            continue;
        if (x == NULL && (x = malloc(2 * sizeof *x * (size_t)r->Y.m)) == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "rounding: no memory for %d samples", r->Y.m);
        rc = is_rounding(r, c, most, x, x + r->Y.m, &Q, &rounding, err);
        if (rc == MODAL_OK && rounding)
            leave_out(r, c);
    }
    for (int c = 0; c < r->channels; c++)
        r->scale[c] = r->below[c] ? 0 : r->scale[c];
    free(x), free(Q.x);
    return rc;
}
