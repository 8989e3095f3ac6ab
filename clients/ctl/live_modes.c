/* live_modes.c - see live_modes.h */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "field.h"
#include "live_modes.h"
#include "whole_file.h"

/* Standard errors, of two windows together: beyond them what differs has moved. */
static const double ERRORS = 3;

const char *live_modes_verdict(const cJSON *event, const char *otherwise)
{
    const cJSON *stable = field_get(field_get(event, "stability"), "stable");

    return cJSON_IsTrue(stable)    ? "stable"
           : cJSON_IsFalse(stable) ? "unstable"
           : cJSON_IsNull(stable)  ? "undecided"
                                   : otherwise;
}

/* A track or errors that a window did not give are NaN: then nothing is said of the damping. */
static const char *trend(const struct live_modes *before, double track, double zeta, double std)
{
    const struct live_mode *was = NULL;

    for (int i = 0; i < before->count; i++)
        if (before->mode[i].track == track)
            was = &before->mode[i];
    if (was == NULL)
        return isnan(track) ? "unknown" : "new";
    double moved = zeta - was->zeta, bar = ERRORS * (std + was->std);
    if (isnan(bar))
        return "unknown";
    return moved > bar ? "rising" : moved < -bar ? "falling" : "steady";
}

void live_modes_trend(struct live_modes *modes, cJSON *event)
{
    struct live_modes now = { .epoch = field_number(event, "epoch", 0) };
    cJSON *mode;

    if (!cJSON_IsArray(field_get(event, "modes")))
        return;
    if (now.epoch != modes->epoch)
        modes->count = 0;
    cJSON_ArrayForEach(mode, field_get(event, "modes")) {
        struct live_mode own = { field_real(mode, "track"),
                                 field_real(mode, "damping_ratio"),
                                 field_real(field_get(mode, "std"), "damping_ratio") };
        cJSON_AddStringToObject(mode, "trend", trend(modes, own.track, own.zeta, own.std));
        if (now.count < LIVE_MODES && isfinite(own.zeta))
            now.mode[now.count++] = own;
    }
    *modes = now;
}

static void show_error(double std)
{
    if (isfinite(std))
        printf(" +- %.1e", std);
    else
        printf(" +- -");
}

void live_modes_show(const cJSON *event)
{
    const cJSON *mode, *lag = field_get(event, "lag"), *gaps = field_get(event, "gaps");

    if (cJSON_HasObjectItem(event, "to"))
        printf(" to %-9.0f", field_real(event, "to"));
    if (cJSON_HasObjectItem(event, "dt"))
        printf(" %.6g s ", field_real(event, "to") * field_real(event, "dt"));
    if (cJSON_HasObjectItem(event, "to"))
        printf(" %-9s", live_modes_verdict(event, "-"));
    cJSON_ArrayForEach(mode, field_get(event, "modes")) {
        const cJSON *std = field_get(mode, "std");
        printf(" ");
        if (cJSON_HasObjectItem(mode, "track"))
            printf(" [%.0f]", field_real(mode, "track"));
        printf(" %.6g Hz", field_real(mode, "frequency_hz"));
        show_error(field_real(std, "frequency_hz"));
        printf("  zeta %.5g", field_real(mode, "damping_ratio"));
        show_error(field_real(std, "damping_ratio"));
        printf(" %s", field_word(mode, "trend", ""));
    }
    if (field_number(lag, "samples", 0) > 0)
        printf("  lag %.0f samples, %.0f B", field_number(lag, "samples", 0),
               field_number(lag, "bytes", 0));
    if (field_number(gaps, "count", 0) > 0)
        printf("  %.0f gaps, %.0f samples", field_number(gaps, "count", 0),
               field_number(gaps, "samples", 0));
}

/* ---- Prometheus */

/* NAME and the label of the stream; of its value backslash, quote and end of line are escaped. */
static void begin(FILE *to, const char *name, const char *stream)
{
    fprintf(to, "modald_stream_%s{stream=\"", name);
    for (const char *c = stream; *c != 0; c++) {
        if (*c == '\\' || *c == '"' || *c == '\n')
            fputc('\\', to);
        fputc(*c == '\n' ? 'n' : *c, to);
    }
    fputc('"', to);
}

