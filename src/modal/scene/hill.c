/*
 * hill.c - see hill.h
 *
 * A Floquet mode is e^(lambda t) sum_k u_k e^(i k W t), W = 2 pi / T.  With A(t) = sum_m A_m e^(i m
 * W t), y' = A y asks
 *
 *     lambda u_k = sum_m A_(k-m) u_m - i k W u_k,    k = -H .. H,                               (1)
 *
 * an eigenproblem of (2 H + 1) N: each exponent appears as lambda + i k W for every k, and those at
 * the rim are spoilt by the cut.  Of each family we take the member whose u is centred best, i.e.
 * with the least sum_k |k| |u_k|^2 / sum_k |u_k|^2: the N best centred of all, no two of which are
 * translates of each other with the same vector (moved by one block).
 */
#include "modal/scene/hill.h"
#include <lapacke.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/statespace.h"

static const double ON_EDGE = 1e-9;      /* of the strip: rounding decides no side of it */
static const double SAME_MODE = 0.9;     /* overlap: translates have 1, others nearly 0 */

/* truncation, of the exponents' strip 2 pi / T, that ends the growth of H */
static const double ENOUGH = 1e-10;

/* of W: copies of one exponent, spoilt by the cut, lie no further apart; the vectors decide */
static const double TRANSLATE = 1e-3;

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "hill: out of memory");
}

/* (1), column-major. */
static void assemble(const struct statespace *ss, double period, int H, double complex *Z)
{
    int N = ss->N;
    size_t size = (size_t)N * (size_t)(2 * H + 1);
    double W = 2 * M_PI / period;  /* of (1) */

    memset(Z, 0, size * size * sizeof *Z);
    for (int k = -H; k <= H; k++)
        for (int j = 0; j < N; j++) {
            double complex *column = Z + ((size_t)(k + H) * (size_t)N + (size_t)j) * size;
            for (int i = 0; i < N; i++)
                column[(size_t)(k + H) * (size_t)N + (size_t)i] += ss->A[i + (size_t)j * (size_t)N];
            column[(size_t)(k + H) * (size_t)N + (size_t)j] -= I * (k * W);  /* -i k W u_k of (1) */
            for (int h = 0; h < ss->harmonics; h++) {
                int m = (int)lround(ss->harmonic[h].k * ss->p->omega * period / (2 * M_PI));
                for (int sign = -1; sign <= 1; sign += 2) {
                    int row = k + sign * m;  /* A_(row - k): both signs of a real harmonic */
                    if (row < -H || row > H)
                        continue;
                    for (int i = 0; i < N; i++) {        /* cos = (e + e*)/2, sin = (e - e*)/2i */
                        size_t at = i + (size_t)j * (size_t)N;
                        column[(size_t)(row + H) * (size_t)N + (size_t)i] +=
                            (ss->harmonic[h].cosine[at] - I * sign * ss->harmonic[h].sine[at]) / 2;
                    }
                }
            }
        }
}

struct candidate { double complex value; double spread; int index; };

/* For qsort: the best centred candidates first. */
static int by_spread(const void *a, const void *b)
{
    const struct candidate *x = a, *y = b;

    return x->spread != y->spread ? (x->spread > y->spread) - (x->spread < y->spread)
                                  : (x->index > y->index) - (x->index < y->index);
}

/* For qsort: descending real part, as hill.h has it. */
static int by_value(const void *a, const void *b)
{
    double complex x = *(const double complex *)a, y = *(const double complex *)b;

    if (creal(x) != creal(y))
        return creal(x) < creal(y) ? 1 : -1;
    return (cimag(x) < cimag(y)) - (cimag(x) > cimag(y));
}

/* How far a vector's harmonics lie from 0 in the mean: of the 2 H + 1 copies of an exponent
 * the one centred best is cut least. */
static double spread(const double complex *u, int N, int H)
{
    double sum = 0, moment = 0;

    for (int k = -H; k <= H; k++)
        for (int i = 0; i < N; i++) {
            double x = cabs(u[(size_t)(k + H) * (size_t)N + (size_t)i]);
            sum += x * x;
            moment += abs(k) * x * x;  /* sum |k| |u_k|^2 */
        }
    return moment / sum;
}

/* |<u moved by SHIFT blocks, v>| / (|u| |v|): near 1 where v is u's translate. */
static double overlap(const double complex *u, const double complex *v, int N, int H, int shift)
{
    double complex product = 0;
    double uu = 0, vv = 0;

    for (int k = -H; k <= H; k++)
        for (int i = 0; i < N; i++) {
            double complex b = v[(size_t)(k + H) * (size_t)N + (size_t)i];
            vv += creal(b * conj(b));
            if (k - shift < -H || k - shift > H)
                continue;
            double complex a = u[(size_t)(k - shift + H) * (size_t)N + (size_t)i];
            uu += creal(a * conj(a));
            product += conj(a) * b;
        }
    return uu > 0 ? cabs(product) / sqrt(uu * vv) : 0;
}

/* Im moved by whole W into (-W/2, W/2]. */
static double complex principal(double complex lambda, double W)
{
    double k = round(cimag(lambda) / W);
    double complex value = CMPLX(creal(lambda), cimag(lambda) - k * W);

    return cimag(value) <= -W / 2 * (1 - ON_EDGE) ? value + I * W : value;
}

