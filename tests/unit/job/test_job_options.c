/* test_job_options.c - the tables of options agree with themselves and with their parsers */
/* Tests as well: kinds.c */
#include "check.h"
#include <stdlib.h>
#include "ctl/option.h"
#include "job/identify_options.h"
#include "job/job.h"
#include "job/job_options.h"

static bool in_range(const struct key_row *r, double x)
{
    return x >= r->low && x <= r->high && (r->type != KEY_WHOLE || x == floor(x));
}

static bool is_word(const char *const *words, const char *word)
{
    while (*words != NULL && strcmp(*words, word) != 0)
        words++;
    return *words != NULL;
}

/* Each row of each table. */
#define EACH_ROW(table, row) \
    for (const struct job_option_table *table = job_option_tables; table->kind != NULL; table++) \
        for (const struct key_row *row = table->rows; row != NULL && row->name != NULL; row++)

TEST(what_holds_without_an_option_is_what_the_option_accepts)
{
    int defaults = 0;

    EACH_ROW(t, r) {
        bool good = r->initial == NULL || r->type == KEY_OWN ||
                    ((r->type == KEY_NUMBER || r->type == KEY_WHOLE) &&
                     in_range(r, strtod(r->initial, NULL))) ||
                    (r->type == KEY_TRUTH &&
                     (strcmp(r->initial, "true") == 0 || strcmp(r->initial, "false") == 0)) ||
                    (r->type == KEY_CHOICE && is_word(r->words, r->initial));
        if (!good)
            fail_msg("%s: %s is %s without being said", t->kind, r->name, r->initial);
        defaults += r->initial != NULL;
    }
    CHECK(defaults > 30);
}

TEST(every_option_has_a_meaning_and_an_example_that_its_own_row_accepts)
{
    EACH_ROW(t, r) {
        double into[2] = { 0 };
        struct key_row one[] = { *r, { 0 } };
        struct modal_error err = { 0 };
        cJSON *o = cJSON_CreateObject();
        char text[256];

        CHECK(r->meaning != NULL && r->meaning[0] != '\0' && r->example != NULL);
        one[0].at = 0;
        snprintf(text, sizeof text, "%s=%s", r->name, r->example);
        if (option_add(o, text, &err) != MODAL_OK ||
            key_table_read(one, o, "", into, &err) != MODAL_OK)
            fail_msg("%s: -o %s: %s", t->kind, text, err.message);
        cJSON_Delete(o);
    }
}

TEST(no_option_stands_twice_in_the_tables_of_a_kind)
{
    EACH_ROW(t, r) {
        int same = 0;

        EACH_ROW(u, s)
        same += strcmp(t->kind, u->kind) == 0 &&
                strcmp(t->of ? t->of : "", u->of ? u->of : "") == 0 &&
                strcmp(r->name, s->name) == 0;
        if (same != 1)
            fail_msg("%s: %s stands %d times", t->kind, r->name, same);
    }
}

TEST(every_kind_has_a_table_and_every_table_a_kind)
{
    for (const struct job_kind *k = job_kinds; k->name != NULL; k++) {
        int tables = 0;

        for (const struct job_option_table *t = job_option_tables; t->kind != NULL; t++)
            tables += strcmp(t->kind, k->name) == 0;
        if (tables == 0)
            fail_msg("no table of options for the kind %s", k->name);
    }
    for (const struct job_option_table *t = job_option_tables; t->kind != NULL; t++) {
        CHECK(strcmp(t->kind, "stream") == 0 || job_kind_find(t->kind) != NULL);
        CHECK(t->as == NULL || job_kind_find(t->as) != NULL);
    }
}

/* 8 samples of 1 channel, 1 s apart: enough to be read, so that a refusal is the option's. */
TEST(each_number_of_identify_is_refused_past_either_end_of_its_row)
{
    static const double x[8] = { 1, -1, 2, -2, 3, -3, 4, -4 };
    const struct batch batch = { .samples = 8, .channels = 1, .signals = x, .dt = 1 };

    for (const struct key_row *r = identify_option_rows; r->name != NULL; r++)
        for (int end = 0; end < 2 && (r->type == KEY_NUMBER || r->type == KEY_WHOLE); end++) {
            struct identify_settings s;
            struct modal_error err = { 0 };
            cJSON *o = cJSON_CreateObject();
            double past = end == 0 ? r->low - 1 : r->high * 2;

            cJSON_AddNumberToObject(o, r->name, past);
            if (identify_options_read(o, &batch, &s, &err) != MODAL_BAD_INPUT ||
                strcmp(err.field, r->name) != 0)
                fail_msg("%s = %g: field \"%s\" (%s)", r->name, past, err.field, err.message);
            CHECK(s.channels == NULL && s.threads == 0);
            cJSON_Delete(o);
        }
}

TEST(a_refusal_says_the_unit_and_an_example)
{
    static const double x[8] = { 1, -1, 2, -2, 3, -3, 4, -4 };
    const struct batch batch = { .samples = 8, .channels = 1, .signals = x, .dt = 1 };
    struct identify_settings s;
    struct modal_error err = { 0 };
    cJSON *o = cJSON_Parse("{\"band\":[5,4]}");

    CHECK(identify_options_read(o, &batch, &s, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.message, "band is [5, 4]; accepted: two numbers, the first below the second, "
                              "in Hz, such as 3500,3700");
    cJSON_Delete(o);
}
