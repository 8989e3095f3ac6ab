/* torus.c - see torus.h; tested by tests/unit/modal/steady/test_torus.c */
#include "modal/steady/torus.h"
#include <fftw3.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"

enum {
    AFRESH = 32,                            /* products of a wave: their rounding is some 1e-15 */
    PAD = 4,                                /* numbers, a line of a cache: rows a power of two apart
                                             * would all be in the same few of its places, and
                                             * transforms across 256 take 15 times as long */
};
static const double SAME = 4 * DBL_EPSILON; /* of a tone, as torus_fold.c has it */
static const double NOTHING = 1e-13;        /* of a sum of frequencies: its rounding */

struct torus_grid {
    struct torus_tones tones;
    int N, lines, size[TORUS_TONES_MOST];   /* size of the lead: N */
    int apart;                              /* rows of x */
    int other[TORUS_TONES_MOST - 1];        /* the tones but the lead; unused: -1 */
    fftw_complex *x;                        /* [line][N, then PAD] */
    fftw_plan along_back, across_back, along, across;   /* in place */
};

struct torus_tones torus_tones_of(const double *omega, int count)
{
    struct torus_tones t = { .count = count };

    for (int j = 0; j < count; j++) {
        t.omega[j] = omega[j];
        t.lead = omega[j] > omega[t.lead] ? j : t.lead;
    }
    for (int j = 0; j < count; j++)
        t.nu[j] = omega[j] / omega[t.lead];
    return t;
}

void torus_tones_move(struct torus_tones *t, int j, double omega)
{
    t->omega[j] = omega;
    for (int i = 0; i < t->count; i++)
        t->nu[i] = t->omega[i] / t->omega[t->lead];
}

double torus_frequency(const struct torus_tones *t, struct torus_index k)
{
    double sum = 0;

    for (int j = 0; j < t->count; j++)
        sum += k.k[j] * t->omega[j];
    return sum;
}

double torus_rounding(const struct torus_tones *t, struct torus_index k)
{
    double sum = 0;

    for (int j = 0; j < t->count; j++)
        sum += abs(k.k[j]) * t->omega[j];
    return SAME * sum;
}

int torus_order(struct torus_index k)
{
    return abs(k.k[0]) + abs(k.k[1]) + abs(k.k[2]);
}

bool torus_equal(struct torus_index a, struct torus_index b)
{
    return a.k[0] == b.k[0] && a.k[1] == b.k[1] && a.k[2] == b.k[2];
}

bool torus_told(const struct torus_tones *t, struct torus_index k)
{
    double Omega = torus_frequency(t, k);

    if (fabs(Omega) > NOTHING * torus_order(k) * t->omega[t->lead])
        return Omega > 0;
    for (int j = 0; j < t->count; j++)
        if (k.k[j] != 0)
            return k.k[j] > 0;
    return true;
}

struct torus_index torus_signed(const struct torus_tones *t, struct torus_index k, bool *flipped)
{
    *flipped = !torus_told(t, k);
    return *flipped ? (struct torus_index) { { -k.k[0], -k.k[1], -k.k[2] } } : k;
}

/* Lines go [last tone][first], each contiguous in theta. */
enum modal_status torus_grid_new(const struct torus_tones *t, int N, const int *lines,
                                 struct torus_grid **out, struct modal_error *err)
{
    struct torus_grid *g = calloc(1, sizeof *g);
    int across[TORUS_TONES_MOST - 1], rank = 0;

    if (g == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
    *g = (struct torus_grid) { .tones = *t, .N = N, .lines = 1, .apart = N + PAD,
                               .other = { -1, -1 } };
    for (int j = 0; j < t->count; j++) {
        g->size[j] = j == t->lead ? N : lines[j];
        if (j != t->lead) {
            g->lines *= lines[j];
            g->other[rank++] = j;
        }
    }
    for (int r = 0; r < rank; r++)                     /* FFTW's rows first: the last tone */
        across[r] = g->size[g->other[rank - 1 - r]];
    g->x = fftw_alloc_complex((size_t)g->lines * (size_t)g->apart);
    if (g->x != NULL) {
        int A = g->apart;

        g->along_back = fftw_plan_many_dft(1, &N, g->lines, g->x, NULL, 1, A, g->x, NULL, 1, A,
                                           FFTW_BACKWARD, FFTW_ESTIMATE);
        g->along = fftw_plan_many_dft(1, &N, g->lines, g->x, NULL, 1, A, g->x, NULL, 1, A,
                                      FFTW_FORWARD, FFTW_ESTIMATE);
        g->across_back = fftw_plan_many_dft(rank, across, N, g->x, NULL, A, 1, g->x, NULL, A, 1,
                                            FFTW_BACKWARD, FFTW_ESTIMATE);
        g->across = fftw_plan_many_dft(rank, across, N, g->x, NULL, A, 1, g->x, NULL, A, 1,
                                       FFTW_FORWARD, FFTW_ESTIMATE);
    }
    if (g->along == NULL || g->across == NULL || g->along_back == NULL || g->across_back == NULL) {
        torus_grid_free(g);
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for %d lines of %d samples",
                          g->lines, N);
    }
    *out = g;
    return MODAL_OK;
}

void torus_grid_free(struct torus_grid *g)
{
    if (g == NULL)
        return;
    if (g->along_back != NULL)
        fftw_destroy_plan(g->along_back);
    if (g->across_back != NULL)
        fftw_destroy_plan(g->across_back);
    if (g->along != NULL)
        fftw_destroy_plan(g->along);
    if (g->across != NULL)
        fftw_destroy_plan(g->across);
    fftw_free(g->x);
    free(g);
}

