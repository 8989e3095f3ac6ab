/*
 * fuzz_page.c - any bytes as what modald-web is given: a path and a host of a browser's, an event
 * and a result of a daemon's
 *
 * The first byte chooses.  A name that is read escapes to a path that is read as the same name; a
 * page has no markup but its own: between tags neither < nor > is left of what was told.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "base/json.h"
#include "ctl/plot.h"
#include "web/board.h"
#include "web/feed.h"
#include "web/html.h"
#include "web/result_table.h"
#include "web/url.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void take_path(const char *text)
{
    static const char *const names[] = { "lab.example.org" };
    char path[3 * URL_NAME_MOST + 1], again[URL_NAME_MOST + 1];
    struct url url = url_read(text);

    url_host_is_ours(text, names, 1);
    url_origin_is(text, "localhost");
    if (url.name[0] == 0 || url.page == URL_NONE)
        return;
    url_escape(url.name, path);
    if (!url_decode(path, strlen(path), again) || strcmp(again, url.name) != 0)
        abort();
}

static void take_text(const char *text)
{
    struct html html;
    size_t length;
    char *page;

    if (!html_begin(&html))
        return;
    html_text(&html, text);
    page = html_end(&html, &length);
    if (page != NULL && strpbrk(page, "<>\"'") != NULL)
        abort();
    free(page);
}

static void take_event(const cJSON *event)
{
    struct board board = { 0 };
    struct feed *feed = feed_new();
    struct feed_place place = { 0 };
    char buffer[256];

    board_add(&board, event);
    board_clear(&board);
    if (feed == NULL)
        return;
    feed_add(feed, event);
    feed_seek(feed, &place, 0);
    while (feed_read(feed, &place, buffer, sizeof buffer) > 0)
        ;
    feed_free(feed);
}

static void take_result(const cJSON *result)
{
    const cJSON *kind = cJSON_GetObjectItemCaseSensitive(result, "kind");
    struct html html;
    size_t length;

    if (html_begin(&html)) {
        result_table(&html, result);
        free(html_end(&html, &length));
    }
    if (cJSON_IsString(kind) && html_begin(&html)) {
        plot_draw(html.file, kind->valuestring, result, NULL, NULL);
        free(html_end(&html, &length));
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char *text = size > 0 ? calloc(1, size) : NULL;
    cJSON *document = NULL;

    if (text == NULL)
        return 0;
    memcpy(text, data + 1, size - 1);
    if (data[0] % 3 == 0) {
        take_path(text);
        take_text(text);
    } else if (json_read(text, size - 1, &document, NULL) == MODAL_OK) {
        if (data[0] % 3 == 1)
            take_event(document);
        else
            take_result(document);
    }
    cJSON_Delete(document);
    free(text);
    return 0;
}
