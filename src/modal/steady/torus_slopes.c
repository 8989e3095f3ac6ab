/*
 * torus_slopes.c - what the laws' forces gain with a motion: their slopes over the torus; tested by
 * tests/unit/modal/steady/test_torus.c
 *
 * With G_k the two-sided coefficients of df/dd, a force gains at combination k of dX_l
 * G_{k-l} dX_l + G_{k+l} conj(dX_l); a rate is i Omega_l dX_l.
 */
#include "modal/steady/torus_laws_state.h"

/* The block of one dof pair, in torus_laws.h's order, times WEIGHT. */
static void add_gain(const struct torus_laws *w, const struct torus_grid *g, bool rate,
                     double weight, int row, int column, int core, const struct torus_index *index,
                     double *J)
{
    size_t n = (size_t)(2 * core - 1), order = (size_t)w->q * n;

    for (int c = 0; c < core; c++)
        for (int r = 0; r < core; r++) {
            struct torus_index less = index[r], more = index[r];
            double complex turn = rate ? I * torus_frequency(&w->tones, index[c]) : 1, G, H, re, im;
            double *to = J + (size_t)row * n + ((size_t)column * n) * order;

            for (int j = 0; j < TORUS_TONES_MOST; j++)
                less.k[j] -= index[c].k[j], more.k[j] += index[c].k[j];
            G = weight * turn * torus_coefficient(g, less);
            H = weight * conj(turn) * torus_coefficient(g, more);
            if (c == 0)
                H = 0;
            if (r == 0)                                    /* F_0 = Re(conj(G_l) dX_l) */
                G /= c == 0 ? 1 : 2, H /= 2;
            else if (c == 0)
                G *= 2;
            re = G + H, im = I * (G - H);
            if (r == 0) {
                to[(c == 0 ? 0 : (size_t)(2 * c - 1)) * order] += creal(re);
                if (c > 0)
                    to[(size_t)(2 * c) * order] += creal(im);
                continue;
            }
            to += (c == 0 ? 0 : (size_t)(2 * c - 1)) * order + (size_t)(2 * r - 1);
            to[0] += creal(re), to[1] += cimag(re);
            if (c > 0)
                to[order] += creal(im), to[order + 1] += cimag(im);
        }
}

void torus_derivative(const struct torus_laws *w, struct torus_grid *g, int core,
                      const struct torus_index *index, double *J)
{
    for (int l = 0; l < w->laws; l++) {
        const struct torus_law *a = &w->law[l];
        int inputs = a->law->kind->inputs;

        for (int s = 0; s < (a->law->kind->reads_velocity ? 2 : 1) * inputs * inputs; s++) {
            bool rate = s >= inputs * inputs;
            int i = s % (inputs * inputs) / inputs, j = s % inputs;

            torus_analyze(g, a->slopes + (size_t)s * w->points);
            for (int r = a->law->start[i]; r < a->law->start[i + 1]; r++)
                for (int c = a->law->start[j]; c < a->law->start[j + 1]; c++)
                    add_gain(w, g, rate, a->law->end[r].weight * a->law->end[c].weight,
                             a->place[r], a->place[c], core, index, J);
        }
    }
}

void torus_mean_slopes(const struct torus_laws *w, double *K, double *C)
{
    for (int l = 0; l < w->laws; l++) {
        const struct law *law = w->law[l].law;
        int inputs = law->kind->inputs;

        for (int s = 0; s < (law->kind->reads_velocity ? 2 : 1) * inputs * inputs; s++) {
            const double *slope = w->law[l].slopes + (size_t)s * w->points;
            double *to = s < inputs * inputs ? K : C, mean = 0;
            int i = s % (inputs * inputs) / inputs, j = s % inputs;

            for (size_t n = 0; n < w->points; n++)
                mean += slope[n] / (double)w->points;
            for (int r = law->start[i]; r < law->start[i + 1]; r++)
                for (int c = law->start[j]; c < law->start[j + 1]; c++)
                    to[w->law[l].place[c] * w->q + w->law[l].place[r]] +=
                        law->end[r].weight * law->end[c].weight * mean;
        }
    }
}
