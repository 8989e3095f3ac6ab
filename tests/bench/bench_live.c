/*
 * bench_live.c - CPU of a live result after a hop, over that of an `identify` job on the same
 * window, in one process
 *
 * Signals are decays of known exponents in white noise, beside what each case adds.  Every hop is
 * taken by both; medians of their CPU seconds, and a figure only counts where frequency, damping
 * and verdict of both agree to 1e-9 in every window.  Goal: a ratio of 10 or more.  With a NAME:
 * that case alone.  `..., counted`: the same in instructions, where the machine counts them.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "../unit/signals.h"
#include "counted.h"
#include "job/job.h"
#include "job/live.h"

enum { HOPS = 12 };

static const struct row {
    const char *name;
    int channels, window, hop;
    double snr_db, offset;
    const char *options;
    double period;
} rows[] = {
    { "1 channel, 600/60", 1, 600, 60, 40, 0, NULL, 0 },
    { "1 channel, 4000/400", 1, 4000, 400, 40, 0, NULL, 0 },
    { "2 channels, 1000/37", 2, 1000, 37, 30, 0, NULL, 0 },
    { "3 channels, 600/50", 3, 600, 50, 20, 0, NULL, 0 },
    { "3 channels, 1200/100", 3, 1200, 100, 40, 0, NULL, 0 },
    { "3 channels, 1200/1200", 3, 1200, 1200, 40, 0, NULL, 0 },
    { "3 channels, exact, 600/100", 3, 600, 100, 0, 0, NULL, 0 },
    { "8 channels, 4000/500", 8, 4000, 500, 40, 0, NULL, 0 },
    { "16 channels, 800/100", 16, 800, 100, 30, 0, NULL, 0 },
    { "64 channels, 1000/200", 64, 1000, 200, 40, 0, NULL, 0 },
    { "64 channels, 2000/200", 64, 2000, 200, 40, 0, NULL, 0 },
    { "3 channels, shapes, 1200/100", 3, 1200, 100, 40, 0, "{\"shapes\":true}", 0 },
    { "3 channels, offset, 1200/100", 3, 1200, 100, 40, 3.7, NULL, 0 },
    { "64 channels, offset, 2000/200", 64, 2000, 200, 40, 3.7, NULL, 0 },
    { "100 channels, 2000/200", 100, 2000, 200, 40, 0, NULL, 0 },
    { "256 channels, 2000/200", 256, 2000, 200, 40, 0, NULL, 0 },
    { "1000 channels, 1000/100", 1000, 1000, 100, 40, 0, NULL, 0 },
    { "3 channels, band, 4000/400", 3, 4000, 400, 40, 0, "{\"band\":[1.5,3]}", 0 },
    { "3 channels, mean, 1200/100", 3, 1200, 100, 40, 3.7, "{\"detrend\":\"mean\"}", 0 },
    { "3 channels, periodic, 1200/100", 3, 1200, 100, 40, 0, NULL, 1.0 },
};

static double cpu_s(void)
{
    struct timespec t;

    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

/* Row-major; a period modulates all of it. */
static double *record(const struct row *r, int samples, double dt)
{
    static const double hz[] = { 1.0, 2.3, 4.1 }, zeta[] = { 2e-4, 1e-4, 1e-4 };
    size_t S = (size_t)r->channels;
    double *y = calloc((size_t)samples * S, sizeof *y), sum = 0, sd;
    struct random random = { 7 };

    for (size_t c = 0; c < S; c++)
        for (int j = 0; j < 3; j++) {
            double complex lambda = decay_pole(hz[j] / (r->period > 0 ? 2 : 1), zeta[j]);
            double a = 0.4 + 0.6 * random_uniform(&random), phase = 6.283 * random_uniform(&random);
            for (int k = 0; k < samples; k++) {
                double t = k * dt;
                y[(size_t)k * S + c] +=
                    a * exp(creal(lambda) * t) * cos(cimag(lambda) * t + phase) *
                    (r->period > 0 ? 1 + 0.3 * cos(6.283185307179586 * t / r->period + phase) : 1);
            }
        }
    for (size_t i = 0; i < (size_t)samples * S; i++)
        sum += y[i] * y[i];
    sd = r->snr_db > 0 ? sqrt(sum / ((double)samples * (double)S) * pow(10, -r->snr_db / 10)) : 0;
    for (size_t i = 0; i < (size_t)samples * S; i++)
        y[i] += sd * random_normal(&random) + r->offset;
    return y;
}

