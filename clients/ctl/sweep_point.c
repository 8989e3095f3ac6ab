/* sweep_point.c - see sweep_point.h */
#include "sweep_point.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "field.h"

struct sweep_amplitude sweep_amplitude(const cJSON *point)
{
    struct sweep_amplitude a = { NAN, "" };
    const cJSON *dof;

    cJSON_ArrayForEach(dof, cJSON_GetObjectItemCaseSensitive(point, "harmonics")) {
        const cJSON *re = cJSON_GetObjectItemCaseSensitive(dof, "re"),
                    *im = cJSON_GetObjectItemCaseSensitive(dof, "im");
        for (int k = 1; k < cJSON_GetArraySize(re); k++) {
            double size = hypot(field_at(re, k), field_at(im, k));
            if (isfinite(size) && !(size <= a.size))
                a = (struct sweep_amplitude) { size, field_word(dof, "dof", "") };
        }
    }
    return a;
}

double sweep_value(const cJSON *axis, const cJSON *point, int i)
{
    return field_at(field_get(axis, "values"), field_index_at(field_get(point, "index"), i));
}

/* A steady state that was not found is told by the first of its diagnostics. */
const char *sweep_failure(const cJSON *point)
{
    const cJSON *error = cJSON_GetObjectItemCaseSensitive(point, "error"),
                *list = cJSON_GetObjectItemCaseSensitive(point, "diagnostics");

    if (error != NULL)
        return field_word(error, "message", "error");
    if (cJSON_IsFalse(cJSON_GetObjectItemCaseSensitive(point, "converged")))
        return field_word(cJSON_GetArrayItem(list, 0), "message", "not converged");
    return "";
}

int sweep_exit(const cJSON *result)
{
    const cJSON *points = cJSON_GetObjectItemCaseSensitive(result, "points"), *point,
                *options = cJSON_GetObjectItemCaseSensitive(
                    cJSON_GetObjectItemCaseSensitive(result, "provenance"), "options"),
                *first = NULL, *axis;
    int count = 0, i = 0;

    if (strcmp(field_word(result, "kind", ""), "sweep") != 0)
        return 0;
    cJSON_ArrayForEach(point, points)
        if (cJSON_HasObjectItem(point, "error")) {
            first = first != NULL ? first : point;
            count++;
        }
    if (count == 0)
        return 0;
    fprintf(stderr, "modalctl: %d of %.0f points failed, the first at", count,
            field_number(options, "count", cJSON_GetArraySize(points)));
    cJSON_ArrayForEach(axis, cJSON_GetObjectItemCaseSensitive(result, "grid")) {
        fprintf(stderr, " %s = %g", field_word(axis, "path", "-"), sweep_value(axis, first, i));
        i++;
    }
    fprintf(stderr, ": %s\n", sweep_failure(first));
    return 1;
}
