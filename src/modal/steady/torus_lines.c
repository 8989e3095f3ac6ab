/*
 * torus_lines.c - see torus_lines.h; tested by tests/unit/modal/steady/test_torus.c
 *
 * A record has N samples a turn of the leading tone, t = 2 pi (r + m / N) / w_lead.  Under a window
 * W, sum W = 1, its line at combination k is
 *
 *     X_k = 2 sum_m e^{-2 pi i k_lead m / N} sum_r W x e^{-2 pi i s (r + m / N)},               (1)
 *     s = sum_j k_j nu_j of the other tones j,
 *
 * the mean half of that: one product of matrices gives the sums over r of all s.  W is
 * exp(pi B (sqrt(1 - u^2) - 1)), -1 < u < 1 over the record: of another line B or more turns of the
 * record away (1) has e^{-pi B} at most.  Of nearer ones it has V, the transform of W: with time
 * from the record's middle, where V is real,
 *
 *     (1) = sum_l V(Omega_k - Omega_l) X_l + V(Omega_k + Omega_l) conj(X_l),                    (2)
 *
 * least squares weighed by W, and banded where lines are in order.  The same of what is left of the
 * record when the lines are taken out has the rest.  Lines nearer than APART are one, that of the
 * lower order.
 *
 * What no line explains is seen, over the whole record, of whose ends the window takes little.
 * Beyond N / 2 a record sees nothing: there lines sum to some part of the last below it, told or
 * not, and as many fold onto those.  Where a force has a kink its motion's lines fall as their
 * fourth power, and those beyond sum to 1 / ((1 - LAST)^-3 - 1) of the last; where it is smooth, to
 * less.
 */
#include "modal/steady/torus_lines.h"
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    BINS_LEAST = 3,            /* B: e^{-3 pi} is 1e-4 */
    BINS_MOST = 8,             /* and e^{-8 pi} 1e-11 */
    TURNS_A_ROW = 3,           /* more rows have more lines than a record tells: one in APART */
    OTHERS_MOST = 160,         /* |k_j| of one tone beside the leading one: slow envelopes of close
                                * tones have as many lines */
    OTHERS_OF_TWO_MOST = 12,   /* of two */
    AFRESH = 32,               /* products of a wave: no rounding gathers */
    LINES_MOST = 3000,         /* what a motion of one dof may balance, however many outputs */
    BLOCK = 64,                /* turns whose samples are weighed at once */
};
static const double APART = 1.5;          /* turns of the record that lines are apart at least: (2)
                                           * multiplies what is no line by some 2 there */
static const double FEWER = 0.01;         /* of the error asked for, which is a line's: smaller ones
                                           * are not worth being told, nor is what they leak */
static const double LAST = 0.125;         /* of the lines below N / 2, as in torus_error.c */
static const double BEYOND = 4.06;        /* 2 / ((1 - LAST)^-3 - 1): see above */
static const double SAME = 1e-6;          /* turns of the record between lines that coincide: a
                                           * million records would not tell them */
static const double WAVE = 3;             /* budget.h: of a sample and a row, five products of
                                           * matrices */

/* A line of the sheet of (1): its combination with the sign of torus.h's (1), size and place. */
struct line { struct torus_index k; double size; int row, lead; bool flipped; };

/* Row ROW's numbers of the other tones, into K; row 0: none. */
static void row_of(const struct torus_sheet *a, int row, struct torus_index *k)
{
    int wide = 2 * a->highest + 1;

    *k = (struct torus_index) { { 0 } };
    if (a->others[1] < 0) {
        k->k[a->others[0]] = row;
        return;
    }
    row += a->highest;                    /* (0, 0 ..), then (1, -highest ..) */
    k->k[a->others[0]] = row % wide - a->highest;
    k->k[a->others[1]] = row / wide;
}

