/*
 * many_streams.c - a host with many running simulations: what their streams cost it, how old their
 * live results are
 *
 *     many_streams STREAMS CHANNELS RATE SECONDS [FOLDER [FIRST [KIND]]]
 *
 * Each stream many-K, K from FIRST (0) on, is an oscillator of two modes, sampled RATE times a
 * second of real time, each at its own phase of the clock.  KIND driven (default): by noise, so
 * that no window settles and each is found from nothing; free: they swing on, and windows are
 * brought up to date.  Every second, and once all is closed, a line on stdout:
 *
 *     {"s","streams","pushed","acknowledged","dropped","spilled","refused",   of all of them
 *      "live",                             streams that have a live result
 *      "age_s":[least,median,most],        of their last results, in seconds of samples
 *      "threads","rss_kb",                 more than before the first was opened
 *      "closed":bool}
 *
 * With FOLDER, unless it is empty, each stream's samples go to FOLDER/many-K too.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "../../clients/c/modald_stream.h"

enum { MODES = 2, CHANNELS_MOST = 64, STREAMS_MOST = 4096 };

struct simulation {
    modald_stream *s;
    FILE *log;
    long pushed;
    unsigned long long dice;
    double x[MODES][2];                                  /* of each mode the last two states */
};

static struct simulation all[STREAMS_MOST];
static int streams, channels;
static double shape[MODES][CHANNELS_MOST];               /* of each mode, in each channel */
static double turn[MODES], shrink[MODES];                /* of each mode, from sample to sample */
static double rate;
static int is_free, is_read;

static double now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Between -1 and 1, uniform (xorshift64*). */
static double noise(struct simulation *of)
{
    of->dice ^= of->dice >> 12;
    of->dice ^= of->dice << 25;
    of->dice ^= of->dice >> 27;
    return (double)((of->dice * 0x2545f4914f6cdd1dULL) >> 11) * 0x1p-52 - 1;
}

/* Modes of a tenth and a fifth of the rate, of 1 % of critical damping where they are driven, of
 * none where they are free: once for all, since a simulation of 64 channels at 10 kHz has no time
 * for sines beside the daemon that is measured. */
static void set_modes(void)
{
    const double tau = 6.283185307179586;

    for (int m = 0; m < MODES; m++) {
        double w = tau * (m + 1) / 10, radius = is_free ? 1 : exp(-0.01 * w);
        turn[m] = 2 * radius * cos(w);
        shrink[m] = radius * radius;
    }
    for (int c = 0; c < CHANNELS_MOST; c++) {
        shape[0][c] = cos(c);
        shape[1][c] = sin(1 + c);
    }
}

/* The next sample. */
static void step(struct simulation *of, double *y)
{
    for (int m = 0; m < MODES; m++) {
        double x = turn[m] * of->x[m][0] - shrink[m] * of->x[m][1] + (is_free ? 0 : noise(of));
        of->x[m][1] = of->x[m][0];
        of->x[m][0] = x;
    }
    for (int c = 0; c < channels; c++)
        y[c] = of->x[0][0] * shape[0][c] + of->x[1][0] * shape[1][c] + 0.01 * noise(of);
}

/* What of /proc/self/status has the name KEY. */
static long status_of(const char *key)
{
    FILE *file = fopen("/proc/self/status", "r");
    char line[256];
    long value = 0;

    while (file != NULL && fgets(line, sizeof line, file) != NULL)
        if (strncmp(line, key, strlen(key)) == 0)
            value = strtol(line + strlen(key), NULL, 10);
    if (file != NULL)
        fclose(file);
    return value;
}

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

static struct modald_report sum;

