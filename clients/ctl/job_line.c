/* job_line.c - see job_line.h */
#include "job_line.h"
#include <time.h>
#include "field.h"

void job_line_heading(FILE *to)
{
    fprintf(to, "%-20s %-10s %-10s %2s  %-21s%s\n", "job", "kind", "state", "no", "submitted",
            "key");
}

static void put_time(FILE *to, double utc)
{
    time_t t = (time_t)utc;
    struct tm parts;
    char s[32] = "-";

    if (utc > 0 && gmtime_r(&t, &parts) != NULL)
        strftime(s, sizeof s, "%Y-%m-%d %H:%M:%SZ", &parts);
    fprintf(to, "%-21s", s);
}

void job_line(FILE *to, const cJSON *doc)
{
    const cJSON *error = cJSON_GetObjectItemCaseSensitive(doc, "error");

    fprintf(to, "%-20s %-10s %-10s %2.0f  ", field_word(doc, "job", "-"),
            field_word(doc, "kind", "-"), field_word(doc, "state", "-"),
            field_number(doc, "attempts", 0));
    put_time(to, field_number(doc, "submitted", 0));
    fprintf(to, "%s", field_word(doc, "key", "-"));
    if (cJSON_IsNumber(cJSON_GetObjectItemCaseSensitive(doc, "position")))
        fprintf(to, "  (%.0f before it)", field_number(doc, "position", 0));
    if (error != NULL)
        fprintf(to, "  %s: %s", field_word(error, "code", "-"), field_word(error, "message", "-"));
    fputc('\n', to);
}
