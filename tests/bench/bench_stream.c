/*
 * bench_stream.c - what modald_push costs its host: 8 channels, against two reads of the clock
 *
 * Each of N pushes stands between two clock reads; the same loop without the push is the floor.  Needs a daemon at
 * $MODALD_URL, or none: the ring takes the samples either way.  With --marked it only pushes, between two marks on stderr
 * that a trace of system calls shows, and measures nothing.
 *
 *     push_p50, push_p99   ns above the floor's median (goal: p99 < 100)
 *     noop                 ns of a push without a stream (goal: about 2)
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "../../clients/c/modald_stream.h"

enum { CHANNELS = 8, N = 100000, MARKED = 20000 };

static double ns(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

/* N intervals around WORK (NULL: nothing), sorted. */
static void measure(modald_stream *s, int work, double *took)
{
    double y[CHANNELS] = { 2.385 };

    for (int i = 0; i < N; i++) {
        double before = ns();
        if (work)
            modald_push(s, y);
        took[i] = ns() - before;
        y[0] += 1e-3;
    }
    qsort(took, N, sizeof *took, ascending);
}

static void say(const char *name, double value, double floor_value)
{
    printf("{\"bench\":\"stream\",\"case\":\"%s 8 channels\",\"value\":%.1f,\"unit\":\"ns\",\"peer\":\"two clock reads\",\"ratio\":%.3f,\"n\":%d}\n", name, value,
           value / floor_value, N);
}

static int push_marked(modald_stream *s)
{
    double y[CHANNELS] = { 2.385 };

    if (write(2, "BEGIN\n", 6) != 6)
        return 1;
    for (int i = 0; i < MARKED; i++)
        modald_push(s, y);
    if (write(2, "END\n", 4) != 4)
        return 1;
    modald_close(s);
    return 0;
}

int main(int argc, char **argv)
{
    double *base = malloc(N * sizeof *base), *push = malloc(N * sizeof *push), *noop = malloc(N * sizeof *noop);
    modald_stream *s;

    setenv("MODALD_URL", "ipc:///nonexistent/modald", 0);
    setenv("MODALD_SPILL_MAX", "0", 0);
    setenv("MODALD_CLOSE_WAIT", "0.1", 0);
    s = modald_open("bench", CHANNELS, 1e-3);
    if (s == NULL || base == NULL || push == NULL || noop == NULL)
        return 1;
    if (argc > 1 && strcmp(argv[1], "--marked") == 0) {
        free(base);
        free(push);
        free(noop);
        return push_marked(s);
    }
    measure(s, 0, base);
    measure(s, 1, push);
    measure(NULL, 1, noop);
    struct modald_report r;
    modald_get_report(s, &r);
    if (r.pushed != N || r.dropped != 0)
        return 1;                                      /* a figure for work not done is no figure */
    say("push_p50", push[N / 2] - base[N / 2], base[N / 2]);
    say("push_p99", push[N - N / 100] - base[N - N / 100], base[N / 2]);
    say("noop", noop[N / 2] - base[N / 2], base[N / 2]);
    modald_close(s);
    free(base);
    free(push);
    free(noop);
    return 0;
}
