/* job_page.c - see job_page.h
 *
 * STATUS, and of a job that is done RESULT.  A picture is drawn from the finished result alone: no
 * job is run for it, and what would not be small is named instead.
 */
#include "job_page.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "ctl/field.h"
#include "ctl/plot.h"
#include "result_table.h"
#include "site.h"

static bool is_reply(const struct link_message *answer)
{
    return answer != NULL && answer->type == LINK_REPLY;
}

static bool is_state(const cJSON *doc, const char *state)
{
    return strcmp(field_word(doc, "state", ""), state) == 0;
}

static bool has_ended(const cJSON *doc)
{
    return !is_state(doc, "queued") && !is_state(doc, "running");
}

static cJSON *job_header(const char *job)
{
    cJSON *header = cJSON_CreateObject();

    cJSON_AddStringToObject(header, "job", job);
    return header;
}

/* What can be done with a job in its state, as buttons of the script's. */
static void show_actions(struct html *html, const cJSON *doc)
{
    const struct { const char *word, *label; bool fits; } actions[] = {
        { "cancel", "Cancel this job", !has_ended(doc) },
        { "retry", "Try once more", is_state(doc, "dead") },
        { "delete", "Delete job and result", has_ended(doc) },
    };

    html_raw(html, "<p class=\"actions\">");
    for (size_t i = 0; i < sizeof actions / sizeof actions[0]; i++)
        if (actions[i].fits)
            fprintf(html->file, "<button type=\"button\" data-action=\"%s\">%s</button> ",
                    actions[i].word, actions[i].label);
    html_raw(html, "</p>\n");
}

static void show_state(struct html *html, const cJSON *doc)
{
    static const char *const times[] = { "submitted", "started", "finished" };
    static const char *const plain[] = { "key", "user", "kind", "attempts", "priority", "position",
                                         "cached", "bytes" };
    const char *state = field_word(doc, "state", "-");
    const cJSON *item;

    html_raw(html, "<p class=\"state\"><span class=\"");
    html_text(html, state);
    html_raw(html, "\">");
    html_text(html, state);
    html_raw(html, "</span></p>\n<dl class=\"facts\">");
    for (size_t i = 0; i < sizeof plain / sizeof plain[0]; i++) {
        item = field_get(doc, plain[i]);
        if (item == NULL || cJSON_IsNull(item))
            continue;
        fprintf(html->file, "<dt>%s</dt><dd>", plain[i]);
        if (cJSON_IsNumber(item))
            html_number(html, item->valuedouble);
        else
            html_text(html, cJSON_IsString(item) ? item->valuestring : "yes");
        html_raw(html, "</dd>");
    }
    for (size_t i = 0; i < sizeof times / sizeof times[0]; i++) {
        fprintf(html->file, "<dt>%s, UTC</dt><dd>", times[i]);
        html_instant(html, field_real(doc, times[i]));
        html_raw(html, "</dd>");
    }
    html_raw(html, "</dl>\n");
    item = field_get(doc, "error");
    if (item != NULL)
        html_format(html, "%s: %s", field_word(item, "code", "-"), field_word(item, "message", ""));
    if (field_get(doc, "progress") != NULL) {
        html_raw(html, "<h3>progress</h3>\n");
        result_table(html, field_get(doc, "progress"));
    }
}

/* RESULT of a done job; NULL: it is too much for a page. */
static void show_result(struct html *html, const struct visit *visit, const cJSON *result)
{
    const char *job = field_word(visit->doc, "job", "-");
    char path[3 * URL_NAME_MOST + 1];

    html_section(html, "result", "Result");
    if (result == NULL) {
        html_format(html, "The result is %.0f bytes, too much for a page; modalctl result %s has "
                    "all of it.", field_real(visit->doc, "bytes"), job);
    } else {
        url_escape(job, path);
        if (plot_is_of(field_word(result, "kind", "-"))) {
            html_raw(html, "<p class=\"wide\" tabindex=\"0\" role=\"region\" "
                           "aria-label=\"Picture\"><img src=\"/jobs/");
            html_text(html, path);
            html_raw(html, ".svg\" alt=\"the result as a picture; its numbers stand below\">"
                           "</p>\n");
        }
        result_table(html, result);
    }
    html_section_end(html);
}

