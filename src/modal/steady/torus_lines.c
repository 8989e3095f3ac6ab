/*
 * torus_lines.c - see torus_lines.h; tested by tests/unit/modal/steady/test_torus_lines.c
 *
 * A record has N samples a turn of the leading tone, t = 2 pi (r + m / N) / w_lead.  Combinations
 * that differ by the leading tone alone are a row: from turn to turn, at any m, they go on alike,
 *
 *     x(r, m) = Re sum_rows z_row(m) e^{2 pi i s rho},   rho = r - (turns - 1) / 2,             (1)
 *     s = sum_j k_j nu_j of the other tones j,
 *
 * and z is N samples of what the row's own lines sum to within a turn,
 *
 *     z(m) = e^{-pi i s} sum_lead Y e^{2 pi i (lead + s) m / N},                                (2)
 *
 * Y a line as it stands turns / 2 from the record's begin.  (1) is least squares of two columns a
 * row, cosine and minus sine, whose products are known in closed form and the same for all m; (2)
 * is a transform.  About the middle of the turns cosines are even and sines odd, of no product with
 * each other, and so each kind has a factor of its own.  Where 2 s is a whole number a row is its
 * own mirror, real, and one of its columns is 0.
 *
 * Rows are taken by rising order.  One of which all but TOLD of its square is in those before it
 * is left out, and what its lines are is told as theirs: what no line explains would stand in it
 * multiplied by more than TOLD^-1/2.  Two rows F turns of the record apart have 1 - sinc^2 F of
 * each other's squares left, many evenly spaced ones less; that knows of both.
 *
 * A record that has not settled has more than lines: what decays, and a body's drift that nothing
 * holds.  They go on where a turn ends, and z of (2) does not: it would have lines that fall as
 * 1 / lead, whose rates are noise.  Its least squares are weighed by
 *
 *     W = 8 / 3 cos^4 pi u = 1 + 4 / 3 cos 2 pi u + 1 / 3 cos 4 pi u,   -1/2 < u < 1/2,         (3)
 *
 * of the samples' own times, under which all m see the same.  The products are those of a turn's
 * middle, and so z is off by some ten turns in the record's; what it leaves, under W, is read
 * again, until that falls no more.
 *
 * What no line explains is seen over the whole record.  Beyond N / 2 a record sees nothing: there
 * lines sum to some part of the last below it, told or not, and as many fold onto those.  Where a
 * force has a kink its motion's lines fall as their fourth power, and those beyond sum to
 * 1 / ((1 - LAST)^-3 - 1) of the last; where it is smooth, to less.
 */
#include "modal/steady/torus_lines.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"

enum {
    PASSES = 8,                /* at most: of 64, 256, 1024 turns each left 0.2, 0.04, 1e-3 of what
                                * the one before had */
    AFRESH = 32,               /* products of a wave: no rounding gathers */
    LINES_MOST = 3000,         /* what a motion of one dof may balance, however many outputs */
};
static const double TOLD = 0.1;           /* of a column's square: three errors of what is no line,
                                           * at most */
static const double TOGETHER = 0.5;       /* of what one row leaves of it, several leave less */
static const double HARMONIC[] = { 1, 2.0 / 3, 1.0 / 6 };  /* of (3), at j whole waves */
static const double SPREAD = 0.289;       /* root mean square of u, with no window: 12^-1/2 */
static const double SPREAD_WEIGHED = 0.141;   /* under (3) */
static const double TWICE = 18.0 / 35;    /* 1 over the mean square of (3) */
static const double FALLS = 0.5;          /* of what the pass before left: more is what no line
                                           * explains */
static const double FEWER = 0.01;         /* of the error asked for, which is a line's: smaller ones
                                           * are not worth being told */
static const double LAST = 0.125;         /* of the lines below N / 2, as in torus_error.c */
static const double BEYOND = 4.06;        /* 2 / ((1 - LAST)^-3 - 1): see above */