/* The line; THREADS and RSS were there before. */
static void tell(double s, long threads, long rss)
{
    static double ages[STREAMS_MOST];
    struct modald_report r;
    struct modald_estimate e;
    int live = 0;

    memset(&sum, 0, sizeof sum);
    for (int k = 0; k < streams; k++) {
        modald_get_report(all[k].s, &r);
        sum.pushed += r.pushed;
        sum.acknowledged += r.acknowledged;
        sum.dropped += r.dropped;
        sum.spilled += r.spilled;
        sum.refused += r.refused;
        if (modald_get_estimate(all[k].s, &e))
            ages[live++] = (r.pushed - 1 - e.sample) / rate;
    }
    qsort(ages, (size_t)live, sizeof *ages, ascending);
    printf("{\"s\":%.1f,\"streams\":%d,\"pushed\":%.0f,\"acknowledged\":%.0f,\"dropped\":%.0f,"
           "\"spilled\":%.0f,\"refused\":%.0f,\"live\":%d,", s, streams, sum.pushed,
           sum.acknowledged, sum.dropped, sum.spilled, sum.refused, live);
    printf("\"age_s\":[%.3f,%.3f,%.3f],\"threads\":%ld,\"rss_kb\":%ld,\"closed\":false}\n",
           live ? ages[0] : -1, live ? ages[live / 2] : -1, live ? ages[live - 1] : -1,
           status_of("Threads:") - threads, status_of("VmRSS:") - rss);
    fflush(stdout);
}

static int open_all(const char *folder, int first)
{
    char path[1024];

    for (int k = 0; k < streams; k++) {
        char name[32];
        snprintf(name, sizeof name, "many-%d", first + k);
        all[k].dice = 88172645463325252ULL + (unsigned long long)(first + k) * 7919;
        for (int m = 0; is_free && m < MODES; m++)
            all[k].x[m][0] = 1 + m + noise(&all[k]) / 2;
        all[k].s = modald_open(name, channels, 1 / rate);
        if (folder != NULL) {
            snprintf(path, sizeof path, "%s/%s", folder, name);
            all[k].log = fopen(path, "wb");
        }
        if (all[k].s == NULL || (folder != NULL && all[k].log == NULL))
            return 0;
    }
    return 1;
}

/* All samples up to T seconds. */
static void push_until(double t)
{
    double y[CHANNELS_MOST];

    for (int k = 0; k < streams; k++)
        while ((double)all[k].pushed < t * rate - (double)k / streams) {
            step(&all[k], y);
            modald_push(all[k].s, y);
            all[k].pushed++;
            if (all[k].log != NULL)
                fwrite(y, sizeof *y, (size_t)channels, all[k].log);
        }
}

static void close_all(void)
{
    static modald_stream *open[STREAMS_MOST];

    for (int k = 0; k < streams; k++) {
        open[k] = all[k].s;
        if (all[k].log != NULL)
            fclose(all[k].log);
    }
    modald_close_all(open, (size_t)streams);
}

int main(int argc, char **argv)
{
    double seconds = argc > 4 ? atof(argv[4]) : 0, begin, told = 0, t;
    long threads = status_of("Threads:"), rss = status_of("VmRSS:");

    streams = argc > 4 ? atoi(argv[1]) : 0;
    channels = argc > 4 ? atoi(argv[2]) : 0;
    rate = argc > 4 ? atof(argv[3]) : 0;
    is_free = argc > 7 && strcmp(argv[7], "free") == 0;
    is_read = argc > 7 && strcmp(argv[7], "read") == 0;
    set_modes();
    if (streams < 1 || streams > STREAMS_MOST || channels < 1 || channels > CHANNELS_MOST
        || !(rate > 0) || !open_all(argc > 5 && *argv[5] != 0 ? argv[5] : NULL,
                                    argc > 6 ? atoi(argv[6]) : 0)) {
        fprintf(stderr, "many_streams STREAMS CHANNELS RATE SECONDS [FOLDER [FIRST [KIND]]]; "
                        "$MODALD_URL\n");
        return 2;
    }
    begin = now();
    while ((t = now() - begin) < seconds) {
        push_until(t);
        if (t > told + 1)
            tell(told = t, threads, rss);
        nanosleep(&(struct timespec) { 0, 1000000 }, NULL);
    }
    push_until(seconds);
    tell(seconds, threads, rss);
    while (is_read && sum.acknowledged < sum.pushed) {
        nanosleep(&(struct timespec) { 0, 50000000 }, NULL);
        tell(now() - begin, threads, rss);
    }
    close_all();
    for (int i = 0; i < 1000 && status_of("Threads:") > threads; i++)
        nanosleep(&(struct timespec) { 0, 1000000 }, NULL);     /* it is counted for a moment yet */
    printf("{\"s\":%.1f,\"streams\":%d,\"threads\":%ld,\"rss_kb\":%ld,\"closed\":true}\n",
           now() - begin, streams, status_of("Threads:") - threads, status_of("VmRSS:") - rss);
    return 0;
}