/* The page of a job whose document is known, with its RESULT where it has one. */
static void show(struct visit *visit, const cJSON *result)
{
    const struct site *site = visit->site;
    const char *job = field_word(visit->doc, "job", "-");
    char events[3 * URL_NAME_MOST + 40], path[3 * URL_NAME_MOST + 1], title[URL_NAME_MOST + 8];
    struct html html;

    if (!html_begin(&html)) {
        visit_end(visit, MHD_HTTP_INTERNAL_SERVER_ERROR, "text/plain", NULL, 0);
        return;
    }
    url_escape(job, path);
    snprintf(events, sizeof events, "/events?kinds=state&job=%s", path);
    snprintf(title, sizeof title, "Job %.*s", URL_NAME_MOST, job);
    html_head(&html, &(struct html_head) { .title = title, .events = events,
                                           .poll = has_ended(visit->doc) ? 0 : 2,
                                           .token = site_acts(site) ? site->token : NULL });
    html_section(&html, "state", "State");
    show_state(&html, visit->doc);
    if (site_acts(site))
        show_actions(&html, visit->doc);
    html_section_end(&html);
    if (is_state(visit->doc, "done"))
        show_result(&html, visit, result);
    html_foot(&html);
    visit_end_page(visit, MHD_HTTP_OK, &html);
}

static void draw(struct visit *visit, const cJSON *result)
{
    struct modal_error err = { 0 };
    struct html svg;
    char *text;
    size_t length;

    if (!html_begin(&svg)) {
        visit_end(visit, MHD_HTTP_INTERNAL_SERVER_ERROR, "text/plain", NULL, 0);
        return;
    }
    if (plot_draw(svg.file, field_word(result, "kind", "-"), result, NULL, &err) != MODAL_OK) {
        free(html_end(&svg, &length));
        visit_fail(visit, MHD_HTTP_NOT_FOUND, "No picture", err.message);
        return;
    }
    text = html_end(&svg, &length);
    visit_end(visit, MHD_HTTP_OK, "image/svg+xml", text, length);
}

static void on_result(void *context, const struct link_message *answer)
{
    struct visit *visit = context;
    cJSON *result = NULL;

    if (!is_reply(answer) || answer->body == NULL
        || json_read(answer->body, answer->length, &result, NULL) != MODAL_OK)
        visit_fail_by(visit, answer);
    else if (visit->url.page == URL_PICTURE)
        draw(visit, result);
    else
        show(visit, result);
    cJSON_Delete(result);
}

static void on_status(void *context, const struct link_message *answer)
{
    struct visit *visit = context;
    bool picture = visit->url.page == URL_PICTURE;

    if (!is_reply(answer)) {
        visit_fail_by(visit, answer);
        return;
    }
    visit->doc = cJSON_Duplicate(answer->header, true);
    bool done = is_state(visit->doc, "done"),
         small = field_number(visit->doc, "bytes", 0) <= JOB_PAGE_RESULT_MOST;
    if (done && small) {
        if (!ask(&visit->site->service.ask, "RESULT",
                 job_header(field_word(visit->doc, "job", "-")), on_result, visit))
            visit_fail_by(visit, NULL);
    } else if (picture)
        visit_fail(visit, MHD_HTTP_NOT_FOUND, "No picture",
                   done ? "The result is too much for a page; modalctl result JOB --plot FILE.svg "
                          "draws it."
                        : "The job has no result.");
    else
        show(visit, NULL);
}

void job_page_show(struct visit *visit)
{
    if (ask(&visit->site->service.ask, "STATUS", job_header(visit->url.name), on_status, visit))
        visit_wait(visit);
    else
        visit_fail_by(visit, NULL);
}

static void on_done(void *context, const struct link_message *answer)
{
    struct visit *visit = context;
    char *text = is_reply(answer) ? json_print(answer->header) : NULL;

    if (text == NULL)
        visit_fail_by(visit, answer);
    else
        visit_end(visit, MHD_HTTP_OK, "application/json", text, strlen(text));
}

void job_page_act(struct visit *visit)
{
    if (ask(&visit->site->service.ask, visit->url.verb, job_header(visit->url.name), on_done,
            visit))
        visit_wait(visit);
    else
        visit_fail_by(visit, NULL);
}