/* The columns of a row, by kind. */
enum { COSINE, SINE, KINDS = TORUS_KINDS };

/* A line of a row, of combination k as torus.h's (1) has it. */
struct line { struct torus_index k; double size; int told, bin; bool flipped; };

/* Row ROW's numbers of the other tones, into K; row 0: none. */
static void row_of(const struct torus_sheet *a, int row, struct torus_index *k)
{
    int wide = 2 * a->highest + 1;

    *k = (struct torus_index) { { 0 } };
    if (a->others[0] < 0)
        return;
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

/* e^{2 pi i s (first + step n)} for COUNT n into WAVE. */
static void fill_wave(double s, double first, double step, int count, double complex *wave)
{
    double complex turn = CMPLX(cos(2 * M_PI * s * step), sin(2 * M_PI * s * step));

    for (int n = 0; n < count; n++)
        if (n % AFRESH == 0) {
            double phase = 2 * M_PI * fmod(s * (first + step * n), 1);

            wave[n] = CMPLX(cos(phase), sin(phase));
        } else
            wave[n] = numbers_times(wave[n - 1], turn);
}

/* +-1: e^{2 pi i whole rho}, rho of (1). */
static int sign_of(const struct torus_sheet *a, int whole)
{
    return whole * (a->turns - 1) % 2 == 0 ? 1 : -1;
}

/* The mean of e^{2 pi i s rho} over the record's turns, under (3) where it has not settled. */
static double mean_at(const struct torus_sheet *a, double s)
{
    double f = M_PI * (s - round(s)), sum = 0;
    int highest = a->settled ? 0 : 2;

    for (int j = -highest; j <= highest; j++) {
        double g = f + j * M_PI / a->turns;

        sum += HARMONIC[abs(j)] * (g == 0 ? 1 : sin(a->turns * g) / (a->turns * sin(g)));
    }
    return sign_of(a, (int)lround(s)) * sum;
}

/* That of ROW's s + SIGN WITH's.  Of one other tone both are a whole number of its, less whole
 * turns, and as many means are known. */
static double mean_wave(const struct torus_sheet *a, const struct torus_row *row, int sign,
                        const struct torus_row *with)
{
    if (a->others[1] >= 0)
        return mean_at(a, row->s + sign * with->s);
    return sign_of(a, row->whole + with->whole) * a->mean[abs(row->row + sign * with->row)];
}

/* The mean products of columns of ROW and WITH, of each kind. */
static void products(const struct torus_sheet *a, const struct torus_row *row,
                     const struct torus_row *with, double to[KINDS])
{
    double less = mean_wave(a, row, -1, with), more = mean_wave(a, row, 1, with);

    to[COSINE] = 0.5 * (less + more), to[SINE] = 0.5 * (less - more);
}

/* <x, y>, N numbers: short ones are most, and a library's call costs as much as one. */
static double inner(const double *x, const double *y, int n)
{
    double even = 0, odd = 0;

    for (int i = 0; i + 1 < n; i += 2)
        even += x[i] * y[i], odd += x[i + 1] * y[i + 1];
    return even + odd + (n % 2 ? x[n - 1] * y[n - 1] : 0);
}

/* Row I of L, the products of a column with those before it and itself, becomes that of Cholesky's
 * factor.  What part of its square is in no other. */
static double factor_row(double *L, int ld, int i)
{
    double *row = L + (size_t)i * (size_t)ld, whole = row[i], left;

    for (int j = 0; j < i; j++) {
        const double *before = L + (size_t)j * (size_t)ld;

        row[j] = (row[j] - inner(before, row, j)) / before[j];
    }
    left = larger(whole - inner(row, row, i), 0);
    row[i] = sqrt(left);
    return left / whole;
}

/* What part of ROW's columns, whose products with WITH's are TO and with themselves OWN, is not in
 * those. */
static double left_by(const struct torus_sheet *a, const struct torus_row *row,
                      const struct torus_row *with, const double to[KINDS],
                      const double own[KINDS])
{
    double of[KINDS], part = 1;

    products(a, with, with, of);
    for (int k = 0; k < KINDS; k++)
        if (row->at[k] >= 0 && with->at[k] >= 0)
            part = fmin(part, larger(1 - to[k] * to[k] / (of[k] * own[k]), 0));
    return part;
}

/* ROW's columns, of products OWN with themselves, behind those of L, a factor of each kind; what
 * part of them is in no other.  *PAIR: what part is not in the row told that has most of it. */
static double try_row(const struct torus_sheet *a, const struct torus_row *row,
                      const double own[KINDS], double *const L[KINDS], int ld, double *pair)
{
    double part = 1;

    for (int t = 0; t < a->told; t++) {
        const struct torus_row *with = &a->row[t];
        double to[KINDS];

        products(a, row, with, to);
        for (int k = 0; k < KINDS; k++)
            if (row->at[k] >= 0 && with->at[k] >= 0)
                L[k][(size_t)row->at[k] * (size_t)ld + (size_t)with->at[k]] = to[k];
        *pair = fmin(*pair, left_by(a, row, with, to, own));
    }
    for (int k = 0; k < KINDS && part >= TOLD; k++)
        if (row->at[k] >= 0) {
            L[k][(size_t)row->at[k] * (size_t)(ld + 1)] = own[k];
            part = fmin(part, factor_row(L[k], ld, row->at[k]));
        }
    return part;
}

/* rad/s: what lines of ROW and, with SIGN, of WITH or its mirror beat with at the slowest; 0: no
 * faster than the rounding of tones.  However slow it is else, a longer record would see it. */
static double beat_of(const struct torus_sheet *a, const struct torus_row *row, int sign,
                      const struct torus_row *with)
{
    const struct torus_tones *t = &a->s->tones;
    double turns = row->s + sign * with->s, beat = fabs(turns - round(turns)) * t->omega[t->lead];
    struct torus_index k, l;

    row_of(a, row->row, &k);
    row_of(a, with->row, &l);
    return beat > torus_rounding(t, k) + torus_rounding(t, l) ? beat : 0;
}

/* The slowest of ROW with those told. */
static double slowest_beat(const struct torus_sheet *a, const struct torus_row *row)
{
    double beat = HUGE_VAL;

    for (int r = 0; r < a->told; r++)
        beat = fmin(beat, fmin(beat_of(a, row, -1, &a->row[r]), beat_of(a, row, 1, &a->row[r])));
    return beat;
}

/* Rows by rising rank: those of two other tones are not in order as they stand. */
struct place { int rank, row; };

static int by_place(const void *a, const void *b)
{
    const struct place *x = a, *y = b;

    return x->rank != y->rank ? x->rank - y->rank : x->row - y->row;
}

/*
 * Of rows of ORDER what PART is in no other is all that is seen of one that is not told.  PAIR as
 * try_row has it: one that several rows have together, of tones whose beat is longer than the
 * record, is seen not at all, for as many lines may hide each other's.  BEAT: slowest_beat's.
 */
static void hide(struct torus_sheet *a, int order, double part, double pair, double beat)
{
    if (order >= TORUS_SHEET_ORDERS)
        return;
    a->nearest[order] = part < TOGETHER * pair ? 0 : fmin(a->nearest[order], sqrt(part));
    if (beat < torus_sheet_apart(&a->s->tones, TORUS_TURNS_MOST, a->settled))
        a->beats = order < a->beats ? order : a->beats;
}

/* The order of K; of one with a tone that no load has past all others, which what the record does
 * not tell from it is told as, and hide() knows nothing of it. */
static int rank_of(const struct torus_sheet *a, struct torus_index k)
{
    int order = torus_order(k);

    for (int j = 0; j < a->s->tones.count; j++)
        order += a->idle[j] && k.k[j] != 0 ? TORUS_SHEET_ORDERS : 0;
    return order;
}

/* Row number R as the next that may be told, its products with itself into OWN: with each column
 * of which there is anything. */
static struct torus_row next_row(const struct torus_sheet *a, int r, double own[KINDS])
{
    struct torus_row row = { .row = r };
    struct torus_index k;
    double s;

    row_of(a, r, &k);
    s = turns_of(a, k);
    row.whole = (int)lround(s);
    row.s = s - row.whole;
    products(a, &row, &row, own);
    for (int kind = 0; kind < KINDS; kind++) {
        bool none = own[kind] < 0.5 * TOLD;

        row.at[kind] = none ? -1 : a->columns[kind];
        row.real = row.real || none;
    }
    return row;
}

/* A->row, those that are told, and the factors of their products, LD a row, into L. */
static enum modal_status choose_rows(struct torus_sheet *a, double *const L[KINDS], int ld,
                                     struct modal_error *err)
{
    struct place *list = workspace_room(&a->space, (size_t)a->rows, sizeof *list);
    enum modal_status rc = workspace_check(&a->space, "torus: no memory for a record", err);

    for (int o = 0; o < TORUS_SHEET_ORDERS; o++)
        a->nearest[o] = 1;
    a->beats = TORUS_SHEET_ORDERS;
    a->told = a->columns[COSINE] = a->columns[SINE] = 0;
    for (int k = 0; rc == MODAL_OK && a->others[1] < 0 && k < 2 * a->rows; k++)
        a->mean[k] = mean_at(a, a->others[0] < 0 ? 0 : k * a->s->tones.nu[a->others[0]]);
    for (int r = 0; rc == MODAL_OK && r < a->rows; r++) {
        struct torus_index k;

        row_of(a, r, &k);
        list[r] = (struct place) { rank_of(a, k), r };
    }
    if (rc == MODAL_OK)
        qsort(list, (size_t)a->rows, sizeof *list, by_place);
    for (int r = 0; rc == MODAL_OK && r < a->rows; r++) {
        double own[KINDS], pair = 1, less, beat;
        struct torus_row row = next_row(a, list[r].row, own);
        double part = try_row(a, &row, own, L, ld, &pair);

        less = larger(2 * fmin(own[COSINE], own[SINE]), 0);
        if (part >= TOLD
            && TORUS_TURNS_A_ROW * (a->columns[COSINE] + a->columns[SINE] + 2)
                   <= 2 * a->turns) {
            a->row[a->told++] = row;
            for (int k = 0; k < KINDS; k++)
                a->columns[k] += row.at[k] >= 0;
            beat = beat_of(a, &row, 1, &row);
            if (row.real && beat > 0)     /* of it and its mirror one is told */
                hide(a, list[r].rank + 1, less, 0, beat);
        } else if ((beat = slowest_beat(a, &row)) > 0)
            hide(a, list[r].rank, row.real ? fmax(part, less) : part, pair, beat);
    }
    return rc;
}

/* The waves of A's columns of KIND, [column][turn]; their sums. */
static double *waves_of(const struct torus_sheet *a, int kind)
{
    return a->wave + (size_t)kind * (size_t)a->rows * (size_t)a->turns;
}

static double *sums_of(const struct torus_sheet *a, int kind)
{
    return a->sum + (size_t)kind * (size_t)a->rows * (size_t)(a->N * a->outputs);
}

/* The columns' waves of the rows told; WAVE: turns of room. */
static void fill_columns(struct torus_sheet *a, double complex *wave)
{
    for (int t = 0; t < a->told; t++) {
        const struct torus_row *row = &a->row[t];

        fill_wave(row->s, -0.5 * (a->turns - 1), 1, a->turns, wave);
        for (int k = 0; k < KINDS; k++)
            for (int r = 0; row->at[k] >= 0 && r < a->turns; r++)
                waves_of(a, k)[(size_t)row->at[k] * (size_t)a->turns + (size_t)r]
                    = k == COSINE ? creal(wave[r]) : -cimag(wave[r]);
    }
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
                double complex b = numbers_times(z[k + half], turn[(k - first) * (M / half)]);

                z[k + half] = z[k] - b;
                z[k] += b;
            }
}

