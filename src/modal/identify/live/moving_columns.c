/*
 * moving_columns.c - exponentials on compressed rows
 *
 * A block's columns are those of any other times a power of z.  With u = l - (length - 1) / 2 the
 * place in the block, h its largest value and lambda_a an anchor,
 *
 *     Q^T u^m e^{lambda u} = h^m sum_{i < TERMS} ((lambda - lambda_a) h)^i / i!  P_{i+m},
 *     P_i = Q^T (u/h)^i e^{lambda_a u},                                                         (1)
 *
 * up to NEAR^TERMS / TERMS! < 1e-15 of the column where |lambda - lambda_a| h <= NEAR (lambda per
 * step): P is found once for an anchor, and a column then costs k numbers, not length x k.  Further
 * from every anchor the left side is multiplied out.  Each e^{lambda u} stands over e^{|Re lambda|
 * h}, so that nothing overflows.
 */
#include "modal/identify/live/moving_columns.h"
#include <cblas.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include "modal/identify/linear/exponents.h"
#include "modal/identify/linear/powers.h"

enum { POWERS = 16 };                               /* a table's */
enum { TERMS = 8, KEPT = TERMS + MOVING_MOMENTS - 1 };       /* of (1); P_i that they need */
static const double NEAR = 0.05;    /* (1) is then cut below 1e-15 */

int moving_rows_count(const struct moving_rows *r)
{
    return r->lead + r->blocks * r->k + r->trail;
}

int moving_rows_samples(const struct moving_rows *r)
{
    return r->lead + r->blocks * r->length + r->trail;
}

/* z = e^{a + ib}, a step's multiplier, over e^reference. */
struct power { double a, b, reference; };

/* z^l over the reference. */
static double complex power(const struct power *p, double l)
{
    /* b l is high + low exactly */
    double high = p->b * l, low = fma(p->b, l, -high), e = exp(p->a * l - p->reference), s, c;

    s = sin(high), c = cos(high);
    /* cos and sin of the sum, to first order in low */
    return CMPLX(e * (c - low * s), e * (s + low * c));
}

struct table { double re[POWERS], im[POWERS]; };    /* z^0 .. */

static void fill_table(const struct power *p, struct table *t)
{
    struct power own = { p->a, p->b, 0 };

    for (int i = 0; i < POWERS; i++) {
        double complex z = power(&own, i);
        t->re[i] = creal(z), t->im[i] = cimag(z);
    }
}

/* z^l over the reference, and minus its imaginary part, for l = first .. first + count - 1: every
 * POWERS-th exactly, times the table. */
static void powers(const struct power *p, const struct table *t, double first, int count,
                   double *re, double *im)
{
    for (int at = 0; at < count; at += POWERS) {
        double complex head = power(p, first + at);
        double x = creal(head), y = cimag(head);
        int n = count - at < POWERS ? count - at : POWERS;
        for (int i = 0; i < n; i++)
            /* columns are Re z^l and -Im z^l */
            re[at + i] = x * t->re[i] - y * t->im[i], im[at + i] = -(x * t->im[i] + y * t->re[i]);
    }
}

static void put_samples(const struct power *p, const struct table *t, int moments,
                        const struct moving_column *c, int row, int first, int count)
{
    powers(p, t, first, count, c->re[0] + row, c->im[0] + row);
    for (int m = 1; m < moments; m++)
        for (int i = 0; i < count; i++) {
            double s = first + i - c->centre;
            c->re[m][row + i] = s * c->re[m - 1][row + i],
                           c->im[m][row + i] = s * c->im[m - 1][row + i];
        }
}

/* ---- blocks ---- */

static double half_length(const struct moving_rows *r)
{
    return r->length > 1 ? 0.5 * (r->length - 1) : 0.5;
}

/* (u/h)^i e^{lambda u} over e^{|a| h}, i < count, as pairs of columns; scaled by h^i where RAISED.
 * */
static void moment_columns(const struct moving_rows *r, double a, double b, int count, bool raised,
                           double *x)
{
    double middle = 0.5 * (r->length - 1), h = half_length(r);
    struct power p = { a, b, fabs(a) * h };

    for (int l = 0; l < r->length; l++) {
        double complex z = power(&p, l - middle);
        double s = (l - middle) / (raised ? 1 : h), scale = 1;
        for (int i = 0; i < count; i++, scale *= s)
            x[l + 2 * i * r->length] = scale * creal(z),
                          x[l + (2 * i + 1) * r->length] = scale * cimag(z);
    }
}

enum modal_status moving_table(const struct moving_rows *r, double **table, struct modal_error *err)
{
    size_t n = (size_t)r->length, one = (size_t)(2 * KEPT * r->k);
    double *x = malloc(sizeof *x * (2 * KEPT * n + 1)),
           *P = malloc(sizeof *P * (one * (size_t)r->anchors + 1));

    if (x == NULL || P == NULL) {
        free(x), free(P);
        return modal_fail(err, MODAL_NO_MEMORY, "moving: no memory for a table of %d poles",
                          r->anchors);
    }
    for (int j = 0; j < r->anchors; j++) {
        moment_columns(r, creal(r->anchor[j]) * r->tau, cimag(r->anchor[j]) * r->tau, KEPT, false,
                       x);
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, r->k, 2 * KEPT, r->length, 1, r->Q,
                    r->length, x, r->length, 0, P + (size_t)j * one, r->k);
    }
    free(x);
    *table = P;
    return MODAL_OK;
}

