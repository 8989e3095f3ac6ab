/*
 * offset.c - see offset.h
 *
 * With C the still sliders, U_C their forces and D_C y their relative displacements, slider l of
 * them moved by 1 moves the state and the forces that hold by the solution of
 *
 *     [A  U_C; D_C  0] (dy; dphi) = (0; e_l).                                                   (1)
 *
 * Sliders are moved in turn, each to zero or until one of C has no strength left, until none moves:
 * a cyclic descent of sum d_l^2 in a box of forces, whose end is the least such sum where one
 * slider alone is still.
 */
#include "modal/steady/offset.h"
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/matrix.h"
#include "modal/numbers.h"
#include "modal/scene/ports.h"

enum {
    ROUNDS = 40,             /* of the descent: one slider alone needs one */
    MOST = OFFSET_LAWS_MOST
};
/* Of the largest displacement: a slider that moves by less is still, to the stepper's tolerance and
 * a hundred more. */
static const double STILL = 1e-10;

/* The sliders that are still: the set C. */
struct held {
    int count, law[MOST];
    double d[MOST], low[MOST], high[MOST];       /* where each is, the least and the most that it
                                                  * holds */
    double moved[MOST];                                 /* how far, in all */
    double *shift;                               /* (1): columns of N + count */
};

/* The relative displacement of law L at sample J. */
static double at(const struct ports *p, const struct offset_motion *m, int l, int j)
{
    const struct law *law = p->law[l].law;
    double sum = 0;

    for (int e = 0; e < law->start[1]; e++)
        sum += law->end[e].weight
               * m->x[(size_t)law->end[e].dof * (size_t)m->samples + (size_t)j];
    return sum;
}

/* Which sliders are still, where, and the least and the most that each holds. */
static void find_held(const struct ports *p, const struct offset_motion *m, int n, struct held *h)
{
    double size = numbers_largest(m->x, (size_t)n * (size_t)m->samples);

    for (int l = 0; l < p->laws; l++) {
        const double *f = m->force + (size_t)l * (size_t)m->samples;
        double least = HUGE_VAL, most = -HUGE_VAL, low = HUGE_VAL, high = -HUGE_VAL;

        for (int j = 0; j < m->samples; j++) {
            least = fmin(least, at(p, m, l, j));
            most = fmax(most, at(p, m, l, j));
            low = fmin(low, f[j]);
            high = fmax(high, f[j]);
        }
        m->still[l] = most - least <= STILL * size;
        if (!m->still[l])
            continue;
        h->law[h->count] = l;
        h->d[h->count] = (least + most) / 2;
        h->low[h->count] = low;
        h->high[h->count++] = high;
    }
}

/* (1), rows and columns scaled to units of 1; false: singular. */
static bool static_shifts(const struct statespace *ss, const struct ports *p, struct held *h,
                          double *K, int *pivot)
{
    int N = ss->N, c = h->count, size = N + c, r = 2 * p->probes;

    memset(K, 0, (size_t)size * (size_t)size * sizeof *K);
    memset(h->shift, 0, (size_t)size * (size_t)c * sizeof *h->shift);
    matrix_copy(N, N, ss->A, N, K, size);
    for (int i = 0; i < c; i++) {
        int channel = p->law[h->law[i]].channel;
        const double *U = p->U + (size_t)channel * (size_t)N, *D = p->R + channel;
        double strength = numbers_largest(U, (size_t)N), reach = 0;

        for (int j = 0; j < N; j++)
            reach = fmax(reach, fabs(D[(size_t)j * (size_t)r]));
        for (int j = 0; j < N; j++) {
            /* U_C, a unit of force 1 */
            K[(size_t)j + (size_t)(N + i) * (size_t)size] = U[j] / strength;
            /* D_C */
            K[(size_t)(N + i) + (size_t)j * (size_t)size] = D[(size_t)j * (size_t)r] / reach;
        }
        /* e_l, in the row's scale */
        h->shift[(size_t)(N + i) + (size_t)i * (size_t)size] = 1 / reach;
    }
    if (LAPACKE_dgesv_work(LAPACK_COL_MAJOR, size, c, K, size, pivot, h->shift, size) != 0)
        return false;
    for (int i = 0; i < c; i++)
        for (int l = 0; l < c; l++)
            h->shift[(size_t)(N + i) + (size_t)l * (size_t)size] /=
                numbers_largest(p->U + (size_t)p->law[h->law[i]].channel * (size_t)N, (size_t)N);
    return isfinite(numbers_largest(h->shift, (size_t)size * (size_t)c));
}