/* e^{-pi i j / M}, j < M, into TURN. */
static void half_turn(size_t M, double complex *turn)
{
    fill_wave(-0.5 / (double)M, 0, 1, (int)M, turn);
}

/* (2)'s waves of row T's s within a turn into SLOW, N. */
static void slow_waves(const struct torus_sheet *a, int t, double complex *slow)
{
    fill_wave(a->row[t].s, -0.5, 1.0 / a->N, a->N, slow);
}

/* Where a->sum has the column of KIND of row T at the first sample of output I; NULL: none. */
static double *sum_at(const struct torus_sheet *a, int kind, int t, int i)
{
    int c = a->row[t].at[kind];
    size_t wide = (size_t)(a->N * a->outputs);

    return c < 0 ? NULL : sums_of(a, kind) + (size_t)c * wide + (size_t)i;
}

/* Where A has the N lines of row T and output I, by their leads modulo N. */
static double complex *lines_at(const struct torus_sheet *a, int t, int i)
{
    return a->Y + ((size_t)t * (size_t)a->outputs + (size_t)i) * (size_t)a->N;
}

/* (1) of what is left solved for z of all rows, L being the factors, and (2) for their lines, which
 * are added to A's; ROOM: 2 N. */
static void solve_rows(struct torus_sheet *a, double *const L[KINDS], int ld,
                       double complex *room)
{
    int wide = a->N * a->outputs, N = a->N;
    double complex *slow = room, *turn = room + N;

    for (int k = 0; k < KINDS; k++) {
        double *sum = sums_of(a, k);

        cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, a->columns[k], wide, a->turns,
                    1.0 / a->turns, waves_of(a, k), a->turns, a->left, wide, 0, sum, wide);
        for (int e = 0; e < 2; e++)
            cblas_dtrsm(CblasRowMajor, CblasLeft, CblasLower, e == 0 ? CblasNoTrans : CblasTrans,
                        CblasNonUnit, a->columns[k], wide, 1, L[k], ld, sum, wide);
    }
    half_turn((size_t)N, turn);
    for (int t = 0; t < a->told; t++) {
        slow_waves(a, t, slow);
        for (int i = 0; i < a->outputs; i++) {
            const double *even = sum_at(a, COSINE, t, i), *odd = sum_at(a, SINE, t, i);
            double complex *Y = lines_at(a, t, i), *z = a->z;

            for (int m = 0; m < N; m++) {
                int at = m * a->outputs;

                z[m] = numbers_times(CMPLX(even != NULL ? even[at] : 0, odd != NULL ? odd[at] : 0),
                              conj(slow[m]) / N);
            }
            transform(z, (size_t)N, turn);
            for (int m = 0; m < N; m++)
                Y[m] += z[m];
        }
    }
}

