/*
 * remainder.c - poles in what a fit leaves
 *
 * A pencil of the signals sees first what is strong: modes near the edge of the noise, or that
 * share a direction with strong neighbours, may be missing from its poles. What a refined fit
 * leaves has the strong ones taken out to their bound, so the same pencil sees the next ones as
 * the strongest. A peak test tells whether there is a reason to look.
 */
#include "modal/identify/order/remainder.h"
#include "modal/identify/fit/compressed.h"
#include "modal/identify/linear/pencil.h"
#include "modal/identify/linear/powers.h"
#include <cblas.h>
#include <fftw3.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { ROWS_LEAST = 16 };        /* of the periodograms */

/* E -= Phi C, pole by pole: basis has two columns. */
static void subtract(const struct refine_data *data, const struct refined *fit, const double *C,
                     int ld, double *basis, struct matrix *E)
{
    for (int j = 0, i = 0; j < fit->poles; j++) {
        enum pole_kind kind = pole_kind(fit->lambda[j], data->tau);
        int n = kind == POLE_PAIR ? 2 : 1;
        powers_of(kind, creal(fit->lambda[j]) * data->tau, cimag(fit->lambda[j]) * data->tau, E->m,
                  basis, E->m);
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, E->m, E->n, n, -1, basis, E->m,
                    C + i, ld, 1, E->x, E->ld);
        i += n;
    }
}

double remainder_unit(const struct refine_data *data, const struct refined *fit,
                      const struct projected *p, int c)
{
    int L = data->Y->m, phases = data->phases > 0 ? data->phases : 1, g = c / phases;
    double noise = fit->noise[g], rms = sqrt(p->energy[g] / ((double)L * phases));
    double parts = rms > 0 ? cblas_dnrm2(p->order, p->Z + (size_t)c * (size_t)p->order, 1) / rms
                           : 1;
    /* cancelling amplitudes carry rounding that is larger than the signal's own */
    bool seen = noise > fmax(parts, 1) * sqrt(p->lowest[g]) && noise > REFINE_EXACT * rms;

    return seen ? 1 / noise : 0;
}

enum modal_status remainder_of(const struct refine_data *data, const struct refined *fit,
                               struct matrix *E, struct modal_error *err)
{
    int L = data->Y->m, S = data->Y->n;
    double *basis = malloc(2 * (size_t)L * sizeof *basis),
        *x = malloc((size_t)L * (size_t)S * sizeof *x);
    struct projected p = { 0 };
    enum modal_status rc = refine_project(data, fit->lambda, fit->poles, NULL, &p, err);

    if (rc == MODAL_OK && (basis == NULL || x == NULL))
        rc = modal_fail(err, MODAL_NO_MEMORY, "remainder: no memory for %d x %d", L, S);
    if (rc != MODAL_OK || p.degenerate)
        goto out;
    matrix_copy(L, S, data->Y->x, data->Y->ld, x, L);
    *E = (struct matrix) { L, S, L, x };
    x = NULL;
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasNoTrans, CblasNonUnit, p.order, S, 1,
                p.R, p.order, p.Z, p.order);
    subtract(data, fit, p.Z, p.order, basis, E);
    for (int c = 0; c < S; c++)
        cblas_dscal(L, remainder_unit(data, fit, &p, c), E->x + (size_t)c * (size_t)L, 1);
out:
    projected_done(&p);
    free(basis), free(x);
    return rc;
}

/*
 * A filter for a pole e^{(a + i theta) l}: |sum e_l z^l|^2 over half of sum |z|^2l is chi-squared
 * of two columns, at every theta by one transform of the weighed rows. Of one that decays with a
 * one that decays with b shows 4 a b / (a + b)^2, of one that does not in L rows tanh(x/2) / (x/2),
 * x = b L: so a L = 0, +-RATE_FIRST and by factors of RATE_RATIO from there show 0.76 of any.
 * Weights that decay end after RATE_FIRST / a rows. As many zeros after the rows let no frequency
 * lie so far between two bins that less than 0.81 of it shows.
 */