/* Omega_k over that of the leading tone: of a turn's lines, N / 2 are below what folds. */
static double turns_of(const struct torus_sheet *a, struct torus_index k)
{
    return torus_frequency(&a->s->tones, k) / a->s->tones.omega[a->s->tones.lead];
}

/* The larger of two that are numbers, without a call. */
static double larger(double a, double b) { return a > b ? a : b; }

/* a b of finite numbers: C's product asks whether they are. */
static double complex turned(double complex a, double complex b)
{
    return CMPLX(creal(a) * creal(b) - cimag(a) * cimag(b),
                 creal(a) * cimag(b) + cimag(a) * creal(b));
}

/* The cosines, then the sines of 2 pi s r at the record's turns r, of row after row. */
static void fill_waves(struct torus_sheet *a)
{
    double first = a->start * a->s->tones.omega[a->s->tones.lead] / (2 * M_PI);

    for (int row = 0; row < a->rows; row++) {
        double complex turn, wave = 1;
        struct torus_index k;
        double s;

        row_of(a, row, &k);
        s = turns_of(a, k);
        turn = CMPLX(cos(2 * M_PI * s), sin(2 * M_PI * s));
        for (int r = 0; r < a->turns; r++) {
            if (r % AFRESH == 0)
                wave = cexp(2 * M_PI * I * fmod(s * (first + r), 1));
            a->wave[(size_t)row * (size_t)a->turns + (size_t)r] = creal(wave);
            a->wave[(size_t)(a->rows + row) * (size_t)a->turns + (size_t)r] = cimag(wave);
            wave = turned(wave, turn);
        }
    }
}

/* e^{2 pi i s m / N} of row ROW into SLOW, N. */
static void slow_waves(const struct torus_sheet *a, int row, double complex *slow)
{
    struct torus_index k;
    double complex turn;
    double s;

    row_of(a, row, &k);
    s = 2 * M_PI * turns_of(a, k) / a->N;
    turn = CMPLX(cos(s), sin(s));
    for (int m = 0; m < a->N; m++)
        slow[m] = m % AFRESH == 0 ? cexp(I * s * m) : turned(slow[m - 1], turn);
}

/* The sums over r of (1) of SIGNAL, all rows at once: into a->sum, less their waves within a
 * turn. */
static void gather(struct torus_sheet *a, const double *signal)
{
    size_t wide = (size_t)a->outputs, columns = (size_t)a->N * wide;

    for (int first = 0; first < a->turns; first += BLOCK) {
        int turns = a->turns - first < BLOCK ? a->turns - first : BLOCK;
        const double *x = signal + (size_t)first * columns;

        for (size_t e = 0; e < (size_t)turns * columns; e++)
            a->weighed[e] = a->window[(size_t)(first * a->N) + e / wide] * x[e];
        cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, 2 * a->rows, (int)columns, turns, 1,
                    a->wave + first, a->turns, a->weighed, (int)columns, first > 0, a->sum,
                    (int)columns);
    }
}

/* Those of output I and row ROW into SUM, N, SLOW being its waves. */
static void sums_of(const struct torus_sheet *a, int i, int row, const double complex *slow,
                    double complex *sum)
{
    size_t columns = (size_t)a->N * (size_t)a->outputs;

    for (int m = 0; m < a->N; m++) {
        const double *at = a->sum + (size_t)row * columns + (size_t)(m * a->outputs + i);

        sum[m] = conj(CMPLX(at[0], at[(size_t)a->rows * columns]) * slow[m]);
    }
}

/* (1) of k_lead from SUM; e^{2 pi i m / N} is TURN, N a power of two. */
static double complex line_at(const struct torus_sheet *a, const double complex *sum, int lead,
                              const double complex *turn)
{
    double re = 0, im = 0;

    for (int m = 0; m < a->N; m++) {
        double complex w = turn[(lead * m) & (a->N - 1)];

        re += creal(sum[m]) * creal(w) + cimag(sum[m]) * cimag(w);
        im += cimag(sum[m]) * creal(w) - creal(sum[m]) * cimag(w);
    }
    return CMPLX(re, im);
}