/* x less the lines in a->Y, into a->left; ROOM: 2 N. */
static void take_out(struct torus_sheet *a, double complex *room)
{
    int wide = a->N * a->outputs, N = a->N;
    double complex *slow = room, *turn = room + N, *z = a->z;

    half_turn((size_t)N, turn);
    for (int t = 0; t < a->told; t++) {
        slow_waves(a, t, slow);
        for (int i = 0; i < a->outputs; i++) {
            double *even = sum_at(a, COSINE, t, i), *odd = sum_at(a, SINE, t, i);
            const double complex *Y = lines_at(a, t, i);

            for (int m = 0; m < N; m++)        /* the transform back, by that of conjugates */
                z[m] = conj(Y[m]);
            transform(z, (size_t)N, turn);
            for (int m = 0; m < N; m++) {
                double complex at = numbers_times(conj(z[m]), slow[m]);

                if (even != NULL)
                    even[m * a->outputs] = creal(at);
                if (odd != NULL)
                    odd[m * a->outputs] = cimag(at);
            }
        }
    }
    memcpy(a->left, a->x, (size_t)wide * (size_t)a->turns * sizeof *a->left);
    for (int k = 0; k < KINDS; k++)
        cblas_dgemm(CblasRowMajor, CblasTrans, CblasNoTrans, a->turns, wide, a->columns[k], -1,
                    waves_of(a, k), a->turns, sums_of(a, k), wide, 1, a->left, wide);
}