size_t moving_columns_scratch(const struct moving_rows *r)
{
    int columns = 2 * MOVING_MOMENTS, more = r->length > 2 * KEPT ? r->length : 2 * KEPT;

    return (size_t)columns * (size_t)(r->k + more) + 1;
}

/* The nearest anchor; -1 where none is near. */
static int nearest(const struct moving_rows *r, double complex lambda)
{
    int best = -1;

    for (int j = 0; j < r->anchors; j++)
        if (best < 0 || cabs(lambda - r->anchor[j]) < cabs(lambda - r->anchor[best]))
            best = j;
    return best >= 0 && cabs(lambda - r->anchor[best]) * r->tau * half_length(r) <= NEAR ? best
                                                                                         : -1;
}

/* The coefficients of (1), 2 KEPT x 2 moments. */
static void coefficients(double complex step, double h, int moments, double *K)
{
    double complex term[TERMS] = { 1 };
    double raise = 1;

    for (int i = 1; i < TERMS; i++)
        /* e^x by its series, x at most NEAR: the first term left out is NEAR^8 / 8! = 1e-15 */
        term[i] = term[i - 1] * step / i;
    for (int i = 0; i < 2 * KEPT * 2 * moments; i++)
        K[i] = 0;
    for (int m = 0; m < moments; m++, raise *= h)
        for (int i = 0; i < TERMS; i++) {
            double *re = K + 2 * (i + m) + 2 * m * 2 * KEPT, *im = re + 2 * KEPT,
                   x = raise * creal(term[i]), y = raise * cimag(term[i]);
            re[0] = x, re[1] = -y, im[0] = y, im[1] = x;
        }
}

/* Q^T u^m e^{lambda u}, k x 2 moments, into E; the exponent of what they stand over. */
static double project(const struct moving_rows *r, double complex lambda, int moments, double *E)
{
    int k = r->k, columns = 2 * moments, j = nearest(r, lambda);
    double h = half_length(r), *x = E + k * columns;

    if (j >= 0) {
        coefficients((lambda - r->anchor[j]) * r->tau * h, h, moments, x);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, k, columns, 2 * KEPT, 1,
                    r->table + (size_t)j * (size_t)(2 * KEPT * k), k, x, 2 * KEPT, 0, E, k);
        return fabs(creal(r->anchor[j])) * r->tau * h;
    }
    moment_columns(r, creal(lambda) * r->tau, cimag(lambda) * r->tau, moments, true, x);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, k, columns, r->length, 1, r->Q, r->length,
                x, r->length, 0, E, k);
    return fabs(creal(lambda)) * r->tau * h;
}

/* Row by row head (E_0, E_1 + o E_0, E_2 + 2 o E_1 + o^2 E_0), o from the column's centre to the
 * block's middle. */
static void put_block(int k, int moments, const struct moving_column *c, int row,
                      double complex head, double o, const double *E)
{
    double x = creal(head), y = cimag(head);

    for (int m = 0; m < moments; m++) {
        /* (u + o)^m by the binomials */
        double w[MOVING_MOMENTS] = { m == 0 ? 1 : m == 1 ? o : o * o, m == 1 ? 1 : 2 * o, 1 };
        double *re = c->re[m] + row, *im = c->im[m] + row;
        for (int i = 0; i < k; i++) {
            double p = 0, q = 0;
            for (int n = 0; n <= m; n++)
                p += w[n] * E[i + 2 * n * k], q += w[n] * E[i + (2 * n + 1) * k];
            re[i] = x * p - y * q, im[i] = -(x * q + y * p);
        }
    }
}

double moving_reference(const struct moving_rows *r, double complex lambda)
{
    return fmax(creal(lambda), 0) * r->tau * (moving_rows_samples(r) - 1);
}

void moving_columns(const struct moving_rows *r, double complex lambda, int moments,
                    struct moving_column *c, double *scratch)
{
    int L = moving_rows_samples(r), after = r->lead + r->blocks * r->k;
    struct power p = { creal(lambda) * r->tau, cimag(lambda) * r->tau, 0 };
    double middle = 0.5 * (r->length - 1), over;
    struct table t;

    p.reference = c->reference = moving_reference(r, lambda);
    c->centre = powers_centre(p.a, L);
    if (r->lead + r->trail > 0)
        fill_table(&p, &t);
    if (r->lead > 0)
        put_samples(&p, &t, moments, c, 0, 0, r->lead);
    if (r->trail > 0)
        put_samples(&p, &t, moments, c, after, L - r->trail, r->trail);
    if (r->blocks == 0)
        return;
    over = project(r, lambda, moments, scratch);
    p.reference -= over;            /* what project() has divided by already */
    for (int j = 0; j < r->blocks; j++) {
        double at = r->lead + j * r->length + middle;
        put_block(r->k, moments, c, r->lead + j * r->k, power(&p, at), at - c->centre, scratch);
    }
}

void moving_basis(const struct moving_rows *r, const double complex *lambda, int count, double *Phi,
                  double *scratch)
{
    size_t n = (size_t)moving_rows_count(r);

    for (int i = 0; i < count; i++) {
        struct moving_column c = { .re = { Phi }, .im = { Phi + n } };
        moving_columns(r, lambda[i], 1, &c, scratch);
        Phi += n * (size_t)pole_order(lambda[i], r->tau);
    }
}
