/* option_help.c - see option_help.h */
#include "option_help.h"
#include <string.h>
#include "job/job_options.h"

static void print_rows(FILE *to, const struct key_row *rows)
{
    char form[128], text[400];

    for (const struct key_row *row = rows; row != NULL && row->name != NULL; row++) {
        key_row_form(row, form, sizeof form);
        key_row_text(row, text, sizeof text);
        fprintf(to, "  %-28s %s\n", form, text);
    }
}

/* Tables of KIND; a TITLE stands once above those of one `of`. */
static void print_tables(FILE *to, const struct job_option_table *tables, const char *kind,
                         const char *title, const char *end)
{
    const char *last = "";

    for (const struct job_option_table *t = tables; t->kind != NULL; t++) {
        const char *of = t->of != NULL ? t->of : "";
        char as[48];

        if (strcmp(t->kind, kind) != 0)
            continue;
        if (title != NULL && (strcmp(of, last) != 0 || last[0] == '\0'))
            fprintf(to, "\n%s%s%s%s:\n", title, t->of != NULL ? " of " : "", of, end);
        if (t->of == NULL)
            title = NULL;
        last = of;
        print_rows(to, t->rows);
        if (t->as != NULL) {
            snprintf(as, sizeof as, "(those of %s)", t->as);
            fprintf(to, "  %-28s %s\n", as, t->when);
        }
    }
}

void option_help(FILE *to, const char *kind)
{
    print_tables(to, job_option_tables, kind, "-o KEY=VALUE",
                 ", all in the result with their defaults");
    print_tables(to, job_document_tables, kind, "keys", "");
}