/* SIGNAL less the lines X, whose places are LIST, by row.  SLOW: N of room. */
static void take_out(struct torus_sheet *a, double *signal, const struct line *list,
                     const double complex *X, double complex *slow, const double complex *turn)
{
    size_t columns = (size_t)a->N * (size_t)a->outputs;

    memset(a->sum, 0, 2 * (size_t)a->rows * columns * sizeof *a->sum);
    for (int l = 0; l < a->count; l++) {
        if (l == 0 || list[l].row != list[l - 1].row)
            slow_waves(a, list[l].row, slow);
        for (int e = 0; e < (int)columns; e++) {
            int i = e % a->outputs, m = e / a->outputs;
            double complex Z = X[(size_t)i * (size_t)a->count + (size_t)l]
                * turn[(list[l].lead * m) & (a->N - 1)] * slow[m];
            double *at = a->sum + (size_t)list[l].row * columns + (size_t)e;

            at[0] += creal(Z);
            at[(size_t)a->rows * columns] -= cimag(Z);
        }
    }
    cblas_dgemm(CblasRowMajor, CblasTrans, CblasNoTrans, a->turns, (int)columns, 2 * a->rows, -1,
                a->wave, a->turns, a->sum, (int)columns, 1, signal, (int)columns);
}

/* By falling size: what is left out last is least. */
static int by_size(const void *a, const void *b)
{
    double x = ((const struct line *)a)->size, y = ((const struct line *)b)->size;

    return (x < y) - (x > y);
}

static int by_order(const void *a, const void *b)
{
    int order = torus_order(((const struct line *)a)->k) - torus_order(((const struct line *)b)->k);

    return order != 0 ? order : by_size(a, b);
}

/* Of two lines that the record does not tell apart one is where the motion is, and larger; where
 * they coincide it is that of the lower order. */
static int by_claim(const void *a, const void *b)
{
    const struct line *x = a, *y = b;
    double p = x->size / (1 + torus_order(x->k)), q = y->size / (1 + torus_order(y->k));

    return p != q ? (p < q) - (p > q) : by_order(a, b);
}

/* Lines of a row share their waves. */
static int by_row(const void *a, const void *b)
{
    return ((const struct line *)a)->row - ((const struct line *)b)->row;
}

/* All lines below N / 2 of the record into LIST; SUM: twice N. */
static int sheet(struct torus_sheet *a, struct line *list, double complex *sum,
                 const double complex *turn)
{
    double complex *slow = sum + a->N;
    int count = 0;

    gather(a, a->x);
    for (int row = 0; row < a->rows; row++) {
        int first = count, middle;
        struct torus_index k;

        row_of(a, row, &k);
        middle = -(int)lround(turns_of(a, k));     /* a high row's slow lines have as high a lead */
        for (int lead = row > 0 ? middle - a->N / 2 : 0; lead <= middle + a->N / 2; lead++) {
            struct line l = { .row = row, .lead = lead };

            k.k[a->s->tones.lead] = lead;
            l.k = torus_signed(&a->s->tones, k, &l.flipped);
            if (2 * turns_of(a, l.k) < a->N)
                list[count++] = l;
        }
        slow_waves(a, row, slow);
        for (int i = 0; i < a->outputs; i++) {
            sums_of(a, i, row, slow, sum);
            for (int l = first; l < count; l++)
                list[l].size = larger(list[l].size,
                                      2 * cabs(line_at(a, sum, list[l].lead, turn)));
        }
    }
    return count;
}

/* Of claim(): two lines are never in one, for it is as wide as they are apart at least. */
static int cells_of(const struct torus_sheet *a)
{
    return (int)((double)a->N * a->turns / (2 * APART)) + 3;
}

/* How far FREQUENCY, in turns, is from the nearest that is taken, one a cell of as many at most, in
 * turns of the record; from APART on it is then among them. */
