/* csv_cell.c - see csv_cell.h */
#include "csv_cell.h"
#include <math.h>
#include <string.h>

void csv_name(FILE *to, bool first, const char *name, const char *after)
{
    bool quoted = strpbrk(name, ",\"\r\n") != NULL;

    fputs(first ? "" : ",", to);
    fputs(quoted ? "\"" : "", to);
    for (; *name != 0; name++) {
        if (*name == '"')
            fputc('"', to);
        fputc(*name, to);
    }
    fprintf(to, "%s%s", after, quoted ? "\"" : "");
}

void csv_number(FILE *to, bool first, double value)
{
    fputs(first ? "" : ",", to);
    if (isfinite(value))
        fprintf(to, "%.17g", value);
}

void csv_item(FILE *to, bool first, const cJSON *value)
{
    if (cJSON_IsBool(value))
        csv_number(to, first, cJSON_IsTrue(value));
    else
        csv_number(to, first, cJSON_IsNumber(value) ? value->valuedouble : NAN);
}
