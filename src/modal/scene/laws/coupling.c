/*
 * coupling.c - forces that are polynomials of several displacements
 *
 *     f_i = sum over the terms on input i of c prod_j d_j^(n_j)               (1)
 *
 * with n_j whole.  Of total degree p the force is sampled without aliasing once N > (p + 1) H.  (1)
 * need not come from a potential: each term acts where it says.
 */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/law.h"

struct coupling {
    int count;
    struct law_term term[];
};

/* d^n */
static double power(double d, int n)
{
    double p = 1;

    for (; n > 0; n--)
        p *= d;
    return p;
}

/* (1) and its derivatives: of d_j's power times the others as they are. */
static enum modal_status coupling_force(const struct law *law, const struct law_point *at,
                                        struct law_force *out, struct modal_error *err)
{
    const struct coupling *c = law->data;
    int inputs = law->kind->inputs;

    (void)err;
    memset(out, 0, offsetof(struct law_force, memory));
    for (int t = 0; t < c->count; t++) {
        const struct law_term *term = &c->term[t];
        double whole = term->coefficient;

        for (int j = 0; j < inputs; j++) {
            double slope = term->coefficient;

            whole *= power(at->d[j], term->power[j]);
            if (term->power[j] == 0)
                continue;
            for (int k = 0; k < inputs; k++)
                slope *= k != j ? power(at->d[k], term->power[k])
                                : term->power[j] * power(at->d[j], term->power[j] - 1);
            out->fd[term->on][j] += slope;
        }
        out->f[term->on] += whole;
    }
    out->acts = true;
    out->regime = 0;
    return MODAL_OK;
}

/* One for each number of inputs, from 1. */
#define OF_INPUTS(n) \
    { .name = "polynomial_coupling", .inputs = n, .smooth = true, .force = coupling_force }
static const struct law_class coupling_class[LAW_INPUTS_MOST] = {
    OF_INPUTS(1), OF_INPUTS(2), OF_INPUTS(3), OF_INPUTS(4)
};

enum modal_status law_coupling(const struct law_term *term, int count, int inputs, struct law *out,
                               struct modal_error *err)
{
    struct coupling *c = malloc(sizeof *c + (size_t)count * sizeof *term);

    if (c == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "polynomial_coupling: no memory for %d terms",
                          count);
    c->count = count;
    memcpy(c->term, term, (size_t)count * sizeof *term);
    law_clear(out, &coupling_class[inputs - 1]);
    out->data = c;
    for (int t = 0; t < count; t++) {
        int degree = 0;
        for (int j = 0; j < inputs; j++)
            degree += term[t].power[j];
        out->degree = degree > out->degree ? degree : out->degree;
    }
    return MODAL_OK;
}