static double claim(const struct torus_sheet *a, double frequency, double *taken)
{
    double least = APART / a->turns, nearest = APART;
    int cell = 1 + (int)(frequency / least);

    for (int c = cell - 1; c <= cell + 1; c++)
        if (taken[c] >= 0)
            nearest = fmin(nearest, fabs(taken[c] - frequency) * a->turns);
    if (nearest >= APART)
        taken[cell] = frequency;
    return nearest;
}

/* Whether K is among the last lines below N / 2. */
static bool is_last(const struct torus_sheet *a, struct torus_index k)
{
    return 2 * turns_of(a, k) > (1 - LAST) * a->N;
}

/* Of ALL lines those to keep at the front of LIST, by row: apart from each other, and larger than
 * LEAVE; the mean always. */
static int keep(struct torus_sheet *a, struct line *list, int all, double leave, double *taken)
{
    int most = LINES_MOST, count = 0, large = 0;

    for (int c = 0; c < cells_of(a); c++)
        taken[c] = -1;
    for (int o = 0; o < TORUS_SHEET_ORDERS; o++)
        a->nearest[o] = APART;
    for (int l = 0; l < all; l++) {
        if (torus_order(list[l].k) == 0)
            list[l].size = HUGE_VAL;
        if (list[l].size > leave)
            list[large++] = list[l];
        else
            a->last += is_last(a, list[l].k) ? list[l].size : 0;
    }
    qsort(list, (size_t)large, sizeof *list, by_claim);
    for (int l = 0; l < large; l++) {
        int order = torus_order(list[l].k);
        double far = claim(a, turns_of(a, list[l].k), taken);

        if (far >= APART)
            list[count++] = list[l];
        else if (far > SAME && order < TORUS_SHEET_ORDERS)
            a->nearest[order] = fmin(a->nearest[order], far);
    }
    if (count > most)
        qsort(list, (size_t)count, sizeof *list, by_size);
    count = count < most ? count : most;
    qsort(list, (size_t)count, sizeof *list, by_row);
    return count;
}

/*
 * What a line may hide of another that the record does not tell from it, in m.  F turns of the
 * record away they drift apart by pi F to its ends, and LEFT is the most that is seen there; and it
 * is no larger than the lines kept of its order and above.
 */
static double hidden(const struct torus_sheet *a, const struct line *list, double left)
{
    double most = 0;

    for (int order = 0; order < TORUS_SHEET_ORDERS; order++) {
        double size = 0;

        if (a->nearest[order] >= APART)
            continue;
        for (int l = 0; l < a->count; l++)
            size = torus_order(list[l].k) >= order && isfinite(list[l].size)
                       ? fmax(size, list[l].size) : size;
        most = fmax(most, fmin(2 * size, left / fmin(1, M_PI / 2 * a->nearest[order])));
    }
    return most;
}

/* V of (2), F turns of the record away: even, and so is W. */
static double leaks(const struct torus_sheet *a, double f)
{
    double step = M_PI * f / TORUS_SHEET_NODES, turn = 2 * cos(step), c = cos(step / 2);
    double before = c, sum = 0;

    for (int n = 0; n < TORUS_SHEET_NODES; n++) {      /* c = cos(pi f u) at a->node's u */
        double next = turn * c - before;

        sum += a->node[n] * c;
        before = c;
        c = next;
    }
    return sum;
}

/* Line L of a list, AT so many turns of the record. */
struct spot { double at; int l; };

static int by_frequency(const void *a, const void *b)
{
    double x = ((const struct spot *)a)->at, y = ((const struct spot *)b)->at;

    return (x > y) - (x < y);
}

/* The matrices of (2) for real and imaginary parts, of lines SPOT in order: DIAGONALS below the
 * main one, by columns. */