enum {
    RATE_FIRST = 4,                  /* of a L, as above */
    RATE_RATIO = 8                   /* from one to the next */
};

struct filter {
    const struct matrix *E, *K;  /* K: E E^T, of few rows; x NULL: E itself is read */
    double rate;                 /* of decay, per row; < 0: growth */
    int rows, length;            /* that it weighs; of its transform */
    double *x, *power;
    fftw_complex *X;
};

/* Weighed rows of column C, from the end of the record where the filter grows; how much in all. */
static double weigh_rows(struct filter *f, int c)
{
    const double *e = f->E->x + (size_t)c * (size_t)f->E->ld;
    /* rows / RATE_FIRST is the filter's life */
    double z = exp(-fabs(f->rate)), weight = 1, sum = 0;

    for (int l = 0; l < f->rows; l++, weight *= z) {
        f->x[l] = weight * (f->rate < 0 ? e[f->E->m - 1 - l] : e[l]);
        sum += weight * weight;
    }
    memset(f->x + f->rows, 0, (size_t)(f->length - f->rows) * sizeof *f->x);
    return sum;
}

/* Of few rows with many columns: the sums over the diagonals of the weighed products, whose
 * transform is the sum over the columns. */
static double weigh_products(struct filter *f)
{
    const struct matrix *K = f->K;
    int n = f->rows, late = f->rate < 0 ? K->n - n : 0;
    double z = exp(-fabs(f->rate)), sum = 0;

    memset(f->x, 0, (size_t)f->length * sizeof *f->x);
    for (int d = 0; d < n; d++) {
        double part = 0, weight = pow(z, d);
        for (int l = 0; l + d < n; l++, weight *= z * z) {
            int row = late + (f->rate < 0 ? n - 1 - l - d : l);
            part += weight * K->x[row + d + (size_t)row * (size_t)K->ld];
            sum += d == 0 ? weight : 0;
        }
        f->x[d] = part;
        if (d > 0)
            f->x[f->length - d] = part;
    }
    return sum;
}

/* The sums over the columns at all frequencies. */
static void sum_columns(struct filter *f, fftw_plan plan)
{
    int half = f->length / 2;
    bool squares = f->K->x != NULL;

    memset(f->power, 0, ((size_t)half + 1) * sizeof *f->power);
    for (int c = 0; c < (squares ? 1 : f->E->n); c++) {
        double all = squares ? weigh_products(f) : weigh_rows(f, c);
        fftw_execute(plan);
        for (int k = 0; k <= half; k++) {
            double re = creal(f->X[k]), im = cimag(f->X[k]);
            /* noise of unit variance: chi-squared of two columns has mean 2 */
            f->power[k] += (k == 0 || k == half ? 1 : 2) / all
                         * (squares ? re : re * re + im * im);
        }
    }
}

/* The largest of them, if above *chi2: it, and the pole per row. */
static void filter_rows(struct filter *f, double *chi2, double complex *pole)
{
    int half = f->length / 2;
    fftw_plan plan = fftw_plan_dft_r2c_1d(f->length, f->x, f->X, FFTW_ESTIMATE);

    if (plan == NULL)
        return;
    sum_columns(f, plan);
    for (int k = 0; k <= half; k++)
        if (f->power[k] > *chi2)
            *chi2 = f->power[k], *pole = CMPLX(-f->rate, M_PI * k / half);
    fftw_destroy_plan(plan);
}

/* E E^T where that pays; else K->x is NULL. */
static enum modal_status products_of(const struct matrix *E, struct matrix *K,
                                     struct modal_error *err)
{
    *K = (struct matrix) { 0 };
    return pencil_products_pay(E->m, E->n) ? pencil_products(E, K, err) : MODAL_OK;
}