/* How far slider I may go towards WANTED with every force within its limit: a force beyond it by
 * rounding goes no further. */
static double allowed(const struct ports *p, const struct held *h, int N, int i, double wanted)
{
    const double *holds = h->shift + (size_t)i * (size_t)(N + h->count) + N;

    for (int k = 0; k < h->count; k++) {
        double limit = p->law[h->law[k]].law->limit, change = holds[k] * wanted;
        /* to its limit on that side */
        double room = change > 0 ? limit - h->high[k] : limit + h->low[k];

        if (fabs(change) > fmax(room, 0))
            wanted *= fmax(room, 0) / fabs(change);     /* forces are linear in the shift */
    }
    return wanted;
}

/* The cyclic descent: each slider to zero, as far as all forces allow. */
static void descend(const struct ports *p, struct held *h, int N)
{
    for (int round = 0; round < ROUNDS; round++)
        for (int i = 0; i < h->count; i++) {
            double step = allowed(p, h, N, i, -h->d[i]);  /* all the way to zero, or less */

            h->d[i] += step;                             /* nearer to zero */
            h->moved[i] += step;
            for (int k = 0; k < h->count; k++) {
                double change =
                    h->shift[(size_t)(N + k) + (size_t)i * (size_t)(N + h->count)] * step;

                h->low[k] += change;
                h->high[k] += change;
            }
        }
}

/* x_j += value. */
static void add_to_all(double *x, int count, double value)
{
    for (int j = 0; j < count; j++)
        x[j] += value;
}

/* The motion with slider I moved. */
static void move(const struct statespace *ss, const struct held *h, int i, struct offset_motion *m,
                 double *x)
{
    const double *shift = h->shift + (size_t)i * (size_t)(ss->N + h->count);

    statespace_motion(ss, shift, x);
    for (int k = 0; k < ss->n; k++)
        add_to_all(m->x + (size_t)k * (size_t)m->samples, m->samples, h->moved[i] * x[k]);
    for (int k = 0; k < h->count; k++)
        add_to_all(m->force + (size_t)h->law[k] * (size_t)m->samples, m->samples,
                   h->moved[i] * shift[ss->N + k]);
}

enum modal_status offset_remove(const struct statespace *ss, const struct ports *ports,
                                struct offset_motion *motion, struct modal_error *err)
{
    struct held h = { 0 };
    size_t most = (size_t)ss->N + (size_t)ports->laws;
    double *K = malloc((most * most + 1) * sizeof *K), *x = malloc(((size_t)ss->n + 1) * sizeof *x);
    int *pivot = malloc((most + 1) * sizeof *pivot);

    h.shift = malloc((most * (size_t)ports->laws + 1) * sizeof *h.shift);
    if (K != NULL && x != NULL && pivot != NULL && h.shift != NULL) {
        find_held(ports, motion, ss->n, &h);
        /* Where (1) is singular nothing fixes the structure: it is left alone. */
        if (h.count > 0 && static_shifts(ss, ports, &h, K, pivot)) {
            descend(ports, &h, ss->N);
            for (int i = 0; i < h.count; i++)
                move(ss, &h, i, motion, x);
        }
    }
    bool failed = K == NULL || x == NULL || pivot == NULL || h.shift == NULL;
    free(K);
    free(x);
    free(pivot);
    free(h.shift);
    return failed ? modal_fail(err, MODAL_NO_MEMORY, "offset: no memory") : MODAL_OK;
}