static void fill_leaks(const struct torus_sheet *a, const struct spot *spot, int diagonals,
                       double *re, double *im)
{
    for (int l = 0; l < a->count; l++)
        for (int d = 0; d <= diagonals && l + d < a->count; d++) {
            double less = spot[l + d].at - spot[l].at, more = spot[l + d].at + spot[l].at;
            double V = less < a->bins ? leaks(a, less) : 0, U = more < a->bins ? leaks(a, more) : 0;
            size_t at = (size_t)l * (size_t)(diagonals + 1) + (size_t)d;

            re[at] = V + U;
            im[at] = spot[l].at > 0 ? V - U : d == 0;      /* the mean is real */
        }
}

/* (2) solved: X, read by (1), becomes that of the lines LIST. */
static enum modal_status untangle(struct torus_sheet *a, const struct line *list, double complex *X,
                                  struct modal_error *err)
{
    size_t K = (size_t)a->count, all = K * (size_t)a->outputs;
    double middle = a->start + M_PI / a->s->tones.omega[a->s->tones.lead]
        * (a->turns - 1.0 / a->N);
    struct spot *spot = workspace_zeros(&a->space, K, sizeof *spot);
    double *b = workspace_zeros(&a->space, 2 * all, sizeof *b), *part[2];
    int diagonals = 0;
    enum modal_status rc = workspace_check(&a->space, "torus: no memory for a record", err);

    for (size_t l = 0; rc == MODAL_OK && l < K; l++)
        spot[l] = (struct spot) { turns_of(a, list[l].k) * a->turns, (int)l };
    if (rc == MODAL_OK)
        qsort(spot, K, sizeof *spot, by_frequency);
    for (size_t l = 0; rc == MODAL_OK && l < K; l++)
        while (l + (size_t)diagonals + 1 < K
               && spot[l + (size_t)diagonals + 1].at - spot[l].at < a->bins)
            diagonals++;
    for (int e = 0; e < 2; e++)
        part[e] = workspace_zeros(&a->space, K * (size_t)(diagonals + 1), sizeof *part[e]);
    if (rc == MODAL_OK)
        rc = workspace_check(&a->space, "torus: no memory for a record", err);
    if (rc != MODAL_OK)
        return rc;
    fill_leaks(a, spot, diagonals, part[0], part[1]);
    for (size_t e = 0; e < all; e++) {
        const struct line *at = &list[spot[e % K].l];
        double complex Y = X[e / K * K + (size_t)spot[e % K].l];

        /* from the record's middle; the mean stands for both of its halves */
        Y = (at->flipped ? conj(Y) : Y)
            * cexp(I * fmod(torus_frequency(&a->s->tones, at->k) * middle, 2 * M_PI));
        b[e] = torus_order(at->k) == 0 ? 2 * creal(Y) : creal(Y);
        b[all + e] = cimag(Y);
    }
    for (int e = 0; e < 2; e++)
        if (LAPACKE_dpbsv_work(LAPACK_COL_MAJOR, 'L', a->count, diagonals, a->outputs, part[e],
                               diagonals + 1, b + (size_t)e * all, a->count) != 0)
            return MODAL_OK;              /* as they were read: the second pass mends some */
    for (size_t e = 0; e < all; e++) {
        const struct line *at = &list[spot[e % K].l];
        double complex Y = CMPLX(b[e], b[all + e])
            * cexp(-I * fmod(torus_frequency(&a->s->tones, at->k) * middle, 2 * M_PI));

        X[e / K * K + (size_t)spot[e % K].l] = at->flipped ? conj(Y) : Y;
    }
    return MODAL_OK;
}

