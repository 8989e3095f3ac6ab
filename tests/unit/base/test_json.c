/* Tests as well: json_read.c json_text.c json_tree.c near.c */
#include "check.h"
#include <stdlib.h>
#include "base/json.h"

static enum modal_status read_text(const char *text, struct modal_error *err)
{
    cJSON *value = NULL;
    enum modal_status rc = json_read(text, strlen(text), &value, err);

    cJSON_Delete(value);
    return rc;
}

TEST(what_json_forbids_is_refused_and_leaves_the_output_alone)
{
    static const char *const bad[] = { "",
                                       " ",
                                       "NaN",
                                       "Infinity",
                                       "-Infinity",
                                       "1e999",
                                       "-1e400",
                                       "{\"a\":NaN}",
                                       "[1,]",
                                       "{\"a\":1,}",
                                       "{\"a\" 1}",
                                       "01",
                                       "1.",
                                       ".5",
                                       "+1",
                                       "1 2",
                                       "\"\\x\"",
                                       "\"\\u12\"",
                                       "\"\\u0000\"",
                                       "\"\n\"",
                                       "\"\xff\"",
                                       "\"\xc0\xaf\"",
                                       "\"\xed\xa0\x80\"",
                                       "{\"a\":1",
                                       "[",
                                       "tru",
                                       "nul",
                                       "'a'",
                                       "{\"\\u0061\":1}",
                                       "{a:1}",
                                       "\"\\uDDDD0e9",
                                       "\"\\udc00\"" };
    cJSON *value = (cJSON *)&value;

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        if (json_read(bad[i], strlen(bad[i]), &value, NULL) != MODAL_BAD_INPUT)
            fail_msg("accepted: %s", bad[i]);
        CHECK(value == (cJSON *)&value);
    }
}

/* It ends a text in C: behind it anything could hide. */
TEST(a_zero_byte_is_refused_wherever_it_stands)
{
    static const struct { const char *text; size_t length;
    } bad[] = {
        { "\"a\0b\"", 5 },    { "\"a\\\0b\"", 6 },    { "\"\\u00\0\0\"", 8 },
        { "{\"a\0\":1}", 8 }, { "{\"a\\\0\":1}", 9 }, { "1\0", 2 },
        { "\0", 1 },          { "[1,\0 2]", 7 },
    };
    cJSON *value = NULL;

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        CHECK(json_read(bad[i].text, bad[i].length, &value, NULL) == MODAL_BAD_INPUT &&
              value == NULL);
}

