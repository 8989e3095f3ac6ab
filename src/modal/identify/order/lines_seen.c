/*
 * lines_seen.c - lines of families whose exponents are known, without a fit of all of them
 *
 * Lines of two families lie as near to each other in every harmonic as their exponents do in one:
 * the nearest of family i to a line of j are lambda_i and its conjugate plus a multiple of i omega.
 * With G their inner products, and j last, the square of the last entry of Cholesky's factor is
 * what of j the others leave: n families cost n^4, whatever lines and rows there are.
 *
 * What E has of the line k of a family is
 *
 *     sum_l E_l e^{(conj lambda - i k omega) tau l}.                                            (1)
 *
 * All k together cost one pass of the rows: E_l e^{conj lambda tau l} is summed into PHASES bins of
 * the period for each harmonic there may be, and (1) is a Fourier sum of these.  A row is at most
 * half a bin from where it is taken, so that the highest harmonic loses (x / sin x)^2, x = pi /
 * (2 PHASES), and keeps 95 % of its chi-squared.
 */
#include "modal/identify/order/lines_seen.h"
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include "modal/identify/linear/powers.h"
#include "modal/identify/order/remainder.h"
#include "modal/linalg/workspace.h"

enum { PHASES = 4 };            /* bins a harmonic */

/* sum over l < L of e^{x l}, over what grows most of it. */
static double complex power_sum(double complex x, double grown, int L)
{
    double complex scale = 1, e;

    if (creal(x) > 0)
        scale = cexp(x * (L - 1)), x = -x;      /* from the last row back */
    e = powers_grown(x);
    return scale * exp(-grown * (L - 1)) * (e == 0 ? L : powers_grown(x * L) / e);
}

/* Im of the line of J, or of its CONJUGATE, that is nearest to one of Im AT. */
static double nearest(const struct heads *h, int j, bool conjugate, double at)
{
    double im = (conjugate ? -1 : 1) * cimag(h->head[j]);

    return im + nearbyint((at - im) / h->omega) * h->omega;
}

/* Its own conjugate is a line of the same family. */
static bool is_real(const struct heads *h, int j)
{
    double im = cimag(h->head[j]);

    return im == 0 || fabs(h->omega / 2 - im) <= REFINE_TIED * h->omega;
}

/* Per step, into Z: the nearest of all others to J's own, which is last.  Returns how many. */
static int neighbours(const struct heads *h, int j, double complex *z)
{
    int n = 0;
    double im = cimag(h->head[j]);

    for (int i = 0; i < h->count; i++)
        for (int c = 0; c < (is_real(h, i) ? 1 : 2) && i != j; c++)
            z[n++] = CMPLX(creal(h->head[i]), nearest(h, i, c == 1, im)) * h->tau;
    z[n++] = CMPLX(creal(h->head[j]), im) * h->tau;
    return n;
}

/* What of the last of N columns the others leave. */
static double unexplained(int n, int L, const double complex *z, double complex *G)
{
    double own;

    for (int j = 0; j < n; j++)
        for (int i = 0; i <= j; i++)
            G[i + j * n] = power_sum(conj(z[i]) + z[j],
                                     fmax(creal(z[i]), 0) + fmax(creal(z[j]), 0), L);
    own = creal(G[n * n - 1]);
    /* of those that the rows hardly tell apart the last may have no pivot left */
    return LAPACKE_zpotrf_work(LAPACK_COL_MAJOR, 'U', n, G, n) == 0
        ? creal(G[n * n - 1]) * creal(G[n * n - 1]) / own : 0;
}

enum modal_status lines_shares(const struct heads *h, double *share, struct modal_error *err)
{
    struct workspace space = { 0 };
    size_t most = 2 * (size_t)h->count;
    double complex *z = workspace_zeros(&space, most, sizeof *z),
                   *G = workspace_zeros(&space, most * most, sizeof *G);
    enum modal_status rc = MODAL_OK;

    if (space.failed)
        rc = modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d families", h->count);
    for (int j = 0; j < h->count && rc == MODAL_OK; j++) {
        int n = neighbours(h, j, z);
        share[j] = unexplained(n, h->L, z, G);
    }
    workspace_free(&space);
    return rc;
}

/* ---- (1) ---- */

struct bins {
    int count, most;            /* bins; harmonics are -most to most */
    double complex *z, *sum;    /* one a row; bins x signals */
    int *at;                    /* of each row: its bin */
    struct workspace space;
};