enum modal_status remainder_peak(const struct matrix *E, double tau, double complex *lambda,
                                 double *chi2, struct modal_error *err)
{
    int L = E->m, most = transform_length(2 * L);
    struct matrix K;
    struct filter f = { E, &K, 0, L, most, fftw_alloc_real((size_t)most),
                        fftw_alloc_real((size_t)most / 2 + 1),
                        fftw_alloc_complex((size_t)most / 2 + 1) };
    enum modal_status rc = products_of(E, &K, err);

    *chi2 = 0, *lambda = 0;
    if (rc == MODAL_OK && (f.x == NULL || f.X == NULL || f.power == NULL))
        rc = modal_fail(err, MODAL_NO_MEMORY, "remainder: no memory for a transform of %d", most);
    if (rc == MODAL_OK)
        filter_rows(&f, chi2, lambda);
    for (int n = L; rc == MODAL_OK && n >= ROWS_LEAST; n /= RATE_RATIO) {
        f.rows = n, f.length = transform_length(2 * n);
        f.rate = (double)RATE_FIRST / n;
        filter_rows(&f, chi2, lambda);
        f.rate = -f.rate;
        filter_rows(&f, chi2, lambda);
    }
    *lambda = CMPLX(creal(*lambda) / tau, cimag(*lambda) / tau);
    fftw_free(f.x), fftw_free(f.X), fftw_free(f.power), free(K.x);
    return rc;
}

enum modal_status remainder_poles(const struct matrix *E, double tau, int most,
                                  double complex *lambda, int *count, struct modal_error *err)
{
    struct matrix K;
    struct pencil_options how = { .wanted = most };
    struct pencil p;
    double complex *rho;
    int r;
    enum modal_status rc = products_of(E, &K, err);

    *count = 0;
    how.products = K.x != NULL ? &K : NULL;
    if (rc == MODAL_OK)
        rc = pencil_new(E, &how, &p, err);
    free(K.x);
    if (rc != MODAL_OK)
        return rc;
    r = pencil_signals(&p);
    r = r < 2 ? 2 : r;  /* a pair at least: one that the edge hides may pay for all that */
    r = r < p.count ? r : p.count;
    rho = malloc(((size_t)r + 1) * sizeof *rho);
    if (rho == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "remainder: no memory for order %d", r);
    else if (r > 0 && (rc = pencil_multipliers(&p, r, rho, err)) == MODAL_OK)
        *count = poles_of_multipliers(rho, r, tau, 1e-300, lambda, NULL);
    if (rc == MODAL_NO_CONVERGENCE)
        rc = MODAL_OK;
    free(rho);
    pencil_done(&p);
    return rc;
}

/* ---- a second pole beside one ---- */

/*
 * What a second pole beside the first could take lies in u^2 z, u the row from a centre over a
 * width, z = e^{lambda l}, once z and u z are taken out. The six columns Re and -Im of z, u z,
 * u^2 z are, in each block of rows, those of the first block times a 6 x 6 matrix, for which
 *
 *     z = x z0,   u z = x (u0 + s) z0,   u^2 z = x (u0^2 + 2 s u0 + s^2) z0,                (1)
 *
 * x = e^{lambda l}, s = l / width at the block's first row l: their products and those with E are
 * sums over blocks, and no column is formed.
 */
enum {
    BLOCK = 1024,                    /* rows of a table of COLUMNS: 48 kB */
    COLUMNS = 6                      /* Re and -Im of z, u z, u^2 z */
};

static const double COLUMN_LEAST = 1e-6;     /* of a column, that those before it do not explain */

struct beside {
    double a, b, centre, width;
    int block, whole, left;          /* rows of a block; blocks; rows after them */
    double *table;                   /* block x COLUMNS: the columns in the first block */
    double first[COLUMNS * COLUMNS]; /* products of those */
    double G[COLUMNS * COLUMNS];     /* of all rows */
    double *P;                       /* COLUMNS x blocks x signals: those of the first with E */
    double *Z;                       /* COLUMNS x signals: of all with E */
};

static void fill_table(struct beside *k)
{
    for (int i = 0; i < k->block; i++) {
        double u = (i - k->centre) / k->width, x = exp(k->a * i);
        for (int p = 0; p < COLUMNS; p += 2, x *= u) {
            k->table[i + p * k->block] = x * cos(k->b * i);
            k->table[i + (p + 1) * k->block] = -x * sin(k->b * i);
        }
    }
}