TEST(a_duplicate_key_is_refused_with_its_path)
{
    struct modal_error err;

    CHECK(read_text("{\"effects\":[{},{\"limit\":1,\"x\":2,\"limit\":1}]}", &err) ==
          MODAL_BAD_INPUT);
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

/* C's own %.15g is what a decimal of at most 15 digits is written as. */
TEST(decimals_of_three_places_print_as_printf_has_them)
{
    unsigned long long state = 0x9e3779b97f4a7c15u;

    for (int i = 0; i < 20000; i++) {
        state = state * 6364136223846793005u + 1442695040888963407u;
        double x = (double)((long long)(state >> 14) % (1LL << (1 + i % 49))) / 1000 *
                   (i % 2 ? 1 : -1);
        char expected[40], *text;
        cJSON *number = cJSON_CreateNumber(x);
        snprintf(expected, sizeof expected, "%.15g", x);
        text = json_print(number);
        CHECK_STRING(text, x == 0 ? text : expected);
        free(text);
        cJSON_Delete(number);
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

/* cJSON's own parser is the other opinion: where it reads what we accept, the trees are equal. */
TEST(a_tree_is_the_one_that_cjson_builds)
{
    static const char *const good[] = {
        "{}",
        "[]",
        " null ",
        "true",
        "[false,[],{}]",
        "-0",
        "12",
        "-999999999999999",
        "123456789012345678901234567890",
        "0.1",
        "1e-320",
        "-2.5E+3",
        "\"\"",
        "\"a\\\"\\\\\\/\\b\\f\\n\\r\\tz\"",
        "\"\\u00e4\\u20ac\\ud83d\\ude00\\u0041\"",
        "\"\xc3\xa4\"",
        "{\"a\":[1,2,{\"b\":null}],\"c\":\"d\", \"e\" : -1.5e3 ,\"\":[[[]]]}"
    };

    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        cJSON *ours = NULL, *theirs = cJSON_Parse(good[i]);
        char *printed[2];
        CHECK(json_read(good[i], strlen(good[i]), &ours, NULL) == MODAL_OK);
        CHECK(cJSON_Compare(ours, theirs, true));
        printed[0] = cJSON_PrintUnformatted(ours);
        printed[1] = cJSON_PrintUnformatted(theirs);
        CHECK_STRING(printed[0], printed[1]);
        free(printed[0]);
        free(printed[1]);
        cJSON_Delete(cJSON_Duplicate(ours, true));     /* its links are cJSON's */
        if (cJSON_IsObject(ours) || cJSON_IsArray(ours))
            CHECK(cJSON_GetArraySize(ours) == cJSON_GetArraySize(theirs));
        cJSON_Delete(ours);
        cJSON_Delete(theirs);
    }
}

/* RFC 8259, section 8.2: half a surrogate pair is no character. */
/* 3,000 members of one byte each: far more than the first block holds. */
TEST(a_tree_in_a_pool_prints_as_the_text_it_was_read_from_however_large)
{
    struct json_text t = { 0 };
    struct json_pool *pool = NULL;
    cJSON *tree = NULL, *copy;
    char key[16], *text;

    json_text_open(&t, NULL);
    for (int i = 0; i < 3000; i++) {
        snprintf(key, sizeof key, "k%d", i);
        json_text_number(&t, key, i % 10);
    }
    json_text_string(&t, "s", "a\"b\\c\n\xc3\xa4");
    json_text_close(&t);
    CHECK(json_read_pooled(t.x, t.length, &tree, &pool, NULL) == MODAL_OK);
    CHECK(json_member(tree, "k2718")->valuedouble == 8 && json_member(tree, "k3000") == NULL &&
          json_member(tree->child, "k") == NULL);
    copy = cJSON_Duplicate(tree, true);
    text = json_print(tree);
    CHECK_STRING(text, t.x);
    json_pool_free(pool);
    free(text);
    text = json_print(copy);                       /* the copy's own */
    CHECK_STRING(text, t.x);
    cJSON_Delete(copy);
    free(text);
    pool = (struct json_pool *)&pool;
    CHECK(json_read_pooled("{\"a\":[1,}", 9, &tree, &pool, NULL) == MODAL_BAD_INPUT &&
          pool == (struct json_pool *)&pool);
    json_pool_free(NULL);
    free(t.x);
}

TEST(half_a_surrogate_pair_is_refused)
{
    static const char *const bad[] = {
        "\"\\ud83d\"",        "\"\\ud83dx\"",       "\"\\ud83d\\n\"",
        "\"\\ude00\\ud83d\"", "\"\\ud83d\\u0041\"", "[\"\\udfff\"]"
    };

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        CHECK(read_text(bad[i], NULL) == MODAL_BAD_INPUT);
}

TEST(an_item_can_be_added_behind_those_that_were_read)
{
    cJSON *object = NULL;
    char *text;

    CHECK(json_read("{\"a\":[1,2]}", 11, &object, NULL) == MODAL_OK);
    cJSON_AddItemToArray(object->child, cJSON_CreateNumber(3));
    cJSON_AddStringToObject(object, "b", "c");
    text = json_print(object);
    CHECK_STRING(text, "{\"a\":[1,2,3],\"b\":\"c\"}");
    free(text);
    cJSON_Delete(object);
}

TEST(a_text_written_without_a_tree_reads_as_what_was_written)
{
    struct json_text t = { 0 };

    json_text_open(&t, NULL);
    json_text_key(&t, "list");
    json_text_raw(&t, "[");
    for (int i = 0; i < 2; i++) {
        json_text_open(&t, NULL);
        json_text_number(&t, "n", 0.1 + i);
        json_text_close(&t);
    }
    json_text_raw(&t, "]");
    json_text_string(&t, "s", "a\"b");
    json_text_string(&t, "none", NULL);
    json_text_open(&t, "in");
    json_text_bool(&t, "yes", true);
    json_text_bool(&t, "no", false);
    json_text_close(&t);
    json_text_close(&t);
    CHECK(!t.failed);
    CHECK_STRING(t.x, "{\"list\":[{\"n\":0.1},{\"n\":1.1}],\"s\":\"a\\\"b\",\"none\":null,\"in\":"
                      "{\"yes\":true,\"no\":false}}");
    free(t.x);
}

TEST(members_are_found_as_they_are_written)
{
    static const char text[] = " {\"s\":\"a,\\\"b\\\\\", \"o\" : {\"k\":[1,{\"x\":2}],\"s\":3} ,"
                               "\"n\":1.50,\"key\":null,\"k\":\"}]\",\"\":[]\n}";
    enum { KEYS = 8 };
    static const char *const keys[KEYS] = { "s", "o", "n", "key", "k", "", "x", "ke" };
    static const char *const values[KEYS] = {
        "\"a,\\\"b\\\\\"", "{\"k\":[1,{\"x\":2}],\"s\":3}", "1.50", "null", "\"}]\"", "[]",
        NULL, NULL
    };
    static const char *const others[] = { "", " ", "{}", "[{\"n\":1}]", "\"n\"", "{\"m\":1}" };
    struct json_part found[KEYS];

    json_find_texts(text, strlen(text), keys, KEYS, found);
    for (size_t i = 0; i < KEYS; i++) {
        CHECK((found[i].text == NULL) == (values[i] == NULL));
        CHECK(values[i] == NULL || (found[i].length == strlen(values[i])
                                    && memcmp(found[i].text, values[i], found[i].length) == 0));
    }
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
        json_find_texts(others[i], strlen(others[i]), keys + 2, 1, found);
        CHECK(found[0].text == NULL);
    }
    for (size_t length = 0; length < strlen(text); length++) {        /* cut anywhere it ends */
        char *exact = malloc(length > 0 ? length : 1);
        memcpy(exact, text, length);
        json_find_texts(exact, length, keys, KEYS, found);
        free(exact);
    }
}

#define LETTERS "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"

/* Strings of 0 to 40 characters with one at any place that does not stand for itself. */
TEST(a_quote_an_escape_a_control_character_and_a_byte_of_utf8_are_seen_at_any_place_of_a_string)
{
    static const struct { const char *put; bool good; } cases[] = {
        { "\\\"", true }, { "\\\\", true }, { "\xc3\xa9", true }, { "\x7f", true }, { " ", true },
        { "!", true }, { "#", true }, { "[", true }, { "]", true }, { "\x1f", false },
        { "\x01", false }, { "\x80", false }, { "\xff", false }, { "\"", false } };
    static const char *const key[] = { "b" };

    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++)
        for (int length = 0; length <= 40; length++)
            for (int at = 0; at <= length; at++) {
                char text[128];
                struct json_part found;
                cJSON *read = NULL;
                snprintf(text, sizeof text, "{\"a\":\"%.*s%s%.*s\",\"b\":7}", at, LETTERS,
                         cases[k].put, length - at, LETTERS);
                CHECK((json_read(text, strlen(text), &read, NULL) == MODAL_OK) == cases[k].good);
                json_find_texts(text, strlen(text), key, 1, &found);
                CHECK(!cases[k].good || (found.length == 1 && *found.text == '7'));
                cJSON_Delete(read);
            }
}

