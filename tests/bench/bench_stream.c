/*
 * bench_stream.c - what modald_push costs its host: 1, 8 and 64 channels, against two reads of the
 * clock
 *
 * Each push stands between two clock reads; the same loop without the push is the floor, and each
 * figure is above the floor's own: median above median, 99th percentile above 99th percentile.  The
 * pushes go round a ring that was never written to before, nearly once (the worst case: each of its
 * pages is new), as fast as they can, beside the sender that reads them.  Needs a daemon at
 * $MODALD_URL, or none: the ring takes the samples either way; with $MODALD_RING_FILE the ring is
 * in that file.  With --marked it only pushes, between two marks on stderr that a trace of system
 * calls shows, and measures nothing.
 *
 *     push_p50, push_p99   ns above the floor's (goal: p99 < 100 with 8 channels).  A processor's
 *                          clock may take steps as long as a push, which meet it anywhere: of each
 *                          quantile the mean is taken of what is within half of a percent of it
 *     ..., one a us        the same of pushes that come one a microsecond: the lines one writes
 *                          are not on their way from the sender's processor still
 *     push_counted         instructions of a push, on average, where the machine counts them
 *     noop                 ns of a push without a stream (goal: about 2)
 *     step_1us             ns that a push adds to a step of 1 us whose results it takes as they
 *                          come (goal: < 100): median of blocks of BLOCK steps, with the push and
 *                          without it in turns, so that a block that was interrupted counts for
 *                          neither
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "../../clients/c/modald_stream.h"
#include "counted.h"

enum { CHANNELS = 8, CHANNELS_MOST = 64, N = 100000, MARKED = 20000, BLOCK = 100, BLOCKS = 900 };

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

static void sort(double *took, int count)
{
    qsort(took, (size_t)count, sizeof *took, ascending);
}

/* COUNT intervals around a push to S (WORK 0: around nothing), which begin PACE ns one after the
 * other, or as soon as they can. */
static void run_all(modald_stream *s, int work, double pace, double *took, int count)
{
    double y[CHANNELS_MOST] = { 2.385 };

    for (int i = 0; i < count; i++) {
        double before = ns();
        if (work)
            modald_push(s, y);
        took[i] = ns() - before;
        y[0] += 1e-3;
        while (pace > 0 && ns() < before + pace)
            ;
    }
}

/* The quantile Q of the COUNT that TOOK has, sorted. */
static double quantile(const double *took, int count, double q)
{
    const int half = count / 200, at = (int)(q * count);
    double sum = 0;

    for (int i = at - half; i < at + half; i++)
        sum += took[i];
    return sum / (2 * half);
}

static volatile double computed = 1;

/* Seconds of a block of steps of LENGTH operations, each of which waits for the one before, pushed
 * to S. */
static double block(modald_stream *s, double *y, int length)
{
    double before = ns();

    for (int i = 0; i < BLOCK; i++) {
        double z = computed;
        for (int k = 0; k < length; k++)
            z = z * 1.0000001 + 1e-9;
        computed = z;
        for (int k = 0; k < CHANNELS; k++)
            y[k] = z + k;
        modald_push(s, y);
    }
    return (ns() - before) / BLOCK;
}

static void say(const char *name, int channels, const char *pace, double value, double floor_value,
                int count)
{
    printf("{\"bench\":\"stream\",\"case\":\"%s %d channels%s\",\"value\":%.1f,\"unit\":\"ns\","
           "\"peer\":\"two clock reads\",\"ratio\":%.3f,\"n\":%d}\n",
           name, channels, pace, value, value / floor_value, count);
}

/* As many pushes as the ring holds with some to spare; 1: not all of them were taken, and a figure
 * for work not done is no figure. */
