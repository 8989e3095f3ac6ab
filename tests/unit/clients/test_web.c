/* test_web.c - what modald-web makes of paths, hosts, events and documents, without a socket */
#include <stdlib.h>
#include <string.h>
#include "check.h"
#include "ctl/plot.h"
#include "web/board.h"
#include "web/feed.h"
#include "web/html.h"
#include "web/result_table.h"
#include "web/url.h"

TEST(a_path_is_one_of_a_few_pages_with_one_name_at_most)
{
    static const struct {
        const char *path;
        enum url_page page;
        const char *name, *verb;
    } rows[] = {
        { "/", URL_FRONT, "", NULL }, { "/events", URL_EVENTS, "", NULL },
        { "/metrics", URL_METRICS, "", NULL }, { "/page.js", URL_FILE, "page.js", NULL },
        { "/jobs/7bq", URL_JOB, "7bq", NULL }, { "/jobs/7bq.svg", URL_PICTURE, "7bq", NULL },
        { "/jobs/key:a%20%2Fb", URL_JOB, "key:a /b", NULL },
        { "/jobs/7bq/cancel", URL_ACTION, "7bq", "CANCEL" },
        { "/jobs/7bq/delete", URL_ACTION, "7bq", "DELETE" },
        { "/streams/rig%207", URL_STREAM, "rig 7", NULL },
        { "/jobs/7bq/delete/x", URL_NONE, "", NULL }, { "/jobs/", URL_NONE, "", NULL },
        { "/streams/a/b", URL_NONE, "", NULL }, { "/../etc/passwd", URL_NONE, "", NULL },
        { "/a/b", URL_NONE, "", NULL }, { "x", URL_NONE, "", NULL }, { "", URL_NONE, "", NULL },
    };

    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct url url = url_read(rows[i].path);
        CHECK(url.page == rows[i].page);
        CHECK(url.page == URL_NONE || strcmp(url.name, rows[i].name) == 0);
        CHECK(url.page != URL_ACTION || strcmp(url.verb, rows[i].verb) == 0);
    }
}

TEST(a_name_with_a_broken_escape_a_control_sign_or_no_utf8_is_none)
{
    static const char *const bad[] = { "", "%", "a%", "a%2", "%zz", "%00", "a%0a", "%7f", "%ff",
                                       "%e2%82", "%c0%af" };
    char name[URL_NAME_MOST + 1], path[3 * URL_NAME_MOST + 1], long_name[2 * URL_NAME_MOST];

    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        CHECK(!url_decode(bad[i], strlen(bad[i]), name));
    memset(long_name, 'x', sizeof long_name);
    CHECK(url_decode(long_name, URL_NAME_MOST, name));
    CHECK(!url_decode(long_name, URL_NAME_MOST + 1, name));
    url_escape("r\xc3\xb6hre <7>/%", path);
    CHECK(strcmp(path, "r%C3%B6hre%20%3C7%3E%2F%25") == 0);
    CHECK(url_decode(path, strlen(path), name) && strcmp(name, "r\xc3\xb6hre <7>/%") == 0);
}

/* Events of NUMBER, of a stream whose text is SIZE bytes long. */
static void add_event(struct feed *feed, double number, const char *stream, size_t size)
{
    cJSON *event = cJSON_CreateObject();
    char *text = malloc(size + 1);

    memset(text, 'x', size);
    text[size] = 0;
    cJSON_AddStringToObject(event, "event", "modes");
    cJSON_AddStringToObject(event, "stream", stream);
    cJSON_AddNumberToObject(event, "number", number);
    cJSON_AddStringToObject(event, "text", text);
    feed_add(feed, event);
    cJSON_Delete(event);
    free(text);
}

TEST(a_reader_who_falls_behind_what_is_kept_has_lost_his_place_and_others_have_not)
{
    struct feed *feed = feed_new();
    struct feed_place slow = { 0 }, quick = { 0 };
    static char buffer[65536];
    ssize_t most = 0, n;

    CHECK(feed_seek(feed, &slow, -1) && feed_seek(feed, &quick, -1));
    for (int i = 0; i < 2000; i++) {
        add_event(feed, i, "rig", 20000);
        n = feed_read(feed, &quick, buffer, sizeof buffer);
        CHECK(n > 20000 && feed_read(feed, &quick, buffer, sizeof buffer) == 0);
        most = n > most ? n : most;
    }
    CHECK(feed_read(feed, &slow, buffer, sizeof buffer) == -1);
    /* what is kept is within its bound: no more whole events than fit it */
    CHECK(feed_number(feed) == 1999 && feed_first(feed) > 1999 - FEED_BYTES / 20000);
    CHECK(!feed_seek(feed, &slow, feed_first(feed) - 1));
    CHECK(feed_seek(feed, &slow, feed_first(feed)));
    CHECK(feed_read(feed, &slow, buffer, sizeof buffer) > 0);
    CHECK(!feed_seek(feed, &slow, 2001) && feed_seek(feed, &slow, 2000));
    feed_free(feed);
}

