/*
 * resonance.c - see resonance.h
 *
 * Every motion of period 2 pi / Omega has at each harmonic k
 *     Lambda_k X_k + sum_l a_l F_lk = P_k,      Lambda_k = K - (k Omega)^2 M + i k Omega C,
 * F_lk the coefficient of law l's force and a_l +1 on its dof, -1 on its `to`.  Where
 * v^H Lambda_k = 0,
 *     v^H P_k = sum_l v^H a_l F_lk.                                                             (1)
 * A force that never exceeds b has |F_lk| <= (2 / T) b int |cos| dt = 4 b / pi, and b where k = 0;
 * so that (1) cannot be met where |v^H P_k| exceeds the sum of |v^H a_l| times that, whatever the
 * motion.
 */
#include "modal/steady/resonance.h"
#include <complex.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <lapacke.h>
#include "modal/scene/program.h"

/* Lambda at frequency w; returns the largest term of an entry, the scale of its rounding. */
static double fill(const struct program *p, double w, double complex *Lambda)
{
    const double complex factor[3] = { -w * w, CMPLX(0, w), 1 };
    double size = 0;

    for (int t = 0; t < 3; t++)
        for (int i = 0; i < p->n; i++)
            for (int e = p->constant[t].start[i]; e < p->constant[t].start[i + 1]; e++) {
                /* -(k Omega)^2 M, i k Omega C, K */
                double complex term = factor[t] * p->constant[t].value[e];
                Lambda[i + p->constant[t].index[e] * p->n] += term;
                size = fmax(size, cabs(term));
            }
    return size;
}

/* v along input J of LAW. */
static double complex along(const struct law *law, int j, const double complex *v)
{
    double complex sum = 0;

    for (int e = law->start[j]; e < law->start[j + 1]; e++)
        sum += law->end[e].weight * v[law->end[e].dof];
    return sum;
}

/* The most that the laws can put against v; HUGE_VAL: no bound is known. */
static double held(const struct program *p, int k, const double complex *v)
{
    double most = 0;

    for (int l = 0; l < p->laws; l++) {
        const struct law *law = &p->law[l];
        for (int j = 0; j < law->kind->inputs; j++) {
            double reach = cabs(along(law, j, v));      /* |v^H a_l| */
            if (reach > 0 && law->limit == 0)           /* no bound on its force */
                return HUGE_VAL;
            most += (k > 0 ? 4 / M_PI : 1) * reach * law->limit;  /* 4 b / pi, or b */
        }
    }
    return most;
}

/* (1) for one v: the load along it is beyond what is held, and beyond what a v off by sqrt(eps)
 * makes of a load across it. */
static bool exceeds(const struct program *p, int k, const double complex *v)
{
    double complex work = 0;
    double size = 0;

    for (int i = 0; i < p->loads; i++)
        if (p->load[i].type == LOAD_HARMONIC && p->load[i].k == k) {
            double complex P = CMPLX(p->load[i].cosine, k > 0 ? -p->load[i].sine : 0);
            work += conj(v[p->load[i].dof]) * P;        /* v^H P_k */
            size += cabs(P);
        }
    return cabs(work) > held(p, k, v) + p->n * sqrt(DBL_EPSILON) * size;
}

/* (1) for every v of Lambda_k's null space, its left singular vectors of values that are
 * rounding. */
static bool unheld_at(const struct program *p, double omega, int k)
{
    int n = p->n;
    double complex *Lambda = calloc((size_t)n * (size_t)n, sizeof *Lambda);
    double complex *U = malloc((size_t)n * (size_t)n * sizeof *U);
    double *s = malloc((size_t)n * sizeof *s), *rest = malloc((size_t)n * sizeof *rest);
    bool found = false;

    if (Lambda != NULL && U != NULL && s != NULL && rest != NULL) {
        double rounding = n * DBL_EPSILON * fill(p, k * omega, Lambda);

        if (LAPACKE_zgesvd(LAPACK_COL_MAJOR, 'A', 'N', n, n, Lambda, n, s, U, n, NULL, 1, rest)
            == 0)
            for (int i = n - 1; i >= 0 && s[i] <= rounding && !found; i--)
                found = exceeds(p, k, U + (size_t)i * (size_t)n);
    }
    free(Lambda);
    free(U);
    free(s);
    free(rest);
    return found;
}

/* The first load of its harmonic: each is looked at once. */
static bool first_of_its_harmonic(const struct program *p, int i)
{
    for (int j = 0; j < i; j++)
        if (p->load[j].type == LOAD_HARMONIC && p->load[j].k == p->load[i].k)
            return false;
    return p->load[i].type == LOAD_HARMONIC;
}

bool resonance_unheld(const struct program *p, double omega, int *harmonic)
{
    if (p->n > RESONANCE_DOFS_MOST || p->n_linear > 0 || p->harmonics > 0)
        return false;
    for (int i = 0; i < p->loads; i++)
        if (p->load[i].dof_sine >= 0)
            return false;
    for (int i = 0; i < p->loads; i++)
        if (first_of_its_harmonic(p, i) && unheld_at(p, omega, p->load[i].k)) {
            *harmonic = p->load[i].k;
            return true;
        }
    return false;
}
