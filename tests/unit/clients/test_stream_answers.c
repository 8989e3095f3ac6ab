/* test_stream_answers.c - what the streaming library makes of a server's words
 *
 * The library is taken in whole, so that what it keeps to itself can be asked. */
#include "check.h"
#include "modald_stream.c"

static modald_stream s;

static void hear_said(const char *kind, const char *text)
{
    char *exact = strdup(text);          /* of its size: a sanitizer sees a byte too many */

    take_message(&s, kind, exact);
    free(exact);
}

static void begin(void)
{
    s = (modald_stream) { .spill_fd = -1, .ring_fd = -1, .channels = 1, .told = true, .credit = 77,
                          .stream = "abcd", .epoch = 3, .opened = true, .open_id = 1,
                          .next_id = 8, .first_id = 5 };
}

#define MODES(of)                                                             \
    "{\"epoch\":3,\"to\":9,\"modes\":[{\"frequency_hz\":2.5,\"damping_ratio\":0.125,"    \
    "\"std\":{\"frequency_hz\":0.5,\"damping_ratio\":0.25}},"                       \
    "{\"frequency_hz\":7.5,\"damping_ratio\":-0.5}],"                             \
    "\"stability\":{\"stable\":false},\"stream_id\":" of

TEST(the_least_damped_mode_of_our_own_stream_and_epoch_is_the_estimate)
{
    begin();
    hear_said("EVENT", MODES("\"abcd\"}"));
    CHECK(s.verdict == MODALD_UNSTABLE && s.estimate.sample == 9);
    CHECK(s.estimate.frequency_hz == 7.5 && s.estimate.damping_ratio == -0.5);
    CHECK(s.estimate.damping_std == -1);
}

TEST(words_of_another_stream_or_cut_at_the_end_are_none)
{
    static const char *const ends[] = {
        "\"abcde\"}", "\"abc\"}", "", "\"", "\"abcd", "7}", "null}"
    };

    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        char text[512] = MODES("");
        begin();
        strcat(text, ends[i]);
        hear_said("EVENT", text);
        CHECK(s.verdict == MODALD_UNKNOWN);
    }
}

TEST(a_key_inside_a_string_or_another_object_is_no_key)
{
    begin();
    hear_said("REPLY", "{\"id\":9,\"x\":\"\\\",\\\"credit\\\":5\",\"y\":{\"credit\":6},"
                       "\"z\":[{\"credit\":7}],\"credit\":8}");
    CHECK(s.credit == 8);
    hear_said("REPLY", "{\"id\":9,\"x\":\"\\\",\\\"credit\\\":5\",\"y\":{\"credit\":6}}");
    CHECK(s.credit == 8);
}

TEST(a_number_that_is_none_or_no_count_changes_nothing)
{
    static const char *const numbers[] = {
        "1e308", "-1e308", "-1", "nan", "NaN", "inf", "1e999", "0x10", "0.5", "", "\"5\"", "null",
        "9007199254740993e3", "{}", "[]", "true", "--1", "1e"
    };

    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        char text[128];
        begin();
        snprintf(text, sizeof text, "{\"id\":9,\"credit\":%s}", numbers[i]);
        hear_said("REPLY", text);
        CHECK(s.credit == 77);
    }
    hear_said("REPLY", "{\"id\":9,\"credit\":9007199254740992}");
    CHECK(s.credit == (size_t)1 << 53);
}

TEST(busy_waits_at_most_half_a_second_without_a_sleep_and_begins_anew)
{
    static const char *const after[] = { "0.2", "1e308", "-5", "nan", "\"x\"" };

    for (size_t i = 0; i < sizeof after / sizeof after[0]; i++) {
        char text[256];
        begin();
        snprintf(text, sizeof text, "{\"id\":7,\"error\":{\"code\":\"busy\",\"message\":\"x\","
                 "\"detail\":{\"retry_after_s\":%s}}}", after[i]);
        double before = now();
        hear_said("ERROR", text);
        CHECK(!s.opened && !s.refused);
        CHECK(s.quiet_until >= before + 0.05 && s.quiet_until <= now() + 0.5);
    }
}

TEST(an_error_that_answers_what_was_asked_before_is_no_news)
{
    begin();
    hear_said("ERROR", "{\"id\":4,\"error\":{\"code\":\"denied\",\"message\":\"x\"}}");
    CHECK(s.opened && !s.refused);
    hear_said("ERROR", "{\"id\":6,\"error\":{\"code\":\"denied\",\"message\":\"x\"}}");
    CHECK(s.refused);
}

TEST(depth_and_length_cost_no_stack_and_no_second_look)
{
    size_t length = 1000000;
    char *text = malloc(length + 64);

    strcpy(text, "{\"a\":");
    memset(text + 5, '[', length);
    strcpy(text + 5 + length, ",\"credit\":5}");
    begin();
    hear_said("REPLY", text);
    CHECK(s.credit == 77);
    free(text);
}

/* What add_string writes read_string reads, for every byte but 0. */
TEST(a_string_comes_back_as_it_was_written)
{
    char name[256], text[2048] = "", back[256];

    for (int i = 1; i < 256; i++)
        name[i - 1] = (char)i;
    name[255] = 0;
    add_string(text, sizeof text, name);
    CHECK(read_string(text, back, sizeof back) && strcmp(back, name) == 0);
    CHECK(!read_string(text, back, sizeof back - 1) && back[0] == 0);
    CHECK(!read_string("\"no end", back, sizeof back));
    CHECK(!read_string("\"\\u0041\"", back, sizeof back));
    CHECK(!read_string("7", back, sizeof back) && !read_string(NULL, back, sizeof back));
}
