/* table_file.c - see table_file.h */
#include "table_file.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "csv_cell.h"
#include "field.h"
#include "whole_file.h"

/* ---- tables ---- */

static void write_signals(FILE *to, const struct batch *b)
{
    fputs("t", to);
    for (size_t c = 0; c < b->channels; c++) {
        char own[24];
        snprintf(own, sizeof own, "ch%zu", c);
        csv_name(to, false, b->names != NULL && b->names[c] != NULL ? b->names[c] : own, "");
    }
    fputc('\n', to);
    for (size_t k = 0; k < b->samples; k++) {
        csv_number(to, true, (double)k * b->dt);
        for (size_t c = 0; c < b->channels; c++)
            csv_number(to, false, b->signals[k * b->channels + c]);
        fputc('\n', to);
    }
}

static void write_waveform(FILE *to, const cJSON *time)
{
    const cJSON *rows = field_get(time, "x"), *row, *t;
    int k = 0;

    fputs("t", to);
    cJSON_ArrayForEach(row, rows)
        csv_name(to, false, row->string, "");
    fputc('\n', to);
    cJSON_ArrayForEach(t, field_get(time, "t")) {
        csv_item(to, true, t);
        cJSON_ArrayForEach(row, rows)
            csv_item(to, false, cJSON_GetArrayItem(row, k));
        fputc('\n', to);
        k++;
    }
}

static void write_spectrum(FILE *to, const cJSON *dofs)
{
    const cJSON *dof, *k;
    int i = 0;

    fputs("k", to);
    cJSON_ArrayForEach(dof, dofs) {
        csv_name(to, false, field_get(dof, "dof")->valuestring, "_re");
        csv_name(to, false, field_get(dof, "dof")->valuestring, "_im");
    }
    fputc('\n', to);
    cJSON_ArrayForEach(k, field_get(cJSON_GetArrayItem(dofs, 0), "k")) {
        csv_item(to, true, k);
        cJSON_ArrayForEach(dof, dofs) {
            csv_item(to, false, cJSON_GetArrayItem(field_get(dof, "re"), i));
            csv_item(to, false, cJSON_GetArrayItem(field_get(dof, "im"), i));
        }
        fputc('\n', to);
        i++;
    }
}

/* The harmonics of a curve: those of the point that has most. */
static int most_harmonics(const cJSON *points)
{
    const cJSON *point;
    int most = 0;

    cJSON_ArrayForEach(point, points) {
        const cJSON *first = cJSON_GetArrayItem(field_get(point, "harmonics"), 0);
        int count = cJSON_GetArraySize(field_get(first, "k"));
        most = count > most ? count : most;
    }
    return most;
}

static void put_point(FILE *to, const cJSON *point, const char *parameter, int harmonics)
{
    const cJSON *value = field_get(point, parameter), *dof;

    csv_item(to, true, value != NULL ? value : field_get(point, "value"));
    csv_item(to, false, field_get(point, "converged"));
    csv_item(to, false, field_get(field_get(point, "stability"), "stable"));
    csv_item(to, false, field_get(point, "total_error"));
    cJSON_ArrayForEach(dof, field_get(point, "harmonics"))
        for (int i = 0; i < harmonics; i++) {
            csv_item(to, false, cJSON_GetArrayItem(field_get(dof, "re"), i));
            csv_item(to, false, cJSON_GetArrayItem(field_get(dof, "im"), i));
        }
    fputc('\n', to);
}

static void write_points(FILE *to, const cJSON *doc, const cJSON *points)
{
    bool backbone = strcmp(cJSON_GetStringValue(field_get(doc, "kind")), "backbone") == 0;
    const char *named = cJSON_GetStringValue(field_get(doc, "parameter"));
    const char *parameter = backbone ? "amplitude" : named != NULL ? named : "omega";
    int harmonics = most_harmonics(points);
    const cJSON *point, *dof;

    csv_name(to, true, parameter, "");
    fputs(",converged,stable,total_error", to);
    cJSON_ArrayForEach(dof, field_get(cJSON_GetArrayItem(points, 0), "harmonics"))
        for (int i = 0; i < 2 * harmonics; i++) {
            char after[24];
            snprintf(after, sizeof after, "_%s_%d", i % 2 == 0 ? "re" : "im", i / 2);
            csv_name(to, false, field_get(dof, "dof")->valuestring, after);
        }
    fputc('\n', to);
    cJSON_ArrayForEach(point, points)
        put_point(to, point, parameter, harmonics);
}

enum modal_status table_file_write(const char *path, const cJSON *doc, const struct batch *batch,
                                   struct modal_error *err)
{
    const cJSON *points = field_get(doc, "points"), *time = field_get(doc, "time");
    struct whole_file out;
    enum modal_status rc = whole_file_begin(&out, path, "output", err);

    if (rc != MODAL_OK)
        return rc;
    if (batch->samples > 0)
        write_signals(out.file, batch);
    else if (points != NULL)
        write_points(out.file, doc, points);
    else if (time != NULL)
        write_waveform(out.file, time);
    else
        write_spectrum(out.file, field_get(doc, "harmonics"));
    return whole_file_end(&out, err);
}