static void head(FILE *to, const char *name, const char *help)
{
    fprintf(to, "# HELP modald_stream_%s %s\n# TYPE modald_stream_%s gauge\n", name, help, name);
}

/* Of a daemon that tells no tracks, the mode's place I. */
static double track_of(const cJSON *mode, int i)
{
    return field_number(mode, "track", i);
}

/* Has no mode before MODE its TRACK, as labels say it?  Where two samples have the same labels all
 * of the text is refused. */
static bool is_first(const cJSON *modes, const cJSON *mode, double track)
{
    const cJSON *other;
    int i = 0;

    cJSON_ArrayForEach(other, modes) {
        if (other == mode)
            break;
        if (rint(track_of(other, i++)) == rint(track))
            return false;
    }
    return true;
}

/* A gauge of each mode: KEY of it, or of its `std`.  `mode` is the number of its track too, as what
 * stays with it. */
static void of_modes(FILE *to, const cJSON *event, const char *stream, const char *name,
                     const char *help, bool std, const char *key)
{
    const cJSON *mode;
    int i = -1;

    head(to, name, help);
    cJSON_ArrayForEach(mode, field_get(event, "modes")) {
        double value = field_real(std ? field_get(mode, "std") : mode, key);
        double track = track_of(mode, ++i);
        if (!isfinite(value) || !is_first(field_get(event, "modes"), mode, track))
            continue;
        begin(to, name, stream);
        fprintf(to, ",mode=\"%.0f\",track=\"%.0f\"} %.17g\n", track, track, value);
    }
}

static void of_stream(FILE *to, const char *stream, const char *name, const char *help,
                      double value)
{
    if (!isfinite(value))
        return;
    head(to, name, help);
    begin(to, name, stream);
    fprintf(to, "} %.17g\n", value);
}

/* 1 stable, -1 unstable, 0 neither is said */
static double verdict_number(const cJSON *event)
{
    const char *verdict = live_modes_verdict(event, "-");

    return strcmp(verdict, "stable") == 0     ? 1
           : strcmp(verdict, "unstable") == 0 ? -1
                                              : 0;
}

enum modal_status live_modes_prometheus(const char *path, const cJSON *event,
                                        struct modal_error *err)
{
    const char *stream = field_word(event, "stream", "-");
    struct whole_file out;

    if (strcmp(field_word(event, "event", "-"), "modes") != 0)
        return MODAL_OK;
    if (whole_file_begin(&out, path, "prometheus", err) != MODAL_OK)
        return MODAL_BAD_INPUT;
    of_modes(out.file, event, stream, "frequency_hertz",
             "Frequency of a mode of the last live window, by its track.",
             false, "frequency_hz");
    of_modes(out.file, event, stream, "frequency_std_hertz", "Its standard error.", true,
             "frequency_hz");
    of_modes(out.file, event, stream, "damping_ratio",
             "Damping ratio of a mode of the last live window.", false, "damping_ratio");
    of_modes(out.file, event, stream, "damping_ratio_std", "Its standard error.", true,
             "damping_ratio");
    of_stream(out.file, stream, "verdict", "1 stable, -1 unstable, 0 undecided or not known.",
              verdict_number(event));
    of_stream(out.file, stream, "epoch", "Epoch of the last live window.",
              field_real(event, "epoch"));
    of_stream(out.file, stream, "last_sample", "Index of the last sample of the last live window.",
              field_real(event, "to"));
    of_stream(out.file, stream, "lag_samples",
              "Samples that had come after the window when its modes were told.",
              field_real(field_get(event, "lag"), "samples"));
    of_stream(out.file, stream, "lag_bytes", "The same in bytes.",
              field_real(field_get(event, "lag"), "bytes"));
    of_stream(out.file, stream, "gaps", "Gaps of the epoch so far.",
              field_real(field_get(event, "gaps"), "count"));
    of_stream(out.file, stream, "gap_samples", "Samples that are missing in them.",
              field_real(field_get(event, "gaps"), "samples"));
    return whole_file_end(&out, err);
}