static int bench(int channels, double pace, int counter, double *base, double *push, double *noop)
{
    const char *paced = pace > 0 ? ", one a us" : "";
    double begun, alone, whole, half;
    char name[32];
    int count = (8 << 20) / 8 / (channels + 2) / 100 * 95;
    struct modald_report r;
    modald_stream *s;

    count = count < N ? count : N;
    snprintf(name, sizeof name, "bench%d", channels);
    s = modald_open(name, channels, 1e-3);
    if (s == NULL)
        return 1;
    begun = counted(counter);
    run_all(s, 0, pace, base, count);
    alone = counted(counter) - begun;
    sort(base, count);
    begun = counted(counter);
    run_all(s, 1, pace, push, count);
    whole = counted(counter) - begun;
    run_all(NULL, 1, 0, noop, count);
    sort(push, count), sort(noop, count);
    modald_get_report(s, &r);
    modald_close(s);
    half = quantile(base, count, 0.5);
    say("push_p50", channels, paced, quantile(push, count, 0.5) - half, half, count);
    say("push_p99", channels, paced,
        quantile(push, count, 0.99) - quantile(base, count, 0.99), half, count);
    if (channels == CHANNELS && pace == 0)
        say("noop", channels, "", quantile(noop, count, 0.5) - half, half, count);
    if (counter >= 0 && pace == 0)
        printf("{\"bench\":\"stream\",\"case\":\"push_counted %d channels\",\"value\":%.1f,"
               "\"unit\":\"instructions\",\"peer\":\"two clock reads\",\"ratio\":%.3f,"
               "\"n\":%d}\n", channels, (whole - alone) / count, whole / alone, count);
    return r.pushed != count || r.dropped != 0;
}

static int push_marked(void)
{
    double y[CHANNELS] = { 2.385 };
    modald_stream *s = modald_open("bench", CHANNELS, 1e-3);

    if (s == NULL || write(2, "BEGIN\n", 6) != 6)
        return 1;
    for (int i = 0; i < MARKED; i++)
        modald_push(s, y);
    if (write(2, "END\n", 4) != 4)
        return 1;
    modald_close(s);
    return 0;
}

/* A step of about 1 us, with the push and without. */
static int bench_step(double *base, double *push)
{
    double y[CHANNELS];
    int length = 500;
    struct modald_report r;
    modald_stream *s = modald_open("step", CHANNELS, 1e-3);

    if (s == NULL)
        return 1;
    for (int i = 0; i < 20; i++)
        base[i] = block(NULL, y, length);
    qsort(base, 20, sizeof *base, ascending);
    length = (int)(1000 * length / base[10]);
    for (int i = 0; i < BLOCKS; i++) {
        base[i] = block(NULL, y, length);
        push[i] = block(s, y, length);
    }
    modald_get_report(s, &r);
    modald_close(s);
    qsort(base, BLOCKS, sizeof *base, ascending);
    qsort(push, BLOCKS, sizeof *push, ascending);
    say("step_1us", CHANNELS, "", push[BLOCKS / 2] - base[BLOCKS / 2], base[BLOCKS / 2],
        BLOCK * BLOCKS);
    return r.pushed != BLOCK * BLOCKS || r.dropped != 0;
}

int main(int argc, char **argv)
{
    static const int channels[] = { CHANNELS, 1, CHANNELS_MOST };
    static double base[N], push[N], noop[N];
    int bad = 0, counter = counted_open();

    setenv("MODALD_URL", "ipc:///nonexistent/modald", 0);
    setenv("MODALD_SPILL_MAX", "0", 0);
    setenv("MODALD_CLOSE_WAIT", "0.1", 0);
    if (argc > 1 && strcmp(argv[1], "--marked") == 0)
        return push_marked();
    for (int i = 0; i < N; i++)   /* their pages too are there in both loops */
        base[i] = push[i] = noop[i] = 1;
    for (size_t i = 0; i < sizeof channels / sizeof channels[0]; i++)
        bad |= bench(channels[i], 0, counter, base, push, noop)
             | bench(channels[i], 1000, counter, base, push, noop);
    return bad | bench_step(base, push);
}
