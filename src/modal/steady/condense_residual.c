/*
 * condense_residual.c - what is left of the balance of the dofs that condense.c eliminated, from
 * the entries of M, C, K and the linear states themselves: neither a factor nor a basis is trusted
 *
 * With the motion X_k of all dofs, kept and recovered, and z_k of the linear states,
 *
 *     R_k = Lambda_k X_k - F z_k - P_k,     Lambda_k = K + i s C - s^2 M,  s = k omega,        (5)
 *     r_k = (i s E - A) z_k - (Bx + i s Bv - s^2 Ba) X_k.                                      (6)
 *
 * Nothing here knows of laws: where none acts, R_k is the error of the answer, whatever way the
 * elimination went.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"
#include "modal/steady/condense_state.h"
#include "modal/steady/pattern.h"

/* The unknowns of harmonic k: dofs, then linear states; with sparse factors c->right has what they
 * are made of. */
static void unknowns_at(const struct condense *c, int k, const double complex *Xq,
                        double complex *x)
{
    size_t order = (size_t)c->order;
    const double complex *Y = c->sparse ? c->right
        : c->order > 0 ? c->kept_right + (size_t)k * order * ((size_t)c->q + 1) : NULL;

    for (int i = 0; i < c->n + c->p->n_linear; i++) {
        int row = i < c->n ? c->spot[i] : c->r + i - c->n;

        if (row < 0) {
            x[i] = Xq[c->place[i] * (c->H + 1) + k];
            continue;
        }
        x[i] = Y[(size_t)c->q * order + (size_t)row];   /* as in recovery, linear states too */
        for (int j = 0; j < c->q; j++)
            x[i] -= Y[(size_t)j * order + (size_t)row] * Xq[j * (c->H + 1) + k];
    }
}

/* y += by A x, row by row. */
static void multiply_add(const struct sparse *a, double complex by, const double complex *x,
                         double complex *y)
{
    for (int i = 0; a->start != NULL && i < a->m; i++)
        for (int e = a->start[i]; e < a->start[i + 1]; e++)
            y[i] += by * a->value[e] * x[a->index[e]];
}

/* Lambda x - F z of (5), its rows of dofs. */
static void forces_of(const struct condense *c, double s, const double complex *x,
                      double complex *y)
{
    for (int t = 0; t < 3; t++)
        multiply_add(&c->p->constant[t], factor_of(t, s), x, y);
    if (c->p->n_linear > 0)
        multiply_add(&c->p->F, -1, x + c->n, y);        /* - F z */
}

/* r of (6), relative to (i s E - A) z: states may be of any unit, and their rows of any size. */
static double states_residual(const struct condense *c, double s, const double complex *x,
                              double complex *y)
{
    const struct program *p = c->p;
    double scale;

    multiply_add(&p->E, I * s, x + c->n, y);
    multiply_add(&p->A, -1, x + c->n, y);
    scale = numbers_modulus(y, (size_t)p->n_linear);    /* before what drives z is subtracted */
    multiply_add(&p->Bx, -1, x, y);
    multiply_add(&p->Bv, -I * s, x, y);
    multiply_add(&p->Ba, s * s, x, y);
    return scale > 0 ? numbers_modulus(y, (size_t)p->n_linear) / scale : 0;
}

/* One harmonic's part in OUT; peak[0..n-1] and peak[n..2n-1] sum |R| and |P| over harmonics. */
static void add_residual(const struct condense *c, int k, const double complex *x,
                         double complex *R, double complex *P, double *peak,
                         struct condense_residual *out)
{
    size_t n = (size_t)c->n;

    forces_of(c, k * c->omega, x, R);
    for (int l = 0; l < c->loads; l++)
        if (c->load[l].k == k)
            P[c->load[l].dof] += c->level * c->load[l].value;
    out->scale = fmax(out->scale, fmax(numbers_modulus(P, n), numbers_modulus(R, n)));
    for (size_t i = 0; i < n; i++) {
        double size = cabs(R[i] -= P[i]);               /* Lambda X - P */

        out->rms += size * size / (k == 0 ? 1 : 2);     /* a harmonic's mean square is half */
        peak[i] += size;                                /* at most, over time */
        peak[n + i] += cabs(P[i]);
    }
    out->relative = fmax(out->relative, numbers_modulus(R, n));
}

enum modal_status condense_residual(struct condense *c, const double complex *Xq,
                                    struct condense_residual *out, struct modal_error *err)
{
    size_t all = (size_t)c->n + (size_t)c->p->n_linear;
    double complex *x = calloc(3 * all + 1, sizeof *x);
    size_t q = (size_t)c->q, entries = (size_t)pattern_entries(c->pattern);
    double complex *S = calloc(entries + q + 1, sizeof *S);    /* not asked for */
    double *peak = calloc(2 * (size_t)c->n + 1, sizeof *peak), states = 0;
    enum modal_status rc =
        x == NULL || peak == NULL || S == NULL
            ? modal_fail(err, MODAL_NO_MEMORY, "condense: no memory for a residual")
            : MODAL_OK;

    memset(out, 0, sizeof *out);
    if (rc == MODAL_OK && !c->solved && c->order > 0)
        rc = condense_solve_for_recovery(c, err);
    for (int k = 0; rc == MODAL_OK && k <= c->H; k++) {
        /* only the last harmonic factored is in c->right: each is made anew */
        if (c->sparse
            && (rc = condense_factor_at(c, k, k * c->omega, S, S + entries, err)) != MODAL_OK)
            break;
        unknowns_at(c, k, Xq, x);
        memset(x + all, 0, 2 * all * sizeof *x);        /* R_k and P_k of (5), or r_k of (6) */
        add_residual(c, k, x, x + all, x + 2 * all, peak, out);
        if (c->p->n_linear > 0)
            states = fmax(states, states_residual(c, k * c->omega, x, x + all + c->n));
    }
    for (int i = 0; rc == MODAL_OK && i < c->n; i++) {
        out->most = fmax(out->most, peak[i]);
        out->load = fmax(out->load, peak[c->n + i]);
    }
    /* Linear states have units of their own: they are compared by themselves. */
    out->rms = sqrt(out->rms);
    out->relative = fmax(out->scale > 0 ? out->relative / out->scale : 0, states);
    free(S);
    free(x);
    free(peak);
    return rc;
}