static enum modal_status bins_new(const struct heads *h, int S, struct bins *b,
                                  struct modal_error *err)
{
    *b = (struct bins) { .most = (int)(M_PI / h->tau / h->omega) + 1 };
    b->count = 2 * PHASES * b->most;
    b->z = workspace_zeros(&b->space, (size_t)h->L, sizeof *b->z);
    b->sum = workspace_zeros(&b->space, (size_t)b->count * (size_t)S, sizeof *b->sum);
    b->at = workspace_zeros(&b->space, (size_t)h->L, sizeof *b->at);
    if (b->space.failed)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d rows", h->L);
    for (int l = 0; l < h->L; l++) {
        double turn = l * h->tau * h->omega / (2 * M_PI);
        int at = (int)((turn - floor(turn)) * b->count);
        b->at[l] = at < b->count ? at : b->count - 1;
    }
    return MODAL_OK;
}

/* Family j's; returns the sum of squares of a line's column. */
static double fill_bins(const struct heads *h, int j, const struct matrix *E, struct bins *b)
{
    double a = creal(h->head[j]) * h->tau, w = cimag(h->head[j]) * h->tau, size2 = 0;

    for (int l = 0; l < h->L; l++) {
        b->z[l] = cexp(CMPLX(a * (l - (a > 0 ? h->L - 1 : 0)), -w * l));
        size2 += creal(b->z[l]) * creal(b->z[l]) + cimag(b->z[l]) * cimag(b->z[l]);
    }
    for (int s = 0; s < E->n; s++) {
        const double *e = E->x + (size_t)s * (size_t)E->ld;
        double complex *sum = b->sum + (size_t)s * (size_t)b->count;
        for (int p = 0; p < b->count; p++)
            sum[p] = 0;
        for (int l = 0; l < h->L; l++)
            sum[b->at[l]] += e[l] * b->z[l];
    }
    return size2;
}

/* Chi-squared of harmonic K's two columns, of so much square together. */
static double chi2_of(const struct bins *b, int k, int S, double size2)
{
    double complex step = cexp(CMPLX(0, -2 * M_PI * k / b->count));
    double chi2 = 0;

    for (int s = 0; s < S; s++) {
        double complex sum = 0;
        for (int p = b->count - 1; p >= 0; p--)
            sum = sum * step + b->sum[p + s * b->count];
        chi2 += 2 * (creal(sum) * creal(sum) + cimag(sum) * cimag(sum)) / size2;
    }
    return chi2;
}

static bool has_line(const struct lines *l, int count, int family, double im, double near)
{
    bool has = false;

    for (int i = 0; i < count && !has; i++)
        has = l->family[i] == family && fabs(cimag(l->lambda[i]) - im) < near;
    return has;
}

enum modal_status lines_seen(const struct heads *h, const struct matrix *E, double least,
                             const struct lines *all, struct lines *l, struct modal_error *err)
{
    struct bins b;
    int had = l->count;
    enum modal_status rc = bins_new(h, E->n, &b, err);

    for (int j = 0; j < h->count && rc == MODAL_OK; j++) {
        double size2 = fill_bins(h, j, E, &b);
        for (int i = 0; i < all->count; i++) {
            /* of a line that is a conjugate's the harmonic is that of the other way */
            double im = cimag(all->lambda[i]), up = (im - cimag(h->head[j])) / h->omega,
                   down = (im + cimag(h->head[j])) / h->omega;
            bool is_up = fabs(up - nearbyint(up)) <= fabs(down - nearbyint(down));
            int k = (int)nearbyint(is_up ? up : -down);
            if (all->family[i] != j || has_line(l, had, j, im, REFINE_TIED * h->omega)
                || !(chi2_of(&b, k, E->n, size2) > least))
                continue;
            l->family[l->count] = j;
            l->lambda[l->count++] = all->lambda[i];
        }
    }
    workspace_free(&b.space);
    return rc;
}

enum modal_status lines_beside(const struct matrix *E, double tau, const struct lines *l, int j,
                               double share, double least, double *pays, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    *pays = 0;
    for (int i = 0; i < l->count && rc == MODAL_OK; i++) {
        double chi2;
        if (l->family[i] != j)
            continue;
        rc = remainder_split(E, tau, l->lambda[i], true, &chi2, err);
        *pays += rc == MODAL_OK ? fmax(chi2 / share - least, 0) : 0;
    }
    return rc;
}
