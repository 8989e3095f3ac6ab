/* test_stream_answers.c - what the streaming library makes of a server's words
 *
 * The library is taken in whole, so that what it keeps to itself can be asked. */
#include "check.h"
#include "modald_stream.c"
#include "base/json.h"
#include <time.h>

static modald_stream s;
static struct link link_of_s = { .streams = { &s }, .slots = 1, .warned = true };

static void hear_said(const char *kind, const char *text)
{
    char *exact = strdup(text);          /* of its size: a sanitizer sees a byte too many */

    on_message(&link_of_s, kind, exact, NULL);
    free(exact);
}

static void begin(void)
{
    s = (modald_stream) { .spill_fd = -1,
                         .ring_fd = -1,
                         .channels = 1,
                         .warned = true,
                         .credit = 77,
                         .epoch = 3,
                         .opened = true,
                         .link = &link_of_s,
                         .name = "rig7",
                         .open_id = 1 * LINK_STREAMS,
                         .first_id = 5 * LINK_STREAMS };
    link_of_s.questions = 8;
    memset(link_of_s.named, 0, sizeof link_of_s.named);
    set_name(&s, "abcd");
}

static double number_of(const cJSON *vector, const char *key, double otherwise)
{
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(vector, key);

    return value != NULL ? value->valuedouble : otherwise;
}

static void check_event(const cJSON *vector)
{
    static const char *const words[] = { "unknown", "stable", "unstable", "undecided" };
    const char *name = cJSON_GetStringValue(cJSON_GetObjectItem(vector, "name"));
    const char *says = cJSON_GetStringValue(cJSON_GetObjectItem(vector, "says"));
    const struct modald_estimate *e = &s.estimate;
    bool any = cJSON_GetObjectItem(vector, "damping_ratio") != NULL;

    begin();
    hear_said("EVENT", cJSON_GetStringValue(cJSON_GetObjectItem(vector, "text")));
    if (strcmp(says, words[s.verdict]) != 0 || s.estimate_version != (any ? 2 : 0)
        || (any && (e->frequency_hz != number_of(vector, "frequency_hz", 0) || e->sample != 9
                    || e->frequency_std != number_of(vector, "frequency_hz_std", -1)
                    || e->damping_ratio != number_of(vector, "damping_ratio", 0)
                    || e->damping_std != number_of(vector, "damping_ratio_std", -1))))
        fail_msg("event \"%s\": %s with %g Hz, %g", name, words[s.verdict], e->frequency_hz,
                 e->damping_ratio);
}

/* Each cut short at every byte is none: what it would have said at its end is not known. */
static void check_cuts(const char *event)
{
    for (size_t length = 0; length < strlen(event); length++) {
        char *text = strndup(event, length);
        begin();
        hear_said("EVENT", text);
        if (s.verdict != MODALD_UNKNOWN || s.estimate_version != 0)
            fail_msg("%s", text);
        free(text);
    }
}

TEST(every_event_vector_of_proto_says_what_it_should_and_cut_anywhere_nothing)
{
    FILE *file = fopen(TEST_DATA "/../../proto/vectors/events.json", "rb");
    char *text = calloc(1, 1 << 20);
    cJSON *all = NULL, *vector;
    int count = 0;

    CHECK(file != NULL && fread(text, 1, (1 << 20) - 1, file) > 0);
    CHECK(json_read(text, strlen(text), &all, NULL) == MODAL_OK);
    cJSON_ArrayForEach(vector, all) {
        check_event(vector);
        if (strcmp(cJSON_GetStringValue(cJSON_GetObjectItem(vector, "says")), "unknown") != 0)
            check_cuts(cJSON_GetStringValue(cJSON_GetObjectItem(vector, "text")));
        count++;
    }
    CHECK(count >= 30);
    cJSON_Delete(all);
    free(text);
    fclose(file);
}

/* ns of the processor that an event of one of COUNT streams takes, the least of five times 400; it
 * is that stream's alone. */
static double event_ns(int count)
{
    static struct link of_many;
    modald_stream *many = calloc((size_t)count, sizeof *many);
    double least = HUGE_VAL;
    char name[16], text[200];

    CHECK(many != NULL);
    memset((void *)&of_many, 0, sizeof of_many);
    of_many.slots = count;
    for (int k = 0; k < count; k++) {
        of_many.streams[k] = &many[k];
        many[k].link = &of_many;
        snprintf(name, sizeof name, "s%d", k);
        set_name(&many[k], name);
    }
    snprintf(text, sizeof text, "{\"event\":\"modes\",\"stream_id\":\"s%d\",\"epoch\":0,\"to\":9,"
             "\"verdict\":\"stable\",\"frequency_hz\":3,\"damping_ratio\":0.5}", count / 2);
    for (int repeat = 0; repeat < 5; repeat++) {
        const clock_t from = clock();
        for (int k = 0; k < 400; k++)
            on_message(&of_many, "EVENT", text, NULL);
        least = fmin(least, (double)(clock() - from) / CLOCKS_PER_SEC * 1e9 / 400);
    }
    for (int k = 0; k < count; k++)
        CHECK(many[k].verdict == (k == count / 2 ? MODALD_STABLE : MODALD_UNKNOWN));
    free(many);
    return least;
}