/* Of the modes' frequency and damping, the latter over itself or ten of its standard errors. */
static double apart(const cJSON *a, const cJSON *b)
{
    const cJSON *p = cJSON_GetObjectItem(a, "modes"), *q = cJSON_GetObjectItem(b, "modes"), *m, *n;
    const cJSON *s = cJSON_GetObjectItem(cJSON_GetObjectItem(a, "stability"), "stable"),
                *t = cJSON_GetObjectItem(cJSON_GetObjectItem(b, "stability"), "stable");
    double worst = cJSON_GetArraySize(p) == cJSON_GetArraySize(q) && s->type == t->type ? 0 : 1;

    n = q->child;
    cJSON_ArrayForEach(m, p) {
        double f = cJSON_GetObjectItem(m, "frequency_hz")->valuedouble, g,
               d = cJSON_GetObjectItem(m, "damping_ratio")->valuedouble, e, std;
        if (n == NULL)
            break;
        g = cJSON_GetObjectItem(n, "frequency_hz")->valuedouble,
        e = cJSON_GetObjectItem(n, "damping_ratio")->valuedouble;
        std = cJSON_GetObjectItem(cJSON_GetObjectItem(n, "std"), "damping_ratio")->valuedouble;
        worst = fmax(worst, fmax(fabs(f - g) / g, fabs(d - e) / hypot(e, 10 * std)));
        n = n->next;
    }
    return worst;
}

/* The line of case NAME, what it is MEASURED in behind it. */
static void say(const char *name, const char *measured, const char *unit, double scale,
                double ours[HOPS], double theirs[HOPS], int updates, const char *why)
{
    qsort(ours, HOPS, sizeof *ours, ascending), qsort(theirs, HOPS, sizeof *theirs, ascending);
    printf("{\"bench\":\"live\",\"case\":\"%s%s\",\"value\":%.3f,\"unit\":\"%s\","
           "\"peer\":\"identify job of the window\",\"ratio\":%.2f,\"n\":%d,\"updated\":%d,"
           "\"why\":\"%s\"}\n",
           name, measured, scale * ours[HOPS / 2], unit, theirs[HOPS / 2] / ours[HOPS / 2], HOPS,
           updates, why);
    fflush(stdout);
}

static int run(const struct row *r, int counter)
{
    double dt = 0.05, ours[HOPS], theirs[HOPS], ours_n[HOPS], theirs_n[HOPS], worst = 0;
    int samples = r->window + HOPS * r->hop, updates = 0, bad = 0;
    double *y = record(r, samples, dt);
    cJSON *options = r->options != NULL ? cJSON_Parse(r->options) : NULL, *document = NULL;
    struct batch batch = {
        .channels = (size_t)r->channels, .samples = (size_t)r->window, .dt = dt, .period = r->period
    };
    struct modal_error err = { 0 };
    struct live *live = NULL;
    char why[64] = "";

    bad = live_new(options, &batch, r->hop, &live, &err) != MODAL_OK ||
          live_next(live, 0, (uint64_t)r->window - 1, y, (size_t)r->window, &document,
                    &err) != MODAL_OK;
    cJSON_Delete(document);
    for (int i = 0; i < HOPS && !bad; i++) {
        struct job_request request = { .kind = "identify", .options = options, .batch = &batch };
        struct job_result result = { 0 };
        double start = cpu_s(), start_n = counted(counter);
        const cJSON *update;
        document = NULL;
        bad = live_next(live, 0, (uint64_t)(r->window + (i + 1) * r->hop - 1),
                        y + (size_t)(r->window + i * r->hop) * (size_t)r->channels,
                        (size_t)r->hop, &document, &err) != MODAL_OK;
        ours_n[i] = counted(counter) - start_n;
        ours[i] = cpu_s() - start;
        batch.signals = y + (size_t)((i + 1) * r->hop) * (size_t)r->channels;
        start = cpu_s(), start_n = counted(counter);
        bad |= job_run(&request, &result, &err) != MODAL_OK;
        theirs_n[i] = counted(counter) - start_n;
        theirs[i] = cpu_s() - start;
        if (bad)
            break;
        update = cJSON_GetObjectItem(document, "update");
        updates += cJSON_IsTrue(cJSON_GetObjectItem(update, "updated"));
        if (cJSON_IsString(cJSON_GetObjectItem(update, "why")))
            snprintf(why, sizeof why, "%s", cJSON_GetObjectItem(update, "why")->valuestring);
        worst = fmax(worst, apart(document, result.result));
        cJSON_Delete(document);
        job_result_done(&result);
    }
    live_free(live);
    cJSON_Delete(options);
    free(y);
    if (bad || !(worst <= 1e-9)) {
        fprintf(stderr, "bench_live: %s: %s; apart %.2g\n", r->name, err.message, worst);
        return 1;
    }
    say(r->name, "", "ms", 1e3, ours, theirs, updates, why);
    if (counter >= 0)
        say(r->name, ", counted", "million instructions", 1e-6, ours_n, theirs_n, updates, why);
    return 0;
}

int main(int argc, char **argv)
{
    int bad = 0, counter = counted_open();

    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        if (argc < 2 || strcmp(argv[1], rows[i].name) == 0)
            bad |= run(&rows[i], counter);
    return bad;
}
