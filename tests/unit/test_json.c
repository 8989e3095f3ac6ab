#include "check.h"
#include <stdlib.h>
#include "modal/json.h"

static enum modal_status read_text(const char *text, struct modal_error *err)
{
    cJSON *value = NULL;
    enum modal_status rc = json_read(text, strlen(text), &value, err);

    cJSON_Delete(value);
    return rc;
}

TEST(what_json_forbids_is_refused_and_leaves_the_output_alone)
{
    static const char *const bad[] = {
        "", " ", "NaN", "Infinity", "-Infinity", "1e999", "-1e400", "{\"a\":NaN}", "[1,]", "{\"a\":1,}", "{\"a\" 1}", "01", "1.", ".5", "+1",
        "1 2", "\"\\x\"", "\"\\u12\"", "\"\\u0000\"", "\"\n\"", "\"\xff\"", "\"\xc0\xaf\"", "\"\xed\xa0\x80\"", "{\"a\":1", "[", "tru", "nul", "'a'",
        "{\"\\u0061\":1}", "{a:1}", "\"\\uDDDD0e9", "\"\\udc00\"" };
    cJSON *value = (cJSON *)&value;

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        if (json_read(bad[i], strlen(bad[i]), &value, NULL) != MODAL_BAD_INPUT)
            fail_msg("accepted: %s", bad[i]);
        CHECK(value == (cJSON *)&value);
    }
}

TEST(a_duplicate_key_is_refused_with_its_path)
{
    struct modal_error err;

    CHECK(read_text("{\"effects\":[{},{\"limit\":1,\"x\":2,\"limit\":1}]}", &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "effects[1].limit");
}

TEST(nesting_past_32_is_refused_and_32_is_not)
{
    char text[100] = "";

    memset(text, '[', 32);
    memset(text + 32, ']', 32);
    text[64] = '\0';
    CHECK(read_text(text, NULL) == MODAL_OK);
    memset(text, '[', 33);
    memset(text + 33, ']', 33);
    text[66] = '\0';
    CHECK(read_text(text, NULL) == MODAL_BAD_INPUT);
}

TEST(doubles_print_and_read_back_bit_for_bit)
{
    unsigned long long state = 0x9e3779b97f4a7c15u;

    for (int i = 0; i < 20000; i++) {
        double x;
        state = state * 6364136223846793005u + 1442695040888963407u;
        memcpy(&x, &state, sizeof x);
        if (!isfinite(x))
            continue;
        cJSON *number = cJSON_CreateNumber(x), *back = NULL;
        char *text = json_print(number);
        CHECK(json_read(text, strlen(text), &back, NULL) == MODAL_OK);
        CHECK(memcmp(&back->valuedouble, &x, sizeof x) == 0);
        free(text);
        cJSON_Delete(number);
        cJSON_Delete(back);
    }
}

/* 0xff occurs in no UTF-8; U+FFFD is its published replacement (Unicode 15, section 5.22). */
TEST(text_in_another_encoding_is_printed_as_json_all_the_same)
{
    cJSON *string = cJSON_CreateString("a\xff\"\xc3\xa4\xc3"), *back = NULL;
    char *text = json_print(string);

    CHECK_STRING(text, "\"a\xef\xbf\xbd\\\"\xc3\xa4\xef\xbf\xbd\"");
    CHECK(json_read(text, strlen(text), &back, NULL) == MODAL_OK);
    free(text);
    cJSON_Delete(string);
    cJSON_Delete(back);
}

TEST(a_slip_in_json_is_placed_by_line_and_column)
{
    struct modal_error err;
    cJSON *value = NULL;

    CHECK(json_read("{\n  \"a\": 1,\n  \"b\": nan\n}", 26, &value, &err) == MODAL_BAD_INPUT);
    CHECK(strstr(err.message, "line 3, column 8") != NULL);
    CHECK(value == NULL);
}

TEST(an_unknown_key_is_named_and_the_accepted_ones_listed)
{
    static const char *const names[] = { "stiffness", "limit", NULL };
    struct modal_error err;
    cJSON *object = NULL;

    CHECK(json_read("{\"stifness\":1}", 14, &object, NULL) == MODAL_OK);
    CHECK(json_keys(object, "effects[2]", names, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "effects[2].stifness");
    CHECK(strstr(err.message, "stiffness, limit") != NULL);
    cJSON_Delete(object);
}

TEST(a_number_out_of_range_keeps_the_default)
{
    struct modal_error err;
    cJSON *object = NULL;
    double x = 2.385;

    CHECK(json_read("{\"limit\":-1,\"s\":\"a\"}", 20, &object, NULL) == MODAL_OK);
    CHECK(json_get_number(object, "e", "limit", 0, HUGE_VAL, &x, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "e.limit");
    CHECK(json_get_number(object, "e", "s", 0, 1, &x, &err) == MODAL_BAD_INPUT);
    CHECK(json_get_number(object, "e", "absent", 0, 1, &x, &err) == MODAL_OK);
    CHECK(json_need_number(object, "e", "absent", 0, 1, &x, &err) == MODAL_BAD_INPUT);
    CHECK(x == 2.385);
    cJSON_Delete(object);
}