/* What is left, under (3); its sum of squares then. */
static double weigh(struct torus_sheet *a)
{
    long samples = (long)a->N * a->turns;
    double sum = 0, *left = a->left;

    for (long n = 0; n < samples; n++) {
        double c = sin(M_PI * ((double)n + 0.5) / (double)samples), c2 = c * c;

        for (int i = 0; i < a->outputs; i++, left++) {
            *left *= 8.0 / 3 * c2 * c2;
            sum += *left * *left;
        }
    }
    return sum;
}

/* The lines of all rows, L being the factors, into a->Y; ROOM: 2 N. */
static void fit_rows(struct torus_sheet *a, double *const L[KINDS], int ld, double complex *room)
{
    size_t wide = (size_t)a->outputs * (size_t)a->N;
    double before = HUGE_VAL;

    memset(a->Y, 0, (size_t)a->told * wide * sizeof *a->Y);
    memcpy(a->left, a->x, wide * (size_t)a->turns * sizeof *a->left);
    if (a->settled)
        solve_rows(a, L, ld, room);
    for (int pass = 0; pass < PASSES && !a->settled; pass++) {
        double left = weigh(a);

        if (left > FALLS * FALLS * before)
            break;
        before = left;
        solve_rows(a, L, ld, room);
        take_out(a, room);
    }
    /* a real row has each line and its mirror; the mean is both */
    for (int t = 0; t < a->told; t++)
        for (size_t e = 0; a->row[t].real && e < wide; e++)
            lines_at(a, t, 0)[e] *= a->row[t].row == 0 && e % (size_t)a->N == 0 ? 1 : 2;
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

/* The line LEAD turns from row T's s, 2 |lead + s| < N.  Of a real row each is two combinations, of
 * which it is that of the lower order. */
static struct line line_of(const struct torus_sheet *a, int t, int lead)
{
    const struct torus_row *row = &a->row[t];
    struct line line = { .told = t, .bin = lead & (a->N - 1) };
    struct torus_index k;
    int own = lead - row->whole, mirror = -lead - (int)lround(2 * row->s) - row->whole;

    row_of(a, row->row, &k);
    k.k[a->s->tones.lead] = row->real && abs(mirror) < abs(own) ? mirror : own;
    line.k = torus_signed(&a->s->tones, k, &line.flipped);
    line.flipped = lead + row->s < 0;     /* Y stands for the frequency that it was read at */
    for (int i = 0; i < a->outputs; i++) {
        double complex Y = lines_at(a, t, i)[line.bin];

        line.size = larger(line.size, numbers_square(Y));
    }
    line.size = sqrt(line.size);
    return line;
}

/* Whether K is among the last lines below N / 2. */
static bool is_last(const struct torus_sheet *a, struct torus_index k)
{
    return 2 * turns_of(a, k) > (1 - LAST) * a->N;
}

/* The lines below N / 2 to be told into LIST, the mean and what is above LEAVE, no more than
 * LINES_MOST, by rising order: their count.  *FOLDED: the largest of the last, told or not. */
static int list_lines(struct torus_sheet *a, struct line *list, double leave, double *folded)
{
    int count = 0;

    for (int t = 0; t < a->told; t++)
        for (int lead = -a->N / 2; lead <= a->N / 2; lead++) {
            double f = lead + a->row[t].s;
            struct line *line = &list[count];

            if (2 * fabs(f) >= a->N || (a->row[t].real && f < 0))
                continue;
            *line = line_of(a, t, lead);
            if (is_last(a, line->k)) {
                a->last += line->size;
                *folded = larger(*folded, line->size);
            }
            line->size = torus_order(line->k) == 0 ? HUGE_VAL : line->size;
            count += line->size > leave;
        }
    if (count > LINES_MOST) {
        qsort(list, (size_t)count, sizeof *list, by_size);
        count = LINES_MOST;
    }
    qsort(list, (size_t)count, sizeof *list, by_order);
    return count;
}

/* The largest of the lines told, LIST, of ORDER and above; not the mean. */
static double largest_line(const struct torus_sheet *a, const struct line *list, int order)
{
    double size = 0;

    for (int l = 0; l < a->count; l++)
        if (torus_order(list[l].k) >= order && isfinite(list[l].size))
            size = fmax(size, list[l].size);
    return size;
}

/*
 * What a line may hide of another that the record does not tell from it, in m.  Of one of which the
 * root PART is left the most that is seen, LEFT, is as much; and it is no larger than the lines
 * told of its order and above.
 */
static double hidden(const struct torus_sheet *a, const struct line *list, double left)
{
    double most = 0;

    for (int order = 0; order < TORUS_SHEET_ORDERS; order++) {
        double size = a->nearest[order] < 1 ? largest_line(a, list, order) : 0;

        if (a->nearest[order] >= 1)
            continue;
        most = fmax(most, a->nearest[order] > 0 ? fmin(2 * size, left / a->nearest[order])
                                                : 2 * size);
    }
    return most;
}

/* The largest of output I of SIGNAL, over all of the record. */
static double largest(const struct torus_sheet *a, const double *signal, int i)
{
    double most = 0;

    for (long n = 0; n < (long)a->N * a->turns; n++)
        most = larger(most, fabs(signal[n * a->outputs + i]));
    return most;
}

/* The lines at LIST as a->index and a->X, from the record's middle to t = 0; a->Y has no others
 * then. */
static void tell_lines(struct torus_sheet *a, const struct line *list)
{
    const struct torus_tones *t = &a->s->tones;
    double middle = a->start + a->turns / 2 * 2 * M_PI / t->omega[t->lead];
    size_t K = (size_t)a->count;

    for (size_t l = 0; l < K; l++) {
        a->index[l] = list[l].k;
        for (int i = 0; i < a->outputs; i++)
            a->X[(size_t)i * K + l] = lines_at(a, list[l].told, i)[list[l].bin];
    }
    memset(a->Y, 0, (size_t)a->told * (size_t)(a->outputs * a->N) * sizeof *a->Y);
    for (size_t l = 0; l < K; l++) {
        double phase = fmod(torus_frequency(t, list[l].k) * middle, 2 * M_PI);
        double complex turn = CMPLX(cos(phase), -sin(phase));

        for (int i = 0; i < a->outputs; i++) {
            double complex *X = &a->X[(size_t)i * K + l];

            lines_at(a, list[l].told, i)[list[l].bin] = *X;
            *X = numbers_times(list[l].flipped ? conj(*X) : *X, turn);
        }
    }
}

/* The largest line of what no line explains, wherever it is.  Even and odd samples are one number
 * of half as many, z = x + i y, whose transforms are those of both: X_k + e^{-pi i k / M} Y_k is
 * the whole record's. */
static enum modal_status unexplained(struct torus_sheet *a, double *most, struct modal_error *err)
{
    size_t M = (size_t)a->N * (size_t)a->turns / 2, wide = (size_t)a->outputs;
    double complex *z = workspace_room(&a->space, M, sizeof *z),
                   *turn = workspace_room(&a->space, M, sizeof *turn);
    double largest = 0;
    enum modal_status rc = workspace_check(&a->space, "torus: no memory for a record", err);

    if (rc == MODAL_OK)
        half_turn(M, turn);
    for (size_t i = 0; rc == MODAL_OK && i < wide; i++) {
        if (!a->reported[i])
            continue;
        for (size_t n = 0; n < M; n++)
            z[n] = CMPLX(a->left[2 * n * wide + i], a->left[(2 * n + 1) * wide + i]);
        transform(z, M, turn);
        for (size_t k = 0; k < M; k++) {
            double complex p = z[k], q = conj(z[k > 0 ? M - k : 0]);
            double complex X = 0.5 * (p + q) + numbers_times(-0.5 * I * (p - q), turn[k]);

            largest = larger(largest, (k == 0 ? 1 : 4) * (creal(X) * creal(X)
                                                          + cimag(X) * cimag(X)));
        }
    }
    *most = sqrt(largest) / (2.0 * (double)M);
    return rc;
}

/* The lines of the record, LIST, into A, and what they leave of it: E's truncation, line and
 * folded.  ROOM: 2 N. */
static enum modal_status read_lines(struct torus_sheet *a, struct line *list, double leave,
                                    double complex *room, struct torus_errors *e,
                                    struct modal_error *err)
{
    enum modal_status rc;

    a->count = list_lines(a, list, leave, &e->folded);
    a->index = workspace_room(&a->space, (size_t)a->count, sizeof *a->index);
    a->X = workspace_room(&a->space, (size_t)(a->outputs * a->count), sizeof *a->X);
    rc = workspace_check(&a->space, "torus: no memory for a record", err);
    if (rc != MODAL_OK)
        return rc;
    tell_lines(a, list);
    take_out(a, room);
    for (int i = 0; i < a->outputs; i++)
        e->truncation = fmax(e->truncation, a->reported[i] ? largest(a, a->left, i) : 0);
    e->change = e->truncation;
    e->truncation = fmax(e->truncation, hidden(a, list, e->truncation));
    if (!a->settled)
        weigh(a), weigh(a);               /* what decays or drifts is no line */
    rc = unexplained(a, &e->line, err);
    e->line = fmax(e->line * (a->settled ? 1 : TWICE), 2 * largest_line(a, list, a->beats));
    return rc;
}

enum modal_status torus_sheet_read(struct torus_sheet *a, struct torus_errors *e, double *amplitude,
                                    struct modal_error *err)
{
    int ld = a->rows;
    size_t lines = (size_t)a->rows * ((size_t)a->N + 1), square = (size_t)ld * (size_t)ld;
    double *L[KINDS] = { workspace_room(&a->space, square, sizeof **L),
                         workspace_room(&a->space, square, sizeof **L) };
    struct line *list = workspace_room(&a->space, lines, sizeof *list);
    int longest = a->turns > 2 * a->N ? a->turns : 2 * a->N;
    double complex *room = workspace_room(&a->space, (size_t)longest, sizeof *room);
    enum modal_status rc = workspace_check(&a->space, "torus: no memory for a record", err);

    if (rc == MODAL_OK)
        rc = choose_rows(a, L, ld, err);
    if (rc != MODAL_OK)
        return rc;
    *amplitude = 0;
    for (int i = 0; i < a->outputs; i++)
        *amplitude = fmax(*amplitude, a->reported[i] ? largest(a, a->x, i) : 0);
    fill_columns(a, room);
    fit_rows(a, L, ld, room);
    rc = read_lines(a, list, FEWER * a->wanted * *amplitude, room, e, err);
    e->sampling = BEYOND * a->last;
    return rc;
}

double torus_sheet_apart(const struct torus_tones *t, int turns, bool settled)
{
    /* of two lines F turns of the record apart (2 pi F SPREAD)^2 is left */
    return sqrt(TOLD) / (2 * M_PI * (settled ? SPREAD : SPREAD_WEIGHED)) / turns
        * t->omega[t->lead];
}