/* What the first ROWS of each block say of each other. */
static void multiply_table(struct beside *k, int rows)
{
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, COLUMNS, COLUMNS, rows, 1, k->table,
                k->block, k->table, k->block, 0, k->first, COLUMNS);
}

/* (1): the columns of the block that begins at row l are those of the first times A. */
static void turn_block(const struct beside *k, double l, double last, double *A)
{
    double s = l / k->width, size = exp(k->a * (l - (k->a > 0 ? last : 0)));
    double c = size * cos(k->b * l), d = size * sin(k->b * l);
    /* (1): binomials of u0 + s */
    const double part[3][3] = { { 1, 0, 0 }, { s, 1, 0 }, { s * s, 2 * s, 1 } };

    for (int p = 0; p < 3; p++)
        for (int q = 0; q < 3; q++) {
            double *to = A + 2 * q + 2 * p * COLUMNS;
            to[0] = part[p][q] * c, to[1] = part[p][q] * d;
            to[COLUMNS] = -part[p][q] * d, to[COLUMNS + 1] = part[p][q] * c;
        }
}

/* G and Z of the block that A turns; P, its products with E, LD apart from signal to signal. */
static void add_block(struct beside *k, const double *A, const double *P, size_t ld, int S)
{
    double T[COLUMNS * COLUMNS];

    cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, COLUMNS, COLUMNS, COLUMNS, 1, k->first,
                COLUMNS, A, COLUMNS, 0, T, COLUMNS);
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, COLUMNS, COLUMNS, COLUMNS, 1, A, COLUMNS,
                T, COLUMNS, 1, k->G, COLUMNS);
    for (int c = 0; c < S; c++)
        cblas_dgemv(CblasColMajor, CblasTrans, COLUMNS, COLUMNS, 1, A, COLUMNS,
                    P + (size_t)c * ld, 1, 1, k->Z + (size_t)c * COLUMNS, 1);
}

/* Products of the first block's columns with the blocks of one column, and with its last rows. */
static void multiply_rows(struct beside *k, int c, const double *e)
{
    double *P = k->P + (size_t)c * (size_t)(k->whole + 1) * COLUMNS;

    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, COLUMNS, k->whole, k->block, 1, k->table,
                k->block, e, k->block, 0, P, COLUMNS);
}

static void multiply_tail(struct beside *k, int c, const double *e)
{
    double *P = k->P + ((size_t)c * (size_t)(k->whole + 1) + (size_t)k->whole) * COLUMNS;

    if (k->left > 0)
        cblas_dgemv(CblasColMajor, CblasTrans, k->left, COLUMNS, 1, k->table, k->block, e, 1, 0, P,
                    1);
}

/* G and Z of all rows, S signals. */
static void add_blocks(struct beside *k, int S)
{
    double A[COLUMNS * COLUMNS], last = (double)k->whole * k->block + k->left - 1;

    multiply_table(k, k->block);
    for (int t = 0; t < k->whole + (k->left > 0); t++) {
        if (t == k->whole)
            multiply_table(k, k->left);
        turn_block(k, (double)t * k->block, last, A);
        add_block(k, A, k->P + (size_t)t * COLUMNS, (size_t)(k->whole + 1) * COLUMNS, S);
    }
}

/* Cholesky's factor of G in its place; false where a column is next to nothing but those before. */
static bool factor_products(struct beside *k)
{
    double norm[COLUMNS];
    bool well = true;

    for (int j = 0; j < COLUMNS; j++)
        norm[j] = sqrt(k->G[j + j * COLUMNS]);
    if (LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'U', COLUMNS, k->G, COLUMNS) != 0)
        return false;
    for (int j = 0; j < COLUMNS; j++)
        well &= k->G[j + j * COLUMNS] > COLUMN_LEAST * norm[j];
    return well;
}

