/*
 * polynomial.c - springs and dampers that are polynomials
 *
 *     spring   f = sum_i c_i d^(i+1)                                          (1)
 *     damper   f = sum_i c_i d^i v                                            (2)
 *
 * Both are s(d) w with s(d) = sum_i c_i d^i and w = d or v, evaluated by Horner's rule with its
 * derivative.  Of degree `count`, they are sampled without aliasing once N > (count + 1) H.
 */
#include <stdlib.h>
#include <string.h>
#include "modal/scene/law.h"

struct polynomial {
    int count;
    double c[];  /* of s(d), ascending */
};

/* s and s' at d */
static void horner(const struct polynomial *p, double d, double *s, double *slope)
{
    *s = *slope = 0;
    for (int i = p->count - 1; i >= 0; i--) {
        *slope = *slope * d + *s;  /* before s: it needs the last s */
        *s = *s * d + p->c[i];  /* Horner */
    }
}

/* s at d, to the same digits */
static double value(const struct polynomial *p, double d)
{
    double s = 0;

    for (int i = p->count - 1; i >= 0; i--)
        s = s * d + p->c[i];
    return s;
}

/* (1) and (2) by themselves. */
static double spring_alone(const struct law *law, double d, double v)
{
    (void)v;
    return value(law->data, d) * d;
}

static double damper_alone(const struct law *law, double d, double v)
{
    return value(law->data, d) * v;
}

/* (1) = s(d) d, so df/dd = s + s' d. */
static enum modal_status spring_force(const struct law *law, const struct law_point *at,
                                      struct law_force *out, struct modal_error *err)
{
    double s, slope;

    (void)err;
    horner(law->data, at->d[0], &s, &slope);
    out->f[0] = s * at->d[0];                                   /* (1) */
    out->fd[0][0] = s + slope * at->d[0];
    out->fv[0][0] = 0;
    out->acts = true;
    out->regime = 0;
    return MODAL_OK;
}

/* (2) = s(d) v, so df/dd = s' v, df/dv = s. */
static enum modal_status damper_force(const struct law *law, const struct law_point *at,
                                      struct law_force *out, struct modal_error *err)
{
    double s, slope;

    (void)err;
    horner(law->data, at->d[0], &s, &slope);
    out->f[0] = s * at->v[0];                                   /* (2) */
    out->fd[0][0] = slope * at->v[0];
    out->fv[0][0] = s;
    out->acts = true;
    out->regime = 0;
    return MODAL_OK;
}

static const struct law_class spring_class = {
    .name = "polynomial_spring", .inputs = 1, .smooth = true, .force = spring_force,
    .alone = spring_alone
};
static const struct law_class damper_class = { .name = "polynomial_damper",
                                               .inputs = 1,
                                               .smooth = true,
                                               .reads_velocity = true,
                                               .force = damper_force,
                                               .alone = damper_alone };

/* Coefficients are copied; the degree bounds the harmonics that f of a polynomial motion
 * reaches. */
static enum modal_status polynomial_new(const struct law_class *kind, const double *c, int count,
                                        struct law *out, struct modal_error *err)
{
    struct polynomial *p;

    if (count < 1 || count > LAW_TERMS_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "coefficients",
                                "%d coefficients; accepted: 1 to %d", count, LAW_TERMS_MOST);
    for (int i = 0; i < count; i++)
        if (law_check("coefficients", c[i], -1e300, err) != MODAL_OK)
            return MODAL_BAD_INPUT;
    p = malloc(sizeof *p + (size_t)count * sizeof *c);
    if (p == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "polynomial: no memory for %d coefficients", count);
    p->count = count;
    memcpy(p->c, c, (size_t)count * sizeof *c);
    law_clear(out, kind);
    out->data = p;
    out->degree = count;  /* of s(d) w: see the opening */
    return MODAL_OK;
}

enum modal_status law_polynomial_spring(const double *c, int count, struct law *out,
                                        struct modal_error *err)
{
    return polynomial_new(&spring_class, c, count, out, err);
}

enum modal_status law_polynomial_damper(const double *c, int count, struct law *out,
                                        struct modal_error *err)
{
    return polynomial_new(&damper_class, c, count, out, err);
}
