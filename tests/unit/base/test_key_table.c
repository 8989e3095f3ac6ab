/* test_key_table.c - rows of keys read, written and told */
#include "check.h"
#include "base/key_table.h"

struct owner { double x, interval[2]; int n, word; bool yes; const char *text; };

static const char *const words[] = { "red", "green", NULL };
#define AT(member) .at = offsetof(struct owner, member)
static const struct key_row rows[] = {
    { "x", KEY_NUMBER, AT(x), .low = 0, .high = 10, .initial = "2.5", .meaning = "a number",
      .example = "1" },
    { "n", KEY_WHOLE, KEY_SHOWN_IF_SET, AT(n), .low = 1, .high = 9, .meaning = "a count",
      .example = "1" },
    { "y", KEY_TRUTH, AT(yes), .initial = "true", .meaning = "a truth", .example = "true" },
    { "w", KEY_CHOICE, AT(word), .words = words, .initial = "green", .meaning = "a word",
      .example = "red" },
    { "t", KEY_TEXT, KEY_SHOWN_IF_SET, AT(text), .meaning = "a text", .example = "abc" },
    { "i", KEY_INTERVAL, AT(interval), .low = 0, .high = 1e300, .meaning = "two numbers",
      .example = "1,2" },
    { "v", KEY_INTERVAL, AT(interval), .low = 0, .high = 1e300, .words = words,
      .meaning = "two numbers or a colour", .form = "red|green|A,B", .example = "3,4" },
    { "secret", KEY_WHOLE, KEY_SILENT, AT(n), .low = 1, .high = 9, .meaning = "a count",
      .example = "1" },
    { "own", KEY_OWN, .meaning = "its owner's", .example = "1" },
    { 0 },
};

TEST(a_table_reads_writes_and_has_defaults)
{
    cJSON *given = cJSON_Parse("{\"x\":7.25,\"t\":\"abc\",\"i\":[1,4],\"own\":{}}"),
          *out = cJSON_CreateObject();
    cJSON *expected = cJSON_Parse(
        "{\"x\":7.25,\"y\":true,\"w\":\"green\",\"t\":\"abc\",\"i\":[1,4],\"v\":[1,4]}");
    struct owner o = { 0 };

    CHECK(key_table_options(rows, given, &o, NULL) == MODAL_OK);
    CHECK(o.x == 7.25 && o.yes && o.word == 1 && strcmp(o.text, "abc") == 0 && o.interval[0] == 1 &&
          o.interval[1] == 4 && o.n == 0);
    key_table_write(rows, &o, out);
    CHECK(cJSON_Compare(out, expected, true));
    cJSON_Delete(given), cJSON_Delete(out), cJSON_Delete(expected);
}

TEST(a_word_stands_for_an_interval_where_the_row_has_it_and_another_is_refused_with_those)
{
    const struct { const char *given, *message; double low; } cases[] = {
        { "{\"v\":\"red\"}", NULL, -1 }, { "{\"v\":\"green\"}", NULL, -2 },
        { "{\"v\":\"gren\"}", "v is \"gren\"; did you mean green?; accepted: red, green, or two "
          "numbers, the first below the second, such as 3,4", 0 },
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cJSON *given = cJSON_Parse(cases[i].given);
        struct owner o = { 0 };
        struct modal_error err = { 0 };
        enum modal_status rc = key_table_options(rows, given, &o, &err);
        CHECK((rc == MODAL_OK) == (cases[i].message == NULL) && o.interval[0] == cases[i].low);
        if (cases[i].message != NULL) {
            CHECK(rc == MODAL_BAD_INPUT);
            CHECK_STRING(err.field, "v");
            CHECK_STRING(err.message, cases[i].message);
        }
        cJSON_Delete(given);
    }
}

TEST(a_row_is_told_with_its_form_its_range_and_its_default)
{
    const struct { int row; const char *form, *text;
    } cases[] = {
        { 0, "x=X", "a number (0 to 10; default 2.5)" },
        { 1, "n=N", "a count (1 to 9)" },
        { 2, "y=true|false", "a truth (default true)" },
        { 3, "w=red|green", "a word (default green)" },
        { 5, "i=A,B", "two numbers" },
    };
    char form[64], text[128];

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        key_row_form(&rows[cases[i].row], form, sizeof form);
        key_row_text(&rows[cases[i].row], text, sizeof text);
        CHECK_STRING(form, cases[i].form);
        CHECK_STRING(text, cases[i].text);
    }
}
