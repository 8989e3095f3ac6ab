/* bench_identify.c - processor time of the default identification, its answer checked against the
 * bound first
 *
 *   3 x 1200         6 poles, 40 dB
 *   20000 x 1000     12 poles, 60 dB
 *   100000 x 1000    12 poles, 60 dB; ratio to as many triad passes over the matrix as Lanczos
 *                    would take steps (16)
 *   4 GB             12 poles, 60 dB, mapped from a file, anonymous memory limited to 512 MB; only
 *                    with MODALD_BENCH_LARGE set
 *
 * {"bench","case","value","unit","peer","ratio","n"} a line: the median of n runs; `peer` is the
 * goal, or the triad.
 */
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>
#include "modal/identify/identify.h"
#include "../unit/signals.h"

enum { MODES = 6, RUNS_MOST = 31, LANCZOS_STEPS = 16 };
static const double frequency[MODES] = { 0.6, 1.1, 1.9, 2.7, 3.6, 4.8 },
                    damping[MODES] = { 0.01, 0.02, 0.005, 0.015, 0.01, 0.008 };
static const double dt = 0.05;

static double cpu(void *context)
{
    struct timespec t;

    (void)context;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int by_value(const void *a, const void *b)
{
    return (*(const double *)a > *(const double *)b) - (*(const double *)a < *(const double *)b);
}

static double median(double *x, int n)
{
    qsort(x, (size_t)n, sizeof *x, by_value);
    return x[n / 2];
}

/* Samples by channels; every channel its own amplitudes, all the same noise.  x must hold L * S
 * numbers. */
static void make(double *x, int L, int S, double snr_db, struct random *r)
{
    double complex *B = malloc(sizeof *B * MODES * (size_t)S), e[MODES];
    double sd = sqrt(MODES * pow(10, -snr_db / 10)), decay = 0;

    for (size_t i = 0; i < MODES * (size_t)S; i++)
        B[i] = CMPLX(random_normal(r), random_normal(r));
    for (int k = 0; k < L; k++)
        for (int j = 0; j < MODES; j++)
            decay += exp(2 * creal(decay_pole(frequency[j], damping[j])) * k * dt) / L / MODES;
    sd *= sqrt(decay);
    for (int k = 0; k < L; k++) {
        for (int j = 0; j < MODES; j++)
            e[j] = cexp(decay_pole(frequency[j], damping[j]) * (k * dt));
        for (int c = 0; c < S; c++) {
            double sum = 0;
            for (int j = 0; j < MODES; j++)
                sum += creal(B[j + MODES * (size_t)c]) * creal(e[j]) -
                       cimag(B[j + MODES * (size_t)c]) * cimag(e[j]);
            x[(size_t)k * (size_t)S + (size_t)c] = sum + sd * random_normal(r);
        }
    }
    free(B);
}

/* Every exponent within five of its stated standard errors, and none besides. */
static bool right(const struct identify_result *r, int modes, const double complex *truth)
{
    if (r->mode_count != modes)
        return false;
    for (int j = 0; j < modes; j++) {
        int b = 0;
        for (int i = 1; i < modes; i++)
            if (cabs(r->modes[i].exponent - truth[j]) < cabs(r->modes[b].exponent - truth[j]))
                b = i;
        double complex e = r->modes[b].exponent - truth[j];
        if (!(fabs(creal(e)) < 5 * r->modes[b].std_re && fabs(cimag(e)) < 5 * r->modes[b].std_im))
            return false;
    }
    return true;
}

/* The median over RUNS; < 0: a wrong answer, which has no time. */
static double identify(const struct batch *b, int modes, const double complex *truth, int runs)
{
    double seconds[RUNS_MOST];

    for (int i = 0; i < runs; i++) {
        struct identify_options opt = { .clock = cpu };
        struct identify_result r;
        struct modal_error err;
        double start = cpu(NULL);
        if (modal_identify(b, &opt, &r, &err) != MODAL_OK) {
            fprintf(stderr, "bench_identify: %s\n", err.message);
            return -1;
        }
        seconds[i] = cpu(NULL) - start;
        bool ok = right(&r, modes, truth);
        identify_result_done(&r);
        if (!ok) {
            fprintf(stderr, "bench_identify: the answer is wrong\n");
            return -1;
        }
    }
    return median(seconds, runs);
}

static int print(const char *what, double value, const char *peer, double ratio, int n)
{
    char text[32] = "null";

    if (value < 0)
        return 1;
    if (isfinite(ratio))
        snprintf(text, sizeof text, "%.4g", ratio);
    printf("{\"bench\":\"identify\",\"case\":\"%s\",\"value\":%.6g,\"unit\":\"s CPU\","
           "\"peer\":\"%s\",\"ratio\":%s,\"n\":%d}\n",
           what, value, peer, text, n);
    fflush(stdout);
    return 0;
}

static int small(void)
{
    static double column[3600], x[3600];
    struct random r = { 1 };
    struct decay d;

    decay_of_case(&decay_cases[3], &r, &d);
    decay_signals(&d, column, 1200);
    decay_noise(&d, column, 1200, 40, &r);
    for (int k = 0; k < 1200; k++)
        for (int c = 0; c < 3; c++)
            x[3 * k + c] = column[k + 1200 * c];
    struct batch b = { .samples = 1200, .channels = 3, .signals = x, .dt = d.dt };
    double seconds = identify(&b, 3, d.lambda, RUNS_MOST);
    return print("3 x 1200, 6 poles, 40 dB", seconds, "goal 5 ms", seconds / 0.005, RUNS_MOST);
}

/* One pass of a[i] = b[i] + s c[i], 24 bytes an entry, over arrays of the matrix' size: scaled up
 * from a part. */
static double triad(size_t entries)
{
    size_t part = entries > 20000000 ? 20000000 : entries;
    double *a = malloc(sizeof *a * part), *b = malloc(sizeof *a * part),
           *c = malloc(sizeof *a * part), seconds[5];

    for (size_t i = 0; i < part; i++)
        a[i] = 0, b[i] = 1, c[i] = 2;
    for (int k = 0; k < 5; k++) {
        double start = cpu(NULL);
        for (size_t i = 0; i < part; i++)
            a[i] = b[i] + 3.1 * c[i];
        seconds[k] = cpu(NULL) - start;
    }
    volatile double keep = a[part / 2];
    (void)keep;
    free(a), free(b), free(c);
    return median(seconds, 5) * (double)entries / (double)part;
}

static void truths(double complex *truth)
{
    for (int j = 0; j < MODES; j++)
        truth[j] = decay_pole(frequency[j], damping[j]);
}

static int large(int S, const char *what, double goal, int runs)
{
    double *x = malloc(sizeof *x * (size_t)S * 1000), seconds, steps;
    double complex truth[MODES];
    struct random r = { 5 };
    int bad;

    if (x == NULL)
        return 1;
    truths(truth);
    make(x, 1000, S, 60, &r);
    struct batch b = { .samples = 1000, .channels = (size_t)S, .signals = x, .dt = dt };
    seconds = identify(&b, MODES, truth, runs);
    if (goal > 0) {
        bad = print(what, seconds, "goal 0.35 s", seconds / goal, runs);
    } else {
        steps = LANCZOS_STEPS * triad((size_t)S * 1000);
        bad = print(what, seconds, "triad passes, one a Lanczos step", seconds / steps, runs);
    }
    free(x);
    return bad;
}

/* 5000 samples of 100000 channels, mapped; written a block at a time so that making it needs no
 * memory either. */
static int mapped(void)
{
    enum { L = 5000, S = 100000, BLOCK = 50 };
    const size_t bytes = sizeof(double) * (size_t)L * S;
    char path[] = "bench_identify_XXXXXX";
    struct rlimit limit = { 512u << 20, 512u << 20 };
    int file = mkstemp(path), bad = 1;
    double complex truth[MODES], e[MODES];
    double *block = malloc(sizeof *block * BLOCK * (size_t)S),
           *B = malloc(sizeof *B * 2 * MODES * (size_t)S);
    struct random r = { 9 };

    unlink(path);
    truths(truth);
    for (size_t i = 0; i < 2 * MODES * (size_t)S; i++)
        B[i] = random_normal(&r);
    for (int k0 = 0; k0 < L; k0 += BLOCK) {
        for (int k = 0; k < BLOCK; k++) {
            for (int j = 0; j < MODES; j++)
                e[j] = cexp(truth[j] * ((k0 + k) * dt));
            for (size_t c = 0; c < S; c++) {
                double sum = 1e-3 * random_normal(&r);
                for (int j = 0; j < MODES; j++)
                    sum += B[2 * (j + MODES * c)] * creal(e[j]) -
                           B[2 * (j + MODES * c) + 1] * cimag(e[j]);
                block[(size_t)k * S + c] = sum;
            }
        }
        if (write(file, block, sizeof *block * BLOCK * (size_t)S) !=
            (ssize_t)(sizeof *block * BLOCK * (size_t)S))
            goto out;
    }
    free(block), free(B);
    block = B = NULL;
    setrlimit(RLIMIT_DATA, &limit);
    const double *x = mmap(NULL, bytes, PROT_READ, MAP_SHARED, file, 0);
    if (x == MAP_FAILED)
        goto out;
    struct batch b = { .samples = L, .channels = S, .signals = x, .dt = dt };
    double seconds = identify(&b, MODES, truth, 1);
    bad = print("4 GB, mapped, 512 MB of memory", seconds, "none", NAN, 1);
out:
    free(block), free(B);
    close(file);
    return bad;
}

int main(void)
{
    int bad = small() + large(20000, "20000 x 1000, 12 poles, 60 dB", 0.35, 5) +
              large(100000, "100000 x 1000, 12 poles, 60 dB", 0, 3);

    if (getenv("MODALD_BENCH_LARGE") != NULL)
        bad += mapped();
    return bad > 0;
}