/* X += the lines at LIST of what is left of the record, and they are taken out of it. */
static enum modal_status read_lines(struct torus_sheet *a, const struct line *list,
                                    double complex *more, double complex *sum,
                                    const double complex *turn, struct modal_error *err)
{
    size_t K = (size_t)a->count;
    enum modal_status rc;

    gather(a, a->left);
    for (int l = 0; l < a->count; l++)
        for (int i = 0; i < a->outputs; i++) {
            double complex X;

            if (i == 0 && (l == 0 || list[l].row != list[l - 1].row))
                slow_waves(a, list[l].row, sum + a->N);
            if (a->outputs > 1 || l == 0 || list[l].row != list[l - 1].row)
                sums_of(a, i, list[l].row, sum + a->N, sum);
            X = line_at(a, sum, list[l].lead, turn);
            more[(size_t)i * K + (size_t)l] =
                torus_order(list[l].k) == 0 ? creal(X) : 2 * X;
        }
    rc = untangle(a, list, more, err);
    if (rc != MODAL_OK)
        return rc;
    take_out(a, a->left, list, more, sum, turn);
    for (size_t j = 0; j < (size_t)a->outputs * K; j++)
        a->X[j] += more[j];
    return MODAL_OK;
}

/* The largest of output I of SIGNAL, over all of the record: its ends too, where W has next to
 * nothing and lines told wrongly have drifted apart. */
static double largest(const struct torus_sheet *a, const double *signal, int i)
{
    double most = 0;

    for (long n = 0; n < (long)a->N * a->turns; n++)
        most = larger(most, fabs(signal[n * a->outputs + i]));
    return most;
}

/* What was read, by rising order and with torus.h's signs, without those of LEAVE or less, whose
 * sum is added to *LEFT.  What leaked into many is found to be nothing once they are told
 * apart. */
static enum modal_status sort_lines(struct torus_sheet *a, const struct line *list,
                                    double complex *room, double leave, double *left,
                                    struct modal_error *err)
{
    size_t K = (size_t)a->count;
    double sum = 0;
    struct line *sorted = workspace_zeros(&a->space, K, sizeof *sorted);
    enum modal_status rc = workspace_check(&a->space, "torus: no memory for a record", err);

    if (rc != MODAL_OK)
        return rc;
    for (size_t l = 0; l < K; l++) {
        sorted[l] = list[l];
        sorted[l].row = (int)l;                    /* where its X is */
    }
    qsort(sorted, K, sizeof *sorted, by_size);
    while (a->count > 1 && sorted[a->count - 1].size <= leave)
        sum += sorted[--a->count].size;
    *left += sum;
    qsort(sorted, (size_t)a->count, sizeof *sorted, by_order);
    memcpy(room, a->X, (size_t)a->outputs * K * sizeof *room);
    for (size_t l = 0; l < (size_t)a->count; l++) {
        a->index[l] = sorted[l].k;
        for (size_t i = 0; i < (size_t)a->outputs; i++) {
            double complex X = room[i * K + (size_t)sorted[l].row];

            a->X[i * (size_t)a->count + l] = sorted[l].flipped ? conj(X) : X;
        }
    }
    return MODAL_OK;
}

/* z_k <- sum_n z_n e^{-2 pi i n k / M} of M = 2^p numbers, TURN being e^{-pi i j / M} for j < M: to
 * plan one that serves once takes FFTW several times as long as to go through it. */
static void transform(double complex *z, size_t M, const double complex *turn)
{
    for (size_t i = 1, j = 0; i < M; i++) {            /* j is i with its bits reversed */
        size_t bit = M / 2;
        double complex was = z[i];

        for (; j & bit; bit /= 2)
            j ^= bit;
        j |= bit;
        if (i < j)
            z[i] = z[j], z[j] = was;
    }
    for (size_t half = 1; half < M; half *= 2)
        for (size_t first = 0; first < M; first += 2 * half)
            for (size_t k = first; k < first + half; k++) {
                double complex b = turned(z[k + half], turn[(k - first) * (M / half)]);

                z[k + half] = z[k] - b;
                z[k] += b;
            }
}

/* The largest line of what no line explains, wherever it is: of W times it.  Even and odd samples
 * are one number of half as many, z = x + i y, whose transforms are those of both:
 * X_k + e^{-pi i k / M} Y_k is the whole record's. */
