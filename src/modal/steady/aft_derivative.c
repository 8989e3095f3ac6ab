/*
 * aft_derivative.c - the derivative of the laws' forces
 *
 * The derivative of a force of gain g is (2) of aft_events.c again, applied to delta D, with the
 * levels' own changes (pieces.h, (2)): for each stuck phase one product of its mask with the motion
 * where it began.  Rigid friction jumps at turns theta_b, which move: delta F_k = -(jump / pi)
 * e^{-i k theta_b} delta theta_b.  (1)
 *
 * As real matrices of order 2 HJ + 1, with G the harmonics of df/dd, V those of df/dv and s = l
 * omega, column l of the gain's block is
 *
 *     dF_k = (G_{k-l} + i s V_{k-l}) dD_l + (G_{k+l} - i s V_{k+l}) conj(dD_l),                 (2)
 *
 * its two real columns for Re and Im of dD_l.
 *
 * The gains of a law that is sampled are df/dd and df/dv at the samples.  Their harmonics have
 * period N, so that (2) is the exact derivative of what is sampled, aliasing and all.
 */
#include <math.h>
#include <stdlib.h>
#include "modal/steady/aft_events.h"

/* Harmonics of df/dd and df/dv at the samples, period N. */
static void analyze_gains(struct aft *w, struct aft_law *a)
{
    int inputs = a->law->kind->inputs, H = w->H, N = w->N;
    size_t stride = 2 * (size_t)H + 1;

    for (int g = 0; g < inputs * inputs; g++) {
        orbit_analyze_gain(w->grid, a->fd + (size_t)g * (size_t)N, 2 * H,
                           a->gain + (size_t)g * stride);
        if (a->law->kind->reads_velocity)
            orbit_analyze_gain(w->grid, a->fv + (size_t)g * (size_t)N, 2 * H,
                               a->damp + (size_t)g * stride);
    }
}

/* The gains of the last force's derivative.  A law sampled on request has that of its pieces. */
static enum modal_status law_gains(struct aft *w, struct aft_law *a, struct modal_error *err)
{
    bool borrow = !a->exact && a->law->kind->pieces != NULL;
    enum modal_status rc = borrow ? aft_find_pieces(w, a, err) : aft_make_slopes(w, a, err);

    if (rc == MODAL_OK && borrow)
        aft_waves(w, a);
    if (rc == MODAL_OK && (a->exact || borrow))
        aft_cross_gains(w, a, w->product + 3 * w->H + 2);
    else if (rc == MODAL_OK)
        analyze_gains(w, a);
    return rc;
}

/* (2)'s derivative as a real matrix of order 2H+1 into w->block. */
static void gain_block(struct aft *w, const double complex *G, const double complex *V)
{
    int H = w->HJ, n = 2 * H + 1;
    double *B = w->block;

    B[0] = creal(G[0]);                                 /* k = 0, l = 0 */
    for (int k = 1; k <= H; k++) {
        B[2 * k - 1] = 2 * creal(G[k]);                 /* 2 G_k dD_0 */
        B[2 * k] = 2 * cimag(G[k]);
    }
    for (int l = 1; l <= H; l++) {
        double *re = B + (size_t)(2 * l - 1) * (size_t)n, *im = re + n, s = l * w->omega;

        re[0] = creal(G[l]) + s * cimag(V[l]);          /* F_0 by Re D_l, and by Im D_l below */
        im[0] = cimag(G[l]) - s * creal(V[l]);
        for (int k = 1; k <= H; k++) {
            int p = k >= l ? k - l : l - k;
            double sign = k >= l ? 1 : -1;
            double Tr = creal(G[p]) - s * sign * cimag(V[p]),  /* G_{k-l}, of dD_l */
                   Ti = sign * cimag(G[p]) + s * creal(V[p]);
            double Hr = creal(G[k + l]) + s * cimag(V[k + l]),  /* G_{k+l}, of conj dD_l */
                   Hi = cimag(G[k + l]) - s * creal(V[k + l]);

            re[2 * k - 1] = Tr + Hr;                    /* (2), in real parts */
            re[2 * k] = Ti + Hi;
            im[2 * k - 1] = Hi - Ti;
            im[2 * k] = Tr - Hr;
        }
    }
}

/* block += column (masks or jumps, one-sided) x row (displacement, or rate, where the rotations are
 * E) */
static void outer_block(struct aft *w, const double complex *column, double factor, bool rate,
                        const double complex *e)
{
    int H = w->HJ, n = 2 * H + 1;

    for (int l = rate ? 1 : 0; l <= H; l++) {
        double a = factor * (rate ? l * cimag(e[l]) : creal(e[l]));
        double b = factor * (rate ? -l * creal(e[l]) : cimag(e[l]));
        double *re = w->block + (l > 0 ? (size_t)(2 * l - 1) * (size_t)n : 0), *im = re + n;

        re[0] += a * creal(column[0]);
        for (int k = 1; k <= H; k++) {
            re[2 * k - 1] += a * creal(column[k]);
            re[2 * k] += a * cimag(column[k]);
        }
        if (l == 0)
            continue;
        im[0] += b * creal(column[0]);
        for (int k = 1; k <= H; k++) {
            im[2 * k - 1] += b * creal(column[k]);
            im[2 * k] += b * cimag(column[k]);
        }
    }
}