/* The N best centred eigenvalues of COUNT, no translates, as principal values. */
static void choose(struct candidate *c, size_t count, const double complex *V, int N, int H,
                   double W, double complex *out)
{
    int found = 0;                       /* those chosen stand first in c */

    qsort(c, count, sizeof *c, by_spread);
    for (size_t i = 0; i < count && found < N; i++) {
        bool again = false;
        for (int j = 0; j < found && !again; j++) {
            double shift = (cimag(c[j].value) - cimag(c[i].value)) / W, whole = round(shift);
            bool near = whole != 0 && fabs(shift - whole) < TRANSLATE
                        && fabs(creal(c[j].value) - creal(c[i].value)) < TRANSLATE * W;
            again = near
                    && overlap(V + (size_t)c[j].index * count, V + (size_t)c[i].index * count, N, H,
                               (int)whole)
                           > SAME_MODE;
        }
        if (!again)
            c[found++] = c[i];
    }
    for (int i = 0; i < N; i++)
        out[i] = i < found ? principal(c[i].value, W) : NAN;
    qsort(out, (size_t)N, sizeof *out, by_value);
}

/* The determinant cut at H, its copies sorted out. */
static enum modal_status solve(const struct statespace *ss, double period, int H,
                               double complex *out, struct modal_error *err)
{
    size_t size = (size_t)ss->N * (size_t)(2 * H + 1);
    double complex *Z = malloc(size * size * sizeof *Z), *V = malloc(size * size * sizeof *V),
                   *w = malloc(size * sizeof *w);
    struct candidate *c = malloc(size * sizeof *c);
    enum modal_status rc = MODAL_OK;

    if (Z == NULL || V == NULL || w == NULL || c == NULL)
        rc = no_memory(err);
    if (rc == MODAL_OK) {
        assemble(ss, period, H, Z);
        if (LAPACKE_zgeev(LAPACK_COL_MAJOR, 'N', 'V', (int)size, Z, (int)size, w, NULL, 1, V,
                          (int)size)
            != 0)
            rc = modal_fail(err, MODAL_NO_CONVERGENCE, "hill: the eigenproblem of size %zu failed",
                            size);
    }
    for (size_t i = 0; rc == MODAL_OK && i < size; i++)
        c[i] = (struct candidate) { w[i], spread(V + i * size, ss->N, H), (int)i };
    if (rc == MODAL_OK)
        choose(c, size, V, ss->N, H, 2 * M_PI / period, out);
    free(Z);
    free(V);
    free(w);
    free(c);
    return rc;
}

/* The largest distance of an exponent from its nearest in the other set, modulo i W. */
static double distance(const double complex *a, const double complex *b, int count, double W)
{
    double worst = 0;

    for (int i = 0; i < count; i++) {
        double least = HUGE_VAL;
        for (int j = 0; j < count; j++) {
            double im = remainder(cimag(a[i]) - cimag(b[j]), W);
            least = fmin(least, hypot(creal(a[i]) - creal(b[j]), im));
        }
        worst = fmax(worst, least);
    }
    return worst;
}

/* The highest harmonic of A over PERIOD, at least 2: a cut must lose at least one of its steps
 * to be seen. */
static int highest(const struct statespace *ss, double period)
{
    int most = 2;

    for (int h = 0; h < ss->harmonics; h++) {
        int m = (int)lround(ss->harmonic[h].k * ss->p->omega * period / (2 * M_PI));
        most = m > most ? m : most;
    }
    return most;
}

/* Two cuts, whose difference is the truncation. */
static enum modal_status solve_two(const struct statespace *ss, double period, int H,
                                   struct hill *out, struct modal_error *err)
{
    int less = H - highest(ss, period);  /* a cut of one harmonic of A less */
    double complex *fine = malloc((size_t)ss->N * sizeof *fine + 1),
                   *coarse = malloc((size_t)ss->N * sizeof *coarse + 1);
    enum modal_status rc = fine != NULL && coarse != NULL ? MODAL_OK : no_memory(err);

    if (rc == MODAL_OK)
        rc = solve(ss, period, less > 1 ? less : 1, coarse, err);
    if (rc == MODAL_OK)
        rc = solve(ss, period, H, fine, err);
    if (rc == MODAL_OK) {
        *out = (struct hill){ .count = ss->N,
                              .harmonics = H,
                              .exponent = fine,
                              .truncation = distance(fine, coarse, ss->N, 2 * M_PI / period) };
        fine = NULL;
    }
    free(fine);
    free(coarse);
    return rc;
}

enum modal_status hill(const struct program *p, int harmonics, struct hill *out,
                       struct modal_error *err)
{
    struct statespace *ss = NULL;
    double period = p->period > 0 ? p->period : 2 * M_PI / p->omega;
    int H = harmonics > 0 ? harmonics : 12;
    enum modal_status rc;

    if (p->laws > 0 || p->harmonics == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "effects",
                                "Hill's determinant is of linear periodic scenes");
    rc = statespace_new(p, &ss, err);
    while (rc == MODAL_OK && harmonics == 0 && H > 2 && ss->N * (2 * H + 1) > HILL_SIZE_MOST / 2)
        H--;  /* room for the doubling that the truncation asks for */
    if (rc == MODAL_OK && ss->N * (2 * H + 1) > HILL_SIZE_MOST)
        rc = modal_fail_field(err, MODAL_TOO_LARGE, "hill",
                              "Hill's matrix would be of size %d; at most %d", ss->N * (2 * H + 1),
                              HILL_SIZE_MOST);
    if (rc == MODAL_OK)
        rc = solve_two(ss, period, H, out, err);
    while (rc == MODAL_OK && harmonics == 0 && out->truncation > ENOUGH * 2 * M_PI / period
           && ss->N * (4 * H + 1) <= HILL_SIZE_MOST / 2) {
        hill_done(out);
        rc = solve_two(ss, period, H *= 2, out, err);  /* errors fall faster than any power of H */
    }
    statespace_free(ss);
    return rc;
}

void hill_done(struct hill *h)
{
    free(h->exponent);
    memset(h, 0, sizeof *h);
}