static enum modal_status unexplained(struct torus_sheet *a, double *most, struct modal_error *err)
{
    size_t M = (size_t)a->N * (size_t)a->turns / 2, wide = (size_t)a->outputs;
    double complex *z = workspace_zeros(&a->space, M, sizeof *z),
                   *turn = workspace_zeros(&a->space, M, sizeof *turn);
    double step = M_PI / (double)M, largest = 0;
    enum modal_status rc = workspace_check(&a->space, "torus: no memory for a record", err);

    for (size_t j = 0; rc == MODAL_OK && j < M; j++)
        turn[j] = j % AFRESH == 0 ? CMPLX(cos(step * (double)j), -sin(step * (double)j))
                                  : turned(turn[j - 1], turn[1]);
    for (size_t i = 0; rc == MODAL_OK && i < wide; i++) {
        if (!a->reported[i])
            continue;
        for (size_t n = 0; n < M; n++)
            z[n] = CMPLX(a->window[2 * n] * a->left[2 * n * wide + i],
                         a->window[2 * n + 1] * a->left[(2 * n + 1) * wide + i]);
        transform(z, M, turn);
        for (size_t k = 0; k < M; k++) {
            double complex p = z[k], q = conj(z[k > 0 ? M - k : 0]);
            double complex X = 0.5 * (p + q) + turned(-0.5 * I * (p - q), turn[k]);

            largest = larger(largest, (k == 0 ? 1 : 4) * (creal(X) * creal(X)
                                                          + cimag(X) * cimag(X)));
        }
    }
    *most = sqrt(largest);
    return rc;
}

enum modal_status torus_sheet_read(struct torus_sheet *a, struct torus_errors *e, double *amplitude,
                                    struct modal_error *err)
{
    size_t most = 2 * (size_t)a->rows * (size_t)a->N, numbers = (size_t)a->N * (size_t)a->turns;
    struct line *list = workspace_zeros(&a->space, most, sizeof *list);
    double *taken = workspace_zeros(&a->space, (size_t)cells_of(a), sizeof *taken);
    double complex *sum = workspace_zeros(&a->space, 3 * (size_t)a->N, sizeof *sum),
                   *turn = sum + 2 * a->N, *more;
    double leave;
    enum modal_status rc = workspace_check(&a->space, "torus: no memory for a record", err);

    if (rc != MODAL_OK)
        return rc;
    *amplitude = 0;
    for (int i = 0; i < a->outputs; i++)
        *amplitude = fmax(*amplitude, a->reported[i] ? largest(a, a->x, i) : 0);
    leave = FEWER * a->wanted * *amplitude;
    for (int m = 0; m < a->N; m++)
        turn[m] = cexp(2 * M_PI * I * m / a->N);
    a->count = keep(a, list, sheet(a, list, sum, turn), leave, taken);
    most = (size_t)a->outputs * (size_t)a->count;
    a->index = workspace_zeros(&a->space, (size_t)a->count, sizeof *a->index);
    a->X = workspace_zeros(&a->space, most, sizeof *a->X);
    more = workspace_zeros(&a->space, most, sizeof *more);
    rc = workspace_check(&a->space, "torus: no memory for a record", err);
    if (rc != MODAL_OK)
        return rc;
    memcpy(a->left, a->x, numbers * (size_t)a->outputs * sizeof *a->left);
    for (int pass = 0; rc == MODAL_OK && pass < 2; pass++)
        rc = read_lines(a, list, more, sum, turn, err);
    if (rc != MODAL_OK)
        return rc;
    for (int i = 0; i < a->outputs; i++)
        e->truncation = fmax(e->truncation, a->reported[i] ? largest(a, a->left, i) : 0);
    e->change = e->truncation;
    rc = unexplained(a, &e->line, err);
    if (rc != MODAL_OK)
        return rc;
    for (int l = 0; l < a->count; l++) {
        list[l].size = torus_order(list[l].k) == 0 ? HUGE_VAL : 0;
        for (int i = 0; i < a->outputs; i++)
            list[l].size = fmax(list[l].size, cabs(a->X[(size_t)i * (size_t)a->count + (size_t)l]));
    }
    e->truncation = fmax(e->truncation, hidden(a, list, e->truncation));
    for (int l = 0; l < a->count; l++)
        if (is_last(a, list[l].k)) {
            a->last += list[l].size;
            e->folded = fmax(e->folded, list[l].size);
        }
    e->sampling = BEYOND * a->last;
    budget_add(a->s->work, torus_sheet_work(a));
    return sort_lines(a, list, more, leave, &e->truncation, err);
}

