/* result_csv.c - see result_csv.h */
#include "result_csv.h"
#include <math.h>
#include <string.h>
#include "csv_cell.h"
#include "field.h"
#include "sweep_point.h"

static void put_modes(FILE *to, const cJSON *result, const char *job, bool header)
{
    static const struct { const char *name, *of, *key; int part; } columns[] = {
        { "frequency_hz", NULL, "frequency_hz", -1 },
        { "frequency_hz_std", "std", "frequency_hz", -1 },
        { "damping_ratio", NULL, "damping_ratio", -1 },
        { "damping_ratio_std", "std", "damping_ratio", -1 },
        { "re", NULL, "exponent", 0 }, { "im", NULL, "exponent", 1 },
        { "amplitude", NULL, "amplitude", -1 }, { "residual", NULL, "residual", -1 },
        { "k", NULL, "resolved_k", -1 },
    };
    const int count = sizeof columns / sizeof *columns;
    const cJSON *mode;

    if (header && job != NULL)
        csv_name(to, true, "job", "");
    for (int i = 0; header && i < count; i++)
        csv_name(to, i == 0 && job == NULL, columns[i].name, "");
    if (header)
        fputc('\n', to);
    cJSON_ArrayForEach(mode, field_get(result, "modes")) {
        if (job != NULL)
            csv_name(to, true, job, "");
        for (int i = 0; i < count; i++) {
            const cJSON *of = columns[i].of != NULL ? field_get(mode, columns[i].of) : mode;
            const cJSON *value = field_get(of, columns[i].key);
            csv_item(to, i == 0 && job == NULL,
                     columns[i].part < 0 ? value : cJSON_GetArrayItem(value, columns[i].part));
        }
        fputc('\n', to);
    }
}

static void put_points(FILE *to, const cJSON *result, const char *job, bool header)
{
    const cJSON *grid = field_get(result, "grid"), *axis, *point;

    if (header && job != NULL)
        csv_name(to, true, "job", "");
    cJSON_ArrayForEach(axis, grid)
        if (header)
            csv_name(to, axis == grid->child && job == NULL, field_word(axis, "path", "-"), "");
    if (header)
        fputs(",stable,max_multiplier,margin,amplitude,dof,error\n", to);
    cJSON_ArrayForEach(point, field_get(result, "points")) {
        struct sweep_amplitude a = sweep_amplitude(point);
        const cJSON *stability = field_get(point, "stability");
        int i = 0;
        if (job != NULL)
            csv_name(to, true, job, "");
        cJSON_ArrayForEach(axis, grid) {
            csv_number(to, i == 0 && job == NULL, sweep_value(axis, point, i));
            i++;
        }
        csv_item(to, false, field_get(stability, "stable"));
        csv_item(to, false, field_get(stability, "max_multiplier"));
        csv_item(to, false, field_get(stability, "margin"));
        csv_number(to, false, a.size);
        csv_name(to, false, a.dof, "");
        csv_name(to, false, sweep_failure(point), "");
        fputc('\n', to);
    }
}

enum modal_status result_csv(FILE *to, const cJSON *result, const char *job, bool header,
                             struct modal_error *err)
{
    const char *kind = field_word(result, "kind", "-");

    if (strcmp(kind, "identify") == 0)
        put_modes(to, result, job, header);
    else if (strcmp(kind, "sweep") == 0)
        put_points(to, result, job, header);
    else
        return modal_fail_field(err, MODAL_BAD_INPUT, "csv", "a result of %.40s is no table; "
                                "accepted: identify, sweep (of others see -O FILE.csv)", kind);
    return fflush(to) == 0 && !ferror(to)
               ? MODAL_OK : modal_fail(err, MODAL_IO, "stdout: the table could not be written");
}