void torus_grid_retune(struct torus_grid *g, const struct torus_tones *t) { g->tones = *t; }
int torus_grid_samples(const struct torus_grid *g) { return g->N; }
int torus_grid_lines(const struct torus_grid *g) { return g->lines; }

/* Which of the lines along tone j line LINE is; 0 for the lead. */
static int place_of(const struct torus_grid *g, int line, int j)
{
    if (j == g->tones.lead)
        return 0;
    return j == g->other[0] ? line % g->size[j] : line / g->size[g->other[0]];
}

double torus_grid_phase(const struct torus_grid *g, int line, int j)
{
    return 2 * M_PI * place_of(g, line, j) / g->size[j];
}

/* Whether (1)'s combination K is one that the grid tells from the others. */
static bool torus_grid_holds(const struct torus_grid *g, struct torus_index k)
{
    for (int j = 0; j < g->tones.count; j++)
        if (2 * abs(k.k[j]) >= g->size[j])
            return false;
    return true;
}

/* -N/2 < signed <= N/2 of an index modulo N. */
static int signed_of(int i, int N) { return i > N / 2 ? i - N : i; }

/* Where combination K stands in x, modulo the grid. */
static size_t spot_of(const struct torus_grid *g, struct torus_index k)
{
    size_t line = 0;

    for (int j = g->tones.count - 1; j >= 0; j--)
        if (j != g->tones.lead)
            line = line * (size_t)g->size[j]
                + (size_t)(((k.k[j] % g->size[j]) + g->size[j]) % g->size[j]);
    return line * (size_t)g->apart + (size_t)(((k.k[g->tones.lead] % g->N) + g->N) % g->N);
}

int torus_grid_indices(const struct torus_grid *g, struct torus_index *out)
{
    int count = 0;

    for (int line = 0; line < g->lines; line++)
        for (int n = 0; n < g->N; n++) {
            struct torus_index k = { { 0 } };

            for (int j = 0; j < g->tones.count; j++)
                k.k[j] = signed_of(j == g->tones.lead ? n : place_of(g, line, j), g->size[j]);
            if (torus_grid_holds(g, k) && torus_told(&g->tones, k))
                out[count++] = k;
        }
    return count;
}

/* Of line LINE as a harmonic in phi: nu . k, the shear of (2). */
static double shear_of(const struct torus_grid *g, int line)
{
    double sum = 0;

    for (int j = 0; j < g->tones.count; j++)
        if (j != g->tones.lead)
            sum += g->tones.nu[j] * signed_of(place_of(g, line, j), g->size[j]);
    return sum;
}

static fftw_complex *row_at(const struct torus_grid *g, int line)
{
    return g->x + (size_t)line * (size_t)g->apart;
}

/* Row LINE times e^{i sign shear (theta_n + 2 pi turn)}. */
static void turn_row(struct torus_grid *g, int line, int sign, int turn)
{
    double shear = sign * shear_of(g, line), step = 2 * M_PI * shear / g->N;
    double whole = fmod(shear, 1);                     /* 2 pi turn shear, less whole turns */
    double complex *x = row_at(g, line), wave = 1;
    double complex advance = CMPLX(cos(step), sin(step));

    if (shear == 0)
        return;
    for (int n = 0; n < g->N; n++) {
        wave = n % AFRESH == 0 ? cexp(I * (step * n + 2 * M_PI * fmod(whole * turn, 1)))
                               : wave * advance;
        x[n] = numbers_times(x[n], wave);
    }
}

/* From combinations in their spots to samples. */
static void execute_back(struct torus_grid *g, int turn)
{
    fftw_execute(g->along_back);
    for (int line = 0; line < g->lines; line++)
        turn_row(g, line, 1, turn);
    fftw_execute(g->across_back);
}

void torus_synthesize(struct torus_grid *g, int count, const struct torus_index *index,
                      const double complex *X, double *x)
{
    memset(g->x, 0, (size_t)g->lines * (size_t)g->apart * sizeof *g->x);
    for (int i = 0; i < count; i++)
        g->x[spot_of(g, index[i])] = X[i];
    execute_back(g, 0);
    for (int line = 0; line < g->lines; line++)
        for (int n = 0; n < g->N; n++)
            *x++ = creal(row_at(g, line)[n]);
}

void torus_synthesize_both(struct torus_grid *g, int count, const struct torus_index *index,
                           const double complex *X, int turn, double *x, double *v)
{
    double lead = g->tones.omega[g->tones.lead];

    memset(g->x, 0, (size_t)g->lines * (size_t)g->apart * sizeof *g->x);
    for (int i = 0; i < count; i++) {     /* of x + i v / w_lead, alike in size: k and -k */
        struct torus_index k = index[i], minus = { { -k.k[0], -k.k[1], -k.k[2] } };
        double turns = torus_frequency(&g->tones, k) / lead;

        g->x[spot_of(g, k)] += 0.5 * (1 - turns) * X[i];
        g->x[spot_of(g, minus)] += 0.5 * (1 + turns) * conj(X[i]);
    }
    execute_back(g, turn);
    for (int line = 0; line < g->lines; line++)
        for (int n = 0; n < g->N; n++) {
            *x++ = creal(row_at(g, line)[n]);
            *v++ = lead * cimag(row_at(g, line)[n]);
        }
}

void torus_analyze(struct torus_grid *g, const double *x)
{
    size_t points = (size_t)g->lines * (size_t)g->N;

    for (int line = 0; line < g->lines; line++)
        for (int n = 0; n < g->N; n++)
            row_at(g, line)[n] = *x++ / (double)points;
    fftw_execute(g->across);
    for (int line = 0; line < g->lines; line++)
        turn_row(g, line, -1, 0);
    fftw_execute(g->along);
}

double complex torus_coefficient(const struct torus_grid *g, struct torus_index k)
{
    return g->x[spot_of(g, k)];
}