bool torus_sheet_lay(struct torus_sheet *a, int N, int turns, double wanted)
{
    const struct torus_tones *t = &a->s->tones;
    int r = 0, most = t->count > 2 ? OTHERS_OF_TWO_MOST : OTHERS_MOST, wide;

    a->N = N, a->turns = turns;
    a->wanted = wanted;
    a->bins = fmin(fmax(log(10 / wanted) / M_PI, BINS_LEAST), BINS_MOST);
    a->apart = APART / turns * t->omega[t->lead];
    a->others[0] = a->others[1] = -1;
    for (int j = 0; j < t->count; j++)
        if (j != t->lead)
            a->others[r++] = j;
    a->highest = turns / TURNS_A_ROW < most ? turns / TURNS_A_ROW : most;
    wide = 2 * a->highest + 1;
    a->rows = t->count > 2 ? (wide * wide + 1) / 2 : a->highest + 1;
    return (double)N * turns * a->outputs <= TORUS_SHEET_MOST;
}

double torus_sheet_work(const struct torus_sheet *a)
{
    return WAVE * a->rows * a->outputs * ((double)a->N * a->turns);
}

enum modal_status torus_sheet_room(struct torus_sheet *a, struct modal_error *err)
{
    size_t samples = (size_t)a->N * (size_t)a->turns;
    double sum = 0;
    enum modal_status rc;

    if (a->x == NULL)
        a->x = workspace_zeros(&a->space, samples * (size_t)a->outputs, sizeof *a->x);
    a->left = workspace_zeros(&a->space, samples * (size_t)a->outputs, sizeof *a->left);
    a->window = workspace_zeros(&a->space, samples, sizeof *a->window);
    a->weighed = workspace_zeros(&a->space, (size_t)BLOCK * (size_t)(a->N * a->outputs),
                                 sizeof *a->weighed);
    a->wave = workspace_zeros(&a->space, 2 * (size_t)a->rows * (size_t)a->turns, sizeof *a->wave);
    a->sum = workspace_zeros(&a->space, 2 * (size_t)a->rows * (size_t)(a->N * a->outputs),
                             sizeof *a->sum);
    rc = workspace_check(&a->space, "torus: no memory for a record", err);
    for (size_t n = 0; rc == MODAL_OK && n < samples / 2; n++) {   /* the same from both ends */
        double u = (2 * (double)n + 1) / (double)samples - 1;

        sum += a->window[n] = exp(M_PI * a->bins * (sqrt(1 - u * u) - 1));
    }
    for (size_t n = 0; rc == MODAL_OK && n < samples / 2; n++)
        a->window[samples - 1 - n] = a->window[n] /= 2 * sum;
    if (rc == MODAL_OK)
        fill_waves(a);
    sum = 0;
    for (int n = 0; n < TORUS_SHEET_NODES; n++) {
        double u = (n + 0.5) / TORUS_SHEET_NODES;

        sum += a->node[n] = exp(M_PI * a->bins * (sqrt(1 - u * u) - 1));
    }
    for (int n = 0; n < TORUS_SHEET_NODES; n++)
        a->node[n] /= sum;
    return rc;
}