/* pieces.h (2) and (3) for output i, input j */
static void level_blocks(struct aft *w, const struct aft_law *a, int i, int j)
{
    for (int s = 0; s < a->pieces.count; s++) {
        const struct law_piece *piece = &a->pieces.piece[s];

        if (piece->output != i)
            continue;
        /* What a stuck phase holds follows the motion at its start. */
        if (piece->holds && piece->ref[j] != 0) {
            aft_rotations(a->ends[2 * s], w->HJ, w->before);
            aft_rotations(a->ends[2 * s + 1], w->HJ, w->after);
            aft_mask(w, piece->to - piece->from, w->HJ);
            for (int k = 1; k <= w->HJ; k++)
                w->mask[k] *= 2;
            if (piece->at != piece->from)
                aft_rotations(aft_rotation(piece->at), w->HJ, w->before);
            /* held at what the motion was at its start */
            outer_block(w, w->mask, piece->ref[j], false, w->before);
        }
        /* A jump moves with its turn, (1). */
        if (piece->jump != 0 && piece->slope != 0 && j == 0) {
            aft_rotations(a->ends[2 * s], w->HJ, w->before);
            for (int k = 0; k <= w->HJ; k++)
                w->mask[k] = (k > 0 ? 2 : 1) / TWO_PI * w->before[k];  /* e^{-i k theta_b} / pi */
            /* (1): d theta_b = -d v / slope */
            outer_block(w, w->mask, piece->jump / piece->slope, true, w->before);
        }
    }
}

/* A visit of aft_each_slope's: onto the ends of both inputs. */
struct onto { const struct aft *w; const struct aft_target *into; };

static void add_ends(void *context, int l, int i, int j, const double *block)
{
    const struct onto *onto = context;
    const struct aft_law *a = &onto->w->law[l];
    const struct law *law = a->law;
    int n = 2 * onto->w->HJ + 1;

    for (int r = law->start[i]; r < law->start[i + 1]; r++)
        for (int c = law->start[j]; c < law->start[j + 1]; c++) {
            double weight = law->end[r].weight * law->end[c].weight;

            for (int k = 0; k < n; k++) {
                double *out = onto->into->column(onto->into->context, a->place[r], a->place[c], k);

                for (int e = 0; e < n; e++)
                    out[e] += weight * block[(size_t)k * (size_t)n + (size_t)e];
            }
        }
}

enum modal_status aft_each_slope(struct aft *w,
                                 void (*visit)(void *context, int law, int i, int j,
                                               const double *block),
                                 void *context, struct modal_error *err)
{
    size_t stride = 2 * (size_t)w->H + 1;
    enum modal_status rc = MODAL_OK;

    /* made on first use: a balance may never want a derivative */
    if (w->block == NULL && (w->block = malloc(stride * stride * sizeof *w->block)) == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for a derivative of %d harmonics",
                          w->H);
    for (int l = 0; rc == MODAL_OK && l < w->laws; l++)
        rc = law_gains(w, &w->law[l], err);
    for (int l = 0; rc == MODAL_OK && l < w->laws; l++) {
        struct aft_law *a = &w->law[l];
        int inputs = a->law->kind->inputs;

        for (int i = 0; i < inputs; i++)
            for (int j = 0; j < inputs; j++) {
                size_t at = (size_t)(i * inputs + j) * stride;

                gain_block(w, a->gain + at, a->damp + at);
                level_blocks(w, a, i, j);
                visit(context, l, i, j, w->block);
            }
    }
    return rc;
}

enum modal_status aft_add_derivative(struct aft *w, const struct aft_target *into,
                                     struct modal_error *err)
{
    struct onto onto = { w, into };

    return aft_each_slope(w, add_ends, &onto, err);
}

double aft_slope(struct aft *w)
{
    double most = 0;

    for (int l = 0; l < w->laws; l++) {
        struct aft_law *a = &w->law[l];
        int inputs = a->law->kind->inputs;

        if (aft_make_slopes(w, a, NULL) != MODAL_OK)
            continue;

        for (int s = 0; a->exact && s < a->pieces.count; s++)
            for (int j = 0; j < inputs; j++)
                most = fmax(most, fabs(a->pieces.piece[s].gain[j]));
        for (int n = 0; !a->exact && n < inputs * inputs * w->N; n++)
            most = fmax(most, fabs(a->fd[n]));
    }
    return most;
}
