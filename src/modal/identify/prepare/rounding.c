/* rounding.c - a sensor on a node of every mode measures the last bits of its neighbours
 *
 * Such a channel, 1e-17 beside 1, scaled to unit rms like the rest, is noise as strong as any
 * signal.  Its size alone does not condemn it: channels have their own units, and a displacement in
 * metres beside a stress in pascals may be as small.  So two things are asked of a channel before
 * it is left out: that its rms is below ROUNDING_RATIO of the largest, and that it is not a free
 * response.
 *
 * A free response of q exponents has a Hankel matrix of rank q: what its leading MODES triplets
 * leave of the energy,
 *
 *     1 - sum_{i<=MODES} s_i^2 / |H|_F^2,                                                       (1)
 *
 * is its noise.  Above NOISE (30 dB) the channel is taken for rounding: that of an integration is
 * not white, for it drives the modes that the motion left alone, but it drives them at every step.
 */
#include "modal/identify/prepare/rounding.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/identify/linear/pencil.h"
#include "modal/linalg/svd.h"

enum {
    MODES = 12,                     /* triplets */
    ROWS_MOST = 512                 /* of the record that are asked: its beginning */
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

enum modal_status rounding_channels(struct record *r, struct modal_error *err)
{
    double most = largest_magnitude(r->scale, r->channels), *x = NULL;
    enum modal_status rc = MODAL_OK;

    for (int c = 0; c < r->channels && rc == MODAL_OK; c++) {
        bool free_response;
        if (r->scale[c] == 0 || r->scale[c] / most >= ROUNDING_RATIO)
            continue;
        if (x == NULL && (x = malloc(sizeof *x * (size_t)r->Y.m)) == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "rounding: no memory for %d samples", r->Y.m);
        read_column(r, c, x);
        rc = is_free_response(x, r->Y.m, &free_response, err);
        if (rc != MODAL_OK || free_response)
            continue;
        r->scale[c] = 0;
        r->below[c] = true;
        if (!r->wide)
            memset(r->Y.x + (size_t)c * (size_t)r->Y.ld, 0, sizeof(double) * (size_t)r->Y.m);
    }
    free(x);
    return rc;
}