TEST(an_unknown_key_is_named_and_the_accepted_ones_listed)
{
    static const char *const names[] = { "stiffness", "limit", NULL };
    struct modal_error err;
    cJSON *object = NULL;

    CHECK(json_read("{\"stifness\":1}", 14, &object, NULL) == MODAL_OK);
    CHECK(json_keys(object, "effects[2]", names, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "effects[2].stifness");
    CHECK(strstr(err.message, "accepted: limit, stiffness") != NULL);
    cJSON_Delete(object);
}

TEST(what_may_have_been_meant_by_an_unknown_key_is_asked)
{
    static const char *const names[] = { "window", "rank.rule", "shapes", "rank.fixed", "band",
                                         NULL };
    static const struct { const char *key, *asked; } cases[] = {
        { "rank", "; did you mean rank.fixed, rank.rule?" }, { "shape", "; did you mean shapes?" },
        { "windwo", "; did you mean window?" }, { "rank.fxed", "; did you mean rank.fixed?" },
        { "badn", "; did you mean band?" },
        { "xyz", "unknown key \"xyz\"; accepted: band, rank.fixed, rank.rule, shapes, window" },
        { "b", "unknown key \"b\"; accepted: " },
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cJSON *object = cJSON_CreateObject();
        struct modal_error err;
        cJSON_AddTrueToObject(object, cases[i].key);
        CHECK(json_keys(object, "", names, &err) == MODAL_BAD_INPUT);
        if (strstr(err.message, cases[i].asked) == NULL)
            fail_msg("%s: %s", cases[i].key, err.message);
        cJSON_Delete(object);
    }
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