TEST(events_arrive_whole_whatever_room_there_is_for_them)
{
    struct feed *feed = feed_new();
    struct feed_place place = { .stream = "b" };
    char all[4096] = "", byte[8];
    ssize_t n;

    add_event(feed, 1, "a", 100);
    add_event(feed, 2, "b", 100);
    add_event(feed, 3, "a", 100);
    add_event(feed, 4, "b", 3);
    CHECK(feed_seek(feed, &place, 1));
    while ((n = feed_read(feed, &place, byte, 7)) > 0)
        strncat(all, byte, (size_t)n);
    CHECK(n == 0 && strstr(all, "id: 1\n") == NULL && strstr(all, "id: 3\n") == NULL);
    CHECK(strncmp(all, "id: 2\ndata: {", 13) == 0);
    CHECK(strstr(all, "\"text\":\"xxx\"}\n\n") == all + strlen(all) - 15);
    feed_free(feed);
}

TEST(the_board_keeps_the_streams_told_of_last_and_the_alarms_that_hold)
{
    static const char alarm[] = "{\"event\":\"alarm\",\"stream\":\"s0400\",\"rule\":\"growth\","
                                "\"state\":\"%s\",\"time\":1e9,\"mode\":{\"track\":3}}";
    struct board board = { 0 };
    char text[256];
    cJSON *event;

    for (int i = 0; i < 500; i++) {
        snprintf(text, sizeof text, "{\"event\":\"modes\",\"stream\":\"s%04d\",\"time\":%d,"
                 "\"epoch\":0,\"modes\":[{\"track\":3,\"frequency_hz\":2.5}]}", i, i);
        event = cJSON_Parse(text);
        board_add(&board, event);
        cJSON_Delete(event);
    }
    CHECK(board.streams == BOARD_STREAMS && board_find(&board, "s0000") == NULL);
    for (int i = 1; i < board.streams; i++)
        CHECK(strcmp(board.stream[i - 1]->name, board.stream[i]->name) < 0);
    CHECK(board_find(&board, "s0499")->mode[0].hertz == 2.5);
    for (int i = 0; i < 3; i++) {
        snprintf(text, sizeof text, alarm, i < 2 ? "raised" : "cleared");
        event = cJSON_Parse(text);
        board_add(&board, event);
        cJSON_Delete(event);
        CHECK(board_find(&board, "s0400")->alarms == (i < 2));
    }
    CHECK(board.edges == 3 && strcmp(board.edge[0].state, "cleared") == 0);
    board_clear(&board);
}

TEST(a_place_in_no_list_is_drawn_as_none)
{
    static const char *const rows[] = {
        "{\"kind\":\"tradeoff\",\"bound\":16,\"recommended\":7e34,"
        "\"rungs\":[{\"error\":1e-3,\"seconds\":0.1,\"pareto\":true}]}",
        "{\"kind\":\"tradeoff\",\"bound\":16,\"recommended\":-7e34,"
        "\"rungs\":[{\"error\":1e-3,\"seconds\":0.1,\"pareto\":true}]}",
        "{\"kind\":\"sweep\",\"grid\":[{\"path\":\"c\",\"values\":[1,2]}],"
        "\"points\":[{\"index\":[1e300],\"stability\":{\"max_multiplier\":0.5}}]}",
    };

    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        cJSON *result = cJSON_Parse(rows[i]);
        struct html html;
        size_t length;
        char *text;

        CHECK(result != NULL && html_begin(&html));
        CHECK(plot_draw(html.file, cJSON_GetObjectItem(result, "kind")->valuestring, result, NULL,
                        NULL) == MODAL_OK);
        text = html_end(&html, &length);
        CHECK(text != NULL && strstr(text, "<svg") != NULL);
        CHECK(strstr(text, "recommended") == NULL);
        free(text);
        cJSON_Delete(result);
    }
}

TEST(no_document_makes_markup_of_its_own)
{
    cJSON *document = cJSON_Parse(
        "{\"<b>k\":\"<i>v\",\"modes\":[{\"<u>\":1,\"std\":{\"<u>\":\"<s>\"}},7,[1],null],"
        "\"x\":{\"<q>\":[[1,\"<w>\"],{\"a\":\"<e>\"}]},"
        "\"deep\":{\"a\":{\"b\":{\"c\":{\"d\":1}}}}}");
    static const char *const bad[] = { "<b>k", "<i>", "<u>", "<s>", "<q>", "<w>", "<e>" };
    struct html html;
    size_t length;
    char *text;

    CHECK(document != NULL && html_begin(&html));
    result_table(&html, document);
    text = html_end(&html, &length);
    CHECK(text != NULL && strlen(text) == length);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        CHECK(strstr(text, bad[i]) == NULL);
    CHECK(strstr(text, "&lt;i&gt;v") != NULL && strstr(text, "&lt;s&gt;") != NULL);
    free(text);
    cJSON_Delete(document);
}