/* For L rows in blocks of so many, S signals. */
static struct beside *beside_new(int L, int block, int S, double tau, double complex lambda)
{
    struct beside *k = calloc(1, sizeof *k);
    size_t all;

    if (k == NULL)
        return NULL;
    k->block = block, k->whole = L / block, k->left = L % block;
    all = (size_t)COLUMNS * ((size_t)S * (size_t)(k->whole + 2) + (size_t)block);
    k->table = calloc(all, sizeof *k->table);
    if (k->table == NULL) {
        free(k);
        return NULL;
    }
    k->Z = k->table + (size_t)COLUMNS * (size_t)block, k->P = k->Z + (size_t)COLUMNS * (size_t)S;
    k->a = creal(lambda) * tau, k->b = cimag(lambda) * tau;
    k->centre = k->a == 0 ? 0.5 * L : k->a > 0 ? L - fmin(0.5 * L, 1 / k->a)
              : fmin(0.5 * L, -1 / k->a);
    k->width = fmax(fmin(k->centre, L - k->centre), 1);  /* u of order 1 where z has its weight */
    fill_table(k);
    return k;
}

static void beside_free(struct beside *k)
{
    free(k->table);
    free(k);
}

/* Of the products, chi-squared; the first FITTED columns are in the fit. */
static double beside_chi2(struct beside *k, int fitted, int S)
{
    double sum = 0;

    add_blocks(k, S);
    if (!factor_products(k))
        /* not told: it has to be tried */
        return k->whole * (double)k->block + k->left >= COLUMNS ? HUGE_VAL : 0;
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasUpper, CblasTrans, CblasNonUnit, COLUMNS, S, 1, k->G,
                COLUMNS, k->Z, COLUMNS);
    for (int c = 0; c < S; c++)
        /* the others less their part in those: the last of Q^T e */
        sum += cblas_ddot(COLUMNS - fitted, k->Z + fitted + c * COLUMNS, 1,
                          k->Z + fitted + c * COLUMNS, 1);
    return sum;
}

enum modal_status remainder_split(const struct matrix *E, double tau, double complex lambda,
                                  bool tied, double *chi2, struct modal_error *err)
{
    struct beside *k = beside_new(E->m, BLOCK, E->n, tau, lambda);

    *chi2 = 0;
    if (k == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "remainder: no memory for %d rows", E->m);
    for (int c = 0; c < E->n; c++) {
        const double *e = E->x + (size_t)c * (size_t)E->ld;
        multiply_rows(k, c, e);
        multiply_tail(k, c, e + (size_t)k->whole * BLOCK);
    }
    *chi2 = beside_chi2(k, tied ? 2 : 4, E->n);
    beside_free(k);
    return MODAL_OK;
}

enum modal_status remainder_split_blocks(const struct compressed *b, const double *rest,
                                         const struct matrix *tail, double tau,
                                         double complex lambda, double *chi2,
                                         struct modal_error *err)
{
    int S = b->Y.n, n = b->rows;
    struct beside *k = beside_new(b->Y.m, b->block, S, tau, lambda);
    double *T = malloc((size_t)n * COLUMNS * sizeof *T);

    *chi2 = 0;
    if (k == NULL || T == NULL) {
        if (k != NULL)
            beside_free(k);
        free(T);
        return modal_fail(err, MODAL_NO_MEMORY, "remainder: no memory for %d rows", b->Y.m);
    }
    k->whole = 1 << b->levels, k->left = b->left;
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, n, COLUMNS, b->block, 1, b->Q, b->block,
                k->table, b->block, 0, T, n);
    for (int c = 0; c < S; c++) {
        double *P = k->P + (size_t)c * (size_t)(k->whole + 1) * COLUMNS;
        cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, COLUMNS, k->whole, n, 1, T, n,
                    rest + (size_t)c * ((size_t)n << b->levels), n, 0, P, COLUMNS);
        multiply_tail(k, c, tail->x + (size_t)c * (size_t)tail->ld);
    }
    *chi2 = beside_chi2(k, 4, S);
    free(T);
    beside_free(k);
    return MODAL_OK;
}