/* 120 ns for each of them made two hundred times as much of it. */
TEST(what_an_event_costs_a_host_does_not_grow_with_its_streams)
{
    const double few = event_ns(10), many = event_ns(4000);

    printf("%.0f ns an event beside 10 streams, %.0f beside 4000\n", few, many);
    CHECK(many < 4 * few);
}

TEST(a_key_inside_a_string_or_another_object_is_no_key)
{
    begin();
    hear_said("REPLY", "{\"id\":36864,\"x\":\"\\\",\\\"credit\\\":5\",\"y\":{\"credit\":6},"
                       "\"z\":[{\"credit\":7}],\"credit\":8}");
    CHECK(s.credit == 8);
    hear_said("REPLY", "{\"id\":36864,\"x\":\"\\\",\\\"credit\\\":5\",\"y\":{\"credit\":6}}");
    CHECK(s.credit == 8);
    hear_said("REPLY", "{\"id\":36864,\"credit\":5,\"credit\":6}");
    hear_said("REPLY", "{\"id\":36864,\"credit\":5");
    CHECK(s.credit == 8);
}

/* What goes together is answered part for part: the one that was refused is to be sent again, the
 * others are taken. */
TEST(each_part_of_an_answer_to_many_streams_is_its_own_streams)
{
    static double sample = 2.385;
    static modald_stream other;
    const char *body = "{\"parts\":[{\"epoch\":3,\"next\":8},{\"error\":{\"code\":\"busy\","
                       "\"message\":\"one behind another\"}},{\"epoch\":3,\"next\":9}]}";
    struct together *t = calloc(1, sizeof *t);
    char header[] = "{\"id\":36864,\"verb\":\"STREAM\",\"count\":3}";

    begin();
    other = s;
    other.slot = 1;
    link_of_s.streams[1] = &other;
    link_of_s.slots = 2;
    link_of_s.asked = 1;
    *t = (struct together) { .id = 36864, .count = 3, .slots = { 0, 1, 0 } };
    link_of_s.sent = t;
    for (int k = 0; k < 2; k++)
        *frame_at(&s, s.frames++) = (struct frame) {
            .first = 7 + (uint64_t)k, .count = 1, .data = &sample, .id = 36864, .part = 2 * k };
    *frame_at(&other, other.frames++) = (struct frame) {
        .first = 4, .count = 1, .data = &sample, .id = 36864, .part = 1 };
    s.flying = 16;
    other.flying = 8;
    CHECK(is_overdue(&link_of_s));                     /* it was sent at 0 */
    on_message(&link_of_s, "REPLY", header, body);
    CHECK(s.frames == 0 && s.acknowledged == 2 && s.flying == 0 && s.flows && s.went_on == 9);
    CHECK(other.frames == 1 && other.acknowledged == 0 && other.flying == 0 && !other.opened);
    CHECK(frame_at(&other, 0)->id == 0 && other.quiet_until > 0);
    CHECK(link_of_s.sent == NULL && link_of_s.asked == 0 && !is_overdue(&link_of_s));
    link_of_s.streams[1] = NULL;
    link_of_s.slots = 1;
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
        snprintf(text, sizeof text, "{\"id\":36864,\"credit\":%s}", numbers[i]);
        hear_said("REPLY", text);
        CHECK(s.credit == 77);
    }
    hear_said("REPLY", "{\"id\":36864,\"credit\":9007199254740992}");
    CHECK(s.credit == (size_t)1 << 53);
}

TEST(busy_waits_at_most_half_a_second_without_a_sleep_and_begins_anew)
{
    static const char *const after[] = { "0.2", "1e308", "-5", "nan", "\"x\"" };

    for (size_t i = 0; i < sizeof after / sizeof after[0]; i++) {
        char text[256];
        begin();
        snprintf(text, sizeof text, "{\"id\":28672,\"error\":{\"code\":\"busy\",\"message\":\"x\","
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
    hear_said("ERROR", "{\"id\":16384,\"error\":{\"code\":\"denied\",\"message\":\"x\"}}");
    CHECK(s.opened && !s.refused);
    hear_said("ERROR", "{\"id\":24576,\"error\":{\"code\":\"denied\",\"message\":\"x\"}}");
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
    append_string(text, sizeof text, name);
    CHECK(read_string(text, back, sizeof back) && strcmp(back, name) == 0);
    CHECK(!read_string(text, back, sizeof back - 1) && back[0] == 0);
    CHECK(!read_string("\"no end", back, sizeof back));
    CHECK(!read_string("\"\\u0041\"", back, sizeof back));
    CHECK(!read_string("7", back, sizeof back) && !read_string(NULL, back, sizeof back));
}

/* libzmq connects to 5555 by each but the last four. */
TEST(a_server_over_tcp_ends_in_a_port_and_in_nothing_else)
{
    static const char *const none[] = { "tcp://h:5555junk", "tcp://h:71091", "tcp://h:5555 ",
                                        "tcp://h:0", "tcp://h:", "tcp://h", "tcp://h:-1" };

    for (size_t i = 0; i < sizeof none / sizeof *none; i++)
        if (has_port(none[i]))
            fail_msg("%s", none[i]);
    CHECK(has_port("tcp://h:5555") && has_port("tcp://[::1]:65535") && has_port("tcp://h:1"));
    CHECK(has_port("tcp://h:000000005555") && has_port("ipc:///a:b"));
}
